"""Arithmetic text, such as the entry of a tableau file, read into exact SymPy numbers.

    sum     = product { ("+" | "-") product }
    product = signed { ("*" | "/") signed }
    signed  = { "+" | "-" } power
    power   = atom [ "**" signed ]                  -2**2 = -4,  2**3**2 = 2**9,  2**-1 = 1/2
    atom    = number | name | function "(" sum ")" | "(" sum ")"

The text comes from files of unknown origin: it is never handed to Python or to SymPy's parsers.
What it asks for is carried out by ``bounded_numbers``, so time and memory are bounded too.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import sympy as sp

from ..errors import InputError
from .bounded_numbers import (
    FUNCTIONS,
    RefusedError,
    Value,
    add,
    multiply,
    named,
    power,
    rational,
    reciprocal,
    shorten,
)

__all__ = ["FUNCTIONS", "decimal_digits", "parse_expression"]

MAX_LENGTH = 4000
MAX_DEPTH = 50
MAX_DIGITS = 100
MAX_DECIMAL_EXPONENT = 400
#: Different radicals, such as √3; each costs SymPy a search for square factors.
MAX_RADICALS = 100

# ---------------------------------------------------------------- tokens


@dataclass(frozen=True)
class _Token:
    kind: str  # "number", "name", "sign" or "end"
    text: str
    position: int  # from 0


TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z_0-9]*)"
    r"|(?P<sign>\*\*|[-+*/()])"
    r"|(?P<space>[ \t\r\n]+)"
)


def _tokens(text: str) -> Iterator[_Token]:
    """Split a text; the end of it is a token too."""
    position = 0
    while position < len(text):
        match = TOKEN.match(text, position)
        if match is None:
            raise _error(
                text, position, f"The character {text[position]!r} has no meaning",
                "use digits, names, + - * / ** ( and )",
            )
        kind = str(match.lastgroup)
        if kind != "space":
            yield _Token(kind, match.group(), position)
        position = match.end()
    yield _Token("end", "", len(text))


def _error(text: str, position: int, reason: str, cure: str = "") -> InputError:
    """Return an error that names the position, counted from 1, and the text around it."""
    around = text[max(0, position - 30) : position + 30]
    message = f"{reason} (character {position + 1}, near {around!r})"
    return InputError(f"{message}; {cure}." if cure else f"{message}.")


def _decimal_parts(literal: str) -> tuple[str, str, int]:
    """Return the digits before and after the point and the decimal exponent of a literal."""
    mantissa, _, exponent = literal.lower().partition("e")
    whole, _, fraction = mantissa.partition(".")
    if len(exponent.lstrip("+-0")) > 3 or abs(int(exponent or 0)) > MAX_DECIMAL_EXPONENT:
        raise RefusedError(
            f"The decimal exponent {shorten(exponent, 20)} is not within "
            f"±{MAX_DECIMAL_EXPONENT}; write the number with a smaller one"
        )
    return whole, fraction, int(exponent or 0)


def _literal(literal: str) -> Value:
    """Return a number as it is written: 0.25 is 1/4."""
    whole, fraction, exponent = _decimal_parts(literal)
    digits = whole + fraction
    if len(digits) > MAX_DIGITS:
        raise RefusedError(
            f"The number has {len(digits)} digits and at most {MAX_DIGITS} are allowed; "
            "round it"
        )
    return rational(sp.Integer(int(digits)) * sp.Integer(10) ** (exponent - len(fraction)))


def decimal_digits(text: str, exact_up_to: int = 0) -> int | None:
    """Return how many digits after the point the least precise rounded decimal of a text has.

    A decimal is rounded if, trailing zeros apart, it has more than ``exact_up_to`` digits after
    the point; None when the text has no such decimal. With ``exact_up_to=8``:
    "1/4 + 0.25" → None, "0.21132486540519" → 14, "2.1132486540519e-1" → 14.

    Raises ``InputError`` where ``parse_expression`` does for an unknown character or exponent.
    """
    counts = []
    for token in _tokens(text):
        if token.kind == "number":
            written, needed = _refuse_at(text, token.position, _digits_after_point, token.text)
            if needed > exact_up_to:
                counts.append(written)
    return min(counts, default=None)


def _digits_after_point(literal: str) -> tuple[int, int]:
    """Return the digits after the point as written, and without trailing zeros."""
    whole, fraction, exponent = _decimal_parts(literal)
    digits = (whole + fraction).lstrip("0")
    written = len(fraction) - exponent
    zeros = len(digits) - len(digits.rstrip("0"))
    return written, written - zeros if digits else 0


def _refuse_at(text: str, position: int, function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function and say where in the text its refusal, if any, belongs."""
    try:
        return function(*arguments)
    except RefusedError as refusal:
        reason, _, cure = str(refusal).rpartition("; ")
        raise _error(text, position, reason, cure) from None


# ---------------------------------------------------------------- the parser


