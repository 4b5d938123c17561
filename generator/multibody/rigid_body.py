"""The rigid body in unit quaternions: L(q), R(q), and the α- and γ-type kinetic energies.

The paper's equation numbers are given; tests/generator/multibody/test_rigid_body.py proves the
identities.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType
from typing import Literal

import sympy as sp

from ...core.arguments import as_flag, as_items, as_mapping, unknown
from ...core.errors import InputError
from ..systems.expression_arguments import as_expression
from ..systems.system import INVERSE as INVERSE_NAMES
from ..systems.system import System

__all__ = [
    "INVERSE",
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
#: K11, K12, K13, K22, K23, K33: the entries of J⁻¹ where the inertia is a tensor.
INVERSE = tuple(sp.Symbol(name, real=True) for name in INVERSE_NAMES)
alpha, gamma = sp.symbols("alpha gamma", real=True, nonzero=True)
mgl = sp.Symbol("mgl", real=True)
time = sp.Symbol("t", real=True)


def expressions(label: str, values: object, count: int) -> list[sp.Expr]:
    """Return ``count`` expressions, or raise InputError for another number of them."""
    entries = [as_expression(e) for e in as_items(label, values, f"{count} expressions")]
    if len(entries) != count:
        raise InputError(f"The {label} has {len(entries)} entries; give {count}.")
    return entries


def left_matrix(x: Sequence[sp.Expr]) -> sp.Matrix:
    """Return L(x) of (8), 3 × 4: L(q)q = 0, and Ω = 2 L(q) q̇ in body axes."""
    x0, x1, x2, x3 = x
    return sp.Matrix([[-x1, x0, x3, -x2], [-x2, -x3, x0, x1], [-x3, x2, -x1, x0]])


def rotation_matrix(x: Sequence[sp.Expr]) -> sp.Matrix:
    """Return R(x) of (3), 3 × 3, for a quaternion, scalar first: it maps body to space axes.

    Erratum 1: the paper does not say in which direction.
    """
    entries = expressions("quaternion", x, 4)
    # a model asks for the matrices of its bodies again and again
    return sp.Matrix(_rotation_of_symbols(*entries) if all(e.is_Symbol for e in entries)
                     else _rotation(*entries))


def _rotation(x0: sp.Expr, x1: sp.Expr, x2: sp.Expr, x3: sp.Expr) -> list[list[sp.Expr]]:
    """Return the rows of R(x) = (x₀² − |v|²) 1 + 2 v vᵀ + 2 x₀ [v×], v = (x₁, x₂, x₃)."""
    return [
        [x0**2 + x1**2 - x2**2 - x3**2, 2 * (x1 * x2 - x0 * x3), 2 * (x1 * x3 + x0 * x2)],
        [2 * (x1 * x2 + x0 * x3), x0**2 - x1**2 + x2**2 - x3**2, 2 * (x2 * x3 - x0 * x1)],
        [2 * (x1 * x3 - x0 * x2), 2 * (x2 * x3 + x0 * x1), x0**2 - x1**2 - x2**2 + x3**2],
    ]


_rotation_of_symbols = lru_cache(maxsize=1024)(_rotation)


def double_momentum(x: Sequence[sp.Expr], y: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Return 2l = L(q) p, twice the angular momentum in body axes (19): three bilinear sums.

    q is the argument x, p the argument y.
    """
    return [sum(a * b for a, b in zip(row, y, strict=True)) for row in left_matrix(x).tolist()]


def kinetic_energy(
    rep: Rep, x: Sequence[sp.Expr] = q, y: Sequence[sp.Expr] = p,
    inertia: Sequence[sp.Expr] = moments, weight: sp.Expr | None = None
) -> sp.Expr:
    """Return T(q, p) for q = x and p = y: original (20), α-type (22) or γ-type (26), w = L(q)p.

        original   ⅛ wᵀJ⁻¹w
        α-type     ⅛ wᵀJ⁻¹w + (qᵀp)²/(8α)
        γ-type     ⅛ wᵀ(J⁻¹ − γ⁻¹)w + |p|²/(8γ)

    ``inertia`` is I1, I2, I3, or K11, K12, K13, K22, K23, K33 of J⁻¹; ``weight`` is α or γ. The
    components of w stay unexpanded: derivatives and discrete gradients are then expressions in
    them, which are computed once.
    """
    w = double_momentum(x, y)
    if rep == "original":
        return sum(squares(w, inertia), sp.Integer(0)) / 8
    if rep == "alpha":
        radial = sum(a * b for a, b in zip(x, y, strict=True))
        return kinetic_energy("original", x, y, inertia) + radial**2 / (weight or alpha) / 8
    if rep == "gamma":
        square = sum(b**2 for b in y)
        weight = weight or gamma
        relative = sum(squares(w, inertia, 1 / weight), sp.Integer(0))
        return square / weight / 8 + relative / 8
    raise unknown("representation", rep, ("alpha", "gamma"))


def squares(
    w: Sequence[sp.Expr], inertia: Sequence[sp.Expr], less: sp.Expr | int = 0
) -> list[sp.Expr]:
    """Return the terms of wᵀ(J⁻¹ − less · 1)w, three for principal moments, six for a tensor."""
    if len(inertia) == 3:
        return [(1 / Ii - less) * wi**2 for wi, Ii in zip(w, inertia, strict=True)]
    K = symmetric_matrix(inertia)
    return [*((K[i, i] - less) * w[i] ** 2 for i in range(3)),
            *(2 * K[i, j] * w[i] * w[j] for i, j in ((0, 1), (0, 2), (1, 2)))]


