"""Tiles on a Dask cluster: workers compute and write regions of one store that all can reach."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
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

__all__ = ["client_of", "run_tiles"]

#: How often a tile that ends with an error is tried again: a full disk, a file server away.
_RETRIES = 5
#: Tiles at the scheduler for each thread of the workers.
_TILES_A_THREAD = 4
#: Seconds that a scheduler may take to answer.
_CONNECT_SECONDS = 10
#: Seconds between two looks at the cluster, and how long it may be without workers.
_CHECK_SECONDS, _PATIENCE = 1.0, 600


def client_of(where: Any) -> Client:
    """Return a Dask client: the one given, or one for a scheduler's address.

    Raises
    ------
    MissingDependencyError
        Without dask.distributed.
    InputError
        If no scheduler answers at the address.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise MissingDependencyError(
            f"A cluster needs dask.distributed; {install('cluster')} brings it."
        ) from error
    if isinstance(where, Client):
        return where
    try:
        return Client(where, timeout=_CONNECT_SECONDS)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"No Dask scheduler answers at {where!r}: {error or 'no connection'}. "
                         "Start one with `dask scheduler`, and write its address, "
                         "tcp://HOST:8786.") from error


def run_tiles(
    study: Study, fields: list[StoredField], tiles: Iterator[Tile], sink: Sink, client: Client,
    interrupts: Interrupts, advance: Callable[[Tile], None],
) -> None:
    """Compute tiles on the workers of a cluster.

    Workers write the tiles of a store. If a worker dies, another one computes its tiles again and
    writes the same bytes. If workers keep dying, the scheduler blames all tiles that they had;
    these are computed last, one at a time, and a tile that kills its workers then too is abandoned.

    Raises
    ------
    GyrosparkError
        If tiles are abandoned because workers died at them repeatedly, or the cluster has lost its
        workers for good.
    """
    from distributed.scheduler import KilledWorker

    remote = sink if isinstance(sink, StoreSink) else None
    finished_futures: SimpleQueue[Any] = SimpleQueue()
    submitted: dict[str, tuple[Any, Tile]] = {}
    blamed: list[Tile] = []
    abandoned: list[Tile] = []
    memory = _ClusterCapacity(client)

    def share() -> Any:
        # A task, not scattered data: the scheduler repeats it when its workers have died.
        return client.submit(_shared, study, fields, remote, pure=False)

    def begin(tile: Tile) -> None:
        future = client.submit(_compute, shared, tile, pure=False, retries=_RETRIES)
        submitted[future.key] = future, tile
        future.add_done_callback(finished_futures.put)

    def fill() -> None:
        while len(submitted) < memory.tiles and not interrupts.requested:
            tile = next(tiles, None)
            if tile is None:
                break
            begin(tile)
        if not submitted and blamed and not interrupts.requested:
            retried_alone.add(blamed[-1].place)
            begin(blamed.pop())

    def withdraw() -> None:
        if interrupts.requested:
            client.cancel([future for future, _ in submitted.values()
                           if future.status == "pending"])

    shared, retried_alone = share(), set[tuple[int, ...]]()
    fill()
    while submitted:
        try:
            future = finished_futures.get(timeout=_CHECK_SECONDS)
        except Empty:
            withdraw()
            memory.measure(len(submitted))
            continue
        _, tile = submitted.pop(future.key)
        if future.status == "finished":
            if remote is None:
                sink.write(tile, future.result())
            advance(tile)
        elif future.status == "cancelled":
            if not interrupts.requested:
                begin(tile)
        elif isinstance(future.exception(), KilledWorker):
            (abandoned if tile.place in retried_alone else blamed).append(tile)
            shared = share()  # it may have been blamed as well
        else:
            raise future.exception()
        withdraw()
        fill()
    if abandoned:
        raise GyrosparkError(
            f"Tiles of the sweep that are not computed: {len(abandoned)}. Workers died again and "
            "again at them; give the workers more memory, and repeat the sweep with --resume."
        )


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
        self._counted = time.monotonic()
        self.threads = int(sum(self._client.nthreads().values()))
        if self.threads:
            self._last_worker_time = self._counted

    def measure(self, submitted_count: int) -> None:
        """Check that workers exist to finish the submitted tiles.

        Raises
        ------
        GyrosparkError
            If the workers have gone and none has come for a long time.
        """
        self._count()
        last = self._last_worker_time
        if last is not None and self._counted > last + _PATIENCE:
            raise GyrosparkError(
                f"The cluster has had no worker for {_PATIENCE} s; {submitted_count} tiles were "
                "begun. Start workers, and repeat the sweep with --resume.")


def _shared(study: Study, fields: list[StoredField], sink: Sink | None) -> tuple[Any, ...]:
    return study, fields, sink


def _compute(shared: tuple[Any, ...], tile: Tile) -> Any:
    """Compute a tile on a worker; return its arrays if there is no store."""
    study, fields, sink = shared
    arrays = compute(study, fields, tile)
    if sink is None:
        return arrays
    sink.write(tile, arrays)
    return None
