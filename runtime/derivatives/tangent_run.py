"""Tangents along a run: the steps are kept piece by piece, and directions follow them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arguments import shown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.records import changed
from ..integration.run_arguments import RunArguments
from ..results.tangent_rows import EventTangents, TangentRows
from .binding import KeptSteps
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


def tangents_of(
    stepper: Stepper, run: RunArguments, tangents: Tangents | TangentRows
) -> TangentRows:
    """Return the tangents of a checked run at the states that it stores.

    Raises InputError for directions that are none; StepFailed as the run itself does.
    """
    return _followed(stepper, run, tangents, ())[0]


def with_tangents(stepper: Stepper, tangents: Any, trajectory: Trajectory) -> Trajectory:
    """Return a trajectory that ``integrate`` returned with its tangents.

    ``tangents`` are directions of the start, or tangents of the same run at other rows, whose
    directions are taken. The run is taken once more, from its start to its last point.
    """
    if not isinstance(tangents, (Tangents, TangentRows)):
        raise InputError(f"tangents = {shown(tangents)} are none; give gyrospark.Tangents(...).")
    rows = rows_of(stepper, trajectory, trajectory._origin.run)
    events = [point for points in rows.events.values() for point in points]
    stored_tangents, q, t = _followed(stepper, rows.run, tangents, [*rows.points, *events])
    tangent_rows = stored_tangents.of_others(*_of_rows(rows, stored_tangents, q, t))
    offset, tangents_by_event = len(rows.points), dict[str, TangentRows]()
    refused = dict(rows.refused)
    for name, points in rows.events.items():
        event_rows = slice(offset, offset + len(points))
        offset += len(points)
        # one crossing without derivatives leaves the whole event without
        errors = [str(x) for x in q[event_rows] if isinstance(x, InputError)]
        if errors:
            refused[name] = errors[0]
        else:
            states, of_times = _stacked(stored_tangents, q[event_rows], t[event_rows])
            # the rows behind q and p are of multipliers, which an event has not
            tangents_by_event[name] = tangent_rows.of_others(
                states[:, : len(stored_tangents.start)], of_times)
    at_events = EventTangents(tangents_by_event, refused)
    return changed(trajectory, tangents=replace(tangent_rows, events=at_events))


def _of_rows(
    rows: RunRows, stored_tangents: TangentRows, q: list[Any], t: list[Any]
) -> tuple[Array, Array]:
    """Return the directions (rows, 2 n, k) and times' derivatives (rows, k) of a trajectory's rows.

    First the rows at ends of steps, then those within steps. Raises the error of a point that has
    no derivatives.
    """
    count = len(rows.points)
    for error in q[:count]:
        if isinstance(error, InputError):
            raise error
    of_steps = stored_tangents.together()[: len(rows.of_steps)]
    directions, times = _stacked(stored_tangents, q[:count], t[:count])
    return (np.concatenate([of_steps, directions]),
            np.concatenate([stored_tangents.t[: len(of_steps)], times]))


def _stacked(stored_tangents: TangentRows, q: list[Any], t: list[Any]) -> tuple[Array, Array]:
    """Return the points' directions and times as arrays, shapes (points, ·, k) and (points, k).

    ``q`` and ``t`` have the arrays of each point; ``stored_tangents`` give widths and type, which
    an empty list does not.
    """
    shape = stored_tangents.together().shape[1:]
    directions, times = np.zeros((len(q), *shape), stored_tangents.q.dtype), np.zeros(
        (len(q), shape[1]), stored_tangents.q.dtype)
    for i, (row, time) in enumerate(zip(q, t, strict=True)):
        directions[i], times[i] = row, time
    return directions, times


def _followed(
    stepper: Stepper, run: RunArguments, request: Tangents | TangentRows, points: Sequence[Point]
) -> tuple[TangentRows, list[Any], list[Any]]:
    """Return the tangents of the stored states, of the points, and of the points' times.

    The lists have an entry for each point; the tangent of a point that has none is the InputError
    that says why.
    """
    tangent_run = _TangentRun(stepper, run, request, points)
    tangent_run.advance()
    return tangent_run.rows(), tangent_run.point_tangents, tangent_run.point_times


class _TangentRun:
    """A run once more, step by step, with dΦ(z) dz of its steps along k directions dz.

    The state of the frame and its tangents go forward together; rows are stored in space.
    """

    def __init__(
        self, stepper: Stepper, run: RunArguments, request: Tangents | TangentRows,
        points: Sequence[Point],
    ) -> None:
        """Take the directions of a request at the start of the run, projected onto the constraints.
        """
        refuse_run(run)
        self.stepper, self.run = stepper, run
        self.binding, self.n = stepper._derivative_binding(), stepper.binding.n
        self.own = self.binding.own
        self.kept_run = self.binding.begin(run)
        self.space = TangentSpace(self.binding, self.kept_run.parameters, run.q, run.p,
                                  stepper.constraint_names)
        self.dz, self.names, with_multipliers = self._directions(request)
        #: Shape of a step's multipliers, and their number; None and 0 if not asked for.
        self.inner = multiplier_shape(stepper) if with_multipliers else None
        self.width = 0 if self.inner is None else self.own.multipliers
        self.frame = FrameMotion(self.binding, stepper.symmetries, run)
        if self.inner is not None:
            self.frame.refuse_rotating_multipliers(run)
        size = 2 * self.n
        #: Tangents of the present state, in the frame; C overwrites them.
        self.tangents = self.dz[:size].copy()
        self.stored = self.own.new(run.rows + 1, size + self.width, self.dz.shape[1])
        self.stored[0, :size] = self.tangents
        self.ends = run.steps_of_rows(run.steps)
        self.points = points
        self.steps_of_points = np.array([point.step for point in points], int)
        self.point_tangents: list[Any] = [None] * len(points)
        self.point_times: list[Any] = [None] * len(points)
        self.switched = 0

    def _directions(
        self, request: Tangents | TangentRows
    ) -> tuple[Array, list[str], bool]:
        """Return the directions of the start in columns of all rows, and a name for each column.

        The flag says whether multipliers are asked for.
        """
        if not isinstance(request, Tangents):  # a run that goes on along the directions of another
            return request._directions, request.names, request.multipliers is not None
        for name in request.parameters if self.run.inputs is not None else ():
            if name in self.own.input_names:
                raise InputError(f"Input {name!r} has a value for each step in this run, so that "
                                 "it is no direction; take the gradient by \"inputs\".")
        start = Start(self.space, request)
        return np.ascontiguousarray(start.directions), start.names, request.multipliers

    def advance(self) -> None:
        """Take all steps, piece by piece, with a stop at each step that has points behind it."""
        run, last_state = self.run, (self.run.q, self.run.p)
        point_steps = np.unique(self.steps_of_points)
        for kept_piece in pieces(self.stepper, run, self.kept_run):
            self.switched += self.binding.count_switches(run, self.kept_run.parameters, kept_piece)
            for steps in split(kept_piece, point_steps):
                self._differentiate_points(steps.first, steps.q[0], steps.p[0])
                self._take(steps)
                last_state = steps.q[-1], steps.p[-1]
        self._differentiate_points(run.steps, *last_state)

    def _take(self, steps: KeptSteps) -> None:
        """Advance the tangents by some steps, and store those of the rows that lie in them."""
        run, size, count = self.run, 2 * self.n, self.dz.shape[1]
        # rows ``first_row`` + 1, ... of the run are states after steps of this piece
        first_row, end = steps.first // run.every, steps.first + steps.count
        rows = self.own.new(end // run.every - first_row, size, count)
        multiplier_tangents = self.own.new(steps.count if self.width else 0, self.width, count)
        status = self.binding.integrate_tangent(run, self.kept_run.parameters, steps, self.dz,
                                                run.every, rows, multiplier_tangents, self.tangents)
        if status:
            raise singular(steps.first, status)
        for i, row in enumerate(rows):
            k = (first_row + 1 + i) * run.every
            self.stored[first_row + 1 + i, :size] = _in_space(self.frame, k, steps, row, self.dz)
        if end == run.steps and run.steps % run.every:  # the last state is stored in any case
            self.stored[-1, :size] = _in_space(self.frame, run.steps, steps, self.tangents, self.dz)
        if self.width:
            in_piece = (self.ends > steps.first) & (self.ends <= end)
            self.stored[in_piece, size:] = multiplier_tangents[self.ends[in_piece] - 1
                                                               - steps.first]

    def _differentiate_points(self, step: int, q: Array, p: Array) -> None:
        """Differentiate the points within a step; (q, p) is the state before it, in the frame.

        A point without derivatives keeps its error, which is raised only if its row is asked for.
        """
        selected = np.flatnonzero(self.steps_of_points == step)
        if not len(selected):
            return
        size = 2 * self.n
        z, directions = np.concatenate([q, p]), self.dz.copy()
        z, directions[:size] = self.frame.in_space(step, z, self.dz, self.tangents)
        for i in selected.tolist():
            try:
                tangent, time = tangent_at(self.stepper, self.run, self.points[i], z, directions,
                                           self.width > 0)
            except InputError as error:
                self.point_tangents[i] = error
                continue
            if self.own.clocked:  # t is coordinate n − 1, and users see it as a time alone
                visible = np.r_[self.space.places, size : size + self.width]
                tangent, time = tangent[visible], tangent[self.n - 1]
            self.point_tangents[i], self.point_times[i] = tangent, time

    def rows(self) -> TangentRows:
        """Return the tangents of the stored states, after a warning of growth and of jumps."""
        binding, n, dz, places = self.own, self.n, self.dz, self.space.places
        warn_of_growth(self.stepper, "Directions of the start have",
                       _growth(self.names, dz[places], self.stored[-1][places]))
        # t = t0 + k Δt: its tangent is dt0 + k dΔt, with k = 0 in row 0
        of_times = (self.stored[:, n - 1].copy() if binding.clocked else
                    dz[-1] + np.outer(self.run.steps_of_rows(self.run.steps), dz[-2]))
        warn_of_jumps(self.stepper, self.switched)
        multipliers = None if self.inner is None else self.stored[1:, 2 * n :].reshape(
            -1, *self.inner, dz.shape[1])
        q, p = (self.stored[:, k : k + binding.shown] for k in (0, n))
        return TangentRows(q, p, self.names, dz[places], of_times, dz, multipliers=multipliers,
                           switched_steps=self.switched)


def _in_space(frame: FrameMotion, k: int, steps: Any, row: Array, dz: Array) -> Array:
    """Return directions ``row`` of the frame's state after step k, one of ``steps``, in space."""
    z = np.concatenate([steps.q[k - steps.first], steps.p[k - steps.first]])
    return frame.in_space(k, z, dz, row)[1]


def _growth(names: list[str], start: Array, end: Array) -> float:
    """Return by how much the longest of the directions of the start has grown."""
    start_columns = [k for k, name in enumerate(names) if name.startswith("start[")]
    before, after = (np.linalg.norm(x[:, start_columns].astype(float), axis=0)
                     for x in (start, end))
    return float((after / np.where(before > 0, before, 1)).max(initial=0))
