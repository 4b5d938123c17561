"""Tangents along a run: the steps are kept piece by piece, and directions follow them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core.arguments import shown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.records import replace_fields
from ..integration.run_arguments import RunArguments
from ..results.tangent_rows import EventTangents, TangentRows
from .binding import KeptSteps
from .frame import FrameMotion
from .kept_steps import (
    linearisation_error,
    multiplier_shape,
    part_sizes,
    pieces,
    refuse_run,
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


class _RunTangents(NamedTuple):
    """The tangents of a run at its stored states, and at points within its steps."""

    rows: TangentRows
    #: an array (2 n, k) for each point, or the InputError that says why it has no derivatives
    at_points: list[Any]
    point_times: list[Any]  # derivatives of the times of the points, (k,) each


class _Directions(NamedTuple):
    """Directions of the start along which a run is differentiated."""

    columns: Array  # shape (rows, k)
    names: list[str]  # of the k columns
    with_multipliers: bool  # whether derivatives of the multipliers are computed too


def tangents_of(
    stepper: Stepper, run: RunArguments, tangents: Tangents | TangentRows
) -> TangentRows:
    """Return the tangents of a checked run at the states that it stores.

    Raises InputError for directions that the run does not have; StepFailed as the run itself does.
    """
    return _propagate(stepper, run, tangents, points=()).rows


def with_tangents(stepper: Stepper, tangents: Any, trajectory: Trajectory) -> Trajectory:
    """Return a trajectory that ``integrate`` returned, with the tangents of its rows and events.

    ``tangents`` are directions of the start, or tangents of the same run at other rows, whose
    directions are taken. The run is integrated once more, from its start to its last point.
    """
    if not isinstance(tangents, (Tangents, TangentRows)):
        raise InputError(f"tangents = {shown(tangents)} are no directions; give "
                         "gyrospark.Tangents(...).")
    rows = rows_of(stepper, trajectory, trajectory._origin.run)
    # rows within steps, then events: both are points besides the rows at ends of steps
    events = [point for points in rows.events.values() for point in points]
    stored_tangents, at_points, point_times = _propagate(stepper, rows.run, tangents,
                                                         [*rows.points, *events])
    count = len(rows.points)
    directions, times = _directions_of_rows(
        rows, stored_tangents, at_points[:count], point_times[:count])
    at_events = _tangents_at_events(rows, stored_tangents, at_points[count:], point_times[count:])
    return replace_fields(trajectory, tangents=replace(
        stored_tangents.of_others(directions, times), events=at_events))


def _tangents_at_events(
    rows: RunRows, stored_tangents: TangentRows, directions: list[Any], times: list[Any]
) -> EventTangents:
    """Return the tangents at events, by their names, and the errors of events that have none.

    ``directions`` and ``times`` have an entry for each point of all events, one event after
    another: arrays of the shapes (2 n, k) and (k,), or the InputError of a point.
    """
    tangents, refused, first = dict[str, TangentRows](), dict(rows.refused), 0
    for name, points in rows.events.items():
        crossings = slice(first, first + len(points))
        first += len(points)
        # one crossing without derivatives leaves the whole event without
        errors = [str(entry) for entry in directions[crossings] if isinstance(entry, InputError)]
        if errors:
            refused[name] = errors[0]
            continue
        states, of_times = _stack(stored_tangents, directions[crossings], times[crossings])
        # rows after q and p are of multipliers, which an event has not
        tangents[name] = stored_tangents.of_others(
            states[:, : len(stored_tangents.start)], of_times)
    return EventTangents(tangents, refused)


def _directions_of_rows(
    rows: RunRows, stored_tangents: TangentRows, directions: list[Any], times: list[Any]
) -> tuple[Array, Array]:
    """Return the directions (rows, 2 n, k) and times' derivatives (rows, k) of a trajectory's rows.

    First the rows at ends of steps, then those within steps, whose ``directions`` and ``times`` are
    in lists. Raises the error of a point that has no derivatives.
    """
    for entry in directions:
        if isinstance(entry, InputError):
            raise entry
    of_steps = stored_tangents.together()[: len(rows.of_steps)]
    of_points, point_times = _stack(stored_tangents, directions, times)
    return (np.concatenate([of_steps, of_points]),
            np.concatenate([stored_tangents.t[: len(of_steps)], point_times]))


def _stack(
    stored_tangents: TangentRows, directions: list[Any], times: list[Any]
) -> tuple[Array, Array]:
    """Return lists of points' directions and times as arrays, (points, ·, k) and (points, k).

    ``stored_tangents`` give widths and type, which an empty list does not.
    """
    shape, dtype = stored_tangents.together().shape[1:], stored_tangents.q.dtype
    all_directions = np.zeros((len(directions), *shape), dtype)
    all_times = np.zeros((len(times), shape[-1]), dtype)
    for i, (direction, time) in enumerate(zip(directions, times, strict=True)):
        all_directions[i], all_times[i] = direction, time
    return all_directions, all_times


def _propagate(
    stepper: Stepper, run: RunArguments, request: Tangents | TangentRows, points: Sequence[Point]
) -> _RunTangents:
    """Return the tangents of a run along the directions of ``request``, also at the ``points``.

    Points are states within steps, such as events.
    """
    tangent_run = _TangentRun(stepper, run, request, points)
    tangent_run.advance()
    return _RunTangents(tangent_run.rows(), tangent_run.point_tangents, tangent_run.point_times)


class _TangentRun:
    """A run integrated once more, with dΦ(z) dz of its steps Φ along k directions dz.

    The state of the frame and its tangents go forward together; rows are stored in space.
    """

    def __init__(
        self, stepper: Stepper, run: RunArguments, request: Tangents | TangentRows,
        points: Sequence[Point],
    ) -> None:
        """Project the directions of a request at the start of the run, and allocate the rows.

        ``points`` are states within steps, whose tangents are computed too.
        """
        refuse_run(run)
        self.stepper, self.run = stepper, run
        self.binding, self.n = stepper._derivative_binding(), stepper.binding.n
        self.module = self.binding.module
        self.kept_run = self.binding.begin(run)
        self.space = TangentSpace(self.binding, self.kept_run.parameters, run.q, run.p,
                                  stepper.constraint_names)
        self.dz, self.names, with_multipliers = self._directions(request)
        #: Shape of a step's multipliers, and their number; None and 0 if not asked for.
        self.inner = multiplier_shape(stepper) if with_multipliers else None
        self.width = 0 if self.inner is None else self.module.multipliers
        self.frame = FrameMotion(self.binding, stepper.symmetries, run)
        if self.inner is not None:
            self.frame.refuse_rotating_multipliers(run)
        size = 2 * self.n
        # at the start S = 1: the state of the frame is that in space
        #: Tangents of the present state, in the frame; C overwrites them.
        self.tangents = self.dz[:size].copy()
        #: Tangents of the stored states and, after these rows, of the multipliers before them.
        self.stored = self.module.new(run.rows + 1, size + self.width, self.dz.shape[1])
        self.stored[0, :size] = self.tangents
        #: Steps before each stored state.
        self.ends = run.steps_of_rows(run.steps)
        self.points = points
        self.steps_of_points = np.array([point.step for point in points], int)
        self.point_tangents: list[Any] = [None] * len(points)
        self.point_times: list[Any] = [None] * len(points)
        self.switched = 0

    def _directions(self, request: Tangents | TangentRows) -> _Directions:
        """Return the directions of the start that a caller asks for.

        Raises InputError for an input that is not constant in the run.
        """
        if not isinstance(request, Tangents):  # a run that goes on along the directions of another
            return _Directions(request._directions, request.names, request.multipliers is not None)
        for name in request.parameters if self.run.inputs is not None else ():
            if name in self.module.input_names:
                raise InputError(f"Input {name!r} has a value for each step in this run, so that "
                                 "it is no direction; take the gradient by \"inputs\".")
        start = Start(self.space, request)
        return _Directions(
            np.ascontiguousarray(start.directions), start.names, request.multipliers)

    def advance(self) -> None:
        """Take all steps, piece by piece, with a stop before each step that has points in it."""
        run, last_state = self.run, (self.run.q, self.run.p)
        point_steps = np.unique(self.steps_of_points)
        for kept_piece in pieces(self.stepper, run, self.kept_run):
            self.switched += self.binding.count_switches(run, self.kept_run.parameters, kept_piece)
            for steps in split(kept_piece, point_steps):
                self._differentiate_points(steps.first, steps.q[0], steps.p[0])
                self._take(steps)
                last_state = steps.q[-1], steps.p[-1]
        # points after the last whole step, at a terminal event or a t_end within a step
        self._differentiate_points(run.steps, *last_state)

    def _take(self, steps: KeptSteps) -> None:
        """Advance the tangents by some steps, and store the tangents of the rows after them."""
        run, size, count = self.run, 2 * self.n, self.dz.shape[1]
        # rows ``first_row`` + 1, ... of the run are states after steps of this piece
        first_row, end = steps.first // run.every, steps.first + steps.count
        rows = self.module.new(end // run.every - first_row, size, count)
        multiplier_tangents = self.module.new(steps.count if self.width else 0, self.width, count)
        status = self.binding.integrate_tangent(
            run, self.kept_run.parameters, steps, self.dz, every=run.every, rows=rows,
            multipliers=multiplier_tangents, tangents=self.tangents)
        if status:
            raise linearisation_error(steps.first, status)
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
        """Fill ``point_tangents`` and ``point_times`` of the points within step number ``step``.

        (q, p) is the state before the step, (n,) each, and ``tangents`` its directions, (2 n, k),
        both in the frame. A point without derivatives gets its InputError in place of a tangent,
        which is raised only if its row is asked for.
        """
        points_of_step = np.flatnonzero(self.steps_of_points == step)
        if not len(points_of_step):
            return
        size = 2 * self.n
        # a point's step is taken in space, from z = S z̃ with the directions S dz̃ + dS z̃
        directions = self.dz.copy()
        z, directions[:size] = self.frame.in_space(step, np.concatenate([q, p]), self.dz,
                                                   self.tangents)
        for i in points_of_step.tolist():
            try:
                tangent, time = tangent_at(self.stepper, self.run, self.points[i], z, directions,
                                           multipliers=self.width > 0)
            except InputError as error:
                self.point_tangents[i] = error
                continue
            if self.module.clocked:  # t is coordinate n − 1, and users see it as a time alone
                visible = np.r_[self.space.places, size : size + self.width]
                tangent, time = tangent[visible], tangent[self.n - 1]
            self.point_tangents[i], self.point_times[i] = tangent, time

    def rows(self) -> TangentRows:
        """Return the tangents of the stored states, after a warning of growth and of jumps."""
        binding, n, dz, places = self.module, self.n, self.dz, self.space.places
        # directions of parameters have other units, and their growth has no meaning
        columns = [k for k, name in enumerate(self.names) if name.startswith("start[")]
        warn_of_growth(self.stepper, "Directions of the start have", *(
            part_sizes(x[places][:, columns]) for x in (dz, self.stored[-1])))
        # t = t0 + k Δt: its tangent is dt0 + k dΔt, with k = 0 in row 0
        of_times = (self.stored[:, n - 1].copy() if binding.clocked else
                    dz[-1] + np.outer(self.run.steps_of_rows(self.run.steps), dz[-2]))
        warn_of_jumps(self.stepper, self.switched)
        # the start is the end of no step, and has no multipliers
        multipliers = None if self.inner is None else self.stored[1:, 2 * n :].reshape(
            -1, *self.inner, dz.shape[1])
        q, p = self.stored[:, : binding.shown], self.stored[:, n : n + binding.shown]
        return TangentRows(q, p, self.names, start=dz[places], t=of_times, _directions=dz,
                           multipliers=multipliers, switched_steps=self.switched)


def _in_space(frame: FrameMotion, k: int, steps: Any, row: Array, dz: Array) -> Array:
    """Return the directions in space, (2 n, k), of the state after k steps of the run.

    ``row`` has the directions of the frame's state, which is one of ``steps``; ``dz`` those of the
    start, with the rates of the frame.
    """
    z = np.concatenate([steps.q[k - steps.first], steps.p[k - steps.first]])
    _, directions = frame.in_space(k, z, dz, row)
    return directions
