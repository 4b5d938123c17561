"""Memory of a run, and of an export, does not grow with what is stored."""

from __future__ import annotations

import sys

import pytest

from processes import FAST_TOP, python

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")

PEAK = """
from gyrospark.storage import layout
if out:
    layout._MOST_ROWS = 2**14
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


def peak(rows, out, folder):
    """Return the largest resident memory of a process in kB."""
    return int(python(f"{FAST_TOP}\nrows, out = {rows}, {out!r}\n{PEAK}", cwd=folder))


def test_recording(tmp_path):
    """A long run takes no more than some blocks of 32 MB, which the short one has in flight too."""
    (tmp_path / "short").mkdir()
    (tmp_path / "long").mkdir()
    short, long = peak(1_000_000, "", tmp_path / "short"), peak(2_000_000, "", tmp_path / "long")
    assert long - short < 40_000  # all of them have 112 MB more


@pytest.mark.parametrize("end", [".csv", ".nc"])
def test_export(end, tmp_path):
    """120,000 states have 16 MB, as Python's numbers 60; a few blocks of 2 are in memory."""
    assert peak(120_000, end, tmp_path) < 45_000
