"""IFToMM's stiff flyball governor in three coordinates; and stiffer, struck against its dampers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from .problem import Attempt, Reference

if TYPE_CHECKING:
    from ..generator.multibody.model import Model
    from ..runtime.results.trajectory import Trajectory

__all__ = ["FLYBALL_GOVERNOR", "FLYBALL_GOVERNOR_STIFF"]

#: SI: stiffness and damping, length of the spring at rest, mass and width w of a rod, mass of a
#: ball; M and a: mass and half the side of the slider, a block, a also from the shaft to a hinge.
_VALUES = {"K": "8e5", "C": "4e4", "rest": "0.5", "g": "9.81", "m": "0.3", "M": "3", "ball": "5",
           "w": "0.01", "a": "0.05"}
_DIGITS = 50


def _governor(damping: str = _VALUES["C"], slider_speed: str = "0") -> Model:
    """Return the model with one turn of the shaft a second, rods 30° below the horizontal.

    ``damping`` is C in N s/m, ``slider_speed`` the initial s' in m/s, both in decimals. Coordinates
    are the turn ψ of the shaft, β of the rods below the horizontal, and the height s of the slider.

    Both halves move alike: a spring and a damper from the middle of each rod, (a + cos β/2,
    1 − sin β/2), to the slider at (a, s): the potential K (L − rest)² of their length L, and the
    forces −2C L' ∂L/∂q.
    """
    import sympy as sp

    from ..generator.multibody.model import Model
    from ..generator.systems.system import System

    q = _, beta, s = sp.symbols("psi beta s", real=True)
    v = turn, swing, slide = sp.symbols("psi_t beta_t s_t", real=True)
    K, C, rest_length, g, m, M, ball, w, a = parameters = sp.symbols([*_VALUES], positive=True)
    sin, cos = sp.sin(beta), sp.cos(beta)
    # moments of inertia of a rod of length 1 with its ball: about the hinge, and about the shaft,
    # which depends on β
    about_hinge = m * (1 + w**2 / 4) / 3 + ball
    about_shaft = (m * (a**2 + a * cos + cos**2 / 3 + w**2 * (2 * sin**2 + cos**2) / 12)
                   + ball * (a + cos) ** 2)
    # the shaft, a bar of section w × w, and the slider, a block of side 2a, turn about their axis
    inertia = m * w**2 / 6 + M * (2 * a) ** 2 / 6 + 2 * about_shaft
    # there are two rods: no factor ½ at their swing
    kinetic = inertia * turn**2 / 2 + about_hinge * swing**2 + M * slide**2 / 2
    length = sp.sqrt(cos**2 / 4 + (1 - sin / 2 - s) ** 2)
    # two rods with their middles at −½ sin β and two balls at −sin β, from the hinge
    potential = g * (M * s - (m + 2 * ball) * sin) + K * (length - rest_length) ** 2
    slopes = [sp.diff(length, x) for x in q]  # ∂L/∂q, with L' = Σ ∂L/∂q q'
    rate = sum(slope * x for slope, x in zip(slopes, v, strict=True))
    system = System.from_lagrangian(kinetic - potential, q, v, parameters, name="flyball_governor",
                                    forces=[-2 * C * rate * slope for slope in slopes])
    values: dict[str, Any] = {name: Fraction(text) for name, text in (
        _VALUES | {"C": damping}).items()}
    start = {beta: sp.pi / 6, s: sp.Rational(1, 2)}
    substitution = {x: sp.Rational(values[str(x)]) for x in parameters} | start
    # p_ψ of one turn a second: 2π times the inertia about the shaft at the start
    spin = Fraction(str((2 * sp.pi * inertia.subs(substitution)).evalf(_DIGITS)))
    momenta = [spin, 0, values["M"] * Fraction(slider_speed)]
    q0 = [0, Fraction(str((sp.pi / 6).evalf(_DIGITS))), Fraction(1, 2)]
    return Model(replace(system, quantities={"Lz": system.p[0]}), values,
                 np.array(q0, dtype=object), np.array(momenta, dtype=object))


_COORDINATES = ("psi", "beta", "s")
_GROUPS = {"positions": _COORDINATES, "velocities": tuple(f"{x}'" for x in _COORDINATES)}
_KEPT = {"energy": "T + V + ∫ 2C L'² dt", "Lz": "∂T/∂ψ'"}


def _end(run: Trajectory) -> Mapping[str, Any]:
    """Return q and q' of the last state, three numbers each."""
    return {"positions": run.q[-1], "velocities": run.velocities[-1]}


FLYBALL_GOVERNOR = Reference(
    name="flyball-governor", title="Stiff flyball governor, IFToMM A05",
    source="IFToMM library of multibody problems, A05: 2π rad/s, rods 30° below the horizontal, "
           "8e5 N/m, 4e4 N s/m; turn of the shaft, of the rods, height of the slider",
    form="Lagrangian", make=_governor, seconds="0.1", groups=_GROUPS, read=_end, invariants=_KEPT,
    attempts=(Attempt("G-L", 4, (25, 50, 100, 200, 400)),
              Attempt("G-L", 3, (25, 50, 100, 200, 400, 800)),
              Attempt("Radau-L", 3, (25, 50, 100, 200, 400, 800, 1600))))

FLYBALL_GOVERNOR_STIFF = Reference(
    name="flyball-governor-stiff", title="Stiffer flyball governor with initial slider velocity",
    source="IFToMM A05 with 4e5 N s/m, a decay rate of 8e4 1/s, and an initial slider velocity of "
           "0.05 m/s, which long steps damp with Radau-L but not with G-L",
    form="Lagrangian", make=lambda: _governor("4e5", "0.05"), seconds="0.01", groups=_GROUPS,
    read=_end, invariants=_KEPT,
    attempts=(Attempt("G-L", 4, (5, 10, 20, 100, 500, 2000)),
              Attempt("Radau-L", 3, (5, 10, 20, 100, 500, 2000, 8000)),
              Attempt("G-L", 3, (5, 10, 20, 100, 500, 2000))))
