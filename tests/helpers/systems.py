"""The catalogue: systems that tests step, each with a start, parameters and, where known, q(t).

``case(name)`` has the numbers, ``stepper(name, scheme, stages)`` the compiled stepper, once a
session (the cache folder serves both workers, and derivation and compilation count for no case of
the budget), ``start(name, step)`` a state on the constraints, ``run(name, step, steps)`` a
trajectory. Features are read off the system.

Take G-L with 2 stages, or EMS, unless the test is about stages: each other stepper costs a second.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import mpmath
import numpy as np
import sympy as sp
from numpy.typing import NDArray

import budget
import gyrospark as gs
import lagrangians
import mechanisms
import rolling_systems
import scaled_motions
import structured_systems
import time_lagrangians
from processes import ROOT

Array = NDArray[Any]

__all__ = ["SCHEMES", "Case", "case", "differentiable", "run", "start", "stepper"]

#: The steps of a quick test: two stages, and the discrete gradient.
SCHEMES = [("G-L", 2), ("EMS", None)]

x, y, z, u, v, w, t = sp.symbols("x y z u v w t", real=True)
k, c, f, a, m, g, length, omega = sp.symbols("k c f a m g l omega", positive=True)
push, pull = sp.symbols("push pull", real=True)


@dataclass(frozen=True)
class Case:
    """A system with a start near its constraints.

    Attributes
    ----------
    options : dict
        What ``gs.stepper`` gets besides the scheme: ``system``, ``rep``, ``frame``.
    q, p : tuple of float
        A start, on the constraints to a few digits; ``start`` projects it.
    parameters : dict
        Numbers, those of inputs included.
    dt, t0 : float
        A step of moderate length, in scaled time Δτ, and where the time begins.
    exact : callable, optional
        q(t) in closed form, from ``mpmath`` or from the problem itself.
    """

    options: Mapping[str, Any]
    q: tuple[float, ...]
    p: tuple[float, ...]
    parameters: Mapping[str, Any]
    dt: float
    t0: float = 0.0
    exact: Callable[[float], Array] | None = None

    @property
    def system(self) -> Any:
        """The system, or its name."""
        return self.options.get("system", "heavy_top")

    @property
    def step(self) -> dict[str, float]:
        """The step as an argument."""
        return {"dtau" if "scaled" in self.features else "dt": self.dt}

    @property
    def features(self) -> frozenset[str]:
        """Return the features that matter to an integrator of the system."""
        system = self.system
        if isinstance(system, str):
            return frozenset({"constraints", "bodies"} | {*self.options} & {"frame"})
        system = getattr(system, "system", system)  # of a model
        present = {"constraints": system.constraints, "forces": system.forces,
                   "time": system.is_nonautonomous, "inputs": system.inputs,
                   "velocity_constraints": system.velocity_constraints,
                   "lagrangian": system.velocities and not system.velocity_constraints,
                   "bodies": system is not self.system, "quantities": system.quantities,
                   "scaled": system.time_scale is not None}
        return frozenset(name for name, entries in present.items() if entries) | (
            {*self.options} & {"frame"})


def _plane(name: str, q: Any, p: Any, parameters: Mapping[str, float], H: Any, *constraints: Any,
           order: tuple[Any, ...] = (), dt: float = 0.02, t0: float = 0.0,
           exact: Callable[[float], Array] | None = None, **more: Any) -> Case:
    """Return a case whose coordinates are the first of (x, y, z) and momenta of (u, v, w)."""
    symbols = order or tuple({str(e): e for e in (k, c, f, a, m, g, length, omega)}[key]
                             for key in parameters if key not in ("push", "pull"))
    system = gs.System((x, y, z)[:len(q)], (u, v, w)[:len(p)], symbols, H, constraints, name=name,
                       **more)
    return Case({"system": system}, tuple(q), tuple(p), parameters, dt, t0, exact)


# ---------------------------------------------------------------- bodies


def _heavy_top(rep: str = "gamma", **options: Any) -> Case:
    top = gs.problems.fast_top()
    rates = {"omega_body": 90.0} if options else {}
    return Case({"rep": rep, **options}, tuple(top.q0), tuple(top.p0),
                top.parameters | {rep: gs.gamma(top.inertia)} | rates, 2e-3)


def _free_body() -> Case:
    body = gs.problems.free_body()
    parameters = {name: value for name, value in body.parameters.items() if name != "mgl"}
    return Case({"rep": "gamma", "system": "free_body"}, tuple(body.q0), tuple(body.p0),
                parameters | {"gamma": gs.gamma(body.inertia)}, 5e-3,
                exact=lambda time: body.exact.attitude(time))


def _model(name: str, dt: float = 2e-3) -> Case:
    return _of_model(getattr(gs.models, name)(), dt)


def _of_model(model: gs.Model, dt: float) -> Case:
    return Case({"system": model}, tuple(model.q0), tuple(model.p0), model.parameters, dt)


# ---------------------------------------------------------------- without constraints


def _oscillator() -> Case:
    return _plane("oscillator", (0.8,), (-0.3,), {"k": 4.0}, u**2 / 2 + k * x**2 / 2,
                  exact=lambda time: np.array([0.8 * np.cos(2 * time) - 0.15 * np.sin(2 * time)]))


def _driven_oscillator() -> Case:
    """A driven oscillator, x'' = −k x − c x' + f cos ωt."""
    return _plane("driven_oscillator", (0.5,), (0.3,),
                  {"k": 1.3, "c": 0.2, "f": 0.7, "omega": 2.1}, u**2 / 2 + k * x**2 / 2,
                  forces=(-c * u + f * sp.cos(omega * t),), time=t, exact=_driven_motion)


