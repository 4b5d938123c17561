"""A run does not depend on the clock of the machine, which may jump."""

from __future__ import annotations

import ast
import itertools
from pathlib import Path
from types import SimpleNamespace

import pytest

import gyrospark.storage
from gyrospark.storage import recorder
from stores import START, assert_same_bytes, recorded, small_blocks

#: Clocks that someone can set.
WALL = {"time", "time_ns", "localtime", "gmtime", "now", "utcnow", "today", "ctime"}


def test_no_wall_clock_in_the_source():
    for file in Path(gyrospark.storage.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                assert "datetime" not in {name.name for name in node.names}, file
            if isinstance(node, ast.ImportFrom):
                assert node.module not in ("datetime", "time"), file
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                assert node.func.attr not in WALL, (file, ast.unparse(node))


def test_between_full_blocks_commits_wait_for_their_time(gl3, tmp_path, monkeypatch):
    """1,001 states in blocks of 64, and no time goes by: a commit for each block."""
    small_blocks(monkeypatch, 64, seconds=5.0)
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 50)
    monkeypatch.setattr(recorder, "time", SimpleNamespace(monotonic=lambda: 1e6))
    commits, commit = [], recorder.Recorder._commit

    def counted(course, writer, **how):
        commits.append(course.state.steps)
        commit(course, writer, **how)

    monkeypatch.setattr(recorder.Recorder, "_commit", counted)
    recorded(gl3, tmp_path / "run.zarr", **START, steps=3000, every=3)
    assert len(commits) == 16
    assert commits[-1] == 3000


@pytest.mark.parametrize("clock", [
    pytest.param([0.0, 1e9], marks=pytest.mark.slow), [0.0, 5.0, 5.0, 5.0]])
def test_number_of_commits_does_not_matter(clock, gl3, tmp_path, monkeypatch):
    """However the time since the last commit comes out: never, always, now and then."""
    small_blocks(monkeypatch, 32, seconds=5.0)
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 25)
    recorded(gl3, tmp_path / "whole.zarr", **START, steps=300, every=3)
    times = itertools.accumulate(itertools.cycle(clock))
    monkeypatch.setattr(recorder, "time", SimpleNamespace(monotonic=lambda: next(times)))
    recorded(gl3, tmp_path / "run.zarr", **START, steps=300, every=3)
    assert_same_bytes(tmp_path / "whole.zarr", tmp_path / "run.zarr")
