"""Systems whose steps are differentiated, and differences of float128 steps to compare with."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import sympy as sp

import gyrospark as gs
from calls import identify

#: Steps of each kind: Gauss-Lobatto, Lobatto IIIA-B, Radau-L, implicit midpoint, energy-momentum.
SCHEMES = [("G-L", 2), ("G-L", 3), ("LIIIA-B", 3), ("Radau-L", 2), ("IMS", None), ("EMS", None)]
SYMMETRIC = [s for s in SCHEMES if s[0] in ("G-L", "LIIIA-B")]

x, y, px, py, t, u, v, w = sp.symbols("x y px py t u v w", real=True)
m, grav, length, c, a, stiff = sp.symbols("m g l c a k", positive=True)


@dataclass(frozen=True)
class Case:
    """A system with a start near its constraints, and what its steps are differentiated by."""

    q: tuple[float, ...]
    p: tuple[float, ...]
    parameters: dict[str, Any]
    dt: float
    t0: float = 0.0
    #: What ``gs.stepper`` gets in addition to the scheme.
    options: dict[str, Any] = field(default_factory=dict)
    #: Parameters and inputs that change together; by default each alone.
    by: tuple[tuple[str, ...], ...] = ()

    def directions(self) -> list[dict[str, float]]:
        """Return directions of parameters, dt and, where there is time, t0: relative changes."""
        timed = getattr(self.options.get("system"), "time", None) is not None
        each = ((name,) for name in self.parameters)
        return [*({k: self.parameters[k] for k in names} for names in self.by or each),
                {"dt": self.dt}, *([{"t0": self.dt}] if timed else [])]


def forced_system() -> gs.System:
    """A pendulum on a driven pivot, with drag, a driven force and an input."""
    H = (px**2 + py**2) / (2 * m) + m * grav * y + a * sp.cos(3 * t) * x**2
    constraint = x**2 + (y - a * sp.sin(2 * t))**2 - length**2
    forces = (-c * px * py + u, -c * py + sp.sin(5 * t))
    return gs.System((x, y), (px, py), (m, grav, length, c, a), H, [constraint], forces=forces,
                     time=t, inputs=(u,), name="driven_pendulum")


def conservative_system() -> gs.System:
    """A point on an ellipse with a quartic potential: forces vary, nothing is quadratic."""
    H = (px**2 + py**2) / (2 * m) + stiff * x**4 / 4 + grav * y * x
    return gs.System((x, y), (px, py), (m, stiff, grav, length), H, [x**2 / length**2 + y**2 - 1],
                     name="ellipse")


def driven_system() -> gs.System:
    """The same on an ellipse that breathes: g depends on the time."""
    H = (px**2 + py**2) / (2 * m) + stiff * x**4 / 4 + grav * y * x
    return gs.System((x, y), (px, py), (m, stiff, grav, length), H,
                     [x**2 / (length + sp.sin(2 * t) / 4)**2 + y**2 - 1], time=t, name="breathing")


def lagrangian_system() -> gs.System:
    """Two coupled coordinates with a mass matrix, magnetic terms, time and drag."""
    L = (m * (1 + x**2 / 3) * v**2 / 2 + m * w**2 / 2 + m * v * w * sp.cos(x - y) / 3 + a * x * v
         - m * grav * y * sp.cos(x) + a * sp.cos(3 * t) * x * w)
    return gs.System.from_lagrangian(L, (x, y), (v, w), (m, grav, a, c), time=t,
                                     forces=(-c * v * w, -c * w), name="coupled")


def constrained_lagrangian_system() -> gs.System:
    """A pendulum with a mass matrix that depends on q."""
    L = m * (1 + x**2 / 3) * v**2 / 2 + m * w**2 / 2 - m * grav * y
    return gs.System.from_lagrangian(L, (x, y), (v, w), (m, grav, length),
                                     [x**2 + y**2 - length**2], name="heavy_bob")


def top_case(rep: str, frame: bool = False) -> Case:
    """The heavy top, with γ or α, or in a co-moving frame, which needs I1 = I2."""
    top = gs.problems.fast_top()
    parameters = top.parameters | {rep: gs.gamma_m(top.inertia)}
    if not frame:
        return Case(tuple(top.q0), tuple(top.p0), parameters, 2e-3, options={"rep": rep})
    return Case(tuple(top.q0), tuple(top.p0), parameters | {"omega_body": 90.0}, 2e-3,
                options={"rep": rep, "frame": "symmetries"},
                by=(("I1", "I2"), ("I3",), ("mgl",), (rep,), ("omega_body",)))


def free_case() -> Case:
    """A free body of three moments."""
    body = gs.problems.free_body()
    parameters = {k: v for k, v in body.parameters.items() if k != "mgl"}
    parameters["gamma"] = gs.gamma_m(body.inertia)
    return Case(tuple(body.q0), tuple(body.p0), parameters, 1e-2,
                options={"rep": "gamma", "system": "free_body"})


_FORCED = {"m": 1.1, "g": 9.81, "l": 0.9, "c": 0.3, "a": 0.2, "u": 0.4}
_ELLIPSE = {"m": 1.1, "k": 7.0, "g": 2.0, "l": 1.4}
_PLANE = {"m": 1.1, "g": 9.81, "a": 0.2, "c": 0.3}

CASES = {
    "free body": free_case,
    "top, γ": lambda: top_case("gamma"),
    "top, α": lambda: top_case("alpha"),
    "top in a frame": lambda: top_case("gamma", frame=True),
    "forced": lambda: Case((0.5, -0.8), (0.3, 0.4), _FORCED, 0.02, 0.3,
                           {"system": forced_system()}),
    "ellipse": lambda: Case((0.9, 0.7), (0.5, 0.4), _ELLIPSE, 0.05,
                            options={"system": conservative_system()}),
    "breathing": lambda: Case((0.9, 0.7), (0.5, 0.4), _ELLIPSE, 0.05, 0.3,
                              {"system": driven_system()}),
    "Lagrangian": lambda: Case((0.5, -0.8), (0.3, 0.4), _PLANE, 0.02, 0.3,
                               {"system": lagrangian_system()}),
    "Lagrangian with g": lambda: Case((0.6, -0.8), (0.3, 0.4), {"m": 1.1, "g": 9.81, "l": 1.0},
                                      0.02, options={"system": constrained_lagrangian_system()}),
}


def product() -> list[Any]:
    """Return every name of a case with every scheme."""
    return [(name, scheme) for name in CASES for scheme in SCHEMES]


def label(given: Any) -> str:
    """Return a test's id."""
    return given if isinstance(given, str) else identify(given)


