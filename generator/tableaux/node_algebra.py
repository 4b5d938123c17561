"""Functions on a set of nodes, with exact arithmetic.

Every condition on a tableau is a statement about functions of a node: sums over the nodes,
products, powers of the node. Two representations have the same operations:

- ``PolynomialNodes``: nodes are the roots of a rational polynomial M. A function is an element
  of ℚ[x]/(M), represented by its s coefficients; a sum over the roots is a trace. All arithmetic is
  rational, so that identities are proved without computing the roots.
- ``ValueNodes``: nodes are given numbers. A function is represented by its s values.

Coefficients a_ij are a matrix over two such spaces: rows are functions of c_i, columns functions
of c_j.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, Protocol

import mpmath as mp
import sympy as sp
from sympy import EXRAW, QQ
from sympy.polys.matrices import DomainMatrix

from .nodes import enclose_roots
from .separation_bounds import Rounding, enclosure, vanishes_to

__all__ = ["Nodes", "PolynomialNodes", "ValueNodes", "column", "magnitude"]

Matrix = Any  # DomainMatrix; SymPy ships no types


class Nodes(Protocol):
    """Operations of conditions on a set of nodes."""

    size: int
    domain: Any

    @property
    def one(self) -> Matrix:
        """The constant function 1, as a column."""

    @property
    def powers(self) -> dict[int, Matrix]:
        """Cache of ``power``, k → cᵏ; contains 0 → 1."""

    @property
    def trace(self) -> Matrix:
        """The symmetric T with fᵀ T g = Σ_nodes f g."""

    @property
    def reflection(self) -> Matrix | None:
        """The map f(c) → f(1 − c); None when the nodes are not symmetric about ½."""

    def times_node(self, f: Matrix) -> Matrix:
        """Return the function c f(c) as a column."""

    def multiply(self, f: Matrix) -> Matrix:
        """Multiplication by the function f, as a matrix."""

    def at(self, position: int) -> Matrix:
        """Evaluation at the first (0) or last (−1) node, as a row."""


def power(nodes: Nodes, k: int) -> Matrix:
    """Return the function cᵏ as a column."""
    powers = nodes.powers
    for j in range(1, k + 1):
        if j not in powers:
            powers[j] = nodes.times_node(powers[j - 1])
    return powers[k]


def column(entries: Sequence[Any], domain: Any) -> Matrix:
    """Return a column over the domain."""
    return DomainMatrix([[entry] for entry in entries], (len(entries), 1), domain)


class PolynomialNodes:
    """Functions on the roots of a rational polynomial M, by coefficients in ℚ[x]/(M)."""

    domain = QQ

    def __init__(self, polynomial: sp.Poly) -> None:
        self.polynomial = polynomial.monic()
        self.size = polynomial.degree()
        # e_0, …, e_(s−1) of M = x^s + e_(s−1) x^(s−1) + … + e_0
        self._coefficients = [QQ.from_sympy(c) for c in self.polynomial.all_coeffs()[:0:-1]]

    def __repr__(self) -> str:
        return f"<PolynomialNodes: the {self.size} roots of a polynomial>"

    @cached_property
    def one(self) -> Matrix:
        """The constant polynomial 1."""
        return column([QQ(1)] + [QQ(0)] * (self.size - 1), QQ)

    @cached_property
    def powers(self) -> dict[int, Matrix]:
        """Cache of ``power``: 0 → the constant polynomial 1, and the powers computed so far."""
        return {0: self.one}

    @cached_property
    def trace(self) -> Matrix:
        """The Hankel matrix T_ij = Σ c^(i+j) of power sums, from Newton's identities.

            P_k = −Σ_{0<j<min(k, s+1)} e_{s−j} P_{k−j} − k e_{s−k} [k ≤ s]
        """
        s = self.size
        e = self._coefficients  # x^s + e_{s−1} x^{s−1} + … + e_0
        sums = [QQ(s)]
        for k in range(1, 2 * s - 1):
            products = sum((e[s - j] * sums[k - j] for j in range(1, min(k - 1, s) + 1)), QQ(0))
            sums.append(-products - (QQ(k) * e[s - k] if k <= s else QQ(0)))
        return DomainMatrix([[sums[i + j] for j in range(s)] for i in range(s)], (s, s), QQ)

    @cached_property
    def reflection(self) -> Matrix | None:
        """The matrix of f(x) → f(1 − x); None if M(1 − x) is not ±M(x)."""
        variable = self.polynomial.gen
        mirrored = sp.Poly(self.polynomial.as_expr().subs(variable, 1 - variable), variable)
        if mirrored.monic() != self.polynomial:
            return None
        columns = [self.one]
        for _ in range(self.size - 1):
            columns.append(columns[-1] - self.times_node(columns[-1]))  # times 1 − x
        return DomainMatrix.hstack(*columns)

    def times_node(self, f: Matrix) -> Matrix:
        """Return x f: the coefficients are shifted, and x^s is reduced modulo M."""
        *low, top = f.to_list_flat()
        shifted = zip([QQ(0), *low], self._coefficients, strict=True)
        return column([a - top * m for a, m in shifted], QQ)

    def multiply(self, f: Matrix) -> Matrix:
        """Return the matrix with columns f, x f, x² f, …."""
        columns = [f]
        for _ in range(self.size - 1):
            columns.append(self.times_node(columns[-1]))
        return DomainMatrix.hstack(*columns)

    def at(self, position: int) -> Matrix:
        """Return the evaluation at 0 or 1, which must be nodes (Lobatto), as a row."""
        node = QQ(0) if position == 0 else QQ(1)
        return DomainMatrix([[node**k for k in range(self.size)]], (1, self.size), QQ)


class ValueNodes:
    """Functions on given nodes, by their values; nodes may be rounded decimals."""

    domain = EXRAW

    def __init__(self, values: Sequence[sp.Expr], rounding: Rounding | None = None) -> None:
        self.values = list(values)
        self.size = len(self.values)
        self._rounding = rounding

    def __repr__(self) -> str:
        return f"<ValueNodes: {self.size} given nodes>"

    @cached_property
    def one(self) -> Matrix:
        """A column of ones."""
        return column([sp.Integer(1)] * self.size, EXRAW)

    @cached_property
    def powers(self) -> dict[int, Matrix]:
        """Cache of ``power``: 0 → ones, and the powers computed so far."""
        return {0: self.one}

    @cached_property
    def trace(self) -> Matrix:
        """The identity: Σ f g is a sum over the values."""
        return DomainMatrix.eye(self.size, EXRAW)

    @cached_property
    def reflection(self) -> Matrix | None:
        """The reversal of the nodes if c_i + c_{s+1−i} = 1, exactly or to the given decimals."""
        for c, mirrored in zip(self.values, reversed(self.values), strict=True):
            if not vanishes_to(c + mirrored - 1, self._rounding):
                return None
        s = self.size
        rows = [[sp.Integer(int(i + j == s - 1)) for j in range(s)] for i in range(s)]
        return DomainMatrix(rows, (s, s), EXRAW)

    def times_node(self, f: Matrix) -> Matrix:
        """Return c f, entry by entry."""
        pairs = zip(self.values, f.to_list_flat(), strict=True)
        return column([value * entry for value, entry in pairs], EXRAW)

    def multiply(self, f: Matrix) -> Matrix:
        """Return the diagonal matrix of the values of f."""
        s = self.size
        values = f.to_list_flat()
        rows = [[values[i] if i == j else sp.Integer(0) for j in range(s)] for i in range(s)]
        return DomainMatrix(rows, (s, s), EXRAW)

    def at(self, position: int) -> Matrix:
        """Return the unit row that selects the first (0) or last (−1) value."""
        s = self.size
        return DomainMatrix([[sp.Integer(int(j == position % s)) for j in range(s)]], (1, s), EXRAW)


def magnitude(residual: Matrix, rows: Nodes | None, columns: Nodes | None) -> mp.mpf:
    """Return the largest |entry| of a residual, evaluated at the nodes.

    ``rows`` and ``columns`` are the nodes of which its rows and columns are functions; None where
    these are numbers.
    """
    at_rows = _at_nodes(residual.to_Matrix(), rows)
    entries = _at_nodes(at_rows.T, columns)
    return max((mp.mpf(abs(enclosure(entry)).b) for entry in entries), default=mp.mpf(0))


def _at_nodes(matrix: sp.Matrix, nodes: Nodes | None) -> sp.Matrix:
    """Return V C: the polynomials of C's columns at the nodes, V_ik = r_i^k for root r_i.

    Roots are taken to 2⁻⁶⁴, enough for the size of a residual; where there are no nodes, or nodes
    that are values, the matrix has numbers already.
    """
    if nodes is None or isinstance(nodes, ValueNodes):
        return matrix
    roots = [sp.Rational(r.centre.numerator, r.centre.denominator)
             for r in enclose_roots(nodes.polynomial, bits=64)]  # type: ignore[attr-defined]
    return sp.Matrix([[r**k for k in range(nodes.size)] for r in roots]) * matrix
