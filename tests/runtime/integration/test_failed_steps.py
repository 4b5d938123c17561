"""``StepFailed``: reason, increment, a step that would converge, and the states that remain."""

from __future__ import annotations

import copy
import pickle
from functools import cache

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from calls import LATE, PARAMETERS, RUN, TOP, equal
from gyrospark.runtime.bindings.binding import REASONS

pytestmark = pytest.mark.filterwarnings("ignore:The fastest rotation")

FEW = gs.Solver("auto", max_iterations=2)
FAILURES = {
    "diverged": {"dt": 0.08, "solver": "fixed-point"},
    "not converged": {"dt": 0.01, "solver": FEW},
    "a root that Newton cannot reach": {"dt": 0.2},
}


def failed(step, **run) -> gs.StepFailed:
    with pytest.raises(gs.StepFailed) as caught:
        step.integrate(TOP.q0, TOP.p0, steps=20, parameters=PARAMETERS, **run)
    return caught.value


@pytest.mark.parametrize("run", FAILURES.values(), ids=FAILURES)
def test_the_step_that_it_proposes_does(run, gl3):
    failure = failed(gl3, **run)
    assert 0 < failure.dt < run["dt"]
    assert f"dt = {failure.dt:.9g} does" in str(failure)
    state = failure.trajectory
    retried = gl3.integrate(state.q[-1], state.p[-1], steps=1, parameters=PARAMETERS,
                            **run | {"dt": failure.dt})
    assert len(retried) == 2


def test_too_few_iterations_are_distinguished_from_divergence(gl3):
    few = failed(gl3, dt=0.01, solver=FEW)
    assert few.reason == "not converged"
    assert "2 iterations" in str(few)
    assert "max_iterations" in str(few)
    assert 1e-3 < few.increment < 1
    assert f"{few.increment:.1e}" in str(few)
    assert failed(gl3, dt=0.08, solver="fixed-point").reason == "diverged"


@cache
def damped():
    """Return a body under a spring and its weight, with a damper and friction on a belt."""
    x, p, k, g, c, a, b, belt = sp.symbols("x p k g c a b belt", real=True)
    return gs.stepper("IMS", system=gs.System(
        (x,), (p,), (k, g, c, a, b, belt), p**2 / 2 + k * x**2 / 2 + g * x,
        forces=[-c * sp.tanh(a * (p - belt)) - sp.sinh(b * p)], name="damped"))


@pytest.mark.parametrize(("belt", "reason"), [(1.0, "stagnated"), (0.0, "diverged")])
def test_stagnation_is_reported(belt, reason):
    """At a jump of the force increments neither shrink nor grow, which no rounding explains.

    The momentum jumps by 2 c dt: a small part of it on a belt that moves, all of it at rest.
    """
    dt, friction = 1e-4, 2.0
    with pytest.raises(gs.StepFailed) as caught:  # friction, as steep as a jump for these steps
        damped().integrate([0.0], [belt + 1e-5], dt=dt, steps=1, solver="newton",
                           parameters={"k": 0, "g": 1, "c": friction, "a": 1e9, "b": 0,
                                       "belt": belt})
    assert caught.value.reason == reason
    if belt:  # increments are relative to the momentum, which is 1 within some dt
        assert caught.value.increment == pytest.approx(2 * friction * dt, rel=4 * dt)
    else:
        assert caught.value.increment > 1


def test_ensembles_tell_the_reason_without_looking_for_a_cure(gl3):
    ensemble = gl3.integrate_ensemble(np.array([TOP.q0] * 2), np.array([TOP.p0] * 2),
                                      dt=np.array([1e-3, 0.08]), steps=3, parameters=PARAMETERS,
                                      solver="fixed-point")
    assert list(ensemble.failures) == [1]
    assert ensemble.failures[1].reason == "diverged"
    assert ensemble.failures[1].dt is None


def test_newton_that_leaves_the_range_of_numbers_has_diverged():
    """The state is finite, and so are its forces: the reason is not that numbers are not finite."""
    with pytest.raises(gs.StepFailed) as caught:
        damped().integrate([0.0], [3.0], dt=1.0, steps=1,
                           parameters={"k": 1, "g": 0, "c": 0, "a": 0, "b": 50, "belt": 0})
    assert caught.value.reason == "diverged"


