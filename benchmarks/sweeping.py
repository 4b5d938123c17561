"""What a sweep costs beside the bare kernel, and how that grows.

The fast top over γ × Δt, in three ways, in turn:

    kernel      ``integrate_many`` on threads, arrays ready beforehand, nothing kept but the ends
    memory      ``gyrospark.sweep`` without a store
    store       the same into a Zarr store in a temporary folder; in the part "dask" by the worker
                processes of a cluster on this machine

A share is the kernel's time over that of a way, of the same round, medians: what is left of the
kernel's throughput.
"""

from __future__ import annotations

import math
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gyrospark.core.errors import GyrosparkError
from gyrospark.runtime.rigid_body.problems import fast_top
from gyrospark.sweeps.plan import plan
from gyrospark.sweeps.run_sweep import run_study
from gyrospark.sweeps.study import Study
from gyrospark.sweeps.tiles import Tile, cells_of

from .peers.optional import Unavailable, need

__all__ = ["CASES", "QUICK", "SCHEMES", "WAYS", "SweepCase", "SweepRow", "compare_sweeps",
           "kernel_job"]

Job = Callable[[], object]

WAYS = ("kernel", "memory", "store")
SCHEMES = ("G-L 2", "G-L 4")
#: Parts of a kernel's work for each thread: so many that both end at the same time.
_PARTS, _LEAST = 16, 64


@dataclass(frozen=True)
class SweepCase:
    """A sweep of ``side`` × ``side`` cells."""

    part: str
    side: int
    steps: int
    every: int | None = None
    workers: int = 2


CASES = (
    *(SweepCase("steps", side, steps) for side, steps in (
        (316, 10), (100, 100), (32, 1000), (10, 10000))),
    *(SweepCase("cells", side, 100) for side in (8, 32, 316)),
    *(SweepCase("samples", 32, 1000, every) for every in (1000, 100, 10, 1)),
    *(SweepCase("threads", 64, 1000, None, workers) for workers in (1, 2)),
    *(SweepCase("dask", 64, 1000, None, workers) for workers in (1, 2, 4)),
)
QUICK = (SweepCase("steps", 32, 10), SweepCase("cells", 8, 100), SweepCase("samples", 8, 100, 10),
         SweepCase("threads", 16, 100, None, 1))


