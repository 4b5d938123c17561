"""Sums of terms: rational coefficients, bases and their powers, as dictionaries.

    Σ_i a_i Π_j b_j^n_ij

Bases are symbols, functions, sums in a denominator or a root, numbers under a root. Symbols are
placeholders whose names sort as their indices do, variables (of a run) before parameters.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import sympy as sp

__all__ = ["ONE", "Monomial", "MonomialProduct", "Number", "Terms", "add_to", "base_key", "divides",
           "expression_of", "fraction", "inverse", "is_below", "is_rational", "leading",
           "multiply_monomials", "order", "placeholder", "plain_exponent", "primitive", "quotient",
           "rational", "scale_terms", "symbols_in", "term", "total_of", "varies"]

Number = int | Fraction
#: Bases with their exponents: ints, or expressions.
Monomial = frozenset[tuple[sp.Expr, Any]]
Terms = dict[Monomial, Number]

ONE: Monomial = frozenset()


# ---------------------------------------------------------------- symbols


@lru_cache(maxsize=2**16)
def placeholder(
    index: int, is_variable: bool, assumptions: frozenset[tuple[str, bool]]
) -> sp.Symbol:
    """Return placeholder ``index`` of the variables of a run, or of the parameters.

    The names sort by index, variables before parameters.
    """
    return sp.Symbol(f"_{'x' if is_variable else 'y'}{index:06}", **dict(assumptions))


@lru_cache(maxsize=2**16)
def varies(e: sp.Basic) -> bool:
    """Whether an expression in placeholders depends on a variable."""
    if e.is_Symbol:
        return bool(e.name.startswith("_x"))
    return any(map(varies, e.args))


def symbols_in(monomials: Iterable[Monomial]) -> set[sp.Symbol]:
    """Return the symbols in any base or exponent."""
    expressions = {e for m in monomials for pair in m for e in pair if not isinstance(e, int)}
    return {x for e in expressions for x in e.free_symbols}


# ---------------------------------------------------------------- numbers


def quotient(a: Number, b: Number) -> Number:
    """Return a/b, as an int where it is one; b = 1 only makes an int of a whole fraction a."""
    ratio = Fraction(a) / b
    return int(ratio) if ratio.denominator == 1 else ratio


def fraction(e: sp.Expr) -> Number:
    """Return the exact value of a rational or a decimal, sign · digits · 2^exponent."""
    if e.is_Rational:
        return quotient(int(e.p), int(e.q))
    sign, digits, exponent, _ = e._mpf_  # (−1)^sign · digits · 2^exponent
    return quotient((-1) ** sign * int(digits) * 2 ** max(int(exponent), 0), 2 ** max(-exponent, 0))


def rational(number: Number) -> sp.Rational:
    """Return a number as an expression."""
    return sp.Rational(number.numerator, number.denominator)


def plain_exponent(n: Any) -> Any:
    """Return an exponent as an int where it is one."""
    return n if isinstance(n, int) or not n.is_Integer else int(n)


def is_rational(n: Any) -> bool:
    """Whether an exponent is a known number."""
    return isinstance(n, int) or bool(n.is_Rational)


# ---------------------------------------------------------------- monomials


class MonomialProduct(NamedTuple):
    """number · monomial · Π sum^exponent."""

    monomial: Monomial
    number: Number = 1
    sum_powers: Sequence[tuple[sp.Expr, int]] = ()


def multiply_monomials(a: Monomial, b: Monomial) -> MonomialProduct:
    """Return the product of two monomials.

    The factors that are no longer irreducible are split off: √u √u gives the sum u to the power 1,
    √2 √2 the number 2.
    """
    if not a or not b:
        return MonomialProduct(a or b)
    bases, is_plain = _bases(b)
    if is_plain and bases.isdisjoint(_bases(a)[0]):
        return MonomialProduct(a | b)  # the set knows the hashes of its pairs
    powers = dict(a)
    number: Number = 1
    sum_powers: list[tuple[sp.Expr, int]] = []
    for base, n in b:
        exponent = plain_exponent(powers.pop(base, 0) + n)
        if (base.is_Add or base.is_Rational) and is_rational(exponent):
            integer_part = math.floor(exponent)
            if base.is_Rational:  # 2^(1/2) 2^(1/2) = 2
                number = quotient(number * Fraction(fraction(base)) ** integer_part, 1)
                exponent = plain_exponent(exponent - integer_part)
            # u^(1/2) u^(1/2) = u, which the caller expands; u in a denominator stays a base
            elif integer_part > 0 and not (isinstance(n, int) and n > 0):
                sum_powers.append((base, integer_part))
                exponent = plain_exponent(exponent - integer_part)
        if exponent != 0:
            powers[base] = exponent
    return MonomialProduct(frozenset(powers.items()), number, sum_powers)


@lru_cache(maxsize=2**16)
def _bases(m: Monomial) -> tuple[frozenset[sp.Expr], bool]:
    """Return the bases, and whether a product with other bases is the union of the pairs.

    Numbers, roots of sums and exponents that are no ints yet are processed by
    ``multiply_monomials``.
    """
    is_plain = all((isinstance(n, int) or not (n.is_Integer or base.is_Add))
                   and not base.is_Rational for base, n in m)
    return frozenset(base for base, _ in m), is_plain


def inverse(m: Monomial) -> Monomial:
    """Return 1/m."""
    return frozenset((base, -n) for base, n in m)


def divides(a: Monomial, b: Monomial) -> bool:
    """Whether b/a has integer exponents n ≥ 0 for all bases of a."""
    powers = dict(b)
    return all(isinstance(powers.get(base), int) and powers[base] >= n for base, n in a)


def is_below(base: sp.Expr, n: Any) -> bool:
    """Whether baseⁿ is a sum in the denominator: a sum with a rational n < 0."""
    return bool(base.is_Add and is_rational(n) and n < 0)


@lru_cache(maxsize=2**14)
def base_key(base: sp.Expr) -> Any:
    """Return the sort key of a base: symbols first."""
    return not base.is_Symbol, sp.default_sort_key(base)


@lru_cache(maxsize=2**16)
def order(m: Monomial) -> Any:
    """Return the sort key of a monomial: lexicographic, higher powers of the first base first.

    The last entry, (2,), sorts after all bases, so that x² y comes before x².
    """
    pairs = sorted(((base_key(base), n) for base, n in m), key=lambda pair: pair[0])
    return [(key, -n if is_rational(n) else 0) for key, n in pairs] + [((2,), 0)]


# ---------------------------------------------------------------- sums


def add_to(terms: Terms, m: Monomial, a: Number) -> None:
    """Add a term in place; a term with the coefficient 0 is removed."""
    coefficient = terms.get(m, 0) + a
    if coefficient:
        terms[m] = coefficient
    else:
        terms.pop(m, None)


def total_of(*summands: Terms) -> Terms:
    """Return the sum."""
    total = dict(summands[0]) if summands else {}
    for summand in summands[1:]:
        for m, a in summand.items():
            add_to(total, m, a)
    return total


def scale_terms(terms: Terms, factor: Number) -> Terms:
    """Return the terms times a number."""
    return {m: quotient(a * factor, 1) for m, a in terms.items()}


def leading(terms: Terms) -> Monomial | None:
    """Return the first monomial, in ``order``, with integer exponents > 0 only, or None."""
    monomials = [m for m in terms if m and all(isinstance(n, int) and n > 0 for _, n in m)]
    return min(monomials, key=order, default=None)


def term(m: Monomial, a: Number = 1) -> sp.Expr:
    """Return one term as an expression."""
    return sp.Mul(rational(a), *(base**n for base, n in m))


def expression_of(terms: Terms) -> sp.Expr:
    """Return the sum of the terms as an expression."""
    return sp.Add(*(term(m, a) for m, a in terms.items()))


def primitive(e: sp.Expr) -> tuple[Number, sp.Expr]:
    """Return (a, s) with e = a s; s is a sum with coprime integer coefficients.

    SymPy's order of terms decides between s and −s, so that e and −e have the same s.
    """
    if not e.is_Add:
        return 1, e
    content, inner = e.primitive()
    factor = fraction(content)
    return (-factor, -inner) if inner.could_extract_minus_sign() else (factor, inner)
