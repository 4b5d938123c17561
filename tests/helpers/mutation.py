"""Mutation: change one place of the code, run the tests that execute it, see whether one fails.

    python mutation.py run                 300 mutants of Python at random, 40 of the engine
    python mutation.py run --again         the survivors of the log, with tests that execute them
    python mutation.py table               share caught by package, and the survivors

``mutants.py`` has the changes and the places without any. A mutant meets the tests that are named
after its module or import it, those of its folder, and whole runs. It is caught when a test fails
that passes without it, or that runs too long. One of C that does not compile without a warning is
not counted. Everything happens in copies of the project under ``--work``, with the lowest priority;
``run`` goes on where it was stopped. With ``--again``, survivors meet the tests that execute them,
which one run of the quick tests notes. Before the first mutant comes one that must be caught, so
that tests of an unchanged package are noticed. The seed is the week's by default.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import random
import re
import shutil
import subprocess
import sys
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import asdict
from datetime import date
from itertools import zip_longest
from pathlib import Path
from typing import Any

import pytest

from mutants import Mutant, mutants_of

PACKAGES = ("generator", "runtime", "core", "storage", "sweeps", "commands", "certificates",
            "targets", "interop", "studies", "references", "engine", "api.py")
ROOT = next(folder for folder in Path(__file__).resolve().parents
            if (folder / "pyproject.toml").is_file())
EXPLAINED = ROOT / "tests" / "data" / "mutation_survivors.json"
#: What tests import: once, in the process from which theirs are forked (no plugins of pytest).
HEAVY = ("cffi", "click", "jinja2", "matplotlib.figure", "mpmath", "numpy", "rich", "scipy.spatial",
         "scipy.spatial.transform", "sympy", "xarray")
#: A change that no suite survives: exact numbers and errors import this module.
FATAL = ("core/errors.py", "raise AssertionError\n")
#: What a mutant meets at last, by package: whole texts, whole runs.
WHOLE = {"core": ["api/test_misspelt_arguments.py", "refusals/test_run_arguments.py",
                  "commands/test_cli.py"],
         "generator": ["golden/test_generated.py", "engine/test_control_profile.py",
                       "laws/test_laws.py", "runtime/results/test_body_motion.py"],
         "commands": ["commands/test_cli.py"],
         "engine": ["engine/test_step_reference.py", "laws/test_laws.py",
                    "engine/test_splitting.py", "engine/test_splitting_derivatives.py",
                    "engine/test_control_profile.py", "golden/test_golden_runs.py",
                    "runtime/derivatives/test_steps.py", "runtime/events/test_impacts.py"],
         "runtime": ["laws/test_laws.py", "matrix/test_features_by_consumers.py"]}
#: Tests that look at text, pages and packaging, and see no behaviour, and hostile input at random.
UNRELATED = re.compile(r"/(docs|fuzz|project)/")


# ---------------------------------------------------------------- as a plugin of pytest

MEMORY = 1 << 21  # pages, of 4 KiB, that a mutant may take
COMPILE, CONFTEST, CRASH = "the compiler", "import of conftest", "a crash"
LIMIT, FAILED, NOTES = (f"GYROSPARK_MUTATION_{word}" for word in ("LIMIT", "FAILED", "NOTES"))
#: A module whose function a statement calls, so that the test that executes it is written down.
NOTING = f"""import os
seen = set()


def note(key):
    test = os.environ.get("PYTEST_CURRENT_TEST", "").rpartition(" ")[0]
    if test and (key, test) not in seen:
        seen.add((key, test))
        with open(os.environ["{NOTES}"], "a") as file:
            file.write(f"{{key}}\\t{{test}}\\n")
