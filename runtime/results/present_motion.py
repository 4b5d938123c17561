"""Bodies and joints of a simulation: the methods of ``run.body`` and ``run.joint``, of one state.

Attitudes, rates and angles, which controllers read, are computed on floats: on arrays of one row
the same formulas take ten times as long.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from ...core.arguments import as_flag, choose
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ...core.inertia import inertia_matrix, quaternion_product
from ...core.manifest import Manifest
from ..compilation.body_columns import BodyAt, JointAt, PlacedAt, numbers
from .body_motion import FRAMES, BodyMotion, FrameName, PlacedMotion
from .joint_motion import JointMotion, shortest_rotation
from .trajectory import Trajectory

__all__ = ["PresentBody", "PresentJoint", "PresentPlaced", "body_at_present"]

Floats = Sequence[float]


class Present(Protocol):
    """The part of a simulation that bodies and joints read; q and p have the shape (n,)."""

    simulation: Any
    q: Array
    p: Array
    manifest: Manifest
    quantities: tuple[str, ...]

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters, as numbers."""

    def quantity(self, name: str) -> Any:
        """Return a quantity of the system."""

    def body(self, name: str) -> Any:
        """Return one of the bodies."""

    def next_step(self) -> Trajectory:
        """Return the next step as a trajectory, without advancing the simulation."""


class _SingleState:
    """A body or joint of one state, which refuses the methods that need a motion."""

    name: str
    _run: Any

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name} of {self._run.manifest.name}>"

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle by name, together with the simulation."""
        return operator.methodcaller(self._kind, self.name), (self._run.simulation,)

    @property
    def _kind(self) -> str:
        """The method of a simulation that returns this object."""
        return "joint" if isinstance(self, JointMotion) else "body"

    def plot(self, *arguments: Any, **options: Any) -> Any:
        """Refuse to draw one state."""
        raise InputError(f"A simulation has one state of {self.name!r}, which is no motion to "
                         "draw; start it by step.start(..., record=True) and call "
                         f"sim.trajectory.{self._kind}({self.name!r}).plot().")


@explain_arguments
class PresentPlaced(_SingleState, PlacedMotion):
    """A placed body of a simulation at its present state; made by ``Simulation.body``."""


@explain_arguments
class PresentBody(_SingleState, BodyMotion):
    """One body of a simulation at its present state; made by ``Simulation.body``.

    It has the attributes and methods of ``BodyMotion``, whose arrays have one row less a
    dimension: ``angular_velocity()`` has shape (3,). Each call reads the state that is reached
    then, so that one object serves a whole control loop.
    """

    def __init__(self, run: Present, name: str, columns: BodyAt) -> None:
        super().__init__(run, name, columns)  # type: ignore[arg-type]
        self._columns = np.array(columns.q)
        self._inverse = _CachedFunction(run, columns.inertia, lambda: _inverse(self._inertia))

    @property
    def attitude(self) -> Array:
        """Unit quaternion from body to space axes, scalar first, shape (4,), as computed."""
        quaternion: Array = self._run.q[self._columns]
        return quaternion

    def angular_velocity(self, frame: FrameName = "body") -> Array:
        """Return Ω = J⁻¹ ½ L(q) p, or R(q) Ω for ``frame="space"``, shape (3,), in rad/s.

        Raises
        ------
        InputError
            For another frame.
        """
        in_body = frame == "body" or choose("frame", frame, FRAMES) == "body"
        return np.array(self._rates() if in_body
                        else rotate_vector(self._quaternion(), self._rates()))

    def _quaternion(self) -> list[float]:
        """Return the attitude as floats."""
        quaternion: list[float] = self._run.q[self._columns].astype(float).tolist()
        return quaternion

    def _rates(self) -> list[float]:
        """Return Ω = J⁻¹ ½ L(q) p (19) in body axes as floats; Python's are faster than arrays."""
        q0, q1, q2, q3 = self._quaternion()
        p0, p1, p2, p3 = self._run.p[self._columns].astype(float).tolist()
        x = q0 * p1 - q1 * p0 + q3 * p2 - q2 * p3
        y = q0 * p2 - q2 * p0 + q1 * p3 - q3 * p1
        z = q0 * p3 - q3 * p0 + q2 * p1 - q1 * p2
        return [(a * x + b * y + c * z) / 2 for a, b, c in self._inverse()]

    def _in_space(self, vectors: Array) -> Array:
        """Return R(q) v of a vector in body axes, shape (3,)."""
        return np.array(rotate_vector(self._quaternion(), vectors.tolist()))


