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

__all__ = ["ALIGNMENT", "WIDE_BYTES", "aligned_zeros", "as_bytes", "as_float", "from_bytes",
           "from_text", "rounding", "without_padding"]

def rounding(real: RealName) -> Callable[[Fraction], Any]:
    """Return the rounding function of a type: to NumPy's long double, to mpf, else to double."""
    if REALS[real].in_mpmath:
        from .binary128 import round_to_quad  # mpmath costs time, and only float128 needs it

        return round_to_quad
    return _as_long_double if REALS[real].dtype is np.longdouble else as_double


def as_float(value: Fraction, dtype: Any) -> Any:
    """Return the number of a type of NumPy next to a value; infinity beyond its range."""
    type_info = np.finfo(dtype)
    bits = int(type_info.nmant) + 1
    mantissa, exponent = nearest(value, bits, int(type_info.minexp) - int(type_info.nmant))
    # value ≈ mantissa · 2^exponent, with the bits of the type
    number = type_info.dtype.type(0)
    # the mantissa in pieces of 16 bits, each of which any of the types holds exactly
    for shift in range(0, bits + 1, 16):
        number += np.ldexp(type_info.dtype.type(abs(mantissa) >> shift & 0xFFFF), shift)
    with np.errstate(over="ignore"):
        scaled = np.ldexp(number, exponent)
    return -scaled if mantissa < 0 else scaled


def _as_long_double(value: Fraction) -> Any:
    """Return a fraction as the nearest long double."""
    return as_float(value, np.longdouble)


def from_text(value: Any, real: RealName) -> Any:
    """Return the number that ``exact_numbers.digits_of`` wrote, in that type.

    Raises ValueError for anything else.
    """
    if type(value) not in (int, float) and not (REALS[real].wide and type(value) is str):
        raise ValueError(f"{value!r} is no number")
    # a file could name an integer that takes the memory of the machine: 64 bits are enough
    if type(value) is int and abs(value) >= 2**63:
        raise ValueError("an integer is huge")
    if not REALS[real].wide:
        return value
    if value != value:  # of an input that changes
        return rounding(real)(Fraction(0)) + value
    number = decimal(value) if isinstance(value, str) else exact(value)
    if not isinstance(number, Fraction):
        raise ValueError(f"{value!r} is no number")
    return rounding(real)(number)


#: Bytes of a cache line, and of a register of AVX-512.
ALIGNMENT = 64
#: Bytes of an x87 number that count.
_X87_BYTES = 10


def aligned_zeros(size: int) -> NDArray[Any]:
    """Return ``size`` zeroed bytes whose address is a multiple of ``ALIGNMENT``."""
    # NumPy aligns to 16 bytes only: the bytes begin at the next multiple inside a larger array
    room = np.zeros(size + ALIGNMENT, dtype=np.uint8)
    start = -room.__array_interface__["data"][0] % ALIGNMENT
    return room[start : start + size]


def without_padding(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array with equal bytes for equal numbers: itself, or a copy.

    An x87 long double has 10 bytes of value and 6 of padding, which are set to 0 in a copy.
    """
    if array.dtype != np.longdouble or np.finfo(np.longdouble).nmant != 63:
        return array
    copy = array.copy(order="C")
    copy.reshape(-1).view(np.uint8).reshape(-1, copy.itemsize)[:, _X87_BYTES:] = 0
    return copy


#: Bytes of a long double on x86-64 and AArch64, and of a float128.
WIDE_BYTES = 16


def as_bytes(array: Array) -> Array:
    """Return the bytes of an array's numbers along a last axis, equal for equal numbers."""
    if array.dtype == object:
        from .binary128 import to_bytes  # mpmath costs time, and only float128 needs it

        return to_bytes(array)
    data = np.ascontiguousarray(without_padding(array)).view(np.uint8)
    return data.reshape(*array.shape, array.dtype.itemsize)


def from_bytes(data: Array, dtype: Any) -> Array:
    """Return the numbers whose bytes are along the last axis: the inverse of ``as_bytes``."""
    if dtype is object:
        from .binary128 import from_bytes as quads

        return quads(data)
    values: Array = np.ascontiguousarray(data).view(dtype)
    return values.reshape(data.shape[:-1])
