"""Line breaks in generated C: names of steppers and kernels make some lines too long."""

from __future__ import annotations

import re
import textwrap

__all__ = ["WIDTH", "wrap_lines"]

#: Characters of a line of C, as of the Python here.
WIDTH = 100
_EMPTY = re.compile(r"\n{3,}")


def wrap_lines(text: str) -> str:
    """Return C with lines of at most ``WIDTH`` characters, without two empty lines in a row.

    Lines of code are broken after commas (a line without a comma stays long); a comment of one line
    becomes one of several. Equations in the comment at the top are not wrapped.
    """
    lines: list[str] = []
    for line in _EMPTY.sub("\n\n", text).split("\n"):
        fits = len(line) <= WIDTH or line.lstrip().startswith("*")
        lines += [line] if fits else _break_line(line)
    return "\n".join(lines)


def _break_line(line: str) -> list[str]:
    """Return the lines of one long line; continuation lines are indented by four more columns."""
    indent = line[: len(line) - len(line.lstrip())]
    if line.startswith("/* ") and line.endswith(" */"):
        inner = textwrap.wrap(line[3:-3], WIDTH - 3, break_long_words=False)  # room for " * "
        return ["/*", *(f" * {text}" for text in inner), " */"]
    lines = []
    while len(line) > WIDTH:
        end = line.rfind(", ", 0, WIDTH) + 1  # behind the last comma that fits
        # no comma, or only the indentation in front of it: a break would not shorten the line
        if end <= len(indent) + 4:
            break
        lines.append(line[:end])
        line = f"{indent}    {line[end + 1:]}"
    return [*lines, line]
