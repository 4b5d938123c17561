"""Constraints that others imply are found before a stepper is made, and refused by name."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from ..errors import InputError
from ..projection import dependent_rows
from .numeric_system import NumericSystem

__all__ = ["refuse_redundant"]

Array = NDArray[Any]


def refuse_redundant(system: NumericSystem, q: Array) -> None:
    """Refuse constraints whose gradients depend on each other at q.

    Raises
    ------
    InputError
        With the names of all that take part, and of a smallest set to leave out.
    """
    involved, left_out = dependent_rows(system.G(q))
    if involved:
        names = system.constraint_names
        raise InputError(
            f"{len(left_out)} of the {len(names)} constraints of {system.system.name!r} are "
            f"redundant. Leave out {', '.join(repr(names[i]) for i in left_out)}; these depend on "
            f"each other: {', '.join(repr(names[i]) for i in involved)}."
        )
