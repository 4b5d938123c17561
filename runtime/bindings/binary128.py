"""IEEE binary128 at the Python side: mpmath numbers of 113 bits, and their 16 bytes.

NumPy has no such type. ``mpf`` here belongs to an mpmath context of its own: arithmetic among
these numbers rounds to 113 bits, whatever ``mpmath.mp.prec`` is, in every thread. mpmath's own
functions take them as they are; a mixed sum has the precision of its left term. mpmath has no
negative zero: −0 is read as 0.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np

from ...core.arrays import Array
from ...core.errors import InputError
from ...core.exact_numbers import Rounded, nearest
from ...core.exact_numbers import exact as exact_number
from .array_checks import as_numbers

__all__ = ["BITS", "BYTES", "EPSILON", "as_quads", "exact", "from_bytes", "full", "mpf", "pack",
           "quad", "round_to_quad", "to_bytes", "unpack"]

#: IEEE 754 binary128: bits of the significand, its first one implied; bias of the exponent.
BITS = 113
BYTES = 16
EPSILON = 2.0 ** (1 - BITS)
_BIAS = 16383
#: Exponent of the last bit of a subnormal number.
_LEAST = 2 - _BIAS - BITS
_FRACTION: int = 2 ** (BITS - 1)
#: Exponent bits of infinity and NaN.
_SPECIAL = 2 * _BIAS + 1
_INFINITY: int = _SPECIAL << (BITS - 1)
_SIGN: int = 1 << (8 * BYTES - 1)

_CONTEXT = mpmath.MPContext()
_CONTEXT.prec = BITS
mpf = _CONTEXT.mpf
mpf.__module__ = __name__  # where pickle finds it


def quad(value: Any) -> Any:
    """Return a real number of any type as mpf, rounded once to 113 bits."""
    if isinstance(value, (mpf, int, float)) and not isinstance(value, Rounded):
        return _CONTEXT.mpf(value)
    number = exact_number(value)
    if number is None:
        raise TypeError(f"{value!r} is no real number")
    return round_to_quad(number) if isinstance(number, Fraction) else _CONTEXT.mpf(number)


def round_to_quad(value: Fraction) -> Any:
    """Return the number of binary128 next to a value; infinity beyond their range."""
    result = _number(*nearest(value, BITS, _LEAST))
    if abs(result) >= _CONTEXT.ldexp(1, _BIAS + 1):
        return _CONTEXT.ninf if value < 0 else _CONTEXT.inf
    return result


def full(shape: tuple[int, ...], value: Any = 0) -> Array:
    """Return an array of mpf, each entry the number ``value``."""
    array: Array = np.full(shape, quad(value), dtype=object)
    return array


def exact(value: Any) -> Fraction:
    """Return a finite mpf as a fraction."""
    sign, mantissa, exponent, _ = value._mpf_
    fraction: Fraction = int(mantissa) * (-1) ** sign * Fraction(2) ** exponent
    return fraction


# ---------------------------------------------------------------- 16 bytes


def pack(values: Iterable[Any]) -> bytes:
    """Return the bytes of numbers, 16 each in the machine's order, rounded to nearest even."""
    return b"".join(_encode(value).to_bytes(BYTES, sys.byteorder) for value in values)


def unpack(data: bytes) -> list[Any]:
    """Return the mpf numbers that bytes hold, exactly: the inverse of ``pack``."""
    return [_decode(int.from_bytes(data[i : i + BYTES], sys.byteorder))
            for i in range(0, len(data), BYTES)]


