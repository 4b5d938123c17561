"""Volume, centre and inertia of the solid within a closed surface of triangles.

    V = Σ a·(b × c)/6,   V x = Σ V_k (a + b + c)/4,
    ∫ r rᵀ dV = Σ V_k ((a + b + c)(a + b + c)ᵀ + a aᵀ + b bᵀ + c cᵀ)/20

over tetrahedra from a point to each triangle a, b, c (Mirtich, J. Graphics Tools 1 (1996) 31). A
surface is closed if its triangles have each edge as often in one direction as in the other.
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Floats
from ...core.errors import InputError
from ...core.records import dataclass

__all__ = ["Volume", "convex_hull", "mesh_volume"]


@dataclass(frozen=True, eq=False)
class Volume:
    """Volume in m³, its centre, and ∫ (|r|² − r rᵀ) dV / V about it."""

    volume: float
    centre: Floats
    moments: Floats


def convex_hull(triangles: Floats) -> Floats:
    """Return the triangles of the convex hull of all corners, their normals outwards.

    ``triangles`` and the result have shape (triangles, corners 3, coordinates 3). Raises InputError
    where all corners are in a plane.
    """
    from scipy.spatial import ConvexHull, QhullError  # takes 0.1 s

    points = np.unique(triangles.reshape(-1, 3), axis=0)
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        raise InputError("its corners are in a plane, so that it has no volume.") from None
    corners: Floats = points[hull.simplices]
    # a·(b × c) < 0 seen from inside: clockwise from outside, so that the order is reversed
    middle = points[hull.vertices].mean(axis=0)
    inwards = np.linalg.det(corners - middle) < 0
    corners[inwards] = corners[inwards][:, ::-1]
    return corners


def mesh_volume(triangles: Floats, *, overlaps: bool = False) -> Volume:
    """Return volume, centre and inertia of a solid; triangles are counterclockwise from outside.

    ``triangles`` has shape (triangles, 3, 3), in m. With ``overlaps`` each tetrahedron from the
    centre of the surface counts as positive, as in MuJoCo's "legacy": the same for convex surfaces,
    too much for others. Raises InputError, "reason; cure.", for surfaces that are open, or inside
    out.
    """
    # the common point of the tetrahedra: near the surface fewer digits are lost
    apex = triangles.reshape(-1, 3).mean(axis=0)
    if overlaps:
        areas = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0],
                                        triangles[:, 2] - triangles[:, 0]), axis=1)
        apex = areas @ triangles.mean(axis=1) / areas.sum() if areas.any() else apex
    else:
        _refuse_open(triangles)
    corners = triangles - apex
    volumes = np.linalg.det(corners) / 6
    volumes = np.abs(volumes) if overlaps else volumes
    volume = float(volumes.sum())
    if not volume > 0:
        raise InputError(f"its volume is {volume:.3g} m³; turn its triangles round, so that they "
                         "are counterclockwise from outside.")
    # a + b + c of each triangle
    sums = corners.sum(axis=1)
    centre = volumes @ sums / 4 / volume
    squares = (np.einsum("k,ki,kj->ij", volumes, sums, sums)
               + np.einsum("k,kci,kcj->ij", volumes, corners, corners)) / 20 / volume
    # about the centre instead of the apex (Steiner)
    squares -= np.outer(centre, centre)
    return Volume(volume, apex + centre, np.trace(squares) * np.eye(3) - squares)


def _refuse_open(triangles: Floats) -> None:
    """Refuse a surface with an edge that is not in two triangles, once in each direction."""
    points, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    corners = index.reshape(-1, 3)
    count = len(points)
    edges = np.concatenate([corners[:, [k, (k + 1) % 3]] for k in range(3)])
    # a degenerate triangle has an edge from a point to itself
    edges = edges[edges[:, 0] != edges[:, 1]]
    # the edge from i to j as the number i · count + j, and the number of its reverse
    forward, backward = (np.sort(edges[:, i] * count + edges[:, 1 - i]) for i in (0, 1))
    if not np.array_equal(forward, backward):
        raise InputError("its surface is not closed: an edge has no neighbour; close it, or give "
                         "the body an <inertial>.")
