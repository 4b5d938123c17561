"""Many trajectories at once: lanes of vector registers, threads over batches, no GIL."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import field, replace
from fractions import Fraction
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import as_path, count_text, shown
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.errors import InputError, InputWarning, StepFailed, Stopped
from ...core.event import Event, as_events, as_impacts, terminal_of
from ...core.exact_numbers import Number
from ...core.file_formats import format_of
from ...core.incompatibilities import refuse_together
from ...core.interrupts import Interrupts, catch_ctrl_c
from ...core.progress import Progress, as_progress, log_progress
from ...core.records import dataclass, replace_fields
from ...core.start import Rule
from ...core.warnings import warn
from ..bindings.array_checks import as_numbers, as_positive_count
from ..bindings.inputs import as_inputs
from ..derivatives.tangent_run import with_tangents
from ..derivatives.tangent_space import Tangents
from ..devices.cuda_text import cuda_text
from ..devices.device import Device, is_on_card
from ..devices.ensemble import (
    DeviceEnsemble,
    DeviceName,
    device_for,
    ensemble_card,
    refuse_on_device,
    shared_ensemble,
    views_of,
)
from ..devices.trajectories import Trajectories, gather_states
from ..events.detection import Levels
from ..events.impact_observer import refuse_unusable
from ..events.last_step import joined_with_part
from ..events.location import crossings_of, detectors_for
from ..events.observer import observer_to_end, with_end_apart, with_events
from ..integration.consistency import refuse_undefined_energy
from ..integration.failure import Diagnosis
from ..integration.lanes import EnsembleStates, fill_ensemble, threads_of
from ..integration.run_arguments import (
    OPEN,
    EnsembleArguments,
    Origin,
    RawArguments,
    RunArguments,
    StartNumbers,
    checked_runs,
    end_of_run,
    refuse_texts,
    warn_of_late_start,
    warn_of_negative,
    with_rules,
)
from ..integration.step_loop import failure_of, march, trajectory_of
from ..results.crossings import Crossings, CrossingsOfMany
from ..results.missed_rates import warn_of_missed_rate
from ..results.table import as_dataset, as_frame, save_table, table_of_ensemble
from ..results.tangent_rows import TangentRows
from ..results.trajectory import Trajectory

if TYPE_CHECKING:
    import pandas
    import xarray

    from .stepper import Stepper

__all__ = ["Ensemble", "EnsembleEnd", "integrate_members"]


@explain_arguments
@dataclass(frozen=True, eq=False)
class Ensemble:
    """The trajectories of ``integrate_ensemble``; the leading axis is the trajectory.

    Attributes
    ----------
    t, q, p, multipliers, iterations : arrays
        As in ``Trajectory`` with a leading axis; NaN (0 iterations) after a failed step, and after
        Ctrl-C where the ensemble comes with ``Stopped``. Reactions of velocity constraints are in
        ``members``.
    failures : dict
        Number of a failed trajectory → its ``StepFailed``.
    events : dict of str to CrossingsOfMany
        Where the events that were asked for happened: ``events["height"].first``, ``.count``, and
        the ``Crossings`` of trajectory i in ``events["height"][i]``. Impacts of trajectory i are
        in ``members[i].impacts``.
    tangents : list of TangentRows or None
        Those of each trajectory, where ``integrate_ensemble(tangents=...)`` was asked for them;
        None for one that failed.
    members : list of Trajectory
        Each trajectory by itself, up to its failed step if it has one; with it ``work`` and
        ``quantity(name)``. Made when first asked for.
    """

    t: Array
    q: Array
    p: Array
    multipliers: Array
    iterations: Array
    failures: dict[int, StepFailed]
    _name: str = field(repr=False)
    _make: Callable[[int], Trajectory] = field(repr=False)
    events: dict[str, CrossingsOfMany] = field(default_factory=dict, repr=False)
    tangents: list[TangentRows | None] = field(default_factory=list, repr=False)
    _made: dict[str, list[Trajectory]] = field(default_factory=dict, init=False, repr=False)

    @property
    def members(self) -> list[Trajectory]:
        """Each trajectory by itself."""
        if not self._made:  # two threads may both make them; the first one's stay
            self._made.setdefault("members", [
                self.failures[i].trajectory if i in self.failures else self._make(i)
                for i in range(len(self))])
        return self._made["members"]

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        return (f"<Ensemble of {self._name}: {count_text(len(self), 'trajectory')} of "
                f"{count_text(self.t.shape[1], 'state')}, {len(self.failures):,} failed>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the number of trajectories, and the first failures."""
        return ensemble_card(f"Ensemble of {self._name}", self.t, self.failures)

    def table(self, columns: str | Iterable[str] | None = None) -> pandas.DataFrame:
        """Return all states as a pandas DataFrame by trajectory and time, as ``Trajectory.table``.
        """
        return as_frame(table_of_ensemble(self), columns)

    def dataset(self) -> xarray.Dataset:
        """Return all trajectories as an xarray Dataset along ``trajectory`` and ``state``.

        Its variables are those of ``Trajectory.dataset``, NaN after the end of a trajectory that
        failed; ``time``, ``dt``, ``steps``, ``status`` ("complete", "stopped", or why a step
        failed) and each ``parameter_NAME`` are coordinates. Events are along dimensions of their
        own, with the ``trajectory`` of each.

        Raises
        ------
        MissingDependencyError
            Without xarray.

        Examples
        --------
        >>> many.dataset().swap_dims(trajectory="parameter_mgl").energy     # doctest: +SKIP
        """
        table = table_of_ensemble(self)
        return as_dataset(table, {name: x for name, x in table.attributes.items()
                                  if name != "manifest"})

    def save(
        self, path: str | os.PathLike[str], *, columns: str | Iterable[str] | None = None
    ) -> Path:
        """Write all trajectories to a file, which appears complete or not at all; return its path.

        - .npz: the arrays of ``dataset`` under their names, with all their digits, and ``about``,
          JSON with the manifest: for ``numpy.load``.
        - .csv, .parquet: a row for each state, with the number of its trajectory, and the columns
          of ``table``; events in a second file.
        - .nc: ``dataset`` as NetCDF-4: for ``xarray.open_dataset``.

        Raises
        ------
        InputError
            For another ending, or none.
        GyrosparkError
            If the file cannot be written.
        """
        target = as_path("path", path, "ensemble.npz")
        form = format_of(target, "An ensemble", "states")
        if columns is not None and not form.tabular:
            raise InputError(f"columns is for files of columns, .csv and .parquet, and "
                             f"{target.name!r} is none; leave it out.")
        form.require_packages()
        if "ensemble" in form.writers:
            saved_path: Path = form.function(form.writers["ensemble"])(self, target)
            return saved_path
        return save_table(table_of_ensemble(self), target, "The ensemble", columns)

    def plot(self, *names: str | os.PathLike[str],
             path: str | os.PathLike[str] | None = None) -> Any:
        """Draw values and the energy error against time, a line for each trajectory.

        The arguments are those of ``Trajectory.plot``; by default the first six quantities are
        drawn, or coordinates where there are none. Of more than 200 trajectories, 200 are drawn,
        evenly spread.
        """
        from ..plotting.trajectory_plots import draw_ensemble, names_and_path

        columns, target = names_and_path(names, path)
        return draw_ensemble(self, columns, target)

    def show(self, path: str | os.PathLike[str] | None = None, *, member: int = 0,
             **options: Any) -> Any:
        """Show the bodies of one of the trajectories in motion; see ``Trajectory.show``."""
        number = as_positive_count("member", member)
        if number >= len(self):
            raise InputError(f"member = {number} is none of {count_text(len(self), 'trajectory')}, "
                             "which are "
                             "counted from 0.")
        return self.members[number].show(path, **options)

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the members; memory of compiled code stays where it is."""
        members = self.members
        return {**self.__dict__, "_make": members.__getitem__}


class EnsembleEnd(NamedTuple):
    """The time t_end of the last state of all runs, where that is not the end of a whole step."""

    #: t_end in scaled time, up to which runs take different numbers of steps.
    open_end: Any = None
    #: t_end between two steps, and the time from the last whole step to it: one for all runs, or
    #: one for each.
    last_part: tuple[Any, Sequence[Fraction]] | None = None


_NO_END = EnsembleEnd()
#: From so many steps on each start is checked before any step is taken, which costs less than 1 %:
#: the check takes as long as some tens of steps. H of shorter runs is read from their reports.
_STEPS_OF_A_CHECK = 10_000


def integrate_members(
    stepper: Stepper, starts: StartNumbers, dt: Number | ArrayLike, workers: int | None,
    events: Any, inputs: Any = None, tangents: Tangents | None = None,
    device: DeviceName | None = None, progress: Progress = None, end: EnsembleEnd = _NO_END,
    **options: Any
) -> Ensemble:
    """Integrate each row of starts; see ``Stepper.integrate_ensemble``.

    There are four ways: on a card; each run by itself, with impacts; each by itself up to t_end in
    scaled time, ``end.open_end``, where the numbers of steps are not known before; all side by
    side, which is the usual one. ``end.last_part`` is a t_end between two steps; ``options`` are
    steps, every and solver.
    """
    as_progress(progress)
    card = device_for(device, starts.q, starts.p)
    if card is not None:
        refuse_on_device(stepper, options["solver"].kind, events=events, inputs=inputs,
                         tangents=tangents, workers=workers)
        # A DeviceEnsemble for arrays on a card, which no annotation tells from other arrays.
        return cast(Ensemble, _integrate_on(card, stepper, starts, dt, options, progress))
    runs, watches_rotations = _check_arguments(stepper, starts, dt, options, inputs, end.last_part)
    impacts = as_impacts(events, stepper.manifest.system.event_quantities)
    # impacts are refused in scaled time, so that there is no open end with them
    if impacts:
        # runs backwards take elastic impacts alone: the smallest dt decides for all
        refuse_unusable(stepper, runs[int(np.argmin(runs.dt))], impacts,
                        tangents=tangents is not None and "tangents of an ensemble")
        return _integrate_separately(stepper, runs, impacts, threads_of(workers), progress)
    if end.open_end is not None:
        observed_events = as_events(events, stepper.manifest.system.event_quantities)
        refuse_together(ensemble="an ensemble", terminal=terminal_of(observed_events))
        ensemble = _integrate_separately(stepper, runs, observed_events, threads_of(workers),
                                         progress, t_end=end.open_end)
        return ensemble if tangents is None else _with_tangents(
            stepper, ensemble, tangents, threads_of(workers), stop=lambda: False)
    return _side_by_side(stepper, runs, events, tangents, threads_of(workers), progress,
                         watches_rotations=watches_rotations)


def _side_by_side(
    stepper: Stepper, runs: EnsembleArguments, events: Any, tangents: Tangents | None,
    threads: int, progress: Progress, *, watches_rotations: bool,
) -> Ensemble:
    """Integrate runs in lanes and on threads: whole steps, events, partial last steps, tangents.

    ``watches_rotations``: too large rotations in a step, of any stored state, are warned of. After
    Ctrl-C, the states so far come with ``Stopped``.
    """
    levels = _levels(stepper, events)
    # starts where H is no number are refused before long runs, and after short ones
    is_long = runs.first.steps >= _STEPS_OF_A_CHECK
    if is_long:
        for i in range(len(runs)):
            _refuse_undefined_energy(stepper, runs, i)
    states = EnsembleStates.at_start(stepper, runs, detectors_for(stepper, levels, runs))
    with _progress_of(stepper, runs, progress) as report, catch_ctrl_c() as interrupts:
        fill = partial(fill_ensemble, threads=threads, stop=lambda: interrupts.is_requested)
        fill(states, report=report)
        for i in range(len(runs)):
            # H at the start of shorter runs is in their reports
            if not (is_long or math.isfinite(states.report(i).energy_start)):
                _refuse_undefined_energy(stepper, runs, i)
        ensemble = _ensemble(stepper, states, levels, fill)
        if runs.rests is not None and not interrupts.is_requested:
            last_runs = runs.last_parts(stepper.binding, states.q, states.p, states.status)
            parts = EnsembleStates.at_start(stepper, last_runs,
                                            detectors_for(stepper, levels, last_runs))
            fill(parts)
            ensemble = _with_last_parts(stepper, ensemble, runs,
                                        _ensemble(stepper, parts, levels, fill),
                                        () if levels is None else levels.events)
        if watches_rotations:
            dt = runs.dt[:, None]
            if stepper.binding.clocked:  # bodies turn by Ω Δt, not Ω Δτ: Δt is a mean over rows
                dt = np.diff(ensemble.t, axis=1) / runs.first.every
            stepper.rotations.warn_of_many(runs.parameters, dt, ensemble.q, ensemble.p)
        if tangents is not None:
            ensemble = _with_tangents(stepper, ensemble, tangents, threads,
                                      lambda: interrupts.is_requested)
    if interrupts.is_requested:
        raise _stop_exception(interrupts, sum(states.row_counts), ensemble, ensemble.t.size)
    return ensemble


def _refuse_undefined_energy(stepper: Stepper, runs: EnsembleArguments, i: int) -> None:
    """Refuse a start of run i where H is no finite number."""
    try:
        refuse_undefined_energy(stepper.binding, runs[i])
    except InputError as error:
        raise InputError(f"Trajectory {i}: {error}") from None


def _with_last_parts(
    stepper: Stepper, ensemble: Ensemble, runs: EnsembleArguments, parts: Ensemble,
    event_tuple: tuple[Event, ...],
) -> Ensemble:
    """Return an ensemble of whole steps with the ends of partial steps ``parts`` as last row.

    The row of the last whole step is left out unless ``every`` stores it. A run that failed,
    before or in its partial step, has a row of NaN there, and its failure the trajectory of whole
    steps.
    """
    failures = dict(ensemble.failures)
    for i, failed in parts.failures.items():
        if i not in ensemble.failures:
            failures[i] = StepFailed(
                step=runs.first.steps + 1, t=failed.t, reason=failed.reason,
                trajectory=ensemble._make(i), detail=failed.detail, cure=failed.cure)

    @cache  # events below and the caller's ``members`` ask for the same trajectory
    def member(i: int) -> Trajectory:
        """Return trajectory i, which has not failed, with its partial step."""
        longer_run = joined_with_part(stepper, runs[i], ensemble._make(i), parts._make(i))
        return replace_fields(longer_run, _origin=Origin(runs[i], event_tuple, rest=runs[i].rest))

    events = {name: CrossingsOfMany([
        ensemble.events[name][i] if i in failures else member(i).events[name]
        for i in range(len(ensemble))]) for name in ensemble.events}
    return replace(ensemble, **_columns_with_last_parts(stepper, ensemble, runs, parts),
                   failures=failures, events=events, _make=member)


def _columns_with_last_parts(
    stepper: Stepper, ensemble: Ensemble, runs: EnsembleArguments, parts: Ensemble
) -> dict[str, Any]:
    """Return the arrays of ``ensemble`` with the ends of ``parts`` as last row."""
    row_count = runs.first.steps // runs.first.every + 1
    # the caller's t_end, without the round-off of t0 + k dt + rest
    end = parts.t[:, -1:].copy()
    end[...] = runs.first.t_end
    columns: dict[str, Any] = {
        "t": np.concatenate([ensemble.t[:, :row_count], end], axis=1)}
    # multipliers and iterations are of a step, and the start has none: one row fewer
    for name, fewer in (("q", 0), ("p", 0), ("multipliers", 1), ("iterations", 1)):
        whole_steps = getattr(ensemble, name)[:, : row_count - fewer]
        columns[name] = np.concatenate([whole_steps, getattr(parts, name)[:, -1:]], axis=1)
    failed_runs = [*{*ensemble.failures, *parts.failures}]
    for name in ("t", "q", "p", "multipliers"):
        columns[name][failed_runs, -1] = stepper.binding.new(1)[0] + np.nan  # in its own type
    columns["iterations"][failed_runs, -1] = 0
    return columns


def _progress_of(
    stepper: Stepper, runs: EnsembleArguments, progress: Progress, steps: int | None = None
) -> AbstractContextManager[Callable[..., Any] | None]:
    """Return the context that reports the steps of all runs together.

    ``steps`` is their total, by default that of runs of equal length.
    """
    return log_progress(f"integrating {count_text(len(runs), 'time')} {stepper.name}",
                        steps or len(runs) * runs.first.steps, progress)


def _stop_exception(
    interrupts: Interrupts, stored: int, ensemble: Ensemble | DeviceEnsemble, size: int
) -> Stopped:
    """Return the exception after Ctrl-C, when ``stored`` of ``size`` states are computed."""
    return Stopped(f"Stopped with {stored:,} of {count_text(size, 'state')}; they are in "
                   ".ensemble.",
                   interrupts.signal, ensemble=cast(Ensemble, ensemble))


def _check_arguments(
    stepper: Stepper, starts: StartNumbers, dt: Any, options: dict[str, Any], inputs: Any = None,
    last_part: tuple[Any, Sequence[Fraction]] | None = None,
) -> tuple[EnsembleArguments, bool]:
    """Return the checked runs of an ensemble, or raise InputError for unusable arguments.

    ``dt``, the time and each parameter are one number, or one for each trajectory. ``last_part`` is
    t_end and the times from the last whole steps to it. The flag says whether too large rotations
    in a step are still to be looked for: not where the starts were warned of, nor without steps.
    """
    q, p = _rows(stepper, "q", starts.q), _rows(stepper, "p", starts.p)
    if q.ndim != 2 or q.shape != p.shape or not len(q):
        raise InputError(f"q and p have shapes {q.shape} and {p.shape}; give "
                         f"(trajectories, {stepper.n}) for both.")
    size = len(q)
    arguments = RawArguments(
        q, p, dt=np.broadcast_to(_number_of_each_run("dt", dt, size), size),
        t0=np.broadcast_to(_number_of_each_run("t", starts.t, size), size),
        excess=np.broadcast_to(starts.excess, size), parameters=_parameters_of_runs(
            stepper._parameters_with_inputs(starts.parameters, inputs), size,
            stepper.parameter_domains), common=options)
    # the last part of a step has a row of inputs of its own
    count = as_positive_count("steps", options["steps"]) + (last_part is not None)
    input_rows = as_inputs(inputs, stepper.binding, count, runs=size)
    runs = replace(checked_runs(stepper, arguments), inputs=input_rows)
    if last_part is not None:
        runs = runs.to_end(stepper.binding, *last_part)
    warn_of_negative(runs.parameters)
    warn_of_late_start(stepper.binding, runs.t0, runs.dt, runs.first.steps)
    if not runs.first.steps:  # no step turns a body
        return runs, False
    times_of_steps = runs.dt
    if stepper.binding.clocked and stepper.rotations.bodies:  # runs.dt is Δτ
        times_of_steps = times_of_steps * _initial_time_scales(stepper, runs)
    return runs, not stepper.rotations.warn(runs.parameters, times_of_steps, runs.q, runs.p)


def _initial_time_scales(stepper: Stepper, runs: EnsembleArguments) -> Array:
    """Return dt/dτ at the start of each run, shape (trajectories,)."""
    binding = stepper.binding
    scales = []
    for i in range(len(runs)):
        run = runs[i]
        parameters = binding.parameters(run.parameters)
        scales.append(binding.time_scales(parameters, run.q[None], run.p[None]))
    return np.concatenate(scales)


def _integrate_on(
    device: Device, stepper: Stepper, starts: StartNumbers, dt: Any, options: dict[str, Any],
    progress: Progress,
) -> Ensemble | DeviceEnsemble:
    """Integrate each row of starts on a card.

    Starts in memory of the card stay there, and a ``DeviceEnsemble`` of their library's arrays
    comes back; NumPy arrays are copied there, and an ``Ensemble`` comes back.
    """
    try:
        name, text = stepper.name, cuda_text(stepper.name, stepper._control_files())
    except InputError as error:
        raise InputError(f"device = 'cuda' takes what profile control takes: {error}") from error
    callers_q, state_on_card = starts.q, None  # None: NumPy's arrays, which are copied there
    if is_on_card(callers_q):
        # the checks read a copy on the host; trajectories begin from what lies on the card
        state_on_card = gather_states(device, name, text,
                                      *views_of(device, stepper, starts.q, starts.p))
        q, p = np.split(device.get(state_on_card).T, 2, axis=1)
        starts = replace(starts, q=q, p=p)
    runs, _ = _check_arguments(stepper, starts, dt, options)
    trajectories = Trajectories(device, name, text, stepper.binding, runs, state_on_card)
    with _progress_of(stepper, runs, progress) as report, catch_ctrl_c() as interrupts:
        def stop() -> bool:
            """Report the steps so far; return whether Ctrl-C asks for an end."""
            if report is not None:
                report(int(trajectories.steps_done.sum()))
            return interrupts.is_requested

        ensemble = (_ensemble(stepper, trajectories.states(stepper.binding, stop))
                    if state_on_card is None else
                    shared_ensemble(stepper, trajectories, callers_q, stop))
        if report is not None:
            report(int(trajectories.steps_done.sum()))
    if interrupts.is_requested:
        stored_rows = int(sum(runs.first.rows_after(step_count) + 1
                              for step_count in trajectories.steps_done.tolist()))
        raise _stop_exception(interrupts, stored_rows, ensemble, len(runs) * (runs.first.rows + 1))
    return ensemble


def _levels(stepper: Stepper, events: Any) -> Levels | None:
    """Return the levels of a caller's events, none of which ends a run; None without events."""
    event_tuple = as_events(events, stepper.manifest.system.event_quantities)
    refuse_together(ensemble="an ensemble", terminal=terminal_of(event_tuple))
    return Levels.of(stepper.binding, stepper.manifest, event_tuple) if event_tuple else None


