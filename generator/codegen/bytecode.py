"""Cache of compiled templates, in ``__pycache__`` as the bytecode of Python modules.

Jinja compiles a template to Python, which takes a seventh of a derivation. The bytecode is reused
as long as the template, Jinja and Python are the same. If the folder is not writable, or Python
writes no bytecode (PYTHONDONTWRITEBYTECODE), templates are compiled each time.
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

#: Bytes of the SHA-256 digest in front of the bytecode.
_DIGEST_BYTES = 32


class Bytecode(jinja2.BytecodeCache):
    """The bytecode of templates in ``__pycache__``, or below PYTHONPYCACHEPREFIX."""

    def __init__(self, options: str) -> None:
        """Cache the bytecode of an environment; ``options`` are its Jinja options as text."""
        self.versions = f"{sys.version} {jinja2.__version__} {options}"

    def get_cache_key(self, name: str, filename: str | None = None) -> str:
        """Return the path of the bytecode of a template."""
        return importlib.util.cache_from_source(filename or name)

    def get_source_checksum(self, source: str) -> str:
        """Return a hash of the template, the options and the versions of Python and Jinja."""
        return sha256(f"{self.versions}\n{source}".encode()).hexdigest()

    def load_bytecode(self, bucket: Bucket) -> None:
        """Load the cached bytecode, if its digest is right."""
        with contextlib.suppress(OSError):  # no cached file
            content = Path(bucket.key).read_bytes()
            digest, code = content[:_DIGEST_BYTES], content[_DIGEST_BYTES:]
            # damaged bytes may crash marshal
            if digest == _digest(bucket, code):
                bucket.code = marshal.loads(code)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Write the bytecode by an atomic rename, if the folder is writable."""
        if sys.dont_write_bytecode:
            return
        target, code = Path(bucket.key), marshal.dumps(bucket.code)
        with contextlib.suppress(OSError):  # a folder of another user's, a disk that is full
            target.parent.mkdir(parents=True, exist_ok=True)
            descriptor, temporary = tempfile.mkstemp(dir=target.parent, prefix=f"{target.name}.")
            try:
                with os.fdopen(descriptor, "wb") as file:
                    file.write(_digest(bucket, code) + code)
                Path(temporary).replace(target)
            except OSError:
                Path(temporary).unlink()
                raise


def _digest(bucket: Bucket, code: bytes) -> bytes:
    """Return a hash of a template and its bytecode: damaged bytecode could end the process."""
    return sha256(bucket.checksum.encode() + code).digest()
