"""``gyrospark.sweep``: compute the missing cells of a study, return its result."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._version import __version__
from ..core.arguments import as_flag, count_text, shown
from ..core.errors import InputError, Stopped, StorageError
from ..core.exact_numbers import Number, digits_of, exact
from ..core.incompatibilities import refuse_together
from ..core.inertia import RepName
from ..core.interrupts import catch_ctrl_c, catch_signals
from ..core.progress import Progress, as_progress, log_progress
from ..core.real_types import RealName
from ..core.solver import Solver, SolverName, as_solver
from ..core.warnings import warn
from ..generator.schemes.named_schemes import SchemeName
from ..runtime.bindings.array_checks import as_positive_count
from ..runtime.bindings.real_numbers import as_bytes
from ..runtime.results.rotation_rate import FastestRotation
from ..storage.array_layout import StoredField, attributes_of, open_group
from ..storage.durable_files import new_store_path, remove_parts, storage_errors
from ..storage.identity import refuse_if_different, versions
from ..storage.staging import created_atomically, is_new, writer_lock
from . import cluster, compute_tile
from .plan import plan
from .results import (
    CURE,
    FORMAT,
    STATUS,
    MemorySink,
    Sink,
    StoreSink,
    count_of_each,
    count_statuses,
    create_store,
    done_tiles,
    fields_of,
    load_sweep,
    meanings,
)
from .study import Study
from .tiles import Tile, cells_of, tile_shape, tiles_of

if TYPE_CHECKING:
    import xarray

__all__ = ["run_study", "sweep"]

#: How to make a file of a sweep.
_AS_FILE = "xarray writes the dataset that sweep(...) returns: .to_netcdf('sweep.nc')."


def sweep(
    model: Any,
    over: Mapping[str, Any],
    *,
    scheme: SchemeName | None = None,
    stages: int | None = None,
    order: int | None = None,
    rep: RepName | None = None,
    real: RealName | None = None,
    frame: str | None = None,
    parameters: Mapping[str, Number] | None = None,
    dt: float | None = None,
    dtau: float | None = None,
    steps: int | None = None,
    t_end: float | None = None,
    every: int | None = None,
    solver: SolverName | Solver = "auto",
    events: Any = (),
    keep: Iterable[str] | None = None,
    out: str | Path | None = None,
    resume: bool = False,
    workers: int | None = None,
    dask: Any = None,
    progress: Progress = None,
) -> xarray.Dataset:
    """Integrate a model for every combination of the values of the axes.

    Parameters
    ----------
    model : Problem, Model, str or path
        What moves: a problem of ``gyrospark.problems`` or its name, a model or its file.
    over : mapping
        The axes, in the order of the result's dimensions. A key is a parameter, ``"dt"`` (of
        systems in scaled time ``"dtau"``),
        ``"scheme"`` (["EMS", "G-L 3", "splitting 4"]) or ``"start"`` ({"q": rows, "p": rows}, or
        {"angular_velocity": rows}); its values are a list, or {"from": …, "to": …, "count": …,
        "spacing": "linear" or "log"}. Any other key is a list of points, a dict of equally long
        columns: {"gamma": […], "dt": […]}; with "count" and "seed" the columns are ranges to draw
        from at random.
    scheme, stages, order, rep, real, frame
        As for ``gyrospark.stepper``, where no axis varies them. Errors of a splitting are taken at
        the start, at its first 16 steps and at every 32nd step, as in ``Report``.
    parameters : mapping, optional
        Beside the model's own, and like these where no axis varies them; γ and α that are not
        given are γ_m, another mean is ``gyrospark.gamma(inertia, "h")``.
    dt, steps, t_end : float, int, float
        The time step and the number of steps of every cell; or, in place of ``steps``, ``t_end`` in
        seconds from the start at t = 0: a cell ends with the whole step that is nearest to it.
    dtau : float
        In place of dt, of systems with ``time_scale``: the step of scaled time. Cells have equal
        numbers of steps, and the results ``t`` and, with ``every``, ``t_samples``.
    every : int, optional
        Keep every so many states of each cell, as ``q_samples`` and ``p_samples``.
    solver : str or Solver
        As for ``Stepper.integrate``.
    events : Event or list of Event, optional
        Events to detect in every cell, such as ``model.events``. Results are
        ``event_<name>_first``, the first time (NaN where there is none), and
        ``event_<name>_count``.
    keep : list of str, optional
        The results to keep of a cell; all by default.
    out : path, optional
        A Zarr store to write to as the sweep goes; in memory without.
    resume : bool
        Go on with the sweep in ``out``; cells that are done are not computed again.
    workers : int, optional
        Threads (default: all cores); refused with ``dask``.
    dask : str or distributed.Client, optional
        A cluster in place of threads: a scheduler's address, ``"tcp://…"``, or a client. Workers
        write to ``out``, which must be a folder that all of them can reach.
    progress : callable or bool, optional
        A function is called with the number of cells that are done, and of all; True and False
        as of ``integrate``.

    Returns
    -------
    xarray.Dataset
        Along the axes: largest and mean errors, iterations, the state at the end, and ``status``:
        0, or why a cell is NaN (``Dataset.status.attrs``); a warning has the number of failed
        cells. A cell's bits depend on its own numbers alone, not on neighbours, workers or
        interruptions. The model's q and p are moved onto the constraints of each cell, as by
        ``Stepper.project`` with the parameters of the cell.

    Raises
    ------
    InputError
        For what cannot be swept, before anything is computed.
    StorageError
        If the store cannot be written, or another process writes to it.
    Stopped
        After a signal, with every finished cell in the store, or in the error's ``dataset``.
    """
    method = as_solver(solver)
    study = plan(model, over, scheme=scheme, stages=stages, order=order, rep=rep,
                 real=real, frame=frame, parameters=parameters, dt=dt, dtau=dtau, steps=steps,
                 t_end=t_end, every=every, solver=method.kind, tolerance=method.tolerance,
                 max_iterations=method.max_iterations, events=events)
    return run_study(study, keep=keep, out=out, resume=resume, workers=workers, dask=dask,
                     progress=progress)


def run_study(
    study: Study, *, keep: Iterable[str] | None = None, out: str | Path | None = None,
    resume: bool = False, workers: int | None = None, dask: Any = None,
    progress: Progress = None,
) -> xarray.Dataset:
    """Compute the missing cells of a study, and return its result; see ``sweep``.

    ``keep`` are the names of results, all if None; ``out`` is the path of a store, or None for a
    result in memory.
    """
    as_flag("resume", resume)
    refuse_together(cluster=dask is not None and "a Dask cluster",
                    workers=workers is not None and f"workers = {shown(workers)}")
    fields = fields_of(study, keep)
    count = os.cpu_count() or 1
    threads = count if workers is None else as_positive_count("workers", workers, minimum=1)
    as_progress(progress)
    _warn_of_fast_rotation(study)
    with cluster.connect(dask) as client:
        return _compute_result(study, fields, out, resume, threads, client, progress)


def _compute_result(
    study: Study, fields: list[StoredField], out: str | Path | None, resume: bool, threads: int,
    client: Any, progress: Progress,
) -> xarray.Dataset:
    """Return the result of a study, in memory or in the store ``out``; see ``run_study``."""
    attributes = _attributes(study, fields)
    if out is None:
        if resume:
            raise InputError("resume goes on with a store; give out.")
        memory = MemorySink(study, fields)
        try:
            _compute(study, fields, set(), memory, threads, client, progress, path=None)
        except Stopped as stopped:  # the cells so far are not lost
            stopped.dataset = memory.dataset(attributes)
            raise
        _warn_of_failures(count_of_each(memory.arrays[STATUS]))
        return memory.dataset(attributes)
    path = new_store_path(out, _AS_FILE)
    # one process at a time writes a store; finished tiles are not computed again
    with writer_lock(path):
        with storage_errors(path, CURE):
            _prepare(study, fields, path, attributes, resume)
        _compute(study, fields, done_tiles(path), StoreSink(path.absolute()), threads, client,
                 progress, path)
        with storage_errors(path, CURE):
            remove_parts(path)
    _warn_of_failures(count_statuses(study, path))
    return load_sweep(path)


def _warn_of_failures(statuses: Mapping[int, int]) -> None:
    """Warn of the cells of a complete sweep that failed, with their number for each reason."""
    failures = {status: count for status, count in statuses.items() if status != 0}
    if failures:
        reasons = ", ".join(f"{count:,} with status {status} ({meanings()[status]})"
                            for status, count in sorted(failures.items()))
        warn(f"{sum(failures.values()):,} of {count_text(sum(statuses.values()), 'cell')} of the "
             "sweep failed "
             f"and are NaN: {reasons}. The result's status has the reason of each cell.")


def _warn_of_fast_rotation(study: Study) -> None:
    """Warn of the largest |Ω Δt| of a body at the start of any cell, if it is too large."""
    rotations: list[FastestRotation] = []
    for tile in tiles_of(study):
        cells = cells_of(study, tile)
        for scheme, stepper in enumerate(study.steppers):
            group = np.flatnonzero(cells.scheme == scheme)
            if not len(group) or not stepper.rotations.bodies:
                continue
            fastest = stepper.rotations.fastest(
                {name: x[group] for name, x in cells.parameters.items()},
                compute_tile.first_steps(study, stepper, cells, group), cells.q[group],
                cells.p[group])
            if fastest is not None:
                rotations.append(fastest)
    if rotations:  # one warning, of the cell that is most beyond its limit
        max(rotations, key=lambda rotation: rotation.radians / rotation.limit).warn()


def _prepare(
    study: Study, fields: list[StoredField], path: Path, attributes: dict[str, Any], resume: bool
) -> None:
    """Create the store, or check that the existing one belongs to this study.

    ``attributes`` go into a new store; an existing one may differ in those that are not the
    study's.
    """
    if is_new(path, resume, "sweep"):
        with created_atomically(path) as fresh:
            create_store(fresh, study, fields, attributes)
        return
    try:
        stored_attributes = attributes_of(open_group(path))["sweep"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise StorageError(f"{str(path)!r} is no sweep that gyrospark stored, or damaged; choose "
                           "another store.") from error
    refuse_if_different(stored_attributes, attributes["sweep"], f"The store {str(path)!r}")
    remove_parts(path)


def _compute(
    study: Study, fields: list[StoredField], finished: set[tuple[int, ...]], sink: Sink,
    threads: int, client: Any, progress: Progress, path: Path | None,
) -> None:
    """Compute the tiles that are not ``finished`` and write them to the sink.

    They run on ``threads`` of this machine, or by the Dask client of a cluster; ``path`` is where
    the store is, None in memory. Raises Stopped after a signal.
    """
    is_stored = path is not None  # tiles of a store are larger
    cells = sum(_size(tile) for tile in tiles_of(study, is_stored) if tile.place in finished)
    remaining_tiles = (tile for tile in tiles_of(study, is_stored) if tile.place not in finished)
    work = f"sweeping {count_text(study.size, 'cell')}"
    with (log_progress(work, study.size, progress) as report,
          catch_signals() if is_stored else catch_ctrl_c() as interrupts):
        progress_count = _CellCount(cells, study.size, report)
        progress_count.tell()
        if client is None:
            compute_tile.run_tiles(study, fields, remaining_tiles, sink, threads, interrupts,
                                   progress_count.add)
        else:
            cluster.run_tiles(study, fields, remaining_tiles, sink, client, interrupts,
                              progress_count.add)
    if interrupts.is_requested:
        raise Stopped(_interruption_text(progress_count, path), interrupts.signal)


def _interruption_text(progress_count: _CellCount, path: Path | None) -> str:
    """Return the message of the error of a sweep that a signal has interrupted."""
    where = ".dataset" if path is None else repr(str(path))
    if progress_count.done == progress_count.all:
        return (f"Stopped after the last of {count_text(progress_count.all, 'cell')}: the sweep is "
                "complete, "
                f"in {where}.")
    hint = "" if path is None else " The same command with --resume goes on."
    return (f"Stopped with {progress_count.done:,} of {count_text(progress_count.all, 'cell')} "
            "done; they are "
            f"in {where}.{hint}")


class _CellCount:
    """The number of finished cells, reported after each tile."""

    def __init__(self, done: int, everything: int, progress: Callable[..., Any] | None) -> None:
        self.done, self.all, self._progress = done, everything, progress

    def add(self, tile: Tile) -> None:
        """Add the cells of a finished tile."""
        self.done += _size(tile)
        self.tell()

    def tell(self) -> None:
        """Report the number of finished cells."""
        if self._progress is not None:
            self._progress(self.done, self.all)


def _size(tile: Tile) -> int:
    """Return the number of cells of a tile."""
    return int(np.prod(tile.shape, dtype=np.int64))


def _attributes(study: Study, fields: list[StoredField]) -> dict[str, Any]:
    """Return the attributes of a result; ``sweep`` is compared before a sweep is resumed."""
    return {
        "title": study.name,
        # all that decides the bits of a cell
        "sweep": {
            "format": FORMAT,
            "gyrospark": __version__,
            "steppers": {s.name: s._provenance for s in study.steppers},
            "axes": {axis.name: {name: _digest(values) for name, values in axis.columns.items()}
                     | ({"labels": list(axis.labels)} if axis.labels else {})
                     for axis in study.axes},
            "shape": list(study.shape),
            "tile": list(tile_shape(study)),
            "parameters": {name: number for name, number in study.parameters.items()
                           if not study.has_axis(name)},
            **({"means": {name: rule.name for name, rule in study.means.items()}}
               if study.means else {}),
            "q": None if study.has_axis("q") else [digits_of(x) for x in study.q],
            "p": None if study.has_axis("p") else [digits_of(x) for x in study.p],
            study.step_name: None if study.has_axis(study.step_name) else study.dt,
            "steps": study.steps, "t_end": study.t_end, "every": study.every,
            "t0": study.t0, "solver": study.solver, "tolerance": study.tolerance,
            "max_iterations": study.max_iterations, "results": [f.name for f in fields],
        } | _events(study),
        "seed": study.seed,
        "versions": versions(),
        "manifests": {s.name: s.manifest.as_json() for s in study.steppers},
    }


def _events(study: Study) -> dict[str, Any]:
    """Return the events as JSON, {} without events, as in earlier stores."""
    return {"events": {event.name: [event.quantity, str(exact(event.level)), event.direction]
                       for event in study.events}} if study.events else {}


def _digest(values: Any) -> str:
    """Return a digest of an axis' values, equal for equal bytes, by which a resumed sweep is
    compared."""
    plain = as_bytes(np.asarray(values))
    return hashlib.sha256(plain.tobytes()).hexdigest()[:32]
