"""A system from its Lagrangian: M(q) is factorised as numbers, never inverted in symbols.

    L = ½ vᵀM(q)v + b(q)ᵀv − V(q),   p = M v + b,   H = ½ (p − b)ᵀM⁻¹(p − b) + V

With v the solution of M v = p − b, all derivatives of H are derivatives of L at fixed v:

    H_p = v,   H_q = −L_q,   H_t = −L_t,   H_pp = M⁻¹,   v_q = −M⁻¹ L_vq,   H_qq = −L_qq − L_qv v_q

so that L is differentiated, and M⁻¹ is two substitutions with the factors of M at hand. M, b and V
may depend on t as well: moving coordinate systems and loads have this form.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from ...core.arguments import count_text, few, shown
from ...core.errors import InputError
from ...core.records import dataclass
from ..parsing.tokens import shorten
from ..symbolic.derivatives import derivative, slopes
from ..symbolic.identities import compare, is_refuted
from ..symbolic.numeric_evaluation import evaluate
from ..symbolic.shared_subexpressions import (
    Shared,
    name_of,
    parts_of,
    share_repeated,
    substitute,
    symbols_of,
    tree_size,
)
from ..symbolic.switching_functions import switches_of
from .elimination_order import Elimination, eliminate
from .expression_arguments import as_expression, as_sequence, refuse_other_assumptions
from .system import System

__all__ = ["LagrangianSystem", "from_lagrangian"]

#: Nodes of an L that is differentiated as given; in a longer one repeated parts are shared.
_LARGEST_TREE = 2_000
#: Points at which a mass matrix must be singular to be refused, and the tolerance there.
_POINTS, _SMALL = 4, 1e-11


@dataclass(frozen=True, repr=False)
class LagrangianSystem(System):
    """A system with L in place of H; ``from_lagrangian`` makes one, and checks it.

    ``H`` is ½ (p − b)ᵀv + V in terms of q, p and the velocities, which are no symbols of their own
    but M⁻¹(p − b). Forces are F(q, v, t).

    Parameters
    ----------
    L : Expr
        The Lagrangian L(q, v, t; parameters).
    velocities : sequence of Symbol
        v, one for each coordinate.
    placed : mapping
        Name of a body → ``x`` and ``axes``: names of the quantities that are the place of its
        centre of mass, and its first two axes in space (none for a particle).
    """

    H: sp.Expr = field(init=False)
    L: sp.Expr = field(kw_only=True)
    velocities: tuple[sp.Symbol, ...] = field(kw_only=True)
    placed: Mapping[str, Mapping[str, Sequence[str]]] = field(
        default_factory=dict, kw_only=True, hash=False)

    def __post_init__(self) -> None:
        # H = ½ (p − b)ᵀv + V, in which v stands for M⁻¹(p − b)
        kinetic = ((p - b) * v / 2
                   for p, b, v in zip(self.p, self.rest_momenta, self.velocities, strict=True))
        object.__setattr__(self, "H", sp.Add(*kinetic, self.potential))
        super().__post_init__()

    @property
    def _dependent_symbols(self) -> tuple[sp.Symbol, ...]:
        """The velocities, which H contains as functions of q and p."""
        return self.velocities

    @property
    def defining(self) -> dict[str, sp.Expr]:
        """L, which defines the equations of motion."""
        return {"L": self.L}

    @property
    def _slopes(self) -> list[sp.Expr]:
        """L_q, then L_v, 2n entries, by one pass backward through L."""
        return slopes(self.L, (*self.q, *self.velocities))

    def _at_rest(self, expressions: Sequence[sp.Expr]) -> list[sp.Expr]:
        """Return expressions at v = 0."""
        return substitute(expressions, dict.fromkeys(self.velocities, sp.Integer(0)))

    @cached_property
    def L_v(self) -> list[sp.Expr]:
        """∂L/∂v, n entries: the momenta."""
        return self._slopes[self.n :]

    @cached_property
    def rest_momenta(self) -> list[sp.Expr]:
        """b(q), the momenta of v = 0, n entries."""
        return self._at_rest(self.L_v)

    @cached_property
    def potential(self) -> sp.Expr:
        """V(q)."""
        return -self._at_rest([self.L])[0]

    @cached_property
    def mass(self) -> dict[tuple[int, int], sp.Expr]:
        """The entries of M = ∂²L/∂v∂v that are not 0, i ≥ j, before v = 0 is put in."""
        entries = {(i, j): derivative(self.L_v[i], self.velocities[j])
                   for i in range(self.n) for j in range(i + 1)}
        return {index: e for index, e in entries.items() if e != 0}

    @cached_property
    def is_long(self) -> bool:
        """Whether L is so long that its repeated parts are shared."""
        return any(isinstance(subexpression, Shared) for subexpression in parts_of([self.L]))

    @cached_property
    def is_definite(self) -> bool:
        """Whether M is positive definite at random points, so that LDLᵀ of it needs no pivots.

        The eigenvalues of a regular M do not change their sign along a path from such a point;
        parameters are positive at the points.
        """
        for M in _masses(self, _POINTS, decades=1.0, distant_points=4 * _POINTS):
            diagonal = np.diag(M)
            if not (diagonal > 0).all():
                return False
            # scaled to the diagonal 1, for masses and moments have different units
            scales = np.sqrt(diagonal)
            if np.linalg.eigvalsh(M / np.outer(scales, scales))[0] < -_SMALL:
                return False
        return True

    @cached_property
    def elimination(self) -> Elimination:
        """Sparse factorisation M = L D Lᵀ: order of the coordinates, and storage of the entries."""
        neighbours: dict[int, set[int]] = {i: set() for i in range(self.n)}
        for i, j in self.mass:
            if i != j:
                neighbours[i].add(j)
                neighbours[j].add(i)
        return eliminate(neighbours)

    @cached_property
    def mass_entries(self) -> list[sp.Expr]:
        """M(q) as ``elimination`` stores it: the diagonal, then the lower triangle with fill-in."""
        stored = [sp.Integer(0)] * self.elimination.entries
        for index, e in zip(self.mass, self._at_rest([*self.mass.values()]), strict=True):
            stored[self.elimination.slot_of[index]] = e
        return stored

    @cached_property
    def generalised_force(self) -> list[sp.Expr]:
        """L_q + F, n entries: the generalised force, ṗ without constraint forces, at fixed v."""
        return [-e for e in self.minus_p_rate]

    @cached_property
    def H_q(self) -> list[sp.Expr]:
        """∂H/∂q = −∂L/∂q, n entries, in terms of q and v."""
        return [-e for e in self._slopes[: self.n]]

    @cached_property
    def H_p(self) -> list[sp.Expr]:
        """∂H/∂p, n entries: the velocities."""
        return list(self.velocities)

    @cached_property
    def H_t(self) -> sp.Expr:
        """∂H/∂t = −∂L/∂t, the explicit time derivative, in terms of q and v."""
        return sp.Integer(0) if self.clock is None else -slopes(self.L, (self.clock,))[0]

    @cached_property
    def hidden(self) -> list[sp.Expr]:
        """G v + g_t, m entries: the rates of the constraints."""
        return [sp.Add(rate, *(a * v for a, v in zip(row, self.velocities, strict=True)))
                for row, rate in zip(self.G, self.g_t, strict=True)]

    def texts(self) -> tuple[str, str]:
        """Return H and L as text; long ones by the letters M, b and V."""
        if self.is_long:
            return ("(p - b(q))^T M(q)^-1 (p - b(q))/2 + V(q)",
                    f"v^T M(q) v/2 + b(q)^T v - V(q), n = {self.n}")
        return str(self.H), str(self.L)

    def legendre(self) -> System:
        """Return the same system with H = ½ (p − b)ᵀ M⁻¹ (p − b) + V, M inverted in symbols.

        M may have a few rows only. Tests compare the result with the system that factorises M as
        numbers.
        """
        # ``mass`` has the lower triangle
        entries = dict(zip(self.mass, self._at_rest([*self.mass.values()]), strict=True))
        M = sp.Matrix(self.n, self.n,
                      lambda i, j: entries.get((max(i, j), min(i, j)), sp.Integer(0)))
        momenta = [p - b for p, b in zip(self.p, self.rest_momenta, strict=True)]
        velocities = list(M.inv() @ sp.Matrix(momenta))
        velocity_of = dict(zip(self.velocities, velocities, strict=True))
        return System(self.q, self.p, self.parameters, self.H.subs(velocity_of), self.constraints,
                      name=self.name, constraint_names=self.constraint_names, time=self.time,
                      forces=tuple(f.subs(velocity_of) for f in self.forces), inputs=self.inputs,
                      quantities={k: e.subs(velocity_of) for k, e in self.quantities.items()},
                      velocity_constraints=self.velocity_constraints, velocities=self.velocities,
                      velocity_constraint_names=self.velocity_constraint_names)


def from_lagrangian(
    L: Any, q: Any, velocities: Any, parameters: Any, constraints: Any = (), forces: Any = None,
    time: sp.Symbol | None = None, *,
    name: str = "system", constraint_names: Sequence[str] = (), inputs: Any = (),
    quantities: Mapping[str, sp.Expr] | None = None,
    placed: Mapping[str, Mapping[str, Sequence[str]]] | None = None,
    velocity_constraints: Any = (), velocity_constraint_names: Sequence[str] = (),
) -> LagrangianSystem:
    """Return the system of a Lagrangian L = ½ vᵀM(q)v + b(q)ᵀv − V(q), p = M v + b.

    Parameters
    ----------
    L : Expr
        L(q, v, t; parameters), in joules for SI input.
    q, velocities : sequence of Symbol
        Coordinates, and the symbols of their rates, n of each. The momenta are named p_…
    parameters, constraints, name, constraint_names, inputs, quantities
        As of ``System``; inputs may occur in forces only.
    velocity_constraints, velocity_constraint_names
        As of ``System``: A(q, t) v + a(q, t) = 0.
    placed
        As of ``LagrangianSystem``.
    forces : sequence of Expr, optional
        F(q, v, t; parameters), n of them: d/dt L_v = L_q + F − g_qᵀλ.
    time : Symbol, optional
        The symbol of t in L, in constraints g(q, t) and in forces.

    Raises
    ------
    InputError
        If L is not quadratic in the velocities, its mass matrix singular, or as ``System``.
    """
    coordinates, speeds, constants = (
        _symbols(key, argument, name) for key, argument in (
            ("q", q), ("velocities", velocities), ("parameters", parameters)))
    L = as_expression(L)
    # derivatives of a long L that is not shared would visit each occurrence of a subexpression
    if tree_size([L]) > _LARGEST_TREE:
        (L,) = share_repeated([L])
    if len(speeds) != len(coordinates):
        raise InputError(f"System {name!r} has {count_text(len(coordinates), 'coordinate')} and "
                         f"{len(speeds)} "
                         "velocities; give the velocity of each coordinate, in the same order.")
    F = tuple(map(as_expression, as_sequence("forces", () if forces is None else forces)))
    g = tuple(map(as_expression, as_sequence("constraints", constraints)))
    input_symbols = _symbols("inputs", inputs, name)
    _refuse_unknown(name, L, F,
                    {*coordinates, *speeds, *constants, *input_symbols, *filter(None, [time])})
    names = {str(s) for s in (*coordinates, *speeds, *constants, *input_symbols, time) if s}
    system = LagrangianSystem(
        coordinates, tuple(_momentum(x, names) for x in coordinates), constants,
        g, L=L, velocities=speeds, forces=F, time=time, name=name,
        constraint_names=tuple(constraint_names), inputs=input_symbols, quantities=quantities or {},
        placed=placed or {}, velocity_constraints=velocity_constraints,
        velocity_constraint_names=tuple(velocity_constraint_names))
    _refuse_unless_quadratic(system)
    _refuse_switching(system)
    _refuse_singular(system)
    return system


def _symbols(key: str, argument: Any, name: str) -> tuple[sp.Symbol, ...]:
    """Return an argument as a tuple of symbols; refuse other entries.

    ``key`` is the argument's name in messages, ``name`` the system's.
    """
    symbols = as_sequence(key, argument)
    for x in symbols:
        if not isinstance(x, sp.Symbol):
            of_time = ("; gyrospark.from_mechanics(LagrangesMethod(L, q)) takes functions of time"
                       if isinstance(x, sp.Function | sp.Derivative) else "")
            raise InputError(f"System {name!r} has {shown(x)} in {key}, which is no symbol; make "
                             f"it with sympy.Symbol{of_time}.")
    return symbols  # type: ignore[return-value]


def _momentum(x: sp.Symbol, names: set[str]) -> sp.Symbol:
    """Return the symbol of a coordinate's momentum: p_ before its name, "_" after a name in use."""
    name = f"p_{x}"
    while name in names:
        name += "_"
    return sp.Symbol(name, real=True)


