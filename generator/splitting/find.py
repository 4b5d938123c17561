"""The search for a splitting of a Hamiltonian into parts with closed flows (``parts``).

1. V is H at p = 0; H − V has to be a polynomial of degree 2 at most in p.
2. With p = 2 L(q)ᵀ m, which holds modulo (|q|² − 1, qᵀp), H − V is a polynomial in q, r, m and p_r
   modulo |q|² = 1. Its normal form is unique, and α and γ vanish from it. It has to be

       Σ_b (½ mᵀ S m + c·m + δ·l) + ½ p_rᵀ M⁻¹ p_r + v·p_r + p_rᵀ A r

   with constant S, c, δ, M, v and A: each is read from the coefficient of one monomial, and what is
   left must be 0. The first monomial that is left over names what has no closed flow.
3. S = a I + Σ d e eᵀ with axes e; δ and A make rotations of space.

Terms of H of equal form are treated once (``repeated_structure``).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, combinations_with_replacement
from typing import Any

import sympy as sp

from ...core.errors import InputError
from ..multibody.rigid_body import left_matrix, rotation_matrix
from ..normal_forms.expansion import TooLongError
from ..normal_forms.terms import Monomial, Terms, expression_of, order, symbols_in, term
from ..symbolic.derivatives import derivative
from ..symbolic.shared_subexpressions import share, substitute
from ..systems.elimination_order import connected
from ..systems.lagrangian import LagrangianSystem
from ..systems.repeated_structure import ElementTemplate, Structure
from ..systems.system import System
from .kicks import Vector, shortened
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
_NONE: Vector = (_ZERO, _ZERO, _ZERO)


def split(system: System, *, symmetric: bool = False) -> Splitting:
    """Return the splitting of a system of free bodies and points.

    Parameters
    ----------
    system : System
        Its constraints are |q|² = 1 of bodies; of a co-moving frame, H is that of the frame.
    symmetric : bool
        Take the first two moments of each asymmetric body as equal: its rotation is then one exact
        flow, and ``Splitting.conditions`` must hold at run time.

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
    search.take_hamiltonian()
    return search.splitting(symmetric)


#: Coefficients of H − V: ("S", m, m'), ("c", m), ("δ", m), ("M", y, y'), ("v", y), ("A", y, r) with
#: momenta m of bodies and y of points.
_Coefficients = dict[tuple[Any, ...], sp.Expr]


