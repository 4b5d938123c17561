"""The Levenberg-Marquardt method in relative units, and the identifiability of unknowns.

Unknowns y are measured in units u, changes that are large: 1 of a logarithm, of a momentum its
size. The step minimises |r + J y|² + μ |y/u|². The damping μ = 4 σ², with the variance σ² of the
residuals at the point, keeps directions that the data do not determine within about u/2 a step. It
vanishes with the residuals (Yamashita, Fukushima, Computing Suppl. 15, 2001), and grows where a
step does not decrease |r|².
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np

from ...core.arrays import Array
from ...core.errors import GyrosparkError
from ...core.records import dataclass

__all__ = ["Identifiability", "Linear", "Minimum", "identify", "minimise", "reduced_basis"]

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
class Minimum(Generic[Point]):
    """A point where the sum of squares is least."""

    point: Point
    iterations: int
    converged: bool


def minimise(
    point: Point, residuals: Callable[[Point], Array], linearise: Callable[[Point], Linear],
    move: Callable[[Point, Array], Point], excess: Callable[[Point, Array], float],
    tolerance: float, iteration_limit: int, noise: float = 0.0,
) -> Minimum[Point]:
    """Return the point where |r|² is least, by damped Gauss-Newton steps from ``point``.

    A step y changes the unknowns, and in the linear model the residuals r to r + J y. J has the
    derivatives of r, and u the units of the unknowns (``Linear``). With the singular values s_i of
    J in units, J diag(u) = Q U diag(s) Vᵀ with Q of a QR factorisation, and g = Uᵀ Qᵀ r, the step
    is y = −u V x, x = diag(s/(s² + μ)) g, with μ the ``damping`` and x the ``singular_step``. It
    decreases |r|² by Σ g_i² − (g_i − s_i x_i)².

    Parameters
    ----------
    residuals, linearise : callable
        r at a point, and r with J and units.
    move : callable
        The point after a step y.
    excess : callable
        Length of y as a multiple of the longest step allowed; above 1, y is shortened.
    tolerance : float
        The iteration ends where the expected decrease of |r|² is below this share of the variance
        of a residual: the step is then a part √tolerance of one standard deviation.
    iteration_limit : int
        Largest number of iterations.
    noise : float
        Least standard deviation of the residuals, such as their truncation error.
    """
    linear = linearise(point)
    factor = 1.0
    for iteration in range(iteration_limit):
        s, Vt, g = _singular_system(linear)
        cost = float(linear.r @ linear.r)
        variance = cost / max(1, len(linear.r) - len(s)) + noise**2
        # No step along directions whose standard deviation exceeds _BEYOND units.
        within_reach = _BEYOND * s > np.sqrt(variance)
        failed = False
        # A step that decreases |r|² by less than a thousandth of the expected decrease is tried
        # with more damping. That lowers the expectation too, below the tolerance at last.
        while True:
            # the second term replaces singular values of round-off (``RANK``), the third one
            # prevents 0/0 for J = 0
            damping = factor * _DAMPING * variance + (RANK * s[0]) ** 2 + np.finfo(float).tiny
            singular_step = within_reach * s * g / (s**2 + damping)
            y = -(Vt.T @ singular_step) * linear.units
            share = min(1.0, 1 / max(excess(point, y), 1e-300))
            singular_step, y = singular_step * share, y * share
            # |r|² − |r + J y|², which a linear model gains by the step
            expected = float(g @ g - np.sum((g - s * singular_step) ** 2))
            if expected <= tolerance * variance:
                return Minimum(point, iteration, converged=True)
            trial = _evaluate_trial(point, y, residuals, linearise, move, cost - 1e-3 * expected)
            if trial is not None:
                break
            factor, failed = factor * _GROWTH, True
        point, linear = trial
        # the damping falls again only after a step that needed no second try
        if not failed:
            factor = max(1.0, factor / _GROWTH)
    return Minimum(point, iteration_limit, converged=False)


def _singular_system(linear: Linear) -> tuple[Array, Array, Array]:
    """Return s, Vᵀ and g = Uᵀ r of J diag(u) = U diag(s) Vᵀ: the residual along each direction."""
    # the residual as the last column: one QR factorisation gives R and Qᵀr
    R = triangle(np.column_stack([linear.J * linear.units, linear.r]))
    U, s, Vt = np.linalg.svd(R[:, :-1], full_matrices=False)
    return s, Vt, U.T @ R[:, -1]


def triangle(A: Array) -> Array:
    """Return R of A = QR, at most as many rows as columns: it has the singular values of A.

    A is factorised a few rows at a time, [R; next rows] = Q R', which LAPACK does on one thread:
    with two threads on 600 × 24 numbers, a fit of a double body took 1.0 CPU seconds in place of
    0.36.
    """
    block_rows = 2 * A.shape[1]
    R: Array = A[:0]
    for start_row in range(0, len(A), block_rows):
        next_rows = A[start_row : start_row + block_rows]
        factor: Any = np.linalg.qr(np.concatenate([R, next_rows]), mode="r")
        R = factor
    return R


def _evaluate_trial(
    point: Point, y: Array, residuals: Callable[[Point], Array],
    linearise: Callable[[Point], Linear], move: Callable[[Point, Array], Point], cost_bound: float,
) -> tuple[Point, Linear] | None:
    """Return the point at y, linearised; None if |r|² is not below a bound or the run fails.

    The other arguments as for ``minimise``. J is computed only where r is accepted.
    """
    try:
        trial = move(point, y)
        r = residuals(trial)
        if not float(r @ r) < cost_bound:
            return None
        linear = linearise(trial)
    except GyrosparkError:  # a step too far, which damping shortens
        return None
    return (trial, linear) if linear.finite else None


@dataclass(frozen=True)
class Identifiability:
    """The directions of the unknowns that the data determine, and those they leave free.

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


