"""Exact null spaces over the rational numbers, from null spaces modulo primes.

Modulo a prime, the reduced echelon form of a basis is computed by elimination in integers. Several
primes (Chinese remainder theorem) determine its entries as fractions (Wang, Guy and Davenport,
SIGSAM Bull. 16, 1982); further primes, with conditions at other points, confirm them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction
from functools import cached_property
from itertools import islice
from math import isqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .finite_fields import UnsuitablePrimeError, primes

__all__ = ["Conditions", "NullSpace", "echelon_form"]

Residue = NDArray[np.int64]
#: prime → blocks of the rows that annihilate the null space; a block is a function
#: number of rows → rows modulo the prime.
Conditions = Callable[[int], Iterable[Callable[[int], Residue]]]

#: Number of primes that confirm a null space, and largest number: fractions with more than a
#: hundred digits are not reconstructed.
_MIN_PRIMES, _MAX_PRIMES = 3, 24
#: Rows beyond the number of unknowns.
_EXTRA_ROWS = 8


class NullSpace:
    """The null space of conditions in ℚⁿ.

    Parameters
    ----------
    size : int
        n.
    conditions : callable
        See ``Conditions``; primes for which it raises ``UnsuitablePrimeError`` are skipped.
    within : NullSpace, optional
        A space that contains this one.
    """

    def __init__(self, size: int, conditions: Conditions, within: NullSpace | None = None) -> None:
        self.size, self._conditions, self._within = size, conditions, within
        self._echelon_forms: dict[int, tuple[Residue, list[int]] | None] = {}

    @cached_property
    def rows(self) -> list[list[Fraction]]:
        """A basis in reduced echelon form.

        Vectors with irrational entries, or with fractions of more than about a hundred digits, are
        omitted.
        """
        # entries of the basis modulo the product of the primes so far
        entries, modulus = np.zeros((0, self.size), dtype=object), 1
        pivots = [0] * (self.size + 1)  # more than any basis has: the first prime has fewer
        candidates: list[list[Fraction] | None] = []
        confirmed: list[bool] = []
        forms = islice(self._iterate_forms(), _MAX_PRIMES)
        for prime_count, (prime, echelon, prime_pivots) in enumerate(forms, 1):
            if not prime_pivots:
                return []  # the null space over the rationals has no larger dimension
            # the null space modulo a prime is never smaller: fewer vectors mean a better prime
            if len(prime_pivots) < len(pivots):
                entries, modulus, pivots = echelon.astype(object), prime, prime_pivots
                confirmed = [False] * len(pivots)
            elif prime_pivots == pivots:
                confirmed = [row is not None and _is_congruent(row, residues, prime)
                             for row, residues in zip(candidates, echelon, strict=True)]
                if all(confirmed) and prime_count >= _MIN_PRIMES:
                    break
                # Chinese remainder: entries ≡ the old ones mod modulus, ≡ echelon mod prime
                correction = (echelon - entries) * pow(modulus, -1, prime) % prime
                entries, modulus = entries + modulus * correction, modulus * prime
            candidates = [_fractions(row.tolist(), modulus) for row in entries]
        return [row for row, is_confirmed in zip(candidates, confirmed, strict=True)
                if row is not None and is_confirmed]

    def contains(self, vector: Sequence[Fraction]) -> bool:
        """Whether a vector of ℚⁿ is in the space, modulo three primes."""
        for prime, echelon, pivots in islice(self._iterate_forms(), _MIN_PRIMES):
            entries = np.array([_residue(x, prime) for x in vector])
            # rows of the echelon form are unit vectors at the pivots: these give the combination
            combination = _product(entries[None, pivots], echelon, prime)[0]
            if ((entries - combination) % prime).any():
                return False
        return True

    # ------------------------------------------------------------ modulo a prime

    def _iterate_forms(self) -> Iterator[tuple[int, Residue, list[int]]]:
        """Yield each suitable prime with a basis in reduced echelon form and its pivots."""
        for prime in primes():
            form = self._form_modulo(prime)
            if form is not None:
                yield prime, *form

    def _form_modulo(self, prime: int) -> tuple[Residue, list[int]] | None:
        """Return a basis in reduced echelon form and its pivots; None for an unsuitable prime."""
        if prime not in self._echelon_forms:
            try:
                self._echelon_forms[prime] = self._solve(prime)
            except UnsuitablePrimeError:
                self._echelon_forms[prime] = None
        return self._echelon_forms[prime]

    def _solve(self, prime: int) -> tuple[Residue, list[int]] | None:
        """Return the basis modulo a prime: block by block, the space is cut by the conditions."""
        basis = np.eye(self.size, dtype=np.int64)  # its columns
        if self._within is not None:
            outer = self._within._form_modulo(prime)
            if outer is None:
                return None
            basis = outer[0].T
        for block in self._conditions(prime):
            if basis.shape[1]:
                basis = _intersection(basis, block(basis.shape[1] + _EXTRA_ROWS), prime)
        return echelon_form(basis.T, prime)


def _intersection(basis: Residue, rows: Residue, prime: int) -> Residue:
    """Return a basis of the subspace that ``rows`` annihilate, as columns.

    ``basis`` has the vectors of a space in its columns, shape (n, dimension); ``rows`` has the
    shape (conditions, n). Only the vectors with a nonzero image are combined; most rows have few.
    """
    has_entries = rows.any(axis=0)
    images = _product(rows[:, has_entries], basis[has_entries], prime)
    has_image = images.any(axis=0)
    combined = _product(basis[:, has_image], _null_space(images[:, has_image], prime), prime)
    return np.column_stack([basis[:, ~has_image], combined])


def echelon_form(
    rows: Residue, prime: int, columns: int | None = None
) -> tuple[Residue, list[int]]:
    """Return the reduced echelon form modulo a prime, and its pivots.

    With ``columns``, only the first ``columns`` columns are eliminated, and all rows are returned;
    those with zeros in these columns are the last.
    """
    rows, pivots = rows.copy(), list[int]()
    for column in range(rows.shape[1] if columns is None else columns):
        rank = len(pivots)
        # exact arithmetic: any nonzero entry is a pivot, and none is better than another
        candidates = np.flatnonzero(rows[rank:, column])
        if not len(candidates):
            continue
        rows[[rank, rank + candidates[0]]] = rows[[rank + candidates[0], rank]]
        rows[rank] = rows[rank] * pow(int(rows[rank, column]), -1, prime) % prime
        other_rows = np.flatnonzero(rows[:, column])
        other_rows = other_rows[other_rows != rank]
        rows[other_rows] = (rows[other_rows] - rows[other_rows, column, None] * rows[rank]) % prime
        pivots.append(column)
        if len(pivots) == len(rows):
            break
    return (rows[: len(pivots)] if columns is None else rows), pivots


def _null_space(rows: Residue, prime: int) -> Residue:
    """Return a basis of the null space of ``rows``, as columns.

    Each vector has 1 in one column without a pivot and 0 in the others; the echelon form gives its
    entries at the pivots.
    """
    form, pivots = echelon_form(rows, prime)
    free_columns = [k for k in range(rows.shape[1]) if k not in set(pivots)]
    basis = np.zeros((rows.shape[1], len(free_columns)), dtype=np.int64)
    basis[free_columns, np.arange(len(free_columns))] = 1
    basis[pivots] = -form[:, free_columns] % prime
    return basis


def _product(A: Residue, B: Residue, prime: int) -> Residue:
    """Return A B modulo a prime; A is split into 16-bit halves, so that sums have 63 bits."""
    high, low = A >> 16, A & 0xFFFF
    return np.asarray((((high @ B) % prime << 16) + low @ B) % prime)


# ---------------------------------------------------------------- fractions


def _residue(x: Fraction, prime: int) -> int:
    """Return n d⁻¹ modulo a prime, for x = n/d."""
    return x.numerator * pow(x.denominator, -1, prime) % prime


def _is_congruent(row: Sequence[Fraction], residues: Residue, prime: int) -> bool:
    """Whether fractions have these residues; False if the prime divides a denominator."""
    return all(x.denominator % prime and _residue(x, prime) == residue
               for x, residue in zip(row, residues.tolist(), strict=True))


def _fractions(entries: Sequence[Any], modulus: int) -> list[Fraction] | None:
    """Return the entries as fractions; None if one of them has no small fraction."""
    fractions = [_fraction(int(x), modulus) for x in entries]
    return None if None in fractions else fractions  # type: ignore[return-value]


def _fraction(x: int, modulus: int) -> Fraction | None:
    """Return n/d ≡ x with |n|, d ≤ √(modulus/2), by Euclid's algorithm; None if there is none."""
    bound = isqrt(modulus // 2)
    # n ≡ d x holds in every step: the remainders n fall, and |d| grows
    (n_before, d_before), (n, d) = (modulus, 0), (x, 1)
    while n > bound:
        quotient = n_before // n
        (n_before, d_before), (n, d) = (n, d), (n_before - quotient * n, d_before - quotient * d)
    return Fraction(n, d) if 0 < abs(d) <= bound else None
