"""The states of a run as .npz, .csv or NetCDF, block by block: memory stays constant but for .npz.

A stored run and a trajectory give the same file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.arguments import why_unwritable
from ..core.errors import InputError, StorageError
from ..core.exact_numbers import digits_of
from ..core.file_formats import format_of
from ..core.real_types import REALS
from ..runtime.bindings.real_numbers import as_bytes, from_bytes
from ..runtime.results.run_arrays import labels_of
from ..runtime.results.state_columns import (
    event_headings,
    events_path,
    headings,
    places_of,
    spreadsheet_text,
    states_of,
    write_csv,
)
from ..runtime.rigid_body.euler_angles import check_sequence
from .array_layout import StoredField, array_of, fields_of, fields_of_event, names_of, wide_name
from .durable_files import atomic_file
from .event_store import values_of
from .recording import Recording
from .validation import refuse_missing_blocks, stored_values

__all__ = ["Column", "StateTable", "check_angles", "check_export", "export", "export_csv",
           "export_netcdf", "export_npz", "save_netcdf", "stored_table", "table_of"]

if TYPE_CHECKING:
    from ..runtime.results.trajectory import Trajectory
    from .recording import Recording


Array = NDArray[Any]


def check_export(path: Path) -> None:
    """Refuse paths that no run can be exported to.

    Raises
    ------
    InputError, MissingDependencyError
    """
    format_of(path, "A run", "states").require_packages()


def check_angles(path: Path, euler: str | None, *, degrees: bool) -> None:
    """Refuse Euler angles where no columns are, and a unit of none.

    Raises
    ------
    InputError
    """
    if euler is not None:
        check_sequence(euler)
        if not format_of(path, "Euler angles", "states", "store").tabular:
            raise InputError(f"Euler angles are columns of a .csv file, and {path.name!r} is none; "
                             "end its name in .csv, or leave them out.")
    elif degrees:
        raise InputError("Degrees are for Euler angles; give their axes too, such as ZYX.")


def export(
    recording: Recording, path: Path, *, euler: str | None = None, degrees: bool = False,
    columns: str | Iterable[str] | None = None,
) -> Path:
    """Write the states of a run; the file appears complete or not at all.

    .npz is what ``Trajectory.load`` reads, with all digits; .csv has a column a number, under the
    names that the system gives its coordinates, momenta and quantities, each with the digits that
    give it back; .nc is NetCDF-4, with attributes as text. Events of a .csv file stand in another
    one, ``night.events.csv``, a line each.

    ``euler``, a sequence of axes such as ``"ZYX"``, adds columns with these angles of every body to
    a .csv file, in rad or ``degrees``, as ``Trajectory.to_csv`` does; the states are in memory.
    ``columns`` of a .csv file are those that are wanted, as for ``Trajectory.to_dataframe``.

    Raises
    ------
    InputError
        For another ending, or a run without a state; for angles in another file than .csv, of
        another sequence, or without bodies.
    StorageError
        If the file cannot be written.
    """
    check_export(path)
    check_angles(path, euler, degrees=degrees)
    form = format_of(path, "A run", "states")
    if columns is not None and not form.tabular:
        raise InputError(f"columns are those of a .csv file, and {path.name!r} is none; end its "
                         "name in .csv, or leave them out.")
    if recording.report is None:
        raise InputError(f"{str(recording.path)!r} holds no state yet; go on with its run first.")
    if euler is not None:
        return recording.trajectory().to_csv(path, euler=euler, degrees=degrees, columns=columns)
    found: Path = form.writer("run")(recording, path, columns)
    return found


def export_npz(recording: Recording, path: Path, columns: Any) -> Path:
    """Write a run as .npz."""
    return recording.trajectory().save(path)


def export_netcdf(recording: Recording, path: Path, columns: Any) -> Path:
    """Write a run as .nc."""
    return _write(stored_table(recording), path, _write_netcdf)


def export_csv(recording: Recording, path: Path, columns: str | Iterable[str] | None) -> Path:
    """Write a run as .csv, and its events as a second file."""
    table = stored_table(recording)
    return _write(table, path, partial(_write_csv, picks=_picks(table, columns)), events=True)


def save_netcdf(trajectory: Trajectory, path: Path) -> Path:
    """Write a trajectory as .nc, as if it had been stored and exported.

    Raises
    ------
    InputError, MissingDependencyError, StorageError
        As for ``export``.
    """
    check_export(path)
    for name in trajectory.events:
        if "/" in name or "\0" in name:
            raise InputError(f"The event {name!r} names variables of a NetCDF file, where '/' "
                             'parts groups; give it another name, as in gs.Event(..., '
                             'name="landing"), or save the run as .npz or .csv.')
    return _write(table_of(trajectory), path, _write_netcdf)


def _write(
    table: StateTable, path: Path, write: Callable[[StateTable, Path], None], *,
    events: bool = False,
) -> Path:
    try:
        if table.events and events:
            with atomic_file(events_path(path)) as part:
                _write_events(table, part)
        with atomic_file(path) as part:
            write(table, part)
    except (OSError, RuntimeError) as error:  # HDF5 has a RuntimeError for some of the system's
        raise StorageError(f"The file {str(path)!r} cannot be written: "
                           f"{why_unwritable(path, error)}.") from error
    return path


def _picks(
    table: StateTable, wanted: str | Iterable[str] | None
) -> list[tuple[str, Column, int]]:
    """Return the heading of each column that is wanted, its array and its place in it."""
    arrays = table.numbers
    titles = headings(table.system, {array.name: array.shape for array in arrays})
    places = [(array, i) for array in arrays for i in range(math.prod(array.shape))]
    sizes = {array.name: math.prod(array.shape) for array in arrays}
    return [(titles[k], *places[k]) for k in places_of(wanted, titles, sizes)]


def _write_csv(table: StateTable, path: Path, picks: list[tuple[str, Column, int]]) -> None:
    arrays = list({array.name: array for _, array, _ in picks}.values())
    at = [([one.name for one in arrays].index(array.name), i) for _, array, i in picks]

    def blocks() -> Iterator[list[Array]]:
        for _, read in table.blocks(arrays):
            flat = [part.reshape(len(part), math.prod(part.shape[1:])) for part in read]
            yield [flat[k][:, i] for k, i in at]

    write_csv(path, [title for title, _, _ in picks], blocks())


def _write_events(table: StateTable, path: Path) -> None:
    """Write events as CSV: the name of the event, then the entries of its arrays."""
    blocks = ([np.full(len(arrays[0]), spreadsheet_text(name)), *arrays]
              for name, own in table.events.items() for _, arrays in own.blocks(own.numbers))
    write_csv(path, event_headings(table.system), blocks)


def _write_netcdf(table: StateTable, path: Path) -> None:
    import h5netcdf

    with h5netcdf.File(path, "w") as file:
        file.attrs.update({name: _plain(value) for name, value in table.attributes.items()})
        tables = [table, *table.events.values()]
        file.dimensions = {one.along: one.rows for one in tables} | {
            dimension: length for one in tables for column in one.columns
            for dimension, length in column.inner}
        for dimension, (names, meaning) in labels_of(table.system).items():
            if dimension in file.dimensions:
                labels = file.create_variable(dimension, (dimension,), dtype=_text())
                labels[:] = names
                labels.attrs["long_name"] = meaning
        for one in tables:
            made = [_netcdf_variable(file, one.along, column) for column in one.columns]
            for begin, arrays in one.blocks(one.columns):
                for variable, array in zip(made, arrays, strict=True):
                    variable[begin : begin + len(array)] = array


def _netcdf_variable(file: Any, along: str, column: Column) -> Any:
    dimensions = (along, *(dimension for dimension, _ in column.inner))
    variable = file.create_variable(column.name, dimensions, dtype=column.dtype)
    variable.attrs.update({name: _plain(value) for name, value in column.attributes.items()})
    return variable


def _text() -> Any:
    import h5py

    return h5py.string_dtype()


def _plain(value: Any) -> Any:
    """Return an attribute as NetCDF can hold it."""
    return value if isinstance(value, (str, int, float)) else json.dumps(value)


if TYPE_CHECKING:
    from ..runtime.results.trajectory import Trajectory



#: Rows of a block of what is in memory.
_ROWS = 2**16
#: The last dimension of numbers stored as bytes.
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
class StateTable:
    """Columns of ``rows`` states each, read in blocks of ``block``; attributes of the run.

    ``events`` are tables of what has happened, by names; each along a dimension of its own.
    """

    columns: list[Column]
    rows: int
    block: int
    attributes: dict[str, Any]
    along: str = "time"
    events: dict[str, StateTable] = field(default_factory=dict)

    @property
    def system(self) -> dict[str, Any]:
        """The system's part of the manifest."""
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


