"""Joints, springs and motors between frames: their constraints, energies and forces.

    ball       x_a + R(q_a) r_a − x_b − R(q_b) r_b = 0                       three
    align      R(q_a) n_k · R(q_b) e = 0,  k = 1, 2                          two
    revolute   both of these                                                 five
    rod        |x_a + R(q_a) r_a − x_b − R(q_b) r_b|² − l² = 0               one

n₁ and n₂ are two directions of a that are perpendicular to the axis, e is the axis in b. All are
polynomials of the coordinates. A component that is 0 stays 0 and costs no arithmetic. Joints with
an axis measure the angle of b relative to a, and its rate:

    angle      θ = 2 atan2(v, w),  (w, v e) = q̄_a q_b c,  smooth for |θ| < 2π
    rate       e · Ω_b − e · Ω_a

with c such that θ is 0 in the pose in which the model is described; the joint's ``angle`` moves
the bodies from there to the start. Sliding joints, gears and driven joints:

    cylindrical  align, and R(q_a) n_k · d = 0                               four
    prismatic    cylindrical, and R(q_a) n₁ · R(q_b) m₂ = 0                  five
    screw        cylindrical, and sin(θ − 2π (s − s₀)/h) = 0                 five
    planar       align, and R(q_a) e · d = 0                                 three
    fixed        ball, and R(q_a) n_k · R(q_b) m_k = 0, k = 1, 2, 3          six
    universal    ball, and R(q_a) e₁ · R(q_b) e₂ = 0                         four
    gear         sin(z₁ θ₁ + z₂ θ₂) = 0 of two joints                        one
    rheonomic    sin(f(t) − θ) = 0                                           one
    coupling     c₂ − (ratio c₁ + offset) = 0, c their angles or travels     one

d is the vector from the point of a to that of b; s = c + R(q_a) e · d is the travel, with c such
that s₀ = 0 in the pose of the description. m_k are the directions of b that are n_k at the start:
cos θ = R(q_a) n₁ · R(q_b) m₁ and sin θ = R(q_a) n₂ · R(q_b) m₁ determine the angle but for whole
turns, and so does the screw. Motors and springs act on the coordinate c of a joint:

    motor        a torque about its axis, or a force along it
    spring       V = ½ k (c − c₀)², and a damper −k_d ċ
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import ClassVar, NamedTuple

import numpy as np
import sympy as sp

from ...core.arrays import Array
from ...core.errors import InputError
from ...core.inertia import quaternion_product
from ...core.records import FixedAttributes
from ..symbolic.switching_functions import Max
from ..systems.body_layout import ConstraintForce
from .body import Body, Frame, GeneralisedForce, Vector, dot
from .initial_poses import (
    Pose,
    RigidMotion,
    clean,
    conjugate,
    direction,
    normals,
)

__all__ = [
    "FRACTION",
    "RATE_OF",
    "Align",
    "Connection",
    "Coupling",
    "Cylindrical",
    "Equation",
    "Fixed",
    "Gear",
    "HingedJoint",
    "Joint",
    "JointSpring",
    "Motor",
    "Planar",
    "PointConnection",
    "Prismatic",
    "Revolute",
    "RheonomicConstraint",
    "Rod",
    "Screw",
    "Spring",
    "StartRate",
    "StartValue",
    "Universal",
    "copies",
    "difference",
    "hinge_of",
    "named_number",
    "named_vector",
    "perpendicular",
    "unit_vector",
]

#: Frame → its pose at the start.
Poses = Mapping[Frame, Pose]
#: The values of a model's parameters by name.
Store = dict[str, float]

#: Position between the described pose, 0, and the start, 1, at which given angles are evaluated.
FRACTION = sp.Dummy("fraction", real=True)
#: Coordinate of a joint → its rate.
RATE_OF = {"angle": "rate", "travel": "speed"}
#: Angles in a ratio of such whole numbers are coupled over any number of turns.
_FEW_TEETH = 12
#: Components of unit vectors that stay numbers.
UNIT = (0.0, 1.0, -1.0)


@dataclass(frozen=True)
class Equation:
    """One constraint with its name, and its constraint force where that is known."""

    name: str
    expression: sp.Expr
    constraint_force: ConstraintForce | None = None


@dataclass(frozen=True)
class StartValue:
    """A coordinate of a joint that is given at the start, and the difference of a state from it.

    ``sine`` and ``cosine`` are sin and cos of the difference of an angle; for a travel, which has
    no ``cosine``, ``sine`` is the difference. The target is the described coordinate plus
    ``FRACTION`` times the displacement to the start.
    """

    joint: str
    measure: str
    value: float
    sine: sp.Expr
    cosine: sp.Expr | None = None


class StartRate(NamedTuple):
    """A rate given at the start: Σ (c_v·v + c_ω·ω) over bodies = ``value``.

    ``coefficients`` has (c_v, c_ω) of each body, of the lengths of its v and ω, in space.
    """

    joint: str
    value: float
    coefficients: dict[Frame, tuple[Array, Array]]


def named_vector(
    prefix: str, values: Sequence[float], store: Store, literals: Sequence[float] = (0.0,)
) -> Vector:
    """Return symbols PREFIX_x, PREFIX_y, PREFIX_z for a vector, and store their values.

    Components in ``literals`` stay numbers, so that they cost no arithmetic.
    """
    x, y, z = (named_number(f"{prefix}_{axis}", value, store, literals)
               for axis, value in zip("xyz", values, strict=True))
    return x, y, z


def propagate(quantity: str, a: Pose, b: Pose, difference: Array) -> bool:
    """Set an unknown quantity of a or b by b = a + ``difference``; return whether it was set.

    ``quantity`` is "spin", the angular velocity in space, or "v". Nothing is set where both values
    are known, or neither is.
    """
    value_a, value_b = getattr(a, quantity), getattr(b, quantity)
    if value_a is not None and value_b is None:
        setattr(b, quantity, value_a + difference)
    elif value_b is not None and value_a is None:
        setattr(a, quantity, value_b - difference)
    else:
        return False
    return True


def _short_text(link: Connection) -> str:
    """Return a short text for a joint, a rod or a spring."""
    names = [frame.name if isinstance(frame, Body) else "ground" for frame in (link.a, link.b)]
    return f"<{type(link).__name__} {link.name}: {', '.join(names)}>"


@dataclass(eq=False, repr=False)
class Connection(FixedAttributes):
    """A connection of two frames, with constraints, an energy or forces."""

    name: str
    a: Frame
    b: Frame
    #: Joints on whose coordinates the connection acts: of a motor, a spring, a gear, ….
    joints: tuple[Connection, ...] = field(default=(), kw_only=True)
    #: Names of the measures: "angle", "rate", "travel" and "speed".
    MEASURES: ClassVar[tuple[str, ...]] = ()
    _CURE = "give the method that adds it another argument"
    _REASSIGNED = True

    @property
    def displacement(self) -> float:
        """Change of the coordinate from the described pose to the start: 0 unless it is given."""
        return 0.0

    def __repr__(self) -> str:
        return _short_text(self)

    @property
    def frames(self) -> tuple[Frame, ...]:
        """All frames that the constraints and forces contain."""
        return (self.a, self.b, *(frame for joint in self.joints for frame in joint.frames))

    def motion(self, poses: Poses) -> RigidMotion:
        """Return the motion of b against a from the described pose to the start: none."""
        return RigidMotion.along(np.zeros(3))

    def start_values(self, poses: Poses, store: Store) -> Iterator[StartValue]:
        """Yield the coordinates that are given for the start: none."""
        yield from ()

    def start_rates(self, poses: Poses) -> Iterator[StartRate]:
        """Yield the rates that are given for the start: none."""
        yield from ()

    def propagate_spin(self, poses: Poses) -> bool:
        """Set ω of a or b in space from the other one's, with 0 for rates that are not given.

        Return whether it was set: not where both are known, or neither is.
        """
        return False

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints, none; values of their parameters go into ``store``."""
        yield from ()

    def energy(self, store: Store) -> sp.Expr:
        """Return V, 0; values of its parameters go into ``store``."""
        return sp.Integer(0)

    def local_points(self, store: Store) -> tuple[Sequence[sp.Expr], Sequence[sp.Expr]]:
        """Return the point of the connection in the axes of a and of b, () without a point."""
        return (), ()

    def axes(self, poses: Poses, store: Store) -> tuple[Sequence[sp.Expr], Sequence[sp.Expr]]:
        """Return n₁ and n₂ in a's axes, six entries, and n₁ × n₂ in b's; () without an axis."""
        return (), ()

    def forces(self, poses: Poses, store: Store) -> Iterator[GeneralisedForce]:
        """Yield forces, none; values of their parameters go into ``store``."""
        yield from ()

    def measure(self, quantity: str, poses: Poses, store: Store) -> sp.Expr:
        """Return one of ``MEASURES`` as an expression in q and p."""
        raise InputError(f"{self.name!r} has no {quantity}.")

    def multiple_angle(self, count: int, poses: Poses, store: Store) -> tuple[sp.Expr, sp.Expr]:
        """Return cos kθ and sin kθ of the turn θ since the described pose, k = ``count``."""
        return multiple(count, *cosine_and_sine(hinge_of(self), poses, store))

    def generalised_forces(
        self, quantity: str, effort: sp.Expr, poses: Poses, store: Store
    ) -> Iterator[GeneralisedForce]:
        """Yield the generalised forces of an effort on a measure: on b, its opposite on a.

        The effort is a torque in N m on an angle, a force in N on a travel.
        """
        raise InputError(f"{self.name!r} has no {quantity}.")


