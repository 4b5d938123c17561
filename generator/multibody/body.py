"""One rigid body in expressions: its symbols, and its points and velocities in space.

A body has a quaternion q, R(q) from body to space axes, and, unless one of its points is held in
space, the position x of its centre of mass. Body axes are the principal axes of inertia, or any
where J is a tensor.

    point r of the body     x + R(q) r
    angular velocity        Ω = J⁻¹ l,  l = ½ L(q) p     (body axes)
    kinetic energy          T(q, p) of (22) or (26)  +  |p_x|²/(2 m)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import sympy as sp

from ...core.arguments import as_items, shown
from ...core.errors import InputError
from ...core.records import dataclass
from ..systems.expression_arguments import as_expression
from ..systems.system import INVERSE
from .rigid_body import (
    Rep,
    angular_velocity,
    expressions,
    kinetic_energy,
    left_matrix,
    rotation_matrix,
    tensor_symbols,
)

__all__ = ["GROUND", "Body", "Frame", "GeneralisedForce", "MovingPoint", "Particle", "Vector",
           "three_expressions"]

Vector = tuple[sp.Expr, sp.Expr, sp.Expr]
#: Momenta, and the generalised force on each of them.
GeneralisedForce = tuple[Sequence[sp.Symbol], Sequence[sp.Expr]]

_AXES = "xyz"


class Frame:
    """A frame of reference for joints and springs; the base class is the ground, which is space.

    Bodies and moving points are subclasses.
    """

    def __repr__(self) -> str:
        return "<Frame: space>"

    def direction(self, v: Sequence[object]) -> Vector:
        """Return the components in space of a vector fixed in the frame."""
        return _vector(expressions("vector", v, 3))

    def point(self, r: Sequence[object]) -> Vector:
        """Return the position in space of a point of the frame."""
        return self.direction(r)

    @property
    def attitude(self) -> tuple[sp.Expr, ...]:
        """Unit quaternion of the frame's axes in space, scalar first: the identity."""
        return (sp.Integer(1), *[sp.Integer(0)] * 3)

    @property
    def angular_velocity(self) -> Vector:
        """Angular velocity in the axes of the frame: 0."""
        return _vector([sp.Integer(0)] * 3)

    def point_velocity(self, r: Sequence[object]) -> Vector:
        """Return the velocity in space of a point of the frame: 0."""
        return _vector([sp.Integer(0)] * 3)

    def force_at(self, r: Sequence[object], force: Vector) -> list[GeneralisedForce]:
        """Return the generalised forces of a force (space axes) at a point of the frame: none."""
        return []

    def torque_on(self, torque: Sequence[object]) -> list[GeneralisedForce]:
        """Return the generalised forces of a torque in the axes of the frame: none."""
        return []


#: Space itself.
GROUND = Frame()


@dataclass(frozen=True, eq=False)
class MovingPoint(Frame):
    """A point of the ground that moves by a law of t, with axes parallel to those of space."""

    name: str
    path: Vector
    velocity: Vector

    def __repr__(self) -> str:
        return f"<MovingPoint {self.name}>"

    def point(self, r: Sequence[object]) -> Vector:
        """Return the position in space of a point fixed in the moving axes."""
        return _vector([x + d for x, d in zip(self.path, self.direction(r), strict=True)])

    def point_velocity(self, r: Sequence[object]) -> Vector:
        """Return the rate of the path: the axes do not turn."""
        return self.velocity


