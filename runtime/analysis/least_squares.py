"""The method of Levenberg and Marquardt in relative units, and what data determine.

Unknowns y are measured in units u, changes that are large: 1 of a logarithm, of a momentum its
size. The step minimises |r + J y|² + μ |y/u|². The damping μ = 4 σ², with the variance σ² of the
residuals at the point, keeps directions that the data do not determine within about u/2 a step. It
vanishes with the residuals (Yamashita, Fukushima, Computing Suppl. 15, 2001), and grows where a
step does not decrease |r|².
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core.errors import GyrosparkError

__all__ = ["Determined", "Found", "Linear", "determined", "minimise", "reduced"]

Array = NDArray[Any]
Point = TypeVar("Point")

#: Singular values below this share of the largest are round-off of the derivatives.
RANK = 1e-10
#: A part of a direction that is smaller is none.
SHARE = 1e-3
#: Standard deviation of a direction, in units, beyond which no step is taken along it.
_BEYOND = 10.0
#: μ/σ² of a step, and the factor by which it grows where a step fails.
_DAMPING, _GROWTH = 4.0, 8.0


@dataclass(frozen=True)
class Linear:
    """Residuals r at a point, their derivatives J by coordinates y that are 0 there, units of y."""

    r: Array
    J: Array
    units: Array

    @property
    def finite(self) -> bool:
        """Whether r and J are numbers."""
        return bool(np.isfinite(self.r).all() and np.isfinite(self.J).all())


@dataclass(frozen=True)
class Found(Generic[Point]):
    """A point where the sum of squares is least."""

    point: Point
    iterations: int
    converged: bool


def minimise(
    point: Point, residuals: Callable[[Point], Array], linearise: Callable[[Point], Linear],
    moved: Callable[[Point, Array], Point], excess: Callable[[Point, Array], float],
    tolerance: float, most: int, noise: float = 0.0,
) -> Found[Point]:
    """Return where |r|² is least, from a point near to it.

    Parameters
    ----------
    residuals, linearise : callable
        The residuals at a point, and these linearised.
    moved : callable
        The point at y.
    excess : callable
        How many times y is longer than a step may be; where this is above 1, y is shortened.
    tolerance : float
        The iteration ends where the expected decrease of |r|² is below this share of the variance
        of a residual: the step is then a part √tolerance of one standard deviation.
    most : int
        Largest number of iterations.
    noise : float
        What residuals are uncertain by at least.
    """
    at = linearise(point)
    factor = 1.0
    for iteration in range(most):
        R = triangle(np.column_stack([at.J * at.units, at.r]))
        U, s, Vt = np.linalg.svd(R[:, :-1], full_matrices=False)
        g = U.T @ R[:, -1]
        cost = float(at.r @ at.r)
        variance = cost / max(1, len(at.r) - len(s)) + noise**2
        kept = _BEYOND * s > np.sqrt(variance)
        failed = False
        while True:
            damping = factor * _DAMPING * variance + (RANK * s[0]) ** 2 + np.finfo(float).tiny
            part = kept * s * g / (s**2 + damping)
            y = -(Vt.T @ part) * at.units
            share = min(1.0, 1 / max(excess(point, y), 1e-300))
            part, y = part * share, y * share
            expected = float(g @ g - np.sum((g - s * part) ** 2))
            if expected <= tolerance * variance:
                return Found(point, iteration, True)
            trial = _tried(point, y, residuals, linearise, moved, cost - 1e-3 * expected)
            if trial is not None:
                break
            factor, failed = factor * _GROWTH, True
        point, at = trial
        if not failed:
            factor = max(1.0, factor / _GROWTH)
    return Found(point, most, False)


def triangle(A: Array) -> Array:
    """Return R of A = QR, at most as many rows as columns: the same singular values.

    A few rows at a time, which LAPACK does on one thread: with two threads on 600 × 24 numbers, a
    fit of a double body took 1.0 CPU seconds in place of 0.36.
    """
    rows = 2 * A.shape[1]
    R: Array = A[:0]
    for first in range(0, len(A), rows):
        made: Any = np.linalg.qr(np.concatenate([R, A[first : first + rows]]), mode="r")
        R = made
    return R


def _tried(
    point: Point, y: Array, residuals: Callable[[Point], Array],
    linearise: Callable[[Point], Linear], moved: Callable[[Point, Array], Point], below: float,
) -> tuple[Point, Linear] | None:
    """Return the point at y, linearised; None where |r|² is not below a bound or no motion is."""
    try:
        new = moved(point, y)
        r = residuals(new)
        if not float(r @ r) < below:
            return None
        made = linearise(new)
    except GyrosparkError:  # a step too far, which damping shortens
        return None
    return (new, made) if made.finite else None


@dataclass(frozen=True)
class Determined:
    """What data determine of unknowns.

    Attributes
    ----------
    covariance : array, shape (k, k)
        For residuals of variance 1, over the determined directions alone.
    null : array, shape (k, l)
        Directions that are not determined.
    variances : array, shape (k,)
        Of each unknown over all directions; infinite where it has a part in one that changes
        nothing, or where one standard deviation is longer than 1 in the units.
    """

    covariance: Array
    null: Array
    variances: Array


def determined(at: Linear, noise: float) -> Determined:
    """Return what residuals of this noise determine.

    A direction is undetermined where its singular value is round-off, or where one standard
    deviation of it is longer than 1 in the units.
    """
    _, s, Vt = np.linalg.svd(triangle(at.J * at.units), full_matrices=True)
    full = np.zeros(len(Vt))
    full[: len(s)] = s
    moves = full > RANK * full[0]
    kept = moves & (full > noise)
    directions = Vt.T * at.units[:, None]
    part = directions[:, kept] / full[kept]
    variances = ((directions[:, moves] / full[moves])**2).sum(axis=1)
    idle = (np.abs(Vt.T[:, ~moves]) > SHARE).any(axis=1)
    vague = ~kept.all() & (noise * np.sqrt(variances) > at.units)
    return Determined(part @ part.T, directions[:, ~kept],
                      np.where(idle | vague, np.inf, variances))


def reduced(null: Array) -> Array:
    """Return a readable basis of the space of the columns, in rows.

    Each has a 1 where the others have 0. By Gauss-Jordan elimination with full pivots: entries of a
    single row are at most 1 in size.
    """
    A = null.T.copy()
    free = list(range(A.shape[1]))
    for i in range(len(A)):
        sizes = np.abs(A[i:][:, free])
        row, at = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
        column = free.pop(int(at))
        A[[i, i + int(row)]] = A[[i + int(row), i]]
        A[i] /= A[i, column]
        for j in range(len(A)):
            if j != i:
                A[j] -= A[j, column] * A[i]
    return A
