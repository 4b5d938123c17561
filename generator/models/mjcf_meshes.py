"""Geoms of meshes, for MuJoCo's compiler, which then opens no file of a mesh, texture or field.

A mesh that gives mass to a body is measured (``closed_mesh``) and replaced by an ellipsoid of the
same mass, centre and inertia; other meshes become spheres without mass at their places.
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
    """A geom of a mesh in the compiled model, in which an ellipsoid or a sphere replaces it."""

    name: str
    inner: Placement  # the mesh's file in the axes of the compiled geom
    shape: Callable[[str], Shape] | None  # colour → shape; None for a geom fitted to a mesh


def remove_files(mujoco: Any, spec: Any, folder: Path) -> list[MeshGeom]:
    """Remove meshes, textures and height fields from a specification; return its mesh geoms.

    The files are below ``folder``. Raises InputError for meshes that give mass and cannot be
    measured.
    """
    kinds = mujoco.mjtGeom
    names = {geom.name for geom in spec.geoms}
    meshes = {mesh.name: mesh for mesh in spec.meshes if mesh.file}
    volumes: dict[str, Volume] = {}  # meshes that are measured, by name
    geoms = []
    for number, geom in enumerate([*spec.geoms]):
        # a height field becomes a sphere without mass that is not drawn
        if geom.type == kinds.mjGEOM_HFIELD:
            geom.type, geom.size, geom.mass, geom.rgba = kinds.mjGEOM_SPHERE, [1] * 3, 0.0, [0] * 4
            geom.hfieldname = ""
        if geom.meshname not in meshes:
            continue
        mesh = meshes[geom.meshname]
        # MuJoCo fits a capsule or a box that names a mesh to it, which would need the file
        is_fitted = geom.type not in (kinds.mjGEOM_MESH, kinds.mjGEOM_SDF)
        outer = _replace_mesh(kinds, spec, geom, mesh, is_fitted, folder, volumes)
        # the geom is found in the compiled model by its name
        if not geom.name:
            geom.name = next(name for k in count(number) if (name := f"mesh{k}") not in names)
            names.add(geom.name)
        # without a scale along the file's axes the mesh is sheared, which no shape here is
        inner, scale = _stretch(mesh)
        geoms.append(MeshGeom(geom.name, outer.then(inner), None if is_fitted or scale is None else
                              partial(_shape, scale, _file(mesh, spec.strippath).as_posix())))
    _remove_elements_of_files(kinds, spec, meshes)
    return geoms


def _replace_mesh(
    kinds: Any, spec: Any, geom: Any, mesh: Any, is_fitted: bool, folder: Path,
    volumes: dict[str, Volume],
) -> Placement:
    """Make a geom of a mesh an ellipsoid of equal mass and inertia, or a sphere without mass.

    ``kinds`` is MuJoCo's ``mjtGeom``, ``spec`` its specification, to which geom and mesh belong;
    ``is_fitted``: the geom is a primitive fitted to the mesh. Measured meshes are added to
    ``volumes`` by name. Returns the pose of the old axes of the geom in its new ones. Raises
    InputError for a mesh whose mass is not that of its volume.
    """
    geom_type = kinds.mjGEOM_SPHERE
    outer = IDENTITY
    if _weighs(spec, geom):
        if is_fitted or int(geom.typeinertia):
            raise InputError(f"the mesh {shown(mesh.name)} gives mass to a body as a shape that is "
                             "fitted to it, or as a shell; give that body an <inertial>.")
        if mesh.name not in volumes:
            volumes[mesh.name] = _measure(mesh, folder, spec.strippath)
        outer = _put_ellipsoid(geom, volumes[mesh.name])
        geom_type = kinds.mjGEOM_ELLIPSOID
    else:
        geom.size, geom.mass = [1] * 3, 0.0
    geom.type = geom_type
    geom.meshname = ""
    return outer


def _remove_elements_of_files(kinds: Any, spec: Any, meshes: Collection[str]) -> None:
    """Remove the elements of a specification that need files, and what names them.

    A texture of one colour colours its material. Sizes of MuJoCo's memory become its defaults.
    """
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
    # a file may ask for more of them than it has
    spec.nkey, spec.nuserdata = len(spec.keys), 0
    for size in ("memory", "njmax", "nconmax", *(e for e in dir(spec) if e.startswith("nuser_"))):
        # −1: MuJoCo computes the size that it needs
        setattr(spec, size, -1)
    # no ranges of muscles, for which MuJoCo would simulate
    spec.compiler.LRopt.mode = 0


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
    # MuJoCo has NaN for a mass that the file does not give
    return bool(geom.density if np.isnan(geom.mass) else geom.mass)


def _reference(mesh: Any) -> Placement:
    """Return the placement of a mesh's axes in the axes of its file, by refpos and refquat."""
    return Placement(np.array(mesh.refpos), rotation(unit(np.array(mesh.refquat))))


