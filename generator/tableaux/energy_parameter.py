"""Free numbers θ₀ and θ₁ of a Gauss-Lobatto tableau, for a step of exact energy.

With Legendre polynomials P_k on [0, 1], u = P_{s−1}(c), v = P_{s−2}(c) at the stages, and
w = P_s(c̃) − P_{s−2}(c̃) at the constraint nodes, which is 0 at both ends of the step:

    A + θ₀ Z, Â = A              z_ij = b_j (u_i v_j − v_i u_j)
    Ā + θ₁ Z̄, Ã + θ₁ Z̃          z̄_lj = w_l b_j u_j,    z̃_il = −b̃_l w_l u_i

All other coefficients are unchanged. b_i z_ij + b_j z_ji = 0, b_i z̃_il + b̃_l z̄_li = 0, and u v
and u w are odd about ½: the tableau is symplectic and symmetric for every θ (``conditions`` proves
it). Z is the direction of Brugnano, Iavernaro, Trigiante (arXiv 1005.1930), for systems without
constraints. It has no effect if all forces are constraint forces, as of a point mass on a surface;
Z̄ has.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from sympy import QQ

from ...core.errors import TableauError
from .enclosures import enclose_part
from .node_algebra import Nodes, power
from .nodes import BITS, Enclosure
from .tableau import Tableau

__all__ = ["energy_values", "with_energy_parameter"]

Matrix = Any


def legendre(nodes: Nodes, k: int) -> Matrix:
    """Return P_k on the nodes, as a column of their exact algebra."""
    # (j + 1) P_{j+1} = (2j + 1) x P_j − j P_{j−1}, in the exact algebra of the nodes
    x = 2 * power(nodes, 1) - power(nodes, 0)  # from [0, 1] to [−1, 1]
    previous, current = power(nodes, 0), x
    for j in range(1, k):
        previous, current = current, (nodes.multiply(x) * current * QQ(2 * j + 1, j + 1)
                                      - previous * QQ(j, j + 1))
    return current if k else previous


def energy_columns(tableau: Tableau) -> dict[str, tuple[Matrix, Nodes]]:
    """Return u, v and w as functions on their nodes.

    Raises TableauError for fewer than two stages: there is no P_{s−2}.
    """
    s, stages, nodes = tableau.s, tableau.stages, tableau.constraints
    if s < 2:
        raise TableauError(f"Exact energy takes at least 2 stages, not {s}.")
    return {"u": (legendre(stages, s - 1), stages), "v": (legendre(stages, s - 2), stages),
            "w": (legendre(nodes, s) - legendre(nodes, s - 2), nodes)}


def with_energy_parameter(tableau: Tableau, theta: tuple[Any, Any]) -> Tableau:
    """Return the tableau at rational numbers θ₀ and θ₁.

        A + θ₀ (u vᵀ − v uᵀ) B,   Ā + θ₁ w uᵀ B,   Ã − θ₁ u wᵀ B̃,    B = diag b, B̃ = diag b̃

    which stays symplectic for all θ. Fixed numbers lower the stage conditions and the order, so
    these claims are dropped.
    """
    basis = tableau.basis
    u, v, w = (column for column, _ in energy_columns(tableau).values())
    # multiplication by b, as a matrix over the functions of a node
    B = tableau.stages.multiply(basis["b"])
    B_tilde = tableau.constraints.multiply(basis["b_tilde"])
    theta_0, theta_1 = (QQ.convert(x) for x in theta)
    A = basis["A"] + (u * (B * v).transpose() - v * (B * u).transpose()) * theta_0
    coefficients = {"A": A, "A_hat": A,
                    "A_bar": basis["A_bar"] + w * (B * u).transpose() * theta_1,
                    "A_tilde": basis["A_tilde"] - u * (B_tilde * w).transpose() * theta_1}
    claims = {name: claim for name, claim in tableau.claims.items()
              if name in ("B", "B_hat", "B_tilde", "symmetric", "symplectic")}
    return replace(tableau, name=f"{tableau.name}_energy", claims=claims,
                   basis={**basis, **coefficients})


def energy_values(tableau: Tableau, *, constrained: bool) -> dict[str, tuple[Enclosure, ...]]:
    """Return enclosures of u and v, and with constraints of w, at their nodes."""
    columns = energy_columns(tableau)
    return {name: enclose_part(values.to_list(), [nodes], BITS)
            for name, (values, nodes) in columns.items() if constrained or name != "w"}
