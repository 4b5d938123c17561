"""Sparse matrices of large systems: products, and solutions of banded positive definite equations.

    A = L Lᵀ,   A block-tridiagonal with blocks as wide as its band

Constraints of a chain are numbered body by body, so that g_q g_qᵀ and g_q H_pp g_qᵀ have a narrow
band. Memory and time are O(m b) and O(m b²) for m rows and a band of b.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["BandCholesky", "SparseMatrix", "as_dense", "entries_of", "find_colours"]

Array = NDArray[Any]

#: Rows of a block at least: smaller ones cost more calls than they save arithmetic.
_BLOCK = 32


@dataclass(frozen=True, eq=False)
class SparseMatrix:
    """The nonzero entries of a matrix, sorted by row and column, each place once."""

    shape: tuple[int, int]
    rows: Array
    columns: Array
    values: Array

    @classmethod
    def of(cls, shape: tuple[int, int], rows: Array, columns: Array, values: Array
           ) -> SparseMatrix:
        """Return the matrix with these entries; those of one place are added."""
        place, which = np.unique(rows * shape[1] + columns, return_inverse=True)
        sums = np.bincount(which, values, len(place))
        return cls(shape, place // shape[1], place % shape[1], sums)

    @property
    def size(self) -> int:
        """The number of entries."""
        return len(self.values)

    @property
    def T(self) -> SparseMatrix:
        """The transpose."""
        return SparseMatrix.of((self.shape[1], self.shape[0]), self.columns, self.rows,
                               self.values)

    def __abs__(self) -> SparseMatrix:
        return SparseMatrix(self.shape, self.rows, self.columns, np.abs(self.values))

    def __matmul__(self, other: Any) -> Any:
        """Return the product with a vector, or with a sparse matrix."""
        if not isinstance(other, SparseMatrix):
            return np.bincount(self.rows, self.values * other[self.columns], self.shape[0])
        first = np.searchsorted(other.rows, np.arange(other.shape[0] + 1))
        start, count = first[self.columns], np.diff(first)[self.columns]
        each = np.repeat(np.arange(self.size), count)  # this entry, and the other's of its row
        partner = np.arange(len(each)) - np.repeat(np.cumsum(count) - count, count) + start[each]
        return SparseMatrix.of((self.shape[0], other.shape[1]), self.rows[each],
                               other.columns[partner], self.values[each] * other.values[partner])

    def diagonal(self) -> Array:
        """Return the diagonal."""
        on = self.rows == self.columns
        return np.bincount(self.rows[on], self.values[on], self.shape[0])

    def scaled(self, by_row: Array, by_column: Array) -> SparseMatrix:
        """Return the matrix with each row and each column multiplied by a number."""
        return SparseMatrix(self.shape, self.rows, self.columns,
                            self.values * by_row[self.rows] * by_column[self.columns])

    def norm_1(self) -> float:
        """Return the largest sum of absolute values of a column."""
        sums = np.bincount(self.columns, np.abs(self.values), self.shape[1])
        return float(sums.max(initial=0.0))

    def toarray(self) -> Array:
        """Return the dense matrix."""
        full = np.zeros(self.shape)
        full[self.rows, self.columns] = self.values
        return full


class BandCholesky:
    """The Cholesky factor of A − shift: raises ``LinAlgError`` unless that is positive definite.

    Parameters
    ----------
    A : SparseMatrix
        Symmetric; its lower half is read.
    shift : float
        A multiple of the identity that is subtracted: with it, a lower bound of eigenvalues.
    """

    def __init__(self, A: SparseMatrix, shift: float = 0.0) -> None:
        if not np.isfinite(A.values).all():
            raise np.linalg.LinAlgError("entries are not finite")
        self.size = A.shape[0]
        lower = A.rows >= A.columns
        i, j, values = A.rows[lower], A.columns[lower], A.values[lower]
        self._b = b = max(int((i - j).max(initial=1)), min(_BLOCK, self.size))
        count = -(-self.size // b)
        diagonal, below = np.zeros((2, count, b, b))
        beside = i // b == j // b
        for blocks, some in ((diagonal, beside), (below, ~beside)):
            blocks[j[some] // b, i[some] % b, j[some] % b] = values[some]
        rest = np.arange(self.size, count * b) % b
        diagonal[:, range(b), range(b)] -= shift
        diagonal[-1, rest, rest] = 1.0
        for k in range(count):
            if k:
                diagonal[k] -= below[k - 1] @ below[k - 1].T
            diagonal[k] = np.linalg.cholesky(diagonal[k])
            below[k] = np.linalg.solve(diagonal[k], below[k].T).T
        self._diagonal, self._below = diagonal, below

    def solve(self, right: Array) -> Array:
        """Return the solution for one right side."""
        count, b = len(self._diagonal), self._b
        x = np.zeros((count, b))
        x.reshape(-1)[: self.size] = right
        for k in range(count):
            x[k] = np.linalg.solve(self._diagonal[k],
                                   x[k] - (self._below[k - 1] @ x[k - 1] if k else 0))
        for k in reversed(range(count)):
            more = self._below[k].T @ x[k + 1] if k + 1 < count else 0
            x[k] = np.linalg.solve(self._diagonal[k].T, x[k] - more)
        return x.ravel()[: self.size]


def as_dense(matrix: Array | SparseMatrix) -> Array:
    """Return a matrix as an array."""
    return matrix.toarray() if isinstance(matrix, SparseMatrix) else matrix


def entries_of(matrix: Array | SparseMatrix) -> Array:
    """Return all entries that are stored."""
    return matrix.values if isinstance(matrix, SparseMatrix) else matrix


def find_colours(rows: Sequence[Sequence[int]], columns: int) -> Array:
    """Return a colour for each column, so that no row contains two columns of one colour.

    One evaluation then serves all columns of a colour (Curtis, Powell and Reid, 1974).
    """
    inside: list[list[int]] = [[] for _ in range(columns)]
    for row, entries in enumerate(rows):
        for column in entries:
            inside[column].append(row)
    colours = np.full(columns, -1)
    for column, own in enumerate(inside):
        taken = {int(colours[other]) for row in own for other in rows[row]}
        colours[column] = next(c for c in range(len(taken) + 1) if c not in taken)
    return colours
