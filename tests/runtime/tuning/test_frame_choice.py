"""Rates of co-moving frames, chosen: least squares of a start, pilots, and the guard over them.

What a choice promises is measured here again: beside a run of a method of more stages, beyond the
pilots, and for motions where a frame does not help or harms.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import sympy as sp
from numpy.testing import assert_array_equal

import gyrospark as gs
import systems
from framed_point import FIELD, framed_point
from gyrospark.runtime.tuning.frame_search import SpectralLines

TOP = gs.problems.fast_top()
CONE = gs.problems.regular_precession()
BODY = gs.problems.free_body()
X, Y, Z, PX, PY, PZ = sp.symbols("x y z p_x p_y p_z", real=True)


def with_gamma(problem):
    return problem.parameters | {"gamma": gs.gamma(problem.inertia)}


@cache
def framed(scheme="G-L", stages=2, **more):
    if (scheme, stages, more) == ("G-L", 2, {}):
        return systems.stepper("heavy_top_in_frame")
    return gs.stepper(scheme, stages, frame="symmetries", **more)


# ---------------------------------------------------------------- least squares of a start


def test_the_start_of_a_relative_equilibrium_tells_its_rates():
    run = framed().integrate(CONE.q0, CONE.p0, dt=1e-2, steps=10,
                             parameters=with_gamma(CONE) | {"frame": "start"})
    Omega = CONE.exact.angular_velocity(0.0)
    nutation = 2 * np.arccos(np.hypot(CONE.q0[0], CONE.q0[3]))
    space = 30.0  # the problem's rate
    assert run.parameters["omega_space"] == pytest.approx(space, rel=1e-12)
    assert run.parameters["omega_body"] == pytest.approx(Omega[2] - space * np.cos(nutation),
                                                         rel=1e-12)


@pytest.mark.slow  # six stages for the exact motion
def test_a_free_body_turns_about_its_angular_momentum():
    """Three rotations of space do not commute: the frame's axis is that of l, else l is lost."""
    I1, _, I3 = BODY.inertia
    numbers = {"I1": I1, "I2": I1, "I3": I3, "gamma": I1}
    step = framed(system="free_body")
    run = step.integrate(BODY.q0, BODY.p0, dt=1e-2, steps=500,
                         parameters=numbers | {"frame": "start"})
    still = step.integrate(BODY.q0, BODY.p0, dt=1e-2, steps=500, parameters=numbers)
    axes = [s for s in step.symmetries if s.group == step.symmetries[-1].group]
    omega = np.array([run.parameters[s.name] for s in axes])
    l_of_t = np.array([s.momentum(run.q, run.p) for s in axes])
    assert abs(np.cross(omega, l_of_t[:, 0])).max() < 1e-12 * abs(omega).max() * abs(l_of_t).max()
    assert abs(l_of_t - l_of_t[:, :1]).max() < 1e-13 * abs(l_of_t).max()
    # It is a relative equilibrium, solved exactly: |l|/I1 about l, the rest about the body's axis.
    assert np.linalg.norm(omega) == pytest.approx(np.linalg.norm(l_of_t[:, 0]) / I1, rel=1e-12)
    fine = gs.stepper("G-L", 6, rep="gamma", system="free_body").integrate(
        BODY.q0, BODY.p0, dt=2e-3, steps=2500, every=5, parameters=numbers)
    assert abs(run.q - fine.q).max() < 1e-11
    assert abs(still.q - fine.q).max() > 1e-3


def test_asymmetric_bodies_keep_what_is_left():
    """Of a body with three moments only the rotations of space are symmetries."""
    run = framed().integrate(
        BODY.q0, BODY.p0, dt=1e-3, steps=20, parameters={
            "I1": 1.0, "I2": 2.0, "I3": 3.0, "mgl": 0.1, "gamma": 2.0, "frame": "start"})
    assert run.parameters["omega_body"] == 0
    assert run.parameters["omega_space"] != 0


