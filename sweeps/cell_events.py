"""Events of cells: the runs of an ensemble with event detection after each step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..runtime.events.detection import Levels
from ..runtime.events.location import crossings_of, detectors_for
from ..runtime.integration.lanes import EnsembleStates
from ..runtime.integration.run_arguments import EnsembleArguments, RunArguments
from ..runtime.steppers.stepper import Stepper
from .study import Study
from .tiles import Cells

__all__ = ["CellEnds", "count_of", "first_of", "watched"]

Array = NDArray[Any]


@dataclass(frozen=True)
class CellEnds:
    """How cells end, their samples with the start, and what was found of their events."""

    q: Array
    p: Array
    reports: Array
    status: Array
    samples: tuple[Array, ...]
    found: dict[str, Array]


def first_of(event: str) -> str:
    """Return the name of the result with the time of the first event in a cell."""
    return f"event_{event}_first"


def count_of(event: str) -> str:
    """Return the name of the result with the number of events."""
    return f"event_{event}_count"


def watched(study: Study, stepper: Stepper, steps: int, cells: Cells, group: Array) -> CellEnds:
    """Integrate some cells that have the scheme and the steps in common, and find their events.

    Bits are those of cells at which nobody looks. It runs on the caller's thread.
    """
    every = study.every or steps
    runs = _runs(study, stepper, steps, every, cells, group)
    levels = Levels.of(stepper.binding, stepper.manifest, study.events)
    computed = EnsembleStates.of(stepper, runs, detectors_for(stepper, levels, runs))
    _fill(computed)
    crossings = crossings_of(stepper, levels, runs,
                             [one.final_brackets() for one in computed.detectors], _fill)
    binding, rows = computed.binding, steps // every + 1
    found: dict[str, Array] = {}
    for event in study.events:
        own = [one[event.name] for one in crossings]
        found[first_of(event.name)] = np.array([float(one.t[0]) if len(one) else np.nan
                                                for one in own])
        found[count_of(event.name)] = np.array([len(one) for one in own], dtype=float)
    reports = np.concatenate([np.frombuffer(binding.ffi.buffer(one), dtype=binding.report_type)
                              for one in computed.reports])
    samples = computed.rows.q[:, :rows], computed.rows.p[:, :rows]
    return CellEnds(computed.q, computed.p, reports, computed.status, samples, found)


def _fill(computed: EnsembleStates) -> None:
    computed.fill(range(len(computed.reports)), lambda: False)


def _runs(
    study: Study, stepper: Stepper, steps: int, every: int, cells: Cells, group: Array
) -> EnsembleArguments:
    """Return the cells as runs, with numbers as a single run has them."""
    binding = stepper.binding

    def column(values: Any) -> Array:
        made: Array = np.array(values).astype(binding.number_type)
        return made

    q, p = (values[group].astype(binding.dtype) for values in (cells.q, cells.p))
    dt, t0 = column(cells.dt[group]), column(np.full(len(group), study.t0))
    parameters = {name: column(values[group]) for name, values in cells.parameters.items()}
    first = RunArguments(q[0], p[0], dt[0], steps, every,
                {name: values[0] for name, values in parameters.items()}, study.solver,
                study.tolerance, study.max_iterations, t0[0])
    return EnsembleArguments(first, q, p, dt, t0, parameters)
