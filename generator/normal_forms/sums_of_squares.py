"""Sums of squares Σ_k a_k (± m_1 ± m_2 …)², such as T of a body whose moments are numbers.

Each square of a monomial, a m², says in which of the sums m is: one with the number a. A mixed term
then is 2a m n with a sign, or a sum of such, as of q_0 q_1 p_0 p_1 = (q_0 p_1)(q_1 p_0) =
(q_0 p_0)(q_1 p_1): where only one choice of signs makes its coefficient, it joins m and n.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import product

from .terms import Monomial, Number, Terms, add_to, divides, inverse, merged, order

__all__ = ["squares_of"]

#: Squares of monomials, and products that make one term, up to which sums are looked for.
_MOST_SQUARES, _MOST_PRODUCTS = 64, 3


def squares_of(terms: Terms) -> list[tuple[Number, Terms]] | None:
    """Return the numbers a_k and the sums whose squares make the terms; None if there are none."""
    if not all(isinstance(n, int) and n > 0 for m in terms for _, n in m):
        return None
    roots = {frozenset((base, n // 2) for base, n in m): a for m, a in terms.items()
             if not any(n % 2 for _, n in m)}
    if not roots or len(roots) > _MOST_SQUARES or len(roots) == len(terms):
        return None
    joined: dict[Monomial, list[tuple[Monomial, int]]] = defaultdict(list)
    for t, a in terms.items():
        if any(n % 2 for _, n in t):
            signs = _signs(t, a, roots)
            if signs is None:
                return None
            for (m, n), sign in signs:
                joined[m].append((n, sign))
                joined[n].append((m, sign))
    sums = _sums(roots, joined)
    left = dict(terms)
    for a, root in sums:
        for m, b in root.items():
            for n, c in root.items():
                add_to(left, merged(m, n)[0], -a * b * c)
    return None if left else sums


def _signs(
    t: Monomial, a: Number, roots: dict[Monomial, Number]
) -> list[tuple[tuple[Monomial, Monomial], int]] | None:
    """Return the pairs of roots whose products make a term, with signs; None if no signs do.

    Where several do, none is chosen: what belongs together is joined by other terms.
    """
    pairs = {frozenset([m, n]) for m in roots if divides(m, t)
             and (n := merged(t, inverse(m))[0]) in roots and roots[n] == roots[m]}
    if len(pairs) > _MOST_PRODUCTS:
        return None
    ordered = sorted((tuple(sorted(pair, key=order)) for pair in pairs),
                     key=lambda pair: tuple(map(order, pair)))
    found = [signs for signs in product((-1, 0, 1), repeat=len(ordered))
             if sum(2 * s * roots[m] for s, (m, _) in zip(signs, ordered, strict=True)) == a]
    if len(found) != 1:
        return [] if found else None
    return [((m, n), s) for (m, n), s in zip(ordered, found[0], strict=True) if s]


def _sums(
    roots: dict[Monomial, Number], joined: dict[Monomial, list[tuple[Monomial, int]]]
) -> list[tuple[Number, Terms]]:
    """Return the sums that the joints make, the sign of the first monomial of each above zero."""
    found: list[tuple[Number, Terms]] = []
    seen: set[Monomial] = set()
    for first in sorted(roots, key=order):
        if first in seen:
            continue
        signs: Terms = {first: 1}
        waiting = [first]
        while waiting:
            m = waiting.pop()
            for n, sign in joined[m]:
                if n not in signs:
                    signs[n] = sign * signs[m]
                    waiting.append(n)
        seen |= signs.keys()
        found.append((roots[first], signs))
    return found