def _driven_motion(time: float) -> Array:
    """Return the sum of the forced oscillation and of the one that decays."""
    stiffness, drag, force, rate = 1.3, 0.2, 0.7, 2.1
    answer = force / (stiffness - rate**2 + 1j * drag * rate)
    roots = np.roots([1, drag, stiffness])
    free = np.linalg.solve([[1, 1], roots], [0.5 - answer.real, 0.3 - (1j * rate * answer).real])
    return np.array([(free @ np.exp(roots * time) + answer * np.exp(1j * rate * time)).real])


def _kepler() -> Case:
    """Kepler's problem with eccentricity .3, from the pericentre."""
    return _plane("kepler", (0.7, 0.0), (0.0, float(np.sqrt(1.3 / 0.7))), {"k": 1.0},
                  (u**2 + v**2) / 2 - k / sp.sqrt(x**2 + y**2), dt=0.05, exact=_kepler_motion)


def _kepler_motion(time: float, e: float = 0.3) -> Array:
    """Return r = (cos E − e, √(1−e²) sin E) with E − e sin E = t."""
    E = float(mpmath.findroot(lambda E: E - e * mpmath.sin(E) - time, (time - e, time + e),
                              solver="anderson"))
    return np.array([np.cos(E) - e, np.sqrt(1 - e**2) * np.sin(E)])


def _henon_heiles() -> Case:
    return _plane("henon_heiles", (0.3, -0.2), (0.25, 0.35), {},
                  (u**2 + v**2 + x**2 + y**2) / 2 + x**2 * y - y**3 / 3, dt=0.1)


def _polar() -> Case:
    """Kepler's problem in polar coordinates: H_pq is not zero."""
    return _plane("polar", (1.0, 0.2), (0.1, 1.1), {"k": 1.0},
                  u**2 / 2 + v**2 / (2 * x**2) - k / x, dt=0.05)


# ---------------------------------------------------------------- points on constraints


def _pendulum() -> Case:
    """The model of examples/pendulum.toml, l² = x² + y², released at rest 1 rad from the lowest
    point."""
    return Case({"system": gs.load_model(ROOT / "examples" / "pendulum.toml").system},
                (np.sin(1.0), -np.cos(1.0)), (0.0, 0.0), {"m": 1.0, "g": 1.0, "l": 1.0}, 0.05,
                exact=_pendulum_motion)


def _pendulum_motion(time: float) -> Array:
    """Return q of θ = 2 asin(k sn(K − t | k²)) with k = sin(θ₀/2), g = l = 1."""
    with mpmath.workdps(30):
        modulus = mpmath.sin(mpmath.mpf(1) / 2)
        sn = mpmath.ellipfun("sn", mpmath.ellipk(modulus**2) - time, m=modulus**2)
        angle = 2 * mpmath.asin(modulus * sn)
        return np.array([float(mpmath.sin(angle)), -float(mpmath.cos(angle))])


