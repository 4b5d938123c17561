"""One trajectory held between calls of ``Stepper.step``: its predictor and its rounding errors.

A loop of ``step`` gives each call the end of the one before. As long as it does, with the same time
step, parameters and solver, compiled code goes on in the memory of that call, which knows the steps
before it: a call then takes the sweeps, and gives the bits, of a step inside ``integrate``. Any
other call starts anew, as ``integrate`` does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..call.binding import Binding
from ..call.inputs import Inputs
from .integration import Run

__all__ = ["Held"]

Array = NDArray[Any]


class Held:
    """A run of one step, and of as many more as its caller asks for, one at a time."""

    def __init__(self, binding: Binding, run: Run, given: tuple[Any, ...]) -> None:
        self.run, self.steps = run, 0
        self._binding = binding
        #: What the caller gave beside the state, as given: a call that gives the same goes on.
        *self._given, self._given_parameters = *given[:-1], dict(given[-1])
        self._q, self._p = run.q.copy(), run.p.copy()
        self._nothing = tuple(binding.new(0) for _ in range(3)), np.zeros(0, dtype=np.intc)
        self._parameters = binding.parameters(run.parameters, run.t0)
        self._options = binding.options(run.tolerance, run.max_iterations, run.solver)
        self._report, self._work = binding.report(), binding.work()

    def goes_on(self, q: Any, p: Any, t0: Any, given: tuple[Any, ...]) -> bool:
        """Whether these are the end of the step before, and all else is as it was."""
        run = self.run
        return (
            type(q) is np.ndarray and type(p) is np.ndarray
            and q.dtype == self._q.dtype and p.dtype == self._p.dtype
            and np.array_equal(q, self._q) and np.array_equal(p, self._p)
            and (self._binding.time is None or t0 == run.t0 + self.steps * run.dt)
            and all(map(_same, given[:-1], self._given))
            and _same_numbers(given[-1], self._given_parameters)
        )

    def run_from(self, q: Any, p: Any, t0: Any) -> Run:
        """Return a run of one step from these, which the caller gave and were checked."""
        return replace(self.run, q=np.array(q, self._q.dtype), p=np.array(p, self._p.dtype),
                       t0=t0)

    def advance(self, inputs: Inputs | None = None) -> int:
        """Take a step, with its own inputs; return the status."""
        (q_out, p_out, work_out), counts = self._nothing
        status = self._binding.integrate(
            self._parameters, self._options, self.run.dt, 1, 1, self._q, self._p,
            (q_out, p_out, work_out, counts, work_out), self._report, self._work, inputs)
        self.steps += not status
        return status

    @property
    def state(self) -> tuple[Array, Array]:
        """Copies of q and p at the end of the last step."""
        return self._q.copy(), self._p.copy()


def _same(a: Any, b: Any) -> bool:
    """Whether two arguments are equal and of one type."""
    return type(a) is type(b) and not isinstance(a, np.ndarray) and bool(a == b)


def _same_numbers(a: Any, b: Mapping[str, Any]) -> bool:
    return isinstance(a, dict) and a.keys() == b.keys() and all(_same(a[k], b[k]) for k in b)