@dataclass(eq=False, repr=False)
class PointConnection(Connection):
    """A connection at a point of each frame, as ball joints, rods and springs are.

    ``on_a`` and ``on_b`` are in body axes, from the origin of the body.
    """

    on_a: Array | None = None
    on_b: Array | None = None

    def local_points(self, store: Store) -> tuple[Vector, Vector]:
        """Return both points in the axes of their frames; their components become parameters."""
        points = []
        for frame, r in ((self.a, self.on_a), (self.b, self.on_b)):
            assert r is not None
            suffix = frame.name if isinstance(frame, Body) else ""
            # a joint on the ground with the name of a body: NAME_x is a coordinate of the body
            if not suffix and self.name in (getattr(e, "name", "") for e in self.frames):
                suffix = "ground"
            prefix = f"{self.name}_{suffix}" if suffix else self.name
            points.append(named_vector(prefix, r.tolist(), store))
        return points[0], points[1]

    def points(self, store: Store) -> tuple[Vector, Vector]:
        """Return both points in space as expressions."""
        on_a, on_b = self.local_points(store)
        return self.a.point(on_a), self.b.point(on_b)

    def square(self, store: Store) -> sp.Expr:
        """Return the squared distance of the joint's points of a and of b."""
        point_a, point_b = self.points(store)
        return sum(((x - y) ** 2 for x, y in zip(point_a, point_b, strict=True)), sp.Integer(0))

    def distance(self, poses: Poses) -> float:
        """Return the distance of the points at the start."""
        assert self.on_a is not None
        assert self.on_b is not None
        separation = poses[self.a].space(self.on_a) - poses[self.b].space(self.on_b)
        return float(np.linalg.norm(separation))


