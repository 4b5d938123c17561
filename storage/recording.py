"""A stored run, complete or not: a ``Trajectory`` whose states are read from its store."""

from __future__ import annotations

import json
import operator
import os
import zlib
from collections.abc import Iterator, Mapping
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import zarr

from ..core.arguments import count_text, join_or
from ..core.arrays import Array
from ..core.calls import explain_arguments
from ..core.errors import InputError, StepFailed
from ..core.event import Event, Impact, impacts_of_json
from ..core.html import card
from ..core.manifest import Manifest
from ..core.real_types import REALS
from ..core.records import replace_fields
from ..runtime.bindings.real_numbers import from_text
from ..runtime.results.crossings import Impacts
from ..runtime.results.diagnostics import Report, known_fields
from ..runtime.results.outputs import OUTPUTS, States, array_from_files, labels_of, names_in_files
from ..runtime.results.trajectory import Trajectory
from ..runtime.steppers.differentiation import Derive
from ..runtime.steppers.stepper import Stepper, stepper_of
from .array_layout import (
    CHECKPOINT,
    SOURCE,
    array_of,
    fields_of_events,
    names_of,
    open_group,
    wide_name,
)
from .checkpoint import CheckpointState, unpack
from .durable_files import one_line, store_path
from .event_store import crossings_in
from .identity import written_by
from .validation import (
    COMPLETE,
    ENDED,
    FAILED,
    UNREADABLE,
    checked_attributes,
    refuse_missing_blocks,
    rows_of,
    stored_values,
)

if TYPE_CHECKING:
    import xarray

    from ..core.start import Start
    from ..runtime.bindings.binding import Binding

__all__ = ["Recording", "events_in", "group_of", "open_recording", "source_of"]

#: States in the error of a failed run; the others are in the store.
_LAST = 4096
#: States in memory for pictures: more are not distinguishable.
_SHOWN = 20_000
#: Before the names of files with derivatives.
_DERIVATIVES = "derivatives/"
_ATTRIBUTES = {output.attribute for output in OUTPUTS}


def open_recording(path: str | os.PathLike[str]) -> Recording:
    """Return the run that ``integrate(..., out=...)`` or ``gyrospark run --out X.zarr`` stored.

    Raises InputError if there is none, or it is damaged.
    """
    return Recording.read(store_path(path))


