"""Ctrl-C loses nothing: computed states come with the exception, or go to the file."""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import threading
import time

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import RUN, TOP, integrate
from command_line import RUN as COMMAND
from gyrospark.core.interrupts import catch_ctrl_c, catch_signals, catch_termination
from gyrospark.runtime.bindings.compiled_module import Compiled
from gyrospark.runtime.integration import dense_output, step_loop
from gyrospark.sweeps.results import NOT_COMPUTED
from gyrospark.targets.artefact import staging
from processes import PATIENCE, catches, environment, gyrospark_command, wait_for
from stores import START, assert_same, assert_same_states
from sweep_studies import GAMMAS

pytestmark = pytest.mark.skipif(os.name == "nt", reason="POSIX signals")


def interrupt(number=signal.SIGINT):
    os.kill(os.getpid(), number)


def at(step):
    """Return a progress callback that presses Ctrl-C once so many steps are done."""
    return lambda done: interrupt() if done >= step else None


@pytest.mark.parametrize(("solver", "every"), [("auto", 1), ("auto", 7), ("newton", 3)])
def test_run_comes_with_what_it_has(solver, every, gl3):
    """A KeyboardInterrupt has the trajectory; the caller's handler is back in place."""
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt, match=r"step [0-9]+ of 400\.") as error:
        integrate(gl3, **START, steps=400, every=every, solver=solver, progress=at(50))
    assert isinstance(error.value, gs.errors.Stopped)
    assert error.value.signal == signal.SIGINT
    trajectory = error.value.trajectory
    assert 50 <= trajectory.report.steps < 400
    assert len(trajectory) == trajectory.report.steps // every + 1
    assert_same_states(trajectory, integrate(gl3, **START, steps=400, every=every, solver=solver))
    assert trajectory.report.q == integrate(
        gl3, **START, steps=trajectory.report.steps, solver=solver).report.q
    assert signal.getsignal(signal.SIGINT) is before


def test_run_that_is_over_is_reported_too(gl3):
    """A loop over short runs can be ended, and the last run is complete."""
    with pytest.raises(gs.errors.Stopped, match=r"last .*20 .*complete") as error:
        integrate(gl3, **START, steps=20, progress=at(20))
    assert_same(error.value.trajectory, integrate(gl3, **START, steps=20))


def test_a_search_for_gamma_has_no_steps_of_the_run(gl3, monkeypatch):
    monkeypatch.setattr(Compiled, "integrate",
                        lambda *_, **__: (interrupt(), 0)[1])  # of the first pilot run
    start = TOP.start.of_model({"gamma": TOP.inertia}, {"gamma": "auto"})
    for call in (lambda: gl3.integrate(start, dt=1e-3, steps=20),
                 lambda: gs.tune(gl3, TOP, dt=1e-3, gamma="auto")):
        with pytest.raises(gs.errors.Stopped, match="first step") as error:
            call()
        assert error.value.trajectory is None


def test_a_run_whose_states_between_steps_were_asked_for_is_complete(gl3, monkeypatch):
    run, fill = integrate(gl3, **START, steps=20), dense_output.fill_ensemble
    monkeypatch.setattr(dense_output, "fill_ensemble",
                        lambda *arguments, **named: (fill(*arguments, **named), interrupt())[0])
    with pytest.raises(gs.errors.Stopped, match="complete") as error:
        run.at(run.t[:-1] + 1e-4)
    assert error.value.trajectory is run


def test_own_handler_is_left_alone(gl3):
    heard = []
    before = signal.signal(signal.SIGINT, lambda *arguments: heard.append(arguments))
    try:
        run = integrate(gl3, **START, steps=100, progress=at(50))
    finally:
        signal.signal(signal.SIGINT, before)
    assert run.report.steps == 100
    assert heard


def test_watch_within_a_watch_is_the_same():
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    with catch_signals() as outer:
        with catch_ctrl_c() as inner:
            assert inner is outer
            interrupt(signal.SIGTERM)
            assert inner.signal == signal.SIGTERM
        with pytest.raises(KeyboardInterrupt):
            interrupt()
    assert {number: signal.getsignal(number) for number in before} == before
    with catch_ctrl_c() as later:
        assert not later.is_requested


