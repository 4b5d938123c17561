"""Header, source and manifest of a stepper, from its scheme and the templates."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import mpmath as mp
import sympy as sp

from ..._version import __version__
from ...core.real_types import REALS, Real, round_binary
from ...engine.amalgamate import INCLUDE_CHECK, amalgamate
from ..kernels.c_printer import SWITCHES, CPrinter
from ..kernels.kernel import Constants, EmittedKernel, Target, emit_kernel, sums_products
from ..kernels.statements import Kernel
from ..schemes.frame_kernels import Turning
from ..schemes.step_equations import MeanScheme, SparkScheme, common_kernels
from ..symbolic.cardinal_functions import c_names_with_needs
from ..symmetry.frame_symmetries import Frame
from ..systems.lagrangian import LagrangianSystem
from ..systems.moving_frame import MovingSystem, energy_of
from ..systems.repeated_structure import Structure
from ..systems.system import System
from ..tableaux.tableau import FIELDS, Tableau, is_quadratic
from .bytecode import Bytecode
from .c_lines import fitted
from .emit_control import beside, control_context
from .emit_fast import fast_context, structured_fast_context
from .emit_manifest import frame_manifest, hidden_constraints, manifest_text
from .emit_mass import mass_context
from .emit_structure import structure_context
from .engine import ENGINE_VERSION, features
from .profiles import ProfileName
from .solver_costs import solver_costs

__all__ = ["Source", "emit"]

TEMPLATES = Path(__file__).resolve().parents[2] / "templates"


@dataclass(frozen=True)
class Source:
    """The three files of a stepper, as text.

    The C includes headers of the engine, but for profiles ``control`` and ``run``: it has them in
    it.
    """

    name: str
    header: str
    source: str
    manifest: str

    def files(self, *, standalone: bool = True) -> dict[str, str]:
        """Return file name → text.

        ``standalone`` puts the engine into the C. This text is what is compiled, and what keys of
        the cache and identities of stored runs are hashes of: another engine is another stepper.
        """
        source = amalgamate(self.source) if standalone else self.source
        return {
            f"{self.name}.h": self.header,
            f"{self.name}.c": source,
            f"{self.name}.json": self.manifest,
        }


def emit(
    name: str,
    method: str,
    scheme: SparkScheme | MeanScheme,
    system: System,
    constants: Constants,
    real: Real,
    structured: bool | None = None,
    profile: ProfileName = "full",
    frame: Frame | None = None,
) -> Source:
    """Return the C and the manifest.

    ``system`` is the one the user knows, with its own parameters; the scheme works on the same
    system with constants of the run in place of parameter-only subexpressions. ``structured``
    decides whether the C loops over the instances of the system's forms; by default where that
    saves work.
    """
    if profile == "control":
        return _emit_control(name, method, scheme, system, constants, real)
    if profile == "run":
        return _emit_run(name, method, scheme, system, constants, real)
    structure = Structure(scheme.system)
    lagrangian = isinstance(scheme.system, LagrangianSystem)
    if lagrangian:
        structured = False  # M couples all of it
    carried = isinstance(scheme.system, MovingSystem) and bool(scheme.system.carried)
    if carried:
        structured = False  # what a frame moves is no form
    if structured is None:
        structured = structure.is_worthwhile
    forms: dict[str, Any] = {"structured": False}
    kernels: list[EmittedKernel] = []
    if structured:
        forms = structure_context(structure, scheme, constants, real)
        fast = structured_fast_context(scheme, structure, forms, real)
    else:
        kernels = [emit_kernel(k, constants, real) for k in [*common_kernels(scheme.system),
                                                             *scheme.kernels()]]
        fast = fast_context(scheme, constants, real)
    known = [*kernels, *fast["lane_kernels"], *forms.get("form_kernels", ())]
    context = _context(name, method, scheme, system, constants, real, known, forms) | fast | {
        "kernels": kernels, "costs": solver_costs(scheme, known, forms), "full": True,
        "run_constants": []}
    context |= _frame_context(frame, name, system, real)
    context["profile"] = "full"
    context["features"] = features(
        scheme, system, real, fast, structured=structured, frame=frame,
        rotates=bool(context.get("frame_turns_multipliers")))
    quantities = context["quantity_kernel"] = _quantity_kernel(system, real)
    if quantities is not None:
        context["own_switches"] |= quantities.functions & SWITCHES
    environment = _environment()
    return Source(
        name,
        fitted(environment.get_template("stepper.h.jinja").render(context)),
        fitted(environment.get_template("stepper.c.jinja").render(context)),
        manifest_text(name, method, scheme, system, constants, real, kernels, fast, forms, profile,
                      frame),
    )


def _emit_control(
    name: str,
    method: str,
    scheme: SparkScheme | MeanScheme,
    system: System,
    constants: Constants,
    real: Real,
) -> Source:
    """Return the C and the manifest of profile ``control``."""
    own = control_context(scheme, constants, real, "control")
    forms: dict[str, Any] = {"structured": False}
    context = _context(name, method, scheme, system, constants, real, own["known"], forms) | own
    context |= {"profile": "control",
                "features": features(scheme, system, real, own, profile="control")}
    quantities = context["quantity_kernel"] = _quantity_kernel(system, real)
    if quantities is not None:
        context["own_switches"] |= quantities.functions & SWITCHES
    environment = _environment()
    return Source(
        name,
        fitted(environment.get_template("control.h.jinja").render(context)),
        amalgamate(fitted(environment.get_template("control.c.jinja").render(context))),
        manifest_text(name, method, scheme, system, constants, real, own["kernels"],
                      own["proved"], forms, "control"),
    )


def _emit_run(
    name: str,
    method: str,
    scheme: SparkScheme | MeanScheme,
    system: System,
    constants: Constants,
    real: Real,
) -> Source:
    """Return the C and the manifest of profile ``run``: the sweeps of ``control``, and Newton."""
    own = control_context(scheme, constants, real, "run")
    forms: dict[str, Any] = {"structured": False}
    kernels = [emit_kernel(k, constants, real) for k in [*common_kernels(scheme.system),
                                                         *scheme.kernels()]]
    beside_them, renamed = beside(kernels, own["kernels"])
    context = _context(name, method, scheme, system, constants, real, [*kernels, *own["known"]],
                       forms) | own
    context |= {
        "full": False, "fast": True, "inputs": [], "kernels": kernels, "sweep_kernels": beside_them,
        "costs": solver_costs(scheme, kernels, forms),
        "run_constants": [*own["folded"].items(), *own["run_constants"]],
        "renamed": renamed, "profile": "run",
        "features": features(scheme, system, real, own, profile="run")}
    quantities = context["quantity_kernel"] = _quantity_kernel(system, real)
    if quantities is not None:
        context["own_switches"] |= quantities.functions & SWITCHES
    environment = _environment()
    header, text = (environment.get_template(f"stepper.{kind}.jinja").render(context)
                    for kind in "hc")
    return Source(
        name,
        fitted(header),
        amalgamate(fitted(text)),
        manifest_text(name, method, scheme, system, constants, real, kernels, own["proved"], forms,
                      "run"),
    )


@cache
def _environment() -> jinja2.Environment:
    options: dict[str, Any] = {
        "undefined": jinja2.StrictUndefined,
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


def _context(
    name: str,
    method: str,
    scheme: SparkScheme | MeanScheme,
    system: System,
    constants: Constants,
    real: Real,
    kernels: list[EmittedKernel],
    forms: dict[str, Any],
) -> dict[str, Any]:
    tableau = scheme.tableau
    legendre = system if isinstance(system, LagrangianSystem) else None
    parameter_names = {p: f"par->{p}" for p in constants.parameters}
    printer = CPrinter(real, parameter_names)
    hidden = hidden_constraints(scheme, constants, forms)
    used = frozenset[str]().union(*(kernel.constants for kernel in kernels),
                                  forms.get("used_constants", ()))
    needed = {e: s for e, s in constants.definitions.items() if str(s) in used}
    constants_c = {str(s): printer(e) for e, s in needed.items()}
    alone = [k for k in kernels if not k.name.startswith("lanes_")]
    return forms | {
        "name": name,
        "version": __version__,
        "engine_version": ENGINE_VERSION,
        "include_check": INCLUDE_CHECK,
        "renamed": {},
        "title": f"{method} for {system.name.replace('_', ' ')}",
        "hamiltonian": "" if forms["structured"] else comment(
            legendre.texts()[0] if legendre else
            energy_of(system)),
        "lagrangian": comment(legendre.texts()[1]) if legendre else "",
        "forces": [comment(f) for f in system.forces],
        "time": str(system.time) if system.is_driven else "",
        "timed": system.is_timed,
        "framed": False,
        "inputs": [str(u) for u in system.inputs],
        "input_places": [list(constants_c).index(str(u)) for u in system.inputs
                         if str(u) in constants_c],
        "quantities": {name: comment(e) for name, e in system.quantities.items()},
        "quantity_time": bool(system.quantities) and system.time is not None,
        "mass": mass_context(legendre) if legendre else None,
        "constraints": [] if forms["structured"] else [comment(g) for g in system.constraints],
        "hidden_text": ", ".join(dict.fromkeys(f"f = {comment(f)}" for f in hidden))
                       or "no constraint",
        "parameters": [str(p) for p in system.parameters],
        "constants": {str(s): comment(e) for e, s in needed.items()},
        "constants_c": constants_c,
        "R": real.c_type,
        "sfx": real.suffix.lower(),
        "limits": real.limits,
        "N": system.n,
        "M": system.m,
        "U": scheme.size,
        "S": tableau.s if tableau else 0,
        "P": tableau.p if tableau else 0,
        "order": scheme.order,
        "multipliers": scheme.multipliers * system.m,
        "kernels": kernels,
        "compensated_plain": any(map(sums_products, kernels)),
        "cardinals": c_names_with_needs(frozenset().union(*(k.functions for k in kernels))),
        "own_switches": SWITCHES & printer.functions.union(*(k.functions for k in alone)),
        "scheme_doc": _scheme_doc(scheme),
        "unknowns_doc": _unknowns_doc(scheme),
        "tableau": _tableau_rows(tableau, real) if tableau else None,
        "tableau_shapes": _tableau_shapes(tableau) if tableau else {},
        "tableau_doc": _tableau_doc(tableau) if tableau else [],
    }


def _frame_context(frame: Frame | None, name: str, system: System, real: Real) -> dict[str, Any]:
    """Return what the templates need of a co-moving frame; ``framed`` is False without one."""
    if frame is None:
        return {"framed": False}
    wide = REALS["double"] if real.name == "float" else real  # 24 bits count no 10⁹ steps
    turning = Turning(frame, system)
    target = Target(real.c_type, "parameters_t", "")
    rates = [f"product_of({wide.literal(a)}, par->{frame.groups[g][0].name})"
             if turning.axes[g] is None else
             f"times((double_word){{ {wide.literal(a)}, 0 }}, omega{turning.axes[g]})"
             for g, a in turning.angles]
    return {
        "framed": True,
        "turning": wide.c_type,
        "turning_suffix": wide.suffix.lower(),
        "frame_quarter": _quarter(wide),
        "frame_groups": [{"names": [symmetry.name for symmetry in group], "axis": axis}
                         for group, axis in zip(frame.groups, turning.axes, strict=True)],
        "frame_sets": turning.sets,
        "frame_fed": bool(system.forces or system.inputs),
        "frame_axes": turning.components,
        "frame_angles": rates,
        "frame_kernels": [emit_kernel(kernel, Constants(system.parameters), real, target)
                          for kernel in turning.kernels()],
        "frame_turns_multipliers": turning.turns_multipliers,
        "frame_symmetries": frame_manifest(frame, system)["symmetries"],
    }


def _quarter(wide: Real) -> list[str]:
    """Return π/2 as three numbers of the type, each the rounded rest."""
    bits = 4 * wide.bits
    with mp.workprec(bits + 64):
        rest = Fraction(int(mp.floor(mp.ldexp(mp.pi / 2, bits))), 2**bits)
    parts = []
    for _ in range(3):
        parts.append(wide.literal(rest))
        rest -= round_binary(rest, wide.bits)
    return parts


def _quantity_kernel(system: System, real: Real) -> EmittedKernel | None:
    """Return the kernel of the user's quantities, in terms of the parameters themselves."""
    if not system.quantities:
        return None
    time = {} if system.time is None else {"t": [system.time]}
    kernel = Kernel("quantities", "What the user asked for of a state",
                    {**time, "q": list(system.q), "p": list(system.p)},
                    {"out": list(system.quantities.values())})
    return emit_kernel(kernel, Constants(system.parameters), real,
                       Target(real.c_type, "parameters_t", ""))


