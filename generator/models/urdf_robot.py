"""The links and joints that a URDF file describes, each number checked.

What moves a robot otherwise than its bodies and joints alone (``EXTRAS``) is never passed over
unasked: it is counted, and refused unless its name is among those to ignore.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import listed, proposal, shown
from ...core.errors import InputError
from ...core.warnings import warn
from ..multibody.initial_poses import positive
from .bounded_xml import Element

__all__ = ["EXTRAS", "IDENTITY", "MOVING", "NUMBER", "Placement", "Robot", "RobotJoint",
           "RobotLink", "RobotLoop", "numbers_of", "place_of", "read_robot", "refuse_extras",
           "root_of", "stiffness_of_limits", "turn"]

Array = NDArray[np.float64]
Read = TypeVar("Read")

#: Types of joints with a coordinate.
MOVING = ("revolute", "continuous", "prismatic")
TYPES = (*MOVING, "fixed", "floating")
#: Types of <constraint>.
LOOPS = (*MOVING, "fixed", "ball", "universal")
#: Ignorable element → its meaning.
EXTRAS = {
    "limits": "ends of a joint's range",
    "friction": "dry friction of a joint",
    "collision": "shapes that touch",
    "contact": "properties of touching",
    "transmission": "gears between motors and joints",
    "gazebo": "settings of another simulator",
    "safety_controller": "limits of a controller",
}
MAX_LINKS = 500
#: Moments below this, in kg m², are 0 with rounding.
_NOTHING = 1e-20
NUMBER = re.compile(r"[+-]?(\d{1,40}\.?\d{0,40}|\.\d{1,40})([eE][+-]?\d{1,3})?", re.ASCII)


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a frame is in another one: R maps its axes to those of the other."""

    x: Array
    R: Array

    def then(self, inner: Placement) -> Placement:
        """Return where a frame is that is ``inner`` in this one."""
        return Placement(self.x + self.R @ inner.x, self.R @ inner.R)


#: The frame itself.
IDENTITY = Placement(np.zeros(3), np.eye(3))


@dataclass(frozen=True, eq=False)
class RobotLink:
    """A link: its name, and mass, centre of mass and inertia about it in the axes of the link."""

    name: str
    mass: float
    centre: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class RobotJoint:
    """A joint: where the child is in the parent at 0, what about or along, what it follows.

    ``follows`` is the name of another joint, ratio and offset.
    """

    name: str
    kind: str
    parent: str
    child: str
    place: Placement
    axis: Array
    damping: float
    follows: tuple[str, float, float] | None
    stiffness: float = 0.0
    rest: float = 0.0
    range: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class RobotLoop:
    """A <constraint>: its links, its frames in them, and its axes in these.

    The proposal of github.com/ros/urdfdom/pull/264.
    """

    name: str
    kind: str
    links: tuple[str, str]
    places: tuple[Placement, Placement]
    axes: tuple[Array | None, Array | None]


@dataclass(frozen=True, eq=False)
class Robot:
    """A tree of links, in the order of the file."""

    name: str
    links: dict[str, RobotLink]
    joints: dict[str, RobotJoint]
    root: str
    loops: tuple[RobotLoop, ...] = ()
    limits: float | None = None  # stiffness of the ends of ranges of joints


def read_robot(
    top: Element, ignore: Collection[str] = (), limits: float | None = None
) -> Robot:
    """Return the robot of a URDF's outermost element.

    Parameters
    ----------
    top : Element
        <robot>.
    ignore : collection of str
        Which of ``EXTRAS`` the model is to do without, or "all" of them.
    limits : float, optional
        Stiffness of the ends of ranges of joints.

    Raises
    ------
    InputError
        With the link or joint, what is wrong with it, and the cure.
    """
    if top.name != "robot":
        raise InputError(f"line {top.line}: its outermost element is <{shown(top.name)[1:-1]}>, "
                         "not <robot>; give a URDF file.")
    macros = next((e for e in top.children if e.name.startswith("xacro:")), None)
    if macros is not None:
        raise InputError(f"line {macros.line}: <{macros.name}> is a macro; expand the file with "
                         "xacro first.")
    extras = Counter(_extras(top))
    if limits is not None:
        del extras["limits"]
    refuse_extras(extras, EXTRAS, ignore)
    links, joints = _read_all(top, "link", _link), _read_all(top, "joint", _joint)
    if not links:
        raise InputError("it has no <link>; write one at least.")
    if len(links) > MAX_LINKS:
        raise InputError(f"it has {len(links)} links and at most {MAX_LINKS} are allowed.")
    _check_followed(joints)
    return Robot(top.attributes.get("name", "robot"), links, joints, root_of(links, joints),
                 tuple(_read_all(top, "constraint", partial(_loop, links)).values()), limits)


# ---------------------------------------------------------------- what is left out


