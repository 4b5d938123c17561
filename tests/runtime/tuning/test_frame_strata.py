"""Frames of motions that start near an axis of their symmetry: "auto" is no worse than no frame.

Near a stratum of the action (a pendulum at its pole, a top upright, a body that spins about its own
axis, a pair of points in line with its velocity) a rate is a quotient of two small numbers. Starts
are drawn at every distance from there. True is 6-G-L without a frame at a quarter of the step.
"""

from __future__ import annotations

import warnings
from functools import cache

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import gyrospark as gs
import systems
from framed_point import PENDULUM, framed_point

METHODS = [("IMS", None), ("EMS", None), ("G-L", 1), ("G-L", 2), ("G-L", 3), ("LIIIA-B", 2),
           ("LIIIA-B", 3), ("Radau-L", 1), ("Radau-L", 2)]
INERTIA = (1.0, 1.0, 0.6)
NUMBERS = {"I1": 1.0, "I2": 1.0, "I3": 0.6, "gamma": 0.9}
STEPS = 40
X, Y, Z, PX, PY, PZ = sp.symbols("x y z p_x p_y p_z", real=True)
C = sp.Symbol("c", real=True)
#: Without the input, of which a run may have rows.
WEIGHT = {"k": 1.0, "a": 0.0}
SPACE = (PX**2 + PY**2 + PZ**2) / 2
SPHERE = (X**2 + Y**2 + Z**2 - 1,)


@cache
def system(name: str):
    """A pendulum in space, a pair of points on a spring, or a named system."""
    if name == "pendulum":
        return gs.System((X, Y, Z), (PX, PY, PZ), (), SPACE + Z, SPHERE, name="pendulum")
    if name == "pair":
        q, p = sp.symbols("a1:4 b1:4", real=True), sp.symbols("pa1:4 pb1:4", real=True)
        apart = sum((q[i] - q[i + 3]) ** 2 for i in range(3))
        return gs.System(q, p, (), sum(x**2 for x in p) / 2 + apart / 2 + apart**2 / 8,
                         name="pair")
    if name == "dragged":
        return gs.System((X, Y, Z), (PX, PY, PZ), (C,), SPACE + (X**2 + Y**2 + 4 * Z**2) / 2,
                         SPHERE, name="dragged", forces=(-C * PX, -C * PY, -C * PZ))
    return name


@cache
def stepper(name: str, scheme: str, stages: int | None, frame: str | None = "symmetries"):
    rep = "gamma" if isinstance(system(name), str) else None
    return gs.stepper(scheme, stages, rep, system=system(name), frame=frame)


def start(name: str, apart: float, rng: np.random.Generator):
    """Return q, p and parameters so far from a stratum."""
    turn, spin = rng.uniform(0, 2 * np.pi), rng.normal(size=3)
    if name in ("pendulum", "dragged"):
        q = np.array([np.sin(apart) * np.cos(turn), np.sin(apart) * np.sin(turn),
                      rng.choice([-1.0, 1.0]) * np.cos(apart)])
        q /= np.linalg.norm(q)
        more = {"c": float(rng.uniform(0.01, 0.5))} if name == "dragged" else {}
        return q, spin - q * (q @ spin), more
    if name == "pair":
        along, off = rng.normal(size=3), rng.normal(size=3)
        half, speed = along * rng.uniform(0.1, 1), along * rng.normal() + apart * off
        return np.concatenate([half, -half]), np.concatenate([speed, -speed]), {}
    tilt = apart if rng.random() < 0.5 else np.pi - apart
    q = np.array([np.cos(tilt / 2), np.sin(tilt / 2) * np.cos(turn),
                  np.sin(tilt / 2) * np.sin(turn), 0.0])
    q /= np.linalg.norm(q)
    across = rng.choice([1.0, apart])  # about its own axis, or not
    omega = np.array([across * spin[0], across * spin[1], 4 * spin[2]])
    more = {"mgl": float(rng.uniform(0.2, 2))} if name == "heavy_top" else {
        "I2": float(rng.choice([1.0, 1.2]))}
    numbers = NUMBERS | more
    return q, gs.Start.of_body(q, omega, [numbers[f"I{k}"] for k in (1, 2, 3)]).p, numbers


