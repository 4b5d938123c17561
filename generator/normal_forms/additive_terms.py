"""Additive terms of H and F: sums of expressions in as few coordinates as possible.

An addend is an expression with its terms. ``derived`` addends are computed from the expanded terms
of H alone; ``original`` addends are the summands of the user's expression, expanded no further
than necessary. For each set of coupled terms, the cheaper of the two is selected.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import sympy as sp

from ..symbolic.shared_subexpressions import substitute, symbols_of
from ..systems.elimination_order import connected_components
from .canonical_expressions import CanonicalForms, costs_less, local_names
from .common_factors import square_root, without_common
from .coordinate_coupling import CoordinateCoupling, IndexSet
from .terms import (
    Monomial,
    Number,
    Terms,
    add_to,
    multiply_monomials,
    quotient,
    scale_terms,
    symbols_in,
    term,
    total_of,
    varies,
)

__all__ = ["ForceTerms", "HamiltonianTerms", "Support"]


class Addend(NamedTuple):
    """A summand of H or of a row of F."""

    expression: sp.Expr
    terms: Terms


class LocalForm(NamedTuple):
    """Expressions with symbols named by their order, equal for equal joints of a chain.

    ``key`` has the expressions and the places in ``classes`` of the classes of their variables.
    """

    key: Hashable
    renaming: dict[sp.Symbol, sp.Symbol]
    classes: list[int]


class Indices(NamedTuple):
    """Indices of the momenta in a term, and of its coordinates and momenta together."""

    p: IndexSet
    q_and_p: IndexSet


class Support:
    """Indices of the coordinates and momenta in a term, and the coupling of coordinates in H."""

    def __init__(self, q: Sequence[sp.Symbol], p: Sequence[sp.Symbol], terms: Iterable[Monomial],
                 others: Iterable[tuple[IndexSet, IndexSet]] = ()) -> None:
        """Number the coordinates and momenta; terms of H, and ``others`` by indices, couple them.
        """
        self.index_of = {x: i for symbols in (q, p) for i, x in enumerate(symbols)}
        self.p = frozenset(p)
        self._indices: dict[Monomial, Indices] = {}
        self.coupling = CoordinateCoupling(len(q), [*map(self, terms), *others])

    def __call__(self, m: Monomial) -> Indices:
        """Return the indices of the coordinates and momenta in a term."""
        if m not in self._indices:
            symbols = symbols_in([m])
            self._indices[m] = Indices(
                frozenset(self.index_of[x] for x in symbols & self.p),
                frozenset(self.index_of[x] for x in symbols if x in self.index_of))
        return self._indices[m]

    def blocks(self, m: Monomial) -> frozenset[int]:
        """Return the blocks of a term."""
        return self.coupling.blocks(self(m).q_and_p)

    def classes(self, m: Monomial) -> frozenset[int]:
        """Return the classes of a term."""
        return self.coupling.classes(self(m).q_and_p)

    def classes_of(self, e: sp.Expr) -> frozenset[int]:
        """Return the classes of an expression."""
        return self.coupling.classes(self.index_of[x] for x in e.free_symbols if x in self.index_of)

    def kinetic_block(self, m: Monomial) -> int:
        """Return the kinetic block of a term with momenta."""
        a = min(self(m).p)
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
    """Yield the addends of an expression: (a + b) c as it is, or as a c and b c.

    An addend stays whole if its expanded terms are irreducible (``is_irreducible``). Else the first
    sum among its factors is expanded; without one each of its terms is an addend.
    """
    for addend in sp.Add.make_args(e):
        terms = forms.terms(addend)
        sums = [a for a in addend.args if a.is_Add] if addend.is_Mul else []
        if is_irreducible(terms):
            yield Addend(forms.normal_form(addend), terms)
        elif sums:  # a product with a sum: only its first sum is expanded
            other_factors = [a for a in addend.args if a is not sums[0]]
            for a in sums[0].args:
                yield from split(forms, sp.Mul(*other_factors, a), is_irreducible)
        else:
            yield from (Addend(term(m, a), {m: a}) for m, a in terms.items())


class HamiltonianTerms:
    """The additive terms of H."""

    def __init__(
        self, forms: CanonicalForms, q: Sequence[sp.Symbol], p: Sequence[sp.Symbol], H: sp.Expr
    ) -> None:
        """Expand H into its terms, monomial → coefficient."""
        self.forms = forms
        self.H = H
        self.terms = total_of(*map(forms.terms, sp.Add.make_args(H)))
        self.support = Support(q, p, self.terms)

    @property
    def constant(self) -> Terms:
        """The terms that are constant during a run."""
        return {m: a for m, a in self.terms.items() if is_constant(m)}

    @cached_property
    def sum(self) -> sp.Expr:
        """H as the sum of its addends."""
        constant = self.constant
        varying = {m: a for m, a in self.terms.items() if m not in constant}
        addends = [addend for terms, derived, original in self._regions(varying)
                   for addend in self._select(terms, derived, original)]
        # squares contain shares of the constant: only the remainder is added
        for _, terms in addends:
            for m in filter(is_constant, terms):
                add_to(constant, m, -terms[m])
        return sp.Add(*(e for e, _ in addends), self.forms.short(constant))

    # ------------------------------------------------------------ derived or original addends

    def _regions(self, varying: Terms) -> Iterator[tuple[Terms, list[Addend], list[Addend]]]:
        """Yield coupled terms, with their derived and their original addends.

        An addend, derived or original, that contains terms of two regions joins them.
        """
        derived = self._derived_addends()
        original = list(split(self.forms, self.H, self._is_irreducible))
        set_of = self._coupled_sets(varying)

        def sets_of(addend: Addend) -> frozenset[int]:
            """Return the coupled sets of the terms of an addend; a constant has none."""
            return frozenset(set_of(m) for m in addend.terms if not is_constant(m))

        # derived and original addends of a region have the same terms, and can be compared
        regions = connected_components(map(sets_of, [*derived, *original]))
        region_of = {number: i for i, region in enumerate(regions) for number in region}
        terms: list[Terms] = [{} for _ in regions]
        for m, a in varying.items():
            terms[region_of[set_of(m)]][m] = a

        def by_region(addends: Iterable[Addend]) -> list[list[Addend]]:
            """Return the addends of each region; constants belong to none."""
            addends_of: list[list[Addend]] = [[] for _ in regions]
            for addend in addends:
                sets = sets_of(addend)
                if sets:  # all of them are of one region, as the addend joins them
                    addends_of[region_of[min(sets)]].append(addend)
            return addends_of

        yield from zip(terms, by_region(derived), by_region(original), strict=True)

    def _coupled_sets(self, varying: Terms) -> Callable[[Monomial], int]:
        """Return a function of the terms that vary: the number of the coupled set of a term.

        A term with momenta is in the set of its kinetic block, numbered below n. Terms of the
        potential are in one set if they have blocks in common, directly or through others; these
        sets have the numbers n + the least block, and terms in time alone the number 2 n.
        """
        n = len(self.support.p)
        groups = connected_components(self.support.blocks(m) for m in varying
                                      if not self.support(m).p)
        group_of_block = {block: min(group) for group in groups for block in group}

        def set_of(m: Monomial) -> int:
            """Return the number of the coupled set of a term."""
            if self.support(m).p:
                return self.support.kinetic_block(m)
            block = min(self.support.blocks(m), default=n)
            return n + group_of_block.get(block, block)

        return set_of

    def _select(self, terms: Terms, derived: list[Addend], original: list[Addend]) -> list[Addend]:
        """Return the derived addends, or the original ones if these are equal and clearly cheaper.

        Original addends that were not expanded may not add up to the terms: then they are useless.
        """
        original_terms = total_of(*(addend_terms for _, addend_terms in original))
        is_equal = {m: a for m, a in original_terms.items() if not is_constant(m)} == terms
        return original if is_equal and costs_less([total(original)], [total(derived)]) else derived

    def _is_irreducible(self, terms: Terms) -> bool:
        """Whether the terms belong to at most one kinetic block and are all coupled."""
        kinetic_blocks = {self.support.kinetic_block(m) for m in terms if self.support(m).p}
        places = frozenset[int]().union(*(self.support(m).q_and_p for m in terms))
        return len(kinetic_blocks) <= 1 and self.support.coupling.are_coupled(places)

    # ------------------------------------------------------------ addends derived from the terms

    def _derived_addends(self) -> list[Addend]:
        """Return the addends of H: kinetic energies a (p + A)², other kinetic terms, potentials.

        The constant of H is omitted, except the shares that complete squares of a potential.
        """
        squares, remainder = self.forms.powers(self.terms, self.support.p)
        addends = [self._as_addend(sp.Mul(term(*outer), power)) for outer, power in squares]
        kinetic: dict[int, Terms] = defaultdict(dict)
        potential: Terms = {}
        constant: Terms = {}
        for m, a in remainder.items():
            if self.support(m).p:
                kinetic[self.support.kinetic_block(m)][m] = a
            elif is_constant(m):
                constant[m] = a
            else:
                potential[m] = a
        addends += [Addend(self.forms.short(terms), terms) for terms in kinetic.values()]
        # each potential takes a share of the constant, and leaves the others to the next
        for terms in self._coupled_potentials(potential):
            potential_addends, constant = self._potential_addends(terms, constant)
            addends += potential_addends
        return addends

    def _coupled_potentials(self, terms: Terms) -> Iterator[Terms]:
        """Yield the terms of each set of coupled coordinates, then the terms in time alone."""
        blocks = {monomial: self.support.blocks(monomial) for monomial in terms}
        groups = connected_components(blocks.values())
        group_of = {block: i for i, group in enumerate(groups) for block in group}
        # the last one is for terms in time alone, which no coordinate is in
        potentials: list[Terms] = [{} for _ in range(len(groups) + 1)]
        for monomial, coefficient in terms.items():
            group = group_of[min(blocks[monomial])] if blocks[monomial] else -1
            potentials[group][monomial] = coefficient
        yield from filter(None, potentials)

    def _potential_addends(self, terms: Terms, constant: Terms) -> tuple[list[Addend], Terms]:
        """Return the addends of a potential, and the part of ``constant`` not used by them.

        Powers of differences are sought in all terms, other forms in terms of equal support. A
        polynomial is also tried without powers, which is selected if it costs clearly less.
        """
        powers, remainder = self.forms.powers(total_of(terms, constant))
        # k (r_1² + r_2²) in place of k r_1² + k r_2²: equal factors of equal classes of coordinates
        by_factor: dict[tuple[Monomial, Number, frozenset[int]], list[sp.Expr]] = defaultdict(list)
        for (constants, a), power in powers:
            by_factor[constants, a, self.support.classes_of(power)].append(power)
        addends = [self._as_addend(sp.Mul(term(constants, a), sp.Add(*sums)))
                   for (constants, a, _), sums in by_factor.items()]
        with_powers = self._addends_of_bundles(addends, remainder)
        is_polynomial = all(base.is_Symbol for m in terms for base, _ in m)
        if powers and is_polynomial:
            without_powers = self._addends_of_bundles(addends=[], terms=total_of(terms, constant))
            if costs_less([total(without_powers[0])], [total(with_powers[0])]):
                return without_powers
        return with_powers

    def _addends_of_bundles(
        self, addends: list[Addend], terms: Terms
    ) -> tuple[list[Addend], Terms]:
        """Return ``addends`` and the addends of ``terms``, and the unused part of the constant.

        Terms with the same classes of coordinates are a bundle, which becomes one addend or two.
        """
        bundles: dict[Hashable, Terms] = defaultdict(dict)
        constant = {m: a for m, a in terms.items() if is_constant(m)}
        for m, a in terms.items():
            if m not in constant:
                bundles[self.support.classes(m)][m] = a
        for bundle in bundles.values():
            for subset in self._split_linear(bundle):
                addend, constant = self._addend_of_bundle(subset, constant)
                addends.append(addend)
        return addends, constant

    def _split_linear(self, terms: Terms) -> list[Terms]:
        """Return the linear terms (weights m g z) of each block, and all other terms.

        Linear terms stay with the nonlinear terms of their block, unless these are the square of a
        sum, which is shorter alone.
        """
        blocks = {m: self.support.blocks(m) for m in terms}
        nonlinear = {m: a for m, a in terms.items() if not self._is_linear(m)}
        is_square = bool(nonlinear) and not square_root(without_common(nonlinear).primitive)[1]
        nonlinear_blocks = frozenset[int]().union(*(blocks[m] for m in nonlinear if not is_square))
        parts: dict[frozenset[int], Terms] = defaultdict(dict)
        for m, a in terms.items():
            stays = m in nonlinear or blocks[m] & nonlinear_blocks
            # the empty set stands for all terms that stay together
            parts[frozenset() if stays else blocks[m]][m] = a
        return list(parts.values())

    def _is_linear(self, m: Monomial) -> bool:
        """Whether the variable factors of a term are one symbol to the power 1."""
        return [(x.is_Symbol, n) for x, n in self.forms.compact.split(m)[0]] == [(True, 1)]

    def _addend_of_bundle(self, terms: Terms, constant: Terms) -> tuple[Addend, Terms]:
        """Return the addend of ``terms``, completed to a square if possible, and the new constant.

        The square, of a sum r with a factor c, is c r² = terms + completion: the constant of H may
        lend no more than it has, so that no term is added.
        """
        # terms = c · inner with c = outer · factor: only ``inner`` is completed to a square
        outer, factor, inner = without_common(terms)
        root, remainder = square_root(inner)
        completion = {multiply_monomials(outer, m).monomial: -a * factor
                      for m, a in remainder.items()}
        # the share a of a term b of the constant: 0 < a/b ≤ 1; a missing term gives a/(−a) = −1
        if root and all(0 < quotient(a, constant.get(m, -a)) <= 1 for m, a in completion.items()):
            square = sp.Mul(term(outer, factor), self.forms.short(root) ** 2)
            unused = total_of(constant, scale_terms(completion, -1))
            return Addend(square, total_of(terms, completion)), unused
        return Addend(self.forms.short(terms), terms), constant

    def _as_addend(self, e: sp.Expr) -> Addend:
        """Return an expression as an addend."""
        return Addend(e, self.forms.terms(e))


class ForceTerms:
    """The additive terms of the rows of F, by classes of coordinates."""

    def __init__(self, forms: CanonicalForms, support: Support, F: Sequence[sp.Expr]) -> None:
        """Keep the forces, and what was found of their terms, so that equal terms get equal forms.
        """
        self.forms = forms
        self.support = support
        self.F = F
        self._class_sets: dict[Hashable, frozenset[frozenset[int]]] = {}
        self._selected: dict[Hashable, list[sp.Expr]] = {}

    def rows(self) -> list[sp.Expr]:
        """Return each row of F as the sum of its addends.

        Summands that share a set of classes are selected together. For the joints of a chain they
        are equal up to the names of symbols: their addends are derived once.
        """
        addends: list[list[sp.Expr]] = [[] for _ in self.F]
        for group in self._groups():
            for row, e in zip(group, self._rows_of(list(group.values())), strict=True):
                addends[row].append(e)
        return [sp.Add(*row_addends) for row_addends in addends]

    def _groups(self) -> Iterable[dict[int, list[sp.Expr]]]:
        """Return groups of summands of F, row → summands, that share sets of classes."""
        summands = [(row, e) for row, f in enumerate(self.F) for e in sp.Add.make_args(f)]
        # each set of classes has a number, by which summands with a set in common are connected
        numbers: dict[frozenset[int], int] = {}
        set_numbers = [frozenset(numbers.setdefault(c, len(numbers)) for c in self._classes_in(e))
                       for _, e in summands]
        group_of = {number: i for i, group in enumerate(connected_components(set_numbers))
                    for number in group}
        groups: dict[int, dict[int, list[sp.Expr]]] = defaultdict(lambda: defaultdict(list))
        for (row, e), sets in zip(summands, set_numbers, strict=True):
            if sets:  # a summand that is 0 has no terms
                groups[group_of[min(sets)]][row].append(e)
        return groups.values()

    def _classes_in(self, e: sp.Expr) -> Iterator[frozenset[int]]:
        """Yield, for each term of an expression, the set of classes of coordinates in it."""
        local = self._local([e])  # terms alike but for their symbols share an entry, by places
        if local.key not in self._class_sets:
            self._class_sets[local.key] = frozenset(
                frozenset(map(local.classes.index, self.support.classes(m)))
                for m in self.forms.terms(e))
        for places in self._class_sets[local.key]:
            yield frozenset(local.classes[i] for i in places)

    def _rows_of(self, summands: Sequence[Sequence[sp.Expr]]) -> list[sp.Expr]:
        """Return the sum of the summands of each row as the sum of its addends."""
        local = self._local([e for row in summands for e in row])
        key = local.key, tuple(map(len, summands))
        if key not in self._selected:
            self._selected[key] = substitute(self._sums(summands), local.renaming)
        return substitute(self._selected[key], {x: s for s, x in local.renaming.items()})

    def _local(self, expressions: Sequence[sp.Expr]) -> LocalForm:
        """Return expressions in local symbols, with the classes of these in order."""
        renaming = local_names(symbols_of(expressions))
        classes = [self.support.coupling.classes([self.support.index_of[x]])
                   for x in renaming if x in self.support.index_of]
        # a symbol of q or p is in one class
        order = list(dict.fromkeys(c for (c,) in classes))
        places = (order.index(c) for (c,) in classes)
        return LocalForm((*substitute(expressions, renaming), *places), renaming, order)

    def _sums(self, summands: Sequence[Sequence[sp.Expr]]) -> list[sp.Expr]:
        """Return each row of F as a sum of addends.

        For each set of classes of coordinates these are the original addends or the expanded
        terms, whichever ``_select`` finds cheaper for all rows together, as rows share
        subexpressions.
        """
        # set of classes → row → terms, and → addends
        derived: dict[Hashable, dict[int, Terms]] = defaultdict(lambda: defaultdict(dict))
        original: dict[Hashable, dict[int, list[Addend]]] = defaultdict(lambda: defaultdict(list))
        for row, row_summands in enumerate(summands):
            for m, a in total_of(*map(self.forms.terms, row_summands)).items():
                derived[self.support.classes(m)][row][m] = a
            for e in row_summands:
                for addend in split(self.forms, e, self._is_irreducible):
                    if addend.terms:
                        m = next(iter(addend.terms))  # all terms of an addend have one set
                        original[self.support.classes(m)][row].append(addend)
        addends: list[list[sp.Expr]] = [[] for _ in summands]
        for key, row_terms in derived.items():
            for row, e in zip(row_terms, self._select(row_terms, original[key]), strict=True):
                addends[row].append(e)
        return [sp.Add(*row_addends) for row_addends in addends]

    def _select(
        self, row_terms: dict[int, Terms], original: dict[int, list[Addend]]
    ) -> Iterable[sp.Expr]:
        """Return derived rows, or the original ones if these are equal and clearly cheaper."""
        derived_rows = list(map(self.forms.short, row_terms.values()))
        original_rows = [total(original[row]) for row in row_terms]
        is_equal = all(total_of(*(addend_terms for _, addend_terms in original[row])) == terms
                       for row, terms in row_terms.items())
        is_cheaper = is_equal and costs_less(original_rows, derived_rows)
        return original_rows if is_cheaper else derived_rows

    def _is_irreducible(self, terms: Terms) -> bool:
        """Whether all terms have the same set of classes."""
        return len(set(map(self.support.classes, terms))) <= 1