def refuse_extras(
    found: Mapping[str, int], known: Mapping[str, str], ignore: Collection[str]
) -> None:
    """Refuse what a file has besides bodies and joints, with its count, unless it is ignored."""
    for name in ignore:
        if name not in (*known, "all"):
            raise InputError(f"ignore names {shown(name)}; choose "
                             f"{listed([*known, 'all'])}{proposal(name, known)}.")
    if "all" in ignore:
        return
    left = {name: found[name] for name in known if found[name] and name not in ignore}
    if left:
        told = ", ".join(f"{name} ({known[name]}, {count} of them)"
                         for name, count in left.items())
        wanted = [*ignore, *left]
        raise InputError(f"it has {told}, which no model here has; to run without, write "
                         f"ignore={wanted}, or on the command line --set ignore="
                         f"{','.join(wanted)}.")


def _extras(top: Element) -> Iterator[str]:
    """Yield the names of what is beyond links and joints, each time it is there."""
    for element in top.children:
        if element.name in ("transmission", "gazebo"):
            yield element.name
        for part in element.children:
            if part.name in ("collision", "contact", "safety_controller"):
                yield part.name
            if part.name == "limit" and _is_limited(element.attributes.get("type", ""), part):
                yield "limits"
            if part.name == "dynamics" and numbers_of(part, "friction", 1, [0.0])[0] != 0:
                yield "friction"


def _is_limited(kind: str, limit: Element) -> bool:
    return kind in ("revolute", "prismatic") and bool({"lower", "upper"} & limit.attributes.keys())


def stiffness_of_limits(given: Any) -> float | None:
    """Return the stiffness of the ends of ranges of joints, None where they are refused."""
    return None if given is None else positive("limits, a stiffness in N m/rad and N/m", given)


# ---------------------------------------------------------------- links and joints


def _read_all(top: Element, kind: str, read: Callable[[str, Element], Read]) -> dict[str, Read]:
    """Return name → what ``read`` makes of each element of a kind; names are there, and once."""
    found: dict[str, Read] = {}
    for element in top.all(kind):
        name = element.attributes.get("name", "")
        if not name:
            raise InputError(f"line {element.line}: a <{kind}> has no name; write name=\"…\".")
        if name in found:
            raise InputError(f"line {element.line}: {kind} {shown(name)} is there twice; rename "
                             "one of them.")
        try:
            found[name] = read(name, element)
        except InputError as error:
            raise InputError(f"line {element.line}: {kind} {shown(name)}: {error}") from None
    return found


