"""Detection of events: the steps of a run in which a value x − level changes its sign.

Compiled code advances a piece of the run, evaluates the quantities and flags steps that may contain
a crossing: |x − level| ≤ change of x in the two neighbouring steps. Only these are examined here.
The result are brackets: steps with values of two signs at their ends. A value that approaches its
level and turns may cross it twice within one step: if a state is nearer to the level than both
neighbours, the steps on both sides are bracketed as turning. A sine of θ rad a step turns between
three states for θ < π, and satisfies the bound of the compiled code for 1 − c ≤ 4c(1 − c²) with
c = cos(θ/2): up to θ = 2.72. Faster oscillations between two states cannot be detected. A step
that begins or ends exactly on the level is bracketed too: its ends do not determine the sign within
the step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Array
from ...core.event import Event
from ...core.manifest import Manifest
from ..bindings.array_checks import as_real
from ..bindings.binding import Binding
from ..bindings.run_memory import ParameterStruct, Rows

__all__ = ["TAIL", "Brackets", "EventDetector", "Levels", "Memory"]

#: States stored from piece to piece: a step is examined with a neighbour on either side.
TAIL = 3
#: A run may start on a level if its value is at most this share of its first change.
_AT_START = 2.0**-40


@dataclass(frozen=True)
class Levels:
    """Levels of events, and the differences value − level at states."""

    binding: Binding
    events: tuple[Event, ...]
    #: For each event "q", "p" or, of quantities, "", and which column of these.
    columns: tuple[tuple[str, int], ...]
    levels: Array
    #: The columns as C counts them, q, p and quantities in a row, and the levels in its type.
    columns_in_c: Array
    levels_in_c: Array

    @classmethod
    def of(cls, binding: Binding, manifest: Manifest, events: tuple[Event, ...]) -> Levels:
        """Return the levels of events in runs of a stepper.

        The column of an event is the index of its quantity in (q, p, quantities), as C counts.
        """
        system = manifest.system
        # a name that a quantity shares with a coordinate or momentum is the quantity's
        columns_by_name = {name: ("p", i) for i, name in enumerate(system.momenta)}
        columns_by_name |= {name: ("q", i) for i, name in enumerate(system.coordinates)}
        if system.clock is not None:
            columns_by_name[system.clock.time] = ("q", binding.n - 1)
        columns_by_name |= {name: ("", i) for i, name in enumerate(system.quantities)}
        columns = tuple(columns_by_name[event.quantity] for event in events)
        first_column = {"q": 0, "p": binding.n, "": 2 * binding.n}
        levels = np.array([as_real("level", event.level, binding.number) for event in events],
                          binding.number_type)
        return cls(binding, events, columns, levels, columns_in_c=np.array(
            [column + first_column[kind] for kind, column in columns], np.intc),
            levels_in_c=levels.astype(binding.dtype))

    def differences(
        self, parameters: ParameterStruct, t: Array | None, q: Array, p: Array
    ) -> Array:
        """Return x − level of each event at each state, shape (states, events).

        An event happens where its difference changes its sign. ``t`` has the times of the states;
        it is needed only if quantities depend on t, as ``is_time_dependent`` says.
        """
        quantities = (self.binding.quantities(parameters, self._times(t), q, p)
                      if self._has_quantities else q)
        arrays = {"": quantities, "q": q, "p": p}
        # float32 values are subtracted as doubles, the type of levels
        observed = np.empty((len(q), len(self.events)), self.binding.number_type)
        for i, (kind, column) in enumerate(self.columns):
            observed[:, i] = arrays[kind][:, column]
        differences: Array = observed - self.levels
        return differences

    def near(
        self, parameters: ParameterStruct, t: Array | None, q: Array, p: Array, last: Array
    ) -> tuple[int, int] | None:
        """Return the first and last row that follows a state near a level.

        A state is near if |x − level| ≤ change of x; None if no state is. ``last`` has the values
        at the two states before the rows, at first ``no_past``; the values of the last two rows
        replace them.
        """
        return self.binding.near(parameters, self._times(t), q, p, self.columns_in_c,
                                 self.levels_in_c, last)

    @property
    def no_past(self) -> Array:
        """Values for ``near`` before the first state: NaN."""
        return self.binding.to_real(np.full(2 * len(self.events), np.nan))

    @property
    def is_time_dependent(self) -> bool:
        """Whether the values depend on the times of the states."""
        return self._has_quantities and self.binding.quantities_take_time

    @property
    def _has_quantities(self) -> bool:
        """Whether an event is of a quantity, which the C must evaluate."""
        return any(kind == "" for kind, _ in self.columns)

    def _times(self, t: Array | None) -> Array:
        """Return times in the stepper's type; where no value depends on t, any array serves."""
        return self.levels if t is None else t.astype(self.binding.dtype)


