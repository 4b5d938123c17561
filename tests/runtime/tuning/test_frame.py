"""Chosen rates of co-moving frames: least squares of a start, pilot runs, and the guard over them.

The promises of a choice are measured here again: beside a run of a method of more stages, beyond
the pilot runs, and for motions where a frame does not help or harms.
"""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from calls import refused
from framed_point import FIELD, PENDULUM, framed_point
from gyrospark.core.manifest import Manifest
from gyrospark.core.registry import SYSTEMS
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.runtime.integration.manifest_symmetries import symmetries_of
from gyrospark.runtime.rigid_body.quaternion import left_matrix, rotation_matrix
from gyrospark.runtime.tuning.frame_start import directions_of
from gyrospark.runtime.tuning.spectral_lines import SpectralLines

TOP = gs.problems.fast_top()
CONE = gs.problems.regular_precession()
BODY = gs.problems.free_body()
DRAG = sp.Symbol("c", real=True)


def framed():
    return systems.stepper("heavy_top_in_frame")


def test_the_start_of_a_relative_equilibrium_tells_its_rates():
    rates = gs.tune(framed(), CONE, dt=1e-2, frame="start").parameters
    Omega = CONE.exact.angular_velocity(0.0)
    nutation = 2 * np.arccos(np.hypot(CONE.q0[0], CONE.q0[3]))
    space = 30.0  # the problem's rate
    assert rates["omega_space"] == pytest.approx(space, rel=1e-12)
    assert rates["omega_body"] == pytest.approx(Omega[2] - space * np.cos(nutation), rel=1e-12)


def test_asymmetric_bodies_keep_what_is_left():
    """A body with three moments has only the rotations of space as symmetries."""
    rates = gs.tune(framed(), BODY.q0, BODY.p0, dt=1e-3, frame="start", parameters={
        "I1": 1.0, "I2": 2.0, "I3": 3.0, "mgl": 0.1}).parameters
    assert rates["omega_body"] == 0
    assert rates["omega_space"] != 0


def test_three_rotations_of_space_turn_about_the_angular_momentum():
    """A free body has the direction of l = R ½ L(q) p, and none at rest with three moments."""
    spec = Spec.from_arguments("G-L", 1, "gamma", "free_body").with_frame("symmetries")
    stepper = SimpleNamespace(symmetries=symmetries_of(Manifest.from_json(
        json.loads(generate(spec).source.manifest))))
    body, space = directions_of(stepper, BODY.q0, BODY.p0, dict.fromkeys(("I1", "I2", "I3"), 1.0))
    momentum = rotation_matrix(BODY.q0) @ left_matrix(BODY.q0) @ BODY.p0 / 2
    assert body.weights == {"omega_body": 1}
    assert [*space.weights.values()] == pytest.approx(momentum / np.linalg.norm(momentum))
    assert not directions_of(stepper, BODY.q0, 0 * BODY.p0, {"I1": 1.0, "I2": 2.0, "I3": 2.5})


def test_a_model_with_a_frame_starts_in_it():
    """A run without rates takes the least squares, in whatever way it begins."""
    step = framed()
    model = gs.Model(SYSTEMS["heavy_top"].make("gamma"), TOP.parameters, TOP.q0, TOP.p0,
                     bodies={"gamma": TOP.inertia}, frame="symmetries")
    rates = gs.tune(step, TOP, dt=2e-3, frame="start").parameters
    run = step.integrate(model, dt=2e-3, steps=20)
    simulation = step.start(model, dt=2e-3)
    simulation.advance(20)
    assert {name: run.parameters[name] for name in rates} == rates
    assert np.array_equal(simulation.q, run.q[-1])
    overridden = step.integrate(model, dt=2e-3, steps=20, parameters={"omega_body": 100.0})
    assert (overridden.parameters["omega_body"],
            overridden.parameters["omega_space"]) == (100.0, 0.0)


def test_a_choice_says_what_it_was_chosen_by():
    step = framed()
    tuned = gs.tune(step, TOP, dt=1e-2, frame="auto", pilot_steps=200)
    assert tuned.parameters.keys() == {"omega_body", "omega_space"}
    plain, start = tuned.pilots[:2]
    assert (plain.label, start.label) == ("no frame", "least squares of the start")
    chosen = next(pilot for pilot in tuned.pilots if pilot.parameters == tuned.parameters)
    assert tuned.error == chosen.motion < start.motion / 10
    assert tuned.gain == pytest.approx(plain.motion / chosen.motion)
    assert plain.worst == 1 > 1000 * chosen.worst
    assert "no symmetry" not in tuned.reason


