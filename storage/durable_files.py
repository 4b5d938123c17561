"""A Zarr store on a local disk whose files are whole at every instant.

A file is written under another name, forced to the disk (``fsync``), and then takes its place: a
reader, a killed process or a power cut finds the old bytes or the new ones, never a part.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from zarr.core.buffer import Buffer
from zarr.storage import LocalStore

from ..core.arguments import as_path
from ..core.errors import InputError, StorageError
from ..core.file_formats import ending_of, endings

__all__ = ["DurableStore", "atomic_file", "new_store_path", "one_line", "remove_parts",
           "storage_errors", "store_path", "sync_folder", "write_durably"]

#: Suffix of unfinished files.
_PART = ".part"


class DurableStore(LocalStore):
    """``LocalStore`` that writes through ``write_durably``."""

    async def set(self, key: str, value: Buffer) -> None:
        """Write a file."""
        if not self._is_open:
            await self._open()
        self._check_writable()
        await asyncio.to_thread(self._write, key, value)

    def set_sync(self, key: str, value: Buffer) -> None:
        """Write a file."""
        self._ensure_open_sync()
        self._check_writable()
        self._write(key, value)

    def _write(self, key: str, value: Buffer) -> None:
        """Write a key's bytes so that the file is whole after a crash."""
        path = self.root / key
        at_root = path.parent == self.root
        write_durably(path, value.as_buffer_like(),
                      workshop=_array_folder(self.root) if at_root else None)

    async def set_if_not_exists(self, key: str, value: Buffer) -> None:
        """Write a file unless it is there; there is one writer, see ``staging``."""
        if not (self.root / key).exists():
            await self.set(key, value)

    def with_read_only(self, read_only: bool = False) -> DurableStore:
        """Return the same store, to read only or not."""
        return type(self)(self.root, read_only=read_only)


def _array_folder(root: Path) -> Path | None:
    """Return the folder of some array in a store, None if there is none.

    Unfinished files of the root lie there: readers list the root, and warn of files that they do
    not know.
    """
    if not root.is_dir():
        return None
    return next((folder for folder in root.iterdir() if folder.is_dir()), None)


def write_durably(path: Path, *data: Any, workshop: Path | None = None) -> None:
    """Write a file that is complete or absent, and on the disk when this returns.

    Its content is ``data``, concatenated. The unfinished file is in ``workshop``; see
    ``atomic_file``.
    """
    _make_folder(path.parent)
    with atomic_file(path, workshop) as partial_file, partial_file.open("wb") as file:
        file.writelines(data)


@contextlib.contextmanager
def atomic_file(path: Path, workshop: Path | None = None) -> Iterator[Path]:
    """Yield a temporary name of a file to write, which is then renamed to ``path``.

    The temporary file is in ``workshop``, by default the folder of ``path``, and removed on errors.
    """
    partial_file = (workshop or path.parent) / f".{path.name}.{uuid.uuid4().hex}{_PART}"
    try:
        yield partial_file
        with partial_file.open("rb") as file:
            os.fsync(file.fileno())
        partial_file.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            partial_file.unlink()
        raise
    sync_folder(path.parent)


def _make_folder(folder: Path) -> None:
    """Make a folder and its parents, each on the disk before the next one.

    A folder whose parent is lost in a power cut would be lost as well.
    """
    if folder.is_dir():
        return
    _make_folder(folder.parent)
    folder.mkdir(exist_ok=True)
    sync_folder(folder.parent)


def sync_folder(folder: Path) -> None:
    """Force the entries of a folder to the disk; Windows has no such call, and needs none."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def remove_parts(root: Path) -> None:
    """Remove unfinished files of killed processes. The caller is the store's only writer."""
    for partial_file in root.rglob(f".*{_PART}"):
        partial_file.unlink(missing_ok=True)


def store_path(path: Any) -> Path:
    """Return a caller's path of a store.

    Raises InputError if it is none.
    """
    return as_path("The store", path, "run.zarr")


def new_store_path(path: Any, cure: str) -> Path:
    """Return a caller's path of a store to write, which is a folder and no file.

    Raises InputError, whose message ends with ``cure``, if it ends like a file of states,
    such as .csv or .npz.
    """
    store = store_path(path)
    if ending_of(store) in endings("states"):
        raise InputError(f"out = {str(store)!r} names a file, and a store is a folder; end it in "
                         f".zarr. {cure}")
    return store


def one_line(error: Exception) -> str:
    """Return the message of a library's error as one line."""
    return " ".join(str(error).split()).rstrip(".")


@contextlib.contextmanager
def storage_errors(path: Path, cure: str) -> Iterator[None]:
    """Turn any OSError at a store into a StorageError, whose message ends with ``cure``."""
    try:
        yield
    except OSError as error:
        raise StorageError(f"The store {str(path)!r} cannot be used: {error.strerror or error}. "
                           f"{cure}") from error
