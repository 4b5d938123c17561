"""IMS and EMS of a system from its Lagrangian, with exact differences of H for EMS.

At the ends i = 0, 1 of a step M_i v_i = p_i − b_i, and H_i = ½ v_iᵀM_i v_i + V_i. As an identity in
v₀, v₁, M₀ and M₁, with v̄ = (v₀ + v₁)/2,

    ½ v₁ᵀM₁v₁ − ½ v₀ᵀM₀v₀ = v̄ᵀ(M₁v₁ − M₀v₀) − ½ v₀ᵀ(M₁ − M₀)v₁

so that, with the discrete derivative D of Λ by q and t at fixed v₀ and v₁ (``discrete_gradient``),

    ΔH = D_pH·Δp + D_qH·Δq + D_tH Δt,   D_pH = v̄,   D_qH = −D_qΛ,   D_tH = −D_tΛ
    Λ(q, t) = ½ v₀ᵀM v₁ + bᵀv̄ − V

For v₀ = v₁, Λ = L and D = (−L_q, v, −L_t). D is symmetric under exchange of the ends.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import sympy as sp

from ...core.records import dataclass
from ..kernels.statements import Kernel
from ..symbolic.derivatives import along
from ..symbolic.identities import IdentityCheck, compare
from ..symbolic.shared_subexpressions import substitute
from ..systems.lagrangian import LagrangianSystem
from ..systems.system import System
from .discrete_gradient import discrete_gradient
from .lagrangian_kernels import motion_kernels, newton_kernels
from .step_equations import MeanScheme
from .system_differences import TIME_STEP, time_input, vector, with_time

__all__ = ["LagrangianEMS", "LagrangianIMS", "mean_scheme"]


def mean_scheme(system: System, *, discrete: bool) -> MeanScheme:
    """Return IMS or EMS of a system from its H or from its Lagrangian."""
    if isinstance(system, LagrangianSystem):
        return (LagrangianEMS if discrete else LagrangianIMS)(system, discrete)
    return MeanScheme(system, discrete)


@dataclass(frozen=True)
class LagrangianIMS(MeanScheme):
    """IMS of a Lagrangian: L_q at the midpoint and the velocity of the midpoint."""

    system: LagrangianSystem

    def kernels(self) -> list[Kernel]:
        """Return the kernels of L_q + F, of their derivatives, and of the constraints."""
        return [*self.motion_kernels(), *self.newton_kernels(), *self._constraint_kernels(),
                *self.constraint_rate_kernels()]

    def motion_kernels(self) -> list[Kernel]:
        """Return the generalised force and ∂H/∂t, for both solvers."""
        return motion_kernels(self.system)

    def newton_kernels(self) -> list[Kernel]:
        """Return the derivatives of the generalised force along a direction."""
        return newton_kernels(self.system)


@dataclass(frozen=True)
class LagrangianEMS(LagrangianIMS):
    """EMS of a Lagrangian, in terms of the velocities of both ends."""

    @cached_property
    def ends(self) -> tuple[list[sp.Symbol], list[sp.Symbol]]:
        """The symbols of v₀ and v₁."""
        return vector("before", self.system.n), vector("after", self.system.n)

    @cached_property
    def mean_velocity(self) -> list[sp.Expr]:
        """v̄."""
        return [(a + b) / 2 for a, b in zip(*self.ends, strict=True)]

    @cached_property
    def discrete_lagrangian(self) -> sp.Expr:
        """Λ(q, t) = ½ v₀ᵀ M v₁ + b·v̄ − V at fixed velocities of the ends of a step.

        M of a long L is longer still: then Λ = L(v̄) − L(δ) + b·δ − V with δ = (v₁ − v₀)/2, since
        v₀ᵀ M v₁ = v̄ᵀ M v̄ − δᵀ M δ.
        """
        system, (v0, v1) = self.system, self.ends
        if system.is_long:
            delta = [(b - a) / 2 for a, b in zip(v0, v1, strict=True)]
            L_mean, L_delta = (
                substitute([system.L], dict(zip(system.velocities, v, strict=True)))[0]
                for v in (self.mean_velocity, delta))
            b_delta = (b * v for b, v in zip(system.rest_momenta, delta, strict=True))
            return sp.Add(L_mean, -L_delta, *b_delta, -system.potential)
        # ``mass`` has one entry of each pair of equal ones: ½ M_ij (v₀_i v₁_j + v₀_j v₁_i), and
        # ½ M_ii v₀_i v₁_i on the diagonal, half the same sum
        entries = zip(system.mass, system._at_rest([*system.mass.values()]), strict=True)
        bilinear = (e * (v0[i] * v1[j] + v0[j] * v1[i]) / (2 if i != j else 4)
                    for (i, j), e in entries)
        linear = (b * v for b, v in zip(system.rest_momenta, self.mean_velocity, strict=True))
        return sp.Add(*bilinear, *linear, -system.potential)

    @cached_property
    def _slopes(self) -> list[sp.Expr]:
        """DΛ by q and, with explicit time, by t."""
        return discrete_gradient(self.discrete_lagrangian, *with_time(
            self.system.q, self.means.q, self.differences.q, self.system.clock))

    @cached_property
    def mean_gradient(self) -> tuple[list[sp.Expr], list[sp.Expr]]:
        """D_qH and D_pH in terms of q̄, Δq, v₀ and v₁."""
        return [-e for e in self._slopes[: self.system.n]], self.mean_velocity

    @cached_property
    def mean_generalised_force(self) -> list[sp.Expr]:
        """D_qΛ + F(q̄, v̄, t), n entries: Δp/Δt without the constraint forces."""
        slopes = self._slopes[: self.system.n]
        if not self.system.forces:
            return slopes
        at_mean = dict(zip([*self.system.q, *self.system.velocities],
                           [*self.means.q, *self.mean_velocity], strict=True))
        forces = substitute(self.system.forces, at_mean)
        return [d + f for d, f in zip(slopes, forces, strict=True)]

    @cached_property
    def mean_energy_rate(self) -> sp.Expr:
        """D_tH."""
        return -self._slopes[-1]

    @property
    def _no_step(self) -> dict[sp.Symbol, sp.Expr]:
        """Substitution for Δ = 0, where v₀ = v₁ = v."""
        velocities = self.system.velocities
        return super()._no_step | {x: v for side in self.ends
                                   for x, v in zip(side, velocities, strict=True)}

    @property
    def _backwards(self) -> dict[sp.Symbol, sp.Expr]:
        """Substitution Δ → −Δ, v₀ ↔ v₁, which exchanges the ends."""
        v0, v1 = self.ends
        return super()._backwards | dict(zip([*v0, *v1], [*v1, *v0], strict=True))

    def balance(self) -> IdentityCheck:
        """Whether ΔH = D_pH·Δp + D_qH·Δq + D_tH Δt, for all v₀ and v₁.

        H = p·v − L and p = L_v at both ends.
        """
        system = self.system
        symbols, means, steps = with_time(system.q, self.means.q, self.differences.q,
                                          system.clock)
        momenta, energies = [], []
        # q and t at the ends are q̄ ∓ Δq/2 and t̄ ∓ Δt/2
        for v, sign in zip(self.ends, (-1, 1), strict=True):
            at_end = {x: mean + sign * step / 2
                      for x, mean, step in zip(symbols, means, steps, strict=True)}
            at_end |= dict(zip(system.velocities, v, strict=True))
            *p, L = substitute([*system.L_v, system.L], at_end)
            momenta.append(p)
            energies.append(sp.Add(-L, *(a * b for a, b in zip(p, v, strict=True))))
        momentum_terms = (v * (p1 - p0)
                          for v, p0, p1 in zip(self.mean_velocity, *momenta, strict=True))
        coordinate_terms = (-slope * step for slope, step in zip(self._slopes, steps, strict=True))
        small = self.differences.q + [TIME_STEP] * system.is_time_dependent
        return compare([energies[1] - energies[0]], [sp.Add(*momentum_terms, *coordinate_terms)],
                       small)

    # ------------------------------------------------------------ kernels

    def motion_kernels(self) -> list[Kernel]:
        """Return D_qΛ + F, and D_tH, at the velocities of both ends."""
        arguments = self._arguments
        plus_forces = " + F at the means" if self.system.forces else ""
        kernels = [Kernel("mean_generalised_force", f"R = D_q(v0^T M v1/2 + b.v - V){plus_forces}",
                          arguments | time_input(self.system), {"R": self.mean_generalised_force})]
        if self.system.is_time_dependent:
            kernels.append(Kernel("mean_energy_rate_of_velocities",
                                  "D_t: mean of dH/dt between the ends", arguments,
                                  {"D_t": self.mean_energy_rate}))
        return self._as_long(kernels)

    def newton_kernels(self) -> list[Kernel]:
        """Return d(L_q) at one end, and dR of the mean force R, along (wq, wv) of q₁ and v₁.

        q̄ moves by wq/2, Δq by wq.
        """
        n = self.system.n
        wq, wv = vector("wq", n), vector("wv", n)
        variables = [*self.means.q, *self.differences.q, *self.ends[1]]
        change = along(self.mean_generalised_force, variables, [*(x / 2 for x in wq), *wq, *wv])
        at_one_end = [k for k in newton_kernels(self.system) if k.name == "force_derivative"]
        return [*at_one_end, *self._as_long([
            Kernel("mean_generalised_force_derivative", "dR as q1 and v1 move along (wq, wv)",
                   self._arguments | time_input(self.system) | {"wq": wq, "wv": wv},
                   {"dR": change})])]

    @property
    def _arguments(self) -> dict[str, list[Any]]:
        """The inputs of kernels between two states: q̄, Δq, v₀ and v₁."""
        v0, v1 = self.ends
        return {"qm": self.means.q, "dq": self.differences.q, "v0": v0, "v1": v1}

    def _as_long(self, kernels: list[Kernel]) -> list[Kernel]:
        """Return the kernels of a long L without a search for common factors, which takes long."""
        return [replace(k, factors=not self.system.is_long) for k in kernels]
