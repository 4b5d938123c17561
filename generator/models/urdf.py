"""A URDF file to bodies and joints: links in their own axes, joints with their coordinates.

    revolute, continuous   a hinge; its angle and rate are quantities JOINT_angle and JOINT_rate
    prismatic              a slide; JOINT_travel and JOINT_speed
    fixed                  what it joins is one body
    floating               no constraint
    <mimic>                a constraint on two coordinates
    <dynamics damping=…>   a damper in the joint
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arguments import as_items, as_mapping, as_text, choose, listed, proposal, shown
from ...core.errors import InputError
from ...core.exact_numbers import decimal
from ...core.inertia import warn_of_degrees
from ...core.registry import SYSTEMS
from ..multibody.body import GROUND, Frame
from ..multibody.initial_poses import attitude, finite, rotation, vector
from ..multibody.multibody import Multibody
from ..parsing.exact_expressions import parse_number
from ..parsing.grammar import ANGLES, RATES
from ..parsing.reserved_names import KEYWORDS
from .bounded_xml import read_xml
from .robot_visuals import add_visuals, urdf_looks
from .urdf_robot import (
    MOVING,
    Placement,
    Robot,
    RobotJoint,
    read_robot,
    stiffness_of_limits,
)
from .urdf_tree import LoopJoint, Mount, RobotBody, placed, robot_bodies

__all__ = ["BASES", "Close", "Names", "build_robot", "coordinate_value", "parse_urdf", "plain_name",
           "read_settings", "system_name"]

BASES = ("fixed", "floating")
#: Units of coordinates and rates of hinges.
_UNITS = {"angles": ANGLES, "rates": RATES}
_VECTORS = ("gravity", "position", "quaternion", "velocity", "angular_velocity")


#: Adds to a robot's bodies and joints, by the names of its links.
Close = Callable[[Multibody, Mapping[str, Mount]], None]


@dataclass(frozen=True)
class InitialConfiguration:
    """Where a robot starts: coordinates and rates by the names of joints, and its base."""

    coordinates: dict[str, float]
    rates: dict[str, float]
    base: Placement
    velocity: Any
    angular_velocity: Any


def parse_urdf(
    text: str, path: str | Path, *, base: Any = "fixed", angles: Any = None, rates: Any = None,
    ignore: Any = (), gravity: Any = (0.0, 0.0, -9.81), position: Any = (0.0, 0.0, 0.0),
    quaternion: Any = None, velocity: Any = None, angular_velocity: Any = None, rep: Any = "gamma",
    limits: Any = None, close: Close | None = None,
) -> Multibody:
    """Return the bodies and joints of a text that was read from a file; see ``read_urdf``.

    ``close`` may add to them what closes loops, knowing where each link is.
    """
    choose("base", base, BASES)
    left_out = [ignore] if isinstance(ignore, str) else [
        as_text("what to ignore", name) for name in as_items("ignore", ignore, "names")]
    pose = Placement(vector("position", position), rotation(attitude("the base", quaternion, None)))
    stiffness = stiffness_of_limits(limits)
    try:
        top = read_xml(text)
        robot = read_robot(top, left_out, stiffness)
        builder, mounts = build_robot(robot, base, pose, angles, rates, velocity,
                                      angular_velocity, gravity, rep)
        add_visuals(builder, urdf_looks(top), mounts, Path(path))
    except InputError as error:
        raise InputError(f"The model file {str(path)!r} is not usable: {error}") from None
    if close is not None:
        close(builder, mounts)
    return builder


def read_settings(
    text: str, path: str | Path, rep: str | None, settings: Mapping[str, str],
    close: Close | None = None, parse: Callable[..., Multibody] | None = None,
) -> Multibody:
    """Return the bodies and joints of a text, with settings as a command has them.

    ``base=floating``, ``ignore=limits,collision``, ``gravity=0,0,-1.62`` (and position, quaternion,
    velocity, angular_velocity), ``limits=1000``, ``JOINT=0.5`` or ``JOINT="30 deg"`` for an angle
    or travel, ``JOINT.rate=1``. ``parse`` reads another format.
    """
    options: dict[str, Any] = {"angles": {}, "rates": {}, "rep": rep or "gamma"}
    for key, value in settings.items():
        if key == "base":
            options[key] = value
        elif key == "ignore":
            options[key] = [name.strip() for name in value.split(",")]
        elif key in _VECTORS:
            options[key] = [_number(key, part) for part in value.split(",")]
        elif key == "limits":
            options[key] = _number(key, value)
        else:
            joint, _, rate = key.rpartition(".")
            kind, name = ("rates", joint) if rate == "rate" else ("angles", key)
            number = decimal(value)
            options[kind][name] = value if number is None else float(number)
    if parse is not None:
        return parse(text, path, **options)
    return parse_urdf(text, path, close=close, **options)


def _number(key: str, text: str) -> float:
    number = decimal(text)
    if number is None:
        raise InputError(f"{key}={shown(text)} is no number; write for example {key}=0.5.")
    return float(number)


def _coordinates(robot: Robot, what: str, given: Any) -> dict[str, float]:
    """Return the values of all joints that move: those that follow others as they do."""
    moving = {name: joint for name, joint in robot.joints.items() if joint.kind in MOVING}
    told = as_mapping(what, {} if given is None else given, "{'elbow': 0.5}")
    for name in told:
        if name not in moving:
            raise InputError(f"{what} names {shown(name)}, which is no joint that moves; choose "
                             f"{listed([*moving]) if moving else 'none'}{proposal(name, moving)}.")
        leader = moving[name].follows
        if leader is not None:
            raise InputError(f"{what} names {shown(name)}, which follows {shown(leader[0])}; set "
                             "that one.")

    def value(joint: RobotJoint) -> float:
        if joint.follows is None:
            return coordinate_value(what, joint.name, joint.kind != "prismatic",
                                    told.get(joint.name, 0.0))
        leader, ratio, offset = joint.follows
        return ratio * value(moving[leader]) + (offset if what == "angles" else 0.0)

    return {name: value(joint) for name, joint in moving.items()}


def coordinate_value(what: str, name: str, is_angle: bool, given: Any) -> float:
    """Return a coordinate or rate that is a number, or a text such as "45 deg"."""
    about = f"{what[:-1]} of {name!r}"
    if isinstance(given, str):
        try:
            return float(finite(about, parse_number(given, _UNITS[what] if is_angle else {}), ()))
        except InputError as error:
            raise InputError(f"The {about} is {shown(given)}: {error}") from None
    number = float(finite(about, given, ()))
    if is_angle and what == "angles":
        warn_of_degrees(f"The {about}", [number], cure=(
            f'"{number:.6g} deg"; "{number:.6g} rad" says that radians are'))
    return number


def build_robot(
    robot: Robot, base: str, pose: Placement, angles: Any, rates: Any, velocity: Any,
    angular_velocity: Any, gravity: Any, rep: Any, kind: str = "a URDF",
) -> tuple[Multibody, dict[str, Mount]]:
    """Return bodies and joints of a tree of links, and where each link is."""
    start = InitialConfiguration(
        _coordinates(robot, "angles", angles), _coordinates(robot, "rates", rates), pose, velocity,
        angular_velocity)
    limbs = robot_bodies(robot)
    builder = Multibody(system_name(robot.name), gravity=gravity,
                        description=f"The robot {robot.name}, of {kind} file.")
    moved = limbs if base == "floating" else limbs[1:]
    if not moved:
        raise InputError("it has no link that moves; give it a joint, or a floating base.")
    floating = [limb for limb in moved if limb.joint is None or limb.joint.kind == "floating"]
    told = (start.velocity, start.angular_velocity) != (None, None)
    if told and len(floating) != 1:
        raise InputError(f"velocity and angular_velocity are those of one floating body, and there "
                         f"{'are several' if floating else 'is none'}; leave them out.")
    names, centres = Names(), {limbs[0]: np.zeros(3)}
    frames: dict[RobotBody, Frame] = {limbs[0]: builder.ground}
    places = placed(limbs, start.base, start.coordinates)
    for limb in moved:
        mass, centre, inertia = limb.body()
        centres[limb] = centre
        motion = {"velocity": start.velocity, "angular_velocity": start.angular_velocity}
        frames[limb] = builder.body(
            names.free(limb.name), mass=mass, inertia=inertia, rep=rep,
            position=places[limb].x + places[limb].R @ centre, rotation=places[limb].R,
            **(motion if limb in floating else {}))
    joined = {limb.joint.name: _join(builder, names, limb, frames, places, start)
              for limb in moved if limb.joint is not None and limb.joint.kind != "floating"}
    for name, joint in robot.joints.items():
        if joint.follows is not None:
            leader, ratio, offset = joint.follows
            builder.couple(names.free(f"{name}_mimic"), joined[leader], joined[name], ratio=ratio,
                           offset=offset)
        if robot.limits is not None and joint.range is not None and name in joined:
            builder.joint_spring(names.free(f"{name}_limits"), joined[name], rest=joint.range,
                                 stiffness=robot.limits)
        if (joint.damping or joint.stiffness) and name in joined:
            builder.joint_spring(names.free(f"{name}_damper"), joined[name], damping=joint.damping,
                                 stiffness=joint.stiffness, rest=joint.rest)
    mounts = {link.name: _mount(frames[limb], centres[limb], place, places[limb])
              for limb in limbs for place, link in limb.parts}
    for loop in robot.loops:
        LoopJoint(loop.name, loop.kind, loop.links, loop.places,
                  np.zeros(3) if loop.axes[0] is None else loop.axes[0], loop.axes[1]).close(
                      builder, names.free(loop.name, "loop"), mounts)
    return builder, mounts


def _mount(frame: Frame, centre: Any, inner: Placement, limb: Placement) -> Mount:
    """Return where a link is that is ``inner`` in its limb, and that in space."""
    space = limb.then(inner)
    if frame is GROUND:
        return Mount(frame, space, space)
    return Mount(frame, Placement(inner.x - centre, inner.R), space)


def _join(
    builder: Multibody, names: Names, limb: RobotBody, frames: Mapping[RobotBody, Frame],
    places: Mapping[RobotBody, Placement], start: InitialConfiguration,
) -> str:
    """Add the joint of a limb, with its coordinate and its rate as quantities."""
    joint = limb.joint
    assert joint is not None
    assert limb.above is not None
    name = names.free(joint.name, "joint")
    where = places[limb.above].then(limb.at)
    ends = (name, frames[limb.above], frames[limb])
    if joint.kind == "ball":
        builder.ball(*ends, at=where.x)
        return name
    axis, value, rate = where.R @ joint.axis, start.coordinates[joint.name], start.rates[joint.name]
    if joint.kind == "prismatic":
        builder.prismatic(*ends, axis_in_space=axis, at=places[limb].x, travel=value, speed=rate)
        measures = {"travel": builder.travel(name), "speed": builder.speed(name)}
    else:
        builder.revolute(*ends, axis_in_space=axis, at=where.x, angle=value, rate=rate)
        measures = {"angle": builder.angle(name), "rate": builder.rate(name)}
    for what, symbol in measures.items():
        builder.quantity(f"{plain_name(joint.name)}_{what}", symbol)
    return name


class Names:
    """Names that C has, each once, of names that may have any signs."""

    def __init__(self) -> None:
        self._taken = {"ground", "gravity"}

    def free(self, name: str, kind: str = "") -> str:
        """Return the name with _ for what C has not; with its kind, or a number, if it is taken."""
        plain = plain_name(name)
        found, count = plain, 1
        while found in self._taken:
            found = f"{plain}_{kind}" if kind and count == 1 else f"{plain}_{count}"
            count += 1
        self._taken.add(found)
        return found


def plain_name(name: str) -> str:
    """Return a name of letters, digits and _, a letter first."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII).strip("_") or "part"
    return plain if plain[0].isalpha() else f"n{plain}"


def system_name(name: str) -> str:
    """Return the name of a system for that of a robot."""
    plain = plain_name(name.lower())[:40].rstrip("_")
    return f"{plain[:34]}_robot" if plain in KEYWORDS or plain in SYSTEMS else plain
