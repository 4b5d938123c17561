"""Laws of every scheme and system, a function each, over systems of the catalogue.

Each feature of a system is there with Gauss-Lobatto, and once with the discrete gradient where that
is derived in another way: with and without constraints, forces, time, a mass matrix, H_qp.
"""

from __future__ import annotations

import numpy as np
import pytest

import gyrospark as gs
from calls import jacobian_by_differences
from python_newton import newton_in_python
from systems import case, differentiable, run, start, stepper

EPS = np.finfo(float).eps
CLOSED = ["free_body", "oscillator", "driven_oscillator", "kepler", "pendulum", "eccentric"]
POINTS = ["driven_oscillator", "kepler", "pendulum", "ellipse", "breathing",
          "relativistic", "driven_pendulum", "dragged_pendulum", "pushed_pendulum", "two_rods",
          "lagrangian", "heavy_bob", "bead"]
#: The discrete gradient of the others is one of these.
EMS = ["pendulum", "breathing", "relativistic", "driven_pendulum", "two_rods",
       "lagrangian", "bead"]
ROLLING = ["sleigh", "skate_chain"]
SCALED = ["eccentric", "scaled_pendulum", "tethered_pair"]
PAIRS = [*((name, "G-L", 2) for name in (*POINTS, *ROLLING, *SCALED, "heavy_top", "double_top")),
         *((name, "EMS", None) for name in (*EMS, "heavy_top", "scaled_pendulum"))]
#: The symplectic schemes act on phase space without forces and without constraints on velocities.
CONSERVATIVE = ["two_rods", "heavy_top", "heavy_top_in_frame", *(  # their derivatives have others
    pytest.param(name, marks=pytest.mark.slow) for name in ("breathing", "ellipse", "heavy_bob"))]


def scales(trajectory):
    """Return the largest |q| and |p|."""
    return max(1.0, np.abs(trajectory.q).max()), max(1.0, np.abs(trajectory.p).max())


@pytest.mark.parametrize(("name", "scheme", "stages"), PAIRS)
def test_constraints_hold_to_round_off(name, scheme, stages):
    """|g(q)| of every stored state is some units in the last place of the terms of g."""
    step = stepper(name, scheme, stages)
    trajectory = run(name, step, 100)
    size = scales(trajectory)[0] ** 2
    if step.m:
        assert np.abs(trajectory.g_errors).max() <= 64 * EPS * size
    if stages and step.m:
        assert trajectory.report.momentum_constraint_max <= 64 * EPS * scales(trajectory)[1] * size


@pytest.mark.parametrize("name", EMS)
def test_energy_changes_by_the_work_of_forces_and_drives(name):
    """|H − H₀ − W| of the discrete gradient is round-off; W agrees with the report."""
    step = stepper(name, "EMS")
    trajectory = run(name, step, 100)
    size = np.abs(trajectory.energies).max() + np.abs(trajectory.work).max()
    assert trajectory.report.energy_error_max <= 300 * EPS * size
    assert np.abs(trajectory.energy_error()).max() == trajectory.report.energy_error_max
    assert trajectory.work[0] == 0
    assert trajectory.report.work == trajectory.work[-1]
    if {"forces", "time"} & case(name).features:
        assert np.abs(trajectory.work).max() > 1e-3 * size


@pytest.mark.parametrize(("name", "scheme", "stages"), PAIRS)
def test_solvers_agree(name, scheme, stages):
    """Sweeps, Newton and Python agree to 64 ε a step; EMS has the error of p by rounding g, too."""
    step = stepper(name, scheme, stages)
    trajectory = run(name, step, 6)
    q, p = scales(trajectory)
    rounding = 0 if stages or not step.m else 64 * EPS * q**2 / case(name).dt
    runs = [run(name, step, 6, solver="newton")]
    with newton_in_python():
        runs.append(run(name, step, 6, solver="newton"))
    for run_of_solver in runs:
        assert np.abs(run_of_solver.q - trajectory.q).max() <= 6 * 64 * EPS * q
        assert np.abs(run_of_solver.p - trajectory.p).max() <= 6 * 64 * EPS * p + rounding
        assert np.abs(run_of_solver.work - trajectory.work).max() <= 6 * 64 * EPS * (
            1 + np.abs(trajectory.energies).max()) + rounding


