"""A system with its numbers, before anything is compiled: g, g_q, A, H_p in NumPy.

g_q is Im g(q + iε e_k)/ε, exact to round-off: a method that shares nothing with the derived
formulas. In a large system g_q and H_pp are sparse: one evaluation serves all columns of which no
constraint, or term of H, contains two.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

from ...core.arguments import as_mapping, shown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.inertia import real_array
from ...core.projection import as_dense
from ...core.records import dataclass
from ..symbolic.derivatives import derivative
from ..symbolic.numeric_evaluation import evaluate
from .lagrangian import LagrangianSystem
from .system import System

if TYPE_CHECKING:
    from scipy.sparse import csr_array

__all__ = ["NumericConstraints", "NumericSystem", "numeric"]

TINY = 1e-100  # ε of the complex step: its square vanishes beside 1
#: Entries of g_q from which on it is sparse.
_SPARSE = 200_000
#: Step of the differences for H_pp, relative to the largest momentum.
_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Pattern:
    """Entries of a Jacobian that are not always 0, by row and column, and colours of columns.

    Columns of one colour have no row in common.
    """

    rows: Array  # row of each entry, shape (entries,)
    columns: Array  # column of each entry, shape (entries,)
    colours: Array  # shape (columns,)

    @classmethod
    def of(cls, expressions: Sequence[sp.Expr], symbols: Sequence[sp.Symbol]) -> Pattern:
        """Return the pattern of ∂expression/∂symbol: an entry where a row contains the symbol."""
        column_of = {x: i for i, x in enumerate(symbols)}
        return cls.of_rows([sorted(column_of[s] for s in e.free_symbols if s in column_of)
                            for e in expressions], len(symbols))

    @classmethod
    def of_rows(cls, rows: Sequence[Sequence[int]], columns: int) -> Pattern:
        """Return the pattern of a matrix; ``rows`` has the columns of each row's entries.

        ``columns`` is the number of columns.
        """
        return cls(np.repeat(np.arange(len(rows)), list(map(len, rows))),
                   np.array([i for row in rows for i in row], dtype=int),
                   find_colours(rows, columns))

    @property
    def masks(self) -> Array:
        """Matrix with 1 where a column has a colour and 0 elsewhere, shape (columns, colours)."""
        return np.equal.outer(self.colours, np.arange(self.colours.max(initial=0) + 1)) * 1.0

    def jacobian_entries(
        self, expressions: Sequence[sp.Expr], x: Array,
        substitute: Callable[[Array], dict[sp.Symbol, Any]]
    ) -> Array:
        """Return the entries ∂f_row/∂x_column by complex steps, Im f(x + iε)/ε.

        Columns of one colour share no row, so that one evaluation serves all of them. x has shape
        (n,) or (n, points), the result (entries,) or (entries, points); ``substitute`` returns the
        values of all symbols at x.
        """
        steps = 1j * TINY * self.masks
        points = (x[:, None] + steps if x.ndim == 1 else x[:, None, :] + steps[:, :, None])
        with np.errstate(over="ignore"):  # callers check that entries are finite
            derivatives: Array = evaluate(expressions, substitute(points)).imag / TINY
        return derivatives[self.rows, self.colours[self.columns]]


def _sparse(shape: tuple[int, int], rows: Array, columns: Array, entries: Array) -> csr_array:
    """Return the sparse matrix with these entries at (row, column)."""
    from scipy.sparse import csr_array  # takes 0.1 s

    return csr_array((entries, (rows, columns)), shape)


def find_colours(rows: Sequence[Sequence[int]], columns: int) -> Array:
    """Return a colour for each column, so that no row contains two columns of one colour.

    ``rows`` has the columns of each row's entries; ``columns`` is the number of columns. One
    evaluation then serves all columns of a colour (Curtis, Powell and Reid, 1974).
    """
    rows_of: list[list[int]] = [[] for _ in range(columns)]
    for row, entries in enumerate(rows):
        for column in entries:
            rows_of[column].append(row)
    # greedy: the smallest colour that no column in a row with this one has; −1 is no colour yet
    colours = np.full(columns, -1)
    for column, rows_of_column in enumerate(rows_of):
        taken_colours = {int(colours[other]) for row in rows_of_column for other in rows[row]}
        colours[column] = next(c for c in range(len(taken_colours) + 1) if c not in taken_colours)
    return colours


class NumericConstraints:
    """g, g_q and A at given parameters; states are float arrays, shape (n,).

    They are evaluated from expressions: ``constraints`` g(q) = 0, ``A`` and ``a`` of the velocity
    constraints A(q) q̇ + a(q) = 0, row by row, and ``g_t`` = ∂g/∂t, by default 0.
    """

    def __init__(
        self, q: Sequence[sp.Symbol], constraints: Sequence[sp.Expr], names: Sequence[str],
        parameters: Mapping[str, float], A: Sequence[Sequence[sp.Expr]] = (),
        a: Sequence[sp.Expr] = (), velocity_constraint_names: Sequence[str] = (),
        g_t: Sequence[sp.Expr] = (),
    ) -> None:
        """Store g, A, a and g_t, in the symbols ``q`` and in parameters with values.

        ``names`` has a name for each entry of g. Raises InputError for a parameter without a value.
        """
        self.constraint_names = names
        self.velocity_constraint_names = velocity_constraint_names
        self._A, self._a = [e for row in A for e in row], list(a)
        self._g_t = list(g_t) or [sp.Integer(0)] * len(constraints)
        self.coordinates = [str(x) for x in q]
        self.expressions = constraints
        self.symbols, self.values = q, parameters
        symbols: set[sp.Symbol] = set().union(
            *(e.free_symbols for e in (*constraints, *self._A, *self._a, *self._g_t)))
        self._parameters = values_of(symbols - set(q), parameters)

    def set_value(self, symbol: sp.Symbol, value: float) -> None:
        """Give a parameter another value."""
        self._parameters[symbol] = value

    def g(self, q: Array) -> Array:
        """Return g(q), shape (m,)."""
        return evaluate(self.expressions, self._at(q))

    @cached_property
    def is_sparse(self) -> bool:
        """Whether g_q is sparse: it is large, and there are no velocity constraints."""
        return not self._A and len(self.expressions) * len(self.coordinates) > _SPARSE

    @cached_property
    def _pattern(self) -> Pattern:
        """The pattern of g_q."""
        return Pattern.of(self.expressions, self.symbols)

    def G(self, q: Array) -> Array | csr_array:
        """Return g_q, shape (m, n), by complex steps; callers check that it is finite."""
        if self.is_sparse:
            columns, rows = self._pattern.columns, self._pattern.rows
            slopes = self._pattern.jacobian_entries(self.expressions, q, self._at)
            return _sparse((len(self.expressions), len(q)), rows, columns, slopes)
        directions = q[:, None] + 1j * TINY * np.eye(len(q))
        with np.errstate(over="ignore"):
            dense: Array = evaluate(self.expressions, self._at(directions)).imag / TINY
        return dense

    def A(self, q: Array) -> Array:
        """Return the coefficients of the velocity constraints, shape (m', n)."""
        return evaluate(self._A, self._at(q)).reshape(len(self.velocity_constraint_names), len(q))

    def a(self, q: Array) -> Array:
        """Return the velocity constraints at rest, shape (m',)."""
        return evaluate(self._a, self._at(q))

    def drift(self, q: Array) -> Array:
        """Return g_t and below it a, shape (m + m',): ``rows`` q̇ + ``drift`` = 0."""
        return evaluate([*self._g_t, *self._a], self._at(q))

    def rows(self, q: Array) -> Array | csr_array:
        """Return g_q and below it A, shape (m + m', n)."""
        return np.vstack([as_dense(self.G(q)), self.A(q)]) if self._A else self.G(q)

    @property
    def names(self) -> list[str]:
        """Names of the rows."""
        return [*self.constraint_names, *self.velocity_constraint_names]

    def _at(self, q: Array) -> dict[sp.Symbol, Any]:
        """Return the value of each symbol at q, shape (n,) or (n, points)."""
        return dict(zip(self.symbols, q, strict=True)) | self._parameters


class NumericSystem(NumericConstraints):
    """g, g_q, H and H_p of a system at given parameters and one time."""

    def __init__(self, system: System, parameters: Mapping[str, float], t: float = 0.0) -> None:
        """Store a system with numbers for its parameters; all is evaluated at the time t."""
        time = {} if system.time is None else {str(system.time): t}
        values = {**as_mapping("parameters", parameters, "{'m': 1.0}"), **time}
        super().__init__(system.q, system.constraints, system.constraint_names, values,
                         system.A, system.a, system.velocity_constraint_names)
        self.system = system
        self.momenta = [str(x) for x in system.p]
        # H contains parameters that the constraints do not
        self._parameters = values_of(
            [*system.parameters, *filter(None, (system.time,))], values)

    def H_p(self, q: Array, p: Array) -> Array:
        """Return the velocity H_p in the shape of p, (n,) or (n, points)."""
        if not self.is_sparse:
            return evaluate(self._velocity, self._state(q, p))
        # H is a sum of terms with few momenta each: their derivatives are added up by momentum
        slopes = self._momenta_of_terms.jacobian_entries(
            self._terms, p, partial(self._state, q))
        sums = np.zeros(p.shape)
        np.add.at(sums, self._momenta_of_terms.columns, slopes)
        return sums

    def f(self, q: Array, p: Array) -> Array:
        """Return the constraints' rates g_q H_p + g_t and A H_p + a, shape (m + m',).

        g_t is computed by a complex step of t.
        """
        rates: Array = self.rows(q) @ self.H_p(q, p)
        if self._A:
            rates[len(self.expressions):] += self.a(q)
        if self.system.clock is None:
            return rates
        later = self._at(q) | {self.system.clock: self._parameters[self.system.clock] + 1j * TINY}
        rates[: len(self.expressions)] += evaluate(self.expressions, later).imag / TINY
        return rates

    def W(self, q: Array, p: Array, G: Any) -> Array | csr_array:
        """Return G H_pp Gᵀ for rows G, shape (rows, n); sparse G takes H_pp by differences."""
        if not isinstance(G, np.ndarray):
            return G @ (self._sparse_H_pp(q, p) @ G.T)
        if not len(G):
            return np.zeros((0, 0))
        matrix: Array = G @ self.H_pp_times(q, p, G.T)
        return matrix

    def H_pp_times(self, q: Array, p: Array, directions: Array) -> Array:
        """Return H_pp times directions of momenta, shape (n, k)."""
        along = self._state(q[:, None], p[:, None] + 1j * TINY * directions)
        slopes: Array = evaluate(self._velocity, along).imag / TINY
        return slopes

    @cached_property
    def _terms(self) -> tuple[sp.Expr, ...]:
        """The terms of H with momenta."""
        momenta = {*self.system.p}
        return tuple(term for term in sp.Add.make_args(self.system.H)
                     if not momenta.isdisjoint(term.free_symbols))

    @cached_property
    def _momenta_of_terms(self) -> Pattern:
        """The momenta (columns) that each term of ``_terms`` (rows) contains."""
        return Pattern.of(self._terms, self.system.p)

    @cached_property
    def _kinetic_pattern(self) -> Pattern:
        """The pattern of H_pp: momenta with a term of H in common."""
        n, terms = self.system.n, self._momenta_of_terms
        columns_of_row: list[set[int]] = [set() for _ in range(n)]
        # entries are sorted by term: a new term begins where the row number changes
        term_starts = np.flatnonzero(np.diff(terms.rows)) + 1
        for momenta in np.split(terms.columns, term_starts):
            for i in momenta.tolist():
                columns_of_row[i].update(momenta.tolist())
        return Pattern.of_rows([sorted(columns) for columns in columns_of_row], n)

    def _sparse_H_pp(self, q: Array, p: Array) -> csr_array:
        """Return H_pp, (n, n), by central differences of H_p: exact to round-off for quadratic H.

        It is the matrix of Newton's method, whose rate, not result, depends on its errors.
        """
        pattern, n = self._kinetic_pattern, self.system.n
        step = _STEP * (float(np.abs(p).max()) or 1.0)
        masks = step * pattern.masks
        rates = (self.H_p(q, p[:, None] + masks) - self.H_p(q, p[:, None] - masks)) / (2 * step)
        return _sparse((n, n), pattern.rows, pattern.columns,
                       rates[pattern.rows, pattern.colours[pattern.columns]])

    @cached_property
    def _velocity(self) -> list[sp.Expr]:
        """H_p, n entries: each term of H is differentiated by the momenta that it contains."""
        by_momentum: dict[sp.Symbol, list[sp.Expr]] = {x: [] for x in self.system.p}
        for term in sp.Add.make_args(self.system.H):
            for x in term.free_symbols & by_momentum.keys():
                by_momentum[x].append(derivative(term, x))
        return [sp.Add(*terms) for terms in by_momentum.values()]

    def _state(self, q: Array, p: Array) -> dict[sp.Symbol, Any]:
        """Return the value of each symbol at (q, p)."""
        return self._at(q) | dict(zip(self.system.p, p, strict=True))


class NumericLagrangian(NumericSystem):
    """Numeric functions of a Lagrangian system; M(q) is evaluated in numbers."""

    system: LagrangianSystem

    def H_p(self, q: Array, p: Array) -> Array:
        """Return the velocity M⁻¹(p − b), shape (n,)."""
        b = evaluate(self.system.rest_momenta, self._at(q))
        velocity: Array = np.linalg.solve(self._mass(q), p - b)
        return velocity

    @property
    def is_sparse(self) -> bool:
        """Never: M⁻¹ is dense."""
        return False

    def W(self, q: Array, p: Array, G: Any) -> Array:
        """Return G M⁻¹ Gᵀ, shape (m, m)."""
        matrix: Array = G @ np.linalg.solve(self._mass(q), G.T)
        return matrix

    def _mass(self, q: Array) -> Array:
        """Return M(q), shape (n, n), from its stored entries; ``slot_of`` has both triangles."""
        entries = evaluate(self.system.mass_entries, self._at(q))
        M = np.zeros((self.system.n, self.system.n))
        for index, slot in self.system.elimination.slot_of.items():
            M[index] = entries[slot]
        return M


def numeric(system: System, parameters: Mapping[str, float], t: float = 0.0) -> NumericSystem:
    """Return a system of either kind with its numbers."""
    kind = NumericLagrangian if isinstance(system, LagrangianSystem) else NumericSystem
    return kind(system, parameters, t)


def values_of(symbols: Any, parameters: Mapping[str, float]) -> dict[sp.Symbol, float]:
    """Return symbol → value; raise InputError for a missing value or one that is no number."""
    values = as_mapping("parameters", parameters, "{'m': 1.0}")
    value_of = {}
    for symbol in sorted(symbols, key=str):
        if str(symbol) not in values:
            raise InputError(f"Parameter {str(symbol)!r} has no value; give one.")
        number = real_array(values[str(symbol)])
        if number is None or number.ndim or not np.isfinite(number):
            raise InputError(f"Parameter {symbol} = {shown(values[str(symbol)])} is no finite "
                             "number.")
        value_of[symbol] = float(number)
    return value_of
