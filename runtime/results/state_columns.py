"""The states of a run as columns along the time, under the names that the system gives them.

They stand in the order of ``OUTPUTS``, here as in a stored run.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from itertools import groupby
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import as_items, as_text, listed, proposal, shown
from ...core.errors import InputError
from ...core.exact_numbers import digits_of
from ...core.manifest import SystemManifest
from .run_arrays import OUTPUTS, QUANTITY, pieces

if TYPE_CHECKING:
    from .trajectory import Trajectory

__all__ = [
    "event_headings",
    "events_path",
    "headings",
    "places_of",
    "spreadsheet_text",
    "states_of",
    "write_csv",
    "written",
]

Array = NDArray[Any]

#: Rows that are in memory as Python's numbers.
_ROWS = 2**13
#: Headings that a refusal lists.
_NAMED = 12


def states_of(trajectory: Trajectory) -> dict[str, Array]:
    """Return the arrays of a trajectory, a row a state; those of steps begin with nothing."""
    found: dict[str, Array] = {}
    for one in OUTPUTS:
        values = getattr(trajectory, one.attribute)
        if one.of_steps:
            none = 0 if one.whole else 0 * trajectory.q[0, 0] + np.nan  # of the stepper's own type
            start = np.full((1, *values.shape[1:]), none, dtype=values.dtype)
            values = np.concatenate([start, values])
        found |= pieces(one, trajectory.manifest, values)
    return found


def headings(
    system: SystemManifest, shapes: Mapping[str, tuple[int, ...]],
    of_bodies: Mapping[str, list[str]] = MappingProxyType({}),
) -> list[str]:
    """Return a heading for each number of a state, all of them different.

    ``shapes`` are those of one state's entries, ``of_bodies`` the headings of arrays of the bodies.
    Coordinates, momenta and quantities go by the names
    that the system gives them, unless a name is taken: by the time, the energy, … or by another
    one of these.
    """
    own: dict[str, tuple[str, Sequence[str]]] = {
        "q": ("q", system.coordinates), "p": ("p", system.momenta)}
    own |= {"velocities": ("velocity", system.velocity_names)}
    own |= {QUANTITY + name: ("quantity", (name,)) for name in system.quantities}
    own |= {name: ("body", labels) for name, labels in of_bodies.items()}
    counted = {name: [name + "_".join(map(str, index)) for index in np.ndindex(*shape)]
               for name, shape in shapes.items()}
    taken = {label for name, labels in counted.items() if name not in own for label in labels}
    found = []
    for name, numbered in counted.items():
        kind, labels = own.get(name, ("", numbered))
        for label in labels:
            while kind and label in taken:
                label = f"{kind}_{label}"
            taken.add(label)
            found.append(label)
    return found


def places_of(
    columns: Any, titles: Sequence[str], sizes: Mapping[str, int]
) -> list[int]:
    """Return the places of the columns that a caller wants, the time first; None wants all.

    Each is wanted by its heading, by a pattern such as ``"*_angle"``, or by the name of the array
    that it belongs to: ``"q"``, ``"multipliers"``, ``"quantities"``. ``sizes`` say how many of the
    headings, in order, are an array's.

    Raises
    ------
    InputError
        For what is none of these.
    """
    if columns is None:
        return [*range(len(titles))]
    groups: dict[str, list[int]] = {}
    begin = 0
    for name, size in sizes.items():
        group = "quantities" if name.startswith(QUANTITY) else name
        groups.setdefault(group, []).extend(range(begin, begin + size))
        begin += size
    found = {titles.index("time"): None}
    for one in [columns] if isinstance(columns, str) else as_items("columns", columns, "names"):
        pattern = as_text("columns", one)
        places = [i for i, title in enumerate(titles) if fnmatchcase(title, pattern)]
        places = places or groups.get(pattern, [])
        if not places:
            known = [*dict.fromkeys((*titles, *groups))]
            raise InputError(f"columns has {shown(one)}, which no column is called; choose names "
                             f"and patterns of {', '.join(known[:_NAMED])}"
                             f"{', …' if len(known) > _NAMED else ''}, or arrays: "
                             f"{listed(groups)}{proposal(one, known)}.")
        found |= dict.fromkeys(places)
    return [*found]


def write_csv(path: Path, titles: list[str], blocks: Iterable[list[Array]]) -> None:
    """Write blocks of states, each an array for each column or group of columns."""
    # Lone surrogates, which only names of damaged files have, are written as \udc80.
    with path.open("w", encoding="utf-8", newline="", errors="backslashreplace") as file:
        lines = csv.writer(file)
        lines.writerow(titles)
        for arrays in blocks:
            alike = [[array.reshape(len(array), math.prod(array.shape[1:])) for array in group]
                     for _, group in groupby(arrays, key=lambda array: array.dtype)]
            for start in range(0, len(arrays[0]), _ROWS):
                parts = [written(np.concatenate([x[start : start + _ROWS] for x in group], axis=1))
                         for group in alike]
                lines.writerows([number for part in row for number in part]
                                for row in zip(*parts, strict=True))


def written(numbers: Array, *, flat: bool = False) -> list[Any]:
    """Return rows of numbers as files have them: those wider than doubles as text.

    ``flat`` returns one list of all.
    """
    rows: list[list[Any]] = numbers.tolist()
    if numbers.dtype in (object, np.longdouble):
        rows = [[digits_of(number) for number in row] for row in rows]
    return [number for row in rows for number in row] if flat else rows


def events_path(path: Path) -> Path:
    """Return the path of the events of a run whose states are in a .csv file."""
    return path.with_name(f"{path.stem}.events{path.suffix}")


def event_headings(system: SystemManifest) -> list[str]:
    """Return the headings of that file: the event's name, then what ``Crossings`` have of it."""
    shape = (len(system.coordinates),)
    return headings(system, {"event": (), "time": (), "q": shape, "p": shape, "steps": (),
                             "rising": (), "elapsed": ()})


def spreadsheet_text(name: str) -> str:
    """Return a name as a cell of CSV: spreadsheets take one that begins like a formula for one.

    Such a name gets an apostrophe before it, which they show as text.
    """
    return f"'{name}" if name.startswith(("=", "+", "-", "@", "\t", "\r", "\n")) else name