@dataclass(frozen=True, eq=False)
class Body(Frame):
    """One rigid body of a ``Multibody``; made by ``Multibody.body`` and ``Multibody.top``.

    Attributes
    ----------
    name : str
        Begins the names of all its symbols.
    rep : {"gamma", "alpha"}
        Inertia representation.
    q, p : tuple of 4 symbols
        Quaternion, scalar first, and its momenta.
    x, p_x : tuple of 3 symbols, or ()
        Position of the centre of mass and its momenta; empty for a top.
    origin : tuple of 3 expressions
        Position of the origin of the body axes: x, or the fixed point of a top.
    centre : tuple of 3 expressions
        Centre of mass in body axes, from the origin.
    mass, weight : symbols
        m; γ or α.
    inertia : tuple of 3 symbols, or matrix of symbols
        I₁, I₂, I₃ about the origin, or J, 3 × 3, where a tensor is given.
    inverse : tuple of 6 symbols, or ()
        K11, K12, K13, K22, K23, K33 of J⁻¹, where a tensor is given.
    """

    name: str
    rep: Rep
    q: tuple[sp.Symbol, ...]
    p: tuple[sp.Symbol, ...]
    x: tuple[sp.Symbol, ...]
    p_x: tuple[sp.Symbol, ...]
    origin: Vector
    centre: Vector
    mass: sp.Symbol
    inertia: Any
    weight: sp.Symbol
    inverse: tuple[sp.Symbol, ...] = ()

    def __repr__(self) -> str:
        return f"<Body {self.name}: {self.rep}, {len(self.coordinates)} coordinates>"

    @classmethod
    def free(cls, name: str, rep: Rep, *, tensor: bool = False) -> Body:
        """Return a body with quaternion and position: 7 coordinates."""
        x = tuple(sp.Symbol(f"{name}_{axis}", real=True) for axis in _AXES)
        p_x = tuple(sp.Symbol(f"{name}_p{axis}", real=True) for axis in _AXES)
        return cls._with_name(name, rep, x, p_x, _vector(x), _vector([sp.Integer(0)] * 3), tensor)

    @classmethod
    def with_fixed_point(
        cls, name: str, rep: Rep, origin: Vector, centre: Vector, *, tensor: bool = False
    ) -> Body:
        """Return a body one of whose points is fixed in space: 4 coordinates."""
        return cls._with_name(name, rep, x=(), p_x=(), origin=origin, centre=centre, tensor=tensor)

    @classmethod
    def _with_name(
        cls, name: str, rep: Rep, x: tuple[sp.Symbol, ...], p_x: tuple[sp.Symbol, ...],
        origin: Vector, centre: Vector, tensor: bool,
    ) -> Body:
        """Return a body whose symbols begin with its name: NAME_q0, NAME_m, NAME_I1, NAME_gamma.

        With ``tensor`` it has the entries K11 … K33 of J⁻¹ in place of the three moments.
        """
        inertia = tensor_symbols(f"{name}_") if tensor else sp.symbols(f"{name}_I1:4",
                                                                       positive=True)
        inverse = tuple(sp.Symbol(f"{name}_{entry}", real=True) for entry in INVERSE)
        return cls(
            name, rep, sp.symbols(f"{name}_q0:4", real=True), sp.symbols(f"{name}_p0:4", real=True),
            x, p_x, origin, centre, sp.Symbol(f"{name}_m", positive=True),
            inertia, sp.Symbol(f"{name}_{rep}", real=True, nonzero=True),
            inverse if tensor else (),
        )

    @classmethod
    def of_beam(cls, name: str, rep: Rep, beam: str) -> Body:
        """Return a segment of a beam, whose mass and inertia have the beam's symbols."""
        shared = cls.free(beam, rep)
        return replace(cls.free(name, rep), mass=shared.mass, inertia=shared.inertia,
                       weight=shared.weight)

    @property
    def coordinates(self) -> tuple[sp.Symbol, ...]:
        """The body's part of q of the system: quaternion first, then position."""
        return (*self.q, *self.x)

    @property
    def momenta(self) -> tuple[sp.Symbol, ...]:
        """The body's part of p of the system."""
        return (*self.p, *self.p_x)

    @property
    def velocities(self) -> tuple[sp.Symbol, ...]:
        """The symbols of the coordinates' rates, for velocity constraints."""
        return tuple(sp.Symbol(f"{x}_t", real=True) for x in self.coordinates)

    @property
    def turning(self) -> Vector:
        """ω = 2 E(q) q̇, the angular velocity in space in terms of the rates."""
        (x0, x1, x2, x3), (v0, v1, v2, v3) = self.q, self.velocities[:4]
        return (2 * (x0 * v1 - x1 * v0 + x2 * v3 - x3 * v2),
                2 * (x0 * v2 - x2 * v0 + x3 * v1 - x1 * v3),
                2 * (x0 * v3 - x3 * v0 + x1 * v2 - x2 * v1))

    @property
    def origin_rate(self) -> Vector:
        """The velocity of the origin in space, in terms of the rates; 0 for a fixed point."""
        return _vector(self.velocities[4:] or [sp.Integer(0)] * 3)

    @property
    def attitude(self) -> tuple[sp.Expr, ...]:
        """The symbols of the unit quaternion, scalar first."""
        return self.q

    @cached_property
    def rotation(self) -> sp.Matrix:
        """R(q), 3 × 3, from body to space axes."""
        return rotation_matrix(self.q)

    def direction(self, v: Sequence[object]) -> Vector:
        """Return R(q) v: the components in space of a vector in body axes."""
        return _vector(_times(self.rotation.tolist(), v))

    def point(self, r: Sequence[object]) -> Vector:
        """Return x + R(q) r, the position in space of the point r of the body."""
        offset = self.direction(r)
        return _vector([o + d for o, d in zip(self.origin, offset, strict=True)])

    @property
    def centre_of_mass(self) -> Vector:
        """Position of the centre of mass in space."""
        return self.point(self.centre)

    @property
    def angular_velocity(self) -> Vector:
        """Ω = J⁻¹ l in body axes."""
        return _vector(angular_velocity(self.q, self.p, self.inverse or self.inertia))

    @property
    def angular_momentum(self) -> Vector:
        """The angular momentum about the origin in space axes: R(q) l for |q| = 1, bilinear."""
        (q0, q1, q2, q3), (p0, p1, p2, p3) = self.q, self.p
        return (
            (q0 * p1 - q1 * p0 + q2 * p3 - q3 * p2) / 2,
            (q0 * p2 - q2 * p0 + q3 * p1 - q1 * p3) / 2,
            (q0 * p3 - q3 * p0 + q1 * p2 - q2 * p1) / 2,
        )

    @property
    def velocity(self) -> Vector:
        """Velocity of the origin in space."""
        if not self.p_x:
            return _vector([sp.Integer(0)] * 3)
        return _vector([p / self.mass for p in self.p_x])

    def point_velocity(self, r: Sequence[object]) -> Vector:
        """Return ẋ + R(q) (Ω × r): the velocity in space of the point r of the body."""
        turning = self.direction(cross(self.angular_velocity, r))
        return _vector([v + t for v, t in zip(self.velocity, turning, strict=True)])

    @property
    def kinetic_energy(self) -> sp.Expr:
        """T(q, p) of rotation, and of translation unless a point is fixed."""
        turning = kinetic_energy(self.rep, self.q, self.p, self.inverse or self.inertia,
                                 self.weight)
        return sum((p**2 / (2 * self.mass) for p in self.p_x), turning)

    @property
    def unit(self) -> sp.Expr:
        """|q|² − 1, which vanishes."""
        return sum((x**2 for x in self.q), sp.Integer(-1))

    def torque_force(self, torque: Sequence[object]) -> list[sp.Expr]:
        """Return 2 L(q)ᵀ τ, four entries: the force on the quaternion of a torque τ in body axes.

        Force and torque have one power: Ω = 2 L q̇ gives τ·Ω = (2 Lᵀτ)·q̇.
        """
        return [2 * e for e in _times(left_matrix(self.q).T.tolist(), torque)]

    def force_at(self, r: Sequence[object], force: Vector) -> list[GeneralisedForce]:
        """Return the generalised forces of a force (space axes) at the point r of the body."""
        moment = cross(r, _times(self.rotation.T.tolist(), force))
        # a body with a fixed point has no momenta p_x: the point bears the force
        return [(self.p_x, force if self.p_x else ()), *self.torque_on(moment)]

    def torque_on(self, torque: Sequence[object]) -> list[GeneralisedForce]:
        """Return the generalised forces of a torque in body axes."""
        return [(self.p, self.torque_force(torque))] if any(torque) else []


