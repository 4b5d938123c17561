"""Tiles on a Dask cluster: workers compute and write regions of one store that all can reach."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from ..core.errors import GyrosparkError, InputError, MissingDependencyError
from ..core.extras import install
from ..core.interrupts import Interrupts
from ..storage.array_layout import StoredField
from .compute_tile import compute
from .results import Sink, StoreSink
from .study import Study
from .tiles import Tile

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["connect", "run_tiles"]

#: How often a tile that ends with an error is tried again: a full disk, a file server away.
_RETRIES = 5
#: Tiles at the scheduler for each thread of the workers.
_TILES_A_THREAD = 4
#: Seconds that a scheduler may take to answer.
_CONNECT_SECONDS = 10
#: Seconds between two looks at the cluster, and how long it may be without workers.
_CHECK_SECONDS, _PATIENCE = 1.0, 600


@contextmanager
def connect(where: Any) -> Iterator[Client | None]:
    """Yield a Dask client: the one given, or one for a scheduler's address, closed at the end.

    None yields None. Raises MissingDependencyError without dask.distributed; InputError if no
    scheduler answers at the address.
    """
    if where is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise MissingDependencyError(f"A cluster needs dask.distributed; {install('cluster')} "
                                     "brings it.") from error
    if isinstance(where, Client):
        yield where
        return
    try:
        # a scheduler that is not there is reported within seconds; a default client would compute
        # what else this process asks Dask for
        client = Client(where, timeout=_CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"No Dask scheduler answers at {where!r}: {error or 'no connection'}. "
                         "Start one with `dask scheduler`, and write its address, "
                         "tcp://HOST:8786.") from error
    try:
        yield client
    finally:
        client.close()


def run_tiles(
    study: Study, fields: list[StoredField], tiles: Iterator[Tile], sink: Sink, client: Client,
    interrupts: Interrupts, advance: Callable[[Tile], None],
) -> None:
    """Compute tiles on the workers of a cluster.

    Workers write the tiles of a store. If a worker dies, another one computes its tiles again and
    writes the same bytes. If workers keep dying, the scheduler blames all tiles that they had;
    these are computed last, one at a time, and a tile that kills its workers then too is abandoned.
    Raises GyrosparkError if tiles are abandoned because workers died at them repeatedly, or the
    cluster has lost its workers for good.
    """
    _ClusterRun(study, fields, tiles, sink, client, interrupts, advance).run()


class _ClusterRun:
    """The tiles of one sweep on a cluster: submitted, blamed for dead workers, abandoned."""

    def __init__(
        self, study: Study, fields: list[StoredField], tiles: Iterator[Tile], sink: Sink,
        client: Client, interrupts: Interrupts, advance: Callable[[Tile], None],
    ) -> None:
        """Begin with no tile submitted; workers write into a store themselves, else the sink does.
        """
        self.study, self.fields, self.tiles, self.sink = study, fields, tiles, sink
        self.client, self.interrupts, self.advance = client, interrupts, advance
        self.remote_sink = sink if isinstance(sink, StoreSink) else None
        #: Futures that have ended; key of a future → it and its tile, until its end is handled.
        self.ended: SimpleQueue[Any] = SimpleQueue()
        self.submitted: dict[str, tuple[Any, Tile]] = {}
        #: Tiles whose workers died, to be tried alone; tiles at which they died again; the places
        #: of the tiles tried alone.
        self.blamed: list[Tile] = []
        self.abandoned: list[Tile] = []
        self.retried_alone: set[tuple[int, ...]] = set()
        self.capacity = _ClusterCapacity(client)
        self.shared = self._share()

    def run(self) -> None:
        """Submit tiles and handle the ends of their futures until none is left."""
        self._fill()
        while self.submitted:
            try:
                # a signal, or workers that are gone, must be noticed without an end of a tile
                future = self.ended.get(timeout=_CHECK_SECONDS)
            except Empty:
                self._withdraw()
                self.capacity.measure(len(self.submitted))
                continue
            self._handle(future)
            self._withdraw()
            self._fill()
        if self.abandoned:
            raise GyrosparkError(
                f"Tiles of the sweep that are not computed: {len(self.abandoned)}. Workers died "
                "again and again at them; give the workers more memory, and repeat the sweep with "
                "--resume.")

    def _share(self) -> Any:
        """Submit the study once for all tiles; return its future."""
        # A task, not scattered data: the scheduler repeats it when its workers have died.
        return self.client.submit(_study_fields_sink, self.study, self.fields, self.remote_sink,
                                  pure=False)

    def _submit(self, tile: Tile) -> None:
        """Submit a tile; its future comes into ``ended`` when it is done."""
        future = self.client.submit(_compute, self.shared, tile, pure=False, retries=_RETRIES)
        self.submitted[future.key] = future, tile
        future.add_done_callback(self.ended.put)

    def _fill(self) -> None:
        """Submit new tiles up to the capacity, and the blamed ones alone at the end."""
        while len(self.submitted) < self.capacity.tiles and not self.interrupts.is_requested:
            tile = next(self.tiles, None)
            if tile is None:
                break
            self._submit(tile)
        if not self.submitted and self.blamed and not self.interrupts.is_requested:
            self.retried_alone.add(self.blamed[-1].place)
            self._submit(self.blamed.pop())

    def _withdraw(self) -> None:
        """After a signal, cancel the tiles that no worker has begun."""
        if self.interrupts.is_requested:
            self.client.cancel([future for future, _ in self.submitted.values()
                                if future.status == "pending"])

    def _handle(self, future: Any) -> None:
        """Handle the end of a tile's future: finished, cancelled, or its workers died."""
        from distributed.scheduler import KilledWorker

        _, tile = self.submitted.pop(future.key)
        if future.status == "finished":
            if self.remote_sink is None:
                self.sink.write(tile, future.result())
            self.advance(tile)
        elif future.status == "cancelled":
            if not self.interrupts.is_requested:
                self._submit(tile)
        elif isinstance(future.exception(), KilledWorker):
            # once more alone, at the end: another tile on the worker may have used up its memory
            (self.abandoned if tile.place in self.retried_alone else self.blamed).append(tile)
            self.shared = self._share()  # it may have been blamed as well
        else:
            raise future.exception()


