"""Co-moving frames: the symmetries along which a stepper may move, proved, and H̃ = H − Σ ω_i J_i.

Let q → e^{θA} q, p → e^{−θAᵀ} p leave H, g = 0 and forces as they are, with J = pᵀA q. In
coordinates that turn along with it, q = e^{ωtA} q̃ and p = e^{−ωtAᵀ} p̃, the motion is that of

    H̃ = H − ω J,   the same g,   multipliers λ = C(ωt)⁻ᵀ λ̃,   where g(e^{θA} q) = C(θ) g(q),

for any number ω. A method that is applied to H̃ and turned back keeps its order, stays symplectic
and symmetric, and keeps every quadratic J that commutes; what H has of a motion along A costs it
nothing, and a relative equilibrium of rate ω is solved exactly (docs/frames.md).

    {J, H} = pᵀA H_p − (A q)·H_q = 0     for all q, p, where the parameters meet the conditions
    g_q A q = C g                        for all q
    F_q A q − F_p Aᵀp + AᵀF = 0          F turns with the frame

Symmetries are tried in this order: each body's own axes, everything about an axis of space, then
whatever else has a name and commutes with all that were taken.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations

import sympy as sp
from sympy import QQ
from sympy.polys.matrices import DomainMatrix

from ...core.arguments import few
from ...core.errors import InputError
from ..symbolic.bounded_algebra import is_small
from ..symbolic.derivatives import derivative
from ..symbolic.finite_fields import exactly, identically_zero
from ..symbolic.shared_subexpressions import substitute
from ..systems.lagrangian import LagrangianSystem
from ..systems.moving_frame import CoMovingSystem, in_sums
from ..systems.system import System
from .linear_fields import LinearField, known_fields, motions_of_space
from .rotations import Rotation, commute, rotation_of
from .symmetry_conditions import SymmetrySpace

__all__ = ["CoMovingFrame", "FrameSymmetry", "frame_of"]

#: So many conditions on parameters a symmetry may have: a body's own axis has four at the most,
#: where its inertia is a tensor.
_MOST_CONDITIONS = 4
#: Up to so many coordinates rotations of each pair of them are tried.
_FEW = 6


@dataclass(frozen=True, eq=False)
class FrameSymmetry:
    """A symmetry that a stepper's frame may move along.

    Attributes
    ----------
    name : str
        Of the parameter ω, e.g. omega_body.
    field : Field
        X(q) = A q.
    rotation : Rotation
        The same, to be turned back.
    turns : Rotation or None
        −C_Aᵀ with g_q A q = C_A g, the rotation of the multipliers; None if g is invariant.
    conditions : tuple of Expr
        Polynomials of the parameters; all of them vanish where this is a symmetry.
    """

    name: str
    field: LinearField
    rotation: Rotation
    turns: Rotation | None
    conditions: tuple[sp.Expr, ...]

    def momentum(self, system: System) -> sp.Expr:
        """J = pᵀA q."""
        return self.field.momentum(system.q, system.p)


@dataclass(frozen=True, eq=False)
class CoMovingFrame:
    """The symmetries of a stepper, in groups that commute with each other.

    A group is one symmetry, or the three rotations of a system that is free in space: these do not
    commute, and turn as one about the axis ω.
    """

    groups: tuple[tuple[FrameSymmetry, ...], ...]

    @property
    def symmetries(self) -> list[FrameSymmetry]:
        """All of them."""
        return [symmetry for group in self.groups for symmetry in group]

    def rates(self) -> list[sp.Symbol]:
        """The parameters ω."""
        return [sp.Symbol(symmetry.name, real=True) for symmetry in self.symmetries]

    def moving(self, system: System) -> System:
        """Return the system in the frame: H̃ in place of H, which stays as its energy."""
        rates = self.rates()
        lost = [rate * part for rate, symmetry in zip(rates, self.symmetries, strict=True)
                for part in in_sums(symmetry.momentum(system), system.H)]
        frame_velocity = [sp.Add(*(rate * sp.diff(symmetry.momentum(system), p)
                                   for rate, symmetry in zip(rates, self.symmetries, strict=True)))
                          for p in system.p]
        power = [f * v for f,
                 v in zip(system.forces, frame_velocity, strict=False) if f != 0 and v != 0]
        works = bool(power) and not identically_zero([power])
        parts = {part.name: getattr(system, part.name) for part in dataclasses.fields(System)}
        return CoMovingSystem(**parts | {
            "parameters": (*system.parameters, *rates), "energy": system.H,
            "frame_velocity": tuple(frame_velocity) if works else (),
            "H": sp.Add(system.H, *(-e for e in lost))})


def frame_of(system: System) -> CoMovingFrame:
    """Return the frame that a system has.

    Raises
    ------
    InputError
        If no symmetry is found that a frame can move along.
    """
    if system.is_time_dependent:
        raise InputError(f"System {system.name!r} has time in H or in a constraint, which a "
                         "co-moving frame does not know; leave out frame, or time.")
    if system.velocity_count:
        raise InputError(f"System {system.name!r} has the velocity constraints "
                         f"{few(system.velocity_constraint_names)}, which a co-moving frame does "
                         "not know; leave out frame.")
    if isinstance(system, LagrangianSystem):
        raise InputError(f"System {system.name!r} is from a Lagrangian, and its H is not written "
                         "out: leave out frame, or take the system that its legendre() returns.")
    search = _SymmetrySearch(system)
    groups = [*search.bodies(), *search.space(), *search.others()]
    if not groups:
        raise InputError(
            f"System {system.name!r} has no co-moving frame: no rotation was found that leaves H, "
            f"g{' and forces' if system.forces else ''} as they are; leave out frame.")
    return CoMovingFrame(tuple(groups))


class _SymmetrySearch:
    """The search for symmetries, one after the other."""

    def __init__(self, system: System) -> None:
        self.system = replace(system, forces=(), time=None, quantities={}, inputs=())
        self.inputs = system.inputs
        self.forces = system.forces
        self.taken: list[LinearField] = []
        self.names = {str(s) for s in (*system.q, *system.p, *system.parameters)}
        self.count = 0
        self.kept = self._unconditional(list(self._candidates()))

    def _candidates(self) -> Iterator[LinearField]:
        """Yield the fields with names, and rotations of pairs of coordinates."""
        yield from (field for field in known_fields(self.system) if not field.a.any())
        n = self.system.n
        for i, j in combinations(range(n), 2) if n <= _FEW else ():
            name = f"rotation of ({self.system.q[i]}, {self.system.q[j]})"
            yield LinearField(name, n, {(j, i): Fraction(1), (i, j): Fraction(-1)})

    def _unconditional(self, fields: list[LinearField]) -> dict[str, LinearField]:
        """Return the symmetries for any parameters, by name."""
        space = SymmetrySpace(self.system, fields, {})
        return {field.name: field for field in fields if space.contains(field)}

    # ------------------------------------------------------------ the kinds of them

    def bodies(self) -> Iterator[tuple[FrameSymmetry]]:
        """Yield the own axis of each body: of fewest conditions, the third before the others."""
        named = {body.q: body.name for body in self.system.bodies}
        spins = [f for f in self._candidates() if ", the" not in f.name and "axis" in f.name]
        blocks: dict[tuple[int, ...], list[LinearField]] = {}
        for field in spins:
            blocks.setdefault(tuple(sorted({i for i, _ in field.weights})), []).append(field)
        for block, fields in blocks.items():
            body = named.get(tuple(self.system.q[i] for i in block), "")
            name = "omega_body" if len(blocks) == 1 else f"omega_{body}" if body else ""
            yield from self._first(name, reversed(fields))

    def space(self) -> Iterator[tuple[FrameSymmetry, ...]]:
        """Yield the rotation of everything about e3, or another axis; about all if it is free."""
        turns = [field for field in motions_of_space(self.system) if field.A.any()]
        if len(turns) == 3 and all(field.name in self.kept for field in turns):
            found = [self._symmetry(f"omega_space_{k}", field, ()) for k, field in
                     enumerate(turns, 1)]
            if all(found):
                self.taken += turns
                yield tuple(symmetry for symmetry in found if symmetry is not None)
                return
        yield from self._first("omega_space", reversed(turns))

    def others(self) -> Iterator[tuple[FrameSymmetry]]:
        """Yield further symmetries for any parameters that commute with all before."""
        for field in self.kept.values():
            yield from self._first("", [field])

    def _first(self, name: str, fields: Sequence[LinearField] | Iterator[LinearField]) -> Iterator[
            tuple[FrameSymmetry]]:
        """Yield the symmetry of fewest conditions, if there is one; the first of several."""
        new = [field for field in fields if self._is_new(field)]
        found: list[FrameSymmetry] = []
        for field in sorted(new, key=lambda field: field.name not in self.kept):
            conditions = self._conditions(field)
            symmetry = None if conditions is None else self._symmetry(name, field, conditions)
            found += [] if symmetry is None else [symmetry]
            if symmetry is not None and len(symmetry.conditions) <= 1:
                break
        if found:
            best = min(found, key=lambda symmetry: len(symmetry.conditions))
            self.taken.append(best.field)
            yield (replace(best, name=self._name(name)),)

    def _name(self, name: str) -> str:
        while not name or name in self.names:
            self.count += 1
            name = f"omega_{self.count}"
        self.names.add(name)
        return name

    def _is_new(self, field: LinearField) -> bool:
        """Whether a field commutes with those that were taken and is no combination of them."""
        return (all(commute(field.weights, f.weights) for f in self.taken)
                and _independent([*self.taken, field]))

    # ------------------------------------------------------------ proofs

    def _symmetry(
        self, name: str, field: LinearField, conditions: tuple[sp.Expr, ...]
    ) -> FrameSymmetry | None:
        """Return a field as a symmetry, if it turns in closed form, g with it, and F as well."""
        rotation, slide = rotation_of(field.weights), self._slide(field)
        if rotation is None or slide is None or not self._turns_forces(field):
            return None
        turns = rotation_of(slide) if slide else None
        if slide and turns is None:
            return None
        return FrameSymmetry(name, field, rotation, turns, conditions)

    def _conditions(self, field: LinearField) -> tuple[sp.Expr, ...] | None:
        """Return the conditions on parameters for {J, H} = 0; None if none are found."""
        if field.name in self.kept:
            return ()
        has_inputs = {*self.inputs}
        part = self._moved_part(field)
        coefficients = _bracket_coefficients(part, field)
        if coefficients is None:
            return None
        found: list[sp.Expr] = []
        solved: dict[sp.Symbol, sp.Expr] = {}
        for e in coefficients:
            rest = sp.numer(sp.together(e.xreplace(solved)))
            condition = None if sp.expand(rest) == 0 else _linear_factor(rest)
            if condition is None and sp.expand(rest) != 0:
                return None
            if condition is not None:
                found.append(condition)
                symbol = _solvable(condition)
                solution = sp.solve(condition, symbol)[0]
                solved = {s: x.xreplace({symbol: solution})
                          for s, x in solved.items()} | {symbol: solution}
            if len(found) > _MOST_CONDITIONS:
                return None
        meets = replace(part, H=substitute([part.H], solved)[0],
                        constraints=tuple(substitute(list(part.constraints), solved)))
        if any(e.free_symbols & has_inputs for e in found):
            return None  # inputs change from step to step
        return tuple(found) if SymmetrySpace(meets, [field], {}).contains(field) else None

    def _moved_part(self, field: LinearField) -> System:
        """Return the system with the terms of H and the constraints that a field changes."""
        system = self.system
        moved = {s for i, j in field.weights for s in (system.q[i], system.p[j])}
        return replace(
            system, H=sp.Add(*(e for e in sp.Add.make_args(system.H) if e.free_symbols & moved)),
            constraints=tuple(g for g in system.constraints if g.free_symbols & moved),
            constraint_names=())

    def _slide(self, field: LinearField) -> dict[tuple[int, int], Fraction] | None:
        """Return −C_Aᵀ with g_q A q = C_A g, empty if g is invariant; None if there is none."""
        system = self.system
        image = [sp.Add(*(sp.Rational(x.numerator, x.denominator) * system.q[j]
                          for (i, j), x in field.weights.items() if i == k))
                 for k in range(system.n)]
        found: dict[tuple[int, int], Fraction] = {}
        for k, row in enumerate(system.G):
            terms = [exactly(a) * x for a, x in zip(row, image, strict=True) if a != 0 and x != 0]
            if identically_zero([terms]):
                continue
            factors = self._combination(sp.Add(*terms))
            if factors is None:
                return None
            found |= {(m, k): -x for m, x in factors.items()}
        return found

    def _combination(self, slide: sp.Expr) -> dict[int, Fraction] | None:
        """Return the numbers c with slide = Σ c_k g_k, all polynomials."""
        system = self.system
        near = [k for k, g in enumerate(system.constraints) if g.free_symbols & slide.free_symbols]
        parts = (slide, *(system.constraints[k] for k in near))
        symbols = sorted(set[sp.Symbol]().union(*(e.free_symbols for e in parts)), key=str)
        if not all(e.is_polynomial(*symbols) for e in parts):
            return None
        wanted = sp.Poly(exactly(slide), *symbols)
        known = [sp.Poly(exactly(system.constraints[k]), *symbols) for k in near]
        monomials = sorted(set(wanted.monoms()).union(*(g.monoms() for g in known)))
        matrix = sp.Matrix([[g.coeff_monomial(x) for g in known] for x in monomials])
        right = sp.Matrix([wanted.coeff_monomial(x) for x in monomials])
        unknown = sp.symbols(f"_c0:{len(near)}")
        solution = sp.linsolve((matrix, right), *unknown)
        if not solution:
            return None
        values = [e.xreplace(dict.fromkeys(unknown, sp.Integer(0))) for e in next(iter(solution))]
        return {k: Fraction(int(x.p), int(x.q)) for k, x in zip(near, values, strict=True) if x}

    def _turns_forces(self, field: LinearField) -> bool:
        """Whether F turns with the frame."""
        if not self.forces:
            return True
        q, p = self.system.q, self.system.p
        J = field.momentum(q, p)
        to_q, to_p = ([sp.diff(J, x) for x in side] for side in (p, q))
        sums: list[list[sp.Expr]] = []
        for k, f in enumerate(self.forces):
            turned = [self.forces[i] * sp.Rational(x.numerator, x.denominator)
                      for (i, j), x in field.weights.items() if j == k]
            sums.append([*(sp.diff(f, s) * x for s, x in zip(q, to_q, strict=True)),
                         *(-sp.diff(f, s) * x for s, x in zip(p, to_p, strict=True)), *turned])
        return bool(identically_zero([terms for terms in sums if any(e != 0 for e in terms)]))


def _independent(fields: Sequence[LinearField]) -> bool:
    """Whether no field is a combination of the others; few of their n² entries are not 0."""
    places = sorted({place for field in fields for place in field.weights})
    rows = [[QQ(x.numerator, x.denominator) if (x := field.weights.get(place)) else QQ(0)
             for place in places] for field in fields]
    return bool(DomainMatrix(rows, (len(fields), len(places)), QQ).rank() == len(fields))


def _bracket_coefficients(system: System, field: LinearField) -> list[sp.Expr] | None:
    """Return the coefficients of {J, H} as a polynomial of q and p; None if it is none."""
    J = field.momentum(system.q, system.p)
    slopes = {s: sp.diff(J, s) for s in (*system.q, *system.p)}
    found: dict[tuple[sp.Expr, ...], sp.Expr] = {}
    for term in sp.Add.make_args(exactly(system.H)):
        free = term.free_symbols
        bracket = sp.Add(*(slopes[q] * derivative(term, p) for q, p in zip(system.q, system.p,
                                                                            strict=True)
                           if p in free),
                         *(-slopes[p] * derivative(term, q) for q, p in zip(system.q, system.p,
                                                                             strict=True)
                           if q in free))
        symbols = sorted(bracket.free_symbols & slopes.keys(), key=str)
        if not is_small(bracket) or not bracket.is_polynomial(*symbols):
            return None
        for powers, x in sp.Poly(bracket, *symbols).terms() if symbols else ():
            monomial = tuple(s**n for s, n in zip(symbols, powers, strict=True) if n)
            found[monomial] = found.get(monomial, sp.Integer(0)) + x
    return sorted({sp.together(x) for x in found.values()}, key=sp.default_sort_key)


def _linear_factor(e: sp.Expr) -> sp.Expr | None:
    """Return the factor of a polynomial that may vanish, one for which a symbol can be solved."""
    for factor, _ in sp.factor_list(e)[1]:
        if not factor.is_nonzero and _solvable(factor) is not None:
            return _signed(factor)
    return None


def _solvable(e: sp.Expr) -> sp.Symbol | None:
    """Return the last symbol in which e is linear with a number as its factor."""
    for symbol in sorted(e.free_symbols, key=str, reverse=True):
        slope = sp.diff(e, symbol)
        if slope.is_number and slope != 0:
            found: sp.Symbol = symbol
            return found
    return None


def _signed(e: sp.Expr) -> sp.Expr:
    """Return e or −e, the one whose first symbol by name has a positive factor."""
    first = min(e.free_symbols, key=str)
    return -e if sp.diff(e, first).is_negative else e


