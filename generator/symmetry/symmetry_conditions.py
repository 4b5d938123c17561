"""Conditions of a symmetry X(q) = A q + a of a system, in exact arithmetic.

    {J, H} + J_p·F = pᵀA H_p − (A q + a)·(H_q − F) = 0   for all q, p, t
    g_q (A q + a) = C g                                  for all q

The second states that X leaves g = 0 invariant; C may be any matrix of numbers: where two bodies
hold a point in common, a rotation turns the three components of that constraint into one another.
Both are linear in A, a and C, with parameters as fractions, which all doubles are, or as symbols.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from ..symbolic.finite_fields import Residues, exactly
from ..symbolic.null_spaces import NullSpace, reduced
from ..symbolic.shared_subexpressions import substitute
from ..systems.system import System
from .linear_fields import LinearField

__all__ = ["SymmetrySpace"]

Residue = NDArray[np.int64]

#: Points beyond the number of fields that a constraint knows of.
_SPARE = 8


class SymmetrySpace:
    """The combinations of some fields that are symmetries of a system.

    Parameters
    ----------
    system : System
    fields : sequence of Field
        What is combined.
    numbers : mapping of Symbol to Rational
        Values of parameters; those without one may have any.
    within : SymmetrySpace, optional
        Of the same fields: a space to look in.
    """

    def __init__(
        self, system: System, fields: Sequence[LinearField],
        numbers: Mapping[sp.Symbol, sp.Rational],
        within: SymmetrySpace | None = None,
    ) -> None:
        self.fields, self._n = list(fields), system.n
        given = [*system.minus_p_rate, *system.H_p, *system.constraints,
                 *(e for row in system.G for e in row)]
        exact = iter(substitute([exactly(e) for e in given], numbers))
        self._pull, self._speed, self._g, slopes = (
            [next(exact) for _ in range(count)]
            for count in (system.n, system.n, system.m, system.m * system.n))
        self._G = [slopes[k : k + system.n] for k in range(0, len(slopes), system.n)]
        self._q, self._p = list(system.q), list(system.p)
        time = () if system.time is None else (system.time,)
        self._others = [*(s for s in system.parameters if s not in numbers), *time]
        self._constants: dict[int, dict[Any, int]] = {}
        self._places = {place for field in fields for place in field.weights}
        outer = None if within is None else within._space
        self._space: NullSpace = NullSpace(len(self.fields), self._blocks, outer)

    @property
    def basis(self) -> list[LinearField]:
        """A basis without names; in reduced echelon form where the fields are units."""
        combined = (LinearField.combined("", row, self.fields, self._n) for row in self._space.rows)
        return [field for field in combined if field.weights]

    def contains(self, field: LinearField) -> bool:
        """Return whether a field is in the space: one of the fields, or any if they are units."""
        if field in self.fields:
            return self._space.contains([Fraction(int(field is f)) for f in self.fields])
        units = (next(iter(f.weights)) for f in self.fields)
        return self._space.contains([field.weights.get(place, Fraction(0)) for place in units])

    # ------------------------------------------------------------ rows modulo a prime

    def _blocks(self, prime: int) -> Iterator[Callable[[int], Residue]]:
        """Yield the conditions, those of the constraints first: they leave little to combine."""
        for k in range(len(self._G)):
            yield partial(self._constraint_rows, k, prime)
        yield partial(self._bracket_rows, prime)

    def _bracket_rows(self, prime: int, count: int) -> Residue:
        at = self._points(prime, [*self._pull, *self._speed], count, [*self._q, *self._p])
        one, zero = np.ones(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        q, v = [*(at[s] for s in self._q), one], [*(at[e] for e in self._speed), zero]
        p, pull = [at[s] for s in self._p], [at[e] for e in self._pull]
        return self._combined(prime, lambda i, j: (p[i] * v[j] - pull[i] * q[j]) % prime, count)

    def _constraint_rows(self, k: int, prime: int, count: int) -> Residue:
        """Return the rows of g_k from which C is eliminated."""
        places = [[j for i, j in f.weights if self._G[k][i] != 0] for f in self.fields]
        moving = [columns for columns in places if columns]
        reached = {self._q[j] for columns in moving for j in columns if j < self._n}
        beside = [g for g in self._g if g is self._g[k] or g.free_symbols & reached]
        count = min(count, len(moving) + _SPARE) + len(beside)
        at = self._points(prime, [*beside, *self._G[k]], count, self._q)
        q = [*(at[s] for s in self._q), np.ones(count, dtype=np.int64)]
        G = [at[e] for e in self._G[k]]
        rows = self._combined(prime, lambda i, j: G[i] * q[j] % prime, count)
        rows, pivots = reduced(np.column_stack([*(at[g] for g in beside), rows]), prime,
                               len(beside))
        return rows[len(pivots) :, len(beside) :]

    def _points(
        self, prime: int, expressions: Sequence[sp.Expr], count: int, states: Sequence[sp.Symbol]
    ) -> Residues:
        constants = self._constants.setdefault(prime, {})
        return Residues(prime, [*states, *self._others], expressions, count, constants, count)

    def _combined(
        self, prime: int, term: Callable[[int, int], Residue], count: int
    ) -> Residue:
        """Return Σ_ij w_ij term(i, j) of each field, a column each."""
        rows = np.zeros((count, len(self.fields)), dtype=np.int64)
        terms = {place: term(*place) for place in self._places}
        for column, field in zip(rows.T, self.fields, strict=True):
            for place, x in field.weights.items():
                weight = x.numerator * pow(x.denominator, -1, prime) % prime
                column[:] = (column + weight * terms[place]) % prime
        return rows
