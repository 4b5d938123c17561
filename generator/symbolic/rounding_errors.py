"""Estimate of round-off in an expression: a running error analysis to first order.

Every operation adds half a unit in the last place of its result and propagates the errors of its
operands (Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., section 3.3):

    |δ(x + y)| ≤ |δx| + |δy| + ε|x + y|,  |δ(xy)| ≤ |y||δx| + |x||δy| + ε|xy|,
    |δf(x)| ≤ |f'(x)||δx| + ε|f(x)|

Bounds are in units of ε of the floating-point type. The bound of 1 − cos x for small x is about 1,
not x².
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import sympy as sp

from ...core.arrays import Array
from .numeric_evaluation import Evaluator
from .shared_subexpressions import parts_of
from .switching_functions import Switch

__all__ = ["rounding"]


def rounding(
    expressions: Sequence[sp.Expr], values: Mapping[sp.Symbol, Any],
    errors: Mapping[sp.Symbol, Any],
) -> Array:
    """Return the error bounds, shape (number of expressions, *shape of values).

    They are in units of ε, the relative precision of the floating-point type.

    Parameters
    ----------
    expressions : sequence of Expr
    values : mapping of Symbol to numbers or arrays
        Values of the symbols at one point or at many.
    errors : mapping of Symbol to numbers or arrays
        Errors of symbols in units of ε; by default |value|.
    """
    evaluate = Evaluator({s: np.asarray(x)[()] for s, x in values.items()})
    bounds: dict[sp.Basic, Any] = {}
    with np.errstate(all="ignore"):
        for e in parts_of(expressions):
            bounds[e] = errors[e] if e in errors else _bound(e, evaluate, bounds)
    shape = np.broadcast_shapes(*(np.shape(x) for x in values.values()))
    rows = [np.broadcast_to(np.asarray(bounds[e], float), shape) for e in expressions]
    return np.array(rows) if rows else np.zeros((0, *shape))


def _bound(e: sp.Expr, evaluate: Evaluator, bounds: Mapping[sp.Basic, Any]) -> Any:
    """Return the bound of an expression's rounding error in ε, from the bounds of its arguments.

    Each operation adds |value|, and passes the errors of its arguments on by their slopes.
    """
    if e.is_Integer:
        return 0.0
    size = np.abs(evaluate(e))
    if e.is_Atom or e.is_number:  # a set of symbols for each subexpression takes far longer
        return size
    if e.is_Add:
        return size + sum(bounds[a] for a in e.args)
    if e.is_Mul:
        sizes = [np.abs(evaluate(a)) for a in e.args]
        return size + _error_of_product(sizes, [bounds[a] for a in e.args])
    if e.is_Pow and e.exp.is_number:
        slope = evaluate(e.exp) * np.abs(evaluate(e.base)) ** (evaluate(e.exp) - 1)
        return size + np.abs(slope) * bounds[e.base]
    if e.is_Pow:  # u^v = exp(v log u): |δ(u^v)|/|u^v| ≤ |v/u| |δu| + |log u| |δv|
        u, v = evaluate(e.base), evaluate(e.exp)
        return size * (1 + np.abs(v / u) * bounds[e.base]
                       + np.abs(np.log(np.abs(u))) * bounds[e.exp])
    if isinstance(e, Switch):  # the larger error: round-off may select either branch
        return size + np.maximum(*(bounds[e.args[i]] for i in e.branches))
    if e.func in (sp.sign, sp.floor):
        return size
    return size + sum(_slope(e, i, evaluate) * bounds[a] for i, a in enumerate(e.args))


def _slope(e: sp.Expr, i: int, evaluate: Evaluator) -> Any:
    """Return |∂f/∂x_i| of a function by a forward difference, precise enough for a bound."""
    symbols = [sp.Dummy() for _ in e.args]
    arguments = dict(zip(symbols, map(evaluate, e.args), strict=True))
    width = 2.0**-24 * np.where(arguments[symbols[i]] == 0, 1.0, np.abs(arguments[symbols[i]]))
    displaced = Evaluator(arguments | {symbols[i]: arguments[symbols[i]] + width})(e.func(*symbols))
    return np.abs(displaced - evaluate(e)) / width


def _error_of_product(sizes: Sequence[Any], errors: Sequence[Any]) -> Any:
    """Return Σ_i δx_i Π_(j≠i) |x_j|, the error of a product of factors x with errors δx.

    Products from both ends are multiplied in place of dividing by x_i, which may be 0.
    """
    # 1 without axes, which products broadcast to the shape of the sizes
    left_products = [np.ones(())]
    for size in sizes[:-1]:
        left_products.append(left_products[-1] * size)
    total, right_product = 0.0, np.ones(())
    for size, error, left_product in zip(reversed(sizes), reversed(errors), reversed(left_products),
                                         strict=True):
        total = total + error * left_product * right_product
        right_product = right_product * size
    return total
