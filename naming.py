"""Names that a caller chooses from: a refusal lists them and proposes the nearest."""

from __future__ import annotations

import difflib
import numbers
from collections.abc import Collection, Iterable, Mapping
from types import MappingProxyType
from typing import Any, TypeVar

from .errors import InputError

__all__ = ["choose", "few", "listed", "proposal", "shown", "unknown", "whole"]

Name = TypeVar("Name", bound=str)

#: Names that are shown of a list.
_FEW = 6


def few(names: Iterable[object]) -> str:
    """Return the first of some names, and how many there are if that is not all."""
    found = [str(name) for name in names]
    first = ", ".join(found[:_FEW]) or "none"
    return first if len(found) <= _FEW else f"{first}, … ({len(found)})"


def choose(what: str, value: Any, allowed: Collection[Name], more: str = "") -> Name:
    """Return a value that is one of the allowed names.

    Parameters
    ----------
    what : str
        What is chosen, e.g. ``"scheme"``.
    value
        Anything a caller passed.
    allowed : collection of str
        The names; a mapping's keys do.
    more : str
        What else may be given, e.g. ``" or a model file"``.

    Raises
    ------
    InputError
    """
    if isinstance(value, str):
        for name in allowed:
            if name == value:
                return name
    raise unknown(what, value, allowed, more)


def unknown(what: str, value: Any, allowed: Iterable[str], more: str = "") -> InputError:
    """Return the refusal of a name: the allowed ones, and the one that was probably meant."""
    names = list(allowed)
    return InputError(f"Unknown {what} {shown(value)}; choose {listed(names)}{more}"
                      f"{proposal(value, names)}.")


def proposal(
    value: Any, allowed: Iterable[str], spelt: Mapping[str, str] = MappingProxyType({})
) -> str:
    """Return " (did you mean …?)" if a name looks like one of the allowed, else nothing.

    ``spelt`` has names beside these that must be spelt otherwise than they sound.
    """
    if not isinstance(value, str):
        return ""
    plain = {_plain(name): text for name, text in spelt.items()}
    plain |= {_plain(name): name for name in allowed}
    near = difflib.get_close_matches(_plain(value), plain, n=1, cutoff=0.6)
    return f" (did you mean {plain[near[0]]}?)" if near else ""


def _plain(name: str) -> str:
    """Return a name without what people confuse: case, and the signs between words."""
    return name.lower().replace("-", "").replace("_", "").replace(" ", "")


def listed(names: Iterable[str]) -> str:
    """Return "a, b or c"."""
    *first, last = names
    return f"{', '.join(first)} or {last}" if first else last


def shown(value: Any, most: int = 80) -> str:
    """Return a value as a message shows it: on one line, cut to what can be read."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # a repr of somebody else's; of an integer of 5000 digits, too
        text = f"a value of type {type(value).__name__}"
    return text if len(text) <= most else text[: most - 1] + "…"


def whole(value: Any) -> int | None:
    """Return a whole number of whatever type, 10.0 and 1e3 among them, as int; else None."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return None
    try:
        found: int = int(value)  # type: ignore[call-overload]
    except (OverflowError, ValueError):  # infinity, NaN
        return None
    return found if found == value else None
