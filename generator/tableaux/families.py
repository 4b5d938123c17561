"""The families, solved from their defining conditions: Gauss-Lobatto and Lobatto IIIA-B of the
paper, (A.8)-(A.16), and Radau-Lobatto, which is Gauss-Lobatto on the nodes of Radau IIA.

Each condition is linear in the unknown coefficients. For functions on the nodes (``node_algebra``)
the unknown is a rational matrix, and one exact solve gives all s² entries, for any s.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from sympy import QQ
from sympy.polys.matrices import DomainMatrix

from ...core.errors import TableauError
from .node_algebra import Nodes, PolynomialNodes, column, power
from .nodes import gauss_polynomial, lobatto_polynomial, radau_polynomial
from .tableau import Tableau

__all__ = ["gauss_lobatto", "lobatto_iiiab", "radau_lobatto"]

Matrix = Any


def quadrature_weights(nodes: Nodes) -> Matrix:
    """Solve B(s), (A.8) or (A.10): Σ_i b_i c_i^{k−1} = 1/k for k = 1..s."""
    # a sum over the nodes is a trace: Σ_i b_i c_iᵏ = bᵀ T cᵏ
    system = DomainMatrix.hstack(*[nodes.trace * power(nodes, k) for k in range(nodes.size)])
    right_side = column([QQ(1, k + 1) for k in range(nodes.size)], QQ)
    return system.transpose().lu_solve(right_side)


def solve_rows(rows: Nodes, columns: Nodes, count: int, ends: Matrix | None = None) -> Matrix:
    """Solve Σ_j a_ij c_j^{k−1} = c_i^k/k, k = 1..count, for the matrix a_ij.

    With ``ends``, the weight b_1 as a number, also the conditions (A.13)/(A.15): the first column
    is the constant b_1, the last is 0. Raises TableauError if the number of conditions is not the
    number of columns.
    """
    conditions, targets = [], []
    for k in range(1, count + 1):
        conditions.append(columns.trace * power(columns, k - 1))
        targets.append(power(rows, k) * QQ(1, k))
    if ends is not None:
        conditions += [columns.at(0).transpose(), columns.at(-1).transpose()]
        targets += [rows.one * ends, rows.one * QQ(0)]
    if len(conditions) != columns.size:
        raise TableauError(f"{len(conditions)} conditions cannot fix {columns.size} columns.")
    system = DomainMatrix.hstack(*conditions)
    return system.transpose().lu_solve(DomainMatrix.hstack(*targets).transpose()).transpose()


def first_weight(nodes: Nodes, weights: Matrix) -> Any:
    """Return b at the first node."""
    return (nodes.at(0) * weights).to_list()[0][0]


@lru_cache
def gauss_lobatto(s: int) -> Tableau:
    """Return the s-stage Gauss-Lobatto SPARK tableau, p = s (A.15), (A.16).

    C(s) determines A, C̄(s) determines Ā; Ã has ã_i0 = b̃_0, ã_is = 0 and C̃(s−1).
    """
    if s < 1:
        raise TableauError(f"A Gauss-Lobatto tableau has at least 1 stage, not {s}.")
    claims = {"B": 2 * s, "B_hat": 2 * s, "B_tilde": 2 * s, "C": s, "C_hat": s, "C_tilde": s,
              "C_bar": s, "symmetric": 1, "symplectic": 1, "order": 2 * s}
    return _with_lobatto(f"gl{s}", gauss_polynomial(s), claims)


@lru_cache
def radau_lobatto(s: int) -> Tableau:
    """Return the s-stage Radau-Lobatto SPARK tableau, p = s: for stiff dampers.

    Gauss-Lobatto on the nodes of Radau IIA: c_s = 1 and ā_sj = a_sj = b_j, so that the last stage
    is the end of the step, where g = 0, and R(∞) = 0 (``stability``). Ã and Ā are a symplectic
    pair, A and Â = A are not; the tableau is not symmetric. C̃ holds to k = s − 1 only.
    """
    if s < 1:
        raise TableauError(f"A Radau-Lobatto tableau has at least 1 stage, not {s}.")
    claims = {"B": 2 * s - 1, "B_hat": 2 * s - 1, "B_tilde": 2 * s, "C": s, "C_hat": s,
              "C_tilde": s - 1, "C_bar": s, "symplectic": 0, "L_stable": 1, "order": 2 * s - 1}
    return _with_lobatto(f"radaul{s}", radau_polynomial(s), claims)


def _with_lobatto(name: str, polynomial: Any, claims: dict[str, int]) -> Tableau:
    """Return the tableau with the roots of a polynomial as stages and s + 1 Lobatto nodes.

    A and Ā are collocation matrices, C(s) and C̄(s). Ã has the first column b̃_0, the last 0, and
    C̃(s − 1).
    """
    s = polynomial.degree()
    stages, lobatto = PolynomialNodes(polynomial), PolynomialNodes(lobatto_polynomial(s + 1))
    b, b_tilde = quadrature_weights(stages), quadrature_weights(lobatto)
    A = solve_rows(stages, stages, s)
    basis = {
        "A": A,
        "A_hat": A,
        "A_tilde": solve_rows(stages, lobatto, s - 1, ends=first_weight(lobatto, b_tilde)),
        "A_bar": solve_rows(lobatto, stages, s),
        "b": b,
        "b_hat": b,
        "b_tilde": b_tilde,
        "c": power(stages, 1),
        "c_tilde": power(lobatto, 1),
    }
    return Tableau(name, stages, lobatto, basis, claims)


@lru_cache
def lobatto_iiiab(s: int) -> Tableau:
    """Return the s-stage Lobatto IIIA-B tableau, p = s − 1 (A.13), (A.14).

    C(s) determines A (Lobatto IIIA); Â has â_i1 = b_1, â_is = 0 and Ĉ(s−2) (Lobatto IIIB); Ā = A
    and Ã = Â, as the constraint nodes are the stages.
    """
    if s < 2:
        raise TableauError(f"A Lobatto IIIA-B tableau has at least 2 stages, not {s}.")
    lobatto = PolynomialNodes(lobatto_polynomial(s))
    b = quadrature_weights(lobatto)
    A = solve_rows(lobatto, lobatto, s)
    A_hat = solve_rows(lobatto, lobatto, s - 2, ends=first_weight(lobatto, b))
    c = power(lobatto, 1)
    basis = {
        "A": A, "A_hat": A_hat, "A_tilde": A_hat, "A_bar": A,
        "b": b, "b_hat": b, "b_tilde": b,
        "c": c, "c_tilde": c,
    }
    order = 2 * s - 2  # of Lobatto quadrature with s nodes
    claims = {"B": order, "B_hat": order, "B_tilde": order, "C": s, "C_hat": s - 2,
              "C_tilde": s - 2, "C_bar": s, "symmetric": 1, "symplectic": 1, "order": order}
    return Tableau(f"liiiab{s}", lobatto, lobatto, basis, claims)
