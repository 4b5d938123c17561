"""How many steps lead to a time: a whole number of them, or none does."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

from ...core.arguments import shown
from ...core.errors import InputError
from ...core.exact_numbers import as_double, exact
from ..bindings.array_checks import as_positive_count, as_real, as_step

__all__ = ["step_count"]

#: What t_end, t0 and dt may be off by, in parts of their sizes: two roundings of a double each.
_ROUNDING = Fraction(1, 2**52)


def step_count(steps: Any, t_end: Any, t0: Any, dt: Any, nearest: bool = False) -> int:
    """Return the number of steps: as given, or (t_end − t0)/dt.

    That is a whole number n if |t_end − t0 − n dt| ≤ 2⁻⁵² (|t_end| + |t0| + n |dt|): decimals such
    as 0.1 are rounded before they come here. ``nearest`` takes the whole number next to any t_end.

    Raises
    ------
    InputError
        For both or neither of them, and for a time that no whole number of steps leads to.
    """
    if (steps is None) == (t_end is None):
        raise InputError("Give either steps, their number, or t_end, the time of the last state.")
    if nearest and t_end is None:
        raise InputError("round is for t_end, the time of the last state; give that, or leave "
                         "round away.")
    if t_end is None:
        return as_positive_count("steps", steps)
    as_step(dt)
    end, begin, step = (_fraction(*pair) for pair in (("t_end", t_end), ("t0", t0), ("dt", dt)))
    span = end - begin
    if span * step < 0:
        raise InputError(f"t_end = {_text(end)} lies {'before' if span < 0 else 'behind'} "
                         f"t0 = {_text(begin)}, and dt = {_text(step)} leads away from it; give "
                         f"dt = {_text(-step)}.")
    count = round(span / step)
    rounding = _ROUNDING * (abs(end) + abs(begin) + count * abs(step))
    if nearest or abs(span - count * step) <= rounding:
        return as_positive_count("steps", count)
    few = math.floor(span / step)
    times = " and ".join(_text(begin + n * step) for n in (few, few + 1) if n)
    steps_of = " or ".join(_text(span / n) for n in (few + 1, few) if n)
    raise InputError(f"t_end = {_text(end)} is no whole number of steps of dt = {_text(step)} from "
                     f"t0 = {_text(begin)}; round=True (--round) ends at the step next to it. The "
                     f"nearest that fit: t_end = {times}, or dt = "
                     f"{steps_of}.")


def _fraction(name: str, value: Any) -> Fraction:
    """Return a number of any type as it is."""
    as_real(name, value)
    number = exact(value)
    assert isinstance(number, Fraction), shown(value)
    return number


def _text(value: Fraction) -> str:
    return repr(as_double(value))
