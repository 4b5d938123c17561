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

#: Cells timed together, enough for the lanes of any register; how many such samples, whose mean has
#: a tenth of their standard deviation as its error; and steps of each.
_CELLS, _SAMPLES, _STEPS = 16, 96, 200


@dataclass(frozen=True)
class Estimate:
    """Estimated cost of a sweep.

    Attributes
    ----------
    cells, tiles, steps : int
        Numbers of cells, of tiles, and of steps of all cells together.
    cpu_seconds : float
        Time of one core; ``low`` and ``high`` are two standard errors of the mean away.
    disk_bytes, files : int
        Size of the store, and number of its files.
    memory_bytes : int
        Memory of a worker, without the interpreter.
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
    """Return the cost from timed samples of cells, spread evenly over the axes, with few steps.

    With the mean s and the standard deviation d of N samples' seconds a step, all steps of all
    cells take steps · (s ± 2 d/√N).
    """
    tiles, steps = _counts(study)
    samples = [_sample(study, i) for i in range(_SAMPLES)]
    distinct_tiles = {tile.place: tile for tile in samples}  # each once: a small grid has few
    seconds = {tile_place: _seconds_a_step(study, tile)
               for tile_place, tile in distinct_tiles.items()}
    sample_seconds = [seconds[tile.place] for tile in samples]
    mean = float(np.mean(sample_seconds))
    two_errors = 2 * float(np.std(sample_seconds, ddof=1)) / math.sqrt(len(sample_seconds))
    cell_bytes = sum(field.row_bytes for field in fields)
    tile_bytes = cell_bytes * math.prod(tile_shape(study))  # the last tile of an axis is padded
    return Estimate(
        study.size, tiles, steps, cpu_seconds=steps * mean,
        low=steps * max(mean - two_errors, 0.0), high=steps * (mean + two_errors),
        disk_bytes=tiles * tile_bytes, files=tiles * len(fields),
        memory_bytes=2 * tile_bytes,  # a thread computes one tile while its last one is written
    )


def _counts(study: Study) -> tuple[int, int]:
    """Return the number of tiles, and of steps of all cells."""
    steps = study.steps_of(study.time_steps)
    return math.prod(tile_counts(study)), int(steps.sum()) * (study.size // len(steps))


def _sample(study: Study, sample_index: int) -> Tile:
    """Return up to ``_CELLS`` neighbouring cells along the last axis.

    Sample i begins at x_i = ½ + i φ^-k mod 1 along axis k, with φ^(d+1) = φ + 1 for d axes: any
    number of samples covers the axes evenly, so that a few hard cells are neither missed nor
    counted twice (M. Roberts' R-sequence).
    """
    shape = study.shape
    ratio = 2.0
    for _ in range(64):  # the fixed point φ = (1 + φ)^(1/(d + 1))
        ratio = (1 + ratio) ** (1 / (len(shape) + 1))
    origin = [int((0.5 + sample_index * ratio**-k) % 1 * length)
              for k, length in enumerate(shape, 1)]
    width = min(shape[-1], _CELLS)
    origin[-1] = min(origin[-1], shape[-1] - width)
    widths = [1] * (len(shape) - 1) + [width]
    return Tile(tuple(origin), tuple(slice(i, i + w) for i, w in zip(origin, widths, strict=True)))


def _seconds_a_step(study: Study, tile: Tile) -> float:
    """Return the CPU time of a step of one cell, in seconds, the mean of a tile's cells.

    The difference of runs of two lengths excludes the calls and the first steps; runs of few steps
    are measured whole, with these.
    """
    if study.steps is not None and study.steps <= 2 * _STEPS:
        short = replace(study, every=None)
        _time(short, tile)  # for caches
        return _time(short, tile) / study.steps / math.prod(tile.shape)
    short_study, long_study = (replace(study, steps=n, t_end=None, every=None)
                               for n in (_STEPS, 2 * _STEPS))
    _time(short_study, tile)  # for caches
    seconds = max(_time(long_study, tile) - _time(short_study, tile), 0.0)
    return seconds / _STEPS / math.prod(tile.shape)


def _time(study: Study, tile: Tile) -> float:
    """Return the CPU time of this thread for the cells of a tile, in seconds, without stored
    results."""
    fields = fields_of(study, [])
    start_time = time.thread_time()
    compute(study, fields, tile)
    return time.thread_time() - start_time