def _ellipse() -> Case:
    """A particle in a quartic potential: neither H nor g is quadratic with a constant Hessian."""
    return _plane("ellipse", (0.9, 0.7), (0.5, 0.4), {"m": 1.1, "k": 7.0, "g": 2.0, "l": 1.4},
                  (u**2 + v**2) / (2 * m) + k * x**4 / 4 + g * y * x,
                  x**2 / length**2 + y**2 - 1, dt=0.05)


def _breathing() -> Case:
    """The particle of ``_ellipse`` on an ellipse that breathes: g depends on the time."""
    return _plane("breathing", (0.9, 0.7), (0.5, 0.4), {"m": 1.1, "k": 7.0, "g": 2.0, "l": 1.4},
                  (u**2 + v**2) / (2 * m) + k * x**4 / 4 + g * y * x,
                  x**2 / (length + sp.sin(2 * t) / 4)**2 + y**2 - 1, time=t, dt=0.05, t0=0.3)


def _relativistic() -> Case:
    """A relativistic particle on a curve: no identity of the fast path holds for its H."""
    return _plane("relativistic", (0.8, 0.77), (0.6, -0.8), {"m": 0.8, "k": 1.7},
                  sp.sqrt(m**2 + u**2 + v**2) * (1 + x**2 / 4) + k / (2 + y),
                  x**4 + y**2 - 1, order=(m, k), quantities={"floor": x})


def _driven_pendulum() -> Case:
    """A pendulum with a moving pivot, drag, a driven force, an input and a spring of the time.

    The parameters are any numbers, as in a model file, which so has the same stepper.
    """
    m, (g, length, c, a) = sp.Symbol("m", real=True, nonzero=True), sp.symbols("g l c a", real=True)
    return _plane("driven_pendulum", (0.5, -0.8), (0.3, 0.4),
                  {"m": 1.1, "g": 9.81, "l": 0.9, "c": 0.3, "a": 0.2, "push": 0.4},
                  (u**2 + v**2) / (2 * m) + m * g * y + a * sp.cos(3 * t) * x**2,
                  x**2 + (y - a * sp.sin(2 * t))**2 - length**2, time=t, inputs=(push,),
                  forces=(-c * u * v + push, -c * v + sp.sin(5 * t)), t0=0.3,
                  order=(m, g, length, c, a),
                  quantities={"along": x * sp.cos(t) + a * u - y * length})


def _dragged_pendulum() -> Case:
    """A pendulum with forces neither linear nor along the velocity, and quantities of every
    kind."""
    return _plane("dragged_pendulum", (0.6, -0.8), (0.8, 0.6),
                  {"k": 1.3, "c": 0.2, "f": 0.7, "omega": 2.1}, (u**2 + v**2) / 2 + 9 * y,
                  x**2 + y**2 - 1, time=t,
                  forces=(-c * u + f * sp.cos(omega * t), -c * v - k * x * (x * v - y * u)),
                  quantities={"height": y, "drive": f * sp.cos(omega * t), "spin": x * v - y * u,
                              "phase": sp.sin(k * t) * sp.exp(-x), "three": sp.Integer(3),
                              "ratio": f / (1 + x**2 + sp.sqrt(1 + u**2)), "rates": k**2 * omega})


def _pushed_pendulum() -> Case:
    """A pendulum with two inputs, one of which is multiplied by the other."""
    return _plane("pushed_pendulum", (0.6, -0.8), (0.4, 0.3), {"k": 2.0, "push": 0.5, "pull": -0.2},
                  (u**2 + v**2) / 2 + k * y, x**2 + y**2 - 1, inputs=(push, pull),
                  forces=(push, push * pull - u / 10))


def _two_rods() -> Case:
    """A plane double pendulum in Cartesian coordinates, beside a wall."""
    q = sp.symbols("x1 y1 x2 y2", real=True)
    p = sp.symbols("px1 py1 px2 py2", real=True)
    width = sp.Symbol("width", positive=True)
    H = sum(e**2 for e in p) / 2 + g * (q[1] + q[3])
    rods = [q[0]**2 + q[1]**2 - 1, (q[2] - q[0])**2 + (q[3] - q[1])**2 - length**2]
    A, B = 1.2, 2.0
    positions = (np.sin(A), -np.cos(A), np.sin(A) + np.sin(B), -np.cos(A) - np.cos(B))
    system = gs.System(q, p, (g, length, width), H, rods, name="two_rods", quantities={
        "gap": width - q[2], "held": q[0]**2 + q[1]**2})
    return Case({"system": system}, positions, (0.0,) * 4, {"g": 9.81, "l": 1.0, "width": 0.3},
                5e-3)