def _ensemble(
    stepper: Stepper, states: EnsembleStates, levels: Levels | None = None,
    fill: Callable[[EnsembleStates], None] | None = None,
) -> Ensemble:
    """Return the ensemble of stored states, NaN behind a failed step, with failures and events.

    ``levels`` are those of events, None without events; ``fill`` integrates the steps in which
    detectors bracketed a crossing once more, to locate it. Members are made from ``states`` when
    they are asked for.
    """
    binding, runs = stepper.binding, states.runs
    crossings: list[dict[str, Crossings]] = []  # of each run, event's name → crossings
    if levels is not None:
        assert fill is not None
        brackets = [detector.final_brackets() for detector in states.detectors]
        crossings = crossings_of(stepper, levels, runs, brackets, fill)
    event_tuple = () if levels is None else levels.events
    # crossings without the coordinates that scaled time adds
    shown_crossings = [{name: crossing.shown(binding) for name, crossing in events_of_run.items()}
                       for events_of_run in crossings]

    def member(i: int) -> Trajectory:
        """Return trajectory i, up to its failed step if it has one."""
        trajectory = trajectory_of(binding, stepper.manifest, runs[i], lambda: states.rows[i],
                                   states.final_report(i), states.q[i], states.p[i])
        return replace_fields(trajectory, events=shown_crossings[i] if shown_crossings else {},
                              _origin=Origin(runs[i], event_tuple))

    failures = {i: failure_of(binding, runs[i], member(i),
                              Diagnosis.bare(int(states.status[i])), states.q[i])
                for i in np.flatnonzero(states.status).tolist()}
    events = {name: CrossingsOfMany([events_of_run[name] for events_of_run in shown_crossings])
              for name in (shown_crossings[0] if shown_crossings else ())}
    return Ensemble(**_stored_arrays(stepper, states), failures=failures, _name=stepper.name,
                    _make=member, events=events)


