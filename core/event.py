"""Events: a quantity of a run crosses a level; impacts: there the momenta jump.

Their records, and the text of events on the command line.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

from .arguments import choose, shown
from .errors import InputError
from .exact_numbers import decimal, exact
from .incompatibilities import refuse_together
from .records import dataclass

__all__ = ["DIRECTIONS", "Event", "Impact", "as_events", "as_impacts", "event_of_text",
           "events_of_model", "impacts_as_json", "impacts_of_json", "refuse_unusable_names",
           "terminal_of", "with_restitutions"]

#: How a direction is written on the command line and in model files.
DIRECTIONS = {"up": 1, "down": -1, "both": 0}
#: Such as "height = 0 down stop"; the caller parses the level, which may be a formula.
_TEXT = re.compile(r"\s*(?P<quantity>[^=]+?)\s*=\s*(?P<level>\S.*?)"
                   r"(?P<words>(?:\s+(?:up|down|both|stop))*)\s*")
_NAME = re.compile("[A-Za-z0-9_]{1,40}")


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
        -1: falling, 0: both, 1: rising, in the order of integration (t falls if dt < 0).
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
        """Check all fields; by default an event is named after its quantity."""
        _set_name(self, "event")
        # True and 1.0 equal 1, and would be read as "rising" where a flag was meant
        if type(self.direction) is not int or self.direction not in (-1, 0, 1):
            raise InputError(f"direction = {shown(self.direction)} is unknown; give -1 (falling), "
                             "1 (rising) or 0 (both).")
        level = exact(self.level)
        if level is None or isinstance(level, float):  # a float is NaN, ∞ or −∞
            raise InputError(f"level = {shown(self.level)} is no finite number.")


@dataclass(frozen=True)
class Impact:
    """A gap φ(q, t) ≥ 0 closes, and the momenta jump by Newton's law with the restitution e.

        p⁺ = p⁻ − (1 + e) n (nᵀ H_pp n)⁻¹ φ̇,   n = φ_qᵀ − g_qᵀ W⁻¹ g_q H_pp φ_qᵀ

    with W = g_q H_pp g_qᵀ: φ̇⁺ = −e φ̇⁻, the constraints are kept, and for e = 1 and φ_t = 0 so is
    H. H must be quadratic in p. (docs/theory/impacts.md)

    Attributes
    ----------
    quantity : str
        The gap: a quantity of the system, of coordinates and time.
    restitution : number or str
        e, from 0 (plastic) to 1 (elastic), or the name of a parameter that has it.
    name : str, optional
        Under which it is found in ``Trajectory.impacts``; by default the quantity's.
    terminal : bool
        Whether the run ends where the gap closes, before the momenta jump.

    Raises
    ------
    InputError
        For a restitution outside of [0, 1].
    """

    quantity: str
    restitution: Any = 1.0
    name: str = ""
    terminal: bool = False

    def __post_init__(self) -> None:
        _set_name(self, "impact")
        if not isinstance(self.restitution, str):
            _refuse_restitution("restitution", self.restitution)


def _set_name(record: Event | Impact, kind: str) -> None:
    """Name an event or impact after its quantity by default; refuse fields of wrong types."""
    if not isinstance(record.quantity, str):
        raise InputError(f"An {kind}'s quantity is a name, not {shown(record.quantity)}.")
    if not isinstance(record.name, str):
        raise InputError(f"An {kind}'s name is text, not {shown(record.name)}.")
    if not isinstance(record.terminal, bool):
        raise InputError(f"terminal = {shown(record.terminal)} is neither True nor False.")
    object.__setattr__(record, "name", record.name or record.quantity)


def _refuse_restitution(label: str, entry: Any) -> None:
    """Refuse a restitution that is no number from 0 to 1; ``label`` names it in the error."""
    e = exact(entry)
    # e > 1 would add the energy ½ (e² − 1) φ̇² / (nᵀ H_pp n) in each impact
    if e is None or isinstance(e, float) or not 0 <= e <= 1:
        raise InputError(f"{label} = {shown(entry)} is outside of [0, 1]; give a number from 0 "
                         "(plastic) to 1 (elastic).")


def with_restitutions(
    impacts: Sequence[Impact], parameters: Mapping[str, Any]
) -> tuple[Impact, ...]:
    """Return the impacts with numbers where a restitution is the name of a parameter.

    Raises InputError for an unknown parameter, and one outside of [0, 1].
    """
    def value(e: Any) -> Any:
        """Return the number of a restitution, which may be the name of a parameter."""
        if not isinstance(e, str):
            return e
        number = parameters[choose("parameter of a restitution", e, list(parameters))]
        _refuse_restitution(f"The restitution {e}", number)
        return number

    return tuple(replace(impact, restitution=value(impact.restitution)) for impact in impacts)


def impacts_as_json(
    impacts: Sequence[Impact], parameters: Mapping[str, Any]
) -> dict[str, dict[str, Any]]:
    """Return the impacts of a run as JSON values by name, for ``impacts_of_json``."""
    return {impact.name: {"quantity": impact.quantity, "terminal": impact.terminal,
                          "restitution": str(exact(number.restitution)),
                          **parameter_of_restitution(impact)}
            for impact, number in zip(impacts, with_restitutions(impacts, parameters),
                                      strict=True)}


def parameter_of_restitution(impact: Impact) -> dict[str, str]:
    """Return the name of the parameter that is a restitution as an entry of a file, if one is."""
    return {"parameter": impact.restitution} if isinstance(impact.restitution, str) else {}


def impacts_of_json(records: Mapping[str, Mapping[str, Any]]) -> tuple[Impact, ...]:
    """Return the impacts among the events of a file; those of earlier versions have no record.

    Raises ValueError, KeyError, TypeError, ArithmeticError or InputError for unusable records.
    """
    return tuple(Impact(record["quantity"],
                        record.get("parameter", Fraction(record["restitution"])), name,
                        record["terminal"])
                 for name, record in records.items() if record.get("restitution") is not None)


def events_of_model(
    argument: Any, quantities: Sequence[str], velocities: Sequence[str]
) -> tuple[Event | Impact, ...]:
    """Return the impacts and then the events that a model declares.

    Impacts watch quantities; events may also watch velocities. Raises InputError as ``as_impacts``
    and ``as_events``.
    """
    declarations = [argument] if isinstance(argument, Event | Impact) else argument
    if not isinstance(declarations, Sequence):
        return as_events(declarations, [*quantities, *velocities])  # raises: it is no list
    impacts = [item for item in declarations if isinstance(item, Impact)]
    # without impacts the model's own list, which a refusal shows as it was written
    events = [item for item in declarations if item not in impacts] if impacts else declarations
    return *as_impacts(impacts, quantities), *as_events(events, [*quantities, *velocities])


def as_impacts(
    argument: Any, quantities: Sequence[str], model_impacts: Sequence[Impact] = ()
) -> tuple[Impact, ...]:
    """Return a caller's impacts, each of a quantity that the system has; () of events alone.

    ``model_impacts`` are the impacts of the start; impacts of the caller replace them. Raises
    InputError for impacts and events together, an unknown quantity, two impacts of one gap or one
    name.
    """
    impacts = (argument,) if isinstance(argument, Event | Impact) else argument
    if not isinstance(impacts, Sequence):
        return ()
    if not any(isinstance(event_or_impact, Impact) for event_or_impact in impacts):
        # events of the caller stand beside the impacts of the model, and are refused below
        impacts = (*model_impacts, *impacts) if model_impacts else ()
    for impact in impacts:
        refuse_together(impacts="impacts", events=not isinstance(impact, Impact) and "events")
        choose("quantity of an impact", impact.quantity, quantities)
    for names in ([impact.quantity for impact in impacts], [impact.name for impact in impacts]):
        repeated = [name for name in names if names.count(name) > 1]
        if repeated:
            raise InputError(f"Two impacts are of {repeated[0]!r}; give one for each gap, each "
                             "with a name of its own.")
    return tuple(impacts)


def as_events(argument: Any, quantities: Sequence[str]) -> tuple[Event, ...]:
    """Return a caller's events, each of a quantity that the system has.

    ``quantities`` are names of quantities, coordinates and momenta, and of the time in scaled time.
    Raises InputError for a value that is no event, an unknown quantity, two events of one name.
    """
    # most calls have the default (), and a short run takes microseconds
    if type(argument) is tuple and not argument:
        return ()
    events = (argument,) if isinstance(argument, Event | Impact) else argument
    if isinstance(events, Sequence):
        # runs take impacts by ``as_impacts``: here they come from sweeps and sections alone
        refuse_together(impacts=any(isinstance(event, Impact) for event in events) and "an impact",
                        other_runs="sweeps and sections")
    if not isinstance(events, Sequence) or not all(isinstance(event, Event) for event in events):
        raise InputError(f"events = {shown(argument)} is no list of events; give "
                         'events=[gs.Event("height", level=0.0, direction=-1)].')
    for event in events:
        choose("quantity of an event", event.quantity, quantities)
    names = [event.name for event in events]
    repeated_names = [name for name in names if names.count(name) > 1]
    if repeated_names:
        raise InputError(f"Two events are named {repeated_names[0]!r}; give one of them another "
                         'name, as in gs.Event(..., name="landing") or --event "landing: x=0".')
    return tuple(events)


def terminal_of(events: Sequence[Event]) -> str:
    """Return the name of the first terminal event for messages, "" without one."""
    return next((f"the terminal event {event.name!r}" for event in events if event.terminal), "")


def refuse_unusable_names(events: Sequence[Event | Impact], named: str) -> None:
    """Refuse events whose names cannot be in the names of arrays; ``named`` says in which."""
    for event in events:
        if not _NAME.fullmatch(event.name):
            raise InputError(f"The event {event.name!r} names {named}; give it a name of letters, "
                             'digits and "_", as in gs.Event(..., name="landing").')


def event_of_text(text: str, name: str = "", number: Callable[[str], Any] = decimal) -> Event:
    """Return the event that ``"height=0 down stop"`` says.

    ``number`` returns the level in a text; it returns None or raises InputError if the text has
    none. Raises InputError for other text.
    """
    match = _TEXT.fullmatch(text)
    try:
        level = None if match is None else number(match["level"])
    except InputError as error:
        raise InputError(f"{error} The event {text!r} may have up, down or both, and stop, behind "
                         "its level.") from None
    words = [] if match is None else match["words"].split()
    directions = [word for word in words if word in DIRECTIONS]
    if match is None or level is None or len(directions) > 1:
        raise InputError(f'The event {text!r} is not read; write "height=0", "height=0 down" or '
                         '"height=0 up stop": a quantity, its level, up, down or both, and stop '
                         "where the run shall end there.")
    return Event(match["quantity"], level,
                 direction=DIRECTIONS[directions[0]] if directions else 0,
                 terminal="stop" in words, name=name)