def parse_expression(
    text: str,
    names: Mapping[str, sp.Expr] = MappingProxyType({}),
    radicals: set[sp.Expr] | None = None,
) -> sp.Expr:
    """Return the exact value of an arithmetic text, e.g. "1/4 - sqrt(3)/6" or "0.25".

    Decimals are taken as they are written, ``names`` says what each name stands for, and an
    exponent is an integer or a half-integer. A set passed as ``radicals`` collects the different
    radicals met; with one set for all entries of a file, the limit on them holds for the file.

    Raises ``InputError``, with the position and the cure, for text that is empty, too long, too
    deeply nested or not of the grammar above, an unknown name or function, a division by zero,
    the square root of a negative number, and numbers too large to be coefficients.
    """
    if len(text) > MAX_LENGTH:
        raise InputError(
            f"The expression {shorten(text)!r} has {len(text)} characters and at most "
            f"{MAX_LENGTH} are allowed; simplify it or write it in decimals."
        )
    if not text.strip():
        raise InputError("The expression is empty; write a number such as 1/2 or sqrt(3)/6.")
    parser = _Parser(text, names, set() if radicals is None else radicals)
    value = parser.sum()
    parser.end()
    return value.exact


def _radicals(expression: sp.Expr) -> Iterator[sp.Expr]:
    """Yield the factors of a product that are roots."""
    if not expression.is_Rational:
        for factor in sp.Mul.make_args(expression):
            if factor.is_Pow and factor.exp.is_Rational and factor.exp.q > 1:
                yield factor


class _Parser:
    """Recursive descent: one method for each line of the grammar."""

    def __init__(
        self, text: str, names: Mapping[str, sp.Expr], radicals: set[sp.Expr]
    ) -> None:
        self.text = text
        self.names = names
        self.radicals = radicals
        self.tokens = list(_tokens(text))
        self.next = 0
        self.depth = 0

    @property
    def token(self) -> _Token:
        return self.tokens[self.next]

    def accept(self, *signs: str) -> _Token | None:
        """Return the next token and go on, if it is one of these signs."""
        token = self.token
        if token.kind != "sign" or token.text not in signs:
            return None
        self.next += 1
        return token

    def sum(self) -> Value:
        start = self.token
        terms = [self.product()]
        while sign := self.accept("+", "-"):
            term = self.product()
            terms.append(self.negative(sign, term) if sign.text == "-" else term)
        return self.at(start, add, terms) if len(terms) > 1 else terms[0]

    def product(self) -> Value:
        start = self.token
        factors = [self.signed()]
        while sign := self.accept("*", "/"):
            factor = self.signed()
            factors.append(self.at(sign, reciprocal, factor) if sign.text == "/" else factor)
        return self.at(start, multiply, factors) if len(factors) > 1 else factors[0]

    def signed(self) -> Value:
        start = self.token
        minus = False
        while sign := self.accept("+", "-"):
            minus ^= sign.text == "-"
        value = self.power()
        return self.negative(start, value) if minus else value

    def power(self) -> Value:
        base = self.atom()
        sign = self.accept("**")
        if sign is None:
            return base
        return self.at(sign, power, base, self.nested(sign, self.signed))

    def atom(self) -> Value:
        token = self.token
        if token.kind == "number":
            self.next += 1
            return self.at(token, _literal, token.text)
        if token.kind == "name":
            self.next += 1
            return self.call(token) if token.text in FUNCTIONS else self.name(token)
        if self.accept("("):
            return self.parenthesis(token)
        raise self.error("A number, a name or ( is missing", "complete the expression")

    def call(self, name: _Token) -> Value:
        opening = self.accept("(")
        if opening is None:
            raise self.error(f"The function {name.text} has no argument", f"write {name.text}(…)")
        return self.at(name, FUNCTIONS[name.text], self.parenthesis(opening))

    def name(self, token: _Token) -> Value:
        if token.text not in self.names:
            known = ", ".join(sorted([*self.names, *(f"{name}(…)" for name in FUNCTIONS)]))
            self.next -= 1
            raise self.error(f"The name {shorten(token.text)} is unknown", f"use one of {known}")
        return self.at(token, named, self.names[token.text])

    def parenthesis(self, opening: _Token) -> Value:
        """Read on from after an opening parenthesis to behind the closing one."""
        value = self.nested(opening, self.sum)
        if not self.accept(")"):
            reason = f"The ( of character {opening.position + 1} is not closed here"
            raise self.error(reason, "write ) or one of + - * / **")
        return value

    def nested(self, token: _Token, method: Callable[[], Value]) -> Value:
        """Read with one of the methods, one level deeper."""
        if self.depth == MAX_DEPTH:
            reason = f"This is nested deeper than {MAX_DEPTH} levels"
            raise _error(self.text, token.position, reason, "simplify the expression")
        self.depth += 1
        value = method()
        self.depth -= 1
        return value

    def end(self) -> None:
        if self.token.kind != "end":
            reason = f"{shorten(self.token.text)} cannot follow here"
            raise self.error(reason, "write one of + - * / ** in between, and a ( for every )")

    def negative(self, token: _Token, value: Value) -> Value:
        return self.at(token, multiply, [rational(sp.Integer(-1)), value])

    def at(self, token: _Token, function: Callable[..., Value], *arguments: Any) -> Value:
        """Carry out an operation that belongs to a token."""
        result: Value = _refuse_at(self.text, token.position, function, *arguments)
        self.radicals.update(_radicals(result.exact))
        if len(self.radicals) > MAX_RADICALS:
            reason = f"This is the radical number {len(self.radicals)} of at most {MAX_RADICALS}"
            raise _error(self.text, token.position, reason, "write the number in decimals")
        return result

    def error(self, reason: str, cure: str) -> InputError:
        return _error(self.text, self.token.position, reason, cure)
