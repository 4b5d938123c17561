"""Zeros of many functions at once, each in its bracket: Chandrupatla's method, by columns.

T. R. Chandrupatla, A new hybrid quadratic/bisection algorithm for finding the zero of a nonlinear
function without using derivatives, Adv. Eng. Software 28 (1997) 145-149. It takes inverse quadratic
interpolation where that is safe, else halves the bracket: no more than some fifty evaluations, and
six or so where the function is smooth.

Where events happen: short real steps from the states before, many of them side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.event import Event
from ..integration.dense_output import epsilon_of_times, partial_steps
from ..integration.run_arguments import EnsembleArguments
from ..results.crossings import Crossings
from .detection import Brackets, EventDetector, Levels

if TYPE_CHECKING:
    from ..integration.lanes import EnsembleStates
    from ..steppers.stepper import Stepper

__all__ = ["crossings_of", "detectors_for", "ending", "zeros"]

Array = NDArray[Any]

#: Evaluations, where a value jumps or is noise: as many halvings tell any two numbers apart.
_MOST = 240


def zeros(
    evaluate: Callable[[Array, Array], Array], f0: Array, f1: Array, tolerance: Array,
    start: Array | None = None,
) -> None:
    """Find a zero of each function in [0, 1], where it has the values f0 and f1 of two signs.

    ``evaluate(x, which)`` returns the values of the functions numbered ``which`` at x, and keeps
    what it needs of them. The search begins at ``start``, by default the secant's zero. It ends
    where the last bracket of a function is at most twice its tolerance wide, or one of its values
    is 0; and, at a simple zero, where the secant through the last two places has its own within
    half of the tolerance: the secant before, a hundred times as long, had the same slope.
    """
    which = np.arange(len(f0))
    x1, x2 = 0 * tolerance, 0 * tolerance + 1
    y1, y2 = f0.copy(), f1.copy()
    least = tolerance.copy()
    share = _within(y1 / (y1 - y2) if start is None else x1 + start, least)
    move, slope = x2, f1 - f0
    for _ in range(_MOST):
        if not len(which):
            break
        x = x1 + share * (x2 - x1)
        y = evaluate(x, which)
        last, before = move, slope
        move = x - x1
        slope = (y - y1) / move
        found = ((abs(y) <= least / 2 * abs(slope)) & (100 * abs(move) <= abs(last))
                 & (10 * abs(slope - before) <= abs(before)))
        same = (y > 0) == (y1 > 0)
        x3, y3 = np.where(same, x1, x2), np.where(same, y1, y2)
        x2, y2 = np.where(same, x2, x1), np.where(same, y2, y1)
        x1, y1 = x, y
        width = abs(x2 - x1)
        open_ = (width > 2 * least) & (y1 != 0) & (y2 != 0) & ~found
        which, x1, x2, x3, y1, y2, y3, least, width, move, slope = (part[open_] for part in (
            which, x1, x2, x3, y1, y2, y3, least, width, move, slope))
        share = _within(_share(x1, x2, x3, y1, y2, y3), least / width)


def _cubic_zero(past: Array, f0: Array, f1: Array) -> Array:
    """Return a zero in (0, 1) of the cubic through f(−2), f(−1), f(0), f(1), else the secant's.

    ``past`` has f(−1) and f(−2), NaN where they are unknown.
    """
    before, d, after = past[:, 0], f0.astype(float), f1.astype(float)
    x = secant = d / (d - after)
    with np.errstate(all="ignore"):  # what is no zero is left out
        a = (after - past[:, 1]) / 6 - (d - before) / 2
        b = (after + before) / 2 - d
        c = after - d - a - b
        for _ in range(3):  # Newton's method
            x = x - (((a * x + b) * x + c) * x + d) / ((3 * a * x + 2 * b) * x + c)
        inside: Array = np.where((x > 0) & (x < 1), x, secant)
    return inside


def _share(x1: Array, x2: Array, x3: Array, y1: Array, y2: Array, y3: Array) -> Array:
    """Return how far to go from x1 to x2: by the quadratic through three points, or half."""
    flat = (y3 == y2) | (y3 == y1) | (x3 == x2)
    y3 = np.where(flat, y2 - (y1 - y2), y3)  # any number that divides: half is taken there
    x3 = np.where(flat, x2 - (x1 - x2), x3)
    xi, phi = (x1 - x2) / (x3 - x2), (y1 - y2) / (y3 - y2)
    safe = (phi * phi < xi) & ((1 - phi) * (1 - phi) < 1 - xi) & ~flat
    share = (y1 / (y2 - y1) * (y3 / (y2 - y3))
             + (x3 - x1) / (x2 - x1) * (y1 / (y3 - y1)) * (y2 / (y3 - y2)))
    half: Array = np.where(safe, share, 0 * share + 0.5)
    return half


def _within(share: Array, least: Array) -> Array:
    """Return a share of a bracket that comes no nearer to its ends than is worth it."""
    least = np.where(least < 0.5, least, 0 * least + 0.5)
    share = np.where(share > least, share, least)
    inside: Array = np.where(share < 1 - least, share, 1 - least)
    return inside


#: Steps that are solved for side by side.
_AT_ONCE = 2**15
#: Shares of a step after which it is looked on which side of its level a value is.
_SHARES = 2.0 ** (-5.0 * np.arange(1, 17))
#: Looks for the place where a value turns, at most: half a dozen are usual.
_LOOKS = 80


def crossings_of(
    stepper: Stepper, levels: Levels, runs: EnsembleArguments,
    brackets: Sequence[Brackets | None], fill: Callable[[EnsembleStates], None],
) -> list[dict[str, Crossings]]:
    """Return the crossings of each run by the events' names, from its brackets."""
    if runs.inputs is not None:  # they are held throughout, as parameters are
        each = [runs[i] for i in range(len(runs))]
        runs = replace(EnsembleArguments.of(each, stepper.binding.number_type), inputs=runs.inputs)
    seen = [(i, own) for i, own in enumerate(brackets) if own is not None]
    parts: list[_Roots] = []
    if seen:
        every = Brackets.together([own for _, own in seen])
        owner = np.repeat([i for i, _ in seen], [len(own) for _, own in seen])
        for i in range(0, len(every), _AT_ONCE):
            part = np.arange(i, min(i + _AT_ONCE, len(every)))
            work = _Work(stepper, levels, runs, every.of(part), owner[part], fill)
            parts += [_single(work), *([_twofold(work)] if work.brackets.turning.any() else ()),
                      *([_beside_level(work)] if work.brackets.on_level.any() else ())]
    return _by_run(stepper, levels, parts, runs)


