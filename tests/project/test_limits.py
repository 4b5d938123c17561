"""Sizes that keep the project readable: generated files, the engine, the root."""

from __future__ import annotations

import pytest

from processes import ROOT, call
from toy import HEADERS

#: Files of the root that tools ask for by name.
TOOLING = {"CITATION.cff", "LICENSE", "MANIFEST.in", "Makefile", "__main__.py", "_version.py",
           "__init__.pyi", "py.typed", "pyproject.toml", "setup.py"}


def lines(path):
    return path.read_text(encoding="utf-8").count("\n")


def test_generated_files_hold_what_was_derived():
    files = sorted((ROOT / "generated").glob("*.c"))
    assert len(files) == 6
    assert lines(ROOT / "generated" / "heavy_top_gl3_gamma.c") <= 750
    assert max(map(lines, files)) <= 900


def test_the_engine_has_few_headers_none_of_them_long():
    """That each compiles alone is tested with the engine."""
    assert 40 <= len(HEADERS) <= 110
    assert max(map(lines, HEADERS)) <= 600


def test_the_root_has_few_files():
    if not (ROOT / ".git").exists():
        pytest.skip("this is no git checkout")
    listed = call(["git", "ls-files", "-z"], cwd=ROOT).stdout.split("\0")
    files = {name for name in listed if name and "/" not in name and not name.startswith(".")}
    assert files >= TOOLING
    assert len(files - TOOLING) <= 8, sorted(files - TOOLING)
