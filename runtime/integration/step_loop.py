"""One integration in chunks of compiled steps; an interrupted one returns its states."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError, StepFailed, Stopped
from ...core.interrupts import Interrupts, catch_ctrl_c
from ...core.manifest import Manifest
from ..bindings.binding import Binding
from ..compilation.call_stack import thread_seconds
from ..results.diagnostics import Report
from ..results.run_arrays import States, defect_sizes
from ..results.trajectory import Trajectory
from .failure import Diagnosis, diagnose
from .run_arguments import RunArguments

if TYPE_CHECKING:
    from ..events.detection import EventDetector

__all__ = ["FIRST_STEPS", "ChunkSize", "Rows", "advance", "course", "defect_sizes", "ended_at",
           "failure_of", "fill", "integrate", "next_chunk", "thin", "trajectory_of"]

Array = NDArray[Any]

#: Steps between two looks at the progress bar and at signals: at first, at most.
FIRST_STEPS, _CHUNK = 16, 4096
#: The same, where what is seen between is looked at: that takes a while for a piece.
_CHUNK_WITH_EVENTS = 2**14
#: Seconds between two looks, where a step does not take longer.
_LOOK = 0.1


@dataclass(frozen=True)
class Rows:
    """Where stored states go: row 0 of q, p and work is the start."""

    q: Array
    p: Array
    multipliers: Array
    iterations: Array
    work: Array

    @classmethod
    def allocate(cls, binding: Binding, rows: int) -> Rows:
        """Return empty rows, or raise InputError where there is no memory for them."""
        try:
            return cls(
                binding.new(rows + 1, binding.n),
                binding.new(rows + 1, binding.n),
                binding.new(rows, binding.multipliers),
                np.zeros(rows, dtype=np.intc),
                binding.new(rows + 1),
            )
        except (MemoryError, ValueError) as error:  # ValueError: more than can be addressed
            raise InputError(
                f"There is no memory for {rows + 1} states; take fewer steps, or keep fewer of "
                "their states with a larger every."
            ) from error

    def after(self, row: int) -> tuple[Array, ...]:
        """Return what compiled code fills from this row on."""
        return (self.q[row + 1 :], self.p[row + 1 :], self.multipliers[row:],
                self.iterations[row:], self.work[row + 1 :])


class ChunkSize:
    """How many steps compiled code does between two looks at signals: some tenths of a second.

    CPU seconds of this thread, unless ``clock`` says otherwise: a machine that is busy elsewhere
    changes nothing.
    """

    def __init__(
        self, catch_signals: bool = False, clock: Callable[[], float] | None = None
    ) -> None:
        self._clock = clock or thread_seconds
        self._largest = _CHUNK_WITH_EVENTS if catch_signals else _CHUNK
        self.most = min(FIRST_STEPS, self._largest)
        self._began: float | None = None

    def begin(self, left: int | None = None) -> int:
        """Return how many steps to do at most; the clock runs, unless no more are ``left``."""
        self._began = None if left is not None and left <= self.most else self._clock()
        return self.most

    def end(self, steps: int) -> None:
        """Take the time that so many steps took for the next ones."""
        if self._began is None:
            return
        seconds = self._clock() - self._began
        if seconds > _LOOK:
            self.most = max(1, int(steps * _LOOK / seconds))
        elif 2 * steps > self.most and seconds < _LOOK / 2:  # whole multiples of ``every`` fit in
            self.most = min(2 * self.most, self._largest)


def integrate(
    binding: Binding,
    manifest: Manifest,
    run: RunArguments,
    progress: Callable[[int], None] | None = None,
) -> Trajectory:
    """Return the trajectory of a run.

    Raises
    ------
    StepFailed
        With everything computed before the failed step, and what was found of its reasons.
    Stopped
        After Ctrl-C, with everything computed until then.
    """
    # One step is done or not: there is nothing to lose.
    with catch_ctrl_c() if run.steps > 1 else nullcontext(Interrupts()) as interrupts:
        trajectory, status = course(binding, manifest, run, lambda: interrupts.requested, progress)
    if status:
        last = trajectory.report
        q, p = (np.array(x, dtype=binding.dtype) for x in (last.q, last.p))
        found = diagnose(binding, manifest, run.at_step(last.steps), status, q, p,
                         run.t0 + last.steps * run.dt)
        raise failure_of(run, trajectory, found)
    if interrupts.requested:
        raise Stopped(f"{ended_at(trajectory.report.steps, run.steps)} The states are in "
                      ".trajectory.", interrupts.signal, trajectory=trajectory)
    return trajectory


def ended_at(done: int, steps: int) -> str:
    """Return a sentence that says where a signal has ended a run."""
    if done == steps:
        return f"Stopped after the last of {steps:,} steps: the run is complete."
    return f"Stopped at step {done:,} of {steps:,}."


def course(
    binding: Binding, manifest: Manifest, run: RunArguments, stop: Callable[[], bool],
    progress: Callable[[int], None] | None = None,
) -> tuple[Trajectory, int]:
    """Return a run up to its end, to a step that fails, or until it shall stop; and the status."""
    rows = Rows.allocate(binding, run.rows)
    rows.q[0], rows.p[0] = run.q, run.p
    q, p, report = run.q.copy(), run.p.copy(), binding.report()
    status = fill(binding, run, rows, q, p, report, stop, progress)
    return trajectory_of(binding, manifest, run, rows, report, q, p), status


def fill(
    binding: Binding, run: RunArguments, rows: Rows, q: Array, p: Array, report: Any,
    stop: Callable[[], bool], progress: Callable[[int], None] | None = None,
) -> int:
    """Fill the rows of a run, up to its end or as ``course`` does; (q, p) goes there.

    Returns the status.
    """
    parameters, work = binding.parameters(run.parameters, run.t0), binding.works.take()
    pace = ChunkSize(run.detector is not None)
    status = 0
    if not run.steps or run.detector is not None or stop():  # else the first steps start the record
        status = advance(binding, run, parameters, 0, 1, q, p, rows.after(run.rows), report, work)
    step_on = advance if run.detector is None else advance_with_events
    ended = run.detector is not None and run.detector.ends_in is not None
    while report.steps < run.steps and status == 0 and not ended and not stop():
        row = run.stored(int(report.steps))
        done = int(report.steps)
        count, every = next_chunk(run, done, pace.begin(run.steps - done))
        most = rows.iterations[row]  # of the pieces before, where a row takes several
        status = step_on(binding, run, parameters, count, every, q, p, rows.after(row), report,
                         work)
        ended = run.detector is not None and run.detector.ends_in is not None
        rows.iterations[row] = max(most, rows.iterations[row])
        pace.end(count)
        if progress is not None:
            progress(int(report.steps))
    binding.works.give_back(work)
    return status


def failure_of(run: RunArguments, trajectory: Trajectory, found: Diagnosis) -> StepFailed:
    """Return the error of a run whose next step has no solution."""
    done = trajectory.report.steps
    return StepFailed(step=done + 1, t=float(run.t0 + done * run.dt), trajectory=trajectory,
                      **asdict(found))


def advance(
    binding: Binding, run: RunArguments, parameters: Any, steps: int, every: int, q: Array,
    p: Array, out: tuple[Array, ...], report: Any, work: Any,
) -> int:
    """Advance (q, p) in place by up to ``steps`` steps with the run's solver; return the status.

    Every ``every``-th state goes to ``out``: q, p, multipliers, iterations, work.
    """
    options = binding.options(run.tolerance, run.max_iterations, run.solver)
    return binding.integrate(parameters, options, run.dt, steps, every, q, p, out, report, work,
                             run.inputs)


def advance_with_events(
    binding: Binding, run: RunArguments, parameters: Any, steps: int, every: int, q: Array,
    p: Array, out: tuple[Array, ...], report: Any, work: Any,
) -> int:
    """Advance as ``advance`` does, with the run's event detector on every state.

    Where it sees the run's end within a step, the state before that step is the last one.
    """
    detector = run.detector
    assert detector is not None
    begun, start = int(report.steps), (q.copy(), p.copy())
    images = [binding.image(struct) for struct in (report, work)] if detector.terminal else []
    before = [image.copy() for image in images]
    seen = out if every == 1 else _room(binding, detector, steps)
    status = advance(binding, run, parameters, steps, 1, q, p, seen, report, work)
    done = int(report.steps) - begun
    detector.detect(begun, start[0][None], start[1][None])
    detector.detect(begun + 1, seen[0][:done], seen[1][:done])
    if detector.ends_in is not None:
        status, done = 0, detector.ends_in - begun
        q[:], p[:] = start
        for image, kept in zip(images, before, strict=True):
            image[:] = kept
        if done:
            advance(binding, run, parameters, done, done + 1, q, p, seen, report, work)
    if every > 1:
        thin(seen, done, every, out)
    return status


def _room(binding: Binding, detector: EventDetector, steps: int) -> tuple[Array, ...]:
    """Return arrays for the states of so many steps, those of the last piece if they are long
    enough."""
    if detector.buffer is None or len(detector.buffer.iterations) < steps:
        detector.buffer = Rows.allocate(binding, steps)
    room: Rows = detector.buffer
    return room.after(0)


def thin(seen: tuple[Array, ...], done: int, every: int, out: tuple[Array, ...]) -> None:
    """Store every ``every``-th of the states that were seen, ``done`` of them."""
    count = done // every
    if not count:
        return
    most = seen[3][: count * every].reshape(count, every).max(axis=1)
    for part, found in zip(out, (*seen[:3], None, seen[4]), strict=True):
        part[:count] = most if found is None else found[every - 1 : done : every]


def next_chunk(run: RunArguments, done: int, most: int, rows: int | None = None) -> tuple[int, int]:
    """Return how many steps to do next, and how often to store; the very last is stored too.

    ``most`` steps at once, and there is room for ``rows`` stored states. Where it takes more steps
    to the next stored state, each piece is stored in its row and the last of them stays.
    """
    left = run.steps - done
    to_row = min(run.every - done % run.every, left)
    if run.stored_steps is not None:
        piece = min(int(run.stored_steps[run.stored(done)]) - done, most)
        return piece, piece
    if to_row < run.every or run.every > most:
        piece = min(to_row, most)
        return piece, piece
    count = most // run.every if rows is None else min(most // run.every, rows)
    return min(run.every * count, left - left % run.every), run.every


def trajectory_of(
    binding: Binding, manifest: Manifest, run: RunArguments, rows: Rows, report: Any,
    q: Array, p: Array,
) -> Trajectory:
    """Return the rows that were filled; they, the report, q and p are read when asked for."""
    given = run.parameters.copy()  # those of the trajectory are its owner's

    def states() -> States:
        done = int(report.steps)
        stored = run.stored(done)
        steps = run.steps_of_rows(done)
        return States(
            binding, manifest, binding.parameters(given, run.t0),
            binding.times(run.t0, run.dt, steps), rows.q[: stored + 1],
            rows.p[: stored + 1], rows.multipliers[:stored], rows.iterations[:stored],
            rows.work[: stored + 1], binding.times(0 * run.t0, run.dt, steps))

    return Trajectory.of(
        states,
        _read=lambda: Report.read(report, q, p, forced=binding.has_forces),
        dt=run.dt,
        every=run.every,
        parameters=run.parameters,
        manifest=manifest,
        _inputs=run.inputs,
    )
