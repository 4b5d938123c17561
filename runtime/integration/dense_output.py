"""States of a run between its steps: a real step of a part of Δt from the state before.

Where the run stored t_k, the state at t_k + jΔt + θΔt, 0 < θ < 1, is that of j whole steps and one
step of length θΔt. It is on its constraints to round-off, and as near to the motion as the states
of the run are: a short step adds an error of its own order, (θΔt)^(r+1). In scaled time it is one
of length δτ with t(δτ) the time asked for, which Newton's method finds: dt/dτ = σ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import count_text, shown
from ...core.arrays import Array
from ...core.errors import InputError, Stopped
from ...core.interrupts import catch_ctrl_c
from ...core.records import dataclass
from ..bindings.array_checks import as_numbers, as_real
from ..bindings.inputs import InputRows
from ..results.outputs import States, flat_multipliers, full_states
from ..results.trajectory import Trajectory
from .lanes import EnsembleStates, fill_ensemble, threads_of
from .run_arguments import EnsembleArguments, RunArguments

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["between", "epsilon_of_times", "partial_steps", "places_of", "refuse_forgotten",
           "refuse_impacts", "refuse_of_another", "run_together", "stored_steps_at",
           "times_reached"]

#: Newton's steps to a time in scaled time, at most: three or four are usual.
_NEWTON = 12
#: Numbers of states that whole steps may fill at a time, between two stored ones.
_AT_ONCE = 2**22


@dataclass(frozen=True)
class Places:
    """Places of times in a run: the known state before each, then whole steps, then a part of one.

    ``rows`` are indices of known states, ``steps`` numbers of whole steps from there, and ``rest``
    the remaining parts of a step in s, in scaled time δτ; an entry for each time.
    """

    rows: Array
    steps: Array
    rest: Array


def between(
    stepper: Stepper, trajectory: Trajectory, times: ArrayLike, workers: int | None
) -> Trajectory:
    """Return the states of a trajectory at times; see ``Trajectory.at``."""
    if not isinstance(trajectory, Trajectory):
        raise InputError(f"trajectory = {shown(trajectory)} is no trajectory; give what "
                         "integrate returned.")
    threads = threads_of(workers)
    with catch_ctrl_c() as interrupts:
        states = _states_at(stepper, trajectory, times, lambda ensemble: fill_ensemble(
            ensemble, threads, stop=lambda: interrupts.is_requested))
    if interrupts.is_requested:
        raise Stopped("Stopped between the steps of a run that is complete; it is in .trajectory.",
                      interrupts.signal, trajectory=trajectory)
    return states


def _states_at(
    stepper: Stepper, trajectory: Trajectory, times: ArrayLike,
    fill: Callable[[EnsembleStates], None],
) -> Trajectory:
    """Return the states of a run at ``times``, computed by steps from the known states before them.

    Known states are stored rows and states after impacts. From them all states are integrated as
    one ensemble, which ``fill`` advances in place, in three stages: from an impact to the end of
    its step, whole steps, and the rest of a step.
    """
    refuse_of_another(stepper, trajectory)
    refuse_impacts(trajectory)
    refuse_forgotten(stepper, trajectory)
    if not len(trajectory) or ((1 if trajectory.dt > 0 else -1) * np.diff(trajectory.t) < 0).any():
        raise InputError(f"The trajectory has {count_text(len(trajectory), 'state')}, not in the "
                         "order of time: "
                         "t_eval or at(...) had these times. Ask the run for the times wanted."
                         if len(trajectory) else "The trajectory has no states: t_eval or at(...) "
                         "had no times. Ask the run for the times wanted.")
    t = _times(stepper, times)
    clocked, dt = stepper.binding.clocked, trajectory.dt
    known_states = _known_states(trajectory, clocked)
    places = (_places_in_scaled_time(stepper, trajectory, t, fill) if clocked else
              places_of(stepper, trajectory.t[0], known_states.elapsed, dt, t))
    targets = _targets_at(trajectory, known_states, places.rows)
    _finish_impact_steps(stepper, trajectory, t, known_states, places, targets, fill)
    for limit, group in _groups_of_times(trajectory, places):
        _advance(stepper, trajectory, fill, targets, group, np.full(len(group), dt),
                 steps=places.steps[group], step_limit=limit)
    targets.t[:] = stepper.binding.times(targets.t, dt, places.steps)
    targets.steps[:] += places.steps
    remaining = np.flatnonzero(places.rest != 0)
    if len(remaining):
        _advance(stepper, trajectory, fill, targets, remaining, places.rest[remaining],
                 steps=np.ones(len(remaining), dtype=int), step_limit=1)
    if clocked:
        # the last coordinate is t: as asked for, which it is but for rounding; the times are τ
        targets.q[:, -1], t = t, targets.t + places.rest
    return _trajectory(stepper, trajectory, t, targets)


def _targets_at(trajectory: Trajectory, known_states: _KnownStates, rows: Array) -> _Targets:
    """Return copies of the known states ``rows``, with multipliers of the steps that end there."""
    multipliers_of_steps = flat_multipliers(trajectory)
    multipliers = np.zeros((len(rows), multipliers_of_steps.shape[1]), trajectory.q.dtype)
    iterations = np.zeros(len(rows), dtype=np.intc)
    # row 0 of the run stands for the start and for impacts, where no step of the run ends
    stored_rows = known_states.ends_of[rows]
    ends_step = stored_rows > 0
    multipliers[ends_step] = multipliers_of_steps[stored_rows[ends_step] - 1]
    iterations[ends_step] = trajectory.iterations[stored_rows[ends_step] - 1]
    return _Targets(
        t=known_states.begin[rows], steps=known_states.steps[rows], q=known_states.q[rows],
        p=known_states.p[rows], work=known_states.work[rows], multipliers=multipliers,
        iterations=iterations)


def _finish_impact_steps(
    stepper: Stepper, trajectory: Trajectory, t: Array, known_states: _KnownStates, places: Places,
    targets: _Targets, fill: Callable[[EnsembleStates], None],
) -> None:
    """Advance targets from an impact to the end of its step, where t is at that end or after it.

    t, shape (targets,), are the times asked for. From the end of that step the targets take steps
    of the run: ``places`` gets the number of steps and the remainder from there. A target within
    the step of its impact is one partial step away.
    """
    impacts = np.flatnonzero(known_states.is_impact[places.rows])
    if not len(impacts):
        return
    dt, t0 = trajectory.dt, trajectory.t[0]
    impact_times, elapsed = known_states.elapsed[places.rows[impacts]], t[impacts] - t0
    # 0 * x is 0 in the type of times, which may be Python's objects
    step_ends = stepper.binding.times(0 * impact_times, dt, targets.steps[impacts] + 1)
    rounding = _rounding_of_times(stepper, t0, known_states.elapsed[-1])
    steps, remainders = _whole_steps(stepper, step_ends, dt, elapsed, rounding)
    is_behind = np.array((1 if dt > 0 else -1) * (elapsed - step_ends) >= -rounding, bool)
    leaving = impacts[is_behind]
    if len(leaving):
        _advance(stepper, trajectory, fill, targets, leaving,
                 (step_ends - impact_times)[is_behind], steps=np.ones(len(leaving), int),
                 step_limit=1)
    targets.t[leaving] = t0 + step_ends[is_behind]
    targets.steps[leaving] += 1
    distance = elapsed - impact_times
    places.steps[impacts] = np.where(is_behind, steps, 0)
    places.rest[impacts] = np.where(
        is_behind, remainders, np.where(abs(distance) <= rounding, 0 * distance, distance))


class _KnownStates(NamedTuple):
    """Rows of a run, and the states after its impacts, in the order of time.

    An entry for each state: ``begin`` its time, in scaled time τ; ``elapsed`` the time since the
    start; ``steps`` the whole steps of the run before it; ``ends_of`` its row in the trajectory, 0
    for the start and for impacts. q and p have the shape (states, n).
    """

    begin: Array
    elapsed: Array
    q: Array
    p: Array
    work: Array
    steps: Array
    ends_of: Array
    is_impact: Array


def _known_states(trajectory: Trajectory, clocked: bool) -> _KnownStates:
    """Return the stored rows and the states after impacts, from which steps may be taken."""
    times, elapsed = ((trajectory.tau, trajectory.tau) if clocked else
                      (trajectory.t, trajectory.elapsed))
    steps = np.rint((elapsed / trajectory.dt).astype(float)).astype(int)
    q, p = full_states(trajectory)
    stored_rows = _KnownStates(
        times, elapsed, q, p, trajectory.work, steps, ends_of=np.arange(len(times)),
        is_impact=np.zeros(len(times), bool))
    if not trajectory.impacts:
        return stored_rows
    parts = [stored_rows]
    for impacts in trajectory.impacts.values():
        # a trajectory of a file has no elapsed times
        elapsed_of_impacts = (impacts.t - trajectory.t[0] if trajectory._states is None
                              else impacts.elapsed)
        steps_of_impacts = np.floor((elapsed_of_impacts / trajectory.dt).astype(float)).astype(int)
        parts.append(_KnownStates(
            impacts.t, elapsed_of_impacts, impacts.q, impacts.p, impacts.work, steps_of_impacts,
            ends_of=np.zeros(len(impacts), int), is_impact=np.ones(len(impacts), bool)))
    known_states = _KnownStates(*map(np.concatenate, zip(*parts, strict=True)))
    # of gaps that close at once, the last jump leads to a state that no other begins with
    starts_of_jumps = {(t, p.tobytes()) for impacts in trajectory.impacts.values()
                       for t, p in zip(impacts.t.tolist(), impacts.p_before, strict=True)}
    is_last = [not known_states.is_impact[i]
               or (float(t), known_states.p[i].tobytes()) not in starts_of_jumps
               for i, t in enumerate(known_states.begin)]
    distinct = np.flatnonzero(is_last)
    # stable: an impact at the time of a row follows the row
    direction = 1 if trajectory.dt > 0 else -1
    order = np.argsort(direction * known_states.elapsed[distinct], kind="stable")
    return _KnownStates(*(column[distinct[order]] for column in known_states))


def stored_steps_at(
    stepper: Stepper, run: RunArguments, times: ArrayLike, remainder: Any = 0
) -> Array | None:
    """Return numbers of steps, rising: the last ones before the times, and the count of the run.

    Only the states after these steps need be stored. None in scaled time, where any step may be one
    of them. The run ends ``remainder`` seconds after its last step. Raises InputError for times
    outside of the run, and for ``every`` other than 1.
    """
    if run.every != 1:
        raise InputError(f"every = {run.every} and t_eval both say what is stored; give one.")
    if stepper.binding.clocked:
        return None  # which steps are next to them is known when they are done
    time_span = stepper.binding.times(0 * run.t0, run.dt, np.array([0, run.steps]))
    time_span[1] += remainder
    places = places_of(stepper, run.t0, time_span, run.dt, _times(stepper, times))
    # row 1 of ``time_span`` is the end of the run; a time there counts no steps from the start
    stored_steps = np.unique(np.append(places.steps[places.rows == 0], run.steps))
    return stored_steps[stored_steps > 0]


def times_reached(stepper: Stepper, trajectory: Trajectory, times: ArrayLike) -> Array:
    """Return those of the times that are not behind the last row of a run."""
    t, end = _times(stepper, times), trajectory.t[-1]
    ahead = 1 if trajectory.dt > 0 else -1
    reached: Array = t[ahead * (t - end) <= _rounding_of_times(stepper, end, elapsed=0)]
    return reached


@dataclass(frozen=True)
class _Targets:
    """States on their way to the times asked for, a row each; they are advanced in place.

    ``t`` are their times, in scaled time τ, ``steps`` the whole steps of the run before them. q and
    p have the shape (times, n). ``multipliers`` and ``iterations`` are of the last step to a state.
    """

    t: Array
    steps: Array
    q: Array
    p: Array
    work: Array
    multipliers: Array
    iterations: Array


def _advance(
    stepper: Stepper, trajectory: Trajectory, fill: Callable[[EnsembleStates], None],
    targets: _Targets, group: Array, dt: Array, *, steps: Array, step_limit: int,
) -> None:
    """Advance the targets with the indices ``group`` by ``steps`` steps of dt, in place.

    ``dt`` and ``steps`` have an entry for each target. All take ``step_limit`` steps together, with
    the inputs of their steps of the run, and each target gets the state after its own number of
    steps. Their times and steps are not changed.
    """
    input_rows, step_counts = trajectory._inputs, targets.steps[group]
    # all targets are of one run, number 0
    inputs = None if input_rows is None else input_rows.rows_of(
        runs=0 * step_counts, steps=step_counts, count=step_limit)
    columns = {name: np.full(len(group), number, stepper.binding.number_type)
               for name, number in trajectory.parameters.items()}
    ensemble = run_together(stepper, targets.q[group], targets.p[group], targets.t[group], dt,
                            columns, fill, step_limit, inputs)
    # rows of the ensemble have the axes (target, step)
    own_rows = np.arange(len(group)), steps
    rows = ensemble.rows
    targets.q[group], targets.p[group] = rows.q[own_rows], rows.p[own_rows]
    targets.work[group] += rows.work[own_rows]
    targets.multipliers[group] = rows.multipliers[own_rows]
    targets.iterations[group] = rows.iterations[own_rows]


def run_together(
    stepper: Stepper, q: Array, p: Array, t0: Array, dt: Array, parameters: dict[str, Array],
    fill: Callable[[EnsembleStates], None], steps: int, inputs: InputRows | None = None,
) -> EnsembleStates:
    """Return runs of ``steps`` steps, each stored, from states that are on their constraints.

    Run i begins at row i of q and p, (runs, n), at t0[i], with steps of dt[i] and the i-th entries
    of ``parameters``; ``fill`` integrates an ensemble in place. Raises InputError if a step of one
    of them has no solution, though the steps of the run that they belong to have.
    """
    # the arguments that all runs have in common come from the first one; the solver is the default
    number = stepper.binding.number_type
    parameters_of_first = {name: column[0] for name, column in parameters.items()}
    first_run = RunArguments(q[0], p[0], dt[0], steps, every=1, parameters=parameters_of_first,
                             solver="auto", tolerance=None, max_iterations=50, t0=t0[0])
    ensemble = EnsembleStates.at_start(stepper, EnsembleArguments(
        first_run, q, p, dt=dt.astype(number), t0=t0.astype(number), parameters=parameters,
        inputs=inputs))
    fill(ensemble)
    failed = np.flatnonzero(ensemble.status)
    if len(failed):
        raise InputError(
            f"From t = {float(t0[failed[0]]):.6g} s no step of {float(dt[failed[0]]):.3g} s is "
            "found, though the run has found its own; take a smaller dt.")
    return ensemble


def partial_steps(
    stepper: Stepper, q: Array, p: Array, t0: Array, dt: Array, parameters: dict[str, Array],
    fill: Callable[[EnsembleStates], None], inputs: InputRows | None = None,
) -> tuple[Array, Array]:
    """Return the states (q, p), (rows, n) each, one step of dt after rows of q and p.

    ``t0``, ``dt`` and the columns of ``parameters`` have an entry for each row, ``inputs`` a run. A
    dt of 0 leaves its row unchanged.
    """
    q, p = q.copy(), p.copy()
    indices = np.flatnonzero(dt != 0)
    if len(indices):
        columns = {name: column[indices] for name, column in parameters.items()}
        own_inputs = None if inputs is None else inputs.rows_of(runs=indices, steps=0 * indices)
        ensemble = run_together(stepper, q[indices], p[indices], t0[indices], dt[indices], columns,
                                fill, steps=1, inputs=own_inputs)
        q[indices], p[indices] = ensemble.q, ensemble.p
    return q, p


def _groups_of_times(trajectory: Trajectory, places: Places) -> list[tuple[int, Array]]:
    """Return groups of the times that whole steps lead to: (most steps in the group, its indices).

    All members of a group store the most steps of the group: members of similar length, the longest
    first, and at most ``_AT_ONCE`` numbers together.
    """
    order = np.argsort(places.steps, kind="stable")
    order = order[places.steps[order] > 0]
    groups, width = [], trajectory.q.shape[1]
    while len(order):
        longest = int(places.steps[order[-1]])
        count = max(1, _AT_ONCE // ((longest + 1) * width))
        groups.append((longest, order[-count:]))
        order = order[:-count]
    return groups


def places_of(stepper: Stepper, t0: Any, stored_times: Array, dt: Any, t: Array) -> Places:
    """Return the places of the times t in a run; raise InputError for times outside of the run.

    ``stored_times`` are the times of stored rows since the start t0, which keep their digits at
    large t. A time within rounding of a row, or of the end of a step, is there.
    """
    ahead, elapsed = 1 if dt > 0 else -1, t - t0
    rounding = _rounding_of_times(stepper, t0, stored_times[-1])
    is_outside = ((ahead * (elapsed - stored_times[0]) < -rounding)
                  | (ahead * (elapsed - stored_times[-1]) > rounding))
    if is_outside.any():
        raise InputError(
            f"The time {float(t0 + elapsed[is_outside][0])} is outside of the run, which goes from "
            f"{float(t0)} to {float(t0 + stored_times[-1])} s; ask for times in between.")
    rows = np.searchsorted(ahead * stored_times, ahead * elapsed + rounding, side="right") - 1
    return Places(rows, *_whole_steps(stepper, stored_times[rows], dt, elapsed, rounding))


def _rounding_of_times(stepper: Stepper, t0: Any, elapsed: Any) -> Any:
    """Return the rounding in s of times up to ``elapsed`` after t0, two units in the last place."""
    return 2 * epsilon_of_times(stepper) * max(abs(t0), abs(t0 + elapsed))


def _whole_steps(
    stepper: Stepper, start_times: Array, dt: Any, t: Array, rounding: Any
) -> tuple[Array, Array]:
    """Return the numbers of whole steps from ``start_times`` to t, and the remainders in s.

    Remainders up to ``rounding`` are 0, in the type of times, which may be Python's objects.
    """
    ahead, times = 1 if dt > 0 else -1, stepper.binding.times
    steps = np.array([int(x) for x in (t - start_times) / dt], dtype=int)
    # a quotient rounds either way: below a whole number, one more step may lead up to t
    steps += ahead * times(start_times, dt, steps + 1) <= ahead * t + rounding
    remainders = t - times(start_times, dt, steps)
    return steps, np.where(abs(remainders) <= rounding, 0 * remainders, remainders)


def _places_in_scaled_time(
    stepper: Stepper, trajectory: Trajectory, t: Array, fill: Callable[[EnsembleStates], None]
) -> Places:
    """Return the places of the times t in a run in scaled time; ``rest`` is δτ.

    The clock t(τ) is the last coordinate. The stored row before t is known from its clock; whole
    steps from there are taken until the clock has passed t; δτ solves t(δτ) = t. Raises InputError
    for times outside of the run.
    """
    binding, direction = stepper.binding, 1 if trajectory.dt > 0 else -1
    q, p = full_states(trajectory)
    clock = trajectory.t
    # t is a coordinate, of the stepper's type
    rounding = 2 * binding.epsilon * np.abs(clock).max()
    rows = np.searchsorted(direction * clock, direction * t + rounding, side="right") - 1
    is_outside = (rows < 0) | (direction * (t - clock[-1]) > rounding)
    if is_outside.any():
        raise InputError(
            f"The time {float(t[is_outside][0])} is outside of the run, which goes from "
            f"{float(clock[0])} to {float(clock[-1])} s; ask for times in between.")
    columns = {name: np.full(len(t), number, binding.number_type)
               for name, number in trajectory.parameters.items()}
    dt, zeros = np.full(len(t), trajectory.dt), np.zeros(len(t), binding.number_type)
    q, p = q[rows], p[rows]
    # steps from each row to the next; the last row has none
    steps_to_next = np.append(np.diff(trajectory.tau), 0 * trajectory.dt)[rows] / trajectory.dt
    # one less: the last of them ends at the next row, which is not before t; a quotient that is a
    # whole number but for round-off is that number
    step_limit = max(int(np.ceil(float(steps_to_next.max()) - 1e-3)) - 1, 0) if len(t) else 0
    steps = np.zeros(len(t), int)
    if step_limit:
        states = run_together(stepper, q, p, zeros, dt, columns, fill, step_limit).rows
        # the axes of rows are (time, step, coordinate)
        clocks = states.q[:, :, -1].astype(t.dtype)
        is_before = direction * clocks <= direction * t[:, None] + rounding
        # the start of the steps is before t, and is no step
        steps = np.where(steps_to_next > 1, is_before.sum(axis=1) - 1, 0)
        own_rows = np.arange(len(t)), steps
        q, p = states.q[own_rows], states.p[own_rows]
    return Places(rows, steps, _partial_scaled_steps(stepper, trajectory, t, (q, p), columns,
                                                     rounding, fill))


def _partial_scaled_steps(
    stepper: Stepper, trajectory: Trajectory, t: Array, states: tuple[Array, Array],
    parameters: dict[str, Array], rounding: Any, fill: Callable[[EnsembleStates], None],
) -> Array:
    """Return the part δτ of a step from each state at which its clock shows t, shape (times,).

    Newton's method for t(δτ) = t, with dt/dτ = σ at the end of the part: δτ ← δτ + (t − t(δτ))/σ,
    within 0 and Δτ. ``states`` are (q, p), (times, n) each, within a step before t.
    """
    binding, direction = stepper.binding, 1 if trajectory.dt > 0 else -1
    q, p = states
    dt, zeros = np.full(len(t), trajectory.dt), np.zeros(len(t), binding.number_type)
    remainders, end_states = zeros.copy(), states
    structs = binding.parameters(trajectory.parameters)
    for _ in range(_NEWTON):
        clock_errors = t - end_states[0][:, -1].astype(t.dtype)
        is_open = np.abs(clock_errors) > rounding
        if not is_open.any():
            break
        updated = remainders + np.where(
            is_open, clock_errors / binding.time_scales(structs, *end_states), 0)
        # σ may change within a step: an update that leaves the step is taken to its end
        is_beyond, is_inside = direction * updated > direction * dt, direction * updated > 0
        remainders = np.where(is_beyond, dt, np.where(is_inside, updated, zeros))
        end_states = partial_steps(stepper, q, p, zeros, remainders, parameters, fill)
    return remainders


def epsilon_of_times(stepper: Stepper) -> float:
    """Return ε of the type of times, which for ``real="float"`` is double."""
    number = stepper.binding.number_type
    return stepper.binding.epsilon if number is object else float(np.finfo(number).eps)


def _times(stepper: Stepper, times: ArrayLike) -> Array:
    """Return the times, a number or a row, as an array (times,) of the stepper's numbers.

    Raises InputError for a time that is no number, and for more than one axis.
    """
    rows = np.atleast_1d(as_numbers("times", times))
    if rows.ndim != 1:
        raise InputError(f"times has shape {rows.shape}; give one row of times.")
    number = stepper.binding.number
    reals = [as_real("A time", x, number) for x in rows.tolist()]
    return np.array(reals, dtype=stepper.binding.number_type)


def refuse_forgotten(stepper: Stepper, trajectory: Trajectory) -> None:
    """Refuse a trajectory without the inputs of each step: one read from a file, or between steps.
    """
    # NaN, which differs from itself, stands for an input that changes
    changing = [name for name in stepper.binding.input_names
                if trajectory.parameters[name] != trajectory.parameters[name]]
    if changing and trajectory._inputs is None:
        raise InputError(f"Input {changing[0]!r} changes in this run, and what it was in each step "
                         "is not kept in files, nor with states between steps: ask the trajectory "
                         "that integrate returned.")


def refuse_impacts(trajectory: Trajectory) -> None:
    """Refuse a trajectory whose impacts are not known, such as one of an earlier file."""
    if trajectory.report.impacts and not trajectory.impacts:
        raise InputError("The run has impacts, at which its momenta jump, and they are not kept; "
                         "integrate again.")


def refuse_of_another(stepper: Stepper, trajectory: Trajectory) -> None:
    """Refuse a trajectory of another stepper, or of another version of the stepper."""
    own_manifest, run_manifest = stepper.manifest, trajectory.manifest
    compared_fields = ("name", "real", "system", "scheme")
    differences = [name for name in compared_fields
                   if getattr(own_manifest, name) != getattr(run_manifest, name)]
    if differences:
        raise InputError(
            f"The trajectory is of {run_manifest.name} in {run_manifest.real}, not of this "
            f"stepper, {own_manifest.name} in {own_manifest.real}: they differ in "
            f"{differences[0]}. Give the stepper that made it.")


def _trajectory(
    stepper: Stepper, trajectory: Trajectory, t: Array, targets: _Targets
) -> Trajectory:
    """Return the states as a trajectory: rows at the times, the report of the whole run."""
    binding = stepper.binding
    parameters = binding.parameters(trajectory.parameters, trajectory.t[0])
    states = States(binding, stepper.manifest, parameters, t, targets.q, targets.p,
                    multipliers=targets.multipliers[1:], iterations=targets.iterations[1:],
                    work=targets.work)
    origin = None if trajectory._origin is None else replace(trajectory._origin, between=True)
    return trajectory.of_states(states, tangents=None, _inputs=None, _origin=origin)
