"""Conditions of a tableau: a residual each, and a predicate derived from it.

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
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import mpmath as mp
import sympy as sp

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
D_LABELS = {"C": "D", "C_hat": "D̂", "C_tilde": "D̃", "C_bar": "D̄"}


@dataclass(frozen=True)
class Condition:
    """One line of the report on a tableau.

    ``required`` conditions make the step well defined and keep its constraints, or are what the
    family (or the file) says of itself; the others are properties that a method may lack.
    ``found`` is the result, ``holds`` whether it is as required or as claimed.
    ``residual`` is "0" where it was proved zero, "0 to 16 digits" where it is as far as decimals
    can say, else its largest entry as a number.
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
    """b_i a_ij + b_j a'_ji − b_i b_j, a function of row and column node."""
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
    return nodes.domain.from_sympy(sp.Rational(numerator, denominator))


# ---------------------------------------------------------------- zero or not


def is_zero(residual: Matrix, tableau: Tableau) -> bool:
    """Whether every entry vanishes: proved exactly, or to the digits a decimal file gives."""
    if residual.domain.is_QQ:
        return bool(residual.is_zero_matrix)
    return all(_entry_is_zero(entry, tableau.rounding) for entry in residual.to_list_flat())


@cache
def _entry_is_zero(entry: sp.Expr, rounding: Rounding | None) -> bool:
    return vanishes_to(entry, rounding)


# ---------------------------------------------------------------- counts and order


def holds_to(residual: Callable[[int], Matrix], tableau: Tableau, limit: int) -> int:
    """Return the largest k ≤ limit with residual(1), …, residual(k) all zero."""
    for k in range(1, limit + 1):
        if not is_zero(residual(k), tableau):
            return k - 1
    return limit


@cache
def counts(tableau: Tableau) -> dict[str, int]:
    """Return how far B, C and D hold for each part, e.g. {"B": 6, "C_hat": 3, "D_bar": 3}."""
    t, part = tableau, tableau.basis
    limit = 2 * max(t.s, t.p) + 2
    found = {
        "B": holds_to(lambda k: quadrature_residual(t.stages, part["b"], k), t, limit),
        "B_hat": holds_to(lambda k: quadrature_residual(t.stages, part["b_hat"], k), t, limit),
        "B_tilde": holds_to(
            lambda k: quadrature_residual(t.constraints, part["b_tilde"], k), t, limit
        ),
    }
    for name, (label, b_rows, b_columns) in MATRICES.items():
        rows, columns = t.nodes_of(name)
        a, b_row, b_column = part[name], part[b_rows], part[b_columns]
        found[label] = holds_to(partial(stage_residual, rows, columns, a), t, limit)
        found[label.replace("C", "D")] = holds_to(
            partial(adjoint_residual, rows, columns, a, b_row, b_column), t, limit
        )
    return found


def order(tableau: Tableau, *, constrained: bool = True) -> int:
    """Return the order that B, C and D guarantee, for each of the four coefficient matrices.

    Without constraints A and Â alone count.

    Butcher's theorem, order = min(B, C + D + 1, 2C + 2), carried to partitioned and constrained
    systems by Jay (SIAM J. Numer. Anal. 45, 2007); the order of a symmetric method is even. A
    method may have a higher order than these conditions show: they are sufficient.
    ``observed_order`` measures it on a test problem, which is the second way to it.
    """
    bound = min(bound for bound, _ in _bounds(tableau, constrained))
    return bound + bound % 2 if is_symmetric(tableau) else bound


def _bounds(tableau: Tableau, constrained: bool = True) -> list[tuple[int, str]]:
    """Return every bound on the order with the conditions it comes from."""
    k = counts(tableau)
    bounds = [(2 * tableau.s, "2s")]  # in decimals B may seem to hold beyond
    bounds += [(k[label], LABELS[label]) for label in ("B", "B_hat", "B_tilde")[:2 + constrained]]
    for label, _, _ in [*MATRICES.values()][:4 if constrained else 2]:
        c, d = k[label], k[label.replace("C", "D")]
        bounds += [(c + d + 1, f"{LABELS[label]}({c}) and {D_LABELS[label]}({d})"),
                   (2 * c + 2, f"{LABELS[label]}({c})")]
    return bounds


