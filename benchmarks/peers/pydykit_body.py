"""pydykit: its rigid body in quaternions by its midpoint rule, in Python with NumPy.

Its rigid body has no potential; the top's is added in a subclass. Needs Python 3.12. Left out is
its discrete gradient, which in version 0.0.6 stops at this body with arrays of unequal shapes.
"""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import numpy as np

from ..attitudes import Array, angular_velocity
from ..tops import INERTIA, MGL, TopState, tops
from .entry import PeerEntry, Run
from .optional import need

__all__ = ["PACKAGE", "entries"]

PACKAGE = "pydykit"
_SIGNS = np.array([1.0, -1.0, -1.0, 1.0])


def entries() -> list[PeerEntry]:
    """Return the midpoint rule."""
    dt = 1e-3
    return [PeerEntry("pydykit", f"midpoint Δt={dt:g}", partial(_prepare, dt), dt,
                      quick=True)]


def _prepare(dt: float) -> Run:
    configuration = need("pydykit.configuration", "pydykit")
    managers = need("pydykit.managers", "pydykit")
    body = _heavy_top()

    def run(t_end: float) -> TopState:
        manager = managers.Manager()
        settings = configuration.Configuration(**_settings(dt, t_end))
        manager._configure(settings)
        manager.system = body(manager=manager, **_body())
        x = manager.manage().results[-1]
        return TopState(x[:4], angular_velocity(x[:4], x[4:8], INERTIA))

    return run


def _body() -> dict[str, Any]:
    top = tops()[0]
    return {"nbr_spatial_dimensions": 3, "nbr_dof": 4, "nbr_constraints": 1, "mass": 1.0,
            "inertias": list(INERTIA),
            "state": {"position": top.q.tolist(), "momentum": top.p.tolist(),
                      "multiplier": [0.0]}}


def _settings(dt: float, t_end: float) -> dict[str, Any]:
    return {
        "name": "fast_top",
        "system": {"class_name": "RigidBodyRotatingQuaternions", **_body()},
        "simulator": {"class_name": "OneStep", "solver_name": "NewtonPlainPython",
                      "newton_epsilon": 1e-10, "max_iterations": 40},
        "integrator": {"class_name": "MidpointMultibody"},
        "time_stepper": {"class_name": "FixedIncrement", "step_size": dt, "start": 0.0,
                         "end": t_end},
    }


@cache
def _heavy_top() -> Any:
    """Return pydykit's rigid body with V = mgl R33."""
    base = need("pydykit.systems_multi_body", "pydykit").RigidBodyRotatingQuaternions

    class HeavyTop(base):  # type: ignore[valid-type, misc]
        def external_potential(self) -> float:
            q: Array = self.decompose_state()["position"]
            return float(MGL * (_SIGNS * q**2).sum())

        def external_potential_gradient(self) -> Array:
            q: Array = self.decompose_state()["position"]
            gradient: Array = 2 * MGL * _SIGNS * q
            return gradient

    return HeavyTop
