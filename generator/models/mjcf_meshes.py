"""Geoms of meshes, for MuJoCo's compiler: no file of a mesh, a texture or a field is opened by it.

A mesh that gives mass to a body is measured (``closed_mesh``), and an ellipsoid of the same mass,
centre and inertia takes its place; other meshes become spheres without mass, where they are.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arguments import shown
from ...core.arrays import Floats
from ...core.errors import InputError
from ...core.inertia import quaternion_of_matrix
from ...core.mesh_files import read_triangles
from ...core.records import dataclass
from ...core.shapes import Shape
from ..multibody.initial_poses import rotation, unit
from .closed_mesh import Volume, convex_hull, mesh_volume
from .mjcf_document import is_within
from .robot_tree import IDENTITY, Placement

__all__ = ["MeshGeom", "remove_files"]


@dataclass(frozen=True, eq=False)
class MeshGeom:
    """A geom of a mesh: its name, its shape by its colour, and where that is in the compiled geom.

    A geom that is fitted to a mesh has no shape.
    """

    name: str
    inner: Placement
    shape: Callable[[str], Shape] | None


def remove_files(mujoco: Any, spec: Any, folder: Path) -> list[MeshGeom]:
    """Remove meshes, textures and height fields from a specification; return its mesh geoms.

    Raises InputError for meshes that give mass and cannot be measured.
    """
    kinds = mujoco.mjtGeom
    names = {geom.name for geom in spec.geoms}
    meshes = {mesh.name: mesh for mesh in spec.meshes if mesh.file}
    volumes: dict[str, Volume] = {}
    geoms = []
    for number, geom in enumerate([*spec.geoms]):
        # in place of a height field, a sphere without mass that is not drawn
        if geom.type == kinds.mjGEOM_HFIELD:
            geom.type, geom.size, geom.mass, geom.rgba = kinds.mjGEOM_SPHERE, [1] * 3, 0.0, [0] * 4
            geom.hfieldname = ""
        if geom.meshname not in meshes:
            continue
        mesh, weighs = meshes[geom.meshname], _weighs(spec, geom)
        # MuJoCo fits a capsule or a box that names a mesh to it, which would need the file
        is_fitted = geom.type not in (kinds.mjGEOM_MESH, kinds.mjGEOM_SDF)
        if weighs and (is_fitted or int(geom.typeinertia)):
            raise InputError(f"the mesh {shown(mesh.name)} gives mass to a body as a shape that is "
                             "fitted to it, or as a shell; give that body an <inertial>.")
        # an ellipsoid of the mass, centre and moments of the mesh takes its place
        outer = IDENTITY
        if weighs:
            if mesh.name not in volumes:
                volumes[mesh.name] = _measure(mesh, folder, spec.strippath)
            outer = _put_ellipsoid(geom, volumes[mesh.name])
        else:
            geom.size, geom.mass = [1] * 3, 0.0
        geom.type = kinds.mjGEOM_ELLIPSOID if weighs else kinds.mjGEOM_SPHERE
        geom.meshname = ""
        if not geom.name:
            geom.name = next(name for k in count(number) if (name := f"mesh{k}") not in names)
            names.add(geom.name)
        inner, size = _stretch(mesh)
        geoms.append(MeshGeom(geom.name, outer.then(inner), None if is_fitted or size is None else
                              partial(_shape, size, _file(mesh, spec.strippath).as_posix())))
    _remove(kinds, spec, meshes)
    return geoms


def _remove(kinds: Any, spec: Any, meshes: Collection[str]) -> None:
    """Remove files and elements that name them; a texture of one colour colours its material."""
    textures = {texture.name: texture for texture in spec.textures}
    for material in spec.materials:
        for name in filter(None, material.textures):
            # a texture that MuJoCo makes itself has a colour; that of a picture is not known, and
            # a white material under it becomes grey
            tint = [*textures[name].rgb1, 1.0] if name in textures and int(
                textures[name].builtin) else None
            is_white = tint is None and list(material.rgba) == [1.0] * 4
            material.rgba = [0.5, 0.5, 0.5, 1] if is_white else np.multiply(
                material.rgba, 1.0 if tint is None else tint)
        material.textures = [""] * len(material.textures)
    for site in spec.sites:
        if site.meshname in meshes:
            site.meshname, site.type = "", kinds.mjGEOM_SPHERE
    for element in [*spec.sensors, *spec.skins, *spec.textures, *spec.hfields,
                    *(mesh for mesh in spec.meshes if mesh.name in meshes)]:
        spec.delete(element)
    spec.nkey, spec.nuserdata = len(spec.keys), 0
    for size in ("memory", "njmax", "nconmax", *(e for e in dir(spec) if e.startswith("nuser_"))):
        setattr(spec, size, -1)  # as MuJoCo needs it
    spec.compiler.LRopt.mode = 0  # ranges of muscles, for which MuJoCo would simulate


def _weighs(spec: Any, geom: Any) -> bool:
    """Return whether a geom gives mass to a body whose mass matters.

    A body that no joint moves, itself or above it, has a mass only for ``settotalmass``.
    """
    body, (lowest, highest) = geom.parent, geom.compiler.inertiagrouprange
    # inertiafromgeom: 0 false, 1 true, 2 auto
    mode = int(geom.compiler.inertiafromgeom)
    moves, ancestor = False, body
    while ancestor is not None and not moves:
        moves, ancestor = bool(ancestor.joints), ancestor.parent
    if not (moves or spec.compiler.settotalmass > 0):
        return False
    if not (mode == 1 or (mode == 2 and not body.explicitinertial)):
        return False
    if not lowest <= geom.group <= highest:
        return False
    return bool(geom.density if np.isnan(geom.mass) else geom.mass)


def _reference(mesh: Any) -> Placement:
    """Return the axes of a mesh in those of its file."""
    return Placement(np.array(mesh.refpos), rotation(unit(np.array(mesh.refquat))))


def _stretch(mesh: Any) -> tuple[Placement, Floats | None]:
    """Return where a mesh's file is in its axes, and its scale there; None where it is sheared.

    The mesh is S Rᵀ (v − x) of the file's v.
    """
    axes = _reference(mesh)
    M = np.diag(mesh.scale) @ axes.R.T
    size = np.linalg.norm(M, axis=0) * (1 if np.linalg.det(M) > 0 else -1)
    square = M.T @ M
    if not all(size) or np.abs(square - np.diag(size**2)).max() > 1e-12 * square.max():
        return IDENTITY, None
    return Placement(-M @ axes.x, M / size), size


def _file(mesh: Any, strip: bool) -> Path:
    """Return the path of a mesh from the folder of the model."""
    name = re.split(r"[/\\]", mesh.file)[-1] if strip else mesh.file
    return Path(mesh.compiler.meshdir) / name


def _shape(scale: Floats, file: str, colour: str) -> Shape:
    return Shape("mesh", scale, colour=colour, file=file)


def _measure(mesh: Any, folder: Path, strip: bool) -> Volume:
    """Return the volume of a mesh in its axes, by MuJoCo's method ``inertia`` of the mesh.

    "exact" is the volume inside the triangles, "convex" the volume of their hull, and "legacy"
    counts each tetrahedron from the centre as positive.
    """
    file = _file(mesh, strip)
    method = mesh.inertia.name.rpartition("_")[2].lower()
    try:
        if method == "shell":
            raise InputError("its inertia is that of a shell; write inertia=\"exact\".")
        if not is_within(folder, file.as_posix()):
            raise InputError("it is not in the folder of the model; move it there.")
        axes, scale = _reference(mesh), np.array(mesh.scale)
        corners = (read_triangles(folder / file) - axes.x) @ axes.R * scale
        if scale.prod() < 0:  # a reflection turns triangles inside out
            corners = corners[:, ::-1]
        return mesh_volume(convex_hull(corners) if method == "convex" else corners,
                           overlaps=method == "legacy")
    except InputError as error:
        raise InputError(f"the mesh {shown(mesh.name)} gives mass to a body, and its file "
                         f"{shown(file.as_posix())} is not usable: {error}") from None


def _put_ellipsoid(geom: Any, volume: Volume) -> Placement:
    """Make a geom an ellipsoid with a mesh's mass; return its old axes in the new ones.

    Moments m (b² + c²)/5, … are those of the semi-axes a² = 5 (I₂ + I₃ − I₁)/(2m), ….
    """
    moments, axes = np.linalg.eigh(volume.moments)
    axes[:, 0] *= np.linalg.det(axes)
    frame = geom.parent.add_frame()
    if geom.frame is not None:
        frame.set_frame(geom.frame)
    frame.pos, frame.quat = geom.pos, geom.quat
    for key in ("type", "axisangle", "xyaxes", "zaxis", "euler"):
        setattr(frame.alt, key, getattr(geom.alt, key))
    geom.alt.type = type(geom.alt.type)(0)  # of a quaternion
    geom.set_frame(frame)
    geom.pos, geom.quat = volume.centre, quaternion_of_matrix(axes, "axes of inertia")
    geom.size = np.sqrt(2.5 * np.maximum(moments.sum() - 2 * moments, 1e-12 * moments.sum()))
    if np.isnan(geom.mass):
        geom.mass = geom.density * volume.volume
    return Placement(-axes.T @ volume.centre, axes.T)
