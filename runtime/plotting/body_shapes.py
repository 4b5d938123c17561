"""How bodies are drawn: as tops, wheels, rings, bars, blocks, balls, from inertia and joints.

A body with a symmetry axis has the inertia of a cylinder of radius r and height h about its centre
of mass: r² = 2 I₃/m, h² = 12 I₁/m − 3 r². A body on a fixed point, of which I₁, I₂, I₃ alone are
known, has the inertia of a flywheel with its mass m on a thin elliptic rim across its third axis:
at the distance l from the point, l² = (I₁ + I₂ − I₃)/(2m), with semi-axes a² = (I₃ + I₂ − I₁)/m,
b² = (I₃ + I₁ − I₂)/m. A plate of the same inertia is √2 times as wide and hides the point. The
weight m g l, with g = 9.81 m/s², fixes m and l.
A flat free body has the inertia of two rods that form a T.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.records import dataclass
from ...core.shapes import Shape, axes_about

if TYPE_CHECKING:
    from .scene import ScenePart

__all__ = ["DARK", "METAL", "STAND", "Held", "Rim", "rim_of", "shapes_of"]

Array = NDArray[np.float64]

METAL, DARK, STAND = "#575c66", "#2c3038", "#9aa1ac"
#: Relative difference of two lengths that count as equal.
_EQUAL = 1e-6
#: Radius of bars and stems in parts of the reach of the scene.
_BAR = 0.02
#: A body is slim, a bar, where its second half edge is less than this part of the longest: with
#: joints, and without.
_SLIM, _SLIM_FREE = 0.42, 0.08
#: Joints are at the centre where the farthest two are nearer than this part of the longest half
#: edge: a frame or a wheel, whose pins alone are joints.
_CENTRAL = 0.5
#: A disc on its hinge is a wheel where half its height is less than so many radii; radius and half
#: length of the axle in parts of the wheel's.
_WHEEL, _AXLE = 1.5, (0.1, 1.35)
#: Bars lead to the joints where the second half edge is less than this part of their distance.
_THIN_BETWEEN_JOINTS = 0.3
#: A free body is flat, drawn as two rods, where its shortest half edge is this part of the longest.
_FLAT = 0.05
#: Semi-axis r of an elliptic cylinder over half the edge, a, of the box of the same inertia: both
#: have the mean square r²/4 = a²/3 of this coordinate.
_SEMI_AXIS = np.sqrt(4 / 3)
#: Half the height of the flywheel of a top in parts of its radius and of its distance.
_THICK = (0.14, 0.35)


@dataclass(frozen=True)
class Held:
    """A place in body axes where a joint holds a body, and the axis of a hinge or slide.

    ``outer`` says that the other body is the ground or a larger one.
    """

    at: Array
    axis: Array | None
    outer: bool
    slides: bool


class Rim(NamedTuple):
    """An elliptic ring about the third principal axis of a top, in kg and m."""

    mass: float
    distance: float  # from the fixed point
    semi_axes: Array  # shape (2,)


def rim_of(moments: Array, weight: float) -> Rim:
    """Return the rim with moments I and weight m g l about a point: m l² = (I₁ + I₂ − I₃)/2.

    A flywheel whose mass is at the point (I₁ + I₂ = I₃) has mass 1.
    """
    I1, I2, I3 = moments
    ml, ml2 = weight / 9.81, max(I1 + I2 - I3, 0.0) / 2
    mass = ml**2 / ml2 if ml2 > 0 else 1.0
    semi_axes = np.sqrt(np.maximum([I3 + I2 - I1, I3 + I1 - I2], 0.0) / mass)
    return Rim(float(mass), float(np.sqrt(ml2 / mass)), semi_axes)


def shapes_of(body: ScenePart, joints: list[Held], reach: float, *, inside: bool,
              loose: Sequence[Array] = ()) -> list[Shape]:
    """Return the shapes of a body.

    Parameters
    ----------
    body : ScenePart
    joints : list of Held
        Its joints.
    reach : float
        Size of the scene, of which the thickness of bars is a part.
    inside : bool
        Whether another body is within it: then it is a frame.
    loose : sequence of array, shape (3,)
        Ends of rods in body axes.
    """
    thick = _BAR * reach
    return [*_body_shapes(body, joints, thick, reach, inside=inside),
            *_arms(body, loose, thick, body.centre)]


class _Proportions(NamedTuple):
    """A body's box and its joints: half edges, also in ascending order; places and hinges."""

    half: Array
    ordered: Array
    #: Places of the joints in body axes, shape (joints, 3), and the largest distance of two.
    places: Array
    span: float
    #: Axes of hinges that do not slide.
    hinges: list[Array]
    is_central: bool
    is_cube: bool
    is_slim: bool


