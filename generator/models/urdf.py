"""A URDF file to bodies and joints: links in their own axes, joints with their coordinates.

    revolute, continuous   a hinge; its angle and rate are quantities JOINT_angle and JOINT_rate
    prismatic              a slide; JOINT_travel and JOINT_speed
    fixed                  both links are one body
    floating               no constraint
    <mimic>                a constraint on two coordinates
    <dynamics damping=…>   a damper in the joint
    <constraint>           a joint that closes a loop, github.com/ros/urdfdom/pull/264

Each element and attribute is in a closed list (``urdf_schema``): parts that move a robot besides
its bodies and joints are counted, and refused unless ``ignore`` has their name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ...core.arguments import choose, join_or, proposal, shown
from ...core.arrays import Floats
from ...core.errors import InputError
from ...core.warnings import warn
from ..multibody.initial_poses import optional_vector, unit
from ..multibody.multibody import Multibody
from .bounded_xml import Element, read_xml
from .robot_builder import (
    Close,
    RobotBuilder,
    as_names,
    base_pose,
    ends_of_ranges,
    refuse_extras,
    start_of,
)
from .robot_options import UrdfOptions
from .robot_tree import (
    Edge,
    Follower,
    Limits,
    LoopJoint,
    Placement,
    Robot,
    RobotJoint,
    RobotLink,
    check_followers,
    free_base,
    grow_tree,
)
from .robot_visuals import add_visuals, urdf_looks
from .urdf_schema import EXTRAS, URDF, VERSIONS
from .xml_numbers import UNLIMITED, attribute_of, numbers_of, place_of
from .xml_schema import count_extras

__all__ = ["BASES", "MAX_LINKS", "parse_urdf"]

Read = TypeVar("Read")

BASES = ("fixed", "floating")
#: Type of a joint → its kind in the tree; "" for links that are fixed to each other.
KINDS = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide", "fixed": "",
         "floating": "free"}
#: Types of joints with a coordinate, and those of <constraint>.
MOVING = ("revolute", "continuous", "prismatic")
LOOPS = (*MOVING, "fixed", "ball", "universal")
#: Derivation and C grow with the number of links; as many as bodies of an MJCF file.
MAX_LINKS = 500
#: Principal moments of this size, in kg m², are round-off of 0.
_NOTHING = 1e-20


def parse_urdf(
    text: str, path: str | Path, rep: Any, options: UrdfOptions, close: Close | None = None
) -> Multibody:
    """Return the bodies and joints of a text that was read from a file; see ``load_model``.

    ``close`` adds loop joints, given the placement of each link.
    """
    base = choose("base", options.get("base", "fixed"), BASES)
    left_out, pose = as_names(options.get("ignore", ())), base_pose(options)
    gravity = optional_vector("gravity", options.get("gravity"))
    limits = ends_of_ranges(options.get("limits"))
    try:
        top = read_xml(text)
        robot = _read(top, left_out, limits, pose, floats=base == "floating")
        if gravity is not None:
            robot.gravity = gravity
        robot_builder = RobotBuilder(robot, start_of(robot, options), rep)
        builder = robot_builder.build()
        mounts = robot_builder.mounts()
        add_visuals(builder, urdf_looks(top), mounts, Path(path))
    except InputError as error:
        raise InputError(f"The model file {str(path)!r} is not usable: {error}") from None
    if close is not None:
        close(builder, mounts)
    return builder


def _read(top: Element, ignore: list[str], limits: Limits, base: Placement, floats: bool) -> Robot:
    """Return the robot of a URDF file's root element ``top``.

    ``ignore`` are the parts to leave out, ``base`` is the pose of the root link in space; with
    ``floats`` it has a free joint. Raises InputError, without the file's name.
    """
    version, extras = _version_of(top), count_extras(top, URDF)
    links = _read_all(top, "link", _link)
    # reading the joints adds each <mimic> to the robot's followers
    robot = Robot(top.attributes.get("name", "robot"), "a URDF", "link", limits=limits)
    edges = _read_all(top, "joint", partial(_joint, version, robot.followers))
    # without the option limits, ranges of joints are elements that no model here has
    if limits is None:
        extras["limits"] = sum(edge.joint is not None and edge.joint.range is not None
                               for edge in edges.values())
    refuse_extras(extras, EXTRAS, ignore)
    if not links:
        raise InputError("it has no <link>; write one at least.")
    if len(links) > MAX_LINKS:
        raise InputError(f"it has {len(links)} links and at most {MAX_LINKS} are allowed.")
    grow_tree(robot, {name: (link, 0.0) for name, link in links.items()}, [*edges.values()], base,
              free_base() if floats else None)
    check_followers(robot)
    robot.loops = [*_read_all(top, "constraint", partial(_loop, links)).values()]
    return robot


def _version_of(top: Element) -> str:
    """Return the version of a URDF file; refuse other files, macros, and keys of later versions."""
    # [1:-1] takes off the quotes of ``shown``
    if top.name != "robot":
        raise InputError(f"line {top.line}: its outermost element is <{shown(top.name)[1:-1]}>, "
                         "not <robot>; give a URDF file.")
    macros = next((e for e in _descendants(top) if e.name.startswith("xacro:")), None)
    if macros is not None:
        raise InputError(f"line {macros.line}: <{macros.name}> is a macro; expand the file with "
                         "xacro first.")
    version = choose("version of URDF", top.attributes.get("version", "1.0"), VERSIONS)
    for element in _descendants(top) if version == "1.0" else ():
        if element.name.endswith("origin") and "quat_xyzw" in element.attributes:
            raise InputError(f"line {element.line}: <{element.name}> has quat_xyzw=, which "
                             "URDF has from version 1.1 on; write version=\"1.1\" in <robot>, "
                             "or rpy=.")
    return version


def _descendants(element: Element) -> Iterator[Element]:
    """Yield all elements below an element, at any depth."""
    for child in element.children:
        yield child
        yield from _descendants(child)


# ---------------------------------------------------------------- links and joints


def _read_all(top: Element, kind: str, read: Callable[[str, Element], Read]) -> dict[str, Read]:
    """Return name → ``read(name, element)`` for each element of a kind.

    Raises InputError, with the line, for elements without a name and for names that occur twice.
    """
    parts: dict[str, Read] = {}
    for element in top.all(kind):
        name = element.attributes.get("name", "")
        if not name:
            raise InputError(f"line {element.line}: a <{kind}> has no name; write name=\"…\".")
        if name in parts:
            raise InputError(f"line {element.line}: {kind} {shown(name)} is there twice; rename "
                             "one of them.")
        try:
            parts[name] = read(name, element)
        except InputError as error:
            raise InputError(f"line {element.line}: {kind} {shown(name)}: {error}") from None
    return parts


def _link(name: str, element: Element) -> RobotLink:
    """Return mass, centre and inertia of a link, in the link's axes; 0 without <inertial>."""
    inertial = element.first("inertial")
    if inertial is None:
        return RobotLink(name, 0.0, np.zeros(3), np.zeros((3, 3)))
    placement = place_of(inertial)
    mass = _required_number(inertial, "mass", "value")
    if mass < 0:
        raise InputError(f"its mass is {mass:g}; it must be 0 or more.")
    moments = inertial.first("inertia")
    if moments is None:
        raise InputError("its <inertial> has no <inertia>; write ixx, iyy, izz, ixy, ixz, iyz.")
    # products of inertia are 0 where none are written, moments have no default
    xx, xy, xz, yy, yz, zz = (numbers_of(moments, key, 1, [0.0] if key in ("ixy", "ixz", "iyz")
                                       else None)[0]
                              for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    J = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    # small negative moments are rounding of the file's digits
    smallest = float(np.linalg.eigvalsh(J).min())
    if smallest < -max(1e-9 * float(np.abs(J).max()), _NOTHING):
        raise InputError(f"its inertia has the principal moment {smallest:.3g}; none may be "
                         "below 0.")
    return RobotLink(name, mass, placement.x, placement.R @ J @ placement.R.T)


def _joint(version: str, followers: list[Follower], name: str, element: Element) -> Edge:
    """Return a joint as an edge of the tree; its <mimic> is added to ``followers``."""
    kind = element.attributes.get("type", "")
    if kind not in KINDS:
        raise InputError(f"its type is {shown(kind)}; choose {join_or(KINDS)}"
                         f"{proposal(kind, KINDS)}.")
    parent, child = (_text(element, end, "link") for end in ("parent", "child"))
    dynamics, mimic = element.first("dynamics"), element.first("mimic")
    # a fixed or floating joint has no single coordinate that could follow another
    if mimic is not None and kind not in MOVING:
        warn(f"Joint {shown(name)} is {kind}: its <mimic> has no effect.")
    elif mimic is not None:
        followers.append(Follower(
            name, attribute_of(mimic, "joint"), numbers_of(mimic, "multiplier", 1, [1.0])[0],
            numbers_of(mimic, "offset", 1, [0.0])[0]))
    damping = 0.0 if dynamics is None or kind not in MOVING else numbers_of(
        dynamics, "damping", 1, [0.0])[0]
    if damping < 0:
        raise InputError(f"its damping is {damping:g}, which would add energy; write 0 or more.")
    # 0: ``grow_tree`` sets the number of the body
    joint = None if kind == "fixed" else RobotJoint(
        name, KINDS[kind], 0, _axis(element, kind), np.zeros(3), damping=damping,
        range=_range(version, kind, element.first("limit")))
    return Edge(name, parent, child, place_of(element), joint)


def _range(version: str, kind: str, limit: Element | None) -> tuple[float, float] | None:
    """Return (lower, upper) of a joint in rad or m; None without a range.

    An end that is not written is 0, and absent from version 1.2 on.
    """
    if limit is None or kind not in ("revolute", "prismatic") or not (
            {"lower", "upper"} & limit.attributes.keys()):
        return None
    bound = UNLIMITED if version == "1.2" else 0.0
    lower, upper = (numbers_of(limit, key, 1, [default], endless=True)[0]
                    for key, default in (("lower", -bound), ("upper", bound)))
    return (lower, upper) if min(abs(lower), abs(upper)) < UNLIMITED else None


def _loop(links: Mapping[str, RobotLink], name: str, element: Element) -> LoopJoint:
    """Return a joint that closes a loop: its type, links, poses in both, and axes.

    A hinge, a slide and a universal joint have an axis in the parent's frame, a universal joint
    another one in the child's; axes that a joint does not have are (0, 0, 0).
    """
    kind = element.attributes.get("type", "")
    if kind not in LOOPS:
        raise InputError(f"its type is {shown(kind)}; choose {join_or(LOOPS)}"
                         f"{proposal(kind, LOOPS)}.")
    names, places, axes = [], [], []
    for side in ("parent", "child"):
        names.append(_text(element, side, "link"))
        if names[-1] not in links:
            raise InputError(f"it joins {shown(names[-1])}, which is no link"
                             f"{proposal(names[-1], links)}; correct it.")
        places.append(place_of(element, f"{side}_origin"))
        has_axis = (side == "parent" and kind not in ("ball", "fixed")) or kind == "universal"
        axes.append(_axis(element, kind, f"{side}_axis") if has_axis else np.zeros(3))
    return LoopJoint(name, kind, (names[0], names[1]), (places[0], places[1]), axes[0], axes[1])


def _axis(element: Element, kind: str, key: str = "axis") -> Floats:
    """Return the unit vector of the axis in <``key``>; e₁ for types without an axis."""
    if kind not in (*MOVING, "universal"):
        return np.array([1.0, 0, 0])
    axis = element.first(key)
    if axis is None:
        raise InputError(f"it is {kind} and has no <{key}>; write <{key} xyz=\"1 0 0\"/>, which "
                         "is what others take then, or the one that is meant.")
    along = np.array(numbers_of(axis, "xyz", 3))
    if not along.any():
        raise InputError(f"its <{key}> is zero; write its direction.")
    return unit(along)


# ---------------------------------------------------------------- text and numbers


def _text(element: Element, name: str, key: str) -> str:
    """Return the attribute ``key`` of the child element ``name``; refuse an element without it."""
    child = element.first(name)
    if child is None:
        raise InputError(f"it has no <{name}>; write <{name} {key}=\"…\"/>.")
    return attribute_of(child, key)


def _required_number(element: Element, name: str, key: str) -> float:
    """Return the number in attribute ``key`` of child ``name``; refuse an element without it."""
    child = element.first(name)
    if child is None:
        raise InputError(f"its <{element.name}> has no <{name}>; write <{name} {key}=\"…\"/>.")
    return numbers_of(child, key, 1)[0]
