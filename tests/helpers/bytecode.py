"""Bytecode of a fresh clone, of which each worker compiles its share and reads that of the others.

A plugin of pytest. Without it each worker rewrites the assertions of all test files, and compiles
all modules, for all collect the same files in the same order.
"""

from __future__ import annotations

import compileall
import contextlib
import sys
from pathlib import Path

import pytest
from _pytest.assertion import rewrite

import gyrospark

_TESTS, _PACKAGE = Path(__file__).parents[1], Path(gyrospark.__file__).parent


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Compile every n-th file, with n workers, before a worker of the whole run collects."""
    config = session.config
    worker = getattr(config, "workerinput", None)
    if (worker is None or sys.dont_write_bytecode
            or config.args_source is not pytest.Config.ArgsSource.TESTPATHS):
        return
    folders = [init.parent for init in _PACKAGE.glob("*/__init__.py")]
    files = sorted(file for folder in [_TESTS, *folders] for file in folder.rglob("*.py"))
    for file in files[int(worker["workerid"].removeprefix("gw"))::worker["workercount"]]:
        if file.match("test_*.py"):
            with contextlib.suppress(SyntaxError):  # which collecting reports
                _rewrite(file, config)
        else:
            compileall.compile_file(file, quiet=2)


def _rewrite(file: Path, config: pytest.Config) -> None:
    """Rewrite the assertions of a test file, unless what is cached is of its text."""
    cached = rewrite.get_cache_dir(file) / (file.stem + rewrite.PYC_TAIL)
    if not rewrite._read_pyc(file, cached) and rewrite.try_makedirs(cached.parent):
        source, code = rewrite._rewrite_test(file, config)
        rewrite._write_pyc(config.stash[rewrite.assertstate_key], code, source, cached)
