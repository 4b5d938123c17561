"""Real numbers of any kind as the numbers they are, and their one rounding.

A Python float is the binary number that it holds: 0.1 is 0.1000000000000000055..., also where a
wider type computes. More digits come as mpmath numbers, decimal.Decimal, fractions.Fraction,
NumPy's long doubles, or SymPy's constants; none of these packages is imported here.
"""

from __future__ import annotations

import math
import numbers
import re
from decimal import Decimal
from fractions import Fraction
from typing import TYPE_CHECKING, Any, SupportsFloat, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

#: A real number of any type, among them NumPy's, mpmath's and SymPy's; text is none.
Number: TypeAlias = SupportsFloat
#: One number for all runs of an ensemble, or one for each.
Numbers: TypeAlias = "SupportsFloat | Sequence[SupportsFloat] | np.ndarray[Any, Any]"

#: The widest type, binary128, has numbers from 2^-16494 to 2^16384: beyond 2^±20000 a number is
#: infinite, or 0. The bound is checked first: as a fraction, 1e999999999 would fill the memory.
_RANGE = 20_000
#: Bits of a constant such as π. Rounded again, to 113, it is wrong only if bits 114 to 256 are
#: 10…0 or 01…1.
_CONSTANT_BITS = 256
#: binary128: bits of a number and exponent of the last bit of a subnormal number; decimal digits
#: that tell any number from its neighbours.
_QUAD, _QUAD_DIGITS = (113, -16494), 36
_DECIMAL = re.compile(r"\s*([+-]?)(\d+\.?\d*|\.\d+)(?:[eE]([+-]?\d+))?\s*", re.ASCII)
_NOT_FINITE = {"nan": math.nan, "inf": math.inf, "infinity": math.inf}


class Rounded(float):
    """Double with the exact number it was rounded from, such as a decimal typed in a file.

    What computes in doubles takes it for one; a wider stepper gets all that was typed.
    """

    __slots__ = ("whole",)
    whole: Fraction

    def __new__(cls, exact_value: Fraction) -> Rounded:
        """Return the double next to a number."""
        double = super().__new__(cls, as_double(exact_value))
        double.whole = exact_value
        return double

    def __getnewargs__(self) -> tuple[Fraction]:  # type: ignore[override]
        """Pickle and copy by the whole number."""
        return (self.whole,)


def exact(value: Any) -> Fraction | float | None:
    """Return a real number as a fraction, NaN and ±∞ as floats, and None for anything else.

    Text is no number: "auto" and "m" mean something else, and Decimal("0.1") says it.
    """
    if isinstance(value, Rounded):
        return value.whole
    # NumPy's bools, complex numbers and texts are none either
    if isinstance(value, bool) or getattr(getattr(value, "dtype", None), "kind", "f") not in "fiu":
        return None
    if hasattr(value, "_mpf_"):  # of mpmath, and SymPy's Float
        # mpmath's constants, such as pi, have a function of the precision; so have SymPy's numbers
        is_constant = hasattr(value, "func") and not hasattr(value, "is_number")
        return _of_mpf(value.func(_CONSTANT_BITS, "n") if is_constant else value._mpf_)
    if isinstance(value, Decimal):
        return _of_decimal(value)
    if isinstance(value, numbers.Rational):  # int among them, and SymPy's
        return _of_ratio(int(value.numerator), int(value.denominator))
    if isinstance(value, numbers.Real):
        ratio = getattr(value, "as_integer_ratio", None) or float(value).as_integer_ratio
        try:
            return Fraction(*ratio())  # of all floats, NumPy's among them, the method is there
        except (OverflowError, ValueError):  # of infinity, of NaN
            return float(value)
    # SymPy's pi/9, sqrt(2), ... to 80 decimals, the 256 bits of a constant
    if all(getattr(value, attribute, False) for attribute in ("is_number", "is_finite", "is_real")):
        return exact(value.evalf(80))
    return None


def _of_mpf(value: tuple[int, int, int, int]) -> Fraction | float:
    """Return (−1)^sign · mantissa · 2^exponent, mpmath's tuple of a number, as a fraction.

    NaN, ±∞ and numbers beyond the range of all types are floats; ``length`` is the mantissa's in
    bits.
    """
    sign, mantissa, exponent, length = value
    if not mantissa:
        special = {-456: math.inf, -789: -math.inf}  # mpmath's codes
        return Fraction(0) if exponent == 0 else special.get(exponent, math.nan)
    if abs(exponent + length) > _RANGE:
        return _beyond(exponent, negative=bool(sign))
    return Fraction(-int(mantissa) if sign else int(mantissa)) * Fraction(2) ** exponent


