"""Estimate of round-off in an expression: a running error analysis to first order.

Every operation adds half a unit in the last place of its result and hands on the errors of what it
is made of (Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., section 3.3):

    |δ(x + y)| ≤ |δx| + |δy| + ε|x + y|,  |δ(xy)| ≤ |y||δx| + |x||δy| + ε|xy|,
    |δf(x)| ≤ |f'(x)||δx| + ε|f(x)|

All in units of ε: of whichever floating-point type. 1 − cos x for small x is worth 1, not x².
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from .numeric_evaluation import Evaluator
from .shared_subexpressions import parts_of
from .switching_functions import Switch

__all__ = ["rounding"]

Array = NDArray[Any]


def rounding(
    expressions: Sequence[sp.Expr], values: Mapping[sp.Symbol, Any],
    errors: Mapping[sp.Symbol, Any],
) -> Array:
    """Return the error bounds in units of ε, one row an expression.

    Parameters
    ----------
    expressions : sequence of Expr
    values : mapping of Symbol to numbers or arrays
        At one point, or at many.
    errors : mapping of Symbol to numbers or arrays
        Errors of the symbols in units of ε; |value| for those that are left out.
    """
    value = Evaluator({s: np.asarray(x)[()] for s, x in values.items()})
    bounds: dict[sp.Basic, Any] = {}
    with np.errstate(all="ignore"):
        for e in parts_of(expressions):
            bounds[e] = errors[e] if e in errors else _bound(e, value, bounds)
    shape = np.broadcast_shapes(*(np.shape(x) for x in values.values()))
    rows = [np.broadcast_to(np.asarray(bounds[e], float), shape) for e in expressions]
    return np.array(rows) if rows else np.zeros((0, *shape))


def _bound(e: sp.Expr, value: Evaluator, bounds: Mapping[sp.Basic, Any]) -> Any:
    if e.is_Integer:
        return 0.0
    own = np.abs(value(e))
    if e.is_Atom or not e.free_symbols:
        return own
    if e.is_Add:
        return own + sum(bounds[a] for a in e.args)
    if e.is_Mul:
        return own + _of_product([np.abs(value(a)) for a in e.args], [bounds[a] for a in e.args])
    if e.is_Pow and not e.exp.free_symbols:
        slope = value(e.exp) * np.abs(value(e.base)) ** (value(e.exp) - 1)
        return own + np.abs(slope) * bounds[e.base]
    if e.is_Pow:  # u^v = exp(v log u)
        return own * (1 + np.abs(value(e.exp) / value(e.base)) * bounds[e.base]
                      + np.abs(np.log(np.abs(value(e.base)))) * bounds[e.exp])
    if isinstance(e, Switch):  # of either side: rounding may tell which
        return own + np.maximum(*(bounds[e.args[i]] for i in e.branches))
    if e.func in (sp.sign, sp.floor):
        return own
    return own + sum(_slope(e, i, value) * bounds[a] for i, a in enumerate(e.args))


def _slope(e: sp.Expr, i: int, value: Evaluator) -> Any:
    """Return |∂f/∂x_i| of a function by a difference: for a bound that is near enough."""
    symbols = [sp.Dummy() for _ in e.args]
    at = dict(zip(symbols, map(value, e.args), strict=True))
    width = 2.0**-24 * np.where(at[symbols[i]] == 0, 1.0, np.abs(at[symbols[i]]))
    moved = Evaluator(at | {symbols[i]: at[symbols[i]] + width})(e.func(*symbols))
    return np.abs(moved - value(e)) / width


def _of_product(sizes: Sequence[Any], errors: Sequence[Any]) -> Any:
    """Return Σ_i δx_i Π_(j≠i) |x_j|; products from the left and from the right, none divided."""
    before = [np.ones(())]
    for size in sizes[:-1]:
        before.append(before[-1] * size)
    total, after = 0.0, np.ones(())
    for size, error, left in zip(reversed(sizes), reversed(errors), reversed(before), strict=True):
        total = total + error * left * after
        after = after * size
    return total