@dataclass(frozen=True)
class _Slots:
    """A template of H in which bodies have all their coordinates.

    Attributes
    ----------
    e : Expr
        The template with p = 2 L(q)ᵀ m.
    q, m : tuple
        Quaternions and m of the bodies.
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
    """The search in one system."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.quaternions = _quaternions(system)
        self.body_of = {i: (b, k) for b, places in enumerate(self.quaternions)
                        for k, i in enumerate(places)}
        self.points = tuple(i for i in range(system.n) if i not in self.body_of)
        names = {body.q: body.name for body in system.bodies}
        self.names = [names.get(tuple(system.q[i] for i in places), f"body{b + 1}")
                      for b, places in enumerate(self.quaternions)]
        taken = {str(s) for s in (*system.q, *system.p, *system.parameters, system.time)}
        self.m, self.l = ([_fresh(f"{name}_{letter}", taken) for name in self.names]
                          for letter in "ml")
        self.total: _Coefficients = defaultdict(lambda: _ZERO)
        self.potentials: list[sp.Expr] = []
        self.kicks: dict[KickTemplate, list[KickInstance]] = {}

    def take_hamiltonian(self) -> None:
        """Take the coefficients and the potential of H, template by template."""
        for template in Structure(self.system).templates:
            for pattern, instances in self._patterns(template).items():
                self._take(_slots(template, pattern), instances)

    def splitting(self, symmetric: bool) -> Splitting:
        """Return the splitting."""
        torques = [self._force_on(b) for b in range(len(self.names))]
        forces = [self._force_at(i) for i in self.points]
        bodies = [self._body(b, k) for b, (_, k) in enumerate(torques)]
        conditions = [e for body in bodies for e in body.symmetric_if] if symmetric else []
        if symmetric:
            bodies = [replace(body, further=(), symmetric_if=()) if body.symmetric_if else body
                      for body in bodies]
        applied = Kick(tuple(N for N, _ in torques), tuple(F for F, _ in forces))
        momenta = {*(x for names in self.l for x in names),
                   *(self.system.p[i] for i in self.points)}
        found = Splitting(
            self.system, tuple(bodies), self._translation([k for _, k in forces]), self._space(),
            sp.Add(*self.potentials),
            tuple(replace(kick, instances=tuple(at)) for kick, at in self.kicks.items()),
            applied, tuple(conditions),
            any(e.free_symbols & momenta for e in (*applied.forces, *chain(*applied.torques))))
        slots: dict[int, set[tuple[int, int]]] = defaultdict(set)
        for k, template in enumerate(found.templates):
            for at in template.instances:
                for slot, b in enumerate(at.bodies):
                    slots[b].add((k, slot))
        turned: dict[tuple[int, int, Vector], bool] = {}
        return replace(found, bodies=tuple(
            replace(body, axes=tuple(replace(axis, steady=_is_steady(
                found, b, axis, slots[b], turned)) for axis in body.axes))
            for b, body in enumerate(bodies)))

    def _at(self, y: sp.Symbol) -> int:
        return self.system.p.index(y)

    # ------------------------------------------------------------ terms of H

    def _patterns(self, template: ElementTemplate) -> dict[tuple[Any, ...], list[KickInstance]]:
        """Return instances by their coordinates: slot and component of a body, −1 and a point."""
        found: dict[tuple[Any, ...], list[KickInstance]] = defaultdict(list)
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
            found[tuple(pattern)].append(
                KickInstance(tuple(bodies), tuple(points), instance.constants))
        return found

    def _take(self, slots: _Slots, instances: Sequence[KickInstance]) -> None:
        """Take a template of H: its coefficients, its potential and its kick."""
        V = slots.e
        if V.free_symbols & slots.momenta:
            V = V.xreplace(dict.fromkeys(slots.momenta, _ZERO))
            found = self._coefficients(slots, V, self._own(slots, instances[0]))
            for instance in instances:
                own = self._own(slots, instance)
                for (kind, *symbols), e in found.items():
                    self.total[(kind, *(own[x] for x in symbols))] += e.xreplace(own)
        if V != 0:
            self.potentials += [V.xreplace(self._own(slots, at)) for at in instances]
        if V.free_symbols & {*slots.r, *(x for q in slots.q for x in q)}:
            kick = KickTemplate(slots.q, slots.r, slots.constants, V)
            self.kicks.setdefault(kick, []).extend(instances)

    def _own(self, slots: _Slots, at: KickInstance) -> dict[sp.Symbol, sp.Symbol]:
        """Return the symbols of an instance, by those of the slots."""
        q, p, constants = self.system.q, self.system.p, self.system.parameters
        own = dict(zip(slots.constants, (constants[k] for k in at.constants), strict=True))
        own |= dict(zip(slots.r, (q[i] for i in at.coordinates), strict=True))
        own |= dict(zip(slots.y, (p[i] for i in at.coordinates), strict=True))
        for q_slot, m_slot, b in zip(slots.q, slots.m, at.bodies, strict=True):
            own |= dict(zip(q_slot, (q[i] for i in self.quaternions[b]), strict=True))
            own |= dict(zip(m_slot, self.m[b], strict=True))
        return own

    def _coefficients(
        self, slots: _Slots, V: sp.Expr, own: Mapping[sp.Symbol, sp.Symbol]
    ) -> _Coefficients:
        """Return the coefficients of H − V.

        Raises
        ------
        InputError
            Naming the first monomial that is left over.
        """
        rest = self._by_shape(slots, slots.e - V)
        for shape in rest:
            self._refuse_degree(shape, slots.momenta)
        found: _Coefficients = {}
        for q, m in zip(slots.q, slots.m, strict=True):
            # q0 q3 m2, q0 q1 m3 and q0 q2 m1 occur in one component of R m each, with −2
            delta = [rest.get(frozenset([(q[0], 1), (q[i], 1), (m[j], 1)]), _ZERO) / -2
                     for i, j in ((3, 1), (1, 2), (2, 0))]
            if any(delta):
                turned = rotation_matrix(q) * sp.Matrix(m)
                part = self._by_shape(slots, sp.Add(*(d * e for d, e in zip(delta, turned,
                                                                           strict=True))))
                rest = {shape: e for shape in rest | part for e in [sp.expand(
                    rest.get(shape, _ZERO) - part.get(shape, _ZERO))] if e != 0}
                found |= {("δ", x): e for x, e in zip(m, delta, strict=True) if e != 0}
        wanted: list[tuple[Any, ...]] = [
            ("S", x, y) for m in slots.m for x, y in combinations_with_replacement(m, 2)]
        wanted += [("M", x, y) for x, y in combinations_with_replacement(slots.y, 2)]
        wanted += [("c", x) for m in slots.m for x in m] + [("v", y) for y in slots.y]
        wanted += [("A", y, x) for y in slots.y for x in slots.r]
        for kind, *symbols in wanted:
            twice = kind in "SM" and symbols[0] == symbols[1]
            e = rest.pop(frozenset([(symbols[0], 2)] if twice else ((x, 1) for x in symbols)), None)
            if e is not None:
                found[kind, *symbols] = 2 * e if twice else e
        if rest:
            first = term(min(rest, key=order)).xreplace(own)
            raise InputError(
                f"H of system {self.system.name!r} has the term {first} times a constant, for "
                "which no exact flow is known: the kinetic energy of exact-flow splitting has "
                "constant coefficients of body axes (m is ½ L(q) p); take another scheme, such "
                "as 'G-L'.")
        return found

    def _by_shape(self, slots: _Slots, e: sp.Expr) -> dict[Monomial, sp.Expr]:
        """Return the coefficients in constants of the monomials of the normal form."""
        try:
            terms = Quotient(unit_quaternions(slots.q)).terms(e)
        except TooLongError:
            raise InputError(
                f"System {self.system.name!r} has a kinetic energy that is too long for exact-flow "
                "splitting; take another scheme, such as 'G-L'.") from None
        constants, found = {*slots.constants}, defaultdict[Monomial, Terms](dict)
        for m, a in terms.items():
            shape = frozenset(x for x in m if not symbols_in([frozenset([x])]) <= constants)
            found[shape][m - shape] = a
        sums = {shape: expression_of(part) for shape, part in found.items()}
        return {shape: e for shape, e in sums.items() if not _is_zero(e)}

    def _refuse_degree(self, shape: Monomial, momenta: set[sp.Symbol]) -> None:
        degree: int | None = 0
        for x, n in shape:
            if degree is not None and x in momenta and isinstance(n, int) and n > 0:
                degree += n
            elif symbols_in([frozenset([(x, n)])]) & momenta:
                degree = None
        if degree is None or degree > 2:
            said = "not a polynomial in p" if degree is None else f"of degree {degree} in p"
            raise InputError(
                f"H of system {self.system.name!r} is {said}: exact-flow splitting takes degree 2 "
                "at most; take another scheme, such as 'G-L'.")

    # ------------------------------------------------------------ parts

    def _body(self, b: int, drag: sp.Expr) -> BodyFlow:
        """Return the rotation of a body: S = a I + Σ d e eᵀ."""
        m = self.m[b]
        S = {(i, j): self.total[("S", m[i], m[j])] for i in range(3) for j in range(i, 3)}
        c = [self.total[("c", x)] for x in m]
        a, main, further = _axes(self.system.name, self.names[b], S, c)
        condition = ()
        if [axis.c for axis in further] == [0]:
            condition = tuple(sp.numer(sp.together(axis.d)) for axis in further)
        return BodyFlow(self.names[b], self.quaternions[b], self.l[b], a, main, further, drag,
                        condition)

    def _translation(self, drag: Sequence[sp.Expr]) -> Translation | None:
        """Return the motion of the points, with k of each."""
        if not self.points:
            return None
        found = {kind: {tuple(map(self._at, y)): e for (kind_, *y), e in self.total.items()
                        if kind_ == kind and e != 0} for kind in "Mv"}
        mass = {at: e for (i, j), e in found["M"].items() for at in ((i, j), (j, i))}
        return Translation(self.points, mass, {i: e for (i,), e in found["v"].items()},
                           {i: k for i, k in zip(self.points, drag, strict=True) if k != 0})

    def _space(self) -> tuple[SpaceRotation, ...]:
        """Return the rotations of space: −ω·J has δ = −ω, and A = −ω× for points."""
        found: dict[Vector, tuple[list[int], list[tuple[int, int, int]]]] = defaultdict(
            lambda: ([], []))
        for b, m in enumerate(self.m):
            x, y, z = (-self.total.get(("δ", e), _ZERO) for e in m)
            if (x, y, z) != (0, 0, 0):
                found[x, y, z][0].append(b)
        A = {(self._at(y), self.system.q.index(x[0])): e
             for (kind, y, *x), e in self.total.items() if kind == "A" and e != 0}
        for part in connected([frozenset(place) for place in A]):
            i, j, k = (*sorted(part), -1, -1)[:3]
            if len(part) not in (2, 3) or not self._is_rotation(sorted(part), A):
                y, x = next(place for place in A if place[0] in part)
                raise InputError(
                    f"H of system {self.system.name!r} has the term {self.system.p[y]}*"
                    f"{self.system.q[x]} times a constant, which is no part of a rotation of a "
                    "point of one mass: no exact flow is known; take another scheme, such as "
                    "'G-L'.")
            omega = (-A.get((k, j), _ZERO), -A.get((i, k), _ZERO), -A.get((j, i), _ZERO))
            found[omega][1].append((i, j, k))
        return tuple(SpaceRotation(omega, tuple(bodies), tuple(points))
                     for omega, (bodies, points) in found.items())

    def _is_rotation(
        self, part: Sequence[int], A: Mapping[tuple[int, int], sp.Expr]
    ) -> bool:
        """Whether A is skew on a point, and commutes with its kinetic energy."""
        p = self.system.p
        skew = all(_is_zero(A.get((i, j), _ZERO) + A.get((j, i), _ZERO))
                   for i, j in combinations_with_replacement(part, 2))
        mass = [self.total[("M", p[i], p[i])] for i in part]
        mixed = any(kind == "M" and y != z[0] and {self._at(y), self._at(z[0])} & {*part}
                    and e != 0 for (kind, y, *z), e in self.total.items())
        drifts = any(self.total.get(("v", p[i]), _ZERO) != 0 for i in part)
        return skew and not mixed and not drifts and all(_is_zero(e - mass[0]) for e in mass)

    # ------------------------------------------------------------ forces

    @cached_property
    def _momenta(self) -> dict[sp.Symbol, sp.Expr]:
        """p of bodies by q and m."""
        return {self.system.p[i]: e for places, m in zip(self.quaternions, self.m, strict=True)
                for i, e in zip(places, 2 * left_matrix(self._q(places)).T * sp.Matrix(m),
                                strict=True)}

    @cached_property
    def _in_space(self) -> dict[sp.Symbol, sp.Expr]:
        """m of bodies by q and l: Rᵀ l, a temporary of the C."""
        return {x: share(e) for places, m, found in zip(
                    self.quaternions, self.m, self.l, strict=True)
                for x, e in zip(m, rotation_matrix(self._q(places)).T * sp.Matrix(found),
                                strict=True)}

    def _q(self, places: Sequence[int]) -> list[sp.Symbol]:
        return [self.system.q[i] for i in places]

    def _force_on(self, b: int) -> tuple[Vector, sp.Expr]:
        """Return the torque on a body without its isotropic drag, and k of the drag."""
        places, q = self.quaternions[b], self._q(self.quaternions[b])
        force = [self.system.forces[i] for i in places] if self.system.forces else []
        if not any(force):
            return _NONE, _ZERO
        torque = left_matrix(q) * sp.Matrix(force).xreplace(self._momenta) / 2
        k, rest = self._drag(list(torque), self.m[b], q)
        R = rotation_matrix(q)
        if any(e.free_symbols & self._in_space.keys() for e in rest):
            x, y, z = R * sp.Matrix([share(e) for e in substitute(rest, self._in_space)])
        else:
            x, y, z = shortened(list(R * sp.Matrix(rest)), [q])
        return (x, y, z), k

    def _force_at(self, i: int) -> tuple[sp.Expr, sp.Expr]:
        """Return the force on a coordinate of a point without its drag, and k of the drag."""
        force = self.system.forces[i].xreplace(self._momenta) if self.system.forces else _ZERO
        k, (rest,) = self._drag([force], [self.system.p[i]], ())
        return substitute([rest], self._in_space)[0], k

    def _drag(
        self, force: Sequence[sp.Expr], momenta: Sequence[sp.Symbol], q: Sequence[sp.Symbol]
    ) -> tuple[sp.Expr, list[sp.Expr]]:
        """Return k and F + k m, for the constant k that makes it free of these momenta, or 0."""
        quotient = Quotient(unit_quaternions([q] if q else []))
        try:
            force = [quotient.expression(e) for e in force]
        except TooLongError:
            return _ZERO, list(force)
        k = -derivative(force[0], momenta[0])
        rest = [sp.expand(e + k * x) for e, x in zip(force, momenta, strict=True)]
        constant = {*self.system.parameters} - {*self.system.inputs}
        if not k.free_symbols <= constant or any(e.free_symbols & {*momenta} for e in rest):
            return _ZERO, list(force)
        return k, rest


