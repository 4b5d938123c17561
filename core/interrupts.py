"""Ctrl-C and the end a cluster asks for: finish what is begun, then stop."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any

from .errors import Stopped

__all__ = ["Interrupts", "before_start", "catch_ctrl_c", "catch_signals", "catch_termination"]

#: Ctrl-C, the end that a batch system announces, the terminal that goes away.
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")


class Interrupts:
    """Whether a signal has asked this process to end."""

    def __init__(self) -> None:
        self.signal = 0

    @property
    def is_requested(self) -> bool:
        """Whether a signal has come."""
        return self.signal != 0

    def handle(self, number: int, frame: FrameType | None) -> None:
        """Record a signal; the second one ends the process at once."""
        if self.is_requested:
            raise KeyboardInterrupt
        self.signal = number


#: The record in use in the main thread: nested calls share it.
_active: list[Interrupts] = []


def catch_signals() -> contextlib.AbstractContextManager[Interrupts]:
    """Yield a record of the signals that end a process; other threads than the main one see none.

    Signals that are ignored (nohup, a shell's background) stay ignored. A second one raises
    ``KeyboardInterrupt``: stored rows stay complete.
    """
    numbers = [getattr(signal, name) for name in _SIGNALS if hasattr(signal, name)]
    return _handling([n for n in numbers if signal.getsignal(n) is not signal.SIG_IGN])


def catch_ctrl_c() -> contextlib.AbstractContextManager[Interrupts]:
    """Yield a record of Ctrl-C, where Python would raise ``KeyboardInterrupt``.

    A program that has its own way with signals keeps it.
    """
    is_foreign = signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    return _handling([] if is_foreign else [signal.SIGINT])


@contextlib.contextmanager
def catch_termination() -> Iterator[None]:
    """Let SIGTERM end a command as an exception does, so that incomplete files are removed."""
    # shells report a program that a signal ended by 128 + its number
    before = signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def before_start(subject: str) -> Iterator[None]:
    """Let Ctrl-C during pilot runs end a call that has not begun, without a pilot's trajectory."""
    try:
        yield
    except Stopped as stopped:
        raise Stopped(f"Stopped before the first step, while {subject} was chosen.", stopped.signal
                      ) from None


@contextlib.contextmanager
def _handling(numbers: list[int]) -> Iterator[Interrupts]:
    """Yield interrupts of the signals with these numbers, which are restored at the end.

    Within an outer call they are its interrupts; outside the main thread there are none.
    """
    if threading.current_thread() is not threading.main_thread():
        yield Interrupts()
        return
    if _active:
        yield _active[-1]
        return
    interrupts, before = Interrupts(), dict[int, Any]()
    try:
        _active.append(interrupts)
        for number in numbers:
            before[number] = signal.signal(number, interrupts.handle)
        yield interrupts
    finally:
        _active.clear()
        for number, handler in reversed(before.items()):  # Ctrl-C last: it may be on its way
            signal.signal(number, handler)
