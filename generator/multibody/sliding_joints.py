"""Joints that slide, screw, cross or mesh: their equations, in the letters of ``joints``.

    cylindrical  align, and R(q_a) n_k · d = 0                               four
    prismatic    cylindrical, and R(q_a) n₁ · R(q_b) m₂ = 0                  five
    screw        cylindrical, and sin(θ − 2π (s − s₀)/h) = 0                 five
    planar       align, and R(q_a) e · d = 0                                 three
    universal    ball, and R(q_a) e₁ · R(q_b) e₂ = 0                         four
    gear         sin(z₁ θ₁ + z₂ θ₂) = 0 of two joints                        one
    drive        sin(f(t) − θ) = 0                                           one
    coupling     c₂ − (ratio c₁ + offset) = 0, c their angles or travels     one

d goes from the point of a to that of b; s = c + R(q_a) e · d is the travel, with c such that it is
at the start what is said of it, s₀. m_k are the directions of b that are n_k at the start:
cos θ = R(q_a) n₁ · R(q_b) m₁ and sin θ = R(q_a) n₂ · R(q_b) m₁ know the angle of turn but for whole
turns, and so does the screw.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import ClassVar

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from ..systems.body_layout import Pull
from .body import Push, Vector, dot
from .initial_poses import Pose, clean, direction, normals
from .joints import (
    Align,
    Connection,
    Equation,
    Joint,
    Poses,
    Revolute,
    Store,
    apart,
    named_number,
    perpendicular,
    unit_vector,
)

__all__ = ["Coupling", "Cylindrical", "Gear", "Planar", "Prismatic", "Screw", "Universal"]

Array = NDArray[np.float64]

#: Angles in a ratio of such whole numbers are coupled over any number of turns.
_FEW_TEETH = 12


@dataclass(eq=False, repr=False)
class Planar(Joint):
    """A plane of b slides on one of a; the axis of ``hinge`` is the normal."""

    hinge: Align = field(kw_only=True)
    MEASURES: ClassVar[tuple[str, ...]] = Align.MEASURES

    def turn(self, poses: Poses) -> bool:
        """Hand on the angular velocity as ``Align`` does."""
        return self.hinge.turn(poses)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints; values of their parameters go into ``store``."""
        yield from self.hinge.equations(poses, store)
        yield Equation(f"{self.name}: distance", self.along(poses, store))

    def axes(self, poses: Poses, store: Store) -> tuple[Sequence[sp.Expr], Sequence[sp.Expr]]:
        """Return those of the hinge."""
        return self.hinge.axes(poses, store)

    def measure(self, what: str, poses: Poses, store: Store) -> sp.Expr:
        """Return the angle or the rate."""
        return self.hinge.measure(what, poses, store)

    def push(self, what: str, effort: sp.Expr, poses: Poses, store: Store) -> Iterator[Push]:
        """Yield what a torque about the axis does."""
        return self.hinge.push(what, effort, poses, store)

    def along(self, poses: Poses, store: Store) -> sp.Expr:
        """Return R(q_a) e · d."""
        in_a, _ = self.hinge.ends(poses, store)
        return dot(self.a.direction(in_a), self.offset(store))

    def offset(self, store: Store) -> Vector:
        """Return d."""
        point_a, point_b = self.points(store)
        return apart(point_b, point_a)


