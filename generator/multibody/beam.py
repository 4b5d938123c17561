"""Beams and cables: chains of rigid segments, potentials of the strains between them.

Between neighbouring segments a and b of length h, with w + u = q̄_a q_b,

    curvature   κ = (2/h) u,  |κ| = (2/h) sin(θ/2)
    bending     V = (h/2) Σ B_k (κ_k − κ°_k)²,  B = (EI₁, EI₂, GJ)
    stretching  V = (h/4) Σ_{a,b} Σ C_k Γ_k²,  Γ = Rᵀ(P_b − P_a)/h,  C = (GA, GA, EA)

or, without stretching and shearing (Kirchhoff), a ball joint P_a = P_b. V is a polynomial, a motion
of the whole does not change κ and Γ, and errors are O(h²) (Lang, Linn, Arnold, Multibody System
Dynamics 25, 2011). A clamp bends half a segment: h/2 in place of h. Kelvin-Voigt damping adds
τ B κ̇ to the moment B (κ − κ°), and τ C Γ̇ to the force.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from ...core.arguments import as_integer, count_text, shown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.inertia import quaternion_product, real_array
from ..systems.body_layout import SectionLayout
from ..systems.expression_arguments import as_expression
from .body import Body, Frame, GeneralisedForce, Vector, cross, dot
from .initial_poses import conjugate, finite, non_negative, onto, positive, rotation, vector
from .joints import (
    UNIT,
    Equation,
    Joint,
    Poses,
    Store,
    difference,
    named_number,
    named_vector,
    propagate,
)
from .rigid_body import rotation_matrix

__all__ = ["COLOUR", "Beam", "BeamEnd", "BeamJoint", "curve_of", "moments_of_segment",
           "stiffness_of", "strain_between"]

#: Colour of the tube that a beam is drawn as.
COLOUR = "#7d8794"
_IDENTITY = (1.0, 0.0, 0.0, 0.0)
#: Differences of lengths and components of unit vectors below this are round-off.
_ROUNDING = 1e-13
#: Segments of a beam, at most: a thousand take minutes to derive.
_MOST_SEGMENTS = 100_000


@dataclass(frozen=True, eq=False, repr=False)
class BeamEnd(Frame):
    """An end of a beam, for joints, springs, forces and quantities.

    Its origin is the end of the first or last ``segment``, at ``on`` in its axes, which are the
    axes of the end; ``q`` and ``at`` are the attitude and the place of the section at the start.
    """

    name: str
    segment: Body
    on: Array
    q: Array
    at: Array
    is_first: bool

    def __repr__(self) -> str:
        return f"<BeamEnd {self.name}>"

    @property
    def attitude(self) -> tuple[sp.Expr, ...]:
        """Quaternion of the segment."""
        return self.segment.attitude

    @property
    def angular_velocity(self) -> Vector:
        """Angular velocity of the segment in its axes."""
        return self.segment.angular_velocity

    def direction(self, v: Sequence[object]) -> Vector:
        """Return the components in space of a vector in the axes of the segment."""
        return self.segment.direction(v)

    def point(self, r: Sequence[object] = (0, 0, 0)) -> Vector:
        """Return the position in space of a point in the axes of the segment, from the end."""
        return self.segment.point(self._from_segment_origin(r))

    def point_velocity(self, r: Sequence[object] = (0, 0, 0)) -> Vector:
        """Return the velocity in space of a point in the axes of the segment, from the end."""
        return self.segment.point_velocity(self._from_segment_origin(r))

    def _from_segment_origin(self, r: Sequence[object]) -> list[Any]:
        """Return a point, given from the end, from the origin of the segment."""
        return [as_expression(x) + d for x, d in zip(r, self.on.tolist(), strict=True)]


@dataclass(eq=False, repr=False)
class Beam:
    """A beam or cable of a ``Multibody``; made by ``Multibody.beam``.

    Attributes
    ----------
    name : str
        Begins the names of the beam's parameters, segments (``cable_1``, …) and joints.
    segments : tuple of Body
        Rigid segments; their third axes are tangents, the others the axes of the section.
    first, last : BeamEnd
        The ends, which model files call ``NAME_first`` and ``NAME_last``.
    spacing : float
        h in m, the length of a segment along the curve.
    bending, twisting : two floats, and a float
        (EI₁, EI₂) and GJ in N m².
    damping : float
        Retardation time τ in s.
    """

    name: str
    segments: tuple[Body, ...]
    first: BeamEnd
    last: BeamEnd
    spacing: float
    bending: tuple[float, float]
    twisting: float
    #: (shearing, stretching), or () of an inextensible beam.
    extension: tuple[float, ...]
    damping: float
    #: Curvature without moment about the axes of the section, None for that of the start.
    rest: Array | None

    def __repr__(self) -> str:
        return (f"<Beam {self.name}: {count_text(len(self.segments), 'segment')} of "
                f"{self.spacing:g} m>")

    def rest_strain(self, a: Array, b: Array, factor: int) -> Array:
        """Return u (3,) at which a joint has no moment, where κ = (factor/h) u is the curvature.

        u is the vector part of the relative unit quaternion ā b, with |u| the sine of half the
        angle, below 1: (h/factor) ``rest``, h = ``spacing``, where the beam has a rest curvature,
        else u of the attitudes ``a`` and ``b`` at the start. Raises InputError for a curvature with
        |u| ≥ 1.
        """
        u = strain_between(a, b) if self.rest is None else self.spacing / factor * self.rest
        if not np.linalg.norm(u) < 1:
            raise InputError(f"The rest curvature of beam {self.name!r} is {shown(self.rest)} 1/m, "
                             f"too much for segments of {self.spacing:g} m; give more segments.")
        return u

    def stiffness(self, store: Store) -> Vector:
        """Return EI₁, EI₂ and GJ; their values go into ``store``."""
        # equal stiffnesses are one parameter, NAME_bending
        names = ("bending",) * 2 if len({*self.bending}) == 1 else ("bending1", "bending2")
        EI1, EI2, GJ = (
            named_number(f"{self.name}_{name}", value, store, literals=()) for name, value in
            zip((*names, "twisting"), (*self.bending, self.twisting), strict=True))
        return EI1, EI2, GJ


class _Extension(NamedTuple):
    """The displacement of the two ends that a joint of a beam connects, and its stiffnesses."""

    across: sp.Expr  # C_⊥ = GA/h, N/m
    along: sp.Expr  # C_∥ = EA/h, N/m
    d: Vector  # P_b − P_a in space, m
    tangents: list[Vector]  # of a and of b, in space


@dataclass(eq=False, repr=False)
class BeamJoint(Joint):
    """A joint between two segments of a beam, or a clamp of one of its ends.

    ``factor`` is f in κ = (f/h) u: 2, and 4 at a clamp; ``relative`` is the attitude of the section
    at a clamp in the axes of the frame that holds it; ``rest`` is u without moment; ``arc`` is the
    distance of the joint from the start along the beam, in m; ``gap`` is the length in m whose
    stretching the joint has, 0 for a joint without stretching.
    """

    beam: Beam = field(kw_only=True)
    rest: Array = field(kw_only=True)
    arc: float = field(kw_only=True)
    factor: int = field(kw_only=True, default=2)
    relative: Sequence[float] = field(kw_only=True, default=_IDENTITY)
    gap: float = field(kw_only=True, default=0.0)

    @property
    def sides(self) -> tuple[Frame, Frame]:
        """The frames before and after the joint along the beam.

        A clamp holds the start, arc = 0, or the end of the beam; its segment is a or b.
        """
        # a is before the joint, but where a is the segment at the start, or the holder at the end
        is_b_before = self.factor == 4 and (self.a in self.beam.segments) != bool(self.arc)
        return (self.b, self.a) if is_b_before else (self.a, self.b)

    def turns(self, store: Store) -> tuple[Sequence[sp.Expr], Sequence[sp.Expr]]:
        """Return the quaternions of the section in the axes of both sides.

        Between two segments, and on the segment of a clamp, it is the identity; on the holder's
        side of a clamp it is ``relative``.
        """
        relative = [named_number(f"{self.name}_turn{k}", x, store, UNIT)
                    for k, x in enumerate(self.relative)]
        identity = [sp.Integer(1), *[sp.Integer(0)] * 3]
        # the holder is before the first segment, and after the last one
        return (identity, relative) if self.arc else (relative, identity)

    def propagate_spin(self, poses: Poses) -> bool:
        """Propagate the angular velocity in space: ω_b = ω_a."""
        return propagate("spin", poses[self.a], poses[self.b], np.zeros(3))

    def local_points(self, store: Store) -> tuple[Vector, Vector]:
        """Return both points in the axes of their frames; full segments share their parameters."""
        # a clamp has points of its own
        if self.factor == 4:
            return super().local_points(store)
        points = []
        for frame, r, end in ((self.a, self.on_a, "front"), (self.b, self.on_b, "back")):
            assert isinstance(frame, Body)
            assert r is not None
            # a chord of a polygon may be shorter than the arc h: such a segment has its own points
            is_full = abs(2 * abs(r[2]) - self.beam.spacing) <= _ROUNDING * self.beam.spacing
            name = self.beam.name if is_full else frame.name
            points.append(named_vector(f"{name}_{end}", r.tolist(), store))
        return points[0], points[1]

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the constraints of a ball; none of a joint that stretches."""
        if not self.gap:
            yield from super().equations(poses, store)

    def strain(self, store: Store) -> tuple[sp.Expr, Vector]:
        """Return w and u of w + u = q̄_1 q_2, with the attitudes of the sections on both sides."""
        q1, q2 = (quaternion_product(frame.attitude, turn)
                  for frame, turn in zip(self.sides, self.turns(store), strict=True))
        w, *u = quaternion_product(conjugate(q1), q2)
        return w, (u[0], u[1], u[2])

    def stiffness_by_strain(self, store: Store) -> tuple[sp.Expr, Vector]:
        """Return f/h and B of V = Σ (f/h) B_k (u_k − u°_k)²; f is ``factor``, h ``spacing``."""
        h = named_number(f"{self.beam.name}_spacing", self.beam.spacing, store)
        return self.factor / h, self.beam.stiffness(store)

    def energy(self, store: Store) -> sp.Expr:
        """Return Σ (f/h) B_k (u_k − u°_k)², and V of the stretching; values go into ``store``."""
        _, u = self.strain(store)
        rest_strain = named_vector(f"{self.name}_rest", self.rest.tolist(), store)
        ratio, B = self.stiffness_by_strain(store)
        bending = ratio * sp.Add(*(b * (x - x0) ** 2 for b, x, x0 in
                                   zip(B, u, rest_strain, strict=True)))
        return bending + self._stretching(store) if self.gap else bending

    def section(self, store: Store) -> SectionLayout:
        """Return the section: its place along the beam, its strain at rest, and its stiffness."""
        start_turn, end_turn = self.turns(store)
        holder: Literal["a", "b", ""] = "" if self.factor == 2 else (
            "b" if self.a in self.beam.segments else "a")
        return SectionLayout(
            self.beam.name, self.arc, float(self.factor),
            named_number(f"{self.beam.name}_spacing", self.beam.spacing, store),
            self.beam.stiffness(store),
            named_vector(f"{self.name}_rest", self.rest.tolist(), store), holder,
            # the turn on the holder's side, which is behind the last segment or before the first
            tuple(end_turn if self.arc else start_turn) if holder else (),
            self._axial_stiffness(store) if self.gap else (),
            named_number(f"{self.beam.name}_damping", self.beam.damping, store))

    def _axial_stiffness(self, store: Store) -> Vector:
        """Return GA, EA and the length that the joint stands for.

        The length is h, and h/2 more for the first and for the last joint: the outer halves of the
        segments at both ends have no joint.
        """
        shearing, stretching = self.beam.extension
        GA = EA = named_number(f"{self.beam.name}_shearing", shearing, store, literals=())
        # equal stiffnesses are one parameter: V is then ½ C |d|², without tangents
        if stretching != shearing:
            EA = named_number(f"{self.beam.name}_stretching", stretching, store, literals=())
        suffix = "gap" if self.gap == self.beam.spacing else "end_gap"
        return GA, EA, named_number(f"{self.beam.name}_{suffix}", self.gap, store)

    def _extension(self, store: Store) -> _Extension:
        """Return the distance of the two ends of the joint, and its stiffnesses."""
        across, along, length = self._axial_stiffness(store)
        point_a, point_b = self.points(store)
        return _Extension(across / length, along / length, difference(point_b, point_a),
                          [frame.direction((0, 0, 1)) for frame in (self.a, self.b)])

    def _stretching(self, store: Store) -> sp.Expr:
        """Return V = ½ C_⊥ |d|² + ½ (C_∥ − C_⊥) × the mean of (d·t)² of both tangents t."""
        across, along, d, tangents = self._extension(store)
        V = across * dot(d, d) / 2
        if across == along:
            return V
        return V + sum(((along - across) * dot(d, t) ** 2 / 4 for t in tangents), sp.Integer(0))

    def forces(self, poses: Poses, store: Store) -> Iterator[GeneralisedForce]:
        """Yield the damping: torques of −2τ (f/h) B u̇ on both sides, and −τ C Γ̇."""
        if not self.beam.damping:
            return
        tau = named_number(f"{self.beam.name}_damping", self.beam.damping, store)
        w, u = self.strain(store)
        sides = [(frame, rotation_matrix(turn)) for frame, turn in
                 zip(self.sides, self.turns(store), strict=True)]
        # angular velocities in the section's axes
        spin_a, spin_b = (list(R.T * sp.Matrix(frame.angular_velocity)) for frame, R in sides)
        # u̇ = ½ (w (Ω_b − Ω_a) + u × (Ω_a + Ω_b))
        relative_spin = [y - x for x, y in zip(spin_a, spin_b, strict=True)]
        spin_sum = [y + x for x, y in zip(spin_a, spin_b, strict=True)]
        strain_rate = [(w * x + y) / 2
                       for x, y in zip(relative_spin, cross(u, spin_sum), strict=True)]
        ratio, B = self.stiffness_by_strain(store)
        s = [2 * tau * ratio * b * x for b, x in zip(B, strain_rate, strict=True)]
        # the power −s·u̇ gives the torques ½ (±w s − s × u) on both sides
        for (frame, R), sign in zip(sides, (1, -1), strict=True):
            torque = [(sign * w * x - y) / 2 for x, y in zip(s, cross(s, u), strict=True)]
            yield from frame.torque_on(list(R * sp.Matrix(torque)))
        if self.gap:
            yield from self._stretching_damping(tau, store)

    def _stretching_damping(self, tau: sp.Expr, store: Store) -> Iterator[GeneralisedForce]:
        """Yield −τ C Γ̇ of both frames: forces on the points, and torques that keep momenta.

        In a frame that turns at ω, d changes at the rate ḋ − ω × d. With its tangent t

            s = ½ τ (C_⊥ (ḋ − ω × d) + (C_∥ − C_⊥) t·(ḋ − ω × d) t),

        the power −s·(ḋ − ω × d) gives the force s on the point of a, −s on that of b, and the
        torque d × s on the frame itself.
        """
        across, along, d, tangents = self._extension(store)
        points = self.local_points(store)
        d_rate = difference(self.b.point_velocity(points[1]), self.a.point_velocity(points[0]))
        force = [sp.Integer(0)] * 3
        # half of the damping in the frame of each end: neither of them is preferred
        for frame, t in zip((self.a, self.b), tangents, strict=True):
            spin = frame.direction(frame.angular_velocity)
            rate = difference(d_rate, cross(spin, d))
            stretch_rate = dot(rate, t)
            s = [tau * (across * x + (along - across) * stretch_rate * e) / 2
                 for x, e in zip(rate, t, strict=True)]
            torque = cross(d, s)
            assert isinstance(frame, Body)
            yield from frame.torque_on(list(frame.rotation.T * sp.Matrix(torque)))
            force = [x + y for x, y in zip(force, s, strict=True)]
        for frame, r, sign in zip((self.a, self.b), points, (1, -1), strict=True):
            x, y, z = (sign * e for e in force)
            yield from frame.force_at(r, (x, y, z))


