"""The last step of a run that ends between two steps: a real step of a part of Δt to t_end."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import StepFailed, Stopped
from ...core.event import Event
from ...core.records import changed
from ..bindings.array_checks import as_real
from ..bindings.run_memory import Rows
from ..integration.run_arguments import RunArguments
from ..results.crossings import Crossings
from ..results.run_arrays import flat_multipliers
from ..results.trajectory import Trajectory
from .location import ending
from .observer import observed, with_row

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["ended_between"]


def ended_between(
    stepper: Stepper, run: RunArguments, events: tuple[Event, ...], found: Trajectory,
    rest: Fraction, t_end: Any,
) -> Trajectory:
    """Return a run of whole steps with one row more: its state ``rest`` seconds later, at t_end.

    The row of its last whole step is left out, unless ``every`` or ``t_eval`` stores it. A run that
    a terminal event has ended is returned as it is; one in the last part of a step ends it there.

    Raises
    ------
    StepFailed, Stopped
        In that part of a step, with the run of whole steps.
    """
    if ending(events, found.events, run.dt) is not None:
        return found
    binding, done = stepper.binding, run.steps
    begun = found.elapsed[-1]
    grid = found[len(found) - 1]
    part = replace(run.at_step(done), q=found.q[-1].copy(), p=found.p[-1].copy(), t0=found.t[-1],
                   dt=binding.number(rest), steps=1, every=1, inputs=None, stored_steps=None)
    try:
        last = observed(stepper, part, events, None)
    except StepFailed as error:
        raise StepFailed(step=done + 1, t=error.t, reason=error.reason, trajectory=found,
                         increment=error.increment, dt=error.dt, detail=error.detail,
                         cure=error.cure) from None
    except Stopped as error:
        error.trajectory = found
        raise
    if ending(events, last.events, run.dt) is None:
        end = as_real("t_end", t_end, binding.number)
        times = (np.array([end], found.t.dtype),
                 np.array([begun + part.dt], found.elapsed.dtype))
    else:
        times = last.t[-1:], begun + last.elapsed[-1:]
    stored = run.stored_steps is not None or done % run.every == 0
    rows = len(found) - (not stored)
    work = found.work[-1] + last.work[-1:]
    report = replace(
        found.report, q=tuple(map(float, last.q[-1].tolist())),
        p=tuple(map(float, last.p[-1].tolist())), work=float(work[0]),
        constraint_max=max(found.report.constraint_max, last.report.constraint_max),
        momentum_constraint_max=max(found.report.momentum_constraint_max,
                                    last.report.momentum_constraint_max))
    joined = with_row(stepper, found, rows, times, Rows(
        last.q[-1:], last.p[-1:], flat_multipliers(last)[-1:], last.iterations[-1:], work))
    crossings = {name: _together(stepper, run, before, last.events[name], begun)
                 for name, before in found.events.items()}
    return changed(joined, report=report, events=crossings, _grid=grid)


def _together(
    stepper: Stepper, run: RunArguments, before: Crossings, last: Crossings, begun: Any
) -> Crossings:
    """Return the crossings of a run and of its last part of a step.

    What happens at the end of the last whole step is in both of them.
    """
    once = np.array(last.elapsed != 0 * begun, bool) | (
        not (len(before) and before.elapsed[-1] == begun))
    return Crossings(
        np.concatenate([before.t, last.t[once]]), np.concatenate([before.q, last.q[once]]),
        np.concatenate([before.p, last.p[once]]),
        np.concatenate([before.steps, last.steps[once] + run.steps]),
        np.concatenate([before.rising, last.rising[once]]),
        np.concatenate([before.elapsed, last.elapsed[once] + begun]))
