"""The stored states of an ensemble, and their integration batch by batch.

Where there is a fast path, the trajectories of a batch lie side by side in the lanes of vector
registers; else each is integrated by itself.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from functools import partial
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arrays import Array
from ...core.records import dataclass
from ..bindings.array_checks import as_positive_count
from ..bindings.binding import Binding
from ..bindings.compiled_module import CORES
from ..bindings.run_memory import BatchMemory, BatchState, Rows, RunConstants, RunRecord, RunState
from .run_arguments import EnsembleArguments, RunArguments
from .step_loop import FIRST_STEPS, ChunkSize, advance_and_detect, fill, next_chunk, thin

if TYPE_CHECKING:
    from ..events.detection import EventDetector
    from ..steppers.evaluation import Evaluation

__all__ = ["EnsembleStates", "fill_ensemble", "threads_of"]

#: Coordinates in all steps up to which a run takes less time than the start of threads.
_FEW_NUMBERS = 2**14
#: Seconds between two numbers of steps that are reported.
_REPORTED = 0.5
#: Batches of short runs that are integrated in one call.
_TOGETHER = 16


@dataclass(frozen=True)
class EnsembleStates:
    """The stored states of many runs, their ends, records and statuses.

    Axes of ``rows`` are (run, stored state, ...); q and p, (runs, n), are the last states, and
    ``status``, (runs,), is 0 for a run that has not failed.
    """

    binding: Binding
    runs: EnsembleArguments
    #: Whether batches lie in lanes, and the number of trajectories in a batch.
    in_lanes: bool
    batch: int
    rows: Rows
    q: Array
    p: Array
    status: Array
    #: The running records of each batch.
    reports: list[Any]
    #: The parameters of all runs, as compiled code takes them in lanes; not used off lanes.
    parameters: Array
    #: The time step of each run.
    dt: Array
    #: Event detectors, one for each trajectory; or none.
    detectors: tuple[EventDetector, ...] = ()

    @classmethod
    def at_start(
        cls, stepper: Evaluation, runs: EnsembleArguments, detectors: Sequence[EventDetector] = ()
    ) -> EnsembleStates:
        """Return the runs at their start, with memory for all their stored states."""
        count, rows, binding = len(runs), runs.first.rows + 1, stepper.binding
        in_lanes = binding.lanes > 0 and runs.first.solver in ("auto", "fixed-point")
        if in_lanes:
            binding = stepper._binding_of_many
        reports: list[Any]
        if in_lanes:
            # detectors read the states of a batch after each call: with them a call has one batch
            batch = binding.lanes * (1 if detectors else _batches_in_a_call(binding, runs.first))
            reports = [binding.reports(min(batch, count - i)) for i in range(0, count, batch)]
            parameters = binding.parameter_rows(runs.parameters, runs.t0)
        else:
            batch, parameters = 1, runs.dt  # any array: runs off lanes have their own parameters
            reports = [binding.report() for _ in range(count)]
        states = cls(binding, runs, in_lanes, batch, rows=Rows.allocate(binding, count, rows),
                     q=runs.q.copy(), p=runs.p.copy(), status=np.zeros(count, dtype=np.intc),
                     reports=reports, parameters=parameters, dt=runs.dt.astype(binding.dtype),
                     detectors=tuple(detectors))
        states.rows.q[:, 0], states.rows.p[:, 0] = runs.q, runs.p
        return states

    def report(self, i: int) -> RunRecord:
        """Return the running record of a trajectory."""
        record: RunRecord = (self.reports[i // self.batch][i % self.batch] if self.in_lanes
                             else self.reports[i])
        return record

    def final_report(self, i: int) -> RunRecord:
        """Return the record of a trajectory that has ended; it owns its memory."""
        report = self.report(i)
        return self.binding.copy_of(report) if self.in_lanes else report

    @property
    def row_counts(self) -> list[int]:
        """Number of stored states of each trajectory, with its start; once all are done."""
        step_counts = [int(self.report(i).steps) for i in range(len(self.runs))]
        rows = {steps: self.runs.first.rows_after(steps) + 1 for steps in set(step_counts)}
        return [rows[steps] for steps in step_counts]

    @property
    def steps_done(self) -> int:
        """Sum of the completed steps of all trajectories."""
        return sum(int(self.report(i).steps) for i in range(len(self.runs)))

    def fill(self, batches: Iterable[int], stop: Callable[[], bool]) -> None:
        """Integrate the trajectories of ``batches`` in this thread, until ``stop()`` is true.

        One that fails ends there; the others are not touched.
        """
        if not self.in_lanes:
            for i in batches:
                self._fill_run(i, stop)
            return
        memory = self.binding.batches.take()
        for batch in batches:
            self._fill_lanes(batch, memory, stop)
        self.binding.batches.give_back(memory)

    def _fill_run(self, i: int, stop: Callable[[], bool]) -> None:
        """Integrate run i alone, on plain numbers."""
        binding, run = self.binding, self.runs[i]
        state = RunState(self.q[i], self.p[i], self.report(i), binding.works.take())
        step_on = (partial(advance_and_detect, self.detectors[i], binding) if self.detectors
                   else None)
        self.status[i], _ = fill(binding, run, run.constants(binding), self.rows[i],
                                 state, stop, step_on=step_on)
        binding.works.give_back(state.work)

    def _fill_lanes(self, batch: int, memory: BatchMemory, stop: Callable[[], bool]) -> None:
        """Integrate a batch of runs, one a lane, in pieces until all have ended or ``stop()``."""
        binding, first = self.binding, self.runs.first
        lanes = slice(batch * self.batch, (batch + 1) * self.batch)
        rows, state = self.rows[lanes], BatchState(
            self.q[lanes], self.p[lanes], self.reports[batch], self.status[lanes])
        constants = RunConstants(
            binding.sets_of(self.parameters[lanes]),
            binding.options(first.tolerance, first.max_iterations, first.solver), self.dt[lanes],
            None if self.runs.inputs is None else self.runs.inputs.between(lanes))
        step_count, pace = 0, ChunkSize()
        while step_count < first.steps and not state.status.all() and not stop():
            row = step_count // first.every + 1
            count, every = next_chunk(first, step_count, pace.begin(first.steps - step_count))
            previous = rows.iterations[:, row].copy()  # of earlier pieces: a row may take several
            # events are sought in every state, also in those that are not stored
            if self.detectors:
                visited = Rows.allocate(binding, len(state.q), count + 1)
                visited.q[:, 0], visited.p[:, 0] = state.q, state.p
                binding.integrate_lanes(constants, count, every=1, batch=state, rows=visited,
                                        row=1, memory=memory)
                self._detect(lanes, step_count, every, visited, rows[:, row:])
            else:
                binding.integrate_lanes(constants, count, every, state, rows, row, memory)
            np.maximum(rows.iterations[:, row], previous, out=rows.iterations[:, row])
            step_count += count
            pace.end(count)

    def _detect(self, lanes: slice, first_step: int, every: int, visited: Rows, rows: Rows) -> None:
        """Give the states of a batch to their detectors; copy every ``every``-th to ``rows``."""
        for i, detector in enumerate(self.detectors[lanes]):
            count = int(self.report(lanes.start + i).steps) - first_step
            # a trajectory that has failed takes no more steps
            if count > 0:
                detector.detect(first_step, visited.q[i, : count + 1], visited.p[i, : count + 1])
                thin(visited[i, 1:], count, every, rows[i])


def _batches_in_a_call(binding: Binding, first: RunArguments) -> int:
    """Return how many batches compiled code may integrate in one call, which takes all steps.

    Several for short runs alone, since signals do not interrupt a call. Their last step must be
    stored, as all others at multiples of ``every``.
    """
    short = first.steps <= FIRST_STEPS and (
        first.every >= first.steps or first.steps % first.every == 0)
    return _TOGETHER if short and binding.dtype is not object else 1


def threads_of(workers: int | None) -> int:
    """Return on how many threads to run: all cores, where a caller does not say."""
    return CORES if workers is None else as_positive_count("workers", workers, minimum=1)


def fill_ensemble(
    states: EnsembleStates, threads: int, stop: Callable[[], bool],
    report: Callable[[int], Any] | None = None,
) -> None:
    """Integrate all batches, which fills their rows.

    Where threads would cost more than they gain, the calling thread takes all batches. ``report``
    is called in it, with the sum of the steps of all runs so far.
    """
    # no more threads than batches
    workers, first = min(threads, len(states.reports)), states.runs.first
    if workers == 1 or len(states.runs) * first.steps * states.binding.n < _FEW_NUMBERS:
        _fill_here(states, stop, report)
    else:
        _fill_on_threads(states, workers, stop, report)


def _fill_here(
    states: EnsembleStates, stop: Callable[[], bool], report: Callable[[int], Any] | None
) -> None:
    """Integrate all batches on the calling thread; see ``fill_ensemble``."""
    def stop_and_report() -> bool:
        """Report the steps so far, and return whether to stop."""
        if report is not None:
            report(states.steps_done)
        return stop()

    states.fill(range(len(states.reports)), stop_and_report)
    if report is not None:
        report(states.steps_done)


def _fill_on_threads(
    states: EnsembleStates, workers: int, stop: Callable[[], bool],
    report: Callable[[int], Any] | None,
) -> None:
    """Integrate all batches on some threads, each of which takes the next one in turn."""
    batches, is_stopped = SimpleQueue[int | None](), threading.Event()
    # after the batches one None for each thread, which ends it
    for batch in (*range(len(states.reports)), *[None] * workers):
        batches.put(batch)

    def work() -> None:
        """Take batches from the queue until it gives None."""
        states.fill(iter(batches.get, None), lambda: is_stopped.is_set() or stop())

    with ThreadPoolExecutor(workers) as pool:
        futures = [pool.submit(work) for _ in range(workers)]
        try:
            running = set(futures)
            while running:
                ended, running = wait(running, timeout=None if report is None else _REPORTED,
                                      return_when=FIRST_EXCEPTION)
                for future in ended:
                    future.result()
                if report is not None:
                    report(states.steps_done)
        finally:  # after an error, such as full memory, the other threads stop too
            is_stopped.set()
