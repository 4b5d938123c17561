"""Symbols in which formulas of one rigid body are written, as ``gyrospark.symbols``.

    q        q0..q3, the unit quaternion, scalar first
    p        p0..p3, its momenta, in kg m²/s
    R        R(q), 3 × 3: maps body to space axes; R[2, :] is the space axis z in body axes
    inertia  I1, I2, I3, principal moments about the fixed point, in kg m²
    omega    Ω = J⁻¹ ½ L(q) p, angular velocity in body axes, in rad/s
    t        time in s, of torques and quantities

R and omega are expressions in q, p and inertia; ``rotation_matrix(x)`` is R of another quaternion
x, such as a body's in a system of several. Your own parameters are symbols of your own.
"""

from __future__ import annotations

from .rigid_body import angular_velocity, p, q, rotation_matrix
from .rigid_body import moments as inertia
from .rigid_body import time as t

__all__ = ["R", "inertia", "omega", "p", "q", "rotation_matrix", "t"]


def __dir__() -> list[str]:
    return __all__


R = rotation_matrix(q).as_immutable()
omega = tuple(angular_velocity())
