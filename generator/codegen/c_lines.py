"""Lines of C that fit on a screen: names of steppers and kernels make some of them long."""

from __future__ import annotations

import re
import textwrap

__all__ = ["WIDTH", "fitted"]

WIDTH = 100
_EMPTY = re.compile(r"\n{3,}")


def fitted(text: str) -> str:
    """Return C with no line beyond ``WIDTH`` that can be broken, nor two empty lines in a row.

    Lines of code are broken behind commas; a comment of one line becomes one of several. Equations
    in the comment on top stay as they are.
    """
    lines: list[str] = []
    for line in _EMPTY.sub("\n\n", text).split("\n"):
        lines += [line] if len(line) <= WIDTH or line.lstrip().startswith("*") else _broken(line)
    return "\n".join(lines)


def _broken(line: str) -> list[str]:
    indent = line[: len(line) - len(line.lstrip())]
    if line.startswith("/* ") and line.endswith(" */"):
        inner = textwrap.wrap(line[3:-3], WIDTH - 3, break_long_words=False)
        return ["/*", *(f" * {part}" for part in inner), " */"]
    parts = []
    while len(line) > WIDTH:
        at = line.rfind(", ", 0, WIDTH) + 1
        if at <= len(indent) + 4:
            break
        parts.append(line[:at])
        line = f"{indent}    {line[at + 1:]}"
    return [*parts, line]