def _stored_arrays(stepper: Stepper, states: EnsembleStates) -> dict[str, Any]:
    """Return t, q, p, multipliers and iterations by name, their first axis the trajectory.

    t, q and p have a row for the start and for each stored step, the others for each stored step.
    Rows behind a failed step are NaN, and 0 iterations.
    """
    binding, runs, rows = stepper.binding, states.runs, states.rows
    state_count, no_number = rows.q.shape[1], binding.new(1)[0] + np.nan
    # the last step is stored also where ``every`` does not divide the number of steps
    steps = np.minimum(np.arange(state_count) * runs.first.every, runs.first.steps)
    t = binding.times(runs.t0[:, None], runs.dt[:, None], steps)
    if binding.clocked:  # the last coordinate is t
        t = rows.q[:, :, -1].astype(t.dtype)
    q, p = (x[:, :, : binding.shown].copy() for x in (rows.q, rows.p))
    # the last columns are reactions of velocity constraints; ensembles leave these to their members
    multipliers = rows.multipliers[:, 1:, : binding.multipliers - binding.reactions].copy()
    iterations = rows.iterations[:, 1:].copy()
    for i, row_count in enumerate(states.row_counts):
        if row_count < state_count:
            t[i, row_count:] = no_number if t.dtype == object else np.nan
            q[i, row_count:] = p[i, row_count:] = multipliers[i, row_count - 1 :] = no_number
            iterations[i, row_count - 1 :] = 0
    if binding.m > 1:  # an axis for the stages of a step, and one for the constraints
        multipliers = multipliers.reshape(*multipliers.shape[:2], -1, binding.m)
    return {"t": t, "q": q, "p": p, "multipliers": multipliers, "iterations": iterations}