def detectors_for(
    stepper: Stepper, levels: Levels | None, runs: EnsembleArguments
) -> list[EventDetector]:
    """Return the event detector of each run; none without events."""
    if levels is None:
        return []
    binding, found = stepper.binding, list[EventDetector]()
    for run in map(runs.__getitem__, range(len(runs))):
        parameters = binding.parameters(run.parameters, run.t0)
        found.append(EventDetector(levels, parameters, run.t0, run.dt))
    return found


def ending(events: tuple[Event, ...], found: dict[str, Crossings], dt: Any) -> str | None:
    """Return the name of the terminal event that happens first; None if none does."""
    ends = [one.name for one in events if one.terminal and len(found[one.name])]
    ahead = 1 if dt > 0 else -1
    return min(ends, key=lambda name: (found[name].steps[0], ahead * found[name].elapsed[0]),
               default=None)


@dataclass(frozen=True)
class _Work:
    """Brackets of runs, and steps of parts of Δt in them."""

    stepper: Stepper
    levels: Levels
    runs: EnsembleArguments
    brackets: Brackets
    owner: Array
    fill: Callable[[EnsembleStates], None]

    def t(self, which: Array) -> Array:
        """Return the times at the start of brackets."""
        runs, owner = self.runs, self.owner[which]
        times: Array = runs.t0[owner] + self.brackets.step[which] * runs.dt[owner]
        return times

    def tolerance(self, which: Array) -> Array:
        """Return what share of a step a time since the start cannot tell apart."""
        runs, owner = self.runs, self.owner[which]
        size = np.maximum(abs(self.brackets.step[which] * runs.dt[owner]), abs(runs.dt[owner]))
        share: Array = epsilon_of_times(self.stepper) * size / abs(runs.dt[owner])
        return share

    def states(
        self, share: Array, which: Array, end: tuple[Array, Array] | None = None
    ) -> tuple[Array, Array, Array, Array]:
        """Return times, states and the events' values after shares of a step in brackets.

        Times are those since the start of the step.

        The shares count from the start of the step, or from its ``end``, whose states are given.
        """
        owner, start = self.owner[which], self.brackets
        q, p = (start.q[which], start.p[which]) if end is None else end
        t, since = self.t(which), 0 * share
        dt = share * self.runs.dt[owner]
        columns = {name: column[owner] for name, column in self.runs.parameters.items()}
        held, step = self.runs.inputs, start.step[which]
        if end is not None:
            since = since + self.runs.dt[owner]
            t, step = t + since, step + (share > 0)
        inputs = None if held is None else held.taken(owner, step)
        q, p = partial_steps(self.stepper, q, p, t, dt, columns, self.fill, inputs)
        return since + dt, q, p, self._values(which, t + dt, q, p)

    def slopes(self, which: Array, ahead: int, end: tuple[Array, Array] | None = None) -> Array:
        """Return value over share just behind (−1: before) a state on the level; 0 where it rests.

        Of shares from 2⁻⁵ to 2⁻⁸⁰ the least three are taken over which the value falls as a power
        does, of the first order to the third: rounding does not.
        """
        none = 0 * self.tolerance(which)
        y = np.column_stack([self.states(none + ahead * share, which, end)[3]
                             for share in _SHARES]).astype(float)
        with np.errstate(all="ignore"):
            ratio = y[:, :-1] / y[:, 1:]
        falls = (ratio > 2**4) & (ratio < 2**16)
        steady = falls[:, :-1] & falls[:, 1:]
        last = steady.shape[1] - 1 - steady[:, ::-1].argmax(axis=1)
        slopes: Array = np.where(steady.any(axis=1),
                                 y[np.arange(len(y)), last] / _SHARES[last], 0)
        return slopes

    def _values(self, which: Array, t: Array, q: Array, p: Array) -> Array:
        """Return the value of each bracket's own event."""
        values, owner = np.empty_like(t), self.owner[which]
        order = np.argsort(owner, kind="stable")
        alike = all((column == column[0]).all() for column in self.runs.parameters.values())
        starts: Any = [] if alike else np.flatnonzero(np.diff(owner[order])) + 1
        for of in np.split(order, starts) if len(order) else ():
            run = self.runs[int(owner[of[0]])]
            parameters = self.stepper.binding.parameters(run.parameters, run.t0)
            rows = self.levels.values(parameters, t[of], q[of], p[of])
            values[of] = rows[np.arange(len(of)), self.brackets.event[which[of]]]
        return values


