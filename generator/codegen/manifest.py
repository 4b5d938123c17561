"""The manifest: what the C promises, for those who call it and for those who read it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import sympy as sp

from ..._version import __version__
from ...core.manifest import (
    BodyManifest,
    ClockManifest,
    ConstraintForceManifest,
    FastPathManifest,
    FrameManifest,
    JointManifest,
    Manifest,
    PlacedManifest,
    SchemeManifest,
    SectionManifest,
    SymmetryManifest,
    SystemManifest,
    TableauManifest,
    VelocityConstraintsManifest,
)
from ..schemes.fast_tableau import FastTableau
from ..schemes.splitting_scheme import SplittingScheme
from ..schemes.step_equations import MeanScheme
from ..symbolic.shared_subexpressions import text_of
from ..symmetry.frame_symmetries import CoMovingFrame
from ..systems.body_layout import BodyLayout, ConstraintForce, Entry, JointLayout, SectionLayout
from ..systems.lagrangian import LagrangianSystem
from ..systems.moving_frame import energy_of
from ..systems.smoothness import Switching
from ..systems.system import System
from ..systems.time_scale import ScaledSystem, shown_count
from ..tableaux.conditions import check_tableau, remarks
from ..tableaux.tableau import Tableau
from .manifest_numbers import domain_of, numbers_of
from .program import Derived, Elements, Program

__all__ = ["SCHEMA", "frame_manifest", "hidden_constraints", "manifest_text"]

SCHEMA = 3  # of the manifest; part of the cache key


def hidden_constraints(derived: Derived, elements: Elements | None) -> list[str]:
    """Return the constraints on the momenta as text."""
    system = derived.scheme.system
    if elements is not None:
        return ["G H_p + g_t" if system.is_time_dependent else "G H_p"] * system.m
    return [text_of(derived.constants.expand_shared(f)) for f in system.hidden]


def manifest_text(derived: Derived, program: Program, identity: str) -> str:
    """Return the manifest as JSON.

    Manifests of profiles ``control`` and ``run`` contain the model's numbers, and ``identity``,
    the hash of the three files. Those of profile ``full`` contain neither: one build serves all
    numbers of a model.
    """
    system, elements, frame = derived.system, program.elements, derived.frame
    return Manifest(
        schema=SCHEMA,
        generator=__version__,
        name=derived.name,
        profile=derived.profile,
        hash="" if derived.profile == "full" else identity,
        system=_system(derived, program),
        scheme=_scheme(derived, program),
        frame=None if frame is None else frame_manifest(frame, system),
        tableau=_users_tableau(derived.scheme.tableau, constrained=system.m > 0),
        fast_path=_fast_path(program),
        real=derived.real.name,
        operations=elements.operations if elements is not None
        else {k.name: k.operations for k in program.kernels},
    ).text


def _system(derived: Derived, program: Program) -> SystemManifest:
    """Return the entry of the system: names, formulas, bodies, and the model's numbers."""
    scheme, system, elements = derived.scheme, derived.system, program.elements
    return SystemManifest(
        name=system.name,
        # in scaled time users see neither t nor its momentum among q and p
        coordinates=_texts(system.q[: shown_count(system)]),
        momenta=_texts(system.p[: shown_count(system)]),
        clock=_clock(system),
        parameters={str(x): domain_of(x) for x in system.parameters},
        hamiltonian=_hamiltonian(system, elements),
        constraints=tuple(text_of(g) for g in system.constraints),
        hidden=tuple(hidden_constraints(derived, elements)),
        start_parameters=tuple(_start_parameters(derived, elements)),
        constraint_names=tuple(system.constraint_names),
        velocity_constraints=_velocity_constraints(system),
        rigid_body=system.rigid_body,
        forces=tuple(text_of(f) for f in system.forces),
        # three questions: whether the motion depends on time, by forces too; whether the compiled
        # H or g does; whether functions of quantities have t among their arguments
        time=str(system.time) if system.is_nonautonomous else None,
        inputs=_texts(system.inputs),
        time_in_H_or_g=system.is_time_dependent,
        quantities={name: text_of(e) for name, e in system.quantities.items()},
        quantities_take_time=system.time is not None,
        **_lagrangian(system),
        **_bodies(system),
        **_numbers(derived, program),
        **Switching(system).manifest_fields(
            scheme.order, discrete=isinstance(scheme, MeanScheme) and scheme.discrete),
    )


def _scheme(derived: Derived, program: Program) -> SchemeManifest:
    """Return the entry of the scheme: its kind, order, numbers of unknowns and multipliers."""
    scheme, tableau = derived.scheme, derived.scheme.tableau
    return SchemeManifest(
        method=derived.method,
        kind="spark" if tableau else "splitting" if program.flows else "mean",
        stages=tableau.s if tableau else None,
        constraint_nodes=tableau.p + 1 if tableau else None,
        order=scheme.order,
        unknowns=scheme.size,
        unknowns_are_state=scheme.unknowns_are_state,
        multipliers=scheme.multipliers,
        reactions=scheme.reactions,
        # IMS and EMS let f oscillate at their truncation error
        keeps_momentum_constraint=tableau is not None or program.flows is not None,
        exact_energy=program.features.exact_energy,
        remarks=tuple(_remarks(derived, program)),
        **_composition(scheme),
    )


