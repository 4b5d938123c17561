"""A constrained Hamiltonian system, and the derivatives that a step needs of it.

    q̇ = H_p(q, p),   ṗ = −H_q(q, p) − g_q(q)ᵀ λ,   0 = g(q)          (paper, eq. 12)

Generalised forces F(q, p, t) that no potential has are added to ṗ. H and g may depend on t too:
then g_q H_p + g_t = 0, and energy changes by work of forces and of explicit time dependence, Ḣ =
F·q̇ + H_t + λᵀg_t.

Velocity constraints A(q, t) q̇ + a(q, t) = 0, such as those of rolling, add −Aᵀμ to ṗ: Ḣ then has
the further term μᵀa.

Nothing here knows of quaternions: a system is its symbols, its H and its g.
"""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import sympy as sp

from ...core.arguments import as_flag, as_items, as_mapping, as_text, count_text, few, shown
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ...core.frozen_dict import FrozenDict
from ...core.html import card, table
from ...core.records import dataclass
from ..parsing.reserved_names import is_taken
from .body_layout import BodyLayout, JointLayout
from .expression_arguments import (
    as_expression,
    as_sequence,
    refuse_other_assumptions,
    refuse_unless_symbols,
    shown_formula,
)
from .jacobians import curvature, difference, gradient, jacobian, shortest, symmetric_jacobian
from .velocity_coefficients import coefficients_of, refuse_unless_linear

__all__ = ["BodyLayout", "System"]

#: The letters of principal moments, and those of J⁻¹ where the inertia is a tensor.
MOMENTS = ("I1", "I2", "I3")
INVERSE = ("K11", "K12", "K13", "K22", "K23", "K33")
#: Constraints of a system with velocity constraints whose W = g_q H_pp g_qᵀ is not shortened.
_MANY = 8
#: Constraints and forces that notebooks show.
_SHOWN = 6


