"""Rates of co-moving frames, chosen: least squares of a start, pilot runs, and the guard over them.

What a choice promises is measured here again: beside a run of a method of more stages, beyond the
pilot runs, and for motions where a frame does not help or harms.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from calls import refused
from framed_point import FIELD, framed_point
from gyrospark.core.registry import SYSTEMS
from gyrospark.runtime.tuning.spectral_lines import SpectralLines

TOP = gs.problems.fast_top()
CONE = gs.problems.regular_precession()
BODY = gs.problems.free_body()
DRAG = sp.Symbol("c", real=True)


@cache
def framed(scheme="G-L", stages=2, **more):
    if (scheme, stages, more) == ("G-L", 2, {}):
        return systems.stepper("heavy_top_in_frame")
    return gs.stepper(scheme, stages, frame="symmetries", **more)


@cache
def dragged():
    """The heavy top with drag F = −cp."""
    top = SYSTEMS["heavy_top"].make("gamma")
    system = replace(top, forces=tuple(-DRAG * p for p in top.p), name="dragged_top",
                     parameters=(*top.parameters, DRAG))
    return gs.stepper("G-L", 2, system=system, frame="symmetries")


# ---------------------------------------------------------------- least squares of a start


def test_the_start_of_a_relative_equilibrium_tells_its_rates():
    rates = gs.tune(framed(), CONE, dt=1e-2, frame="start").parameters
    Omega = CONE.exact.angular_velocity(0.0)
    nutation = 2 * np.arccos(np.hypot(CONE.q0[0], CONE.q0[3]))
    space = 30.0  # the problem's rate
    assert rates["omega_space"] == pytest.approx(space, rel=1e-12)
    assert rates["omega_body"] == pytest.approx(Omega[2] - space * np.cos(nutation), rel=1e-12)


@pytest.mark.slow  # six stages for the exact motion
def test_a_free_body_turns_about_its_angular_momentum():
    """Three rotations of space do not commute: the frame's axis is that of l, else l is lost."""
    I1, _, I3 = BODY.inertia
    numbers = {"I1": I1, "I2": I1, "I3": I3, "gamma": I1}
    step, start = framed(system="free_body"), gs.Start(BODY.q0, BODY.p0, numbers)
    rates = gs.tune(step, start, dt=1e-2, frame="start").parameters
    run, still = (step.integrate(start, dt=1e-2, steps=500, parameters=more)
                  for more in (rates, {}))
    axes = [s for s in step.symmetries if s.group == step.symmetries[-1].group]
    omega = np.array([rates[s.name] for s in axes])
    l_of_t = np.array([s.momentum(run.q, run.p) for s in axes])
    assert abs(np.cross(omega, l_of_t[:, 0])).max() < 1e-12 * abs(omega).max() * abs(l_of_t).max()
    assert abs(l_of_t - l_of_t[:, :1]).max() < 1e-13 * abs(l_of_t).max()
    # It is a relative equilibrium, solved exactly: |l|/I1 about l, the rest about the body's axis.
    assert np.linalg.norm(omega) == pytest.approx(np.linalg.norm(l_of_t[:, 0]) / I1, rel=1e-12)
    fine = gs.stepper("G-L", 6, rep="gamma", system="free_body").integrate(
        start, dt=2e-3, steps=2500, every=5)
    assert abs(run.q - fine.q).max() < 1e-11
    assert abs(still.q - fine.q).max() > 1e-3


def test_asymmetric_bodies_keep_what_is_left():
    """Of a body with three moments only the rotations of space are symmetries."""
    rates = gs.tune(framed(), BODY.q0, BODY.p0, dt=1e-3, frame="start", parameters={
        "I1": 1.0, "I2": 2.0, "I3": 3.0, "mgl": 0.1}).parameters
    assert rates["omega_body"] == 0
    assert rates["omega_space"] != 0


def test_a_model_with_a_frame_starts_in_it():
    """A run takes the least squares where it is given no rates, in whatever way it is begun."""
    step = framed()
    model = gs.Model(SYSTEMS["heavy_top"].make("gamma"), TOP.parameters, TOP.q0, TOP.p0,
                     bodies={"gamma": TOP.inertia}, frame="symmetries")
    rates = gs.tune(step, TOP, dt=2e-3, frame="start").parameters
    run = step.integrate(model, dt=2e-3, steps=20)
    simulation = step.start(model, dt=2e-3)
    simulation.advance(20)
    assert {name: run.parameters[name] for name in rates} == rates
    assert np.array_equal(simulation.q, run.q[-1])
    given = step.integrate(model, dt=2e-3, steps=20, parameters={"omega_body": 100.0})
    assert (given.parameters["omega_body"], given.parameters["omega_space"]) == (100.0, 0.0)


