"""Triangles of mesh files: STL, binary or text, and OBJ."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .arguments import shown
from .arrays import Floats
from .errors import InputError

if TYPE_CHECKING:
    from .shapes import Shape

__all__ = ["READABLE", "locate", "read_triangles"]

#: Endings of files that can be read.
READABLE = (".stl", ".obj")
MAX_BYTES = 64 * 2**20
MAX_TRIANGLES = 2_000_000
_HEADER, _FACET = 84, 50  # bytes of a binary STL file


def read_triangles(path: Path) -> Floats:
    """Return the corners of the triangles of an STL or OBJ file, shape (triangles, 3, 3).

    Raises InputError, "reason; cure.", for files that are neither, or too large.
    """
    ending = path.suffix.lower()
    if ending not in READABLE:
        raise InputError(f"it ends in {shown(ending)}; convert it to .stl or .obj.")
    try:
        if not path.is_file():
            raise InputError("there is no such file; correct the path.")
        # before the file is in memory
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"it has more than {MAX_BYTES >> 20} MiB; simplify it.")
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        raise InputError(f"it cannot be read ({error}); check its path.") from None
    triangles = _obj(content) if ending == ".obj" else _stl(content)
    if not len(triangles) or not np.isfinite(triangles).all():
        raise InputError("it has no triangles of finite numbers; correct it.")
    _check_number(len(triangles))
    return triangles


def _check_number(count: int) -> None:
    """Refuse a number of triangles that is too large."""
    if count > MAX_TRIANGLES:
        raise InputError(f"it has {count} triangles and at most {MAX_TRIANGLES} are allowed; "
                         "simplify it.")


def _stl(content: bytes) -> Floats:
    """Return the triangles of an STL file, binary or text, shape (count, 3, 3)."""
    # binary STL: 80 bytes of any text, the number of triangles, and 50 bytes for each
    count = int.from_bytes(content[80:_HEADER], "little")
    # some binary files begin with "solid", as text does: only the length decides
    if len(content) == _HEADER + _FACET * count:
        _check_number(count)
        # a facet of binary STL, with two bytes that most programs leave 0
        kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
        return np.frombuffer(content, kind, offset=_HEADER)["corners"].astype(float)
    lines = [line.split() for line in content.decode("utf-8", "replace").splitlines()]
    corners = [line[1:4] for line in lines if line[:1] == ["vertex"]]
    try:
        return np.array(corners, dtype=float).reshape(-1, 3, 3)
    except ValueError:
        raise InputError("it is no STL; correct it.") from None


def _obj(content: bytes) -> Floats:
    """Return the triangles of an OBJ file, shape (triangles, 3, 3): corners and coordinates.

    Faces with more than three corners become fans of triangles.
    """
    _check_number(content.count(b"\nf "))  # a face has a triangle or more
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    try:
        for line in content.decode("utf-8", "replace").splitlines():
            words = line.split()
            if words[:1] == ["v"]:
                vertices.append([float(word) for word in words[1:4]])
            elif words[:1] == ["f"]:
                index = [int(word.split("/")[0]) for word in words[1:]]
                # indices count from 1, negative ones from the last vertex so far; there is no 0
                index = [k - 1 if k > 0 else len(vertices) + k for k in index]
                if min(index) < 0:
                    raise IndexError
                faces += [(index[0], index[k], index[k + 1]) for k in range(1, len(index) - 1)]
        points = np.array(vertices, dtype=float).reshape(-1, 3)
        corners: Floats = points[np.array(faces, dtype=int).reshape(-1, 3)]
        return corners
    except (ValueError, IndexError):
        raise InputError("it is no OBJ; correct it.") from None


def locate_all(visuals: Mapping[str, Iterable[Shape]], model: str | Path) -> dict[str, list[Shape]]:
    """Return the shapes of bodies with the paths of their meshes; see ``locate``."""
    return {body: [locate(shape, model) for shape in shapes] for body, shapes in visuals.items()}


def locate(shape: Shape, model: str | Path) -> Shape:
    """Return a shape with the path of its mesh, of the name that a model file gives it.

    ``package://NAME/…`` and ``model://NAME/…`` are searched for upwards from the model's folder;
    ``file://…`` is a path; other names are relative to the folder. A mesh that is not found keeps
    its name.
    """
    if not shape.file:
        return shape
    folder = Path(model).absolute().parent
    scheme, colon, relative = shape.file.partition("://")
    if not colon or scheme == "file":
        return replace(shape, file=str(folder / (relative or shape.file)))
    package, _, path_in_package = relative.partition("/")
    for above in (folder, *folder.parents):
        candidates = [above / relative]  # the package beside the model, or beside a folder above
        if above.name == package:  # the model is in the package
            candidates.append(above / path_in_package)
        for candidate in candidates:
            if candidate.is_file():
                return replace(shape, file=str(candidate))
    return shape