def _slider_crank() -> Case:
    q, p = mechanisms.slider_crank_at(0.9, 1.5)
    return Case({"system": mechanisms.slider_crank()}, tuple(q), tuple(p), mechanisms.GRAVITY, 5e-3)


def _andrews() -> Case:
    q, p = mechanisms.ANDREWS_START
    return Case({"system": mechanisms.andrews()}, tuple(q), tuple(p), {}, 1e-4)


# ---------------------------------------------------------------- Lagrangians, rolling


def _lagrangian() -> Case:
    """Two coupled coordinates with a mass matrix, magnetic terms, time and drag."""
    vx, vy = sp.symbols("vx vy", real=True)
    L = (m * (1 + x**2 / 3) * vx**2 / 2 + m * vy**2 / 2 + m * vx * vy * sp.cos(x - y) / 3
         + a * x * vx - m * g * y * sp.cos(x) + a * sp.cos(3 * t) * x * vy)
    system = gs.System.from_lagrangian(L, (x, y), (vx, vy), (m, g, a, c), time=t,
                                       forces=(-c * vx * vy, -c * vy), name="lagrangian")
    return Case({"system": system}, (0.5, -0.8), (0.3, 0.4),
                {"m": 1.1, "g": 9.81, "a": 0.2, "c": 0.3}, 0.02, 0.3)


def _heavy_bob() -> Case:
    """A system with a constraint and a mass matrix that depends on q."""
    vx, vy = sp.symbols("vx vy", real=True)
    L = m * (1 + x**2 / 3) * vx**2 / 2 + m * vy**2 / 2 - m * g * y
    system = gs.System.from_lagrangian(L, (x, y), (vx, vy), (m, g, length),
                                       [x**2 + y**2 - length**2], name="heavy_bob")
    return Case({"system": system}, (0.6, -0.8), (0.3, 0.4), {"m": 1.1, "g": 9.81, "l": 1.0}, 0.02)


def _shaken() -> Case:
    return Case({"system": time_lagrangians.shaken()}, (0.4,), (0.3,),
                {"w": 2.1, "a": 0.3, "b": 0.2, "g": 9.81}, 0.02)


def _bead() -> Case:
    q, velocity = lagrangians.STARTS["bead"]
    mass = lagrangians.PARAMETERS["bead"]["m"]
    return Case({"system": lagrangians.bead()}, tuple(q), tuple(mass * e for e in velocity),
                lagrangians.PARAMETERS["bead"], 0.01)


def _sleigh() -> Case:
    q, p = rolling_systems.sleigh_state(1.2, 0.7)
    return Case({"system": rolling_systems.sleigh()}, tuple(q), tuple(p), rolling_systems.SLEIGH,
                0.02)


def _skate_chain() -> Case:
    q, p = rolling_systems.SKATE_CHAIN_START
    return Case({"system": rolling_systems.skate_chain()}, tuple(q), tuple(p),
                rolling_systems.SKATE_CHAIN, 0.02)


# ---------------------------------------------------------------- scaled time


def _eccentric() -> Case:
    """Kepler's problem with eccentricity .6, in steps of equal length in ∫ r^(-3/2) dt.

    The parameter is any number, as in a model file, which so has the same stepper.
    """
    k = sp.Symbol("k", real=True)
    return _plane("eccentric", (0.4, 0.0), (0.0, 2.0), {"k": 1.0},
                  (u**2 + v**2) / 2 - k / sp.sqrt(x**2 + y**2), order=(k,), dt=0.1,
                  time_scale=gs.scales.distance((x, y), (0, 0)),
                  exact=lambda time: _kepler_motion(time, 0.6))


