"""How far one motion is from another, path by path: of each body's axes, and of points.

A unit quaternion q beside q_ref is turned by φ = 2 L(q_ref)(q − q_ref) in body axes (exact where
both have one norm, whose difference L(q_ref) leaves out). The path of the body's axis i in space
is then off by √(φ_j² + φ_k²), j and k the two other axes. Three paths a body tell what one angle
hides: a top's axis, which carries its centre of mass, may be a thousand times more exact than its
spin. What stands between quaternions are positions: each block of them is the path of a point.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..rigid_body.quaternion import left_matrix

__all__ = ["MotionError", "sizes"]

Array = NDArray[Any]


class MotionError:
    """Differences from a reference motion as columns, and which columns make a path.

    Attributes
    ----------
    paths : list of list of int
        Columns of each path: two components of φ, or the coordinates of a point.
    units : numpy.ndarray
        What a difference of 1 is to be held against: 1 for φ, the largest coordinate of a point.
    turning : list of int
        The columns that are components of φ, in rad.
    """

    def __init__(self, reference: Array, like: Array) -> None:
        """Compare with ``reference``; ``like`` is a run, whose quaternions have norm 1."""
        self.reference = reference
        self.quaternions, points = _blocks(np.asarray(like, dtype=float))
        self.turning = list(range(3 * len(self.quaternions)))
        self.paths = [[column for column in range(3 * body, 3 * body + 3) if column != 3 * body + i]
                      for body in range(len(self.quaternions)) for i in range(3)]
        largest = np.abs(np.asarray(like, dtype=float)).max(axis=0)
        units, first = [1.0] * len(self.paths), len(self.turning)
        for point in points:
            self.paths.append(list(range(first, first + len(point))))
            units.append(float(largest[point].max()))
            first += len(point)
        self.units = np.array(units)
        self._points = [i for point in points for i in point]

    def __call__(self, q: Array) -> Array:
        """Return the differences of a motion's rows from the reference, one column a component."""
        change = np.asarray(q - self.reference, dtype=float)  # float128: subtracted in full first
        place = np.asarray(self.reference, dtype=float)
        turns = [2 * np.einsum("kij,kj->ki", left_matrix(place[:, at]), change[:, at])
                 for at in self.quaternions]
        return np.concatenate([*turns, change[:, self._points]], axis=1)


def sizes(errors: Array, paths: list[list[int]]) -> Array:
    """Return the mean distance of each path over the rows."""
    return np.array([np.sqrt((errors[:, path] ** 2).sum(axis=1)).mean() for path in paths])


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
