"""Feed every entrance with inputs; print a table; keep what fails.

    python tests/fuzz/run.py --inputs 1200000 --seed 1
    python tests/fuzz/run.py --inputs 20000 --entrance model --engine atheris
    python tests/fuzz/run.py --replay fuzz-failures/model-0.bin --entrance model

Each entrance runs in a process of its own; one that crashes or no longer answers is noted with its
input and started again behind it. Exit code 1 if anything failed.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import mmap
import os
import re
import selectors
import struct
import subprocess
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

TESTS = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(TESTS), str(TESTS / "helpers")]
os.environ.setdefault("GYROSPARK_OPTIMISE", "1")

from fuzz.judging import Failure, Verdict, corpus, judge, random_input, shrunk  # noqa: E402

#: Bytes of the file in which a worker notes the input it is about to try.
NOTE = 2**16
#: A worker that says nothing for so much longer than an input may take is stopped.
GRACE = 15.0


@dataclass
class Tally:
    """What is known of one entrance so far."""

    done: int = 0
    seconds: float = 0.0
    slowest: float = 0.0
    outcomes: Counter[str] = field(default_factory=Counter)
    failures: dict[str, tuple[bytes, str]] = field(default_factory=dict)
    failed: int = 0

    def add(self, data: bytes, verdict: Verdict) -> None:
        self.done += 1
        self.seconds += verdict.seconds
        self.slowest = max(self.slowest, verdict.seconds)
        if verdict.failure is None:
            self.outcomes[verdict.outcome] += 1
        else:
            self.failed += 1
            self.keep(data, verdict.failure)

    def keep(self, data: bytes, failure: Failure) -> None:
        known = self.failures.get(failure.key)
        if known is None or len(data) < len(known[0]):
            self.failures[failure.key] = data, failure.text

    def merge(self, news: dict[str, Any]) -> None:
        self.done += news["done"]
        self.seconds += news["seconds"]
        self.slowest = max(self.slowest, news["slowest"])
        self.outcomes.update(news["outcomes"])
        self.failed += news["failed"]
        for key, (data, text) in news["failures"].items():
            found = bytes.fromhex(data)
            if key not in self.failures or len(found) < len(self.failures[key][0]):
                self.failures[key] = found, text

    def as_json(self) -> str:
        return json.dumps({
            "done": self.done, "seconds": self.seconds, "slowest": self.slowest,
            "outcomes": self.outcomes, "failed": self.failed,
            "failures": {k: (d.hex(), t) for k, (d, t) in self.failures.items()}})


# ---------------------------------------------------------------- the worker


class Worker:
    """Tries inputs in this process; tells the parent about them on stdout, a line now and then."""

    def __init__(self, name: str, note: Path) -> None:
        from fuzz.entrances import ENTRANCES

        warnings.simplefilter("error")  # nor shall a warning reach the user
        self.entrance = ENTRANCES[name]
        self.stream = os.fdopen(os.dup(1), "w")  # what an entrance prints is not for the parent
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        self.tally, self.told = Tally(), time.perf_counter()
        with note.open("r+b") as file:
            self.note = mmap.mmap(file.fileno(), NOTE)

    def attempt(self, data: bytes) -> None:
        data = data[: NOTE - 4]
        self.note[: 4 + len(data)] = struct.pack("<I", len(data)) + data
        verdict = judge(self.entrance.check, data, self.entrance.seconds)
        new = verdict.failure is not None and verdict.failure.key not in self.tally.failures
        self.tally.add(data, verdict)
        if new and verdict.failure is not None and verdict.failure.kind != "HangError":
            key = verdict.failure.key
            small = shrunk(data, lambda d: self.fails_alike(d, key))
            again = judge(self.entrance.check, small, self.entrance.seconds).failure
            self.tally.keep(small, again or verdict.failure)
            self.tally.failures.setdefault(key, (small, verdict.failure.text))
        if time.perf_counter() - self.told > 0.3:
            self.tell()

    def fails_alike(self, data: bytes, key: str) -> bool:
        failure = judge(self.entrance.check, data, self.entrance.seconds).failure
        return failure is not None and failure.key == key

    def tell(self) -> None:
        self.stream.write(self.tally.as_json() + "\n")
        self.stream.flush()
        self.tally, self.told = Tally(failures=dict.fromkeys(self.tally.failures, (b"", ""))), (
            time.perf_counter())
        self.tally.failures = {}


def work(options: argparse.Namespace) -> None:
    """Be a worker: numbered random inputs, or what atheris makes of the corpus."""
    if options.engine == "atheris":
        work_guided(options)
        return
    worker = Worker(options.entrance, options.note)
    for number in range(options.first, options.inputs):
        worker.attempt(random_input(options.entrance, options.seed, number))
    worker.tell()


def work_guided(options: argparse.Namespace) -> None:
    """Let libFuzzer choose the inputs, guided by the coverage of the package's Python code."""
    import atheris

    with atheris.instrument_imports(include=["gyrospark"]):
        worker = Worker(options.entrance, options.note)
    seeds = options.note.with_suffix(".seeds")
    seeds.mkdir(exist_ok=True)
    for number in range(200):
        (seeds / str(number)).write_bytes(random_input(options.entrance, options.seed, number))
    for path in corpus(options.entrance):
        (seeds / path.name).write_bytes(path.read_bytes())
    left = options.inputs - options.first

    def one(data: bytes) -> None:
        nonlocal left
        worker.attempt(data)
        left -= 1
        if left <= 0:
            worker.tell()

    atheris.Setup([sys.argv[0], f"-runs={left}", f"-seed={options.seed + options.first + 1}",
                   "-max_len=600", "-timeout=0", "-rss_limit_mb=0", "-verbosity=0", str(seeds)],
                  one)
    atheris.Fuzz()


