"""Shapes of drawn bodies: boxes, spheres, discs, bars and meshes."""

from __future__ import annotations

import re
from dataclasses import field
from typing import Any, Literal, get_args

import numpy as np

from .arguments import choose, shown
from .arrays import Floats
from .errors import InputError
from .inertia import real_array
from .records import dataclass

__all__ = ["KINDS", "Shape", "ShapeKind"]

ShapeKind = Literal["box", "sphere", "disc", "bar", "mesh"]
KINDS: tuple[ShapeKind, ...] = get_args(ShapeKind)

_COLOUR = re.compile(r"#[0-9a-fA-F]{6}")


def _zeros() -> Floats:
    """Return the default centre: the origin of the body."""
    return np.zeros(3)


def _identity() -> Floats:
    """Return the default axes: those of the body."""
    return np.eye(3)


@dataclass(frozen=True, eq=False)
class Shape:
    """A shape fixed to a body.

    Attributes
    ----------
    kind : {"box", "sphere", "disc", "bar", "mesh"}
    size : array, shape (3,)
        Half edges of a box; semi-axes of a sphere; of a disc, which is a cylinder about its third
        axis with two dark marks, two radii and half the height; of a bar, a cylinder with round
        ends, two radii and half the distance of the centres of its ends; scale factors of a mesh.
    centre : array, shape (3,)
        Its middle in body axes; the origin of a mesh.
    axes : array, shape (3, 3)
        Columns: its axes in body axes, orthonormal.
    colour : str
        "#rrggbb"; "" for the colour of the body.
    file : str
        The file of a mesh, STL or OBJ; "" for the others.

    Raises
    ------
    InputError
        For another kind, lengths that are not positive and finite, axes that are not orthonormal,
        a colour of another form, and a mesh without a file.
    """

    kind: ShapeKind
    size: Floats
    centre: Floats = field(default_factory=_zeros)
    axes: Floats = field(default_factory=_identity)
    colour: str = ""
    file: str = ""

    def __post_init__(self) -> None:
        """Check all fields, and convert arrays to floats."""
        choose("kind of a shape", self.kind, KINDS)
        for name, shape in (("size", (3,)), ("centre", (3,)), ("axes", (3, 3))):
            object.__setattr__(self, name, self._array(name, getattr(self, name), shape))
        # a mesh with a negative scale is mirrored
        if (self.size == 0).any() or (self.kind != "mesh" and (self.size < 0).any()):
            raise InputError(f"The size of a {self.kind} is {self.size.tolist()}; give three "
                             "lengths above 0.")
        if np.abs(self.axes.T @ self.axes - np.eye(3)).max() > 1e-6:
            raise InputError(f"The axes of a {self.kind} are {self.axes.tolist()}; give three "
                             "orthonormal columns.")
        if not isinstance(self.colour, str) or (self.colour and not _COLOUR.fullmatch(self.colour)):
            raise InputError(f"The colour of a {self.kind} is {shown(self.colour)}; write it as "
                             "'#4c78a8'.")
        if not isinstance(self.file, str) or (self.kind == "mesh") != bool(self.file):
            raise InputError(f"A {self.kind} has file = {shown(self.file)}; a mesh has the name of "
                             "one, and nothing else has.")

    def _array(self, name: str, numbers: Any, shape: tuple[int, ...]) -> Floats:
        """Return the numbers of a field as floats of an array ``shape``, or refuse them."""
        array = real_array(numbers)
        if array is None or array.shape != shape or not np.isfinite(array.astype(float)).all():
            raise InputError(f"The {name} of a {self.kind} is {shown(numbers)}; give "
                             f"{'×'.join(map(str, shape))} finite numbers.")
        return array.astype(float)

    def as_json(self) -> dict[str, Any]:
        """Return the arguments that the shape was made of, as JSON can hold them."""
        return {name: value.tolist() if isinstance(value, np.ndarray) else value
                for name, value in self.__dict__.items()}

    @staticmethod
    def bar(start: Any, end: Any, radius: float, colour: str = "") -> Shape:
        """Return the bar of a radius between two points, which may coincide."""
        a, b = np.asarray(start, float), np.asarray(end, float)
        length = float(np.linalg.norm(b - a))
        # between equal points the bar is a ball: any axis, and a length just above the refused 0
        along = (b - a) / length if length > 1e-12 * radius else np.array([0.0, 0.0, 1.0])
        return Shape("bar", np.array([radius, radius, max(length / 2, 1e-6 * radius)]), (a + b) / 2,
                     axes_about(along), colour)


def axes_about(third: Floats) -> Floats:
    """Return orthonormal columns, the third of which is the given unit vector."""
    # the coordinate axis furthest from the vector: their cross product has at least √(2/3)
    first = np.cross(np.eye(3)[int(np.argmin(np.abs(third)))], third)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(third, first), third], axis=1)
