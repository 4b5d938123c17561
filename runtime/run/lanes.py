"""Trajectories side by side in the lanes of a vector register, by compiled code."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import StepFailed
from ..call.binding import Binding
from ..output.trajectory import Trajectory
from .failure import Diagnosis
from .integration import Pace, Rows, Run, failure_of, next_chunk, trajectory_of

__all__ = ["Member", "integrate_lanes"]

Array = NDArray[Any]
Member = tuple[Trajectory, StepFailed | None]


@dataclass(frozen=True)
class _Batch:
    """What compiled code fills for the trajectories of one batch, which have equal steps."""

    q: Array
    p: Array
    multipliers: Array
    iterations: Array
    work: Array

    @classmethod
    def room(cls, binding: Binding, runs: list[Run]) -> _Batch:
        count, rows = len(runs), runs[0].rows
        return cls(
            binding.new(count, rows, binding.n),
            binding.new(count, rows, binding.n),
            binding.new(count, rows, binding.multipliers),
            np.zeros((count, rows), dtype=np.intc),
            binding.new(count, rows),
        )

    @property
    def out(self) -> tuple[Array, ...]:
        return self.q, self.p, self.multipliers, self.iterations, self.work

    def rows_of(self, member: int, run: Run) -> Rows:
        """Return the stored states of one trajectory, its start in front."""
        return Rows(
            np.concatenate([run.q[None], self.q[member]]),
            np.concatenate([run.p[None], self.p[member]]),
            self.multipliers[member],
            self.iterations[member],
            np.concatenate([0 * run.q[:1], self.work[member]]),
        )


def integrate_lanes(
    binding: Binding, manifest: dict[str, Any], runs: list[Run], stop: Callable[[], bool]
) -> list[Member]:
    """Integrate at most ``binding.lanes`` runs, equal in steps, every, solver and tolerance.

    A run that fails ends there with its ``StepFailed``; the others are not touched. All end early
    when they shall ``stop``.
    """
    first = runs[0]
    batch = _Batch.room(binding, runs)
    q, p = (np.array([getattr(run, x) for run in runs]) for x in "qp")
    dt = np.array([run.dt for run in runs], dtype=binding.dtype)
    status, reports = np.zeros(len(runs), dtype=np.intc), binding.reports(len(runs))
    parameters = binding.parameter_sets([run.parameters for run in runs],
                                        [run.t0 for run in runs])
    options = binding.options(first.tolerance, first.max_iterations, first.solver)
    memory, done, pace = binding.batch_memory(), 0, Pace()
    while done < first.steps and not status.all() and not stop():
        row = done // first.every
        count, every = next_chunk(first, done, pace.begin())
        most = batch.iterations[:, row].copy()  # of the pieces before, where a row takes several
        binding.integrate_lanes(parameters, options, dt, count, every, row, q, p, batch.out,
                                reports, status, memory)
        np.maximum(batch.iterations[:, row], most, out=batch.iterations[:, row])
        done += count
        pace.end(count)
    return [
        _member(binding, manifest, run, batch.rows_of(i, run), reports[i], q[i], p[i],
                int(status[i]))
        for i, run in enumerate(runs)
    ]


def _member(
    binding: Binding, manifest: dict[str, Any], run: Run, rows: Rows, report: Any, q: Array,
    p: Array, status: int,
) -> Member:
    trajectory = trajectory_of(binding, manifest, run, rows, report, q, p,
                               binding.parameters(run.parameters, run.t0))
    return trajectory, failure_of(run, trajectory, Diagnosis.bare(status)) if status else None
