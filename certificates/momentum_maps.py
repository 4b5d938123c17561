"""Momentum maps of a system, conserved by the symmetries of H, g and F.

A point symmetry q → q + ε X(q) with X(q) = A q + a that leaves H and g alone conserves

    J(q, p) = pᵀ(A q + a),   dJ/dt = pᵀA H_p − (A q + a)·(H_q − F) − λᵀ g_q (A q + a) = 0.

Both sums are linear in A and a, and so their solutions are a linear space: it is found in exact
arithmetic, with parameters as the fractions that doubles are, or for any parameters at all
(``symmetry_conditions``). A basis of it is chosen from fields that have a name
(``linear_fields``) and filled up with its reduced echelon form.

J is conserved *by the scheme* where {H, J} = 0 for all q and p, because stages are off the
constraints; {H, J} = 0 only on g = 0 is enough for the motion. Symmetries on g = 0 only, and
such as are broken by a millionth at most, are reported as such: they are tested at random points
(``near_symmetries``).

Where H and F switch sides, as |x| does, J must be conserved on each of them: points near the start
may all lie on one. Sides are weighed with parameters for this.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike, NDArray

from ..generator.symbolic.finite_fields import identically_zero
from ..generator.symbolic.shared_subexpressions import substitute
from ..generator.symmetry.linear_fields import LinearField, known_fields, motions_of_space
from ..generator.symmetry.symmetry_conditions import SymmetrySpace
from ..generator.systems.smoothness import on_any_side
from ..generator.systems.system import System
from .near_symmetries import NEAR, RandomPoints

__all__ = ["MAX_COORDINATES", "MomentumMap", "momentum_map_of", "momentum_maps"]

Array = NDArray[np.float64]

#: Up to so many coordinates every A and a is searched, beyond it those with a name.
MAX_COORDINATES = 20
#: Round-off of dJ/dt on the constraints, relative to its terms.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class MomentumMap:
    """J = pᵀ(A q + a), conserved by the motion or nearly so.

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
        Whether {H, J} = F·X vanishes for all q and p, in exact arithmetic. Else it is seen to
        vanish on the constraint manifold, or nearly to vanish.
    turns_constraints : bool
        Whether g_q X vanishes for all q, or where g = 0 only.
    proof : str
        How it is known: "expanded", which is a proof, by "exact arithmetic at random points", or
        at "random points" in doubles.
    broken : float
        The largest |dJ/dt| met at random points, relative to its terms; 0 if it is 0 everywhere.
    on_constraints : bool
        Whether that is round-off, on g = 0: then the motion keeps J as far as can be seen.
    """

    name: str
    J: sp.Expr
    A: Array
    a: Array
    any_parameters: bool
    everywhere: bool
    turns_constraints: bool
    proof: str
    broken: float = 0.0
    on_constraints: bool = False

    def values(self, q: Array, p: Array) -> Array:
        """Return J of each row of q and p, shapes (..., n)."""
        return np.asarray(np.einsum("...i,...i->...", p, q @ self.A.T + self.a))

    def sizes(self, q: Array, p: Array) -> Array:
        """Return |p| (|A| |q| + |a|), the size of the terms of J, to which its round-off is
        relative.

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
    values = {s: float(parameters[str(s)]) for s in system.parameters if s not in weights}
    numbers = {s: sp.Rational(x) for s, x in values.items()}
    points = RandomPoints(system, values, np.asarray(q0, float), np.asarray(p0, float))
    named, n = known_fields(system), system.n
    full = n <= MAX_COORDINATES
    units = [LinearField("", n, {(i, j): Fraction(1)}) for i in range(n) for j in range(n + 1)]
    exact = SymmetrySpace(system, units if full else named, numbers)
    general = SymmetrySpace(system, exact.fields, {}, within=exact)
    chosen = _Chosen(points)
    found: list[MomentumMap] = []
    for space, any_parameters in ((general, True), (exact, False)):
        in_space = [field for field in named if space.contains(field)]
        for field in [*in_space, *(with_name(f, system) for f in space.basis)]:
            if chosen.accepts(field, 1e-9):
                found.append(_exact_map(field, system, {} if any_parameters else numbers))
    return found + list(_near_maps(points, named, chosen, full))


