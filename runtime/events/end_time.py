"""The end of a run in scaled time at a given t: t grows, and its slope over τ is σ."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core.arrays import Array
from ...core.errors import InputError
from ...core.event import Event
from ...core.records import replace_fields
from ..bindings.array_checks import as_real
from ..bindings.run_memory import Rows, RunConstants, RunState
from ..integration.dense_output import epsilon_of_times
from ..integration.run_arguments import RunArguments
from ..integration.step_loop import thin
from ..results.crossings import Crossings
from ..results.trajectory import Trajectory
from .location import TerminalEvent

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["EndTimeObserver"]

#: Partial steps at most: three or four are usual, and as many bisections separate two doubles.
_MOST = 60


class _TimePoint(NamedTuple):
    """A state near t_end: τ since the state before the end, and t there."""

    tau: Any
    overshoot: Any  # t − t_end
    slope: Any  # dτ/dt = 1/σ


class EndTimeObserver:
    """Observer of a run in scaled time that has no event but its end, t = t_end.

    τ(t) has the slope 1/σ. The cubic with the values and slopes at the two nearest states has τ at
    t_end; a partial step of that τ gives a nearer state, and so on down to the round-off of t.

    Attributes
    ----------
    events : tuple of Event
    end : TerminalEvent or None
        The end of the run, once it is reached.
    """

    def __init__(self, stepper: Stepper, run: RunArguments, event: Event) -> None:
        """Take the event t = t_end, whose time is rounded to the stepper's numbers."""
        self.events = (event,)
        self.end: TerminalEvent | None = None
        self._stepper, self._run = stepper, run
        self._t = stepper.binding.to_real(
            np.array([as_real("t_end", event.level, stepper.binding.number)],
                     stepper.binding.number_type))[0]
        self._ahead = 1 if run.dt > 0 else -1

    def advance(
        self, constants: RunConstants, steps: int, every: int, state: RunState, rows: Rows
    ) -> int:
        """Advance as ``binding.integrate`` does, up to the step before the end."""
        binding, start = self._stepper.binding, state.copy(self._stepper.binding)
        visited = rows if every == 1 else Rows.allocate(binding, steps)
        # t_end is sought in every state, also between two stored ones
        status = binding.integrate(constants, steps, every=1, state=state, rows=visited)
        count = state.steps - start.steps
        if every > 1:
            thin(visited, count, every, rows)
        # t is the last coordinate: the first state at or after t_end
        steps_at_end = np.flatnonzero(self._ahead * (visited.q[:count, -1] - self._t) >= 0)
        if not len(steps_at_end):
            return status
        whole_steps = int(steps_at_end[0])
        # back to the state before that step, which is the last whole one of the run
        row = visited[whole_steps : whole_steps + 1].copy()
        state.assign(binding, start)
        if whole_steps:
            # ``every`` is larger than the number of steps: nothing is stored
            binding.integrate(constants, whole_steps, every=whole_steps + 1, state=state,
                              rows=Rows.allocate(binding, 0))
        self.end = self._end(constants, state, row)
        return 0

    def _end(self, constants: RunConstants, state: RunState, row: Rows) -> TerminalEvent:
        """Return the end of the run, between a state and the row at the end of the step from there.
        """
        binding, run = self._stepper.binding, self._run
        work_memory = binding.works.take()
        tau, row = self._step_to_end(constants, state, row, work_memory)
        binding.works.give_back(work_memory)
        row.q[0, -1] = self._t  # to the last bit, which it is but for round-off
        row.work[:] += binding.work_done(state.record)
        steps = np.array([state.steps])
        elapsed = binding.times(0 * run.t0, run.dt, steps) + tau
        crossing = Crossings(run.t0 + elapsed, row.q, row.p, steps,
                             rising=np.array([self._ahead > 0]), elapsed=elapsed)
        return TerminalEvent(event=0, at=crossing, row=row)

    def _step_to_end(
        self, constants: RunConstants, state: RunState, row: Rows, work_memory: Any
    ) -> tuple[Any, Rows]:
        """Return τ and the row of the partial step from ``state`` whose end is nearest to t_end.

        t(τ) = t_end by the inverse cubic through the two nearest points (τ, t − t_end, dτ/dt =
        1/σ), which a partial step of τ then corrects; bisection where that leaves the bracket. In
        scaled time t is the last coordinate, q[-1].
        """
        binding, t_end = self._stepper.binding, self._t
        low, high = 0 * self._run.dt, self._run.dt
        scales = binding.time_scales(constants.parameters, np.stack([state.q, row.q[0]]),
                                     np.stack([state.p, row.p[0]]))
        near_point, new_point = (_TimePoint(tau, t - t_end, 1 / scale) for tau, t, scale in zip(
            (low, high), (state.q[-1], row.q[0, -1]), scales, strict=True))
        resolution = epsilon_of_times(self._stepper) * max(abs(state.q[-1]), abs(t_end))
        best_overshoot: Any = np.inf
        best_step: tuple[Any, Rows] | None = None
        for _ in range(_MOST):
            # rounded to the type of times
            tau = np.array([_zero(near_point, new_point)], binding.number_type)[0]
            # low > high in a run backwards in time
            if not min(low, high) < tau <= max(low, high):
                tau = (low + high) / 2
            row = self._partial_step(constants, state, tau, work_memory)
            overshoot = row.q[0, -1] - t_end
            if not abs(overshoot) < best_overshoot:  # no nearer than before: round-off
                break
            best_overshoot, best_step = abs(overshoot), (tau, row)
            if abs(overshoot) <= resolution:
                break
            low, high = (low, tau) if self._ahead * overshoot > 0 else (tau, high)
            scale = binding.time_scales(constants.parameters, row.q, row.p)[0]
            near_point = min(near_point, new_point, key=lambda point: abs(point.overshoot))
            new_point = _TimePoint(tau, overshoot, 1 / scale)
        assert best_step is not None
        return best_step

    def _partial_step(
        self, constants: RunConstants, state: RunState, tau: Any, work_memory: Any
    ) -> Rows:
        """Return the row of a step of length ``tau`` from a state, which is not changed.

        Raises InputError if the step has no solution.
        """
        binding, row = self._stepper.binding, Rows.allocate(self._stepper.binding, 1)
        partial_state = RunState.at_start(binding, state.q, state.p, work_memory)
        if binding.integrate(replace_fields(constants, dt=tau), steps=1, every=1,
                             state=partial_state, rows=row):
            raise InputError(
                f"From t = {float(state.q[-1]):.6g} s no step of {float(tau):.3g} s of τ is found, "
                "though the run has found its own; take a smaller dtau.")
        return row

    def close(self, state: RunState, ahead: tuple[Array, Array] | None = None) -> None:
        """Do nothing: ``advance`` has examined the last step."""

    def take_crossings(self, stop: Callable[[], bool] = lambda: False) -> dict[str, Crossings]:
        """Return the end as a crossing of its event, or no crossing before it is reached."""
        binding, no_index = self._stepper.binding, np.array([], int)
        times, states = np.array([], binding.number_type), binding.new(0, binding.n)
        crossings = (Crossings(t=times, q=states, p=states, steps=no_index,
                               rising=no_index.astype(bool), elapsed=times)
                     if self.end is None else self.end.at)
        return {self.events[0].name: crossings}

    def results(self, trajectory: Trajectory, crossings: dict[str, Crossings]) -> Trajectory:
        """Return a trajectory with the end among its crossings."""
        return replace_fields(trajectory, events=crossings)


def _zero(a: _TimePoint, b: _TimePoint) -> Any:
    """Return τ(0) by the cubic τ(t) through (τ, t, dτ/dt) of two points: Hermite interpolation.

    With h = t_b − t_a, the ``width``, and x = −t_a/h: τ_a + (τ_b − τ_a) x² (3 − 2x) +
    h x (1 − x) ((1 − x) τ_a′ − x τ_b′).
    """
    (tau, t, slope), (other_tau, other_t, other_slope) = a, b
    width = other_t - t
    x = -t / width
    rise = x * x * (3 - 2 * x)
    return (tau + (other_tau - tau) * rise
            + width * x * (1 - x) * ((1 - x) * slope - x * other_slope))
