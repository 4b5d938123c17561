"""The C program of a stepper as one typed description: the context of the templates.

``emit.program_of`` turns a ``Derived`` into a ``Program``. All profiles have the same fields; one
that a profile or a system does not have is None.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, fields
from typing import TYPE_CHECKING, Any

from ...core.manifest import SymmetryManifest
from ...core.real_types import Real
from ...core.records import dataclass
from ..kernels.kernel import Constants, EmittedKernel
from ..schemes.splitting_scheme import SplittingScheme
from ..schemes.start_kernels import StartKernels
from ..schemes.step_equations import MeanScheme, SparkScheme
from ..symmetry.frame_symmetries import CoMovingFrame
from ..systems.system import System
from .condensation import Condensation
from .constant_loops import ConstantLoop
from .profiles import ProfileName

if TYPE_CHECKING:
    from ..multibody.model import Model

__all__ = [
    "CompositionText", "Derivatives", "Derived", "DualKernels", "Elements", "Features", "Flows",
    "FrameTransformation", "Iteration", "LaneIteration", "MassTables", "PlainIteration", "Program",
    "StateFunctions", "TableauText",
]

Table = list[list[str]]


@dataclass(frozen=True)
class Derived:
    """A derived stepper: the input of code generation.

    ``system`` is the user's system in its parameters; ``scheme.system`` is the same system with
    constants of the run in place of the subexpressions that depend on parameters alone.
    """

    name: str
    method: str
    scheme: SparkScheme | MeanScheme | SplittingScheme
    system: System
    constants: Constants
    real: Real
    profile: ProfileName = "full"
    frame: CoMovingFrame | None = None
    #: Whether the C has tangents and adjoints.
    derivatives: bool = False
    #: Whether the C has derivatives of adjoints.
    second: bool = False
    #: The model, with the starting values; None for a system without one.
    model: Model | None = None

    @property
    def implicit(self) -> SparkScheme | MeanScheme:
        """The scheme, if a step solves equations: SPARK, IMS or EMS."""
        assert not isinstance(self.scheme, SplittingScheme)
        return self.scheme

    @property
    def is_spark(self) -> bool:
        """Whether the scheme has stages; IMS and EMS have one mean value a step."""
        return isinstance(self.scheme, SparkScheme)


@dataclass(frozen=True)
class Features:
    """Features of a stepper; they select the compiled branches of ``engine/gyrospark``."""

    # The system: g = 0, several g, A v + a = 0.
    constrained: bool = False
    several_constraints: bool = False
    velocity_constraints: bool = False
    # Stages (SPARK) or one mean value (IMS, EMS); loops over element templates; Newton's system
    # without rates of momenta.
    spark: bool = False
    elements: bool = False
    condensed: bool = False
    # Forces F, whose work is counted; time in H or g; time anywhere; a scaled time; inputs.
    forces: bool = False
    time_dependent: bool = False
    forced_by_time: bool = False
    clock: bool = False
    inputs: bool = False
    # A Lagrangian, whose M the engine factorises: EMS of it; M not positive definite.
    lagrangian: bool = False
    energy_momentum: bool = False
    indefinite_mass: bool = False
    # A co-moving frame: forces do work on its motion; multipliers rotate with it.
    frame: bool = False
    frame_work: bool = False
    rotating_multipliers: bool = False
    fixed_point: bool = False
    # A composition of flows: with drag, axes that rotate in space, forces of momenta.
    splitting: bool = False
    drag: bool = False
    rotating_axes: bool = False
    momentum_forces: bool = False
    # The fixed-point iteration: W constant; H_pp Gᵀ = c Gᵀ; W factorised in a step; H_pq = 0.
    constant_schur: bool = False
    scalar_schur: bool = False
    factors: bool = False
    separable: bool = False
    # Functions of a start check constraints; tables in even and odd parts; H exact in every step.
    held: bool = False
    even_odd: bool = False
    exact_energy: bool = False
    # Numbers that do not count all steps; numbers that no vector register has; double-word sums.
    short_real: bool = False
    wide_real: bool = False
    compensated_lanes: bool = False
    # Arrays of lanes that take megabytes.
    large: bool = False
    profile_run: bool = False
    profile_control: bool = False

    @property
    def defines(self) -> list[str]:
        """Names of the macros that the generated file defines, without their prefix."""
        return [field.name.upper() for field in fields(self) if getattr(self, field.name)]


@dataclass(frozen=True)
class Elements:
    """A system as sums over element templates: the indices of the numbers of each instance.

    A template is a dict with its name, its sizes, its tables and its kernels (``elements_of``).
    """

    energies: list[dict[str, Any]]
    constraints: list[dict[str, Any]]
    forces: list[dict[str, Any]]
    #: Names of the constants that instances read.
    used_constants: list[str]
    #: Indices of the entries of G, block by block, and of W.
    blocks: Any
    #: Whether each momentum belongs to one element of H.
    covers_momenta: bool
    #: Tables of the factors of W = G H_pp Gᵀ.
    elimination: dict[str, Any]
    #: Indices of the entries of H_pp and of H_qp − F_p, row by row.
    second: dict[str, Any]
    #: Place of each unknown in the band of Newton's matrix, and half the bandwidth.
    positions: list[int]
    band: int
    #: Pattern of Newton's system without the rates of momenta (``condensation``), or None.
    condensed: Condensation | None

    @property
    def all_templates(self) -> list[dict[str, Any]]:
        """All templates."""
        return [*self.energies, *self.constraints, *self.forces]

    @property
    def kernels(self) -> list[EmittedKernel]:
        """The kernels of all templates, for numbers and for lanes."""
        return [kernel[kind] for template in self.all_templates for kernel in template["kernels"]
                for kind in ("scalar", "lanes") if kernel[kind]]

    @property
    def operations(self) -> dict[str, dict[str, int]]:
        """The operations of one call of each kernel, by its C name."""
        return {f"{template['name']}_{k['name']}": k["operations"]
                for template in self.all_templates for k in template["kernels"]}


@dataclass(frozen=True, kw_only=True)
class Iteration:
    """The structure of a fixed-point iteration, on lanes or on plain numbers."""

    kernels: list[EmittedKernel]
    #: Constant of the run → C of its value.
    folded: dict[str, str] = field(default_factory=dict)
    #: Coefficients of the scaled unknowns (``FastTableau``).
    tables: dict[str, Table] = field(default_factory=dict)
    #: W = G H_pp Gᵀ: whether it is factorised in a step, constant, and with H_pp Gᵀ = c Gᵀ.
    factors: bool
    constant_schur: bool = False
    scalar_schur: bool = False
    #: Whether H_pq = 0.
    separable: bool
    #: Number of subexpressions that H_p shares with H_q.
    shared: int = 0
    #: H is quadratic in p: one solve projects the momentum.
    affine: bool


@dataclass(frozen=True, kw_only=True)
class LaneIteration(Iteration):
    """Fixed-point iteration of profile ``full``, on lanes (``engine/gyrospark/fixed_point``)."""

    #: Functions that kernels call: lane by lane, and on all lanes at once.
    functions: list[str]
    switches: list[str]
    #: ``tables`` in even and odd parts.
    even_odd_tables: dict[str, Table] = field(default_factory=dict)
    #: Whether a kernel sums in double words.
    compensated: bool
    #: Number of past steps that predict the next; bytes for one trajectory, and for all lanes.
    history: int
    memory: int
    batch_memory: int


@dataclass(frozen=True, kw_only=True)
class PlainIteration(Iteration):
    """The fixed-point iteration of profiles ``control`` and ``run``, on plain numbers."""

    #: Those that are not printed, too: their operations and constants count.
    all_kernels: list[EmittedKernel]
    run_constants: list[tuple[str, str]]
    #: Number of backward differences that extrapolate the starting values.
    orders: int
    unknowns: int
    nodes: int


@dataclass(frozen=True)
class FrameTransformation:
    """Transformation of states from a co-moving frame; see ``engine/gyrospark/frames``."""

    #: The type of angles, and the suffix of its functions of <math.h>.
    real: str
    suffix: str
    #: π/2 as three numbers of the type.
    quarter: list[str]
    groups: list[dict[str, Any]]
    #: For each coordinate, the first coordinate of its set; a rotation mixes the q of one set.
    rotation_groups: Sequence[int]
    has_inputs: bool
    axes: int
    rates: list[str]
    kernels: list[EmittedKernel]
    rotates_multipliers: bool
    symmetries: tuple[SymmetryManifest, ...]


@dataclass(frozen=True)
class MassTables:
    """The elimination of the mass matrix of a Lagrangian, without its zeros."""

    #: Number of entries of the factors; whether M is positive definite.
    entries: int
    definite: bool
    #: Pivots in order, and the number of rows that each changes.
    order: Sequence[int]
    counts: list[int]
    #: For all pivots in turn: these rows, the places of their entries in the pivot's column, and
    #: the places of the entries that change.
    flat_rows: list[int]
    flat_slots: list[int]
    flat_targets: list[int]


@dataclass(frozen=True)
class TableauText:
    """The tableau as correctly rounded literals, their shapes, and the exact values to read."""

    rows: dict[str, list[str]]
    shapes: dict[str, str]
    doc: list[str]
    #: The free direction of exact energy (``energy_parameter``), where the scheme has one.
    energy: dict[str, list[str]]


@dataclass(frozen=True)
class CompositionText:
    """The weights of a composition as C, padded to the longest."""

    name: str
    stages: int
    drift: list[str]
    kick: list[str]
    time: list[str]
    gradient: list[str]


@dataclass(frozen=True)
class Flows:
    """Tables and kernels of a splitting, as ``engine/gyrospark/splitting`` expects them."""

    kernels: list[EmittedKernel]
    #: For each body: indices of its quaternion in q, and index of its axis rotation or -1.
    bodies: list[list[int]]
    body_axis: list[int]
    #: For each axis rotation: 0, 1, 2 for a coordinate axis, 3 for any other; whether its rate is
    #: constant if the bodies are symmetric.
    axis_which: list[int]
    axis_steady: list[int]
    #: Rotations that do not commute with free motions: their bodies, and 0 to 3 for their axes.
    further_body: list[int]
    further_which: list[int]
    #: Indices of the coordinates of points in q, and of the entries of y that kicks change.
    free: list[int]
    kicked: list[int]
    momenta: int
    #: Rotations of space: their number; for each body, the index of its rotation or -1; for each
    #: rotated point, the index of its rotation and its indices in q and in y.
    space_axes: int
    body_space: list[int]
    space_points: list[tuple[int, list[int], list[int]]]
    stages: int
    compositions: list[CompositionText]
    half_pi: list[str]
    #: Members of the C struct that a step changes, all its members, and its number of numbers.
    state: list[tuple[str, list[int]]]
    members: list[tuple[str, list[int]]]
    numbers: int
    memory: int
    description: str


@dataclass(frozen=True)
class StateFunctions:
    """Functions of one state in profile ``control``: energy, velocities and their momenta."""

    kernels: list[EmittedKernel]
    own: StartKernels
    #: Names of velocities; empty if they do not determine the momenta.
    velocities: list[str]
    #: Number of constraints that are checked at the start.
    held: int


@dataclass(frozen=True)
class DualKernels:
    """Kernels on dual numbers, and the functions that they call."""

    kernels: list[EmittedKernel]
    #: Nonzero derivatives of constants by parameters, in C.
    chain: list[str]
    #: Function of <math.h> → its derivative.
    slopes: dict[str, str]
    #: Cardinal function → parts of its second derivative.
    cardinals: dict[str, tuple[str, str]]
    #: Functions with switches (min, max, …) and functions of two arguments.
    others: list[str]
    #: Functions of plain numbers that the functions of dual numbers call.
    functions: frozenset[str]


@dataclass(frozen=True)
class Derivatives:
    """Kernels and tables of derivatives, as ``engine/gyrospark/derivatives`` expects them."""

    kernels: list[EmittedKernel]
    #: Columns of the kernels: constants, at least one, and times.
    columns: int
    times: int
    #: Nonzero derivatives dc_i/dθ_j of constants by parameters: i, j and C.
    chain: list[tuple[int, int, str]]
    #: The column of each input; -1 if nothing depends on the input.
    inputs: list[int]
    functions: frozenset[str]
    #: For each element template, its table with the kernels by name.
    element_tables: list[dict[str, Any]]
    #: Kernels on lanes, which linearise one step a lane.
    lane_kernels: list[EmittedKernel]
    #: Whether there are kernels of the derivatives of quantities, and of their rates.
    quantities: bool
    quantity_rates: bool
    #: Kernels on dual numbers: for second derivatives, and for tangents of flows without lanes.
    duals: DualKernels | None
    #: Whether there are second derivatives, and those of impacts.
    second: bool
    impacts: bool
    #: Number of switching functions of H and the forces.
    switches: int


@dataclass(frozen=True)
class Program:
    """The context of the templates: the text, names and sizes that they print."""

    name: str
    version: str
    engine_version: int
    include_check: str
    profile: ProfileName
    features: Features
    title: str
    # The type of numbers: in C, the suffix of its functions, the prefix of its limits.
    R: str
    suffix: str
    limits: str
    # Sizes: coordinates, constraints, unknowns of T1, stages, constraint nodes, multipliers.
    N: int
    M: int
    U: int
    S: int
    P: int
    multipliers: int
    #: Velocity constraints, and V of ``velocity_rows`` as literals.
    rows: int
    velocity_table: Table
    order: int
    # The system, to read.
    hamiltonian: str
    lagrangian: str
    forces: list[str]
    constraints: list[str]
    velocity_constraints: list[str]
    hidden: str
    scheme_doc: list[str]
    unknowns_doc: list[str]
    # Parameters, time, inputs, quantities, and constants of a run: to read, and as C.
    parameters: list[str]
    #: Parameters with their domains.
    domains: list[tuple[str, str]]
    #: Indices of unit quaternions in q.
    quaternions: list[list[int]]
    time: str
    inputs: list[str]
    input_places: list[int]
    quantities: dict[str, str]
    quantity_time: bool
    quantity_kernel: EmittedKernel | None
    constants: dict[str, str]
    constants_c: dict[str, str]
    #: Index → C of the constants that are not evaluated by ``constant_loops``.
    single_constants: dict[int, str]
    constant_loops: list[ConstantLoop]
    run_constants: list[tuple[str, str]]
    # Kernels, and the functions that they call.
    kernels: list[EmittedKernel]
    compensated: bool
    cardinals: list[str]
    switch_functions: frozenset[str]
    costs: dict[str, int]
    #: Profile run: kernels of the iteration that Newton's method lacks, and name → new name.
    iteration_kernels: list[EmittedKernel]
    renamed: dict[str, str]
    # Parts that not every program has.
    tableau: TableauText | None
    mass: MassTables | None
    elements: Elements | None
    lanes: LaneIteration | None
    plain: PlainIteration | None
    #: Why there is no fixed-point iteration.
    no_fixed_point: str
    frame: FrameTransformation | None
    derivatives: Derivatives | None
    flows: Flows | None
    states: StateFunctions | None

    @property
    def iteration(self) -> Iteration | None:
        """The fixed-point iteration of the profile."""
        return self.lanes or self.plain
