"""Memory of a run, and of an export, does not grow with what is stored."""

from __future__ import annotations

import gc
import sys
import tracemalloc

import pytest

import gyrospark as gs
import systems
from processes import FAST_TOP, python
from stores import START, small_blocks

PEAK = """
step = gs.stepper("EMS")
def peak():
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmHWM"))
found = gs.record(step, top.q0, top.p0, dt=1e-3, steps=rows, parameters=parameters,
                  out="run.zarr", resume=True)
before = peak()
if out:
    found.export("run" + out)
print(peak() - (before if out else 0))
"""


def peak(rows, out, folder):
    """Return the largest resident memory of a process in kB."""
    folder.mkdir()
    return int(python(f"{FAST_TOP}\nrows, out = {rows}, {out!r}\n{PEAK}", cwd=folder))


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
    "", pytest.param(".csv", marks=pytest.mark.slow), pytest.param(".nc", marks=pytest.mark.slow)])
def test_memory_is_that_of_blocks(end, tmp_path, monkeypatch):
    """Three times as many rows take no more: 1,200 more of 224 bytes would be 270 kB."""
    small_blocks(monkeypatch, 128, seconds=1e9)
    step, peaks = systems.stepper("heavy_top", "EMS"), []
    for rows in (200, 600, 1800):  # the first run imports and caches
        def record(rows=rows):
            return gs.record(step, **START, steps=rows, out=tmp_path / f"{rows}.zarr", resume=True)

        run = record() if end else None
        peaks.append(traced_peak(
            lambda run=run, record=record, rows=rows:
            run.export(tmp_path / f"{rows}{end}") if end else record()))
    assert peaks[2] - peaks[1] < 120_000


@pytest.mark.slow  # a process of a million steps each
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("end", ["", ".csv", ".nc"])
def test_resident_memory_of_long_runs(end, tmp_path):
    """States are 0.224 kB a step, as Python's numbers 0.5; blocks are of 32 MB."""
    short, long = (peak(steps, end, tmp_path / f"{steps}") for steps in (1_000_000, 3_000_000))
    assert long - short < 100_000
