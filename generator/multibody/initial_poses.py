"""Poses and velocities of bodies at the start, in numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...core.arguments import as_integer, shown, unknown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.inertia import (
    REPS,
    Inertia,
    inertia_matrix,
    quaternion_of_matrix,
    quaternion_product,
    real_array,
    unit_quaternions,
)
from .rigid_body import left_matrix, rotation_matrix

__all__ = ["Attitude", "InitialState", "Pose", "RigidMotion", "attitude", "check_rep",
           "clean", "conjugate",
           "count", "direction", "finite", "in_range", "initial_state", "nonzero", "normals",
           "onto", "optional_vector", "positive", "propagate_all", "rotation", "unit",
           "vector"]

#: Components smaller than this relative to the vector, or to its parts, are round-off: zero.
_ROUNDING = 2.0**-49


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """r ↦ R(q) r + x of points in space."""

    q: Array
    x: Array

    @classmethod
    def along(cls, x: Array) -> RigidMotion:
        """Return the translation by x."""
        return cls(np.array([1.0, 0, 0, 0]), x)

    @classmethod
    def about(cls, axis: Array, angle: float, point: Array) -> RigidMotion:
        """Return the rotation by an angle about an axis, of length 1, through a point.

        q has half the angle: one whole turn changes its sign.
        """
        if not angle:
            return cls.along(np.zeros(3))
        q = np.array([math.cos(angle / 2), *(math.sin(angle / 2) * axis)])
        return cls(q, point - rotation(q) @ point)

    def __matmul__(self, first: RigidMotion) -> RigidMotion:
        """Return the motion that does ``first``, then this."""
        return RigidMotion(np.array(quaternion_product(self.q, first.q)), self.point(first.x))

    def inverse(self) -> RigidMotion:
        """Return the inverse motion r ↦ R(q)ᵀ (r − x)."""
        turn = RigidMotion(np.array(conjugate(self.q)), np.zeros(3))
        return RigidMotion(turn.q, -turn.direction(self.x))

    def point(self, r: Array) -> Array:
        """Return the image R(q) r + x of a point."""
        return self.direction(r) + self.x

    def direction(self, v: Array) -> Array:
        """Return R(q) v, the image of a vector."""
        # a translation keeps the bits of v
        image: Array = v if not self.q[1:].any() else rotation(self.q) @ v
        return image


@dataclass(eq=False)
class Pose:
    """Attitude and motion of a frame; None where it is not known yet.

    Attributes
    ----------
    q : ndarray, shape (4,)
        Unit quaternion.
    R : ndarray, shape (3, 3)
        From body to space axes.
    x, v : ndarray, shape (3,), or None
        Position and velocity of the origin in space.
    spin : ndarray, shape (3,), or None
        Angular velocity in space.
    motion : RigidMotion
        From the pose in which the model is described to this one.
    """

    q: Array
    R: Array
    x: Array | None
    v: Array | None
    spin: Array | None
    motion: RigidMotion = field(default_factory=lambda: RigidMotion.along(np.zeros(3)))

    @classmethod
    def ground(cls) -> Pose:
        """Return the pose of space."""
        zero = np.zeros(3)
        return cls(np.array([1.0, 0, 0, 0]), np.eye(3), zero, zero, zero)

    def space(self, r: Array) -> Array:
        """Return x + R r, the position in space of a point of the frame."""
        assert self.x is not None
        position: Array = self.x + self.R @ r
        return position

    def after(self, motion: RigidMotion, is_held: bool = False) -> Pose:
        """Return the pose after a motion; ``is_held`` keeps the origin and takes only the rotation.

        The angular velocity turns with the body, the velocity keeps its direction in space.
        """
        assert self.x is not None
        # x = R x + d for the translation d = x − R x
        if is_held:
            motion = RigidMotion(motion.q, self.x - motion.direction(self.x))
        q = np.array(quaternion_product(motion.q, self.q))
        spin = None if self.spin is None else motion.direction(self.spin)
        return Pose(q, rotation(q), motion.point(self.x), self.v, spin, motion)

    def momenta(self, inertia: Inertia) -> Array:
        """Return p = 2 L(q)ᵀ J Ω (82)."""
        assert self.spin is not None
        L = numbers(left_matrix(self.q.tolist()))
        p: Array = 2 * L.T @ (inertia_matrix(inertia) @ (self.R.T @ self.spin))
        return p


@dataclass
class InitialState:
    """Initial state of a body as its user gave it; None where it follows from joints.

    ``is_turned``: the attitude is given. ``is_placed``: a robot's file gives it, by joints.
    """

    q: Array
    x: Array | None
    v: Array | None
    omega: Array | None  # in body axes
    is_turned: bool = False
    is_placed: bool = False

    def pose(self) -> Pose:
        """Return the pose, with None for positions and velocities that are not given."""
        R = rotation(self.q)
        return Pose(self.q, R, self.x, self.v, None if self.omega is None else R @ self.omega)


def initial_state(
    name: str, quaternion: Any, rotation: Any, position: Any, velocity: Any, omega: Any
) -> InitialState:
    """Return the initial state of a body from its checked arguments; None for those not given."""
    return InitialState(
        attitude(f"body {name!r}", quaternion, rotation),
        optional_vector(f"position of {name!r}", position),
        optional_vector(f"velocity of {name!r}", velocity),
        optional_vector(f"angular velocity of {name!r}", omega),
        is_turned=quaternion is not None or rotation is not None,
    )


def numbers(matrix: Any) -> Array:
    """Return a SymPy matrix of numbers as an array."""
    return np.array(matrix.tolist(), dtype=float)


def onto(axis: Array) -> Array:
    """Return the quaternion of the smallest rotation that turns the third axis into a direction.

    It is the rotation by the angle θ between the axes about (−y, x, 0)/sin θ, with the unit vector
    (x, y, z) along ``axis``.
    """
    size = float(np.linalg.norm(axis))
    x, y, z = axis / (size or 1.0)
    sine = math.hypot(x, y)
    # along the third axis no rotation, and against it half a turn about the first
    if not sine:
        return np.array([1.0, 0, 0, 0] if z >= 0 else [0.0, 1, 0, 0])
    half = math.atan2(sine, z) / 2
    y, x = y / sine, x / sine
    return np.array([math.cos(half), -y * math.sin(half), x * math.sin(half), 0.0])


def rotation(q: Array) -> Array:
    """Return R(q), 3 × 3."""
    return numbers(rotation_matrix(q.tolist()))


@dataclass(frozen=True)
class Attitude:
    """A checked unit quaternion, scalar first; accepted wherever a rotation is."""

    q: Sequence[float]

    def as_quat(self) -> Array:
        """Return (x, y, z, w), scalar last, as ``scipy.spatial.transform.Rotation`` does."""
        return np.array([*self.q[1:], self.q[0]])


def attitude(label: str, quaternion: Any, matrix: Any) -> Array:
    """Return the attitude of a body as a unit quaternion, shape (4,), scalar first.

    ``quaternion`` may have any length but 0; without both arguments the attitude is the identity.
    ``matrix`` is 3 × 3 from body to space axes, or a SciPy Rotation.

    Raises
    ------
    InputError
        For both, for the zero quaternion and for a matrix that is no rotation.
    """
    if quaternion is not None and matrix is not None:
        raise InputError(f"{label} has a quaternion and a rotation; give one of them.")
    if hasattr(matrix, "as_quat"):  # a SciPy Rotation, whose quaternions are (x, y, z, w)
        scalar_last = real_array(matrix.as_quat())
        if scalar_last is None or scalar_last.shape != (4,):
            raise InputError(f"The rotation of {label} is {shown(matrix)}; give a single one.")
        return unit(scalar_last[[3, 0, 1, 2]])
    if matrix is not None:
        return quaternion_of_matrix(matrix, f"rotation of {label}")
    if quaternion is None:
        return np.array([1.0, 0.0, 0.0, 0.0])
    q = unit_quaternions(quaternion, f"quaternion of {label}")
    if q.shape != (4,):
        raise InputError(f"The quaternion of {label} is {shown(quaternion)}; give 4 numbers.")
    return q


def unit(v: Array) -> Array:
    """Return a vector's direction; its length may be any but zero."""
    v = v / np.abs(v).max()  # so that no square leaves the range of doubles
    unit_vector: Array = v / np.linalg.norm(v)
    return unit_vector


