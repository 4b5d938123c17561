"""Coordinates with an inertia of their own, and what joins them to bodies: flywheels and chains.

    flywheel   T = p²/(2a) of the angle φ = nθ by which a joint's gear turns it, without gyroscopic
               effect; sin(φ/n − θ) = 0, on a joint that slides φ/n − s = 0            one
               on a ball T = p·p/(8a) of four coordinates z with z = q̄_a q_b, |ω|² = 4|ż|²  four
    chain      joints in a row without bodies between: R_b = R_a Π R(φ_i), x_b = …      six
    law        f(c₁, c₂, …) = 0 of coordinates of joints                               one

A flywheel with a and n adds a n² to the joint's entry of the mass matrix, MuJoCo's ``armature``.
With the displacements δ_i = φ_i − φ_i(0) and the axes e_i through points c_i, in the axes of a at
the start, a chain is the product of exponentials (Brockett 1984)

    vec(q̄_b q_a Q(δ) q̄_a(0) q_b(0)) = 0,    x_a + R(q_a) D(δ) − x_b − R(q_b) r = 0

Q(δ) is the product of the quaternions of the hinges, D(δ) the point to which hinges and slides
move r. The numbers at the right count the constraints.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import sympy as sp

from ...core.arrays import Array
from ...core.inertia import quaternion_product
from .body import Body, Frame, GeneralisedForce, Particle, Vector, cross, dot
from .initial_poses import Pose, RigidMotion, conjugate, direction
from .joints import (
    FRACTION,
    RATE_OF,
    UNIT,
    Connection,
    Cylindrical,
    Equation,
    Fixed,
    Joint,
    Poses,
    StartRate,
    StartValue,
    Store,
    cosine_and_sine,
    difference,
    hinge_of,
    named_number,
    named_vector,
    propagate,
    unit_vector,
)

__all__ = ["Arm", "BallFlywheel", "Chain", "Coordinate", "Flywheel", "FlywheelBody", "Law", "Link",
           "Slide", "Translation"]


@dataclass(frozen=True, eq=False, repr=False)
class FlywheelBody(Particle):
    """One coordinate φ with p = a φ̇, or four; they have no place in space.

    They stand as the position of a point whose mass is the inertia a.
    """

    @classmethod
    def of(cls, name: str, numbers: Sequence[str] = ("",)) -> FlywheelBody:
        """Return coordinates NAME_phiK, one for each suffix K in ``numbers``, and their inertia.

        The inertia a is the symbol NAME_inertia.
        """
        zero = (sp.Integer(0),) * 3
        x, p = (tuple(sp.Symbol(f"{name}_{prefix}{k}", real=True) for k in numbers)
                for prefix in ("phi", "pphi"))
        # as in ``Particle.with_name``, no formula has its representation or its weight
        return cls(f"{name}_phi", rep="gamma", q=(), p=(), x=x, p_x=p, origin=zero, centre=zero,
                   mass=sp.Symbol(f"{name}_inertia", positive=True), inertia=(),
                   weight=sp.Symbol(f"{name}_gamma"))

    @property
    def centre_of_mass(self) -> Vector:
        """The origin, so that it has no weight."""
        return self.origin

    @property
    def rate(self) -> sp.Expr:
        """φ̇ = p/a, for one coordinate."""
        return self.p_x[0] / self.mass


@dataclass(eq=False, repr=False)
class Coordinate(Connection):
    """A joint with a coordinate of its own, ``b``, on which motors and springs may act."""

    kind: str = field(kw_only=True)  # "angle" or "travel"
    value: float = field(kw_only=True, default=0.0)  # in the pose of the description
    start_value: float | None = field(kw_only=True, default=None)  # at the start, if it is given
    #: Rate at the start, if it is given.
    speed: float | None = field(kw_only=True, default=None)

    @property
    def displacement(self) -> float:
        """The coordinate at the start, if it is given: it is 0 in the described pose then."""
        return self.start_value or 0.0

    @property
    def MEASURES(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of its measures: "angle" and "rate", or "travel" and "speed"."""
        return (self.kind, RATE_OF[self.kind])

    def measure(self, quantity: str, poses: Poses, store: Store) -> sp.Expr:
        """Return the coordinate or its rate."""
        body = self.b
        assert isinstance(body, FlywheelBody)
        return body.x[0] if quantity == self.kind else body.rate

    def multiple_angle(self, count: int, poses: Poses, store: Store) -> tuple[sp.Expr, sp.Expr]:
        """Return cos kθ and sin kθ of the turn θ = c − c₀ since the described pose.

        k is ``count``.
        """
        begin = named_number(f"{self.name}_start", self.value, store)
        angle = count * (self.measure(self.kind, poses, store) - begin)
        return sp.cos(angle), sp.sin(angle)

    def generalised_forces(
        self, quantity: str, effort: sp.Expr, poses: Poses, store: Store
    ) -> Iterator[GeneralisedForce]:
        """Yield the effort on the coordinate."""
        assert isinstance(self.b, FlywheelBody)
        yield self.b.p_x, (effort,)

    def start_values(self, poses: Poses, store: Store) -> Iterator[StartValue]:
        """Yield c − fraction · c₁ of the coordinate c, if c₁ is given for the start."""
        if self.start_value is not None:
            coordinate = self.measure(self.kind, poses, store)
            yield StartValue(self.name, self.kind, self.start_value,
                             coordinate - FRACTION * self.start_value)

    def start_rates(self, poses: Poses) -> Iterator[StartRate]:
        """Yield the rate, if it is given."""
        if self.speed is not None:
            # v of a flywheel's body is the rate of its one coordinate; it has no angular velocity
            yield StartRate(self.name, self.speed, {self.b: (np.ones(1), np.zeros(0))})

    def begin(self, poses: Poses) -> None:
        """Set the value of the coordinate in the described pose."""
        poses[self.b].x = np.array([self.value])

    def begin_rate(self, poses: Poses) -> None:
        """Set the rate of the coordinate at the start."""
        poses[self.b].v = np.array([self.speed or 0.0])


