"""Programs and packages that targets need, and what to do where one is missing."""

from __future__ import annotations

import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..core.errors import CompilerError, GyrosparkError, InputError
from ..runtime.compilation.compiler import find_compiler

__all__ = ["TOOLS", "Tool", "require", "run_tool"]

#: Seconds that a tool may take: ziglang compiles a C library at first.
_PATIENCE = 900


@dataclass(frozen=True)
class Tool:
    """A program, or a package of Python.

    Attributes
    ----------
    name : str
        In messages.
    commands : tuple of str
        Names of the program; the first that there is.
    variable : str
        Of the environment, which names the command instead.
    package : str
        Of Python, run by ``python -m`` if ``module_command`` says how, else imported.
    module_command : tuple of str
        Behind ``python -m``.
    cure : str
        What to type.
    """

    name: str
    commands: tuple[str, ...] = ()
    variable: str = ""
    package: str = ""
    module_command: tuple[str, ...] = ()
    cure: str = ""

    def find(self) -> list[str] | None:
        """Return the command; empty for a package that is imported; None where it is missing."""
        if self.variable and os.environ.get(self.variable, "").strip():
            return shlex.split(os.environ[self.variable])
        if self.name == "cc":
            try:
                return [*find_compiler().command]
            except CompilerError:
                return None
        found = next(filter(None, map(shutil.which, self.commands)), None)
        if found is not None:
            return [found]
        if self.package and importlib.util.find_spec(self.package) is not None:
            return [sys.executable, "-m", *self.module_command] if self.module_command else []
        return None


TOOLS = {tool.name: tool for tool in (
    Tool("cc", variable="CC", cure="install gcc or clang, or `pip install ziglang`"),
    Tool("c++", ("c++", "g++", "clang++"), "CXX", "ziglang", ("ziglang", "c++"),
         cure="install g++ or clang++, or `pip install ziglang`"),
    Tool("cargo", ("cargo",), "CARGO", cure="install Rust, as https://rustup.rs says"),
    Tool("octave", ("octave-cli", "octave"), cure="install Octave, with its headers"),
    Tool("mkoctfile", ("mkoctfile",), cure="install Octave's headers, octave-dev in Debian"),
    Tool("zig", ("zig",), package="ziglang", module_command=("ziglang",),
         cure="`pip install ziglang`"),
    Tool("wasmtime", package="wasmtime", cure="`pip install wasmtime`, or Node.js"),
    Tool("node", ("node",), cure="install Node.js"),
)}


def require(name: str, what: str) -> list[str]:
    """Return the command of a tool.

    Raises
    ------
    InputError
        Where it is missing: what needs it, and the cure.
    """
    tool = TOOLS[name]
    found = tool.find()
    if found is None:
        raise InputError(f"{what} needs {tool.name}, which was not found; {tool.cure}.")
    return found


def run_tool(command: Sequence[str], folder: Path, what: str) -> str:
    """Run a command in a folder; return what it printed.

    Raises
    ------
    GyrosparkError
        Where it fails, with its own words.
    """
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, check=False,
                              stdin=subprocess.DEVNULL, encoding="utf-8", errors="replace",
                              timeout=_PATIENCE)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise GyrosparkError(f"{what} failed: {shlex.join(command)}: {error}.") from error
    if done.returncode != 0:
        raise GyrosparkError(f"{what} failed with exit code {done.returncode}: "
                             f"{shlex.join(command)}\n{done.stderr.strip() or done.stdout.strip()}")
    return done.stdout