@dataclass(frozen=True)
class _Roots:
    """States at which events happen."""

    owner: Array
    event: Array
    step: Array
    #: As a share of the step, a double: what orders two of one step.
    place: Array
    #: Times since the start of the step.
    since: Array
    q: Array
    p: Array
    rising: Array


class _Best:
    """The state with the least value so far, of each root that is sought in a part of a step."""

    def __init__(
        self, work: _Work, which: Array, low: Array, high: Array, known: Array | None = None
    ) -> None:
        """``known`` has two columns: whether 0 and 1 are zeros, which are divided out."""
        self._work, self.which, self._low, self._width = work, which, low, high - low
        self._known = np.zeros((len(which), 2), bool) if known is None else known
        binding = work.stepper.binding
        self.since = 0 * work.t(which)
        self.q, self.p = (binding.new(len(which), binding.n) for _ in range(2))
        self._size = self.since - 1  # none yet

    def __call__(self, x: Array, roots: Array) -> Array:
        """Return the values at x from 0 to 1 within those parts."""
        share = self._low[roots] + x * self._width[roots]
        since, q, p, values = self._work.states(share, self.which[roots])
        at_start, at_end = self._known[roots].T
        values = values / np.where(at_start, share, 1) / np.where(at_end, 1 - share, 1)
        better = (self._size[roots] < 0) | (abs(values) < self._size[roots])
        at = roots[better]
        self.since[at], self.q[at], self.p[at] = since[better], q[better], p[better]
        self._size[at] = abs(values[better])
        return values

    def roots(self, rising: Array) -> _Roots:
        """Return them."""
        work, which = self._work, self.which
        owner = work.owner[which]
        place = (self.since / work.runs.dt[owner]).astype(float)
        return _Roots(owner, work.brackets.event[which], work.brackets.step[which], place,
                      self.since, self.q, self.p, rising)


