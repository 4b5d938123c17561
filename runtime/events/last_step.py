"""The last step of a run that ends between two steps: a real step of a part of Δt to t_end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from operator import add
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
from .observer import integrate_observed, with_row

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["counted_from_start", "ended_between", "impact_losses", "joined_with_part",
           "report_to_end", "row_of"]

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
                                               work[0], losses),
                          events=crossings, impacts=impacts, _grid=grid,
                          _ended_by=partial_run._ended_by)


def row_of(last: Trajectory, work: Array) -> Rows:
    """Return the last row of a partial step, with ``work``, (1,), of the whole run in J."""
    return Rows(last.q[-1:], last.p[-1:], flat_multipliers(last)[-1:], last.iterations[-1:], work)


def impact_losses(crossings: Mapping[str, Crossings], earlier: Mapping[str, Any]) -> dict[str, Any]:
    """Return the energy lost in the impacts of each gap, by its name, added to ``earlier`` losses.

    The order of the sum does not depend on the pieces in which the impacts come.
    """
    return {**earlier, **{name: reduce(add, hits.energy_lost, earlier.get(name, 0.0))
                          for name, hits in crossings.items() if isinstance(hits, Impacts)}}


def report_to_end(
    stepper: Stepper, run: RunArguments, report: Report, partial_run: Trajectory, work: Any,
    losses: Mapping[str, Any],
) -> Report:
    """Return the report of a run that ends with a partial step, from its whole steps' report.

    ``work`` and ``losses``, in J, are the work of the whole run, and the energy lost in the impacts
    of each gap.
    """
    binding = stepper.binding
    H = binding.hamiltonian(binding.parameters(run.parameters, run.t0), run.q[None], run.p[None])
    energy_error = abs(partial_run.energies[-1] - H[0] - work
                       + sum(losses[name] for name in sorted(losses)))
    return replace(
        report, q=tuple(map(float, partial_run.q[-1].tolist())),
        p=tuple(map(float, partial_run.p[-1].tolist())),
        # NaN where an energy is
        energy_error_max=float(np.maximum(report.energy_error_max, float(energy_error))),
        work=float(work), impacts=report.impacts + partial_run.report.impacts,
        constraint_max=max(report.constraint_max, partial_run.report.constraint_max),
        momentum_constraint_max=max(report.momentum_constraint_max,
                                    partial_run.report.momentum_constraint_max))


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
