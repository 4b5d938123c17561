"""The arrays of a stored run, for xarray, Julia and other readers of Zarr.

The arrays of ``OUTPUTS`` lie along the dimension ``time``, one entry per stored state; some systems
have no multipliers, work or quantities. Multipliers and iterations belong to the step that ends at
a state, and are empty at the start. Values not yet computed are NaN, or 0. Zarr has no wide numbers
(long double, binary128): they are stored rounded to double under these names, and as bytes with all
digits under ``<name>_bytes``.

A row of all arrays is a state; rows are written in blocks, each a chunk of every array.

The events of a run have arrays of their own, ``event_<name>_t``, ``_q``, ``_p``, ``_steps``,
``_rising`` and ``_elapsed``, along a dimension ``event_<name>`` that grows with the events found;
impacts ``_p_after``, ``_impulse``, ``_energy_lost`` and ``_work`` in addition.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import BytesCodec, Crc32cCodec

from ..core.manifest import Manifest
from ..core.real_types import REALS
from ..runtime.bindings.real_numbers import WIDE_BYTES
from ..runtime.results.crossings import Crossings, Impacts
from ..runtime.results.outputs import (
    OUTPUTS,
    QUANTITY,
    description_of,
    description_of_column,
    names_in_files,
)
from .chunk_writer import Chunk, write_chunks
from .durable_files import DurableStore, write_durably

__all__ = ["CHECKPOINT", "EXTENDS", "QUANTITY", "SOURCE", "WIDE_FILL", "StoredField", "array_of",
           "attributes_of", "block_rows", "consolidate", "create", "create_array", "extend",
           "fields_of", "fields_of_events", "names_of", "open_group", "wide_name"]

CHECKPOINT = "checkpoint"
#: The array with the files of the stepper.
SOURCE = "source"
_METADATA = "zarr.json"
#: The attribute with the rows that the arrays are about to have.
EXTENDS = "extends_to_rows"
#: A block is written whole, and forcing it to the disk takes some ten times 1 ms however small it
#: is: large enough for that not to count, small enough for a few to be in memory.
_BLOCK_BYTES = 32 * 2**20
_MOST_ROWS = 2**18
#: Block size of rare events: the last block is written again with each commit.
_BLOCK_OF_EVENTS, _MOST_EVENTS = 2**20, 2**12
#: Fill bytes of wide numbers not yet computed; 16 of them are NaN.
WIDE_FILL = 255


@dataclass(frozen=True)
class StoredField:
    """One array of a run.

    Attributes
    ----------
    name : str
    inner : tuple of (dimension, length)
        Dimensions of one state.
    attributes : dict
        ``units`` and ``long_name`` for readers.
    dtype : str
        Type of the array, as NumPy names it.
    wide : bool
        Whether its numbers are wider than a double.
    """

    name: str
    inner: tuple[tuple[str, int], ...] = ()
    attributes: dict[str, Any] = field(default_factory=dict)
    dtype: str = "f8"
    wide: bool = False

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one state's entry."""
        return tuple(length for _, length in self.inner)

    @property
    def wide_shape(self) -> tuple[int, ...]:
        """Shape of one state's entry as bytes."""
        return (*self.shape, WIDE_BYTES)

    @property
    def fill(self) -> float:
        """Fill value of entries not yet computed."""
        return np.nan if self.dtype.startswith("f") else 0

    @property
    def row_bytes(self) -> int:
        """Bytes of one state's entry on the disk, those with all digits of wide numbers included.
        """
        number_bytes = int(self.dtype[1:])  # 8 of "f8"
        return math.prod(self.shape) * (number_bytes + WIDE_BYTES * self.wide)


def wide_name(name: str) -> str:
    """Return the name of the array with a wide field's bytes."""
    return f"{name}_bytes"


def fields_of(manifest: Manifest) -> list[StoredField]:
    """Return the arrays of states that a store of this stepper has, in the order of ``OUTPUTS``."""
    real = REALS[manifest.real]
    fields = []
    for output in OUTPUTS:
        for name in names_in_files(output, manifest):
            fields.append(StoredField(
                name, output.inner(manifest) or (), description_of(output, manifest, name),
                output.dtype or real.stored, wide=real.wide and not output.is_integer))
    return fields