def _encode(value: Any) -> int:
    """Return the 128 bits of a number: sign, exponent and fraction, rounded to nearest.

    With the exponent u (``unit``) of the last bit and an integer M < 2^113 (``significand``) the
    number is M · 2^u. A normal M has the hidden bit 2^112, so that (u − u_min) · 2^112 + M, u_min
    the least exponent, are exponent and fraction in one sum.
    """
    if not hasattr(value, "_mpf_"):
        value = quad(value)
    sign, mantissa, exponent, length = value._mpf_
    # mpmath has 0, NaN and infinity without a mantissa
    if not mantissa:
        if exponent == 0:
            return 0
        if value != value:  # a quiet NaN: infinity with the first bit of the fraction
            return _INFINITY | _FRACTION >> 1
        return _INFINITY if value > 0 else _INFINITY | _SIGN
    unit = max(exponent + length - BITS, _LEAST)  # exponent of the last bit kept
    shift = exponent - unit
    significand = int(mantissa) << shift if shift >= 0 else _round_half_even(int(mantissa), -shift)
    # The hidden bit of the significand, if it has one, adds 1 to the exponent; so does a carry by
    # rounding. Beyond the largest number that gives infinity.
    bits: int = min(((unit - _LEAST) << (BITS - 1)) + significand, _INFINITY)
    return bits | _SIGN if sign else bits


def _round_half_even(mantissa: int, shift: int) -> int:
    """Return mantissa/2^shift rounded to nearest, ties to even."""
    quotient, remainder = mantissa >> shift, mantissa & ((1 << shift) - 1)
    half = 1 << (shift - 1)
    # ties go to the even quotient
    up = remainder > half or (remainder == half and quotient % 2 == 1)
    return quotient + 1 if up else quotient


def _decode(bits: int) -> Any:
    """Return the number that 128 bits encode: the inverse of ``_encode``."""
    sign, exponent, fraction = bits & _SIGN, (bits & ~_SIGN) >> (BITS - 1), bits & (_FRACTION - 1)
    if exponent == _SPECIAL:
        return _CONTEXT.nan if fraction else _CONTEXT.ninf if sign else _CONTEXT.inf
    if exponent:  # normal: with the hidden bit; subnormal numbers have the exponent of 1 too
        fraction, exponent = fraction | _FRACTION, exponent - 1
    return _number(-fraction if sign else fraction, exponent + _LEAST)


def _number(mantissa: int, exponent: int) -> Any:
    """Return mantissa · 2^exponent, exactly."""
    return _CONTEXT.make_mpf(mpmath.libmp.from_man_exp(mantissa, exponent))


# ---------------------------------------------------------------- arrays


def to_bytes(array: Array) -> Array:
    """Return an array's bytes, least significant first, along a last axis of 16."""
    data = np.frombuffer(pack(array.flat), dtype=np.uint8).reshape(*array.shape, BYTES)
    return data[..., :: 1 if sys.byteorder == "little" else -1].copy()


def from_bytes(data: Array) -> Array:
    """Return the array of mpf whose bytes are along the last axis: the inverse of ``to_bytes``."""
    if data.dtype != np.uint8 or data.shape[-1:] != (BYTES,):
        raise ValueError("these are no bytes of binary128")
    array = full(data.shape[:-1])
    array.flat[:] = unpack(data[..., :: 1 if sys.byteorder == "little" else -1].tobytes())
    return array


def as_quads(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Return an array of mpf by value, from numbers of any real type.

    Raises InputError for another shape, for entries that are no finite real numbers of binary128.
    """
    array = as_numbers(name, value)
    if array.shape != shape:
        raise InputError(f"{name} has shape {array.shape}; give shape {shape}.")
    converted = full(shape)
    for index, entry in enumerate(array.ravel()):
        number = converted.flat[index] = quad(entry)
        if not _CONTEXT.isfinite(number):
            # infinite as given, or a finite number beyond the range
            finite = isinstance(exact_number(entry), Fraction)
            raise InputError(f"{name} = {array} is " + (
                "too large for float128; give smaller numbers." if finite else
                "not finite; give finite numbers."))
        if abs(number) >= _CONTEXT.ldexp(1, _BIAS + 1):  # exponents of mpf have no bound
            raise InputError(f"{name} = {array} is too large for float128; give smaller numbers.")
    return converted
