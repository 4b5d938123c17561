"""What a URDF file says its links look like: <visual>, or <collision> for meshes of other formats.

They move nothing, so what cannot be read is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from ...core.errors import InputError
from ...core.mesh_files import READABLE, located
from ...core.shapes import Shape
from ..multibody.multibody import Multibody
from .bounded_xml import Element
from .urdf_robot import Placement, numbers_of, place_of
from .urdf_tree import Mount

__all__ = ["add_visuals"]


def add_visuals(
    builder: Multibody, top: Element, mounts: Mapping[str, Mount], path: Path | None
) -> None:
    """Draw the bodies of a robot as its file says, by the places of its links.

    Meshes keep the names that the file has for them unless its ``path`` is given.
    """
    colours = {material.attributes.get("name", ""): _colour(material)
               for material in top.all("material")}
    for link in top.all("link"):
        mount = mounts.get(link.attributes.get("name", ""))
        if mount is None:
            continue
        shapes = list(_shapes(link, "visual", colours))
        if any(not _is_readable(shape) for _, shape in shapes):
            simple = list(_shapes(link, "collision", colours))
            if simple and all(_is_readable(shape) for _, shape in simple):
                shapes = simple
        for place, shape in shapes:
            at = mount.inner.then(place)
            placed = Shape(shape.kind, shape.size, at.x, at.R @ shape.axes, shape.colour,
                           shape.file)
            builder.visual(mount.frame, placed if path is None else located(placed, path))


def _is_readable(shape: Shape) -> bool:
    return not shape.file or Path(shape.file).suffix.lower() in READABLE


def _shapes(
    link: Element, kind: str, colours: Mapping[str, str]
) -> Iterator[tuple[Placement, Shape]]:
    for element in link.all(kind):
        geometry, material = element.first("geometry"), element.first("material")
        colour = "" if material is None else _colour(material) or colours.get(
            material.attributes.get("name", ""), "")
        try:
            for shape in [] if geometry is None else geometry.children:
                made = _shape(shape, colour)
                if made is not None:
                    yield place_of(element), made
        except InputError:
            continue


def _shape(element: Element, colour: str) -> Shape | None:
    if element.name == "box":
        return Shape("box", np.array(numbers_of(element, "size", 3)) / 2, colour=colour)
    if element.name == "sphere":
        return Shape("sphere", np.full(3, numbers_of(element, "radius", 1)[0]), colour=colour)
    if element.name in ("cylinder", "capsule"):
        r, length = (numbers_of(element, key, 1)[0] for key in ("radius", "length"))
        return Shape("disc" if element.name == "cylinder" else "bar",
                     np.array([r, r, length / 2]), colour=colour)
    if element.name == "mesh":
        scale = numbers_of(element, "scale", 3, [1.0, 1.0, 1.0])
        return Shape("mesh", np.array(scale), colour=colour,
                     file=element.attributes.get("filename", ""))
    return None


def _colour(material: Element) -> str:
    element = material.first("color")
    try:
        rgba = [] if element is None else numbers_of(element, "rgba", 4)
    except InputError:
        return ""
    return "#" + "".join(f"{round(255 * min(max(x, 0), 1)):02x}" for x in rgba[:3]) if rgba else ""
