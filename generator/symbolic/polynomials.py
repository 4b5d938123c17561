"""Expansion of polynomials with rational coefficients: SymPy's result in a fraction of its time.

SymPy builds and sorts every intermediate product. Here a monomial Π x_k^(n_k) is the number
Σ n_k 2^(16 k), so that a product of monomials is the sum of two numbers, and only the terms of the
result become expressions. Exponents of symbols may be negative: 1/m is a power of m.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce

import sympy as sp

from .construction import ORDER

__all__ = ["expanded_polynomial"]

#: Bits of an exponent, of which one is its sign.
_BITS = 16
_HALF = 1 << (_BITS - 1)

#: Monomials with their coefficients, and the common denominator of these.
_Polynomial = tuple[dict[int, int], int]


class _OtherExpressionError(Exception):
    """An expression is no polynomial with rational coefficients."""


def expanded_polynomial(e: sp.Expr) -> sp.Expr | None:
    """Return ``sympy.expand(e)`` of a polynomial in symbols and their inverses; else None.

    Exponents must be below 2¹⁵ = 32768.
    """
    places: dict[sp.Symbol, int] = {}
    try:
        terms, denominator = _polynomial(e, places, results={})
    except _OtherExpressionError:
        return None
    symbols = list(places)
    # a monomial m is Σ n_k 2^(16 k): half the range of an exponent is added to each n_k, so that
    # none is negative and 16 bits of the sum belong to each
    bias = sum(_HALF << (_BITS * k) for k in range(len(symbols)))
    rows = [(sp.Rational(a, denominator), _exponents(m + bias)) for m, a in terms.items() if a]
    powers = {(k, n) for _, exponents in rows for k, n in exponents}
    power_of = {(k, n): symbols[k] if n == 1 else symbols[k] ** n for k, n in powers}
    # the order of arguments, as ranks: each two powers and numbers are compared once
    ordered = sorted({*power_of.values(), *(a for a, _ in rows)}, key=ORDER)
    rank = {x: i for i, x in enumerate(ordered)}
    products: list[tuple[sp.Expr, ...]] = []
    for a, exponents in rows:
        factors = sorted((power_of[power] for power in exponents), key=rank.__getitem__)
        # a factor 1 is left out, unless it is the whole term
        products.append((*factors,) if a == 1 and factors else (a, *factors))
    products.sort(key=lambda factors: (len(factors), [rank[x] for x in factors]))
    summands = [factors[0] if len(factors) == 1
                else sp.Mul._from_args(factors, is_commutative=True) for factors in products]
    summands.sort(key=ORDER)  # nearly sorted
    summands.sort(key=lambda term: not term.is_Number)  # a number is the first
    return sp.Add._from_args(summands, is_commutative=True)


def _exponents(biased_monomial: int) -> list[tuple[int, int]]:
    """Return (place, exponent) of the symbols of a monomial whose exponents have the bias."""
    digits = biased_monomial.to_bytes((biased_monomial.bit_length() + 7) // 8 + 1, "little")
    # two bytes, _BITS bits, are one exponent
    exponents = (int.from_bytes(digits[i:i + 2], "little") - _HALF
                 for i in range(0, len(digits) - 1, 2))
    return [(k, n) for k, n in enumerate(exponents) if n]


def _polynomial(
    e: sp.Expr, places: dict[sp.Symbol, int], results: dict[sp.Expr, _Polynomial]
) -> _Polynomial:
    """Return (monomial → integer coefficient, common denominator) of an expression.

    Both ``places`` of symbols in monomials and ``results`` of subexpressions are extended. Raises
    _OtherExpressionError for an expression that is no polynomial.
    """
    # a monomial is one integer with _BITS bits for each exponent: a product adds monomials
    if e.is_Symbol:
        return {1 << (_BITS * places.setdefault(e, len(places))): 1}, 1
    if e.is_Rational:
        return ({0: int(e.p)} if e else {}), int(e.q)
    if e in results:
        return results[e]
    if e.is_Add:
        results[e] = _sum([_polynomial(term, places, results) for term in e.args])
    elif e.is_Mul:
        factors = [_polynomial(factor, places, results) for factor in e.args]
        factors.sort(key=lambda factor: len(factor[0]))  # intermediate products stay short
        results[e] = reduce(_product, factors)
    elif e.is_Pow and e.exp.is_Integer and (e.base.is_Symbol or e.exp > 0):
        results[e] = _power(_polynomial(e.base, places, results), int(e.exp))
    else:
        raise _OtherExpressionError
    return results[e]


def _sum(polynomials: Sequence[_Polynomial]) -> _Polynomial:
    """Return the sum of polynomials over their least common denominator."""
    denominator = math.lcm(*(d for _, d in polynomials))
    total: dict[int, int] = {}
    for terms, d in polynomials:
        for m, a in terms.items():
            total[m] = total.get(m, 0) + a * (denominator // d)
    return total, denominator


def _power(base: _Polynomial, n: int) -> _Polynomial:
    """Return baseⁿ; n < 0 only of a symbol."""
    terms, denominator = base
    if len(terms) == 1:
        (m, a), = terms.items()
        # of a symbol a = 1 and the denominator is 1: the inverse has the exponent alone
        return {m * n: a ** abs(n)}, denominator ** abs(n)
    return reduce(_product, [base] * n, ({0: 1}, 1))


def _product(a: _Polynomial, b: _Polynomial) -> _Polynomial:
    """Return the product of two polynomials, whose monomials are numbers that add up."""
    product: dict[int, int] = {}
    get = product.get
    (a_terms, a_denominator), (b_terms, b_denominator) = a, b
    for m, x in a_terms.items():
        for n, y in b_terms.items():
            product[m + n] = get(m + n, 0) + x * y
    return product, a_denominator * b_denominator
