"""Steppers for the fuzzing of calls: one of each kind of generated code."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import sympy as sp

import gyrospark as gs

__all__ = ["NAMES", "Case", "beads", "case"]

#: "beads" has two constraints, forces of time and quantities; "chain" loops over its bodies.
NAMES = ("gl3", "ems", "ims", "beads", "chain")


@dataclass(frozen=True)
class Case:
    """A stepper with a state and parameters to start from."""

    step: gs.Stepper
    q: np.ndarray
    p: np.ndarray
    parameters: dict[str, float]


def beads() -> gs.System:
    """Return two beads on circles, one hanging on the other, with drag and a drive in time.

    Forces and quantities switch sides, some of which are no numbers.
    """
    x, y, u, v = sp.symbols("x y u v", real=True)
    px, py, pu, pv = sp.symbols("px py pu pv", real=True)
    mass, grav, drag = sp.symbols("m g c", positive=True)
    t = sp.Symbol("t", real=True)
    H = (px**2 + py**2 + pu**2 + pv**2) / (2 * mass) + mass * grav * (y + v)
    return gs.System(
        (x, y, u, v), (px, py, pu, pv), (mass, grav, drag), H,
        (x**2 + y**2 - 1, (u - x) ** 2 + (v - y) ** 2 - 1),
        forces=(-drag * px + sp.sin(t), -drag * sp.Abs(py) * py,
                -drag * sp.Max(-1, sp.Min(pu, sp.sqrt(1 + u))),
                sp.Piecewise((sp.log(v), v > 1), (0, t < 2), (sp.Mod(t, 1) / 9, True)) - drag * pv),
        time=t, name="beads", quantities={"height": y + v, "drive": sp.sin(t) * sp.sign(x),
                                          "late": sp.Heaviside(t - 1) + sp.floor(x / drag)},
    )


@cache
def case(name: str) -> Case:
    """Return one of ``NAMES``."""
    if name == "beads":
        step = gs.stepper("G-L", 2, system=beads())
        parameters = {"m": 0.7, "g": 9.81, "c": 0.1}
        q, p = step.project([0.6, -0.8, 1.4, -1.4], [0.3, 0.2, 0.1, 0.0], parameters=parameters)
        return Case(step, q, p, parameters)
    if name == "chain":
        model = gs.models.double_top()  # which tests step, too
        return Case(gs.stepper("G-L", 2, system=model), model.q0, model.p0, dict(model.parameters))
    top = gs.problems.fast_top()
    scheme = {"gl3": ("G-L", 3, "gamma"), "ems": ("EMS", None, "gamma"),
              "ims": ("IMS", None, "gamma")}[name]
    rep: Any = scheme[2]
    return Case(gs.stepper(*scheme), top.q0, top.p0,
                top.parameters | {rep: gs.gamma(top.inertia)})
