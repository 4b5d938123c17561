"""Hash of the generator's source files: part of the key of each cached derivation."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from .._version import __version__

__all__ = ["generator_fingerprint"]

ROOT = Path(__file__).resolve().parents[1]


@cache
def generator_fingerprint() -> str:
    """Return a hash of the generator's source files: a change to any invalidates derivations."""
    paths = [*(ROOT / "core").glob("*.py"), *(ROOT / "generator").rglob("*.py"),
             *(ROOT / "templates").glob("*.jinja"), *(ROOT / "engine").rglob("*.h"),
             ROOT / "engine" / "amalgamate.py"]
    digest = hashlib.sha256(__version__.encode())
    for path in sorted(paths):
        digest.update(path.read_bytes() + b"\0")
    return digest.hexdigest()
