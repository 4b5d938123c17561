"""The distance of one motion from another, path by path: of each body's axes, and of points.

A unit quaternion q differs from q_ref by the rotation φ = 2 L(q_ref)(q − q_ref) in body axes (exact
if both have the same norm; L(q_ref) removes the difference of the norms). The path of the body's
axis i in space then differs by √(φ_j² + φ_k²), j and k the two other axes. Three paths per body
show more than one angle: a top's axis, which carries its centre of mass, may be a thousand times
more exact than its spin. Coordinates between quaternions are positions: each block of them is the
path of a point.
"""

from __future__ import annotations

import math

import numpy as np

from ...core.arrays import Array
from ..rigid_body.quaternion import left_matrix

__all__ = ["MotionError", "distances", "root_mean_squares"]


class MotionError:
    """Differences from a reference motion as columns, and which columns make a path.

    Attributes
    ----------
    paths : list of list of int
        Columns of each path: two components of φ, or the coordinates of a point.
    turning : list of int
        The columns that are components of φ, in rad; the others are in parts of the largest
        coordinate of their point.
    """

    def __init__(self, reference: Array, run_states: Array) -> None:
        """Compare with the rows of q in ``reference``.

        ``run_states``, rows of q of a run near it, show which columns are quaternions and how large
        the coordinates of points are: an extrapolated reference has quaternions of other norms.
        """
        self.reference, states = reference, np.asarray(run_states, dtype=float)
        self.quaternions, points = _blocks(states)
        # φ of each body, three columns, then the coordinates of points
        self.turning = list(range(3 * len(self.quaternions)))
        # the path of axis i of a body: the two components of φ about its other axes
        self.paths = []
        for first in range(0, len(self.turning), 3):
            self.paths += [[first + 1, first + 2], [first, first + 2], [first, first + 1]]
        first_column = len(self.turning)
        for point in points:
            self.paths.append(list(range(first_column, first_column + len(point))))
            first_column += len(point)
        self._points = [i for point in points for i in point]
        # points are measured by their extent: the largest coordinate, 1 if all are 0
        largest = np.abs(states).max(axis=0, initial=0)
        self._reach = np.array([largest[point].max() or 1.0 for point in points for _ in point])

    def __call__(self, q: Array) -> Array:
        """Return the differences of q from the reference q_ref, shape (rows, columns).

        Columns: φ = 2 L(q_ref)(q − q_ref) of each body in rad, a small rotation in body axes, then
        the coordinates of each point over its extent.
        """
        change = np.asarray(q - self.reference, dtype=float)  # float128: subtracted in full first
        position = np.asarray(self.reference, dtype=float)
        angles = [2 * np.einsum("kij,kj->ki", left_matrix(position[:, columns]), change[:, columns])
                  for columns in self.quaternions]
        return np.concatenate([*angles, change[:, self._points] / self._reach], axis=1)


def distances(errors: Array, paths: list[list[int]]) -> Array:
    """Return |errors| of each path in each row, shape (rows, paths); a path is a list of columns.
    """
    return np.stack([np.sqrt((errors[:, path] ** 2).sum(axis=1)) for path in paths], axis=1)


def root_mean_squares(errors: Array, paths: list[list[int]]) -> Array:
    """Return the root mean square of each path's distance over the rows; infinite for NaN."""
    if not len(errors):
        return np.zeros(len(paths))
    with np.errstate(over="ignore", invalid="ignore"):
        sizes = np.sqrt((distances(errors, paths) ** 2).mean(axis=0))
    return np.where(np.isfinite(sizes), sizes, math.inf)


def _blocks(q: Array) -> tuple[list[slice], list[list[int]]]:
    """Return the columns of unit quaternions, as slices, and those of each block between them.

    Four columns whose squares have the sum 1 in every row, to 1e-4, are a quaternion.
    """
    quaternions: list[slice] = []
    points: list[list[int]] = []
    column, n, starts_point = 0, q.shape[1], True
    while column < n:
        squares = (q[:, column : column + 4] ** 2).sum(axis=1)
        if column + 4 <= n and np.abs(squares - 1).max() < 1e-4:
            quaternions.append(slice(column, column + 4))
            column, starts_point = column + 4, True  # a coordinate behind it begins a new point
            continue
        if starts_point:
            points.append([])
        points[-1].append(column)
        column, starts_point = column + 1, False
    return quaternions, points