@contextmanager
def in_range(label: str) -> Iterator[None]:
    """Refuse values outside the range of doubles."""
    try:
        with np.errstate(over="raise", invalid="raise"):
            yield
    except FloatingPointError:
        raise InputError(f"The start of {label} leads out of the range of doubles: positions, "
                         "velocities or rates are too large; take other units.") from None


def vector(label: str, value: Any) -> Array:
    """Return three finite numbers, shape (3,); ``label`` names the argument in InputError."""
    return finite(label, value, (3,))


def finite(label: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Return finite numbers of a shape, () for one number, as floats.

    ``label`` names the argument in InputError.
    """
    array = real_array(value)
    if array is None or array.shape != shape or not np.isfinite(array).all():
        size = math.prod(shape)
        raise InputError(f"The {label} is {shown(value)}; give {size} finite "
                         f"number{'s' if size > 1 else ''}.")
    return array


def positive(label: str, value: Any) -> float:
    """Return a finite number above 0."""
    number = float(finite(label, value, shape=()))
    if number <= 0:
        raise InputError(f"The {label} is {number}; it must be above 0.")
    return number


def non_negative(label: str, value: Any) -> float:
    """Return a finite number, 0 or more."""
    number = float(finite(label, value, shape=()))
    if number < 0:
        raise InputError(f"The {label} is {number:g}; give 0 or more.")
    return number


def optional_vector(label: str, value: Any) -> Array | None:
    """Return three numbers, or None where none are given."""
    return None if value is None else vector(label, value)


def propagate_all(
    poses: Mapping[Any, Pose], attribute: str,
    steps: Sequence[Callable[[Mapping[Any, Pose]], bool]],
    fallbacks: Sequence[Callable[[Mapping[Any, Pose]], bool]] = (),
) -> None:
    """Propagate a quantity of poses from body to body until none is None.

    A step sets the values that follow from known poses, and returns whether it has set one. If no
    step does, one of the ``fallbacks`` sets a value, and if none does, an unknown one becomes 0.
    """
    while True:
        # a sum runs all steps, any() only those up to the first fallback that sets something
        while sum(step(poses) for step in steps) or any(step(poses) for step in fallbacks):
            pass
        incomplete = next((p for p in poses.values() if getattr(p, attribute) is None), None)
        if incomplete is None:
            return
        setattr(incomplete, attribute, np.zeros(3))


def check_rep(name: str, rep: Any) -> None:
    """Refuse an unknown representation of the inertia."""
    if not isinstance(rep, str) or rep not in REPS:
        raise unknown(f"representation of body {name!r}:", rep, REPS)


def count(value: Any) -> int:
    """Return a number of steps as int, or refuse a value that is no whole number ≥ 0."""
    number = as_integer(value)
    if number is None or number < 0:
        raise InputError(f"steps = {shown(value)} is no whole number from 0 on.")
    return number


def nonzero(label: str, value: Any) -> float:
    """Return a finite number other than 0, such as γ or α."""
    number = float(finite(label, value, shape=()))
    if number == 0:
        raise InputError(f"The {label} is 0, and the kinetic energy divides by it; give another "
                         "number.")
    return number


def conjugate(q: Any) -> list[Any]:
    """Return the conjugate of a unit quaternion, its inverse rotation, scalar first."""
    return [q[0], *(-x for x in q[1:])]


def normals(axis: Array) -> tuple[Array, Array]:
    """Return two unit vectors that are perpendicular to a unit vector and to each other."""
    k = int(np.argmax(np.abs(axis)))
    # e_{k−1} × axis, so that the normals of a coordinate axis are the two others
    n1 = np.cross(np.roll(np.eye(3)[k], -1), axis)
    n1 = direction(n1 / np.linalg.norm(n1))
    return n1, direction(np.cross(axis, n1))


def clean(v: Array, *sizes: Array) -> Array:
    """Return a vector with 0 for components that are round-off relative to it or ``sizes``."""
    size = max(float(np.abs(x).max()) for x in (v, *sizes))
    return np.where(np.abs(v) <= _ROUNDING * size, 0.0, v)


def direction(v: Array) -> Array:
    """Return a unit vector or quaternion with round-off removed: along an axis its entry is ±1."""
    v = clean(v)
    return np.sign(v) if np.count_nonzero(v) == 1 else v
