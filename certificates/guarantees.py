"""Guaranteed properties of a scheme on a model, derived in exact algebra, not listed.

A property is guaranteed, not guaranteed, or refuted. Refuted: an exact condition fails, even if no
run shows it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import sympy as sp

from ..generator.schemes.named_schemes import scheme_named
from ..generator.schemes.step_equations import MeanScheme
from ..generator.schemes.system_differences import with_time
from ..generator.splitting.decomposition import split
from ..generator.splitting.parts import Splitting
from ..generator.symbolic.derivatives import derivative
from ..generator.symbolic.finite_fields import identically_zero
from ..generator.symbolic.identities import compare
from ..generator.symbolic.shared_subexpressions import substitute
from ..generator.systems.system import System
from ..generator.systems.time_scale import ScaledSystem
from ..generator.tableaux.conditions import (
    Condition,
    check_tableau,
    energy_conditions,
    invariant_conditions,
)
from ..generator.tableaux.families import gauss_lobatto
from ..generator.tableaux.stability import Stability, stability
from ..generator.tableaux.tableau import Tableau
from .momentum_maps import MomentumMap
from .splitting_proofs import is_invariant

__all__ = ["Guarantee", "Guarantees", "MeanGuarantees", "SparkGuarantees", "SplittingGuarantees"]

Numbers = Mapping[sp.Symbol, sp.Rational]


@dataclass(frozen=True)
class Guarantee:
    """Whether a property is guaranteed, the reason, and the exact condition that refutes it."""

    guaranteed: bool
    why: str
    refuted: str = ""


def make_guarantee(why: str, refuted: str = "") -> Guarantee:
    """Return the guarantee of a property; an exact condition that fails refutes it."""
    return Guarantee(guaranteed=True, why=why, refuted=refuted)


def no_guarantee(why: str) -> Guarantee:
    """Return no guarantee, and why there is none: the property may hold all the same."""
    return Guarantee(guaranteed=False, why=why)


_WORK_ON_LOOPS = no_guarantee("the forces are no gradient in q and may do work on the loop")


class Guarantees(Protocol):
    """Properties of a scheme on a system that a certificate needs."""

    @property
    def symmetric(self) -> bool:
        """Whether step(−h) undoes step(h)."""

    @property
    def discrete(self) -> bool:
        """Whether the step uses a discrete gradient."""

    @property
    def stability(self) -> Stability | None:
        """Stability function; None if q and p have different methods."""

    def loop(self) -> Guarantee:
        """Return whether the map is symplectic: ∮p·dq is invariant."""

    def energy(self) -> Guarantee:
        """Return whether H minus the work of the forces is conserved."""

    def momentum_constraint(self) -> Guarantee:
        """Return whether f(q, p) = g_q H_p = 0 holds after each step: H is then the energy of the
        motion, H(q, Pp) with p projected along g_qᵀ onto f = 0."""

    def momentum(self, J: MomentumMap) -> Guarantee:
        """Return whether a momentum map is conserved."""


def forces_are_gradient(system: System, parameters: Numbers) -> bool:
    """Whether F = −∇V(q, t): F_p = 0 and F_q is symmetric, identically and in exact algebra."""
    forces = substitute(system.forces, parameters)
    q, p = system.q, system.p
    # a list is a sum of terms that must be 0; derivatives that are 0 at sight are left out
    by_momentum = [[derivative(f, x)] for f in forces for x in p if f.has(x)]
    curl = [[derivative(forces[i], q[j]), -derivative(forces[j], q[i])]
            for i in range(len(forces)) for j in range(i)
            if forces[i].has(q[j]) or forces[j].has(q[i])]
    return bool(identically_zero([*by_momentum, *curl]))


def is_quadratic(e: sp.Expr, symbols: Sequence[sp.Symbol], parameters: Numbers) -> bool:
    """Whether an expression is a polynomial of degree 2 at most: its third differences vanish."""
    steps = [sp.Dummy(real=True) for _ in symbols]
    # f(x + 3d) − 3 f(x + 2d) + 3 f(x + d) − f(x) = 0 for all x and d
    shifted = [substitute([e], {x: x + k * d for x, d in zip(symbols, steps, strict=True)})[0]
               for k in range(4)]
    terms = [factor * x for factor, x in zip((-1, 3, -3, 1), substitute(shifted, parameters),
                                             strict=True)]
    return bool(identically_zero([terms]))


def _not_exact(J: MomentumMap) -> Guarantee:
    """Return the guarantee of a map whose bracket with H is not identically zero."""
    if J.on_constraints:
        return no_guarantee("{J, H} = 0 on the constraints only, as far as random points show: "
                            "the motion keeps it, stages do not; write V for any q")
    return no_guarantee(f"{{J, H}} is not 0 but up to {J.symmetry_defect:.1e} of its terms: a near "
                        "symmetry, J drifts as far as that allows")


def _domain(J: MomentumMap) -> str:
    """Return the end of a sentence on J: nothing, or " at these parameters" if J needs them."""
    return "" if J.any_parameters else " at these parameters"


# ---------------------------------------------------------------- SPARK


@dataclass(frozen=True)
class SparkGuarantees:
    """Guaranteed properties of a SPARK method.

    With b_i â_ij + b̂_j a_ji = b_i b̂_j, b_i ã_ij + b̃_j ā_ji = b_i b̃_j and b = b̂ it is symplectic,
    and keeps every J bilinear in q and p: summed over a step,

        J_(k+1) − J_k = Δt Σ_i b_i {J, H}(Q_i, P_i) − Δt Σ_j b̃_j Λ_jᵀ g_q(Q̃_j) X(Q̃_j),

    where {J, H} = 0 everywhere and g_q X = 0 on g(Q̃_j) = 0. A J without q needs none of them.

    Reactions −AᵀM_i of velocity constraints add −Δt Σ_i b_i M_iᵀ A(Q_i) X(Q_i) to it. With them no
    flow is symplectic, and the energy of a step has an error of the order of the method; symmetry
    keeps it near on motions that a reversal maps to themselves (Modin, Verdier 2020).
    """

    system: System
    numbers: Numbers
    tableau: Tableau
    #: Whether free numbers of the tableau, chosen in each step, make the energy exact.
    exact_energy: bool = False

    @cached_property
    def violation(self) -> str:
        """The first symplecticity condition that the tableau violates; empty if none is."""
        irrelevant = "" if self.system.m else "symplectic, constraints"
        conditions = [line for line in check_tableau(self.tableau)
                      if line.name.startswith("symplectic") and line.name != irrelevant]
        equal_weights, *_ = invariant_conditions(self.tableau)
        return _first_violation([*conditions, equal_weights])

    @property
    def is_declared_nonsymplectic(self) -> bool:
        """Whether the tableau is declared not symplectic."""
        return self.tableau.claims.get("symplectic") == 0

    @property
    def discrete(self) -> bool:
        """False: stages use the gradients of H and g themselves, at their points."""
        return False

    @property
    def symmetric(self) -> bool:
        """Whether the tableau is symmetric, so that step(−h) undoes step(h); never with θ, which
        the way back would choose differently."""
        return not self.exact_energy and any(line.name == "symmetric" and line.found == "yes"
                                             for line in check_tableau(self.tableau))

    @property
    def stability(self) -> Stability | None:
        """R(z) = 1 + z bᵀ(1 − zA)⁻¹ 1 of the tableau; None where Â ≠ A or b̂ ≠ b."""
        return stability(self.tableau)

    def loop(self) -> Guarantee:
        """Return whether the map is symplectic: with the conditions of the class, a fixed tableau
        and forces F = −∇V(q, t)."""
        if self.system.velocity_count:
            return no_guarantee("the motion itself is not symplectic with velocity constraints")
        if self.exact_energy:
            return no_guarantee("the tableau is symplectic for every θ, but θ depends on the "
                                "state")
        if not forces_are_gradient(self.system, self.numbers):
            return _WORK_ON_LOOPS
        if self.is_declared_nonsymplectic:
            return no_guarantee("; ".join(filter(None, (
                "the tableau says that it is not symplectic", self.violation))))
        return make_guarantee(f"b_i â_ij + b̂_j a_ji = b_i b̂_j, b_i ã_ij + b̃_j ā_ji = b_i b̃_j"
                              f"{self._digits}", self.violation)

    def energy(self) -> Guarantee:
        """Return whether the energy is exact: for a quadratic H and a method that conserves
        quadratic invariants, or by a θ of the tableau that each step solves for."""
        if self.exact_energy:
            return make_guarantee("θ with H(q₁, p₁) = H₀ + W in each step", self._broken_energy)
        system = self.system
        proved = self.tableau.order if system.m else self.tableau.free_order
        order = f"an error of order {proved} in Δt"
        state = [*system.q, *system.p]
        if system.velocity_count:
            return no_guarantee(f"{order}; {self._reversal}")
        if system.m or system.is_time_dependent or not is_quadratic(system.H, state, self.numbers):
            return no_guarantee(order)
        violation = _first_violation(invariant_conditions(self.tableau))
        if violation:
            return no_guarantee(f"{order}: H is quadratic, but {violation}")
        return make_guarantee("H is quadratic, b_i a_ij + b_j a_ji = b_i b_j for A and Â together "
                              f"and each by itself{self._digits}")

    @cached_property
    def _reversal(self) -> str:
        """The reason why the energy stays near, or may drift, with velocity constraints."""
        system = self.system
        if not self.symmetric:
            return "the tableau is not symmetric, it may drift"
        # p → −p reverses the motion if H and F are even in p and the rates a of constraints are 0
        reversed_momenta = {x: -x for x in system.p}
        functions = (system.H, *system.forces)
        even = [[f, -f_reversed] for f, f_reversed in zip(
            functions, substitute(functions, reversed_momenta), strict=True)]
        odd = [[a] for a in system.a]
        if system.is_nonautonomous or not identically_zero(
                [substitute(terms, self.numbers) for terms in (*even, *odd)]):
            return "the system is not reversible under p → −p, it may drift"
        return ("the system is reversible under p → −p: near on a motion that this maps to itself, "
                "others may drift")

    def momentum_constraint(self) -> Guarantee:
        """Return the guarantee of f = g_q H_p = 0: the last equations of a step, T2, project p
        along g_qᵀ with a multiplier Λ_p of their own."""
        return make_guarantee("T2 projects p in every step")

    def momentum(self, J: MomentumMap) -> Guarantee:
        """Return whether J = pᵀ(A q + a) is conserved.

        {J, H} = 0 is needed for every q and p. Reactions of velocity constraints A_v q̇ + a_v = 0
        change J at the rate −μᵀ A_v X, X = J_p = A q + a, which has to be 0. With A = 0, J is
        linear in p and then conserved by every tableau; otherwise J is bilinear in q and p, and is
        conserved by the tableaux that are symplectic.
        """
        if not J.everywhere:
            return _not_exact(J)
        why = f"{{J, H}} = 0{_domain(J)} ({J.proof})"
        X = [derivative(J.J, x) for x in self.system.p]
        for name, row in zip(self.system.velocity_constraint_names, self.system.A, strict=True):
            reaction_rate = [a * x for a, x in zip(row, X, strict=True)]  # of J, for μ = −1
            if not identically_zero([substitute(
                    reaction_rate, {} if J.any_parameters else self.numbers)]):
                return no_guarantee(f"{why}, but the reaction of {name} changes it: A X is not "
                                    "0")
        if not J.A.any():
            return make_guarantee(f"{why}, and J is linear in p alone")
        # the tableau itself says that it is not symplectic: a violation refutes nothing
        if self.is_declared_nonsymplectic and self.violation:
            return no_guarantee(f"{why}; {self.violation}")
        return make_guarantee(f"{why}{self._digits}", self.violation or self._broken_energy)

    @property
    def _broken_energy(self) -> str:
        """The first condition that the tableau violates for some θ; empty if none is."""
        return _first_violation([line for line in energy_conditions(self.tableau)
                                 if not line.holds]) if self.exact_energy else ""

    @property
    def _digits(self) -> str:
        """The end of a sentence on a tableau that is given in decimals; empty for an exact one."""
        digits = self.tableau.decimal_digits
        return "" if digits is None else f", to the {digits} digits of the tableau"


def _first_violation(lines: Sequence[Condition]) -> str:
    """Return the equation of the first condition that fails, and by how much; empty if none does.
    """
    return next((f"{line.equation} is off by {line.residual}" for line in lines
                 if line.found != "yes"), "")


# ---------------------------------------------------------------- IMS and EMS


@dataclass(frozen=True)
class MeanGuarantees:
    """Guaranteed properties of IMS and EMS: (Δq, Δp) = Δt (D_p, −D_q + F − Ḡᵀλ), each an identity
    in D.

    H stays if D_q·Δq + D_p·Δp = ΔH and Ḡ·Δq = Δg, which EMS's D is made for; IMS's is for quadratic
    H and g. J stays if p̄ᵀA D_p = (A q̄ + a)·(D_q − F) and Ḡ (A q̄ + a) = 0. Without constraints the
    map is symplectic if D is the gradient at the midpoint: IMS's is, EMS's for quadratic H.
    """

    system: System
    numbers: Numbers
    name: str
    #: As the generator derived it: 2 where D is symmetric in the end points.
    order: int

    @cached_property
    def scheme(self) -> MeanScheme:
        """The scheme with its D and Ḡ."""
        return MeanScheme(self.system, scheme_named(self.name).discrete)

    @property
    def discrete(self) -> bool:
        """Whether D is the discrete gradient."""
        return self.scheme.discrete

    @property
    def symmetric(self) -> bool:
        """Whether D is symmetric in the end points: order 2 follows from it."""
        return self.order == 2

    @property
    def stability(self) -> Stability | None:
        """R(z) of the midpoint rule, which is one Gauss stage: forces are taken at (q̄, p̄), so that
        p' = λp is integrated by it."""
        return stability(gauss_lobatto(1))

    def loop(self) -> Guarantee:
        """Return whether the map is symplectic: only without constraints, and if D is the gradient
        of H at the midpoint."""
        if self.system.m:
            return no_guarantee(f"{self.name} does not project p: with constraints it "
                                "guarantees no ∮p·dq")
        if not forces_are_gradient(self.system, self.numbers):
            return _WORK_ON_LOOPS
        if not self.scheme.discrete:
            return make_guarantee("the implicit midpoint rule")
        if not self._is_midpoint:
            return no_guarantee(f"{self.name}'s D is not the gradient at the midpoint: it "
                                "guarantees no ∮p·dq")
        return make_guarantee("D is the gradient at the midpoint: H is quadratic")

    def energy(self) -> Guarantee:
        """Return whether H is exact: if ΔH = D_q·Δq + D_p·Δp and Δg = Ḡ·Δq.

        The step then gives ΔH = F·Δq − λᵀΔg, and Δg = 0. EMS is made for these equations: it is
        refuted if they fail. IMS has them for quadratic H and g. In scaled time H + e stays if the
        work F·Δq is the change of −e, too.
        """
        if self.system.forces and isinstance(self.system, ScaledSystem) and not self._power_proof:
            return no_guarantee(f"an error of order {self.order} in Δτ: e changes by F·H_p at the "
                                "midpoint, and q moves along D_pH, which is another vector")
        proof = self._energy_proof
        if self.scheme.discrete:
            time_dependent = self.system.is_time_dependent
            law = "ΔH = Δp·D_pH + Δq·D_qH" + " + Δt D_tH" * time_dependent
            return make_guarantee(f"{law}, Δg = Ḡ·Δq{' + Δt ḡ_t' * time_dependent} ({proof})",
                                  "" if proof else f"{law} is refuted")
        if proof:
            return make_guarantee(f"H and g are quadratic: ΔH = Δp·H_p + Δq·H_q at the midpoint "
                                  f"({proof})")
        return no_guarantee(f"an error of order {self.order} in Δt: H or g is not quadratic")

    def momentum_constraint(self) -> Guarantee:
        """Return whether the constraint f(q, p) = 0 on the momenta is kept, up to its sign.

        Δg = Ḡ Δq = Δt Ḡ D_p by the discrete gradients Ḡ of g and D_p of H, so steps that keep g
        have Ḡ D_p = 0. f_(k+1) = −f_k follows where each row of Ḡ D_p is a multiple of
        f_k + f_(k+1): the row vanishes identically once a momentum is eliminated by
        f_k + f_(k+1) = 0. An f that is not linear in p has no guarantee.
        """
        scheme, system = self.scheme, self.system
        no_projection = no_guarantee(f"{self.name} has no projection of p")
        if system.is_time_dependent:
            return no_projection
        (q, p), (dq, dp) = scheme.means, scheme.differences
        _, D_p = scheme.mean_gradient
        # f at the ends q̄ ± Δq/2, p̄ ± Δp/2
        end, start = (
            substitute(system.hidden, {x: m + sign * d / 2 for x, m, d in zip(
                [*system.q, *system.p], [*q, *p], [*dq, *dp], strict=True)})
            for sign in (1, -1))
        for row, f_end, f_start in zip(scheme.mean_constraint, end, start, strict=True):
            total = f_end + f_start
            slopes = {x: derivative(total, x) for x in p if total.has(x)}
            if not slopes or any(slope.has(*p, *dp) for slope in slopes.values()):
                return no_projection  # not linear in p
            # x − total/slope is the momentum x that makes f_k + f_(k+1) = 0
            x, slope = next(iter(slopes.items()))
            terms = substitute([a * b for a, b in zip(row, D_p, strict=True)],
                               {x: x - total / slope})
            proof = self._vanish([terms])
            if not proof:
                return no_projection
        return make_guarantee(f"Ḡ D_p = 0 makes f_(k+1) = −f_k ({proof})")

    def momentum(self, J: MomentumMap) -> Guarantee:
        """Return whether J = pᵀ(A q + a) is conserved, from the difference of J over a step.

        ΔJ/Δt = p̄ᵀA D_p − (A q̄ + a)·(D_q − F) − λᵀ Ḡ (A q̄ + a) at the means q̄ and p̄: the first two
        terms must cancel, and the last be 0 off the constraints, too.
        """
        if not J.everywhere:
            return _not_exact(J)
        why = f"{{J, H}} = 0{_domain(J)}"
        # a list of terms for each sum that must vanish
        X, p_A = self._field(J)
        D_q, D_p = self.scheme.mean_rates
        rate = [*(a * b for a, b in zip(p_A, D_p, strict=True)),
                *(-a * b for a, b in zip(X, D_q, strict=True))]
        constraint_rates = [[a * b for a, b in zip(row, X, strict=True)]
                            for row in self.scheme.mean_constraint]
        if not self._vanish(constraint_rates, J):
            return no_guarantee(f"{why}; g_q X = 0 is not seen off the constraints, where the "
                                "midpoints are")
        proof = self._vanish([rate], J)
        if not proof:
            return no_guarantee(f"{why}; D is not seen to turn as the gradient does")
        return make_guarantee(f"p̄ᵀA D_p = (A q̄ + a)·D_q and Ḡ (A q̄ + a) = 0{_domain(J)} ({proof})")

    # ------------------------------------------------------------ identities

    @cached_property
    def _is_midpoint(self) -> bool:
        """Whether EMS's D and Ḡ are the gradients at the midpoint."""
        midpoint = MeanScheme(self.system, discrete=False)
        pairs = zip(_slopes(self.scheme), _slopes(midpoint), strict=True)
        return bool(self._vanish([[a, -b] for a, b in pairs]))

    @cached_property
    def _energy_proof(self) -> str:
        """The kind of proof of ΔH = D_q·Δq + D_p·Δp and Δg = Ḡ·Δq; "" if they do not hold.

        Of time-dependent systems ΔH has the term D_t Δt, too, and Δg the term ḡ_t Δt.
        """
        scheme, system = self.scheme, self.system
        (q, p), (dq, dp) = scheme.means, scheme.differences
        # rows of D and Ḡ, in Δq, Δp and, of time-dependent systems, Δt
        slopes = [[*scheme.mean_gradient[0], *scheme.mean_gradient[1]],
                  *([*row, *[sp.Integer(0)] * system.n] for row in scheme.mean_constraint)]
        if system.is_time_dependent:
            rates = [scheme.mean_energy_rate, *scheme.mean_constraint_rate]
            slopes = [[*slope, rate] for slope, rate in zip(slopes, rates, strict=True)]
        variables, means, differences = with_time(
            [*system.q, *system.p], [*q, *p], [*dq, *dp], system.clock)
        # H and g at the ends of the step, mean ± half the difference
        end, start = (
            substitute([system.H, *system.constraints],
                       {x: m + sign * d / 2 for x, m, d
                        in zip(variables, means, differences, strict=True)})
            for sign in (1, -1))
        works = [[a * d for a, d in zip(slope, differences, strict=True)] for slope in slopes]
        # identities of the expressions first; then, of discrete gradients, comparison at random
        # points where algebra does not decide
        proof = self._vanish([[b, -a, *(-w for w in work)]
                              for a, b, work in zip(start, end, works, strict=True)])
        if proof or not self.scheme.discrete:
            return proof
        comparison = compare([b - a for a, b in zip(start, end, strict=True)],
                             [sp.Add(*work) for work in works], differences, thorough=False)
        return comparison.how if comparison.holds else ""

    @cached_property
    def _power_proof(self) -> str:
        """The kind of proof of F·D_p = 0, F the forces (σ F, −σ F·H_p) of scaled time; else ""."""
        system, scheme = self.system, self.scheme
        q, p = scheme.means
        at_mean = dict(zip([*system.q, *system.p], [*q, *p], strict=True))
        forces = substitute(system.forces, at_mean)
        powers = [F * v for F, v in zip(forces, scheme.mean_gradient[1], strict=True)]
        proof = self._vanish([powers])
        if proof or not self.scheme.discrete:
            return proof
        comparison = compare([powers[-1]], [-sp.Add(*powers[:-1])],
                             [*scheme.differences.q, *scheme.differences.p], thorough=False)
        return comparison.how if comparison.holds else ""

    def _field(self, J: MomentumMap) -> tuple[list[sp.Expr], list[sp.Expr]]:
        """Return X = J_p = A q̄ + a and J_q = p̄ᵀA at the means q̄ and p̄, n expressions each."""
        system, (q, p) = self.system, self.scheme.means
        at_mean = dict(zip([*system.q, *system.p], [*q, *p], strict=True))
        X = [derivative(J.J, x) for x in system.p]
        p_A = [derivative(J.J, x) for x in system.q]
        return substitute(X, at_mean), substitute(p_A, at_mean)

    def _vanish(self, sums: Sequence[Sequence[sp.Expr]], J: MomentumMap | None = None) -> str:
        """Return the proof that sums vanish at these parameters, or at any that J holds for."""
        parameters = {} if J is not None and J.any_parameters else self.numbers
        return identically_zero([substitute(terms, parameters) for terms in sums])


