"""Location of events: their roots, by short real steps from the states before, side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core.arrays import Array
from ...core.event import Event, Impact
from ...core.records import dataclass
from ..bindings.run_memory import Rows
from ..integration.dense_output import epsilon_of_times, partial_steps
from ..integration.run_arguments import EnsembleArguments
from ..results.crossings import Crossings
from .detection import Brackets, EventDetector, Levels
from .zeros import cubic_zero, zeros

if TYPE_CHECKING:
    from ..integration.lanes import EnsembleStates
    from ..steppers.stepper import Stepper

__all__ = ["TerminalEvent", "crossings_of", "detectors_for", "first_terminal_event"]

#: Steps that are solved for side by side.
_AT_ONCE = 2**15
#: Shares of a step, beside a state on the level, at which the sign of a value is evaluated.
_SHARES = 2.0 ** (-5.0 * np.arange(1, 17))
#: Places examined where a value turns, at most: half a dozen are usual.
_MOST_PLACES = 80


def crossings_of(
    stepper: Stepper, levels: Levels, runs: EnsembleArguments,
    brackets: Sequence[Brackets | None], fill: Callable[[EnsembleStates], None],
) -> list[dict[str, Crossings]]:
    """Return the crossings of each run, event's name → crossings, from its brackets.

    ``brackets`` has an entry for each run, None without events. ``fill`` integrates an ensemble in
    place; here it takes partial steps.
    """
    if runs.inputs is not None:  # inputs that never change are columns of parameters
        run_arguments = [runs[i] for i in range(len(runs))]
        runs = replace(EnsembleArguments.of(run_arguments, stepper.binding.number_type),
                       inputs=runs.inputs)
    runs_with_brackets = [(i, run_brackets) for i, run_brackets in enumerate(brackets)
                          if run_brackets is not None]
    roots: list[_Roots] = []
    if runs_with_brackets:
        all_brackets = Brackets.together([run_brackets for _, run_brackets in runs_with_brackets])
        # the run of each bracket
        owner = np.repeat([i for i, _ in runs_with_brackets],
                          [len(run_brackets) for _, run_brackets in runs_with_brackets])
        # brackets of all runs are solved side by side on lanes; blocks bound the memory
        for i in range(0, len(all_brackets), _AT_ONCE):
            indices = np.arange(i, min(i + _AT_ONCE, len(all_brackets)))
            work = _Work(stepper, levels, runs, all_brackets.of(indices), owner[indices], fill)
            roots.append(_simple_roots(work))
            if work.brackets.turning.any():
                roots.append(_double_roots(work))
            if work.brackets.on_level.any():
                roots.append(_level_roots(work))
    return _by_run(stepper, levels, roots, runs)


def detectors_for(
    stepper: Stepper, levels: Levels | None, runs: EnsembleArguments
) -> list[EventDetector]:
    """Return the event detector of each run; none without events."""
    if levels is None:
        return []
    binding, detectors = stepper.binding, list[EventDetector]()
    for run in map(runs.__getitem__, range(len(runs))):
        parameters = binding.parameters(run.parameters, run.t0)
        detectors.append(EventDetector(levels, parameters, run.t0, run.dt))
    return detectors


def first_terminal_event(
    events: Sequence[Event | Impact], crossings: dict[str, Crossings], dt: Any
) -> str | None:
    """Return the name of the terminal event that happens first; None if none of them happens."""
    terminal_names = [event.name for event in events
                      if event.terminal and len(crossings[event.name])]
    ahead = 1 if dt > 0 else -1
    return min(terminal_names,
               key=lambda name: (crossings[name].steps[0], ahead * crossings[name].elapsed[0]),
               default=None)


@dataclass(frozen=True)
class TerminalEvent:
    """The end of a run by an event: the event's index, its crossing, the row of the partial step.
    """

    event: int
    at: Crossings
    row: Rows


class _PartialSteps(NamedTuple):
    """States within steps, and the values of their events."""

    time_in_step: Array  # from the start of the step, shape (states,)
    q: Array  # shape (states, n)
    p: Array
    height: Array  # x − level, shape (states,)


@dataclass(frozen=True)
class _Work:
    """Brackets of runs, and partial steps in them; bracket i is of the run ``owner[i]``."""

    stepper: Stepper
    levels: Levels
    runs: EnsembleArguments
    brackets: Brackets
    owner: Array
    fill: Callable[[EnsembleStates], None]

    def t(self, indices: Array) -> Array:
        """Return the times at the start of brackets."""
        runs, owner = self.runs, self.owner[indices]
        times: Array = runs.t0[owner] + self.brackets.step[indices] * runs.dt[owner]
        return times

    def tolerance(self, indices: Array) -> Array:
        """Return the resolution of times since the start, as a share of a step, one per bracket."""
        runs, owner = self.runs, self.owner[indices]
        size = np.maximum(abs(self.brackets.step[indices] * runs.dt[owner]), abs(runs.dt[owner]))
        share: Array = epsilon_of_times(self.stepper) * size / abs(runs.dt[owner])
        return share

    def states(
        self, share: Array, indices: Array, end: tuple[Array, Array] | None = None
    ) -> _PartialSteps:
        """Return the states after partial steps share · Δt in the brackets ``indices``.

        ``share`` and ``indices`` have an entry for each state. Shares count from the start of the
        step, or from its end if ``end`` has the states (q, p) there.
        """
        owner, brackets = self.owner[indices], self.brackets
        q, p = (brackets.q[indices], brackets.p[indices]) if end is None else end
        t, time_in_step = self.t(indices), 0 * share
        dt = share * self.runs.dt[owner]
        columns = {name: column[owner] for name, column in self.runs.parameters.items()}
        inputs_of_runs, step = self.runs.inputs, brackets.step[indices]
        if end is not None:
            time_in_step = time_in_step + self.runs.dt[owner]
            # a positive share leads into the next step, with its inputs
            t, step = t + time_in_step, step + (share > 0)
        inputs = None if inputs_of_runs is None else inputs_of_runs.rows_of(owner, step)
        q, p = partial_steps(self.stepper, q, p, t, dt, columns, self.fill, inputs)
        return _PartialSteps(time_in_step + dt, q, p, self._values(indices, t + dt, q, p))

    def slopes(self, indices: Array, ahead: int, end: tuple[Array, Array] | None = None) -> Array:
        """Return the limit of (x − level)/share beside a state on the level; 0 where x rests there.

        A slope for each of the ``indices`` of brackets; ``end`` has the states (q, p) on the level,
        shapes (indices, n), by default those at the starts of the steps. ``ahead`` is 1 just after
        the state, −1 just before it. The limit is an estimate: of shares from 2⁻⁵ to 2⁻⁸⁰ the
        smallest three are taken over which the value falls like a power of the share, of order 1 to
        3. Round-off does not fall.
        """
        no_time = 0 * self.tolerance(indices)
        event_values = np.column_stack([self.states(no_time + ahead * share, indices, end).height
                                        for share in _SHARES]).astype(float)
        with np.errstate(all="ignore"):
            ratio = event_values[:, :-1] / event_values[:, 1:]
        # shares fall by 2⁻⁵: a value of order k in the share falls by 2⁻⁵ᵏ, k = 1 to 3; at
        # round-off it does not
        falls = (ratio > 2**4) & (ratio < 2**16)
        steady = falls[:, :-1] & falls[:, 1:]
        # the last column that is steady, for shares fall from column to column
        smallest_share = steady.shape[1] - 1 - steady[:, ::-1].argmax(axis=1)
        slopes: Array = np.where(steady.any(axis=1),
                                 event_values[np.arange(len(event_values)), smallest_share]
                                 / _SHARES[smallest_share], 0)
        return slopes

    def _values(self, indices: Array, t: Array, q: Array, p: Array) -> Array:
        """Return x − level of the event of each bracket.

        The entries of t and the rows of q and p, shape (brackets, n), are its time and state.
        """
        event_values, owner = np.empty_like(t), self.owner[indices]
        # one call of C for all brackets of a run, or of all runs if their parameters are the same
        order = np.argsort(owner, kind="stable")
        has_equal_runs = all((column == column[0]).all()
                             for column in self.runs.parameters.values())
        starts: Any = [] if has_equal_runs else np.flatnonzero(np.diff(owner[order])) + 1
        for group in np.split(order, starts) if len(order) else ():
            run = self.runs[int(owner[group[0]])]
            parameters = self.stepper.binding.parameters(run.parameters, run.t0)
            differences = self.levels.differences(parameters, t[group], q[group], p[group])
            event_values[group] = differences[np.arange(len(group)),
                                              self.brackets.event[indices[group]]]
        return event_values


@dataclass(frozen=True)
class _Roots:
    """States at which events happen: index of the run, of the event, whole steps before, state."""

    owner: Array
    event: Array
    step: Array
    #: Share of the step, a double, by which two roots of one step are ordered.
    place: Array
    #: Time since the start of the step.
    time_in_step: Array
    q: Array
    p: Array
    rising: Array


class _BestStates:
    """The state with the least |value − level| so far for each root, sought in a part of a step.

    The part goes from the share ``low`` to the share ``high`` of the step. Called as a function of
    x in [0, 1] along that part, it takes the partial steps there.
    """

    def __init__(
        self, work: _Work, indices: Array, low: Array, high: Array, known_zeros: Array | None = None
    ) -> None:
        """Begin without any state.

        ``known_zeros``, (roots, 2), says whether x = 0 and x = 1 are zeros, to be divided out.
        """
        self._work, self.indices, self._low, self._width = work, indices, low, high - low
        self._known = np.zeros((len(indices), 2), bool) if known_zeros is None else known_zeros
        binding = work.stepper.binding
        self.time_in_step = 0 * work.t(indices)
        self.q, self.p = (binding.new(len(indices), binding.n) for _ in range(2))
        self._size = self.time_in_step - 1  # |value − level| of the best state; below 0: none yet

    def __call__(self, x: Array, roots: Array) -> Array:
        """Return (value − level)/(known zeros) after partial steps to the places ``x`` in brackets.

        ``x`` is 0 at the start of a bracket and 1 at its end; ``roots`` are the indices of the
        brackets, of the same shape (roots,). The best states so far are kept.
        """
        share = self._low[roots] + x * self._width[roots]
        time_in_step, q, p, event_values = self._work.states(share, self.indices[roots])
        at_start, at_end = self._known[roots].T
        # a known zero at 0 or 1 is divided out: what remains changes its sign at the other zero
        # only
        event_values = event_values / np.where(at_start, share, 1) / np.where(at_end, 1 - share, 1)
        is_better = (self._size[roots] < 0) | (abs(event_values) < self._size[roots])
        improved = roots[is_better]
        self.time_in_step[improved] = time_in_step[is_better]
        self.q[improved], self.p[improved] = q[is_better], p[is_better]
        self._size[improved] = abs(event_values[is_better])
        return event_values

    def roots(self, rising: Array) -> _Roots:
        """Return the best states as roots; ``rising`` says whether the value grows there."""
        work, indices = self._work, self.indices
        owner = work.owner[indices]
        fraction = (self.time_in_step / work.runs.dt[owner]).astype(float)
        return _Roots(
            owner, event=work.brackets.event[indices], step=work.brackets.step[indices],
            place=fraction, time_in_step=self.time_in_step, q=self.q, p=self.p, rising=rising)


def _roots_between(
    work: _Work, indices: Array, low: Array, high: Array, f_low: Array, f_high: Array, *,
    known_zeros: Array | None = None, start: Array | None = None,
) -> _Roots:
    """Return one root of each bracket between the shares ``low`` and ``high`` of its step.

    The values f_low and f_high of the event there have two signs. ``known_zeros`` as of
    ``_BestStates``, ``start`` as of ``zeros``; all arrays have an entry for each root.
    """
    best_states = _BestStates(work, indices, low, high, known_zeros)
    # the search returns nothing: ``best_states`` keeps the nearest state of each root
    zeros(best_states, f_low, f_high, work.tolerance(indices) / (high - low), start)
    return best_states.roots(rising=f_low < 0)


def _simple_roots(work: _Work) -> _Roots:
    """Return the roots of steps at whose ends the value has two signs, neither of them 0."""
    brackets = work.brackets
    indices = np.flatnonzero(~brackets.turning & ~brackets.on_level)
    # sought in the whole step, from its share 0 to 1
    before, after = brackets.before[indices], brackets.after[indices]
    return _roots_between(work, indices, *_zero_and_one(work, indices), before, after,
                          start=cubic_zero(brackets.past[indices], before, after))


def _level_roots(work: _Work) -> _Roots:
    """Return the roots of steps that begin or end on the level, or begin within rounding of it.

    The start of a step on the level is no root of the step: the step before ends there, or the run
    begins there. Its end is a root if the value comes from one side and does not go back to it.
    """
    brackets = work.brackets
    indices = np.flatnonzero(brackets.on_level)
    start_share, end_share = _zero_and_one(work, indices)
    # the values at the ends; where these are 0, zeros that ``_BestStates`` divides out, the slopes
    # take their place below
    start_slope, end_slope = (ends_of_step[indices].astype(float)
                              for ends_of_step in (brackets.before, brackets.after))
    on_level = np.column_stack([start_slope, end_slope]) == 0
    starts, ends = map(np.flatnonzero, on_level.T)
    # a value of 0 has no sign: at the start of the step the sign just after it is taken, at the end
    # the sign just before it
    start_slope[starts] = work.slopes(indices[starts], ahead=1)
    time_in_step, q, p, _ = work.states(end_share[ends], indices[ends])
    end_slope[ends] = slope_before = work.slopes(indices[ends], ahead=-1, end=(q, p))
    slope_after = work.slopes(indices[ends], ahead=1, end=(q, p))
    # one more root between the ends, if the value changes its sign there
    inside = np.flatnonzero(start_slope * end_slope < 0)
    within_steps = _roots_between(
        work, indices[inside], start_share[inside], end_share[inside], start_slope[inside],
        end_slope[inside], known_zeros=on_level[inside])
    # the end of a step is a root if the value arrives and does not turn back: then it only touches
    # its level
    crossing_ends = np.flatnonzero((slope_before != 0) & (slope_before * slope_after <= 0))
    indices_through = indices[ends[crossing_ends]]
    at_ends = _Roots(
        work.owner[indices_through], event=brackets.event[indices_through],
        step=brackets.step[indices_through], place=np.ones(len(indices_through)),
        time_in_step=time_in_step[crossing_ends], q=q[crossing_ends], p=p[crossing_ends],
        rising=slope_before[crossing_ends] < 0)
    roots = _join([within_steps, at_ends])
    return _select(roots, _is_accepted(work, roots))


def _double_roots(work: _Work) -> _Roots:
    """Return the roots of steps within which a value goes through its level and back."""
    turning = np.flatnonzero(work.brackets.turning)
    indices, inner_share, inner_value = _sign_changes(work, turning)
    start_share, end_share = _zero_and_one(work, indices)
    # the place of other sign divides the step into two parts, each with one simple root
    part_indices = np.concatenate([indices, indices])
    low, high = np.concatenate([start_share, inner_share]), np.concatenate([inner_share, end_share])
    before, after = work.brackets.before[indices], work.brackets.after[indices]
    roots = _roots_between(work, part_indices, low, high, np.concatenate([before, inner_value]),
                           np.concatenate([inner_value, after]))
    return _select(roots, _is_accepted(work, roots))


class _SignChanges(NamedTuple):
    """Places within steps where x − level has the other sign than at both ends; one each."""

    indices: Array  # of the brackets
    share: Array  # place as a share of the step, from its start
    height: Array  # x − level there


def _sign_changes(work: _Work, indices: Array) -> _SignChanges:
    """Return a place beyond the level in each turning step that has one.

    ``indices`` are of brackets: at both ends the value x of an event has one sign, and it may turn
    between them; ``_TurningSearch`` looks for its extremum in each.
    """
    search = _TurningSearch.at_start(work, indices)
    sign_changes: list[_SignChanges] = []
    for iteration in range(_MOST_PLACES):
        sign_changes.append(search.below_level())
        search = search.subset(search.is_open)
        if not len(search.indices):
            break
        # places by parabolas alone may creep, each close to the last: every other one keeps away
        search = search.with_next_place(away=iteration % 2 == 1)
    return _SignChanges(*map(np.concatenate, zip(*sign_changes, strict=True)))


@dataclass(frozen=True)
class _TurningSearch:
    """Search, in many steps at once, for a place x where a height y = ±(value − level) is below 0.

    The height is positive at both ends of a step. x counts from its lower end: a height that falls
    there and turns is lower than this end up to twice the distance of its minimum. Points approach
    this end by the parabola through the last three until one is lower; then parabolas lead to the
    minimum between two higher points.

    Attributes
    ----------
    side : array of ±1
        y = side · (value − level).
    is_reversed : array of bool
        Whether x counts from the end of the step backwards.
    total_change : array
        |y₁ − y₀| + |y₂ − y₁| of the ends and the middle of the step.
    tolerance : array
        The resolution of times as a share of the step.
    x, y : tuple of 3 array
        Places x₀ < x₁ < x₂ and their heights; y₁ is the lowest, or x₁ the nearest to the lower end.
    """

    work: _Work
    indices: Array
    side: Array
    is_reversed: Array
    total_change: Array
    tolerance: Array
    x: tuple[Array, Array, Array]
    y: tuple[Array, Array, Array]

    @classmethod
    def at_start(cls, work: _Work, indices: Array) -> _TurningSearch:
        """Return the search with the ends and the middle of each step."""
        brackets = work.brackets
        side: Array = np.where(brackets.before[indices] > 0, 1, -1)
        start, end = side * brackets.before[indices], side * brackets.after[indices]
        is_reversed: Array = end < start
        x0, x2 = _zero_and_one(work, indices)
        y0, y2 = _where(is_reversed, (end, start), (start, end))
        x1: Array = (x0 + x2) / 2
        # y₁ and the total change are evaluated by the search itself
        search = cls(work, indices, side, is_reversed, total_change=0 * y0,
                     tolerance=work.tolerance(indices), x=(x0, x1, x2), y=(y0, 0 * y0, y2))
        y1 = search._heights(x1)
        return replace(search, y=(y0, y1, y2), total_change=abs(y1 - y0) + abs(y2 - y1))

    def below_level(self) -> _SignChanges:
        """Return the middle places of the steps in which y < 0 there."""
        x1, y1 = self.x[1], self.y[1]
        is_below = y1 < 0
        return _SignChanges(self.indices[is_below], self._shares(x1)[is_below],
                            (self.side * y1)[is_below])

    @property
    def is_open(self) -> Array:
        """Which steps are searched on.

        A step is abandoned if times are not resolved, or if its lowest height is above 4 C w², with
        the change C of the height over the step and the share w of the wider of the two parts: a
        parabola that has its least value within w falls by less from there.
        """
        wider_part = self._wider_part
        possible_fall = 4 * self.total_change * wider_part * wider_part
        may_fall_below = possible_fall >= np.where(self._is_inside, self.y[1], self.y[0])
        is_open: Array = ~(self.y[1] < 0) & may_fall_below & (wider_part > self.tolerance)
        return is_open

    def subset(self, mask: Array) -> _TurningSearch:
        """Return the search in the steps of a mask."""
        x0, x1, x2 = (column[mask] for column in self.x)
        y0, y1, y2 = (column[mask] for column in self.y)
        return _TurningSearch(self.work, self.indices[mask], side=self.side[mask],
                              is_reversed=self.is_reversed[mask],
                              total_change=self.total_change[mask],
                              tolerance=self.tolerance[mask], x=(x0, x1, x2), y=(y0, y1, y2))

    def with_next_place(self, *, away: bool) -> _TurningSearch:
        """Return the search with one more place in each step, and one of the four dropped.

        ``away`` asks for a place at least an eighth of the wider part from x₁.
        """
        (x0, x1, x2), (y0, y1, y2) = self.x, self.y
        is_inside, wider_part = self._is_inside, self._wider_part
        to_wider_end = np.where(self._is_left_wider, -wider_part, wider_part)
        x = _next_place(self.x, self.y, is_inside, to_wider_end,
                        wider_part / 8 if away else 0 * wider_part)
        y = self._heights(x)
        # of four places the lowest stays in the middle of its neighbours; without a lowest one
        # inside, the three nearest to the lower end stay
        is_lower, is_left = np.where(is_inside, y < y1, True), x < x1
        neighbour = _where(is_lower, (x1, y1), (x, y))
        x0, y0 = _where(is_inside & (is_lower != is_left), neighbour, (x0, y0))
        x2, y2 = _where(is_lower == is_left, neighbour, (x2, y2))
        x1, y1 = _where(is_lower, (x, y), (x1, y1))
        return replace(self, x=(x0, x1, x2), y=(y0, y1, y2))

    @property
    def _is_inside(self) -> Array:
        """Whether the lowest place is between two others."""
        is_inside: Array = self.y[1] < self.y[0]
        return is_inside

    @property
    def _is_left_wider(self) -> Array:
        """Whether x₁ − x₀ is more than x₂ − x₁."""
        x0, x1, x2 = self.x
        is_left_wider: Array = x1 - x0 > x2 - x1
        return is_left_wider

    @property
    def _wider_part(self) -> Array:
        """Length of the part to search: the wider one about a lowest place, else x₁ − x₀."""
        x0, x1, x2 = self.x
        wider_part: Array = np.where(self._is_inside & ~self._is_left_wider, x2 - x1, x1 - x0)
        return wider_part

    def _shares(self, x: Array) -> Array:
        """Return places as shares of the steps, counted from their starts."""
        shares: Array = np.where(self.is_reversed, 1 - x, x)
        return shares

    def _heights(self, x: Array) -> Array:
        """Return y after partial steps to the places x."""
        heights: Array = self.side * self.work.states(self._shares(x), self.indices).height
        return heights


def _next_place(
    x: tuple[Array, Array, Array], y: tuple[Array, Array, Array], inside: Array,
    to_wider_end: Array, least_distance: Array,
) -> Array:
    """Return the place that each search for a minimum examines next, from x₀ < x₁ < x₂.

    ``to_wider_end`` leads from x₁ to the end of the wider part. The parabola through the three
    points, with the ``slope`` d and the ``bend`` b, has its minimum, if b > 0, at

        x = (x₀ + x₁)/2 − d (x₂ − x₀)/(2b),  d = (y₁ − y₀)/(x₁ − x₀),  b = (y₂ − y₁)/(x₂ − x₁) − d

    It is taken where y₁ is the lowest (``inside``), unless it lies within ``least_distance`` of x₁:
    then a place beside x₁ is. Where y₁ is not the lowest, the place is between 0 and x₁.
    """
    (x0, x1, x2), (y0, y1, y2) = x, y
    slope = (y1 - y0) / (x1 - x0)
    bend = (y2 - y1) / (x2 - x1) - slope
    is_convex = bend > 0
    lowest: Array = (x0 + x1) / 2 - slope * (x2 - x0) / (2 * np.where(is_convex, bend, 1))
    # a place at x₁ says nothing new: one beside it, in the wider part, does
    is_useful = is_convex & (lowest > x0) & (lowest < x2) & (abs(lowest - x1) > least_distance)
    lowest = np.where(is_useful, lowest, x1 + to_wider_end / 8)
    # still falling towards x = 0: no nearer to it than an eighth of the last point at a time
    towards_start = np.where(is_convex & (lowest > x1 / 8),
                             np.where(lowest < x1 / 2, lowest, x1 / 2), x1 / 8)
    next_place: Array = np.where(inside, lowest, towards_start)
    return next_place


def _where(condition: Array, a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the points (x, y) of a where the condition holds, else of b."""
    (x_a, y_a), (x_b, y_b) = a, b
    return np.where(condition, x_a, x_b), np.where(condition, y_a, y_b)