def test_each_start_of_an_ensemble_has_its_own_least_squares():
    step, numbers = framed(), with_gamma(TOP)
    p = np.array([s * TOP.p0 for s in (0.5, 1.0, 1.5)])
    many = step.integrate_ensemble([TOP.q0] * 3, p, dt=2e-3, steps=20,
                                   parameters=numbers | {"frame": "start"})
    listed = step.integrate_ensemble([TOP.q0] * 3, p, dt=2e-3, steps=20,
                                     parameters=[numbers | {"frame": "start"}] * 3)
    assert_array_equal(many.q, listed.q)
    rates = [member.parameters["omega_body"] for member in many.members]
    assert rates == pytest.approx([62.831853, 125.663706, 188.495559], rel=1e-7)
    for i, member in enumerate(many.members):
        one = step.integrate(TOP.q0, p[i], dt=2e-3, steps=20,
                             parameters=numbers | {"frame": "start"})
        assert one.parameters == member.parameters
        assert abs(one.q - many.q[i]).max() < 1e-12


# ---------------------------------------------------------------- pilots


def test_a_choice_says_what_it_was_chosen_by():
    step, numbers = framed(), with_gamma(TOP)
    choice = gs.choose_frame(step, TOP.q0, TOP.p0, dt=1e-2, parameters=numbers, steps=200)
    assert choice.values == choice.frame
    assert choice.gamma is None
    assert choice.frame.keys() == {"omega_body", "omega_space"}
    plain, start = choice.pilots[:2]
    assert (plain.label, start.label) == ("no frame", "least squares of the start")
    chosen = next(pilot for pilot in choice.pilots if pilot.values == choice.frame)
    assert choice.measured_gain == pytest.approx(plain.whole / chosen.whole)
    assert choice.expected_gain == pytest.approx(plain.half / chosen.half)
    assert chosen.whole < start.whole / 10
    assert "searched for" in str(choice)
    assert f"{choice.measured_gain:.3g} times smaller" in repr(choice)
    run = step.integrate(TOP.q0, TOP.p0, dt=1e-2, steps=200,
                         parameters=numbers | {"frame": "auto"})
    assert {name: run.parameters[name] for name in choice.frame} == choice.frame


@pytest.mark.slow  # three seconds of pilots; test_gamma_choice.py has the search
def test_gamma_is_searched_for_with_the_rates():
    step, numbers = framed("G-L", 1), TOP.parameters | {"gamma": "auto"}
    both = gs.choose_frame(step, TOP.q0, TOP.p0, dt=1e-3, parameters=numbers, steps=300)
    alone = gs.choose_frame(step, TOP.q0, TOP.p0, dt=1e-3, parameters=with_gamma(TOP), steps=300)
    assert both.gamma == both.values["gamma"] != gs.gamma(TOP.inertia)
    assert both.measured_gain > 3 * alone.measured_gain
    run = step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=300,
                         parameters=numbers | {"frame": "auto"})
    assert run.parameters["gamma"] == both.gamma


# ---------------------------------------------------------------- the guard


def test_where_a_frame_harms_none_is_taken_or_a_better_one():
    """A point on a sphere in a field that two axes share: least squares alone harm it."""
    step = framed_point()
    q = np.array([0.6, 0.0, 0.8])
    p = np.array([0.4, 1.1, -0.3])
    runs = {mode: step.integrate(q, p, dt=0.1, steps=400, parameters=par) for mode, par in (
        ("none", FIELD), *((word, FIELD | {"frame": word}) for word in ("start", "auto")))}
    exact = step.integrate(q, p, dt=0.00625, steps=6400, every=16, parameters=FIELD)
    error = {mode: np.sqrt(((run.q - exact.q) ** 2).mean()) for mode, run in runs.items()}
    assert error["start"] > error["none"]
    assert error["auto"] <= 1.05 * error["none"]


def test_a_motion_without_error_needs_no_frame():
    """At a small step what is left is round-off, and no frame is searched for."""
    step = framed()
    choice = gs.choose_frame(step, TOP.q0, TOP.p0, dt=1e-6, parameters=with_gamma(TOP), steps=50)
    assert "round-off" in choice.reason
    assert set(choice.frame.values()) == {0.0}
    assert choice.measured_gain == choice.expected_gain == 1


def test_lines_are_centred():
    """Of two lines of power 9 and 1: M_1 is least at their mean, higher powers near the middle."""
    t = np.arange(4096) * 0.01
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    q = np.stack([3 * wave(20 * t) + wave(26 * t) for wave in (np.cos, np.sin)], axis=1)
    lines = SpectralLines(q, q, 0.01, [turn])
    assert lines.resolved
    assert lines.least(1, np.zeros(1)) == pytest.approx([(9 * 20 + 26) / 10], rel=1e-6)
    middle = 20 + 6 / (1 + 9 ** (1 / 11))  # 9 x^11 = (6 - x)^11
    assert lines.least(6, np.zeros(1)) == pytest.approx([middle], rel=2e-3)  # a window has a width
    coarse = SpectralLines(q[::32], q[::32], 0.32, [turn])  # folded: 26 rad/s > π/0.32
    assert not coarse.resolved or abs(coarse.least(1, np.zeros(1))[0]) < 10


