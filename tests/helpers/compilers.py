"""The C compilers of this machine, gcc or clang under any name, for tests that call them."""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys

import pytest

from processes import call

#: One that stops tells what it stopped at where a macro is used, not where it is defined.
ALL_ERRORS = {"gcc": ["-fmax-errors=0", "-ftrack-macro-expansion=0"], "clang": ["-ferror-limit=0"]}


def found(names):
    """Return gcc and clang by their kind, as far as one of these programs is one of them."""
    commands = {}
    for name in names:
        path = shutil.which(name)
        if path is not None:
            macros = call([path, "-dM", "-E", "-x", "c", os.devnull]).stdout
            commands.setdefault("clang" if "__clang__" in macros else "gcc", [path])
    return commands


COMPILERS = found(["gcc", "clang", "cc"])
COMPILERS_OF_CPLUSPLUS = found(["g++", "clang++", "c++"])
#: The compiler of every test of the C, and the second one of some.
MAIN, OTHER = ("clang", "gcc") if list(COMPILERS) == ["clang"] else ("gcc", "clang")


def compiler(kind, among=COMPILERS):
    """Return a compiler's command; skip the test, with the reason, if it is not there."""
    if kind not in among:
        pytest.skip(f"{kind} is not installed")
    return among[kind]


def zig():
    """Return the command of the compiler that PyPI has; skip the test if it is not there."""
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("ziglang is not installed (pip install '.[compiler]')")
    return [sys.executable, "-m", "ziglang", "cc"]
