"""One C file that compiles alone: the headers of the engine in place of their includes.

A preprocessor for the engine's names, which begin with ``GS_``, and for includes of ``gyrospark/``,
and for nothing else: it keeps the branches of the features, and leaves all other lines as they are.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

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
#: A line for this preprocessor; the text between two of them stays as it is.
_DIRECTIVE = re.compile(
    r'\n(#(?:if|elif|else|endif|include "gyrospark/|define GS_|undef GS_|error).*)')
_INCLUDE = re.compile(r'#include "(gyrospark/[\w./]+)"$')
# A feature has a number, and the guard of a header ends with _H: a name without either is that of
# a system "gs" or "gs_…", such as GS_DEMO_GL2_WORK, which its own header reads.
_DEFINE = re.compile(r"#define (GS_\w+(?= \d)|GS_\w+_H)(?: (\d+))?(?: */\*.*\*/)?$")
_CONDITIONAL = re.compile(r"#(?:(ifdef|ifndef) (GS_\w+)|(if|elif) "
                          r"((?:[!() ]*\bGS_\w+|[\d&|=!() ])+)|(else|endif)\b)")
_TOKEN = re.compile(r"\s*(\w+|&&|\|\||==|!=|[!()])")


def amalgamate(source: str) -> str:
    """Return C without includes of the engine, which compiles to what the source compiles to.

    Raises GyrosparkError if a header of the engine is missing, or is of another version than the
    source.
    """
    if '#include "gyrospark/' not in source:
        return source
    pieces: list[str] = []
    _process(_split(source.replace(INCLUDE_CHECK, "")), {}, pieces)
    text = "".join(pieces)[1:] + "\n"
    while "\n\n\n" in text:  # blank lines around what was left out
        text = text.replace("\n\n\n", "\n\n")
    return text


def complete(files: Mapping[str, str]) -> dict[str, str]:
    """Return the files of a stepper, its C with the engine in it."""
    return {name: amalgamate(text) if name.endswith(".c") else text
            for name, text in files.items()}


class _Directive(NamedTuple):
    """A line for this preprocessor, the text above it, and what its conditional consists of."""

    before: str
    line: str
    #: Of ``_CONDITIONAL``; None of all other lines.
    groups: Sequence[str | None]


def _split(text: str) -> tuple[list[_Directive], str]:
    """Return the directives of a text, and what is behind the last; a line feed precedes a line."""
    text, place, directives = "\n" + text.rstrip("\n"), 0, []
    for directive in _DIRECTIVE.finditer(text):
        conditional = _CONDITIONAL.match(directive[1])
        directives.append(_Directive(text[place : directive.start()], directive[1],
                                     conditional.groups() if conditional else (None,) * 5))
        place = directive.end()
    return directives, text[place:]


@cache
def _header(name: str) -> tuple[list[_Directive], str]:
    """Return a header of the engine, split once for all steppers of a process."""
    try:
        text = (FOLDER / name).read_text(encoding="ascii")
    except OSError as error:
        raise GyrosparkError(
            f"The header {name!r} of the engine is missing in {str(FOLDER)!r}; install gyrospark "
            "again, or generate the file with this version.") from error
    return _split(text.partition("*/\n")[2])  # after the comment that says what the file is for


class _Branch(NamedTuple):
    """The branch of an open conditional that the current line stands in."""

    is_active: bool
    #: Was this branch, or one above it, active? Then ``#elif`` and ``#else`` are not.
    has_been_active: bool
    #: Is the condition one of GS_ names? All others are left to the compiler.
    is_ours: bool


def _process(
    text: tuple[list[_Directive], str], names: dict[str, int], pieces: list[str]
) -> None:
    """Append the lines of a text, a line feed before each; ``names`` are the GS_ names so far."""
    branches: list[_Branch] = []
    directives, rest = text
    for directive in directives:
        line, is_active = directive.line, all(branch.is_active for branch in branches)
        if is_active:
            pieces.append(directive.before)
        if _take_conditional(directive, branches, names, is_active) or not is_active:
            continue
        if match := _INCLUDE.match(line):
            _process(_header(match[1]), names, pieces)
        elif match := _DEFINE.match(line):
            names[match[1]] = int(match[2] or 1)
        elif line.startswith("#undef GS_"):
            names.pop(line.split()[1], None)
        elif line.startswith("#error"):
            raise GyrosparkError(line.partition('"')[2].rstrip('"'))
        else:
            pieces.append(f"\n{line}")
    assert not branches
    pieces.append(rest)


def _take_conditional(
    directive: _Directive, branches: list[_Branch], names: dict[str, int], is_active: bool
) -> bool:
    """Open or close a branch as a directive says; return whether it is of GS_ names, and left out.

    ``is_active`` says whether the line stands in active branches alone.
    """
    name_test, name, keyword, condition, ending = directive.groups
    if condition and (keyword == "if" or branches[-1].is_ours):
        before = keyword == "elif" and branches.pop().has_been_active
        # #elif stands in the branch above it, which need not be active
        chosen = (keyword == "elif" or is_active) and not before and _value(condition, names)
        branches.append(_Branch(chosen, chosen or before, is_ours=True))
        return True
    if name:
        chosen = is_active and (name in names) == (name_test == "ifdef")
        branches.append(_Branch(chosen, chosen, is_ours=True))
        return True
    if directive.line.startswith("#if"):
        branches.append(_Branch(True, has_been_active=True, is_ours=False))
    elif ending and branches[-1].is_ours:
        before = branches.pop().has_been_active
        if ending == "else":
            branches.append(_Branch(not before, has_been_active=True, is_ours=True))
        return True
    elif directive.line.startswith("#endif"):
        branches.pop()
    return False


@cache
def _tokens(expression: str) -> tuple[str, ...]:
    return tuple(_TOKEN.findall(expression.partition("/*")[0]))


def _value(expression: str, names: dict[str, int]) -> bool:
    """Return the value of a condition: GS_ names, whole numbers, ``! == != && || ( )``."""
    tokens = list(_tokens(expression))

    # One function for each level of precedence, the loosest first.
    def disjunction() -> int:
        value = conjunction()
        while tokens[:1] == ["||"]:
            tokens.pop(0)
            value = conjunction() or value
        return value

    def conjunction() -> int:
        value = comparison()
        while tokens[:1] == ["&&"]:
            tokens.pop(0)
            value = comparison() and value
        return value

    def comparison() -> int:
        value = single()
        while tokens[:1] in (["=="], ["!="]):
            equality = tokens.pop(0) == "=="
            value = (value == single()) == equality
        return value

    def single() -> int:
        token = tokens.pop(0)
        if token == "!":
            return not single()
        if token == "(":
            value = disjunction()
            tokens.pop(0)
            return value
        return int(token) if token.isdigit() else names.get(token, 0)

    return bool(disjunction())
