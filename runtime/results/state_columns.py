"""The states of a run as columns along the time, under their names in the system.

The columns have the order of ``OUTPUTS``, here as in a stored run.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from itertools import groupby
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arguments import as_items, as_text, join_or, proposal, shown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.exact_numbers import wide_text
from ...core.manifest import SystemManifest
from .outputs import OUTPUTS, QUANTITY, arrays_in_files

if TYPE_CHECKING:
    from .trajectory import Trajectory

__all__ = [
    "event_headings",
    "events_path",
    "file_rows",
    "headings",
    "places_of",
    "spreadsheet_text",
    "states_of",
    "write_csv",
]

#: Rows that are in memory as Python's numbers.
_ROWS = 2**13
#: Headings that an error lists.
_NAMED = 12


def states_of(trajectory: Trajectory) -> dict[str, Array]:
    """Return the arrays of a trajectory by name, one row per state.

    Arrays of steps get a first row of NaN, or of 0 where their entries are whole numbers.
    """
    arrays: dict[str, Array] = {}
    for output in OUTPUTS:
        array = getattr(trajectory, output.attribute)
        if output.of_steps and len(trajectory):
            # NaN in the stepper's own number type: 0 q + NaN.
            missing_value = 0 if output.is_integer else 0 * trajectory.q[0, 0] + np.nan
            start = np.full((1, *array.shape[1:]), missing_value, dtype=array.dtype)
            array = np.concatenate([start, array])
        arrays |= arrays_in_files(output, trajectory.manifest, array)
    return arrays


def headings(
    system: SystemManifest, shapes: Mapping[str, tuple[int, ...]],
    of_bodies: Mapping[str, list[str]] = MappingProxyType({}),
) -> list[str]:
    """Return a heading for each number of a state, all of them different.

    ``shapes`` has the shape of one state's entry of each array, ``of_bodies`` the headings of the
    arrays of bodies. Coordinates, momenta and quantities have their names in the system; a name
    that is used already, such as "energy", gets a prefix, as in ``quantity_energy``.
    """
    # array → the prefix of names that are used already, and its labels
    system_labels: dict[str, tuple[str, Sequence[str]]] = {
        "q": ("q", system.coordinates), "p": ("p", system.momenta),
        "p_after": ("after", [f"{name}_after" for name in system.momenta])}
    system_labels |= {"velocities": ("velocity", system.velocity_names)}
    system_labels |= {QUANTITY + name: ("quantity", (name,)) for name in system.quantities}
    system_labels |= {name: ("body", labels) for name, labels in of_bodies.items()}
    constraints = {"multipliers": system.constraint_names,
                   "reactions": system.velocity_constraint_names}
    numbered_by_array = {name: _numbered_headings(name, shape, constraints.get(name, ()))
                         for name, shape in shapes.items()}
    # headings that cannot be changed come first: "time", "energy", "multipliers0"
    used_headings = {label for name, labels in numbered_by_array.items()
                     if name not in system_labels for label in labels}
    headings_in_order = []
    for name, numbered in numbered_by_array.items():
        prefix, labels = system_labels.get(name, ("", numbered))
        for label in labels:
            while prefix and label in used_headings:
                label = f"{prefix}_{label}"
            used_headings.add(label)
            headings_in_order.append(label)
    return headings_in_order


def _numbered_headings(name: str, shape: tuple[int, ...], constraints: Sequence[str]) -> list[str]:
    """Return a heading for each entry, the array's name and its indices: ``multipliers0_1``.

    Along the last axis, if it counts constraints of different names, these take the index's place.
    """
    labels = ["_".join(re.findall(r"\w+", constraint)) for constraint in constraints]
    has_labels = len(shape) == 2 and shape[-1] == len({*labels})
    headings_of_entries = []
    for index in np.ndindex(*shape):
        parts = (*index[:-1], labels[index[-1]]) if has_labels else index
        headings_of_entries.append(name + "_".join(map(str, parts)))
    return headings_of_entries


def places_of(
    columns: Any, titles: Sequence[str], sizes: Mapping[str, int], index: Iterable[str]
) -> list[int]:
    """Return the indices of selected columns, those of ``index`` first; None selects all.

    A column is selected by its heading, by a pattern such as ``"*_angle"``, or by the name of its
    array: ``"q"``, ``"multipliers"``, ``"quantities"``. ``sizes`` has the number of columns of each
    array, in the order of the headings. Raises InputError for a name or pattern that selects no
    column.
    """
    if columns is None:
        return [*range(len(titles))]
    # name of an array → its columns; all quantities are one group
    groups: dict[str, list[int]] = {}
    first_column = 0
    for name, size in sizes.items():
        group = "quantities" if name.startswith(QUANTITY) else name
        groups.setdefault(group, []).extend(range(first_column, first_column + size))
        first_column += size
    # a dict keeps the order and drops repeated columns
    places = dict.fromkeys(map(titles.index, index))
    for column in [columns] if isinstance(columns, str) else as_items("columns", columns, "names"):
        pattern = as_text("columns", column)
        matches = [i for i, title in enumerate(titles) if fnmatchcase(title, pattern)]
        matches = matches or groups.get(pattern, [])
        if not matches:
            column_names = [*dict.fromkeys((*titles, *groups))]
            raise InputError(f"columns has {shown(column)}, which no column is called; choose "
                             f"names and patterns of {', '.join(column_names[:_NAMED])}"
                             f"{', …' if len(column_names) > _NAMED else ''}, or arrays: "
                             f"{join_or(groups)}{proposal(column, column_names)}.")
        places |= dict.fromkeys(matches)
    return [*places]


def write_csv(path: Path, titles: list[str], blocks: Iterable[list[Array]]) -> None:
    """Write blocks of states, each an array for each column or group of columns."""
    # lone surrogates, which only names of damaged files have, are written as \udc80
    with path.open("w", encoding="utf-8", newline="", errors="backslashreplace") as file:
        lines = csv.writer(file)
        lines.writerow(titles)
        for arrays in blocks:
            # neighbours of one type are converted to Python's numbers together
            groups = [[array.reshape(len(array), math.prod(array.shape[1:])) for array in group]
                      for _, group in groupby(arrays, key=lambda array: array.dtype)]
            for start in range(0, len(arrays[0]), _ROWS):
                tables = [file_rows(np.concatenate([x[start : start + _ROWS] for x in group],
                                                   axis=1))
                          for group in groups]
                lines.writerows([number for group_row in row for number in group_row]
                                for row in zip(*tables, strict=True))


def file_rows(array: Array, *, flat: bool = False) -> list[Any]:
    """Return rows of numbers for a file: numbers wider than doubles as text with all their digits.

    ``flat`` returns the rows joined to one list.
    """
    rows: list[list[Any]] = array.tolist()
    if array.dtype in (object, np.longdouble):
        rows = [[wide_text(x) if abs(x) < math.inf else float(x) for x in row] for row in rows]
    return [value for row in rows for value in row] if flat else rows


def events_path(path: Path) -> Path:
    """Return the path of the events of a run whose states are in a .csv file."""
    return path.with_name(f"{path.stem}.events{path.suffix}")


def event_headings(system: SystemManifest, fields: Iterable[str]) -> list[str]:
    """Return the headings of the file of events: the event's name, then columns of crossings.

    ``fields`` are the columns' names, ``t``, ``q``, …, of which "t" has the heading "time".
    """
    shape = (len(system.coordinates),)
    return headings(system, {"event": ()} | {
        "time" if name == "t" else name: shape if name in ("q", "p", "p_after") else ()
        for name in fields})


def spreadsheet_text(name: str) -> str:
    """Return a name as a cell of CSV, with an apostrophe if it begins like a formula.

    Spreadsheets would otherwise evaluate it.
    """
    return f"'{name}" if name.startswith(("=", "+", "-", "@", "\t", "\r", "\n")) else name
