"""A stored run, complete or not: its states for xarray, and as a ``Trajectory``."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import zarr
from numpy.typing import NDArray

from ..core.arguments import as_flag, as_path, listed
from ..core.calls import explain_arguments
from ..core.errors import InputError, StepFailed
from ..core.real_types import REALS
from ..runtime.bindings.array_checks import as_positive_count
from ..runtime.bindings.real_numbers import from_text
from ..runtime.results.crossings import Crossings
from ..runtime.results.diagnostics import Report, known_fields
from ..runtime.results.run_arrays import OUTPUTS, labels_of, parts, together
from ..runtime.results.trajectory import Trajectory
from .array_layout import array_of, fields_of_event, names_of, open_group, wide_name
from .durable_files import one_line, store_path
from .event_store import crossings_in
from .identity import written_by
from .validation import (
    FAILED,
    UNREADABLE,
    checked_attributes,
    refuse_missing_blocks,
    rows_of,
    stored_values,
)

if TYPE_CHECKING:
    import xarray

__all__ = ["Recording", "open_recording"]

Array = NDArray[Any]

#: States in the error of a failed run; the others are in the store.
_LAST = 4096


def open_recording(path: str | os.PathLike[str]) -> Recording:
    """Return the run that ``gyrospark.record`` or ``gyrospark run --out X.zarr`` stored.

    Raises
    ------
    InputError
        If there is none, or it is damaged.
    """
    return Recording(store_path(path))


@explain_arguments
class Recording:
    """A stored run.

    Attributes
    ----------
    path : Path
    status : str
        ``"complete"``, ``"running"`` (also of an interrupted run: it can be resumed),
        ``"ended: "`` and the name of the event that ended it, or ``"failed: "`` and the reason.
    steps_done : int
    states : int
        States that are stored, with the start.
    report : Report or None
        Diagnostics over every step so far; None before the first commit.
    attributes : dict
        Attributes of the store: run, manifest, versions, seed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._group = self.group()
        self.attributes = checked_attributes(path, self._group)
        self.status: str = self.attributes["status"]
        self.steps_done: int = self.attributes["steps_done"]
        self.states: int = self.attributes["states"]
        report = self.attributes.get("report")
        self.report = None if report is None else _report(report)

    def __repr__(self) -> str:
        of = self.attributes["run"]["steps"]
        return f"<Recording {str(self.path)!r}: {self.status}, {self.steps_done} of {of} steps>"

    def __len__(self) -> int:
        return self.states

    @property
    def rows(self) -> int:
        """How many states the whole run has, with the start."""
        return rows_of(self.attributes["run"])

    def group(self, *, write: bool = False) -> zarr.Group:
        """Return the Zarr group."""
        try:
            return open_group(self.path, write=write)
        except PermissionError as error:
            raise InputError(f"{str(self.path)!r} cannot be read: {error.strerror}.") from error
        except UNREADABLE as error:
            raise InputError(f"{str(self.path)!r} is not a run that gyrospark stored, or damaged; "
                             "give a folder that `gyrospark run --out X.zarr` made.") from error

    @property
    def events(self) -> dict[str, Crossings]:
        """Events found up to the last commit.

        ``events["height"].t``, ``.q``, ``.p``, as of a trajectory; read anew each time.
        """
        return crossings_in(self.path, self._group, self.attributes["manifest"],
                            self.attributes["events"])

    @property
    def dataset(self) -> xarray.Dataset:
        """The states as an xarray Dataset along ``time``; values are read when they are used.

        Coordinates go by their names: ``dataset.q.sel(coordinate="x")``, and so does the momentum
        that belongs to one. An event has ``event_height_t``, ``_q``, ``_p``, ``_steps`` and
        ``_rising`` along a dimension of its own.
        """
        import xarray

        refuse_missing_blocks(self.path, self._group, 0, self.states)
        try:  # reads the times
            whole = xarray.open_zarr(self.path)
        except UNREADABLE as error:
            raise InputError(f"{str(self.path)!r} is damaged: {one_line(error)}.") from error
        counts: dict[str, int] = self.attributes["events"]
        of_events = [one for name in counts for one in names_of(
            fields_of_event(self.attributes["manifest"], name))]
        kept: xarray.Dataset = whole[[*self.attributes["arrays"], *of_events]].isel(
            time=slice(0, self.states),
            **{f"event_{name}": slice(0, count) for name, count in counts.items()})
        return kept.assign_coords({
            dimension: (dimension, names, {"long_name": meaning})
            for dimension, (names, meaning) in labels_of(self.attributes["manifest"]["system"])
            .items() if dimension in kept.dims})

    def failure(self) -> StepFailed:
        """Return the error of a failed run; its trajectory has the last states."""
        run, real = self.attributes["run"], self.attributes["manifest"]["real"]
        t0, dt = (from_text(run[name], real) for name in ("t0", "dt"))
        first = max(0, self.states - _LAST)
        return StepFailed(step=self.steps_done + 1, t=float(t0 + self.steps_done * dt),
                          reason=self.status.removeprefix(FAILED),
                          trajectory=self.trajectory(first=first))

    def trajectory(self, *, first: int = 0, thin: int = 1) -> Trajectory:
        """Return the stored states, or every ``thin``-th from ``first`` on, in memory.

        Raises
        ------
        InputError
            Before the first commit, when nothing is stored; if a version with other outputs
            stored it.
        """
        if self.report is None:
            raise InputError(f"{str(self.path)!r} holds no state yet; resume its run first.")
        first = as_positive_count("first", first)
        thin = as_positive_count("thin", thin, least=1)
        group, manifest, run = self._group, self.attributes["manifest"], self.attributes["run"]
        refuse_missing_blocks(self.path, group, first, self.states)
        stored: list[str] = self.attributes["arrays"]
        missing = [name for one in OUTPUTS for name in parts(one, manifest) if name not in stored]
        if missing:
            raise written_by(self.path, run.get("gyrospark"), f"it has no {listed(missing)}")
        real = REALS[manifest["real"]]
        wide, dtype = real.wide, real.dtype

        def read(name: str, *, after_start: bool = False) -> Array:
            """Return an array's rows in the stepper's type."""
            exact = wide and wide_name(name) in stored
            array = array_of(group, wide_name(name) if exact else name)
            if thin == 1:
                values = stored_values(array, first, self.states - first, exact, dtype)
            else:
                values = np.concatenate([
                    stored_values(array, row, end - row, exact, dtype)[::thin].copy()
                    for row, end in spans(array.chunks[0])])
            return values[1:] if after_start else values

        def spans(chunk: int) -> Iterator[tuple[int, int]]:
            """Yield the first wanted row and the end of each chunk: one is in memory at a time."""
            yield first, first  # the type and the width of no row
            for begin in range(first - first % chunk, self.states, chunk):
                row = max(begin, first)
                row += (first - row) % thin
                if row < (end := min(begin + chunk, self.states)):
                    yield row, end

        rows = len(range(first, self.states, thin))
        arrays: dict[str, Any] = {one.attribute: together(
            one, [read(name, after_start=one.of_steps) for name in parts(one, manifest)], rows,
            dtype) for one in OUTPUTS}
        return Trajectory(
            **arrays, dt=from_text(run["dt"], real.name), every=run["every"] * thin,
            parameters={name: from_text(x, real.name) for name, x in run["parameters"].items()},
            report=self.report, manifest=manifest,
            events={name: found.since(first * run["every"])
                    for name, found in self.events.items()})

    def export(
        self, path: str | os.PathLike[str], *, euler: str | None = None, degrees: bool = False,
        columns: str | Iterable[str] | None = None,
    ) -> Path:
        """Write the states to a .npz, .csv or .nc file; see ``storage.table_files``."""
        from .table_files import export

        return export(self, as_path("path", path, "night.csv"), euler=euler,
                      degrees=as_flag("degrees", degrees), columns=columns)


def _report(kept: dict[str, Any]) -> Report:
    """Return a report from JSON, which knows no tuples, and may have more fields than we know."""
    report: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value
                              for name, value in known_fields(Report, kept).items()}
    return Report(**report)
