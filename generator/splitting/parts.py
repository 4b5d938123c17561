"""Parts of a Hamiltonian with closed flows on T*S³ × R^k.

Body b has the unit quaternion q, the angular momentum m = ½ L(q) p in body axes and l = R(q) m in
space axes. Modulo the ideal (|q|² − 1, qᵀp), q and l determine p = 2 L(q)ᵀ m, and

    H = Σ_b [½ a |m|² + Σ_e (½ d (e·m)² + c (e·m))] − ω·J + ½ p_rᵀ M⁻¹ p_r + v·p_r + V(q, r, t)

with constants a, d, c, e, ω, M and v of the parameters, and J = Σ l + Σ r × p_r. Flows over a time
t, for a quaternion exp(t w) = (cos(t |w|), sin(t |w|) w/|w|):

    ½ a |m|²               q ← exp(½ t a l) q                     l fixed
    ½ d (e·m)² + c (e·m)   q ← q exp(½ t (d (e·m) + c) e)         l and e·m fixed; e·m = (R(q) e)·l
    −ω·J                   q ← exp(−½ t ω) q                      l, r, p_r ← exp(−t ω×) of each
    ½ p_rᵀM⁻¹p_r + v·p_r   r ← r + t (M⁻¹ p_r + v)                p_r fixed
    V                      l ← l + t N(q, r, t),  p_r ← p_r − t V_r     q and r fixed

with the space torque N = −½ R(q) L(q) V_q. An isotropic drag dl/dt = −k l keeps the flow of the
rotations of a symmetric body closed: with s = (1 − exp(−k t))/k in place of t wherever l or m
multiplies it (c t stays), and l ← exp(−k t) l last; p_r in the same way.

Force gradient, with the canonical bracket {f, g} = f_q·g_p − f_p·g_q and τ = −½ L(q) V_q:

    G = −{V, {T, V}} = Σ_b τᵀ S τ + V_rᵀ M⁻¹ V_r,   S = a I + Σ d e eᵀ,

a function of q and r. The kick of b V + κ h² G is one kick with N + κ h² N_G in place of N; the
field of G is −[V, [T, V]] of the fields of T and V.

Source: McLachlan and Quispel, Splitting methods, Acta Numerica 11 (2002); Chin, Physics Letters A
226 (1997) 344, for G.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import sympy as sp

from ..systems.system import System

__all__ = ["AxisRotation", "BodyFlow", "Kick", "KickTemplate", "SpaceRotation", "Splitting",
           "Translation", "Vector"]

Vector = tuple[sp.Expr, sp.Expr, sp.Expr]


@dataclass(frozen=True)
class AxisRotation:
    """The part ½ d (e·m)² + c (e·m): a rotation about a body axis at the rate d (e·m) + c.

    Attributes
    ----------
    axis : Vector
        e, a unit vector in body axes.
    d, c : Expr
        In 1/(kg m²) and rad/s.
    steady : bool
        Whether e·m is an invariant of every part: the rate is the same at every step of a run,
        so that sine and cosine of each stage's angle are evaluated once a run.
    """

    axis: Vector
    d: sp.Expr
    c: sp.Expr
    steady: bool = False


@dataclass(frozen=True)
class BodyFlow:
    """The rotation of a free body: one exact flow, and axis rotations beyond it.

    Attributes
    ----------
    name : str
        Of the body.
    q : tuple of 4 int
        Indices of its quaternion in ``system.q``, scalar first.
    l : tuple of 3 Symbol
        Names of its angular momentum in space axes, in expressions of kicks.
    a : Expr
        Of ½ a |m|², in 1/(kg m²).
    axes : tuple of AxisRotation
        At most one: with ½ a |m|² it is one exact flow, for the two commute.
    further : tuple of AxisRotation
        Rotations that do not commute with ``axes``: those of an asymmetric body, and of a gyrostat
        whose wheel is not on the axis of symmetry. In a symmetric composition they are run in this
        order before the exact flow and in reverse order after it, half the time each.
    drag : Expr
        k of dl/dt = −k l, in 1/s; 0 without drag.
    symmetric_if : tuple of Expr
        Polynomials of the parameters; where all of them vanish, all rates in ``further`` are 0.
        Empty if ``further`` is, or if no equality of moments removes it.
    """

    name: str
    q: tuple[int, ...]
    l: tuple[sp.Symbol, ...]  # noqa: E741
    a: sp.Expr
    axes: tuple[AxisRotation, ...] = ()
    further: tuple[AxisRotation, ...] = ()
    drag: sp.Expr = sp.S.Zero
    symmetric_if: tuple[sp.Expr, ...] = ()

    @property
    def S(self) -> sp.ImmutableMatrix:
        """S = a I + Σ d e eᵀ, 3 × 3: T = ½ mᵀ S m + Σ c (e·m)."""
        return sp.ImmutableMatrix(sp.Matrix(sp.eye(3)) * self.a + sum(
            (e.d * sp.Matrix(e.axis) * sp.Matrix(e.axis).T for e in (*self.axes, *self.further)),
            sp.zeros(3, 3)))


@dataclass(frozen=True)
class Translation:
    """The coordinates r that move at M⁻¹ p_r + v.

    Attributes
    ----------
    coordinates : tuple of int
        Indices of r in ``system.q``; its momenta have the same indices in ``system.p``.
    inverse_mass : mapping of (int, int) to Expr
        Entries of M⁻¹ that are not 0, by indices in ``system.q``; both halves.
    velocity : mapping of int to Expr
        Entries of v that are not 0.
    drag : mapping of int to Expr
        k of dp/dt = −k p for each coordinate that has a drag.
    """

    coordinates: tuple[int, ...]
    inverse_mass: Mapping[tuple[int, int], sp.Expr]
    velocity: Mapping[int, sp.Expr]
    drag: Mapping[int, sp.Expr]


@dataclass(frozen=True)
class SpaceRotation:
    """The part −ω·J, of a co-moving frame: it commutes with every other part of T.

    Attributes
    ----------
    omega : Vector
        ω in space axes, in rad/s.
    bodies : tuple of int
        Indices in ``Splitting.bodies``.
    points : tuple of 3 int
        Coordinates of the points that turn, by indices in ``system.q``.
    """

    omega: Vector
    bodies: tuple[int, ...]
    points: tuple[tuple[int, int, int], ...]


@dataclass(frozen=True)
class Kick:
    """What a potential and forces add to the momenta per unit of time, at fixed q and r.

    Expressions in ``system.q``, parameters, time and inputs; if the splitting has
    ``other_forces``, also in ``BodyFlow.l`` and the p of translations.

    Attributes
    ----------
    torques : tuple of Vector
        dl/dt of each body, in space axes, N m.
    forces : tuple of Expr
        dp/dt of each coordinate of the translation.
    """

    torques: tuple[Vector, ...]
    forces: tuple[sp.Expr, ...]


@dataclass(frozen=True)
class KickTemplate:
    """One term of V in local symbols, with its kick, and the instances that share it.

    Attributes
    ----------
    bodies : tuple of 4 symbols each
        Local quaternions, each a slot.
    coordinates : tuple of Symbol
        Local coordinates of translation.
    constants : tuple of Symbol
        Local parameters.
    V : Expr
        The term.
    kick : Kick
        Of the term: a torque for each slot, a force for each local coordinate.
    rates : tuple of Symbol
        Local directions: 3 angular velocities W in space axes for each slot, then a velocity for
        each local coordinate.
    slope : Kick
        −2 times the derivative of ``kick`` along ``rates``. With W_b = R S τ of the whole torque τ
        on body b and M⁻¹ times the whole force it sums up to the kick of G.
    instances : tuple of KickInstance
    """

    bodies: tuple[tuple[sp.Symbol, ...], ...]
    coordinates: tuple[sp.Symbol, ...]
    constants: tuple[sp.Symbol, ...]
    V: sp.Expr
    kick: Kick
    rates: tuple[sp.Symbol, ...]
    slope: Kick
    instances: tuple[KickInstance, ...]


@dataclass(frozen=True)
class KickInstance:
    """Indices: bodies in ``Splitting.bodies``, coordinates in ``system.q``, parameters."""

    bodies: tuple[int, ...]
    coordinates: tuple[int, ...]
    constants: tuple[int, ...]


@dataclass(frozen=True)
class Splitting:
    """A Hamiltonian as a sum of parts with closed flows, proved.

    Attributes
    ----------
    system : System
        The system that was split, with its forces.
    bodies : tuple of BodyFlow
    translation : Translation or None
    space : SpaceRotation or None
    V : Expr
        The potential: H at p = 0.
    kick : Kick
        Of V, and of forces that are neither drag nor ``other_forces``.
    conditions : tuple of Expr
        Polynomials of the parameters that must vanish at run time: a body was taken as symmetric.
    has_gradient : bool
        Whether the kick comes from V alone, so that G is defined.
    other_forces : bool
        Whether the kick depends on momenta. Its flow is then approximated, to order 2, and
        compositions have order 2.
    time_dependent : bool
        Whether kicks depend on the time: it advances with the rotations and translations.
    invariants : tuple of (str, Expr)
        Name and J of momentum maps that every part leaves invariant, in q and p of the system.
    """

    system: System
    bodies: tuple[BodyFlow, ...]
    translation: Translation | None
    space: SpaceRotation | None
    V: sp.Expr
    kick: Kick
    conditions: tuple[sp.Expr, ...] = ()
    has_gradient: bool = True
    other_forces: bool = False
    time_dependent: bool = False
    invariants: tuple[tuple[str, sp.Expr], ...] = ()

    @property
    def exact_parts(self) -> int:
        """How many exact flows do not commute: 1 without V, 2 for V and symmetric bodies, …"""
        return (any(e != 0 for n in self.kick.torques for e in n)
                + any(e != 0 for e in self.kick.forces)
                + 1 + max((len(b.further) for b in self.bodies), default=0))

    @property
    def is_exact(self) -> bool:
        """Whether T is one exact flow: compositions of the kinds ABA and RKN keep their order."""
        return not any(body.further for body in self.bodies)

    @property
    def gradient(self) -> Kick:
        """N_G and −G_r, the kick of G; ``kick`` where it is 0."""
        raise NotImplementedError

    @property
    def templates(self) -> tuple[KickTemplate, ...]:
        """The terms of V as templates with their instances: for systems of many equal bodies."""
        raise NotImplementedError
