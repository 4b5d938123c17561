"""Chains of bodies whose Jacobian is sparse."""

from __future__ import annotations

from functools import cache

import numpy as np
import sympy as sp

from gyrospark.generator.multibody.rigid_body import kinetic_energy, left_matrix, rotation_matrix
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.generator.systems.system import System
from gyrospark.runtime.steppers.stepper import Stepper


def sling(*, driven: bool) -> System:
    """Return a top and a weight on a rod from its tip; with drag and a driving force.

    Small, for the sake of dense code, and yet of several forms: H_pq ≠ 0 for the top only, one
    constraint on both.
    """
    a, b = sp.symbols("q0:4", real=True), sp.symbols("p0:4", real=True)
    x, px = sp.symbols("x y z", real=True), sp.symbols("px py pz", real=True)
    inertia = sp.symbols("I1:4", positive=True)
    gamma = sp.Symbol("gamma", real=True, nonzero=True)
    mass, grav, drag = sp.symbols("m grav drag", positive=True)
    t = sp.Symbol("t", real=True)
    axis = rotation_matrix(a)[:, 2]
    H = kinetic_energy("gamma", a, b, inertia) + grav * axis[2] / 2
    H += sum(e**2 for e in px) / (2 * mass) + mass * grav * x[2]
    g = [sum(e**2 for e in a) - 1, sum((x[k] - axis[k]) ** 2 for k in range(3)) - 1]
    torque = sp.Matrix([-drag * w for w in left_matrix(a) * sp.Matrix(b)])
    forces = [*(2 * left_matrix(a).T * torque), sp.cos(3 * t) * (1 + a[0] * px[1]), -drag * px[1],
              sp.Integer(0)]
    more = {"forces": forces, "time": t} if driven else {}
    return System([*a, *x], [*b, *px], (*inertia, gamma, mass, grav, *([drag] if driven else [])),
                  H, g, name="sling", **more)


def start(driven: bool) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
    """Return a state on the constraints, and parameters."""
    q = np.array([np.cos(0.2), np.sin(0.2), 0, 0, 0, -np.sin(0.4) + 0.6, np.cos(0.4) - 0.8])
    p = np.zeros(7)
    parameters = {"I1": 0.2, "I2": 0.15, "I3": 0.1, "gamma": 0.14, "m": 0.7, "grav": 9.81}
    return q, p, parameters | ({"drag": 0.3} if driven else {})


@cache
def made(scheme: str, stages: int | None, structured: bool, driven: bool, real: str = "double"):
    found = generate(Spec.checked(scheme, stages, None, None, real), system=sling(driven=driven),
                     structured=structured)
    return Stepper(found.source.name, found.source.files())
