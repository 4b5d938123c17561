"""One integration in chunks of compiled steps; an interrupted one returns its states."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...core.arguments import count_text
from ...core.arrays import Array
from ...core.errors import StepFailed, Stopped
from ...core.interrupts import Interrupts, catch_ctrl_c
from ...core.manifest import Manifest
from ..bindings.binding import Binding
from ..bindings.run_memory import Rows, RunConstants, RunRecord, RunState
from ..compilation.call_stack import thread_seconds
from ..results.diagnostics import Report
from ..results.outputs import States
from ..results.trajectory import Trajectory
from .failure import Diagnosis, diagnose
from .run_arguments import RunArguments

if TYPE_CHECKING:
    from ..events.detection import EventDetector
    from ..events.observer import Observer

__all__ = ["FIRST_STEPS", "ChunkSize", "advance_and_detect", "ended_at", "failure_of", "fill",
           "integrate", "march", "next_chunk", "require_end", "thin", "trajectory_of"]

#: Takes steps as ``Binding.integrate`` does.
StepOn = Callable[[RunConstants, int, int, RunState, Rows], int]

#: Steps of the first chunk, and of a chunk at most: between chunks signals and progress are polled.
FIRST_STEPS, _CHUNK = 16, 4096
#: Steps of a chunk at most, where events are sought in its states after it.
_CHUNK_WITH_EVENTS = 2**14
#: Seconds that a chunk takes, where a step does not take longer.
_CHUNK_SECONDS = 0.1
#: A single step is not interrupted: there are no states before it to return.
_WITHOUT_INTERRUPTS = nullcontext(Interrupts())


class ChunkSize:
    """Number of steps that compiled code takes between two polls of signals: some 0.1 s of them.

    The time is CPU time of this thread, unless there is another ``clock``: load of the machine
    changes nothing.
    """

    def __init__(
        self, has_events: bool = False, clock: Callable[[], float] | None = None,
        first: int = FIRST_STEPS,
    ) -> None:
        """Begin with ``first`` steps; the largest chunk is smaller with events."""
        self._clock = clock or thread_seconds
        self._largest = _CHUNK_WITH_EVENTS if has_events else _CHUNK
        self.most = min(first, self._largest)
        self._began: float | None = None

    def begin(self, remaining: int | None = None) -> int:
        """Return the largest number of steps of the next chunk, and start the clock.

        The clock does not run for the last chunk, which no other one follows.
        """
        self._began = None if remaining is not None and remaining <= self.most else self._clock()
        return self.most

    def end(self, steps: int) -> None:
        """Estimate the time of the next steps from the time of the last ``steps`` steps."""
        if self._began is None:
            return
        seconds = self._clock() - self._began
        if seconds > _CHUNK_SECONDS:
            self.most = max(1, int(steps * _CHUNK_SECONDS / seconds))
        # a chunk of whole multiples of ``every`` may have taken fewer steps than it might have:
        # twice the time for ``most`` steps, so that a chunk eight times as long still fits
        elif 2 * steps > self.most and seconds < _CHUNK_SECONDS / 2:
            factor = 8 if seconds < _CHUNK_SECONDS / 16 else 2
            self.most = min(factor * self.most, self._largest)


def integrate(
    binding: Binding, manifest: Manifest, run: RunArguments,
    progress: Callable[[int], None] | None = None, observer: Observer | None = None,
    constants: RunConstants | None = None, pace: ChunkSize | None = None
) -> Trajectory:
    """Return the trajectory of a run, up to the terminal event that its observer finds.

    ``constants`` are the run's, computed here where a caller has none. ``pace`` has the size of the
    first chunk, and afterwards of the next one.

    Raises
    ------
    StepFailed
        With the states before the failed step, and the reasons that were found.
    Stopped
        After Ctrl-C, with everything computed until then.
    """
    with catch_ctrl_c() if run.steps > 1 else _WITHOUT_INTERRUPTS as interrupts:
        trajectory, status, state = march(
            binding, manifest, run, stop=lambda: interrupts.is_requested, progress=progress,
            observer=observer, constants=constants, pace=pace)
    return require_end(binding, manifest, run, trajectory, status, state, interrupts)


def require_end(
    binding: Binding, manifest: Manifest, run: RunArguments, trajectory: Trajectory, status: int,
    state: RunState, interrupts: Interrupts,
) -> Trajectory:
    """Return a trajectory that came to its end, or raise StepFailed or Stopped.

    ``status`` is the C's, 0 for success; ``state`` the last state, from which a step failed.
    """
    if status:
        report = trajectory.report
        diagnosis = diagnose(binding, manifest, run.at_step(report.steps), status, state.q, state.p,
                             run.t0 + report.steps * run.dt)
        raise failure_of(binding, run, trajectory, diagnosis, state.q)
    if interrupts.is_requested:
        raise Stopped(f"{ended_at(trajectory.report.steps, run.steps)} The states are in "
                      ".trajectory.", interrupts.signal, trajectory=trajectory)
    return trajectory


def ended_at(step: int, steps: int) -> str:
    """Return a sentence that says after which step a signal has ended a run."""
    if step == steps:
        return f"Stopped after the last of {count_text(steps, 'step')}: the run is complete."
    return f"Stopped at step {step:,} of {steps:,}."


class MarchedRun(NamedTuple):
    """A run up to its end, to a step that fails or to a stop."""

    trajectory: Trajectory
    status: int  # 0, or the C's of a failed step
    state: RunState  # the last one


def march(
    binding: Binding, manifest: Manifest, run: RunArguments, stop: Callable[[], bool],
    progress: Callable[[int], None] | None = None, observer: Observer | None = None,
    constants: RunConstants | None = None, pace: ChunkSize | None = None,
) -> MarchedRun:
    """Integrate up to the end of a run, to a step that fails, to the event that ends it, or until
    ``stop()`` is true, which is called between chunks.
    """
    pace = pace or ChunkSize(has_events=observer is not None)
    constants = constants or run.constants(binding)
    # arrays of float128 hold Python objects, which ``integrate_short`` does not take
    is_one_chunk = (observer is None and progress is None and run.stored_steps is None
                    and 0 < run.steps <= pace.most and not run.steps % run.every
                    and binding.dtype is not object)
    if is_one_chunk and not stop():
        return _march_one_chunk(binding, manifest, run, constants, pace)
    # how many steps an open end takes is not known: ``fill`` makes room as they come
    rows = Rows.allocate(binding, FIRST_STEPS if run.open_end else run.rows + 1)
    rows.q[0], rows.p[0] = run.q, run.p
    state = RunState.at_start(binding, run.q, run.p, binding.works.take())
    if observer is None:
        status, rows = fill(binding, run, constants, rows, state, stop, progress, pace=pace)
    else:
        status, rows = fill(binding, run, constants, rows, state,
                            lambda: observer.end is not None or stop(), progress,
                            step_on=observer.advance, pace=pace)
        observer.close(state)
        if observer.end is not None:  # a step that fails after the end is none of the run's
            status = 0
    binding.works.give_back(state.work)
    trajectory = trajectory_of(binding, manifest, run, lambda: rows, state.record, state.q,
                               state.p)
    return MarchedRun(trajectory, status, state)


def _march_one_chunk(
    binding: Binding, manifest: Manifest, run: RunArguments, constants: RunConstants,
    pace: ChunkSize,
) -> MarchedRun:
    """Integrate a short run without the bookkeeping of ``fill``, as it takes microseconds."""
    is_timed = run.steps > FIRST_STEPS  # for the first chunk of the next call
    pace.begin(remaining=None if is_timed else run.steps)
    status, state, read_rows = binding.integrate_short(
        constants, run.q, run.p, run.steps, run.every)
    pace.end(run.steps)
    trajectory = trajectory_of(binding, manifest, run, read_rows, state.record, state.q, state.p)
    return MarchedRun(trajectory, status, state)


def fill(
    binding: Binding, run: RunArguments, constants: RunConstants, rows: Rows, state: RunState,
    stop: Callable[[], bool], progress: Callable[[int], None] | None = None,
    step_on: StepOn | None = None, pace: ChunkSize | None = None,
) -> tuple[int, Rows]:
    """Fill the rows of a run from its start, as ``march`` does; return the status and the rows.

    The rows returned are new ones with more room where those given were too few. ``step_on`` is
    ``binding.integrate`` or takes its arguments, and observes each step.
    """
    pace, status = pace or ChunkSize(has_events=step_on is not None), 0
    # 0 steps initialise record and work memory, which the first steps otherwise do
    if not run.steps or step_on is not None or stop():
        status = binding.integrate(constants, steps=0, every=1, state=state, rows=rows[:0])
    step_on = step_on or binding.integrate
    while state.steps < run.steps and status == 0 and not stop():
        step_count = state.steps
        row = run.rows_after(step_count) + 1
        count, every = next_chunk(run, step_count, pace.begin(run.steps - step_count))
        if row + count // every > len(rows.iterations):
            # doubled, so that all copies together cost no more than the rows themselves
            rows = rows.with_room(binding, max(2 * row, row + count // every))
        previous = rows.iterations[row]  # of the pieces before, where a row takes several
        status = step_on(constants, count, every, state, rows[row:])
        rows.iterations[row] = max(previous, rows.iterations[row])
        pace.end(count)
        if progress is not None:
            progress(state.steps)
    return status, rows


def failure_of(
    binding: Binding, run: RunArguments, trajectory: Trajectory, diagnosis: Diagnosis, q: Array
) -> StepFailed:
    """Return the error of a run whose next step, from q, has no solution."""
    step_count = trajectory.report.steps
    t = binding.time_of(q) if binding.clocked else run.t0 + step_count * run.dt
    return StepFailed(step=step_count + 1, t=float(t), trajectory=trajectory, **asdict(diagnosis))


def advance_and_detect(
    detector: EventDetector, binding: Binding, constants: RunConstants, steps: int, every: int,
    state: RunState, rows: Rows,
) -> int:
    """Advance as ``binding.integrate`` does, and pass every state to an event detector.

    ``rows`` get each ``every``-th state; the status is returned.
    """
    first_step, q, p = state.steps, state.q.copy(), state.p.copy()
    visited = rows if every == 1 else detector.scratch_rows(steps)
    # events are sought in every state, also between two stored ones
    status = binding.integrate(constants, steps, every=1, state=state, rows=visited)
    count = state.steps - first_step
    detector.detect(first_step, q[None], p[None])
    detector.detect(first_step + 1, visited.q[:count], visited.p[:count])
    if every > 1:
        thin(visited, count, every, rows)
    return status


def thin(visited: Rows, step_count: int, every: int, rows: Rows) -> None:
    """Copy every ``every``-th of ``step_count`` visited states to ``rows``.

    The iterations of a stored state are the most of its ``every`` steps.
    """
    count = step_count // every
    if not count:
        return
    rows.assign(np.s_[:count], visited[every - 1 : step_count : every])
    rows.iterations[:count] = visited.iterations[: count * every].reshape(count, every).max(axis=1)


def next_chunk(
    run: RunArguments, step_count: int, limit: int, rows: int | None = None
) -> tuple[int, int]:
    """Return (steps, every) of the next call of compiled code, after ``step_count`` steps.

    A call takes at most ``limit`` steps, and stores at most ``rows`` states, unless None; the last
    state of the run is stored, too. A call stores each ``run.every``-th state; if there are more
    steps between two stored states than a call may take, the states after its pieces are stored in
    one row one after another, and the last one stays.
    """
    remaining = run.steps - step_count
    to_row = min(run.every - step_count % run.every, remaining)
    if run.stored_steps is not None:
        piece_steps = min(int(run.stored_steps[run.rows_after(step_count)]) - step_count, limit)
        return piece_steps, piece_steps
    # within a row, or a row longer than a chunk: on to the next stored state, in pieces
    if to_row < run.every or run.every > limit:
        piece_steps = min(to_row, limit)
        return piece_steps, piece_steps
    count = limit // run.every if rows is None else min(limit // run.every, rows)
    # a remainder of the run that is shorter than ``every`` takes a call of its own
    return min(run.every * count, remaining - remaining % run.every), run.every


def trajectory_of(
    binding: Binding, manifest: Manifest, run: RunArguments, read_rows: Callable[[], Rows],
    record: RunRecord, q: Array, p: Array,
) -> Trajectory:
    """Return the trajectory of rows that were filled, which are read when they are asked for.

    ``record``, q and p are of the last state, for the report. Nothing is copied.
    """
    own_parameters = run.parameters.copy()  # a user may change the trajectory's dict

    def states() -> States:
        """Return the rows filled so far, computed at the first call."""
        rows = read_rows()
        step_count = int(record.steps)
        row_count = run.rows_after(step_count)
        if row_count + 1 < len(rows.iterations):  # views take as long as a step
            rows = rows[: row_count + 1]
        elapsed = binding.times(0 * run.t0, run.dt, run.steps_of_rows(step_count))
        return States(
            binding, manifest, binding.parameters(own_parameters, run.t0), t=run.t0 + elapsed,
            q=rows.q, p=rows.p, multipliers=rows.multipliers[1:], iterations=rows.iterations[1:],
            work=rows.work, elapsed=elapsed)

    return Trajectory.of(
        states,
        _read=lambda: Report.read(record, q, p, binding),
        dt=run.dt,
        every=run.every,
        parameters=run.parameters,
        manifest=manifest,
        _inputs=run.inputs,
    )
