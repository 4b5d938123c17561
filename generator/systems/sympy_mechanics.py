"""Systems of ``sympy.physics.mechanics``: its methods hold all that a Lagrangian needs.

    LagrangesMethod  L, forces, holonomic and nonholonomic constraints
    KanesMethod      T of its bodies, loads, constraints on configuration and velocities
    System           T − V of its bodies, loads and actuators, all of its constraints

No equations of motion are formed. Coordinates q(t) become symbols of the same names; so do speeds
u = q̇, other velocities are called q_t. The time ``dynamicsymbols._t`` may stand in anything: what
moves or is driven by a law has it there. A load that is constant in the inertial frame, at a point
whose place is known from a fixed one, has a potential, which becomes a part of L; what else acts is
a generalised force F_i = ∂v/∂q̇_i · load.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics import mechanics as me

from ...core.arguments import as_flag, count_text, quote, shown
from ...core.errors import InputError
from ...core.projection import dependent_rows
from ...core.warnings import warn
from ..parsing.tokens import shorten
from ..symbolic.derivatives import slopes
from ..symbolic.numeric_evaluation import evaluate
from ..symbolic.shared_subexpressions import parts_of, substitute, symbols_of
from .expression_arguments import as_sequence
from .integrable_rows import curls_of
from .lagrangian import LagrangianSystem, from_lagrangian
from .redundant_constraints import random_point
from .sympy_motion import FrameMotion
from .velocity_coefficients import coefficients_of, refuse_unless_linear

__all__ = ["from_mechanics"]

#: Singular values up to this part of the largest count as 0.
_SMALL = 1e-9


@dataclass
class Mechanics:
    """Contents of a method, in functions of time: q(t), q̇(t).

    Attributes
    ----------
    motion : FrameMotion
        Motion of frames and points in the inertial frame, with each generalised speed in q and q̇.
    q : list
        Coordinates.
    L : Expr
        The Lagrangian before the loads.
    loads : list
        Pairs of a point and a force, or a frame and a torque.
    constraints : list of Expr
        g(q, t).
    velocity_constraints : list of Expr
        Constraints on q̇; they may follow from g.
    inputs : dict
        Output of a controller, as the user wrote it → its symbol.
    """

    motion: FrameMotion
    q: list[sp.Expr]
    L: sp.Expr
    loads: list[Any]
    constraints: list[sp.Expr]
    velocity_constraints: list[sp.Expr] = field(default_factory=list)
    inputs: dict[sp.Expr, sp.Symbol] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse what is no load."""
        self.loads = [(load[0], load[1]) for load in self.loads]
        for where, load in self.loads:
            if not (isinstance(where, me.Point | me.ReferenceFrame)
                    and isinstance(load, me.Vector)):
                raise InputError(f"The load ({shown(where)}, {shown(load)}) is neither a point "
                                 "with a force nor a frame with a torque; give such a pair, as "
                                 "with the masscenter or the frame of a body.")
            self.motion.refuse_unoriented(axes for _, axes in load.args)