class BeamCurve(NamedTuple):
    """The polygon that a beam follows at the start, in space."""

    nodes: Array  # ends of the segments, at equal distances along it, shape (count + 1, 3), m
    end_edges: Array  # its first and its last edge, shape (2, 3), m
    length: float  # m

    @property
    def chords(self) -> Array:
        """The segments as vectors in space, shape (count, 3), m."""
        return np.diff(self.nodes, axis=0)

    def attitudes(self, name: str, normal: ArrayLike | None, twist: float) -> list[Array]:
        """Return the unit quaternions of the sections at the start, mid-segments and the end.

        Arguments and errors as of ``frames_along``.
        """
        first_edge, last_edge = self.end_edges
        count = len(self.nodes) - 1
        arc = np.array([0.0, *(np.arange(count) + 0.5) / count, 1.0])
        return frames_along(name, np.stack([first_edge, *self.chords, last_edge]), arc, normal,
                            twist)


def curve_of(name: str, start: Any, end: Any, points: Any, count: int) -> BeamCurve:
    """Return the curve of a beam with ``count`` segments.

    The polygon has two ends, ``start`` and ``end``, or ``points``. Raises InputError for another
    description, and for points that coincide.
    """
    if (points is None) == (start is None) or (start is None) != (end is None):
        raise InputError(f"Beam {name!r} has {'points and' if points is not None else 'neither'} "
                         f"{'a start or an end' if points is not None else 'both ends nor points'}"
                         "; give start and end, or points.")
    line = real_array([start, end] if points is None else points)
    if line is None or line.ndim != 2 or line.shape[1] != 3 or len(line) < 2 or not np.isfinite(
            line).all():
        raise InputError(f"The points of beam {name!r} are "
                         f"{shown(points if points is not None else (start, end))}; give at least "
                         "two points of three finite numbers each.")
    edges = np.linalg.norm(np.diff(line, axis=0), axis=1)
    if not (edges > _ROUNDING * np.abs(line).max()).all():
        k = int(np.argmin(edges))
        raise InputError(f"Points {k + 1} and {k + 2} of beam {name!r} coincide at "
                         f"{line[k].tolist()}; give points at a distance from each other.")
    arc = np.concatenate([[0.0], np.cumsum(edges)])
    # nodes at equal distances along the polygon; segments are chords
    lengths = np.linspace(0.0, arc[-1], count + 1)
    nodes = np.stack([np.interp(lengths, arc, x) for x in line.T], axis=1)
    return BeamCurve(nodes, np.stack([line[1] - line[0], line[-1] - line[-2]]), float(arc[-1]))


