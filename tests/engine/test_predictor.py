"""The predictor: starting values of the fixed-point iteration, fitted for each trajectory."""

from __future__ import annotations

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import integrate
from resumed_stores import check

TOP = gs.problems.fast_top()
PARAMETERS = TOP.parameters | {"gamma": 1.6e-3}


def members(count):
    return [PARAMETERS | {"mgl": TOP.parameters["mgl"] * (1 + 0.02 * i)} for i in range(count)]


def ends(step, dt, parameters, spin=1.0):
    count = len(parameters)
    ensemble = step.integrate_ensemble(
        np.tile(TOP.q0, (count, 1)), np.tile(TOP.p0 * spin, (count, 1)), dt=dt, steps=900, every=30,
        parameters=parameters, workers=1)
    return [(m.q.tobytes(), m.p.tobytes()) for m in ensemble.members]


@pytest.mark.filterwarnings("ignore:The fastest rotation")
@pytest.mark.parametrize(("stages", "dt", "spin"), [
    (2, 0.003, 1.0), (8, 0.01, 1.0), (8, 0.04, 0.05),
    *(pytest.param(*given, marks=pytest.mark.slow) for given in ((2, 0.015, 1.0), (8, 0.05, 0.2)))])
def test_lanes_are_independent_with_prediction(stages, dt, spin):
    """Between these steps some tops use a fitted recurrence and their neighbours do not.

    With many stages, sweeps far from rounding are tested at once where no neighbour is near it.
    Slow tops at long steps are extrapolated by polynomials in place of a recurrence.
    """
    step, tops = gs.stepper("G-L", stages, "gamma"), members(8)
    eight = ends(step, dt, tops, spin)
    assert ends(step, dt, tops[:3], spin) == eight[:3]
    for i in (0, 7):
        assert ends(step, dt, tops[i:i + 1], spin) == eight[i:i + 1]


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_first_steps_too_long_for_an_euler_start_need_no_newton():
    """Continuation in the step size converges to Newton's solution; other lanes keep their bits."""
    step, count = gs.stepper("G-L", 8, "gamma"), 5
    start = np.tile(TOP.q0, (count, 1)), np.tile(TOP.p0, (count, 1))
    dt = np.array([0.01, 0.025, 0.02, 0.03, 0.04])
    ensemble = step.integrate_ensemble(*start, dt=dt, steps=1, parameters=PARAMETERS, workers=1)
    for i, member in enumerate(ensemble.members):
        run = {"dt": dt[i], "steps": 1, "parameters": PARAMETERS}
        newton = step.integrate(TOP.q0, TOP.p0, solver="newton", **run)
        single = step.integrate(TOP.q0, TOP.p0, **run)
        lane = step.integrate_ensemble(TOP.q0[None], TOP.p0[None], workers=1, **run).members[0]
        assert member.report == lane.report
        assert member.q.tobytes() == lane.q.tobytes()
        for trajectory in (member, single):
            assert trajectory.report.newton_steps == 0
            assert trajectory.report.iterations_max < 50
            assert np.abs(trajectory.q - newton.q).max() < 4e-15
            assert np.abs(trajectory.p - newton.p).max() < 4e-15 * np.abs(newton.p).max()


def test_history_of_the_predictor_outlives_a_call(tmp_path, monkeypatch):
    """Lessons come after 8, 24 and 768 steps; a trial may begin in one call and end in the next."""
    step = gs.stepper("G-L", 2, "gamma")
    run = {"q": TOP.q0, "p": TOP.p0, "dt": 0.01, "steps": 900, "every": 30,
           "parameters": PARAMETERS}
    full_run = integrate(step, **run)
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 8)
    in_chunks = integrate(step, **run)
    assert in_chunks.q.tobytes() == full_run.q.tobytes()
    assert in_chunks.report == full_run.report
    assert in_chunks.iterations.tobytes() == full_run.iterations.tobytes()  # the most of all pieces
    monkeypatch.setattr("os.fsync", lambda handle: None)
    assert check(step, tmp_path, [1, 2, 20, 40], **run) == 4


def test_prediction_saves_iterations():
    """A recurrence alone took 14 iterations a step."""
    run = gs.stepper("G-L", 2, "gamma").integrate(
        TOP.q0, TOP.p0, dt=0.01, steps=1500, parameters=PARAMETERS)
    assert run.report.newton_steps == 0
    assert run.report.constraint_max <= 4 * np.finfo(float).eps
    assert run.iterations[:8].mean() > run.iterations[30:60].mean() + 4
    assert run.iterations[100:].mean() < 0.8 * 14.0
    short = systems.run("heavy_top", systems.stepper("heavy_top"), 1000, dt=1e-3)
    assert short.report.iterations_mean < 4  # 3.3; 10.8 without its long recurrence


def test_polynomials_serve_on_where_no_recurrence_does():
    """The harmonics of a slow top at long steps are too many for a recurrence, with 13.9 sweeps."""
    run = gs.stepper("G-L", 8, "gamma").integrate(
        TOP.q0, TOP.p0 / 20, dt=0.04, steps=500, parameters=PARAMETERS)
    assert run.iterations[150:].mean() < 13.2  # 12.7


@pytest.mark.slow  # a hundred thousand steps of eight tops
def test_what_sweeps_leave_does_not_add_up():
    """The energy stays at small steps, where one rate for all sweeps underestimated the rest:
    2.5e-14."""
    ensemble = gs.stepper("G-L", 8, "gamma").integrate_ensemble(
        np.tile(TOP.q0, (8, 1)), np.tile(TOP.p0, (8, 1)), dt=5e-4, steps=100_000, every=100_000,
        parameters=members(8), workers=1)
    drift = [m.report.energy_error_max / abs(m.report.energy_start) for m in ensemble.members]
    assert np.sqrt(np.mean(np.square(drift))) < 8e-15
