"""Products, squares and powers of sums in a sum of terms.

**Products** e(a, b) = Σ_k f_k(a) h_k(b), as two rotations make. In all terms the powers of the
symbols of one kind add up to the same number, which separates a from b. The products are a
rank decomposition: h_k are the rows of the echelon form of the coefficients of e, terms of a by
terms of b.

**Squares** Σ_k a_k (± m_1 ± m_2 …)², as T of a body with numeric moments. A square of a monomial,
a m², belongs to a sum with the number a. A mixed term is 2 a m n with a sign, or a sum of such, as
q_0 q_1 p_0 p_1 = (q_0 p_1)(q_1 p_0) = (q_0 p_0)(q_1 p_1). Where only one choice of signs gives its
coefficient, m and n belong to one sum.

**Powers** of springs, rods and vector potentials:

    a (√u − l)²      in   a u − 2 a l √u + a l²
    a (x − y − l)²   in   a x² − 2 a x y + a y² − 2 a l x + 2 a l y + a l²
    a (x − y)ⁿ       in   its terms, by the binomial coefficients
    a (x + A)²       in   a x² + 2 a x A + a A²

A term such as a y², or the constant, may belong to several powers: each takes its share. No term is
added: H keeps its constant, and its digits.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Mapping
from fractions import Fraction
from itertools import combinations, product
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import sympy as sp

from ..systems.elimination_order import connected
from .terms import (
    ONE,
    Monomial,
    Number,
    Terms,
    add_to,
    base_key,
    divides,
    inverse,
    merged,
    order,
    quotient,
    scaled,
    total_of,
    varies,
)

__all__ = ["Echelon", "Power", "products_of", "split_off_powers", "squares_of"]

Key = TypeVar("Key", bound=Hashable)
#: Most terms, kinds of symbols and products of a product decomposition.
_MOST_TERMS, _MOST_KINDS, _MOST_PRODUCTS = 400, 6, 4


def products_of(terms: Terms) -> list[tuple[Terms, Terms]] | None:
    """Return the fewest pairs (f_k, h_k); None where there are none, or too many."""
    if not 4 <= len(terms) <= _MOST_TERMS or not all(isinstance(n, int) for m in terms
                                                     for _, n in m):
        return None
    found = kinds(terms)
    moving = [kind for kind in found if any(map(varies, kind))]
    if len(moving) < 2 or len(found) > _MOST_KINDS:
        return None
    others = [kind for kind in found if kind != moving[0]]
    best: list[tuple[Terms, Terms]] | None = None
    for count in range(len(others)):
        for more in combinations(others, count):
            side = moving[0].union(*more)
            if any(varies(base) for kind in moving for base in kind - side):
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
    """Return the products for one choice of the symbols of a."""
    by_side: dict[Monomial, dict[Monomial, Number]] = defaultdict(dict)
    for m, a in terms.items():
        own = frozenset(pair for pair in m if pair[0] in side)
        by_side[own][m - own] = a
    system: Echelon[Monomial] = Echelon(order)
    for row in by_side.values():
        system.add(row)
    return [({own: row[pivot] for own, row in by_side.items() if pivot in row}, dict(other))
            for pivot, other in system.reduced().items()]


#: Most squares of monomials, and most products that give one term, of sums of squares.
_MOST_SQUARES, _MOST_ROOT_PAIRS = 64, 3


def squares_of(terms: Terms) -> list[tuple[Number, Terms]] | None:
    """Return numbers a_k and sums whose squares add up to the terms; None if there are none."""
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
    """Return the pairs of roots whose products give a term, with signs; None if no signs do.

    Where several do, none is selected: other terms determine the sums.
    """
    pairs = {frozenset([m, n]) for m in roots if divides(m, t)
             and (n := merged(t, inverse(m))[0]) in roots and roots[n] == roots[m]}
    if len(pairs) > _MOST_ROOT_PAIRS:
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
    """Return the connected sums; the first monomial of each has a positive sign."""
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


if TYPE_CHECKING:
    from .shortest_sum import Compact


Pair = tuple[sp.Expr, sp.Expr]
#: A constant factor, as a term, and a power of a sum.
Power = tuple[tuple[Monomial, Number], sp.Expr]

#: Most terms of a radicand whose root is tried in third and fourth powers.
_LARGEST_LENGTH = 30
_HALF = sp.Rational(1, 2)


def split_off_powers(
    terms: Terms, compact: Compact, momenta: frozenset[sp.Symbol] | None = None
) -> tuple[list[Power], Terms]:
    """Return powers of sums, and the remaining terms.

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
    """Splits powers of sums off terms, one after the other."""

    def __init__(self, left: Terms, compact: Compact) -> None:
        self.left = left
        self.compact = compact
        self.form = compact.form
        self.found: list[Power] = []
        #: Product of variables → the constants it is multiplied by.
        self.stills: dict[Monomial, list[Monomial]] = defaultdict(list)
        for m in left:
            moving, still = compact.split(m)
            self.stills[moving].append(still)

    def _take(
        self, outer: tuple[Monomial, Number], root: Terms, n: int, second: Terms
    ) -> bool:
        """Take a (r + s)ⁿ, where n a s is ``second``, if all but a rⁿ is there.

        The coefficient of rⁿ may be smaller than a, if no new term results.
        """
        m, a = outer
        shift = self.form.product([second, {inverse(m): quotient(1, n * a)}])
        inner = total_of(root, shift)
        terms, first = (self.form.product([{m: a}, *[e] * n]) for e in (inner, root))
        if not all(0 < quotient(b, self.left.get(own, -b)) <= 1 for own, b in terms.items()
                   if own not in first):
            return False
        left = total_of(self.left, scaled(terms, -1))
        if len(left) > len(self.left):
            return False
        self.left = left
        self.found.append((outer, sp.Add(self.compact(root), self.compact(shift)) ** n))
        return True

    def _take_each(self, first: Terms, root: Terms, n: int, second: Terms) -> None:
        """Take a (r + s)ⁿ for each a with a constant n a s, or for all of them."""
        for m in sorted(first, key=order):
            ways = [{b: second[b]} for b in sorted(second, key=order)]
            for way in [*ways, second] if len(ways) > 1 else ways:
                if self._take((m, first[m]), root, n, way):
                    second = {b: c for b, c in second.items() if b not in way}
                    break

    # ------------------------------------------------------------ lengths √u

    def take_lengths(self) -> None:
        """Take powers of lengths plus a constant, a (√u + s)ⁿ."""
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
        """Return the largest number of variable bases in a term of a sum."""
        return max(len(self.compact.split(m)[0]) for m in self.form.terms(base))

    def _in_common(self, u: Terms) -> Terms:
        """Return the constants a of all a·u in the remaining terms.

        Only terms of u with most variables count, as no other sum has them.
        """
        parts = {m: self.compact.split(m) for m in u}
        most = max(len(moving) for moving, _ in parts.values())
        asked = [m for m in u if len(parts[m][0]) == most]
        first = min(asked, key=order)
        found: Terms = {}
        for still in self.stills.get(parts[first][0], ()):
            a = merged(still, inverse(parts[first][1]))[0]
            ratios = [quotient(self.left.get(merged(a, other)[0], 0), u[other]) for other in asked]
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
                        not momenta.isdisjoint(base.free_symbols) for base, _ in rest):
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

        Of a square, a has the sign of x² and y².
        """
        if len(by_power) < n - 1:
            return None
        if n == 2:
            had = [self.left.get(still | {(z, 2)}, 0) for z in pair]
            if had[0] * had[1] <= 0:
                return None
            a = quotient(max(by_power[1], -by_power[1]), 2 if had[0] > 0 else -2)
            return a, 1 if by_power[1] * a > 0 else -1
        sign = 1 if by_power[1] * by_power[2] > 0 else -1
        a = quotient(by_power[1], n * sign)
        exact = all(b == a * math.comb(n, k) * sign**k for k, b in by_power.items())
        return (a, sign) if exact else None

    def _take_group(
        self, still: Monomial, n: int, powers: dict[Pair, tuple[Number, int]]
    ) -> None:
        """Take a (x ± y)ⁿ for all of these coupled pairs, or for none.

        They are taken if fewer terms remain, or if all xⁿ are present: a sum of squares.
        """
        ends: dict[sp.Expr, Number] = defaultdict(lambda: 0)
        for (x, y), (a, sign) in powers.items():
            ends[x] += a
            ends[y] += a * sign**n
        had = {x: self.left.get(still | {(x, n)}, 0) for x in ends}
        after = len(powers) + sum(had[x] != ends[x] for x in ends)
        before = (n - 1) * len(powers) + sum(a != 0 for a in had.values())
        covered = n % 2 == 0 and all(0 < quotient(ends[x], had[x] or -ends[x]) <= 1 for x in ends)
        if after >= before and not covered:
            return
        for (x, y), (a, sign) in powers.items():
            root: Terms = {frozenset([(x, 1)]): 1, frozenset([(y, 1)]): sign}
            if n > 2 or not self._take((still, a), root, 2, self._linear(x, y, sign)):
                whole = self.form.product([{still: -a}, *[root] * n])
                self.left = total_of(self.left, whole)
                self.found.append(((still, a), self.compact(root) ** n))

    def _linear(self, x: sp.Expr, y: sp.Expr, sign: int) -> Terms:
        """Return the first of the constants b of b (x ± y) in the remaining terms."""
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


# ---------------------------------------------------------------- exact elimination


class Echelon(Generic[Key]):
    """Sparse rational vectors in echelon form, each with its combination of the given ones.

    Parameters
    ----------
    order : function
        The key of an order of the entries; the first entry of a vector becomes its pivot.
    """

    def __init__(self, order: Callable[[Key], Any]) -> None:
        self.order = order
        self._rows: list[tuple[Key, dict[Key, Number], dict[int, Number]]] = []

    def _reduce(
        self, vector: Mapping[Key, Number], made_of: Mapping[int, Number]
    ) -> tuple[dict[Key, Number], dict[int, Number]]:
        left, own = dict(vector), dict(made_of)
        for pivot, row, parts in self._rows:
            if pivot in left:
                a = left[pivot]
                _subtract(left, a, row)
                _subtract(own, a, parts)
        return left, own

    def add(self, vector: Mapping[Key, Number]) -> bool:
        """Add a vector; return False if it depends on those before."""
        left, own = self._reduce(vector, {len(self._rows): 1})
        if not left:
            return False
        pivot = min(left, key=self.order)
        a = left[pivot]
        self._rows.append((pivot, {k: quotient(b, a) for k, b in left.items()},
                           {j: quotient(b, a) for j, b in own.items()}))
        return True

    def solve(self, vector: Mapping[Key, Number]) -> dict[int, Number]:
        """Return the coefficients of a dependent vector in the given ones."""
        _, own = self._reduce(vector, {})
        return {j: -a for j, a in own.items()}

    def reduced(self) -> dict[Key, dict[Key, Number]]:
        """Return the reduced echelon form, rows by their pivots."""
        rows: dict[Key, dict[Key, Number]] = {}
        for pivot, row, _ in reversed(self._rows):
            own = dict(row)
            for other, below in rows.items():
                if other in own:
                    _subtract(own, own[other], below)
            rows[pivot] = own
        return {pivot: rows[pivot] for pivot in sorted(rows, key=self.order)}


def _subtract(vector: dict[Any, Number], a: Number, other: Mapping[Any, Number]) -> None:
    for k, b in other.items():
        value = vector.get(k, 0) - a * b
        if value:
            vector[k] = value
        else:
            vector.pop(k, None)
