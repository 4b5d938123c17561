"""Meshes of pages: vertices clustered in growing cells until all fit into a number of bytes.

Clustering (Rossignac and Borrel, 1993): the vertices in a cubic cell become their mean; triangles
of which two corners are in one cell, and repeated ones, vanish.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.mesh_files import read_triangles
from ...core.records import dataclass

__all__ = ["MESHES", "IndexedMesh", "MeshesName", "encode", "read_meshes"]

Array = NDArray[np.float64]
MeshesName = Literal["small", "full", "none"]
MESHES: tuple[MeshesName, ...] = get_args(MeshesName)

#: Bytes of all meshes of a page, in base64.
BUDGET = 700_000
#: Cells along the longest mesh to begin with.
_CELLS = 192.0
#: Along a small mesh there are so many at least.
_LEAST = 6


@dataclass(frozen=True, eq=False)
class IndexedMesh:
    """Vertices, shape (n, 3), and three numbers of them for each triangle, shape (m, 3)."""

    points: Array
    triangles: NDArray[np.int64]

    @staticmethod
    def of(corners: Array) -> IndexedMesh:
        """Return the mesh of triangles, shape (m, 3, 3), with each vertex once."""
        points = corners.reshape(-1, 3) + 0.0  # −0 becomes 0: equal points have equal bytes
        first, index = _unique_rows(points)
        return IndexedMesh(points[first], index.reshape(-1, 3)).clean()

    @property
    def extent(self) -> float:
        """The longest side of its bounding box."""
        return float(np.ptp(self.points, axis=0).max())

    def clean(self) -> IndexedMesh:
        """Return the mesh without triangles that are lines, or that are there twice.

        Each triangle is rotated so that its smallest vertex number comes first; equal ones are then
        equal rows.
        """
        t = self.triangles
        t = t[(t[:, 0] != t[:, 1]) & (t[:, 1] != t[:, 2]) & (t[:, 2] != t[:, 0])]
        smallest_corner = np.argmin(t, axis=1)[:, None]
        triangles = np.take_along_axis(t, (smallest_corner + np.arange(3)) % 3, axis=1)
        return IndexedMesh(self.points, triangles[np.sort(_unique_rows(triangles)[0])])

    def cluster(self, cell: float) -> IndexedMesh:
        """Return the mesh with the vertices in each cubic cell replaced by their mean."""
        low = self.points.min(axis=0)
        # to the nearest multiple: vertices of a flat side are in one layer, in spite of rounding
        cells = np.floor((self.points - low) / cell + 0.5).astype(np.int64)
        index = _unique_rows(cells)[1]
        points = np.stack([np.bincount(index, self.points[:, k]) for k in range(3)], axis=1)
        return IndexedMesh(points / np.bincount(index)[:, None], index[self.triangles]).clean()


def _unique_rows(vertices: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the indices of the distinct rows, and the position of each row among them."""
    # a row as one opaque item: NumPy sorts these by their bytes, faster than rows of numbers
    row_type = np.dtype((np.void, vertices.itemsize * vertices.shape[1]))
    row_bytes = np.ascontiguousarray(vertices).view(row_type)
    _, first, index = np.unique(row_bytes.ravel(), return_index=True, return_inverse=True)
    return first, index.ravel()


def read_meshes(
    files: Iterable[str], meshes: MeshesName, budget: int = BUDGET
) -> tuple[dict[str, IndexedMesh], dict[str, str]]:
    """Return the meshes by file, and the errors of files that cannot be shown.

    ``"full"`` keeps all triangles; ``"small"`` clusters the meshes until all together take at most
    ``budget`` bytes, by default the budget of a page; ``"none"`` returns no meshes.
    """
    meshes_by_file: dict[str, IndexedMesh] = {}
    reasons: dict[str, str] = {}
    for file in dict.fromkeys(files) if meshes != "none" else ():
        try:
            meshes_by_file[file] = IndexedMesh.of(read_triangles(Path(file)))
        except InputError as error:
            reasons[file] = str(error)
    if meshes == "full" or not meshes_by_file:
        return meshes_by_file, reasons
    # cells along the longest mesh; 0: not clustered yet
    cells, longest = 0.0, max(mesh.extent for mesh in meshes_by_file.values())
    while (size := sum(len(encode(mesh)["data"]) for mesh in meshes_by_file.values())) > budget:
        # the number of triangles grows like the square of the cells along a side; 5 % are spare,
        # and at least a fifth is left out, so that the loop ends
        cells = cells * min(0.8, 0.95 * (budget / size) ** 0.5) if cells else _CELLS
        if cells < 1:
            break
        # all meshes have cells of one size, but small ones have at least _LEAST along each
        for file, mesh in meshes_by_file.items():
            cell = min(longest / cells, mesh.extent / _LEAST)
            meshes_by_file[file] = mesh.cluster(max(cell, 1e-12))  # of a mesh without extent
    return meshes_by_file, reasons


def encode(mesh: IndexedMesh) -> Mapping[str, Any]:
    """Return a mesh as JSON: its bounds, and its vertices and triangles in base64.

    Vertices are sorted 16-bit integers between the bounds, as differences along each axis in turn;
    then the vertex numbers of the corners, as differences too. Both are little-endian, modulo their
    width, and deflated together.
    """
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    width = np.where(high > low, high - low, 1.0)
    points = np.round((mesh.points - low) / width * 65535).astype(np.int64)
    order = np.lexsort(points.T[::-1])
    points, vertex_number = points[order], np.empty_like(order)
    vertex_number[order] = np.arange(len(order))
    triangles = vertex_number[mesh.triangles]
    # the smallest vertex number comes first, and the triangles are sorted by it
    smallest_corner = np.argmin(triangles, axis=1)[:, None]
    triangles = np.take_along_axis(triangles, (smallest_corner + np.arange(3)) % 3, axis=1)
    corners = triangles[np.lexsort(triangles.T[::-1])].ravel()
    # differences of sorted numbers are small, and small numbers deflate well
    words = (np.diff(points, axis=0, prepend=0).T.astype("<u2").tobytes()
             + np.diff(corners, prepend=0).astype("<u4").tobytes())
    return {"low": low.tolist(), "width": width.tolist(), "vertices": len(points),
            "triangles": len(mesh.triangles),
            "data": base64.b64encode(zlib.compress(words, level=6)).decode("ascii")}
