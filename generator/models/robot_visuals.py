"""Visual shapes of robot files: <visual> of URDF and SDF, geoms of MJCF.

    box, sphere, ellipsoid   boxes and spheres
    cylinder, capsule        discs and bars
    mesh                     STL and OBJ files

Collision shapes are drawn if files of visual shapes cannot be read. Shapes do not affect the
motion, so those that cannot be read at all are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...core.errors import InputError
from ...core.mesh_files import READABLE, locate
from ...core.shapes import Shape
from ..multibody.body import Frame
from ..multibody.multibody import Multibody
from .bounded_xml import Element
from .robot_tree import Mount, Placement
from .xml_numbers import numbers_of, place_of

__all__ = ["LinkLooks", "Look", "add_visuals", "colour_of", "draw", "looks_of", "shape_of",
           "urdf_looks"]

#: Placement of a shape in its link or body, and the shape.
Look = tuple[Placement, Shape]
#: Name of a link, its visual shapes and its collision shapes.
LinkLooks = tuple[str, Sequence[Look], Sequence[Look]]


def draw(
    builder: Multibody, frame: Frame, placement: Placement, shapes: Sequence[Look],
    colliding: Sequence[Look], path: Path,
) -> None:
    """Add the shapes of a link at ``placement`` in ``frame``; ``path`` is the robot's file.

    ``colliding``, its collision shapes, replace visual shapes whose files cannot be read, if their
    own can.
    """
    if colliding and not all(_is_readable(shape, path) for _, shape in shapes) and all(
            _is_readable(shape, path) for _, shape in colliding):
        shapes = colliding
    for pose, shape in shapes:
        shape_placement = placement.then(pose).then(Placement(shape.centre, shape.axes))
        builder.visual(frame, replace(shape, centre=shape_placement.x, axes=shape_placement.R))


def add_visuals(
    builder: Multibody, looks: Iterable[LinkLooks], mounts: Mapping[str, Mount], path: Path
) -> None:
    """Add the shapes of all links, at the placements of the links."""
    for name, visible, colliding in looks:
        if name in mounts:
            draw(builder, mounts[name].frame, mounts[name].inner, visible, colliding, path)


def _is_readable(shape: Shape, path: Path) -> bool:
    """Whether a shape needs no file, or one that exists in a format that is read here."""
    file = Path(locate(shape, path).file)
    return not shape.file or (file.suffix.lower() in READABLE and file.is_file())


def colour_of(rgba: Sequence[float]) -> str:
    """Return red, green and blue from 0 to 1 as "#rrggbb"; numbers outside are clipped."""
    return "#" + "".join(f"{round(255 * min(max(x, 0), 1)):02x}" for x in rgba[:3])


# ---------------------------------------------------------------- URDF


def urdf_looks(top: Element) -> Iterator[LinkLooks]:
    """Yield the looks of the links of a URDF file: name, visual shapes and collision shapes."""
    # materials that are defined once, for all links
    colours = {material.attributes.get("name", ""): _colour(material)
               for material in top.all("material")}

    def colour(element: Element) -> str:
        """Return the colour of a <visual>: of its own material, or of the defined one; else ""."""
        material = element.first("material")
        return "" if material is None else _colour(material) or colours.get(
            material.attributes.get("name", ""), "")

    for link in top.all("link"):
        visible, colliding = (looks_of(link, kind, place_of, shape_of, colour)
                              for kind in ("visual", "collision"))
        yield link.attributes.get("name", ""), visible, colliding


def looks_of(
    link: Element, kind: str, pose_of: Callable[[Element], Placement],
    shape: Callable[[Element, str], Shape | None], colour: Callable[[Element], str],
) -> list[Look]:
    """Return the shapes of a link's elements of a ``kind``, visual or collision, with their poses.

    ``pose_of``, ``shape`` and ``colour`` read the format. A shape that cannot be read is left out:
    pictures change nothing in the model.
    """
    shapes = []
    for element in link.all(kind):
        geometry = element.first("geometry")
        for child in [] if geometry is None else geometry.children:
            try:
                visual = shape(child, colour(element))
                if visual is not None:
                    shapes.append((pose_of(element), visual))
            except InputError:
                continue
    return shapes


def shape_of(element: Element, colour: str) -> Shape | None:
    """Return the shape of a child of <geometry>; None for other elements.

    Sizes of a ``Shape`` are half lengths and radii, in m; ``colour`` is "#rrggbb" or "".
    """
    if element.name == "box":
        return Shape("box", np.array(numbers_of(element, "size", 3)) / 2, colour=colour)
    if element.name == "sphere":
        return Shape("sphere", np.full(3, numbers_of(element, "radius", 1)[0]), colour=colour)
    if element.name == "ellipsoid":
        return Shape("sphere", np.array(numbers_of(element, "radii", 3)), colour=colour)
    if element.name in ("cylinder", "capsule"):
        r, length = (numbers_of(element, key, 1)[0] for key in ("radius", "length"))
        # along axis z of the element
        return Shape("disc" if element.name == "cylinder" else "bar",
                     np.array([r, r, length / 2]), colour=colour)
    if element.name == "mesh":
        scale = numbers_of(element, "scale", 3, [1.0, 1.0, 1.0])
        return Shape("mesh", np.array(scale), colour=colour,
                     file=element.attributes.get("filename", ""))
    return None


def _colour(material: Element) -> str:
    """Return the colour of a <material>; "" if it has none, or none that can be read."""
    element = material.first("color")
    try:
        return "" if element is None else colour_of(numbers_of(element, "rgba", 4))
    except InputError:
        return ""
