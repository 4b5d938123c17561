"""Header, source and manifest of a derived stepper.

    program_of  Derived → Program
    emit        Program → the text of three files, by templates
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import sympy as sp

from ..._version import __version__
from ...core.real_types import REALS, Real
from ...core.records import dataclass
from ...engine.amalgamate import INCLUDE_CHECK, amalgamate
from ..kernels.c_printer import ON_LANES, SWITCHES, CPrinter
from ..kernels.kernel import Constants, EmittedKernel, Target, emit_kernel, sums_products
from ..schemes.frame_kernels import FrameRotation
from ..schemes.lagrangian_midpoint import LagrangianEMS
from ..schemes.splitting_scheme import SplittingScheme
from ..schemes.step_equations import MeanScheme, SparkScheme, common_kernels
from ..symbolic.cardinal_functions import c_names_with_needs
from ..symbolic.phases import START
from ..symbolic.shared_subexpressions import text_of
from ..systems.lagrangian import LagrangianSystem
from ..systems.moving_frame import CoMovingSystem, energy_of
from ..systems.repeated_structure import Structure
from ..systems.time_scale import ScaledSystem
from ..tableaux.energy_parameter import energy_values
from ..tableaux.tableau import FIELDS, Tableau, is_quadratic
from ..tableaux.velocity_rows import velocity_enclosures
from .bytecode import Bytecode
from .c_lines import wrap_lines
from .constant_loops import split_constants
from .derivatives import LINEARISATION, derivatives_of
from .elements import elements_of
from .lane_iteration import lane_iteration
from .manifest import frame_manifest, hidden_constraints, manifest_text
from .manifest_numbers import domain_of
from .mass_tables import mass_tables
from .plain_iteration import additional_kernels, plain_iteration
from .program import (
    Derivatives,
    Derived,
    Elements,
    Features,
    Flows,
    FrameTransformation,
    LaneIteration,
    PlainIteration,
    Program,
    StateFunctions,
    TableauText,
)
from .second_order import refuse_second
from .solver_costs import solver_costs
from .splitting_flows import flow_lanes, flows_of, half_pi_words
from .state_functions import quantity_kernel, state_functions

__all__ = ["Source", "emit", "program_of"]

TEMPLATES = Path(__file__).resolve().parents[2] / "templates"
#: Version of the interface between generated files and ``engine/gyrospark/engine.h``.
ENGINE_VERSION = 1
#: Placeholder in the header, replaced by the hash of the three files.
_IDENTITY = "HASH OF THE FILES"
#: Bits of the number of steps of a run, at most.
_COUNTER_BITS = 53
#: Coordinates of a system whose arrays of lanes take megabytes.
_LARGE = 1000


@dataclass(frozen=True)
class Source:
    """The three files of a stepper, as text.

    The C includes headers of the engine; the C of profiles ``control`` and ``run`` contains them.
    """

    name: str
    header: str
    source: str
    manifest: str

    def files(self, *, standalone: bool = True) -> dict[str, str]:
        """Return file name → text.

        ``standalone`` puts the engine into the C. The compiler, the key of the cache and the
        identity of stored runs use this text: another engine is another stepper.
        """
        source = amalgamate(self.source) if standalone else self.source
        return {
            f"{self.name}.h": self.header,
            f"{self.name}.c": source,
            f"{self.name}.json": self.manifest,
        }

def emit(derived: Derived, elements: bool | None = None) -> Source:
    """Return the C and the manifest.

    ``elements`` decides whether the C loops over the instances of the system's element templates;
    with None, it does if that saves work.
    """
    program = program_of(derived, elements)
    context = {field.name: getattr(program, field.name) for field in fields(program)}
    context |= {"full": program.profile == "full", "iteration": program.iteration,
                "identity": _IDENTITY,
                "derivative_parts": program.derivatives.element_tables if program.derivatives
                else []}
    kind = "control" if program.profile == "control" else "stepper"
    templates = (_environment().get_template(f"{kind}.{ending}.jinja") for ending in "hc")
    header, source = (wrap_lines(template.render(context)) for template in templates)
    manifest = manifest_text(derived, program, _IDENTITY)
    # The texts contain a placeholder for the hash of all three. Profile full needs no hash: the
    # cache has a key of its own.
    if program.profile == "full":
        return Source(program.name, header, source, manifest)
    files = header, amalgamate(source), manifest
    identity = hashlib.sha256("\0".join(files).encode()).hexdigest()[:32]
    return Source(program.name, *(text.replace(_IDENTITY, identity) for text in files))


def program_of(derived: Derived, elements: bool | None = None) -> Program:
    """Return the context of the templates: kernels, constants, tables, sizes and formulas.

    Parameters
    ----------
    derived : Derived
        The scheme, its system and the kind of numbers.
    elements : bool or None
        Whether kernels are those of element templates, in loops over their instances; with None,
        they are if that saves work.

    Raises
    ------
    InputError
        If the profile does not support the system or the tableau; see ``plain_iteration``.
    """
    scheme, system, real = derived.scheme, derived.system, derived.real
    if derived.second:
        refuse_second(derived)  # a frame, a Lagrangian or a large system has no second derivatives
    is_control = derived.profile == "control"
    # the equations of a step, and their fixed-point iteration: on lanes in profile full, on plain
    # numbers in profiles control and run
    code = _step_code(derived, elements)
    plain, lanes = code.plain, code.lanes
    # renamed: name of a kernel of the plain iteration that a Newton kernel has too → its new name
    iteration_kernels, renamed = additional_kernels(code.kernels, plain.kernels if plain else [])
    frame = _frame(derived)
    quantities, states = quantity_kernel(derived), state_functions(derived)
    # kernels of a step read constants of a run; kernels of one state read the parameters
    constants, constant_calls = _run_constants(derived, code.all_kernels, code.elements)
    derivatives = derivatives_of(derived, constants["constants_c"], code.elements, lanes) if (
        derived.derivatives) else None
    calls = _calls(code.all_kernels, derivatives, states)
    if derivatives and lanes:
        # the C has each function on lanes once, for kernels of a step and of derivatives
        lanes = _with_functions(lanes, calls.of_derivatives)
    scalar_calls = calls.scalar.union(constant_calls, quantities.functions if quantities else ())
    # C of profile control or of a splitting has no use of costs, by which others select the solver
    # of a step. Costs are counted by names of kernels; a plain iteration's kernels have Newton's
    # names, so they are not counted
    costs = {} if is_control or isinstance(scheme, SplittingScheme) else solver_costs(
        scheme, code.kernels if plain else code.all_kernels, code.elements, real)
    return Program(
        **_identity(derived),
        features=_features(derived, code, frame, states),
        **_sizes(derived),
        **_formulas(derived, code.elements),
        **_arguments(derived, constants["constants_c"]),
        **constants,
        quantity_kernel=quantities,
        run_constants=plain.run_constants if plain else [],
        # the template of profile ``control`` prints one list of kernels
        kernels=[*code.kernels, *iteration_kernels] if is_control else code.kernels,
        compensated=any(map(sums_products, code.all_kernels)),
        cardinals=sorted(c_names_with_needs(calls.of_kernels)),
        switch_functions=SWITCHES & scalar_calls,
        costs=costs,
        iteration_kernels=iteration_kernels,
        renamed=renamed,
        tableau=_tableau(scheme, real) if isinstance(scheme, SparkScheme) else None,
        mass=mass_tables(system) if isinstance(system, LagrangianSystem) else None,
        elements=code.elements,
        lanes=lanes,
        plain=plain,
        no_fixed_point=code.refusal,
        frame=frame,
        derivatives=derivatives,
        flows=code.flows,
        states=states,
    )


class _StepCode(NamedTuple):
    """The equations of a step, and their fixed-point iteration."""

    #: Kernels of the equations; none of a system that is summed over element templates.
    kernels: list[EmittedKernel]
    elements: Elements | None
    flows: Flows | None  # of a splitting
    #: The iteration on vector lanes, the one on plain numbers, and why there is none.
    lanes: LaneIteration | None
    plain: PlainIteration | None
    refusal: str
    #: Kernels of the equations and of the iteration, which read the constants of a run.
    all_kernels: list[EmittedKernel]


def _step_code(derived: Derived, elements: bool | None) -> _StepCode:
    """Return the code of a step; ``elements``: whether kernels are those of element templates."""
    element_sums = _elements(derived, elements)
    flows = flows_of(derived) if isinstance(derived.scheme, SplittingScheme) else None
    kernels = [] if element_sums else _step_kernels(derived, flows)
    lanes, plain, refusal = _iterations(derived, element_sums, flows)
    return _StepCode(kernels, element_sums, flows, lanes, plain, refusal, [
        *kernels, *(plain.all_kernels if plain else []), *(lanes.kernels if lanes else []),
        *(element_sums.kernels if element_sums else [])])


def _identity(derived: Derived) -> dict[str, Any]:
    """Return the name, versions, profile and title of a stepper, and its type of numbers."""
    real = derived.real
    return {
        "name": derived.name, "version": __version__, "engine_version": ENGINE_VERSION,
        "include_check": INCLUDE_CHECK, "profile": derived.profile,
        "title": f"{derived.method} for {derived.system.name.replace('_', ' ')}",
        "R": real.c_type, "suffix": real.suffix.lower(), "limits": real.limits,
    }


class _Calls(NamedTuple):
    """Functions of <math.h> and of the engine that the C calls.

    Attributes
    ----------
    of_derivatives : frozenset of str
        Called by derivatives and by functions of one state.
    of_kernels : frozenset of str
        Called by these and by the kernels of a step, on numbers or on lanes.
    scalar : frozenset of str
        Called on numbers. Kernels on lanes call versions of their own (``LaneIteration``).
    """

    of_derivatives: frozenset[str]
    of_kernels: frozenset[str]
    scalar: frozenset[str]


def _calls(
    step_kernels: Sequence[EmittedKernel], derivatives: Derivatives | None,
    states: StateFunctions | None,
) -> _Calls:
    """Return the functions that the kernels of a step, derivatives and state functions call."""
    on_numbers = _called_by(states.kernels if states else [])
    of_derivatives = on_numbers
    if derivatives:
        on_numbers |= derivatives.functions
        of_derivatives = on_numbers | _called_by(derivatives.lane_kernels)
    scalar_kernels = [k for k in step_kernels if not k.name.startswith("lanes_")]
    return _Calls(of_derivatives, of_derivatives | _called_by(step_kernels),
                  on_numbers | _called_by(scalar_kernels))


def _called_by(kernels: Iterable[EmittedKernel]) -> frozenset[str]:
    """Return the functions that kernels call."""
    return frozenset[str]().union(*(kernel.functions for kernel in kernels))


def _arguments(derived: Derived, constants_c: Mapping[str, str]) -> dict[str, Any]:
    """Return the parameters, the time and the inputs of the system, and its unit quaternions.

    ``constants_c`` are the constants of a run, among which inputs have a place if a kernel reads
    them.
    """
    system = derived.system
    index_of = {x: i for i, x in enumerate(system.q)}
    return {
        "parameters": [str(p) for p in system.parameters],
        "domains": [(str(p), domain_of(p)) for p in system.parameters],
        "quaternions": [[index_of[x] for x in body.q] for body in system.bodies if body.q],
        "time": str(system.time) if system.is_nonautonomous else "",
        # other profiles have no arrays of inputs: the parameters define them
        "inputs": [str(u) for u in system.inputs] if derived.profile == "full" else [],
        "input_places": [list(constants_c).index(str(u)) for u in system.inputs
                         if str(u) in constants_c],
        "quantity_time": bool(system.quantities) and system.time is not None,
    }


def _sizes(derived: Derived) -> dict[str, Any]:
    """Return the numbers of coordinates, constraints, stages, nodes, unknowns, and the order."""
    scheme, system, tableau = derived.scheme, derived.system, derived.scheme.tableau
    real = derived.real
    velocity_table: list[list[str]] = []
    if tableau and system.velocity_count:
        velocity_table = [[real.literal(real.round(e)) for e in row]
                          for row in velocity_enclosures(tableau)]
    return {
        "N": system.n, "M": system.m, "U": scheme.size,
        "S": tableau.s if tableau else 0, "P": tableau.p if tableau else 0,
        # of constraints at the nodes, then of velocity constraints at the stages
        "multipliers": scheme.multipliers * system.m + scheme.reactions * system.velocity_count,
        "rows": system.velocity_count,
        "velocity_table": velocity_table,
        "order": scheme.order,
    }


def _formulas(derived: Derived, elements: Elements | None) -> dict[str, Any]:
    """Return the formulas in comments of the C; element templates have comments of their own."""
    scheme, system = derived.scheme, derived.system
    energy: sp.Expr | str = energy_of(system)
    lagrangian = ""
    if isinstance(system, LagrangianSystem):
        energy, lagrangian = system.texts()
    # equal formulas, as the elements have, are printed once
    hidden = dict.fromkeys(f"f = {comment(f)}" for f in hidden_constraints(derived, elements))
    return {
        "hamiltonian": "" if elements else comment(energy),
        "lagrangian": comment(lagrangian) if lagrangian else "",
        "forces": [comment(f) for f in system.forces],
        "constraints": [] if elements else [comment(g) for g in system.constraints],
        "velocity_constraints": [comment(e) for e in system.velocity_constraints],
        "hidden": ", ".join(hidden) or "no constraint",
        "scheme_doc": _scheme_doc(scheme),
        "unknowns_doc": _unknowns_doc(scheme),
        "quantities": {name: comment(e) for name, e in system.quantities.items()},
    }


def _run_constants(
    derived: Derived, kernels: Iterable[EmittedKernel], elements: Elements | None
) -> tuple[dict[str, Any], set[str]]:
    """Return the constants of a run as fields of ``Program``, and the functions that their C calls.

    Only constants that a kernel reads are computed.
    """
    used = frozenset[str]().union(*(kernel.constants for kernel in kernels),
                                  elements.used_constants if elements else ())
    definitions = {str(s): e for e, s in derived.constants.definitions.items() if str(s) in used}
    # phases depend on the time at the start of the run, which is stored among the parameters
    names = {p: f"par->{p}" for p in derived.constants.parameters}
    printer = CPrinter(derived.real, names | {START: f"par->{derived.system.time}"},
                       explicit=derived.profile == "control")
    constants_c = {name: printer(e) for name, e in definitions.items()}
    single_constants, constant_loops = split_constants(constants_c)
    return {"constants": {name: comment(e) for name, e in definitions.items()},
            "constants_c": constants_c, "single_constants": single_constants,
            "constant_loops": constant_loops}, printer.functions


def _with_functions(lanes: LaneIteration, functions: frozenset[str]) -> LaneIteration:
    """Return the iteration on lanes with the functions that kernels of derivatives call too."""
    return replace(lanes, functions=sorted({*lanes.functions, *(functions - ON_LANES)}),
                   switches=sorted({*lanes.switches, *(functions & ON_LANES)}))


class _Iterations(NamedTuple):
    """The fixed-point iteration on lanes or on plain numbers: one of the two at most."""

    lanes: LaneIteration | None = None
    plain: PlainIteration | None = None
    refusal: str = ""  # why profile ``full`` has none


def _iterations(derived: Derived, elements: Elements | None, flows: Flows | None) -> _Iterations:
    """Return the fixed-point iteration of a step.

    Compositions of flows solve no equations: their "iteration" is the lanes of many trajectories.
    """
    if flows is not None:
        return _Iterations(lanes=flow_lanes(derived, flows) if derived.profile == "full" else None)
    if derived.profile == "full":
        lanes, refusal = lane_iteration(derived, elements)
        return _Iterations(lanes, refusal=refusal)
    return _Iterations(plain=plain_iteration(derived))


def _step_kernels(derived: Derived, flows: Flows | None) -> list[EmittedKernel]:
    """Return the kernels of the step equations, or of the flows of a splitting, for one state.

    Profile ``control`` has the iteration alone: it needs only the kernels of a linearisation.
    """
    scheme, constants, real = derived.scheme, derived.constants, derived.real
    is_control = derived.profile == "control"
    if isinstance(scheme, SplittingScheme):
        state_kernels = [k for k in scheme.state_kernels() if not is_control or (
            derived.derivatives and k.name in LINEARISATION)]
        return [*(emit_kernel(k, constants, real) for k in state_kernels),
                *(flows.kernels if flows else [])]
    if is_control and not derived.derivatives:
        return []
    return [emit_kernel(k, constants, real)
            for k in [*common_kernels(scheme.system), *scheme.kernels()]
            if not is_control or k.name in LINEARISATION]


def _elements(derived: Derived, requested: bool | None) -> Elements | None:
    """Return the system as sums over element templates, or None if its kernels are written out.

    ``requested`` is the user's choice; None selects element templates where they save work.
    """
    system = derived.scheme.system
    if (derived.profile != "full" or derived.second or system.velocity_count
            or isinstance(system, LagrangianSystem) or isinstance(derived.scheme, SplittingScheme)):
        return None  # the mass matrix of a Lagrangian and reactions couple all elements
    if isinstance(system, CoMovingSystem) and system.frame_velocity:
        return None  # the velocity of the frame is a kernel of the whole system
    if isinstance(system, ScaledSystem):
        return None  # the scale couples all coordinates
    structure = Structure(system)
    if not (structure.is_worthwhile if requested is None else requested):
        return None
    return elements_of(structure, derived)


def _features(
    derived: Derived, code: _StepCode, frame: FrameTransformation | None,
    states: StateFunctions | None,
) -> Features:
    """Return the features of the engine that a stepper needs; each becomes a macro in C.

    ``states`` are the functions of one state of profile ``control``. ``Features`` says what each
    feature means; those that are not named here are False.
    """
    scheme, system = derived.scheme, derived.system
    flags = _system_features(derived) | {"spark": derived.is_spark}
    if isinstance(scheme, SparkScheme):
        flags["exact_energy"] = scheme.exact_energy
    if isinstance(scheme, SplittingScheme):
        flags |= {"splitting": True, "drag": scheme.has_drag,
                  "rotating_axes": bool(scheme.splitting.space),
                  "momentum_forces": scheme.splitting.other_forces}
        if derived.profile == "control":
            flags["forces"] = False  # their work is not counted
    if isinstance(system, LagrangianSystem):
        flags |= {"lagrangian": True, "energy_momentum": isinstance(scheme, LagrangianEMS),
                  "indefinite_mass": not system.is_definite}
    if frame is not None:
        flags |= {"frame": True, "rotating_multipliers": frame.rotates_multipliers}
    if isinstance(scheme.system, CoMovingSystem):
        flags["frame_work"] = bool(scheme.system.frame_velocity)
    if states is not None:  # constraints that a start is checked for
        flags["held"] = states.held > 0
    elements, lanes = code.elements, code.lanes
    if elements is not None:
        flags |= {"elements": True, "condensed": elements.condensed is not None}
    if iteration := lanes or code.plain:
        flags |= {"constant_schur": iteration.constant_schur,
                  "scalar_schur": iteration.scalar_schur,
                  "factors": iteration.factors, "separable": iteration.separable}
    if lanes is not None:
        # the engine's iteration is on lanes: the C of other profiles has one of its own, and a
        # splitting has kernels on lanes and no equations
        flags |= {"fixed_point": not isinstance(scheme, SplittingScheme),
                  "even_odd": bool(lanes.even_odd_tables), "compensated_lanes": lanes.compensated,
                  "large": elements is not None and system.n >= _LARGE}
    return Features(**flags)


def _system_features(derived: Derived) -> dict[str, bool]:
    """Return the features of constraints, forces, time and inputs, of numbers and profile."""
    system, real, profile = derived.system, derived.real, derived.profile
    return {
        "constrained": system.m > 0,
        "several_constraints": system.m > 1,
        "velocity_constraints": system.velocity_count > 0,
        "forces": bool(system.forces),
        "time_dependent": system.is_time_dependent,
        "forced_by_time": system.is_nonautonomous,
        "clock": isinstance(system, ScaledSystem),  # scaled time: a coordinate is the clock
        "inputs": bool(system.inputs) and profile == "full",
        "short_real": real.bits < _COUNTER_BITS,
        "wide_real": real.wide,
        "profile_run": profile == "run",
        "profile_control": profile == "control",
    }


@cache
def _environment() -> jinja2.Environment:
    """Return Jinja's environment for C."""
    options: dict[str, Any] = {
        "undefined": jinja2.StrictUndefined,  # a misspelt name is an error, not an empty text
        "trim_blocks": True,
        "lstrip_blocks": True,
        "keep_trailing_newline": True,
        "autoescape": False,  # this is C, not HTML
    }
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES), bytecode_cache=Bytecode(str(options)), **options)
    environment.filters["operations"] = operations_text
    return environment


