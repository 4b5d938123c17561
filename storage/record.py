"""Records a run: computes states in blocks, commits them, goes on where an earlier call ended.

One thread computes, another writes. A commit is a block of rows, whole or begun, and the
checkpoint that belongs to it; at every instant the store holds a run up to some commit. What is
recorded is what ``Stepper.integrate`` returns, to the bit, however often a run was ended.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import ArrayLike

from ..arguments import as_flag
from ..errors import InputError, Stopped
from ..exact import Number
from ..naming import shown, whole
from ..runtime.call.binding import REASONS, SolverName
from ..runtime.call.checks import as_callback
from ..runtime.choice.frame_choice import chosen
from ..runtime.interrupts import Interrupts, watched
from ..runtime.output.report import Report
from ..runtime.run.stepper import Stepper
from ..runtime.steps.follow import followed
from ..runtime.steps.integration import Pace, Rows, Run, advance, ended_at, next_chunk
from .checkpoint import State, pack, room, unpack
from .durable import new_store_path, remove_parts, storage_errors
from .fresh import appearing, is_new
from .identity import identity_of, refuse_if_different, versions
from .layout import (
    CHECKPOINT,
    EXTENDS,
    array_of,
    create,
    extend,
    fields_of,
    open_group,
    wide_name,
)
from .lock import claim
from .recording import Recording, stored_values
from .soundness import COMPLETE, FAILED, RUNNING, refuse_other_arrays
from .writer import CURE, Batch, Writer

__all__ = ["record"]

#: What helps where a store cannot be made.
_NEW = "Nothing is stored yet: free some space, or choose another place."
#: What makes a file of a stored run.
_AS_FILE = "What record(...) returns is then written by .export('run.csv')."
#: Seconds between two commits: what a killed run computes again, at most.
COMMIT_SECONDS = 5.0


def record(
    stepper: Stepper,
    q: ArrayLike,
    p: ArrayLike,
    *,
    out: str | Path,
    dt: Number,
    steps: int,
    parameters: Mapping[str, Any],
    t0: Number = 0.0,
    every: int = 1,
    solver: SolverName = "auto",
    tolerance: Number | None = None,
    max_iterations: int = 50,
    resume: bool = False,
    seed: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Recording:
    """Integrate as ``Stepper.integrate`` does and stream the states to a Zarr store.

    Memory stays constant; states are written while the next ones are computed. After any end (a
    signal, ``kill -9``, a power cut, a full disk) the store is whole up to its last commit, a few
    seconds ago, and ``resume=True`` goes on there: compensation terms, the predictor's past and
    the running record are kept, so the result is that of an uninterrupted run, bit for bit.

    Parameters
    ----------
    stepper : Stepper
    q, p, dt, steps, parameters, t0, every, solver, tolerance, max_iterations, progress
        As for ``Stepper.integrate``.
    out : path
        The store, a folder; by custom its name ends in ``.zarr``.
    resume : bool
        Go on with the run in ``out``; begins it if there is none. With more steps than it began
        with it goes on to these, finished or not.
    seed : int, optional
        Of the random numbers that made this start, if it was drawn: kept with the run, not used.

    Returns
    -------
    Recording

    Raises
    ------
    InputError
        If the store exists and ``resume`` is not set, or holds another run: says what differs.
    StorageError
        If the store cannot be written, or another process is at it.
    StepFailed
        When a step finds no solution; everything before it is in the store.
    Stopped
        After SIGINT, SIGTERM or SIGHUP, with everything computed in the store.
    """
    if not isinstance(stepper, Stepper):
        raise InputError(f"stepper = {shown(stepper)} is no stepper; make one with "
                         "gyrospark.stepper.")
    as_flag("resume", resume)
    parameters, follow = followed(stepper, q, p, dt=dt, steps=steps, parameters=parameters, t0=t0)
    parameters = chosen(stepper, q, p, dt=dt, steps=steps, parameters=parameters, t0=t0)
    run = stepper.checked_run(q, p, dt=dt, steps=steps, every=every, parameters=parameters, t0=t0,
                              solver=solver, tolerance=tolerance, max_iterations=max_iterations)
    run = replace(run, follow=follow)
    path, drawn = new_store_path(out, _AS_FILE), _as_seed(seed)
    as_callback("progress", progress)
    with claim(path):
        group = _opened(stepper, run, path, resume, drawn)
        if group.attrs["status"] == RUNNING:
            _Course(stepper, run, path, group).go(progress)
    recording = Recording(path)
    if recording.status != COMPLETE:
        raise recording.failure()
    return recording


def _opened(
    stepper: Stepper, run: Run, path: Path, resume: bool, seed: int | None
) -> zarr.Group:
    """Return the store's group: the one that is there, or a new one."""
    identity = identity_of(stepper, run)
    if not is_new(path, resume, "run"):
        return _begun_earlier(stepper, run, path, identity)
    about = _course(stepper, run, identity) | {
        "steps_done": 0,
        "seed": seed,
        "versions": versions(),
        "manifest": stepper.manifest,
    }
    with storage_errors(path, _NEW):
        with appearing(path) as fresh:
            create(fresh, fields_of(stepper.manifest), run.rows + 1, room(stepper.binding), about)
        return open_group(path, write=True)


