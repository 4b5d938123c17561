"""Arithmetic text, such as the entry of a tableau file, read into exact SymPy numbers.

    sum     = product { ("+" | "-") product }
    product = signed { ("*" | "/") signed }
    signed  = { "+" | "-" } power
    power   = atom [ "**" signed ]                  -2**2 = -4,  2**3**2 = 2**9,  2**-1 = 1/2
    atom    = number | name | function "(" sum ")" | "(" sum ")"

The text comes from files of unknown origin: it is never handed to Python or to SymPy's parsers.
Every value carries an enclosing interval, which decides signs and zeros, and a bound on the size
of its integers, which is checked before an operation is carried out; so time and memory are
bounded whatever the text says.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from types import MappingProxyType
from typing import Any

import sympy as sp
from mpmath.ctx_iv import MPIntervalContext

from ..errors import InputError

__all__ = ["FUNCTIONS", "decimal_digits", "parse_expression"]

MAX_LENGTH = 4000
MAX_DEPTH = 50
MAX_EXPONENT = 64
MAX_DIGITS = 100
MAX_DECIMAL_EXPONENT = 400
#: Bits of numerator and denominator: of a rational, of a number under a root, and (a bound on
#: the sum over all terms, were the expression multiplied out) of an irrational.
MAX_BITS = 4000
MAX_RADICAND_BITS = 200
MAX_IRRATIONAL_BITS = 12_000
#: Of irrational factors that SymPy may gather under one root.
MAX_PRODUCT_BITS = 1000
#: Irrational sums, products and powers inside one another; SymPy's evaluation and printing take
#: time exponential in it.
MAX_LEVEL = 16
#: Different radicals, such as √3; each costs SymPy a search for square factors.
MAX_RADICALS = 100

INTERVAL = MPIntervalContext()
INTERVAL.prec = 320

#: What a number given to 100 digits is multiplied by to enclose it.
NEARLY_ONE = 1 + INTERVAL.mpf([-1, 1]) / 10**90

HALF = sp.Rational(1, 2)


# ---------------------------------------------------------------- bounded exact numbers


class _RefusedError(Exception):
    """An operation is not carried out; the parser adds where in the text."""


@dataclass(frozen=True)
class _Value:
    """An exact value with what is needed to bound the next operation on it."""

    exact: sp.Expr
    enclosure: Any  # of an irrational; None where the value has no number (a free symbol)
    bits: int
    level: int = 0

    @property
    def is_rational(self) -> bool:
        return bool(self.exact.is_Rational)

    @property
    def interval(self) -> Any:
        if self.is_rational:
            return INTERVAL.mpf(int(self.exact.p)) / int(self.exact.q)
        return self.enclosure


def _rational(number: sp.Rational) -> _Value:
    bits = max(int(number.p).bit_length(), int(number.q).bit_length())
    if bits > MAX_BITS:
        raise _RefusedError(
            f"The number has {bits} bits and at most {MAX_BITS} are allowed; write a shorter one"
        )
    return _Value(number, None, bits)


def _irrational(
    bits: int, level: int, interval: Any, operation: Callable[..., sp.Expr], *arguments: sp.Expr
) -> _Value:
    """Carry out an operation once its bounds are found good; the outcome may be rational."""
    if interval is not None:
        bits = max(bits, _binary_magnitude(interval))
    if bits > MAX_IRRATIONAL_BITS:
        raise _RefusedError(
            f"The integers of this expression may need {bits} bits and at most "
            f"{MAX_IRRATIONAL_BITS} are allowed; lower its powers or write it in decimals"
        )
    if level > MAX_LEVEL:
        raise _RefusedError(
            f"More than {MAX_LEVEL} irrational sums, products and powers lie inside one another; "
            "multiply out or write the number in decimals"
        )
    exact = operation(*arguments)
    return _rational(exact) if exact.is_Rational else _Value(exact, interval, bits, level)


def _binary_magnitude(interval: Any) -> int:
    """Return the larger |log2| of the ends of an interval, rounded up."""
    return max(abs(int(exponent + bits)) for _, _, exponent, bits in interval._mpi_)


def _add(values: Sequence[_Value]) -> _Value:
    total = _rational(sp.Integer(0))
    for value in values:
        if value.is_rational:
            total = _rational(total.exact + value.exact)
    terms = [total, *(value for value in values if not value.is_rational)]
    return _combine(terms, sp.Add, lambda a, b: a + b) if len(terms) > 1 else total


def _multiply(values: Sequence[_Value]) -> _Value:
    product = _rational(sp.Integer(1))
    for value in values:
        if value.is_rational:
            product = _rational(product.exact * value.exact)
    factors = [product, *(value for value in values if not value.is_rational)]
    bits = sum(factor.bits for factor in factors[1:] if not factor.exact.is_Add)
    if bits > MAX_PRODUCT_BITS and len(factors) > 2:
        raise _RefusedError(
            f"The integers of this product may need {bits} bits and at most {MAX_PRODUCT_BITS} "
            "are allowed; write it shorter or in decimals"
        )
    return _combine(factors, sp.Mul, lambda a, b: a * b) if len(factors) > 1 else product


def _combine(
    values: Sequence[_Value], operation: Callable[..., sp.Expr], on_intervals: Callable[..., Any]
) -> _Value:
    """Add or multiply at once: one after the other would take quadratic time in SymPy."""
    intervals = [value.interval for value in values]
    interval = None if any(i is None for i in intervals) else reduce(on_intervals, intervals)
    return _irrational(
        sum(value.bits + 1 for value in values),
        max(value.level for value in values) + 1,
        interval,
        operation,
        *(value.exact for value in values),
    )


def _refuse_zero(value: _Value) -> None:
    if value.exact == 0:
        raise _RefusedError("This divides by zero; write a denominator other than 0")
    if value.enclosure is not None and 0 in value.enclosure:
        raise _RefusedError(
            "This divides by a number that cannot be told from zero to 90 digits; simplify it"
        )


def _reciprocal(value: _Value) -> _Value:
    _refuse_zero(value)
    if value.is_rational:
        return _rational(1 / value.exact)
    return _irrational_power(value, sp.Integer(-1))


def _power(base: _Value, exponent: _Value) -> _Value:
    e = exponent.exact
    if not e.is_Rational or e.q > 2 or abs(e) > MAX_EXPONENT:
        raise _RefusedError(
            f"An exponent is an integer or a half-integer from -{MAX_EXPONENT} to {MAX_EXPONENT}, "
            f"not {_shorten(str(e))}; multiply factors out or take sqrt of sqrt"
        )
    if e < 0:
        _refuse_zero(base)
    if e.q == 2:
        _refuse_root(base)
    if base.is_rational and e.q == 1:
        if base.bits * abs(e) > MAX_BITS + abs(e):
            raise _RefusedError(
                f"This power has about {base.bits * abs(e)} bits and at most {MAX_BITS} are "
                "allowed; lower the exponent"
            )
        return _rational(base.exact**e)
    return _irrational_power(base, e)


def _irrational_power(base: _Value, e: sp.Rational) -> _Value:
    bits = base.bits * (int(abs(e)) + int(e.q) - 1)
    interval = _interval_power(base.interval, e)
    operation = sp.Pow
    if base.exact.is_Add and interval is not None and e not in (0, 1):
        # A power of a real sum stays as it stands; SymPy would take long to find that out.
        operation = partial(sp.Pow, evaluate=False)
    return _irrational(bits, base.level + 1, interval, operation, base.exact, e)


def _interval_power(interval: Any, exponent: sp.Rational) -> Any:
    if interval is None:
        return None
    root = interval if exponent.q == 1 else INTERVAL.sqrt(interval)
    return root ** int(exponent.p)


def _refuse_root(value: _Value) -> None:
    interval = value.interval
    if interval is not None and interval.b < 0:
        raise _RefusedError("This is the square root of a negative number; write one that is not")
    if not value.is_rational and interval is not None and 0 in interval:
        raise _RefusedError(
            "This is the square root of a number that cannot be told from zero to 90 digits; "
            "simplify it"
        )
    if value.bits > MAX_RADICAND_BITS:
        raise _RefusedError(
            f"The number under a root may need {value.bits} bits and at most {MAX_RADICAND_BITS} "
            "are allowed; write it shorter"
        )


def _square_root(value: _Value) -> _Value:
    return _power(value, _rational(HALF))


def _named(expression: sp.Expr) -> _Value:
    """Wrap the meaning of a name: a number, or anything with free symbols."""
    if expression.is_Rational:
        return _rational(expression)
    bits = sum(_rational(number).bits for number in expression.atoms(sp.Rational)) + 1
    if not (expression.is_number and expression.is_real):
        return _Value(expression, None, bits)
    return _Value(expression, INTERVAL.mpf(str(sp.N(expression, 100))) * NEARLY_ONE, bits)


#: What text may call; each takes and returns a bounded value and refuses what it is not
#: defined for.
FUNCTIONS: dict[str, Callable[[_Value], _Value]] = {"sqrt": _square_root}


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


def _shorten(text: str, length: int = 60) -> str:
    return text if len(text) <= length else text[: length - 1] + "…"


def _decimal_parts(literal: str) -> tuple[str, str, int]:
    """Return the digits before and after the point and the decimal exponent of a literal."""
    mantissa, _, exponent = literal.lower().partition("e")
    whole, _, fraction = mantissa.partition(".")
    if len(exponent.lstrip("+-0")) > 3 or abs(int(exponent or 0)) > MAX_DECIMAL_EXPONENT:
        raise _RefusedError(
            f"The decimal exponent {_shorten(exponent, 20)} is not within "
            f"±{MAX_DECIMAL_EXPONENT}; write the number with a smaller one"
        )
    return whole, fraction, int(exponent or 0)


def _literal(literal: str) -> _Value:
    """Return a number as it is written: 0.25 is 1/4."""
    whole, fraction, exponent = _decimal_parts(literal)
    digits = whole + fraction
    if len(digits) > MAX_DIGITS:
        raise _RefusedError(
            f"The number has {len(digits)} digits and at most {MAX_DIGITS} are allowed; "
            "round it"
        )
    return _rational(sp.Integer(int(digits)) * sp.Integer(10) ** (exponent - len(fraction)))


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
    except _RefusedError as refusal:
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
            f"The expression {_shorten(text)!r} has {len(text)} characters and at most "
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

    def sum(self) -> _Value:
        start = self.token
        terms = [self.product()]
        while sign := self.accept("+", "-"):
            term = self.product()
            terms.append(self.negative(sign, term) if sign.text == "-" else term)
        return self.at(start, _add, terms) if len(terms) > 1 else terms[0]

    def product(self) -> _Value:
        start = self.token
        factors = [self.signed()]
        while sign := self.accept("*", "/"):
            factor = self.signed()
            factors.append(self.at(sign, _reciprocal, factor) if sign.text == "/" else factor)
        return self.at(start, _multiply, factors) if len(factors) > 1 else factors[0]

    def signed(self) -> _Value:
        start = self.token
        minus = False
        while sign := self.accept("+", "-"):
            minus ^= sign.text == "-"
        value = self.power()
        return self.negative(start, value) if minus else value

    def power(self) -> _Value:
        base = self.atom()
        sign = self.accept("**")
        if sign is None:
            return base
        return self.at(sign, _power, base, self.nested(sign, self.signed))

    def atom(self) -> _Value:
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

    def call(self, name: _Token) -> _Value:
        opening = self.accept("(")
        if opening is None:
            raise self.error(f"The function {name.text} has no argument", f"write {name.text}(…)")
        return self.at(name, FUNCTIONS[name.text], self.parenthesis(opening))

    def name(self, token: _Token) -> _Value:
        if token.text not in self.names:
            known = ", ".join(sorted([*self.names, *(f"{name}(…)" for name in FUNCTIONS)]))
            self.next -= 1
            raise self.error(f"The name {_shorten(token.text)} is unknown", f"use one of {known}")
        return self.at(token, _named, self.names[token.text])

    def parenthesis(self, opening: _Token) -> _Value:
        """Read on from after an opening parenthesis to behind the closing one."""
        value = self.nested(opening, self.sum)
        if not self.accept(")"):
            reason = f"The ( of character {opening.position + 1} is not closed here"
            raise self.error(reason, "write ) or one of + - * / **")
        return value

    def nested(self, token: _Token, method: Callable[[], _Value]) -> _Value:
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
            reason = f"{_shorten(self.token.text)} cannot follow here"
            raise self.error(reason, "write one of + - * / ** in between, and a ( for every )")

    def negative(self, token: _Token, value: _Value) -> _Value:
        return self.at(token, _multiply, [_rational(sp.Integer(-1)), value])

    def at(self, token: _Token, function: Callable[..., _Value], *arguments: Any) -> _Value:
        """Carry out an operation that belongs to a token."""
        result: _Value = _refuse_at(self.text, token.position, function, *arguments)
        self.radicals.update(_radicals(result.exact))
        if len(self.radicals) > MAX_RADICALS:
            reason = f"This is the radical number {len(self.radicals)} of at most {MAX_RADICALS}"
            raise _error(self.text, token.position, reason, "write the number in decimals")
        return result

    def error(self, reason: str, cure: str) -> InputError:
        return _error(self.text, self.token.position, reason, cure)
