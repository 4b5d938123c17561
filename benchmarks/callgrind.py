"""Instructions of one step, counted by valgrind: a guard for the speed that no load disturbs.

    count(N) of a process at N = 20 and N = 120 steps; a step = the difference / 100

The steppers are the plain C that is exported, for any x86-64 (-O2, no contraction, no -march), so
that one gcc of one major version makes the same code everywhere. ``instructions.json`` holds the
counts; ``pytest tests/benchmarks/test_instructions.py --update`` makes them again.
"""

from __future__ import annotations

import json
import platform
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

__all__ = ["ALLOWED", "FLAGS", "PATH", "STEPPERS", "Counter", "count_step", "find_counter",
           "recorded", "write"]

PATH = Path(__file__).resolve().parent / "instructions.json"
_MAIN = Path(__file__).resolve().parent / "count_steps.c"
#: For any x86-64.
FLAGS = ("-std=c11", "-O2", "-ffp-contract=off")
#: Relative change of a count that is no regression.
ALLOWED = 0.05
_FEW, _MANY = 20, 120
#: Scheme, stages, representation.
STEPPERS = (
    ("G-L", 1, "gamma"), ("G-L", 2, "gamma"), ("G-L", 3, "gamma"), ("G-L", 4, "gamma"),
    ("G-L", 3, "alpha"), ("LIIIA-B", 3, "gamma"), ("EMS", None, "gamma"),
)


@dataclass(frozen=True)
class Counter:
    """Counter of instructions: versions of gcc and valgrind, or ``missing``, a sentence."""

    gcc: str = ""
    major: str = ""
    missing: str = ""


def find_counter(version: str | None = None) -> Counter:
    """Return gcc of a major version, any without one, or why there is no counting here."""
    if platform.machine() not in ("x86_64", "AMD64"):
        return Counter(missing=f"Instructions are counted on x86-64, not {platform.machine()}.")
    if shutil.which("valgrind") is None:
        return Counter(missing="There is no valgrind here.")
    for name in ("gcc", f"gcc-{version}"):
        path = shutil.which(name)
        if path is None:
            continue
        major = _output([path, "-dumpversion"]).partition(".")[0].strip()
        if version in (None, major):
            return Counter(path, major)
    return Counter(missing=f"There is no gcc {version or ''}".rstrip() + " here.")


def recorded() -> dict[str, Any]:
    """Return the checked-in counts: ``gcc``, ``flags`` and ``steps`` by name; empty without any."""
    if not PATH.is_file():
        return {}
    content: dict[str, Any] = json.loads(PATH.read_text(encoding="utf-8"))
    return content


def write(counter: Counter, steps: dict[str, float]) -> None:
    """Check in new counts."""
    content = {"gcc": counter.major, "flags": " ".join(FLAGS),
               "steps": {name: round(count) for name, count in sorted(steps.items())}}
    PATH.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def count_step(counter: Counter, scheme: str, stages: int | None, rep: str) -> tuple[str, float]:
    """Return a stepper's name and the instructions of one of its steps."""
    with TemporaryDirectory(prefix="gyrospark-count-") as folder:
        number = [] if stages is None else ["--stages", str(stages)]
        _output([sys.executable, "-m", "gyrospark", "generate", "--scheme", scheme, *number,
                 "--rep", rep, "--standalone", "--no-compile", "--out", folder])
        header, = Path(folder).glob("*.h")
        program = _build(counter, header.stem, rep, Path(folder))
        few_count, many_count = (_count(program, steps) for steps in (_FEW, _MANY))
    return header.stem, (many_count - few_count) / (_MANY - _FEW)


def _build(counter: Counter, name: str, rep: str, folder: Path) -> Path:
    program = folder / "count"
    definitions = [f"-DSTEPPER={name}", f'-DHEADER="{name}.h"',
                   *(["-DALPHA"] if rep == "alpha" else [])]
    _output([counter.gcc, *FLAGS, *definitions, f"-I{folder}", str(_MAIN),
             str(folder / f"{name}.c"), "-lm", "-o", str(program)])
    return program


def _count(program: Path, steps: int) -> int:
    """Return the instructions of a process that takes ``steps`` steps."""
    output = _output(["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null",
                      str(program), str(steps)])
    match = re.search(r"Collected\s*:\s*(\d+)", output)
    if match is None:
        raise RuntimeError(f"valgrind says no count: {output}")
    return int(match.group(1))


def _output(command: list[str]) -> str:
    """Run a command and return its stdout and stderr; raises RuntimeError if it fails."""
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    if process.returncode:
        raise RuntimeError(f"{command[0]} failed: {process.stderr}")
    return process.stdout + process.stderr
