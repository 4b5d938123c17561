"""The last step of a run that ends between two steps: a real step of a part of Δt to t_end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ...core.arrays import Array
from ...core.errors import StepFailed, Stopped
from ...core.event import Event, Impact
from ...core.records import replace_fields
from ..bindings.run_memory import Rows
from ..integration.run_arguments import RunArguments
from ..results.crossings import Crossings, Impacts
from ..results.diagnostics import Report
from ..results.outputs import flat_multipliers
from ..results.trajectory import Trajectory
from .observer import impact_losses, integrate_observed, report_with_row, with_row

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["counted_from_start", "ended_between", "joined_with_part", "report_to_end", "row_of"]

CrossingsType = TypeVar("CrossingsType", bound=Crossings)


def ended_between(
    stepper: Stepper, run: RunArguments, events: Sequence[Event | Impact], trajectory: Trajectory,
) -> Trajectory:
    """Return a run of whole steps with one more row: the state ``run.rest`` later, at t_end.

    The row of its last whole step is left out, unless ``every`` or ``t_eval`` stores it. A run that
    a terminal event, or a gap that stays closed, has ended is returned as it is; one in the last
    part of a step ends it there. Raises StepFailed or Stopped in that part of a step, with the run
    of whole steps.
    """
    if trajectory._ended_by is not None:
        return trajectory
    # a run of one step of length ``rest``, with events of its own
    partial_arguments = run.part_of_step(trajectory.q[-1], trajectory.p[-1], trajectory.t[-1])
    try:
        partial_run = integrate_observed(stepper, partial_arguments, events, progress=None)
    except StepFailed as error:
        raise StepFailed(step=run.steps + 1, t=error.t, reason=error.reason, trajectory=trajectory,
                         increment=error.increment, dt=error.dt, detail=error.detail,
                         cure=error.cure) from None
    except Stopped as error:
        error.trajectory = trajectory
        raise
    return joined_with_part(stepper, run, trajectory, partial_run)


def joined_with_part(
    stepper: Stepper, run: RunArguments, trajectory: Trajectory, partial_run: Trajectory,
) -> Trajectory:
    """Return a run of whole steps with the end of ``partial_run``, a partial step, as last row.

    The last row of the whole steps is left out where ``every`` or ``t_eval`` does not store it.
    """
    # the state after whole steps, from which the grid of steps goes on
    last_elapsed, grid = trajectory.elapsed[-1], trajectory[len(trajectory) - 1]
    if partial_run._ended_by is not None:
        times = partial_run.t[-1:], last_elapsed + partial_run.elapsed[-1:]
    else:
        times = (np.array([run.t_end], trajectory.t.dtype),
                 np.array([last_elapsed + run.rest], trajectory.elapsed.dtype))
    # the last whole step has a row in any case; between two stored ones it gives way to the end
    is_stored = run.stored_steps is not None or run.steps % run.every == 0
    row_count = len(trajectory) - (not is_stored)
    work = trajectory.work[-1] + partial_run.work[-1:]
    longer_run = with_row(stepper, trajectory, row_count, times, row_of(partial_run, work))
    crossings = {name: _join(run, of_steps, partial_run.events[name], trajectory)
                 for name, of_steps in trajectory.events.items()}
    impacts = {name: _join(run, of_steps, partial_run.impacts[name], trajectory)
               for name, of_steps in trajectory.impacts.items()}
    losses = impact_losses(impacts, {})
    return replace_fields(longer_run,
                          report=report_to_end(stepper, run, trajectory.report, partial_run,
                                               work, losses),
                          events=crossings, impacts=impacts, _grid=grid,
                          _ended_by=partial_run._ended_by)


def row_of(last: Trajectory, work: Array) -> Rows:
    """Return the last row of a partial step, with ``work``, (1,), of the whole run in J."""
    return Rows(last.q[-1:], last.p[-1:], flat_multipliers(last)[-1:], last.iterations[-1:], work)


def report_to_end(
    stepper: Stepper, run: RunArguments, report: Report, partial_run: Trajectory, work: Array,
    losses: Mapping[str, Any],
) -> Report:
    """Return the report of a run that ends with a partial step, from its whole steps' report.

    ``work``, shape (1,), and ``losses``, in J, are the work of the whole run, and the energy lost
    in the impacts of each gap.
    """
    to_end = report_with_row(stepper, run, report, partial_run.t[-1:], row_of(partial_run, work),
                             losses)
    # impacts in the last part have states of their own
    of_part = partial_run.report
    return replace(
        to_end, impacts=report.impacts + of_part.impacts,
        constraint_max=max(to_end.constraint_max, of_part.constraint_max),
        momentum_constraint_max=max(to_end.momentum_constraint_max,
                                    of_part.momentum_constraint_max))


def _join(
    run: RunArguments, earlier: CrossingsType, last: CrossingsType, trajectory: Trajectory
) -> CrossingsType:
    """Return the crossings of whole steps, ``earlier``, and of the partial step after them."""
    latest = earlier.elapsed[-1] if len(earlier) else None
    return earlier.joined(counted_from_start(last, run.steps, trajectory.elapsed[-1],
                                             trajectory.work[-1], latest))


def counted_from_start(
    last: CrossingsType, steps: int, elapsed: Any, work: Any, latest: Any
) -> CrossingsType:
    """Return the crossings of a partial last step, their times and steps from the start of the run.

    ``steps``, ``elapsed`` and ``work`` belong to the whole steps, ``latest`` is the time since the
    start of the last crossing in them. A crossing at the end of the last whole step is in both: it
    counts once.
    """
    is_at_start = np.array(last.elapsed == 0 * elapsed, bool)
    is_new = ~is_at_start | (latest is None or latest != elapsed)
    last = replace(last._select(is_new), steps=last.steps[is_new] + steps,
                   elapsed=last.elapsed[is_new] + elapsed)
    return replace(last, work=last.work + work) if isinstance(last, Impacts) else last