def _scaled_pendulum() -> Case:
    """A breathing ellipse with drag, scaled by q and t: g, F and the scale depend on the time."""
    return _plane("scaled_pendulum", (0.9, 0.7), (0.5, 0.4),
                  {"m": 1.1, "k": 7.0, "g": 2.0, "l": 1.4},
                  (u**2 + v**2) / (2 * m) + k * x**4 / 4 + g * y * x,
                  x**2 / (length + sp.sin(2 * t) / 4)**2 + y**2 - 1, time=t, dt=0.05, t0=0.3,
                  forces=(-u / 5, sp.sin(3 * t) / 5), quantities={"along": x * sp.cos(t) + y},
                  time_scale=gs.scales.rates(1, 2 * x, sp.sin(t)))


def _tethered_pair() -> Case:
    """Two masses on a rod around a centre, eccentricity .7: gravity gradient, index 3."""
    q = sp.symbols("x1 y1 x2 y2", real=True)
    p = sp.symbols("px1 py1 px2 py2", real=True)
    H = sum(e**2 for e in p) - sum(k / sp.sqrt(a**2 + b**2) for a, b in (q[:2], q[2:])) / 2
    middle = [(a + b) / 2 for a, b in zip(q[:2], q[2:], strict=True)]
    system = gs.System(q, p, (k,), H, [(q[2] - q[0])**2 + (q[3] - q[1])**2 - sp.Rational(1, 400)],
                       name="tethered_pair", time_scale=gs.scales.distance(middle, (0, 0)))
    speed = np.sqrt(1.7 / 0.3)
    return Case({"system": system}, (0.3, -0.025, 0.3, 0.025),
                (-0.05, speed / 2, 0.05, speed / 2), {"k": 1.0}, 0.1)


# ---------------------------------------------------------------- of one feature each


def _ball() -> Case:
    """A ball between a floor, or a wall that moves, and a roof, which drag may slow and one push.

    5 km away is a point, whose distance has coarse digits.
    """
    distant = sp.exp(sp.sqrt((x + 3000)**2 + 4000**2) - 5000) - sp.Rational(5, 4)
    c, a, omega = sp.symbols("c a omega", real=True)
    return _plane("ball", (1.0,), (0.0,), {"m": 1.0, "g": 9.81, "c": 0.0, "a": 0.0, "omega": 1.0,
                                           "push": 0.0}, u**2 / (2 * m) + m * g * x,
                  order=(m, g, c, a, omega), forces=(push - c * u,), time=t, inputs=(push,),
                  quantities={"floor": x, "wall": x - a * sp.sin(omega * t), "roof": 1 - x,
                              "speed": u / m, "far": distant}, dt=0.01)


def _swing() -> Case:
    """A pendulum by its angle, without a parameter."""
    return _plane("swing", (0.3,), (0.0,), {}, u**2 / 2 + 9 * (1 - sp.cos(x)), dt=0.01)


def _logarithm() -> Case:
    """A motion that goes on at x < 0, where H is no number; its parameter is named as the step."""
    strength = sp.Symbol("dt", real=True)
    return _plane("logarithm", (1.0,), (0.0,), {"dt": 1.0}, u**2 / 2 + strength * sp.log(x),
                  order=(strength,), dt=0.01)


def _tilted() -> Case:
    """A pendulum by its angle, in a field that leans, with a stop at −½."""
    return _plane("tilted", (2.9,), (0.0,), {}, u**2 / 2 - sp.sin(x) - sp.cos(x) / 2, dt=0.02,
                  quantities={"stop": x + sp.Rational(1, 2)})


def _beam() -> Case:
    """Two free segments of a beam that stretches and shears, which move apart."""
    build = gs.Multibody("beams", gravity=(0, 0, 0))
    build.beam("rod", count=2, start=(0, 0, 0), end=(1, 0, 0), mass=1.0, bending=1.0,
               twisting=1.0, damping=0.0, stretching=7.0, shearing=7.0)
    model, p = build.model(), np.zeros(14)
    p[4:7], p[11:14] = (0.1, 0.2, -0.1), (-0.2, -0.2, 0.3)
    return Case({"system": model}, tuple(model.q0), tuple(p), model.parameters, 1e-4)