def from_mechanics(
    method: Any, *, name: str = "system", inputs: Sequence[Any] = (), bodies: bool = False
) -> LagrangianSystem:
    """Return the system of a method of ``sympy.physics.mechanics``.

    Parameters
    ----------
    method : LagrangesMethod, KanesMethod or System
        With its bodies and loads; its equations of motion need not be formed. Of a ``System``
        potential energies of bodies count as loads do: give each force once.
    name : str
        A C identifier; begins the names of the generated files.
    inputs : sequence of Symbol or dynamicsymbols
        Outputs of a controller in loads: constant over a step (``System``).
    bodies : bool
        Give runs where the bodies are: ``run.body(name)``, ``run.show(...)``. Places and axes of
        those that are placed from a point at rest are quantities NAME_x, …, NAME_R11, ….

    Returns
    -------
    System
        As of ``System.from_lagrangian``: coordinates, speeds and constants keep their names.
        Nonholonomic constraints become velocity constraints with multipliers; which speeds a
        ``KanesMethod`` calls dependent does not matter.

    Raises
    ------
    InputError
        For constraints that contradict each other or are not linear in the velocities, for bodies
        whose velocity is the rate of no place, and as ``System.from_lagrangian``.
    """
    mechanics = _mechanics_of(method)
    method_bodies = getattr(method, "bodies", None) or ()
    has_contradictions = _warn_of_velocities(mechanics.motion, method_bodies)
    mechanics.inputs = _inputs(inputs)
    t = me.dynamicsymbols._t
    velocities = [x.diff(t) for x in mechanics.q]
    symbol_of = _symbols_of_motion(mechanics, velocities)
    F, potential = _generalised_forces(mechanics, symbol_of)
    # placed: body → names of the quantities of its place and axes; places: such a name → expression
    placed, places = (_places(mechanics.motion, method_bodies) if as_flag("bodies", bodies)
                      else ({}, {}))
    # one substitution for all expressions, as each is a pass over their whole graph
    L, *expressions = _replace_symbols(mechanics, [
        mechanics.L - potential, *mechanics.constraints, *mechanics.velocity_constraints,
        *places.values()], symbol_of)
    g_end = len(mechanics.constraints)
    rows_end = g_end + len(mechanics.velocity_constraints)
    g, velocity_constraints = expressions[:g_end], expressions[g_end:rows_end]
    quantities = dict(zip(places, expressions[rows_end:], strict=True))
    _refuse_functions(name, [L, *g, *F, *velocity_constraints])
    # if no velocity contradicts a place, the velocity of a placed body is the rate of its place
    _refuse_substituted(mechanics, symbol_of, [
        body for body in method_bodies
        if has_contradictions or not mechanics.motion.is_placed(body.masscenter)])
    q, v = [symbol_of[x] for x in mechanics.q], [symbol_of[x] for x in velocities]
    input_symbols = tuple(mechanics.inputs.values())
    symbols = symbols_of([L, *g, *F, *quantities.values()])
    parameters = sorted(symbols - {*q, *v, *input_symbols, t}, key=str)
    system = from_lagrangian(L, q, v, parameters, g, F if any(f != 0 for f in F) else None,
                             t if t in symbols else None, name=name,
                             inputs=input_symbols, quantities=quantities, placed=placed)
    return _with_velocity_constraints(system, velocity_constraints)


# ---------------------------------------------------------------- contents of a method


def _mechanics_of(method: Any) -> Mechanics:
    """Return the contents of a method; refuse other objects."""
    readers = {me.LagrangesMethod: _of_lagrange, me.KanesMethod: _of_kane, me.System: _of_system}
    for kind, reader in readers.items():
        if isinstance(method, kind):
            return reader(method)
    raise InputError(f"method = {shown(method)} is no LagrangesMethod, KanesMethod or System "
                     "of sympy.physics.mechanics.")


def _of_lagrange(method: Any) -> Mechanics:
    """Return the contents of a LagrangesMethod; its nonholonomic equations follow the others."""
    holonomic = list(method._hol_coneqs)
    if method.forcelist and method.inertial is None:
        raise InputError("LagrangesMethod has a forcelist and no frame; give it as "
                         "LagrangesMethod(..., frame=N), the frame at rest.")
    return Mechanics(FrameMotion(method.inertial), list(method.q), method._L[0],
                     [*(method.forcelist or ())], holonomic, list(method.coneqs)[len(holonomic):])


def _of_kane(method: Any) -> Mechanics:
    """Return the contents of a KanesMethod: T of its bodies, and its speeds as functions of q̇.

    Auxiliary speeds, which exist for reactions only, are 0.
    """
    if not method.bodies:
        raise InputError("KanesMethod has no bodies as yet; give them as KanesMethod(..., "
                         "bodies=[...]), or call its kanes_equations first.")
    frame, u, zeros = method._inertial, list(method.u), dict.fromkeys(method._uaux, sp.Integer(0))
    # k_ku u + k_kqdot q̇ + f_k = 0, and the velocity constraints k_nh u + f_nh = 0
    kinematics = (method._k_ku_implicit * sp.Matrix(u)
                  + method._k_kqdot_implicit * method._qdot + method._f_k_implicit)
    speeds = _solve_speeds(list(kinematics), u)
    velocity_constraints = list(method._k_nh * sp.Matrix(u) + method._f_nh) if method._k_nh else []
    motion = FrameMotion(frame, speeds | zeros)
    return Mechanics(motion, list(method.q), motion.energy(method.bodies),
                     [*(method.loads or ())], list(method._f_h), velocity_constraints)


def _of_system(method: Any) -> Mechanics:
    """Return the contents of a System: T − V of its bodies, its loads and those of actuators."""
    bodies = list(method.bodies)
    if not bodies:
        raise InputError("System has no bodies as yet; add them, or joints that have some.")
    V = sp.Add(*(body.potential_energy for body in bodies))
    loads = [*method.loads, *(load for actuator in method.actuators
                              for load in actuator.to_loads())]
    speeds = _solve_speeds(list(method.kdes), list(method.u)) if method.u else {}
    auxiliary = dict.fromkeys(method.u_aux, sp.Integer(0))
    motion = FrameMotion(method.frame, speeds | auxiliary)
    return Mechanics(motion, list(method.q), motion.energy(bodies) - V, loads,
                     list(method.holonomic_constraints), list(method.velocity_constraints))