class _ClusterCapacity:
    """The number of tiles that a cluster takes at a time; its workers are counted every second."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._last_worker_time: float | None = None
        self._count()

    @property
    def tiles(self) -> int:
        """Number of tiles to submit: some wait at the scheduler, so that no worker idles."""
        if time.monotonic() > self._counted + _CHECK_SECONDS:
            self._count()
        return _TILES_A_THREAD * max(1, self.threads)

    def _count(self) -> None:
        """Count the threads of all workers, and note when there was one last."""
        self._counted = time.monotonic()
        self.threads = int(sum(self._client.nthreads().values()))
        if self.threads:
            self._last_worker_time = self._counted

    def measure(self, submitted_count: int) -> None:
        """Count workers; fail if the cluster has had none for a long time.

        Raises GyrosparkError if the workers have gone and none has come for a long time.
        """
        self._count()
        last_seen = self._last_worker_time
        if last_seen is not None and self._counted > last_seen + _PATIENCE:
            raise GyrosparkError(
                f"The cluster has had no worker for {_PATIENCE} s; {submitted_count} tiles were "
                "begun. Start workers, and repeat the sweep with --resume.")


def _study_fields_sink(
    study: Study, fields: list[StoredField], sink: Sink | None,
) -> tuple[Any, ...]:
    """Return study, fields and sink as the result of a task, from which ``_compute`` takes them."""
    return study, fields, sink


def _compute(study_fields_sink: tuple[Any, ...], tile: Tile) -> Any:
    """Compute a tile on a worker; return its arrays if there is no store."""
    study, fields, sink = study_fields_sink
    arrays = compute(study, fields, tile)
    if sink is None:
        return arrays
    sink.write(tile, arrays)
    return None
