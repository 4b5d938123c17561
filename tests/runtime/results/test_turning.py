"""The fastest rotation is reported in radians a step, and a run may warn of it."""

from __future__ import annotations

import warnings
from functools import partial
from math import pi

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import LATE, TOP
from gyrospark.errors import InputWarning
from gyrospark.runtime.integration.linear_frequency import fastest_frequency
from gyrospark.runtime.integration.run_arguments import StartNumbers
from gyrospark.runtime.results.rotation_rate import fastest_rotation, phase_error

RUN = ("run", "fast-top", "--json", "--steps", "20")
SCHEMES = [("EMS",), ("G-L", "--stages", "2")]


@pytest.mark.parametrize("scheme", SCHEMES, ids=" ".join)
@pytest.mark.parametrize("dt", ["1e-3", "1e-2"])
def test_the_papers_runs_do_not_warn(scheme, dt, gyrospark):
    answer = gyrospark(*RUN, "--scheme", *scheme, "--dt", dt)
    assert answer.stderr == ""
    assert answer.document["radians_per_step"] == pytest.approx(40 * pi * float(dt), rel=0.01)
    assert answer.document["fastest_body"] == "body"


@pytest.mark.parametrize(("scheme", "borne"), [(("EMS",), 1.5), (("G-L", "--stages", "2"), 2.5),
                                               (("G-L", "--stages", "3"), 3.5)], ids=str)
def test_more_than_is_borne_is_reported(scheme, borne, gyrospark):
    """Below the bound nothing is reported, above it a line with a dt that is below it again."""
    rate = 40 * pi
    below, above = (str(factor * borne / rate) for factor in (0.98, 1.02))
    assert gyrospark(*RUN, "--scheme", *scheme, "--dt", below).stderr == ""
    answer = gyrospark(*RUN, "--scheme", *scheme, "--dt", above)
    assert answer.code == 0
    assert answer.stderr.count("\n") == 1
    for words in (f"{1.02 * borne:.2f} rad", f"{borne:g}",
                  f"well below {borne / rate:.2g}."):
        assert words in answer.stderr
    assert answer.document["radians_per_step"] > borne


def test_a_failed_step_and_its_rotation_are_reported_in_one_line(gyrospark):
    answer = gyrospark(*RUN, "--scheme", "IMS", "--dt", "1e300")
    assert answer.code == 1
    assert answer.stderr.count("\n") == 1
    for words in ("Step 1", "1.5"):
        assert words in answer.stderr


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_the_error_and_the_bound_of_order_two(gl3):
    """A midpoint turns by 4 arctan(θ/4) in place of θ: two radians are lost in some turns."""
    dt = 1.5 / (40 * pi)
    midpoint = systems.stepper("heavy_top", "EMS").integrate(TOP, dt=dt, steps=28)
    exact = gl3.integrate(TOP, dt=dt / 8, steps=8 * 28, every=8)
    angle = 2 * np.arccos(np.clip(np.abs((midpoint.q * exact.q).sum(axis=1)), 0, 1))
    assert angle[14] == pytest.approx(14 * (1.5 - 4 * np.arctan(1.5 / 4)), rel=0.1)


@pytest.mark.parametrize("radians", [2.0, 3.4])
def test_the_error_that_order_six_has(gl3, radians):
    """The fast top errs by a hundredth of the expectation at least, and never by more."""
    dt = radians / (40 * pi)
    run = gl3.integrate(TOP, dt=dt, steps=40)
    exact = gl3.integrate(TOP, dt=dt / 8, steps=8 * 40, every=8)
    sign = np.sign((run.q[-1] * exact.q[-1]).sum())
    error = 2 * np.linalg.norm(sign * run.q[-1] - exact.q[-1]) / (40 * radians)
    assert phase_error(6, radians) / 100 < error < phase_error(6, radians)


