"""Steps without a solution: the error, and the states that remain of the run."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import gyrospark as gs
from calls import LATE, PARAMETERS, RUN, TOP, equal
from gyrospark.runtime.bindings.binding import REASONS


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_failed_step_carries_everything_before_it(failures):
    """Bit for bit what a shorter run returns; step, time and reason are told."""
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
    """The rows that were complete are there; the report knows the last good state."""
    for step, options, failure in failures:
        with pytest.raises(gs.StepFailed) as caught:
            step.integrate(*LATE, steps=200, every=every, **options)
        assert caught.value.step == failure.step
        made, whole = caught.value.trajectory, failure.trajectory
        assert made.report == whole.report
        kept = np.arange(0, failure.step, every)
        assert np.array_equal(made.q[: len(kept)], whole.q[kept])
        assert np.array_equal(made.t[: len(kept)], whole.t[kept])
        assert made.report.q == tuple(whole.q[-1])


def test_one_iteration_is_not_enough(step):
    with pytest.raises(gs.StepFailed, match=r"Step 1.*converge") as caught:
        step.step(TOP.q0, TOP.p0, solver=gs.Solver("newton", max_iterations=1), **RUN)
    assert len(caught.value.trajectory) == 1
    assert caught.value.trajectory.multipliers.shape[0] == 0


@pytest.mark.filterwarnings("ignore:The fastest rotation")
@pytest.mark.parametrize("dt", [-1e300, 1e-320, 1e30])
def test_hopeless_time_step_fails_or_works_without_a_warning(dt, step):
    """No exception but StepFailed; what is returned is finite and on the constraint."""
    for solver in ("auto", "newton"):
        try:
            q, p = step.step(TOP.q0, TOP.p0, dt=dt, parameters=PARAMETERS, solver=solver)
        except gs.StepFailed as failure:
            assert failure.step == 1  # noqa: PT017 (it may fail and need not)
            continue
        assert np.isfinite(q).all()
        assert np.isfinite(p).all()
        assert abs(q @ q - 1) < 1e-12


@pytest.mark.parametrize("changes", [{"I1": 1e-310}, {"gamma": 1e308}, {"mgl": 1e308},
                                     {"gamma": 5e-324}], ids=str)
def test_parameters_at_the_edge_fail_cleanly(changes, step):
    """What is returned is finite, or a step fails, or H is refused: no NaN passed off, no hang."""
    for solver in ("auto", "newton"):
        try:
            made = step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=3, solver=solver,
                                  parameters=PARAMETERS | changes)
        except gs.StepFailed:
            continue
        except gs.InputError as refused:
            assert "H = nan" in str(refused)  # noqa: PT017 (it may be refused and need not)
            continue
        assert np.isfinite(made.q).all()
        assert np.isfinite(made.p).all()


def test_failure_can_be_sent_to_another_process(failures):
    """A worker's exception that cannot be pickled would hang its pool."""
    for _, _, failure in failures:
        for other in (pickle.loads(pickle.dumps(failure)), copy.copy(failure)):
            assert (other.step, other.t, other.reason) == (failure.step, failure.t, failure.reason)
            assert equal(other.trajectory, failure.trajectory)
            assert str(other) == str(failure)
