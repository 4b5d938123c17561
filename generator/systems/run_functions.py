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


def sum_over_states(
    expression: Any, at_states: Callable[[Any], Any], to_steps: Callable[[Any, Any], Any], run: Any
) -> tuple[Any, dict[str, Any]]:
    """Return Σ ℓ(q, p, t, θ) over the stored states of a run, and its cotangents.

    Parameters
    ----------
    expression : Expr
        ℓ, in symbols that have the names of coordinates, momenta, parameters, and the time;
        lambda_0, lambda_1, … are multipliers of constraints at the states, as of
        ``JointMotion.force``.
    at_states, to_steps : callable
        ``multipliers_at_states``, and its transpose.
    run : Trajectory
        Whose states are put in.

    Returns
    -------
    value, cotangents
        Of "q" and "p" shape (rows, n), of "t" shape (rows,), of "multipliers" in their shape, and
        of "parameters" by name.

    Raises
    ------
    InputError
        For a symbol that the system does not have, with the nearest; for multipliers in a run that
        has not stored every step.
    """
    e = as_expression(expression)
    system, rows = run.manifest.system, len(run.t)
    columns = dict(zip(system.coordinates, run.q.T, strict=True))
    columns |= dict(zip(system.momenta, run.p.T, strict=True))
    time = system.time or "t"
    forces = [f"lambda_{k}" for k in range(len(system.constraints))]
    # a number or a column for each name that ℓ may have; states win over parameters of the same
    # name
    columns_of = dict(zip(forces, at_states(run).T, strict=True)) if forces else {}
    columns_of |= {time: run.t} | {name: run.parameters[name] for name in run.parameters} | columns
    values: dict[sp.Symbol, Any] = {}
    for symbol in sorted(e.free_symbols, key=str):
        if str(symbol) not in columns_of:
            raise unknown("symbol of a loss", str(symbol), columns_of,
                          "; for a quantity, such as a joint's angle, give a function of the run "
                          "that returns its value and cotangents")
        values[symbol] = columns_of[str(symbol)]
    evaluator = Evaluator(values)

    def of_rows(body: sp.Expr) -> Any:
        with np.errstate(all="ignore"):  # what is not finite is refused as a cotangent
            return np.broadcast_to(evaluator(body), (rows,))

    # ∂ℓ/∂x in each row: the cotangent of x there; those of parameters are summed over the rows
    slopes = {str(symbol): of_rows(derivative(e, symbol)) for symbol in values}
    zero = 0 * run.t
    cotangents: dict[str, Any] = {
        "q": np.stack([slopes.get(x, zero) for x in system.coordinates], axis=1),
        "p": np.stack([slopes.get(x, zero) for x in system.momenta], axis=1)}
    if {*forces} & {*slopes}:
        w = np.stack([slopes.get(name, zero) for name in forces], axis=1)
        cotangents["multipliers"] = to_steps(run, w)
    if time in slopes:
        cotangents["t"] = slopes[time]
    inner = {name: slopes[name].sum() for name in run.parameters if name in slopes}
    if inner:
        cotangents["parameters"] = inner
    return of_rows(e).sum(), cotangents


def slopes_over_states(
    expression: Any, run: Any
) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Return a function: direction d of states and parameters → Σ_y ∂²ℓ/∂x∂y d_y.

    Directions and results are {"q", "p", "t", "parameters"} in the shapes of the cotangents of
    ``sum_over_states``. Raises InputError for symbols of other numbers; multipliers have no second
    derivatives.
    """
    e = as_expression(expression)
    system = run.manifest.system
    time, names = system.time or "t", [*system.coordinates, *system.momenta]
    columns_of = dict(zip(names, [*run.q.T, *run.p.T], strict=True))
    columns_of |= {time: run.t, **run.parameters}
    values: dict[sp.Symbol, Any] = {}
    for symbol in sorted(e.free_symbols, key=str):
        if str(symbol) not in columns_of:
            raise unknown("symbol of a loss with second derivatives", str(symbol), columns_of)
        values[symbol] = columns_of[str(symbol)]
    evaluator = Evaluator(values)
    # ∂²ℓ/∂x∂y at each stored state; cotangents are those of one term of the sum each
    second = [(str(x), str(y),
               np.broadcast_to(evaluator(derivative(derivative(e, x), y)), run.t.shape))
              for x in values for y in values]

    def slopes(along: dict[str, Any]) -> dict[str, Any]:
        """Return how cotangents change along directions: second derivatives times these."""
        directions = dict(zip(names, [*along["q"].T, *along["p"].T], strict=True))
        directions |= {time: along["t"], **along["parameters"]}
        cotangents = dict.fromkeys(columns_of, 0 * run.t)
        for x, y, by_both in second:
            cotangents[x] = cotangents[x] + by_both * directions[y]
        q, p = (np.stack([cotangents[x] for x in getattr(system, kind)], axis=1)
                for kind in ("coordinates", "momenta"))
        return {"q": q, "p": p, "t": cotangents[time],
                "parameters": {name: cotangents[name].sum() for name in run.parameters}}

    return slopes
