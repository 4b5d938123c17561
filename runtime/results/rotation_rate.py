"""The rotation of the fastest body in a step, and the limit of a method."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core.arrays import Array
from ...core.manifest import Manifest
from ...core.records import dataclass
from ...core.warnings import warn
from ..compilation.body_columns import BodyAt, bodies_of

if TYPE_CHECKING:
    from .trajectory import Trajectory

__all__ = ["LOOKED_AT", "LOST", "FastestRotation", "Limits", "Rotations", "are_slow",
           "fastest_rotation", "phase_error"]

#: A method of order r bears turns of r/2 + 1/2 rad a step, up to this. Measured on the fast top and
#: on free bodies with three moments, one of them beside the separatrix, over 20 turns: the error of
#: the attitude, in parts of the angle turned. Of order 2 it is 3 to 5 % at 1.25 rad (the paper's
#: runs with Δt = 0.01 s; 1 − 4 arctan(θ/4)/θ for the midpoint), and from 1.5 rad on the motion is
#: lost within three turns. At r/2 + 1/2 it is 1 % with order 4, 0.1 to 0.5 % with orders 6 and 8;
#: at 5 rad 2e-8 to 4e-4 with order 12 and 4e-15 to 2e-8 with order 20. At 6 rad steps of every
#: order find no solution for one motion or another.
_MOST = 5.0
#: From this error in parts of the angle on a motion is lost within some turns.
LOST = 0.05
#: Largest rotation in rad of an exact flow between two kicks: near π compositions have resonances.
_MOST_A_FLOW = 2.0
#: Stored states of a run that are compared for a warning: all of a long run would cost as much as
#: the steps of a small system.
LOOKED_AT = 64
#: Bodies of one state up to which floats are faster than arrays.
_FEW = 8
#: States of a run up to which floats are faster than arrays.
_FEW_ROWS = 16


#: For each body its inertia, the columns of its q and p, and the largest |Ω| in rad/s.
Limits = list[tuple[list[float], Sequence[int], float]]


class _Rotation(NamedTuple):
    """The rotation of a body in a step."""

    body: str  # "" if no body turns
    radians: float  # |Ω Δt|; −1, below the rotation of any body, if no body turns
    dt: float  # s


_NO_ROTATION = _Rotation("", -1.0, 0.0)


@dataclass(frozen=True)
class FastestRotation:
    """The fastest rotation among some states.

    Attributes
    ----------
    body : str
    radians : float
        |Ω Δt|, the rotation in a step.
    limit : float
        The largest rotation in a step for a method of this order.
    dt : float
        The time step, in seconds.
    order : int
        Order of the method.
    error : float or None
        The error of the attitude to expect, in parts of the angle turned, where it is known.
    clocked : bool
        Whether the caller chooses Δτ, the step of scaled time, in place of ``dt``.
    """

    body: str
    radians: float
    limit: float
    dt: float
    order: int
    error: float | None = None
    clocked: bool = False

    def warn(self) -> bool:
        """Warn if the rotation exceeds the limit of the method, and return whether it does."""
        if self.radians <= self.limit:
            return False
        warn(f"The fastest rotation, of {self.body}, is {self.radians:.3g} rad a step, and a "
             f"method of order {self.order} bears {self.limit:g} at the most: "
             f"{self._consequence}. {self._cure}")
        return True

    @property
    def _cure(self) -> str:
        """Return the advice of the warning, as a sentence."""
        share = self.limit / self.radians
        if self.clocked:
            return f"Take a dtau well below {share:.2g} times this one."
        return f"Take a dt well below {abs(self.dt) * share:.2g}."

    @property
    def _consequence(self) -> str:
        """Return the consequence of the rotation in a step, as the end of the warning."""
        if self.error is None or self.error > LOST:
            return "the motion is lost within some turns"
        return (f"errors are about {self.error:.0e} of the angle turned, and there are motions for "
                "which steps have no solution")


class Rotations:
    """The rotations of a stepper's bodies in a step.

    Rotations along a co-moving frame need not be resolved: with a frame there is no limit.
    """

    def __init__(self, manifest: Manifest) -> None:
        """Sort the bodies by the form of their inertia, and set the limit of |Ω Δt| for the scheme.
        """
        self.bodies = bodies_of(manifest)
        self._rates = [] if manifest.frame is None else [
            symmetry.name for symmetry in manifest.frame.symmetries]
        self._order, self._clocked = manifest.scheme.order, manifest.system.clock is not None
        self._limit = min(max(self._order // 2, 1) + 0.5, _MOST)
        # the longest flow of a splitting, in parts of Δt; other schemes solve for stages
        longest_flow = manifest.scheme.longest_flow
        self._solves_stages = longest_flow is None
        if longest_flow is not None:
            self._limit = _MOST_A_FLOW / longest_flow
        #: Bodies with moments, and bodies with tensors: their names, the columns of their q,
        #: (bodies, 4), and the parameters of their inertias one after another.
        self._groups = []
        for entry_count in (3, 6):
            group = {name: body for name, body in self.bodies.items()
                     if len(body.inertia) == entry_count}
            if group:
                columns = np.array([body.q for body in group.values()])
                inertia = [key for body in group.values() for key in body.inertia]
                self._groups.append(([*group], columns, inertia))

    def fastest(
        self, parameters: Mapping[str, Any], dt: Any, q: Array, p: Array
    ) -> FastestRotation | None:
        """Return |Ω Δt| of the body that turns fastest in rows of q and p, (rows, n).

        ``dt`` and each parameter are a number, or an array with an entry for each row. None where
        no body turns.
        """
        name, radians, step = self._largest(parameters, dt, q, p)
        if not name:
            return None
        error = phase_error(self._order, radians) if self._solves_stages else None
        return FastestRotation(name, radians, self._limit, step, self._order, error, self._clocked)

    def _largest(self, parameters: Mapping[str, Any], dt: Any, q: Array, p: Array) -> _Rotation:
        """Return the largest rotation in a step from the states q and p, shape (rows, n).

        Rows in which a co-moving frame moves are left out, and those that are not finite.
        """
        bodies = self.bodies
        if not bodies:
            return _NO_ROTATION
        if len(q) == 1:
            return self._largest_from_state(parameters, _only(dt), q[0], p[0])
        columns = (q.T.astype(float, copy=False), p.T.astype(float, copy=False))
        as_number = partial(np.asarray, dtype=float)
        # rotations along a frame that moves need not be resolved
        moves = [as_number(parameters[name]) != 0 for name in self._rates if name in parameters]
        dt = as_number(dt)
        largest, fastest, step = -1.0, "", 0.0
        with np.errstate(over="ignore", invalid="ignore"):  # numbers that are not finite stay out
            for name, body in bodies.items():
                inertia = [as_number(parameters[key]) for key in body.inertia]
                speeds = _angular_speed(inertia, *([x[i] for i in body.q] for x in columns))
                radians = abs(speeds * dt)
                # −1 rad is below the rotation of any body
                if moves:
                    radians = np.where(np.any(np.broadcast_arrays(*moves), axis=0), -1.0, radians)
                radians = np.where(np.isfinite(radians), radians, -1.0)
                row = int(np.argmax(radians))
                if largest < radians[row]:
                    largest, fastest = float(radians[row]), name
                    step = float(np.broadcast_to(dt, len(q))[row])
        return _Rotation(fastest, largest, step)

    def _largest_from_state(
        self, parameters: Mapping[str, Any], dt: float, q: Array, p: Array
    ) -> _Rotation:
        """Return the largest rotation in a step from one state, q and p of shape (n,).

        In Python's floats, which take a quarter of the time of arrays.
        """
        # in a frame that moves rotations along it need not be resolved: no body, and −1 rad
        bodies, largest, fastest = self.bodies, -1.0, ""
        if any(_only(parameters[name]) for name in self._rates if name in parameters):
            return _NO_ROTATION
        q, p = q.astype(float, copy=False), p.astype(float, copy=False)
        if len(bodies) > _FEW:
            bodies = self._fastest_of_many(parameters, q, p)
        state = q.tolist(), p.tolist()
        for name, body in bodies.items():
            inertia = [*map(_only, map(parameters.__getitem__, body.inertia))]
            speed = _angular_speed(inertia, *([*map(x.__getitem__, body.q)] for x in state))
            radians = abs(speed * dt)
            if largest < radians < math.inf:
                largest, fastest = radians, name
        return _Rotation(fastest, largest, dt)

    def _fastest_of_many(
        self, parameters: Mapping[str, Any], q: Array, p: Array
    ) -> dict[str, BodyAt]:
        """Return the fastest of the bodies with moments, and of those with tensors, by their names.

        q and p, shapes (n,), are one state. The speeds are computed in arrays, which takes less
        time than floats if there are many bodies.
        """
        fastest = {}
        for names, columns, inertia in self._groups:
            inertias = np.array([parameters[key] for key in inertia], float).reshape(len(names), -1)
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                speeds = _angular_speed([*inertias.T], [*q[columns].T], [*p[columns].T])
            name = names[int(np.argmax(np.where(np.isfinite(speeds), speeds, -1.0)))]
            fastest[name] = self.bodies[name]
        return fastest

    def warn(self, parameters: Mapping[str, Any], dt: Any, q: Array, p: Array) -> bool:
        """Warn if a body's rotation in a step exceeds the limit, and return whether it does."""
        if self._largest(parameters, dt, q, p).radians <= self._limit:
            return False
        fastest = self.fastest(parameters, dt, q, p)
        return fastest is not None and fastest.warn()

    def limits(self, parameters: Mapping[str, float], dt: float) -> Limits | None:
        """Return the limits of |Ω| for ``are_slow``; None for many bodies or a frame that moves.

        They have, for each body, its inertia, the columns of its q and p, and the largest |Ω| of
        which the method follows the rotation with the step dt.
        """
        if len(self.bodies) > _FEW or any(parameters.get(name) for name in self._rates):
            return None
        step = abs(float(dt))  # 0 for a wide step that doubles do not reach
        largest = self._limit / step if step else math.inf
        return [([parameters[key] for key in body.inertia], body.q, largest)
                for body in self.bodies.values()]

    def warn_of(self, trajectory: Trajectory) -> bool:
        """Warn and return as ``warn`` does, for some stored states of a run, the last among them.

        The start is left out: it is checked before the run.
        """
        count = len(trajectory) - 1 if self.bodies else 0
        if count < 2:  # the end of a single step is the start of the next call, which checks it
            return False
        q, p = trajectory.q, trajectory.p
        if count <= _FEW_ROWS and q.dtype == np.float64 and (
                trajectory.manifest.system.clock is None):
            limits = self.limits(trajectory.parameters, trajectory.dt)
            if limits is not None and all(map(are_slow, itertools.repeat(limits), q.tolist(),
                                              p.tolist())):
                return False
        # from the last row back to row 1
        sampled = slice(None, 0, -max(1, count // LOOKED_AT))
        return self.warn(trajectory.parameters, trajectory.time_steps[sampled], q[sampled],
                         p[sampled])

    def warn_of_many(self, parameters: Mapping[str, Any], dt: Array, q: Array, p: Array) -> None:
        """Warn as ``warn_of`` does, of the runs of an ensemble; q and p are (runs, states, n).

        ``dt`` has the step to each state after the start, or one step for each run.
        """
        count = q.shape[1] - 1
        if count < 2 or not self.bodies:
            return
        stride = max(1, count // LOOKED_AT)
        sampled = slice(None, 0, -stride)  # from the last row back to row 1
        rows, momenta = q[:, sampled], p[:, sampled]
        row_count = rows.shape[1]
        # ``dt`` has no entry for the start: the steps to the same states, from the last one back
        steps = np.broadcast_to(dt, (len(q), count))[:, :: -1][:, ::stride]
        self.warn({name: np.repeat(column, row_count) for name, column in parameters.items()},
                  steps.reshape(-1), rows.reshape(-1, rows.shape[2]),
                  momenta.reshape(-1, rows.shape[2]))


def fastest_rotation(trajectory: Trajectory) -> FastestRotation | None:
    """Return |Ω Δt| of the body that turns fastest in the stored states of a run, or None."""
    return Rotations(trajectory.manifest).fastest(
        trajectory.parameters, trajectory.time_steps, trajectory.q, trajectory.p)


def are_slow(limits: Limits, q: list[float], p: list[float]) -> bool:
    """Return whether no |Ω| of a state exceeds its limit of ``Rotations.limits``.

    A speed that is NaN exceeds it.
    """
    for inertia, columns, largest in limits:
        if not _angular_speed(inertia, [*map(q.__getitem__, columns)],
                              [*map(p.__getitem__, columns)]) <= largest:
            return False
    return True


def phase_error(order: int, radians: float) -> float:
    """Return the relative error of a phase that advances by ``radians`` a step, at most 1.

    It is the error of the diagonal Padé approximation of exp(iθ), (s!)² θ^2s/((2s)! (2s + 1)!) with
    2s the order. A rotation by θ advances the phase of q by θ/2, of harmonics by up to a few θ:
    measured errors are between a hundredth of this error and a hundred times it.
    """
    # factorials by log Γ, which does not overflow for high orders
    logarithm = (2 * math.lgamma(order / 2 + 1) - math.lgamma(order + 1) - math.lgamma(order + 2)
                 + order * math.log(max(radians, 1e-300)))
    return math.exp(min(logarithm, 0.0))


def _only(x: Any) -> float:
    """Return a number, or the only entry of an array, as a float."""
    return x if type(x) is float else float(x[0] if isinstance(x, np.ndarray) and x.shape else x)


def _angular_speed(inertia: list[Any], q: list[Any], p: list[Any]) -> Any:
    """Return |Ω| = |J⁻¹ ½ L(q) p| (19), from three moments or the six entries of J⁻¹.

    q, p and the inertia are lists of numbers, or of columns for many bodies; (x, y, z) = L(q) p.
    """
    (a, b, c, d), (e, f, g, h) = q, p
    x = -b * e + a * f + d * g - c * h
    y = -c * e - d * f + a * g + b * h
    z = -d * e + c * f - b * g + a * h
    if len(inertia) == 3:
        x, y, z = x / inertia[0], y / inertia[1], z / inertia[2]
    else:
        xx, xy, xz, yy, yz, zz = inertia
        x, y, z = xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z
    return (x * x + y * y + z * z) ** 0.5 / 2
