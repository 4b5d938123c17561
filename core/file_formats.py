"""Formats of the files that results are written to, by the ending of the name: one registry.

A format of states has a writer for each kind of result. Writers are imported when they are used;
``packages`` are imported first, so that a missing one is found before a long run.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import field
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

from .arguments import as_path, why_unwritable
from .errors import GyrosparkError, InputError, MissingDependencyError
from .extras import install
from .records import dataclass

__all__ = ["FORMATS", "FileFormat", "Kind", "checked_path", "ending_of", "endings", "format_of",
           "result_file"]

_PACKAGE = __name__.partition(".")[0]

Kind = Literal["states", "store", "picture", "film", "page", "model"]


@dataclass(frozen=True)
class FileFormat:
    """A format.

    Attributes
    ----------
    ending : str
    kind : {"states", "store", "picture", "film", "page", "model"}
    name : str
        As messages name it.
    writers : dict of str to str
        "trajectory" or "ensemble" → "module:function", where it is not written of a table.
    reader : str
        "module:function" that returns the run in such a file, if one does.
    tabular : bool
        Whether it has named columns, which a caller may choose, and Euler angles among them.
    extra, packages : str and tuple of str
        Packages to install, and modules that are imported.
    """

    ending: str
    kind: Kind
    name: str = ""
    writers: dict[str, str] = field(default_factory=dict)
    reader: str = ""
    tabular: bool = False
    extra: str = ""
    packages: tuple[str, ...] = ()

    def function(self, name: str) -> Any:
        """Return a function by "module:function"."""
        module, _, function = name.partition(":")
        return getattr(import_module(f"{_PACKAGE}.{module}"), function)

    def require_packages(self) -> None:
        """Raise MissingDependencyError if a package that the format needs is not installed."""
        try:
            for package in self.packages:
                import_module(package)
        except ImportError as error:
            raise MissingDependencyError(f"{self.name} needs {self.packages[0]}; "
                                         f"{install(self.extra)} brings it.") from error


_RUNS = "runtime.results.trajectory_file"

FORMATS = (
    FileFormat(".npz", "states", "NumPy", {
        "trajectory": f"{_RUNS}:save_npz", "ensemble": f"{_RUNS}:save_ensemble"},
        reader=f"{_RUNS}:load_npz"),
    FileFormat(".csv", "states", "CSV", tabular=True),
    FileFormat(".nc", "states", "NetCDF", reader=f"{_RUNS}:load_netcdf",
               extra="netcdf", packages=("h5netcdf", "h5py")),
    FileFormat(".parquet", "states", "Parquet", tabular=True, extra="parquet",
               packages=("pyarrow",)),
    FileFormat(".zarr", "store", "Zarr", {"trajectory": "storage.saved_run:save_store"},
               reader="storage.recording:open_recording"),
    *(FileFormat(ending, "picture") for ending in (".png", ".svg", ".pdf")),
    *(FileFormat(ending, "film") for ending in (".gif", ".mp4")),
    *(FileFormat(ending, "page") for ending in (".html", ".htm")),
    FileFormat(".glb", "model"),
)


def ending_of(path: Path) -> str:
    """Return the ending of a file's name in small letters."""
    return path.suffix.lower()


def endings(*kinds: Kind) -> list[str]:
    """Return the endings of all formats of some kinds."""
    return [file_format.ending for file_format in FORMATS if file_format.kind in kinds]


def format_of(path: Path, label: str, *kinds: Kind) -> FileFormat:
    """Return the format that a name asks for.

    Raises InputError where none of these kinds has its ending; ``label`` begins its message.
    """
    for file_format in FORMATS:
        if file_format.kind in kinds and file_format.ending == ending_of(path):
            return file_format
    raise InputError(f"{label} cannot be written as {path.name!r}; end it in "
                     f"{', '.join(endings(*kinds))}.")


def checked_path(path: str | os.PathLike[str], example: str, label: str, kind: Kind) -> Path:
    """Return the path if a result of this kind can be written as such a file; see ``format_of``."""
    target = as_path("path", path, example)
    format_of(target, label, kind)
    return target


@contextlib.contextmanager
def staged_file(path: Path) -> Iterator[Path]:
    """Yield the name of a file to write, which then becomes ``path``, complete or not at all.

    An error or an interrupt removes what was written.
    """
    # in the same folder, for a rename is atomic within a file system alone; with the same ending,
    # by which writers choose the format
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield temporary
        temporary.replace(path)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


@contextlib.contextmanager
def result_file(path: Path, label: str) -> Iterator[Path]:
    """Yield a name as ``staged_file`` does.

    Raises GyrosparkError saying why ``label`` cannot be written, where the system refuses it.
    """
    try:
        with staged_file(path) as temporary:
            yield temporary
    except OSError as error:
        raise GyrosparkError(f"{label} cannot be written to {str(path)!r}: "
                             f"{why_unwritable(path, error)}.") from error
