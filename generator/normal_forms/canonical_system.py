"""One form for all spellings: a system whose H, g and F look as if nobody had written them.

    (Σ p_i²)/(2m),   Σ p_i²/(2m),   (p_1² m_2 + p_2² m_1)/(2 m_1 m_2),   m (a + b)²/2,   …

1. Everything is multiplied out (``expansion``): what is left is the same for all spellings.
2. The terms are taken apart into pieces (``additive_terms``): H into the kinetic energies of its
   cells and into potentials of coordinates that depend on each other. So a sum over bodies is a sum
   of their terms, whatever stood before it.
3. Each piece gets its shortest form (``shortest_sum``), found from its terms alone.

What was written is looked at for one thing: where multiplying out takes too long, or has lost a
form that costs clearly less and is not found again, the piece stays as it was written, but for the
order and the numbers in it (``canonical_expressions``).
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import sympy as sp

from ..systems.lagrangian import LagrangianSystem
from ..systems.system import System
from .additive_terms import ForcePieces, HamiltonianPieces
from .canonical_expressions import Forms
from .terms import stand_in

__all__ = ["canonical"]

#: Numerators and denominators beyond this come from decimals such as 0.1.
_LONGEST = 2**20


@lru_cache(maxsize=16)
def canonical(system: System) -> System:
    """Return the system with H, g, F and quantities in their canonical form.

    Symbols are ordered by their places in q, p and the parameters, not by their names.
    """
    moving = (*system.q, *system.p, *filter(None, (system.time,)))
    stand_ins = {x: stand_in(at, side is moving, frozenset(x.assumptions0.items()))
                 for side in (moving, system.parameters) for at, x in enumerate(side)}
    names = {x: own for own, x in stand_ins.items()}
    forms = Forms()

    def named(found: sp.Expr, written: sp.Expr) -> sp.Expr:
        return with_floats(found, written).xreplace(names)

    def by_itself(e: sp.Expr) -> sp.Expr:
        return named(forms.expression(e.xreplace(stand_ins)), e)

    if isinstance(system, LagrangianSystem):  # what is written is short: T of sums of velocities
        return replace(system, constraints=tuple(map(by_itself, system.constraints)))
    q, p = ([stand_ins[x] for x in side] for side in (system.q, system.p))
    H = HamiltonianPieces(forms, q, p, system.H.xreplace(stand_ins))
    F = ForcePieces(forms, H.reach, [e.xreplace(stand_ins) for e in system.forces])
    return replace(
        system,
        H=named(H.sum(), system.H),
        constraints=tuple(map(by_itself, system.constraints)),
        forces=tuple(named(e, old) for e, old in zip(F.rows(), system.forces, strict=True)),
        quantities={name: by_itself(e) for name, e in system.quantities.items()},
    )


def with_floats(found: sp.Expr, written: sp.Expr) -> sp.Expr:
    """Return decimals in place of long fractions where decimals were written.

    In between they are fractions, exactly: 0.5 and 1/2 are one number, and so is a sum of decimals
    in any order.
    """
    bits = max((x._prec for x in written.atoms(sp.Float)), default=0)
    return found if not bits else found.xreplace({
        x: sp.Float(x, precision=bits) for x in found.atoms(sp.Rational)
        if max(abs(x.p), x.q) > _LONGEST})
