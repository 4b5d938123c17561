"""Progress messages: records of the logger ``gyrospark``, and a handler that shows them.

A task that takes seconds logs its begin at level DEBUG and its result, with the time it took, at
INFO. ``TerminalHandler`` shows the task under way on stderr, if that is a terminal: installed by
the command line, and in an interactive Python by the first task. Scripts, pipes, notebooks and
``--json`` show nothing; a program that wants the messages adds a handler of its own.
"""

from __future__ import annotations

import contextlib
import logging
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

__all__ = ["TERMINAL", "hide_tasks", "log_task", "terminal_messages"]

_LOGGER = logging.getLogger("gyrospark")


class TerminalHandler(logging.Handler):
    """Shows the innermost task under way in the main thread; ``results`` are printed, too."""

    results = False

    def __init__(self) -> None:
        super().__init__()
        self._tasks: list[str] = []
        self._status: Any = None

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether somebody reads a record of a task."""
        return (hasattr(record, "task") and sys.stderr is not None and sys.stderr.isatty()
                and record.thread == threading.main_thread().ident)

    def emit(self, record: logging.LogRecord) -> None:
        """Show a task that begins; at its end the one around it, or the result."""
        if record.task == "begin":  # type: ignore[attr-defined]
            self._tasks.append(record.getMessage())
        elif self._tasks:
            self._tasks.pop()
        if self._tasks:
            self._show(self._tasks[-1])
        elif self._status is not None:
            self._status.stop()
            if self.results and record.levelno >= logging.INFO:
                self._status.console.print(record.getMessage(), markup=False)
            self._status = None

    def _show(self, text: str) -> None:
        from rich.console import Console
        from rich.text import Text  # a path may have brackets, which are no style

        if self._status is None:
            self._status = Console(stderr=True, highlight=False).status("")
            self._status.start()
        self._status.update(Text(text))


TERMINAL = TerminalHandler()


@contextlib.contextmanager
def log_task(text: str, done: str = "") -> Iterator[None]:
    """Log that a task begins, and when it is ``done`` how long it took."""
    if hasattr(sys, "ps1") and not _LOGGER.handlers:
        _LOGGER.addHandler(TERMINAL)
        _LOGGER.setLevel(logging.DEBUG)
    start, level, result = time.perf_counter(), logging.DEBUG, f"{text}: ended"
    _LOGGER.debug("%s …", text, extra={"task": "begin"})
    try:
        yield
        if done:
            level, result = logging.INFO, f"{done} in {time.perf_counter() - start:.1f} s"
    finally:
        _LOGGER.log(level, "%s", result, extra={"task": "end"})


@contextlib.contextmanager
def terminal_messages() -> Iterator[None]:
    """Show tasks and results within: for the command line."""
    before = _LOGGER.level, TERMINAL.level
    TERMINAL.results = True
    TERMINAL.setLevel(logging.NOTSET)
    _LOGGER.addHandler(TERMINAL)
    _LOGGER.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        _LOGGER.removeHandler(TERMINAL)
        _LOGGER.setLevel(before[0])
        TERMINAL.setLevel(before[1])
        TERMINAL.results = False


@contextlib.contextmanager
def hide_tasks() -> Iterator[None]:
    """Show no tasks within: a progress bar is there already."""
    before = TERMINAL.level
    TERMINAL.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        TERMINAL.setLevel(before)