# ---------------------------------------------------------------- pilot runs


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


# ---------------------------------------------------------------- the guard


def test_where_a_frame_harms_none_is_taken_or_a_better_one():
    """A point on a sphere in a field that two axes share: least squares alone harm it."""
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
    """At a small step what is left is round-off, and no frame is searched for."""
    tuned = gs.tune(framed(), TOP, dt=1e-6, frame="auto", pilot_steps=50)
    assert "round-off" in tuned.reason
    assert set(tuned.parameters.values()) == {0.0}
    assert tuned.gain == 1


@pytest.mark.slow  # a stepper and 16,000 steps
def test_drag_takes_a_motion_out_of_its_frame_and_new_blocks_into_one():
    """The spin falls to a fiftieth in 8 s: each block of 100 steps has its own least squares."""
    step, dt = dragged(), 5e-3
    start = gs.Start(TOP.q0, TOP.p0, TOP.parameters | {"c": 0.5})
    exact = step.integrate(start, dt=dt / 10, steps=16_000, every=100).q

    def error(q):
        return float(np.sqrt(((q - exact) ** 2).sum(axis=1).mean()))

    plain = error(step.integrate(start, dt=dt, steps=1600, every=10).q)
    once = gs.tune(step, start, dt=dt, frame="start").parameters
    stays = error(step.integrate(start, dt=dt, steps=1600, every=10, parameters=once).q)
    rows, row = [np.array(TOP.q0)[None]], start
    for _ in range(16):
        rates = gs.tune(step, row, dt=dt, frame="start").parameters
        block = step.integrate(row, dt=dt, steps=100, every=10, parameters=rates)
        rows.append(block.q[1:])
        row = block[-1]
    assert stays > 2 * plain > 200 * error(np.concatenate(rows))
    longer = gs.tune(step, start, dt=dt, frame="auto")
    assert set(longer.parameters.values()) == {0.0}
    assert "forces" in longer.reason


@pytest.mark.parametrize(("scheme", "solver"), [
    (("G-L", 2), "auto"), (("G-L", 2), "newton"),
    pytest.param(("IMS", None), "newton", marks=pytest.mark.slow)])  # a stepper for this
def test_energy_is_the_work_of_drag_to_the_order_of_the_method(scheme, solver):
    """F·q̇ has the part of q̇ that the frame moves by itself, Σ ω_i A_i q.

    H and g are quadratic: with IMS nothing but rounding is left.
    """
    step = framed_point(*scheme)
    start = gs.Start([0.6, 0.0, 0.8], [0.4, 1.1, -0.3], FIELD | {"c": 0.5})
    rates = gs.tune(step, start, dt=0.05, frame="start").parameters
    assert any(rates.values())
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
    """Of two lines of power 9 and 1: M_1 is least at their mean, higher powers near the middle."""
    t = np.arange(4096) * 0.01
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    q = np.stack([3 * wave(20 * t) + wave(26 * t) for wave in (np.cos, np.sin)], axis=1)
    lines = SpectralLines(q, q, 0.01, [turn])
    assert lines.is_resolved
    assert lines.minimise(1, np.zeros(1)) == pytest.approx([(9 * 20 + 26) / 10], rel=1e-6)
    middle = 20 + 6 / (1 + 9 ** (1 / 11))  # 9 x^11 = (6 - x)^11
    # A window has a width.
    assert lines.minimise(6, np.zeros(1)) == pytest.approx([middle], rel=2e-3)
    coarse = SpectralLines(q[::32], q[::32], 0.32, [turn])  # folded: 26 rad/s > π/0.32
    assert not coarse.is_resolved or abs(coarse.minimise(1, np.zeros(1))[0]) < 10


# ---------------------------------------------------------------- certificates


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
    assert moved["parameters"]["omega_body"] == 75.4
    assert moved["parameters"]["omega_space"] == 1.0
    assert moved["energy_error_max"] < still["energy_error_max"] / 10
    assert auto["tuned"]["gain"] > 1000
    assert auto["tuned"]["parameters"].items() <= auto["parameters"].items()
    assert start["tuned"]["parameters"]["omega_body"] == pytest.approx(125.663706, rel=1e-7)
    wrong = gyrospark(*choice, "--frame", "omega_bdy=75.4")
    assert wrong.code == 2
    assert "omega_body" in wrong.stderr
