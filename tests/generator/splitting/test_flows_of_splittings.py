"""Steps of a splitting solve the equations of motion of its system, to their order."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.generator.multibody.rigid_body import (
    body_system,
    gamma,
    gravity_potential,
    heavy_top,
    kinetic_energy,
    left_matrix,
    mgl,
    moments,
    p,
    q,
    rotation_matrix,
)
from gyrospark.generator.splitting.find import split
from gyrospark.generator.systems.system import System
from splitting_flows import Flows, motion

TOP = {"I1": 1.0, "I2": 1.0, "I3": 0.4, "mgl": 1.3, "gamma": 0.7, "alpha": 0.7}
ASYMMETRIC = TOP | {"I2": 1.4}
UNIT = (sum(x**2 for x in q) - 1,)
k, c1, c2, c3 = sp.symbols("k c1 c2 c3", real=True)


def start(omega, values, linear=(0, 0, 0)):
    """Return q, p of a body with an angular velocity in body axes."""
    q0 = np.array([0.8, 0.4, -0.2, 0.1])
    q0 /= np.linalg.norm(q0)
    m = np.array([values[f"I{i}"] * w for i, w in zip((1, 2, 3), omega, strict=True)])
    lifted = np.array(left_matrix(q0), float)
    return q0, 2 * lifted.T @ (m + np.array(linear))


def drag():
    torque = [-k * e / 2 for e in left_matrix(q) * sp.Matrix(p)]
    return body_system("drag", "gamma", gravity_potential(), (mgl, k), torque=torque)


def driven():
    t = gs.symbols.t
    torque = [k * sp.cos(t), 0, -k * gs.symbols.omega[2]]
    return body_system("driven", "gamma", gravity_potential() * (1 + sp.sin(t) / 2), (mgl, k),
                       torque=torque)


def gyrostat():
    m = left_matrix(q) * sp.Matrix(p) / 2
    linear = c1 * m[0] + c2 * m[1] + c3 * m[2]
    return System(q, p, (*moments, gamma, mgl, c1, c2, c3), kinetic_energy("gamma") + linear
                  + mgl * rotation_matrix(q)[2, 0], UNIT, name="gyrostat")


SYSTEMS = {
    "gamma": (heavy_top("gamma"), TOP, True),
    "alpha": (heavy_top("alpha"), TOP, True),
    "asymmetric": (heavy_top("gamma"), ASYMMETRIC, False),
    "drag": (drag(), TOP | {"k": 0.3}, True),
    "driven": (driven(), TOP | {"k": 0.3}, True),
    "gyrostat": (gyrostat(), ASYMMETRIC | {"c1": 0.4, "c2": -0.3, "c3": 0.7}, False),
}


def error(flows, step, q0, p0, exact, t_end, steps):
    """Return the difference to the exact state after so many steps."""
    x = flows.start(q0, p0)
    for _ in range(steps):
        step(x, t_end / steps)
    assert x.t == pytest.approx(t_end)
    return max(np.abs(x.q - exact[0]).max(), np.abs(flows.momenta(x) - exact[1]).max())


@pytest.mark.parametrize("name", SYSTEMS)
def test_symmetric_steps_have_order_two(name):
    system, values, symmetric = SYSTEMS[name]
    splitting = split(system, symmetric=symmetric)
    flows = Flows(splitting, values)
    q0, p0 = start((0.3, -0.5, 1.2), values)
    exact = motion(system, values, q0, p0, 0.5, 200)
    coarse, fine = (error(flows, flows.strang, q0, p0, exact, 0.5, n) for n in (20, 40))
    assert splitting.other_forces is (name == "driven")
    assert coarse < 1e-3
    assert 3.8 < coarse / fine < 4.2


@pytest.mark.parametrize("name", ["gamma", "drag"])
def test_force_gradients_give_order_four(name):
    system, values, _ = SYSTEMS[name]
    flows = Flows(split(system, symmetric=True), values)
    q0, p0 = start((0.3, -0.5, 1.2), values)
    exact = motion(system, values, q0, p0, 1.0, 1000)
    coarse, fine = (error(flows, flows.forward4, q0, p0, exact, 1.0, n) for n in (8, 16))
    assert coarse < 1e-5
    assert 14 < coarse / fine < 18