def _solve_speeds(equations: Sequence[sp.Expr], u: Sequence[sp.Expr]) -> dict[sp.Expr, sp.Expr]:
    """Return each generalised speed in terms of q and q̇, from kinematic differential equations.

    The equations are linear in u: K u + k = 0, u = −K⁻¹ k.
    """
    if len(equations) != len(u):
        raise InputError(
            f"System has {count_text(len(equations), 'kinematic differential equation')} for "
            f"{count_text(len(u), 'generalised speed')}, {quote(map(str, u))}; give one for each, "
            "such as u − q̇.")
    K = sp.Matrix(equations).jacobian(u)
    if K.has(*u):
        nonlinear = next(e for i, e in enumerate(equations) if K[i, :].has(*u))
        raise InputError(f"The kinematic differential equation {shown(nonlinear)} = 0 is not "
                         "linear in the generalised speeds; write K(q, t) u + k(q, q̇, t).")
    k = sp.Matrix(equations).xreplace(dict.fromkeys(u, sp.Integer(0)))
    solution = K.LUsolve(-k)
    return dict(zip(u, solution, strict=True))


def _warn_of_velocities(motion: FrameMotion, bodies: Sequence[Any]) -> bool:
    """Warn of a velocity of a point that is not the rate of its place; return whether there is one.

    The velocities are used all the same: a base that moves may be at rest in them.
    """
    pair = next(motion.contradictions(bodies), None)
    if pair is not None:
        point, neighbour = pair
        warn(f"In {motion.frame} the velocity of {point} is {shown(point.vel(motion.frame))} and "
             f"that of {neighbour} {shown(neighbour.vel(motion.frame))}, which is not how its "
             "place from there changes; velocities are taken as they are. A joint of SymPy sets "
             "its point at rest in the axes of its first body: a base that moves needs a frame of "
             f"its own, such as {motion.frame}.orientnew('B', 'Axis', [0, {motion.frame}.z]).")
    return pair is not None


def _refuse_substituted(
    mechanics: Mechanics, symbol_of: Mapping[sp.Expr, sp.Symbol], bodies: Sequence[Any]
) -> None:
    """Refuse bodies whose velocity is the rate of no place: a rolling condition was put into it.

    Lagrange's equations of such a T are wrong, since it holds on the constraints only. The
    velocity A(q, t) q̇ + a(q, t) is a rate if ∂A_ij/∂q_k = ∂A_ik/∂q_j and ∂A_ij/∂t = ∂a_i/∂q_j,
    tested at a random point.
    """
    t = me.dynamicsymbols._t
    q = [symbol_of[x] for x in mechanics.q]
    velocities = [symbol_of[x.diff(t)] for x in mechanics.q]
    rng = np.random.default_rng(29)  # a fixed seed: the same bodies have the same answer
    for body in bodies:
        v = body.masscenter.vel(mechanics.motion.frame).to_matrix(mechanics.motion.frame)
        A, a = coefficients_of(_replace_symbols(mechanics, list(v), symbol_of), velocities)
        # a is the coefficient of ṫ = 1: one closed 1-form in (q, t) for each component
        rows, x = [[*row, rate] for row, rate in zip(A, a, strict=True)], [*q, t]
        constants = symbols_of([e for row in rows for e in row]) - {*x}
        values = {s: float(rng.uniform(0.5, 2.0)) for s in sorted(constants, key=str)}
        # numbers between 0.5 and 2, away from 0, where terms of A vanish
        W, curls = curls_of(rows, x, rng.uniform(0.5, 1.5, len(x)), values)
        if np.abs(curls).max() > _SMALL * np.abs(W).max():
            raise InputError(
                f"The velocity of {body.masscenter} in {mechanics.motion.frame} is the rate of no "
                "place: constraints such as rolling have been put into it, where Lagrange's "
                "equations need multipliers. Give the body all coordinates of its place, and the "
                "constraints as velocity_constraints, u_dependent of KanesMethod.")


# ---------------------------------------------------------------- loads


