"""One C file that compiles alone: the headers of the engine in place of their includes.

A preprocessor for the names that begin with ``GS_`` and for includes of ``gyrospark/``, and for
nothing else: it keeps the branches of the features, and leaves all other lines as they are.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from ..core.errors import GyrosparkError

__all__ = ["FOLDER", "INCLUDE_CHECK", "amalgamate", "complete"]

#: The folder for ``-I``: headers are ``gyrospark/...`` in it.
FOLDER = Path(__file__).resolve().parent
#: What a generated file says where the compiler does not find the engine.
INCLUDE_CHECK = """\
#ifdef __has_include
#if !__has_include("gyrospark/engine.h")
#error "The engine is missing: add -I $(gyrospark include), or generate with --standalone."
#endif
#endif
"""
_INCLUDE = re.compile(r'#include "(gyrospark/[\w./]+)"$')
_DEFINE = re.compile(r"#define (GS_\w+)(?: (\d+))?(?: */\*.*\*/)?$")
_OWN = re.compile(r"#(?:(ifdef|ifndef) (GS_\w+)|(if|elif) ((?:[!() ]*\bGS_\w+|[\d&|=!() ])+)"
                  r"|(else|endif)\b)")
_TOKEN = re.compile(r"\s*(\w+|&&|\|\||==|!=|[!()])")


def amalgamate(source: str) -> str:
    """Return C without includes of the engine, which compiles to what the source compiles to.

    Raises
    ------
    GyrosparkError
        If a header of the engine is missing, or is of another version than the source.
    """
    if '#include "gyrospark/' not in source:
        return source
    lines: list[str] = []
    _process(source.replace(INCLUDE_CHECK, ""), {}, lines)
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)) + "\n"


def complete(files: Mapping[str, str]) -> dict[str, str]:
    """Return the files of a stepper, its C with the engine in it."""
    return {name: amalgamate(text) if name.endswith(".c") else text
            for name, text in files.items()}


@cache
def _header(name: str) -> str:
    try:
        text = (FOLDER / name).read_text(encoding="ascii")
        return text.partition("*/\n")[2]  # after the comment that says what the file is for
    except OSError as error:
        raise GyrosparkError(
            f"The header {name!r} of the engine is missing in {str(FOLDER)!r}; install gyrospark "
            "again, or generate the file with this version.") from error


def _process(text: str, names: dict[str, int], lines: list[str]) -> None:
    """Append the lines of a text; ``names`` are the GS_ names defined so far."""
    # Of each conditional that is open: whether its lines are kept, whether a branch was taken
    # already, and whether it is one of ours.
    open_: list[tuple[bool, bool, bool]] = []
    for line in text.rstrip("\n").split("\n"):
        kept = all(state[0] for state in open_)
        if line.startswith("#"):
            own = _OWN.match(line)
            if own and (own[2] or own[4]) and (own[3] != "elif" or open_[-1][2]):
                if own[3] == "elif":
                    _, taken, _ = open_.pop()
                    true = not taken and _value(own[4], names)
                    open_.append((true, taken or true, True))
                else:
                    true = kept and (_value(own[4], names) if own[4]
                                     else (own[2] in names) == (own[1] == "ifdef"))
                    open_.append((true, true, True))
                continue
            if line.startswith("#if"):
                open_.append((True, True, False))
            elif own and own[5] and open_[-1][2]:
                _, taken, _ = open_.pop()
                if own[5] == "else":
                    open_.append((not taken, True, True))
                continue
            elif line.startswith("#endif"):
                open_.pop()
            if not kept:
                continue
            if found := _INCLUDE.match(line):
                _process(_header(found[1]), names, lines)
                continue
            if found := _DEFINE.match(line):
                names[found[1]] = int(found[2] or 1)
                continue
            if line.startswith("#undef GS_"):
                names.pop(line.split()[1], None)
                continue
            if line.startswith("#error"):
                raise GyrosparkError(line.partition('"')[2].rstrip('"'))
        if kept:
            lines.append(line)
    assert not open_


def _value(expression: str, names: dict[str, int]) -> bool:
    """Return the value of a condition: GS_ names, whole numbers, ``! == != && || ( )``."""
    tokens = _TOKEN.findall(expression.partition("/*")[0])

    def either() -> int:
        value = both()
        while tokens[:1] == ["||"]:
            tokens.pop(0)
            value = both() or value
        return value

    def both() -> int:
        value = equal()
        while tokens[:1] == ["&&"]:
            tokens.pop(0)
            value = equal() and value
        return value

    def equal() -> int:
        value = single()
        while tokens[:1] in (["=="], ["!="]):
            same = tokens.pop(0) == "=="
            value = (value == single()) == same
        return value

    def single() -> int:
        token = tokens.pop(0)
        if token == "!":
            return not single()
        if token == "(":
            value = either()
            tokens.pop(0)
            return value
        return int(token) if token.isdigit() else names.get(token, 0)

    return bool(either())