@dataclass(eq=False, repr=False)
class Cylindrical(Planar):
    """b turns about an axis of a and slides along it, at ``speed`` to begin with."""

    speed: float = 0.0
    travel: float = 0.0
    MEASURES: ClassVar[tuple[str, ...]] = (*Align.MEASURES, "travel", "speed")

    def hand_over(self) -> Array:
        """Return the velocity of the point of b past that of a at the start."""
        return self.speed * self.hinge.axis

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints; values of their parameters go into ``store``."""
        yield from self.hinge.equations(poses, store)
        d = self.offset(store)
        for k, normal in enumerate(self.triad(poses)[:2], start=1):
            n = unit_vector(f"{self.name}_normal{k}", normal, store)
            yield Equation(f"{self.name}: across {k}", dot(self.a.direction(n), d))

    def triad(self, poses: Poses) -> tuple[Array, Array]:
        """Return n₁ and n₂ in the axes of a."""
        return normals(direction(poses[self.a].R.T @ self.hinge.axis))

    def measure(self, what: str, poses: Poses, store: Store) -> sp.Expr:
        """Return angle, rate, travel or speed."""
        if what == "travel":
            a, b = (poses[frame] for frame in (self.a, self.b))
            d = b.space(np.asarray(self.on_b)) - a.space(np.asarray(self.on_a))
            left = np.array([self.travel, -float(self.hinge.axis @ d)])
            offset = float(clean(np.array([left.sum()]), left)[0])
            return named_number(f"{self.name}_offset", offset, store) + self.along(poses, store)
        if what == "speed":
            (in_a, _), (on_a, on_b) = self.hinge.ends(poses, store), self.places(store)
            past = apart(self.b.point_velocity(on_b), self.a.point_velocity(on_a))
            return dot(self.a.direction(in_a), past)
        return super().measure(what, poses, store)

    def push(self, what: str, effort: sp.Expr, poses: Poses, store: Store) -> Iterator[Push]:
        """Yield what a torque about the axis, or a force along it, does."""
        if what not in ("travel", "speed"):
            yield from super().push(what, effort, poses, store)
            return
        (in_a, in_b), (on_a, on_b) = self.hinge.ends(poses, store), self.places(store)
        for frame, e, r, sign in ((self.a, in_a, on_a, -1), (self.b, in_b, on_b, 1)):
            x, y, z = (sign * effort * c for c in frame.direction(e))
            yield from frame.pushed(r, (x, y, z))


@dataclass(eq=False, repr=False)
class Prismatic(Cylindrical):
    """b slides along an axis of a and does not turn."""

    MEASURES: ClassVar[tuple[str, ...]] = ("travel", "speed")

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints; values of their parameters go into ``store``."""
        yield from super().equations(poses, store)
        first, second = self.triad(poses)
        n = unit_vector(f"{self.name}_normal1", first, store)
        m = unit_vector(f"{self.name}_mark", seen(poses[self.a], second, poses[self.b]), store)
        yield perpendicular(f"{self.name}: turn", self.a, n, self.b, m)


@dataclass(eq=False, repr=False)
class Screw(Cylindrical):
    """b turns about an axis of a and moves along it by ``lead`` a turn."""

    lead: float = field(kw_only=True)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints; values of their parameters go into ``store``."""
        yield from super().equations(poses, store)
        turned = 2 * sp.pi / named_number(f"{self.name}_lead", self.lead, store)
        moved = turned * self.along(poses, store)
        cosine, sine = cosine_and_sine(self.hinge, poses, store)
        yield Equation(f"{self.name}: thread", sine * sp.cos(moved) - cosine * sp.sin(moved))

    def hand_over(self) -> Array:
        """Return the velocity of the point of b past that of a at the start."""
        along: Array = self.hinge.rate * self.lead / (2 * math.pi) * self.hinge.axis
        return along


@dataclass(eq=False, repr=False)
class Universal(Joint):
    """A ball joint whose cross keeps an axis of a perpendicular to one of b: Cardan's joint.

    ``arms`` are both at the start, in space; about them b turns against a at ``rates``.
    """

    arms: tuple[Array, Array] = field(kw_only=True)
    rates: tuple[float, float] = (0.0, 0.0)

    def turn(self, poses: Poses) -> bool:
        """Hand on the angular velocity: that of b is that of a and the rates about both arms."""
        first, second = (rate * arm for rate, arm in zip(self.rates, self.arms, strict=True))
        return Align(self.name, self.a, self.b, first + second, 1.0).turn(poses)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints; values of their parameters go into ``store``."""
        yield from super().equations(poses, store)
        x, y = (unit_vector(f"{self.name}_arm_{side}", direction(poses[frame].R.T @ arm), store)
                for frame, side, arm in zip((self.a, self.b), "ab", self.arms, strict=True))
        yield perpendicular(f"{self.name}: cross", self.a, x, self.b, y)