def _generalised_forces(mechanics: Mechanics, symbol_of: Mapping[sp.Expr, sp.Symbol]) -> tuple[
    list[sp.Expr], sp.Expr
]:
    """Return the generalised forces of the loads, n entries, and the potential of constant forces.

    F_i = ∂(Σ v·F)/∂q̇_i, with F held fixed: one pass backward through all velocities v serves all
    loads and all coordinates. A torque takes the angular velocity of its frame for v.
    """
    motion, magnitudes = mechanics.motion, dict[sp.Expr, sp.Expr]()
    power, potential = sp.Integer(0), sp.Integer(0)
    for where, load in mechanics.loads:
        # a constant force has a potential, which belongs to H
        energy = _potential(motion, where, load, mechanics.inputs)
        if energy is not None:
            potential += energy
            continue
        if isinstance(where, me.ReferenceFrame):
            rates, axes = motion.turning(where), where
        else:
            rates, axes = motion.velocity(where)
        for rate, component in zip(rates, motion.components(load, axes), strict=True):
            # a symbol for the component: it may contain velocities, which are not differentiated
            symbol = sp.Symbol(f"_w{len(magnitudes)}", real=True)
            magnitudes[symbol] = component
            power += symbol * rate
    (power,) = _replace_symbols(mechanics, [power], symbol_of)
    forces = slopes(power, tuple(symbol_of[x.diff(me.dynamicsymbols._t)] for x in mechanics.q))
    components = _replace_symbols(mechanics, [*magnitudes.values()], symbol_of)
    component_of = dict(zip(magnitudes, components, strict=True))
    return substitute(forces, component_of), potential


def _potential(
    motion: FrameMotion, where: Any, load: Any, inputs: Mapping[sp.Expr, sp.Symbol]
) -> sp.Expr | None:
    """Return V = −F·r of a constant force at r, the place of ``where`` from a point at rest.

    None for a torque, a force that is not constant, and a point whose place is not known.
    """
    if not isinstance(where, me.Point):
        return None
    components = load.to_matrix(motion.frame)
    # a force of the motion, of the time or of an input has no potential
    changing = {me.dynamicsymbols._t, *inputs}
    if me.find_dynamicsymbols(components) or not changing.isdisjoint(components.free_symbols):
        return None
    position = motion.place(where)
    if position is None:
        return None
    return -sp.Add(*(F * motion.along(k, position) for k, F in enumerate(components) if F != 0))


def _places(motion: FrameMotion, bodies: Sequence[Any]) -> tuple[
    dict[str, dict[str, list[str]]], dict[str, sp.Expr]
]:
    """Return body → names of the quantities of its place and axes, and name → expression.

    A body whose place is not known from a point at rest has none. Two axes of a rigid body are
    enough: the third is their cross product. NAME_Rij is component i of the body's axis j in space.
    """
    placed: dict[str, dict[str, list[str]]] = {}
    quantities: dict[str, sp.Expr] = {}
    for body in bodies:
        position = motion.place(body.masscenter)
        if position is None:
            continue
        if body.name in placed:
            raise InputError(f"Two bodies have the name {body.name!r}; give each its own for "
                             "bodies=True.")
        x = {f"{body.name}_{axis}": motion.along(k, position) for k, axis in enumerate("xyz")}
        # row j of SymPy's matrix is the axis j of the body in space; a particle has no axes; len(R)
        # is the number of entries, 9 or 0
        R = body.frame.dcm(motion.frame) if isinstance(body, me.RigidBody) else sp.zeros(0, 3)
        axes = {f"{body.name}_R{i + 1}{j + 1}": R[j, i] for j in range(min(len(R), 2))
                for i in range(3)}
        quantities |= x | axes
        placed[body.name] = {"x": list(x), "axes": list(axes)}
    return placed, quantities


# ---------------------------------------------------------------- names


def _inputs(inputs: Sequence[Any]) -> dict[sp.Expr, sp.Symbol]:
    """Return a symbol for each input, which may be a function of time."""
    symbol_of: dict[sp.Expr, sp.Symbol] = {}
    for u in as_sequence("inputs", inputs):
        if isinstance(u, AppliedUndef) and u.args == (me.dynamicsymbols._t,):
            symbol_of[u] = sp.Symbol(u.func.__name__, real=True)
        elif isinstance(u, sp.Symbol):
            symbol_of[u] = u
        else:
            raise InputError(f"Input {shown(u)} is neither a symbol nor a function of time; make "
                             "it with sympy.Symbol or dynamicsymbols.")
    return symbol_of


