"""An MJCF file to bodies and joints: bodies in their own axes, joints with their coordinates.

    hinge, slide          a revolute or prismatic joint, whose coordinate is that of qpos
    ball, free            a ball joint; no constraint
    several in one body   a planar, cylindrical, universal or ball joint, else a chain
    armature              a flywheel
    stiffness, damping    a spring and a damper in the joint
    actuator              an input of its name, and a motor
    connect, weld, joint  a ball, a fixed joint, a coupling or a law; tendon: a law
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import as_items, as_mapping, as_text, listed, proposal, shown
from ...core.errors import InputError
from ...core.inertia import quaternion_of_matrix, real_array
from ..multibody.body import GROUND, Body, Frame, dot
from ..multibody.coordinates import Arm, Slide, Translation
from ..multibody.initial_poses import clean, optional_vector, rotation, unit
from ..multibody.joints import Align, Connection
from ..multibody.multibody import Multibody
from .mjcf_document import Given, read_document
from .mjcf_robot import (
    COMMON,
    EXTRAS,
    MjcfActuator,
    MjcfEquality,
    MjcfJoint,
    MjcfRobot,
    MjcfTendon,
    read_mjcf_robot,
)
from .robot_visuals import Look, draw
from .urdf import Close, Names, coordinate_value, plain_name, system_name
from .urdf_robot import (
    IDENTITY,
    Placement,
    RobotLink,
    refuse_extras,
    stiffness_of_limits,
    turn,
)
from .urdf_tree import Mount, combine

__all__ = ["parse_mjcf", "read_mjcf_settings"]

Array = NDArray[np.float64]
#: Axes are perpendicular, or agree, to within this; points in m.
_SAME = 1e-12


def parse_mjcf(
    text: str, path: str | Path, *, keyframe: Any = None, angles: Any = None, rates: Any = None,
    ignore: Any = (), gravity: Any = None, rep: Any = "gamma", limits: Any = None,
    close: Close | None = None,
) -> Multibody:
    """Return the bodies and joints of a text that was read from a file; see ``read_mjcf``.

    ``close`` adds loop joints, given the placement of each body.
    """
    left_out = [ignore] if isinstance(ignore, str) else [
        as_text("what to ignore", name) for name in as_items("ignore", ignore, "names")]
    weight, stiffness = optional_vector("gravity", gravity), stiffness_of_limits(limits)
    file = Path(path)
    try:
        robot = read_mjcf_robot(read_document(text, file, COMMON), file.stem)
        robot.limits = stiffness
        robot.extras["limits"] += sum(
            joint.range is not None and (stiffness is None or joint.kind == "ball")
            for joint in robot.joints.values())
        refuse_extras(robot.extras, EXTRAS, left_out)
        if weight is not None:
            robot.gravity = weight
        made = _Builder(robot, _start(robot, keyframe, angles, rates), rep, file)
        builder = made.build()
    except InputError as error:
        raise InputError(f"The model file {str(path)!r} is not usable: {error}") from None
    if close is not None:
        close(builder, made.mounts())
    return builder


def read_mjcf_settings(
    text: str, path: str | Path, rep: str | None, settings: Mapping[str, str],
    close: Close | None = None,
) -> Multibody:
    """Return the bodies and joints of a text, with settings as a command has them.

    ``keyframe=home``, ``ignore=limits,contact``, ``limits=1000``, ``gravity=0,0,-1.62``,
    ``JOINT=0.5`` or ``JOINT="30 deg"`` for an angle or travel, ``JOINT.rate=1``; ball and free
    joints take several numbers, ``root=0,0,1,1,0,0,0``.
    """
    options: dict[str, Any] = {"angles": {}, "rates": {}, "rep": rep or "gamma"}
    for key, value in settings.items():
        if key == "keyframe":
            options[key] = value
        elif key == "ignore":
            options[key] = [name.strip() for name in value.split(",")]
        elif key == "gravity":
            options[key] = _numbers(value)
        elif key == "limits":
            options[key] = _number(value)
        else:
            joint, _, rate = key.rpartition(".")
            kind, name = ("rates", joint) if rate == "rate" else ("angles", key)
            options[kind][name] = _numbers(value) if "," in value else _number(value)
    return parse_mjcf(text, path, close=close, **options)


def _numbers(text: str) -> list[Any]:
    return [_number(part) for part in text.split(",")]


def _number(text: str) -> Any:
    """Return a number, or a text, which is an angle with a unit, or refused later."""
    try:
        return float(text)
    except ValueError:
        return text


# ---------------------------------------------------------------- the start


@dataclass
class _Start:
    """Coordinates and rates of joints as in qpos and qvel, and values of actuators."""

    values: dict[str, Array]
    rates: dict[str, Array]
    controls: dict[str, float]


def _start(robot: MjcfRobot, keyframe: Any, angles: Any, rates: Any) -> _Start:
    """Return where the robot starts: at a keyframe, else where the file places it."""
    found = _Start({name: _reference(robot, joint) for name, joint in robot.joints.items()},
                   {name: np.zeros(_rates_of(joint)) for name, joint in robot.joints.items()},
                   {actuator.name: 0.0 for actuator in robot.actuators})
    if keyframe is not None:
        _take_key(robot, found, _key(robot, keyframe))
    for what, given, values in (("angles", angles, found.values), ("rates", rates, found.rates)):
        for name, e in as_mapping(what, {} if given is None else given, "{'elbow': 0.5}").items():
            if name not in robot.joints:
                raise InputError(
                    f"{what} names {shown(name)}, which is no joint; choose "
                    f"{listed([*robot.joints]) if robot.joints else 'none'}"
                    f"{proposal(name, robot.joints)}.")
            values[name] = _joint_values(what, robot.joints[name], e)
    return found


def _reference(robot: MjcfRobot, joint: MjcfJoint) -> Array:
    """Return a joint's part of qpos0, where the file places its body."""
    if joint.kind == "ball":
        return np.array([1.0, 0, 0, 0])
    if joint.kind == "free":
        place = robot.bodies[joint.body].place
        return np.concatenate([place.x, _quaternion(place.R)])
    return np.array([joint.ref])


