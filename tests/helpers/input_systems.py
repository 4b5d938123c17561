"""A pendulum that inputs push and pull."""

from __future__ import annotations

from functools import cache

import sympy as sp

import gyrospark as gs

x, y, u, v = sp.symbols("x y u v", real=True)
k, push, pull = sp.symbols("k push pull", real=True)


def pendulum():
    return gs.System((x, y), (u, v), (k,), (u**2 + v**2) / 2 + k * y, [x**2 + y**2 - 1],
                     forces=[push, push * pull - u / 10], inputs=(push, pull), name="pushed")


@cache
def stepper(make, scheme="G-L", stages=2, real="double"):
    return gs.stepper(scheme, stages, system=make(), real=real)


def oscillator():
    """Return one that one input pushes."""
    return gs.System((x,), (u,), (k,), u**2 / 2 + k * x**2 / 2, forces=[push], inputs=(push,),
                     name="pushed_oscillator")
