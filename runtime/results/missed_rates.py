"""Whether a time scale misses a rate of the motion: scaled steps beside constant ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array
from ...core.warnings import warn

if TYPE_CHECKING:
    from .trajectory import Trajectory

__all__ = ["warn_of_missed_rate"]

#: Rows that are looked at, the last ones, so many at a time; fewest, for few do not span a motion.
_LOOKED_AT, _AT_ONCE, _FEWEST = 1 << 20, 1 << 14, 12
#: Coordinates whose range is below this part of their size are constant.
_CONSTANT = 1e-9
#: Order of the differences: of first ones a pulse has no more than a later rotation.
_ORDER = 4
#: As many constant steps may be shorter by this factor, for equal differences.
_WORSE = 1.3


def warn_of_missed_rate(trajectory: Trajectory) -> bool:
    """Warn, and return True, if scaled steps resolve the motion worse than as many constant ones.

    The error of steps h grows with h^r |z⁽ʳ⁾|. Of scaled steps that is the difference |Δʳz| of
    r + 1 rows, of N constant ones in a time T about (T/N)^r r! |z[t_k, …, t_(k+r)]| with the
    divided difference; r = 4. A scale that sees all rates makes the largest |Δʳz|, in parts of the
    range of z, smaller than the largest of constant steps. A run that stores not every step is not
    looked at.
    """
    if trajectory.every != 1:
        return False
    count = min(len(trajectory) - 1, _LOOKED_AT)  # the last step may end at t_end
    if count < _FEWEST:
        return False
    rows = slice(len(trajectory) - 1 - count, len(trajectory) - 1)
    t, states = trajectory.t[rows].astype(float), (trajectory.q[rows], trajectory.p[rows])
    ranges, size = (np.concatenate([measure(x, axis=0) for x in states]).astype(float)
                    for measure in (np.ptp, _largest))
    moves, step = ranges > _CONSTANT * size, abs(t[-1] - t[0]) / (count - 1)
    scaled = constant = np.zeros(np.count_nonzero(moves))
    for start_row in range(0, count - _ORDER, _AT_ONCE):
        block = slice(start_row, start_row + _AT_ONCE + _ORDER)
        z = np.concatenate([x[block] for x in states], axis=1).astype(float)
        z = z[:, moves] / ranges[moves]
        scaled = np.maximum(scaled, _largest(np.diff(z, _ORDER, axis=0), axis=0))
        constant = np.maximum(constant, _largest(_divided(z, t[block] / step), axis=0))
    worst = int(np.argmax(scaled)) if len(scaled) else 0
    if not constant.any() or not scaled[worst] > _WORSE**_ORDER * constant.max():
        return False  # without any, what moves has differences of round-off alone
    # ``worst`` counts the coordinates and momenta that move
    name = [*trajectory.coordinates, *trajectory.momenta][np.flatnonzero(moves)[worst]]
    factor = (scaled[worst] / constant.max()) ** (1 / _ORDER)
    warn(f"Steps in scaled time resolve {name} at worst as constant steps {factor:.2g} times as "
         "long as as many of them are: time_scale misses a rate of the motion. Add it to "
         "gyrospark.scales.rates(...), or leave time_scale out.")
    return True


def _divided(z: Array, t: Array) -> Array:
    """Return r! z[t_k, …, t_(k+r)], 0 where it is round-off.

    By r steps of the recursion z[t_k, …, t_(k+j)] = (z[t_(k+1), …] − z[t_k, …])/(t_(k+j) − t_k).
    """
    differences = z
    for j in range(1, _ORDER + 1):
        differences = np.diff(differences, axis=0) * (j / (t[j:] - t[:-j]))[:, None]
    # the shortest of the r steps that a difference spans
    shortest = np.abs(np.diff(t))
    for _ in range(_ORDER - 1):
        shortest = np.minimum(shortest[1:], shortest[:-1])
    noise = 2.0 ** (2 * _ORDER) * np.finfo(float).eps / shortest**_ORDER
    return np.where(np.abs(differences) > noise[:, None], differences, 0)


def _largest(x: Array, axis: int) -> Array:
    largest: Array = np.abs(x).max(axis=axis)
    return largest
