"""What takes seconds is said while it is done, to people at a terminal and to nobody else.

The command line says it on stderr; so does an interactive Python, where it vanishes when it is
over. Scripts, pipes, notebooks and ``--json`` hear nothing: there the log ``gyrospark`` has it, at
level INFO, for whoever listens.
"""

from __future__ import annotations

import contextlib
import logging
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

__all__ = ["doing", "hush", "hushed", "spoken"]

_LOG = logging.getLogger("gyrospark")


@dataclass
class _Terminal:
    """Who is at the terminal, and what it shows."""

    commands: bool = False  # the command line is at work, and not another program
    hushed: bool = False
    texts: list[str] = field(default_factory=list)
    status: Any = None

    @property
    def listens(self) -> bool:
        """Whether somebody reads what is said now."""
        return (not self.hushed and (self.commands or hasattr(sys, "ps1"))
                and sys.stderr is not None and sys.stderr.isatty()
                and threading.current_thread() is threading.main_thread())

    def begin(self, text: str) -> None:
        """Show that something is being done, in place of what it is a part of."""
        self.texts.append(text)
        if self.status is None:
            from rich.console import Console

            self.status = Console(stderr=True, highlight=False).status("")
            self.status.start()
        self._show()

    def _show(self) -> None:
        from rich.text import Text  # a path may have brackets, which are no style

        self.status.update(Text(f"{self.texts[-1]} …"))

    def end(self, line: str) -> None:
        """Show again what it was a part of; else nothing, and on the command line what was done."""
        self.texts.pop()
        if self.texts:
            self._show()
            return
        self.status.stop()
        if line and self.commands:
            self.status.console.print(line, markup=False)
        self.status = None


_terminal = _Terminal()


@contextlib.contextmanager
def doing(what: str, done: str = "") -> Iterator[None]:
    """Say what is being done, and when it is ``done`` how long it took."""
    shown, began, line = _terminal.listens, time.perf_counter(), ""
    if shown:
        _terminal.begin(what)
    try:
        yield
        if done:
            line = f"{done} in {time.perf_counter() - began:.1f} s"
            _LOG.info("%s", line)
    finally:
        if shown:
            _terminal.end(line)


@contextlib.contextmanager
def spoken() -> Iterator[None]:
    """Let what is done within be said on stderr, if that is a terminal, by the command line."""
    before = _terminal.commands, _terminal.hushed
    _terminal.commands, _terminal.hushed = True, False
    try:
        yield
    finally:
        _terminal.commands, _terminal.hushed = before


def hush() -> None:
    """Say nothing until the command is over."""
    _terminal.hushed = True


@contextlib.contextmanager
def hushed() -> Iterator[None]:
    """Say nothing within: a bar is there already."""
    before, _terminal.hushed = _terminal.hushed, True
    try:
        yield
    finally:
        _terminal.hushed = before
