"""What is asked for, an event, and what was found of it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...exact import decimal, exact
from ...naming import choose, shown

__all__ = ["DIRECTIONS", "Crossings", "CrossingsOfMany", "Event", "as_events", "event_of_text"]

Array = NDArray[Any]

#: How a direction is written on the command line and in model files.
DIRECTIONS = {"up": 1, "down": -1, "both": 0}
_TEXT = re.compile(r"\s*(?P<quantity>[^=]+?)\s*=\s*(?P<level>\S+)"
                   r"(?P<words>(?:\s+(?:up|down|both|stop))*)\s*")


@dataclass(frozen=True)
class Event:
    """A quantity of the run crosses a level.

    Attributes
    ----------
    quantity : str
        A quantity, a coordinate or a momentum of the system, by its name.
    level : number
        In the quantity's own units.
    direction : {-1, 0, 1}
        Only where it falls, in either direction, only where it rises, along the time of the run
        (which may go backwards).
    terminal : bool
        Whether the run ends there.
    name : str, optional
        Under which it is found in ``Trajectory.events``; by default the quantity's.

    Raises
    ------
    InputError
        For another direction, for a level that is no finite number.
    """

    quantity: str
    level: Any = 0.0
    direction: int = 0
    terminal: bool = False
    name: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.quantity, str):
            raise InputError(f"An event's quantity is a name, not {shown(self.quantity)}.")
        if type(self.direction) is not int or self.direction not in (-1, 0, 1):
            raise InputError(f"direction = {shown(self.direction)} is none; give -1 (falling), 1 "
                             "(rising) or 0 (both).")
        if not isinstance(self.terminal, bool):
            raise InputError(f"terminal = {shown(self.terminal)} is neither True nor False.")
        if not isinstance(self.name, str):
            raise InputError(f"An event's name is text, not {shown(self.name)}.")
        level = exact(self.level)
        if level is None or isinstance(level, float):
            raise InputError(f"level = {shown(self.level)} is no finite number.")
        object.__setattr__(self, "name", self.name or self.quantity)


@dataclass(frozen=True, eq=False)
class Crossings:
    """Where a run crossed a level, in the order of the run.

    Attributes
    ----------
    t : array, shape (K,)
        Times, to some units in the last place.
    q, p : array, shape (K, n)
        The states there: of real steps from the states before, so on their constraints.
    steps : array of int, shape (K,)
        Whole steps of the run before each.
    rising : array of bool, shape (K,)
        Whether the quantity rises there along the run.
    """

    t: Array
    q: Array
    p: Array
    steps: Array
    rising: Array

    def __len__(self) -> int:
        return len(self.t)

    @property
    def first(self) -> Crossings:
        """The first of them by itself, or none."""
        return self._some(np.arange(len(self)) < 1)

    def until(self, last: Crossings, dt: Any) -> Crossings:
        """Return those that are no later, in a run with steps dt, than another crossing."""
        step, later = last.steps[0], (self.t - last.t[0]) * dt > 0
        return self._some((self.steps < step) | (self.steps == step) & ~later.astype(bool))

    def _some(self, chosen: Array) -> Crossings:
        return Crossings(self.t[chosen], self.q[chosen], self.p[chosen], self.steps[chosen],
                         self.rising[chosen])

    def __repr__(self) -> str:
        if not len(self):
            return "<Crossings: none>"
        return (f"<Crossings: {len(self):,}, from t = {float(self.t[0]):.6g} to "
                f"{float(self.t[-1]):.6g} s>")


@dataclass(frozen=True, eq=False)
class CrossingsOfMany:
    """The crossings of each trajectory of an ensemble: ``found[i]`` has those of trajectory i."""

    _members: list[Crossings]

    def __getitem__(self, i: int) -> Crossings:
        return self._members[i]

    def __len__(self) -> int:
        return len(self._members)

    @property
    def count(self) -> Array:
        """How many each trajectory has."""
        return np.array([len(one) for one in self._members])

    @property
    def first(self) -> Array:
        """The time of the first of each trajectory; NaN where it has none."""
        none = np.array([np.nan])
        return np.array([(one.t if len(one) else none)[0] for one in self._members])

    def __repr__(self) -> str:
        return f"<Crossings of {len(self):,} trajectories: {self.count.sum():,}>"


def as_events(given: Any, system: Mapping[str, Any]) -> tuple[Event, ...]:
    """Return a caller's events, each of a quantity that the system has.

    Raises
    ------
    InputError
        For what is no event, an unknown quantity, two events of one name.
    """
    events = (given,) if isinstance(given, Event) else given
    if not isinstance(events, Sequence) or not all(isinstance(one, Event) for one in events):
        raise InputError(f"events = {shown(given)} is no list of events; give "
                         'events=[gs.Event("height", level=0.0, direction=-1)].')
    known = [*system.get("quantities", ()), *system["coordinates"], *system["momenta"]]
    for one in events:
        choose("quantity of an event", one.quantity, known)
    names = [one.name for one in events]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"Two events are named {twice[0]!r}; give one of them another "
                         'name, as in gs.Event(..., name="landing").')
    return tuple(events)


def event_of_text(text: str, name: str = "") -> Event:
    """Return the event that ``"height=0 down stop"`` says.

    Raises
    ------
    InputError
        For other text.
    """
    found = _TEXT.fullmatch(text)
    level = None if found is None else decimal(found["level"])
    words = [] if found is None else found["words"].split()
    directions = [word for word in words if word in DIRECTIONS]
    if found is None or level is None or len(directions) > 1:
        raise InputError(f'The event {text!r} is not read; write "height=0", "height=0 down" or '
                         '"height=0 up stop": a quantity, its level, up, down or both, and stop '
                         "where the run shall end there.")
    return Event(found["quantity"], level, DIRECTIONS[directions[0]] if directions else 0,
                 "stop" in words, name)