# ---------------------------------------------------------------- the parent


def run_entrance(
    name: str, inputs: int, options: argparse.Namespace, tally: Tally,
    advance: Callable[[int], None],
) -> None:
    """Add up what workers find, one after the other until all inputs are done."""
    from tempfile import TemporaryDirectory

    from fuzz.entrances import ENTRANCES

    silence = ENTRANCES[name].seconds + GRACE
    with TemporaryDirectory(prefix="gyrospark-fuzz-") as folder:
        note = Path(folder) / "note"
        note.write_bytes(bytes(NOTE))
        while tally.done < inputs:
            command = [sys.executable, str(Path(__file__)), "--worker", "--entrance", name,
                       "--engine", options.engine, "--seed", str(options.seed), "--inputs",
                       str(inputs), "--first", str(tally.done), "--note", str(note)]
            before = tally.done
            end = follow(command, tally, silence, advance)
            if tally.done >= inputs:
                break
            size = struct.unpack("<I", note.read_bytes()[:4])[0]
            data = note.read_bytes()[4 : 4 + size]
            tally.failed += 1
            tally.keep(data, Failure(end, "the worker", f"{end} after {tally.done} inputs"))
            # What was done since the last line is not known to us: do those once more, from the
            # line after; where nothing at all came, skip one.
            skipped = skip_to(name, options, before, tally.done, data)
            advance(skipped - tally.done)
            tally.done = skipped


def skip_to(name: str, options: argparse.Namespace, before: int, done: int, data: bytes) -> int:
    """Return the number behind the input that ended a worker."""
    if options.engine == "random":
        for number in range(done, done + 200_000):
            if random_input(name, options.seed, number) == data:
                return number + 1
    return max(done, before) + 1


