"""Identity of a run: everything that determines the bits of its result."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import zarr

from .._version import __version__
from ..core.errors import InputError
from ..core.event import Event, parameter_of_restitution, with_restitutions
from ..core.exact_numbers import digits_of, exact

if TYPE_CHECKING:
    from ..core.event import Impact
    from ..runtime.integration.run_arguments import RunArguments
    from ..runtime.steppers.stepper import Stepper

__all__ = ["identity_of", "refuse_if_different", "versions", "written_by"]

#: Version of the layout of stores; stores of another version are refused.
FORMAT = 1


def identity_of(
    stepper: Stepper, run: RunArguments, events: tuple[Event | Impact, ...] = ()
) -> dict[str, Any]:
    """Return the identity of a run, compared before it is resumed, as JSON values.

    Numbers have all their digits: as text where a double does not hold them. A run without events
    has no entry for them, as in earlier versions.
    """
    return _event_identity(events, run.parameters) | {
        "format": FORMAT,
        "gyrospark": __version__,
        "stepper": stepper.name,
        # source, compiler and CPU: the bits depend on them
        "code": stepper._provenance,
        "parameters": {name: digits_of(x) for name, x in run.parameters.items()},
        "q0": [digits_of(x) for x in run.q],
        "p0": [digits_of(x) for x in run.p],
        "t0": digits_of(run.t0),
        "dt": digits_of(run.dt),
        "steps": run.steps,
        "every": run.every,
        **({"t_end": digits_of(run.t_end), "rest": digits_of(run.rest)} if run.rest else {}),
        "solver": run.solver,
        "tolerance": None if run.tolerance is None else digits_of(run.tolerance),
        "max_iterations": run.max_iterations,
    }


def _event_identity(
    events: tuple[Event | Impact, ...], parameters: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the quantities, levels and restitutions of events, which a resumed run must have."""
    events_json: dict[str, dict[str, Any]] = {}
    for event in events:
        own_fields: dict[str, Any]
        if isinstance(event, Event):
            own_fields = {"level": _level(event.level), "direction": event.direction}
        else:
            (impact,) = with_restitutions([event], parameters)
            own_fields = {"restitution": _level(impact.restitution),
                          **parameter_of_restitution(event)}
        events_json[event.name] = {"quantity": event.quantity, **own_fields,
                                   "terminal": event.terminal}
    return {"events": events_json} if events_json else {}


def _level(level: Any) -> float | str:
    """Return a level or restitution as a number where a double has all of it, else as a fraction.
    """
    exact_level = exact(level)
    assert isinstance(exact_level, Fraction)  # events have no other
    # beyond about 2**1024 float() raises an error
    fits = abs(exact_level) < 2**1000 and Fraction(float(exact_level)) == exact_level
    return float(exact_level) if fits else str(exact_level)


def versions() -> dict[str, str]:
    """Return the versions that made a store; for information, not compared."""
    return {"gyrospark": __version__, "numpy": np.__version__, "zarr": zarr.__version__,
            "python": platform.python_version()}


def refuse_if_different(
    stored_identity: Mapping[str, Any], current_identity: Mapping[str, Any], where: str
) -> None:
    """Refuse to resume another run.

    Raises InputError with all differences, both values each.
    """
    differences = list(_differences(stored_identity, current_identity))
    writer = stored_identity.get("gyrospark")
    if writer != current_identity["gyrospark"]:
        prefixes_of_version = ("gyrospark ", "code.source ", "steppers.")  # what a version changes
        other_differences = "".join(f"; {phrase}" for phrase in differences
                                    if not phrase.startswith(prefixes_of_version))
        raise InputError(f"{where} was written by gyrospark {writer}; this is gyrospark "
                         f"{current_identity['gyrospark']}, which may compute other "
                         f"bits{other_differences}. What is stored can be read; go on with "
                         f"gyrospark {writer}, or choose another store.")
    if differences:
        raise InputError(f"{where} holds another run and cannot be resumed: "
                         f"{'; '.join(differences)}. Repeat the command that began it, or choose "
                         "another store.")


def written_by(path: Path, writer: Any, why: str) -> InputError:
    """Return the error for a store of another version that this version cannot read."""
    return InputError(f"{str(path)!r} was written by gyrospark {writer}; this is gyrospark "
                      f"{__version__}, which cannot read it: {why}. Use gyrospark {writer}.")


def _differences(stored_entry: Any, current_entry: Any, path: str = "") -> list[str]:
    """Return a phrase for each entry that differs, with its ``path`` of keys, "run.dt"."""
    if isinstance(stored_entry, Mapping) and isinstance(current_entry, Mapping):
        return list(chain.from_iterable(
            _differences(stored_entry.get(name), current_entry.get(name),
                         f"{path}.{name}".lstrip("."))
            for name in {**stored_entry, **current_entry}))
    if stored_entry == current_entry:
        return []
    return [f"{path} was {_short(stored_entry)} and is {_short(current_entry)}"]


def _short(value: Any) -> str:
    """Return the text of a value for a message, at most 80 characters with its last one."""
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:76]}...{text[-1]}"