@dataclass(frozen=True, eq=False, repr=False)
class Particle(Body):
    """A point with mass and no attitude, 3 coordinates; made by ``Multibody.point_mass``.

    Its axes are the axes of space.
    """

    def __repr__(self) -> str:
        return f"<Particle {self.name}>"

    @classmethod
    def with_name(cls, name: str) -> Particle:
        """Return the point with the symbols of a name."""
        x, p_x = (sp.symbols([f"{name}_{prefix}{axis}" for axis in _AXES], real=True)
                  for prefix in ("", "p"))
        # a point does not turn: no formula has its representation, its inertia or its weight
        return cls(name, rep="gamma", q=(), p=(), x=tuple(x), p_x=tuple(p_x), origin=_vector(x),
                   centre=_vector([sp.Integer(0)] * 3), mass=sp.Symbol(f"{name}_m", positive=True),
                   inertia=(), weight=sp.Symbol(f"{name}_gamma"))

    @property
    def attitude(self) -> tuple[sp.Expr, ...]:
        """The attitude of the ground: a point has no axes."""
        return GROUND.attitude

    @cached_property
    def rotation(self) -> sp.Matrix:
        """The identity."""
        return sp.eye(3)

    @property
    def angular_velocity(self) -> Vector:
        """Zero."""
        return GROUND.angular_velocity

    @property
    def angular_momentum(self) -> Vector:
        """Zero, about itself."""
        return GROUND.angular_velocity

    @property
    def kinetic_energy(self) -> sp.Expr:
        """|p|²/(2 m)."""
        return sp.Add(*(p**2 / (2 * self.mass) for p in self.p_x))

    def torque_on(self, torque: Sequence[object]) -> list[GeneralisedForce]:
        """Return nothing: a point has no attitude."""
        return []


