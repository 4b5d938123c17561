"""Near symmetries: |dJ/dt| of a field relative to its terms, at random points.

Exact algebra decides whether a field is a symmetry of H and F for all q and p. Two kinds of other
fields are reported without proof: fields that break the symmetry by a millionth at most, such as a
rotation of a body with I₂ = I₁ (1 + 1e-11), and symmetries on the constraints only, such as of a
potential given for |q| = 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import sympy as sp

from ..core.arrays import Floats
from ..generator.symbolic.derivatives import derivative
from ..generator.symbolic.numeric_evaluation import Evaluator, evaluate, mp_context
from ..generator.symmetry.linear_fields import LinearField
from ..generator.systems.system import System

__all__ = ["NEAR", "RandomPoints"]

#: Conditions at many points, shape (points, m), and their derivatives, shape (points, m, n).
_Step = tuple[Floats, Floats]

#: Singular values below this part of the largest are zero in the numeric search.
_ZERO = 1e-10
#: A near symmetry is violated by at most this, relative to its terms.
NEAR = 1e-6
#: Digits of the test off the constraints, and the number of states at which it is made.
_DIGITS, _FEW = 60, 6


class _ManifoldStates(NamedTuple):
    """States on g = 0 and g_q H_p + g_t = 0: the last axis counts them."""

    q: Floats  # shape (n, states), as the next three
    p: Floats
    minus_p_rate: Floats  # H_q − F, −ṗ without constraints
    H_p: Floats
    G: Floats  # g_q, shape (m, n, states)


class RandomPoints:
    """Random states around a start, at which fields are tested as symmetries.

    Parameters without a value, such as the weights of sides, are drawn from 0 to 1. Raises
    InputError if H, g or F contains a function that cannot be evaluated.
    """

    def __init__(
        self, system: System, parameters: Mapping[sp.Symbol, float], q0: Floats, p0: Floats
    ) -> None:
        """Draw the symbols without a value, and set the spread of q and p from the start."""
        self.system, self.q0, self.p0 = system, q0, p0
        self.parameters = dict(parameters)
        self.rng = np.random.default_rng(20)
        self._draw_unknown_symbols(count=1)
        # coordinates that begin at 0 move, too, by a tenth of the largest
        self.spread = np.abs(q0) + 0.1 * (np.abs(q0).max() or 1.0)
        self.momenta = self._momentum_scale()
        # More points than fields to combine, or to compare.
        self.point_count = 200 if system.n <= 20 else 40

    def _momentum_scale(self) -> Floats:
        """Return √(2E/H_pp) for each momentum, E = Σ |q H_q| + |p H_p| at the start."""
        system = self.system
        symbol_values = self._symbol_values(self.q0[:, None], self.p0[:, None])
        slopes = _at_points([*system.H_q, *system.H_p], symbol_values)[:, 0]
        energy = float(np.abs(slopes * np.concatenate([self.q0, self.p0])).sum())
        masses = _at_points([derivative(v, x) for v, x in zip(system.H_p, system.p, strict=True)],
                            symbol_values)[:, 0]
        with np.errstate(all="ignore"):
            scale = np.sqrt(2 * energy / np.abs(masses))
        usable = np.isfinite(scale) & (scale > 0)
        return np.where(usable, scale, np.abs(self.p0).max() or 1.0)

    def _draw_unknown_symbols(self, count: int) -> None:
        """Draw values of parameters without a value, and of the time, for one set of points."""
        system = self.system
        time = () if system.time is None else (system.time,)
        self._drawn_symbols = {s: self.rng.uniform(0, 1, count)
                               for s in (*system.parameters, *time) if s not in self.parameters}

    def _symbol_values(self, q: Floats, p: Floats) -> dict[Any, Any]:
        """Return symbol → value at states, with the parameters and the symbols drawn at random.

        q and p have the shape (n, states).
        """
        symbol_values: dict[Any, Any] = dict(self.parameters)
        symbol_values |= dict(zip(self.system.q, q, strict=True))
        symbol_values |= dict(zip(self.system.p, p, strict=True))
        return symbol_values | self._drawn_symbols

    def points(self, count: int, *, manifold: bool) -> dict[Any, Any]:
        """Draw states around the start, with ``manifold`` projected onto the constraints.

        Momenta are drawn over four decades, so that a broken symmetry of the kinetic energy shows
        beside the potential energy, and the reverse; a tenth of the states is at rest. Returns
        symbol → values: of each q and p ``count`` numbers, NaN where the projection fails.
        """
        n = self.system.n
        self._draw_unknown_symbols(count)
        # 0.4: the states are far from the start, and most of their projections converge. Of 40
        # states of a four-bar linkage 37 reach the constraints and move; with 0.8 it is 29.
        q = self.q0[:, None] + 0.4 * self.spread[:, None] * self.rng.standard_normal((n, count))
        sizes = 10 ** self.rng.uniform(-2, 2, count) * (self.rng.uniform(size=count) > 0.1)
        p = self.momenta[:, None] * sizes * self.rng.standard_normal((n, count))
        if manifold and self.system.m:
            # q first: the condition on p is taken at the projected q
            q = _newton(q, lambda x: self._constraint(x, p))
            p = _newton(p, lambda y: self._velocity_constraint(q, y))
        return self._symbol_values(q, p)

    def _constraint(self, q: Floats, p: Floats) -> _Step:
        """Return g and g_q at each point, shapes (points, m) and (points, m, n)."""
        system, symbol_values = self.system, self._symbol_values(q, p)
        slopes = _at_points([e for row in system.G for e in row], symbol_values).T
        g = _at_points(system.constraints, symbol_values).T
        return g, slopes.reshape(-1, system.m, system.n)

    def _velocity_constraint(self, q: Floats, p: Floats) -> _Step:
        """Return f = g_q H_p and f_p = g_q H_pp, shapes (points, m) and (points, m, n)."""
        system, symbol_values = self.system, self._symbol_values(q, p)
        _, G = self._constraint(q, p)
        masses = _at_points([e for row in system.H_pp for e in row], symbol_values).T
        speed = _at_points(system.H_p, symbol_values).T
        return np.einsum("kln,kn->kl", G, speed), G @ masses.reshape(-1, system.n, system.n)

    def moving_states(self) -> tuple[Floats, Floats]:
        """Return states on the constraints with p ≠ 0, a row each."""
        symbol_values = self.points(self.point_count, manifold=True)
        q, p = (_at_points(s, symbol_values).T for s in (self.system.q, self.system.p))
        usable = np.isfinite(q).all(axis=1) & np.isfinite(p).all(axis=1) & p.any(axis=1)
        return q[usable], p[usable]

    # ------------------------------------------------------------ how far from a symmetry

    def symmetry_defect(self, field: LinearField) -> tuple[float, bool]:
        """Return |dJ/dt| relative to its terms, and whether it is that small on g = 0 only.

        dJ/dt = (Aᵀp)·H_p − (H_q − F)·X, X = A q + a, and g_q X = 0 is needed. They are evaluated on
        the constraints in doubles, and for all q and p in arithmetic of 60 digits.
        """
        q, p, minus_p_rate, H_p, G = self._on_constraints
        # only entries that the field moves: others would be terms 0 of a sum
        moved_coordinates = sorted({i for i, _ in field.weights})
        X = (field.A @ q + field.a[:, None])[moved_coordinates]
        constraint_rate = max((_relative(row * X) for row in G[:, moved_coordinates]), default=0.0)
        rotated_momenta = sorted({j for _, j in field.weights if j < field.n})
        rate = np.concatenate([(field.A.T @ p)[rotated_momenta] * H_p[rotated_momenta],
                               -minus_p_rate[moved_coordinates] * X])
        on_constraints = max(_relative(rate), constraint_rate)
        if on_constraints > NEAR or not q.shape[1]:  # no claim where nothing can be evaluated
            return max(on_constraints, 1.0), True
        off_constraints = max((_relative(np.array(terms)) for terms in self._precise_terms(field)),
                              default=np.inf)
        if off_constraints > NEAR:
            return on_constraints, True
        return max(off_constraints, constraint_rate), False

    def _precise_terms(self, field: LinearField) -> Iterator[list[Any]]:
        """Yield the terms of {J, H} + J_p·F at a few states, in many digits."""
        weights, n = _numbers(field, self._context), field.n
        for q, p, minus_p_rate, H_p in self._precise:
            # column n of (A | a) is a, which belongs to no coordinate
            kinetic = [x * p[i] * H_p[j] for (i, j), x in weights if j < n]
            potential = [-x * minus_p_rate[i] * (q[j] if j < n else 1) for (i, j), x in weights]
            yield kinetic + potential

    @cached_property
    def _context(self) -> Any:
        """mpmath's arithmetic of 60 digits."""
        return mp_context(_DIGITS)

    @cached_property
    def _precise(self) -> list[tuple[list[Any], ...]]:
        """q, p, H_q − F and H_p at a few states where all are real and finite."""
        system, states = self.system, []
        points = self.points(self.point_count, manifold=False)
        for k in range(self.point_count):
            symbol_values = {s: self._context.mpf(float(np.broadcast_to(x, self.point_count)[k]))
                             for s, x in points.items()}
            if k % 2:  # at rest, kinetic energy does not hide a broken symmetry of V
                symbol_values |= dict.fromkeys(system.p, self._context.zero)
            evaluator = Evaluator(symbol_values, mp=self._context)
            try:
                evaluated = [[evaluator(e) for e in symbols] for symbols in
                             (system.q, system.p, system.minus_p_rate, system.H_p)]
            except (ArithmeticError, ValueError):
                continue
            if all(self._context.isfinite(x) and x.imag == 0 for symbols in evaluated
                   for x in symbols):
                states.append(tuple(evaluated))
            if len(states) == _FEW:
                break
        return states

    @cached_property
    def _on_constraints(self) -> _ManifoldStates:
        """Random states on the constraints at which all functions are finite.

        Others are left out: any sample of states can show that a field is no symmetry.
        """
        system, symbol_values = self.system, self.points(self.point_count, manifold=True)
        entries_of_G = [e for row in system.G for e in row]
        arrays = [_at_points(e, symbol_values) for e in (
            system.q, system.p, system.minus_p_rate, system.H_p, entries_of_G)]
        usable = np.isfinite(np.concatenate(arrays)).all(axis=0)
        q, p, minus_p_rate, H_p, G = (array[:, usable] for array in arrays)
        return _ManifoldStates(q, p, minus_p_rate, H_p,
                               G.reshape(system.m, system.n, q.shape[1]))

    # ------------------------------------------------------------ combinations

    def null_space(self, fields: Sequence[LinearField]) -> Floats:
        """Return an orthonormal basis of the combinations of fields that satisfy dJ/dt = 0.

        On the constraints, to 1e-10 at random points; shape (n (n + 1), dimension), A and a as one
        matrix.
        """
        span = _orthonormal(np.array([field.matrix.ravel() for field in fields]).T)
        q, p, minus_p_rate, H_p, G = self._on_constraints
        ones, zeros = np.ones((1, q.shape[1])), np.zeros((1, q.shape[1]))
        # with (q, 1) and (H_p, 0), dJ/dt = Σ_ij (A | a)_ij (p_i (H_p, 0)_j − (H_q − F)_i (q, 1)_j)
        q1, v0 = np.concatenate([q, ones]), np.concatenate([H_p, zeros])
        conditions = [np.einsum("ik,jk->kij", p, v0) - np.einsum("ik,jk->kij", minus_p_rate, q1)]
        conditions += [np.einsum("ik,jk->kij", row, q1) for row in G]
        return np.asarray(span @ _null_space(np.concatenate([_normalise_rows(condition) @ span
                                                             for condition in conditions])))


