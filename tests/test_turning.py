"""Radians a step: what is said of the fastest rotation, and when a run warns."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.runtime.output.turning import fastest_turning

RUN = ("run", "fast-top", "--json", "--steps", "20")
SCHEMES = [("IMS",), ("EMS",), ("G-L", "--stages", "3")]


@pytest.mark.parametrize("scheme", SCHEMES, ids=" ".join)
@pytest.mark.parametrize("dt", ["1e-3", "1e-2"])
def test_the_papers_runs_do_not_warn(scheme, dt, gyrospark):
    answer = gyrospark(*RUN, "--scheme", *scheme, "--dt", dt)
    assert answer.stderr == ""
    assert answer.document["radians_per_step"] == pytest.approx(40 * pi * float(dt), rel=0.01)
    assert answer.document["fastest_body"] == "body"


def test_the_papers_precession_does_not_warn(gyrospark):
    answer = gyrospark("run", "regular-precession", "--scheme", "IMS", "--dt", "0.007", "--steps",
                       "20", "--set", "radius_ratio=0.5")
    assert answer.stderr == ""
    assert "rad a step, of body" in answer.stdout


@pytest.mark.parametrize(("scheme", "borne"), [(("EMS",), 1.5), (("G-L", "--stages", "2"), 2.5),
                                               (("G-L", "--stages", "3"), 3.0)], ids=str)
def test_more_than_is_borne_is_told(scheme, borne, gyrospark):
    """Beside the bound: nothing below it, a line above it, with a dt that is below it again."""
    rate = 40 * pi
    below, above = (str(factor * borne / rate) for factor in (0.98, 1.02))
    assert gyrospark(*RUN, "--scheme", *scheme, "--dt", below).stderr == ""
    answer = gyrospark(*RUN, "--scheme", *scheme, "--dt", above)
    assert answer.code == 0
    assert answer.stderr.count("\n") == 1
    for part in (f"is {1.02 * borne:.2f} rad a step", f"bears {borne:g} at the most",
                 f"well below {borne / rate:.2g}."):
        assert part in answer.stderr
    assert answer.document["radians_per_step"] > borne


def test_the_error_beside_the_bound_of_order_two(gl3):
    """A midpoint turns by 4 arctan(θ/4) in place of θ: two radians are lost in some turns."""
    top = gs.problems.fast_top()
    parameters = top.parameters | {"gamma": "m"}
    dt = 1.5 / (40 * pi)
    made = gs.stepper("EMS").integrate(top.q0, top.p0, dt=dt, steps=28, parameters=parameters)
    true = gl3.integrate(top.q0, top.p0, dt=dt / 8, steps=8 * 28, every=8, parameters=parameters)
    off = 2 * np.arccos(np.clip(np.abs((made.q * true.q).sum(axis=1)), 0, 1))
    assert off[14] == pytest.approx(14 * (1.5 - 4 * np.arctan(1.5 / 4)), rel=0.1)


def test_of_several_bodies_the_fastest(gyrospark):
    answer = gyrospark("run", "double_top", "--dt", "1e-3", "--steps", "5", "--json", "--out",
                       "run.npz")
    run = gs.Trajectory.load("run.npz")
    rates = {name: np.linalg.norm(run.angular_velocity(name), axis=1).max() for name in "ab"}
    fastest = max("ab", key=rates.__getitem__)
    assert rates["a"] != rates["b"]
    assert answer.document["fastest_body"] == fastest
    assert answer.document["radians_per_step"] == pytest.approx(rates[fastest] * 1e-3, rel=1e-9)


def test_what_does_not_turn_has_none(gyrospark):
    """Points, and what a frame carries."""
    points = gyrospark("run", "examples/pendulum.toml", "--steps", "5", "--dt", "1", "--json")
    framed = gyrospark(*RUN, "--scheme", "IMS", "--frame", "start", "--dt", "2e-2")
    for answer in (points, framed):
        assert "radians_per_step" not in answer.document
    assert framed.stderr == ""


def test_every_type_has_radians():
    top = gs.problems.fast_top()
    for real in ("float", "float128"):
        step = gs.stepper("G-L", 2, real=real)
        parameters = top.parameters | {"gamma": 0.0016}
        run = step.integrate(*step.project(top.q0, top.p0, parameters=parameters), dt=0.01,
                             steps=2, parameters=parameters)
        assert fastest_turning(run).radians == pytest.approx(0.4 * pi, rel=1e-3)
