"""What an ensemble's trajectories are stored in, and the code that fills it, batch by batch.

Where there is a fast path, the trajectories of a batch lie side by side in the lanes of vector
registers; else each is integrated by itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..call.binding import Binding
from ..steps.integration import Pace, Rows, fill, next_chunk
from .runs import Runs

__all__ = ["Course"]

Array = NDArray[Any]


@dataclass(frozen=True)
class Course:
    """The stored states of many runs, row 0 the start, their ends, records and statuses.

    multipliers and iterations have a row 0 too, of no meaning: compiled code takes one distance
    from a trajectory to the next.
    """

    binding: Binding
    runs: Runs
    #: Whether batches lie in lanes, and how many trajectories are a batch.
    in_lanes: bool
    batch: int
    rows: Rows
    q: Array
    p: Array
    status: Array
    #: The running records of each batch.
    reports: list[Any]

    @classmethod
    def of(cls, binding: Binding, runs: Runs) -> Course:
        """Return room for runs, at their start."""
        count, rows = len(runs), runs.first.rows + 1
        in_lanes = binding.lanes > 0 and runs.first.solver in ("auto", "fixed-point")
        batch = binding.lanes if in_lanes else 1
        reports = [binding.reports(min(batch, count - i)) for i in range(0, count, batch)
                   ] if in_lanes else [binding.report() for _ in range(count)]
        found = cls(
            binding, runs, in_lanes, batch,
            Rows(binding.new(count, rows, binding.n), binding.new(count, rows, binding.n),
                 binding.new(count, rows, binding.multipliers),
                 np.zeros((count, rows), dtype=np.intc), binding.new(count, rows)),
            runs.q.copy(), runs.p.copy(), np.zeros(count, dtype=np.intc),
            reports)
        found.rows.q[:, 0], found.rows.p[:, 0] = runs.q, runs.p
        return found

    def report(self, i: int) -> Any:
        """Return the running record of a trajectory."""
        return self.reports[i // self.batch][i % self.batch] if self.in_lanes else self.reports[i]

    @cached_property
    def stored(self) -> list[int]:
        """The stored states of each trajectory, its start among them; once all are done."""
        return [self.runs.first.stored(int(self.report(i).steps)) + 1
                for i in range(len(self.runs))]

    def rows_of(self, i: int) -> Rows:
        """Return the stored states of a trajectory."""
        rows = self.rows
        return Rows(rows.q[i], rows.p[i], rows.multipliers[i, 1:], rows.iterations[i, 1:],
                    rows.work[i])

    def memory(self) -> Any:
        """Return what one thread needs to fill batches."""
        return self.binding.batch_memory() if self.in_lanes else None

    def fill(self, batch: int, memory: Any, stop: Callable[[], bool]) -> None:
        """Integrate the trajectories of a batch, until they shall stop.

        One that fails ends there; the others are not touched.
        """
        if self.in_lanes:
            self._fill_lanes(batch, memory, stop)
        else:
            self._fill_one(batch, stop)

    def _fill_one(self, i: int, stop: Callable[[], bool]) -> None:
        self.status[i] = fill(self.binding, self.runs[i], self.rows_of(i), self.q[i], self.p[i],
                              self.report(i), stop)

    def _fill_lanes(self, batch: int, memory: Any, stop: Callable[[], bool]) -> None:
        binding, first, reports = self.binding, self.runs.first, self.reports[batch]
        part = slice(batch * self.batch, (batch + 1) * self.batch)
        rows, status, q, p = self.rows, self.status[part], self.q[part], self.p[part]
        out = (rows.q[part], rows.p[part], rows.multipliers[part], rows.iterations[part],
               rows.work[part])
        dt = self.runs.dt[part].astype(binding.dtype)
        parameters = binding.parameter_sets(self.runs.columns(part), self.runs.t0[part])
        inputs = None if self.runs.inputs is None else self.runs.inputs.between(part)
        options = binding.options(first.tolerance, first.max_iterations, first.solver)
        iterations, done, pace = rows.iterations[part], 0, Pace()
        while done < first.steps and not status.all() and not stop():
            row = done // first.every + 1
            count, every = next_chunk(first, done, pace.begin())
            most = iterations[:, row].copy()  # of the pieces before, where a row takes several
            binding.integrate_lanes(parameters, options, dt, count, every, row, q, p, out,
                                    reports, status, memory, inputs)
            np.maximum(iterations[:, row], most, out=iterations[:, row])
            done += count
            pace.end(count)
