"""Validation of a store: its attributes are complete and match its arrays.

A store may come from another version, a disk that loses bytes, or an editor. A store refused here
would otherwise cause an obscure error later, or a wrong number.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zarr

from .._version import __version__
from ..core.arrays import Array
from ..core.errors import InputError
from ..core.event import impacts_of_json
from ..core.json_records import UnfitError
from ..core.manifest import Manifest
from ..core.real_types import RealName
from ..runtime.bindings.real_numbers import from_bytes, from_text
from ..runtime.compilation.manifest import parse_manifest
from ..runtime.results.diagnostics import Report, known_fields
from .array_layout import (
    CHECKPOINT,
    EXTENDS,
    StoredField,
    array_of,
    attributes_of,
    fields_of_events,
    names_of,
    wide_name,
)
from .durable_files import one_line
from .identity import FORMAT, written_by

__all__ = ["COMPLETE", "ENDED", "FAILED", "RUNNING", "UNREADABLE", "checked_attributes",
           "refuse_missing_blocks", "refuse_other_arrays", "rows_of", "stored_values"]

RUNNING = "running"
COMPLETE = "complete"
#: Beginning of the status of a run with a step without a solution.
FAILED = "failed: "
#: Beginning of the status of a run ended by an event; its name follows.
ENDED = "ended: "

#: Errors of Zarr for unreadable files; RuntimeError for endless brackets.
UNREADABLE = (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError, OverflowError)

_CURE = "restore it from a copy, or compute the run anew in another store."


def checked_attributes(path: Path, group: zarr.Group) -> dict[str, Any]:
    """Return the attributes of a store, checked.

    Raises InputError if they are incomplete or inconsistent, or of an unknown format.
    """
    about = {"events": {}} | attributes_of(group)
    run = about.get("run")
    if not isinstance(run, Mapping) or "format" not in run:
        if "sweep" in about:
            raise InputError(f"{str(path)!r} is a sweep, not a run; gs.load_sweep reads it.")
        raise InputError(f"{str(path)!r} is not a run that gyrospark stored, or damaged: what it "
                         "says of itself is missing; give a folder that `gyrospark run --out "
                         "X.zarr` made.")
    writer = run.get("gyrospark")
    if run["format"] != FORMAT:
        raise written_by(path, writer, f"its format is {run['format']}, and {FORMAT} is known here")
    if complaint := _complaint(about, run, group):
        raise (_damage(path, complaint) if writer in (None, __version__) else
               written_by(path, writer, complaint))
    return about


def _complaint(about: dict[str, Any], run: Mapping[str, Any], group: zarr.Group) -> str:
    """Return the first complaint, empty without one; each check relies on those before it.

    ``about`` are all attributes of the store, ``run`` the arguments of the run among them.
    """
    return (_check_manifest(about) or _check_run(run, about["manifest"]["real"])
            or _check_events(about, run, group) or _check_run_attributes(about, run)
            or _check_arrays(about, group))


def _damage(path: Path, complaint: str) -> InputError:
    """Return the error for a store with a fault, which completes "The store ... is damaged"."""
    return InputError(f"The store {str(path)!r} is damaged: {complaint}; {_CURE}")


def _is_count(value: Any, lower_bound: int) -> bool:
    """Whether a value of JSON is an integer, not below the bound; true and 1.0 are none."""
    return type(value) is int and value >= lower_bound


def _is_number(value: Any, real: RealName = "double") -> bool:
    """Whether a value of JSON is a stored number; of a wide type it may be text."""
    try:
        from_text(value, real)
    except ValueError:
        return False
    return True


def _check_run(run: Mapping[str, Any], real: RealName) -> str:
    """Return a complaint about the run's arguments."""
    for name, lower_bound in (("steps", 0), ("every", 1), ("rows", 1)):
        if name == "rows" and name not in run:
            continue
        if not _is_count(run.get(name), lower_bound):
            return f"run.{name} is {run.get(name)!r}"
    for name in ("dt", "t0", *(("t_end", "rest") if "rest" in run else ())):
        if not _is_number(run.get(name), real):
            return f"run.{name} is {run.get(name)!r}"
    parameters = run.get("parameters")
    if not isinstance(parameters, Mapping) or not all(
            _is_number(x, real) for x in parameters.values()):
        return "run.parameters are no numbers"
    return ""