@dataclass(eq=False, repr=False)
class Flywheel(Coordinate):
    """Flywheel on a joint: its angle is ``ratio`` times the coordinate of the joint.

    On a joint that slides the coordinate counts as a travel, too.
    """

    ratio: float = field(kw_only=True)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield φ/n − s = 0 of a joint that slides, else sin(θ − (φ/n − θ₀)) = 0.

        φ is the coordinate of the flywheel, n its ``ratio``, s the travel of the joint, θ its turn
        since the described pose and θ₀ its angle there. Values of parameters go into ``store``.
        """
        (joint,), coordinate = self.joints, self.measure(self.kind, poses, store)
        joint_value = coordinate / named_number(f"{self.name}_ratio", self.ratio, store, UNIT)
        if self.kind == "travel":
            yield Equation(f"{self.name}: ratio",
                           joint_value - joint.measure("travel", poses, store))
            return
        hinge = hinge_of(joint)
        target = joint_value - named_number(f"{self.name}_begin", hinge.angle, store)
        cosine, sine = cosine_and_sine(hinge, poses, store)
        yield Equation(f"{self.name}: ratio", sine * sp.cos(target) - cosine * sp.sin(target))

    @property
    def displacement(self) -> float:
        """The coordinate's change from the described pose to the start: ratio × the joint's."""
        (joint,) = self.joints
        travel = joint.travel_to_start if isinstance(joint, Cylindrical) else 0.0
        return self.ratio * (joint.displacement if self.kind == "angle" else travel)

    def begin(self, poses: Poses) -> None:
        """Set the value of the coordinate in the described pose, by its joint."""
        (joint,) = self.joints
        self.value = self.ratio * (hinge_of(joint).angle if self.kind == "angle"
                                   else getattr(joint, "travel", 0.0))
        super().begin(poses)

    def begin_rate(self, poses: Poses) -> None:
        """Set the velocity v of the flywheel's one coordinate at the start.

        With the axis e of the joint, v = ratio e·(ω_b − ω_a). On a joint that slides v = ratio s
        e·u, where u is the velocity of the point of b relative to a, and s the scale of a ``Slide``
        or 1.
        """
        (joint,) = self.joints
        a, b = poses[joint.a], poses[joint.b]
        assert a.spin is not None
        assert b.spin is not None
        if self.kind == "travel":
            assert isinstance(joint, Joint)
            relative_rate = getattr(joint, "scale", 1.0) * _slip(joint, a, b)
        else:
            relative_rate = b.spin - a.spin
        rate = self.ratio * float(hinge_of(joint).axis_at(poses) @ relative_rate)
        poses[self.b].v = np.array([rate])


@dataclass(eq=False, repr=False)
class BallFlywheel(Connection):
    """Flywheel on a ball joint, with any axis: T = ½ a |ω_b − ω_a|²."""

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the four constraints z − q̄_a q_b = 0."""
        (joint,) = self.joints
        assert isinstance(self.b, FlywheelBody)
        relative_attitude = quaternion_product(conjugate(joint.a.attitude), joint.b.attitude)
        for k, (z, e) in enumerate(zip(self.b.x, relative_attitude, strict=True)):
            yield Equation(f"{self.name}: {k}", z - e)

    def begin(self, poses: Poses) -> None:
        """Set z = q̄_a q_b, the relative attitude of the joint's bodies in the described pose."""
        (joint,) = self.joints
        poses[self.b].x = np.array(
            quaternion_product(conjugate(poses[joint.a].q), poses[joint.b].q))

    def begin_rate(self, poses: Poses) -> None:
        """Set ż = ½ z (0, R_bᵀ(Ω_b − Ω_a)) at the start, by its joint."""
        (joint,) = self.joints
        a, b = poses[joint.a], poses[joint.b]
        assert a.spin is not None
        assert b.spin is not None
        rate = quaternion_product(poses[self.b].x, [0.0, *(b.R.T @ (b.spin - a.spin))])
        poses[self.b].v = np.array(rate) / 2


