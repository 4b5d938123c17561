"""Joining bodies: a method for each kind of joint, for springs, and for the names that join.

``JOINTS`` are those that a model file may have as ``type``; its keys are the arguments.
"""

from __future__ import annotations

from typing import Any, TypeAlias, TypeVar

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike, NDArray

from ...core.arguments import as_text, proposal, shown
from ...core.errors import InputError
from ...core.warnings import warn
from .body import GROUND, Body, Frame, Moving, Particle
from .initial_poses import Start, finite, positive, rotation, three, three_or_none, unit
from .joints import Align, Connection, Joint, Revolute, Rod, Spring
from .sliding_joints import Cylindrical, Planar, Prismatic, Screw, Universal

__all__ = ["AXES", "JOINTS", "Linkage"]

Array = NDArray[Any]
Joined = TypeVar("Joined", bound=Connection)
#: One of axis, axis_on_body and axis_in_space.
AXES = ("axis", "axis_on_body", "axis_in_space")
Axes: TypeAlias = tuple[ArrayLike | None, ArrayLike | None, ArrayLike | None]
#: An axis is the same in space and on a body if its components are to within this.
_SAME_AXIS = 1e-9

JOINTS = ("ball", "fixed_point", "revolute", "align", "rod", "prismatic", "cylindrical", "planar",
          "screw", "universal")


