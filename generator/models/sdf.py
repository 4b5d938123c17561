"""An SDF file to bodies and joints: a graph of links, whose loops are closed by joints.

    <link>    a body with a <pose> in the model, or in the element that ``relative_to`` names
    <joint>   revolute, continuous, prismatic, ball or fixed, with a <pose> in the child

The first joint that has a link as its child belongs to the tree of the robot, and is as in URDF; a
further joint closes a loop, and its place in the parent follows from the poses of the file. A link
that is no child floats; ``world`` is the ground. The axis is in the axes of the joint, as from
version 1.5.
Each element and attribute is in a closed list (``sdf_schema``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arguments import choose, few, join_or, proposal, shown
from ...core.arrays import Array, Floats
from ...core.errors import InputError
from ...core.records import dataclass
from ...core.shapes import Shape
from ...core.warnings import warn
from ..multibody.body import GROUND
from ..multibody.initial_poses import optional_vector, unit
from ..multibody.multibody import Multibody
from .bounded_xml import Element, read_xml
from .robot_builder import (
    RobotBuilder,
    as_names,
    base_pose,
    ends_of_ranges,
    refuse_extras,
    start_of,
)
from .robot_options import SdfOptions
from .robot_tree import (
    IDENTITY,
    Edge,
    Follower,
    LoopJoint,
    Placement,
    Robot,
    RobotJoint,
    RobotLink,
    check_followers,
    free_base,
    grow_tree,
    root_of,
)
from .robot_visuals import LinkLooks, add_visuals, colour_of, looks_of, shape_of
from .sdf_schema import EXTRAS, SDF, VERSIONS
from .urdf import BASES, MAX_LINKS
from .xml_numbers import UNLIMITED, parse_numbers, roll_pitch_yaw, rotation_xyzw
from .xml_schema import count_extras

__all__ = ["parse_sdf"]

#: Type of a joint → its kind in the tree; "" for links that are fixed to each other.
KINDS = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide", "ball": "ball",
         "fixed": ""}
#: The name by which elements of a model refer to the model itself.
_MODEL = "__model__"
_FLAGS = {"true": True, "1": True, "false": False, "0": False}
#: Gravity in m/s² of a <world> without <gravity>, by the standard, and of a file without a world,
#: about which the standard says nothing: the gravity of all other models here.
_STANDARD, _USUAL = [0.0, 0.0, -9.8], [0.0, 0.0, -9.81]


@dataclass(frozen=True, eq=False)
class PlacedJoint:
    """A joint where the file places it, its axis in the axes of the world.

    ``kind`` is its type in SDF, ``range`` its (lower, upper) in rad or m.
    """

    name: str
    kind: str
    parent: str
    child: str
    place: Placement
    axis: Floats
    damping: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    range: tuple[float, float] | None = None
    follower: Follower | None = None


def parse_sdf(text: str, path: str | Path, rep: Any, options: SdfOptions) -> Multibody:
    """Return the bodies and joints of a text that was read from a file; see ``load_model``."""
    base = options.get("base")
    if base is not None:
        choose("base", base, BASES)
    left_out, pose = as_names(options.get("ignore", ())), base_pose(options)
    gravity = optional_vector("gravity", options.get("gravity"))
    limits = ends_of_ranges(options.get("limits"))
    try:
        top = read_xml(text)
        model = _only_model(top)
        extras = count_extras(top, SDF)
        scopes = _Scopes(top, model)
        links, joints = _read(scopes)
        # without the option limits, ranges of joints are elements that no model here has
        if limits is None:
            extras["limits"] = sum(joint.range is not None for joint in joints)
        refuse_extras(extras, EXTRAS, left_out)
        robot = _tree(scopes, links, joints, pose, base)
        robot.gravity = np.array(_gravity(top)) if gravity is None else gravity
        robot.limits = limits
        robot_builder = RobotBuilder(robot, start_of(robot, options), rep)
        builder, mounts = robot_builder.build(), robot_builder.mounts()
        assumed = [name for name, element in scopes.elements_of_kind("link").items()
                   if element.first("inertial") is None and mounts[name].frame is not GROUND]
        if assumed:
            warn(f"The model file {str(path)!r} has no <inertial> for {few(assumed)}: 1 kg and "
                 "1 kg m² are taken, as SDF has it.")
        add_visuals(builder, _looks(model), mounts, Path(path))
        return builder
    except InputError as error:
        raise InputError(f"The model file {str(path)!r} is not usable: {error}") from None


def _only_model(top: Element) -> Element:
    """Return the one <model> of a file, which may be in a <world>, or refuse the file."""
    # [1:-1] takes off the quotes of ``shown``
    if top.name != "sdf":
        raise InputError(f"line {top.line}: its outermost element is <{shown(top.name)[1:-1]}>, "
                         "not <sdf>; give an SDF file.")
    models = [*top.all("model"), *(e for world in top.all("world") for e in world.all("model"))]
    if len(models) != 1:
        raise InputError(f"it has {len(models)} models; give a file with one <model>.")
    return models[0]


def _gravity(top: Element) -> list[float]:
    """Return gravity of the world in m/s², which files before version 1.6 have in <physics>.

    Raises InputError if the file has several that differ.
    """
    elements = [e for world in top.all("world") for owner in (world, *world.all("physics"))
                for e in owner.all("gravity")]
    if not elements:
        return _STANDARD if top.first("world") else _USUAL
    first, *duplicates = (_numbers(e, 3) for e in elements)
    if any(duplicate != first for duplicate in duplicates):
        raise InputError(f"line {elements[-1].line}: <gravity> is another one than in line "
                         f"{elements[0].line}; write the same, or set gravity.")
    return first


def _range(axis: Element) -> tuple[float, float] | None:
    """Return (lower, upper) of a joint in rad or m; None if it has no end below 10⁹."""
    limit = axis.first("limit")
    if limit is None:
        return None
    lower, upper = (_number(limit, name, end, endless=True)
                    for name, end in (("lower", -UNLIMITED), ("upper", UNLIMITED)))
    return (lower, upper) if min(abs(lower), abs(upper)) < UNLIMITED else None


# ---------------------------------------------------------------- reading


class _Scopes:
    """Named elements of a world and its model: links, joints and frames, with their places.

    In the world a part of the model has the name ``MODEL::PART``.
    """

    def __init__(self, top: Element, model: Element) -> None:
        """Collect links, joints and frames of world and model by name, and place all of them."""
        self.model, self.version = model, choose(
            "version of SDF", top.attributes.get("version", "1.6"), VERSIONS)
        self.name = model.attributes.get("name", "robot")
        self.elements: dict[str, Element] = {}
        # names of elements that belong to the world, not to the model
        self.outside: set[str] = set()
        for world in top.all("world"):
            self._add(world)
            self.outside = {*self.elements}
        self._add(model)
        self.places = {"world": IDENTITY}
        for name in (_MODEL, *self.elements):
            self.place(name)

    def _add(self, scope: Element) -> None:
        """Add the links, joints and frames of an element, or refuse a name that occurs twice."""
        for element in scope.children:
            if element.name in ("link", "joint", "frame"):
                name = element.attributes.get("name", "")
                if not name or name in self.elements or name in ("world", _MODEL):
                    raise InputError(f"line {element.line}: a <{element.name}> is named "
                                     f"{shown(name)}; give it a name of its own.")
                self.elements[name] = element

    def elements_of_kind(self, kind: str) -> dict[str, Element]:
        """Return the elements of a kind by name."""
        return {name: e for name, e in self.elements.items() if e.name == kind}

    def resolve(self, name: str, owner: str) -> str:
        """Return the name of an element that ``owner`` refers to by ``name``.

        Elements of the world call the model and its parts MODEL and MODEL::PART.
        """
        if owner not in self.outside and owner != _MODEL:
            return name
        return _MODEL if name == self.name else name.removeprefix(f"{self.name}::")

    def place(self, name: str, below: tuple[str, ...] = ()) -> Placement:
        """Return the placement of the model, a link, a joint or a frame in the world.

        Poses are relative to other elements, whose places are found first; ``below`` has the names
        on the way, so that a circle is refused.
        """
        if name in self.places:
            return self.places[name]
        if name in below:
            raise InputError(f"the poses of {' – '.join(below)} refer to each other in a circle; "
                             "correct relative_to.")
        if name not in self.elements and name != _MODEL:
            raise InputError(f"a pose is relative to {shown(name)}, which is no link, joint or "
                             f"frame{proposal(name, self.elements)}; correct it.")
        element = self.model if name == _MODEL else self.elements[name]
        pose = element.first("pose")
        attributes = {} if pose is None else pose.attributes
        # without relative_to: a joint in its child, a frame in its link, all else in its scope
        home = "world" if name == _MODEL or name in self.outside else _MODEL
        default = _text(element, "child") if element.name == "joint" else element.attributes.get(
            "attached_to") or home
        # relative_to was called frame before version 1.7
        above = self.resolve(
            attributes.get("relative_to") or attributes.get("frame") or default, name)
        placement = self.place(above, (*below, name)).then(_pose(pose))
        placement_frame = element.attributes.get("placement_frame") if name == _MODEL else None
        if placement_frame:
            # the pose belongs to a frame of the model: the model itself is at pose · frame⁻¹, and
            # the places that were computed with the model at the origin are dropped
            self.places[_MODEL] = IDENTITY
            inner = self.place(placement_frame, (*below, name))
            placement = placement.then(Placement(-inner.R.T @ inner.x, inner.R.T))
            self.places = {"world": IDENTITY}
        self.places[name] = placement
        return placement

    def link(self, name: str, below: tuple[str, ...] = ()) -> str:
        """Return the link, or the world, that a link, a joint, a frame or the model moves with.

        A joint moves with its child, a frame with the element it is attached to, and so on.
        ``below`` has the names on the way, so that a cycle ends.
        """
        if name == "world":
            return name
        if name == _MODEL:
            links = self.elements_of_kind("link")
            return self.model.attributes.get("canonical_link") or next(iter(links), "world")
        element = self.elements.get(name)
        # unknown names and circles are refused by ``place``, with a sentence
        if element is None or name in below or element.name == "link":
            return name
        # by default a frame of the world is attached to the world, and any other to the model
        home = "world" if name in self.outside else _MODEL
        above = _text(element, "child") if element.name == "joint" else element.attributes.get(
            "attached_to") or home
        return self.link(self.resolve(above, name), (*below, name))


def _read(scopes: _Scopes) -> tuple[dict[str, tuple[RobotLink, float]], list[PlacedJoint]]:
    """Return the links, name → (link, share of its weight that is compensated), and the joints.

    Raises InputError for a file without links, too many links, and joints of unknown links.
    """
    elements = scopes.elements_of_kind("link")
    if not elements:
        raise InputError("it has no <link>; write one at least.")
    if len(elements) > MAX_LINKS:
        raise InputError(f"it has more than {MAX_LINKS} links; leave some out.")
    links = {name: _link(name, e) for name, e in elements.items()}
    joints = [_joint(name, e, scopes) for name, e in scopes.elements_of_kind("joint").items()]
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in links and end != "world":
                raise InputError(f"joint {shown(joint.name)} joins {shown(end)}, which is no link"
                                 f"{proposal(end, links)}; correct it.")
    return links, joints


def _pose(pose: Element | None) -> Placement:
    """Return the placement of a <pose>: x y z roll pitch yaw, or x y z and a quaternion x y z w."""
    if pose is None or not pose.text.strip():
        return IDENTITY
    form = pose.attributes.get("rotation_format", "euler_rpy")
    owner = f"line {pose.line}: <pose>"
    choose(f"rotation_format of {owner}", form, ("euler_rpy", "quat_xyzw"))
    degrees = _flag(pose.attributes.get("degrees", "false"), owner)
    numbers = _numbers(pose, 6 if form == "euler_rpy" else 7)
    attitude = numbers[3:]
    # the text has radians unless degrees="true"; quaternions have no unit
    if form == "euler_rpy":
        R = roll_pitch_yaw(np.radians(attitude).tolist() if degrees else attitude)
    elif degrees:
        raise InputError(f"{owner} has degrees and a quaternion; remove degrees.")
    else:
        R = rotation_xyzw(attitude, owner)
    return Placement(np.array(numbers[:3]), R)


def _link(name: str, element: Element) -> tuple[RobotLink, float]:
    """Return a link, and the share of its weight that is compensated: 1 without gravity.

    A link without <inertial> has 1 kg and 1 kg m², as SDF specifies. J is rotated from the axes of
    the <inertial> to those of the link.
    """
    inertial, gravity = element.first("inertial"), element.first("gravity")
    weightless = 0.0 if gravity is None or _flag(
        gravity.text, f"line {gravity.line}: <gravity>") else 1.0
    if inertial is None:
        return RobotLink(name, 1.0, np.zeros(3), np.eye(3)), weightless
    moments = inertial.first("inertia")
    if inertial.first("mass") is None or moments is None:
        raise InputError(f"line {inertial.line}: the <inertial> of {shown(name)} has no <mass> or "
                         "no <inertia>; write both.")
    xx, yy, zz = (_number(moments, key) for key in ("ixx", "iyy", "izz"))
    xy, xz, yz = (_number(moments, key, default=0.0) for key in ("ixy", "ixz", "iyz"))
    placement, mass = _pose(inertial.first("pose")), _number(inertial, "mass")
    J = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    # a thin body has a moment of 0, which printed digits of J may miss
    if mass < 0 or np.linalg.eigvalsh(J).min() < -1e-9 * np.abs(J).max():
        raise InputError(f"line {inertial.line}: the <inertial> of {shown(name)} has a mass or a "
                         "principal moment below 0; correct it.")
    return RobotLink(name, mass, placement.x, placement.R @ J @ placement.R.T), weightless


def _joint(name: str, element: Element, scopes: _Scopes) -> PlacedJoint:
    """Return a joint with its axis and its pose in the world."""
    kind = element.attributes.get("type", "")
    if kind not in KINDS:
        raise InputError(f"line {element.line}: the type of joint {shown(name)} is {shown(kind)}; "
                         f"choose {join_or(KINDS)}{proposal(kind, KINDS)}.")
    parent, child = (scopes.link(scopes.resolve(_text(element, end), name))
                     for end in ("parent", "child"))
    if child == "world":
        raise InputError(f"line {element.line}: the child of joint {shown(name)} is 'world', which "
                         "SDF allows as a parent alone; swap <parent> and <child>, and reverse "
                         "the axis.")
    axis = element.first("axis") if KINDS[kind] in ("hinge", "slide") else None
    if axis is None:  # a ball or fixed joint needs none; the standard gives others the axis z
        return PlacedJoint(name, kind, parent, child, scopes.places[name],
                           np.array([0.0, 0.0, 1.0]))
    direction = _axis_direction(name, axis, scopes)
    if not direction.any():
        raise InputError(f"line {element.line}: the axis of joint {shown(name)} is zero; write its "
                         "direction.")
    dynamics = axis.first("dynamics")
    damping, stiffness, rest_angle = (
        0.0 if dynamics is None else _number(dynamics, key, default=0.0)
        for key in ("damping", "spring_stiffness", "spring_reference"))
    if damping < 0:
        raise InputError(f"line {axis.line}: the damping of joint {shown(name)} is {damping:g}, "
                         "which would add energy; write 0 or more.")
    return PlacedJoint(name, kind, parent, child, scopes.places[name], unit(direction),
                       damping=damping, stiffness=stiffness, rest=rest_angle, range=_range(axis),
                       follower=_follower(name, axis))


def _axis_direction(name: str, axis: Element, scopes: _Scopes) -> Array:
    """Return the direction of a joint's axis in the world, shape (3,), of any length.

    The axis is given in the frame ``expressed_in``; without it, in the frame of the joint, or in
    the frame of the model in versions 1.3 and 1.4 and with ``use_parent_model_frame``.
    """
    xyz, model = axis.first("xyz"), axis.first("use_parent_model_frame")
    expressed_in = "" if xyz is None else xyz.attributes.get("expressed_in", "")
    in_model = model is not None and _flag(model.text, f"line {model.line}: <{model.name}>")
    frame = scopes.resolve(expressed_in, name) if expressed_in else (
        _MODEL if in_model or scopes.version in ("1.3", "1.4") else name)
    if frame not in scopes.places:
        raise InputError(f"line {axis.line}: the axis of {shown(name)} is expressed in "
                         f"{shown(frame)}, which is no link, joint or frame; correct it.")
    direction: Array = scopes.places[frame].R @ (
        [0, 0, 1.0] if xyz is None else _numbers(xyz, 3))
    return direction


def _follower(name: str, axis: Element) -> Follower | None:
    """Return the law c = ratio · (c_leader − reference) + offset of <mimic>; None without it."""
    mimic = axis.first("mimic")
    if mimic is None:
        return None
    leader = mimic.attributes.get("joint", "")
    if not leader:
        raise InputError(f"line {mimic.line}: the <mimic> of joint {shown(name)} has no joint; "
                         "write joint=\"…\".")
    ratio, offset, reference = (_number(mimic, key, default) for key, default in (
        ("multiplier", 1.0), ("offset", 0.0), ("reference", 0.0)))
    return Follower(name, leader, ratio, offset - ratio * reference)


# ---------------------------------------------------------------- the tree, and what closes loops


def _tree(
    scopes: _Scopes, links: dict[str, tuple[RobotLink, float]], joints: list[PlacedJoint],
    pose: Placement, base: str | None,
) -> Robot:
    """Return the robot: the first joint to each link as its child belongs to the tree.

    All further joints to a link close loops. ``pose`` is where the options put the model. The root
    floats unless the world is in the tree or ``base`` says otherwise.
    """
    robot, places = Robot(scopes.name, "an SDF", "link"), scopes.places
    first: dict[str, PlacedJoint] = {}  # child → the joint of the tree
    for joint in joints:
        first.setdefault(joint.child, joint)
    if any(joint.parent == "world" for joint in joints):
        links = {"world": (RobotLink("world", 0.0, np.zeros(3), np.zeros((3, 3))), 0.0), **links}
    edges = [_edge(joint, places) for joint in first.values()]
    robot.followers = [joint.follower for joint in first.values() if joint.follower]
    root = root_of(links, edges, "swap <parent> and <child> of one of their joints")
    floats = root != "world" if base is None else base == "floating"
    if floats and root == "world":
        holding = next(joint.name for joint in joints if joint.parent == "world")
        raise InputError(f"base = 'floating', and joint {shown(holding)} holds the model in the "
                         "world; remove the joint, or leave base out.")
    grow_tree(robot, links, edges, pose.then(places[root]), free_base() if floats else None)
    for joint in joints:
        if joint not in first.values():
            if joint.follower is not None:
                raise InputError(f"joint {shown(joint.name)} closes a loop and has a <mimic>; "
                                 "write the <mimic> at a joint of the tree.")
            robot.loops.append(_loop(joint, places))
    check_followers(robot)
    return robot


def _edge(joint: PlacedJoint, places: Mapping[str, Placement]) -> Edge:
    """Return a joint of the tree, with its axis and its point in the axes of the child."""
    child = places[joint.child]
    placement, kind = places[joint.parent].inverse().then(child), KINDS[joint.kind]
    # 0: ``grow_tree`` sets the number of the body
    return Edge(joint.name, joint.parent, joint.child, placement, RobotJoint(
        joint.name, kind, 0, child.R.T @ joint.axis, child.inverse().then(joint.place).x,
        stiffness=joint.stiffness, rest=joint.rest, damping=joint.damping,
        range=joint.range) if kind else None)


def _loop(joint: PlacedJoint, places: Mapping[str, Placement]) -> LoopJoint:
    """Return a joint that closes a loop.

    The joint's own axes are parallel to the world's in the pose of the file, as its axis is given
    in the world.
    """
    placement = Placement(joint.place.x, np.eye(3))
    parent, child = (places[link].inverse().then(placement) for link in (joint.parent, joint.child))
    return LoopJoint(f"{joint.name}_loop", joint.kind, (joint.parent, joint.child),
                     (parent, child), joint.axis, across=None, stiffness=joint.stiffness,
                     rest=joint.rest, damping=joint.damping, range=joint.range, has_axes_on_b=True)


# ---------------------------------------------------------------- looks


def _looks(model: Element) -> Iterator[LinkLooks]:
    """Yield the looks of links, in their frames: name, visual shapes and collision shapes."""
    for link in model.all("link"):
        visible, colliding = (looks_of(link, kind, lambda element: _pose(element.first("pose")),
                                       _shape, _colour) for kind in ("visual", "collision"))
        yield link.attributes["name"], visible, colliding


def _shape(element: Element, colour: str) -> Shape | None:
    """Return a shape; SDF has its numbers in elements, where URDF has attributes."""
    texts = {child.name: child.text.strip() for child in element.children}
    texts["filename"] = texts.get("uri", "")
    return shape_of(Element(element.name, texts, element.line), colour)


def _colour(element: Element) -> str:
    """Return the colour <diffuse>, or <ambient>, of an element's <material>; "" without one."""
    material = element.first("material")
    # no loop is entered if its element is None, which type checkers do not see
    for name in ("diffuse", "ambient") if material is not None else ():
        child = material.first(name) if material is not None else None
        for count in (3, 4) if child is not None else ():
            rgba = None if child is None else parse_numbers(child.text, count)
            if rgba is not None:
                return colour_of(rgba)
    return ""


