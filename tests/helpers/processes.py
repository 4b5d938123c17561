"""Starting gyrospark, compilers and Python in processes of their own."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import gyrospark
from warm_python import PATIENCE, WarmPython

ROOT = Path(gyrospark.__file__).resolve().parent
HELPERS, DATA = (ROOT / "tests" / name for name in ("helpers", "data"))

FAST_TOP = """
import gyrospark as gs
top = gs.problems.fast_top()
parameters = top.parameters | {"gamma": gs.gamma(top.inertia)}
"""


def environment(**changes: str | None) -> dict[str, str]:
    """Return this process's environment with changes; None takes a variable away."""
    merged = {**os.environ, "PYTHONWARNINGS": "error", **changes}
    return {name: value for name, value in merged.items() if value is not None}


def call(
    command: Sequence[str | Path], *, cwd: Path | None = None, **changes: str | None
) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, its output captured."""
    return subprocess.run(
        [str(word) for word in command], cwd=cwd, env=environment(**changes), text=True,
        capture_output=True, timeout=PATIENCE, check=False, stdin=subprocess.DEVNULL,
        encoding="utf-8", errors="surrogateescape",
    )


def python(code: str, *, cwd: Path | None = None, **changes: str | None) -> str:
    """Run Python code that must succeed in silence; return what it prints."""
    process = call([sys.executable, "-c", code], cwd=cwd, **changes)
    assert process.returncode == 0, process.stderr
    assert not process.stderr
    return process.stdout


@functools.cache
def _warm_python() -> WarmPython:
    return WarmPython(sys.executable, environment())


def warm_call(
    words: Sequence[str | Path], *, cwd: Path | None = None, **changes: str | None
) -> subprocess.CompletedProcess[str]:
    """Run ``python WORDS`` to its end, packages imported before it begins where that can be."""
    return _warm_python().call(words, environment(**changes), cwd=cwd)


def gyrospark_command(*arguments: str | Path) -> list[str]:
    """Return the command line of ``gyrospark ARGUMENTS``, console scripts installed or not."""
    return [sys.executable, "-m", "gyrospark", *map(str, arguments)]


def cli(
    *arguments: str | Path, cwd: Path | None = None, **changes: str | None
) -> subprocess.CompletedProcess[str]:
    """Run ``gyrospark ARGUMENTS`` as a process."""
    return warm_call(gyrospark_command(*arguments)[1:], cwd=cwd, **changes)


def catches(process: subprocess.Popen[str], number: int) -> bool:
    """Whether a process has a handler of its own for a signal, as far as the system tells."""
    try:
        status = Path(f"/proc/{process.pid}/status").read_text(encoding="ascii")
    except FileNotFoundError:  # no Linux, or it is over
        return True
    (caught,) = (line.split()[1] for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(caught, 16) >> (number - 1) & 1)


def wait_for(process: subprocess.Popen[str], has_happened: Callable[[], object]) -> None:
    """Wait until a process that runs has brought something about."""
    give_up = time.monotonic() + PATIENCE
    while not has_happened():
        assert process.poll() is None
        assert time.monotonic() < give_up
        time.sleep(0.01)


def installed(names: Mapping[str, str] | Sequence[str]) -> list[str]:
    """Return the programs that are on PATH."""
    return [name for name in names if shutil.which(name)]