@dataclass
class Brackets:
    """Steps of a run in which an event happens, or (``turning``) may happen twice."""

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
    def together(cls, groups: Sequence[Brackets]) -> Brackets:
        """Return the brackets of all groups, one group after the other."""
        return cls(**{name: np.concatenate([getattr(brackets, name) for brackets in groups])
                      for name in cls.__dataclass_fields__})

    def of(self, index: Array) -> Brackets:
        """Return the brackets selected by indices or by a mask."""
        return Brackets(**{name: column[index] for name, column in vars(self).items()})


def _turning_steps(
    differences: Array, start: int, end: int, *, begins: bool, ends: bool
) -> tuple[Array, Array]:
    """Return (rows, events) of steps in which a value may touch 0: a step begins at its row.

    ``differences`` has the shape (states, events); steps from row ``start`` up to ``end`` are
    examined. Of the states about a place where a smooth value turns, the state with the least
    |value| has larger ones on both sides: the steps before and after it are returned, unless the
    value is further from 0 than it moves in both. ``begins`` and ``ends`` say whether the first
    and the last row are those of the run, which lack a neighbour, and are examined in any case.
    """
    size, sides = abs(differences), np.sign(differences.astype(float))
    nearest = np.zeros(differences.shape, bool)
    previous, current, following = size[:-2], size[1:-1], size[2:]
    # the smallest of three, on one side of the level, and not further from 0 than the value moves
    # in both steps together
    nearest[1:-1] = ((current < previous) & (current <= following)
                     & (current <= previous - current + (following - current))
                     & (sides[:-2] == sides[1:-1]) & (sides[1:-1] == sides[2:]))
    if len(differences) > 1:
        nearest[0] = begins & (size[0] <= size[1])
        nearest[-1] = ends & (size[-1] < size[-2])
    # steps with ends of two signs, or on the level, have brackets of their own
    is_on_one_side = (sides[:-1] == sides[1:]) & (sides[1:] != 0)
    row, event = np.nonzero(((nearest[:-1] | nearest[1:]) & is_on_one_side)[start:end])
    return row + start, event


def _steps_on_level(differences: Array) -> Array:
    """Whether each step begins or ends with a value on its level, shape (rows − 1, events).

    A step between two zeros does only if the value came to its level in the step before: then the
    value rests there, and the steps after have no event of their own. ``differences`` are the
    values less their levels, (rows, events); those before row 0 count as off the level.
    """
    is_zero: Array = differences == 0
    begins, ends = is_zero[:-1], is_zero[1:]
    rests = np.zeros_like(begins)
    rests[1:] = begins[:-1] & begins[1:] & ends[1:]
    on_level: Array = (begins | ends) & ~rests
    return on_level


@dataclass(frozen=True)
class Memory:
    """Memory of detection, from which a run resumes.

    q and p, (up to ``TAIL``, n), are the last states; ``closed`` says for each event whether a
    turning in the last step has its bracket; ``margins`` are the round-off of gaps, for impacts.
    """

    q: Array
    p: Array
    closed: Array
    margins: Array


