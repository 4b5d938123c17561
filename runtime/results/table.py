"""A run, or an ensemble, as one table: the source of xarray, pandas, CSV, NetCDF and Parquet.

A table has arrays by name along ``time``, or along ``trajectory`` and ``state``; arrays of a run
are the ``OUTPUTS`` of ``outputs.py``. A table is read in blocks of rows, so that writing a stored
run to a file needs constant memory.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import field
from functools import partial
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..._version import __version__
from ...core.arguments import as_flag
from ...core.arrays import Array
from ...core.errors import InputError, MissingDependencyError
from ...core.extras import install
from ...core.file_formats import format_of, result_file
from ...core.manifest import Manifest, SystemManifest
from ...core.records import dataclass
from ..bindings.real_numbers import WIDE_BYTES, as_bytes
from ..rigid_body.euler_angles import check_sequence
from .body_motion import FrameName
from .crossings import Crossings
from .outputs import (
    OUTPUTS,
    description_of,
    description_of_column,
    labels_of,
    names_in_files,
)
from .state_columns import (
    event_headings,
    events_path,
    file_rows,
    headings,
    places_of,
    spreadsheet_text,
    states_of,
    write_csv,
)

if TYPE_CHECKING:
    import pandas
    import xarray

    from ..steppers.ensemble import Ensemble
    from .trajectory import Trajectory

__all__ = ["Table", "as_dataset", "as_frame", "save_table", "table_of_ensemble",
           "table_of_run"]

#: Index of a block along the leading dimensions, and its arrays by name.
Block = tuple[tuple[Any, ...], dict[str, Array]]


@dataclass(frozen=True)
class Table:
    """Arrays along the same leading dimensions, as names, attributes and an iterator over blocks.

    Of a run the leading dimension is ``time``: the array of a name has the shape (states, *inner).
    Of an ensemble they are ``trajectory`` and ``state``. Arrays are read only when ``read()`` is
    iterated over.

    Attributes
    ----------
    dimensions : dict of str to int
        The leading dimensions and their lengths.
    inner : dict of str to tuple of str
        Name of each array → its other dimensions.
    descriptions : dict of str to dict
        Name → ``long_name`` and ``units``.
    read : callable
        Returns an iterator over the blocks, in order.
    manifest : Manifest
        The manifest of the stepper.
    attributes : dict
        Attributes of the run, for files.
    labels : dict of str to (list of str, str)
        Dimension → names along it, and their meaning.
    titles : dict of str to list of str
        Name of an array of the bodies → headings of its columns.
    parts : list of Table
        Events, and numbers of an ensemble with one entry per trajectory.
    event : str or None
        Name of the event whose crossings are the rows.
    """

    dimensions: dict[str, int]
    inner: dict[str, tuple[str, ...]]
    descriptions: dict[str, dict[str, Any]]
    read: Callable[[], Iterator[Block]]
    manifest: Manifest
    attributes: dict[str, Any] = field(default_factory=dict)
    labels: dict[str, tuple[list[str], str]] = field(default_factory=dict)
    titles: dict[str, list[str]] = field(default_factory=dict)
    parts: list[Table] = field(default_factory=list)
    event: str | None = None

    @property
    def events(self) -> list[Table]:
        """The parts that are tables of events."""
        return [part_table for part_table in self.parts if part_table.event is not None]

    def in_memory(self) -> dict[str, Array]:
        """Return the arrays in memory, NaN (0 of whole numbers) where no block has rows."""
        filled: dict[str, Array] = {}
        for index, arrays in self.read():
            for name, array in arrays.items():
                if name not in filled:
                    filled[name] = np.full((*self.dimensions.values(), *array.shape[1:]),
                                           _missing_value(array), array.dtype)
                filled[name][index] = array
        return filled

    def columns(self, selection: Any = None) -> Iterator[tuple[list[str], list[Array]]]:
        """Yield the headings and the columns of each block, a column for each number of a state.

        ``selection`` names columns, as for ``Trajectory.table``; None takes all. The number of the
        trajectory and the time come first.
        """
        for index, arrays in self.read():
            count = len(next(iter(arrays.values())))
            # an ensemble's block is of one trajectory, whose number becomes a column
            index_columns = {name: np.full(count, i)
                             for name, i in zip(self.dimensions, index, strict=True)
                             if not isinstance(i, slice)}
            by_name = index_columns | arrays
            matrices = {name: array.reshape(count, math.prod(array.shape[1:]))
                        for name, array in by_name.items()}
            shapes = {name: array.shape[1:] for name, array in by_name.items()}
            titles = headings(self.manifest.system, shapes, self.titles)
            columns = [column for array in matrices.values() for column in array.T]
            widths = {name: array.shape[1] for name, array in matrices.items()}
            places = places_of(selection, titles, widths, index=(*index_columns, "time"))
            yield [titles[i] for i in places], [columns[i] for i in places]


def _missing_value(array: Array) -> Any:
    """Return 0 for whole numbers, "" for texts, NaN in the number type of other arrays."""
    if array.dtype.kind in "iub":
        return 0
    if array.dtype.kind == "U":
        return ""
    return 0 * array.flat[0] + np.nan if array.dtype == object and array.size else np.nan


def table_of_run(
    run: Trajectory, *, euler: str | None = None, degrees: bool = False,
    angular_velocity: FrameName | None = None, attitudes: bool = False,
) -> Table:
    """Return the table of a run along ``time``, a variable for each output that the system has.

    ``euler``, a sequence of axes such as "ZYX", adds Euler angles of each body, in rad or with
    ``degrees`` in degrees; ``angular_velocity``, "body" or "space", adds Ω or ω in rad/s, and
    ``attitudes`` the quaternion.

    Raises InputError for an unknown sequence or frame, and for a run without bodies.
    """
    if as_flag("degrees", degrees) and euler is None:
        raise InputError("degrees is for Euler angles; give their axes too, such as euler='ZYX'.")
    if euler is not None:
        check_sequence(euler)
    if not run.bodies and (euler is not None or angular_velocity is not None):
        run.body()  # raises the error, for there is none
    manifest = run.manifest
    inner_dimensions, descriptions = _output_dimensions(manifest)
    labels, titles = labels_of(manifest.system), {}
    bodies = _arrays_of_bodies(run, euler, degrees, angular_velocity, attitudes)
    for name, array in bodies.items():
        inner_dimensions[name], descriptions[name] = ("body", array.dimension), array.description
        titles[name] = [f"{body}_{column}" for body in run.bodies for column in array.columns]
    if bodies:
        labels["body"] = list(run.bodies), "name of the body"
    return Table({"time": len(run)}, inner_dimensions, descriptions,
                 partial(_blocks_of_run, run, bodies), manifest,
                 attributes=run._attributes(), labels=labels, titles=titles,
                 parts=[_table_of_event(manifest, name, [crossings])
                        for name, crossings in (run.events | run.impacts).items()])


def _blocks_of_run(run: Trajectory, bodies: Mapping[str, _BodyArray]) -> Iterator[Block]:
    """Yield the arrays of a run and of its bodies in blocks of states."""
    for rows, block in run._blocks():
        arrays = states_of(block)
        for name, array in bodies.items():
            arrays[name] = np.stack([array.of_body(block.body(body)) for body in run.bodies],
                                    axis=1)
        # a block of a store has the row before it too, where its first step begins
        yield (rows,), {name: x[len(x) - (rows.stop - rows.start):] for name, x in arrays.items()}


def _output_dimensions(
    manifest: Manifest,
) -> tuple[dict[str, tuple[str, ...]], dict[str, dict[str, Any]]]:
    """Return the dimensions of one state's entry, and the description, of each array in files.

    An output that is split, such as the quantities, has arrays of numbers.
    """
    dimensions: dict[str, tuple[str, ...]] = {}
    descriptions: dict[str, dict[str, Any]] = {}
    for output in OUTPUTS:
        for name in names_in_files(output, manifest):
            inner = () if output.split else output.inner(manifest) or ()
            dimensions[name] = tuple(dimension for dimension, _ in inner)
            descriptions[name] = description_of(output, manifest, name)
    return dimensions, descriptions


class _BodyArray(NamedTuple):
    """An array of every body of a run: ``of_body`` computes it from one ``BodyMotion``."""

    dimension: str
    description: dict[str, Any]
    columns: list[str]
    of_body: Callable[[Any], Array]


def _arrays_of_bodies(
    run: Trajectory, euler: str | None, degrees: bool, frame: FrameName | None, attitudes: bool
) -> dict[str, _BodyArray]:
    """Return the requested arrays of the bodies by name, a function of a body's motion for each.

    None of ``euler`` and ``frame`` asks for no Euler angles and no angular velocity.
    """
    arrays: dict[str, _BodyArray] = {}
    if attitudes and run.bodies:
        description = {"long_name": "unit quaternion, scalar first, body to space axes"}
        # for datasets alone, which take no headings of columns
        arrays["attitude"] = _BodyArray("component", description, columns=[],
                                        of_body=lambda body: body.attitude)
    if euler is not None:
        description = {"long_name": f"Euler angles {euler}",
                       "units": "degree" if degrees else "rad"}
        arrays["euler"] = _BodyArray(
            "angle", description, [f"euler{k}_{axis}" for k, axis in enumerate(euler, 1)],
            lambda body: body.euler(euler, degrees=degrees))
    if frame is not None:
        description = {"long_name": f"angular velocity in {frame} axes", "units": "rad s-1"}
        arrays["angular_velocity"] = _BodyArray(
            "axis", description, [f"omega{k}" for k in (1, 2, 3)],
            lambda body: body.angular_velocity(frame))
    return arrays


def table_of_ensemble(ensemble: Ensemble) -> Table:
    """Return the table of an ensemble along ``trajectory`` and ``state``; a trajectory is a block.

    ``parts`` are the numbers that a trajectory has once (dt, status, steps, parameters), and
    events.
    """
    # members have one stepper: names, dimensions and descriptions are those of the first
    first_table = table_of_run(ensemble.members[0])
    members = ensemble.members

    def read() -> Iterator[Block]:
        """Yield the arrays of each trajectory, which may end before the others."""
        for i, member in enumerate(members):
            yield (i, slice(len(member))), states_of(member)

    crossings = [member.events | member.impacts for member in members]
    events = [_table_of_event(first_table.manifest, name, [of_run[name] for of_run in crossings],
                              by_trajectory=True) for name in ensemble.events]
    return Table({"trajectory": len(members), "state": ensemble.t.shape[1]}, first_table.inner,
                 first_table.descriptions, read, first_table.manifest,
                 attributes={"stepper": first_table.manifest.name, "gyrospark": __version__,
                             "every": members[0].every,
                             "manifest": first_table.manifest.as_json()},
                 labels=first_table.labels,
                 parts=[_table_of_trajectories(ensemble), *events])


def _table_of_trajectories(ensemble: Ensemble) -> Table:
    """Return the table of the numbers that each trajectory has once, one row a trajectory."""
    members, number_type = ensemble.members, ensemble.members[0].t.dtype
    single: dict[str, tuple[Array, str, str]] = {
        "dt": (np.array([run.dt for run in members], number_type), "time step", "s"),
        "status": (np.array([_status(ensemble, i) for i in range(len(members))], dtype=str),
                   "complete, stopped, or why a step failed", ""),
        "steps": (np.array([run.report.steps for run in members]), "steps done", "")}
    for name in members[0].parameters:
        column = np.array([run.parameters[name] for run in members], number_type)
        single[f"parameter_{name}"] = column, f"parameter {name}", ""
    no_dimensions: tuple[str, ...] = ()  # beside the trajectory
    return Table(
        {"trajectory": len(members)}, dict.fromkeys(single, no_dimensions),
        {name: {"long_name": text} | ({"units": unit} if unit else {})
         for name, (_, text, unit) in single.items()},
        lambda: iter([((slice(None),), {name: array for name, (array, *_) in single.items()})]),
        members[0].manifest)


def _status(ensemble: Ensemble, i: int) -> str:
    """Return how trajectory i ended: "complete", "stopped", or the reason of its failed step."""
    if i in ensemble.failures:
        return str(ensemble.failures[i].reason)
    member = ensemble.members[i]
    # runs to t_end in scaled time have different numbers of states
    reached_end = [len(crossing) == 1 for crossing in member._end_event.values()]
    is_complete = all(reached_end) if reached_end else len(member) == ensemble.t.shape[1]
    return "complete" if is_complete else "stopped"


def _table_of_event(
    manifest: Manifest, name: str, crossings: list[Crossings], *, by_trajectory: bool = False
) -> Table:
    """Return the table of an event along ``event_NAME``, one row a crossing, of one run or several.

    ``crossings`` has those of each run; ``by_trajectory`` adds a column with the run's number. The
    names of its arrays begin with ``event_NAME_``, so that one file holds several events.
    """
    dimension = f"event_{name}"
    columns = [run_crossings.columns for run_crossings in crossings]
    arrays = {f"{dimension}_{column}": np.concatenate([by_column[column] for by_column in columns])
              for column in columns[0]}
    arrays[f"{dimension}_rising"] = arrays[f"{dimension}_rising"].astype(np.int8)  # NetCDF: no bool
    descriptions = {f"{dimension}_{column}": description_of_column(manifest, name, column)
                    for column in columns[0]}
    if by_trajectory:
        arrays = {f"{dimension}_trajectory": np.repeat(np.arange(len(crossings)),
                                                       [*map(len, crossings)])
                  } | arrays
        descriptions[f"{dimension}_trajectory"] = {"long_name": f"trajectory of {name}"}
    inner_dimensions: dict[str, tuple[str, ...]] = {
        array_name: ("coordinate",) if array.ndim > 1 else ()
        for array_name, array in arrays.items()}
    return Table({dimension: sum(map(len, crossings))}, inner_dimensions, descriptions,
                 lambda: iter([((slice(None),), arrays)]), manifest, event=name)


# ---------------------------------------------------------------- in memory


def _import_package(package: str, extra: str, purpose: str) -> Any:
    """Return an optional package, or raise MissingDependencyError with the extra that has it."""
    try:
        return import_module(package)
    except ImportError as error:
        raise MissingDependencyError(f"{purpose} need {package}; {install(extra)} brings it."
                                     ) from error


def as_dataset(table: Table, attributes: Mapping[str, Any]) -> xarray.Dataset:
    """Return a table as an xarray Dataset, with names along every dimension that has some.

    The time, and numbers with one entry a trajectory, are coordinates; all else are variables.
    """
    package = _import_package("xarray", "storage", "Datasets")
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    if "trajectory" in table.dimensions:
        coordinates["trajectory"] = np.arange(table.dimensions["trajectory"])
    for part_table in (table, *table.parts):
        # numbers that a trajectory has once select trajectories, as its index does
        single = [*part_table.dimensions] == ["trajectory"]
        for name, array in part_table.in_memory().items():
            target = coordinates if name == "time" or single else variables
            target[name] = ([*part_table.dimensions, *part_table.inner[name]], array,
                            part_table.descriptions[name])
    used_dimensions = {dimension for dimensions, *_ in variables.values()
                       for dimension in dimensions}
    coordinates |= {dimension: (dimension, names, {"long_name": meaning})
                    for dimension, (names, meaning) in table.labels.items()
                    if dimension in used_dimensions}
    dataset: xarray.Dataset = package.Dataset(variables, coordinates, attributes)
    return dataset


def as_frame(table: Table, selection: Any = None) -> pandas.DataFrame:
    """Return a table as a pandas DataFrame, a row a state, with trajectory and time as index.

    ``selection`` names columns, as for ``Trajectory.table``; None takes all.
    """
    pandas = _import_package("pandas", "pandas", "Data frames")
    blocks = [dict(zip(*block, strict=True)) for block in table.columns(selection)]
    # all blocks have the same columns
    frame = pandas.DataFrame({name: np.concatenate([block[name] for block in blocks])
                              for name in blocks[0]})
    if frame["time"].dtype == np.longdouble:  # pandas finds no long double in an index
        frame["time"] = frame["time"].astype(object)
    return frame.set_index([*(name for name in table.dimensions if name == "trajectory"), "time"])


# ---------------------------------------------------------------- files


def save_table(table: Table, path: Path, description: str, selection: Any = None) -> Path:
    """Write a table to a file, which appears complete or not at all; return its path.

    The ending says how: .csv, .parquet, .nc. Events beside columns are in a second file,
    ``run.events.csv``. Raises InputError for columns that the table does not have; GyrosparkError
    if the file cannot be written.
    """
    form = format_of(path, description, "states")
    with result_file(path, description) as partial_file:
        if not form.tabular:
            _write_netcdf(table, partial_file)
        elif form.ending == ".csv":
            blocks = table.columns(selection)
            titles, first_columns = next(blocks)  # all blocks have the same headings
            write_csv(partial_file, titles, chain([first_columns],
                                                  (columns for _, columns in blocks)))
        else:
            _write_parquet(table.columns(selection), partial_file)
    if form.tabular and table.events:
        titles, event_blocks = _event_blocks(table.manifest.system, table.events)
        with result_file(events_path(path), description) as partial_file:
            if form.ending == ".csv":
                write_csv(partial_file, titles, event_blocks)
            else:
                _write_parquet(((titles, _flat(columns)) for columns in event_blocks),
                               partial_file)
    return path


def _event_blocks(
    system: SystemManifest, events: Iterable[Table]
) -> tuple[list[str], list[list[Array]]]:
    """Return the headings of the file of events, and a block of columns for each event.

    The event's name is the first column; in ensembles it is behind the trajectory's number.
    """
    columns_of = dict(map(_event_columns, events))
    # all events have the same fields: a run has crossings or impacts
    fields = [*next(iter(columns_of.values()))]
    name_column = 1 if "trajectory" in fields else 0
    headings = fields[:name_column] + event_headings(system, fields[name_column:])
    blocks = []
    for name, columns in columns_of.items():
        names = np.full(len(columns["t"]), spreadsheet_text(name))
        arrays = [*columns.values()]
        blocks.append([*arrays[:name_column], names, *arrays[name_column:]])
    return headings, blocks


def _event_columns(event: Table) -> tuple[str, dict[str, Array]]:
    """Return the name of an event, and its columns under their names."""
    assert event.event is not None
    return event.event, {column.removeprefix(f"event_{event.event}_"): array
                         for column, array in event.in_memory().items()}


def _flat(columns: list[Array]) -> list[Array]:
    """Return every column of arrays as one array each: Parquet has no columns of rows."""
    return [column for array in columns
            for column in array.reshape(len(array), math.prod(array.shape[1:])).T]


def _write_parquet(blocks: Iterable[tuple[list[str], list[Array]]], path: Path) -> None:
    """Write blocks of columns; numbers wider than doubles are texts with all their digits."""
    import pyarrow
    from pyarrow.parquet import ParquetWriter

    # the first block says the types of the columns, which a file needs at its start
    writer = None
    try:
        for titles, columns in blocks:
            record_table = pyarrow.table([
                pyarrow.array(map(str, file_rows(column[:, None], flat=True)), pyarrow.string())
                if _is_wide(column) else pyarrow.array(column) for column in columns], names=titles)
            writer = writer or ParquetWriter(path, record_table.schema)
            writer.write_table(record_table)
    finally:
        if writer is not None:
            writer.close()


def _write_blocks(file: Any, table: Table) -> None:
    """Write the variables of a table to an open NetCDF file, block by block."""
    # trajectories end after different numbers of states: the whole arrays have NaN there
    blocks = table.read() if len(table.dimensions) == 1 else iter([
        ((slice(None),) * 2, table.in_memory())])
    for index, arrays in blocks:
        for variable in _netcdf_variables(table, arrays):
            _write_rows(file, table, index, *variable)


def _refuse_dimension_names(table: Table) -> None:
    """Refuse events whose names cannot be dimensions of a NetCDF file."""
    event_of_variable = {variable: event_table.event for event_table in table.events
                         for variable in event_table.descriptions}
    for event_table in table.events:
        (dimension,) = event_table.dimensions
        if "/" in dimension:
            fault = "'/' would part groups"
        elif "\0" in dimension:
            fault = "a name cannot contain the null character"
        elif dimension in event_of_variable:
            fault = f"the event {event_of_variable[dimension]!r} has a variable {dimension!r}"
        else:
            continue
        raise InputError(f"The event {event_table.event!r} cannot name a dimension of a NetCDF "
                         f"file: {fault}; give it another name, as in "
                         'gs.Event(..., name="landing"), or save .npz or .csv.')


def _write_netcdf(table: Table, path: Path) -> None:
    """Write NetCDF-4 block by block: wide numbers as doubles, and with all digits as bytes."""
    import h5netcdf
    import h5py

    _refuse_dimension_names(table)
    try:
        with h5netcdf.File(path, "w") as file:
            file.attrs.update({name: _plain(x) for name, x in table.attributes.items()})
            for part_table in (table, *table.parts):
                _write_blocks(file, part_table)
            if "trajectory" in table.dimensions:
                file.create_variable("trajectory", ("trajectory",),
                                     data=np.arange(table.dimensions["trajectory"]))
            for dimension, (names, meaning) in table.labels.items():
                if dimension in file.dimensions:
                    labels = file.create_variable(dimension, (dimension,),
                                                  dtype=h5py.string_dtype())
                    labels[:] = names
                    labels.attrs["long_name"] = meaning
    except RuntimeError as error:  # HDF5 has one for some of the system's errors
        raise OSError(str(error)) from error


def _write_rows(
    file: Any, table: Table, index: tuple[Any, ...], name: str, array: Array,
    inner_dimensions: tuple[str, ...], description: dict[str, Any],
) -> None:
    """Write rows of a variable of a NetCDF file, which the first rows define.

    ``index`` says where the rows of ``array`` belong along the dimensions of the table, and
    ``inner_dimensions`` are the names of its further ones.
    """
    import h5py

    # HDF5 takes texts of any length as Python's objects
    is_text = array.dtype.kind == "U"
    if name not in file.variables:
        shape = *table.dimensions.values(), *array.shape[len(index):]
        dimensions = *table.dimensions, *inner_dimensions
        for dimension, length in zip(dimensions, shape, strict=True):
            if dimension not in file.dimensions:
                file.dimensions[dimension] = length
        variable = file.create_variable(
            name, dimensions, dtype=h5py.string_dtype() if is_text else array.dtype)
        variable.attrs.update({key: _plain(x) for key, x in description.items()})
    file.variables[name][index] = array.astype(object) if is_text else array


def _netcdf_variables(
    table: Table, arrays: dict[str, Array]
) -> Iterator[tuple[str, Array, tuple[str, ...], dict[str, Any]]]:
    """Yield (name, array, inner dimensions, attributes) for each variable of a NetCDF file.

    A wide array becomes two variables: its doubles, and its bytes with all digits.
    """
    for name, array in arrays.items():
        inner_dimensions, description = table.inner[name], table.descriptions[name]
        wide = _is_wide(array)
        yield name, array.astype(float) if wide else array, inner_dimensions, description
        if wide:
            yield f"{name}_bytes", as_bytes(array), (*inner_dimensions, "byte"), {
                "long_name": f"{name} with all its digits, {WIDE_BYTES} bytes a number"}


def _is_wide(array: Array) -> bool:
    """Whether the numbers of an array are wider than doubles: long doubles, or mpmath's."""
    return array.dtype in (np.dtype(object), np.dtype(np.longdouble))


def _plain(value: Any) -> Any:
    """Return an attribute as NetCDF can hold it: a text or a number, anything else as JSON."""
    return value if isinstance(value, (str, int, float)) else json.dumps(value)