# ---------------------------------------------------------------- the report


def check_tableau(tableau: Tableau) -> list[Condition]:
    """Return every condition with its result, in the order of reports."""
    return list(_checked(tableau))


@cache
def _checked(tableau: Tableau) -> tuple[Condition, ...]:
    found = counts(tableau)
    lines = (
        *_structure(tableau),
        _determined(tableau),
        *(_symplectic(tableau)),
        *(_range(tableau, label, found) for label in LABELS),
        _symmetric(tableau),
        _stability(tableau),
        _order(tableau),
    )
    if tableau.digits_given is None:
        return lines
    size = f"0 to {tableau.digits_given} digits"  # of rounded numbers no more can be known
    return tuple(replace(line, residual=size) if line.residual == "0" else line for line in lines)


def remarks(tableau: Tableau, *, constrained: bool = True) -> list[str]:
    """Return the properties a given tableau lacks: a short clause each.

    Required conditions that fail, properties it lacks, and what its order is limited by.
    """
    said = []
    for line in check_tableau(tableau):
        clause = f"{line.name} ({line.equation}; {_size(line)})"
        if line.required and not line.holds:
            said.append(f"violates {clause}")
        elif line.name.startswith(("symplectic", "symmetric")) and line.found != "yes":
            said.append(f"not {clause}")
    quadrature = counts(tableau)["B"]
    proved = tableau.order if constrained else tableau.free_order
    if proved < quadrature:
        bounds = _bounds(tableau, constrained)
        least = min(bound for bound, _ in bounds)
        limits = dict.fromkeys(text for bound, text in bounds if bound == least)
        said.append(f"order {proved} is proved, although b is exact to order {quadrature}: "
                    f"limited by {', '.join(limits)}")
    return said


def _size(line: Condition) -> str:
    """Return "residual 0.1", or the residual that is a word."""
    return f"residual {line.residual}" if line.residual[:1].isdigit() else line.residual


def _structure(tableau: Tableau) -> list[Condition]:
    """The conditions under which T1 and T2 separate: Q̃_0 = q_k, Q̃_p = q_{k+1}, Λ_p only in T2."""
    t, part = tableau, tableau.basis
    a_bar, a_tilde = part["A_bar"], part["A_tilde"]
    first, last = t.constraints.at(0), t.constraints.at(-1)
    c_tilde = part["c_tilde"]
    lines = [
        ("ā_0j = 0", first * a_bar, None, t.stages),
        ("ā_pj = b_j", last * a_bar - part["b"].transpose(), None, t.stages),
        ("ã_ip = 0", a_tilde * last.transpose(), t.stages, None),
        ("c_i are the nodes", part["c"] - power(t.stages, 1), t.stages, None),
        ("c̃_i are the nodes", c_tilde - power(t.constraints, 1), t.constraints, None),
        ("c̃_0 = 0", first * c_tilde, None, None),
        ("c̃_p = 1", last * c_tilde - column([t.stages.domain.one], t.stages.domain), None, None),
    ]
    return [
        _condition(t, equation, equation, residual, rows, columns, required=True)
        for equation, residual, rows, columns in lines
    ]


def _determined(tableau: Tableau) -> Condition:
    """The multipliers of T1 are determined: M = Ā Ã is regular."""
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


def _symplectic(tableau: Tableau) -> list[Condition]:
    """Check that the map is symplectic; a disclaimed property is reported, not required."""
    t, part = tableau, tableau.basis
    lines = [
        ("symplectic, forces", "b_i â_ij + b̂_j a_ji = b_i b̂_j",
         symplectic_residual(t.stages, t.stages, part["A_hat"], part["A"], part["b"],
                             part["b_hat"]), t.stages),
        ("symplectic, constraints", "b_i ã_ij + b̃_j ā_ji = b_i b̃_j",
         symplectic_residual(t.stages, t.constraints, part["A_tilde"], part["A_bar"], part["b"],
                             part["b_tilde"]), t.constraints),
    ]
    claimed = t.claims.get("symplectic")
    return [
        replace(line, holds=line.holds or claimed == 0, required=bool(claimed))
        for line in (_condition(t, name, equation, residual, t.stages, columns, required=False)
                     for name, equation, residual, columns in lines)
    ]