@explain_arguments
class Recording(Trajectory):
    """A stored run: a ``Trajectory`` whose arrays are read when they are first asked for.

    ``run[::100]`` reads some of the states, block by block; files are written, and pictures drawn,
    in constant memory.

    Attributes
    ----------
    path : Path
    status : str
        ``"complete"``, ``"running"`` (also of an interrupted run: it can be resumed),
        ``"ended: "`` and the name of the event that ended it, or ``"failed: "`` and the reason.
    steps_done : int
    states : int
        States that are stored, with the start.
    attributes : dict
        Attributes of the store: run, manifest, versions.
    """

    _CURE = "a stored run is what its store has"

    path: Path
    status: str
    steps_done: int
    states: int
    attributes: dict[str, Any]
    _group: zarr.Group

    @classmethod
    def read(cls, path: Path) -> Recording:
        """Return the run in a store."""
        group = group_of(path)
        about = checked_attributes(path, group)
        manifest = Manifest.from_json(about["manifest"])
        run, report = about["run"], about.get("report")
        real = manifest.real
        return replace_fields(
            object.__new__(cls), path=path, attributes=about, status=about["status"],
            steps_done=about["steps_done"], states=about["states"], manifest=manifest,
            dt=from_text(run["dt"], real), every=run["every"],
            parameters={name: from_text(x, real) for name, x in run["parameters"].items()},
            report=None if report is None else _report(report), _group=group,
            _laws=impacts_of_json(run.get("events", {})))

    if not TYPE_CHECKING:  # as in Trajectory

        def __getattr__(self, name: str) -> Any:
            """Read an array, or the events; keep it. Of two threads the first one's stays."""
            if name in ("events", "impacts"):
                crossings = crossings_in(
                    self.path, self._group, self.manifest, self.attributes["run"].get("events", {}),
                    self.attributes["events"])
                impacts = {event: x for event, x in crossings.items() if isinstance(x, Impacts)}
                self.__dict__.setdefault("impacts", impacts)
                self.__dict__.setdefault("events", crossings | {
                    event: x.crossings for event, x in impacts.items()})
                return self.__dict__[name]
            if name in _ATTRIBUTES:
                # all arrays at once: a store is read block by block, each with all outputs
                run_in_memory = self._in_memory(range(self.states))
                for output in OUTPUTS:
                    array = getattr(run_in_memory, output.attribute)
                    self.__dict__.setdefault(output.attribute, array)
                return self.__dict__[name]
            return super().__getattr__(name)

    @property
    def ended_by(self) -> str | None:
        """The name of the event that ended the run, None if none has."""
        return self.status.removeprefix(ENDED) if self.status.startswith(ENDED) else None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by the path of the store."""
        return Recording.read, (self.path,)

    def __repr__(self) -> str:
        total_steps = count_text(self.attributes["run"]["steps"], "step")
        return (f"<Recording {str(self.path)!r}: {self.status}, {self.steps_done} of "
                f"{total_steps}>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks; of a run without a state, its status."""
        if not self.states:
            return card(repr(self)[1:-1], "")
        return super()._repr_html_()

    def __len__(self) -> int:
        return self.states

    def __getitem__(self, row: Any) -> Any:
        """Return a state as a start, or a run of some states in memory; see ``Trajectory``."""
        self._refuse_unless_begun()
        try:
            index = range(self.states)[operator.index(row)]
        except (TypeError, IndexError):  # a slice, or what a run in memory refuses in a sentence
            return super().__getitem__(row)
        return self._in_memory(range(index, index + 1))[0]

    def _attributes(self) -> dict[str, Any]:
        return self.attributes

    def save(self, path: str | os.PathLike[str], **options: Any) -> Path:
        """Write the states to a file, finished or not; see ``Trajectory.save``."""
        self._refuse_unless_begun()
        return super().save(path, **options)

    def _refuse_unless_begun(self) -> None:
        """Raise InputError before the first commit, when nothing is stored."""
        if not self.states:
            raise InputError(f"{str(self.path)!r} holds no state yet; resume its run first.")

    def of_states(self, states: States, **changes: Any) -> Trajectory:
        """Return a trajectory in memory with other states; see ``Trajectory``."""
        fields = {name: getattr(self, name) for name in (
            "dt", "every", "parameters", "report", "manifest", "events", "impacts", "_stepper",
            "_laws")}
        return Trajectory.of(states, **fields | changes)

    def _rows(self, row_range: range) -> Trajectory:
        """Return some rows as a trajectory, with the events and impacts between their times."""
        run_in_memory = self._in_memory(row_range)
        t, ahead = run_in_memory.t, 1 if self.dt > 0 else -1
        end = None if row_range[-1] + row_range.step >= self.states else t[-1]
        events, impacts = ({name: x.within(t[0], end, ahead) for name, x in crossings.items()}
                           for crossings in (self.events, self.impacts))
        # the stepper in the store is read and compiled when it is first needed
        return replace_fields(run_in_memory, events=events, impacts=impacts,
                              _stepper=self._stepper or (lambda: self.stepper))

    def _blocks(self) -> Iterator[tuple[slice, Trajectory]]:
        """Yield blocks of rows, each with the row before it."""
        block = array_of(self._group, "time").chunks[0]
        for begin in range(0, self.states, block):
            end = min(begin + block, self.states)
            yield slice(begin, end), self._in_memory(range(max(begin - 1, 0), end))

    @property
    def stepper(self) -> Stepper:
        """The stepper of the run: the one that ran it here, or one of the source in the store.

        Raises
        ------
        InputError
            Where the store has no source: one of an earlier version, or a run that was saved.
        """
        if self._stepper is None:
            try:
                # the files of the stepper, as ``source_of`` packs them
                packed = np.asarray(array_of(self._group, SOURCE)[:]).tobytes()
                files = json.loads(zlib.decompress(packed))
            except UNREADABLE as error:
                raise InputError(f"{str(self.path)!r} has no source of its stepper; give the "
                                 "stepper, or begin another store.") from error
            derivatives = {name.removeprefix(_DERIVATIVES): files.pop(name) for name in [*files]
                           if name.startswith(_DERIVATIVES)}
            derive = (Derive(partial(dict, derivatives), portable=True, known=True)
                      if derivatives else None)
            self.__dict__["_stepper"] = stepper_of(self.manifest.name,
                                                   tuple(sorted(files.items())), derive)
        stepper: Stepper = self._stepper
        return stepper

    def _maker(self, stepper: Any, call: str) -> Any:
        """Return the stepper that a method of a trajectory needs, by default the one in the store.
        """
        return super()._maker(self.stepper if stepper is None else stepper, call)

    @property
    def grid_end(self) -> Start:
        """The state of the last whole step; see ``Trajectory``."""
        # without a rest, a shorter last step, the last row is the one to ask
        if self.status != COMPLETE or "rest" not in self.attributes["run"]:
            return super().grid_end
        binding, run, real = self.stepper.binding, self.attributes["run"], self.manifest.real
        checkpoint = self._checkpoint(binding)
        assert checkpoint is not None  # of a complete run
        t0, dt = (from_text(run[name], real) for name in ("t0", "dt"))
        t = binding.times(t0, dt, np.array([run["steps"]]))[0]
        start: Start = self[-1].replace(q=checkpoint.run.q, p=checkpoint.run.p, t=t)
        return start

    def _checkpoint(self, binding: Binding) -> CheckpointState | None:
        """Return the state from which the run resumes, None before the first commit.

        Raises InputError if it is damaged.
        """
        try:
            return unpack(binding, np.asarray(array_of(self._group, CHECKPOINT)[:]),
                          events_in(self.attributes["run"]))
        except ValueError as error:
            raise InputError(f"The store {str(self.path)!r} cannot be resumed: {error}. What "
                             "is stored can be read; choose another store for the run.") from error

    def _events_to_resume(self, binding: Binding) -> dict[str, int]:
        """Return the number of each event, by its name, up to the state from which the run resumes.
        """
        counts: dict[str, int] = self.attributes["events"]
        checkpoint = self._checkpoint(binding)
        if checkpoint is None or checkpoint.event_progress is None:
            return counts
        # the checkpoint of a killed run may be ahead of the attributes
        return {name: min(counts[name], count) for name, count in zip(
            self.attributes["run"]["events"], checkpoint.event_progress.counts.tolist(),
            strict=True)}

    @property
    def rows(self) -> int:
        """The number of states of the whole run, with the start."""
        return rows_of(self.attributes["run"])

    @property
    def _run(self) -> Trajectory:
        """The states drawn in pictures; more could not be distinguished."""
        return self[:: max(1, -(-self.states // _SHOWN))] if self.states else self

    def dataset(self, **options: Any) -> xarray.Dataset:
        """Return the states as an xarray Dataset along ``time``, whose values are read when used.

        Coordinates go by their names: ``dataset.q.sel(coordinate="x")``, and so does the momentum
        that belongs to one. An event has ``event_height_t``, ``_q``, ``_p``, ``_steps`` and
        ``_rising`` along a dimension of its own. With ``euler`` or ``angular_velocity``, the
        arguments of ``Trajectory.dataset``, the states are in memory.
        """
        if options:
            in_memory: xarray.Dataset = self[:].dataset(**options)
            return in_memory
        import xarray

        refuse_missing_blocks(self.path, self._group, 0, self.states)
        try:  # reads the times
            store = xarray.open_zarr(self.path)
        except UNREADABLE as error:
            raise InputError(f"{str(self.path)!r} is damaged: {one_line(error)}.") from error
        counts: dict[str, int] = self.attributes["events"]
        event_arrays = [name for fields in fields_of_events(
            self.manifest, self.attributes["run"].get("events", {})).values()
            for name in names_of(fields)]
        dataset: xarray.Dataset = store[[*self.attributes["arrays"], *event_arrays]].isel(
            time=slice(0, self.states),
            **{f"event_{name}": slice(0, count) for name, count in counts.items()})
        return dataset.assign_coords({
            dimension: (dimension, names, {"long_name": meaning})
            for dimension, (names, meaning) in labels_of(self.manifest.system)
            .items() if dimension in dataset.dims})

    def failure(self) -> StepFailed:
        """Return the error of a failed run; its trajectory has the last states."""
        run, real = self.attributes["run"], self.manifest.real
        t0, dt = (from_text(run[name], real) for name in ("t0", "dt"))
        last_states, t = self[-_LAST:], t0 + self.steps_done * dt
        if self.manifest.system.clock is not None:  # a coordinate, which may be behind the last row
            checkpoint = self._checkpoint(self.stepper.binding)
            assert checkpoint is not None  # of a run that has begun
            t = self.stepper.binding.time_of(checkpoint.run.q)
        return StepFailed(step=self.steps_done + 1, t=float(t),
                          reason=self.status.removeprefix(FAILED), trajectory=last_states)

    def _in_memory(self, row_range: range) -> Trajectory:
        """Return some of the stored states, in memory.

        Raises
        ------
        InputError
            Before the first commit, when nothing is stored; if a version with other outputs
            stored it.
        """
        self._refuse_unless_begun()
        manifest, run = self.manifest, self.attributes["run"]
        refuse_missing_blocks(self.path, self._group, row_range.start, row_range.stop)
        missing_names = [name for output in OUTPUTS for name in names_in_files(output, manifest)
                         if name not in self.attributes["arrays"]]
        if missing_names:
            raise written_by(self.path, run.get("gyrospark"), f"it has no {join_or(missing_names)}")
        arrays: dict[str, Any] = {}
        for output in OUTPUTS:
            # outputs of steps have no entry for the start
            stored_arrays = [self._rows_of(name, row_range)[1 if output.of_steps else 0 :]
                             for name in names_in_files(output, manifest)]
            arrays[output.attribute] = array_from_files(output, stored_arrays, len(row_range),
                                                        REALS[manifest.real].dtype)
        return Trajectory(
            **arrays, dt=self.dt, every=self.every * row_range.step,
            parameters=dict(self.parameters), report=self.report, manifest=manifest,
            _laws=self._laws)

    def _rows_of(self, name: str, row_range: range) -> Array:
        """Return rows of an array in the stepper's type, wide numbers with all their digits."""
        real = REALS[self.manifest.real]
        is_exact = real.wide and wide_name(name) in self.attributes["arrays"]
        array = array_of(self._group, wide_name(name) if is_exact else name)
        if row_range.step == 1:
            return stored_values(array, row_range.start, row_range.stop - row_range.start, is_exact,
                                 real.dtype)
        if name == "iterations":
            return self._most_iterations(row_range)
        # of each chunk a copy of its selected rows: one chunk at a time is in memory
        return np.concatenate([
            stored_values(array, begin, end - begin, is_exact, real.dtype)[:: row_range.step].copy()
            for begin, end in _spans_of_chunks(row_range, array.chunks[0])])

    def _most_iterations(self, row_range: range) -> Array:
        """Return the most iterations of the steps since the selected row before each, (rows,).

        One chunk at a time is in memory.
        """
        array = array_of(self._group, "iterations")
        largest_counts = np.zeros(len(row_range), array.dtype)
        chunk, first_row, end_row = array.chunks[0], row_range.start, row_range[-1] + 1
        for chunk_start in range(first_row - first_row % chunk, end_row, chunk):
            begin, end = max(chunk_start, first_row), min(chunk_start + chunk, end_row)
            # the selected row at or behind each row
            places = -(-(np.arange(begin, end) - first_row) // row_range.step)
            iterations = stored_values(array, begin, end - begin, wide=False, dtype=array.dtype)
            np.maximum.at(largest_counts, places, iterations)
        return largest_counts


def _spans_of_chunks(row_range: range, chunk: int) -> Iterator[tuple[int, int]]:
    """Yield, for each chunk with selected rows, the first selected row and the end of its rows.

    The first span is empty, so that there is an array to concatenate.
    """
    first_row, stop, stride = row_range.start, row_range.stop, row_range.step
    yield first_row, first_row
    for chunk_start in range(first_row - first_row % chunk, stop, chunk):
        row = max(chunk_start, first_row)
        row += (first_row - row) % stride  # to the next selected row
        end = min(chunk_start + chunk, stop)
        if row < end:
            yield row, end


def source_of(stepper: Stepper, impacts: bool = False) -> bytes:
    """Return the files of a stepper as bytes for a store: JSON compressed by zlib.

    Runs with impacts need those with derivatives as well.
    """
    files = {**stepper.files}
    if impacts:
        files |= {_DERIVATIVES + name: text for name, text in stepper._derivative_files().items()}
    return zlib.compress(json.dumps(files, sort_keys=True).encode(), level=9)


def events_in(run: Mapping[str, Any]) -> tuple[Event | Impact, ...]:
    """Return the events or impacts of a run from its attributes."""
    records = run.get("events", {})
    return impacts_of_json(records) or tuple(
        Event(record["quantity"], Fraction(record["level"]), record["direction"],
              terminal=record["terminal"], name=name) for name, record in records.items())


def group_of(path: Path, *, write: bool = False) -> zarr.Group:
    """Return the Zarr group of a store.

    Raises InputError if there is none that can be read.
    """
    try:
        return open_group(path, write=write)
    except PermissionError as error:
        raise InputError(f"{str(path)!r} cannot be read: {error.strerror}.") from error
    except UNREADABLE as error:
        raise InputError(f"{str(path)!r} is not a run that gyrospark stored, or damaged; give a "
                         "folder that `gyrospark run --out X.zarr` made.") from error


def _report(report_json: dict[str, Any]) -> Report:
    """Return a report from JSON, whose lists are tuples; fields of other versions are left out."""
    report: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value
                              for name, value in known_fields(Report, report_json).items()}
    return Report(**report)
