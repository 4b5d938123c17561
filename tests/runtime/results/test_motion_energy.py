"""The energy of the motion is H with p projected onto the constraint on the momenta."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

import gyrospark as gs
import systems
from gyrospark.certificates.guarantees import MeanGuarantees
from gyrospark.generator.multibody.rigid_body import heavy_top

TOP = gs.problems.fast_top()
DT, STEPS = 0.01, 100


def run_of(scheme, rep, **options):
    """Return a stepper and its run of the fast top."""
    step = gs.stepper(scheme, rep=rep, **options)
    return step, step.integrate(TOP.q0, TOP.p0, dt=DT, steps=STEPS,
                                parameters=TOP.parameters | {rep: gs.gamma(TOP.inertia)})


def energy_of_the_body(run):
    """Return mᵀJ⁻¹m/2 + mgl R33, from what the body has alone."""
    m = run.body().angular_velocity() * TOP.inertia
    return (m**2 / TOP.inertia).sum(axis=1) / 2 + TOP.parameters["mgl"] * run.axis()[:, 2]


@pytest.mark.parametrize(("scheme", "rep"), [("EMS", "gamma"), ("EMS", "alpha")])
def test_it_is_what_the_body_has(scheme, rep):
    """H has (qᵀp)²/8γ more, or /8α, on |q| = 1."""
    _, run = run_of(scheme, rep)
    energies = run.energy(of_motion=True)
    assert np.abs(energies - energy_of_the_body(run)).max() < 1e-13
    radial = (run.q * run.p).sum(axis=1)**2 / (8 * gs.gamma(TOP.inertia))
    assert np.abs(run.energy() - energies - radial).max() < 2e-14


def test_ems_keeps_h_and_not_the_energy_of_the_motion():
    """The error is of order 4, as f² with f of order 2; the α-type has f = 0 and both energies."""
    step, run = run_of("EMS", "gamma")
    coarse = np.abs(run.energy_error(of_motion=True)).max()
    fine = step.integrate(TOP.q0, TOP.p0, dt=DT/2, steps=2*STEPS, parameters=run.parameters)
    assert run.report.energy_error_max < 1e-13
    assert 14 < coarse / np.abs(fine.energy_error(of_motion=True)).max() < 18
    assert coarse == pytest.approx(8.89e-9, rel=0.01)
    assert np.abs(run_of("EMS", "alpha")[1].energy_error(of_motion=True)).max() < 1e-13


def test_where_the_momenta_are_projected_both_are_one():
    _, run = run_of("G-L", "gamma", stages=2)
    assert not run.has_motion_energy
    assert run.energy(of_motion=True) is run.energy()


def test_constraints_that_move():
    """On an ellipse that breathes, p − m Gᵀ f/(G Gᵀ) with f = G p/m + g_t is computed by hand."""
    step, values = systems.stepper("breathing", "EMS"), systems.case("breathing").parameters
    m, k, g, length = (values[name] for name in ("m", "k", "g", "l"))
    times = np.array([0.3, 0.7])
    width = length + np.sin(2 * times) / 4
    q = np.stack([width * [0.6, 0.8], [0.8, -0.6]], axis=1)
    p = np.array([[0.3, -1.0], [0.5, 0.2]])
    energies = step.energy(q, p, parameters=values, t=times, of_motion=True)
    G = 2 * q / np.stack([width**2, [1, 1]], axis=1)
    f = (G * p).sum(axis=1) / m - q[:, 0]**2 / width**3 * np.cos(2 * times)
    projected = p - m * G * (f / (G**2).sum(axis=1))[:, None]
    potential = k * q[:, 0]**4 / 4 + g * q[:, 1] * q[:, 0]
    assert energies == pytest.approx((projected**2).sum(axis=1) / (2 * m) + potential, rel=1e-14)


def test_the_command_reports_both(gyrospark):
    of_ems, of_gl = (gyrospark("run", "fast-top", "--scheme", *scheme, "--dt", "0.01", "--steps",
                               "100", "--json").document
                     for scheme in (["EMS"], ["G-L", "--stages", "2"]))
    assert of_ems["motion_energy_error_max"] == pytest.approx(8.89e-9, rel=0.01)
    assert of_ems["motion_energy_error_mean"] < of_ems["motion_energy_error_max"]
    assert of_ems["energy_error_max"] < 1e-13
    assert not any(key.startswith("motion_energy") for key in of_gl)


def test_a_trajectory_without_its_stepper_asks_for_it(tmp_path):
    step, run = run_of("EMS", "gamma")
    again = gs.load(run.save(tmp_path / "run.npz"))
    with pytest.raises(gs.InputError, match="stepper"):
        again.energy(of_motion=True)
    errors = again.energy_error(of_motion=True, stepper=step)
    assert np.array_equal(errors, run.energy_error(of_motion=True))


@pytest.mark.parametrize(("name", "rep", "is_kept"), [
    ("EMS", "alpha", True), ("EMS", "gamma", False), ("IMS", "alpha", False),
    ("IMS", "gamma", False)])
def test_which_scheme_keeps_the_momentum_constraint_is_derived(name, rep, is_kept):
    system = heavy_top(rep)
    numbers = {s: Fraction(i + 2, 7) for i, s in enumerate(system.parameters)}
    assert MeanGuarantees(system, numbers, name, 2).momentum_constraint().guaranteed is is_kept


def test_an_energy_that_is_no_number_has_no_largest_error():
    """A step across 0 in log(x) leads to a real motion at x < 0, where H is no number."""
    step, case = systems.stepper("logarithm"), systems.case("logarithm")
    for speed in (-40.0, 0.0):
        report = step.integrate([0.3], [speed], dt=0.01, steps=2,
                                parameters=case.parameters).report
        assert math.isnan(report.energy_error_max) == math.isnan(report.energy_error_mean) == (
            speed < 0)
    model = gs.Model(case.system, case.parameters, [1.0], [0.0])
    over = {"start": {"q": [[0.3], [0.3]], "p": [[-40.0], [0.0]]}}
    cells = gs.sweep(model, over, scheme="G-L", stages=2, dt=0.01, steps=2)
    assert np.isnan(cells.energy_error_max).values.tolist() == [True, False]
    assert not cells.status.any()
