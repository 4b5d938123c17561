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
    variables = (*system.q, *system.p, *filter(None, (system.time,)))
    placeholders = {
        x: placeholder(index, symbols is variables, frozenset(x.assumptions0.items()))
        for symbols in (variables, system.parameters) for index, x in enumerate(symbols)}
    symbol_of = {stand_in: x for x, stand_in in placeholders.items()}
    forms = CanonicalForms()

    def with_symbols(e: sp.Expr, original: sp.Expr) -> sp.Expr:
        return substitute([with_floats(e, original)], symbol_of)[0]

    def canonical_expression(e: sp.Expr) -> sp.Expr:
        return with_symbols(forms.expression(substitute([e], placeholders)[0]), e)

    v = system.velocities
    velocity_constraints = tuple(  # A v + a
        sp.Add(canonical_expression(affine),
               *(canonical_expression(e) * x for e, x in zip(row, v, strict=True)))
        for row, affine in zip(system.A, system.a, strict=True))
    g = tuple(map(canonical_expression, system.constraints))
    # T keeps its original form: expanded, it would lose its short sums of velocities
    if isinstance(system, LagrangianSystem):
        return replace(system, constraints=g, velocity_constraints=velocity_constraints)
    q, p = ([placeholders[x] for x in symbols] for symbols in (system.q, system.p))
    hamiltonian, *forces = substitute([system.H, *system.forces], placeholders)
    H = HamiltonianTerms(forms, q, p, hamiltonian)
    F = ForceTerms(forms, H.support, forces)
    return replace(
        system,
        H=with_symbols(H.sum(), system.H),
        constraints=g,
        velocity_constraints=velocity_constraints,
        forces=tuple(with_symbols(e, original)
                     for e, original in zip(F.rows(), system.forces, strict=True)),
        quantities={name: canonical_expression(e) for name, e in system.quantities.items()},
        time_scale=(None if system.time_scale is None
                    else canonical_expression(system.time_scale)),
    )


def with_floats(e: sp.Expr, original: sp.Expr) -> sp.Expr:
    """Return e with decimals in place of long fractions, if the original expression has decimals.

    Decimals are exact fractions until then: 0.5 and 1/2 are one number, and a sum of decimals is
    the same in any order.
    """
    bits = max((x._prec for x in original.atoms(sp.Float)), default=0)
    return e if not bits else e.xreplace({
        x: sp.Float(x, precision=bits) for x in e.atoms(sp.Rational)
        if max(abs(x.p), x.q) > _LONGEST})
