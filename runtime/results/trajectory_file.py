"""Runs as .npz, with all digits, names, parameters, report and manifest; .npz and .nc are read."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._version import __version__
from ...core.arguments import join_or
from ...core.arrays import Array
from ...core.errors import ArgumentError, InputError
from ...core.event import impacts_as_json, impacts_of_json
from ...core.exact_numbers import digits_of
from ...core.file_formats import result_file
from ...core.json_records import UnfitError
from ...core.manifest import Manifest
from ...core.real_types import REALS, Real
from ...core.records import replace_fields
from ..bindings.real_numbers import from_bytes, from_text, without_padding
from ..compilation.manifest import parse_manifest
from .crossings import Impacts, of_columns
from .diagnostics import Report, known_fields
from .outputs import OUTPUTS, Output, absent, array_from_files, names_in_files
from .table import table_of_ensemble
from .tangent_rows import EventTangents, TangentRows

if TYPE_CHECKING:
    from ..steppers.ensemble import Ensemble
    from .trajectory import Trajectory

__all__ = ["load_netcdf", "load_npz", "save_ensemble", "save_npz"]

#: Rises with a change that older versions misread.
_FORMAT = 2
#: The arrays of an event.
_CROSSING = ("t", "q", "p", "steps", "rising", "elapsed")
#: The arrays of the impacts of a gap.
_COLUMNS = (*_CROSSING, "p_after", "impulse", "energy_lost", "work")
#: The arrays of tangents; "multipliers" where their derivatives were computed.
_TANGENTS = ("q", "p", "start", "t", "multipliers")
#: Arrays of names, for other readers of the file.
_LABELS = tuple(output.labels for output in OUTPUTS if output.labels)


def save_npz(trajectory: Trajectory, target: Path) -> Path:
    """Write a trajectory with all its arrays as .npz; return the path.

    NumPy has no float128: its numbers are stored as 16 bytes each.
    """
    about = {
        "format": _FORMAT,
        "dt": digits_of(trajectory.dt),
        "every": trajectory.every,
        "parameters": {name: digits_of(x) for name, x in trajectory.parameters.items()},
        "report": asdict(trajectory.report),
        "manifest": trajectory.manifest.as_json(),
        "events": list(trajectory.events),
        "impacts": impacts_as_json(trajectory._laws, trajectory.parameters),
        "tangents": [] if trajectory.tangents is None else trajectory.tangents.names,
        "switched_steps": getattr(trajectory.tangents, "switched_steps", 0),
        "refused_tangents": {} if trajectory.tangents is None
        else trajectory.tangents.events.refused,
    }
    # no pickles: a file is read without executing anything in it
    with result_file(target, "The trajectory") as partial_file, partial_file.open("wb") as file:
        np.savez_compressed(
            file, allow_pickle=False, about=np.array(json.dumps(about)),
            **{name: np.array(_names(trajectory.manifest, name), dtype=str) for name in _LABELS},
            **{output.attribute: storable(getattr(trajectory, output.attribute))
               for output in OUTPUTS},
            **{name: storable(array)
               for name, array in _arrays_of_events_and_tangents(trajectory).items()})
    return target


def _arrays_of_events_and_tangents(trajectory: Trajectory) -> dict[str, Array]:
    """Return the arrays of crossings and impacts, and of tangents, by their names in a file."""
    arrays = {f"event{i}_{name}": array
              for i, event_rows in enumerate((trajectory.events | trajectory.impacts).values())
              for name, array in event_rows.columns.items()}
    if trajectory.tangents is None:
        return arrays
    of_events = trajectory.tangents.events
    tangents = {"": trajectory.tangents} | {
        f"event{i}_": of_events[name] for i, name in enumerate(trajectory.events)
        if name in of_events}
    return arrays | {f"tangents_{prefix}{name}": array for prefix, rows in tangents.items()
                     for name in _TANGENTS if (array := getattr(rows, name)) is not None}


def save_ensemble(ensemble: Ensemble, target: Path) -> Path:
    """Write all arrays of an ensemble with all their digits, under the names of its table."""
    table = table_of_ensemble(ensemble)
    arrays = {name: storable(array) for part_table in (table, *table.parts)
              for name, array in part_table.in_memory().items()}
    with result_file(target, "The ensemble") as partial_file, partial_file.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, about=np.array(json.dumps(table.attributes)),
                            **arrays)
    return target


@contextlib.contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Turn any exception of a missing or damaged file into an ``InputError`` that names it."""
    try:
        yield
    except UnfitError as error:
        raise InputError(f"{str(path)!r} is no run that gyrospark saved, or damaged: of its "
                         f"manifest, {error}.") from error
    except ArgumentError as error:  # a report lacks an entry
        raise InputError(f"{str(path)!r} is no run that gyrospark saved, or damaged.") from error
    except InputError:
        raise
    except OSError as error:
        why = error.strerror or error
        raise InputError(f"{str(path)!r} cannot be read: {why}.") from error
    except Exception as error:  # a damaged zip file raises of ten kinds, zlib.error among them
        raise InputError(f"{str(path)!r} is no run that gyrospark saved, or damaged; the file of "
                         "an ensemble is read with numpy.load or xarray.open_dataset.") from error


