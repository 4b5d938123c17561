"""The cells of a tile: those with equal steps run side by side in the lanes of compiled code."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Array
from ..core.errors import GyrosparkError
from ..core.interrupts import Interrupts
from ..core.real_types import REALS
from ..runtime.integration.consistency import defects_of_starts
from ..runtime.steppers.stepper import Stepper
from ..storage.array_layout import QUANTITY, StoredField
from .cell_events import CellEnds, run_with_events
from .results import BAD_START, STATUS, Sink
from .study import Study
from .tiles import Cells, Tile, cells_of

__all__ = ["compute", "first_steps", "run_tiles"]

#: Result → its name in the running record of compiled code; "hidden" is g_q H_p.
_ERRORS = {"energy_error": "energy_error", "constraint": "constraint",
           "momentum_constraint": "hidden"}
_MEMORY = threading.local()


def compute(study: Study, fields: list[StoredField], tile: Tile) -> dict[str, Array]:
    """Return the arrays of a tile, by name and with the tile's shape, the status last.

    A cell whose step fails is NaN, with the number of its finished steps and the reason as its
    status; other cells are not affected. The bits of a cell depend on its own numbers alone.
    """
    cells = cells_of(study, tile)
    arrays: dict[str, Array] = {f.name: np.full((len(cells), *f.shape), f.fill, dtype=f.dtype)
                                for f in fields}
    # cells of equal scheme and number of steps are integrated together; one number for the pair
    scheme_and_steps = cells.scheme.astype(np.int64) * (study.max_steps + 1) + cells.steps
    for group_key in np.unique(scheme_and_steps):
        scheme, steps = divmod(int(group_key), study.max_steps + 1)
        group = np.flatnonzero(scheme_and_steps == group_key)
        # Neighbouring lanes iterate together: similar dt need similar numbers of iterations.
        group = group[np.argsort(cells.dt[group], kind="stable")]
        results = _run(study, study.steppers[scheme], steps, cells, group)
        for field in fields:
            arrays[field.name][group] = results[field.name]
    return {name: array.reshape(*tile.shape, *array.shape[1:])
            for name, array in arrays.items()}


def _run(
    study: Study, stepper: Stepper, steps: int, cells: Cells, group: Array
) -> dict[str, Array]:
    """Return the results of a group of cells with equal scheme and number of steps.

    ``group`` has the indices of the cells in the tile. A cell off the constraints, or where H is no
    finite number, has the status BAD_START; numbers of cells that failed are NaN.
    """
    dtype = stepper._binding_of_many.dtype
    dt, q0, p0 = (np.array(x[group], dtype=dtype) for x in (cells.dt, cells.q, cells.p))
    structs = _structs(study, stepper, cells, group)
    with np.errstate(all="ignore"):  # numbers that are not finite make a status, no warning
        q0, p0 = _in_scaled_time(study, stepper, structs, q0, p0)  # appends t and e = −H
        equal_constraints = _groups_of_constraints(study, stepper, cells, group)
        # starts of an axis are taken as they are, but wide numbers need digits beyond doubles
        if not study.has_axis("q") or REALS[stepper.manifest.real].wide:
            _project_starts(study, stepper, equal_constraints, structs, q0, p0)
            q0, p0 = _in_scaled_time(study, stepper, structs, q0, p0)  # e of the projected start
        outcome = (run_with_events(study, stepper, steps, cells, group, q0, p0) if study.events else
                   _run_without_events(study, stepper, steps, structs, dt, q0, p0))
        reports, status = outcome.reports, outcome.status
        unusable = ~_consistent(study, stepper, equal_constraints, structs, q0, p0, dt)
        unusable |= ~np.isfinite(reports["energy_start"])
        status[unusable], reports["steps"][unusable] = BAD_START, 0
        results = _report_results(reports) | {STATUS: status}
        results |= _quantities(study, stepper, structs, reports, dt, outcome.q, outcome.p)
    results |= outcome.event_results | _states(stepper, outcome)
    failed = status != 0
    for name, array in results.items():
        if array.dtype.kind == "f" and failed.any():
            results[name] = array.copy()
            results[name][failed] = np.nan
    return results


def _states(stepper: Stepper, outcome: CellEnds) -> dict[str, Array]:
    """Return q, p and their samples, if there are any; in scaled time also the times t."""
    results: dict[str, Array] = {}
    # ``samples`` may be empty
    for name, array in zip(("q", "p", "q_samples", "p_samples"),
                           (outcome.q, outcome.p, *outcome.samples), strict=False):
        results[name] = array[..., : stepper.n]
        if stepper.binding.clocked and name.startswith("q"):  # the last coordinate is t
            results[name.replace("q", "t", 1)] = array[..., -1]
    return results


def _run_without_events(
    study: Study, stepper: Stepper, steps: int, structs: Array, dt: Array, q0: Array, p0: Array
) -> CellEnds:
    """Integrate cells in one call of compiled code; ``structs`` has a row of parameters each.

    dt has an entry, q0 and p0 have a row for each cell. The samples are q and p at the start and
    after every ``study.every`` steps.
    """
    binding, every = stepper._binding_of_many, study.every or steps
    q, p = q0.copy(), p0.copy()
    out = None
    if study.every is not None:
        out = tuple(binding.new(len(q), steps // every, binding.n) for _ in "qp")
    options = binding.options(study.tolerance, study.max_iterations, study.solver)
    reports, status = binding.integrate_many(structs, options, dt, steps, every, q, p, out,
                                             _memory(stepper))
    samples: tuple[Array, ...] = ()
    if out is not None:  # compiled code stores states after steps, not the start
        samples = tuple(np.concatenate([start[:, None], stored_states], axis=1)
                        for start, stored_states in zip((q0, p0), out, strict=True))
    return CellEnds(q, p, reports, status, samples, event_results={})


def _memory(stepper: Stepper) -> tuple[Any, ...]:
    """Return this thread's work memory for a stepper; it is kept for the next tile."""
    memory_of: dict[int, tuple[Stepper, tuple[Any, ...]]] = _MEMORY.__dict__.setdefault("kept", {})
    if id(stepper) not in memory_of:
        memory_of.clear()  # a thread works at one stepper at a time
        memory_of[id(stepper)] = stepper, stepper._binding_of_many.many_memory()
    return memory_of[id(stepper)][1]


