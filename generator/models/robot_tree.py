"""The tree of a robot, whichever format its file has.

A body is placed in its parent, the body above it, and its joints move it from there, one after the
other: no joint if it moves with the parent, one in URDF and SDF, several in MJCF. A joint has its
axis and its point in the axes of its body. Coordinates and rates are as in MuJoCo's qpos and qvel:

    hinge, slide   an angle or a travel, and its rate
    ball           a quaternion, and an angular velocity in the axes of the body
    free           position and quaternion, velocity in space and angular velocity in the body
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from ...core.arguments import proposal, shown
from ...core.arrays import Floats
from ...core.errors import InputError
from ...core.inertia import quaternion_of_matrix
from ..multibody.body import Frame
from ..multibody.initial_poses import clean, rotation
from ..multibody.joints import Joint
from ..multibody.multibody import Multibody

__all__ = ["IDENTITY", "Edge", "Follower", "Limits", "LoopJoint", "Mount", "Placement", "Poses",
           "Robot", "RobotBody", "RobotJoint", "RobotLink", "body_velocities", "check_followers",
           "combine", "free_base", "grow_tree", "place_bodies", "root_of", "turn"]

#: Ends of ranges: springs with a stiffness, stops, or refused (None).
Limits: TypeAlias = float | Literal["stops"] | None


@dataclass(frozen=True, eq=False)
class Placement:
    """Placement of a frame in another one: its origin x, and R from its axes to the other's."""

    x: Floats
    R: Floats

    def then(self, inner: Placement) -> Placement:
        """Return the placement, in the other frame, of a frame that is at ``inner`` in this one."""
        return Placement(self.x + self.R @ inner.x, self.R @ inner.R)

    def inverse(self) -> Placement:
        """Return the placement of the other frame in this one: −Rᵀx and Rᵀ."""
        return Placement(-self.R.T @ self.x, self.R.T)


#: How far the bodies of a joint that closes a loop may start turned, in rad: rounding of a file.
_TURNED = 1e-3
#: The frame itself.
IDENTITY = Placement(np.zeros(3), np.eye(3))


@dataclass(frozen=True, eq=False)
class RobotLink:
    """Mass, centre of mass and inertia about it, in the axes of the link of this name."""

    name: str
    mass: float
    centre: Floats
    inertia: Floats


@dataclass(eq=False)
class RobotJoint:
    """A joint: axis and point in the axes of its body, ``ref`` its coordinate in the file's pose.

    ``body`` is the number of its body; ``armature`` is the inertia of a rotor; ``rest`` is the
    coordinate at which the spring is without force.
    """

    name: str
    kind: str  # "hinge", "slide", "ball" or "free"
    body: int
    axis: Floats
    point: Floats
    ref: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    armature: float = 0.0
    range: tuple[float, float] | None = None

    @property
    def count(self) -> int:
        """The number of coordinates, as in MuJoCo's qpos."""
        return {"free": 7, "ball": 4}.get(self.kind, 1)

    @property
    def freedoms(self) -> int:
        """The number of rates, as in MuJoCo's qvel."""
        return {"free": 6, "ball": 3}.get(self.kind, 1)


@dataclass(eq=False)
class RobotBody:
    """A body, placed at ``place`` in the body with the number ``above``, −1 for space.

    ``gravcomp`` is the share of its weight that is compensated.
    """

    name: str
    above: int
    place: Placement
    link: RobotLink
    gravcomp: float = 0.0
    joints: list[RobotJoint] = field(default_factory=list)


@dataclass(frozen=True)
class Follower:
    """A joint whose coordinate is ratio · c + offset, with the coordinate c of another joint."""

    name: str
    leader: str
    ratio: float
    offset: float


@dataclass(frozen=True, eq=False)
class Mount:
    """A link of a file as part of a body of the model, which may have several links.

    Attributes
    ----------
    frame : Frame
        The body.
    inner : Placement
        Pose of the link frame in the body's axes, from its centre of mass.
    space : Placement
        Pose of the link frame in space.
    """

    frame: Frame
    inner: Placement
    space: Placement


