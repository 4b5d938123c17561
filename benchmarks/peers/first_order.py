"""heyoka, SciPy with numba and diffrax integrate explicit first-order equations.

Each function compiles the equations once and returns a run from the start to ``t_end``, which
returns the variables there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp

from ..attitudes import Array
from .optional import need

__all__ = ["FirstOrder", "diffrax_run", "heyoka_run", "scipy_run"]

Run = Callable[[], Array]


@dataclass(frozen=True)
class FirstOrder:
    """Equations x' = f(x) without t, as SymPy's symbols and expressions, and their start."""

    variables: Sequence[Any]
    rates: Sequence[Any]
    start: Sequence[float]
    t_end: float


def heyoka_run(equations: FirstOrder, **options: Any) -> Run:
    """Return Taylor's method; without ``tol`` its tolerance is round-off."""
    heyoka = need("heyoka")
    start = np.array(equations.start)
    motion = heyoka.taylor_adaptive(
        [(heyoka.expression(str(x)), heyoka.from_sympy(sp.Integer(0) + rate))
         for x, rate in zip(equations.variables, equations.rates, strict=True)], start, **options)

    def run() -> Array:
        motion.time, motion.state[:] = 0.0, start
        motion.propagate_until(equations.t_end)
        end: Array = motion.state.copy()
        return end

    return run


def scipy_run(equations: FirstOrder, tol: float) -> Run:
    """Return DOP853 with a right-hand side compiled by numba; its step is Python."""
    numba, integrate = need("numba"), need("scipy.integrate", "scipy")
    function = numba.njit(sp.lambdify([equations.variables], equations.rates, "math", cse=True))
    start = np.array(equations.start)

    @numba.njit  # type: ignore[untyped-decorator]
    def derivative(t: float, x: Array) -> Array:
        return np.array(function(x))

    def run() -> Array:
        end: Array = integrate.solve_ivp(
            derivative, (0.0, equations.t_end), start, method="DOP853", rtol=tol, atol=tol,
            t_eval=[equations.t_end]).y[:, -1]
        return end

    return run


def diffrax_run(equations: FirstOrder, tol: float) -> Run:
    """Return Dormand and Prince's method of order 8, compiled with its loop by JAX."""
    jax, diffrax = need("jax"), need("diffrax")
    jax.config.update("jax_enable_x64", True)
    function = sp.lambdify([equations.variables], equations.rates, "jax", cse=True)
    start = jax.numpy.asarray(equations.start)
    term = diffrax.ODETerm(lambda t, x, _: jax.numpy.stack(function(x)))
    control = diffrax.PIDController(rtol=tol, atol=tol)

    @jax.jit  # type: ignore[untyped-decorator]
    def end(x: Any) -> Any:
        return diffrax.diffeqsolve(term, diffrax.Dopri8(), 0.0, equations.t_end, 1e-3, x,
                                   stepsize_controller=control, max_steps=None).ys[-1]

    return lambda: np.asarray(end(start))
