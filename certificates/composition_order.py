"""The order of a composition as measured: the error of one step, in many digits.

    e(h) = |Φ_h(y) − φ_h(y)| = C h^{order+1} + …,   order = log2 e(h)/e(h/2) − 1

on H = pᵀMp/2 + ε V(q), V = −Σ_k w_k cos(n_k·q): two pendulums that are coupled in T and in V. φ is
summed from its Taylor series, Φ takes the force gradient G = ε² V_qᵀ M V_q in closed form. With a
tiny ε, the slope is the order in terms with one kick.
"""

from __future__ import annotations

from typing import Any

import mpmath as mp

from ..generator.tableaux.compositions import Composition
from .composition_proofs import as_mpf

__all__ = ["observed_composition_order"]

#: V = −Σ w cos(n·q), and the inverse mass M of T = ½ pᵀM p.
_WEIGHTS, _WAVES = (1, 2, 1), ((1, 0), (0, 1), (2, -1))
_INVERSE_MASS = ((1, "0.25"), ("0.25", "0.5"))
#: A step, short enough for the next term to show by at most 0.05; digits and terms of the series.
_STEP, _DIGITS, _TERMS = "0.0078125", 110, 45
#: ε where terms with two kicks are to vanish beside those with one.
_TINY = "1e-45"


def observed_composition_order(composition: Composition, one_kick: bool = False) -> float:
    """Return the measured order; within 0.1 of the order of the composition.

    With ``one_kick``, the order where kicks are small: the first of ``composition.orders``.
    """
    with mp.workdps(_DIGITS):
        scale, h = mp.mpf(_TINY) if one_kick else mp.mpf(1), mp.mpf(_STEP)
        long, short = (_error(composition, step, scale) for step in (h, h / 2))
        return float(mp.log(long / short, 2)) - 1


def _error(composition: Composition, h: Any, scale: Any) -> Any:
    """Return |z₁ − z(h)| of a step of size h of a composition from a fixed state, by Taylor series.
    """
    q, p = [mp.mpf(1), mp.mpf(-1) / 2], [mp.mpf(1) / 3, mp.mpf(3) / 4]
    exact = _taylor(q, p, h, scale)
    end = _step(composition, q, p, h, scale)
    return mp.norm(mp.matrix(end) - mp.matrix(exact))


def _times(matrix: Any, vector: list[Any]) -> list[Any]:
    """Return matrix · vector; entries of the matrix are numbers or decimals as text."""
    return [mp.fdot(map(mp.mpf, row), vector) for row in matrix]


def _step(composition: Composition, q: list[Any], p: list[Any], h: Any, scale: Any) -> list[Any]:
    """Return (q, p) after one step of alternating drifts and kicks.

    q ← q + a h M p,  p ← p − b h V_q + c h³ G_q,  with G = V_qᵀ M V_q and V scaled by ``scale``.
    V = −Σ w cos(n·q) is a sum of waves, so that V_q = Σ w n sin(n·q).
    """
    kicks = zip(composition.kicks, composition.gradients, strict=True)
    for i, a in enumerate(composition.drifts):
        if i:  # a kick stands between two drifts, so none before the first
            b, c = map(as_mpf, next(kicks))
            angles = [mp.fdot(wave, q) for wave in _WAVES]
            V_q = [scale * mp.fsum(w * n[k] * mp.sin(u) for w, n, u in zip(
                _WEIGHTS, _WAVES, angles, strict=True)) for k in range(2)]
            M_V_q = _times(_INVERSE_MASS, V_q)
            # G_q = 2 V_qq M V_q, with V_qq = Σ w n nᵀ cos(n·q)
            G_q = [2 * scale * mp.fsum(
                w * n[k] * mp.fdot(n, M_V_q) * mp.cos(u) for w, n, u in zip(
                    _WEIGHTS, _WAVES, angles, strict=True)) for k in range(2)]
            p = [x - b * h * v + c * h**3 * g for x, v, g in zip(p, V_q, G_q, strict=True)]
        q = [x + as_mpf(a) * h * v for x, v in zip(q, _times(_INVERSE_MASS, p), strict=True)]
    return [*q, *p]


def _taylor(q: list[Any], p: list[Any], h: Any, scale: Any) -> list[Any]:
    """Return the exact (q₁, q₂, p₁, p₂) after a time h, by the power series of the solution.

    The problem is H = ½ pᵀ M p + ``scale`` · V(q) in two coordinates, V = −Σ w cos(n·q).

    The coefficients follow from q̇ = M p, ṗ = −V_q, and for the sine s and cosine c of an angle u
    from ṡ = c u̇ and ċ = −s u̇.
    """
    # each list holds the coefficients of 1, t, t², … of one function of time
    Q, P = [[x] for x in q], [[x] for x in p]
    angles = [[mp.fdot(wave, q)] for wave in _WAVES]
    sines, cosines = [[mp.sin(u[0])] for u in angles], [[mp.cos(u[0])] for u in angles]
    for n in range(_TERMS):
        for k, v in enumerate(_times(_INVERSE_MASS, [P[0][n], P[1][n]])):
            Q[k].append(v / (n + 1))
        for k in range(2):
            force = mp.fsum(w * wave[k] * s[n] for w, wave, s in zip(
                _WEIGHTS, _WAVES, sines, strict=True))
            P[k].append(-scale * force / (n + 1))
        for u, s, c, wave in zip(angles, sines, cosines, _WAVES, strict=True):
            u.append(mp.fdot(wave, [Q[0][n + 1], Q[1][n + 1]]))
            rates = [(j + 1) * u[j + 1] for j in range(n + 1)]  # of u̇
            # coefficient n of a product of series: Σ_j u̇_j c_(n−j)
            s.append(mp.fdot(rates, reversed(c[: n + 1])) / (n + 1))
            c.append(-mp.fdot(rates, reversed(s[: n + 1])) / (n + 1))
    # polyval takes the highest power first
    return [mp.polyval(series[::-1], h) for series in (*Q, *P)]
