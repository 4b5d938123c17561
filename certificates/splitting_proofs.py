"""Proofs of flows, of sums and brackets of parts, and of invariants: exact algebra, no numbers.

A flow is a polynomial in q, l and C, Z, …, which stand for cosines, sines and exponentials of the
time: for a rotation vector 2 t u, C = cos(t|u|) and Z = sin(t|u|)/|u|, so that C² + |u|² Z² = 1,
Ċ = −|u|² Z and Ż = C. It is proved by

    (i)   its derivative by t is the field of its Hamiltonian at the flow's state,
    (ii)  at t = 0 it is the identity,
    (iii) |q|² = 1 and qᵀp = 0 stay.

Fields come from H(q, p): q̇ = H_p, ṗ = −H_q, so that 2 l̇ = Λ(q̇) p + Λ(q) ṗ; the constraint force
is a multiple of q, and Λ(q) q = 0. All equations hold modulo |q|² = 1 and p = 2 Λ(q)ᵀ l.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import sympy as sp

from ..core.inertia import quaternion_product
from ..generator.multibody.rigid_body import left_matrix, rotation_matrix
from ..generator.splitting.kicks import space_matrix
from ..generator.splitting.parts import Splitting
from ..generator.splitting.quotient import Quotient, unit_quaternions
from ..generator.symbolic.derivatives import derivative
from ..generator.symmetry.linear_fields import known_fields
from ..generator.systems.elimination_order import connected_components

__all__ = ["Proof", "bracket", "hamiltonians", "invariants", "is_invariant", "prove_flows",
           "prove_splitting"]

q, p = (sp.symbols(f"{letter}0:4", real=True) for letter in "qp")
l = sp.symbols("l1:4", real=True)  # noqa: E741
e = sp.symbols("e1:4", real=True)
omega = sp.symbols("omega1:4", real=True)
a, d, c, k = sp.symbols("a d c k", real=True)
#: Cosine and sine of a rotation in space axes, of one in body axes, e^(−kt), and d (e·m) at t = 0.
C, Z, D, Y, E, rate = sp.symbols("C Z D Y E rate", real=True)
#: d (e·m) in q and l.
_RATE = d * (rotation_matrix(q) * sp.Matrix(e)).dot(sp.Matrix(l))


@dataclass(frozen=True)
class Proof:
    """An equation and whether algebra proves it."""

    name: str
    equation: str
    holds: bool


@dataclass(frozen=True)
class _Flow:
    """A flow on the state (q, l) of a body whose field is 2 q̇ = W q + q w, l̇ = f.

    Attributes
    ----------
    name, equation : str
        The part of H, and its flow in the text of proofs.
    H : Expr
        The part of H, in the module's symbols q and p.
    left, right, force : three expressions each
        The angular velocities W in space axes and w in body axes, and f, in q and l.
    q, l : expressions
        The flow.
    along : pair of three expressions
        W and w along the flow, in q, l and symbols of the time.
    rates : mapping
        Time derivatives of the symbols of the time.
    squares : mapping
        Squares of symbols that the ideal replaces, such as C² = 1 − |u|² Z².
    drag : Expr
        k of l̇ = −k l.
    """

    name: str
    equation: str
    H: sp.Expr
    left: Sequence[sp.Expr]
    right: Sequence[sp.Expr]
    q: Sequence[sp.Expr]
    l: Sequence[sp.Expr]  # noqa: E741
    along: tuple[Sequence[sp.Expr], Sequence[sp.Expr]]
    rates: Mapping[sp.Symbol, sp.Expr]
    squares: Mapping[sp.Symbol, sp.Expr]
    drag: sp.Expr = sp.S.Zero
    force: Sequence[sp.Expr] = (sp.S.Zero,) * 3

    def proofs(self) -> Iterator[Proof]:
        """Yield the proofs that the flow's field is the field of H, and of (i) to (iii)."""
        # sines and cosines are symbols with relations, ``squares``: everything is a polynomial
        ring = Quotient({**unit_quaternions([q]), **self.squares})
        state = {**dict(zip(q, self.q, strict=True)), **dict(zip(l, self.l, strict=True))}

        def equal(expressions: Sequence[sp.Expr], expected: Sequence[sp.Expr]) -> bool:
            """Whether two lists of expressions are equal on the phase space."""
            return all(ring.vanishes(x - y) for x, y in zip(expressions, expected, strict=True))

        field = [*_quaternion_rate(q, self.left, self.right), *self.force]
        yield Proof(self.name, "the field of H is 2q̇ = W q + q w", equal(
            _field(self.H, self.drag), field))
        yield Proof(self.name, f"W and w along {self.equation}", equal(
            [x.xreplace(state) for x in (*self.left, *self.right)],
            [x.xreplace({rate: _RATE}) for x in (*self.along[0], *self.along[1])]))
        time_derivative = [sp.Add(*(derivative(x, y) * r for y, r in self.rates.items()))
                           for x in (*self.q, *self.l)]
        yield Proof(self.name, f"d/dt {self.equation} = (½ W q + ½ q w, f)", equal(
            time_derivative, [*_quaternion_rate(self.q, *self.along),
                              *(x.xreplace(state) for x in self.force)]))
        # at t = 0 cosines and exponentials are 1, sines 0
        start = {x: sp.Integer(x in (C, D, E)) for x in self.rates}
        yield Proof(self.name, f"{self.equation} = (q, l) at t = 0", equal(
            [x.xreplace(start) for x in (*self.q, *self.l)], (*q, *l)))
        yield Proof(self.name, "|q|² = 1", ring.vanishes(sp.Add(*(x**2 for x in self.q), -1)))


