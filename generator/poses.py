"""Where bodies are and how they move at the start, in numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .rigid_body import left_matrix, rotation_matrix

__all__ = ["Pose", "attitude", "finite", "in_range", "rotation", "settle", "three", "unit"]

Array = NDArray[Any]


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
    """

    q: Array
    R: Array
    x: Array | None
    v: Array | None
    spin: Array | None

    @classmethod
    def ground(cls) -> Pose:
        """Return the pose of space."""
        zero = np.zeros(3)
        return cls(np.array([1.0, 0, 0, 0]), np.eye(3), zero, zero, zero)

    def space(self, r: Array) -> Array:
        """Return where in space a point of the frame is."""
        assert self.x is not None
        where: Array = self.x + self.R @ r
        return where

    def momenta(self, inertia: Sequence[float]) -> Array:
        """Return p = 2 L(q)ᵀ J Ω (82)."""
        assert self.spin is not None
        L = numbers(left_matrix(self.q.tolist()))
        p: Array = 2 * L.T @ (np.array(inertia) * (self.R.T @ self.spin))
        return p


def numbers(matrix: Any) -> Array:
    """Return a SymPy matrix of numbers as an array."""
    return np.array(matrix.tolist(), dtype=float)


def rotation(q: Array) -> Array:
    """Return R(q), 3 × 3."""
    return numbers(rotation_matrix(q.tolist()))


def attitude(what: str, quaternion: Any, matrix: Any) -> Array:
    """Return the unit quaternion of a quaternion of any length, or of a rotation.

    ``matrix`` is 3 × 3 from body to space axes, or a SciPy Rotation.

    Raises
    ------
    InputError
        For both, for the zero quaternion and for a matrix that is no rotation.
    """
    if quaternion is not None and matrix is not None:
        raise InputError(f"{what} has a quaternion and a rotation; give one of them.")
    if matrix is not None:
        return _from_matrix(what, matrix.as_matrix() if hasattr(matrix, "as_matrix") else matrix)
    if quaternion is None:
        return np.array([1.0, 0.0, 0.0, 0.0])
    q = finite(f"quaternion of {what}", quaternion, (4,))
    if not q.any():
        raise InputError(f"The quaternion of {what} is zero; take (1, 0, 0, 0) for no turn.")
    return unit(q)


def _from_matrix(what: str, matrix: Any) -> Array:
    R = finite(f"rotation of {what}", matrix, (3, 3))
    with np.errstate(over="ignore", invalid="ignore"):  # no rotation, then
        error, determinant = np.abs(R @ R.T - np.eye(3)).max(), np.linalg.det(R)
    if not error <= 1e-6 or determinant < 0:
        raise InputError(
            f"The rotation of {what} is no rotation matrix: |R Rᵀ − 1| = {error:.1e}, "
            f"det R = {determinant:.3g}; give orthogonal columns, right-handed."
        )
    # 4 q qᵀ, every entry from R; the row with the largest diagonal loses no digits.
    t = np.trace(R)
    K = np.empty((4, 4))
    K[0, 0] = 1 + t
    K[0, 1:] = K[1:, 0] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    K[1:, 1:] = R + R.T + (1 - t) * np.eye(3)
    q: Array = K[int(np.argmax(np.diag(K)))]
    q = q / np.linalg.norm(q)
    return q if q[0] >= 0 else -q


def unit(v: Array) -> Array:
    """Return a vector's direction; its length may be any but zero."""
    v = v / np.abs(v).max()  # so that no square leaves the range of doubles
    direction: Array = v / np.linalg.norm(v)
    return direction


@contextmanager
def in_range(what: str) -> Iterator[None]:
    """Refuse what leads out of the range of doubles.

    Raises
    ------
    InputError
    """
    try:
        with np.errstate(over="raise", invalid="raise"):
            yield
    except FloatingPointError:
        raise InputError(f"The start of {what} leads out of the range of doubles: positions, "
                         "velocities or rates are too large; take other units.") from None


def three(what: str, value: Any) -> Array:
    """Return three finite numbers."""
    return finite(what, value, (3,))


def finite(what: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Return finite numbers of a shape as floats."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"The {what} is {value!r}; give {np.prod(shape)} numbers.") from error
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(f"The {what} is {value!r}; give {np.prod(shape)} finite numbers.")
    return array


def settle(
    poses: Mapping[Any, Pose], attribute: str, steps: Sequence[Callable[[Mapping[Any, Pose]], bool]]
) -> None:
    """Let joints hand on what is known, from body to body; what nothing tells is zero."""
    while True:
        while sum(step(poses) for step in steps):
            pass
        unknown = next((p for p in poses.values() if getattr(p, attribute) is None), None)
        if unknown is None:
            return
        setattr(unknown, attribute, np.zeros(3))