class Linkage:
    """Bodies and what joins them; ``Multibody`` adds what makes bodies of it, and the model."""

    def __init__(self, name: str) -> None:
        self.name = as_text("name of a Multibody", name)
        self.ground: Frame = GROUND
        self._bodies: dict[Body, Start] = {}
        self._moving: list[Moving] = []
        self._links: list[Connection] = []
        self._symbols: dict[str, sp.Symbol] = {}

    def ball(
        self, name: str, a: Frame | str, b: Frame | str, *, at: ArrayLike | None = None,
        on_a: ArrayLike | None = None, on_b: ArrayLike | None = None,
    ) -> Joint:
        """Join a point of a to a point of b: three constraints, ``name: x``, ``y`` and ``z``.

        Parameters
        ----------
        a, b : Body, ``ground``, or a name
            In the order of the chain.
        at : three floats, optional
            Where in space the joint is at the start.
        on_a, on_b : three floats, optional
            Where on the bodies it is, in body axes from their origins. Two of the three are
            enough; a position that is not given follows from them. ``at`` alone is enough for
            bodies in known places.
        """
        return self._join(Joint(name, **self._pair(name, a, b, at, on_a, on_b)))

    def fixed_point(
        self, name: str, body: Frame | str, *, at: ArrayLike | None = None,
        on_body: ArrayLike | None = None,
    ) -> Joint:
        """Hold a point of a body at a point of space: three constraints.

        Prefer ``top`` where it is the only joint to the ground: it needs no constraint.
        """
        return self.ball(name, GROUND, body, at=at, on_b=on_body)

    def revolute(
        self, name: str, a: Frame | str, b: Frame | str, *, axis: ArrayLike | None = None,
        axis_on_body: ArrayLike | None = None, axis_in_space: ArrayLike | None = None,
        at: ArrayLike | None = None, on_a: ArrayLike | None = None,
        on_b: ArrayLike | None = None, rate: float = 0.0, angle: float = 0.0,
    ) -> Revolute:
        """Join a and b by a hinge: five constraints, ``name: x``, ``y``, ``z``, ``axis 1, 2``.

        ``axis`` is its direction in space at the start, of any length, as ``axis_in_space`` is;
        ``axis_on_body`` is its direction in the axes of a, or of b where a is the ground. A
        warning tells if ``axis`` is another one in the axes of a. ``rate`` is the angular
        velocity of b against a about it in rad/s, from which an angular velocity that is not
        given follows; ``angle`` what its measure is at the start, in rad. All else as for
        ``ball``.
        """
        return self._join(Revolute(name, **self._pair(name, a, b, at, on_a, on_b),
                                   hinge=self._hinge(
                                       name, a, b, (axis, axis_on_body, axis_in_space), rate,
                                       angle)))

    def align(
        self, name: str, a: Frame | str, b: Frame | str, *, axis: ArrayLike | None = None,
        axis_on_body: ArrayLike | None = None, axis_in_space: ArrayLike | None = None,
        rate: float = 0.0, angle: float = 0.0,
    ) -> Align:
        """Keep one axis of a and b in common: two constraints, ``name: axis 1`` and ``axis 2``.

        For bodies that have a point in common anyway, such as tops in one place, it is a hinge.
        ``axis``, ``rate`` and ``angle`` are those of ``revolute``.
        """
        return self._join(self._hinge(name, a, b, (axis, axis_on_body, axis_in_space), rate, angle))

    def prismatic(
        self, name: str, a: Frame | str, b: Frame | str, *, axis: ArrayLike | None = None,
        axis_on_body: ArrayLike | None = None, axis_in_space: ArrayLike | None = None,
        at: ArrayLike | None = None, on_a: ArrayLike | None = None,
        on_b: ArrayLike | None = None, speed: float = 0.0, travel: float = 0.0,
    ) -> Prismatic:
        """Let b slide along an axis of a without turning: five constraints.

        ``axis`` is its direction in space at the start, along which b moves at ``speed`` in m/s;
        ``at`` any point of it; ``travel`` what its measure is at the start, in m. All else as for
        ``ball``. Constraints: ``name: axis 1``, ``axis 2``, ``across 1``, ``across 2``, ``turn``.
        """
        return self._join(Prismatic(
            name, **self._pair(name, a, b, at, on_a, on_b),
            hinge=self._hinge(name, a, b, (axis, axis_on_body, axis_in_space)),
            speed=float(finite(f"speed of {name!r}", speed, ())),
            travel=float(finite(f"travel of {name!r}", travel, ()))))

    def cylindrical(
        self, name: str, a: Frame | str, b: Frame | str, *, axis: ArrayLike | None = None,
        axis_on_body: ArrayLike | None = None, axis_in_space: ArrayLike | None = None,
        at: ArrayLike | None = None, on_a: ArrayLike | None = None,
        on_b: ArrayLike | None = None, rate: float = 0.0, speed: float = 0.0,
        angle: float = 0.0, travel: float = 0.0,
    ) -> Cylindrical:
        """Let b slide along an axis of a and turn about it: four constraints, as ``prismatic``."""
        return self._join(Cylindrical(
            name, **self._pair(name, a, b, at, on_a, on_b),
            hinge=self._hinge(name, a, b, (axis, axis_on_body, axis_in_space), rate, angle),
            speed=float(finite(f"speed of {name!r}", speed, ())),
            travel=float(finite(f"travel of {name!r}", travel, ()))))

    def planar(
        self, name: str, a: Frame | str, b: Frame | str, *, axis: ArrayLike | None = None,
        axis_on_body: ArrayLike | None = None, axis_in_space: ArrayLike | None = None,
        at: ArrayLike | None = None, on_a: ArrayLike | None = None,
        on_b: ArrayLike | None = None, rate: float = 0.0, angle: float = 0.0,
    ) -> Planar:
        """Keep a plane of b on one of a: three constraints.

        ``axis`` is the normal in space at the start, ``at`` a point of both planes. All else as
        for ``revolute``. Constraints: ``name: axis 1``, ``axis 2``, ``distance``.
        """
        return self._join(Planar(name, **self._pair(name, a, b, at, on_a, on_b),
                                 hinge=self._hinge(
                                     name, a, b, (axis, axis_on_body, axis_in_space), rate,
                                     angle)))

    def screw(
        self, name: str, a: Frame | str, b: Frame | str, *, lead: float,
        axis: ArrayLike | None = None, axis_on_body: ArrayLike | None = None,
        axis_in_space: ArrayLike | None = None, at: ArrayLike | None = None,
        on_a: ArrayLike | None = None, on_b: ArrayLike | None = None, rate: float = 0.0,
        travel: float = 0.0,
    ) -> Screw:
        """Let b turn about an axis of a and move along it by ``lead`` (m) a turn: five constraints.

        A lead below 0 is a left-handed thread. All else as for ``prismatic``, with ``thread`` in
        place of ``turn``.
        """
        pitch = float(finite(f"lead of {name!r}", lead, ()))
        if not pitch:
            raise InputError(f"The lead of {name!r} is 0, and a screw moves; take a revolute.")
        return self._join(Screw(
            name, **self._pair(name, a, b, at, on_a, on_b), lead=pitch,
            hinge=self._hinge(name, a, b, (axis, axis_on_body, axis_in_space), rate),
            travel=float(finite(f"travel of {name!r}", travel, ()))))

    def universal(
        self, name: str, a: Frame | str, b: Frame | str, *, axis_a: ArrayLike,
        axis_b: ArrayLike, at: ArrayLike | None = None, on_a: ArrayLike | None = None,
        on_b: ArrayLike | None = None, rate_a: float = 0.0, rate_b: float = 0.0,
    ) -> Universal:
        """Join a and b by a cross with an axis in each, Cardan's joint: four constraints.

        ``axis_a`` and ``axis_b`` are the directions of its arms in space at the start, at right
        angles; b turns about them at ``rate_a`` and ``rate_b``. All else as for ``ball``.
        """
        arms = _direction(name, "axis_a", axis_a), _direction(name, "axis_b", axis_b)
        if abs(float(arms[0] @ arms[1])) > 1e-6:
            raise InputError(f"The axes of {name!r} are not at right angles: {shown(axis_a)} and "
                             f"{shown(axis_b)}; correct one of them.")
        rates = (float(finite(f"rate_a of {name!r}", rate_a, ())),
                 float(finite(f"rate_b of {name!r}", rate_b, ())))
        return self._join(Universal(name, **self._pair(name, a, b, at, on_a, on_b),
                                    arms=arms, rates=rates))

    def rod(
        self, name: str, a: Frame | str, b: Frame | str, *, on_a: ArrayLike = (0.0, 0.0, 0.0),
        on_b: ArrayLike = (0.0, 0.0, 0.0), length: float | None = None,
    ) -> Rod:
        """Keep two points at a distance: one constraint; by default at that of the start."""
        if length is not None:
            length = positive(f"length of {name!r}", length)
        return self._join(Rod(
            name, *self._two(name, a, b), *self._points(name, on_a, on_b), length=length))

    def spring(
        self, name: str, a: Frame | str, b: Frame | str, *, stiffness: float, length: float = 0.0,
        on_a: ArrayLike = (0.0, 0.0, 0.0), on_b: ArrayLike = (0.0, 0.0, 0.0),
        damping: float = 0.0,
    ) -> Spring:
        """Add V = ½ k (|d| − l)² between a point of a and a point of b (body axes; N/m, m).

        With ``damping`` c, in N s/m, a damper beside it pulls by c d|d|/dt.
        """
        rest = float(finite(f"length of {name!r}", length, ()))
        if rest < 0:
            raise InputError(f"The length of spring {name!r} is {rest}; give 0 or more.")
        return self._join(Spring(
            name, *self._two(name, a, b), *self._points(name, on_a, on_b),
            stiffness=float(finite(f"stiffness of {name!r}", stiffness, ())), length=rest,
            damping=float(finite(f"damping of {name!r}", damping, ())),
        ))

    # ------------------------------------------------------------ inside

    def _hinge(
        self, name: str, a: Frame | str, b: Frame | str, axes: Axes, rate: float = 0.0,
        angle: float = 0.0,
    ) -> Align:
        first, second = self._two(name, a, b)
        return Align(name, first, second, self._axis(name, first, second, axes),
                     float(finite(f"rate of {name!r} in rad/s", rate, ())),
                     float(finite(f"angle of {name!r} in rad", angle, ())))

    def _axis(self, name: str, a: Frame, b: Frame, axes: Axes) -> Array:
        """Return the unit vector of an axis in space at the start."""
        given = {what: e for what, e in zip(AXES, axes, strict=True) if e is not None}
        if len(given) != 1:
            raise InputError(f"{name!r} has {' and '.join(given) or 'no axis'}; give one of axis, "
                             "axis_on_body and axis_in_space.")
        ((what, e),) = given.items()
        axis = _direction(name, "axis", e)
        carrier = next((frame for frame in (a, b) if isinstance(frame, Body)), None)
        if carrier is None:
            return axis
        turned: Array = rotation(self._bodies[carrier].q) @ axis
        if what == "axis_on_body":
            return turned
        if what == "axis" and carrier is a and np.abs(turned - axis).max() > _SAME_AXIS:
            warn(f"The axis of {name!r} is {shown(e)} in space, and {carrier.name!r} is tilted "
                 f"at the start, so that its components on the body differ. Write axis_on_body= "
                 f"if they are components in the axes of {carrier.name!r}, or axis_in_space= if "
                 "they are in space.")
        return axis

    def _pair(
        self, name: str, a: Frame | str, b: Frame | str, at: Any, on_a: Any, on_b: Any
    ) -> dict[str, Any]:
        """Return what all joints with a common point are made of."""
        (first, second), (on_first, on_second) = self._two(name, a, b), self._points(
            name, on_a, on_b)
        return {"a": first, "b": second, "on_a": on_first, "on_b": on_second,
                "at": three_or_none(f"at of {name!r}", at)}

    def _join(self, link: Joined) -> Joined:
        point = next((frame for frame in link.frames if isinstance(frame, Particle)), None)
        if point is not None and type(link) not in (Joint, Rod, Spring):
            raise InputError(f"{link.name!r} asks for axes of {point.name!r}, a point mass, which "
                             "has none; join it by a ball, a rod or a spring, or give a body.")
        self._claim(link.name)
        self._links.append(link)
        return link

    def _claim(self, name: str) -> None:
        as_text(f"a name in Multibody {self.name!r}", name)
        taken = {*(b.name for b in self._bodies), *(point.name for point in self._moving),
                 *(link.name for link in self._links), *self._symbols}
        if name in taken or name in ("ground", "gravity"):
            raise InputError(f"{name!r} is used twice in Multibody {self.name!r}; bodies, joints, "
                             "springs and parameters need names of their own.")
        if not (name.isascii() and name.isidentifier()) or name.startswith("_"):
            raise InputError(f"{shown(name)} is no name for a part of Multibody {self.name!r}; use "
                             "letters, digits and '_', a letter first.")

    def _two(self, name: str, a: Frame | str, b: Frame | str) -> tuple[Frame, Frame]:
        found = [self._frame(frame, shown(name)) for frame in (a, b)]
        if found[0] is found[1] or not any(isinstance(frame, Body) for frame in found):
            raise InputError(f"{name!r} joins a body to itself, or the ground; give two bodies.")
        return found[0], found[1]

    def _frame(self, frame: Any, what: str) -> Frame:
        """Return the ground, a point of it that moves, or a body: itself, or that of a name."""
        if frame is GROUND or (isinstance(frame, str) and frame == "ground"):
            return GROUND
        moving = {one.name: one for one in self._moving}
        if isinstance(frame, str) and frame in moving:
            return moving[frame]
        return frame if isinstance(frame, Moving) and frame in self._moving else self._body(
            frame, what)

    def _body(self, body: Any, what: str) -> Body:
        """Return a body of this builder: itself, or that of a name."""
        names = {known.name: known for known in self._bodies}
        if isinstance(body, str) and body in names:
            return names[body]
        if isinstance(body, Body) and body in self._bodies:
            return body
        raise InputError(
            f"{what} holds on to {shown(body)}, which is no body of Multibody {self.name!r}; pass "
            f"what body(...) returned, or a name: {', '.join(names) or 'there is none yet'}"
            f"{proposal(body, names)}.")

    def _points(self, name: str, on_a: Any, on_b: Any) -> tuple[Array | None, Array | None]:
        return (three_or_none(f"on_a of {name!r}", on_a),
                three_or_none(f"on_b of {name!r}", on_b))


def _direction(name: str, what: str, given: ArrayLike) -> Array:
    """Return a direction, given in any length, as a unit vector."""
    found = three(f"{what} of {name!r}", given)
    if not found.any():
        raise InputError(f"The {what} of {name!r} is zero; give its direction.")
    return unit(found)
