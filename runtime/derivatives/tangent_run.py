"""Tangents along a run: the steps are kept piece by piece, and directions follow them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import shown
from ...core.errors import InputError
from ...core.records import changed
from ..integration.run_arguments import RunArguments
from ..results.tangent_rows import EventTangents, TangentRows
from .frame import FrameMotion
from .kept_steps import (
    multiplier_shape,
    pieces,
    refuse_run,
    singular,
    split,
    warn_of_growth,
    warn_of_jumps,
)
from .points import Point, RunRows, rows_of, tangent_at
from .tangent_space import Start, Tangents, TangentSpace

if TYPE_CHECKING:
    from ..results.trajectory import Trajectory
    from ..steppers.stepper import Stepper

__all__ = ["tangents_of", "with_tangents"]

Array = NDArray[Any]


def tangents_of(
    stepper: Stepper, run: RunArguments, tangents: Tangents | TangentRows
) -> TangentRows:
    """Return the tangents of a checked run at the states that it stores.

    Raises
    ------
    InputError
        For directions that are none.
    StepFailed
        As the run itself does.
    """
    return _followed(stepper, run, tangents, ())[0]


def with_tangents(stepper: Stepper, tangents: Any, trajectory: Trajectory) -> Trajectory:
    """Return a trajectory that ``integrate`` returned with its tangents.

    ``tangents`` are directions, or the tangents of the run at other rows.
    """
    if not isinstance(tangents, (Tangents, TangentRows)):
        raise InputError(f"tangents = {shown(tangents)} are none; give gyrospark.Tangents(...).")
    rows = rows_of(stepper, trajectory, trajectory._origin.run)
    events = [point for points in rows.events.values() for point in points]
    all_rows, q, t = _followed(stepper, rows.run, tangents, [*rows.points, *events])
    tangent_rows = all_rows.of_others(*_of_rows(rows, all_rows, q, t))
    offset, tangents_by_event = len(rows.points), dict[str, TangentRows]()
    refused = dict(rows.refused)
    for name, points in rows.events.items():
        event_rows = slice(offset, offset + len(points))
        offset += len(points)
        why = [str(x) for x in q[event_rows] if isinstance(x, InputError)]
        if why:
            refused[name] = why[0]
        else:
            states, of_times = _stacked(all_rows, q[event_rows], t[event_rows])
            tangents_by_event[name] = tangent_rows.of_others(states[:, : len(all_rows.start)],
                                                             of_times)
    at_events = EventTangents(tangents_by_event, refused)
    return changed(trajectory, tangents=replace(tangent_rows, events=at_events))


def _of_rows(
    rows: RunRows, all_rows: TangentRows, q: list[Any], t: list[Any]
) -> tuple[Array, Array]:
    """Return directions and times' derivatives of each row: ends of steps, then points."""
    count = len(rows.points)
    for error in q[:count]:
        if isinstance(error, InputError):
            raise error
    of_steps = all_rows.together()[: len(rows.of_steps)]
    directions, times = _stacked(all_rows, q[:count], t[:count])
    return (np.concatenate([of_steps, directions]),
            np.concatenate([all_rows.t[: len(of_steps)], times]))


def _stacked(all_rows: TangentRows, q: list[Any], t: list[Any]) -> tuple[Array, Array]:
    shape = all_rows.together().shape[1:]
    directions, times = np.zeros((len(q), *shape), all_rows.q.dtype), np.zeros(
        (len(q), shape[1]), all_rows.q.dtype)
    for i, (row, time) in enumerate(zip(q, t, strict=True)):
        directions[i], times[i] = row, time
    return directions, times


