"""The manifest of a stepper: what its generated C computes, for those who call it.

The generator writes it as JSON beside header and source, the runtime, stores and artefacts read it:
it is all that these two halves know of each other. ``Manifest.from_json`` and ``as_json`` are
inverse, to the byte.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import field
from typing import Any, Literal

from .frozen_dict import FrozenDict
from .json_records import UnfitError, as_json, from_json
from .real_types import RealName
from .records import dataclass

__all__ = ["BodyManifest", "ClockManifest", "ConstraintForceManifest", "Domain", "Entry",
           "FastPathManifest", "FrameManifest", "JointManifest", "Manifest", "NumberManifest",
           "PlacedManifest", "SchemeManifest", "SectionManifest", "SymmetryManifest",
           "SystemManifest", "TableauManifest", "VelocityConstraintsManifest"]

#: An entry of a vector: the name of a parameter, or a number.
Entry = str | float
Domain = Literal["positive", "nonzero", "real"]
Counts = Mapping[str, int]

#: A bounded length, as powers have a bound: a damaged file must not cost hours of arithmetic.
_FRACTION = re.compile(r"-?\d{1,40}(/[1-9]\d{0,39})?")


@dataclass(frozen=True, kw_only=True)
class BodyManifest:
    """A rigid body: names of its coordinates and parameters.

    Attributes
    ----------
    q : the unit quaternion
    inertia, inverse_inertia : I1, I2, I3; or K11, K12, K13, K22, K23, K33 of J⁻¹
    x, origin : position of the origin, the centre of mass; or the fixed origin in space
    centre : centre of mass in body axes from the origin
    mass : name or number
    """

    q: tuple[str, ...]
    inertia: tuple[str, ...] = ()
    inverse_inertia: tuple[str, ...] = ()
    x: tuple[str, ...] = ()
    origin: tuple[Entry, ...] = ()
    centre: tuple[Entry, ...] = ()
    mass: Entry | None = None


@dataclass(frozen=True, kw_only=True)
class ConstraintForceManifest:
    """How the multiplier of a constraint acts on a joint's second body (``body_columns.Pull``)."""

    kind: Literal["force", "torque", "distance", "normal", "axial", "thread"]
    on_a: tuple[Entry, ...] = ()
    on_b: tuple[Entry, ...] = ()


@dataclass(frozen=True, kw_only=True)
class SectionManifest:
    """A section of a beam (``generator.systems.body_layout.SectionLayout``)."""

    beam: str
    arc: float
    ratio: float
    spacing: Entry
    stiffness: tuple[Entry, ...]
    rest: tuple[Entry, ...]
    holder: Literal["a", "b", ""] = ""
    turn: tuple[Entry, ...] = ()
    extension: tuple[Entry, ...] = ()
    damping: Entry = 0.0


@dataclass(frozen=True, kw_only=True)
class JointManifest:
    """A joint: names of its bodies, "" for the ground, vectors in their axes, constraints.

    ``zero`` holds c and full turns of θ = 2 atan2(v, w) + turns, (w, v e) = q̄_a q_b c.
    """

    bodies: tuple[str, str]
    on_a: tuple[Entry, ...] = ()
    on_b: tuple[Entry, ...] = ()
    axis_a: tuple[Entry, ...] = ()
    axis_b: tuple[Entry, ...] = ()
    zero: tuple[Entry, ...] = ()
    constraints: Mapping[str, ConstraintForceManifest | None]
    section: SectionManifest | None = None


@dataclass(frozen=True, kw_only=True)
class PlacedManifest:
    """Names of the quantities with a body's centre of mass and its first two axes in space."""

    x: tuple[str, ...]
    axes: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class ClockManifest:
    """Names in scaled time: of t, the last coordinate, of its momentum, and of σ, a quantity."""

    time: str
    momentum: str
    scale: str


@dataclass(frozen=True, kw_only=True)
class NumberManifest:
    """A number of the C, of profiles with numbers."""

    name: str
    role: Literal["input", "parameter", "time", "q", "p", "velocity", "quantity"]
    domain: Domain
    unit: str | None
    start: float | None