def _checked_manifest(path: Path, about: Mapping[str, Any], file: Container[str]) -> Manifest:
    """Return the manifest of a file; refuse another format, and other outputs than this version's.
    """
    writer = about["manifest"]["generator"]
    if about["format"] != _FORMAT:
        raise InputError(f"{str(path)!r} was written by gyrospark {writer} in format "
                         f"{about['format']}; this is gyrospark {__version__}, which reads format "
                         f"{_FORMAT}.")
    manifest = parse_manifest(about["manifest"])
    # outputs that this version has and the file has not; without "t" it is no run at all
    missing_outputs = [output.attribute for output in OUTPUTS
                       if output.attribute not in file and names_in_files(output, manifest)]
    if missing_outputs and "t" in file:
        raise InputError(f"{str(path)!r} has no {join_or(missing_outputs)}: it was written by "
                         f"gyrospark {writer}, which knew other outputs than this gyrospark "
                         f"{__version__}, or is damaged. Run it again, or read it with numpy.load.")
    return manifest


def load_npz(path: Path) -> Trajectory:
    """Return the run in a file; nothing in it is executed.

    Raises InputError if the file is missing, damaged, of another kind, or of a version with other
    outputs.
    """
    with _readable(path):
        # Opened here because np.load leaves a damaged file open.
        with path.open("rb") as binary_file, np.load(binary_file, allow_pickle=False) as file:
            about = json.loads(str(file["about"]))
            about["manifest"] = _checked_manifest(path, about, file)
            arrays = {output.attribute: file[output.attribute] for output in OUTPUTS
                      if output.attribute in file}
            labels = {name: tuple(file[name].tolist()) for name in _LABELS if name in file}
            prefixes = {name: f"event{i}_" for i, name in enumerate(about.get("events", ()))}
            crossings = _event_arrays(prefixes, file, file.__getitem__)
            tangents = {prefix: {name: file[f"tangents_{prefix}{name}"] for name in _TANGENTS
                                 if f"tangents_{prefix}{name}" in file}
                        for prefix in ("", *prefixes.values())}
        return _trajectory(_fields(about, arrays, labels) | _events(about, crossings) | {
            "tangents": _tangents(about, tangents),
            "_laws": impacts_of_json(about.get("impacts", {}))})


def _netcdf_array(file: Any, real: Real, name: str) -> Array:
    """Return a variable of a NetCDF file, from its bytes if it has wide numbers."""
    if f"{name}_bytes" not in file.variables:
        return np.asarray(file.variables[name][...])
    stored_bytes = np.asarray(file.variables[f"{name}_bytes"][...])
    return stored_bytes if real.in_mpmath else from_bytes(stored_bytes, real.dtype)


def load_netcdf(path: Path) -> Trajectory:
    """Return the run in a NetCDF file, with all its digits; raises as ``load_npz``."""
    import h5netcdf

    with _readable(path), h5netcdf.File(path, "r") as file:
        run, report, content = (json.loads(file.attrs[name])
                                for name in ("run", "report", "manifest"))
        manifest = parse_manifest(content)
        about = {"dt": run["dt"], "every": run["every"], "parameters": run["parameters"],
                 "report": report, "manifest": manifest}
        real = REALS[manifest.real]
        read = partial(_netcdf_array, file, real)
        state_count = len(file.dimensions["time"])
        arrays = {}
        for output in OUTPUTS:
            if names := names_in_files(output, manifest):
                arrays_of_output = [read(name)[output.of_steps :] for name in names]
                arrays[output.attribute] = array_from_files(output, arrays_of_output, state_count,
                                                            real.dtype)
        # every event has a variable event_NAME_elapsed
        affixes = ("event_", "_elapsed")
        events = [name[len(affixes[0]) : -len(affixes[1])] for name in file.variables
                  if name.startswith(affixes[0]) and name.endswith(affixes[1])]
        crossings = _event_arrays({name: f"event_{name}_" for name in events}, file.variables, read)
        for columns in crossings.values():
            columns["rising"] = columns["rising"].astype(bool)
        # a stored run that was written as a file has them among its events
        laws = impacts_of_json(run.get("impacts", run.get("events", {})))
        return _trajectory(_fields(about, arrays, labels={}) | _events(about, crossings)
                           | {"_laws": laws})


