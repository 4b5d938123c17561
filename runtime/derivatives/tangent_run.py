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
    stepper: Stepper, run: RunArguments, wanted: Tangents | TangentRows
) -> TangentRows:
    """Return the tangents of a checked run at the states that it stores.

    Raises
    ------
    InputError
        For directions that are none.
    StepFailed
        As the run itself does.
    """
    return _followed(stepper, run, wanted, ())[0]


def with_tangents(stepper: Stepper, wanted: Any, found: Trajectory) -> Trajectory:
    """Return a trajectory that ``integrate`` returned with its tangents.

    ``wanted`` are directions, or the tangents of the run at other rows.
    """
    if not isinstance(wanted, (Tangents, TangentRows)):
        raise InputError(f"tangents = {shown(wanted)} are none; give gyrospark.Tangents(...).")
    rows = rows_of(stepper, found, found._origin.run)
    events = [point for points in rows.events.values() for point in points]
    whole, q, t = _followed(stepper, rows.run, wanted, [*rows.points, *events])
    own = whole.of_others(*_of_rows(rows, whole, q, t))
    at, made = len(rows.points), dict[str, TangentRows]()
    refused = dict(rows.refused)
    for name, points in rows.events.items():
        part = slice(at, at + len(points))
        at += len(points)
        why = [str(x) for x in q[part] if isinstance(x, InputError)]
        if why:
            refused[name] = why[0]
        else:
            states, of_times = _stacked(whole, q[part], t[part])
            made[name] = own.of_others(states[:, : len(whole.start)], of_times)
    return changed(found, tangents=replace(own, events=EventTangents(made, refused)))


def _of_rows(rows: RunRows, whole: TangentRows, q: list[Any], t: list[Any]) -> tuple[Array, Array]:
    """Return directions and times' derivatives of each row: ends of steps, then points."""
    count = len(rows.points)
    for error in q[:count]:
        if isinstance(error, InputError):
            raise error
    of_steps = whole.together()[: len(rows.of_steps)]
    made, times = _stacked(whole, q[:count], t[:count])
    return (np.concatenate([of_steps, made]),
            np.concatenate([whole.t[: len(of_steps)], times]))


def _stacked(whole: TangentRows, q: list[Any], t: list[Any]) -> tuple[Array, Array]:
    shape = whole.together().shape[1:]
    made, times = np.zeros((len(q), *shape), whole.q.dtype), np.zeros(
        (len(q), shape[1]), whole.q.dtype)
    for i, (row, time) in enumerate(zip(q, t, strict=True)):
        made[i], times[i] = row, time
    return made, times


def _followed(
    stepper: Stepper, run: RunArguments, wanted: Tangents | TangentRows, points: Sequence[Point]
) -> tuple[TangentRows, list[Any], list[Any]]:
    """Return the tangents of the stored states, and those of points and of their times.

    In place of those of an event that has none is the error that says why.
    """
    refuse_run(run)
    binding, n = stepper._derivative_binding(), stepper.binding.n
    own = binding.own
    kept_run = binding.begin(run)
    space = TangentSpace(binding, kept_run.parameters, run.q, run.p, stepper.constraint_names)
    if isinstance(wanted, Tangents):
        for name in wanted.parameters if run.inputs is not None else ():
            if name in own.input_names:
                raise InputError(f"Input {name!r} has a value for each step in this run, so that "
                                 "it is no direction; take the gradient by \"inputs\".")
        start = Start(space, wanted)
        dz, names = np.ascontiguousarray(start.directions), start.names
    else:
        dz, names = wanted._directions, wanted.names
    asked = (wanted.multipliers if isinstance(wanted, Tangents)
             else wanted.multipliers is not None)
    count, inner = dz.shape[1], multiplier_shape(stepper) if asked else None
    tangents = dz[: 2 * n].copy()
    #: Rows that users see, those of multipliers among them.
    shown = np.r_[space.places, 2 * n : 2 * n + (own.multipliers if inner is not None else 0)]
    frame = FrameMotion(binding, stepper.symmetries, run)
    if inner is not None:
        frame.refuse_rotating_multipliers(run)
    width = 0 if inner is None else own.multipliers
    made = own.new(run.rows + 1, 2 * n + width, count)
    made[0, : 2 * n] = tangents
    ends = run.steps_of_rows(run.steps)
    found: list[Any] = [None] * len(points)
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
                found[i], times[i] = tangent_at(stepper, run, points[i], z, here, width > 0)
            except InputError as error:
                found[i] = error
                continue
            if own.clocked:
                found[i], times[i] = found[i][shown], found[i][n - 1]

    at, last = np.unique(steps_of_points), (run.q, run.p)
    switched = 0
    for piece in pieces(stepper, run, kept_run):
        switched += binding.count_switches(run, kept_run.parameters, piece)
        for steps in split(piece, at):
            differentiate_points(steps.first, steps.q[0], steps.p[0])
            first, end = steps.first // run.every, steps.first + steps.count
            rows = own.new(end // run.every - first, 2 * n, count)
            forces = own.new(steps.count if width else 0, width, count)
            status = binding.integrate_tangent(run, kept_run.parameters, steps, dz, run.every,
                                               rows, forces, tangents)
            if status:
                raise singular(steps.first, status)
            for i, row in enumerate(rows):
                k = (first + 1 + i) * run.every
                made[first + 1 + i, : 2 * n] = _in_space(frame, k, steps, row, dz)
            if end == run.steps and run.steps % run.every:
                made[-1, : 2 * n] = _in_space(frame, run.steps, steps, tangents, dz)
            if width:
                here = (ends > steps.first) & (ends <= end)
                made[here, 2 * n :] = forces[ends[here] - 1 - steps.first]
            last = steps.q[-1], steps.p[-1]
    differentiate_points(run.steps, *last)
    warn_of_growth(stepper, "Directions of the start have",
                   _growth(names, dz[space.places], made[-1][space.places]))
    of_times = (made[:, n - 1].copy() if own.clocked else
                dz[-1] + np.outer(run.steps_of_rows(run.steps), dz[-2]))
    warn_of_jumps(stepper, switched)
    of_steps = None if inner is None else made[1:, 2 * n :].reshape(-1, *inner, count)
    q, p = (made[:, k : k + own.shown] for k in (0, n))
    return TangentRows(q, p, names, dz[space.places], of_times, dz, multipliers=of_steps,
                       switched_steps=switched), found, times


def _in_space(frame: FrameMotion, k: int, steps: Any, row: Array, dz: Array) -> Array:
    z = np.concatenate([steps.q[k - steps.first], steps.p[k - steps.first]])
    return frame.in_space(k, z, dz, row)[1]


def _growth(names: list[str], start: Array, end: Array) -> float:
    """Return by how much the longest of the directions of the start has grown."""
    own = [k for k, name in enumerate(names) if name.startswith("start[")]
    before, after = (np.linalg.norm(x[:, own].astype(float), axis=0) for x in (start, end))
    return float((after / np.where(before > 0, before, 1)).max(initial=0))