# ---------------------------------------------------------------- bodies, slots, axes


def _quaternions(system: System) -> list[tuple[int, ...]]:
    """Return the indices of the unit quaternions, scalar first; refuse other constraints."""
    place = {x: i for i, x in enumerate(system.q)}
    layouts = {frozenset(body.q): body.q for body in system.bodies}
    found, taken = [], set[sp.Symbol]()
    for name, g in zip(system.constraint_names, system.constraints, strict=True):
        q = layouts.get(frozenset(g.free_symbols), tuple(sorted(
            (x for x in g.free_symbols if x in place), key=place.__getitem__)))
        square = sp.Add(*(x**2 for x in q), -1)
        rest = sp.expand(g) if len(q) == 4 else g
        if len(q) != 4 or taken & {*q} or not _is_zero(rest - rest.coeff(q[0], 2) * square):
            raise InputError(
                f"System {system.name!r} has the constraint {name!r}, and exact-flow splitting is "
                "for free bodies: |q|² = 1 of a quaternion is the only constraint that it takes; "
                "remove the joint, or take another scheme, such as 'G-L'.")
        taken |= {*q}
        found.append(tuple(place[x] for x in q))
    return found


def _slots(template: ElementTemplate, pattern: Sequence[tuple[int, int]]) -> _Slots:
    """Return a template with all coordinates of its bodies, and m in place of p."""
    count = 1 + max((slot for slot, _ in pattern), default=-1)
    points = 1 + max((k for slot, k in pattern if slot < 0), default=-1)
    q = tuple(sp.symbols(f"_q{slot}_0:4", real=True) for slot in range(count))
    m = tuple(sp.symbols(f"_m{slot}_1:4", real=True) for slot in range(count))
    r, y = (tuple(sp.Symbol(f"_{letter}{k}", real=True) for k in range(points))
            for letter in "ry")
    p = [list(2 * left_matrix(a).T * sp.Matrix(b)) for a, b in zip(q, m, strict=True)]
    symbols = (*template.q, *template.p)
    names = {x: (r if at < len(template.q) else y)[k] if slot < 0
             else (q if at < len(template.q) else p)[slot][k]
             for at, (x, (slot, k)) in enumerate(zip(symbols, pattern, strict=True))}
    return _Slots(template.expressions[0].xreplace(names), q, m, r, y, template.constants)


