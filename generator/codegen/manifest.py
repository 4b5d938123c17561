"""The manifest: what the C promises, for those who call it and for those who read it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import sympy as sp

from ..._version import __version__
from ..schemes.fast_tableau import FastTableau
from ..schemes.splitting_scheme import SplittingScheme
from ..schemes.step_equations import MeanScheme
from ..symbolic.shared_subexpressions import text_of
from ..symmetry.frame_symmetries import CoMovingFrame
from ..systems.body_layout import BodyLayout, ConstraintForce, Entry, JointLayout
from ..systems.lagrangian import LagrangianSystem
from ..systems.moving_frame import energy_of
from ..systems.smoothness import Switching
from ..systems.system import System
from ..tableaux.conditions import check_tableau, remarks
from ..tableaux.tableau import Tableau
from .numbers import domain_of, numbers_of
from .program import Derived, Elements, Program

__all__ = ["SCHEMA", "frame_manifest", "hidden_constraints", "manifest_text"]

SCHEMA = 3  # of the manifest; part of the cache key


def hidden_constraints(derived: Derived, elements: Elements | None) -> list[str]:
    """Return the constraints on the momenta as text."""
    system = derived.scheme.system
    if elements is not None:
        return ["G H_p + g_t" if system.is_time_dependent else "G H_p"] * system.m
    return [str(derived.constants.expand_shared(f)) for f in system.hidden]


def manifest_text(derived: Derived, program: Program, identity: str) -> str:
    """Return the manifest as JSON.

    Profiles for C have the numbers of the model in it, and a hash of it and the other files;
    manifests of profile ``full`` are the same for all numbers, and so are builds.
    """
    scheme, system, elements = derived.scheme, derived.system, program.elements
    tableau, frame = scheme.tableau, derived.frame
    content = {
        "schema": SCHEMA,
        "generator": __version__,
        "name": derived.name,
        "profile": derived.profile,
        **({} if derived.profile == "full" else {"hash": identity}),
        "system": {
            "name": system.name,
            "coordinates": [str(x) for x in system.q],
            "momenta": [str(x) for x in system.p],
            "parameters": {str(x): domain_of(x) for x in system.parameters},
            "hamiltonian": _hamiltonian(system, elements),
            **_lagrangian(system),
            "constraints": [text_of(g) for g in system.constraints],
            "hidden": list(hidden_constraints(derived, elements)),
            "start_parameters": _start_parameters(derived, elements),
            **_given_names(system),
            **_velocity_constraints(system),
            "rigid_body": system.rigid_body,
            **_bodies(system),
            **_forces_and_quantities(system),
            **_numbers(derived, program),
            **Switching(system).said(
                scheme.order, discrete=isinstance(scheme, MeanScheme) and scheme.discrete),
        },
        "scheme": {
            "method": derived.method,
            "kind": "spark" if tableau else "splitting" if program.flows else "mean",
            "stages": tableau.s if tableau else None,
            "constraint_nodes": tableau.p + 1 if tableau else None,
            "order": scheme.order,
            **_composition(scheme),
            "unknowns": scheme.size,
            "unknowns_are_state": scheme.unknowns_are_state,
            "multipliers": scheme.multipliers,
            **({"reactions": scheme.reactions} if scheme.reactions else {}),
            "keeps_momentum_constraint": tableau is not None or program.flows is not None,
            **({"exact_energy": True} if program.features.exact_energy else {}),
            **_remarks(derived, program),
        },
        **({} if frame is None else {"frame": frame_manifest(frame, system)}),
        **_given_tableau(tableau, constrained=derived.system.m > 0),
        "fast_path": _fast_path(program),
        "real": derived.real.name,
        "operations": elements.operations if elements is not None
        else {k.name: k.operations for k in program.kernels},
    }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _numbers(derived: Derived, program: Program) -> dict[str, Any]:
    """Return all numbers with their roles, and the time step of the model."""
    if derived.profile == "full":
        return {}
    dt = derived.model.dt if derived.model else None
    return {"numbers": numbers_of(derived, program.states),
            "dt": None if dt is None else float(dt)}


def _remarks(derived: Derived, program: Program) -> dict[str, Any]:
    """Return what a user of the scheme should know of its errors."""
    scheme, remarks = derived.scheme, list[str]()
    if isinstance(scheme, SplittingScheme) and scheme.order > 2 and scheme.work_has_order_2:
        remarks.append("the work of drag on a body with three different moments has order 2, "
                       f"and so has the energy error of a run, while its motion has order "
                       f"{scheme.order}")
    if program.features.exact_energy and scheme.tableau and scheme.tableau.s == 2:
        remarks.append("with 2 stages and energy=True the error of the state may be a hundred "
                       "times that of energy=False; choose 3 stages or more, and compare the two")
    return {"remarks": remarks} if remarks else {}


def _composition(scheme: object) -> dict[str, Any]:
    """Return compositions of a splitting, and the longest free motion among its flows over h."""
    if not isinstance(scheme, SplittingScheme):
        return {}
    return {"compositions": [one.name for one in scheme.compositions],
            "longest_flow": float(max(abs(a) for one in scheme.compositions for a in
                                      (*one.drifts[1:-1], one.drifts[0] + one.drifts[-1])))}


def _fast_path(program: Program) -> dict[str, Any]:
    """Return whether there is a fixed-point iteration, what was proved for it, or why not."""
    iteration = program.iteration
    if iteration is None:
        return {"available": False, "reason": program.no_fixed_point}
    return {
        "available": True,
        "constant_schur": iteration.constant_schur,
        "scalar_correction": iteration.scalar_schur,
        "gauss_seidel": iteration.separable,
        "operations": {k.name: k.operations for k in program.lanes.kernels}
        if program.lanes else {},
    }


def _given_tableau(tableau: Tableau | None, *, constrained: bool) -> dict[str, Any]:
    """Say what holds of a given tableau and what does not; the families hold by derivation."""
    if tableau is None or not tableau.given:
        return {}
    refusal = FastTableau(tableau).refusal
    return {"tableau": {
        "name": tableau.name,
        "remarks": [*remarks(tableau, constrained=constrained),
                    *([] if refusal is None else [f"no fixed-point iteration: {refusal}"])],
        "conditions": {line.name: {"found": line.found, "residual": line.residual}
                       for line in check_tableau(tableau)},
    }}


def _start_parameters(derived: Derived, elements: Elements | None) -> list[str]:
    """Return the parameters that decide whether a state is on the constraints.

    Of a structured system, whose g_q H_p is never written out, all that could.
    """
    system = derived.system
    if not system.constraints and not system.velocity_count:
        return []
    deciding = (energy_of(system), *system.constraints) if elements is not None else (
        *system.constraints, *map(derived.constants.expand_shared, derived.scheme.system.hidden))
    if isinstance(system, LagrangianSystem):
        deciding = (system.L, *system.constraints)
    if system.velocity_count:
        deciding = (*deciding, energy_of(system), *system.velocity_constraints)
    found = {x for e in deciding for x in e.free_symbols}
    return [str(x) for x in system.parameters if x in found]


def _hamiltonian(system: System, elements: Elements | None) -> str:
    """Return H as text: in full, or as so many terms of each form."""
    if isinstance(system, LagrangianSystem):
        return system.texts()[0]
    if elements is None:
        return text_of(energy_of(system))
    return " + ".join(f"{part['count']} x [{part['text'][0]}]" for part in elements.energies)


def _lagrangian(system: System) -> dict[str, Any]:
    """Return L and its velocities, where H is made of one."""
    if not isinstance(system, LagrangianSystem):
        return {}
    return {"lagrangian": system.texts()[1], "velocity_names": [str(v) for v in system.velocities],
            **({} if system.is_definite else {"indefinite": True}),
            **({"placed": {name: {what: list(names) for what, names in one.items()}
                           for name, one in system.placed.items()}} if system.placed else {})}


def _forces_and_quantities(system: System) -> dict[str, Any]:
    """Return what is said of forces, time and quantities; nothing of what is not there."""
    said: dict[str, Any] = {}
    if system.forces:
        said["forces"] = [text_of(f) for f in system.forces]
    if system.is_nonautonomous:
        said["time"] = str(system.time)
    if system.inputs:
        said["inputs"] = [str(u) for u in system.inputs]
    if system.is_time_dependent:
        said["time_in_H_or_g"] = True
    if system.quantities:
        said["quantities"] = {name: text_of(e) for name, e in system.quantities.items()}
        said["quantities_take_time"] = system.time is not None
    return said


def _bodies(system: System) -> dict[str, Any]:
    """Return where bodies and joints are.

    That of a ``rigid_body`` with I1, I2, I3 goes without saying.
    """
    if (system.rigid_body and len(system.bodies[0].inertia) == 3) or not system.bodies:
        return {}
    joints = {"joints": {joint.name: _joint(joint) for joint in system.joints}}
    return {"bodies": {body.name: _body(body) for body in system.bodies},
            **(joints if system.joints else {})}


def _body(body: BodyLayout) -> dict[str, Any]:
    inertia = "inertia" if len(body.inertia) == 3 else "inverse_inertia"
    place = {"x": [str(x) for x in body.x]} if body.x else {"origin": _entries(body.origin)}
    centre = {"centre": _entries(body.centre)} if body.centre else {}
    mass: dict[str, Any] = {} if body.mass is None else {"mass": _entries([body.mass])[0]}
    return {"q": [str(x) for x in body.q], inertia: [str(x) for x in body.inertia], **place,
            **centre, **mass}


def _joint(joint: JointLayout) -> dict[str, Any]:
    pulls = {name: None if pull is None else {"kind": pull.kind, **_vectors(pull, "on_a", "on_b")}
             for name, pull in joint.constraint_forces}
    places = _vectors(joint, "on_a", "on_b", "axis_a", "axis_b", "zero")
    return {"bodies": [joint.a, joint.b], **places, "constraints": pulls}


def _vectors(one: JointLayout | ConstraintForce, *names: str) -> dict[str, list[str | float]]:
    """Return those of its vectors that it has."""
    return {name: _entries(getattr(one, name)) for name in names if getattr(one, name)}


def _entries(entries: Iterable[Entry]) -> list[str | float]:
    """Return names of parameters and numbers."""
    return [e if isinstance(e, float) else str(e) for e in entries]


def _given_names(system: System) -> dict[str, list[str]]:
    """Return the constraints' names where somebody gave them; g0, g1, … go without saying."""
    names = list(system.constraint_names)
    default = [f"g{i}" for i in range(system.m)]
    return {} if names == default else {"constraint_names": names}


