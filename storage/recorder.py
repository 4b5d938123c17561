"""The recorder: computes states in blocks, finds events, commits both.

One thread computes, another writes. A commit is a block of rows, full or partial, the new events
and the checkpoint of the last row.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, replace
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zarr

from ..core.errors import InputError, StepFailed, Stopped
from ..core.event import Event, Impact
from ..core.interrupts import Interrupts, catch_signals
from ..runtime.bindings.binding import REASONS
from ..runtime.bindings.run_memory import Rows, RunState
from ..runtime.events.last_step import counted_from_start, report_to_end, row_of
from ..runtime.events.observer import (
    impact_losses,
    integrate_observed,
    observer_of,
    report_with_row,
)
from ..runtime.integration.run_arguments import RunArguments
from ..runtime.integration.step_loop import ChunkSize, ended_at, next_chunk
from ..runtime.results.crossings import Crossings
from ..runtime.results.diagnostics import Report
from ..runtime.results.trajectory import Trajectory
from ..runtime.steppers.stepper import Stepper
from .array_layout import (
    CHECKPOINT,
    array_of,
    attributes_of,
    fields_of,
    fields_of_events,
    names_of,
    wide_name,
)
from .checkpoint import CheckpointState, EventProgress, pack, unpack
from .durable_files import storage_errors
from .event_store import EventStore
from .validation import (
    COMPLETE,
    ENDED,
    FAILED,
    RUNNING,
    refuse_missing_blocks,
    stored_values,
)
from .writer import CURE, Batch, Writer

__all__ = ["Recorder"]

#: Seconds between two commits: the most work that a killed run repeats.
COMMIT_SECONDS = 5.0


class _ResumePoint(NamedTuple):
    """The state from which a stored run continues."""

    state: CheckpointState
    first_row: int  # of the block in the store, which counts the states from 0
    rows: Rows  # the block: rows up to the state are as stored, later ones are to be filled


class Recorder:
    """Recorder of a run: its state, and the block of rows being filled."""

    def __init__(self, stepper: Stepper, run: RunArguments, events: tuple[Event | Impact, ...],
                 path: Path, group: zarr.Group) -> None:
        """Open a store for a run; events take the order that they have in the store.

        ``group`` is the root of the store at ``path``, from whose last commit the run continues.
        """
        self.binding, self.run, self.path, self.group = stepper.binding, run, path, group
        self.stepper = stepper
        #: The last part of a step, to t_end between two steps, once it is taken.
        self.last_part: Trajectory | None = None
        self.manifest, self.fields = stepper.manifest, fields_of(stepper.manifest)
        self.block = array_of(group, "time").chunks[0]
        self.constants = run.constants(self.binding)
        event_by_name = {event.name: event for event in events}  # in the order of the store
        self._event_attributes = attributes_of(group)["run"].get("events", {})
        self._event_fields = fields_of_events(self.manifest, self._event_attributes)
        self.events = tuple(event_by_name[name] for name in self._event_attributes)
        #: Count of each event up to the last commit; time of the one that ended the run.
        self.counts = np.zeros(len(events), int)
        self.end: Any = None
        #: When the last crossing of each event was, and the energy lost in impacts of each gap.
        self._latest: dict[str, Any] = {}
        self._losses: dict[str, Any] = {}
        self.observer = observer_of(stepper, run, self.events) if events else None
        self._step_on = self.binding.integrate if self.observer is None else self.observer.advance
        self.state, self.first_row, self.rows = self._resume_state()
        self.pace = ChunkSize(has_events=self.observer is not None)

    # ------------------------------------------------------------ where it stands

    def _resume_state(self) -> _ResumePoint:
        """Return the last commit of the store, or the start of the run if there is none.

        Raises InputError for a store with the checkpoint of another run.
        """
        try:
            checkpoint = unpack(self.binding, np.asarray(array_of(self.group, CHECKPOINT)[:]),
                                self.events)
            self._check_checkpoint(checkpoint)
        except ValueError as error:
            raise InputError(f"The store {str(self.path)!r} cannot be resumed: {error}. What "
                             "is stored can be read; choose another store for the run.") from error
        if self.events:
            self._resume_detection(checkpoint)
        if checkpoint is None:
            return self._start()
        stored_states = self._states(checkpoint)
        # the block of the row of the next step, whose first rows may be stored already
        # (the row itself too, if the run ended between two multiples of ``every``)
        next_row = checkpoint.steps // self.run.every + 1
        first_row = next_row // self.block * self.block
        block_rows = self._read(first_row, stored_states - first_row)
        if checkpoint.ended_by is not None:
            # fields[0] is the time, in numbers like those of τ
            self.end = self._rows("tau" if self.binding.clocked else "time",
                                  self.fields[0].wide, stored_states - 1, count=1)
        if next_row == stored_states:
            block_rows.iterations[next_row - first_row] = checkpoint.most_iterations
        return _ResumePoint(checkpoint, first_row, block_rows)

    def _check_checkpoint(self, checkpoint: CheckpointState | None) -> None:
        """Refuse a checkpoint of more steps or rows than the run has, or events than are stored.

        Raises ValueError, whose text ends the sentence of the caller.
        """
        if checkpoint is None:
            return
        progress = checkpoint.event_progress
        counts = [] if progress is None else progress.counts.tolist()
        stored_counts = [array_of(self.group, fields[0].name).shape[0]
                         for fields in self._event_fields.values()]
        if (checkpoint.steps > self.run.steps
                or self._states(checkpoint) > self.run.stored_states
                or any(count > stored_count
                       for count, stored_count in zip(counts, stored_counts, strict=True))):
            raise ValueError("its checkpoint is ahead of what is stored")

    def _resume_detection(self, checkpoint: CheckpointState | None) -> None:
        """Resume event detection at the state of the run, and drop later stored events.

        These belong to a process interrupted between its events and its checkpoint.
        """
        if checkpoint is not None and checkpoint.event_progress is not None:
            self.counts = checkpoint.event_progress.counts
            assert self.observer is not None
            # the brackets of crossings that were not located at the last commit
            self.observer.resume(checkpoint.run, checkpoint.event_progress.memory)
            for (name, fields), count in zip(self._event_fields.items(), self.counts.tolist(),
                                             strict=True):
                refuse_missing_blocks(self.path, self.group, 0, count, names_of(fields))
                if count:
                    elapsed = next(field for field in fields if field.name.endswith("_elapsed"))
                    self._latest[name] = self._rows(elapsed.name, elapsed.wide, count - 1,
                                                    count=1)[0]
                for field in fields:
                    if field.name == f"event_{name}_energy_lost":
                        losses = self._rows(field.name, field.wide, first=0, count=count)
                        self._losses[name] = reduce(add, losses, 0.0)
        names = [event.name for event in self.events]
        with storage_errors(self.path, CURE):
            EventStore(self.group, self.manifest, self._event_attributes).resize(
                dict(zip(names, self.counts.tolist(), strict=True)))

    def _start(self) -> _ResumePoint:
        """Return the start of the run, its first row filled; no step is taken."""
        binding, run, block_rows = self.binding, self.run, self._empty()
        block_rows.q[0], block_rows.p[0] = run.q, run.p
        state = RunState.at_start(binding, run.q, run.p)
        status = binding.integrate(self.constants, steps=0, every=1, state=state,
                                   rows=block_rows[:0])
        return _ResumePoint(CheckpointState(state, status=status), first_row=0, rows=block_rows)

    def _states(self, state: CheckpointState) -> int:
        """Return the number of states up to a checkpoint.

        These are the start, the stored steps, and the state at a final event or at t_end.
        """
        run = self.run
        if state.ended_by is not None:
            return state.steps // run.every + 2
        complete = state.steps == run.steps and (self.last_part is not None or not run.rest)
        return run.stored_states if complete else state.steps // run.every + 1

    def _empty(self) -> Rows:
        """Return a block of empty rows; the start, its first row, has NaN for multipliers."""
        block_rows = Rows.allocate(self.binding, self.block)
        block_rows.multipliers[:1] = self.binding.new(1)[0] + np.nan
        return block_rows

    def _begin_next_block(self, writer: Writer) -> None:
        """Begin the block of rows after the present one, in a written block if there is one.

        Page faults of new memory would cost as much as the steps.
        """
        self.first_row += self.block
        try:
            self.rows = writer.written.get_nowait()
        except queue.Empty:
            self.rows = self._empty()
        else:
            self.rows.iterations[:] = 0

    def _read(self, first_row: int, count: int) -> Rows:
        """Return a block of rows from ``first_row`` on, its first ``count`` ones as stored."""
        refuse_missing_blocks(self.path, self.group, first_row, first_row + count)
        block_rows, multiplier_columns = self._empty(), []
        for stored_field in self.fields:
            name = stored_field.name
            target: Any = getattr(block_rows, name, None)
            # the last coordinate and momentum of scaled time
            is_hidden = self.binding.clocked and name in ("time", "time_momentum")
            if target is None and name != "reactions" and not is_hidden:
                continue
            columns = self._rows(name, stored_field.wide, first_row, count)
            if name in ("multipliers", "reactions"):
                multiplier_columns.append(columns.reshape(count, int(np.prod(columns.shape[1:]))))
            elif is_hidden:
                (block_rows.q if name == "time" else block_rows.p)[:count, -1] = columns
            elif name in ("q", "p"):  # without t and e of scaled time
                target[:count, : self.binding.shown] = columns
            else:
                target[:count] = columns.reshape(count, *target.shape[1:])
        if multiplier_columns:  # side by side, as ``flat_multipliers`` has them
            block_rows.multipliers[:count] = np.concatenate(multiplier_columns, axis=1)
        return block_rows

    def _rows(self, name: str, wide: bool, first: int, count: int) -> Any:
        """Return ``count`` rows of an array in the store from ``first`` on, wide ones with all
        digits."""
        array = array_of(self.group, wide_name(name) if wide else name)
        return stored_values(array, first, count, wide, self.binding.dtype)

    # ------------------------------------------------------------ computing

    def run_to_end(self, progress: Callable[[int], None] | None) -> None:
        """Compute and commit to the end of the run, to a step that fails, or to a signal."""
        with ExitStack() as stack:
            interrupts = stack.enter_context(catch_signals())
            writer = stack.enter_context(Writer(self.path, self.group, self.fields, self.binding,
                                                self.run, self.block))
            self._compute(writer, interrupts, progress)
            self._commit(writer)
            # the last part of a step, to a t_end between two steps, is no step of the grid
            if (self.run.rest and self.state.steps == self.run.steps and not self._has_ended()
                    and not interrupts.is_requested):
                self._take_last_part(writer)
        if interrupts.is_requested and self.state.status <= 0:
            raise self._stop_exception(interrupts)

    def _stop_exception(self, interrupts: Interrupts) -> Stopped:
        """Return the exception after a signal, whose message says whether steps remain."""
        state, run = self.state, self.run
        remaining = run.steps - state.steps + bool(run.rest and not self.last_part)
        if state.status < 0:  # an event has ended the run
            remaining = 0
        next_action = ("The same command with --resume continues it: everything up to there is"
                       if remaining else "It is")
        return Stopped(f"{ended_at(state.steps, state.steps + remaining)} {next_action} in "
                       f"{str(self.path)!r}.", interrupts.signal)

    def _compute(self, writer: Writer, interrupts: Interrupts,
                 progress: Callable[[int], None] | None) -> None:
        """Take all steps; commit full blocks, and every few seconds.

        ``interrupts`` end it after a chunk; ``progress`` is called with the steps done.
        """
        run, committed = self.run, time.monotonic()
        while not (self.state.steps >= run.steps or self._has_ended() or interrupts.is_requested):
            row = self.state.steps // run.every + 1 - self.first_row  # the next row in the block
            if row == self.block:
                self._commit(writer, reusable=True)
                committed = time.monotonic()
                if self._has_ended():
                    return
                self._begin_next_block(writer)
                row = 0
            self._advance(row)
            if self.state.ended_by is not None:
                return
            if progress is not None:
                progress(self.state.steps)
            # while the writer is busy, steps go on: a slow disk makes commits rarer, not the run
            # slower
            has_many_brackets = self.observer is not None and self.observer.full
            if has_many_brackets or (time.monotonic() - committed > COMMIT_SECONDS
                                     and not writer.busy):
                self._commit(writer)
                committed = time.monotonic()

    def _has_ended(self) -> bool:
        """Whether a step has failed, or an event has ended the run."""
        return self.state.status != 0

    def _advance(self, row: int) -> None:
        """Compute the next chunk into the block, from that row on, up to a terminal event."""
        state, block_rows = self.state.run, self.rows
        count, every = next_chunk(self.run, state.steps, self.pace.begin(), self.block - row)
        earlier_iterations = block_rows.iterations[row]  # of earlier pieces of this row
        status = self._step_on(self.constants, count, every, state, block_rows[row:])
        block_rows.iterations[row] = max(earlier_iterations, block_rows.iterations[row])
        self.pace.end(count)
        self.state = CheckpointState(state, status=status)
        self._end_at_event()

    def _take_last_part(self, writer: Writer) -> None:
        """Take the partial step to t_end, and commit its end as the last row.

        Events within it are counted from the start of the run; a terminal one ends the run there.
        """
        run, state, binding = self.run, self.state.run, self.binding
        row = run.steps // run.every + 1 - self.first_row  # the last row, counted in its block
        # where ``every`` does not store the last whole step, a longer run that resumes here takes
        # more steps for the same row, which has the most iterations of all of them; it needs no
        # event of this part, which it finds again in its next step
        iterations = int(self.rows.iterations[row]) if run.steps % run.every else 0
        grid_end = replace(self.state, most_iterations=iterations,
                           event_progress=self._event_progress())
        # the time of the last whole step, and that since the start of the run, in the type of t0
        t, elapsed = (binding.times(first_time, run.dt, np.array([run.steps]))[0]
                      for first_time in (run.t0, 0 * run.t0))
        try:
            partial_run = integrate_observed(self.stepper, run.part_of_step(state.q, state.p, t),
                                             self.events, progress=None)
        except StepFailed as error:
            # a failure is stored as a status of C, from which its reason is read again
            status = next(code for code, text in REASONS.items() if text == error.reason)
            self.state = replace(self.state, status=status)
            self._commit(writer)
            return
        work_of_steps = self.binding.work_done(state.record)
        new_events = partial_run.impacts or partial_run.events
        crossings = {name: counted_from_start(crossings_of_event, run.steps, elapsed, work_of_steps,
                                              self._latest.get(name))
                     for name, crossings_of_event in new_events.items()}
        if row == self.block:
            self._begin_next_block(writer)
            row = 0
        self.rows.assign(np.s_[row : row + 1],
                         row_of(partial_run, work_of_steps + partial_run.work[-1:]))
        self.last_part = partial_run
        self.end = np.array([run.t_end], partial_run.t.dtype)
        if partial_run._ended_by is not None:
            self.end = partial_run.t[-1:]
            names = [event.name for event in self.events]
            self.state = self.state.ended_at_event(names.index(partial_run._ended_by))
        self._commit(writer, crossings=crossings, checkpoint=grid_end)

    # ------------------------------------------------------------ events

    def _commit_events(self) -> dict[str, Crossings]:
        """Return the events since the last commit; end the run at a terminal one."""
        observer = self.observer
        if observer is None:
            return {}
        observer.close(self.state.run, self._next_state() if observer.terminal else None)
        self._end_at_event()
        return {name: crossings.shown(self.binding)
                for name, crossings in observer.take_crossings().items()}

    def _next_state(self) -> tuple[Any, Any] | None:
        """Return the state one step ahead, which is not part of the run; None if there is none."""
        if self.state.status or self.state.steps == self.run.steps:
            return None
        state = self.state.run.copy(self.binding)
        status = self.binding.integrate(self.constants, steps=1, every=1, state=state,
                                        rows=Rows.allocate(self.binding, 1))
        return None if status else (state.q[None], state.p[None])

    def _end_at_event(self) -> None:
        """Store the state of the event that ends the run, if one does, in the row behind."""
        end = None if self.observer is None else self.observer.end
        if end is None or self.state.ended_by is not None:
            return
        self.state = self.state.ended_at_event(end.event)
        row_in_block = self.state.steps // self.run.every + 1 - self.first_row
        self.rows.assign(np.s_[row_in_block : row_in_block + 1], end.row)
        self.end = end.at.t  # in scaled time τ

    # ------------------------------------------------------------ committing

    def _commit(
        self, writer: Writer, *, reusable: bool = False,
        crossings: dict[str, Crossings] | None = None, checkpoint: CheckpointState | None = None,
    ) -> None:
        """Commit the filled part of the block, and the state of the run.

        The writer may give ``reusable`` rows back; whole blocks are not copied. ``crossings`` are
        new since the last commit, by default the observer's; ``checkpoint`` is the state
        from which the run resumes, by default the present one.
        """
        if crossings is None:
            crossings = self._commit_events()
        self._latest |= {name: rows.elapsed[-1] for name, rows in crossings.items() if len(rows)}
        self._losses = impact_losses(crossings, self._losses)
        state, run = self.state, self.run
        count = self._states(state) - self.first_row
        row = state.steps // run.every + 1 - self.first_row  # of a row that is begun
        begun = state.steps % run.every and state.ended_by is None and self.last_part is None
        iterations_so_far = int(self.rows.iterations[row]) if begun else state.most_iterations
        # the counts before this commit, behind which the writer appends its events
        counts = {event.name: int(n) for event, n in zip(self.events, self.counts, strict=True)}
        self.counts = self.counts + [len(crossings.get(name, ())) for name in counts]
        checkpoint = checkpoint or replace(state, most_iterations=iterations_so_far,
                                           event_progress=self._event_progress())
        block_rows = self.rows
        if count < self.block:  # more rows come into it while these are written
            block_rows = block_rows[:count].copy()
        writer.put(Batch(self.first_row, count, block_rows,
                         checkpoint=pack(self.binding, checkpoint),
                         attributes=self._run_attributes(state), end=self.end, counts=counts,
                         crossings=crossings, reusable=reusable))

    def _event_progress(self) -> EventProgress | None:
        """Return the event progress at the state; detection stops behind an end."""
        if self.observer is None:
            return None
        if self.state.ended_by is not None:
            return replace(EventProgress.none(self.binding, self.events), counts=self.counts)
        return EventProgress(self.counts, self.observer.memory)

    def _report(self, state: CheckpointState) -> Report:
        """Return the diagnostics up to a checkpoint.

        The record of the run has its whole steps alone: impacts, and a last step that is shorter
        than dt or ends at an event, are added.
        """
        run = state.run
        report = Report.read(run.record, run.q, run.p, self.binding)
        if self.observer is not None:
            report = self.observer.add_impacts(report, int(self.counts.sum()))
        if self.last_part is None:
            if state.ended_by is None:
                return report
            row = state.steps // self.run.every + 1 - self.first_row
            return report_with_row(self.stepper, self.run, report, self.end,
                                   self.rows[row : row + 1], self._losses)
        work = self.binding.work_done(run.record) + self.last_part.work[-1:]
        to_end = report_to_end(self.stepper, self.run, report, self.last_part, work, self._losses)
        return replace(to_end, impacts=report.impacts)

    def _run_attributes(self, state: CheckpointState) -> dict[str, Any]:
        """Return the attributes of the run so far."""
        if state.ended_by is not None:
            status = ENDED + self.events[state.ended_by].name
        elif state.status:
            status = FAILED + REASONS[state.status]
        else:
            complete = state.steps == self.run.steps and (
                self.last_part is not None or not self.run.rest)
            status = COMPLETE if complete else RUNNING
        attributes = {"status": status, "steps_done": state.steps, "states": self._states(state),
                      "report": asdict(self._report(state))}
        counts = {event.name: int(n) for event, n in zip(self.events, self.counts, strict=True)}
        return attributes | ({"events": counts} if counts else {})
