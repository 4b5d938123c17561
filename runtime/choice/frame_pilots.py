"""Short runs in different co-moving frames, and their errors.

The error is that of the motion, q_k − q(t_k), attitudes as angles and points in units of their
reach (``motion_error``), with q(t) extrapolated from the same method at Δt/4 and Δt/8 in the frame
that suits it best. Rates are looked for on the first half of the runs and judged on all of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import StepFailed
from ...exact import Number
from ...remarks import listening
from ..body.inertia import gamma_m
from .frame_start import Direction
from .motion_error import MotionError

if TYPE_CHECKING:
    from ..output.trajectory import Trajectory
    from ..run.stepper import Stepper

__all__ = ["FramePilot", "FramePilots"]

Array = NDArray[Any]

#: Rows of a run that errors are taken of, at most.
_ROWS = 250


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
        self, stepper: Stepper, q: ArrayLike, p: ArrayLike, dt: Any, steps: int,
        parameters: Mapping[str, Any], directions: list[Direction],
        bodies: Mapping[str, Any], t0: Number,
    ) -> None:
        self.stepper, self.q, self.p, self.dt, self.steps = stepper, q, p, dt, steps
        self.directions, self.t0, self._bodies = directions, t0, bodies
        self.means = {name: float(gamma_m(inertia)) for name, inertia in bodies.items()}
        self.parameters = dict(parameters)
        self.done: list[FramePilot] = []
        self._known: dict[bytes, tuple[int, Array | None]] = {}

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
            with listening():  # what is to be said is said of the run that is asked for
                return self.stepper.integrate(
                    self.q, self.p, dt=self.dt / finer, steps=self.steps * finer,
                    every=finer * self.every, t0=self.t0,
                    parameters=self.parameters | self.values(x))
        except StepFailed:
            return None

    def coarser(self) -> FramePilots:
        """Return runs over the same time by steps twice as long."""
        return FramePilots(self.stepper, self.q, self.p, 2 * self.dt, -(-self.steps // 2),
                           self.parameters, self.directions, self._bodies, self.t0)

    @property
    def every(self) -> int:
        """Steps between two rows that errors are taken of."""
        return max(1, self.steps // _ROWS)

    def set_reference(self, choices: list[Array]) -> Trajectory | None:
        """Extrapolate the motion, in the frame where this changes least; None if none converges.

        Returns the finest run that it was made of.
        """
        best = math.inf
        finest = None
        for x in choices:
            runs = [self.run(x, finer) for finer in (2, 4, 8)]
            if any(run is None for run in runs):
                continue
            second, fourth, eighth = (np.asarray(run.q) for run in runs if run is not None)
            factor = 2**self.stepper.order - 1
            motion = eighth + (eighth - fourth) / factor
            coarser = fourth + (fourth - second) / factor
            error = MotionError(motion, np.asarray(eighth, dtype=float))
            units = _units(error)
            doubt = _size(error(coarser)[1:] / units) / 2 ** (self.stepper.order + 2)
            if doubt < best:
                best, finest = doubt, runs[-1]
                self._motion, self._scale, self.doubt = error, units, doubt
        if finest is not None:
            epsilon = self.stepper.binding.epsilon
            self.doubt += epsilon * (2 + math.sqrt(self.steps) / 4)
        return finest

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
            self.done.append(FramePilot(label, self.values(x), half, whole))
        return self._known[key][0]

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