def _symbols_of_motion(mechanics: Mechanics, rates: Sequence[sp.Expr]) -> dict[sp.Expr, sp.Symbol]:
    """Return a symbol for each coordinate, with its name, and for each velocity.

    ``rates`` are the derivatives of the coordinates, in their order. A velocity has the name of the
    speed u that equals it, u = q̇, else NAME_t; ``_`` is appended to a name that is in use.
    """
    for x in mechanics.q:
        if not isinstance(x, AppliedUndef):
            raise InputError(f"Coordinate {shown(x)} is no function of time; make it with "
                             "sympy.physics.mechanics.dynamicsymbols.")
    name_of_speed = {rate: u.func.__name__ for u, rate in mechanics.motion.speeds.items()}
    symbol_of = {x: sp.Symbol(x.func.__name__, real=True) for x in mechanics.q}
    load_components = [e for _, load in mechanics.loads for components, _ in load.args
                       for e in components]
    symbols = symbols_of([mechanics.L, *mechanics.constraints,
                          *load_components]) | {*mechanics.inputs.values()}
    clashes = {str(s) for s in symbols} & {str(s) for s in symbol_of.values()}
    if clashes:
        raise InputError(f"{min(clashes)!r} is a coordinate and a constant or an input; give one "
                         "of them another name.")
    # velocities give way: a coordinate or a constant keeps its name
    reserved = {str(s) for s in (*symbol_of.values(), *symbols)}
    for x, rate in zip(mechanics.q, rates, strict=True):
        name = name_of_speed.get(rate, f"{x.func.__name__}_t")
        while name in reserved:
            name += "_"
        reserved.add(name)
        symbol_of[rate] = sp.Symbol(name, real=True)
    return symbol_of


def _replace_symbols(
    mechanics: Mechanics, expressions: Sequence[sp.Expr], symbol_of: Mapping[sp.Expr, sp.Symbol]
) -> list[sp.Expr]:
    """Return expressions in symbols: q(t), q̇(t) and inputs replaced, speeds in terms of q̇.

    ``symbol_of`` has the symbols of q(t) and q̇(t).
    """
    return substitute(substitute(expressions, mechanics.motion.speeds),
                      {**symbol_of, **mechanics.inputs})


def _refuse_functions(name: str, expressions: Sequence[sp.Expr]) -> None:
    """Refuse functions of time that are neither coordinates nor speeds."""
    for node in parts_of(expressions):
        if isinstance(node, (AppliedUndef, sp.Derivative)):
            raise InputError(f"System {name!r} contains {node}, which is no coordinate and "
                             "no speed; put an expression in its place, in t if it is a law.")


# ---------------------------------------------------------------- constraints on velocities


def _with_velocity_constraints(
    system: LagrangianSystem, velocity_constraints: Sequence[sp.Expr]
) -> LagrangianSystem:
    """Return the system with the velocity constraints that its g does not imply.

    The rows may have parameters and the time, which L does not contain.
    """
    nonzero_rows = [e for e in velocity_constraints if e != 0]
    refuse_unless_linear(system.name, nonzero_rows, system.velocities,
                         [f"A{i}" for i in range(len(nonzero_rows))])
    rows = _independent(system, nonzero_rows)
    if not rows:
        return system
    t, row_symbols = me.dynamicsymbols._t, symbols_of(rows)
    constants = {*system.parameters, *row_symbols} - {
        *system.q, *system.velocities, *system.inputs, t}
    return replace(system, parameters=tuple(sorted(constants, key=str)), velocity_constraints=rows,
                   time=t if t in row_symbols else system.time)


def _independent(
    system: LagrangianSystem, velocity_constraints: Sequence[sp.Expr]
) -> tuple[sp.Expr, ...]:
    """Return the constraints on velocities that neither g nor earlier ones imply.

    A row a(q, t) v + a₀(q, t) is implied if (a, a₀) is a combination of others, such as (g_q, g_t),
    at a random point of g = 0. Raises InputError where a is a combination of others, and (a, a₀)
    is none: no velocities then satisfy all rows.
    """
    if not velocity_constraints:
        return ()
    A, a = coefficients_of(velocity_constraints, system.velocities)
    rows = [[*row, rate] for row, rate in zip((*system.G, *A), (*system.g_t, *a), strict=True)]
    flat = [e for row in rows for e in row]
    q, values = random_point(system, symbols_of(flat))
    substitution: Mapping[sp.Symbol, Any] = dict(zip(system.q, q, strict=True)) | values
    numbers = evaluate(flat, substitution).reshape(len(rows), system.n + 1)
    implied = {*dependent_rows(numbers).left_out}
    # the row depends on others without a₀ and not with it: a v = −a₀ has no solution
    contradictory = {*dependent_rows(numbers[:, :-1]).left_out} - implied
    if contradictory:
        row = velocity_constraints[max(contradictory) - system.m]
        raise InputError(f"The constraint {shorten(str(row), 60)} = 0 on the velocities of "
                         f"{system.name!r} contradicts the others: no velocities satisfy them all; "
                         "leave it out, or correct it.")
    return tuple(e for i, e in enumerate(velocity_constraints, start=system.m)
                 if i not in implied)