def _proportions(body: ScenePart, joints: list[Held]) -> _Proportions:
    """Return the proportions of a body by which its shape is chosen."""
    half = body.sizes["box"]
    longest, ordered = half.max(), np.sort(half)
    hinges = [joint.axis for joint in joints if joint.axis is not None and not joint.slides]
    places = np.array([joint.at for joint in joints]).reshape(-1, 3)
    span = max((float(np.linalg.norm(a - b)) for a in places for b in places), default=0.0)
    return _Proportions(
        half, ordered, places, span, hinges, is_central=span < _CENTRAL * longest,
        is_cube=np.ptp(half) < _EQUAL * longest,
        is_slim=ordered[1] < (_SLIM if joints else _SLIM_FREE) * ordered[2])


def _body_shapes(body: ScenePart, joints: list[Held], thick: float, reach: float, *, inside: bool,
                 ) -> list[Shape]:
    """Return the shapes of a body: the first that its joints and proportions suggest.

    A rim with its stem, a gimbal ring, a frame, a block that slides, a top on its support; else by
    its proportions. ``inside``: another body lies within its box; ``thick`` is the radius of bars.
    """
    if body.rim is not None:
        return list(_top(np.zeros(3), body.axes, body.rim.distance, body.rim.semi_axes, end=0.0))
    proportions = _proportions(body, joints)
    hinges, is_slim = proportions.hinges, proportions.is_slim
    # bodies around others: hinges in two directions, one of them on the outside, make a gimbal ring
    has_two_directions = any(np.linalg.norm(np.cross(a, b)) > 0.5 for a in hinges for b in hinges)
    if inside and not is_slim and has_two_directions and any(joint.outer for joint in joints):
        return list(_ring(body, hinges, thick))
    if inside and proportions.is_central:
        return list(_frame(body, proportions.half))
    if any(joint.slides for joint in joints) and proportions.is_cube:
        return [Shape("box", proportions.half, body.centre, body.axes)]
    support = None if is_slim else _support(body, joints, reach)
    if support is not None:
        return list(_top_on(body, joints, *support))
    return _shapes_by_proportions(body, joints, proportions, thick)


def _shapes_by_proportions(
    body: ScenePart, joints: list[Held], proportions: _Proportions, thick: float
) -> list[Shape]:
    """Return a wheel, a sphere, a bar, arms to the joints, a disc or a wing nut; else a box."""
    half, ordered, places = proportions.half, proportions.ordered, proportions.places
    # bars from the centre to joints outside of the body
    arms = list(_arms(body, places, thick, body.centre))
    disc = _disc(body, half)
    if disc is not None and proportions.is_central and disc.size[2] < _WHEEL * disc.size[0] and any(
            abs(hinge @ disc.axes[:, 2]) > 1 - _EQUAL for hinge in proportions.hinges):
        axle_size = disc.size * [_AXLE[0], _AXLE[0], _AXLE[1]]
        return [disc, Shape("disc", axle_size, body.centre, disc.axes, METAL), *arms]
    if proportions.is_cube:
        return [Shape("sphere", body.sizes["ellipsoid"], body.centre, body.axes), *arms]
    if proportions.is_slim:
        return list(_bar(body, joints, ordered, thick))
    if proportions.span > 0 and ordered[1] < _THIN_BETWEEN_JOINTS * proportions.span:
        radius = float(np.clip(ordered[1], 0.7 * thick, 1.3 * thick))
        return [Shape.bar(places.mean(axis=0), place, radius) for place in places]
    if disc is not None:
        return [disc, *arms, *_pointer(body, half)]
    if not joints and not body.to_scale and ordered[0] < _FLAT * ordered[2]:
        return list(_wing_nut(body, half))
    return [Shape("box", half, body.centre, body.axes), *arms, *_pointer(body, half)]


