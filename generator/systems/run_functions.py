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
        lambda_0, lambda_1, … are the multipliers of constraints at the states, as in
        ``JointMotion.force``.
    at_states, to_steps : callable
        ``multipliers_at_states``, which returns the multipliers of a run at its stored states,
        shape (rows, m); and its transpose, which takes the run and derivatives in that shape, and
        returns the derivatives by the multipliers of the run's steps.
    run : Trajectory
        The run with the states.

    Returns
    -------
    value, cotangents
        Σ ℓ, and its derivatives: "q" and "p", shape (rows, n); "t", shape (rows,); "multipliers",
        in the shape of the run's; "parameters", a number for each name. Only "q" and "p" are
        always there.

    Raises
    ------
    InputError
        For a symbol that the system does not have, with the nearest; for multipliers in a run that
        has not stored every step.
    """
    e = as_expression(expression)
    system = run.manifest.system
    states = dict(zip(system.coordinates, run.q.T, strict=True))
    states |= dict(zip(system.momenta, run.p.T, strict=True))
    multipliers = [f"lambda_{k}" for k in range(len(system.constraints))]
    # a number or a column for each name that ℓ may have; states win over parameters of the same
    # name
    columns_of = dict(zip(multipliers, at_states(run).T, strict=True)) if multipliers else {}
    columns_of |= {system.time or "t": run.t}
    columns_of |= {name: run.parameters[name] for name in run.parameters} | states
    values = _values_of(e, columns_of, "symbol of a loss",
                        "; for a quantity, such as a joint's angle, give a function of the run "
                        "that returns its value and cotangents")
    evaluator = Evaluator(values)

    def by_state(function: sp.Expr) -> Any:
        """Return an expression at each stored state, shape (rows,)."""
        # the caller refuses cotangents that are not finite
        with np.errstate(all="ignore"):
            return np.broadcast_to(evaluator(function), run.t.shape)

    slopes = {str(symbol): by_state(derivative(e, symbol)) for symbol in values}
    return by_state(e).sum(), _cotangents(slopes, multipliers, to_steps, run)


def _values_of(
    e: sp.Expr, columns_of: dict[str, Any], kind: str, cure: str = ""
) -> dict[sp.Symbol, Any]:
    """Return symbol of e → its number or column; refuse a name that ``columns_of`` lacks.

    ``kind`` is the noun of the message, such as "input"; ``cure`` ends the message.
    """
    values: dict[sp.Symbol, Any] = {}
    for symbol in sorted(e.free_symbols, key=str):
        if str(symbol) not in columns_of:
            raise unknown(kind, str(symbol), columns_of, cure)
        values[symbol] = columns_of[str(symbol)]
    return values


def _cotangents(
    slopes: dict[str, Any], multipliers: list[str], to_steps: Callable[[Any, Any], Any], run: Any
) -> dict[str, Any]:
    """Return the cotangents of ``sum_over_states`` from ∂ℓ/∂x in each row, shape (rows,), by name.

    ∂ℓ/∂x is the cotangent of x in its row; a parameter has the sum over all rows. ``multipliers``
    are their names at states; ``to_steps`` takes their cotangents from the states to the steps.
    """
    system, time = run.manifest.system, run.manifest.system.time or "t"
    zero = 0 * run.t
    cotangents: dict[str, Any] = {
        "q": np.stack([slopes.get(x, zero) for x in system.coordinates], axis=1),
        "p": np.stack([slopes.get(x, zero) for x in system.momenta], axis=1)}
    if {*multipliers} & {*slopes}:
        w = np.stack([slopes.get(name, zero) for name in multipliers], axis=1)
        cotangents["multipliers"] = to_steps(run, w)
    if time in slopes:
        cotangents["t"] = slopes[time]
    of_parameters = {name: slopes[name].sum() for name in run.parameters if name in slopes}
    if of_parameters:
        cotangents["parameters"] = of_parameters
    return cotangents


def slopes_over_states(expression: Any, run: Any) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Return a function: direction d of states and parameters → Σ_y ∂²ℓ/∂x∂y d_y.

    Directions and results are {"q", "p", "t", "parameters"} in the shapes of the cotangents of
    ``sum_over_states``. Raises InputError for other symbols; multipliers have no second
    derivatives.
    """
    e = as_expression(expression)
    system = run.manifest.system
    time, names = system.time or "t", [*system.coordinates, *system.momenta]
    columns_of = dict(zip(names, [*run.q.T, *run.p.T], strict=True))
    columns_of |= {time: run.t, **run.parameters}
    values = _values_of(e, columns_of, "symbol of a loss with second derivatives")
    evaluator = Evaluator(values)
    # ∂²ℓ/∂x∂y at each stored state: a state enters one term of the sum only
    second_derivatives = [
        (str(x), str(y),
         np.broadcast_to(evaluator(derivative(derivative(e, x), y)), run.t.shape))
        for x in values for y in values]

    def slopes(along: dict[str, Any]) -> dict[str, Any]:
        """Return Σ_y ∂²ℓ/∂x∂y d_y for each x: the change of its cotangent along the directions."""
        directions = dict(zip(names, [*along["q"].T, *along["p"].T], strict=True))
        directions |= {time: along["t"], **along["parameters"]}
        cotangents = dict.fromkeys(columns_of, 0 * run.t)
        for x_name, y_name, by_both in second_derivatives:
            cotangents[x_name] = cotangents[x_name] + by_both * directions[y_name]
        q, p = (np.stack([cotangents[name] for name in state_names], axis=1)
                for state_names in (system.coordinates, system.momenta))
        return {"q": q, "p": p, "t": cotangents[time],
                "parameters": {name: cotangents[name].sum() for name in run.parameters}}

    return slopes
