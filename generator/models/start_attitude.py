"""The start of a body in numbers: attitude from Euler angles, momenta from its rotation.

Computed to 50 digits from what was typed, and rounded once by whoever takes them.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from mpmath import mp

from ...core.exact_numbers import Rounded, exact
from ...core.inertia import Inertia, inertia_rows
from ..multibody.initial_poses import product
from ..multibody.rigid_body import left_matrix

__all__ = ["from_euler", "momentum", "unit"]

_DIGITS = 50


def from_euler(phi: float, theta: float, psi: float) -> list[float]:
    """Return the quaternion of R_z(φ) R_x(θ) R_z(ψ) (81), angles in rad."""
    with mp.workdps(_DIGITS):
        (a, b), (c, d), (e, f) = ((mp.cos(x), mp.sin(x)) for x in
                                  (_mpf(angle) / 2 for angle in (phi, theta, psi)))
        return _rounded(product(product([a, 0, 0, b], [c, d, 0, 0]), [e, 0, 0, f]))


def unit(quaternion: Sequence[float]) -> list[float]:
    """Return q/|q|, of a quaternion that is not 0."""
    with mp.workdps(_DIGITS):
        q = [_mpf(x) for x in quaternion]
        size = mp.sqrt(sum(x * x for x in q))
        return _rounded([x / size for x in q])


def _mpf(value: float) -> Any:
    """Return a number with the digits it was typed with."""
    number = exact(value)
    assert isinstance(number, Fraction)
    return mp.mpf(number.numerator) / number.denominator


def _rounded(values: Sequence[Any]) -> list[float]:
    """Return doubles that know all digits of mpmath's numbers."""
    return [Rounded(x) for x in map(exact, values) if isinstance(x, Fraction)]


def momentum(q: Sequence[float], omega: Sequence[float], inertia: Inertia) -> list[float]:
    """Return p = 2 L(q)ᵀ J Ω (82), with Ω in body axes; qᵀp = 0 by (9)."""
    with mp.workdps(_DIGITS):
        l = [sum(_mpf(I) * _mpf(x) for I, x in zip(row, omega, strict=True))  # noqa: E741
             for row in inertia_rows(inertia)]
        columns = left_matrix([_mpf(x) for x in q]).T.tolist()
        return _rounded([2 * sum(mp.mpf(a) * b for a, b in zip(column, l, strict=True))
                         for column in columns])
