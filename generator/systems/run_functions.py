"""Functions of a run from an expression: the sum over its stored states, and its derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import sympy as sp

from ...core.arguments import unknown
from ..symbolic.derivatives import derivative
from ..symbolic.numeric_evaluation import Evaluator
from .expression_arguments import as_expression

__all__ = ["slopes_over_states", "sum_over_states"]


def sum_over_states(expression: Any, run: Any) -> tuple[Any, dict[str, Any]]:
    """Return Σ ℓ(q, p, t, θ) over the stored states of a run, and its cotangents.

    Parameters
    ----------
    expression : Expr
        ℓ, in symbols that have the names of coordinates, momenta, parameters, and the time.
    run : Trajectory
        Whose states are put in.

    Returns
    -------
    value, cotangents
        Of "q" and "p" shape (rows, n), of "t" shape (rows,), and of "parameters" by name.

    Raises
    ------
    InputError
        For a symbol that the system does not have, with the nearest.
    """
    e = as_expression(expression)
    values = _values(e, run)
    walk = Evaluator(values)
    slopes = {str(symbol): np.broadcast_to(walk(derivative(e, symbol)), run.t.shape)
              for symbol in values}
    return np.broadcast_to(walk(e), run.t.shape).sum(), _cotangents(run, slopes)


def slopes_over_states(
    expression: Any, run: Any
) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Return how the cotangents of ``sum_over_states`` change along directions of the states.

    The function that is returned takes directions {"q", "p", "t", "parameters"} of the same shapes.
    """
    e = as_expression(expression)
    values = _values(e, run)
    walk = Evaluator(values)
    second = [(str(x), str(y), np.broadcast_to(walk(derivative(derivative(e, x), y)), run.t.shape))
              for x in values for y in values]

    def slopes(along: dict[str, Any]) -> dict[str, Any]:
        system = run.manifest["system"]
        moved = dict(zip(system["coordinates"], along["q"].T, strict=True))
        moved |= dict(zip(system["momenta"], along["p"].T, strict=True))
        moved |= {system.get("time", "t"): along["t"], **along["parameters"]}
        found: dict[str, Any] = {}
        for x, y, by_both in second:
            found[x] = found.get(x, 0) + by_both * moved[y]
        return _cotangents(run, found)

    return slopes


def _values(e: sp.Expr, run: Any) -> dict[sp.Symbol, Any]:
    """Return the numbers of the symbols of a loss: one, or one for each stored state."""
    system = run.manifest["system"]
    known = {system.get("time", "t"): run.t} | dict(run.parameters)
    known |= dict(zip(system["coordinates"], run.q.T, strict=True))
    known |= dict(zip(system["momenta"], run.p.T, strict=True))
    values: dict[sp.Symbol, Any] = {}
    for symbol in sorted(e.free_symbols, key=str):
        if str(symbol) not in known:
            raise unknown("symbol of a loss", str(symbol), known)
        values[symbol] = known[str(symbol)]
    return values


def _cotangents(run: Any, slopes: dict[str, Any]) -> dict[str, Any]:
    """Return derivatives by the names of a run's numbers as cotangents."""
    system, zero = run.manifest["system"], 0 * run.t
    time = system.get("time", "t")
    found: dict[str, Any] = {
        "q": np.stack([slopes.get(x, zero) for x in system["coordinates"]], axis=1),
        "p": np.stack([slopes.get(x, zero) for x in system["momenta"]], axis=1)}
    if time in slopes:
        found["t"] = slopes[time]
    inner = {name: slopes[name].sum() for name in run.parameters if name in slopes}
    if inner:
        found["parameters"] = inner
    return found