def _rates_of(joint: MjcfJoint) -> int:
    return {"free": 6, "ball": 3}.get(joint.kind, 1)


def _joint_values(what: str, joint: MjcfJoint, given: Any) -> Array:
    """Return values of a joint: one, or as many numbers as qpos or qvel has."""
    if joint.kind in ("hinge", "slide"):
        return np.array([coordinate_value(what, joint.name, joint.kind == "hinge", given)])
    count = joint.count if what == "angles" else _rates_of(joint)
    found = real_array(given)
    if found is None or found.shape != (count,) or not np.isfinite(found).all():
        raise InputError(f"The {what[:-1]} of {joint.name!r} is {shown(given)}; a {joint.kind} "
                         f"joint has {count} finite numbers, as "
                         f"{'qpos' if what == 'angles' else 'qvel'} has.")
    return _with_unit_quaternion(joint, found) if what == "angles" else found


def _with_unit_quaternion(joint: MjcfJoint, values: Array) -> Array:
    if not values[-4:].any():
        raise InputError(f"The quaternion of {joint.name!r} is zero; give its direction.")
    return np.concatenate([values[:-4], unit(values[-4:])])


def _key(robot: MjcfRobot, keyframe: Any) -> Given:
    names = [key.name for key in robot.keys]
    if isinstance(keyframe, str) and keyframe in names:
        return robot.keys[names.index(keyframe)].given
    number = int(keyframe) if isinstance(keyframe, str) and keyframe.isdigit() else keyframe
    if isinstance(number, int) and not isinstance(number, bool) and 0 <= number < len(names):
        return robot.keys[number].given
    known = [name or str(number) for number, name in enumerate(names)]
    raise InputError(f"keyframe = {shown(keyframe)} is none of the file; "
                     f"{'choose ' + listed(known) if known else 'it has no <key>'}"
                     f"{proposal(keyframe, known)}.")


def _take_key(robot: MjcfRobot, start: _Start, key: Given) -> None:
    joints = [*robot.joints.values()]
    for what, values, counts in (
            ("qpos", start.values, [joint.count for joint in joints]),
            ("qvel", start.rates, [_rates_of(joint) for joint in joints])):
        if what in key:
            numbers, ends = np.array(key.numbers(what, sum(counts))), np.cumsum(counts)
            for joint, part in zip(joints, np.split(numbers, ends[:-1]), strict=True):
                quaternion = what == "qpos" and joint.kind in ("ball", "free")
                values[joint.name] = _with_unit_quaternion(joint, part) if quaternion else part
    if "ctrl" in key and robot.actuators:
        controls = key.numbers("ctrl", 1, 1000)
        if len(controls) == len(robot.actuators):  # else some are left out, whose numbers these are
            start.controls = dict(zip(start.controls, controls, strict=True))


