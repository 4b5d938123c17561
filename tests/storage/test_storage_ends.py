"""Real ends of real processes: SIGKILL, signals, two of them on one store.

Every test ends with the bytes of a run that nothing happened to.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import gyrospark as gs
from processes import (
    HELPERS,
    PATIENCE,
    ROOT,
    call,
    catches,
    cli,
    environment,
    gyrospark_command,
    wait_for,
)
from stores import START, assert_same_bytes

pytestmark = pytest.mark.skipif(os.name == "nt", reason="POSIX signals")

#: For processes of many steps.
FAST = {"GYROSPARK_OPTIMISE": "1"}

TOP = ["run", "fast-top", "--scheme", "G-L", "--stages", "3", "--dt", "1e-3"]
#: A second and more, hundreds of pieces: there is time to end it in the middle.
LONG = [*TOP, "--steps", "2000000", "--every", "500"]
#: The first half of it, for what need not be ended.
BEGUN = [*TOP, "--steps", "1000000", "--every", "500"]
#: Ten seconds, with a tenth of a second from one look at the signals to the next.
SLOW = [*TOP, "--steps", "40960", "--every", "10", "--solver", "python"]
OUT = ["--out", "run.zarr", "--resume"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The store of LONG when nothing happens to it."""
    folder = tmp_path_factory.mktemp("whole")
    assert cli(*LONG, *OUT, cwd=folder, **FAST).returncode == 0
    return folder / "run.zarr"


def begin(command, folder, ignored=()):
    """Start a command; return when it has its store and hears signals."""
    process = subprocess.Popen(
        gyrospark_command(*command), cwd=folder, env=environment(**FAST), text=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        preexec_fn=lambda: [signal.signal(number, signal.SIG_IGN) for number in ignored],
    )
    wait_for(process, lambda: (folder / "run.zarr").exists() and catches(process, signal.SIGTERM))
    time.sleep(0.1)  # from there to the first step
    return process


def end(process):
    """Return a process's exit code, stdout and stderr."""
    stdout, stderr = process.communicate(timeout=PATIENCE)
    assert "Traceback" not in stderr
    return process.returncode, stdout, stderr


# ---------------------------------------------------------------- signals


@pytest.mark.parametrize(("number", "code", "onward"), [
    (signal.SIGINT, 130, True),  # the others differ in their number alone
    pytest.param(signal.SIGTERM, 143, False, marks=pytest.mark.slow),
    pytest.param(signal.SIGHUP, 129, False, marks=pytest.mark.slow)])
def test_signal_ends_a_run_at_a_commit(number, code, onward, whole, tmp_path):
    """It says where it stands, and all of that is in the store; the same command goes on.

    What was stored does not know which signal it was: one of them is gone on with.
    """
    process = begin([*LONG, *OUT], tmp_path)
    process.send_signal(number)
    found, stdout, stderr = end(process)
    assert found == code
    stored = gs.open_recording(tmp_path / "run.zarr")
    assert stored.status == "running"
    assert stored.steps_done < 2_000_000
    assert stored.states == stored.steps_done // 500 + 1
    assert stderr.count("\n") == 1
    assert f"{stored.steps_done:,} of 2,000,000" in stderr
    assert "--resume" in stderr
    assert f"{stored.steps_done:,} steps of 0.001 s" in stdout
    if not onward:
        return
    again = cli(*LONG, *OUT, "--json", cwd=tmp_path, **FAST)
    assert again.returncode == 0
    assert json.loads(again.stdout).get("resumed_at", 0) == stored.steps_done  # 0: none was taken
    assert_same_bytes(whole, tmp_path / "run.zarr")


@pytest.mark.slow  # a real process; test_interrupts.py has a second signal in this one
def test_second_signal_ends_it_at_once(tmp_path):
    """Without a commit, and both are there before the first is heard: what was stored is whole."""
    made = cli(*TOP, "--steps", "2", "--solver", "python", cwd=tmp_path, **FAST)
    assert made.returncode == 0  # Newton's method is compiled now, and not while signals come
    process = begin([*SLOW, *OUT], tmp_path)
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGTERM)
    code, stdout, stderr = end(process)
    assert (code, stdout) == (130, "")
    assert stderr.count("\n") == 1
    for word in ("Interrupted", "'run.zarr'", "--resume"):
        assert word in stderr
    assert gs.open_recording(tmp_path / "run.zarr").status == "running"


@pytest.mark.slow  # a real process; as under nohup
def test_ignored_signal_stays_ignored(tmp_path):
    process = begin([*BEGUN, *OUT], tmp_path, ignored=[signal.SIGHUP])
    process.send_signal(signal.SIGHUP)
    assert end(process)[0] == 0
    assert gs.open_recording(tmp_path / "run.zarr").status == "complete"


def test_an_ignored_signal_does_not_end_a_run(gl3, tmp_path):
    """As under nohup; the handler stays as it was."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        run = gs.record(gl3, **START, out=tmp_path / "run.zarr", steps=100,
                        progress=lambda done: os.kill(os.getpid(), signal.SIGHUP))
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
    assert run.status == "complete"


def test_signal_after_the_last_step_loses_nothing(gl3, tmp_path):
    """The run is complete, says so, and its caller's handlers are back in place."""
    before = signal.getsignal(signal.SIGINT)

    def progress(done):
        if done == 5000:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(gs.Stopped, match=r"5,000.*complete") as end:
        gs.record(gl3, **START, out=tmp_path / "run.zarr", steps=5000, progress=progress)
    assert "--resume" not in str(end.value)
    assert gs.open_recording(tmp_path / "run.zarr").status == "complete"
    assert signal.getsignal(signal.SIGINT) is before


