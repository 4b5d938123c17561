"""dt = "auto": the error that was wanted, against motions that are known otherwise."""

from __future__ import annotations

import re

import numpy as np
import pytest

import gyrospark as gs
from calls import PARAMETERS, TOP, refused
from command_line import refused as refused_by_command
from gyrospark.runtime.tuning.motion_distance import MotionError
from gyrospark.runtime.tuning.step_choice import choose_dt

WANTED = {"error": 1e-6, "t_end": 0.4}
COMMAND = ("run", "fast-top", "--json", "--t-end", "0.4")


def largest(run, true):
    error = MotionError(true.q, np.asarray(true.q, float))
    off = error(run.q)
    return max(np.sqrt((off[:, path] ** 2).sum(axis=1)).max() for path in error.paths)


@pytest.mark.parametrize(("scheme", "stages", "error"), [
    ("EMS", None, 1e-3), ("G-L", 2, 1e-6), ("G-L", 3, 0.1),
    *(pytest.param(*row, marks=pytest.mark.slow) for row in (
        ("G-L", 3, 1e-9), ("G-L", 4, 1e-2), ("LIIIA-B", 3, 1e-6)))])
def test_the_error_is_as_wanted_and_not_much_smaller(scheme, stages, error):
    """Against 6 stages; steps twice as long err more than was wanted, if there are such pilots."""
    step, true = gs.stepper(scheme, stages), gs.stepper("G-L", 6)
    run = step.integrate(TOP.q0, TOP.p0, dt="auto", error=error, t_end=0.4, parameters=PARAMETERS)
    n = run.report.steps
    assert run.t[-1] == pytest.approx(0.4, rel=1e-14)
    fine = -(-1000 // n)
    there = true.integrate(TOP.q0, TOP.p0, dt=0.4 / n / fine, steps=n * fine, every=fine,
                           parameters=PARAMETERS)
    assert largest(run, there) <= 1.1 * error  # the largest between the rows that are compared
    found = choose_dt(step, TOP.q0, TOP.p0, error=error, t_end=0.4, parameters=PARAMETERS)
    assert found.steps == n
    rows = n // 16
    assert largest(step.at(run, there.t[::rows]), true.at(there, there.t[::rows])) \
        == pytest.approx(found.error, rel=0.1)
    if n > 16:
        coarse = step.integrate(TOP.q0, TOP.p0, dt=0.8 / n, steps=n // 2, parameters=PARAMETERS)
        assert largest(coarse, true.at(there, coarse.t)) > error


def test_the_command_reports_what_was_measured(gyrospark):
    said = gyrospark(*COMMAND, "--dt", "auto", "--error", "1e-8").document
    assert said["dt_error"] <= 1e-8
    assert said["steps"] * said["dt"] == pytest.approx(0.4)
    halved = [pilot["steps"] for pilot in said["dt_pilots"]]
    assert halved[:3] == [16, 32, 64]
    assert said["steps"] in halved
    text = gyrospark("run", "fast-top", "--dt", "auto", "--error", "1e-8", "--t-end", "0.4").stdout
    assert re.search(rf"{said['dt_error']:.2e},.*\b{len(halved)} pilots", text)


def test_backwards_and_from_another_time(gl3):
    run = gl3.integrate(gs.Start(TOP.q0, TOP.p0, t=1), dt="auto", error=1e-6, t_end=0.6,
                        parameters=PARAMETERS)
    assert run.dt < 0
    assert run.t[-1] == pytest.approx(0.6)
    back = gl3.integrate(run.q[-1], run.p[-1], dt=-run.dt, steps=run.report.steps,
                         parameters=PARAMETERS)
    assert abs(back.q[-1] - TOP.q0).max() < 1e-12


def test_round_off_is_reported(gl3):
    with refused(r"error = 1e-19.*\d\.\de-1\d"):
        gl3.integrate(TOP.q0, TOP.p0, dt="auto", error=1e-19, t_end=0.01, parameters=PARAMETERS)


def test_what_fails_with_every_step_says_so(gl3, monkeypatch):
    """As does what needs more steps than a pilot may have."""
    from gyrospark.runtime.tuning import step_choice

    monkeypatch.setattr(step_choice, "_MOST", 64)
    with pytest.raises(gs.StepFailed):
        gl3.integrate(TOP.q0, TOP.p0, dt="auto", **WANTED, parameters=PARAMETERS,
                      solver=gs.Solver("auto", max_iterations=1))
    with refused(r"64 steps.* 32 .*dt = 0\.0125"):
        gl3.integrate(TOP.q0, TOP.p0, dt="auto", error=1e-12, t_end=0.4, parameters=PARAMETERS)


@pytest.mark.parametrize(("more", "said"), [
    ({"dt": "auto"}, "needs.*error"),
    ({"dt": "auto", "error": 1e-6}, "needs.*error"),
    ({"dt": "auto", "steps": 3, **WANTED}, "steps"),
    ({"dt": "auto", **WANTED, "error": -1}, "error = -1"),
    ({"dt": "auto", **WANTED, "error": "small"}, "error = 'small'"),
    ({"dt": "auto", **WANTED, "t_end": 0}, "t_end = 0 is t0"),
    ({"dt": 1e-3, "steps": 3, "error": 1e-6}, r"dt = 'auto'.*dt = 0\.001"),
    ({"dt": "fine", **WANTED}, "dt = 'auto'.*dt = 'fine'"),
])
def test_wrong_use_is_refused(more, said, gl3):
    with refused(said):
        gl3.integrate(TOP.q0, TOP.p0, parameters=PARAMETERS, **more)


def test_gamma_that_waits_for_dt_is_refused(gl3):
    with refused("gamma = 'auto'.*dt"):
        gl3.integrate(TOP.q0, TOP.p0, dt="auto", **WANTED,
                      parameters=TOP.parameters | {"gamma": "auto"})


@pytest.mark.parametrize(("more", "said"), [
    (("--dt", "auto"), "give --error and --t-end"),
    (("--dt", "auto", "--error", "1e-6", "--steps", "3"), "no --steps"),
    (("--dt", "1e-3", "--error", "1e-6"), "--error 1e-6"),
    (("--dt", "auto", "--error", "1e-6", "--frame", "start"), "--dt with --frame"),
    (("--dt", "auto", "--error", "tiny"), "--error 'tiny'"),
])
def test_wrong_options_are_refused(more, said, gyrospark):
    refused_by_command(gyrospark(*COMMAND, *more), said)
