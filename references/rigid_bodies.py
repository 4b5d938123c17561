"""Rigid bodies about a fixed point: free ones, and tops that are integrable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from .problem import Attempt, Published, Reference

if TYPE_CHECKING:
    from ..generator.multibody.model import Model
    from ..runtime.results.trajectory import Trajectory

__all__ = ["DZHANIBEKOV", "FREE_BODY", "GORYACHEV_CHAPLYGIN", "HEAVY_TOP", "KOVALEVSKAYA"]

_QUATERNION = ("q0", "q1", "q2", "q3")
_OMEGA = ("Omega1", "Omega2", "Omega3")
_ATTEMPTS = (Attempt("G-L", 4, (25, 50, 100, 250)), Attempt("G-L", 3, (50, 100, 250, 1000)),
             Attempt("EMS", None, (1000, 4000)))


#: Moments of Brüls, Cardona and Arnold's top about its point: 15 kg at 1 m on axis 2.
_BRUELS = (Fraction("15.234375"), Fraction("0.46875"), Fraction("15.234375"))
_FREE = (Fraction(2), Fraction(1), Fraction(2, 3))
_DZHANIBEKOV, _KOVALEVSKAYA, _GORYACHEV = (
    tuple(map(Fraction, moments)) for moments in ((1, 2, 3), (2, 2, 1), (4, 4, 1)))


def _model(name: str, potential: Any, quantities: Mapping[str, Any], moments: Sequence[Fraction],
           omega: Sequence[Fraction | str]) -> Model:
    """Return a body about a fixed point that starts with q = (1, 0, 0, 0).

    There p = 2 L(q)ᵀ I Ω = 2 (0, I₁ Ω₁, I₂ Ω₂, I₃ Ω₃). ``moments`` are I₁ to I₃, ``omega`` the
    start's Ω in body axes, in rad/s. γ, which the motion does not depend on, is their mean.
    """
    from ..generator.multibody.model import Model
    from ..generator.multibody.rigid_body import body_system

    system = body_system(name, "gamma", potential, quantities=quantities)
    parameters: dict[str, Any] = dict(zip(("I1", "I2", "I3"), moments, strict=True))
    parameters |= {"gamma": Fraction(sum(moments)) / 3}
    p = [2 * Ii * Fraction(x) for Ii, x in zip(moments, omega, strict=True)]
    return Model(system, parameters, np.array([1, 0, 0, 0]), np.array([Fraction(0), *p]))


def _end(run: Trajectory, moments: Sequence[Fraction]) -> Mapping[str, Any]:
    """Return q and Ω of the last state: I_i Ω_i = (L(q) p)_i/2, in the numbers of the run."""
    (q0, q1, q2, q3), (p0, p1, p2, p3) = run.q[-1], run.p[-1]
    twice_momentum = (-q1 * p0 + q0 * p1 + q3 * p2 - q2 * p3,
                      -q2 * p0 - q3 * p1 + q0 * p2 + q1 * p3,
                      -q3 * p0 + q2 * p1 - q1 * p2 + q0 * p3)
    # products and quotients with whole numbers keep the type of q and p, quadruple included
    return {"attitude": run.q[-1],
            "angular velocity": [x * Ii.denominator / (2 * Ii.numerator)
                                 for x, Ii in zip(twice_momentum, moments, strict=True)]}


def _free_omega() -> tuple[Fraction, ...]:
    """Return Ω of M = (cos 1.1, 0, sin 1.1), to 50 digits."""
    import sympy as sp

    angle = sp.Rational("1.1")
    M1, M3 = (Fraction(str(sp.N(f(angle), 50))) for f in (sp.cos, sp.sin))
    return M1 / _FREE[0], Fraction(0), M3 / _FREE[2]


def _free(moments: Sequence[Fraction], omega: Sequence[Fraction | str]) -> Model:
    """Return a free body with its angular momentum in space axes, l = R J Ω, as quantities."""
    import sympy as sp

    from ..generator.multibody.symbols import R, inertia
    from ..generator.multibody.symbols import omega as angular_velocity

    space = R * sp.Matrix([Ii * x for Ii, x in zip(inertia, angular_velocity, strict=True)])
    momenta = {"Lx": space[0], "Ly": space[1], "Lz": space[2]}
    return _model("body_that_turns", sp.Integer(0), momenta, moments, omega)


def _kovalevskaya() -> Model:
    """Return Kovalevskaya's top with K = (Ω₁² − Ω₂² − R₃₁)² + (2 Ω₁ Ω₂ − R₃₂)²."""
    from ..generator.multibody.symbols import R, omega

    O1, O2, _ = omega
    K = (O1**2 - O2**2 - R[2, 0]) ** 2 + (2 * O1 * O2 - R[2, 1]) ** 2
    return _model("kovalevskaya_top", R[2, 0], {"K": K}, _KOVALEVSKAYA, ("1", "0.5", "0.25"))