def _disc(body: ScenePart, half: Array) -> Shape | None:
    """Return the cylinder with the inertia of the box of half edges ``half``.

    Its axis is the one across two equal edges; None where no two are equal.
    """
    axis = next((k for k in range(3) if np.ptp(np.delete(half, k)) < _EQUAL * half.max()), None)
    if axis is None:
        return None
    r = float(np.delete(half, axis)[0]) * _SEMI_AXIS
    return Shape("disc", np.array([r, r, float(half[axis])]), body.centre,
                 _axes_with_third(body.axes, axis))


def _top_on(body: ScenePart, joints: list[Held], foot: Array, k: int) -> Iterator[Shape]:
    """Yield a top that stands on ``foot`` with its principal axis k, 0 to 2.

    ``foot`` is a point in body axes, shape (3,), m. The stem ends at the farthest joint.
    """
    lever = body.centre - foot
    height = float(np.linalg.norm(lever))
    axes = _axes_with_third(body.axes, k)
    # the third axis leads up from the foot
    axes = axes * (1 if lever @ axes[:, 2] > 0 else np.array([1, -1, -1]))
    end = max(float((joint.at - foot) @ lever) / height for joint in joints)
    half = body.sizes["box"]
    return _top(foot, axes, height, half[[(k + 1) % 3, (k + 2) % 3]] * _SEMI_AXIS, end)


def _axes_with_third(axes: Array, axis: int) -> Array:
    """Return right-handed axes, the columns of ``axes`` cyclically moved so that ``axis`` is the
    third."""
    turned_axes: Array = axes[:, [(axis + 1) % 3, (axis + 2) % 3, axis]]
    return turned_axes


def _support(body: ScenePart, joints: list[Held], reach: float) -> tuple[Array, int] | None:
    """Return the point on which a top stands and the number k of its principal axis, or None.

    Ball joints on one principal axis hold a top, and no other joints do.
    """
    if not joints or any(joint.axis is not None for joint in joints):
        return None
    # from each joint to the centre of mass, in principal axes
    levers = np.array([(body.centre - joint.at) @ body.axes for joint in joints])
    k = int(np.argmax(np.abs(levers).max(axis=0)))
    is_beside_axis = np.abs(np.delete(levers, k, axis=1)).max() > _EQUAL * reach
    is_at_centre = abs(levers[0, k]) < _EQUAL * reach
    return None if is_beside_axis or is_at_centre else (joints[0].at, k)


def _top(foot: Array, axes: Array, height: float, half: Array, end: float) -> Iterator[Shape]:
    """Yield a top: a stem from its foot along the third axis, through an elliptic flywheel.

    The flywheel has the semi-axes ``half``, (2,), at ``height`` above the foot. The stem ends at
    the distance ``end`` from the foot; if 0, with a knob above the flywheel.
    """
    r = float(half.max())
    # disc with the hub on it, then the stem and its thin point
    half_thickness = min(_THICK[0] * r, _THICK[1] * height)
    stem = 0.05 * max(r, height)
    knob = end or height + max(0.7 * r, 0.4 * height)
    e, centre = axes[:, 2], foot + height * axes[:, 2]
    yield Shape("disc", np.array([half[0], half[1], half_thickness]), centre, axes)
    yield Shape("disc", np.array([2 * stem, 2 * stem, 1.5 * half_thickness]), centre, axes, DARK)
    yield Shape.bar(foot + 2.4 * stem * e, foot + (knob - stem) * e, stem, METAL)
    yield Shape.bar(foot + 0.45 * stem * e, foot + 2.4 * stem * e, 0.45 * stem, METAL)


def _ring(body: ScenePart, hinges: list[Array], thick: float) -> Iterator[Shape]:
    """Yield a ring of bars about the centre, in the plane of two hinges, and a pin at each hinge.
    """
    # of all hinges the one that is most nearly across the first determines the plane best
    first_hinge = hinges[0]
    second_hinge = max(hinges, key=lambda a: float(np.linalg.norm(np.cross(a, first_hinge))))
    normal = np.cross(first_hinge, second_hinge)
    axes = axes_about(normal / np.linalg.norm(normal))
    radius = float(body.sizes["box"].max())
    angles = 2 * np.pi * np.arange(37) / 36
    line = body.centre + radius * (np.outer(np.cos(angles), axes[:, 0])
                                   + np.outer(np.sin(angles), axes[:, 1]))
    for a, b in pairwise(line):
        yield Shape.bar(a, b, 0.9 * thick)
    for e in hinges:
        for side in (-1, 1):
            yield Shape.bar(body.centre + side * (radius - thick) * e,
                            body.centre + side * (radius + 2.5 * thick) * e, 0.6 * thick, METAL)


