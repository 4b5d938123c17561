"""V = (v_il): weights of the constraint forces in the momenta at which velocity rows are asked.

    P̃_i = p_k + h Σ_j ā_ij k̂_j − h Σ_l v_il g_q(Q̃_l)ᵀ Λ_l,   A(Q̃_i) H_p(Q̃_i, P̃_i) + a(Q̃_i) = 0

for i = 1..p, with the reactions −A(Q_j)ᵀ M_j of the stages in k̂_j. V integrates from 0 to c̃_i the
polynomials of degree p through all p + 1 constraint nodes, so that C(p + 1) holds: on Lobatto nodes
it is the matrix of Lobatto IIIA. The row that continues Ã, b̃_0 in its first column and 0 in its
last, satisfies C(p − 1) alone, and a run with g and A has the order 2, 2, 4 for s = 1, 2, 3.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from ...core.errors import TableauError
from .enclosures import enclose_part
from .families import solve_rows
from .nodes import BITS, Enclosure
from .tableau import Tableau

__all__ = ["refusal_of_velocity_rows", "velocity_enclosures", "velocity_matrix"]

Matrix = Any  # DomainMatrix; SymPy ships no types


def refusal_of_velocity_rows(tableau: Tableau) -> str:
    """Return why a tableau takes no velocity rows; "" if it does.

    As many rows as stages have multipliers: p = s, which leaves out Lobatto IIIA-B.
    """
    if tableau.given:
        return f"tableau {tableau.name!r} is given in numbers"
    if tableau.p != tableau.s:
        return (f"tableau {tableau.name!r} has {tableau.s} stages for multipliers of velocity "
                f"constraints and {tableau.p} nodes at which these hold")
    return ""


@cache
def velocity_matrix(tableau: Tableau) -> Matrix:
    """Return V over the constraint nodes, (p + 1) × (p + 1).

    Raises
    ------
    TableauError
        If the tableau takes no velocity rows.
    """
    refusal = refusal_of_velocity_rows(tableau)
    if refusal:
        raise TableauError(f"There is no V: {refusal}; take G-L or Radau-L.")
    return solve_rows(tableau.constraints, tableau.constraints, tableau.p + 1)


def velocity_enclosures(tableau: Tableau) -> tuple[tuple[Enclosure, ...], ...]:
    """Return the entries of V as certified enclosures."""
    nodes = [tableau.constraints, tableau.constraints]
    return enclose_part(velocity_matrix(tableau).to_list(), nodes, BITS)
