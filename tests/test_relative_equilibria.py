"""Relative equilibria have no error in the frame of their rates, whatever the method and the step.

Each motion is q(t) = e^{ωt} q(0), written out here by quaternions: everything turns about an axis
of space, and each body about its own. That it is a motion at all is seen by how the error of the
same method without a frame goes down with its step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from math import cos, pi, sin

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.generator.multibody.example_models import multiply, turn
from gyrospark.runtime.rigid_body.quaternion import rotation_matrix

EPS = np.finfo(float).eps
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
        """q(t) in closed form."""
        rate = np.linalg.norm(self.about)
        axis = self.about / (rate or 1.0)
        space, spins, parts = turn(axis, rate * t), iter(self.spins), []
        for block in np.split(self.q, np.cumsum(self.blocks)[:-1]):
            if len(block) == 4:
                parts.append(multiply(space, multiply(block, turn(E3, next(spins, 0.0) * t))))
            else:
                along, across = axis * (axis @ block), np.cross(axis, block)
                parts.append(along + cos(rate * t) * (block - along) + sin(rate * t) * across)
        return np.concatenate(parts)

    def error(self, run) -> float:
        """The largest error of q at the end."""
        return float(abs(run.q[-1] - self.at(run.t[-1])).max())


def of_model(model, dt, **more) -> Steady:
    """Return a steady motion of the start of a model, γ_m in all bodies."""
    gammas = {name: gs.gamma_m(inertia) for name, inertia in model.bodies.items()}
    numbers = {name: float(x) for name, x in model.parameters.items()} | gammas
    return Steady(model, model.q0, model.p0, numbers, dt, **more)


def sleeping_top() -> Steady:
    """Upright, 1.25 rad a step: both axes are one, and either rate would do."""
    top, spin = gs.problems.fast_top(), 125.0
    q = np.array([1.0, 0, 0, 0])
    numbers = top.parameters | {"gamma": gs.gamma_m(top.inertia)}
    return Steady("heavy_top", q, gs.momentum(q, spin * E3, top.inertia), numbers, 1e-2, (spin,),
                  rep={"rep": "gamma"})


def free_body() -> Steady:
    """Symmetric and free: |l|/I₁ about l, and (1/I₃ − 1/I₁) l₃ about the body's own axis."""
    body, I1, I3 = gs.problems.free_body(), 0.002, 0.0008
    q, omega = body.q0, np.array([20.0, 0.0, 100.0])
    l_of_body = np.array([I1, I1, I3]) * omega
    rotation = rotation_matrix(q)
    numbers = {"I1": I1, "I2": I1, "I3": I3, "gamma": gs.gamma_m((I1, I1, I3))}
    return Steady("free_body", q, gs.momentum(q, omega, (I1, I1, I3)), numbers, 1e-2,
                  ((1 / I3 - 1 / I1) * l_of_body[2],), rotation @ l_of_body / I1,
                  rep={"rep": "gamma"})


def satellite() -> Steady:
    """Symmetric, its axis along the normal of the orbit: in orbit axes it turns at s − n.

    H of the model is that of inertial axes less n l_y: a satellite at rest in orbit axes stands
    still without a frame, and what is left to be found is the satellite's own axis.
    """
    model = gs.models.satellite()
    n, I1, I3 = model.parameters["n"], 30.0, 40.0
    q, s = turn(E1, -pi / 2), 10 * model.parameters["n"]  # e3 of the body → e2
    made = of_model(model, 0.1 / n, spins=(s - n,))
    moments = {"a_I1": I1, "a_I2": I1, "a_I3": I3, "a_gamma": gs.gamma_m((I1, I1, I3))}
    return Steady(made.system, q, gs.momentum(q, s * E3, (I1, I1, I3)),
                  {**made.parameters, **moments}, made.dt, made.spins)


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
        """(x, z) of the rods' centres, from the top."""
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
        p += [gs.momentum(attitude, omega, moments), [0, m * rate * x, 0]]
    made = of_model(gs.models.chain(rods), 0.02, spins=spins, about=rate * E3, blocks=(4, 3) * rods)
    numbers = {**made.parameters} | {f"b{i}_I2": I1 for i in range(rods)}
    assert max(abs(np.array(angles))) > 0.5
    return Steady(made.system, np.concatenate(q), np.concatenate(p), numbers, made.dt, made.spins,
                  made.about, made.blocks)


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
    p = [gs.momentum(q, omega, body), gs.momentum(q, omega + rate * E3, wheel), 0.5 * velocity]
    made = of_model(rotor(), dt)
    moments = {f"{name}_I{k}": x for name, J in (("a", body), ("w", wheel))
               for k, x in enumerate(J, 1)}
    gammas = {"a_gamma": gs.gamma_m(body), "w_gamma": 0.01}
    return Steady(made.system, np.concatenate([q, q, rotation_matrix(q) @ (0.2 * E3)]),
                  np.concatenate(p), {**made.parameters} | moments | gammas, dt,
                  blocks=(4, 4, 3), **more)


def two_on_one_axis() -> Steady:
    """Both symmetric, tilted, in regular precession: (L_a + L_w) φ̇ = m g l + I φ̇² cos θ."""
    tilt, rate, fast = 0.6, 5.0, 80.0
    body, wheel = (0.1, 0.1, 0.05), (0.01, 0.01, 0.02)
    L = WEIGHT / rate + (0.1 + ACROSS) * rate * cos(tilt)
    omega = np.array([0, rate * sin(tilt), (L - wheel[2] * fast) / (body[2] + wheel[2])])
    slow = omega[2] - rate * cos(tilt)
    return with_wheel(turn(E1, tilt), omega, fast, body, wheel, 1e-2, spins=(slow, slow + fast),
                      about=rate * E3)


