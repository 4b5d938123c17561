"""Memory of a run, and of an export, does not grow with what is stored."""

from __future__ import annotations

import sys

import pytest

from processes import FAST_TOP, python

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")

PEAK = """
from gyrospark.storage import array_layout
if block:
    array_layout._MOST_ROWS = block
step = gs.stepper("EMS")
def peak():
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmHWM"))
found = gs.record(step, top.q0, top.p0, dt=1e-3, steps=rows, parameters=parameters,
                  out="run.zarr", resume=True)
if out:
    gs.record(step, top.q0, top.p0, dt=1e-3, steps=10, parameters=parameters,
              out="small.zarr", resume=True).export("small" + out)
    before = peak()
    found.export("run" + out)
    print(peak() - before)
else:
    print(peak())
"""


def peak(rows, out, folder, block=2**14):
    """Return the largest resident memory of a process in kB."""
    return int(python(f"{FAST_TOP}\nrows, out, block = {rows}, {out!r}, {block}\n{PEAK}",
                      cwd=folder))


@pytest.mark.parametrize(("steps", "block"), [
    (100_000, 2**14), pytest.param(1_000_000, None, marks=pytest.mark.slow)])
def test_recording(steps, block, tmp_path):
    """A long run takes no more than some blocks, which the short one has in flight too."""
    (tmp_path / "short").mkdir()
    (tmp_path / "long").mkdir()
    short = peak(steps, "", tmp_path / "short", block)
    long = peak(3 * steps, "", tmp_path / "long", block)
    assert long - short < 0.1 * steps  # kB; all states more are 0.224 a step, blocks 2 MB or 32


@pytest.mark.parametrize("end", [".csv", ".nc"])
def test_export(end, tmp_path):
    """120,000 states have 16 MB, as Python's numbers 60; a few blocks of 2 are in memory."""
    assert peak(120_000, end, tmp_path) < 45_000
