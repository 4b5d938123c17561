"""Motions in closed form and by quadrature, in mpmath's numbers: nothing of the engine is in them.

Each returns positions and velocities, or attitude and angular velocity, at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import mpmath as mp

__all__ = ["Numbers", "bead", "four_bars", "free_body", "growing_mass", "heavy_top", "jacobi",
           "simple_pendulum", "spherical_pendulum"]

Numbers = Mapping[str, Sequence[Any]]


def jacobi(u: Any, m: Any) -> tuple[Any, Any, Any]:
    """Return sn, cn and dn."""
    return tuple(mp.ellipfun(name, u, m=m) for name in ("sn", "cn", "dn"))


def simple_pendulum(t: Any) -> Numbers:
    """Return θ = 2 asin(k sn(√g t − K)) from downward, k² = ½: from the horizontal at x = −1."""
    g, m = mp.mpf("9.81"), mp.mpf(1) / 2
    sn, cn, dn = jacobi(mp.sqrt(g) * t - mp.ellipk(m), m)
    k = mp.sqrt(m)
    x, y, rate = 2 * k * sn * dn, 2 * m * sn**2 - 1, 2 * k * cn * mp.sqrt(g)
    return {"positions": [x, y], "velocities": [-rate * y, rate * x]}


def spherical_pendulum(t: Any) -> Numbers:
    """Return z'² = z (2 g z² − z − 2 g) by sn², the azimuth by quadrature of 1/(1 − z²); L = 1."""
    g = mp.mpf("9.81")
    root = mp.sqrt(1 + 16 * g**2)
    low, high = (1 - root) / (4 * g), (1 + root) / (4 * g)
    m, rate = -low / (high - low), mp.sqrt(2 * g * (high - low)) / 2

    def height(s: Any) -> tuple[Any, Any]:
        sn, cn, dn = jacobi(rate * s + mp.ellipk(m), m)
        return low - low * sn**2, -2 * low * sn * cn * dn * rate

    azimuth = _sum(lambda s: 1 / (1 - height(s)[0] ** 2), t, 40)
    z, climb = height(t)
    radius = mp.sqrt(1 - z**2)
    out, turn = -z * climb / radius, 1 / radius
    c, s = mp.cos(azimuth), mp.sin(azimuth)
    return {"positions": [radius * c, radius * s, z],
            "velocities": [out * c - turn * s, out * s + turn * c, climb]}


def four_bars(count: int, t: Any) -> tuple[Any, Any]:
    """Return sin φ and cos φ of φ'' = c sin φ, φ = 0, φ' = 1: all upright rods turn alike.

    c = g ((N+1)/2 + N)/((N+1)/3 + N), φ = π + 2 am(w t − K), w = ½ √(1 + 4c), m = 4c/(1 + 4c).
    """
    c = four_bar_constant(count)
    m, w = 4 * c / (1 + 4 * c), mp.sqrt(1 + 4 * c) / 2
    sn, cn, _ = jacobi(w * t - mp.ellipk(m), m)
    return -2 * sn * cn, 2 * sn**2 - 1


def four_bar_constant(count: int) -> Any:
    """Return c of φ'' = c sin φ for N linkages."""
    return mp.mpf("9.81") * (3 * (3 * count + 1)) / (2 * (4 * count + 1))


def bead(t: Any) -> Numbers:
    """Return r = cosh wt + (g/2w²)(sin wt − sinh wt) of r'' = w² r − g sin wt, w = 2."""
    w = mp.mpf(2)
    k = mp.mpf("9.81") / (2 * w**2)
    r = mp.cosh(w * t) + k * (mp.sin(w * t) - mp.sinh(w * t))
    out = w * (mp.sinh(w * t) + k * (mp.cos(w * t) - mp.cosh(w * t)))
    c, s = mp.cos(w * t), mp.sin(w * t)
    return {"positions": [r * c, r * s], "velocities": [out * c - w * r * s, out * s + w * r * c]}


def growing_mass(t: Any) -> Numbers:
    """Return x of x'' + 2c x' + k² x = 0 from rest at 1, c = 1/4 and k = 1."""
    c = mp.mpf(1) / 4
    turn = mp.sqrt(1 - c**2)
    decay, cosine, sine = mp.exp(-c * t), mp.cos(turn * t), mp.sin(turn * t) / turn
    return {"positions": [decay * (cosine + c * sine)], "velocities": [-decay * sine]}


# ---------------------------------------------------------------- bodies that turn


