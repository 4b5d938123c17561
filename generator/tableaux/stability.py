"""Stability function of a tableau: y' = λy gives y_{k+1} = R(z) y_k, z = λΔt.

    R(z) = det(I − zA + z 1bᵀ)/det(I − zA)

A-stable: |R| ≤ 1 wherever Re z ≤ 0; that is, det(I − zA) has its roots in Re z > 0, and

    E(w) = |det(I − iyA)|² − |det(I − iyA + iy 1bᵀ)|² ≥ 0,  w = y² ≥ 0.

L-stable: R(∞) = 0 besides. What decays faster than a step is then gone after it, where |R(∞)| = 1
lets it ring. An undamped oscillation ω keeps |R(iωΔt)| = 1 − Cw^k/2 of its amplitude, with the
first term of E, C w^k: what numerical damping costs.

Under linear constraints q' = M⁻¹p, p' = −Cp − Kq − Gᵀλ, Gq = 0, G Q̃_l = 0 says Σ_j ā_lj G k_j = 0,
l = 1..p. If p = s and M = Ā Ã is regular, so is Ā: all stages have G k_j = 0, and on the null space
of G, where Gᵀλ is not felt, they are those of the Runge-Kutta method (A, b) on the motion left
free. T2 then finds nothing to project: R is that of the constrained step too.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import sympy as sp
from sympy import QQ
from sympy.polys.matrices import DomainMatrix

from .multipliers import multiplier_inverse
from .tableau import Tableau

__all__ = ["Stability", "stability"]

z = sp.Symbol("z")
w = sp.Symbol("w")
#: Half the bits that numbers of a given tableau are taken to; what is below the half is zero.
BITS = 256


@dataclass(frozen=True)
class Stability:
    """R(z) of a tableau, by its numerator and denominator, and what follows.

    Attributes
    ----------
    numerator, denominator : Poly
        In z; R(0) = 1.
    constrained : bool
        Whether R is that of steps under linear constraints too.
    rounding : Rational
        Values smaller than this relative to their terms are 0, for a tableau given as numbers.
    """

    numerator: sp.Poly
    denominator: sp.Poly
    constrained: bool
    rounding: sp.Rational

    @property
    def at_infinity(self) -> sp.Rational | None:
        """R(∞); None where it has none."""
        high, low = self.numerator.degree(), self.denominator.degree()
        if high > low:
            return None
        return self.numerator.LC() / self.denominator.LC() if high == low else sp.Integer(0)

    @property
    def deficit(self) -> sp.Poly:
        """E(w), by how much |R(iy)| is below 1."""
        whole, less = _square(self.denominator), _square(self.numerator)
        kept = {powers: c for powers, c in (whole - less).terms()
                if abs(c) > self.rounding * max(abs(whole.nth(*powers)), abs(less.nth(*powers)))}
        return sp.Poly.from_dict(kept, w, domain="QQ")

    @property
    def a_stable(self) -> bool:
        """Whether |R| ≤ 1 in the left half-plane."""
        return _roots_are_right(self.denominator) and _nowhere_negative(self.deficit)

    @property
    def l_stable(self) -> bool:
        """Whether R(∞) = 0 besides."""
        return self.at_infinity == 0 and self.a_stable

    @property
    def damping(self) -> tuple[sp.Rational, int] | None:
        """C and 2k: an oscillation loses about C (ωΔt)^2k of its amplitude in a step."""
        terms = [(k, c) for (k,), c in self.deficit.terms() if c]
        return (min(terms)[1] / 2, 2 * min(terms)[0]) if terms else None

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
    """Return R(z); None where Â ≠ A or b̂ ≠ b, and q and p have no method in common."""
    part, nodes = tableau.basis, tableau.stages
    if part["A"] != part["A_hat"] or part["b"] != part["b_hat"]:
        return None
    # A function f of the node goes to Σ_j a_ij f(c_j) by A T, to 1 Σ_j b_j f(c_j) by 1 bᵀ T.
    stages = _rational(part["A"]) * _rational(nodes.trace)
    ends = _rational(nodes.one) * _rational(part["b"]).transpose() * _rational(nodes.trace)
    rounding = sp.Integer(0)
    if tableau.given:
        digits = tableau.digits_given
        rounding = sp.Rational(1, 2**BITS if digits is None else 10 ** (digits - 2))
    constrained = tableau.p == tableau.s and multiplier_inverse(tableau) is not None
    return Stability(_without(_determinant(stages - ends), rounding),
                     _without(_determinant(stages), rounding), constrained, rounding)


def _rational(matrix: Any) -> DomainMatrix:
    """Return a matrix of rationals: itself, or numbers that are given, to 2^−2·BITS."""
    if matrix.domain.is_QQ:
        return matrix
    unit = 4**BITS
    rows = [[QQ(int(e.p), int(e.q)) if e.is_Rational else
             QQ(int(sp.floor(sp.N(e * unit, BITS))), unit) for e in row]
            for row in matrix.to_list()]
    return DomainMatrix(rows, matrix.shape, QQ)


def _determinant(matrix: DomainMatrix) -> sp.Poly:
    """Return det(I − z K)."""
    coefficients = [QQ.to_sympy(c) for c in matrix.charpoly()]  # of λ^s, λ^(s−1), …
    return sp.Poly(coefficients[::-1], z, domain="QQ")


def _without(polynomial: sp.Poly, rounding: sp.Rational) -> sp.Poly:
    """Return a polynomial without terms that are round-off relative to the largest.

    Eigenvalues of A are about 1/(2s): z is counted in 2s.
    """
    sizes = {k: c * (2 * polynomial.degree()) ** k for (k,), c in polynomial.terms()}
    least = rounding * max(map(abs, sizes.values()))
    kept = {powers: c for powers, c in polynomial.terms() if abs(sizes[powers[0]]) > least}
    return sp.Poly.from_dict(kept, polynomial.gen, domain="QQ")


def _square(polynomial: sp.Poly) -> sp.Poly:
    """Return |P(iy)|² as a polynomial in w = y²."""
    product = polynomial * polynomial.compose(sp.Poly(-z, z, domain="QQ"))  # even in z
    terms = {(k // 2,): c * (-1) ** (k // 2) for (k,), c in product.terms() if c}
    return sp.Poly.from_dict(terms, w, domain="QQ")


def _nowhere_negative(polynomial: sp.Poly) -> bool:
    """Whether a polynomial is ≥ 0 for all w ≥ 0: no sign changes, and the last sign is +."""
    if polynomial.is_zero:
        return True
    odd = [factor for factor, times in polynomial.sqf_list()[1] if times % 2]
    crossed = any(factor.count_roots(0, sp.oo) - (factor.TC() == 0) for factor in odd)
    return bool(polynomial.LC() > 0) and not crossed


def _roots_are_right(polynomial: sp.Poly) -> bool:
    """Whether all roots have Re z > 0: by Routh's scheme of P(−z)."""
    mirrored = polynomial.compose(sp.Poly(-z, z, domain="QQ")).all_coeffs()
    above, row = mirrored[::2], mirrored[1::2]
    signs = [above[0]]
    while row:
        if row[0] == 0:
            return False
        signs.append(row[0])
        below = [above[i + 1] - above[0] * (row[i + 1] if i + 1 < len(row) else 0) / row[0]
                 for i in range(len(above) - 1)]
        above, row = row, below
    return all(sign > 0 for sign in signs) or all(sign < 0 for sign in signs)
