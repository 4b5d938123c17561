"""A frame that follows a motion which changes for good: a top with drag F = −cp.

The second ways: another method without a frame, energy against work, a run in one piece.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sympy as sp
from numpy.testing import assert_array_equal

import gyrospark as gs
import systems
from calls import integrate
from gyrospark.core.registry import SYSTEMS
from stores import record

TOP = gs.problems.fast_top()
C = sp.Symbol("c", real=True)
#: The spin falls to a fiftieth in 8 s.
START = {"q": TOP.q0, "p": TOP.p0, "dt": 5e-3, "steps": 1600, "every": 10}
NUMBERS = TOP.parameters | {"gamma": gs.gamma(TOP.inertia), "c": 0.5}


@cache
def dragged():
    """The heavy top with drag."""
    top = SYSTEMS["heavy_top"].make("gamma")
    return replace(top, forces=tuple(-C * p for p in top.p), parameters=(*top.parameters, C),
                   name="dragged_top")


@cache
def stepper():
    return gs.stepper("G-L", 2, system=dragged(), frame="symmetries")


@cache
def exact():
    """By 2-G-L without moving the frame, at a tenth of the step: the error is a 10,000th."""
    return integrate(
        stepper(), **START | {"dt": 5e-4, "steps": 16_000, "every": 100}, parameters=NUMBERS).q


def run(frame=None, **more):
    asked = {} if frame is None else {"frame": frame}
    return integrate(stepper(), **START | more, parameters=NUMBERS | asked)


def error(found):
    """Of the attitude, root mean square over the run."""
    return float(np.sqrt(((found.q - exact()) ** 2).sum(axis=1).mean()))


def test_following_gains_a_hundred_where_a_frame_that_stays_harms():
    plain, stays, follows = (error(run(frame)) for frame in (None, "start", "follow"))
    assert stays > 2 * plain
    assert plain > 100 * follows
    assert error(run("follow 30")) < follows


@pytest.mark.parametrize("solver", ["auto", "newton"])
def test_energy_is_the_work_of_drag_to_the_order_of_the_method(solver):
    """F·q̇ has the part of q̇ that the frame moves by itself, Σ ω_i A_i q."""
    largest = [abs(run("start", steps=200 * k, dt=5e-3 / k, every=1, solver=solver).energy_error(
        )).max() for k in (1, 2, 4)]
    assert largest[0] / largest[1] == pytest.approx(16, rel=0.2)
    assert largest[1] / largest[2] == pytest.approx(16, rel=0.2)


def test_forces_that_do_not_turn_with_a_frame_have_none():
    top = dragged()
    one = replace(top, forces=(-C * top.p[0], *top.forces[1:3], -2 * C * top.p[3]))
    with pytest.raises(gs.InputError, match="co-moving"):
        gs.stepper("G-L", 2, system=one, frame="symmetries")


def test_auto_follows_where_forces_take_the_motion_elsewhere():
    auto, follows = run("auto"), run("follow")
    assert_array_equal(auto.q, follows.q)
    assert auto.parameters == follows.parameters


def test_the_bits_do_not_depend_on_how_steps_are_stored():
    whole = run("follow 30", every=1)
    for every in (7, 100):
        found = run("follow 30", every=every)
        assert_array_equal(found.q[:-1], whole.q[:-1:every])
        assert_array_equal(found.p[-1], whole.p[-1])
        assert found.report.newton_steps == whole.report.newton_steps


def test_a_stored_run_goes_on_within_a_block_with_the_same_bits(tmp_path):
    whole, path = run("follow 70"), tmp_path / "run.zarr"
    given = START | {"parameters": NUMBERS | {"frame": "follow 70"}, "out": path}
    for steps in (100, 350, 1600):
        found = record(stepper(), **given | {"steps": steps}, resume=True)
    assert_array_equal(found[:].q, whole.q)
    assert_array_equal(found[:].p, whole.p)
    with pytest.raises(gs.InputError, match="frame"):
        record(stepper(), **given | {"steps": 1700, "parameters": NUMBERS | {
            "frame": "follow 71"}}, resume=True)


def test_in_a_conservative_system_a_block_as_long_as_the_run_is_the_start():
    top = systems.stepper("heavy_top_in_frame")
    numbers = {name: x for name, x in NUMBERS.items() if name != "c"}
    found = [integrate(top, **START, parameters=numbers | {"frame": frame}) for frame in (
        "start", "follow 1600")]
    assert_array_equal(found[0].q, found[1].q)
    assert found[0].parameters == found[1].parameters


def test_the_certificate_says_what_of_its_promises_holds():
    found = gs.certify(TOP, "G-L", 2, frame="symmetries", dt=2e-3, steps=200,
                       parameters={"frame": "follow 50"})
    assert "block" in found.line("co-moving frame").why
    assert found.line("angular momentum about e3").holds is True
    assert found.holds
    assert not any(line.quantity.startswith("energy in the frame") for line in found.lines)


def test_what_cannot_follow_is_reported():
    with pytest.raises(gs.InputError, match="'follow 50'"):
        run("follow 0")
    with pytest.raises(gs.InputError, match=r"omega_body.*'follow'"):
        integrate(stepper(), **START, parameters=NUMBERS | {"frame": "follow", "omega_body": 3.0})
    with pytest.raises(gs.InputError, match="start"):
        stepper().integrate_ensemble(
            np.stack([TOP.q0] * 2), np.stack([TOP.p0] * 2), dt=1e-3, steps=3,
            parameters=NUMBERS | {"frame": "follow"})


def test_run_takes_frames_that_follow(gyrospark, tmp_path):
    """On the command line, with a store that goes on."""
    out = tmp_path / "run.zarr"
    arguments = ["run", "fast-top", "--scheme", "G-L", "--stages", "2", "--dt", "5e-3", "--frame",
                 "follow 20", "--out", str(out)]
    assert "follow 20" in gyrospark(*arguments, "--steps", "50").stdout
    gyrospark(*arguments, "--steps", "90", "--resume")
    top = systems.stepper("heavy_top_in_frame")
    whole = top.integrate(TOP.q0, TOP.p0, dt=5e-3, steps=90, parameters=TOP.parameters | {
        "gamma": "m", "frame": "follow 20"})
    assert_array_equal(gs.load(out)[:].q, whole.q)
