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
from gyrospark.generator.multibody.models import turn
from steady_motions import ACROSS, E1, E3, STEADY, WEIGHT, Steady, of_model, with_wheel

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


# ---------------------------------------------------------------- a rotor


#: Of the body that carries a wheel: moments, attitude, Ω; and the wheel's momentum about axis 3.
CARRIER, ATTITUDE, OMEGA, MOMENTUM = (np.array([0.1, 0.12, 0.05]), turn(E1, 0.6),
                                      np.array([0.7, -0.5, 0.4]), 0.3)


def wheelless() -> Steady:
    """The rotor as one body: the wheel's mass at rest in it, its momentum h as H − h Ω₃."""
    moments = np.array([*CARRIER[:2] + ACROSS, CARRIER[2]])
    build = gs.Multibody("wheelless")
    body = build.top("a", mass=1.5, inertia=moments, centre=(0, 0, WEIGHT / 9.81 / 1.5),
                     quaternion=ATTITUDE, angular_velocity=OMEGA + MOMENTUM / moments[2] * E3)
    build.potential(-build.parameter("h", MOMENTUM) * body.angular_velocity[2])
    return of_model(build.model(), 5e-3)


@pytest.mark.slow  # derives two bodies on one axis
@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_a_reaction_wheel_errs_as_if_it_turned_slowly():
    """The body feels the wheel's momentum h and moments across, not how fast it turns.

    A body of three moments in gravity, beside one that has h and no wheel at all: the same wheel's
    momentum of a heavy rim at a tenth of a radian a step, or at 1, 3 and 10.
    """
    alone, step = wheelless(), framed("two_on_one_axis")
    exact = gs.stepper("G-L", 2, system=alone.system).integrate(
        alone.q, alone.p, dt=alone.dt / 16, steps=3200, every=16, parameters=alone.parameters).q

    def error(turn_a_step, moving=True):
        rate = turn_a_step / alone.dt
        wheel = np.array([0.01, 0.01, MOMENTUM / (rate + OMEGA[2])])
        both = with_wheel(ATTITUDE, OMEGA, rate, CARRIER, wheel, alone.dt)
        found = step.integrate(both.q, both.p, dt=alone.dt, steps=200, parameters={
            **both.parameters, "omega_w": rate if moving else 0.0}).q[:, :4]
        return float(np.sqrt(((found - exact) ** 2).sum(axis=1).mean()))

    slow = error(0.1)
    assert [error(angle) for angle in (1, 3, 10)] == pytest.approx([slow] * 3, rel=1e-2)
    assert error(1, moving=False) > 1e3 * slow
    with pytest.raises(gs.StepFailed):
        error(10, moving=False)
