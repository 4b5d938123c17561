"""Every entrance with inputs from outer space, for seconds; ``fuzz/run.py`` does it for hours.

Each input that once triggered a bug is a file in ``fuzz/corpus/<entrance>/`` and is tried again
here.
"""

from __future__ import annotations

import subprocess
import sys
import time

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fuzz.choices import Choices
from fuzz.entrances import ENTRANCES
from fuzz.judging import CORPUS, corpus, judge, random_input, shrunk
from processes import HELPERS, ROOT, call

every_entrance = pytest.mark.parametrize("name", list(ENTRANCES))
INPUTS = [(name, path) for name in ENTRANCES for path in corpus(name)]
#: Of seeded inputs, for each entrance; the slow ones get fewer of them.
SECONDS = 0.05
DRIVER = ROOT / "tests" / "fuzz" / "run.py"


def try_one(name: str, data: bytes) -> str:
    entrance = ENTRANCES[name]
    verdict = judge(entrance.check, data, entrance.seconds)
    assert verdict.failure is None, f"{data.hex()}\n{verdict.failure}"
    return verdict.outcome


@pytest.mark.parametrize(("name", "path"), INPUTS, ids=lambda x: getattr(x, "name", x))
def test_what_found_a_bug_finds_none(name, path):
    try_one(name, path.read_bytes())


def test_corpus_belongs_to_entrances():
    assert {path.name for path in CORPUS.iterdir()} <= set(ENTRANCES)


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow] * (name == "checkpoint"))  # compiled for this
    for name in ENTRANCES])
def test_seeded_inputs(name):
    """The same inputs come in every run, as many as time allows, until both kinds of end occur."""
    try_one(name, b"")  # first compilations and imports are not counted
    end, outcomes = time.perf_counter() + SECONDS, set()
    for number in range(20_000):
        outcomes.add(try_one(name, random_input(name, 0, number)))
        if time.perf_counter() > end and len(outcomes) > 1:  # stores are slow: a second kind is met
            break
    assert len(outcomes) > 1


@pytest.mark.parametrize("name", [  # which compiles what bytes ask for
    pytest.param(name, marks=[pytest.mark.slow] * (name == "checkpoint"))
    for name in ENTRANCES])
@settings(max_examples=3, database=None,
          suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(data=st.binary(max_size=120))
def test_any_bytes(name, data):
    try_one(name, data)


@pytest.mark.slow
@every_entrance
def test_many_inputs(name):
    for number in range(20_000):
        try_one(name, random_input(name, 1, number))


def test_choices_of_nothing_are_the_plainest():
    nothing = Choices(b"")
    assert [nothing.below(7), nothing.one_in(2), nothing.pick("ab"), nothing.text()] == [
        0, False, "a", ""]


def test_shrinking_finds_the_least():
    assert shrunk(bytes(range(200)), lambda data: 77 in data) == bytes([77])


def test_failures_and_hangs_are_seen():
    def hang(data: bytes) -> str:
        while True:
            try:
                time.sleep(10)
            except Exception:  # nor does this keep a hang from being seen
                continue

    assert judge(hang, b"", 0.05).failure.kind == "HangError"
    assert judge(lambda data: str(1 / 0), b"", 60).failure.kind == "ZeroDivisionError"
    assert judge(lambda data: sys.exit(3), b"", 60).failure.kind == "SystemExit"


def drive(*arguments: str, folder) -> subprocess.CompletedProcess[str]:
    return call([sys.executable, DRIVER, "--out", folder, *arguments])


@pytest.mark.slow  # a process that starts others
def test_driver_counts_what_it_tries(tmp_path):
    process = drive("--inputs", "60", "--seed", "2", "--entrance", "formula", folder=tmp_path)
    assert process.returncode == 0, process.stderr
    assert "formula: 60 inputs" in process.stdout


@pytest.mark.slow
def test_driver_survives_a_crash(tmp_path, monkeypatch):
    """An input that kills the process is saved; the other inputs are tried all the same."""
    (tmp_path / "sitecustomize.py").write_text(
        "import os, sys\n"
        "if '--worker' in sys.argv:\n"
        "    import fuzz.formulas as formulas\n"
        "    before = formulas.check\n"
        "    formulas.check = lambda data: os.abort() if data[:1] < b'\\x08' else before(data)\n",
        encoding="utf-8")
    paths = [str(tmp_path), str(ROOT / "tests"), str(HELPERS), str(ROOT.parent)]
    monkeypatch.setenv("PYTHONPATH", ":".join(paths))
    out = tmp_path / "failures"
    process = drive("--inputs", "100", "--entrance", "formula", folder=out)
    assert process.returncode == 1
    inputs = [*out.glob("formula-*.bin")]
    assert inputs
    assert all(path.read_bytes()[:1] < b"\x08" for path in inputs)
