"""The scene of a film or page: bodies as boxes or ellipsoids, joints, places.

A uniform ellipsoid of mass m has semi-axes a_i with I_j + I_k − I_i = 2 m a_i²/5, a uniform box
half edges with I_j + I_k − I_i = 2 m a_i²/3, the moments being those about the centre of mass. So a
body is shown as large as it is; one of which the mass is not known in its proportions only.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.manifest import Manifest
from ...core.records import dataclass
from ...core.shapes import Shape, axes_about
from ..compilation.body_columns import (
    JointAt,
    bodies_of,
    joints_of,
    numbers,
    placed_of,
)
from ..rigid_body.quaternion import left_matrix, rotation_matrix
from .body_shapes import DARK, METAL, Held, Rim, rim_of, shapes_of

if TYPE_CHECKING:
    from ..results.trajectory import Trajectory

__all__ = ["DRAWN", "JOINT", "ROD", "SHAPES", "DrawnName", "Scene", "ScenePart", "ShapeName", "Tie",
           "check_bodies", "drawn_joints", "is_held", "scene_of"]

Array = NDArray[np.float64]
ShapeName = Literal["box", "ellipsoid"]
SHAPES: tuple[ShapeName, ...] = get_args(ShapeName)
#: Shapes of bodies on pages; "auto" takes those of the scene.
DrawnName = Literal["auto", "box", "ellipsoid"]
DRAWN: tuple[DrawnName, ...] = get_args(DrawnName)

#: S_i = I_j + I_k − I_i is so many times m a_i².
_FACTORS = {"box": 2 / 3, "ellipsoid": 2 / 5}
#: The thinnest that a body is drawn, beside its longest axis.
_THIN = 0.03
#: Radii of joints and rods, in parts of the reach of the scene.
JOINT, ROD = 0.021, 0.010


@dataclass(frozen=True)
class ScenePart:
    """One body of a scene.

    Attributes
    ----------
    name : str
    q, x : array, shape (frames, 4) and (frames, 3)
        Attitude, and where the origin of the body axes is.
    centre : array, shape (3,)
        The middle of its shape in body axes.
    axes : array, shape (3, 3)
        Columns: the principal axes in body axes, right-handed.
    sizes : dict of str to array, shape (3,)
        Half the edges of the box, the semi-axes of the ellipsoid.
    tip : array, shape (3,)
        The point in body axes that leaves a trace.
    to_scale : bool
        Whether the sizes are the body's own.
    rim : Rim, optional
        Of a body on a fixed point under gravity, of which no mass is known: the rim that has its
        inertia and weight, on the third of ``axes``.
    shapes : list of Shape
        The drawn shapes in body axes; none for the box of its inertia.
    glass : bool
        Whether it is a frame around other bodies, with sides of glass.
    own : bool
        Whether its model has visuals: its joints are then not drawn.
    """

    name: str
    q: Array
    x: Array
    centre: Array
    axes: Array
    sizes: dict[str, Array]
    tip: Array
    to_scale: bool
    rim: Rim | None = None
    shapes: list[Shape] = field(default_factory=list)
    glass: bool = False
    own: bool = False

    def at(self, points: Array) -> Array:
        """Return points of the body in space, shape (frames, number of points, 3)."""
        R = rotation_matrix(self.q)
        where: Array = self.x[:, None] + np.einsum("kij,nj->kni", R, np.atleast_2d(points))
        return where


@dataclass(frozen=True)
class Tie:
    """A joint, rod or spring between two bodies: their indices, −1 for the ground, and points.

    ``kind`` is ``"ball"``, ``"hinge"`` with the axis in b, ``"rod"`` or ``"spring"``; ``slides``
    says that b moves along the axis.
    """

    name: str
    kind: str
    a: int
    b: int
    on_a: Array
    on_b: Array
    axis: Array | None
    slides: bool = False


@dataclass(frozen=True)
class Scene:
    """Some states of a trajectory as bodies in space.

    Attributes
    ----------
    title : str
    t, energy_error : array, shape (frames,)
    parts, ties : list
    up : array, shape (3,)
        Against gravity; the third axis where there is none.
    gravity : bool
        Whether there is gravity, and so a floor.
    remarks : list of str
        Notes on the picture for its reader.
    ground : list of Shape
        Shapes fixed in space.
    impacts : array, shape (impacts,)
        Their times.
    """

    title: str
    t: Array
    energy_error: Array
    parts: list[ScenePart]
    ties: list[Tie]
    up: Array
    gravity: bool
    remarks: list[str]
    ground: list[Shape] = field(default_factory=list)
    impacts: Array = field(default_factory=lambda: np.zeros(0))

    def points(self, frames: Any) -> Array:
        """Return centres and joints of bodies at some frames, shape (frames, points, 3)."""
        points = []
        for i, body in enumerate(self.parts):
            tie_ends = [end for tie in self.ties
                        for end in ((tie.a, tie.on_a), (tie.b, tie.on_b))]
            points_of_body = np.array([body.centre, *(r for k, r in tie_ends if k == i)])
            R = rotation_matrix(body.q[frames])
            points.append(body.x[frames][:, None] + np.einsum("kij,nj->kni", R, points_of_body))
        return np.concatenate(points, axis=1)

    def reach(self, frame: int) -> float:
        """Return the size of the scene in a frame: its diagonal, or the largest body.

        Joints are drawn with a thickness that is a fixed part of it.
        """
        return max(float(np.linalg.norm(np.ptp(self.points([frame])[0], axis=0))),
                   *(2 * float(body.sizes["box"].max()) for body in self.parts))

    def hides(self, tie: Tie) -> bool:
        """Return whether a joint is part of the shapes that the model gives one of its bodies."""
        return any(i >= 0 and self.parts[i].own for i in (tie.a, tie.b))

    def joints_on(self, i: int, reach: float) -> Iterator[Shape]:
        """Yield pins and balls of the joints whose second body is i (−1: ground), in its axes.

        ``reach`` is the size of the scene, which joints are a fixed part of.
        """
        # a disc turns about its own axis: a pin would only repeat it
        is_wheel = i >= 0 and self.parts[i].shapes and self.parts[i].shapes[0].kind == "disc"
        r = JOINT * reach
        for tie in self.ties:
            if tie.b != i or tie.slides or self.hides(tie):
                continue
            if tie.kind == "ball":
                yield Shape("sphere", np.full(3, 1.3 * r), tie.on_b, colour=METAL)
            elif tie.kind == "hinge" and tie.axis is not None and not is_wheel:
                # a pin, and a thinner core that sticks out at both ends
                for radius, half_length, colour in ((r, 1.9 * r, METAL), (0.45 * r, 2.1 * r, DARK)):
                    yield Shape("disc", np.array([radius, radius, half_length]), tie.on_b,
                                axes_about(tie.axis), colour)


def scene_of(trajectory: Trajectory, frames: int, *, include: int | None = None) -> Scene:
    """Return the scene of a trajectory: its bodies and joints at up to ``frames`` stored states.

    The states are evenly spaced; ``include`` is the index of a stored state to be among them.

    Raises
    ------
    InputError
        Where there is no rigid body.
    """
    check_bodies(trajectory.manifest)
    state_indices = _shown_states(trajectory, frames, include)
    bodies = bodies_of(trajectory.manifest)
    parts = [_scene_body(trajectory, name, state_indices) if name in bodies else
             _placed_body(trajectory, name, state_indices) for name in trajectory.bodies]
    error, t = trajectory.energy_error(), trajectory.t
    # shapes are chosen last: joints and neighbours decide them
    up, ties = _up(trajectory), _ties(trajectory, parts)
    bodies_with_shapes = _with_shapes(parts, ties, _rolling(trajectory.manifest))
    return Scene(
        f"{trajectory.manifest.system.name}, {trajectory.manifest.scheme.method}",
        t[state_indices].astype(float), error[state_indices].astype(float), bodies_with_shapes,
        ties,
        up=np.array([0.0, 0.0, 1.0]) if up is None else up,
        gravity=up is not None or any(body.rim is not None for body in parts),
        remarks=list(_remarks(trajectory, parts, state_indices)),
        impacts=_impact_times(trajectory))


def _shown_states(trajectory: Trajectory, frames: int, include: int | None) -> Any:
    """Return the indices of at most ``frames`` states, evenly spread, and of ``include``."""
    count = len(trajectory)
    indices = np.linspace(0, count - 1, min(frames, count)).astype(int)
    indices = np.unique(indices if include is None else np.append(indices, include))
    # t_eval may have had its times in any order
    forwards = np.sign(float(trajectory.dt)) * trajectory.t[indices].astype(float)
    return indices[np.argsort(forwards, kind="stable")]


def _impact_times(trajectory: Trajectory) -> Array:
    """Return the times of impacts, of each kind at most about 500, evenly among all of them."""
    times = [impacts.t[:: max(1, len(impacts) // 500)].astype(float)
             for impacts in trajectory.impacts.values()]
    return np.concatenate([np.zeros(0), *times])


def check_bodies(manifest: Manifest) -> None:
    """Refuse a system without a body that a scene could show.

    Raises
    ------
    InputError
    """
    if not bodies_of(manifest) and not placed_of(manifest):
        raise InputError(f"System {manifest.system.name!r} has no rigid body to show; "
                         "run.plot() draws its coordinates, and placed= of a Lagrangian says where "
                         "bodies are.")


def _scene_body(trajectory: Trajectory, name: str, state_indices: Any) -> ScenePart:
    """Return a body with the box and the ellipsoid of its inertia, its poses, and a tip to trace.

    With S_i = I_j + I_k − I_i about the centre of mass, half its lengths are √(S_i/(f m)), f = 2/3
    of a box and 2/5 of an ellipsoid. Where no mass is known, they are relative to the largest. A
    body on a fixed point whose weight is on a principal axis is drawn as a top of that inertia and
    weight.
    """
    motion, columns = trajectory.body(name), bodies_of(trajectory.manifest)[name]
    mass = columns.mass_of(trajectory.parameters)
    centre = motion.centre if columns.centre else np.zeros(3)
    moments, axes = _principal_moments(motion.inertia, mass, centre)
    sizes = _sizes_of(moments, mass)
    x = trajectory.q[state_indices][:, columns.x].astype(float) if columns.x else np.broadcast_to(
        numbers(columns.origin, trajectory.parameters), (len(state_indices), 3))
    if columns.x or centre.any():
        tip = centre
    else:  # its centre stands still: the end of the third axis
        tip = np.array([0.0, 0.0, 1.3 * max(size.max() for size in sizes.values())])
    rim = None
    # without a mass, on a fixed point: a top, whose weight tells its size, or a flat body
    if mass is None and not columns.x and not columns.centre:
        top = _top_of(trajectory, moments, axes)
        if top is not None:
            axes, order, rim = top
            # lengths in m, from the mass of the rim, in the order of the top's axes
            largest = np.sqrt(_second_moments(moments).max() / rim.mass)
            sizes = {kind: largest * sizes_of_kind[order] / np.sqrt(_FACTORS[kind])
                     for kind, sizes_of_kind in sizes.items()}
            # beyond the rim, so that the trace is outside of the drawn top
            tip = axes[:, 2] * (rim.distance + max(0.75 * float(rim.semi_axes.max()),
                                                   0.35 * rim.distance))
        # a flat body is drawn as a T: the end of its stem
        elif sizes["box"].min() < 0.05 * sizes["box"].max() and not centre.any():
            k = int(np.argsort(sizes["box"])[1])
            tip = -1.35 * sizes["box"][k] * axes[:, k]
    return ScenePart(name, trajectory.q[state_indices][:, columns.q].astype(float), x, centre,
                     axes, sizes, tip, to_scale=bool(mass) or rim is not None, rim=rim)


class _Top(NamedTuple):
    """A body on a fixed point whose weight is on a principal axis, drawn about its third axis."""

    axes: Array  # principal axes in columns, the third one from the point up, against the weight
    order: list[int]  # of the moments along these axes
    rim: Rim


def _top_of(trajectory: Trajectory, moments: Array, axes: Array) -> _Top | None:
    """Return the top with these moments about the principal axes; None for another body."""
    w = _weight_times_centre(trajectory, moments, axes)  # m g r in N m, along the axes
    # w and the axis may differ by 4.5e-5 rad, √(2e-9): errors of the fit
    if w is None or not np.abs(w).max() > (1 - 1e-9) * np.linalg.norm(w):
        return None
    k = int(np.argmax(np.abs(w)))
    order = [(k + 1) % 3, (k + 2) % 3, k]
    # where the centre is on the negative axis, half a turn about the first axis puts it on the
    # third, and the axes stay right-handed
    return _Top(axes[:, order] * (1 if w[k] > 0 else np.array([1, -1, -1])), order,
                rim_of(moments[order], float(np.linalg.norm(w))))


def _principal_moments(inertia: Array, mass: float | None, centre: Array) -> tuple[Array, Array]:
    """Return the principal moments, shape (3,), and the axes, columns of a rotation matrix.

    ``inertia`` is about the body's origin; with a mass the moments are about the centre of mass.
    """
    J = inertia
    if mass is not None:  # Steiner's theorem
        J = J - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    is_diagonal = not (J - np.diag(np.diag(J))).any()  # keeps the order of the body's axes
    moments, axes = (np.diag(J), np.eye(3)) if is_diagonal else np.linalg.eigh(J)
    # eigenvectors may be left-handed
    return moments, axes * np.sign(np.linalg.det(axes))


def _second_moments(moments: Array) -> Array:
    """Return S_i = I_j + I_k − I_i, shape (3,), at least 0 in spite of round-off."""
    second_moments: Array = np.maximum(moments.sum() - 2 * moments, 0.0)
    return second_moments


def _sizes_of(moments: Array, mass: float | None) -> dict[str, Array]:
    """Return half edges of the box, and semi-axes of the ellipsoid, of equal inertia, (3,) each.

    ``moments`` are the principal moments, shape (3,), kg m², ``mass`` is in kg. a_i² = S_i/(factor
    · m), S_i = I_j + I_k − I_i; without a mass the largest length is 1 in both.
    """
    lengths = np.sqrt(_second_moments(moments) / (1.0 if mass is None else mass))
    lengths = np.maximum(lengths, _THIN * lengths.max())  # a flat body is drawn with a thickness
    if mass is None:
        return dict.fromkeys(_FACTORS, lengths / lengths.max())
    return {kind: lengths / np.sqrt(factor) for kind, factor in _FACTORS.items()}


def _placed_body(trajectory: Trajectory, name: str, state_indices: Any) -> ScenePart:
    """Return a cube for a placed body, whose position alone the model gives, and no inertia.

    It has no size of its own: half its edge is 1/20 of the largest coordinate of all such bodies.
    """
    motion = trajectory.body(name)
    farthest = max(float(np.abs(trajectory.body(placed_name).position()[state_indices]).max())
                   for placed_name in placed_of(trajectory.manifest))
    size = np.full(3, farthest / 20 or 1.0)  # 1 m if all are at the origin
    return ScenePart(
        name, q=motion.attitude[state_indices], x=motion.position()[state_indices],
        centre=np.zeros(3), axes=np.eye(3), sizes=dict.fromkeys(_FACTORS, size), tip=np.zeros(3),
        to_scale=False)


def _ties(trajectory: Trajectory, parts: list[ScenePart]) -> list[Tie]:
    """Return the joints, rods and springs that a scene draws, with the bodies by their index in
    ``parts``."""
    numbered = {body.name: i for i, body in enumerate(parts)} | {"": -1}
    ties = []
    for name, (kind, joint) in drawn_joints(trajectory.manifest).items():
        on_a, on_b, axis = (numbers(e, trajectory.parameters)
                            for e in (joint.on_a, joint.on_b, joint.axis_b))
        ties.append(Tie(name, kind, numbered[joint.a], numbered[joint.b], on_a, on_b,
                        axis if joint.axis_b else None,
                        slides=kind == "hinge" and joint.slides))
    return ties


def drawn_joints(manifest: Manifest) -> dict[str, tuple[str, JointAt]]:
    """Return kind and place of the joints, rods and springs that a scene shows, by name."""
    joints = {}
    for name, joint in joints_of(manifest).items():
        if joint.pulls and all(pull.kind == "axial" for pull in joint.pulls):
            continue  # a drive, at the place of its joint
        if not (joint.on_a or joint.on_b or joint.axis_b):
            continue  # a motor or a spring of a joint, a body that rolls
        if not (joint.on_a and joint.on_b):  # an axis alone: where b is held, or its origin is
            if not joint.b or joint.on_a or joint.on_b:
                continue  # nor at a moving point
            joint = replace(joint, on_a=[0.0]*3, on_b=[0.0]*3)
        keeps_distance = joint.pulls is not None and any(
            pull.kind == "distance" for pull in joint.pulls)
        if not joint.constraints:
            kind = "spring"
        elif keeps_distance:
            kind = "rod"
        else:
            kind = "hinge" if joint.axis_b else "ball"
        joints[name] = (kind, joint)
    return joints


def _up(trajectory: Trajectory) -> Array | None:
    """Return the unit vector against gravity in space; None without gravity."""
    gravity = np.array([float(trajectory.parameters.get(f"gravity_{axis}", 0)) for axis in "xyz"])
    size = np.linalg.norm(gravity)
    return -gravity / size if size else None


def _weight_times_centre(trajectory: Trajectory, moments: Array, axes: Array) -> Array | None:
    """Return m g times the centre of mass of a body on a fixed point, in its principal axes.

    ``moments``, (3,), are those about the axes, the columns of ``axes``. V = H − T is fitted to
    c + w · (third row of R) by least squares over states of the run, with T = ½ Σ L_i²/I_i and the
    angular momentum ½ L(q) p of components L_i about these axes. None where that does not fit, so
    that the potential is another one, or where the states determine no w.
    """
    # over the whole run: one state determines no direction
    state_indices = np.unique(np.linspace(0, len(trajectory) - 1, 60).astype(int))
    q, p = (states[state_indices].astype(float) for states in (trajectory.q, trajectory.p))
    L = (left_matrix(q) @ p[..., None])[..., 0] @ axes / 2
    V = trajectory.energy()[state_indices].astype(float) - (L**2 / moments).sum(axis=1) / 2
    row = rotation_matrix(q)[:, 2]
    # w and c are four unknowns; a row that hardly turns does not determine them
    if len(state_indices) < 6 or np.ptp(row, axis=0).max() < 1e-6:
        return None
    columns = np.column_stack([row, np.ones(len(state_indices))])
    # w is 0 along directions that the motion hardly shows: singular values below 1e-9 of the first
    w, *_ = np.linalg.lstsq(columns, V, rcond=1e-9)
    size = float(np.linalg.norm(w[:3]))
    # V = H − T has the round-off of T, which may be much larger than V
    fits = np.abs(columns @ w - V).max() < 1e-6 * size
    return w[:3] @ axes if fits and size > 1e-9 * float(np.abs(V).max() + size) else None


def _rolling(manifest: Manifest) -> set[str]:
    """Return the names of rolling bodies: those with a constraint without a point or axis."""
    return {body for joint in joints_of(manifest).values() for body in (joint.a, joint.b)
            if joint.constraints and not (joint.on_a or joint.on_b or joint.axis_b)}


def _with_shapes(parts: list[ScenePart], ties: list[Tie], rolling: set[str]) -> list[ScenePart]:
    """Return the bodies with their drawn shapes, which joints and neighbours decide.

    For each body: its places at joints, whether another body lies within its box, the ends of rods.
    A body of which ``rolling`` has the name is round.
    """
    centres = np.array([body.at(body.centre)[0, 0] for body in parts])
    # the size of the scene at its start: between bodies, of a body, and from a body to its joints
    reach = max([float(np.linalg.norm(np.ptp(centres, axis=0)))]
                + [2 * float(body.sizes["box"].max()) for body in parts]
                + [2 * float(np.linalg.norm(body.centre - r)) for body, r in _points(parts, ties)])
    bodies, sizes = [], [float(body.sizes["box"].max()) for body in parts]
    for i, body in enumerate(parts):
        attachments = list(_attachments(parts, ties, sizes, i))
        R = rotation_matrix(body.q[:1])[0]
        # the centres of the others along this body's principal axes
        local = (centres - centres[i]) @ R @ body.axes
        half = body.sizes["box"]
        inside = body.name not in rolling and any(
            j != i and (np.abs(local[j]) < half).all() and neighbour.sizes["box"].max() < half.max()
            for j, neighbour in enumerate(parts))
        # the ends of rods on this body
        loose = [r for tie in ties if tie.kind == "rod"
                 for body_index, r in ((tie.a, tie.on_a), (tie.b, tie.on_b)) if body_index == i]
        shapes = shapes_of(body, attachments, reach, inside=inside, loose=loose)
        if body.name in rolling and {shape.kind for shape in shapes} == {"box"}:
            shapes = [Shape("sphere", body.sizes["ellipsoid"], body.centre, body.axes)]
        is_frame = inside and len(shapes) == 12  # the edges of a box
        bodies.append(replace(body, shapes=shapes, glass=is_frame))
    return bodies


def _attachments(
    parts: list[ScenePart], ties: list[Tie], sizes: list[float], i: int
) -> Iterator[Held]:
    """Yield the places where joints, or the ground without a joint, hold body i, in its axes.

    ``sizes`` are the largest half edges of the bodies, which decide which of two is the outer one.
    """
    for tie in ties:
        if tie.kind not in ("ball", "hinge"):
            continue
        for body, other_body, r in ((tie.a, tie.b, tie.on_a), (tie.b, tie.a, tie.on_b)):
            if body == i:
                yield Held(r, _axis_in(parts, tie, i), slides=tie.slides,
                           outer=other_body < 0 or sizes[other_body] > sizes[i])
    if is_held(parts, ties, i):
        yield Held(np.zeros(3), axis=None, outer=True, slides=False)


def is_held(parts: list[ScenePart], ties: list[Tie], i: int) -> bool:
    """Return whether the ground holds the origin of body i, which no joint is at.

    Its centre of mass is then off its origin, and the origin does not move.
    """
    body = parts[i]
    return bool(body.centre.any()) and not np.ptp(body.x, axis=0).any() and all(
        r.any() for tie in ties for k, r in ((tie.a, tie.on_a), (tie.b, tie.on_b)) if k == i)


def _axis_in(parts: list[ScenePart], tie: Tie, i: int) -> Array | None:
    """Return the axis of a hinge in the axes of body i, one of its two; None for other joints.

    ``tie.axis`` is in the axes of b, for the ground of space.
    """
    if tie.axis is None or tie.b == i:
        return tie.axis
    in_space = tie.axis if tie.b < 0 else rotation_matrix(parts[tie.b].q[0]) @ tie.axis
    axis: Array = rotation_matrix(parts[i].q[0]).T @ in_space
    return axis


def _points(parts: list[ScenePart], ties: list[Tie]) -> list[tuple[ScenePart, Array]]:
    """Return (body, point) for each end of a joint, rod or spring at a body, in its axes."""
    return [(parts[i], r) for tie in ties for i, r in ((tie.a, tie.on_a), (tie.b, tie.on_b))
            if i >= 0]


def _remarks(trajectory: Trajectory, parts: list[ScenePart], state_indices: Any) -> Any:
    """Yield sentences about the picture: unknown mass, flywheels, rotations too fast to follow."""
    if not all(body.to_scale for body in parts):
        yield "The mass is not known: the shape has the proportions of the inertia, not its size."
    for body in parts:
        if (rim := body.rim) is not None:
            yield (f"{body.name} is drawn as the flywheel that has its inertia and its weight with "
                   f"g = 9.81 m/s²: {rim.mass:.3g} kg on a rim of radius "
                   f"{rim.semi_axes.max():.3g} m, {rim.distance:.3g} m from the point.")
    t = trajectory.t[state_indices].astype(float)
    if len(t) > 1:
        bodies = bodies_of(trajectory.manifest)
        for body in (body for body in parts if body.name in bodies):
            omega = trajectory.body(body.name).angular_velocity()[state_indices]
            # |Ω| Δt from frame to frame: beyond half a turn the eye sees another rotation
            turn = np.linalg.norm(omega, axis=1)[1:] * np.abs(np.diff(t))
            if turn.max() > np.pi:
                yield (f"{body.name} turns by up to {turn.max() / (2 * np.pi):.1f} turns between "
                       "two of the pictures kept here: it seems to turn slower, or backwards.")