@dataclass(eq=False, repr=False)
class Joint(PointConnection):
    """A ball joint: two points coincide, at the position ``at`` in space in the described pose.

    Two of at, on_a and on_b determine the third; one is enough if both bodies have a position.
    """

    at: Array | None = None

    def propagate_point(self, poses: Poses) -> bool:
        """Propagate the point of the joint and positions of bodies; return whether one was set.

        x_a + R_a r_a = at = x_b + R_b r_b: each unknown follows from the others.
        """
        was_set = False
        sides = ((self.a, "on_a"), (self.b, "on_b"))
        for frame, side in sides:
            pose, r = poses[frame], getattr(self, side)
            if self.at is None and r is not None and pose.x is not None:
                self.at, was_set = pose.space(r), True
        for frame, side in sides if self.at is not None else ():
            pose, r = poses[frame], getattr(self, side)
            if r is None and pose.x is not None:
                # components that cancel to round-off are 0, and cost no parameter
                pivot = np.asarray(self.at)
                setattr(self, side, clean(pose.R.T @ (pivot - pose.x), pivot, pose.x))
                was_set = True
            elif r is not None and pose.x is None:
                pose.x, was_set = self.at - pose.R @ r, True
        return was_set

    def propagate_velocity(self, poses: Poses) -> bool:
        """Propagate the velocity of the common point; return whether a velocity was set.

        v_b = v_a + ω_a × (x_P − x_a) − ω_b × R_b r_b + u, with P the point of b, r_b in the axes
        of b, and u = ``relative_velocity``.
        """
        a, b = poses[self.a], poses[self.b]
        assert a.spin is not None
        assert b.spin is not None
        arm_a, arm_b = a.R @ self.on_a, b.R @ self.on_b
        assert a.x is not None
        assert b.x is not None
        # the points of a joint that slides may be apart
        separation = b.x + arm_b - a.x - arm_a
        turning = np.cross(a.spin, arm_a + separation) - np.cross(b.spin, arm_b)
        return propagate("v", a, b, turning + self.relative_velocity(poses))

    def relative_velocity(self, poses: Poses) -> Array:
        """Return the velocity of the point of b relative to that of a at the start, 0."""
        return np.zeros(3)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the components of x_a + R(q_a) r_a − x_b − R(q_b) r_b = 0."""
        for k, (x, y) in enumerate(zip(*self.points(store), strict=True)):
            yield Equation(f"{self.name}: {'xyz'[k]}", x - y,
                           ConstraintForce("force", coordinate_axis(k)))


@dataclass(eq=False, repr=False)
class Align(Connection):
    """A and b keep an axis in common; ``axis`` is a unit vector in space in the described pose.

    ``angle`` is the angle of b against a there; ``start_angle`` and ``rate`` are the values given
    for the start, None where they follow.
    """

    axis: Array
    rate: float | None = None
    angle: float = 0.0
    start_angle: float | None = None
    MEASURES = ("angle", "rate")

    @property
    def displacement(self) -> float:
        """The angle by which b turns against a from the described pose to the start."""
        return 0.0 if self.start_angle is None else self.start_angle - self.angle

    def axis_at(self, poses: Poses) -> Array:
        """Return the axis in space at the start."""
        return poses[self.a].motion.direction(self.axis)

    def motion(self, poses: Poses) -> RigidMotion:
        """Return the rotation about the axis, through the origin of b."""
        x = poses[self.b].x
        assert x is not None
        return RigidMotion.about(self.axis, self.displacement, x)

    def start_values(self, poses: Poses, store: Store) -> Iterator[StartValue]:
        """Yield the angle, if it is given for the start."""
        if self.start_angle is not None:
            c, s = cosine_and_sine(self, poses, store)
            # the angle θ against the described pose, whose sin and cos are s and c, is led to the
            # start: FRACTION goes from 0 to 1
            target = FRACTION * self.displacement
            # sin and cos of θ − target: polynomials of the coordinates, so that the closing of
            # loops has no jump at θ = π
            yield StartValue(self.name, "angle", self.start_angle,
                             sine=s * sp.cos(target) - c * sp.sin(target),
                             cosine=c * sp.cos(target) + s * sp.sin(target))

    def start_rates(self, poses: Poses) -> Iterator[StartRate]:
        """Yield the rate e·(ω_b − ω_a), if it is given for the start."""
        if self.rate is not None:
            e, zero = self.axis_at(poses), np.zeros(3)
            yield StartRate(self.name, self.rate, {self.a: (zero, -e), self.b: (zero, e)})

    def propagate_spin(self, poses: Poses) -> bool:
        """Propagate the angular velocity in space: ω_b = ω_a + rate · axis."""
        rate = (self.rate or 0.0) * self.axis_at(poses)
        return propagate("spin", poses[self.a], poses[self.b], rate)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield R(q_a) n_k · R(q_b) e = 0, k = 1, 2."""
        # the axis is perpendicular to two directions of a; e · e' = 1 would be one equation with a
        # gradient that vanishes where it holds
        normals_of_a, axis = self.axes(poses, store)
        for k, n in enumerate((normals_of_a[:3], normals_of_a[3:]), start=1):
            yield perpendicular(f"{self.name}: axis {k}", self.a, n, self.b, axis)

    def axes(self, poses: Poses, store: Store) -> tuple[Sequence[sp.Expr], Sequence[sp.Expr]]:
        """Return n₁ and n₂ in a's axes and n₁ × n₂, the axis, in b's."""
        in_a, in_b = (direction(poses[frame].R.T @ self.axis) for frame in (self.a, self.b))
        axis = unit_vector(f"{self.name}_axis", in_b, store)
        n1, n2 = (unit_vector(f"{self.name}_normal{k}", normal, store)
                  for k, normal in enumerate(normals(in_a), start=1))
        return (*n1, *n2), axis

    def ends(self, poses: Poses, store: Store) -> tuple[Vector, Vector]:
        """Return the axis in the axes of a and in those of b."""
        in_a, in_b = (direction(poses[frame].R.T @ self.axis) for frame in (self.a, self.b))
        return (unit_vector(f"{self.name}_axis_a", in_a, store),
                unit_vector(f"{self.name}_axis", in_b, store))

    def measure(self, quantity: str, poses: Poses, store: Store) -> sp.Expr:
        """Return the angle 2 atan2(e·v, w), (w, v) = q̄_a q_b c, or the rate e_b·Ω_b − e_a·Ω_a.

        c is the quaternion of ``zero``; e_a and e_b are the axis in the axes of a and b.
        """
        in_a, in_b = self.ends(poses, store)
        if quantity == "rate":
            return dot(in_b, self.b.angular_velocity) - dot(in_a, self.a.angular_velocity)
        # the quaternion has half the angle, so that θ is smooth for |θ| < 2π
        *c, full_turns = self.zero(poses, store)
        w, *v = quaternion_product(
            conjugate(self.a.attitude), quaternion_product(self.b.attitude, c))
        return full_turns + 2 * sp.atan2(dot(in_a, (v[0], v[1], v[2])), w)

    def generalised_forces(
        self, quantity: str, effort: sp.Expr, poses: Poses, store: Store
    ) -> Iterator[GeneralisedForce]:
        """Yield the generalised forces of a torque about the axis."""
        in_a, in_b = self.ends(poses, store)
        yield from self.b.torque_on([effort * e for e in in_b])
        yield from self.a.torque_on([-effort * e for e in in_a])

    @property
    def _full_turns(self) -> float:
        """The multiple of 2π nearest to the angle at the start, in rad."""
        angle = self.angle if self.start_angle is None else self.start_angle
        return 2 * math.pi * round(angle / (2 * math.pi))

    def zero(self, poses: Poses, store: Store) -> tuple[sp.Expr, ...]:
        """Return the four entries of c, and the full turns in rad, as parameters or numbers.

        q̄_a q_b c is the rotation of b against a by the joint's angle φ. In the described pose
        φ = ``angle``, so that c = q̄_b q_a (cos φ/2, e sin φ/2) there.
        """
        pose_a, pose_b = poses[self.a], poses[self.b]
        # the quaternion has the angle but for full turns, which are a parameter of their own
        half = (self.angle - self._full_turns) / 2
        described_turn = [math.cos(half), *(math.sin(half) * (pose_a.R.T @ self.axis))]
        c = direction(np.array(
            quaternion_product(conjugate(pose_b.q), pose_a.q, described_turn)))
        return (*(named_number(f"{self.name}_before{k}", x, store, UNIT)
                  for k, x in enumerate(c.tolist())),
                named_number(f"{self.name}_turns", self._full_turns, store))


