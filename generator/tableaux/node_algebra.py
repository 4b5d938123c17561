"""Functions on a set of nodes, with exact arithmetic.

Every condition on a tableau is a statement about functions of a node: sums over the nodes,
products, powers of the node. Two representations answer the same few questions:

- ``PolynomialNodes``: nodes are the roots of a rational polynomial M. A function is an element
  of ℚ[x]/(M), held by its s coefficients; a sum over the roots is a trace. All arithmetic stays
  rational, so identities are proved without ever writing down a root.
- ``ValueNodes``: nodes are given numbers. A function is held by its s values.

A coefficient a_ij becomes a matrix over two such spaces: rows carry the function of c_i,
columns the function of c_j.
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
        """k → cᵏ, as far as ``power`` has formed them; begins with 0 → 1."""

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
    known = nodes.powers
    for j in range(1, k + 1):
        if j not in known:
            known[j] = nodes.times_node(known[j - 1])
    return known[k]


def column(entries: Sequence[Any], domain: Any) -> Matrix:
    """Return a column over the domain."""
    return DomainMatrix([[entry] for entry in entries], (len(entries), 1), domain)


class PolynomialNodes:
    """Functions on the roots of a rational polynomial M, by coefficients in ℚ[x]/(M)."""

    domain = QQ

    def __init__(self, polynomial: sp.Poly) -> None:
        self.polynomial = polynomial.monic()
        self.size = polynomial.degree()
        self._coefficients = [QQ.from_sympy(c) for c in self.polynomial.all_coeffs()[:0:-1]]

    def __repr__(self) -> str:
        return f"<PolynomialNodes: the {self.size} roots of a polynomial>"

    @cached_property
    def one(self) -> Matrix:
        """The constant polynomial."""
        return column([QQ(1)] + [QQ(0)] * (self.size - 1), QQ)

    @cached_property
    def powers(self) -> dict[int, Matrix]:
        """The constant polynomial, to be continued by ``power``."""
        return {0: self.one}

    @cached_property
    def trace(self) -> Matrix:
        """The Hankel matrix of the power sums Σ cᵏ, from Newton's identities."""
        s = self.size
        e = self._coefficients  # x^s + e_{s−1} x^{s−1} + … + e_0
        sums = [QQ(s)]
        for k in range(1, 2 * s - 1):
            known = sum((e[s - j] * sums[k - j] for j in range(1, min(k - 1, s) + 1)), QQ(0))
            sums.append(-known - (QQ(k) * e[s - k] if k <= s else QQ(0)))
        return DomainMatrix([[sums[i + j] for j in range(s)] for i in range(s)], (s, s), QQ)

    @cached_property
    def reflection(self) -> Matrix | None:
        """Substitution of 1 − x, when M allows it."""
        variable = self.polynomial.gen
        mirrored = sp.Poly(self.polynomial.as_expr().subs(variable, 1 - variable), variable)
        if mirrored.monic() != self.polynomial:
            return None
        columns = [self.one]
        for _ in range(self.size - 1):
            columns.append(columns[-1] - self.times_node(columns[-1]))  # times 1 − x
        return DomainMatrix.hstack(*columns)

    def times_node(self, f: Matrix) -> Matrix:
        """Shift the coefficients up; M reduces x^s."""
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
        """Evaluate at 0 or 1; only for nodes that contain them (Lobatto)."""
        value = QQ(0) if position == 0 else QQ(1)
        return DomainMatrix([[value**k for k in range(self.size)]], (1, self.size), QQ)


class ValueNodes:
    """Functions on given nodes, by their values, which may be rounded."""

    domain = EXRAW

    def __init__(self, values: Sequence[sp.Expr], rounding: Rounding | None = None) -> None:
        self.values = list(values)
        self.size = len(self.values)
        self._rounding = rounding

    def __repr__(self) -> str:
        return f"<ValueNodes: {self.size} given nodes>"

    @cached_property
    def one(self) -> Matrix:
        """Ones."""
        return column([sp.Integer(1)] * self.size, EXRAW)

    @cached_property
    def powers(self) -> dict[int, Matrix]:
        """Ones, to be continued by ``power``."""
        return {0: self.one}

    @cached_property
    def trace(self) -> Matrix:
        """The identity: a sum over nodes is a sum of values."""
        return DomainMatrix.eye(self.size, EXRAW)

    @cached_property
    def reflection(self) -> Matrix | None:
        """The reversal of the nodes when c_i + c_{s+1−i} = 1, exactly or to the given decimals."""
        for c, mirrored in zip(self.values, reversed(self.values), strict=True):
            if not vanishes_to(c + mirrored - 1, self._rounding):
                return None
        s = self.size
        rows = [[sp.Integer(int(i + j == s - 1)) for j in range(s)] for i in range(s)]
        return DomainMatrix(rows, (s, s), EXRAW)

    def times_node(self, f: Matrix) -> Matrix:
        """Multiply node by node."""
        pairs = zip(self.values, f.to_list_flat(), strict=True)
        return column([value * entry for value, entry in pairs], EXRAW)

    def multiply(self, f: Matrix) -> Matrix:
        """Return the values of f on a diagonal."""
        s = self.size
        values = f.to_list_flat()
        rows = [[values[i] if i == j else sp.Integer(0) for j in range(s)] for i in range(s)]
        return DomainMatrix(rows, (s, s), EXRAW)

    def at(self, position: int) -> Matrix:
        """Pick the first (0) or last (−1) value."""
        s = self.size
        return DomainMatrix([[sp.Integer(int(j == position % s)) for j in range(s)]], (1, s), EXRAW)


def magnitude(residual: Matrix, rows: Nodes | None, columns: Nodes | None) -> mp.mpf:
    """Return the largest |entry| of a residual at the nodes themselves."""
    values = _at_nodes(_at_nodes(residual.to_Matrix(), rows).T, columns)
    return max((mp.mpf(abs(enclosure(v)).b) for v in values), default=mp.mpf(0))


def _at_nodes(matrix: sp.Matrix, nodes: Nodes | None) -> sp.Matrix:
    if nodes is None or isinstance(nodes, ValueNodes):
        return matrix
    roots = [sp.Rational(r.centre.numerator, r.centre.denominator)
             for r in enclose_roots(nodes.polynomial, 64)]  # type: ignore[attr-defined]
    return sp.Matrix([[r**k for k in range(nodes.size)] for r in roots]) * matrix