def operations_text(operations: dict[str, int]) -> str:
    """Return e.g. ``33 add, 63 mul``."""
    return ", ".join(f"{count} {kind}" for kind, count in operations.items()) or "no operations"


def _frame(derived: Derived) -> FrameTransformation | None:
    """Return the transformation of states from the co-moving frame to the frame of the user.

    A group of symmetries rotates a state by the angles a ω t, computed as double words: ω is the
    parameter of a group of one symmetry, or the length of the vector of parameters of a larger
    group, whose direction is the axis; a > 0 are the frequencies of generators (A³ = −a² A).
    """
    frame, system, real = derived.frame, derived.system, derived.real
    if frame is None:
        return None
    # the angle after 10⁹ steps has 30 bits before the point, and float has 24 in all
    angle_type = REALS["double"] if real.name == "float" else real
    rotation = FrameRotation(frame, system)
    target = Target(real.c_type, constants="parameters_t", prefix="")
    rates: list[str] = []
    for group, a in rotation.angles:
        literal, axis = angle_type.literal(a), rotation.axes[group]
        # the parameter of one symmetry is one number; the length of a vector is a double word
        rates.append(f"product_of({literal}, par->{frame.groups[group][0].name})" if axis is None
                     else f"times((double_word){{ {literal}, 0 }}, omega{axis})")
    return FrameTransformation(
        real=angle_type.c_type,
        suffix=angle_type.suffix.lower(),
        quarter=half_pi_words(angle_type, count=3),
        groups=[{"names": [symmetry.name for symmetry in group], "axis": axis}
                for group, axis in zip(frame.groups, rotation.axes, strict=True)],
        rotation_groups=rotation.sets,
        has_inputs=bool(system.forces or system.inputs),
        axes=rotation.components,
        rates=rates,
        kernels=[emit_kernel(kernel, Constants(system.parameters), real, target)
                 for kernel in rotation.kernels()],
        rotates_multipliers=rotation.turns_multipliers,
        symmetries=frame_manifest(frame, system).symmetries,
    )