def frames_along(
    name: str, tangents: Array, arc: Array, normal: ArrayLike | None, twist: float
) -> list[Array]:
    """Return the unit quaternions of sections by parallel transport along the beam.

    The first and the last section are at the ends, the others in the segments 1, 2, … of the beam.

    From section to section the attitude turns by the shortest rotation from tangent to tangent,
    and by its part of ``twist`` about the tangent. The third axis of a section is its tangent.

    Parameters
    ----------
    tangents : ndarray, shape (sections, 3)
    arc : ndarray, shape (sections,)
        Distances of the sections from the start, as parts of the length.
    normal : three floats, optional
        Direction of the first axis at the start.
    twist : float
        Angle in rad by which the section turns about the tangent from the first to the last.

    Raises
    ------
    InputError
        For a normal along the tangent, a curve that turns back, and a twist of more than 90° from
        section to section.
    """
    t = tangents / np.linalg.norm(tangents, axis=1)[:, None]
    q = onto(t[0])
    if normal is not None:
        x, y, z = (rotation(q).T @ vector(f"normal of {name!r}", normal)).tolist()
        # (x, y) is the part across the tangent, whose direction becomes the first axis
        if math.hypot(x, y) <= 1e-9 * math.hypot(x, y, z):
            raise InputError(f"The normal of beam {name!r} is {shown(normal)}, which has no part "
                             "across its tangent; give a direction across the beam.")
        q = _twist(q, math.atan2(y, x))
    attitudes = [q]
    for k, (a, b) in enumerate(pairwise(t)):
        # the quaternion of the shortest rotation from a to b, not normalised; 0 for opposite ones
        shortest = np.array([1 + a @ b, *np.cross(a, b)])
        angle = twist * (arc[k + 1] - arc[k])
        # the strain u has the sine of half an angle: more than 90° a segment is no small strain
        if shortest[0] < 1e-6 or abs(angle) > math.pi / 2:
            raise InputError(f"Beam {name!r} turns back, or twists by more than 90°, at segment "
                             f"{max(k, 1)}; give more segments, or a smoother curve.")
        q = _twist(np.array(quaternion_product(shortest, attitudes[-1])), angle)
        attitudes.append(q / np.linalg.norm(q))
    return attitudes