def ratio(name: str, scheme: str, stages: int | None, seed: int, power: float, dt: float) -> float:
    """Return the error with "auto" over that without a frame, both at least round-off."""
    rng = np.random.default_rng(seed)
    q, p, numbers = start(name, 10.0**power, rng)
    step = stepper(name, scheme, stages)
    exact = stepper(name, "G-L", 6, None).integrate(
        q, p, dt=dt / 4, steps=4 * STEPS, every=4, parameters=numbers).q
    floor = 32 * np.finfo(float).eps * abs(exact).max()
    still, moved = (floor + np.sqrt(((step.integrate(
        q, p, dt=dt, steps=STEPS, parameters=numbers | more).q - exact) ** 2).sum(axis=1).mean())
        for more in ({}, {"frame": "auto"}))
    return float(moved / still)


def error(run, exact) -> float:
    return float(np.sqrt(((run.q - exact) ** 2).sum(axis=1).mean()))


# ---------------------------------------------------------------- through an axis


@pytest.mark.parametrize(("apart", "frame"), [
    (0.0, "auto"), (1e-6, "auto"), (0.0, "start"), (1e-6, "follow")])
def test_a_pendulum_passes_its_axis(apart, frame):
    """ω = J/𝕀 is 1.6e16 rad/s at sin π: in that frame the pendulum stands still for ever."""
    step = framed_point()
    q, p = [np.sin(np.pi) + apart, 0.0, -np.sqrt(1 - apart**2)], [0.0, 1.5, 0.0]
    how = {"dt": 0.02, "steps": 150}
    exact = step.integrate(q, p, dt=0.02 / 16, steps=16 * 150, every=16, parameters=PENDULUM).q
    plain = step.integrate(q, p, **how, parameters=PENDULUM)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        moved = step.integrate(q, p, **how, parameters=PENDULUM | {"frame": frame})
    assert error(moved, exact) <= 1.05 * error(plain, exact) + 1e-13
    assert [one.category for one in told] == ([] if frame == "auto" else [gs.errors.InputWarning])


def test_members_of_an_ensemble_pass_their_axis():
    step = framed_point()
    q = [[x, 0.0, -np.sqrt(1 - x**2)] for x in (0.6, np.sin(np.pi))]
    how = {"dt": 0.02, "steps": 50}
    with pytest.warns(gs.errors.InputWarning, match="omega"):
        many = step.integrate_ensemble(q, [[0, 1.5, 0]] * 2, **how,
                                       parameters=PENDULUM | {"frame": "start"})
    rates = [one.parameters[step.symmetries[0].name] for one in many.members]
    assert rates == [pytest.approx(2.5), 0.0]
    plain = step.integrate_ensemble(q, [[0, 1.5, 0]] * 2, **how, parameters=PENDULUM)
    assert_allclose(many.q, plain.q, atol=1e-6)


@pytest.mark.parametrize("tilt", [1e-3, 1e-6])
def test_a_top_that_is_nearly_upright_keeps_one_of_two_rates(tilt):
    """Both axes are nearly one: the least squares of both rates are (−1/tilt, 1/tilt)."""
    step = systems.stepper("heavy_top_in_frame")
    q = np.array([np.cos(tilt / 2), np.sin(tilt / 2), 0, 0])
    p = gs.Start.of_body(q, (0.3, 0.3, 8.0), INERTIA).p
    numbers, how = NUMBERS | {"mgl": 1.0}, {"dt": 0.01, "steps": 100}
    exact = step.integrate(q, p, dt=0.01 / 16, steps=1600, every=16, parameters=numbers).q
    with pytest.warns(gs.errors.InputWarning, match="omega"):
        moved = step.integrate(q, p, **how, parameters=numbers | {"frame": "start"})
    assert error(moved, exact) < error(step.integrate(q, p, **how, parameters=numbers), exact)
    assert sorted(moved.parameters[one.name] != 0 for one in step.symmetries) == [False, True]


