"""Chunks are filled up, rounded and packed, and written at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st

from gyrospark.storage.array_layout import create_array
from gyrospark.storage.chunk_writer import Chunk, write_chunks
from interruption import differences


def new_array(path: Path, shape, chunks, dtype, fill):
    group = zarr.create_group(path)
    return create_array(group, "a", shape, chunks, dtype, fill, list("xyz"[: len(shape)]), {})


@settings(max_examples=20)
@given(st.data())
def test_files_are_those_of_an_assignment(tmp_path_factory, data):
    """The files equal files of an assignment, for full chunks and for short ones at either end."""
    folder = tmp_path_factory.mktemp("chunks")
    dtype, fill = data.draw(st.sampled_from(
        [("f8", np.nan), ("f4", np.nan), ("f8", 0.0), ("i8", 0), ("i4", 7), ("i1", -1),
         ("u1", 255)]))
    shape = tuple(data.draw(st.lists(st.integers(1, 9), min_size=1, max_size=3)))
    chunks = tuple(data.draw(st.integers(1, length)) for length in shape)
    position = tuple(data.draw(st.integers(0, (length - 1) // size))
                     for length, size in zip(shape, chunks, strict=True))
    corner = [i * size for i, size in zip(position, chunks, strict=True)]
    inside = [min(size, length - start) for size, length, start in
              zip(chunks, shape, corner, strict=True)]
    size = tuple(data.draw(st.integers(1, length)) for length in inside)
    values = np.random.default_rng(len(shape)).integers(0, 100, size).astype(dtype)
    ours, its = (new_array(folder / name, shape, chunks, dtype, fill) for name in ("ours", "its"))
    write_chunks([Chunk(ours, position, values)])
    its = its.with_config({"write_empty_chunks": True})
    its[tuple(slice(i, i + n) for i, n in zip(corner, size, strict=True))] = values
    assert differences(folder / "ours", folder / "its") == []


def test_wider_and_strided_numbers_are_rounded_and_packed(tmp_path):
    array = new_array(tmp_path, (8, 2), (4, 2), "f8", np.nan)
    wide = np.arange(16, dtype=np.longdouble).reshape(4, 4)[:, ::2] / 3
    write_chunks([Chunk(array, (1, 0), wide)])
    assert np.array_equal(array[4:], wide.astype(float))
    assert np.isnan(array[:4]).all()
