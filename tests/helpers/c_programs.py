"""Writing, compiling and running C programs around generated files."""

from __future__ import annotations

import ctypes

from compilers import MAIN, compiler
from processes import call

STRICT = ["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]


def write(files, folder):
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")


def run(command, folder, **changes):
    """Run a command that must succeed without a word on stderr."""
    done = call(command, cwd=folder, **changes)
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return done.stdout


def shared_library(source, folder):
    """Compile a stepper with all warnings as errors, and load it."""
    write(source.files(), folder)
    run([*compiler(MAIN), *STRICT, "-Wshadow", "-O0", "-shared", "-fPIC", f"{source.name}.c", "-o",
         f"{source.name}.so", "-lm"], folder)
    return ctypes.CDLL(str(folder / f"{source.name}.so"))
