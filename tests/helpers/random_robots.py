"""Random robots in URDF and SDF, and parts of their formats to put into them.

The same tree of links is written in both formats: in SDF each link, joint and axis has a frame of
its own choice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gyrospark.generator.models.robot_tree import IDENTITY, Placement
from gyrospark.generator.models.xml_numbers import roll_pitch_yaw

KINDS = ("revolute", "continuous", "prismatic", "fixed")


@dataclass
class Link:
    """A link, and the joint by which it hangs on another one."""

    name: str
    above: str
    kind: str
    place: Placement  # of link and joint in the link above
    angles: tuple[float, ...]  # roll, pitch, yaw of it
    axis: np.ndarray
    mass: float
    centre: np.ndarray
    turned: tuple[float, ...]
    inertia: np.ndarray
    damping: float
    follows: tuple[str, float, float] | None


def random_tree(rng: np.random.Generator, count: int, *, mimic: bool = True) -> list[Link]:
    """Return links, each hanging on one before it or on ``base``; the first one moves."""
    links: list[Link] = []
    for k in range(count):
        angles = tuple(rng.uniform(-3, 3, 3).round(3).tolist())
        placement = Placement(rng.uniform(-1, 1, 3).round(3), roll_pitch_yaw(angles))
        a, b, c = rng.uniform(0.05, 0.5, 3).round(3)
        moving = [link.name for link in links if link.kind != "fixed" and not link.follows]
        kind = str(rng.choice(KINDS[:3] if k == 0 else KINDS))
        follows = None
        if mimic and moving and kind != "fixed" and rng.random() < 0.3:
            follows = f"{rng.choice(moving)}_joint", *rng.uniform(-2, 2, 2).round(2).tolist()
        links.append(Link(
            f"l{k}", str(rng.choice(["base", *(link.name for link in links)])), kind, placement,
            angles, rng.normal(size=3).round(3), round(rng.uniform(0.2, 3), 3),
            rng.uniform(-0.5, 0.5, 3).round(3), tuple(rng.uniform(-3, 3, 3).round(3).tolist()),
            np.array([b + c, a + c, a + b]), float(rng.choice([0, 0.3])), follows))
    return links


def words(numbers) -> str:
    return " ".join(repr(float(x)) for x in numbers)


def urdf_text(links: list[Link], rng: np.random.Generator | None = None) -> str:
    """Return the URDF of a tree; with ``rng``, some rotations are quaternions."""
    def origin(x, angles):
        if rng is None or rng.random() < 0.5:
            return f'<origin xyz="{words(x)}" rpy="{words(angles)}"/>'
        return f'<origin xyz="{words(x)}" quat_xyzw="{words(2 * quaternion_xyzw(angles))}"/>'

    parts = ['<link name="base"/>']
    for link in links:
        inertia = "".join(f' {key}="{x!r}"' for key, x in zip(
            ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), [*link.inertia.tolist(), 0, 0, 0],
            strict=True))
        mimic = '<mimic joint="{}" multiplier="{!r}" offset="{!r}"/>'.format(*link.follows) \
            if link.follows else ""
        parts.append(
            f'<link name="{link.name}"><inertial>{origin(link.centre, link.turned)}'
            f'<mass value="{link.mass!r}"/><inertia{inertia}/></inertial></link>'
            f'<joint name="{link.name}_joint" type="{link.kind}">'
            f'{origin(link.place.x, link.angles)}'
            f'<parent link="{link.above}"/><child link="{link.name}"/>'
            f'<axis xyz="{words(link.axis)}"/><dynamics damping="{link.damping!r}"/>{mimic}'
            '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>')
    version = "1.0" if rng is None else "1.1"
    return f'<robot name="random" version="{version}">{"".join(parts)}</robot>'


def quaternion_xyzw(angles) -> np.ndarray:
    """Return the unit quaternion of R_z(yaw) R_y(pitch) R_x(roll) by half angles."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(x / 2), math.sin(x / 2)) for x in angles)
    return np.array([sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
                     cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy])