def _integrate_separately(
    stepper: Stepper, runs: EnsembleArguments, events: tuple[Any, ...], threads: int,
    progress: Progress, t_end: Any = None,
) -> Ensemble:
    """Integrate each run by itself on a thread, with the bits of ``integrate``.

    That is for runs that may take different numbers of steps; rows behind the end of one are NaN:

    - ``t_end`` None: runs with impacts, which are ``events``; a gap that stays closed, or a
      terminal impact, ends a run.
    - ``t_end`` given: runs in scaled time up to ``t_end``, with other events.
    """
    to_end = t_end is not None
    if not to_end:
        stepper._impact_binding()  # compiled once, before threads ask for it
    # OPEN: the steps to t_end in scaled time are not known before
    with (_progress_of(stepper, runs, progress, steps=OPEN if to_end else None) as report,
          catch_ctrl_c() as interrupts):
        finished_runs = _run_on_threads(stepper, runs, events, t_end, threads, report,
                                        lambda: interrupts.is_requested)
    members = [finished.trajectory for finished in finished_runs]
    if to_end:
        lengths = [*map(len, members)]  # stored states of each run, and of the longest one
        state_count = max(lengths)
        # each function returns whether it has warned: the first warning stands for all
        for warn_of_one in (stepper.rotations.warn_of, warn_of_missed_rate):
            next(filter(warn_of_one, members), None)
    else:  # the row at which an impact ends a run is in its member alone
        lengths = [min(runs.first.rows_after(member.report.steps) + 1, len(member))
                   for member in members]
        state_count = runs.first.rows + 1
        if not interrupts.is_requested:
            _warn_of_early_ends(finished_runs, runs.first.steps)
    failures = {i: failure_of(stepper.binding, runs[i], finished.trajectory,
                              Diagnosis.bare(finished.status), finished.q)
                for i, finished in enumerate(finished_runs) if finished.status}
    crossings = {event.name: CrossingsOfMany([member.events[event.name] for member in members])
                 for event in events}
    ensemble = Ensemble(**_padded_arrays(members, lengths, state_count), failures=failures,
                        _name=stepper.name, _make=members.__getitem__, events=crossings)
    if interrupts.is_requested:
        raise _stop_exception(interrupts, sum(map(len, members)), ensemble, ensemble.t.size)
    return ensemble


