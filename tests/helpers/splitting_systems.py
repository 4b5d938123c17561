"""Systems that split into exact flows, with values and starts."""

from __future__ import annotations

import numpy as np
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
from gyrospark.generator.systems.system import System

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


def molecules(count, inertia, *, neighbours=3):
    """Return rigid molecules; a softened Coulomb force acts between sites of each two."""
    build, rng = gs.Multibody("molecules", gravity=(0, 0, 0)), np.random.default_rng(1)
    strength = build.parameter("k", 1.3)
    bodies = [build.body(f"w{i}", mass=1 + 0.1 * i, inertia=inertia,
                         position=2 * rng.random(3) + 2 * i, velocity=0.2 * rng.random(3),
                         angular_velocity=rng.random(3)) for i in range(count)]
    for i, body in enumerate(bodies):
        for neighbour in bodies[max(0, i - neighbours) : i]:
            sites = zip(body.point((0.3, 0.1, -0.2)), neighbour.point((0, 0, 0.3)), strict=True)
            build.potential(strength / sp.sqrt(sum((x - y)**2 for x, y in sites)
                                               + sp.Rational(1, 2)))
    return build.model()