def fields_of_events(
    manifest: Manifest, events: Mapping[str, Mapping[str, Any]]
) -> dict[str, list[StoredField]]:
    """Return the arrays of each event of a run, in the order of ``Crossings.columns``.

    ``events``, name → attributes as stored: impacts have a restitution.
    """
    real = REALS[manifest.real]
    state = (("coordinate", len(manifest.system.coordinates)),)
    shape_of_column = {"q": state, "p": state, "p_after": state}  # other columns have one number

    def event_field(name: str, column: str) -> StoredField:
        """Return the field of one array of an event, with its shape, unit and type."""
        dtype = {"steps": "i8", "rising": "i1", "t": "f8", "elapsed": "f8"}.get(column, real.stored)
        return StoredField(f"event_{name}_{column}", shape_of_column.get(column, ()),
                           description_of_column(manifest, name, column), dtype,
                           wide=real.wide and not dtype.startswith("i"))

    fields = {}
    for name, attributes in events.items():
        kind = Impacts if "restitution" in attributes else Crossings
        fields[name] = [event_field(name, column) for column in kind._column_names()]
    return fields


def names_of(fields: Iterable[StoredField]) -> list[str]:
    """Return the names of the arrays of the fields, and of the bytes of wide numbers."""
    return [name for stored_field in fields
            # the second name for wide numbers alone
            for name in (stored_field.name, wide_name(stored_field.name))[: 1 + stored_field.wide]]


