"""Powers of sums in a sum of terms, as springs, rods and vector potentials have them.

    a (√u − l)²      in   a u − 2 a l √u + a l²
    a (x − y − l)²   in   a x² − 2 a x y + a y² − 2 a l x + 2 a l y + a l²
    a (x − y)ⁿ       in   its terms, by the binomial coefficients
    a (x + A)²       in   a x² + 2 a x A + a A²

A term such as a y², or the constant, may belong to several of them: of each as much is taken as it
needs. What is not there is not made up: H keeps its constant, and its digits.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from fractions import Fraction
from typing import TYPE_CHECKING

import sympy as sp

from ..systems.elimination_order import connected
from .terms import (
    ONE,
    Monomial,
    Number,
    Terms,
    base_key,
    inverse,
    merged,
    order,
    over,
    plus,
    scaled,
)

if TYPE_CHECKING:
    from .shortest_sum import Compact

__all__ = ["Power", "split_off_powers"]

Pair = tuple[sp.Expr, sp.Expr]
#: A constant factor, as a term, and a power of a sum.
Power = tuple[tuple[Monomial, Number], sp.Expr]

#: Terms under a root up to which its third and fourth power are looked for.
_LARGEST_LENGTH = 30
_HALF = sp.Rational(1, 2)


def split_off_powers(
    terms: Terms, compact: Compact, momenta: frozenset[sp.Symbol] | None = None
) -> tuple[list[Power], Terms]:
    """Return powers of sums, and the terms that are left.

    If momenta are given, these are squares a (p + A(q))² and nothing else.
    """
    finder = _Finder(dict(terms), compact)
    if momenta is None:
        finder.take_lengths()
        finder.take_pairs()
        finder.take_shifted()
    else:
        finder.take_completed(momenta)
    return finder.found, finder.left


class _Finder:
    """Takes powers of sums out of terms, one after the other."""

    def __init__(self, left: Terms, compact: Compact) -> None:
        self.left = left
        self.compact = compact
        self.form = compact.form
        self.found: list[Power] = []
        #: What moves → the constants it is multiplied with.
        self.stills: dict[Monomial, list[Monomial]] = defaultdict(list)
        for m in left:
            moving, still = compact.split(m)
            self.stills[moving].append(still)

    def _take(
        self, outer: tuple[Monomial, Number], root: Terms, n: int, second: Terms
    ) -> bool:
        """Take a (r + s)ⁿ, where n a s is ``second``, if all but a rⁿ is there.

        Of a rⁿ less may be there than it takes, if no term is made up for it.
        """
        m, a = outer
        shift = self.form.product([second, {inverse(m): over(1, n * a)}])
        inner = plus(root, shift)
        terms, first = (self.form.product([{m: a}, *[e] * n]) for e in (inner, root))
        if not all(0 < over(b, self.left.get(own, -b)) <= 1 for own, b in terms.items()
                   if own not in first):
            return False
        left = plus(self.left, scaled(terms, -1))
        if len(left) > len(self.left):
            return False
        self.left = left
        self.found.append((outer, sp.Add(self.compact(root), self.compact(shift)) ** n))
        return True

    def _take_each(self, first: Terms, root: Terms, n: int, second: Terms) -> None:
        """Take a (r + s)ⁿ for each a that one of the constants n a s belongs to, or all of them."""
        for m in sorted(first, key=order):
            ways = [{b: second[b]} for b in sorted(second, key=order)]
            for way in [*ways, second] if len(ways) > 1 else ways:
                if self._take((m, first[m]), root, n, way):
                    second = {b: c for b, c in second.items() if b not in way}
                    break

    # ------------------------------------------------------------ lengths √u

    def take_lengths(self) -> None:
        """Take powers of lengths less a constant, a (√u + s)ⁿ."""
        sums = {base for m in self.left for base, n in m if base.is_Add and n == _HALF}
        for base in sorted(sums, key=lambda base: (-self._most(base), base_key(base))):
            root: Terms = {frozenset([(base, _HALF)]): 1}
            powers: list[Terms] = [{ONE: 1}, root]
            highest = 4 if len(self.form.terms(base)) <= _LARGEST_LENGTH else 2
            for _ in range(highest - 1):
                powers.append(self.form.product([powers[-1], root]))
            for n in range(highest, 1, -1):
                first, second = (self._in_common(powers[k]) for k in (n, n - 1))
                self._take_each(first, root, n, second)

    def _most(self, base: sp.Expr) -> int:
        """Return how many moving bases a term of a sum has at the most."""
        return max(len(self.compact.split(m)[0]) for m in self.form.terms(base))

    def _in_common(self, u: Terms) -> Terms:
        """Return the constants a of all a·u in what is left: for each of its terms there is one.

        Of the terms of u those that depend on most are asked, which no other sum has.
        """
        parts = {m: self.compact.split(m) for m in u}
        most = max(len(moving) for moving, _ in parts.values())
        asked = [m for m in u if len(parts[m][0]) == most]
        first = min(asked, key=order)
        found: Terms = {}
        for still in self.stills.get(parts[first][0], ()):
            a = merged(still, inverse(parts[first][1]))[0]
            ratios = [over(self.left.get(merged(a, other)[0], 0), u[other]) for other in asked]
            if all(r > 0 for r in ratios) or all(r < 0 for r in ratios):
                found[a] = smaller(*ratios)
        return found

    # ------------------------------------------------------------ squares of p + A

    def take_completed(self, momenta: frozenset[sp.Symbol]) -> None:
        """Take a (p + A)², where A depends on no momenta."""
        own: dict[sp.Symbol, list[Monomial]] = defaultdict(list)
        for m in self.left:
            for x in {x for base, _ in m for x in base.free_symbols & momenta}:
                own[x].append(m)
        for x in sorted(own, key=base_key):
            square: Terms = {}
            linear: Terms = {}
            for m in own[x]:
                rest = frozenset(pair for pair in m if pair[0] != x)
                kind = {1: linear, 2: square}.get(dict(m).get(x, 0))
                if kind is None or m not in self.left or any(
                        base.has(*momenta) for base, _ in rest):
                    break
                kind[rest] = self.left[m]
            else:
                still, a = next(iter(square.items()), (ONE, 0))
                if len(square) == 1 and not self.compact.split(still)[0] and any(
                        self.compact.split(m)[0] for m in linear):
                    self._take((still, a), {frozenset([(x, 1)]): 1}, 2, linear)

    # ------------------------------------------------------------ powers of x ± y

    def take_pairs(self) -> None:
        """Take powers of sums and differences of two bases."""
        mixed: dict[tuple[Monomial, int], dict[Pair, dict[int, Number]]]
        mixed = defaultdict(lambda: defaultdict(dict))
        for m, a in self.left.items():
            moving, still = self.compact.split(m)
            if len(moving) == 2 and all(isinstance(n, int) and n > 0 for _, n in moving):
                (x, n), (y, k) = sorted(moving, key=lambda pair: base_key(pair[0]))
                mixed[still, n + k][x, y][k] = a
        for still, n in sorted(mixed, key=lambda key: (key[1], order(key[0]))):
            found = {pair: self._power_of(still, n, pair, by_power)
                     for pair, by_power in mixed[still, n].items()}
            for group in _connected(found):
                powers = {pair: power for pair in group if (power := found[pair])}
                if len(powers) == len(group):
                    self._take_group(still, n, powers)

    def _power_of(
        self, still: Monomial, n: int, pair: Pair, by_power: dict[int, Number]
    ) -> tuple[Number, int] | None:
        """Return a and ± of a (x ± y)ⁿ with these mixed terms; None if there is none.

        Of a square, a has the sign that x² and y² have.
        """
        if len(by_power) < n - 1:
            return None
        if n == 2:
            had = [self.left.get(still | {(z, 2)}, 0) for z in pair]
            if had[0] * had[1] <= 0:
                return None
            a = over(max(by_power[1], -by_power[1]), 2 if had[0] > 0 else -2)
            return a, 1 if by_power[1] * a > 0 else -1
        sign = 1 if by_power[1] * by_power[2] > 0 else -1
        a = over(by_power[1], n * sign)
        exact = all(b == a * math.comb(n, k) * sign**k for k, b in by_power.items())
        return (a, sign) if exact else None

    def _take_group(
        self, still: Monomial, n: int, powers: dict[Pair, tuple[Number, int]]
    ) -> None:
        """Take a (x ± y)ⁿ for all of these pairs, which hang together, or for none.

        They are taken if that makes less terms, or if all xⁿ are there: then each is a sum of
        squares.
        """
        ends: dict[sp.Expr, Number] = defaultdict(lambda: 0)
        for (x, y), (a, sign) in powers.items():
            ends[x] += a
            ends[y] += a * sign**n
        had = {x: self.left.get(still | {(x, n)}, 0) for x in ends}
        after = len(powers) + sum(had[x] != ends[x] for x in ends)
        before = (n - 1) * len(powers) + sum(a != 0 for a in had.values())
        covered = n % 2 == 0 and all(0 < over(ends[x], had[x] or -ends[x]) <= 1 for x in ends)
        if after >= before and not covered:
            return
        for (x, y), (a, sign) in powers.items():
            root: Terms = {frozenset([(x, 1)]): 1, frozenset([(y, 1)]): sign}
            if n > 2 or not self._take((still, a), root, 2, self._linear(x, y, sign)):
                whole = self.form.product([{still: -a}, *[root] * n])
                self.left = plus(self.left, whole)
                self.found.append(((still, a), self.compact(root) ** n))

    def _linear(self, x: sp.Expr, y: sp.Expr, sign: int) -> Terms:
        """Return the first of the constants b of b (x ± y) in what is left."""
        for still in sorted(self.stills.get(frozenset([(x, 1)]), ()), key=order):
            b, c = (self.left.get(still | {(z, 1)}, 0) for z in (x, y))
            if b * c * sign > 0:
                return {still: smaller(b, c * sign)}
        return {}

    # ------------------------------------------------------------ squares of x + s

    def take_shifted(self) -> None:
        """Take squares a (x + s)² of one base and a constant."""
        for moving in sorted(self.stills, key=order):
            base, n = next(iter(moving), (None, 0))
            if len(moving) == 1 and n == 2:
                root: Terms = {frozenset([(base, 1)]): 1}
                linear, square = (
                    {still: self.left[own] for still in self.stills.get(frozenset([(base, k)]), ())
                     if (own := still | {(base, k)}) in self.left} for k in (1, 2))
                self._take_each(square, root, 2, linear)


def smaller(*numbers: Number) -> Number:
    """Return the number that is closest to zero."""
    return min(numbers, key=lambda a: Fraction(max(a, -a)))


def _connected(pairs: Iterable[Pair]) -> list[list[Pair]]:
    """Return pairs in groups that share bases, in order."""
    ordered = sorted(pairs, key=lambda pair: tuple(map(base_key, pair)))
    place: dict[sp.Expr, int] = {}
    for pair in ordered:
        for base in pair:
            place.setdefault(base, len(place))
    groups = connected(frozenset(map(place.__getitem__, pair)) for pair in ordered)
    group_of = {a: i for i, group in enumerate(groups) for a in group}
    found: list[list[Pair]] = [[] for _ in groups]
    for pair in ordered:
        found[group_of[place[pair[0]]]].append(pair)
    return found