def test_a_parameter_beyond_the_range_is_named(gl3):
    with pytest.raises(gs.StepFailed, match=r"mgl = 1e\+300.*range") as caught:
        gl3.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=1, parameters=PARAMETERS | {"mgl": 1e300})
    assert caught.value.reason == "not finite"


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_failed_step_carries_everything_before_it(failures):
    """The error has the bits of a shorter run, with step, time and reason."""
    for step, options, failure in failures:
        before = failure.step - 1
        shorter = step.integrate(*LATE, steps=before, **options)
        assert equal(failure.trajectory, shorter)
        assert failure.trajectory.report == shorter.report
        assert failure.t == before * options["dt"]
        assert failure.reason in REASONS.values()
        assert f"Step {failure.step} at t = " in str(failure)
        assert failure.reason in str(failure)


@pytest.mark.parametrize("every", [3, 1000])
def test_failed_step_between_stored_ones(every, failures):
    """The complete rows are there; the report has the last good state."""
    for step, options, failure in failures:
        with pytest.raises(gs.StepFailed) as caught:
            step.integrate(*LATE, steps=200, every=every, **options)
        assert caught.value.step == failure.step
        partial, full = caught.value.trajectory, failure.trajectory
        assert partial.report == full.report
        stored = np.arange(0, failure.step, every)
        assert np.array_equal(partial.q[: len(stored)], full.q[stored])
        assert np.array_equal(partial.t[: len(stored)], full.t[stored])
        assert partial.report.q == tuple(full.q[-1])


def test_one_iteration_is_not_enough(step):
    with pytest.raises(gs.StepFailed, match=r"Step 1.*converge") as caught:
        step.step(TOP.q0, TOP.p0, solver=gs.Solver("newton", max_iterations=1), **RUN)
    assert len(caught.value.trajectory) == 1
    assert caught.value.trajectory.multipliers.shape[0] == 0


@pytest.mark.filterwarnings("ignore:The fastest rotation")
@pytest.mark.parametrize(("dt", "reason"), [
    (-1e300, "not finite"), (1e-320, "not finite"), (1e30, "diverged")])
def test_hopeless_time_step_fails_without_a_warning(dt, reason, step):
    """The first step fails; the start is the only state."""
    for solver in ("auto", "newton"):
        with pytest.raises(gs.StepFailed) as caught:
            step.step(TOP.q0, TOP.p0, dt=dt, parameters=PARAMETERS, solver=solver)
        assert (caught.value.step, caught.value.reason) == (1, reason)
        assert np.array_equal(caught.value.trajectory.q, [TOP.q0])
        assert np.array_equal(caught.value.trajectory.p, [TOP.p0])


@pytest.mark.parametrize(("changes", "error"), [
    ({"I1": 1e-310}, gs.InputError), ({"gamma": 5e-324}, gs.InputError),  # their inverses overflow
    ({"gamma": 1e308}, gs.StepFailed), ({"mgl": 1e308}, gs.StepFailed)], ids=str)
def test_parameters_at_the_edge_fail_cleanly(changes, error, step):
    """H that is not finite is refused, else the first step fails: nothing returns NaN or hangs."""
    for solver in ("auto", "newton"):
        with pytest.raises(error) as caught:
            step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=3, solver=solver,
                           parameters=PARAMETERS | changes)
        if error is gs.StepFailed:
            assert caught.value.reason in ("not finite", "diverged")
            assert np.array_equal(caught.value.trajectory.q, [TOP.q0])


def test_failure_can_be_sent_to_another_process(failures):
    """A worker's exception that cannot be pickled would hang its pool."""
    for _, _, failure in failures:
        for copied in (pickle.loads(pickle.dumps(failure)), copy.copy(failure)):
            assert (copied.step, copied.t, copied.reason) == (
                failure.step, failure.t, failure.reason)
            assert equal(copied.trajectory, failure.trajectory)
            assert str(copied) == str(failure)