def block_rows(
    fields: list[StoredField], rows: int, most_bytes: int = _BLOCK_BYTES,
    most_rows: int | None = None
) -> int:
    """Return how many states are written at a time: a power of two, at most all ``rows``.

    A block has at most ``most_bytes`` bytes and ``most_rows`` rows, and one row at least.
    """
    row_limit = min(most_bytes // sum(f.row_bytes for f in fields), most_rows or _MOST_ROWS)
    power_of_two = 1 << (max(row_limit, 1).bit_length() - 1)
    return max(1, min(rows, power_of_two))


def create(
    path: Path, fields: list[StoredField], rows: int, checkpoint_bytes: int,
    attributes: dict[str, Any],
    events: Mapping[str, list[StoredField]] | None = None, source: bytes = b"",
) -> None:
    """Create an empty store: fields of states, fields of each event, checkpoint, attributes.

    Fields of states have ``rows`` rows, those of events none yet. ``source`` has the bytes of the
    stepper's files.
    """
    group = zarr.create_group(DurableStore(path),
                              attributes=attributes | {"arrays": names_of(fields)})
    _create_along(group, "time", fields, rows, block_rows(fields, rows))
    for name, event_fields in (events or {}).items():
        _create_along(group, f"event_{name}", event_fields, rows=0, block=block_rows(
            event_fields, rows=_MOST_EVENTS, most_bytes=_BLOCK_OF_EVENTS,
            most_rows=_MOST_EVENTS))
    create_array(group, CHECKPOINT, shape=(checkpoint_bytes,), chunks=(checkpoint_bytes,),
                 dtype="u1", fill=0, dimensions=["checkpoint_byte"],
                 attributes={"long_name": "from which the run goes on; see gyrospark"})
    if source:
        # with it a store can be resumed, and differentiated, on another machine
        array = create_array(group, SOURCE, shape=(len(source),), chunks=(len(source),),
                             dtype="u1", fill=0, dimensions=["source_byte"],
                             attributes={"long_name": "C source and manifest of the stepper, "
                                         "JSON compressed by zlib"})
        write_chunks([Chunk(array, position=(0,), values=np.frombuffer(source, np.uint8))])
    consolidate(path)


def _create_along(
    group: zarr.Group, dimension: str, fields: list[StoredField], rows: int, block: int
) -> None:
    """Create the arrays of fields, each with ``rows`` rows along ``dimension``, ``block`` in a
    chunk.

    Wide fields have a second array, with the bytes of all digits.
    """
    for stored_field in fields:
        inner_dimensions = [name for name, _ in stored_field.inner]
        create_array(group, stored_field.name, (rows, *stored_field.shape),
                     (block, *stored_field.shape), stored_field.dtype, stored_field.fill,
                     [dimension, *inner_dimensions], stored_field.attributes)
        if stored_field.wide:
            description = {"long_name": f"{stored_field.name} with all its digits, {WIDE_BYTES} "
                                        "bytes a number"}
            create_array(group, wide_name(stored_field.name), (rows, *stored_field.wide_shape),
                         (block, *stored_field.wide_shape), "u1", WIDE_FILL,
                         [dimension, *inner_dimensions, "byte"], description)


def extend(path: Path, names: Sequence[str], rows: int, attributes: Mapping[str, Any]) -> None:
    """Resize the arrays of a store to ``rows``, then set attributes of the store.

    The process may be killed between any two files: until all are written the store has the
    attribute ``EXTENDS``, and each array has its old or its new number of rows.
    """
    consolidate(path, names=(), attributes={EXTENDS: rows})
    group = open_group(path, write=True)
    for name in names:
        array = array_of(group, name)
        array.resize((rows, *array.shape[1:]))
    consolidate(path, names, {**attributes, EXTENDS: None})  # all arrays have their new rows


def create_array(
    group: zarr.Group, name: str, shape: tuple[int, ...], chunks: tuple[int, ...], dtype: Any,
    fill: float, dimensions: list[str], attributes: dict[str, Any],
) -> zarr.Array[Any]:
    """Create an array of little-endian numbers, each chunk with its CRC32C.

    No compression: the last bits of a motion are noise, and compression saves only a tenth.
    """
    number_codec = BytesCodec(endian="little" if np.dtype(dtype).itemsize > 1 else None)
    return group.create_array(name, shape=shape, chunks=chunks, dtype=dtype, fill_value=fill,
                              filters=None, serializer=number_codec, compressors=[Crc32cCodec()],
                              dimension_names=dimensions, attributes=attributes)


def consolidate(
    path: Path, names: Iterable[str] | None = None, attributes: Mapping[str, Any] | None = None
) -> None:
    """Consolidate the metadata of arrays in the group: readers then open one file, not ten.

    xarray warns if there is none. ``names`` are the arrays with new metadata, by default all;
    ``attributes`` of the group are written in the same file.
    """
    root = json.loads((path / _METADATA).read_bytes())
    root["attributes"] |= attributes or {}
    consolidated = (root.get("consolidated_metadata") or {}).get("metadata", {})
    if names is None or not consolidated:
        names = [file.parent.name for file in path.glob(f"*/{_METADATA}")]
    arrays = {name: json.loads((path / name / _METADATA).read_bytes()) for name in names}
    root["consolidated_metadata"] = {"kind": "inline", "must_understand": False,
                                     "metadata": dict(sorted((consolidated | arrays).items()))}
    write_durably(path / _METADATA, json.dumps(root, indent=2).encode())


def open_group(path: Path, *, write: bool = False) -> zarr.Group:
    """Return the group of a store, with the metadata of its arrays, not those of the root.

    After a killed process the copies in the root may be outdated.
    """
    return zarr.open_group(DurableStore(path, read_only=not write), mode="r+" if write else "r",
                           use_consolidated=False)


def attributes_of(group: zarr.Group) -> dict[str, Any]:
    """Return the attributes of a store."""
    return dict(group.attrs)


def array_of(group: zarr.Group, name: str) -> zarr.Array[Any]:
    """Return an array of a store, which a group opens once.

    Raises KeyError if it is not there.
    """
    opened: dict[str, zarr.Array[Any]] = vars(group).setdefault("opened_arrays", {})
    if name not in opened:
        member = group[name]
        if not isinstance(member, zarr.Array):
            raise KeyError(name)
        opened[name] = member
    return opened[name]