def _frame(body: ScenePart, half: Array) -> Iterator[Shape]:
    """Yield bars along the twelve edges of the box with the half edges ``half``."""
    edge_radius = 0.035 * float(half.max())
    for k in range(3):  # four edges along axis k, at both ends of axes i and j
        i, j = (k + 1) % 3, (k + 2) % 3
        for a in (-1, 1):
            for b in (-1, 1):
                tips = np.zeros((2, 3))
                tips[:, i], tips[:, j] = a * (half[i] - edge_radius), b * (half[j] - edge_radius)
                tips[:, k] = (edge_radius - half[k], half[k] - edge_radius)
                start, end = body.centre + tips @ body.axes.T
                yield Shape.bar(start, end, edge_radius)


def _bar(body: ScenePart, joints: list[Held], ordered: Array, thick: float) -> Iterator[Shape]:
    """Yield a bar along the longest axis of a body, to its ends or its joints beyond.

    ``ordered`` are the half lengths in ascending order, shape (3,), and ``thick`` is the usual
    radius, in m. A joint beside the bar has a bar to it.
    """
    e = body.axes[:, int(np.argmax(body.sizes["box"]))]
    radius = float(np.clip(ordered[1], 0.7 * thick, 1.3 * thick))
    half_length = ordered[2]
    begin, end = -half_length, half_length
    joint_distances = [float((joint.at - body.centre) @ e) for joint in joints]
    # a bar ends where it is held, if that is near its end or beyond
    if joint_distances and min(joint_distances) < -0.8 * half_length:
        begin = min(joint_distances)
    if joint_distances and max(joint_distances) > 0.8 * half_length:
        end = max(joint_distances)
    yield Shape.bar(body.centre + min(begin, end, *joint_distances) * e,
                    body.centre + max(begin, end, *joint_distances) * e, radius)
    for joint, s in zip(joints, joint_distances, strict=True):
        foot = body.centre + s * e
        if np.linalg.norm(joint.at - foot) > radius:
            yield Shape.bar(foot, joint.at, 0.8 * radius)


def _arms(body: ScenePart, points: Sequence[Array] | Array, thick: float, start: Array,
          ) -> Iterator[Shape]:
    """Yield a bar from ``start`` to each of the points outside of the body, all in body axes."""
    for point in points:
        r = (point - body.centre) @ body.axes
        if (np.abs(r) > body.sizes["box"] + 0.1 * thick).any():
            yield Shape.bar(start, point, 0.8 * thick, METAL)


def _pointer(body: ScenePart, half: Array) -> Iterator[Shape]:
    """Yield a rod to the point that leaves a trace, where it is outside of the body."""
    if np.linalg.norm(body.tip - body.centre) > half.max():
        yield Shape.bar(body.centre, body.tip, 0.025 * float(half.max()), METAL)


def _wing_nut(body: ScenePart, half: Array) -> Iterator[Shape]:
    """Yield two rods that form a T: the longer axis is the bar across, the other the stem.

    Of a bar of half length 1 and a stem of length L of the same line density, the ratio of the two
    second moments is ρ(L) = (2c² + L³/12 + L(c − L/2)²)/(2/3), c = L²/(2(2 + L)): it increases. The
    bar is at the distance c from the centre of mass.
    """
    across, along = np.argsort(half)[[2, 1]]
    low, high = 0.0, 2.0
    # bisection for ρ(L) = (half[along]/half[across])², to the last bit
    for _ in range(50):
        L = (low + high) / 2
        c = L**2 / (2 * (2 + L))
        ratio = (2 * c**2 + L**3 / 12 + L * (c - L / 2) ** 2) / (2 / 3)
        low, high = (L, high) if ratio < (half[along] / half[across]) ** 2 else (low, L)
    size = 1.25 * float(half[across])
    x, y = size * body.axes[:, across], size * body.axes[:, along]
    yield Shape.bar(body.centre + c * y - x, body.centre + c * y + x, 0.11 * size)
    yield Shape.bar(body.centre + c * y, body.centre + (c - L) * y, 0.08 * size, METAL)
