"""Relative equilibria: systems, parameters, starts and rates of their steady rotation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from math import cos, pi, sin

import mpmath as mp
import numpy as np
import sympy as sp

import gyrospark as gs
from gyrospark.core.inertia import quaternion_product
from gyrospark.generator.multibody.models import turn
from gyrospark.runtime.rigid_body.quaternion import rotation_matrix

E1, E2, E3 = np.eye(3)


@dataclass(frozen=True)
class Steady:
    """A start, and what turns: everything about ``about``, each body about its own third axis.

    ``blocks`` are the sizes of its blocks of coordinates, 4 for a quaternion and 3 for a point.
    """

    system: object
    q: np.ndarray
    p: np.ndarray
    parameters: Mapping[str, float]
    dt: float
    spins: tuple[float, ...] = ()
    about: np.ndarray = field(default_factory=lambda: np.zeros(3))
    blocks: tuple[int, ...] = (4,)
    rep: Mapping[str, str] = field(default_factory=dict)

    def at(self, t: float) -> np.ndarray:
        """Return q(t) in closed form."""
        rate = np.linalg.norm(self.about)
        axis = self.about / (rate or 1.0)
        space, spins, parts = turn(axis, rate * t), iter(self.spins), []
        for block in np.split(self.q, np.cumsum(self.blocks)[:-1]):
            if len(block) == 4:
                parts.append(quaternion_product(space, block, turn(E3, next(spins, 0.0) * t)))
            else:
                along, across = axis * (axis @ block), np.cross(axis, block)
                parts.append(along + cos(rate * t) * (block - along) + sin(rate * t) * across)
        return np.concatenate(parts)

    def error(self, run) -> float:
        """Return the largest error of q at the end."""
        return float(abs(run.q[-1] - self.at(run.t[-1])).max())


def of_model(model, dt, **more) -> Steady:
    """Return a steady motion of the start of a model, γ_m in all bodies."""
    gammas = {name: gs.gamma(inertia) for name, inertia in model.bodies.items()}
    numbers = {name: float(x) for name, x in model.parameters.items()} | gammas
    return Steady(model, model.q0, model.p0, numbers, dt, **more)


def sleeping_top() -> Steady:
    """An upright top, 1.25 rad a step: both axes are one, and either rate would do."""
    top, spin = gs.problems.fast_top(), 125.0
    q = np.array([1.0, 0, 0, 0])
    numbers = top.parameters | {"gamma": gs.gamma(top.inertia)}
    p = gs.Start.of_body(q, spin * E3, top.inertia).p
    return Steady("heavy_top", q, p, numbers, 1e-2, (spin,), rep={"rep": "gamma"})


def free_body() -> Steady:
    """A symmetric free body: |l|/I₁ about l, and (1/I₃ − 1/I₁) l₃ about the body's own axis."""
    body, I1, I3 = gs.problems.free_body(), 0.002, 0.0008
    q, omega = body.q0, np.array([20.0, 0.0, 100.0])
    l_of_body = np.array([I1, I1, I3]) * omega
    rotation = rotation_matrix(q)
    numbers = {"I1": I1, "I2": I1, "I3": I3, "gamma": gs.gamma((I1, I1, I3))}
    return Steady("free_body", q, gs.Start.of_body(q, omega, (I1, I1, I3)).p, numbers, 1e-2,
                  ((1 / I3 - 1 / I1) * l_of_body[2],), rotation @ l_of_body / I1,
                  rep={"rep": "gamma"})


def satellite() -> Steady:
    """A symmetric satellite whose axis is normal to the orbit: in orbit axes it turns at s − n.

    H of the model equals H of inertial axes less n l_y: a satellite at rest in orbit axes stands
    still without a frame, and only the satellite's own axis remains to be determined.
    """
    model = gs.models.satellite()
    n, I1, I3 = model.parameters["n"], 30.0, 40.0
    q, s = turn(E1, -pi / 2), 10 * model.parameters["n"]  # e3 of the body → e2
    steady = of_model(model, 0.1 / n, spins=(s - n,))
    moments = {"a_I1": I1, "a_I2": I1, "a_I3": I3, "a_gamma": gs.gamma((I1, I1, I3))}
    return Steady(steady.system, q, gs.Start.of_body(q, s * E3, (I1, I1, I3)).p,
                  {**steady.parameters, **moments}, steady.dt, steady.spins)


def orbiting() -> Steady:
    """A body on a circular orbit that turns as it goes round, its long axis towards the centre.

    V = −μm/r − μ (tr J − 3 u·Ju)/(2r³):  m n² r = μm/r² + 3μ (I₂ + I₃ − 2I₁)/(2r⁴).
    """
    J, mu = np.array([0.01, 0.03, 0.035]), 1.0
    n = np.sqrt(mu + 1.5 * mu * (J[1] + J[2] - 2 * J[0]))
    build = gs.Multibody("orbiting", gravity=(0, 0, 0))
    body = build.body("a", mass=1.0, inertia=J, position=E1, velocity=n * E2,
                      angular_velocity=n * E3)
    k, x = build.parameter("mu", mu), sp.Matrix(body.x)
    r, inward = sp.sqrt(x.dot(x)), body.rotation.T * x
    twist = sum(moment * u**2 for moment, u in zip(body.inertia, inward, strict=True)) / r**2
    build.potential(-k * body.mass / r - k * (sum(body.inertia) - 3 * twist) / (2 * r**3))
    return of_model(build.model(), 0.3, about=n * E3, blocks=(4, 3))


