"""The rigid body in unit quaternions: L(q), R(q), and the α- and γ-type kinetic energies.

The paper's equation numbers are given; tests/test_rigid_body.py proves the identities.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import sympy as sp

from ..errors import InputError
from .system import System

__all__ = [
    "Rep",
    "body_system",
    "free_body",
    "gravity_potential",
    "heavy_top",
    "kinetic_energy",
    "left_matrix",
    "rotation_matrix",
]

Rep = Literal["original", "alpha", "gamma"]

q = sp.symbols("q0:4", real=True)
p = sp.symbols("p0:4", real=True)
moments = sp.symbols("I1:4", positive=True)
alpha, gamma = sp.symbols("alpha gamma", real=True, nonzero=True)
mgl = sp.Symbol("mgl", real=True)


def left_matrix(x: Sequence[sp.Expr]) -> sp.Matrix:
    """Return L(x) of (8), 3 × 4: L(q)q = 0, and Ω = 2 L(q) q̇ in body axes."""
    x0, x1, x2, x3 = x
    return sp.Matrix([[-x1, x0, x3, -x2], [-x2, -x3, x0, x1], [-x3, x2, -x1, x0]])


def rotation_matrix(x: Sequence[sp.Expr]) -> sp.Matrix:
    """Return R(x) of (3), 3 × 3; maps body to space axes (erratum 1)."""
    x0, x1, x2, x3 = x
    return sp.Matrix(
        [
            [x0**2 + x1**2 - x2**2 - x3**2, 2 * (x1 * x2 - x0 * x3), 2 * (x1 * x3 + x0 * x2)],
            [2 * (x1 * x2 + x0 * x3), x0**2 - x1**2 + x2**2 - x3**2, 2 * (x2 * x3 - x0 * x1)],
            [2 * (x1 * x3 - x0 * x2), 2 * (x2 * x3 + x0 * x1), x0**2 - x1**2 - x2**2 + x3**2],
        ]
    )


def double_momentum(x: Sequence[sp.Expr], y: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Return 2l = L(q) p, twice the angular momentum in body axes (19): three bilinear sums."""
    return [sum(a * b for a, b in zip(row, y, strict=True)) for row in left_matrix(x).tolist()]


def kinetic_energy(
    rep: Rep,
    x: Sequence[sp.Expr] = q,
    y: Sequence[sp.Expr] = p,
    inertia: Sequence[sp.Expr] = moments,
    weight: sp.Expr | None = None,
) -> sp.Expr:
    """Return T(q, p): original (20), α-type (22) or γ-type (26); ``weight`` is α or γ.

    The components of L(q)p stay unexpanded: derivatives and discrete gradients then come out in
    terms of them, and common subexpressions are found where a reader would put them.
    """
    w = double_momentum(x, y)
    if rep == "original":
        return sum((wi**2 / Ii for wi, Ii in zip(w, inertia, strict=True)), sp.Integer(0)) / 8
    if rep == "alpha":
        radial = sum(a * b for a, b in zip(x, y, strict=True))
        return kinetic_energy("original", x, y, inertia) + radial**2 / (weight or alpha) / 8
    if rep == "gamma":
        square = sum(b**2 for b in y)
        weight = weight or gamma
        relative = sum(
            ((1 / Ii - 1 / weight) * wi**2 for wi, Ii in zip(w, inertia, strict=True)),
            sp.Integer(0),
        )
        return square / weight / 8 + relative / 8
    raise InputError(f"Unknown representation {rep!r}; choose alpha or gamma.")


def gravity_potential(x: Sequence[sp.Expr] = q) -> sp.Expr:
    """Return V = mgl cos θ = mgl qᵀ diag(1, −1, −1, 1) q (79)."""
    x0, x1, x2, x3 = x
    return mgl * (x0**2 - x1**2 - x2**2 + x3**2)


def body_system(name: str, rep: Rep, potential: sp.Expr, parameters: Sequence[sp.Symbol]) -> System:
    """Return a body with a fixed point in a potential V(q); g = qᵀq − 1 (2)."""
    inertia_parameter = {"alpha": (alpha,), "gamma": (gamma,), "original": ()}[rep]
    return System(
        q,
        p,
        (*moments, *parameters, *inertia_parameter),
        kinetic_energy(rep) + potential,
        (sum(x**2 for x in q) - 1,),
        name=name,
        rigid_body=True,
    )


def heavy_top(rep: Rep) -> System:
    """Return the paper's top: parameters I1, I2, I3, mgl, and alpha or gamma."""
    return body_system("heavy_top", rep, gravity_potential(), (mgl,))


def free_body(rep: Rep) -> System:
    """Return a body without forces: parameters I1, I2, I3, and alpha or gamma."""
    return body_system("free_body", rep, sp.Integer(0), ())
