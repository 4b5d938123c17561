"""How a store comes to be: under another name, until it is whole."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from ..core.errors import InputError
from .durable_files import sync_folder

__all__ = ["appearing", "is_new"]


def is_new(path: Path, resume: bool, holds: str) -> bool:
    """Return whether a store is to be made; the one that is there is gone on with.

    Raises
    ------
    InputError
        If one is there and nobody said to go on with what it ``holds``.
    """
    if path.exists() and not resume:
        raise InputError(f"The store {str(path)!r} is there already; --resume (resume=True) goes "
                         f"on with its {holds}, another name begins a new one.")
    return not path.exists()


@contextlib.contextmanager
def appearing(path: Path) -> Iterator[Path]:
    """Yield the name of a folder to make, which then becomes ``path``, or what that links to.

    Nothing is left of one that cannot be made.
    """
    real = Path(os.path.realpath(path))
    fresh = real.with_name(f".{real.name}.new")
    if fresh.exists():  # of a process that was killed: the caller has the lock
        shutil.rmtree(fresh)
    try:
        yield fresh
        fresh.rename(real)
    except BaseException:
        shutil.rmtree(fresh, ignore_errors=True)
        raise
    sync_folder(real.parent)
