"""A controller reads bodies, joints and inputs of a simulation at its present state."""

from __future__ import annotations

import inspect
import pickle
import re
from fractions import Fraction

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gyrospark as gs
import systems
from gyrospark.runtime.integration.run_arguments import steps_until
from gyrospark.runtime.results.body_motion import BodyMotion
from gyrospark.runtime.results.joint_motion import JointMotion

EPS = float(np.finfo(float).eps)
#: Arguments without which a method cannot be called.
NEEDED = {"euler": ("ZYX",)}


def refused(*words):
    """Expect an InputError that has these words, in this order."""
    return pytest.raises(gs.InputError, match=".*".join(map(re.escape, words)))


def advanced(name, steps=30):
    """Return a simulation of a catalogue's system, and the same run."""
    case, step = systems.case(name), systems.stepper(name)
    q, p = systems.start(name, step)
    sim = step.start(q, p, dt=case.dt, parameters=case.parameters)
    sim.advance(steps)
    return sim, systems.run(name, step, steps)


def calls(kind, *without):
    """Return every public method and property of a class of motions, with its arguments."""
    for name, member in inspect.getmembers(kind):
        if not name.startswith("_") and name not in (*without, "plot"):
            yield name, (NEEDED.get(name, ()) if callable(member) else None)


def value_of(motion, name, arguments):
    """Return the value of a method or property, or the type of its refusal."""
    try:
        value = getattr(motion, name)
        return value if arguments is None else value(*arguments)
    except gs.InputError as error:
        return type(error)


def assert_is_row(present, motion, kind, *without):
    """Check each method against the last row of a run's, to 64 roundings of its size."""
    for name, arguments in calls(kind, *without):
        now, rows = (value_of(view, name, arguments) for view in (present, motion))
        if name == "rotation":
            now, rows = now.as_quat(), rows.as_quat()
        if name in ("mass", "inertia", "centre", "moves", "has_axis") or isinstance(rows, type):
            assert np.array_equal(now, rows), name
        else:
            last = np.asarray(rows)[-1]
            assert np.shape(now) == last.shape, name
            assert np.abs(now - last).max() <= 64 * EPS * max(np.abs(rows).max(), 1), name


@pytest.mark.parametrize("name", ["heavy_top", "double_top", "four_bar", "satellite"])
def test_every_method_of_a_body_returns_the_last_row_of_a_run(name):
    sim, run = advanced(name)
    for body in run.bodies:
        assert_is_row(sim.body(body), run.body(body), BodyMotion, "name")
        turning = sim.body(body).angular_velocity("space")
        assert np.abs(turning - run.body(body).angular_velocity("space")[-1]).max() <= (
            64 * EPS * np.abs(turning).max())


@pytest.mark.parametrize("name", ["double_top", "four_bar", "gimbal"])
def test_every_method_of_a_joint_returns_the_last_row_of_a_run(name):
    """Forces belong to the step that would follow: row 0 of a run from the present state."""
    sim, run = advanced(name)
    case, step = systems.case(name), systems.stepper(name)
    following = step.integrate(sim.q, sim.p, dt=sim.dt, steps=1, parameters=case.parameters)
    for joint in run.joints:
        assert_is_row(sim.joint(joint), run.joint(joint), JointMotion, "force", "torque", "name",
                      "bodies", *(["angle"] if name == "gimbal" else []))
        for method in ("force", "torque"):
            expected = getattr(following.joint(joint), method)()[0]
            assert np.array_equal(getattr(sim.joint(joint), method)(), expected)
    if name == "gimbal":  # the run has counted the turns of the wheel
        turns = (sim.joint("spindle").angle() - run.joint("spindle").angle()[-1]) / (2 * np.pi)
        assert turns == pytest.approx(round(turns), abs=64 * EPS * 10)


def test_angles_by_which_a_model_goes_are_its_quantities():
    """Kernels compiled from symbols agree with floats; J is a tensor."""
    model, step = systems.case("arm").system, systems.stepper("arm", "IMS")
    run = step.integrate(model.q0, model.p0, dt=5e-3, steps=40, parameters=model.parameters)
    sim = step.start(model.q0, model.p0, dt=5e-3, parameters=model.parameters)
    sim.advance(40)
    for k, name in enumerate(["hinge0", "hinge1"]):
        assert sim.joint(name).angle() == pytest.approx(sim.quantity(f"turn{k}"), abs=16 * EPS)
        assert sim.joint(name).rate() == pytest.approx(sim.quantity(f"speed{k}"), abs=99 * EPS)
        assert_is_row(sim.joint(name), run.joint(name), JointMotion, "force", "torque", "name",
                      "bodies")
        assert_is_row(sim.body("rod1"), run.body("rod1"), BodyMotion, "name")
    assert sim.joint("hinge1").angle(degrees=True) == pytest.approx(
        np.degrees(sim.quantity("turn1")), rel=16 * EPS)