@dataclass(eq=False, repr=False)
class Gear(Connection):
    """Two joints turn as gears in mesh: z₁ θ₁ + z₂ θ₂ stays what it is at the start."""

    teeth: tuple[int, int] = field(kw_only=True)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraint; values of its parameters go into ``store``."""
        (c1, s1), (c2, s2) = (
            multiple(z, *cosine_and_sine(hinge_of(joint), poses, store))
            for z, joint in zip(self.teeth, self.joints, strict=True))
        yield Equation(f"{self.name}: mesh", s1 * c2 + c1 * s2)


@dataclass(eq=False, repr=False)
class Drive(Connection):
    """The angle of a hinge is a law of t: sin(f(t) − φ) = 0, and f(0) is where it starts.

    The multiplier is the torque of the drive on the second body of the joint, about its axis.
    """

    law: sp.Expr = field(kw_only=True)
    begin: float = field(kw_only=True)  # f(0)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraint; values of its parameters go into ``store``."""
        hinge = hinge_of(self)
        c, s = cosine_and_sine(hinge, poses, store)
        since = self.law - named_number(f"{self.name}_begin", self.begin, store)
        yield Equation(f"{self.name}: angle", c * sp.sin(since) - s * sp.cos(since),
                       Pull("axial", hinge.ends(poses, store)[0]))

    def axes(self, poses: Poses, store: Store) -> tuple[Sequence[sp.Expr], Sequence[sp.Expr]]:
        """Return those of the hinge."""
        return hinge_of(self).axes(poses, store)


@dataclass(eq=False, repr=False)
class Coupling(Connection):
    """The coordinate of the second joint is ``ratio`` times that of the first, and ``offset``."""

    what: tuple[str, str] = field(kw_only=True)
    ratio: float = field(kw_only=True)
    offset: float = field(kw_only=True)

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraint; values of its parameters go into ``store``."""
        ratio = Fraction(repr(self.ratio)).limit_denominator(_FEW_TEETH)
        if self.what == ("angle", "angle") and float(ratio) == self.ratio and (
                0 < abs(ratio.numerator) <= _FEW_TEETH):
            yield Equation(f"{self.name}: ratio", self._turns(ratio, poses, store))
            return
        first, second = (joint.measure(what, poses, store)
                         for joint, what in zip(self.joints, self.what, strict=True))
        k = named_number(f"{self.name}_ratio", self.ratio, store, (0.0, 1.0, -1.0))
        offset = named_number(f"{self.name}_offset", self.offset, store)
        yield Equation(f"{self.name}: ratio", second - k * first - offset)

    def _turns(self, ratio: Fraction, poses: Poses, store: Store) -> sp.Expr:
        """Return sin(n θ₂ − z θ₁ − φ) for a ratio z/n: 0 whatever the number of turns."""
        first, second = self.joints
        z, n = ratio.numerator, ratio.denominator
        (c1, s1), (c2, s2) = (
            multiple(k, *cosine_and_sine(hinge_of(joint), poses, store))
            for k, joint in ((-z, first), (n, second)))
        sine, cosine = s1 * c2 + c1 * s2, c1 * c2 - s1 * s2
        left = n * self.offset + z * hinge_of(first).angle - n * hinge_of(second).angle
        phase = named_number(f"{self.name}_phase", left, store)
        return sine * sp.cos(phase) - cosine * sp.sin(phase)


def cosine_and_sine(hinge: Align, poses: Poses, store: Store) -> tuple[sp.Expr, sp.Expr]:
    """Return cos θ and sin θ of the turn about the axis of a hinge since the start."""
    pose_a, pose_b = poses[hinge.a], poses[hinge.b]
    first, second = normals(direction(pose_a.R.T @ hinge.axis))
    mark = hinge.b.direction(
        unit_vector(f"{hinge.name}_mark1", seen(pose_a, first, pose_b), store))
    n1, n2 = (hinge.a.direction(unit_vector(f"{hinge.name}_normal{k}", n, store))
              for k, n in ((1, first), (2, second)))
    return dot(n1, mark), dot(n2, mark)


def seen(of: Pose, v: Array, by: Pose) -> Array:
    """Return a direction in the axes of one frame in those of another, at the start."""
    return direction(by.R.T @ (of.R @ v))


def hinge_of(joint: Connection) -> Align:
    """Return what a joint turns about; of a drive, what the joint does that it drives."""
    if isinstance(joint, Drive):
        return hinge_of(joint.joints[0])
    assert isinstance(joint, (Align, Revolute, Planar))
    return joint if isinstance(joint, Align) else joint.hinge


def multiple(count: int, cosine: sp.Expr, sine: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    """Return cos kθ and sin kθ of cos θ and sin θ: smooth, however often θ has turned."""
    if abs(count) == 1:
        return cosine, count * sine
    angle = count * sp.atan2(sine, cosine)
    return sp.cos(angle), sp.sin(angle)
