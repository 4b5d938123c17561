"""Additive terms of H and F: sums of expressions in as few coordinates as possible.

An addend is an expression with its terms. Addends are derived from the terms of H alone, and
compared with those of the given expression, expanded no further than necessary. In each coupled
region, either all derived or all given addends are selected.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence

import sympy as sp

from ..systems.elimination_order import connected
from .canonical_expressions import CanonicalForms, costs_less
from .common_factors import square_root, without_common
from .coordinate_coupling import CoordinateCoupling
from .terms import (
    Monomial,
    Number,
    Terms,
    add_to,
    merged,
    quotient,
    scaled,
    symbols_in,
    term,
    total_of,
    varies,
)

__all__ = ["ForceTerms", "HamiltonianTerms", "Support"]

#: An expression and its terms.
Addend = tuple[sp.Expr, Terms]


class Support:
    """Coordinates and momenta of terms, by their indices, and how H couples them."""

    def __init__(self, q: Sequence[sp.Symbol], p: Sequence[sp.Symbol], H: Terms) -> None:
        self.place = {x: i for symbols in (q, p) for i, x in enumerate(symbols)}
        self.p = frozenset(p)
        self._known: dict[Monomial, tuple[frozenset[int], frozenset[int]]] = {}
        self.coupling = CoordinateCoupling(len(q), map(self, H))

    def __call__(self, m: Monomial) -> tuple[frozenset[int], frozenset[int]]:
        """Return the indices of the momenta in a term, and of its coordinates and momenta."""
        if m not in self._known:
            symbols = symbols_in([m])
            self._known[m] = (frozenset(self.place[x] for x in symbols & self.p),
                              frozenset(self.place[x] for x in symbols if x in self.place))
        return self._known[m]

    def blocks(self, m: Monomial) -> frozenset[int]:
        """Return the blocks of a term."""
        return self.coupling.blocks(self(m)[1])

    def classes(self, m: Monomial) -> frozenset[int]:
        """Return the classes of a term."""
        return self.coupling.classes(self(m)[1])

    def classes_of(self, e: sp.Expr) -> frozenset[int]:
        """Return the classes of an expression."""
        return self.coupling.classes(self.place[x] for x in e.free_symbols if x in self.place)

    def kinetic_block(self, m: Monomial) -> int:
        """Return the kinetic block of a term with momenta."""
        a = min(self(m)[0])
        return self.coupling.kinetic_block_of.get(a, a)


def total(addends: Iterable[Addend]) -> sp.Expr:
    """Return the sum of addends."""
    return sp.Add(*(e for e, _ in addends))


def is_constant(m: Monomial) -> bool:
    """Whether a term is constant during a run."""
    return not any(map(varies, symbols_in([m])))


def split(
    forms: CanonicalForms, e: sp.Expr, is_irreducible: Callable[[Terms], bool]
) -> Iterator[Addend]:
    """Yield the addends of an expression, expanded no further than necessary."""
    for part in sp.Add.make_args(e):
        terms = forms.terms(part)
        sums = [a for a in part.args if a.is_Add] if part.is_Mul else []
        if is_irreducible(terms):
            yield forms.normal_form(part), terms
        elif sums:
            others = [a for a in part.args if a is not sums[0]]
            for a in sums[0].args:
                yield from split(forms, sp.Mul(*others, a), is_irreducible)
        else:
            yield from ((term(m, a), {m: a}) for m, a in terms.items())


class HamiltonianTerms:
    """The additive terms of H."""

    def __init__(
        self, forms: CanonicalForms, q: Sequence[sp.Symbol], p: Sequence[sp.Symbol], H: sp.Expr
    ) -> None:
        self.forms = forms
        self.given = H
        self.terms = total_of(*map(forms.terms, sp.Add.make_args(H)))
        self.support = Support(q, p, self.terms)

    def sum(self) -> sp.Expr:
        """Return H as the sum of its addends."""
        constant = {m: a for m, a in self.terms.items() if is_constant(m)}
        moving = {m: a for m, a in self.terms.items() if m not in constant}
        chosen = [addend for terms, found, given in self._regions(moving)
                  for addend in self._chosen(terms, found, given)]
        for _, terms in chosen:
            for m in filter(is_constant, terms):
                add_to(constant, m, -terms[m])
        return sp.Add(*(e for e, _ in chosen), self.forms.short(constant))

    # ------------------------------------------------------------ found or written

    def _regions(self, moving: Terms) -> Iterator[tuple[Terms, list[Addend], list[Addend]]]:
        """Yield coupled terms, with their derived and their given addends."""
        addends = [self._found(), list(split(self.forms, self.given, self._is_irreducible))]
        nodes = self._nodes(moving)
        touched = [[frozenset(nodes(m) for m in terms if not is_constant(m))
                    for _, terms in side] for side in addends]
        regions = connected(place for side in touched for place in side)
        region_of = {node: i for i, region in enumerate(regions) for node in region}
        terms: list[Terms] = [{} for _ in regions]
        for m, a in moving.items():
            terms[region_of[nodes(m)]][m] = a
        sides: list[tuple[list[Addend], list[Addend]]] = [([], []) for _ in regions]
        for side, (own, places) in enumerate(zip(addends, touched, strict=True)):
            for addend, place in zip(own, places, strict=True):
                if place:
                    sides[region_of[min(place)]][side].append(addend)
        for inside, (found, given) in zip(terms, sides, strict=True):
            yield inside, found, given

    def _nodes(self, moving: Terms) -> Callable[[Monomial], int]:
        """Return a function term → number; coupled terms have the same number."""
        n = len(self.support.p)
        potential = connected(self.support.blocks(m) for m in moving if not self.support(m)[0])
        part_of = {a: n + min(part) for part in potential for a in part}

        def node(m: Monomial) -> int:
            if self.support(m)[0]:
                return self.support.kinetic_block(m)
            a = min(self.support.blocks(m), default=n)
            return part_of.get(a, n + a)

        return node

    def _chosen(self, terms: Terms, found: list[Addend], given: list[Addend]) -> list[Addend]:
        """Return the derived addends, or the given ones if they are equal and cost clearly less."""
        made = total_of(*(part for _, part in given))
        same = {m: a for m, a in made.items() if not is_constant(m)} == terms
        return given if same and costs_less([total(given)], [total(found)]) else found

    def _is_irreducible(self, terms: Terms) -> bool:
        """Whether terms are of one kinetic block at most, and all coupled."""
        kinetic_blocks = {self.support.kinetic_block(m) for m in terms if self.support(m)[0]}
        places = frozenset[int]().union(*(self.support(m)[1] for m in terms))
        return len(kinetic_blocks) <= 1 and self.support.coupling.are_coupled(places)

    # ------------------------------------------------------------ found from terms alone

    def _found(self) -> list[Addend]:
        """Return the addends of H, except a constant."""
        squares, left = self.forms.powers(self.terms, self.support.p)
        addends = [self._with_terms(sp.Mul(term(*outer), power)) for outer, power in squares]
        kinetic: dict[int, Terms] = defaultdict(dict)
        potential: Terms = {}
        constant: Terms = {}
        for m, a in left.items():
            part = kinetic[self.support.kinetic_block(m)] if self.support(m)[0] else (
                constant if is_constant(m) else potential)
            part[m] = a
        addends += [(self.forms.short(part), part) for part in kinetic.values()]
        for part in self._potentials(potential):
            found, constant = self._potential(part, constant)
            addends += found
        return addends

    def _potentials(self, terms: Terms) -> Iterator[Terms]:
        """Yield terms with coupled coordinates, and those of time alone."""
        blocks = {m: self.support.blocks(m) for m in terms}
        together = connected(blocks.values())
        part_of = {a: i for i, part in enumerate(together) for a in part}
        parts: list[Terms] = [{} for _ in range(len(together) + 1)]
        for m, a in terms.items():
            parts[part_of[min(blocks[m])] if blocks[m] else -1][m] = a
        yield from filter(None, parts)

    def _potential(self, terms: Terms, constant: Terms) -> tuple[list[Addend], Terms]:
        """Return the addends of a potential, and the rest of the constant.

        Powers of differences are sought in all terms, other forms in terms of equal support. A
        polynomial is also tried without powers, which is selected if it costs clearly less.
        """
        powers, left = self.forms.powers(total_of(terms, constant))
        together: dict[tuple[Monomial, Number, frozenset[int]], list[sp.Expr]] = defaultdict(list)
        for (still, a), power in powers:
            together[still, a, self.support.classes_of(power)].append(power)
        addends = [self._with_terms(sp.Mul(term(still, a), sp.Add(*own)))
                   for (still, a, _), own in together.items()]
        found = self._bundles(addends, left)
        if powers and all(base.is_Symbol for m in terms for base, _ in m):
            plain = self._bundles([], total_of(terms, constant))
            if costs_less([total(plain[0])], [total(found[0])]):
                return plain
        return found

    def _bundles(self, addends: list[Addend], left: Terms) -> tuple[list[Addend], Terms]:
        """Return the addends, with those of all other terms, and the rest of the constant."""
        bundles: dict[Hashable, Terms] = defaultdict(dict)
        constant = {m: a for m, a in left.items() if is_constant(m)}
        for m, a in left.items():
            if m not in constant:
                bundles[self.support.classes(m)][m] = a
        for bundle in bundles.values():
            for part in self._split_linear(bundle):
                addend, constant = self._bundle(part, constant)
                addends.append(addend)
        return addends, constant

    def _split_linear(self, terms: Terms) -> list[Terms]:
        """Return linear terms by blocks, as weights are, and the rest.

        Linear terms stay with other terms of their block, unless these are the square of a sum.
        """
        blocks = {m: self.support.blocks(m) for m in terms}
        bent = {m: a for m, a in terms.items() if not self._is_linear(m)}
        is_square = bool(bent) and not square_root(without_common(bent)[2])[1]
        kept = frozenset[int]().union(*(blocks[m] for m in bent if not is_square))
        parts: dict[frozenset[int], Terms] = defaultdict(dict)
        for m, a in terms.items():
            parts[frozenset() if m in bent or blocks[m] & kept else blocks[m]][m] = a
        return list(parts.values())

    def _is_linear(self, m: Monomial) -> bool:
        return [(x.is_Symbol, n) for x, n in self.forms.compact.split(m)[0]] == [(True, 1)]

    def _bundle(self, terms: Terms, constant: Terms) -> tuple[Addend, Terms]:
        """Return the addend of terms of the same coordinates, completed to a square if possible."""
        outer, value, inner = without_common(terms)
        root, left = square_root(inner)
        needed = {merged(outer, m)[0]: -a * value for m, a in left.items()}
        if root and all(0 < quotient(a, constant.get(m, -a)) <= 1 for m, a in needed.items()):
            e = sp.Mul(term(outer, value), self.forms.short(root) ** 2)
            return (e, total_of(terms, needed)), total_of(constant, scaled(needed, -1))
        return (self.forms.short(terms), terms), constant

    def _with_terms(self, e: sp.Expr) -> Addend:
        return e, self.forms.terms(e)


class ForceTerms:
    """The additive terms of the rows of F, by classes of coordinates."""

    def __init__(
        self, forms: CanonicalForms, support: Support, given: Sequence[sp.Expr]
    ) -> None:
        self.forms = forms
        self.support = support
        self.given = given

    def rows(self) -> list[sp.Expr]:
        """Return each row as the sum of its addends.

        One choice serves all rows, as they have subexpressions in common.
        """
        found: dict[Hashable, dict[int, Terms]] = defaultdict(lambda: defaultdict(dict))
        given: dict[Hashable, dict[int, list[Addend]]] = defaultdict(lambda: defaultdict(list))
        for row, e in enumerate(self.given):
            for m, a in total_of(*map(self.forms.terms, sp.Add.make_args(e))).items():
                found[self.support.classes(m)][row][m] = a
            for addend in split(self.forms, e, self._is_irreducible):
                if addend[1]:
                    given[self.support.classes(next(iter(addend[1])))][row].append(addend)
        made: list[list[sp.Expr]] = [[] for _ in self.given]
        for key, parts in found.items():
            for row, e in zip(parts, self._chosen(parts, given[key]), strict=True):
                made[row].append(e)
        return [sp.Add(*addends) for addends in made]

    def _chosen(
        self, parts: dict[int, Terms], given: dict[int, list[Addend]]
    ) -> Iterable[sp.Expr]:
        short = [self.forms.short(part) for part in parts.values()]
        kept = [total(given[row]) for row in parts]
        same = all(total_of(*(terms for _, terms in given[row])) == part
                   for row, part in parts.items())
        return kept if same and costs_less(kept, short) else short

    def _is_irreducible(self, terms: Terms) -> bool:
        return len(set(map(self.support.classes, terms))) <= 1
