"""Memory of a run, and of an export, does not grow with what is stored."""

from __future__ import annotations

import functools
import gc
import tracemalloc

import pytest

import systems
from stores import START, record, small_blocks


def traced_peak(call):
    """Return the largest memory of Python and NumPy while a function is called, in bytes."""
    gc.collect()  # what earlier tests left behind
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("end", [
    "", *(pytest.param(end, marks=pytest.mark.slow) for end in (".csv", ".nc"))])
def test_memory_is_that_of_blocks(end, tmp_path, monkeypatch):
    """Four times as many rows take no more: 1,536 more of 224 bytes would be 344 kB.

    What waits for the collection of cycles, of JSON's encoder and of asyncio, is some 100 kB.
    """
    small_blocks(monkeypatch, 256, seconds=1e9)
    step, peaks = systems.stepper("heavy_top", "EMS"), []
    for rows in (256, 512, 2048):  # the first run imports and caches
        def stored(rows=rows):
            return record(step, **START, steps=rows, out=tmp_path / f"{rows}.zarr", resume=True)

        run = stored() if end else None
        write = functools.partial(run.save, tmp_path / f"{rows}{end}") if end else stored
        peaks.append(traced_peak(write) if rows > 256 else write())
    assert peaks[2] - peaks[1] < 250_000
