"""Bounds of the size of an expanded or factored expression.

Expansion and factoring only make formulas shorter; they are skipped if they would take long. Few
characters can have billions of terms: ((x + y + 1)**9 + z)**9.
"""

from __future__ import annotations

import math
from functools import lru_cache

import sympy as sp

from .polynomials import expanded_polynomial

__all__ = ["can_be_factored", "expand_if_short", "is_small"]

#: Largest number of symbols of an expanded expression.
MAX_SYMBOLS = 20_000
#: Largest number of terms of the numerator over a common denominator.
MAX_NUMERATOR_TERMS = 1000


def expand_if_short(e: sp.Expr) -> sp.Expr:
    """Return the expanded expression; a long one unchanged."""
    if not is_small(e):
        return e
    polynomial = expanded_polynomial(e)
    return sp.expand(e) if polynomial is None else polynomial


def is_small(e: sp.Expr) -> bool:
    """Whether an expression is short enough to be expanded."""
    terms, length = _expanded_size(e)
    return terms * length <= MAX_SYMBOLS


def can_be_factored(e: sp.Expr) -> bool:
    """Whether an expression is a ratio of polynomials that are short enough to be factored."""
    if e.is_polynomial(*e.free_symbols):
        return is_small(e)
    if not is_small(e) or not e.is_rational_function():
        return False
    denominators = {power.base for power in e.atoms(sp.Pow) if power.exp.is_negative}
    term_counts = [terms for terms, _ in map(_expanded_size, (e, *denominators))]
    return math.prod(term_counts) <= MAX_NUMERATOR_TERMS


@lru_cache(maxsize=2**14)
def _expanded_size(e: sp.Expr) -> tuple[int, int]:
    """Return bounds of the number of terms of the expansion, and of the symbols of a term.

    Denominators, radicands and arguments are expanded, too, and are parts of one term. Both numbers
    are truncated to ``MAX_SYMBOLS + 1``.
    """
    if e.is_Atom:
        return 1, 1
    sizes = [_expanded_size(argument) for argument in e.args]
    if e.is_Add:
        return _saturate(sum(t for t, _ in sizes)), max(length for _, length in sizes)
    if e.is_Mul:
        return _saturate(math.prod(t for t, _ in sizes)), _saturate(sum(length for _,
                                                                        length in sizes))
    if e.is_Pow and e.exp.is_Rational:
        base_terms, base_length = sizes[0]
        n = math.ceil(abs(e.exp))
        # (x_1 + … + x_t)ⁿ has C(t + n − 1, n) terms; beyond n = 200 the number itself takes long
        terms = _saturate(math.comb(base_terms + n - 1, n)) if n <= 200 else MAX_SYMBOLS + 1
        length = _saturate(base_length * n)
        is_expanded = e.exp.is_Integer and e.exp > 0
        return (terms, length) if is_expanded else (1, _saturate(terms * length))
    return 1, _saturate(sum(t * length for t, length in sizes))


def _saturate(count: int) -> int:
    """Return a count up to the limit: products of larger ones would be numbers of many digits."""
    return min(count, MAX_SYMBOLS + 1)
