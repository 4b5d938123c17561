"""Arithmetic text, such as an entry of a tableau file, as an exact SymPy number.

The grammar is ``grammar`` with sqrt as its only function; the operations are ``bounded_numbers``,
so that time and memory are bounded for any text.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

import sympy as sp

from . import bounded_numbers as numbers
from .bounded_numbers import ROOTS, Value, rational
from .grammar import parse, parse_quantity
from .tokens import RefusedError, decimal_parts, refuse_at, tokens

__all__ = ["decimal_digits", "parse_expression", "parse_number"]

#: Largest number of different radicals, such as √3: SymPy searches each for square factors.
MAX_RADICALS = 100


def parse_expression(
    text: str,
    names: Mapping[str, sp.Expr] = MappingProxyType({}),
    radicals: set[sp.Expr] | None = None,
) -> sp.Expr:
    """Return the exact value of an arithmetic text, e.g. "1/4 - sqrt(3)/6" or "0.25".

    Decimals have the exact value of their text, ``names`` maps names to values, and an exponent is
    an integer or a half-integer. The different radicals are added to the set ``radicals``; with one
    set for all entries of a file, their limit applies to the file.

    Raises ``InputError``, with the position and the cure, for text that is empty, too long, too
    deeply nested or not of the grammar, an unknown name or function, a division by zero, the
    square root of a negative number, and numbers too large to be coefficients.
    """
    arithmetic = _ExactNumbers(names, set() if radicals is None else radicals)
    return parse(text, arithmetic, "a number such as 1/2 or sqrt(3)/6").exact


def parse_number(text: str, units: Mapping[str, str] = MappingProxyType({})) -> float:
    """Return the double nearest to the value of an arithmetic text, in rad and seconds.

    ``units`` are the permitted units of ``grammar``: "30 deg" is pi/6. Raises ``InputError`` for
    the same reasons as ``parse_expression``.
    """
    arithmetic = _ExactNumbers({"pi": sp.pi}, radicals=set())
    return float(parse_quantity(text, arithmetic, "a number such as 0.5", units).exact)


class _ExactNumbers:
    """Bounded exact numbers, with a limit on the number of different radicals."""

    functions: Mapping[str, int] = MappingProxyType(dict.fromkeys(ROOTS, 1))

    def __init__(self, names: Mapping[str, sp.Expr], radicals: set[sp.Expr]) -> None:
        self.names = names
        self.radicals = radicals

    def literal(self, digits: int, exponent: int) -> Value:
        """Return digits · 10^exponent."""
        return rational(sp.Integer(digits) * sp.Integer(10) ** exponent)

    def value_of(self, name: str) -> Value:
        """Return the value of a name."""
        return self.count_radicals(numbers.value_of(self.names[name]))

    def add(self, terms: Sequence[Value]) -> Value:
        """Return the sum."""
        return self.count_radicals(numbers.add(terms))

    def multiply(self, factors: Sequence[Value]) -> Value:
        """Return the product."""
        return self.count_radicals(numbers.multiply(factors))

    def negative(self, value: Value) -> Value:
        """Return −value."""
        return self.multiply([rational(sp.Integer(-1)), value])

    def reciprocal(self, value: Value) -> Value:
        """Return 1/value."""
        return self.count_radicals(numbers.reciprocal(value))

    def power(self, base: Value, exponent: Value) -> Value:
        """Return base**exponent."""
        return self.count_radicals(numbers.power(base, exponent))

    def call(self, function: str, arguments: Sequence[Value]) -> Value:
        """Return the value of a function of ``ROOTS``."""
        return self.count_radicals(ROOTS[function](*arguments))

    def count_radicals(self, value: Value) -> Value:
        """Return the value, with its radicals added to those of the text.

        Raises ``RefusedError`` for more than ``MAX_RADICALS`` different ones: SymPy takes too long.
        """
        self.radicals.update(_radicals(value.exact))
        if len(self.radicals) > MAX_RADICALS:
            raise RefusedError(f"There are more than {MAX_RADICALS} different radicals; write the "
                               "number in decimals")
        return value


def _radicals(expression: sp.Expr) -> Iterator[sp.Expr]:
    """Yield the factors of a product that are roots."""
    if not expression.is_Rational:
        for factor in sp.Mul.make_args(expression):
            if factor.is_Pow and factor.exp.is_Rational and factor.exp.q > 1:
                yield factor


def decimal_digits(text: str, exact_up_to: int = 0) -> int | None:
    """Return the digits after the point of the least precise rounded decimal of a text, or None.

    A decimal is rounded if it has more than ``exact_up_to`` digits after the point, without
    trailing zeros. With ``exact_up_to=8``:
    "1/4 + 0.25" → None, "0.21132486540519" → 14, "2.1132486540519e-1" → 14.

    Raises ``InputError`` for an unknown character or exponent.
    """
    counts = []
    for token in tokens(text):
        if token.kind == "number":
            digits, significant = refuse_at(text, token.position, _digits_after_point, token.text)
            if significant > exact_up_to:
                counts.append(digits)
    return min(counts, default=None)


def _digits_after_point(literal: str) -> tuple[int, int]:
    """Return the number of digits after the point, with and without trailing zeros."""
    integer_part, fraction, exponent = decimal_parts(literal)
    digits = (integer_part + fraction).lstrip("0")
    count = len(fraction) - exponent  # 1.5e-3 = 0.0015 has 1 + 3
    trailing_zeros = len(digits) - len(digits.rstrip("0"))
    return count, count - trailing_zeros if digits else 0
