"""Kicks: rates of the angular momenta due to a potential or a force at fixed q.

With Λ(q) p = 2 l, the angular momentum in space axes,

    N = −½ Λ(q) V_q = −½ R(q) L(q) V_q,      q̇ = ½ Λ(q)ᵀ W for the angular velocity W in space,

on |q| = 1. N is the same for every smooth extension of V off |q| = 1, as Λ q = 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import sympy as sp

from ..normal_forms.expansion import TooLongError
from ..symbolic.bounded_algebra import is_small
from ..symbolic.derivatives import derivative
from ..symbolic.shared_subexpressions import Shared, parts_of, tree_size
from ..systems.jacobians import shortest
from .quotient import Quotient, unit_quaternions

#: Largest number of terms of a sum that is factored.
_MAX_TERMS = 100

__all__ = ["Vector", "derivatives_along", "shorten_on_unit_sphere", "space_matrix", "space_torque"]

#: Largest number of nodes of expressions that are shortened.
_MAX_NODES = 3000

Vector = tuple[sp.Expr, sp.Expr, sp.Expr]


def space_matrix(q: Sequence[sp.Expr]) -> sp.Matrix:
    """Return Λ(q), 3 × 4: Λ = R L on |q| = 1, Λ q = 0, Λ Λᵀ = |q|²."""
    q0, q1, q2, q3 = q
    return sp.Matrix([[-q1, q0, -q3, q2], [-q2, q3, q0, -q1], [-q3, -q2, q1, q0]])


def space_torque(q: Sequence[sp.Expr], force: Sequence[sp.Expr]) -> Vector:
    """Return ½ Λ(q) F, the torque in space axes of a generalised force on a quaternion."""
    x, y, z = (space_matrix(q) * sp.Matrix(force) / 2).tolist()
    return x[0], y[0], z[0]


def derivatives_along(
    expressions: Sequence[sp.Expr], quaternions: Mapping[tuple[sp.Symbol, ...], Vector],
    points: Mapping[sp.Symbol, sp.Expr],
) -> list[sp.Expr]:
    """Return the time derivative de/dt = Σ e_q·q̇ + Σ e_r ṙ of each expression.

    ``quaternions`` has the angular velocity W of each q in space axes, with which q̇ = ½ Λ(q)ᵀ W,
    and ``points`` the velocity ṙ of each coordinate of a point.
    """
    rate = dict(points)
    for q, W in quaternions.items():
        rate |= dict(zip(q, space_matrix(q).T * sp.Matrix(W) / 2, strict=True))
    derivatives: list[sp.Expr] = []
    for e in expressions:
        moving = sorted(e.free_symbols & rate.keys(), key=str)
        derivatives.append(sp.Add(*(derivative(e, x) * rate[x] for x in moving if rate[x] != 0)))
    return derivatives


def shorten_on_unit_sphere(
    expressions: Sequence[sp.Expr], quaternions: Sequence[Sequence[sp.Symbol]]
) -> list[sp.Expr]:
    """Return the expressions, or a form with fewer operations that is equal on |q| = 1.

    Long expressions, and expressions that are no polynomials in q, are returned unchanged.
    """
    symbols = {x for q in quaternions for x in q}
    is_short = tree_size(expressions) <= _MAX_NODES and all(map(is_small, expressions))
    if not is_short or not all(
            e.is_polynomial(*symbols) and not e.has(Shared) for e in expressions):
        return list(expressions)
    quotient = Quotient(unit_quaternions(quaternions))
    try:
        shorter = [_factor(quotient.expression(e)) for e in expressions]
    except TooLongError:
        return list(expressions)
    return min((list(expressions), shorter), key=lambda row: _operation_count(row, symbols))


def _factor(e: sp.Expr) -> sp.Expr:
    """Return a sum in its shortest form; a long sum unchanged: factoring would take seconds."""
    return shortest(e) if len(sp.Add.make_args(e)) <= _MAX_TERMS else e


def _operation_count(expressions: Sequence[sp.Expr], symbols: set[sp.Symbol]) -> int:
    """Return the number of operations, each subexpression once; those without ``symbols`` are free.
    """
    return sum(abs(int(e.exp)) if e.is_Pow and e.exp.is_Integer else len(e.args)
               for e in parts_of(expressions) if e.args and e.free_symbols & symbols)