def _zero_and_one(work: _Work, indices: Array) -> tuple[Array, Array]:
    """Return 0 and 1 for each bracket, in the type of times."""
    zero = 0 * work.tolerance(indices)
    return zero, zero + 1


def _is_accepted(work: _Work, roots: _Roots) -> Array:
    """Return which roots have the directions of their events and are not the start of the run.

    A run that starts from an event is at its level within the rounding of times, that of t0 if it
    is a small share of a step: this root belongs to the run before.
    """
    directions = np.array([event.direction for event in work.levels.events])[roots.event]
    runs, owner = work.runs, roots.owner
    step = abs(runs.dt[owner])
    rounding = np.minimum(4 * epsilon_of_times(work.stepper) * np.maximum(
        abs(runs.t0[owner]), step), 2.0**-20 * step)
    starts = (roots.step == 0) & (abs(roots.time_in_step) <= rounding)
    accepted: Array = ((directions == 0) | ((directions > 0) == roots.rising)) & ~starts
    return accepted


def _join(groups: list[_Roots]) -> _Roots:
    """Return the roots of all groups, in their order."""
    return _Roots(*(np.concatenate([getattr(group, name) for group in groups])
                    for name in _Roots.__dataclass_fields__))


def _select(roots: _Roots, mask: Array) -> _Roots:
    """Return the roots of a mask, or of indices in their order."""
    return _Roots(*(getattr(roots, name)[mask] for name in _Roots.__dataclass_fields__))