def comment(e: sp.Expr | str) -> str:
    """Return an expression as text that cannot end a C comment."""
    return str(e).replace("**", "^").replace("*/", "* /").replace("/*", "/ *")


def _scheme_doc(scheme: SparkScheme | MeanScheme) -> list[str]:
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


def _unknowns_doc(scheme: SparkScheme | MeanScheme) -> list[str]:
    if isinstance(scheme, SparkScheme):
        return ["x = (k_1..k_s, k^_1..k^_s, Lambda_0..Lambda_(p-1)), (B.2)"]
    return ["x = (dq, dp, lambda): the increments q_k - q_(k-1), p_k - p_(k-1) and the multiplier"]


def _tableau_shapes(tableau: Tableau) -> dict[str, str]:
    size = {"s": tableau.s, "p": tableau.p + 1}
    return {field: "".join(f"[{size[kind]}]" for kind in kinds) for field, kinds in FIELDS.items()}


def _tableau_rows(tableau: Tableau, real: Real) -> dict[str, list[str]]:
    """Return every part as rows of correctly rounded literals."""
    parts = tableau.map_enclosures(lambda e: real.literal(real.round(e)))
    rows = {}
    for field, part in parts.items():
        if isinstance(part[0], list):
            rows[field] = ["{ " + ", ".join(row) + " }" for row in part]
        else:
            rows[field] = [", ".join(part)]
    return rows


def _tableau_doc(tableau: Tableau) -> list[str]:
    """Return the exact coefficients, while they are short enough to read."""
    lines = ["Coefficients: each literal is the correctly rounded exact value."]
    if tableau.s > 5 or not all(map(is_quadratic, (*tableau.c, *tableau.c_tilde))):
        return lines
    for field in FIELDS:
        part = getattr(tableau, field)
        rows = part if isinstance(part[0], tuple) else (part,)
        text = [", ".join(comment(e).replace(" ", "") for e in row) for row in rows]
        for i, row in enumerate(text):
            line = f"{field + (f'[{i}]' if len(rows) > 1 else ''):10s} = {row}"
            if len(line) <= 140:
                lines.append(line)
    return lines