def free_body(moments: Sequence[Any], momentum: Sequence[Any], t: Any) -> Numbers:
    """Return M by Jacobi's functions, the turn about M's direction in space by quadrature.

    On the axes d, s, c that go with dn, sn and cn; s has the moment in the middle, and d turns
    over at no time: M_d = D dn τ, M_s = S sn τ, M_c = C cn τ, τ = τ₀ + n t. With M in space along z
    and 3-1-3 angles, R = Rz(ψ) Rx(θ) Rz(φ): M = |M| (sin θ sin φ, sin θ cos φ, cos θ) and
    ψ' = |M| (M₁²/I₁ + M₂²/I₂)/(M₁² + M₂²).
    """
    Is, M0 = list(moments), list(momentum)
    square, twice = sum(x**2 for x in M0), sum(x**2 / Ii for x, Ii in zip(M0, Is, strict=True))
    smallest, s, largest = sorted(range(3), key=Is.__getitem__)
    d, c = (smallest, largest) if square < twice * Is[s] else (largest, smallest)

    def amplitude(axis: int, zero: int, third: int) -> Any:
        """Return the square of M's component along ``axis`` where the one along ``zero`` is 0."""
        return (twice - square / Is[third]) / (1 / Is[axis] - 1 / Is[third])

    D, C, S = (mp.sqrt(amplitude(*axes)) for axes in ((d, s, c), (c, s, d), (s, c, d)))
    m = 1 - (square - S**2) / D**2
    D *= mp.sign(M0[d])
    even = 1 if (s - d) % 3 == 1 else -1  # sign of the permutation d, s, c
    # M_s' = ± M_c M_d (1/I_d − 1/I_c), from M' = M × Ω
    rate = even * C * D * (1 / Is[d] - 1 / Is[c]) / S
    begin = mp.ellipf(mp.atan2(M0[s] / S, M0[c] / C), m)

    def momentum_at(time: Any) -> list[Any]:
        sn, cn, dn = jacobi(begin + rate * time, m)
        M = [mp.mpf(0)] * 3
        M[d], M[s], M[c] = D * dn, S * sn, C * cn
        return M

    size = mp.sqrt(square)

    def turning(time: Any) -> Any:
        x, y, _ = momentum_at(time)
        return size * (x**2 / Is[0] + y**2 / Is[1]) / (x**2 + y**2)

    # φ, and with it the sign of q, is continued without jumps
    momenta = [momentum_at(time) for time in mp.linspace(0, t, 8 * max(1, int(t)))]
    spin = [mp.atan2(x, y) for x, y, _ in momenta]
    turns = sum(mp.nint((a - b) / (2 * mp.pi)) for a, b in pairwise(spin))

    def attitude(M: Sequence[Any], psi: Any, full_turns: Any) -> list[Any]:
        tilt = mp.acos(M[2] / size)
        parts = (about(2, psi), about(0, tilt), about(2, mp.atan2(M[0], M[1]) + full_turns))
        return product(product(parts[0], parts[1]), parts[2])

    start = attitude(momenta[0], mp.mpf(0), 0)
    end = attitude(momenta[-1], _sum(turning, t, 4 * max(1, int(t))), 2 * mp.pi * turns)
    # space axes are the body's axes at the start
    q = product([start[0], *(-x for x in start[1:])], end)
    return {"attitude": q,
            "angular velocity": [x / Ii for x, Ii in zip(momenta[-1], Is, strict=True)]}


def heavy_top(moments: Sequence[Any], mgl: Any, spin: Any, turn: Any, t: Any) -> Numbers:
    """Return Lagrange's top: its axis, 2, is horizontal at the start, Ω = (0, spin, turn), u' = 0.

    u, the height of the axis, is u₁ cn² v with v = K + n t; with R = Rz(ψ) Rx(χ) Ry(φ), u = sin χ:

        u'² = (1 − u²)(turn² − 2 mgl u/I) − (turn − k u)²,   I = I₁, k = I₂ spin/I
        ψ' = (turn − k u)/(1 − u²),   φ' = spin − u ψ'

    ∫ dt/(1 ± u) are elliptic integrals of the third kind: the axis goes past the lower pole so
    closely that a quadrature does not see it.
    """
    across, along, _ = moments
    k, drop = along * spin / across, 2 * mgl / across
    half = -(k**2 + turn**2) / (2 * drop)  # u'² = drop u (u² + 2 half u + 2 turn k/drop − 1)
    root = mp.sqrt(half**2 - 2 * turn * k / drop + 1)
    low, high = -half - root, -half + root
    m, rate = -low / (high - low), mp.sqrt(drop * (high - low)) / 2
    begin = mp.ellipk(m)
    end = begin + rate * t
    sn, cn, dn = jacobi(end, m)
    u, climb = low * cn**2, -2 * low * sn * cn * dn * rate

    def over(sign: int) -> Any:
        """Return ∫₀ᵗ dt/(1 + sign u)."""
        n = sign * low / (1 + sign * low)
        through = mp.ellippi(n, amplitude(end, m), m) - mp.ellippi(n, mp.pi / 2, m)
        return through / (1 + sign * low) / rate

    above, below = over(-1), over(1)
    psi = ((turn - k) * above + (turn + k) * below) / 2
    phi = spin * t - ((turn - k) * above - (turn + k) * below) / 2 - k * t
    tilt = mp.asin(u)
    q = product(product(about(2, psi), about(0, tilt)), about(1, phi))
    x, y = climb / mp.cos(tilt), (turn - k * u) / mp.cos(tilt)
    c, s = mp.cos(phi), mp.sin(phi)
    return {"attitude": q, "angular velocity": [c * x - s * y, spin, s * x + c * y]}


def amplitude(v: Any, m: Any) -> Any:
    """Return am v: sn v = sin am v, and it grows with v."""
    sn, cn, _ = jacobi(v, m)
    angle = mp.atan2(sn, cn)
    return angle + 2 * mp.pi * mp.nint(v / (4 * mp.ellipk(m)) - angle / (2 * mp.pi))


def about(axis: int, angle: Any) -> list[Any]:
    """Return the quaternion of a turn about an axis."""
    return [mp.cos(angle / 2), *(mp.sin(angle / 2) if i == axis else mp.mpf(0) for i in range(3))]


def product(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    """Return the product of two quaternions."""
    a0, a1, a2, a3 = a
    b0, b1, b2, b3 = b
    return [a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3, a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
            a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1, a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0]


def _sum(f: Callable[[Any], Any], t: Any, pieces: int) -> Any:
    """Return ∫₀ᵗ f by Gauss-Legendre quadrature in ``pieces`` equal pieces."""
    return mp.quadgl(f, mp.linspace(0, t, pieces + 1))