def comment(e: sp.Expr | str) -> str:
    """Return an expression as text that cannot end a C comment."""
    return text_of(e).replace("**", "^").replace("*/", "* /").replace("/*", "/ *")


def _scheme_doc(scheme: SparkScheme | MeanScheme | SplittingScheme) -> list[str]:
    """Return the comment of the equations of a step, in ASCII, as lines of C."""
    if isinstance(scheme, SplittingScheme):
        return [f"Composition of exact flows: {scheme.name}.",
                "T(a_0 h) K(b_1 h) T(a_1 h) .. K(b_s h) T(a_s h), where T are free rotations and",
                "translations and K are kicks by the potential and by forces."]
    if scheme.system.velocity_count:
        return [
            "T1 solves (B.1) for k_i = H_p(Q_i, P_i), k^_i = -H_q(Q_i, P_i) - A(Q_i)^T M_i and all",
            "multipliers, with g(Q~_l) = 0 and A H_p + a = 0 at the nodes l = 1..P, and with",
            "g_q H_p + g_t = 0 at the end of the step, which T2 computes from them.",
        ]
    if isinstance(scheme, SparkScheme):
        return [
            "T1 solves (B.1) for k_i = H_p(Q_i, P_i), k^_i = -H_q(Q_i, P_i) and the multipliers",
            "Lambda_0..Lambda_(P-1), with g(Q~_l) = 0 at l = 1..P; T2 finishes the step and",
            "projects the momentum with Lambda_P. Stages are loops over the tableau below.",
        ]
    kind = "discrete gradient" if scheme.discrete else "gradient at the midpoint"
    return [
        "dq/dt = D_p, dp/dt = -D_q - G^T lambda, g(q + dq) = 0, where D is the",
        f"{kind} of H and G that of g.",
    ]


