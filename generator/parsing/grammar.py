"""The grammar of arithmetic text: tokens, limits, and one parser for whatever numbers compute.

    sum     = product { ("+" | "-") product }
    product = signed { ("*" | "/") signed }
    signed  = { "+" | "-" } power
    power   = atom [ "**" signed ]                  -2**2 = -4,  2**3**2 = 2**9,  2**-1 = 1/2
    atom    = number | name | function "(" sum { "," sum } ")" | "(" sum ")"
            | "if" "(" condition "," sum "," sum ")"
    condition  = all { "or" all }
    all        = comparison { "and" comparison }
    comparison = sum ( "<" | "<=" | ">" | ">=" | "==" | "!=" ) sum { ... }     0 < x < 1

Comparisons occur in the condition of an if(...) only; an arithmetic that has no
function "if" knows none. And of a number with a unit, where one is meant:

    quantity = product [unit] { ("+" | "-") product [unit] }         each with a unit, or none
    unit     = "deg" | "rad" | "deg/s" | "rad/s" | "rpm"             10*3 deg, 90 deg - 0.1 rad

The text comes from files of unknown origin: it is never handed to Python or to SymPy's parsers.
What an operation means is an ``ParserArithmetic``: exact bounded numbers in ``exact_expressions``,
formulas in named symbols in ``models.formulas``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Generic, Protocol, TypeVar, cast

from ...core.arguments import proposal
from ...core.errors import InputError
from .tokens import (
    RefusedError,
    Token,
    decimal_parts,
    error_at,
    names_in,
    refuse_at,
    shorten,
    tokens,
)

__all__ = ["ANGLES", "RATES", "UNITS", "Choosing", "ParserArithmetic", "parse", "parse_quantity"]

MAX_LENGTH = 4000
MAX_DEPTH = 50
MAX_DIGITS = 100

#: Signs that compare, and the words between comparisons.
COMPARISONS = ("<", "<=", ">", ">=", "==", "!=")
CHOICE = "if"
#: Units → what they are times rad, or rad/s.
ANGLES = {"deg": "pi/180", "rad": "1"}
RATES = {"deg/s": "pi/180", "rad/s": "1", "rpm": "pi/30"}
UNITS = ANGLES | RATES

V = TypeVar("V")


class ParserArithmetic(Protocol[V]):
    """Operations of a text; each may raise ``RefusedError``."""

    @property
    def functions(self) -> Mapping[str, int]:
        """Name of each function → how many arguments it takes; −2: two or more."""

    @property
    def names(self) -> Mapping[str, Any]:
        """The names that ``named`` knows."""

    def literal(self, digits: int, exponent: int) -> V:
        """Return digits · 10^exponent."""

    def named(self, name: str) -> V:
        """Return the value of a name."""

    def add(self, terms: Sequence[V]) -> V:
        """Return the sum."""

    def multiply(self, factors: Sequence[V]) -> V:
        """Return the product."""

    def negative(self, value: V) -> V:
        """Return −value."""

    def reciprocal(self, value: V) -> V:
        """Return 1/value."""

    def power(self, base: V, exponent: V) -> V:
        """Return base**exponent."""

    def call(self, function: str, arguments: Sequence[V]) -> V:
        """Return a function's value."""


class Choosing(ParserArithmetic[V], Protocol[V]):
    """An arithmetic with the function "if"; conditions are of whatever type it likes."""

    def compare(self, sign: str, a: V, b: V) -> Any:
        """Return the condition a < b, a == b, …"""

    def join(self, word: str, conditions: Sequence[Any]) -> Any:
        """Return the condition that all ("and") or any ("or") of these hold."""

    def choose(self, condition: Any, yes: V, no: V) -> V:
        """Return ``yes`` where a condition holds, else ``no``."""


def parse(text: str, arithmetic: ParserArithmetic[V], example: str) -> V:
    """Return the value of a text in an arithmetic; ``example`` is proposed for an empty text.

    Raises ``InputError``, with the position and the cure, for text that is empty, too long, too
    deeply nested or not of the grammar, for unknown names and functions, and for whatever the
    arithmetic refuses.
    """
    if len(text) > MAX_LENGTH:
        raise InputError(
            f"The expression {shorten(text)!r} has {len(text)} characters and at most "
            f"{MAX_LENGTH} are allowed; simplify it or write it in decimals."
        )
    if not text.strip():
        raise InputError(f"The expression is empty; write {example}.")
    parser = _Parser(text, arithmetic)
    value = parser.sum()
    parser.end()
    return value


