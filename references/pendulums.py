"""A point on a rod, in a plane and on a sphere: motions by Jacobi's functions."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from .problem import Attempt, Reference

if TYPE_CHECKING:
    from ..generator.multibody.model import Model
    from ..runtime.results.trajectory import Trajectory

__all__ = ["SIMPLE_PENDULUM", "SPHERICAL_PENDULUM"]

GRAVITY = Fraction("9.81")


def _point(name: str, axes: str, q: list[int], p: list[int]) -> Model:
    """Return a point of 1 kg on a rod of 1 m, gravity against the last axis.

    ``axes`` has a letter for each coordinate, "xy" or "xyz"; q and p are the start. In space the
    angular momentum L about the last axis is a quantity.
    """
    import sympy as sp

    from ..generator.multibody.model import Model
    from ..generator.systems.system import System

    coordinates = sp.symbols(list(axes), real=True)
    momenta = sp.symbols([f"p{axis}" for axis in axes], real=True)
    g = sp.Symbol("g", positive=True)
    quantities = {}
    if len(axes) == 3:
        x, y, _ = coordinates
        quantities = {"L": x * momenta[1] - y * momenta[0]}
    H = sum(u**2 for u in momenta) / 2 + g * coordinates[-1]
    rod = sum(x**2 for x in coordinates) - 1
    system = System(coordinates, momenta, (g,), H, (rod,), name=name, quantities=quantities)
    parameters: dict[str, Any] = {"g": GRAVITY}
    return Model(system, parameters, np.array(q), np.array(p))


def _end(run: Trajectory) -> Mapping[str, Any]:
    """Return positions and velocities of the last state; of 1 kg, momenta are velocities."""
    return {"positions": run.q[-1], "velocities": run.p[-1]}


SIMPLE_PENDULUM = Reference(
    name="simple-pendulum", title="Planar simple pendulum, IFToMM A01",
    source="IFToMM library of multibody problems, A01: 1 m, 1 kg, from the horizontal, at rest",
    form="Python",
    make=lambda: _point("simple_pendulum", "xy", [-1, 0], [0, 0]),
    seconds="10", groups={"positions": ("x", "y"), "velocities": ("x'", "y'")}, read=_end,
    invariants={"energy": "|p|²/2 + g y"},
    attempts=(Attempt("G-L", 3, (500, 1000, 2000, 4000)), Attempt("G-L", 5, (250, 500, 1000)),
              Attempt("LIIIA-B", 3, (500, 1000, 2000)), Attempt("EMS", None, (1000, 4000))))

SPHERICAL_PENDULUM = Reference(
    name="spherical-pendulum", title="Spherical pendulum",
    source="pydykit, pendulum_3d: m = l = 1, q = (1, 0, 0), p = (0, 1, 0)", form="Python",
    make=lambda: _point("spherical_pendulum", "xyz", [1, 0, 0], [0, 1, 0]),
    seconds="10", groups={"positions": ("x", "y", "z"), "velocities": ("x'", "y'", "z'")},
    read=_end, invariants={"energy": "|p|²/2 + g z", "L": "x p_y − y p_x"},
    attempts=(Attempt("G-L", 3, (500, 1000, 2000, 4000)), Attempt("G-L", 5, (250, 500, 1000)),
              Attempt("LIIIA-B", 3, (500, 1000, 2000)), Attempt("EMS", None, (1000, 4000))))
