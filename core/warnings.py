"""Warnings about accepted but suspicious input, at the line of the caller's own code."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from .errors import InputWarning

__all__ = ["capture_warnings", "warn"]

# ``warnings.catch_warnings`` replaces a function of the whole process, and models are read and
# certificates made in several threads at once: a capture is of its own context.
_CAPTURED: ContextVar[list[str] | None] = ContextVar("captured", default=None)


def warn(message: str) -> None:
    """Issue an ``InputWarning`` at the first line outside of gyrospark, or add to a capture."""
    captured = _CAPTURED.get()
    if captured is not None:
        captured.append(message)
        return
    level, frame = 1, sys._getframe(0)
    # these of the standard library call functions of the package for it
    inside = __name__.partition(".")[0], "contextlib", "functools"
    while frame.f_back is not None and (
            frame.f_globals.get("__name__", "").partition(".")[0] in inside):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, InputWarning, stacklevel=level)


@contextmanager
def capture_warnings() -> Iterator[list[str]]:
    """Yield a list of the messages that ``warn`` gets in this context, which are not
    issued."""
    captured: list[str] = []
    token = _CAPTURED.set(captured)
    try:
        yield captured
    finally:
        _CAPTURED.reset(token)