def _refuse_unknown(
    name: str, L: sp.Expr, forces: Sequence[sp.Expr], declared: set[sp.Symbol]
) -> None:
    """Refuse undeclared symbols in L and in forces."""
    for label, e in (("L", L), *((f"Force {i}", f) for i, f in enumerate(forces))):
        unknown = symbols_of([e]) - declared
        if unknown:
            refuse_other_assumptions(label, name, unknown, declared)
            raise InputError(f"{label} of system {name!r} contains the unknown symbol "
                             f"{min(map(str, unknown))!r}; declare it in q, velocities or "
                             "parameters, or as time.")


def _refuse_unless_quadratic(system: LagrangianSystem) -> None:
    """Refuse an L that is not ½ vᵀM v + bᵀv − V.

    A bound of the degree decides cheaply; otherwise an entry of M is compared with M at v = 0.
    Where L switches with v, L itself is compared: |v| has the second derivative 0 but at v = 0.
    """
    if _degree(system.L, system.velocities) <= 2:
        return
    entries_with_velocities = {index: e for index, e in system.mass.items()
                               if not symbols_of([e]).isdisjoint(system.velocities)}
    for (i, j), e in entries_with_velocities.items():
        if not compare([e], system._at_rest([e])).holds:
            v = system.velocities
            raise InputError(
                f"L of system {system.name!r} is not quadratic in the velocities: its derivative "
                f"by {v[j]} and {v[i]}, {shorten(str(e), 60)}, depends on them; give a "
                "gyrospark.System with its H instead.")
    # pᵀv − H is ½ (p − b)ᵀv + bᵀv − V, in which p − b = M v
    if symbols_of(switches_of([system.L])).isdisjoint(system.velocities):
        return
    v, b = system.velocities, system.rest_momenta
    M = zip(system.mass, system._at_rest([*system.mass.values()]), strict=True)
    kinetic = (e * v[i] * v[j] * (1 if i != j else sp.Rational(1, 2)) for (i, j), e in M)
    quadratic = sp.Add(*kinetic, *(x * y for x, y in zip(b, v, strict=True)), -system.potential)
    if is_refuted([system.L], [quadratic]):
        raise InputError(
            f"L of system {system.name!r} is not quadratic in the velocities: it is not "
            f"{shorten(str(quadratic), 60)} at all {few(v)}; give a gyrospark.System with its H "
            "instead.")


