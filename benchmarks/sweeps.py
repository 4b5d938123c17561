"""Cost of a sweep divided by the cost of an ensemble of the same cells, by number of cells.

The fast top over γ × Δt, in three ways, in turn:

    ensemble    ``integrate_ensemble`` of all cells, sorted by Δt so that lanes have equally many
                iterations; only the ends are stored
    memory      ``gs.sweep`` without a store
    store       the same into a Zarr store in a temporary folder; in the cases "dask" by the worker
                processes of a cluster on this machine

A share is the ensemble's wall time divided by the wall time of the sweep.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import gyrospark as gs

from .peers.optional import need
from .rows import Choice, Entry, Prepared, Row, contest

__all__ = ["ensemble_job", "sweep_arguments", "sweeps"]

#: The varied quantity, cells along a side, steps, interval of the stored states, workers.
CASES: tuple[tuple[str, int, int, int | None, int], ...] = (
    *(("steps", side, steps, None, 2) for side, steps in (
        (316, 10), (100, 100), (32, 1000), (10, 10000))),
    *(("cells", side, 100, None, 2) for side in (8, 32, 316)),
    *(("states", 32, 1000, every, 2) for every in (1000, 100, 10, 1)),
    *(("threads", 64, 1000, None, workers) for workers in (1, 2)),
    *(("dask", 64, 1000, None, workers) for workers in (1, 2, 4)))
QUICK = (("steps", 32, 10, None, 2), ("cells", 8, 100, None, 2), ("states", 8, 100, 10, 2),
         ("threads", 16, 100, None, 1))


def sweeps(choice: Choice) -> list[Row]:
    """Return a row for each case and scheme."""
    rows = []
    for case, side, steps, every, workers in QUICK if choice.quick else CASES:
        for stages in (2,) if choice.quick else (2, 4):
            if choice.only in case:
                setting = f"{stages}-G-L {side**2:,} cells of {steps:,} steps" + (
                    f", every {every:,}" if every else "") + f", {workers} workers"
                rows += contest(case, [Entry("gyrospark", setting, partial(
                    _swept, stages, side, steps, every, workers, dask=case == "dask"))], choice)
    return rows


def sweep_arguments(stages: int, side: int, steps: int, every: int | None = None
                    ) -> dict[str, Any]:
    """Return the arguments of a sweep whose steps converge for every γ."""
    over = {"gamma": np.geomspace(4e-4, 4e-3, side), "dt": np.geomspace(1e-4, 2e-3, side)}
    return {"over": over, "scheme": "G-L", "stages": stages, "steps": steps, "every": every}


def ensemble_job(stages: int, side: int, steps: int, every: int | None = None,
                 workers: int | None = None) -> Callable[[], gs.Ensemble]:
    """Return the run of all cells of a sweep as an ensemble, in the order of their Δt."""
    step, top = gs.stepper("G-L", stages), gs.problems.fast_top()
    over = sweep_arguments(stages, side, steps)["over"]
    gammas, dts = (np.tile(over["gamma"], side), np.repeat(over["dt"], side))
    q, p = (np.tile(x, (side**2, 1)) for x in (top.q0, top.p0))
    return lambda: step.integrate_ensemble(
        q, p, dt=dts, steps=steps, every=every or steps, workers=workers,
        parameters=top.parameters | {"gamma": gammas})


def _swept(stages: int, side: int, steps: int, every: int | None, workers: int, *, dask: bool
           ) -> Prepared:
    folder = tempfile.TemporaryDirectory(prefix="gyrospark-sweep-")
    path = Path(folder.name) / "sweep.zarr"
    arguments = sweep_arguments(stages, side, steps, every) | {"workers": workers}
    top = gs.problems.fast_top()
    client = None
    if dask:
        distributed = need("distributed")
        cluster = distributed.LocalCluster(n_workers=workers, threads_per_worker=1,
                                           dashboard_address=":0", silence_logs=50)
        client = distributed.Client(cluster)
        arguments = arguments | {"dask": client}

    def store() -> None:
        shutil.rmtree(path, ignore_errors=True)
        gs.sweep(top, out=path, **arguments)

    store()
    files = [file.stat().st_size for file in path.rglob("*") if file.is_file()]
    jobs: dict[str, Callable[[], object]] = {
        "ensemble": ensemble_job(stages, side, steps, every, workers), "store": store}
    if not dask:
        jobs["memory"] = partial(gs.sweep, top, **arguments)
    work = side**2 * steps

    def costs(seconds: Any) -> dict[str, float]:
        cells = {f"{job} ns/step": sample.wall / work * 1e9 for job, sample in seconds.items()}
        shares = {f"share of {job}": seconds["ensemble"].wall / sample.wall
                  for job, sample in seconds.items() if job != "ensemble"}
        if client is not None:
            client.close()
            cluster.close()
        folder.cleanup()
        return cells | shares

    return Prepared({"B/cell": sum(files) / side**2, "files": float(len(files))}, jobs, costs)