def _quaternion_rate(x: Sequence[sp.Expr], W: Sequence[sp.Expr], w: Sequence[sp.Expr]
             ) -> list[sp.Expr]:
    """Return ½ W x + ½ x w."""
    return [(u + v) / 2 for u, v in zip(
        quaternion_product([0, *W], x), quaternion_product(x, [0, *w]), strict=True)]


def _field(H: sp.Expr, drag: sp.Expr) -> list[sp.Expr]:
    """Return q̇ and l̇ of a Hamiltonian in q and p, and of a drag, as functions of q and l."""
    q_rate = [derivative(H, y) for y in p]
    l_rate = (space_matrix(q_rate) * sp.Matrix(p)
              - space_matrix(q) * sp.Matrix([derivative(H, x) for x in q])) / 2
    momenta = dict(zip(p, 2 * space_matrix(q).T * sp.Matrix(l), strict=True))  # p = 2 Λ(q)ᵀ l
    rates = [x.xreplace(momenta) for x in (*q_rate, *l_rate)]
    return [*rates[:4], *(x - drag * y for x, y in zip(rates[4:], l, strict=True))]


def _flows() -> Iterator[_Flow]:
    """Yield the flows of the catalogue, for any axis e and any numbers a, d, c, k and ω.

    Their H are ½ a |m|², ½ d (e·m)² + c (e·m), the sum of both with the drag −k l, and −ω·l. They
    are rotations by left and right quaternions, with angular velocities W and w.
    """
    m, l_of_p = (matrix(q) * sp.Matrix(p) / 2 for matrix in (left_matrix, space_matrix))
    zero, half = [sp.S.Zero] * 3, sp.Rational(1, 2)
    sphere, e_m = a * m.dot(m) / 2, sp.Matrix(e).dot(m)
    axis = d * e_m**2 / 2 + c * e_m
    l_squared, omega_squared = (sp.Add(*(x**2 for x in v)) for v in (l, omega))
    unit = {e[0]: 1 - e[1]**2 - e[2]**2}  # |e| = 1
    left_quaternion, right_quaternion = [C, *(Z * x for x in l)], [D, *(Y * x for x in e)]
    # d (e·m): _RATE at a state, ``rate`` at t = 0, which is its value along a flow without drag
    W, w = [a * x for x in l], [(_RATE + c) * x for x in e]
    # C = cos(½ a t |l|), Z = sin(½ a t |l|)/|l|
    yield _Flow(
        "sphere", "(exp(½ t a l) q, l)", sphere, left=W, right=zero,
        q=quaternion_product(left_quaternion, q), l=l, along=(W, zero),
        rates={C: -half * a * l_squared * Z, Z: half * a * C}, squares={C: 1 - l_squared * Z**2})
    # D = cos(½ t (d (e·m) + c)), Y = sin(½ t (d (e·m) + c))
    yield _Flow(
        "axis", "(q exp(½ t (d (e·m) + c) e), l)", axis, left=zero, right=w,
        q=quaternion_product(q, right_quaternion), l=l,
        along=(zero, [(rate + c) * x for x in e]),
        rates={D: -half * (rate + c) * Y, Y: half * (rate + c) * D},
        squares=unit | {D: 1 - Y**2})
    # s = (1 − e^(−kt))/k has ṡ = E = e^(−kt): both angles with s in place of t, but c t
    yield _Flow(
        "symmetric body with drag", "(exp(½ s a l) q exp(½ (s d (e·m) + c t) e), E l)",
        sphere + axis, left=W, right=w,
        q=quaternion_product(left_quaternion, q, right_quaternion), l=[E * x for x in l],
        along=([E * x for x in W], [(E * rate + c) * x for x in e]),
        rates={C: -half * a * E * l_squared * Z, Z: half * a * E * C,
               D: -half * (rate * E + c) * Y, Y: half * (rate * E + c) * D, E: -k * E},
        squares=unit | {C: 1 - l_squared * Z**2, D: 1 - Y**2}, drag=k, force=[-k * x for x in l])
    # C = cos(½ t |ω|), Z = sin(½ t |ω|)/|ω|
    back = [C, *(-Z * x for x in omega)]
    velocity = [-x for x in omega]
    yield _Flow(
        "space", "(exp(−½ t ω) q, exp(−t ω×) l)", -sp.Matrix(omega).dot(l_of_p), left=velocity,
        right=zero, q=quaternion_product(back, q), l=list(rotation_matrix(back) * sp.Matrix(l)),
        along=(velocity, zero), rates={C: -half * omega_squared * Z, Z: half * C},
        squares={C: 1 - omega_squared * Z**2},
        force=list(-sp.Matrix(omega).cross(sp.Matrix(l))))


