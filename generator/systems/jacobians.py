"""Gradients and Jacobians of expressions, as rows of a matrix."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from ..algebra.bounded_algebra import can_be_factored, expanded
from ..algebra.derivatives import derivative

__all__ = ["difference", "gradient", "jacobian", "shortest", "symmetric_jacobian"]


def gradient(expression: sp.Expr, symbols: Sequence[sp.Symbol]) -> list[sp.Expr]:
    """Derivative of one expression by each symbol."""
    return [derivative(expression, symbol) for symbol in symbols]


def jacobian(
    expressions: Sequence[sp.Expr], symbols: Sequence[sp.Symbol]
) -> list[list[sp.Expr]]:
    """Derivative of each expression (row) by each symbol (column)."""
    return [gradient(expression, symbols) for expression in expressions]


def difference(
    left: list[list[sp.Expr]], right: list[list[sp.Expr]]
) -> list[list[sp.Expr]]:
    """Difference of two matrices, entry by entry; the left one where there is no right one."""
    if not right:
        return left
    return [[a - b for a, b in zip(*rows, strict=True)]
            for rows in zip(left, right, strict=True)]


def symmetric_jacobian(
    grad: Sequence[sp.Expr], symbols: Sequence[sp.Symbol]
) -> list[list[sp.Expr]]:
    """Hessian from a gradient; the lower half is the upper half, entry by entry the same object."""
    rows = [[sp.Integer(0)] * len(symbols) for _ in symbols]
    for i, entry in enumerate(grad):
        for j in range(i, len(symbols)):
            rows[i][j] = rows[j][i] = derivative(entry, symbols[j])
    return rows


def shortest(expression: sp.Expr) -> sp.Expr:
    """Return the expression as it is, expanded or factored: whichever has fewest operations.

    Polynomials of many symbols are not factored: it takes seconds each and finds nothing.
    """
    long = expanded(expression)
    candidates = [expression, long]
    if long.is_Add and len(long.args) <= 64 and len(long.free_symbols) <= 12:
        candidates.append(sp.factor_terms(long))
        if can_be_factored(long):
            candidates.append(sp.factor(long))
    return min(candidates, key=lambda candidate: int(sp.count_ops(candidate)))
