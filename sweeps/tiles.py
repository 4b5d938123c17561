"""Tiles: blocks of cells of a sweep that one worker computes and writes at once.

The size of a tile depends on the study alone, not on the machine or its cores: the same study
always writes the same files.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.arrays import Array
from ..core.start import Rule
from ..runtime.rigid_body.gamma_rules import gamma_by_rule, inertia_names
from .axes import SCHEME
from .study import Study

__all__ = ["Cells", "Tile", "cells_of", "tile_counts", "tile_shape", "tiles_of"]

#: Steps times unknowns of a tile: some tenths of a second to some seconds of one core, so that
#: neither writing it nor losing it matters; what stays in memory costs nothing to write.
_LEAST_STORED, _LEAST_KEPT, _MOST_WORK = 4 * 10**7, 10**7, 4 * 10**8
#: Cells of a tile: more of short runs make no call cheaper, and take memory.
_MOST_CELLS = 2**16
#: Tiles of a study, where its work allows: for that many cores.
_TILES = 32
#: Numbers of a tile's stored states.
_MOST_NUMBERS = 2**23


@dataclass(frozen=True)
class Tile:
    """A block of cells.

    Attributes
    ----------
    place : tuple of int
        Index of the tile along each axis, which is the index of its chunk in a store.
    slices : tuple of slice
        Range of the cells along each axis.
    """

    place: tuple[int, ...]
    slices: tuple[slice, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Cells along each axis."""
        return tuple(s.stop - s.start for s in self.slices)


@dataclass(frozen=True)
class Cells:
    """The arguments of the cells of a tile, one row per cell."""

    scheme: Array
    parameters: dict[str, Array]
    dt: Array
    steps: Array
    q: Array
    p: Array

    def __len__(self) -> int:
        return len(self.dt)


def tile_shape(study: Study, is_stored: bool = True) -> tuple[int, ...]:
    """Return the shape of a whole tile: long in the last axes, one scheme each.

    An axis is cut into equal parts: a short last part would be padded on the disk to the length of
    the others.
    """
    cells = _cells_of_a_tile(study, is_stored)
    shape = []
    for axis in reversed(study.axes):
        # a tile has one scheme; of other axes as few parts as leave at most ``cells`` cells each
        part_count = len(axis) if SCHEME in axis.columns else math.ceil(len(axis) / cells)
        length = math.ceil(len(axis) / part_count)
        shape.append(length)
        cells = max(1, cells // length)
    return tuple(reversed(shape))


def _cells_of_a_tile(study: Study, is_stored: bool) -> int:
    """Return how many cells one task takes: enough work for a call, little enough to lose."""
    # a splitting has no unknowns: its flows move q and p
    work = study.max_steps * max(s.unknowns or 2 * s.n for s in study.steppers)
    least_work = _LEAST_STORED if is_stored else _LEAST_KEPT
    cells = min(max(study.size // _TILES, least_work // work), _MOST_WORK // work, _MOST_CELLS)
    if study.every is not None:
        numbers_per_cell = 2 * study.steppers[0].n * (study.max_steps // study.every + 1)
        cells = min(cells, _MOST_NUMBERS // numbers_per_cell)
    return max(cells, 16)  # the lanes of a register of any width


def tile_counts(study: Study, is_stored: bool = True) -> tuple[int, ...]:
    """Return the number of tiles along each axis."""
    return tuple(math.ceil(length / size)
                 for length, size in zip(study.shape, tile_shape(study, is_stored), strict=True))


def tiles_of(study: Study, is_stored: bool = True) -> Iterator[Tile]:
    """Yield the tiles of a study in order: those of a store, or those for a result in memory."""
    shape = tile_shape(study, is_stored)
    for tile_index in itertools.product(*map(range, tile_counts(study, is_stored))):
        yield Tile(tile_index, tuple(
            slice(i * size, min((i + 1) * size, length))
            for i, size, length in zip(tile_index, shape, study.shape, strict=True)))


def cells_of(study: Study, tile: Tile) -> Cells:
    """Return the arguments of the cells of a tile, the last axis fastest."""
    # of each axis the index of each cell, shape (axes, cells)
    indices = np.indices(tile.shape).reshape(len(tile.shape), -1)
    count = indices.shape[1]
    columns: dict[str, Array] = {}
    for axis, tile_slice, index in zip(study.axes, tile.slices, indices, strict=True):
        columns |= {name: values[tile_slice][index] for name, values in axis.columns.items()}

    def column(name: str, common: Any) -> Array:
        """Return a quantity of each cell: of its axis, or the number or row that all share."""
        if name in columns:
            return columns[name]
        return np.broadcast_to(np.asarray(common), (count, *np.shape(common)))

    dt = column(study.step_name, study.dt).astype(float)
    names = study.steppers[0].parameter_domains
    parameters = {name: column(name, study.parameters.get(name)) for name in names
                  if name not in study.means}
    means = {name: _means(name, rule, parameters) for name, rule in study.means.items()}
    return Cells(  # without an axis of schemes there is one, of number 0
        scheme=column(SCHEME, common=0),
        parameters={name: (parameters | means)[name] for name in names}, dt=dt,
        steps=study.steps_of(dt), q=column("q", study.q), p=column("p", study.p))


def _means(name: str, rule: Rule, parameters: dict[str, Array]) -> Array:
    """Return γ or α of each cell, the mean of its moments, which few cells differ in."""
    names = [moment for moment in itertools.chain(*inertia_names(name)) if moment in parameters]
    inertias, cells = np.unique(np.column_stack([parameters[moment] for moment in names]), axis=0,
                                return_inverse=True)
    means = np.array([gamma_by_rule(name, rule, dict(zip(names, row, strict=True)))
                      for row in inertias.tolist()])
    of_cells: Array = means[cells.reshape(-1)]
    return of_cells
