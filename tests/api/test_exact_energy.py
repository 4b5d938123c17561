"""G-L with exact energy: H, constraints, momenta, its order, and steps where the energy waits."""

from __future__ import annotations

from itertools import pairwise

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from calls import PARAMETERS, TOP


def ulps(run):
    """Return the largest |H − H₀| in units of the last place of H₀."""
    return run.report.energy_error_max / np.spacing(abs(run.report.energy_start))


@pytest.mark.parametrize(("stages", "steps"), [
    (2, 200), pytest.param(3, 100_000, marks=pytest.mark.slow)])  # drift shows in long runs
def test_the_fast_top_keeps_everything(stages, steps):
    step = systems.stepper("heavy_top", "G-L", stages, energy=True)
    run = step.integrate(TOP.q0, TOP.p0, dt=0.01, steps=steps, parameters=PARAMETERS,
                         every=steps // 100)
    assert ulps(run) <= (8 if steps < 10_000 else 12)
    assert run.report.energy_waits == 0
    assert run.report.constraint_max < 1e-15
    assert run.report.momentum_constraint_max < 1e-16
    plain = systems.stepper("heavy_top", "G-L", stages).integrate(
        TOP.q0, TOP.p0, dt=0.01, steps=steps, parameters=PARAMETERS, every=steps // 100)
    assert plain.report.energy_error_max > 1e6 * run.report.energy_error_max
    spin = run.angular_velocity()[:, 2]
    assert np.abs(spin / spin[0] - 1).max() < 1e-16 * steps  # Newton's method has no sums in pairs


@pytest.mark.slow  # steppers in float128
@pytest.mark.parametrize("stages", [2, 3])
def test_order_is_twice_the_stages_with_113_bits(stages):
    """Runs with h, h/2, h/4 differ by this order; the energy is exact to 1e-30 in every step."""
    step = systems.stepper("heavy_top", "G-L", stages, "float128", energy=True)
    q, p = step.project(TOP.q0, TOP.p0, parameters=PARAMETERS)
    ends = []
    for count in (16, 32, 64):
        run = step.integrate(q, p, dt=mp.mpf("0.04") / count, steps=count, parameters=PARAMETERS)
        assert run.report.energy_error_max < 1e-30
        ends.append(run.q[-1])
    coarse, fine = (max(abs(b - a)) for a, b in pairwise(ends))
    assert float(mp.log(coarse / fine, 2)) == pytest.approx(2 * stages, abs=0.15)


def well():
    """Return a particle in a double well, whose H depends on θ little at the turning points."""
    q, p = sp.symbols("q p", real=True)
    return gs.System((q,), (p,), (), p**2 / 2 + q**4 / 4 - q**2, name="well")


def test_the_energy_waits_where_it_does_not_depend_on_theta():
    """Such steps are counted, their error is below G-L's, and later steps compensate it."""
    run = gs.stepper("G-L", 2, system=well(), energy=True).integrate(
        [0.3], [1.5], dt=0.1, steps=400, parameters={})
    error = np.abs(run.energy_error())
    assert 0 < run.report.energy_waits < 40
    assert np.median(error) < 1e-15
    assert error.max() < 3.3e-5 / 2  # of 2-G-L


@pytest.mark.parametrize("damped", [False, True])
def test_a_pendulum_with_and_without_forces(damped):
    """From rest with H_0 = 0 the energies of the step are the scale; H less the work is exact."""
    step = systems.stepper("dragged_pendulum", energy=True)
    parameters = {"k": 1.3, "c": 0.2, "f": 0.7, "omega": 2.1}
    run = step.integrate([1, 0], [0, 0], dt=0.04, steps=200, parameters=parameters if damped else
                         dict.fromkeys(parameters, 1e-300))
    assert run.report.energy_waits <= (3 if damped else 0)
    assert bool(np.abs(run.work).max() > 0.1) == damped
    assert np.median(np.abs(run.energy_error())) < 2e-15
    assert damped or run.report.energy_error_max < 1e-14


def test_ensembles_and_single_steps():
    step = systems.stepper("heavy_top", energy=True)
    q0, p0 = np.stack([TOP.q0] * 3), np.stack([TOP.p0, 0.9 * TOP.p0, 1.1 * TOP.p0])
    ensemble = step.integrate_ensemble(q0, p0, dt=0.01, steps=20, parameters=PARAMETERS)
    for i in range(3):
        single = step.integrate(q0[i], p0[i], dt=0.01, steps=20, parameters=PARAMETERS)
        assert np.array_equal(single.q[-1], ensemble.q[i][-1])
        assert ulps(single) <= 8
    q1, p1 = step.step(TOP.q0, TOP.p0, dt=0.01, parameters=PARAMETERS)
    change = step.energy(q1, p1, parameters=PARAMETERS) - step.energy(TOP.q0, TOP.p0,
                                                                      parameters=PARAMETERS)
    assert abs(float(change)) < 8e-15


@pytest.mark.parametrize("body", [
    False, pytest.param(True, marks=pytest.mark.slow)])  # the derivation of a body takes seconds
def test_the_certificate_guarantees_energy_and_no_symplecticity(body):
    problem = TOP if body else gs.Model(well(), {}, [0.3], [1.5])
    certificate = gs.certify(problem, "G-L", 2, energy=True, dt=0.01, steps=20)
    assert certificate.holds
    assert certificate.line("energy").holds is True
    assert certificate.line("loop invariant").holds is None
    assert certificate.line("reversal").holds is None
    if body:
        assert certificate.line("angular momentum about e3").holds is True


@pytest.mark.parametrize(("choice", "named"), [
    ({"scheme": "EMS"}, "G-L"), ({"scheme": "G-L", "stages": 1}, "1-G-L"),
    ({"scheme": "LIIIA-B", "stages": 3}, "3-LIIIA-B"),
    ({"scheme": "G-L", "stages": 2, "frame": "symmetries"}, "frame")])
def test_schemes_without_exact_energy_are_refused(choice, named):
    with pytest.raises(gs.InputError, match=named):
        gs.stepper(**choice, energy=True)


def test_steps_with_exact_energy_refuse_solvers_derivatives_and_profiles(gyrospark):
    step = systems.stepper("heavy_top", energy=True)
    with pytest.raises(gs.InputError, match="fixed-point"):
        step.integrate(TOP.q0, TOP.p0, dt=0.01, steps=2, parameters=PARAMETERS,
                       solver="fixed-point")
    with pytest.raises(gs.InputError, match="derivatives"):
        step.jvp(TOP.q0, TOP.p0, np.zeros(4), np.zeros(4), dt=0.01, parameters=PARAMETERS)
    answer = gyrospark("generate", "--scheme", "G-L", "--stages", "2", "--energy", "--profile",
                       "control")
    assert answer.code == 2
    assert "control" in answer.stderr
    answer = gyrospark("run", "fast-top", "--scheme", "G-L", "--stages", "2", "--energy", "--dt",
                       "0.01", "--steps", "20", "--json")
    assert answer.document["energy_waits"] == 0
    assert answer.document["stepper"] == "heavy_top_gl2_energy_gamma"
