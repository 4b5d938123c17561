"""One writer a store: a lock of the operating system, which ends with the process that holds it."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from ..core.errors import StorageError

__all__ = ["claim", "lock_file"]


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
