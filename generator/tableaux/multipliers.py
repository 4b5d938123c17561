"""M = Ā Ã, the effect of the multipliers of a step on the constraints at its nodes.

To leading order g(Q̃_l) changes by −h² Σ_j M_lj W Λ_j for l = 1..p and j = 0..p−1, with
W = g_q H_pp g_qᵀ. The multipliers are determined if and only if M is regular: not with more
constraint intervals than stages (the rank of M is at most s), and not with b̃_j = 0 for a j < p,
which makes column j of a symplectic Ã vanish.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache

import mpmath as mp

from .tableau import Tableau

__all__ = ["multiplier_condition", "multiplier_inverse"]

#: Condition number from which M counts as singular: decimals give M to about 12 digits.
_LARGEST_CONDITION = mp.mpf(10) ** 12
_DIGITS = 100


@cache
def multiplier_inverse(tableau: Tableau) -> mp.matrix | None:
    """Return M⁻¹ at 100 digits; None if M is singular."""
    if multiplier_condition(tableau) >= _LARGEST_CONDITION:
        return None
    with mp.workdps(_DIGITS):
        return _multiplier_matrix(tableau) ** -1


@cache
def multiplier_condition(tableau: Tableau) -> mp.mpf:
    """Return the condition number of M, largest over smallest singular value; inf if singular."""
    with mp.workdps(_DIGITS):
        singular_values = mp.svd_r(_multiplier_matrix(tableau), compute_uv=False)
        largest, smallest = max(singular_values), min(singular_values)
        # below the round-off of the decomposition a singular value counts as 0
        return largest / smallest if smallest > largest * mp.eps * 2**16 else mp.inf


def _multiplier_matrix(tableau: Tableau) -> mp.matrix:
    """Return M = Ā Ã, p × p for p constraint intervals, by which g depends on the multipliers.

    Rows are the constraint nodes l = 1..p, columns the multipliers j = 0..p − 1.
    """
    tables, p = tableau.map_enclosures(lambda e: e.centre), tableau.p
    M = mp.matrix(p, p)
    # node 0 is the start of the step, where row 0 of Ā is 0; Λ_p acts at the end alone
    for row, A_bar_row in enumerate(tables["A_bar"][1:]):
        for j in range(p):
            products = (a_bar * A_tilde_row[j]
                        for a_bar, A_tilde_row in zip(A_bar_row, tables["A_tilde"], strict=True))
            entry = sum(products, Fraction(0))
            M[row, j] = mp.mpf(entry.numerator) / entry.denominator
    return M