def test_a_warning_has_the_error_to_expect(gl3):
    """Order 6 bears 3.5 rad; just beyond it is 2 % off, and the motion is lost from 4.2 on."""
    for radians, words in ((3.6, "2e-02"), (4.5, "lost")):
        with pytest.warns(gs.errors.InputWarning, match=words):
            gl3.step(TOP, dt=radians / (40 * pi))


def test_of_several_bodies_the_fastest(gyrospark):
    answer = gyrospark("run", "double_top", "--scheme", "G-L", "--stages", "2", "--dt", "1e-3",
                       "--steps", "5", "--json", "--out", "run.npz")
    run = gs.load("run.npz")
    rates = {name: np.linalg.norm(run.angular_velocity(name), axis=1).max() for name in "ab"}
    fastest = max("ab", key=rates.__getitem__)
    assert rates["a"] != rates["b"]
    assert answer.document["fastest_body"] == fastest
    assert answer.document["radians_per_step"] == pytest.approx(rates[fastest] * 1e-3, rel=1e-9)


def test_what_does_not_turn_has_none(gyrospark):
    """Points have no rotation in a step, nor have tops in their frame."""
    scheme = "--scheme", "G-L", "--stages", "2"
    points = gyrospark("run", "examples/pendulum.toml", *scheme, "--steps", "5", "--dt", "1",
                       "--json")
    framed = gyrospark(*RUN, *scheme, "--frame", "start", "--dt", "2e-2")
    for answer in (points, framed):
        assert "radians_per_step" not in answer.document
    assert framed.stderr == ""


def said_of(call):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    return [str(warning.message) for warning in caught if warning.category is gs.errors.InputWarning
            and warning.filename == __file__]


def test_python_warns_as_the_command_does(gl3, tmp_path):
    """At 2 rad a step no call warns, at 6.3 each does once; the advice is a smaller step."""
    start, pair = (TOP.q0, TOP.p0), ([TOP.q0] * 2, [TOP.p0] * 2)
    calls = {
        "integrate": lambda options: gl3.integrate(*start, steps=4, **options),
        "start": lambda options: gl3.start(*start, **options),
        "step": lambda options: gl3.step(*start, **options),
        "ensemble": lambda options: gl3.integrate_ensemble(*pair, steps=4, **options),
        "one": lambda options: gl3.integrate_ensemble(*(x[:1] for x in pair), steps=4, **options),
        "differ": lambda options: gl3.integrate_ensemble(
            *pair, steps=4, **options | {"dt": [1e-3, options["dt"]]}),
        "record": lambda options: gl3.integrate(*start, steps=4, **options,
                                        out=tmp_path / f"{options['dt']}.zarr"),
        "sweep": lambda options: gs.sweep("fast-top", {"dt": [1e-3, options["dt"]]}, scheme="G-L",
                                          stages=3, steps=4, parameters={"gamma": 4e-4}),
        "tuned": lambda options: gl3.integrate(gs.Start(*start, TOP.parameters).of_model(
            {"gamma": TOP.inertia}, {"gamma": "auto"}), dt=options["dt"], steps=4),
    }
    for name, call in calls.items():
        slow, fast = ({"dt": dt, "parameters": TOP.parameters} for dt in (2 / (40 * pi), 0.05))
        assert said_of(partial(call, slow)) == [], name
        texts = [text for text in said_of(partial(call, fast)) if "rad" in text]
        assert len(texts) == 1, name  # cells of the sweep fail too, with another warning
        assert "6.28 rad" in texts[0], name


def test_a_body_that_gets_fast_on_the_way():
    """A top let go near its highest place rests at first; a state on the way shows its rate."""
    q, p = LATE
    step = systems.stepper("heavy_top")
    run = {"dt": 0.09, "parameters": TOP.parameters}
    assert len(said_of(lambda: step.integrate(q, p, steps=200, **run))) == 1
    starts = [gs.Start(q, p), gs.Start(q * [1, -1, 1, 1], p)]
    assert len(said_of(lambda: step.integrate_ensemble(starts, steps=200, **run))) == 1
    assert said_of(lambda: step.integrate_ensemble(starts[:1], steps=2, **run)) == []
    assert said_of(lambda: step.start(q, p, **run)) == []


