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
    """Return the body's third axis at the trajectory's times, shape (N+1, 3), and its source.

    The source is "closed form", or the 8-stage reference where the problem has no exact solution.
    """
    if problem.exact is not None:
        # the closed form starts at t = 0 with the problem's initial state
        elapsed = (trajectory.t - trajectory.t[0]).astype(float)
        return problem.exact.axis(elapsed), "closed form"
    return _integrate(problem, trajectory).axis(), "8-stage Gauss-Lobatto reference"


def _integrate(problem: Problem, trajectory: Trajectory) -> Trajectory:
    """Return the motion by 8-stage G-L, with the trajectory's times and a divisor of its Δt.

    The body rotates by at most ``_ANGLE`` in a step of the reference.

    Raises
    ------
    InputError
        If the reference needs more than ``_MOST_STEPS`` steps.
    """
    rate = float(np.linalg.norm(trajectory.angular_velocity(), axis=1).max())
    steps, turns = trajectory.report.steps, abs(trajectory.dt) * rate / _ANGLE
    # "not <" refuses NaN as well
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
