"""The budget of a case: one CPU second, children included, but for what the catalogue builds.

A plugin of pytest. The summary lists the cases beyond the budget and counts the steppers that were
compiled, and the parts of steppers that are compiled when they are first asked for; a case beyond
``LIMIT`` fails unless it is marked ``slow`` with a reason. A busy machine takes up to eight times
as long for the same case, so the limit finds only what has grown out of hand.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from gyrospark.runtime.compilation import verified_build
from gyrospark.runtime.compilation.build_cache import digest

__all__ = ["shared"]

#: CPU seconds that a case may use on an idle machine, and at which it fails on any.
BUDGET, LIMIT = 1.0, 30.0

_spent = {"shared": 0.0, "total": 0.0}
#: Kind and text of each compiled module, of which "runs" is the stepper; a text counts once.
_compiled: set[tuple[str, str]] = set()
_beyond: list[tuple[float, str]] = []


def _cpu() -> float:
    """Return CPU seconds of this process and of the children that it waited for."""
    return sum(os.times()[:4])


@contextmanager
def shared() -> Iterator[None]:
    """Run a block whose result other cases use too: the session bears its cost."""
    began, before = _cpu(), _spent["shared"]
    try:
        yield
    finally:
        _spent["shared"] = before + _cpu() - began  # blocks inside are part of this one


def _count_builds(compile_module: Any) -> Any:
    def counted(name: str, files: Any, compiler: Any, folder: Any, kind: str, *flags: Any) -> Any:
        module = compile_module(name, files, compiler, folder, kind, *flags)
        _compiled.add((kind, digest(files)))  # a compiler of a test that fails has compiled nothing
        return module

    return counted


def pytest_configure() -> None:
    """Count the modules that are compiled from here on."""
    verified_build.compile_module = _count_builds(verified_build.compile_module)


def pytest_collection_finish() -> None:
    """Refuse to run what compiles while pytest collects: each worker would, for any choice."""
    if _compiled:
        raise pytest.UsageError("A test compiles while pytest collects: compile in a fixture.")


@pytest.hookimpl(hookwrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Take the CPU seconds of a case with its setup and teardown."""
    began, before = _cpu(), _spent["shared"]
    yield
    item.user_properties.append(("cpu", _cpu() - began - (_spent["shared"] - before)))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Fail a case that takes far more than it may."""
    began, before = _cpu(), _spent["shared"]
    outcome: Any = yield
    seconds = _cpu() - began - (_spent["shared"] - before)
    if item.get_closest_marker("slow") is not None or outcome.excinfo:
        return
    if seconds > BUDGET:
        item.user_properties.append(("beyond the budget", seconds))
    if seconds > LIMIT:
        outcome.force_exception(pytest.fail.Exception(
            f"This case used {seconds:.1f} CPU s; {BUDGET:g} is the budget. Make it smaller, take "
            "a stepper of the catalogue, or mark it slow with a reason.", pytrace=False))


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Keep the cases beyond the budget, in the process that prints the summary."""
    if report.when == "call":
        _beyond.extend((seconds, report.nodeid) for name, seconds in report.user_properties
                       if name == "beyond the budget")


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Hand the counts of a worker to the process that prints."""
    output = getattr(session.config, "workeroutput", None)
    if output is not None:
        output["budget"] = _spent | {"total": _cpu()}
        output["compiled"] = sorted(map(list, _compiled))


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Add the counts of a worker."""
    output = getattr(node, "workeroutput", {})
    for name, number in output.get("budget", {}).items():
        _spent[name] += number
    _compiled.update(map(tuple, output.get("compiled", ())))


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print the cost of the run."""
    # Children of the process that prints are the workers, which have counted themselves.
    cpu_seconds = _spent["total"] + sum(os.times()[:2]) if _spent["total"] else _cpu()
    steppers = sum(kind == "runs" for kind, _ in _compiled)
    terminalreporter.write_line(
        f"{cpu_seconds:.0f} CPU s, of which the catalogue {_spent['shared']:.0f}; "
        f"{steppers} steppers and {len(_compiled) - steppers} parts compiled")
    for seconds, name in sorted(_beyond, reverse=True)[:40]:
        terminalreporter.write_line(f"  {seconds:.1f} CPU s, {BUDGET:g} budgeted: {name}")