@pytest.mark.parametrize("angle", [1e-6, 1e-3, 0.5])
def test_a_cone_of_any_angle_keeps_its_rate(angle):
    """A conical pendulum turns at ω = 1/√cos θ, however near its axis: a relative equilibrium."""
    rate = 1 / np.sqrt(np.cos(angle))
    run = framed_point().integrate(
        [np.sin(angle), 0.0, -np.cos(angle)], [0.0, rate * np.sin(angle), 0.0], dt=0.1, steps=50,
        parameters=PENDULUM | {"frame": "start"})
    name = framed_point().symmetries[0].name
    assert run.parameters[name] == pytest.approx(rate, rel=1e-9)
    assert abs(run.q[:, 2] + np.cos(angle)).max() < 1e-15


# ---------------------------------------------------------------- inputs


@pytest.mark.parametrize(("frame", "hold"), [("start", 1), ("auto", 3), ("follow 20", 1)])
def test_a_frame_is_chosen_with_the_inputs_of_the_run(frame, hold):
    step, q, p = framed_point(), [0.6, 0.0, -0.8], [0.0, 0.7, 0.0]
    how = {"dt": 0.1, "steps": 90}
    u = 0.5 * np.sin(np.arange(90 // hold) * hold / 9)
    fine = step.integrate(q, p, dt=0.1 / 16, steps=90 * 16, every=16,
                          inputs=gs.Inputs({"u": u}, hold=16 * hold), parameters=WEIGHT)
    plain, moved = (step.integrate(q, p, **how, inputs=gs.Inputs({"u": u}, hold=hold),
                                   parameters=more)
                    for more in (WEIGHT, WEIGHT | {"frame": frame}))
    worse = 1.05 if frame == "auto" else 10  # nobody has asked whether the other two are better
    assert error(moved, fine.q) <= worse * error(plain, fine.q)
    held, given = (step.integrate(q, p, **how, **more) for more in (
        {"inputs": {"u": 0.3}, "parameters": WEIGHT | {"frame": frame}},
        {"parameters": WEIGHT | {"u": 0.3, "frame": frame}}))
    assert_array_equal(held.q, given.q)
    assert held.parameters == given.parameters


def test_a_choice_is_measured_with_the_inputs():
    """Without weight the motion is a great circle, a relative equilibrium; with it it is not."""
    step, q, p = framed_point(), [0.6, 0.0, -0.8], [0.0, 0.7, 0.0]
    name = step.symmetries[0].name
    rates = [gs.choose_frame(step, q, p, dt=0.1, steps=60, parameters=WEIGHT,
                             inputs={"u": u}).frame[name] for u in (0.0, -2.0)]
    run = step.integrate(q, p, dt=0.1, steps=60, parameters=WEIGHT | {"frame": "auto"},
                         inputs={"u": -2.0})
    assert run.parameters[name] in (rates[1], step.integrate(
        q, p, dt=0.1, steps=60, parameters=WEIGHT | {"frame": "start"},
        inputs={"u": -2.0}).parameters[name])
    assert rates[0] != rates[1]


# ---------------------------------------------------------------- every stratum


NAMES = ["pendulum", "pair", "heavy_top", "free_body"]
STARTS = {"seed": st.integers(0, 2**32 - 1), "power": st.floats(-17, 0),
          "dt": st.floats(0.01, 0.15)}


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(**STARTS)
@pytest.mark.parametrize(("scheme", "stages"), METHODS)
@pytest.mark.parametrize("name", [*NAMES, "dragged"])
def test_auto_is_never_worse_than_no_frame_by_any_method(name, scheme, stages, seed, power, dt):
    """1,440 conservative starts, 360 with drag."""
    assert ratio(name, scheme, stages, seed, power, dt) <= 1.05
