"""Decomposition of a Hamiltonian into parts with closed flows (``parts``).

1. V is H at p = 0; H − V has to be a polynomial of degree 2 at most in p.
2. With p = 2 L(q)ᵀ m, which holds modulo (|q|² − 1, qᵀp), H − V is a polynomial in q, r, m and p_r
   modulo |q|² = 1. Its normal form is unique, and α and γ vanish from it. It has to be

       Σ_b (½ mᵀ S m + c·m + δ·l) + ½ p_rᵀ M⁻¹ p_r + v·p_r + p_rᵀ A r

   with constant S, c, δ, M, v and A: each is read from the coefficient of one monomial, and the
   remainder must be 0. The error names the first monomial of the remainder: it has no closed flow.
3. S = a I + Σ d e eᵀ with axes e; δ and A are rotations of space.

Equal terms of H of several bodies are processed once (``repeated_structure``).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import chain, combinations_with_replacement
from typing import Any, NamedTuple

import sympy as sp

from ...core.errors import InputError
from ...core.records import dataclass
from ..multibody.rigid_body import left_matrix, rotation_matrix
from ..normal_forms.expansion import TooLongError
from ..normal_forms.terms import Monomial, Terms, expression_of, order, symbols_in, term
from ..symbolic.derivatives import derivative
from ..symbolic.shared_subexpressions import share, substitute
from ..systems.elimination_order import connected_components
from ..systems.lagrangian import LagrangianSystem
from ..systems.repeated_structure import ElementTemplate, Structure
from ..systems.system import System
from .kicks import Vector, shorten_on_unit_sphere
from .parts import (
    AxisRotation,
    BodyFlow,
    Kick,
    KickInstance,
    KickTemplate,
    SpaceRotation,
    Splitting,
    Translation,
)
from .quotient import Quotient, unit_quaternions

__all__ = ["split"]

_ZERO = sp.S.Zero
_ZERO_VECTOR: Vector = (_ZERO, _ZERO, _ZERO)


def split(system: System, *, symmetric: bool = False) -> Splitting:
    """Return the splitting of a system of free bodies and points.

    Parameters
    ----------
    system : System
        A system with the constraints |q|² = 1 of bodies only; in a co-moving frame, H̃ is split.
    symmetric : bool
        Whether the first two moments of each asymmetric body are taken as equal: its rotation is
        then one exact flow, and ``Splitting.conditions`` must hold at run time.

    Raises
    ------
    InputError
        If H − V has another degree in p or has a term without a closed flow, if there are other
        constraints, and for a Lagrangian whose H is not written out.
    """
    if isinstance(system, LagrangianSystem):
        raise InputError(f"System {system.name!r} is from a Lagrangian, and its H is not written "
                         "out; split the system that its legendre() returns.")
    search = _Search(system)
    search.add_hamiltonian()
    return search.splitting(symmetric)


#: Coefficients of H − V by kind and symbols: ("S", m, m'), ("c", m), ("δ", m), ("M", y, y'),
#: ("v", y), ("A", y, r), where m are components of angular momenta and y momenta of points.
_Coefficients = dict[tuple[Any, ...], sp.Expr]


@dataclass(frozen=True)
class _LocalTerm:
    """A term of H in local symbols, with all coordinates of its bodies (slots 0, 1, …).

    Attributes
    ----------
    e : Expr
        The term with p = 2 L(q)ᵀ m.
    q, m : tuple
        Quaternions and angular momenta in body axes, one for each body.
    r, y : tuple of Symbol
        Coordinates of points and their momenta.
    constants : tuple of Symbol
    """

    e: sp.Expr
    q: tuple[tuple[sp.Symbol, ...], ...]
    m: tuple[tuple[sp.Symbol, ...], ...]
    r: tuple[sp.Symbol, ...]
    y: tuple[sp.Symbol, ...]
    constants: tuple[sp.Symbol, ...]

    @property
    def momenta(self) -> set[sp.Symbol]:
        """All momenta."""
        return {*self.y, *(x for m in self.m for x in m)}


class _Search:
    """The decomposition of one system.

    Attributes
    ----------
    quaternions : list of tuple of int
        Indices in q of the quaternion of each body.
    body_of : dict of int to (int, int)
        Index in q → body and component of its quaternion.
    points : tuple of int
        Indices in q of the coordinates of points.
    m, l : list of tuple of Symbol
        Angular momenta of each body, in body axes and in space axes.
    total : dict
        The coefficients of H − V, in these symbols (``_Coefficients``).
    potentials : list of Expr
        The terms of V.
    kicks : dict of KickTemplate to list of KickInstance
        The terms of V that depend on q, and their instances.
    """

    def __init__(self, system: System) -> None:
        """Number bodies, each with four coordinates of q, and name the symbols of m and l."""
        self.system = system
        self.quaternions = _quaternions(system)
        self.body_of = {i: (b, k) for b, indices in enumerate(self.quaternions)
                        for k, i in enumerate(indices)}
        self.points = tuple(i for i in range(system.n) if i not in self.body_of)
        names = {body.q: body.name for body in system.bodies}
        self.names = [names.get(tuple(system.q[i] for i in indices), f"body{b + 1}")
                      for b, indices in enumerate(self.quaternions)]
        reserved = {str(s) for s in (*system.q, *system.p, *system.parameters, system.time)}
        self.m, self.l = ([_new_symbols(f"{name}_{letter}", reserved) for name in self.names]
                          for letter in "ml")
        self.total: _Coefficients = defaultdict(lambda: _ZERO)
        self.potentials: list[sp.Expr] = []
        self.kicks: dict[KickTemplate, list[KickInstance]] = {}

    def add_hamiltonian(self) -> None:
        """Add the coefficients and the potential of each template of H."""
        for template in Structure(self.system).templates:
            for pattern, instances in self._patterns(template).items():
                self._add_template(_local_term(template, pattern), instances)

    def splitting(self, symmetric: bool) -> Splitting:
        """Return the splitting; ``symmetric`` as for ``split``."""
        # (N, k): torque in space axes without the drag −k l; (F, k): force without the drag −k p
        torques = [self._force_on(b) for b in range(len(self.names))]
        forces = [self._force_at(i) for i in self.points]
        bodies = [self._body(b, k) for b, (_, k) in enumerate(torques)]
        conditions: list[sp.Expr] = []
        if symmetric:
            # where its conditions hold, the further rotations of a body are the identity
            conditions = [e for body in bodies for e in body.symmetric_if]
            bodies = [replace(body, further=(), symmetric_if=()) if body.symmetric_if else body
                      for body in bodies]
        applied = Kick(tuple(N for N, _ in torques), tuple(F for F, _ in forces))
        momenta = {*(x for names in self.l for x in names),
                   *(self.system.p[i] for i in self.points)}
        splitting = Splitting(
            system=self.system,
            bodies=tuple(bodies),
            translation=self._translation([k for _, k in forces]),
            space=self._space(),
            V=sp.Add(*self.potentials),
            templates=tuple(replace(kick, instances=tuple(instances))
                            for kick, instances in self.kicks.items()),
            applied=applied,
            conditions=tuple(conditions),
            other_forces=any(e.free_symbols & momenta
                             for e in (*applied.forces, *chain(*applied.torques))))
        return replace(splitting, bodies=_with_steady_axes(splitting))

    def _momentum_index(self, y: sp.Symbol) -> int:
        """Return the index in p of a momentum of a point."""
        return self.system.p.index(y)

    # ------------------------------------------------------------ terms of H

    def _patterns(self, template: ElementTemplate) -> dict[tuple[Any, ...], list[KickInstance]]:
        """Return pattern → its instances.

        A pattern has a pair for each q and p of the template: slot of a body and component of its
        quaternion, or −1 and the number of a coordinate of points. Slots and coordinates are
        numbered in the order in which they occur.
        """
        instances_of: dict[tuple[Any, ...], list[KickInstance]] = defaultdict(list)
        for instance in template.instances:
            bodies: dict[int, int] = {}
            points: dict[int, int] = {}
            pattern = []
            for i in (*instance.q, *instance.p):
                b, k = self.body_of.get(i, (-1, 0))
                if b < 0:
                    pattern.append((-1, points.setdefault(i, len(points))))
                else:
                    pattern.append((bodies.setdefault(b, len(bodies)), k))
            instances_of[tuple(pattern)].append(
                KickInstance(tuple(bodies), tuple(points), instance.constants))
        return instances_of

    def _add_template(self, slots: _LocalTerm, instances: Sequence[KickInstance]) -> None:
        """Add the coefficients, the potential and the kick of a template of H.

        ``slots`` is the template in local symbols, ``instances`` have the indices of the bodies,
        coordinates and constants that take their places.
        """
        V = slots.e
        # a term without momenta belongs to V as a whole
        if V.free_symbols & slots.momenta:
            V = V.xreplace(dict.fromkeys(slots.momenta, _ZERO))
            # errors name the symbols of the first instance
            coefficients = self._coefficients(slots, V, self._instance_symbols(slots, instances[0]))
            for instance in instances:
                symbols_of = self._instance_symbols(slots, instance)
                for (kind, *symbols), e in coefficients.items():
                    self.total[(kind, *(symbols_of[x] for x in symbols))] += e.xreplace(symbols_of)
        if V != 0:
            self.potentials += [V.xreplace(self._instance_symbols(slots, instance))
                                for instance in instances]
        if V.free_symbols & {*slots.r, *(x for q in slots.q for x in q)}:
            kick = KickTemplate(slots.q, slots.r, slots.constants, V)
            self.kicks.setdefault(kick, []).extend(instances)

    def _instance_symbols(
        self, slots: _LocalTerm, instance: KickInstance
    ) -> dict[sp.Symbol, sp.Symbol]:
        """Return slot symbol → symbol of the system, for one instance."""
        q, p, parameters = self.system.q, self.system.p, self.system.parameters
        symbol_of = dict(zip(slots.constants, (parameters[k] for k in instance.constants),
                             strict=True))
        symbol_of |= dict(zip(slots.r, (q[i] for i in instance.coordinates), strict=True))
        symbol_of |= dict(zip(slots.y, (p[i] for i in instance.coordinates), strict=True))
        for q_slot, m_slot, b in zip(slots.q, slots.m, instance.bodies, strict=True):
            symbol_of |= dict(zip(q_slot, (q[i] for i in self.quaternions[b]), strict=True))
            symbol_of |= dict(zip(m_slot, self.m[b], strict=True))
        return symbol_of

    def _coefficients(
        self, slots: _LocalTerm, V: sp.Expr, symbol_of: Mapping[sp.Symbol, sp.Symbol]
    ) -> _Coefficients:
        """Return the coefficients of H − V, by the symbols of the slots.

        First δ·l = δ·R m of each body, whose monomials contain q, is subtracted; then the entries
        of S, M, c, v and A are the coefficients of single monomials. Raises InputError if one
        remains, which has no exact flow; ``symbol_of`` translates it.
        """
        remainder = self._monomial_coefficients(slots, slots.e - V)
        for monomial in remainder:
            self._refuse_degree(monomial, slots.momenta)
        coefficients: _Coefficients = {}
        for q, m in zip(slots.q, slots.m, strict=True):
            delta = _space_rotation(remainder, q, m)
            if any(delta):
                remainder = self._without_rotation(slots, remainder, (q, m), delta)
                coefficients |= {("δ", x): e for x, e in zip(m, delta, strict=True) if e != 0}
        entries = _entries(slots, remainder)
        coefficients |= {key: e for key, (_, e) in entries.items()}
        for monomial, _ in entries.values():
            del remainder[monomial]
        if remainder:  # a term that no part of the decomposition has
            first = term(min(remainder, key=order)).xreplace(symbol_of)
            raise InputError(
                f"H of system {self.system.name!r} has the term {first} times a constant, for "
                "which no exact flow is known: the kinetic energy of exact-flow splitting has "
                "constant coefficients of body axes (m is ½ L(q) p); take another scheme, such "
                "as 'G-L'.")
        return coefficients

    def _without_rotation(
        self, slots: _LocalTerm, coefficients: dict[Monomial, sp.Expr],
        body: tuple[Sequence[sp.Symbol], Sequence[sp.Symbol]], delta: Sequence[sp.Expr],
    ) -> dict[Monomial, sp.Expr]:
        """Return monomial → coefficient without the terms of δ·R(q) m.

        ``coefficients`` belong to H − V before the subtraction, ``body`` is (q, m) of one body, and
        ``delta`` δ.
        """
        q, m = body
        m_in_space = rotation_matrix(q) * sp.Matrix(m)
        rotation = self._monomial_coefficients(slots, _inner_product(delta, m_in_space))
        differences = {
            monomial: sp.expand(coefficients.get(monomial, _ZERO) - rotation.get(monomial, _ZERO))
            for monomial in coefficients | rotation}
        return {monomial: e for monomial, e in differences.items() if e != 0}

    def _monomial_coefficients(self, slots: _LocalTerm, e: sp.Expr) -> dict[Monomial, sp.Expr]:
        """Return monomial → coefficient of the normal form of e, a polynomial in q, r, m and y.

        A monomial is the set of its powers of these symbols. Coefficients are expressions of
        constants that are not 0.
        """
        try:
            terms = Quotient(unit_quaternions(slots.q)).terms(e)
        except TooLongError:
            raise InputError(
                f"System {self.system.name!r} has a kinetic energy that is too long for exact-flow "
                "splitting; take another scheme, such as 'G-L'.") from None
        constants = {*slots.constants}
        terms_of: dict[Monomial, Terms] = defaultdict(dict)
        for powers, a in terms.items():
            # the powers that are not constant; the others, with a, are a term of the coefficient
            monomial = frozenset(
                power for power in powers if not symbols_in([frozenset([power])]) <= constants)
            terms_of[monomial][powers - monomial] = a
        sums = {monomial: expression_of(a) for monomial, a in terms_of.items()}
        return {monomial: e for monomial, e in sums.items() if not _is_zero(e)}

    def _refuse_degree(self, monomial: Monomial, momenta: set[sp.Symbol]) -> None:
        """Refuse a monomial whose degree in the momenta is more than 2, or undefined."""
        degree: int | None = 0
        for x, n in monomial:
            if degree is not None and x in momenta and isinstance(n, int) and n > 0:
                degree += n
            elif symbols_in([frozenset([(x, n)])]) & momenta:
                degree = None
        if degree is None or degree > 2:
            description = "not a polynomial in p" if degree is None else f"of degree {degree} in p"
            raise InputError(
                f"H of system {self.system.name!r} is {description}: exact-flow splitting takes "
                "degree 2 at most; take another scheme, such as 'G-L'.")

    # ------------------------------------------------------------ parts

    def _body(self, b: int, drag: sp.Expr) -> BodyFlow:
        """Return the rotation of body b, with ½ mᵀ S m + c·m in H and S = a I + Σ d e eᵀ."""
        m = self.m[b]
        S = {(i, j): self.total[("S", m[i], m[j])] for i in range(3) for j in range(i, 3)}
        c = [self.total[("c", x)] for x in m]
        rotations = _axis_rotations(self.system.name, self.names[b], S, c)
        symmetric_if = ()
        # one further rotation without an offset: d = 0, two equal moments, makes it the identity
        if [rotation.c for rotation in rotations.further] == [0]:
            symmetric_if = tuple(sp.numer(sp.together(rotation.d))
                                 for rotation in rotations.further)
        return BodyFlow(self.names[b], self.quaternions[b], self.l[b], a=rotations.a,
                        axes=rotations.first, further=rotations.further, drag=drag,
                        symmetric_if=symmetric_if)

    def _translation(self, drag: Sequence[sp.Expr]) -> Translation | None:
        """Return the translation of the points, with T = ½ p_rᵀ M⁻¹ p_r + v·p_r.

        ``drag`` has k of ṗ = −k p for each coordinate of points. None without points.
        """
        if not self.points:
            return None
        inverse_mass: dict[tuple[int, int], sp.Expr] = {}
        velocity: dict[int, sp.Expr] = {}
        for (kind, *symbols), e in self.total.items():
            if kind == "M" and e != 0:
                # M⁻¹ is symmetric, and ``total`` has one entry of each pair of equal ones
                i, j = map(self._momentum_index, symbols)
                inverse_mass[i, j] = inverse_mass[j, i] = e
            elif kind == "v" and e != 0:
                velocity[self._momentum_index(symbols[0])] = e
        return Translation(self.points, inverse_mass, velocity,
                           {i: k for i, k in zip(self.points, drag, strict=True) if k != 0})

    def _space(self) -> tuple[SpaceRotation, ...]:
        """Return the rotations of space −ω·J: δ·l with δ = −ω, and p_rᵀ A r with A = −ω×."""
        # ω → bodies, and points by the indices of their coordinates
        rotations: dict[Vector, tuple[list[int], list[tuple[int, int, int]]]] = defaultdict(
            lambda: ([], []))
        for b, m in enumerate(self.m):
            x, y, z = (-self.total.get(("δ", e), _ZERO) for e in m)
            if (x, y, z) != (0, 0, 0):
                bodies, _ = rotations[x, y, z]
                bodies.append(b)
        # (index in p, index in q) → entry; a key of kind "A" has two symbols: r has one
        A = {(self._momentum_index(y), self.system.q.index(r[0])): e
             for (kind, y, *r), e in self.total.items() if kind == "A" and e != 0}
        # coordinates that A couples belong to one point
        for indices in connected_components([frozenset(entry) for entry in A]):
            i, j, k = (*sorted(indices), -1, -1)[:3]  # k = −1: a point that moves in a plane
            if len(indices) not in (2, 3) or not self._is_rotation(sorted(indices), A):
                row, column = next(entry for entry in A if entry[0] in indices)
                raise InputError(
                    f"H of system {self.system.name!r} has the term {self.system.p[row]}*"
                    f"{self.system.q[column]} times a constant, which is no part of a rotation of "
                    "a point of one mass: no exact flow is known; take another scheme, such as "
                    "'G-L'.")
            omega = (-A.get((k, j), _ZERO), -A.get((i, k), _ZERO), -A.get((j, i), _ZERO))
            _, points = rotations[omega]
            points.append((i, j, k))
        return tuple(SpaceRotation(omega, tuple(bodies), tuple(points))
                     for omega, (bodies, points) in rotations.items())

    def _is_rotation(self, indices: Sequence[int], A: Mapping[tuple[int, int], sp.Expr]) -> bool:
        """Whether A is skew on a point, which has one mass and no velocity v of its own in H.

        Then the rotation commutes with the kinetic energy of the point. ``indices`` are its
        coordinates; A maps (index in p, index in q) to the entry.
        """
        p = self.system.p
        is_skew = all(_is_zero(A.get((i, j), _ZERO) + A.get((j, i), _ZERO))
                      for i, j in combinations_with_replacement(indices, 2))
        inverse_masses = [self.total[("M", p[i], p[i])] for i in indices]
        has_one_mass = all(_is_zero(e - inverse_masses[0]) for e in inverse_masses)
        momenta = {p[i] for i in indices}
        # M⁻¹ off the diagonal; keys of other kinds than "M" may have one symbol: then z is empty
        is_coupled = any(kind == "M" and y != z[0] and {y, z[0]} & momenta and e != 0
                         for (kind, y, *z), e in self.total.items())
        has_velocity = any(self.total.get(("v", p[i]), _ZERO) != 0 for i in indices)
        return is_skew and has_one_mass and not is_coupled and not has_velocity

    # ------------------------------------------------------------ forces

    @cached_property
    def _p_by_m(self) -> dict[sp.Symbol, sp.Expr]:
        """p of bodies as expressions of q and m, p = 2 L(q)ᵀ m."""
        p_by_m: dict[sp.Symbol, sp.Expr] = {}
        for indices, m in zip(self.quaternions, self.m, strict=True):
            p = 2 * left_matrix(self._q(indices)).T * sp.Matrix(m)
            p_by_m |= {self.system.p[i]: e for i, e in zip(indices, p, strict=True)}
        return p_by_m

    @cached_property
    def _m_by_l(self) -> dict[sp.Symbol, sp.Expr]:
        """m of bodies as expressions of q and l, m = R(q)ᵀ l: temporaries in C."""
        m_by_l: dict[sp.Symbol, sp.Expr] = {}
        for indices, m, l_b in zip(self.quaternions, self.m, self.l, strict=True):
            in_body_axes = rotation_matrix(self._q(indices)).T * sp.Matrix(l_b)
            m_by_l |= {x: share(e) for x, e in zip(m, in_body_axes, strict=True)}
        return m_by_l

    def _q(self, indices: Sequence[int]) -> list[sp.Symbol]:
        """Return the coordinates q_i of the indices i."""
        return [self.system.q[i] for i in indices]

    def _force_on(self, b: int) -> tuple[Vector, sp.Expr]:
        """Return the torque N = ½ R L F on a body in space axes, without its drag −k l, and k.

        F is the generalised force on its quaternion, L(q) F/2 the torque in body axes.
        """
        indices, q = self.quaternions[b], self._q(self.quaternions[b])
        force = [self.system.forces[i] for i in indices] if self.system.forces else []
        if not any(force):
            return _ZERO_VECTOR, _ZERO
        torque = left_matrix(q) * sp.Matrix(force).xreplace(self._p_by_m) / 2
        k, remainder = self._split_off_drag(list(torque), self.m[b], q)
        R = rotation_matrix(q)
        # a torque that depends on m is evaluated with m = Rᵀ l as temporaries
        if any(e.free_symbols & self._m_by_l.keys() for e in remainder):
            x, y, z = R * sp.Matrix([share(e) for e in substitute(remainder, self._m_by_l)])
        else:
            x, y, z = shorten_on_unit_sphere(list(R * sp.Matrix(remainder)), [q])
        return (x, y, z), k

    def _force_at(self, i: int) -> tuple[sp.Expr, sp.Expr]:
        """Return the force on a coordinate of a point without its drag, and k of the drag."""
        force = self.system.forces[i].xreplace(self._p_by_m) if self.system.forces else _ZERO
        k, (remainder,) = self._split_off_drag([force], [self.system.p[i]], q=())
        return substitute([remainder], self._m_by_l)[0], k

    def _split_off_drag(
        self, force: Sequence[sp.Expr], momenta: Sequence[sp.Symbol], q: Sequence[sp.Symbol]
    ) -> tuple[sp.Expr, list[sp.Expr]]:
        """Return (k, F + k m) for a force F = −k m + …, with F + k m without momenta m, k constant.

        F is reduced modulo |q|² = 1 of the quaternion ``q`` before; ``q`` is empty for a point. If
        no such k exists, k is 0.
        """
        quotient = Quotient(unit_quaternions([q] if q else []))
        try:
            force = [quotient.expression(e) for e in force]
        except TooLongError:
            return _ZERO, list(force)
        # an isotropic drag has the same k in each component
        k = -derivative(force[0], momenta[0])
        remainder = [sp.expand(e + k * x) for e, x in zip(force, momenta, strict=True)]
        constants = {*self.system.parameters} - {*self.system.inputs}
        if not k.free_symbols <= constants or any(e.free_symbols & {*momenta} for e in remainder):
            return _ZERO, list(force)
        return k, remainder


# ---------------------------------------------------------------- bodies, slots, axes


def _quaternions(system: System) -> list[tuple[int, ...]]:
    """Return the indices of the unit quaternions, scalar first.

    Raises InputError if a constraint is not a multiple of |q|² − 1 of four coordinates, or shares
    them.
    """
    index_of = {x: i for i, x in enumerate(system.q)}
    layouts = {frozenset(body.q): body.q for body in system.bodies}
    quaternions, taken_symbols = [], set[sp.Symbol]()
    for name, g in zip(system.constraint_names, system.constraints, strict=True):
        # the coordinates in g, in the order of a body of the system if it has such a body
        in_order = sorted((x for x in g.free_symbols if x in index_of), key=index_of.__getitem__)
        q = layouts.get(frozenset(g.free_symbols), tuple(in_order))
        square = sp.Add(*(x**2 for x in q), -1)
        expanded = sp.expand(g) if len(q) == 4 else g
        # g = c (|q|² − 1), with c its coefficient of q₀²
        if len(q) != 4 or taken_symbols & {*q} or not _is_zero(
                expanded - expanded.coeff(q[0], 2) * square):
            raise InputError(
                f"System {system.name!r} has the constraint {name!r}, and exact-flow splitting is "
                "for free bodies: |q|² = 1 of a quaternion is the only constraint that it takes; "
                "remove the joint, or take another scheme, such as 'G-L'.")
        taken_symbols |= {*q}
        quaternions.append(tuple(index_of[x] for x in q))
    return quaternions


def _local_term(template: ElementTemplate, pattern: Sequence[tuple[int, int]]) -> _LocalTerm:
    """Return a template in local symbols, with all coordinates of its bodies and m for p.

    ``pattern`` has, for each q, then each p of the template, (slot, component) of a body, or
    (−1, k) for coordinate k of points; see ``_Search._patterns``. p = 2 L(q)ᵀ m of bodies.
    """
    # slots and coordinates are numbered from 0
    body_count = 1 + max((slot for slot, _ in pattern), default=-1)
    point_count = 1 + max((k for slot, k in pattern if slot < 0), default=-1)
    q = tuple(sp.symbols(f"_q{slot}_0:4", real=True) for slot in range(body_count))
    m = tuple(sp.symbols(f"_m{slot}_1:4", real=True) for slot in range(body_count))
    r, y = (tuple(sp.Symbol(f"_{letter}{k}", real=True) for k in range(point_count))
            for letter in "ry")
    p = [list(2 * left_matrix(a).T * sp.Matrix(b)) for a, b in zip(q, m, strict=True)]
    pattern_of_q, pattern_of_p = pattern[:len(template.q)], pattern[len(template.q):]
    local = {x: r[k] if slot < 0 else q[slot][k]
             for x, (slot, k) in zip(template.q, pattern_of_q, strict=True)}
    local |= {x: y[k] if slot < 0 else p[slot][k]
              for x, (slot, k) in zip(template.p, pattern_of_p, strict=True)}
    return _LocalTerm(template.expressions[0].xreplace(local), q, m, r, y, template.constants)


def _space_rotation(
    coefficients: Mapping[Monomial, sp.Expr], q: Sequence[sp.Symbol], m: Sequence[sp.Symbol]
) -> list[sp.Expr]:
    """Return δ of the terms δ·l = δ·R(q) m, from the coefficient of one monomial each."""
    # q0 q3 m2, q0 q1 m3 and q0 q2 m1 occur in one component of R m each, with −2
    return [coefficients.get(frozenset([(q[0], 1), (q[i], 1), (m[j], 1)]), _ZERO) / -2
            for i, j in ((3, 1), (1, 2), (2, 0))]


def _entries(
    slots: _LocalTerm, coefficients: Mapping[Monomial, sp.Expr]
) -> dict[tuple[Any, ...], tuple[Monomial, sp.Expr]]:
    """Return the monomial and the value of each entry of S, M, c, v and A that is not 0, where

        H − V = ½ mᵀ S m + ½ yᵀ M y + cᵀ m + vᵀ y + yᵀ A r

    with angular momenta m of bodies, momenta y and positions r of points.

    ``coefficients`` maps monomials of H − V to their coefficients; keys are as in
    ``_Coefficients``.
    """
    keys: list[tuple[Any, ...]] = [
        ("S", x, y) for m in slots.m for x, y in combinations_with_replacement(m, 2)]
    keys += [("M", x, y) for x, y in combinations_with_replacement(slots.y, 2)]
    keys += [("c", x) for m in slots.m for x in m] + [("v", y) for y in slots.y]
    keys += [("A", y, x) for y in slots.y for x in slots.r]
    entries: dict[tuple[Any, ...], tuple[Monomial, sp.Expr]] = {}
    for kind, *symbols in keys:
        # ½ mᵀ S m has the coefficients ½ S_ii of m_i² and S_ij of m_i m_j
        is_square = kind in "SM" and symbols[0] == symbols[1]
        monomial = frozenset([(symbols[0], 2)] if is_square else [(x, 1) for x in symbols])
        if monomial in coefficients:
            e = coefficients[monomial]
            entries[kind, *symbols] = monomial, 2 * e if is_square else e
    return entries


class _AxisRotations(NamedTuple):
    """½ mᵀ S m + c·m as ½ a |m|² and the rotations ½ d (e·m)² + c e·m about axes e.

    Each commutes with ½ a |m|², but not with the others, so that only the first (or none) belongs
    to the flow of free rotation.
    """

    a: sp.Expr
    first: tuple[AxisRotation, ...]
    further: tuple[AxisRotation, ...]


def _axis_rotations(
    system: str, body: str, S: Mapping[tuple[int, int], sp.Expr], c: Sequence[sp.Expr]
) -> _AxisRotations:
    """Return the axis rotations of ½ mᵀ S m + c·m.

    Raises InputError if S is neither diagonal nor a I + b e eᵀ.
    """
    a, axes = _eigenaxes(system, body, S)
    rotations = [AxisRotation(e, d, _inner_product(e, c)) for e, d in axes]
    # the component of c perpendicular to the axes has a rotation of its own, ½ 0 (e·m)² + |c| e·m
    across = [sp.expand(x - sum(rotation.c * rotation.axis[k] for rotation in rotations))
              for k, x in enumerate(c)]
    if not all(map(_is_zero, across)):
        nonzero = [k for k, x in enumerate(across) if x != 0]
        if len(nonzero) == 1:  # without a root, and with the sign of c
            k, = nonzero
            rotations.append(AxisRotation(_unit_vector(k), d=_ZERO, c=across[k]))
        else:
            length = sp.sqrt(sp.Add(*(x**2 for x in across)))
            rotations.append(AxisRotation(
                (across[0] / length, across[1] / length, across[2] / length), d=_ZERO, c=length))
    return _AxisRotations(a, tuple(rotations[:1]), tuple(rotations[1:]))


def _eigenaxes(
    system: str, body: str, S: Mapping[tuple[int, int], sp.Expr]
) -> tuple[sp.Expr, list[tuple[Vector, sp.Expr]]]:
    """Return a and the pairs (e, d) of S = a I + Σ d e eᵀ, the axis of symmetry first.

    ``S`` has the entries (i, j) with i ≤ j of a symmetric 3 × 3 matrix. Raises InputError if S is
    neither diagonal nor a I + b e eᵀ.
    """
    x, y, z = S[0, 0], S[1, 1], S[2, 2]
    if S[0, 1] == S[0, 2] == S[1, 2] == 0:
        # S = x I + (z − x) e₃ e₃ᵀ + (y − x) e₂ e₂ᵀ has one axis where two entries are equal
        a, axes = (y, [(0, x - y)]) if _is_zero(y - z) else (x, [(2, z - x), (1, y - x)])
        return a, [(_unit_vector(k), d) for k, d in axes if not _is_zero(d)]
    products = [S[0, 1] * S[0, 2], S[0, 1] * S[1, 2], S[0, 2] * S[1, 2]]
    if all(e != 0 for e in products):  # S = a I + b e eᵀ has S_01 S_02/S_12 = b e_0²
        squares = [products[0] / S[1, 2], products[1] / S[0, 2], products[2] / S[0, 1]]
        a = x - squares[0]
        if _is_zero(y - squares[1] - a) and _is_zero(z - squares[2] - a):
            row = sp.Matrix([squares[0], S[0, 1], S[0, 2]])  # of b e eᵀ: a multiple of e
            length = sp.sqrt(sp.Add(*(entry**2 for entry in row)))
            return a, [((row[0] / length, row[1] / length, row[2] / length),
                        sp.Add(*squares))]
    raise InputError(
        f"Body {body!r} of system {system!r} has an inertia tensor that is not diagonal, and "
        "exact-flow splitting needs principal axes: give its three moments in principal axes, or "
        "take another scheme, such as 'G-L'.")


def _unit_vector(k: int) -> Vector:
    """Return the unit vector along coordinate axis k."""
    e = [sp.Integer(int(k == i)) for i in range(3)]
    return e[0], e[1], e[2]


def _inner_product(e: Sequence[sp.Expr], c: Sequence[sp.Expr]) -> sp.Expr:
    """Return the inner product e·c."""
    return sp.Add(*(x * y for x, y in zip(e, c, strict=True)))


def _is_zero(e: sp.Expr) -> bool:
    """Whether a rational expression of constants is 0."""
    return bool(e == 0 or sp.expand(sp.numer(sp.together(e))) == 0)


def _new_symbols(prefix: str, reserved: set[str]) -> tuple[sp.Symbol, ...]:
    """Return three symbols with names that are not reserved."""
    while any(f"{prefix}{k}" in reserved for k in (1, 2, 3)):
        prefix += "_"
    x, y, z = (sp.Symbol(f"{prefix}{k}", real=True) for k in (1, 2, 3))
    return x, y, z


def _with_steady_axes(splitting: Splitting) -> tuple[BodyFlow, ...]:
    """Return the bodies of a splitting, with ``steady`` of each of their axes."""
    # body → (template, slot) of the terms of V that depend on its attitude
    slots: dict[int, set[tuple[int, int]]] = defaultdict(set)
    for k, template in enumerate(splitting.templates):
        for instance in template.instances:
            for slot, b in enumerate(instance.bodies):
                slots[b].add((k, slot))
    torque_free: dict[tuple[int, int, Vector], bool] = {}  # equal bodies are examined once
    bodies: list[BodyFlow] = []
    for b, body in enumerate(splitting.bodies):
        axes = tuple(replace(axis, steady=_is_steady(splitting, b, axis, slots[b], torque_free))
                     for axis in body.axes)
        bodies.append(replace(body, axes=axes))
    return tuple(bodies)


def _is_steady(
    splitting: Splitting, b: int, axis: AxisRotation, slots: set[tuple[int, int]],
    torque_free: dict[tuple[int, int, Vector], bool],
) -> bool:
    """Whether e·m of a body is an invariant of every part: no torque acts about the axis.

    ``slots`` has the (template, slot) pairs of the body in V; ``torque_free`` caches whether the
    torque N on a slot has no component along the axis, (R e)·N = 0.
    """
    body = splitting.bodies[b]
    # other rotations, drag and torques of applied forces change e·m
    if body.further or body.drag != 0 or any(splitting.applied.torques[b]):
        return False
    for k, slot in sorted(slots):
        key = k, slot, axis.axis
        if key not in torque_free:
            template = splitting.templates[k]
            axis_in_space = rotation_matrix(template.bodies[slot]) * sp.Matrix(axis.axis)
            torque_free[key] = Quotient(unit_quaternions(template.bodies)).vanishes(
                axis_in_space.dot(sp.Matrix(template.kick.torques[slot])))
        if not torque_free[key]:
            return False
    return True