@explain_arguments
class PresentJoint(_SingleState, JointMotion):
    """One joint of a simulation at its present state; made by ``Simulation.joint``.

    It has the methods of ``JointMotion``, whose arrays have one row less a dimension: ``angle()``
    and ``rate()`` are numbers.
    """

    def __init__(self, run: Present, name: str, columns: JointAt) -> None:
        """Cache the joint's vectors that depend on parameters alone, until a parameter changes."""
        super().__init__(run, name, columns)  # type: ignore[arg-type]
        # entries of these vectors are numbers, or names of parameters
        names = [entry for entry in (*columns.axis_a, *columns.axis_b, *columns.zero)
                 if isinstance(entry, str)]
        self._vectors = _CachedFunction(run, names, self._constant_vectors)

    def angle(self, *, degrees: bool = False) -> Any:
        """Return by how much b is turned against a about their axis, in rad or degrees.

        Equal to ``JointMotion.angle`` in its first state: one state does not determine whole turns,
        which ``sim.trajectory.joint(name).angle()`` counts. If the model depends on the angle, it
        is unique up to two turns; otherwise it lies in (−π, π].

        Raises
        ------
        InputError
            For a joint without such an axis.
        """
        unit = math.degrees(1.0) if as_flag("degrees", degrees) else 1.0
        if self._is_measured("angle"):
            return self._run.quantity(f"{self.name}_angle") * unit
        axis, n1, n2, n1_in_b, zero = self._vectors()
        q_a, q_b = map(self._quaternion_of, self.bodies)
        if zero:  # (w, v e) = q̄_a q_b c, θ = 2 atan2(v, w) + turns
            conjugate_a = [q_a[0], *map(operator.neg, q_a[1:])]
            w, *v = quaternion_product(conjugate_a, quaternion_product(q_b, zero[:4]))
            return (zero[4] + 2 * math.atan2(dot(v, axis), w)) * unit
        # the angle of b's image of n₁ in the plane of n₁ and n₂, which a carries
        image = rotate_vector(q_b, n1_in_b)
        return math.atan2(dot(rotate_vector(q_a, n2), image),
                          dot(rotate_vector(q_a, n1), image)) * unit

    def rate(self) -> Any:
        """Return the angular velocity of b against a about their axis, in rad/s.

        Raises the same errors as ``angle``.
        """
        if self._is_measured("rate"):
            return self._run.quantity(f"{self.name}_rate")
        # (ω_b − ω_a)·e with the axis e in space; the ground, "", does not turn
        axis, rate = rotate_vector(self._quaternion_of(self.bodies[0]), self._vectors()[0]), 0.0
        for name, sign in zip(self.bodies, (-1, 1), strict=True):
            if name:
                body = self._run.body(name)
                rate += sign * dot(axis, rotate_vector(body._quaternion(), body._rates()))
        return rate

    def _reaction(self) -> tuple[Array, Array]:
        """Return force and torque at the start of the next step, shape (3,) each, in N and N m."""
        # multipliers belong to a step: the step from the present state, which is discarded
        force, torque = JointMotion(self._run.next_step(), self.name, self._layout)._reaction()
        return force[0], torque[0]

    def _quaternion_of(self, name: str) -> list[float]:
        """Return the attitude of a body; of the ground, "", (1, 0, 0, 0)."""
        ground = [1.0, 0.0, 0.0, 0.0]
        quaternion: list[float] = self._run.body(name)._quaternion() if name else ground
        return quaternion

    def _constant_vectors(self) -> tuple[list[float], ...]:
        """Return e = n₁ × n₂, n₁ and n₂ in a, the image of n₁ in b at angle 0, and ``zero``."""
        n1, n2, _, axis_in_b = self._axes()
        e = np.cross(n1, n2)
        return (e.tolist(), n1.tolist(), n2.tolist(),
                (shortest_rotation(e, axis_in_b, n1) @ n1).tolist(),
                numbers(self._layout.zero, self._run.parameters).tolist())


class _CachedFunction:
    """A function of some parameters, whose result is kept until one of them changes."""

    def __init__(self, run: Present, names: Sequence[str], function: Any) -> None:
        self._run, self._names, self._function = run, names, function
        self._arguments: list[Any] | None = None
        self._result: Any = None

    def __call__(self) -> Any:
        """Return the value of the function at the present parameters."""
        arguments = [*map(self._run.parameters.__getitem__, self._names)]
        if arguments != self._arguments:
            self._result, self._arguments = self._function(), arguments
        return self._result


def body_at_present(
    run: Present, name: str, columns: BodyAt | PlacedAt
) -> PresentBody | PresentPlaced:
    """Return a body of a simulation."""
    if isinstance(columns, PlacedAt):
        return PresentPlaced(run, name, columns)  # type: ignore[arg-type]
    return PresentBody(run, name, columns)


def _inverse(inertia: Any) -> list[list[float]]:
    """Return the rows of J⁻¹, (3, 3), in 1/(kg m²), of moments or a tensor."""
    inverse: list[list[float]] = np.linalg.inv(inertia_matrix(inertia)).tolist()
    return inverse


def rotate_vector(q: Floats, v: Floats) -> list[float]:
    """Return R(q) v = (q₀² − u·u) v + 2 (u·v) u + 2 q₀ u × v with q = (q₀, u)."""
    (q0, q1, q2, q3), (x, y, z) = q, v
    scale, along = q0 * q0 - q1 * q1 - q2 * q2 - q3 * q3, 2 * (q1 * x + q2 * y + q3 * z)
    return [scale * x + along * q1 + 2 * q0 * (q2 * z - q3 * y),
            scale * y + along * q2 + 2 * q0 * (q3 * x - q1 * z),
            scale * z + along * q3 + 2 * q0 * (q1 * y - q2 * x)]


def dot(v: Floats, w: Floats) -> float:
    """Return v·w."""
    return v[0] * w[0] + v[1] * w[1] + v[2] * w[2]
