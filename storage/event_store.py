"""Event store of a run: arrays to which found events are appended.

Nothing in them changes once it is there. Attributes and checkpoint hold the number of
each; later entries belong to a process that was interrupted, and are dropped.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from ..core.manifest import Manifest
from ..core.real_types import REALS
from ..runtime.bindings.real_numbers import as_bytes
from ..runtime.results.crossings import Crossings
from .array_layout import StoredField, array_of, fields_of_event, names_of, wide_name
from .chunks import Chunk
from .validation import refuse_missing_blocks, stored_values

__all__ = ["EventStore", "crossings_in", "values_of"]

Array = NDArray[Any]


class EventStore:
    """Appendable arrays of a run's events."""

    def __init__(self, group: zarr.Group, manifest: Manifest, names: list[str]) -> None:
        self._fields = {name: fields_of_event(manifest, name) for name in names}
        self._arrays = {one: array_of(group, one) for fields in self._fields.values()
                        for one in names_of(fields)}

    def chunks(self, begun: Mapping[str, int], found: Mapping[str, Crossings]) -> list[Chunk]:
        """Return new events as chunks, after the given number stored of each."""
        return [chunk for name, crossings in found.items() if len(crossings)
                for field, values in zip(self._fields[name], values_of(crossings), strict=True)
                for chunk in self._of_field(field, begun[name], values)]

    def _of_field(self, field: StoredField, begun: int, values: Array) -> list[Chunk]:
        parts = {field.name: values.astype(field.dtype)}
        if field.wide:
            parts[wide_name(field.name)] = as_bytes(values)
        return [chunk for name, rows in parts.items()
                for chunk in _behind(self._arrays[name], begun, rows)]

    @property
    def names(self) -> set[str]:
        """The names of the arrays."""
        return set(self._arrays)

    def grow(self, counts: Mapping[str, int]) -> set[str]:
        """Resize the arrays of each event, and drop later rows.

        Returns the names of those that had not as many.
        """
        changed = [(one, count) for name, count in counts.items()
                   for one in names_of(self._fields[name]) if self._arrays[one].shape[0] != count]
        for one, count in changed:
            array = self._arrays[one]
            array.resize((count, *array.shape[1:]))
        return {one for one, _ in changed}


def _behind(array: zarr.Array[Any], begun: int, rows: Array) -> list[Chunk]:
    """Return the chunks that have new rows; the first has old ones too."""
    block, inner = array.chunks[0], (0,) * (array.ndim - 1)
    first = begun // block
    known = stored_values(array, first * block, begun - first * block, False, array.dtype)
    whole = np.concatenate([known, rows])
    return [Chunk(array, (first + i, *inner), whole[i * block : (i + 1) * block])
            for i in range(-(-len(whole) // block))]


def values_of(crossings: Crossings) -> tuple[Array, ...]:
    """Return the arrays of an event in the order of ``fields_of_event``."""
    return (crossings.t, crossings.q, crossings.p, crossings.steps, crossings.rising,
            crossings.elapsed)


def crossings_in(
    path: Path, group: zarr.Group, manifest: Manifest, counts: Mapping[str, int]
) -> dict[str, Crossings]:
    """Return the given number of crossings of each event."""
    dtype = REALS[manifest.real].dtype
    found = {}
    for name, count in counts.items():
        fields = fields_of_event(manifest, name)
        refuse_missing_blocks(path, group, 0, count, names_of(fields))
        t, q, p, steps, rising, elapsed = (
            stored_values(array_of(group, wide_name(one.name) if one.wide else one.name), 0, count,
                          one.wide, dtype) for one in fields)
        found[name] = Crossings(t, q, p, steps, rising.astype(bool), elapsed)
    return found