@dataclass(eq=False, repr=False)
class HingedJoint(Joint):
    """A joint whose bodies have an axis in common, the axis of ``hinge``, about which b turns."""

    hinge: Align = field(kw_only=True)
    MEASURES: ClassVar[tuple[str, ...]] = Align.MEASURES

    @property
    def displacement(self) -> float:
        """The angle by which b turns against a from the described pose to the start."""
        return self.hinge.displacement

    def motion(self, poses: Poses) -> RigidMotion:
        """Return the rotation about the axis."""
        assert self.on_a is not None
        return RigidMotion.about(self.hinge.axis, self.displacement, poses[self.a].space(self.on_a))

    def start_values(self, poses: Poses, store: Store) -> Iterator[StartValue]:
        """Yield the angle."""
        return self.hinge.start_values(poses, store)

    def start_rates(self, poses: Poses) -> Iterator[StartRate]:
        """Yield the rate."""
        return self.hinge.start_rates(poses)

    def propagate_spin(self, poses: Poses) -> bool:
        """Propagate the angular velocity as ``Align`` does."""
        return self.hinge.propagate_spin(poses)

    def axes(self, poses: Poses, store: Store) -> tuple[Sequence[sp.Expr], Sequence[sp.Expr]]:
        """Return the axes of the hinge."""
        return self.hinge.axes(poses, store)

    def measure(self, quantity: str, poses: Poses, store: Store) -> sp.Expr:
        """Return the angle or the rate."""
        return self.hinge.measure(quantity, poses, store)

    def generalised_forces(
        self, quantity: str, effort: sp.Expr, poses: Poses, store: Store
    ) -> Iterator[GeneralisedForce]:
        """Yield the generalised forces of a torque about the axis."""
        return self.hinge.generalised_forces(quantity, effort, poses, store)