def _begun_earlier(
    stepper: Stepper, run: Run, path: Path, identity: dict[str, Any]
) -> zarr.Group:
    """Return the group of a store that is there, and holds this run, or its first steps."""
    kept = Recording(path)
    begun = kept.attributes["run"]
    longer = run.steps > begun["steps"] and not kept.status.startswith(FAILED)
    refuse_if_different(begun | ({"steps": run.steps} if longer else {}), identity,
                        f"The store {str(path)!r}")
    fields, checkpoint = fields_of(stepper.manifest), room(stepper.binding)
    rows, coming = kept.rows, kept.attributes.get(EXTENDS)
    with storage_errors(path, CURE):
        refuse_other_arrays(path, kept.group(), fields, {rows, coming or rows}, checkpoint)
        if longer or coming is not None:
            extend(path, kept.attributes["arrays"], run.rows + 1,
                   _course(stepper, run, identity, kept) if longer else {})
        remove_parts(path)
        return kept.group(write=True)


def _course(
    stepper: Stepper, run: Run, identity: dict[str, Any], kept: Recording | None = None
) -> dict[str, Any]:
    """Return what a store says of a run that is begun, or that has more steps than it ``kept``.

    A last state between two that are stored is none of the longer run's.
    """
    begun = kept is not None and kept.report is not None
    return {
        "title": f"{stepper.name}: {run.steps} steps of {float(run.dt):g} s",
        "status": RUNNING,
        "states": kept.steps_done // run.every + 1 if kept is not None and begun else 0,
        "run": identity,
    }


def _as_seed(seed: Any) -> int | None:
    """Return a seed as a whole number."""
    drawn = None if seed is None else whole(seed)
    if seed is not None and drawn is None:
        raise InputError(f"seed = {shown(seed)} is no whole number; give the one that the start "
                         "was drawn with, or leave it out.")
    return drawn



