"""Zeros of many functions at once, each in its bracket: Chandrupatla's method, by columns.

T. R. Chandrupatla, A new hybrid quadratic/bisection algorithm for finding the zero of a nonlinear
function without using derivatives, Adv. Eng. Software 28 (1997) 145-149. It takes inverse quadratic
interpolation where that is safe, else halves the bracket: no more than some fifty evaluations, and
six or so where the function is smooth.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["zeros"]

Array = NDArray[Any]

#: Evaluations, where a value jumps or is noise: as many halvings tell any two numbers apart.
_MOST = 240


def zeros(
    evaluate: Callable[[Array, Array], Array], f0: Array, f1: Array, tolerance: Array,
) -> None:
    """Find a zero of each function in [0, 1], where it has the values f0 and f1 of two signs.

    ``evaluate(x, which)`` returns the values of the functions numbered ``which`` at x, and keeps
    what it needs of them. The last bracket of a function is at most twice its tolerance wide, or
    one of its values is 0.
    """
    which = np.arange(len(f0))
    x1, x2 = 0 * tolerance, 0 * tolerance + 1
    y1, y2 = f0.copy(), f1.copy()
    share = y1 / (y1 - y2)
    least = tolerance.copy()
    share = _within(share, least)
    for _ in range(_MOST):
        if not len(which):
            break
        x = x1 + share * (x2 - x1)
        y = evaluate(x, which)
        same = (y > 0) == (y1 > 0)
        x3, y3 = np.where(same, x1, x2), np.where(same, y1, y2)
        x2, y2 = np.where(same, x2, x1), np.where(same, y2, y1)
        x1, y1 = x, y
        width = abs(x2 - x1)
        open_ = (width > 2 * least) & (y1 != 0) & (y2 != 0)
        which, x1, x2, x3, y1, y2, y3, least, width = (
            part[open_] for part in (which, x1, x2, x3, y1, y2, y3, least, width))
        share = _within(_share(x1, x2, x3, y1, y2, y3), least / width)


def _share(x1: Array, x2: Array, x3: Array, y1: Array, y2: Array, y3: Array) -> Array:
    """Return how far to go from x1 to x2: by the quadratic through three points, or half."""
    flat = (y3 == y2) | (y3 == y1) | (x3 == x2)
    y3 = np.where(flat, y2 - (y1 - y2), y3)  # any number that divides: half is taken there
    x3 = np.where(flat, x2 - (x1 - x2), x3)
    xi, phi = (x1 - x2) / (x3 - x2), (y1 - y2) / (y3 - y2)
    safe = (phi * phi < xi) & ((1 - phi) * (1 - phi) < 1 - xi) & ~flat
    share = (y1 / (y2 - y1) * (y3 / (y2 - y3))
             + (x3 - x1) / (x2 - x1) * (y1 / (y3 - y1)) * (y2 / (y3 - y2)))
    half: Array = np.where(safe, share, 0 * share + 0.5)
    return half


def _within(share: Array, least: Array) -> Array:
    """Return a share of a bracket that comes no nearer to its ends than is worth it."""
    least = np.where(least < 0.5, least, 0 * least + 0.5)
    share = np.where(share > least, share, least)
    inside: Array = np.where(share < 1 - least, share, 1 - least)
    return inside