def _by_run(
    stepper: Stepper, levels: Levels, root_groups: list[_Roots], runs: EnsembleArguments
) -> list[dict[str, Crossings]]:
    """Return the crossings of each run, event's name → crossings in the order of the run."""
    roots = _join(root_groups) if root_groups else _no_roots(stepper)
    crossings_of_runs: list[dict[str, Crossings]] = [{} for _ in range(len(runs))]
    for event_index, event in enumerate(levels.events):
        event_roots = _select(roots, roots.event == event_index)
        # along each run: by owner, then step, then place in the step
        order = np.lexsort((event_roots.place, event_roots.step, event_roots.owner))
        event_roots = _select(event_roots, order)
        if stepper.binding.clocked and levels.columns[event_index] == ("q", stepper.binding.n - 1):
            # roots of the time itself: the requested time, to the last bit
            event_roots.q[:, -1] = levels.levels_in_c[event_index]
        elapsed = event_roots.step * runs.dt[event_roots.owner] + event_roots.time_in_step
        t = runs.t0[event_roots.owner] + elapsed
        bounds = np.searchsorted(event_roots.owner, np.arange(len(runs) + 1))
        for crossings, start, end in zip(crossings_of_runs, bounds[:-1], bounds[1:], strict=True):
            row = slice(start, end)
            crossings[event.name] = Crossings(
                t[row], event_roots.q[row], event_roots.p[row], steps=event_roots.step[row],
                rising=event_roots.rising[row], elapsed=elapsed[row])
    return crossings_of_runs


def _no_roots(stepper: Stepper) -> _Roots:
    """Return empty arrays of the types that roots have."""
    binding, no_index = stepper.binding, np.array([], int)
    no_states = binding.new(0, binding.n)
    return _Roots(owner=no_index, event=no_index, step=no_index, place=np.array([]),
                  time_in_step=np.array([], binding.number_type), q=no_states, p=no_states,
                  rising=no_index.astype(bool))