def sdf_text(links: list[Link], rng: np.random.Generator) -> str:
    """Return the SDF of a tree at zero coordinates, its frames chosen at random.

    The pose of a link is in the model, in the link above, or in a frame; that of a joint is moved
    along its axis, or about it, and its axis is in the axes of any of these.
    """
    places = {"base": IDENTITY}
    for link in links:
        places[link.name] = places[link.above].then(link.place)
    model = Placement(rng.uniform(-1, 1, 3), roll_pitch_yaw([0.0, 0.0, 0.0]))
    parts = ['<link name="base"/>', '<joint name="floor" type="fixed"><parent>world</parent>'
             "<child>base</child></joint>"]
    for link in links:
        space, axis = places[link.name], link.axis / np.linalg.norm(link.axis)
        above = str(rng.choice(["", "__model__", link.above, f"{link.name}_frame"]))
        frame = Placement(rng.uniform(-1, 1, 3), roll_pitch_yaw(rng.uniform(-3, 3, 3)))
        frames = {"": IDENTITY, "__model__": IDENTITY, f"{link.name}_frame": frame, **places}
        # a hinge may be anywhere on its axis; a slide anywhere at all
        shift = rng.normal() * axis if link.kind in KINDS[:2] else rng.normal(size=3)
        joint = Placement(np.zeros(3) if link.kind == "fixed" else shift,
                          roll_pitch_yaw(rng.uniform(-3, 3, 3)))
        axis_frame = str(rng.choice(["", "__model__", link.above, link.name, f"{link.name}_frame"]))
        joint_space = space.then(joint)
        axis_frames = {**frames, "": joint_space, link.name: space}
        mimic = ""
        if link.follows:
            leader, ratio, offset = link.follows
            mimic = (f'<mimic joint="{leader}"><multiplier>{ratio!r}</multiplier>'
                     f"<offset>{offset + 0.5 * ratio!r}</offset><reference>0.5</reference></mimic>")
        a, b, c = link.inertia.tolist()
        expressed = f' expressed_in="{axis_frame}"' if axis_frame else ""
        parts.append(
            f'<frame name="{link.name}_frame">{_pose("", frame, rng)}</frame>'
            f'<link name="{link.name}">{_pose(above, inside(frames[above], space), rng)}'
            f"<inertial>{_pose('', Placement(link.centre, roll_pitch_yaw(link.turned)), rng)}"
            f"<mass>{link.mass!r}</mass><inertia><ixx>{a!r}</ixx><iyy>{b!r}</iyy><izz>{c!r}</izz>"
            "</inertia></inertial></link>"
            f'<joint name="{link.name}_joint" type="{link.kind}">'
            f"{_pose(link.name, joint, rng)}<parent>{link.above}</parent><child>{link.name}</child>"
            f"<axis>"
            f"<xyz{expressed}>{words(axis_frames[axis_frame].R.T @ space.R @ axis)}</xyz>{mimic}"
            f"<dynamics><damping>{link.damping!r}</damping></dynamics></axis></joint>")
    order = rng.permutation(len(parts))
    inner = "".join(parts[k] for k in order)
    return (f'<sdf version="1.12"><world name="w"><gravity>0 0 -9.81</gravity><model name="random">'
            f"{_pose('', model, rng)}{inner}</model></world></sdf>")


def inside(outer: Placement, inner: Placement) -> Placement:
    """Return where a frame of space is in another one."""
    return Placement(outer.R.T @ (inner.x - outer.x), outer.R.T @ inner.R)


def _pose(above: str, placement: Placement, rng: np.random.Generator) -> str:
    relative_to = f' relative_to="{above}"' if above else ""
    pitch = math.asin(min(max(-placement.R[2, 0], -1), 1))
    angles = (math.atan2(placement.R[2, 1], placement.R[2, 2]), pitch,
              math.atan2(placement.R[1, 0], placement.R[0, 0]))
    form = rng.integers(3)
    if form == 0:
        return f"<pose{relative_to}>{words([*placement.x, *angles])}</pose>"
    if form == 1:
        return (f'<pose{relative_to} '
                f'degrees="true">{words([*placement.x, *np.degrees(angles)])}</pose>')
    return (f'<pose{relative_to} rotation_format="quat_xyzw">'
            f"{words([*placement.x, *quaternion_xyzw(angles)])}</pose>")
