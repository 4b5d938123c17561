"""The states of a run, looked at step by step: where an event's value changes its sign.

Compiled code steps, a piece of the run at a time, evaluates the quantities and says between which
states one of them comes no further from its level than it moves in a step or two; only these are
looked at here. What is kept of them are the brackets, steps between whose ends a value has two
signs. A value that comes near its level and turns may cross it twice within one step: where a state
is nearer to the level than both its neighbours, the steps on its two sides are kept as ones to look
into. A sine of θ rad a step is seen so for θ < π, and passes the bound of the compiled code, that
its nearest state is no further off than it moves on both sides, where 1 − c ≤ 4c(1 − c²) with
c = cos(θ/2): up to θ = 2.72. What turns more often than that between two states cannot be seen.
A step that begins or ends exactly on the level is kept too: its two ends do not say on which side
the value was in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.event import Event
from ...core.manifest import Manifest
from ..bindings.array_checks import as_real
from ..bindings.binding import Binding
from ..bindings.run_memory import ParameterStruct, Rows

__all__ = ["TAIL", "Brackets", "EventDetector", "Levels", "Memory"]

Array = NDArray[Any]

#: States that are kept from piece to piece: a step is looked into with a neighbour on either side.
TAIL = 3
#: A run starts on a level, perhaps, if its value is that share of its first change from it.
_AT_START = 2.0**-40


@dataclass(frozen=True)
class Levels:
    """The values of events, less their levels, of rows of states."""

    binding: Binding
    events: tuple[Event, ...]
    #: For each event "q", "p" or, of quantities, "", and which column of these.
    columns: tuple[tuple[str, int], ...]
    levels: Array
    #: The columns as C counts them, q, p and quantities in a row, and the levels in its type.
    numbered: Array
    rounded: Array

    @classmethod
    def of(cls, binding: Binding, manifest: Manifest, events: tuple[Event, ...]) -> Levels:
        """Return them for the events of a stepper's runs."""
        system = manifest.system
        places = {name: ("p", i) for i, name in enumerate(system.momenta)}
        places |= {name: ("q", i) for i, name in enumerate(system.coordinates)}
        places |= {name: ("", i) for i, name in enumerate(system.quantities)}
        columns = tuple(places[one.quantity] for one in events)
        first = {"q": 0, "p": binding.n, "": 2 * binding.n}
        levels = np.array([as_real("level", one.level, binding.number) for one in events],
                          binding.number_type)
        return cls(binding, events, columns, levels,
                   np.array([column + first[of] for of, column in columns], np.intc),
                   levels.astype(binding.dtype))

    def values(self, parameters: ParameterStruct, t: Array | None, q: Array, p: Array) -> Array:
        """Return the values of rows of states, a column an event; with times where ``timed``."""
        quantities = (self.binding.quantities(parameters, self._times(t), q, p)
                      if self._of_quantities else q)
        parts = {"": quantities, "q": q, "p": p}
        found = np.empty((len(q), len(self.events)), self.binding.number_type)
        for i, (of, column) in enumerate(self.columns):
            found[:, i] = parts[of][:, column]
        values: Array = found - self.levels
        return values

    def near(
        self, parameters: ParameterStruct, t: Array | None, q: Array, p: Array, last: Array
    ) -> tuple[int, int] | None:
        """Return the first and the last of rows of states behind one that is near its level.

        None where none is. ``last`` is what was before, of ``no_past`` at first.
        """
        return self.binding.near(parameters, self._times(t), q, p, self.numbered, self.rounded,
                                 last)

    @property
    def no_past(self) -> Array:
        """What ``near`` knows of the states before the first."""
        return self.binding.converted(np.full(2 * len(self.events), np.nan))

    @property
    def timed(self) -> bool:
        """Whether the values depend on the times of the states."""
        return self._of_quantities and self.binding.quantities_take_time

    @property
    def _of_quantities(self) -> bool:
        return any(of == "" for of, _ in self.columns)

    def _times(self, t: Array | None) -> Array:
        """Return times in the stepper's type, where they matter."""
        return self.levels if t is None else t.astype(self.binding.dtype)


@dataclass
class Brackets:
    """Steps of a run in which an event happens, or (``turning``) might happen twice."""

    event: Array
    #: Steps before it, and the state and the value there; the value at the end of the step.
    step: Array
    q: Array
    p: Array
    before: Array
    after: Array
    turning: Array
    #: Whether the step begins or ends on the level, or the run begins within rounding of it.
    on_level: Array
    #: The values one and two steps before, in doubles, shape (brackets, 2); NaN before the run.
    past: Array

    def __len__(self) -> int:
        return len(self.event)

    @classmethod
    def together(cls, parts: Sequence[Brackets]) -> Brackets:
        """Return all of them, in order."""
        names = ("event", "step", "q", "p", "before", "after", "turning", "on_level",
                 "past")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def of(self, chosen: Array) -> Brackets:
        """Return some of them."""
        return Brackets(self.event[chosen], self.step[chosen], self.q[chosen], self.p[chosen],
                        self.before[chosen], self.after[chosen], self.turning[chosen],
                        self.on_level[chosen], self.past[chosen])


