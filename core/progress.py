"""Progress messages: records of the logger ``gyrospark``, and a handler that shows them.

A task that takes seconds logs its begin at level DEBUG and its result, with the time it took, at
INFO; one with steps logs the share that is done. ``TerminalHandler`` shows the task under way on
stderr, if that is a terminal, or below the cell of a Jupyter notebook: installed by the command
line, and in an interactive Python or a notebook by the first task. Scripts, pipes and ``--json``
show nothing; a program that wants the messages adds a handler of its own.
"""

from __future__ import annotations

import contextlib
import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator
from datetime import timedelta
from importlib import import_module
from typing import Any

from .arguments import shown
from .errors import InputError

__all__ = ["TERMINAL", "Progress", "as_progress", "hide_tasks", "log_progress", "log_stages",
           "log_task", "terminal_messages"]

_LOGGER = logging.getLogger("gyrospark")
#: A function that is called with the steps or cells done; whether progress is shown.
Progress = Callable[..., Any] | bool | None
#: Seconds until a task with steps is shown, and between two numbers of it; on a stderr that is no
#: terminal every number is a line.
_FIRST, _NEXT, _NEXT_LINE = 1.0, 0.2, 10.0
#: Seconds to the end of a task that are shown; more are those of a task without an end.
_SOON, _FAR = 5.0, 1e8


class _Status:
    """A line on a terminal, which the next text takes the place of."""

    def __init__(self) -> None:
        """Start the spinner of a terminal; rich is imported here, as it takes a tenth of a second.
        """
        from rich.console import Console

        self._status = Console(stderr=True, highlight=False).status("")
        self._status.start()

    def show(self, text: str) -> None:
        """Show a text in place of the last one."""
        from rich.text import Text  # a path may have brackets, which are no style

        self._status.update(Text(text))

    def end(self, result: str) -> None:
        """Remove the line; print a result, unless it is empty."""
        self._status.stop()
        if result:
            self._status.console.print(result, markup=False)


class _Cell:
    """A text below the cell of a notebook, which the next text takes the place of."""

    def __init__(self) -> None:
        display = import_module("IPython.display").display
        self._handle = display({"text/plain": ""}, raw=True, display_id=True)

    def show(self, text: str) -> None:
        """Show a text in place of the last one."""
        self._handle.update({"text/plain": text}, raw=True)

    end = show


class _Lines:
    """Lines on a stderr that is no terminal, for ``progress=True``."""

    def show(self, text: str) -> None:
        """Print a text."""
        print(text, file=sys.stderr, flush=True)

    def end(self, result: str) -> None:
        """Print a result, unless it is empty."""
        if result:
            self.show(result)


def _is_notebook() -> bool:
    """Whether this is the kernel of a Jupyter notebook."""
    shell = import_module("IPython").get_ipython() if "ipykernel" in sys.modules else None
    return getattr(shell, "kernel", None) is not None


def _is_terminal() -> bool:
    """Whether stderr is a terminal; a program may have none."""
    return sys.stderr is not None and sys.stderr.isatty()


class TerminalHandler(logging.Handler):
    """Shows the innermost task under way in the main thread; ``results`` are printed, too.

    With ``asked``, for ``progress=True``, tasks are shown on a stderr that is no terminal, too.
    """

    results = False
    asked = False

    def __init__(self) -> None:
        super().__init__()
        self._tasks: list[str] = []
        self._display: _Status | _Cell | _Lines | None = None

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether somebody reads a record of a task."""
        return (hasattr(record, "task") and record.thread == threading.main_thread().ident
                and (_is_terminal() or _is_notebook() or (self.asked and sys.stderr is not None)))

    def emit(self, record: logging.LogRecord) -> None:
        """Show a task that begins or advances; at its end the enclosing task, or the result."""
        task = record.task  # type: ignore[attr-defined]
        if task == "end":
            del self._tasks[-1:]
        else:  # tasks are nested: "begin" adds a text, "step" replaces that of the innermost
            self._tasks[len(self._tasks) - (task == "step"):] = [record.getMessage()]
        if self._tasks:
            if self._display is None:
                self._display = _new_display()
            self._display.show(self._tasks[-1])
        elif self._display is not None:
            printed = self.results and record.levelno >= logging.INFO
            self._display.end(record.getMessage() if printed else "")
            self._display = None


def _new_display() -> _Status | _Cell | _Lines:
    """Return the display of tasks: of a notebook, of a terminal, or lines on another stderr."""
    if _is_notebook():
        return _Cell()
    return _Status() if _is_terminal() else _Lines()


TERMINAL = TerminalHandler()


def _install() -> None:
    """Show tasks from now on where a person sees them as they run."""
    if not _LOGGER.handlers and (hasattr(sys, "ps1") or _is_notebook()):
        _LOGGER.addHandler(TERMINAL)
        _LOGGER.setLevel(logging.DEBUG)


@contextlib.contextmanager
def log_task(text: str, done: str = "") -> Iterator[None]:
    """Log the start of a task, and at its end ``done`` with the duration."""
    _install()
    start, level, message = time.perf_counter(), logging.DEBUG, f"{text}: ended"
    _LOGGER.debug("%s …", text, extra={"task": "begin"})
    try:
        yield
        if done:
            level, message = logging.INFO, f"{done} in {time.perf_counter() - start:.1f} s"
    finally:
        _LOGGER.log(level, "%s", message, extra={"task": "end"})


def as_progress(progress: Any) -> Progress:
    """Return the argument ``progress``: a function, a bool or None, or raise InputError."""
    if progress is not None and not isinstance(progress, bool) and not callable(progress):
        raise InputError(f"progress = {shown(progress)} cannot be called; give True, False, or a "
                         "function that takes the number of steps (or cells) done, such as print.")
    callback: Progress = progress
    return callback


def log_progress(
    text: str, total: int, progress: Progress = None
) -> contextlib.AbstractContextManager[Callable[..., Any] | None]:
    """Yield the function that a task is to call with the steps done, or None.

    Parameters
    ----------
    text : str
        The task.
    total : int
        All its steps.
    progress : callable or bool, optional
        Of the caller: a function is yielded as it is; True shows the share that is done. With False
        and with a function nothing is shown, tasks within included. By default it is shown on the
        command line, in an interactive Python and in a notebook, after a second.

    Raises
    ------
    InputError
        For any other value.
    """
    if progress is None:
        _install()
        if not _LOGGER.isEnabledFor(logging.DEBUG):
            return contextlib.nullcontext()  # as of most calls, whose steps take less time
    return _log_progress(text, total, progress)


@contextlib.contextmanager
def _log_progress(text: str, total: int, progress: Progress) -> Iterator[Callable[..., Any] | None]:
    """Yield the function of ``log_progress``: the caller's own, one that logs, or None."""
    as_progress(progress)
    if callable(progress) or progress is False:
        with hide_tasks():
            yield progress or None
        return
    with terminal_messages(explicit=True) if progress else contextlib.nullcontext():
        _install()
        if not _LOGGER.isEnabledFor(logging.DEBUG):
            yield None
            return
        messages = _ShareMessages(text, total)
        try:
            yield messages.report
        finally:
            messages.end()


