"""Tiles on a Dask cluster: workers compute and write regions of one store that all can reach."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from ..errors import GyrosparkError, InputError, MissingDependencyError
from ..storage.interrupts import Interrupts
from ..storage.layout import Field
from .compute import compute
from .results import Sink, Store
from .study import Study
from .tiles import Tile

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["client_of", "run_tiles"]

#: How often a tile is given to a worker before the sweep does without it.
_ATTEMPTS = 5


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
            "A cluster needs dask.distributed; `pip install gyrospark[cluster]` brings it."
        ) from error
    if isinstance(where, Client):
        return where
    try:
        return Client(where, timeout=10)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"No Dask scheduler answers at {where!r}: {error or 'no connection'}. "
                         "Start one with `dask scheduler`, and write its address, "
                         "tcp://HOST:8786.") from error


def run_tiles(
    study: Study, fields: list[Field], tiles: Iterator[Tile], sink: Sink, client: Client,
    interrupts: Interrupts, advance: Callable[[Tile], None],
) -> None:
    """Compute tiles on the workers of a cluster.

    A store's tiles are written by the workers. A worker that dies loses what it was at: another
    one does it again, and writes the same bytes.

    Raises
    ------
    GyrosparkError
        If tiles are left because workers died again and again at them.
    """
    from distributed import as_completed
    from distributed.scheduler import KilledWorker

    remote = sink if isinstance(sink, Store) else None
    # A task, not scattered data: the scheduler makes it again when its workers have died.
    shared = client.submit(_shared, study, fields, remote, pure=False)
    flow = as_completed([], raise_errors=False)
    begun: dict[str, tuple[Any, Tile, int]] = {}
    left: list[Tile] = []

    def begin(tile: Tile, attempt: int) -> None:
        future = client.submit(_compute, shared, tile, pure=False, retries=_ATTEMPTS)
        begun[future.key] = future, tile, attempt
        flow.add(future)

    def fill() -> None:
        most = 4 * max(1, sum(client.nthreads().values()))
        while len(begun) < most and not interrupts.asked:
            tile = next(tiles, None)
            if tile is None:
                return
            begin(tile, 1)

    fill()
    while begun:
        future = next(flow)
        _, tile, attempt = begun.pop(future.key)
        if future.status == "finished":
            if remote is None:
                sink.write(tile, future.result())
            advance(tile)
        elif future.status == "cancelled":
            if not interrupts.asked:
                begin(tile, attempt)
        elif isinstance(future.exception(), KilledWorker):
            if attempt < _ATTEMPTS:
                begin(tile, attempt + 1)
            else:
                left.append(tile)
        else:
            raise future.exception()
        if interrupts.asked:
            client.cancel([future for future, _, _ in begun.values()
                           if future.status == "pending"])
        fill()
    if left:
        raise GyrosparkError(
            f"{len(left)} tiles of the sweep are not computed: workers died at them {_ATTEMPTS} "
            "times. Give the workers more memory, and repeat the sweep with --resume."
        )


def _shared(study: Study, fields: list[Field], sink: Sink | None) -> tuple[Any, ...]:
    return study, fields, sink


def _compute(shared: tuple[Any, ...], tile: Tile) -> Any:
    """Compute a tile on a worker; return its arrays where nobody else keeps them."""
    study, fields, sink = shared
    arrays = compute(study, fields, tile)
    if sink is None:
        return arrays
    sink.write(tile, arrays)
    return None