def test_where_a_frame_harms_none_is_taken_or_a_better_one():
    """Least squares alone harm a point on a sphere, in a field that two axes share."""
    step, start = framed_point(), gs.Start([0.6, 0.0, 0.8], [0.4, 1.1, -0.3], FIELD)
    exact = step.integrate(start, dt=0.0125, steps=3200, every=8)
    error = {}
    for mode in (None, "start", "auto"):
        rates = {} if mode is None else gs.tune(step, start, dt=0.1, steps=400,
                                                frame=mode).parameters
        run = step.integrate(start, dt=0.1, steps=400, parameters=rates)
        error[mode] = np.sqrt(((run.q - exact.q) ** 2).mean())
    assert error["start"] > error[None]
    assert error["auto"] <= 1.05 * error[None]


def test_a_motion_without_error_needs_no_frame():
    """At a small step the error is round-off, and no frame is searched for."""
    tuned = gs.tune(framed(), TOP, dt=1e-6, frame="auto", pilot_steps=50)
    assert "round-off" in tuned.reason
    assert set(tuned.parameters.values()) == {0.0}
    assert tuned.gain == 1


@pytest.mark.parametrize(("scheme", "solver"), [
    (("G-L", 2), "auto"), (("G-L", 2), "newton"),
    pytest.param(("IMS", None), "newton", marks=pytest.mark.slow)])  # a stepper for this
def test_energy_is_the_work_of_drag_to_the_order_of_the_method(scheme, solver):
    """The work F·q̇ includes the part of q̇ that the frame moves by itself, Σ ω_i A_i q.

    H and g are quadratic: with IMS nothing but rounding is left.
    """
    step = framed_point(*scheme)
    start = gs.Start([0.6, 0.0, 0.8], [0.4, 1.1, -0.3], FIELD | {"c": 0.5})
    rates = gs.tune(step, start, dt=0.05, frame="start").parameters
    assert any(rates.values())
    longer = gs.tune(step, start, dt=0.05, frame="auto")  # forces take it out of a frame
    assert set(longer.parameters.values()) == {0.0}
    assert "forces" in longer.reason
    largest = [abs(step.integrate(start, dt=0.05 / k, steps=80 * k, solver=solver,
                                  parameters=rates).energy_error()).max() for k in (1, 2, 4)]
    if scheme[0] == "IMS":
        assert max(largest) < 64 * np.finfo(float).eps
    else:
        assert largest[0] / largest[1] == pytest.approx(16, rel=0.2)
        assert largest[1] / largest[2] == pytest.approx(16, rel=0.2)


def test_forces_that_do_not_turn_with_a_frame_have_none():
    top = SYSTEMS["heavy_top"].make("gamma")
    forces = (-DRAG * top.p[0], *(-DRAG * p for p in top.p[1:3]), -2 * DRAG * top.p[3])
    system = replace(top, forces=forces, parameters=(*top.parameters, DRAG), name="uneven_drag")
    with refused("co-moving"):
        gs.stepper("G-L", 2, system=system, frame="symmetries")


def test_lines_are_centred():
    """For two lines of power 9 and 1, M_1 is least at their mean, higher powers near the middle.

    Power at the end of the band shows that it may be folded.
    """
    t = np.arange(4096) * 0.01
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    q = np.stack([3 * wave(20 * t) + wave(26 * t) for wave in (np.cos, np.sin)], axis=1)
    lines = SpectralLines(q, q, 0.01, [turn])
    assert lines.is_resolved
    assert lines.minimise(1, np.zeros(1)) == pytest.approx([(9 * 20 + 26) / 10], rel=1e-6)
    middle = 20 + 6 / (1 + 9 ** (1 / 11))  # 9 x^11 = (6 - x)^11
    # A window has a width.
    assert lines.minimise(6, np.zeros(1)) == pytest.approx([middle], rel=2e-3)
    # Rows at 0.12 s end the band at 26.2 rad/s, beside a line; at 0.16 s 20 rad/s fold to −19.3.
    for every, resolved in ((8, True), (12, False), (16, False)):
        rows = q[::every]
        assert SpectralLines(rows, rows, 0.01 * every, [turn]).is_resolved is resolved


