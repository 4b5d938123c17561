"""The tree of a robot to bodies and joints, whichever format its file has.

    hinge, slide          a revolute or prismatic joint, whose coordinate is that of the file
    ball, free            a ball joint; no constraint
    several in one body   a planar, cylindrical, universal or ball joint, else a chain
    armature              a flywheel
    stiffness, damping    a spring and a damper in the joint
    followers             couplings
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp

from ...core.arguments import as_items, as_mapping, as_text, join_or, proposal, shown
from ...core.arrays import Floats
from ...core.errors import InputError
from ...core.inertia import real_array, warn_of_degrees
from ...core.registry import SYSTEMS
from ..multibody.body import GROUND, Body, Frame, dot
from ..multibody.coordinates import Arm, Slide, Translation
from ..multibody.initial_poses import (
    attitude,
    clean,
    finite,
    positive,
    rotation,
    unit,
    vector,
)
from ..multibody.joints import Align, Connection, Joint
from ..multibody.multibody import Multibody
from ..parsing.exact_expressions import parse_number
from ..parsing.grammar import ANGLES, RATES
from ..parsing.reserved_names import KEYWORDS
from .robot_options import SdfOptions
from .robot_tree import (
    IDENTITY,
    Follower,
    Limits,
    LoopJoint,
    Mount,
    Placement,
    Poses,
    Robot,
    RobotJoint,
    body_velocities,
    place_bodies,
)
from .xml_numbers import UNLIMITED

__all__ = ["Close", "Names", "RobotBuilder", "Start", "as_names", "base_pose", "ends_of_ranges",
           "plain_name", "reference_of", "refuse_extras", "start_of", "take_values",
           "with_unit_quaternion"]

#: A function that adds joints to a robot's builder, given name → frame of its links.
Close = Callable[[Multibody, Mapping[str, Mount]], None]
#: Units of coordinates and rates of hinges.
_UNITS = {"angles": ANGLES, "rates": RATES}
#: Axes are perpendicular, or agree, to within this; points in m.
_SAME = 1e-12


# ---------------------------------------------------------------- arguments


def as_names(ignore: Any) -> list[str]:
    """Return the option ``ignore``, one name or several, as a list."""
    return [ignore] if isinstance(ignore, str) else [
        as_text("what to ignore", name)
        for name in as_items("ignore", ignore, "names", is_ordered=False)]


def ends_of_ranges(limits: Any) -> Limits:
    """Return the option ``limits``: a stiffness of the ends of joints' ranges, "stops", or None."""
    if isinstance(limits, str):
        if limits != "stops":
            raise InputError(f"limits = {shown(limits)} is no end of ranges; choose 'stops', or "
                             "a stiffness as a number, such as 1000.0, in N m/rad and N/m.")
        return "stops"
    return None if limits is None else positive(
        "stiffness limits, in N m/rad and N/m,", limits)


def refuse_extras(
    extras: Mapping[str, int], descriptions: Mapping[str, str], ignore: Sequence[str]
) -> None:
    """Refuse parts besides bodies and joints, with their counts, unless ``ignore`` has their names.

    ``extras``: name of a part → number of its elements; ``descriptions``: name → its meaning.
    """
    for name in ignore:
        if name not in (*descriptions, "all"):
            raise InputError(f"ignore names {shown(name)}; choose "
                             f"{join_or([*descriptions, 'all'])}{proposal(name, descriptions)}.")
    if "all" in ignore:
        return
    remaining = {name: extras[name] for name in descriptions if extras[name] and name not in ignore}
    if remaining:
        listing = ", ".join(f"{name} ({descriptions[name]}, {count} of them)"
                            for name, count in remaining.items())
        ignored = [*ignore, *remaining]
        limits_cure = "" if "limits" not in remaining else (
            "to read the ends of hinges and slides, write limits=\"stops\", or a stiffness, "
            "limits=1000.0 (--set limits=stops, limits=1000); ")
        raise InputError(f"it has {listing}, which the model would leave out; {limits_cure}to run "
                         f"without, write ignore={ignored} in Python, --set ignore="
                         f"{','.join(ignored)} after run or build; other commands need a "
                         "file without.")


