"""Where the states of ``gyrospark run`` go: memory and a file, or a store that they stream to."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import GyrosparkError, InputError, StepFailed, Stopped
from ...core.event import Event, Impact, as_events, as_impacts, event_of_text
from ...core.file_formats import ending_of, endings, format_of
from ...runtime.plotting.show import ENDINGS
from ..options import check_ending, check_film, check_picture, check_writable
from .choices import steps_of

if TYPE_CHECKING:
    from ...core.start import Start
    from ...runtime.results.trajectory import Trajectory
    from ...runtime.steppers.stepper import Stepper

__all__ = ["RunOutcome", "check_targets", "events_of", "integrate_to", "stored_location"]

#: States in memory for pictures and errors of a stored run: more are not distinguishable.
_SHOWN = 20_000


@dataclass(frozen=True)
class RunOutcome:
    """Finished or interrupted run, with the written file.

    Attributes
    ----------
    trajectory : Trajectory
        All states, or of a stored run a selection for pictures; its report is of every step.
    last : Trajectory
        Ends with the last stored state.
    seconds : float
        The integration took.
    steps : int
        Steps of this call; a resumed run has the steps of earlier calls besides.
    out : str or None
        What was written.
    trouble : Exception or None
        Why it ended early, or what could not be written.
    ended_by : str or None
        The event that ended it.
    """

    trajectory: Trajectory
    last: Trajectory
    seconds: float
    steps: int
    out: str | None
    trouble: GyrosparkError | Stopped | None
    ended_by: str | None = None


def check_targets(
    out: Path | None, plot: Path | None, show: Sequence[Path], *, resume: bool
) -> None:
    """Refuse unwritable files before a long run: states, pictures, and what shows the bodies."""
    if out is not None:
        check_writable("--out", out, folder=_is_store(out))
        check_ending("--out", out, endings("states", "store"))
    if plot is not None:
        check_picture(plot)
    for path in show:
        check_writable("--show", path)
        check_ending("--show", path, [*ENDINGS])
        if ending_of(path) in endings("film"):
            check_film(path)
    # the endings of --out are others
    pictures = [path.resolve() for path in (*show, *([] if plot is None else [plot]))]
    for path in pictures:
        if pictures.count(path) > 1:
            raise InputError(f"--plot and --show are to write one file, {path.name!r}, more than "
                             "once; give each a name of its own.")
    if resume and not _is_store(out):
        raise InputError("--resume continues a stored run; give its store, --out NAME.zarr. "
                         "gyrospark export NAME.zarr NAME.csv then makes a table of it.")
    if out is not None:
        if _is_store(out):
            import_module("...storage", __package__)  # says which package is missing
        format_of(out, "A run", "states", "store").require_packages()


def events_of(
    texts: tuple[str, ...], model_events: Sequence[Event | Impact], step: Stepper
) -> dict[str, Any]:
    """Return {"events": ...}, the model's own and those of --event; {} without --event."""
    if not texts:
        return {}
    events = [*model_events, *map(_parse_event, texts)]
    names = step.manifest.system.event_quantities
    return {"events": as_impacts(events, names) or as_events(events, names)}


def _parse_event(text: str) -> Event:
    """Return the event that "height=0 down" says, or with a name "landing: height=0 down"."""
    from ...generator.models.toml_tables import number_of_text

    name, colon, condition = text.partition(":")
    return event_of_text(condition if colon else text, name.strip() if colon else "",
                         number_of_text)


def _is_store(out: Path | None) -> bool:
    """Return whether a path, which may be None, names a store of a run."""
    return out is not None and ending_of(out) in endings("store")


def integrate_to(
    step: Stepper, start: Start, out: Path | None, arguments: dict[str, Any], *, resume: bool,
) -> RunOutcome:
    """Integrate and write the states; an error comes with all states before it."""
    if out is not None and _is_store(out):
        return _integrate_into_store(step, start, out, arguments, resume=resume)
    return _integrate_in_memory(step, start, out, arguments)


def stored_location(out: Path | None) -> str:
    """Return a sentence on the store of an interrupted run; empty where there is none."""
    if out is None or not (_is_store(out) and out.exists()):
        return ""
    return f"What is stored in {str(out)!r} is whole: the same command with --resume goes on."


def _integrate_in_memory(
    step: Stepper, start: Start, out: Path | None, arguments: dict[str, Any],
) -> RunOutcome:
    """Integrate in memory and write ``out``; return the outcome with the error that ended the run.
    """
    trouble: GyrosparkError | Stopped | None = None
    saved_path = None
    started = time.perf_counter()
    try:
        trajectory = step.integrate(start, **arguments)
    except (StepFailed, Stopped) as error:
        if error.trajectory is None:  # a pilot run was stopped, and none of this one is done
            raise
        trouble, trajectory = error, error.trajectory
    seconds = time.perf_counter() - started
    try:
        if out is not None:
            saved_path = str(trajectory.save(out))
    except GyrosparkError as error:  # the disk is full, say: the numbers are still printed
        trouble = trouble or error
    count = steps_of(arguments, start.t, arguments.get("dt"))
    if isinstance(trouble, Stopped) and count:
        trouble = _with_location(trouble, trajectory.report.steps, count, saved_path)
    return RunOutcome(trajectory, last=trajectory, seconds=seconds, steps=trajectory.report.steps,
                      out=saved_path, trouble=trouble, ended_by=trajectory._ended_by)


def _with_location(
    stopped: Stopped, steps_done: int, steps: int, saved_path: str | None
) -> Stopped:
    """Return the error of an interrupted run of ``steps`` steps with the location of its states."""
    from ...runtime.integration.step_loop import ended_at

    location = "--out would keep its states." if saved_path is None else f"It is in {saved_path!r}."
    if steps_done < steps and saved_path is not None:
        location = f"Everything up to there is in {saved_path!r}."
    return Stopped(f"{ended_at(steps_done, steps)} {location}", stopped.signal)


def _integrate_into_store(
    step: Stepper, start: Start, store: Path, arguments: dict[str, Any], *, resume: bool,
) -> RunOutcome:
    """Integrate into a store, or resume it; return the outcome with the error that ended the run.
    """
    from ...runtime.integration.starts import Span
    from ...storage.recording import Recording, open_recording

    before = open_recording(store).steps_done if resume and store.exists() else 0
    trouble: GyrosparkError | Stopped | None = None
    started = time.perf_counter()
    try:
        span = Span(*(arguments.get(name) for name in Span._fields))
        other_arguments = {name: arguments[name] for name in arguments.keys() - {*Span._fields}}
        recording = step._record(step._integration(start, None, span, **other_arguments), store,
                                 resume=resume)
    except (StepFailed, Stopped) as error:
        trouble, recording = error, open_recording(store)
    assert isinstance(recording, Recording)
    seconds = time.perf_counter() - started
    # a sample of a long run, for plots: the stride is rounded up
    sampled_states = recording[:: -(-len(recording) // _SHOWN)]
    last_state = recording[-1:]
    return RunOutcome(sampled_states, last_state, seconds, steps=recording.steps_done - before,
                      out=str(store), trouble=trouble, ended_by=recording.ended_by)
