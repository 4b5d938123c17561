"""Exact numbers and formulas with operations that are bounded in time and memory.

A number carries an enclosing interval, which decides signs and zeros, and a bound on the size of
its integers, which is checked before an operation is carried out. ``exact_expressions`` computes
with these, ``models.formulas`` with formulas too, for any text of unknown origin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial, reduce
from typing import Any

import sympy as sp
from mpmath.ctx_iv import MPIntervalContext
from mpmath.libmp import mpf_floor, to_int

from ...core.records import dataclass
from .tokens import RefusedError, shorten

__all__ = [
    "FUNCTIONS",
    "ROOTS",
    "Value",
    "add",
    "multiply",
    "order",
    "power",
    "rational",
    "reciprocal",
    "value_of",
]

#: Largest exponent: (a + b)^64 has 65 terms once it is expanded.
MAX_EXPONENT = 64
#: Largest number of bits of numerator and denominator: of a rational, of a radicand, and of an
#: irrational (a bound of the sum over all terms of its expansion).
MAX_BITS = 4000
MAX_RADICAND_BITS = 200
MAX_IRRATIONAL_BITS = 12_000
#: Largest number of bits of irrational factors that SymPy may combine under one root.
MAX_PRODUCT_BITS = 1000
#: Largest depth of nested irrational sums, products and powers; SymPy's evaluation and printing
#: take time exponential in it.
MAX_LEVEL = 16
#: 320 bits are 96 digits: comparisons hold to 90, with some digits for the round-off of operations.
INTERVAL = MPIntervalContext()
INTERVAL.prec = 320

#: Factor that encloses a number given to 100 digits.
NEARLY_ONE = 1 + INTERVAL.mpf([-1, 1]) / 10**90

HALF = sp.Rational(1, 2)


@dataclass(frozen=True)
class Value:
    """An exact number or a formula, with bounds that limit the next operation on it."""

    exact: sp.Expr
    enclosure: Any  # interval of an irrational; None for a rational and for a free symbol
    bits: int
    level: int = 0  # depth of irrational sums, products and powers, or of a formula's operations
    terms: int = 1  # number of terms of an expanded formula

    @property
    def is_number(self) -> bool:
        """Whether the value is a real number, not a formula."""
        return self.is_rational or self.enclosure is not None

    @property
    def is_rational(self) -> bool:
        """Whether the value is a ratio of integers."""
        return bool(self.exact.is_Rational)

    @property
    def interval(self) -> Any:
        """Enclosing interval of the value; None for a free symbol."""
        if self.is_rational:
            return INTERVAL.mpf(int(self.exact.p)) / int(self.exact.q)
        return self.enclosure


def rational(number: sp.Rational) -> Value:
    """Return a rational as a value; raises ``RefusedError`` if it has too many bits."""
    bits = max(int(number.p).bit_length(), int(number.q).bit_length())
    if bits > MAX_BITS:
        raise RefusedError(f"The number has {bits} bits and at most {MAX_BITS} are allowed; write "
                           "a shorter one")
    return Value(number, enclosure=None, bits=bits)


def _irrational(
    bits: int, level: int, interval: Any, operation: Callable[..., sp.Expr], *arguments: sp.Expr
) -> Value:
    """Return the result of an operation, which is carried out if its bounds permit it.

    ``bits``, ``level`` and ``interval`` are the bounds and the enclosure of the result; the
    interval is None for a formula. Raises ``RefusedError`` beyond the limits.
    """
    if interval is not None:
        bits = max(bits, _binary_magnitude(interval))
    if bits > MAX_IRRATIONAL_BITS:
        raise RefusedError(f"The integers of this expression may need {bits} bits and at most "
                           f"{MAX_IRRATIONAL_BITS} are allowed; lower its powers or write it in "
                           "decimals")
    if level > MAX_LEVEL:
        raise RefusedError(f"More than {MAX_LEVEL} irrational sums, products and powers lie inside "
                           "one another; multiply out or write the number in decimals")
    exact = operation(*arguments)
    return rational(exact) if exact.is_Rational else Value(exact, interval, bits, level)


def _binary_magnitude(interval: Any) -> int:
    """Return the larger |log2| of the ends of an interval, rounded up."""
    return max(abs(int(exponent + bits)) for _, _, exponent, bits in interval._mpi_)


def add(values: Sequence[Value]) -> Value:
    """Return the sum; rational terms are added first, as their bounds are exact."""
    total = rational(sp.Integer(0))
    for value in values:
        if value.is_rational:
            total = rational(total.exact + value.exact)
    terms = [total, *(value for value in values if not value.is_rational)]
    return _combine(terms, sp.Add, lambda a, b: a + b) if len(terms) > 1 else total


def multiply(values: Sequence[Value]) -> Value:
    """Return the product; the rational factors are one, whose size ``rational`` limits.

    SymPy multiplies the integers of the other factors, except for sums: their bits add.
    """
    product = rational(sp.Integer(1))
    for value in values:
        if value.is_rational:
            product = rational(product.exact * value.exact)
    factors = [product, *(value for value in values if not value.is_rational)]
    bits = sum(factor.bits for factor in factors[1:] if not factor.exact.is_Add)
    # ``product`` and one irrational factor stay apart: there is nothing to multiply out
    if bits > MAX_PRODUCT_BITS and len(factors) > 2:
        raise RefusedError(f"The integers of this product may need {bits} bits and at most "
                           f"{MAX_PRODUCT_BITS} are allowed; write it shorter or in decimals")
    return _combine(factors, sp.Mul, lambda a, b: a * b) if len(factors) > 1 else product


def _combine(
    values: Sequence[Value], operation: Callable[..., sp.Expr],
    interval_operation: Callable[..., Any],
) -> Value:
    """Return the sum or product of all values at once; one by one, SymPy takes quadratic time.

    ``interval_operation`` is the operation on two enclosing intervals.
    """
    intervals = [value.interval for value in values]
    interval = None  # of a formula, which has free symbols
    if all(operand is not None for operand in intervals):
        interval = reduce(interval_operation, intervals)
    # integers of the result have at most the bits of all operands, and a carry for each; at least
    # one operand is irrational, or the operation would have been rational arithmetic
    bits = sum(value.bits + 1 for value in values)
    level = max(value.level for value in values) + 1
    return _irrational(bits, level, interval, operation, *(value.exact for value in values))


def _refuse_zero(value: Value) -> None:
    """Refuse a denominator that is 0, or whose enclosure contains 0."""
    if value.exact == 0:
        raise RefusedError("This divides by zero; write a denominator other than 0")
    if value.enclosure is not None and 0 in value.enclosure:
        raise RefusedError("This divides by a number that cannot be told from zero to 90 digits; "
                           "simplify it")


def reciprocal(value: Value) -> Value:
    """Return 1/value; raises ``RefusedError`` for zero."""
    _refuse_zero(value)
    if value.is_rational:
        return rational(1 / value.exact)
    return _irrational_power(value, sp.Integer(-1))


def power(base: Value, exponent: Value) -> Value:
    """Return base**exponent for an integer or half-integer exponent."""
    e = exponent.exact
    if not e.is_Rational or e.q > 2 or abs(e) > MAX_EXPONENT:
        raise RefusedError(f"An exponent is an integer or a half-integer from -{MAX_EXPONENT} to "
                           f"{MAX_EXPONENT}, not {shorten(str(e))}; multiply factors out or take "
                           "sqrt of sqrt")
    if e < 0:
        _refuse_zero(base)
    if e.q == 2:
        _refuse_root(base)
    if base.is_rational and e.q == 1:
        # exact arithmetic would carry out any power; a number of b bits is at least 2^(b − 1), so
        # that its power n has more than (b − 1) n
        if base.bits * abs(e) > MAX_BITS + abs(e):
            raise RefusedError(f"This power has about {base.bits * abs(e)} bits and at most "
                               f"{MAX_BITS} are allowed; lower the exponent")
        return rational(base.exact**e)
    return _irrational_power(base, e)


def _irrational_power(base: Value, e: sp.Rational) -> Value:
    """Return base^e of an irrational base, with bounds: a power n has n times the bits."""
    # a half power n + ½ has the bits of n + 1
    bits = base.bits * (int(abs(e)) + int(e.q) - 1)
    interval = _interval_power(base.interval, e)
    operation = sp.Pow
    if base.exact.is_Add and interval is not None and e not in (0, 1):
        # SymPy takes long to leave a power of a real sum unchanged; the powers 0 and 1, which it
        # changes at once, would stay powers without evaluation
        operation = partial(sp.Pow, evaluate=False)
    return _irrational(bits, base.level + 1, interval, operation, base.exact, e)


def _interval_power(interval: Any, exponent: sp.Rational) -> Any:
    """Return the interval of a whole or half power; None if there is no interval."""
    if interval is None:
        return None
    root = interval if exponent.q == 1 else INTERVAL.sqrt(interval)
    return root ** int(exponent.p)


def _refuse_root(value: Value) -> None:
    """Refuse the root of a negative number, of one that may be zero, and of one that is too long.
    """
    interval = value.interval
    if interval is not None and interval.b < 0:
        raise RefusedError("This is the square root of a negative number; write one that is not")
    if not value.is_rational and interval is not None and 0 in interval:
        raise RefusedError("This is the square root of a number that cannot be told from zero to "
                           "90 digits; simplify it")
    if value.bits > MAX_RADICAND_BITS:
        raise RefusedError(f"The number under a root may need {value.bits} bits and at most "
                           f"{MAX_RADICAND_BITS} are allowed; write it shorter")


def _square_root(value: Value) -> Value:
    """Return √value; raises ``RefusedError`` for a negative number."""
    return power(value, rational(HALF))


def value_of(expression: sp.Expr) -> Value:
    """Return the value of a name: a number, or an expression with free symbols."""
    if expression.is_Rational:
        return rational(expression)
    bits = sum(rational(number).bits for number in expression.atoms(sp.Rational)) + 1
    if not (expression.is_number and expression.is_real):
        return Value(expression, enclosure=None, bits=bits)
    return Value(expression, INTERVAL.mpf(str(sp.N(expression, 100))) * NEARLY_ONE, bits)


# ---------------------------------------------------------------- comparisons


def order(a: Value, b: Value) -> int:
    """Return −1, 0 or 1 for a < b, a = b, a > b; raises if 90 digits do not decide."""
    if a.exact == b.exact:
        return 0
    difference = a.interval - b.interval
    if 0 in difference:
        raise RefusedError("Which of these numbers is larger cannot be told to 90 digits; simplify "
                           "them")
    return 1 if difference.a > 0 else -1


def absolute(value: Value) -> Value:
    """Return |value|."""
    return multiply([sign(value), value])


def sign(value: Value) -> Value:
    """Return −1, 0 or 1."""
    return rational(sp.Integer(order(value, rational(sp.Integer(0)))))


def _heaviside(value: Value) -> Value:
    """Return 0, ½ or 1 for a negative number, 0, and a positive number, as SymPy's Heaviside."""
    return rational((sign(value).exact + 1) / 2)