@cache
def prove_flows() -> tuple[Proof, ...]:
    """Prove the flows of rotations, (i) to (iii), and that those of T commute."""
    m = left_matrix(q) * sp.Matrix(p) / 2
    e_m = sp.Matrix(e).dot(m)
    sphere, axis = a * m.dot(m) / 2, d * e_m**2 / 2 + c * e_m
    space = sp.Matrix(omega).dot(space_matrix(q) * sp.Matrix(p) / 2)
    names = {"½ a |m|²": sphere, "½ d (e·m)² + c (e·m)": axis, "ω·l": space}
    ring = Quotient({**unit_quaternions([q]), e[0]: 1 - e[1]**2 - e[2]**2})
    momenta = dict(zip(p, 2 * space_matrix(q).T * sp.Matrix(l), strict=True))
    return (*(x for flow in _flows() for x in flow.proofs()), *(
        Proof("parts of T", f"{{{x}, {y}}} = 0", ring.vanishes(
            bracket(names[x], names[y], q, p).xreplace(momenta)))
        for x, y in combinations(names, 2)))


def bracket(f: sp.Expr, g: sp.Expr, q: Sequence[sp.Symbol], p: Sequence[sp.Symbol]) -> sp.Expr:
    """Return the canonical bracket {f, g} = f_q·g_p − f_p·g_q.

    For functions of q and l it is the bracket on T*S³: they commute with |q|², so that the
    correction of the Dirac bracket for |q|² = 1 and qᵀp = 0 vanishes.
    """
    return sp.Add(*(derivative(f, x) * derivative(g, y) - derivative(f, y) * derivative(g, x)
                    for x, y in zip(q, p, strict=True)
                    if {x, y} & f.free_symbols and {x, y} & g.free_symbols))


# ---------------------------------------------------------------- one splitting


