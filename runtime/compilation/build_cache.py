"""The cache of generated sources and compiled modules.

A file appears under its final name only when it is complete (``os.replace`` from a private
folder), so a killed build leaves nothing that a later one could trip over, and any number of
processes may build the same stepper at once without a lock: the last one wins with equal bytes.

Modules are loaded and sources compiled, so what is read here is code. It is read only where no
other user can have written it (``untrusted_writers``), and only folders that carry our own mark are
removed (``_remove_stale``).
"""

from __future__ import annotations

import atexit
import contextlib
import errno
import functools
import hashlib
import json
import os
import platform
import re
import shlex
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cffi
import platformdirs

from ...core.errors import GyrosparkError
from ...core.warnings import warn
from . import call_stack, kernel_check, kernel_text, newton_library, object_files, quad_wrapper
from .compiler import SPEED_FLAGS, STRICT_FLAGS, WRAPPER_FLAGS, Compiler, extension_suffix
from .object_files import ModuleKind

__all__ = [
    "CacheError",
    "binary_key",
    "build_folder",
    "cache_folder",
    "is_trusted",
    "publish",
    "read_cache",
    "untrusted_writers",
    "write_cache",
]

#: A build's folder of this age is what a killed build left: each build removes such folders.
_STALE_SECONDS = 24 * 3600
#: No build takes so long; ``clear`` takes it for ended.
_ENDED_SECONDS = 3600
#: Names of finished files. Nothing else is listed or removed, whatever folder the user chose.
_ENTRY = re.compile(r"\w+-[0-9a-f]{32}\.(source\.json|[\w.-]*(so|pyd)(\.json|\.sha256)?)")
#: Name of a build's private folder, and the file in it, written first, that says whose it is.
_BUILD, _BUILD_NAME = "gyrospark-build-", re.compile(r"gyrospark-build-\w{8}")
_MARK, _MARKED = ".gyrospark-build", "A build of gyrospark; removed when it is older than a day.\n"


class CacheError(GyrosparkError):
    """The cache folder cannot be used."""


#: Folders that cannot be used → what this process uses in their place.
_IN_PLACE: dict[Path, Path] = {}


def cache_folder() -> Path:
    """Return the cache folder: ``GYROSPARK_CACHE``, else the platform's place for caches."""
    folder_name = os.environ.get("GYROSPARK_CACHE")
    folder = Path(folder_name) if folder_name else Path(platformdirs.user_cache_dir("gyrospark"))
    return _IN_PLACE.get(folder, folder)


def _usable(folder: Path) -> Path:
    """Return the folder if files can be made in it, and by no other user; else a temporary one.

    A temporary folder comes with a warning, and serves this process until it ends. A full disk
    raises an error where room is needed.
    """
    try:
        if not folder.is_dir():
            folder.parent.mkdir(parents=True, exist_ok=True)
            folder.mkdir(mode=0o700, exist_ok=True)
        why = untrusted_writers(folder)
        cure = (f"a folder that only you can write to, or chown and chmod go-w "
                f"{shlex.quote(str(folder))}")
        if not why:
            # permissions do not tell whether files can be made: a folder that is made does
            with tempfile.TemporaryDirectory(prefix=_BUILD, dir=folder):
                return folder
    except OSError as error:
        if error.errno == errno.ENOSPC:
            raise
        why, cure = error.strerror or str(error), "a folder that can be written"
    temporary = Path(tempfile.mkdtemp(prefix="gyrospark-"))
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    _IN_PLACE[folder] = temporary
    warn(f"The cache folder {str(folder)!r} cannot be used: {why}. What is compiled is kept in "
         f"{str(temporary)!r} until this process ends; set GYROSPARK_CACHE to {cure}.")
    return temporary


def digest(content: Any) -> str:
    """Return a hash of anything JSON can hold."""
    text = json.dumps(content, sort_keys=True, ensure_ascii=False)
    # 128 bits: no two contents share them, and names of files stay short
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def binary_key(files: dict[str, str], compiler: Compiler, module_kind: ModuleKind = "runs") -> str:
    """Return a hash of everything that changes the binary."""
    return digest(
        {
            # as JSON they would take eight times as long
            "files": {name: hashlib.sha256(text.encode()).hexdigest()
                      for name, text in files.items()},
            "part": module_kind,
            "made by": _own_sources(),
            "command": compiler.command,
            "version": compiler.version,
            "flags": [compiler.flags, compiler.lower_flags, compiler.link_flags, STRICT_FLAGS,
                      SPEED_FLAGS, WRAPPER_FLAGS],
            "cpu": cpu_description(),
            "python": extension_suffix(),
            "cffi": cffi.__version__,
        }
    )


@functools.cache
def _own_sources() -> str:
    """Return a hash of the modules here that decide what is compiled of a text."""
    return digest([Path(str(module.__file__)).read_text(encoding="utf-8")
                   for module in (call_stack, kernel_check, kernel_text, newton_library,
                                  object_files, quad_wrapper)])


@functools.cache
def cpu_description() -> str:
    """Return the CPU's model and features, which ``-march=native`` depends on."""
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        prefixes = ("model name", "flags", "Features", "CPU part")
        return "\n".join(sorted({line for line in lines if line.startswith(prefixes)}))
    return f"{platform.machine()} {platform.processor()}"


