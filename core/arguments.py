"""Checks of arguments that every package takes: names to choose from, paths, flags, lists, texts.

A refusal names the argument and its value; for a name it lists the allowed ones and proposes the
nearest. Numbers and arrays are checked by ``exact_numbers`` and ``runtime.bindings.array_checks``.
"""

from __future__ import annotations

import difflib
import numbers
import os
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from .errors import InputError

__all__ = [
    "as_flag",
    "as_integer",
    "as_items",
    "as_mapping",
    "as_path",
    "as_text",
    "check_stepper",
    "choose",
    "count_text",
    "few",
    "join_or",
    "proposal",
    "quote",
    "shown",
    "unknown",
    "why_unwritable",
]

Name = TypeVar("Name", bound=str)

#: Names that are shown of a list.
_FEW = 6
#: Length of a file's name, at most: of ext4, NTFS and APFS.
_LONGEST_NAME = 255


def few(names: Iterable[object]) -> str:
    """Return the first of some names, and how many there are if that is not all."""
    texts = [str(name) for name in names]
    first = ", ".join(texts[:_FEW]) or "none"
    return first if len(texts) <= _FEW else f"{first}, … ({len(texts)})"


def choose(label: str, value: Any, allowed: Collection[Name], suffix: str = "") -> Name:
    """Return a value that is one of the allowed names.

    Parameters
    ----------
    label : str
        The kind of name, for the error, such as ``"scheme"``.
    value
        Anything a caller passed.
    allowed : collection of str
        The names; a mapping's keys do.
    suffix : str
        Further choices, for the error, such as ``" or a model file"``.

    Raises
    ------
    InputError
    """
    if isinstance(value, str):
        for name in allowed:
            if name == value:
                return name  # the registry's own text: ``value`` may be of a subclass, as NumPy's
    raise unknown(label, value, allowed, suffix)


def unknown(label: str, value: Any, allowed: Iterable[str], suffix: str = "") -> InputError:
    """Return the refusal of a name: the allowed ones, and the one that was probably meant."""
    names = list(allowed)
    return InputError(f"Unknown {label} {shown(value)}; choose {join_or(names)}{suffix}"
                      f"{proposal(value, names)}.")


def proposal(
    value: Any, allowed: Iterable[str], spelt: Mapping[str, str] = MappingProxyType({})
) -> str:
    """Return " (did you mean …?)" if a name looks like one of the allowed, else nothing.

    ``spelt`` maps further names to the text that is proposed for them, such as
    "pendulum" to "examples/pendulum.toml".
    """
    if not isinstance(value, str):
        return ""
    text_by_spelling = {_plain(name): text for name, text in spelt.items()}
    text_by_spelling |= {_plain(name): name for name in allowed}
    closest = difflib.get_close_matches(_plain(value), text_by_spelling, n=1)
    return f" (did you mean {text_by_spelling[closest[0]]}?)" if closest else ""


def _plain(name: str) -> str:
    """Return a name without case and signs between words, which people confuse."""
    return name.lower().replace("-", "").replace("_", "").replace(" ", "")


def count_text(count: int, noun: str) -> str:
    """Return a number with its noun, in the plural unless there is one: "1 step", "2,000 steps"."""
    plural = f"{noun[:-1]}ies" if noun.endswith("y") else f"{noun}s"
    return f"{count:,} {noun if count == 1 else plural}"


def join_or(names: Iterable[str]) -> str:
    """Return "a, b or c"; an empty name, such as the ground's, as ''."""
    *first, last = (name or "''" for name in names)
    return f"{', '.join(first)} or {last}" if first else last


def quote(names: Iterable[str]) -> str:
    """Return names in quotes, separated by commas."""
    return ", ".join(map(repr, names))