def _in_scaled_time(
    study: Study, stepper: Stepper, structs: Array, q: Array, p: Array
) -> tuple[Array, Array]:
    """Return the starts of cells with t and e = −H as last coordinate and momentum, in scaled time.

    ``structs`` has a row of parameters for each row of q and p, on which H depends. Where time is
    not scaled q and p are returned unchanged.
    """
    binding = stepper.binding
    if not binding.clocked:
        return q, p
    states = [binding.start_in_scaled_time(_struct(stepper, row), q[i, : binding.shown],
                                           p[i, : binding.shown], study.t0)
              for i, row in enumerate(structs)]
    return np.array([q for q, _ in states]), np.array([p for _, p in states])


def first_steps(study: Study, stepper: Stepper, cells: Cells, group: Array) -> Array:
    """Return Δt of the first step of the cells ``group``; in scaled time σ Δτ, to first order."""
    dt, binding = cells.dt[group], stepper.binding
    if not binding.clocked:
        return dt
    structs = _structs(study, stepper, cells, group)
    q, p = (x[group].astype(binding.dtype) for x in (cells.q, cells.p))
    q, p = _in_scaled_time(study, stepper, structs, q, p)
    scales = [float(binding.time_scales(_struct(stepper, row), q[i : i + 1], p[i : i + 1])[0])
              for i, row in enumerate(structs)]
    steps: Array = dt * np.array(scales)
    return steps


def _structs(study: Study, stepper: Stepper, cells: Cells, group: Array) -> Array:
    """Return the parameters of the cells for compiled code, shape (cells, names), the time last."""
    binding = stepper.binding
    columns = [cells.parameters[name][group] for name in binding.parameter_names]
    columns += [] if binding.time is None else [np.full(len(group), study.t0)]
    columns += [] if columns else [np.zeros(len(group))]  # C has no empty struct
    return np.ascontiguousarray(np.stack(columns, axis=1), dtype=binding.dtype)


def _report_results(reports: Array) -> dict[str, Array]:
    """Return the results in the running records of cells as columns by name, errors as doubles."""
    steps, columns = reports["steps"], reports.dtype.names or ()
    # errors are those of the start and of all steps, or of as many states as the record says
    states = reports["recorded"] if "recorded" in columns else steps + 1
    results: dict[str, Array] = {"energy_start": reports["energy_start"].astype(float)}
    for name, column in _ERRORS.items():
        mean = reports[f"{column}_sum"].astype(float) / np.maximum(states, 1)
        # the maximum of the C leaves out NaN, which the sum contains
        results[f"{name}_max"] = np.where(np.isnan(mean), mean, reports[f"{column}_max"])
        results[f"{name}_mean"] = mean
    results["iterations_mean"] = reports["iterations"] / np.maximum(steps, 1)
    results |= {name: reports[name] for name in ("iterations_max", "newton_steps")}
    results["steps_done"] = steps
    if "work" in columns:
        results["work"] = reports["work"].astype(float)
    return results


def _quantities(
    study: Study, stepper: Stepper, structs: Array, reports: Array, dt: Array, q: Array, p: Array
) -> dict[str, Array]:
    """Return the system's own quantities at the ends q and p, name → a number for each cell.

    ``structs`` and ``dt`` have the parameters and the step of each, ``reports`` its steps: cells
    that failed end earlier.
    """
    binding = stepper.binding
    if not binding.quantity_names:
        return {}
    t = (study.t0 + reports["steps"] * dt).astype(binding.dtype)
    cell_values = [binding.quantities(_struct(stepper, structs[i]), t[i : i + 1], q[i : i + 1],
                                      p[i : i + 1])[0] for i in range(len(q))]
    quantities = np.array(cell_values, dtype=float)
    return {QUANTITY + name: quantities[:, i] for i, name in enumerate(binding.quantity_names)}


