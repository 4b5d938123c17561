"""Mutation: change one place of the code, run the tests that execute it, see whether one fails.

    python mutation.py map                   which tests execute which line (needs coverage)
    python mutation.py run --mutants 300     take mutants at random, write log.jsonl, resume
    python mutation.py run --again           the survivors of the log, after a test was added
    python mutation.py table                 share caught by package, and the survivors

``mutants.py`` has the changes, and what is left out. A mutant is caught when a test that executes
its line fails or runs too long; it survives when all of them pass, about two minutes of them at
most. One of C that does not compile is not counted. Everything happens in copies of the project
under ``--work``.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import shutil
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from mutants import Mutant, mutants_of

PACKAGES = ("generator", "runtime", "storage", "engine")
ROOT = next(folder for folder in Path(__file__).resolve().parents
            if (folder / "pyproject.toml").is_file())
EXPLAINED = ROOT / "tests" / "data" / "mutation_survivors.json"
#: Test files that look at text, pages and packaging, or take minutes, and see no behaviour.
UNRELATED = re.compile(
    r"/(benchmarks|docs|fuzz|studies)/|architecture|bare|citations|docstrings|first_call|naming|"
    r"notebooks|packaging|project_files|recipes|residues|_mutants")


# ---------------------------------------------------------------- as a plugin of pytest

LIMITS, SEEN = "GYROSPARK_MUTATION_LIMITS", "GYROSPARK_MUTATION_SEEN"
_seen: dict[str, Any] = {"tests": {}, "failed": []}


def pytest_configure() -> None:
    """Limit time and memory; in ``map``, begin to measure."""
    import resource

    cpu, memory = json.loads(os.environ[LIMITS])
    resource.setrlimit(resource.RLIMIT_CPU, (cpu, cpu))
    resource.setrlimit(resource.RLIMIT_AS, (memory << 30, memory << 30))
    if SEEN in os.environ:
        import coverage

        _seen["coverage"] = coverage.Coverage(
            data_file=None, include=[f"{Path.cwd()}/{name}/*" for name in PACKAGES], messages=False)
        _seen["coverage"].set_option("run:disable_warnings", ["no-data-collected"])
        _seen["coverage"].start()


def pytest_collection_modifyitems(items: list[Any]) -> None:
    """In ``map``, run one case of each test before the second of any."""
    if SEEN in os.environ:
        nth: Counter[str] = Counter()
        order = {}
        for item in items:
            function = item.nodeid.split("[")[0]
            order[item.nodeid], nth[function] = nth[function], nth[function] + 1
        items.sort(key=lambda item: order[item.nodeid])


def pytest_runtest_logreport(report: Any) -> None:
    """Note a test that fails without a change, for it tells nothing."""
    if report.failed:
        _seen["failed"].append(report.nodeid)


def pytest_runtest_logstart(nodeid: str) -> None:
    """The lines that follow are of this test."""
    if SEEN in os.environ:
        _seen["coverage"].switch_context(nodeid)
        _seen["tests"][nodeid] = -time.monotonic()


def pytest_runtest_logfinish(nodeid: str) -> None:
    """Take the time of a test."""
    if SEEN in os.environ:
        _seen["tests"][nodeid] = round(_seen["tests"][nodeid] + time.monotonic(), 3)
        _seen["coverage"].switch_context("")


def pytest_runtest_teardown(item: Any) -> None:
    """End a file whose budget is used."""
    if SEEN in os.environ and sum(os.times()[:4]) > json.loads(os.environ[LIMITS])[0] / 2:
        item.session.shouldstop = "The budget of this file is used."


def pytest_sessionfinish(session: Any) -> None:
    """Write which tests executed which lines."""
    if SEEN not in os.environ:
        return
    _seen["coverage"].stop()
    _seen["failed"] += [name for name, seconds in _seen["tests"].items() if seconds < 0]
    data, number = _seen["coverage"].get_data(), {name: i for i, name in enumerate(_seen["tests"])}
    lines = {os.path.relpath(file): {line: [number[name] for name in names if name]
                                     for line, names in data.contexts_by_lineno(file).items()}
             for file in data.measured_files()}
    Path(os.environ[SEEN]).write_text(json.dumps(
        {"tests": _seen["tests"], "failed": _seen["failed"], "lines": lines,
         "complete": not session.shouldstop}))


# ---------------------------------------------------------------- copies, tests in them


class Copy:
    """A copy of the project in which one file at a time is changed."""

    def __init__(self, work: Path, number: int) -> None:
        self.cache, self.fresh, self.scratch = work / "cache", work / f"cache{number}", (
            work / f"tmp{number}")
        self.folder = work / f"copy{number}" / ROOT.name
        shutil.rmtree(self.folder.parent, ignore_errors=True)
        shutil.copytree(ROOT, self.folder, symlinks=True, ignore=shutil.ignore_patterns(
            ".git", "__pycache__", ".*_cache", ".venv", "*.egg-info", "mutation"))
        self.cache.mkdir(parents=True, exist_ok=True)
        self.clock = int(time.time()) - 10**6

    def write(self, mutant: Mutant, *, changed: bool) -> None:
        """Write a file with or without the change, newer than its bytecode in each case."""
        source, self.clock = (ROOT / mutant.file).read_bytes(), self.clock + 10
        if changed:
            source = source[:mutant.start] + mutant.after.encode() + source[mutant.end:]
        (self.folder / mutant.file).write_bytes(source)
        os.utime(self.folder / mutant.file, (self.clock, self.clock))

    def pytest(self, tests: Iterable[str], seconds: float, *, seen: Path | None = None,
               skipped: Iterable[str] = ()) -> tuple[int | None, str]:
        """Return the exit code, None after too long a time, and what pytest wrote."""
        cache = self.cache if seen else self.fresh
        if not seen:  # what a mutant compiles or breaks is no other's
            shutil.rmtree(cache, ignore_errors=True)
            shutil.copytree(self.cache, cache, copy_function=os.link)
            cache.chmod(0o700)
        here = os.pathsep.join([str(self.folder.parent), str(Path(__file__).resolve().parent)])
        environment = {**os.environ, "PYTHONPATH": here, "GYROSPARK_OPTIMISE": "0",
                       "GYROSPARK_CACHE": str(cache), LIMITS: json.dumps([int(seconds), 12])}
        if seen:
            environment[SEEN] = str(seen)
        command = [sys.executable, "-m", "pytest", "-p", Path(__file__).stem, "-q", "-n", "0", "-p",
                   "no:cacheprovider", "--basetemp", str(self.scratch), *([] if seen else ["-x"]),
                   *(f"--deselect={name}" for name in skipped), *tests]
        process = subprocess.Popen(
            command, cwd=self.folder, env=environment, text=True, errors="replace",
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True)
        try:
            said = process.communicate(timeout=60 + 5 * seconds)[0]
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)
            return None, process.communicate()[0]
        return (None if process.returncode in (-9, -24) else process.returncode), said


class Map:
    """Which tests execute which line, and what they cost."""

    def __init__(self, folder: Path) -> None:
        self.seen = {path.stem: json.loads(path.read_text()) for path in folder.glob("*.json")}
        self.failed = {name for seen in self.seen.values() for name in seen["failed"]}
        self.complete = {next(iter(seen["tests"])).split("::")[0] for seen in self.seen.values()
                         if seen["complete"] and seen["tests"]}
        self.covered = {stem: sum(map(len, seen["lines"].values()))
                        for stem, seen in self.seen.items()}

    def tests(self, mutant: Mutant) -> list[tuple[float, list[tuple[float, str]]]]:
        """Return (share of this module, (seconds, test)) of files of tests, most special first."""
        for line in (*range(mutant.line, mutant.first - 1, -1), 0):
            found = []
            for stem, seen in self.seen.items():
                lines = seen["lines"].get(mutant.file, {})
                numbers = set(lines.get(str(line), ())) if line else {
                    number for numbers in lines.values() for number in numbers}
                named = list(seen["tests"].items())
                tests = [(named[i][1], named[i][0]) for i in numbers
                         if named[i][0] not in self.failed]
                if tests:
                    found.append((len(lines) / self.covered[stem], sorted(tests)))
            if found:
                return sorted(found, reverse=True)
        return []

    def choose(self, mutant: Mutant, *, whole: bool) -> list[list[tuple[float, str]]]:
        """Return cheap and special tests, more (six files, 100 s), two files not seen whole."""
        files = self.tests(mutant)
        first = {test for _, tests in files[:4] for test in tests[:2]}
        first |= set(sorted(test for _, tests in files for test in tests[:2])[:5])
        then, left = [], 100.0
        for _, tests in files[:6]:
            for test in tests:
                if test not in first and test[0] < left:
                    then.append(test)
                    left -= test[0]
        names = dict.fromkeys(test.split("::")[0] for _, tests in files for _, test in tests[:1])
        then_whole = [(50.0, name) for name in names if name not in self.complete][:2]
        return [part for part in (sorted(first), then, then_whole if whole else []) if part]


def try_out(copy: Copy, known: Map, mutant: Mutant, *, changed: bool,
            whole: bool) -> dict[str, Any]:
    """Return what became of a mutant, with the test that caught it."""
    began, outcome, by = time.monotonic(), "not executed", ""
    copy.write(mutant, changed=changed)
    for tests in known.choose(mutant, whole=whole):
        cost = 30 + 4 * sum(seconds for seconds, _ in tests)
        code, said = copy.pytest([name for _, name in tests], cost, skipped=known.failed)
        found = re.search(r"^(?:FAILED|ERROR) (\S+)", said, re.MULTILINE)
        by = found[1] if found else said[-300:] if code else ""
        if code == 4 and "not found" in said:
            code, by = 1, "tests of other names"
        outcome = ("timeout" if code is None else "survived" if code == 0 else "caught")
        if outcome == "caught" and mutant.package == "engine" and re.search(
                r"\.[ch]:\d+:\d+: .*error:", said):
            outcome = "does not compile"
        if outcome != "survived":
            break
    copy.write(mutant, changed=False)
    return {"outcome": outcome, "by": by, "seconds": round(time.monotonic() - began, 1)}


# ---------------------------------------------------------------- the commands


def read_log(work: Path) -> dict[str, dict[str, Any]]:
    """Return the last record of each mutant."""
    path = work / "log.jsonl"
    records = map(json.loads, path.read_text().splitlines()) if path.is_file() else ()
    return {record["key"]: record for record in records}


def measure(work: Path, seconds: int, wanted: list[str]) -> None:
    """Run each file of tests once and write the lines that its tests execute."""
    copy, folder = Copy(work, os.getpid()), work / "map"
    folder.mkdir(exist_ok=True)
    for path in sorted((copy.folder / "tests").rglob("test_*.py")):
        name = str(path.relative_to(copy.folder))
        target = folder / f"{name.replace('/', '-')}.json"
        if target.exists() or UNRELATED.search(name) or (wanted and path.stem not in wanted):
            continue
        began = time.monotonic()
        code, said = copy.pytest([name], 2 * seconds, seen=target)
        print(f"{name:48} {time.monotonic() - began:6.1f} s  {said.splitlines()[-1:]} {code}",
              flush=True)


def pick(count: int, least: int, packages: list[str], seed: int,
         done: dict[str, dict[str, Any]]) -> list[Mutant]:
    """Return mutants that the log lacks, so that with it there are as many as asked for."""
    places = {package: mutants_of(ROOT, package) for package in packages}
    whole, chosen = sum(map(len, places.values())), []
    for package, statements in places.items():
        logged = sum(record["file"].startswith(f"{package}/")
                     and record["outcome"] != "does not compile" for record in done.values())
        wanted = max(least, round(count * len(statements) / whole)) - logged
        choose = random.Random(f"{seed} {package}")
        choose.shuffle(statements)
        fresh = [mutant for mutant in map(choose.choice, statements) if mutant.key not in done]
        chosen += fresh[:max(wanted, 0)]
    random.Random(seed).shuffle(chosen)
    return chosen


def run(work: Path, mutants: list[Mutant], jobs: int, *, changed: bool, whole: bool) -> None:
    """Try mutants out and log each."""
    known, copies = Map(work / "map"), SimpleQueue[Copy]()
    for number in range(jobs):
        copies.put(Copy(work, number))
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, text=True,
                            capture_output=True, check=False).stdout.strip()

    def one(mutant: Mutant) -> None:
        copy = copies.get()
        found = try_out(copy, known, mutant, changed=changed, whole=whole)
        copies.put(copy)
        record = {"key": mutant.key, **asdict(mutant), **found, "commit": commit}
        with (work / ("log.jsonl" if changed else "unchanged.jsonl")).open("a") as log:
            log.write(json.dumps(record) + "\n")
        print(f"{found['outcome']:12} {found['seconds']:6} s  {mutant.file}:{mutant.line} "
              f"{mutant.before[:40]!r} -> {mutant.after[:40]!r}  {found['by'][:60]}", flush=True)

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(one, mutants))


def table(work: Path) -> None:
    """Print the share by package, then the survivors and why they may live."""
    why = {record["key"]: record["reason"] for record in json.loads(EXPLAINED.read_text())}
    rows: dict[str, Counter[str]] = defaultdict(Counter)
    survivors = []
    for key, record in read_log(work).items():
        outcome = record["outcome"]
        if outcome in ("survived", "not executed"):
            survivors.append(record)
            outcome = "explained" if key in why else "survived"
        for row in (record["file"].split("/")[0], "all"):
            rows[row][outcome] += 1
    print(f"{'package':12}{'mutants':>9}{'caught':>9}{'survived':>10}{'explained':>11}{'share':>9}")
    for name in (*PACKAGES, "all"):
        row = rows[name]
        caught = row["caught"] + row["timeout"]
        every = caught + row["survived"] + row["explained"]
        print(f"{name:12}{every:9}{caught:9}{row['survived'] + row['explained']:10}"
              f"{row['explained']:11}{caught / max(every, 1):9.1%}")
    for record in sorted(survivors, key=lambda one: (one["file"], one["line"])):
        print(f"\n{record['file']}:{record['line']} {record['function']}: {record['before']!r} -> "
              f"{record['after']!r}   [{record['key']}] {record['outcome']}\n    {record['text']}\n"
              f"    {why.get(record['key'], '')}")


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("map", "run", "table"))
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "mutation",
                        help="folder of copies, map and log")
    parser.add_argument("--mutants", type=int, default=300,
                        help="how many, those of the log included")
    parser.add_argument("--least", type=int, default=40, help="how many of each package at least")
    parser.add_argument("--packages", nargs="+", choices=PACKAGES, default=list(PACKAGES))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--seconds", type=int, default=20, help="of CPU for a file of tests in map")
    parser.add_argument("--tests", nargs="+", default=[], help="files of tests that map measures")
    parser.add_argument("--again", action="store_true",
                        help="only the survivors of the log, against whole files of tests")
    parser.add_argument("--unchanged", action="store_true",
                        help="run the same tests without the changes: none may fail")
    given = parser.parse_args()
    work = given.work.resolve()
    os.nice(19)
    if given.command == "map":
        measure(work, given.seconds, given.tests)
    elif given.command == "table":
        table(work)
    else:
        done = read_log(work)
        if given.again:
            living = {key for key, record in done.items()
                      if record["outcome"] in ("survived", "not executed")}
            mutants = list({mutant.key: mutant for package in given.packages
                            for places in mutants_of(ROOT, package) for mutant in places
                            if mutant.key in living}.values())
        else:
            mutants = pick(given.mutants, given.least, given.packages, given.seed,
                           {} if given.unchanged else done)
        run(work, mutants, given.jobs, changed=not given.unchanged, whole=given.again)


if __name__ == "__main__":
    main()