def turning_chain() -> Steady:
    """Three symmetric rods, bent in a plane that turns about the vertical, each on its own axis.

    Their angles are where V − T of the rates is stationary.
    """
    rods, m, half, g, I1, I3 = 3, 0.2, 0.15, 9.81, 0.0017, 0.0002
    rate, spins = 5.0, (30.0, 40.0, 50.0)

    def places(angles, sin, cos):
        """Return (x, z) of the rods' centres, from the top."""
        tips = [[-2 * half * f(a) for a in angles] for f in (sin, cos)]
        return [tuple(sum(tip[:i]) + tip[i] / 2 for tip in tips) for i in range(rods)]

    a = sp.symbols("a0:3")
    amended = sum(m * g * z - m * rate**2 * x**2 / 2 - I1 * rate**2 * sp.sin(t)**2 / 2
                  - I3 * (rate * sp.cos(t) + s)**2 / 2
                  for t, s, (x, z) in zip(a, spins, places(a, sp.sin, sp.cos), strict=True))
    slopes = sp.lambdify(a, [sp.diff(amended, t) for t in a], "mpmath")
    with mp.workdps(30):
        angles = [float(t) for t in mp.findroot(lambda *t: slopes(*t), (0.9, 1.0, 1.1))]
    q, p = [], []
    for angle, s, (x, z) in zip(angles, spins, places(angles, sin, cos), strict=True):
        attitude, moments = turn(E2, angle), (I1, I1, I3)
        omega = np.array([-rate * sin(angle), 0, rate * cos(angle) + s])
        q += [attitude, [x, 0, z]]
        p += [gs.Start.of_body(attitude, omega, moments).p, [0, m * rate * x, 0]]
    steady = of_model(gs.models.chain(rods), 0.02, spins=spins, about=rate * E3,
                      blocks=(4, 3) * rods)
    numbers = {**steady.parameters} | {f"b{i}_I2": I1 for i in range(rods)}
    assert max(abs(np.array(angles))) > 0.5
    return Steady(steady.system, np.concatenate(q), np.concatenate(p), numbers, steady.dt,
                  steady.spins, steady.about, steady.blocks)


@cache
def rotor():
    """A top that carries a wheel on its own axis by a hinge, in gravity."""
    build = gs.Multibody("rotor")
    body = build.top("a", mass=1.0, inertia=(0.1, 0.1, 0.05), centre=(0, 0, 0.1))
    wheel = build.body("w", mass=0.5, inertia=(0.01, 0.01, 0.02))
    build.revolute("hinge", body, wheel, axis=E3, on_a=(0, 0, 0.2), on_b=(0, 0, 0))
    return build.model()


#: Of ``rotor``: both bodies about the fixed point, across and m g l.
ACROSS, WEIGHT = 0.01 + 0.5 * 0.2**2, 9.81 * (1.0 * 0.1 + 0.5 * 0.2)


def with_wheel(q, omega, rate, body, wheel, dt, **more) -> Steady:
    """Return the rotor with attitude q and Ω of the body, the wheel at ``rate`` against it."""
    velocity = rotation_matrix(q) @ np.cross(omega, 0.2 * E3)
    p = [gs.Start.of_body(q, omega, body).p, gs.Start.of_body(q, omega + rate * E3, wheel).p,
         0.5 * velocity]
    steady = of_model(rotor(), dt)
    moments = {f"{name}_I{k}": x for name, J in (("a", body), ("w", wheel))
               for k, x in enumerate(J, 1)}
    gammas = {"a_gamma": gs.gamma(body), "w_gamma": 0.01}
    return Steady(steady.system, np.concatenate([q, q, rotation_matrix(q) @ (0.2 * E3)]),
                  np.concatenate(p), {**steady.parameters} | moments | gammas, dt,
                  blocks=(4, 4, 3), **more)


def two_on_one_axis() -> Steady:
    """Two symmetric bodies, tilted, in regular precession: (L_a + L_w) φ̇ = m g l + I φ̇² cos θ."""
    tilt, rate, fast = 0.6, 5.0, 80.0
    body, wheel = (0.1, 0.1, 0.05), (0.01, 0.01, 0.02)
    L = WEIGHT / rate + (0.1 + ACROSS) * rate * cos(tilt)
    omega = np.array([0, rate * sin(tilt), (L - wheel[2] * fast) / (body[2] + wheel[2])])
    slow = omega[2] - rate * cos(tilt)
    return with_wheel(turn(E1, tilt), omega, fast, body, wheel, 1e-2, spins=(slow, slow + fast),
                      about=rate * E3)


STEADY: dict[str, Callable[[], Steady]] = {make.__name__: cache(make) for make in (
    sleeping_top, free_body, satellite, orbiting, two_on_one_axis, turning_chain)}
