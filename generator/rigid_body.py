"""The rigid body in unit quaternions: L(q), R(q), and the α- and γ-type kinetic energies.

The paper's equation numbers are given; tests/test_rigid_body.py proves the identities.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Literal

import sympy as sp

from ..errors import InputError
from .system import System

__all__ = [
    "Rep",
    "angular_velocity",
    "body_force",
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
time = sp.Symbol("t", real=True)


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


def angular_velocity(
    x: Sequence[sp.Expr] = q, y: Sequence[sp.Expr] = p, inertia: Sequence[sp.Expr] = moments
) -> list[sp.Expr]:
    """Return Ω = J⁻¹ ½ L(q) p in body axes (19), three entries."""
    return [w / (2 * Ii) for w, Ii in zip(double_momentum(x, y), inertia, strict=True)]


def body_force(torque: Sequence[sp.Expr], x: Sequence[sp.Expr] = q) -> list[sp.Expr]:
    """Return the generalised force F = 2 L(q)ᵀ τ of a torque τ in body axes, four entries.

    Its power is that of the torque, F·q̇ = τ·2L(q)q̇ = τ·Ω, and it does not push q off the sphere:
    q·F = 0.
    """
    return [2 * sum(a * b for a, b in zip(column, torque, strict=True))
            for column in left_matrix(x).T.tolist()]


def body_system(
    name: str,
    rep: Rep,
    potential: sp.Expr,
    parameters: Sequence[sp.Symbol] = (),
    *,
    torque: Sequence[sp.Expr] = (),
    quantities: Mapping[str, sp.Expr] = MappingProxyType({}),
) -> System:
    """Return a rigid body with a fixed point in a potential V(q): H = T(q, p) + V, qᵀq = 1 (2).

    Formulas are SymPy expressions in ``gyrospark.symbols``: q (q0..q3), p, R (R(q), body to space
    axes), inertia (I1, I2, I3), omega (Ω in body axes), t, and your own ``parameters``.

    Parameters
    ----------
    name : str
        A C identifier.
    rep : {"gamma", "alpha"}
        How T is written; gamma or alpha becomes a parameter beside I1, I2 and I3.
    potential : Expr
        V of q (or R), inertia and parameters, in J.
    parameters : sequence of Symbol
        Every further symbol of the formulas.
    torque : sequence of Expr
        Torque in body axes in N m, three entries of q, p, omega, t and parameters, or none.
    quantities : mapping of str to Expr
        What trajectories offer by name.

    Raises
    ------
    InputError
        For another representation, a torque that has not three entries, unknown symbols.

    Examples
    --------
    A satellite in a gravity gradient:

    >>> mu, r = sympy.symbols("mu r", positive=True)              # doctest: +SKIP
    >>> V = 3*mu/(2*r**3) * sum(I*x**2 for I, x in zip(gs.symbols.inertia, gs.symbols.R[2, :]))
    >>> satellite = gs.body_system("satellite", "gamma", V, (mu, r))
    """
    inertia_parameter = {"alpha": (alpha,), "gamma": (gamma,), "original": ()}.get(rep)
    if inertia_parameter is None:
        raise InputError(f"Unknown representation {rep!r}; choose alpha or gamma.")
    if len(torque) not in (0, 3):
        raise InputError(f"The torque has {len(torque)} entries; give three, in body axes, or none "
                         "at all.")
    return System(
        q,
        p,
        (*moments, *parameters, *inertia_parameter),
        kinetic_energy(rep) + potential,
        (sum(x**2 for x in q) - 1,),
        name=name,
        forces=tuple(body_force(torque)) if torque else (),
        time=time if torque or quantities else None,
        quantities=quantities,
        rigid_body=True,
    )


def heavy_top(rep: Rep) -> System:
    """Return the paper's top: parameters I1, I2, I3, mgl, and alpha or gamma."""
    return body_system("heavy_top", rep, gravity_potential(), (mgl,))


def free_body(rep: Rep) -> System:
    """Return a body without forces: parameters I1, I2, I3, and alpha or gamma."""
    return body_system("free_body", rep, sp.Integer(0), ())
