"""heyoka's variational equations of the top: Euler's equations, 11 directions.

``compact_mode`` makes functions of the 84 equations; without it LLVM takes many times as long to
compile them, and the run is faster. The run alone has Euler's 7 equations, never compact.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from ..attitudes import Array
from ..tops import euler_equations
from .gradient_job import TOP_VALUES, GradientJob, Job, of_euler, top_start
from .optional import need

__all__ = ["PACKAGE", "of_top"]

PACKAGE = "heyoka"


def of_top(t_end: float, target: Array) -> dict[str, Callable[[], Job]]:
    """Return settings, each with the function that prepares it."""
    return {f"variational tol {text}{' compact' * compact}":
            partial(_prepare, float(text), compact, t_end, target)
            for text, compact in (("1e-9", True), ("1e-12", True), ("1e-16", True),
                                  ("1e-9", False), ("1e-12", False))}


def _prepare(tol: float, compact: bool, t_end: float, target: Array) -> Job:
    heyoka = need(PACKAGE)
    variables = heyoka.make_vars("q0", "q1", "q2", "q3", "w1", "w2", "w3")
    constants = [heyoka.par[i] for i in range(4)]
    right = list(zip(variables, euler_equations(*variables, *constants), strict=True))
    start = top_start()
    variational = heyoka.var_ode_sys(right, [*variables, *constants], order=1)
    varied = heyoka.taylor_adaptive(variational, start, pars=TOP_VALUES, tol=tol,
                                    compact_mode=compact)
    plain = heyoka.taylor_adaptive(right, start, pars=TOP_VALUES, tol=tol)
    starts = {id(motion): motion.state.copy() for motion in (varied, plain)}

    def run(motion: Any) -> Array:
        motion.time = 0.0
        motion.state[:] = starts[id(motion)]
        motion.propagate_until(t_end)
        end: Array = motion.state.copy()
        return end

    def gradient() -> GradientJob:
        end = run(varied)
        derivatives = 2 * (end[:4] - target) @ end[7:].reshape(7, 11)[:4]
        return of_euler(derivatives[:7], derivatives[7:])

    return Job(gradient, lambda: run(plain))
