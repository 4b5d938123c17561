"""Joints and springs between bodies: what they hold on to, and their equations.

    ball       x_a + R(q_a) r_a − x_b − R(q_b) r_b = 0                       three
    align      R(q_a) n_k · R(q_b) e = 0,  k = 1, 2                          two
    revolute   both of these                                                 five
    rod        |x_a + R(q_a) r_a − x_b − R(q_b) r_b|² − l² = 0               one

n₁ and n₂ are two directions of a that are perpendicular to the axis, e is the axis in b. All are
polynomials of the coordinates. A component that is 0 stays 0: it takes no arithmetic. Joints with
an axis tell how far b has turned about it against a, and how fast:

    angle      θ = 2 atan2(v, w),  (w, v e) = q̄_a q_b c,  smooth for |θ| < 2π
    rate       e · Ω_b − e · Ω_a

with c such that θ is at the start what is said of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from ...core.errors import InputError
from ..systems.body_layout import Pull
from .body import Body, Frame, Push, Vector, dot
from .initial_poses import Pose, clean, conjugate, direction, normals, product

__all__ = ["Align", "Connection", "Equation", "Joint", "Link", "Revolute", "Rod", "Spring",
           "apart", "copies", "named_number", "named_vector", "perpendicular", "unit_vector"]

Array = NDArray[Any]
#: Where the frames are at the start.
Poses = Mapping[Frame, Pose]
#: The values of a model's parameters by name.
Store = dict[str, float]

UNIT = (0.0, 1.0, -1.0)  # components of unit vectors that stay numbers


@dataclass(frozen=True)
class Equation:
    """One constraint with its name, and how its multiplier acts where that is known."""

    name: str
    expression: sp.Expr
    pull: Pull | None = None


def named_vector(
    prefix: str, values: Sequence[float], store: Store, plain: Sequence[float] = (0.0,)
) -> Vector:
    """Return symbols prefix_x, … for a vector and store their values; plain ones stay numbers."""
    x, y, z = (named_number(f"{prefix}_{axis}", value, store, plain)
               for axis, value in zip("xyz", values, strict=True))
    return x, y, z


def hand_on(quantity: str, a: Pose, b: Pose, more: Array) -> bool:
    """Set what b has = what a has + ``more`` on the side that lacks it; return whether one did."""
    of_a, of_b = getattr(a, quantity), getattr(b, quantity)
    if of_a is not None and of_b is None:
        setattr(b, quantity, of_a + more)
    elif of_b is not None and of_a is None:
        setattr(a, quantity, of_b - more)
    else:
        return False
    return True


def _shown(link: Connection) -> str:
    """Return what stands for a joint, a rod or a spring."""
    ends = [frame.name if isinstance(frame, Body) else "ground" for frame in (link.a, link.b)]
    return f"<{type(link).__name__} {link.name}: {', '.join(ends)}>"


@dataclass(eq=False, repr=False)
class Connection:
    """What joins two frames. It may hand on motion at the start, hold, and have energy."""

    name: str
    a: Frame
    b: Frame
    #: Those it acts on, as a motor does.
    joints: tuple[Connection, ...] = field(default=(), kw_only=True)
    #: What it can measure.
    MEASURES: ClassVar[tuple[str, ...]] = ()

    def __repr__(self) -> str:
        return _shown(self)

    @property
    def frames(self) -> tuple[Frame, ...]:
        """All that it acts on."""
        return (self.a, self.b, *(frame for joint in self.joints for frame in joint.frames))

    def turn(self, poses: Poses) -> bool:
        """Hand on angular velocity where one of the two lacks it; return whether it did."""
        return False

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints, none; values of their parameters go into ``store``."""
        yield from ()

    def energy(self, store: Store) -> sp.Expr:
        """Return V, 0; values of its parameters go into ``store``."""
        return sp.Integer(0)

    def places(self, store: Store) -> tuple[Sequence[sp.Expr], Sequence[sp.Expr]]:
        """Return its point in the axes of a and in those of b; nothing where it has none."""
        return (), ()

    def axes(self, poses: Poses, store: Store) -> tuple[Sequence[sp.Expr], Sequence[sp.Expr]]:
        """Return n₁ and n₂ in a's axes and n₁ × n₂ in b's, where such an axis is in common."""
        return (), ()

    def forces(self, poses: Poses, store: Store) -> Iterator[Push]:
        """Yield forces, none; values of their parameters go into ``store``."""
        yield from ()

    def measure(self, what: str, poses: Poses, store: Store) -> sp.Expr:
        """Return one of its ``MEASURES`` as an expression."""
        raise InputError(f"{self.name!r} has no {what}.")

    def push(self, what: str, effort: sp.Expr, poses: Poses, store: Store) -> Iterator[Push]:
        """Yield what a torque, or force, does that drives a measure: it acts on b and back on a."""
        raise InputError(f"{self.name!r} has no {what}.")


