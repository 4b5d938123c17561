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
from calls import integrate
from processes import (
    HELPERS,
    PATIENCE,
    ROOT,
    call,
    catches,
    environment,
    gyrospark_command,
    wait_for,
)
from stores import START, assert_same_bytes, record

pytestmark = pytest.mark.skipif(os.name == "nt", reason="POSIX signals")

#: For processes of many steps.
FAST = {"GYROSPARK_OPTIMISE": "1"}

TOP = ["run", "fast-top", "--scheme", "G-L", "--stages", "3", "--dt", "1e-3"]
#: Minutes: there is time to end it in the middle, on the slowest machine.
LONG = [*TOP, "--steps", "2000000000", "--every", "500"]
OUT = ["--out", "run.zarr", "--resume"]


def begin(command, folder):
    """Start a command; return when it has its store and hears signals."""
    process = subprocess.Popen(
        gyrospark_command(*command), cwd=folder, env=environment(), text=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    wait_for(process, lambda: (folder / "run.zarr").exists() and catches(process, signal.SIGTERM))
    time.sleep(0.1)  # from there to the first step
    return process


def end(process):
    """Return a process's exit code, stdout and stderr."""
    stdout, stderr = process.communicate(timeout=PATIENCE)
    assert "Traceback" not in stderr
    return process.returncode, stdout, stderr


def test_signal_ends_a_run_at_a_commit(tmp_path):
    """The message names the step of the end, and the store has all steps up to it."""
    process = begin([*LONG, *OUT], tmp_path)
    process.send_signal(signal.SIGINT)
    code, stdout, stderr = end(process)
    assert code == 130
    stored = gs.load(tmp_path / "run.zarr")
    assert stored.status == "running"
    assert stored.steps_done < 2_000_000_000
    assert stored.states == stored.steps_done // 500 + 1
    assert stderr.count("\n") == 1
    assert f"{stored.steps_done:,} of 2,000,000,000" in stderr
    assert "--resume" in stderr
    assert f"{stored.steps_done:,} steps of 0.001 s" in stdout


def test_an_ignored_signal_does_not_end_a_run(gl3, tmp_path):
    """The signal is ignored, as under nohup; the handler stays as it was."""
    handler = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        run = record(gl3, **START, out=tmp_path / "run.zarr", steps=100,
                        progress=lambda done: os.kill(os.getpid(), signal.SIGHUP))
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, handler)
    assert run.status == "complete"


def test_signal_after_the_last_step_loses_nothing(gl3, tmp_path):
    """The run is complete, says so, and its caller's handlers are back in place."""
    handler = signal.getsignal(signal.SIGINT)

    def progress(done):
        if done == 5000:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(gs.errors.Stopped, match=r"5,000.*complete") as end:
        record(gl3, **START, out=tmp_path / "run.zarr", steps=5000, progress=progress)
    assert "--resume" not in str(end.value)
    assert gs.load(tmp_path / "run.zarr").status == "complete"
    assert signal.getsignal(signal.SIGINT) is handler


def test_stopped_says_where(gl3, tmp_path):
    """In Python a signal is a ``Stopped``, which is a ``KeyboardInterrupt``."""
    def progress(done):
        os.kill(os.getpid(), signal.SIGTERM)

    handler = signal.getsignal(signal.SIGTERM)
    with pytest.raises(gs.errors.Stopped, match="16 of 20,000") as stopped:
        record(gl3, **START, out=tmp_path / "run.zarr", steps=20_000, progress=progress)
    assert isinstance(stopped.value, KeyboardInterrupt)
    assert stopped.value.signal == signal.SIGTERM
    assert signal.getsignal(signal.SIGTERM) is handler
    recording = record(gl3, **START, out=tmp_path / "run.zarr", steps=20_000, resume=True)
    np.testing.assert_array_equal(recording[:].q, integrate(gl3, **START, steps=20_000).q)


def test_runs_in_threads(gl3, tmp_path):
    """Only the main thread has signals; several runs at once are as good as one after another."""
    stores = [tmp_path / f"{number}.zarr" for number in range(3)]
    errors = []

    def work(store):
        try:
            record(gl3, **START, out=store, steps=5000, every=3)
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
    """No step remains, so the time of a step is None; the numbers come from the store."""
    command = [*TOP, "--steps", "50", *OUT]
    first, repeated = (gyrospark(*command, "--json").document for _ in range(2))
    assert (repeated["ns_per_step"], repeated["done_before"], repeated["resumed_at"]) == (
        None, True, 50)
    assert "done_before" not in first
    for key in first.keys() - {"seconds", "ns_per_step"}:
        assert repeated[key] == first[key]
    text = gyrospark(*command).stdout
    assert "  done before: " in text
    assert "µs a step" not in text
    continued = gyrospark(*TOP, "--steps", "80", *OUT).stdout
    assert " step 50\n" in continued
    assert "µs a step" in continued


EVERY_STEP = [*TOP, "--steps", "80000"]
PARTS_OF_BLOCKS = ["run", "fast-top", "--scheme", "EMS", "--rep", "alpha", "--dt", "1e-3",
                   "--steps", "200000", "--every", "7"]
MODEL_FILE = ["run", str(ROOT / "examples" / "dragged_top.toml"), "--scheme", "G-L",
              "--stages", "2", "--steps", "40000", "--every", "2"]
WATCHED = [*TOP, "--steps", "60000", "--every", "7", "--event", "q1=0.2 down", "--event", "p0=0",
           "--event", "high: q0=0.99999"]
#: Impacts faster and faster until they are not resolved, in the last tenth of these steps.
CASCADE = ["run", str(ROOT / "tests" / "data" / "dropped.toml"), "--scheme", "G-L",
           "--stages", "2", "--dt", "1e-4", "--steps", "90000", "--every", "7"]
KILLED = {"every step": (EVERY_STEP, "5"), "parts of blocks": (PARTS_OF_BLOCKS, "0.05"),
          "model file": (MODEL_FILE, "0.1"), "events": (WATCHED, "0.05"),
          "cascade": (CASCADE, "0.05")}


def killed(command, seconds, kills, folder, seed):
    """Kill a command that often; each time it ends, it must end with the same bytes."""
    folder.mkdir()
    process = call([sys.executable, HELPERS / "interruption.py", str(folder),
                    str(kills), str(seed), *command, "--out", "{store}"],
                   KILLING_SECONDS=seconds, **FAST)
    assert process.returncode == 0, process.stderr
    outcome = json.loads(process.stdout)
    assert outcome["kills"] == kills
    assert outcome["completed"] == outcome["same"] > 0
    assert not outcome["differing"]
    return outcome


@pytest.mark.slow
@pytest.mark.parametrize(("command", "seconds"), KILLED.values(), ids=KILLED.keys())
def test_killed_200_times(command, seconds, tmp_path):
    for seed in range(1, 11):  # in parts, each of less time than a hang
        killed(command, seconds, 20, tmp_path / str(seed), seed)