def _degree(e: sp.Expr, symbols: Sequence[sp.Symbol]) -> float:
    """Return a bound of the degree of e in some symbols: infinite if it is no polynomial."""
    degree: dict[sp.Basic, float] = dict.fromkeys(symbols, 1)
    # nodes come after those that they contain
    for node in parts_of([e]):
        if node in degree:
            continue
        degrees = [degree[a] for a in node.args]
        if not any(degrees):
            degree[node] = 0
        elif node.is_Mul:
            degree[node] = sum(degrees)
        elif node.is_Pow and node.exp.is_Integer and node.exp > 0:
            degree[node] = degrees[0] * int(node.exp)
        else:
            # ``Shared`` stands for its argument; any other function is no polynomial
            degree[node] = max(degrees) if node.is_Add or isinstance(node, Shared) else math.inf
    return degree[e]


def _refuse_switching(system: LagrangianSystem) -> None:
    """Refuse a mass matrix with switching functions: velocities M⁻¹(p − b) would jump."""
    # the entries are second derivatives, which are computed only if L switches at all
    switching = switches_of(system.mass_entries) if switches_of([system.L]) else []
    if switching:
        raise InputError(f"The mass matrix of system {system.name!r} switches at "
                         f"{shorten(str(switching[0]), 60)} = 0, where velocities would jump; "
                         "let only V switch.")


