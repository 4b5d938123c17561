"""Repeated structure of a large system: element templates, their instances, and elimination.

A chain of a hundred bodies has a hundred kinetic energies of one form and a hundred joints of one
form. H and g are split into terms; terms that are equal but for the names of their symbols become
one element template in local symbols, with a table of its instances. The C has one kernel per
template and loops over instances: its size, and the time to derive and compile it, hardly depend on
the number of bodies, and zero entries of matrices are never stored.

    H = Σ_f Σ_i  h_f(q[Q_fi], p[P_fi]; k[K_fi]),     g[R_fi] = g_f(q[Q_fi]; k[K_fi])
    F[R_fi] += F_f(q[Q_fi], p[P_fi], t; k[K_fi])

Where H or g depends on t, so do h_f and g_f.

Terms with momenta are grouped by *kinetic blocks*, the sets of coordinates that H_pp couples:
W = G H_pp Gᵀ is a sum over these blocks. Its pattern, an elimination order and the fill-in are
computed here; for a chain or a tree there is no fill-in.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable, Iterator, Sequence
from functools import cached_property

import sympy as sp

from ...core.records import dataclass
from ..symbolic.shared_subexpressions import structure_of, substitute
from ..symbolic.switching_functions import depends_by_steps
from .elimination_order import (
    Elimination,
    Node,
    connected_components,
    eliminate,
    reverse_cuthill_mckee,
)
from .moving_frame import CoMovingSystem, energy_of
from .system import System

__all__ = ["ElementSystem", "ElementTemplate", "Instance", "Structure"]


@dataclass(frozen=True)
class Instance:
    """Indices of the coordinates, momenta, constants and constraints of one instance."""

    q: tuple[int, ...]
    p: tuple[int, ...]
    constants: tuple[int, ...]
    rows: tuple[int, ...] = ()


@dataclass(frozen=True)
class ElementTemplate:
    """Expressions in local symbols, and the instances that share them.

    A template of H has one expression, in a co-moving frame also its energy; one of constraints or
    forces has an expression for each of its rows.
    """

    q: tuple[sp.Symbol, ...]
    p: tuple[sp.Symbol, ...]
    constants: tuple[sp.Symbol, ...]
    expressions: tuple[sp.Expr, ...]
    instances: tuple[Instance, ...]
    time: sp.Symbol | None = None

    @cached_property
    def system(self) -> System:
        """The template by itself, as a system with its local symbols: its derivatives."""
        return ElementSystem(self.q, self.p, self.constants, self.expressions[0], time=self.time)


class ElementSystem(System):
    """Part of a system: momenta need not belong to coordinates, and nothing is checked."""

    def __post_init__(self) -> None:
        """Skip the checks of ``System``: the whole system has passed them."""


class Structure:
    """Element templates of a system, its kinetic blocks, and the elimination of W."""

    def __init__(self, system: System) -> None:
        """Number the coordinates, momenta and constants of a system."""
        self.system = system
        self._q = {x: i for i, x in enumerate(system.q)}
        self._p = {x: i for i, x in enumerate(system.p)}
        self._constants = {x: i for i, x in enumerate(system.parameters)}
        # structure → expressions in local symbols, and the places of their constants in it
        self._local_forms: dict[Hashable, tuple[tuple[sp.Expr, ...], list[int]]] = {}

    # ------------------------------------------------------------ H

    def _indices(self, e: sp.Expr, index_of: dict[sp.Symbol, int]) -> frozenset[int]:
        """Return the indices of the symbols of e that ``index_of`` contains."""
        return frozenset(index_of[s] for s in e.free_symbols if s in index_of)

    @cached_property
    def templates(self) -> list[ElementTemplate]:
        """The templates of H: those with momenta first."""
        groups = [*self._kinetic_groups.values(), *self._potential_groups]
        # terms of H belong to no row of g or F
        return self._templates_of([(self._with_energy(terms), ()) for terms in groups])

    def _with_energy(self, terms: list[sp.Expr]) -> tuple[sp.Expr, ...]:
        """Return Σ terms of H̃; in a co-moving frame also Σ of the terms that the energy H has."""
        if not isinstance(self.system, CoMovingSystem):
            return (sp.Add(*terms),)
        return sp.Add(*terms), sp.Add(*(term for term in terms if term in self._energy))

    @cached_property
    def _energy(self) -> frozenset[sp.Expr]:
        """The terms of the energy that runs report."""
        return frozenset(sp.Add.make_args(energy_of(self.system)))

    @cached_property
    def _terms(self) -> list[tuple[sp.Expr, frozenset[int], frozenset[int]]]:
        """The terms of H, each with the indices of its coordinates and of its momenta."""
        return [(term, self._indices(term, self._q), self._indices(term, self._p))
                for term in sp.Add.make_args(self.system.H)]

    @cached_property
    def _kinetic_groups(self) -> dict[frozenset[int], list[sp.Expr]]:
        """Kinetic block → its terms with momenta, and potentials of its coordinates alone.

        A kinetic block is a set of momenta, by index, that terms of H couple to each other.
        """
        kinetic_blocks = connected_components([p for _, _, p in self._terms if p])
        block_of = {a: block for block in kinetic_blocks for a in block}
        groups: dict[frozenset[int], list[sp.Expr]] = {block: [] for block in kinetic_blocks}
        support = {block: set(block) for block in kinetic_blocks}
        for term, q, p in self._terms:
            if p:
                # all momenta of a term are in one block
                block = block_of[min(p)]
                groups[block].append(term)
                support[block] |= q
        # potentials of these coordinates alone, such as gravity, join the kinetic energy: one
        # kernel in place of two
        for term, q, p in self._terms:
            kinetic_block = block_of.get(min(q)) if q and not p else None
            if kinetic_block is not None and q <= support[kinetic_block]:
                groups[kinetic_block].append(term)
        return groups

    @cached_property
    def _potential_groups(self) -> list[list[sp.Expr]]:
        """All other terms, by the coordinates they depend on."""
        kinetic = {term for terms in self._kinetic_groups.values() for term in terms}
        groups: dict[frozenset[int], list[sp.Expr]] = defaultdict(list)
        for term, q, _ in self._terms:
            if term not in kinetic:
                groups[q].append(term)
        return list(groups.values())

    # ------------------------------------------------------------ g

    @cached_property
    def constraint_templates(self) -> list[ElementTemplate]:
        """The templates of the constraints; rows of one name (before a colon) go together."""
        groups: dict[str, list[int]] = defaultdict(list)
        for row, name in enumerate(self.system.constraint_names):
            # "hinge:x", "hinge:y" are rows of one joint; a name without a colon stands alone
            groups[name.split(":")[0] if ":" in name else f"{row}:"].append(row)
        parts = []
        for rows in groups.values():
            for group in self._overlapping(rows):
                parts.append((tuple(self.system.constraints[r] for r in group), tuple(group)))
        return self._templates_of(parts)

    def _overlapping(self, rows: list[int]) -> Iterator[list[int]]:
        """Yield the groups of rows that common coordinates connect; a common name does not."""
        support = {r: self._indices(self.system.constraints[r], self._q) for r in rows}
        # all coordinates of a row are in one component
        for coordinates in connected_components([s for s in support.values() if s]):
            yield [r for r in rows if support[r] and min(support[r]) in coordinates]
        yield from ([r] for r in rows if not support[r])

    # ------------------------------------------------------------ F

    @cached_property
    def force_templates(self) -> list[ElementTemplate]:
        """The templates of the forces: terms of equal support, with their rows.

        The support of a term is its coordinates and momenta, by index.
        """
        # support → row of F → terms
        groups: dict[tuple[frozenset[int], frozenset[int]], dict[int, list[sp.Expr]]] = {}
        for row, force in enumerate(self.system.forces):
            for term in sp.Add.make_args(force):
                if term != 0:
                    support = (self._indices(term, self._q), self._indices(term, self._p))
                    groups.setdefault(support, {}).setdefault(row, []).append(term)
        return self._templates_of([(tuple(sp.Add(*terms) for terms in rows.values()), tuple(rows))
                                   for rows in groups.values()])

    # ------------------------------------------------------------ templates

    def _templates_of(
        self, parts: Iterable[tuple[tuple[sp.Expr, ...], tuple[int, ...]]]
    ) -> list[ElementTemplate]:
        """Return the templates of parts: parts that are equal in local symbols share one.

        A part has expressions, and the rows of g or F that they belong to. Templates with momenta
        come first.
        """
        instances_of: dict[tuple[sp.Expr, ...], list[Instance]] = {}
        for expressions, rows in parts:
            local_expressions, instance = self._canonical(expressions, rows)
            instances_of.setdefault(local_expressions, []).append(instance)
        templates = []
        for local_expressions, instances in instances_of.items():
            first = instances[0]
            templates.append(ElementTemplate(local("x", len(first.q)), local("y", len(first.p)),
                                             local("k", len(first.constants)), local_expressions,
                                             tuple(instances), self.system.clock))
        return sorted(templates, key=lambda template: not template.p)

    def _canonical(
        self, expressions: tuple[sp.Expr, ...], rows: tuple[int, ...]
    ) -> tuple[tuple[sp.Expr, ...], Instance]:
        """Return the expressions in local symbols x, y and k, and the indices of the local symbols.

        Coordinates and momenta are numbered by their order in the system, constants by their order
        in the expressions. ``rows`` are the rows of g or F that the instance has. Parts of equal
        structure are derived once.
        """
        structure, symbols = structure_of(expressions)
        q, p = (sorted(index_of[s] for s in symbols if s in index_of)
                for index_of in (self._q, self._p))
        names = dict(zip((self.system.q[i] for i in q), local("x", len(q)), strict=True))
        names |= dict(zip((self.system.p[i] for i in p), local("y", len(p)), strict=True))
        # where one expression has the time and another a constant, the two differ
        key = structure, tuple(None if x in self._constants else names.get(x, x) for x in symbols)
        if key not in self._local_forms:
            # coordinates first: the order of constants refers to these local names
            local_expressions = tuple(substitute(expressions, names))
            constants = self._constants_in_order(local_expressions)
            final = dict(zip(constants, local("k", len(constants)), strict=True))
            self._local_forms[key] = (tuple(substitute(local_expressions, final)),
                                      [symbols.index(c) for c in constants])
        local_expressions, places = self._local_forms[key]
        return local_expressions, Instance(
            tuple(q), tuple(p), tuple(self._constants[symbols[i]] for i in places), rows)

    @cached_property
    def _anonymous(self) -> dict[sp.Symbol, sp.Symbol]:
        """Every constant → one symbol, so that expressions are compared without their names."""
        return dict.fromkeys(self._constants, sp.Symbol("_"))

    def _constants_in_order(self, expressions: Sequence[sp.Expr]) -> list[sp.Symbol]:
        """Return the constants in their order in the expressions.

        The order does not depend on names, so that equal templates get equal symbols.
        """
        anonymous = self._anonymous
        constants: dict[sp.Symbol, None] = {}

        def visit(e: sp.Expr) -> None:
            """Add the constants of an expression in an order that does not depend on their names.
            """
            if e in self._constants:
                constants.setdefault(e)
            elif not e.is_Atom:
                for a in sorted((a for a in e.args if a.free_symbols),
                                key=lambda a: sp.default_sort_key(a.xreplace(anonymous))):
                    visit(a)

        for e in expressions:
            visit(e)
        return list(constants)

    # ------------------------------------------------------------ W

    @cached_property
    def entries(self) -> dict[int, list[int]]:
        """Coordinate → constraints that depend on it, in order."""
        rows: dict[int, list[int]] = defaultdict(list)
        for row, g in enumerate(self.system.constraints):
            for a in self._indices(g, self._q):
                rows[a].append(row)
        return rows

    def constraints_of(self, instance: Instance) -> list[int]:
        """Return the constraints that act on the momenta of an instance of H."""
        return sorted({row for a in instance.p for row in self.entries.get(a, ())})

    @cached_property
    def elimination(self) -> Elimination:
        """Sparse factorisation of W = G H_pp Gᵀ, m × m.

        Constraints that act on the same kinetic block are coupled.
        """
        neighbours: dict[int, set[int]] = {row: set() for row in range(self.system.m)}
        for template in self.templates:
            for instance in template.instances:
                rows = self.constraints_of(instance)
                for row in rows:
                    neighbours[row] |= set(rows) - {row}
        return eliminate(neighbours)

    @cached_property
    def is_worthwhile(self) -> bool:
        """Whether sparse products are fewer than three quarters of the dense ones.

        Counted are the multiply-adds of the dominant costs: the factors of W = G H_pp Gᵀ, m × m;
        G, m × n, and H_pp, n × n, times a vector. Up to six coordinates gathering costs more than
        zeros do, and dense code may use properties proved for the whole system. Both bounds are
        chosen, not fitted to measurements.
        """
        n, m = self.system.n, self.system.m
        if n <= 6:
            return False
        # dense C has LU factors, with m³/3 although W is symmetric; ``elimination`` is LDLᵀ
        dense = m**3 / 3 + m * n + n * n
        G_entries = sum(map(len, self.entries.values()))
        # H_pp of an instance has a row and a column for each of its momenta
        H_pp_entries = sum(len(i.p) ** 2 for template in self.templates for i in template.instances)
        sparse = self.elimination.products + G_entries + H_pp_entries
        return sparse < 0.75 * dense

    @property
    def is_quadratic(self) -> bool:
        """Whether H is quadratic in p, so that one solve finds the momenta on g_q H_p = 0."""
        return not any(depends_by_steps(template.system.H_p, template.p) or e.has(*template.p)
                       for template in self.templates if template.p
                       for row in template.system.H_pp for e in row)

    @property
    def is_separable(self) -> bool:
        """Whether H_pq = 0."""
        return all(sp.expand(e) == 0 and not depends_by_steps(template.system.H_p, template.q)
                   for template in self.templates if template.p
                   for row in template.system.H_pq for e in row)

    @cached_property
    def band_order(self) -> list[Node]:
        """Coordinates ("q", a) and constraints ("g", row), in an order with a narrow band.

        Nodes that an element couples stand close together (reverse Cuthill-McKee).
        """
        neighbours: dict[Node, set[Node]] = {
            **{("q", a): set() for a in range(self.system.n)},
            **{("g", row): set() for row in range(self.system.m)}}
        for nodes in self.coupled_sets:
            for node in nodes:
                neighbours[node] |= nodes - {node}
        return reverse_cuthill_mckee(neighbours)

    @cached_property
    def coupled_sets(self) -> list[set[Node]]:
        """Sets of coordinates ("q", a) and constraints ("g", row) that an element couples.

        The constraint force Gᵀ λ changes the momenta of its coordinates, and H_pp Gᵀ λ the
        velocities of their kinetic blocks: a constraint is coupled to whole blocks.
        """
        # momentum → coordinates whose velocity, or force, depends on it
        block_of = {a: set(i.q) | set(i.p)
                    for template in self.templates for i in template.instances for a in i.p}
        sets = [{("q", a) for a in (*i.q, *i.p)}
                for template in self.templates for i in template.instances]
        for template in self.force_templates:
            for i in template.instances:
                sets.append({("q", a) for a in (*i.q, *i.p, *i.rows)})
                for a in i.p:
                    block_of[a] = block_of.get(a, set()) | set(i.rows)
        for template in self.constraint_templates:
            for i in template.instances:
                reached = set(i.q).union(*(block_of.get(a, ()) for a in i.q))
                sets.append({("q", a) for a in reached} | {("g", row) for row in i.rows})
        return [nodes for nodes in sets if nodes]  # a constant in H has none


def local(letter: str, count: int) -> tuple[sp.Symbol, ...]:
    """Return the local symbols _x0, _x1, … of a letter; symbols of a system begin otherwise."""
    return tuple(sp.Symbol(f"_{letter}{i}", real=True) for i in range(count))
