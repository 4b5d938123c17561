"""Chunks of a store's arrays as files, whole and side by side.

A file holds what Zarr reads there: the numbers, little endian, and their CRC32C. Zarr's own way to
it suits any codec and any selection, and takes four times as long.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Literal, NamedTuple

import google_crc32c
import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import BytesCodec, Crc32cCodec

from ..core.errors import StorageError
from . import durable_files

__all__ = ["Chunk", "codecs_of", "write_chunks"]

Bytes = NDArray[np.uint8]

_CHECKSUM = 4
#: Number of files written at once; more threads do not help.
_AT_ONCE = 4


def codecs_of(dtype: Any) -> tuple[BytesCodec, Crc32cCodec]:
    """Return Zarr's codecs of these files.

    No compression: the last bits of a motion are noise, and a tenth is all it saves.
    """
    endian: Literal["little"] | None = "little" if np.dtype(dtype).itemsize > 1 else None
    return BytesCodec(endian=endian), Crc32cCodec()


class Chunk(NamedTuple):
    """Numbers to write: the chunk at ``place`` among those of the array.

    There may be fewer values than the chunk has room for; it is filled up.
    """

    array: zarr.Array[Any]
    place: tuple[int, ...]
    values: NDArray[Any]


def write_chunks(root: Path, chunks: Sequence[Chunk]) -> None:
    """Write chunks of the store ``root``; when this returns they are on the disk.

    At once: each waits for the disk, and the disk takes them together.

    Raises
    ------
    OSError
        If one cannot be written; the others are.
    """
    with ThreadPoolExecutor(_AT_ONCE, "gyrospark-files") as pool:
        writes = [pool.submit(_write, root, chunk) for chunk in chunks]
    for done in writes:
        done.result()


def _write(root: Path, chunk: Chunk) -> None:
    array = chunk.array
    if array.metadata.zarr_format != 3 or array.metadata.codecs != codecs_of(array.dtype):
        raise StorageError(f"The array {array.path!r} of {str(root)!r} is encoded in another way "
                           "than gyrospark does; choose another store.")
    path = root / array.path / array.metadata.encode_chunk_key(chunk.place)
    durable_files.write_durably(path, *_encoded(array, chunk.values))


def _encoded(array: zarr.Array[Any], values: NDArray[Any]) -> tuple[Bytes, bytes]:
    """Return the bytes of a chunk's numbers and their checksum.

    Numbers of a whole chunk are written from where they are; others are filled up.
    """
    kind = array.dtype.newbyteorder("<")
    numbers = np.ascontiguousarray(values, dtype=kind)
    if values.shape != array.chunks:
        numbers = np.full(array.chunks, array.fill_value, dtype=kind)
        numbers[tuple(map(slice, values.shape))] = values
    data = numbers.reshape(-1).view(np.uint8)
    checksum: int = google_crc32c.value(data)
    return data, checksum.to_bytes(_CHECKSUM, "little")
