"""T1 by full Newton, driven from Python over the compiled residual and Jacobian.

Slow, and open to inspection: the same rules as ``templates/newton.c.jinja``, an independent
linear solver. Tests hold the two against each other.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .binding import Binding
from .checks import all_finite

__all__ = ["newton_step"]

Array = NDArray[Any]


def newton_step(
    binding: Binding, parameters: Any, tolerance: float | None, max_iterations: int, dt: float,
    q: Array, p: Array, work: Any,
) -> tuple[int, Array, Array, Array, int, Any]:
    """Return status, q1, p1, multipliers, the number of iterations and the work of one step."""
    status, x, taken = solve_stages(
        binding, parameters, tolerance, max_iterations, dt, q, p, work
    )
    if status != 0:
        return status, q, p, binding.new(binding.multipliers), taken, 0
    status, q1, p1, multipliers = binding.finish(parameters, dt, q, p, x, work)
    done = binding.step_work(parameters, dt, q, p, x, work)
    return status, q1, p1, multipliers, taken, done


def solve_stages(
    binding: Binding, parameters: Any, tolerance: float | None, max_iterations: int, dt: float,
    q: Array, p: Array, work: Any,
) -> tuple[int, Array, int]:
    """T1: return status, the unknowns x and the number of iterations."""
    epsilon = binding.epsilon
    x = binding.guess(parameters, dt, q, p, work)
    previous = 0.0
    for taken in range(1, max_iterations + 1):
        r = binding.residual(parameters, dt, q, p, x, work)
        J = binding.jacobian(parameters, dt, q, p, x, work)
        if not (all_finite(r) and all_finite(J)):
            return 3, x, taken
        scale = np.abs(J).max(axis=1)
        if not scale.all():
            return 2, x, taken
        try:
            with np.errstate(all="ignore"):  # dx is judged below
                dx = binding.solve((J.T / scale).T, r / scale)
        except np.linalg.LinAlgError:
            return 2, x, taken
        size = binding.increment_size(dt, q, p, x, dx)
        x = x - dx
        if not np.isfinite(size):
            return 3, x, taken
        ratio = size / previous if taken > 1 else np.nan
        done = (
            size <= (tolerance or 0.0)
            or (size < 65536 * epsilon and ratio >= 0.5)
            or (not tolerance and size < 1e-3 and ratio < 0.1 and size * ratio**2 < epsilon / 64)
        )
        if done:
            return 0, x, taken
        previous = size
    return 1, x, max_iterations
