"""Text of a file of unknown origin: a regular file of bounded size in UTF-8, or a refusal."""

from __future__ import annotations

import re
import stat
from pathlib import Path

from ...core.errors import InputError

__all__ = ["MODEL_FILES", "UnusableFileError", "is_robot", "model_text", "read_text",
           "states_of_files"]

#: Ending of a model file → the most bytes it may have.
MODEL_FILES = {".toml": 2**18, ".urdf": 2**20, ".xml": 2**20, ".sdf": 2**20}
#: Names of files in the XML of a robot, and of folders they are in.
_FILES = re.compile(r"\bfile\s*=\s*[\"']([^\"'<>]{1,500})[\"']")
_FOLDERS = re.compile(r"\b(?:mesh|asset)dir\s*=\s*[\"']([^\"'<>]{1,500})[\"']")
#: Has the examples in it, wherever it is installed.
_PACKAGE = Path(__file__).resolve().parents[2]


class UnusableFileError(Exception):
    """The file is not to be read: "reason; cure." The caller adds which file it is."""


def read_text(path: Path, most: int) -> str:
    """Return the text of a file of at most so many bytes; no more of it is ever read.

    Pipes and devices are refused before they are opened: that might wait for ever. A path such as
    ``examples/satellite.toml`` that leads to no file from here is one of the package's.
    """
    try:
        path = _own_example(path) or path
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            raise UnusableFileError("it is no regular file; correct the path.")
        if found.st_size > most:
            raise UnusableFileError(f"it has more than {most} bytes; write shorter entries.")
        with path.open("rb") as stream:
            content = stream.read(most + 1)
    except FileNotFoundError:
        own = Path("examples", path.name)
        cure = (f"the example of that name is {own.as_posix()!r} from everywhere"
                if path.name and (_PACKAGE / own).is_file() else "correct the path")
        raise UnusableFileError(f"there is no such file; {cure}.") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        raise UnusableFileError(
            f"it cannot be read ({getattr(error, 'strerror', None) or error}); check its path and "
            "its permissions."
        ) from None
    if len(content) > most:  # it grew, or says 0 as files of the system do
        raise UnusableFileError(f"it has more than {most} bytes; write shorter entries.")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if b"\0" in content[:1024] and content[:2] not in (b"\xff\xfe", b"\xfe\xff"):  # UTF-16
            raise UnusableFileError(f"it is no text: it begins with {content[:8]!r}; give the file "
                                    "of a model, .toml, .urdf, .xml or .sdf.") from None
        raise UnusableFileError(f"it is not UTF-8 ({error}); save it in that encoding.") from None


def _own_example(path: Path) -> Path | None:
    """Return the package's example that a path means which leads nowhere by itself."""
    if path.parts[:1] != ("examples",) or ".." in path.parts or path.exists():
        return None
    own = _PACKAGE / path
    return own if own.is_file() else None


def is_robot(path: str | Path) -> bool:
    """Whether a model file describes a robot, in URDF, MJCF or SDF."""
    return str(path).endswith((".urdf", ".xml", ".sdf"))


def states_of_files(path: Path, text: str) -> list[str]:
    """Return size and time of change of the files that the XML of a robot names, in its folder.

    With these, what is cached for a robot belongs to its meshes and includes as they are.
    """
    folders, found = ["", *_FOLDERS.findall(text)], []
    texts, seen = [text], set[Path]()
    while texts:
        for name in _FILES.findall(texts.pop()):
            for file in (path.parent / folder / name for folder in folders):
                try:
                    state = None if file in seen else file.stat()
                except (OSError, ValueError):
                    continue
                seen.add(file)
                if state is None or not stat.S_ISREG(state.st_mode):
                    continue
                found.append(f"{name} {state.st_size} {state.st_mtime_ns}")
                if file.suffix == ".xml" and state.st_size <= MODEL_FILES[".xml"]:
                    texts.append(file.read_text("utf-8", "replace"))
    return found


def model_text(path: str | Path) -> str:
    """Return the text of a model file, TOML, URDF, MJCF or SDF.

    Raises
    ------
    InputError
        With file and cure.
    """
    try:
        return read_text(Path(path), MODEL_FILES.get(Path(path).suffix, MODEL_FILES[".toml"]))
    except UnusableFileError as error:
        raise InputError(f"The model file {str(path)!r} is not usable: {error}") from None