def _turning(
    values: Array, start: int, end: int, *, begins: bool, ends: bool
) -> tuple[Array, Array]:
    """Return the steps from row ``start`` up to ``end`` in which a value may touch 0, and which.

    Of the states about a place where a smooth value turns, the one with the least |value| has
    larger ones on both sides: the step before it and the step behind it are returned, unless the
    value is further from 0 than it moves in both. ``begins`` and ``ends`` say whether the first
    and the last row are the run's, which then lack a neighbour, and are looked at in any case.
    """
    size, sides = abs(values), np.sign(values.astype(float))
    least = np.zeros(values.shape, bool)
    before, now, behind = size[:-2], size[1:-1], size[2:]
    least[1:-1] = ((now < before) & (now <= behind) & (now <= before - now + (behind - now))
                   & (sides[:-2] == sides[1:-1]) & (sides[1:-1] == sides[2:]))
    if len(values) > 1:
        least[0] = begins & (size[0] <= size[1])
        least[-1] = ends & (size[-1] < size[-2])
    one_side = (sides[:-1] == sides[1:]) & (sides[1:] != 0)
    row, event = np.nonzero(((least[:-1] | least[1:]) & one_side)[start:end])
    return row + start, event


@dataclass(frozen=True)
class Memory:
    """What a watch needs of the past to go on: the last states, up to ``TAIL``, and of each event
    whether its turning in the last step is noted."""

    q: Array
    p: Array
    closed: Array


