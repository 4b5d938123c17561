"""Stability function of a tableau: y' = λy gives y_{k+1} = R(z) y_k, z = λΔt.

    R(z) = det(I − zA + z 1bᵀ)/det(I − zA)

A-stable: |R| ≤ 1 wherever Re z ≤ 0; that is, det(I − zA) has its roots in Re z > 0, and

    E(w) = |det(I − iyA)|² − |det(I − iyA + iy 1bᵀ)|² ≥ 0,  w = y² ≥ 0.

L-stable: A-stable and R(∞) = 0. A component that decays much faster than a step vanishes after one
step; with |R(∞)| = 1 it would oscillate. An undamped oscillation ω is multiplied by
|R(iωΔt)| = 1 − Cw^k/2 in a step, w = (ωΔt)², with C w^k the first term of E: numerical damping.

Under linear constraints q' = M⁻¹p, p' = −Cp − Kq − Gᵀλ, Gq = 0, the equations G Q̃_l = 0 give
Σ_j ā_lj G k_j = 0, l = 1..p. If p = s and M = Ā Ã is regular, so is Ā: then G k_j = 0 for all
stages. On the null space of G, on which Gᵀλ vanishes, the step is the step of the Runge-Kutta
method (A, b) for the unconstrained motion, and T2 projects nothing: R(z) is also the stability
function of the constrained step.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import sympy as sp
from sympy import QQ
from sympy.polys.matrices import DomainMatrix

from ...core.records import dataclass
from .multipliers import multiplier_inverse
from .tableau import Tableau

__all__ = ["Stability", "stability"]

z = sp.Symbol("z")
w = sp.Symbol("w")
#: Numbers of a given tableau have 2·BITS bits; relative values below 2^−BITS count as zero.
BITS = 256


@dataclass(frozen=True)
class Stability:
    """R(z) of a tableau, by its numerator and denominator, and its properties.

    Attributes
    ----------
    numerator, denominator : Poly
        Polynomials in z; R(0) = 1.
    holds_with_constraints : bool
        Whether R is also the stability function under linear constraints.
    rounding : Rational
        Values smaller than this relative to their terms count as 0; 0 for an exact tableau.
    """

    numerator: sp.Poly
    denominator: sp.Poly
    holds_with_constraints: bool
    rounding: sp.Rational

    @property
    def at_infinity(self) -> sp.Rational | None:
        """R(∞); None if |R(∞)| is infinite."""
        high, low = self.numerator.degree(), self.denominator.degree()
        if high > low:
            return None
        return self.numerator.LC() / self.denominator.LC() if high == low else sp.Integer(0)

    @property
    def deficit(self) -> sp.Poly:
        """E(w) = |denominator|² − |numerator|² at z = iy, w = y²."""
        denominator = _squared_modulus(self.denominator)
        numerator = _squared_modulus(self.numerator)
        terms = {}
        for powers, c in (denominator - numerator).terms():
            # a difference below the round-off of its operands is 0
            size = max(abs(denominator.nth(*powers)), abs(numerator.nth(*powers)))
            if abs(c) > self.rounding * size:
                terms[powers] = c
        return sp.Poly.from_dict(terms, w, domain="QQ")

    @property
    def a_stable(self) -> bool:
        """Whether |R| ≤ 1 in the left half-plane."""
        return _roots_have_positive_real_part(self.denominator) and _is_nonnegative(self.deficit)

    @property
    def l_stable(self) -> bool:
        """Whether R is A-stable and R(∞) = 0."""
        return self.at_infinity == 0 and self.a_stable

    @property
    def damping(self) -> tuple[sp.Rational, int] | None:
        """(C/2, 2k): an oscillation ω loses about C/2 (ωΔt)^2k of its amplitude in a step Δt.

        C w^k, w = (ωΔt)², is the first term of E (``deficit``); None if E = 0. As R(0) = 1, it is
        the first term of 1 − |R|², too, and |R| = √(1 − C w^k) is about 1 − C w^k/2.
        """
        terms = [(k, c) for (k,), c in self.deficit.terms() if c]
        if not terms:  # E = 0: oscillations keep their amplitude
            return None
        k, c = min(terms)
        return c / 2, 2 * k

    @property
    def kind(self) -> str:
        """``L-stable``, ``A-stable`` or ``not A-stable``."""
        return "L-stable" if self.l_stable else "A-stable" if self.a_stable else "not A-stable"

    def __str__(self) -> str:
        limit = self.at_infinity
        size = "∞" if limit is None else f"{float(abs(limit)):.4g}"
        return f"{self.kind}, |R(∞)| = {size}"


@cache
def stability(tableau: Tableau) -> Stability | None:
    """Return R(z); None if Â ≠ A or b̂ ≠ b, so that q and p have different methods."""
    basis, nodes = tableau.basis, tableau.stages
    if basis["A"] != basis["A_hat"] or basis["b"] != basis["b_hat"]:
        return None
    # On functions of the node, A T is f → Σ_j a_ij f(c_j) and 1 bᵀ T is f → 1 Σ_j b_j f(c_j).
    stages = _rational(basis["A"]) * _rational(nodes.trace)
    ends = _rational(nodes.one) * _rational(basis["b"]).transpose() * _rational(nodes.trace)
    rounding = sp.Integer(0)
    if tableau.is_given_in_numbers:
        digits = tableau.decimal_digits
        rounding = sp.Rational(1, 2**BITS if digits is None else 10 ** (digits - 2))
    holds_with_constraints = (tableau.p == tableau.s
                              and multiplier_inverse(tableau) is not None)
    return Stability(_drop_round_off(_determinant(stages - ends), rounding),
                     _drop_round_off(_determinant(stages), rounding), holds_with_constraints,
                     rounding)


def _rational(matrix: Any) -> DomainMatrix:
    """Return the matrix with irrational numbers rounded down to multiples of 2^(−2·BITS)."""
    if matrix.domain.is_QQ:
        return matrix
    unit = 4**BITS

    def round_down(e: sp.Expr) -> Any:
        """Return a rational number exactly, any other one rounded down to a multiple of 1/unit."""
        if e.is_Rational:
            return QQ(int(e.p), int(e.q))
        # BITS digits are more than 2·BITS bits
        return QQ(int(sp.floor(sp.N(e * unit, BITS))), unit)

    rows = [[round_down(e) for e in row] for row in matrix.to_list()]
    return DomainMatrix(rows, matrix.shape, QQ)


def _determinant(matrix: DomainMatrix) -> sp.Poly:
    """Return det(I − z K)."""
    coefficients = [QQ.to_sympy(c) for c in matrix.charpoly()]  # of λ^s, λ^(s−1), …
    return sp.Poly(coefficients[::-1], z, domain="QQ")


def _drop_round_off(polynomial: sp.Poly, rounding: sp.Rational) -> sp.Poly:
    """Return a polynomial without the terms that are round-off relative to the largest term.

    Terms are compared at z = 2s, as the eigenvalues of A are about 1/(2s).
    """
    sizes = {k: c * (2 * polynomial.degree()) ** k for (k,), c in polynomial.terms()}
    threshold = rounding * max(map(abs, sizes.values()))
    terms = {powers: c for powers, c in polynomial.terms() if abs(sizes[powers[0]]) > threshold}
    return sp.Poly.from_dict(terms, polynomial.gen, domain="QQ")


def _squared_modulus(polynomial: sp.Poly) -> sp.Poly:
    """Return |P(iy)|² as a polynomial in w = y²."""
    product = polynomial * polynomial.compose(sp.Poly(-z, z, domain="QQ"))  # even in z
    terms = {(k // 2,): c * (-1) ** (k // 2) for (k,), c in product.terms() if c}
    return sp.Poly.from_dict(terms, w, domain="QQ")


def _is_nonnegative(polynomial: sp.Poly) -> bool:
    """Whether a polynomial is ≥ 0 for all w ≥ 0: no root of odd order in (0, ∞), and + at ∞."""
    if polynomial.is_zero:
        return True
    # roots of even order touch zero without a change of sign
    odd = [factor for factor, multiplicity in polynomial.sqf_list()[1] if multiplicity % 2]
    # a root at w = 0, where the constant term is 0, does not count
    changes_sign = any(factor.count_roots(0, sp.oo) - (factor.TC() == 0) for factor in odd)
    return bool(polynomial.LC() > 0) and not changes_sign


def _roots_have_positive_real_part(polynomial: sp.Poly) -> bool:
    """Whether all roots have Re z > 0, by the Routh array of P(−z).

    P(−z) is stable if and only if the first column of the array has one sign.
    """
    mirrored = polynomial.compose(sp.Poly(-z, z, domain="QQ")).all_coeffs()
    previous, row = mirrored[::2], mirrored[1::2]
    signs = [previous[0]]
    while row:
        if row[0] == 0:  # a zero pivot: not all roots have Re z > 0
            return False
        signs.append(row[0])
        padded = [*row, *[0] * (len(previous) - len(row))]
        following = [previous[i + 1] - previous[0] * padded[i + 1] / row[0]
                     for i in range(len(previous) - 1)]
        previous, row = row, following
    return all(sign > 0 for sign in signs) or all(sign < 0 for sign in signs)
