"""Writing, compiling and running C programs around generated files."""

from __future__ import annotations

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
