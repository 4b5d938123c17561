"""Axes of a parameter sweep, each a dimension of the result."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..core.arrays import Array
from ..core.errors import InputError
from ..runtime.bindings.array_checks import as_numbers, as_positive_count, converted_to

__all__ = ["SCHEME", "START", "Axis", "as_rows", "list_axis", "random_axis", "start_axis",
           "value_axis"]

#: Columns that are no numbers of a cell but its scheme, or its state at the start.
SCHEME, START = "scheme", "start"
_SPACINGS = ("linear", "log")
#: Most values along an axis; they are in memory.
_MOST_VALUES = 10**8


@dataclass(frozen=True, eq=False)
class Axis:
    """One dimension of a sweep.

    Attributes
    ----------
    name : str
        Name of the dimension.
    columns : dict
        What varies along it, each with one value a place: parameters and ``dt`` are numbers,
        ``scheme`` is an index into ``labels``, ``q`` and ``p`` are states, one row a place.
    labels : list of str
        The names of schemes.
    """

    name: str
    columns: dict[str, Array]
    labels: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))


def value_axis(name: str, values: Any) -> Axis:
    """Return the axis of one parameter, of ``dt`` or of ``scheme``.

    ``values`` is a list, or a table with ``from``, ``to``, ``count`` and ``spacing`` ("linear" or
    "log"). Raises InputError.
    """
    if name == SCHEME:
        return _scheme_axis(values)
    if isinstance(values, Mapping):
        return Axis(name, {name: _space(name, values)})
    return Axis(name, {name: _numbers(name, values)})


def list_axis(name: str, columns: Mapping[str, Any]) -> Axis:
    """Return the axis of several quantities that vary together: a list of points.

    Raises InputError if they are not equally many.
    """
    if not columns:
        raise InputError(f"The list {name!r} is empty; give it a column for each quantity.")
    columns_as_numbers = {key: _numbers(key, values) for key, values in columns.items()}
    lengths = {key: len(values) for key, values in columns_as_numbers.items()}
    if len(set(lengths.values())) > 1:
        lengths_text = ", ".join(f"{key} has {length}" for key, length in lengths.items())
        raise InputError(f"The columns of the list {name!r} have different lengths: "
                         f"{lengths_text}; give each the same number of values.")
    return Axis(name, columns_as_numbers)


def random_axis(name: str, ranges: Mapping[str, Any], count: Any, seed: int) -> Axis:
    """Return random points: each column uniform in its range, or its logarithm uniform.

    x = a + (b − a) u, or a (b/a)^u with log spacing, for u uniform in [0, 1).

    A range is a table with ``from``, ``to`` and ``spacing``. The same seed gives the same points.
    Raises InputError.
    """
    if not ranges:
        raise InputError("A random list has no column; give each quantity a range, for example "
                         "gamma = { from = 1e-4, to = 1e-3 }.")
    count = _count(name, count)
    generator = np.random.default_rng(seed)
    columns = {}
    for key, table in ranges.items():
        low, high, spacing = _range(key, table)
        share = generator.random(count)
        columns[key] = (low + (high - low) * share if spacing == "linear"
                        else low * (high / low) ** share)
    return Axis(name, columns)


def start_axis(q: Any, p: Any) -> Axis:
    """Return the axis of several states to start from, one row of q and p each.

    Raises InputError.
    """
    states = [as_rows(letter, x) for letter, x in (("q", q), ("p", p))]
    if states[0].shape != states[1].shape:
        raise InputError(f"The starts have q and p of shapes {states[0].shape} and "
                         f"{states[1].shape}; give a row of numbers for each start, both alike.")
    return Axis(START, {"q": states[0], "p": states[1]})


def _scheme_axis(values: Any) -> Axis:
    """Return the axis of a list of schemes: a column of numbers 0, 1, ... with labels.

    A scheme is a text, "G-L 3", or a pair of name and stages; its label is the text.
    """
    if isinstance(values, str) or not isinstance(values, Sequence) or not values:
        raise InputError(f"scheme = {values!r} is no list of schemes; write for example "
                         '["EMS", "G-L 2", "G-L 3"].')
    labels = tuple(" ".join(map(str, v)) if isinstance(v, (tuple, list)) else str(v)
                   for v in values)
    return Axis(SCHEME, {SCHEME: np.arange(len(labels), dtype="i4")}, labels)


def _numbers(name: str, values: Any) -> Array:
    """Return a list of finite numbers as a column of doubles, shape (values,); else raise
    InputError."""
    refusal = InputError(f"{name} = {_short(values)} is no list of finite numbers; give at least "
                         "one.")
    try:
        array = np.array(values)
    except ValueError as error:
        raise refusal from error
    if array.ndim != 1 or not len(array) or array.dtype.kind not in "iuf":
        raise refusal
    array = array.astype(float)
    if not np.isfinite(array).all():
        raise refusal
    return array


def as_rows(name: str, values: Any, width: int | None = None) -> Array:
    """Return a table of numbers, (starts, ``width`` or any), or raise InputError.

    The error names the argument by ``name``.
    """
    table: Array = converted_to(np.float64, as_numbers(name, values))
    if not np.isfinite(table).all():
        raise InputError(f"{name} = {_short(values)} is not finite; mend it.")
    if table.ndim != 2 or not table.size or (width is not None and table.shape[1] != width):
        raise InputError(f"{name} has shape {table.shape}; give rows of "
                         f"{'equally many' if width is None else width} numbers.")
    return table


def _count(name: str, count: Any) -> int:
    """Return a number of values along an axis, or raise InputError."""
    value_count = as_positive_count(f"{name}: count", count, minimum=1)
    if value_count > _MOST_VALUES:
        raise InputError(f"{name}: count = {value_count} is too large; an axis has at most "
                         f"{_MOST_VALUES} values.")
    return value_count


def _space(name: str, table: Mapping[str, Any]) -> Array:
    """Return ``count`` numbers from low to high, equally spaced, or their logarithms."""
    count = _count(name, table.get("count"))
    low, high, spacing = _range(name, {k: v for k, v in table.items() if k != "count"})
    if spacing == "log":
        with np.errstate(over="ignore"):  # next to the largest double, where round-off is clipped
            return np.clip(np.geomspace(low, high, count), min(low, high), max(low, high))
    return np.linspace(low, high, count)


class _Range(NamedTuple):
    low: float
    high: float
    spacing: str  # "linear" or "log"


def _range(name: str, table: Any) -> _Range:
    """Return the range of a table ``{ from, to, spacing }``; InputError for an unusable one."""
    if not isinstance(table, Mapping) or not {"from", "to"} <= table.keys() <= {
            "from", "to", "spacing"}:
        raise InputError(f"{name} = {_short(table)} is no range; write "
                         '{ from = 1e-4, to = 1e-3, spacing = "log" }, and count = 100 in a grid.')
    low, high = (_numbers(f"{name}: {key}", [table[key]])[0].item() for key in ("from", "to"))
    spacing = table.get("spacing", "linear")
    if spacing not in _SPACINGS:
        raise InputError(f"{name}: spacing = {spacing!r} is unknown; choose "
                         f"{' or '.join(_SPACINGS)}.")
    if spacing == "log" and min(low, high) <= 0 <= max(low, high):
        raise InputError(f"{name}: a range from {low} to {high} has no logarithm; choose ends of "
                         "one sign, or linear spacing.")
    # beyond the largest double, or a ratio that underflows to 0
    width = high - low if spacing == "linear" else high / low
    if not math.isfinite(width) or (spacing == "log" and width == 0):
        raise InputError(f"{name}: a range from {low} to {high} is wider than a double can say; "
                         "choose nearer ends.")
    return _Range(low, high, spacing)


def _short(value: Any) -> str:
    """Return the text of a value for a message, at most 60 characters."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
