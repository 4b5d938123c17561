"""Equations of motion without multipliers: rates(t, state), and the state at t = 0.

For mpmath's Taylor series and midpoint rule, SciPy and heyoka: rates take numbers of any kind,
except the governor's, which take mpmath's alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mpmath as mp

__all__ = ["Motion", "ellipsoid", "flyball_governor", "goryachev_chaplygin", "kovalevskaya",
           "neumann"]

Motion = tuple[Callable[[Any, Sequence[Any]], list[Any]], list[Any]]


def neumann() -> Motion:
    """Return q'' = (q·Aq − |q'|²) q − A q, A = diag(1, 2, 4), and its start."""
    def rates(_: Any, state: Sequence[Any]) -> list[Any]:
        q, v = state[:3], state[3:]
        multiplier = sum(a * x**2 for a, x in zip((1, 2, 4), q, strict=True)) - sum(x**2 for x in v)
        return [*v, *((multiplier - a) * x for a, x in zip((1, 2, 4), q, strict=True))]

    return rates, [mp.mpf(x) for x in ("0.6", "0.64", "0.48", "0.8", "-0.48", "-0.36")]


def ellipsoid() -> Motion:
    """Return q'' = −(q'·Aq'/|Aq|²) A q, A = diag(1, 1/2, 1/4), and its start."""
    squares = (1, 2, 4)

    def rates(_: Any, state: Sequence[Any]) -> list[Any]:
        q, v = state[:3], state[3:]
        normal = [x / b for b, x in zip(squares, q, strict=True)]
        pull = sum(x**2 / b for b, x in zip(squares, v, strict=True)) / sum(x**2 for x in normal)
        return [*v, *(-pull * x for x in normal)]

    q = [mp.mpf("0.6"), mp.mpf("0.64") * mp.sqrt(2), mp.mpf("0.96")]
    normal = [x / b for b, x in zip(squares, q, strict=True)]
    square = sum(x**2 for x in normal)
    along = [(i == 0) - normal[0] * x / square for i, x in enumerate(normal)]
    length = mp.sqrt(sum(x**2 for x in along))
    return rates, [*q, *(x / length for x in along)]


def kovalevskaya() -> Motion:
    """Return the top with I = (2, 2, 1), V = R₃₁."""
    return _top((2, 2, 1), ("1", "0.5", "0.25"))


def goryachev_chaplygin() -> Motion:
    """Return the top with I = (4, 4, 1), V = R₃₁."""
    return _top((4, 4, 1), ("1", "0.5", "0"))


def _top(moments: Sequence[int], omega: Sequence[str]) -> Motion:
    """Return the equations of a top, with R₃ the upward vertical in the body.

        q' = ½ q (0, Ω),   I Ω' = I Ω × Ω + R₃ × e₁
    """
    I1, I2, I3 = moments

    def rates(_: Any, state: Sequence[Any]) -> list[Any]:
        q0, q1, q2, q3, x, y, z = state
        across, up = 2 * (q2 * q3 + q0 * q1), q0**2 - q1**2 - q2**2 + q3**2
        return [(-q1 * x - q2 * y - q3 * z) / 2, (q0 * x + q2 * z - q3 * y) / 2,
                (q0 * y + q3 * x - q1 * z) / 2, (q0 * z + q1 * y - q2 * x) / 2,
                (I2 - I3) * y * z / I1, ((I3 - I1) * z * x + up) / I2,
                ((I1 - I2) * x * y - across) / I3]

    return rates, [mp.mpf(x) for x in ("1", "0", "0", "0", *omega)]


def flyball_governor(damping: str = "4e4", struck: str = "0") -> Motion:
    """Return the equations of the governor, and its start.

        J ψ'' = −J_β β' ψ',   I β'' = ½ J_β ψ'² + f L_β + (m + 2 m_b) g cos β,   M s'' = f L_s − M g

    J is the inertia of all parts about the shaft, I of both rods about their hinges, L the length
    of a spring and f = −2 (K (L − ½) + C L').
    """
    K, C, g, m, M, ball, w, a = (mp.mpf(x) for x in (
        "8e5", damping, "9.81", "0.3", "3", "5", "0.01", "0.05"))
    shaft, block, swing = m * w**2 / 6, M * 4 * a**2 / 6, 2 * (m / 3 + m * w**2 / 12 + ball)

    def rates(_: Any, state: Sequence[Any]) -> list[Any]:
        _, beta, s, turn, down, up = state
        c, d = mp.cos(beta), mp.sin(beta)
        J = shaft + block + 2 * (m * (a**2 + a * c + c**2 / 3) + ball * (a + c) ** 2
                                 + m * w**2 * (d**2 / 6 + c**2 / 12))
        J_beta = 2 * (-m * (a + 2 * c / 3) * d - 2 * ball * (a + c) * d + m * w**2 * c * d / 6)
        above = 1 - d / 2 - s
        L = mp.sqrt(c**2 / 4 + above**2)
        L_beta, L_s = -c * (d / 2 + above) / (2 * L), -above / L
        f = -2 * (K * (L - mp.mpf(1) / 2) + C * (L_beta * down + L_s * up))
        return [turn, down, up, -J_beta * down * turn / J,
                (J_beta * turn**2 / 2 + f * L_beta + (m + 2 * ball) * g * c) / swing,
                f * L_s / M - g]

    return rates, [mp.mpf(0), mp.pi / 6, mp.mpf(1) / 2, 2 * mp.pi, mp.mpf(0), mp.mpf(struck)]