def _run_on_threads(
    stepper: Stepper, runs: EnsembleArguments, events: tuple[Any, ...], t_end: Any, threads: int,
    report: Callable[..., Any] | None, stop: Callable[[], bool],
) -> list[_FinishedRun]:
    """Integrate each run by itself on at most ``threads`` threads; return them in their order.

    ``report`` is called with the number of steps of all runs so far. An InputError names its run.
    """
    step_counts = [0] * len(runs)

    def integrate_run(i: int) -> _FinishedRun:
        """Integrate run i, and count its steps among those of all runs."""
        def count_steps(steps: int) -> None:
            """Note the steps of run i so far, and report the sum of all runs."""
            step_counts[i] = steps
            if report is not None:
                report(sum(step_counts))
        _refuse_undefined_energy(stepper, runs, i)
        try:
            return _integrate_alone(stepper, runs[i], events, t_end, stop, count_steps)
        except InputError as error:
            raise InputError(f"Trajectory {i}: {error}") from None

    with warnings.catch_warnings(), ThreadPoolExecutor(min(threads, len(runs))) as pool:
        # each run would warn of gaps that stay closed; the caller gives one warning for all
        warnings.simplefilter("ignore", InputWarning)
        return list(pool.map(integrate_run, range(len(runs))))


class _FinishedRun(NamedTuple):
    """A run with its events, the status of the compiled steps (0: no failure), and its last q."""

    trajectory: Trajectory
    status: int
    q: Array