def test_stopped_says_where(gl3, tmp_path):
    """In Python a signal is a ``Stopped``, which is a ``KeyboardInterrupt``."""
    def progress(done):
        os.kill(os.getpid(), signal.SIGTERM)

    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(gs.Stopped, match="16 of 20,000") as stopped:
        gs.record(gl3, **START, out=tmp_path / "run.zarr", steps=20_000, progress=progress)
    assert isinstance(stopped.value, KeyboardInterrupt)
    assert stopped.value.signal == signal.SIGTERM
    assert signal.getsignal(signal.SIGTERM) is before
    found = gs.record(gl3, **START, out=tmp_path / "run.zarr", steps=20_000, resume=True)
    np.testing.assert_array_equal(found.trajectory().q, gl3.integrate(**START, steps=20_000).q)


def test_runs_in_threads(gl3, tmp_path):
    """Signals are the main thread's; several runs at once are as good as one after another."""
    stores = [tmp_path / f"{number}.zarr" for number in range(3)]
    errors = []

    def work(store):
        try:
            gs.record(gl3, **START, out=store, steps=5000, every=3)
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=work, args=(store,)) for store in stores]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not errors
    for store in stores[1:]:
        assert_same_bytes(stores[0], store)


def test_run_that_was_done_before_says_so(gyrospark):
    """No step is left, so there is no time of one; the numbers are those of the store."""
    command = [*TOP, "--steps", "50", *OUT]
    first, said = (gyrospark(*command, "--json").document for _ in range(2))
    assert (said["ns_per_step"], said["done_before"], said["resumed_at"]) == (None, True, 50)
    assert "done_before" not in first
    for key in first.keys() - {"seconds", "ns_per_step"}:
        assert said[key] == first[key]
    text = gyrospark(*command).stdout
    assert "  done before: " in text
    assert "µs a step" not in text
    more = gyrospark(*TOP, "--steps", "80", *OUT).stdout
    assert " step 50\n" in more
    assert "µs a step" in more


# ---------------------------------------------------------------- two on one store


@pytest.mark.slow  # a real process; the lock is tested in this one too
def test_second_process_is_refused_and_a_dead_one_is_not_in_the_way(tmp_path):
    first = begin([*SLOW, *OUT], tmp_path)
    second = cli(*SLOW, *OUT, cwd=tmp_path, **FAST)
    assert first.poll() is None
    assert second.returncode == 2
    assert second.stdout == ""
    assert second.stderr.count("\n") == 1
    assert "Another process" in second.stderr
    first.kill()
    assert end(first)[0] == -signal.SIGKILL
    third = begin([*SLOW, *OUT], tmp_path)
    assert third.poll() is None
    third.send_signal(signal.SIGINT)
    assert end(third)[0] == 130


@pytest.mark.slow  # a real process; test_storage_resume.py reads after each commit
def test_reading_while_it_is_written(gl3, whole, tmp_path):
    """Every state that a reader sees is one of the run."""
    process = begin([*BEGUN, *OUT], tmp_path)
    exact = gs.open_recording(whole).trajectory().q  # of a longer run, with the same states
    seen = set()
    while process.poll() is None:
        found = gs.open_recording(tmp_path / "run.zarr")
        seen.add(found.states)
        if found.report is not None:
            np.testing.assert_array_equal(found.trajectory(thin=7).q, exact[: found.states : 7])
        time.sleep(0.02)
    assert end(process)[0] == 0
    assert seen
    np.testing.assert_array_equal(gs.open_recording(tmp_path / "run.zarr").trajectory().q,
                                  exact[:2001])


# ---------------------------------------------------------------- kill -9

EVERY_STEP = [*TOP, "--steps", "80000"]
PARTS_OF_BLOCKS = ["run", "fast-top", "--scheme", "EMS", "--rep", "alpha", "--dt", "1e-3",
                   "--steps", "200000", "--every", "7"]
MODEL_FILE = ["run", str(ROOT / "examples" / "dragged_top.toml"), "--scheme", "G-L",
              "--stages", "2", "--steps", "40000", "--every", "2"]
WATCHED = [*TOP, "--steps", "60000", "--every", "7", "--event", "q1=0.2 down", "--event", "p0=0",
           "--event", "high: q0=0.99999"]
KILLED = {"every step": (EVERY_STEP, "5"), "parts of blocks": (PARTS_OF_BLOCKS, "0.05"),
          "model file": (MODEL_FILE, "0.1"), "events": (WATCHED, "0.05")}


def killed(command, seconds, kills, folder, seed):
    """Kill a command that often; each time it ends, it must end with the same bytes."""
    folder.mkdir()
    done = call([sys.executable, HELPERS / "interruption.py", str(folder),
                 str(kills), str(seed), *command, "--out", "{store}"],
                KILLING_SECONDS=seconds, **FAST)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["kills"] == kills
    assert found["completed"] == found["same"] > 0
    assert not found["differing"]
    return found


@pytest.mark.slow  # five seconds each; test_storage_resume.py reads and resumes after each file
@pytest.mark.parametrize(("command", "seconds"), KILLED.values(), ids=KILLED.keys())
def test_killed_at_random(command, seconds, tmp_path):
    killed([*command, "--steps", "20000"], seconds, 1, tmp_path / "0", seed=0)


@pytest.mark.slow
@pytest.mark.parametrize(("command", "seconds"), KILLED.values(), ids=KILLED.keys())
def test_killed_200_times(command, seconds, tmp_path):
    for seed in range(1, 11):  # in parts, each of less time than a hang
        killed(command, seconds, 20, tmp_path / str(seed), seed)
