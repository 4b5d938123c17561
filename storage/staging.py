"""How a store comes to be: under another name, until it is whole."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from ..core.errors import InputError, StorageError
from .durable_files import sync_folder

__all__ = ["appearing", "claim", "is_new", "lock_file"]

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


def lock_file(store: Path) -> Path:
    """Return where a store's lock lies: beside it, for a Zarr folder holds arrays alone.

    Beside the folder itself, by whatever links it was reached.
    """
    real = Path(os.path.realpath(store))
    return real.with_name(f".{real.name}.lock")


@contextlib.contextmanager
def claim(store: Path) -> Iterator[None]:
    """Hold the lock of a store.

    Raises
    ------
    StorageError
        If another process, or another run of this one, is at it; if no lock can be made there.
    """
    lock = FileLock(lock_file(store), thread_local=False)
    try:
        lock.acquire(timeout=0)
    except Timeout as error:
        raise StorageError(
            f"Another process is writing to {str(store)!r}; wait for its end, or choose another "
            "store. A process that has died holds no lock."
        ) from error
    except OSError as error:
        raise StorageError(
            f"The store {str(store)!r} cannot be written: its lock {str(lock_file(store))!r} "
            f"cannot be made, {error.strerror or error}. Choose a folder that can be written."
        ) from error
    try:
        yield
    finally:
        if not store.exists():  # it could not be made: nothing hidden stays in its place
            lock_file(store).unlink(missing_ok=True)
        lock.release()
