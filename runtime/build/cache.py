"""What is kept between runs: generated sources and compiled modules.

A file appears under its final name only when it is complete (``os.replace`` from a private
folder), so a killed build leaves nothing that a later one could trip over, and any number of
processes may build the same stepper at once without a lock: the last one wins with equal bytes.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
import platform
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cffi
import platformdirs

from ...errors import GyrosparkError
from . import objects, permutations, quad_wrapper
from .compiler import SPEED_FLAGS, STRICT_FLAGS, WRAPPER_FLAGS, Compiler, extension_suffix
from .objects import Part

__all__ = ["CacheError", "binary_key", "cache_folder", "keep", "kept", "publish", "workshop"]

_STALE_SECONDS = 24 * 3600
#: No build takes so long; ``clear`` takes it for ended.
_ENDED_SECONDS = 3600
#: Names of finished files. Nothing else is listed or removed, whatever folder the user chose.
_ENTRY = re.compile(r"\w+-[0-9a-f]{32}\.(source\.json|[\w.-]*(so|pyd)(\.sha256)?)")


class CacheError(GyrosparkError):
    """The cache folder cannot be used."""


def cache_folder() -> Path:
    """Return the cache folder: ``GYROSPARK_CACHE``, else the platform's place for caches."""
    chosen = os.environ.get("GYROSPARK_CACHE")
    return Path(chosen) if chosen else Path(platformdirs.user_cache_dir("gyrospark"))


def digest(content: Any) -> str:
    """Return a hash of anything JSON can hold."""
    text = json.dumps(content, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def binary_key(files: dict[str, str], compiler: Compiler, part: Part = "runs") -> str:
    """Return a hash of everything that changes the binary."""
    return digest(
        {
            "files": files,
            "part": part,
            "made by": [Path(str(module.__file__)).read_text(encoding="utf-8")
                        for module in (objects, permutations, quad_wrapper)],
            "command": compiler.command,
            "version": compiler.version,
            "flags": [compiler.flags, compiler.seldom_flags, compiler.link_flags, STRICT_FLAGS,
                      SPEED_FLAGS, WRAPPER_FLAGS],
            "cpu": cpu_description(),
            "python": extension_suffix(),
            "cffi": cffi.__version__,
        }
    )


@functools.cache
def cpu_description() -> str:
    """Return what ``-march=native`` depends on: the CPU's model and features."""
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        wanted = ("model name", "flags", "Features", "CPU part")
        return "\n".join(sorted({line for line in lines if line.startswith(wanted)}))
    return f"{platform.machine()} {platform.processor()}"


@contextlib.contextmanager
def workshop() -> Iterator[Path]:
    """Yield a private folder inside the cache, removed afterwards.

    Raises
    ------
    CacheError
        If the cache folder cannot be written, is full, or becomes so meanwhile.
    """
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _remove_stale(folder, _STALE_SECONDS)
        with tempfile.TemporaryDirectory(prefix="build-", dir=folder) as private:
            yield Path(private)
    except OSError as error:
        raise CacheError(
            f"The cache folder {str(folder)!r} cannot be used: {error.strerror or error}. Free "
            "some space, or set GYROSPARK_CACHE to a folder that can be written."
        ) from error


def _remove_stale(folder: Path, seconds: float) -> None:
    """Remove what builds left that were killed so long ago; running ones are not disturbed."""
    for left in folder.glob("build-*"):
        with contextlib.suppress(OSError):
            if time.time() - left.stat().st_mtime > seconds:
                shutil.rmtree(left, ignore_errors=True)


def publish(made: Path, name: str) -> Path:
    """Move a finished file to its place in the cache, in one step."""
    target = cache_folder() / name
    made.replace(target)
    return target


def keep(name: str, content: Any) -> None:
    """Keep what JSON can hold under a name, with its checksum."""
    with workshop() as folder:
        made = folder / "content.json"
        made.write_text(json.dumps([digest(content), content]), encoding="utf-8")
        publish(made, name)


def kept(name: str) -> Any:
    """Return what was kept under a name; None if it is not there, or not as it was written."""
    try:
        proof, content = json.loads((cache_folder() / name).read_text(encoding="utf-8"))
        return content if proof == digest(content) else None
    except (OSError, ValueError, TypeError, RecursionError):
        return None


def entries() -> list[Path]:
    """Return the finished files in the cache."""
    folder = cache_folder()
    if not folder.is_dir():
        return []
    return sorted(p for p in folder.glob("*") if _ENTRY.fullmatch(p.name) and p.is_file())


def clear() -> int:
    """Remove everything in the cache and return how many files that were.

    Raises
    ------
    CacheError
        If a file cannot be removed.
    """
    found = entries()
    for path in found:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise CacheError(f"{str(path)!r} cannot be removed: {error.strerror or error}. Change "
                             "the folder's permissions.") from error
    _remove_stale(cache_folder(), _ENDED_SECONDS)
    return len(found)
