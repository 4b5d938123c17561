"""Systems from a Lagrangian that depends on time, and the same with time as a coordinate."""

from __future__ import annotations

from functools import cache

import numpy as np
import sympy as sp

import gyrospark as gs
from lagrangians import PARAMETERS, STARTS, bead

t = sp.Symbol("t", real=True)
w, a, g, c, k, m = sp.symbols("w a g c k m", positive=True)
b = sp.Symbol("b", real=True)


def one(name):
    """Return a coordinate, its velocity and its momentum."""
    return sp.symbols(f"{name} v{name} p_{name}", real=True)


@cache
def swelling():
    x, v, _ = one("x")
    return gs.System.from_lagrangian(sp.exp(2 * c * t) * (v**2 - k**2 * x**2) / 2, [x], [v],
                                     [c, k], time=t, name="swelling")


@cache
def kinked():
    """A particle on a V-shaped floor, of a mass that is more on the right."""
    x, v, _ = one("x")
    return gs.System.from_lagrangian((2 + sp.tanh(x)) * v**2 / 2 - sp.Abs(x), [x], [v], [],
                                     name="kinked")


@cache
def wire():
    (r, vr, _), (f, vf, _) = one("r"), one("f")
    return gs.System.from_lagrangian(m * (vr**2 + r**2 * vf**2) / 2, [r, f], [vr, vf], [m, w],
                                     [f - w * t], time=t, name="wire")


@cache
def shaken():
    """With the pivot at y = a sin wt and the length l = 1 + b cos wt; and its H by hand."""
    x, v, p = one("x")
    lift, length = a * sp.sin(w * t), 1 + b * sp.cos(w * t)
    rate, reel = sp.diff(lift, t), sp.diff(length, t)
    L = ((reel * sp.sin(x) + length * v * sp.cos(x))**2
         + (rate - reel * sp.cos(x) + length * v * sp.sin(x))**2) / 2 - g * (
             lift - length * sp.cos(x))
    H = ((p - rate * length * sp.sin(x))**2 / length**2 - reel**2 - rate**2
         + 2 * rate * reel * sp.cos(x)) / 2 + g * (lift - length * sp.cos(x))
    return (gs.System.from_lagrangian(L, [x], [v], [w, a, b, g], time=t, name="shaken"),
            gs.System([x], [p], [w, a, b, g], H, time=t, name="shaken_by_hand"))


@cache
def lifted():
    still = bead()
    (r, z, _), (_, vz, vf) = still.q, still.velocities
    mass, length, gravity, rate, _, push = still.parameters
    sphere = length * (1 + push * sp.sin(t) / 10)
    height, turn = push * sp.sin(rate * t), push * sp.sin(2 * t)
    there = {mass: mass * (1 + t / 8), vz: vz + sp.diff(height, t), vf: vf + sp.diff(turn, t)}
    return gs.System.from_lagrangian(
        still.L.subs(there) - mass * gravity * height, still.q, still.velocities, still.parameters,
        [r**2 + z**2 - sphere**2], still.forces, t, name="lifted", constraint_names=["sphere"])


def start_of_lifted(step, t0=0.3):
    q, v = map(np.array, STARTS["bead"])
    p = step.momenta(q, v, parameters=PARAMETERS["bead"], t=t0)
    return step.project(q, p, parameters=PARAMETERS["bead"], t=t0)
