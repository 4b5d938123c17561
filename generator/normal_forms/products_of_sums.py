"""Sums of a few products of sums, each of symbols of its own, as two rotations make.

    e(a, b) = Σ_k f_k(a) h_k(b)

What belongs to a and what to b is seen from the terms: in all of them the powers of the symbols of
one kind add up to the same number. The products are then a decomposition by rank: h_k are the rows
of the echelon form of the coefficients of e, terms of a by terms of b.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import combinations

import sympy as sp

from .sparse_elimination import Echelon
from .terms import Monomial, Number, Terms, base_key, moves, order

__all__ = ["products_of"]

#: Terms, kinds of symbols and products up to which they are looked for.
_MOST_TERMS, _MOST_KINDS, _MOST_PRODUCTS = 400, 6, 4


def products_of(terms: Terms) -> list[tuple[Terms, Terms]] | None:
    """Return the fewest pairs (f_k, h_k); None where there are none, or too many."""
    if not 4 <= len(terms) <= _MOST_TERMS or not all(isinstance(n, int) for m in terms
                                                     for _, n in m):
        return None
    found = kinds(terms)
    moving = [kind for kind in found if any(map(moves, kind))]
    if len(moving) < 2 or len(found) > _MOST_KINDS:
        return None
    others = [kind for kind in found if kind != moving[0]]
    best: list[tuple[Terms, Terms]] | None = None
    for count in range(len(others)):
        for more in combinations(others, count):
            side = moving[0].union(*more)
            if any(moves(base) for kind in moving for base in kind - side):
                pairs = _decomposition(terms, side)
                if best is None or len(pairs) < len(best):
                    best = pairs
    return best if best is not None and 1 < len(best) <= _MOST_PRODUCTS else None


def kinds(terms: Terms) -> list[frozenset[sp.Expr]]:
    """Return disjoint sets of bases, each with powers that add up to the same in every term."""
    bases = sorted({base for m in terms for base, _ in m}, key=base_key)
    first = dict(next(iter(terms)))
    system: Echelon[sp.Expr] = Echelon(base_key)
    for m in terms:
        powers = dict(m)
        system.add({b: d for b in bases if (d := powers.get(b, 0) - first.get(b, 0))})
    rows = system.reduced()
    found = []
    for free in bases:
        if free not in rows:
            weights = {free: 1} | {pivot: -row[free] for pivot, row in rows.items() if free in row}
            if any(w != 1 for w in weights.values()):
                return []
            found.append(frozenset(weights))
    disjoint = sum(map(len, found)) == len(frozenset().union(*found))
    return found if disjoint else []


def _decomposition(terms: Terms, side: frozenset[sp.Expr]) -> list[tuple[Terms, Terms]]:
    """Return the products for one choice of what belongs to a."""
    by_side: dict[Monomial, dict[Monomial, Number]] = defaultdict(dict)
    for m, a in terms.items():
        own = frozenset(pair for pair in m if pair[0] in side)
        by_side[own][m - own] = a
    system: Echelon[Monomial] = Echelon(order)
    for row in by_side.values():
        system.add(row)
    return [({own: row[pivot] for own, row in by_side.items() if pivot in row}, dict(other))
            for pivot, other in system.reduced().items()]
