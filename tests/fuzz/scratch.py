"""A folder for the files that entrances read and write; in memory where the system has that."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from functools import cache
from pathlib import Path

MEMORY = Path("/dev/shm")


@cache
def scratch() -> Path:
    """Return this process's folder; it goes when the process ends."""
    folder = Path(tempfile.mkdtemp(prefix="gyrospark-fuzz-", dir=MEMORY if MEMORY.is_dir()
                                   else None))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
