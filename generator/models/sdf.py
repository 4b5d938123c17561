"""An SDF file to bodies and joints: a graph of links, whose loops are closed by joints.

    <link>    a body where its <pose> is in the model, or in what ``relative_to`` names
    <joint>   revolute, continuous, prismatic, ball or fixed, where its <pose> is in the child

The first joint that has a link as its child belongs to the tree of the robot, and is as in URDF; a
further one closes a loop. What its other side is follows from the poses of the file. A link that is
no child floats; ``world`` is the ground. The axis is in the axes of the joint, as from version 1.5.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import as_items, as_text, choose, listed, proposal, shown
from ...core.errors import InputError
from ...core.shapes import Shape
from ..multibody.initial_poses import attitude, rotation, vector
from ..multibody.multibody import Multibody
from .bounded_xml import Element, read_xml
from .robot_visuals import LinkLooks, add_visuals, colour_of, looks_of, shape_of
from .urdf import BASES, Names, build_robot
from .urdf_robot import (
    IDENTITY,
    MAX_LINKS,
    NUMBER,
    Placement,
    Robot,
    RobotJoint,
    RobotLink,
    refuse_extras,
    root_of,
    stiffness_of_limits,
    turn,
)
from .urdf_tree import LoopJoint, Mount

__all__ = ["EXTRAS", "parse_sdf"]

Array = NDArray[np.float64]

TYPES = ("revolute", "continuous", "prismatic", "ball", "fixed")
#: Ignorable part of a file → its meaning.
EXTRAS = {
    "limits": "ends of a joint's range",
    "friction": "dry friction of a joint",
    "collision": "shapes that touch",
    "plugin": "parts of another simulator",
}
#: What makes models of others, or follows another joint.
REFUSED = ("include", "model", "gripper", "mimic")
_MODEL = "__model__"
#: Ranges beyond this, in rad or m, are none.
_UNLIMITED = 1e9


@dataclass(frozen=True, eq=False)
class Graph:
    """Links and joints where the file places them, in the axes of the model."""

    name: str
    links: dict[str, RobotLink]
    joints: dict[str, RobotJoint]
    places: dict[str, Placement]  # of links, and of joints


def parse_sdf(
    text: str, path: str | Path, *, base: Any = None, angles: Any = None, rates: Any = None,
    ignore: Any = (), gravity: Any = None, position: Any = (0.0, 0.0, 0.0),
    quaternion: Any = None, velocity: Any = None, angular_velocity: Any = None, rep: Any = "gamma",
    limits: Any = None,
) -> Multibody:
    """Return the bodies and joints of a text that was read from a file; see ``read_sdf``."""
    if base is not None:
        choose("base", base, BASES)
    left_out = [ignore] if isinstance(ignore, str) else [
        as_text("what to ignore", name) for name in as_items("ignore", ignore, "names")]
    pose = Placement(vector("position", position), rotation(attitude("the base", quaternion, None)))
    stiffness = stiffness_of_limits(limits)
    try:
        top = read_xml(text)
        model = _only_model(top)
        extras = Counter(_extras(model))
        if stiffness is not None:
            del extras["limits"]
        refuse_extras(extras, EXTRAS, left_out)
        graph = _read(model, str(top.attributes.get("version", "1.6")))
        before = dict(graph.places)
        tree, closing = _tree(graph)
        tree = replace(tree, limits=stiffness)
        builder, mounts = _build(graph, tree, closing, base, pose.then(graph.places[tree.root]),
                                 (angles, rates, velocity, angular_velocity),
                                 _gravity(top) if gravity is None else gravity, rep)
        add_visuals(builder, _looks(model, before, graph.places), mounts, Path(path))
        return builder
    except InputError as error:
        raise InputError(f"The model file {str(path)!r} is not usable: {error}") from None


def _only_model(top: Element) -> Element:
    if top.name != "sdf":
        raise InputError(f"line {top.line}: its outermost element is <{shown(top.name)[1:-1]}>, "
                         "not <sdf>; give an SDF file.")
    models = [*top.all("model"), *(e for world in top.all("world") for e in world.all("model"))]
    if len(models) != 1:
        raise InputError(f"it has {len(models)} models; give a file with one <model>.")
    for element in models[0].children:
        if element.name in REFUSED:
            raise InputError(f"line {element.line}: <{element.name}> is none of what is read; "
                             "write its links and joints out.")
    return models[0]


def _gravity(top: Element) -> list[float]:
    given = [e for world in top.all("world") for e in world.all("gravity")]
    return _numbers(given[0], 3) if given else [0.0, 0.0, -9.81]


def _extras(model: Element) -> Iterator[str]:
    """Yield the names of what is beyond links and joints, each time it is there."""
    for element in model.children:
        if element.name == "plugin":
            yield "plugin"
        for part in element.children:
            if part.name == "collision":
                yield "collision"
            if part.name != "axis" or element.attributes.get("type") not in TYPES[:3]:
                continue
            if _range(part) is not None:
                yield "limits"
            dynamics = part.first("dynamics")
            if dynamics is not None and _number(dynamics, "friction", 0.0):
                yield "friction"


def _range(axis: Element) -> tuple[float, float] | None:
    """Return the range of a joint, None where it has none."""
    limit = axis.first("limit")
    if limit is None:
        return None
    lower, upper = _number(limit, "lower", -_UNLIMITED), _number(limit, "upper", _UNLIMITED)
    return (lower, upper) if min(abs(lower), abs(upper)) < _UNLIMITED else None


# ---------------------------------------------------------------- reading


def _read(model: Element, version: str) -> Graph:
    elements: dict[str, Element] = {}
    for element in model.children:
        if element.name in ("link", "joint", "frame"):
            name = element.attributes.get("name", "")
            if not name or name in elements or name in ("world", _MODEL):
                raise InputError(f"line {element.line}: a <{element.name}> is named {shown(name)}; "
                                 "give it a name of its own.")
            elements[name] = element
    if sum(element.name == "link" for element in elements.values()) > MAX_LINKS:
        raise InputError(f"it has more than {MAX_LINKS} links; leave some out.")
    places = {_MODEL: IDENTITY, "world": IDENTITY}
    for name in elements:
        _place(name, elements, places, [])
    links = {name: _link(name, e) for name, e in elements.items() if e.name == "link"}
    joints = {name: _joint(name, e, places, version) for name, e in elements.items()
              if e.name == "joint"}
    for joint in joints.values():
        for end in (joint.parent, joint.child):
            if end not in links and end != "world":
                raise InputError(f"joint {shown(joint.name)} joins {shown(end)}, which is no link"
                                 f"{proposal(end, links)}; correct it.")
    if not links:
        raise InputError("it has no <link>; write one at least.")
    return Graph(model.attributes.get("name", "robot"), links, joints, places)


def _place(
    name: str, elements: Mapping[str, Element], places: dict[str, Placement], below: list[str]
) -> Placement:
    """Return where a link, a joint or a frame is in the model."""
    if name in places:
        return places[name]
    if name in below:
        raise InputError(f"the poses of {' – '.join(below)} refer to each other in a circle; "
                         "correct relative_to.")
    if name not in elements:
        raise InputError(f"a pose is relative to {shown(name)}, which is no link, joint or frame"
                         f"{proposal(name, elements)}; correct it.")
    element = elements[name]
    pose = element.first("pose")
    told = {} if pose is None else pose.attributes
    default = _text(element, "child") if element.name == "joint" else element.attributes.get(
        "attached_to", _MODEL)
    above = told.get("relative_to") or told.get("frame") or default
    places[name] = _place(above, elements, places, [*below, name]).then(_pose(pose))
    return places[name]


def _pose(pose: Element | None) -> Placement:
    """Return x y z, roll pitch yaw."""
    if pose is None:
        return IDENTITY
    if pose.attributes.get("rotation_format", "euler_rpy") != "euler_rpy":
        raise InputError(f"line {pose.line}: <pose> has rotation_format="
                         f"{shown(pose.attributes['rotation_format'])}; write roll, pitch, yaw.")
    *x, roll, pitch, yaw = _numbers(pose, 6)
    if pose.attributes.get("degrees") == "true":
        roll, pitch, yaw = np.radians([roll, pitch, yaw]).tolist()
    axes = np.eye(3)
    return Placement(np.array(x), turn(axes[2], yaw) @ turn(axes[1], pitch) @ turn(axes[0], roll))


def _link(name: str, element: Element) -> RobotLink:
    inertial = element.first("inertial")
    if inertial is None:
        return RobotLink(name, 0.0, np.zeros(3), np.zeros((3, 3)))
    moments = inertial.first("inertia")
    if inertial.first("mass") is None or moments is None:
        raise InputError(f"line {inertial.line}: the <inertial> of {shown(name)} has no <mass> or "
                         "no <inertia>; write both.")
    xx, xy, xz, yy, yz, zz = (_number(moments, key, 0.0) for key in
                              ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    place, mass = _pose(inertial.first("pose")), _number(inertial, "mass", 0.0)
    J = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if mass < 0 or np.linalg.eigvalsh(J).min() < -1e-9 * np.abs(J).max():
        raise InputError(f"line {inertial.line}: the <inertial> of {shown(name)} has a mass or a "
                         "principal moment below 0; correct it.")
    return RobotLink(name, mass, place.x, place.R @ J @ place.R.T)


def _joint(
    name: str, element: Element, places: Mapping[str, Placement], version: str
) -> RobotJoint:
    """Return a joint, its axis in the axes of the model and its place where it is there."""
    kind = element.attributes.get("type", "")
    if kind not in TYPES:
        raise InputError(f"line {element.line}: the type of joint {shown(name)} is {shown(kind)}; "
                         f"choose {listed(TYPES)}{proposal(kind, TYPES)}.")
    axis, dynamics = element.first("axis"), None
    along = np.array([0.0, 0.0, 1.0])
    if axis is not None and kind in TYPES[:3]:
        xyz, dynamics = axis.first("xyz"), axis.first("dynamics")
        along = np.array([0, 0, 1.0] if xyz is None else _numbers(xyz, 3))
        told = "" if xyz is None else xyz.attributes.get("expressed_in", "")
        model = _text(axis, "use_parent_model_frame", "0") in ("1", "true")
        frame = told or (_MODEL if model or version in ("1.2", "1.3", "1.4") else name)
        if frame not in places:
            raise InputError(f"line {axis.line}: the axis of {shown(name)} is expressed in "
                             f"{shown(frame)}, which is no link, joint or frame; correct it.")
        along = places[frame].R @ along
    size = float(np.linalg.norm(along))
    if not size:
        raise InputError(f"line {element.line}: the axis of joint {shown(name)} is zero; write its "
                         "direction.")
    damping, stiffness, rest = (
        0.0 if dynamics is None else _number(dynamics, key, 0.0)
        for key in ("damping", "spring_stiffness", "spring_reference"))
    return RobotJoint(name, kind, _text(element, "parent"), _text(element, "child"), places[name],
                      along / size, damping, None, stiffness, rest,
                      None if axis is None or kind not in TYPES[:3] else _range(axis))


# ---------------------------------------------------------------- the tree, and what closes loops


def _tree(graph: Graph) -> tuple[Robot, list[RobotJoint]]:
    """Return a tree of links and joints as URDF has them, and the joints that close loops.

    A link's frame in it is at its joint, with the axes of the link.
    """
    first: dict[str, RobotJoint] = {}
    for joint in graph.joints.values():
        if joint.child != "world":
            first.setdefault(joint.child, joint)
    tree = {joint.name for joint in first.values()}
    links, places = dict(graph.links), graph.places
    if any("world" in (joint.parent, joint.child) for joint in graph.joints.values()):
        links = {"world": RobotLink("world", 0.0, np.zeros(3), np.zeros((3, 3))), **links}
    for child, joint in first.items():  # its frame goes to its joint
        moved = Placement(joint.place.x, places[child].R)
        link = links[child]
        shift = moved.R.T @ (places[child].x - moved.x)
        links[child] = RobotLink(child, link.mass, link.centre + shift, link.inertia)
        places[child] = moved
    joints = {}
    for name, joint in graph.joints.items():
        if name in tree:
            above, here = places[joint.parent], places[joint.child]
            joints[name] = RobotJoint(
                name, joint.kind, joint.parent, joint.child,
                Placement(above.R.T @ (here.x - above.x), above.R.T @ here.R),
                here.R.T @ joint.axis, joint.damping, None, joint.stiffness, joint.rest,
                joint.range)
    robot = Robot(graph.name, links, joints, root_of(links, joints))
    return robot, [joint for name, joint in graph.joints.items() if name not in tree]


def _build(
    graph: Graph, tree: Robot, closing: list[RobotJoint], base: str | None, pose: Placement,
    start: tuple[Any, Any, Any, Any], gravity: Any, rep: Any,
) -> tuple[Multibody, dict[str, Mount]]:
    chosen = base or ("fixed" if tree.root == "world" else "floating")
    angles, rates, velocity, angular_velocity = start
    builder, mounts = build_robot(tree, chosen, pose, angles, rates, velocity, angular_velocity,
                                  gravity, rep, "an SDF")
    names = Names()
    for joint in closing:
        _close(builder, names.free(f"{joint.name}_loop"), joint, graph.places, mounts)
    return builder, mounts


def _close(
    builder: Multibody, name: str, joint: RobotJoint, places: Mapping[str, Placement],
    mounts: Mapping[str, Mount],
) -> None:
    """Add a joint that closes a loop, in the axes of the model where the file places it."""
    ends = joint.parent, joint.child
    at, over = (Placement(places[link].R.T @ (joint.place.x - places[link].x), places[link].R.T)
                for link in ends)
    LoopJoint(joint.name, joint.kind, ends, (at, over), joint.axis).close(builder, name, mounts)
    if (joint.damping or joint.stiffness) and joint.kind in TYPES[:3]:
        builder.joint_spring(f"{name}_damper", name, damping=joint.damping,
                             stiffness=joint.stiffness, rest=joint.rest)


# ---------------------------------------------------------------- looks


def _looks(
    model: Element, before: Mapping[str, Placement], places: Mapping[str, Placement]
) -> Iterator[LinkLooks]:
    """Yield what links look like, in their frames in the tree, which are at their joints."""
    for link in model.all("link"):
        name = link.attributes["name"]
        shift = places[name].R.T @ (before[name].x - places[name].x)

        def place(element: Element, shift: Array = shift) -> Placement:
            return Placement(shift, np.eye(3)).then(_pose(element.first("pose")))

        seen, colliding = (looks_of(link, kind, place, _shape, _colour)
                           for kind in ("visual", "collision"))
        yield name, seen, colliding


def _shape(element: Element, colour: str) -> Shape | None:
    """Return a shape whose numbers are elements."""
    told = {part.name: part.text.strip() for part in element.children}
    told["filename"] = told.get("uri", "")
    return shape_of(Element(element.name, told, element.line), colour)


def _colour(element: Element) -> str:
    """Return <diffuse>, or <ambient>, of <material>."""
    material = element.first("material")
    for name in ("diffuse", "ambient") if material is not None else ():
        part = material.first(name) if material is not None else None
        words = [] if part is None else part.text.split()
        if len(words) >= 3 and all(NUMBER.fullmatch(word) for word in words):
            return colour_of([*map(float, words)])
    return ""


# ---------------------------------------------------------------- text and numbers


def _text(element: Element, name: str, default: str | None = None) -> str:
    part = element.first(name)
    found = (default if part is None else part.text.strip()) or ""
    if not found:
        raise InputError(f"line {element.line}: a <{element.name}> has no <{name}>; write one.")
    return found


def _numbers(element: Element, count: int) -> list[float]:
    words = element.text.split()
    values = [float(word) for word in words if NUMBER.fullmatch(word)]
    if len(words) != count or len(values) != count or not np.isfinite(values).all():
        raise InputError(f"line {element.line}: <{element.name}> is {shown(element.text.strip())}; "
                         f"write {count} finite number{'s' if count > 1 else ''}.")
    return values


def _number(element: Element, name: str, default: float) -> float:
    part = element.first(name)
    return default if part is None else _numbers(part, 1)[0]
