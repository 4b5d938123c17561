"""Systems whose Jacobian is sparse, in forms and dense: a sling of bodies, beads on rods."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import sympy as sp

import budget
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


BEADS = {"k": 1.3, "c": 0.2, "f": 0.7, "omega": 2.1}


def beads(links: int = 2) -> System:
    """Return beads on rods whose mass depends on place, on a pivot and in a field that time moves.

    There are dampers between them, and a drive at the end.
    """
    q = sp.symbols(f"x0:{2 * links}", real=True)
    p = sp.symbols(f"y0:{2 * links}", real=True)
    k, c, f, omega = sp.symbols("k c f omega", positive=True)
    t = sp.Symbol("t", real=True)
    points = [(0, f * sp.sin(omega * t) / 5), *zip(q[::2], q[1::2], strict=True)]
    rods = [(b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 - 1 for a, b in pairwise(points)]
    H = sum(a**2 for a in p) / 2 + 9 * sum(q[1::2])
    H += sum(x**2 * (v**2 / 8 + f * sp.cos(t)) for x, v in zip(q[::2], p[1::2], strict=True))
    forces = [-k * a for a in p]
    for i in range(2 * links - 2):
        pull = c * (p[i + 2] - p[i]) * (1 + q[i] * q[i + 2] / 5)
        forces[i], forces[i + 2] = forces[i] + pull, forces[i + 2] - pull
    forces[-2] += f * sp.sin(omega * t) * q[-1]
    return System(q, p, (k, c, f, omega), H, rods, forces=forces, time=t, name="beads")


def start_of_beads(step: Stepper, t0: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a state of two beads on the constraints."""
    return step.project([0.6, -0.8, 1.4, -1.4], [0.8, 0.6] * 2, parameters=BEADS, t=t0)


@cache
def made_beads(scheme: str, stages: int | None, structured: bool, real: str = "double"):
    """Return a stepper of two beads, in forms or dense."""
    with budget.shared():
        source = generate(Spec.checked(scheme, stages, None, None, real), system=beads(),
                          structured=structured).source
        return Stepper(source.name, source.files())