@pytest.mark.parametrize(("name", "scheme", "stages"), PAIRS)
def test_the_jacobian_is_the_derivative_of_the_residual(name, scheme, stages):
    """Central differences off the motion, where no term vanishes: h² and ε/h, both 1e-12 and more.
    """
    step, entry = stepper(name, scheme, stages), case(name)
    q, p = start(name, step)
    arguments = entry.step | {"t": entry.t0, "parameters": entry.parameters}
    draw = np.random.default_rng(5)
    x = step.guess(q, p, **arguments)
    x = x + 0.02 * draw.standard_normal(len(x)) * (1 + np.abs(x))
    J = step.jacobian(x, q, p, **arguments)
    assert np.abs(jacobian_by_differences(step, x, q, p, **arguments) - J).max() <= (
        1e-6 * np.abs(J).max())


@pytest.mark.parametrize(("name", "scheme", "stages"), [
    *((name, "G-L", 2) for name in CLOSED), ("pendulum", "EMS", None),
    pytest.param("driven_oscillator", "EMS", None, marks=pytest.mark.slow)])  # a stepper more
def test_the_closed_form_is_approached_with_the_order(name, scheme, stages):
    """Half the step has an error smaller by the factor 2^order."""
    step, entry = stepper(name, scheme, stages), case(name)
    errors = []
    for parts in (1, 2, 4):
        steps = 8 * parts
        dt = 2 * entry.dt / parts
        trajectory = run(name, step, steps, **dict.fromkeys(entry.step, dt))
        errors.append(np.abs(trajectory.q[-1] - entry.exact(trajectory.t[-1])).max())
    order = 2 * (stages or 1)
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 1e-2
    assert (slopes > order - 0.5).all() or errors[-1] < 1e-12, errors


@pytest.mark.parametrize(("name", "scheme", "stages"), PAIRS)
def test_symmetric_steps_turn_back(name, scheme, stages):
    """A run forward and back ends at its start, to the round-off that 40 steps amplify."""
    step, entry = stepper(name, scheme, stages), case(name)
    forward = run(name, step, 20)
    reversed_run = step.integrate(forward[-1], steps=20, parameters=entry.parameters,
                                  **dict.fromkeys(entry.step, -entry.dt))
    q, p = scales(forward)
    size = 1 + np.abs(forward.energies).max()
    assert abs(reversed_run.work[-1] + forward.work[-1]) <= 1e4 * EPS * size
    assert np.abs(reversed_run.q[-1] - forward.q[0]).max() <= 1e4 * EPS * q
    assert np.abs(reversed_run.p[-1] - forward.p[0]).max() <= 1e4 * EPS * p
    assert abs(reversed_run.t[-1] - entry.t0) <= 1e4 * EPS * (1 + abs(forward.t[-1]))


@pytest.mark.parametrize(("name", "stages"), [
    ("eccentric", 2), ("tethered_pair", 2), *(
        pytest.param("eccentric", s, marks=pytest.mark.slow) for s in (1, 3))])  # of odd stages
def test_turned_momenta_lead_back_in_scaled_time(name, stages):
    """Runs from −p at the end, with the run's H + e, return to its start; also in lanes."""
    step, options = stepper(name, "G-L", stages), case(name).step
    forward = run(name, step, 30)
    turned = forward[-1].replace(p=-forward[-1].p)
    size = 1e4 * EPS * max(scales(forward))
    single = step.integrate(turned, steps=30, **options)
    lanes = step.integrate_ensemble([turned, step.start(turned, **options).start], steps=30,
                                    **options).members
    for reversed_run in (single, *lanes):
        assert np.abs(reversed_run.q[-1] - forward.q[0]).max() <= size
        assert np.abs(reversed_run.p[-1] + forward.p[0]).max() <= size
        assert abs(reversed_run.t[-1] - 2 * forward.t[-1]) <= size
    assert forward.report.energy_error_max > 1e3 * EPS


@pytest.mark.parametrize("name", CONSERVATIVE)
def test_gauss_lobatto_is_symplectic_on_the_constraints(name):
    """MᵀJM = J holds on T(T*Q), with M from exact tangents."""
    step, entry = differentiable(name), case(name)
    q, p = start(name, step)
    trajectory = step.integrate(gs.Start(q, p, t=entry.t0), dt=entry.dt, steps=3,
                                parameters=entry.parameters, tangents=gs.Tangents(start="all"))
    basis = trajectory.tangents.start
    M = np.concatenate([trajectory.tangents.q[-1], trajectory.tangents.p[-1]])
    n = step.n
    J = np.block([[np.zeros((n, n)), np.eye(n)], [-np.eye(n), np.zeros((n, n))]])
    area, mapped = basis.T @ J @ basis, M.T @ J @ M
    assert np.abs(mapped - area).max() <= 500 * EPS * np.abs(M).max() ** 2
