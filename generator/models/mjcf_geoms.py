"""Mass, centre and inertia of geoms by their shape and density, and what there is to be drawn.

    sphere r                  4πr³/3       2r²/5
    ellipsoid a, b, c         4πabc/3      (b² + c²)/5, …
    box a, b, c (half edges)  8abc         (b² + c²)/3, …
    cylinder r, h (half)      2πr²h        r²/4 + h²/3 across, r²/2 along
    capsule r, h (half)       V_c + V_s    (V_c (3r² + L²)/12 + V_s (2r²/5 + L²/4 + 3Lr/8))/V and
                                           (V_c r²/2 + V_s 2r²/5)/V

with V_c = πr²L, V_s = 4πr³/3, L = 2h: volumes and moments per mass. Meshes: ``closed_mesh``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...core.shapes import Shape, ShapeKind
from ..multibody.initial_poses import onto, rotation
from .closed_mesh import Volume
from .mjcf_document import Given, Settings
from .robot_visuals import Look, colour_of
from .urdf_robot import IDENTITY, Placement, RobotLink

__all__ = ["KINDS", "Geom", "geom_mass", "geom_shape"]

Array = NDArray[np.float64]

#: Type of a geom → how many sizes it has, and the fewest that have to be given.
KINDS: Mapping[str, int] = {"sphere": 1, "ellipsoid": 3, "box": 3, "cylinder": 2, "capsule": 2,
                            "plane": 0, "hfield": 0, "mesh": 0, "sdf": 0}
_DRAWN: Mapping[str, ShapeKind] = {"sphere": "sphere", "ellipsoid": "sphere", "box": "box",
                                   "cylinder": "disc", "capsule": "bar"}
#: Density of what says none, in kg/m³: that of water.
_WATER = 1000.0


@dataclass(frozen=True, eq=False)
class Geom:
    """What can be drawn of a body.

    Attributes
    ----------
    kind : str
        sphere, ellipsoid, box, cylinder, capsule, plane, hfield, mesh or sdf.
    size : tuple of float
        Radii and half lengths in m, as in MJCF.
    position, rotation : ndarray, shapes (3,) and (3, 3)
        Of its axes in those of the body, from the body's centre of mass; of the ground, in space.
    mesh : str
        Name of the mesh, "" where there is none.
    file : str
        Its file, from the folder of the model.
    scale : tuple of three float
        Of the mesh.
    inner : Placement
        Where the axes of the file are in those of the geom.
    colour : tuple of four float, or None
        Red, green, blue and opacity, from 0 to 1.
    group : int
        0 to 2 are seen, from 3 on they are what collides.
    """

    kind: str
    size: tuple[float, ...]
    position: Array
    rotation: Array
    mesh: str = ""
    file: str = ""
    scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    inner: Placement = IDENTITY
    colour: tuple[float, ...] | None = None
    group: int = 0

    def moved(self, position: Array, rotation: Array) -> Geom:
        """Return the geom elsewhere."""
        return replace(self, position=position, rotation=rotation)

    @property
    def look(self) -> Look | None:
        """Visual shape and its placement; None for planes and invisible geoms."""
        place = Placement(self.position, self.rotation)
        if self.colour is not None and self.colour[3] == 0:
            return None
        colour = "" if self.colour is None else colour_of(self.colour)
        if self.file and all(self.scale):
            return place.then(self.inner), Shape("mesh", np.array(self.scale), colour=colour,
                                                 file=self.file)
        if self.kind not in _DRAWN or not all(self.size):
            return None
        size = [*[self.size[0]] * (3 - len(self.size)), *self.size]
        return place, Shape(_DRAWN[self.kind], np.array(size), colour=colour)


def geom_shape(given: Given, settings: Settings) -> Geom:
    """Return the shape of a geom in the axes of its body, its sizes checked."""
    default = "mesh" if "mesh" in given and "type" not in given else "sphere"
    kind = given.choice("type", tuple(KINDS), default)
    place = given.place(settings)
    count = KINDS[kind]
    size = given.numbers("size", 1, 3, []) if count else []
    if count and "fromto" in given:
        ends = np.array(given.numbers("fromto", 6))
        along = ends[:3] - ends[3:]
        length = float(np.linalg.norm(along))
        if kind == "sphere" or not length or not size:
            raise given.error("has fromto, which is for cylinders, capsules, boxes and ellipsoids "
                              "of some length and size; correct it.")
        place = Placement((ends[:3] + ends[3:]) / 2, rotation(onto(along / length)))
        size = [*([size[0]] if count == 2 else [size[0], size[min(1, len(size) - 1)]]), length / 2]
    if "mesh" in given and kind not in ("mesh", "sdf"):
        size = [0.0] * count  # fitted to the mesh, which only matters where it has mass
    elif len(size) < count or any(x <= 0 for x in size[:count]):
        raise given.error(f"has size={given.text('size', '')!r}; a {kind} has {count} above 0.")
    return Geom(kind, tuple(size[:count]), place.x, place.R, given.text("mesh", ""),
                 colour=tuple(given.numbers("rgba", 4)) if "rgba" in given else None,
                 group=given.whole("group", 0))


def geom_mass(
    given: Given, shape: Geom, settings: Settings, mesh: Callable[[Given, str], Volume]
) -> RobotLink | None:
    """Return mass, centre and inertia of a geom in the axes of its body; None without mass.

    ``mesh`` returns the volume of a mesh by its name.
    """
    low, high = settings.groups
    mass = given.number("mass", -1.0) if "mass" in given else None
    density = given.number("density", _WATER)
    if shape.kind in ("plane", "hfield") or not low <= shape.group <= high or mass == 0 or (
            mass is None and density == 0):
        return None
    if (mass if mass is not None else density) < 0:
        raise given.error(f"has the {'density' if mass is None else 'mass'} "
                          f"{density if mass is None else mass:g}; it must be above 0.")
    if given.flag("shellinertia", False):
        raise given.error("has shellinertia, the mass on its surface; give its body an <inertial>.")
    if shape.kind == "sdf" or (shape.mesh and shape.kind != "mesh"):
        raise given.error(f"is a {shape.kind} that is fitted to a mesh or a plugin's and has mass; "
                          "give its body an <inertial>.")
    volume = mesh(given, shape.mesh) if shape.kind == "mesh" else _volume(shape)
    m = density * volume.volume if mass is None else mass
    R = shape.rotation
    return RobotLink(given.text("name", ""), m, shape.position + R @ volume.centre,
                     R @ (m * volume.moments) @ R.T)


def _volume(shape: Geom) -> Volume:
    s = np.array(shape.size)
    if shape.kind == "sphere":
        volume, moments = 4 / 3 * math.pi * s[0] ** 3, np.full(3, 0.4 * s[0] ** 2)
    elif shape.kind == "ellipsoid":
        volume, moments = 4 / 3 * math.pi * s.prod(), (s @ s - s * s) / 5
    elif shape.kind == "box":
        volume, moments = 8 * s.prod(), (s @ s - s * s) / 3
    else:
        r, length = float(s[0]), 2 * float(s[1])
        tube, ball = math.pi * r * r * length, 4 / 3 * math.pi * r**3
        if shape.kind == "cylinder":
            ball = 0.0
        volume = tube + ball
        across = (tube * (3 * r * r + length**2) / 12
                  + ball * (0.4 * r * r + length**2 / 4 + 0.375 * length * r))
        along = tube * r * r / 2 + ball * 0.4 * r * r
        moments = np.array([across, across, along]) / volume
    return Volume(float(volume), np.zeros(3), np.diag(moments))
