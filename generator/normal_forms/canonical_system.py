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

from dataclasses import replace
from functools import lru_cache

import sympy as sp

from ..symbolic.shared_subexpressions import substitute
from ..systems.lagrangian import LagrangianSystem
from ..systems.system import System
from .additive_terms import ForceTerms, HamiltonianTerms
from .canonical_expressions import CanonicalForms
from .terms import placeholder

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


class _SystemForms:
    """Canonical forms of the expressions of a system, in its symbols.

    They are derived in placeholders, whose order is the order of the symbols in q, p, t and the
    parameters.
    """

    def __init__(self, system: System) -> None:
        """Number the variables q, p, t, and the parameters, from 0 each."""
        self.system = system
        variables = (*system.q, *system.p, *filter(None, (system.time,)))
        self.placeholders: dict[sp.Symbol, sp.Symbol] = {}
        for symbols, is_variable in ((variables, True), (system.parameters, False)):
            for index, x in enumerate(symbols):
                self.placeholders[x] = placeholder(index, is_variable,
                                                   frozenset(x.assumptions0.items()))
        self.symbol_of = {stand_in: x for x, stand_in in self.placeholders.items()}
        self.forms = CanonicalForms()

    def with_symbols(self, e: sp.Expr, original: sp.Expr) -> sp.Expr:
        """Return e in the symbols of the system, with decimals if the original has some."""
        return substitute([with_floats(e, original)], self.symbol_of)[0]

    def expression(self, e: sp.Expr) -> sp.Expr:
        """Return the canonical form of an expression as a whole."""
        in_placeholders, = substitute([e], self.placeholders)
        return self.with_symbols(self.forms.expression(in_placeholders), e)

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
        """Return H and the rows of F, split into additive terms."""
        system = self.system
        q, p = ([self.placeholders[x] for x in symbols] for symbols in (system.q, system.p))
        hamiltonian, *forces = substitute([system.H, *system.forces], self.placeholders)
        H = HamiltonianTerms(self.forms, q, p, hamiltonian)
        # the coupling of coordinates in H decides how forces are split
        F = ForceTerms(self.forms, H.support, forces)
        return self.with_symbols(H.sum(), system.H), tuple(
            self.with_symbols(e, original)
            for e, original in zip(F.rows(), system.forces, strict=True))


def with_floats(e: sp.Expr, original: sp.Expr) -> sp.Expr:
    """Return e with decimals in place of long fractions, if the original expression has decimals.

    Decimals are exact fractions until then: 0.5 and 1/2 are one number, and a sum of decimals is
    the same in any order.
    """
    bits = max((x._prec for x in original.atoms(sp.Float)), default=0)
    if not bits:
        return e
    long_fractions = [x for x in e.atoms(sp.Rational) if max(abs(x.p), x.q) > _LONGEST]
    return e.xreplace({x: sp.Float(x, precision=bits) for x in long_fractions})