def _event_arrays(
    prefixes: Mapping[str, str], stored_names: Container[str], read: Callable[[str], Array]
) -> dict[str, dict[str, Array]]:
    """Return the arrays of events in a file, event → column → array; impacts have more columns.

    ``prefixes`` are the beginnings of the names of an event's arrays; ``read`` returns the array of
    a name, and raises an error for a crossing's column that is not there.
    """
    arrays: dict[str, dict[str, Array]] = {}
    for event, prefix in prefixes.items():
        columns = [column for column in _COLUMNS
                   if column in _CROSSING or f"{prefix}{column}" in stored_names]
        arrays[event] = {column: read(f"{prefix}{column}") for column in columns}
    return arrays


def _trajectory(fields: dict[str, Any]) -> Trajectory:
    """Return the trajectory that the fields describe."""
    from .trajectory import Trajectory  # which imports this module

    return Trajectory(**fields)


def _fields(about: Any, arrays: dict[str, Array], labels: dict[str, tuple[str, ...]]
            ) -> dict[str, Any]:
    """Return the fields of a ``Trajectory``; raise ``ValueError`` for inconsistent ones.

    ``about`` is the file's JSON, ``arrays`` are its outputs by attribute, ``labels`` the names of
    columns, which must be those of the manifest.
    """
    manifest: Manifest = about["manifest"]
    real = manifest.real
    if REALS[real].in_mpmath:
        # files of version 0.1.0 have t in doubles
        in_double = {"t"} if arrays["t"].dtype.kind == "f" else set()
        arrays |= {output.attribute: _from_bytes(arrays[output.attribute]) for output in OUTPUTS
                   if output.attribute in arrays and not output.is_integer
                   and output.attribute not in in_double}
    # a file of an earlier version lacks outputs that the version did not know; ``load_npz`` has
    # checked that this system does not have them
    empty_arrays = {output.attribute: absent(output, len(arrays["t"]), arrays["q"].dtype)
                    for output in OUTPUTS}
    arrays = empty_arrays | arrays
    report = known_fields(Report, about["report"])
    report["q"], report["p"] = tuple(report["q"]), tuple(report["p"])
    fields = {"dt": from_text(about["dt"], real), "every": about["every"],
              "parameters": {k: from_text(x, real) for k, x in about["parameters"].items()},
              "report": Report(**report), "manifest": manifest}
    _check_consistency(arrays, fields)
    if any(_names(manifest, name) != stored_labels for name, stored_labels in labels.items()):
        raise ValueError("a column has two names")
    return arrays | fields


def _events(about: Any, crossings: dict[str, dict[str, Array]]) -> dict[str, Any]:
    """Return the fields ``events`` and ``impacts`` of a ``Trajectory``, by events' names.

    ``crossings`` maps each event to its arrays; one with ``p_after`` is of impacts, and is among
    the events too. Raises ``ValueError`` for arrays of inconsistent shapes or types.
    """
    in_binary128 = REALS[about["manifest"].real].in_mpmath
    n, events, impacts = len(about["manifest"].system.coordinates), {}, {}
    for name, columns in crossings.items():
        count = len(columns["t"])
        arrays = {column: _from_bytes(x) if in_binary128 and column not in ("steps", "rising")
                  else x for column, x in columns.items()}
        shapes = {column: (count, n) if column in ("q", "p", "p_after") else (count,)
                  for column in arrays}
        has_all_columns = len(arrays) in (len(_CROSSING), len(_COLUMNS))
        if not has_all_columns or any(x.shape != shapes[column] for column, x in arrays.items()):
            raise ValueError("an event has parts of several lengths")
        kinds = arrays["steps"].dtype.kind, arrays["rising"].dtype.kind
        if not isinstance(name, str) or kinds != ("i", "b"):
            raise ValueError("an event has parts of another type")
        events[name] = event_rows = of_columns(arrays)
        if isinstance(event_rows, Impacts):
            events[name], impacts[name] = event_rows.crossings, event_rows
    return {"events": events, "impacts": impacts}


