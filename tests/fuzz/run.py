"""Feed every entrance with numbered inputs; print a line for each entrance; keep what fails.

    python tests/fuzz/run.py --inputs 1200000 --seed 1
    python tests/fuzz/run.py --replay fuzz-failures/model-17.bin --entrance model

Each entrance runs in a process of its own, which says a line for each input; one that crashes or no
longer answers is noted with its input and started again behind it. Exit code 1 if anything failed.
"""

from __future__ import annotations

import argparse
import faulthandler
import os
import subprocess
import sys
import warnings
from collections import Counter
from pathlib import Path

TESTS = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(TESTS), str(TESTS / "helpers")]
os.environ.setdefault("GYROSPARK_OPTIMISE", "1")

from fuzz.judging import Failure, judge, random_input, shrunk  # noqa: E402

#: A worker that takes so much longer than an input may take ends itself.
GRACE = 15.0


def work(options: argparse.Namespace) -> None:
    """Try inputs in this process; write the outcome of each to stdout."""
    from fuzz.entrances import ENTRANCES

    entrance, keys = ENTRANCES[options.entrance], set[str]()
    warnings.simplefilter("error")  # nor shall a warning reach the user
    output = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # prints of an entrance are not for the parent

    def failure_of(data: bytes) -> Failure | None:
        faulthandler.dump_traceback_later(entrance.seconds + GRACE, exit=True)
        return judge(entrance.check, data, entrance.seconds).failure

    for number in range(options.first, options.inputs):
        data = random_input(entrance.name, options.seed, number)
        faulthandler.dump_traceback_later(entrance.seconds + GRACE, exit=True)
        verdict = judge(entrance.check, data, entrance.seconds)
        if (failure := verdict.failure) is not None and failure.key not in keys:
            keys.add(failure.key)
            if failure.kind != "HangError":
                data = shrunk(data, lambda d, key=failure.key: (
                    getattr(failure_of(d), "key", None) == key))
            save(options, number, data, failure)
        os.write(output, f"{verdict.outcome}\n".encode())


def save(options: argparse.Namespace, number: int, data: bytes, failure: Failure) -> None:
    """Write an input that fails, with its traceback beside it."""
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / f"{options.entrance}-{number}.bin"
    path.write_bytes(data)
    path.with_suffix(".txt").write_text(f"{failure.key}\n{failure.text}", encoding="utf-8",
                                        errors="backslashreplace")


def run_entrance(options: argparse.Namespace) -> Counter[str]:
    """Return the outcomes of the inputs, tried by one worker after the other."""
    outcomes: Counter[str] = Counter()
    while (tried := outcomes.total()) < options.inputs:
        command = [sys.executable, __file__, "--worker", "--entrance", options.entrance, "--seed",
                   str(options.seed), "--inputs", str(options.inputs), "--first", str(tried),
                   "--out", str(options.out)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            outcomes.update(line.strip() for line in process.stdout or ())
        if process.returncode:
            number, end = outcomes.total(), f"crash {process.returncode}"
            save(options, number, random_input(options.entrance, options.seed, number),
                 Failure(end, "the worker", end))
            outcomes["crashed"] += 1
    return outcomes


def main() -> int:
    """Run the command line of this file."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=100_000, help="of all entrances together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--entrance", help="only this one")
    parser.add_argument("--out", type=Path, default=Path("fuzz-failures"),
                        help="folder for inputs that fail")
    parser.add_argument("--replay", type=Path, help="try one input of --entrance, and say more")
    parser.add_argument("--first", type=int, default=0, help=argparse.SUPPRESS)
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        work(options)
        return 0
    from fuzz.entrances import ENTRANCES

    if options.replay is not None:
        warnings.simplefilter("error")
        entrance = ENTRANCES[options.entrance]
        verdict = judge(entrance.check, options.replay.read_bytes(), entrance.seconds)
        print(verdict.outcome, f"{verdict.seconds:.3f} s", verdict.failure or "")
        return 0 if verdict.failure is None else 1
    chosen = [ENTRANCES[options.entrance]] if options.entrance else [*ENTRANCES.values()]
    total, shares, failed = options.inputs, sum(e.share for e in chosen), 0
    for entry in chosen:
        options.entrance, options.inputs = entry.name, max(1, round(total * entry.share / shares))
        outcomes = run_entrance(options)
        failed += outcomes["failed"] + outcomes["crashed"]
        print(f"{entry.name}: {options.inputs:,} inputs:", ", ".join(
            f"{kind} {count:,}" for kind, count in sorted(outcomes.items())), flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
