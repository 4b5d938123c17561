"""G-L with exact energy: H, constraints, momenta, its order, and steps where the energy waits."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs

TOP = gs.problems.fast_top()
PARAMETERS = TOP.parameters | {"gamma": gs.gamma_m(TOP.inertia)}


def ulps(run):
    """Return the largest |H − H₀| in units of the last place of H₀."""
    return run.report.energy_error_max / np.spacing(abs(run.report.energy_start))


@pytest.mark.parametrize(("stages", "steps"), [
    (2, 1000), (3, 1000), pytest.param(3, 100_000, marks=pytest.mark.slow)])
def test_the_fast_top_keeps_everything(stages, steps):
    step = gs.stepper("G-L", stages, energy=True)
    run = step.integrate(TOP.q0, TOP.p0, dt=0.01, steps=steps, parameters=PARAMETERS,
                         every=steps // 100)
    assert ulps(run) <= (8 if steps < 10_000 else 12)
    assert run.report.energy_waits == 0
    assert run.report.constraint_max < 1e-15
    assert run.report.momentum_constraint_max < 1e-16
    plain = gs.stepper("G-L", stages).integrate(TOP.q0, TOP.p0, dt=0.01, steps=steps,
                                                parameters=PARAMETERS, every=steps // 100)
    assert plain.report.energy_error_max > 1e6 * run.report.energy_error_max
    spin = run.angular_velocity()[:, 2]
    assert np.abs(spin / spin[0] - 1).max() < 1e-16 * steps  # Newton's method has no sums in pairs


def test_order_six_with_113_bits():
    """Of three stages; the energy is exact to 1e-30 in every step."""
    step = gs.stepper("G-L", 3, energy=True, real="float128")
    plain = gs.stepper("G-L", 5, real="float128")
    q0, p0 = plain.project(TOP.q0, TOP.p0, parameters=PARAMETERS)
    exact = plain.integrate(q0, p0, dt=mp.mpf("0.0005"), steps=160, parameters=PARAMETERS)
    errors = []
    for count in (16, 32):
        run = step.integrate(q0, p0, dt=mp.mpf("0.08") / count, steps=count, parameters=PARAMETERS)
        assert run.report.energy_error_max < 1e-30
        errors.append(max(abs(a - b) for a, b in zip(run.q[-1], exact.q[-1], strict=True)))
    assert float(mp.log(errors[0] / errors[1], 2)) == pytest.approx(6, abs=0.15)


def well():
    """Return a particle in a double well, whose H depends on θ little at the turning points."""
    q, p = sp.symbols("q p", real=True)
    return gs.System((q,), (p,), (), p**2 / 2 + q**4 / 4 - q**2, name="well")


def test_the_energy_waits_where_it_does_not_depend_on_theta():
    """Such steps are counted, their error is below G-L's, and later steps compensate it."""
    run, plain = (gs.stepper("G-L", 2, system=well(), energy=energy).integrate(
        [0.3], [1.5], dt=0.1, steps=400, parameters={}) for energy in (True, False))
    error = np.abs(run.energy_error())
    assert 0 < run.report.energy_waits < 40
    assert np.median(error) < 1e-15
    assert error.max() < plain.report.energy_error_max / 2
    found = gs.certify(gs.Model(well(), {}, [0.3], [1.5], dt=0.1, steps=20), "G-L", 2, energy=True)
    assert found.holds
    assert found.line("energy").holds is None


def test_a_pendulum_from_rest():
    """H_0 = 0 and no velocity: the energies of the step are the scale, not H_0."""
    x, y, u, v = sp.symbols("x y u v", real=True)
    rod = gs.System((x, y), (u, v), (), (u**2 + v**2) / 2 + 10 * y, [x**2 + y**2 - 1], name="swing")
    run = gs.stepper("G-L", 2, system=rod, energy=True).integrate(
        [1, 0], [0, 0], dt=0.04, steps=200, parameters={})
    assert run.report.energy_waits == 0
    assert run.report.energy_error_max < 1e-14


def test_forces_do_their_work():
    """H less the work is exact, with damping."""
    q, p = sp.symbols("q p", real=True)
    damped = gs.System((q,), (p,), (), p**2 / 2 + q**4 / 4, name="damped", forces=[-p / 10])
    run = gs.stepper("G-L", 2, system=damped, energy=True).integrate(
        [1.0], [0.5], dt=0.1, steps=200, parameters={})
    assert run.work[-1] < -0.1
    assert np.median(np.abs(run.energy_error())) < 1e-15


def test_ensembles_and_single_steps():
    step = gs.stepper("G-L", 2, energy=True)
    q0, p0 = np.stack([TOP.q0] * 3), np.stack([TOP.p0, 0.9 * TOP.p0, 1.1 * TOP.p0])
    many = step.integrate_ensemble(q0, p0, dt=0.01, steps=20, parameters=PARAMETERS)
    for i in range(3):
        one = step.integrate(q0[i], p0[i], dt=0.01, steps=20, parameters=PARAMETERS)
        assert np.array_equal(one.q[-1], many.q[i][-1])
        assert ulps(one) <= 8
    q1, p1 = step.step(TOP.q0, TOP.p0, dt=0.01, parameters=PARAMETERS)
    change = step.energy(q1, p1, parameters=PARAMETERS) - step.energy(TOP.q0, TOP.p0,
                                                                      parameters=PARAMETERS)
    assert abs(float(change)) < 8e-15


def test_the_certificate_guarantees_energy_and_no_symplecticity():
    found = gs.certify(TOP, "G-L", 3, energy=True, dt=0.01, steps=20)
    assert found.holds
    assert found.line("energy").holds is True
    assert found.line("loop invariant").holds is None
    assert found.line("reversal").holds is None
    assert found.line("angular momentum about e3").holds is True


@pytest.mark.parametrize(("choice", "named"), [
    ({"scheme": "EMS"}, "G-L"), ({"scheme": "G-L", "stages": 1}, "1-G-L"),
    ({"scheme": "LIIIA-B", "stages": 3}, "3-LIIIA-B"),
    ({"scheme": "G-L", "stages": 2, "frame": "symmetries"}, "frame")])
def test_what_has_no_exact_energy_is_refused(choice, named):
    with pytest.raises(gs.InputError, match=named):
        gs.stepper(**choice, energy=True)


def test_what_steps_with_exact_energy_lack_is_refused(gyrospark):
    step = gs.stepper("G-L", 2, energy=True)
    for solver in ("python", "fixed-point"):
        with pytest.raises(gs.InputError, match=solver):
            step.integrate(TOP.q0, TOP.p0, dt=0.01, steps=2, parameters=PARAMETERS, solver=solver)
    with pytest.raises(gs.InputError, match="derivatives"):
        step.jvp(TOP.q0, TOP.p0, np.zeros(4), np.zeros(4), dt=0.01, parameters=PARAMETERS)
    refused = gyrospark("generate", "--scheme", "G-L", "--stages", "2", "--energy", "--profile",
                        "control")
    assert refused.code == 2
    assert "control" in refused.stderr
    told = gyrospark("run", "fast-top", "--scheme", "G-L", "--stages", "2", "--energy", "--dt",
                     "0.01", "--steps", "20", "--json")
    assert told.document["energy_waits"] == 0
    assert told.document["stepper"] == "heavy_top_gl2_energy_gamma"
