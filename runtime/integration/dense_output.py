"""States of a run between its steps: a real step of a part of Δt from the state before.

Where the run stored t_k, the state at t_k + jΔt + θΔt, 0 < θ < 1, is that of j whole steps and one
step of length θΔt. It is on its constraints to round-off, and as near to the motion as the states
of the run are: a short step adds an error of its own order, (θΔt)^(r+1). In scaled time it is one
of length δτ with t(δτ) the time asked for, which Newton's method finds: dt/dτ = σ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import shown
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
           "refuse_impacts", "refuse_of_another", "run_together", "stored_steps_at"]

#: Newton's steps to a time in scaled time, at most: three or four are usual.
_NEWTON = 12
#: Numbers of states that whole steps may fill at a time, between two stored ones.
_AT_ONCE = 2**22


@dataclass(frozen=True)
class Places:
    """Places of times in a run: the stored row before each, then whole steps, then a part of one.
    """

    rows: Array
    steps: Array
    rest: Array


def between(
    stepper: Stepper, trajectory: Trajectory, times: ArrayLike, workers: int | None
) -> Trajectory:
    """Return the states of a trajectory at times; see ``Trajectory.at``."""
    if not isinstance(trajectory, Trajectory):
        raise InputError(f"trajectory = {shown(trajectory)} is none; give what integrate returned.")
    threads = threads_of(workers)
    with catch_ctrl_c() as interrupts:
        states = _states_at(stepper, trajectory, times, lambda ensemble: fill_ensemble(
            ensemble, threads, lambda: interrupts.requested))
    if interrupts.requested:
        raise Stopped("Stopped between the steps of a run that is complete; it is in .trajectory.",
                      interrupts.signal, trajectory=trajectory)
    return states


def _states_at(
    stepper: Stepper, trajectory: Trajectory, times: ArrayLike,
    fill: Callable[[EnsembleStates], None],
) -> Trajectory:
    """Return the states of a run at times: rows of it, or real steps from the rows before them.

    Each time belongs to the known state before it, a stored row or the state after an impact. From
    there go, for all times together: from an impact to the end of its step; whole steps; the rest.
    """
    refuse_of_another(stepper, trajectory)
    refuse_impacts(trajectory)
    refuse_forgotten(stepper, trajectory)
    t = _times(stepper, times)
    clocked, dt = stepper.binding.clocked, trajectory.dt
    known_states = _known_states(trajectory, clocked)
    begin, elapsed = known_states.begin, known_states.elapsed
    places = (_places_in_scaled_time(stepper, trajectory, t, fill) if clocked else
              places_of(stepper, trajectory.t[0], elapsed, dt, t))
    q, p, work = (column[places.rows] for column in (  # copies
        known_states.q, known_states.p, known_states.work))
    of_steps = flat_multipliers(trajectory)
    multipliers = np.zeros((len(t), of_steps.shape[1]), trajectory.q.dtype)
    iterations = np.zeros(len(t), dtype=np.intc)
    steps_ended = known_states.ends_of[places.rows]
    ended = steps_ended > 0  # on a state that a step of the run ends at: what that step found
    multipliers[ended] = of_steps[steps_ended[ended] - 1]
    iterations[ended] = trajectory.iterations[steps_ended[ended] - 1]
    targets = _Targets(q, p, work, multipliers, iterations)
    begin_times, step_counts = begin[places.rows], known_states.steps[places.rows]
    after = np.flatnonzero(known_states.is_impact[places.rows])
    if len(after):  # from an impact, first to the end of its step
        since, of_t = elapsed[places.rows[after]], t[after] - trajectory.t[0]
        ends = stepper.binding.times(0 * since, dt, step_counts[after] + 1)
        reach = _reach(stepper, trajectory.t[0], elapsed[-1])
        steps, remainders = _counted(stepper, ends, dt, of_t, reach)
        passed = np.array((1 if dt > 0 else -1) * (of_t - ends) >= -reach, bool)
        leaving = after[passed]
        if len(leaving):
            _advance(stepper, trajectory, fill, targets, leaving, begin_times[leaving],
                     (ends - since)[passed], step_counts=step_counts[leaving],
                     steps=np.ones(len(leaving), int), step_limit=1)
        begin_times[leaving] = trajectory.t[0] + ends[passed]
        step_counts[leaving] += 1
        places.steps[after] = np.where(passed, steps, 0)
        places.rest[after] = np.where(
            passed, remainders, np.where(abs(of_t - since) <= reach, 0 * since, of_t - since))
    # whole steps, then the parts of a step
    for limit, group in _parts(trajectory, places):
        _advance(stepper, trajectory, fill, targets, group, begin_times[group],
                 np.full(len(group), dt), step_counts=step_counts[group],
                 steps=places.steps[group], step_limit=limit)
    remaining = np.flatnonzero(places.rest != 0)
    begin_times = stepper.binding.times(begin_times, dt, places.steps)
    if len(remaining):
        _advance(stepper, trajectory, fill, targets, remaining, begin_times[remaining],
                 places.rest[remaining], step_counts=(step_counts + places.steps)[remaining],
                 steps=np.ones(len(remaining), dtype=int), step_limit=1)
    if clocked:
        targets.q[:, -1], t = t, begin_times + places.rest  # the same but for rounding, and τ
    return _trajectory(stepper, trajectory, t, targets)


@dataclass(frozen=True)
class _KnownStates:
    """Rows of a run, and the states after its impacts, in the order of time.

    ``begin`` are their times, in scaled time τ, ``steps`` the whole steps before each; ``ends_of``
    is the stored row that a state is, 0 for the start and for impacts.
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
    begin, elapsed = ((trajectory.tau, trajectory.tau) if clocked else
                      (trajectory.t, trajectory.elapsed))
    steps = np.rint((elapsed / trajectory.dt).astype(float)).astype(int)
    rows = len(begin)
    columns = [begin, elapsed, *full_states(trajectory), trajectory.work, steps, np.arange(rows),
               np.zeros(rows, bool)]
    if not trajectory.impacts:
        return _KnownStates(*columns)
    for impacts in trajectory.impacts.values():
        since = impacts.t - trajectory.t[0] if trajectory._states is None else impacts.elapsed
        columns = [np.concatenate(pair) for pair in zip(columns, (
            impacts.t, since, impacts.q, impacts.p, impacts.work,
            np.floor((since / trajectory.dt).astype(float)).astype(int),
            np.zeros(len(impacts), int), np.ones(len(impacts), bool)), strict=True)]
    # Of gaps that close at once, the last jump leads to a state that no other begins with.
    begun = {(t, p.tobytes()) for impacts in trajectory.impacts.values()
             for t, p in zip(impacts.t.tolist(), impacts.p_before, strict=True)}
    last = [row for row in range(len(columns[0])) if row < rows or (
        float(columns[0][row]), columns[3][row].tobytes()) not in begun]
    order = np.argsort((1 if trajectory.dt > 0 else -1) * columns[1][last], kind="stable")
    return _KnownStates(*(column[np.array(last)[order]] for column in columns))