def _single(work: _Work) -> _Roots:
    """Return the roots of steps between whose ends a value changes its sign."""
    brackets = work.brackets
    which = np.flatnonzero(~brackets.turning & ~brackets.on_level)
    best = _Best(work, which, *_whole(work, which))
    before, after = brackets.before[which], brackets.after[which]
    zeros(best, before, after, work.tolerance(which),
          _cubic_zero(brackets.past[which], before, after))
    return best.roots(before < 0)


def _beside_level(work: _Work) -> _Roots:
    """Return the roots of steps that begin or end on the level, or begin within rounding of it.

    The level at the start of a step is no root of it: the step before ends there, or the run begins
    there. At its end it is one if the value comes from one side and does not go back to it.
    """
    brackets = work.brackets
    which = np.flatnonzero(brackets.on_level)
    first, last = _whole(work, which)
    behind, before = (values[which].astype(float) for values in (brackets.before, brackets.after))
    known = np.column_stack([behind, before]) == 0
    starts, ends = map(np.flatnonzero, known.T)
    behind[starts] = work.slopes(which[starts], 1)
    since, q, p, _ = work.states(last[ends], which[ends])
    before[ends] = comes = work.slopes(which[ends], -1, (q, p))
    goes = work.slopes(which[ends], 1, (q, p))
    inside = np.flatnonzero(behind * before < 0)
    best = _Best(work, which[inside], first[inside], last[inside], known[inside])
    zeros(best, behind[inside], before[inside], work.tolerance(which[inside]))
    through = np.flatnonzero((comes != 0) & (comes * goes <= 0))
    own = which[ends[through]]
    at_end = _Roots(work.owner[own], brackets.event[own], brackets.step[own], np.ones(len(own)),
                    since[through], q[through], p[through], comes[through] < 0)
    roots = _together([best.roots(behind[inside] < 0), at_end])
    return _chosen(roots, _wanted(work, roots))


def _twofold(work: _Work) -> _Roots:
    """Return the roots of steps within which a value goes through its level and back."""
    turning = np.flatnonzero(work.brackets.turning)
    which, place, value = _turned(work, turning)
    first, last = _whole(work, which)
    twice = np.concatenate([which, which])
    low, high = np.concatenate([first, place]), np.concatenate([place, last])
    best = _Best(work, twice, low, high)
    before, after = work.brackets.before[which], work.brackets.after[which]
    zeros(best, np.concatenate([before, value]), np.concatenate([value, after]),
          work.tolerance(twice) / (high - low))
    rising = np.concatenate([before, value]) < 0
    roots = best.roots(rising)
    return _chosen(roots, _wanted(work, roots))


def _turned(work: _Work, which: Array) -> tuple[Array, Array, Array]:
    """Return the steps within which a value does change its sign, a place where it has, its value.

    Places are counted from the end of the step with the lower value: a value that falls there, and
    turns, is lower than it up to twice as far as it turns. They come nearer to that end, by the
    parabola through the last three, until one is lower; then parabolas lead to the lowest place,
    between two that are higher. A step is left where the value is four times as high as it could
    still fall, on the scale of how it moves within the step, or times cannot be told apart.
    """
    brackets = work.brackets
    # the value is that many times above its level: it falls towards it, whatever its sign
    side: Array = np.where(brackets.before[which] > 0, 1, -1)
    start, end = side * brackets.before[which], side * brackets.after[which]
    turned: Array = end < start
    x0, x2 = _whole(work, which)
    y0, y2 = _where(turned, (end, start), (start, end))
    x1: Array = (x0 + x2) / 2

    def value(x: Array) -> Array:
        values: Array = side * work.states(np.where(turned, 1 - x, x), which)[3]
        return values

    y1, least = value(x1), work.tolerance(which)
    moves: Array = abs(y1 - y0) + abs(y2 - y1)
    found: list[tuple[Array, Array, Array]] = []
    for look in range(_LOOKS):
        through = y1 < 0
        found.append((which[through], np.where(turned, 1 - x1, x1)[through],
                      (side * y1)[through]))
        inside: Array = y1 < y0
        left_of: Array = x1 - x0 > x2 - x1  # where the wider of the two parts is
        wide: Array = np.where(inside & ~left_of, x2 - x1, x1 - x0)
        left = ~through & (4 * moves * wide * wide >= np.where(inside, y1, y0)) & (wide > least)
        inside, left_of = inside[left], left_of[left]
        which, side, turned, moves, least, wide, x0, x1, x2, y0, y1, y2 = (
            part[left] for part in (which, side, turned, moves, least, wide, x0, x1, x2, y0, y1,
                                    y2))
        if not len(which):
            break
        bend = (y2 - y1) / (x2 - x1) - (y1 - y0) / (x1 - x0)
        bends = bend > 0
        x = (x0 + x1) / 2 - (y1 - y0) / (x1 - x0) * (x2 - x0) / (2 * np.where(bends, bend, 1))
        # a place at the lowest one says nothing new: one beside it, in the wider part, does
        new = bends & (x > x0) & (x < x2) & (abs(x - x1) > (wide / 8 if look % 2 else 0 * wide))
        x = np.where(new, x, x1 + np.where(left_of, -wide, wide) / 8)
        near = np.where(bends & (x > x1 / 8), np.where(x < x1 / 2, x, x1 / 2), x1 / 8)
        x = np.where(inside, x, near)
        y = value(x)
        # of four places the lowest stays in the middle of its neighbours; else the first three
        lower, left_of = np.where(inside, y < y1, True), x < x1
        x0, y0 = _where(inside & (lower != left_of), _where(lower, (x1, y1), (x, y)), (x0, y0))
        x2, y2 = _where(lower == left_of, _where(lower, (x1, y1), (x, y)), (x2, y2))
        x1, y1 = _where(lower, (x, y), (x1, y1))
    steps, places, values = (np.concatenate(column) for column in zip(*found, strict=True))
    return steps, places, values


