"""Components of a multibody system, found by name: bodies, connections, forces, parameters."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import sympy as sp

from ...core.arguments import as_text, join_or, proposal, shown
from ...core.errors import InputError
from ...core.event import Impact
from ...core.inertia import Inertia
from ..symbolic.derivatives import derivative
from ..symbolic.numeric_evaluation import evaluate
from .beam import Beam, BeamEnd
from .body import GROUND, Body, Frame, GeneralisedForce, MovingPoint, Vector
from .coordinates import Arm, FlywheelBody
from .initial_poses import InitialState
from .joints import Connection

__all__ = ["TIME", "Components"]

#: t, in laws of motion and in forces.
TIME = sp.Symbol("t", real=True)


@dataclass(eq=False)
class Components:
    """Bodies, connections, forces and parameters of a multibody system.

    Attributes
    ----------
    gravity : vector
        Acceleration of gravity in space.
    bodies, inertia : dict
        Body → its initial state; rigid body → its moments or tensor of inertia.
    symbols, values : dict
        Symbols that users named; value of each parameter by its name.
    measures : dict
        Symbol of a joint's coordinate or rate → the joint, and the name of the measure.
    placed : set of Connection
        Joints of a robot's file: their rates are defaults of the file, which loops may change.
    """

    name: str
    gravity: Vector
    values: dict[str, float]
    bodies: dict[Body, InitialState] = field(default_factory=dict)
    inertia: dict[Body, Inertia] = field(default_factory=dict)
    moving_points: list[MovingPoint] = field(default_factory=list)
    connections: list[Connection] = field(default_factory=list)
    symbols: dict[str, sp.Symbol] = field(default_factory=dict)
    potentials: list[sp.Expr] = field(default_factory=list)
    forces: list[GeneralisedForce] = field(default_factory=list)
    quantities: dict[str, sp.Expr] = field(default_factory=dict)
    time_scale: sp.Expr | None = None
    inputs: list[sp.Symbol] = field(default_factory=list)
    measures: dict[sp.Symbol, tuple[Connection, str]] = field(default_factory=dict)
    placed: set[Connection] = field(default_factory=set)
    beams: list[Beam] = field(default_factory=list)
    #: Name of a contact or a stop → the impacts of its gaps, which are quantities.
    contacts: dict[str, tuple[Impact, ...]] = field(default_factory=dict)
    #: Name of a latch → the joints that it closes.
    latches: dict[str, list[Connection]] = field(default_factory=dict)
    #: Name of a joint of a robot's file that one joint replaces together with others → that joint.
    aliases: dict[str, Connection] = field(default_factory=dict)

    def claim(self, name: str, kind: Literal["body", "joint", "parameter"]) -> None:
        """Refuse a name that another body, joint or parameter has, and one that C cannot have."""
        as_text(f"a name in Multibody {self.name!r}", name)
        names_of: Mapping[str, Collection[str]] = {
            "body": [*(body.name for body in self.bodies), *(p.name for p in self.moving_points),
                     *self.ends, *(beam.name for beam in self.beams)],
            "joint": [*(link.name for link in self.connections), *self.contacts],
            "parameter": self.symbols}
        if name in names_of[kind] or name in ("ground", "gravity"):
            raise InputError(f"{name!r} is used twice in Multibody {self.name!r}; each body, each "
                             "joint or spring, and each parameter needs a name of its own.")
        if not (name.isascii() and name.isidentifier()) or name.startswith("_"):
            raise InputError(f"{shown(name)} is no name for a part of Multibody {self.name!r}; use "
                             "letters, digits and '_', a letter first.")

    @property
    def impacts(self) -> list[Impact]:
        """The impacts of all contacts."""
        return [impact for impacts in self.contacts.values() for impact in impacts]

    @property
    def ends(self) -> dict[str, BeamEnd]:
        """The ends of the beams by name."""
        return {end.name: end for beam in self.beams for end in (beam.first, beam.last)}

    def end(self, frame: Any) -> BeamEnd | None:
        """Return an end of a beam, given as an object or by name; None for other frames."""
        ends_by_name = self.ends
        return ends_by_name.get(frame) if isinstance(frame, str) else next(
            (end for end in ends_by_name.values() if end is frame), None)

    def frames(self, name: str, a: Frame | str, b: Frame | str) -> tuple[Frame, Frame]:
        """Return the two frames of a connection, at least one of them a body."""
        pair = [self.frame(frame, shown(name)) for frame in (a, b)]
        if pair[0] is pair[1] or not any(isinstance(frame, Body) for frame in pair):
            raise InputError(f"{name!r} joins a body to itself, or the ground; give two bodies.")
        return pair[0], pair[1]

    def frame(self, frame: Any, label: str) -> Frame:
        """Return the ground, a moving point or a body, given as an object or by name.

        ``label`` begins the message for anything else.
        """
        if frame is GROUND or (isinstance(frame, str) and frame == "ground"):
            return GROUND
        moving = {point.name: point for point in self.moving_points}
        if isinstance(frame, str) and frame in moving:
            return moving[frame]
        if isinstance(frame, MovingPoint) and frame in self.moving_points:
            return frame
        return self.body(frame, label, ("ground", *moving))

    def body(self, body: Any, label: str, other_names: Sequence[str] = ()) -> Body:
        """Return a body, given as an object or by name; an end of a beam stands for its segment.

        ``label`` begins the message for anything else, which allows ``other_names`` too.
        """
        bodies_by_name = {candidate.name: candidate for candidate in self.bodies
                          if not isinstance(candidate, FlywheelBody)}
        bodies_by_name |= {end.name: end.segment for end in self.ends.values()}
        if isinstance(body, BeamEnd):
            body = body.segment
        if isinstance(body, str) and body in bodies_by_name:
            return bodies_by_name[body]
        if isinstance(body, Body) and body in bodies_by_name.values():
            return body
        names = [*other_names, *bodies_by_name]
        raise InputError(
            f"{label} connects {shown(body)}, which is no body of Multibody {self.name!r}; pass "
            "what body(...) returned, or a name: "
            f"{', '.join(names) or 'there is none yet'}{proposal(body, names)}.")

    def joint(self, joint: Any, label: str) -> Connection:
        """Return a joint, given as an object or by name; ``label`` begins the message."""
        joints_by_name = {link.name: link for link in self.connections}
        if isinstance(joint, str) and joint in joints_by_name:
            return joints_by_name[joint]
        if isinstance(joint, Connection) and joint in self.connections:
            return joint
        raise InputError(f"{label} connects {shown(joint)}, which is no joint of Multibody "
                         f"{self.name!r}; pass a joint, or a name: "
                         f"{', '.join(joints_by_name) or 'there is none yet'}"
                         f"{proposal(joint, joints_by_name)}.")

    def turning_joint(self, label: str, joint: Connection | str) -> Connection:
        """Return a joint with a hinge or a flywheel's angle; ``label`` names the gear or drive."""
        hinged = self.joint(joint, label)
        self.refuse_measure(hinged, "angle")
        if isinstance(hinged, Arm):
            raise InputError(f"{label} needs a joint with a hinge, and {hinged.name!r} is an arm "
                             "of a universal joint; name another joint, or write a law or couple.")
        return hinged

    def refuse_measure(self, joint: Connection, measure: str) -> None:
        """Refuse a measure that a joint does not have."""
        if measure not in joint.MEASURES:
            raise InputError(f"Joint {joint.name!r} has no {measure}; it has "
                             f"{join_or(joint.MEASURES) if joint.MEASURES else 'no coordinate'}.")

    def start_of_point(self, point: MovingPoint) -> list[tuple[float, float]]:
        """Return (position, velocity) of a moving point at t = 0 along each of the three axes."""
        return [self.initial_value_and_rate(f"path of {point.name!r}", e) for e in point.path]

    def initial_value_and_rate(self, label: str, law: sp.Expr) -> tuple[float, float]:
        """Return f(0) and f'(0) of a law f of the time, with the parameters' values."""
        substitution = {symbol: self.values[name] for name, symbol in self.symbols.items()
                        if name in self.values}
        with np.errstate(all="ignore"):
            value, rate = map(float, evaluate([law, derivative(law, TIME)],
                                              substitution | {TIME: 0.0}))
        if not (math.isfinite(value) and math.isfinite(rate)):
            raise InputError(f"The {label} has no finite value and rate at t = 0, so that no start "
                             "satisfies it; write a law that begins smoothly.")
        return value, rate
