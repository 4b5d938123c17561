"""Where bodies are and how they move at the start, in numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .attitude import from_matrix, momentum, normalised
from .rigid_body import rotation_matrix

__all__ = ["Pose", "attitude", "finite", "rotation", "settle", "three"]

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
        omega = self.R.T @ self.spin
        return np.array(momentum(self.q.tolist(), omega.tolist(), inertia))


def rotation(q: Array) -> Array:
    """Return R(q), 3 × 3."""
    return np.array(rotation_matrix(q.tolist()).tolist(), dtype=float)


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
    unit = normalised(finite(f"quaternion of {what}", quaternion, (4,)).tolist())
    if unit is None:
        raise InputError(f"The quaternion of {what} is zero; take (1, 0, 0, 0) for no turn.")
    return np.array(unit)


def _from_matrix(what: str, matrix: Any) -> Array:
    R = finite(f"rotation of {what}", matrix, (3, 3))
    q = from_matrix(R.tolist())
    if q is None:
        raise InputError(
            f"The rotation of {what} is no rotation matrix: |R Rᵀ − 1| = "
            f"{np.abs(R @ R.T - np.eye(3)).max():.1e}, det R = {np.linalg.det(R):.3g}; give "
            "orthogonal columns, right-handed."
        )
    return np.array(q if q[0] >= 0 else [-x for x in q])


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