def _integrate_alone(
    stepper: Stepper, run: RunArguments, events: tuple[Any, ...], t_end: Any,
    stop: Callable[[], bool], count_steps: Callable[[int], None],
) -> _FinishedRun:
    """Integrate one run with its events, to its last step or to ``t_end`` in scaled time.

    ``stop`` says whether the run shall end early; ``count_steps`` takes the number of steps so far.
    """
    binding, clock = stepper.binding, stepper.manifest.system.clock
    end_event = ""
    if t_end is not None:
        assert clock is not None  # t_end is given in scaled time alone
        run = replace_fields(run, steps=OPEN, open_end=True)
        end = end_of_run(clock, events, binding.time_of(run.q), t_end, run.dt)
        events, end_event = (*events, end), end.name
    observer = observer_to_end(stepper, run, events)
    trajectory, status, state = march(binding, stepper.manifest, run, stop, count_steps, observer)
    trajectory = with_events(stepper, run, observer, trajectory, observer.take_crossings())
    # without t_end the events are impacts: other runs are integrated side by side
    origin = Origin(run, impacts=() if end_event else events)
    if end_event:
        trajectory = with_end_apart(trajectory, end_event)
        # derivatives of the run repeat as many steps as it took
        origin = Origin(run.until(trajectory.report.steps), events)
    return _FinishedRun(trajectory.made_by(stepper, origin), status, state.q)