def _struct(stepper: Stepper, row: Array) -> Any:
    """Return a row of ``_structs`` as the parameter struct of compiled code, without a copy."""
    return stepper.binding.ffi.from_buffer(f"{stepper.binding.name}_parameters *", row)


def _project_starts(
    study: Study, stepper: Stepper, equal_constraints: list[Array], structs: Array, q: Array,
    p: Array,
) -> None:
    """Move the starts onto the constraints of their cells, in place; shape (cells, n) each.

    ``equal_constraints`` has the cells with equal constraints as arrays of indices. A start that
    cannot be moved stays, and the check of the starts finds it.
    """
    for group_rows in equal_constraints:
        # one projection for all cells of a group, unless their starts differ
        for rows in group_rows[:, None] if study.has_axis("q") else [group_rows]:
            first_row = rows[0]
            try:
                projected_start = stepper._project(q[first_row], p[first_row],
                                                   _struct(stepper, structs[first_row]))
            except GyrosparkError:
                continue
            for state, projected in zip((q, p), projected_start, strict=True):
                state[rows, : stepper.n] = projected[: stepper.n]


def _consistent(
    study: Study, stepper: Stepper, equal_constraints: list[Array], structs: Array, q: Array,
    p: Array, dt: Array,
) -> Array:
    """Return whether each cell's start is on the constraints.

    Cells with equal constraints are checked together, and by one of them if the
    start does not vary. A scheme that lets the momentum constraint oscillate accepts larger
    errors: cells that fail are then checked again one by one, with their own dt.
    """
    consistent = np.ones(len(q), dtype=bool)

    def check(rows: Array, keeps_f: bool) -> Array:
        """Return whether the starts of cells are consistent, with the parameters of the first cell.

        ``keeps_f`` says that the scheme keeps the momentum constraint, whose error is then bounded
        by round-off.
        """
        parameters = _struct(stepper, structs[rows[0]])
        return defects_of_starts(stepper.binding, keeps_f, parameters, q[rows], p[rows],
                                 dt[rows]).consistent

    for group_rows in equal_constraints:
        # one check serves cells with one start
        consistent[group_rows] = check(group_rows if study.has_axis("q") else group_rows[:1],
                                       keeps_f=True)
    if not stepper.manifest.scheme.keeps_momentum_constraint:
        for i in np.flatnonzero(~consistent):
            consistent[i] = check(np.array([i]), keeps_f=False)[0]
    return consistent


def _groups_of_constraints(
    study: Study, stepper: Stepper, cells: Cells, group: Array
) -> list[Array]:
    """Return the indices of cells whose constraints have equal parameters, an array per group.

    One projection, and one check of the start, serves all cells of a group with one start.
    """
    if not stepper.binding.conditions:
        return []
    columns = [cells.parameters[name][group]
               for name in stepper.manifest.system.start_parameters if study.has_axis(name)]
    if not columns:
        return [np.arange(len(group))]
    group_index = np.unique(np.column_stack(columns), axis=0, return_inverse=True)[1].reshape(-1)
    cells_by_group = np.argsort(group_index, kind="stable")
    group_ends = np.cumsum(np.bincount(group_index))
    return np.split(cells_by_group, group_ends[:-1])


def run_tiles(
    study: Study, fields: list[StoredField], tiles: Iterator[Tile], sink: Sink, workers: int,
    interrupts: Interrupts, advance: Callable[[Tile], None],
) -> None:
    """Compute tiles on ``workers`` threads and write them from this one as they come.

    At most 2 ``workers`` tiles are in memory. After a signal, running tiles are finished and
    written.
    """
    for stepper in study.steppers:
        _ = stepper._binding_of_many  # compiled once, before threads ask for it
    # two for each thread: a thread that is done has the next one while this thread writes
    submitted: dict[Future[dict[str, NDArray[Any]]], Tile] = {}
    pool = ThreadPoolExecutor(workers, thread_name_prefix="gyrospark-sweep")
    try:
        while True:
            while len(submitted) < 2 * workers and not interrupts.is_requested:
                tile = next(tiles, None)
                if tile is None:
                    break
                submitted[pool.submit(compute, study, fields, tile)] = tile
            if interrupts.is_requested:
                submitted = {future: tile for future, tile in submitted.items()
                             if not future.cancel()}
            if not submitted:
                return
            finished, _ = wait(submitted, return_when=FIRST_COMPLETED)
            for future in finished:
                tile = submitted.pop(future)
                sink.write(tile, future.result())
                advance(tile)
    finally:  # after an error, do not wait for running tiles: they may take long
        pool.shutdown(wait=not submitted, cancel_futures=True)