@dataclass
class Start:
    """Coordinates and rates of joints by name, as in MuJoCo's qpos and qvel."""

    coordinates: dict[str, Floats]
    rates: dict[str, Floats]


def reference_of(robot: Robot) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return coordinates and rates of joints, by name, in the pose of the file at rest."""
    return ({name: robot.reference(joint) for name, joint in robot.joints.items()},
            {name: np.zeros(joint.freedoms) for name, joint in robot.joints.items()})


def base_pose(options: SdfOptions) -> Placement:
    """Return the pose of the base in space by the options ``position`` and ``quaternion``."""
    return Placement(vector("position", options.get("position", np.zeros(3))),
                     rotation(attitude("the base", options.get("quaternion"), matrix=None)))


def start_of(robot: Robot, options: SdfOptions) -> Start:
    """Return the coordinates and rates that the file and the options set, checked."""
    start = Start(*reference_of(robot))
    take_values(robot, start, options.get("angles"), options.get("rates"))
    set_base_motion(robot, start, options.get("velocity"), options.get("angular_velocity"))
    return start


def take_values(robot: Robot, start: Start, angles: Any, rates: Any) -> None:
    """Set the coordinates and rates of ``start`` by the options ``angles`` and ``rates``.

    Joints that follow others follow the new values. Raises InputError for names of no joint, for
    followers, and for values that a joint cannot have.
    """
    follower_of = {follower.name: follower for follower in robot.followers}
    joint_names = [name for name in robot.joints if name]
    for key, argument, values in (
            ("angles", angles, start.coordinates), ("rates", rates, start.rates)):
        entries = as_mapping(key, {} if argument is None else argument, "{'elbow': 0.5}")
        for name, value in entries.items():
            if name not in joint_names:
                raise InputError(f"{key} names {shown(name)}, which is no joint that moves; "
                                 f"choose {join_or(joint_names or ['none'])}"
                                 f"{proposal(name, joint_names)}.")
            if name in follower_of:
                raise InputError(f"{key} names {shown(name)}, which follows "
                                 f"{shown(follower_of[name].leader)}; set that one.")
            values[name] = _joint_values(key, robot.joints[name], value)
        # offsets belong to angles alone: rates follow by the ratio
        for name in follower_of:
            values[name] = _evaluate_follower(follower_of, name, values, is_angle=key == "angles")


def _evaluate_follower(
    follower_of: Mapping[str, Follower], name: str, values: Mapping[str, Floats], is_angle: bool
) -> Floats:
    """Return the coordinate or rate of a joint; of one that follows, ratio · leader + offset.

    ``follower_of``: name of a joint that follows → its law; ``values``: name of a joint → its
    coordinates, or its rates, shape (numbers,). Rates (``is_angle`` false) have no offset.
    """
    if name not in follower_of:
        return values[name]
    follower = follower_of[name]
    leader = _evaluate_follower(follower_of, follower.leader, values, is_angle)
    value: Floats = follower.ratio * leader + (follower.offset if is_angle else 0.0)
    return value


def _joint_values(key: str, joint: RobotJoint, entry: Any) -> Floats:
    """Return the value of the option ``key`` for a joint, shape (numbers of qpos or qvel,)."""
    if joint.kind in ("hinge", "slide"):
        return np.array([_coordinate_value(
            key, joint.name, is_angle=joint.kind == "hinge", entry=entry)])
    count = joint.count if key == "angles" else joint.freedoms
    values = real_array(entry)
    if values is None or values.shape != (count,) or not np.isfinite(values).all():
        raise InputError(f"The {key[:-1]} of {joint.name!r} is {shown(entry)}; a {joint.kind} "
                         f"joint has {count} finite numbers, as "
                         f"{'qpos' if key == 'angles' else 'qvel'} has.")
    return with_unit_quaternion(joint, values) if key == "angles" else values


def with_unit_quaternion(joint: RobotJoint, values: Floats) -> Floats:
    """Return coordinates of a ball or free joint with a unit quaternion, their last four numbers.
    """
    if not values[-4:].any():
        raise InputError(f"The quaternion of {joint.name!r} is zero; give its direction.")
    return np.concatenate([values[:-4], unit(values[-4:])])


def _coordinate_value(key: str, name: str, is_angle: bool, entry: Any) -> float:
    """Return a coordinate or rate, given as a number or as a text such as "45 deg".

    ``key`` is "angles" or "rates"; ``is_angle`` allows units of angles. Warns of angles that look
    like degrees.
    """
    about = f"{key[:-1]} of {name!r}"
    if isinstance(entry, str):
        try:
            units = _UNITS[key] if is_angle else {}
            return float(finite(about, parse_number(entry, units), shape=()))
        except InputError as error:
            raise InputError(f"The {about} is {shown(entry)}: {error}") from None
    number = float(finite(about, entry, shape=()))
    if is_angle and key == "angles":
        warn_of_degrees(f"The {about}", [number], cure=(
            f'"{number:.6g} deg"; "{number:.6g} rad" says that radians are'))
    return number


def set_base_motion(robot: Robot, start: Start, velocity: Any, angular_velocity: Any) -> None:
    """Set the rates of the floating body by the options ``velocity`` and ``angular_velocity``.

    The velocity of the centre of mass is in space axes, the angular velocity in body axes.
    Raises InputError unless one body floats.
    """
    if velocity is None and angular_velocity is None:
        return
    floating = [joint for joint in robot.joints.values() if joint.kind == "free"]
    if len(floating) != 1:
        raise InputError("velocity and angular_velocity are those of one floating body, and there "
                         f"{'are several' if floating else 'is none'}; leave them out.")
    v, w = (np.zeros(3) if argument is None else vector(name, argument) for name, argument in (
        ("velocity", velocity), ("angular_velocity", angular_velocity)))
    limb = floating[0].body
    R = place_bodies(robot, start.coordinates).bodies[limb].R
    # the rates of a free joint have the velocity of the origin: v − R (Ω × centre)
    centre = robot.mass_of(limb).centre
    start.rates[floating[0].name] = np.concatenate([v - R @ np.cross(w, centre), w])


# ---------------------------------------------------------------- building


class RobotBuilder:
    """Builder of the bodies, joints, springs and couplings of a robot.

    A *limb* is a body of the file with joints, together with all bodies that are fixed to it.

    Attributes
    ----------
    builder : Multibody
        The model's builder, to which all is added.
    frames, centres : dict
        Number of a limb → its frame, and its centre of mass in its axes; −1 is the ground.
    coordinates : dict
        Name of a joint → the connection whose angle or travel is the joint's coordinate.
    cylindrical : dict
        Name of a hinge with a slide along its axis → the cylindrical joint that has its angle, and
        whose coordinate, for couplings, is the travel.
    names, joint_names, parameter_names : Names
        Names of the model's bodies, joints and parameters, which must differ.
    joint_name : dict
        Name of a joint in the file → its name in the model.
    """

    def __init__(self, robot: Robot, start: Start, rep: Any) -> None:
        """Place the bodies of a robot at the coordinates of ``start``, and name its joints."""
        self.robot, self.start, self.rep = robot, start, rep
        self.poses = place_bodies(robot, start.coordinates)
        # a file of robots has a time step at most, and no length of a run
        self.builder = Multibody(
            _system_name(robot.name), gravity=robot.gravity, dt=robot.dt,
            steps=None if robot.dt is None else 1000,
            description=f"The robot {robot.name}, of {robot.format} file.")
        # joints count from the angles that are given, and move no body to them
        self.builder._describes_start = True
        self.names, self.joint_names, self.parameter_names = Names(), Names(), Names()
        self.joint_name = {name: self.joint_names.free(name) for name in robot.joints if name}
        self.frames: dict[int, Frame] = {-1: self.builder.ground}
        self.centres: dict[int, Floats] = {-1: np.zeros(3)}
        self.coordinates: dict[str, Connection] = {}
        self.cylindrical: dict[str, Connection] = {}

    def build(self) -> Multibody:
        """Return a ``Multibody`` with the bodies, joints, springs and quantities of the robot.

        Raises InputError if nothing moves, if a limb has no mass, and for joints that no model here
        has.
        """
        robot = self.robot
        limbs = [k for k, body in enumerate(robot.bodies) if body.joints]
        if not limbs:
            raise InputError(f"no {robot.part} of it has a joint, so that nothing moves; give it a "
                             "joint, or a floating base.")
        velocities = body_velocities(robot, self.poses, self.start.rates)
        # all bodies before all joints: a joint names two of them
        for limb in limbs:
            self._add_body(limb, velocities[limb])
        for limb in limbs:
            self._join_and_name(limb)
        for joint in robot.joints.values():
            self._add_quantities(joint)
            self._add_springs(joint)
        for follower in robot.followers:
            self.builder.couple(
                self.joint_names.free(f"{follower.name}_mimic"), self.coordinates[follower.leader],
                self.coordinates[follower.name], ratio=follower.ratio, offset=follower.offset)
        self._add_more()
        self._compensate_gravity()
        mounts = self.mounts()
        for loop in robot.loops:
            name = self.joint_names.free(loop.name, "loop")
            self._add_loop_springs(loop, loop.close(self.builder, name, mounts))
        # bodies of the file are where they start; those that a user adds are moved there by the
        # angles of their joints, as in any Multibody
        self.builder._describes_start = False
        return self.builder

    def _add_more(self) -> None:
        """Add the elements that a single format has, in its subclass."""

    def mounts(self) -> dict[str, Mount]:
        """Return name → frame of each body of the file, in its limb and in space."""
        return {body.name: self._mount(k, IDENTITY) for k, body in enumerate(self.robot.bodies)}

    def _mount(self, body: int, placement: Placement) -> Mount:
        """Return a frame at ``placement`` in a body, −1 for the ground: in its limb, and in space.
        """
        limb, inner = self.robot.limb(body), self.robot.inner(body).then(placement)
        space = placement if body < 0 else self.poses.bodies[body].then(placement)
        return Mount(self.frames[limb], Placement(inner.x - self.centres[limb], inner.R), space)

    # ------------------------------------------------------------ bodies

    def _add_body(self, limb: int, motion: tuple[Floats, Floats]) -> None:
        """Add the body of a limb with its pose and velocity at the start.

        ``motion`` is the velocity of the limb's origin, m/s, and its angular velocity, rad/s, both
        in space and of shape (3,).
        """
        mass, centre, inertia = self.robot.mass_of(limb)
        pose, (v, w) = self.poses.bodies[limb], motion
        self.centres[limb] = centre
        self.frames[limb] = self.builder.body(
            self._body_name(limb), mass=mass, inertia=inertia, rep=self.rep,
            position=pose.x + pose.R @ centre, rotation=pose.R,
            velocity=v + np.cross(w, pose.R @ centre), angular_velocity=pose.R.T @ w)

    def _body_name(self, limb: int) -> str:
        """Return a free name for a limb's body.

        A joint on the ground has parameters that begin with its name: NAME_x would be a coordinate
        of a body with the same name, which is called NAME_body.
        """
        robot, name = self.robot, plain_name(self.robot.bodies[limb].name)
        on_ground = {self.joint_name[joint.name] for k, body in enumerate(robot.bodies)
                     if robot.limb(body.above) < 0 and k != limb
                     for joint in body.joints if joint.name}
        return self.names.free(f"{name}_body" if name in on_ground else name)

    def _on(self, limb: int, poses: Poses, point: Floats) -> Floats:
        """Return a point, given in space at some poses, in the axes of a limb, from its centre."""
        if limb < 0:
            return point
        pose = poses.bodies[limb]
        inner: Floats = pose.R.T @ (point - pose.x) - self.centres[limb]
        return inner

    # ------------------------------------------------------------ joints

    def _join_and_name(self, limb: int) -> None:
        """Connect a limb to its parent; names of joints without a connection become aliases.

        An alias shares the connection that several joints of the file have in common.
        """
        components = self.builder._components
        count = len(components.connections)
        self._join(limb)
        # the first new one with a point and axes: a Slide is a coordinate without constraints
        connection = next((link for link in components.connections[count:]
                           if isinstance(link, Joint) and not isinstance(link, Slide)), None)
        if connection is not None:
            names = [self.joint_name[joint.name] for joint in self.robot.bodies[limb].joints]
            components.aliases |= {name: connection for name in names if name != connection.name}

    def _join(self, limb: int) -> None:
        """Connect a limb to its parent by the joints of the file.

        A free joint, or three independent slides of the ground and a ball, need no constraint. One
        joint is one of the builder's; several with armatures are a chain of coordinates; other
        combinations have a joint of their own (``_add_combined_joint``), or are refused.
        """
        robot = self.robot
        joints, parent = robot.bodies[limb].joints, robot.limb(robot.bodies[limb].above)
        kinds = [joint.kind for joint in joints]
        frames = self.frames[parent], self.frames[limb]
        axes = [self.poses.axes[joint.name] for joint in joints]
        points = [self.poses.points[joint.name] for joint in joints]
        # a body has six coordinates anyway: nothing to constrain
        if kinds == ["free"] or (kinds == ["slide"] * 3 + ["ball"] and parent < 0
                                 and abs(np.linalg.det(axes[:3])) > _SAME):
            return
        if len(joints) == 1:
            self._add_single_joint(joints[0], frames, axes[0], points[0])
        # coordinates with inertias of their own need no bodies between the joints
        elif all(joint.armature for joint in joints) and set(kinds) <= {"hinge", "slide"}:
            self._add_chain(limb, frames, axes, points)
        elif not self._add_combined_joint(limb, frames, axes, points):
            raise InputError(
                f"{robot.part} {shown(robot.bodies[limb].name)} has the joints {', '.join(kinds)} "
                "in a row, and not each has an inertia; write armature=\"…\" above 0 for each, or "
                f"a {robot.part} with mass between them.")

    def _add_single_joint(
        self, joint: RobotJoint, frames: tuple[Frame, Frame], axis: Floats, point: Floats
    ) -> None:
        """Add a ball, hinge or slide between two frames at a point, about or along an axis."""
        build, name = self.builder, self.joint_name[joint.name]
        coordinate = float(self.start.coordinates[joint.name][0])
        if joint.kind == "ball":
            ball = build.ball(name, *frames, at=point)
            if joint.armature:
                build.flywheel(self.joint_names.free(f"{joint.name}_rotor"), ball,
                               inertia=joint.armature)
            return
        line: dict[str, Any] = {"at": point, "axis_in_space": axis}
        self._set_coordinate(
            joint, build.revolute(name, *frames, **line, angle=coordinate)
            if joint.kind == "hinge" else
            build.prismatic(name, *frames, **line, travel=coordinate))

    def _set_coordinate(self, joint: RobotJoint, link: Connection) -> None:
        """Store the connection with the coordinate of a joint: ``link``, or a flywheel on it.

        A joint with armature has the flywheel, whose angle counts full turns.
        """
        if joint.armature:
            link = self.builder.flywheel(self.joint_names.free(f"{joint.name}_rotor"), link,
                                         inertia=joint.armature)
        self.coordinates[joint.name] = link

    def _add_chain(
        self, limb: int, frames: tuple[Frame, Frame], axes: Sequence[Floats],
        points: Sequence[Floats],
    ) -> None:
        """Add the joints of a limb as a chain of coordinates, with a flywheel for each armature.

        The arguments are as of ``_add_combined_joint``.
        """
        joints, build = self.robot.bodies[limb].joints, self.builder
        rows = []
        for joint, axis, point in zip(joints, axes, points, strict=True):
            coordinate, rate = ("angle", "rate") if joint.kind == "hinge" else ("travel", "speed")
            rows.append({
                "name": self.joint_name[joint.name], "axis": axis, "at": point,
                "inertia": joint.armature,
                coordinate: float(self.start.coordinates[joint.name][0]),
                rate: float(self.start.rates[joint.name][0])})
        name = self.joint_names.free(f"{self.robot.bodies[limb].name}_joints")
        chain = build.chain(name, *frames, rows)
        for joint, link in zip(joints, chain.links, strict=True):
            self.coordinates[joint.name] = link.coordinate

    def _add_combined_joint(
        self, limb: int, frames: tuple[Frame, Frame], axes: Sequence[Floats],
        points: Sequence[Floats],
    ) -> bool:
        """Add several joints of a limb as one joint of the builder; return whether there is one.

        ``frames`` are the parent and the limb; ``axes`` and ``points`` have a unit vector and a
        point in space, (3,), for each joint.

            two or three slides of the ground               constraints of attitude and position
            two slides of the ground and a hinge            planar joint
            hinge and slide along one axis                  cylindrical joint
            two hinges at right angles whose axes meet      universal joint
            three hinges through one point                  ball joint
        """
        joints, build = self.robot.bodies[limb].joints, self.builder
        kinds = [joint.kind for joint in joints]
        coordinates = [float(self.start.coordinates[joint.name][0]) for joint in joints]
        # the number of joints before the first hinge
        slide_count = kinds.index("hinge") if "hinge" in kinds else len(kinds)
        has_armature = any(joint.armature for joint in joints)
        name = self.joint_name[joints[-1].name]
        if (set(kinds[:slide_count]) == {"slide"} and frames[0] is GROUND and len(kinds) <= 3
                and len(kinds) - slide_count <= 1
                and self._add_slides(name, limb, frames, axes, points)):
            return True
        if kinds in (["hinge", "slide"], ["slide", "hinge"]) and axes[0] @ axes[1] > 1 - _SAME:
            hinge, slide = kinds.index("hinge"), kinds.index("slide")
            link = build.cylindrical(name, *frames, axis_in_space=axes[hinge], at=points[hinge],
                                     angle=coordinates[hinge], travel=coordinates[slide])
            self.coordinates[joints[slide].name] = self.cylindrical[joints[hinge].name] = link
            # with an armature, for which it has no flywheel, the caller refuses the file
            return not has_armature
        if kinds == ["hinge"] * 2 and abs(axes[0] @ axes[1]) < _SAME and not has_armature:
            return self._add_universal(name, limb, frames, axes, points)
        if kinds == ["hinge"] * 3 and not has_armature and all(
                np.allclose(points[0], point, rtol=0, atol=_SAME) for point in points):
            build.ball(name, *frames, at=points[0])
            return True
        return False

    def _add_slides(
        self, name: str, limb: int, frames: tuple[Frame, Frame], axes: Sequence[Floats],
        points: Sequence[Floats]
    ) -> bool:
        """Add two or three slides of the ground; the last may be a hinge normal to them.

        ``axes`` and ``points`` have a unit vector and a point in space, (3,), for each joint of the
        limb. A travel s_i of d = Σ s_i e_i is measured along the dual direction of e_i. Returns
        False, and adds nothing, if the directions e_i are dependent, or the hinge is not normal to
        them.
        """
        joints, build = self.robot.bodies[limb].joints, self.builder
        has_hinge = joints[-1].kind == "hinge"
        directions = np.array(axes[:-1] if has_hinge else axes)
        point = points[-1]
        if len(directions) < 2 or np.linalg.svd(directions)[1][-1] < _SAME:
            return False
        normal = unit(np.cross(directions[0], directions[1])) if len(directions) == 2 else None
        if has_hinge:
            if normal is None or abs(normal @ axes[-1]) < 1 - _SAME:
                return False
            angle = float(self.start.coordinates[joints[-1].name][0])
            self._set_coordinate(joints[-1], build.planar(
                name, *frames, axis_in_space=axes[-1], at=point, angle=angle))
        else:
            build._join(Translation(name, *frames, at=point, normal=normal))
        # d = Σ s_i e_i has s_i = d · dual_i
        duals = np.linalg.pinv(directions).T
        # a hinge, which is the last joint, has no direction of travel
        for joint, dual in zip(joints, duals, strict=False):
            label = self.joint_names.free(f"{joint.name}_slide")
            self._set_coordinate(joint, build._join(Slide(
                label, *frames, at=point, hinge=Align(label, *frames, unit(dual)),
                scale=float(np.linalg.norm(dual)),
                travel=float(self.start.coordinates[joint.name][0]))))
        return True

    def _add_universal(
        self, name: str, limb: int, frames: tuple[Frame, Frame], axes: Sequence[Floats],
        points: Sequence[Floats]
    ) -> bool:
        """Add two hinges at right angles as a universal joint, with the angles about both arms.

        ``axes`` and ``points`` have a unit vector and a point in space, (3,), for each hinge.
        Returns False, and adds nothing, if the axes do not meet.
        """
        joints, build = self.robot.bodies[limb].joints, self.builder
        offset = points[1] - points[0]
        # the distance of the axes
        if abs(np.cross(axes[0], axes[1]) @ offset) > _SAME:
            return False
        # the point of the first axis next to the second's point, for axes at right angles
        point = points[0] + (axes[0] @ offset) * axes[0]
        build.universal(name, *frames, axis_a=axes[0], axis_b=axes[1], at=point)
        for k, joint in enumerate(joints):
            self.coordinates[joint.name] = build._join(Arm(
                self.joint_names.free(f"{joint.name}_arm"), *frames, arms=(axes[0], axes[1]), own=k,
                angle=float(self.start.coordinates[joint.name][0])))
        return True

    @property
    def _measured(self) -> dict[str, Connection]:
        """Name of each joint with an angle or a travel → the connection that measures it."""
        return self.coordinates | self.cylindrical

    def _symbols(self, joint: str) -> tuple[Any, Any]:
        """Return the symbols of the coordinate and of the rate of a joint."""
        link = self._measured[joint]
        if self.robot.joints[joint].kind == "hinge":
            return self.builder.angle(link), self.builder.rate(link)
        return self.builder.travel(link), self.builder.speed(link)

    def _add_quantities(self, joint: RobotJoint) -> None:
        """Add angle and rate, or travel and speed, of a joint as quantities of the model."""
        if joint.name in self._measured:
            names = ("angle", "rate") if joint.kind == "hinge" else ("travel", "speed")
            for measure, symbol in zip(names, self._symbols(joint.name), strict=True):
                self.builder.quantity(f"{self.joint_name[joint.name]}_{measure}", symbol)

    def _add_springs(self, joint: RobotJoint) -> None:
        """Add spring, damper and limits of a joint; refuse those of a joint without a coordinate.

        Limits are stops, or springs beyond the range, as the option ``limits`` says.
        """
        build = self.builder
        # the range of a ball joint is counted among the parts that no model here has
        bounds = None if self.robot.limits is None or joint.kind == "ball" else joint.range
        if joint.name in self._measured:
            link = self._measured[joint.name]
            coordinate: Any = "angle" if joint.name in self.cylindrical else None
            if joint.stiffness or joint.damping:
                build.joint_spring(
                    self.joint_names.free(f"{joint.name}_spring"), link, coordinate=coordinate,
                    stiffness=joint.stiffness, damping=joint.damping, rest=joint.rest)
            if bounds is not None:
                self._add_limits(joint.name, link, bounds, coordinate)
            return
        # Of joints without a coordinate, a ball may have a damper, and a ball or a free joint that
        # is the only one of its body an armature; anything else is refused.
        is_single = (joint.kind in ("ball", "free")
                     and len(self.robot.bodies[joint.body].joints) == 1)
        elements = " and ".join(
            [key for key in ("stiffness", "damping", "armature")
             if getattr(joint, key) and not (is_single and key == "armature")]
            + ["range"] * (bounds is not None))
        if joint.kind == "ball" and elements == "damping":
            self._add_ball_damper(joint)
        elif elements:
            row = "" if joint.kind in ("ball", "free") else " in a row without armature"
            raise InputError(f"joint {shown(joint.name)} has {elements}, which a {joint.kind} joint"
                             f"{row} has not here; write 0, or armature for each joint of its "
                             f"{self.robot.part}.")

    def _add_loop_springs(self, loop: LoopJoint, connection: Connection) -> None:
        """Add spring, damper and limits of a joint that closes a loop."""
        if loop.damping or loop.stiffness:
            self.builder.joint_spring(
                self.joint_names.free(f"{connection.name}_spring"), connection,
                damping=loop.damping, stiffness=loop.stiffness, rest=loop.rest)
        if self.robot.limits is not None and loop.range is not None:
            self._add_limits(connection.name, connection, loop.range)

    def _add_limits(
        self, name: str, connection: Connection, bounds: tuple[float, float],
        coordinate: Any = None,
    ) -> None:
        """Add the ends of the range of a coordinate, ``bounds``: stops, or springs beyond them."""
        build, limits, (lower, upper) = self.builder, self.robot.limits, bounds
        label = self.joint_names.free(f"{name}_limits")
        if limits == "stops":
            build.stop(label, connection, restitution=self.restitution, coordinate=coordinate,
                       lower=None if lower <= -UNLIMITED else lower,
                       upper=None if upper >= UNLIMITED else upper)
        else:
            build.joint_spring(label, connection, stiffness=limits or 0.0, rest=bounds,
                               coordinate=coordinate)

    @cached_property
    def restitution(self) -> sp.Symbol:
        """The parameter of all stops at ends of ranges."""
        return self.builder.parameter(self.parameter_names.free("restitution"), 1.0)

    def _add_ball_damper(self, joint: RobotJoint) -> None:
        """Add the torque −c (ω_b − ω_a) of a ball joint on the limb b, and its opposite on a.

        ω is in space; torques are in the axes of the body on which they act.
        """
        limb = joint.body
        a, b = self.frames[self.robot.limb(self.robot.bodies[limb].above)], self.frames[limb]
        c = self.builder.parameter(
            self.parameter_names.free(f"{joint.name}_damping"), joint.damping)
        relative = [y - x for x, y in zip(a.direction(a.angular_velocity),
                                          b.direction(b.angular_velocity), strict=True)]
        for frame, sign in ((b, -1), (a, 1)):
            if isinstance(frame, Body):
                self.builder.torque(frame, [sign * c * dot(frame.rotation.col(k), relative)
                                            for k in range(3)])

    def _compensate_gravity(self) -> None:
        """Add potentials that cancel weights: gravcomp · m g·x, and a g·x of free joints' armature.

        The armature of a free joint counts as mass, and MuJoCo gives it no weight.
        """
        for k, body in enumerate(self.robot.bodies):
            placement = self.robot.inner(k)
            self._add_lift(f"{body.name}_gravcomp", k, placement.x + placement.R @ body.link.centre,
                       body.gravcomp * body.link.mass)
            for joint in body.joints:
                if joint.kind == "free":
                    self._add_lift(f"{joint.name}_weightless", k, np.zeros(3), joint.armature)

    def _add_lift(self, name: str, body: int, point: Floats, mass: float) -> None:
        """Add m g·x, which cancels the weight of a mass m at a point of a body of the file.

        ``name`` is the name of the parameter m.
        """
        limb = self.robot.limb(body)
        frame = self.frames[limb]
        if mass and self.robot.gravity.any() and frame is not GROUND:
            weight = self.builder.parameter(self.parameter_names.free(name), mass)
            self.builder.potential(weight * dot(
                self.builder.gravity, frame.point(clean(point - self.centres[limb]).tolist())))


class Names:
    """Distinct C identifiers for names with any characters."""

    def __init__(self) -> None:
        """Begin with the names that every builder uses itself."""
        self._taken = {"ground", "gravity"}

    def free(self, name: str, kind: str = "") -> str:
        """Return an identifier for a name, with "_" for other characters than C allows.

        An identifier in use gets the suffix ``kind``, or a number.
        """
        identifier = plain_name(name)
        unique_name, count = identifier, 1
        while unique_name in self._taken:
            unique_name = f"{identifier}_{kind}" if kind and count == 1 else f"{identifier}_{count}"
            count += 1
        self._taken.add(unique_name)
        return unique_name


def plain_name(name: str) -> str:
    """Return a name with "_" for all characters but ASCII letters and digits, a letter first."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII).strip("_") or "part"
    return plain if plain[0].isalpha() else f"n{plain}"


def _system_name(name: str) -> str:
    """Return a robot's name as a system's: lower case, 40 characters, no keyword, no built-in."""
    plain = plain_name(name.lower())[:40].rstrip("_")
    # with "_robot", 40 characters again
    return f"{plain[:34]}_robot" if plain in KEYWORDS or plain in SYSTEMS else plain
