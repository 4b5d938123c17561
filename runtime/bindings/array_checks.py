"""Checks of a caller's arrays, numbers and parameters. Converts, never reinterprets."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import as_integer, shown
from ...core.errors import InputError
from ...core.exact_numbers import as_double, exact
from .real_numbers import as_float

__all__ = ["as_array", "as_numbers", "as_positive_count", "as_real",
           "as_step", "converted_to"]

#: Largest count: half the range of C's ``long`` and of NumPy's int64, so that sums with numbers of
#: steps or rows do not overflow.
_MOST = 2**62
_DOUBLE = np.dtype(np.float64)
#: Numbers up to which floats are faster than arrays.
_FEW = 32


def as_array(name: str, value: Any, shape: tuple[int, ...], dtype: type) -> NDArray[Any]:
    """Return a contiguous copy of the value in the stepper's own type.

    Lists, integers, other types of numbers and strided views are converted by value. Raises
    InputError for another shape, for complex, boolean or non-numeric entries, for NaN and infinity.
    """
    # what most calls give; a finite sum has finite entries
    if (type(value) is np.ndarray and value.dtype is _DOUBLE and dtype is np.float64
            and value.shape == shape and value.size <= _FEW and value.ndim == 1
            and math.isfinite(sum(value.tolist()))):
        return value.copy()
    array = as_numbers(name, value)
    if array.shape != shape:
        raise InputError(f"{name} has shape {array.shape}; give shape {shape}.")
    converted = converted_to(dtype, array)
    if _all_finite(converted):
        return converted
    if not _are_finite(array):
        raise InputError(f"{name} = {_entries(array)} is not finite; give finite numbers.")
    raise InputError(f"{name} = {_entries(array)} is too large for {converted.dtype}; give "
                     "smaller numbers or a wider floating-point type.")


def _all_finite(array: NDArray[Any]) -> bool:
    """Whether all entries of an array of floating-point numbers are finite."""
    # The number of finite entries is the fastest of NumPy's reductions over truth values.
    return int(np.count_nonzero(np.isfinite(array))) == array.size


def _are_finite(array: NDArray[Any]) -> bool:
    """Whether all entries of an array by ``as_numbers`` are finite, of whatever type they are."""
    if array.dtype == object:
        return all(isinstance(exact(entry), Fraction) for entry in array.flat)
    return bool(np.all(np.isfinite(array)))


def converted_to(dtype: Any, array: NDArray[Any]) -> NDArray[Any]:
    """Return a copy of an array by ``as_numbers`` in a type of NumPy; overflow gives infinity."""
    if array.dtype == object:
        # a fraction is rounded once; what ``exact`` returns else is NaN or infinity
        numbers = [as_float(x, dtype) if isinstance(x, Fraction) else x
                   for x in map(exact, array.flat)]
        array = np.array(numbers, dtype=dtype).reshape(array.shape)
    if array.dtype == dtype:
        return np.array(array, order="C")
    with np.errstate(over="ignore"):
        return np.array(array, dtype=dtype, order="C")


def _entries(array: NDArray[Any]) -> str:
    """Return the text of an array for a message, on one line and at most 200 characters long."""
    text = " ".join(str(array).split())
    return text if len(text) <= 200 else text[:199] + "…"


def as_numbers(name: str, value: Any) -> NDArray[Any]:
    """Return an array of real numbers of whatever type and shape they are; not a copy.

    Numbers that NumPy has no type for (``Fraction``, ``Decimal``, mpmath) are an array of objects,
    each of which ``exact_numbers.exact`` takes. Raises InputError for complex, boolean or
    non-numeric entries.
    """
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(f"{name} {_unequal_rows(value)}; give an array of numbers, with rows of "
                         "equal length.") from error
    # kinds of NumPy: floats, signed and unsigned integers, and objects, which may be numbers
    strange: list[Any] = []
    if array.dtype.kind not in "fiuO":
        strange = [array.dtype]
    elif array.dtype == object:
        strange = [type(x).__name__ for x in array.flat if exact(x) is None]
    if strange:
        raise InputError(f"{name} has entries of type {strange[0]}; give real numbers (float64 is "
                         "best).")
    return array


def _unequal_rows(value: Any) -> str:
    """Return how the rows of a ragged sequence differ, as the rest of a sentence.

    The row named is the first whose length is not that of row 0.
    """
    # None stands for a number in place of a row
    lengths = [len(row) if hasattr(row, "__len__") else None for row in value]
    row = next((i for i, length in enumerate(lengths) if length != lengths[0]), None)
    if row is None:
        return "has rows of unequal shapes"
    first_length, other_length = ("is one number" if length is None else f"has {length} entries"
                                  for length in (lengths[0], lengths[row]))
    return f"has unequal rows: row 0 {first_length}, row {row} {other_length}"


def as_real(name: str, value: Any, number: Callable[[Fraction], Any] = as_double) -> Any:
    """Return a finite real number, of whatever type it comes, rounded once by ``number``."""
    if number is as_double and isinstance(value, float) and math.isfinite(value):
        return float(value)  # what most calls give
    exact_value = exact(value)
    if exact_value is None:
        raise InputError(f"{name} = {shown(value)} is not a real number.{_cure(value)}")
    if isinstance(exact_value, float):
        raise InputError(f"{name} = {exact_value} is not finite; give a finite number.")
    rounded = number(exact_value)
    if rounded - rounded != 0:  # infinite, in any type
        raise InputError(f"{name} = {shown(value)} is too large; give a smaller number, or choose "
                         "a wider floating-point type.")
    return rounded


def _cure(value: Any) -> str:
    """Return advice for a number that was given as text; none for other values."""
    if isinstance(value, str):
        return " Give a number: 0.1, or with all its digits Decimal('0.1')."
    return ""


def as_step(value: Any, number: Callable[[Fraction], Any] = as_double, name: str = "dt") -> Any:
    """Return a usable time step: finite and not zero; negative integrates backwards."""
    if value is None:
        raise InputError(f"{name} is not given; give the time step in seconds, such as "
                         f"{name} = 1e-3.")
    if isinstance(value, str):
        raise InputError(f"{name} = {shown(value)} is no number; give seconds, such as those of "
                         "gyrospark.tune(step, start, step_error=1e-9, t_end=1).dt.")
    dt = as_real(name, value, number)
    if dt == 0:
        raise InputError(f"{name} = 0 makes no step; give a positive {name}, or a negative one to "
                         "go back.")
    return dt


def as_positive_count(name: str, value: Any, minimum: int = 0) -> int:
    """Return a whole number of at least ``minimum``; 10.0 and 1e3 are such numbers."""
    count = as_integer(value)
    if count is None:
        raise InputError(f"{name} = {shown(value)} is not a whole number.")
    if count < minimum:
        raise InputError(f"{name} = {shown(value)} is too small; give at least {minimum}.")
    if count > _MOST:
        raise InputError(f"{name} = {shown(value)} is too large; give at most {_MOST}.")
    return count