class EventDetector:
    """Detects the events of one run, piece by piece; the result does not depend on the pieces."""

    def __init__(self, levels: Levels, parameters: ParameterStruct, t0: Any, dt: Any) -> None:
        """Begin at the start of a run, of which no state has been examined."""
        self._levels, self._parameters, self._t0, self._dt = levels, parameters, t0, dt
        #: The last states that were examined, up to ``TAIL`` rows of q and of p.
        self._tail: tuple[Array, Array] | None = None
        #: Steps before the last state that was examined.
        self._last_step = 0
        #: x − level at the last two states, and whether these may be near their levels.
        self._last_values = levels.no_past
        self._near_level = False
        self._bracket_groups: list[Brackets] = []
        #: Events whose turning in the last step has its bracket: the next state, which shows the
        #: same turning again, must not add a second one.
        self._turnings_bracketed = np.zeros(len(levels.events), bool)
        #: The step within which a terminal event happens; None as long as there is none.
        self.ends_in: int | None = None
        self._scratch: Rows | None = None
        #: The first groups, from which the brackets of terminal events have been taken.
        self._nonterminal_groups = 0
        self.terminal = any(event.terminal for event in levels.events)
        self._directions = np.array([event.direction for event in levels.events])
        self._is_terminal = np.array([event.terminal for event in levels.events])

    def scratch_rows(self, steps: int) -> Rows:
        """Return rows for the states of ``steps`` steps that the run does not store."""
        if self._scratch is None or len(self._scratch.iterations) < steps:
            self._scratch = Rows.allocate(self._levels.binding, steps)
        return self._scratch

    def _times(self, first_step: int, q: Array) -> Array | None:
        """Return the times of the states q after ``first_step``, ``first_step`` + 1, ... steps.

        None if no value depends on the time.
        """
        if not self._levels.is_time_dependent:
            return None
        steps = np.arange(first_step, first_step + len(q))
        return self._levels.binding.times(self._t0, self._dt, steps)

    def _differences(self, first_step: int, q: Array, p: Array) -> Array:
        """Return x − level, (states, events), of states from ``first_step`` steps on."""
        return self._levels.differences(self._parameters, self._times(first_step, q), q, p)

    def detect(self, first_step: int, q: Array, p: Array) -> None:
        """Examine the states after ``first_step``, ``first_step`` + 1, … steps.

        They are the rows of q and p, shape (states, n). The first of them may have been examined
        before: the last state of one piece is the first of the next.
        """
        if self._tail is not None and first_step == self._last_step:
            first_step, q, p = first_step + 1, q[1:], p[1:]
        if not len(q):
            return
        # C finds states near a level in one pass; NumPy examines only the rows about these
        candidate_rows = self._levels.near(self._parameters, self._times(first_step, q), q, p,
                                           self._last_values)
        tail_q, tail_p = self._tail or (q[:0], p[:0])
        tail_length, (first_candidate, last_candidate) = len(tail_q), candidate_rows or (0, 0)
        self._last_step = first_step + len(q) - 1
        self._tail = (np.concatenate([tail_q, q[-TAIL:]])[-TAIL:],
                      np.concatenate([tail_p, p[-TAIL:]])[-TAIL:])
        if candidate_rows or self._near_level:
            # the rows from ``TAIL`` before the first near state on; all of the tail, if the last
            # piece ended near a level; rows count from the start of the tail
            start = 0 if self._near_level else max(tail_length + first_candidate - TAIL - 1, 0)
            new_rows = slice(max(start - tail_length, 0), last_candidate + TAIL + 1)
            self._bracket(first_step - tail_length + start, max(tail_length - 1 - start, 0),
                          np.concatenate([tail_q[start:], q[new_rows]]),
                          np.concatenate([tail_p[start:], p[new_rows]]))
        self._turnings_bracketed[:] = False
        self._near_level = candidate_rows is not None and last_candidate >= len(q) - TAIL

    def _bracket(self, first_step: int, first_row: int, q: Array, p: Array) -> None:
        """Bracket events in the steps that begin at row ``first_row`` of q and p, or after it.

        Row 0 is the state after ``first_step`` steps; rows before ``first_row`` have been examined,
        and show whether a value turns in the others.
        """
        differences = self._differences(first_step, q, p)
        if len(differences) < 2:
            return
        self._bracket_crossings(first_step, first_row, q, p, differences)
        if self.ends_in is not None:  # the run ends in this step: rows up to its end remain
            q, p, differences = (array[: self.ends_in - first_step + 2]
                                 for array in (q, p, differences))
            self._last_step, self._tail = self.ends_in + 1, (q[-TAIL:], p[-TAIL:])
        self._bracket_turnings(first_step, first_row, q, p, differences)

    def _bracket_crossings(
        self, first_step: int, first_row: int, q: Array, p: Array, differences: Array
    ) -> None:
        """Bracket the steps from row ``first_row`` on in which a value crosses or meets its level.

        ``differences``, x − level, have the shape (rows, events). Their signs at the ends of a step
        say what it has:

            + −   − +    a crossing, in the direction of the event
            0 ±   ± 0    perhaps a crossing (``_steps_on_level``)
            0 0          the same, if the value came to its level in the step before

        The first crossing of a terminal event sets ``ends_in``. Of steps with perhaps a crossing,
        location decides whether they end the run.
        """
        before, after = differences[first_row:-1], differences[first_row + 1:]
        falls = (before > 0) & (after < 0) & (self._directions <= 0)
        rises = (before < 0) & (after > 0) & (self._directions >= 0)
        on_level = _steps_on_level(differences)[first_row:]
        # the start of a run may be off its level by rounding: the first change decides
        if not first_step + first_row:
            on_level[0] |= (falls | rises)[0] & (
                abs(before[0]) <= _AT_START * abs(after[0] - before[0]))
        step, event = np.nonzero(falls | rises | on_level)
        row, is_certain = step + first_row, ~on_level[step, event]
        is_end = self._is_terminal[event] & is_certain
        if is_end.any():
            end = int(row[is_end].min())
            self.ends_in = first_step + end
            up_to_end = row <= end
            row, event, is_certain = row[up_to_end], event[up_to_end], is_certain[up_to_end]
        for mask, is_on_level in ((is_certain, False), (~is_certain, True)):
            self._add_brackets(first_step, row[mask], event[mask], q, p, differences,
                               on_level=is_on_level)

    def _bracket_turnings(
        self, first_step: int, first_row: int, q: Array, p: Array, differences: Array
    ) -> None:
        """Bracket the steps in which a value may touch its level, all but the last one.

        ``q``, ``p``, shapes (rows, n), and ``differences``, x − level of shape (rows, events), are
        the states from step ``first_step`` on; rows from ``first_row`` on are new. A turning shows
        in a step with a neighbour on either side, so that the last step waits for the next.
        """
        # the step before ``first_row`` is examined once more: only now has it neighbours on both
        # sides
        row, event = _turning_steps(differences, max(first_row - 1, 0), len(differences) - 2,
                                    begins=not first_step, ends=False)
        unbracketed = (row >= first_row) | ~self._turnings_bracketed[event]
        self._add_brackets(first_step, row[unbracketed], event[unbracketed], q, p, differences,
                           turning=True)

    def _add_brackets(
        self, first_step: int, row: Array, event: Array, q: Array, p: Array, differences: Array, *,
        turning: bool = False, on_level: bool = False,
    ) -> None:
        """Add a bracket for each pair of ``row`` and ``event``: the step that begins at the row.

        ``row`` and ``event`` have the same length; row 0 of q, p and the differences x − level,
        (rows, events), is the state after ``first_step`` steps.
        """
        if len(row):
            # one and two rows before; the tail has both, unless the run begins there
            earlier = row[:, None] - [1, 2]
            past = np.where(earlier < 0, np.nan, differences[earlier, event[:, None]].astype(float))
            self._bracket_groups.append(Brackets(
                event, step=first_step + row, q=q[row], p=p[row], before=differences[row, event],
                after=differences[row + 1, event], turning=np.full(len(row), turning),
                on_level=np.full(len(row), on_level), past=past))

    def bracket_last_step(self, ahead: tuple[Array, Array] | None = None) -> None:
        """Bracket turnings in the last step of the rows, which has no next one yet.

        A turning is a place where x − level may touch 0 between two rows. ``ahead`` is the state
        after the next step, if it is known: a row of q and of p.
        """
        if self._tail is None:
            return
        q, p = self._tail
        last_row = len(q) - 1
        differences = self._differences(self._last_step - last_row, q, p)
        with_next = differences if ahead is None else np.concatenate(
            [differences, self._differences(self._last_step + 1, *ahead)])
        row, event = _turning_steps(with_next, max(last_row - 1, 0), last_row,
                                    begins=self._last_step == last_row, ends=ahead is None)
        # one turning an event: a second call for the same step adds none
        is_new = ~self._turnings_bracketed[event]
        row, event = row[is_new], event[is_new]
        self._turnings_bracketed[event] = True
        self._add_brackets(self._last_step - last_row, row, event, q, p, differences, turning=True)

    @property
    def memory(self) -> Memory:
        """The memory from which detection resumes after the examined states."""
        no_states = self._levels.binding.new(0, self._levels.binding.n)
        q, p = self._tail or (no_states, no_states)
        return Memory(q, p, closed=self._turnings_bracketed.copy(),
                      margins=self._levels.binding.new(0))

    def resume(self, step: int, memory: Memory) -> None:
        """Continue after ``step`` steps, with the memory of detection up to there."""
        self._last_step, self._turnings_bracketed = step, memory.closed.copy()
        if len(memory.q):
            # whether the tail is near a level is not stored: it is examined again, and gives no
            # bracket twice, as turnings that have theirs are marked
            self._tail, self._near_level = (memory.q, memory.p), True
            times = self._times(step + 1 - len(memory.q), memory.q)
            # called for the differences of the last two states, which C writes
            self._levels.near(self._parameters, times, memory.q, memory.p, self._last_values)

    @property
    def bracket_count(self) -> int:
        """The number of brackets that are not located yet."""
        return sum(map(len, self._bracket_groups))

    def forget(self) -> None:
        """Remove the brackets, which are located."""
        self._bracket_groups, self._nonterminal_groups = [], 0

    @property
    def brackets(self) -> Brackets | None:
        """All brackets in the order of the run; None if there are none."""
        return _in_order(self._bracket_groups)

    def final_brackets(self) -> Brackets | None:
        """Examine the last step of the run; return all brackets."""
        self.bracket_last_step()
        return self.brackets

    def take_terminal_brackets(self) -> Brackets | None:
        """Remove and return the brackets of terminal events."""
        # the first groups have been looked through by earlier calls
        new_groups = self._bracket_groups[self._nonterminal_groups :]
        del self._bracket_groups[self._nonterminal_groups :]
        terminal_groups: list[Brackets] = []
        for brackets in new_groups:
            is_terminal = self._is_terminal[brackets.event]
            if is_terminal.any():
                terminal_groups.append(brackets.of(is_terminal))
            if not is_terminal.all():
                self._bracket_groups.append(brackets.of(~is_terminal))
        self._nonterminal_groups = len(self._bracket_groups)
        return _in_order(terminal_groups)


def _in_order(groups: Sequence[Brackets]) -> Brackets | None:
    """Return brackets in the order of the run; None if there are none."""
    if not groups:
        return None
    brackets = Brackets.together(groups)
    return brackets.of(np.argsort(brackets.step, kind="stable"))