def _clock(system: System) -> ClockManifest | None:
    """Return the hidden coordinate of a system in scaled time, its momentum, and the scale's name.
    """
    if not isinstance(system, ScaledSystem):
        return None
    return ClockManifest(time=str(system.q[-1]), momentum=str(system.p[-1]),
                         scale=system.scale_name)


def _numbers(derived: Derived, program: Program) -> dict[str, Any]:
    """Return ``numbers``, all numbers with their roles, and ``dt``, the time step of the model.

    They are for programs that read the manifest of plain C; a stepper of Python has them elsewhere.
    """
    if derived.profile == "full":
        return {}
    dt = derived.model.dt if derived.model else None
    return {"numbers": tuple(numbers_of(derived, program.states)),
            "dt": None if dt is None else float(dt)}


def _remarks(derived: Derived, program: Program) -> list[str]:
    """Return warnings of unexpected orders of the error, one sentence each."""
    scheme, remarks = derived.scheme, list[str]()
    if isinstance(scheme, SplittingScheme) and scheme.order > 2 and scheme.work_has_order_2:
        remarks.append("the work of drag on a body with three different moments has order 2, "
                       f"and so has the energy error of a run, while its motion has order "
                       f"{scheme.order}")
    if program.features.exact_energy and scheme.tableau and scheme.tableau.s == 2:
        remarks.append("with 2 stages and energy=True the error of the state may be a hundred "
                       "times that of energy=False; choose 3 stages or more, and compare the two")
    return remarks


def _composition(scheme: object) -> dict[str, Any]:
    """Return compositions of a splitting, and the longest free motion among its flows over h."""
    if not isinstance(scheme, SplittingScheme):
        return {}
    # the last drift of a step and the first of the next one are one flow
    flows = [a for composition in scheme.compositions
             for a in (*composition.drifts[1:-1], composition.drifts[0] + composition.drifts[-1])]
    return {"compositions": tuple(composition.name for composition in scheme.compositions),
            "longest_flow": float(max(map(abs, flows)))}


def _fast_path(program: Program) -> FastPathManifest:
    """Return the entry of the fixed-point iteration: proved properties, or why there is none."""
    iteration = program.iteration
    if iteration is None:
        return FastPathManifest(available=False, reason=program.no_fixed_point)
    return FastPathManifest(
        available=True, constant_schur=iteration.constant_schur,
        scalar_correction=iteration.scalar_schur, gauss_seidel=iteration.separable,
        operations={k.name: k.operations for k in program.lanes.kernels} if program.lanes else {})


def _users_tableau(tableau: Tableau | None, *, constrained: bool) -> TableauManifest | None:
    """Return the residuals of a user's tableau, else None.

    The families satisfy their conditions by derivation.
    """
    if tableau is None or not tableau.is_given_in_numbers:
        return None
    refusal = FastTableau(tableau).refusal
    iteration = [] if refusal is None else [f"no fixed-point iteration: {refusal}"]
    return TableauManifest(
        name=tableau.name,
        remarks=(*remarks(tableau, constrained=constrained), *iteration),
        conditions={line.name: {"found": line.found, "residual": line.residual}
                    for line in check_tableau(tableau)})


def _start_parameters(derived: Derived, elements: Elements | None) -> list[str]:
    """Return the parameters that decide whether a state is on the constraints g = 0 and f = 0.

    f = g_q H_p + g_t has the parameters of g and some of those of H. Where f is not written out,
    all of H are returned (sums over element templates), or all of L (a Lagrangian).
    """
    system = derived.system
    if not system.constraints and not system.velocity_count:
        return []
    expressions: list[sp.Expr] = list(system.constraints)
    if isinstance(system, LagrangianSystem):
        expressions.append(system.L)
    elif elements is not None:
        expressions.append(energy_of(system))
    else:
        expressions += map(derived.constants.expand_shared, derived.scheme.system.hidden)
    if system.velocity_count:
        expressions += [energy_of(system), *system.velocity_constraints]
    symbols = {x for e in expressions for x in e.free_symbols}
    return [str(x) for x in system.parameters if x in symbols]


def _hamiltonian(system: System, elements: Elements | None) -> str:
    """Return H as text: in full, or the number of terms of each element template."""
    if isinstance(system, LagrangianSystem):
        H, _ = system.texts()
        return H
    if elements is None:
        return text_of(energy_of(system))
    return " + ".join(f"{form['count']} x [{form['text'][-1]}]" for form in elements.energies)


def _lagrangian(system: System) -> dict[str, Any]:
    """Return L as text, its velocities, whether M may be indefinite, and the places of its bodies.

    ``placed`` has, for each body that is drawn, the quantities with its centre and axes. {} where
    H is no Legendre transform of an L.
    """
    if not isinstance(system, LagrangianSystem):
        return {}
    placed = {name: PlacedManifest(**{key: tuple(names) for key, names in lists.items()})
              for name, lists in system.placed.items()}
    _, L = system.texts()
    return {"lagrangian": L, "velocity_names": _texts(system.velocities),
            "indefinite": not system.is_definite, "placed": placed}