@explain_arguments
@dataclass(frozen=True)
class System:
    """A holonomic Hamiltonian system with n coordinates and m constraints.

    Parameters
    ----------
    q, p : sequence of Symbol
        Coordinates and conjugate momenta, n of each.
    parameters : sequence of Symbol
        Everything else that occurs in H and g. A symbol declared ``positive`` or ``nonzero``
        is checked at run time against that; other assumptions of SymPy, such as ``integer``, are
        refused.
    H : Expr
        The Hamiltonian H(q, p; parameters).
    constraints : sequence of Expr
        g(q; parameters), m expressions that vanish on the constraint manifold.
    name : str
        A C identifier; begins the names of the generated files.
    constraint_names : sequence of str
        Name of each constraint in messages, e.g. the name of its joint; by default g0, g1, …
    forces : sequence of Expr
        Generalised forces F(q, p, t; parameters), n of them or none: ṗ = −H_q + F − g_qᵀλ.
    time : Symbol, optional
        The symbol of t in H, constraints, forces and quantities.
    inputs : sequence of Symbol
        Parameters that may change from step to step, such as the output of a controller; they occur
        in forces only.
    velocity_constraints : sequence of Expr
        A(q, t) q̇ + a(q, t), m' expressions that vanish on every motion, linear or affine in the
        velocities. They need not be integrable: rolling, skates, wheels.
    velocities : sequence of Symbol
        The symbols of q̇ in the velocity constraints, n of them, or none.
    velocity_constraint_names : sequence of str
        Name of each velocity constraint in messages; by default A0, A1, …
    quantities : mapping of str to Expr
        Quantities of q, p, t and parameters that trajectories offer by name; a name of a symbol of
        q, p, parameters or time is refused.
    time_scale : Expr, optional
        σ(q, p, t) > 0 with dt = σ dτ: constant steps Δτ are steps Δt ≈ σ Δτ that adapt to the
        motion. σ is to be small where any rate of the motion is large; see ``gyrospark.scales``.
    rigid_body : bool
        True when q is a unit quaternion of a body with principal moments I1, I2, I3 (or K11, K12,
        K13, K22, K23, K33, the entries of J⁻¹): the trajectory then offers angular velocity, axis
        and rotation.
    bodies : sequence of BodyLayout
        Bodies whose quaternions are a part of q, as ``Multibody`` makes them, for the same views.
    joints : sequence of JointLayout
        Connections of the bodies.

    Notes
    -----
    All symbols stand for real numbers. Expressions may have SymPy's Abs, sign, Heaviside, Min, Max,
    Piecewise, floor, ceiling and Mod (``switching_functions``); Heaviside(0) is ½ unless it is said
    otherwise. Derivatives are taken on the side where q and p are. A constraint must have a
    continuous derivative all the same, and EMS uses the continuous part of H.
    """

    q: tuple[sp.Symbol, ...]
    p: tuple[sp.Symbol, ...]
    parameters: tuple[sp.Symbol, ...]
    H: sp.Expr
    constraints: tuple[sp.Expr, ...] = ()
    name: str = field(default="system", kw_only=True)
    constraint_names: tuple[str, ...] = field(default=(), kw_only=True)
    forces: tuple[sp.Expr, ...] = field(default=(), kw_only=True)
    time: sp.Symbol | None = field(default=None, kw_only=True)
    inputs: tuple[sp.Symbol, ...] = field(default=(), kw_only=True)
    quantities: Mapping[str, sp.Expr] = field(default_factory=dict, kw_only=True, hash=False)
    rigid_body: bool = field(default=False, kw_only=True)
    bodies: tuple[BodyLayout, ...] = field(default=(), kw_only=True)
    joints: tuple[JointLayout, ...] = field(default=(), kw_only=True)
    velocity_constraints: tuple[sp.Expr, ...] = field(default=(), kw_only=True)
    velocities: tuple[sp.Symbol, ...] = field(default=(), kw_only=True)
    velocity_constraint_names: tuple[str, ...] = field(default=(), kw_only=True)
    time_scale: sp.Expr | None = field(default=None, kw_only=True)

    if TYPE_CHECKING:  # sequences become tuples of expressions
        def __init__(
            self, q: Sequence[sp.Symbol], p: Sequence[sp.Symbol], parameters: Sequence[sp.Symbol],
            H: sp.Expr | float, constraints: Sequence[sp.Expr] = (), *, name: str = "system",
            constraint_names: Sequence[str] = (), forces: Sequence[sp.Expr | float] = (),
            time: sp.Symbol | None = None, inputs: Sequence[sp.Symbol] = (),
            quantities: Mapping[str, sp.Expr] = ..., rigid_body: bool = False,
            bodies: tuple[BodyLayout, ...] = (), joints: tuple[JointLayout, ...] = (),
            velocity_constraints: Sequence[sp.Expr] = (), velocities: Sequence[sp.Symbol] = (),
            velocity_constraint_names: Sequence[str] = (), time_scale: sp.Expr | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        # each check relies on those before it
        self._convert_fields()
        self._refuse_wrong_counts()
        self._refuse_names()
        self._refuse_undeclared_symbols()
        self._refuse_inputs_elsewhere()
        self._refuse_unless_linear()
        if self.time_scale is not None:
            from .time_scale import refuse_unscalable  # imports this module

            object.__setattr__(self, "time_scale", as_expression(self.time_scale))
            refuse_unscalable(self)
        for key, kind in (("bodies", BodyLayout), ("joints", JointLayout)):
            entries = as_items(key, getattr(self, key),
                               f"what Multibody makes, {kind.__name__}")
            if not all(isinstance(entry, kind) for entry in entries):
                raise InputError(f"{key} = {shown(entries)} are no {key}; Multibody makes them.")
            object.__setattr__(self, key, tuple(entries))
        if self.rigid_body and not self.bodies:
            object.__setattr__(self, "bodies", (self._whole_body(),))

    def _convert_fields(self) -> None:
        """Convert fields to tuples of expressions, symbols and texts, or raise InputError."""
        for name in ("q", "p", "parameters", "constraints", "forces", "inputs",
                     "velocity_constraints", "velocities"):
            entries = as_sequence(name, getattr(self, name))
            object.__setattr__(self, name, tuple(map(as_expression, entries)))
        # inputs are parameters, too: their values may change from step to step
        undeclared_inputs = tuple(u for u in self.inputs if u not in self.parameters)
        object.__setattr__(self, "parameters", self.parameters + undeclared_inputs)
        as_text("name of the system", self.name)
        as_flag("rigid_body", self.rigid_body)
        object.__setattr__(self, "H", as_expression(self.H))
        quantities = as_mapping("quantities", self.quantities, "{'height': q[1]}")
        object.__setattr__(self, "quantities", FrozenDict(
            {name: as_expression(e) for name, e in quantities.items()}))
        for key, letter, count in (("constraint_names", "g", self.m),
                                   ("velocity_constraint_names", "A", self.velocity_count)):
            entries = as_items(key, getattr(self, key), "texts")
            names = tuple(as_text("a constraint's name", name) for name in entries)
            object.__setattr__(self, key, names or tuple(f"{letter}{i}" for i in range(count)))
        for key in ("q", "p", "inputs", "parameters", "velocities"):
            refuse_unless_symbols(self.name, key, getattr(self, key))
        if self.time is not None:
            refuse_unless_symbols(self.name, "time", (self.time,))

    def _refuse_wrong_counts(self) -> None:
        """Refuse a name that is no C identifier, and counts that do not fit each other.

        These are the counts of momenta, velocities, constraints, constraint names and forces.
        """
        if not self.name.isidentifier() or not self.name.isascii():
            raise InputError(f"System name {self.name!r} is not a C identifier; use letters, "
                             "digits and '_'.")
        if len(self.q) != len(self.p) or not self.q:
            raise InputError(f"System {self.name!r} has {count_text(len(self.q), 'coordinate')} "
                             f"and {len(self.p)} momenta; give one momentum for each of at least "
                             "one coordinate.")
        # velocities may be missing only where no velocity constraint needs them
        allowed_counts = (self.n,) if self.velocity_count else (0, self.n)
        if len(self.velocities) not in allowed_counts:
            raise InputError(
                f"System {self.name!r} has {self.n} coordinates and {len(self.velocities)} "
                "velocities; give the symbol of each coordinate's velocity, in the same order.")
        for key, count in (("constraint", self.m), ("velocity_constraint", self.velocity_count)):
            if len(names := getattr(self, f"{key}_names")) != count:
                raise InputError(
                    f"System {self.name!r} has {count} {key}s and {len(names)} {key}_names; "
                    "give one name for each constraint, or none.")
        # drives, constraints of t, may determine all coordinates; else one freedom must remain
        total = self.m + self.velocity_count
        if total > len(self.q) - (self.clock is None):
            # redundant constraints, if that is the cause, are refused by name
            from .redundant_constraints import refuse_redundant_anywhere  # imports this module

            self._refuse_unless_linear()
            refuse_redundant_anywhere(self)
            raise InputError(f"System {self.name!r} has {total} constraints on {len(self.q)} "
                             "coordinates; fewer constraints than coordinates must remain. If "
                             "drives determine the whole motion, add a body that moves freely, "
                             "such as build.point_mass(...); if a closed loop takes the last "
                             "freedom, leave out one of its joints.")
        if len(self.forces) not in (0, self.n):
            raise InputError(f"System {self.name!r} has {count_text(len(self.forces), 'force')} on "
                             f"{self.n} coordinates; give one for each coordinate (0 where none "
                             "acts), or none at all.")

    def _refuse_unless_linear(self) -> None:
        """Refuse velocity constraints that are not linear, and such without velocities."""
        refuse_unless_linear(self.name, self.velocity_constraints, self.velocities,
                             self.velocity_constraint_names)

    def _whole_body(self) -> BodyLayout:
        """Return the layout of the body whose quaternion is all of q; refuse any other q."""
        parameters = {str(s): s for s in self.parameters}
        inertia = next((letters for letters in (MOMENTS, INVERSE) if {*letters} <= {*parameters}),
                       ())
        if self.n != 4 or not inertia:
            raise InputError(
                f"System {self.name!r} is no rigid_body: it has {self.n} coordinates and the "
                f"parameters {', '.join(parameters) or 'none'}; a body has a quaternion of 4 and "
                "the moments I1, I2, I3.")
        return BodyLayout("body", self.q, tuple(parameters[letter] for letter in inertia))

    def __repr__(self) -> str:
        parts = [f"coordinates {few(self.q)}", f"parameters {few(self.parameters)}",
                 count_text(self.m, "constraint")]
        parts += [count_text(self.velocity_count, "velocity constraint")] * bool(
            self.velocity_count)
        parts += ["forces"] if self.forces else []
        parts += [f"quantities {few(self.quantities)}"] if self.quantities else []
        return f"<System {self.name}: {'; '.join(parts)}>"

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: H, g and forces as formulas, where they are short enough."""
        # strict=False: the first entries of each field, and of the forces none if there are none
        rows = [("H", shown_formula(self.H)),
                *((f"g: {name}", shown_formula(g)) for name, g in
                  zip(self.constraint_names[:_SHOWN], self.constraints, strict=False)),
                *((f"A v + a: {name}", shown_formula(row)) for name, row in
                  zip(self.velocity_constraint_names[:_SHOWN], self.velocity_constraints,
                      strict=False)),
                *((f"F({p})", shown_formula(F)) for p, F in
                  zip(self.p[:_SHOWN], self.forces, strict=False)),
                *([] if self.time_scale is None else [("dt/dτ", shown_formula(self.time_scale))])]
        rows += [("coordinates", few(self.q)), ("momenta", few(self.p)),
                 ("parameters", few(self.parameters)), ("constraints", str(self.m))]
        return card(f"System {self.name}", table(rows))

    def _refuse_names(self) -> None:
        """Refuse names that are no C identifiers, are taken in the C, or occur twice."""
        time = () if self.time is None else (self.time,)
        names = [str(s) for s in (*self.q, *self.p, *self.velocities, *self.parameters, *time)]
        for name in names:
            if not _is_name(name):
                raise InputError(f"System {self.name!r} has a symbol named {name!r}; names are "
                                 "letters, digits and '_' and begin with a "
                                 f"letter{_latin_proposal(name)}.")
            if is_taken(name) or self._is_guard(name):
                raise InputError(f"System {self.name!r} has a symbol named {name!r}, which is a "
                                 "keyword or a macro of the generated C; choose another name.")
        repeated = sorted(name for name, count in Counter(names).items() if count > 1)
        if repeated:
            raise InputError(f"System {self.name!r} uses the name {repeated[0]!r} twice; names "
                             "must differ.")
        for name in self.quantities:
            if not _is_name(name):
                raise InputError(f"System {self.name!r} has a quantity named {name!r}; names are "
                                 "letters, digits and '_' and begin with a letter.")
            # events and tables find both by their names, but no symbols of velocities
            if name in {*names} - {*map(str, self.velocities)}:
                raise InputError(f"System {self.name!r} has a quantity and a symbol named "
                                 f"{name!r}; give the quantity another name.")

    def _refuse_undeclared_symbols(self) -> None:
        """Refuse symbols of H, constraints, forces and quantities that are not declared.

        H(q, p, t), forces and quantities have all declared symbols; g(q, t) has no momenta, and
        A(q, t) v + a(q, t) velocities in place of these.
        """
        time = () if self.time is None else (self.time,)
        allowed = {*self.q, *self.p, *self.parameters, *self._dependent_symbols, *time}
        of_g = allowed - {*self.p, *self._dependent_symbols}
        of_rows = (allowed - {*self.p}) | {*self.velocities}
        any_symbol = "the unknown symbol {}; declare it in q, p, parameters or as time."
        # label, expression, symbols that it may contain, rest of the sentence
        checks: list[tuple[str, sp.Expr, set[sp.Symbol], str]] = [
            ("H", self.H, allowed, any_symbol),
            *((f"Constraint {i}", g, of_g,
               "{}; a holonomic constraint depends on q, parameters and what is declared as time; "
               "declare it there, or remove it.") for i, g in enumerate(self.constraints)),
            *((f"Velocity constraint {name!r}", row, of_rows,
               "{}; it depends on q, velocities, parameters and what is declared as time; declare "
               "it there, or remove it.") for name, row in zip(
                   self.velocity_constraint_names, self.velocity_constraints, strict=True)),
            *((f"Force {i}", e, allowed, any_symbol) for i, e in enumerate(self.forces)),
            *((f"Quantity {name!r}", e, allowed, any_symbol)
              for name, e in self.quantities.items())]
        for label, e, symbols, sentence in checks:
            if unknown := e.free_symbols - symbols:
                refuse_other_assumptions(label, self.name, unknown, symbols)
                raise InputError(f"{label} of system {self.name!r} contains "
                                 + sentence.format(repr(min(map(str, unknown)))))

    def _refuse_inputs_elsewhere(self) -> None:
        """Refuse inputs outside forces: they jump between steps, which changes H and violates g."""
        places = {label: (e,) for label, e in self.defining.items()}
        places |= {"a constraint": (*self.constraints, *self.velocity_constraints),
                   "a quantity": tuple(self.quantities.values())}
        for label, expressions in places.items():
            inputs = {s for e in expressions for s in e.free_symbols}.intersection(self.inputs)
            if inputs:
                raise InputError(
                    f"System {self.name!r} has the input {min(map(str, inputs))!r} in {label}; an "
                    "input jumps from step to step: write what it does as forces.")

    def _is_guard(self, name: str) -> bool:
        """Whether the header of a stepper of this system may have this include guard."""
        return re.fullmatch(f"{self.name.upper()}_[A-Z0-9_]+_H", name) is not None

    @property
    def _dependent_symbols(self) -> tuple[sp.Symbol, ...]:
        """Symbols in H that are functions of q and p: none, but the velocities of a Lagrangian."""
        return ()

    @property
    def defining(self) -> dict[str, sp.Expr]:
        """Fields of the system that enter its equations of motion, by name."""
        return {"H": self.H}

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.q)

    @property
    def m(self) -> int:
        """Number of constraints."""
        return len(self.constraints)

    @property
    def velocity_count(self) -> int:
        """Number m' of velocity constraints."""
        return len(self.velocity_constraints)

    @cached_property
    def H_q(self) -> list[sp.Expr]:
        """∂H/∂q, n entries."""
        return gradient(self.H, self.q)

    @cached_property
    def H_p(self) -> list[sp.Expr]:
        """∂H/∂p, n entries."""
        return gradient(self.H, self.p)

    @cached_property
    def H_qq(self) -> list[list[sp.Expr]]:
        """∂²H/∂q∂q, n × n."""
        return symmetric_jacobian(self.H_q, self.q)

    @cached_property
    def H_pq(self) -> list[list[sp.Expr]]:
        """∂H_p/∂q, n × n; its transpose is ∂H_q/∂p."""
        return jacobian(self.H_p, self.q)

    @cached_property
    def H_pp(self) -> list[list[sp.Expr]]:
        """∂²H/∂p∂p, n × n."""
        return symmetric_jacobian(self.H_p, self.p)

    @cached_property
    def minus_p_rate(self) -> list[sp.Expr]:
        """H_q − F, n entries: −ṗ but for the constraint forces."""
        if not self.forces:
            return self.H_q
        return [h - f for h, f in zip(self.H_q, self.forces, strict=True)]

    @cached_property
    def minus_p_rate_by_q(self) -> list[list[sp.Expr]]:
        """H_qq − F_q, n × n, of a system with forces."""
        return difference(self.H_qq, jacobian(self.forces, self.q))

    @cached_property
    def minus_p_rate_by_p(self) -> list[list[sp.Expr]]:
        """H_qp − F_p, n × n, of a system with forces: not the transpose of H_pq."""
        transposed = [list(column) for column in zip(*self.H_pq, strict=True)]
        return difference(transposed, jacobian(self.forces, self.p))

    @staticmethod
    def from_lagrangian(
        L: sp.Expr, q: Sequence[sp.Symbol], velocities: Sequence[sp.Symbol],
        parameters: Sequence[sp.Symbol], constraints: Sequence[sp.Expr] = (),
        forces: Sequence[sp.Expr] | None = None, time: sp.Symbol | None = None, *,
        name: str = "system", constraint_names: Sequence[str] = (),
        inputs: Sequence[sp.Symbol] = (), quantities: Mapping[str, sp.Expr] | None = None,
        placed: Mapping[str, Mapping[str, Sequence[str]]] | None = None,
        velocity_constraints: Sequence[sp.Expr] = (),
        velocity_constraint_names: Sequence[str] = (),
    ) -> System:
        """Return the system of a Lagrangian L = ½ vᵀM(q, t)v + b(q, t)ᵀv − V(q, t).

            p = L_v = M v + b,   d/dt L_v = L_q + F − g_qᵀλ − Aᵀμ

        M is factorised numerically in every step and never inverted in symbols.

        Parameters
        ----------
        L : Expr
            L(q, v, t; parameters) in J.
        q, velocities : sequence of Symbol
            Coordinates and the symbols v of their rates, n of each. Momenta have the names ``p_…``.
        parameters : sequence of Symbol
            Every other symbol but ``time`` and ``inputs``.
        constraints : sequence of Expr
            g(q, t; parameters), m expressions.
        forces : sequence of Expr, optional
            Generalised forces F(q, v, t; parameters, inputs), n of them.
        time : Symbol, optional
            The symbol of t in L, constraints, forces and quantities.
        name, constraint_names, inputs, quantities
            As of ``System``; steppers take quantities in momenta alone, and in
            velocities of ``system.legendre()``.
        placed : mapping, optional
            Name of a body → ``x`` and ``axes``: names of the quantities that are the place of its
            centre of mass, and of its first two axes in space, none for a particle.
        velocity_constraints, velocity_constraint_names
            As of ``System``: A(q, t) v + a(q, t) = 0.

        Raises
        ------
        InputError
            For an L that is not quadratic in the velocities, a singular M, with the velocities
            that have no mass, another number of velocities than of coordinates, and as ``System``.
        """
        from .lagrangian import from_lagrangian

        return from_lagrangian(
            L, q, velocities, parameters, constraints, forces, time, name=name,
            constraint_names=constraint_names, inputs=inputs, quantities=quantities, placed=placed,
            velocity_constraints=velocity_constraints,
            velocity_constraint_names=velocity_constraint_names)

    def with_row_integrals(self) -> System:
        """Return the system with integrable velocity constraints as constraints on positions.

        They then hold to round-off, where as velocities they hold to the order of the method:
        see ``integrable_rows``. Each has a new parameter NAME_0, the value of the integral at the
        start.
        """
        from .integrable_rows import with_row_integrals

        return with_row_integrals(self)

    def with_time_scale(self, scale: sp.Expr | None) -> System:
        """Return the system with another ``time_scale``, or without one."""
        return replace(self, time_scale=scale)

    @property
    def is_nonautonomous(self) -> bool:
        """Whether H, g or F depends on time."""
        return self.is_time_dependent or any(self.time in f.free_symbols for f in self.forces)

    @property
    def is_time_dependent(self) -> bool:
        """Whether H, g, A or a depends on time: then kernels find t among the constants."""
        return self.clock is not None

    @cached_property
    def clock(self) -> sp.Symbol | None:
        """The time where H or a constraint depends on it."""
        time_dependent = any(self.time in e.free_symbols
                             for e in (*self.defining.values(), *self.constraints,
                                       *self.velocity_constraints))
        return self.time if time_dependent else None

    @cached_property
    def H_t(self) -> sp.Expr:
        """∂H/∂t, the explicit time derivative."""
        return sp.Integer(0) if self.clock is None else gradient(self.H, [self.clock])[0]

    @cached_property
    def g_t(self) -> list[sp.Expr]:
        """∂g/∂t, m entries: how fast the constraints move."""
        if self.clock is None:
            return [sp.Integer(0)] * self.m
        return [row[0] for row in jacobian(self.constraints, [self.clock])]

    @cached_property
    def G(self) -> list[list[sp.Expr]]:
        """g_q = ∂g/∂q, m × n."""
        return jacobian(self.constraints, self.q)

    @cached_property
    def A(self) -> list[list[sp.Expr]]:
        """The coefficients of the velocities in the velocity constraints, m' × n."""
        A, _ = self._velocity_rows
        return A

    @cached_property
    def a(self) -> list[sp.Expr]:
        """The velocity constraints at rest, m' entries: A(q, t) q̇ + a(q, t) = 0."""
        _, a = self._velocity_rows
        return a

    @cached_property
    def _velocity_rows(self) -> tuple[list[list[sp.Expr]], list[sp.Expr]]:
        """A, m' × n, and a, m' entries, of the velocity constraints."""
        return coefficients_of(self.velocity_constraints, self.velocities)

    def curvature(self, multipliers: Sequence[sp.Symbol]) -> list[list[sp.Expr]]:
        """Return Σ_l λ_l ∂²g_l/∂q∂q, n × n: the derivative of g_qᵀ λ by q."""
        return curvature(self.constraints, self.q, multipliers)

    @cached_property
    def hidden(self) -> list[sp.Expr]:
        """The constraint on the momenta, m entries: g_q H_p + g_t = 0 (12) in its shortest form.

        Expanded, identically vanishing terms such as L(q)q cancel, and with them their
        round-off; factors that cannot vanish on g = 0 are dropped. For the quaternion both
        representations come out as qᵀp (17).
        """
        products = [sum(a * b for a, b in zip(row, self.H_p, strict=True)) for row in self.G]
        return [self._without_units(shortest(e + rate))
                for e, rate in zip(products, self.g_t, strict=True)]

    def _without_units(self, e: sp.Expr) -> sp.Expr:
        """Return e without the factors free of p that are a nonzero constant wherever g = 0."""
        factors = [f for f in sp.Mul.make_args(e) if f.has(*self.p) or not self._is_unit(f)]
        return sp.Mul(*factors)

    def _is_unit(self, factor: sp.Expr) -> bool:
        """Return whether a factor is a nonzero constant on g = 0.

        For polynomials the remainder modulo g decides: |q|² is 1 on |q|² − 1 = 0.
        """
        if not factor.has(*self.q):
            return bool(factor.is_nonzero)
        if not all(e.is_polynomial(*self.q) for e in (factor, *self.constraints)):
            return False
        _, remainder = sp.reduced(factor, list(self.constraints), *self.q)
        return not remainder.has(*self.q) and bool(remainder.is_nonzero)

    @cached_property
    def hidden_matrix(self) -> list[list[sp.Expr]]:
        """W = (∂f/∂p) g_qᵀ, m × m, with f = ``hidden``.

        It is g_q H_pp g_qᵀ without the factors that ``hidden`` drops.
        """
        rows = jacobian(self.hidden, self.p)
        # Many bodies that roll have no element templates: hundreds of entries of W are written out.
        products = [[sum((a * b for a, b in zip(row, g_q, strict=True)), sp.Integer(0))
                     for g_q in self.G] for row in rows]
        if self.velocity_count and self.m > _MANY:
            return products
        return [[shortest(e) for e in row] for row in products]


def _latin_proposal(name: str) -> str:
    """Return the end of a sentence with a Latin name for one with Greek letters, e.g. for "ω1".

    Empty if that is no name either. Unicode calls ω "GREEK SMALL LETTER OMEGA": the last word is
    its name, but of é, "… E WITH ACUTE".
    """
    words_of = [unicodedata.name(letter, "").lower().split() if not letter.isascii() else [letter]
                for letter in name]
    proposal = "".join(words[-1] for words in words_of if words)
    is_letters = all(len(words) == 1 or ("letter" in words and "with" not in words)
                     for words in words_of)
    return f"; write sympy.Symbol({proposal!r})" if is_letters and _is_name(proposal) else ""


def _is_name(text: str) -> bool:
    """Whether a text consists of letters, digits and "_", and begins with a letter."""
    return re.fullmatch("[A-Za-z][A-Za-z0-9_]*", text) is not None
