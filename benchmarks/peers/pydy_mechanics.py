"""PyDy on a ``System`` of ``sympy.physics.mechanics``: Kane's equations, their C, SciPy's DOP853.

Mass matrix and forces are the C that PyDy writes with shared subexpressions; NumPy solves for the
accelerations, and the step is SciPy's, in Python.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import sympy as sp
from sympy.physics import mechanics as me

from ..attitudes import Array
from ..timing import with_children
from .optional import Unavailable, need

__all__ = ["LIMIT", "PACKAGE", "PydyMechanics"]

PACKAGE = "pydy"
#: Seconds after which deriving and compiling are given up.
LIMIT = 600.0


class PydyMechanics:
    """A system of pin joints, derived and compiled once, at a ``cost`` in CPU seconds."""

    def __init__(self, system: Any, values: Mapping[str, float]) -> None:
        need("Cython", "cython")
        make = need("pydy.codegen.ode_function_generators", PACKAGE).generate_ode_function
        self._solve = need("scipy.integrate", "scipy").solve_ivp
        self._values = np.array([*values.values()])
        start = with_children()
        with _limited(LIMIT):
            system.form_eoms(eom_method=me.KanesMethod)
            kane, speeds = system.eom_method, list(system.u)
            self._rates = make(
                kane.forcing, list(system.q), speeds, sp.symbols([*values], positive=True),
                mass_matrix=kane.mass_matrix, coordinate_derivatives=sp.Matrix(speeds),
                generator="cython", time_first=True, constants_arg_type="array")
        self.cost = with_children() - start

    def run(self, tolerance: float, start: Array, t_end: float) -> Array:
        """Return the coordinates at ``t_end`` after a start at rest."""
        state = np.concatenate([start, np.zeros_like(start)])
        solution = self._solve(self._slopes, (0.0, t_end), state, method="DOP853", rtol=tolerance,
                               atol=tolerance, t_eval=[t_end])
        end: Array = solution.y[:len(start), -1]
        return end

    def _slopes(self, t: float, state: Array) -> Array:
        """Return a copy of the rates: PyDy fills one array in all calls, and SciPy stores it."""
        slopes: Array = self._rates(t, state, self._values)
        return slopes.copy()


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise ``Unavailable`` after ``seconds``, in the main thread of a system with alarms."""
    def stop(*_: object) -> None:
        raise Unavailable(f"not derived and compiled in {seconds:g} s")

    try:
        handler = signal.signal(signal.SIGALRM, stop)
    except (AttributeError, ValueError):  # no alarms, or another thread: no limit
        yield
        return
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, handler)
