"""Chains and loops side by side in lanes: what one gives is its own, to the bit."""

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import equal

EPS = 2.0**-52


def starts(name, count):
    """Return starts of a case on its constraints, the first its own."""
    case, step, draw = systems.case(name), systems.stepper(name), np.random.default_rng(1)
    q, p = np.array(case.q), np.array(case.p)
    displacements = 0.03 * draw.standard_normal((count, 2, len(q)))
    displacements[0] = 0
    states = [step.project(q + dq, p + dp * np.abs(p).max(), parameters=case.parameters)
              for dq, dp in displacements]
    return tuple(map(np.array, zip(*states, strict=True)))


@pytest.fixture(params=["double_top", "four_bar"])
def batch(request):
    """A stepper, seven starts and time steps, and parameters: of a chain and of a loop."""
    name = request.param
    return (systems.stepper(name), *starts(name, 7), np.linspace(5e-4, 4e-3, 7),
            systems.case(name).parameters)


def test_a_linkage_does_not_depend_on_its_neighbours(batch):
    """It has the same bits beside six others, in another order and alone in its batch."""
    step, q, p, dts, parameters = batch
    run = {"steps": 70, "every": 7, "parameters": parameters}
    ensemble = step.integrate_ensemble(q, p, dt=dts, **run)
    reversed_order = step.integrate_ensemble(q[::-1], p[::-1], dt=dts[::-1], workers=1, **run)
    assert not ensemble.failures
    for i, member in enumerate(ensemble.members):
        batch_of_one = step.integrate_ensemble(q[i : i + 1], p[i : i + 1], dt=dts[i], **run)
        assert equal(member, batch_of_one.members[0])
        assert member.report == batch_of_one.members[0].report == reversed_order.members[
            6 - i].report
        assert equal(member, reversed_order.members[6 - i])
        single = step.integrate(q[i], p[i], dt=dts[i], **run)
        # 70 steps of round-off, stages in lanes there, trajectories here
        assert np.abs(single.q - member.q).max() <= 256 * EPS
        assert np.abs(single.p - member.p).max() <= 256 * EPS * np.abs(single.p).max()
        assert member.report.newton_steps == 0
        # q is a rounded sum: an ulp of a quaternion's entries, of places and of arms
        assert member.report.constraint_max <= 4 * EPS


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_a_linkage_that_fails_falls_out_alone(batch):
    """A step of one second is too long for a pendulum of one second: only that lane ends."""
    step, q, p, dts, parameters = batch
    dts[2] = 1.0
    run = {"steps": 12, "parameters": parameters}
    ensemble = step.integrate_ensemble(q, p, dt=dts, **run)
    failing = step.integrate_ensemble(q[2:3], p[2:3], dt=1.0, **run)
    assert list(ensemble.failures) == [2]
    failure, expected = ensemble.failures[2], failing.failures[0]
    assert (failure.step, failure.reason) == (expected.step, expected.reason)
    assert equal(failure.trajectory, expected.trajectory)
    for i in (0, 1, 3, 4, 5, 6):
        single = step.integrate_ensemble(q[i : i + 1], p[i : i + 1], dt=dts[i], **run)
        assert equal(ensemble.members[i], single.members[0])


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_a_lane_that_newton_finishes_stays_its_own(batch):
    """Newton takes steps too long for 15 sweeps in that lane; its mates have the same bits."""
    step, q, p, dts, parameters = batch
    dts[4] = 0.05
    run = {"steps": 6, "parameters": parameters, "solver": gs.Solver("auto", max_iterations=15)}
    ensemble = step.integrate_ensemble(q, p, dt=dts, **run)
    single = step.integrate_ensemble(q[4:5], p[4:5], dt=0.05, **run)
    assert ensemble.members[4].report == single.members[0].report
    assert equal(ensemble.members[4], single.members[0])
    assert ensemble.members[4].report.newton_steps > 0
    assert not any(ensemble.members[i].report.newton_steps for i in (0, 1, 2, 3, 5, 6))


def test_predictions_follow_a_motion_that_changes():
    """A fit to the first steps of a loop is useless later: alone it needs 10.9 sweeps a step.

    The run is computed both ways, for the polynomials in its place are chosen lane by lane.
    """
    step, case = systems.stepper("four_bar"), systems.case("four_bar")
    run = {"dt": 8e-3, "steps": 400, "every": 400, "parameters": case.parameters}
    single = step.integrate(case.q, case.p, **run)
    ensemble = step.integrate_ensemble([case.q] * 2, [case.p] * 2, **run)
    for member in (single, *ensemble.members):
        assert member.report.iterations_mean < 10.7
        assert member.report.newton_steps == 0
