"""SciPy's explicit Runge-Kutta of order 8, its right-hand side compiled by numba where that is.

The step itself is Python; the time is SciPy's, not numba's.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ..attitudes import Array
from ..tops import INERTIA, MGL, TopState, euler_equations, state_of, tops
from .entry import PeerEntry, Run
from .optional import Unavailable, need

__all__ = ["PACKAGE", "entries", "right_hand_side"]

PACKAGE = "scipy"


def entries() -> list[PeerEntry]:
    """Return DOP853 at three tolerances."""
    return [PeerEntry("scipy", f"DOP853 tol {text}",
                      partial(_prepare, float(text)),
                      quick=text == "1e-9")
            for text in ("1e-12", "1e-9", "1e-6")]


def _prepare(tol: float) -> Run:
    integrate = need("scipy.integrate", "scipy")
    rhs = right_hand_side()
    start = state_of(tops()[0])
    initial = np.concatenate([start.q, start.omega])

    def run(t_end: float) -> TopState:
        x = integrate.solve_ivp(rhs, (0.0, t_end), initial, method="DOP853", rtol=tol, atol=tol,
                                t_eval=[t_end]).y[:, -1]
        return TopState(x[:4], x[4:])

    return run


def right_hand_side() -> Any:
    """Return Euler's equations as SciPy calls them."""
    constants = (*INERTIA, MGL)
    try:
        equations = need("numba").njit(euler_equations)
    except Unavailable:
        equations = euler_equations

    def rhs(t: float, x: Array) -> Array:
        return np.array(equations(*x.tolist(), *constants))

    return rhs