"""


def pytest_configure() -> None:
    """Limit the time."""
    import resource

    cpu = int(os.environ[LIMIT])
    resource.setrlimit(resource.RLIMIT_CPU, (cpu, cpu))


def pytest_runtest_logreport(report: Any) -> None:
    """Note a test that fails: without a change, it tells nothing."""
    if report.failed:
        Path(os.environ[FAILED]).write_text(report.nodeid)


pytest_collectreport = pytest_runtest_logreport  # a file that cannot be imported


# ---------------------------------------------------------------- copies, tests in them


class Copy:
    """A copy of the project in which one file at a time is changed."""

    def __init__(self, work: Path, number: int) -> None:
        self.cache, self.fresh, self.scratch = work / "cache", work / f"cache{number}", (
            work / f"tmp{number}")
        self.folder = work / f"copy{number}" / "gyrospark"  # whatever the checkout is called
        shutil.rmtree(self.folder.parent, ignore_errors=True)
        shutil.copytree(ROOT, self.folder, symlinks=True, ignore=shutil.ignore_patterns(
            ".git", "__pycache__", ".*_cache", ".venv", "*.egg-info", "mutation"))
        self.cache.mkdir(parents=True, exist_ok=True)
        self.clock, self.sound = int(time.time()) - 10**6, dict[str, bytes]()
        self.failed = self.folder.parent / "failed.txt"  # the last test that did

    def write(self, mutant: Mutant, *, changed: bool) -> None:
        """Write a file with or without the change, newer than its bytecode in each case."""
        path, self.clock = self.folder / mutant.file, self.clock + 10
        source = self.sound.setdefault(mutant.file, path.read_bytes())
        if changed:
            source = source[:mutant.start] + mutant.after.encode() + source[mutant.end:]
        path.write_bytes(source)
        os.utime(path, (self.clock, self.clock))

    def run(self, tests: Iterable[str], seconds: float,
            skipped: Iterable[str] = ()) -> tuple[int | None, str]:
        """Return the exit code, None after too long a time, and what pytest wrote."""
        shutil.rmtree(self.fresh, ignore_errors=True)  # what a mutant compiles is no other's
        shutil.copytree(self.cache, self.fresh, copy_function=os.link)
        self.fresh.chmod(0o700)
        here = os.pathsep.join([str(self.folder.parent), str(self.folder / "tests" / "helpers")])
        environment = {"PYTHONPATH": here, "GYROSPARK_OPTIMISE": "0", LIMIT: str(int(seconds)),
                       "GYROSPARK_CACHE": str(self.fresh), FAILED: str(self.failed)}
        self.failed.unlink(missing_ok=True)
        command = ["-p", Path(__file__).stem, "-q", "-n", "0", "-p", "no:cacheprovider",
                   "--basetemp", str(self.scratch), "-x",
                   *(f"--deselect={name}" for name in skipped), *tests]
        output_file, until = self.folder.parent / "said.txt", time.monotonic() + 60 + 5 * seconds
        child = os.fork()  # what this process has imported needs no second import
        if not child:
            os.setsid()
            os.environ.update(environment)
            os.chdir(self.folder)
            sys.path.insert(0, str(self.folder.parent))
            with output_file.open("w") as file:
                os.dup2(file.fileno(), 1)
                os.dup2(file.fileno(), 2)
            ended = 70
            try:
                ended = int(pytest.main(command))
            except BaseException:
                traceback.print_exc()
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(ended)
        while not (done := os.waitpid(child, os.WNOHANG))[0]:
            time.sleep(0.05)
            pages = Path(f"/proc/{child}/statm").read_text().split()[1]
            if time.monotonic() > until or int(pages) > MEMORY:
                os.killpg(child, 9)
        code = os.waitstatus_to_exitcode(done[1])
        return None if code in (-9, -24) else code, output_file.read_text(errors="replace")


def near(mutant: Mutant, limit: int = 4) -> list[list[tuple[float, str]]]:
    """Return the test files named after a mutant's module, those that import it, its folder's.

    Of the latter, or of the folder above where tests have none of that name, the ``limit`` shortest
    are returned; at last those of ``WHOLE``.
    """
    path = Path(mutant.file)
    module = ".".join(path.with_suffix("").parts)
    texts = {file: file.read_text(encoding="utf-8") for file in (ROOT / "tests").rglob("test_*.py")
             if not UNRELATED.search(str(file.relative_to(ROOT)))}
    named = [file for file in texts if file.stem == f"test_{path.stem}"]
    importing = sorted((file for file, text in texts.items()
                        if re.search(rf"gyrospark\.{re.escape(module)}\b", text)),
                       key=lambda file: len(texts[file]))[:limit]
    level = next(parent for parent in path.parents if (ROOT / "tests" / parent).is_dir())
    folder = sorted((file for file in texts if file.parent == ROOT / "tests" / level),
                    key=lambda file: len(texts[file]))[:limit]
    files = dict.fromkeys([*named, *importing, *folder, *(
        ROOT / "tests" / name for name in WHOLE.get(mutant.package, ()))])
    return [[(20.0, str(file.relative_to(ROOT)))] for file in files]


def with_notes(source: str, mutants: Iterable[Mutant]) -> str:
    """Return a file whose mutants' statements note the tests; none that an import executes."""
    lines = source.splitlines(keepends=True)
    for mutant in sorted(mutants, key=lambda mutant: -mutant.first):
        row = mutant.first - 1
        indent = lines[row][: len(lines[row]) - len(lines[row].lstrip())]
        if lines[row].startswith(f"{indent}elif"):  # nothing stands before it but its if
            row = max(i for i in range(row) if lines[i].startswith(f"{indent}if "))
        if indent and not re.match(r"\s*(@|(async )?def |class )", lines[row]):
            lines.insert(row, f'{indent}__import__("noting").note("{mutant.key}")\n')
    return "".join(lines)


