"""Energy errors of the fast top from compiled steppers, and the state that the law is taken at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..api import stepper
from ..core.arrays import Array
from ..core.inertia import RepName
from ..core.real_types import RealName
from ..generator.schemes.named_schemes import SchemeName
from ..runtime.results.trajectory import Trajectory
from ..runtime.rigid_body.problems import fast_top
from ..runtime.rigid_body.quaternion import rotation_matrix
from .body_frame import BodyFrameTop

__all__ = ["energy_errors", "peak", "run", "top_along"]


def run(
    scheme: SchemeName, stages: int | None, dt: float, steps: int, parameter: float, *,
    rep: RepName = "gamma", real: RealName = "double",
) -> Trajectory:
    """Integrate the fast top, and return all states; ``parameter`` is γ or α in kg m²."""
    problem = fast_top()
    step = stepper(scheme, stages, rep, real=real)
    parameters = problem.parameters | {rep: parameter}
    q, p = problem.q0, problem.p0
    if real != "double":  # the start is on the constraints to double precision only
        q, p = step.project(q, p, parameters=parameters)
    return step.integrate(q, p, dt=dt, steps=steps, parameters=parameters, solver="newton")


def energy_errors(run: Trajectory) -> Array:
    """Return H_k − H_0 in J of all stored states, shape (N + 1,), with the scheme's own H."""
    return np.asarray(run.energies - run.energies[0])


def peak(errors: Array) -> float:
    """Return the error of largest size with its sign."""
    return float(errors[np.argmax(np.abs(errors))])


def top_along(run: Trajectory, rows: Sequence[int] = ()) -> BodyFrameTop:
    """Return the states of a run as one top, each entry an array over the steps.

    ``rows`` selects states, all of them by default.
    """
    problem = fast_top()
    selected_rows = list(rows) or slice(None)
    l = run.angular_velocity()[selected_rows] * np.asarray(problem.inertia)  # noqa: E741
    vertical = rotation_matrix(run.q[selected_rows].astype(float))[:, 2, :]
    return BodyFrameTop(list(l.astype(float).T), list(vertical.T), [1 / x for x in problem.inertia],
                        problem.parameters["mgl"])
