"""heyoka: Taylor series of order 20, compiled by LLVM for these equations.

Its default tolerance is round-off. The equations are ``tops.euler_equations`` with the numbers in
them, the fewest operations.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ..attitudes import Array
from ..tops import INERTIA, MGL, TopState, euler_equations, state_of, tops
from .entry import PeerEntry, Run
from .optional import need

__all__ = ["PACKAGE", "entries", "equations", "prepare_batch"]

PACKAGE = "heyoka"
_SETTINGS: dict[str, dict[str, Any]] = {
    "default": {},
    "high accuracy": {"high_accuracy": True},
    "tol 1e-12": {"tol": 1e-12},
    "tol 1e-9": {"tol": 1e-9},
    "tol 1e-6": {"tol": 1e-6},
}


def entries() -> list[PeerEntry]:
    """Return the scalar integrator at several tolerances."""
    return [PeerEntry("heyoka", setting, partial(_prepare, options),
                      quick=setting in ("default", "tol 1e-12"))
            for setting, options in _SETTINGS.items()]


def equations(real: Any = np.float64) -> list[tuple[Any, Any]]:
    """Return pairs (variable, its derivative) with constants of a floating-point type."""
    heyoka = need("heyoka")
    variables = heyoka.make_vars("q0", "q1", "q2", "q3", "w1", "w2", "w3")
    constants = [heyoka.expression(real(x)) for x in (*INERTIA, MGL)]
    right = euler_equations(*variables, *constants)
    return list(zip(variables, right, strict=True))


def _prepare(options: dict[str, Any]) -> Run:
    heyoka = need("heyoka")
    start = state_of(tops()[0])
    initial = np.concatenate([start.q, start.omega])
    motion = heyoka.taylor_adaptive(equations(), initial, **options)

    def run(t_end: float) -> TopState:
        motion.time = 0.0
        motion.state[:] = initial
        motion.propagate_until(t_end)
        return TopState(motion.state[:4].copy(), motion.state[4:].copy())

    return run


def prepare_batch(count: int, width: int | None, options: dict[str, Any]) -> Run:
    """Return the run of ``count`` tops, ``width`` at a time in the lanes of one integrator.

    Without a width heyoka recommends one for this machine; it must divide ``count``.
    """
    heyoka = need("heyoka")
    starts = [state_of(top) for top in tops(count)]
    columns = np.array([np.concatenate([s.q, s.omega]) for s in starts]).T
    width = heyoka.recommended_simd_size() if width is None else width
    motion = heyoka.taylor_adaptive_batch(equations(), columns[:, :width].copy(), **options)

    def run(t_end: float) -> TopState:
        ends: list[Array] = []
        for first in range(0, count, width):
            motion.set_time(0.0)
            motion.state[:] = columns[:, first : first + width]
            motion.propagate_until(t_end)
            ends.append(motion.state.T.copy())
        rows = np.concatenate(ends)
        return TopState(rows[:, :4], rows[:, 4:])

    return run
