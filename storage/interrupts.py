"""Ctrl-C and the end a cluster asks for: finish what is begun, then stop."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

__all__ = ["Interrupts", "watched"]

#: Ctrl-C, the end that a batch system announces, the terminal that goes away.
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")


class Interrupts:
    """Whether someone wants this process to end."""

    def __init__(self) -> None:
        self.signal = 0

    @property
    def asked(self) -> bool:
        """Whether a signal has come."""
        return self.signal != 0

    def hear(self, number: int, frame: FrameType | None) -> None:
        """Take note of a signal; the second one ends the process at once."""
        if self.asked:
            raise KeyboardInterrupt
        self.signal = number


@contextlib.contextmanager
def watched() -> Iterator[Interrupts]:
    """Yield what hears the signals that end a process; in threads beside the main one, nothing.

    Signals that are ignored (nohup, a shell's background) stay ignored. A second one raises
    ``KeyboardInterrupt``: what is stored stays whole.
    """
    interrupts = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield interrupts
        return
    numbers = [getattr(signal, name) for name in _SIGNALS if hasattr(signal, name)]
    before = {number: signal.signal(number, interrupts.hear) for number in numbers
              if signal.getsignal(number) is not signal.SIG_IGN}
    try:
        yield interrupts
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
