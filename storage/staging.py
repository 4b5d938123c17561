"""Creation of stores, and their lock: one writer per store.

A store is made under another name and renamed when it is complete. The lock is one of the operating
system, which ends with the process that holds it.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from ..core.errors import InputError, StorageError
from .durable_files import sync_folder

__all__ = ["created_atomically", "is_new", "lock_file", "writer_lock"]

def is_new(path: Path, resume: bool, holds: str) -> bool:
    """Return whether the store is new; an existing store is resumed.

    Raises InputError if a store exists and ``resume`` is false; ``holds`` names its content in the
    message.
    """
    if path.exists() and not resume:
        raise InputError(f"The store {str(path)!r} exists already; --resume (resume=True) goes "
                         f"on with its {holds}, another name begins a new one.")
    return not path.exists()


@contextlib.contextmanager
def created_atomically(path: Path) -> Iterator[Path]:
    """Yield the name of a new folder, which is then renamed to ``path``, or to its link's target.

    On errors the folder is removed.
    """
    real = Path(os.path.realpath(path))
    new_folder = real.with_name(f".{real.name}.new")
    if new_folder.exists():  # of a process that was killed: the caller has the lock
        shutil.rmtree(new_folder)
    try:
        yield new_folder
        new_folder.rename(real)
    except BaseException:
        shutil.rmtree(new_folder, ignore_errors=True)
        raise
    sync_folder(real.parent)


def lock_file(store: Path) -> Path:
    """Return the path of a store's lock: next to it, as a Zarr folder holds arrays only.

    Next to the folder itself, for any links to it.
    """
    real = Path(os.path.realpath(store))
    return real.with_name(f".{real.name}.lock")


@contextlib.contextmanager
def writer_lock(store: Path) -> Iterator[None]:
    """Hold the lock of a store.

    Raises StorageError if another process, or another run of this one, has it; if no lock can be
    made there.
    """
    lock = FileLock(lock_file(store), thread_local=False)
    try:
        lock.acquire(timeout=0)
    except (Timeout, OSError) as error:
        # FileLock waits for some files that cannot be made as if a process held them.
        if isinstance(error, Timeout) and lock_file(store).exists():
            raise StorageError(
                f"Another process is writing to {str(store)!r}; wait for its end, or choose "
                "another store. A process that has died holds no lock.") from error
        raise StorageError(
            f"The store {str(store)!r} cannot be written: its lock {str(lock_file(store))!r} "
            f"cannot be made, {getattr(error, 'strerror', None) or 'the file system has none'}. "
            "Choose a folder that can be written.") from error
    try:
        yield
    finally:
        if not store.exists():  # it could not be made: nothing hidden stays in its place
            lock_file(store).unlink(missing_ok=True)
        lock.release()
