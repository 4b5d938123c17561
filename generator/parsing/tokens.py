"""Tokens of arithmetic text, and errors with their position."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from ...core.errors import InputError
from ...core.records import dataclass

__all__ = ["DecimalParts", "RefusedError", "Token", "decimal_parts", "error_at", "names_in",
           "refuse_at", "shorten", "tokens"]

#: Doubles end at 1e308; 10^400 has 1329 bits, which exact arithmetic handles at once.
MAX_DECIMAL_EXPONENT = 400


class RefusedError(Exception):
    """An operation is refused: "reason; cure". The parser adds the position in the text."""


@dataclass(frozen=True)
class Token:
    """A token: "number", "name", "sign" or "end", and its position, from 0."""

    kind: str
    text: str
    position: int


TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z_0-9]*)"
    r"|(?P<sign>\*\*|[<>=!]=|[-+*/(),<>])"
    r"|(?P<space>[ \t\r\n]+)"
)


#: Characters that other languages have, and what the grammar has in their place.
_CURES = {"^": "write ** for a power", "=": "write == for a comparison"}


def tokens(text: str) -> Iterator[Token]:
    """Yield the tokens of a text; the last one is "end"."""
    position = 0
    while position < len(text):
        match = TOKEN.match(text, position)
        if match is None:
            character = text[position]
            cure = _CURES.get(character, "use digits, names, + - * / ** ( and )")
            raise error_at(text, position, f"The character {character!r} has no meaning", cure)
        kind = str(match.lastgroup)  # the name of the group that matched
        if kind != "space":
            yield Token(kind, match.group(), position)
        position = match.end()
    yield Token("end", "", len(text))


def error_at(text: str, position: int, reason: str, cure: str = "") -> InputError:
    """Return an error that names the position, counted from 1, and the text around it."""
    context = text[max(0, position - 30) : position + 30]
    message = f"{reason} (character {position + 1}, near {context!r})"
    return InputError(f"{message}; {cure}." if cure else f"{message}.")


def refuse_at(text: str, position: int, function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function and add the position in the text to its error."""
    try:
        return function(*arguments)
    except RefusedError as refusal:
        reason, _, cure = str(refusal).rpartition("; ")
        raise error_at(text, position, reason, cure) from None


class DecimalParts(NamedTuple):
    """Digits before and after the point of a literal, and its exponent of 10."""

    integer_part: str
    fraction: str
    exponent: int


def decimal_parts(literal: str) -> DecimalParts:
    """Return the parts of a decimal literal; refuse a long exponent."""
    mantissa, _, exponent = literal.lower().partition("e")
    integer_part, _, fraction = mantissa.partition(".")
    # by its length first: the conversion of thousands of digits takes long
    if len(exponent.lstrip("+-0")) > 3 or abs(int(exponent or 0)) > MAX_DECIMAL_EXPONENT:
        raise RefusedError(f"The decimal exponent {shorten(exponent, 20)} is not within "
                           f"±{MAX_DECIMAL_EXPONENT}; write the number with a smaller one")
    return DecimalParts(integer_part, fraction, int(exponent or 0))


def shorten(text: str, length: int = 60) -> str:
    """Return a text cut to a length that fits a message."""
    return text if len(text) <= length else text[: length - 1] + "…"


def names_in(text: str) -> set[str]:
    """Return the names that a text mentions."""
    return {token.text for token in tokens(text) if token.kind == "name"}
