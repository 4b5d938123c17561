"""The events of one run: detected while it is advanced, located now and then, or at its end.

A terminal event ends the run at the step within which it happens. Terminal events whose value
changes its sign in a piece of the run, or may touch its level there, are located before the next
piece; the run then returns to the beginning of this piece, or of the one before if the event is in
the last step of that, and is advanced to the step before the event.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from operator import add
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arguments import count_text
from ...core.arrays import Array
from ...core.errors import StepFailed, Stopped
from ...core.event import Event, Impact
from ...core.interrupts import catch_ctrl_c
from ...core.records import replace_fields
from ..bindings.run_memory import Rows, RunConstants, RunState
from ..integration.dense_output import run_together
from ..integration.lanes import EnsembleStates, fill_ensemble, threads_of
from ..integration.run_arguments import EnsembleArguments, RunArguments
from ..integration.step_loop import advance_and_detect, integrate
from ..results.crossings import Crossings, Impacts
from ..results.diagnostics import Report
from ..results.outputs import States, flat_multipliers, full_states
from ..results.trajectory import Trajectory
from .detection import Levels, Memory
from .end_time import EndTimeObserver
from .impact_observer import ImpactObserver
from .location import TerminalEvent, crossings_of, detectors_for, first_terminal_event

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["Observer", "impact_losses", "integrate_observed", "observer_of", "observer_to_end",
           "report_with_row", "with_events", "with_row"]

#: Largest number of bracketed steps that wait for their location.
_MOST = 2**14


def integrate_observed(
    stepper: Stepper, run: RunArguments, events: Sequence[Event | Impact],
    progress: Callable[[int], None] | None, end_event: str = "",
) -> Trajectory:
    """Return the trajectory of a run with its events, up to the first terminal one.

    ``end_event`` names the event of t_end in scaled time, which users did not ask for. Raises
    StepFailed or Stopped as ``integrate`` does. Stopped while events are solved for, with the
    states alone.
    """
    if not events:
        return integrate(stepper.binding, stepper.manifest, run, progress)
    observer = observer_to_end(stepper, run, events)
    trajectory: Trajectory
    trouble: StepFailed | Stopped | None = None
    try:
        trajectory = integrate(stepper.binding, stepper.manifest, run, progress, observer)
    except (StepFailed, Stopped) as error:
        if error.trajectory is None:
            raise
        trouble, trajectory = error, error.trajectory
    with catch_ctrl_c() as interrupts:
        # a signal that has ended the run does not end the location of its events
        had_signal = interrupts.is_requested
        crossings_by_name = observer.take_crossings(
            lambda: interrupts.is_requested and not had_signal)
    if interrupts.is_requested and not had_signal:
        raise Stopped(f"Stopped where the events of {count_text(trajectory.report.steps, 'step')} "
                      "were solved "
                      "for; the states are in .trajectory, without events.", interrupts.signal,
                      trajectory=trajectory)
    trajectory = with_events(stepper, run, observer, trajectory, crossings_by_name)
    if end_event:
        trajectory = with_end_apart(trajectory, end_event)
    if trouble is None:
        return trajectory
    trouble.trajectory = trajectory
    raise trouble


def with_end_apart(trajectory: Trajectory, end_event: str) -> Trajectory:
    """Return a trajectory whose event at t_end in scaled time is none of its events."""
    events_by_name = {**trajectory.events}
    end_events = {end_event: events_by_name.pop(end_event)}
    ended_by = None if trajectory._ended_by == end_event else trajectory._ended_by
    return replace_fields(trajectory, events=events_by_name, _end_event=end_events,
                          _ended_by=ended_by)


def observer_of(
    stepper: Stepper, run: RunArguments, events: Sequence[Event | Impact]
) -> Observer | ImpactObserver:
    """Return the observer of a run with events, or with impacts."""
    impacts = tuple(event for event in events if isinstance(event, Impact))
    if impacts:
        return ImpactObserver(stepper, run, impacts)
    return Observer(stepper, run, tuple(event for event in events if isinstance(event, Event)))


def observer_to_end(stepper: Stepper, run: RunArguments, events: Sequence[Event | Impact]) -> Any:
    """Return the observer of a run in memory: an ``EndTimeObserver`` if t_end is its only event."""
    if run.open_end and len(events) == 1 and isinstance(events[0], Event):
        return EndTimeObserver(stepper, run, events[0])
    return observer_of(stepper, run, events)


def with_events(
    stepper: Stepper, run: RunArguments, observer: Observer | ImpactObserver | EndTimeObserver,
    trajectory: Trajectory, crossings_by_name: dict[str, Any],
) -> Trajectory:
    """Return a trajectory with its events, and a last row at the event that ended it.

    ``crossings_by_name`` are the crossings that its observer has located.
    """
    end = observer.end
    if end is not None:
        trajectory = with_row(stepper, trajectory, len(trajectory), (end.at.t, end.at.elapsed),
                              end.row)
    trajectory = observer.results(trajectory, {
        name: crossings.shown(stepper.binding) for name, crossings in crossings_by_name.items()})
    if end is None:
        return trajectory
    report = report_with_row(stepper, run, trajectory.report, end.at.t, end.row,
                             impact_losses(crossings_by_name, {}))
    return replace_fields(trajectory, report=report, _ended_by=observer.events[end.event].name)


def impact_losses(crossings: Mapping[str, Crossings], earlier: Mapping[str, Any]) -> dict[str, Any]:
    """Return the energy lost in the impacts of each gap, by its name, added to ``earlier`` losses.

    The order of the sum does not depend on the pieces in which the impacts come.
    """
    return {**earlier, **{name: reduce(add, hits.energy_lost, earlier.get(name, 0.0))
                          for name, hits in crossings.items() if isinstance(hits, Impacts)}}


def report_with_row(
    stepper: Stepper, run: RunArguments, report: Report, t: Array, row: Rows,
    losses: Mapping[str, Any],
) -> Report:
    """Return the report of whole steps with the end of the run, ``row``, in its largest errors.

    ``t`` is the time of that row, shape (1,), in scaled time τ. Its work in J belongs to the
    whole run; ``losses``, in J, are the energies lost in the impacts of each gap.
    """
    binding = stepper.binding
    states = States(
        binding, stepper.manifest, binding.parameters(run.parameters, run.t0),
        t=np.concatenate([np.array([run.t0], t.dtype), t]), q=np.concatenate([run.q[None], row.q]),
        p=np.concatenate([run.p[None], row.p]), multipliers=row.multipliers,
        iterations=row.iterations, work=row.work)
    H, defects = states.energies, states.defects
    energy_error = abs(H[1] - H[0] - row.work[0] + sum(losses[name] for name in sorted(losses)))

    def largest(earlier: float, at_end: Any) -> float:
        """Return the larger error, NaN where one is."""
        return float(np.maximum(earlier, float(at_end)))

    return replace(
        report, q=tuple(map(float, row.q[0, : binding.shown].tolist())),
        p=tuple(map(float, row.p[0, : binding.shown].tolist())), work=float(row.work[0]),
        energy_error_max=largest(report.energy_error_max, energy_error),
        constraint_max=largest(report.constraint_max, defects.g[1]),
        momentum_constraint_max=largest(report.momentum_constraint_max, defects.f[1]))


def with_row(
    stepper: Stepper, trajectory: Trajectory, row_count: int, times: tuple[Array, Array], row: Rows
) -> Trajectory:
    """Return a trajectory of the first ``row_count`` rows of another and one more, ``row``.

    ``times`` are the time of that row and its time since the start, shape (1,) each, in scaled time
    both τ.
    """
    # no step ends at the start: multipliers and iterations have one row less
    binding, states, ends = stepper.binding, slice(row_count), slice(row_count - 1)
    (t, elapsed), (q, p) = times, full_states(trajectory)
    times_of_states = trajectory.tau if binding.clocked else trajectory.t
    flat = flat_multipliers(trajectory)[ends]
    return trajectory.of_states(States(
        binding, stepper.manifest, binding.parameters(trajectory.parameters, trajectory.t[0]),
        t=np.concatenate([times_of_states[states], t]), q=np.concatenate([q[states], row.q]),
        p=np.concatenate([p[states], row.p]),
        multipliers=np.concatenate([flat, row.multipliers]).astype(binding.dtype),
        iterations=np.concatenate([trajectory.iterations[ends], row.iterations]),
        work=np.concatenate([trajectory.work[states], row.work]),
        elapsed=np.concatenate([trajectory.elapsed[states], elapsed])))


class Observer:
    """Detection and location of the events of a run, which its caller stores.

    The crossings, and the end of the run by a terminal event, do not depend on the pieces in which
    the run is advanced, nor on when brackets are located.

    Attributes
    ----------
    events : tuple of Event
    end : TerminalEvent or None
        The event that ends the run.
    """

    def __init__(self, stepper: Stepper, run: RunArguments, events: tuple[Event, ...]) -> None:
        """Observe a run from its start; the run is an ensemble of one to ``crossings_of``."""
        self.events = events
        self.end: TerminalEvent | None = None
        self._stepper, self._run, self._binding = stepper, run, stepper.binding
        self._levels = Levels.of(stepper.binding, stepper.manifest, events)
        self._runs = replace(EnsembleArguments.of([run], stepper.binding.number_type),
                             inputs=run.inputs)
        (self._detector,) = detectors_for(stepper, self._levels, self._runs)
        #: The states at the beginning of the last two pieces, where an event may end the run.
        self._piece_starts: list[RunState] = []
        #: Crossings of the terminal events, once one of them ends the run.
        self._terminal_crossings: dict[str, Crossings] = {}

    @property
    def terminal(self) -> bool:
        """Whether an event may end the run."""
        return self._detector.terminal

    @property
    def full(self) -> bool:
        """Whether the brackets should be located before the run continues."""
        return self._detector.bracket_count >= _MOST

    @property
    def memory(self) -> Memory:
        """The detector's memory, from which detection resumes."""
        return self._detector.memory

    def resume(self, state: RunState, memory: Memory) -> None:
        """Continue from a state, with the memory of detection up to it."""
        self._detector.resume(state.steps, memory)
        self._piece_starts = [state.copy(self._binding)]

    def advance(
        self, constants: RunConstants, steps: int, every: int, state: RunState, rows: Rows
    ) -> int:
        """Advance ``state`` by up to ``steps`` steps, or to the step before a terminal event.

        Every ``every``-th state is written to ``rows``. Returns 0, or the status of a step that
        fails.
        """
        # the states at which this call and the last one began are kept: a terminal event is located
        # again from one of them, and may be in the last step of the call before
        if self.terminal:
            # the memory of the oldest start serves the newest
            piece_start = (self._piece_starts.pop(0) if len(self._piece_starts) == 2
                           else state.copy(self._binding))
            piece_start.assign(self._binding, state)
            self._piece_starts.append(piece_start)
        status = advance_and_detect(self._detector, self._binding, constants, steps, every, state,
                                    rows)
        if self._detector.ends_in is not None:  # no state after that step belongs to the run
            self._detector.bracket_last_step()
        self._look_for_end(state)
        return status if self.end is None else 0

    def close(self, state: RunState, ahead: tuple[Array, Array] | None = None) -> None:
        """Detect events in the last step without a next one; go back if one ends the run.

        ``ahead`` is the state (q, p) after the next step, shapes (n,), for runs that a terminal
        event may end: the detection in the last step is then final, and the run does not go back
        before it.
        """
        if self.end is None:
            self._detector.bracket_last_step(ahead)
            self._look_for_end(state)

    def take_crossings(self, stop: Callable[[], bool] = lambda: False) -> dict[str, Crossings]:
        """Solve for the crossings bracketed since the last call, and forget the brackets.

        Crossings after a terminal event that has ended the run are left out. ``stop()`` is called
        between steps; once it is true, the remaining crossings are not located.
        """
        # terminal events were solved for in ``_look_for_end``, and have no bracket any more
        crossings = self._locate(self._detector.brackets, stop) | self._terminal_crossings
        self._detector.forget()
        self._terminal_crossings = {}
        if self.end is None:
            return crossings
        return {name: event_crossings.until(self.end.at, self._run.dt)
                for name, event_crossings in crossings.items()}

    def add_impacts(self, report: Report, _count: int) -> Report:
        """Return the report of the run unchanged."""
        return report

    def results(self, trajectory: Trajectory, crossings: dict[str, Crossings]) -> Trajectory:
        """Return a trajectory with its crossings."""
        return replace_fields(trajectory, events=crossings)

    def _locate(self, brackets: Any, stop: Callable[[], bool]) -> dict[str, Crossings]:
        """Return the crossings in ``brackets`` (or None), event's name → crossings.

        The location ends early once ``stop()`` is true.
        """
        (crossings,) = crossings_of(self._stepper, self._levels, self._runs, [brackets],
                                    lambda states: fill_ensemble(states, threads_of(workers=None),
                                                                 stop))
        return crossings

    def _look_for_end(self, state: RunState) -> None:
        """Locate terminal events, and return the state to the step before the first one."""
        brackets = self._detector.take_terminal_brackets()
        if brackets is None:
            return
        crossings = self._locate(brackets, stop=lambda: False)
        name = first_terminal_event(self.events, crossings, self._run.dt)
        if name is None:
            return
        self._terminal_crossings = {event.name: crossings[event.name]
                                    for event in self.events if event.terminal}
        crossing, binding = crossings[name].first, self._binding
        steps = int(crossing.steps[0])
        # An event shows in the piece of its step or in the next one, so that one of the last two
        # pieces starts before it. From there the run is repeated up to its step; as ``every`` is
        # more than the number of steps, no row is stored.
        piece_start = next(start for start in reversed(self._piece_starts) if start.steps <= steps)
        remaining_steps = steps - piece_start.steps
        state.assign(binding, piece_start)
        if remaining_steps:
            binding.integrate(self._run.constants(binding), remaining_steps,
                              every=remaining_steps + 1, state=state,
                              rows=Rows.allocate(binding, 0))
        self.end = TerminalEvent([event.name for event in self.events].index(name), crossing,
                                 self._row_to(state, crossing))

    def _row_to(self, state: RunState, event: Crossings) -> Rows:
        """Return the row at an event: a partial step from the state before it.

        The row has the state of the crossing, the multipliers of the partial step, and the work
        since the start of the run.
        """
        stepper, run, binding = self._stepper, self._run, self._binding
        # counted from the start of the run, as the crossing's time is
        t0 = binding.times(run.t0, run.dt, event.steps)
        partial_step = event.elapsed - binding.times(0 * run.t0, run.dt, event.steps)
        parameters = {name: np.array([number], binding.number_type)
                      for name, number in run.at_step(int(event.steps[0])).parameters.items()}

        def fill(states: EnsembleStates) -> None:
            """Integrate an ensemble in this thread."""
            fill_ensemble(states, threads=1, stop=lambda: False)

        states_of_step = run_together(stepper, state.q[None], state.p[None], t0, partial_step,
                                      parameters, fill, steps=1)
        row = states_of_step.rows[:, 1]
        return replace(row, q=event.q, p=event.p, work=binding.work_done(state.record) + row.work)
