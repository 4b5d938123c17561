"""Momentum maps of a system: what the symmetries of H, g and F conserve.

A point symmetry q → q + ε X(q) with X(q) = A q + a that leaves H and g alone conserves

    J(q, p) = pᵀ(A q + a),   dJ/dt = pᵀA H_p − (A q + a)·(H_q − F) − λᵀ g_q (A q + a) = 0.

Both sums are linear in A and a. They are found where the sums vanish at random points, by the null
space of a matrix with one row for each point; a basis of it is chosen from fields that have a name
(``linear_fields``) and filled up with its reduced echelon form in whole fractions. Each J is then
proved: its bracket with H is expanded, and where that does not decide it, evaluated in 50 digits.

J is kept *by the scheme* where {H, J} = 0 for all q and p, because stages are off the constraints;
{H, J} = 0 only on g = 0 is enough for the motion. The three spaces, each within the next:

    for any parameters, everywhere  ⊆  for these parameters, everywhere  ⊆  on the constraints

Where H and F switch sides, as |x| does, J must be kept on each of them: points near the start may
all lie on one. Sides are weighed with parameters for this.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike, NDArray

from .evaluation import Evaluator, evaluate, mp_context
from .linear_fields import Field, known_fields, motions_of_space
from .smoothness import on_any_side
from .system import System

__all__ = ["MAX_COORDINATES", "MomentumMap", "momentum_maps"]

Array = NDArray[np.float64]
#: Conditions and their derivatives at many points.
_Step = tuple[Array, Array]

#: Up to so many coordinates every A and a is searched, beyond it those with a name.
MAX_COORDINATES = 20
#: Singular values below this part of the largest are zero; symmetries that are broken by less
#: would not be told from round-off in the matrix.
_ZERO = 1e-10
#: Operations in a bracket up to which it is expanded.
_EXPANDABLE = 6000
_DIGITS = 50


@dataclass(frozen=True, eq=False)
class MomentumMap:
    """J = pᵀ(A q + a), conserved by the motion.

    Attributes
    ----------
    name : str
        E.g. "angular momentum about e3".
    J : Expr
        In the symbols of the system.
    A, a : ndarray, shapes (n, n) and (n,)
        Its field.
    any_parameters : bool
        Whether it is conserved whatever the parameters are, or for those given only.
    everywhere : bool
        Whether {H, J} = F·X vanishes for all q and p, or on the constraint manifold only.
    turns_constraints : bool
        Whether g_q X vanishes for all q, or where g = 0 only.
    proof : str
        How it was proved: "expanded", in "50 digits" at random points, or at
        "random points" of the constraint manifold in doubles.
    """

    name: str
    J: sp.Expr
    A: Array
    a: Array
    any_parameters: bool
    everywhere: bool
    turns_constraints: bool
    proof: str

    def values(self, q: Array, p: Array) -> Array:
        """Return J of each row of q and p, shapes (..., n)."""
        return np.asarray(np.einsum("...i,...i->...", p, q @ self.A.T + self.a))

    def sizes(self, q: Array, p: Array) -> Array:
        """Return |p| (|A| |q| + |a|) of what enters J, of which its round-off is a part.

        Norms, not terms: a motion in a plane rounds out of it by ε of its size.
        """
        rows, columns = self.A.any(axis=1) | (self.a != 0), self.A.any(axis=0)
        reach = np.linalg.norm(q[..., columns], axis=-1) * np.linalg.norm(self.A)
        momenta = np.linalg.norm(p[..., rows], axis=-1)
        return np.asarray(momenta * (reach + np.linalg.norm(self.a)))


def momentum_maps(
    system: System, parameters: Mapping[str, float], q0: ArrayLike, p0: ArrayLike
) -> list[MomentumMap]:
    """Return independent momentum maps linear in p, with X(q) = A q + a.

    Parameters
    ----------
    system : System
        With n coordinates; beyond ``MAX_COORDINATES`` only fields with a name are tried.
    parameters : mapping of str to float
        Every parameter's value.
    q0, p0 : array_like, shape (n,)
        A state on the constraints; points are drawn around it.

    Raises
    ------
    InputError
        If H, g or F contains a function that cannot be evaluated, or g switches sides.
    """
    system, weights = on_any_side(system)
    search = _Search(system, weights, parameters, np.asarray(q0, float), np.asarray(p0, float))
    named = known_fields(system)
    full = system.n <= MAX_COORDINATES
    tried = np.eye(system.n * (system.n + 1)) if full else _orthonormal(
        np.array([f.flat for f in named]).T)
    on_manifold = _null_space(search.rows(tried, manifold=True, vary=False), tried)
    everywhere = _null_space(search.rows(on_manifold, manifold=False, vary=False), on_manifold)
    general = _null_space(search.rows(everywhere, manifold=False, vary=True), everywhere)
    chosen = _Chosen(search)
    found: list[MomentumMap] = []
    for space, any_parameters, anywhere in ((general, True, True), (everywhere, False, True),
                                            (on_manifold, False, False)):
        for field in [*named, *_echelon(space, system)]:
            if _distance(field.flat, space) < 1e-7 and chosen.accepts(field):
                found += _proved(search, field, any_parameters, anywhere)
    return found


# ---------------------------------------------------------------- the linear conditions


class _Search:
    """Random points of a system, and the conditions on (A, a) there."""

    def __init__(
        self, system: System, weights: Sequence[sp.Symbol], parameters: Mapping[str, float],
        q0: Array, p0: Array,
    ) -> None:
        self.system, self.weights, self.q0, self.p0 = system, weights, q0, p0
        self.parameters = {s: float(parameters[str(s)]) for s in system.parameters
                           if s not in weights}
        self.rng = np.random.default_rng(20)
        self.spread = np.abs(q0) + 0.1 * (np.abs(q0).max() or 1.0)
        self.momenta = self._momentum_scale()

    def _momentum_scale(self) -> Array:
        """Return momenta worth the energy of the start, each by itself."""
        n, system = self.system.n, self.system
        at = self._at(self.q0[:, None], self.p0[:, None],
                      self.parameters | dict.fromkeys(self.weights, 0.5))
        slopes = _at_points([*system.H_q, *system.H_p], at)[:, 0]
        energy = float(np.abs(slopes * np.concatenate([self.q0, self.p0])).sum())
        masses = _at_points([system.H_pp[i][i] for i in range(n)], at)[:, 0]
        with np.errstate(all="ignore"):
            scale = np.sqrt(2 * energy / np.abs(masses))
        usable = np.isfinite(scale) & (scale > 0)
        return np.where(usable, scale, np.abs(self.p0).max() or 1.0)

    def _at(self, q: Array, p: Array, parameters: Mapping[Any, Any]) -> dict[Any, Any]:
        values: dict[Any, Any] = dict(parameters)
        values |= dict(zip(self.system.q, q, strict=True))
        values |= dict(zip(self.system.p, p, strict=True))
        if self.system.time is not None:
            values[self.system.time] = self.rng.uniform(0, 1, q.shape[1])
        return values

    def points(self, count: int, *, manifold: bool, vary: bool) -> dict[Any, Any]:
        """Draw states, and parameters around the given ones; on the constraints if wanted.

        Momenta are drawn over four decades, so that neither kinetic nor potential energy hides
        what breaks a symmetry of the other; a tenth of them is zero.
        """
        n = self.system.n
        q = self.q0[:, None] + 0.4 * self.spread[:, None] * self.rng.standard_normal((n, count))
        sizes = 10 ** self.rng.uniform(-2, 2, count) * (self.rng.uniform(size=count) > 0.1)
        p = self.momenta[:, None] * sizes * self.rng.standard_normal((n, count))
        parameters: dict[Any, Any] = dict(self.parameters)
        if vary:
            parameters = {s: (x or 0.3) * self.rng.uniform(0.9, 1.1, count)
                          for s, x in self.parameters.items()}
        parameters |= {s: self.rng.uniform(size=count) for s in self.weights}
        if manifold and self.system.m:
            q = _newton(q, lambda x: self._constraint(x, p, parameters))
            p = _newton(p, lambda y: self._velocity_constraint(q, y, parameters))
        return self._at(q, p, parameters)

    def _constraint(self, q: Array, p: Array, parameters: Mapping[Any, Any]) -> _Step:
        """Return g and g_q at each point, shapes (points, m) and (points, m, n)."""
        system, at = self.system, self._at(q, p, parameters)
        slopes = _at_points([e for row in system.G for e in row], at).T
        return _at_points(system.constraints, at).T, slopes.reshape(-1, system.m, system.n)

    def _velocity_constraint(self, q: Array, p: Array, parameters: Mapping[Any, Any]) -> _Step:
        """Return g_q H_p and its derivative g_q H_pp by p."""
        system, at = self.system, self._at(q, p, parameters)
        G = self._constraint(q, p, parameters)[1]
        masses = _at_points([e for row in system.H_pp for e in row], at).T
        speed = _at_points(system.H_p, at).T
        return np.einsum("kln,kn->kl", G, speed), G @ masses.reshape(-1, system.n, system.n)

    def rows(self, basis: Array, *, manifold: bool, vary: bool) -> Array:
        """Return the conditions on the combinations of a basis of fields, one in each row."""
        count = basis.shape[1] + basis.shape[1] // 4 + 30
        system, n = self.system, self.system.n
        at = self.points(count, manifold=manifold, vary=vary)
        force = system.forces or (sp.Integer(0),) * n
        pull = _at_points([a - b for a, b in zip(system.H_q, force, strict=True)], at)
        speed = _at_points(system.H_p, at)
        q, p = (_at_points(symbols, at) for symbols in (system.q, system.p))
        A = np.einsum("ik,jk->kij", p, speed) - np.einsum("ik,jk->kij", pull, q)
        parts = [_scaled(np.concatenate([A.reshape(count, -1), -pull.T], axis=1)) @ basis]
        at = self.points(count, manifold=True, vary=vary)
        q = _at_points(system.q, at)
        for row in system.G:
            G = _at_points(row, at)
            A = np.einsum("ik,jk->kij", G, q)
            parts.append(_scaled(np.concatenate([A.reshape(count, -1), G.T], axis=1)) @ basis)
        return np.concatenate(parts)


def _scaled(rows: Array) -> Array:
    """Return the rows with all numbers finite, each of length 1."""
    lengths = np.linalg.norm(rows, axis=1)
    usable = np.isfinite(lengths) & (lengths > 0)
    return np.asarray(rows[usable] / lengths[usable, None])


def _orthonormal(columns: Array) -> Array:
    """Return an orthonormal basis of the span."""
    U, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(U[:, sizes > _ZERO * sizes[0]])


def _null_space(rows: Array, basis: Array) -> Array:
    """Return an orthonormal basis of the combinations of a basis that all rows annihilate."""
    k = basis.shape[1]
    if k == 0 or len(rows) < k:  # too few points where everything is finite: nothing is claimed
        return basis[:, :0]
    _, sizes, V = np.linalg.svd(np.linalg.qr(rows, mode="r"))  # many more rows than columns
    rank = int((sizes > _ZERO * max(1.0, sizes[0])).sum())
    return _orthonormal(basis @ V[rank:].T) if rank < k else basis[:, :0]


def _distance(flat: Array, space: Array) -> float:
    """Return how far a field is from a space of them, relative to its length."""
    if not space.shape[1] or not flat.any():
        return 1.0
    return float(np.linalg.norm(flat - space @ (space.T @ flat)) / np.linalg.norm(flat))


def _newton(x: Array, conditions: Callable[[Array], _Step]) -> Array:
    """Return points, shape (n, points), moved to where the conditions vanish.

    By the shortest increments that make the linearised conditions vanish; NaN where 12 of them
    are not enough.
    """
    done = np.zeros(x.shape[1], dtype=bool)
    for _ in range(12):
        defect, slopes = conditions(x)
        usable = np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(defect).all(axis=1)
        step = np.full(x.shape, np.nan)
        step[:, usable] = (np.linalg.pinv(slopes[usable]) @ defect[usable, :, None])[:, :, 0].T
        x = x - step
        done = np.abs(step).max(axis=0) <= 1e-12 * np.abs(x).max(axis=0)
        if done[usable].all():
            break
    return np.where(done, x, np.nan)


def _at_points(expressions: Sequence[sp.Expr], at: Mapping[Any, Any]) -> Array:
    """Return the expressions at many points, shape (expressions, points); NaN where undefined."""
    with np.errstate(all="ignore"):
        return np.asarray(evaluate(expressions, at), dtype=float)


# ---------------------------------------------------------------- a basis for people


class _Chosen:
    """The J that were taken, as their values at points of the constraint manifold."""

    def __init__(self, search: _Search) -> None:
        at = search.points(200, manifold=True, vary=False)
        q, p = (_at_points(s, at).T for s in (search.system.q, search.system.p))
        usable = np.isfinite(q).all(axis=1) & np.isfinite(p).all(axis=1) & p.any(axis=1)
        self.q, self.p = q[usable], p[usable]
        self.basis = np.zeros((len(self.q), 0))

    def accepts(self, field: Field) -> bool:
        """Take a field whose J is no combination of those taken; J = 0 on the manifold is none."""
        reach = self.q @ field.A.T + field.a
        J = np.einsum("ki,ki->k", self.p, reach)
        size = np.linalg.norm(self.p, axis=1)
        terms = size * (np.linalg.norm(self.q, axis=1) * np.linalg.norm(field.A)
                        + np.linalg.norm(field.a))
        J, weight = J / size, np.linalg.norm(terms / size)
        rest = J - self.basis @ (self.basis.T @ J)
        rest -= self.basis @ (self.basis.T @ rest)
        length = np.linalg.norm(rest)
        if not length > 1e-9 * weight:
            return False
        self.basis = np.column_stack([self.basis, rest / length])
        return True


def _echelon(space: Array, system: System) -> list[Field]:
    """Return a basis in reduced echelon form, its entries as fractions where they are any."""
    rows, n = space.T.copy(), system.n
    done = 0
    for column in range(rows.shape[1]):
        if done == len(rows):
            break
        pivot = done + int(np.abs(rows[done:, column]).argmax())
        if abs(rows[pivot, column]) < 1e-8:
            continue
        rows[[done, pivot]] = rows[[pivot, done]]
        rows[done] /= rows[done, column]
        others = np.arange(len(rows)) != done
        rows[others] -= np.outer(rows[others, column], rows[done])
        done += 1
    return [_with_name(Field.from_flat("", _fractions(row), n), system) for row in rows]


def _fractions(values: Array) -> Array:
    """Return each number as the simple fraction next to it, if it is next to one."""
    simple = np.array([float(Fraction(x).limit_denominator(10_000)) for x in values.tolist()])
    return np.where(np.abs(simple - values) < 1e-9, simple, values)


def _with_name(field: Field, system: System) -> Field:
    """Name a field that no list has: a rotation about another axis, or else by its J."""
    moves = motions_of_space(system)
    turns = [f for f in moves if f.A.any()]
    if len(turns) == 3:
        flats = np.array([f.flat for f in moves]).T
        weights = np.linalg.lstsq(flats, field.flat, rcond=None)[0].round(12)
        if np.abs(flats @ weights - field.flat).max() < 1e-9:
            about, along = weights[:3], weights[3:]
            kind = "angular momentum about" if about.any() else "linear momentum along"
            axis = about if about.any() else along
            sign = -1.0 if axis[np.flatnonzero(axis)[-1]] < 0 else 1.0
            direction = ", ".join(f"{x:.6g}" for x in sign * axis / np.linalg.norm(axis) + 0.0)
            place = ", off the origin" if about.any() and along.any() else ""
            return Field(f"{kind} ({direction}){place}", sign * field.A, sign * field.a)
    text = str(_expression(field, system))
    return Field(text if len(text) <= 60 else text[:59] + "…", field.A, field.a)


def _expression(field: Field, system: System) -> sp.Expr:
    """Return J, its numbers exact."""
    q = sp.Matrix([*system.q, 1])
    numbers = sp.Matrix(np.column_stack([field.A, field.a]).tolist()).applyfunc(_exact)
    return sp.Add(*(p * x for p, x in zip(system.p, numbers * q, strict=True)))


def _exact(x: float) -> sp.Rational:
    """Return the simple fraction a number stands for, or else the number itself."""
    simple = Fraction(float(x)).limit_denominator(10_000)
    exact = simple if abs(simple - Fraction(float(x))) < Fraction(1, 10**12) else Fraction(float(x))
    return sp.Rational(exact.numerator, exact.denominator)


# ---------------------------------------------------------------- the proof


def _proved(
    search: _Search, field: Field, any_parameters: bool, everywhere: bool
) -> list[MomentumMap]:
    """Return the momentum map of a field if its conservation can be proved, else nothing."""
    system = search.system
    J = _expression(field, system)
    # As they are written: 0.3 is 3/10, so that what cancels in a person's mind cancels here.
    numbers = {s: sp.Rational(repr(x)) for s, x in search.parameters.items()}
    symbols: Mapping[Any, Any] = {} if any_parameters else numbers
    terms = [e.xreplace(symbols) for e in _rate_terms(J, system)]
    proof = ""
    if everywhere:
        proof = _proof([terms], [*system.q, *system.p, *system.parameters], search, numbers)
    if not everywhere or not proof:
        everywhere, proof = False, _proof_on_manifold(search, J)
    if not proof:
        return []
    slides = [[a * sp.diff(J, p).xreplace(symbols) for a, p in
               zip((e.xreplace(symbols) for e in row), system.p, strict=True)] for row in system.G]
    turned = bool(_proof(slides, [*system.q, *system.parameters], search, numbers))
    return [MomentumMap(field.name, J, field.A, field.a, any_parameters, everywhere, turned, proof)]


def _rate_terms(J: sp.Expr, system: System) -> list[sp.Expr]:
    """Return the terms of dJ/dt without constraint forces: {J, H} + J_p·F."""
    forces = system.forces or (sp.Integer(0),) * system.n
    moved = [sp.diff(J, q) * v for q, v in zip(system.q, system.H_p, strict=True)]
    pulled = [sp.diff(J, p) * (f - h)
              for p, f, h in zip(system.p, forces, system.H_q, strict=True)]
    return [*moved, *pulled]


def _proof(
    sums: Sequence[Sequence[sp.Expr]], symbols: Sequence[sp.Symbol], search: _Search,
    numbers: Mapping[Any, Any],
) -> str:
    """Return how it is known that all the sums vanish identically; empty if they do not."""
    if sum(int(sp.count_ops(e)) for terms in sums for e in terms) <= _EXPANDABLE and all(
            sp.expand(sp.Add(*(sp.expand(e) for e in terms))) == 0 for terms in sums):
        return "expanded"
    context = mp_context(_DIGITS + 10)
    for _ in range(3):
        walk = Evaluator(_random_point(search, symbols, numbers, context), mp=context)
        if not all(_vanishes([walk(e) for e in terms], context) for terms in sums):
            return ""
    return f"{_DIGITS} digits"


def _random_point(
    search: _Search, symbols: Sequence[sp.Symbol], numbers: Mapping[Any, Any], context: Any
) -> dict[Any, Any]:
    """Return random values of the symbols, and the parameters' own for the rest."""
    drawn = search.points(1, manifold=False, vary=True)
    at = {s: context.mpf(x.p) / x.q for s, x in numbers.items() if s not in symbols}
    return at | {s: context.mpf(float(np.ravel(value)[0]))
                 for s, value in drawn.items() if s not in at}


def _vanishes(terms: Sequence[Any], context: Any) -> bool:
    """Whether a sum is zero to 50 digits of its largest term; a term that is no number is not."""
    if not all(context.isfinite(x) and x.imag == 0 for x in terms):
        return False
    size = max((abs(x) for x in terms), default=context.zero)
    return bool(abs(context.fsum(terms)) <= size * context.mpf(10) ** -_DIGITS)


def _proof_on_manifold(search: _Search, J: sp.Expr) -> str:
    """Return how it is known that dJ/dt vanishes where g = 0; empty if it does not."""
    at = search.points(50, manifold=True, vary=False)
    terms = _at_points(_rate_terms(J, search.system), at)
    usable = np.isfinite(terms).all(axis=0)
    rates, sizes = np.abs(terms.sum(axis=0))[usable], np.abs(terms).max(axis=0)[usable]
    return "random points" if usable.any() and (rates <= 1e-10 * sizes).all() else ""