def _quaternion(R: Array) -> Array:
    return np.array(quaternion_of_matrix(R, "attitude"))


# ---------------------------------------------------------------- bodies in space


@dataclass
class _Poses:
    """Where bodies are in space, and axes and points of joints."""

    bodies: list[Placement] = field(default_factory=list)
    axes: dict[str, Array] = field(default_factory=dict)
    points: dict[str, Array] = field(default_factory=dict)


def _placed(robot: MjcfRobot, values: Mapping[str, Array]) -> _Poses:
    """Return where bodies are at the values of their joints."""
    found = _Poses()
    for body in robot.bodies:
        above = IDENTITY if body.above < 0 else found.bodies[body.above]
        here = above.then(body.place)
        for joint in body.joints:
            value, name = values[joint.name], joint.name
            if joint.kind == "free":
                here = Placement(value[:3], rotation(value[3:]))
            axis, point = here.R @ joint.axis, here.x + here.R @ joint.point
            found.axes[name] = axis
            if joint.kind == "slide":
                here = Placement(here.x + (value[0] - joint.ref) * axis, here.R)
                point = point + (value[0] - joint.ref) * axis
            elif joint.kind != "free":
                R = (turn(axis, value[0] - joint.ref) @ here.R if joint.kind == "hinge"
                     else here.R @ rotation(value))
                here = Placement(point - R @ joint.point, R)
            found.points[name] = point
        found.bodies.append(here)
    return found


def _velocities(
    robot: MjcfRobot, poses: _Poses, rates: Mapping[str, Array]
) -> list[tuple[Array, Array]]:
    """Return the velocity of the origin of each body and its angular velocity, in space."""
    found: list[tuple[Array, Array]] = []
    for body, here in zip(robot.bodies, poses.bodies, strict=True):
        v, w = np.zeros(3), np.zeros(3)
        if body.above >= 0:
            v, w = found[body.above]
            v = v + np.cross(w, here.x - poses.bodies[body.above].x)
        for joint in body.joints:
            rate = rates[joint.name]
            if joint.kind == "slide":
                v = v + rate[0] * poses.axes[joint.name]
                continue
            if joint.kind == "free":
                v, w = rate[:3], here.R @ rate[3:]
                continue
            turning = here.R @ rate if joint.kind == "ball" else rate[0] * poses.axes[joint.name]
            w = w + turning
            v = v + np.cross(turning, here.x - poses.points[joint.name])
        found.append((v, w))
    return found


# ---------------------------------------------------------------- building


