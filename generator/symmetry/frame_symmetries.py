"""Co-moving frames: symmetries of a system, proved exactly, and H̃ = H − Σ ω_i J_i.

Let q → e^{θA} q, p → e^{−θAᵀ} p leave H, g = 0 and forces invariant, with J = pᵀA q. In rotating
coordinates, q = e^{ωtA} q̃ and p = e^{−ωtAᵀ} p̃, the equations of motion have

    H̃ = H − ω J,   the same g,   multipliers λ = C(ωt)⁻ᵀ λ̃,   where g(e^{θA} q) = C(θ) g(q),

for any number ω. A method that is applied to H̃ and transformed back keeps its order, its
symplecticity, its symmetry and every quadratic J that commutes. Motion along A has no error, so
that a relative equilibrium of rate ω is solved exactly (docs/frames.md).

    {J, H} = pᵀA H_p − (A q)·H_q = 0     for all q, p, where the parameters meet the conditions
    g_q A q = C g                        for all q
    F_q A q − F_p Aᵀp + AᵀF = 0          F turns with the frame

Symmetries are tried in this order: rotations about the axes of each body, rotations of the whole
system about an axis of space, then all other named fields that commute with the selected ones.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import combinations
from typing import Any

import sympy as sp
from sympy import QQ
from sympy.polys.matrices import DomainMatrix

from ...core.arguments import few
from ...core.errors import InputError
from ...core.incompatibilities import refuse_together
from ...core.records import dataclass
from ..symbolic.bounded_algebra import is_small
from ..symbolic.derivatives import derivative
from ..symbolic.finite_fields import exactly, identically_zero
from ..symbolic.shared_subexpressions import substitute
from ..systems.lagrangian import LagrangianSystem
from ..systems.moving_frame import CoMovingSystem, in_sums
from ..systems.system import System
from .linear_fields import LinearField, known_fields, motions_of_space, spins_of_bodies
from .rotations import Rotation, commute, rotation_of
from .symmetry_conditions import SymmetrySpace

__all__ = ["CoMovingFrame", "FrameSymmetry", "frame_of"]

#: Largest number of conditions of a symmetry on parameters: the axis of a body has at most four,
#: if its inertia is a full tensor.
_MOST_CONDITIONS = 4
#: Largest number of coordinates for which the rotations of all pairs are tried.
_MOST_PAIRED = 6


@dataclass(frozen=True, eq=False)
class FrameSymmetry:
    """A symmetry X(q) = A q of a co-moving frame, with the rate ω.

    Attributes
    ----------
    name : str
        Name of the parameter ω, e.g. omega_body.
    field : LinearField
        X(q) = A q.
    rotation : Rotation
        A as a rotation, which gives e^{θA} in closed form.
    turns : Rotation or None
        −C_Aᵀ with g_q A q = C_A g, the rotation of the multipliers; None if g is invariant.
    conditions : tuple of Expr
        Polynomials of the parameters; X is a symmetry if all of them vanish.
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
    commute, and are combined to one rotation about the axis ω.
    """

    groups: tuple[tuple[FrameSymmetry, ...], ...]

    @property
    def symmetries(self) -> list[FrameSymmetry]:
        """The symmetries of all groups."""
        return [symmetry for group in self.groups for symmetry in group]

    def rates(self) -> list[sp.Symbol]:
        """The parameters ω."""
        return [sp.Symbol(symmetry.name, real=True) for symmetry in self.symmetries]

    def moving(self, system: System) -> System:
        """Return the system in the frame, with H̃ in place of H; H is its ``energy``."""
        rates = self.rates()
        momenta = [symmetry.momentum(system) for symmetry in self.symmetries]
        # Σ ω J, each J divided as the sums of H are, so that equal terms combine
        frame_terms = [rate * term for rate, J in zip(rates, momenta, strict=True)
                       for term in in_sums(J, system.H)]
        # Σ ω A q, as J_p = A q
        frame_velocity = [sp.Add(*(rate * sp.diff(J, p)
                                   for rate, J in zip(rates, momenta, strict=True)))
                          for p in system.p]
        # forces, of which there may be none, do work on the motion of the frame; without such a
        # work C needs no frame velocity
        power = [f * v for f, v in zip(system.forces, frame_velocity, strict=False)
                 if f != 0 and v != 0]
        does_work = bool(power) and not identically_zero([power])
        fields = {x.name: getattr(system, x.name) for x in dataclasses.fields(System)}
        return CoMovingSystem(**fields | {
            "parameters": (*system.parameters, *rates), "energy": system.H,
            "frame_velocity": tuple(frame_velocity) if does_work else (),
            "H": sp.Add(system.H, *(-e for e in frame_terms))})


def frame_of(system: System) -> CoMovingFrame:
    """Return the frame that a system has.

    Raises InputError if the system has no symmetry for a co-moving frame.
    """
    # the name of each feature in an error; False if the system does not have it
    refuse_together(
        frame="a co-moving frame",
        time=system.is_time_dependent and f"time in H or in a constraint of {system.name!r}",
        velocity_constraints=system.velocity_count > 0 and f"the velocity constraints "
        f"{few(system.velocity_constraint_names)} of {system.name!r}",
        lagrangian=isinstance(system, LagrangianSystem) and f"the Lagrangian of {system.name!r}")
    search = _SymmetrySearch(system)
    # the order decides which of several symmetries that do not commute are taken
    groups = [*search.bodies(), *search.space(), *search.other_symmetries()]
    if not groups:
        raise InputError(
            f"System {system.name!r} has no co-moving frame: no rotation was found that leaves H, "
            f"g{' and forces' if system.forces else ''} as they are; leave out frame.")
    return CoMovingFrame(tuple(groups))


class _SymmetrySearch:
    """The search for the symmetries of a frame; each must commute with the ones before."""

    def __init__(self, system: System) -> None:
        """Search the symmetries of H and g; forces and inputs are tested with these later."""
        self.system = replace(system, forces=(), time=None, quantities={}, inputs=())
        self.forces = system.forces
        self.frame_fields: list[LinearField] = []
        self.names = {str(s) for s in (*system.q, *system.p, *system.parameters)}
        self.unnamed_count = 0
        self.unconditional = self._unconditional_symmetries(list(self._candidates()))

    def _candidates(self) -> Iterator[LinearField]:
        """Yield the named fields A q, and the rotations of pairs of few coordinates.

        A frame turns and does not translate: a field A q + a with a ≠ 0 is none of it.
        """
        yield from (field for field in known_fields(self.system) if not field.a.any())
        n = self.system.n
        for i, j in combinations(range(n), 2) if n <= _MOST_PAIRED else ():
            name = f"rotation of ({self.system.q[i]}, {self.system.q[j]})"
            yield LinearField(name, n, {(j, i): Fraction(1), (i, j): Fraction(-1)})

    def _unconditional_symmetries(self, fields: list[LinearField]) -> dict[str, LinearField]:
        """Return the fields that are symmetries for any parameters, by name."""
        space = SymmetrySpace(self.system, fields, numbers={})
        return {field.name: field for field in fields if space.contains(field)}

    # ------------------------------------------------------------ kinds of symmetries

    def bodies(self) -> Iterator[tuple[FrameSymmetry]]:
        """Yield a rotation about a body axis for each body, with the fewest conditions.

        If several have as few, axis 3 comes first, then 2, then 1.
        """
        name_of = {body.q: body.name for body in self.system.bodies}
        spins_of: dict[tuple[int, ...], list[LinearField]] = {}  # by the indices of a quaternion
        for field in spins_of_bodies(self.system):
            spins_of.setdefault(tuple(sorted({i for i, _ in field.weights})), []).append(field)
        for indices, fields in spins_of.items():
            body = name_of.get(tuple(self.system.q[i] for i in indices), "")
            name = "omega_body" if len(spins_of) == 1 else f"omega_{body}" if body else ""
            yield from self._with_fewest_conditions(name, reversed(fields))

    def space(self) -> Iterator[tuple[FrameSymmetry, ...]]:
        """Yield the rotation of the system about e3, or e2 or e1; about all three if it is free."""
        rotations = [field for field in motions_of_space(self.system) if field.A.any()]
        # the three rotations of space do not commute with each other; as one group, with one axis
        # and one rate, they move the frame nevertheless
        if len(rotations) == 3 and all(field.name in self.unconditional for field in rotations):
            symmetries = [self._symmetry(f"omega_space_{k}", field, conditions=())
                          for k, field in enumerate(rotations, 1)]
            if all(symmetries):
                self.frame_fields += rotations
                yield tuple(symmetry for symmetry in symmetries if symmetry is not None)
                return
        yield from self._with_fewest_conditions("omega_space", reversed(rotations))

    def other_symmetries(self) -> Iterator[tuple[FrameSymmetry]]:
        """Yield the other symmetries for any parameters, as far as they commute."""
        for field in self.unconditional.values():
            yield from self._with_fewest_conditions(name="", fields=[field])

    def _with_fewest_conditions(
        self, name: str, fields: Sequence[LinearField] | Iterator[LinearField]
    ) -> Iterator[tuple[FrameSymmetry]]:
        """Yield the symmetry with the fewest conditions on parameters, the first of several.

        Yields nothing if no field is a symmetry. The field is added to those of the frame, and its
        rate has the ``name``, or a number if that is in use.
        """
        candidates = [field for field in fields if self._is_new(field)]
        symmetries: list[FrameSymmetry] = []
        # False sorts first: fields that need no condition
        for field in sorted(candidates, key=lambda field: field.name not in self.unconditional):
            conditions = self._conditions(field)
            symmetry = None if conditions is None else self._symmetry(name, field, conditions)
            if symmetry is None:
                continue
            symmetries.append(symmetry)
            # one condition, such as I1 = I2, is the fewest that any of the others needs
            if len(symmetry.conditions) <= 1:
                break
        if symmetries:
            chosen_symmetry = min(symmetries, key=lambda symmetry: len(symmetry.conditions))
            self.frame_fields.append(chosen_symmetry.field)
            yield (replace(chosen_symmetry, name=self._unused_name(name)),)

    def _unused_name(self, name: str) -> str:
        """Return the name of a rate, omega_1 and so on where a name is empty or in use."""
        while not name or name in self.names:
            self.unnamed_count += 1
            name = f"omega_{self.unnamed_count}"
        self.names.add(name)
        return name

    def _is_new(self, field: LinearField) -> bool:
        """Whether a field commutes with the selected fields and is linearly independent."""
        return (all(commute(field.weights, f.weights) for f in self.frame_fields)
                and _are_independent([*self.frame_fields, field]))

    # ------------------------------------------------------------ proofs

    def _symmetry(
        self, name: str, field: LinearField, conditions: tuple[sp.Expr, ...]
    ) -> FrameSymmetry | None:
        """Return a field as a symmetry; None if it is no rotation, or g or F do not rotate."""
        rotation, matrix = rotation_of(field.weights), self._multiplier_matrix(field)
        if rotation is None or matrix is None or not self._rotates_forces(field):
            return None
        if not matrix:  # g is invariant, and multipliers do not rotate
            return FrameSymmetry(name, field, rotation, turns=None, conditions=conditions)
        turns = rotation_of(matrix)
        if turns is None:
            return None
        return FrameSymmetry(name, field, rotation, turns, conditions)

    def _conditions(self, field: LinearField) -> tuple[sp.Expr, ...] | None:
        """Return polynomials of the parameters whose zeros give {J, H} = 0; None if unknown.

        The coefficients of {J, H} are solved one by one, each for one symbol in which it is linear.
        """
        if field.name in self.unconditional:
            return ()
        affected = self._affected_part(field)
        coefficients = _bracket_coefficients(affected, field)
        solved = None if coefficients is None else _solved_conditions(coefficients)
        if solved is None:
            return None
        conditions, solution_of = solved
        # the conditions are necessary; that they suffice is proved on the special system
        special = replace(affected, H=substitute([affected.H], solution_of)[0],
                          constraints=tuple(substitute(list(affected.constraints), solution_of)))
        suffice = SymmetrySpace(special, [field], numbers={}).contains(field)
        return tuple(conditions) if suffice else None

    def _affected_part(self, field: LinearField) -> System:
        """Return the system with the terms of H and the constraints that a field changes."""
        system = self.system
        # an entry A_ij changes q_i at the rate A_ij q_j, and p_j at the rate −A_ij p_i
        affected = {s for i, j in field.weights for s in (system.q[i], system.p[j])}
        return replace(
            system, H=sp.Add(*(e for e in sp.Add.make_args(system.H) if e.free_symbols & affected)),
            constraints=tuple(g for g in system.constraints if g.free_symbols & affected),
            constraint_names=())

    def _multiplier_matrix(self, field: LinearField) -> dict[tuple[int, int], Fraction] | None:
        """Return −C_Aᵀ with g_q A q = C_A g, by which multipliers rotate: λ' = −C_Aᵀ λ.

        Empty if g is invariant, g_q A q = 0; None if there is no such matrix of numbers.
        """
        system = self.system
        # A q
        image = [sp.Add(*(sp.Rational(x.numerator, x.denominator) * system.q[j]
                          for (i, j), x in field.weights.items() if i == k))
                 for k in range(system.n)]
        entries: dict[tuple[int, int], Fraction] = {}
        for k, row in enumerate(system.G):
            # the rate of g_k along the field, Σ_j g_k,j (A q)_j
            terms = [exactly(a) * x for a, x in zip(row, image, strict=True) if a != 0 and x != 0]
            if identically_zero([terms]):
                continue
            C_row = self._combination(sp.Add(*terms))
            if C_row is None:
                return None
            entries |= {(m, k): -x for m, x in C_row.items()}
        return entries

    def _combination(self, rate: sp.Expr) -> dict[int, Fraction] | None:
        """Return the numbers c_k ≠ 0 with rate = Σ c_k g_k, by equal coefficients of all monomials.

        None if there are none, or if the expressions are no polynomials.
        """
        constraints = {k: g for k, g in enumerate(self.system.constraints)
                       if g.free_symbols & rate.free_symbols}
        expressions = (rate, *constraints.values())
        symbols = sorted(set[sp.Symbol]().union(*(e.free_symbols for e in expressions)), key=str)
        if not all(e.is_polynomial(*symbols) for e in expressions):
            return None
        target, *polynomials = (sp.Poly(exactly(e), *symbols) for e in expressions)
        monomials = sorted(set(target.monoms()).union(*(g.monoms() for g in polynomials)))
        # coefficients of like monomials give linear equations for c
        matrix = sp.Matrix([[g.coeff_monomial(x) for g in polynomials] for x in monomials])
        right_side = sp.Matrix([target.coeff_monomial(x) for x in monomials])
        unknowns = sp.symbols(f"_c0:{len(constraints)}")
        solution = sp.linsolve((matrix, right_side), *unknowns)
        if not solution:
            return None
        zeros = dict.fromkeys(unknowns, sp.Integer(0))  # unknowns that remain free
        coefficients = [e.xreplace(zeros) for e in next(iter(solution))]
        return {k: Fraction(int(x.p), int(x.q))
                for k, x in zip(constraints, coefficients, strict=True) if x}

    def _rotates_forces(self, field: LinearField) -> bool:
        """Whether forces rotate with the frame, F_q A q − F_p Aᵀp + AᵀF = 0 identically."""
        if not self.forces:
            return True
        q, p = self.system.q, self.system.p
        # J = pᵀA q has J_p = A q and J_q = Aᵀ p
        J = field.momentum(q, p)
        A_q, At_p = ([sp.diff(J, x) for x in symbols] for symbols in (p, q))
        sums: list[list[sp.Expr]] = []
        for k, f in enumerate(self.forces):
            At_F = [self.forces[i] * sp.Rational(x.numerator, x.denominator)
                    for (i, j), x in field.weights.items() if j == k]
            sums.append([*(sp.diff(f, s) * x for s, x in zip(q, A_q, strict=True)),
                         *(-sp.diff(f, s) * x for s, x in zip(p, At_p, strict=True)), *At_F])
        return bool(identically_zero([terms for terms in sums if any(e != 0 for e in terms)]))


def _are_independent(fields: Sequence[LinearField]) -> bool:
    """Whether the fields are linearly independent; only their nonzero entries are compared."""
    entries = sorted({entry for field in fields for entry in field.weights})
    rows: list[list[Any]] = []
    for field in fields:
        row = [field.weights.get(entry, Fraction(0)) for entry in entries]
        rows.append([QQ(x.numerator, x.denominator) for x in row])
    return bool(DomainMatrix(rows, (len(fields), len(entries)), QQ).rank() == len(fields))


def _bracket_coefficients(system: System, field: LinearField) -> list[sp.Expr] | None:
    """Return the coefficients of {J, H} = J_q·H_p − J_p·H_q; None if it is no polynomial in q, p.

    The bracket is expanded term by term of H, as it is long. Coefficients are expressions of
    parameters.
    """
    J = field.momentum(system.q, system.p)
    slopes = {s: sp.diff(J, s) for s in (*system.q, *system.p)}
    pairs = list(zip(system.q, system.p, strict=True))
    coefficients: dict[tuple[sp.Expr, ...], sp.Expr] = {}
    for term in sp.Add.make_args(exactly(system.H)):
        term_symbols = term.free_symbols
        bracket = sp.Add(
            *(slopes[q] * derivative(term, p) for q, p in pairs if p in term_symbols),
            *(-slopes[p] * derivative(term, q) for q, p in pairs if q in term_symbols))
        symbols = sorted(bracket.free_symbols & slopes.keys(), key=str)
        # the expansion of a long bracket may take minutes
        if not is_small(bracket) or not bracket.is_polynomial(*symbols):
            return None
        for powers, c in sp.Poly(bracket, *symbols).terms() if symbols else ():
            monomial = tuple(s**n for s, n in zip(symbols, powers, strict=True) if n)
            coefficients[monomial] = coefficients.get(monomial, sp.Integer(0)) + c
    # conditions are solved one after the other: their order must not depend on the order of H
    return sorted({sp.together(c) for c in coefficients.values()}, key=sp.default_sort_key)


def _solved_conditions(
    coefficients: Sequence[sp.Expr]
) -> tuple[list[sp.Expr], dict[sp.Symbol, sp.Expr]] | None:
    """Return conditions under which all coefficients vanish, and symbol → its value under these.

    None if a coefficient is linear in no symbol, or if there are more than four conditions.
    """
    conditions: list[sp.Expr] = []
    solution_of: dict[sp.Symbol, sp.Expr] = {}
    for e in coefficients:
        # conditions so far are substituted: the next coefficient may follow from them
        numerator = sp.numer(sp.together(e.xreplace(solution_of)))
        if sp.expand(numerator) == 0:
            continue
        condition = _linear_factor(numerator)
        if condition is None:
            return None
        # solve for a symbol, which later coefficients contain
        conditions.append(condition)
        symbol = _solvable_symbol(condition)
        solution = sp.solve(condition, symbol)[0]
        solution_of = {s: x.xreplace({symbol: solution}) for s, x in solution_of.items()}
        solution_of[symbol] = solution
        if len(conditions) > _MOST_CONDITIONS:  # too special to occur
            return None
    return conditions, solution_of


def _linear_factor(e: sp.Expr) -> sp.Expr | None:
    """Return a factor of a polynomial that may vanish and is linear in a symbol, or None."""
    for factor, _ in sp.factor_list(e)[1]:
        if not factor.is_nonzero and _solvable_symbol(factor) is not None:
            return _normalise_sign(factor)
    return None


def _solvable_symbol(e: sp.Expr) -> sp.Symbol | None:
    """Return the last symbol, by name, in which e is linear with a number as coefficient.

    A division by an expression would need a condition of its own.
    """
    for symbol in sorted(e.free_symbols, key=str, reverse=True):
        slope = sp.diff(e, symbol)
        if slope.is_number and slope != 0:
            unknown: sp.Symbol = symbol
            return unknown
    return None


def _normalise_sign(e: sp.Expr) -> sp.Expr:
    """Return ±e, with the sign that makes the coefficient of the first symbol positive."""
    first = min(e.free_symbols, key=str)
    return -e if sp.diff(e, first).is_negative else e


