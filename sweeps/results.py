"""Results of cells, in memory or in a Zarr store whose regions workers write.

The arrays of a tile are written concurrently, to hide the latency of a disk, and ``status`` last:
a tile whose ``status`` chunk exists is complete on the disk and is never computed again.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import zarr

from ..core.arguments import as_items, as_path, proposal, shown
from ..core.arrays import Array
from ..core.errors import InputError, StorageError
from ..core.manifest import Manifest
from ..runtime.bindings.binding import REASONS
from ..runtime.results.outputs import labels_of
from ..storage.array_layout import (
    QUANTITY,
    StoredField,
    array_of,
    attributes_of,
    consolidate,
    create_array,
    open_group,
)
from ..storage.chunk_writer import Chunk, write_chunks
from ..storage.durable_files import DurableStore, storage_errors
from ..storage.identity import written_by
from .axes import SCHEME, START
from .cell_events import count_of, first_of
from .study import Study
from .tiles import Tile, tile_counts, tile_shape, tiles_of

if TYPE_CHECKING:
    import xarray

__all__ = [
    "BAD_START",
    "CURE",
    "FORMAT",
    "NOT_COMPUTED",
    "STATUS",
    "MemorySink",
    "Sink",
    "StoreSink",
    "count_of_each",
    "count_statuses",
    "create_store",
    "done_tiles",
    "fields_of",
    "is_complete",
    "load_sweep",
    "meanings",
    "summary",
]

#: Version of the layout of stores; stores of another version are refused.
FORMAT = 1
STATUS = "status"
NOT_COMPUTED = -1
#: Behind the statuses of compiled code, 1 to 7.
BAD_START = 8
CURE = "Finished cells are whole: mend it, and repeat the command with --resume."


def meanings() -> dict[int, str]:
    """Return the meaning of each status of a cell."""
    return {NOT_COMPUTED: "not computed", 0: "done", **REASONS,
            BAD_START: "start off the constraints or without finite H"}


def fields_of(study: Study, keep: Iterable[str] | None = None) -> list[StoredField]:
    """Return the arrays of a sweep's result, all or the ones in ``keep``; the status last.

    Raises InputError if a name in ``keep`` is no result.
    """
    binding = study.steppers[0].binding
    # of other systems than a rigid body the units of H and p are not known
    is_body = study.steppers[0].manifest.system.rigid_body
    joule, momentum = ({"units": unit} if is_body else {} for unit in ("J", "kg m2 s-1"))
    state = (("coordinate", study.steppers[0].n),)
    fields = [
        *_error_fields(binding.has_forces, joule),
        _scalar_field("iterations_mean", "iterations a step"),
        StoredField("iterations_max", (), {"long_name": "most iterations of a step"}, dtype="i4"),
        StoredField("newton_steps", (), {"long_name": "steps that only Newton could do"},
                    dtype="i8"),
        StoredField("steps_done", (), {"long_name": "steps done"}, dtype="i8"),
        StoredField("q", state, {"long_name": "coordinates at the end"}),
        StoredField("p", state, {"long_name": "momenta at the end", **momentum}),
    ]
    if binding.clocked:
        fields.append(_scalar_field("t", "time at the end", units="s"))
    if binding.has_forces:
        fields.append(_scalar_field("work", "work of the forces"))
    fields += [_scalar_field(QUANTITY + name, f"quantity {name} at the end")
               for name in binding.quantity_names]
    for event in study.events:
        crossing = f"{event.quantity} = {float(event.level):g}"
        fields += [_scalar_field(first_of(event.name),
                                 f"time of the first {crossing}; NaN where none", units="s"),
                   _scalar_field(count_of(event.name), f"how often {crossing}")]
    fields += _sample_fields(study, state, momentum)
    _refuse_result_names(study, fields)
    return [*_selected_fields(fields, keep), _status_field()]


def _scalar_field(name: str, text: str, **units: str) -> StoredField:
    """Return the field of one double for each cell, described by ``text``."""
    return StoredField(name, (), {"long_name": text, **units})


def _error_fields(has_forces: bool, joule: Mapping[str, str]) -> list[StoredField]:
    """Return the fields of H and of the errors in H, g and g_q H_p over the steps of a cell.

    ``joule`` is the attribute with the unit of H, {} where it is not known.
    """
    error = "|H - H0 - W|" if has_forces else "|H - H0|"
    return [
        _scalar_field("energy_start", "H at the start", **joule),
        _scalar_field("energy_error_max", f"largest {error} of all steps", **joule),
        _scalar_field("energy_error_mean", f"mean {error} of all steps", **joule),
        _scalar_field("constraint_max", "largest |g(q)| of all steps"),
        _scalar_field("constraint_mean", "mean |g(q)| of all steps"),
        _scalar_field("momentum_constraint_max", "largest |g_q H_p| of all steps"),
        _scalar_field("momentum_constraint_mean", "mean |g_q H_p| of all steps"),
    ]


def _refuse_result_names(study: Study, fields: list[StoredField]) -> None:
    """Refuse an axis, or a column of one, with the name of a result or of its dimensions.

    A dataset has each name once.
    """
    names = {STATUS, *(field.name for field in fields),
             *(dimension for field in fields for dimension, _ in field.inner)}
    for axis in study.axes:
        for name in (axis.name, *axis.columns):
            # columns q and p of starts have names of their own in the dataset
            if name in names and axis.name != START:
                raise InputError(f"{name!r} along the axis {axis.name!r} is the name of a result "
                                 "of this sweep, or of a dimension of one; give it another name.")


def _sample_fields(
    study: Study, state: tuple[tuple[str, int], ...], momentum: Mapping[str, str]
) -> list[StoredField]:
    """Return the fields of the states of a cell during the run, every ``study.every`` steps.

    ``state`` is the dimension of a state, ``momentum`` the attribute with the unit of momenta.
    """
    if study.every is None:
        return []
    samples = (("sample", study.max_steps // study.every + 1), *state)
    fields = [StoredField("q_samples", samples, {"long_name": "coordinates on the way"}),
              StoredField("p_samples", samples, {"long_name": "momenta on the way", **momentum})]
    if study.steppers[0].binding.clocked:
        fields.append(StoredField("t_samples", samples[:1],
                                  {"long_name": "times on the way", "units": "s"}))
    return fields


def _status_field() -> StoredField:
    """Return the field of the status, whose attributes name its values (CF conventions)."""
    status_texts = meanings()
    return StoredField(STATUS, (), {
        "long_name": "how the cell ended", "flag_values": list(status_texts),
        "flag_meanings": " ".join(text.replace(" ", "_") for text in status_texts.values())}, "i1")


def _selected_fields(fields: list[StoredField], keep: Iterable[str] | None) -> list[StoredField]:
    """Return the fields that ``keep`` names, all if it is None; raise InputError for other names.

    The status may be named too, though it is none of ``fields``: every sweep stores it.
    """
    names = [field.name for field in fields]
    selected_names = names if keep is None else as_items("keep", keep, "results", is_ordered=False)
    for name in selected_names:
        if not isinstance(name, str) or name not in (*names, STATUS):
            raise InputError(f"{shown(name)} is no result of this sweep; keep some of "
                             f"{', '.join(names)}{proposal(name, names)}.")
    return [field for field in fields if field.name in selected_names]


class Sink(Protocol):
    """The destination of the arrays of finished tiles: memory or a store."""

    def write(self, tile: Tile, arrays: dict[str, Array]) -> None:
        """Store the arrays of a tile."""


class MemorySink:
    """Arrays in memory."""

    def __init__(self, study: Study, fields: list[StoredField]) -> None:
        """Allocate an array of all cells for each field, or refuse a study that memory cannot hold.
        """
        self._study, self._fields = study, fields
        try:
            self.arrays = {f.name: np.full((*study.shape, *f.shape), _fill(f), dtype=f.dtype)
                           for f in fields}
        except MemoryError as error:
            raise InputError(f"There is no memory for {study.size:,} cells; give a store, or keep "
                             "fewer results of each.") from error

    def write(self, tile: Tile, arrays: dict[str, Array]) -> None:
        """Keep the arrays of a tile."""
        for name, array in self.arrays.items():
            array[tile.slices] = arrays[name]

    def dataset(self, attributes: dict[str, Any]) -> xarray.Dataset:
        """Return the results as an xarray Dataset."""
        import xarray

        dimensions = [axis.name for axis in self._study.axes]
        # after the axes of the study, the dimensions of a result in one cell, such as coordinates
        results = {stored.name: ([*dimensions, *(name for name, _ in stored.inner)],
                                 self.arrays[stored.name], stored.attributes)
                   for stored in self._fields}
        coordinates = {}
        for name, (along, numbers, coordinate_attributes) in _coordinates(self._study).items():
            coordinates[name] = along, _labels(name, numbers, coordinate_attributes)
        return _label_dimensions(xarray.Dataset(results, coordinates, attributes))


class StoreSink:
    """Arrays on disk. Any number of workers may write tiles, each its own chunks."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._arrays: dict[str, zarr.Array[Any]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Travel to a worker as a path."""
        return {"path": self.path, "_arrays": {}}

    def write(self, tile: Tile, arrays: dict[str, Array]) -> None:
        """Write a tile, name of a result → array of the tile's shape, and flush it to the disk."""
        with storage_errors(self.path, CURE):
            if not self._arrays:
                group = open_group(self.path, write=True)
                self._arrays = {name: array_of(group, name) for name in arrays}
            chunks = {name: Chunk(self._arrays[name], self._place(name, tile), array)
                      for name, array in arrays.items()}
            status_chunk = chunks.pop(STATUS)
            # the status last: where it is, all results of the tile are
            if chunks:
                write_chunks(list(chunks.values()))
            write_chunks([status_chunk])

    def _place(self, name: str, tile: Tile) -> tuple[int, ...]:
        """Return the place of a tile's chunk: a tile has all numbers of its cells."""
        return tile.place + (0,) * (self._arrays[name].ndim - len(tile.place))


