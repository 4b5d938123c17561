"""Event store of a run: arrays to which located events are appended.

Entries never change. Attributes and checkpoint hold the number of events; later entries belong to
an interrupted process and are dropped.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from ..core.arrays import Array
from ..core.manifest import Manifest
from ..core.real_types import REALS
from ..runtime.bindings.real_numbers import as_bytes
from ..runtime.results.crossings import Crossings, of_columns
from .array_layout import StoredField, array_of, fields_of_events, names_of, wide_name
from .chunk_writer import Chunk
from .validation import refuse_missing_blocks, stored_values

__all__ = ["EventStore", "crossings_in"]


class EventStore:
    """Appendable arrays of a run's events."""

    def __init__(
        self, group: zarr.Group, manifest: Manifest, events: Mapping[str, Mapping[str, Any]]
    ) -> None:
        """Open the arrays of each event in a store's group."""
        self._fields = fields_of_events(manifest, events)
        self._arrays = {array_name: array_of(group, array_name) for fields in self._fields.values()
                        for array_name in names_of(fields)}

    def chunks(self, stored_counts: Mapping[str, int],
               new_crossings: Mapping[str, Crossings]) -> list[Chunk]:
        """Return chunks with new events, appended after the stored number of each event."""
        chunks: list[Chunk] = []
        for name, crossings in new_crossings.items():
            if len(crossings):
                columns = zip(self._fields[name], crossings.columns.values(), strict=True)
                for field, column in columns:
                    chunks += self._of_field(field, stored_counts[name], column)
        return chunks

    def _of_field(self, field: StoredField, stored_count: int, array: Array) -> list[Chunk]:
        """Return the chunks that new rows of a field add behind ``stored_count`` rows.

        Numbers wider than a double are in two arrays: rounded, and as bytes.
        """
        arrays = {field.name: array.astype(field.dtype)}
        if field.wide:
            arrays[wide_name(field.name)] = as_bytes(array)
        return [chunk for name, new_rows in arrays.items()
                for chunk in _chunks_to_append(self._arrays[name], stored_count, new_rows)]

    @property
    def names(self) -> set[str]:
        """The names of the arrays."""
        return set(self._arrays)

    def resize(self, counts: Mapping[str, int]) -> set[str]:
        """Give the arrays of each event ``counts[name]`` rows; return the names of changed arrays.
        """
        lengths_to_change = [(array_name, count) for name, count in counts.items()
                             for array_name in names_of(self._fields[name])
                             if self._arrays[array_name].shape[0] != count]
        for array_name, count in lengths_to_change:
            array = self._arrays[array_name]
            array.resize((count, *array.shape[1:]))
        return {array_name for array_name, _ in lengths_to_change}


def _chunks_to_append(array: zarr.Array[Any], stored_count: int, new_rows: Array) -> list[Chunk]:
    """Return the chunks with new rows; the first chunk has the stored rows of its block too.

    ``stored_count`` rows precede the new ones: chunks are written whole.
    """
    block, inner_position = array.chunks[0], (0,) * (array.ndim - 1)
    first_chunk = stored_count // block
    block_start = stored_values(array, first_chunk * block, stored_count - first_chunk * block,
                                wide=False, dtype=array.dtype)
    all_rows = np.concatenate([block_start, new_rows])
    return [Chunk(array, (first_chunk + i, *inner_position), all_rows[begin : begin + block])
            for i, begin in enumerate(range(0, len(all_rows), block))]


def crossings_in(
    path: Path, group: zarr.Group, manifest: Manifest, events: Mapping[str, Mapping[str, Any]],
    counts: Mapping[str, int],
) -> dict[str, Crossings]:
    """Return the crossings, or impacts, of each event: the first ``counts[name]`` of its rows.

    ``events`` are the attributes of the run's events. Raises InputError for missing files.
    """
    dtype = REALS[manifest.real].dtype
    crossings = {}
    for name, fields in fields_of_events(manifest, events).items():
        refuse_missing_blocks(path, group, 0, counts[name], names_of(fields))
        columns = {}
        for field in fields:
            # wide numbers are read from their bytes, which have all digits
            array = array_of(group, wide_name(field.name) if field.wide else field.name)
            columns[field.name.removeprefix(f"event_{name}_")] = stored_values(
                array, 0, counts[name], field.wide, dtype)
        columns["rising"] = columns["rising"].astype(bool)  # stored as 0 and 1
        crossings[name] = of_columns(columns)
    return crossings
