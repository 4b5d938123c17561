"""T1 by full Newton, driven from Python over the compiled residual and Jacobian.

Slow, and open to inspection: the same rules as ``engine/gyrospark/newton/newton.h``, an independent
linear solver. Tests hold the two against each other.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bindings.array_checks import all_finite
from ..bindings.binding import Binding

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
    """T1: return status, the unknowns x and the number of iterations.

    From the rates at the start of the step, and where that fails, from a momentum that stays.
    """
    x = binding.guess(parameters, dt, q, p, work)
    what = binding, parameters, tolerance
    status, found, taken = iterate(*what, max_iterations, dt, q, p, x, work)
    if status == 0 or taken == max_iterations:
        return status, found, taken
    x[binding.kicks] = 0
    again, found, more = iterate(*what, max_iterations - taken, dt, q, p, x, work)
    return again and status, found, taken + more


def iterate(
    binding: Binding, parameters: Any, tolerance: float | None, max_iterations: int, dt: float,
    q: Array, p: Array, x: Array, work: Any,
) -> tuple[int, Array, int]:
    """Return status, the unknowns from a guess x and the number of iterations."""
    epsilon = binding.epsilon
    size, ratio = 0.0, 0.0
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
        previous, size = size, binding.increment_size(dt, q, p, x, dx, work)
        x = x - dx
        if not np.isfinite(size):
            return 3, x, taken
        shrinks, ratio = ratio < 0.5, size / previous if taken > 1 else 0.0
        if size <= (tolerance or 0.0):
            return binding.check_constraints(dt, q, x, work), x, taken
        if taken == 1:
            continue
        stops = ratio >= 0.5 and is_rounding(binding, parameters, dt, q, p, dx, size, work)
        quadratic = not tolerance and shrinks and size < 1e-3 and ratio < 0.1
        if stops or (quadratic and size * ratio**2 < epsilon / 64):
            return binding.check_constraints(dt, q, x, work), x, taken
    return (1 if ratio < 0.5 else 4 if size < 1e-3 else 5), x, max_iterations


def is_rounding(
    binding: Binding, parameters: Any, dt: float, q: Array, p: Array, dx: Array, size: float,
    work: Any,
) -> bool:
    """Whether an increment, no smaller than half the one before, is so by rounding.

    A stiff spring k rounds its force by ε k |q|, and Δt times that may be large beside a small
    momentum: states and guesses two units in the last place away tell by how much the residual is
    uncertain. They are those at the start, for an iteration that has gone astray proves nothing.
    """
    if size <= 64 * binding.epsilon:
        return True
    chance = np.random.default_rng(1)
    ulps = 2 * binding.epsilon
    x = binding.guess(parameters, dt, q, p, work)
    r = binding.residual(parameters, dt, q, p, x, work)
    size = binding.increment_size(dt, q, p, x, dx, work)
    rounding = 0.0
    for _ in range(4):
        q_near, p_near, x_near = (
            np.ascontiguousarray(y + ulps * chance.choice([-1, 1], len(y)) * y, y.dtype)
            for y in (q, p, x))
        change = binding.residual(parameters, dt, q_near, p_near, x_near, work) - r
        rounding = max(rounding, binding.residual_size(dt, q, p, x, change, work))
    return size <= 16 * rounding
