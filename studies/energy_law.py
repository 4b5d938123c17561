"""The energy error of LIIIA-B: the leading terms of its modified Hamiltonian, with γ.

LIIIA-B is the variational method of the discrete Lagrangian

    L_d(q₀, q₁) = ext h Σ_i b_i L(Q_i, Q̇_i),   |Q_i| = 1,   Q̇_i of a polynomial of degree s,

L = T + 2γ(qᵀq̇)² − V. Expanding it about the exact motion (see ``odd_stages``) gives

    H̃ = H + h^{2s−2} (A_s + C_s/γ) + h^{2s} (B_s γ + terms without γ and with 1/γ) + O(h^{2s+2})

    C_s = μ/(8s) Y²,    Y = y_{s−1}⁰
    B_s = −2μς X²,      X = x_{s+1}⁰ + ẋᵀH_pp y_{s−1}/s
    A_s = μ/(8s) Σᵢ (y_{s−1}ⁱ)²/Iᵢ + μ Σ_{k=1}^{s−1} y_{s−1−k}·x_{s+k} − ε [t^{2s−2}] ẋ·y

with x_k = q⁽ᵏ⁾/k! and y_k = p⁽ᵏ⁾/k! of the exact motion, ⁰ the component along q and ⁱ those along
the body axes, the node polynomial M(t) = Π(t − c_i), and the numbers

    μ = b_i M′(c_i)², the same for every i,   ς = Σ (c_i − ½)²,   ε = Σ b_i c_i^{2s−2} − 1/(2s−1).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import sympy as sp
from sympy import QQ

from ..generator.tableaux.families import lobatto_iiiab
from ..generator.tableaux.node_algebra import Nodes, power
from .body_frame import BodyFrameTop, dot, motion, over

__all__ = ["Law", "NodeNumbers", "energy_law", "node_numbers", "node_slope"]

Matrix = Any


@dataclass(frozen=True)
class NodeNumbers:
    """μ (``mu``), ς (``spread``) and ε (``quadrature``) of the s Lobatto nodes, exact."""

    mu: sp.Rational
    spread: sp.Rational
    quadrature: sp.Rational


@dataclass(frozen=True)
class Law:
    """A_s, B_s, C_s, X and Y at a state: numbers, polynomials, or arrays over many states."""

    A: Any
    B: Any
    C: Any
    X: Any
    Y: Any


def node_slope(nodes: Nodes) -> Matrix:
    """Return the derivative c → M′(c) = Σ_k k a_k c^(k−1) of the node polynomial M = Σ_k a_k c^k.

    M is ``nodes.polynomial``, whose roots are the nodes. As every function on ``nodes``, M′ is a
    column of rational numbers: its coefficients as an element of ℚ[x]/(M).
    """
    coefficients = nodes.polynomial.all_coeffs()[::-1]  # type: ignore[attr-defined]
    # the sum starts from its term k = 1, the constant a_1, as 0 is no column to add to
    return sum(
        (power(nodes, k - 1) * QQ.from_sympy(k * a) for k, a in enumerate(coefficients) if k > 1),
        nodes.one * QQ.from_sympy(coefficients[1]),
    )


@lru_cache
def node_numbers(s: int) -> NodeNumbers:
    """Return μ = b_i M′(c_i)², ς = Σ (c_i − ½)² and ε = Σ b_i c_i^(2s−2) − 1/(2s − 1) of s nodes.

    Sums over the nodes are traces of rational matrices, so that no root of M is computed.
    """
    tableau = lobatto_iiiab(s)
    nodes, b = tableau.stages, tableau.basis["b"]

    def total(f: Matrix, g: Matrix) -> Any:
        """Return Σ_i f(c_i) g(c_i)."""
        return (f.transpose() * nodes.trace * g).to_list()[0][0]

    slope = node_slope(nodes)
    # b_i M′(c_i)² is the same for every i: the sum over the s nodes, divided by s
    mu = total(b, nodes.multiply(slope) * slope) / s
    # Σ (c_i − ½)² = Σ c_i² − s/4, for symmetric nodes have Σ c_i = s/2
    spread = total(power(nodes, 1), power(nodes, 1)) - QQ(s, 4)
    quadrature = total(b, power(nodes, 2 * s - 2)) - QQ(1, 2 * s - 1)
    return NodeNumbers(*map(QQ.to_sympy, (mu, spread, quadrature)))


def energy_law(s: int, top: BodyFrameTop) -> Law:
    """Return A_s, B_s and C_s of H̃ = H + h^(2s−2) (A + C/γ) + h^(2s) B γ + … of s-LIIIA-B.

    With the Taylor coefficients x_k of q and y_k of p in body axes, z of y_(s−1) = (Y, z) and the
    numbers μ, ς, ε of the nodes,

        A = μ/(8s) z·J⁻¹z + μ Σ_k y_(s−1−k)·x_(s+k) − ε Σ_k (k + 1) x_(k+1)·y_(2s−2−k)
        X = x_(s+1),0 + x_1·J⁻¹z/(4s),   B = −2μς X²,   C = μY²/(8s)
    """
    # the sums reach x_(2s−1) and y_(2s−2)
    x, y = motion(top, 2 * s - 1)
    mu, spread, quadrature = (_as(top, number) for number in vars(node_numbers(s)).values())
    Y, *z = y[s - 1]
    J_inverse_z = [j * a for j, a in zip(top.inverse_inertia, z, strict=True)]
    A = over(mu * sum(a * b for a, b in zip(J_inverse_z, z, strict=True)), 8 * s)
    A += mu * sum(dot(y[s - 1 - k], x[s + k]) for k in range(1, s))
    A -= quadrature * sum((k + 1) * dot(x[k + 1], y[2 * s - 2 - k]) for k in range(2 * s - 1))
    X = x[s + 1][0] + over(sum(a * b for a, b in zip(x[1][1:], J_inverse_z, strict=True)), 4 * s)
    return Law(A, -2 * mu * spread * X * X, over(mu * Y * Y, 8 * s), X, Y)


def _as(top: BodyFrameTop, number: sp.Rational) -> Any:
    """Return a rational number in the arithmetic of the state: exact, or a float for arrays."""
    # the entries of a state are polynomials of a ring, elements of ℚ itself, or NumPy's arrays
    domain = getattr(getattr(top.l[0], "ring", None), "domain", None)
    if domain is not None or isinstance(top.l[0], type(QQ(1, 2))):
        return QQ.from_sympy(number)
    return float(number)
