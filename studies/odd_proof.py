"""Proofs behind the law of ``energy_law``, each exact and each able to fail.

- the tableau facts that make LIIIA-B variational and fix the radial velocity of its stages
- one step expanded in h (``one_step``): its energy error must be −h^{2s−1} d/dt(A_s + C_s/γ), and
  the first term with γ itself −h^{2s+1} γ dB_s/dt, as H̃ is conserved
- the parity of X and Y, which decides between 1/γ and γ
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import sympy as sp
from sympy import QQ, ring

from ..generator.tableaux.families import lobatto_iiiab
from ..generator.tableaux.tableau import Tableau
from .body_frame import BodyFrameTop
from .energy_law import energy_law, node_numbers, node_slope
from .one_step import energy_error
from .power_series import PowerSeries
from .study_result import Claim

__all__ = [
    "RATIONAL_STATES",
    "gamma_claim",
    "identities_claim",
    "parity_claim",
    "step_claim_rational",
    "step_claim_symbolic",
    "symbolic_top",
    "variational",
    "variational_claim",
]

#: l, Γ, (1/I₁, 1/I₂, 1/I₃) and mgl of bodies without any symmetry.
RATIONAL_STATES = [
    (("3/7", "-2/5", "1/3"), ("2/3", "-1/3", "2/3"), ("1/2", "3/5", "4/3"), "5/7"),
    (("-1/2", "5/3", "2/7"), ("2/7", "6/7", "3/7"), ("2/3", "1/4", "7/5"), "-3/4"),
]

Expression = Any


# ---------------------------------------------------------------- the tableau


def variational(tableau: Tableau) -> bool:
    """Whether b_i â_ij + b_j a_ji = b_i b_j and Σ_i b_i M′(c_i) â_ij = 0, b_i M′(c_i)² constant.

    The first makes the step stationary for its discrete Lagrangian; the second says that the
    stage momenta P_i lie on a polynomial of degree s − 2. All are matrix equations in the rational
    basis of ``tableau.stages``, in which ``nodes.multiply(f)`` is the product with f(c_i).
    """
    nodes, basis = tableau.stages, tableau.basis
    b, A, A_hat = (basis[name] for name in ("b", "A", "A_hat"))
    times_b = nodes.multiply(b)
    symplectic_defect = times_b * A_hat + (times_b * A).transpose() - b * b.transpose()
    weighted = times_b * node_slope(nodes)
    radial_defect = weighted.transpose() * nodes.trace * A_hat
    square = nodes.multiply(node_slope(nodes)) * weighted
    mu = node_numbers(tableau.s).mu
    mu_defect = square - nodes.one * QQ.from_sympy(mu)
    return all(defect.is_zero_matrix for defect in (symplectic_defect, radial_defect, mu_defect))


def variational_claim(stages: Sequence[int]) -> Claim:
    """Return the claim that the tableaux of s-LIIIA-B have the properties of ``variational``."""
    good = [s for s in stages if variational(lobatto_iiiab(s))]
    return Claim(
        "LIIIA-B is the variational method of h Σ b_i L(Q_i, Q̇_i): b_i â_ij + b_j a_ji = b_i b_j; "
        "Σ_i b_i M′(c_i) P_i = 0; b_i M′(c_i)² = μ for every i.",
        f"exact for s = {_list(good)}", f"exact for s = {_list(stages)}", good == list(stages),
        "proved",
    )


# ---------------------------------------------------------------- one step


def symbolic_top() -> tuple[BodyFrameTop, Callable[[Expression], Expression]]:
    """Return a top with l, Γ, 1/I₁, 1/I₂ as symbols, I₃ = mgl = 1, and d/dt along its motion.

    The units of mass and time make I₃ and mgl equal to 1; nothing else is special.
    """
    polynomials, *symbols = ring("l1 l2 l3 G1 G2 G3 j1 j2", QQ)
    top = BodyFrameTop(symbols[:3], symbols[3:6], [*symbols[6:], polynomials.one], polynomials.one)
    rates = [rate for vector in top.rates() for rate in vector]

    def derivative(f: Expression) -> Expression:
        """Return df/dt = Σ ∂f/∂x ẋ over l and Γ; the moments are constant."""
        return sum((f.diff(x) * rate for x, rate in zip(symbols[:6], rates, strict=True)),
                   polynomials.zero)

    return top, derivative


def step_claim_symbolic(s: int) -> Claim:
    """Return the claim that one step of s-LIIIA-B changes H by −h^(2s−1) d/dt(A_s + C_s/γ).

    The coefficients are compared as polynomials in the state and the moments: for every top. A
    key (n, g) of the series is the power hⁿ γᵍ.
    """
    top, derivative = symbolic_top()
    law = energy_law(s, top)
    error = energy_error(lobatto_iiiab(s), top, 2 * s - 1)
    expected = {(2 * s - 1, 0): -derivative(law.A), (2 * s - 1, -1): -derivative(law.C)}
    return _step_claim(s, error.terms == expected, "any state of any top, γ symbolic")


def step_claim_rational(s: int) -> Claim:
    """Return the claim of ``step_claim_symbolic`` at rational states of two bodies, γ symbolic."""
    holds = True
    for top, error in _rational_errors(s, 2 * s - 1):
        law = energy_law(s, _moving(top))
        expected = {(2 * s - 1, 0): -_rate(law.A), (2 * s - 1, -1): -_rate(law.C)}
        holds &= error.terms == expected
    return _step_claim(s, holds, f"{len(RATIONAL_STATES)} rational states, γ symbolic")


def _step_claim(s: int, holds: bool, where: str) -> Claim:
    """Return the claim on the energy error of one step; ``where`` names the states it covers."""
    return Claim(
        f"One step of {s}-LIIIA-B changes the energy by −h^{2 * s - 1} d/dt(A_{s} + C_{s}/γ), with "
        f"no other power of γ and nothing below h^{2 * s - 1}.",
        f"{'equal' if holds else 'not equal'}, {where}", "equal, term by term", holds, "proved",
    )


def gamma_claim(stages: Sequence[int]) -> Claim:
    """Return the claim that γ first appears in one step's energy error as −h^(2s+1) γ dB_s/dt.

    The expansions are exact, at rational states of two bodies; a key (n, g) is the power hⁿ γᵍ.
    """
    outcomes = []
    for s in stages:
        for top, error in _rational_errors(s, 2 * s + 1):
            positive_powers = {key: a for key, a in error.terms.items() if key[1] > 0}
            B_rate = _rate(energy_law(s, _moving(top)).B)
            outcomes.append(positive_powers == {(2 * s + 1, 1): -B_rate})
    return Claim(
        "γ itself first appears two orders later, as −h^{2s+1} γ dB_s/dt.",
        f"{sum(outcomes)} of {len(outcomes)} expansions of s = {_list(stages)} at rational states",
        f"all {len(outcomes)}, in rational arithmetic", all(outcomes), "proved",
    )


@cache
def _rational_errors(s: int, order: int) -> list[tuple[BodyFrameTop, PowerSeries]]:
    """Return the rational tops, each with the energy error of one step of s-LIIIA-B."""
    return [(top, energy_error(lobatto_iiiab(s), top, order)) for top in _rational_tops()]


def _rational_tops() -> list[BodyFrameTop]:
    """Return the tops of ``RATIONAL_STATES``, in exact rational numbers."""
    def numbers(texts: Sequence[str]) -> list[Any]:
        """Return texts such as "3/7" as exact numbers."""
        return [QQ.from_sympy(sp.Rational(text)) for text in texts]

    return [BodyFrameTop(numbers(a), numbers(b), numbers(c), numbers([d])[0])
            for a, b, c, d in RATIONAL_STATES]


def _moving(top: BodyFrameTop) -> BodyFrameTop:
    """Return the top at l + e l̇ and Γ + e Γ̇, with a symbol e.

    The coefficient of e in a polynomial f of this state is df/dt; e² is not used.
    """
    _, e = ring("e", QQ)
    l_rate, vertical_rate = top.rates()
    return BodyFrameTop([e * rate + x for x, rate in zip(top.l, l_rate, strict=True)],
                        [e * rate + x for x, rate in zip(top.vertical, vertical_rate, strict=True)],
                        top.inverse_inertia, top.mgl)


def _rate(moving: Any) -> Any:
    """Return df/dt: the coefficient of e in f at a state of ``_moving``."""
    return moving.coeff(moving.ring.gens[0])


# ---------------------------------------------------------------- what the terms are


def identities_claim() -> Claim:
    """Return the claim with closed forms of C₂, C₃ and B₂, as polynomials, for every top.

    C₂ = T²/8; C₃ = V̇²/256 with V̇ = −Ṫ, as T + V is constant; B₂ = −[l₁l₂l₃ Π(1/Iᵢ − 1/Iⱼ)]²/512.
    """
    top, derivative = symbolic_top()
    l, j = top.l, top.inverse_inertia  # noqa: E741
    T = sum(x * x * i for x, i in zip(l, j, strict=True)) * QQ(1, 2)
    asymmetry = (l[0] * l[1] * l[2]) * (j[0] - j[1]) * (j[1] - j[2]) * (j[2] - j[0])
    two, three = energy_law(2, top), energy_law(3, top)
    pairs = [(two.C, T**2 * QQ(1, 8)), (three.C, derivative(T) ** 2 * QQ(1, 256)),
             (two.B, asymmetry**2 * QQ(-1, 512))]
    holds = all(term == expected for term, expected in pairs)
    return Claim(
        "C₂ = T²/8, C₃ = V̇²/256 and B₂ = −[l₁l₂l₃(1/I₁−1/I₂)(1/I₂−1/I₃)(1/I₃−1/I₁)]²/512, which is "
        "0 for a symmetric top.",
        "identical polynomials" if holds else "different polynomials", "identical polynomials",
        holds, "proved",
    )


def parity_claim(stages: Sequence[int]) -> Claim:
    """Return the claim Y_s → (−1)^s Y_s and X_s → (−1)^(s+1) X_s under l₂, Γ₂, t → −l₂, −Γ₂, −t."""
    top, _ = symbolic_top()
    good = [s for s in stages if _parity_holds(s, top)]
    return Claim(
        "Under the reversal (l₂, Γ₂, t) → (−l₂, −Γ₂, −t), Y_s → (−1)^s Y_s and X_s → (−1)^{s+1} "
        "X_s: at the turning points of a symmetric top's nutation (l₂ = Γ₂ = 0 in suitable axes) "
        "Y = 0 for odd s and X = 0 for even s.",
        f"s = {_list(good)}, as polynomials in the state", f"s = {_list(stages)}",
        good == list(stages), "proved",
    )


def _parity_holds(s: int, top: BodyFrameTop) -> bool:
    """Return whether X_s and Y_s of a symbolic top have the parity of ``parity_claim``."""
    law = energy_law(s, top)
    sign = (-1) ** s
    return bool(_reverse_signs(law.Y) == sign * law.Y and _reverse_signs(law.X) == -sign * law.X)


def _reverse_signs(f: Any) -> Any:
    """Return f(−l₂, −Γ₂): terms odd in l₂ and Γ₂ (generators 1 and 4) change their sign."""
    return f.ring.from_dict({powers: -a if (powers[1] + powers[4]) % 2 else a
                             for powers, a in f.items()})


def _list(numbers: Sequence[int]) -> str:
    """Return e.g. "2, 3, 4", or "none"."""
    return ", ".join(map(str, numbers)) or "none"
