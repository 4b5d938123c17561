"""What is said of an input that is taken, and was perhaps meant otherwise.

A remark becomes an ``InputWarning`` at the caller's own line. Whoever reads a file listens to the
remarks instead: to say in which place of the file they belong, and to say them again when the file
is known from an earlier time.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from .errors import InputWarning

__all__ = ["listening", "remark"]

_HEARD: ContextVar[list[str] | None] = ContextVar("heard", default=None)


def remark(message: str) -> None:
    """Say a sentence about an input, to whoever listens or else as a warning."""
    heard = _HEARD.get()
    if heard is not None:
        heard.append(message)
        return
    level, frame = 1, sys._getframe(0)
    while frame.f_back is not None and _is_ours(frame.f_globals.get("__name__", "")):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, InputWarning, stacklevel=level)


def _is_ours(module: str) -> bool:
    return module.partition(".")[0] == __name__.partition(".")[0]


@contextmanager
def listening() -> Iterator[list[str]]:
    """Yield a list that the remarks of this thread go to until the end."""
    heard: list[str] = []
    token = _HEARD.set(heard)
    try:
        yield heard
    finally:
        _HEARD.reset(token)
