"""How much stack compiled functions take, and calls on a stack that has as much.

Frames of a step grow with the number of bodies: those of a thousand take 7 MB, where a thread has
8 MB or less. The compiler reports the frame of each function (``-fstack-usage``). No function calls
itself, so that the sum over all functions of a module bounds what any call takes; it is recorded
beside the module. A call that may not fit runs in a thread of its own, with a stack that is large
enough. Memory of a stack is taken where it is used.
"""

from __future__ import annotations

import contextvars
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

if sys.platform != "win32":
    import resource

__all__ = ["FLAGS", "frames_of", "on_large_stack", "thread_seconds"]

#: Has the compiler write the frame of each function beside an object.
FLAGS = ["-fstack-usage"]
#: Factor for Newton's method, whose frames have numbers where the iteration has lanes; and bytes
#: that Python itself takes.
_MORE, _PYTHON = 1.25, 2**20
#: Calls that take less fit anywhere.
_SMALL = 2**18
#: Stacks of threads are multiples of it.
_PAGE = 2**16
_starting = threading.Lock()
#: CPU seconds of the calls that this thread has made on large stacks.
_elsewhere = threading.local()


def frames_of(folder: Path) -> int | None:
    """Return the sum over the functions of the objects in a folder; None if it is not known."""
    lines = [line for file in folder.glob("*.su") for line in file.read_text(
        encoding="utf-8", errors="replace").splitlines()]
    return sum(int(line.rsplit("\t", 2)[1]) for line in lines) if lines else None


def thread_seconds() -> float:
    """Return the CPU seconds of this thread and of its calls on large stacks."""
    return time.thread_time() + float(getattr(_elsewhere, "seconds", 0.0))


def on_large_stack(function: Callable[..., Any], frames: int) -> Callable[..., Any]:
    """Return a compiled function that runs in a thread with a large stack if it needs one.

    ``frames`` is the number of bytes that its calls take at most.
    """
    if frames < _SMALL:
        return function

    def call(*arguments: Any) -> Any:
        """Call the function in this thread, or in one with a larger stack if it may not fit."""
        if _MORE * frames <= _available() - _PYTHON:
            return function(*arguments)
        return _in_thread(function, arguments, int(_MORE * frames) + _PYTHON)

    return call


def _available() -> int:
    """Return the size of the stack of this thread in bytes, or the least that it may have."""
    if sys.platform == "win32":
        return 2**20
    limit = resource.getrlimit(resource.RLIMIT_STACK)[0]
    # without a limit glibc gives threads 2 MB; other C libraries do not go by the limit
    limit = 2**21 if limit == resource.RLIM_INFINITY else limit
    if threading.current_thread() is threading.main_thread():
        return limit
    is_glibc = str(sys.thread_info.version).startswith("NPTL")
    return threading.stack_size() or (limit if is_glibc else 2**19)


def _in_thread(function: Callable[..., Any], arguments: tuple[Any, ...], size: int) -> Any:
    """Call a function in a thread with a larger stack; return its result or raise its error.

    An interrupt waits for its end, as it does for a compiled function in the main thread.
    """
    results: list[Any] = []
    raised: list[BaseException] = []
    seconds: list[float] = []
    context = contextvars.copy_context()

    def run() -> None:
        """Keep the result of the function, or the exception, and the CPU time of the thread."""
        try:
            results.append(context.run(function, *arguments))
        except BaseException as error:
            raised.append(error)
        seconds.append(time.thread_time())

    thread = threading.Thread(target=run, daemon=True)
    # the size for new threads is a setting of the process: no other call may start one meanwhile
    with _starting:
        before = threading.stack_size(-(-size // _PAGE) * _PAGE)  # rounded up to whole pages
        try:
            thread.start()
        finally:
            threading.stack_size(before)
    while thread.is_alive():
        try:
            thread.join()
        except KeyboardInterrupt as interrupt:
            raised.append(interrupt)
    _elsewhere.seconds = getattr(_elsewhere, "seconds", 0.0) + seconds[0]
    if raised:
        raise raised[0]
    return results[0]
