"""Imports of large packages without garbage collection, for the command line.

SymPy makes some hundred thousand objects, and Python's collector goes through them again and again
while they are made, and once more at the end of the program: a quarter of what a short command
takes.
"""

from __future__ import annotations

import contextlib
import gc
import sys
from collections.abc import Iterator

__all__ = ["imported_for_good"]


@contextlib.contextmanager
def imported_for_good(module: str) -> Iterator[None]:
    """Keep the collector from what a ``with`` block imports: all objects that are there at its end.

    Nothing happens if ``module`` was imported before. For commands alone: other programs have
    objects that must be collected.
    """
    if module in sys.modules or not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.freeze()  # moves all objects to a generation that is never collected