def _fill(field: StoredField) -> float:
    """Return the value of a result before its cell is computed."""
    return NOT_COMPUTED if field.name == STATUS else field.fill


def create_store(
    path: Path, study: Study, fields: list[StoredField], attributes: dict[str, Any]
) -> None:
    """Make an empty store for a sweep: results, and the values along the axes.

    ``fields`` are the results of a cell; a chunk is a tile, which one task computes.
    """
    group = zarr.create_group(DurableStore(path), attributes=attributes)
    dimensions, chunks = [axis.name for axis in study.axes], tile_shape(study)
    for field in fields:
        create_array(group, field.name, (*study.shape, *field.shape), (*chunks, *field.shape),
                     field.dtype, _fill(field),
                     [*dimensions, *(name for name, _ in field.inner)], field.attributes)
    for name, (along, coordinate, coordinate_attributes) in _coordinates(study).items():
        array = create_array(group, name, shape=coordinate.shape, chunks=coordinate.shape,
                             dtype=coordinate.dtype, fill=0, dimensions=along,
                             attributes=coordinate_attributes)
        # zeros are written too: a missing file means damage
        array.with_config({"write_empty_chunks": True})[...] = coordinate
    consolidate(path)


def _coordinates(study: Study) -> dict[str, tuple[list[str], Array, dict[str, Any]]]:
    """Return the coordinates along the axes: name → (dimensions, values, attributes)."""
    coordinates: dict[str, tuple[list[str], Array, dict[str, Any]]] = {}
    for axis in study.axes:
        for name, values in axis.columns.items():
            if name in ("q", "p"):
                coordinates[f"{name}_start"] = ([axis.name, "coordinate"], values.astype(float), {})
            else:
                attributes = {"labels": list(axis.labels)} if name == SCHEME else {}
                coordinates[name] = ([axis.name], values, attributes)
    return coordinates


