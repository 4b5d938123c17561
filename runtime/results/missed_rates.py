"""Whether a time scale misses a rate of the motion: scaled steps beside constant ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.warnings import warn

if TYPE_CHECKING:
    from .trajectory import Trajectory

__all__ = ["warn_of_missed_rate"]

#: Rows that are looked at, the last ones; fewest.
_LOOKED_AT, _FEWEST = 1 << 14, 16
#: Coordinates whose range is below this part of their size are constant.
_CONSTANT = 1e-9
#: Scaled steps may change a coordinate by this multiple of what constant steps do.
_WORSE = 1.3


def warn_of_missed_rate(trajectory: Trajectory) -> None:
    """Warn if steps in scaled time resolve the motion worse than as many constant steps.

    A step changes coordinate or momentum z by |Δz|, in parts of the range of z: at most a in these
    steps, and about c = max |Δz/Δt| T/N in N constant steps. A scale that sees all rates makes a
    smaller than c. A run that stores not every step is not looked at.
    """
    rows = slice(-_LOOKED_AT, len(trajectory) - 1)  # the last step may end at t_end
    z = np.concatenate([trajectory.q[rows], trajectory.p[rows]], axis=1).astype(float)
    if trajectory.every != 1 or len(z) < _FEWEST:
        return
    steps = np.abs(np.diff(trajectory.t[rows].astype(float)))
    reach = np.ptp(z, axis=0)
    moves = reach > _CONSTANT * np.abs(z).max(axis=0)
    changes = np.abs(np.diff(z[:, moves], axis=0)) / reach[moves]
    scaled = changes.max(axis=0, initial=0)
    constant = (changes / steps[:, None]).max(initial=0) * steps.mean()
    if not scaled.max(initial=0) > _WORSE * constant:
        return
    names = [*trajectory.coordinates, *trajectory.momenta]
    name = names[np.flatnonzero(moves)[int(np.argmax(scaled))]]
    warn(f"A step in scaled time changes {name} by up to {scaled.max():.2g} of its range; as many "
         f"constant steps would change no coordinate or momentum by more than {constant:.2g}: "
         "time_scale misses a rate of the motion. Add it to gyrospark.scales.rates(...), or leave "
         "time_scale out.")
