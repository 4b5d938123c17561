"""EMS of Lagrangians: H's exact difference from the velocities of both ends, M⁻¹ never in symbols.

    ΔH = v̄·Δp − DΛ·(Δq, Δt),   Λ = ½ v₀ᵀM v₁ + bᵀv̄ − V

That is an identity between any two states, so residuals at random unknowns must show it, not only
steps: D_p and D_q are read out of them, and H comes from its own function.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from gyrospark.generator.schemes.lagrangian_midpoint import LagrangianEMS
from gyrospark.generator.schemes.midpoint_conditions import check_mean_scheme
from lagrangians import PARAMETERS, bead, case, double
from mechanics_systems import joints
from strategies import EPS
from time_lagrangians import lifted, one, shaken, start_of_lifted, swelling, wire


def kinked():
    """A particle on a V-shaped floor, of a mass that is more on the right."""
    x, v, _ = one("x")
    return gs.System.from_lagrangian((2 + sp.tanh(x)) * v**2 / 2 - sp.Abs(x), [x], [v], [],
                                     name="kinked")


@cache
def stepper(make):
    return systems.stepper("bead", "EMS") if make is bead else gs.stepper("EMS", system=make())


def began(make, t0=0.3):
    """Return a stepper of EMS, a start on the constraints and the parameters."""
    step = stepper(make)
    if make is lifted:
        return step, *start_of_lifted(step, t0), PARAMETERS["bead"]
    _, parameters, q, v = case(make)
    return step, q, step.momenta(q, v, parameters=parameters), parameters


@pytest.mark.parametrize("make", [double, bead, lambda: shaken()[0], swelling, wire, kinked],
                         ids=["double", "bead", "shaken", "swelling", "wire", "kinked"])
def test_laws_are_identities(make):
    lines = {line.name: line for line in check_mean_scheme(LagrangianEMS(make(), discrete=True))}
    for law in ("consistent", "symmetric", "order", "energy", "constraint work"):
        assert lines[law].holds, lines[law]


def test_a_wrong_difference_is_refuted():
    """The balance can fail: with L at the mean velocity alone it lacks ½ δᵀM δ."""
    class Without(LagrangianEMS):
        @property
        def between(self):
            there = dict(zip(self.system.velocities, self.mean_velocity, strict=True))
            return self.system.L.subs(there)

    assert not Without(double(), discrete=True).balance().holds


def test_a_long_lagrangian_is_differenced_through_its_shared_parts():
    system = gs.from_mechanics(joints(3), name="arm")
    assert system.is_long
    scheme = LagrangianEMS(system, discrete=True)
    assert scheme.balance().holds
    assert scheme.consistency().holds
    assert scheme.symmetry().holds


# ---------------------------------------------------------------- between any two states


@pytest.mark.parametrize("seed", range(3))
def test_the_difference_of_h_between_any_two_states(seed):
    """Residuals of the free double pendulum are Δq/Δt − D_p and Δp/Δt + D_q."""
    step, q, p, parameters = began(double)
    rng, dt = np.random.default_rng(seed), 0.25
    end = np.concatenate([q, p]) + rng.standard_normal(4) * 10.0 ** -seed
    dq, dp = end[:2] - q, end[2:] - p
    r = step.residual(end, q, p, dt=dt, parameters=parameters)
    D_p, D_q = dq / dt - r[:2], r[2:4] - dp / dt
    gained = step.energy(end[:2], end[2:], parameters=parameters) - step.energy(
        q, p, parameters=parameters)
    assert abs(D_p @ dp + D_q @ dq - gained) <= 64 * EPS * (abs(gained) + 20)
    v0, v1 = (step.velocities(x[:2], x[2:], parameters=parameters)
              for x in (np.concatenate([q, p]), end))
    np.testing.assert_allclose(D_p, (v0 + v1) / 2, rtol=0, atol=64 * EPS)


# ---------------------------------------------------------------- steps


@pytest.mark.parametrize("make", [double, bead, lifted])
@pytest.mark.parametrize("solver", ["auto", "newton"])
def test_energy_balances_to_rounding(make, solver):
    """H_k − H_0 − W_k, with the work of forces and drives; g = 0 as ever."""
    step, q, p, parameters = began(make)
    run = step.integrate(q, p, dt=0.01, steps=300, parameters=parameters, t0=0.3, solver=solver)
    size = np.abs(run.energies).max() + np.abs(run.work).max()
    assert run.report.energy_error_max <= 300 * EPS * size
    assert run.report.constraint_max <= 4 * EPS
    if make is not double:
        assert np.abs(run.work).max() > 0.01 * size
    if make is bead:
        force = (run.work[1:] - run.work[:-1])
        v = np.diff(run.q, axis=0) / 0.01
        q_mean, k, now = (run.q[1:] + run.q[:-1]) / 2, parameters["k"], run.t[:-1] + 0.005
        F = [-k * v[:, 0] * q_mean[:, 1]**2, -k * v[:, 1],
             parameters["a"] * np.cos(now) - k * v[:, 2]]
        np.testing.assert_allclose(force, np.sum(np.transpose(F) * v, axis=1) * 0.01, rtol=0,
                                   atol=64 * EPS * size)


def test_a_cyclic_coordinate_keeps_its_momentum():
    step, q, p, parameters = began(bead)
    run = step.integrate(q, p, dt=0.02, steps=200, parameters=parameters | {"k": 0, "a": 0})
    assert np.ptp(run.p[:, 2]) <= 200 * EPS * abs(p[2])
    assert np.ptp(run.energies) <= 200 * EPS * np.abs(run.energies).max()


def test_order_two_on_a_mass_that_grows():
    """Where IMS has the midpoint of e^(2ct), EMS has what makes the balance exact."""
    step, errors = stepper(swelling), []
    numbers = {"c": 0.6, "k": 1.0}
    for steps in (20, 40, 80):
        run = step.integrate([1.0], [0.0], dt=2 / steps, steps=steps, parameters=numbers)
        x = np.exp(-0.6 * run.t) * (np.cos(0.8 * run.t) + 0.75 * np.sin(0.8 * run.t))
        errors.append(np.abs(run.q[:, 0] - x).max())
        assert run.report.energy_error_max <= 64 * EPS
    assert all(abs(np.log2(a / b) - 2) < 0.05 for a, b in pairwise(errors)), errors


def test_a_floor_with_an_edge_costs_no_energy():
    step = stepper(kinked)
    run = step.integrate([0.3], [1.0], dt=0.05, steps=400, parameters={})
    assert np.count_nonzero(np.diff(np.sign(run.q[:, 0]))) > 5
    assert np.ptp(run.energies) <= 400 * EPS


@pytest.mark.slow  # the bead of another file has wide numbers
def test_wide_numbers_balance_to_their_rounding():
    step = gs.stepper("EMS", system=double(), real="float128")
    _, parameters, q, v = case(double)
    p = step.momenta(q, v, parameters=parameters)
    run = step.integrate(q, p, dt=0.01, steps=20, parameters=parameters)
    assert float(run.report.energy_error_max) <= 100 * 2.0**-112 * 20