def _slip(joint: Joint, a: Pose, b: Pose) -> Array:
    """Return the velocity of P, the joint's point of b, relative to a, in space, shape (3,).

    v_b + ω_b × R_b r_b − v_a − ω_a × (x_P − x_a), with r_b the point in the axes of b.
    """
    arm_b, point = b.R @ joint.on_b, b.space(np.asarray(joint.on_b))
    assert a.x is not None
    slip: Array = b.v + np.cross(b.spin, arm_b) - a.v - np.cross(a.spin, point - a.x)  # type: ignore[arg-type,operator]
    return slip


@dataclass(eq=False, repr=False)
class Translation(Fixed):
    """b slides on a plane of the ground, or anywhere, and does not turn.

    ``normal`` is the normal of the plane in space axes; None for translation in all directions.
    """

    normal: Array | None = field(kw_only=True, default=None)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield n · d = 0 of a plane with the normal n, and the constraints of ``turns``."""
        if self.normal is not None:
            point_a, point_b = self.points(store)
            n = unit_vector(f"{self.name}_normal", self.normal, store)
            yield Equation(f"{self.name}: distance", dot(n, difference(point_b, point_a)))
        yield from self.turns(poses, store)


@dataclass(eq=False, repr=False)
class Slide(Cylindrical):
    """A coordinate of a point of b in the ground's axes: ``scale`` · axis · d, no constraint.

    d leads from the point of the ground to the point of b, which coincide at the start. For slides
    along s_i that are not perpendicular, d = Σ c_i s_i, the axes are the directions of the
    reciprocal vectors, and the scales their lengths.
    """

    scale: float = field(kw_only=True, default=1.0)
    MEASURES: ClassVar[tuple[str, ...]] = ("travel", "speed")

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints, none."""
        yield from ()

    def measure(self, quantity: str, poses: Poses, store: Store) -> sp.Expr:
        """Return the travel c = c₀ + scale · e·d, or the speed ċ."""
        k = named_number(f"{self.name}_scale", self.scale, store, UNIT)
        if quantity == "speed":
            return k * super().measure(quantity, poses, store)
        begin = named_number(f"{self.name}_begin", self.travel, store)
        return begin + k * self.along(poses, store)

    def generalised_forces(
        self, quantity: str, effort: sp.Expr, poses: Poses, store: Store
    ) -> Iterator[GeneralisedForce]:
        """Yield the generalised forces of a force along the axis, which is fixed in a, on b and a.
        """
        k = named_number(f"{self.name}_scale", self.scale, store, UNIT)
        (in_a, _), (on_a, on_b) = self.hinge.ends(poses, store), self.local_points(store)
        # no constraint keeps the axis in b, which a hinge of the same limb may turn
        e = self.a.direction(in_a)
        for frame, r, sign in ((self.a, on_a, -1), (self.b, on_b, 1)):
            x, y, z = (sign * k * effort * c for c in e)
            yield from frame.force_at(r, (x, y, z))