def _goryachev_chaplygin() -> Model:
    """Return the Goryachev-Chaplygin top with G = Ω₃ (Ω₁² + Ω₂²) − Ω₁ R₃₃, an integral for l_z = 0.
    """
    from ..generator.multibody.symbols import R, omega

    O1, O2, O3 = omega  # M = (4 Ω₁, 4 Ω₂, Ω₃)
    integrals = {"G": O3 * (O1**2 + O2**2) - O1 * R[2, 2], "Lz": 4 * O1 * R[2, 0]
                 + 4 * O2 * R[2, 1] + O3 * R[2, 2]}
    return _model("goryachev_chaplygin", R[2, 0], integrals, _GORYACHEV, ("1", "0.5", "0"))


def _heavy_top() -> Model:
    """Return Brüls and Cardona's heavy top with l_z in space and l₂ about its axis as quantities.
    """
    import sympy as sp

    from ..generator.multibody.symbols import R, inertia, omega

    space = R * sp.Matrix([Ii * x for Ii, x in zip(inertia, omega, strict=True)])
    # 147.15 = 15 kg · 9.81 m/s² · 1 m; R₃₂ is the height of the centre, which lies on axis 2
    return _model("bruels_top", sp.Rational("147.15") * R[2, 1],
                  {"Lz": space[2], "L2": inertia[1] * omega[1]}, _BRUELS,
                  ("0", "150", "-4.61538"))


DZHANIBEKOV = Reference(
    name="dzhanibekov", title="Free body near its intermediate axis (Dzhanibekov effect)",
    source="I = (1, 2, 3), Ω = (0.001, 1, 0.001), q = (1, 0, 0, 0)", form="Python",
    make=lambda: _free(_DZHANIBEKOV, ("0.001", "1", "0.001")), seconds="10",
    groups={"attitude": _QUATERNION, "angular velocity": _OMEGA},
    read=lambda run: _end(run, _DZHANIBEKOV),
    invariants={"energy": "Ω·IΩ/2", "Lx": "(R IΩ)₁", "Ly": "(R IΩ)₂", "Lz": "(R IΩ)₃"},
    attempts=_ATTEMPTS)

KOVALEVSKAYA = Reference(
    name="kovalevskaya", title="Kovalevskaya's top",
    source="I = (2, 2, 1), mgl = 1, centre on axis 1, Ω = (1, 0.5, 0.25), q = (1, 0, 0, 0)",
    form="Python", make=_kovalevskaya, seconds="10",
    groups={"attitude": _QUATERNION, "angular velocity": _OMEGA},
    read=lambda run: _end(run, _KOVALEVSKAYA),
    invariants={"energy": "Ω·IΩ/2 + R₃₁",
                "K": "(Ω₁² − Ω₂² − R₃₁)² + (2 Ω₁ Ω₂ − R₃₂)²"},
    attempts=_ATTEMPTS)

FREE_BODY = Reference(
    name="free-body", title="Free body of GeometricProblems.jl",
    source="GeometricProblems.jl, rigid_body: I = (2, 1, 2/3), I Ω = (cos 1.1, 0, sin 1.1)",
    form="Python", make=lambda: _free(_FREE, _free_omega()), seconds="100",
    groups={"attitude": _QUATERNION, "angular velocity": _OMEGA},
    read=lambda run: _end(run, _FREE),
    invariants={"energy": "Ω·IΩ/2", "Lx": "(R IΩ)₁", "Ly": "(R IΩ)₂", "Lz": "(R IΩ)₃"},
    attempts=(Attempt("G-L", 4, (100, 250, 500, 1000)), Attempt("G-L", 3, (250, 500, 1000, 4000)),
              Attempt("EMS", None, (1000, 4000))))

HEAVY_TOP = Reference(
    name="heavy-top", title="Fast heavy top of Brüls, Cardona and Arnold",
    source="15 kg at 1 m on axis 2, I = (15.234375, 0.46875, 15.234375) about the point, "
           "Ω = (0, 150, −4.61538), q = (1, 0, 0, 0)",
    form="Python", make=_heavy_top, seconds="2",
    groups={"attitude": _QUATERNION, "angular velocity": _OMEGA},
    read=lambda run: _end(run, _BRUELS),
    invariants={"energy": "Ω·IΩ/2 + 147.15 R₃₂", "Lz": "(R IΩ)₃", "L2": "I₂ Ω₂"},
    attempts=(Attempt("G-L", 4, (250, 500, 1000, 2000)), Attempt("G-L", 3, (500, 1000, 2000, 4000)),
              Attempt("EMS", None, (4000,))),
    published=Published("EXUDYN, heavyTop.py: RK4, h = 1e-4 s", {
        "q0": "0.12295", "q1": "-0.49108", "q2": "0.35043", "q3": "-0.78799"}))

GORYACHEV_CHAPLYGIN = Reference(
    name="goryachev-chaplygin", title="Top of Goryachev and Chaplygin",
    source="I = (4, 4, 1), mgl = 1, centre on axis 1, Lz = 0: Ω = (1, 0.5, 0), q = (1, 0, 0, 0)",
    form="Python", make=_goryachev_chaplygin, seconds="10",
    groups={"attitude": _QUATERNION, "angular velocity": _OMEGA},
    read=lambda run: _end(run, _GORYACHEV),
    invariants={"energy": "Ω·IΩ/2 + R₃₁", "Lz": "(R IΩ)₃",
                "G": "Ω₃ (Ω₁² + Ω₂²) − Ω₁ R₃₃"},
    attempts=_ATTEMPTS)