def test_a_build_that_is_terminated_leaves_no_folder(tmp_path):
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(SystemExit) as ended, catch_termination(), staging(
            tmp_path / "top.html", {"top.c": ""}):
        interrupt(signal.SIGTERM)
    assert ended.value.code == 143
    assert not any(tmp_path.iterdir())
    assert signal.getsignal(signal.SIGTERM) is before


def test_threads_hear_nothing(gl3):
    """Only the main thread has signals: a run in another one goes on."""
    runs = []
    thread = threading.Thread(target=lambda: runs.append(
        integrate(gl3, **START, steps=8000, every=8000)))
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012 (raised wherever the main thread is)
        thread.start()
        interrupt()
        time.sleep(0.2)
    thread.join()
    assert runs[0].report.steps == 8000


@pytest.mark.parametrize(("solver", "count"), [
    ("auto", 20), pytest.param("newton", 3, marks=pytest.mark.slow)])
def test_ensemble_comes_with_what_it_has(solver, count, gl3):
    """Each member has the states it reached; a member that was not begun has its start."""
    q, p = np.tile(TOP.q0, (count, 1)), np.tile(TOP.p0, (count, 1))
    assert gl3._binding_of_many.lanes  # compiled before, not meanwhile
    presses = [interrupt]  # a second one would be raised at once
    with pytest.raises(gs.errors.Stopped, match=r"\.ensemble") as error:
        gl3.integrate_ensemble(q, p, **RUN, steps=10**8, every=10**6, solver=solver, workers=2,
                               progress=lambda done: presses.pop()() if done and presses else None)
    ensemble = error.value.ensemble
    assert len(ensemble) == count
    assert ensemble.q.shape == (count, 101, 4)
    assert not ensemble.failures
    done = [member.report.steps for member in ensemble.members]
    assert 0 < max(done) < 10**8
    for steps in sorted(set(done))[:2]:
        alone = gl3.integrate_ensemble(q[:1], p[:1], **RUN, steps=steps, every=10**6, solver=solver)
        member = ensemble.members[done.index(steps)]
        assert member.report.q == alone.members[0].report.q
        np.testing.assert_array_equal(ensemble.q[done.index(steps), : len(member)], member.q)
    assert np.isnan(ensemble.q[:, -1]).all()


def test_ensemble_to_a_time_comes_with_what_it_has():
    """Runs of different numbers of steps end too: those to one time in scaled time."""
    step, entry = systems.stepper("eccentric"), systems.case("eccentric")
    start, dtau, presses = systems.timed_start("eccentric", step), [0.01, 0.02], [interrupt]
    with pytest.raises(gs.errors.Stopped, match=r"\.ensemble") as error:
        step.integrate_ensemble([start] * 2, dtau=dtau, t_end=1e4, parameters=entry.parameters,
                                progress=lambda done: presses.pop()() if done and presses else None)
    for member, size in zip(error.value.ensemble.members, dtau, strict=True):
        steps = member.report.steps
        assert member.t[-1] < 1e4
        assert len(member) == steps + 1
        alone = step.integrate(start, dtau=size, steps=steps, parameters=entry.parameters)
        assert np.array_equal(member.q, alone.q)


def test_sweep_in_memory_comes_with_its_cells():
    """The dataset has the tiles that were done; the others are not computed."""
    over = {"scheme": ["EMS", "IMS", "G-L 2"], "gamma": GAMMAS}  # three tiles
    complete = gs.sweep(TOP, over, dt=1e-3, steps=20, workers=1)
    with pytest.raises(gs.errors.Stopped, match=r"of 9 .*\.dataset") as error:
        gs.sweep(TOP, over, dt=1e-3, steps=20, workers=1,
                 progress=lambda done, everything: interrupt() if 0 < done < 4 else None)
    partial = error.value.dataset
    done = partial.status == 0
    assert 3 <= int(done.sum()) < 9
    assert (partial.status.values[~done.values] == NOT_COMPUTED).all()
    assert partial.energy_error_max.where(done).equals(complete.energy_error_max.where(done))
    assert partial.energy_error_max.where(~done).isnull().all()