def _twist(q: Array, angle: float) -> Array:
    """Return the quaternion after a rotation by an angle about the section's third axis."""
    return np.array(quaternion_product(q, [math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)]))


def strain_between(a: Array, b: Array) -> Array:
    """Return u, (3,), of ā b = w + u for two unit quaternions; components at round-off are 0."""
    u = np.array(quaternion_product(conjugate(a), b)[1:])
    return np.where(np.abs(u) <= _ROUNDING, 0.0, u)


def moments_of_segment(
    name: str, inertia: ArrayLike | None, mass: float, h: float, radius: float | None
) -> tuple[float, ...]:
    """Return the moments of inertia of a segment of length h about the axes of its section.

    They are h times ``inertia``, which is given per length; else those of a cylinder of ``radius``,
    m (r²/4 + h²/12) across and m r²/2 along; without a radius m h²/12 about each axis. m is
    ``mass``.
    """
    if inertia is not None:
        return tuple((h * vector(f"inertia of {name!r}", inertia)).tolist())
    if radius is not None:
        across = mass * (radius**2 / 4 + h**2 / 12)
        return across, across, mass * radius**2 / 2
    return (mass * h**2 / 12,) * 3


class BeamStiffness(NamedTuple):
    """The number of segments of a beam, and the stiffnesses of its section."""

    segment_count: int
    EI: tuple[float, float]  # about the first and the second axis of the section, N m²
    GJ: float  # N m²
    extension: tuple[float, ...]  # GA and EA in N; empty for a beam that keeps its length
    damping: float  # retardation time τ, s