def _bodies(system: System) -> dict[str, Any]:
    """Return the entries of bodies and joints by their names.

    The single body of a ``rigid_body`` with I1, I2, I3 has no entry: readers know its layout.
    """
    if (system.rigid_body and len(system.bodies[0].inertia) == 3) or not system.bodies:
        return {}
    return {"bodies": {body.name: _body(body) for body in system.bodies},
            "joints": {joint.name: _joint(joint) for joint in system.joints}}


def _body(body: BodyLayout) -> BodyManifest:
    """Return a body's entry: names of its q and x, inertia or inverse inertia, mass and centre."""
    # three principal moments, or the six entries of the inverse tensor
    inertia, is_tensor = _texts(body.inertia), len(body.inertia) != 3
    return BodyManifest(
        q=_texts(body.q), inertia=() if is_tensor else inertia,
        inverse_inertia=inertia if is_tensor else (), x=_texts(body.x),
        origin=() if body.x else _entries(body.origin), centre=_entries(body.centre or ()),
        mass=None if body.mass is None else _entries([body.mass])[0])


def _joint(joint: JointLayout) -> JointManifest:
    """Return a joint's entry: its bodies, points and axes, and how each constraint acts on b."""
    forces = {name: None if force is None else ConstraintForceManifest(
        kind=force.kind, **_vectors(force, "on_a", "on_b"))
        for name, force in joint.constraint_forces}
    return JointManifest(bodies=(joint.a, joint.b), constraints=forces,
                         section=None if joint.section is None else _section(joint.section),
                         **_vectors(joint, "on_a", "on_b", "axis_a", "axis_b", "zero"))


def _section(section: SectionLayout) -> SectionManifest:
    """Return the entry of a beam's section: where it is, its stiffness and its strain at rest."""
    spacing, damping = _entries([section.spacing, section.damping])
    return SectionManifest(
        beam=section.beam, arc=section.arc, ratio=section.ratio, spacing=spacing,
        holder=section.holder,
        damping=damping, **_vectors(section, "stiffness", "rest", "turn", "extension"))


def _vectors(source: JointLayout | SectionLayout | ConstraintForce, *names: str) -> dict[str, Any]:
    """Return the vectors under these attributes of a layout; () where it has none."""
    return {name: _entries(getattr(source, name) or ()) for name in names}


def _entries(entries: Iterable[Entry]) -> tuple[str | float, ...]:
    """Return names of parameters and numbers."""
    return tuple(e if isinstance(e, float) else str(e) for e in entries)


def _texts(symbols: Iterable[sp.Expr]) -> tuple[str, ...]:
    """Return symbols, or expressions, as text."""
    return tuple(map(str, symbols))


def _velocity_constraints(system: System) -> VelocityConstraintsManifest | None:
    """Return the velocity constraints as text, the velocities in them and their names."""
    if not system.velocity_count:
        return None
    return VelocityConstraintsManifest(
        expressions=_texts(system.velocity_constraints), velocities=_texts(system.velocities),
        names=tuple(system.velocity_constraint_names))


# ---------------------------------------------------------------- co-moving frames


def frame_manifest(frame: CoMovingFrame, system: System) -> FrameManifest:
    """Return the symmetries q ↦ exp(ωA) q of a frame with their momenta J = pᵀ A q.

    ``A`` has (row, column, text) of each entry, ``conditions`` are equations on parameters, and
    ``vanishing`` the polynomials that are 0 then. Symmetries of different groups commute.
    """
    return FrameManifest(symmetries=tuple(SymmetryManifest(
        name=symmetry.name, group=index, meaning=symmetry.field.name,
        A=tuple((i, j, str(x)) for (i, j), x in sorted(symmetry.field.weights.items())),
        J=str(symmetry.momentum(system)),
        conditions=tuple(_equation(e) for e in symmetry.conditions),
        vanishing=tuple(_terms(e) for e in symmetry.conditions),
    ) for index, group in enumerate(frame.groups) for symmetry in group))


def _equation(e: sp.Expr) -> str:
    """Return e = 0 as text without minus signs: I1 − I2 becomes "I1 = I2"."""
    terms = sp.Add.make_args(e)
    positive = [t for t in terms if not t.could_extract_minus_sign()]
    negative = [-t for t in terms if t.could_extract_minus_sign()]
    return f"{sp.Add(*positive)} = {sp.Add(*negative)}"


def _terms(e: sp.Expr) -> tuple[tuple[str, dict[str, int]], ...]:
    """Return the terms (coefficient, {parameter: power}) of a polynomial e in parameters."""
    symbols = sorted(e.free_symbols, key=str)
    terms = []
    for powers, coefficient in sp.Poly(e, *symbols).terms():
        power_of = {str(s): n for s, n in zip(symbols, powers, strict=True) if n}
        terms.append((str(coefficient), power_of))
    return tuple(terms)