def _numbers(field: LinearField, context: Any) -> list[tuple[tuple[int, int], Any]]:
    """Return the entries of (A | a) that are not 0, as (row, column) and a number of mpmath."""
    return [(entry, context.mpf(x.numerator) / x.denominator)
            for entry, x in field.weights.items()]


def _relative(terms: Floats) -> float:
    """Return the largest |Σ terms|/max |terms| over all points; 0 for no terms, inf for NaN.

    ``terms`` has the shape (terms, points), or (terms,) for one point.
    """
    sizes = abs(terms).max(axis=0, initial=0)
    with np.errstate(all="ignore"):  # a sum that overflows gives inf or NaN
        ratios = abs(terms.sum(axis=0)) / np.where(sizes > 0, sizes, 1)
    largest = float(np.max(ratios, initial=0))
    # NaN is below no bound and above none: as inf it is refused as a symmetry by each comparison
    return math.inf if math.isnan(largest) else largest


def _normalise_rows(conditions: Floats) -> Floats:
    """Return one row of length 1 for each condition; conditions that are 0 or not finite have none.

    ``conditions`` has the shape (points, n, n + 1): a matrix becomes a row of n (n + 1) numbers.
    """
    conditions = conditions.reshape(len(conditions), -1)
    lengths = np.linalg.norm(conditions, axis=1)
    usable = np.isfinite(lengths) & (lengths > 0)
    return np.asarray(conditions[usable] / lengths[usable, None])


