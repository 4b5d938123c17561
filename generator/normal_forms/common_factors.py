"""Factors of a sum of terms: common factors, square roots, products of sums.

Time grows hardly faster than the number of terms; factors that take longer are not sought.
"""

from __future__ import annotations

import math
from typing import Any

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
    merged,
    order,
    quotient,
    rational,
    scaled,
    varies,
)

__all__ = ["doubled", "factors_of", "square_root", "without_common"]

#: Terms, bases and degree up to which SymPy factors a sum.
_MOST_TERMS, _MOST_BASES, _HIGHEST_DEGREE = 20, 4, 8


def without_common(terms: Terms) -> tuple[Monomial, Number, Terms]:
    """Return the monomial and the number common to all terms, and the terms without them.

    The remaining coefficients are coprime whole numbers, the first one positive.
    """
    monomials = iter(terms)
    common = dict(next(monomials))
    for m in monomials:
        powers = dict(m)
        common = {base: shared for base, n in common.items()
                  if (shared := nearer_zero(n, powers.get(base, 0))) is not None}
        if not common:
            break
    outer: Monomial = frozenset(common.items())
    value = quotient(math.gcd(*(a.numerator for a in terms.values())),
                     math.lcm(*(a.denominator for a in terms.values())))
    if terms[min(terms, key=order)] < 0:
        value = -value
    below = inverse(outer)
    inner = {merged(m, below)[0]: a for m, a in terms.items()} if below else terms
    return outer, value, scaled(inner, quotient(1, value))


def nearer_zero(a: Any, b: Any) -> Any:
    """Return the common power of two powers of one base; None where there is none."""
    if a == b:
        return a
    if not (isinstance(a, int) and isinstance(b, int)) or a * b <= 0:
        return None
    return min(a, b, key=abs)


def doubled(value: Number, terms: Terms, n: int = 1) -> tuple[Number, Terms]:
    """Return a number a and terms u, of a uⁿ in a product.

    The 2 stays in products 2 x y of two variables: it comes from (x + y)², and derivatives then
    share subexpressions with those of x².
    """
    bilinear = all(len(m) == 2 and all(b.is_Symbol and varies(b) and k == 1 for b, k in m)
                   for m in terms)
    if not bilinear or value.numerator % 2**n:
        return value, terms
    return quotient(value, 2**n), scaled(terms, 2)


# ---------------------------------------------------------------- squares


def square_root(terms: Terms) -> tuple[Terms, Terms]:
    """Return a square root of the terms and the remainder; no root where there is none.

    Term by term: each is half of the leading remainder over the first term.
    """
    lead = leading(terms)
    first = None if lead is None else root_of_term(lead, terms[lead])
    if lead is None or first is None or any(not isinstance(n, int) for m in terms for _, n in m):
        return {}, terms
    below = inverse(first[0])
    root, left = dict([first]), {m: a for m, a in terms.items() if m != lead}
    while left and len(root) ** 2 <= 4 * len(terms):
        m = min(left, key=order)
        new, a = merged(m, below)[0], quotient(left[m], 2 * first[1])
        if new in root or any(n < 0 for _, n in new):
            break
        for other, b in root.items():
            add_to(left, merged(new, other)[0], -2 * a * b)
        add_to(left, merged(new, new)[0], -a * a)
        root[new] = a
    return (root, left) if len(root) > 1 else ({}, terms)


def root_of_term(m: Monomial, a: Number) -> tuple[Monomial, Number] | None:
    """Return the square root of a term; None where it has none."""
    if a < 0 or any(not isinstance(n, int) or n % 2 for _, n in m):
        return None
    above, below = math.isqrt(a.numerator), math.isqrt(a.denominator)
    if above**2 != a.numerator or below**2 != a.denominator:
        return None
    return frozenset((base, n // 2) for base, n in m), quotient(above, below)


# ---------------------------------------------------------------- products


def factors_of(terms: Terms) -> list[tuple[Terms, int]] | None:
    """Return sums with powers whose product equals the terms; None where there are none.

    Only sums small enough for SymPy are tried.
    """
    bases = sorted({base for m in terms for base, _ in m}, key=base_key)
    if len(terms) > _MOST_TERMS or not 0 < len(bases) <= _MOST_BASES or not all(
            isinstance(n, int) for m in terms for _, n in m):
        return None
    lowest = {base: min(0, *(dict(m).get(base, 0) for m in terms)) for base in bases}
    rows = {tuple(dict(m).get(base, 0) - lowest[base] for base in bases): rational(a)
            for m, a in terms.items()}
    if max(map(sum, rows)) > _HIGHEST_DEGREE:
        return None
    value, factors = sp.Poly(rows, *sp.symbols(f"_b0:{len(bases)}"), domain=sp.QQ).factor_list()
    if sum(n for _, n in factors) < 2:
        return None
    found = [({frozenset((b, int(n)) for b, n in zip(bases, row, strict=True) if n): fraction(a)
               for row, a in factor.terms()}, n) for factor, n in factors]
    below: Monomial = frozenset((base, n) for base, n in lowest.items() if n)
    return [*found, ({below: fraction(value)}, 1)]