def stored_steps_at(
    stepper: Stepper, run: RunArguments, times: ArrayLike, remainder: Any = 0
) -> Array | None:
    """Return the steps of a run that lie just before the times, rising, and its last one.

    None in scaled time, where any step may be. The run ends ``remainder`` seconds after its last
    step. Raises InputError for times outside of the run, and for ``every`` other than 1.
    """
    if run.every != 1:
        raise InputError(f"every = {run.every} and t_eval both say what is stored; give one.")
    if stepper.binding.clocked:
        return None  # which steps are next to them is known when they are done
    ends = stepper.binding.times(0 * run.t0, run.dt, np.array([0, run.steps]))
    ends[1] += remainder
    places = places_of(stepper, run.t0, ends, run.dt, _times(stepper, times))
    stored_steps = np.unique(np.append(places.steps[places.rows == 0], run.steps))
    return stored_steps[stored_steps > 0]


@dataclass(frozen=True)
class _Targets:
    """States on their way to the times asked for, a row each; they are advanced in place."""

    q: Array
    p: Array
    work: Array
    multipliers: Array
    iterations: Array


def _advance(
    stepper: Stepper, trajectory: Trajectory, fill: Callable[[EnsembleStates], None],
    targets: _Targets,
    group: Array, t0: Array, dt: Array, *, step_counts: Array, steps: Array, step_limit: int,
) -> None:
    """Advance the targets with the indices ``group`` by ``steps`` steps of dt each, in place.

    Targets are states at t0 after ``step_counts`` steps of the run, whose inputs they have. All
    take ``step_limit`` steps together; each target keeps the state after its own number of steps.
    """
    input_rows = trajectory._inputs
    inputs = None if input_rows is None else input_rows.taken(0 * step_counts, step_counts,
                                                              step_limit)
    columns = {name: np.full(len(group), value, stepper.binding.number_type)
               for name, value in trajectory.parameters.items()}
    ensemble = run_together(stepper, targets.q[group], targets.p[group], t0, dt, columns, fill,
                            step_limit, inputs)
    row = np.arange(len(group))
    rows = ensemble.rows
    targets.q[group], targets.p[group] = rows.q[row, steps], rows.p[row, steps]
    targets.work[group] += rows.work[row, steps]
    targets.multipliers[group] = rows.multipliers[row, steps]
    targets.iterations[group] = rows.iterations[row, steps]


