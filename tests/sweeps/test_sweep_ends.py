"""Sweeps may be killed or interrupted, or run on clusters that lose their workers."""

from __future__ import annotations

import json
import os
import signal
import sys
import warnings
from importlib import import_module
from types import SimpleNamespace

import pytest

import gyrospark as gs
from gyrospark.sweeps import cluster, compute_tile, tiles
from gyrospark.sweeps.results import done_tiles
from gyrospark.sweeps.run_sweep import run_study
from gyrospark.sweeps.study_file import load_study
from interruption import differences
from processes import HELPERS, call
from sweep_studies import STUDY, study_file

#: The least work of a tile, so that a study of some tenths of a second has a dozen.
WORK = 10**6


def killed(folder, kills, seed):
    path = study_file(folder, STUDY.replace("steps = 100", "steps = 400"))
    done = call([sys.executable, HELPERS / "interruption.py", folder, str(kills), str(seed),
                 "sweep", path, "--out", "{store}"], KILLING_WORK=str(WORK),
                GYROSPARK_OPTIMISE="1")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["kills"] == kills
    assert report["completed"] == report["same"] >= 1, report


@pytest.mark.slow  # processes that are killed; test_sweep_stores.py ends sweeps in this one
@pytest.mark.parametrize("kills", [3, 200])
def test_killed_sweeps_end_in_the_same_bytes(kills, tmp_path, monkeypatch):
    monkeypatch.setattr("processes.PATIENCE", 3600)
    killed(tmp_path, kills, 1)


def test_ctrl_c_keeps_every_finished_cell(gyrospark, monkeypatch, tmp_path):
    study_file(tmp_path)
    monkeypatch.setattr(tiles, "_LEAST_STORED", 1)
    monkeypatch.setattr(tiles, "_TILES", 2**30)
    computed, compute = [], compute_tile.compute

    def interrupted(*arguments):
        computed.append(arguments)
        if len(computed) == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return compute(*arguments)

    monkeypatch.setattr(compute_tile, "compute", interrupted)
    answer = gyrospark("sweep", "study.toml")
    assert answer.code == 130
    assert "--resume" in answer.stderr
    cells = int(answer.stderr.split("Stopped with ")[1].split(" ")[0].replace(",", ""))
    assert cells == int((gs.load_sweep("study.zarr").status == 0).sum()) > 0


def test_ctrl_c_after_the_last_cell(gyrospark, monkeypatch, tmp_path):
    """The message says that the sweep is complete, with its report."""
    study_file(tmp_path, STUDY.replace("count = 40", "count = 4"))
    sweep = import_module("gyrospark.commands.sweep")  # the package has the command by that name
    summary = sweep._result
    monkeypatch.setattr(sweep, "_result", lambda *arguments: (
        os.kill(os.getpid(), signal.SIGINT), summary(*arguments))[1])
    answer = gyrospark("sweep", "study.toml")
    assert answer.code == 130
    assert "128 cells" in answer.stdout
    assert answer.stderr.count("\n") == 1
    assert "complete" in answer.stderr


def on_a_cluster(folder, scenario, **changes):
    """Return the output of the folder's study on a cluster that loses workers."""
    done = call([sys.executable, HELPERS / "clusters.py", scenario], cwd=folder,
                PYTHONWARNINGS=None, **changes)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_cluster_of_threads_writes_the_same_bytes(tmp_path, monkeypatch):
    """Workers are threads of this process; scheduler and client work as in any cluster."""
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(tiles, "_LEAST_STORED", 10**3)
    study = load_study(study_file(tmp_path, STUDY.replace("count = 40", "count = 2"))).study
    assert len(list(tiles.tiles_of(study))) > 2
    run_study(study, out=tmp_path / "threads.zarr")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of Dask
        with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=False,
                                      dashboard_address=None, silence_logs=50) as local, \
                distributed.Client(local) as client:
            run_study(study, out=tmp_path / "cluster.zarr", dask=client)
            in_memory = run_study(study, dask=local.scheduler_address)
            # the client of the address is closed, and never was this process's default
            assert set(local.scheduler.clients) == {"fire-and-forget", client.id}
            assert distributed.default_client() is client
    assert in_memory.equals(gs.load_sweep(tmp_path / "threads.zarr"))
    assert differences(tmp_path / "threads.zarr", tmp_path / "cluster.zarr") == []


@pytest.mark.slow  # processes of a cluster
def test_a_cluster_that_loses_a_worker_writes_the_same_bytes(tmp_path, monkeypatch):
    monkeypatch.setattr(tiles, "_LEAST_STORED", WORK)
    path = study_file(tmp_path, STUDY.replace("steps = 100", "steps = 200"))
    study = load_study(path).study
    assert len(list(tiles.tiles_of(study))) > 4
    run_study(study, out=tmp_path / "threads.zarr")
    assert on_a_cluster(tmp_path, "lose", KILLING_WORK=str(WORK)).split() == ["True"]
    assert differences(tmp_path / "threads.zarr", tmp_path / "cluster.zarr") == []


def test_no_scheduler_answers(monkeypatch):
    monkeypatch.setattr(cluster, "_CONNECT_SECONDS", 0.5)
    with pytest.raises(gs.InputError, match="Dask scheduler"), \
            cluster.connect("tcp://127.0.0.1:1"):
        pass


def test_workers_that_are_gone_for_long_end_a_sweep(monkeypatch):
    """Workers that have not come yet may come; ones that have gone may come back for a while."""
    clock, threads = [0.0], {}
    monkeypatch.setattr(cluster.time, "monotonic", lambda: clock[0])
    capacity = cluster._ClusterCapacity(SimpleNamespace(nthreads=lambda: threads))

    def measure_at(seconds):
        clock[0] = seconds
        capacity.measure(7)
        return capacity.tiles

    assert measure_at(10 * cluster._PATIENCE) == cluster._TILES_A_THREAD
    threads |= {"a": 2, "b": 3}
    assert measure_at(11 * cluster._PATIENCE) == 5 * cluster._TILES_A_THREAD
    threads.clear()
    measure_at(12 * cluster._PATIENCE)
    with pytest.raises(gs.errors.GyrosparkError, match=f"{cluster._PATIENCE}.*7.*--resume"):
        measure_at(12 * cluster._PATIENCE + 1)


@pytest.mark.slow
def test_a_tile_that_kills_every_worker_is_left_and_done_later(tmp_path, monkeypatch):
    """All other tiles are done, whatever the scheduler blames for the deaths."""
    monkeypatch.setattr(tiles, "_LEAST_STORED", WORK)
    study = load_study(study_file(tmp_path)).study
    every = {tile.place for tile in tiles.tiles_of(study)}
    assert (1, 0) in every
    run_study(study, out=tmp_path / "threads.zarr")
    output = on_a_cluster(tmp_path, "deadly", KILLING_WORK=str(WORK))
    assert "Workers died" in output
    assert "--resume" in output
    assert every - done_tiles(tmp_path / "cluster.zarr") == {(1, 0)}
    run_study(study, out=tmp_path / "cluster.zarr", resume=True)
    assert differences(tmp_path / "threads.zarr", tmp_path / "cluster.zarr") == []


@pytest.mark.slow  # processes of a cluster
@pytest.mark.parametrize(("scenario", "words"), [
    ("signal", "0 of 1,280"), ("gone", "2 s")])
def test_a_sweep_does_not_hang_where_no_worker_is(scenario, words, tmp_path):
    study_file(tmp_path)
    output = on_a_cluster(tmp_path, scenario)
    assert words in output
    assert "--resume" in output
