"""CasADi: gradients of its integrators by their adjoints.

    top        cvodes, idas and collocation on Euler's equations
    linkages   idas on our (q, p) with multipliers of index 1: the second derivative of g is 0

"tight" has quadratures under error control and dense output of backward runs by polynomials.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import sympy as sp

import gyrospark as gs

from ..attitudes import Array
from ..tops import euler_equations
from .gradient_job import TOP_VALUES, GradientJob, Job, of_euler, top_start
from .optional import need

__all__ = ["PACKAGE", "of_model", "of_top"]

PACKAGE = "casadi"
_TIGHT = {"quad_err_con": True, "interpolation_type": "polynomial"}
_MOST = {"max_num_steps": 1_000_000}


def _settings() -> dict[str, tuple[str, dict[str, Any]]]:
    settings: dict[str, tuple[str, dict[str, Any]]] = {}
    for plugin, tol in (("cvodes", 1e-9), ("cvodes", 1e-12), ("idas", 1e-9)):
        options = {"reltol": tol, "abstol": tol / 100} | _MOST
        settings[f"{plugin} tol {tol:g}"] = plugin, options
        settings[f"{plugin} tol {tol:g} tight"] = plugin, options | _TIGHT
    settings["collocation 400 × 4"] = "collocation", {
        "number_of_finite_elements": 400, "interpolation_order": 4}
    return settings


def of_top(t_end: float, target: Array) -> dict[str, Callable[[], Job]]:
    """Return settings of the top, each with the function that prepares it."""
    return {name: partial(_top, *setting, t_end, target) for name, setting in _settings().items()}


def of_model(model: gs.Model, wrt: Sequence[str], t_end: float) -> dict[str, Callable[[], Job]]:
    """Return settings of bodies on joints, each with the function that prepares it."""
    return {name: partial(_constrained, model, wrt, *setting, t_end)
            for name, setting in _settings().items() if setting[0] == "idas" and "tight" in name}


def _top(plugin: str, options: Mapping[str, Any], t_end: float, target: Array) -> Job:
    casadi = need(PACKAGE)
    x, values = casadi.SX.sym("x", 7), casadi.SX.sym("values", 4)
    right = casadi.vertcat(*euler_equations(*casadi.vertsplit(x), *casadi.vertsplit(values)))
    motion = casadi.integrator("motion", plugin, {"x": x, "p": values, "ode": right}, 0.0, t_end,
                               dict(options))
    gradient, primal = _differentiated(
        motion, lambda end: casadi.sumsqr(end[:4] - casadi.DM(target)), top_start(), TOP_VALUES)
    return Job(lambda: of_euler(*gradient()), primal)


def _constrained(
    model: gs.Model, wrt: Sequence[str], plugin: str, options: Mapping[str, Any], t_end: float
) -> Job:
    casadi = need(PACKAGE)
    system, parameters = model.system, model.parameters
    n, m = len(system.q), len(system.constraints)
    x, forces, values = (casadi.SX.sym(name, size) for name, size in (
        ("x", 2 * n), ("forces", m), ("values", len(wrt))))
    symbols = [*system.q, *system.p, *system.parameters]
    free_symbols = {name: values[i] for i, name in enumerate(wrt)}
    numbers = [*casadi.vertsplit(x), *(free_symbols.get(str(s), parameters[str(s)])
                                       for s in system.parameters)]
    H, *g = sp.lambdify(symbols, [system.H, *system.constraints], modules="math",
                        cse=True)(*numbers)
    q, p, g = x[:n], x[n:], casadi.vertcat(*g)
    G = casadi.jacobian(g, q)
    H_q, H_p = casadi.gradient(H, q), casadi.gradient(H, p)
    right = casadi.vertcat(H_p, -H_q - G.T @ forces)
    rate = casadi.jtimes(G @ H_p, x, right)
    motion = casadi.integrator("motion", plugin, {
        "x": x, "z": forces, "p": values, "ode": right, "alg": rate}, 0.0, t_end, dict(options))
    gradient, primal = _differentiated(
        motion, lambda end: casadi.sumsqr(end[n - 3 : n]),
        np.concatenate([model.q0, model.p0]), np.array([parameters[i] for i in wrt]))

    def job() -> GradientJob:
        by_state, by_values = gradient()
        return GradientJob(by_state[:n], by_state[n:], by_values)

    return Job(job, primal)


def _differentiated(
    motion: Any, loss: Callable[[Any], Any], start: Array, values: Array
) -> tuple[Callable[[], tuple[Array, Array]], Callable[[], object]]:
    """Return functions: the gradient of the loss by the start and values, and the loss alone."""
    casadi = need(PACKAGE)
    x, p = casadi.MX.sym("x", len(start)), casadi.MX.sym("p", len(values))
    value = loss(motion(x0=x, p=p)["xf"])
    value_and_gradient = casadi.Function(
        "both", [x, p], [value, casadi.gradient(value, x), casadi.gradient(value, p)])
    value_only = casadi.Function("alone", [x, p], [value])

    def gradient() -> tuple[Array, Array]:
        _, by_state, by_values = value_and_gradient(start, values)
        return np.array(by_state).ravel(), np.array(by_values).ravel()

    return gradient, lambda: value_only(start, values)
