"""Normal form of a system: one for all equivalent expressions of H, g and F.

    (Σ p_i²)/(2m),   Σ p_i²/(2m),   (p_1² m_2 + p_2² m_1)/(2 m_1 m_2),   m (a + b)²/2,   …

1. All expressions are expanded (``expansion``); the result is the same for all of them.
2. The terms are split (``additive_terms``): H into the kinetic energies of blocks, and into
   potentials of coupled coordinates. A sum over bodies becomes a sum of their terms.
3. Each addend gets its shortest form (``shortest_sum``), derived from its terms alone.

The user's expression matters in one case: if expansion takes too long, or loses a form that costs
clearly less and is not recovered, the addend keeps its original form, except for order and numbers
(``canonical_expressions``).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import sympy as sp

from ..symbolic.shared_subexpressions import structure_of, substitute
from ..systems.elimination_order import connected_components
from ..systems.lagrangian import LagrangianSystem
from ..systems.system import System
from .additive_terms import ForceTerms, HamiltonianTerms, Support
from .canonical_expressions import CanonicalForms, local_names
from .coordinate_coupling import IndexSet
from .terms import placeholder, symbols_in

__all__ = ["canonical"]

#: Numerators and denominators beyond this come from decimals such as 0.1.
_LONGEST = 2**20


@lru_cache(maxsize=16)
def canonical(system: System) -> System:
    """Return the system with H, g, F and quantities in their canonical form.

    Symbols are ordered by their indices in q, p and the parameters, not by their names.
    """
    forms = _SystemForms(system)
    g = tuple(map(forms.expression, system.constraints))
    velocity_constraints = forms.velocity_constraints()
    # T keeps its original form: expanded, it would lose its short sums of velocities
    if isinstance(system, LagrangianSystem):
        return replace(system, constraints=g, velocity_constraints=velocity_constraints)
    H, forces = forms.hamiltonian_and_forces()
    return replace(
        system,
        H=H,
        constraints=g,
        velocity_constraints=velocity_constraints,
        forces=forces,
        quantities={name: forms.expression(e) for name, e in system.quantities.items()},
        time_scale=None if system.time_scale is None else forms.expression(system.time_scale),
    )


class _Group(NamedTuple):
    """Summands of H that have no coordinate in common with others.

    ``H`` has their terms in local symbols; ``symbols`` maps these to the symbols of the system, and
    ``indices`` has the coordinates in their order.
    """

    summands: list[sp.Expr]
    H: HamiltonianTerms
    symbols: dict[sp.Symbol, sp.Symbol]
    indices: list[int]

    def constants(self) -> list[set[sp.Symbol]]:
        """Return the parameters of each constant term."""
        return [{self.symbols[x] for x in symbols_in([m])} for m in self.H.constant]

    def supports(self) -> list[tuple[IndexSet, IndexSet]]:
        """Return, for each term, the indices of its momenta, and of its q and p, in the system."""
        return [(frozenset(self.indices[i] for i in momenta),
                 frozenset(self.indices[i] for i in coordinates))
                for momenta, coordinates in map(self.H.support, self.H.terms)]


class _SystemForms:
    """Canonical forms of the expressions of a system, in its symbols.

    They are derived in placeholders, whose order is the order of the symbols in q, p, t and the
    parameters. Expressions that differ in their symbols alone are derived once.
    """

    def __init__(self, system: System) -> None:
        """Number the variables q, p, t, and the parameters, from 0 each."""
        self.system = system
        variables = (*system.q, *system.p, *filter(None, (system.time,)))
        self.placeholders: dict[sp.Symbol, sp.Symbol] = {}
        # whether a symbol varies, and what is assumed of it
        self.kinds: dict[sp.Symbol, tuple[bool, frozenset[tuple[str, bool]]]] = {}
        for symbols, is_variable in ((variables, True), (system.parameters, False)):
            for index, x in enumerate(symbols):
                self.kinds[x] = is_variable, frozenset(x.assumptions0.items())
                self.placeholders[x] = placeholder(index, *self.kinds[x])
        self.rank = {x: i for i, x in enumerate(self.placeholders)}
        self.index_of = {x: i for own in (system.q, system.p) for i, x in enumerate(own)}
        self.forms = CanonicalForms()
        # structure → local symbols, and the form or the terms of H in them
        self._form_of: dict[Hashable, tuple[list[sp.Symbol], sp.Expr]] = {}
        self._terms_of: dict[Hashable, tuple[list[sp.Symbol], HamiltonianTerms]] = {}

    def expression(self, e: sp.Expr) -> sp.Expr:
        """Return the canonical form of an expression as a whole."""
        structure, symbols = structure_of([e])
        ordered = sorted(symbols, key=self.rank.__getitem__)
        key = self._key(structure, symbols, ordered)
        if key not in self._form_of:
            names = self._local(ordered)
            form = self.forms.expression(*substitute([e], names))
            self._form_of[key] = [*names.values()], with_floats(form, float_bits(e))
        local, form = self._form_of[key]
        return substitute([form], dict(zip(local, ordered, strict=True)))[0]

    def _key(self, structure: Hashable, symbols: list[sp.Symbol], ordered: list[sp.Symbol]
             ) -> Hashable:
        """Return a key that expressions share if they differ in names of symbols alone."""
        place = {x: i for i, x in enumerate(ordered)}
        return (structure, tuple(place[x] for x in symbols),
                tuple(self.kinds[x] for x in ordered))

    def _local(self, ordered: list[sp.Symbol]) -> dict[sp.Symbol, sp.Symbol]:
        """Return symbol → local name; names are numbered as the symbols are ordered."""
        local = local_names(self.placeholders[x] for x in ordered)
        return {x: local[self.placeholders[x]] for x in ordered}

    def velocity_constraints(self) -> tuple[sp.Expr, ...]:
        """Return the velocity constraints A v + a, with each entry of A and a canonical."""
        system = self.system
        constraints: list[sp.Expr] = []
        for row, affine in zip(system.A, system.a, strict=True):
            terms = [self.expression(affine)]
            terms += [self.expression(e) * x for e, x in zip(row, system.velocities, strict=True)]
            constraints.append(sp.Add(*terms))
        return tuple(constraints)

    def hamiltonian_and_forces(self) -> tuple[sp.Expr, tuple[sp.Expr, ...]]:
        """Return H and the rows of F, split into additive terms.

        Groups of summands without common coordinates are derived apart, equal ones once. A constant
        may complete the square of any group that has its parameters: these are derived together.
        """
        system, bits = self.system, float_bits(self.system.H)
        symbol_of = {stand_in: x for x, stand_in in self.placeholders.items()}
        groups = self._groups()
        constants = [parameters for group in groups for parameters in group.constants()]
        joined: list[sp.Expr] = []
        addends: list[sp.Expr] = []
        supports: list[tuple[IndexSet, IndexSet]] = []
        for group in groups:
            symbols = set(group.symbols.values())
            if group.H.constant or any(parameters <= symbols for parameters in constants):
                joined += group.summands
            else:
                addends += substitute([with_floats(group.H.sum, bits)], group.symbols)
                supports += group.supports()
        q, p = ([self.placeholders[x] for x in symbols] for symbols in (system.q, system.p))
        remainder, *forces = substitute([sp.Add(*joined), *system.forces], self.placeholders)
        H = HamiltonianTerms(self.forms, q, p, remainder)
        addends += substitute([with_floats(H.sum, bits)], symbol_of)
        # the coupling of coordinates in H decides how forces are split
        F = ForceTerms(self.forms, Support(q, p, H.terms, supports), forces)
        return sp.Add(*addends), tuple(
            substitute([with_floats(e, float_bits(original))], symbol_of)[0]
            for e, original in zip(F.rows(), system.forces, strict=True))

    def _groups(self) -> list[_Group]:
        """Return the summands of H by the coordinates that they couple, and those without any."""
        summands_of: dict[int, list[sp.Expr]] = defaultdict(list)
        summands = sp.Add.make_args(self.system.H)
        supports = [frozenset(self.index_of[x] for x in e.free_symbols if x in self.index_of)
                    for e in summands]
        component_of = {i: min(component) for component in connected_components(supports)
                        for i in component}
        for e, support in zip(summands, supports, strict=True):  # −1: without coordinates
            summands_of[component_of[min(support)] if support else -1].append(e)
        return list(map(self._group, summands_of.values()))

    def _group(self, summands: list[sp.Expr]) -> _Group:
        """Return a group of summands with its terms, which equal groups share."""
        structure, symbols = structure_of(summands)
        indices = sorted({self.index_of[x] for x in symbols if x in self.index_of})
        n = len(indices)
        # n coordinates, n momenta, then time and parameters
        ordered = [own[i] for own in (self.system.q, self.system.p) for i in indices]
        ordered += sorted(set(symbols) - set(ordered), key=self.rank.__getitem__)
        key = n, self._key(structure, symbols, ordered)
        if key not in self._terms_of:
            names = self._local(ordered)
            local = [*names.values()]
            self._terms_of[key] = local, HamiltonianTerms(
                self.forms, local[:n], local[n:2 * n], sp.Add(*substitute(summands, names)))
        local, H = self._terms_of[key]
        return _Group(summands, H, dict(zip(local, ordered, strict=True)), indices)


def float_bits(original: sp.Expr) -> int:
    """Return the precision of the decimals in an expression; 0 without any."""
    return max((x._prec for x in original.atoms(sp.Float)), default=0)


def with_floats(e: sp.Expr, bits: int) -> sp.Expr:
    """Return e with decimals of so many bits in place of long fractions; e as it is for 0 bits.

    Decimals are exact fractions until then: 0.5 and 1/2 are one number, and a sum of decimals is
    the same in any order.
    """
    if not bits:
        return e
    long_fractions = [x for x in e.atoms(sp.Rational) if max(abs(x.p), x.q) > _LONGEST]
    return e.xreplace({x: sp.Float(x, precision=bits) for x in long_fractions})
