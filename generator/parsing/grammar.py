"""The grammar of arithmetic text, its limits, and one parser for all kinds of values.

    sum     = product { ("+" | "-") product }
    product = signed { ("*" | "/") signed }
    signed  = { "+" | "-" } power
    power   = atom [ "**" signed ]                  -2**2 = -4,  2**3**2 = 2**9,  2**-1 = 1/2
    atom    = number | name | function "(" sum { "," sum } ")" | "(" sum ")"
            | "if" "(" condition "," sum "," sum ")"
    condition  = all { "or" all }
    all        = comparison { "and" comparison }
    comparison = sum ( "<" | "<=" | ">" | ">=" | "==" | "!=" ) sum { ... }     0 < x < 1

Comparisons occur only in the condition of an if(...); an arithmetic without the function "if" has
none. A number with a unit:

    quantity = product [unit] { ("+" | "-") product [unit] }         each with a unit, or none
    unit     = "deg" | "rad" | "deg/s" | "rad/s" | "rpm"             10*3 deg, 90 deg - 0.1 rad

The text comes from files of unknown origin: it is never passed to Python's or SymPy's parsers. A
``ParserArithmetic`` defines the operations: exact bounded numbers in ``exact_expressions``,
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

#: Characters of a text; levels of brackets and powers, of seven calls each, of the 1000 that Python
#: allows; digits of a number.
MAX_LENGTH = 4000
MAX_DEPTH = 50
MAX_DIGITS = 100

#: Signs of comparisons, and the function that has conditions.
COMPARISONS = ("<", "<=", ">", ">=", "==", "!=")
CHOICE = "if"
#: Unit → its factor to rad, or to rad/s.
ANGLES = {"deg": "pi/180", "rad": "1"}
RATES = {"deg/s": "pi/180", "rad/s": "1", "rpm": "pi/30"}
UNITS = ANGLES | RATES

V = TypeVar("V")


class ParserArithmetic(Protocol[V]):
    """Operations of a text; each may raise ``RefusedError``."""

    @property
    def functions(self) -> Mapping[str, int]:
        """Name of each function → its number of arguments; −2: two or more."""

    @property
    def names(self) -> Mapping[str, Any]:
        """The permitted names, for which ``value_of`` returns a value."""

    def literal(self, digits: int, exponent: int) -> V:
        """Return digits · 10^exponent."""

    def value_of(self, name: str) -> V:
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
    """An arithmetic with the function "if" and a type of its own for conditions."""

    def compare(self, sign: str, a: V, b: V) -> Any:
        """Return the condition a < b, a == b, …"""

    def join(self, word: str, conditions: Sequence[Any]) -> Any:
        """Return the condition that all ("and") or any ("or") of these hold."""

    def choose(self, condition: Any, yes: V, no: V) -> V:
        """Return ``yes`` where a condition holds, else ``no``."""


def parse(text: str, arithmetic: ParserArithmetic[V], example: str) -> V:
    """Return the value of a text in an arithmetic; ``example`` is proposed for an empty text.

    Raises ``InputError``, with the position and the cure, for text that is empty, too long, too
    deeply nested or not of the grammar, for unknown names and functions, and for operations that
    the arithmetic refuses.
    """
    if len(text) > MAX_LENGTH:
        raise InputError(f"The expression {shorten(text)!r} has {len(text)} characters and at most "
                         f"{MAX_LENGTH} are allowed; simplify it or write it in decimals.")
    if not text.strip():
        raise InputError(f"The expression is empty; write {example}.")
    parser = _Parser(text, arithmetic)
    value = parser.sum()
    parser.end()
    return value


def parse_quantity(
    text: str, arithmetic: ParserArithmetic[V], example: str, units: Mapping[str, str]
) -> V:
    """Return the value of a text with units, in rad and seconds; errors as of ``parse``.

    ``units`` has the factor of each unit as text, such as "pi/180" of "deg".
    """
    # a text without units is parsed once; ``parse`` refuses a text that is too long
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
        """Split a text into tokens; ``arithmetic`` computes the values of the rules."""
        self.text = text
        self.arithmetic = arithmetic
        self.tokens = list(tokens(text))
        self.next = 0
        self.depth = 0

    @property
    def token(self) -> Token:
        """The next token, which is not consumed yet."""
        return self.tokens[self.next]

    def accept(self, *signs: str) -> Token | None:
        """Consume and return the next token if it is one of these signs, else return None."""
        token = self.token
        if token.kind != "sign" or token.text not in signs:
            return None
        self.next += 1
        return token

    def sum(self) -> V:
        """Parse: sum = product (('+' | '-') product)*."""
        start = self.token
        terms = [self.product()]
        while sign := self.accept("+", "-"):
            term = self.product()
            terms.append(self.negative(sign, term) if sign.text == "-" else term)
        return self.apply(start, self.arithmetic.add, terms) if len(terms) > 1 else terms[0]

    def quantity(self, units: Mapping[str, V]) -> V:
        """Parse a sum whose terms all have units, or none: ``90 deg - 0.1 rad``.

        ``units`` has the value of each permitted unit.
        """
        start = self.token
        terms = [self.product()]
        unitless: list[Token] = []  # tokens where a unit is missing
        while True:  # a unit behind each term is a factor of it
            unit = self.unit(units)
            if unit is None:
                unitless.append(self.token)
            else:
                terms[-1] = self.apply(start, self.arithmetic.multiply, [terms[-1], unit])
            sign = self.accept("+", "-")
            if sign is None:
                break
            term = self.product()
            terms.append(self.negative(sign, term) if sign.text == "-" else term)
        if unitless and len(unitless) < len(terms):
            raise error_at(self.text, unitless[0].position, "A term has no unit, and another has",
                           "write one behind each, or brackets: (10 + 20) deg")
        return self.apply(start, self.arithmetic.add, terms) if len(terms) > 1 else terms[0]

    def unit(self, units: Mapping[str, V]) -> V | None:
        """Consume a unit and return its factor; None if there is no unit."""
        token = self.token
        if token.kind != "name" or token.text not in _words(UNITS):
            return None
        self.next += 1
        name = token.text
        if self.accept("/"):  # deg/s: the second word belongs to the unit
            name = f"{name}/{self.token.text}"
            if self.token.kind != "end":
                self.next += 1
        if name not in units:
            cure = f"write {', '.join(units)}, or none" if units else "leave it out"
            raise error_at(self.text, token.position,
                           f"The unit {shorten(name, 20)} has no place here", cure)
        return units[name]

    def product(self) -> V:
        """Parse factors with * and /."""
        start = self.token
        factors = [self.signed()]
        while sign := self.accept("*", "/"):
            factor = self.signed()
            factors.append(self.apply(sign, self.arithmetic.reciprocal, factor)
                           if sign.text == "/" else factor)
        if len(factors) == 1:
            return factors[0]
        return self.apply(start, self.arithmetic.multiply, factors)

    def signed(self) -> V:
        """Parse: signed = ('+' | '-')* power."""
        start = self.token
        minus = False
        while sign := self.accept("+", "-"):
            minus ^= sign.text == "-"
        value = self.power()
        return self.negative(start, value) if minus else value

    def power(self) -> V:
        """Parse: power = atom ('**' signed)?, so that a**b**c is a**(b**c), as in Python."""
        base = self.atom()
        sign = self.accept("**")
        if sign is None:
            return base
        return self.apply(sign, self.arithmetic.power, base, self.parse_nested(sign, self.signed))

    def atom(self) -> V:
        """Parse a number, a name, a call or a sum in brackets."""
        token = self.token
        if token.kind == "number":
            self.next += 1
            return self.apply(token, self.literal, token.text)
        if token.kind == "name":
            self.next += 1
            if token.text not in self.arithmetic.functions:
                return self.name(token)
            return self.choice(token) if token.text == CHOICE else self.call(token)
        if self.accept("("):
            value = self.parse_nested(token, self.sum)
            self.close(token)
            return value
        raise self.error("A number, a name or ( is missing", "complete the expression")

    def literal(self, text: str) -> V:
        """Return a decimal exactly, as digits · 10^exponent."""
        integer_part, fraction, exponent = decimal_parts(text)
        digits = integer_part + fraction
        if len(digits) > MAX_DIGITS:
            raise RefusedError(f"The number has {len(digits)} digits and at most {MAX_DIGITS} are "
                               "allowed; round it")
        return self.arithmetic.literal(int(digits), exponent - len(fraction))

    def call(self, name: Token) -> V:
        """Parse the arguments of a function, whose number must be its arity; −k allows k or more.
        """
        opening = self.opening_parenthesis(name)
        arguments = self.arguments(opening, self.sum)
        arity = self.arithmetic.functions[name.text]
        if arity < 0 and len(arguments) < -arity:
            raise self.argument_count_error(name, arguments, f"{-arity} or more")
        if arity >= 0 and len(arguments) != arity:
            raise self.argument_count_error(name, arguments, f"{arity}")
        return self.apply(name, self.arithmetic.call, name.text, arguments)

    def opening_parenthesis(self, name: Token) -> Token:
        """Consume and return the opening parenthesis after the name of a function."""
        opening = self.accept("(")
        if opening is None:
            raise self.error(f"The function {name.text} has no argument", f"write {name.text}(…)")
        return opening

    def arguments(self, opening: Token, first: Callable[[], Any]) -> list[Any]:
        """Parse arguments up to the closing parenthesis; ``first`` is the rule of the first one."""
        values = [self.parse_nested(opening, first)]
        while self.accept(","):
            values.append(self.parse_nested(opening, self.sum))
        self.close(opening)
        return values

    def argument_count_error(self, name: Token, arguments: Sequence[Any],
                             expected: str) -> InputError:
        """Return the error of a function with a wrong number of arguments."""
        count = len(arguments)
        return error_at(self.text, name.position,
                        f"The function {name.text} has {count} argument{'s' * (count != 1)}",
                        f"give it {expected}")

    # ------------------------------------------------------------ conditions

    def choice(self, name: Token) -> V:
        """Parse: choice = name '(' condition ',' sum ',' sum ')'."""
        opening = self.opening_parenthesis(name)
        arguments = self.arguments(opening, self.condition)
        if len(arguments) != 3:
            raise self.argument_count_error(name, arguments,
                                            "a condition, what holds then, and what else")
        return self.apply(name, self.choosing.choose, *arguments)

    def condition(self) -> Any:
        """Parse: condition = all ('or' all)*, all = comparison ('and' comparison)*."""
        return self.junction("or", lambda: self.junction("and", self.comparison))

    def junction(self, word: str, operand: Callable[[], Any]) -> Any:
        """Parse conditions joined by ``word``, "and" or "or"; ``operand`` parses one of them."""
        start = self.token
        operands = [operand()]
        while self.token.kind == "name" and self.token.text == word:
            self.next += 1
            operands.append(operand())
        if len(operands) == 1:
            return operands[0]
        return self.apply(start, self.choosing.join, word, operands)

    def comparison(self) -> Any:
        """Parse a comparison, or a chain of them, a < b < c, which means both."""
        start = self.token
        a, conditions = self.sum(), []
        while sign := self.accept(*COMPARISONS):
            b = self.sum()
            conditions.append(self.apply(sign, self.choosing.compare, sign.text, a, b))
            a = b
        if not conditions:
            raise self.error("A comparison is missing", f"write one of {' '.join(COMPARISONS)}")
        if len(conditions) == 1:
            return conditions[0]
        return self.apply(start, self.choosing.join, "and", conditions)

    @property
    def choosing(self) -> Choosing[V]:
        """The arithmetic, as one with the function "if"."""
        return cast("Choosing[V]", self.arithmetic)

    def name(self, token: Token) -> V:
        """Return the value of a name, or refuse it with the closest match."""
        if token.text not in self.arithmetic.names:
            functions = (f"{name}(…)" for name in self.arithmetic.functions)
            allowed = ", ".join([*sorted(self.arithmetic.names), *functions])
            self.next -= 1  # the error has the position of the name
            raise self.error(f"The name {shorten(token.text)} is unknown",
                             f"use one of {shorten(allowed, 600)}"
                             f"{proposal(token.text, self.arithmetic.names)}")
        return self.apply(token, self.arithmetic.value_of, token.text)

    def close(self, opening: Token) -> None:
        """Consume the closing parenthesis of an opening one."""
        if not self.accept(")"):
            self.refuse_comparison()
            reason = f"The ( of character {opening.position + 1} is not closed here"
            raise self.error(reason, "write ) or one of + - * / **")

    def parse_nested(self, token: Token, method: Callable[[], V]) -> V:
        """Return the value of a nested expression, one level deeper; ``method`` parses it.

        Python's stack ends at some hundred calls of the grammar: deeper text is refused at
        ``token``.
        """
        if self.depth == MAX_DEPTH:
            reason = f"This is nested deeper than {MAX_DEPTH} levels"
            raise error_at(self.text, token.position, reason, "simplify the expression")
        self.depth += 1
        value = method()
        self.depth -= 1
        return value

    def end(self) -> None:
        """Refuse characters behind the end of the formula."""
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
        """Return −value; errors have the position of the sign."""
        return self.apply(token, self.arithmetic.negative, value)

    def apply(self, token: Token, function: Callable[..., V], *arguments: Any) -> V:
        """Return the result of an operation; its errors have the position of the token."""
        result: V = refuse_at(self.text, token.position, function, *arguments)
        return result

    def error(self, reason: str, cure: str) -> InputError:
        """Return an error at the next token."""
        return error_at(self.text, self.token.position, reason, cure)