@cache
def case_of(name: str) -> Case:
    """Return a case by name, once."""
    return CASES[name]()


@cache
def stepper_for(name: str, scheme: tuple[str, int | None], real: str = "double") -> gs.Stepper:
    """Return the stepper of a case."""
    return gs.stepper(*scheme, real=real, **case_of(name).options)


def start_of(name: str, step: gs.Stepper) -> tuple[np.ndarray, np.ndarray]:
    """Return a consistent start."""
    case = case_of(name)
    found = step.consistent(case.q, case.p, parameters=case.parameters, t=case.t0)
    return found.q, found.p


def moved_step(
    name: str, step: gs.Stepper, direction: dict[str, float], shift: Any, dz: Any = None
) -> np.ndarray:
    """Return q, p and multipliers of a step whose consistent start, parameters, times are moved."""
    case, (q, p) = case_of(name), start_of(name, step)
    if dz is not None:
        q, p = q + shift * dz[: step.n], p + shift * dz[step.n :]
    one = q[0] - q[0] + 1  # of the stepper's numbers
    values = {k: one * value + shift * direction.get(k, 0.0) for k, value in
              case.parameters.items()}
    t0 = one * case.t0 + shift * direction.get("t0", 0.0)
    if step.m:
        found = step.consistent(q, p, parameters=values, t=t0)
        q, p = found.q, found.p if step.manifest["scheme"]["keeps_momentum_constraint"] else p
    dt = one * case.dt + shift * direction.get("dt", 0.0)
    run = step.integrate(q, p, dt=dt, steps=1, parameters=values, t0=t0)
    return np.concatenate([run.q[-1], run.p[-1], run.multipliers[-1].ravel()])


def difference(function: Any, size: float = 2.0**-36) -> np.ndarray:
    """Return the derivative at 0 by central differences of order 4."""
    near, far = (function(e) - function(-e) for e in (size, 2 * size))
    return (8 * near - far) / (12 * size)


def tangents_of_step(
    name: str, step: gs.Stepper, **wanted: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Return directions of the start and their tangents at the end of one step, in columns."""
    case, (q, p) = case_of(name), start_of(name, step)
    run = step.integrate(q, p, dt=case.dt, steps=1, parameters=case.parameters, t0=case.t0,
                         tangents=gs.Tangents(**wanted))
    return run.tangents.start, np.concatenate([run.tangents.q[-1], run.tangents.p[-1]])
