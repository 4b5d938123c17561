"""Triangles of the shapes that bodies are drawn with.

Normals belong to the vertices, so that few triangles look round. A sphere, a disc and a bar are
surfaces of revolution; a box has rounded edges.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.records import dataclass
from ...core.shapes import Shape, axes_about
from .meshes import IndexedMesh, encode

__all__ = ["COARSE", "COLOURS", "Mesh", "colour_of", "encoded_solids", "join_meshes", "mesh_of",
           "mesh_of_file", "tube"]

Array = NDArray[np.float64]
Profile = list[tuple[float, float]]

#: Colours of bodies by their number; scene.js has the same.
COLOURS = ("#4c78a8", "#f58518", "#54a24b", "#e45756", "#2f9e99", "#b279a2", "#c9a227", "#9d755d",
           "#7f7f8f", "#e377a2")
#: Segments of a circle: of pictures, of pages, and of what is small.
_AROUND, _ON_PAGES, COARSE = 48, 36, 18
#: Neighbouring segments of a profile that meet at less than this angle form one smooth surface.
_SMOOTH = np.cos(np.radians(40))
#: Cosine of the angle between the normals of a face and of a vertex, beyond which an edge is sharp.
_CREASE = 0.8
#: Bevel of a box, in parts of its shortest and of its longest half edge.
_BEVEL = (0.3, 0.05)
#: Half the height of a disc, in parts of its radius, below which it is a wheel.
_WHEEL = 0.6


@dataclass(frozen=True)
class Mesh:
    """Triangles: vertices (n, 3) with normals, faces (m, 3), and the lightness of each face."""

    points: Array
    normals: Array
    faces: NDArray[np.int64]
    light: Array


def colour_of(text: str) -> Array:
    """Return red, green, blue from 0 to 1 of a colour "#rrggbb"."""
    return np.array([int(text[k:k + 2], 16) for k in (1, 3, 5)]) / 255


def mesh_of(shape: Shape, around: int = _AROUND) -> Mesh:
    """Return the triangles of a shape in body axes; a circle has ``around`` segments."""
    a, b, c = shape.size
    r = max(a, b)
    # a surface of revolution is made with circles, which the scale makes ellipses
    scale = np.array([a / r, b / r, 1.0])
    if shape.kind == "box":
        mesh, scale = _box(shape.size), np.ones(3)
    elif shape.kind == "sphere":
        mesh, scale = _unit_sphere(around), shape.size
    elif shape.kind == "bar":
        mesh = _bar(r, c, min(around, COARSE))
    else:
        mesh = _revolve(_wheel(r, c) if c < _WHEEL * r else _cylinder(r, c), sectors=6,
                        around=around)
    # a surface scaled by S has the normals S⁻¹ n
    normals = mesh.normals / scale @ shape.axes.T
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return replace(mesh, points=shape.centre + mesh.points * scale @ shape.axes.T,
                   normals=normals / np.where(length, length, 1.0))


@cache
def encoded_solids() -> Mapping[str, list[dict[str, Any]]]:
    """Return solids of half edges or radii 1, which pages scale, each as meshes of one tint.

    A bar is a tube and two balls.
    """
    # a wheel's rim is rounded at true proportions, then it is scaled to 1 like the others
    flat = np.array([1.0, 1.0, 0.5 * _WHEEL])
    wheel, sphere = mesh_of(Shape("disc", flat), _ON_PAGES), Shape("sphere", np.ones(3))
    solids = {"box": mesh_of(Shape("box", np.ones(3))),
              "disc": mesh_of(Shape("disc", np.ones(3)), _ON_PAGES),
              "wheel": replace(wheel, points=wheel.points / flat),
              "sphere": mesh_of(sphere, _ON_PAGES), "ball": mesh_of(sphere, COARSE),
              "tube": _revolve([(1, -1), (1, 1)], sectors=0, around=COARSE)}

    def by_tint(mesh: Mesh) -> list[dict[str, Any]]:
        """Return a mesh for each lightness of faces: pages draw each in one colour."""
        return [{"tint": tint,
                 **encode(IndexedMesh.of(mesh.points[mesh.faces[mesh.light == tint]]))}
                for tint in np.unique(mesh.light).tolist()]

    return {name: by_tint(mesh) for name, mesh in solids.items()}


def mesh_of_file(shape: Shape, mesh: IndexedMesh) -> Mesh:
    """Return the triangles of a mesh in body axes, with edges sharper than 37° left sharp.

    The normal of a vertex is the mean of its triangles' normals, weighted by area; where it differs
    from that of a triangle by more, the triangle keeps its own.
    """
    points = shape.centre + (mesh.points * shape.size) @ shape.axes.T
    corners = points[mesh.triangles]
    # twice the area along the normal
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(crossed, axis=1, keepdims=True)
    flat = crossed / np.where(length, length, 1.0)
    normal_sums = np.stack([np.bincount(mesh.triangles.ravel(), np.repeat(column, 3), len(points))
                            for column in crossed.T], axis=1)
    size = np.linalg.norm(normal_sums, axis=1, keepdims=True)
    smooth = (normal_sums / np.where(size, size, 1.0))[mesh.triangles]
    sharp = (smooth * flat[:, None]).sum(axis=2, keepdims=True) < _CREASE
    normals = np.where(sharp, flat[:, None], smooth)
    return Mesh(corners.reshape(-1, 3), normals.reshape(-1, 3),
                np.arange(3 * len(corners)).reshape(-1, 3), np.zeros(len(corners)))


def _column(radii: Array, heights: Array) -> Profile:
    """Return a profile, a list of (radius, height), from an array of each."""
    return list(zip(radii.tolist(), heights.tolist(), strict=True))


def _unit_sphere(around: int) -> Mesh:
    """Return a sphere of radius 1, with quarters of two tints that show how it turns."""
    polar_angles = np.linspace(0, np.pi, around // 3 + 1)
    return _revolve(_column(np.sin(polar_angles), -np.cos(polar_angles)), sectors=4, around=around)


def _bar(r: float, half: float, around: int) -> Mesh:
    """Return a cylinder of radius r with half spheres at ``half`` before and behind its centre."""
    polar_angles = np.linspace(0, np.pi / 2, 5)
    lower = _column(r * np.sin(polar_angles), -half - r * np.cos(polar_angles))
    return _revolve(lower + [(x, -z) for x, z in reversed(lower)], sectors=0, around=around)


def _cylinder(r: float, half: float) -> Profile:
    """Return the profile of a cylinder with bevelled edges."""
    bevel = 0.15 * min(r, half)
    return [(0, -half), (r - bevel, -half), (r, bevel - half), (r, half - bevel), (r - bevel, half),
            (0, half)]


def _wheel(r: float, half: float) -> Profile:
    """Return the profile of a disc whose rim and hub are thicker than its web."""
    rim, hub, web, edge = 0.84 * r, 0.2 * r, 0.5 * half, 0.2 * min(half, 0.16 * r)
    lower = [(0, -half), (hub, -half), (hub, -web), (rim, -web), (rim, edge - half),
             (rim + edge, -half), (r - edge, -half), (r, edge - half)]
    return lower + [(x, -z) for x, z in reversed(lower)]


def join_meshes(meshes: list[Mesh]) -> Mesh:
    """Return several meshes as one."""
    first_vertices = np.cumsum([0] + [len(mesh.points) for mesh in meshes[:-1]])
    return Mesh(np.concatenate([mesh.points for mesh in meshes]),
                np.concatenate([mesh.normals for mesh in meshes]),
                np.concatenate([mesh.faces + k
                                for mesh, k in zip(meshes, first_vertices, strict=True)]),
                np.concatenate([mesh.light for mesh in meshes]))


def tube(line: Array, radius: float, around: int = 8) -> Mesh:
    """Return a tube about a line of points, shape (n, 3); ``around`` is its number of segments.

    Its rings are spanned by u and v = e × u, e the direction of the line, where u is transported
    parallel: u ← u − (u·e) e, of length 1, so that the tube is not twisted.
    """
    along = np.gradient(line, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    side = axes_about(along[0])[:, 0]
    rings = []
    for e in along:
        side = side - (side @ e) * e
        side = side / np.linalg.norm(side)
        rings.append((side, np.cross(e, side)))
    turns = 2 * np.pi * np.arange(around + 1) / around
    normals = np.array([np.outer(np.cos(turns), u) + np.outer(np.sin(turns), v)
                        for u, v in rings])
    return _grid(line[:, None] + radius * normals, normals)


def _grid(points: Array, normals: Array, light: Array | None = None) -> Mesh:
    """Return the mesh of a net of points, shape (rows, columns, 3), without empty triangles.

    ``normals`` has the normal at each point; ``light`` is one number for each column of
    quadrilaterals.
    """
    row_count, column_count = points.shape[:2]
    vertex_number = np.arange(row_count * column_count).reshape(row_count, column_count)
    # the corners of each quadrilateral, in order around it
    a, b, c, d = (vertex_number[:-1, :-1], vertex_number[1:, :-1], vertex_number[1:, 1:],
                  vertex_number[:-1, 1:])
    faces = np.stack([np.stack([a, d, c], -1), np.stack([a, c, b], -1)], axis=2).reshape(-1, 3)
    shade = np.zeros(len(faces)) if light is None else np.repeat(light.ravel(), 2)
    vertices = points.reshape(-1, 3)
    corner = vertices[faces]
    # poles and closed ends of a profile give triangles with two equal corners
    crossed = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.linalg.norm(crossed, axis=1)
    not_empty = area > 1e-12 * max(float(area.max(initial=0.0)), 1e-300)
    return Mesh(vertices, normals.reshape(-1, 3), faces[not_empty], shade[not_empty])


def _revolve(profile: Profile, sectors: int, around: int) -> Mesh:
    """Return a surface of revolution about the third axis; every second sector is lighter.

    With 0 ``sectors`` no part is lighter. ``profile`` is a line of (radius, height). Neighbouring
    pieces that meet at a small angle share their normals, so that they look smooth.
    """
    line = np.array(profile, float)
    step = np.diff(line, axis=0)
    distinct = step.any(axis=1)  # repeated points have no normal
    line, step = line[np.append(True, distinct)], step[distinct]
    # (dz, −dr) points outwards, where the line leads upwards
    normal = np.stack([step[:, 1], -step[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # normals at the two ends of each piece: their sum with the neighbour's where the line is smooth
    starts, ends = normal.copy(), normal.copy()
    smooth = np.flatnonzero((normal[1:] * normal[:-1]).sum(axis=1) > _SMOOTH)
    ends[smooth] = starts[smooth + 1] = normal[smooth] + normal[smooth + 1]
    angles = 2 * np.pi * np.arange(around + 1) / around
    circle = np.stack([np.cos(angles), np.sin(angles)])
    lighter = (np.arange(around) * sectors // around % 2).astype(float)

    def surface_ring(profile_ends: Array) -> Array:
        """Return (r, z) of two ends, (2, 2), turned about the axis: (2, around + 1, 3)."""
        ring = profile_ends[:, None, 0, None] * circle.T
        heights = np.broadcast_to(profile_ends[:, None, 1, None], (*ring.shape[:2], 1))
        return np.concatenate([ring, heights], axis=2)

    rings = []
    for k in range(len(step)):
        n = np.stack([starts[k], ends[k]])
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        rings.append(_grid(surface_ring(line[k:k + 2]), surface_ring(n), lighter))
    return join_meshes(rings)


def _box(half: Array) -> Mesh:
    """Return a box with rounded edges: a sphere whose octants are moved to the corners.

    With the corner's signs s, the bevel b and the sphere's normal n(θ, φ), θ from the pole:

        x = s (half − b) + b n

    Two caps close the flat poles.
    """
    # edges and corners take each boundary of octants twice, with the signs of either side
    bevel = min(_BEVEL[0] * half.min(), _BEVEL[1] * half.max())
    quarter = np.linspace(0, np.pi / 2, 4)
    # four quarters of φ with the signs of x and y in each, and the first column again at the end
    phi = np.concatenate([quarter + k * np.pi / 2 for k in range(4)])
    sign = np.repeat(np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]], float), len(quarter), axis=0)
    phi, sign = np.append(phi, phi[0]), np.concatenate([sign, sign[:1]])
    theta = np.concatenate([quarter, quarter + np.pi / 2])  # the halves z > 0 and z < 0
    up = np.repeat([1.0, -1.0], len(quarter))
    normals = np.stack([np.outer(np.sin(theta), np.cos(phi)), np.outer(np.sin(theta), np.sin(phi)),
                        np.outer(np.cos(theta), np.ones_like(phi))], axis=-1)
    corner = np.stack([np.broadcast_to(sign[:, 0], normals.shape[:2]),
                       np.broadcast_to(sign[:, 1], normals.shape[:2]),
                       np.broadcast_to(up[:, None], normals.shape[:2])], axis=-1)
    points = corner * (half - bevel) + bevel * normals
    sides = _grid(points[::-1], normals[::-1])
    caps = []
    for row in (0, -1):  # the poles: four corners, which lie in a plane
        ends = points[row, ::len(quarter)][:4]
        n = np.broadcast_to(normals[row, 0], (4, 3))
        faces = np.array([[0, 1, 2], [0, 2, 3]])
        caps.append(Mesh(ends, n, faces if row == 0 else faces[:, ::-1], np.zeros(2)))
    return join_meshes([sides, *caps])
