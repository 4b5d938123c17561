"""The C program of a stepper as one typed description: what templates print, and nothing else.

``describe`` in ``emit`` makes a ``Program`` of what was derived. The same description serves
all profiles; a part that a profile or a system does not have is None.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

from ...core.manifest import SymmetryManifest
from ...core.real_types import Real
from ..kernels.kernel import Constants, EmittedKernel
from ..multibody.model import Model
from ..schemes.splitting_scheme import SplittingScheme
from ..schemes.start_kernels import StartKernels
from ..schemes.step_equations import MeanScheme, SparkScheme
from ..symmetry.frame_symmetries import CoMovingFrame
from ..systems.system import System
from .constant_loops import ConstantLoop
from .profiles import ProfileName

__all__ = [
    "CompositionText", "Derivatives", "Derived", "DualKernels", "Elements", "Features", "Flows",
    "FrameTransformation", "LaneIteration", "MassTables", "PlainIteration", "Program",
    "StateFunctions", "TableauText",
]

Table = list[list[str]]


@dataclass(frozen=True)
class Derived:
    """What was derived of a stepper: the input of code generation.

    ``system`` is the one the user knows, with its own parameters; the scheme works on the same
    system with constants of the run in place of parameter-only subexpressions.
    """

    name: str
    method: str
    scheme: SparkScheme | MeanScheme | SplittingScheme
    system: System
    constants: Constants
    real: Real
    profile: ProfileName = "full"
    frame: CoMovingFrame | None = None
    #: Whether tangents and adjoints are written too.
    derivatives: bool = False
    #: Whether the derivatives of adjoints are.
    second: bool = False
    #: The model with the numbers to start from, where there is one.
    model: Model | None = None

    @property
    def implicit(self) -> SparkScheme | MeanScheme:
        """The scheme, where a step solves equations."""
        assert not isinstance(self.scheme, SplittingScheme)
        return self.scheme

    @property
    def is_spark(self) -> bool:
        """Whether the scheme has stages; IMS and EMS have one mean value a step."""
        return isinstance(self.scheme, SparkScheme)


@dataclass(frozen=True)
class Features:
    """What decides which branches of ``engine/gyrospark`` a stepper compiles (see engine.h)."""

    constrained: bool
    several_constraints: bool
    velocity_constraints: bool
    spark: bool
    elements: bool
    forces: bool
    time_dependent: bool
    forced_by_time: bool
    inputs: bool
    lagrangian: bool
    energy_momentum: bool
    indefinite_mass: bool
    frame: bool
    frame_work: bool
    rotating_multipliers: bool
    fixed_point: bool
    splitting: bool
    drag: bool
    rotating_axes: bool
    momentum_forces: bool
    constant_schur: bool
    scalar_schur: bool
    factors: bool
    separable: bool
    held: bool
    even_odd: bool
    exact_energy: bool
    short_real: bool
    wide_real: bool
    compensated_lanes: bool
    large: bool
    profile_run: bool
    profile_control: bool

    @property
    def defines(self) -> list[str]:
        """The names that a generated file defines, without their prefix."""
        return [field.name.upper() for field in fields(self) if getattr(self, field.name)]


@dataclass(frozen=True)
class Elements:
    """A system as sums over element templates: tables of where each instance has its numbers.

    A template is a dict with its name, its sizes, its tables and its kernels.
    """

    energies: list[dict[str, Any]]
    constraints: list[dict[str, Any]]
    forces: list[dict[str, Any]]
    used_constants: list[str]
    #: Where G, block by block, and W keep their entries.
    blocks: Any
    #: Whether each momentum belongs to some element of H.
    covers_momenta: bool
    elimination: dict[str, Any]
    #: Where the rows of H_pp and of H_qp − F_p keep their entries.
    second: dict[str, Any]
    positions: list[int]
    band: int

    @property
    def all(self) -> list[dict[str, Any]]:
        """All templates."""
        return [*self.energies, *self.constraints, *self.forces]

    @property
    def kernels(self) -> list[EmittedKernel]:
        """Their kernels, for numbers and for lanes."""
        return [kernel[kind] for part in self.all for kernel in part["kernels"]
                for kind in ("scalar", "lanes") if kernel[kind]]

    @property
    def operations(self) -> dict[str, dict[str, int]]:
        """The operations of one call of each kernel, by its C name."""
        return {f"{part['name']}_{k['name']}": k["operations"]
                for part in self.all for k in part["kernels"]}


@dataclass(frozen=True)
class LaneIteration:
    """Fixed-point iteration of profile ``full``, on lanes (``engine/gyrospark/fixed_point``)."""

    kernels: list[EmittedKernel]
    #: Constant of the run → C of its value.
    folded: dict[str, str]
    #: Functions that kernels call: lane by lane, and on all lanes at once.
    functions: list[str]
    switches: list[str]
    tables: dict[str, Table]
    even_odd_tables: dict[str, Table]
    compensated: bool
    factors: bool
    constant_schur: bool
    scalar_schur: bool
    separable: bool
    #: How many numbers H_p shares with H_q.
    shared: int
    #: H is quadratic in p: one solve projects the momentum.
    affine: bool
    history: int
    memory: int
    batch_memory: int


@dataclass(frozen=True)
class PlainIteration:
    """The fixed-point iteration of profiles ``control`` and ``run``, on plain numbers."""

    kernels: list[EmittedKernel]
    #: Kernels of which operations and constants count, printed or not.
    known: list[EmittedKernel]
    run_constants: list[tuple[str, str]]
    folded: dict[str, str]
    tables: dict[str, Table]
    factors: bool
    constant_schur: bool
    scalar_schur: bool
    separable: bool
    shared: int
    affine: bool
    #: Backward differences that starting values are made of.
    orders: int
    unknowns: int
    nodes: int


@dataclass(frozen=True)
class FrameTransformation:
    """What transforms states back from a co-moving frame; see ``engine/gyrospark/frames``."""

    #: The type of angles, and the suffix of its functions of <math.h>.
    real: str
    suffix: str
    #: π/2 as three numbers of the type.
    quarter: list[str]
    groups: list[dict[str, Any]]
    #: For each coordinate the first of those that rotate into each other.
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

    entries: int
    definite: bool
    order: Sequence[int]
    counts: list[int]
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
    """What ``engine/gyrospark/splitting`` expects of the generated file."""

    kernels: list[EmittedKernel]
    #: Of each body: coordinates of its quaternion, and its axis rotation or -1.
    bodies: list[list[int]]
    body_axis: list[int]
    #: Axis rotations: 0, 1, 2 for a coordinate axis, 3 for another; whether the rate stays, where
    #: bodies are symmetric.
    axis_which: list[int]
    axis_steady: list[int]
    further_body: list[int]
    further_which: list[int]
    #: Coordinates of points, and entries of y that kicks change.
    free: list[int]
    kicked: list[int]
    momenta: int
    #: Rotations of space: how many, that of each body or -1; of each point that turns, its rotation
    #: and its places in q and in y.
    space_axes: int
    body_space: list[int]
    space_points: list[tuple[int, list[int], list[int]]]
    stages: int
    compositions: list[CompositionText]
    half_pi: list[str]
    #: Members of the state of a step and of all, with their shapes, and how many numbers.
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
    #: Names of velocities, none where momenta do not follow from them.
    velocities: list[str]
    #: Constraints that a start is checked for.
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
    #: Functions with two sides, or of two numbers.
    others: list[str]
    #: Functions on numbers that these call.
    functions: frozenset[str]


@dataclass(frozen=True)
class Derivatives:
    """What ``engine/gyrospark/derivatives`` expects of the generated file."""

    kernels: list[EmittedKernel]
    #: Columns of the kernels: constants, at least one, and times.
    columns: int
    times: int
    #: Nonzero derivatives of constants by parameters: places of both, and C.
    chain: list[tuple[int, int, str]]
    #: The column of each input; -1 of one that nothing depends on.
    inputs: list[int]
    functions: frozenset[str]
    #: Of a system of element templates, each template with its kernels by name.
    parts: list[dict[str, Any]]
    #: Kernels on lanes, where as many steps are linearised at once as there are lanes.
    lanes: list[EmittedKernel]
    #: Whether there is a kernel of the derivatives of quantities, and one of their rates.
    quantities: bool
    quantity_rates: bool
    #: Kernels on dual numbers, for second derivatives, and for tangents where ``flows`` is not on
    #: lanes.
    duals: DualKernels | None
    #: Whether there are second derivatives.
    second: bool
    #: Switching functions of H and the forces in the kernel of them.
    switches: int


@dataclass(frozen=True)
class Program:
    """What the templates print. Names in C are those of the fields' values."""

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
    #: Parameters with what they must be.
    domains: list[tuple[str, str]]
    #: Where q has unit quaternions.
    quaternions: list[list[int]]
    time: str
    inputs: list[str]
    input_places: list[int]
    quantities: dict[str, str]
    quantity_time: bool
    quantity_kernel: EmittedKernel | None
    constants: dict[str, str]
    constants_c: dict[str, str]
    #: Of elements: the same by place, but for those that loops evaluate.
    single_constants: dict[int, str]
    constant_loops: list[ConstantLoop]
    run_constants: list[tuple[str, str]]
    # Kernels, and what they call.
    kernels: list[EmittedKernel]
    compensated: bool
    cardinals: list[str]
    switch_functions: frozenset[str]
    costs: dict[str, int]
    #: Of profile run: kernels of the iteration beside Newton's, and those with another name.
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
    def iteration(self) -> LaneIteration | PlainIteration | None:
        """The fixed-point iteration of the profile."""
        return self.lanes or self.plain