def largest(*values: Value) -> Value:
    """Return the largest of some values."""
    return reduce(lambda a, b: b if order(a, b) < 0 else a, values)


def smallest(*values: Value) -> Value:
    """Return the smallest of some values."""
    return reduce(lambda a, b: b if order(a, b) > 0 else a, values)


def floor(value: Value) -> Value:
    """Return the largest integer ≤ value."""
    if value.is_rational:
        return rational(sp.floor(value.exact))
    low, high = (int(to_int(mpf_floor(end))) for end in value.interval._mpi_)
    if low != high:
        raise RefusedError("Whether this is a whole number cannot be told to 90 digits; simplify "
                           "it")
    return rational(sp.Integer(low))


def remainder(a: Value, b: Value) -> Value:
    """Return a − b ⌊a/b⌋."""
    quotient = floor(multiply([a, reciprocal(b)]))
    return add([a, multiply([rational(sp.Integer(-1)), b, quotient])])


#: Functions of the texts of tableaux: from bounded values to a bounded value, or ``RefusedError``.
ROOTS: dict[str, Callable[..., Value]] = {"sqrt": _square_root}
#: Functions of model files that are evaluated exactly.
FUNCTIONS: dict[str, Callable[..., Value]] = ROOTS | {
    "abs": absolute, "sign": sign, "heaviside": _heaviside, "min": smallest, "max": largest,
    "floor": floor, "mod": remainder,
}