# ---------------------------------------------------------------- text and numbers


def _text(element: Element, name: str, default: str | None = None) -> str:
    """Return the text of a child element, or the default; refuse an element without either."""
    child = element.first(name)
    text = (default if child is None else child.text.strip()) or ""
    if not text:
        raise InputError(f"line {element.line}: a <{element.name}> has no <{name}>; write one.")
    return text


def _flag(text: str, owner: str) -> bool:
    """Return the flag that a text says, or refuse it; ``owner`` is named in the error."""
    flag = _FLAGS.get(text.strip().lower())
    if flag is None:
        raise InputError(f"{owner} is {shown(text.strip())}; write true or false.")
    return flag


def _numbers(element: Element, count: int, endless: bool = False) -> list[float]:
    """Return the ``count`` numbers of an element's text; ``endless`` allows infinity."""
    values = parse_numbers(element.text, count, endless)
    if values is None:
        raise InputError(f"line {element.line}: <{element.name}> is {shown(element.text.strip())}; "
                         f"write {count} finite number{'s' if count > 1 else ''}.")
    return values


def _number(
    element: Element, name: str, default: float | None = None, endless: bool = False
) -> float:
    """Return the number of a child element, or ``default``; ``endless`` allows infinity."""
    child = element.first(name)
    if child is None:
        if default is None:
            raise InputError(f"line {element.line}: <{element.name}> has no <{name}>; write one.")
        return default
    return _numbers(child, 1, endless)[0]