def test_rates_in_fifty_digits():
    """Ω = J⁻¹ ½ L(q) p agrees with mpmath, with J of the present parameters."""
    sim, _ = advanced("heavy_top")
    moments = [sim.parameters[f"I{i}"] for i in (1, 2, 3)]
    for factor in (1, 3):
        sim.parameters = sim.parameters | {"I1": factor * moments[0]}
        with mp.workdps(50):
            (a, b, c, d), p = map(mp.mpf, sim.q), mp.matrix([mp.mpf(x) for x in sim.p])
            L = mp.matrix([[-b, a, d, -c], [-c, -d, a, b], [-d, c, -b, a]])
            exact = [x / (2 * mp.mpf(J)) for x, J in zip(
                L * p, [factor * moments[0], *moments[1:]], strict=True)]
        largest = max(map(abs, exact))
        assert all(abs(x - y) <= 8 * EPS * largest  # four products, three sums, a quotient
                   for x, y in zip(sim.body().angular_velocity(), exact, strict=True))


def test_a_body_follows_its_simulation():
    sim, _ = advanced("satellite", 0)
    body, start = sim.body(), sim.q
    attitude = body.attitude
    assert sim.body() is body
    assert sim.body("a").name == "a"
    sim.advance(5)
    assert np.array_equal(attitude, start)  # a copy
    assert np.array_equal(body.attitude, sim.q)
    unpickled, unpickled_body = pickle.loads(pickle.dumps((sim, body)))
    unpickled.advance(5)
    assert np.array_equal(unpickled_body.attitude, unpickled.q)
    assert not np.array_equal(body.attitude, unpickled.q)
    assert "satellite" in repr(body)


def test_what_is_not_there_is_refused():
    sim, _ = advanced("double_top", 0)
    with refused("'c'", "a or b"):
        sim.body("c")
    with refused("'jonit'", "joint"):
        sim.joint("jonit")
    with refused("2", "a, b"):
        sim.body()
    with refused("record=True", "sim.trajectory.body('a')"):
        sim.body("a").plot()
    with refused("'joint'", "axis"):
        sim.joint().angle()
    with refused("'universe'", "body", "space"):
        sim.body("a").angular_velocity("universe")
    with refused("joints"):
        advanced("satellite", 0)[0].joint()


def test_inputs_are_those_of_advance():
    """Inputs have the same bits, recorded or not; methods of the mapping work as of a dict."""
    model, step = systems.case("arm").system, systems.stepper("arm", "IMS")
    plain, recorded = (step.start(model.q0, model.p0, dt=5e-3, parameters=model.parameters,
                                  record=record) for record in (False, True))
    assert dict(plain.input) == {"u0": 0.2, "u1": -0.1}
    plain.advance(7, u0=0.3)
    plain.advance(2)
    recorded.input["u0"] = 0.3
    assert (recorded.input["u0"], len(recorded.input), recorded.input.get("v")) == (0.3, 2, None)
    recorded.advance(7)
    recorded.advance(2)
    assert np.array_equal(plain.q, recorded.q)
    assert recorded.trajectory.joint("hinge1").rate()[-1] == pytest.approx(
        plain.joint("hinge1").rate())
    recorded.input.update(u0=0.1)
    assert recorded.parameters["u0"] == 0.1
    assert "u0" in recorded.input
    assert "v" not in recorded.input
    for call in (lambda: recorded.input["v"], lambda: recorded.input.update(v=1)):
        with refused("'v'", "u0"):
            call()
    with refused("'u0'", "0"):
        del recorded.input["u0"]
    with refused("u0", "nan"):
        recorded.input["u0"] = float("nan")


@given(st.fractions(-2, 2, max_denominator=997), st.sampled_from([0.1, -0.1, 1e-3, 0.3, 1 / 3]),
       st.integers(0, 10**6))
@settings(max_examples=30)
def test_grid_times_are_found_in_decimals(t0, dt, steps):
    """n dt as a float leads to n, and a hundredth of a step more or less to n or n − 1."""
    t0, between = float(t0), Fraction(dt) / 100
    t = Fraction(t0) + steps * Fraction(dt)
    assert steps_until(float(t), t0, dt) == steps
    assert steps_until(t + between, t0, dt) == steps
    assert steps_until(t - between, t0, dt) == steps - 1


@pytest.mark.parametrize("dt", [0.1, -0.1])
def test_steps_lead_to_the_last_time_not_beyond(dt):
    case, step = systems.case("pushed_pendulum"), systems.stepper("pushed_pendulum")
    q, p = systems.start("pushed_pendulum", step)
    sims = [step.start(gs.Start(q, p, t=2.0), dt=dt, parameters=case.parameters) for _ in range(2)]
    name = next(iter(sims[0].input))
    sims[0].advance(3, **{name: 0.2})
    sims[1].advance_to(2 + 3 * dt, **{name: 0.2})  # 2.3 and 1.7 in decimals
    sims[1].advance_to(2 + 3.9 * dt)
    assert [sim.steps for sim in sims] == [3, 3]
    assert np.array_equal(*(sim.q for sim in sims))
    sims[1].advance_to(sims[1].t)
    with refused(f"{2 + 2.5 * dt:.15g}", f"{2 + 3 * dt:.15g}"):
        sims[1].advance_to(2 + 2.5 * dt)
    for value in ("soon", float("inf")):
        with refused("t", str(value)):
            sims[1].advance_to(value)
    assert sims[1].steps == 3