def test_pace_follows_what_steps_cost():
    """Calls grow from 16 steps to 4096 where these are quick, else to a tenth of a second."""
    now = [0.0]

    def paces(cost, pieces=12):  # costs are powers of two: the clock is exact
        pace, counts = step_loop.ChunkSize(clock=lambda: now[0]), []
        for _ in range(pieces):
            counts.append(pace.begin())
            now[0] += cost * counts[-1]
            pace.end(counts[-1])
        return counts

    assert paces(2.0**-20) == [16, 128, 1024, *[4096] * 9]
    assert 0.05 <= paces(2.0**-10)[-1] * 2.0**-10 <= 0.1
    assert paces(2.0**-6) == [16, *[6] * 11]
    assert paces(4.0) == [16, *[1] * 11]


@pytest.mark.parametrize("every", [3, 100])
def test_pace_grows_where_few_states_are_kept(every):
    """Calls end at stored states once these are no further apart than a call."""
    top, counts = gs.problems.fast_top(), []
    step = gs.stepper("G-L", 2, rep="gamma")
    integrate = step.binding.integrate

    def counted(constants, steps, *values, **named_values):
        counts.append(steps)
        return integrate(constants, steps, *values, **named_values)

    step.binding.integrate = counted
    try:
        step.integrate(top.q0, top.p0, dt=1e-3, steps=30000, every=every,
                       parameters=top.parameters)
    finally:
        del step.binding.integrate
    ends = np.cumsum(counts)
    assert ends[-1] == 30000
    assert not np.any(ends[ends >= every] % every)
    assert len(counts) < 30


LONG = ["run", "fast-top", "--scheme", "G-L", "--stages", "3", "--dt", "1e-3", "--steps",
        "90000000", "--every", "1000"]


def stopped(arguments, number, folder):
    """Return code, stdout and stderr of a command that gets a signal while it integrates."""
    process = subprocess.Popen(
        gyrospark_command(*arguments), cwd=folder, env=environment(), text=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    wait_for(process, lambda: catches(process, signal.SIGTERM))
    time.sleep(0.3)
    process.send_signal(number)
    stdout, stderr = process.communicate(timeout=PATIENCE)
    return process.returncode, stdout, stderr


@pytest.mark.slow  # processes
@pytest.mark.parametrize(("number", "code", "name"), [
    (signal.SIGINT, 130, "x.npz"), (signal.SIGTERM, 143, "x.npz"), (signal.SIGINT, 130, "x.csv")])
def test_command_writes_what_it_has(number, code, name, gl3, tmp_path):
    exit_code, stdout, stderr = stopped([*LONG, "--out", name, "--json"], number, tmp_path)
    assert exit_code == code, stderr
    document = json.loads(stdout)
    steps = document["steps"]
    assert document["stopped"] == {"step": steps, "signal": number}
    assert document["out"] == name
    assert stderr.count("\n") == 1
    assert f"step {steps:,} of 90,000,000" in stderr
    exact = integrate(gl3, **START, steps=steps, every=1000).q[: steps // 1000 + 1]
    assert f"in '{name}'" in stderr
    assert [path.name for path in tmp_path.iterdir()] == [name]
    if name.endswith(".npz"):
        np.testing.assert_array_equal(gs.load(tmp_path / name).q, exact)
    else:
        columns = np.loadtxt(tmp_path / name, delimiter=",", skiprows=1, ndmin=2)
        np.testing.assert_array_equal(columns[:, 1:5], exact)


@pytest.mark.parametrize("out", [(), ("--out", "x.csv"), ("--out", "x.zarr")])
@pytest.mark.parametrize("signals", [1, 2])
def test_signals_after_the_last_step(signals, out, gyrospark, monkeypatch, tmp_path):
    """The message says that the run is complete; a second signal ends the report."""
    run = importlib.import_module("gyrospark.commands.run.command")
    report = run.result_of
    monkeypatch.setattr(run, "result_of", lambda *arguments: (
        [interrupt() for _ in range(signals)], report(*arguments))[1])
    answer = gyrospark(*COMMAND, *out)
    assert answer.code == 130
    assert answer.stderr.count("\n") == 1
    if signals == 2:
        assert answer.stdout == ""
        assert "Interrupted" in answer.stderr
        assert ("'x.zarr'" in answer.stderr) == ("--resume" in answer.stderr) == ("x.zarr" in out)
        return
    assert "20 steps" in answer.stdout
    assert "complete" in answer.stderr
    files = {path.name for path in tmp_path.iterdir()}
    assert files == {*out[1:]} | ({".x.zarr.lock"} if out[1:] == ("x.zarr",) else set())
