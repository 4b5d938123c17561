"""Relative equilibria have no error in the frame of their rates, whatever the method and the step.

Each motion is q(t) = e^{ωt} q(0), written out here by quaternions: everything turns about an axis
of space, and each body about its own. That it is a motion at all is seen by how the error of the
same method without a frame goes down with its step.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import gyrospark as gs
from steady_motions import STEADY

EPS = np.finfo(float).eps


@cache
def framed(name, scheme="G-L", stages=2):
    steady = STEADY[name]()
    return gs.stepper(scheme, stages, system=steady.system, frame="symmetries", **steady.rep)


@pytest.mark.slow  # systems that are derived for seconds; test_frames.py has a quick one
@pytest.mark.parametrize("name", STEADY)
def test_a_steady_motion_has_no_error(name):
    """Where the start's own least squares is the frame; without one the error is of the order."""
    steady, step = STEADY[name](), framed(name)
    start = {"dt": steady.dt, "steps": 200, "parameters": steady.parameters}
    plain = step.integrate(steady.q, steady.p, **start)
    run = step.integrate(steady.q, steady.p, **start | {"parameters": {
        **steady.parameters, **gs.tune(step, steady.q, steady.p, dt=steady.dt, frame="start",
                                       parameters=steady.parameters).parameters}})
    bound = allowed(steady, run)
    assert steady.error(run) < bound < 1e-3 * steady.error(plain)
    # T and V, which are rounded, may be ten times H, their sum
    assert abs(run.energy_error()).max() <= 64 * EPS * abs(run.energies).max()
    errors = [steady.error(step.integrate(
        steady.q, steady.p, dt=steady.dt / k, steps=10 * k, parameters=steady.parameters))
        for k in (4, 8)]
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.1)  # it is a motion of the system


def allowed(steady, run):
    """Rates come of numbers that are rounded: the angle of a run is off by some t ω ε."""
    rates = sum(abs(run.parameters[s]) for s in run.parameters if s.startswith("omega"))
    return 16 * EPS * (1 + run.t[-1] * rates)


@pytest.mark.slow  # derives the satellite
def test_the_satellites_frames_are_its_own_axis_and_the_orbits_where_it_is_a_ball():
    """The gradient is about the vertical, n l_y about the normal: both stay for a ball only."""
    own, normal = framed("satellite").symmetries
    assert (own.name, own.condition) == ("omega_body", "a_I1 = a_I2")
    assert (normal.name, normal.condition) == ("omega_space", "a_I1 = a_I3 and a_I1 = a_I2")
