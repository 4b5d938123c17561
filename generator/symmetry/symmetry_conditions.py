"""Conditions of a symmetry X(q) = A q + a of a system, in exact arithmetic.

    {J, H} + J_p·F = pᵀA H_p − (A q + a)·(H_q − F) = 0   for all q, p, t
    g_q (A q + a) = C g                                  for all q

The second states that X leaves g = 0 invariant; C may be any matrix of numbers: a rotation mixes
the three components of the constraint of a joint that holds a point of two bodies together. Both
are linear in A, a and C. Parameters are fractions (doubles are dyadic fractions) or symbols.
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
from ..symbolic.null_spaces import NullSpace, echelon_form
from ..symbolic.shared_subexpressions import substitute
from ..systems.system import System
from .linear_fields import LinearField

__all__ = ["SymmetrySpace"]

Residue = NDArray[np.int64]

#: Number of sample points beyond the number of fields that occur in a constraint.
_SPARE = 8


class SymmetrySpace:
    """The linear combinations of some fields that are symmetries of a system.

    Parameters
    ----------
    system : System
    fields : sequence of LinearField
        The fields that are combined.
    numbers : mapping of Symbol to Rational
        Values of parameters; a parameter without a value may have any value.
    within : SymmetrySpace, optional
        A space of combinations of the same fields, in which symmetries are sought.
    """

    def __init__(
        self, system: System, fields: Sequence[LinearField],
        numbers: Mapping[sp.Symbol, sp.Rational],
        within: SymmetrySpace | None = None,
    ) -> None:
        """Take the derivatives of H and of g exactly, at the ``numbers`` of parameters."""
        self.fields, self._n = list(fields), system.n
        groups = [system.minus_p_rate, system.H_p, system.constraints, *system.G]
        # one substitution for all expressions, which share their subexpressions
        exact = iter(substitute([exactly(e) for group in groups for e in group], numbers))
        self._minus_p_rate, self._velocity, self._g, *self._G = (
            [next(exact) for _ in group] for group in groups)
        self._q, self._p = list(system.q), list(system.p)
        time = () if system.time is None else (system.time,)
        self._other_symbols = [*(s for s in system.parameters if s not in numbers), *time]
        self._constants: dict[int, dict[Any, int]] = {}
        self._entries = {entry for field in fields for entry in field.weights}
        outer = None if within is None else within._space
        self._space: NullSpace = NullSpace(len(self.fields), self._blocks, outer)

    @property
    def basis(self) -> list[LinearField]:
        """A basis without names; in reduced echelon form if the fields have one entry 1 each."""
        combined = (LinearField.linear_combination(name="", factors=row, fields=self.fields,
                                                   n=self._n) for row in self._space.rows)
        return [field for field in combined if field.weights]

    def contains(self, field: LinearField) -> bool:
        """Whether a field is in the space.

        It must be one of the fields, unless each of these has one entry only, which is 1.
        """
        if field in self.fields:
            return self._space.contains([Fraction(int(field is f)) for f in self.fields])
        units = (next(iter(f.weights)) for f in self.fields)
        return self._space.contains([field.weights.get(entry, Fraction(0)) for entry in units])

    # ------------------------------------------------------------ rows modulo a prime

    def _blocks(self, prime: int) -> Iterator[Callable[[int], Residue]]:
        """Yield the conditions, first of the constraints, which reduce the space most."""
        for k in range(len(self._G)):
            yield partial(self._constraint_rows, k, prime)
        yield partial(self._bracket_rows, prime)

    def _bracket_rows(self, prime: int, count: int) -> Residue:
        """Return pᵀA H_p − (A q + a)·(H_q − F) of each field at ``count`` random points.

        The result has one row for each point and one column for each field.
        """
        residues = self._points(prime, [*self._minus_p_rate, *self._velocity], count,
                                [*self._q, *self._p])
        ones, zeros = np.ones(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        # a is column n of (A, a): its coordinate is 1, and its velocity 0
        q = [*(residues[s] for s in self._q), ones]
        v = [*(residues[e] for e in self._velocity), zeros]
        p, rate = [residues[s] for s in self._p], [residues[e] for e in self._minus_p_rate]
        return self._combine(prime, lambda i, j: (p[i] * v[j] - rate[i] * q[j]) % prime, count)

    def _constraint_rows(self, k: int, prime: int, count: int) -> Residue:
        """Return the rows of g_q (A q + a) = C g of constraint k, after C is eliminated.

        There are ``count`` random points, or fewer where few fields change g_k, and one more for
        each unknown in C. Columns are the fields.
        """
        # of each field, the columns of (A, a) by which g_k changes; few fields have any
        columns_of = [[j for i, j in field.weights if self._G[k][i] != 0] for field in self.fields]
        nonzero_columns = [columns for columns in columns_of if columns]
        coordinates = {self._q[j] for columns in nonzero_columns for j in columns if j < self._n}
        # the constraints that C may have in this row
        related = [g for g in self._g if g is self._g[k] or g.free_symbols & coordinates]
        count = min(count, len(nonzero_columns) + _SPARE) + len(related)
        residues = self._points(prime, [*related, *self._G[k]], count, self._q)
        q = [*(residues[s] for s in self._q), np.ones(count, dtype=np.int64)]
        G = [residues[e] for e in self._G[k]]
        rows = self._combine(prime, lambda i, j: G[i] * q[j] % prime, count)
        # columns g_k, then fields: eliminating the first ones removes the unknown C
        augmented_rows = np.column_stack([*(residues[g] for g in related), rows])
        reduced_rows, pivots = echelon_form(augmented_rows, prime, columns=len(related))
        return reduced_rows[len(pivots) :, len(related) :]

    def _points(
        self, prime: int, expressions: Sequence[sp.Expr], count: int, states: Sequence[sp.Symbol]
    ) -> Residues:
        """Return the residues of expressions at ``count`` random states, parameters and times."""
        constants = self._constants.setdefault(prime, {})
        symbols = [*states, *self._other_symbols]
        return Residues(prime, symbols, expressions, count, constants, seed=count)

    def _combine(self, prime: int, term: Callable[[int, int], Residue], count: int) -> Residue:
        """Return Σ_ij w_ij term(i, j) modulo the prime, shape (count, number of fields).

        A term has the shape (count,). Primes are below 2³¹, so that products fit into int64.
        """
        rows = np.zeros((count, len(self.fields)), dtype=np.int64)
        terms = {entry: term(*entry) for entry in self._entries}
        for column, field in zip(rows.T, self.fields, strict=True):
            for entry, x in field.weights.items():
                weight = x.numerator * pow(x.denominator, -1, prime) % prime
                column[:] = (column + weight * terms[entry]) % prime
        return rows