def _unknowns_doc(scheme: SparkScheme | MeanScheme | SplittingScheme) -> list[str]:
    """Return the comment of the unknowns of a step."""
    if isinstance(scheme, SplittingScheme):
        return []
    if scheme.system.velocity_count:
        last = "Lambda_0..Lambda_p, " if scheme.system.m else ""
        return [f"x = (k_1..k_s, k^_1..k^_s, {last}M_1..M_s)"]
    if isinstance(scheme, SparkScheme):
        return ["x = (k_1..k_s, k^_1..k^_s, Lambda_0..Lambda_(p-1)), (B.2)"]
    return ["x = (dq, dp, lambda): the increments q_k - q_(k-1), p_k - p_(k-1) and the multiplier"]


def _tableau(scheme: SparkScheme, real: Real) -> TableauText:
    """Return every coefficient of a tableau as a correctly rounded literal, row by row.

    Vectors have one row. ``shapes`` are the C arrays, such as [3][3], with p + 1 nodes.
    """
    tableau = scheme.tableau
    energy = (energy_values(tableau, constrained=scheme.system.m > 0) if scheme.exact_energy
              else {})
    lines: dict[str, list[str]] = {}
    literals = tableau.map_enclosures(lambda e: real.literal(real.round(e)))
    for field, coefficients in literals.items():
        is_matrix = isinstance(coefficients[0], list)
        lines[field] = ([f"{{ {', '.join(row)} }}" for row in coefficients] if is_matrix
                        else [", ".join(coefficients)])
    # an axis of stages or of constraint nodes
    length_of = {"s": tableau.s, "p": tableau.p + 1}
    shapes = {field: "".join(f"[{length_of[axis]}]" for axis in axes)
              for field, axes in FIELDS.items()}
    energy_literals = {letter: [real.literal(real.round(e)) for e in coefficients]
                       for letter, coefficients in energy.items()}
    return TableauText(lines, shapes, _tableau_doc(tableau), energy_literals)


def _tableau_doc(tableau: Tableau) -> list[str]:
    """Return lines with the exact coefficients, for s ≤ 5 and quadratic nodes: a comment in C."""
    lines = ["Coefficients: each literal is the correctly rounded exact value."]
    if tableau.s > 5 or not all(map(is_quadratic, (*tableau.c, *tableau.c_tilde))):
        return lines
    for field in FIELDS:
        coefficients = getattr(tableau, field)
        rows = coefficients if isinstance(coefficients[0], tuple) else (coefficients,)
        for i, row in enumerate(rows):
            name = f"{field}[{i}]" if len(rows) > 1 else field
            line = f"{name:10s} = {', '.join(comment(e).replace(' ', '') for e in row)}"
            if len(line) <= 140:  # nobody reads a longer one
                lines.append(line)
    return lines