def identify(linear: Linear, noise: float) -> Identifiability:
    """Return the determined directions of the unknowns.

    ``noise`` is the standard deviation of the residuals. Along the singular direction v_i of J
    diag(u) an estimate has the standard deviation noise/s_i in units: the direction is undetermined
    if that exceeds 1, or if s_i is round-off. Of the determined ones the covariance is u V
    diag(1/s²) Vᵀ u.
    """
    _, s, Vt = np.linalg.svd(triangle(linear.J * linear.units), full_matrices=True)
    singular_values = np.zeros(len(Vt))
    singular_values[: len(s)] = s
    has_effect = singular_values > RANK * singular_values[0]
    measured = has_effect & (singular_values > noise)
    directions = Vt.T * linear.units[:, None]
    measured_directions = directions[:, measured] / singular_values[measured]
    variances = ((directions[:, has_effect] / singular_values[has_effect])**2).sum(axis=1)
    # the variance of an unknown is infinite if a direction without effect has a part along it, or
    # if directions were left out and its deviation exceeds its unit
    without_effect = (np.abs(Vt.T[:, ~has_effect]) > SHARE).any(axis=1)
    beyond_unit = ~measured.all() & (noise * np.sqrt(variances) > linear.units)
    return Identifiability(
        covariance=measured_directions @ measured_directions.T, null=directions[:, ~measured],
        variances=np.where(without_effect | beyond_unit, np.inf, variances))


def reduced_basis(null: Array) -> Array:
    """Return a basis of the space of the columns in reduced echelon form, one vector per row.

    Gauss-Jordan elimination with full pivoting. A basis of one vector has entries of size ≤ 1.
    """
    A = null.T.copy()
    candidates = list(range(A.shape[1]))  # columns without a pivot so far
    for i in range(len(A)):
        sizes = np.abs(A[i:][:, candidates])
        row, pivot_column = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
        column = candidates.pop(int(pivot_column))
        A[[i, i + int(row)]] = A[[i + int(row), i]]  # rows below i are searched: an offset
        A[i] /= A[i, column]
        for j in range(len(A)):
            if j != i:
                A[j] -= A[j, column] * A[i]
    return A
