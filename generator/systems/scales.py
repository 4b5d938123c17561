"""Time scales σ = dt/dτ for ``System(..., time_scale=σ)``, as ``gyrospark.scales``.

    distance(a, b)    |a − b|^(3/2): a close encounter, an eccentric orbit
    rates(w1, w2, …)  (w1² + w2² + …)^(−1/2), a smooth minimum of 1/|w|

σ must see every rate of the motion: what it does not see is stepped over. A rate is an expression
in 1/s: an orbital rate √(μ/r³), an angular velocity, one over the width of a pulse.
"""

from __future__ import annotations

from typing import Any

import sympy as sp

from ...core.arguments import count_text, shown
from ...core.errors import InputError
from .expression_arguments import as_expression, as_sequence

__all__ = ["distance", "rates"]


def __dir__() -> list[str]:
    return __all__


def distance(a: Any, b: Any, power: float | sp.Expr = 1.5) -> sp.Expr:
    """Return |a − b| to a power.

    With 3/2, the power of Kepler's third law, an orbit of any eccentricity takes the same number of
    steps; 1 and 2 make more and fewer steps far away.

    Parameters
    ----------
    a, b : sequences of Expr, of equal length
        Points; a body stands for its origin.
    power : float or Expr
        A positive number.

    Raises
    ------
    InputError
        For a value that is no point, and a power that is not positive.
    """
    exponent = as_expression(power)
    # 1.5 as 3/2, by its decimals
    exponent = sp.Rational(str(exponent)) if exponent.is_Float else exponent
    if not exponent.is_positive:
        raise InputError(f"power = {shown(power)} is not positive; steps are to be short where the "
                         "distance is: give 3/2, say.")
    points = [_point(name, end) for name, end in (("a", a), ("b", b))]
    if len(points[0]) != len(points[1]):
        raise InputError(f"a has {count_text(len(points[0]), 'coordinate')} and b "
                         f"{len(points[1])}; give points "
                         "of the same space.")
    square: sp.Expr = sp.Add(*((x - y) ** 2 for x, y in zip(*points, strict=True)))
    if square == 0:
        raise InputError("a and b are the same point, at distance 0 at all times; give two points.")
    return square ** (exponent / 2)


def rates(*rates: float | sp.Expr) -> sp.Expr:
    """Return (Σ rate²)^(−1/2): near the fastest of the rates it is one over that rate.

    Parameters
    ----------
    rates : Expr or float
        In 1/s, of either sign. One of them is a positive constant, a floor: without it σ has no
        bound where all rates vanish.

    Raises
    ------
    InputError
        For a value that is no expression, and without a floor.
    """
    terms = [as_expression(rate) for rate in rates]
    if not any(term.is_positive and all(s.is_positive for s in term.free_symbols)
               for term in terms):
        raise InputError(f"None of the {len(terms)} rates is a positive constant, so that the time "
                         "scale has no bound where they all vanish; add the slowest rate of "
                         "interest, such as rates(omega, 0.1).")
    total: sp.Expr = sp.Add(*(term**2 for term in terms)) ** sp.Rational(-1, 2)
    return total


def _point(name: str, frame: Any) -> list[sp.Expr]:
    """Return the coordinates of a point as expressions; a body or frame stands for its origin.

    ``name`` is the argument's name in messages.
    """
    point = frame.point([0, 0, 0]) if hasattr(frame, "point_velocity") else frame
    return [as_expression(x) for x in as_sequence(name, point)]
