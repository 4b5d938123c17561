"""gyrospark itself, by the solver it chooses and by dense Newton."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

import gyrospark as gs

from ..attitudes import angular_velocity
from ..tops import FREE_RATE, INERTIA, TopState, parameters, tops
from .entry import PeerEntry, Run

__all__ = ["entries", "prepare"]

_NEAR, _OWN = {"gamma": 1.1 * INERTIA[2]}, {"gamma": INERTIA[0], "omega_body": FREE_RATE}
#: Scheme, stages, time step, parameters beside γ_m, tolerance and a note.
_METHODS: tuple[tuple[Any, int | None, float, Mapping[str, float], float | None, str], ...] = (
    *(("G-L", s, dt, {}, None, "") for s, dt in (
        (2, 1e-3), (3, 1e-3), (4, 1e-3), (4, 1e-2), (6, 1e-2), (8, 1e-2), (8, 2e-2))),
    ("G-L", 8, 2.5e-2, _NEAR, None, " γ=1.1I₃"),
    ("G-L", 8, 2.5e-2, _NEAR, 1e-14, " γ=1.1I₃ tol 1e-14"),
    ("G-L", 8, 2.5e-2, _NEAR, 1e-12, " γ=1.1I₃ tol 1e-12"),
    ("G-L", 3, 1e-2, _OWN, None, " γ=I₁ in its frame"),
    ("G-L", 8, 4e-2, _OWN, None, " γ=I₁ in its frame"),
    ("G-L", 8, 4e-2, _OWN, 5e-15, " γ=I₁ in its frame, tol 5e-15"),
    # pydykit's midpoint rule
    ("IMS", None, 1e-3, {"alpha": sum(INERTIA) / 2}, None, " α=½trJ"))


def entries() -> list[PeerEntry]:
    """Return each method by the default solver and by dense Newton."""
    return [PeerEntry("gyrospark", f"{scheme}{'' if s is None else f' s={s}'} {solver} "
                      f"Δt={dt:g}{note}",
                      partial(prepare, scheme, s, dt, values, tolerance, solver), dt,
                      (s, dt) == (2, 1e-3))
            for scheme, s, dt, values, tolerance, note in _METHODS for solver in ("auto", "newton")]


def prepare(scheme: Any, stages: int | None, dt: float, values: Mapping[str, float] = {},
            tolerance: float | None = None, solver: Any = "auto") -> Run:
    """Return the run of one stepper."""
    step = gs.stepper(scheme, stages, "alpha" if "alpha" in values else "gamma",
                      frame="symmetries" if "omega_body" in values else None)
    numbers = {name: x for name, x in {**parameters(), **values}.items()
               if name in step.parameter_domains}
    top, method = tops()[0], gs.Solver(solver, tolerance)

    def run(t_end: float) -> TopState:
        steps = round(t_end / dt)
        if abs(steps * dt - t_end) > 1e-9 * t_end:
            raise gs.InputError(f"t = {t_end:g} s is no whole number of steps of {dt:g} s.")
        end = step.integrate(top.q, top.p, dt=dt, steps=steps, every=max(steps, 1),
                             parameters=numbers, solver=method)
        q = np.asarray(end.q[-1], dtype=np.float64)
        return TopState(q, angular_velocity(q, end.p[-1], INERTIA))

    return run
