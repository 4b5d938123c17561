"""The states of a run as columns along the time, to be written to a file block by block.

A stored run is read a block at a time; a trajectory is in memory already.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.exact_numbers import digits_of
from ..core.real_types import REALS
from ..runtime.bindings.real_numbers import as_bytes, from_bytes
from ..runtime.results.state_columns import states_of
from .array_layout import Field, array_of, fields_of, fields_of_event, names_of, wide_name
from .event_store import values_of
from .recording import Recording
from .validation import refuse_missing_blocks, stored_values

if TYPE_CHECKING:
    from ..runtime.results.trajectory import Trajectory

__all__ = ["Column", "Table", "stored_table", "table_of"]

Array = NDArray[Any]

#: Rows of a block of what is in memory.
_ROWS = 2**16
#: The last dimension of numbers that stand as bytes.
BYTE = "byte"


@dataclass(frozen=True)
class Column:
    """One array along the time.

    Attributes
    ----------
    name : str
    inner : tuple of (dimension, length)
        Of one state.
    dtype : numpy type
    attributes : dict
        ``units`` and ``long_name`` for readers.
    read : callable
        Returns rows ``begin`` to ``end``.
    """

    name: str
    inner: tuple[tuple[str, int], ...]
    dtype: np.dtype[Any]
    attributes: dict[str, Any]
    read: Callable[[int, int], Array]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one state's entry."""
        return tuple(length for _, length in self.inner)

    @property
    def is_bytes(self) -> bool:
        """Whether it repeats, as bytes, numbers that another column has as doubles."""
        return any(dimension == BYTE for dimension, _ in self.inner)


@dataclass(frozen=True)
class Table:
    """Columns of ``rows`` states each, read in blocks of ``block``; what is said of the run.

    ``events`` are tables of what has happened, by names; each along a dimension of its own.
    """

    columns: list[Column]
    rows: int
    block: int
    attributes: dict[str, Any]
    along: str = "time"
    events: dict[str, Table] = field(default_factory=dict)

    @property
    def system(self) -> dict[str, Any]:
        """What the manifest says of the system."""
        system: dict[str, Any] = self.attributes["manifest"]["system"]
        return system

    @property
    def numbers(self) -> list[Column]:
        """The columns of numbers: wide ones in their own type, not as doubles and as bytes."""
        dtype = REALS[self.attributes["manifest"]["real"]].dtype
        known = {column.name: column for column in self.columns}

        def whole(column: Column) -> Column:
            wide = known.get(wide_name(column.name))
            return column if wide is None else replace(
                column, read=lambda begin, end: from_bytes(wide.read(begin, end), dtype))

        return [whole(column) for column in self.columns if not column.is_bytes]

    def blocks(self, columns: list[Column]) -> Iterator[tuple[int, list[Array]]]:
        """Yield the first row of each block, and the block of each of these columns."""
        for begin in range(0, self.rows, self.block):
            end = min(begin + self.block, self.rows)
            yield begin, [column.read(begin, end) for column in columns]


def stored_table(recording: Recording) -> Table:
    """Return a stored run, as far as it is."""
    group = recording.group()
    refuse_missing_blocks(recording.path, group, 0, recording.states)

    def column(name: str) -> Column:
        array = array_of(group, name)
        dimensions = getattr(array.metadata, "dimension_names", None) or ()
        return Column(
            name, tuple(zip(map(str, dimensions[1:]), array.shape[1:], strict=True)), array.dtype,
            dict(array.attrs),
            lambda begin, end: stored_values(array, begin, end - begin, False, array.dtype))

    names = ["time", *(name for name in recording.attributes["arrays"] if name != "time")]
    events = {}
    for name, count in recording.attributes["events"].items():
        own = names_of(fields_of_event(recording.attributes["manifest"], name))
        refuse_missing_blocks(recording.path, group, 0, count, own)
        events[name] = Table([column(one) for one in own], count,
                             array_of(group, own[0]).chunks[0], recording.attributes,
                             f"event_{name}")
    return Table([column(name) for name in names], recording.states,
                 array_of(group, "time").chunks[0], recording.attributes, events=events)


def table_of(trajectory: Trajectory) -> Table:
    """Return a trajectory as it would be stored."""
    values = states_of(trajectory)
    columns = [column for field in fields_of(trajectory.manifest)
               for column in _columns_of(field, values[field.name])]
    about = {
        "title": f"{trajectory.manifest['name']}: {trajectory.report.steps} steps of "
                 f"{float(trajectory.dt):g} s",
        "run": {"parameters": {name: digits_of(x) for name, x in trajectory.parameters.items()},
                "dt": digits_of(trajectory.dt), "every": trajectory.every,
                "steps": trajectory.report.steps},
        "report": asdict(trajectory.report),
        "manifest": trajectory.manifest,
    }
    events = {name: Table([column for one, part in zip(
        fields_of_event(trajectory.manifest, name), values_of(found), strict=True)
        for column in _columns_of(one, part)], len(found), _ROWS, about, f"event_{name}")
        for name, found in trajectory.events.items()}
    return Table(columns, len(trajectory), _ROWS, about, events=events)


def _columns_of(field: Field, values: Array) -> Iterator[Column]:
    """Yield the column of a field, and the one with its bytes if it is wide."""
    dtype = np.dtype(field.dtype)
    yield Column(field.name, field.inner, dtype, field.attributes,
                 lambda begin, end: values[begin:end].astype(dtype))
    if field.wide:
        inner = (*field.inner, (BYTE, field.wide_shape[-1]))
        yield Column(wide_name(field.name), inner, np.dtype("u1"), {
            "long_name": f"{field.name} with all its digits"},
            lambda begin, end: as_bytes(values[begin:end]))
