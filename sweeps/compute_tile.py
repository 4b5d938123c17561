"""The cells of a tile: those with equal steps run side by side in the lanes of compiled code."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.interrupts import Interrupts
from ..runtime.integration.consistency import defects_of_starts
from ..runtime.steppers.stepper import Stepper
from ..storage.array_layout import QUANTITY, StoredField
from .cell_events import CellEnds, watched
from .results import BAD_START, STATUS, Sink
from .study import Study
from .tiles import Cells, Tile, cells_of

__all__ = ["compute", "run_tiles"]

Array = NDArray[Any]

_ERRORS = {"energy_error": "energy_error", "constraint": "constraint",
           "momentum_constraint": "hidden"}
_MEMORY = threading.local()


def compute(study: Study, fields: list[StoredField], tile: Tile) -> dict[str, Array]:
    """Return the arrays of a tile, by name and with the tile's shape, the status last.

    A cell whose step fails is NaN, with the steps that were done and the reason as its status; it
    disturbs no other. Bits of a cell depend on its own numbers alone.
    """
    cells = cells_of(study, tile)
    flat: dict[str, Array] = {f.name: np.full((len(cells), *f.shape), f.fill, dtype=f.dtype)
                              for f in fields}
    kinds = cells.scheme.astype(np.int64) * (study.most_steps + 1) + cells.steps
    for kind in np.unique(kinds):
        scheme, steps = divmod(int(kind), study.most_steps + 1)
        group = np.flatnonzero(kinds == kind)
        group = group[np.argsort(cells.dt[group], kind="stable")]  # as many sweeps as their mates
        found = _run(study, study.steppers[scheme], steps, cells, group)
        for field in fields:
            flat[field.name][group] = found[field.name]
    return {name: values.reshape(*tile.shape, *values.shape[1:])
            for name, values in flat.items()}


def _run(
    study: Study, stepper: Stepper, steps: int, cells: Cells, group: Array
) -> dict[str, Array]:
    """Return the results of some cells that have the scheme and the steps in common."""
    dtype = stepper._binding_of_many.dtype
    dt, q0, p0 = (np.array(x[group], dtype=dtype) for x in (cells.dt, cells.q, cells.p))
    structs = _structs(study, stepper, cells, group)
    with np.errstate(all="ignore"):
        ends = (watched(study, stepper, steps, cells, group) if study.events else
                _run_without_events(study, stepper, steps, structs, dt, q0, p0))
        q, p, reports, status = ends.q, ends.p, ends.reports, ends.status
        bad = ~_consistent(study, stepper, cells, group, structs, q0, p0, dt)
        status[bad], reports["steps"][bad] = BAD_START, 0
        found = _numbers(reports) | {"q": q, "p": p, STATUS: status}
        found |= _quantities(study, stepper, structs, reports, dt, q, p) | ends.found
    if study.every is not None:
        found["q_samples"], found["p_samples"] = ends.samples
    lost = status != 0
    for name, values in found.items():
        if values.dtype.kind == "f" and lost.any():
            found[name] = values.copy()
            found[name][lost] = np.nan
    return found


def _run_without_events(
    study: Study, stepper: Stepper, steps: int, structs: Array, dt: Array, q0: Array, p0: Array
) -> CellEnds:
    """Integrate cells in one call of compiled code."""
    binding, every = stepper._binding_of_many, study.every or steps
    q, p = q0.copy(), p0.copy()
    out = None
    if study.every is not None:
        out = tuple(binding.new(len(q), steps // every, binding.n) for _ in "qp")
    options = binding.options(study.tolerance, study.max_iterations, study.solver)
    reports, status = binding.integrate_many(structs, options, dt, steps, every, q, p, out,
                                             _memory(stepper))
    way = () if out is None else zip((q0, p0), out, strict=True)
    samples = tuple(np.concatenate([start[:, None], rows], axis=1) for start, rows in way)
    return CellEnds(q, p, reports, status, samples, {})


def _memory(stepper: Stepper) -> tuple[Any, ...]:
    """Return this thread's work memory for a stepper."""
    kept: dict[int, tuple[Stepper, tuple[Any, ...]]] = _MEMORY.__dict__.setdefault("kept", {})
    if id(stepper) not in kept:
        kept.clear()  # a thread works at one stepper at a time
        kept[id(stepper)] = stepper, stepper._binding_of_many.many_memory()
    return kept[id(stepper)][1]


def _structs(study: Study, stepper: Stepper, cells: Cells, group: Array) -> Array:
    """Return the parameters as compiled code has them: a row a cell, the time last."""
    binding = stepper.binding
    columns = [cells.parameters[name][group] for name in binding.parameter_names]
    columns += [] if binding.time is None else [np.full(len(group), study.t0)]
    columns += [] if columns else [np.zeros(len(group))]  # C has no empty struct
    return np.ascontiguousarray(np.stack(columns, axis=1), dtype=binding.dtype)


