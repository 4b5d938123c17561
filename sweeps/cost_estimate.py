"""Cost estimate of a sweep, from a few timed cells."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from ..storage.array_layout import StoredField
from .compute_tile import compute
from .results import fields_of
from .study import Study
from .tiles import Tile, tile_counts, tile_shape

__all__ = ["Estimate", "estimate"]

#: Cells timed together, how many such samples, and steps of each.
_CELLS, _SAMPLES, _STEPS = 16, 96, 200


@dataclass(frozen=True)
class Estimate:
    """Estimated cost of a sweep.

    Attributes
    ----------
    cells, tiles, steps : int
        In all; steps of all cells together.
    cpu_seconds : float
        Of one core; ``low`` and ``high`` are two standard errors of the mean away.
    disk_bytes, files : int
        Of the store.
    memory_bytes : int
        Of a worker, beside the interpreter.
    """

    cells: int
    tiles: int
    steps: int
    cpu_seconds: float
    low: float
    high: float
    disk_bytes: int
    files: int
    memory_bytes: int


def estimate(study: Study, fields: list[StoredField]) -> Estimate:
    """Time samples of neighbouring cells, spread evenly over the axes, a part of their steps."""
    tiles, steps = _counts(study)
    places = [_sample(study, i) for i in range(_SAMPLES)]
    timed = {tile.place: tile for tile in places}  # each once: a small grid has few
    seconds = {place: _seconds_a_step(study, tile) for place, tile in timed.items()}
    samples = [seconds[tile.place] for tile in places]
    mean = float(np.mean(samples))
    spread = 2 * float(np.std(samples, ddof=1)) / math.sqrt(len(samples))
    row = sum(field.row_bytes for field in fields)
    whole = row * math.prod(tile_shape(study))  # the last tile of an axis is padded
    return Estimate(
        study.size, tiles, steps, steps * mean, steps * max(mean - spread, 0.0),
        steps * (mean + spread), tiles * whole, tiles * len(fields), 2 * whole,
    )


def _counts(study: Study) -> tuple[int, int]:
    """Return the number of tiles, and of steps of all cells."""
    steps = study.steps_of(study.time_steps)
    return math.prod(tile_counts(study)), int(steps.sum()) * (study.size // len(steps))


def _sample(study: Study, number: int) -> Tile:
    """Return some neighbouring cells, as many as fit along the last axis.

    Their places are those of an additive recurrence, x_i = i φ^-k mod 1 along axis k, where
    φ^(d+1) = φ + 1 for d axes: samples of any number are spread evenly, those of a few hard cells
    neither missed nor counted twice (M. Roberts' R-sequence).
    """
    shape = study.shape
    ratio = 2.0
    for _ in range(64):
        ratio = (1 + ratio) ** (1 / (len(shape) + 1))
    place = [int((0.5 + number * ratio**-k) % 1 * length) for k, length in enumerate(shape, 1)]
    wide = min(shape[-1], _CELLS)
    place[-1] = min(place[-1], shape[-1] - wide)
    return Tile(tuple(place), tuple(
        slice(i, i + (wide if axis == len(shape) - 1 else 1)) for axis, i in enumerate(place)))


def _seconds_a_step(study: Study, tile: Tile) -> float:
    """Return the CPU time of a step of these cells.

    Two lengths are timed: their difference has no calls in it, and no first steps.
    """
    if study.steps is not None and study.steps <= 2 * _STEPS:
        short = replace(study, every=None)
        _time(short, tile)  # for caches
        return _time(short, tile) / study.steps / math.prod(tile.shape)
    once, twice = (replace(study, steps=n, duration=None, every=None)
                   for n in (_STEPS, 2 * _STEPS))
    _time(once, tile)  # for caches
    seconds = max(_time(twice, tile) - _time(once, tile), 0.0)
    return seconds / _STEPS / math.prod(tile.shape)


def _time(study: Study, tile: Tile) -> float:
    fields = fields_of(study, [])
    began = time.thread_time()
    compute(study, fields, tile)
    return time.thread_time() - began