# ---------------------------------------------------------------- wrong uses


def test_what_cannot_be_chosen_is_reported(tmp_path):
    step, numbers = framed(), with_gamma(TOP)
    run = {"dt": 1e-3, "steps": 2}
    plain = systems.stepper("heavy_top")
    for par, words in (
        ({"frame": "moving"}, "'moving'"),
        ({"frame": "auto", "omega_body": 1.0}, "omega_body.*'auto'"),
    ):
        with pytest.raises(gs.InputError, match=words):
            step.integrate(TOP.q0, TOP.p0, **run, parameters=numbers | par)
    with pytest.raises(gs.InputError, match="co-moving"):
        plain.integrate(TOP.q0, TOP.p0, **run, parameters=numbers | {"frame": "auto"})
    with pytest.raises(gs.InputError, match="frame = 'auto'"):
        step.integrate_ensemble([TOP.q0], [TOP.p0], **run, parameters=numbers | {"frame": "auto"})
    with pytest.raises(gs.InputError, match="frame = 'start'"):
        step.step(TOP.q0, TOP.p0, dt=1e-3, parameters=numbers | {"frame": "start"})
    with pytest.raises(gs.InputError, match="'alpha'"):
        gs.choose_frame(step, TOP.q0, TOP.p0, dt=1e-3, parameters=numbers,
                        bodies={"alpha": TOP.inertia})


# ---------------------------------------------------------------- certificates


def test_ems_keeps_the_energy_of_the_frame_and_says_so():
    moved = {"omega_body": 125.0, "omega_space": 1.0}
    found = gs.certify(TOP, "EMS", frame="symmetries", dt=2e-3, steps=200, parameters=moved)
    assert found.line("energy in the frame").holds is True
    assert found.line("energy H").holds is None
    assert "angular momentum about the body's axis 3" in found.line("energy H").why


@pytest.mark.slow  # a second certificate of a frame by EMS
def test_ems_keeps_h_in_a_frame_about_the_vertical():
    kept = gs.certify(TOP, "EMS", frame="symmetries", dt=2e-3, steps=200,
                      parameters={"omega_space": 5.0})
    assert kept.line("energy H").holds is True  # it keeps the J about the vertical


@pytest.mark.slow  # a certificate of a free body in a frame takes two seconds
def test_what_does_not_commute_is_not_promised():
    """A free body in a frame about e3: l along e3 is kept, and l across it is not."""
    moments = {name: BODY.parameters[name] for name in ("I1", "I2", "I3")}
    free = gs.problems.Problem("free", moments, BODY.q0, BODY.p0, BODY.inertia, "free_body")
    found = gs.certify(free, "G-L", 2, frame="symmetries", dt=5e-3, steps=200,
                       parameters={"omega_space_3": 20.0})
    assert found.line("angular momentum about e3").holds is True
    assert found.line("angular momentum about e1").holds is None
    assert "turns" in found.line("angular momentum about e1").why


# ---------------------------------------------------------------- the command


def test_run_takes_frames(gyrospark):
    choice = ["run", "fast-top", "--scheme", "G-L", "--stages", "2", "--dt", "1e-2", "--steps",
              "100", "--json"]
    still, moved, auto, start = (gyrospark(*choice, *more).document for more in (
        [], ["--frame", "omega_body=75.4,omega_space=1"], ["--frame", "auto"],
        ["--frame", "start"]))
    assert "frame" not in still
    assert moved["frame"] == {"omega_body": 75.4, "omega_space": 1.0}
    assert moved["energy_error_max"] < still["energy_error_max"] / 10
    assert auto["frame_measured_gain"] > 1000
    assert auto["parameters"]["omega_body"] == auto["frame"]["omega_body"]
    assert start["frame"]["omega_body"] == pytest.approx(125.663706, rel=1e-7)
    wrong = gyrospark(*choice, "--frame", "omega_bdy=75.4")
    assert wrong.code == 2
    assert "omega_body" in wrong.stderr