def _arm() -> Case:
    """Two rods with hinges about y, turned by motors; products of inertia move nothing in a plane.
    """
    build = gs.Multibody("arm", gravity=(0, 0, -9.81))
    above: Any = "ground"
    for k, (angle, rate, drive) in enumerate([(0.4, 1.3, 0.2), (0.9, -0.7, -0.1)]):
        across = 0.02 + 0.01 * k
        rod = build.body(f"rod{k}", mass=1.5 - 0.5 * k, position=(0, 0, -0.25 - 0.5 * k),
                         inertia=[[across, 0, 0.002], [0, across, 0], [0.002, 0, 0.003]])
        joint = build.revolute(f"hinge{k}", above, rod, at=(0, 0, -0.5 * k), axis=(0, 1, 0),
                               angle=angle, rate=rate)
        build.motor(f"motor{k}", joint, torque=(2 + k) * build.input(f"u{k}", drive))
        build.quantity(f"turn{k}", build.angle(joint))
        build.quantity(f"speed{k}", build.rate(joint))
        above = rod
    return _of_model(build.model(), 5e-3)


def _tied() -> Case:
    """A leaning top on a spring, and two bodies that circle on a rod, without gravity."""
    build = gs.Multibody("tied", gravity=(0, 0, 0))
    tensor = np.array([[0.5, 0.05, 0.02], [0.05, 0.6, 0.01], [0.02, 0.01, 0.4]])
    c = np.array([0.1, 0, 0.3])
    build.top("a", mass=2.5, inertia=tensor + 2.5 * (c @ c * np.eye(3) - np.outer(c, c)),
              centre=c, at=(1, 2, 3), angular_velocity=(0, 0, 1), rep="alpha")
    build.body("b", mass=0.5, inertia=(0.1, 0.1, 0.1), position=(-1, 0, 0), velocity=(0, -3, 0))
    build.body("c", mass=0.5, inertia=(0.3, 0.4, 0.5), position=(1, 0, 0), velocity=(0, 3, 0),
               angular_velocity=(1, 2, 3))
    build.rod("rod", "b", "c")
    build.spring("spring", "a", "ground", stiffness=20.0, on_a=c, on_b=(0, 1, 0))
    return _of_model(build.model(), 5e-3)


def _eccentric_satellite() -> Case:
    """A body of mass 1/100 on an orbit of eccentricity .7, under gravity gradient; |Q| = 1."""
    position, velocity = sp.symbols("x y z u v w", real=True)[:3], (u, v, w)
    Q, P = sp.symbols("q0:4", real=True), sp.symbols("p0:4", real=True)
    inertia, mass = (sp.Rational(13, 10), 1, sp.Rational(7, 10)), sp.Rational(1, 100)
    L = sp.Matrix([[-Q[1], -Q[2], -Q[3]], [Q[0], -Q[3], Q[2]], [Q[3], Q[0], -Q[1]],
                   [-Q[2], Q[1], Q[0]]])
    R = sp.Matrix([[1 - 2 * (Q[2]**2 + Q[3]**2), 2 * (Q[1]*Q[2] - Q[0]*Q[3]),
                    2 * (Q[1]*Q[3] + Q[0]*Q[2])],
                   [2 * (Q[1]*Q[2] + Q[0]*Q[3]), 1 - 2 * (Q[1]**2 + Q[3]**2),
                    2 * (Q[2]*Q[3] - Q[0]*Q[1])],
                   [2 * (Q[1]*Q[3] - Q[0]*Q[2]), 2 * (Q[2]*Q[3] + Q[0]*Q[1]),
                    1 - 2 * (Q[1]**2 + Q[2]**2)]])
    r = sp.sqrt(sum(e**2 for e in position))
    m, n = L.T * sp.Matrix(P) / 2, R.T * sp.Matrix(position)
    H = (sum(e**2 for e in velocity) / 2 - 1 / r
         + (sum(m[i]**2 / (2 * inertia[i]) for i in range(3))
            + sum(a * b for a, b in zip(Q, P, strict=True))**2 / 8) / mass
         + mass * sp.Rational(3, 2) * sum(inertia[i] * n[i]**2 for i in range(3)) / r**5)
    system = gs.System([*position, *Q], [*velocity, *P], (), H, [sum(e**2 for e in Q) - 1],
                       name="eccentric_satellite",
                       time_scale=gs.scales.rates(r**sp.Rational(-3, 2), 2))
    start, _ = scaled_motions.states("eccentric_satellite")
    return Case({"system": system}, *map(tuple, start.astype(float).reshape(2, 7)), {}, 0.1)


