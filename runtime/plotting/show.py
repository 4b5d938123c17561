"""``run.show``: pages, pictures, films and 3-D models of a run, by the ending of the name."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.arguments import as_path, join_or, proposal
from ...core.errors import InputError
from ...core.file_formats import ending_of
from .gltf import export_gltf
from .html_view import view
from .picture import draw_picture

if TYPE_CHECKING:
    from ..results.trajectory import Trajectory

__all__ = ["ENDINGS", "show"]


def _film(run: Trajectory, path: Any, **options: Any) -> Any:
    """Write a film; matplotlib is imported here, since it is optional."""
    from .animation import animate  # matplotlib is optional

    return animate(run, path, **options)


#: Ending → what it is, the function that makes it, and its options.
ENDINGS: dict[str, tuple[str, Any, tuple[str, ...]]] = {
    ".html": ("a page", view, ("shape", "meshes")),
    ".htm": ("a page", view, ("shape", "meshes")),
    ".png": ("a picture", draw_picture,
             ("size", "time", "azimuth", "elevation", "background", "traces")),
    ".gif": ("a film", _film, ("seconds", "fps", "shape")),
    ".mp4": ("a film", _film, ("seconds", "fps", "shape")),
    ".glb": ("a 3-D model", export_gltf, ("meshes",)),
}


def show(run: Trajectory, path: str | os.PathLike[str] | None, options: dict[str, Any]) -> Any:
    """Return the page or picture of a run, or write it to a path; see ``Trajectory.show``."""
    inline_endings = {None: ".html", ".html": ".html", ".png": ".png"}
    ending = inline_endings.get(path) if path is None or isinstance(path, str) else None
    target = None if ending else as_path("path", path, "run.html")
    ending = ending or ending_of(Path(target or ""))
    if ending not in ENDINGS:
        raise InputError(f"A run is not shown as {target.name if target else ''!r}; end the "
                         f"name in {join_or(ENDINGS)}. plot writes curves as .png, .svg and .pdf.")
    kind, function, option_names = ENDINGS[ending]
    for name in options:
        if name not in option_names:
            raise InputError(f"{name} is no option of {kind}, which has {join_or(option_names)}"
                             f"{proposal(name, option_names)}.")
    return function(run, target, **options)
