"""Symbols of systems with inputs, and an oscillator that one input pushes."""

from __future__ import annotations

from functools import cache

import sympy as sp

import gyrospark as gs

x, y, u, v = sp.symbols("x y u v", real=True)
k, push, pull = sp.symbols("k push pull", real=True)


@cache
def stepper(make, scheme="G-L", stages=2, real="double"):
    return gs.stepper(scheme, stages, system=make(), real=real)


def oscillator():
    """Return an oscillator that one input pushes."""
    return gs.System((x,), (u,), (k,), u**2 / 2 + k * x**2 / 2, forces=[push], inputs=(push,),
                     name="pushed_oscillator")