def _where(condition: Array, a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
    return np.where(condition, a[0], b[0]), np.where(condition, a[1], b[1])


def _whole(work: _Work, which: Array) -> tuple[Array, Array]:
    """Return 0 and 1 for each bracket, in the type of times."""
    none = 0 * work.tolerance(which)
    return none, none + 1


def _wanted(work: _Work, roots: _Roots) -> Array:
    """Return whether roots have their events' directions, and are not the start of their run.

    A run from the state of an event starts within the rounding of times of its level: of that of
    t0, which the event had, as far as it is little of a step.
    """
    wanted = np.array([one.direction for one in work.levels.events])[roots.event]
    runs, owner = work.runs, roots.owner
    step = abs(runs.dt[owner])
    rounding = np.minimum(4 * epsilon_of_times(work.stepper) * np.maximum(
        abs(runs.t0[owner]), step), 2.0**-20 * step)
    starts = (roots.step == 0) & (abs(roots.since) <= rounding)
    right: Array = ((wanted == 0) | ((wanted > 0) == roots.rising)) & ~starts
    return right


def _together(parts: list[_Roots]) -> _Roots:
    return _Roots(*(np.concatenate([getattr(part, name) for part in parts])
                    for name in _Roots.__dataclass_fields__))


def _chosen(roots: _Roots, chosen: Array) -> _Roots:
    return _Roots(*(getattr(roots, name)[chosen] for name in _Roots.__dataclass_fields__))


def _by_run(
    stepper: Stepper, levels: Levels, parts: list[_Roots], runs: EnsembleArguments
) -> list[dict[str, Crossings]]:
    """Return the crossings of each run by the events' names, along the run."""
    roots = _together(parts) if parts else _none(stepper)
    found: list[dict[str, Crossings]] = [{} for _ in range(len(runs))]
    for number, event in enumerate(levels.events):
        own = _chosen(roots, roots.event == number)
        own = _chosen(own, np.lexsort((own.place, own.step, own.owner)))
        elapsed = own.step * runs.dt[own.owner] + own.since
        t = runs.t0[own.owner] + elapsed
        ends = np.searchsorted(own.owner, np.arange(len(runs) + 1))
        for crossings, start, end in zip(found, ends[:-1], ends[1:], strict=True):
            row = slice(start, end)
            crossings[event.name] = Crossings(t[row], own.q[row], own.p[row], own.step[row],
                                              own.rising[row], elapsed[row])
    return found


def _none(stepper: Stepper) -> _Roots:
    binding, count = stepper.binding, np.array([], int)
    return _Roots(count, count, count, np.array([]), np.array([], binding.number_type),
                  binding.new(0, binding.n), binding.new(0, binding.n), count.astype(bool))
