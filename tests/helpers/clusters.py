"""Sweeps study.toml of this folder into cluster.zarr, on a Dask cluster with a fault.

    python tests/helpers/clusters.py FAULT

lose      a worker is killed when the first tile is done
deadly    the tile (1, 0) kills every worker that computes it
signal    no worker is there, and SIGINT comes
gone      the workers have gone for good

Prints what the sweep ends with. KILLING_WORK in the environment is the least work of a tile.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import dask
from distributed import Client, LocalCluster, Scheduler
from distributed.deploy import SpecCluster

import gyrospark as gs
from gyrospark.sweeps import cluster as on_cluster
from gyrospark.sweeps import tiles
from gyrospark.sweeps.run_sweep import run_study
from gyrospark.sweeps.study_file import load_study
from gyrospark.sweeps.tiles import Tile

WORK = on_cluster._compute


@contextmanager
def two_workers() -> Iterator[Client]:
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None,
                      silence_logs=50) as cluster, Client(cluster) as client:
        yield client


@contextmanager
def no_worker() -> Iterator[Client]:
    scheduler = {"cls": Scheduler, "options": {"dashboard_address": None}}
    with SpecCluster({}, scheduler=scheduler, silence_logs=50) as cluster, \
            Client(cluster) as client:
        yield client


def deadly(shared: tuple[Any, ...], tile: Tile) -> Any:
    if tile.place == (1, 0):
        os.kill(os.getpid(), signal.SIGKILL)
    return WORK(shared, tile)


def lose(client: Client) -> None:
    victims: list[int] = []

    def look(done: int, everything: int) -> None:
        if done and not victims:
            victims.append(min(client.run(os.getpid).values()))
            os.kill(victims[0], signal.SIGKILL)

    study = load_study(Path("study.toml")).study
    stored = run_study(study, out="cluster.zarr", dask=client, progress=look)
    assert victims
    print(bool(run_study(study, dask=client).equals(stored)))


def end_early(client: Client) -> None:
    try:
        run_study(load_study(Path("study.toml")).study, out="cluster.zarr", dask=client)
    except (gs.GyrosparkError, KeyboardInterrupt) as error:
        print(error)


def main(fault: str) -> None:
    dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"})  # imports once
    if "KILLING_WORK" in os.environ:
        tiles._LEAST_STORED = int(os.environ["KILLING_WORK"])
    if fault == "lose":
        with two_workers() as client:
            lose(client)
    elif fault == "deadly":
        on_cluster._compute = deadly
        with two_workers() as client:
            end_early(client)
    else:
        with no_worker() as client:
            if fault == "signal":
                threading.Timer(2, os.kill, (os.getpid(), signal.SIGINT)).start()
            else:
                on_cluster._PATIENCE = 2
                client.nthreads = iter([{"tcp://a": 1}] + [{}] * 1000).__next__
            end_early(client)


if __name__ == "__main__":
    main(sys.argv[1])