def _warn_of_early_ends(runs: Sequence[_FinishedRun], steps: int) -> None:
    """Warn of runs that impacts have ended before ``steps`` steps; failed runs do not count."""
    count = sum(run.trajectory.report.steps < steps and not run.status for run in runs)
    if count:
        warn(f"{count:,} of {count_text(len(runs), 'trajectory')} end before the last step, where "
             "a gap "
             "stays closed or a terminal impact ends them; their last rows are in members.")


def _padded_arrays(
    members: Sequence[Trajectory], lengths: Sequence[int], states: int
) -> dict[str, Any]:
    """Return t, q, p, multipliers and iterations by name, with ``states`` rows a trajectory.

    Member i fills its first ``lengths[i]`` rows; the rows behind are NaN, and 0 iterations.
    """
    first_member, count = members[0], len(members)
    arrays: dict[str, Any] = {
        name: np.full((count, states - of_steps, *getattr(first_member, name).shape[1:]), np.nan,
                      getattr(first_member, name).dtype)
        # multipliers and iterations are of a step, and the start has none
        for name, of_steps in (("t", 0), ("q", 0), ("p", 0), ("multipliers", 1))}
    iterations = np.zeros((count, states - 1), np.intc)
    for i, (member, length) in enumerate(zip(members, lengths, strict=True)):
        for name in ("t", "q", "p"):
            arrays[name][i, :length] = getattr(member, name)[:length]
        arrays["multipliers"][i, : length - 1] = member.multipliers[: length - 1]
        iterations[i, : length - 1] = member.iterations[: length - 1]
    return arrays | {"iterations": iterations}


