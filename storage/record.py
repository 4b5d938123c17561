"""Recording a run: begins its store, or resumes it; ``recorder`` computes.

At every instant the store holds a run up to some commit. The record has the
bits of ``Stepper.integrate``, for any number of interruptions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import zarr

from ..core.arguments import count_text
from ..core.errors import InputError
from ..core.event import Event, Impact, refuse_unusable_names
from ..core.exact_numbers import Number
from ..core.progress import Progress, as_progress, log_progress
from ..core.records import replace_fields
from ..core.solver import Solver
from ..runtime.bindings.array_checks import as_real
from ..runtime.bindings.real_numbers import from_text
from ..runtime.events.impact_observer import refuse_unusable
from ..runtime.integration.run_arguments import RunArguments, StartNumbers, span_of
from ..runtime.results.rotation_rate import LOOKED_AT
from ..runtime.steppers.stepper import Stepper
from .array_layout import (
    EXTENDS,
    create,
    extend,
    fields_of,
    fields_of_events,
    open_group,
)
from .checkpoint import checkpoint_size
from .durable_files import new_store_path, remove_parts, storage_errors
from .identity import identity_of, refuse_if_different, versions
from .recorder import Recorder
from .recording import Recording, events_in, group_of, open_recording, source_of
from .staging import created_atomically, is_new, writer_lock
from .validation import COMPLETE, ENDED, FAILED, RUNNING, refuse_other_arrays
from .writer import CURE

__all__ = ["record", "resume"]

#: Cure where a store cannot be made.
_NEW = "Nothing is stored yet: free some space, or choose another place."
#: How to make a file of a stored run.
_AS_FILE = "The run is then written by run.save('run.csv')."


def record(
    stepper: Stepper, run: RunArguments, events: tuple[Event | Impact, ...], out: str | Path, *,
    resume: bool = False, progress: Progress = None,
) -> Recording:
    """Stream the states of a checked run to a Zarr store; see ``Stepper.integrate(..., out=...)``.

    Parameters
    ----------
    resume : bool
        Resume the run in the store; begin it if there is none. It may have more steps than before,
        finished or not.

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
    path = new_store_path(out, _AS_FILE)
    as_progress(progress)
    if impacts := tuple(event for event in events if isinstance(event, Impact)):
        refuse_unusable(stepper, run, impacts)
    refuse_unusable_names(events, "arrays of a store")
    warned = stepper._warn(run)
    with writer_lock(path):
        group = _open(stepper, run, events, path, resume)
        if group.attrs["status"] == RUNNING:
            with log_progress(f"recording {stepper.name}", run.steps, progress) as report:
                Recorder(stepper, run, events, path, group).run_to_end(report)
    recording = replace_fields(Recording.read(path), _stepper=stepper)
    if recording.status != COMPLETE and not recording.status.startswith(ENDED):
        raise recording.failure()
    if not warned:
        count = len(recording)
        stride = math.ceil(count / LOOKED_AT)  # a sample of the rows, the last one included
        rows = recording._in_memory(range((count - 1) % stride, count, stride))
        stepper.rotations.warn(rows.parameters, rows.time_steps, rows.q, rows.p)
    return recording


def resume(
    path: str | Path, *, t_end: Number | None = None, steps: int | None = None,
    progress: Progress = None,
) -> Recording:
    """Resume the run in a store, to the bits of a run that was never interrupted.

    The store has the source of the stepper; compensation terms, the predictor's history and the
    running record are read from its last commit.

    Parameters
    ----------
    path : path
        The store that ``integrate(..., out=...)`` or ``gyrospark run --out X.zarr`` began.
    t_end, steps : number, int
        A later end of the run, as for ``Stepper.integrate``; by default its end stays as it is.
    progress : callable or bool, optional
        As of ``Stepper.integrate``.

    Raises
    ------
    InputError
        If there is no such run; with fewer steps than before; where compiler, flags or version
        differ from those that began it.
    StorageError, StepFailed, Stopped
        As of ``Stepper.integrate``.
    """
    recording = open_recording(path)
    stepper, about = recording.stepper, recording.attributes["run"]
    if stepper.binding.clocked and t_end is not None:
        raise InputError("Steps in scaled time adapt; give steps in place of t_end.")
    number = partial(from_text, real=recording.manifest.real)
    count, rest = about["steps"], number(about.get("rest", 0.0))
    end = number(about["t_end"]) if "t_end" in about else None
    if t_end is not None or steps is not None:
        count, remainder = span_of(steps, t_end, number(about["t0"]), number(about["dt"]))
        rest = stepper.binding.number(remainder)
        end = as_real("t_end", t_end, stepper.binding.number) if remainder else None
    run = replace(_stored_arguments(stepper, about, count), rest=rest, t_end=end)
    return record(stepper, run, events_in(about), path, resume=True, progress=progress)