def _numbers(reports: Array) -> dict[str, Array]:
    """Return the running records as doubles."""
    steps = reports["steps"]
    found: dict[str, Array] = {"energy_start": reports["energy_start"].astype(float)}
    for name, recorded in _ERRORS.items():
        found[f"{name}_max"] = reports[f"{recorded}_max"].astype(float)
        found[f"{name}_mean"] = reports[f"{recorded}_sum"].astype(float) / (steps + 1)
    found["iterations_mean"] = reports["iterations"] / np.maximum(steps, 1)
    found |= {name: reports[name] for name in ("iterations_max", "newton_steps")}
    found["steps_done"] = steps
    if "work" in (reports.dtype.names or ()):
        found["work"] = reports["work"].astype(float)
    return found


def _quantities(
    study: Study, stepper: Stepper, structs: Array, reports: Array, dt: Array, q: Array, p: Array
) -> dict[str, Array]:
    """Return the system's own quantities at the ends."""
    binding = stepper.binding
    if not binding.quantity_names:
        return {}
    t = (study.t0 + reports["steps"] * dt).astype(binding.dtype)
    rows = [binding.quantities(_struct(stepper, structs[i]), t[i : i + 1], q[i : i + 1],
                               p[i : i + 1])[0] for i in range(len(q))]
    values = np.array(rows, dtype=float)
    return {QUANTITY + name: values[:, i] for i, name in enumerate(binding.quantity_names)}


def _struct(stepper: Stepper, row: Array) -> Any:
    """Return one cell's parameters for compiled code."""
    return stepper.binding.ffi.from_buffer(f"{stepper.binding.name}_parameters *", row)


def _consistent(
    study: Study, stepper: Stepper, cells: Cells, group: Array, structs: Array, q: Array,
    p: Array, dt: Array,
) -> Array:
    """Return whether each cell's start is on the constraints.

    Cells that agree in the parameters that matter are judged together, by one of them where they
    start alike. What a scheme that lets the momentum constraint oscillate allows beyond that is
    looked at cell by cell.
    """
    found = np.ones(len(group), dtype=bool)
    if not stepper.m:
        return found

    def judge(same: Array, keeps_f: bool) -> Array:
        parameters = _struct(stepper, structs[same[0]])
        return defects_of_starts(stepper.binding, keeps_f, parameters, q[same], p[same],
                                 dt[same]).consistent

    varied = [cells.parameters[name][group]
              for name in stepper.manifest.system.start_parameters if study.varied(name)]
    for same in _alike(varied, len(group)):
        found[same] = judge(same if study.varied("q") else same[:1], True)
    if not stepper.manifest.scheme.keeps_momentum_constraint:
        for i in np.flatnonzero(~found):
            found[i] = judge(np.array([i]), False)[0]
    return found


def _alike(columns: list[Array], count: int) -> list[Array]:
    """Return the rows that agree in all columns, group by group."""
    if not columns:
        return [np.arange(count)]
    which = np.unique(np.column_stack(columns), axis=0, return_inverse=True)[1].reshape(-1)
    return np.split(np.argsort(which, kind="stable"), np.cumsum(np.bincount(which))[:-1])


def run_tiles(
    study: Study, fields: list[StoredField], tiles: Iterator[Tile], sink: Sink, workers: int,
    interrupts: Interrupts, advance: Callable[[Tile], None],
) -> None:
    """Compute tiles on ``workers`` threads and write them from this one as they come.

    No more than twice as many tiles are in memory. After a signal those that are begun are
    finished and written.
    """
    for stepper in study.steppers:
        _ = stepper._binding_of_many  # compiled once, before threads ask for it
    begun: dict[Future[dict[str, NDArray[Any]]], Tile] = {}
    pool = ThreadPoolExecutor(workers, thread_name_prefix="gyrospark-sweep")
    try:
        while True:
            while len(begun) < 2 * workers and not interrupts.requested:
                tile = next(tiles, None)
                if tile is None:
                    break
                begun[pool.submit(compute, study, fields, tile)] = tile
            if interrupts.requested:
                begun = {future: tile for future, tile in begun.items() if not future.cancel()}
            if not begun:
                return
            ended, _ = wait(begun, return_when=FIRST_COMPLETED)
            for future in ended:
                tile = begun.pop(future)
                sink.write(tile, future.result())
                advance(tile)
    finally:  # after an error nobody waits for tiles that are begun: they may take long
        pool.shutdown(wait=not begun, cancel_futures=True)
