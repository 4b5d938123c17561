"""Tiles on the threads of this process: compiled code runs without Python's lock."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Any

from numpy.typing import NDArray

from ..core.interrupts import Interrupts
from ..storage.array_layout import Field
from .compute_tile import compute
from .results import Sink
from .study import Study
from .tiles import Tile

__all__ = ["run_tiles"]


def run_tiles(
    study: Study, fields: list[Field], tiles: Iterator[Tile], sink: Sink, workers: int,
    interrupts: Interrupts, advance: Callable[[Tile], None],
) -> None:
    """Compute tiles on ``workers`` threads and write them from this one as they come.

    No more than twice as many tiles are in memory. After a signal those that are begun are
    finished and written.
    """
    for stepper in study.steppers:
        _ = stepper.binding_of_many  # compiled once, before threads ask for it
    begun: dict[Future[dict[str, NDArray[Any]]], Tile] = {}
    pool = ThreadPoolExecutor(workers, thread_name_prefix="gyrospark-sweep")
    try:
        while True:
            while len(begun) < 2 * workers and not interrupts.requested:
                tile = next(tiles, None)
                if tile is None:
                    break
                begun[pool.submit(compute, study, fields, tile)] = tile
            if interrupts.requested:
                begun = {future: tile for future, tile in begun.items() if not future.cancel()}
            if not begun:
                return
            ended, _ = wait(begun, return_when=FIRST_COMPLETED)
            for future in ended:
                tile = begun.pop(future)
                sink.write(tile, future.result())
                advance(tile)
    finally:  # after an error nobody waits for tiles that are begun: they may take long
        pool.shutdown(wait=not begun, cancel_futures=True)