def _stored_arguments(stepper: Stepper, about: Mapping[str, Any], steps: int) -> RunArguments:
    """Return the arguments of a stored run for ``steps`` steps.

    ``about`` is its identity, whose numbers are texts where a double does not hold their digits.
    """
    number = partial(from_text, real=stepper.manifest.real)
    parameters = {name: number(x) for name, x in about["parameters"].items()}
    if "frame" in about:  # the rates are chosen along the run
        for symmetry in stepper.symmetries:
            parameters.pop(symmetry.name, None)
        parameters["frame"] = about["frame"]
    tolerance = None if about["tolerance"] is None else number(about["tolerance"])
    n, q0, p0 = stepper.n, [number(x) for x in about["q0"]], [number(x) for x in about["p0"]]
    # in scaled time t and −H are behind the coordinates and momenta
    t0 = q0[n] if q0[n:] else number(about["t0"])
    run = stepper._resolve(stepper._run_arguments(
        StartNumbers(q0[:n], p0[:n], parameters, t0), dt=number(about["dt"]), steps=steps,
        every=about["every"],
        solver=Solver(about["solver"], tolerance, about["max_iterations"]), scaled=True))
    run.p[n:] = p0[n:]  # −H of the start as it was stored, not as it is computed here
    return run


def _open(
    stepper: Stepper, run: RunArguments, events: tuple[Event | Impact, ...], path: Path,
    resume: bool,
) -> zarr.Group:
    """Return the store's group, existing or new.

    An existing one is opened with ``resume`` alone, and only if it is of this run.
    """
    identity = identity_of(stepper, run, events)
    if not is_new(path, resume, "run"):
        return _existing_group(stepper, run, events, path, identity)
    about = _run_attributes(stepper, run, identity) | {
        # the number of crossings of each event
        **({"events": dict.fromkeys(identity["events"], 0)} if events else {}),
        "steps_done": 0,
        "versions": versions(),
        "manifest": stepper.manifest.as_json(),
    }
    with storage_errors(path, _NEW):
        # a killed process leaves no store in part
        with created_atomically(path) as fresh:
            create(fresh, fields_of(stepper.manifest), rows=run.stored_states,
                   checkpoint_bytes=checkpoint_size(stepper.binding, events), attributes=about,
                   events=fields_of_events(stepper.manifest, identity.get("events", {})),
                   source=source_of(stepper, any(isinstance(event, Impact) for event in events)))
        return open_group(path, write=True)


def _existing_group(
    stepper: Stepper, run: RunArguments, events: tuple[Event | Impact, ...], path: Path,
    identity: dict[str, Any]
) -> zarr.Group:
    """Return the group of an existing store of the run, or of its first steps.

    ``identity`` determines the bits of the run; a longer run extends the store's arrays.
    """
    recording = Recording.read(path)
    stored_run = recording.attributes["run"]
    stored_rest = float(from_text(stored_run.get("rest", 0.0), recording.manifest.real))
    # by whole steps, or by the last part of a step behind as many
    # a run that failed is not extended
    longer = (run.steps, abs(float(run.rest))) > (stored_run["steps"], abs(stored_rest)) and not (
        recording.status.startswith(FAILED))
    expected = dict(stored_run)
    if longer:  # it may differ in its end alone
        for name in ("steps", "t_end", "rest"):
            expected.pop(name, None)
            if name in identity:
                expected[name] = identity[name]
    refuse_if_different(expected, identity, f"The store {str(path)!r}")
    if recording.status.startswith(ENDED):  # a terminal event: there is nothing to go on with
        return group_of(path)
    fields = fields_of(stepper.manifest)
    checkpoint = checkpoint_size(stepper.binding, events)
    # ``planned_rows``: an extension was interrupted, and some arrays have their new rows already
    rows, planned_rows = recording.rows, recording.attributes.get(EXTENDS)
    event_fields = list(chain.from_iterable(fields_of_events(
        stepper.manifest, identity.get("events", {})).values()))
    with storage_errors(path, CURE):
        refuse_other_arrays(path, group_of(path), fields, {rows, planned_rows or rows}, checkpoint,
                            event_fields)
        if longer or planned_rows is not None:
            extend(path, recording.attributes["arrays"], run.stored_states,
                   _run_attributes(stepper, run, identity, recording) if longer else {})
        remove_parts(path)
        return group_of(path, write=True)


def _run_attributes(
    stepper: Stepper, run: RunArguments, identity: dict[str, Any],
    recording: Recording | None = None
) -> dict[str, Any]:
    """Return the attributes of a new run, or of one with more steps than ``recording``.

    A last state off the storage interval does not belong to the longer run, nor do the events of
    a last part of a step, which its next step finds again.
    """
    begun = recording is not None and recording.report is not None
    counts = {} if recording is None else recording._events_to_resume(stepper.binding)
    return {
        **({"events": counts} if counts else {}),
        "title": f"{stepper.name}: {count_text(run.steps, 'step')} of {float(run.dt):g} s"
                 + (f", to {float(run.t_end):g} s" if run.rest else ""),
        "status": RUNNING,
        "states": recording.steps_done // run.every + 1 if recording is not None and begun else 0,
        "run": identity,
    }
