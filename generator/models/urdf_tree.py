"""Where the links of a robot are; links that a fixed joint holds together become one body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import shown
from ...core.errors import InputError
from ..multibody.body import Frame
from ..multibody.multibody import Multibody
from .urdf_robot import IDENTITY, Placement, Robot, RobotJoint, RobotLink, turn

__all__ = ["LoopJoint", "Mount", "RobotBody", "combine", "placed", "robot_bodies"]

Array = NDArray[np.float64]


@dataclass(eq=False)
class RobotBody:
    """Links that move as one, named by the first of them, in whose frame all is given.

    Attributes
    ----------
    joint : Joint or None
        What it hangs by; None for the root.
    above : Limb or None
        What it hangs on.
    at : Place
        Where the joint is in the frame of the limb above.
    """

    name: str
    joint: RobotJoint | None
    above: RobotBody | None
    at: Placement
    parts: list[tuple[Placement, RobotLink]] = field(default_factory=list)

    def body(self) -> tuple[float, Array, Array]:
        """Return mass, centre of mass, and inertia about it, in the frame of the limb.

        Raises
        ------
        InputError
            Unless there is mass.
        """
        mass = sum(link.mass for _, link in self.parts)
        if mass <= 0:
            raise InputError(
                f"link {shown(self.name)} moves and has no mass, nor has what is fixed to it; give "
                "it an <inertial> with mass and inertia, or make its joint fixed.")
        return combine(self.parts)


@dataclass(frozen=True, eq=False)
class Mount:
    """A link as part of a body, or of the ground: where its frame is there, and in space."""

    frame: Frame
    inner: Placement
    space: Placement


@dataclass(frozen=True, eq=False)
class LoopJoint:
    """A joint that closes a loop: where it is in two links, and its axis in its own axes.

    ``across`` is the second axis of a universal joint, in the axes of the joint on the second link.
    """

    name: str
    kind: str
    links: tuple[str, str]
    places: tuple[Placement, Placement]
    axis: Array
    across: Array | None = None

    def close(self, builder: Multibody, name: str, mounts: Mapping[str, Mount]) -> None:
        """Add the joint."""
        a, b = (mounts[link] for link in self.links)
        inner_a, inner_b = (mount.inner.then(place)
                            for mount, place in zip((a, b), self.places, strict=True))
        ends: dict[str, Any] = {"a": a.frame, "b": b.frame, "on_a": inner_a.x, "on_b": inner_b.x}
        axis = a.space.R @ self.places[0].R @ self.axis
        if self.kind == "ball":
            builder.ball(name, **ends)
        elif self.kind == "fixed":
            builder.fixed(name, **ends, rotation=inner_a.R @ inner_b.R.T)
        elif self.kind == "prismatic":
            builder.prismatic(name, **ends, axis_in_space=axis)
        elif self.kind == "universal":
            across = b.space.R @ self.places[1].R @ np.asarray(self.across)
            builder.universal(name, **ends, axis_a=axis, axis_b=across)
        else:
            builder.revolute(name, **ends, axis_in_space=axis)


def combine(parts: Sequence[tuple[Placement, RobotLink]]) -> tuple[float, Array, Array]:
    """Return mass, centre of mass, and inertia about it, of links that move as one."""
    mass = sum(link.mass for _, link in parts)
    centres = [place.x + place.R @ link.centre for place, link in parts]
    centre: Array = sum((link.mass * c for (_, link), c in zip(parts, centres, strict=True)),
                        np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for (place, link), c in zip(parts, centres, strict=True):
        d = c - centre
        inertia += place.R @ link.inertia @ place.R.T
        inertia += link.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return mass, centre, (inertia + inertia.T) / 2


def robot_bodies(robot: Robot) -> list[RobotBody]:
    """Return the limbs, each after the one it hangs on, branch by branch."""
    below: dict[str, list[RobotJoint]] = {name: [] for name in robot.links}
    for joint in robot.joints.values():
        below[joint.parent].append(joint)
    root = RobotBody(robot.root, None, None, IDENTITY)
    found = [root]
    left: list[tuple[str, RobotBody, Placement]] = [(robot.root, root, IDENTITY)]
    while left:
        name, limb, place = left.pop()
        limb.parts.append((place, robot.links[name]))
        if limb.joint is not None and limb not in found:
            found.append(limb)
        for joint in reversed(below[name]):
            at = place.then(joint.place)
            if joint.kind == "fixed":
                left.append((joint.child, limb, at))
            else:
                left.append((joint.child, RobotBody(joint.child, joint, limb, at), IDENTITY))
    return found


def placed(
    limbs: list[RobotBody], base: Placement, coordinates: Mapping[str, float]
) -> dict[RobotBody, Placement]:
    """Return where each limb is in space, at these angles and travels of joints by name."""
    found: dict[RobotBody, Placement] = {}
    for limb in limbs:
        joint = limb.joint
        if joint is None or limb.above is None:
            found[limb] = base
            continue
        here = found[limb.above].then(limb.at)
        value = coordinates.get(joint.name, 0.0)
        if joint.kind == "prismatic":
            here = here.then(Placement(value * joint.axis, np.eye(3)))
        elif joint.kind not in ("ball", "floating"):
            here = here.then(Placement(np.zeros(3), turn(joint.axis, value)))
        found[limb] = here
    return found