def executing(copy: Copy, mutants: list[Mutant], limit: int = 60) -> dict[str, list[str]]:
    """Return up to ``limit`` quick tests, of many files, that execute each mutant's statement."""
    notes = copy.folder.parent / "notes.txt"
    notes.write_text("")
    (copy.folder.parent / "noting.py").write_text(NOTING)
    by_file = defaultdict(list)
    for mutant in mutants:
        if mutant.file.endswith(".py"):
            by_file[mutant.file].append(mutant)
    for file, of_file in by_file.items():
        path = copy.folder / file
        path.write_text(with_notes(path.read_text(encoding="utf-8"), of_file), encoding="utf-8")
    here = os.pathsep.join([str(copy.folder.parent), str(copy.folder / "tests" / "helpers")])
    subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-n", "2", "--dist", "loadfile", "-p",
         "no:cacheprovider", *(f"--ignore=tests/{name}" for name in ("docs", "project", "fuzz"))],
        cwd=copy.folder, check=False, env={**os.environ, "PYTHONPATH": here, NOTES: str(notes),
                                           "GYROSPARK_OPTIMISE": "0"})
    for file in by_file:
        shutil.copy2(ROOT / file, copy.folder / file)
    tests: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for key, _, name in (line.partition("\t") for line in notes.read_text().splitlines()):
        if name not in tests[key][name.split("::")[0]]:
            tests[key][name.split("::")[0]].append(name)
    # one of each file, then another of each
    return {key: [name for row in zip_longest(*files.values()) for name in row if name][:limit]
            for key, files in tests.items()}


def failing(copy: Copy, tests: list[str], cost: float, failed: Iterable[str]) -> str | None:
    """Return the first test that fails, "" if none does, None after too long a time."""
    code, output = copy.run(tests, cost, skipped=failed)
    if code == 4 and "not found: " in output:  # cases whose values the change has renamed
        renamed = list(dict.fromkeys(name.split("[")[0] for name in tests))
        return failing(copy, renamed, cost, failed) if renamed != tests else ""
    if code is None or code in (0, 5):  # 5: no test was left
        return None if code is None else ""
    if code < 0:
        return CRASH
    if copy.failed.is_file():
        is_of_compiler = re.search(r"\.[ch]:\d+:\d+: .*error:", output)
        return COMPILE if is_of_compiler else copy.failed.read_text()
    if "while loading conftest" in output:
        return CONFTEST
    raise RuntimeError(output)


def try_out(copy: Copy, parts: list[list[tuple[float, str]]], sound: set[str], failed: set[str],
            mutant: Mutant, *, changed: bool) -> dict[str, Any]:
    """Return what became of a mutant, with the test that caught it and passes without it."""
    began, outcome, by = time.monotonic(), "not executed", ""
    for tests in parts:
        cost, names = 30 + 4 * sum(seconds for seconds, _ in tests), [name for _, name in tests]
        failure: str | None = ""
        copy.write(mutant, changed=changed)
        while names and (failure := failing(copy, names, cost, failed)) and failure not in sound:
            if failure in failed:
                raise RuntimeError(f"{failure} fails although it was left out")
            copy.write(mutant, changed=False)
            alone = [failure] if "::" in failure else [failure, "--collect-only"]
            if failing(copy, alone, cost, ()) == "":
                sound.add(failure)
            else:
                names = [name for name in names if failure not in (name, name.split("::")[0])]
                failed.add(failure)
            copy.write(mutant, changed=changed)
        outcome, by = ("timeout", "") if failure is None else (
            ("caught", failure) if failure else ("survived", ""))
        if failure == COMPILE and mutant.package == "engine":
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


def reasons() -> dict[str, str]:
    """Return why a mutant may live, by its key."""
    return {record["key"]: record["reason"] for record in json.loads(EXPLAINED.read_text())}