class _Course:
    """A run under way: where it stands, and the block of rows that it fills."""

    def __init__(self, stepper: Stepper, run: Run, path: Path, group: zarr.Group) -> None:
        self.binding, self.run, self.path, self.group = stepper.binding, run, path, group
        self.fields = fields_of(stepper.manifest)
        self.block = array_of(group, "time").chunks[0]
        self.parameters = self.binding.parameters(run.parameters, run.t0)
        self.state, self.first, self.rows = self._begun()
        self.pace = Pace()

    # ------------------------------------------------------------ where it stands

    def _begun(self) -> tuple[State, int, Rows]:
        """Return the state to go on from, and the block that it is in."""
        try:
            kept = unpack(self.binding, np.asarray(array_of(self.group, CHECKPOINT)[:]))
        except ValueError as error:
            raise InputError(f"The store {str(self.path)!r} cannot be gone on with: {error}. What "
                             "is stored can be read; choose another store for the run.") from error
        if kept is None:
            return self._start()
        done = self._states(kept)
        first = done // self.block * self.block  # of the next row, which may be begun
        rows = self._read(first, done - first)
        rows.iterations[done - first] = kept.most
        return kept, first, rows

    def _start(self) -> tuple[State, int, Rows]:
        """Return the state and the block at the start; no step is taken."""
        binding, run, rows = self.binding, self.run, self._empty()
        rows.q[0], rows.p[0] = run.q, run.p
        state = State(run.q.copy(), run.p.copy(), binding.report(), binding.work())
        status = advance(binding, run, self.parameters, 0, 1, state.q, state.p, _out(rows, 0),
                         state.report, state.work)
        return State(state.q, state.p, state.report, state.work, status=status), 0, rows

    def _states(self, state: State) -> int:
        """Return how many states are done, with the start."""
        run = self.run
        return run.rows + 1 if state.steps == run.steps else state.steps // run.every + 1

    def _empty(self) -> Rows:
        """Return a block of rows; the start has no multipliers."""
        binding, size = self.binding, self.block
        none = binding.new(1)[0] + np.nan
        rows = Rows(binding.new(size, binding.n), binding.new(size, binding.n),
                    binding.new(size, binding.multipliers), np.zeros(size, dtype=np.intc),
                    binding.new(size))
        rows.multipliers[:1] = none
        return rows

    def _read(self, first: int, count: int) -> Rows:
        """Return a block of rows with what is stored of it."""
        rows = self._empty()
        for one in self.fields:
            part = getattr(rows, one.name, None)
            if part is not None:
                name = wide_name(one.name) if one.wide else one.name
                values = stored_values(array_of(self.group, name), first, count, one.wide,
                                       self.binding.dtype)
                part[:count] = values.reshape(count, *part.shape[1:])
        return rows

    # ------------------------------------------------------------ computing

    def go(self, progress: Callable[[int], None] | None) -> None:
        """Compute and commit to the end of the run, to a step that fails, or to a signal."""
        with ExitStack() as stack:
            interrupts = stack.enter_context(watched())
            writer = stack.enter_context(Writer(self.path, self.group, self.fields, self.binding,
                                                self.run, self.block))
            self._compute(writer, interrupts, progress)
            self._commit(writer)
        if interrupts.asked and not self.state.status:
            rest = ("It is" if self.state.steps == self.run.steps else
                    "The same command with --resume goes on: everything up to there is")
            raise Stopped(f"{ended_at(self.state.steps, self.run.steps)} {rest} in "
                          f"{str(self.path)!r}.", interrupts.signal)

    def _compute(self, writer: Writer, interrupts: Interrupts,
                 progress: Callable[[int], None] | None) -> None:
        run, committed = self.run, time.monotonic()
        while self.state.steps < run.steps and not self.state.status and not interrupts.asked:
            place = self.state.steps // run.every + 1 - self.first
            if place == self.block:
                self._commit(writer)
                committed = time.monotonic()
                self.first, self.rows, place = self.first + self.block, self._empty(), 0
            self._advance(place)
            if progress is not None:
                progress(self.state.steps)
            if time.monotonic() - committed > COMMIT_SECONDS and not writer.busy:
                self._commit(writer)
                committed = time.monotonic()

    def _advance(self, place: int) -> None:
        """Compute the next piece into the block, from that row on."""
        state, rows = self.state, self.rows
        count, every = next_chunk(self.run, state.steps, self.pace.begin(), self.block - place)
        if self.run.follow is not None:
            self.parameters = self.run.follow.parameters(self.run, state.steps, state.q, state.p,
                                                         state.work)
        most = rows.iterations[place]  # of the pieces before, where a row takes several
        status = advance(self.binding, self.run, self.parameters, count, every, state.q, state.p,
                         _out(rows, place), state.report, state.work)
        rows.iterations[place] = max(most, rows.iterations[place])
        self.pace.end(count)
        self.state = State(state.q, state.p, state.report, state.work, status=status)

    # ------------------------------------------------------------ committing

    def _commit(self, writer: Writer) -> None:
        """Hand over the block as far as it is filled, and where the run stands."""
        state, run = self.state, self.run
        count = self._states(state) - self.first
        place = state.steps // run.every + 1 - self.first  # of a row that is begun
        most = int(self.rows.iterations[place]) if state.steps % run.every else 0
        kept = State(state.q, state.p, state.report, state.work, most, state.status)
        rows = self.rows
        if count < self.block:  # more rows come into it while these are written
            rows = Rows(*(getattr(rows, field.name)[:count].copy() for field in fields(Rows)))
        writer.put(Batch(self.first, count, rows, pack(self.binding, kept), self._said(kept)))

    def _said(self, state: State) -> dict[str, Any]:
        """Return what the store says of the run so far."""
        if state.status:
            status = FAILED + REASONS[state.status]
        else:
            status = COMPLETE if state.steps == self.run.steps else RUNNING
        report = Report.read(state.report, state.q, state.p, forced=self.binding.has_forces)
        return {"status": status, "steps_done": state.steps, "states": self._states(state),
                "report": asdict(report)}


def _out(rows: Rows, place: int) -> tuple[Any, ...]:
    """Return what compiled code fills from this row on."""
    return (rows.q[place:], rows.p[place:], rows.multipliers[place:], rows.iterations[place:],
            rows.work[place:])
