"""Text of a file of unknown origin: a regular file of bounded size in UTF-8, or an error."""

from __future__ import annotations

import re
import stat
from pathlib import Path

from ...core.errors import InputError

__all__ = ["MODEL_FILES", "UnusableFileError", "is_robot", "model_text", "read_text",
           "states_of_files"]

#: Ending of a model file → its largest number of bytes.
MODEL_FILES = {".toml": 2**18, ".urdf": 2**20, ".xml": 2**20, ".sdf": 2**20}
#: Names of files in the XML of a robot, and of their folders.
_FILES = re.compile(r"\bfile\s*=\s*[\"']([^\"'<>]{1,500})[\"']")
_FOLDERS = re.compile(r"\b(?:mesh|asset)dir\s*=\s*[\"']([^\"'<>]{1,500})[\"']")
#: Folder of the installed package, with the examples.
_PACKAGE = Path(__file__).resolve().parents[2]


class UnusableFileError(Exception):
    """The file cannot be used: "reason; cure." The caller adds the path."""


def read_text(path: Path, max_bytes: int) -> str:
    """Return the text of a file of at most ``max_bytes`` bytes.

    Pipes and devices are refused before they are opened, as opening them may block. A path such as
    ``examples/satellite.toml`` that does not exist is an example of the package.

    Raises ``UnusableFileError`` for no regular file, more bytes, or text that is not UTF-8.
    """
    try:
        path = _packaged_example(path) or path
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise UnusableFileError("it is no regular file; correct the path.")
        if status.st_size > max_bytes:
            raise UnusableFileError(f"it has more than {max_bytes} bytes; write shorter entries.")
        with path.open("rb") as stream:
            content = stream.read(max_bytes + 1)
    except FileNotFoundError:
        raise UnusableFileError(f"there is no such file; {_cure_of_path(path)}.") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        raise UnusableFileError(f"it cannot be read ({getattr(error, 'strerror', None) or error}); "
                                "check its path and its permissions.") from None
    if len(content) > max_bytes:  # the file has grown, or has the size 0, as in /proc
        raise UnusableFileError(f"it has more than {max_bytes} bytes; write shorter entries.")
    return _decode(content)


def _cure_of_path(path: Path) -> str:
    """Return the cure of a path without a file; it names an example of the package if it can."""
    example = Path("examples", path.name)
    if path.name and (_PACKAGE / example).is_file():
        return f"the example of that name is {example.as_posix()!r} from everywhere"
    return "correct the path"


def _decode(content: bytes) -> str:
    """Return the text of UTF-8 without a byte order mark; raises ``UnusableFileError``."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        # UTF-16 has zero bytes too, behind its byte order mark: that file is text to save again
        if b"\0" in content[:1024] and content[:2] not in (b"\xff\xfe", b"\xfe\xff"):
            raise UnusableFileError(f"it is no text: it begins with {content[:8]!r}; give the file "
                                    "of a model, .toml, .urdf, .xml or .sdf.") from None
        raise UnusableFileError(f"it is not UTF-8 ({error}); save it in that encoding.") from None


def _packaged_example(path: Path) -> Path | None:
    """Return the path of an example of the package for ``examples/…`` that does not exist."""
    if path.parts[:1] != ("examples",) or ".." in path.parts or path.exists():
        return None
    example = _PACKAGE / path
    return example if example.is_file() else None


def is_robot(path: str | Path) -> bool:
    """Whether a model file describes a robot, in URDF, MJCF or SDF."""
    return str(path).endswith((".urdf", ".xml", ".sdf"))


def states_of_files(path: Path, text: str) -> list[str]:
    """Return "name size mtime" of the files that the XML of a robot names, in its folder.

    They are part of cache keys, so that changed meshes and includes are read again.
    """
    folders = ["", *_FOLDERS.findall(text)]
    states: list[str] = []
    # the texts of included files name further ones; a file that includes itself is read once
    texts = [text]
    visited = set[Path]()
    while texts:
        for name in _FILES.findall(texts.pop()):
            for file in (path.parent / folder / name for folder in folders):
                if file in visited:
                    continue
                try:
                    status = file.stat()
                except (OSError, ValueError):  # not there, or no path at all
                    continue
                visited.add(file)
                if not stat.S_ISREG(status.st_mode):
                    continue
                states.append(f"{name} {status.st_size} {status.st_mtime_ns}")
                if file.suffix == ".xml" and status.st_size <= MODEL_FILES[".xml"]:
                    texts.append(file.read_text("utf-8", "replace"))
    return states


def model_text(path: str | Path) -> str:
    """Return the text of a model file, TOML, URDF, MJCF or SDF.

    Raises InputError if the file cannot be used; names the file, the reason and the cure.
    """
    try:
        return read_text(Path(path), MODEL_FILES.get(Path(path).suffix, MODEL_FILES[".toml"]))
    except UnusableFileError as error:
        raise InputError(f"The model file {str(path)!r} is not usable: {error}") from None
