"""Events of cells: the runs of an ensemble with event detection after each step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.arrays import Array
from ..core.errors import InputError
from ..runtime.bindings.binding import Binding
from ..runtime.events.detection import Levels
from ..runtime.events.location import crossings_of, detectors_for
from ..runtime.integration.lanes import EnsembleStates
from ..runtime.integration.run_arguments import EnsembleArguments, RunArguments
from ..runtime.results.crossings import Crossings
from ..runtime.steppers.stepper import Stepper
from .study import Study
from .tiles import Cells

__all__ = ["NOT_CONVERGED", "CellEnds", "count_of", "first_of", "run_with_events"]

#: The status of REASONS of a cell with an event that no part of a step leads to.
NOT_CONVERGED = 1


@dataclass(frozen=True)
class CellEnds:
    """The ends of cells, their samples with the start, and the results of their events."""

    q: Array
    p: Array
    reports: Array
    status: Array
    samples: tuple[Array, ...]
    event_results: dict[str, Array]


def first_of(event: str) -> str:
    """Return the name of the result with the time of the first event in a cell."""
    return f"event_{event}_first"


def count_of(event: str) -> str:
    """Return the name of the result with the number of events."""
    return f"event_{event}_count"


def run_with_events(study: Study, stepper: Stepper, steps: int, cells: Cells,
                    group: Array, q: Array, p: Array) -> CellEnds:
    """Integrate cells of equal scheme and number of steps from q and p, and locate their events.

    ``group`` has the indices of the cells, q and p have a row for each. Event detection does not
    change the bits of the states. It runs on the caller's thread. A cell with an event that is not
    located has the status NOT_CONVERGED.
    """
    every = study.every or steps  # without samples only the start and the end are stored
    runs = _runs(study, stepper, steps, every, cells, group, q, p)
    # a first run brackets the events between steps, a second one locates them in the brackets
    levels = Levels.of(stepper.binding, stepper.manifest, study.events)
    ensemble_states = EnsembleStates.at_start(stepper, runs, detectors_for(stepper, levels, runs))
    _fill(ensemble_states)
    try:
        crossings = crossings_of(
            stepper, levels, runs,
            [detector.final_brackets() for detector in ensemble_states.detectors], _fill)
    except InputError:  # a part of a step of some cell does not converge, though its steps did
        if len(group) > 1:
            half = len(group) // 2
            return _join([run_with_events(study, stepper, steps, cells, group[side], q[side],
                                          p[side])
                          for side in (slice(half), slice(half, None))])
        crossings = []  # one cell, whose results are NaN
        if not ensemble_states.status[0]:  # a cell that failed before keeps its reason
            ensemble_states.status[0] = NOT_CONVERGED
    binding, row_count = ensemble_states.binding, steps // every + 1
    reports = np.concatenate([np.frombuffer(binding.ffi.buffer(record), dtype=binding.report_type)
                              for record in ensemble_states.reports])
    samples = ensemble_states.rows.q[:, :row_count], ensemble_states.rows.p[:, :row_count]
    return CellEnds(ensemble_states.q, ensemble_states.p, reports, ensemble_states.status, samples,
                    _event_results(study, binding, crossings))


def _event_results(
    study: Study, binding: Binding, crossings: Sequence[Mapping[str, Crossings]]
) -> dict[str, Array]:
    """Return the first time and the number of crossings of each event, an entry for each cell.

    No ``crossings`` stand for one cell whose events are not located, with NaN.
    """
    results: dict[str, Array] = {}
    for event in study.events:
        cell_crossings = [run_crossings[event.name].shown(binding) for run_crossings in crossings]
        results[first_of(event.name)] = np.array(
            [float(cell.t[0]) if len(cell) else np.nan for cell in cell_crossings] or [np.nan])
        results[count_of(event.name)] = np.array(
            [float(len(cell)) for cell in cell_crossings] or [np.nan])
    return results


def _join(parts: list[CellEnds]) -> CellEnds:
    """Return the ends of several groups of cells as one group."""
    q, p, reports, status = (np.concatenate([getattr(group, name) for group in parts])
                             for name in ("q", "p", "reports", "status"))
    samples = tuple(map(np.concatenate, zip(*(group.samples for group in parts), strict=True)))
    return CellEnds(q, p, reports, status, samples, {
        name: np.concatenate([group.event_results[name] for group in parts])
        for name in parts[0].event_results})


def _fill(ensemble_states: EnsembleStates) -> None:
    """Integrate all runs of an ensemble on this thread; a tile is not interrupted."""
    ensemble_states.fill(range(len(ensemble_states.reports)), stop=lambda: False)


def _runs(
    study: Study, stepper: Stepper, steps: int, every: int, cells: Cells, group: Array, q: Array,
    p: Array,
) -> EnsembleArguments:
    """Return the cells with the indices ``group`` as runs, in the number type of single runs.

    q and p, shape (cells, n), are their starts; all take ``steps`` steps, every ``every``-th
    stored.
    """
    binding = stepper.binding

    def column(values: Any) -> Array:
        """Return a number for each cell in the type that runs take."""
        typed: Array = np.array(values).astype(binding.number_type)
        return typed

    q, p = (x.astype(binding.dtype) for x in (q, p))
    dt, t0 = column(cells.dt[group]), column(np.full(len(group), study.t0))
    parameters = {name: column(array[group]) for name, array in cells.parameters.items()}
    # the arguments that all runs share are read off the first one
    first_run = RunArguments(
        q[0], p[0], dt[0], steps, every, {name: array[0] for name, array in parameters.items()},
        solver=study.solver, tolerance=study.tolerance, max_iterations=study.max_iterations,
        t0=t0[0])
    return EnsembleArguments(first_run, q, p, dt, t0, parameters)