@dataclass(eq=False, repr=False)
class Arm(Connection):
    """The angle about one arm of a universal joint, within half a turn of the start.

    With e₁ fixed in a and e₂ fixed in b at right angles, Ω_b − Ω_a = φ̇₁ e₁ + φ̇₂ e₂. ``arms`` has
    e₁ and e₂ in space at the start; ``own`` is the index, 0 or 1, of the arm whose angle this is.
    """

    arms: tuple[Array, Array] = field(kw_only=True)
    own: int = field(kw_only=True)
    angle: float = field(kw_only=True, default=0.0)
    MEASURES: ClassVar[tuple[str, ...]] = ("angle", "rate")

    def measure(self, quantity: str, poses: Poses, store: Store) -> sp.Expr:
        """Return the angle by which b is turned against a about the arm e, or e·(ω_b − ω_a).

        e is a unit vector fixed in one of the bodies, m the other arm, fixed in the other. With
        m₀, the direction of m at the start in the axes of e's body,

            angle = angle₀ ± atan2((e × m₀)·m, m₀·m),

        + for an arm of a, − for an arm of b, against which it is a that turns.
        """
        frame, partner = (self.a, self.b) if self.own == 0 else (self.b, self.a)
        e = self._in(frame, f"{self.name}_arm", self.arms[self.own], poses, store)
        if quantity == "rate":
            turning = difference(self.b.direction(self.b.angular_velocity),
                                 self.a.direction(self.a.angular_velocity))
            return dot(frame.direction(e), turning)
        mark = self.arms[1 - self.own]
        m = partner.direction(self._in(partner, f"{self.name}_mark", mark, poses, store))
        m0 = self._in(frame, f"{self.name}_normal1", mark, poses, store)
        e_cross_m0 = self._in(frame, f"{self.name}_normal2", np.cross(self.arms[self.own], mark),
                              poses, store)
        sign = 1 if self.own == 0 else -1
        turn = sp.atan2(sign * dot(frame.direction(e_cross_m0), m), dot(frame.direction(m0), m))
        return named_number(f"{self.name}_begin", self.angle, store) + turn

    def _in(self, frame: Frame, name: str, axis: Array, poses: Poses, store: Store) -> Vector:
        """Return an axis, given in space, as a unit vector in the axes of a frame.

        ``name`` begins the names of the parameters of its components.
        """
        return unit_vector(name, direction(poses[frame].R.T @ axis), store)

    def generalised_forces(
        self, quantity: str, effort: sp.Expr, poses: Poses, store: Store
    ) -> Iterator[GeneralisedForce]:
        """Yield the generalised forces of a torque in N m about the arm: on b, opposite on a."""
        # the arm e is fixed in one of the bodies, and turns with it
        frame = (self.a, self.b)[self.own]
        e = frame.direction(self._in(frame, f"{self.name}_arm", self.arms[self.own], poses, store))
        for body, sign in ((self.b, 1), (self.a, -1)):
            # the torque effort · e in body axes: R has the body's axes as columns
            if isinstance(body, Body):
                yield from body.torque_on([sign * effort * dot(body.rotation.col(k), e)
                                           for k in range(3)])


@dataclass(frozen=True, eq=False)
class Link:
    """One joint of a chain: a hinge or a slide.

    ``axis`` and a point ``at`` of it are in space in the described pose.
    """

    coordinate: Coordinate
    axis: Array
    at: Array

    def motion(self, change: float) -> RigidMotion:
        """Return the motion of the bodies beyond the joint for a change of the coordinate.

        A translation by change · e, or a rotation about e through ``at`` by the change in rad.
        """
        if self.coordinate.kind == "travel":
            return RigidMotion.along(change * self.axis)
        return RigidMotion.about(self.axis, change, self.at)