def _tangents(about: Any, tangents: dict[str, dict[str, Array]]) -> TangentRows | None:
    """Return the tangents of a run and of its events, or None.

    ``tangents`` has their arrays by the prefix of an event, the run's by "". Raises ``ValueError``
    for arrays of inconsistent shapes.
    """
    if not about.get("tangents"):
        return None
    of_events = {name: _tangent_rows(about, tangents[f"event{i}_"])
                 for i, name in enumerate(about.get("events", ())) if tangents[f"event{i}_"]}
    reasons = {str(name): str(why) for name, why in about.get("refused_tangents", {}).items()}
    return replace_fields(_tangent_rows(about, tangents[""]),
                          events=EventTangents(of_events, reasons),
                          switched_steps=int(about.get("switched_steps", 0)))


def _tangent_rows(about: Any, arrays: dict[str, Array]) -> TangentRows:
    """Return tangents of rows.

    Of k directions: q and p (rows, n, k), start (2n, k), t (rows, k), multipliers
    (rows − 1, …, k).
    """
    in_binary128 = REALS[about["manifest"].real].in_mpmath
    numbers = {name: _from_bytes(x) if in_binary128 else x for name, x in arrays.items()}
    q, p, start, t = (numbers[name] for name in _TANGENTS[:4])
    multipliers = numbers.get("multipliers")
    n, names = len(about["manifest"].system.coordinates), about["tangents"]
    rows, k = q.shape[:1], len(names)
    shapes = {"q": (*rows, n, k), "p": (*rows, n, k), "start": (2 * n, k), "t": (*rows, k)}
    if any(numbers[name].shape != shape for name, shape in shapes.items()) or (
            multipliers is not None
            and (multipliers.shape[0] + 1, multipliers.shape[-1]) != (*rows, k)):
        raise ValueError("tangents have parts of several shapes")
    return TangentRows(q, p, [str(name) for name in names], start, t, multipliers=multipliers)


def _check_consistency(arrays: dict[str, Array], fields: dict[str, Any]) -> None:
    """Raise ``ValueError`` unless arrays, report and manifest fit together, as in a run."""
    manifest, report, state_count = fields["manifest"], asdict(fields["report"]), len(arrays["t"])
    for output in OUTPUTS:
        array, shape = arrays[output.attribute], _shape(output, manifest, state_count)
        if array.shape != shape:
            raise ValueError(f"{output.attribute} has another shape than {shape}")
        if array.dtype.kind not in ("iu" if output.is_integer else "fO"):
            raise ValueError(f"{output.attribute} has entries of another type")
    # anybody may have written the file: its JSON may have texts for numbers, or integers beyond
    # the 64 bits of C
    report_numbers = [*report.pop("q"), *report.pop("p"), *report.values()]
    counts = [report["steps"], report["iterations"], fields["every"]]
    if (not all(type(x) in (int, float) for x in report_numbers)
            or not all(type(x) is int for x in counts)
            or not all(abs(x) < 2**63 for x in report_numbers if type(x) is int)
            or fields["parameters"].keys() != manifest.system.parameters.keys()):
        raise ValueError("a number is of another type")


def _shape(output: Output, manifest: Manifest, state_count: int) -> tuple[int, ...]:
    """Return the shape of an output's array in a trajectory of ``state_count`` states."""
    inner_dimensions = output.inner(manifest)
    if output.split:
        return (state_count, len(_names(manifest, output.labels)))
    if inner_dimensions is None:
        return absent(output, state_count, float).shape
    return (max(state_count - output.of_steps, 0), *(length for _, length in inner_dimensions))


def _names(manifest: Manifest, labels: str) -> tuple[str, ...]:
    """Return the names along the last dimension of an output, by its entry in the manifest."""
    return tuple(getattr(manifest.system, labels))


def storable(array: Array) -> Array:
    """Return an array that NumPy can store: mpmath numbers as their bytes in binary128."""
    if array.dtype != object:
        return without_padding(array)
    from ..bindings.binary128 import to_bytes  # mpmath costs time, and only float128 needs it

    return to_bytes(array)


def _from_bytes(array: Array) -> Array:
    """Return the mpmath numbers that were stored as bytes."""
    from ..bindings.binary128 import from_bytes

    return from_bytes(array)