def _labels(name: str, scheme_numbers: Array, attributes: dict[str, Any]) -> Array:
    """Return the values along an axis for readers: of schemes their names, which stores have as
    numbers."""
    return scheme_numbers if name != SCHEME else np.array(attributes["labels"])[scheme_numbers]


def _label_dimensions(dataset: xarray.Dataset) -> xarray.Dataset:
    """Return a result with the system's names along its dimensions: q0, q1, … of ``coordinate``."""
    # the steppers of a study differ by their schemes and have one system
    system = Manifest.from_json(next(iter(dataset.attrs["manifests"].values()))).system
    with_labels: xarray.Dataset = dataset.assign_coords({
        dimension: (dimension, names, {"long_name": meaning})
        for dimension, (names, meaning) in labels_of(system).items() if dimension in dataset.dims})
    return with_labels


def done_tiles(path: Path) -> set[tuple[int, ...]]:
    """Return the places of the tiles that have a file of each result."""
    group = open_group(path)
    return set.intersection(*(_tiles_with_files(path, group, name)
                              for name in attributes_of(group)["sweep"]["results"]))


def _tiles_with_files(path: Path, group: zarr.Group, name: str) -> set[tuple[int, ...]]:
    """Return the places of the tiles that have a file of this result.

    Zarr writes chunk (i, j) of an array to the file ``c/i/j`` of its folder; a tile is one chunk.
    """
    root, axes = path / name / "c", array_of(group, STATUS).ndim
    places = (p.relative_to(root).parts for p in _files(root))
    return {tuple(map(int, tile_index[:axes])) for tile_index in places
            if all(index.isdigit() for index in tile_index)}


def _refuse_missing_files(path: Path, group: zarr.Group, names: Iterable[str]) -> None:
    """Refuse a sweep that lacks files of finished tiles or of axes, which Zarr reads as fills.

    ``names`` are those of the results. Raises InputError.
    """
    tiles = _tiles_with_files(path, group, STATUS)  # written last of a tile
    for name in group.array_keys():
        is_result = name in names
        if is_result and tiles <= _tiles_with_files(path, group, name):
            continue
        if is_result or not any(_files(path / name / "c")):
            raise InputError(
                f"The sweep {str(path)!r} is damaged: a file of {name!r} is missing; "
                + ("repeat the command with --resume, which computes it." if is_result else
                   "restore it from a copy, or compute the sweep in another store."))