def follow(
    command: list[str], tally: Tally, silence: float, advance: Callable[[int], None]
) -> str:
    """Add up what a worker says until it ends; return how it ended."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    said: list[str] = []
    with selectors.DefaultSelector() as selector:
        assert process.stdout is not None
        assert process.stderr is not None
        for stream in (process.stdout, process.stderr):
            os.set_blocking(stream.fileno(), False)
        selector.register(process.stdout, selectors.EVENT_READ, "")
        selector.register(process.stderr, selectors.EVENT_READ, None)
        rest, heard = "", time.monotonic()
        while selector.get_map():
            for key, _ in selector.select(timeout=1):
                chunk = os.read(key.fd, 2**16)
                if not chunk:
                    selector.unregister(key.fileobj)
                elif key.data is None:
                    said = [*said, chunk.decode(errors="replace")][-20:]
                else:
                    heard = time.monotonic()
                    *lines, rest = (rest + chunk.decode()).split("\n")
                    for line in lines:
                        news = json.loads(line)
                        tally.merge(news)
                        advance(news["done"])
            if time.monotonic() - heard > silence:
                process.kill()
                process.wait()
                return "no answer"
    code = process.wait()
    if code:
        print("".join(said)[-2000:], file=sys.stderr)
    return f"crash ({code})"


def save(name: str, tally: Tally, folder: Path) -> Iterator[str]:
    """Write every failing input with its traceback beside it; yield a line about each."""
    for number, (key, (data, text)) in enumerate(tally.failures.items()):
        folder.mkdir(parents=True, exist_ok=True)
        stem = f"{name}-{number}-{re.sub('[^A-Za-z0-9]+', '_', key)[:60]}"
        (folder / f"{stem}.bin").write_bytes(data)
        (folder / f"{stem}.txt").write_text(text, encoding="utf-8", errors="backslashreplace")
        yield f"{name}: {key}: {folder / stem}.bin ({len(data)} bytes)"


def main() -> int:
    """Run the command line of this file."""
    options = arguments()
    if options.worker:
        work(options)
        return 0
    from fuzz.entrances import ENTRANCES

    if options.replay is not None:
        warnings.simplefilter("error")
        verdict = judge(ENTRANCES[options.entrance].check, options.replay.read_bytes(),
                        ENTRANCES[options.entrance].seconds)
        print(verdict.outcome, f"{verdict.seconds:.3f} s", verdict.failure or "")
        return 0 if verdict.failure is None else 1
    chosen = [ENTRANCES[options.entrance]] if options.entrance else [
        e for e in ENTRANCES.values() if e.guided or options.engine == "random"]
    shares = sum(e.share for e in chosen)
    return report({e.name: max(1, round(options.inputs * e.share / shares)) for e in chosen},
                  options)


def report(wanted: dict[str, int], options: argparse.Namespace) -> int:
    """Run the entrances with a progress bar and print the table."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn
    from rich.table import Table

    console = Console()
    table = Table(title=f"seed {options.seed}, engine {options.engine}", title_justify="left")
    for heading in ("entrance", "inputs", "seconds", "slowest", "accepted", "refused", "failed"):
        table.add_column(heading, justify="left" if heading in ("entrance", "refused") else "right",
                         overflow="fold")
    lines: list[str] = []
    columns = ("{task.description:>12}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        for name, inputs in wanted.items():
            task = bar.add_task(name, total=inputs)
            tally = Tally()
            with contextlib.suppress(KeyboardInterrupt):  # on to the next; what was done counts
                run_entrance(name, inputs, options, tally,
                             lambda n, task=task: bar.update(task, advance=n))
            refused = ", ".join(f"{kind} {count:,}" for kind, count in sorted(
                tally.outcomes.items()) if kind != "accepted")
            table.add_row(name, f"{tally.done:,}", f"{tally.seconds:.0f}", f"{tally.slowest:.2f}",
                          f"{tally.outcomes['accepted']:,}", refused, f"{tally.failed:,}")
            lines += save(name, tally, options.out)
    console.print(table)
    for line in lines:
        print(line)
    return 1 if lines else 0


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=100_000, help="of all entrances together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--entrance", help="only this one")
    parser.add_argument("--engine", choices=("random", "atheris"), default="random")
    parser.add_argument("--out", type=Path, default=Path("fuzz-failures"),
                        help="folder for inputs that fail")
    parser.add_argument("--replay", type=Path, help="try one input of --entrance, and say more")
    for hidden in ("--first", "--note", "--worker"):
        parser.add_argument(hidden, help=argparse.SUPPRESS, **(
            {"action": "store_true"} if hidden == "--worker"
            else {"type": Path} if hidden == "--note" else {"type": int, "default": 0}))
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
