"""An ensemble as arrays with names: an xarray Dataset and files, by trajectory and state."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..._version import __version__
from ...core.arguments import as_path
from ...core.errors import MissingDependencyError
from ...core.event import Event, refuse_unusable_names
from ...core.extras import install
from ...core.file_formats import format_of, result_file
from .run_arrays import OUTPUTS, about, labels_of, parts
from .state_columns import event_headings, events_path, headings, states_of, write_csv
from .trajectory_file import storable

if TYPE_CHECKING:
    import xarray

    from ..steppers.ensemble import Ensemble
    from .trajectory import Trajectory

__all__ = ["save", "to_xarray"]

Array = NDArray[Any]
#: Name → dimensions, values, attributes (long name, units).
Variables = dict[str, tuple[list[str], Array, dict[str, str]]]


def to_xarray(ensemble: Ensemble) -> xarray.Dataset:
    """Return an ensemble as an xarray Dataset; see ``Ensemble.to_xarray``."""
    try:
        import xarray
    except ImportError as error:
        raise MissingDependencyError(
            f"Datasets need xarray; {install('storage')} brings it."
        ) from error
    variables, of_runs = _variables(ensemble), _of_trajectories(ensemble)
    system = ensemble.members[0].manifest["system"]
    used = {dimension for dimensions, *_ in variables.values() for dimension in dimensions}
    names = {key: (key, found, {"long_name": meaning})
             for key, (found, meaning) in labels_of(system).items() if key in used}
    coordinates = {"trajectory": np.arange(len(ensemble)), "time": variables.pop("time"),
                   **of_runs, **names}
    return xarray.Dataset(variables, coordinates, _attributes(ensemble))


def save(ensemble: Ensemble, path: Any) -> Path:
    """Write an ensemble to a file; see ``Ensemble.save``."""
    target = as_path("path", path, "ensemble.npz")
    form = format_of(target, "An ensemble", "states")
    write = form.writer("ensemble")
    form.require_packages()
    if ensemble.events and form.tabular:
        with result_file(events_path(target), "The ensemble") as part:
            _write_events(ensemble, part)
    with result_file(target, "The ensemble") as part:
        write(ensemble, part)
    return target


def write_npz(ensemble: Ensemble, part: Path) -> None:
    """Write all arrays with all their digits under the names of the Dataset's variables."""
    arrays = {name: storable(values) for name, (_, values, _) in
              (_variables(ensemble) | _of_trajectories(ensemble)).items()}
    told = json.dumps(_attributes(ensemble) | {"manifest": ensemble.members[0].manifest})
    with part.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, about=np.array(told), **arrays)


def write_csv_rows(ensemble: Ensemble, part: Path) -> None:
    """Write a row for each state, those of a trajectory one behind the other."""
    first = states_of(ensemble.members[0])
    titles = headings(ensemble.members[0].manifest["system"],
                      {"trajectory": ()} | {name: x.shape[1:] for name, x in first.items()})
    write_csv(part, titles, ([np.full(len(one), i), *states_of(one).values()]
                             for i, one in enumerate(ensemble.members)))


def _write_events(ensemble: Ensemble, part: Path) -> None:
    """Write the events to a second file, with the number of the trajectory of each."""
    write_csv(part, ["trajectory", *event_headings(ensemble.members[0].manifest["system"])], (
        [np.full(len(found), i), np.full(len(found), name), found.t, found.q, found.p,
         found.steps, found.rising.astype(int), found.elapsed]
        for name, events in ensemble.events.items()
        for i, found in enumerate(map(events.__getitem__, range(len(events))))))


def write_netcdf(ensemble: Ensemble, part: Path) -> None:
    """Write the Dataset, in doubles where numbers are wider."""
    refuse_unusable_names([Event(name) for name in ensemble.events], "arrays of the file")
    dataset = to_xarray(ensemble)
    for name, values in dataset.variables.items():
        if values.dtype in (np.dtype(object), np.dtype(np.longdouble)):
            dataset[name] = values.astype(float)
    dataset.to_netcdf(part, engine="h5netcdf")


def _attributes(ensemble: Ensemble) -> dict[str, Any]:
    first = ensemble.members[0]
    return {"stepper": first.manifest["name"], "gyrospark": __version__, "every": first.every}


def _variables(ensemble: Ensemble) -> Variables:
    """Return the outputs of all members, nothing (NaN, 0) behind their ends; then the events."""
    members, manifest = ensemble.members, ensemble.members[0].manifest
    states = [states_of(one) for one in members]
    found: Variables = {}
    for one in OUTPUTS:
        inner = [dimension for dimension, _ in one.inner(manifest) or ()] if not one.split else []
        for name in parts(one, manifest):
            found[name] = (["trajectory", "state", *inner],
                           _together([rows[name] for rows in states], ensemble.t.shape[1]),
                           about(one, manifest, name))
    for number, (name, events) in enumerate(ensemble.events.items()):
        along, each = f"event_{name}", [events[i] for i in range(len(ensemble))]
        told = {"long_name": f"of event {number}, {name}"}
        found[f"{along}_trajectory"] = (
            [along], np.repeat(np.arange(len(each)), events.count), told)
        for part, inner in (("t", []), ("q", ["coordinate"]), ("p", ["coordinate"]),
                            ("steps", []), ("rising", []), ("elapsed", [])):
            found[f"{along}_{part}"] = ([along, *inner], np.concatenate(
                [getattr(crossings, part) for crossings in each]), told)
    return found


def _together(rows: list[Array], length: int) -> Array:
    """Return rows of several lengths as one array."""
    first = rows[0]
    whole = first.dtype.kind in "iu"
    nothing = 0 if whole else np.nan if first.dtype != object else 0 * first.flat[0] + np.nan
    made = np.full((len(rows), length, *first.shape[1:]), nothing, first.dtype)
    for i, values in enumerate(rows):
        made[i, : len(values)] = values
    return made


def _of_trajectories(ensemble: Ensemble) -> Variables:
    """Return the variables with one value a trajectory: dt, parameters, status."""
    members = ensemble.members
    number = members[0].t.dtype
    found: Variables = {
        "dt": (["trajectory"], np.array([one.dt for one in members], number),
               {"long_name": "time step", "units": "s"}),
        "status": (["trajectory"], np.array([_status(ensemble, i, one)
                                             for i, one in enumerate(members)], dtype=str),
                   {"long_name": "complete, stopped, or why a step failed"}),
        "steps": (["trajectory"], np.array([one.report.steps for one in members]),
                  {"long_name": "steps done"}),
    }
    for name in members[0].parameters:
        found[f"parameter_{name}"] = (
            ["trajectory"], np.array([one.parameters[name] for one in members], number),
            {"long_name": f"parameter {name}"})
    return found


def _status(ensemble: Ensemble, i: int, member: Trajectory) -> str:
    if i in ensemble.failures:
        return str(ensemble.failures[i].reason)
    return "complete" if len(member) == ensemble.t.shape[1] else "stopped"
