"""Numbers of the type that a stepper computes in: rounded to it, written as JSON, read back."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from ...core.exact_numbers import as_double, decimal, exact, nearest
from ...core.real_types import REALS, RealName

__all__ = ["as_float", "from_text", "rounding"]


def rounding(real: RealName) -> Callable[[Fraction], Any]:
    """Return what rounds a number to a type: to NumPy's long double, to mpf, else to double."""
    if REALS[real].in_mpmath:
        from .binary128 import rounded  # mpmath costs time, and only float128 needs it

        return rounded
    return _as_long_double if REALS[real].dtype is np.longdouble else as_double


def as_float(value: Fraction, dtype: Any) -> Any:
    """Return the number of one of NumPy's floating-point types next to a value, or infinity."""
    about = np.finfo(dtype)
    bits = int(about.nmant) + 1
    mantissa, exponent = nearest(value, bits, int(about.minexp) - int(about.nmant))
    number = about.dtype.type(0)
    for part in range(0, bits + 1, 16):  # each a number of any of the types
        number += np.ldexp(about.dtype.type(abs(mantissa) >> part & 0xFFFF), part)
    with np.errstate(over="ignore"):
        scaled = np.ldexp(number, exponent)
    return -scaled if mantissa < 0 else scaled


def _as_long_double(value: Fraction) -> Any:
    return as_float(value, np.longdouble)


def from_text(value: Any, real: RealName) -> Any:
    """Return the number that ``exact_numbers.digits_of`` wrote, in that type.

    Raises
    ------
    ValueError
        For anything else.
    """
    if type(value) not in (int, float) and not (REALS[real].wide and type(value) is str):
        raise ValueError(f"{value!r} is no number")
    if type(value) is int and abs(value) >= 2**63:
        raise ValueError("an integer is huge")
    if not REALS[real].wide:
        return value
    found = decimal(value) if isinstance(value, str) else exact(value)
    if not isinstance(found, Fraction):
        raise ValueError(f"{value!r} is no number")
    return rounding(real)(found)
