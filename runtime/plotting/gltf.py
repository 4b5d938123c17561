"""A trajectory as a binary glTF file, which Blender and most viewers of 3-D models read.

glTF 2.0 (ISO/IEC 12113): a header, a chunk of JSON, a chunk of numbers. Each body is a node whose
translation and rotation are animated, linearly between the frames; +Y is up, lengths are in metres.
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..._version import __version__
from ...core.arguments import choose
from ...core.file_formats import checked_path, result_file
from ...core.shapes import Shape, axes_about
from .body_shapes import METAL
from .html_view import with_visuals
from .meshes import MESHES, IndexedMesh, MeshesName
from .scene import ROD, Scene, Tie, scene_of
from .solids import COLOURS, Mesh, join_meshes, mesh_of

if TYPE_CHECKING:
    from ..results.trajectory import Trajectory

__all__ = ["export_gltf"]

Array = NDArray[Any]

#: Most key frames: a minute at 60 frames a second.
_FRAMES = 3600
_GROUND = "#969ea6"
#: Component type → its number in glTF; element shape → its name.
_TYPES = {np.dtype("<f4"): 5126, np.dtype("<u4"): 5125}
_SHAPES = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4"}
_ELEMENTS, _VERTICES = 34963, 34962  # uses of a buffer view


def export_gltf(
    trajectory: Trajectory, path: str | os.PathLike[str], *, meshes: MeshesName = "full"
) -> Path:
    """Write the bodies, joints and motion of a trajectory as .glb; return the path.

    Parameters
    ----------
    trajectory : Trajectory
        Of at least one rigid body. Of more than 3600 states, 3600 are written, evenly spread.
    path : path
        A name that ends in .glb.
    meshes : {"small", "full", "none"}
        Which meshes of a robot's file are written, as for ``view``.

    Raises
    ------
    InputError
        Where there is no rigid body; for another ending or number of meshes.
    GyrosparkError
        If the file cannot be written.
    """
    target = checked_path(path, "top.glb", "A 3-D model", "model")
    choose("meshes", meshes, MESHES)
    scene, mesh_files = with_visuals(trajectory, scene_of(trajectory, _FRAMES), meshes)
    with result_file(target, "The model") as partial_file:
        partial_file.write_bytes(_Document(scene, mesh_files).as_bytes())
    return target


class _Document:
    """The JSON of a scene, and its numbers."""

    def __init__(self, scene: Scene, meshes: Mapping[str, IndexedMesh]) -> None:
        """Fill the lists of the JSON; their entries refer to each other by indices."""
        self.numbers = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.materials: dict[str, int] = {}
        self.meshes: list[dict[str, Any]] = []
        # node 0 turns the vertical of the scene to +y, the vertical of glTF
        self.nodes: list[dict[str, Any]] = [{
            "name": scene.title, "rotation": _rotation(scene.up, np.array([0.0, 1.0, 0.0]))}]
        self.samplers: list[dict[str, Any]] = []
        self.channels: list[dict[str, Any]] = []
        self.scene, self.mesh_files = scene, meshes
        # times of keyframes must increase, also of a run backwards
        self.times = self._accessor((scene.t - scene.t[0]) * np.sign(scene.t[-1] - scene.t[0] or 1),
                                    "<f4")
        self.reach = scene.reach(0)
        for i, body in enumerate(scene.parts):
            shapes = body.shapes or [Shape("box", body.sizes["box"], body.centre, body.axes)]
            self._node(body.name, [*shapes, *scene.joints_on(i, self.reach)],
                       COLOURS[i % len(COLOURS)], translation=body.x,
                       rotation=_scalar_last(body.q))
        ground_shapes = [*scene.ground, *scene.joints_on(-1, self.reach)]
        if ground_shapes:
            self._node("ground", ground_shapes, _GROUND)
        for tie in scene.ties:
            if tie.kind in ("rod", "spring"):
                self._rod(tie)
        self.nodes[0]["children"] = list(range(1, len(self.nodes)))

    def as_bytes(self) -> bytes:
        """Return the file."""
        # an animation needs two frames
        animated = self.channels and len(self.scene.t) > 1
        text = json.dumps({
            "asset": {"version": "2.0", "generator": f"gyrospark {__version__}"},
            "scene": 0, "scenes": [{"nodes": [0]}], "nodes": self.nodes, "meshes": self.meshes,
            "materials": [_material(colour) for colour in self.materials],
            "accessors": self.accessors, "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.numbers)}],
            **({"animations": [{"name": "run", "samplers": self.samplers,
                                "channels": self.channels}]} if animated else {}),
        }, allow_nan=False).encode()
        text += b" " * (-len(text) % 4)  # chunks have whole words
        # little-endian words: each chunk has its length and its kind, "JSON" or "BIN"
        json_chunk = struct.pack("<II", len(text), 0x4E4F534A) + text
        binary_chunk = struct.pack("<II", len(self.numbers), 0x004E4942) + bytes(self.numbers)
        size = 12 + len(json_chunk) + len(binary_chunk)  # with this header
        return struct.pack("<4sII", b"glTF", 2, size) + json_chunk + binary_chunk

    def _accessor(self, array: Array, kind: str, use: int = 0) -> int:
        """Append an array to the numbers; return the index of its accessor, with its bounds.

        ``kind`` is a NumPy type such as "<f4"; ``use`` is glTF's number of the target of a buffer
        view, needed for vertices and their indices alone.
        """
        numbers = np.ascontiguousarray(array, dtype=kind)
        self.views.append({"buffer": 0, "byteOffset": len(self.numbers),
                           "byteLength": numbers.nbytes,
                           **({"target": use} if use else {})})
        self.numbers += numbers.tobytes()  # of four bytes each: aligned
        self.accessors.append({
            "bufferView": len(self.views) - 1, "componentType": _TYPES[numbers.dtype],
            "count": len(numbers), "type": _SHAPES[numbers.shape[1:]],
            "min": np.atleast_1d(numbers.min(axis=0)).tolist(),
            "max": np.atleast_1d(numbers.max(axis=0)).tolist()})
        return len(self.accessors) - 1

    def _rod(self, tie: Tie) -> None:
        """Add a bar that is moved, turned and stretched between two points a and b.

        Its node has the translation (a + b)/2, the rotation of the third axis to b − a, and the
        scale |b − a|/2 along it: a bar of half length 1 serves all frames.
        """
        def path(i: int, r: Array) -> Array:
            """Return the point r of body i, or of the ground −1, in each frame."""
            return (self.scene.parts[i].at(r)[:, 0] if i >= 0
                    else np.tile(r, (len(self.scene.t), 1)))

        a, b = path(tie.a, tie.on_a), path(tie.b, tie.on_b)
        # above 0, also where the points coincide
        length = np.maximum(np.linalg.norm(b - a, axis=1, keepdims=True), 1e-9 * self.reach)
        third = np.array([0.0, 0.0, 1.0])
        q = np.array([_rotation(third, e) for e in (b - a) / length])
        r = ROD * self.reach
        self._node(tie.name, [Shape("disc", np.array([r, r, 1.0]), np.zeros(3), colour=METAL)],
                   METAL, translation=(a + b) / 2, rotation=q,
                   scale=np.hstack([np.ones((len(q), 2)), length / 2]))

    def _node(self, name: str, shapes: Iterable[Shape], colour: str, **motion: Array) -> None:
        """Add a node of shapes, with the motion that is not constant as an animation.

        ``motion`` has rows of glTF's "translation", "rotation" or "scale", one a frame.
        """
        node: dict[str, Any] = {"name": name, "mesh": len(self.meshes)}
        self.meshes.append({"name": name, "primitives": list(self._primitives(shapes, colour))})
        for path, channel in motion.items():
            node[path] = channel[0].tolist()
            # what stays is in the node itself
            if np.ptp(channel, axis=0).any():
                self.channels.append({"sampler": len(self.samplers), "target": {
                    "node": len(self.nodes), "path": path}})
                self.samplers.append({"input": self.times, "interpolation": "LINEAR",
                                      "output": self._accessor(channel, "<f4")})
        self.nodes.append(node)

    def _primitives(self, shapes: Iterable[Shape], colour: str) -> Iterable[dict[str, Any]]:
        """Yield a primitive for each colour of solids, and one for each mesh of a file."""
        solids: dict[str, list[Mesh]] = {}
        for shape in shapes:
            shape_colour = shape.colour or colour
            if shape.file:  # without normals it is flat
                mesh = self.mesh_files[shape.file]
                # a mirrored mesh has its corners in the other order
                faces = mesh.triangles if np.prod(shape.size) > 0 else mesh.triangles[:, ::-1]
                accessor = self._accessor(shape.centre + mesh.points * shape.size @ shape.axes.T,
                                          "<f4", _VERTICES)
                yield self._primitive({"POSITION": accessor}, faces, shape_colour)
                continue
            solid = mesh_of(shape)
            # a shape with a colour of its own has one tint; faces of others are lighter or not
            for tint in {0.0} if shape.colour else {*solid.light.tolist()}:
                faces_of_tint = solid.faces if shape.colour else solid.faces[solid.light == tint]
                # the vertices of these faces alone, numbered from 0
                vertices, faces = np.unique(faces_of_tint, return_inverse=True)
                solids.setdefault(_lighter(shape_colour, 0.42 * tint), []).append(replace(
                    solid, points=solid.points[vertices], normals=solid.normals[vertices],
                    faces=faces.reshape(-1, 3)))
        for shape_colour, solid_parts in solids.items():
            solid_mesh = join_meshes(solid_parts)
            yield self._primitive({"POSITION": self._accessor(solid_mesh.points, "<f4", _VERTICES),
                                   "NORMAL": self._accessor(solid_mesh.normals, "<f4", _VERTICES)},
                                  solid_mesh.faces, shape_colour)

    def _primitive(self, attributes: dict[str, int], faces: Array, colour: str) -> dict[str, Any]:
        """Return a primitive: accessors of its vertices by attribute, its triangles and its
        material."""
        return {"attributes": attributes,
                "indices": self._accessor(faces.ravel(), "<u4", _ELEMENTS),
                "material": self.materials.setdefault(colour, len(self.materials))}


def _scalar_last(q: Array) -> Array:
    """Return unit quaternions, shape (frames, 4), scalar last, with signs that make them
    continuous."""
    # viewers interpolate numbers, and between q and −q that is a full turn
    signs = np.cumprod(np.append(1.0, np.where((q[1:] * q[:-1]).sum(axis=1) < 0, -1.0, 1.0)))
    unit: Array = q * (signs / np.linalg.norm(q, axis=1))[:, None]
    return unit[:, [1, 2, 3, 0]]


def _rotation(start: Array, end: Array) -> list[float]:
    """Return the shortest rotation of one unit vector to another: a quaternion, scalar last."""
    # (sin θ n, 1 + cos θ) = 2 cos(θ/2) (sin(θ/2) n, cos(θ/2))
    q = np.append(np.cross(start, end), 1 + start @ end)
    if q[3] < 1e-9:  # opposite: about any axis that is normal to both
        q = np.append(axes_about(start)[:, 0], 0.0)
    rotation: list[float] = (q / np.linalg.norm(q)).tolist()
    return rotation


def _lighter(colour: str, share: float) -> str:
    """Return a colour "#rrggbb" moved towards white by a share of the way."""
    rgb = [int(colour[k:k + 2], 16) for k in (1, 3, 5)]
    return "#" + "".join(f"{round(x + share * (255 - x)):02x}" for x in rgb)


def _material(colour: str) -> dict[str, Any]:
    """Return a material of an sRGB colour, whose components glTF has linear in light."""
    rgb = np.array([int(colour[k:k + 2], 16) for k in (1, 3, 5)]) / 255
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return {"name": colour, "doubleSided": True, "pbrMetallicRoughness": {
        "baseColorFactor": [*linear.round(6).tolist(), 1.0], "metallicFactor": 0.1,
        "roughnessFactor": 0.6}}