def is_complete(study: Study, path: Path) -> bool:
    """Whether all tiles of a study are in its store."""
    return len(done_tiles(path)) == math.prod(tile_counts(study))


def _files(root: Path) -> Iterable[Path]:
    """Yield the paths of all files below a folder."""
    return (Path(folder) / name for folder, _, names in os.walk(root) for name in names)


def _tiles_in(study: Study, path: Path, name: str) -> Iterator[tuple[Tile, Array]]:
    """Yield the tiles of a study with their values of a stored result; StorageError for damage."""
    try:
        array = array_of(open_group(path), name)
        for tile in tiles_of(study):
            yield tile, np.asarray(array[tile.slices])
    except (KeyError, ValueError) as error:
        raise StorageError(f"The store {str(path)!r} is damaged, its {name!r} cannot be read: "
                           f"{error}. Remove the store, and repeat the sweep.") from error


def count_statuses(study: Study, path: Path) -> dict[int, int]:
    """Return the number of cells with each status, reading the store tile by tile."""
    counts: Counter[int] = Counter()
    for _, statuses in _tiles_in(study, path, STATUS):
        counts.update(count_of_each(statuses))
    return dict(counts)


def count_of_each(statuses: Array) -> dict[int, int]:
    """Return the number of cells with each of some statuses."""
    distinct, cell_counts = np.unique(statuses, return_counts=True)
    return dict(zip(distinct.tolist(), cell_counts.tolist(), strict=True))


def load_sweep(path: str | os.PathLike[str]) -> xarray.Dataset:
    """Return the result of a stored sweep, finished or not; values are read when they are used.

    Raises
    ------
    InputError
        If there is none, or it is damaged.
    """
    import xarray

    root = as_path("path", path, "study.zarr")
    try:
        group = open_group(root)
        attributes = attributes_of(group)
        if attributes["sweep"]["format"] != FORMAT:
            raise written_by(root, attributes["sweep"]["gyrospark"], f"its format is "
                             f"{attributes['sweep']['format']}, and {FORMAT} is known here")
        names = attributes["sweep"]["results"]
        _refuse_missing_files(root, group, names)
        dataset: xarray.Dataset = xarray.open_zarr(root)
        if SCHEME in dataset:  # numbers of schemes in the store, names for readers
            scheme = dataset[SCHEME]
            dataset = dataset.assign_coords({SCHEME: (scheme.dims, _labels(
                SCHEME, np.asarray(scheme), scheme.attrs))})
        axes = [name for name in dataset.variables if name not in names]
        return _label_dimensions(dataset.set_coords(axes)[names])
    except InputError:
        raise
    except PermissionError as error:
        raise InputError(f"{str(root)!r} cannot be read: {error.strerror}.") from error
    except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
        raise InputError(f"{str(root)!r} is no sweep that gyrospark stored, or damaged; give a "
                         "folder that `gyrospark sweep` made.") from error


def summary(study: Study, path: Path, name: str) -> dict[str, Any]:
    """Return the extrema of a result and the axis values at them, reading tile by tile.

    Keys: "least", "most", "least_at", "most_at"; None where all cells failed.
    """
    extrema: dict[str, tuple[float, tuple[int, ...]]] = {}
    for tile, stored_values in _tiles_in(study, path, name):
        tile_values = stored_values.astype(float)
        if not np.isfinite(tile_values).any():
            continue
        for end, argument_of, better in (("least", np.nanargmin, np.less),
                                         ("most", np.nanargmax, np.greater)):
            index = np.unravel_index(int(argument_of(tile_values)), tile_values.shape)
            extremum = float(tile_values[index])
            if end not in extrema or better(extremum, extrema[end][0]):
                # the index of the cell in the whole grid
                extrema[end] = extremum, tuple(s.start + int(i) for s, i in
                                               zip(tile.slices, index, strict=True))
    if not extrema:
        return {"least": None, "most": None}
    return {end: extremum for end, (extremum, _) in extrema.items()} | {
        f"{end}_at": _values_at(study, index) for end, (_, index) in extrema.items()}


def _values_at(study: Study, cell_index: tuple[int, ...]) -> dict[str, Any]:
    """Return the values of all columns of the axes at a cell, by name."""
    axis_values: dict[str, Any] = {}
    for axis, i in zip(study.axes, cell_index, strict=True):
        for column, values in axis.columns.items():
            axis_values[column] = (
                axis.labels[i] if column == SCHEME else np.asarray(values[i]).tolist())
    return axis_values
