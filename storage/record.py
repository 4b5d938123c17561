"""Recording a run: begins its store, or resumes it; ``recorder`` computes.

At every instant the store holds a run up to some commit. The record has the
bits of ``Stepper.integrate``, for any number of interruptions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import zarr
from numpy.typing import ArrayLike

from ..core.arguments import as_flag, shown, whole
from ..core.errors import InputError
from ..core.event import Event, as_events, refuse_unusable_names
from ..core.exact_numbers import Number
from ..core.progress import Progress, as_progress, log_progress
from ..core.solver import Solver, SolverName
from ..core.start import HasStart
from ..runtime.integration.run_arguments import RunArguments, step_count
from ..runtime.integration.starts import merged_start
from ..runtime.steppers.stepper import Stepper
from .array_layout import (
    EXTENDS,
    create,
    extend,
    fields_of,
    fields_of_event,
    open_group,
)
from .checkpoint import checkpoint_size
from .durable_files import new_store_path, remove_parts, storage_errors
from .identity import identity_of, refuse_if_different, versions
from .recorder import Recorder
from .recording import Recording
from .staging import created_atomically, is_new, writer_lock
from .validation import COMPLETE, ENDED, FAILED, RUNNING, refuse_other_arrays
from .writer import CURE

__all__ = ["record"]

#: Cure where a store cannot be made.
_NEW = "Nothing is stored yet: free some space, or choose another place."
#: How to make a file of a stored run.
_AS_FILE = "The result of record(...) is then written by .export('run.csv')."


def record(
    stepper: Stepper,
    start: HasStart | ArrayLike,
    p: ArrayLike | None = None,
    /,
    *,
    out: str | Path,
    dt: Number,
    t_end: Number | None = None,
    steps: int | None = None,
    parameters: Mapping[str, Any] | None = None,
    every: int = 1,
    events: Event | Sequence[Event] = (),
    solver: SolverName | Solver = "auto",
    resume: bool = False,
    seed: int | None = None,
    progress: Progress = None,
) -> Recording:
    """Integrate as ``Stepper.integrate`` does and stream the states to a Zarr store.

    Memory stays constant; states are written while the next ones are computed. After any
    interruption (a signal, ``kill -9``, a power cut, a full disk) the store is whole up to its last
    commit, a few seconds ago, and ``resume=True`` resumes there: compensation terms, the
    predictor's history and the running record are stored, so the result has the bits of an
    uninterrupted run.

    Parameters
    ----------
    stepper : Stepper
    start, p, dt, t_end, steps, parameters, every, events, solver, progress
        As for ``Stepper.integrate``. Events are in ``Recording.events``, with the bits of
        ``integrate``; a run that an event has ended is not continued.
    out : path
        The store, a folder; by custom its name ends in ``.zarr``.
    resume : bool
        Resume the run in ``out``; begin it if there is none. It may be given more steps than
        before, finished or not.
    seed : int, optional
        Of the random numbers that made this start, if it was drawn: stored with the run, not used.

    Returns
    -------
    Recording

    Raises
    ------
    InputError
        If the store exists and ``resume`` is not set, or holds another run.
    StorageError
        If the store cannot be written, or another process writes to it.
    StepFailed
        When a step finds no solution; everything before it is in the store.
    Stopped
        After SIGINT, SIGTERM or SIGHUP, with everything computed in the store.
    """
    if not isinstance(stepper, Stepper):
        raise InputError(f"stepper = {shown(stepper)} is no stepper; make one with "
                         "gyrospark.stepper.")
    as_flag("resume", resume)
    state = merged_start(stepper, start, p, parameters)
    run = stepper.resolved(stepper.run_arguments(
        state.q, state.p, dt=dt, steps=step_count(steps, t_end, state.t, dt), every=every,
        parameters=state.parameters, t0=state.t, solver=solver))
    path, drawn = new_store_path(out, _AS_FILE), _as_seed(seed)
    as_progress(progress)
    asked = as_events(events, stepper.manifest["system"])
    refuse_unusable_names(asked, "arrays of a store")
    warned = stepper.warned(run)
    with writer_lock(path):
        group = _opened(stepper, run, asked, path, resume, drawn)
        if group.attrs["status"] == RUNNING:
            with log_progress(f"recording {stepper.name}", run.steps, progress) as report:
                Recorder(stepper, run, asked, path, group).run_to_end(report)
    recording = Recording(path)
    if recording.status != COMPLETE and not recording.status.startswith(ENDED):
        raise recording.failure()
    if not warned:
        last = recording.trajectory(first=len(recording) - 1)
        stepper.rotations.warn(last.parameters, last.dt, last.q, last.p)
    return recording


def _opened(
    stepper: Stepper, run: RunArguments, events: tuple[Event, ...], path: Path, resume: bool,
    seed: int | None,
) -> zarr.Group:
    """Return the store's group, existing or new."""
    identity = identity_of(stepper, run, events)
    if not is_new(path, resume, "run"):
        return _existing_group(stepper, run, path, identity)
    about = _run_attributes(stepper, run, identity) | {
        **({"events": dict.fromkeys(identity["events"], 0)} if events else {}),
        "steps_done": 0,
        "seed": seed,
        "versions": versions(),
        "manifest": stepper.manifest,
    }
    with storage_errors(path, _NEW):
        with created_atomically(path) as fresh:
            create(fresh, fields_of(stepper.manifest), run.rows + 1,
                   checkpoint_size(stepper.binding, len(events)), about,
                   {one.name: fields_of_event(stepper.manifest, one.name) for one in events})
        return open_group(path, write=True)


def _existing_group(
    stepper: Stepper, run: RunArguments, path: Path, identity: dict[str, Any]
) -> zarr.Group:
    """Return the group of an existing store of this run, or of its first steps."""
    kept = Recording(path)
    begun = kept.attributes["run"]
    longer = run.steps > begun["steps"] and not kept.status.startswith(FAILED)
    refuse_if_different(begun | ({"steps": run.steps} if longer else {}), identity,
                        f"The store {str(path)!r}")
    if kept.status.startswith(ENDED):
        return kept.group()
    fields = fields_of(stepper.manifest)
    checkpoint = checkpoint_size(stepper.binding, len(kept.attributes["events"]))
    rows, coming = kept.rows, kept.attributes.get(EXTENDS)
    of_events = [one for name in kept.attributes["events"]
                 for one in fields_of_event(stepper.manifest, name)]
    with storage_errors(path, CURE):
        refuse_other_arrays(path, kept.group(), fields, {rows, coming or rows}, checkpoint,
                            of_events)
        if longer or coming is not None:
            extend(path, kept.attributes["arrays"], run.rows + 1,
                   _run_attributes(stepper, run, identity, kept) if longer else {})
        remove_parts(path)
        return kept.group(write=True)


def _run_attributes(
    stepper: Stepper, run: RunArguments, identity: dict[str, Any], kept: Recording | None = None
) -> dict[str, Any]:
    """Return the attributes of a new run, or of one with more steps than ``kept``.

    A last state off the storage interval does not belong to the longer run.
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
