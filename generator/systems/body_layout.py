"""Layout of rigid bodies and joints in a system: the indices that views of a trajectory need.

An entry of a vector is a parameter of the system, or a number where it is no parameter of it.
"""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import sympy as sp

from ...core.records import dataclass

__all__ = ["BodyLayout", "ConstraintForce", "Entries", "Entry", "JointLayout",
           "SectionLayout"]

#: A symbol, or a float.
Entry: TypeAlias = Any
Entries: TypeAlias = tuple[Entry, ...]


@dataclass(frozen=True)
class BodyLayout:
    """Where a rigid body is in a system.

    Attributes
    ----------
    name : str
        Name of the body.
    q : tuple of 4 symbols
        Unit quaternion of the body among the system's coordinates, scalar first; the momenta stand
        in the same places.
    inertia : tuple of symbols
        Parameters: I1, I2, I3, its moments, or K11, K12, K13, K22, K23, K33 of J⁻¹.
    x : tuple of 3 symbols, or ()
        Position of the centre of mass among the coordinates; () for a body with a fixed point.
    origin : three entries
        The fixed point in space, for a body that has one.
    centre : three entries, or ()
        The centre of mass in body axes from the origin; () if unknown.
    mass : entry or None
        m; None if unknown.
    """

    name: str
    q: tuple[sp.Symbol, ...]
    inertia: tuple[sp.Symbol, ...]
    x: tuple[sp.Symbol, ...] = ()
    origin: Entries = (0.0, 0.0, 0.0)
    centre: Entries = ()
    mass: Entry | None = None


@dataclass(frozen=True)
class ConstraintForce:
    """How the multiplier λ of one constraint of a joint acts, by its equation.

        g = e·(P_a − P_b)       force λ e on b at P_b, −λ e on a
        g = (R_a n)·(R_b e)     torque λ (R_a n) × (R_b e) on b, its opposite on a
        g = |P_a − P_b|² − l²   force 2λ (P_a − P_b) on b at P_b, its opposite on a at P_a
        g = (R_a n)·(P_b − P_a)  force −λ R_a n on b at P_b, its opposite there on a
        g = sin(f(t) − φ)       torque λ R_a e on b, its opposite on a, where g is 0
        g = sin(φ − 2π s/h)     torque −λ R_a e and force λ (2π/h) R_a e on b at P_b, its
                                opposites on a, where g is 0; s is the travel along e

    Attributes
    ----------
    kind : {"force", "torque", "distance", "normal", "axial", "thread"}
    on_a, on_b : three entries, or ()
        Force: ``on_a`` is e, in space. Torque: ``on_a`` is n in a's axes, ``on_b`` e in b's.
        Normal force: ``on_a`` is n in a's axes. Axial torque and thread: ``on_a`` is e, the axis of
        φ, in a's axes. Thread: ``on_b`` is the lead h, one entry.
    """

    kind: Literal["force", "torque", "distance", "normal", "axial", "thread"]
    on_a: Entries = ()
    on_b: Entries = ()


@dataclass(frozen=True)
class SectionLayout:
    """A section of a beam between two segments, or at a clamp; equations of ``multibody.beam``.

    Attributes
    ----------
    beam : str
        Name of the beam.
    arc : float
        Distance from the start along the beam, in m.
    ratio, spacing : float and entry
        f and h of the curvature κ = (f/h) u.
    stiffness, rest : three entries each
        EI₁, EI₂, GJ, and u without moment.
    holder, turn : "a", "b" or "", and four entries or ()
        For a clamp: the side that holds the beam, and the attitude of the section in its axes.
    extension : three entries, or ()
        GA, EA and the length that stretches; () where a ball joins the segments.
    damping : entry
        Retardation time τ.
    """

    beam: str
    arc: float
    ratio: float
    spacing: Entry
    stiffness: Entries
    rest: Entries
    holder: Literal["a", "b", ""] = ""
    turn: Entries = ()
    extension: Entries = ()
    damping: Entry = 0.0


@dataclass(frozen=True)
class JointLayout:
    """A connection of two bodies.

    Attributes
    ----------
    name : str
    a, b : str
        The bodies' names; "" is the ground.
    on_a, on_b : three entries, or ()
        The joint's point in the axes of each body, from its origin; () for a joint without one.
    axis_a, axis_b : three entries, or ()
        ``axis_b`` is the common axis in the axes of b; ``axis_a`` has n₁ and n₂ in the axes of a,
        six entries, with n₁ × n₂ the axis. () for a joint without one.
    zero : five entries, or ()
        If the system depends on the joint's angle θ: constants of θ = 2 atan2(v, w) + turns with
        (w, v e) = q̄_a q_b c: the four of c, and the turns, a multiple of 2π.
    constraint_forces : tuple of (str, ConstraintForce or None)
        Name of each constraint and its force, None if unknown; empty for a spring.
    section : SectionLayout, optional
        The section of the beam, for a joint of a beam.
    """

    name: str
    a: str
    b: str
    on_a: Entries = ()
    on_b: Entries = ()
    axis_a: Entries = ()
    axis_b: Entries = ()
    zero: Entries = ()
    constraint_forces: tuple[tuple[str, ConstraintForce | None], ...] = ()
    section: SectionLayout | None = None
