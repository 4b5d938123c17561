"""Header, source and manifest of a stepper, from its scheme and the templates."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import sympy as sp

from ..._version import __version__
from ...real import Real
from ..algebra.cardinal import c_names_with_needs
from ..kernels.c_printer import SWITCHES, CPrinter
from ..kernels.kernel import Constants, EmittedKernel, Target, emit_kernel, sums_products
from ..kernels.statements import Kernel
from ..schemes.fast_tableau import FastTableau
from ..schemes.schemes import MeanScheme, SparkScheme, common_kernels
from ..systems.smoothness import Switching
from ..systems.structure import Structure
from ..systems.system import System
from ..tableaux.conditions import check_tableau, remarks
from ..tableaux.tableau import FIELDS, Tableau, is_quadratic
from .bytecode import Bytecode
from .c_lines import fitted
from .emit_fast import fast_context, fast_manifest, structured_fast_context
from .emit_structure import operations_of, structure_context
from .engine import Proved, engine_of
from .solver_costs import solver_costs

__all__ = ["SCHEMA", "Source", "emit"]

TEMPLATES = Path(__file__).resolve().parents[2] / "templates"
SCHEMA = 2  # of the manifest; part of the cache key


@dataclass(frozen=True)
class Source:
    """The three files of a stepper, as text."""

    name: str
    header: str
    source: str
    manifest: str

    def files(self) -> dict[str, str]:
        """Return file name → text."""
        return {
            f"{self.name}.h": self.header,
            f"{self.name}.c": self.source,
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
) -> Source:
    """Return the C and the manifest.

    ``system`` is the one the user knows, with its own parameters; the scheme works on the same
    system with constants of the run in place of parameter-only subexpressions. ``structured``
    decides whether the C loops over the instances of the system's forms; by default where that
    saves work.
    """
    structure = Structure(scheme.system)
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
    context = _context(name, method, scheme, system, constants, real,
                       [*kernels, *fast["lane_kernels"], *forms.get("form_kernels", ())],
                       forms) | fast | {"kernels": kernels}
    context["engine"] = engine_of(name, real, fast.get("one", ""), fast.get("many", ""))
    proved = Proved(system.n, system.m, isinstance(scheme, SparkScheme), structured,
                    bool(system.forces), *(bool(fast.get(name)) for name in (
                        "constant_schur", "correction", "separable")))
    context |= proved.scheme_files() | proved.solver_files(fast["fast"])
    context |= proved.sweep_files(fast["one"], fast["many"]) if fast["fast"] else {
        "batch_files": []}
    quantities = context["quantity_kernel"] = _quantity_kernel(system, real)
    if quantities is not None:
        context["own_switches"] |= quantities.functions & SWITCHES
    environment = _environment()
    return Source(
        name,
        fitted(environment.get_template("stepper.h.jinja").render(context)),
        fitted(environment.get_template("stepper.c.jinja").render(context)),
        _manifest(name, method, scheme, system, constants, real, kernels, fast, forms),
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
    parameter_names = {p: f"par->{p}" for p in constants.parameters}
    printer = CPrinter(real, parameter_names)
    hidden = _hidden(scheme, constants, forms)
    used = frozenset[str]().union(*(kernel.constants for kernel in kernels),
                                  forms.get("used_constants", ()))
    needed = {e: s for e, s in constants.definitions.items() if str(s) in used}
    constants_c = {str(s): printer(e) for e, s in needed.items()}
    alone = [k for k in kernels if not k.name.startswith("lanes_")]
    return forms | {
        "name": name,
        "version": __version__,
        "title": f"{method} for {system.name.replace('_', ' ')}",
        "hamiltonian": "" if forms["structured"] else comment(system.H),
        "forces": [comment(f) for f in system.forces],
        "time": str(system.time) if system.is_driven else "",
        "quantities": {name: comment(e) for name, e in system.quantities.items()},
        "quantity_time": bool(system.quantities) and system.time is not None,
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
        "costs": solver_costs(scheme, kernels, forms),
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


def _hidden(
    scheme: SparkScheme | MeanScheme, constants: Constants, forms: dict[str, Any]
) -> list[str]:
    """Return the constraints on the momenta as text."""
    if forms["structured"]:
        return ["G H_p"] * scheme.system.m
    return [str(constants.spelled_out(f)) for f in scheme.system.hidden]


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


def _manifest(
    name: str,
    method: str,
    scheme: SparkScheme | MeanScheme,
    system: System,
    constants: Constants,
    real: Real,
    kernels: list[EmittedKernel],
    fast: dict[str, Any],
    forms: dict[str, Any],
) -> str:
    tableau = scheme.tableau
    content = {
        "schema": SCHEMA,
        "generator": __version__,
        "name": name,
        "system": {
            "name": system.name,
            "coordinates": [str(x) for x in system.q],
            "momenta": [str(x) for x in system.p],
            "parameters": {str(x): _domain(x) for x in system.parameters},
            "hamiltonian": _hamiltonian(system, forms),
            "constraints": [str(g) for g in system.constraints],
            "hidden": _hidden(scheme, constants, forms),
            "start_parameters": _start_parameters(system, forms),
            **_given_names(system),
            "rigid_body": system.rigid_body,
            **_bodies(system),
            **_forces_and_quantities(system),
            **Switching(system).said(
                scheme.order, discrete=isinstance(scheme, MeanScheme) and scheme.discrete),
        },
        "scheme": {
            "method": method,
            "kind": "spark" if tableau else "mean",
            "stages": tableau.s if tableau else None,
            "constraint_nodes": tableau.p + 1 if tableau else None,
            "order": scheme.order,
            "unknowns": scheme.size,
            "unknowns_are_state": scheme.unknowns_are_state,
            "multipliers": scheme.multipliers,
            "keeps_momentum_constraint": tableau is not None,
        },
        **_given_tableau(tableau),
        "fast_path": fast_manifest(fast),
        "real": real.name,
        "operations": operations_of(forms) if forms["structured"]
        else {k.name: k.operations for k in kernels},
    }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _given_tableau(tableau: Tableau | None) -> dict[str, Any]:
    """Say what holds of a given tableau and what does not; the families hold by derivation."""
    if tableau is None or not tableau.given:
        return {}
    refusal = FastTableau(tableau).refusal
    return {"tableau": {
        "name": tableau.name,
        "remarks": [*remarks(tableau),
                    *([] if refusal is None else [f"no sweeps, Newton at every step: {refusal}"])],
        "conditions": {line.name: {"found": line.found, "residual": line.residual}
                       for line in check_tableau(tableau)},
    }}


def _start_parameters(system: System, forms: dict[str, Any]) -> list[str]:
    """Return the parameters that decide whether a state is on the constraints.

    Of a structured system, whose g_q H_p is never written out, all that could.
    """
    if not system.constraints:
        return []
    deciding = (system.H, *system.constraints) if forms["structured"] else (
        *system.constraints, *system.hidden)
    found = {x for e in deciding for x in e.free_symbols}
    return [str(x) for x in system.parameters if x in found]


def _hamiltonian(system: System, forms: dict[str, Any]) -> str:
    """Return H as text: in full, or as so many terms of each form."""
    if not forms["structured"]:
        return str(system.H)
    return " + ".join(f"{part['count']} x [{part['text'][0]}]" for part in forms["terms"])


def _forces_and_quantities(system: System) -> dict[str, Any]:
    """Return what is said of forces, time and quantities; nothing of what is not there."""
    said: dict[str, Any] = {}
    if system.forces:
        said["forces"] = [str(f) for f in system.forces]
    if system.is_driven:
        said["time"] = str(system.time)
    if system.quantities:
        said["quantities"] = {name: str(e) for name, e in system.quantities.items()}
        said["quantities_take_time"] = system.time is not None
    return said


def _bodies(system: System) -> dict[str, Any]:
    """Return where the bodies are; that of a ``rigid_body`` with I1, I2, I3 goes without saying."""
    if (system.rigid_body and len(system.bodies[0].inertia) == 3) or not system.bodies:
        return {}
    return {"bodies": {
        body.name: {"q": [str(x) for x in body.q],
                    "inertia" if len(body.inertia) == 3 else "inverse_inertia":
                        [str(x) for x in body.inertia]}
        for body in system.bodies}}


def _given_names(system: System) -> dict[str, list[str]]:
    """Return the constraints' names where somebody gave them; g0, g1, … go without saying."""
    names = list(system.constraint_names)
    default = [f"g{i}" for i in range(system.m)]
    return {} if names == default else {"constraint_names": names}


def _domain(parameter: sp.Symbol) -> str:
    """What a value must be, from the assumptions of the symbol."""
    if parameter.is_positive:
        return "positive"
    return "nonzero" if parameter.is_nonzero else "real"

