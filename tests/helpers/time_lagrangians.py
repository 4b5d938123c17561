"""Systems from a Lagrangian that depends on time."""

from __future__ import annotations

from functools import cache

import sympy as sp

import gyrospark as gs

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
    """A pendulum with the pivot at y = a sin wt and the length l = 1 + b cos wt."""
    x, v, _ = one("x")
    lift, length = a * sp.sin(w * t), 1 + b * sp.cos(w * t)
    rate, reel = sp.diff(lift, t), sp.diff(length, t)
    L = ((reel * sp.sin(x) + length * v * sp.cos(x))**2
         + (rate - reel * sp.cos(x) + length * v * sp.sin(x))**2) / 2 - g * (
             lift - length * sp.cos(x))
    return gs.System.from_lagrangian(L, [x], [v], [w, a, b, g], time=t, name="shaken")
