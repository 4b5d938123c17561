"""H and F taken apart: sums of pieces that depend on no more than they must.

A piece is an expression with its terms. Pieces are found from the terms of H alone; beside them
stand those that were written, multiplied out no further than taking apart needs. Of what hangs
together, either all found or all written pieces are taken.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence

import sympy as sp

from ..systems.elimination_order import connected
from .canonical_expressions import Forms, costs_less
from .common_factors import square_root, without_common
from .coordinate_coupling import Coupling
from .terms import (
    Monomial,
    Number,
    Terms,
    add_to,
    merged,
    moves,
    over,
    plus,
    scaled,
    symbols_in,
    term,
)

__all__ = ["ForcePieces", "HamiltonianPieces", "Reach"]

#: An expression and its terms.
Piece = tuple[sp.Expr, Terms]


class Reach:
    """Which coordinates and momenta terms depend on, by their places, and how H couples these."""

    def __init__(self, q: Sequence[sp.Symbol], p: Sequence[sp.Symbol], H: Terms) -> None:
        self.place = {x: i for symbols in (q, p) for i, x in enumerate(symbols)}
        self.p = frozenset(p)
        self._known: dict[Monomial, tuple[frozenset[int], frozenset[int]]] = {}
        self.coupling = Coupling(len(q), map(self, H))

    def __call__(self, m: Monomial) -> tuple[frozenset[int], frozenset[int]]:
        """Return the places of the momenta in a term, and of its coordinates and momenta."""
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

    def cell(self, m: Monomial) -> int:
        """Return the cell of a term with momenta."""
        a = min(self(m)[0])
        return self.coupling.cell_of.get(a, a)


def total(pieces: Iterable[Piece]) -> sp.Expr:
    """Return the sum of pieces."""
    return sp.Add(*(e for e, _ in pieces))


def is_constant(m: Monomial) -> bool:
    """Whether nothing in a term moves."""
    return not any(map(moves, symbols_in([m])))


def apart(
    forms: Forms, e: sp.Expr, is_piece: Callable[[Terms], bool]
) -> Iterator[Piece]:
    """Yield an expression in pieces, multiplied out no further than they need it."""
    for part in sp.Add.make_args(e):
        terms = forms.terms(part)
        sums = [a for a in part.args if a.is_Add] if part.is_Mul else []
        if is_piece(terms):
            yield forms.tidied(part), terms
        elif sums:
            others = [a for a in part.args if a is not sums[0]]
            for a in sums[0].args:
                yield from apart(forms, sp.Mul(*others, a), is_piece)
        else:
            yield from ((term(m, a), {m: a}) for m, a in terms.items())


class HamiltonianPieces:
    """The pieces of H."""

    def __init__(
        self, forms: Forms, q: Sequence[sp.Symbol], p: Sequence[sp.Symbol], H: sp.Expr
    ) -> None:
        self.forms = forms
        self.written = H
        self.terms = plus(*map(forms.terms, sp.Add.make_args(H)))
        self.reach = Reach(q, p, self.terms)

    def sum(self) -> sp.Expr:
        """Return H as the sum of its pieces."""
        constant = {m: a for m, a in self.terms.items() if is_constant(m)}
        moving = {m: a for m, a in self.terms.items() if m not in constant}
        chosen = [piece for terms, found, written in self._regions(moving)
                  for piece in self._chosen(terms, found, written)]
        for _, terms in chosen:
            for m in filter(is_constant, terms):
                add_to(constant, m, -terms[m])
        return sp.Add(*(e for e, _ in chosen), self.forms.short(constant))

    # ------------------------------------------------------------ found or written

    def _regions(self, moving: Terms) -> Iterator[tuple[Terms, list[Piece], list[Piece]]]:
        """Yield terms that hang together, with the pieces found for them and those written."""
        pieces = [self._found(), list(apart(self.forms, self.written, self._is_piece))]
        nodes = self._nodes(moving)
        touched = [[frozenset(nodes(m) for m in terms if not is_constant(m))
                    for _, terms in side] for side in pieces]
        regions = connected(place for side in touched for place in side)
        region_of = {node: i for i, region in enumerate(regions) for node in region}
        terms: list[Terms] = [{} for _ in regions]
        for m, a in moving.items():
            terms[region_of[nodes(m)]][m] = a
        sides: list[tuple[list[Piece], list[Piece]]] = [([], []) for _ in regions]
        for side, (own, places) in enumerate(zip(pieces, touched, strict=True)):
            for piece, place in zip(own, places, strict=True):
                if place:
                    sides[region_of[min(place)]][side].append(piece)
        for inside, (found, written) in zip(terms, sides, strict=True):
            yield inside, found, written

    def _nodes(self, moving: Terms) -> Callable[[Monomial], int]:
        """Return what tells which terms depend on each other: a number for each cell and potential.
        """
        n = len(self.reach.p)
        potential = connected(self.reach.blocks(m) for m in moving if not self.reach(m)[0])
        part_of = {a: n + min(part) for part in potential for a in part}

        def node(m: Monomial) -> int:
            if self.reach(m)[0]:
                return self.reach.cell(m)
            a = min(self.reach.blocks(m), default=n)
            return part_of.get(a, n + a)

        return node

    def _chosen(self, terms: Terms, found: list[Piece], written: list[Piece]) -> list[Piece]:
        """Return the pieces found, or those written if they make the same and cost clearly less."""
        made = plus(*(part for _, part in written))
        same = {m: a for m, a in made.items() if not is_constant(m)} == terms
        return written if same and costs_less([total(written)], [total(found)]) else found

    def _is_piece(self, terms: Terms) -> bool:
        """Whether terms need not be taken apart: of one cell at most, and all coupled."""
        cells = {self.reach.cell(m) for m in terms if self.reach(m)[0]}
        places = frozenset[int]().union(*(self.reach(m)[1] for m in terms))
        return len(cells) <= 1 and self.reach.coupling.are_coupled(places)

    # ------------------------------------------------------------ found from terms alone

    def _found(self) -> list[Piece]:
        """Return H in pieces, but for a constant."""
        squares, left = self.forms.powers(self.terms, self.reach.p)
        pieces = [self._with_terms(sp.Mul(term(*outer), power)) for outer, power in squares]
        cells: dict[int, Terms] = defaultdict(dict)
        potential: Terms = {}
        constant: Terms = {}
        for m, a in left.items():
            part = cells[self.reach.cell(m)] if self.reach(m)[0] else (
                constant if is_constant(m) else potential)
            part[m] = a
        pieces += [(self.forms.short(part), part) for part in cells.values()]
        for part in self._potentials(potential):
            found, constant = self._potential(part, constant)
            pieces += found
        return pieces

    def _potentials(self, terms: Terms) -> Iterator[Terms]:
        """Yield terms whose coordinates depend on each other, and those of time alone."""
        blocks = {m: self.reach.blocks(m) for m in terms}
        for together in [*connected(blocks.values()), frozenset[int]()]:
            part = {m: a for m, a in terms.items() if blocks[m] & together or (
                not blocks[m] and not together)}
            if part:
                yield part

    def _potential(self, terms: Terms, constant: Terms) -> tuple[list[Piece], Terms]:
        """Return pieces of a potential, and what is left of the constant.

        Powers of differences are found in all of it, other forms in what depends on the same; of
        polynomials also without the powers, which is taken if that costs clearly less.
        """
        powers, left = self.forms.powers(plus(terms, constant))
        together: dict[tuple[Monomial, Number, frozenset[int]], list[sp.Expr]] = defaultdict(list)
        for (still, a), power in powers:
            together[still, a, self.reach.classes_of(power)].append(power)
        pieces = [self._with_terms(sp.Mul(term(still, a), sp.Add(*own)))
                  for (still, a, _), own in together.items()]
        found = self._bundles(pieces, left)
        if powers and all(base.is_Symbol for m in terms for base, _ in m):
            plain = self._bundles([], plus(terms, constant))
            if costs_less([total(plain[0])], [total(found[0])]):
                return plain
        return found

    def _bundles(self, pieces: list[Piece], left: Terms) -> tuple[list[Piece], Terms]:
        """Return the pieces, with those of all other terms, and what is left of the constant."""
        bundles: dict[Hashable, Terms] = defaultdict(dict)
        constant = {m: a for m, a in left.items() if is_constant(m)}
        for m, a in left.items():
            if m not in constant:
                bundles[self.reach.classes(m)][m] = a
        for bundle in bundles.values():
            for part in self._linear_apart(bundle):
                piece, constant = self._bundle(part, constant)
                pieces.append(piece)
        return pieces, constant

    def _linear_apart(self, terms: Terms) -> list[Terms]:
        """Return linear terms by blocks, as weights are, and the rest.

        Where other terms have the block as well, they stay with them, but for the square of a sum.
        """
        blocks = {m: self.reach.blocks(m) for m in terms}
        bent = {m: a for m, a in terms.items() if not self._is_linear(m)}
        is_square = bool(bent) and not square_root(without_common(bent)[2])[1]
        kept = frozenset[int]().union(*(blocks[m] for m in bent if not is_square))
        parts: dict[frozenset[int], Terms] = defaultdict(dict)
        for m, a in terms.items():
            parts[frozenset() if m in bent or blocks[m] & kept else blocks[m]][m] = a
        return list(parts.values())

    def _is_linear(self, m: Monomial) -> bool:
        return [(x.is_Symbol, n) for x, n in self.forms.compact.split(m)[0]] == [(True, 1)]

    def _bundle(self, terms: Terms, constant: Terms) -> tuple[Piece, Terms]:
        """Return the piece of terms of the same coordinates, a square if the constant makes it."""
        outer, value, inner = without_common(terms)
        root, left = square_root(inner)
        needed = {merged(outer, m)[0]: -a * value for m, a in left.items()}
        if root and all(0 < over(a, constant.get(m, -a)) <= 1 for m, a in needed.items()):
            e = sp.Mul(term(outer, value), self.forms.short(root) ** 2)
            return (e, plus(terms, needed)), plus(constant, scaled(needed, -1))
        return (self.forms.short(terms), terms), constant

    def _with_terms(self, e: sp.Expr) -> Piece:
        return e, self.forms.terms(e)


class ForcePieces:
    """The pieces of the rows of F: terms that depend on the same classes of coordinates."""

    def __init__(self, forms: Forms, reach: Reach, written: Sequence[sp.Expr]) -> None:
        self.forms = forms
        self.reach = reach
        self.written = written

    def rows(self) -> list[sp.Expr]:
        """Return each row as the sum of its pieces.

        What is decided for one row is decided for all: they have parts in common.
        """
        found: dict[Hashable, dict[int, Terms]] = defaultdict(lambda: defaultdict(dict))
        written: dict[Hashable, dict[int, list[Piece]]] = defaultdict(lambda: defaultdict(list))
        for row, e in enumerate(self.written):
            for m, a in plus(*map(self.forms.terms, sp.Add.make_args(e))).items():
                found[self.reach.classes(m)][row][m] = a
            for piece in apart(self.forms, e, self._is_piece):
                if piece[1]:
                    written[self.reach.classes(next(iter(piece[1])))][row].append(piece)
        made: list[list[sp.Expr]] = [[] for _ in self.written]
        for key, parts in found.items():
            for row, e in zip(parts, self._chosen(parts, written[key]), strict=True):
                made[row].append(e)
        return [sp.Add(*pieces) for pieces in made]

    def _chosen(
        self, parts: dict[int, Terms], written: dict[int, list[Piece]]
    ) -> Iterable[sp.Expr]:
        short = [self.forms.short(part) for part in parts.values()]
        kept = [total(written[row]) for row in parts]
        same = all(plus(*(terms for _, terms in written[row])) == part
                   for row, part in parts.items())
        return kept if same and costs_less(kept, short) else short

    def _is_piece(self, terms: Terms) -> bool:
        return len(set(map(self.reach.classes, terms))) <= 1
