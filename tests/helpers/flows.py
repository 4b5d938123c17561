"""Flows of systems with a frame, with inputs, with time, and starts of them: rows of x."""

from __future__ import annotations

import numpy as np
import pytest

import gyrospark as gs
import systems
from gyrospark.interop.discrete_flow import DiscreteFlow

#: Case → system of the catalogue and its scheme.
_SYSTEMS = {"top": ("heavy_top", "G-L"), "framed": ("heavy_top_in_frame", "G-L"),
            "IMS": ("heavy_top", "IMS"), "pushed": ("pushed_pendulum", "G-L"),
            "bead": ("bead", "G-L"), "driven": ("driven_pendulum", "G-L")}
CASES = ["top", "framed", "IMS", "pushed",
         pytest.param("bead", marks=pytest.mark.slow)]  # derivatives compiled for this
TOP = gs.problems.fast_top()
PARAMETERS = TOP.parameters | {"gamma": 0.0016}


def stepper_of(case):
    """Return the stepper of a case, its derivatives compiled."""
    return systems.differentiable(*_SYSTEMS[case])


def start_of(case):
    """Return q, p, parameters, dt and t0 of a case; its start is consistent."""
    if case == "pushed":
        return np.array([0.6, 0.8]), np.array([-0.8, 0.6]), {"k": 1.3}, 0.05, 0.0
    if case in ("bead", "driven"):
        name = _SYSTEMS[case][0]
        entry = systems.case(name)
        parameters = {key: x for key, x in entry.parameters.items() if key != "push"}
        return *systems.start(name, stepper_of(case)), parameters, entry.dt, entry.t0
    rates = {"omega_body": 50.0} if case == "framed" else {}
    return np.array(TOP.q0), np.array(TOP.p0), PARAMETERS | rates, 1e-3, 0.0


def inputs_of(case, steps):
    """Return inputs of each step, or None for a system that has none."""
    count = {"pushed": 2, "driven": 1}.get(case)
    return np.random.default_rng(3).normal(size=(steps, count)) if count else None


def flow_of(case, steps):
    """Return a flow and x of the start."""
    flow, (q, p, parameters, dt, t0) = DiscreteFlow(stepper_of(case), steps), start_of(case)
    inputs = inputs_of(case, steps)
    x = np.concatenate([q, p, flow.parameters(parameters), [dt, t0],
                        [] if inputs is None else inputs.ravel()])
    return flow, x


def directions(x, count, seed=0):
    """Return directions of the size of x, shape (1, count, size)."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(1, count, x.size)) * np.maximum(np.abs(x), 0.1)


def close(values, expected, tolerance=1e-12):
    """Whether two arrays agree, relative to the largest entry."""
    values, expected = np.asarray(values), np.asarray(expected)
    return np.abs(values - expected).max() <= tolerance * np.abs(expected).max()
