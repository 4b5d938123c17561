"""Null spaces over the rational numbers, exactly, from what they are modulo primes.

Modulo a prime the reduced echelon form of a null space is found by elimination in whole numbers.
Several primes together (Chinese remainders) determine its entries as fractions (Wang, Guy and
Davenport, SIGSAM Bull. 16, 1982), and the next primes, with conditions of their own, confirm them.
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

__all__ = ["Conditions", "NullSpace", "reduced"]

Residue = NDArray[np.int64]
#: What the vectors of a null space are annihilated by: of a prime, blocks of rows, each a function
#: of how many rows are wanted.
Conditions = Callable[[int], Iterable[Callable[[int], Residue]]]

#: Primes that confirm a null space, and those after which fractions count as unknown: they would
#: have more than a hundred digits.
_LEAST_PRIMES, _MOST_PRIMES = 3, 24
#: Rows beyond the number of unknowns.
_SPARE = 8


class NullSpace:
    """The null space of conditions in ℚⁿ.

    Parameters
    ----------
    size : int
        n.
    conditions : callable
        See ``Conditions``; a prime that it raises ``UnsuitablePrimeError`` for is passed over.
    within : NullSpace, optional
        A space to look in.
    """

    def __init__(
        self, size: int, conditions: Conditions, within: NullSpace | None = None
    ) -> None:
        self.size, self._conditions, self._within = size, conditions, within
        self._known: dict[int, tuple[Residue, list[int]] | None] = {}

    @cached_property
    def rows(self) -> list[list[Fraction]]:
        """The reduced echelon form of a basis.

        Vectors whose entries are no fractions, or longer ones than two or three doubles make, are
        left out.
        """
        entries, modulus, pivots = np.zeros((0, self.size), dtype=object), 1, [0] * (self.size + 1)
        candidates: list[list[Fraction] | None] = []
        confirmed: list[bool] = []
        for done, (prime, echelon, leading) in enumerate(islice(self._forms(), _MOST_PRIMES), 1):
            if not leading:
                return []
            if len(leading) < len(pivots):  # the first prime, or those before were unlucky
                entries, modulus, pivots = echelon.astype(object), prime, leading
                confirmed = [False] * len(leading)
            elif leading == pivots:
                confirmed = [row is not None and _agrees(row, values, prime)
                             for row, values in zip(candidates, echelon, strict=True)]
                if all(confirmed) and done >= _LEAST_PRIMES:
                    break
                change = (echelon - entries) * pow(modulus, -1, prime) % prime
                entries, modulus = entries + modulus * change, modulus * prime
            candidates = [_fractions(row.tolist(), modulus) for row in entries]
        return [row for row, sure in zip(candidates, confirmed, strict=True)
                if row is not None and sure]

    def contains(self, vector: Sequence[Fraction]) -> bool:
        """Return whether a vector is in the space, modulo three primes."""
        for prime, echelon, pivots in islice(self._forms(), _LEAST_PRIMES):
            entries = np.array([_residue(x, prime) for x in vector])
            if ((entries - _product(entries[None, pivots], echelon, prime)[0]) % prime).any():
                return False
        return True

    # ------------------------------------------------------------ modulo a prime

    def _forms(self) -> Iterator[tuple[int, Residue, list[int]]]:
        """Yield primes and the reduced echelon form of the space modulo each."""
        for prime in primes():
            found = self._modulo(prime)
            if found is not None:
                yield prime, *found

    def _modulo(self, prime: int) -> tuple[Residue, list[int]] | None:
        """Return a basis in reduced echelon form and its pivots; None where there is none."""
        if prime not in self._known:
            try:
                self._known[prime] = self._solved(prime)
            except UnsuitablePrimeError:
                self._known[prime] = None
        return self._known[prime]

    def _solved(self, prime: int) -> tuple[Residue, list[int]] | None:
        basis = np.eye(self.size, dtype=np.int64)  # its columns
        if self._within is not None:
            outer = self._within._modulo(prime)
            if outer is None:
                return None
            basis = outer[0].T
        for block in self._conditions(prime):
            if basis.shape[1]:
                basis = _restricted(basis, block(basis.shape[1] + _SPARE), prime)
        return reduced(basis.T, prime)


def _restricted(basis: Residue, rows: Residue, prime: int) -> Residue:
    """Return a basis of the null space; most rows touch few of the vectors."""
    asked = rows.any(axis=0)
    images = _product(rows[:, asked], basis[asked], prime)
    touched = images.any(axis=0)
    kept = _product(basis[:, touched], _kernel(images[:, touched], prime), prime)
    return np.column_stack([basis[:, ~touched], kept])


def reduced(
    rows: Residue, prime: int, columns: int | None = None
) -> tuple[Residue, list[int]]:
    """Return the reduced echelon form modulo a prime, and its pivots.

    With ``columns``, only those first columns are eliminated; the rows that then have zeros there
    are the last.
    """
    rows, pivots = rows.copy(), list[int]()
    for column in range(rows.shape[1] if columns is None else columns):
        done = len(pivots)
        below = np.flatnonzero(rows[done:, column])
        if not len(below):
            continue
        rows[[done, done + below[0]]] = rows[[done + below[0], done]]
        rows[done] = rows[done] * pow(int(rows[done, column]), -1, prime) % prime
        others = np.flatnonzero(rows[:, column])
        others = others[others != done]
        rows[others] = (rows[others] - rows[others, column, None] * rows[done]) % prime
        pivots.append(column)
        if len(pivots) == len(rows):
            break
    return (rows[: len(pivots)] if columns is None else rows), pivots


def _kernel(rows: Residue, prime: int) -> Residue:
    """Return a basis of the null space, as columns."""
    form, pivots = reduced(rows, prime)
    free = [k for k in range(rows.shape[1]) if k not in set(pivots)]
    basis = np.zeros((rows.shape[1], len(free)), dtype=np.int64)
    basis[free, np.arange(len(free))] = 1
    basis[pivots] = -form[:, free] % prime
    return basis


def _product(A: Residue, B: Residue, prime: int) -> Residue:
    """Return A B modulo a prime; A goes in two halves, so that no sum exceeds 63 bits."""
    high, low = A >> 16, A & 0xFFFF
    return np.asarray((((high @ B) % prime << 16) + low @ B) % prime)


# ---------------------------------------------------------------- fractions


def _residue(x: Fraction, prime: int) -> int:
    return x.numerator * pow(x.denominator, -1, prime) % prime


def _agrees(row: Sequence[Fraction], values: Residue, prime: int) -> bool:
    return all(x.denominator % prime and _residue(x, prime) == value
               for x, value in zip(row, values.tolist(), strict=True))


def _fractions(entries: Sequence[Any], modulus: int) -> list[Fraction] | None:
    """Return the entries as fractions; None if one of them is next to none."""
    found = [_fraction(int(x), modulus) for x in entries]
    return None if None in found else found  # type: ignore[return-value]


def _fraction(x: int, modulus: int) -> Fraction | None:
    """Return the n/d ≡ x with |n|, d ≤ √(modulus/2), by Euclid's algorithm; None without one."""
    bound = isqrt(modulus // 2)
    (n0, d0), (n1, d1) = (modulus, 0), (x, 1)
    while n1 > bound:
        quotient = n0 // n1
        (n0, d0), (n1, d1) = (n1, d1), (n0 - quotient * n1, d0 - quotient * d1)
    return Fraction(n1, d1) if 0 < abs(d1) <= bound else None
