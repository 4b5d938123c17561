"""The start of a body in numbers: attitude from Euler angles, momenta from its rotation.

Computed to 30 digits and rounded once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mpmath import mp

from ..body_values import Inertia, inertia_matrix
from .rigid_body import left_matrix

__all__ = ["from_euler", "momentum"]

_DIGITS = 30


def from_euler(phi: float, theta: float, psi: float) -> list[float]:
    """Return the quaternion of R_z(φ) R_x(θ) R_z(ψ) (81), angles in rad."""
    with mp.workdps(_DIGITS):
        (a, b), (c, d), (e, f) = ((mp.cos(x), mp.sin(x)) for x in
                                  (mp.mpf(angle) / 2 for angle in (phi, theta, psi)))
        product = _times(_times([a, 0, 0, b], [c, d, 0, 0]), [e, 0, 0, f])
        return [float(x) for x in product]


def _times(x: Sequence[Any], y: Sequence[Any]) -> list[Any]:
    """Return the product of two quaternions, scalar first: R(xy) = R(x) R(y)."""
    (a, *u), (b, *v) = x, y
    cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    return [a * b - sum(i * j for i, j in zip(u, v, strict=True)),
            *(a * j + b * i + k for i, j, k in zip(u, v, cross, strict=True))]


def momentum(q: Sequence[float], omega: Sequence[float], inertia: Inertia) -> list[float]:
    """Return p = 2 L(q)ᵀ J Ω (82), with Ω in body axes; qᵀp = 0 by (9)."""
    with mp.workdps(_DIGITS):
        l = [sum(mp.mpf(I) * mp.mpf(x) for I, x in zip(row, omega, strict=True))  # noqa: E741
             for row in inertia_matrix(inertia).tolist()]
        columns = left_matrix([mp.mpf(x) for x in q]).T.tolist()
        return [float(2 * sum(mp.mpf(a) * b for a, b in zip(column, l, strict=True)))
                for column in columns]