@dataclass(frozen=True, eq=False)
class LoopJoint:
    """Joint of a kinematic loop: its placement in both bodies, its axis in its own axes.

    ``across`` is the second axis of a universal joint, in the axes of the joint on the second body.
    ``has_axes_on_b``: the axes of the joint on both bodies agree where angle and travel are 0; else
    these are 0 at the start.
    """

    name: str
    kind: str
    bodies: tuple[str, str]
    places: tuple[Placement, Placement]
    axis: Floats
    across: Floats | None = None
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    range: tuple[float, float] | None = None
    has_axes_on_b: bool = False

    def close(self, builder: Multibody, name: str, mounts: Mapping[str, Mount]) -> Joint:
        """Add the joint and return it: points in the axes of its bodies, axes in space.

        ``mounts`` has the place of each body of the file in its body of the model.
        """
        a, b = (mounts[body] for body in self.bodies)
        inner_a, inner_b = (mount.inner.then(placement)
                            for mount, placement in zip((a, b), self.places, strict=True))
        frames: dict[str, Any] = {"a": a.frame, "b": b.frame, "on_a": inner_a.x, "on_b": inner_b.x}
        # the axis is given in the axes of the joint on a
        axis = a.space.R @ self.places[0].R @ self.axis
        if self.kind == "ball":
            return builder.ball(name, **frames)
        if self.kind == "fixed":
            return builder.fixed(name, **frames, rotation=inner_a.R @ inner_b.R.T)
        if self.kind == "universal":
            across = b.space.R @ self.places[1].R @ np.asarray(self.across)
            return builder.universal(name, **frames, axis_a=axis, axis_b=across)
        angle, travel = self._coordinates(a.space, b.space) if self.has_axes_on_b else (0.0, 0.0)
        if self.kind == "prismatic":
            return builder.prismatic(name, **frames, axis_in_space=axis, travel=travel)
        return builder.revolute(name, **frames, axis_in_space=axis, angle=angle)

    def _coordinates(self, a: Placement, b: Placement) -> tuple[float, float]:
        """Return the angle in rad and the travel in m, with the bodies at ``a`` and ``b``.

        These are places in space. A hinge has no use for the travel; the angle of a slide is 0.
        Raises InputError where the bodies are turned against each other by more than ``_TURNED``
        beside the joint's own rotation.
        """
        joint_on_a, joint_on_b = (body.then(placement) for body, placement in zip(
            (a, b), self.places, strict=True))
        R = joint_on_a.R.T @ joint_on_b.R
        w, *v = quaternion_of_matrix(R)
        angle = 0.0 if self.kind == "prismatic" else math.remainder(
            2 * math.atan2(float(self.axis @ v), w), 2 * math.pi)
        # |R − R'| = 2 √2 sin(θ/2) for the angle θ between R and the turn R' that the joint allows
        half_sine = float(np.linalg.norm(R - turn(self.axis, angle))) / (2 * math.sqrt(2))
        excess = 2 * math.asin(min(half_sine, 1.0))
        if excess > _TURNED:
            raise InputError(f"joint {shown(self.name)} closes a loop, and its bodies "
                             f"{shown(self.bodies[0])} and {shown(self.bodies[1])} start turned "
                             f"by {math.degrees(excess):.3g} degrees from where it holds them; "
                             "give angles of all joints at which the loop is closed.")
        return angle, float(joint_on_a.R @ self.axis @ (joint_on_b.x - joint_on_a.x))


