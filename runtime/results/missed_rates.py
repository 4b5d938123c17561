"""Whether a time scale misses a rate of the motion: scaled steps beside constant ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array
from ...core.warnings import warn

if TYPE_CHECKING:
    from .trajectory import Trajectory

__all__ = ["warn_of_missed_rate"]

#: Rows that are compared, the last ones, and those of a block; fewer than the third number do not
#: span a motion.
_COMPARED, _AT_ONCE, _FEWEST = 1 << 20, 1 << 14, 12
#: Coordinates whose range is below this part of their size are constant.
_CONSTANT = 1e-9
#: Order r of the differences: first differences of a pulse are no larger than those of a later
#: rotation.
_ORDER = 4
#: Ratio of lengths, of constant steps with equal differences to as many as there are scaled steps.
_WORSE = 1.3


def warn_of_missed_rate(trajectory: Trajectory) -> bool:
    """Warn, and return True, if scaled steps resolve the motion worse than as many constant ones.

    The error of steps h grows with h^r |z⁽ʳ⁾|. For scaled steps it is the difference |Δʳz| of
    r + 1 rows, for N constant ones in a time T about (T/N)^r r! |z[t_k, …, t_(k+r)]| with the
    divided difference; r = 4. A scale that follows all rates makes the largest |Δʳz|, in parts of
    the range of z, smaller than the largest of constant steps. A run that does not store every step
    is not compared, and gets no warning.
    """
    if trajectory.every != 1:
        return False
    count = min(len(trajectory) - 1, _COMPARED)  # the last step may end at t_end
    if count < _FEWEST:
        return False
    rows = slice(len(trajectory) - 1 - count, len(trajectory) - 1)
    t, states = trajectory.t[rows].astype(float), (trajectory.q[rows], trajectory.p[rows])
    # of each coordinate and each momentum
    ranges, sizes = (np.concatenate([measure(x, axis=0) for x in states]).astype(float)
                     for measure in (np.ptp, _largest))
    moves, mean_step = ranges > _CONSTANT * sizes, abs(t[-1] - t[0]) / (count - 1)
    # the largest differences so far, of scaled and of constant steps
    scaled = constant = np.zeros(np.count_nonzero(moves))
    for start_row in range(0, count - _ORDER, _AT_ONCE):
        block = slice(start_row, start_row + _AT_ONCE + _ORDER)
        z = np.concatenate([x[block] for x in states], axis=1).astype(float)
        z = z[:, moves] / ranges[moves]
        scaled = np.maximum(scaled, _largest(np.diff(z, _ORDER, axis=0), axis=0))
        constant = np.maximum(
            constant, _largest(_divided_differences(z, t[block] / mean_step), axis=0))
    worst_entry = int(np.argmax(scaled)) if len(scaled) else 0
    # without a difference of constant steps all of them are round-off
    if not constant.any() or not scaled[worst_entry] > _WORSE**_ORDER * constant.max():
        return False
    # ``worst_entry`` counts only the coordinates and momenta that move
    name = [*trajectory.coordinates, *trajectory.momenta][np.flatnonzero(moves)[worst_entry]]
    factor = (scaled[worst_entry] / constant.max()) ** (1 / _ORDER)
    warn(f"Steps in scaled time resolve {name} at worst as constant steps {factor:.2g} times as "
         "long as as many of them are: time_scale misses a rate of the motion. Add it to "
         "gyrospark.scales.rates(...), or leave time_scale out.")
    return True


def _divided_differences(z: Array, t: Array) -> Array:
    """Return r! z[t_k, …, t_(k+r)], shape (rows − r, columns), 0 where it is round-off.

    z has the shape (rows, columns), t the shape (rows,). By r steps of the recursion

        z[t_k, …, t_(k+j)] = (z[t_(k+1), …] − z[t_k, …])/(t_(k+j) − t_k)
    """
    differences = z
    for j in range(1, _ORDER + 1):
        differences = np.diff(differences, axis=0) * (j / (t[j:] - t[:-j]))[:, None]
    # the shortest of the r steps that a difference spans
    shortest = np.abs(np.diff(t))
    for _ in range(_ORDER - 1):
        shortest = np.minimum(shortest[1:], shortest[:-1])
    # round-off ε of z in [0, 1], which r differences multiply by up to 2^r each, over h^r
    noise = 2.0 ** (2 * _ORDER) * np.finfo(float).eps / shortest**_ORDER
    return np.where(np.abs(differences) > noise[:, None], differences, 0)


def _largest(x: Array, axis: int) -> Array:
    """Return max |x| along an axis."""
    largest: Array = np.abs(x).max(axis=axis)
    return largest