def cross(a: Sequence[object], b: Sequence[object]) -> Vector:
    """Return a × b."""
    (a1, a2, a3), (b1, b2, b3) = (expressions("vector", v, 3) for v in (a, b))
    return (a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1)


def dot(a: Sequence[sp.Expr], b: Sequence[sp.Expr]) -> sp.Expr:
    """Return a · b without the products of exact zeros: most vectors are along an axis."""
    return sum((x * y for x, y in zip(a, b, strict=True)
                if x is not sp.S.Zero and y is not sp.S.Zero), sp.Integer(0))


def _times(rows: Sequence[Sequence[sp.Expr]], v: Sequence[object]) -> list[sp.Expr]:
    """Return the product of a matrix, row by row, with a vector of three entries."""
    entries = expressions("vector", v, 3)
    return [dot(row, entries) for row in rows]


def _vector(entries: Sequence[sp.Expr]) -> Vector:
    """Return three entries as a ``Vector``, whose length type checkers know."""
    x, y, z = entries
    return x, y, z


def three_expressions(label: str, values: Any) -> Vector:
    """Return a user's argument as three expressions; ``label`` is its name in InputError."""
    if callable(values):
        raise InputError(f"The {label} is the function {shown(values)}; write three expressions of "
                         "the body's symbols, such as body.angular_velocity, time and parameters.")
    entries = [as_expression(value) for value in as_items(label, values, "three expressions")]
    if len(entries) != 3:
        raise InputError(f"The {label} has {len(entries)} components; give three.")
    return entries[0], entries[1], entries[2]
