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

a function of q and r. The kick of V + κ h² G is one kick with N + κ h² N_G in place of N; the
field of G is −[V, [T, V]] of the fields of T and V.

Source: McLachlan and Quispel, Splitting methods, Acta Numerica 11 (2002); Chin, Physics Letters A
226 (1997) 344, for G.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import sympy as sp

from ...core.records import dataclass
from ..multibody.rigid_body import rotation_matrix
from ..symbolic.derivatives import derivative
from ..symbolic.shared_subexpressions import Shared, share
from ..systems.system import System
from .kicks import Vector, derivatives_along, shorten_on_unit_sphere, space_torque

__all__ = ["AxisRotation", "BodyFlow", "Kick", "KickInstance", "KickTemplate", "SpaceRotation",
           "Splitting", "Translation"]

_ZERO = sp.S.Zero


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
        Name of the body.
    q : tuple of 4 int
        Indices of its quaternion in ``system.q``, scalar first.
    l : tuple of 3 Symbol
        Its angular momentum in space axes, in expressions of kicks.
    a : Expr
        The coefficient a of ½ a |m|², in 1/(kg m²).
    axes : tuple of AxisRotation
        At most one: with ½ a |m|² it is one exact flow, for the two commute.
    further : tuple of AxisRotation
        Rotations that do not commute with ``axes``, of an asymmetric body or of a gyrostat whose
        wheel is not on the axis of symmetry. Their flows are composed into the middle of a kick:
        each over half the time, in this order and then in reverse order.
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
    """The part −ω·J of a rotating frame, which commutes with every other part of T.

    Attributes
    ----------
    omega : Vector
        ω in space axes, in rad/s.
    bodies : tuple of int
        Indices in ``Splitting.bodies``.
    points : tuple of 3 int each
        Indices in ``system.q`` of the coordinates of the rotated points. A third index −1: the
        point moves in a plane at the rate ω₃.
    """

    omega: Vector
    bodies: tuple[int, ...]
    points: tuple[tuple[int, int, int], ...]


