"""A Butcher tableau (A, b, c), completed to a SPARK tableau.

    Â     b_i â_ij + b̂_j a_ji = b_i b̂_j: the symplectic partner of A
    Ā     integrals to c̃_l of the Lagrange polynomials on c: C̄(s), ā_pj = b_j; or Ā = A
    Ã     b_i ã_ij + b̃_j ā_ji = b_i b̃_j: the symplectic partner of Ā; ã_i0 = b̃_0, ã_ip = 0

The nodes c̃ are the stages if the first row of A is 0 and the last is b, as of Lobatto IIIA, or if
the stages are distinct and include 0 and 1; else p + 1 Lobatto nodes, p ≤ s. If b is not
interpolatory or nodes coincide, p = 1 remains, which every method has: Ā = (0, bᵀ), Ã = (1/2, 0),
of order 2. Of the completions that determine the multipliers, the one with the highest proved order
is selected, and of these the one with the fewest nodes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import sympy as sp
from sympy import EXRAW
from sympy.polys.matrices import DomainMatrix

from ...core.errors import TableauError
from .conditions import check_tableau
from .multipliers import multiplier_inverse
from .node_algebra import ValueNodes, column
from .nodes import enclose_roots, exact_roots, lobatto_polynomial
from .separation_bounds import Rounding, vanishes_to
from .tableau import FIELDS, Tableau

__all__ = ["complete_tableau", "matrix"]

Rows = list[list[sp.Expr]]

#: Largest number of Lobatto nodes without nested radicals.
_MOST_EXACT_NODES = 5
_x = sp.Symbol("x")


def complete_tableau(
    name: str, parts: dict[str, Rows], claims: dict[str, int], rounding: Rounding | None
) -> Tableau:
    """Return the SPARK tableau of given A, b, c and, optionally, Â and b̂; vectors are columns.

    Raises TableauError if b has a zero and Â is not given, or if a required condition fails.
    """
    A, b, c = parts["A"], _column(parts["b"]), _column(parts["c"])
    b_hat = _column(parts.get("b_hat", parts["b"]))
    # the number of the first weight 0, counted from 1; 0 without one
    zero = next((i for i, weight in enumerate(b, 1) if vanishes_to(weight, rounding)), 0)
    if "A_hat" not in parts and zero:
        raise TableauError(
            f"The tableau {name!r} cannot be completed: b_{zero} = 0, by which the symplectic "
            "partner of A divides; give A_hat, for example A itself, which makes no symplectic "
            "pair.")
    # the tableau of a motion without constraints
    free_parts = {"A": A, "A_hat": parts.get("A_hat") or partner(A, b, b_hat), "b": parts["b"],
                  "b_hat": [[weight] for weight in b_hat], "c": parts["c"]}
    best_tableau: Tableau | None = None
    for constraint_parts in _constraint_parts(A, b, c, bool(zero), rounding):
        tableau = _tableau(name, free_parts | constraint_parts, claims, rounding)
        if multiplier_inverse(tableau) is None:
            continue
        # the highest order, and of equal orders the fewest nodes of constraints
        if best_tableau is None or (
                (tableau.order, -tableau.p) > (best_tableau.order, -best_tableau.p)):
            best_tableau = tableau
        if best_tableau.order >= best_tableau.free_order:
            break  # constraints cannot raise the order
    assert best_tableau is not None  # p = 1 has M = 1/2
    _refuse_violations(best_tableau)
    return best_tableau


def _refuse_violations(tableau: Tableau) -> None:
    """Refuse a tableau that violates a required condition, with the first three of these."""
    broken = [line for line in check_tableau(tableau) if line.required and not line.holds]
    if broken:
        lines = [f"{line.name} ({line.equation}; residual {line.residual})" for line in broken[:3]]
        raise TableauError(
            f"The tableau {tableau.name!r} violates {', '.join(lines)}; correct its numbers.")


def partner(a: Rows, b_rows: Sequence[sp.Expr], b_columns: Sequence[sp.Expr]) -> Rows:
    """Return the symplectic partner a'_ij = b'_j (1 − a_ji/b_i) of a.

    ``b_rows`` are the weights b_i, none of which is 0, and ``b_columns`` the weights b'_j.
    """
    return [[_simplify(weight * (1 - row[i] / b_rows[i]))
             for row, weight in zip(a, b_columns, strict=True)] for i in range(len(b_rows))]


def matrix(rows: Rows) -> Any:
    """Return rows of expressions as an exact matrix."""
    if len(rows[0]) == 1:
        return column(_column(rows), EXRAW)
    return DomainMatrix(rows, (len(rows), len(rows[0])), EXRAW)


def _constraint_parts(
    A: Rows, b: list[sp.Expr], c: list[sp.Expr], has_zero: bool, rounding: Rounding | None
) -> Iterator[dict[str, Rows]]:
    """Yield candidates for Ā, Ã, b̃ and c̃, in the order in which they are tried.

    Stages as constraint nodes, if possible; then Lobatto nodes, as many as stages allow and fewer;
    then the two ends of the step, which are always possible. ``has_zero``: a weight b_i is 0, by
    which partners would divide.
    """
    zero, half, end = sp.Integer(0), sp.Rational(1, 2), sp.Integer(1)
    if not has_zero:
        is_interpolatory = _is_interpolatory(b, c, rounding)
        starts_and_ends = _all_vanish(A[0], rounding) and _all_vanish(
            [a - weight for a, weight in zip(A[-1], b, strict=True)], rounding)
        if starts_and_ends:
            yield _with_partner(A, b, b, c)  # Ā = A: the stages are the constraint nodes
        elif is_interpolatory and _all_vanish([c[0], c[-1] - 1], rounding):
            yield _with_partner(_collocation(b, c, c), b, b, c)
        if is_interpolatory:
            largest = len(c) + 1 if rounding else min(len(c) + 1, _MOST_EXACT_NODES)
            for count in range(largest, 2, -1):
                nodes = _lobatto_nodes(count, rounding)
                yield _with_partner(_collocation(b, c, nodes), b, _integrals(nodes, end), nodes)
    yield {"A_bar": [[zero] * len(b), b], "A_tilde": [[half, zero] for _ in b],
           "b_tilde": [[half], [half]], "c_tilde": [[zero], [end]]}


def _all_vanish(entries: Iterable[sp.Expr], rounding: Rounding | None) -> bool:
    """Whether all numbers are zero, exactly or to the digits of decimals."""
    return all(vanishes_to(entry, rounding) for entry in entries)


def _is_interpolatory(
    b: Sequence[sp.Expr], c: Sequence[sp.Expr], rounding: Rounding | None
) -> bool:
    """Whether the nodes c are distinct and b_j = ∫₀¹ ℓ_j of their Lagrange polynomials."""
    if any(_all_vanish([u - v], rounding) for i, u in enumerate(c) for v in c[:i]):
        return False
    return _all_vanish((integral - weight for integral, weight in
                        zip(_integrals(c, sp.Integer(1)), b, strict=True)), rounding)


def _collocation(b: list[sp.Expr], c: Sequence[sp.Expr], nodes: Sequence[sp.Expr]) -> Rows:
    """Return Ā of collocation, ā_lj = ∫₀^c̃_l ℓ_j; ``nodes`` c̃ begin with 0 and end with 1."""
    return [[sp.Integer(0)] * len(b), *(_integrals(c, node) for node in nodes[1:-1]), b]


def _with_partner(
    A_bar: Rows, b: list[sp.Expr], b_tilde: list[sp.Expr], c_tilde: list[sp.Expr]
) -> dict[str, Rows]:
    """Return Ā, its symplectic partner Ã, b̃ and c̃ as parts of a tableau."""
    return {"A_bar": A_bar, "A_tilde": partner(A_bar, b, b_tilde),
            "b_tilde": [[weight] for weight in b_tilde], "c_tilde": [[x] for x in c_tilde]}


def _tableau(
    name: str, parts: dict[str, Rows], claims: dict[str, int], rounding: Rounding | None
) -> Tableau:
    """Return the tableau of all parts, with the digits that are certain.

    ``parts`` has all tables of ``FIELDS``, vectors as columns; ``rounding`` are the digits of the
    user's decimals, None for exact numbers.
    """
    if rounding is not None:  # a digit less for each factor of 10 in the 1/b of partners
        smallest = min((abs(float(x)) for x in _column(parts["b"]) if x), default=1.0)
        lost_digits = max(0, math.ceil(-math.log10(smallest)))
        entries = sum(len(rows) * len(rows[0]) for rows in parts.values())
        rounding = replace(rounding, digits=rounding.digits - lost_digits, entries=entries)
    stages, constraints = (ValueNodes(_column(parts[key]), rounding) for key in ("c", "c_tilde"))
    return Tableau(name, stages, constraints, {key: matrix(parts[key]) for key in FIELDS},
                   claims, rounding)


def _lobatto_nodes(count: int, rounding: Rounding | None) -> list[sp.Expr]:
    """Return the Lobatto nodes, exact; for a tableau of decimals rounded to 10 more digits."""
    polynomial = lobatto_polynomial(count)
    if rounding is None:
        return list(exact_roots(polynomial))
    unit = 10 ** (rounding.digits + 10)
    return [sp.Rational(round(node.centre * unit), unit) for node in enclose_roots(polynomial)]


def _integrals(nodes: Sequence[sp.Expr], end: sp.Expr) -> list[sp.Expr]:
    """Return ∫₀^end ℓ_j(x) dx for the Lagrange polynomials ℓ_j of the nodes."""
    integrals = []
    for j, node in enumerate(nodes):
        other_nodes = [x_i for i, x_i in enumerate(nodes) if i != j]
        lagrange = sp.prod([(_x - x_i) / (node - x_i) for x_i in other_nodes],
                           start=sp.Integer(1))
        integrals.append(_simplify(sp.integrate(sp.expand(lagrange), _x).subs(_x, end)))
    return integrals


def _simplify(value: sp.Expr) -> sp.Expr:
    """Return a number expanded, without roots in denominators."""
    return value if value.is_Rational else sp.radsimp(sp.expand(value))


def _column(rows: Rows) -> list[sp.Expr]:
    """Return the entries of a matrix of one column."""
    return [row[0] for row in rows]
