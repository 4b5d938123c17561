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
        The body's.
    q : tuple of 4 symbols
        Its unit quaternion among the system's coordinates, scalar first; its momenta stand in the
        same places.
    inertia : tuple of symbols
        Parameters: I1, I2, I3, its moments, or K11, K12, K13, K22, K23, K33 of J⁻¹.
    x : tuple of 3 symbols, or ()
        Position of its origin, the centre of mass, among the coordinates; () where it is held.
    origin : three entries
        Where the origin is held in space, if it is.
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
        g = sin(f(t) − φ)       torque λ R_a e on b, its opposite on a, where g is 0

    Attributes
    ----------
    kind : {"force", "torque", "distance", "axial"}
    on_a, on_b : three entries, or ()
        Of a force ``on_a`` is e, in space; of a torque n in a's axes and e in b's; of an axial
        torque e, the axis of φ, in a's.
    """

    kind: Literal["force", "torque", "distance", "axial"]
    on_a: Entries = ()
    on_b: Entries = ()


@dataclass(frozen=True)
class SectionLayout:
    """A section of a beam between two segments, or at a clamp; equations of ``multibody.beam``.

    Attributes
    ----------
    beam : str
    arc : float
        Distance from the start along the beam.
    ratio, spacing : float and entry
        f and h of the curvature κ = (f/h) u.
    stiffness, rest : three entries each
        EI₁, EI₂, GJ, and u without moment.
    holder, turn : "a", "b" or "", and four entries or ()
        Of a clamp: the side that holds the beam, and the attitude of the section in its axes.
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
        Its point in body axes from the origins; () where it has none.
    axis_a, axis_b : three entries, or ()
        The common axis, in the axes of each; of a as n₁ and n₂, six entries,
        n₁ × n₂ being the axis. () where there is none.
    zero : five entries, or ()
        If the system depends on its angle θ: constants of θ = 2 atan2(v, w) + turns with
        (w, v e) = q̄_a q_b c: the four of c, and the turns, a multiple of 2π.
    constraint_forces : tuple of (str, ConstraintForce or None)
        Name of each of its constraints and its force, None if unknown; empty for a spring.
    section : SectionLayout, optional
        Of a joint of a beam.
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
