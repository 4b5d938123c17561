"""A point on a sphere that turns about the third axis: its weight, its field, drag and an input."""

from __future__ import annotations

from functools import cache

import sympy as sp

import budget
import gyrospark as gs

__all__ = ["FIELD", "PENDULUM", "framed_point"]

#: A pendulum of weight 1, and Neumann's problem with two equal axes.
PENDULUM, FIELD = ({"k": k, "a": 1 - k, "c": 0.0, "u": 0.0} for k in (1.0, 0.0))


@cache
def framed_point(scheme: str = "G-L", stages: int | None = 2) -> gs.Stepper:
    """Return a stepper of it in a frame: H = p²/2 + k z + a (x² + y² + 4 z²)/2, F = u e₃ − c p."""
    x, y, z, u, v, w = sp.symbols("x y z p_x p_y p_z", real=True)
    k, a, c, push = sp.symbols("k a c u", real=True)
    H = (u**2 + v**2 + w**2) / 2 + k * z + a * (x**2 + y**2 + 4 * z**2) / 2
    system = gs.System((x, y, z), (u, v, w), (k, a, c), H, (x**2 + y**2 + z**2 - 1,),
                       name="framed_point", forces=(-c * u, -c * v, push - c * w), inputs=(push,))
    with budget.shared():
        return gs.stepper(scheme, stages, system=system, frame="symmetries")
