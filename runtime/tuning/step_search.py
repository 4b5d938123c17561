"""The time step by measurement: pilot runs of the whole span, their steps halved.

The error of n steps is taken from the run of 2n, e = |q_n − q_2n| 2^r/(2^r − 1), r the order: the
largest of a path over the run, attitudes in rad and points in parts of their reach
(``motion_distance``). Where e is small enough, n (e/error)^(1/r) steps between two pilot runs are
measured too, against the finest one.

In scaled time n counts steps of the first Δτ/n, not those of a run, and rows are at equal t.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arguments import count_text
from ...core.arrays import Array
from ...core.errors import InputError, StepFailed
from ...core.exact_numbers import as_double
from ...core.start import Start
from ...core.warnings import capture_warnings
from .motion_distance import MotionError, distances
from .pilots import Pilot

if TYPE_CHECKING:
    from ..integration.run_arguments import RunArguments
    from ..steppers.stepper import Stepper

__all__ = ["FEWEST", "StepSearch"]

#: Steps of the first pilot run, and rows at which errors are evaluated: the number of steps is a
#: multiple.
FEWEST = 16
#: Steps of the longest pilot run.
_MOST = 2**22
#: The law shall be met with a margin; a number of steps that saves less is not tried.
_SPARE, _WORTH = 0.8, 0.9
#: Errors of halved steps that decrease by less than this factor are round-off.
_LEAST_DECREASE = 1.5


class StepSearch:
    """The search for the step with which a run over a span has a given error."""

    def __init__(
        self, stepper: Stepper, span: Fraction, bound: float, run: RunArguments,
        report: Callable[[int], Any] | None = None, t_end: Any = None,
    ) -> None:
        """``run`` has the start, the parameters and the solver; its steps are not used.

        ``bound`` is the largest error, ``report`` takes the number of each pilot run, and ``t_end``
        is the end of runs in scaled time.
        """
        self.t_end = t_end
        self.stepper, self.span, self.bound, self.arguments = stepper, span, bound, run
        self.order, self.epsilon = stepper.order, stepper.binding.epsilon
        self.pilots: list[Pilot] = []
        self._steps: list[int] = []
        self._report = report

    def best(self) -> tuple[int, Pilot]:
        """Return the smallest measured number of steps that suffices, as all larger ones, and its
        pilot run.

        Raises InputError if round-off, or the length of a pilot run, is in the way of the error;
        StepFailed if no step converges.
        """
        if self.bound < self.epsilon:  # two pilot runs may agree in all digits by accident
            raise InputError(f"step_error = {self.bound:g} is below round-off, {self.epsilon:.1e}; "
                             "ask for more than that, or take a stepper of a wider type.")
        finest = self._halve()
        best_index = len(self.pilots) - 1
        # from the finest down, as long as every larger number of steps suffices too: a small error
        # by accident does not count
        while best_index and self.pilots[best_index - 1].motion <= self.bound:
            best_index -= 1
        if best_index and self._interpolated_step_suffices(best_index, finest):
            best_index = len(self.pilots) - 1
        return self._steps[best_index], self.pilots[best_index]

    def _halve(self) -> Array:
        """Halve the step until the error is small enough, in two pilots at least.

        Return q of the finest run, with twice the steps of the last pilot, at the compared times,
        shape (rows, n). Raises StepFailed if no run succeeds, InputError if the error stays large.
        """
        n, coarse_q, failure = FEWEST, None, None
        while n <= _MOST:
            fine_q, step_failure = self._run(n)
            failure = step_failure or failure
            if n > FEWEST:
                error = math.inf  # of a step that fails
                if coarse_q is not None and fine_q is not None:
                    # Richardson: e_n = |q_n − q_2n|/(1 − 2^−r)
                    error = _distance(coarse_q, fine_q) / (1 - 2.0**-self.order)
                self._add(n // 2, math.inf if math.isnan(error) else error)
                if len(self.pilots) > 1 and self.pilots[-1].motion <= self.bound:
                    assert fine_q is not None
                    return fine_q
                self._refuse_round_off()
            n, coarse_q = 2 * n, fine_q
        if coarse_q is None and failure is not None:
            raise failure
        raise InputError(
            f"step_error = {self.bound:g} is not reached with {count_text(_MOST, 'step')}: with "
            f"{self._steps[-1]:,} of dt = {self.pilots[-1].dt:.3g} it is "
            f"{self.pilots[-1].motion:.1e}; ask for a larger error, for a nearer t_end, or take a "
            "method of higher order.")

    def _run(self, n: int) -> tuple[Array | None, StepFailed | None]:
        """Return q of n steps at ``FEWEST`` + 1 rows, and None; or None and the failed step."""
        if self._report is not None:
            self._report(len(self.pilots) + 1)
        arguments, dt = self.arguments, self.stepper.binding.number(self.span / n)
        try:
            if self.t_end is None:
                run = self.stepper._run(self.stepper._checked_run(replace(
                    arguments, dt=dt, steps=n, every=n // FEWEST)))
            else:
                times = arguments.t0 + (self.t_end - arguments.t0) * np.arange(FEWEST) / FEWEST
                with capture_warnings():  # of coarse steps, which are not chosen
                    run = self.stepper.integrate(
                        Start(arguments.q, arguments.p, arguments.parameters, arguments.t0),
                        dtau=dt, t_end=self.t_end, t_eval=[*times, self.t_end])
        except StepFailed as failure:
            return None, failure
        return np.asarray(run.q), None

    def _add(self, n: int, error: float) -> None:
        """Append the pilot run of ``n`` steps with its error to the pilots of the search."""
        self._steps.append(n)
        dt = as_double(self.span / n)
        label = f"{count_text(n, 'step')}" if self.t_end is None else f"dtau = {dt:.6g}"
        self.pilots.append(Pilot(label, parameters={}, dt=dt, motion=error))

    def _interpolated_step_suffices(self, best: int, finest: Array) -> bool:
        """Run a number of steps between two pilot runs; return whether they suffice.

        The number follows from e ∝ n^−r. The coarser run is ``best`` − 1, and ``finest`` has q of
        the finest one. If fewer steps are worth a run, its pilot is added.
        """
        coarse_error = self.pilots[best - 1].motion
        if not math.isfinite(coarse_error):
            return False
        # e ∝ n^−r from the coarser pilot, with a margin; multiples of the rows, which all runs
        # share
        factor = (coarse_error / (_SPARE * self.bound)) ** (1 / self.order)
        predicted_steps = self._steps[best - 1] * factor
        n = FEWEST * math.ceil(predicted_steps / FEWEST)
        if n > _WORTH * self._steps[best]:
            return False
        q, _ = self._run(n)
        if q is None:
            return False
        # The finest run has an error too, a share (n/n_finest)^r of the measured distance.
        finest_share = (n / (2 * self._steps[-1])) ** self.order
        self._add(n, _distance(q, finest) / (1 - finest_share))
        return self.pilots[-1].motion <= self.bound

    def _refuse_round_off(self) -> None:
        """Raise an error if halving the step twice no longer reduces the error: round-off."""
        # ``motion`` of a pilot is its error; each pilot has half the step of the one before
        last_errors = [pilot.motion for pilot in self.pilots[-3:]]
        # large errors that do not fall yet are the pre-asymptotic range, not round-off
        if len(last_errors) < 3 or max(last_errors[1:]) > math.sqrt(self.epsilon):
            return
        if any(coarse >= _LEAST_DECREASE * fine for coarse, fine in pairwise(last_errors)):
            return
        raise InputError(
            f"step_error = {self.bound:g} is below round-off: the error stays at "
            f"{min(last_errors):.1e} however small dt is; ask for more than that, or take a "
            "stepper of a wider type.")


def _distance(q: Array, reference: Array) -> float:
    """Return the largest distance of a path over the rows, in rad or relative to its extent."""
    error = MotionError(reference, reference)
    return float(distances(error(q), error.paths).max())
