"""Cost of storing a run: the same steps in memory and streamed to a Zarr store, in turn.

The fast top, every k-th state stored. Two limits of the same disk are measured too: plain bytes
with fsync, and files of the size of a commit with fsync each.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import gyrospark as gs

from .rows import Choice, Entry, Prepared, Row, contest

__all__ = ["store"]

#: Interval of the stored states, and steps.
CASES = ((1, 2_000_000), (10, 5_000_000), (100, 10_000_000), (1000, 10_000_000))
QUICK = ((1, 20_000), (100, 100_000))
#: Bytes with which the disk is measured, and bytes of a file of a commit.
_PLAIN, _FILE = 2**28, 2**21


def store(choice: Choice) -> list[Row]:
    """Return a row for each (every, steps)."""
    with tempfile.TemporaryDirectory(prefix="gyrospark-store-") as folder:
        choice.watch("the disk")
        disk = {"disk (MB/s)": _rate(Path(folder), _PLAIN, 1),
                "of files (MB/s)": _rate(Path(folder), _FILE, _PLAIN // _FILE // 4)}
        return [row for every, steps in (QUICK if choice.quick else CASES) for row in contest(
            f"{steps:,} steps", [Entry("gyrospark", f"every {every:,}", partial(
                _stored, every, steps, Path(folder), disk))], choice)]


def _stored(every: int, steps: int, folder: Path, disk: dict[str, float]) -> Prepared:
    step, top = gs.stepper("G-L", 3), gs.problems.fast_top()
    run: dict[str, Any] = {"dt": 1e-3, "steps": steps, "every": every,
                           "parameters": top.parameters}
    path = folder / "run.zarr"

    def memory() -> None:
        step.integrate(top.q0, top.p0, **run)

    def stored() -> None:
        shutil.rmtree(path, ignore_errors=True)
        step.integrate(top.q0, top.p0, out=path, **run)

    stored()
    size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    return Prepared(
        {**disk, "B/state": size / (-(-steps // every) + 1)},
        {"store": stored, "memory": memory},
        lambda seconds: {
            "stored ns/step": seconds["store"].wall / steps * 1e9,
            "memory ns/step": seconds["memory"].wall / steps * 1e9,
            "added": seconds["store"].wall / seconds["memory"].wall - 1,
            "CPU added": seconds["store"].median / seconds["memory"].median - 1,
            "MB/s": size / seconds["store"].wall / 1e6})


def _rate(folder: Path, size: int, count: int) -> float:
    """Return the megabytes a second of files, each forced to the disk at its end."""
    data = os.urandom(min(size, 2**22))
    start = time.perf_counter()
    for i in range(count):
        with (folder / str(i)).open("wb") as file:
            for _ in range(size // len(data)):
                file.write(data)
            file.flush()
            os.fsync(file.fileno())
    seconds = time.perf_counter() - start
    for i in range(count):
        (folder / str(i)).unlink()
    return size * count / seconds / 1e6