def _check_manifest(about: Mapping[str, Any]) -> str:
    """Return a complaint about a store's manifest."""
    if not isinstance(about.get("manifest"), Mapping):
        return "it has no manifest"
    try:
        parse_manifest(about["manifest"])
    except UnfitError as error:
        return f"of its manifest, {error}"
    return ""


def _check_run_attributes(about: Mapping[str, Any], run: Mapping[str, Any]) -> str:
    """Return a complaint about the progress of the run, "" if there is none."""
    steps_done, states, status = (about.get(name) for name in ("steps_done", "states", "status"))
    if not _is_count(steps_done, 0) or steps_done > run["steps"]:
        return f"steps_done is {steps_done!r}, of {run['steps']} steps"
    ended_by_event = isinstance(status, str) and status.startswith(ENDED)
    if not isinstance(status, str) or not (
            status in (RUNNING, COMPLETE) or status.startswith(FAILED) or ended_by_event):
        return f"status is {status!r}"
    if ended_by_event and not about["events"].get(status.removeprefix(ENDED)):
        return f"status is {status!r}, and that has not happened"
    # complete if all steps are done; but before the first commit no status is final, and after all
    # steps of a run with a ``rest`` its t_end may still be to be reached
    if (not ended_by_event and (status == COMPLETE) is not (steps_done == run["steps"])
            and about.get("report") is not None
            and not (steps_done == run["steps"] and "rest" in run)):
        return f"status is {status!r} after {steps_done} of {run['steps']} steps"
    # rows of the start, of every so many steps, and of a terminal event or the last step
    if about.get("report") is None:
        expected = steps_done  # before the first commit there are 0 steps and 0 rows
    elif steps_done == run["steps"] and (status == COMPLETE or "rest" not in run):
        expected = rows_of(run)
    else:
        expected = steps_done // run["every"] + 1 + ended_by_event
    if type(states) is not int or states != expected:
        return f"states is {states!r} after {steps_done} steps"
    return _check_report(about.get("report"))


def _check_events(about: dict[str, Any], run: Mapping[str, Any], group: zarr.Group) -> str:
    """Return a complaint about event counts and event arrays.

    ``about`` has the number of crossings of each event, ``run`` the attributes of the events.
    """
    requested, counts = run.get("events", {}), about["events"]
    if not isinstance(requested, Mapping) or not isinstance(counts, Mapping) or (
            requested.keys() != counts.keys()):
        return f"events are {counts!r}, and {requested!r} were asked for"
    if not all(isinstance(attributes, Mapping) for attributes in requested.values()):
        return f"run.events are {requested!r}"
    try:
        impacts_of_json(requested)
    except (InputError, KeyError, TypeError, ValueError, ArithmeticError):
        return f"run.events are {requested!r}"
    fields_by_name = fields_of_events(Manifest.from_json(about["manifest"]), requested)
    for name, count in counts.items():
        if not _is_count(count, 0):
            return f"events.{name} is {count!r}"
        for array_name in names_of(fields_by_name[name]):
            try:
                array = array_of(group, array_name)
            except UNREADABLE:
                return f"array {array_name!r} is missing or cannot be read"
            # rows behind the count are those of a commit that was interrupted
            if array.ndim == 0 or array.shape[0] < count:
                return f"array {array_name!r} has not {count} rows"
    return ""


def _check_report(report: Any) -> str:
    """Return a complaint about a report: missing fields, and values that are no numbers."""
    if report is None:
        return ""
    needed = {f.name for f in fields(Report) if f.default is MISSING}
    if not isinstance(report, Mapping) or not needed <= report.keys():
        return "its report is not complete"
    for name, field_value in known_fields(Report, report).items():
        # all other fields are one number
        is_state = name in ("q", "p") and isinstance(field_value, list)
        numbers = field_value if is_state else [field_value]
        if not all(map(_is_number, numbers)):
            return f"report.{name} is {field_value!r}"
    return ""