@dataclass(eq=False, repr=False)
class Chain(Joint):
    """Joints in a row without bodies between them; ``on_b`` is the point of the last joint."""

    links: Sequence[Link] = field(kw_only=True)
    MEASURES: ClassVar[tuple[str, ...]] = ()

    @property
    def frames(self) -> tuple[Frame, ...]:
        """The two bodies, and the coordinates of all joints of the chain."""
        return (self.a, self.b, *(link.coordinate.b for link in self.links))

    def motion(self, poses: Poses) -> RigidMotion:
        """Return the motion of b against a to the start: the product of the joints' motions."""
        motion = RigidMotion.along(np.zeros(3))
        for link in self.links:
            motion = motion @ link.motion(link.coordinate.displacement)
        return motion

    def _links_at(self, poses: Poses) -> Iterator[tuple[Coordinate, Array, Array]]:
        """Yield the coordinate of each joint, its axis and a point of it in space at the start."""
        # axes and points are those of the description: the joints before each one move them
        motion = poses[self.a].motion
        for link in self.links:
            yield link.coordinate, motion.direction(link.axis), motion.point(link.at)
            x = poses[link.coordinate.b].x
            assert x is not None
            motion = motion @ link.motion(float(x[0]) - link.coordinate.value)

    def propagate_spin(self, poses: Poses) -> bool:
        """Propagate the angular velocity: ω_b = ω_a + Σ φ̇_i e_i of the hinges."""
        relative: Array = sum(((coordinate.speed or 0.0) * axis
                               for coordinate, axis, _ in self._links_at(poses)
                               if coordinate.kind == "angle"), np.zeros(3))
        return propagate("spin", poses[self.a], poses[self.b], relative)

    def relative_velocity(self, poses: Poses) -> Array:
        """Return the velocity of the point P of b relative to that of a at the start.

        Σ ṡ e of the slides, and Σ φ̇ e × (x_P − c) of the hinges with the axes e through c.
        """
        velocity, point = np.zeros(3), poses[self.b].space(np.asarray(self.on_b))
        for coordinate, axis, pivot in self._links_at(poses):
            velocity += (coordinate.speed or 0.0) * (
                axis if coordinate.kind == "travel" else np.cross(axis, point - pivot))
        return velocity

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints: attitude and point of b follow from a by the chain of joints.

        From the last joint to the first, ``attitude`` is the quaternion of b in a, and ``point``
        its point in axes of a: a joint rotates both by cos(φ/2), sin(φ/2) e about its axis e, or
        moves the point by s e. Values of parameters go into ``store``.
        """
        a, b = poses[self.a], poses[self.b]
        assert a.x is not None
        on_a, on_b = self.local_points(store)
        point: list[sp.Expr] = list(on_a)
        # as described, where each coordinate has its ``value``: displacements count from there
        attitude: Sequence[sp.Expr] = tuple(
            named_number(f"{self.name}_before{k}", x, store, UNIT) for k, x in enumerate(
                direction(np.array(quaternion_product(conjugate(a.q), b.q))).tolist()))
        for k, link in reversed([*enumerate(self.links, start=1)]):
            coordinate = link.coordinate
            displacement = coordinate.measure(coordinate.kind, poses, store) - named_number(
                f"{coordinate.name}_begin", coordinate.value, store)
            e = unit_vector(f"{self.name}_axis{k}", direction(a.R.T @ link.axis), store)
            if coordinate.kind == "travel":
                point = [x + displacement * y for x, y in zip(point, e, strict=True)]
                continue
            half = displacement / 2
            attitude = quaternion_product((sp.cos(half), *(sp.sin(half) * x for x in e)), attitude)
            # a hinge at the point of b (in m, up to round-off) leaves it there, unless a joint
            # behind the hinge has moved the point
            if np.abs(link.at - np.asarray(self.at)).max() <= 1e-15 and point == list(on_a):
                continue
            c = named_vector(f"{self.name}_point{k}", (a.R.T @ (link.at - a.x)).tolist(), store)
            arm = difference((point[0], point[1], point[2]), c)
            point = [x + y for x, y in zip(c, _rotate(e, displacement, arm), strict=True)]
        # q̄_b q_a × the attitude is ±1 on the constraint: its vector part vanishes
        _, *residual = quaternion_product(
            conjugate(self.b.attitude), quaternion_product(self.a.attitude, attitude))
        for axis, e in zip("xyz", residual, strict=True):
            yield Equation(f"{self.name}: turn {axis}", e)
        for axis, x, y in zip("xyz", self.a.point(point), self.b.point(on_b), strict=True):
            yield Equation(f"{self.name}: {axis}", x - y)


def _rotate(e: Vector, angle: sp.Expr, v: Vector) -> list[sp.Expr]:
    """Return cos φ v + sin φ e × v + (1 − cos φ)(e·v) e, v rotated by φ about e (Rodrigues)."""
    along = dot(e, v)
    cosine, sine = sp.cos(angle), sp.sin(angle)
    return [cosine * x + sine * y + (1 - cosine) * along * z
            for x, y, z in zip(v, cross(e, v), e, strict=True)]


@dataclass(eq=False, repr=False)
class Law(Connection):
    """An expression of coordinates of joints that is 0."""

    quantities: tuple[str, ...] = field(kw_only=True)
    coordinates: tuple[sp.Symbol, ...] = field(kw_only=True)
    expression: sp.Expr = field(kw_only=True)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield f(c₁, c₂, …) = 0 of the coordinates c_k of the joints."""
        measures = {x: joint.measure(quantity, poses, store) for x, joint, quantity in zip(
            self.coordinates, self.joints, self.quantities, strict=True)}
        yield Equation(f"{self.name}: law", self.expression.xreplace(measures))
