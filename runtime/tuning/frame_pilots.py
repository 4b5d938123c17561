"""Short runs in different co-moving frames, and their errors.

The error is that of the motion, q_k − q(t_k), attitudes as angles and points in units of their
reach (``motion_distance``), with q(t) extrapolated from the same method at Δt/4 and Δt/8: without a
frame, or in the frame of the start, if that agrees with it as far as it can tell and is more exact.
The search for rates uses the first half of the runs, the choice all of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import StepFailed
from ..rigid_body.gamma_rules import gamma_m
from .frame_start import Direction
from .motion_distance import MotionError

if TYPE_CHECKING:
    from ..integration.run_arguments import RunArguments
    from ..results.trajectory import Trajectory
    from ..steppers.stepper import Stepper

__all__ = ["AGREES", "CLEAR", "SMALL", "FramePilot", "FramePilots"]

Array = NDArray[Any]

#: Rows of a run that errors are taken of, at most.
_ROWS = 250
#: How far two references may be apart, in parts of what the worse one changed by when refined.
AGREES = 4.0
#: How far apart at least, in parts of the measured error, where that is larger.
SMALL = 0.01
#: By how much a frame must be better than none.
CLEAR = 1.05


@dataclass(frozen=True)
class _Reference:
    """A motion by extrapolation; ``change``: from the one before, ``doubt``: its own error."""

    motion: Array
    error: MotionError
    scale: Array
    change: float
    doubt: float
    finest: Trajectory


@dataclass(frozen=True)
class FramePilot:
    """One short run: why it was made, its rates and γ, and its errors.

    Attributes
    ----------
    label : str
    values : dict
        Rates in rad/s, and γ in kg m² where it is chosen too.
    half, whole : float
        Root mean square error of the motion over the first half and over all of the run, in rad
        or in parts of a point's reach; infinite where a step did not converge.
    """

    label: str
    values: dict[str, float]
    half: float
    whole: float


class FramePilots:
    """Makes short runs and remembers them; a choice is an array: rates, then γ_m/γ of each body."""

    def __init__(
        self, stepper: Stepper, arguments: RunArguments, directions: list[Direction],
        bodies: Mapping[str, Any],
    ) -> None:
        self.stepper, self.arguments, self.steps = stepper, arguments, arguments.steps
        self.directions, self._bodies = directions, bodies
        self.means = {name: float(gamma_m(inertia)) for name, inertia in bodies.items()}
        self.done: list[FramePilot] = []
        self._known: dict[bytes, tuple[int, Array | None]] = {}
        self._halves: list[float] = []

    @property
    def rates(self) -> int:
        """How many rates there are."""
        return len(self.directions)

    def values(self, x: Array) -> dict[str, float]:
        """Return the parameters of a choice."""
        found: dict[str, float] = {symmetry.name: 0.0 for symmetry in self.stepper.symmetries}
        for rate, direction in zip(x, self.directions, strict=False):
            for name, weight in direction.weights.items():
                found[name] += float(rate) * weight
        inverse = x[self.rates :]
        return found | {name: mean / float(u)
                        for (name, mean), u in zip(self.means.items(), inverse, strict=True)}

    def run(self, x: Array, finer: int = 1) -> Trajectory | None:
        """Return a run, with steps so many times finer; None where one did not converge."""
        try:
            return self.stepper.run(self.stepper.checked_run(replace(
                self.arguments.refined(finer), every=finer * self.every,
                parameters=self.arguments.parameters | self.values(x))))
        except StepFailed:
            return None

    def coarser(self) -> FramePilots:
        """Return runs over the same time by steps twice as long."""
        run = self.arguments
        inputs = run.inputs and replace(run.inputs, values=run.inputs.values[:, ::2].copy())
        return FramePilots(self.stepper, replace(run, dt=2 * run.dt, steps=-(-run.steps // 2),
                                                 inputs=inputs), self.directions, self._bodies)

    @property
    def every(self) -> int:
        """Steps between two rows that errors are taken of."""
        return max(1, self.steps // _ROWS)

    def set_reference(self, none: Array, start: Array) -> Trajectory | None:
        """Extrapolate the motion, without a frame and in the start's frame; None if both fail.

        The frame's is taken where it is more exact, and no further from the other than that may be
        wrong: near an axis every run in one frame may err alike. Returns the finest run.
        """
        plain = self._reference(none)
        found, doubt = plain, math.inf if plain is None else plain.doubt
        moved = None if np.array_equal(start, none) else self._reference(start)
        if moved is not None and moved.doubt < doubt and (
                plain is None or self._agrees(plain, moved, self.run(none))):
            found = moved
        if found is None:
            return None
        epsilon = self.stepper.binding.epsilon
        self._motion, self._scale = found.error, found.scale
        self.doubt = found.doubt + epsilon * (2 + math.sqrt(self.steps) / 4)
        return found.finest

    def _agrees(self, plain: _Reference, moved: _Reference, run: Trajectory | None) -> bool:
        """Whether two references agree to within their own errors, or a part of a run's error."""
        apart, error = (0.0 if q is None else _size(plain.error(np.asarray(q))[1:] / plain.scale)
                        for q in (moved.motion, None if run is None else run.q))
        return apart <= max(AGREES * plain.change, SMALL * error)

    def _reference(self, x: Array) -> _Reference | None:
        """Return the motion in a frame, extrapolated; None where a run did not converge."""
        runs = [self.run(x, finer) for finer in (2, 4, 8)]
        second, fourth, eighth = (None if run is None else np.asarray(run.q) for run in runs)
        if second is None or fourth is None or eighth is None or runs[-1] is None:
            return None
        factor = 2**self.stepper.order - 1
        motion = eighth + (eighth - fourth) / factor
        coarser = fourth + (fourth - second) / factor
        error = MotionError(motion, np.asarray(eighth, dtype=float))
        units = _units(error)
        change = _size(error(coarser)[1:] / units)
        return _Reference(motion, error, units, change, change / 2 ** (self.stepper.order + 2),
                          runs[-1])

    def measure(self, label: str, x: Array) -> int:
        """Run and return the number of the run; what is known is not run again."""
        key = np.asarray(x, dtype=float).tobytes()
        if key not in self._known:
            run = self.run(x)
            errors = None
            if run is not None:
                errors = self._motion(np.asarray(run.q))[1:] / self._scale
            half, whole = (math.inf, math.inf) if errors is None else (
                _size(errors[: (len(errors) + 1) // 2]), _size(errors))
            self._known[key] = len(self.done), errors
            self._halves.append(math.inf if errors is None else _size(errors[len(errors) // 2 :]))
            self.done.append(FramePilot(label, self.values(x), half, whole))
        return self._known[key][0]

    def is_clear(self, number: int, plain: int = 0) -> bool:
        """Whether a run's error is below another's by more than can be wrong with either.

        By 5 % and the doubt of both, over all of the run and over its second half.
        """
        pairs = ((self.done[number].whole, self.done[plain].whole),
                 (self._halves[number], self._halves[plain]))
        return all(CLEAR * (moved + self.doubt) <= still - self.doubt for moved, still in pairs)

    def errors(self, x: Array) -> Array | None:
        """Return the errors of the first half as one array, of a choice that was measured."""
        errors = self._known[np.asarray(x, dtype=float).tobytes()][1]
        return None if errors is None else errors[: (len(errors) + 1) // 2].ravel()


def _units(error: MotionError) -> Array:
    """Return what a column of an error is held against: 1 rad, or the reach of a point."""
    units = np.ones(max(max(path) for path in error.paths) + 1)
    for path, unit in zip(error.paths, error.units, strict=True):
        units[path] = unit or 1.0
    return units


def _size(errors: Array) -> float:
    """Return the root mean square over time of the distance."""
    size = float(np.sqrt((errors**2).sum(axis=1).mean())) if len(errors) else 0.0
    return size if math.isfinite(size) else math.inf