def stored_table(recording: Recording) -> StateTable:
    """Return the table of a stored run, complete or not."""
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
        events[name] = StateTable([column(one) for one in own], count,
                             array_of(group, own[0]).chunks[0], recording.attributes,
                             f"event_{name}")
    return StateTable([column(name) for name in names], recording.states,
                 array_of(group, "time").chunks[0], recording.attributes, events=events)


def table_of(trajectory: Trajectory) -> StateTable:
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
    events = {name: StateTable([column for one, part in zip(
        fields_of_event(trajectory.manifest, name), values_of(found), strict=True)
        for column in _columns_of(one, part)], len(found), _ROWS, about, f"event_{name}")
        for name, found in trajectory.events.items()}
    return StateTable(columns, len(trajectory), _ROWS, about, events=events)


def _columns_of(field: StoredField, values: Array) -> Iterator[Column]:
    """Yield the column of a field, and the one with its bytes if it is wide."""
    dtype = np.dtype(field.dtype)
    yield Column(field.name, field.inner, dtype, field.attributes,
                 lambda begin, end: values[begin:end].astype(dtype))
    if field.wide:
        inner = (*field.inner, (BYTE, field.wide_shape[-1]))
        yield Column(wide_name(field.name), inner, np.dtype("u1"), {
            "long_name": f"{field.name} with all its digits"},
            lambda begin, end: as_bytes(values[begin:end]))
