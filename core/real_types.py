"""The floating-point types: one record each, for the generator, the runtime and the stores.

Known here and nowhere else: how C writes a type, how many digits it has, how Python holds it.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from .errors import InputError
from .records import dataclass

if TYPE_CHECKING:
    from ..generator.tableaux.nodes import Enclosure

__all__ = ["REALS", "Real", "RealName", "round_binary"]

#: What ``real`` may be; the keys of ``REALS``, for editors and type checkers.
RealName = Literal["double", "float", "long-double", "float128"]


@dataclass(frozen=True)
class Real:
    """A binary floating-point type of C.

    Attributes
    ----------
    name : str
        As on the command line.
    c_type : str
        As in C.
    bits : int
        Bits of the significand, the hidden one included; eps = 2^(1 − bits).
    exponent : int
        2^exponent is the least power of 2 above the largest finite number.
    digits : int
        Decimal digits that read back to the same number.
    suffix : str
        Of a literal (``f``, ``L``) and of the functions of ``<math.h>`` in lower case.
    limits : str
        Prefix of the type's limits in ``<float.h>``, as DBL in DBL_MAX.
    bytes : int
        The most it takes in memory.
    dtype : type
        Of NumPy's arrays of it; ``object`` where they hold mpmath numbers.
    stored : str
        NumPy's code of the numbers that stores and tables hold: at most a double.
    """

    name: RealName
    c_type: str
    bits: int
    exponent: int
    digits: int
    suffix: str
    limits: str
    bytes: int
    dtype: Any
    stored: str

    @property
    def wide(self) -> bool:
        """Whether it has more digits than a double."""
        return self.bits > 53

    @property
    def standard(self) -> bool:
        """Whether every C compiler has it; others have names like _Float128."""
        return not self.c_type.startswith("_")

    @property
    def in_mpmath(self) -> bool:
        """Whether Python holds it as mpmath numbers."""
        return self.dtype is object

    def literal(self, value: Fraction) -> str:
        """Return a C literal that reads back to the value rounded to this type.

        Raises InputError for a number above the largest of the type.
        """
        rounded = round_binary(value, self.bits)
        if abs(rounded) >= 2**self.exponent:
            power = math.floor(math.log10(abs(rounded.numerator)) - math.log10(rounded.denominator))
            raise InputError(f"A number of the order of 1e{power} is above the largest of type "
                             f"{self.name}, 2^{self.exponent}; choose other units, or a wider "
                             "type.")
        if abs(rounded) <= Fraction(1, 2 ** (self.exponent + self.bits - 2)):
            rounded = Fraction(0)  # at most half of the smallest number above 0
        if rounded.denominator == 1 and abs(rounded) < 10**6:
            return f"{int(rounded)}.0{self.suffix}"
        if self.bits == 53:
            return repr(float(rounded))
        import mpmath as mp  # costs time, and running a stepper writes no literals

        # 64 bits more than the type has: the decimal digits are those of the number, not of a
        # quotient rounded to the type
        with mp.workprec(self.bits + 64):
            number = mp.mpf(rounded.numerator) / rounded.denominator
            return str(mp.nstr(number, self.digits, strip_zeros=True)) + self.suffix

    def round(self, value: Enclosure) -> Fraction:
        """Return the correctly rounded value; both ends of the enclosure must agree on it."""
        low = round_binary(value.centre - value.radius, self.bits)
        high = round_binary(value.centre + value.radius, self.bits)
        if low != high:
            raise ArithmeticError(f"An enclosure of radius {float(value.radius):.1e} is too wide.")
        return low


REALS: dict[RealName, Real] = {
    real.name: real
    for real in (
        Real("double", "double", 53, 1024, 17, "", "DBL", 8, np.float64, "f8"),
        Real("float", "float", 24, 128, 9, "f", "FLT", 4, np.float32, "f4"),
        Real("long-double", "long double", 64, 16384, 21, "L", "LDBL", 16, np.longdouble, "f8"),
        Real("float128", "_Float128", 113, 16384, 36, "F128", "FLT128", 16, object, "f8"),
    )
}


def round_binary(value: Fraction, bits: int) -> Fraction:
    """Return the nearest number with a significand of that many bits, ties to even.

    The exponent is unbounded: no coefficient of a tableau comes near the subnormal range.
    """
    if value == 0:
        return Fraction(0)
    # 2^(bits − 1) < |value| 2^-exponent < 2^(bits + 1): the bit lengths leave a factor of 2 open
    exponent = value.numerator.bit_length() - value.denominator.bit_length() - bits
    scaled = value / Fraction(2) ** exponent
    if abs(scaled) >= 2**bits:
        exponent, scaled = exponent + 1, scaled / 2
    return round(scaled) * Fraction(2) ** exponent