def stiffness_of(
    name: str, count: Any, bending: Any, twisting: Any, stretching: Any, shearing: Any,
    damping: Any,
) -> BeamStiffness:
    """Return the checked arguments ``count`` to ``damping`` of ``Multibody.beam``.

    Raises InputError for less than two segments, stiffnesses that are not above 0, only one of
    stretching and shearing, and a damping below 0.
    """
    number = as_integer(count)
    if number is None or not 2 <= number <= _MOST_SEGMENTS:
        raise InputError(f"The count of beam {name!r} is {shown(count)}; give a whole number of "
                         f"segments, 2 to {_MOST_SEGMENTS}.")
    # one stiffness for both directions of bending, or a pair
    array = real_array(bending)
    shape = () if array is None or array.ndim == 0 else (2,)
    EI1, EI2 = np.broadcast_to(finite(f"bending of {name!r}", bending, shape), 2).tolist()
    EI = positive(f"bending of {name!r}", EI1), positive(f"bending of {name!r}", EI2)
    stiffnesses = {"shearing": shearing, "stretching": stretching}
    absent = [key for key, stiffness in stiffnesses.items() if stiffness is None]
    if len(absent) == 1:
        raise InputError(f"Beam {name!r} has no {absent[0]}; give shearing and stretching, or "
                         "neither for a beam that does not extend.")
    extension = tuple(positive(f"{key} of {name!r}", stiffness)
                      for key, stiffness in stiffnesses.items() if not absent)
    return BeamStiffness(number, EI, positive(f"twisting of {name!r}", twisting), extension,
                         non_negative(f"damping of {name!r} in s", damping))