def run_together(
    stepper: Stepper, q: Array, p: Array, t0: Array, dt: Array, parameters: dict[str, Array],
    fill: Callable[[EnsembleStates], None], steps: int, inputs: InputRows | None = None,
) -> EnsembleStates:
    """Return runs of ``steps`` steps, each stored, from states that are on their constraints.

    Run i begins at row i of q and p, (runs, n), at t0[i], with steps of dt[i]; ``fill`` integrates.

    Raises InputError if one of them finds no step, though the run that they belong to has found its
    own.
    """
    number = stepper.binding.number_type
    parameters_of_first = {name: column[0] for name, column in parameters.items()}
    first = RunArguments(q[0], p[0], dt[0], steps, every=1, parameters=parameters_of_first,
                         solver="auto", tolerance=None, max_iterations=50, t0=t0[0])
    ensemble = EnsembleStates.of(stepper, EnsembleArguments(
        first, q, p, dt.astype(number), t0.astype(number), parameters, inputs))
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
    """Return the states one step of each dt after rows of q and p; a dt of 0 changes nothing."""
    q, p = q.copy(), p.copy()
    moved = np.flatnonzero(dt != 0)
    if len(moved):
        ensemble = run_together(stepper, q[moved], p[moved], t0[moved], dt[moved],
                              {name: column[moved] for name, column in parameters.items()}, fill,
                              1, None if inputs is None else inputs.taken(moved, 0 * moved))
        q[moved], p[moved] = ensemble.q, ensemble.p
    return q, p


def _parts(trajectory: Trajectory, places: Places) -> list[tuple[int, Array]]:
    """Return groups of times that whole steps lead to: (most steps in the group, its indices).

    A group is as large as the memory for all its steps allows; the longest come first.
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


def places_of(stepper: Stepper, t0: Any, stored: Array, dt: Any, t: Array) -> Places:
    """Return where the times t are, or refuse those outside of the run.

    ``stored`` are the times of stored rows since the start t0, which keep their digits at large t.
    """
    ahead, t = 1 if dt > 0 else -1, t - t0
    reach = _reach(stepper, t0, stored[-1])
    outside = (ahead * (t - stored[0]) < -reach) | (ahead * (t - stored[-1]) > reach)
    if outside.any():
        raise InputError(
            f"The time {float(t0 + t[outside][0])} is outside of the run, which goes from "
            f"{float(t0)} to {float(t0 + stored[-1])} s; ask for times in between.")
    rows = np.searchsorted(ahead * stored, ahead * t + reach, side="right") - 1
    return Places(rows, *_counted(stepper, stored[rows], dt, t, reach))


def _reach(stepper: Stepper, t0: Any, elapsed: Any) -> Any:
    """Return the rounding of times up to ``elapsed`` after t0: so near, a time is a step's end."""
    return 2 * epsilon_of_times(stepper) * max(abs(t0), abs(t0 + elapsed))


def _counted(
    stepper: Stepper, begin: Array, dt: Any, t: Array, reach: Any
) -> tuple[Array, Array]:
    """Return the numbers of whole steps from ``begin`` to times t, and the remainders in s."""
    ahead, times = 1 if dt > 0 else -1, stepper.binding.times
    steps = np.array([int(x) for x in (t - begin) / dt], dtype=int)
    # a quotient rounds either way
    steps += ahead * times(begin, dt, steps + 1) <= ahead * t + reach
    remainders = t - times(begin, dt, steps)
    return steps, np.where(abs(remainders) <= reach, 0 * remainders, remainders)


