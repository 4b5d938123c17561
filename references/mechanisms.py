"""Mechanisms in their own coordinates: the car axis, Andrews' squeezing mechanism."""

from __future__ import annotations

import runpy
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .problem import Attempt, Published, Reference

if TYPE_CHECKING:
    from ..generator.multibody.model import Model

__all__ = ["ANDREWS", "CAR_AXIS"]

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


# ---------------------------------------------------------------- car axis


def _car_axis() -> Model:
    """Return the model of the file examples/car_axis.toml."""
    from ..generator.models.model_file import load_model

    return load_model(EXAMPLES / "car_axis.toml")


_WHEELS = ("xl", "yl", "xr", "yr")
# each end of the axis has the mass ε² M/2 = 1/2000: velocities are 2000 p
CAR_AXIS = Reference(
    name="car-axis", title="Car axis, driven by the road",
    source="IVP test set, caraxis", form="TOML", make=_car_axis, seconds="3",
    groups={"positions": _WHEELS, "velocities": tuple(f"{x}'" for x in _WHEELS)},
    read=lambda run: {"positions": run.q[-1], "velocities": run.p[-1] * 2000},
    invariants={"energy balance": "H − ∫ H_t dt"},
    attempts=(Attempt("G-L", 5, (100, 300, 1000)), Attempt("G-L", 3, (300, 1000, 3000)),
              Attempt("EMS", None, (1000, 3000))),
    no_bodies="the road prescribes the motion of a joint and of the end of a spring",
    published=Published("deTestSet (CRAN), caraxis: GAMD in quadruple precision", {
        "xl": "0.0493455784275402809", "yl": "0.496989460230171153861",
        "xr": "1.04174252488542151681", "yr": "0.373911027265361256927",
        "xl'": "-0.0770583684040972358", "yl'": "0.00744686658723778553",
        "xr'": "0.0175568157537232222", "yr'": "0.770341043779251976443"}))


# ---------------------------------------------------------------- Andrews

_ANGLES = ("beta", "theta", "gamma", "phi", "delta", "omega", "epsilon")
_START = ("-0.0617138900142764496358948458001", "0", "0.455279819163070380255912382449",
          "0.222668390165885884674473185609", "0.487364979543842550225598953530",
          "-0.222668390165885884674473185609", "1.23054744454982119249735015568")


def _andrews() -> Model:
    """Return the mechanism from its Lagrangian in examples, at rest at the test set's start."""
    from ..generator.multibody.model import Model

    # the example is a script; its decimals are read as fractions: 0.035 is 35/1000
    example = runpy.run_path(str(EXAMPLES / "andrews.py"))
    parameters: dict[str, Any] = {
        name: Fraction(repr(value)) for name, value in example["values"].items()}
    return Model(example["system"], parameters, np.array([Fraction(x) for x in _START]),
                 np.zeros(7))


ANDREWS = Reference(
    name="andrews", title="Andrews' squeezing mechanism, seven bodies",
    source="IVP test set, andrews; IFToMM A03", form="Lagrangian", make=_andrews, seconds="0.03",
    groups={"positions": _ANGLES, "velocities": tuple(f"{x}'" for x in _ANGLES)},
    read=lambda run: {"positions": run.q[-1], "velocities": run.velocities[-1]},
    invariants={"energy": "T + c₀(l − l₀)²/2 − mom β"},
    attempts=(Attempt("G-L", 4, (100, 200, 300, 400)), Attempt("G-L", 3, (300, 1000, 2000))),
    published=Published("deTestSet (CRAN), andrews: PSIDE, tolerance 1e-14", {
        "beta": "15.81077119629904", "theta": "-15.75637105984298",
        "gamma": "0.04082224013073101", "phi": "-0.5347301163226948",
        "delta": "0.5244099658805304", "omega": "0.5347301163226948",
        "epsilon": "1.048080741042263", "beta'": "1139.920302151208",
        "theta'": "-1424.379294994111", "gamma'": "11.03291221937134",
        "phi'": "19.29337464421385", "delta'": "0.5735699284790808",
        "omega'": "-19.29337464421385", "epsilon'": "0.3231791658026955"}))
