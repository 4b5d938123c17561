"""The motion to compare with: a closed form, or an integration far more accurate than the run."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..api import stepper
from ..core.errors import InputError
from ..runtime.results.trajectory import Trajectory
from ..runtime.rigid_body.gamma_rules import mean_inertia
from ..runtime.rigid_body.problems import Problem

__all__ = ["reference_axis"]

#: Rotation a step of the 8-stage (order 16) reference; its error there is round-off.
_ANGLE = 0.2
#: Of the reference: minutes of computing.
_MOST_STEPS = 10**8


def reference_axis(problem: Problem, trajectory: Trajectory) -> tuple[NDArray[Any], str]:
    """Return the body's third axis at the trajectory's times, shape (N+1, 3), and its source."""
    if problem.exact is not None:
        since = (trajectory.t - trajectory.t[0]).astype(float)
        return problem.exact.axis(since), "closed form"
    return _integrated(problem, trajectory).axis(), "8-stage Gauss-Lobatto reference"


def _integrated(problem: Problem, trajectory: Trajectory) -> Trajectory:
    """Integrate with 8-stage G-L in steps that divide those of the trajectory."""
    rate = float(np.linalg.norm(trajectory.angular_velocity(), axis=1).max())
    steps, turns = trajectory.report.steps, abs(trajectory.dt) * rate / _ANGLE
    if steps and not steps * turns < _MOST_STEPS:
        raise InputError(f"A reference for {steps:,} steps of {trajectory.dt:g} s takes more than "
                         f"{_MOST_STEPS:,} steps of its own; choose a smaller dt, or do without a "
                         "reference.")
    parts = max(1, math.ceil(turns)) if steps else 1
    precise = stepper("G-L", 8, "gamma", system=problem.system)
    return precise.integrate(
        problem.q0, problem.p0, dt=trajectory.dt / parts, steps=steps * parts,
        every=trajectory.every * parts,
        parameters=problem.parameters | {"gamma": mean_inertia(problem.inertia)},
    )