def untrusted_writers(path: Path) -> str:
    """Return the other users who could write or replace a file or folder; "" for none.

    As for keys of ssh: it belongs to this user or to root, and neither group nor others may write
    to it. A sticky folder such as /tmp may be writable, since the files of one user in it cannot be
    replaced by another; of the folders above, only the permissions for all users count. A link is
    not trusted.
    Windows has neither owners nor modes of this kind.
    """
    if os.name == "nt":
        return ""
    status = path.lstat()
    is_file = not path.is_dir()
    if is_file and not stat.S_ISREG(status.st_mode):
        return f"{str(path)!r} is a link"
    if not is_file:
        path = path.resolve()
        status = path.stat()
        # who may write to a folder above could put another folder in place of this one
        for above in path.parents:
            mode = above.stat().st_mode
            if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
                return f"everybody may write to {str(above)!r}, which it is in"
    if status.st_uid not in (os.geteuid(), 0):
        return f"{str(path)!r} belongs to user {status.st_uid}, and this is user {os.geteuid()}"
    sticky = status.st_mode & stat.S_ISVTX and not is_file
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not sticky:
        return f"other users may write to {str(path)!r}"
    return ""


def is_trusted(path: Path) -> bool:
    """Whether no other user can have written a file of the cache, or its folder."""
    return not (untrusted_writers(path.parent) or untrusted_writers(path))


@contextlib.contextmanager
def build_folder() -> Iterator[Path]:
    """Yield a private folder inside the cache, removed afterwards.

    Raises CacheError if the cache folder is full, or can no longer be written.
    """
    folder = cache_folder()
    try:
        folder = _usable(folder)
        _remove_stale(folder, _STALE_SECONDS)
        # inside the cache: os.replace, by which files are published, keeps to one file system
        with tempfile.TemporaryDirectory(prefix=_BUILD, dir=folder) as private:
            (Path(private) / _MARK).write_text(_MARKED, encoding="ascii")
            yield Path(private)
    except OSError as error:
        raise CacheError(f"The cache folder {str(folder)!r} cannot be used: "
                         f"{error.strerror or error}. Free some space, or set GYROSPARK_CACHE to a "
                         "folder that can be written.") from error


def _remove_stale(folder: Path, seconds: float) -> None:
    """Remove the folders of builds that were killed long ago, not of running ones.

    A folder is a build's if its name, its owner and the mark in it say so: the cache may have been
    set to a folder that is used for something else.
    """
    for build in folder.glob(f"{_BUILD}*"):
        with contextlib.suppress(OSError, ValueError):
            status, mark = build.lstat(), build / _MARK
            if (_BUILD_NAME.fullmatch(build.name) and stat.S_ISDIR(status.st_mode)
                    and time.time() - status.st_mtime > seconds
                    and (os.name == "nt" or status.st_uid == os.geteuid())
                    and stat.S_ISREG(mark.lstat().st_mode)
                    and mark.read_text(encoding="ascii") == _MARKED):
                shutil.rmtree(build, ignore_errors=True)


def publish(file: Path, name: str) -> Path:
    """Move a finished file to its place in the cache, in one step; others may not write to it."""
    target = cache_folder() / name
    file.chmod(stat.S_IMODE(file.stat().st_mode) & ~(stat.S_IWGRP | stat.S_IWOTH))
    file.replace(target)
    return target


def _checksum_of(text: bytes) -> bytes:
    """Return the SHA-256 of a text in hexadecimal digits."""
    return hashlib.sha256(text).hexdigest().encode()


def write_cache(name: str, content: Any) -> None:
    """Cache a JSON value under a name, behind a line with its checksum."""
    text = json.dumps(content).encode()
    with build_folder() as folder:
        file = folder / "content.json"
        file.write_bytes(b"%s\n%s" % (_checksum_of(text), text))
        publish(file, name)


def read_cache(name: str) -> Any:
    """Return the cached value of a name; None if it is missing or damaged.

    A file that other users could have written counts as missing.
    """
    path = cache_folder() / name
    try:
        if not is_trusted(path):
            return None
        checksum, _, text = path.read_bytes().partition(b"\n")
        # a damaged disk changes the text and not its checksum
        return json.loads(text) if checksum == _checksum_of(text) else None
    except (OSError, ValueError, TypeError, RecursionError):
        return None


def entries() -> list[Path]:
    """Return the finished files in the cache.

    Other programs name libraries by hashes too: those of gyrospark have a record beside them, or,
    from older versions, a checksum.
    """
    folder = cache_folder()
    if not folder.is_dir():
        return []
    names = {p.name for p in folder.glob("*") if _ENTRY.fullmatch(p.name) and p.is_file()}
    return sorted(folder / name for name in names
                  if not name.endswith((".so", ".pyd"))
                  or {f"{name}.json", f"{name}.sha256"} & names)


def clear() -> int:
    """Remove everything in the cache and return how many files that were.

    Raises
    ------
    CacheError
        If a file cannot be removed.
    """
    files = entries()
    for path in files:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise CacheError(f"{str(path)!r} cannot be removed: {error.strerror or error}. Change "
                             "the folder's permissions.") from error
    _remove_stale(cache_folder(), _ENDED_SECONDS)
    return len(files)
