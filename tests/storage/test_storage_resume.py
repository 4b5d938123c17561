"""However often a run is stopped and resumed, its store ends with the same bytes."""

from __future__ import annotations

import contextlib
import shutil
import threading

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import gyrospark as gs
import systems
from calls import LATE, PARAMETERS, TOP, integrate
from gyrospark.storage import array_layout, recorder
from resumed_stores import check
from stores import (
    START,
    Interrupted,
    assert_same,
    assert_same_bytes,
    assert_same_states,
    ends_after,
    record,
    recorded,
    small_blocks,
)


@pytest.mark.parametrize(("name", "scheme", "real", "solver"), [
    ("heavy_top", "EMS", "double", "newton"),
    *(pytest.param("dragged_pendulum", "G-L", *given, marks=pytest.mark.slow)
      for given in (("long-double", "auto"), ("double", "newton")))])
def test_runs_ended_often(name, scheme, real, solver, tmp_path, monkeypatch):
    """There is a commit after every piece of 5 steps, with 7 steps a row and four rows a block.

    The padding of a long double is arbitrary memory: it must not get into the store.
    """
    small_blocks(monkeypatch, 4)
    step, case = systems.stepper(name, scheme, real=real), systems.case(name)
    q, p = systems.start(name, step)
    ends = check(step, tmp_path, [1, 3] * 5, 5, q=q, p=p, dt=case.dt, t0=case.t0, steps=45,
                 every=7, parameters=case.parameters, solver=solver)
    assert ends > 2


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_steps_that_newton_took(tmp_path, monkeypatch):
    """Diverged iterations leave a mark in the work memory, which a resumed run has too."""
    small_blocks(monkeypatch, 4)
    step = systems.stepper("heavy_top")
    for dt in (0.03, 0.024):
        arguments = START | {"dt": dt, "steps": 40, "every": 4}
        if integrate(step, **arguments).report.newton_steps > 3:
            check(step, tmp_path, [3] * 4, 3, **arguments)
            return
    pytest.fail("no step size at which Newton takes some of the steps")


def test_runs_that_fail(failures, tmp_path, monkeypatch):
    small_blocks(monkeypatch, 4)
    step, options, _ = failures[0]
    check(step, tmp_path, [2] * 5, 3, q=LATE[0], p=LATE[1], steps=200, every=3, **options)
    assert gs.load(tmp_path / "pieces.zarr").status.startswith("failed: ")


def test_a_step_of_scaled_time_that_fails_has_its_time(tmp_path):
    """The step behind the last row begins where a run of the steps before it ends."""
    step, case = systems.stepper("eccentric"), systems.case("eccentric")
    start, run = gs.Start(case.q, case.p, case.parameters), {"steps": 60, "every": 59}
    for limit in range(6, 40):  # of more iterations more steps before one that fails
        plan = {"dtau": case.dt, "solver": gs.Solver("fixed-point", max_iterations=limit)}
        with pytest.raises(gs.StepFailed) as failure:
            step.integrate(start, **plan, **run)
        if failure.value.step > 1:
            break
    with pytest.raises(gs.StepFailed) as failure:
        step.integrate(start, **plan, **run, out=tmp_path / "run.zarr")
    failed = failure.value
    before = step.integrate(start, **plan, steps=failed.step - 1)
    assert failed.t == before.t[-1] > 0


@given(steps=st.integers(0, 150), every=st.integers(1, 40), rows=st.sampled_from([1, 2, 4, 16, 64]),
       chunk=st.integers(1, 60), seconds=st.sampled_from([0.0, 1e9]),
       calls=st.lists(st.integers(0, 12), max_size=8), scheme=st.sampled_from(["EMS", "G-L"]))
@settings(max_examples=3, suppress_health_check=list(HealthCheck))
def test_any_run_ended_anywhere(steps, every, rows, chunk, seconds, calls, scheme, tmp_path):
    """Commits may be at the ends of blocks alone: then the store is behind the run."""
    step = systems.stepper("heavy_top", scheme)
    arguments = START | {"steps": steps, "every": every}
    with pytest.MonkeyPatch.context() as patch:
        small_blocks(patch, rows, seconds)
        check(step, tmp_path, calls, chunk, **arguments)
        trajectory = gs.load(tmp_path / "pieces.zarr")[:]
        assert_same(trajectory, integrate(step, **arguments))