def _axes(
    system: str, body: str, S: Mapping[tuple[int, int], sp.Expr], c: Sequence[sp.Expr]
) -> tuple[sp.Expr, tuple[AxisRotation, ...], tuple[AxisRotation, ...]]:
    """Return a, the axis rotation that is run with ½ a |m|², and those beyond it.

    Raises
    ------
    InputError
        If S is neither diagonal nor a I + b e eᵀ.
    """
    a, axes = _eigenaxes(system, body, S)
    rates = [AxisRotation(e, d, _inner(e, c)) for e, d in axes]
    rest = [sp.expand(x - sum(axis.c * axis.axis[k] for axis in rates)) for k, x in enumerate(c)]
    if not all(map(_is_zero, rest)):  # c has a part across the axes
        length = sp.sqrt(sp.Add(*(x**2 for x in rest)))
        only = [k for k, x in enumerate(rest) if x != 0]
        if len(only) == 1:
            rates.append(AxisRotation(_unit(only[0]), _ZERO, rest[only[0]]))
        else:
            rates.append(AxisRotation((rest[0] / length, rest[1] / length, rest[2] / length),
                                      _ZERO, length))
    return a, tuple(rates[:1]), tuple(rates[1:])


def _eigenaxes(
    system: str, body: str, S: Mapping[tuple[int, int], sp.Expr]
) -> tuple[sp.Expr, list[tuple[Vector, sp.Expr]]]:
    """Return a and the axes e with d of S = a I + Σ d e eᵀ, that of symmetry first."""
    x, y, z = S[0, 0], S[1, 1], S[2, 2]
    if S[0, 1] == S[0, 2] == S[1, 2] == 0:
        if _is_zero(x - y):
            a, found = x, [(2, z - x)]
        elif _is_zero(x - z):
            a, found = x, [(1, y - x)]
        elif _is_zero(y - z):
            a, found = y, [(0, x - y)]
        else:
            a, found = x, [(2, z - x), (1, y - x)]
        return a, [(_unit(k), d) for k, d in found if not _is_zero(d)]
    products = [S[0, 1] * S[0, 2], S[0, 1] * S[1, 2], S[0, 2] * S[1, 2]]
    if all(e != 0 for e in products):
        squares = [products[0] / S[1, 2], products[1] / S[0, 2], products[2] / S[0, 1]]
        a = x - squares[0]
        if _is_zero(y - squares[1] - a) and _is_zero(z - squares[2] - a):
            row = sp.Matrix([squares[0], S[0, 1], S[0, 2]])
            length = sp.sqrt(sp.Add(*(e**2 for e in row)))
            return a, [((row[0] / length, row[1] / length, row[2] / length),
                        sp.Add(*squares))]
    raise InputError(
        f"Body {body!r} of system {system!r} has an inertia tensor that is not diagonal, and "
        "exact-flow splitting needs principal axes: give its three moments in principal axes, or "
        "take another scheme, such as 'G-L'.")


