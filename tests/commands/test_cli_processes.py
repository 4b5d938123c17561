"""The command line as real processes: streams, terminals, signals, readers that go away."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gyrospark import __version__
from gyrospark.commands.generate import write_files
from processes import PATIENCE, ROOT, call, cli, environment, gyrospark_command, wait_for

IMS = ["run", "fast-top", "--scheme", "IMS", "--dt", "1e-3", "--steps", "5"]
FAILS = ["run", "fast-top", "--scheme", "G-L", "--stages", "2", "--dt", "1", "--steps", "20"]


def test_exit_codes_of_processes(tmp_path):
    """Real processes have the same codes, silence on the right stream, and no traceback."""
    good = cli(*IMS, "--json", cwd=tmp_path)
    assert (good.returncode, good.stderr) == (0, "")
    assert json.loads(good.stdout)["steps"] == 5
    bad = cli("run", "fast-top", "--scheme", "RK4", "--dt", "1", "--steps", "1", cwd=tmp_path)
    assert (bad.returncode, bad.stdout, bad.stderr.count("\n")) == (2, "", 1)
    failed = cli(*FAILS, "--solver", "auto,max_iterations=1", "--json", cwd=tmp_path)
    assert (failed.returncode, failed.stderr.count("\n")) == (1, 1)
    assert json.loads(failed.stdout)["failed"]["step"] == 1


def test_console_scripts(tmp_path):
    folder = Path(sys.executable).parent
    if not (folder / "generate").is_file():
        pytest.skip("the package is not installed, so there are no console scripts")
    done = call([folder / "generate", "--scheme", "IMS", "--system", PENDULUM[1], "--no-compile"],
                cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "generated" / "pendulum_ims.c").is_file()
    done = call([folder / "generate", "--scheme", "RK4"], cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith("generate: ")
    assert call([folder / "gyrospark", "--version"]).stdout.split()[-1] == __version__


def test_terminals_that_know_no_greek(tmp_path):
    setting = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0",
               "PYTHONIOENCODING": None}
    done = cli(*IMS, cwd=tmp_path, **setting)
    assert (done.returncode, done.stderr) == (0, "")
    done = cli(*IMS, "--gamma", "γ_m", cwd=tmp_path, **setting)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)


def test_reader_that_goes_away(tmp_path):
    """``gyrospark ... | head`` has no traceback, and no complaint at the end of Python."""
    process = subprocess.Popen(gyrospark_command(*IMS), stdout=subprocess.PIPE, cwd=tmp_path,
                               stderr=subprocess.PIPE, env=environment(), text=True)
    process.stdout.close()
    _, stderr = process.stdout, process.stderr.read()
    process.stderr.close()
    assert process.wait(PATIENCE) >= 0
    for word in ("Traceback", "Exception ignored", "Errno"):
        assert word not in stderr


def test_full_disk_behind_stdout(tmp_path):
    if not Path("/dev/full").exists():
        pytest.skip("there is no /dev/full")
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(gyrospark_command(*IMS), stdout=full, stderr=subprocess.PIPE,
                              cwd=tmp_path, env=environment(), text=True, timeout=PATIENCE,
                              check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "space" in done.stderr


def read_until(terminal, word, seconds=PATIENCE):
    """Return the output of a terminal until a word has appeared or it is closed."""
    text, end = b"", time.monotonic() + seconds
    while word not in text and time.monotonic() < end:
        try:
            chunk = os.read(terminal, 4096)
        except OSError:  # the other side is closed
            break
        if not chunk:
            break
        text += chunk
    return text


@pytest.mark.parametrize(("entry", "name"), [("main", "gyrospark"), ("main_generate", "generate")])
def test_interrupt_of_the_imports(entry, name):
    """Ctrl-C before there is anything to interrupt has the same short end."""
    code = (f"import sys\nfrom gyrospark.__main__ import {entry}\n"
            "class Interrupted:\n"
            "    def find_spec(self, name, *rest):\n"
            "        if name == 'gyrospark.commands': raise KeyboardInterrupt\n"
            f"sys.meta_path.insert(0, Interrupted())\n{entry}()")
    done = call([sys.executable, "-c", code])
    assert (done.returncode, done.stdout, done.stderr) == (130, "", f"\n{name}: Interrupted.\n")


def test_interrupt_of_a_read_from_a_store():
    """Zarr reads in a loop of its own; reads that are pending there print nothing."""
    code = ("import asyncio, os, signal, sys, threading\n"
            "from gyrospark import commands\n"
            "from zarr.core.sync import sync\n"
            "async def read(): await asyncio.gather(asyncio.sleep(99), asyncio.sleep(99))\n"
            "def export(**options):\n"
            "    threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()\n"
            "    sync(read())\n"
            "commands.gyrospark.get_command(None, 'export').callback = export\n"
            "sys.argv = ['gyrospark', 'export', 'run.zarr', 'run.csv']\n"
            "commands.main()")
    done = call([sys.executable, "-c", code])
    assert (done.returncode, done.stdout, done.stderr.strip()) == (
        130, "", "gyrospark: Interrupted.")


PENDULUM = ["run", str(ROOT / "examples" / "pendulum.toml"), "--scheme", "IMS", "--steps", "5"]


@pytest.mark.slow  # derived and compiled for this; test_progress.py tests messages
def test_first_compile_is_said_on_a_terminal(tmp_path):
    """The terminal names each derivation and compilation, at first without, then with its time."""
    terminal, process_end = pty.openpty()
    process = subprocess.Popen(
        gyrospark_command(*PENDULUM), stdout=subprocess.PIPE, stderr=process_end, cwd=tmp_path,
        env=environment(TERM="xterm", COLUMNS="100", GYROSPARK_CACHE=str(tmp_path / "cache")),
        stdin=subprocess.DEVNULL)
    os.close(process_end)
    with process.stdout as stream:
        shown = read_until(terminal, b"no such word").decode()
        printed = stream.read().decode()
    os.close(terminal)
    assert process.wait(PATIENCE) == 0, shown
    for name in (r"deriving \S+pendulum\.toml", r"derived \S+pendulum\.toml in [\d.]+ s",
                 "compiling pendulum_ims", r"compiled pendulum_ims in [\d.]+ s"):
        assert re.search(name, shown.replace("\r\n", "")), shown
    assert printed.startswith("pendulum ")
    assert "\x1b" not in printed


def test_interrupt_of_derivation(tmp_path):
    """Ctrl-C while SymPy works has the same short end, and leaves no incomplete file."""
    process = subprocess.Popen(  # ten seconds of deriving after the first file
        gyrospark_command("generate", "--all", "--no-compile", "--out", "made"),
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, cwd=tmp_path, env=environment(),
        text=True)
    wait_for(process, lambda: list(tmp_path.glob("made/*.h")))
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=PATIENCE)
    assert (process.returncode, stderr.strip()) == (130, "gyrospark: Interrupted.")
    for path in (tmp_path / "made").iterdir():
        generated = ROOT / "generated" / path.name
        assert not generated.is_file() or path.read_bytes() == generated.read_bytes()


def test_interrupt_of_text_that_is_executed(tmp_path):
    """Python keeps an interrupt of ``exec``, which SymPy calls, until its own end."""
    (tmp_path / "interrupted.py").write_text(
        "from gyrospark import commands\n"
        "def main(**options): exec('raise KeyboardInterrupt')\n"
        "commands.gyrospark.main = main\n"
        "commands.main()\n", "utf-8")
    done = call([sys.executable, "-m", "interrupted"], cwd=tmp_path)
    assert (done.returncode, done.stderr.strip()) == (130, "gyrospark: Interrupted.")


@pytest.mark.parametrize("call", ["write_text", "replace"])
def test_interrupt_of_a_write_leaves_no_part_of_a_file(tmp_path, monkeypatch, call):
    """Ctrl-C comes at any instant, also between the writing of a file and its renaming."""
    done = getattr(Path, call)

    def interrupted(*arguments, **options):
        if call == "write_text":
            done(*arguments, **options)
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, call, interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_files({"stepper.h": "int x;"}, tmp_path)
    assert not list(tmp_path.iterdir())
