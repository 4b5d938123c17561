"""Rigid bodies about a fixed point: the free one that turns over, and Kovalevskaya's top."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from .problem import Attempt, Reference

if TYPE_CHECKING:
    from ..generator.bodies.model import Model
    from ..runtime.output.trajectory import Trajectory

__all__ = ["DZHANIBEKOV", "KOVALEVSKAYA"]

_QUATERNION = ("q0", "q1", "q2", "q3")
_OMEGA = ("Omega1", "Omega2", "Omega3")
_ATTEMPTS = (Attempt("G-L", 4, (25, 50, 100, 250)), Attempt("G-L", 3, (50, 100, 250, 1000)),
             Attempt("EMS", None, (1000, 4000)))


def _model(name: str, potential: Any, quantities: Mapping[str, Any], moments: tuple[int, ...],
           omega: tuple[str, ...]) -> Model:
    """Return a body that starts with q = (1, 0, 0, 0): p = 2 (0, I₁ Ω₁, I₂ Ω₂, I₃ Ω₃)."""
    from ..generator.bodies.model import Model
    from ..generator.bodies.rigid_body import body_system

    system = body_system(name, "gamma", potential, quantities=quantities)
    values: dict[str, Any] = dict(zip(("I1", "I2", "I3"), moments, strict=True)) | {"gamma": 2}
    p = [2 * Ii * Fraction(x) for Ii, x in zip(moments, omega, strict=True)]
    return Model(system, values, np.array([1, 0, 0, 0]), np.array([Fraction(0), *p]))


def _end(run: Trajectory, moments: tuple[int, ...]) -> Mapping[str, Any]:
    """Ω = L(q) p / (2 I) of the last state, in numbers of its own type."""
    (q0, q1, q2, q3), (p0, p1, p2, p3) = run.q[-1], run.p[-1]
    twice = (-q1 * p0 + q0 * p1 + q3 * p2 - q2 * p3, -q2 * p0 - q3 * p1 + q0 * p2 + q1 * p3,
             -q3 * p0 + q2 * p1 - q1 * p2 + q0 * p3)
    return {"attitude": run.q[-1],
            "angular velocity": [x / (2 * Ii) for x, Ii in zip(twice, moments, strict=True)]}


def _dzhanibekov() -> Model:
    import sympy as sp

    from ..generator.bodies.symbols import R, inertia, omega

    space = R * sp.Matrix([Ii * x for Ii, x in zip(inertia, omega, strict=True)])
    return _model("dzhanibekov", sp.Integer(0), {"Lx": space[0], "Ly": space[1], "Lz": space[2]},
                  (1, 2, 3), ("0.001", "1", "0.001"))


def _kovalevskaya() -> Model:
    from ..generator.bodies.symbols import R, omega

    O1, O2, _ = omega
    K = (O1**2 - O2**2 - R[2, 0]) ** 2 + (2 * O1 * O2 - R[2, 1]) ** 2
    return _model("kovalevskaya_top", R[2, 0], {"K": K}, (2, 2, 1), ("1", "0.5", "0.25"))


DZHANIBEKOV = Reference(
    name="dzhanibekov", title="Free body that turns over about its middle axis (Dzhanibekov)",
    source="I = (1, 2, 3), Ω = (0.001, 1, 0.001), q = (1, 0, 0, 0)", form="Python",
    make=_dzhanibekov, seconds="10",
    groups={"attitude": _QUATERNION, "angular velocity": _OMEGA},
    read=lambda run: _end(run, (1, 2, 3)),
    invariants={"energy": "Ω·IΩ/2", "Lx": "(R IΩ)₁", "Ly": "(R IΩ)₂", "Lz": "(R IΩ)₃"},
    attempts=_ATTEMPTS)

KOVALEVSKAYA = Reference(
    name="kovalevskaya", title="Kovalevskaya's top",
    source="I = (2, 2, 1), mgl = 1, centre on axis 1, Ω = (1, 0.5, 0.25), q = (1, 0, 0, 0)",
    form="Python", make=_kovalevskaya, seconds="10",
    groups={"attitude": _QUATERNION, "angular velocity": _OMEGA},
    read=lambda run: _end(run, (2, 2, 1)),
    invariants={"energy": "Ω·IΩ/2 + R₃₁",
                "K": "(Ω₁² − Ω₂² − R₃₁)² + (2 Ω₁ Ω₂ − R₃₂)²"},
    attempts=_ATTEMPTS)
