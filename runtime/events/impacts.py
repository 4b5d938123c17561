"""Runs with impacts: gaps that close, where the momenta jump and the run continues on its grid.

Compiled code takes the steps, locates the impacts and applies the law (``engine``, run/impacts.h);
here it is called in chunks, and the impacts become records.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.event import Impact, with_restitutions
from ...core.incompatibilities import LARGEST, refuse_together
from ...core.interrupts import catch_ctrl_c
from ...core.records import changed
from ...core.warnings import warn
from ..bindings.array_checks import as_real
from ..bindings.binding import Binding
from ..bindings.real_numbers import aligned
from ..bindings.run_memory import Rows, RunState, WorkMemory
from ..integration.run_arguments import RunArguments
from ..integration.step_loop import ChunkSize, finished, next_chunk, trajectory_of
from ..results.crossings import Impacts
from ..results.run_arrays import flat_multipliers
from ..results.trajectory import Trajectory
from .observer import with_row

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["ImpactBinding", "integrate_with_impacts", "joined", "refuse_unusable"]

Array = NDArray[Any]

#: Why compiled code returns before the end, beside the failures of a step.
_FULL, _REST, _INSIDE, _UNMOVABLE, _NOT_QUADRATIC = range(16, 21)
#: Impacts that one call returns at most.
_CAPACITY = 1024
_WORD = re.compile(r"[^\W\d]\w*")


class ImpactBinding:
    """Calls into the module of runs with impacts."""

    def __init__(self, own: Binding) -> None:
        self.own = own
        self._size = int(own.function("impact_size")())

    def course(self, run: RunArguments, gaps: Array, impacts: tuple[Impact, ...]) -> _Course:
        """Return a run of its own memory, before the first step."""
        own, memory = self.own, aligned(self._size)
        pointer = own.ffi.cast("void *", own.ffi.from_buffer(memory))
        e = np.array([as_real("restitution", impact.restitution, own.number)
                      for impact in with_restitutions(impacts, run.parameters)])
        state = RunState(run.q.copy(), run.p.copy(), own.report(), WorkMemory(pointer))
        return _Course(own, run, state, memory, gaps, own.converted(e),
                       own.new(len(gaps)), own.new(1))


@dataclass
class _Course:
    """A run with impacts after some steps; arrays that compiled code reads and fills."""

    own: Binding
    run: RunArguments
    state: RunState
    memory: Any
    gaps: Array
    restitution: Array
    margins: Array
    since: Array
    places: list[Array] = field(default_factory=list)
    hits: list[Array] = field(default_factory=list)
    #: The gap for which compiled code has returned early, and what it was at the start.
    last: int = 0
    gap_at_start: Any = 0

    def advance(self, steps: int, every: int, rows: Rows) -> int:
        """Take steps until all are done or something stops them; return the status."""
        own, state = self.own, self.state
        constants = self.run.constants(own)
        count = own.ffi.new("long *")
        places = np.zeros((_CAPACITY + 1, 2), np.dtype("l"))
        hits = own.new(_CAPACITY, 3 + 3 * own.n)
        status = int(own.function("integrate_impacts")(
            constants.parameters, constants.options, *own._fed(constants.inputs)[:2], constants.dt,
            steps, every, len(self.gaps), own.ffi.from_buffer("int[]", self.gaps),
            *map(own.pointer, (self.restitution, self.margins, state.q, state.p, rows.q, rows.p,
                               rows.multipliers)),
            own.ffi.from_buffer("int[]", rows.iterations, require_writable=True),
            *([own.pointer(rows.work)] if own.has_forces else []), own.pointer(self.since),
            _CAPACITY, count, own.ffi.from_buffer("long[]", places, require_writable=True),
            own.pointer(hits), state.record, state.work))
        self.places.append(places[: count[0]].copy())
        self.hits.append(hits[: count[0]].copy())
        self.last, self.gap_at_start = int(places[count[0], 0]), hits[0, 0]
        return status

    def impacts(self, which: int) -> Impacts:
        """Return the impacts of one gap."""
        own, run = self.own, self.run
        places, hits = np.concatenate(self.places), np.concatenate(self.hits)
        selected = places[:, 0] == which
        steps, hits = places[selected, 1], hits[selected]
        since, impulse, lost = hits[:, :3].T.astype(own.number_type)
        q, before, after = (hits[:, 3 + i * own.n : 3 + (i + 1) * own.n].copy() for i in range(3))
        elapsed = own.times(0 * run.t0, run.dt, steps) + since
        return Impacts(run.t0 + elapsed, q, before, after, impulse, lost, steps, elapsed)


def refuse_unusable(
    stepper: Stepper, run: RunArguments, impacts: tuple[Impact, ...], **asked: Any
) -> None:
    """Refuse impacts that the steps or the run cannot have; ``asked`` are features of the call."""
    system, binding = stepper.manifest.system, stepper.binding
    refuse_together(
        impacts="impacts", splitting=not binding.solves and "the scheme splitting",
        frame=bool(stepper.symmetries) and "a co-moving frame", scaled=binding.clocked
        and "a time_scale", velocity_constraints=bool(binding.rows) and "velocity constraints",
        large=binding.n > LARGEST and f"{binding.n} coordinates",
        energy=stepper.manifest.scheme.exact_energy and "energy=True",
        float128=stepper.manifest.real == "float128" and "real='float128'", **asked)
    others = {*system.momenta, *system.velocity_names, *binding.input_names}
    for impact in with_restitutions(impacts, run.parameters):
        if impact.quantity not in system.quantities:
            raise InputError(f"{impact.quantity!r} is no quantity of {system.name}; declare the "
                             f"gap, quantities={{'gap': {impact.quantity}}}.")
        moving = others & {*_WORD.findall(system.quantities[impact.quantity])}
        if moving:
            raise InputError(f"The gap {impact.quantity!r} depends on {min(moving)}; a gap is a "
                             "function of coordinates, parameters and time.")
        if run.dt < 0 and impact.restitution != 1:
            raise InputError(f"dt = {float(run.dt):g} runs backwards, where an impact with "
                             f"restitution = {impact.restitution} has no state before it; take "
                             "restitution=1, or a positive dt.")


def integrate_with_impacts(
    stepper: Stepper, run: RunArguments, impacts: tuple[Impact, ...],
    progress: Callable[[int], None] | None = None,
) -> Trajectory:
    """Return the trajectory of a run with its impacts, up to a gap that stays closed.

    Raises
    ------
    InputError
        For a gap that is negative at the start, one that no motion changes.
    StepFailed, Stopped
        As ``integrate`` does, with everything before.
    """
    own = stepper._impact_binding()
    names = list(stepper.manifest.system.quantities)
    gaps = np.array([names.index(impact.quantity) for impact in impacts], np.intc)
    course = own.course(run, gaps, impacts)
    state, pace, status = course.state, ChunkSize(), 0
    rows = Rows.allocate(own.own, run.rows + 1)
    rows.q[0], rows.p[0] = run.q, run.p
    with catch_ctrl_c() as interrupts:
        status = course.advance(0, 1, rows[1:])
        start_energy = state.record.energy_start
        while state.steps < run.steps and status in (0, _FULL) and not interrupts.requested:
            done = state.steps
            row = run.stored(done) + 1
            count, every = next_chunk(run, done, pace.begin(run.steps - done))
            most = rows.iterations[row]
            status = course.advance(count, every, rows[row:])
            rows.iterations[row] = max(most, rows.iterations[row])
            pace.end(max(state.steps - done, 1))
            if progress is not None:
                progress(state.steps)
    state.record.energy_start = start_energy
    trajectory = trajectory_of(stepper.binding, stepper.manifest, run, rows, state.record, state.q,
                               state.p)
    last = impacts[course.last]
    if status == _INSIDE:
        raise InputError(f"The gap {last.quantity!r} is {float(course.gap_at_start):.6g} at the "
                         "start, below 0; start where it is open.")
    if status == _UNMOVABLE:
        raise InputError(f"No motion on the constraints changes the gap {last.quantity!r}, which "
                         "closes: its gradient depends on theirs; leave its impact out.")
    if status == _NOT_QUADRATIC:
        raise InputError(f"H of {stepper.name} is not quadratic in p, so that the law of impacts "
                         "does not reverse the rate of a gap; take H = T(q, p) + V(q).")
    by_name = {impact.name: course.impacts(i) for i, impact in enumerate(impacts)}
    if status == _REST:
        trajectory = _at_rest(stepper, run, course, trajectory, last.name)
    count = sum(map(len, by_name.values()))
    trajectory = changed(
        trajectory, impacts=by_name, report=replace(trajectory.report, impacts=count),
        events={name: entries.crossings for name, entries in by_name.items()})
    if status == _REST:
        return trajectory
    return finished(stepper.binding, stepper.manifest, run, trajectory,
                    status if status != _FULL else 0, state, interrupts)


def _at_rest(
    stepper: Stepper, run: RunArguments, course: _Course, trajectory: Trajectory, name: str
) -> Trajectory:
    """Return a run with one more row, the state in which a gap stays closed; warn of it."""
    own, state = course.own, course.state
    elapsed = own.times(0 * run.t0, run.dt, np.array([state.steps])) + (
        course.since.astype(own.number_type))
    t = run.t0 + elapsed
    warn(f"The run ends at t = {float(t[0]):.9g} s, after {state.steps:,} of {run.steps:,} steps: "
         f"impacts of {name!r} follow each other faster than times resolve, and it stays closed. "
         "Go on from run[-1] with a system that has the gap as a constraint.")
    work = trajectory.work[-1:] * 0 + trajectory.report.work
    last = flat_multipliers(trajectory)[-1:] if len(trajectory) > 1 else own.new(1, own.multipliers)
    rows = Rows(state.q[None].copy(), state.p[None].copy(), last, np.zeros(1, np.intc), work)
    count = len(trajectory) - (not course.since[0] and run.stored(state.steps) * run.every
                          == state.steps)
    return with_row(stepper, trajectory, max(count, 1), (t, elapsed), rows)


def joined(earlier: Impacts, last: Impacts, steps: int, elapsed: Any) -> Impacts:
    """Return the impacts of a run and of its last part of a step, which begins at ``elapsed``."""
    last = replace(last, steps=last.steps + steps, elapsed=last.elapsed + elapsed)
    return Impacts(*(np.concatenate([getattr(part, name) for part in (earlier, last)])
                     for name in Impacts.__dataclass_fields__))
