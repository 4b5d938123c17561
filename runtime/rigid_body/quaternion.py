"""Unit quaternions and the state (q, p) in NumPy: scalar first, vectorised over leading axes.

A quaternion q and −q are the same attitude. Angular velocities are in body axes, in rad/s;
moments of inertia in kg m², momenta p in kg m²/s.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import shown
from ...core.arrays import Floats
from ...core.errors import InputError
from ...core.inertia import (
    InertiaLike,
    as_moments_or_tensor,
    inertia_matrix,
    is_tensor,
    quaternion_of_matrix,
    real_array,
    unit_quaternions,
)

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

__all__ = [
    "Floats",
    "angular_velocity",
    "attitude_quaternion",
    "axis",
    "euler_quaternion",
    "left_matrix",
    "momentum",
    "rotation_matrix",
    "state_of_body",
    "to_rotation",
]


def left_matrix(q: ArrayLike) -> Floats:
    """Return L(q) of (8), shape (..., 3, 4): L(q)q = 0, and Ω = 2 L(q) q̇ in body axes.

    Raises InputError unless the last axis of q, shape (..., 4), has length 4.
    """
    q0, q1, q2, q3 = np.moveaxis(_vectors(q, 4, "quaternion"), -1, 0)
    return _matrix([[-q1, q0, q3, -q2], [-q2, -q3, q0, q1], [-q3, q2, -q1, q0]])


def rotation_matrix(q: ArrayLike) -> Floats:
    """Return R(q) of (3), shape (..., 3, 3); maps body to space axes (erratum 1).

    Orthogonal for |q| = 1; in general R Rᵀ = |q|⁴ I₃.

    Raises
    ------
    InputError
        Unless the last axis of q, shape (..., 4), has length 4.
    """
    q0, q1, q2, q3 = np.moveaxis(_vectors(q, 4, "quaternion"), -1, 0)
    return _matrix(
        [
            [q0**2 + q1**2 - q2**2 - q3**2, 2 * (q1 * q2 - q0 * q3), 2 * (q1 * q3 + q0 * q2)],
            [2 * (q1 * q2 + q0 * q3), q0**2 - q1**2 + q2**2 - q3**2, 2 * (q2 * q3 - q0 * q1)],
            [2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), q0**2 - q1**2 - q2**2 + q3**2],
        ]
    )


def axis(q: ArrayLike) -> Floats:
    """Return (R13, R23, R33), the body's third axis in space, shape (..., 3).

    The centre of mass of the paper's top is l times this axis. R maps body to space axes, which the
    paper does not say (erratum 1).

    Raises
    ------
    InputError
        Unless the last axis of q, shape (..., 4), has length 4.
    """
    third_column: Floats = rotation_matrix(q)[..., 2]
    return third_column


def angular_velocity(q: ArrayLike, p: ArrayLike, inertia: InertiaLike) -> Floats:
    """Return Ω = J⁻¹ l with l = ½ L(q) p (19), in body axes, shape (..., 3), in rad/s.

    Raises
    ------
    InputError
        Unless q and p have shape (..., 4) and the inertia is three finite moments above 0 or a
        tensor with such.
    """
    moments = as_moments_or_tensor(inertia)
    twice_l = np.einsum("...ij,...j->...i", left_matrix(q), _vectors(p, 4, "momentum p"))
    if is_tensor(moments):
        omega_of_tensor: Floats = np.linalg.solve(inertia_matrix(moments),
                                                  twice_l[..., None] / 2)[..., 0]
        return omega_of_tensor
    omega: Floats = twice_l / (2 * np.array(moments))
    return omega


def momentum(q: ArrayLike, omega: ArrayLike, inertia: InertiaLike) -> Floats:
    """Return p = 2 L(q)ᵀ J Ω (82), shape (..., 4), in kg m²/s; qᵀp = 0 holds by (9).

    Raises
    ------
    InputError
        Unless q has shape (..., 4), Ω has shape (..., 3) and the inertia is three finite moments
        above 0 or a tensor with such.
    """
    moments, vectors = as_moments_or_tensor(inertia), _vectors(omega, 3, "angular velocity")
    with np.errstate(over="ignore", invalid="ignore"):  # states that are not finite are refused
        l = vectors @ inertia_matrix(moments) if is_tensor(moments) else (  # noqa: E741
            np.array(moments) * vectors)
        p: Floats = 2 * np.einsum("...ij,...i->...j", left_matrix(q), l)
    return p


def euler_quaternion(phi: ArrayLike, theta: ArrayLike, psi: ArrayLike) -> Floats:
    """Return q of (81), corrected (erratum 9), shape (..., 4), from angles in rad.

    R(q) = R_z(φ) R_x(θ) R_z(ψ): precession φ, nutation θ, spin ψ.
    """
    phi, theta, psi = (np.asarray(angle, dtype=np.float64) for angle in (phi, theta, psi))
    half_sum, half_difference, half_theta = (phi + psi) / 2, (phi - psi) / 2, theta / 2
    components = [
        np.cos(half_sum) * np.cos(half_theta),
        np.cos(half_difference) * np.sin(half_theta),
        np.sin(half_difference) * np.sin(half_theta),
        np.sin(half_sum) * np.cos(half_theta),
    ]
    return np.stack(components, axis=-1)


def to_rotation(q: ArrayLike) -> Rotation:
    """Return the SciPy Rotation that maps body to space axes, one or a stack as q is.

    SciPy stores the scalar last and normalises. Raises InputError unless q has shape (4,) or (N,
    4), is finite and not zero.
    """
    from scipy.spatial.transform import Rotation  # takes 0.1 s

    q0, q1, q2, q3 = np.moveaxis(_vectors(q, 4, "quaternion"), -1, 0)
    norm = np.sqrt(q0**2 + q1**2 + q2**2 + q3**2)
    if not (np.isfinite(norm) & (norm > 0)).all():
        raise InputError(f"The quaternion {q!r} is no attitude; it must be finite and not zero.")
    return Rotation.from_quat(np.stack([q1, q2, q3, q0], axis=-1))


def attitude_quaternion(attitude: Rotation | ArrayLike) -> Floats:
    """Return q, scalar first, shape (4,) or (N, 4), of attitudes.

    q and −q are the same attitude. A quaternion keeps its sign, a Rotation of SciPy has the sign
    that SciPy stores, and for a matrix the scalar is not negative. Raises InputError if
    ``attitude`` is neither a quaternion, shape (4,) or (N, 4), nor a rotation from body to space
    axes: SciPy's, or a matrix of shape (3, 3) or (N, 3, 3).
    """
    if hasattr(attitude, "as_quat"):  # SciPy is not needed to know its Rotation
        scalar_last: Floats = np.asarray(attitude.as_quat(), dtype=np.float64)
        return scalar_last[..., [3, 0, 1, 2]]
    array = real_array(attitude)
    if array is not None and array.shape[-1:] == (4,) and array.ndim <= 2:
        return unit_quaternions(attitude, "attitude")
    if array is None or array.shape[-2:] != (3, 3) or array.ndim not in (2, 3):
        raise InputError(f"The attitude {shown(attitude)} is neither a quaternion of 4 numbers, "
                         "scalar first, nor a scipy.spatial.transform.Rotation nor a 3 × 3 matrix "
                         "of a rotation; make one with Rotation.from_euler or from_quat.")
    if array.ndim == 2:
        return quaternion_of_matrix(array)
    return np.array([quaternion_of_matrix(R) for R in array]).reshape(-1, 4)


def state_of_body(
    attitude: Rotation | ArrayLike, omega: ArrayLike, inertia: InertiaLike
) -> tuple[Floats, Floats]:
    """Return the state (q, p) of a body, each (4,) or (N, 4); arguments of ``Start.of_body``."""
    q = attitude_quaternion(attitude)
    p = momentum(q, omega, inertia)
    return np.broadcast_to(q, p.shape).copy(), p


def _vectors(components: ArrayLike, length: int, name: str) -> Floats:
    """Return an array of doubles whose last axis has this length.

    Raises InputError, with ``name``, for another shape, and for entries that are no real numbers.
    """
    vectors = real_array(components)
    if vectors is None:
        raise InputError(f"The {name} {shown(components)} is no array of real numbers.")
    if vectors.ndim == 0 or vectors.shape[-1] != length:
        raise InputError(f"The {name} has shape {vectors.shape}; its last axis must have length "
                         f"{length}.")
    return vectors


def _matrix(row_lists: list[list[Floats]]) -> Floats:
    """Return matrices, (..., rows, columns), from their entries, arrays of the shape (...)."""
    return np.stack([np.stack(row, axis=-1) for row in row_lists], axis=-2)
