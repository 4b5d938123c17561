"""Numbers of the type that a stepper computes in: rounding, text, bytes, and memory of structs."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array
from ...core.exact_numbers import as_double, decimal, exact, nearest
from ...core.real_types import REALS, RealName

__all__ = ["ALIGNMENT", "WIDE_BYTES", "aligned", "as_bytes", "as_float", "from_bytes", "from_text",
           "rounding", "without_padding"]

def rounding(real: RealName) -> Callable[[Fraction], Any]:
    """Return the rounding function of a type: to NumPy's long double, to mpf, else to double."""
    if REALS[real].in_mpmath:
        from .binary128 import rounded  # mpmath costs time, and only float128 needs it

        return rounded
    return _as_long_double if REALS[real].dtype is np.longdouble else as_double


def as_float(value: Fraction, dtype: Any) -> Any:
    """Return the number of one of NumPy's floating-point types next to a value, or infinity."""
    type_info = np.finfo(dtype)
    bits = int(type_info.nmant) + 1
    mantissa, exponent = nearest(value, bits, int(type_info.minexp) - int(type_info.nmant))
    number = type_info.dtype.type(0)
    # the mantissa in pieces of 16 bits, each of which any of the types holds exactly
    for shift in range(0, bits + 1, 16):
        number += np.ldexp(type_info.dtype.type(abs(mantissa) >> shift & 0xFFFF), shift)
    with np.errstate(over="ignore"):
        scaled = np.ldexp(number, exponent)
    return -scaled if mantissa < 0 else scaled


def _as_long_double(value: Fraction) -> Any:
    return as_float(value, np.longdouble)


def from_text(value: Any, real: RealName) -> Any:
    """Return the number that ``exact_numbers.digits_of`` wrote, in that type.

    Raises ValueError for anything else.
    """
    if type(value) not in (int, float) and not (REALS[real].wide and type(value) is str):
        raise ValueError(f"{value!r} is no number")
    # a file could name an integer that takes the memory of the machine
    if type(value) is int and abs(value) >= 2**63:
        raise ValueError("an integer is huge")
    if not REALS[real].wide:
        return value
    number = decimal(value) if isinstance(value, str) else exact(value)
    if not isinstance(number, Fraction):
        raise ValueError(f"{value!r} is no number")
    return rounding(real)(number)


ALIGNMENT = 64
#: Bytes of an x87 number that count.
_X87_BYTES = 10


def aligned(size: int) -> NDArray[Any]:
    """Return zeroed bytes, aligned to a multiple of ``ALIGNMENT``."""
    room = np.zeros(size + ALIGNMENT, dtype=np.uint8)
    start = -room.__array_interface__["data"][0] % ALIGNMENT
    return room[start : start + size]


def without_padding(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array with equal bytes for equal numbers: itself, or a copy."""
    if array.dtype != np.longdouble or np.finfo(np.longdouble).nmant != 63:
        return array
    copy = array.copy(order="C")
    copy.reshape(-1).view(np.uint8).reshape(-1, copy.itemsize)[:, _X87_BYTES:] = 0
    return copy


WIDE_BYTES = 16


def as_bytes(array: Array) -> Array:
    """Return an array's numbers as bytes along a last axis, equal for equal numbers."""
    if array.dtype == object:
        from .binary128 import to_bytes  # mpmath costs time, and only float128 needs it

        return to_bytes(array)
    data = np.ascontiguousarray(without_padding(array)).view(np.uint8)
    return data.reshape(*array.shape, array.dtype.itemsize)


def from_bytes(data: Array, dtype: Any) -> Array:
    """Return the numbers that ``as_bytes`` gave the bytes of."""
    if dtype is object:
        from .binary128 import from_bytes as quads

        return quads(data)
    values: Array = np.ascontiguousarray(data).view(dtype)
    return values.reshape(data.shape[:-1])
