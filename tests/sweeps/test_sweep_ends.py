"""Sweeps that are ended: killed, interrupted, on clusters that lose their workers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from importlib import import_module

import pytest

import gyrospark as gs
from gyrospark.sweeps import cluster, tiles
from gyrospark.sweeps.results import done_tiles
from gyrospark.sweeps.run_sweep import run_study
from gyrospark.sweeps.study_file import load_study
from interruption import differences
from processes import HELPERS, call, environment, gyrospark_command, wait_for
from sweep_studies import STUDY, study_file

#: The least work of a tile, so that a study of some tenths of a second has a dozen.
WORK = 10**6


def killed(folder, kills, seed):
    path = study_file(folder)
    done = call([sys.executable, HELPERS / "interruption.py", folder, str(kills), str(seed),
                 "sweep", path, "--out", "{store}"], KILLING_WORK=str(WORK),
                GYROSPARK_OPTIMISE="1")
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["kills"] == kills
    assert said["completed"] == said["same"] >= 1, said


def test_killed_sweeps_end_in_the_same_bytes(tmp_path):
    killed(tmp_path, 3, 1)


@pytest.mark.slow
def test_two_hundred_kills(tmp_path, monkeypatch):
    monkeypatch.setattr("processes.PATIENCE", 3600)
    killed(tmp_path, 200, 2)


def test_ctrl_c_keeps_every_finished_cell(tmp_path):
    study_file(tmp_path, STUDY.replace("count = 40", "count = 4000"))
    command = gyrospark_command("sweep", "study.toml")
    process = subprocess.Popen(command, cwd=tmp_path, text=True,
                               env=environment(GYROSPARK_OPTIMISE="1"),
                               stderr=subprocess.PIPE, stdout=subprocess.PIPE)
    store = tmp_path / "study.zarr"
    wait_for(process, lambda: done_tiles(store))
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "--resume" in said
    cells = int(said.split("Stopped with ")[1].split(" ")[0].replace(",", ""))
    assert cells == int((gs.open_sweep(store).status == 0).sum()) > 0


def test_ctrl_c_after_the_last_cell(gyrospark, monkeypatch, tmp_path):
    """The sweep is complete, and is told so, with its report."""
    study_file(tmp_path)
    sweep = import_module("gyrospark.commands.sweep")  # the package has the command by that name
    summary = sweep._result
    monkeypatch.setattr(sweep, "_result", lambda *given: (
        os.kill(os.getpid(), signal.SIGINT), summary(*given))[1])
    answer = gyrospark("sweep", "study.toml")
    assert answer.code == 130
    assert "1,280 cells" in answer.stdout
    assert answer.stderr.count("\n") == 1
    assert "complete" in answer.stderr


def on_a_cluster(folder, what, **changes):
    """Run the folder's study on a cluster that loses workers; return what is printed."""
    done = call([sys.executable, HELPERS / "clusters.py", what], cwd=folder,
                PYTHONWARNINGS=None, **changes)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_cluster_that_loses_a_worker_writes_the_same_bytes(tmp_path, monkeypatch):
    monkeypatch.setattr(tiles, "_LEAST_STORED", WORK)
    path = study_file(tmp_path, STUDY.replace("steps = 400", "steps = 200"))
    study = load_study(path).study
    assert len(list(tiles.tiles_of(study))) > 4
    run_study(study, out=tmp_path / "threads.zarr")
    assert on_a_cluster(tmp_path, "lose", KILLING_WORK=str(WORK)).split() == ["True"]
    assert differences(tmp_path / "threads.zarr", tmp_path / "cluster.zarr") == []


def test_no_scheduler_answers(monkeypatch):
    monkeypatch.setattr(cluster, "_CONNECT_SECONDS", 0.5)
    with pytest.raises(gs.InputError, match="Dask scheduler"):
        cluster.client_of("tcp://127.0.0.1:1")


@pytest.mark.slow
def test_a_tile_that_kills_every_worker_is_left_and_done_later(tmp_path):
    """All others are done, whatever the scheduler blames for the deaths."""
    path = study_file(tmp_path, STUDY.replace("count = 40", "count = 400"))
    study = load_study(path).study
    run_study(study, out=tmp_path / "threads.zarr")
    said = on_a_cluster(tmp_path, "deadly")
    assert "Workers died" in said
    assert "--resume" in said
    every = {tile.place for tile in tiles.tiles_of(study)}
    assert every - done_tiles(tmp_path / "cluster.zarr") == {(1, 0)}
    run_study(study, out=tmp_path / "cluster.zarr", resume=True)
    assert differences(tmp_path / "threads.zarr", tmp_path / "cluster.zarr") == []


@pytest.mark.parametrize(("how", "words"), [
    ("signal", "0 of 1,280"), ("gone", "2 s")])
def test_a_sweep_does_not_hang_where_no_worker_is(how, words, tmp_path):
    study_file(tmp_path)
    said = on_a_cluster(tmp_path, how)
    assert words in said
    assert "--resume" in said