def invariant_conditions(tableau: Tableau) -> list[Condition]:
    """Return conditions for conserving every quadratic invariant of (q, p), without constraints.

    The pair of A and Â keeps those that are bilinear in q and p (Sanz-Serna, Abia), A alone and Â
    alone those in q and in p (Cooper).
    """
    t, part, s = tableau, tableau.basis, tableau.stages
    lines = [
        ("b_i = b̂_i", part["b"] - part["b_hat"], None),
        ("b_i â_ij + b̂_j a_ji = b_i b̂_j",
         symplectic_residual(s, s, part["A_hat"], part["A"], part["b"], part["b_hat"]), s),
        ("b_i a_ij + b_j a_ji = b_i b_j",
         symplectic_residual(s, s, part["A"], part["A"], part["b"], part["b"]), s),
        ("b̂_i â_ij + b̂_j â_ji = b̂_i b̂_j",
         symplectic_residual(s, s, part["A_hat"], part["A_hat"], part["b_hat"], part["b_hat"]), s),
    ]
    return [_condition(t, equation, equation, residual, s, columns, required=False)
            for equation, residual, columns in lines]


def velocity_conditions(tableau: Tableau, V: Matrix) -> list[Condition]:
    """Return the conditions of V, the matrix of velocity constraints (``velocity_rows``).

    C(p + 1) is what the order 2s takes beside those of the tableau.
    """
    t, part, nodes = tableau, tableau.basis, tableau.constraints
    first, last = nodes.at(0), nodes.at(-1)
    regular = part["A_bar"].rank() == t.s and is_zero(first * part["A_bar"], t)
    found = holds_to(partial(stage_residual, nodes, nodes, V), t, t.p + 2)
    wanted = t.p + 1
    lines = [
        _condition(t, "v_0l = 0", "v_0l = 0", first * V, None, nodes, required=True),
        _condition(t, "v_pl = b̃_l", "v_pl = b̃_l", last * V - part["b_tilde"].transpose(), None,
                   nodes, required=True),
        Condition("C of V", f"Σ v c̃^(k−1) = c̃^k/k, k ≤ {wanted}", f"holds to k = {found}",
                  found >= wanted, "0" if found >= wanted else mp.nstr(magnitude(
                      stage_residual(nodes, nodes, V, found + 1), nodes, None), 5), required=True),
        # A polynomial of degree s that vanishes at 0 and at c̃_1..c̃_p is 0.
        Condition("reactions", "det ā_ij ≠ 0, i = 1..p, j = 1..s",
                  "Ā is regular" if regular else "Ā is singular", regular,
                  "0" if regular else "singular", required=True),
    ]
    mirrored = symmetry_residual(nodes, nodes, V, part["b_tilde"])
    if is_symmetric(t) and mirrored is not None:
        lines.append(_condition(t, "V symmetric", "v_(p−i,p−l) + v_il = b̃_l", mirrored, nodes,
                                nodes, required=True))
    return lines


def energy_conditions(tableau: Tableau) -> list[Condition]:
    """Return what holds of the tableau for all θ₀ and θ₁ of exact energy (``energy_parameter``).

    Each condition is affine in (θ₀, θ₁): it holds for all if it does at (0, 0), (1, 0) and (0, 1).
    With fixed numbers the method has order 2s − 2, so that ∂(q, p)/∂θ = O(Δt^{2s−1}) after a step;
    θ = O(Δt²) changes the step by O(Δt^{2s+1}) and leaves the order 2s. M = ĀÃ is regular at θ = 0,
    and so for small θ.
    """
    at = [tableau, *(with_energy_parameter(tableau, theta) for theta in ((1, 0), (0, 1)))]
    lines = [{line.name: line for line in check_tableau(one)} for one in at]
    names = [name for name in lines[0] if name.startswith(("symplectic", "symmetric", "ā", "ã"))]
    fixed = min(one.order for one in at)
    least = min(tableau.order, fixed + 2)
    return [
        *(replace(lines[0][name], name=f"{name}, every θ", required=True,
                  found="yes" if all(one[name].found == "yes" for one in lines) else "no",
                  holds=all(one[name].found == "yes" for one in lines)) for name in names),
        Condition("order, fixed θ", f"2s − 2 = {2 * tableau.s - 2}", str(fixed),
                  fixed >= 2 * tableau.s - 2, "0", required=True),
        Condition("order, θ = O(Δt²)", f"2s = {2 * tableau.s}", str(least),
                  least == 2 * tableau.s, "0", required=True),
    ]


