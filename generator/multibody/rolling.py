"""Rolling without slip of a disc, a sphere or an ellipsoid on a plane.

    height   n·(x + R o − c) − h(u) = 0,                     u = R(q)ᵀ n            one, on q
    slip     t_k·(ẋ + ω × (R o + ρ) − Ω n × (x + R o + ρ − c)) = 0,  k = 1, 2        two, on q̇

n is the normal of the plane through c, which turns about n at the rate Ω; t₁ and t₂ are tangents; o
is the middle of the shape in body axes, ρ from there to the contact, ω = 2 E(q) q̇ the angular
velocity in space. The contact is where the support function h of the shape has its tangent plane:

    sphere      h = r                 ρ = −r n
    disc        h = r s = r |n × d|   ρ = r c (d − c n)/s − r s n,     d = R e its axis, c = n·d
    ellipsoid   h = √(uᵀMu)           ρ = −R M u/h,                    M = diag(a², b², c²)

The rate of the height is the normal part of the contact's velocity, since ρ·u̇ = −ḣ: all of the
contact's velocity vanishes, and the height is kept as a constraint on positions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import sympy as sp

from ...core.arrays import Array
from ...core.errors import InputError
from ..symbolic.numeric_evaluation import evaluate
from .body import Body, Vector, cross, dot
from .initial_poses import Pose, direction, normals, numbers
from .joints import (
    Connection,
    Equation,
    Poses,
    Store,
    named_number,
    named_vector,
    unit_vector,
)
from .rigid_body import left_matrix

__all__ = ["Rolling"]

#: Largest distance of a shape from the plane at the start, relative to its size.
_OFF_GROUND = 1e-3


@dataclass(eq=False, repr=False)
class Rolling(Connection):
    """A shape of b that rolls on a plane of the ground.

    ``sizes`` is the radius in m of a disc or a sphere, or the three semi-axes of an ellipsoid.
    """

    shape: str = field(kw_only=True)  # "disc", "sphere" or "ellipsoid"
    sizes: tuple[float, ...] = field(kw_only=True)
    axis: Array = field(kw_only=True)  # axis of a disc, on the body
    middle: Array = field(kw_only=True)  # middle of the shape, on the body
    normal: Array = field(kw_only=True)  # unit normal of the plane, in space
    at: Array = field(kw_only=True)  # a point of the plane, in space
    turning: float = field(kw_only=True)  # rate of the plane about its normal, rad/s

    def equations(self, poses: Poses, store: Store) -> Iterator[Equation]:
        """Yield the height of the shape above the plane; its parameters go into ``store``."""
        yield Equation(f"{self.name}: height", self._height(store))

    def velocity_equations(self, store: Store) -> Iterator[Equation]:
        """Yield the slip along two tangents, in the velocities of the body."""
        slip = self._slip(store)
        for k, tangent in enumerate(normals(direction(self.normal)), start=1):
            t = unit_vector(f"{self.name}_tangent{k}", tangent, store)
            yield Equation(f"{self.name}: slip {k}", dot(t, slip))

    def set_position(self, store: Store, poses: Poses) -> bool:
        """Set the position of a body without one so that the shape touches the plane.

        Return whether it was set.
        """
        pose = poses[self.b]
        if pose.x is not None:
            return False
        # the height with the origin at the plane's point, which is then subtracted
        pose.x = self.at
        pose.x = self.at - self._at_start([self._height(store)], store, pose)[0] * self.normal
        return True

    def set_velocity(self, store: Store, poses: Poses) -> bool:
        """Set an unknown velocity so that the contact does not slip; return whether it was set."""
        pose = poses[self.b]
        if pose.v is not None:
            return False
        # the slip of a body whose origin is at rest, with the opposite sign
        pose.v = -self._at_start(self._slip(store), store, pose)
        return True

    def refuse_off_ground(self, store: Store, poses: Poses) -> None:
        """Refuse a start where the shape is above or below the plane.

        Raises InputError with the height.
        """
        height = float(self._at_start([self._height(store)], store, poses[self.b])[0])
        if not abs(height) <= _OFF_GROUND * max(self.sizes):
            side = "below" if height < 0 else "above"
            raise InputError(
                f"{self.body.name!r} starts {abs(height):.6g} m {side} the plane on which "
                f"{self.name!r} lets it roll; move it onto the plane, or leave out its position.")

    @property
    def body(self) -> Body:
        """The rolling body, b of the connection."""
        assert isinstance(self.b, Body)
        return self.b

    def _height(self, store: Store) -> sp.Expr:
        """Return n·(x + R o − c) − h, the height of the shape over the plane."""
        n, from_plane = self._normal(store), self._point(self._arm(store), store)
        h, _ = self._support(store)
        return dot(n, from_plane) - h

    def _slip(self, store: Store) -> Vector:
        """Return ẋ + ω × r − Ω n × (x + r − c), the velocity of the contact relative to the plane.

        r = R o + ρ leads from the origin of the body to the contact.
        """
        _, rho = self._support(store)
        r = [a + b for a, b in zip(self._arm(store), rho, strict=True)]
        turning = named_number(f"{self.name}_turning", self.turning, store)
        of_plane = cross([turning * e for e in self._normal(store)], self._point(r, store))
        x, y, z = (v + w - c for v, w, c in zip(
            self.body.origin_rate, cross(self.body.turning, r), of_plane, strict=True))
        return x, y, z

    def _arm(self, store: Store) -> Vector:
        """Return R o, from the origin of the body to the middle of the shape."""
        return self.body.direction(named_vector(f"{self.name}_middle", self.middle.tolist(), store))

    def _point(self, arm: Sequence[sp.Expr], store: Store) -> list[sp.Expr]:
        """Return x + arm − c: a point at ``arm`` from the body's origin, from the plane's point."""
        plane_point = named_vector(f"{self.name}_at", self.at.tolist(), store)
        return [x + a - c for x, a, c in zip(self.body.origin, arm, plane_point, strict=True)]

    def _normal(self, store: Store) -> Vector:
        """Return the unit normal of the plane in space, as parameters or numbers."""
        return unit_vector(f"{self.name}_normal", self.normal, store)

    def _support(self, store: Store) -> tuple[sp.Expr, list[sp.Expr]]:
        """Return the height h of the middle over the plane, and ρ from the middle to the contact.

            sphere      h = r,               ρ = −r n
            disc        h = r |n × d|,       ρ = r (c/s (d − c n) − s n),  c = n·d, s = |n × d|
            ellipsoid   h = √(uᵀ M u),       ρ = −R M u/h,  u = Rᵀ n, M = diag(a², b², c²)

        with the axis d of the disc; ρ in space axes.
        """
        # no branch where n is along d: a disc lies flat there, and its contact is not one point
        n = self._normal(store)
        names = ("radius",) if len(self.sizes) == 1 else ("a", "b", "c")
        sizes = [sp.Symbol(f"{self.name}_{name}", positive=True) for name in names]
        store.update({str(s): x for s, x in zip(sizes, self.sizes, strict=True)})
        r = sizes[0]
        if self.shape == "sphere":
            return r, [-r * e for e in n]
        if self.shape == "disc":
            d = self.body.direction(unit_vector(f"{self.name}_axis", self.axis, store))
            across, cosine = cross(n, d), dot(n, d)
            sine = sp.sqrt(dot(across, across))
            return r * sine, [r * (cosine / sine * (f - cosine * e) - sine * e)
                              for e, f in zip(n, d, strict=True)]
        u = [dot(n, tuple(self.body.rotation[:, k])) for k in range(3)]
        Mu = [s**2 * e for s, e in zip(sizes, u, strict=True)]
        h = sp.sqrt(sp.Add(*(a * b for a, b in zip(u, Mu, strict=True))))
        return h, [-e / h for e in self.body.direction(Mu)]

    def _at_start(self, expressions: Sequence[sp.Expr], store: Store, pose: Pose) -> Array:
        """Return the values of expressions at a ``pose`` of the body, shape (expressions,).

        The body has the angular velocity of the pose, and its origin is at rest. Parameters have
        their values of ``store``.
        """
        body, omega = self.body, pose.R.T @ (np.zeros(3) if pose.spin is None else pose.spin)
        # q̇ = ½ L(q)ᵀ Ω; ``velocities`` are q̇, then ẋ = 0
        rates = numbers(left_matrix(pose.q.tolist())).T @ omega / 2
        assert pose.x is not None
        values = zip((*body.q, *body.velocities, *body.x),
                     (*pose.q, *rates, 0, 0, 0, *pose.x) if body.x else (*pose.q, *rates),
                     strict=True)
        symbols = set().union(*(e.free_symbols for e in expressions)) - {*body.q, *body.x}
        return evaluate(expressions, {s: store[str(s)] for s in symbols if str(s) in store}
                        | dict(values))
