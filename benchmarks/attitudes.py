"""Rotations by unit quaternions, scalar first, from body to space axes.

    R(q) v    a vector in body axes, seen in space
    L(q)      the 3 × 4 matrix with Ω = 2 L(q) q' in body axes; l = L(q) p / 2
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Array", "angular_velocity", "left_matrix", "quaternion_of", "rotation_matrix"]

Array = NDArray[Any]


def rotation_matrix(q: ArrayLike) -> Array:
    """Return R(q) of unit quaternions, shape (..., 3, 3)."""
    w, x, y, z = np.moveaxis(np.asarray(q), -1, 0)
    return np.moveaxis(np.array([
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z]]),
        (0, 1), (-2, -1))


def left_matrix(q: ArrayLike) -> Array:
    """Return L(q), shape (..., 3, 4)."""
    w, x, y, z = np.moveaxis(np.asarray(q), -1, 0)
    return np.moveaxis(np.array([[-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]]),
                       (0, 1), (-2, -1))


def angular_velocity(q: ArrayLike, p: ArrayLike, inertia: ArrayLike) -> Array:
    """Return Ω = J⁻¹ L(q) p / 2 for principal moments or a tensor J."""
    momentum = (left_matrix(q) @ np.asarray(p)[..., None])[..., 0] / 2
    J = np.asarray(inertia)
    omega: Array = momentum / J if J.ndim == 1 else np.linalg.solve(J, momentum.T).T
    return omega


def quaternion_of(R: ArrayLike) -> Array:
    """Return the unit quaternion of a rotation matrix: the eigenvector of the largest eigenvalue.

    Source: I. Y. Bar-Itzhack, J. Guid. Control Dyn. 23 (2000) 1085.
    """
    R = np.asarray(R, dtype=float)
    K = np.empty((4, 4))
    K[0, 0] = np.trace(R)
    K[0, 1:] = K[1:, 0] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    K[1:, 1:] = R + R.T - np.trace(R) * np.eye(3)
    q: Array = np.linalg.eigh(K)[1][:, -1]
    return q * (1 if q[0] >= 0 else -1)
