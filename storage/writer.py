"""Writes states in a thread of its own while the next ones are computed."""

from __future__ import annotations

import queue
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
import zarr
from numpy.typing import NDArray

from ..runtime.integration import Rows, Run, defect_sizes
from .durable import storage_errors
from .layout import CHECKPOINT, QUANTITY, WIDE_FILL, Field, wide_name, writable_arrays
from .wide import as_bytes, as_doubles

if TYPE_CHECKING:
    from ..runtime.binding import Binding

__all__ = ["CURE", "Batch", "Writer", "stored_arrays"]

Array = NDArray[Any]

CURE = ("What is stored up to the last commit is whole: free some space or mend the disk, and "
        "repeat the command with --resume.")


@dataclass(frozen=True)
class Batch:
    """A commit: rows ``first`` to ``first + count`` of the run, and where the run stands then.

    ``first`` begins a block of rows, of which none may be done; ``attributes`` are those of the
    store that change.
    """

    first: int
    count: int
    rows: Rows
    checkpoint: Array
    attributes: dict[str, Any]


class Writer:
    """One thread that writes batches in their order; at most one waits.

    Use it as a context: at its end everything handed over is on the disk. What goes wrong in the
    thread is raised at the next ``put``, and at the end.
    """

    def __init__(self, path: Path, group: zarr.Group, fields: list[Field], binding: Binding,
                 run: Run, block: int) -> None:
        self._path, self._group, self._fields = path, group, fields
        self._arrays = writable_arrays(group)
        self._binding, self._run, self._block = binding, run, block
        # Of its own: solver "python" writes the time into the struct it steps with.
        self._parameters = binding.parameters(run.parameters, run.t0)
        self._queue: queue.Queue[Batch | None] = queue.Queue(maxsize=1)
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name="gyrospark-writer", daemon=True)

    def __enter__(self) -> Writer:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._queue.put(None)
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
        if self._error is not None:
            raise self._error

    def _work(self) -> None:
        while (batch := self._queue.get()) is not None:
            if self._error is None:  # after an error only the queue is emptied
                try:
                    with storage_errors(self._path, CURE):
                        self._commit(batch)
                except BaseException as error:
                    self._error = error

    def _commit(self, batch: Batch) -> None:
        """Write the rows, then the checkpoint, then what it says: never more than is there."""
        if batch.count:
            self._write_rows(batch)
        self._arrays[CHECKPOINT][:] = batch.checkpoint
        # In one go: ``attrs.update`` would write the file once an attribute.
        self._group.update_attributes(batch.attributes)

    def _write_rows(self, batch: Batch) -> None:
        """Write all arrays at once: each waits for the disk, and the disk takes them together."""
        block = slice(batch.first, batch.first + self._block)
        arrays = stored_arrays(self._binding, self._run, self._parameters, batch)
        parts: list[tuple[str, Array, float]] = []
        for one in self._fields:
            values = arrays[one.name]
            plain = values if one.name == "iterations" else as_doubles(values)
            parts.append((one.name, plain, one.fill))
            if one.wide:
                parts.append((wide_name(one.name), as_bytes(values), WIDE_FILL))
        with ThreadPoolExecutor(len(parts), "gyrospark-files") as pool:
            for done in [pool.submit(self._write, block, *part) for part in parts]:
                done.result()

    def _write(self, block: slice, name: str, values: Array, fill: float) -> None:
        """Write a block whole, filled up behind the last row: nothing needs to be read for that."""
        array = self._arrays[name]
        whole = np.full((self._block, *values.shape[1:]), fill, dtype=array.dtype)
        whole[: len(values)] = values
        end = min(block.stop, array.shape[0])
        array[block.start : end] = whole[: end - block.start]


def stored_arrays(binding: Binding, run: Run, parameters: Any, batch: Batch) -> dict[str, Array]:
    """Return every array of a batch by the field's name."""
    kept = slice(0, batch.count)
    rows, numbers = batch.rows, np.arange(batch.first, batch.first + batch.count)
    q, p = rows.q[kept], rows.p[kept]
    t = run.t0 + np.minimum(numbers * run.every, run.steps) * run.dt
    g_error, f_error = defect_sizes(binding, parameters, q, p)
    values = binding.quantities(parameters, t.astype(binding.dtype), q, p)
    multipliers = rows.multipliers[kept]
    if binding.m > 1:
        multipliers = multipliers.reshape(len(q), -1, binding.m)
    return {
        "time": t, "q": q, "p": p, "multipliers": multipliers, "iterations": rows.iterations[kept],
        "energy": binding.hamiltonian(parameters, q, p), "g_error": g_error, "f_error": f_error,
        "work": rows.work[kept],
        **{QUANTITY + name: values[:, i] for i, name in enumerate(binding.quantity_names)},
    }