def _range(tableau: Tableau, label: str, found: dict[str, int]) -> Condition:
    """A quadrature or stage condition: how far it holds, and the residual of the next k."""
    t, part = tableau, tableau.basis
    k = found[label]
    claim = tableau.claims.get(label)
    # What makes the method consistent: (A.9) and (A.11) may hold to 0 only (2-stage IIIB).
    minimum = 0 if label in ("C_hat", "C_tilde") else 1
    wanted = minimum if claim is None else claim
    if label.startswith("B"):
        weights = part[label.replace("B", "b")]
        nodes = t.constraints if label == "B_tilde" else t.stages
        size = magnitude(quadrature_residual(nodes, weights, k + 1), None, None)
        equation = f"Σ b c^(k−1) = 1/k, k ≤ {wanted}"
    else:
        name = label.replace("C", "A")
        rows, columns = t.nodes_of(name)
        size = magnitude(stage_residual(rows, columns, part[name], k + 1), rows, None)
        equation = f"Σ a c^(k−1) = c^k/k, k ≤ {wanted}"
    return Condition(
        LABELS[label],
        equation,
        found=f"holds to k = {k}, at k = {k + 1} off by {mp.nstr(size, 3)}",
        holds=k >= wanted,
        residual="0" if k >= wanted else mp.nstr(size, 5),
        required=True,
    )


def is_symmetric(tableau: Tableau) -> bool:
    """Whether step(−h) undoes step(h)."""
    return all(residual is not None and is_zero(residual, tableau)
               for residual, _, _ in _symmetry_residuals(tableau))


def _symmetry_residuals(tableau: Tableau) -> Iterator[tuple[Matrix | None, Nodes, Nodes]]:
    part = tableau.basis
    for name, (_, _, b_columns) in MATRICES.items():
        rows, columns = tableau.nodes_of(name)
        yield symmetry_residual(rows, columns, part[name], part[b_columns]), rows, columns


def _symmetric(tableau: Tableau) -> Condition:
    residuals = list(_symmetry_residuals(tableau))
    mirrored = all(residual is not None for residual, _, _ in residuals)
    sizes = [magnitude(*residual) for residual in residuals
             if residual[0] is not None and not is_zero(residual[0], tableau)]
    holds = mirrored and not sizes
    claimed = tableau.claims.get("symmetric")
    return Condition(
        "symmetric",
        "a_(s+1−i,s+1−j) + a_ij = b_j for A, Â, Ã, Ā",
        found="yes" if holds else "no",
        holds=holds or not claimed,
        residual="0" if holds else mp.nstr(max(sizes), 5) if mirrored else "the nodes are not",
        required=bool(claimed),
    )


def _stability(tableau: Tableau) -> Condition:
    """Check L-stability, A-stability; a claimed L-stability is required, with constraints too."""
    found, claimed = stability(tableau), bool(tableau.claims.get("L_stable"))
    damps = found is not None and found.l_stable and found.constrained
    told = "none: Â is not A" if found is None else str(found)
    if found is not None and not found.constrained:
        told += ", without constraints"
    return Condition("stability", "R(z) = det(I − zA + z1bᵀ)/det(I − zA)", told,
                     damps or not claimed, "0" if damps or not claimed else told, claimed)


def _order(tableau: Tableau) -> Condition:
    found = tableau.order
    claimed = tableau.claims.get("order")
    return Condition(
        "order",
        "min(B, C + D + 1, 2C + 2), even if symmetric"
        + ("" if claimed is None else f", = {claimed}"),
        found=str(found),
        holds=found >= 1 and claimed in (None, found),
        residual="0" if claimed in (None, found) else str(found - (claimed or 0)),
        required=True,
    )


def _condition(
    tableau: Tableau, name: str, equation: str, residual: Matrix,
    rows: Nodes | None, columns: Nodes | None, *, required: bool,
) -> Condition:
    holds = is_zero(residual, tableau)
    size = "0" if holds else mp.nstr(magnitude(residual, rows, columns), 5)
    return Condition(name, equation, "yes" if holds else "no", holds, size, required)
