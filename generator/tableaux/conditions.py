"""Conditions of a tableau: for each a residual, and a predicate derived from the residual.

    B(k)   Σ_i b_i c_i^{k−1} = 1/k                       (A.8), B̃ (A.10)
    C(k)   Σ_j a_ij c_j^{k−1} = c_i^k/k                  (A.8), Ĉ (A.9), C̃ (A.11), C̄ (A.12)
    D(k)   Σ_i b_i c_i^{k−1} a_ij = b_j (1 − c_j^k)/k    Butcher's D, for each of the four
    symplectic   b_i â_ij + b̂_j a_ji = b_i b̂_j,   b_i ã_ij + b̃_j ā_ji = b_i b̃_j    (erratum 13)
    symmetric    a_{s+1−i,s+1−j} + a_ij = b_j             for each of the four
    stability    R(z) of a fast decay, and its limit      ``stability``
    V            of velocity constraints                  ``velocity_conditions``

Residuals are exact: zero is proved, not measured (``node_algebra``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from typing import Any

import mpmath as mp
import sympy as sp

from ...core.records import dataclass
from .energy_parameter import with_energy_parameter
from .multipliers import multiplier_condition, multiplier_inverse
from .node_algebra import Nodes, column, magnitude, power
from .separation_bounds import Rounding, vanishes_to
from .stability import stability
from .tableau import Tableau

__all__ = ["Condition", "check_tableau", "energy_conditions", "invariant_conditions", "order",
           "remarks", "velocity_conditions"]

Matrix = Any

#: The four coefficient matrices: label, weights on its rows and weights on its columns.
MATRICES = {
    "A": ("C", "b", "b"),
    "A_hat": ("C_hat", "b_hat", "b_hat"),
    "A_tilde": ("C_tilde", "b", "b_tilde"),
    "A_bar": ("C_bar", "b_tilde", "b"),
}
LABELS = {"C": "C", "C_hat": "Ĉ", "C_tilde": "C̃", "C_bar": "C̄",
          "B": "B", "B_hat": "B̂", "B_tilde": "B̃"}
_EQUATIONS = {"C": "Σ a c^(k−1) = c^k/k", "C_hat": "Σ â c^(k−1) = c^k/k",
              "C_tilde": "Σ ã c̃^(k−1) = c^k/k", "C_bar": "Σ ā c^(k−1) = c̃^k/k",
              "B": "Σ b c^(k−1) = 1/k", "B_hat": "Σ b̂ c^(k−1) = 1/k",
              "B_tilde": "Σ b̃ c̃^(k−1) = 1/k"}
_ADJOINT_EQUATIONS = {"C": "Σ_i b_i c_i^(k−1) a_ij = b_j (1 − c_j^k)/k",
                      "C_hat": "Σ_i b̂_i c_i^(k−1) â_ij = b̂_j (1 − c_j^k)/k",
                      "C_tilde": "Σ_i b_i c_i^(k−1) ã_ij = b̃_j (1 − c̃_j^k)/k",
                      "C_bar": "Σ_i b̃_i c̃_i^(k−1) ā_ij = b_j (1 − c_j^k)/k"}
D_LABELS = {"C": "D", "C_hat": "D̂", "C_tilde": "D̃", "C_bar": "D̄"}


@dataclass(frozen=True)
class Condition:
    """One line of the report on a tableau.

    ``required`` conditions make the step well defined and satisfy its constraints, or are claims
    of the family or the file; the others are properties that a method may lack. ``found`` is the
    result, ``holds`` whether it is as required or as claimed. ``residual`` is "0" if proved zero,
    "0 to 16 digits" if zero to the precision of decimals, else its largest entry as a number.
    """

    name: str
    equation: str
    found: str
    holds: bool
    residual: str
    required: bool = False


# ---------------------------------------------------------------- residuals


def quadrature_residual(nodes: Nodes, b: Matrix, k: int) -> Matrix:
    """B(k): Σ_i b_i c_i^{k−1} − 1/k, 1 × 1."""
    total = b.transpose() * (nodes.trace * power(nodes, k - 1))
    return total - column([_fraction(nodes, 1, k)], nodes.domain)


def stage_residual(rows: Nodes, columns: Nodes, a: Matrix, k: int) -> Matrix:
    """C(k): Σ_j a_ij c_j^{k−1} − c_i^k/k, a function of the row node."""
    return a * (columns.trace * power(columns, k - 1)) - power(rows, k) * _fraction(rows, 1, k)


def adjoint_residual(
    rows: Nodes, columns: Nodes, a: Matrix, b_rows: Matrix, b_columns: Matrix, k: int
) -> Matrix:
    """D(k): Σ_i b_i c_i^{k−1} a_ij − b_j (1 − c_j^k)/k, a function of the column node."""
    weighted = a.transpose() * (rows.trace * (rows.multiply(b_rows) * power(rows, k - 1)))
    target = b_columns - columns.multiply(b_columns) * power(columns, k)
    return weighted - target * _fraction(columns, 1, k)


def symplectic_residual(
    rows: Nodes, columns: Nodes, a: Matrix, a_back: Matrix, b_rows: Matrix, b_columns: Matrix
) -> Matrix:
    """b_i a_ij + b_j a'_ji − b_i b_j with a' = ``a_back``, a function of row and column node."""
    return (
        rows.multiply(b_rows) * a
        + (columns.multiply(b_columns) * a_back).transpose()
        - b_rows * b_columns.transpose()
    )


def symmetry_residual(rows: Nodes, columns: Nodes, a: Matrix, b_columns: Matrix) -> Matrix | None:
    """a(1−c_i, 1−c_j) + a(c_i, c_j) − b_j; None when the nodes are not symmetric."""
    if rows.reflection is None or columns.reflection is None:
        return None
    mirrored = rows.reflection * a * columns.reflection.transpose()
    return mirrored + a - rows.one * b_columns.transpose()


def _fraction(nodes: Nodes, numerator: int, denominator: int) -> Any:
    """Return a rational number in the domain of the matrices of some nodes."""
    return nodes.domain.from_sympy(sp.Rational(numerator, denominator))


# ---------------------------------------------------------------- zero or not


def is_zero(residual: Matrix, tableau: Tableau) -> bool:
    """Whether every entry vanishes: proved exactly, or to the digits a decimal file gives."""
    if residual.domain.is_QQ:
        return bool(residual.is_zero_matrix)
    return all(_entry_is_zero(entry, tableau.rounding) for entry in residual.to_list_flat())


@cache
def _entry_is_zero(entry: sp.Expr, rounding: Rounding | None) -> bool:
    """Whether an entry is zero, cached, as the same entries occur in several conditions."""
    return vanishes_to(entry, rounding)


# ---------------------------------------------------------------- counts and order


def holds_to(residual: Callable[[int], Matrix], tableau: Tableau, limit: int) -> int:
    """Return the largest k ≤ limit such that residual(1), …, residual(k) are zero."""
    for k in range(1, limit + 1):
        if not is_zero(residual(k), tableau):
            return k - 1
    return limit


@cache
def counts(tableau: Tableau) -> dict[str, int]:
    """Return the largest k of B(k), C(k) and D(k): {"B": 6, "C_hat": 3, "D_bar": 3, …}.

        B(k)   Σ_i b_i c_i^(l−1) = 1/l
        C(k)   Σ_j a_ij c_j^(l−1) = c_i^l/l
        D(k)   Σ_i b_i c_i^(l−1) a_ij = b_j (1 − c_j^l)/l,   each for l = 1..k

    with the weights and nodes that belong to each of A, Â, Ã and Ā.
    """
    t, basis = tableau, tableau.basis
    limit = 2 * max(t.s, t.p) + 2  # no quadrature with so many nodes is more exact
    largest_k: dict[str, int] = {}
    for label, weights, nodes in (("B", "b", t.stages), ("B_hat", "b_hat", t.stages),
                                  ("B_tilde", "b_tilde", t.constraints)):
        largest_k[label] = holds_to(partial(quadrature_residual, nodes, basis[weights]), t, limit)
    for name, (label, b_rows, b_columns) in MATRICES.items():
        rows, columns = t.nodes_of(name)
        a, b_row, b_column = basis[name], basis[b_rows], basis[b_columns]
        largest_k[label] = holds_to(partial(stage_residual, rows, columns, a), t, limit)
        largest_k[label.replace("C", "D")] = holds_to(
            partial(adjoint_residual, rows, columns, a, b_row, b_column), t, limit
        )
    return largest_k


def order(tableau: Tableau, *, constrained: bool = True) -> int:
    """Return the order that B, C and D of the four coefficient matrices guarantee.

    Without ``constrained``, only A and Â count.

    By Butcher's theorem order = min(B, C + D + 1, 2C + 2), which Jay extended to partitioned and
    constrained systems (SIAM J. Numer. Anal. 45, 2007); the order of a symmetric method is even.
    The conditions are sufficient: a method may have a higher order. ``observed_order`` measures it
    on a test problem.
    """
    bound = min(bound for bound, _ in _bounds(tableau, constrained))
    return bound + bound % 2 if is_symmetric(tableau) else bound


def _bounds(tableau: Tableau, constrained: bool = True) -> list[tuple[int, str]]:
    """Return the bounds of the order, each with its conditions as text."""
    k = counts(tableau)
    quadratures, stage_conditions = ["B", "B_hat"], ["C", "C_hat"]
    if constrained:
        quadratures.append("B_tilde")
        stage_conditions += ["C_tilde", "C_bar"]
    bounds = [(2 * tableau.s, "2s")]  # in decimals B may seem to hold beyond
    bounds += [(k[label], LABELS[label]) for label in quadratures]
    for label in stage_conditions:
        c, d = k[label], k[label.replace("C", "D")]
        bounds += [(c + d + 1, f"{LABELS[label]}({c}) and {D_LABELS[label]}({d})"),
                   (2 * c + 2, f"{LABELS[label]}({c})")]
    return bounds


# ---------------------------------------------------------------- the report


def check_tableau(tableau: Tableau) -> list[Condition]:
    """Return every condition with its result, in the order of reports."""
    return list(_conditions_of(tableau))


@cache
def _conditions_of(tableau: Tableau) -> tuple[Condition, ...]:
    """Return all conditions of a tableau, each with its residual."""
    largest_k = counts(tableau)  # of B(k), C(k) and D(k)
    lines = (
        *_structure_conditions(tableau),
        _multipliers_condition(tableau),
        *_symplectic_conditions(tableau),
        *(_counted_condition(tableau, label, largest_k) for label in LABELS),
        *(_adjoint_condition(label, largest_k) for label in D_LABELS),
        _symmetry_condition(tableau),
        _stability_condition(tableau),
        _order_condition(tableau),
    )
    if tableau.decimal_digits is None:
        return lines
    size = f"0 to {tableau.decimal_digits} digits"  # rounded numbers prove no more
    return tuple(replace(line, residual=size) if line.residual == "0" else line for line in lines)


def remarks(tableau: Tableau, *, constrained: bool = True) -> list[str]:
    """Return short clauses about a given tableau.

    They name the required conditions that fail, the properties it lacks, and the conditions that
    limit its order.
    """
    clauses = []
    for line in check_tableau(tableau):
        clause = f"{line.name} ({line.equation}; {_residual_text(line)})"
        if line.required and not line.holds:
            clauses.append(f"violates {clause}")
        elif line.name.startswith(("symplectic", "symmetric")) and line.found != "yes":
            clauses.append(f"not {clause}")
    # b alone permits the order of its quadrature; other conditions may limit it further
    quadrature = counts(tableau)["B"]
    proved = tableau.order if constrained else tableau.free_order
    if proved < quadrature:
        bounds = _bounds(tableau, constrained)
        lowest = min(bound for bound, _ in bounds)
        limits = dict.fromkeys(text for bound, text in bounds if bound == lowest)
        clauses.append(f"order {proved} is proved, although b is exact to order {quadrature}: "
                       f"limited by {', '.join(limits)}")
    return clauses


def _residual_text(line: Condition) -> str:
    """Return "residual 0.1", or the residual itself if it is a word."""
    return f"residual {line.residual}" if line.residual[:1].isdigit() else line.residual


def _structure_conditions(tableau: Tableau) -> list[Condition]:
    """Check the separation of T1 and T2: Q̃_0 = q_k, Q̃_p = q_{k+1}, and Λ_p occurs only in T2."""
    t, basis = tableau, tableau.basis
    a_bar, a_tilde = basis["A_bar"], basis["A_tilde"]
    # matrices are functions of the nodes: rows at c̃_0 and c̃_p
    first, last = t.constraints.at(0), t.constraints.at(-1)
    c_tilde = basis["c_tilde"]
    # equation, residual, nodes of its rows and of its columns: None where these are numbers
    lines = [
        ("ā_0j = 0", first * a_bar, None, t.stages),
        ("ā_pj = b_j", last * a_bar - basis["b"].transpose(), None, t.stages),
        ("ã_ip = 0", a_tilde * last.transpose(), t.stages, None),
        ("c_i are the nodes", basis["c"] - power(t.stages, 1), t.stages, None),
        ("c̃_i are the nodes", c_tilde - power(t.constraints, 1), t.constraints, None),
        ("c̃_0 = 0", first * c_tilde, None, None),
        ("c̃_p = 1", last * c_tilde - column([t.stages.domain.one], t.stages.domain), None, None),
    ]
    return [
        _condition(t, equation, equation, residual, rows, columns, required=True)
        for equation, residual, rows, columns in lines
    ]


def _multipliers_condition(tableau: Tableau) -> Condition:
    """Check M = Ā Ã, which is regular if T1 determines the multipliers."""
    size = multiplier_condition(tableau)
    regular = multiplier_inverse(tableau) is not None
    return Condition(
        "multipliers",
        "det M ≠ 0, M_lj = Σ_i ā_li ã_ij, l = 1..p, j = 0..p−1",
        found=f"condition number {mp.nstr(size, 3)}" if regular else "M is singular",
        holds=regular,
        residual="0" if regular else "singular",
        required=True,
    )


def _symplectic_conditions(tableau: Tableau) -> list[Condition]:
    """Check symplecticity of the map, which is required if claimed, and reported otherwise."""
    t, basis = tableau, tableau.basis
    forces = symplectic_residual(t.stages, t.stages, basis["A_hat"], basis["A"], basis["b"],
                                 basis["b_hat"])
    constraints = symplectic_residual(t.stages, t.constraints, basis["A_tilde"], basis["A_bar"],
                                      basis["b"], basis["b_tilde"])
    lines = [_condition(t, "symplectic, forces", "b_i â_ij + b̂_j a_ji = b_i b̂_j", forces,
                        t.stages, t.stages, required=False),
             _condition(t, "symplectic, constraints", "b_i ã_ij + b̃_j ā_ji = b_i b̃_j",
                        constraints, t.stages, t.constraints, required=False)]
    # 0: the family or the file says that the map is not symplectic, which is no violation
    claimed = t.claims.get("symplectic")
    return [replace(line, holds=line.holds or claimed == 0, required=bool(claimed))
            for line in lines]


def invariant_conditions(tableau: Tableau) -> list[Condition]:
    """Return conditions for conserving every quadratic invariant of (q, p), without constraints.

    The pair (A, Â) conserves invariants that are bilinear in q and p (Sanz-Serna, Abia), A and Â
    alone conserve quadratic invariants of q and of p (Cooper).
    """
    t, basis, s = tableau, tableau.basis, tableau.stages
    # equation, residual, nodes of its columns: None of a vector
    lines = [
        ("b_i = b̂_i", basis["b"] - basis["b_hat"], None),
        ("b_i â_ij + b̂_j a_ji = b_i b̂_j",
         symplectic_residual(s, s, basis["A_hat"], basis["A"], basis["b"], basis["b_hat"]), s),
        ("b_i a_ij + b_j a_ji = b_i b_j",
         symplectic_residual(s, s, basis["A"], basis["A"], basis["b"], basis["b"]), s),
        ("b̂_i â_ij + b̂_j â_ji = b̂_i b̂_j",
         symplectic_residual(s, s, basis["A_hat"], basis["A_hat"], basis["b_hat"],
                             basis["b_hat"]), s),
    ]
    return [_condition(t, equation, equation, residual, s, columns, required=False)
            for equation, residual, columns in lines]


def velocity_conditions(tableau: Tableau, V: Matrix) -> list[Condition]:
    """Return the conditions of V, the matrix of velocity constraints (``velocity_rows``).

    The order 2s requires C(p + 1) of V, in addition to the conditions of the tableau.
    """
    t, basis, nodes = tableau, tableau.basis, tableau.constraints
    first, last = nodes.at(0), nodes.at(-1)
    # row 0 of Ā is 0: rows 1..p decide the rank
    is_regular = basis["A_bar"].rank() == t.s and is_zero(first * basis["A_bar"], t)
    required_k = t.p + 1
    k = holds_to(partial(stage_residual, nodes, nodes, V), t, required_k + 1)
    residual = "0"
    if k < required_k:
        size = magnitude(stage_residual(nodes, nodes, V, k + 1), nodes, columns=None)
        residual = mp.nstr(size, 5)
    lines = [
        _condition(t, "v_0l = 0", "v_0l = 0", first * V, rows=None, columns=nodes, required=True),
        _condition(t, "v_pl = b̃_l", "v_pl = b̃_l", last * V - basis["b_tilde"].transpose(),
                   rows=None, columns=nodes, required=True),
        Condition("C of V", f"Σ v c̃^(k−1) = c̃^k/k, k ≤ {required_k}",
                  found=f"holds to k = {k}", holds=k >= required_k, residual=residual,
                  required=True),
        # Ā is regular: a polynomial of degree s that vanishes at 0 and at c̃_1..c̃_p is 0.
        Condition("reactions", "det ā_ij ≠ 0, i = 1..p, j = 1..s",
                  found="Ā is regular" if is_regular else "Ā is singular", holds=is_regular,
                  residual="0" if is_regular else "singular", required=True),
    ]
    mirrored = symmetry_residual(nodes, nodes, V, basis["b_tilde"])
    if is_symmetric(t) and mirrored is not None:
        lines.append(_condition(t, "V symmetric", "v_(p−i,p−l) + v_il = b̃_l", mirrored, nodes,
                                nodes, required=True))
    return lines


def energy_conditions(tableau: Tableau) -> list[Condition]:
    """Return the conditions for all θ₀ and θ₁ of exact energy (``energy_parameter``).

    Each condition is affine in (θ₀, θ₁): it holds for all if it does at (0, 0), (1, 0) and (0, 1).
    With fixed numbers the method has order 2s − 2, so that ∂(q, p)/∂θ = O(Δt^{2s−1}) after a step;
    θ = O(Δt²) changes the step by O(Δt^{2s+1}) and leaves the order 2s. M = ĀÃ is regular at θ = 0,
    and so for small θ.
    """
    tableaux = [tableau, *(with_energy_parameter(tableau, theta) for theta in ((1, 0), (0, 1)))]
    reports = [{line.name: line for line in check_tableau(t)} for t in tableaux]
    lines: list[Condition] = []
    for name, line in reports[0].items():
        # conditions on the entries of Ā and Ã have their equations as names
        if name.startswith(("symplectic", "symmetric", "ā", "ã")):
            holds = all(report[name].found == "yes" for report in reports)
            lines.append(replace(line, name=f"{name}, every θ", required=True,
                                 found="yes" if holds else "no", holds=holds))
    fixed_order = min(t.order for t in tableaux)
    # θ = O(Δt²) adds two orders to those of fixed numbers
    proved = min(tableau.order, fixed_order + 2)
    return [
        *lines,
        Condition("order, fixed θ", f"2s − 2 = {2 * tableau.s - 2}", found=str(fixed_order),
                  holds=fixed_order >= 2 * tableau.s - 2, residual="0", required=True),
        Condition("order, θ = O(Δt²)", f"2s = {2 * tableau.s}", found=str(proved),
                  holds=proved == 2 * tableau.s, residual="0", required=True),
    ]


def _counted_condition(tableau: Tableau, label: str, largest_k: dict[str, int]) -> Condition:
    """Check a quadrature or stage condition: the largest k, and the residual at k + 1.

    ``label`` is B, B_hat, … or C, C_hat, …; ``largest_k`` has the k of each. The condition holds if
    k is as large as the tableau claims, or without a claim as large as consistency needs.
    """
    k = largest_k[label]
    claim = tableau.claims.get(label)
    # Consistency requires k ≥ 1, except of (A.9) and (A.11): 2-stage IIIB has k = 0.
    minimum = 0 if label in ("C_hat", "C_tilde") else 1
    required_k = minimum if claim is None else claim
    size = _residual_size(tableau, label, k + 1)
    return Condition(
        LABELS[label],
        f"{_EQUATIONS[label]}, required to k = {required_k}",
        found=f"holds to k = {k}, at k = {k + 1} off by {mp.nstr(size, 3)}",
        holds=k >= required_k,
        residual="0" if k >= required_k else mp.nstr(size, 5),
        required=True,
    )


def _residual_size(tableau: Tableau, label: str, k: int) -> mp.mpf:
    """Return the largest |entry| of the residual of B(k), C(k), …, by ``label``."""
    t, basis = tableau, tableau.basis
    if label.startswith("B"):
        weights = basis[label.replace("B", "b")]
        nodes = t.constraints if label == "B_tilde" else t.stages
        return magnitude(quadrature_residual(nodes, weights, k), rows=None, columns=None)
    name = label.replace("C", "A")
    rows, columns = t.nodes_of(name)
    return magnitude(stage_residual(rows, columns, basis[name], k), rows, columns=None)


def _adjoint_condition(label: str, largest_k: dict[str, int]) -> Condition:
    """Return the largest k of D for the matrix with the stage condition ``label``."""
    k = largest_k[label.replace("C", "D")]
    return Condition(D_LABELS[label], _ADJOINT_EQUATIONS[label], f"holds to k = {k}", holds=True,
                     residual="0")  # no k is required


def is_symmetric(tableau: Tableau) -> bool:
    """Whether step(−h) is the inverse of step(h)."""
    return all(residual is not None and is_zero(residual, tableau)
               for residual, _, _ in _symmetry_residuals(tableau))


def _symmetry_residuals(tableau: Tableau) -> Iterator[tuple[Matrix | None, Nodes, Nodes]]:
    """Yield the residual of symmetry of each matrix, with its rows' and columns' nodes."""
    basis = tableau.basis
    for name, (_, _, b_columns) in MATRICES.items():
        rows, columns = tableau.nodes_of(name)
        yield symmetry_residual(rows, columns, basis[name], basis[b_columns]), rows, columns


def _symmetry_condition(tableau: Tableau) -> Condition:
    """Return the condition of symmetry in time, with the largest residual."""
    residuals = list(_symmetry_residuals(tableau))
    has_symmetric_nodes = all(residual is not None for residual, _, _ in residuals)
    sizes = [magnitude(residual, rows, columns) for residual, rows, columns in residuals
             if residual is not None and not is_zero(residual, tableau)]
    holds = has_symmetric_nodes and not sizes
    if not has_symmetric_nodes:
        size = "the nodes are not"
    else:
        size = mp.nstr(max(sizes), 5) if sizes else "0"
    claimed = tableau.claims.get("symmetric")
    return Condition(
        "symmetric",
        "a_(s+1−i,s+1−j) + a_ij = b_j for A, Â, Ã, Ā",
        found="yes" if holds else "no",
        holds=holds or not claimed,
        residual=size,
        required=bool(claimed),
    )


def _stability_condition(tableau: Tableau) -> Condition:
    """Check A- and L-stability, by the stability function R(z).

    A tableau that claims L-stability must be L-stable with constraints as well as without.
    """
    R, claimed = stability(tableau), bool(tableau.claims.get("L_stable"))
    is_l_stable = R is not None and R.l_stable and R.holds_with_constraints
    # if Â ≠ A, q and p have different methods, and no single function R describes the step
    text = "none: Â is not A" if R is None else str(R)
    if R is not None and not R.holds_with_constraints:
        text += ", without constraints"
    holds = is_l_stable or not claimed
    return Condition("stability", "R(z) = det(I − zA + z1bᵀ)/det(I − zA)", found=text, holds=holds,
                     residual="0" if holds else text, required=claimed)


def _order_condition(tableau: Tableau) -> Condition:
    """Return the condition of order: the proved one, compared with the claimed one."""
    proved = tableau.order
    claimed = tableau.claims.get("order")
    return Condition(
        "order",
        "min(B, C + D + 1, 2C + 2), raised to an even number if symmetric"
        + ("" if claimed is None else f", = {claimed}"),
        found=str(proved),
        holds=proved >= 1 and claimed in (None, proved),
        residual=str(proved - (claimed or max(proved, 1))),  # without a claim, order 1 is required
        required=True,
    )


def _condition(
    tableau: Tableau, name: str, equation: str, residual: Matrix,
    rows: Nodes | None, columns: Nodes | None, *, required: bool,
) -> Condition:
    """Return a condition with its residual: exact 0, or the largest entry at the nodes as text."""
    holds = is_zero(residual, tableau)
    size = "0" if holds else mp.nstr(magnitude(residual, rows, columns), 5)
    return Condition(name, equation, found="yes" if holds else "no", holds=holds, residual=size,
                     required=required)