def momentum_map_of(
    A: ArrayLike, name: str, system: System, *, any_parameters: bool
) -> MomentumMap:
    """Return the map of a generator A of small fractions that is known to be a symmetry."""
    entries = {(int(i), int(j)): Fraction(float(np.asarray(A)[i, j])).limit_denominator(1000)
               for i, j in np.argwhere(np.asarray(A))}
    field = LinearField(name, system.n, entries)
    return MomentumMap(
        name, field.momentum(system.q, system.p), field.A, field.a, any_parameters=any_parameters,
        everywhere=True, turns_constraints=True, proof="proved with the frame")


def _exact_map(
    field: LinearField, system: System, numbers: Mapping[sp.Symbol, sp.Rational]
) -> MomentumMap:
    """Return the map of a symmetry: proved by expansion, where that is short enough."""
    J = field.momentum(system.q, system.p)
    reach = [sp.diff(J, p) for p in system.p]
    terms = [*(sp.diff(J, q) * v for q, v in zip(system.q, system.H_p, strict=True)),
             *(-x * f for x, f in zip(reach, system.minus_p_rate, strict=True))]
    slides = [substitute([a * x for a, x in zip(row, reach, strict=True)], numbers)
              for row in system.G]
    return MomentumMap(
        field.name, J, field.A, field.a, any_parameters=not numbers, everywhere=True,
        turns_constraints=bool(identically_zero(slides)),
        proof=identically_zero([substitute(terms, numbers)]),
    )


def _near_maps(
    points: RandomPoints, named: Sequence[LinearField], chosen: _Chosen, full: bool
) -> Iterator[MomentumMap]:
    """Yield fields nearly conserved, or conserved on the constraints at random points."""
    system = points.system
    others = _echelon(points.null_space(named), system) if full else []
    for field in [*named, *others]:
        broken, on_constraints = points.broken(field)
        whole = on_constraints and broken <= _ROUNDING
        if broken <= NEAR and chosen.accepts(field, 1e-9 if whole else 1e-3):
            yield MomentumMap(
                field.name, field.momentum(system.q, system.p), field.A, field.a,
                any_parameters=False, everywhere=False, turns_constraints=False,
                proof="random points", broken=broken, on_constraints=whole)


# ---------------------------------------------------------------- a basis for people


class _Chosen:
    """The J that were taken, as their values at points of the constraint manifold."""

    def __init__(self, points: RandomPoints) -> None:
        self.q, self.p = points.moving_states()
        self.basis = np.zeros((len(self.q), 0))

    def accepts(self, field: LinearField, least: float) -> bool:
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
        if not length > least * weight:
            return False
        self.basis = np.column_stack([self.basis, rest / length])
        return True


def _echelon(space: Array, system: System) -> list[LinearField]:
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
    return [with_name(LinearField("", n, {divmod(k, n + 1): _fraction(x)
                                    for k, x in enumerate(row.tolist()) if _fraction(x)}), system)
            for row in rows]


def _fraction(x: float) -> Fraction:
    """Return the simple fraction next to a number, if it is next to one."""
    simple = Fraction(x).limit_denominator(10_000)
    return simple if abs(simple - Fraction(x)) < Fraction(1, 10**9) else Fraction(x)


def with_name(field: LinearField, system: System) -> LinearField:
    """Name a field that no list has: a rotation about another axis, or else by its J."""
    moves = motions_of_space(system)
    if sum(bool(f.A.any()) for f in moves) == 3:
        weights = [field.weights.get(place, Fraction(0)) / x
                   for place, x in (next(iter(f.weights.items())) for f in moves)]
        if LinearField.combined("", weights, moves, field.n).weights == field.weights:
            about, along = weights[:3], weights[3:]
            kind = "angular momentum about" if any(about) else "linear momentum along"
            axis = about if any(about) else along
            last = next(x for x in reversed(axis) if x)
            length = float(np.linalg.norm([float(x) for x in axis])) * (-1 if last < 0 else 1)
            direction = ", ".join(f"{float(x) / length + 0.0:.6g}" for x in axis)
            place = ", off the origin" if any(about) and any(along) else ""
            whole = LinearField.combined("", [Fraction(-1 if last < 0 else 1)], [field], field.n)
            return LinearField(f"{kind} ({direction}){place}", field.n, whole.weights)
    text = str(field.momentum(system.q, system.p))
    return LinearField(text if len(text) <= 60 else text[:59] + "…", field.n, field.weights)
