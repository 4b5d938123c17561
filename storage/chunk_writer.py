"""Chunks of a store's arrays, written by Zarr concurrently."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
import zarr
from numpy.typing import NDArray

__all__ = ["Chunk", "write_chunks"]

#: Number of files written at once; more threads do not help.
_AT_ONCE = 4


class Chunk(NamedTuple):
    """A chunk to write: its position among the chunks of the array, and its values.

    With fewer values than the chunk holds, the rest gets the fill value.
    """

    array: zarr.Array[Any]
    position: tuple[int, ...]
    values: NDArray[Any]


def write_chunks(chunks: Sequence[Chunk]) -> None:
    """Write chunks of a store, and flush them to the disk.

    They are written concurrently: each waits for the disk, which takes them together. Raises
    OSError if one cannot be written; the others are.
    """
    with ThreadPoolExecutor(_AT_ONCE, "gyrospark-files") as pool:
        writes = [pool.submit(_write, chunk) for chunk in chunks]
    for write in writes:
        write.result()


def _write(chunk: Chunk) -> None:
    """Write a whole chunk: Zarr reads no earlier numbers, even if all are fill values."""
    array = chunk.array.with_config({"write_empty_chunks": True})
    begin = np.multiply(chunk.position, array.chunks)
    end = np.minimum(begin + array.chunks, array.shape)
    numbers = chunk.values
    if numbers.shape != tuple(end - begin):
        numbers = np.full(end - begin, array.fill_value, dtype=array.dtype)
        numbers[tuple(map(slice, chunk.values.shape))] = chunk.values
    array[tuple(map(slice, begin, end))] = numbers
