"""``gyrospark.load``: the run in a file or a store, by the ending of its name."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from ...core.arguments import as_path, join_or
from ...core.errors import InputError
from ...core.file_formats import FORMATS, ending_of

if TYPE_CHECKING:
    from .trajectory import Trajectory

__all__ = ["load"]


def load(path: str | os.PathLike[str]) -> Trajectory:
    """Return the run that ``run.save`` wrote, or ``integrate(..., out=...)`` stored.

    Parameters
    ----------
    path : path
        A file .npz or .nc, which is read as a whole, with all digits; or a store .zarr, of which
        each array is read when it is first asked for, finished or not. Nothing in them is executed.

    Raises
    ------
    InputError
        If there is none, it is damaged, of another kind, or of a version with other outputs.
    MissingDependencyError
        Where the package of a format is not installed.
    """
    target = as_path("path", path, "run.npz")
    readable = {format_.ending: format_ for format_ in FORMATS if format_.reader}
    form = readable.get(".zarr" if target.is_dir() else ending_of(target))
    if form is None:
        raise InputError(f"No run is read from {target.name!r}: give a name that ends in "
                         f"{join_or(readable)}. Tables (.csv, .parquet) have numbers without their "
                         "model; pandas reads them.")
    form.require_packages()
    run: Trajectory = form.function(form.reader)(target)
    return run