def test_the_fastest_rotation_of_a_run_is_that_of_its_states(tmp_path):
    """A top falls freely; the energy bounds its rotation: ½ I₁ ω² ≤ H + m g l."""
    q, p = LATE
    step = systems.stepper("heavy_top")
    run = {"dt": 1e-2, "steps": 90, "parameters": TOP.parameters}
    motion = step.integrate(q, p, **run)
    omega = np.linalg.norm(motion.body().angular_velocity(), axis=1)
    assert motion.rotation_max == pytest.approx(1e-2 * omega.max(), rel=1e-12)
    assert motion[:1].rotation_max == 0.0
    assert 0 < motion[:20].rotation_max < motion.rotation_max
    assert motion.rotation_max <= 1e-2 * np.sqrt(
        2 * (motion.energies[0] + TOP.parameters["mgl"]) / min(TOP.inertia))
    assert step.integrate(q, p, **run, out=tmp_path / "a.zarr").rotation_max == motion.rotation_max


def test_a_stored_run_that_is_fast_on_the_way_warns(tmp_path):
    """At the end the top is slow again: the last row alone would not show it."""
    q, p = LATE
    step = systems.stepper("heavy_top")
    run = {"dt": 0.09, "parameters": TOP.parameters}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        motion = step.integrate(q, p, steps=200, **run)
    slow = next(k for k in range(150, 200) if fastest_rotation(motion[k - 1:k]).radians < 1.0)
    texts = said_of(lambda: step.integrate(q, p, steps=slow - 1, **run, out=tmp_path / "s.zarr"))
    assert len(texts) == 1


def test_every_type_has_radians():
    for real in ("float", "float128"):
        step = systems.stepper("heavy_top", real=real)
        parameters = TOP.parameters | {"gamma": 0.0016}
        run = step.integrate(*step.project(TOP.q0, TOP.p0, parameters=parameters), dt=0.01,
                             steps=2, parameters=parameters)
        assert fastest_rotation(run).radians == pytest.approx(0.4 * pi, rel=1e-3)


@pytest.mark.parametrize(("name", "scheme", "real", "omega"), [
    *(("driven_oscillator", ("G-L", 2), real, 2) for real in ("double", "float", "float128")),
    ("henon_heiles", ("EMS", None), "double", 1)])
def test_an_oscillator_at_five_rad_a_step_is_warned_of(name, scheme, real, omega):
    """Near rest the warning has ω Δt; steps of the dt that it names follow the motion."""
    step = systems.stepper(name, *scheme, real)
    parameters = dict.fromkeys(systems.case(name).parameters, 1e-30)
    if parameters:
        parameters["k"] = omega**2
    q, p = (1e-6 * x for x in systems.start(name, step))
    dt = 5 / omega
    with pytest.warns(InputWarning, match=rf"{omega} rad.*order [24]") as warnings:
        step.integrate(q, p, dt=dt, steps=3, parameters=parameters)
    cure = float(str(warnings[0].message).rpartition("below ")[2].rstrip("."))
    step.integrate(q, p, dt=cure, steps=3, parameters=parameters)  # no warning


def test_a_constrained_motion_has_the_frequency_of_its_tangent_space():
    """A pendulum released at rest beside the lowest point has ω² = g cos(θ)/l."""
    step = systems.stepper("pendulum", "EMS")
    q, p = np.array([np.sin(1e-4), -np.cos(1e-4)]), np.zeros(2)
    parameters = {"m": 1.0, "g": 9.0, "l": 1.0}
    run = step._run_arguments(StartNumbers(q, p, parameters, 0.0), dt=3.0, steps=5)
    assert fastest_frequency(step.binding, run, 2) == pytest.approx(3.0, rel=1e-5)
