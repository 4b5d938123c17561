"""A plane double pendulum in Cartesian coordinates, and where it is released."""

from __future__ import annotations

from functools import cache

import numpy as np
import sympy as sp

import gyrospark as gs

__all__ = ["PARAMETERS", "pendulum", "released"]

PARAMETERS = {"g": 9.81, "l": 1.0}


@cache
def pendulum(scheme: str = "G-L", stages: int | None = 3, real: str = "double") -> gs.Stepper:
    """Return the stepper of two unit masses on rods of lengths 1 and l."""
    q, p = sp.symbols("x1 y1 x2 y2", real=True), sp.symbols("px1 py1 px2 py2", real=True)
    g, length = sp.symbols("g l", positive=True)
    H = sum(x**2 for x in p) / 2 + g * (q[1] + q[3])
    rods = [q[0] ** 2 + q[1] ** 2 - 1, (q[2] - q[0]) ** 2 + (q[3] - q[1]) ** 2 - length**2]
    system = gs.System(q, p, (g, length), H, rods, name="two_rods")
    return gs.stepper(scheme, stages, system=system, real=real)


def released(a: float, b: float, step: gs.Stepper | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return the state at rest with these angles against the downward vertical."""
    q = [np.sin(a), -np.cos(a), np.sin(a) + np.sin(b), -np.cos(a) - np.cos(b)]
    return (step or pendulum()).project(q, np.zeros(4), parameters=PARAMETERS)
