"""How far one motion is from another, path by path: of each body's axes, and of points.

A unit quaternion q beside q_ref is turned by φ = 2 L(q_ref)(q − q_ref) in body axes (exact where
both have one norm, whose difference L(q_ref) leaves out). The path of the body's axis i in space
is then off by √(φ_j² + φ_k²), j and k the two other axes. Three paths a body tell what one angle
hides: a top's axis, which carries its centre of mass, may be a thousand times more exact than its
spin. What stands between quaternions are positions: each block of them is the path of a point.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..rigid_body.quaternion import left_matrix

__all__ = ["MotionError", "distances", "root_mean_squares"]

Array = NDArray[Any]


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

    def __init__(self, reference: Array, like: Array) -> None:
        """Compare with ``reference``; ``like`` is a run, whose quaternions have norm 1."""
        self.reference, rows = reference, np.asarray(like, dtype=float)
        self.quaternions, points = _blocks(rows)
        self.turning = list(range(3 * len(self.quaternions)))
        self.paths = [[column for column in range(3 * body, 3 * body + 3) if column != 3 * body + i]
                      for body in range(len(self.quaternions)) for i in range(3)]
        first = len(self.turning)
        for point in points:
            self.paths.append(list(range(first, first + len(point))))
            first += len(point)
        self._points = [i for point in points for i in point]
        largest = np.abs(rows).max(axis=0, initial=0)
        self._reach = np.array([largest[point].max() or 1.0 for point in points for _ in point])

    def __call__(self, q: Array) -> Array:
        """Return the differences of a motion's rows from the reference, one column a component."""
        change = np.asarray(q - self.reference, dtype=float)  # float128: subtracted in full first
        place = np.asarray(self.reference, dtype=float)
        turns = [2 * np.einsum("kij,kj->ki", left_matrix(place[:, at]), change[:, at])
                 for at in self.quaternions]
        return np.concatenate([*turns, change[:, self._points] / self._reach], axis=1)


def distances(errors: Array, paths: list[list[int]]) -> Array:
    """Return the distance of each path in each row, shape (rows, paths)."""
    return np.stack([np.sqrt((errors[:, path] ** 2).sum(axis=1)) for path in paths], axis=1)


def root_mean_squares(errors: Array, paths: list[list[int]]) -> Array:
    """Return the root mean square of each path's distance over the rows; infinite for NaN."""
    if not len(errors):
        return np.zeros(len(paths))
    with np.errstate(over="ignore", invalid="ignore"):
        sizes = np.sqrt((distances(errors, paths) ** 2).mean(axis=0))
    return np.where(np.isfinite(sizes), sizes, math.inf)


def _blocks(q: Array) -> tuple[list[slice], list[list[int]]]:
    """Return the columns of unit quaternions, detected by their norm in every row, and the others.
    """
    quaternions: list[slice] = []
    points: list[list[int]] = []
    i, n, new = 0, q.shape[1], True
    while i < n:
        if i + 4 <= n and np.abs((q[:, i : i + 4] ** 2).sum(axis=1) - 1).max() < 1e-4:
            quaternions.append(slice(i, i + 4))
            i, new = i + 4, True
            continue
        if new:
            points.append([])
        points[-1].append(i)
        i, new = i + 1, False
    return quaternions, points