def _with_tangents(
    stepper: Stepper, ensemble: Ensemble, tangents_asked: Tangents, threads: int,
    stop: Callable[[], bool]
) -> Ensemble:
    """Return an ensemble whose trajectories have their tangents, with the bits of each alone.

    A run that has failed, or after ``stop()``, has None.
    """
    _ = stepper._derivative_binding()  # compiled once, before threads ask for it

    def member_with_tangents(i: int) -> Trajectory | None:
        """Return trajectory i with its tangents, None if it failed or the ensemble stops."""
        if i in ensemble.failures or stop():
            return None
        return with_tangents(stepper, tangents_asked, ensemble._make(i))

    with ThreadPoolExecutor(min(threads, len(ensemble))) as pool:
        trajectories = list(pool.map(member_with_tangents, range(len(ensemble))))
    tangents = [None if trajectory is None else trajectory.tangents for trajectory in trajectories]

    def member(i: int) -> Trajectory:
        """Return trajectory i with the tangents that are computed by now."""
        return replace_fields(ensemble._make(i), tangents=tangents[i])

    return replace(ensemble, tangents=tangents, _make=member)


def _number_of_each_run(name: str, value: Any, size: int) -> Array:
    """Return one number, or one for each of ``size`` trajectories; refuse other shapes."""
    array = as_numbers(name, value)
    if array.shape not in ((), (size,)):
        raise InputError(f"{name} has shape {array.shape}; give one number or {size} of them.")
    return array


def _rows(stepper: Stepper, name: str, value: Any) -> Array:
    """Return a row of numbers for each trajectory, in the stepper's type; refuse other shapes."""
    array = stepper.binding.numbers(name, value)
    if array.ndim != 2:
        raise InputError(f"{name} has shape {array.shape}; give one row for each trajectory.")
    return array


def _parameters_of_runs(
    parameters: Any, size: int, domains: Mapping[str, str]
) -> list[dict[str, Any]] | tuple[dict[str, Any], dict[str, Array]]:
    """Return the parameters of ``size`` trajectories.

    From a list of dicts: a dict for each trajectory. From one dict: the values and rules that all
    share, and the columns of the others, each of shape (size,), both by name.
    """
    if isinstance(parameters, Mapping):
        parameters = with_rules(parameters, domains)
        refuse_texts(parameters, domains)
        # rules are evaluated later, with the inertia of each run
        rules = {name: rule for name, rule in parameters.items() if isinstance(rule, Rule)}
        columns = {name: _number_of_each_run(f"Parameter {name}", number_or_rule, size)
                   for name, number_or_rule in parameters.items() if name not in rules}
        common_values = {name: column[()] for name, column in columns.items() if not column.shape}
        return rules | common_values, {name: column for name, column in columns.items()
                                       if column.shape}
    if not isinstance(parameters, Sequence) or not all(isinstance(r, Mapping) for r in parameters):
        raise InputError(f"parameters = {shown(parameters)} is neither a dict nor a list of "
                         "dicts.")
    if len(parameters) != size:
        raise InputError(f"{len(parameters)} sets of parameters are given for "
                         f"{count_text(size, 'trajectory')}.")
    return [dict(with_rules(run, domains)) for run in parameters]