@given(calls=st.lists(st.integers(1, 6), min_size=1, max_size=6))
@settings(max_examples=2, suppress_health_check=list(HealthCheck))
def test_store_is_a_run_up_to_a_commit(calls, gl3, tmp_path):
    """After any end the states are the first ones of the uninterrupted run, as many as it says."""
    out = tmp_path / "run.zarr"
    shutil.rmtree(out, ignore_errors=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 9)
        small_blocks(patch, 4)
        for count in calls:
            with contextlib.suppress(Interrupted):
                record(gl3, **START, out=out, steps=90, every=2, resume=True,
                          progress=ends_after(count))
            recording = gs.load(out)
            if recording.report is None:
                assert recording.states == recording.steps_done == 0
                continue
            assert recording.status in ("running", "complete")
            assert recording.states == recording.steps_done // 2 + 1
            stored = recording[:]
            end = integrate(gl3, **START, steps=recording.steps_done)
            np.testing.assert_array_equal(stored.q, end.q[::2])
            assert recording.report == end.report
            assert recording.dataset().sizes["time"] == recording.states
            assert not recording.dataset()["q"].isnull().any()


def copies_after_each_file(monkeypatch, step, folder, **arguments):
    """Return copies of the store of a run, one after each of its files that is written."""
    copies, lock, out = [], threading.Lock(), folder / "run.zarr"

    def copy(_):
        """Copy the store as it is; in Zarr's own threads nothing of Zarr can be waited for."""
        with lock:
            if out.exists():
                copies.append(folder / f"{len(copies)}.zarr")
                shutil.copytree(out, copies[-1], ignore=shutil.ignore_patterns("*.part"))

    with monkeypatch.context() as patch:
        patch.setattr("gyrospark.storage.durable_files.sync_folder", copy)
        record(step, out=out, **arguments)
    return copies


def test_killed_before_the_last_attributes(gl3, tmp_path, monkeypatch):
    """The last row, between two of every seven, ends a block, and all steps are stored."""
    small_blocks(monkeypatch, 4)
    arguments = START | {"steps": 20, "every": 7}
    recorded(gl3, tmp_path / "whole.zarr", **arguments)
    copies = copies_after_each_file(monkeypatch, gl3, tmp_path, **arguments)
    for path in [path for path in copies if gs.load(path).status == "running"][-2:]:
        record(gl3, out=path, resume=True, **arguments)
        assert_same_bytes(tmp_path / "whole.zarr", path)


@pytest.mark.slow  # 2 CPU s: a copy after each of a hundred files
def test_store_after_each_file_that_is_written(tmp_path, monkeypatch):
    """A process may end between any two files: the counts in the store agree with its arrays."""
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 9)
    small_blocks(monkeypatch, 4)
    step = systems.stepper("heavy_top")
    q, p = step.project(TOP.q0, TOP.p0, parameters=PARAMETERS)
    arguments = START | {"q": q, "p": p, "steps": 36, "every": 2}
    computed, steps_done = integrate(step, **arguments), []
    for path in copies_after_each_file(monkeypatch, step, tmp_path, **arguments):
        recording = gs.load(path)
        steps_done.append(recording.steps_done)
        if recording.states:
            assert_same_states(recording[:], computed)
            assert recording.dataset().sizes["time"] == recording.states
    assert len(steps_done) > 40
    assert len(set(steps_done)) > 3
    assert steps_done == sorted(steps_done)


def test_before_the_first_commit(gl3, tmp_path):
    """A store without a state can be opened, says so, and can be resumed."""
    out = tmp_path / "run.zarr"
    with pytest.raises(Interrupted):
        record(gl3, **START, out=out, steps=200, progress=ends_after(0))
    recording = gs.load(out)
    assert (recording.status, recording.states, recording.steps_done) == ("running", 0, 0)
    assert recording.report is None
    for use in (lambda: recording[:], lambda: recording[0],
                lambda: recording.save(tmp_path / "run.csv")):
        with pytest.raises(gs.InputError, match=r"state.*run"):
            use()
    assert record(gl3, **START, out=out, steps=200, resume=True).status == "complete"


def test_done_twice(gl3, tmp_path):
    """A complete run is read, not written, even if it is resumed like a new one."""
    first = record(gl3, **START, out=tmp_path / "run.zarr", steps=50, resume=True)
    times_of_files = {p: p.stat().st_mtime_ns for p in (tmp_path / "run.zarr").rglob("*")}
    resumed = record(gl3, **START, out=tmp_path / "run.zarr", steps=50, resume=True)
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "run.zarr").rglob("*")} == times_of_files
    assert_same(resumed[:], first[:])


def test_what_others_left_behind(gl3, tmp_path):
    """Parts of files and an unfinished store of killed processes do no harm."""
    recorded(gl3, tmp_path / "whole.zarr", **START, steps=50)
    (tmp_path / ".run.zarr.new" / "q").mkdir(parents=True)
    (tmp_path / ".run.zarr.new" / "q" / "rest").write_text("rest")
    with pytest.raises(Interrupted):
        record(gl3, **START, out=tmp_path / "run.zarr", steps=50, progress=ends_after(0))
    (tmp_path / "run.zarr" / "q" / "c").mkdir(exist_ok=True)
    (tmp_path / "run.zarr" / "q" / "c" / ".0.4711.part").write_text("rest")
    record(gl3, **START, out=tmp_path / "run.zarr", steps=50, resume=True)
    assert_same_bytes(tmp_path / "whole.zarr", tmp_path / "run.zarr")
    assert not (tmp_path / ".run.zarr.new").exists()