def symmetric_matrix(entries: Sequence[sp.Expr]) -> sp.Matrix:
    """Return the symmetric matrix of its entries 11, 12, 13, 22, 23, 33: J⁻¹, or J."""
    K11, K12, K13, K22, K23, K33 = entries
    return sp.ImmutableMatrix([[K11, K12, K13], [K12, K22, K23], [K13, K23, K33]])


def gravity_potential(x: Sequence[sp.Expr] = q) -> sp.Expr:
    """Return V = mgl cos θ = mgl qᵀ diag(1, −1, −1, 1) q (79), for q = x."""
    x0, x1, x2, x3 = x
    return mgl * (x0**2 - x1**2 - x2**2 + x3**2)


def tensor_symbols(prefix: str = "") -> sp.Matrix:
    """Return J, 3 × 3, in the symbols J11, J12, J13, J22, J23, J33."""
    names = (f"{prefix}J{name[1:]}" for name in INVERSE_NAMES)
    return symmetric_matrix([sp.Symbol(name, real=True) for name in names])


def angular_velocity(
    x: Sequence[sp.Expr] = q, y: Sequence[sp.Expr] = p, inertia: Sequence[sp.Expr] = moments
) -> list[sp.Expr]:
    """Return Ω = J⁻¹ ½ L(q) p in body axes (19), three entries, for q = x and p = y.

    ``inertia`` is as of ``kinetic_energy``: three moments, or the six entries of J⁻¹.
    """
    if len(inertia) != 3:
        halves = sp.Matrix(double_momentum(x, y)) / 2
        return list(symmetric_matrix(inertia) * halves)
    return [w / (2 * Ii) for w, Ii in zip(double_momentum(x, y), inertia, strict=True)]


def body_force(torque: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Return the generalised force F = 2 L(q)ᵀ τ of a torque τ in body axes, four entries.

    Its power is the power of the torque, F·q̇ = τ·2L(q)q̇ = τ·Ω, and it keeps q on the sphere:
    q·F = 0.
    """
    return [2 * sum(a * b for a, b in zip(column, torque, strict=True))
            for column in left_matrix(q).T.tolist()]


def body_system(
    name: str, rep: Rep, potential: sp.Expr, parameters: Sequence[sp.Symbol] = (), *,
    torque: Sequence[sp.Expr] = (), quantities: Mapping[str, sp.Expr] = MappingProxyType({}),
    tensor: bool = False, time_scale: sp.Expr | None = None
) -> System:
    """Return a rigid body with a fixed point in a potential V(q): H = T(q, p) + V, qᵀq = 1 (2).

    Formulas are SymPy expressions in ``gyrospark.symbols``: q (q0..q3), p, R (R(q), body to space
    axes), inertia (I1, I2, I3), omega (Ω in body axes), t, and your own ``parameters``.

    Parameters
    ----------
    name : str
        A C identifier.
    rep : {"gamma", "alpha"}
        Form of T; gamma or alpha becomes a parameter beside I1, I2 and I3.
    potential : Expr
        V of q (or R), inertia and parameters, in J.
    parameters : sequence of Symbol
        Every further symbol of the formulas.
    torque : sequence of Expr
        Torque in body axes in N m, three entries of q, p, omega, t and parameters, or none.
    quantities : mapping of str to Expr
        Quantities of trajectories, by name.
    tensor : bool
        Body axes are no principal axes: K11, K12, K13, K22, K23, K33, the entries of J⁻¹, are
        parameters in place of I1, I2, I3.
    time_scale : Expr, optional
        σ = dt/dτ of q, p, omega, t and parameters: see ``System``.

    Raises
    ------
    InputError
        For another representation, a torque that has not three entries, unknown symbols.

    Examples
    --------
    A satellite in a gravity gradient, whose axes do not rotate with the orbit
    (``gs.models.satellite`` has orbit axes):

    >>> import sympy
    >>> import gyrospark as gs
    >>> mu, r = sympy.symbols("mu r", positive=True)
    >>> V = 3*mu/(2*r**3) * sum(I*x**2 for I, x in zip(gs.symbols.inertia, gs.symbols.R[2, :]))
    >>> satellite = gs.body_system("satellite", "gamma", V, (mu, r))
    """
    weights = {"alpha": (alpha,), "gamma": (gamma,), "original": ()}
    if not isinstance(rep, str) or rep not in weights:
        raise unknown("representation", rep, ("alpha", "gamma"))
    quantities = as_mapping("quantities", quantities, "{'height': ...}")
    torques = [as_expression(e) for e in as_items("torque", torque, "three expressions")]
    if len(torques) not in (0, 3):
        raise InputError(f"The torque has {len(torques)} entries; give three, in body axes, or "
                         "none at all.")
    inertia = INVERSE if as_flag("tensor", tensor) else moments
    has_time = any(as_expression(e).has(time) for e in (potential, time_scale) if e is not None)
    return System(
        q,
        p,
        (*inertia, *as_items("parameters", parameters, "symbols"), *weights[rep]),
        kinetic_energy(rep, inertia=inertia) + as_expression(potential),
        (sum(x**2 for x in q) - 1,),
        name=name,
        forces=tuple(body_force(torques)) if torques else (),
        # torques and quantities may contain t; a potential without it has no explicit time
        time=time if torques or quantities or has_time else None,
        quantities=quantities,
        time_scale=time_scale,
        rigid_body=True,
    )


def heavy_top(rep: Rep) -> System:
    """Return the paper's top: parameters I1, I2, I3, mgl, and alpha or gamma."""
    return body_system("heavy_top", rep, gravity_potential(), (mgl,))


def free_body(rep: Rep) -> System:
    """Return a body without forces: parameters I1, I2, I3, and alpha or gamma."""
    return body_system("free_body", rep, potential=sp.Integer(0))