@dataclass(eq=False, repr=False)
class Revolute(HingedJoint):
    """A hinge: a ball joint whose bodies keep an axis in common."""

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints of a ball joint and of the axis."""
        yield from super().equations(poses, store)
        yield from self.hinge.equations(poses, store)


@dataclass(eq=False, repr=False)
class Fixed(Joint):
    """b does not move against a; ``relative`` is R_aᵀ R_b, by default as in the described pose."""

    relative: Array | None = field(kw_only=True, default=None)

    def propagate_spin(self, poses: Poses) -> bool:
        """Propagate the angular velocity in space: ω_b = ω_a."""
        return propagate("spin", poses[self.a], poses[self.b], np.zeros(3))

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints of a ball joint and of ``turns``."""
        yield from super().equations(poses, store)
        yield from self.turns(poses, store)

    def refuse_half_turn(self, described: Poses, poses: Poses, cure: str) -> None:
        """Refuse poses in which b is turned by π, where the constraints hold, too.

        The rotation by θ from the attitude that the joint holds to that of ``poses`` has the trace
        1 + 2 cos θ: 3 for θ = 0, −1 after half a turn. ``cure`` ends the message.
        """
        if np.trace(self.rotation(described).T @ self.rotation(poses, is_given=False)) < 0:
            raise InputError(f"Joint {self.name!r} fixes its bodies at a rotation of more than "
                             f"120 degrees from {cure}.")

    def rotation(self, poses: Poses, is_given: bool = True) -> Array:
        """Return R_aᵀ R_b of poses, or ``relative`` if that is set and ``is_given`` asks for it."""
        if is_given and self.relative is not None:
            return self.relative
        matrix: Array = poses[self.a].R.T @ poses[self.b].R
        return matrix

    def turns(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield n_k · m_k = 0, k = 1, 2, 3, with n_k the axes of a and m_k = n_{k+1} fixed in b.

        Equation k holds b against turns about n_{k+2}, normal to both, whose name it has.
        """
        # near the relative rotation R the three gradients are the axes: independent
        R = self.rotation(poses)
        for k, axis in enumerate("zxy"):
            n = unit_vector(f"{self.name}_normal{k + 1}", np.eye(3)[k], store)
            m = unit_vector(f"{self.name}_mark{k + 1}", direction(R.T[:, (k + 1) % 3]), store)
            yield perpendicular(f"{self.name}: turn {axis}", self.a, n, self.b, m)


@dataclass(eq=False, repr=False)
class Rod(PointConnection):
    """Two points at a constant distance, by default their distance at the start."""

    length: float | None = None

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield |x_a + R(q_a) r_a − x_b − R(q_b) r_b|² − l² = 0; l goes into ``store``."""
        length = sp.Symbol(f"{self.name}_length", positive=True)
        store[str(length)] = self.distance(poses) if self.length is None else self.length
        yield Equation(f"{self.name}: length", self.square(store) - length**2,
                       ConstraintForce("distance"))


@dataclass(eq=False, repr=False)
class Spring(PointConnection):
    """V = ½ k (|d| − l)² between two points, ½ k d·d for l = 0, and a damper with force c d|d|/dt.

    ``stiffness`` k in N/m, ``length`` l in m, ``damping`` c in N s/m.
    """

    stiffness: float = 0.0
    length: float = 0.0
    damping: float = 0.0

    def energy(self, store: Store) -> sp.Expr:
        """Return V = ½ k (|d| − l)²; values of its parameters go into ``store``."""
        k = sp.Symbol(f"{self.name}_stiffness", real=True)
        store[str(k)] = self.stiffness
        # without a rest length V = ½ k d·d is a polynomial, and smooth where the points meet
        if not self.length:
            return k * self.square(store) / 2
        length = sp.Symbol(f"{self.name}_length", positive=True)
        store[str(length)] = self.length
        return k * (sp.sqrt(self.square(store)) - length) ** 2 / 2

    def forces(self, poses: Poses, store: Store) -> Iterator[GeneralisedForce]:
        """Yield the force c d (d·ḋ)/|d|² on a, and its opposite on b."""
        if not self.damping:
            return
        c = named_number(f"{self.name}_damping", self.damping, store)
        on_a, on_b = self.local_points(store)
        d = difference(self.b.point(on_b), self.a.point(on_a))
        speed = difference(self.b.point_velocity(on_b), self.a.point_velocity(on_a))
        # c d (d·ḋ)/(d·d): the speed along d, without the root in |d|
        x, y, z = (c * dot(d, speed) / dot(d, d) * e for e in d)
        yield from self.a.force_at(on_a, (x, y, z))
        yield from self.b.force_at(on_b, (-x, -y, -z))


def copies(links: Sequence[Connection]) -> dict[Connection, Connection]:
    """Return connection → its copy; copies refer to each other as the originals do."""
    copy_of = {link: replace(link) for link in links}
    for copy in copy_of.values():
        copy.joints = tuple(copy_of[joint] for joint in copy.joints)
    return copy_of


def difference(a: Vector, b: Vector) -> Vector:
    """Return a − b."""
    x, y, z = (e - f for e, f in zip(a, b, strict=True))
    return x, y, z


def named_number(
    name: str, value: float, store: Store, literals: Sequence[float] = (0.0,)
) -> sp.Expr:
    """Return a symbol for a number and store its value; one of ``literals`` stays a number."""
    if value in literals:
        return sp.Integer(int(value))
    store[name] = float(value)
    return sp.Symbol(name, real=True)


def unit_vector(name: str, unit: Array, store: Store) -> Vector:
    """Return symbols for a unit vector, in which 0, 1 and −1 stay numbers; see named_vector."""
    return named_vector(name, unit.tolist(), store, UNIT)


def coordinate_axis(k: int) -> tuple[float, ...]:
    """Return the unit vector along coordinate axis k = 0, 1, 2."""
    return tuple(map(float, np.eye(3)[k]))


def perpendicular(
    name: str, a: Frame, n: Sequence[sp.Expr], b: Frame, e: Sequence[sp.Expr]
) -> Equation:
    """Return the constraint (R_a n)·(R_b e) = 0: a direction of a is perpendicular to one of b."""
    return Equation(name, dot(a.direction(n), b.direction(e)),
                    ConstraintForce("torque", tuple(n), tuple(e)))


@dataclass(eq=False, repr=False)
class Planar(HingedJoint):
    """A plane of b that slides on one of a, normal to the axis of ``hinge``."""

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints of the axis, and R(q_a) e · d = 0."""
        yield from self.hinge.equations(poses, store)
        in_a, _ = self.hinge.ends(poses, store)
        yield Equation(f"{self.name}: distance", self.along(poses, store),
                       ConstraintForce("normal", in_a))

    def along(self, poses: Poses, store: Store) -> sp.Expr:
        """Return R(q_a) e · d, with the axis e and the vector d between the points."""
        in_a, _ = self.hinge.ends(poses, store)
        return dot(self.a.direction(in_a), self.offset(store))

    def offset(self, store: Store) -> Vector:
        """Return d, in space, from the point of a to the point of b."""
        point_a, point_b = self.points(store)
        return difference(point_b, point_a)


@dataclass(eq=False, repr=False)
class Cylindrical(Planar):
    """b turns about an axis of a and slides along it.

    ``travel`` in m is the travel in the described pose; ``start_travel`` and ``speed`` are given
    for the start, None where they follow.
    """

    speed: float | None = None
    travel: float = 0.0
    start_travel: float | None = None
    MEASURES: ClassVar[tuple[str, ...]] = (*Align.MEASURES, "travel", "speed")

    @property
    def travel_to_start(self) -> float:
        """Travel of b along the axis from the described pose to the start."""
        return 0.0 if self.start_travel is None else self.start_travel - self.travel

    def motion(self, poses: Poses) -> RigidMotion:
        """Return the translation along the axis after the rotation about it."""
        return RigidMotion.along(self.travel_to_start * self.hinge.axis) @ super().motion(poses)

    def start_values(self, poses: Poses, store: Store) -> Iterator[StartValue]:
        """Yield angle and travel, if they are given for the start."""
        yield from super().start_values(poses, store)
        if self.start_travel is not None:
            travel = self.measure("travel", poses, store)
            yield StartValue(self.name, "travel", self.start_travel,
                             travel - self.travel - FRACTION * self.travel_to_start)

    def start_rates(self, poses: Poses) -> Iterator[StartRate]:
        """Yield the equations of ``rate`` and ``speed`` for the velocities v and ω of the bodies.

        Speed: e·(v_b + ω_b × r_b) − e·(v_a + ω_a × r_a) = speed, with r from a body's origin to
        the point of b. The factors of (v, ω) are (e, r × e), as e·(ω × r) = (r × e)·ω.
        """
        yield from super().start_rates(poses)
        if self.speed is not None:
            a, b, e = poses[self.a], poses[self.b], self.hinge.axis_at(poses)
            point = b.space(np.asarray(self.on_b))
            yield StartRate(self.name, self.speed, {
                self.a: (-e, -np.cross(point - np.asarray(a.x), e)),
                self.b: (e, np.cross(point - np.asarray(b.x), e))})

    def relative_velocity(self, poses: Poses) -> Array:
        """Return the velocity of the point of b relative to that of a at the start."""
        return (self.speed or 0.0) * self.hinge.axis_at(poses)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints of the axis, and R(q_a) n_k · d = 0, k = 1, 2."""
        yield from self.hinge.equations(poses, store)
        d = self.offset(store)
        for k, normal in enumerate(self.triad(poses)[:2], start=1):
            n = unit_vector(f"{self.name}_normal{k}", normal, store)
            yield Equation(f"{self.name}: across {k}", dot(self.a.direction(n), d),
                           ConstraintForce("normal", n))

    def triad(self, poses: Poses) -> tuple[Array, Array]:
        """Return n₁ and n₂ in the axes of a, unit vectors perpendicular to the joint's axis."""
        return normals(direction(poses[self.a].R.T @ self.hinge.axis))

    def _offset(self, poses: Poses, travel: float) -> float:
        """Return ``travel`` − e·d of the described pose, so that e·d + offset is ``travel`` there.
        """
        a, b = (poses[frame] for frame in (self.a, self.b))
        point_a, point_b = a.space(np.asarray(self.on_a)), b.space(np.asarray(self.on_b))
        offset = travel - float(self.hinge.axis @ (point_b - point_a))
        # a sum that cancels to round-off is 0, so that it costs no parameter and no arithmetic
        return float(clean(np.array([offset]), np.array([travel]), point_a, point_b)[0])

    def measure(self, quantity: str, poses: Poses, store: Store) -> sp.Expr:
        """Return angle, rate, travel or speed.

        The travel is e·d + offset for the axis e and the vector d between the points, and begins
        at ``self.travel``; the speed is e·(v_b − v_a), as ė·d = 0 with d along e.
        """
        if quantity == "travel":
            offset = named_number(f"{self.name}_offset", self._offset(poses, self.travel), store)
            return offset + self.along(poses, store)
        if quantity == "speed":
            (in_a, _), (on_a, on_b) = self.hinge.ends(poses, store), self.local_points(store)
            relative = difference(self.b.point_velocity(on_b), self.a.point_velocity(on_a))
            return dot(self.a.direction(in_a), relative)
        return super().measure(quantity, poses, store)

    def generalised_forces(
        self, quantity: str, effort: sp.Expr, poses: Poses, store: Store
    ) -> Iterator[GeneralisedForce]:
        """Yield the generalised forces of a torque about the axis, or of a force along it."""
        if quantity not in ("travel", "speed"):
            yield from super().generalised_forces(quantity, effort, poses, store)
            return
        (in_a, in_b), (on_a, on_b) = self.hinge.ends(poses, store), self.local_points(store)
        for frame, e, r, sign in ((self.a, in_a, on_a, -1), (self.b, in_b, on_b, 1)):
            x, y, z = (sign * effort * c for c in frame.direction(e))
            yield from frame.force_at(r, (x, y, z))


@dataclass(eq=False, repr=False)
class Prismatic(Cylindrical):
    """b slides along an axis of a and does not turn."""

    MEASURES: ClassVar[tuple[str, ...]] = ("travel", "speed")

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints of ``Cylindrical``, and R(q_a) n₁ · R(q_b) m₂ = 0."""
        yield from super().equations(poses, store)
        n1, n2 = self.triad(poses)
        n = unit_vector(f"{self.name}_normal1", n1, store)
        # n₂ as a direction of b: it stays perpendicular to n₁ of a while b does not turn
        m = unit_vector(f"{self.name}_mark", change_axes(poses[self.a], n2, poses[self.b]), store)
        yield perpendicular(f"{self.name}: turn", self.a, n, self.b, m)


@dataclass(eq=False, repr=False)
class Screw(Cylindrical):
    """b turns about an axis of a and moves along it by h = ``lead`` a turn, in m.

    The angles of ``hinge`` are 2π/h times the travels.
    """

    lead: float = field(kw_only=True)

    def start_values(self, poses: Poses, store: Store) -> Iterator[StartValue]:
        """Yield the travel, if it is given for the start; the thread gives the angle."""
        yield from (value for value in super().start_values(poses, store)
                    if value.measure == "travel")

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints of ``Cylindrical``, and sin(θ − 2π (s − s₀)/h) = 0 of the travel s.

        θ is the turn since the described pose and s₀ the travel there. Values of parameters go into
        ``store``.
        """
        yield from super().equations(poses, store)
        # the turn and s − s₀ are 0 in the described pose, where the points may be apart
        start = named_number(f"{self.name}_thread_offset", self._offset(poses, 0.0), store)
        phi = self._angle_by_length(store) * (start + self.along(poses, store))
        cosine, sine = cosine_and_sine(self.hinge, poses, store)
        in_a, _ = self.hinge.ends(poses, store)
        lead = named_number(f"{self.name}_lead", self.lead, store)
        yield Equation(f"{self.name}: thread", sine * sp.cos(phi) - cosine * sp.sin(phi),
                       ConstraintForce("thread", in_a, (lead,)))

    def measure(self, quantity: str, poses: Poses, store: Store) -> sp.Expr:
        """Return angle, rate, travel or speed; the angle is 2π s/h, for any number of turns."""
        if quantity == "angle":
            return self._angle_by_length(store) * super().measure("travel", poses, store)
        return super().measure(quantity, poses, store)

    def _angle_by_length(self, store: Store) -> sp.Expr:
        """Return 2π/h with the lead h as a parameter."""
        return 2 * sp.pi / named_number(f"{self.name}_lead", self.lead, store)

    def relative_velocity(self, poses: Poses) -> Array:
        """Return the velocity of the point of b relative to that of a at the start."""
        speed = (self.hinge.rate or 0.0) * self.lead / (2 * math.pi)
        return speed * self.hinge.axis_at(poses)


@dataclass(eq=False, repr=False)
class Universal(Joint):
    """A ball joint whose cross keeps an axis of a perpendicular to one of b: Cardan's joint.

    ``arms`` are the axes of a and of b in space in the described pose; ``rates`` are the rates
    about them at the start, None where they follow.
    """

    arms: tuple[Array, Array] = field(kw_only=True)
    rates: tuple[float | None, float | None] = (None, None)

    def start_rates(self, poses: Poses) -> Iterator[StartRate]:
        """Yield the rates e·(ω_b − ω_a) about both arms that are given for the start."""
        zero = np.zeros(3)
        for frame, arm, rate in zip((self.a, self.b), self.arms, self.rates, strict=True):
            if rate is not None:
                e = poses[frame].motion.direction(arm)
                yield StartRate(self.name, rate, {self.a: (zero, -e), self.b: (zero, e)})

    def propagate_spin(self, poses: Poses) -> bool:
        """Propagate the angular velocity in space: ω_b = ω_a + the rates about both arms."""
        about_arm_a, about_arm_b = (
            (rate or 0.0) * poses[frame].motion.direction(arm) for frame, arm, rate
            in zip((self.a, self.b), self.arms, self.rates, strict=True))
        return propagate("spin", poses[self.a], poses[self.b], about_arm_a + about_arm_b)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints of a ball joint, and R(q_a) e₁ · R(q_b) e₂ = 0."""
        yield from super().equations(poses, store)
        x, y = (unit_vector(f"{self.name}_arm_{side}", direction(poses[frame].R.T @ arm), store)
                for frame, side, arm in zip((self.a, self.b), "ab", self.arms, strict=True))
        yield perpendicular(f"{self.name}: cross", self.a, x, self.b, y)


@dataclass(eq=False, repr=False)
class Gear(Connection):
    """Gears in mesh on two joints: z₁ θ₁ + z₂ θ₂ is constant."""

    teeth: tuple[int, int] = field(kw_only=True)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield sin(z₁ θ₁ + z₂ θ₂ − φ) = 0, φ its value at the start; φ goes into ``store``."""
        # multiples by the addition theorem: the same after any number of turns
        cosine, sine = sum_of_angles(*(
            joint.multiple_angle(z, poses, store)
            for z, joint in zip(self.teeth, self.joints, strict=True)))
        phase = sum(z * joint.displacement for z, joint in zip(
            self.teeth, self.joints, strict=True))
        phi = named_number(f"{self.name}_phase", phase, store)
        yield Equation(f"{self.name}: mesh", sine * sp.cos(phi) - cosine * sp.sin(phi))


@dataclass(eq=False, repr=False)
class RheonomicConstraint(Connection):
    """A driven hinge: its angle φ is a law of t, sin(f(t) − φ) = 0, and starts at f(0).

    The multiplier is the driving torque on the second body of the joint, about its axis.
    """

    law: sp.Expr = field(kw_only=True)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield sin(f(t) − f₀ − θ) = 0, θ the turn and f₀ the angle of the described pose.

        f is the ``law``. Values of parameters go into ``store``.
        """
        hinge = hinge_of(self)
        c, s = cosine_and_sine(hinge, poses, store)
        # in cos θ and sin θ it is the same for any number of turns
        target = self.law - named_number(f"{self.name}_begin", hinge.angle, store)
        yield Equation(f"{self.name}: angle", c * sp.sin(target) - s * sp.cos(target),
                       ConstraintForce("axial", hinge.ends(poses, store)[0]))

    def axes(self, poses: Poses, store: Store) -> tuple[Sequence[sp.Expr], Sequence[sp.Expr]]:
        """Return the axes of the hinge."""
        return hinge_of(self).axes(poses, store)


@dataclass(eq=False, repr=False)
class Coupling(Connection):
    """Coupling of two coordinates: c₂ = ratio · c₁ + offset.

    ``quantities`` are the measures c₁ and c₂ of the two joints: "angle" or "travel".
    """

    quantities: tuple[str, str] = field(kw_only=True)
    ratio: float = field(kw_only=True)
    offset: float = field(kw_only=True)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield c₂ − k c₁ − offset = 0, k = ``ratio``; values of its parameters go into ``store``.
        """
        # For a ratio z/n of small numbers it is a condition on sines of multiples of the angles,
        # which full turns do not change. Any other ratio needs the angle itself, which the
        # coordinates determine only within a full turn. By ``repr``, 0.1 is 1/10.
        ratio = Fraction(repr(self.ratio)).limit_denominator(_FEW_TEETH)
        has_few_teeth = float(ratio) == self.ratio and 0 < abs(ratio.numerator) <= _FEW_TEETH
        are_hinges = all(isinstance(joint, Align | HingedJoint) for joint in self.joints)
        if are_hinges and self.quantities == ("angle", "angle") and has_few_teeth:
            yield Equation(f"{self.name}: ratio", self._sine_of_turns(ratio, poses, store))
            return
        c1, c2 = (joint.measure(quantity, poses, store)
                  for joint, quantity in zip(self.joints, self.quantities, strict=True))
        k = named_number(f"{self.name}_ratio", self.ratio, store, UNIT)
        offset = named_number(f"{self.name}_offset", self.offset, store)
        yield Equation(f"{self.name}: ratio", c2 - k * c1 - offset)

    def _sine_of_turns(self, ratio: Fraction, poses: Poses, store: Store) -> sp.Expr:
        """Return sin(n θ₂ − z θ₁ − φ) for a ratio z/n: 0 whatever the number of turns.

        θ₁ and θ₂ are the turns since the described pose, φ follows from the angles there.
        """
        joint1, joint2 = self.joints
        z, n = ratio.numerator, ratio.denominator
        cosine, sine = sum_of_angles(*(joint.multiple_angle(k, poses, store)
                                       for k, joint in ((-z, joint1), (n, joint2))))
        # ``multiple_angle`` counts from the description, where the joints have angles of their own
        angle = n * self.offset + z * hinge_of(joint1).angle - n * hinge_of(joint2).angle
        phi = named_number(f"{self.name}_phase", angle, store)
        return sine * sp.cos(phi) - cosine * sp.sin(phi)


@dataclass(eq=False, repr=False)
class Motor(Connection):
    """A torque in N m, or a force in N, on the coordinate of a joint: the expression ``effort``.

    ``quantity`` is the measure on which it acts: "angle" or "travel".
    """

    quantity: str = field(kw_only=True)
    effort: sp.Expr = field(kw_only=True)

    def forces(self, poses: Poses, store: Store) -> Iterator[GeneralisedForce]:
        """Yield the generalised forces on both bodies."""
        yield from self.joints[0].generalised_forces(self.quantity, self.effort, poses, store)


@dataclass(eq=False, repr=False)
class JointSpring(Connection):
    """V = ½ k d² with the distance d of a joint's coordinate from rest, and a damper.

    ``quantity`` is the measure "angle" or "travel", ``coordinate`` its symbol and ``rate`` the
    symbol of its rate; k is ``stiffness`` in N m/rad or N/m, ``damping`` is in N m s/rad or N s/m.
    ``rest`` is a number in rad or m, or an interval (lower, upper), in which the spring is slack: d
    is the distance from the interval.
    """

    quantity: str = field(kw_only=True)
    coordinate: sp.Symbol = field(kw_only=True)
    rate: sp.Symbol = field(kw_only=True)
    stiffness: float = 0.0
    damping: float = 0.0
    rest: float | tuple[float, float] = 0.0

    def energy(self, store: Store) -> sp.Expr:
        """Return V = ½ k d²; values of its parameters go into ``store``."""
        k = named_number(f"{self.name}_stiffness", self.stiffness, store)
        if isinstance(self.rest, tuple):
            lower, upper = (named_number(f"{self.name}_{end}", value, store)
                            for end, value in zip(("lower", "upper"), self.rest, strict=True))
            return k * (Max(0, self.coordinate - upper) ** 2
                        + Max(0, lower - self.coordinate) ** 2) / 2
        rest_position = named_number(f"{self.name}_rest", self.rest, store)
        return k * (self.coordinate - rest_position) ** 2 / 2

    def forces(self, poses: Poses, store: Store) -> Iterator[GeneralisedForce]:
        """Yield the generalised forces of the damper on both bodies."""
        if self.damping:
            c = named_number(f"{self.name}_damping", self.damping, store)
            (joint,) = self.joints
            yield from joint.generalised_forces(self.quantity, -c * self.rate, poses, store)


def cosine_and_sine(hinge: Align, poses: Poses, store: Store) -> tuple[sp.Expr, sp.Expr]:
    """Return cos θ = n₁·m₁ and sin θ = n₂·m₁ of the turn about a hinge since the described pose.

    n₁ and n₂ are directions of a perpendicular to the axis and to each other; m₁, fixed in b, is n₁
    in the described pose.
    """
    pose_a, pose_b = poses[hinge.a], poses[hinge.b]
    normal1, normal2 = normals(direction(pose_a.R.T @ hinge.axis))
    m1 = hinge.b.direction(
        unit_vector(f"{hinge.name}_mark1", change_axes(pose_a, normal1, pose_b), store))
    n1, n2 = (hinge.a.direction(unit_vector(f"{hinge.name}_normal{k}", normal, store))
              for k, normal in ((1, normal1), (2, normal2)))
    return dot(n1, m1), dot(n2, m1)


def change_axes(a: Pose, v: Array, b: Pose) -> Array:
    """Return R_bᵀ R_a v: a direction in the axes of a, in the axes of b."""
    return direction(b.R.T @ (a.R @ v))


def sum_of_angles(
    x: tuple[sp.Expr, sp.Expr], y: tuple[sp.Expr, sp.Expr]
) -> tuple[sp.Expr, sp.Expr]:
    """Return (cos, sin) of α + β from (cos, sin) of α and of β."""
    (c1, s1), (c2, s2) = x, y
    return c1 * c2 - s1 * s2, s1 * c2 + c1 * s2


def hinge_of(joint: Connection) -> Align:
    """Return the hinge of a joint; for a rheonomic constraint, the hinge of the driven joint.

    ``joint`` is an ``Align``, a ``HingedJoint``, or a ``RheonomicConstraint`` on one of them;
    callers pass no others. An ``Align`` is its own hinge.
    """
    if isinstance(joint, RheonomicConstraint):
        return hinge_of(joint.joints[0])
    assert isinstance(joint, (Align, HingedJoint))
    return joint if isinstance(joint, Align) else joint.hinge


def multiple(count: int, cosine: sp.Expr, sine: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    """Return cos kθ and sin kθ from cos θ and sin θ, k = ``count``: smooth for any number of turns.

    Where atan2 jumps by 2π, kθ jumps by 2πk, which changes neither function.
    """
    if abs(count) == 1:
        return cosine, count * sine
    angle = count * sp.atan2(sine, cosine)
    return sp.cos(angle), sp.sin(angle)
