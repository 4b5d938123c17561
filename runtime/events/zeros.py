"""Zeros of many functions at once, each in its bracket: Chandrupatla's method, by columns.

T. R. Chandrupatla, A new hybrid quadratic/bisection algorithm for finding the zero of a nonlinear
function without using derivatives, Adv. Eng. Software 28 (1997) 145-149. It uses inverse quadratic
interpolation if that is safe, and otherwise bisection: at most about fifty evaluations, and about
six for a smooth function.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...core.arrays import Array

__all__ = ["cubic_zero", "zeros"]

#: Evaluations of a function that jumps or is noise: as many bisections separate any two numbers.
_MOST = 240


def zeros(
    evaluate: Callable[[Array, Array], Array], f0: Array, f1: Array, tolerance: Array,
    start: Array | None = None,
) -> None:
    """Find a zero of each function in [0, 1], where it has the values f0 and f1 of two signs.

    ``evaluate(x, indices)`` returns the values of the functions with these indices at x, and stores
    its best states, so that nothing is returned here. Arrays have the shape (functions,). The
    search begins at ``start``, by default the secant's zero. It ends if the bracket of a function
    is at most twice its tolerance wide, or one of its values is 0; and at a simple zero if the
    secant through the last two points has its zero within half of the tolerance, while the secant
    before, a hundred times as long, had the same slope.
    """
    indices = np.arange(len(f0))
    x1, x2 = 0 * tolerance, 0 * tolerance + 1
    y1, y2 = f0.copy(), f1.copy()
    tolerances = tolerance.copy()
    fraction = _clamp(y1 / (y1 - y2) if start is None else x1 + start, tolerances)
    x_change, slopes = x2, f1 - f0
    for _ in range(_MOST):
        if not len(indices):
            break
        x = x1 + fraction * (x2 - x1)
        y = evaluate(x, indices)
        last_change, last_slopes = x_change, slopes
        x_change = x - x1
        slopes = (y - y1) / x_change
        converged = ((abs(y) <= tolerances / 2 * abs(slopes))
                     & (100 * abs(x_change) <= abs(last_change))
                     & (10 * abs(slopes - last_slopes) <= abs(last_slopes)))
        # x1, the newest point, and x2 bracket the zero; x3 is the one they replace, which the
        # interpolation uses
        same_side = (y > 0) == (y1 > 0)
        x3, y3 = np.where(same_side, x1, x2), np.where(same_side, y1, y2)
        x2, y2 = np.where(same_side, x2, x1), np.where(same_side, y2, y1)
        x1, y1 = x, y
        width = abs(x2 - x1)
        is_open = (width > 2 * tolerances) & (y1 != 0) & (y2 != 0) & ~converged
        indices, x1, x2, x3, y1, y2, y3, tolerances, width, x_change, slopes = (
            column[is_open] for column in (indices, x1, x2, x3, y1, y2, y3, tolerances, width,
                                         x_change, slopes))
        fraction = _clamp(_fraction(x1, x2, x3, y1, y2, y3), tolerances / width)


def cubic_zero(past: Array, f0: Array, f1: Array) -> Array:
    """Return a zero in (0, 1) of the cubic through f(−2), f(−1), f(0), f(1), else the secant's.

    ``past``, (functions, 2), has f(−1) and f(−2), NaN where they are unknown; ``f0`` and ``f1`` are
    f(0) and f(1), of two signs.
    """
    # the cubic a x³ + b x² + c x + d
    previous, d, next_value = past[:, 0], f0.astype(float), f1.astype(float)
    x = secant = d / (d - next_value)
    with np.errstate(all="ignore"):  # an infinite or NaN result is not used
        a = (next_value - past[:, 1]) / 6 - (d - previous) / 2
        b = (next_value + previous) / 2 - d
        c = next_value - d - a - b
        for _ in range(3):  # Newton's method
            x = x - (((a * x + b) * x + c) * x + d) / ((3 * a * x + 2 * b) * x + c)
        zero: Array = np.where((x > 0) & (x < 1), x, secant)
    return zero


def _fraction(x1: Array, x2: Array, x3: Array, y1: Array, y2: Array, y3: Array) -> Array:
    """Return the next point as a fraction of x2 − x1: by inverse quadratic interpolation, or ½.

    Arrays have an entry for each function. x1, the newest point, and x2 bracket its zero, and x3 is
    the point that they replace; y1, y2 and y3 are the values there.
    Chandrupatla's test: with ξ = (x1 − x2)/(x3 − x2) and φ = (y1 − y2)/(y3 − y2) the interpolation
    is monotonic, and safe, if φ² < ξ and (1 − φ)² < 1 − ξ.
    """
    flat = (y3 == y2) | (y3 == y1) | (x3 == x2)
    y3 = np.where(flat, y2 - (y1 - y2), y3)  # any number that divides: half is taken there
    x3 = np.where(flat, x2 - (x1 - x2), x3)
    xi, phi = (x1 - x2) / (x3 - x2), (y1 - y2) / (y3 - y2)
    safe = (phi * phi < xi) & ((1 - phi) * (1 - phi) < 1 - xi) & ~flat
    fraction = (y1 / (y2 - y1) * (y3 / (y2 - y3))
                + (x3 - x1) / (x2 - x1) * (y1 / (y3 - y1)) * (y2 / (y3 - y2)))
    next_fraction: Array = np.where(safe, fraction, 0 * fraction + 0.5)
    return next_fraction


def _clamp(fraction: Array, margin: Array) -> Array:
    """Return a fraction of a bracket moved to at least ``margin`` from its ends, at most to ½."""
    margin = np.where(margin < 0.5, margin, 0 * margin + 0.5)
    fraction = np.where(fraction > margin, fraction, margin)
    inside: Array = np.where(fraction < 1 - margin, fraction, 1 - margin)
    return inside
