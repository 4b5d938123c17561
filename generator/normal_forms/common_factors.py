"""Factors of a sum of terms: common factors, square roots, products of sums.

The time is nearly proportional to the number of terms; SymPy factors only short sums.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import sympy as sp

from .terms import (
    Monomial,
    Number,
    Terms,
    add_to,
    base_key,
    fraction,
    inverse,
    leading,
    multiply_monomials,
    order,
    quotient,
    rational,
    scale_terms,
    varies,
)

__all__ = ["absorb_factor_two", "factors_of", "square_root", "without_common"]

#: Terms, bases and degree up to which SymPy factors a sum.
_MOST_TERMS, _MOST_BASES, _HIGHEST_DEGREE = 20, 4, 8


class Factored(NamedTuple):
    """A sum as content · monomial · primitive.

    The coefficients of the primitive part are coprime integers, the first one positive.
    """

    monomial: Monomial
    content: Number
    primitive: Terms


def without_common(terms: Terms) -> Factored:
    """Return terms with their common monomial and the content taken out."""
    monomials = iter(terms)
    common = dict(next(monomials))
    for m in monomials:
        powers = dict(m)
        nearest = {base: nearer_zero(n, powers.get(base, 0)) for base, n in common.items()}
        common = {base: n for base, n in nearest.items() if n is not None}
        if not common:
            break
    outer: Monomial = frozenset(common.items())
    # gcd of the numerators over lcm of the denominators: the quotients are coprime integers
    content = quotient(math.gcd(*(a.numerator for a in terms.values())),
                       math.lcm(*(a.denominator for a in terms.values())))
    if terms[min(terms, key=order)] < 0:
        content = -content
    primitive = terms
    if outer:
        inverse_outer = inverse(outer)
        primitive = {multiply_monomials(m, inverse_outer).monomial: a for m, a in terms.items()}
    return Factored(outer, content, scale_terms(primitive, quotient(1, content)))


def nearer_zero(a: Any, b: Any) -> Any:
    """Return the exponent of the common factor of xᵃ and xᵇ; None if they have none."""
    if a == b:
        return a
    if not (isinstance(a, int) and isinstance(b, int)) or a * b <= 0:
        return None
    return min(a, b, key=abs)


def absorb_factor_two(factor: Number, terms: Terms, n: int = 1) -> tuple[Number, Terms]:
    """Return (a, u) with a uⁿ = factor · termsⁿ: (factor, terms), or (factor/2ⁿ, 2 terms).

    The latter if 2ⁿ divides the factor, and all terms are products x y of two variables. 2 x y
    stays together: it comes from (x + y)², and its derivatives share subexpressions with the
    derivatives of x².
    """
    are_bilinear = all(len(m) == 2 and all(b.is_Symbol and varies(b) and k == 1 for b, k in m)
                       for m in terms)
    if not are_bilinear or factor.numerator % 2**n:
        return factor, terms
    return quotient(factor, 2**n), scale_terms(terms, 2)


# ---------------------------------------------------------------- squares


def square_root(terms: Terms) -> tuple[Terms, Terms]:
    """Return (r, terms − r²); r is empty if the first term has no root.

    Long division: each term of r is the leading term of the remainder over twice the first term.
    """
    lead = leading(terms)
    first = None if lead is None else root_of_term(lead, terms[lead])
    if lead is None or first is None or any(not isinstance(n, int) for m in terms for _, n in m):
        return {}, terms
    first_monomial, first_coefficient = first
    inverse_first = inverse(first_monomial)
    root: Terms = {first_monomial: first_coefficient}
    remainder = {m: a for m, a in terms.items() if m != lead}
    # the square of k terms has about k²/2 terms: a longer root cannot be one of these terms
    while remainder and len(root) ** 2 <= 4 * len(terms):
        m = min(remainder, key=order)
        next_term = multiply_monomials(m, inverse_first).monomial
        a = quotient(remainder[m], 2 * first_coefficient)
        if next_term in root or any(n < 0 for _, n in next_term):
            break  # not divisible: the division would not end
        # (r + t)² = r² + 2 r t + t² for the new term t of the root
        for root_term, b in root.items():
            add_to(remainder, multiply_monomials(next_term, root_term).monomial, -2 * a * b)
        add_to(remainder, multiply_monomials(next_term, next_term).monomial, -a * a)
        root[next_term] = a
    return (root, remainder) if len(root) > 1 else ({}, terms)


def root_of_term(m: Monomial, a: Number) -> tuple[Monomial, Number] | None:
    """Return the square root of the term a m; None if it is not rational."""
    if a < 0 or any(not isinstance(n, int) or n % 2 for _, n in m):
        return None
    numerator, denominator = math.isqrt(a.numerator), math.isqrt(a.denominator)
    if numerator**2 != a.numerator or denominator**2 != a.denominator:
        return None
    return frozenset((base, n // 2) for base, n in m), quotient(numerator, denominator)


# ---------------------------------------------------------------- products


def factors_of(terms: Terms) -> list[tuple[Terms, int]] | None:
    """Return [(s_1, n_1), …] with terms = Π s_k^(n_k), or None.

    SymPy factors the polynomial that remains when negative powers are taken out; the last factor
    is its content times these. None for an irreducible polynomial, for exponents that are no
    integers, and beyond limits of terms, bases and degree.
    """
    bases = sorted({base for m in terms for base, _ in m}, key=base_key)
    if len(terms) > _MOST_TERMS or not 0 < len(bases) <= _MOST_BASES or not all(
            isinstance(n, int) for m in terms for _, n in m):
        return None
    powers_of = [dict(m) for m in terms]
    # SymPy's polynomials have no negative exponents: these are shifted by the lowest
    lowest = {base: min(0, *(powers.get(base, 0) for powers in powers_of)) for base in bases}
    coefficients = {tuple(powers.get(base, 0) - lowest[base] for base in bases): rational(a)
                    for powers, a in zip(powers_of, terms.values(), strict=True)}
    if max(map(sum, coefficients)) > _HIGHEST_DEGREE:
        return None
    x = sp.symbols(f"_b0:{len(bases)}")
    content, factors = sp.Poly(coefficients, *x, domain=sp.QQ).factor_list()
    if sum(n for _, n in factors) < 2:  # irreducible, but for its content and denominator
        return None
    sums: list[tuple[Terms, int]] = []
    for factor, n in factors:
        factor_terms: Terms = {}
        for exponents, a in factor.terms():
            m = frozenset((base, int(k)) for base, k in zip(bases, exponents, strict=True) if k)
            factor_terms[m] = fraction(a)
        sums.append((factor_terms, n))
    denominator: Monomial = frozenset((base, n) for base, n in lowest.items() if n)
    return [*sums, ({denominator: fraction(content)}, 1)]