class _Ring:
    """The ideal of a system's bodies: |q|² = 1 and p = 2 L(q)ᵀ m.

    Expressions of equal form, of different bodies, are reduced once.
    """

    def __init__(self, splitting: Splitting) -> None:
        """Collect the bodies' (q, p), the body of each symbol, and the order of the variables."""
        self.system = splitting.system
        self.bodies = [(q, [self.system.p[i] for i in body.q])
                       for q, body in zip(splitting.quaternions, splitting.bodies, strict=True)]
        self.body_of = {x: b for b, (q, p) in enumerate(self.bodies) for x in (*q, *p)}
        symbols = (*self.system.q, *self.system.p, *self.system.parameters)
        self.order = {x: k for k, x in enumerate(symbols)}
        self.vanishing: dict[sp.Expr, bool] = {}

    def vanishes(self, expression: sp.Expr) -> bool:
        """Whether an expression is proved to vanish on the phase space.

        Its normal form in local symbols q and m is 0, with p = 2 L(q)ᵀ m.
        """
        symbols = expression.free_symbols
        bodies = sorted({self.body_of[x] for x in symbols if x in self.body_of})
        quaternions: list[Sequence[sp.Symbol]] = []
        # q and p of the bodies that occur, numbered by their order here, in local symbols
        names: dict[sp.Symbol, sp.Expr] = {}
        for slot, b in enumerate(bodies):
            x = sp.symbols(f"_q{slot}_0:4", real=True)
            m = sp.Matrix(sp.symbols(f"_m{slot}_1:4", real=True))
            q, p = self.bodies[b]
            names |= dict(zip((*q, *p), (*x, *(2 * left_matrix(x).T * m)), strict=True))
            quaternions.append(x)
        other_symbols = sorted((x for x in symbols if x in self.order and x not in names),
                               key=self.order.__getitem__)
        names |= {x: sp.Symbol(f"_k{k}", **x.assumptions0) for k, x in enumerate(other_symbols)}
        local = expression.xreplace(names)  # equal for bodies of equal form
        if local not in self.vanishing:
            self.vanishing[local] = Quotient(unit_quaternions(quaternions)).vanishes(local)
        return self.vanishing[local]

    def keeps(self, J: sp.Expr, e: sp.Expr) -> bool:
        """Whether {J, e} = 0 is proved: for the arguments of functions and roots, or for e."""
        q, p = self.system.q, self.system.p
        if not e.free_symbols & self.body_of.keys() | e.free_symbols & {*q, *p}:
            return True  # a constant
        if e.is_Add:
            # terms whose arguments J leaves invariant are left out of the sum
            terms = [x for x in e.args if not self._keeps_arguments(J, x)]
            return self.vanishes(bracket(J, sp.Add(*terms), q, p))
        return self._keeps_arguments(J, e) or self.vanishes(bracket(J, e, q, p))

    def _keeps_arguments(self, J: sp.Expr, e: sp.Expr) -> bool:
        """Whether {J, e} = 0 since J leaves all arguments invariant, of a term with functions."""
        if e.is_polynomial(*self.system.q, *self.system.p):
            return False
        return all(self.keeps(J, x) for x in e.args)


def hamiltonians(splitting: Splitting) -> list[tuple[str, sp.Expr]]:
    """Return the names of the parts of H that are not 0, and the parts in q and p of the system."""
    system, parts = splitting.system, []
    for body, x in zip(splitting.bodies, splitting.quaternions, strict=True):
        y = [system.p[i] for i in body.q]
        m = left_matrix(x) * sp.Matrix(y) / 2
        parts.append((f"½ a |m|² of {body.name}", body.a * m.dot(m) / 2))
        for axis in (*body.axes, *body.further):
            e_m = sp.Matrix(axis.axis).dot(m)
            parts.append((f"axis {axis.axis} of {body.name}", axis.d * e_m**2 / 2 + axis.c * e_m))
    translation = splitting.translation
    if translation is not None:
        terms = [x * system.p[i] * system.p[j] / 2
                 for (i, j), x in translation.inverse_mass.items()]
        terms += [x * system.p[i] for i, x in translation.velocity.items()]
        parts.append(("translation", sp.Add(*terms)))
    for space in splitting.space:
        J = sp.zeros(3, 1)  # Σ l + Σ r × p_r
        for b in space.bodies:
            y = [system.p[i] for i in splitting.bodies[b].q]
            J += space_matrix(splitting.quaternions[b]) * sp.Matrix(y) / 2
        for point in space.points:  # index −1: r₃ = 0 of a point in a plane
            r, y = (sp.Matrix([side[i] if i >= 0 else 0 for i in point])
                    for side in (system.q, system.p))
            J += r.cross(y)
        parts.append(("−ω·J", -sp.Matrix(space.omega).dot(J)))
    return [(name, x) for name, x in (*parts, ("V", splitting.V)) if x != 0]


