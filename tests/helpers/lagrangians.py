"""Systems from a Lagrangian, with parameters and starts."""

from __future__ import annotations

from functools import cache

import numpy as np
import sympy as sp

import gyrospark as gs


@cache
def double():
    q1, q2, v1, v2 = sp.symbols("q1 q2 v1 v2", real=True)
    m, length, g = sp.symbols("m l g", positive=True)
    height = 2 * sp.cos(q1) + sp.cos(q2)
    T = m * length**2 * (2 * v1**2 + v2**2 + 2 * v1 * v2 * sp.cos(q1 - q2)) / 2
    return gs.System.from_lagrangian(T + m * g * length * height, [q1, q2], [v1, v2],
                                     [m, length, g], name="double")


@cache
def bead():
    r, z, f, vr, vz, vf, t = sp.symbols("r z f vr vz vf t", real=True)
    m, length, g = sp.symbols("m l g", positive=True)
    w, k, a = sp.symbols("w k a", real=True)
    L = (m * (vr**2 + vz**2 + r**2 * (vf + w) ** 2) / 2 + m * r * z * vr * vz / (4 * length**2)
         - m * g * z)
    return gs.System.from_lagrangian(
        L, [r, z, f], [vr, vz, vf], [m, length, g, w, k, a], [r**2 + z**2 - length**2],
        [-k * vr * z**2, -k * vz, a * sp.cos(t) - k * vf], t, name="bead",
        constraint_names=["sphere"])


PARAMETERS = {"double": {"m": 1.3, "l": 0.7, "g": 9.81},
              "bead": {"m": 1.25, "l": 0.75, "g": 9.81, "w": 2.0, "k": 0.125, "a": 0.5}}
#: Places, and velocities that keep r r' + z z' = 0.
STARTS = {"double": ([1.0, 2.0], [0.3, -0.2]), "bead": ([0.45, -0.6, 0.1], [0.8, 0.6, 1.5])}


def case(make):
    """Return a system, its parameters, q and v at the start."""
    system = make()
    return system, PARAMETERS[system.name], *map(np.array, STARTS[system.name])