def _followed(
    stepper: Stepper, run: RunArguments, request: Tangents | TangentRows, points: Sequence[Point]
) -> tuple[TangentRows, list[Any], list[Any]]:
    """Return the tangents of the stored states, and those of points and of their times.

    In place of those of an event that has none is the error that says why.
    """
    refuse_run(run)
    binding, n = stepper._derivative_binding(), stepper.binding.n
    binding1 = binding.own
    kept_run = binding.begin(run)
    space = TangentSpace(binding, kept_run.parameters, run.q, run.p, stepper.constraint_names)
    if isinstance(request, Tangents):
        for name in request.parameters if run.inputs is not None else ():
            if name in binding1.input_names:
                raise InputError(f"Input {name!r} has a value for each step in this run, so that "
                                 "it is no direction; take the gradient by \"inputs\".")
        start = Start(space, request)
        dz, names = np.ascontiguousarray(start.directions), start.names
    else:
        dz, names = request._directions, request.names
    asked = (request.multipliers if isinstance(request, Tangents)
             else request.multipliers is not None)
    count, inner = dz.shape[1], multiplier_shape(stepper) if asked else None
    tangents = dz[: 2 * n].copy()
    #: Rows that users see, those of multipliers among them.
    shown = np.r_[space.places, 2 * n : 2 * n + (binding1.multipliers if inner is not None else 0)]
    frame = FrameMotion(binding, stepper.symmetries, run)
    if inner is not None:
        frame.refuse_rotating_multipliers(run)
    width = 0 if inner is None else binding1.multipliers
    rows_of_tangents = binding1.new(run.rows + 1, 2 * n + width, count)
    rows_of_tangents[0, : 2 * n] = tangents
    ends = run.steps_of_rows(run.steps)
    point_tangents: list[Any] = [None] * len(points)
    times: list[Any] = [None] * len(points)
    steps_of_points = np.array([point.step for point in points], int)

    def differentiate_points(step: int, q: Array, p: Array) -> None:
        """Differentiate the points after so many steps, where (q, p) is the state of the frame."""
        chosen = np.flatnonzero(steps_of_points == step)
        if not len(chosen):
            return
        z, here = np.concatenate([q, p]), dz.copy()
        z, here[: 2 * n] = frame.in_space(step, z, dz, tangents)
        for i in chosen.tolist():
            try:
                point_tangents[i], times[i] = tangent_at(
                    stepper, run, points[i], z, here, width > 0)
            except InputError as error:
                point_tangents[i] = error
                continue
            if binding1.clocked:
                point_tangents[i], times[i] = point_tangents[i][shown], point_tangents[i][n - 1]

    point_steps, last = np.unique(steps_of_points), (run.q, run.p)
    switched = 0
    for piece in pieces(stepper, run, kept_run):
        switched += binding.count_switches(run, kept_run.parameters, piece)
        for steps in split(piece, point_steps):
            differentiate_points(steps.first, steps.q[0], steps.p[0])
            first, end = steps.first // run.every, steps.first + steps.count
            rows = binding1.new(end // run.every - first, 2 * n, count)
            forces = binding1.new(steps.count if width else 0, width, count)
            status = binding.integrate_tangent(run, kept_run.parameters, steps, dz, run.every,
                                               rows, forces, tangents)
            if status:
                raise singular(steps.first, status)
            for i, row in enumerate(rows):
                k = (first + 1 + i) * run.every
                rows_of_tangents[first + 1 + i, : 2 * n] = _in_space(frame, k, steps, row, dz)
            if end == run.steps and run.steps % run.every:
                rows_of_tangents[-1, : 2 * n] = _in_space(frame, run.steps, steps, tangents, dz)
            if width:
                here = (ends > steps.first) & (ends <= end)
                rows_of_tangents[here, 2 * n :] = forces[ends[here] - 1 - steps.first]
            last = steps.q[-1], steps.p[-1]
    differentiate_points(run.steps, *last)
    warn_of_growth(stepper, "Directions of the start have",
                   _growth(names, dz[space.places], rows_of_tangents[-1][space.places]))
    of_times = (rows_of_tangents[:, n - 1].copy() if binding1.clocked else
                dz[-1] + np.outer(run.steps_of_rows(run.steps), dz[-2]))
    warn_of_jumps(stepper, switched)
    of_steps = None if inner is None else rows_of_tangents[1:, 2 * n :].reshape(-1, *inner, count)
    q, p = (rows_of_tangents[:, k : k + binding1.shown] for k in (0, n))
    return TangentRows(q, p, names, dz[space.places], of_times, dz, multipliers=of_steps,
                       switched_steps=switched), point_tangents, times


def _in_space(frame: FrameMotion, k: int, steps: Any, row: Array, dz: Array) -> Array:
    z = np.concatenate([steps.q[k - steps.first], steps.p[k - steps.first]])
    return frame.in_space(k, z, dz, row)[1]


def _growth(names: list[str], start: Array, end: Array) -> float:
    """Return by how much the longest of the directions of the start has grown."""
    start_columns = [k for k, name in enumerate(names) if name.startswith("start[")]
    before, after = (np.linalg.norm(x[:, start_columns].astype(float), axis=0)
                     for x in (start, end))
    return float((after / np.where(before > 0, before, 1)).max(initial=0))