@dataclass(eq=False, repr=False)
class Link(Connection):
    """Two points of two frames: what a joint and a spring have in common.

    ``on_a`` and ``on_b`` are in body axes, from the origin of the body.
    """

    on_a: Array | None = None
    on_b: Array | None = None

    def places(self, store: Store) -> tuple[Vector, Vector]:
        """Return both points in the axes of their frames; their components become parameters."""
        where = []
        for frame, r in ((self.a, self.on_a), (self.b, self.on_b)):
            assert r is not None
            prefix = f"{self.name}_{frame.name}" if isinstance(frame, Body) else self.name
            where.append(named_vector(prefix, r.tolist(), store))
        return where[0], where[1]

    def points(self, store: Store) -> tuple[Vector, Vector]:
        """Return both points in space as expressions."""
        on_a, on_b = self.places(store)
        return self.a.point(on_a), self.b.point(on_b)

    def square(self, store: Store) -> sp.Expr:
        """Return the squared distance of the points."""
        point_a, point_b = self.points(store)
        return sum(((x - y) ** 2 for x, y in zip(point_a, point_b, strict=True)), sp.Integer(0))

    def distance(self, poses: Poses) -> float:
        """Return how far apart the points are at the start."""
        assert self.on_a is not None
        assert self.on_b is not None
        apart = poses[self.a].space(self.on_a) - poses[self.b].space(self.on_b)
        return float(np.linalg.norm(apart))


@dataclass(eq=False, repr=False)
class Joint(Link):
    """A ball joint: two points are one. ``at`` is where in space they are at the start.

    Two of at, on_a and on_b are enough, one where both positions are known.
    """

    at: Array | None = None

    def place(self, poses: Poses) -> bool:
        """Hand on points and positions; return whether something was found."""
        found = False
        sides = ((self.a, "on_a"), (self.b, "on_b"))
        for frame, side in sides:
            pose, r = poses[frame], getattr(self, side)
            if self.at is None and r is not None and pose.x is not None:
                self.at, found = pose.space(r), True
        for frame, side in sides if self.at is not None else ():
            pose, r = poses[frame], getattr(self, side)
            if r is None and pose.x is not None:
                at = np.asarray(self.at)
                setattr(self, side, clean(pose.R.T @ (at - pose.x), at, pose.x))
                found = True
            elif r is not None and pose.x is None:
                pose.x, found = self.at - pose.R @ r, True
        return found

    def move(self, poses: Poses) -> bool:
        """Hand on the velocity of the common point; return whether it did."""
        a, b = poses[self.a], poses[self.b]
        assert a.spin is not None
        assert b.spin is not None
        arm_a, arm_b = a.R @ self.on_a, b.R @ self.on_b
        assert a.x is not None
        assert b.x is not None
        apart = b.x + arm_b - a.x - arm_a
        turning = np.cross(a.spin, arm_a + apart) - np.cross(b.spin, arm_b)
        return hand_on("v", a, b, turning + self.hand_over())

    def hand_over(self) -> Array:
        """Return the velocity of the point of b past that of a at the start, 0."""
        return np.zeros(3)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints; values of their parameters go into ``store``."""
        for k, (x, y) in enumerate(zip(*self.points(store), strict=True)):
            yield Equation(f"{self.name}: {'xyz'[k]}", x - y, Pull("force", unit_entries(k)))


@dataclass(eq=False, repr=False)
class Align(Connection):
    """One axis of a stays one of b; ``axis`` is a unit vector in space at the start.

    b turns about it against a, at ``rate`` to begin with.
    """

    axis: Array
    rate: float = 0.0
    angle: float = 0.0
    MEASURES = ("angle", "rate")

    def turn(self, poses: Poses) -> bool:
        """Hand on the angular velocity: that of b is that of a and the rate about the axis."""
        return hand_on("spin", poses[self.a], poses[self.b], self.rate * self.axis)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints; values of their parameters go into ``store``."""
        both, axis = self.axes(poses, store)
        for k, n in enumerate((both[:3], both[3:]), start=1):
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

    def measure(self, what: str, poses: Poses, store: Store) -> sp.Expr:
        """Return the angle or the rate."""
        in_a, in_b = self.ends(poses, store)
        if what == "rate":
            return dot(in_b, self.b.angular_velocity) - dot(in_a, self.a.angular_velocity)
        *start, turns = self.zero(poses, store)
        w, *v = product(conjugate(self.a.attitude), product(self.b.attitude, start))
        return turns + 2 * sp.atan2(dot(in_a, (v[0], v[1], v[2])), w)

    def push(self, what: str, effort: sp.Expr, poses: Poses, store: Store) -> Iterator[Push]:
        """Yield what a torque about the axis does."""
        in_a, in_b = self.ends(poses, store)
        yield from self.b.turned([effort * e for e in in_b])
        yield from self.a.turned([-effort * e for e in in_a])

    @property
    def _full_turns(self) -> float:
        """The multiple of 2π next to the angle at the start."""
        return 2 * math.pi * round(self.angle / (2 * math.pi))

    def zero(self, poses: Poses, store: Store) -> tuple[sp.Expr, ...]:
        """Return c, of which q̄_a q_b c is how b has turned in the axes of a, and full turns."""
        pose_a, pose_b = poses[self.a], poses[self.b]
        half = (self.angle - self._full_turns) / 2
        start = [math.cos(half), *(math.sin(half) * (pose_a.R.T @ self.axis))]
        before = direction(np.array(product(product(conjugate(pose_b.q), pose_a.q), start)))
        return (*(named_number(f"{self.name}_before{k}", x, store, UNIT)
                  for k, x in enumerate(before.tolist())),
                named_number(f"{self.name}_turns", self._full_turns, store))