def prove_splitting(splitting: Splitting) -> tuple[Proof, ...]:
    """Prove Σ parts = H body by body, and {T_i, T_j} = 0 for the parts of T.

    Where bodies were taken as symmetric, both hold where the conditions do.
    """
    ring, system = _Ring(splitting), splitting.system
    solution = _solve_linear(splitting.conditions)
    H = [x.xreplace(solution) for x in sp.Add.make_args(system.H)]
    parts = [y for _, x in hamiltonians(splitting) for y in sp.Add.make_args(x.xreplace(solution))]
    terms = [*H, *(-x for x in parts)]
    sums = all(ring.vanishes(sp.Add(*group)) for group in _by_momenta(terms, system.p)) or (
        ring.vanishes(sp.Add(*terms)))  # such as (p − A(q))²: part of it has no momenta
    # rotations of asymmetric bodies are composed, and do not commute with the rest of T
    inexact_names = {f"axis {axis.axis} of {body.name}" for body in splitting.bodies
                     for axis in body.further}
    exact = [x for name, x in hamiltonians(splitting) if name not in inexact_names and name != "V"]
    commute = all(ring.vanishes(bracket(x, y, system.q, system.p))
                  for x, y in _pairs_with_common_momentum(exact, system.p))
    return (Proof("sum of the parts", "Σ parts = H mod (|q|² − 1, qᵀp)", sums),
            Proof("one exact flow", "{X, Y} = 0 for parts of T", commute))


def _by_momenta(terms: Sequence[sp.Expr], p: Sequence[sp.Symbol]) -> list[list[sp.Expr]]:
    """Return terms in groups without common momenta; the first is of terms without any."""
    index_of = {x: i for i, x in enumerate(p)}
    sets = [frozenset(index_of[x] for x in e.free_symbols if x in index_of) for e in terms]
    # groups of momenta are numbered from 1; 0 is the group of terms without any
    group_of = {x: k for k, group in enumerate(connected_components([s for s in sets if s]), 1)
                for x in group}
    groups: dict[int, list[sp.Expr]] = defaultdict(list)
    for x, symbols in zip(terms, sets, strict=True):
        groups[group_of[next(iter(symbols))] if symbols else 0].append(x)
    return list(groups.values())


def _solve_linear(conditions: Sequence[sp.Expr]) -> dict[sp.Symbol, sp.Expr]:
    """Return symbol → its solution, for conditions e = 0 that are linear in a symbol.

    Each condition is solved for one symbol, the last one by name, with earlier solutions inserted.
    """
    solution: dict[sp.Symbol, sp.Expr] = {}
    for e in conditions:
        remainder = e.xreplace(solution)
        x = max((x for x in remainder.free_symbols if sp.degree(remainder, x) == 1), key=str,
                default=None)
        if x is not None:
            solution[x] = sp.solve(remainder, x)[0]
    return solution


def _pairs_with_common_momentum(
    parts: Sequence[sp.Expr], p: Sequence[sp.Symbol]
) -> Iterator[tuple[sp.Expr, sp.Expr]]:
    """Yield the pairs of parts of T with a common momentum: the only pairs that may not commute.

    A part has coordinates only of the bodies and points whose momenta it has.
    """
    parts_with: dict[sp.Symbol, list[int]] = defaultdict(list)
    for k, x in enumerate(parts):
        for symbol in x.free_symbols.intersection(p):
            parts_with[symbol].append(k)
    for i, j in sorted({pair for indices in parts_with.values()
                        for pair in combinations(indices, 2)}):
        yield parts[i], parts[j]


def is_invariant(
    splitting: Splitting, J: sp.Expr, numbers: Mapping[sp.Symbol, sp.Expr] | None = None
) -> bool:
    """Whether every part and every force is proved to leave J invariant, at some parameters.

    J is a function of q and p of the system whose flow stays on the constraints. Drag is one of
    the forces; a composition then conserves J whatever its order and its step.
    """
    ring, system = _Ring(splitting), splitting.system
    conditions = _solve_linear(splitting.conditions)
    # without forces the sum is empty
    power = sp.Add(*(derivative(J, y) * F for y, F in zip(system.p, system.forces, strict=False)))
    parts = [x.xreplace(conditions) for _, x in hamiltonians(splitting)]
    power, *functions = (
        e.xreplace(dict(numbers or {})) for e in (power, *system.constraints, *parts))
    return ring.vanishes(power) and all(ring.keeps(J, x) for x in functions)


def invariants(splitting: Splitting) -> tuple[tuple[str, sp.Expr], ...]:
    """Return momentum maps with a name that every part leaves invariant, each with its J."""
    system = splitting.system
    names: dict[sp.Expr, str] = {}
    for field in known_fields(system):
        names.setdefault(field.momentum(system.q, system.p), field.name)
    return tuple((name, J) for J, name in names.items() if is_invariant(splitting, J))