class _ShareMessages:
    """Log messages on the share of a task that is done, with the time left."""

    def __init__(self, text: str, total: int) -> None:
        """Begin the task ``text`` of ``total`` steps; the first message is due after a second."""
        self._text, self._total = text, total
        self._start = time.perf_counter()
        self._due = self._start + _FIRST
        self._has_begun = False
        #: The steps of earlier calls, which a resumed task reports first; None before it does.
        self._steps_before: int | None = None

    def report(self, done: int, *_: Any) -> None:
        """Log the share of ``done`` steps, at intervals, from the main thread alone.

        The time left is (total − done) · seconds so far/steps since the start.
        """
        now = time.perf_counter()
        if self._steps_before is None:  # they say nothing about the speed of this call
            self._steps_before = done
        # the handler shows tasks of the main thread alone: others would mix with them
        if now < self._due or threading.current_thread() is not threading.main_thread():
            return
        self._due = now + (_NEXT if _is_terminal() or _is_notebook() else _NEXT_LINE)
        seconds_left = 0.0
        if done > self._steps_before:
            seconds_a_step = (now - self._start) / (done - self._steps_before)
            seconds_left = (self._total - done) * seconds_a_step
        time_left = (f", {timedelta(seconds=round(seconds_left))} left"
                     if _SOON <= seconds_left < _FAR else "")
        _LOGGER.debug("%s: %.0f %%%s …", self._text, 100 * done / max(self._total, 1), time_left,
                      extra={"task": "step" if self._has_begun else "begin"})
        self._has_begun = True

    def end(self) -> None:
        """Log the end of the task, if a message has shown its begin."""
        if self._has_begun:
            _LOGGER.debug("%s: ended", self._text, extra={"task": "end"})


@contextlib.contextmanager
def log_stages(text: str, total: int, progress: Progress) -> Iterator[Callable[[], None]]:
    """Yield a function that a task calls after each of its stages; see ``log_progress``.

    A function of the caller is called with the number of stages done, and of all.
    """
    done = 0
    with log_progress(text, total, progress) as report:
        def end_stage() -> None:
            """Count a stage as done, and report it."""
            nonlocal done
            done += 1
            if report is not None:
                report(done, total)

        yield end_stage


@contextlib.contextmanager
def terminal_messages(*, explicit: bool = False) -> Iterator[None]:
    """Write the messages of tasks and of results to stderr inside a ``with`` block.

    ``explicit`` is for ``progress=True`` of a call: results are not written, tasks also if stderr
    is no terminal. The state before is restored afterwards.
    """
    # calls may be nested: each restores what it has changed
    before = _LOGGER.level, TERMINAL.level, TERMINAL.results, TERMINAL.asked
    is_attached = TERMINAL in _LOGGER.handlers
    TERMINAL.results, TERMINAL.asked = TERMINAL.results or not explicit, TERMINAL.asked or explicit
    TERMINAL.setLevel(logging.NOTSET)
    _LOGGER.addHandler(TERMINAL)
    _LOGGER.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        if not is_attached:
            _LOGGER.removeHandler(TERMINAL)
        _LOGGER.setLevel(before[0])
        TERMINAL.setLevel(before[1])
        TERMINAL.results, TERMINAL.asked = before[2:]


@contextlib.contextmanager
def hide_tasks() -> Iterator[None]:
    """Show no tasks within: a progress bar is there already."""
    if threading.current_thread() is not threading.main_thread():  # whose tasks are not shown
        yield
        return
    before = TERMINAL.level
    TERMINAL.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        TERMINAL.setLevel(before)
