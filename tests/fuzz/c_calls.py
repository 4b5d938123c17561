"""The C functions of a stepper called directly, on memory with guards behind every array.

Doubles are any, finite or not; counts and enumerations are any that the header does not rule out.
Whatever comes in, a call returns a status of the four, leaves the guards alone, and calls nothing
done that is not finite.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from gyrospark.runtime.bindings.binding import REASONS

from .choices import Choices
from .steppers import NAMES, Case, case

GUARD = 8
MARK = -7.25e99
STATES = 6


class Memory:
    """Arrays of doubles, each between guards."""

    def __init__(self, case: Case, choices: Choices) -> None:
        self.case, self.choices = case, choices
        self.use(case.step.binding)
        self.arrays: list[np.ndarray] = []

    def use(self, binding: Any) -> None:
        """Call functions of this module from now on."""
        self.binding, self.ffi, self.lib = binding, binding.ffi, binding.lib

    def new(self, count: int, fill: float = 0.0) -> Any:
        """Return a pointer to so many doubles."""
        array = np.full(count + 2 * GUARD, MARK)
        array[GUARD : GUARD + count] = fill
        self.arrays.append(array)
        return self.ffi.from_buffer("double[]", array, require_writable=True) + GUARD

    def optional(self, count: int) -> Any:
        return self.ffi.NULL if self.choices.one_in(4) else self.new(count)

    def state(self, base: np.ndarray, count: int = 1) -> Any:
        """Return states: as they should be, a little off, or with some numbers of any kind."""
        pointer = self.new(count * len(base))
        values = np.tile(base, count)
        kind = self.choices.below(4)
        with np.errstate(all="ignore"):
            if kind == 1:
                values = values * (1 + 1e-3 * self.choices.double())
            for _ in range(self.choices.below(4) if kind > 1 and count else 0):
                values[self.choices.below(len(values))] = self.choices.double()
            if kind == 3:
                values = values * self.choices.double()
        self.arrays[-1][GUARD:-GUARD] = values
        return pointer

    def result(self, index: int) -> np.ndarray:
        return self.arrays[index][GUARD:-GUARD]

    def refuse_overrun(self) -> None:
        for array in self.arrays:
            assert (array[:GUARD] == MARK).all(), "written in front of an array"
            assert (array[-GUARD:] == MARK).all(), "written behind an array"

    # ------------------------------------------------------------ structs

    def parameters(self) -> Any:
        values = dict(self.case.parameters)
        names = list(values)
        if self.choices.below(2):
            for _ in range(self.choices.below(4)):
                values[self.choices.pick(names)] = self.choices.double()
        if self.case.step.binding.time is not None:
            values[self.case.step.binding.time] = self.choices.double()
        return self.ffi.new(f"{self.case.step.name}_parameters *", values)

    def options(self) -> Any:
        """Iterations are few: a caller who asks for 2^31 of them may wait for them."""
        tolerance = self.choices.double() if self.choices.below(2) else 0.0
        most = self.choices.pick((50, 50, 1, 0, 3, 200, -1, -(2**31)))
        solver = self.choices.pick((0, 0, 1, 2, 3, -1, 2**31 - 1, -(2**31)))
        return self.ffi.new(f"{self.case.step.name}_options *", [tolerance, most, solver])

    def dt(self) -> float:
        return 1e-3 if self.choices.below(3) == 0 else self.choices.double()

    def work(self) -> Any:
        """Return work memory with any contents: it needs no preparation."""
        work = self.binding.work()
        self.ffi.memmove(work, bytes([self.choices.pick((0, 255, 127, 1))])
                         * self.ffi.sizeof(work[0]), self.ffi.sizeof(work[0]))
        return work

    def call(self, name: str, *arguments: Any) -> Any:
        return getattr(self.lib, f"{self.case.step.name}_{name}")(*arguments)


def check(data: bytes) -> str:
    """Call one function of one stepper."""
    choices = Choices(data)
    memory = Memory(case(choices.pick(NAMES)), choices)
    outcome = CALLS[choices.below(len(CALLS))](memory, choices)
    memory.refuse_overrun()
    return outcome


def step(memory: Memory, choices: Choices) -> str:
    binding = memory.case.step.binding
    par, options, dt = memory.parameters(), memory.options(), memory.dt()
    q, p = memory.state(memory.case.q), memory.state(memory.case.p)
    in_place = choices.below(2)
    q1, p1 = (q, p) if in_place else (memory.new(binding.n), memory.new(binding.n))
    multipliers = memory.new(max(binding.multipliers, 1))
    taken = memory.ffi.new("int *", -5)
    status = memory.call("step", par, options, dt, q, p, q1, p1, multipliers, taken, memory.work())
    return judged(status, memory.result(0 if in_place else 2), memory.result(1 if in_place else 3))


def integrate(memory: Memory, choices: Choices) -> str:
    binding, ffi = memory.case.step.binding, memory.ffi
    par, options, dt, work = memory.parameters(), memory.options(), memory.dt(), memory.work()
    steps, every = choices.below(STATES + 1), choices.pick((1, 1, 2, 3, 7, 10**6, 2**63 - 1))
    q, p = memory.state(memory.case.q), memory.state(memory.case.p)
    rows = steps // every
    report = binding.report()
    calls = 1 + choices.below(2)  # a second call goes on, from wherever the first one ended
    for _ in range(calls):
        out = [memory.optional(rows * size) for size in (binding.n, binding.n,
                                                         binding.multipliers)]
        counts = ffi.NULL if choices.one_in(4) else ffi.new("int[]", rows + 1)
        done = [memory.optional(rows)] if binding.has_forces else []
        status = memory.call("integrate", par, options, dt, steps, every, q, p, *out, counts,
                             *done, report, work)
        assert counts == ffi.NULL or counts[rows] == 0, "written behind the counts"
        assert 0 <= report.steps <= calls * steps
    return judged(status, memory.result(0), memory.result(1)) if steps else "no step"


def lanes(memory: Memory, choices: Choices) -> str:
    """Side by side, with differing parameters and states; one that fails does not disturb."""
    memory.use(memory.case.step._binding_of_many)
    binding, ffi, name = memory.binding, memory.ffi, memory.case.step.name
    if not binding.lanes:
        return "no lanes"
    count = choices.below(binding.lanes + 1)
    par = ffi.new(f"{name}_parameters[]", count)
    for i in range(count):
        par[i] = memory.parameters()[0]
    options = memory.options()
    steps, every = choices.below(STATES + 1), choices.pick((1, 2, 5, 2**63 - 1))
    rows = steps // every
    q, p = memory.state(memory.case.q, count), memory.state(memory.case.p, count)
    dt = memory.new(count)
    memory.result(2)[:] = [memory.dt() for _ in range(count)]
    out = [memory.optional(count * rows * size) for size in (binding.n, binding.n,
                                                             binding.multipliers)]
    counts = ffi.NULL if choices.one_in(4) else ffi.new("int[]", count * rows + 1)
    done = [memory.optional(count * rows)] if binding.has_forces else []
    status = ffi.new("int[]", count + 1)
    batch, work = binding.batch_memory()
    memory.call("integrate_lanes", count, par, options, dt, steps, every, rows, q, p, *out, counts,
                *done, binding.reports(count), status, batch, work)
    assert status[count] == 0, "written behind the statuses"
    assert counts == ffi.NULL or counts[count * rows] == 0, "written behind the counts"
    n, kinds = binding.n, set()
    for i in range(count if steps else 0):
        part = slice(i * n, (i + 1) * n)
        kinds.add(judged(status[i], memory.result(0)[part], memory.result(1)[part]))
    return "accepted" if kinds <= {"accepted"} else "some or all failed"


def halves(memory: Memory, choices: Choices) -> str:
    """T1 and T2, residual, Jacobian, guess, increment size, at any x."""
    binding = memory.case.step.binding
    par, options, dt, work = memory.parameters(), memory.options(), memory.dt(), memory.work()
    q, p = memory.state(memory.case.q), memory.state(memory.case.p)
    x = memory.state(np.zeros(binding.unknowns))
    r, J = memory.new(binding.unknowns), memory.new(binding.unknowns**2)
    taken = memory.ffi.new("int *")
    kind = choices.below(6)
    if kind == 0:
        memory.call("guess", par, dt, q, p, x, work)
    elif kind == 1:
        memory.call("residual", par, dt, q, p, x, r, work)
    elif kind == 2:
        memory.call("jacobian", par, dt, q, p, x, J, work)
    elif kind == 3:
        memory.call("increment_size", dt, q, p, x, r, work)
    elif kind == 4:
        status = memory.call("T1", par, options, dt, q, p, x, taken, work)
        return judged(status, memory.result(2))
    else:
        q1, p1 = memory.new(binding.n), memory.new(binding.n)
        multipliers = memory.new(max(binding.multipliers, 1))
        status = memory.call("T2", par, dt, q, p, x, q1, p1, multipliers, work)
        return judged(status, memory.result(5), memory.result(6))
    return "computed"


def rows(memory: Memory, choices: Choices) -> str:
    """H, defects, quantities of some states, or of none; projection."""
    binding = memory.case.step.binding
    par, count = memory.parameters(), choices.below(4)
    q, p = (memory.state(base, count) for base in (memory.case.q, memory.case.p))
    kind = choices.below(4)
    if kind == 0:
        memory.call("hamiltonian", par, count, q, p, memory.new(count))
    elif kind == 1:
        memory.call("defects", par, count, q, p, memory.new(count * binding.m),
                    memory.new(count * binding.m))
    elif kind == 2 and binding.quantity_names:
        memory.call("quantities", par, count, memory.state(np.zeros(1), count), q, p,
                    memory.new(count * len(binding.quantity_names)))
    else:
        q, p = memory.state(memory.case.q), memory.state(memory.case.p)
        return judged(memory.call("project", par, q, p), memory.result(2), memory.result(3))
    return "computed"


CALLS: tuple[Callable[[Memory, Choices], str], ...] = (step, integrate, lanes, halves, rows)


def judged(status: int, *results: np.ndarray) -> str:
    """Return what a status means; what is called done is finite."""
    assert status in (0, *REASONS), f"status {status}"
    if status == 0:
        assert all(math.isfinite(x) for part in results for x in part), "done, and not finite"
        return "accepted"
    return REASONS[status]