@dataclass(eq=False, repr=False)
class Revolute(Joint):
    """A hinge: a ball joint whose bodies keep an axis in common."""

    hinge: Align = field(kw_only=True)
    MEASURES = Align.MEASURES

    def turn(self, poses: Poses) -> bool:
        """Hand on the angular velocity as ``Align`` does."""
        return self.hinge.turn(poses)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints; values of their parameters go into ``store``."""
        yield from super().equations(poses, store)
        yield from self.hinge.equations(poses, store)

    def axes(self, poses: Poses, store: Store) -> tuple[Sequence[sp.Expr], Sequence[sp.Expr]]:
        """Return those of the hinge."""
        return self.hinge.axes(poses, store)

    def measure(self, what: str, poses: Poses, store: Store) -> sp.Expr:
        """Return the angle or the rate."""
        return self.hinge.measure(what, poses, store)

    def push(self, what: str, effort: sp.Expr, poses: Poses, store: Store) -> Iterator[Push]:
        """Yield what a torque about the axis does."""
        return self.hinge.push(what, effort, poses, store)


@dataclass(eq=False, repr=False)
class Rod(Link):
    """Two points keep their distance; None takes it from the start."""

    length: float | None = None

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraint; values of its parameters go into ``store``."""
        length = sp.Symbol(f"{self.name}_length", positive=True)
        store[str(length)] = self.distance(poses) if self.length is None else self.length
        yield Equation(f"{self.name}: length", self.square(store) - length**2, Pull("distance"))


@dataclass(eq=False, repr=False)
class Spring(Link):
    """V = ½ k (|d| − l)² between two points; V = ½ k d·d for l = 0; a damper pulls by c d|d|/dt."""

    stiffness: float = 0.0
    length: float = 0.0
    damping: float = 0.0

    def energy(self, store: Store) -> sp.Expr:
        """Return V; values of its parameters go into ``store``."""
        k = sp.Symbol(f"{self.name}_stiffness", real=True)
        store[str(k)] = self.stiffness
        if not self.length:
            return k * self.square(store) / 2
        length = sp.Symbol(f"{self.name}_length", positive=True)
        store[str(length)] = self.length
        return k * (sp.sqrt(self.square(store)) - length) ** 2 / 2

    def forces(self, poses: Poses, store: Store) -> Iterator[Push]:
        """Yield c d (d·ḋ)/|d|² on a, and the same back on b."""
        if not self.damping:
            return
        c = named_number(f"{self.name}_damping", self.damping, store)
        on_a, on_b = self.places(store)
        d = apart(self.b.point(on_b), self.a.point(on_a))
        speed = apart(self.b.point_velocity(on_b), self.a.point_velocity(on_a))
        x, y, z = (c * dot(d, speed) / dot(d, d) * e for e in d)
        yield from self.a.pushed(on_a, (x, y, z))
        yield from self.b.pushed(on_b, (-x, -y, -z))


def copies(links: Sequence[Connection]) -> dict[Connection, Connection]:
    """Return link → a copy that may be completed; copies act on each other as the links do."""
    made = {link: replace(link) for link in links}
    for copy in made.values():
        copy.joints = tuple(made[joint] for joint in copy.joints)
    return made


def apart(to: Vector, start: Vector) -> Vector:
    """Return the difference of two vectors."""
    x, y, z = (a - b for a, b in zip(to, start, strict=True))
    return x, y, z


def named_number(
    name: str, value: float, store: Store, plain: Sequence[float] = (0.0,)
) -> sp.Expr:
    """Return a symbol for a number and store its value; a plain one stays a number."""
    if value in plain:
        return sp.Integer(int(value))
    store[name] = float(value)
    return sp.Symbol(name, real=True)


def unit_vector(name: str, unit: Array, store: Store) -> Vector:
    """Return symbols for a unit vector, in which 0, 1 and −1 stay numbers; see named_vector."""
    return named_vector(name, unit.tolist(), store, UNIT)


def unit_entries(k: int) -> tuple[float, ...]:
    """Return the k-th coordinate axis."""
    return tuple(map(float, np.eye(3)[k]))


def perpendicular(
    name: str, a: Frame, n: Sequence[sp.Expr], b: Frame, e: Sequence[sp.Expr]
) -> Equation:
    """Return the constraint that a direction of a stays perpendicular to one of b."""
    return Equation(name, dot(a.direction(n), b.direction(e)), Pull("torque", tuple(n), tuple(e)))