@dataclass(eq=False)
class Robot:
    """Bodies of a robot, each after its parent, with joints, followers, loops and actuators.

    Attributes
    ----------
    format, part : str
        The format of the file with its article, and its word for a body.
    joints : dict
        The joints by name, in the order of the file.
    limits : float, "stops" or None
        Stiffness of the ends of ranges, or whether they are stops.
    """

    name: str
    format: str
    part: str
    bodies: list[RobotBody] = field(default_factory=list)
    joints: dict[str, RobotJoint] = field(default_factory=dict)
    followers: list[Follower] = field(default_factory=list)
    loops: list[LoopJoint] = field(default_factory=list)
    gravity: Floats = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    dt: float | None = None
    limits: Limits = None

    def limb(self, body: int) -> int:
        """Return the body with joints that a body moves with: itself, or the nearest one above.

        −1 if there is none: the body is fixed to the ground.
        """
        while body >= 0 and not self.bodies[body].joints:
            body = self.bodies[body].above
        return body

    def inner(self, body: int) -> Placement:
        """Return the placement of a body in the frame of the limb that it moves with."""
        placement, limb = IDENTITY, self.limb(body)
        while body != limb:
            placement = self.bodies[body].place.then(placement)
            body = self.bodies[body].above
        return placement

    def mass_of(self, limb: int) -> MassProperties:
        """Return the mass, the centre of mass and the inertia of a limb, in the limb's axes.

        All bodies that move with the limb belong to it. Raises InputError unless there is mass.
        """
        parts = [(self.inner(k), body.link) for k, body in enumerate(self.bodies)
                 if self.limb(k) == limb]
        moving = self.bodies[limb]
        rotor = moving.joints[0].armature if moving.joints[0].kind == "free" else 0.0
        # armature of a free joint: ½ a (|v|² + |ω|²), with v of the origin of the body's axes
        if rotor:
            parts.append((IDENTITY, RobotLink(moving.name, rotor, np.zeros(3), rotor * np.eye(3))))
        if sum(link.mass for _, link in parts) <= 0:
            raise InputError(f"{self.part} {shown(moving.name)} moves and has no mass, nor has "
                             "what is fixed to it; give it an <inertial> with mass and inertia, or "
                             "make its joint fixed.")
        mass, centre, inertia = combine(parts)
        # products of inertia of round-off would turn three moments into a tensor, which costs more
        return MassProperties(mass, centre, clean(inertia))

    def reference(self, joint: RobotJoint) -> Floats:
        """Return the coordinates of a joint in the file's pose, shape (``joint.count``,)."""
        if joint.kind == "ball":
            return np.array([1.0, 0, 0, 0])
        if joint.kind == "free":
            placement = self.bodies[joint.body].place
            return np.concatenate([placement.x,
                np.array(quaternion_of_matrix(placement.R, "attitude"))])
        return np.array([joint.ref])