def pick(places: dict[str, list[list[Mutant]]], count: int, seed: int,
         done: dict[str, dict[str, Any]]) -> list[Mutant]:
    """Return mutants that the log lacks, so that with it there are as many as asked for."""
    statement_count, chosen = sum(map(len, places.values())), []
    for package, statements in places.items():
        logged = sum(record["file"].split("/")[0] == package
                     and record["outcome"] != "does not compile" for record in done.values())
        missing = round(count * len(statements) / statement_count) - logged
        choose = random.Random(f"{seed} {package}")
        choose.shuffle(statements)
        fresh = [mutant for mutant in map(choose.choice, statements) if mutant.key not in done]
        chosen += fresh[:max(missing, 0)]
    random.Random(seed).shuffle(chosen)
    return chosen


def run(work: Path, copy: Copy, mutants: list[Mutant], tests: list[str], seconds: float, *,
        changed: bool, executed: dict[str, list[str]]) -> None:
    """Try mutants out and log each; ``executed``: tests by key, in place of those near it."""
    failed: set[str] = set()  # tests that fail without a change
    sound = {COMPILE, CONFTEST, CRASH}  # tests that pass without a change
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, text=True,
                            capture_output=True, check=False).stdout.strip()
    file, text = FATAL
    first = Mutant(file, 1, "", 0, 0, "", text, "fatal", "")
    copy.write(first, changed=changed)
    if changed and not failing(copy, ["tests/core/test_units.py"], 60, ()):
        raise SystemExit(f"The tests pass although {file} raises: they import another package.")
    copy.write(first, changed=False)
    for mutant in mutants:
        names = executed.get(mutant.key, [])
        parts = ([[(seconds, name) for name in tests]] if tests else
                 [[(6.0, name) for name in names[k : k + 6]] for k in range(0, len(names), 6)]
                 or near(mutant))
        result = try_out(copy, parts, sound, failed, mutant, changed=changed)
        record = {"key": mutant.key, **asdict(mutant), **result, "commit": commit}
        with (work / ("log.jsonl" if changed else "unchanged.jsonl")).open("a") as log:
            log.write(json.dumps(record) + "\n")
        print(f"{result['outcome']:12} {result['seconds']:6} s  {mutant.file}:{mutant.line} "
              f"{mutant.before[:40]!r} -> {mutant.after[:40]!r}  {result['by'][:90]}", flush=True)


def table(work: Path) -> None:
    """Print the share by package, then the survivors and why they may live."""
    why = reasons()
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
    parser.add_argument("command", choices=("run", "table"))
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "mutation",
                        help="folder of copies, map and log")
    parser.add_argument("--mutants", type=int, default=300,
                        help="how many of Python, those of the log included")
    parser.add_argument("--engine", type=int, default=40, help="how many of the engine")
    parser.add_argument("--packages", nargs="+", choices=PACKAGES, default=list(PACKAGES))
    parser.add_argument("--seed", type=int, default=date.today().isocalendar().week,
                        help="another one draws other mutants; default: the week of the year")
    parser.add_argument("--seconds", type=int, default=60,
                        help="of CPU for a file of --tests")
    parser.add_argument("--tests", nargs="+", default=[],
                        help="tests in place of those near the module")
    parser.add_argument("--again", action="store_true",
                        help="the survivors of the log, with the tests that execute them")
    parser.add_argument("--files", type=re.compile, default="", metavar="PATTERN",
                        help="only mutants of files whose path has this regular expression")
    parser.add_argument("--unchanged", action="store_true",
                        help="run the same tests without the changes: none may fail")
    arguments = parser.parse_args()
    work = arguments.work.resolve()
    if arguments.command == "table":
        return table(work)
    os.nice(19)
    for name in HEAVY:
        importlib.import_module(name)
    copy = Copy(work, os.getpid())
    done = {} if arguments.unchanged else read_log(work)
    places = {package: mutants_of(copy.folder, package) for package in arguments.packages}
    if arguments.again:
        living = {key for key, record in done.items()
                  if record["outcome"] in ("survived", "not executed")} - reasons().keys()
        mutants = list({mutant.key: mutant for statements in places.values()
                        for edits in statements for mutant in edits
                        if mutant.key in living}.values())
    else:
        engine = {name: places.pop(name) for name in ("engine",) if name in places}
        mutants = [*pick(places, arguments.mutants, arguments.seed, done),
                   *pick(engine, arguments.engine, arguments.seed, done)]
    mutants = [mutant for mutant in mutants if re.search(arguments.files, mutant.file)]
    executed = executing(copy, mutants) if arguments.again and not arguments.tests else {}
    return run(work, copy, mutants, arguments.tests, arguments.seconds,
               changed=not arguments.unchanged, executed=executed)


if __name__ == "__main__":
    main()
