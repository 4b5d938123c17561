"""Volume, centre and inertia of what a closed surface of triangles encloses.

    V = Σ a·(b × c)/6,   V x = Σ V_k (a + b + c)/4,
    ∫ r rᵀ dV = Σ V_k ((a + b + c)(a + b + c)ᵀ + a aᵀ + b bᵀ + c cᵀ)/20

over tetrahedra from a point to each triangle a, b, c (Mirtich, J. Graphics Tools 1 (1996) 31). A
surface is closed if each of its edges runs as often one way as the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import shown
from ...core.errors import InputError, MissingDependencyError
from ...core.extras import install

__all__ = ["Volume", "convex_hull", "mesh_volume", "read_triangles"]

Array = NDArray[np.float64]

MAX_BYTES = 64 * 2**20
MAX_TRIANGLES = 2_000_000
_HEADER, _FACET = 84, 50  # bytes of a binary STL file


@dataclass(frozen=True, eq=False)
class Volume:
    """Volume in m³, its centre, and ∫ (|r|² − r rᵀ) dV / V about it."""

    volume: float
    centre: Array
    moments: Array


def read_triangles(path: Path) -> Array:
    """Return the corners of the triangles of an STL or OBJ file, shape (triangles, 3, 3).

    Raises
    ------
    InputError
        "reason; cure.", for files that are no such, or too large.
    """
    try:
        size = path.stat().st_size if path.is_file() else -1
        content = path.read_bytes() if 0 <= size <= MAX_BYTES else b""
    except (OSError, ValueError) as error:
        raise InputError(f"it cannot be read ({error}); check its path.") from None
    if size < 0:
        raise InputError("there is no such file; correct the path.")
    if size > MAX_BYTES:
        raise InputError(f"it has more than {MAX_BYTES} bytes; simplify it.")
    ending = path.suffix.lower()
    if ending not in (".stl", ".obj"):
        raise InputError(f"it ends in {shown(ending)}; convert it to .stl or .obj.")
    found = _obj(content) if ending == ".obj" else _stl(content)
    if not len(found) or not np.isfinite(found).all():
        raise InputError("it has no triangles of finite numbers; correct it.")
    _refuse_many(len(found))
    return found


def _refuse_many(triangles: int) -> None:
    if triangles > MAX_TRIANGLES:
        raise InputError(f"it has {triangles} triangles and at most {MAX_TRIANGLES} are allowed; "
                         "simplify it.")


def _stl(content: bytes) -> Array:
    count = int.from_bytes(content[80:_HEADER], "little")
    if len(content) == _HEADER + _FACET * count:
        _refuse_many(count)
        kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
        corners: Array = np.frombuffer(content, kind, offset=_HEADER)["corners"].astype(float)
        return corners
    lines = [line.split() for line in content.decode("utf-8", "replace").splitlines()]
    written = [line[1:4] for line in lines if line[:1] == ["vertex"]]
    try:
        return np.array(written, dtype=float).reshape(-1, 3, 3)
    except ValueError:
        raise InputError("it is no STL; correct it.") from None


def _obj(content: bytes) -> Array:
    _refuse_many(content.count(b"\nf "))
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    try:
        for line in content.decode("utf-8", "replace").splitlines():
            words = line.split()
            if words[:1] == ["v"]:
                vertices.append([float(word) for word in words[1:4]])
            elif words[:1] == ["f"]:
                index = [int(word.split("/")[0]) for word in words[1:]]
                index = [k - 1 if k > 0 else len(vertices) + k for k in index]
                faces += [(index[0], index[k], index[k + 1]) for k in range(1, len(index) - 1)]
        points = np.array(vertices, dtype=float).reshape(-1, 3)
        found: Array = points[np.array(faces, dtype=int).reshape(-1, 3)]
        return found
    except (ValueError, IndexError):
        raise InputError("it is no OBJ; correct it.") from None


def convex_hull(triangles: Array) -> Array:
    """Return the triangles of the convex hull of all corners, their normals outwards.

    Raises
    ------
    InputError
        Where all corners are in a plane.
    MissingDependencyError
        Without SciPy.
    """
    try:
        from scipy.spatial import ConvexHull, QhullError
    except ImportError:
        raise MissingDependencyError(
            f"The convex hull of a mesh is asked for and SciPy is not installed; "
            f"{install('rotation')} cures it.") from None
    points = np.unique(triangles.reshape(-1, 3), axis=0)
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        raise InputError("its corners are in a plane, so that it has no volume.") from None
    corners: Array = points[hull.simplices]
    middle = points[hull.vertices].mean(axis=0)
    inwards = np.linalg.det(corners - middle) < 0
    corners[inwards] = corners[inwards][:, ::-1]
    return corners


def mesh_volume(triangles: Array) -> Volume:
    """Return volume, centre and inertia of what triangles enclose, seen counterclockwise.

    Raises
    ------
    InputError
        "reason; cure.", for surfaces that are open, or inside out.
    """
    _refuse_open(triangles)
    start = triangles.reshape(-1, 3).mean(axis=0)  # near it: fewer digits are lost
    corners = triangles - start
    volumes = np.linalg.det(corners) / 6
    volume = float(volumes.sum())
    if not volume > 0:
        raise InputError(f"its volume is {volume:.3g} m³; turn its triangles round, so that they "
                         "are counterclockwise from outside.")
    sums = corners.sum(axis=1)
    centre = volumes @ sums / 4 / volume
    squares = (np.einsum("k,ki,kj->ij", volumes, sums, sums)
               + np.einsum("k,kci,kcj->ij", volumes, corners, corners)) / 20 / volume
    squares -= np.outer(centre, centre)
    return Volume(volume, start + centre, np.trace(squares) * np.eye(3) - squares)


def _refuse_open(triangles: Array) -> None:
    points, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    corners = index.reshape(-1, 3)
    count = len(points)
    edges = np.concatenate([corners[:, [k, (k + 1) % 3]] for k in range(3)])
    edges = edges[edges[:, 0] != edges[:, 1]]
    there, back = (np.sort(edges[:, i] * count + edges[:, 1 - i]) for i in (0, 1))
    if not np.array_equal(there, back):
        raise InputError("its surface is not closed: an edge has no neighbour; close it, or give "
                         "the body an <inertial>.")