@dataclass(frozen=True, kw_only=True)
class VelocityConstraintsManifest:
    """Velocity constraints A(q) q̇ + a = 0: their text, the velocities in it, their names."""

    expressions: tuple[str, ...]
    velocities: tuple[str, ...]
    names: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class SystemManifest:
    """The system: names and texts.

    Attributes
    ----------
    coordinates, momenta : names
    clock : in scaled time, names of the coordinate and the momentum beside them
    parameters : name → domain; inputs are among them
    hamiltonian, lagrangian : text of H, and of L where H is made of one
    velocity_names : names of q̇ in L
    indefinite : whether the mass matrix of L may have a negative eigenvalue
    placed : bodies that quantities tell the place of
    constraints, hidden : text of g(q, t) and of g_q H_p + g_t
    start_parameters : parameters that decide whether a state is on the constraints
    constraint_names : g0, g1, … where nobody named them
    rigid_body : whether q is the quaternion of one body
    forces, time, inputs : text of forces, name of the time, names of inputs
    time_in_H_or_g : whether H or g depends on the time
    quantities : name → text
    numbers, dt : of profiles with numbers: each number of the C, the model's time step
    remarks, jumps : what a user should know; where forces jump
    """

    name: str
    coordinates: tuple[str, ...]
    momenta: tuple[str, ...]
    clock: ClockManifest | None = None
    parameters: Mapping[str, Domain]
    hamiltonian: str
    lagrangian: str = ""
    velocity_names: tuple[str, ...] = ()
    indefinite: bool = False
    placed: Mapping[str, PlacedManifest] = field(default_factory=FrozenDict)
    constraints: tuple[str, ...]
    hidden: tuple[str, ...]
    start_parameters: tuple[str, ...]
    constraint_names: tuple[str, ...] = field(
        default=(), metadata={"implied": lambda system: _default_names(system)})
    velocity_constraints: VelocityConstraintsManifest | None = None
    rigid_body: bool
    bodies: Mapping[str, BodyManifest] = field(default_factory=FrozenDict)
    joints: Mapping[str, JointManifest] = field(default_factory=FrozenDict)
    forces: tuple[str, ...] = ()
    time: str | None = None
    inputs: tuple[str, ...] = ()
    time_in_H_or_g: bool = False
    quantities: Mapping[str, str] = field(default_factory=FrozenDict)
    quantities_take_time: bool = field(default=False, metadata={"beside": "quantities"})
    numbers: tuple[NumberManifest, ...] = ()
    dt: float | None = field(default=None, metadata={"beside": "numbers"})
    remarks: tuple[str, ...] = ()
    jumps: str = ""

    def __post_init__(self) -> None:
        if not self.constraint_names:
            object.__setattr__(self, "constraint_names", _default_names(self))

    @property
    def event_quantities(self) -> tuple[str, ...]:
        """Names of possible event functions: quantities, coordinates, momenta, and t if scaled."""
        time = () if self.clock is None else (self.clock.time,)
        return (*self.quantities, *self.coordinates, *self.momenta, *time)

    @property
    def velocity_constraint_names(self) -> tuple[str, ...]:
        """The name of each velocity constraint."""
        rows = self.velocity_constraints
        return () if rows is None else rows.names


@dataclass(frozen=True, kw_only=True)
class SchemeManifest:
    """The scheme and the sizes of its step.

    Attributes
    ----------
    method, kind : "3-G-L"; a tableau, a splitting, or the mean of both ends
    stages, constraint_nodes : of a tableau
    order : of convergence
    compositions, longest_flow : of a splitting: their names; its longest free motion over h
    unknowns : of the equations of a step
    unknowns_are_state : whether they are (q, p) at its end
    multipliers, reactions : for each constraint; for each velocity constraint
    keeps_momentum_constraint : whether g_q H_p + g_t = 0 after a step
    exact_energy : whether a free number of the tableau makes H exact
    remarks : what a user should know
    """

    method: str
    kind: Literal["spark", "splitting", "mean"]
    stages: int | None
    constraint_nodes: int | None
    order: int
    compositions: tuple[str, ...] = ()
    longest_flow: float | None = None
    unknowns: int
    unknowns_are_state: bool
    multipliers: int
    reactions: int = 0
    keeps_momentum_constraint: bool
    exact_energy: bool = False
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class SymmetryManifest:
    """Symmetry of a co-moving frame: A of its vector field, J, and the conditions for it.

    ``A`` has rows (i, j, fraction); ``vanishing`` are the conditions as polynomials, each a list of
    terms (fraction, {parameter: power}).
    """

    name: str
    group: int
    meaning: str
    A: tuple[tuple[int, int, str], ...]
    J: str
    conditions: tuple[str, ...]
    vanishing: tuple[tuple[tuple[str, Counts], ...], ...]


@dataclass(frozen=True, kw_only=True)
class FrameManifest:
    """Symmetries of the co-moving frame."""

    symmetries: tuple[SymmetryManifest, ...]


