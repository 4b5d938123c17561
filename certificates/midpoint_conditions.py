"""Conditions of IMS and EMS: proved as polynomial or rational identities, or tested at points."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from ..generator.schemes.lagrangian_midpoint import LagrangianEMS
from ..generator.schemes.step_equations import MeanScheme
from ..generator.schemes.system_differences import with_time
from ..generator.symbolic.identities import IdentityCheck, compare
from ..generator.symbolic.shared_subexpressions import substitute
from ..generator.tableaux.conditions import Condition

__all__ = ["check_mean_scheme"]


def check_mean_scheme(scheme: MeanScheme) -> list[Condition]:
    """Return consistency, symmetry and order; for EMS also the exact energy and constraint laws.

    ``found`` says how each was found: "proved", or "seen" at random points (``identities``).
    """
    lines = [
        _condition("consistent", "D(q, p, 0, 0) = (H_q, H_p)", scheme.consistency()),
        _condition("symmetric", "D unchanged by exchange of the end points", scheme.symmetry()),
    ]
    # a consistent method is of order 1, and the order of a symmetric one is even
    order = 2 * lines[1].holds if lines[0].holds else 0
    lines.append(Condition("order", "consistent and symmetric: 2", str(order), holds=order == 2,
                           residual=str(order - 2), required=True))
    if scheme.discrete:
        lines += [_energy(scheme), _constraint(scheme)]
    return lines


def _energy(scheme: MeanScheme) -> Condition:
    """Return the condition that the slopes D of a discrete gradient are exact for H over a step.

    ΔH = D_q·Δq + D_p·Δp, with D_t Δt if H depends on time. The step then gives ΔH = F·Δq − λᵀΔg,
    and Δg = 0: energy is conserved up to the work of the forces.
    """
    time_dependent = scheme.system.is_time_dependent
    law = "H_k − H_(k−1) = D_q·Δq + D_p·Δp" + " + D_t Δt" * time_dependent
    if isinstance(scheme, LagrangianEMS):  # its H has no formula in q and p
        return _condition("energy", law, scheme.balance())
    variables = with_time(
        [*scheme.system.q, *scheme.system.p], [*scheme.means.q, *scheme.means.p],
        [*scheme.differences.q, *scheme.differences.p], scheme.system.clock)
    slope = [*scheme.mean_gradient[0], *scheme.mean_gradient[1],
             *([scheme.mean_energy_rate] if time_dependent else [])]
    return _condition("energy", law, _increments([scheme.system.H], [slope], *variables))


def _constraint(scheme: MeanScheme) -> Condition:
    """Return the condition that Ḡ is exact: constraint forces then do no work between the ends.

    Δg = Ḡ·Δq for each constraint, with ḡ_t Δt if g depends on time.
    """
    system, slopes = scheme.system, scheme.mean_constraint
    if system.is_time_dependent:
        slopes = [[*row, rate] for row, rate in
                  zip(slopes, scheme.mean_constraint_rate, strict=True)]
    return _condition(
        "constraint work", "g_k − g_(k−1) = Ḡ·Δq" + " + ḡ_t Δt" * system.is_time_dependent,
        _increments(system.constraints, slopes, *with_time(
            system.q, scheme.means.q, scheme.differences.q,
            system.clock)))


def _increments(
    expressions: Sequence[sp.Expr], slopes: Sequence[Sequence[sp.Expr]],
    variables: Sequence[sp.Symbol], means: Sequence[sp.Symbol], differences: Sequence[sp.Symbol]
) -> IdentityCheck:
    """Compare e(end) − e(start) with slope·difference for each expression e and its ``slopes``.

    End and start are the means ± half the differences of the variables.
    """
    start, end = (
        substitute(expressions, {x: m + sign * d / 2 for x, m, d
                                 in zip(variables, means, differences, strict=True)})
        for sign in (-1, 1)
    )
    work = [sp.Add(*(a * d for a, d in zip(slope, differences, strict=True))) for slope in slopes]
    return compare([b - a for a, b in zip(start, end, strict=True)], work, differences)


def _condition(name: str, equation: str, finding: IdentityCheck) -> Condition:
    """Return a required condition with the result of the comparison of its two sides."""
    return Condition(name, equation, finding.how, finding.holds, finding.residual, required=True)
