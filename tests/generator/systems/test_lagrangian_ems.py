"""EMS of Lagrangians: H's exact difference from the velocities of both ends, M⁻¹ never in symbols.

    ΔH = v̄·Δp − DΛ·(Δq, Δt),   Λ = ½ v₀ᵀM v₁ + bᵀv̄ − V
"""

import numpy as np
import pytest

import gyrospark as gs
import systems
from gyrospark.certificates.midpoint_conditions import check_mean_scheme
from gyrospark.generator.schemes.lagrangian_midpoint import LagrangianEMS
from lagrangians import PARAMETERS, bead, double
from mechanics_systems import joints
from strategies import EPS
from time_lagrangians import kinked, shaken, swelling, wire


@pytest.mark.parametrize("make", [double, bead, shaken, swelling, wire, kinked],
                         ids=["double", "bead", "shaken", "swelling", "wire", "kinked"])
def test_laws_are_identities(make):
    lines = {line.name: line for line in check_mean_scheme(LagrangianEMS(make(), discrete=True))}
    for law in ("consistent", "symmetric", "order", "energy", "constraint work"):
        assert lines[law].holds, lines[law]


def test_a_wrong_difference_is_refuted():
    """The balance fails with L at the mean velocity alone, which lacks ½ δᵀM δ."""
    class Without(LagrangianEMS):
        @property
        def discrete_lagrangian(self):
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


def test_work_is_that_of_the_forces_at_the_mean():
    step, parameters = systems.stepper("bead", "EMS"), PARAMETERS["bead"]
    run = systems.run("bead", step, 300, t=0.3)
    v, dt = np.diff(run.q, axis=0) / 0.01, 0.01
    q_mean, k, now = (run.q[1:] + run.q[:-1]) / 2, parameters["k"], run.t[:-1] + dt / 2
    F = [-k * v[:, 0] * q_mean[:, 1]**2, -k * v[:, 1], parameters["a"] * np.cos(now) - k * v[:, 2]]
    size = np.abs(run.energies).max() + np.abs(run.work).max()
    np.testing.assert_allclose(np.diff(run.work), np.sum(np.transpose(F) * v, axis=1) * dt, rtol=0,
                               atol=64 * EPS * size)
