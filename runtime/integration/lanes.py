"""The stored states of an ensemble, and their integration batch by batch.

Where there is a fast path, the trajectories of a batch lie side by side in the lanes of vector
registers; else each is integrated by itself.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from functools import partial
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..bindings.array_checks import as_positive_count
from ..bindings.binding import Binding
from ..bindings.compiled_module import CORES
from .run_arguments import EnsembleArguments, RunArguments
from .step_loop import FIRST_STEPS, ChunkSize, Rows, fill, next_chunk, thin

if TYPE_CHECKING:
    from ..events.detection import EventDetector
    from ..steppers.evaluation import Evaluation

__all__ = ["EnsembleStates", "fill_ensemble", "threads_of"]

Array = NDArray[Any]

#: Coordinates in all steps up to which a run takes less time than the start of threads.
_FEW_NUMBERS = 2**14
#: Seconds between two numbers of stored states that are reported.
_REPORTED = 0.5
#: Batches of short runs that are integrated in one call.
_TOGETHER = 16


@dataclass(frozen=True)
class EnsembleStates:
    """The stored states of many runs, row 0 the start, their ends, records and statuses.

    multipliers and iterations have a row 0 too, of no meaning: compiled code takes one distance
    from a trajectory to the next.
    """

    binding: Binding
    runs: EnsembleArguments
    #: Whether batches lie in lanes, and how many trajectories are a batch.
    in_lanes: bool
    batch: int
    rows: Rows
    q: Array
    p: Array
    status: Array
    #: The running records of each batch.
    reports: list[Any]
    #: The parameters of all and their time steps, as compiled code takes those of lanes.
    parameters: Array
    dt: Array
    #: What looks at every state for events, one for each trajectory; or none.
    detectors: tuple[EventDetector, ...] = ()

    @classmethod
    def of(
        cls, stepper: Evaluation, runs: EnsembleArguments, detectors: Sequence[EventDetector] = ()
    ) -> EnsembleStates:
        """Return room for runs, at their start."""
        count, rows, binding = len(runs), runs.first.rows + 1, stepper.binding
        in_lanes = binding.lanes > 0 and runs.first.solver in ("auto", "fixed-point")
        if in_lanes:
            binding = stepper._binding_of_many
        batch = binding.lanes * (
            1 if detectors else _batches_in_a_call(binding, runs.first)) if in_lanes else 1
        reports = [binding.reports(min(batch, count - i)) for i in range(0, count, batch)
                   ] if in_lanes else [binding.report() for _ in range(count)]
        found = cls(
            binding, runs, in_lanes, batch,
            Rows(binding.new(count, rows, binding.n), binding.new(count, rows, binding.n),
                 binding.new(count, rows, binding.multipliers),
                 np.zeros((count, rows), dtype=np.intc), binding.new(count, rows)),
            runs.q.copy(), runs.p.copy(), np.zeros(count, dtype=np.intc),
            reports, binding.parameter_rows(runs.parameters, runs.t0) if in_lanes else runs.dt,
            runs.dt.astype(binding.dtype), tuple(detectors))
        found.rows.q[:, 0], found.rows.p[:, 0] = runs.q, runs.p
        return found

    def report(self, i: int) -> Any:
        """Return the running record of a trajectory."""
        return self.reports[i // self.batch][i % self.batch] if self.in_lanes else self.reports[i]

    def final_report(self, i: int) -> Any:
        """Return the record of a trajectory that has ended; it owns its memory."""
        report = self.report(i)
        return self.binding.copy_of(report) if self.in_lanes else report

    @property
    def stored(self) -> list[int]:
        """The stored states of each trajectory, its start among them; once all are done."""
        done = [int(self.report(i).steps) for i in range(len(self.runs))]
        rows = {steps: self.runs.first.stored(steps) + 1 for steps in set(done)}
        return [rows[steps] for steps in done]

    def rows_of(self, i: int) -> Rows:
        """Return the stored states of a trajectory."""
        rows = self.rows
        return Rows(rows.q[i], rows.p[i], rows.multipliers[i, 1:], rows.iterations[i, 1:],
                    rows.work[i])

    def fill(self, batches: Iterable[int], stop: Callable[[], bool]) -> None:
        """Integrate the trajectories of some batches in this thread, until they shall stop.

        One that fails ends there; the others are not touched.
        """
        memory = self.binding.batches.take() if self.in_lanes else None
        for batch in batches:
            if self.in_lanes:
                self._fill_lanes(batch, memory, stop)
            else:
                self._fill_one(batch, stop)
        if self.in_lanes:
            self.binding.batches.give_back(memory)

    def _fill_one(self, i: int, stop: Callable[[], bool]) -> None:
        detector = self.detectors[i] if self.detectors else None
        run = replace(self.runs[i], detector=detector)
        self.status[i] = fill(self.binding, run, self.rows_of(i), self.q[i], self.p[i],
                              self.report(i), stop)

    def _fill_lanes(self, batch: int, memory: Any, stop: Callable[[], bool]) -> None:
        binding, first, reports = self.binding, self.runs.first, self.reports[batch]
        part = slice(batch * self.batch, (batch + 1) * self.batch)
        rows, status, q, p = self.rows, self.status[part], self.q[part], self.p[part]
        out = (rows.q[part], rows.p[part], rows.multipliers[part], rows.iterations[part],
               rows.work[part])
        dt, parameters = self.dt[part], binding.sets_of(self.parameters[part])
        inputs = None if self.runs.inputs is None else self.runs.inputs.between(part)
        options = binding.options(first.tolerance, first.max_iterations, first.solver)
        iterations, done, pace = rows.iterations[part], 0, ChunkSize()
        while done < first.steps and not status.all() and not stop():
            row = done // first.every + 1
            count, every = next_chunk(first, done, pace.begin(first.steps - done))
            most = iterations[:, row].copy()  # of the pieces before, where a row takes several
            step_on = partial(_lanes, binding, parameters, options, dt, count, reports, status,
                              memory, inputs)
            if self.detectors:
                self._look(part, done, count, every, row, out, reports, step_on)
            else:
                step_on(every, row, q, p, out)
            np.maximum(iterations[:, row], most, out=iterations[:, row])
            done += count
            pace.end(count)

    def _look(
        self, part: slice, done: int, count: int, every: int, row: int, out: tuple[Array, ...],
        reports: Any, step_on: Callable[..., None],
    ) -> None:
        """Take so many steps, look at each of them, and store every ``every``-th."""
        binding, q, p = self.binding, self.q[part], self.p[part]
        size = len(q)
        room = size, count + 1
        seen = Rows(binding.new(*room, binding.n), binding.new(*room, binding.n),
                    binding.new(*room, binding.multipliers), np.zeros(room, dtype=np.intc),
                    binding.new(*room))
        seen.q[:, 0], seen.p[:, 0] = q, p
        step_on(1, 1, q, p, (seen.q, seen.p, seen.multipliers, seen.iterations, seen.work))
        for i, detector in enumerate(self.detectors[part]):
            steps = int(reports[i].steps) - done
            if steps <= 0:
                continue
            detector.detect(done, seen.q[i, : steps + 1], seen.p[i, : steps + 1])
            own = tuple(part[i, 1:] for part in vars(seen).values())
            thin(own, steps, every, tuple(array[i, row:] for array in out))


def _batches_in_a_call(binding: Binding, first: RunArguments) -> int:
    """Return how many batches compiled code may integrate in one call, which takes all steps."""
    short = first.steps <= FIRST_STEPS and (
        first.every >= first.steps or first.steps % first.every == 0)
    return _TOGETHER if short and binding.dtype is not object else 1


def _lanes(
    binding: Binding, parameters: Any, options: Any, dt: Array, count: int, reports: Any,
    status: Array, memory: Any, inputs: Any, every: int, row: int, q: Array, p: Array,
    out: tuple[Array, ...],
) -> None:
    """Take a batch on by so many steps; where to store comes last."""
    binding.integrate_lanes(parameters, options, dt, count, every, row, q, p, out, reports, status,
                            memory, inputs)


def threads_of(workers: int | None) -> int:
    """Return on how many threads to run: all cores, where a caller does not say."""
    return CORES if workers is None else as_positive_count("workers", workers, least=1)


def fill_ensemble(
    computed: EnsembleStates, threads: int, stop: Callable[[], bool],
    report: Callable[[int], Any] | None = None,
) -> None:
    """Integrate all batches: each thread takes the next one until there is none.

    Where threads would cost more than they gain, the calling one takes all. It calls ``report``
    with the number of states that are stored.
    """
    workers, first = min(threads, len(computed.reports)), computed.runs.first
    if workers == 1 or len(computed.runs) * first.steps * computed.binding.n < _FEW_NUMBERS:
        def stop_and_report() -> bool:
            if report is not None:
                report(sum(computed.stored))
            return stop()

        return computed.fill(range(len(computed.reports)), stop_and_report)
    batches, broken = SimpleQueue[int | None](), threading.Event()
    for batch in (*range(len(computed.reports)), *[None] * workers):
        batches.put(batch)

    def work() -> None:
        computed.fill(iter(batches.get, None), lambda: broken.is_set() or stop())

    with ThreadPoolExecutor(workers) as pool:
        futures = [pool.submit(work) for _ in range(workers)]
        try:
            running = set(futures)
            while running:
                ended, running = wait(running, None if report is None else _REPORTED,
                                      FIRST_EXCEPTION)
                for future in ended:
                    future.result()
                if report is not None:
                    report(sum(computed.stored))
        finally:  # where memory ran out, say, the others are not finished for nobody
            broken.set()
