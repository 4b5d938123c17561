"""What it costs to store a run: the same steps in memory and streamed to a Zarr store, in turn.

The fast top, every k-th state kept. Beside it what the same disk takes of plain bytes that are
forced to it, and of forced files as large as a commit's: the two limits of storing every step.
"""

from __future__ import annotations

import os
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from gyrospark import gamma as gamma_of
from gyrospark.api import stepper
from gyrospark.runtime.rigid_body.problems import fast_top
from gyrospark.storage.durable_files import write_durably
from gyrospark.storage.record import record

__all__ = ["CASES", "QUICK", "StoreRow", "compare_stores"]

STAGES, DT = 3, 1e-3
#: Every so many states of so many steps.
CASES = ((1, 2_000_000), (10, 5_000_000), (100, 10_000_000), (1000, 10_000_000))
QUICK = ((1, 20_000), (100, 100_000))
#: Bytes with which the disk is measured, and those of a file of a commit.
_PLAIN, _FILE = 2**28, 2**21


@dataclass(frozen=True)
class StoreRow:
    """A run of ``steps`` steps, every ``every``-th state kept.

    Attributes
    ----------
    memory_wall, store_wall, memory_cpu, store_cpu
        Seconds of each round; CPU time is that of all threads.
    stored_bytes
        Of the store, with all that describes it.
    disk, disk_files
        Bytes a second that the disk takes of one forced file, and of files of two megabytes.
    """

    every: int
    steps: int
    memory_wall: tuple[float, ...]
    store_wall: tuple[float, ...]
    memory_cpu: tuple[float, ...]
    store_cpu: tuple[float, ...]
    stored_bytes: int
    disk: float
    disk_files: float
    failed: bool = False

    @property
    def overhead(self) -> float:
        """Wall time that storing adds, as a part of the run's; median over rounds."""
        return _added(self.memory_wall, self.store_wall)

    @property
    def cpu_overhead(self) -> float:
        """The same of CPU time, writing included: other programs on the machine are not in it."""
        return _added(self.memory_cpu, self.store_cpu)

    @property
    def rate(self) -> float:
        """Bytes a second that go to the store."""
        return self.stored_bytes / statistics.median(self.store_wall)

    @property
    def ns(self) -> tuple[float, float]:
        """Wall nanoseconds a step, in memory and stored."""
        return (statistics.median(self.memory_wall) / self.steps * 1e9,
                statistics.median(self.store_wall) / self.steps * 1e9)

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON holds of it."""
        return asdict(self) | {"overhead": self.overhead, "cpu_overhead": self.cpu_overhead,
                               "bytes_per_second": self.rate, "ns_per_step": self.ns}


def _added(without: Sequence[float], with_store: Sequence[float]) -> float:
    return statistics.median(b / a - 1 for a, b in zip(without, with_store, strict=True))


def compare_stores(
    cases: Sequence[tuple[int, int]], rounds: int, watch: Callable[[str], None] = lambda name: None,
    folder: Path | None = None,
) -> list[StoreRow]:
    """Return a row for each (every, steps); memory and store take turns in each round."""
    found = []
    with tempfile.TemporaryDirectory(prefix="gyrospark-store-", dir=folder) as name:
        watch("the disk")
        disk = _plain_rate(Path(name)), _file_rate(Path(name))
        for every, steps in cases:
            watch(f"{steps:,} steps, every {every}")
            found.append(_row(every, steps, rounds, Path(name) / "run.zarr", disk))
    return found


def _row(every: int, steps: int, rounds: int, path: Path, disk: tuple[float, float]) -> StoreRow:
    step, top = stepper("G-L", STAGES), fast_top()
    arguments: dict[str, Any] = {
        "dt": DT, "steps": steps, "every": every,
        "parameters": top.parameters | {"gamma": gamma_of(top.inertia)}}

    def memory() -> None:
        step.integrate(top.q0, top.p0, **arguments)

    def store() -> None:
        record(step, top.q0, top.p0, out=path, **arguments)

    step.integrate(top.q0, top.p0, **arguments | {"steps": 1000})
    times: dict[Any, list[tuple[float, float]]] = {memory: [], store: []}
    for number in range(rounds):
        for job in (memory, store) if number % 2 == 0 else (store, memory):
            if job is store:  # of the round before; no part of storing
                shutil.rmtree(path, ignore_errors=True)
            wall, cpu = time.perf_counter(), time.process_time()
            job()
            times[job].append((time.perf_counter() - wall, time.process_time() - cpu))
    walls, cpus = ([tuple(x[i] for x in times[job]) for job in (memory, store)] for i in (0, 1))
    size = sum(p.stat().st_size for p in path.rglob("*") if p.is_file())
    return StoreRow(every, steps, walls[0], walls[1], cpus[0], cpus[1], size, *disk)


def _plain_rate(folder: Path) -> float:
    """Return the bytes a second of one large file, forced to the disk at its end."""
    data = os.urandom(2**22)
    began = time.perf_counter()
    with (folder / "plain").open("wb") as file:
        for _ in range(_PLAIN // len(data)):
            file.write(data)
        file.flush()
        os.fsync(file.fileno())
    seconds = time.perf_counter() - began
    (folder / "plain").unlink()
    return _PLAIN / seconds


def _file_rate(folder: Path) -> float:
    """Return the bytes a second of files of a commit's size, each forced to the disk."""
    data = os.urandom(_FILE)
    began = time.perf_counter()
    for i in range(_PLAIN // _FILE // 4):
        write_durably(folder / "files" / str(i), data)
    seconds = time.perf_counter() - began
    shutil.rmtree(folder / "files")
    return _PLAIN / 4 / seconds
