"""Gradients and Jacobians of expressions, as rows of a matrix."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import sympy as sp

from ..symbolic.bounded_algebra import can_be_factored, expand_if_short
from ..symbolic.derivatives import derivative

__all__ = ["curvature", "difference", "gradient", "jacobian", "shortest", "symmetric_jacobian",
           "transposed_product"]


def gradient(expression: sp.Expr, symbols: Sequence[sp.Symbol]) -> list[sp.Expr]:
    """Return the derivative of one expression by each symbol.

    Of k u² + c u with a sum u it is (2 k u + c) u_x, in which u is not multiplied out. H − ωJ of a
    frame has this form if H contains the square of the momentum map J = u: J then costs one
    addition.
    """
    bases = _bases(expression)
    if not bases:
        return [derivative(expression, symbol) for symbol in symbols]
    # chain rule through u: ∂e/∂x at fixed u, and ∂e/∂u · ∂u/∂x
    symbol_of = {u: sp.Symbol(f"_u{i}", real=True) for i, u in enumerate(bases)}
    sum_of = {symbol: u for u, symbol in symbol_of.items()}
    outer = expression.xreplace(symbol_of)
    slopes = {u: derivative(outer, symbol).xreplace(sum_of) for u, symbol in symbol_of.items()}
    return [sp.Add(derivative(outer, symbol).xreplace(sum_of),
                   *(slope * derivative(u, symbol) for u, slope in slopes.items()))
            for symbol in symbols]


def _bases(expression: sp.Expr) -> list[sp.Expr]:
    """Return the sums that an expression contains both squared and by themselves."""
    factors = [f for term in sp.Add.make_args(expression) for f in sp.Mul.make_args(term)]
    squared = {f.base for f in factors if f.is_Pow and f.exp == 2}
    return sorted({f for f in factors if f.is_Add and f in squared}, key=sp.default_sort_key)


def jacobian(expressions: Sequence[sp.Expr], symbols: Sequence[sp.Symbol]) -> list[list[sp.Expr]]:
    """Return the derivative of each expression (row) by each symbol (column)."""
    return [gradient(expression, symbols) for expression in expressions]


def difference(
    minuend: list[list[sp.Expr]], subtrahend: list[list[sp.Expr]]
) -> list[list[sp.Expr]]:
    """Return minuend − subtrahend, entry by entry."""
    return [[a - b for a, b in zip(*rows, strict=True)]
            for rows in zip(minuend, subtrahend, strict=True)]


def symmetric_jacobian(
    grad: Sequence[sp.Expr], symbols: Sequence[sp.Symbol]
) -> list[list[sp.Expr]]:
    """Return the Hessian from a gradient; entries (i, j) and (j, i) are one object."""
    rows = [[sp.Integer(0)] * len(symbols) for _ in symbols]
    for i, entry in enumerate(grad):
        for j in range(i, len(symbols)):
            rows[i][j] = rows[j][i] = derivative(entry, symbols[j])
    return rows


def transposed_product(G: Sequence[Sequence[sp.Expr]], x: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Return Gᵀx of a matrix with at least one row."""
    return [sp.Add(*(a * b for a, b in zip(x, column, strict=True)))
            for column in zip(*G, strict=True)]


def curvature(
    g: Sequence[sp.Expr], q: Sequence[sp.Symbol], multipliers: Sequence[sp.Symbol]
) -> list[list[sp.Expr]]:
    """Return Σ_l λ_l ∂²g_l/∂q∂q, n × n: the derivative of g_qᵀ λ by q."""
    weighted = sp.Add(*(a * b for a, b in zip(multipliers, g, strict=True)))
    return symmetric_jacobian(gradient(weighted, q), q)


@lru_cache(maxsize=1024)  # each scheme and the derivatives of a system ask for the same ones
def shortest(expression: sp.Expr) -> sp.Expr:
    """Return the expression unchanged, expanded or factored: the form of fewest operations.

    Polynomials of many symbols are not factored: it takes seconds each and finds nothing.
    """
    long = expand_if_short(expression)
    candidates = [expression, long]
    if long.is_Add and len(long.args) <= 64 and len(long.free_symbols) <= 12:
        candidates.append(sp.factor_terms(long))
        if can_be_factored(long):
            candidates.append(sp.factor(long))
    return min(candidates, key=lambda candidate: int(sp.count_ops(candidate)))