def _stretch(mesh: Any) -> tuple[Placement, Floats | None]:
    """Return the placement of a mesh's file in the mesh's axes, and its scale, shape (3,).

    The mesh has the points S Rᵀ (v − x) for points v of the file: S is the diagonal matrix of its
    scale, and R and x are of ``_reference``. M = S Rᵀ is a rotation times a scale along the file's
    axes if its columns are perpendicular; the scale is None otherwise.
    """
    axes = _reference(mesh)
    M = np.diag(mesh.scale) @ axes.R.T
    # a reflection has a negative scale, so that M / scale is a rotation
    scale = np.linalg.norm(M, axis=0) * (1 if np.linalg.det(M) > 0 else -1)
    square = M.T @ M
    if not all(scale) or np.abs(square - np.diag(scale**2)).max() > 1e-12 * square.max():
        return IDENTITY, None
    return Placement(-M @ axes.x, M / scale), scale


def _file(mesh: Any, strip: bool) -> Path:
    """Return the path of a mesh from the folder of the model; ``strip`` drops its own folder."""
    name = re.split(r"[/\\]", mesh.file)[-1] if strip else mesh.file
    return Path(mesh.compiler.meshdir) / name


def _shape(scale: Floats, file: str, colour: str) -> Shape:
    """Return the shape of a mesh's file, scaled along the file's axes."""
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
        # a reflection turns triangles inside out
        if scale.prod() < 0:
            corners = corners[:, ::-1]
        return mesh_volume(convex_hull(corners) if method == "convex" else corners,
                           overlaps=method == "legacy")
    except InputError as error:
        raise InputError(f"the mesh {shown(mesh.name)} gives mass to a body, and its file "
                         f"{shown(file.as_posix())} is not usable: {error}") from None


def _put_ellipsoid(geom: Any, volume: Volume) -> Placement:
    """Make a geom an ellipsoid with a mesh's mass; return its old axes in the new ones.

    An ellipsoid with the semi-axes a, b, c has the moments I₁ = m (b² + c²)/5, …, so that
    a² = 5 (I₂ + I₃ − I₁)/(2m), ….
    """
    moments, axes = np.linalg.eigh(volume.moments)
    # right-handed principal axes
    axes[:, 0] *= np.linalg.det(axes)
    # the geom's pose goes to a new frame, and the geom gets the principal axes in that frame
    frame = geom.parent.add_frame()
    if geom.frame is not None:
        frame.set_frame(geom.frame)
    frame.pos, frame.quat = geom.pos, geom.quat
    for key in ("type", "axisangle", "xyaxes", "zaxis", "euler"):
        setattr(frame.alt, key, getattr(geom.alt, key))
    # 0: the attitude is the quaternion
    geom.alt.type = type(geom.alt.type)(0)
    geom.set_frame(frame)
    geom.pos, geom.quat = volume.centre, quaternion_of_matrix(axes, "axes of inertia")
    # a flat mesh has a semi-axis of 0, which MuJoCo refuses
    geom.size = np.sqrt(2.5 * np.maximum(moments.sum() - 2 * moments, 1e-12 * moments.sum()))
    if np.isnan(geom.mass):
        geom.mass = geom.density * volume.volume
    return Placement(-axes.T @ volume.centre, axes.T)
