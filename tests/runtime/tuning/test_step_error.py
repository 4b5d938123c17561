"""The time step for an error that is asked for, against exact or more accurate motions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import TOP, refused
from command_line import refused as refused_by_command
from gyrospark.runtime.tuning import step_search
from gyrospark.runtime.tuning.motion_distance import MotionError, distances

COMMAND = ("run", "fast-top", "--json", "--t-end", "0.4")


def largest(run, true):
    error = MotionError(true.q, true.q)
    return distances(error(run.q), error.paths).max()


@pytest.mark.parametrize(("scheme", "stages", "error"), [
    ("EMS", None, 1e-3), ("G-L", 2, 1e-6), ("G-L", 3, 0.1),
    *(pytest.param(*row, marks=pytest.mark.slow) for row in (
        ("G-L", 3, 1e-9), ("G-L", 4, 1e-2), ("LIIIA-B", 3, 1e-6)))])
def test_the_error_is_as_asked_for_and_not_much_smaller(scheme, stages, error):
    """The reference has 8 stages; twice the step errs more, if it has more than 8 steps."""
    step, fine_stepper = gs.stepper(scheme, stages), gs.stepper("G-L", 8)
    tuned = gs.tune(step, TOP, step_error=error, t_end=0.4)
    run = step.integrate(TOP, dt=tuned.dt, t_end=0.4)
    n = run.report.steps
    assert n * tuned.dt == Fraction(0.4)
    fine = -(-1000 // n)
    reference = fine_stepper.integrate(TOP, dt=0.4 / n / fine, steps=n * fine, every=fine)
    assert largest(run, reference) <= 1.1 * error  # the largest between the rows that are compared
    rows = n // 16
    assert largest(run.at(reference.t[::rows]), reference.at(reference.t[::rows])) \
        == pytest.approx(tuned.error, rel=0.1)
    if n > 16:
        coarse = step.integrate(TOP, dt=0.8 / n, steps=n // 2)
        assert largest(coarse, reference.at(coarse.t)) > error


@pytest.mark.parametrize(("error", "t_end", "factor"), [
    (1e-5, 0.1, 3), pytest.param(1e-9, 0.4, 5, marks=pytest.mark.slow)])
def test_gamma_and_a_frame_allow_larger_steps(error, t_end, factor):
    """For the fast top in a frame the step is searched again, with the error as asked for."""
    step, options = systems.stepper("heavy_top_in_frame"), {"step_error": error, "t_end": t_end}
    plain, moved = (gs.tune(step, TOP, **options, **rules) for rules in (
        {}, {"frame": "auto", "gamma": "auto"}))
    assert moved.dt > factor * plain.dt
    assert moved.parameters.keys() == {"gamma", "omega_body", "omega_space"}
    run = step.integrate(TOP, dt=moved.dt, t_end=t_end, parameters=moved.parameters)
    reference = gs.stepper("G-L", 8).integrate(TOP, dt=float(moved.dt) / 16, t_end=t_end, every=16)
    assert largest(run, reference) <= 1.1 * error
    assert largest(run, reference) == pytest.approx(moved.error, rel=0.1)


def test_in_scaled_time_errors_are_at_equal_times():
    """Errors are against the closed form of an orbit; with twice the step they are too large."""
    step, entry = systems.stepper("eccentric"), systems.case("eccentric")
    start = gs.Start(entry.q, entry.p, entry.parameters)
    tuned = gs.tune(step, start, dtau=0.4, step_error=1e-5, t_end=7)
    for text in (str(tuned), repr(tuned), tuned._repr_html_()):
        assert "dtau" in text
        assert all(seconds not in text for seconds in ("dt = ", "dt / s"))
    assert tuned.dt < 0.2
    times = np.linspace(0, 7, 17)
    exact = np.array([entry.exact(time) for time in times])

    def error(dtau):
        run = step.integrate(start, dtau=dtau, t_end=7, t_eval=times)
        return np.linalg.norm(run.q - exact, axis=1).max() / np.abs(exact).max()

    assert error(tuned.dt) == pytest.approx(tuned.error, rel=0.2)
    assert tuned.error <= 1e-5 < error(2 * tuned.dt)
    with pytest.raises(gs.InputError, match=r"dtau.*0\.4"):
        gs.tune(systems.stepper("kepler"), start, dtau=0.4, step_error=1e-5, t_end=7)
    for options in ({}, {"dt": 0.1}, {"dtau": -0.4}):
        with pytest.raises(gs.InputError, match="dt"):
            gs.tune(step, start, step_error=1e-5, t_end=7, **options)


def test_backwards_and_from_another_time(gl3):
    tuned = gs.tune(gl3, gs.Start(TOP.q0, TOP.p0, TOP.parameters, t=1), step_error=1e-6, t_end=0.6)
    ahead = gs.tune(gl3, TOP, step_error=1e-6, t_end=0.4)
    assert float(tuned.dt) == pytest.approx(-float(ahead.dt))
    assert 64 < 0.4 / float(ahead.dt) < 128  # between the steps of two pilots


def test_round_off_is_reported(gl3):
    with refused(r"step_error = 1e-19.*\d\.\de-1\d"):
        gs.tune(gl3, TOP, step_error=1e-19, t_end=0.01)
    pendulum = systems.stepper("pendulum")
    start = systems.timed_start("pendulum", pendulum)
    with refused(r"step_error = 1e-30"):  # in a span so short that errors are 0
        gs.tune(pendulum, start, step_error=1e-30, t_end=1e-9,
                parameters=systems.case("pendulum").parameters)


def test_what_needs_more_steps_than_a_pilot_may_have_says_so(gl3, monkeypatch):
    monkeypatch.setattr(step_search, "_MOST", 64)
    with refused(r"64 steps.* 32 .*dt = 0\.0125"):
        gs.tune(gl3, TOP, step_error=1e-12, t_end=0.4)
    with pytest.raises(gs.StepFailed):
        gs.tune(gl3, TOP, step_error=1e-12, t_end=400)


@pytest.mark.parametrize(("changes", "message"), [
    ({}, "step_error.*t_end"), ({"t_end": 0.4, "dt": 1e-3}, "dt"),
    ({"t_end": 0.4, "steps": 3}, "steps"),
    ({"t_end": 0.4, "inputs": [1.0]}, "inputs"), ({"t_end": 0}, "t_end = 0"),
    ({"t_end": 0.4, "step_error": -1}, "step_error = -1"),
    ({"t_end": 0.4, "step_error": "small"}, "step_error = 'small'"),
])
def test_wrong_use_is_refused(changes, message, gl3):
    with refused(message):
        gs.tune(gl3, TOP, **{"step_error": 1e-6} | changes)


def test_the_command_reports_what_was_measured(gyrospark):
    document = gyrospark(*COMMAND, "--step-error", "1e-8").document
    assert document["tuned"]["error"] <= 1e-8
    assert document["steps"] * document["dt"] == pytest.approx(0.4)
    assert document["tuned"]["dt"] == document["dt"]


@pytest.mark.parametrize(("options", "message"), [
    (("--dt", "auto"), "--step-error"),
    (("--step-error", "1e-6", "--steps", "3"), "steps"),
    (("--dt", "1e-3", "--step-error", "1e-6"), "dt"),
    (("--step-error", "tiny"), "--step-error 'tiny'"),
])
def test_wrong_options_are_refused(options, message, gyrospark):
    refused_by_command(gyrospark(*COMMAND, *options), message)