def _refuse_singular(system: LagrangianSystem) -> None:
    """Refuse a mass matrix that is singular at all sample points, by its singular values."""
    directions = None
    for M in _masses(system, _POINTS):
        _, singular_values, directions = np.linalg.svd(M)
        if singular_values[-1] > _SMALL * singular_values[0]:
            return
    # M could not be evaluated anywhere
    if directions is None:
        return
    # the last row of Vᵀ spans the null space: velocities with M v = 0
    massless = [str(v) for v, x in zip(system.velocities, directions[-1], strict=True)
                if abs(x) > np.sqrt(_SMALL)]
    raise InputError(f"The mass matrix of system {system.name!r} is singular: motion with "
                     f"{', '.join(massless)} costs no kinetic energy, so that momenta do not tell "
                     f"velocities; give every coordinate a mass, or leave {shown(massless[-1])} "
                     "out.")


def _masses(
    system: LagrangianSystem, points: int, decades: float = 0.0, distant_points: int = 0
) -> Iterator[NDArray[Any]]:
    """Yield M, shape (n, n), at random points where it is finite; none if NumPy lacks a function.

    Parameters and coordinates are between 0.5 and 2. At ``distant_points`` further points,
    parameters are up to ``decades`` decades away from there, and coordinates may be negative.
    """
    # seeded, so that the answer for a system is always the same
    rng = np.random.default_rng(17)
    symbols = sorted(symbols_of(system.L_v) - {*system.velocities}, key=name_of)
    # p = M v + b at v = e_1, …, e_n and 0: M are the differences
    unit_velocities = dict(zip(system.velocities, np.eye(system.n, system.n + 1), strict=True))
    for point in range(points + distant_points):
        substitution = {s: float(rng.uniform(0.5, 2.0)) for s in symbols}
        if point >= points:
            substitution = {s: x * float(rng.choice([-1, 1]) if s in system.q else
                                         10 ** rng.uniform(-decades, decades))
                            for s, x in substitution.items()}
        try:
            momenta = evaluate(system.L_v, substitution | unit_velocities).astype(float)
        except (InputError, TypeError, ArithmeticError):
            return  # a function that NumPy does not know
        M = momenta[:, :-1] - momenta[:, -1:]
        if np.isfinite(M).all():
            yield M
