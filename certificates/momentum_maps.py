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
from numpy.typing import ArrayLike

from ..core.arrays import Floats
from ..generator.symbolic.finite_fields import identically_zero
from ..generator.symbolic.shared_subexpressions import substitute
from ..generator.symmetry.linear_fields import LinearField, known_fields, motions_of_space
from ..generator.symmetry.symmetry_conditions import SymmetrySpace
from ..generator.systems.smoothness import on_any_side
from ..generator.systems.system import System
from .near_symmetries import NEAR, RandomPoints

__all__ = ["MAX_COORDINATES", "MomentumMap", "momentum_map_of", "momentum_maps"]

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
        Whether it is conserved for any parameters, or for the given ones only.
    everywhere : bool
        Whether {H, J} = F·X holds for all q and p, in exact arithmetic; otherwise at random points
        on the constraints, or nearly.
    turns_constraints : bool
        Whether g_q X vanishes for all q, or on g = 0 only.
    proof : str
        The evidence: "expanded", which is a proof, "exact arithmetic at random points", or "random
        points" in doubles.
    symmetry_defect : float
        The largest |dJ/dt| at random points, relative to its terms; 0 if it vanishes everywhere.
    on_constraints : bool
        Whether ``symmetry_defect`` is round-off on g = 0: the motion then conserves J as far as
        measured.
    """

    name: str
    J: sp.Expr
    A: Floats
    a: Floats
    any_parameters: bool
    everywhere: bool
    turns_constraints: bool
    proof: str
    symmetry_defect: float = 0.0
    on_constraints: bool = False

    def values(self, q: Floats, p: Floats) -> Floats:
        """Return J of each row of q and p, shapes (..., n)."""
        return np.asarray(np.einsum("...i,...i->...", p, q @ self.A.T + self.a))

    def sizes(self, q: Floats, p: Floats) -> Floats:
        """Return |p| (|A| |q| + |a|), the size of the terms of J, to which its round-off is
        relative.

        Norms are taken, not sums of terms: rounding moves a motion out of its plane by ε of its
        size.
        """
        used_rows, used_columns = self.A.any(axis=1) | (self.a != 0), self.A.any(axis=0)
        reach = np.linalg.norm(q[..., used_columns], axis=-1) * np.linalg.norm(self.A)
        momenta = np.linalg.norm(p[..., used_rows], axis=-1)
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
    parameter_values = {s: float(parameters[str(s)]) for s in system.parameters if s not in weights}
    exact_values = {s: sp.Rational(x) for s, x in parameter_values.items()}  # of doubles, exactly
    points = RandomPoints(system, parameter_values, np.asarray(q0, float), np.asarray(p0, float))
    named_fields, n = known_fields(system), system.n
    full = n <= MAX_COORDINATES
    # one entry each of (A | a), n × (n + 1); for many coordinates fields with a name alone
    units = [LinearField("", n, {(i, j): Fraction(1)}) for i in range(n) for j in range(n + 1)]
    exact = SymmetrySpace(system, units if full else named_fields, exact_values)
    # symmetries of ``exact`` that hold whatever the parameters
    general = SymmetrySpace(system, exact.fields, numbers={}, within=exact)
    independent = _IndependentMaps(points)
    maps: list[MomentumMap] = []
    # maps for any parameters first; then those that need the values. Named ones come first in both,
    # so that a basis has as many names as it can
    for space, any_parameters in ((general, True), (exact, False)):
        in_space = [field for field in named_fields if space.contains(field)]
        for field in [*in_space, *(with_name(f, system) for f in space.basis)]:
            if independent.accepts(field, threshold=1e-9):
                maps.append(_exact_map(field, system, {} if any_parameters else exact_values))
    return maps + list(_near_maps(points, named_fields, independent, full))


def momentum_map_of(
    A: ArrayLike, name: str, system: System, *, any_parameters: bool
) -> MomentumMap:
    """Return the map pᵀA q of a symmetry of a co-moving frame, A in doubles, shape (n, n).

    The search for the frame has proved the symmetry. Entries of A are fractions with small
    denominators, which the doubles determine: the nearest ones with denominators ≤ 1000.
    """
    entries = {(int(i), int(j)): Fraction(float(np.asarray(A)[i, j])).limit_denominator(1000)
               for i, j in np.argwhere(np.asarray(A))}
    field = LinearField(name, system.n, entries)
    return MomentumMap(
        name, field.momentum(system.q, system.p), field.A, field.a, any_parameters=any_parameters,
        everywhere=True, turns_constraints=True, proof="proved with the frame")


def _exact_map(
    field: LinearField, system: System, exact_values: Mapping[sp.Symbol, sp.Rational]
) -> MomentumMap:
    """Return the map J of a symmetry: proved by expansion, where that is short enough.

    J̇ = J_q·H_p − J_p·(H_q − F) = 0, and G J_p = 0 where J does not move the constraints.
    """
    J = field.momentum(system.q, system.p)
    J_p = [sp.diff(J, p) for p in system.p]
    rate = [*(sp.diff(J, q) * v for q, v in zip(system.q, system.H_p, strict=True)),
            *(-x * f for x, f in zip(J_p, system.minus_p_rate, strict=True))]
    constraint_rates = [substitute([a * x for a, x in zip(row, J_p, strict=True)], exact_values)
                        for row in system.G]
    return MomentumMap(
        field.name, J, field.A, field.a, any_parameters=not exact_values, everywhere=True,
        turns_constraints=bool(identically_zero(constraint_rates)),
        proof=identically_zero([substitute(rate, exact_values)]),
    )


def _near_maps(
    points: RandomPoints, named_fields: Sequence[LinearField], independent: _IndependentMaps,
    full: bool,
) -> Iterator[MomentumMap]:
    """Yield fields whose momentum is conserved at random points, to ``NEAR`` or on g = 0 alone.

    ``named_fields`` are tried first, with ``full`` also the fields of the null space beside them.
    Fields of nearly conserved momenta count as independent if they differ by a thousandth.
    """
    system = points.system
    unnamed_fields = _echelon(points.null_space(named_fields), system) if full else []
    for field in [*named_fields, *unnamed_fields]:
        defect, on_constraints = points.symmetry_defect(field)
        is_round_off = on_constraints and defect <= _ROUNDING
        if defect <= NEAR and independent.accepts(field, 1e-9 if is_round_off else 1e-3):
            yield MomentumMap(
                field.name, field.momentum(system.q, system.p), field.A, field.a,
                any_parameters=False, everywhere=False, turns_constraints=False,
                proof="random points", symmetry_defect=defect, on_constraints=is_round_off)


# ---------------------------------------------------------------- a basis for people


class _IndependentMaps:
    """Linearly independent momentum maps, by their values at points on the constraints."""

    def __init__(self, points: RandomPoints) -> None:
        """Draw the points, shape (points, n) of q and p, and begin with no map."""
        self.q, self.p = points.moving_states()
        # orthonormal columns: a basis of the values of the accepted maps at the points
        self.basis = np.zeros((len(self.q), 0))

    def accepts(self, field: LinearField, threshold: float) -> bool:
        """Add a field and return True if its J is independent of the earlier ones.

        J = p·(A q + a) is compared at random points. J = 0 on the constraints is not independent.
        ``threshold`` is the least norm of the part orthogonal to the earlier J, relative to the
        terms of J.
        """
        X = self.q @ field.A.T + field.a
        J = np.einsum("ki,ki->k", self.p, X)
        size = np.linalg.norm(self.p, axis=1)
        terms = size * (np.linalg.norm(self.q, axis=1) * np.linalg.norm(field.A)
                        + np.linalg.norm(field.a))
        # relative to |p|, whose decades would leave a few points to decide
        J, weight = J / size, np.linalg.norm(terms / size)
        remainder = J - self.basis @ (self.basis.T @ J)
        remainder -= self.basis @ (self.basis.T @ remainder)  # again, against round-off
        length = np.linalg.norm(remainder)
        if not length > threshold * weight:
            return False
        self.basis = np.column_stack([self.basis, remainder / length])
        return True


def _echelon(space: Floats, system: System) -> list[LinearField]:
    """Return a basis in reduced echelon form, with simple fractions where entries are close.

    ``space``, shape (n (n + 1), fields), has a field in each column: the entries of (A | a), row by
    row. By Gauss-Jordan elimination with the largest entry of a column as its pivot.
    """
    basis, n = space.T.copy(), system.n  # rows are fields; a copy, since they are changed in place
    rank = 0
    for column in range(basis.shape[1]):
        if rank == len(basis):
            break
        pivot = rank + int(np.abs(basis[rank:, column]).argmax())
        if abs(basis[pivot, column]) < 1e-8:  # round-off of unit vectors: no pivot here
            continue
        basis[[rank, pivot]] = basis[[pivot, rank]]
        basis[rank] /= basis[rank, column]
        other_rows = np.arange(len(basis)) != rank
        basis[other_rows] -= np.outer(basis[other_rows, column], basis[rank])
        rank += 1
    fields: list[LinearField] = []
    for row in basis:
        weights = {divmod(k, n + 1): _fraction(x) for k, x in enumerate(row.tolist())}
        weights = {entry: x for entry, x in weights.items() if x}
        fields.append(with_name(LinearField("", n, weights), system))
    return fields


def _fraction(x: float) -> Fraction:
    """Return the fraction with denominator ≤ 10,000 within 1e-9 of x, otherwise x itself."""
    simple = Fraction(x).limit_denominator(10_000)
    return simple if abs(simple - Fraction(x)) < Fraction(1, 10**9) else Fraction(x)


def with_name(field: LinearField, system: System) -> LinearField:
    """Return a field with a name: a motion of space about or along an axis, otherwise its J."""
    motions = motions_of_space(system)  # rotations about three axes, then translations
    # in space there are three rotations, in a plane one
    if sum(bool(f.A.any()) for f in motions) == 3:
        # an entry of (A | a) belongs to one motion alone, so it gives this motion's weight
        entries = (next(iter(motion.weights.items())) for motion in motions)
        weights = [field.weights.get(entry, Fraction(0)) / x for entry, x in entries]
        if LinearField.linear_combination("", weights, motions, field.n).weights == field.weights:
            return _motion_about_axis(field, weights[:3], weights[3:])
    text = str(field.momentum(system.q, system.p))
    return LinearField(text if len(text) <= 60 else text[:59] + "…", field.n, field.weights)


def _motion_about_axis(
    field: LinearField, about: Sequence[Fraction], along: Sequence[Fraction]
) -> LinearField:
    """Return a motion of space with the name of its axis.

    ``about`` are the weights of the three rotations, ``along`` of the translations: of a motion
    with a rotation the name has its axis, which need not go through the origin. The axis has length
    1 in the name, and the sign that makes its last component positive; the field has this sign.
    """
    kind = "angular momentum about" if any(about) else "linear momentum along"
    axis = about if any(about) else along
    last = next(x for x in reversed(axis) if x)
    sign = -1 if last < 0 else 1
    length = float(np.linalg.norm([float(x) for x in axis])) * sign
    direction = ", ".join(f"{float(x) / length + 0.0:.6g}" for x in axis)  # + 0.0: 0 and not -0
    suffix = ", off the origin" if any(about) and any(along) else ""
    signed_field = LinearField.linear_combination("", [Fraction(sign)], [field], field.n)
    return LinearField(f"{kind} ({direction}){suffix}", field.n, signed_field.weights)