@dataclass(frozen=True)
class Kick:
    """Rates of the momenta due to a potential or to forces, at fixed q and r.

    Expressions in ``system.q``, parameters, time and inputs; if the splitting has
    ``other_forces``, also in ``BodyFlow.l`` and in ``system.p`` of points. Parts that recur may be
    temporaries (``shared_subexpressions.Shared``).

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
class KickInstance:
    """Indices of an instance of a template.

    Attributes
    ----------
    bodies : tuple of int
        In ``Splitting.bodies``, one for each slot.
    coordinates : tuple of int
        In ``system.q``.
    constants : tuple of int
        In ``system.parameters``.
    """

    bodies: tuple[int, ...]
    coordinates: tuple[int, ...]
    constants: tuple[int, ...]


@dataclass(frozen=True)
class KickTemplate:
    """One term of V in local symbols, and the instances that share it.

    Attributes
    ----------
    bodies : tuple of 4 symbols each
        Local quaternions, one for each slot.
    coordinates : tuple of Symbol
        Local coordinates of points.
    constants : tuple of Symbol
        Local parameters.
    V : Expr
        The term.
    instances : tuple of KickInstance
    """

    bodies: tuple[tuple[sp.Symbol, ...], ...]
    coordinates: tuple[sp.Symbol, ...]
    constants: tuple[sp.Symbol, ...]
    V: sp.Expr
    instances: tuple[KickInstance, ...] = ()

    @cached_property
    def kick(self) -> Kick:
        """The kick of the term: a torque for each slot, a force for each local coordinate."""
        torques = [space_torque(q, [-derivative(self.V, x) for x in q]) for q in self.bodies]
        forces = [-derivative(self.V, x) for x in self.coordinates]
        return _shorten(torques, forces, self.bodies)


def _shorten(torques: Sequence[Sequence[sp.Expr]], forces: Sequence[sp.Expr],
             quaternions: Sequence[Sequence[sp.Symbol]]) -> Kick:
    """Return a kick of all torques and forces, in a form with fewer operations on |q| = 1."""
    # all together, as torques and forces share subexpressions
    components = iter(shorten_on_unit_sphere([*(e for N in torques for e in N), *forces],
                                             quaternions))
    short_torques = tuple((next(components), next(components), next(components)) for _ in torques)
    return Kick(short_torques, tuple(components))


def _angular_velocity(body: BodyFlow, q: Sequence[sp.Symbol], N: Vector) -> list[sp.Expr]:
    """Return W = R S Rᵀ N = a N + Σ d (c·N) c with c = R e; a temporary unless all c·N are 0."""
    W, R = body.a * sp.Matrix(N), rotation_matrix(q)
    for axis in (*body.axes, *body.further):
        c = R * sp.Matrix(axis.axis)
        c_dot_N = sp.Add(*(x * y for x, y in zip(c, N, strict=True)))
        projection, = shorten_on_unit_sphere([c_dot_N], [q])
        if projection != 0:
            W += axis.d * share(projection) * c
    return list(W) if not W.has(Shared) else list(map(share, W))


@dataclass(frozen=True)
class Splitting:
    """A Hamiltonian as a sum of parts with closed flows.

    Attributes
    ----------
    system : System
        The system that was split, with its forces.
    bodies : tuple of BodyFlow
    translation : Translation or None
    space : tuple of SpaceRotation
        One for each ω; empty without any.
    V : Expr
        The potential, H at p = 0.
    templates : tuple of KickTemplate
        The terms of V that depend on q, with their instances, whose kicks add up to the kick of V.
    applied : Kick
        Forces that are neither drag nor derived from V.
    conditions : tuple of Expr
        Polynomials of the parameters that must vanish at run time: bodies were taken as symmetric.
    other_forces : bool
        Whether ``applied`` depends on momenta. Its flow is then approximated, to order 2, and
        compositions have order 2. Otherwise kicks are exact flows and no order is lost.
    """

    system: System
    bodies: tuple[BodyFlow, ...]
    translation: Translation | None
    space: tuple[SpaceRotation, ...]
    V: sp.Expr
    templates: tuple[KickTemplate, ...]
    applied: Kick
    conditions: tuple[sp.Expr, ...] = ()
    other_forces: bool = False

    @property
    def is_exact(self) -> bool:
        """Whether T is one exact flow: compositions of the kinds ABA and RKN keep their order."""
        return not any(body.further for body in self.bodies)

    @property
    def has_gradient(self) -> bool:
        """Whether ``gradient`` may be used: T is one exact flow and kicks depend on q and t only.

        Drag, −ω·J, linear terms and the time add nothing to [V, [T, V]].
        """
        return self.is_exact and not self.other_forces

    @property
    def highest_order(self) -> int | None:
        """The highest order of a composition of symmetric steps; None if there is no limit."""
        return 2 if self.other_forces else None

    @cached_property
    def time_dependent(self) -> bool:
        """Whether kicks depend on the time, which advances with rotations and translations."""
        kick = self.kick
        return any(self.system.time in e.free_symbols
                   for e in (*(e for N in kick.torques for e in N), *kick.forces))

    @cached_property
    def quaternions(self) -> tuple[tuple[sp.Symbol, ...], ...]:
        """The quaternion of each body."""
        return tuple(tuple(self.system.q[i] for i in body.q) for body in self.bodies)

    @cached_property
    def points(self) -> tuple[int, ...]:
        """Indices of the coordinates that are no quaternions."""
        return self.translation.coordinates if self.translation else ()

    @cached_property
    def kick(self) -> Kick:
        """The torque N of each body and the force of each coordinate, of V and of ``applied``.

        The kicks of all instances of templates are added, in the symbols of the system.
        """
        # terms of each component of a torque, and of each force by the index of its coordinate
        torques = [[[e] for e in N] for N in self.applied.torques]
        forces = {i: [e] for i, e in zip(self.points, self.applied.forces, strict=True)}
        for template in self.templates:
            for instance in template.instances:
                symbol_of = self._symbols(template, instance)
                for b, N in zip(instance.bodies, template.kick.torques, strict=True):
                    for terms, e in zip(torques[b], N, strict=True):
                        terms.append(e.xreplace(symbol_of))
                for i, e in zip(instance.coordinates, template.kick.forces, strict=True):
                    forces[i].append(e.xreplace(symbol_of))
        sums = [[sp.Add(*terms) for terms in body_torques] for body_torques in torques]
        return Kick(tuple((x, y, z) for x, y, z in sums),
                    tuple(sp.Add(*forces[i]) for i in self.points))

    def _symbols(
        self, template: KickTemplate, instance: KickInstance
    ) -> dict[sp.Symbol, sp.Symbol]:
        """Return local symbol → symbol of the system, for one instance of a template."""
        q, parameters = self.system.q, self.system.parameters
        symbol_of = dict(zip(template.coordinates, (q[i] for i in instance.coordinates),
                             strict=True))
        symbol_of |= dict(zip(template.constants, (parameters[i] for i in instance.constants),
                              strict=True))
        for slot, b in zip(template.bodies, instance.bodies, strict=True):
            symbol_of |= dict(zip(slot, self.quaternions[b], strict=True))
        return symbol_of

    @cached_property
    def gradient(self) -> Kick:
        """The kick of the force gradient: N_G of each body and −G_r of each point.

        It is −2 times the derivative of ``kick`` along W.

        W = R S Rᵀ N and the velocity M⁻¹ F are computed from the kick itself. It is the field of
        −[F, [T, F]] for any forces F; if F is the force of a potential V, G is its potential.
        """
        rates = {}
        for body, q, N in zip(self.bodies, self.quaternions, self.kick.torques, strict=True):
            W = _angular_velocity(body, q, N)
            rates[q] = W[0], W[1], W[2]
        force = dict(zip(self.points, self.kick.forces, strict=True))
        inverse_mass = self.translation.inverse_mass if self.translation else {}
        velocities = dict.fromkeys(self.points, _ZERO)
        for (i, j), e in inverse_mass.items():
            velocities[i] += e * share(force[j])
        speeds = {self.system.q[i]: e for i, e in velocities.items()}
        torques = [[-2 * e for e in derivatives_along(N, rates, speeds)]
                   for N in self.kick.torques]
        forces = [-2 * e for e in derivatives_along(self.kick.forces, rates, speeds)]
        return _shorten(torques, forces, self.quaternions)
