"""Checks of what a caller passes in: arrays, numbers, parameters. Converts, never reinterprets."""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..naming import proposal, shown, whole
from ..remarks import remark
from .inertia import AIMS, has_inertia, is_weight, ruled

__all__ = ["all_finite", "as_array", "as_callback", "as_numbers", "as_parameters",
           "as_positive_count", "as_real", "as_step", "refuse_auto", "shown"]

#: Counts up to this stay exact in C's ``long`` and in NumPy, whatever is added to them.
_MOST = 2**62


def as_array(name: str, value: Any, shape: tuple[int, ...], dtype: type) -> NDArray[Any]:
    """Return a contiguous copy of the value in the stepper's own type.

    Lists, integers, other float types and strided views are converted by value.

    Raises
    ------
    InputError
        For another shape, for complex, boolean or non-numeric entries, for NaN and infinity.
    """
    array = as_numbers(name, value)
    if array.shape != shape:
        raise InputError(f"{name} has shape {array.shape}; give shape {shape}.")
    if not np.all(np.isfinite(array)):
        raise InputError(f"{name} = {_entries(array)} is not finite; give finite numbers.")
    with np.errstate(over="ignore"):  # told below
        converted: NDArray[Any] = np.array(array, dtype=dtype, order="C")
    if not np.all(np.isfinite(converted)):
        raise InputError(f"{name} = {_entries(array)} is too large for {converted.dtype}; give "
                         "smaller numbers or a wider floating-point type.")
    return converted


def _entries(array: NDArray[Any]) -> str:
    """Return an array as a message shows it."""
    text = " ".join(str(array).split())
    return text if len(text) <= 200 else text[:199] + "…"


def all_finite(array: NDArray[Any]) -> bool:
    """Whether all entries, mpmath's among them, are finite."""
    if array.dtype == object:
        return all(entry - entry == 0 for entry in array.flat)
    return bool(np.all(np.isfinite(array)))


def as_numbers(name: str, value: Any) -> NDArray[Any]:
    """Return an array of real numbers of whatever type and shape they are; not a copy.

    Raises
    ------
    InputError
        For complex, boolean or non-numeric entries.
    """
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(f"{name} is ragged; give an array of numbers.") from error
    if array.dtype.kind not in "fiu":
        raise InputError(
            f"{name} has entries of type {array.dtype}; give real numbers (float64 is best)."
        )
    return array


def as_real(name: str, value: Any) -> float:
    """Return a finite real number as float."""
    if isinstance(value, bool) or not isinstance(value, (numbers.Real, np.floating, np.integer)):
        raise InputError(f"{name} = {shown(value)} is not a real number.")
    try:
        number = float(value)
    except OverflowError:  # an integer or a fraction beyond 1e308
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{name} = {number} is not finite; give a finite number.")
    return number


def as_step(value: Any) -> float:
    """Return a usable time step: finite and not zero; negative integrates backwards."""
    dt = as_real("dt", value)
    if dt == 0:
        raise InputError("dt = 0 makes no step; give a positive dt, or a negative one to go back.")
    return dt


def as_positive_count(name: str, value: Any, least: int = 0) -> int:
    """Return a whole number of at least ``least``; 10.0 and 1e3 are such numbers."""
    count = whole(value)
    if count is None:
        raise InputError(f"{name} = {shown(value)} is not a whole number.")
    if count < least:
        raise InputError(f"{name} = {shown(value)} is too small; give at least {least}.")
    if count > _MOST:
        raise InputError(f"{name} = {shown(value)} is too large; give at most {_MOST}.")
    return count


def as_callback(name: str, value: Any) -> Any:
    """Return a function that is called on the way, or None."""
    if value is not None and not callable(value):
        raise InputError(f"{name} = {shown(value)} cannot be called; give a function that takes "
                         "the number of steps (or cells) done, such as print.")
    return value


def as_parameters(given: Any, domains: Mapping[str, str]) -> dict[str, float]:
    """Return the parameters a stepper needs, each checked against its domain.

    Raises
    ------
    InputError
        Naming a missing, unknown or unusable parameter.
    """
    if not isinstance(given, Mapping):
        raise InputError(f"parameters = {shown(given)} is not a dict; give {', '.join(domains)}.")
    missing = [name for name in domains if name not in given]
    if missing:
        raise InputError(
            f"Parameter {missing[0]!r} is not given; this stepper needs {', '.join(domains)}."
        )
    unknown = [str(name) for name in given if name not in domains]
    if unknown:
        raise InputError(
            f"Parameter {unknown[0]!r} is unknown; this stepper takes {', '.join(domains)}"
            f"{proposal(unknown[0], domains)}."
        )
    return {name: _as_parameter(name, given[name], domain, given)
            for name, domain in domains.items()}


def refuse_auto(name: str, value: Any) -> None:
    """Refuse the value "auto" where nothing chooses."""
    if isinstance(value, str) and value in AIMS:
        raise InputError(f"Parameter {name} = {value!r} is chosen by integrate alone; call "
                         "choose_gamma once and give its number.")


def _as_parameter(name: str, value: Any, domain: str, given: Mapping[str, Any]) -> float:
    refuse_auto(name, value)
    if isinstance(value, str) and is_weight(name):
        return ruled(name, value, given)
    number = as_real(f"Parameter {name}", value)
    if domain == "positive" and number <= 0:
        raise InputError(f"Parameter {name} = {number} is not positive; give a number above 0.")
    if domain == "nonzero" and number == 0:
        raise InputError(f"Parameter {name} = 0 divides by zero; give a number other than 0.")
    if number < 0 and has_inertia(name, given):
        remark(f"Parameter {name} = {number:.6g} is below 0. The motion does not depend on it, but "
               "its error does: several times that of a value near the moments of inertia, such "
               "as m.")
    return number