def _velocity_constraints(system: System) -> dict[str, Any]:
    """Return the velocity constraints as text, the velocities in them and their names."""
    if not system.velocity_count:
        return {}
    return {"velocity_constraints": {
        "expressions": [str(row) for row in system.velocity_constraints],
        "velocities": [str(v) for v in system.velocities],
        "names": list(system.velocity_constraint_names)}}


# ---------------------------------------------------------------- co-moving frames


def frame_manifest(frame: CoMovingFrame, system: System) -> dict[str, Any]:
    """Return the symmetries as JSON: A by its entries, conditions as polynomials that vanish."""
    return {"symmetries": [{
        "name": symmetry.name,
        "group": group,
        "meaning": symmetry.field.name,
        "A": [[i, j, str(x)] for (i, j), x in sorted(symmetry.field.weights.items())],
        "J": str(symmetry.momentum(system)),
        "conditions": [_equation(e) for e in symmetry.conditions],
        "vanishing": [_terms(e) for e in symmetry.conditions],
    } for group, together in enumerate(frame.groups) for symmetry in together]}


def _equation(e: sp.Expr) -> str:
    """Return e = 0 as a sentence has it: I1 = I2."""
    terms = sp.Add.make_args(e)
    left = [t for t in terms if not t.could_extract_minus_sign()]
    right = [-t for t in terms if t.could_extract_minus_sign()]
    return f"{sp.Add(*left)} = {sp.Add(*right)}"


def _terms(e: sp.Expr) -> list[list[Any]]:
    """Return a polynomial as its terms: [coefficient, {parameter: power}]."""
    symbols = sorted(e.free_symbols, key=str)
    return [[str(x), {str(s): n for s, n in zip(symbols, powers, strict=True) if n}]
            for powers, x in sp.Poly(e, *symbols).terms()]