def turn(axis: Floats, angle: float) -> Floats:
    """Return the rotation about a unit axis e: R = 1 + sin φ K + (1 − cos φ) K², K v = e × v."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    # 1 − cos φ = 2 sin²(φ/2), whose digits do not cancel for small angles
    R: Floats = np.eye(3) + math.sin(angle) * K + 2 * math.sin(angle / 2) ** 2 * K @ K
    return R


class MassProperties(NamedTuple):
    """Mass, centre of mass and inertia of a rigid assembly, in common axes."""

    mass: float  # kg
    centre: Floats  # centre of mass, shape (3,), m
    inertia: Floats  # about the centre of mass, shape (3, 3), kg m²


def combine(parts: Sequence[tuple[Placement, RobotLink]]) -> MassProperties:
    """Return the mass properties of links that move as one rigid body.

    J = Σ (R_i J_i R_iᵀ + m_i (|d_i|² 1 − d_i d_iᵀ)) with d_i from the common centre of mass to the
    centre of link i (Steiner), in the axes that the placements are given in.
    """
    mass = sum(link.mass for _, link in parts)
    centres = [placement.x + placement.R @ link.centre for placement, link in parts]
    centre: Floats = sum((link.mass * c for (_, link), c in zip(parts, centres, strict=True)),
                        np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for (placement, link), c in zip(parts, centres, strict=True):
        d = c - centre
        inertia += placement.R @ link.inertia @ placement.R.T
        inertia += link.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return MassProperties(mass, centre, (inertia + inertia.T) / 2)


# ---------------------------------------------------------------- bodies in space


@dataclass
class Poses:
    """Placements of the bodies in space, by number, and axes and points of joints, by name."""

    bodies: list[Placement] = field(default_factory=list)
    axes: dict[str, Floats] = field(default_factory=dict)
    points: dict[str, Floats] = field(default_factory=dict)


def place_bodies(robot: Robot, coordinates: Mapping[str, Floats]) -> Poses:
    """Return the poses of bodies, and axes and points of joints in space, at given coordinates.

    Parents come before their children in ``robot.bodies``. The joints of a body move it one after
    the other; a joint's axis and point are moved by the joints before it.
    """
    poses = Poses()
    for body in robot.bodies:
        parent = IDENTITY if body.above < 0 else poses.bodies[body.above]
        placement = parent.then(body.place)
        for joint in body.joints:
            # a travel or angle; a quaternion of a ball; position and quaternion of a free joint
            entries, name = coordinates[joint.name], joint.name
            if joint.kind == "free":
                placement = parent.then(Placement(entries[:3], rotation(entries[3:])))
            axis, point = placement.R @ joint.axis, placement.x + placement.R @ joint.point
            poses.axes[name] = axis
            if joint.kind == "slide":
                placement = Placement(placement.x + (entries[0] - joint.ref) * axis, placement.R)
                point = point + (entries[0] - joint.ref) * axis
            elif joint.kind != "free":
                R = (turn(axis, entries[0] - joint.ref) @ placement.R if joint.kind == "hinge"
                     else placement.R @ rotation(entries))
                # the joint's point stays in place
                placement = Placement(point - R @ joint.point, R)
            poses.points[name] = point
        poses.bodies.append(placement)
    return poses


def body_velocities(
    robot: Robot, poses: Poses, rates: Mapping[str, Floats]
) -> list[tuple[Floats, Floats]]:
    """Return the velocity of the origin of each body and its angular velocity, in space.

    v = v_parent + ω_parent × (x − x_parent) and ω = ω_parent; a slide adds ṡ e to v, a hinge or a
    ball ω_j to ω and ω_j × (x − point of the joint) to v.
    """
    velocities: list[tuple[Floats, Floats]] = []
    for body, pose in zip(robot.bodies, poses.bodies, strict=True):
        v, omega = np.zeros(3), np.zeros(3)
        if body.above >= 0:
            v, omega = velocities[body.above]
            v = v + np.cross(omega, pose.x - poses.bodies[body.above].x)
        for joint in body.joints:
            rate = rates[joint.name]
            if joint.kind == "slide":
                v = v + rate[0] * poses.axes[joint.name]
                continue
            # rates of a free joint: v in space and Ω in body axes
            if joint.kind == "free":
                v, omega = rate[:3], pose.R @ rate[3:]
                continue
            omega_joint = (pose.R @ rate if joint.kind == "ball"
                           else rate[0] * poses.axes[joint.name])
            omega = omega + omega_joint
            v = v + np.cross(omega_joint, pose.x - poses.points[joint.name])
        velocities.append((v, omega))
    return velocities


# ---------------------------------------------------------------- links and joints to a tree


@dataclass(frozen=True, eq=False)
class Edge:
    """A joint of a file between two links: the placement of the child in the parent, and the joint.

    ``joint`` is None where the links are fixed to each other.
    """

    name: str
    parent: str
    child: str
    place: Placement
    joint: RobotJoint | None


def grow_tree(
    robot: Robot, links: Mapping[str, tuple[RobotLink, float]], edges: Sequence[Edge],
    base: Placement, base_joint: RobotJoint | None,
) -> None:
    """Add the links to the robot depth first, and the joints in the order of the file.

    Parameters
    ----------
    robot : Robot
        The robot to which links and joints are added.
    links : mapping of str to pair
        Each link with its mass and inertia, and the share of its weight that is compensated.
    edges : sequence of Edge
        All joints of the tree.
    base : Placement
        Pose of the root in space.
    base_joint : RobotJoint or None
        The joint of the root; None if it is fixed.
    """
    edges_of: dict[str, list[Edge]] = {name: [] for name in links}
    for edge in edges:
        edges_of[edge.parent].append(edge)
    # name of a link, number of its parent (−1: the ground), its placement there, and its joint
    stack = [(root_of(links, edges), -1, base, base_joint)]
    while stack:
        name, parent, placement, joint = stack.pop()
        link, gravcomp = links[name]
        number = len(robot.bodies)
        robot.bodies.append(RobotBody(name, parent, placement, link, gravcomp))
        if joint is not None:
            joint.body = number
            robot.bodies[-1].joints.append(joint)
        # reversed, for the link that is pushed last is taken first
        for edge in reversed(edges_of[name]):
            stack.append((edge.child, number, edge.place, edge.joint))
    joints = [*([base_joint] if base_joint else []), *(e.joint for e in edges if e.joint)]
    robot.joints |= {joint.name: joint for joint in joints}


def free_base() -> RobotJoint:
    """Return the free joint of a floating root, which has no name."""
    # a free joint has no axis; ``grow_tree`` sets the number of the body
    return RobotJoint(name="", kind="free", body=0, axis=np.array([0.0, 0.0, 1.0]),
                      point=np.zeros(3))


def check_followers(robot: Robot) -> None:
    """Refuse followers of a fixed joint, and cycles of followers."""
    leader_of = {follower.name: follower.leader for follower in robot.followers}
    moving = [name for name, joint in robot.joints.items() if joint.kind in ("hinge", "slide")]
    for name in leader_of:
        chain = [name]
        while chain[-1] in leader_of:
            leader = leader_of[chain[-1]]
            if leader not in moving:
                raise InputError(f"joint {shown(chain[-1])} follows {shown(leader)}, which is no "
                                 f"joint that moves{proposal(leader, moving)}; correct its "
                                 "<mimic>.")
            if leader in chain:
                raise InputError(f"joint {shown(leader)} follows itself; correct its <mimic>.")
            chain.append(leader)


def root_of(
    links: Mapping[str, Any], edges: Sequence[Edge], cure: str = "remove one of their joints, and "
    "close the loop again in a TOML file (loops = …)",
) -> str:
    """Return the link that is no child of a joint.

    ``cure`` says what opens a cycle in the format of the file. Raises InputError if the links are
    no tree: an unknown link, two parents, two roots, a cycle.
    """
    edge_to: dict[str, Edge] = {}
    for edge in edges:
        for end in (edge.parent, edge.child):
            if end not in links:
                raise InputError(f"joint {shown(edge.name)} joins {shown(end)}, which is no link"
                                 f"{proposal(end, links)}; correct it.")
        earlier = edge_to.setdefault(edge.child, edge)
        if earlier is not edge:
            raise InputError(f"link {shown(edge.child)} is the child of the joints "
                             f"{shown(earlier.name)} and {shown(edge.name)}, and URDF has trees "
                             "alone; remove one of them.")
    roots = [name for name in links if name not in edge_to]
    if len(roots) > 1:
        root_names = ", ".join(map(shown, roots[:6]))
        raise InputError(f"it has {len(roots)} roots, {root_names}, and a tree has one; "
                         "join the others by <joint>.")
    # the chain of ancestors of each link
    for name in links:
        chain = [name]
        while chain[-1] in edge_to:
            chain.append(edge_to[chain[-1]].parent)
            if chain[-1] in chain[:-1]:
                cycle = chain[chain.index(chain[-1]):]
                raise InputError(f"the links {' – '.join(cycle)} form a cycle, in which each is a "
                                 f"child, and a tree has a root; {cure}.")
    return roots[0]