def error(run, exact) -> float:
    return float(np.sqrt(((run.q - exact) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("frame", ["auto", "start"])
@pytest.mark.parametrize("apart", [0.0, 1e-6])
def test_a_pendulum_passes_its_axis(apart, frame):
    """ω = J/𝕀 is 1.6e16 rad/s at sin π: in that frame the pendulum stands still for ever."""
    step = framed_point()
    begin = gs.Start([np.sin(np.pi) + apart, 0.0, -np.sqrt(1 - apart**2)], [0.0, 1.5, 0.0],
                     PENDULUM)
    exact = step.integrate(begin, dt=0.02 / 16, steps=16 * 150, every=16).q
    tuned = gs.tune(step, begin, dt=0.02, steps=150, frame=frame)
    plain, moved = (error(step.integrate(begin, dt=0.02, steps=150, parameters=changes), exact)
                    for changes in ({}, tuned.parameters))
    assert moved <= 1.05 * plain + 1e-13
    assert frame == "auto" or "near its axis" in tuned.reason


@pytest.mark.parametrize("tilt", [1e-3, 1e-6])
def test_a_top_that_is_nearly_upright_keeps_one_of_two_rates(tilt):
    """Both axes are nearly one: the least squares of both rates are (−1/tilt, 1/tilt)."""
    step, q = systems.stepper("heavy_top_in_frame"), [np.cos(tilt / 2), np.sin(tilt / 2), 0, 0]
    begin = gs.Start.of_body(q, (0.3, 0.3, 8.0), (1.0, 1.0, 0.6), {
        "I1": 1.0, "I2": 1.0, "I3": 0.6, "gamma": 0.9, "mgl": 1.0})
    exact = step.integrate(begin, dt=0.01 / 16, steps=1600, every=16).q
    rates = gs.tune(step, begin, dt=0.01, frame="start").parameters
    plain, moved = (error(step.integrate(begin, dt=0.01, steps=100, parameters=changes), exact)
                    for changes in ({}, rates))
    assert moved < plain
    assert sorted(rate != 0 for rate in rates.values()) == [False, True]


@pytest.mark.parametrize("angle", [1e-6, 1e-3, 0.5])
def test_a_cone_of_any_angle_keeps_its_rate(angle):
    """A conical pendulum turns at ω = 1/√cos θ, however near its axis: a relative equilibrium."""
    rate = 1 / np.sqrt(np.cos(angle))
    begin = gs.Start([np.sin(angle), 0.0, -np.cos(angle)], [0.0, rate * np.sin(angle), 0.0],
                     PENDULUM)
    rates = gs.tune(framed_point(), begin, dt=0.1, frame="start").parameters
    run = framed_point().integrate(begin, dt=0.1, steps=50, parameters=rates)
    assert rates == {framed_point().symmetries[0].name: pytest.approx(rate, rel=1e-9)}
    assert abs(run.q[:, 2] + np.cos(angle)).max() < 1e-15


@pytest.mark.slow  # a certificate of a free body in a frame takes two seconds
def test_what_does_not_commute_is_not_promised():
    """A free body in a frame about e3 keeps l along e3, and not across it."""
    moments = {name: BODY.parameters[name] for name in ("I1", "I2", "I3")}
    free = gs.problems.Problem("free", moments, BODY.q0, BODY.p0, BODY.inertia, "free_body")
    certificate = gs.certify(free, "G-L", 2, frame="symmetries", dt=5e-3, steps=200,
                             parameters={"omega_space_3": 20.0})
    assert certificate.line("angular momentum about e3").holds is True
    assert certificate.line("angular momentum about e1").holds is None
    assert "turns" in certificate.line("angular momentum about e1").why


def test_run_takes_frames(gyrospark):
    choice = ["run", "fast-top", "--scheme", "G-L", "--stages", "2", "--dt", "1e-2", "--steps",
              "100", "--json"]
    still, moved, auto, start = (gyrospark(*choice, *options).document for options in (
        [], ["--frame", "omega_body=75.4,omega_space=1"], ["--frame", "auto"],
        ["--frame", "start"]))
    assert moved["parameters"]["omega_body"] == 75.4
    assert moved["parameters"]["omega_space"] == 1.0
    assert moved["energy_error_max"] < still["energy_error_max"] / 10
    assert auto["tuned"]["gain"] > 1000
    assert auto["tuned"]["parameters"].items() <= auto["parameters"].items()
    assert start["tuned"]["parameters"]["omega_body"] == pytest.approx(125.663706, rel=1e-7)
    wrong = gyrospark(*choice, "--frame", "omega_bdy=75.4")
    assert wrong.code == 2
    assert "omega_body" in wrong.stderr
