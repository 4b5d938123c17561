"""The last step of a run that ends between two steps: a real step of a part of Δt to t_end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ...core.errors import StepFailed, Stopped
from ...core.event import Event, Impact
from ...core.records import changed
from ..bindings.array_checks import as_real
from ..bindings.run_memory import Rows
from ..integration.run_arguments import RunArguments
from ..results.crossings import Crossings, Impacts
from ..results.run_arrays import flat_multipliers
from ..results.trajectory import Trajectory
from .location import ending
from .observer import observed, with_row

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["ended_between"]

CrossingsType = TypeVar("CrossingsType", bound=Crossings)


def ended_between(
    stepper: Stepper, run: RunArguments, events: Sequence[Event | Impact], trajectory: Trajectory,
    remaining_time: Fraction, t_end: Any,
) -> Trajectory:
    """Return a run of whole steps with one more row: the state ``remaining_time`` later, at t_end.

    The row of its last whole step is left out, unless ``every`` or ``t_eval`` stores it. A run that
    a terminal event, or a gap that stays closed, has ended is returned as it is; one in the last
    part of a step ends it there.

    Raises
    ------
    StepFailed, Stopped
        In that part of a step, with the run of whole steps.
    """
    if (trajectory.report.steps < run.steps
            or ending(events, trajectory.events, run.dt) is not None):
        return trajectory
    binding, whole_steps = stepper.binding, run.steps
    last_elapsed = trajectory.elapsed[-1]
    grid = trajectory[len(trajectory) - 1]
    partial_run = replace(run.at_step(whole_steps), q=trajectory.q[-1].copy(),
                          p=trajectory.p[-1].copy(), t0=trajectory.t[-1],
                          dt=binding.number(remaining_time), steps=1, every=1, inputs=None,
                          stored_steps=None)
    try:
        last_trajectory = observed(stepper, partial_run, events, None)
    except StepFailed as error:
        raise StepFailed(step=whole_steps + 1, t=error.t, reason=error.reason,
                         trajectory=trajectory,
                         increment=error.increment, dt=error.dt, detail=error.detail,
                         cure=error.cure) from None
    except Stopped as error:
        error.trajectory = trajectory
        raise
    if last_trajectory.report.steps and ending(events, last_trajectory.events, run.dt) is None:
        end = as_real("t_end", t_end, binding.number)
        times = (np.array([end], trajectory.t.dtype),
                 np.array([last_elapsed + partial_run.dt], trajectory.elapsed.dtype))
    else:
        times = last_trajectory.t[-1:], last_elapsed + last_trajectory.elapsed[-1:]
    stored = run.stored_steps is not None or whole_steps % run.every == 0
    row_count = len(trajectory) - (not stored)
    work = trajectory.work[-1] + last_trajectory.work[-1:]
    report = replace(
        trajectory.report, q=tuple(map(float, last_trajectory.q[-1].tolist())),
        p=tuple(map(float, last_trajectory.p[-1].tolist())), work=float(work[0]),
        impacts=trajectory.report.impacts + last_trajectory.report.impacts,
        constraint_max=max(trajectory.report.constraint_max, last_trajectory.report.constraint_max),
        momentum_constraint_max=max(trajectory.report.momentum_constraint_max,
                                    last_trajectory.report.momentum_constraint_max))
    joined = with_row(stepper, trajectory, row_count, times, Rows(
        last_trajectory.q[-1:], last_trajectory.p[-1:], flat_multipliers(last_trajectory)[-1:],
        last_trajectory.iterations[-1:], work))
    crossings = {name: _joined(run, before, last_trajectory.events[name], trajectory)
                 for name, before in trajectory.events.items()}
    impacts = {name: _joined(run, before, last_trajectory.impacts[name], trajectory)
               for name, before in trajectory.impacts.items()}
    return changed(joined, report=report, events=crossings, impacts=impacts, _grid=grid)


def _joined(
    run: RunArguments, earlier: CrossingsType, last: CrossingsType, trajectory: Trajectory
) -> CrossingsType:
    """Return the crossings of a run and of its last part of a step.

    A crossing at the end of the last whole step is in both of them.
    """
    last_elapsed = trajectory.elapsed[-1]
    only_in_last = np.array(last.elapsed != 0 * last_elapsed, bool) | (
        not (len(earlier) and earlier.elapsed[-1] == last_elapsed))
    last = replace(last._selected(only_in_last), steps=last.steps[only_in_last] + run.steps,
                   elapsed=last.elapsed[only_in_last] + last_elapsed)
    if isinstance(last, Impacts):
        last = replace(last, work=last.work + trajectory.work[-1])
    return earlier.joined(last)
