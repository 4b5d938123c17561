"""Equations of a step of each scheme, for any system.

SPARK (B.1), (B.2): unknowns k_1..k_s, k̂_1..k̂_s, Λ_0..Λ_{p−1};
    r = [k_i − H_p(Q_i, P_i);  k̂_i + H_q(Q_i, P_i);  g(Q̃_l), l = 1..p]

With velocity constraints A(q, t) q̇ + a(q, t) = 0 of reactions −A(Q_i)ᵀM_i, which k̂_i contains,
    further unknowns Λ_p (where there is a g) and M_1..M_s,
    r = […; k̂_i + H_q(Q_i, P_i) + A(Q_i)ᵀM_i; …; g_q H_p + g_t at (Q̃_p, P̃_p);
         A(Q̃_i) H_p(Q̃_i, P̃_i) + a(Q̃_i), i = 1..s],   P̃_i of ``velocity_rows``.

IMS (53) and EMS (61): unknowns Δq, Δp, λ;
    r = [Δq/Δt − D_pH;  Δp/Δt + D_qH + Ḡᵀλ;  g(q + Δq)]
with D the gradient at the midpoint (IMS) or the discrete gradient (EMS), Ḡ likewise of g.

With forces F(q, p, t), H_q − F replaces H_q: SPARK has F(Q_i, P_i, t + c_i Δt), IMS and
EMS have F at the midpoint, F(q̄, p̄, t + Δt/2), so that ΔH = F·Δq holds exactly for EMS.

If H or g depends on t, SPARK has H_q(Q_i, P_i, t + c_i Δt) and g(Q̃_l, t + c̃_l Δt), and time is
one more variable of the discrete gradient of EMS, from t to t + Δt:

    ΔH = D_qH·Δq + D_pH·Δp + D_tH Δt,   Δg = Ḡ Δq + ḡ_t Δt = 0,   so ΔH = F·Δq + (D_tH + λᵀḡ_t) Δt

The last is the work of forces and of explicit time dependence; IMS has all of these at the
midpoint.

The C loops over the stages; the kernels below are expressions.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import sympy as sp

from ...core.records import dataclass
from ..kernels.kernel import Constants
from ..kernels.statements import Kernel
from ..symbolic.identities import IdentityCheck, compare, is_refuted
from ..symbolic.shared_subexpressions import substitute
from ..systems.jacobians import jacobian, transposed_product
from ..systems.lagrangian import LagrangianSystem
from ..systems.moving_frame import CoMovingSystem, energy_of
from ..systems.system import System
from ..tableaux.tableau import Tableau
from .lagrangian_kernels import motion_kernels, newton_kernels, state_kernels
from .system_differences import (
    TIME_STEP,
    StateSymbols,
    by_increment,
    constraint_increment,
    differences_of_states,
    discrete_jacobian,
    discrete_slopes,
    mean_gradient_of,
    mean_slopes_of,
    means_of_states,
    time_input,
    vector,
)

__all__ = ["MeanScheme", "SparkScheme", "common_kernels"]


def common_kernels(system: System) -> list[Kernel]:
    """Return the kernels that every scheme needs: H, F, g, G, f and the matrix W of f.

    W = f_p Gᵀ projects momenta onto f = 0: p ← p − Gᵀ W⁻¹ f. A Lagrangian L = ½ vᵀM v + b·v − V has
    kernels of M, b, V and F in place of H. A frame on whose motion forces do work has a kernel of
    its velocity.
    """
    if isinstance(system, LagrangianSystem):
        return [*state_kernels(system), *(place_kernels(system) if system.m else []),
                *constraint_rate_kernels(system)]
    at_state = {"q": list(system.q), "p": list(system.p)}
    kernels = [Kernel("hamiltonian", "H(q, p)", at_state, {"H": energy_of(system)})]
    if system.forces:
        kernels.append(Kernel("applied_force", "F(q, p, t), which no potential has",
                              at_state | time_input(system), {"F": list(system.forces)}))
    if isinstance(system, CoMovingSystem) and system.frame_velocity:
        kernels.append(Kernel("frame_velocity", "sum omega_i A_i q, by which the frame moves q",
                              {"q": list(system.q)}, {"v": list(system.frame_velocity)}))
    if system.m == 0:
        return kernels
    return [*kernels, *place_kernels(system), *_hidden_kernels(system)]


def _hidden_kernels(system: System) -> list[Kernel]:
    """Return the kernels of the constraint f on the momenta, and of the matrix W = f_p Gᵀ."""
    at_state = {"q": list(system.q), "p": list(system.p)}
    return [
        Kernel("hidden_constraint",
               "f(q, p) = 0 on the momenta: G H_p = 0 without its factors that cannot vanish",
               at_state, {"f": system.hidden}),
        Kernel("hidden_matrix", "W = (df/dp) G^T", at_state, {"W": system.hidden_matrix}),
    ]


def place_kernels(system: System) -> list[Kernel]:
    """Return the kernels of the constraints as functions of q: g(q), g(q + d) − g(q) and G(q)."""
    q, d = list(system.q), vector("d", system.n)
    return [
        # terms of g nearly cancel on the constraints
        Kernel("constraint", "g(q)", {"q": q}, {"g": list(system.constraints)}, compensated=True),
        Kernel("constraint_increment",
               "g(q + d) - g(q), by discrete differentiation: no digit is lost for small d",
               {"q": q, "d": d}, {"dg": constraint_increment(system, d)}),
        Kernel("constraint_jacobian", "G = dg/dq", {"q": q}, {"G": system.G}),
    ]


@dataclass(frozen=True)
class SparkScheme:
    """Any (s, p)-SPARK method: T1 solves (B.1), T2 projects the momentum (A.6)."""

    system: System
    tableau: Tableau
    #: Whether A + θZ with one θ a step replaces A and Â (``energy_parameter``).
    exact_energy: bool = False
    #: The unknowns are rates and multipliers, not the state at the end of the step.
    unknowns_are_state = False

    @property
    def size(self) -> int:
        """Number of unknowns of T1."""
        size = 2 * self.system.n * self.tableau.s + self.system.m * self.tableau.p
        if not self.system.velocity_count:
            return size
        # T1 also solves for Λ_p and M_1..M_s
        return size + self.system.m + self.system.velocity_count * self.tableau.s

    @property
    def multipliers(self) -> int:
        """Number of multipliers of a step for each constraint: Λ_0..Λ_p."""
        return self.tableau.p + 1 if self.system.m else 0

    @property
    def reactions(self) -> int:
        """Number of multipliers of a step for each velocity constraint: M_1..M_s."""
        return self.tableau.s if self.system.velocity_count else 0

    @cached_property
    def order(self) -> int:
        """Order of convergence, derived from the tableau."""
        # without constraints the conditions on Ã, Ā and b̃ do not matter
        return self.tableau.order if self.system.m else self.tableau.free_order

    def kernels(self) -> list[Kernel]:
        """Return the derivative kernels that the stage loops call."""
        system = self.system
        if isinstance(system, LagrangianSystem):
            return [*motion_kernels(system), *newton_kernels(system), *self._curvature_kernels(),
                    *velocity_kernels(system)]
        return [*self._rate_kernels(), *energy_rate_kernels(system),
                *constraint_rate_kernels(system), *self._curvature_kernels(),
                *velocity_kernels(system)]

    def _rate_kernels(self) -> list[Kernel]:
        """Return the kernels of H_q − F and H_p, and of their derivatives by q and p."""
        system = self.system
        state = {"q": list(system.q), "p": list(system.p), **time_input(system)}
        if not system.forces:
            # H_qp is the transpose of H_pq
            return [Kernel("gradient", "H_q = dH/dq, H_p = dH/dp", state,
                           {"H_q": system.H_q, "H_p": system.H_p}),
                    Kernel("hessian", "H_qq, H_pq = dH_p/dq and H_pp", state,
                           {"H_qq": system.H_qq, "H_pq": system.H_pq, "H_pp": system.H_pp})]
        # −ṗ at λ = 0 takes the place of H_q, so that stage loops need no second kernel
        return [Kernel("gradient", "H_q = dH/dq - F, H_p = dH/dp", state,
                       {"H_q": system.minus_p_rate, "H_p": system.H_p}),
                Kernel("hessian", "H_qq and H_qp, derivatives of H_q = dH/dq - F, and those of H_p",
                       state, {"H_qq": system.minus_p_rate_by_q, "H_qp": system.minus_p_rate_by_p,
                               "H_pq": system.H_pq, "H_pp": system.H_pp})]

    def _curvature_kernels(self) -> list[Kernel]:
        """Return the kernel of K = d(Gᵀλ)/dq, if there are constraints."""
        system, lam = self.system, vector("lambda", self.system.m)
        if not system.m:
            return []
        return [Kernel("constraint_curvature", "K = d(G^T lambda)/dq",
                       {"q": list(system.q), "lambda": lam}, {"K": system.curvature(lam)})]


@dataclass(frozen=True)
class MeanScheme:
    """IMS (53) or EMS (61): a step with one mean value of the gradient."""

    system: System
    discrete: bool  # EMS: the discrete gradient; IMS: the gradient at the midpoint
    tableau = None
    unknowns_are_state = True

    @property
    def size(self) -> int:
        """Number of unknowns: q_k, p_k, λ."""
        return 2 * self.system.n + self.system.m

    @property
    def multipliers(self) -> int:
        """One λ for each constraint."""
        return 1 if self.system.m else 0

    @property
    def reactions(self) -> int:
        """0: there are no equations for velocity constraints."""
        return 0

    @cached_property
    def means(self) -> StateSymbols:
        """The symbols of q̄ and p̄."""
        return means_of_states(self.system.n, self.system.n)

    @cached_property
    def differences(self) -> StateSymbols:
        """The symbols of Δq and Δp."""
        return differences_of_states(self.system.n, self.system.n)

    @cached_property
    def mean_gradient(self) -> tuple[list[sp.Expr], list[sp.Expr]]:
        """D_qH and D_pH in terms of means and differences."""
        return mean_gradient_of(self.system, self.means, self.differences, self.discrete)

    @cached_property
    def mean_rates(self) -> tuple[list[sp.Expr], list[sp.Expr]]:
        """D_qH − F(q̄, p̄, t), which is −Δp/Δt without the constraint forces, and D_pH."""
        D_q, D_p = self.mean_gradient
        if not self.system.forces:
            return D_q, D_p
        variables = [*self.system.q, *self.system.p]
        at_mean = dict(zip(variables, [*self.means.q, *self.means.p], strict=True))
        forces = [f.xreplace(at_mean) for f in self.system.forces]
        return [d - f for d, f in zip(D_q, forces, strict=True)], D_p

    @cached_property
    def mean_constraint(self) -> list[list[sp.Expr]]:
        """Ḡ, m × n: discrete for EMS, g_q at the midpoint for IMS."""
        # EMS differs g itself between the ends: g(q₁) − g(q₀) = Ḡ Δq exactly
        if self.discrete:
            return discrete_jacobian(self.system, self.means.q, self.differences.q)
        at_mean = dict(zip(self.system.q, self.means.q, strict=True))
        return [[e.xreplace(at_mean) for e in row] for row in self.system.G]

    @cached_property
    def mean_energy_rate(self) -> sp.Expr:
        """D_tH: discrete for EMS, H_t at the midpoint for IMS."""
        return mean_slopes_of(self.system, self.means, self.differences, self.discrete)[-1]

    @cached_property
    def mean_constraint_rate(self) -> list[sp.Expr]:
        """ḡ_t, m entries: discrete for EMS, g_t at the midpoint for IMS."""
        if self.discrete:
            slopes = discrete_slopes(self.system, self.means.q, self.differences.q)
            return [row[-1] for row in slopes]
        at_mean = dict(zip(self.system.q, self.means.q, strict=True))
        return [e.xreplace(at_mean) for e in self.system.g_t]

    @cached_property
    def order(self) -> int:
        """2 if the gradient is consistent and symmetric, 1 if only consistent, else 0.

        Symmetric methods have even order; D differs from the mean of the gradient by O(Δ²).
        """
        # D at Δ = 0 must be the gradient, and Δ → −Δ must exchange the ends
        if is_refuted(*self._consistency):
            return 0
        return 1 if is_refuted(*self._symmetry) else 2

    def consistency(self) -> IdentityCheck:
        """Whether D = (H_q, H_p) for Δ = 0, and with explicit time also D_t = (H_t, g_t)."""
        return compare(*self._consistency)

    def symmetry(self) -> IdentityCheck:
        """Whether D is invariant under exchange of the end points, Δ → −Δ."""
        return compare(*self._symmetry)

    @property
    def _consistency(self) -> tuple[list[sp.Expr], list[sp.Expr]]:
        """D at Δ = 0, and (H_q, H_p; with time H_t, g_t) at the means, in the order of ``_D``.

        They are equal if the scheme is consistent.
        """
        system = self.system
        at_mean = dict(zip([*system.q, *system.p], [*self.means.q, *self.means.p], strict=True))
        gradient = substitute([*system.H_q, *system.H_p, *self._rates_of_time], at_mean)
        return substitute(self._D, self._no_step), gradient

    @property
    def _symmetry(self) -> tuple[list[sp.Expr], list[sp.Expr], list[sp.Symbol]]:
        """D, D with the ends exchanged, and the symbols of Δ."""
        return self._D, substitute(self._D, self._backwards), self._differences

    @property
    def _no_step(self) -> dict[sp.Symbol, sp.Expr]:
        """Substitution for Δ = 0."""
        return dict.fromkeys(self._differences, sp.Integer(0))

    @property
    def _backwards(self) -> dict[sp.Symbol, sp.Expr]:
        """Substitution Δ → −Δ, which exchanges the ends."""
        return {x: -x for x in self._differences}

    @property
    def _rates_of_time(self) -> list[sp.Expr]:
        """H_t and g_t of a system with explicit time, else nothing."""
        return [self.system.H_t, *self.system.g_t] if self.system.is_time_dependent else []

    @property
    def _D(self) -> list[sp.Expr]:
        """Return the mean gradient (D_q, D_p), and mean time derivatives where H or g have t."""
        gradient = [*self.mean_gradient[0], *self.mean_gradient[1]]
        if not self.system.is_time_dependent:
            return gradient
        return [*gradient, self.mean_energy_rate, *self.mean_constraint_rate]

    @property
    def _differences(self) -> list[sp.Symbol]:
        """The symbols of Δq and Δp, and of Δt where H or g depends on time."""
        time_step = [TIME_STEP] if self.system.is_time_dependent else []
        return [*self.differences.q, *self.differences.p, *time_step]

    def kernels(self) -> list[Kernel]:
        """Return the mean gradient and its derivatives by Δq and Δp."""
        system = self.system
        inputs = {"qm": self.means.q, "pm": self.means.p,
                  "dq": self.differences.q, "dp": self.differences.p}
        inputs |= time_input(system)
        D_q, D_p = self.mean_rates
        kind = "gradient at the midpoint"
        if self.discrete:
            kind = "discrete gradient: H(q1,p1) - H(q0,p0) = D_q.dq + D_p.dp exactly"
        minus_forces = "; from D_q, F(qm, pm, t) is subtracted" if system.forces else ""
        (qm, pm), (dq, dp) = self.means, self.differences
        derivatives = {"D_qq": by_increment(D_q, qm, dq), "D_qp": by_increment(D_q, pm, dp),
                       "D_pq": by_increment(D_p, qm, dq), "D_pp": by_increment(D_p, pm, dp)}
        return [
            Kernel("mean_gradient", f"D_q, D_p: {kind}{minus_forces}", inputs,
                   {"D_q": D_q, "D_p": D_p}),
            Kernel("mean_jacobian", "derivatives of D_q and D_p by dq and dp", inputs, derivatives),
            *self._constraint_kernels(), *self.energy_rate_kernels(),
            *self.constraint_rate_kernels()]

    def _constraint_kernels(self) -> list[Kernel]:
        """Return the kernels of the constraints: G between the ends, and its derivative."""
        if not self.system.m:
            return []
        lam = vector("lambda", self.system.m)
        force = transposed_product(self.mean_constraint, lam)
        inputs = {"qm": self.means.q, "dq": self.differences.q}
        return [
            Kernel("mean_constraint", "G between q0 and q1", inputs, {"G": self.mean_constraint}),
            Kernel("mean_curvature", "K = d(G^T lambda)/d(dq)", inputs | {"lambda": lam},
                   {"K": by_increment(force, self.means.q, self.differences.q)}),
        ]

    def energy_rate_kernels(self) -> list[Kernel]:
        """Return the kernel of D_tH between the ends, if H or g depends on time."""
        if not self.system.is_time_dependent:
            return []
        (qm, pm), (dq, dp) = self.means, self.differences
        return [Kernel("mean_energy_rate", "D_t: mean of dH/dt between the ends",
                       {"qm": qm, "pm": pm, "dq": dq, "dp": dp}, {"D_t": self.mean_energy_rate})]

    def constraint_rate_kernels(self) -> list[Kernel]:
        """Return the kernel of g_t between the ends, if H or g depends on time."""
        if not (self.system.is_time_dependent and self.system.m):
            return []
        return [Kernel("mean_constraint_rate", "g_t between q0 and q1",
                       {"qm": self.means.q, "dq": self.differences.q},
                       {"g_t": self.mean_constraint_rate})]


def energy_rate_kernels(system: System) -> list[Kernel]:
    """Return the kernel of ∂H/∂t, if H or g depends on time."""
    if not system.is_time_dependent:
        return []
    return [Kernel("energy_rate", "H_t, the power of what drives H",
                   {"q": list(system.q), "p": list(system.p)}, {"H_t": system.H_t})]


def constraint_rate_kernels(system: System) -> list[Kernel]:
    """Return the kernel of g_t, if H or g depends on time."""
    if not (system.is_time_dependent and system.m):
        return []
    return [Kernel("constraint_rate", "g_t, how fast the constraints move",
                   {"q": list(system.q)}, {"g_t": system.g_t})]


def velocity_kernels(system: System) -> list[Kernel]:
    """Return the kernels of velocity constraints A v + a = 0, as functions of q and of v = H_p.

    They are A, K = (Aᵀ μ)_q, and the defects (g_q v + g_t, A v + a) with their derivatives by q.
    """
    if not system.velocity_count:
        return []
    q, v, mu = list(system.q), list(system.velocities), vector("mu", system.velocity_count)
    # T1 also solves g_q v + g_t = 0 at the end of the step, so that the rows of g come first
    defects = [sp.Add(offset, *(a * b for a, b in zip(row, v, strict=True)))
               for row, offset in zip([*system.G, *system.A], [*system.g_t, *system.a],
                                      strict=True)]
    force = [sp.Add(*(x * row[i] for x, row in zip(mu, system.A, strict=True)))
             for i in range(system.n)]
    return [
        Kernel("velocity_rows", "A of the velocity constraints A v + a = 0", {"q": q},
               {"A": system.A}),
        Kernel("reaction_curvature", "K = d(A^T mu)/dq", {"q": q, "mu": mu},
               {"K": jacobian(force, system.q)}),
        Kernel("velocity_defect", "g_q v + g_t and A v + a", {"q": q, "v": v}, {"f": defects}),
        Kernel("velocity_defect_by_q", "D = d(g_q v + g_t)/dq and d(A v + a)/dq", {"q": q, "v": v},
               {"D": jacobian(defects, system.q)}),
    ]


def with_work_of_time(system: System) -> System:
    """Return the system with F = 0 if it has no forces, but work to be accumulated.

    Work is done by an H or g that depends on time, and by velocity constraints with a ≠ 0.
    """
    if system.forces or not (system.is_time_dependent or any(system.a)):
        return system
    return replace(system, forces=(sp.Integer(0),) * system.n)


def hoist_constants(system: System) -> tuple[System, Constants]:
    """Return the system with constants of the run for subexpressions of parameters alone.

    The second value has their definitions. In the first, ``parameters`` are these constants.
    """
    time = () if system.time is None else (system.time,)
    # t = t0 + τ with τ small: constants of the run contain t0, and kernels τ, so that no digit is
    # lost at a late time
    clock = {system.time: "_t", TIME_STEP: "_dt"} if system.is_time_dependent else {}
    constants = Constants(system.parameters, (*system.q, *system.p, *system.velocities, *time),
                          clock, system.inputs, system.time)
    defining = {name: constants.since_start(e) for name, e in system.defining.items()}
    g = tuple(map(constants.since_start, system.constraints))
    velocity_constraints = tuple(map(constants.since_start, system.velocity_constraints))
    forces = tuple(map(constants.since_start, system.forces))
    symbols = tuple(constants.definitions.values())
    reduced: System = replace(system, parameters=symbols, constraints=g, forces=forces,
                              velocity_constraints=velocity_constraints, quantities={}, **defining)
    return reduced, constants
