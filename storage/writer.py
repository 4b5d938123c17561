"""Writes states in a thread of its own while the next ones are computed."""

from __future__ import annotations

import queue
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
import zarr

from ..core.arrays import Array
from ..core.manifest import Manifest
from ..runtime.bindings.real_numbers import as_bytes
from ..runtime.bindings.run_memory import ParameterStruct, Rows
from ..runtime.integration.run_arguments import RunArguments
from ..runtime.results.crossings import Crossings
from ..runtime.results.outputs import OUTPUTS, States, arrays_in_files, names_in_files, value_of
from .array_layout import CHECKPOINT, StoredField, array_of, attributes_of, consolidate, wide_name
from .chunk_writer import Chunk, write_chunks
from .durable_files import storage_errors
from .event_store import EventStore

if TYPE_CHECKING:
    from ..runtime.bindings.binding import Binding

__all__ = ["CURE", "Batch", "Writer", "stored_arrays"]

CURE = ("What is stored up to the last commit is whole: free some space or mend the disk, and "
        "repeat the command with --resume.")


@dataclass(frozen=True)
class Batch:
    """A commit: rows ``first`` to ``first + count`` of the run, and its state then.

    ``first`` begins a block of rows, of which none may be done; ``attributes`` are those of the
    store that change. ``end`` is the time of the last row where an event ended the run there.
    ``crossings`` are new since the last commit, when there were ``counts`` of each event.
    ``reusable`` rows are no longer needed when they are written.
    """

    first: int
    count: int
    rows: Rows
    checkpoint: Array
    attributes: dict[str, Any]
    end: Array | None = None
    counts: Mapping[str, int] = field(default_factory=dict)
    crossings: Mapping[str, Crossings] = field(default_factory=dict)
    reusable: bool = False


class Writer:
    """Thread for writing batches in order; at most one waits.

    As a context manager: at its end all batches are on the disk. An error in the thread is raised
    by the next ``put``, and at the end.
    """

    def __init__(self, path: Path, group: zarr.Group, fields: list[StoredField], binding: Binding,
                 run: RunArguments, block: int) -> None:
        """Open the arrays of a store for blocks of rows, which a thread of its own writes."""
        self._path, self._fields = path, fields
        self._arrays = {name: array_of(group, name)
                        for name in (*attributes_of(group)["arrays"], CHECKPOINT)}
        self._binding, self._run, self._block = binding, run, block
        about = attributes_of(group)
        self._manifest = Manifest.from_json(about["manifest"])
        self._event_store = EventStore(group, self._manifest, about["run"].get("events", {}))
        # After a killed process the copies of their metadata in the root may be outdated.
        self._changed = self._event_store.names
        self._parameters = binding.parameters(run.parameters, run.t0)
        self._queue: queue.Queue[Batch | None] = queue.Queue(maxsize=1)
        #: Rows of whole blocks that are written, to be filled again.
        self.written: queue.SimpleQueue[Rows] = queue.SimpleQueue()
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name="gyrospark-writer", daemon=True)

    def __enter__(self) -> Writer:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._queue.put(None)  # the end of the queue
        self._thread.join()
        if error is None:
            self._raise()

    @property
    def busy(self) -> bool:
        """Whether a commit handed over now would have to wait."""
        return self._queue.full()

    def put(self, batch: Batch) -> None:
        """Hand over a commit; waits while another one is waiting."""
        self._raise()
        self._queue.put(batch)

    def _raise(self) -> None:
        """Raise the error of the thread, if it has failed."""
        if self._error is not None:
            raise self._error

    def _work(self) -> None:
        """Commit batches until the queue ends: the work of the thread.

        The first error is kept, for ``_raise`` to raise in the thread of the caller.
        """
        while (batch := self._queue.get()) is not None:
            if self._error is None:  # after an error only the queue is emptied
                try:
                    with storage_errors(self._path, CURE):
                        self._commit(batch)
                    if batch.reusable:
                        self.written.put(batch.rows)
                except BaseException as error:
                    self._error = error

    def _commit(self, batch: Batch) -> None:
        """Write rows, then checkpoint, then attributes: these never claim more than is stored."""
        states = self._chunks(batch) if batch.count else []
        self._changed |= self._event_store.resize({name: batch.counts[name] + len(crossings)
                                                   for name, crossings in batch.crossings.items()})
        write_chunks(states + self._event_store.chunks(batch.counts, batch.crossings))
        write_chunks([Chunk(self._arrays[CHECKPOINT], (0,), batch.checkpoint)])
        consolidate(self._path, self._changed, batch.attributes)  # in one go, and in one file
        self._changed = set()

    def _chunks(self, batch: Batch) -> list[Chunk]:
        """Return the rows of a batch as chunks of all arrays, one for each array."""
        block_index = batch.first // self._block
        arrays = stored_arrays(self._binding, self._manifest, self._run, self._parameters,
                               batch)
        arrays |= {wide_name(stored_field.name): as_bytes(arrays[stored_field.name])
                   for stored_field in self._fields if stored_field.wide}
        return [Chunk(self._arrays[name], (block_index, *(0 for _ in array.shape[1:])), array)
                for name, array in arrays.items() if name in self._arrays]


def stored_arrays(
    binding: Binding, manifest: Manifest, run: RunArguments, parameters: ParameterStruct,
    batch: Batch
) -> dict[str, Array]:
    """Return every array of a batch by the name of its field in the store.

    An output that is split, such as multipliers by constraint, has several fields.
    """
    block = slice(0, batch.count)
    batch_rows, row_numbers = batch.rows, np.arange(batch.first, batch.first + batch.count)
    # the last row may follow fewer than ``every`` steps
    t = binding.times(run.t0, run.dt, np.minimum(row_numbers * run.every, run.steps))
    if batch.end is not None:  # the run ended between two steps, at t_end or at a terminal event
        t[-1:] = batch.end
    states = States(
        binding, manifest, parameters, t, q=batch_rows.q[block], p=batch_rows.p[block],
        multipliers=batch_rows.multipliers[block], iterations=batch_rows.iterations[block],
        work=batch_rows.work[block])
    arrays: dict[str, Array] = {}
    for output in OUTPUTS:
        if names_in_files(output, manifest):
            arrays |= arrays_in_files(output, manifest, value_of(output, states))
    return arrays