def test_block_size_is_the_stores(gl3, tmp_path, monkeypatch):
    """A store with other blocks, say of a later version, is continued in its own blocks."""
    arguments = START | {"steps": 60}
    small_blocks(monkeypatch, 8)
    recorded(gl3, tmp_path / "whole.zarr", **arguments)
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 10)
    with pytest.raises(Interrupted):
        record(gl3, **arguments, out=tmp_path / "run.zarr", progress=ends_after(4))
    monkeypatch.setattr(array_layout, "_MOST_ROWS", 64)
    record(gl3, **arguments, out=tmp_path / "run.zarr", resume=True)
    assert_same_bytes(tmp_path / "whole.zarr", tmp_path / "run.zarr")


@pytest.mark.parametrize(("first", "second", "every"), [
    (49, 120, 7), *(pytest.param(*given, marks=pytest.mark.slow)
                    for given in ((0, 30, 7), (64, 65, 1)))])
def test_finished_run_goes_on_to_more_steps(first, second, every, gl3, tmp_path, monkeypatch):
    """It equals a longer run to the bit, also from a last state between two others."""
    small_blocks(monkeypatch, 16)
    out = tmp_path / "run.zarr"
    record(gl3, **START, out=out, steps=first, every=every)
    for steps in (second, second + 5):
        recording = record(gl3, **START, out=out, steps=steps, every=every, resume=True)
        assert_same(recording[:], integrate(gl3, **START, steps=steps, every=every))
        assert recording.dataset().sizes["time"] == recording.states
        assert recording.attributes["title"].endswith(f"{steps} steps of 0.001 s")
    with pytest.raises(gs.InputError, match=rf"steps.*\b{second + 5}\b.*\b{second}\b"):
        record(gl3, **START, out=out, steps=second, every=every, resume=True)


def test_run_that_was_ended_goes_on_to_more_steps(gl3, tmp_path, monkeypatch):
    small_blocks(monkeypatch, 4)
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 7)
    out, arguments = tmp_path / "run.zarr", START | {"every": 3}
    for steps, count in ((60, 0), (80, 5), (100, 4)):
        with pytest.raises(Interrupted):
            record(gl3, **arguments, out=out, steps=steps, resume=True,
                      progress=ends_after(count))
    recording = record(gl3, **arguments, out=out, steps=120, resume=True)
    assert_same(recording[:], integrate(gl3, **arguments, steps=120))


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_failed_run_has_no_more_steps(failures, tmp_path):
    step, options, _ = failures[0]
    arguments = {"q": TOP.q0, "p": TOP.p0, **options, "out": tmp_path / "run.zarr"}
    with pytest.raises(gs.StepFailed):
        record(step, **arguments, steps=200)
    with pytest.raises(gs.InputError, match=r"steps.*200.*300"):
        record(step, **arguments, steps=300, resume=True)


@pytest.mark.slow  # 1 CPU s: a copy after each of many files
def test_store_that_was_being_extended(gl3, tmp_path, monkeypatch):
    """The process ended after any of the files: old states are there, either number continues."""
    small_blocks(monkeypatch, 16)
    out, copies = tmp_path / "run.zarr", []
    old = record(gl3, **START, out=out, steps=40)[:]

    def copy(folder):
        copies.append(tmp_path / f"{len(copies)}.zarr")
        shutil.copytree(out, copies[-1], ignore=shutil.ignore_patterns("*.part"))

    with monkeypatch.context() as patch:
        patch.setattr("gyrospark.storage.durable_files.sync_folder", copy)
        patch.setattr(recorder.Recorder, "run_to_end", lambda self, progress: None)
        with pytest.raises(gs.StepFailed):  # it is not complete
            record(gl3, **START, out=out, steps=90, resume=True)
    computed = integrate(gl3, **START, steps=90)
    assert len(copies) > 8
    for number, path in enumerate(copies):
        assert_same_states(gs.load(path)[:], computed)
        assert gs.load(path).dataset().sizes["time"] == 41
        if number < len(copies) - 1 and number % 2:
            resumed = record(gl3, **START, out=path, steps=40, resume=True)
            assert_same(resumed[:], old)
        else:
            resumed = record(gl3, **START, out=path, steps=90, resume=True)
            assert_same(resumed[:], computed)