def _very_eccentric() -> Case:
    """Kepler's problem with eccentricity .9, from the pericentre."""
    return Case(_eccentric().options, (0.1, 0.0), (0.0, float(np.sqrt(19))), {"k": 1.0}, 0.1,
                exact=lambda time: _kepler_motion(time, 0.9))


def _beads() -> Case:
    """Four beads on rods: sums over element templates."""
    positions = np.cumsum([[np.cos(a), -np.sin(a)] for a in (0.6, 1.1, 0.3, 0.9)], axis=0).ravel()
    return Case({"system": structured_systems.beads(4)}, tuple(positions), (0.3,) * 8,
                structured_systems.BEADS, 0.02, 0.4)


_CASES: dict[str, Callable[[], Case]] = {
    "heavy_top": _heavy_top,
    "heavy_top_alpha": lambda: _heavy_top("alpha"),
    "heavy_top_in_frame": lambda: _heavy_top(frame="symmetries"),
    "free_body": _free_body,
    "double_top": lambda: _model("double_top"),
    "four_bar": lambda: _model("four_bar"),
    "satellite": lambda: _model("satellite", 0.05),
    "gimbal": lambda: _model("gimbal"),
    "oscillator": _oscillator,
    "driven_oscillator": _driven_oscillator,
    "kepler": _kepler,
    "henon_heiles": _henon_heiles,
    "polar": _polar,
    "pendulum": _pendulum,
    "ellipse": _ellipse,
    "breathing": _breathing,
    "relativistic": _relativistic,
    "driven_pendulum": _driven_pendulum,
    "dragged_pendulum": _dragged_pendulum,
    "pushed_pendulum": _pushed_pendulum,
    "two_rods": _two_rods,
    "slider_crank": _slider_crank,
    "andrews": _andrews,
    "lagrangian": _lagrangian,
    "heavy_bob": _heavy_bob,
    "shaken": _shaken,
    "bead": _bead,
    "sleigh": _sleigh,
    "skate_chain": _skate_chain,
    "eccentric": _eccentric,
    "scaled_pendulum": _scaled_pendulum,
    "tethered_pair": _tethered_pair,
    # which single tests take
    "arm": _arm, "ball": _ball, "beads": _beads, "beam": _beam, "logarithm": _logarithm,
    "eccentric_satellite": _eccentric_satellite, "swing": _swing, "tied": _tied,
    "tilted": _tilted, "very_eccentric": _very_eccentric,
}


@cache
def case(name: str) -> Case:
    """Return a case by its name."""
    with budget.shared():
        return _CASES[name]()


@cache
def stepper(name: str, scheme: str = "G-L", stages: int | None = None, real: str = "double",
            **options: Any) -> gs.Stepper:
    """Return a stepper of a case; two stages of G-L by default. Its cost is no test's."""
    if stages is None and scheme in ("G-L", "LIIIA-B", "Radau-L"):
        stages = 2
    with budget.shared():
        return gs.stepper(scheme, stages, real=real, **case(name).options, **options)


@cache
def differentiable(name: str, scheme: str = "G-L", stages: int | None = None,
                   real: str = "double") -> gs.Stepper:
    """Return the same stepper, its derivatives compiled too."""
    step = stepper(name, scheme, stages, real)
    with budget.shared():
        step._derivative_binding()  # derives and compiles
    return step


def start(name: str, step: gs.Stepper) -> tuple[Array, Array]:
    """Return the case's start, projected on constraints and hidden constraints."""
    entry = case(name)
    state = step.consistent(entry.q, entry.p, parameters=entry.parameters, t=entry.t0)
    return state.q, state.p


def timed_start(name: str, step: gs.Stepper) -> gs.Start:
    """Return the case's start at its time, without parameters."""
    return gs.Start(*start(name, step), t=case(name).t0)


def run(name: str, step: gs.Stepper, steps: int, t: Any = None, **more: Any) -> gs.Trajectory:
    """Integrate from the case's start; ``more`` overrides dt and parameters."""
    entry = case(name)
    begin = timed_start(name, step) if t is None else gs.Start(*start(name, step), t=t)
    return step.integrate(begin, steps=steps, **(
        entry.step | {"parameters": entry.parameters} | more))
