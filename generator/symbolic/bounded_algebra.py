"""Multiplying out and factoring, given up where they would take longer than they are worth.

Both only make formulas shorter. What a user writes may have few characters and billions of terms:
((x + y + 1)**9 + z)**9.
"""

from __future__ import annotations

import math
from functools import lru_cache

import sympy as sp

__all__ = ["can_be_factored", "expanded", "is_small"]

#: Most symbols of the expanded expression.
MOST = 20_000
#: Terms of the numerator, were everything brought to one denominator.
MOST_OVER_COMMON = 1000


def expanded(e: sp.Expr) -> sp.Expr:
    """Return the expression multiplied out; as it is where that is too long."""
    return sp.expand(e) if is_small(e) else e


def is_small(e: sp.Expr) -> bool:
    """Whether an expression is short enough to be multiplied out."""
    terms, length = _size(e)
    return terms * length <= MOST


def can_be_factored(e: sp.Expr) -> bool:
    """Whether an expression is a ratio of polynomials that are short enough to be factored."""
    if e.is_polynomial(*e.free_symbols):
        return is_small(e)
    if not is_small(e) or not e.is_rational_function():
        return False
    denominators = {power.base for power in e.atoms(sp.Pow) if power.exp.is_negative}
    common = math.prod(_size(d)[0] for d in denominators)
    return common * _size(e)[0] <= MOST_OVER_COMMON


@lru_cache(maxsize=2**14)
def _size(e: sp.Expr) -> tuple[int, int]:
    """Bound how many terms there would be, and how many symbols the longest of them would have.

    What stands under a power bar −1, in a root or a function is multiplied out inside one symbol.
    Numbers beyond ``MOST`` mean no more than that: they are cut off.
    """
    if e.is_Atom:
        return 1, 1
    parts = [_size(argument) for argument in e.args]
    if e.is_Add:
        return _cut(sum(t for t, _ in parts)), max(length for _, length in parts)
    if e.is_Mul:
        return _cut(math.prod(t for t, _ in parts)), _cut(sum(length for _, length in parts))
    if e.is_Pow and e.exp.is_Rational:
        terms, length = parts[0]
        n = math.ceil(abs(e.exp))
        power = _cut(math.comb(terms + n - 1, n)) if n <= 200 else MOST + 1, _cut(length * n)
        return power if e.exp.is_Integer and e.exp > 0 else (1, _cut(power[0] * power[1]))
    return 1, _cut(sum(t * length for t, length in parts))


def _cut(number: int) -> int:
    return min(number, MOST + 1)
