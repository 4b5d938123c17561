"""Options of the test run, a SIGINT that tests can send, steppers and the command line to call."""

from __future__ import annotations

import gc
import json
import os
import signal
import sys

import pytest
from hypothesis import settings
from hypothesis.internal.conjecture import providers

import gyrospark as gs
from calls import SCHEMES, identify, late_failures
from compilers import COMPILERS
from gyrospark.commands import main, main_generate
from gyrospark.core.errors import CompilerError

pytest_plugins = ["budget", "root_folder"]

# Tests compile hundreds of steppers and run each for a moment: what a benchmark needs is built by
# itself, and processes that run longer get a higher level. Set another one to test its code.
os.environ.setdefault("GYROSPARK_OPTIMISE", "0")

# SymPy and parsed files make millions of objects that stay, which the collector would look through
# again and again. It ignores all that exist when the tests are collected.
gc.set_threshold(100_000, 20, 50)
gc.disable()

# They start hundreds of processes of Python: what the first compiles of a module the others read,
# for without it each takes a second and more to import SymPy.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# The same examples in every run, so that what fails is what was changed. Look for others now and
# then: pytest --hypothesis-profile=random.
settings.register_profile("same", derandomize=True, deadline=None, max_examples=40)
settings.register_profile("random", derandomize=False, deadline=None)  # of a busy machine
settings.load_profile("same")
# Nor do they change with constants of the code, of which each process would read every module.
providers._get_local_constants = lambda: providers._local_constants

# A shell that starts the run in the background has SIGINT ignored, and so would every process
# that a test starts and interrupts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# nohup has SIGHUP ignored: these tests go on with it, what they start gets the usual end.
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, lambda *_: None)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update", action="store_true",
        help="rewrite generated/ from the generator instead of comparing with it",
    )


def pytest_collection_finish():
    gc.freeze()
    gc.enable()


def _without_quad(outcome):
    """Skip a test that needs float128 on a machine with clang alone, which has no _Float128."""
    error = outcome.excinfo and outcome.excinfo[1]
    if isinstance(error, CompilerError) and "has no float128" in str(error) and (
            "gcc" not in COMPILERS):
        outcome.force_exception(pytest.skip.Exception("clang has no float128"))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_setup(item):
    _without_quad((yield))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_call(item):
    _without_quad((yield))


@pytest.fixture(params=SCHEMES, ids=identify)
def step(request: pytest.FixtureRequest) -> gs.Stepper:
    """A stepper of each kind."""
    return gs.stepper(*request.param)


@pytest.fixture(scope="session")
def gl3() -> gs.Stepper:
    return gs.stepper("G-L", stages=3, rep="gamma")


@pytest.fixture(scope="session")
def failures():
    late = late_failures()
    assert len(late) == len(SCHEMES)
    return late


class Answer:
    """The exit code and the output of a command."""

    def __init__(self, code, stdout, stderr):
        self.code, self.stdout, self.stderr = code, stdout, stderr

    @property
    def document(self):
        """The JSON document on stdout, read strictly."""
        def refuse(constant):
            raise AssertionError(f"{constant} is not JSON")
        return json.loads(self.stdout, parse_constant=refuse)


@pytest.fixture
def gyrospark(monkeypatch, capsys, tmp_path):
    """Call the entry point of a console script inside this process, in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def caller(*arguments, entry=main, name="gyrospark"):
        monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as end:
            entry()
        output = capsys.readouterr()
        return Answer(end.value.code, output.out, output.err)

    return caller


@pytest.fixture
def generate(gyrospark):
    """Call the entry point of ``generate``."""
    return lambda *arguments: gyrospark(*arguments, entry=main_generate, name="generate")