@dataclass(frozen=True, kw_only=True)
class TableauManifest:
    """A tableau of a user: the properties it lacks, and the residual of each condition."""

    name: str
    remarks: tuple[str, ...]
    conditions: Mapping[str, Mapping[str, str]]


@dataclass(frozen=True, kw_only=True)
class FastPathManifest:
    """The fixed-point iteration: what was proved for it, or why there is none."""

    available: bool
    reason: str | None = None
    constant_schur: bool = field(default=False, metadata={"beside": "available"})
    scalar_correction: bool = field(default=False, metadata={"beside": "available"})
    gauss_seidel: bool = field(default=False, metadata={"beside": "available"})
    operations: Mapping[str, Counts] = field(
        default_factory=FrozenDict, metadata={"beside": "available"})


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """The contract between generated C and the programs that call it.

    Attributes
    ----------
    schema, generator : version of this form, and of the program
    name : of the files and of the functions in C
    profile, hash : what was written; a hash of the files, of profiles with numbers
    system, scheme, frame, tableau, fast_path : see their classes
    real : floating-point type
    operations : kernel → operation → how many
    """

    schema: int
    generator: str
    name: str
    profile: str = field(default="full", metadata={"written": True})  # old ones lack it
    hash: str = ""
    system: SystemManifest
    scheme: SchemeManifest
    frame: FrameManifest | None = None
    tableau: TableauManifest | None = None
    fast_path: FastPathManifest
    real: RealName
    operations: Mapping[str, Counts]

    @classmethod
    def from_json(cls, content: Any) -> Manifest:
        """Return the manifest of JSON content.

        Raises
        ------
        UnfitError
            With the place of a value that does not belong there, a key that is unknown or missing.
        """
        manifest = from_json(cls, content)
        manifest._check()
        return manifest

    @classmethod
    def from_text(cls, text: str) -> Manifest:
        """Return the manifest of the text of a file; raises as ``from_json`` does."""
        return cls.from_json(json.loads(text))

    def as_json(self) -> dict[str, Any]:
        """Return the content of its file."""
        return as_json(self)

    @property
    def text(self) -> str:
        """The text of its file."""
        return json.dumps(self.as_json(), indent=2, ensure_ascii=False) + "\n"

    @property
    def warnings(self) -> list[tuple[str, str]]:
        """Remarks on tableau, scheme and system, with the part of each."""
        parts = (("tableau", self.tableau), ("scheme", self.scheme), ("system", self.system))
        return [(name, remark) for name, source in parts if source is not None
                for remark in source.remarks]

    def _check(self) -> None:
        """Raise UnfitError for sizes that do not fit each other, and unusable symmetries."""
        system, n = self.system, len(self.system.coordinates)
        for name, count, expected in (
                ("momenta", len(system.momenta), n),
                ("velocity_names", len(system.velocity_names) or n, n),
                ("constraint_names", len(system.constraint_names), len(system.constraints)),
                ("coordinates", n, 4 if system.rigid_body else n)):
            if count != expected:
                raise UnfitError(f"has {count} where {expected} belong", f"system.{name}")
        if system.clock is not None and system.clock.scale not in system.quantities:
            raise UnfitError("is no quantity", "system.clock.scale")
        if not self.fast_path.available and self.fast_path.reason is None:
            raise UnfitError("lacks 'reason'", "fast_path")
        for symmetry in () if self.frame is None else self.frame.symmetries:
            if not _is_usable(symmetry, {*system.parameters}, n):
                raise UnfitError("is no symmetry of the system", f"frame.{symmetry.name}")


def _is_usable(symmetry: SymmetryManifest, parameters: set[str], n: int) -> bool:
    """Return whether A is an n × n matrix of fractions, and name and conditions are of parameters.

    Powers are bounded as fractions are: see ``_FRACTION``.
    """
    has_matrix = all(0 <= min(i, j) <= max(i, j) < n and _FRACTION.fullmatch(x)
                     for i, j, x in symmetry.A)
    terms = [term for polynomial in symmetry.vanishing for term in polynomial]
    has_conditions = all(_FRACTION.fullmatch(factor) and {*powers} <= parameters
                         and all(0 < power < 100 for power in powers.values())
                         for factor, powers in terms)
    return symmetry.name in parameters and has_matrix and has_conditions


def _default_names(system: SystemManifest) -> tuple[str, ...]:
    """Return g0, g1, …: the names of constraints that nobody named."""
    return tuple(f"g{i}" for i in range(len(system.constraints)))