def shown(value: Any, length: int = 80) -> str:
    """Return a value as a message shows it: on one line, cut to a readable length."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # a repr of somebody else's; of an integer of 5000 digits, too
        text = f"a value of type {type(value).__name__}"
    return text if len(text) <= length else text[: length - 1] + "…"


def as_integer(value: Any) -> int | None:
    """Return a whole number, 10.0 and 1e3 among them, as int; None for all else.

    Numbers are int, float, Fraction and NumPy's; texts, bool and Decimal are none.
    """
    if type(value) is int:
        return value
    # Python's bool is an int, and True steps are a mistake
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return None
    try:
        number: int = int(value)  # type: ignore[call-overload]
    except (OverflowError, ValueError):  # infinity, NaN
        return None
    return number if number == value else None


def as_path(name: str, value: Any, example: str) -> Path:
    """Return the path of a file or folder.

    Raises InputError for a value that is neither text nor a path, and a name that no file can have.
    """
    usable = isinstance(value, (str, os.PathLike))
    try:
        path = Path(value) if usable else Path()
        # "." and "/" have no name
        usable = usable and bool(path.name) and b"\0" not in os.fsencode(path)
    except (TypeError, UnicodeError):  # a PathLike of bytes; half of a surrogate pair
        usable = False
    if not usable:
        raise InputError(f"{name} = {shown(value)} is no file name; give one such as {example!r}.")
    # Windows counts units of UTF-16, other systems bytes
    length = max(len(part.encode("utf-16-le")) // 2 if os.name == "nt" else len(os.fsencode(part))
                 for part in path.parts)
    if length > _LONGEST_NAME:
        raise InputError(f"{name} = {shown(value)} has a name of {length} letters in bytes; files "
                         f"and folders have at most {_LONGEST_NAME}.")
    return path


def why_unwritable(path: Path, error: BaseException) -> str:
    """Return why a file could not be written, with the cure where its folder is missing."""
    if not path.parent.is_dir():
        return (f"there is no folder {str(path.parent)!r}; make it, as with "
                f"pathlib.Path({str(path.parent)!r}).mkdir(parents=True), or choose another")
    return str(getattr(error, "strerror", None) or error)


def check_stepper(stepper: Any, name: str = "stepper") -> None:
    """Raise InputError unless the value is a stepper."""
    # core imports nothing above it, so no class for isinstance: only steppers have this method
    if not hasattr(stepper, "integrate_ensemble"):
        raise InputError(f"{name} = {shown(stepper)} is no stepper; give what gyrospark.stepper "
                         "returned.")


def as_flag(name: str, value: Any) -> bool:
    """Return True or False, or raise InputError."""
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(f"{name} = {shown(value)} is neither True nor False.")
    return bool(value)


def as_mapping(name: str, value: Any, example: str) -> dict[str, Any]:
    """Return a dict whose keys are names, or raise InputError, which shows an ``example``."""
    if not isinstance(value, Mapping):
        raise InputError(f"{name} = {shown(value)} is no dict; give one such as {example}.")
    for key in value:
        if not isinstance(key, str):
            raise InputError(f"{name} has the key {shown(key)}, which is no name; write text.")
    return dict(value)


def as_text(name: str, value: Any) -> str:
    """Return a text, or raise InputError."""
    if not isinstance(value, str):
        raise InputError(f"{name} = {shown(value)} is no text; write it in quotes.")
    return value


def as_items(name: str, value: Any, content: str, *, is_ordered: bool = True) -> list[Any]:
    """Return the items of a list, tuple or other row, or raise InputError, also for text.

    ``content`` is the noun of the entries in the error, such as "names". A set, whose order differs
    from process to process, is refused unless ``is_ordered`` is False.
    """
    items = None
    if isinstance(value, Iterable) and not isinstance(value, (str, bytes, Mapping)):
        items = list(value)
    if items is None:
        raise InputError(f"{name} = {shown(value)} is no list of {content}.")
    if is_ordered and isinstance(value, (set, frozenset)):  # keys of a dict, another Set, have one
        raise InputError(f"{name} = {shown(value)} is a set, which has no order; write a list of "
                         f"{content}.")
    return items