def _orthonormal(columns: Floats) -> Floats:
    """Return an orthonormal basis of the span of the columns, in columns."""
    U, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(U[:, sizes > _ZERO * sizes[0]])


def _null_space(conditions: Floats) -> Floats:
    """Return an orthonormal basis, as columns, of the null space of ``conditions``, a row each."""
    size = conditions.shape[1]
    if len(conditions) < size:  # too few points where everything is finite: nothing is claimed
        return np.zeros((size, 0))
    _, sizes, V = np.linalg.svd(np.linalg.qr(conditions, mode="r"))  # many more rows than columns
    rank = int((sizes > _ZERO * max(1.0, sizes[0])).sum())
    return np.asarray(V[rank:].T)


def _newton(x: Floats, conditions: Callable[[Floats], _Step]) -> Floats:
    """Return points, shape (n, points), moved to where the conditions vanish; NaN where they don't.

    Each of at most 12 iterations makes the linearised conditions vanish by the shortest increments:
    near a solution the number of correct digits doubles. Every point is solved by itself.
    """
    converged = np.zeros(x.shape[1], dtype=bool)
    for _ in range(12):
        defect, slopes = conditions(x)
        usable = np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(defect).all(axis=1)
        step = np.full(x.shape, np.nan)  # a point without finite conditions is lost
        step[:, usable] = (np.linalg.pinv(slopes[usable]) @ defect[usable, :, None])[:, :, 0].T
        x = x - step
        converged = np.abs(step).max(axis=0) <= 1e-12 * np.abs(x).max(axis=0)
        if converged[usable].all():
            break
    return np.where(converged, x, np.nan)


def _at_points(expressions: Sequence[sp.Expr], symbol_values: Mapping[Any, Any]) -> Floats:
    """Return the expressions at many points, shape (expressions, points); NaN where undefined."""
    with np.errstate(all="ignore"):
        return np.asarray(evaluate(expressions, symbol_values), dtype=float)
