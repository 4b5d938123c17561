"""Invariants of steppers of the top at random states; studies have the paper's tables."""

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.runtime.rigid_body.quaternion import left_matrix, rotation_matrix
from strategies import (
    EPS,
    MEAN_SPECS,
    PAPER_SPECS,
    SPARK_SPECS,
    few,
    identify,
    random_case,
    stepper_of,
)


@pytest.mark.filterwarnings("ignore:The fastest rotation")
@pytest.mark.parametrize("spec", few(SPARK_SPECS), ids=identify)
def test_steps_too_long_fail_or_are_right(spec):
    """Steps of up to 30 rad: Newton often fails there, but says so.

    An iterate thrown far off by a nearly singular matrix shrinks by half, not quadratically; a
    rule that trusts one ratio of increments takes it for the solution.
    """
    rng = np.random.default_rng(3)
    drawn = [random_case(rng, spec.rep, turn=(0.5, 30)) for _ in range(200)]
    ensemble = stepper_of(spec).integrate_ensemble(
        np.array([case.q for case in drawn]), np.array([case.p for case in drawn]),
        dt=np.array([case.dt for case in drawn]), steps=1,
        parameters=[case.parameters for case in drawn])
    q = ensemble.q[:, 1]
    done = np.isfinite(q).all(axis=1)
    assert 20 < done.sum() < 180
    # Stages far from the unit sphere, |Q|² up to 100, leave that many ε in the last constraint.
    assert np.abs(np.einsum("ki,ki->k", q[done], q[done]) - 1).max() <= 100 * EPS


@pytest.mark.parametrize("spec", few(MEAN_SPECS), ids=identify)
def test_states_of_ims_and_ems_are_starts(spec):
    """Every state is a start, also of a top let go at rest, whose qᵀp exceeds |Δt H_p|²|p|."""
    step, fast = stepper_of(spec), gs.problems.fast_top()
    parameters = fast.parameters | {spec.rep: gs.gamma(fast.inertia)}
    for dt, p0 in ((1e-3, fast.p0), (1e-2, 0 * fast.p0)):
        run = step.integrate(fast.q0, p0, dt=dt, steps=30, parameters=parameters, solver="newton")
        for k in range(30):
            state = run.q[k], run.p[k]
            q, p = step.step(*state, dt=dt, parameters=parameters, solver="newton")
            assert np.array_equal(q, run.q[k + 1])
            assert np.array_equal(p, run.p[k + 1])
            q, p = step.step(*state, dt=dt, parameters=parameters)
            assert np.abs(q - run.q[k + 1]).max() < 1e-14
            assert np.abs(p - run.p[k + 1]).max() < 1e-14


@pytest.mark.parametrize("spec", few(PAPER_SPECS), ids=identify)
def test_quadratic_invariants(spec):
    """l₃ of a symmetric top and the vertical momentum, both bilinear in q and p (paper, Table 2).

    IMS, G-L and LIIIA-B conserve every bilinear invariant. EMS conserves the vertical momentum, as
    L(q)p itself does not change when space is turned, but not l₃: its mean(L(q)p) is not L(q̄)p̄,
    and D does not commute with their cross product.
    """
    steps, step, rng = 1000, stepper_of(spec), np.random.default_rng(25)
    across = 8 * EPS * np.sqrt(steps)  # a random walk of ε a step; l and R l take a dozen more
    for _ in range(2):
        case = random_case(rng, spec.rep, turn=(0.05, 0.2))
        parameters = case.parameters | {"I2": case.parameters["I1"]}
        p = 2 * left_matrix(case.q).T @ (np.array([1, 1, 1.5]) * case.omega * case.inertia)
        p -= (case.q @ p) * case.q
        run = step.integrate(case.q, p, steps=steps, dt=case.dt, parameters=parameters)
        moment = np.einsum("...ij,...j->...i", left_matrix(run.q), run.p) / 2
        vertical = np.einsum("...j,...j->...", rotation_matrix(run.q)[:, 2], moment)
        size = np.linalg.norm(p) / 2
        assert np.abs(vertical - vertical[0]).max() <= across * size
        error = np.abs(moment[:, 2] - moment[0, 2]).max() / size
        assert error > 100 * across if spec.scheme == "EMS" else error <= across
        assert run.report.energy_error_mean == pytest.approx(
            np.abs(run.energy() - run.energy()[0]).mean(), rel=1e-9)