def _places_in_scaled_time(
    stepper: Stepper, trajectory: Trajectory, t: Array, fill: Callable[[EnsembleStates], None]
) -> Places:
    """Return where the times t are, or refuse those outside of the run; the rest is δτ."""
    binding, ahead = stepper.binding, 1 if trajectory.dt > 0 else -1
    q, p = full_states(trajectory)
    clock = trajectory.t
    reach = 2 * epsilon_of_times(stepper) * np.abs(clock).max()
    rows = np.searchsorted(ahead * clock, ahead * t + reach, side="right") - 1
    outside = (rows < 0) | (ahead * (t - clock[-1]) > reach)
    if outside.any():
        raise InputError(
            f"The time {float(t[outside][0])} is outside of the run, which goes from "
            f"{float(clock[0])} to {float(clock[-1])} s; ask for times in between.")
    columns = {name: np.full(len(t), value, binding.number_type)
               for name, value in trajectory.parameters.items()}
    dt, zeros = np.full(len(t), trajectory.dt), np.zeros(len(t), binding.number_type)
    q, p = q[rows], p[rows]
    # Whole steps from the stored state to the last one that is not behind.
    gaps = np.append(np.diff(trajectory.tau), 0 * trajectory.dt)[rows] / trajectory.dt
    step_limit = max(int(np.ceil(gaps.max().astype(float) - 1e-3)) - 1, 0) if len(t) else 0
    steps = np.zeros(len(t), int)
    if step_limit:
        states = run_together(stepper, q, p, zeros, dt, columns, fill, step_limit).rows
        # the last coordinate is t
        passed = ahead * states.q[:, :, -1].astype(t.dtype) <= ahead * t[:, None] + reach
        steps = np.where(gaps > 1, passed.sum(axis=1) - 1, 0)
        indices = np.arange(len(t))
        q, p = states.q[indices, steps], states.p[indices, steps]
    remainders, ends = zeros.copy(), (q, p)
    parameters = binding.parameters(trajectory.parameters)
    # Newton's method for t(τ) = t, with dt/dτ = σ at the end so far; δτ stays within one step
    for _ in range(_NEWTON):
        missing = t - ends[0][:, -1].astype(t.dtype)
        open_ = np.abs(missing) > reach
        if not open_.any():
            break
        moved = remainders + np.where(open_, missing / binding.time_scales(parameters, *ends), 0)
        remainders = np.where(ahead * moved > ahead * dt, dt,
                              np.where(ahead * moved > 0, moved, zeros))
        ends = partial_steps(stepper, q, p, zeros, remainders, columns, fill)
    return Places(rows, steps, remainders)


def epsilon_of_times(stepper: Stepper) -> float:
    """Return the precision of times, which for ``real="float"`` are doubles."""
    number = stepper.binding.number_type
    return stepper.binding.epsilon if number is object else float(np.finfo(number).eps)


def _times(stepper: Stepper, times: ArrayLike) -> Array:
    """Return the times as a row of the stepper's own numbers."""
    rows = np.atleast_1d(as_numbers("times", times))
    if rows.ndim != 1:
        raise InputError(f"times has shape {rows.shape}; give one row of times.")
    number = stepper.binding.number
    reals = [as_real("A time", x, number) for x in rows.tolist()]
    return np.array(reals, dtype=stepper.binding.number_type)


def refuse_forgotten(stepper: Stepper, trajectory: Trajectory) -> None:
    """Refuse a trajectory without the inputs of each step: one read from a file, or between steps.
    """
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
    """Refuse a trajectory that another stepper made, or another version of this one."""
    own_manifest, run_manifest = stepper.manifest, trajectory.manifest
    named = ("name", "real", "system", "scheme")
    differences = [name for name in named
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
                    targets.multipliers[1:], targets.iterations[1:], targets.work)
    origin = None if trajectory._origin is None else replace(trajectory._origin, between=True)
    return trajectory.of_states(states, tangents=None, _inputs=None, _origin=origin)
