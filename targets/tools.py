"""Programs and packages that targets need, and the cure where one is missing."""

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
from ..core.progress import log_task
from ..runtime.compilation.compiler import exit_reason, find_compiler

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
        Names of the program; the first one on the PATH is used.
    variable : str
        Of the environment, which names the command instead.
    package : str
        Of Python, run by ``python -m`` if ``module_command`` says how, else imported.
    module_command : tuple of str
        Behind ``python -m``.
    cure : str
        How to install it, for messages.
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
        program = next(filter(None, map(shutil.which, self.commands)), None)
        if program is not None:
            return [program]
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


def require(name: str, purpose: str) -> list[str]:
    """Return the command of a tool.

    Raises InputError if it is missing, with the purpose and the cure.
    """
    tool = TOOLS[name]
    command = tool.find()
    if command is None:
        raise InputError(f"{purpose} needs {tool.name}, which was not found; {tool.cure}.")
    return command


def run_tool(command: Sequence[str], folder: Path, purpose: str) -> str:
    """Run a command in a folder; return its standard output.

    Raises GyrosparkError if it fails, with its messages.
    """
    # a build by zig may take a minute more, which the progress says
    zig = TOOLS["zig"].find() or []
    is_zig = bool(zig) and [*command[:len(zig)]] == zig
    library = ", and at first zig's own library, up to a minute" if is_zig else ""
    try:
        with log_task(f"{purpose[0].lower()}{purpose[1:]}{library}"):
            process = subprocess.run(command, cwd=folder, capture_output=True, check=False,
                                     stdin=subprocess.DEVNULL, encoding="utf-8", errors="replace",
                                     timeout=_PATIENCE)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise GyrosparkError(f"{purpose} failed: {shlex.join(command)}: {error}.") from error
    if process.returncode != 0:
        output = process.stderr.strip() or process.stdout.strip()
        raise GyrosparkError(f"{purpose} {exit_reason(process.returncode)}: "
                             f"{shlex.join(command)}\n{output}")
    return process.stdout