def rows_of(run: Mapping[str, Any]) -> int:
    """Return the number of states of the whole run from its attributes; a saved run has it there.
    """
    if "rows" in run:
        return int(run["rows"])
    if "rest" in run:  # the last row is the state at t_end
        return int(run["steps"]) // int(run["every"]) + 2
    # the start, every multiple of ``every``, and the last step in any case: rounded up
    return -(-int(run["steps"]) // int(run["every"])) + 1


def _check_arrays(about: Mapping[str, Any], group: zarr.Group) -> str:
    """Return a complaint about the arrays of every run, and those it names."""
    names, allowed_lengths = about.get("arrays"), {rows_of(about["run"]), about.get(EXTENDS)}
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return f"arrays are {names!r}"
    blocks = set()
    # every run has the first four
    for name in {"time", "q", "p", "energy", *names}:
        try:
            array = array_of(group, name)
        except UNREADABLE:
            return f"array {name!r} is missing or cannot be read"
        if array.ndim == 0 or array.shape[0] not in allowed_lengths:
            return f"array {name!r} has not {rows_of(about['run'])} rows"
        blocks.add(array.chunks[0])
    return "its arrays are not in blocks of the same rows" if len(blocks) > 1 else ""


class _Form(NamedTuple):
    """The form that an array of a store must have."""

    row_shape: tuple[int, ...]
    chunks: tuple[int, ...]
    dtype: np.dtype[Any]


def _forms_of(stored_field: StoredField, rows: int) -> dict[str, _Form]:
    """Return the forms of the arrays of a field, in chunks of ``rows``, by their names."""
    forms = {stored_field.name: _Form(
        stored_field.shape, (rows, *stored_field.shape), np.dtype(stored_field.dtype))}
    if stored_field.wide:  # all digits of wide numbers are in an array of bytes
        forms[wide_name(stored_field.name)] = _Form(
            stored_field.wide_shape, (rows, *stored_field.wide_shape), np.dtype("u1"))
    return forms


def refuse_other_arrays(
    path: Path, group: zarr.Group, fields: list[StoredField], row_counts: Collection[int],
    checkpoint_bytes: int,
    events: Iterable[StoredField] = (),
) -> None:
    """Refuse to resume a store whose arrays do not have the shapes and types of a run.

    ``row_counts`` are the allowed numbers of states, ``checkpoint_bytes`` the length of the
    checkpoint; arrays of ``events`` may have any length. Raises InputError.
    """
    block, about = array_of(group, "time").chunks[0], attributes_of(group)
    expected = {CHECKPOINT: _Form((), (checkpoint_bytes,), np.dtype("u1"))}
    for stored_field in fields:
        expected |= _forms_of(stored_field, block)
    for stored_field in events:
        expected |= _forms_of(stored_field, array_of(group, stored_field.name).chunks[0])
    growing = set(names_of(events))  # an event array has a row for each crossing
    for name, form in expected.items():
        lengths = {checkpoint_bytes} if name == CHECKPOINT else set(row_counts)
        try:
            array = array_of(group, name)
        except UNREADABLE:
            # an array that the store never had is missing since another version wrote it
            if name not in (*about["arrays"], CHECKPOINT):
                raise written_by(path, about["run"].get("gyrospark"),
                                 f"it has no array {name!r}") from None
            raise _damage(path, f"array {name!r} is missing or cannot be read") from None
        if name in growing:
            lengths = set(array.shape[:1])
        if (array.shape[:1] not in {(length,) for length in lengths}
                or (array.shape[1:], array.chunks, array.dtype) != form):
            raise _damage(path, f"array {name!r} has not the form of this run's")


def refuse_missing_blocks(
    path: Path, group: zarr.Group, first_row: int, states: int, names: Iterable[str] | None = None
) -> None:
    """Refuse to read rows whose files are missing: Zarr would silently return NaN for them.

    The rows are those from ``first_row`` on, before row ``states``; ``names`` are the names of
    arrays, by default of all arrays with one row per state. Raises InputError.
    """
    for name in attributes_of(group)["arrays"] if names is None else names:
        array = array_of(group, name)
        block, inner_index = array.chunks[0], (0,) * (array.ndim - 1)
        for block_index in range(first_row // block, -(-states // block)):
            key = array.metadata.encode_chunk_key((block_index, *inner_index))
            if not (path / name / key).is_file():
                raise _damage(path,
                              f"rows {block_index * block} and on of array {name!r} are missing")


def stored_values(
    array: zarr.Array[Any], first_row: int, count: int, wide: bool, dtype: Any
) -> Array:
    """Return ``count`` rows of an array; those of a ``wide`` array, bytes, as numbers of ``dtype``.

    Raises InputError if the stored array is damaged.
    """
    try:
        array_rows = np.asarray(array[first_row : first_row + count])
    except UNREADABLE as error:
        raise InputError(f"Array {array.name!r} of the store is damaged: {one_line(error)}."
                         ) from error
    return from_bytes(array_rows, dtype) if wide else array_rows
