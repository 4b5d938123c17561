"""Exact elimination of sparse rational vectors."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from typing import Any, Generic, TypeVar

from .terms import Number, over

__all__ = ["Echelon"]

Key = TypeVar("Key", bound=Hashable)


class Echelon(Generic[Key]):
    """Vectors brought to echelon form, each with what it is made of.

    Parameters
    ----------
    order : function
        The key of an order of the entries; the first entry of a vector becomes its pivot.
    """

    def __init__(self, order: Callable[[Key], Any]) -> None:
        self.order = order
        self._rows: list[tuple[Key, dict[Key, Number], dict[int, Number]]] = []

    def _reduce(
        self, vector: Mapping[Key, Number], made_of: Mapping[int, Number]
    ) -> tuple[dict[Key, Number], dict[int, Number]]:
        left, own = dict(vector), dict(made_of)
        for pivot, row, parts in self._rows:
            if pivot in left:
                a = left[pivot]
                _subtract(left, a, row)
                _subtract(own, a, parts)
        return left, own

    def add(self, vector: Mapping[Key, Number]) -> bool:
        """Take up a vector; return False if it depends on those before."""
        left, own = self._reduce(vector, {len(self._rows): 1})
        if not left:
            return False
        pivot = min(left, key=self.order)
        a = left[pivot]
        self._rows.append((pivot, {k: over(b, a) for k, b in left.items()},
                           {j: over(b, a) for j, b in own.items()}))
        return True

    def solve(self, vector: Mapping[Key, Number]) -> dict[int, Number]:
        """Return by how much each vector taken up makes a dependent one."""
        _, own = self._reduce(vector, {})
        return {j: -a for j, a in own.items()}

    def reduced(self) -> dict[Key, dict[Key, Number]]:
        """Return the reduced echelon form, rows by their pivots."""
        rows: dict[Key, dict[Key, Number]] = {}
        for pivot, row, _ in reversed(self._rows):
            own = dict(row)
            for other, below in rows.items():
                if other in own:
                    _subtract(own, own[other], below)
            rows[pivot] = own
        return {pivot: rows[pivot] for pivot in sorted(rows, key=self.order)}


def _subtract(vector: dict[Any, Number], a: Number, other: Mapping[Any, Number]) -> None:
    for k, b in other.items():
        value = vector.get(k, 0) - a * b
        if value:
            vector[k] = value
        else:
            vector.pop(k, None)