def _slopes(scheme: MeanScheme) -> list[sp.Expr]:
    """Return the entries of D_q, D_p and Ḡ in one list."""
    return [*scheme.mean_gradient[0], *scheme.mean_gradient[1],
            *(e for row in scheme.mean_constraint for e in row)]


# ---------------------------------------------------------------- splitting


@dataclass(frozen=True)
class SplittingGuarantees:
    """Guaranteed properties of a composition of exact flows.

    The flow of a Hamiltonian part is symplectic and conserves every J with {J, part} = 0; a
    palindrome of flows is its own inverse with −h. Drag and forces without potential are no
    Hamiltonian parts.
    """

    system: System
    numbers: Numbers
    order: int

    @cached_property
    def splitting(self) -> Splitting:
        """The parts of H; bodies that are symmetric at these parameters have fewer."""
        symmetric_splitting = split(self.system, symmetric=True)
        conditions_hold = all(c.xreplace(dict(self.numbers)) == 0
                              for c in symmetric_splitting.conditions)
        return symmetric_splitting if conditions_hold else split(self.system)

    @property
    def discrete(self) -> bool:
        """False: flows are exact, and no difference quotient takes the place of a gradient."""
        return False

    @property
    def symmetric(self) -> bool:
        """Whether the step is a palindrome of exact flows: kicks by forces that depend on momenta
        are none."""
        return not self.splitting.other_forces

    @property
    def stability(self) -> Stability | None:
        """None: a flow is exact, p' = λp is integrated without an error."""
        return None

    def loop(self) -> Guarantee:
        """Return whether the map is symplectic: if forces have a potential, each flow has a
        Hamiltonian."""
        if not forces_are_gradient(self.system, self.numbers):
            return _WORK_ON_LOOPS
        return make_guarantee("each flow is that of a part of H, proved")

    def energy(self) -> Guarantee:
        """Return whether H is exact: only if it has one part; the flow of a part keeps this part,
        not H."""
        V = self.splitting.V.xreplace(dict(self.numbers))
        if not self.system.forces and self.splitting.is_exact and V.free_symbols.isdisjoint(
                self.system.q):
            return make_guarantee("H has one part, whose flow is exact")
        return no_guarantee(f"an error of order {self.order} in Δt: parts do not keep H")

    def momentum_constraint(self) -> Guarantee:
        """Return the guarantee of f = 2 qᵀq̇ = 0: p follows from q and the angular momentum m in
        body axes."""
        return make_guarantee("p = 2 L(q)ᵀ m: qᵀp = 0 by L(q) q = 0")

    def momentum(self, J: MomentumMap) -> Guarantee:
        """Return whether J is conserved: its bracket with each part of H must be 0."""
        if not J.everywhere:
            return _not_exact(J)
        if not is_invariant(self.splitting, J.J, {} if J.any_parameters else self.numbers):
            return no_guarantee(f"{{J, H}} = 0{_domain(J)}, but not with each part of H")
        return make_guarantee(f"{{J, ·}} = 0 with each part of H{_domain(J)}")
