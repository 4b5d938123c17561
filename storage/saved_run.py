"""A run in memory as a store, for ``run.save("x.zarr")``: a stored run without a checkpoint.

The solver memory at its end is not known, so that it cannot be resumed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._version import __version__
from ..core.arrays import Array
from ..core.errors import InputError
from ..core.event import Event, impacts_as_json, refuse_unusable_names
from ..core.exact_numbers import digits_of
from ..runtime.bindings.real_numbers import as_bytes
from ..runtime.results.state_columns import states_of
from ..runtime.results.trajectory import Trajectory
from .array_layout import (
    StoredField,
    array_of,
    consolidate,
    create,
    fields_of,
    fields_of_events,
    open_group,
    wide_name,
)
from .chunk_writer import Chunk, write_chunks
from .durable_files import storage_errors
from .event_store import EventStore
from .identity import FORMAT, versions
from .staging import created_atomically
from .validation import COMPLETE

if TYPE_CHECKING:
    import zarr

__all__ = ["save_store"]


def save_store(run: Trajectory, path: Path) -> Path:
    """Write a run as a store, which appears complete or not at all; return its path.

    Raises InputError where there is a file or a folder already; StorageError if it cannot be
    written.
    """
    if path.exists():
        raise InputError(f"{str(path)!r} is there already; remove it, or choose another store.")
    if not len(run):
        raise InputError("The run has no state to store; ask for one in t_eval at least.")
    refuse_unusable_names([Event(name, name=name) for name in run.events], "arrays of a store")
    fields, arrays = fields_of(run.manifest), states_of(run)
    cure = "Nothing is saved: free some space, or choose another place."
    with storage_errors(path, cure), created_atomically(path) as fresh:
        # a byte in place of the checkpoint, which a run in memory does not have
        create(fresh, fields, len(run), checkpoint_bytes=1, attributes=_attributes(run),
               events=fields_of_events(run.manifest, _event_attributes(run)))
        group = open_group(fresh, write=True)
        _write_fields(group, fields, arrays, len(run))
        events = EventStore(group, run.manifest, _event_attributes(run))
        resized = events.resize({name: len(x) for name, x in run.events.items()})
        write_chunks(events.chunks(dict.fromkeys(run.events, 0), run.events | run.impacts))
        consolidate(fresh, resized)
    return path


def _write_fields(
    group: zarr.Group, fields: Sequence[StoredField], arrays: Mapping[str, Array], count: int
) -> None:
    """Write ``count`` states block by block; numbers wider than a double also as their bytes."""
    block = array_of(group, "time").chunks[0]
    for field in fields:
        array = arrays[field.name]
        stored_arrays = {field.name: array.astype(field.dtype)}
        if field.wide:
            stored_arrays[wide_name(field.name)] = as_bytes(array)
        for name, stored_array in stored_arrays.items():
            inner_position = (0,) * (stored_array.ndim - 1)
            write_chunks([
                Chunk(array_of(group, name), (i, *inner_position),
                      stored_array[begin : begin + block])
                for i, begin in enumerate(range(0, count, block))])


def _attributes(run: Trajectory) -> dict[str, Any]:
    """Return the attributes of the store of a run that was in memory."""
    about = Trajectory._attributes(run)  # a ``Recording`` itself returns those of its store
    return {
        **about, "status": COMPLETE, "states": len(run), "steps_done": run.report.steps,
        "versions": versions(),
        "events": {name: len(crossings) for name, crossings in run.events.items()},
        "run": {**about["run"], "format": FORMAT, "gyrospark": __version__,
                "stepper": run.manifest.name, "t0": digits_of(run.t[0]), "rows": len(run),
                **({"events": _event_attributes(run)} if run.events else {})},
    }


def _event_attributes(run: Trajectory) -> dict[str, dict[str, Any]]:
    """Return the events of a run as JSON, name → attributes; impacts have a restitution, None where
    their laws are not known."""
    laws = impacts_as_json(run._laws, run.parameters)
    return {name: laws.get(name, {"restitution": None}) if name in run.impacts else {}
            for name in run.events}
