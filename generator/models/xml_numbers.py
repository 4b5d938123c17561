"""Numbers, rotations and places in URDF and SDF."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ...core.arguments import shown
from ...core.arrays import Floats
from ...core.errors import InputError
from ..multibody.initial_poses import rotation, unit
from .bounded_xml import Element
from .robot_tree import IDENTITY, Placement, turn

__all__ = ["NUMBER", "UNLIMITED", "attribute_of", "numbers_of", "parse_numbers", "place_of",
           "roll_pitch_yaw", "rotation_xyzw"]

NUMBER = re.compile(r"[+-]?(\d{1,40}\.?\d{0,40}|\.\d{1,40})([eE][+-]?\d{1,3})?", re.ASCII)
#: Ends of ranges beyond this, in rad or m, do not exist.
UNLIMITED = 1e9
#: As a number beyond UNLIMITED: the default ends of ranges in earlier versions of SDF.
_ENDLESS = {"inf": "1e16", "+inf": "1e16", "-inf": "-1e16"}


def parse_numbers(text: str, count: int, endless: bool = False) -> list[float] | None:
    """Return the numbers of a text, if it has ``count`` finite ones and nothing else; else None.

    ``endless`` reads inf and -inf, which a range without ends has, as 1e16 and -1e16.
    """
    words = [_ENDLESS.get(word.lower(), word) if endless else word for word in text.split()]
    numbers = [float(word) for word in words if NUMBER.fullmatch(word)]
    return numbers if len(numbers) == len(words) == count and np.isfinite(numbers).all() else None


def roll_pitch_yaw(angles: Sequence[float]) -> Floats:
    """Return R_z(yaw) R_y(pitch) R_x(roll), 3 × 3, from (roll, pitch, yaw) in rad."""
    roll, pitch, yaw = (turn(axis, angle) for axis, angle in zip(np.eye(3), angles, strict=True))
    R: Floats = yaw @ pitch @ roll
    return R


def rotation_xyzw(numbers: Sequence[float], owner: str) -> Floats:
    """Return the rotation, 3 × 3, of a quaternion of any length but 0, its scalar part last."""
    if not any(numbers):
        raise InputError(f"{owner} has the quaternion 0 0 0 0; write 0 0 0 1 for no rotation.")
    x, y, z, w = numbers
    return rotation(unit(np.array([w, x, y, z])))


def place_of(element: Element, key: str = "origin") -> Placement:
    """Return the placement in <origin>, or in the child element ``key``; identity without it.

    x is xyz, and R is R_z(yaw) R_y(pitch) R_x(roll) of rpy, or the rotation of quat_xyzw.
    """
    origin = element.first(key)
    if origin is None:
        return IDENTITY
    x = np.array(numbers_of(origin, "xyz", 3, [0.0] * 3))
    if "quat_xyzw" not in origin.attributes:
        return Placement(x, roll_pitch_yaw(numbers_of(origin, "rpy", 3, [0.0] * 3)))
    if "rpy" in origin.attributes:
        raise InputError(f"its <{key}> has rpy and quat_xyzw; write one of them.")
    return Placement(x, rotation_xyzw(numbers_of(origin, "quat_xyzw", 4), f"its <{key}>"))


def attribute_of(element: Element, key: str) -> str:
    """Return the text of an attribute; refuse an element without it."""
    if key not in element.attributes:
        raise InputError(f"its <{element.name}> has no {key}; write {key}=\"…\".")
    return element.attributes[key]


def numbers_of(
    element: Element, key: str, count: int, default: list[float] | None = None,
    endless: bool = False,
) -> list[float]:
    """Return the ``count`` numbers of an attribute, or ``default`` without it; refuse other texts.
    """
    if default is not None and key not in element.attributes:
        return default
    values = parse_numbers(attribute_of(element, key), count, endless)
    if values is None:
        raise InputError(f"its <{element.name}> has {key}={shown(element.attributes[key])}; write "
                         f"{count} finite number{'s' if count > 1 else ''}.")
    return values