def _unit(k: int) -> Vector:
    e = [sp.Integer(int(k == i)) for i in range(3)]
    return e[0], e[1], e[2]


def _inner(e: Sequence[sp.Expr], c: Sequence[sp.Expr]) -> sp.Expr:
    return sp.Add(*(x * y for x, y in zip(e, c, strict=True)))


def _is_zero(e: sp.Expr) -> bool:
    """Whether a rational expression of constants is 0."""
    return bool(e == 0 or sp.expand(sp.numer(sp.together(e))) == 0)


def _fresh(prefix: str, taken: set[str]) -> tuple[sp.Symbol, ...]:
    """Return three symbols whose names no system has."""
    while any(f"{prefix}{k}" in taken for k in (1, 2, 3)):
        prefix += "_"
    x, y, z = (sp.Symbol(f"{prefix}{k}", real=True) for k in (1, 2, 3))
    return x, y, z


def _is_steady(
    splitting: Splitting, b: int, axis: AxisRotation, slots: set[tuple[int, int]],
    known: dict[tuple[int, int, Vector], bool],
) -> bool:
    """Whether every part leaves e·m of a body as it is: no torque acts about the axis.

    ``slots`` are those of the body in the templates of V, ``known`` are earlier results.
    """
    body = splitting.bodies[b]
    if body.further or body.drag != 0 or any(splitting.applied.torques[b]):
        return False
    for at in sorted(slots):
        if (*at, axis.axis) not in known:
            template = splitting.templates[at[0]]
            turned = rotation_matrix(template.bodies[at[1]]) * sp.Matrix(axis.axis)
            known[*at, axis.axis] = Quotient(unit_quaternions(template.bodies)).vanishes(
                turned.dot(sp.Matrix(template.kick.torques[at[1]])))
        if not known[*at, axis.axis]:
            return False
    return True
