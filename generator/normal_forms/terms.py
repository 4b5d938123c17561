"""Sums of terms: rational coefficients, bases and their powers, as dictionaries.

    Σ_i a_i Π_j b_j^n_ij

Bases are symbols, functions, sums in a denominator or a root, numbers under a root. Symbols are
placeholders whose names sort as their indices do, variables (of a run) before parameters.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from fractions import Fraction
from functools import lru_cache
from typing import Any

import sympy as sp

__all__ = ["ONE", "Monomial", "Number", "Terms", "add_to", "base_key", "divides", "expression_of",
           "fraction", "inverse", "is_below", "is_rational", "leading", "merged", "order",
           "placeholder", "plain_exponent", "primitive", "quotient", "rational", "scaled",
           "symbols_in", "term", "total_of", "varies"]

Number = int | Fraction
#: Bases with their exponents: ints, or expressions.
Monomial = frozenset[tuple[sp.Expr, Any]]
Terms = dict[Monomial, Number]

ONE: Monomial = frozenset()


# ---------------------------------------------------------------- symbols


@lru_cache(maxsize=2**16)
def placeholder(at: int, moving: bool, facts: frozenset[tuple[str, bool]]) -> sp.Symbol:
    """Return the placeholder number ``at`` of the variables of a run, or of the parameters.

    Names sort as numbers do, variables first.
    """
    return sp.Symbol(f"_{'x' if moving else 'y'}{at:06}", **dict(facts))


@lru_cache(maxsize=2**16)
def varies(e: sp.Basic) -> bool:
    """Whether an expression in placeholders depends on a variable."""
    if e.is_Symbol:
        return bool(e.name.startswith("_x"))
    return any(map(varies, e.args))


def symbols_in(monomials: Iterable[Monomial]) -> set[sp.Symbol]:
    """Return the symbols in any base or exponent."""
    parts = {e for m in monomials for pair in m for e in pair if not isinstance(e, int)}
    return {x for e in parts for x in e.free_symbols}


# ---------------------------------------------------------------- numbers


def quotient(a: Number, b: Number) -> Number:
    """Return a/b, as an int where it is one."""
    value = Fraction(a) / b
    return int(value) if value.denominator == 1 else value


def fraction(e: sp.Expr) -> Number:
    """Return the exact value of a rational or a decimal."""
    if e.is_Rational:
        return quotient(int(e.p), int(e.q))
    sign, digits, exponent, _ = e._mpf_
    return quotient((-1) ** sign * int(digits) * 2 ** max(int(exponent), 0), 2 ** max(-exponent, 0))


def rational(value: Number) -> sp.Rational:
    """Return a number as an expression."""
    return sp.Rational(value.numerator, value.denominator)


def plain_exponent(n: Any) -> Any:
    """Return an exponent as an int where it is one."""
    return n if isinstance(n, int) or not n.is_Integer else int(n)


def is_rational(n: Any) -> bool:
    """Whether an exponent is a known number."""
    return isinstance(n, int) or bool(n.is_Rational)


# ---------------------------------------------------------------- monomials


def merged(a: Monomial, b: Monomial) -> tuple[Monomial, Number, list[tuple[sp.Expr, int]]]:
    """Return the product of monomials, its number, and the whole powers of sums in it.

    √u √u is the sum u to the power 1, √2 √2 the number 2.
    """
    if not a or not b:
        return a or b, 1, []
    bases, is_plain = _bases(b)
    if is_plain and bases.isdisjoint(_bases(a)[0]):
        return a | b, 1, []  # the set knows the hashes of its pairs
    powers = dict(a)
    value: Number = 1
    sums: list[tuple[sp.Expr, int]] = []
    for base, n in b:
        total = plain_exponent(powers.pop(base, 0) + n)
        if (base.is_Add or base.is_Rational) and is_rational(total):
            whole = math.floor(total)
            if base.is_Rational:
                value = quotient(value * Fraction(fraction(base)) ** whole, 1)
                total = plain_exponent(total - whole)
            elif whole > 0 and not (isinstance(n, int) and n > 0):
                sums.append((base, whole))
                total = plain_exponent(total - whole)
        if total != 0:
            powers[base] = total
    return frozenset(powers.items()), value, sums


@lru_cache(maxsize=2**16)
def _bases(m: Monomial) -> tuple[frozenset[sp.Expr], bool]:
    """Return the bases, and whether each stays as it is in a product without powers of it."""
    return frozenset(base for base, _ in m), all(
        (isinstance(n, int) or not (n.is_Integer or base.is_Add)) and not base.is_Rational
        for base, n in m)


def inverse(m: Monomial) -> Monomial:
    """Return 1/m."""
    return frozenset((base, -n) for base, n in m)


def divides(a: Monomial, b: Monomial) -> bool:
    """Whether b is a multiple of a with powers of the bases of a that are not negative."""
    powers = dict(b)
    return all(isinstance(powers.get(base), int) and powers[base] >= n for base, n in a)


def is_below(base: sp.Expr, n: Any) -> bool:
    """Whether a power is of a sum in the denominator."""
    return bool(base.is_Add and is_rational(n) and n < 0)


@lru_cache(maxsize=2**14)
def base_key(base: sp.Expr) -> Any:
    """Return the key of an order of bases: symbols first."""
    return not base.is_Symbol, sp.default_sort_key(base)


@lru_cache(maxsize=2**16)
def order(m: Monomial) -> Any:
    """Return the key of an order of monomials: the higher power of the first base comes first.

    An absent base comes after every other.
    """
    pairs = sorted(((base_key(base), n) for base, n in m), key=lambda pair: pair[0])
    return [(key, -n if is_rational(n) else 0) for key, n in pairs] + [((2,), 0)]


# ---------------------------------------------------------------- sums


def add_to(made: Terms, m: Monomial, a: Number) -> None:
    """Add a term in place; a term with the coefficient 0 is removed."""
    value = made.get(m, 0) + a
    if value:
        made[m] = value
    else:
        made.pop(m, None)


def total_of(*parts: Terms) -> Terms:
    """Return the sum."""
    made = dict(parts[0]) if parts else {}
    for part in parts[1:]:
        for m, a in part.items():
            add_to(made, m, a)
    return made


def scaled(terms: Terms, factor: Number) -> Terms:
    """Return the terms times a number."""
    return {m: quotient(a * factor, 1) for m, a in terms.items()}


def leading(terms: Terms) -> Monomial | None:
    """Return the first of the monomials with whole powers above zero; None if there is none."""
    found = [m for m in terms if m and all(isinstance(n, int) and n > 0 for _, n in m)]
    return min(found, key=order, default=None)


def term(m: Monomial, a: Number = 1) -> sp.Expr:
    """Return one term as an expression."""
    return sp.Mul(rational(a), *(base**n for base, n in m))


def expression_of(terms: Terms) -> sp.Expr:
    """Return the sum of the terms as an expression."""
    return sp.Add(*(term(m, a) for m, a in terms.items()))


def primitive(e: sp.Expr) -> tuple[Number, sp.Expr]:
    """Return a number and a sum of coprime whole coefficients, whose product is e.

    Of a sum and its negative, SymPy's order of terms chooses one.
    """
    if not e.is_Add:
        return 1, e
    content, inner = e.primitive()
    value = fraction(content)
    return (-value, -inner) if inner.could_extract_minus_sign() else (value, inner)