class _Builder:
    """Bodies, joints, springs, motors and equalities of a robot, one after the other."""

    def __init__(self, robot: MjcfRobot, start: _Start, rep: Any, file: Path) -> None:
        self.robot, self.start, self.rep, self.file = robot, start, rep, file
        self.poses = _placed(robot, start.values)
        self.at_reference = _placed(
            robot, {name: _reference(robot, joint) for name, joint in robot.joints.items()})
        self.builder = Multibody(
            system_name(robot.name), gravity=robot.gravity, dt=robot.dt, steps=1000,
            description=f"The robot {robot.name}, of an MJCF file.")
        self.names = Names()
        self.frames: dict[int, Frame] = {-1: self.builder.ground}
        self.centres: dict[int, Array] = {-1: np.zeros(3)}
        #: Name of a joint → what has its coordinate as angle or travel.
        self.coordinates: dict[str, Connection] = {}

    def build(self) -> Multibody:
        robot = self.robot
        moved = [k for k, body in enumerate(robot.bodies) if body.joints]
        if not moved:
            raise InputError("no body of it has a joint, so that nothing moves; give it one.")
        velocities = _velocities(robot, self.poses, self.start.rates)
        for limb in moved:
            self._body(limb, velocities[limb])
        for limb in moved:
            self._join(limb)
        for joint in robot.joints.values():
            self._quantities(joint)
            self._springs(joint)
        for actuator in robot.actuators:
            self._actuator(actuator)
        for name, tendon in robot.tendons.items():
            if tendon.stiffness or tendon.damping:
                self._tendon(name, tendon)
        for equality in robot.equalities:
            self._equality(equality)
        self._compensate_gravity()
        for limb in self.frames:
            self._draw(limb)
        return self.builder

    # ------------------------------------------------------------ bodies

    def _inner(self, body: int, limb: int) -> Placement:
        """Return where a body is in the frame of what it moves with."""
        place = IDENTITY
        while body != limb:
            place = self.robot.bodies[body].place.then(place)
            body = self.robot.bodies[body].above
        return place

    def mounts(self) -> dict[str, Mount]:
        """Return the placement of each body of the file, in its rigid part and in space."""
        found = {}
        for k, body in enumerate(self.robot.bodies):
            limb, space = self.robot.limb(k), self.poses.bodies[k]
            inner = self._inner(k, limb)
            found[body.name] = Mount(
                self.frames[limb], Placement(inner.x - self.centres[limb], inner.R), space)
        return found

    def _body(self, limb: int, motion: tuple[Array, Array]) -> None:
        robot = self.robot
        body, here = robot.bodies[limb], self.poses.bodies[limb]
        parts = [(self._inner(k, limb), part.link) for k, part in enumerate(robot.bodies)
                 if part.link.mass > 0 and robot.limb(k) == limb]
        if not parts:
            raise InputError(f"body {shown(body.name)} moves and has no mass, nor has what is "
                             "fixed to it; give it an <inertial>, or geoms with mass.")
        extra = body.joints[0].armature if body.joints[0].kind == "free" else 0.0
        if extra:  # ½ a (|v|² + |ω|²) of the origin of its axes
            parts.append((IDENTITY, RobotLink(body.name, extra, np.zeros(3), extra * np.eye(3))))
        mass, centre, inertia = combine(parts)
        inertia = clean(inertia)  # moments cost less than a tensor
        v, w = motion
        self.centres[limb] = centre
        self.frames[limb] = self.builder.body(
            self.names.free(body.name), mass=mass, inertia=inertia, rep=self.rep,
            position=here.x + here.R @ centre, rotation=here.R,
            velocity=v + np.cross(w, here.R @ centre), angular_velocity=here.R.T @ w)

    def _on(self, limb: int, poses: _Poses, point: Array) -> Array:
        """Return a point of space at some poses in the axes of a body, from its centre."""
        if limb < 0:
            return point
        here = poses.bodies[limb]
        found: Array = here.R.T @ (point - here.x) - self.centres[limb]
        return found

    def _draw(self, limb: int) -> None:
        """Draw a body, or the ground, with its geoms of groups 0 to 2, else with the others."""
        robot = self.robot
        looks: tuple[list[Look], list[Look]] = ([], [])
        for k in range(-1, len(robot.bodies)):
            if robot.limb(k) != limb:
                continue
            inner = self._inner(k, limb)
            for geom in robot.geoms if k < 0 else robot.bodies[k].geoms:
                if geom.look is not None:
                    place, shape = geom.look
                    looks[geom.group > 2].append((inner.then(place), shape))
        seen, colliding = looks
        draw(self.builder, self.frames[limb], Placement(-self.centres[limb], np.eye(3)),
             seen or colliding, colliding, self.file)

    # ------------------------------------------------------------ joints

    def _join(self, limb: int) -> None:
        """Add what holds a body to the one above."""
        robot, build = self.robot, self.builder
        joints, above = robot.bodies[limb].joints, robot.limb(robot.bodies[limb].above)
        kinds = [joint.kind for joint in joints]
        first = joints[0]
        ends = self.frames[above], self.frames[limb]
        axes = [self.poses.axes[joint.name] for joint in joints]
        points = [self.poses.points[joint.name] for joint in joints]
        if kinds == ["free"] or (kinds == ["slide"] * 3 + ["ball"] and above < 0
                                 and abs(np.linalg.det(axes[:3])) > _SAME):
            return
        if len(joints) == 1:
            name = self.names.free(first.name, "joint")
            value = float(self.start.values[first.name][0])
            where: dict[str, Any] = {"at": points[0]}
            if first.kind == "ball":
                ball = build.ball(name, *ends, **where)
                if first.armature:
                    build.flywheel(self.names.free(f"{first.name}_rotor"), ball,
                                   inertia=first.armature)
                return
            where["axis_in_space"] = axes[0]
            self._know(first, build.revolute(name, *ends, **where, angle=value)
                       if first.kind == "hinge" else
                       build.prismatic(name, *ends, **where, travel=value))
        elif all(joint.armature for joint in joints) and set(kinds) <= {"hinge", "slide"}:
            self._chain(limb, ends, axes, points)
        elif not self._special(limb, ends, axes, points):
            raise InputError(
                f"body {shown(robot.bodies[limb].name)} has the joints {', '.join(kinds)} in a "
                "row, and not each has an inertia; write armature=\"…\" above 0 for each, or a "
                "body with mass between them.")

    def _know(self, joint: MjcfJoint, link: Connection) -> None:
        """Remember what has the coordinate of a joint, which is a flywheel's with armature."""
        if joint.armature:
            link = self.builder.flywheel(self.names.free(f"{joint.name}_rotor"), link,
                                        inertia=joint.armature)
        self.coordinates[joint.name] = link

    def _chain(
        self, limb: int, ends: tuple[Frame, Frame], axes: Sequence[Array], points: Sequence[Array]
    ) -> None:
        joints, build = self.robot.bodies[limb].joints, self.builder
        rows = []
        for joint, axis, point in zip(joints, axes, points, strict=True):
            coordinate, rate = ("angle", "rate") if joint.kind == "hinge" else ("travel", "speed")
            rows.append({
                "name": self.names.free(joint.name, "joint"), "axis": axis, "at": point,
                "inertia": joint.armature, coordinate: float(self.start.values[joint.name][0]),
                rate: float(self.start.rates[joint.name][0])})
        chain = build.chain(self.names.free(f"{self.robot.bodies[limb].name}_joints"), *ends, rows)
        for joint, link in zip(joints, chain.links, strict=True):
            self.coordinates[joint.name] = link.coordinate

    def _special(
        self, limb: int, ends: tuple[Frame, Frame], axes: Sequence[Array], points: Sequence[Array]
    ) -> bool:
        """Add joints in a row as one that is known; return whether there is one."""
        joints, build = self.robot.bodies[limb].joints, self.builder
        kinds = [joint.kind for joint in joints]
        value = [float(self.start.values[joint.name][0]) for joint in joints]
        slides = kinds.index("hinge") if "hinge" in kinds else len(kinds)
        inert = any(joint.armature for joint in joints)
        name = self.names.free(joints[-1].name, "joint")
        if set(kinds[:slides]) == {"slide"} and ends[0] is GROUND and len(kinds) <= 3 and (
                len(kinds) - slides <= 1):
            return self._slides(name, limb, ends, axes, points)
        if kinds in (["hinge", "slide"], ["slide", "hinge"]) and axes[0] @ axes[1] > 1 - _SAME:
            hinge, slide = kinds.index("hinge"), kinds.index("slide")
            link = build.cylindrical(name, *ends, axis_in_space=axes[hinge], at=points[hinge],
                                     angle=value[hinge], travel=value[slide])
            self.coordinates[joints[slide].name] = link
            return not inert
        if kinds == ["hinge"] * 2 and abs(axes[0] @ axes[1]) < _SAME and not inert:
            return self._cross(name, limb, ends, axes, points)
        if kinds == ["hinge"] * 3 and not inert and all(
                np.allclose(points[0], point, rtol=0, atol=_SAME) for point in points):
            build.ball(name, *ends, at=points[0])
            return True
        return False

    def _slides(
        self, name: str, limb: int, ends: tuple[Frame, Frame], axes: Sequence[Array],
        points: Sequence[Array]
    ) -> bool:
        """Add two or three slides of the ground; the last may be a hinge normal to them."""
        joints, build = self.robot.bodies[limb].joints, self.builder
        hinge = joints[-1].kind == "hinge"
        along = np.array(axes[:-1] if hinge else axes)
        at = points[-1]
        if len(along) < 2 or np.linalg.svd(along)[1][-1] < _SAME:
            return False
        normal = unit(np.cross(along[0], along[1])) if len(along) == 2 else None
        if hinge:
            if normal is None or abs(normal @ axes[-1]) < 1 - _SAME:
                return False
            angle = float(self.start.values[joints[-1].name][0])
            self._know(joints[-1], build.planar(name, *ends, axis_in_space=axes[-1], at=at,
                                                angle=angle))
        else:
            build._join(Translation(name, *ends, at=at, normal=normal))
        duals = np.linalg.pinv(along).T  # d = Σ s_i e_i has s_i = d · dual_i
        for joint, dual in zip(joints, duals, strict=False):
            label = self.names.free(f"{joint.name}_slide")
            self._know(joint, build._join(Slide(
                label, *ends, at=at, hinge=Align(label, *ends, unit(dual)),
                scale=float(np.linalg.norm(dual)),
                travel=float(self.start.values[joint.name][0]))))
        return True

    def _cross(
        self, name: str, limb: int, ends: tuple[Frame, Frame], axes: Sequence[Array],
        points: Sequence[Array]
    ) -> bool:
        """Add two hinges at right angles whose axes meet as a universal joint, and its angles."""
        joints, build = self.robot.bodies[limb].joints, self.builder
        apart = points[1] - points[0]
        if abs(np.cross(axes[0], axes[1]) @ apart) > _SAME:
            return False
        at = points[0] + (axes[0] @ apart) * axes[0]
        build.universal(name, *ends, axis_a=axes[0], axis_b=axes[1], at=at)
        for k, joint in enumerate(joints):
            self.coordinates[joint.name] = build._join(Arm(
                self.names.free(f"{joint.name}_arm"), *ends, arms=(axes[0], axes[1]), own=k,
                angle=float(self.start.values[joint.name][0])))
        return True

    def _symbols(self, joint: str) -> tuple[Any, Any]:
        """Return the symbols of the coordinate and of the rate of a joint."""
        link = self.coordinates[joint]
        if self.robot.joints[joint].kind == "hinge":
            return self.builder.angle(link), self.builder.rate(link)
        return self.builder.travel(link), self.builder.speed(link)

    def _quantities(self, joint: MjcfJoint) -> None:
        if joint.name in self.coordinates:
            names = ("angle", "rate") if joint.kind == "hinge" else ("travel", "speed")
            for what, symbol in zip(names, self._symbols(joint.name), strict=True):
                self.builder.quantity(f"{plain_name(joint.name)}_{what}", symbol)

    def _springs(self, joint: MjcfJoint) -> None:
        """Add spring, damper and limits of a joint; refuse those of one without a coordinate."""
        build = self.builder
        limited = None not in (self.robot.limits, joint.range) and joint.kind != "ball"
        if joint.name in self.coordinates:
            if joint.stiffness or joint.damping:
                build.joint_spring(
                    self.names.free(f"{joint.name}_spring"), self.coordinates[joint.name],
                    stiffness=joint.stiffness, damping=joint.damping, rest=joint.rest)
            if limited:
                build.joint_spring(
                    self.names.free(f"{joint.name}_limits"), self.coordinates[joint.name],
                    stiffness=self.robot.limits or 0.0, rest=joint.range or (0.0, 0.0))
            return
        own = joint.kind in ("ball", "free") and len(self.robot.bodies[joint.body].joints) == 1
        told = " and ".join(
            [key for key in ("stiffness", "damping", "armature")
             if getattr(joint, key) and not (own and key == "armature")] + ["range"] * limited)
        if joint.kind == "ball" and told == "damping":
            self._ball_damper(joint)
        elif told:
            row = "" if joint.kind in ("ball", "free") else " in a row without armature"
            raise joint.given.error(f"has {told}, which a {joint.kind} joint{row} has not here; "
                                    "write 0, or armature for each joint of its body.")

    def _ball_damper(self, joint: MjcfJoint) -> None:
        """Add the torque −c ω of the relative angular velocity."""
        limb = joint.body
        a, b = self.frames[self.robot.limb(self.robot.bodies[limb].above)], self.frames[limb]
        c = self.builder.parameter(self.names.free(f"{joint.name}_damping"), joint.damping)
        apart = [y - x for x, y in zip(a.direction(a.angular_velocity),
                                       b.direction(b.angular_velocity), strict=True)]
        for frame, sign in ((b, -1), (a, 1)):
            if isinstance(frame, Body):
                self.builder.torque(frame, [sign * c * dot(frame.rotation.col(k), apart)
                                           for k in range(3)])

    # ------------------------------------------------------------ actuators and equalities

    def _actuator(self, actuator: MjcfActuator) -> None:
        build, gear = self.builder, actuator.gear
        length, rate = (gear * e for e in self._length(
            f"actuator {shown(actuator.name)}", actuator.joints))
        label = self.names.free(actuator.name, "input")
        u: Any = 0
        if actuator.gain or actuator.drag:
            u = build.input(label, self.start.controls[actuator.name])
        b0, b1, b2 = actuator.bias
        if actuator.ratio:
            b2 = -2 * actuator.ratio * float(np.sqrt(-b1 * self._inertia(actuator)))
        effort = gear * (actuator.gain * u + b0 + b1 * length + (b2 + actuator.drag * u) * rate)
        self._pull(label, actuator.joints, effort)

    def _inertia(self, actuator: MjcfActuator) -> float:
        """Return the effective inertia 1/(J M⁻¹ Jᵀ) of an actuator at the reference position."""
        rows: dict[str, Array] = {}  # joint → 6 × n: angular velocity, velocity of the origin
        for name, joint in self.robot.joints.items():
            axes = self.at_reference.bodies[joint.body].R.T  # of balls and free joints
            if joint.kind in ("hinge", "slide"):
                axes = self.at_reference.axes[name][None]
            still = np.zeros((3, 3)) if joint.kind == "free" else np.zeros_like(axes)
            moved = np.cross(self.at_reference.points[name], axes)
            rows[name] = np.hstack([still, axes] if joint.kind == "slide" else [axes, moved])
            if joint.kind == "free":
                rows[name] = np.vstack([np.hstack([still, np.eye(3)]), rows[name]])
        sizes = [len(rows[name]) for name in rows]
        mass = np.diag(np.repeat([j.armature for j in self.robot.joints.values()], sizes))
        for k, body in enumerate(self.robot.bodies):
            here, link = self.at_reference.bodies[k], body.link
            J = np.vstack([row * self._carries(self.robot.joints[name].body, k)
                           for name, row in rows.items()])
            w, v = J[:, :3], J[:, 3:] + np.cross(J[:, :3], here.x + here.R @ link.centre)
            mass += w @ here.R @ link.inertia @ here.R.T @ w.T + link.mass * v @ v.T
        told = dict(actuator.joints)
        J = actuator.gear * np.repeat([told.get(name, 0.0) for name in rows], sizes)
        return 1 / float(J @ np.linalg.solve(mass, J))

    def _carries(self, body: int, other: int) -> bool:
        """Return whether ``other`` is the body or hangs on it."""
        while other > body:
            other = self.robot.bodies[other].above
        return other == body

    def _tendon(self, name: str, tendon: MjcfTendon) -> None:
        """Add the spring and the damper of a fixed tendon."""
        length, rate = self._length(f"tendon {shown(name)}", tendon.joints)
        label = self.names.free(name, "tendon")
        k = self.builder.parameter(f"{label}_stiffness", tendon.stiffness)
        c = self.builder.parameter(f"{label}_damping", tendon.damping)
        if tendon.stiffness:
            self.builder.potential(k * (length - tendon.rest) ** 2 / 2)
        if tendon.damping:
            self._pull(label, tendon.joints, -c * rate)

    def _length(self, what: str, joints: Sequence[tuple[str, float]]) -> tuple[Any, Any]:
        """Return Σ coefficient · coordinate of joints, and its rate."""
        for name, _ in joints:
            if name not in self.coordinates:
                raise InputError(f"{what} acts on {shown(name)}, which has no coordinate here; "
                                 "write armature for each joint of its body.")
        length, rate = (sum(c * self._symbols(name)[k] for name, c in joints) for k in (0, 1))
        return length, rate

    def _pull(self, label: str, joints: Sequence[tuple[str, float]], effort: Any) -> None:
        """Add motors with an effort along Σ coefficient · coordinate."""
        for name, coefficient in joints:
            what = "torque" if self.robot.joints[name].kind == "hinge" else "force"
            self.builder.motor(self.names.free(f"{label}_motor"), self.coordinates[name],
                               **{what: coefficient * effort})

    def _equality(self, equality: MjcfEquality) -> None:
        name = self.names.free(equality.name, "equality")
        if equality.kind == "connect":
            self._connect(name, equality)
        elif equality.kind == "weld":
            self._weld(name, equality)
        else:
            self._law(name, equality)

    def _ends(self, equality: MjcfEquality) -> list[tuple[int, Placement]]:
        """Return the bodies of an equality, and where its sites are in them."""
        if equality.sites:
            return [self.robot.sites[end] for end in equality.ends]
        number = {body.name: k for k, body in enumerate(self.robot.bodies)} | {"world": -1}
        return [(number[end], IDENTITY) for end in (*equality.ends, "world")[:2]]

    def _at_reference(self, body: int) -> Placement:
        return IDENTITY if body < 0 else self.at_reference.bodies[body]

    def _connect(self, name: str, equality: MjcfEquality) -> None:
        (one, site1), (two, site2) = self._ends(equality)
        x1 = x2 = self._at_reference(one).then(site1).x
        if equality.sites:
            x2 = self._at_reference(two).then(site2).x
        else:
            place = self._at_reference(one)
            x1 = x2 = place.x + place.R @ equality.given.vector("anchor")
        a, b = self.robot.limb(one), self.robot.limb(two)
        self.builder.ball(name, self.frames[a], self.frames[b],
                         on_a=self._on(a, self.at_reference, x1),
                         on_b=self._on(b, self.at_reference, x2))

    def _weld(self, name: str, equality: MjcfEquality) -> None:
        (one, site1), (two, site2) = self._ends(equality)
        given = equality.given
        first, second = self._at_reference(one).then(site1), self._at_reference(two).then(site2)
        aimed = second  # where the second is to be while the first is where it is
        pose = given.numbers("relpose", 7, default=[0.0] * 7)
        if equality.sites:
            aimed = first
        elif any(pose[3:]):
            aimed = first.then(Placement(np.array(pose[:3]), rotation(unit(np.array(pose[3:])))))
        a, b = self.robot.limb(one), self.robot.limb(two)
        R_a, R_b = (np.eye(3) if k < 0 else self.at_reference.bodies[k].R for k in (a, b))
        self.builder.fixed(
            name, self.frames[a], self.frames[b],
            on_a=self._on(a, self.at_reference, aimed.x),
            on_b=self._on(b, self.at_reference, second.x),
            rotation=R_a.T @ aimed.R @ second.R.T @ R_b)

    def _law(self, name: str, equality: MjcfEquality) -> None:
        """Add y₁ − y₁(0) = c₀ + c₁ (y₂ − y₂(0)) + …, of joints or tendons."""
        powers = equality.given.numbers("polycoef", 1, 5, [0.0, 1.0, 0.0, 0.0, 0.0])
        sums = [((end, 1.0),) if equality.kind == "joint" else self.robot.tendons[end].joints
                for end in equality.ends]
        for joint, _ in (part for parts in sums for part in parts):
            if joint not in self.coordinates:
                raise equality.given.error(f"is on {shown(joint)}, which has no coordinate here; "
                                           "write armature for each joint of its body.")
        ref = [sum(c * self.robot.joints[joint].ref for joint, c in parts) for parts in sums]
        if equality.kind == "joint" and len(sums) == 2 and not any(powers[2:]):
            c0, c1 = (*powers, 0.0)[:2]
            if c1:
                second, first = (self.coordinates[end] for end in equality.ends)
                self.builder.couple(name, first, second, ratio=c1,
                                   offset=c0 + ref[0] - c1 * ref[1])
                return
        links = [self.coordinates[joint] for parts in sums for joint, _ in parts]

        def law(*coordinates: Any) -> Any:
            rest = iter(coordinates)
            left, *more = (sum(c * next(rest) for _, c in parts) - y0
                           for parts, y0 in zip(sums, ref, strict=True))
            right = sum(c * (more[0] if more else 0) ** k for k, c in enumerate(powers) if c)
            return left - right

        self.builder.law(name, links, law)

    def _compensate_gravity(self) -> None:
        """Add the potential gravcomp m g·x of each body that has it, and of armature a g·x."""
        for k, body in enumerate(self.robot.bodies):
            limb = self.robot.limb(k)
            at = self._inner(k, limb)
            self._lift(f"{body.name}_gravcomp", limb, at.x + at.R @ body.link.centre,
                       body.gravcomp * body.link.mass)
            for joint in body.joints:
                if joint.kind == "free":
                    self._lift(f"{joint.name}_weightless", limb, np.zeros(3), joint.armature)

    def _lift(self, name: str, limb: int, point: Array, mass: float) -> None:
        """Add the potential that cancels the weight of a mass at a point of a body."""
        frame = self.frames[limb]
        if mass and self.robot.gravity.any() and frame is not GROUND:
            weight = self.builder.parameter(self.names.free(name), mass)
            self.builder.potential(weight * dot(
                self.builder.gravity, frame.point((point - self.centres[limb]).tolist())))