def _of_decimal(value: Decimal) -> Fraction | float:
    """Return a decimal as a fraction; NaN, ±∞ and numbers beyond the range of all types as floats.
    """
    if not value.is_finite():
        return math.nan if value.is_nan() else math.copysign(math.inf, value)
    if value and abs(value.adjusted()) > _RANGE:  # 10^±20000 lies further out than 2^±20000
        return _beyond(value.adjusted(), negative=value < 0)
    return Fraction(value)


def _of_ratio(above: int, below: int) -> Fraction | float:
    """Return above/below as a fraction; infinity or 0 beyond the range of all types."""
    size = above.bit_length() - below.bit_length()
    return _beyond(size, negative=above < 0) if abs(size) > _RANGE else Fraction(above, below)


def _beyond(size: int, *, negative: bool) -> Fraction | float:
    """Return 0 for a number too small for any type, whose exponent ``size`` is negative, else ±∞.
    """
    if size < 0:
        return Fraction(0)
    return -math.inf if negative else math.inf


def decimal(text: str) -> Fraction | float | None:
    """Return the number of a text, in plain decimals or with an exponent; None for other texts.

    As ``float(text)`` but with all digits; without underscores and digits of other scripts, which
    are rather a typo.
    """
    match = _DECIMAL.fullmatch(text)
    if match is None:
        sign, word = re.fullmatch(r"\s*([+-]?)(.*?)\s*", text, re.DOTALL).groups()  # type: ignore[union-attr]
        number = _NOT_FINITE.get(word.lower())
        return None if number is None else -number if sign == "-" else number
    sign, digits, exponent = match.groups()
    # 11 digits of an exponent say ∞ or 0 already; Decimal refuses exponents of 19 and more
    power = int((exponent or "0")[:12])
    return _of_decimal(Decimal(f"{sign}{digits}e{power}"))


# ---------------------------------------------------------------- rounding


def knowing(value: Any) -> float:
    """Return a number as a double that knows its digits, if a double does not hold them."""
    number = exact(value)
    if isinstance(number, Fraction) and number != Fraction(as_double(number)):
        return Rounded(number)
    return float(value)


def nearest(value: Fraction, bits: int, least_exponent: int) -> tuple[int, int]:
    """Return m and e of the binary number m 2^e next to a value, ties to even.

    |m| has at most ``bits`` bits, or is 2^bits, one bit alone; e is at least ``least_exponent``,
    the exponent of the last bit of a subnormal number.
    """
    # |value| < 2^(size + 1): the first exponent may leave one bit or two too many
    size = abs(value.numerator).bit_length() - value.denominator.bit_length()
    exponent = max(size - bits - 1, least_exponent)
    while True:
        mantissa = round(value / Fraction(2) ** exponent)  # Python rounds ties to even
        if abs(mantissa) <= 1 << bits:
            return mantissa, exponent
        exponent += 1


def as_double(value: Fraction) -> float:
    """Return the double next to a number; infinity beyond their range."""
    try:
        return float(value)
    except OverflowError:
        return -math.inf if value < 0 else math.inf


# ---------------------------------------------------------------- text


def digits_of(number: Any) -> Any:
    """Return a double, long double or mpf of 113 bits as JSON can hold it, for ``decimal``.

    As a float if it is one or NaN, else as text: the shortest of at least 33 digits that gives it
    back.
    """
    return float(number) if float(number) == number or number != number else wide_text(number)


def wide_text(number: Any) -> str:
    """Return a finite long double or mpf of 113 bits as text that gives it back in its own type.

    The shortest text of a double, such as 0.1, would give another number of a wider type.
    """
    if not hasattr(number, "context"):  # NumPy writes the shortest text itself
        return str(number)
    exact_value = exact(number)
    # ⌊112 log₁₀ 2⌋ = 33 decimals survive binary128; 36 tell any number from its neighbours
    for count in range(_QUAD_DIGITS - 3, _QUAD_DIGITS + 1):
        text: str = number.context.nstr(number, count)
        mantissa, exponent = nearest(Fraction(text), *_QUAD)
        if mantissa * Fraction(2) ** exponent == exact_value:
            return text
    raise ArithmeticError(f"{number!r} has more than {_QUAD[0]} bits.")
