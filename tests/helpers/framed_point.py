"""A point on a sphere that turns about the third axis: its weight, its field and an input."""

from __future__ import annotations

from functools import cache

import sympy as sp

import budget
import gyrospark as gs

__all__ = ["FIELD", "PENDULUM", "framed_point"]

#: A pendulum of weight 1, and Neumann's problem with two equal axes.
PENDULUM, FIELD = {"k": 1.0, "a": 0.0, "u": 0.0}, {"k": 0.0, "a": 1.0, "u": 0.0}


@cache
def framed_point() -> gs.Stepper:
    """Return its stepper in a co-moving frame: p²/2 + k z + a (x² + y² + 4 z²)/2 and a force u."""
    x, y, z, u, v, w = sp.symbols("x y z p_x p_y p_z", real=True)
    k, a, push = sp.symbols("k a u", real=True)
    H = (u**2 + v**2 + w**2) / 2 + k * z + a * (x**2 + y**2 + 4 * z**2) / 2
    system = gs.System((x, y, z), (u, v, w), (k, a), H, (x**2 + y**2 + z**2 - 1,),
                       name="framed_point", forces=(0, 0, push), inputs=(push,))
    with budget.shared():
        return gs.stepper("G-L", 2, system=system, frame="symmetries")