@dataclass(frozen=True)
class SweepRow:
    """A sweep, its three ways side by side.

    Attributes
    ----------
    part
        What grows: steps, cells, samples, threads, or processes of a cluster (dask).
    every
        Steps between stored states; None keeps the ends alone.
    wall, cpu
        Seconds of each round for each way; CPU time is that of all threads and processes.
    bytes_per_cell, files
        Of the store, with all that describes it.
    """

    part: str
    scheme: str
    cells: int
    steps: int
    every: int | None
    workers: int
    wall: dict[str, tuple[float, ...]] = field(default_factory=dict)
    cpu: dict[str, tuple[float, ...]] = field(default_factory=dict)
    bytes_per_cell: float | None = None
    files: int | None = None
    note: str = ""
    failed: bool = False

    @property
    def work(self) -> int:
        """Steps of all cells."""
        return self.cells * self.steps

    def ns(self, way: str) -> float | None:
        """Wall nanoseconds a step of a cell."""
        return statistics.median(self.wall[way]) / self.work * 1e9 if way in self.wall else None

    def cpu_ns(self, way: str) -> float | None:
        """CPU nanoseconds a step of a cell."""
        return statistics.median(self.cpu[way]) / self.work * 1e9 if way in self.cpu else None

    def share(self, way: str) -> float | None:
        """Part of the kernel's throughput, by wall time."""
        return _share(self.wall, way)

    def cpu_share(self, way: str) -> float | None:
        """The same by CPU time: what other programs do on the machine is not in it."""
        return _share(self.cpu, way)

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON holds of it."""
        found = asdict(self)
        for name in ("ns", "cpu_ns", "share", "cpu_share"):
            found[name] = {way: getattr(self, name)(way) for way in self.wall}
        return found


def _share(seconds: Mapping[str, Sequence[float]], way: str) -> float | None:
    if way not in seconds or "kernel" not in seconds:
        return None
    return statistics.median(
        kernel / other for kernel, other in zip(seconds["kernel"], seconds[way], strict=True))


def compare_sweeps(
    cases: Sequence[SweepCase], schemes: Sequence[str], rounds: int,
    watch: Callable[[str], None] = lambda name: None,
) -> list[SweepRow]:
    """Return a row for each case and scheme; the ways of a row take turns."""
    found = []
    for scheme in schemes:
        for case in cases:
            watch(f"{scheme}: {case.side}² cells of {case.steps} steps ({case.part})")
            study = study_of(case, scheme)
            row = SweepRow(case.part, scheme, study.size, case.steps, case.every, case.workers)
            try:
                found.append(_measured(row, study, rounds))
            except Unavailable as reason:
                found.append(replace(row, note=f"distributed: {reason}"))
            except GyrosparkError as error:
                found.append(replace(row, note=str(error), failed=True))
    return found


def study_of(case: SweepCase, scheme: str) -> Study:
    """Return the sweep of a case: steps that converge for every γ."""
    over = {"gamma": {"from": 4e-4, "to": 4e-3, "count": case.side, "spacing": "log"},
            "dt": {"from": 1e-4, "to": 2e-3, "count": case.side, "spacing": "log"}}
    return plan(fast_top(), over, scheme=scheme, steps=case.steps, every=case.every)


# ---------------------------------------------------------------- measuring


def _measured(row: SweepRow, study: Study, rounds: int) -> SweepRow:
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "sweep.zarr"
        with _client(row) as client:
            jobs: dict[str, Job] = {
                "kernel": kernel_job(study, row.workers),
                "memory": partial(run_study, study, workers=row.workers),
                "store": partial(run_study, study, workers=row.workers, out=store, dask=client),
            }
            if client is not None:
                del jobs["memory"]
            jobs["store"]()  # imports, caches of the workers
            files = [path.stat().st_size for path in store.rglob("*") if path.is_file()]
            shutil.rmtree(store)
            wall, cpu = _in_turn(jobs, rounds, partial(_cpu, client), store)
    return replace(row, wall=wall, cpu=cpu, bytes_per_cell=sum(files) / row.cells,
                   files=len(files))


@contextmanager
def _client(row: SweepRow) -> Iterator[Any]:
    """Yield a client of worker processes on this machine for a row of the part "dask"."""
    if row.part != "dask":
        yield None
        return
    distributed = need("distributed")
    with distributed.LocalCluster(
            n_workers=row.workers, threads_per_worker=1, dashboard_address=":0",
            silence_logs=50) as cluster, distributed.Client(cluster) as client:
        yield client


def _cpu(client: Any) -> float:
    """Return the CPU seconds of this process and of the workers."""
    there = 0.0 if client is None else sum(client.run(time.process_time).values())
    return time.process_time() + there


def _in_turn(
    jobs: Mapping[str, Job], rounds: int, cpu_clock: Callable[[], float], store: Path
) -> tuple[dict[str, tuple[float, ...]], dict[str, tuple[float, ...]]]:
    """Run all jobs once a round, forwards and backwards by turns; return wall and CPU seconds."""
    wall: dict[str, list[float]] = {name: [] for name in jobs}
    cpu: dict[str, list[float]] = {name: [] for name in jobs}
    for number in range(rounds):
        for name in list(jobs)[:: 1 if number % 2 == 0 else -1]:
            busy, began = cpu_clock(), time.perf_counter()
            jobs[name]()
            wall[name].append(time.perf_counter() - began)
            cpu[name].append(cpu_clock() - busy)
            shutil.rmtree(store, ignore_errors=True)
    return tuple({name: tuple(seconds) for name, seconds in found.items()}
                 for found in (wall, cpu))  # type: ignore[return-value]


def kernel_job(study: Study, threads: int) -> Callable[[], tuple[NDArray[Any], NDArray[Any]]]:
    """Return the compiled work of a sweep and nothing else; it returns q and p at the ends.

    Cells are sorted by time step, so that lanes have equally many iterations, and cut into parts
    that the threads take as they come.
    """
    whole = Tile((0,) * len(study.axes), tuple(slice(0, length) for length in study.shape))
    cells, binding = cells_of(study, whole), study.steppers[0].binding_of_many
    order = np.argsort(cells.dt, kind="stable")
    dt, q, p, structs = (
        np.ascontiguousarray(x[order], dtype=binding.dtype) for x in (
            cells.dt, cells.q, cells.p,
            np.column_stack([cells.parameters[name] for name in binding.parameter_names])))
    size = max(_LEAST, math.ceil(len(dt) / (_PARTS * threads)))
    parts = [slice(i, i + size) for i in range(0, len(dt), size)]
    options = binding.options(study.tolerance, study.max_iterations, study.solver)
    memories = [binding.many_memory() for _ in range(threads)]
    steps, every = study.most_steps, study.every or study.most_steps

    def job() -> tuple[NDArray[Any], NDArray[Any]]:
        ends, left = (q.copy(), p.copy()), iter(parts)

        def work(memory: tuple[Any, ...]) -> None:
            for part in left:
                at, ends_q, ends_p = dt[part], ends[0][part], ends[1][part]
                out = None if study.every is None else tuple(
                    binding.new(len(at), steps // every, binding.n) for _ in "qp")
                binding.integrate_many(structs[part], options, at, steps, every, ends_q, ends_p,
                                       out, memory)

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(work, memories))
        back = np.argsort(order)
        return ends[0][back], ends[1][back]

    return job