STEADY: dict[str, Callable[[], Steady]] = {make.__name__: cache(make) for make in (
    sleeping_top, free_body, satellite, orbiting, two_on_one_axis, turning_chain)}
METHODS = [("G-L", 1), ("G-L", 3), ("LIIIA-B", 2), ("LIIIA-B", 3), ("IMS", None), ("EMS", None)]


@cache
def framed(name, scheme="G-L", stages=2):
    steady = STEADY[name]()
    return gs.stepper(scheme, stages, system=steady.system, frame="symmetries", **steady.rep)


@pytest.mark.parametrize("name", STEADY)
def test_a_steady_motion_has_no_error(name):
    """Where the start's own least squares is the frame; without one the error is of the order."""
    steady, step = STEADY[name](), framed(name)
    start = {"dt": steady.dt, "steps": 400, "parameters": steady.parameters}
    plain = step.integrate(steady.q, steady.p, **start)
    run = step.integrate(steady.q, steady.p, **start | {"parameters": {
        **steady.parameters, "frame": "start"}})
    bound = allowed(steady, run)
    assert steady.error(run) < bound < 1e-3 * steady.error(plain)
    # T and V, which are rounded, may be ten times H, their sum
    assert abs(run.energy_error()).max() <= 64 * EPS * abs(run.energies).max()
    errors = [steady.error(step.integrate(
        steady.q, steady.p, dt=steady.dt / k, steps=10 * k, parameters=steady.parameters))
        for k in (4, 8)]
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.1)  # it is a motion of the system


def allowed(steady, run):
    """Rates come of numbers that are rounded: the angle of a run is off by some t ω ε."""
    rates = sum(abs(run.parameters[s]) for s in run.parameters if s.startswith("omega"))
    return 16 * EPS * (1 + run.t[-1] * rates)


@pytest.mark.slow
@pytest.mark.parametrize(("scheme", "stages"), METHODS)
@pytest.mark.parametrize("name", STEADY)
def test_a_steady_motion_has_no_error_by_any_method(name, scheme, stages):
    steady, step = STEADY[name](), framed(name, scheme, stages)
    run = step.integrate(steady.q, steady.p, dt=steady.dt, steps=1000, parameters={
        **steady.parameters, "frame": "start"})
    assert steady.error(run) < allowed(steady, run)


def test_the_satellites_frames_are_its_own_axis_and_the_orbits_where_it_is_a_ball():
    """The gradient is about the vertical, n l_y about the normal: both stay for a ball only."""
    own, normal = framed("satellite").symmetries
    assert (own.name, own.condition) == ("omega_body", "a_I1 = a_I2")
    assert (normal.name, normal.condition) == ("omega_space", "a_I1 = a_I3 and a_I1 = a_I2")


# ---------------------------------------------------------------- a rotor


#: Of the body that carries a wheel: moments, attitude, Ω; and the wheel's momentum about axis 3.
CARRIER, ATTITUDE, OMEGA, MOMENTUM = (np.array([0.1, 0.12, 0.05]), turn(E1, 0.6),
                                      np.array([0.7, -0.5, 0.4]), 0.3)


def wheelless() -> Steady:
    """The rotor as one body: the wheel's mass at rest in it, its momentum h as H − h Ω₃."""
    moments = np.array([*CARRIER[:2] + ACROSS, CARRIER[2]])
    build = gs.Multibody("wheelless")
    body = build.top("a", mass=1.5, inertia=moments, centre=(0, 0, WEIGHT / 9.81 / 1.5),
                     quaternion=ATTITUDE, angular_velocity=OMEGA + MOMENTUM / moments[2] * E3)
    build.potential(-build.parameter("h", MOMENTUM) * body.angular_velocity[2])
    return of_model(build.model(), 5e-3)


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_a_reaction_wheel_errs_as_if_it_stood_still():
    """The body feels the wheel's momentum h and moments across, not how fast it turns.

    A body of three moments in gravity, beside one that has h and no wheel at all: the same wheel's
    momentum of a heavy rim at rest, or at 1, 3 and 10 rad a step.
    """
    alone, step = wheelless(), framed("two_on_one_axis")
    exact = gs.stepper("G-L", 2, system=alone.system).integrate(
        alone.q, alone.p, dt=alone.dt / 16, steps=3200, every=16, parameters=alone.parameters).q

    def error(turn_a_step, moving=True):
        rate = turn_a_step / alone.dt
        wheel = np.array([0.01, 0.01, MOMENTUM / (rate + OMEGA[2])])
        both = with_wheel(ATTITUDE, OMEGA, rate, CARRIER, wheel, alone.dt)
        found = step.integrate(both.q, both.p, dt=alone.dt, steps=200, parameters={
            **both.parameters, "omega_w": rate if moving else 0.0}).q[:, :4]
        return float(np.sqrt(((found - exact) ** 2).sum(axis=1).mean()))

    still = error(0)
    assert [error(angle) for angle in (1, 3, 10)] == pytest.approx([still] * 3, rel=1e-2)
    assert error(1, moving=False) > 1e3 * still
    with pytest.raises(gs.StepFailed):
        error(10, moving=False)
