"""Pilot runs: short integrations with trial parameters, and the errors of motion and energy.

The error of the motion is q_k − q(t_k), path by path (``motion_distance``). The reference q(t) is
extrapolated (Richardson) from the same method at Δt/4 and Δt/8, without a frame; or in the frame of
the start, if its reference is more accurate and agrees with the first: near an axis of a symmetry
all runs in one frame have similar errors. The error of the energy is H_k − H_0 − W_k.

A trial is an array x: the rates of the frame in rad/s, then γ_m/γ of each body, for the error of a
run is a polynomial of both, and linear in 1/γ to leading order (paper, (34)).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core.arrays import Array
from ...core.errors import StepFailed
from ...core.records import dataclass
from ...core.registry import Aim
from .frame_start import Direction
from .motion_distance import MotionError, root_mean_squares

if TYPE_CHECKING:
    from ..integration.run_arguments import RunArguments
    from ..results.trajectory import Trajectory
    from ..steppers.stepper import Stepper

__all__ = ["DIFFERENCE", "Pilot", "Pilots"]

#: Label of runs for derivatives.
DIFFERENCE = "difference"

#: Rows of a run at which errors are evaluated, at most twice as many.
_ROWS = 250
#: Two references agree if their distance is at most this multiple of the last refinement of the
#: less accurate one, or this part of the measured error.
_AGREES, _SMALL = 4.0, 0.01
#: Factor by which every path's error must decrease.
_CLEAR = 1.05
#: A path's error below this multiple of its uncertainty is round-off.
_ROUND_OFF = 4.0
#: Runs that the reference is extrapolated from have steps of Δt over these.
_REFINEMENTS = 2, 4, 8


@dataclass(frozen=True)
class Pilot:
    """A pilot run: its purpose, its parameters, and its errors.

    Attributes
    ----------
    label : str
    parameters : dict of str to float
        Rates in rad/s and γ or α in kg m².
    dt : float
        Time step in s.
    motion : float
        The largest error of a path: root mean square over the run, in a search for a step the
        maximum. Attitudes in rad, points in parts of their largest coordinate. Infinite if a step
        did not converge.
    worst : float
        The largest ratio of a path's error to the error of the first pilot; NaN if all are
        round-off, and in a search for a step.
    energy : float
        Root mean square of H_k − H_0, with forces of H_k − H_0 − W_k, in the units of H; NaN in a
        search for a step.
    """

    label: str
    parameters: dict[str, float]
    dt: float
    motion: float
    worst: float = math.nan
    energy: float = math.nan


class _RunErrors(NamedTuple):
    """Errors of a pilot run: of the motion by rows and columns, of the energy by rows."""

    motion: Array
    energy: Array


@dataclass(frozen=True)
class _Reference:
    """An extrapolated motion, and the size of its last refinement, of all paths and of each."""

    motion: Array
    error: MotionError
    change: float
    changes: Array
    finest: Trajectory


class Pilots:
    """Pilot runs of one start, and their errors by number; equal trials run once."""

    def __init__(
        self, stepper: Stepper, run: RunArguments, directions: list[Direction],
        means: dict[str, float], aim: Aim, report: Callable[[int], Any] | None, *, longer: bool,
    ) -> None:
        """Pilot runs of ``run`` with rates along ``directions`` and numbers for γ, α.

        ``means`` are the γ_m of the searched γ by name, ``aim`` says which error is to be small.
        ``longer``: the choice is for a run that continues where the pilot runs end, which matters
        to the error of the motion alone. ``report`` takes the number of each pilot run.
        """
        self.stepper, self.arguments, self.directions = stepper, run, directions
        self.means, self.aim, self.longer = means, aim, longer and aim == "motion"
        self.every = max(1, run.steps // _ROWS)
        self.trials: list[Array] = []
        self._labels: list[str] = []
        self._errors: list[_RunErrors | None] = []
        self._runs, self._report = 0, report

    def parameters(self, x: Array) -> dict[str, float]:
        """Return the parameters of a trial x: rates by their directions' weights, γ = γ_m/u.

        x has the rate of each direction, then u of each γ.
        """
        rates: dict[str, float] = {}
        if self.directions:
            rates = {symmetry.name: 0.0 for symmetry in self.stepper.symmetries}
        of_directions, of_means = np.split(x, [len(self.directions)])
        for rate, direction in zip(of_directions, self.directions, strict=True):
            for name, weight in direction.weights.items():
                rates[name] += float(rate) * weight
        return rates | {name: mean / float(u)
                        for (name, mean), u in zip(self.means.items(), of_means, strict=True)}

    def run(self, x: Array, refinement: int = 1) -> Trajectory | None:
        """Return the run of a trial x with steps of Δt/refinement.

        x has the rates of the frame in rad/s and then γ_m/γ of each body, shape (unknowns,). None
        if a step does not converge.
        """
        self._runs += 1
        if self._report is not None:
            self._report(self._runs)
        try:
            return self._integrate(x, refinement)
        except StepFailed:
            return None

    def _integrate(self, x: Array, refinement: int) -> Trajectory:
        """Return the run of a trial x with steps Δt/refinement, its rows at equal times.

        Raises StepFailed.
        """
        # refinement times as many steps between rows: equal times, so that errors are differences
        run = replace(self.arguments.refine(refinement), every=refinement * self.every,
                      parameters=self.arguments.parameters | self.parameters(x))
        return self.stepper._run(self.stepper._checked_run(run))

    # ------------------------------------------------------------ the reference

    def set_reference(self, base: Array, start: Array) -> Trajectory:
        """Extrapolate the motion from the base and in the start's frame; return the finest run.

        Sets what errors are measured by: ``paths``, ``rows``, ``rounding``, the round-off of a
        state, and ``doubt``, the uncertainty of each path's error. Raises StepFailed if the refined
        runs of neither converge.
        """
        base_motion = self._reference(base)
        frame_motion = None if np.array_equal(start, base) else self._reference(start)
        reference = base_motion
        if frame_motion is not None and (base_motion is None or (
                frame_motion.change < base_motion.change
                and self._agrees(base_motion, frame_motion, self.run(base)))):
            reference = frame_motion
        if reference is None:
            for refinement in _REFINEMENTS:  # the one that failed fails again
                self._integrate(base, refinement)
            raise AssertionError("a step that failed has not failed again")
        self._motion, finest = reference.error, reference.finest
        epsilon = self.stepper.binding.epsilon
        # q and p are rounded once each; the compensated sums of N steps err by about ε √N / 4
        rounding = epsilon * (2 + math.sqrt(self.arguments.steps) / 4)
        if self.aim == "motion":
            self.paths, self.rounding = reference.error.paths, rounding
            # the reference has an error of order r + 1 in Δt/8: 2^(r+1) times less than its change
            # from twice that step; a factor 2 for safety
            self.doubt = reference.changes / 2 ** (self.stepper.order + 2) + rounding
        else:
            # errors of the energy have one column
            H = float(np.abs(np.asarray(finest.energies, dtype=float)).max())
            self.paths, self.rounding, self.doubt = [[0]], epsilon * H, np.array([epsilon * H])
        self.rows = len(finest) - 1
        return finest

    def _reference(self, x: Array) -> _Reference | None:
        """Return the reference motion of a trial x by Richardson's extrapolation.

            q = q_8 + (q_8 − q_4)/(2^r − 1),   q_k by steps of Δt/k

        Its uncertainty is the distance from q_4 + (q_4 − q_2)/(2^r − 1). x has the shape
        (unknowns,); None if a run fails.
        """
        runs = [self.run(x, refinement) for refinement in _REFINEMENTS]
        second, fourth, eighth = (None if run is None else np.asarray(run.q) for run in runs)
        if second is None or fourth is None or eighth is None or runs[-1] is None:
            return None
        factor = 2**self.stepper.order - 1
        motion = eighth + (eighth - fourth) / factor
        error = MotionError(motion, eighth)
        # the extrapolation of twice the step: its distance bounds the error of the reference
        change = error(fourth + (fourth - second) / factor)[1:]
        return _Reference(motion, error, _total(change), root_mean_squares(change, error.paths),
                          runs[-1])

    def _agrees(
        self, base_motion: _Reference, frame_motion: _Reference, run: Trajectory | None
    ) -> bool:
        """Whether the reference in a frame agrees with the reference of the base.

        Their distance must be at most 4 times the last refinement of the base's, or 1 % of the
        error of ``run``, a run with the base.
        """
        def distance(q: Array) -> float:
            """Return the distance of a motion from the base's reference, without the start."""
            return _total(base_motion.error(q)[1:])

        run_error = 0.0 if run is None else distance(np.asarray(run.q))
        return distance(np.asarray(frame_motion.motion)) <= max(
            _AGREES * base_motion.change, _SMALL * run_error)

    # ------------------------------------------------------------ errors

    def measure(self, label: str, x: Array) -> int:
        """Return the index of the pilot run of a trial; the run is integrated if it is new."""
        for index, trial in enumerate(self.trials):
            if np.array_equal(x, trial):
                return index
        run = self.run(x)
        self.trials.append(x)
        self._labels.append(label)
        self._errors.append(None if run is None else _RunErrors(
            self._motion(np.asarray(run.q))[1:],
            np.asarray(run.energy_error()[1:], dtype=float)[:, None]))
        return len(self.trials) - 1

    def errors(self, index: int, rows: slice | None = None) -> Array | None:
        """Return the errors that the search minimises, (rows, columns); None if the run failed."""
        errors = self._errors[index]
        if errors is None:
            return None
        minimised = errors.energy if self.aim == "energy" else errors.motion
        return minimised[: self.rows][rows or slice(None)]

    def sizes(self, index: int, rows: slice | None = None) -> Array:
        """Return the root mean square error of each path; infinite if the run failed."""
        errors = self.errors(index, rows)
        return root_mean_squares(errors, self.paths) if errors is not None else np.full(
            len(self.paths), math.inf)

    def largest(self, index: int, rows: slice | None = None) -> float:
        """Return the largest of ``sizes``."""
        return float(self.sizes(index, rows).max())

    @property
    def searched_rows(self) -> slice:
        """Rows whose errors a search minimises: the first half with rates, which would overfit."""
        return slice(0, (self.rows + 1) // 2 if self.directions else self.rows)

    def is_round_off(self, index: int) -> bool:
        """Whether the error of every path is round-off."""
        return bool((self.sizes(index) <= _ROUND_OFF * self.doubt).all())

    def is_clear(self, index: int, base: int = 0) -> bool:
        """Return whether the error of every path is well below the base's.

        With a path's error e and uncertainty δ, 1.05 (e + δ) ≤ e_base − δ over all rows; for a
        longer run also e + δ ≤ e_base − δ over the second, third and fourth quarter. Where the
        base's error is round-off, e may be that.
        """
        if self.largest(index) * _CLEAR > self.largest(base):
            return False
        base_is_round_off = self.sizes(base) <= 2 * _ROUND_OFF * self.rounding
        comparisons: list[tuple[float, slice | None]] = [(_CLEAR, None)]
        if self.longer:
            comparisons += [(1.0, quarter) for quarter in _quarters(self.rows)[1:]
                            if quarter.stop > quarter.start]
        for factor, rows in comparisons:
            base_sizes = self.sizes(base, rows)
            # A path that is exact with the base may keep an error of round-off.
            bound = np.where(base_is_round_off,
                             np.maximum(base_sizes, _ROUND_OFF * self.rounding) + self.rounding,
                             (base_sizes - self.doubt) / factor - self.doubt)
            if not (self.sizes(index, rows) <= bound).all():
                return False
        return True

    def gain(self, index: int) -> float:
        """Return the largest error of the base over the largest error of a run."""
        if index == 0:
            return 1.0
        return self.largest(0) / max(self.largest(index), self.rounding)

    def pilots(self) -> tuple[Pilot, ...]:
        """Return the records of all runs except those for differences."""
        return tuple(self.pilot(index) for index, label in enumerate(self._labels)
                     if label != DIFFERENCE)

    def pilot(self, index: int) -> Pilot:
        """Return the record of a run: its largest path error, the worst ratio to the base's."""
        errors, label, parameters = (self._errors[index], self._labels[index],
                                     self.parameters(self.trials[index]))
        dt = float(self.arguments.dt)
        if errors is None:
            return Pilot(label, parameters, dt, motion=math.inf, worst=math.inf, energy=math.inf)
        paths, base_errors, worst_ratio = self._motion.paths, self._errors[0], math.nan
        motion = root_mean_squares(errors.motion[: self.rows], paths)
        if base_errors is not None:
            base_sizes = root_mean_squares(base_errors.motion[: self.rows], paths)
            # paths that are exact with the base have no ratio
            worst_ratio = float((motion[base_sizes > 0]
                                 / base_sizes[base_sizes > 0]).max(initial=-math.inf))
        return Pilot(label, parameters, dt, motion=float(motion.max()),
                     worst=worst_ratio if math.isfinite(worst_ratio) else math.nan,
                     energy=float(root_mean_squares(errors.energy, [[0]])[0]))

    def rows_before(self, index: int, angle: float) -> int:
        """Return the number of rows before an attitude differs by more than ``angle``, in rad.

        All rows if none does, or if the run failed.
        """
        errors = self._errors[index]
        if errors is None:
            return self.rows
        exceeds = np.abs(errors.motion[:, self._motion.turning]).max(axis=1, initial=0) > angle
        return int(exceeds.argmax()) if exceeds.any() else self.rows

    def quarters(self, index: int) -> Array:
        """Return the error of each path in each quarter of the rows, shape (4, paths)."""
        return np.array([self.sizes(index, quarter) for quarter in _quarters(self.rows)])


def _quarters(rows: int) -> list[slice]:
    """Return the four quarters of ``rows`` rows, the first ones a row longer where 4 is no divisor.
    """
    bounds = np.cumsum([len(quarter) for quarter in np.array_split(np.arange(rows), 4)]).tolist()
    return [slice(begin, end) for begin, end in pairwise([0, *bounds])]


def _total(errors: Array) -> float:
    """Return the root mean square over the rows of the distance of all columns."""
    return float(root_mean_squares(errors, [[*range(errors.shape[1])]])[0])