def parse_quantity(
    text: str, arithmetic: ParserArithmetic[V], example: str, units: Mapping[str, str]
) -> V:
    """Return the value of a text with units: as ``parse``, in rad and seconds."""
    if len(text) > MAX_LENGTH or not names_in(text) & _words(UNITS):
        return parse(text, arithmetic, example)
    factors = {unit: parse(factor, arithmetic, example) for unit, factor in units.items()}
    parser = _Parser(text, arithmetic)
    value = parser.quantity(factors)
    parser.end()
    return value


def _words(units: Iterable[str]) -> set[str]:
    """Return the first words of units."""
    return {unit.partition("/")[0] for unit in units}


class _Parser(Generic[V]):
    """Recursive descent: one method for each line of the grammar."""

    def __init__(self, text: str, arithmetic: ParserArithmetic[V]) -> None:
        self.text = text
        self.arithmetic = arithmetic
        self.tokens = list(tokens(text))
        self.next = 0
        self.depth = 0

    @property
    def token(self) -> Token:
        return self.tokens[self.next]

    def accept(self, *signs: str) -> Token | None:
        """Return the next token and go on, if it is one of these signs."""
        token = self.token
        if token.kind != "sign" or token.text not in signs:
            return None
        self.next += 1
        return token

    def sum(self) -> V:
        start = self.token
        terms = [self.product()]
        while sign := self.accept("+", "-"):
            term = self.product()
            terms.append(self.negative(sign, term) if sign.text == "-" else term)
        return self.at(start, self.arithmetic.add, terms) if len(terms) > 1 else terms[0]

    def quantity(self, units: Mapping[str, V]) -> V:
        start, terms, bare = self.token, [self.product()], []
        while True:
            unit = self.unit(units)
            if unit is None:
                bare.append(self.token)
            else:
                terms[-1] = self.at(start, self.arithmetic.multiply, [terms[-1], unit])
            sign = self.accept("+", "-")
            if sign is None:
                break
            term = self.product()
            terms.append(self.negative(sign, term) if sign.text == "-" else term)
        if bare and len(bare) < len(terms):
            raise error_at(self.text, bare[0].position, "A term has no unit, and another has",
                           "write one behind each, or brackets: (10 + 20) deg")
        return self.at(start, self.arithmetic.add, terms) if len(terms) > 1 else terms[0]

    def unit(self, units: Mapping[str, V]) -> V | None:
        """Read a unit, if there is one."""
        token = self.token
        if token.kind != "name" or token.text not in _words(UNITS):
            return None
        self.next += 1
        name = token.text
        if self.accept("/"):
            name, self.next = f"{name}/{self.token.text}", self.next + (self.token.kind != "end")
        if name not in units:
            cure = f"write {', '.join(units)}, or none" if units else "leave it out"
            raise error_at(self.text, token.position,
                           f"The unit {shorten(name, 20)} has no place here", cure)
        return units[name]

    def product(self) -> V:
        start = self.token
        factors = [self.signed()]
        while sign := self.accept("*", "/"):
            factor = self.signed()
            factors.append(self.at(sign, self.arithmetic.reciprocal, factor)
                           if sign.text == "/" else factor)
        return self.at(start, self.arithmetic.multiply, factors) if len(factors) > 1 else factors[0]

    def signed(self) -> V:
        start = self.token
        minus = False
        while sign := self.accept("+", "-"):
            minus ^= sign.text == "-"
        value = self.power()
        return self.negative(start, value) if minus else value

    def power(self) -> V:
        base = self.atom()
        sign = self.accept("**")
        if sign is None:
            return base
        return self.at(sign, self.arithmetic.power, base, self.nested(sign, self.signed))

    def atom(self) -> V:
        token = self.token
        if token.kind == "number":
            self.next += 1
            return self.at(token, self.literal, token.text)
        if token.kind == "name":
            self.next += 1
            if token.text not in self.arithmetic.functions:
                return self.name(token)
            return self.choice(token) if token.text == CHOICE else self.call(token)
        if self.accept("("):
            value = self.nested(token, self.sum)
            self.close(token)
            return value
        raise self.error("A number, a name or ( is missing", "complete the expression")

    def literal(self, text: str) -> V:
        whole, fraction, exponent = decimal_parts(text)
        digits = whole + fraction
        if len(digits) > MAX_DIGITS:
            raise RefusedError(
                f"The number has {len(digits)} digits and at most {MAX_DIGITS} are allowed; "
                "round it"
            )
        return self.arithmetic.literal(int(digits), exponent - len(fraction))

    def call(self, name: Token) -> V:
        opening = self.opened(name)
        arguments = self.arguments(opening, self.sum)
        wanted = self.arithmetic.functions[name.text]
        if len(arguments) != wanted and not (wanted < 0 and len(arguments) >= -wanted):
            raise self.miscounted(name, arguments,
                                  f"{-wanted} or more" if wanted < 0 else f"{wanted}")
        return self.at(name, self.arithmetic.call, name.text, arguments)

    def opened(self, name: Token) -> Token:
        """Read the parenthesis behind the name of a function."""
        opening = self.accept("(")
        if opening is None:
            raise self.error(f"The function {name.text} has no argument", f"write {name.text}(…)")
        return opening

    def arguments(self, opening: Token, first: Callable[[], Any]) -> list[Any]:
        found = [self.nested(opening, first)]
        while self.accept(","):
            found.append(self.nested(opening, self.sum))
        self.close(opening)
        return found

    def miscounted(self, name: Token, arguments: Sequence[Any], wanted: str) -> InputError:
        return error_at(self.text, name.position,
                        f"The function {name.text} has {len(arguments)} arguments",
                        f"give it {wanted}")

    # ------------------------------------------------------------ conditions

    def choice(self, name: Token) -> V:
        opening = self.opened(name)
        arguments = self.arguments(opening, self.condition)
        if len(arguments) != 3:
            raise self.miscounted(name, arguments, "a condition, what holds then, and what else")
        return self.at(name, self.choosing.choose, *arguments)

    def condition(self) -> Any:
        return self.joined("or", lambda: self.joined("and", self.comparison))

    def joined(self, word: str, part: Callable[[], Any]) -> Any:
        start = self.token
        parts = [part()]
        while self.token.kind == "name" and self.token.text == word:
            self.next += 1
            parts.append(part())
        return self.at(start, self.choosing.join, word, parts) if len(parts) > 1 else parts[0]

    def comparison(self) -> Any:
        start = self.token
        left, found = self.sum(), []
        while sign := self.accept(*COMPARISONS):
            right = self.sum()
            found.append(self.at(sign, self.choosing.compare, sign.text, left, right))
            left = right
        if not found:
            raise self.error("A comparison is missing", f"write one of {' '.join(COMPARISONS)}")
        return self.at(start, self.choosing.join, "and", found) if len(found) > 1 else found[0]

    @property
    def choosing(self) -> Choosing[V]:
        """The arithmetic, which has the function "if"."""
        return cast("Choosing[V]", self.arithmetic)

    def name(self, token: Token) -> V:
        if token.text not in self.arithmetic.names:
            functions = (f"{name}(…)" for name in self.arithmetic.functions)
            known = ", ".join([*sorted(self.arithmetic.names), *functions])
            self.next -= 1
            raise self.error(f"The name {shorten(token.text)} is unknown",
                             f"use one of {shorten(known, 600)}"
                             f"{proposal(token.text, self.arithmetic.names)}")
        return self.at(token, self.arithmetic.named, token.text)

    def close(self, opening: Token) -> None:
        """Read the parenthesis that belongs to an opening one."""
        if not self.accept(")"):
            self.refuse_comparison()
            reason = f"The ( of character {opening.position + 1} is not closed here"
            raise self.error(reason, "write ) or one of + - * / **")

    def nested(self, token: Token, method: Callable[[], V]) -> V:
        """Read with one of the methods, one level deeper."""
        if self.depth == MAX_DEPTH:
            reason = f"This is nested deeper than {MAX_DEPTH} levels"
            raise error_at(self.text, token.position, reason, "simplify the expression")
        self.depth += 1
        value = method()
        self.depth -= 1
        return value

    def end(self) -> None:
        if self.token.kind != "end":
            self.refuse_comparison()
            reason = f"{shorten(self.token.text)} cannot follow here"
            raise self.error(reason, "write one of + - * / ** in between, and a ( for every )")

    def refuse_comparison(self) -> None:
        """Refuse a comparison outside a condition."""
        if self.token.text in COMPARISONS and CHOICE in self.arithmetic.functions:
            raise self.error("A comparison belongs in the condition of an if",
                             f"write {CHOICE}(…, a, b)")

    def negative(self, token: Token, value: V) -> V:
        return self.at(token, self.arithmetic.negative, value)

    def at(self, token: Token, function: Callable[..., V], *arguments: Any) -> V:
        """Carry out an operation that belongs to a token."""
        result: V = refuse_at(self.text, token.position, function, *arguments)
        return result

    def error(self, reason: str, cure: str) -> InputError:
        return error_at(self.text, self.token.position, reason, cure)
