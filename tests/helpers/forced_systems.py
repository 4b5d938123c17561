"""Systems with forces: a driven oscillator and a pendulum with drag."""

from __future__ import annotations

from functools import cache

import sympy as sp

import gyrospark as gs

x, y, u, v, tau = sp.symbols("x y u v tau", real=True)
k, c, f, omega = sp.symbols("k c f omega", positive=True)
PARAMETERS = {"k": 1.3, "c": 0.2, "f": 0.7, "omega": 2.1}


def oscillator():
    return gs.System((x,), (u,), (k, c, f, omega), u**2 / 2 + k * x**2 / 2, name="driven",
                     forces=(-c * u + f * sp.cos(omega * tau),), time=tau)


def pendulum():
    forces = (-c * u + f * sp.cos(omega * tau), -c * v - k * x * (x * v - y * u))
    return gs.System((x, y), (u, v), (k, c, f, omega), (u**2 + v**2) / 2 + 9 * y,
                     (x**2 + y**2 - 1,), forces=forces, time=tau, name="dragged",
                     quantities={"height": y, "drive": f * sp.cos(omega * tau)})


def runner():
    """H is neither separable nor quadratic: no identity of the fast path holds."""
    H = sp.sqrt(k**2 + u**2 + v**2) * (1 + x**2 / 4) + 3 / (2 + y)
    return gs.System((x, y), (u, v), (k, c, f, omega), H, (x**4 + y**2 - 1,), name="forced_runner",
                     forces=(-c * u, f * x - c * u * v), time=tau)


SYSTEMS = {"oscillator": (oscillator, (0.5,), (0.3,)),
           "pendulum": (pendulum, (0.6, -0.8), (0.8, 0.6)),
           "runner": (runner, (0.7, 0.8), (0.6, 0.3))}


@cache
def stepper_for(name, scheme, stages, real="double"):
    return gs.stepper(scheme, stages, system=SYSTEMS[name][0](), real=real)


def start(name, step):
    _, q, p = SYSTEMS[name]
    return step.project(q, p, parameters=PARAMETERS)
