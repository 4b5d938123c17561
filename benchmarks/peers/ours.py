"""gyrospark itself: Gauss-Lobatto with γ, by each solver."""

from __future__ import annotations

from functools import partial

import numpy as np

from ..._version import __version__
from ...errors import InputError
from ...facade import stepper
from ...runtime.quaternion import angular_velocity
from ..tops import INERTIA, State, parameters, tops
from .entry import Entry, Run
from .optional import Unavailable

__all__ = ["PACKAGE", "SOLVERS", "available", "entries", "prepare"]

PACKAGE = "gyrospark"
SOLVERS = ("auto", "newton", "fixed-point")
#: Stages, time step, γ / I₃ (None: γ_m), whether quick.
_SETTINGS: tuple[tuple[int, float, float | None, bool], ...] = (
    (2, 1e-3, None, True),
    (3, 1e-3, None, False),
    (4, 1e-3, None, True),
    (4, 1e-2, None, False),
    (6, 1e-2, None, False),
    (8, 1e-2, None, False),
    (8, 2e-2, None, False),
    (8, 2.5e-2, 1.1, False),
)


def entries() -> list[Entry]:
    """Return the default solver and dense Newton for each setting."""
    return [_entry(solver, *setting) for setting in _SETTINGS for solver in ("auto", "newton")]


def _entry(solver: str, stages: int, dt: float, ratio: float | None, quick: bool) -> Entry:
    gamma = None if ratio is None else ratio * INERTIA[2]
    setting = f"G-L s={stages} Δt={dt:g} {solver}" + ("" if ratio is None else f" γ={ratio:g}I₃")
    return Entry("gyrospark", __version__, setting, partial(prepare, solver, stages, dt, gamma),
                 dt, quick)


def available(solver: str) -> bool:
    """Return whether this version's steppers know a solver."""
    from ...runtime.stepper import SOLVERS as KNOWN

    return solver in KNOWN


def prepare(solver: str, stages: int, dt: float, gamma: float | None = None) -> Run:
    """Return the run of one stepper.

    Raises
    ------
    Unavailable
        If this version has no such solver.
    """
    if not available(solver):
        raise Unavailable(f"not available: solver {solver!r}")
    step = stepper("G-L", stages, "gamma")
    values, top = parameters(gamma), tops()[0]

    def run(t_end: float) -> State:
        steps = round(t_end / dt)
        if abs(steps * dt - t_end) > 1e-9 * t_end:
            raise InputError(f"t = {t_end:g} s is no whole number of steps of {dt:g} s.")
        end = step.integrate(top.q, top.p, dt=dt, steps=steps, every=max(steps, 1),
                             parameters=values, solver=solver)
        q = np.asarray(end.q[-1], dtype=np.float64)
        return State(q, angular_velocity(q, end.p[-1], INERTIA))

    return run
