"""The time step by measurement: ever halved pilot runs of the whole span, then the order's law.

The error of n steps is taken from the run of 2n, e = |q_n − q_2n| 2^r/(2^r − 1), r the order: the
largest of a path over the run, attitudes in rad and points in parts of their reach
(``motion_distance``). Where e is small enough, n (e/error)^(1/r) steps between two pilots are tried
too, and measured against the finest one. Nothing is concluded from a shorter time to a longer one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.arguments import shown
from ...core.errors import InputError, StepFailed
from ...core.exact_numbers import Number, as_double, exact
from ...core.interrupts import before_start
from ...core.registry import AIMS
from ..bindings.array_checks import as_real
from .motion_distance import MotionError

if TYPE_CHECKING:
    from ..integration.run_arguments import RunArguments
    from ..steppers.stepper import Stepper

__all__ = ["StepChoice", "StepPilot", "choose_dt", "step_choice"]

Array = NDArray[Any]

#: States of a run that are compared: all runs have a multiple of so many steps.
_ROWS = 16
#: Steps of the longest pilot run.
_MOST = 2**22
#: The law shall be met with something to spare; a number of steps that gains less is not tried.
_SPARE, _WORTH = 0.8, 0.9
#: A halved step whose error is not smaller by this meets round-off, once the error is small.
_HALVED = 1.5


@dataclass(frozen=True)
class StepPilot:
    """One run: its steps, and its error; infinite where a step did not converge."""

    steps: int
    error: float

    @property
    def converged(self) -> bool:
        """Whether its steps did, and those it was measured by."""
        return math.isfinite(self.error)


@dataclass(frozen=True)
class StepChoice:
    """A time step, and the pilot runs that it was chosen by.

    Attributes
    ----------
    dt : Fraction
        (t_end − t0)/steps.
    steps : int
    error : float
        Measured with it, in rad or in parts of a point's reach.
    pilots : tuple of StepPilot
        All that was measured, in this order.
    """

    dt: Fraction
    steps: int
    error: float
    pilots: tuple[StepPilot, ...]


def step_choice(
    stepper: Stepper, q: ArrayLike, p: ArrayLike, *, dt: Any, steps: Any, t_end: Any, error: Any,
    inputs: Any, **options: Any,
) -> StepChoice | None:
    """Return the choice that dt = "auto" stands for; None for any other dt."""
    if not (isinstance(dt, str) and dt == "auto"):
        if error is not None:
            raise InputError(f"error = {shown(error)} is for dt = 'auto', not for dt = "
                             f"{shown(dt)}; leave one of them away.")
        return None
    for name, value in (("steps", steps), ("inputs", inputs)):
        if value is not None:
            raise InputError(f"dt = 'auto' chooses how many steps there are, and {name} counts "
                             "them; leave it away, and give t_end.")
    return choose_dt(stepper, q, p, error=error, t_end=t_end, **options)


def choose_dt(
    stepper: Stepper, q: ArrayLike, p: ArrayLike, *, error: Number | None, t_end: Number | None,
    parameters: Mapping[str, Any], t0: Number = 0.0, **options: Any,
) -> StepChoice:
    """Return the time step with which the motion from t0 to t_end has the error that is wanted.

    ``options`` are other arguments of ``Stepper.run_arguments``.

    Raises
    ------
    InputError
        Where round-off, or the length of a pilot run, stands before the error.
    StepFailed
        Where no step converges.
    """
    if error is None or t_end is None:
        raise InputError("dt = 'auto' needs the error that is wanted, such as error=1e-9, and "
                         "t_end, the time of the last state.")
    if isinstance(parameters, Mapping):
        for name, value in parameters.items():
            if isinstance(value, str) and value in AIMS:
                raise InputError(f"dt = 'auto' is given with {name} = {value!r}, which depends on "
                                 "dt; give one of them a number.")
    wanted = float(as_real("error", error))
    if wanted <= 0:
        raise InputError(f"error = {wanted:g} is not positive; give one such as 1e-9.")
    begin, end = _fraction("t0", t0), _fraction("t_end", t_end)
    if begin == end:
        raise InputError(f"t_end = {as_double(end):g} is t0: there is no step to choose.")
    span = end - begin
    run = stepper.run_arguments(q, p, dt=span, steps=1, t0=t0, parameters=parameters, **options)
    with before_start("dt"):
        return StepSearch(stepper, span, wanted, run).choice()


class StepSearch:
    """Makes the runs and remembers their errors."""

    def __init__(
        self, stepper: Stepper, span: Fraction, wanted: float, arguments: RunArguments
    ) -> None:
        self.stepper, self.span, self.wanted, self.arguments = stepper, span, wanted, arguments
        self.order, self.epsilon = stepper.order, stepper.binding.epsilon
        self.pilots: list[StepPilot] = []

    def choice(self) -> StepChoice:
        """Return the fewest steps that were measured to do, all finer ones doing as well."""
        finest = self._halve()
        best = len(self.pilots) - 1
        while best and self.pilots[best - 1].error <= self.wanted:
            best -= 1
        found = self.pilots[best]
        if best:
            between = self._between(self.pilots[best - 1], found, finest)
            if between is not None:
                self.pilots.append(between)
                found = between if between.error <= self.wanted else found
        return StepChoice(self.span / found.steps, found.steps, found.error, tuple(self.pilots))

    def _halve(self) -> Array:
        """Halve the step until the error is as wanted, of two pilots at least; return the last q.
        """
        n, before, failure = _ROWS, None, None
        while n <= _MOST:
            after, failed = self._run(n)
            failure = failed or failure
            if n > _ROWS:
                self._measure(n // 2, before, after)
                if len(self.pilots) > 1 and self.pilots[-1].error <= self.wanted:
                    assert after is not None
                    return after
                self._refuse_round_off()
            n, before = 2 * n, after
        if before is None and failure is not None:
            raise failure
        last = self.pilots[-1]
        raise InputError(
            f"error = {self.wanted:g} is not reached with {_MOST:,} steps: with {last.steps:,} "
            f"of dt = {self._dt(last.steps):.3g} it is {last.error:.1e}; ask for a larger error, "
            "for a nearer t_end, or take a method of higher order.")

    def _run(self, n: int) -> tuple[Array | None, StepFailed | None]:
        """Return q of a run at _ROWS times, None where a step fails."""
        try:
            run = self.stepper.run(self.stepper.resolved(replace(
                self.arguments, dt=self.stepper.binding.number(self.span / n), steps=n,
                every=n // _ROWS), quiet=True))
        except StepFailed as failure:
            return None, failure
        return np.asarray(run.q), None

    def _measure(self, n: int, coarse: Array | None, fine: Array | None) -> None:
        error = math.inf
        if coarse is not None and fine is not None:
            error = _distance(coarse, fine) / (1 - 2.0**-self.order)
            error = math.inf if math.isnan(error) else error
        self.pilots.append(StepPilot(n, error))

    def _between(self, coarse: StepPilot, fine: StepPilot, finest: Array) -> StepPilot | None:
        """Return what the law asks for between two pilots, measured; None if that is not worth it.
        """
        if not math.isfinite(coarse.error):
            return None
        law = coarse.steps * (coarse.error / (_SPARE * self.wanted)) ** (1 / self.order)
        n = _ROWS * math.ceil(law / _ROWS)
        if n > _WORTH * fine.steps:
            return None
        q, _ = self._run(n)
        if q is None:
            return None
        part = (n / (2 * self.pilots[-1].steps)) ** self.order
        return StepPilot(n, _distance(q, finest) / (1 - part))

    def _refuse_round_off(self) -> None:
        """Refuse an error below what the last halved steps could not make smaller."""
        last = [pilot.error for pilot in self.pilots[-3:]]
        if len(last) < 3 or max(last[1:]) > math.sqrt(self.epsilon) or any(
                before >= _HALVED * after for before, after in pairwise(last)):
            return
        raise InputError(
            f"error = {self.wanted:g} is below round-off: it stays at {min(last):.1e} however "
            "small dt is; ask for more than that, or take a stepper of a wider type.")

    def _dt(self, n: int) -> float:
        return as_double(self.span / n)


def _fraction(name: str, value: Any) -> Fraction:
    as_real(name, value)
    number = exact(value)
    assert isinstance(number, Fraction)
    return number


def _distance(q: Array, reference: Array) -> float:
    """Return the largest distance of a path over the rows, in rad or in parts of its reach."""
    error = MotionError(reference, np.asarray(reference, dtype=float))
    off = error(q)
    return max((float(np.sqrt((off[:, path] ** 2).sum(axis=1)).max()) / (unit or 1.0)
                for path, unit in zip(error.paths, error.units, strict=True)), default=0.0)
