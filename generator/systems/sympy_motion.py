"""How frames and points of ``sympy.physics.mechanics`` move, in as few terms as there are joints.

SymPy rotates each part of a velocity along the whole chain of frames by itself, so that the length
of a result grows with the square of the chain's length. Here components are rotated from frame to
frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics import mechanics as me

from ...core.errors import InputError
from ..symbolic.finite_fields import vanish
from ..symbolic.shared_subexpressions import parts_of, share, substitute

__all__ = ["FrameMotion"]


@dataclass
class FrameMotion:
    """How frames and points move in an inertial frame.

    Vectors are rotated from frame to frame, and components given in a frame are added there: bodies
    share the sums up to the joint between them, so that the length of T grows like the number of
    bodies.

    Attributes
    ----------
    frame : ReferenceFrame
        The inertial frame.
    speeds : dict
        Each generalised speed u(t) in terms of q and q̇.

    ``_turning`` caches angular velocities by frame, ``_axes`` the inertial axes in each frame.
    """

    frame: Any
    speeds: Mapping[sp.Expr, sp.Expr] = field(default_factory=dict)
    _turning: dict[Any, list[sp.Expr]] = field(default_factory=dict)
    _axes: dict[Any, list[sp.Expr]] = field(default_factory=dict)

    def energy(self, bodies: Iterable[Any]) -> sp.Expr:
        """Return T of bodies; a body at rest, or moved by a law of t alone, needs no mass."""
        return sp.Add(*map(self._energy_of, bodies))

    def _energy_of(self, body: Any) -> sp.Expr:
        """Return T = ½ m v·v + ½ Ω·J·Ω, with Ω in the axes of the body; 0 for a body at rest."""
        v, _ = self.velocity(body.masscenter)
        rates = self.turning(body.frame) if isinstance(body, me.RigidBody) else []
        # constant, or a function of t alone: such an energy has no effect on the motion
        if not any(isinstance(subexpression, AppliedUndef)
                   for subexpression in parts_of([*v, *rates])):
            return sp.Integer(0)
        translation = body.mass * sp.Add(*(e**2 for e in v)) / 2 if any(v) else sp.Integer(0)
        if not any(rates):
            return translation
        Omega = sp.Matrix(rates)
        J = body.central_inertia.to_matrix(body.frame)
        return translation + (Omega.T * J * Omega)[0] / 2

    def turning(self, axes: Any) -> list[sp.Expr]:
        """Return the angular velocity of a frame in its own axes, three components."""
        if axes not in self._turning:
            self.refuse_unoriented([axes])
            self._turning[axes] = self.components(axes.ang_vel_in(self.frame), axes)
        return self._turning[axes]

    def velocity(self, point: Any) -> tuple[list[sp.Expr], Any]:
        """Return the components of a point's velocity, and their axes: the last frame of its path.

        SymPy returns the velocity that was set for the nearest point, plus the rate of the place
        from there. The rate of the place from a fixed point is shorter: it is returned where there
        is such a point and exact arithmetic shows that both are equal.
        """
        anchor = _nearest(point, lambda neighbour: self.frame in neighbour._vel_dict)
        if anchor is None:
            raise InputError(f"The velocity of {point} in {self.frame} is not known; place it from "
                             "a point whose velocity is set, or set its own.")
        velocity, position = anchor.vel(self.frame), point.pos_from(anchor)
        # an anchor at rest already gives the rate alone
        place = None if velocity == 0 else self.place(point)
        if place is None:
            axes = self._farthest_frame(position, velocity)
            return self._add_rate(position, velocity, axes), axes
        axes = self._farthest_frame(place)
        # 0 * velocity is the zero vector: the fixed point does not move
        short = self._add_rate(place, 0 * velocity, axes)
        long = self._add_rate(position, velocity, axes)
        differences = [a - b for a, b in zip(short, long, strict=True)]
        return (short if vanish(substitute(differences, self.speeds)) else long), axes

    def contradictions(self, bodies: Iterable[Any]) -> Iterator[tuple[Any, Any]]:
        """Yield pairs of points whose velocities do not differ by the rate of their distance.

        Points are those whose velocity was set, among all from which a mass centre is placed.
        """
        points = list(dict.fromkeys(
            point for body in bodies for point in _connected_points(body.masscenter)
            if self.frame in point._vel_dict))
        for point in points:
            anchor = next((neighbour for neighbour in _connected_points(point)
                         if neighbour is not point and neighbour in points), None)
            if anchor is None:
                continue
            # v_anchor − v_point + d/dt (r_point − r_anchor) is 0 if places and velocities agree
            position, gap = point.pos_from(anchor), anchor.vel(self.frame) - point.vel(self.frame)
            residual = self._add_rate(position, gap, self._farthest_frame(position, gap))
            if not vanish(substitute(residual, self.speeds)):
                yield point, anchor

    def is_placed(self, point: Any) -> bool:
        """Whether the position of a point is given relative to another point."""
        return any(neighbour is not point for neighbour in _connected_points(point))

    def place(self, point: Any) -> Any:
        """Return the position vector of a point from the nearest point at rest; None without one.
        """
        resting = _nearest(point, lambda neighbour: neighbour._vel_dict.get(self.frame) == 0)
        return None if resting is None else point.pos_from(resting)

    def along(self, k: int, position: Any) -> sp.Expr:
        """Return the component of a position along axis k = 0, 1, 2 of the inertial frame.

        Σ r·e_k over the frames in which parts r of the position are given, from the root outward:
        ``share`` makes one node of a partial sum, which other bodies have too.
        """
        axis, component = (self.frame.x, self.frame.y, self.frame.z)[k], sp.Integer(0)
        for r, frame in sorted(position.args, key=lambda term: len(self._path(term[1]))):
            if (k, frame) not in self._axes:
                self._axes[k, frame] = self.components(axis, frame)
            products = (a * b for a, b in zip(self._axes[k, frame], r, strict=True))
            component = share(component + sp.Add(*products))
        return component

    def _farthest_frame(self, *vectors: Any) -> Any:
        """Return the frame farthest in the tree among the frames of the vectors' components."""
        return max((frame for vector in vectors for _, frame in vector.args),
                   key=lambda frame: len(self._path(frame)), default=self.frame)

    def _add_rate(self, position: Any, velocity: Any, axes: Any) -> list[sp.Expr]:
        """Return v + dr/dt in ``axes``, three components, r a position and v a velocity.

        For components of r in a frame that turns with Ω, dr/dt = ∂r/∂t + Ω × r.
        """
        rates = 0 * velocity  # SymPy's zero vector
        for r, frame in position.args:
            rate = r.diff(me.dynamicsymbols._t) + sp.Matrix(self.turning(frame)).cross(r)
            rates += me.Vector([(rate, frame)])
        return self.components(velocity + rates, axes)

    def components(self, vector: Any, axes: Any) -> list[sp.Expr]:
        """Return the three components of a vector in the frame ``axes``.

        Along the path of frames to these axes, the sum of the components so far is rotated into the
        next frame, and the components that are given there are added.
        """
        numbers_in = {frame: list(numbers) for numbers, frame in vector.args}
        path = self._path(axes)
        # a vector with parts in other frames: SymPy's conversion, which multiplies matrices out
        if not {*numbers_in} <= {*path}:
            self.refuse_unoriented(numbers_in)
            return list(vector.to_matrix(axes))
        components, previous = [sp.Integer(0)] * 3, None
        for frame in path:
            if any(components):
                R = frame.dcm(previous).tolist()
                components = [sp.Add(*(a * x for a, x in zip(row, components, strict=True)))
                              for row in R]
            in_frame = numbers_in.get(frame, [sp.Integer(0)] * 3)
            components = [share(a + b) for a, b in zip(components, in_frame, strict=True)]
            previous = frame
        return components

    def refuse_unoriented(self, frames: Iterable[Any]) -> None:
        """Refuse frames whose orientation in the inertial one is not known."""
        for frame in frames:
            self._path(frame)

    def _path(self, axes: Any) -> list[Any]:
        """Return the frames of the tree from the inertial one to ``axes``, both included."""
        try:  # 0 is SymPy's number of the tree of orientations
            return list(reversed(axes._dict_list(self.frame, 0)))
        except ValueError as error:
            raise InputError(f"The orientation of frame {axes} in {self.frame} is not known; give "
                             f"it, as by {axes}.orient_axis({self.frame}, {self.frame}.z, q)."
                             ) from error


def _nearest(point: Any, suits: Callable[[Any], bool]) -> Any:
    """Return the point nearest to ``point``, in steps from place to place, that ``suits`` accepts.

    None if there is no such point.
    """
    return next((neighbour for neighbour in _connected_points(point) if suits(neighbour)), None)


def _connected_points(point: Any) -> Iterator[Any]:
    """Yield a point and all points to which positions connect it, the nearest first."""
    visited, waiting = {point}, [point]
    for current in waiting:
        yield current
        fresh = [neighbour for neighbour in current._pos_dict if neighbour not in visited]
        visited.update(fresh)
        waiting += fresh
