"""diffrax: Dormand and Prince's method of order 8 on Euler's equations, differentiated by JAX.

The gradient goes backwards through the steps, by recursive checkpoints.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ..attitudes import Array
from ..tops import euler_equations
from .gradient_job import TOP_VALUES, GradientJob, Job, of_euler, top_start
from .optional import need

__all__ = ["PACKAGE", "of_top"]

PACKAGE = "diffrax"


def of_top(t_end: float, target: Array) -> dict[str, Callable[[], Job]]:
    """Return settings, each with the function that prepares it."""
    return {f"Dopri8 tol {text}": partial(_prepare, float(text), t_end, target)
            for text in ("1e-9", "1e-12")}


def _prepare(tol: float, t_end: float, target: Array) -> Job:
    jax, diffrax = need("jax"), need(PACKAGE)
    jax.config.update("jax_enable_x64", True)
    numpy = jax.numpy

    def right(t: Any, x: Any, values: Any) -> Any:
        return numpy.stack(euler_equations(*x, *values))

    def loss(x: Any, values: Any) -> Any:
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(right), diffrax.Dopri8(), 0.0, t_end, 1e-3, x, args=values,
            stepsize_controller=diffrax.PIDController(rtol=tol, atol=tol), max_steps=100_000,
            adjoint=diffrax.RecursiveCheckpointAdjoint())
        return ((solution.ys[-1, :4] - target) ** 2).sum()

    value_and_gradient, value = jax.jit(jax.value_and_grad(loss, (0, 1))), jax.jit(loss)
    start, values = numpy.asarray(top_start()), numpy.asarray(TOP_VALUES)
    value(start, values).block_until_ready()

    def gradient() -> GradientJob:
        _, (by_state, by_values) = jax.block_until_ready(value_and_gradient(start, values))
        return of_euler(np.asarray(by_state), np.asarray(by_values))

    return Job(gradient, lambda: value(start, values).block_until_ready())
