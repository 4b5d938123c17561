"""Templates as Python's bytecode, kept where Python keeps that of its own modules.

Jinja makes Python of a template, which takes a seventh of a derivation. What it made is read again
as long as the template's text, Jinja and Python are the same; where nothing can be written, or
Python is told to write no bytecode, it is made each time.
"""

from __future__ import annotations

import contextlib
import importlib.util
import marshal
import os
import sys
import tempfile
from hashlib import sha256
from pathlib import Path

import jinja2
from jinja2.bccache import Bucket

__all__ = ["Bytecode"]

#: Bytes of a proof.
_PROOF = 32


class Bytecode(jinja2.BytecodeCache):
    """The bytecode of templates in ``__pycache__``, or where PYTHONPYCACHEPREFIX says."""

    def __init__(self, made_by: str) -> None:
        """Keep what an environment makes; ``made_by`` differs where its options do."""
        self.made_by = f"{sys.version} {jinja2.__version__} {made_by}"

    def get_cache_key(self, name: str, filename: str | None = None) -> str:
        """Return where the bytecode of a template lies."""
        return importlib.util.cache_from_source(filename or name)

    def get_source_checksum(self, source: str) -> str:
        """Return a hash of all that the bytecode depends on."""
        return sha256(f"{self.made_by}\n{source}".encode()).hexdigest()

    def load_bytecode(self, bucket: Bucket) -> None:
        """Read what was kept, if it is whole and of this template."""
        with contextlib.suppress(OSError):  # there is none
            kept = Path(bucket.key).read_bytes()
            if kept[:_PROOF] == _proof(bucket, kept[_PROOF:]):
                bucket.code = marshal.loads(kept[_PROOF:])

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep it under its name in one step, if files may be written."""
        if sys.dont_write_bytecode:
            return
        target, code = Path(bucket.key), marshal.dumps(bucket.code)
        with contextlib.suppress(OSError):  # a folder of another user's, a disk that is full
            target.parent.mkdir(parents=True, exist_ok=True)
            number, part = tempfile.mkstemp(dir=target.parent, prefix=f"{target.name}.")
            try:
                with os.fdopen(number, "wb") as file:
                    file.write(_proof(bucket, code) + code)
                Path(part).replace(target)
            except OSError:
                Path(part).unlink()
                raise


def _proof(bucket: Bucket, code: bytes) -> bytes:
    """Return a hash of a template and its bytecode: damaged bytecode could end the process."""
    return sha256(bucket.checksum.encode() + code).digest()