class EventDetector:
    """Detects the events of one run, piece by piece; the result does not depend on the pieces."""

    def __init__(self, levels: Levels, parameters: ParameterStruct, t0: Any, dt: Any) -> None:
        self._levels, self._parameters, self._t0, self._dt = levels, parameters, t0, dt
        self._tail: tuple[Array, Array] | None = None
        self._done = 0
        #: What the values were at the last two states, and whether these may be near their levels.
        self._last = levels.no_past
        self._near = False
        self._parts: list[Brackets] = []
        #: Whose turning in the last step is noted already, though a neighbour may still come.
        self._closed = np.zeros(len(levels.events), bool)
        #: The step within which a terminal event happens; None as long as there is none.
        self.ends_in: int | None = None
        self._room: Rows | None = None
        #: How many of the parts have none of terminal events any more.
        self._split = 0
        self.terminal = any(one.terminal for one in levels.events)
        self._wanted = np.array([one.direction for one in levels.events])
        self._ending = np.array([one.terminal for one in levels.events])

    def room(self, steps: int) -> Rows:
        """Return rows for the states of so many steps that are not stored."""
        if self._room is None or len(self._room.iterations) < steps:
            self._room = Rows.allocate(self._levels.binding, steps)
        return self._room

    def _times(self, done: int, q: Array) -> Array | None:
        if not self._levels.timed:
            return None
        return self._levels.binding.times(self._t0, self._dt, np.arange(done, done + len(q)))

    def _values(self, done: int, q: Array, p: Array) -> Array:
        return self._levels.values(self._parameters, self._times(done, q), q, p)

    def detect(self, done: int, q: Array, p: Array) -> None:
        """Look at the states after ``done``, ``done`` + 1, … steps; the first was perhaps seen."""
        if self._tail is not None and done == self._done:
            done, q, p = done + 1, q[1:], p[1:]
        if not len(q):
            return
        near = self._levels.near(self._parameters, self._times(done, q), q, p, self._last)
        old_q, old_p = self._tail or (q[:0], p[:0])
        old, (low, high) = len(old_q), near or (0, 0)
        self._done = done + len(q) - 1
        self._tail = (np.concatenate([old_q, q[-TAIL:]])[-TAIL:],
                      np.concatenate([old_p, p[-TAIL:]])[-TAIL:])
        if near or self._near:
            start = 0 if self._near else max(old + low - TAIL - 1, 0)
            new = slice(max(start - old, 0), high + TAIL + 1)
            self._look_at(done - old + start, max(old - 1 - start, 0),
                          np.concatenate([old_q[start:], q[new]]),
                          np.concatenate([old_p[start:], p[new]]))
        self._closed[:] = False
        self._near = near is not None and high >= len(q) - TAIL

    def _look_at(self, done: int, first: int, q: Array, p: Array) -> None:
        """Note what happens in some steps, from row ``first`` on, between states near a level."""
        values = self._values(done, q, p)
        if len(values) < 2:
            return
        self._crossings(done, first, q, p, values)
        if self.ends_in is not None:  # what comes behind is none of the run's
            q, p, values = (part[: self.ends_in - done + 2] for part in (q, p, values))
            self._done, self._tail = self.ends_in + 1, (q[-TAIL:], p[-TAIL:])
        self._turnings(done, first, q, p, values)

    def _crossings(self, done: int, first: int, q: Array, p: Array, values: Array) -> None:
        """Note the steps from row ``first`` on in which a value changes its sign."""
        before, after = values[first:-1], values[first + 1:]
        falls = (before > 0) & (after < 0) & (self._wanted <= 0)
        rises = (before < 0) & (after > 0) & (self._wanted >= 0)
        moved = np.concatenate([np.full((1, len(self._wanted)), True), values != 0])
        # between two zeros a value rests, unless it came there in the step before
        on_level = np.where(before == 0, (after != 0) | moved[first : first + len(before)],
                            after == 0)
        if not done + first:
            on_level[0] |= (falls | rises)[0] & (
                abs(before[0]) <= _AT_START * abs(after[0] - before[0]))
        row, event = np.nonzero(falls | rises | on_level)
        sure = ~on_level[row, event]  # one that is on its level ends the run once it is solved for
        if (self._ending[event] & sure).any():
            end = int(row[self._ending[event] & sure].min())
            self.ends_in = done + first + end
            kept = row <= end
            row, event, sure = row[kept], event[kept], sure[kept]
        for kind in (True, False):
            self._note(done, row[sure == kind] + first, event[sure == kind], q, p, values,
                       on_level=not kind)

    def _turnings(self, done: int, first: int, q: Array, p: Array, values: Array) -> None:
        """Note the steps in which a value may touch its level, with a neighbour on either side.

        The last step waits for its neighbour behind.
        """
        row, event = _turning(values, max(first - 1, 0), len(values) - 2, begins=not done,
                              ends=False)
        new = (row >= first) | ~self._closed[event]
        self._note(done, row[new], event[new], q, p, values, turning=True)

    def _note(self, done: int, row: Array, event: Array, q: Array, p: Array, values: Array, *,
              turning: bool = False, on_level: bool = False) -> None:
        if len(row):
            earlier = row[:, None] - [1, 2]  # the tail has both, unless the run begins there
            past = np.where(earlier < 0, np.nan, values[earlier, event[:, None]].astype(float))
            self._parts.append(Brackets(event, done + row, q[row], p[row], values[row, event],
                                        values[row + 1, event], np.full(len(row), turning),
                                        np.full(len(row), on_level), past))

    def close(self, ahead: tuple[Array, Array] | None = None) -> None:
        """Look into the last step, though no neighbour is there behind it.

        ``ahead`` is the state that a step more leads to, where that is known: a row of q and of p.
        """
        if self._tail is None:
            return
        q, p = self._tail
        last = len(q) - 1
        values = self._values(self._done - last, q, p)
        seen = values if ahead is None else np.concatenate(
            [values, self._values(self._done + 1, *ahead)])
        row, event = _turning(seen, max(last - 1, 0), last, begins=self._done == last,
                              ends=ahead is None)
        row, event = row[~self._closed[event]], event[~self._closed[event]]
        self._closed[event] = True
        self._note(self._done - last, row, event, q, p, values, turning=True)

    @property
    def memory(self) -> Memory:
        """What it goes on from, after the states that it has looked at."""
        none = self._levels.binding.new(0, self._levels.binding.n)
        q, p = self._tail or (none, none)
        return Memory(q, p, self._closed.copy())

    def go_on(self, done: int, memory: Memory) -> None:
        """Go on after so many steps."""
        self._done, self._closed = done, memory.closed.copy()
        if len(memory.q):
            self._tail, self._near = (memory.q, memory.p), True  # a look more finds nothing else
            times = self._times(done + 1 - len(memory.q), memory.q)
            self._levels.near(self._parameters, times, memory.q, memory.p, self._last)

    @property
    def noted(self) -> int:
        """How many steps are noted."""
        return sum(map(len, self._parts))

    def forget(self) -> None:
        """Forget the steps that are noted: they are solved for."""
        self._parts, self._split = [], 0

    @property
    def brackets(self) -> Brackets | None:
        """All that was found, in the order of the run; None if nothing was."""
        return _in_order(self._parts)

    def final_brackets(self) -> Brackets | None:
        """Look into the last step of the run; return all that was found."""
        self.close()
        return self.brackets

    def take_terminal_brackets(self) -> Brackets | None:
        """Return the brackets of terminal events, which are then noted no longer."""
        new = [(part, self._ending[part.event]) for part in self._parts[self._split :]]
        self._parts[self._split :] = [part.of(~ends) for part, ends in new if not ends.all()]
        self._split = len(self._parts)
        return _in_order([part.of(ends) for part, ends in new if ends.any()])


def _in_order(parts: Sequence[Brackets]) -> Brackets | None:
    """Return brackets in the order of the run; None if there are none."""
    if not parts:
        return None
    found = Brackets.together(parts)
    return found.of(np.argsort(found.step, kind="stable"))
