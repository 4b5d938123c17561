"""Arguments of a kind that every room takes: paths, flags, tables, texts, lists.

What is of another kind is refused by the argument's name; numbers are looked at elsewhere.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .errors import InputError
from .naming import shown

__all__ = ["as_flag", "as_items", "as_mapping", "as_path", "as_text",
           "why_unwritable"]


def as_path(name: str, value: Any, example: str) -> Path:
    """Return the path of a file or folder.

    Raises
    ------
    InputError
        For what is neither text nor a path, and for names that no file can have.
    """
    usable = isinstance(value, (str, os.PathLike))
    try:
        path = Path(value) if usable else Path()
        usable = usable and bool(path.name) and b"\0" not in os.fsencode(path)
    except (TypeError, UnicodeError):  # a PathLike of bytes; half a character
        usable = False
    if not usable:
        raise InputError(f"{name} = {shown(value)} is no file name; give one such as {example!r}.")
    return path


def why_unwritable(path: Path, error: Exception) -> str:
    """Return why a file could not be written, with the cure where its folder is missing."""
    if not path.parent.is_dir():
        return (f"there is no folder {str(path.parent)!r}; make it, as with "
                f"pathlib.Path({str(path.parent)!r}).mkdir(parents=True), or choose another")
    return str(getattr(error, "strerror", None) or error)


def as_flag(name: str, value: Any) -> bool:
    """Return True or False.

    Raises
    ------
    InputError
    """
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(f"{name} = {shown(value)} is neither True nor False.")
    return bool(value)


def as_mapping(name: str, value: Any, example: str) -> dict[str, Any]:
    """Return a dict whose keys are names.

    Raises
    ------
    InputError
    """
    if not isinstance(value, Mapping):
        raise InputError(f"{name} = {shown(value)} is no dict; give one such as {example}.")
    for key in value:
        if not isinstance(key, str):
            raise InputError(f"{name} has the key {shown(key)}, which is no name; write text.")
    return dict(value)


def as_text(name: str, value: Any) -> str:
    """Return a text.

    Raises
    ------
    InputError
    """
    if not isinstance(value, str):
        raise InputError(f"{name} = {shown(value)} is no text; write it in quotes.")
    return value


def as_items(name: str, value: Any, what: str) -> list[Any]:
    """Return the items of a list, a tuple or another row; text is none.

    Raises
    ------
    InputError
    """
    items = None
    if isinstance(value, Iterable) and not isinstance(value, (str, bytes, Mapping)):
        items = list(value)
    if items is None:
        raise InputError(f"{name} = {shown(value)} is no list of {what}.")
    return items
