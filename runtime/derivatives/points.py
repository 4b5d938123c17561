"""States of a run within its steps, and their derivatives: at given times, and at events.

A state τ after the state z_j of step j is one step Φ_τ(z_j), that starts at t_j = t0 + j Δt. With
v = ∂Φ_τ/∂τ and Z = dΦ_τ at fixed τ (along dz_j, dθ and dt_j) it moves by

    dz = Z + v dτ,   dt = dt_j + dτ

- at a fixed time: dτ = −dt_j = −dt0 − j dΔt;
- at an event c(z, θ, t) = 0: dτ = −(c_z Z + c_θ dθ + c_t dt_j) / (c_z v + c_t), where c is a
  coordinate, a momentum or a quantity less its level.

In scaled time τ and Δτ stand for t and Δt here, and t is a coordinate: a fixed time is an event.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arrays import Array
from ...core.errors import InputError
from ...core.event import Event, Impact
from ...core.records import dataclass
from ...core.registry import function_of
from ..events.location import first_terminal_event
from ..integration.dense_output import places_of
from ..integration.run_arguments import Origin, RunArguments
from ..results.crossings import Crossings, Impacts
from .kept_steps import SingleStep

if TYPE_CHECKING:
    from ..results.trajectory import Trajectory
    from ..steppers.stepper import Stepper

__all__ = ["SAME_STEP", "Point", "RunRows", "cotangent_at", "rate_of", "rows_of", "tangent_at"]

#: A value that changes more slowly than this share of |c_z| |v| only touches its level.
_GRAZING = 1e-6
#: Share of a step to which the times of a file are those of ends of steps.
SAME_STEP = 1e-6


@dataclass(frozen=True)
class Point:
    """A state of a run, ``tau`` after the state at the start of a step.

    Attributes
    ----------
    step : int
        Whole steps before it.
    tau : number
        In (0, Δt]; None at the start of the run.
    normal : array, shape (rows,), optional
        c_z, c_θ and c_t of an event's value c, with c_t in the row of the start time; None at a
        fixed time.
    name : str
        The event's name; empty at a fixed time.
    """

    step: int
    tau: Any
    normal: Array | None = None
    name: str = ""


@dataclass(frozen=True)
class RunRows:
    """Kinds of the rows of a trajectory: ends of steps, points between them, and events.

    Attributes
    ----------
    run : RunArguments
        The whole steps of the run, up to its end or a terminal event.
    points : list of Point
        The rows that are within steps: all rows, or the last one.
    at_times : bool
        Whether all rows are within steps.
    events : dict of str to list of Point
    refused : dict of str to str
        Events that have no derivatives, and why.
    """

    run: RunArguments
    points: list[Point] = field(default_factory=list)
    at_times: bool = False
    events: dict[str, list[Point]] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)

    @property
    def of_steps(self) -> Array:
        """Steps before each row that is the end of a step."""
        if self.at_times:
            return np.zeros(0, int)
        steps = self.run.steps_of_rows(self.run.steps)
        # the last row is the point itself if its step is no multiple of ``every``
        unstored = bool(self.points) and self.run.steps % self.run.every > 0
        return steps[: len(steps) - unstored]

    def event(self, name: str) -> list[Point]:
        """Return the points of an event, or refuse one that has no derivatives."""
        if name in self.refused:
            raise InputError(self.refused[name])
        return self.events[name]


def rows_of(stepper: Stepper, trajectory: Trajectory, run: RunArguments) -> RunRows:
    """Classify the rows of a trajectory of ``run``: ends of steps, points between, events.

    Raises InputError for rows at other times than ends of steps, where it is not known what made
    them, and for a terminal event that has no derivatives.
    """
    origin: Origin | None = trajectory._origin
    if origin is None:  # of a file, a store or a simulation
        rest = _rest_of(stepper, trajectory, run)
        if trajectory._laws:
            impacts = _from_first_row(stepper, trajectory, run)
            run = replace(run, hits=_hits_of(stepper, run, impacts, trajectory._laws))
        reason = ("A trajectory that was stored does not know which quantities its events are of; "
                  "integrate again for derivatives of events.")
        return RunRows(run, points=[Point(run.steps, rest)] if rest else [],
                       refused=dict.fromkeys(trajectory.events, reason))
    # a terminal event ends a run before the steps that were asked for
    step_count = int(trajectory.report.steps)
    run = replace(run.until(step_count), stored_steps=None)
    if origin.impacts:
        run = replace(run, hits=_hits(stepper, trajectory, origin, run))
    crossings = trajectory.events | trajectory._end_event
    events, refused = _points_of_events(stepper, run, origin, crossings)
    # the event that t_end makes in scaled time is none of the user's
    points_of_events = {name: points for name, points in events.items()
                        if name in trajectory.events}
    if origin.between:
        times = trajectory.tau if stepper.binding.clocked else trajectory.t
        return RunRows(replace(run, every=max(step_count, 1)),
                       points=_points_at_times(stepper, run, times), at_times=True,
                       events=points_of_events, refused=refused)
    run_rows = RunRows(run, events=events, refused=refused)
    terminal_name = first_terminal_event(origin.events, crossings, run.dt)
    if terminal_name is not None:
        return replace(run_rows, points=run_rows.event(terminal_name)[-1:], events=points_of_events)
    # t_end between two steps: the last row is ``rest`` after the last whole step
    return replace(run_rows, points=[Point(step_count, origin.rest)]) if origin.rest else run_rows


def _points_of_events(
    stepper: Stepper, run: RunArguments, origin: Origin, crossings: Mapping[str, Crossings]
) -> tuple[dict[str, list[Point]], dict[str, str]]:
    """Return the points of each event by its name, and the errors of events that have none.

    An event without derivatives is no error until its derivatives are asked for.
    """
    points: dict[str, list[Point]] = {}
    refused: dict[str, str] = {}
    for event in origin.events:
        try:
            points[event.name] = _points_of_event(stepper, run, event, crossings[event.name])
        except InputError as error:
            refused[event.name] = str(error)
    return points, refused


def _hits(
    stepper: Stepper, trajectory: Trajectory, origin: Origin, run: RunArguments
) -> Mapping[int, Any]:
    """Return the impacts of a run, index of a step → list of ``impacts.Hit``.

    Raises InputError for rows that have no derivatives in a run with impacts.
    """
    if origin.between:
        raise InputError("States of t_eval in a run with impacts have no derivatives: leave t_eval "
                         "out, and give t_end for a state between two steps.")
    if run.steps < origin.run.steps:
        raise InputError("This run has no derivatives, for an impact ends it, at t = "
                         f"{float(trajectory.t[-1]):.9g} s: end it before that time.")
    return _hits_of(stepper, run, trajectory.impacts, origin.impacts)


def _hits_of(
    stepper: Stepper, run: RunArguments, crossings: Mapping[str, Impacts], laws: Sequence[Impact]
) -> Mapping[int, Any]:
    """Return the impacts of a run, index of a step → list of ``impacts.Hit``."""
    hits: Mapping[int, Any] = function_of("runtime.derivatives.impacts", "hits_of")(
        stepper, run, crossings, laws)
    return hits


def _points_at_times(stepper: Stepper, run: RunArguments, t: Array) -> list[Point]:
    """Return the points at fixed times t, each in the step that it lies in.

    In scaled time t is the coordinate n − 1, and a fixed time an event of it.
    """
    # times since the start, whose zero is of t0's type, up to the end of a last part of a step
    time_span = stepper.binding.times(0 * run.t0, run.dt, np.array([0, run.steps + 1]))
    places = places_of(stepper, run.t0, time_span, run.dt, t)
    clock_normal = _unit(stepper, stepper.binding.n - 1) if stepper.binding.clocked else None
    return [replace(_point(run, int(step), remainder), normal=clock_normal)
            for step, remainder in zip(places.steps, places.rest.tolist(), strict=True)]


def _unit(stepper: Stepper, row: int) -> Array:
    """Return the derivatives, (rows,), of an entry of a direction: 1 by itself, 0 by others."""
    unit: Array = stepper.binding.new(stepper._derivative_binding().rows)
    unit[row] = 1
    return unit


def _point(run: RunArguments, step: int, tau: Any) -> Point:
    """Return the point ``tau`` after ``step`` whole steps."""
    if tau:
        return Point(step, tau)
    # a point at the end of a step is τ = Δt of the step before, so that it has a step to
    # differentiate
    return Point(step - 1, run.dt) if step else Point(0, tau=None)


def _points_of_event(
    stepper: Stepper, run: RunArguments, event: Event, crossings: Crossings
) -> list[Point]:
    """Return the points of an event, each with the derivatives of the event's value.

    Raises InputError for an event at the start, or whose value has no compiled derivatives.
    """
    # zero in t0's type, so that τ has the type of the run
    step_starts = stepper.binding.times(0 * run.t0, run.dt, crossings.steps)
    taus = (crossings.elapsed - step_starts).tolist()
    points = []
    for i, (step, tau) in enumerate(zip(crossings.steps, taus, strict=True)):
        normal = _normal(stepper, run, event, crossings, i)
        points.append(replace(_point(run, int(step), tau), name=event.name, normal=normal))
    if any(point.tau is None for point in points):
        raise InputError(f"The event {event.name!r} happens at the start itself, where it has no "
                         "derivatives; start before it.")
    return points


def _normal(
    stepper: Stepper, run: RunArguments, event: Event, crossings: Crossings, i: int
) -> Array:
    """Return c_z, c_θ and c_t of an event's value c at its crossing i, shape (rows,).

    Raises InputError for a quantity whose derivatives were not compiled.
    """
    binding, system = stepper._derivative_binding(), stepper.manifest.system
    quantities, n = list(system.quantities), stepper.binding.n
    # rows of a direction; in scaled time t is the last coordinate
    row_of = {name: row for row, name in enumerate(system.coordinates)}
    row_of |= {name: n + row for row, name in enumerate(system.momenta)}
    if system.clock is not None:
        row_of[system.clock.time] = n - 1
    if event.quantity not in quantities:
        return _unit(stepper, row_of[event.quantity])
    # rows of a trajectory have q and p that users see; C takes t and e with them in scaled time
    state = stepper.binding.start_in_scaled_time(
        stepper.binding.parameters(run.parameters, run.t0), crossings.q[i].copy(),
        crossings.p[i].copy(),
        crossings.t[i])
    rows = binding.quantity_derivatives(
        binding.module.parameters(run.parameters, run.t0), crossings.t[i], *state)
    if rows is None:
        raise InputError(
            f"The event {event.name!r} is of the quantity {event.quantity!r}, and this system has "
            "too many or too long quantities for derivatives; take a coordinate or a momentum: "
            f"{', '.join(row_of)}.")
    normal: Array = rows[quantities.index(event.quantity)]
    return normal


def _rest_of(stepper: Stepper, trajectory: Trajectory, run: RunArguments) -> Any:
    """Return the part of a step from the last whole step of ``run`` to t_end, 0 if there is none.

    Raises InputError for a trajectory whose other rows are not ends of steps, and for one that an
    event ends: the time of its last row is no t_end.
    """
    binding, steps = stepper.binding, run.steps_of_rows(run.steps)
    rest = trajectory.elapsed[-1] - binding.times(0 * run.t0, run.dt, steps[-1:])[0]
    row_times = trajectory.tau if binding.clocked else trajectory.t
    if abs(rest) <= SAME_STEP * abs(run.dt):
        rest = 0 * rest
    else:  # the last whole step has a row if its number is a multiple of ``every``
        ends_at_event = any(len(crossings) and crossings.t[-1] == row_times[-1]
                            for crossings in trajectory.events.values())
        row_times = row_times[:0] if binding.clocked or ends_at_event else row_times[:-1]
        steps = steps[: len(steps) - (run.steps % run.every > 0)]
    step_ends = binding.times(run.t0, run.dt, steps)
    if len(step_ends) != len(row_times) or not all(
            abs(x - y) <= SAME_STEP * abs(run.dt)
            for x, y in zip(step_ends, row_times, strict=True)):
        raise InputError("Rows of this trajectory are not ends of its steps, and it does not know "
                         "the run that they are of, for it was stored or belongs to a simulation; "
                         "integrate again for derivatives.")
    return rest


def _from_first_row(
    stepper: Stepper, trajectory: Trajectory, run: RunArguments
) -> Mapping[str, Impacts]:
    """Return the impacts of a trajectory that may be a slice, with steps from its first row on.

    Raises InputError for one that begins within a step of the run that it is a part of.
    """
    def shifted(crossings: Impacts) -> Impacts:
        """Return the impacts of a gap after the first row."""
        if not len(crossings):
            return crossings
        skipped = float((crossings.elapsed[0] - (crossings.t[0] - trajectory.t[0])) / run.dt)
        count = round(skipped)
        if abs(skipped - count) > SAME_STEP:
            raise InputError("This part of a run with impacts begins within a step; integrate "
                             "again for derivatives.")
        elapsed = stepper.binding.times(0 * run.t0, run.dt, np.array([count]))
        return replace(crossings, steps=crossings.steps - count,
                       elapsed=crossings.elapsed - elapsed)

    return {name: shifted(crossings) for name, crossings in trajectory.impacts.items()}


def single_step(stepper: Stepper, run: RunArguments, point: Point, z: Array) -> SingleStep:
    """Return the step of length τ from a state z, (2 n,), that leads to a point.

    z and the point are in space, not in a co-moving frame.
    """
    n, parameters = stepper.binding.n, run.parameters
    # the inputs of the point's step are constant in it: parameters of this step
    if run.inputs is not None:
        parameters = parameters | dict(zip(
            run.inputs.names, run.inputs.at(point.step).tolist(), strict=True))
    return SingleStep(stepper, replace(
        run, q=z[:n].copy(), p=z[n:].copy(), dt=point.tau, steps=1, every=1,
        t0=run.t0 + point.step * run.dt, inputs=None, parameters=parameters, hits=None))


def tangent_at(
    stepper: Stepper, run: RunArguments, point: Point, z: Array, dz: Array,
    multipliers: bool = False,
) -> tuple[Array, Array]:
    """Return the directions of a point, shape (2 n, k), and of its time, shape (k,).

        dz = Z + v dτ,   dt = dt_j + dτ   (with dτ as in the module docstring)

    z, (2 n,), is the state before the point's step, in space; ``dz``, (rows, k), has directions of
    z in its rows q and p. With ``multipliers``, directions of the multipliers of the step follow
    in further rows; at the start of a run they are 0.
    """
    n, count = stepper.binding.n, dz.shape[1]
    if point.tau is None:
        forces = stepper.binding.new(stepper.binding.multipliers if multipliers else 0, count)
        return np.concatenate([dz[: 2 * n], forces]), dz[-1].copy()
    step_directions = stepper.binding.new(len(dz), count + 1)
    step_directions[:, :count] = dz
    step_directions[-2] = 0
    # t_j = t0 + j Δt moves by dt0 + j dΔt; the step to the point has the fixed length τ; one more
    # column gives v = ∂Φ_τ/∂τ
    step_directions[-1, :count] += point.step * dz[-2]
    step_directions[-2, count] = 1
    end_directions = single_step(stepper, run, point, z).tangent(step_directions, multipliers)
    Z, v, dt = end_directions[:, :count], end_directions[:, count], step_directions[-1, :count]
    if point.normal is None:
        # at a fixed time dτ = −dt_j; at an event dτ = −(c_z Z + c_θ dθ + c_t dt_j)/(c_z v + c_t)
        d_tau = -dt
    else:
        directions = np.concatenate([Z[: 2 * n], step_directions[2 * n :, :count]])
        d_tau = -(point.normal @ directions) / rate_of(point, v[: 2 * n])
    return Z + v[:, None] * d_tau, dt + d_tau


def cotangent_at(
    stepper: Stepper, run: RunArguments, point: Point, z: Array, w: Array, s: Any,
    multipliers: Array | None = None,
) -> Array:
    """Return the cotangent z̄, (rows,), from w, (2 n,), of a point's state and s of its time.

    The transpose of ``tangent_at``: z̄·dz = w·(Z + v dτ) + s (dt_j + dτ) for all dz. The rows q and
    p of z̄ are the cotangent of z, the state before the point's step, in space. ``multipliers`` is
    the cotangent of the multipliers of that step, or None.
    """
    if point.tau is None:
        cotangent = stepper.binding.new(stepper._derivative_binding().rows)
        cotangent[: len(w)] = w
        cotangent[-1] = s
        return cotangent
    step = single_step(stepper, run, point, z)
    # its last two rows belong to the length τ and to the time t_j of the step
    if point.normal is None:
        cotangent = step.adjoint(w, multipliers)
        # τ = t − t_j, so the cotangent of τ counts against t_j; the time of the point is fixed
        of_start = cotangent[-1] - cotangent[-2]
    else:
        along_length = stepper.binding.new(stepper._derivative_binding().rows, 1)
        along_length[-2] = 1
        v = step.tangent(along_length, multipliers is not None)[:, 0]
        # the cotangent of dτ = −(c_z Z + c_θ dθ + c_t dt_j)/(c_z v + c_t) is w·v + s
        end_cotangent = w if multipliers is None else np.concatenate([w, multipliers])
        of_value = point.normal * ((end_cotangent @ v + s) / rate_of(point, v[: len(w)]))
        cotangent = step.adjoint(w - of_value[: len(w)], multipliers)
        cotangent[len(w) :] -= of_value[len(w) :]
        of_start = cotangent[-1] + s
    # t_j = t0 + j Δt
    cotangent[-2:] = point.step * of_start, of_start
    return cotangent


def rate_of(point: Point, v: Array) -> Any:
    """Return c_z v + c_t, the rate of an event's value along the motion; v has the shape (2 n,).

    Raises InputError for an event whose value only touches its level.
    """
    assert point.normal is not None
    # the first entries are c_z, the last one c_t
    normal = np.concatenate([point.normal[: len(v)], point.normal[-1:]])
    rate = normal[:-1] @ v + normal[-1]
    normal_size, v_size = (float(np.linalg.norm(x.astype(float))) for x in (normal, v))
    # "not >=" refuses NaN too
    if not abs(float(rate)) >= _GRAZING * normal_size * v_size:
        raise InputError(
            f"The event {point.name!r} has no derivatives: after step {point.step} its value only "
            f"touches its level, at a rate of {float(rate):.1e}. Take another level, or leave this "
            "crossing out.")
    return rate
