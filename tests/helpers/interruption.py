"""Kills a command with SIGKILL at random instants, and resumes it, until it has ended.

    python tests/helpers/interruption.py FOLDER KILLS SEED COMMAND...

``{store}`` in the command is the store it writes; ``--resume`` is added. The command runs in a
fork of a process that has imported everything, so that an instant is one of the work, seldom of
Python's start. After each kill the store is opened as a user would; each time the command comes to
its end, the store's bytes are compared with those of an uninterrupted run. Prints a JSON document.

KILLING_SECONDS in the environment is the time between two commits, KILLING_ROWS the states of a
block, KILLING_WORK the least work of a sweep's tile; KILLING_ALOUD lets the commands say on stderr
what they have to say.
"""

from __future__ import annotations

import contextlib
import filecmp
import json
import os
import random
import shutil
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path


def start(work: Callable[[], None]) -> int:
    """Begin work in a process of its own, without a word; return its number."""
    number = os.fork()
    if number:
        return number
    code = 1
    try:
        nowhere = os.open(os.devnull, os.O_RDWR)
        os.dup2(nowhere, 1)
        if "KILLING_ALOUD" not in os.environ:
            os.dup2(nowhere, 2)
        work()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        os._exit(code)


def ended(number: int) -> int | None:
    """Return the exit code of a process that has ended, else None."""
    ended_number, status = os.waitpid(number, os.WNOHANG)
    return os.waitstatus_to_exitcode(status) if ended_number else None


def finish(work: Callable[[], None]) -> None:
    """Do work in a process of its own, which must end well."""
    number = start(work)
    code = os.waitstatus_to_exitcode(os.waitpid(number, 0)[1])
    if code != 0:
        raise SystemExit(f"the work ended with exit code {code}")


def run(command: list[str]) -> None:
    from gyrospark import commands

    sys.argv = ["gyrospark", *command]
    commands.main()


def look(store: Path) -> None:
    """Open a store that a killed process left, as a user would."""
    import xarray

    with xarray.open_zarr(store) as dataset:
        for array in dataset.variables.values():
            array[:1].load()


def differences(folder: Path, other_folder: Path) -> list[str]:
    """Return the files that are not the same in two folders."""
    names = {str(p.relative_to(root)) for root in (folder, other_folder) for p in root.rglob("*")
             if p.is_file()}
    return sorted(name for name in names
                  if not ((folder / name).is_file() and (other_folder / name).is_file()
                          and filecmp.cmp(folder / name, other_folder / name, shallow=False)))


def kill_at_random(folder: Path, kills: int, seed: int, command: list[str]) -> dict[str, object]:
    """Return counts of kills and of runs that ended, and the files that differ."""
    uninterrupted, store = folder / "whole.zarr", folder / "killed.zarr"

    def arguments(path: Path) -> list[str]:
        return [word.replace("{store}", str(path)) for word in command]

    began = time.perf_counter()
    finish(lambda: run(arguments(uninterrupted)))
    seconds = time.perf_counter() - began
    instants = random.Random(seed)
    killed = readable = completed = equal = 0
    wrong: list[str] = []
    while killed < kills or store.exists() or not completed:
        number, code = start(lambda: run([*arguments(store), "--resume"])), None
        if killed < kills:
            pause = instants.uniform(0, seconds)
            time.sleep(pause)
            code = ended(number)
            if code is None:
                os.kill(number, signal.SIGKILL)
                os.waitpid(number, 0)
                killed += 1
                if store.exists():
                    finish(lambda: look(store))
                    readable += 1
                continue
            seconds = min(seconds, pause)  # the first derived and compiled
        else:
            code = os.waitstatus_to_exitcode(os.waitpid(number, 0)[1])
        if code != 0:
            raise SystemExit(f"a run that was gone on with ended with exit code {code}")
        completed += 1
        differing = differences(uninterrupted, store)
        equal += not differing
        wrong += differing
        shutil.rmtree(store)
    return {"kills": killed, "readable": readable, "completed": completed, "same": equal,
            "differing": wrong, "seconds": seconds}


def main() -> None:
    folder, kills, seed, *command = sys.argv[1:]
    import gyrospark.commands.run.command  # before the forks
    import gyrospark.commands.sweep
    import gyrospark.storage.record
    import gyrospark.sweeps.tiles

    gyrospark.storage.array_layout._MOST_ROWS = int(os.environ.get("KILLING_ROWS", 2**14))
    if "KILLING_SECONDS" in os.environ:
        gyrospark.storage.recorder.COMMIT_SECONDS = float(os.environ["KILLING_SECONDS"])
    if "KILLING_WORK" in os.environ:
        gyrospark.sweeps.tiles._LEAST_STORED = int(os.environ["KILLING_WORK"])
    with contextlib.suppress(ImportError):
        import xarray  # noqa: F401
    print(json.dumps(kill_at_random(Path(folder), int(kills), int(seed), command)))


if __name__ == "__main__":
    main()