def _link(name: str, element: Element) -> RobotLink:
    inertial = element.first("inertial")
    if inertial is None:
        return RobotLink(name, 0.0, np.zeros(3), np.zeros((3, 3)))
    place = place_of(inertial)
    mass = _one(inertial, "mass", "value")
    if mass < 0:
        raise InputError(f"its mass is {mass:g}; it must be above 0.")
    moments = inertial.first("inertia")
    if moments is None:
        raise InputError("its <inertial> has no <inertia>; write ixx, iyy, izz, ixy, ixz, iyz.")
    xx, xy, xz, yy, yz, zz = (numbers_of(moments, key, 1, [0.0] if key in ("ixy", "ixz", "iyz")
                                       else None)[0]
                              for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    J = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    least = float(np.linalg.eigvalsh(J).min())
    if least < -max(1e-9 * float(np.abs(J).max()), _NOTHING):
        raise InputError(f"its inertia has the principal moment {least:.3g}; none may be below 0.")
    return RobotLink(name, mass, place.x, place.R @ J @ place.R.T)


def _joint(name: str, element: Element) -> RobotJoint:
    kind = element.attributes.get("type", "")
    if kind not in TYPES:
        raise InputError(f"its type is {shown(kind)}; choose {listed(TYPES)}"
                         f"{proposal(kind, TYPES)}.")
    parent, child = (_text(element, end, "link") for end in ("parent", "child"))
    dynamics, mimic = element.first("dynamics"), element.first("mimic")
    limit = element.first("limit")
    if mimic is not None and kind not in MOVING:
        warn(f"Joint {shown(name)} is {kind}: its <mimic> has no effect.")
        mimic = None
    return RobotJoint(
        name, kind, parent, child, place_of(element), _axis(element, kind),
        0.0 if dynamics is None else numbers_of(dynamics, "damping", 1, [0.0])[0],
        None if mimic is None else (
            _attribute(mimic, "joint"), numbers_of(mimic, "multiplier", 1, [1.0])[0],
            numbers_of(mimic, "offset", 1, [0.0])[0]),
        range=None if limit is None or not _is_limited(kind, limit) else (
            numbers_of(limit, "lower", 1, [0.0])[0], numbers_of(limit, "upper", 1, [0.0])[0]))


def _loop(links: Mapping[str, RobotLink], name: str, element: Element) -> RobotLoop:
    """Return a joint that closes a loop."""
    kind = element.attributes.get("type", "")
    if kind not in LOOPS:
        raise InputError(f"its type is {shown(kind)}; choose {listed(LOOPS)}"
                         f"{proposal(kind, LOOPS)}.")
    ends, places, axes = [], [], []
    for side in ("parent", "child"):
        ends.append(_text(element, side, "link"))
        if ends[-1] not in links:
            raise InputError(f"it joins {shown(ends[-1])}, which is no link"
                             f"{proposal(ends[-1], links)}; correct it.")
        places.append(place_of(element, f"{side}_origin"))
        needed = (side == "parent" and kind not in ("ball", "fixed")) or kind == "universal"
        axes.append(_axis(element, kind, f"{side}_axis") if needed else None)
    return RobotLoop(name, kind, (ends[0], ends[1]), (places[0], places[1]), (axes[0], axes[1]))


def _axis(element: Element, kind: str, key: str = "axis") -> Array:
    """Return the axis in the axes of the child, of length one."""
    if kind not in (*MOVING, "universal"):
        return np.array([1.0, 0, 0])
    axis = element.first(key)
    if axis is None:
        raise InputError(f"it is {kind} and has no <{key}>; write <{key} xyz=\"1 0 0\"/>, which "
                         "is what others take then, or the one that is meant.")
    found = np.array(numbers_of(axis, "xyz", 3))
    if not found.any():
        raise InputError(f"its <{key}> is zero; write its direction.")
    found = found / np.abs(found).max()
    unit: Array = found / np.linalg.norm(found)
    return unit


def place_of(element: Element, key: str = "origin") -> Placement:
    """Return <origin>: R = R_z(yaw) R_y(pitch) R_x(roll)."""
    origin = element.first(key)
    if origin is None:
        return IDENTITY
    x = np.array(numbers_of(origin, "xyz", 3, [0.0] * 3))
    turns = [turn(axis, angle) for axis, angle in zip(
        np.eye(3), numbers_of(origin, "rpy", 3, [0.0] * 3), strict=True)]
    return Placement(x, turns[2] @ turns[1] @ turns[0])


def turn(axis: Array, angle: float) -> Array:
    """Return the rotation about a unit axis, by Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R: Array = np.eye(3) + math.sin(angle) * K + 2 * math.sin(angle / 2) ** 2 * K @ K
    return R


# ---------------------------------------------------------------- the tree


def root_of(links: dict[str, RobotLink], joints: dict[str, RobotJoint]) -> str:
    """Return the link that is no child, from which all others hang."""
    above: dict[str, RobotJoint] = {}
    for joint in joints.values():
        for end in (joint.parent, joint.child):
            if end not in links:
                raise InputError(f"joint {shown(joint.name)} joins {shown(end)}, which is no link"
                                 f"{proposal(end, links)}; correct it.")
        other = above.setdefault(joint.child, joint)
        if other is not joint:
            raise InputError(f"link {shown(joint.child)} is the child of the joints "
                             f"{shown(other.name)} and {shown(joint.name)}, and URDF has trees "
                             "alone; remove one of them.")
    roots = [name for name in links if name not in above]
    if len(roots) > 1:
        named = ", ".join(map(shown, roots[:6]))
        raise InputError(f"it has {len(roots)} roots, {named}, and a tree has one; "
                         "join the others by <joint>.")
    for name in links:  # up to the root, or round and round
        seen = [name]
        while seen[-1] in above:
            seen.append(above[seen[-1]].parent)
            if seen[-1] in seen[:-1]:
                circle = seen[seen.index(seen[-1]):]
                raise InputError(f"the links {' – '.join(circle)} form a cycle, and URDF has trees "
                                 "alone; remove one of their joints, and close the loop again in "
                                 "a TOML file (loops = …).")
    return roots[0]


def _check_followed(joints: dict[str, RobotJoint]) -> None:
    """Refuse <mimic> of what does not move, and of what follows itself."""
    for joint in joints.values():
        seen, last = [joint.name], joint
        while last.follows is not None:
            name = last.follows[0]
            if name not in joints or joints[name].kind not in MOVING:
                raise InputError(f"joint {shown(last.name)} follows {shown(name)}, which is no "
                                 f"joint that moves{proposal(name, joints)}; correct its <mimic>.")
            if name in seen:
                raise InputError(f"joint {shown(name)} follows itself; correct its <mimic>.")
            seen.append(name)
            last = joints[name]


# ---------------------------------------------------------------- text and numbers


def _attribute(element: Element, key: str) -> str:
    if key not in element.attributes:
        raise InputError(f"its <{element.name}> has no {key}; write {key}=\"…\".")
    return element.attributes[key]


def _text(element: Element, name: str, key: str) -> str:
    part = element.first(name)
    if part is None:
        raise InputError(f"it has no <{name}>; write <{name} {key}=\"…\"/>.")
    return _attribute(part, key)


def _one(element: Element, name: str, key: str) -> float:
    part = element.first(name)
    if part is None:
        raise InputError(f"its <{element.name}> has no <{name}>; write <{name} {key}=\"…\"/>.")
    return numbers_of(part, key, 1)[0]


def numbers_of(
    element: Element, key: str, count: int, default: list[float] | None = None
) -> list[float]:
    """Return so many finite numbers of an attribute."""
    if default is not None and key not in element.attributes:
        return default
    words = _attribute(element, key).split()
    values = [float(word) for word in words if NUMBER.fullmatch(word)]
    if len(words) != count or len(values) != count or not np.isfinite(values).all():
        raise InputError(f"its <{element.name}> has {key}={shown(element.attributes[key])}; write "
                         f"{count} finite number{'s' if count > 1 else ''}.")
    return values
