"""The start of a body in numbers: attitude as a unit quaternion, momenta from its rotation.

Computed to 30 digits and rounded once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mpmath import mp

from .rigid_body import left_matrix, rotation_matrix

__all__ = ["from_euler", "from_matrix", "momentum", "normalised"]

_DIGITS = 30
#: How far from orthogonal a rotation matrix may be that was typed with few digits.
_TYPED = 1e-4


def normalised(quaternion: Sequence[float]) -> list[float] | None:
    """Return the unit quaternion of this direction, None for zero."""
    with mp.workdps(_DIGITS):
        parts = [mp.mpf(x) for x in quaternion]
        size = mp.sqrt(sum(x * x for x in parts))
        return [float(x / size) for x in parts] if size else None


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


def from_matrix(rotation: Sequence[Sequence[float]]) -> list[float] | None:
    """Return the quaternion of a rotation matrix (body to space), None if it is none.

    4 q qᵀ = K(R) is linear in R; its column of largest diagonal entry points along q. The outcome
    is put back into R(q) and compared: whatever is no rotation is found.
    """
    with mp.workdps(_DIGITS):
        R = [[mp.mpf(x) for x in row] for row in rotation]
        trace = R[0][0] + R[1][1] + R[2][2]
        skew = [R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]]
        K = [[1 + trace, *skew]]
        for i in range(3):
            K.append([skew[i], *(R[i][j] + R[j][i] for j in range(3))])
            K[-1][i + 1] = 1 + 2 * R[i][i] - trace
        columns = max(range(4), key=lambda i: K[i][i])
        found = normalised(K[columns])
    if found is None:
        return None
    again = rotation_matrix(found).tolist()
    worst = max(abs(float(x) - y) for row, given in zip(again, rotation, strict=True)
                for x, y in zip(row, given, strict=True))
    return found if worst < _TYPED else None


def momentum(q: Sequence[float], omega: Sequence[float], inertia: Sequence[float]) -> list[float]:
    """Return p = 2 L(q)ᵀ J Ω (82), with Ω in body axes; qᵀp = 0 by (9)."""
    with mp.workdps(_DIGITS):
        l = [mp.mpf(I) * mp.mpf(x) for I, x in zip(inertia, omega, strict=True)]  # noqa: E741
        columns = left_matrix([mp.mpf(x) for x in q]).T.tolist()
        return [float(2 * sum(mp.mpf(a) * b for a, b in zip(column, l, strict=True)))
                for column in columns]
