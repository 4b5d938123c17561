"""What IMS and EMS satisfy, proved as polynomial or rational identities."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from .conditions import Condition
from .schemes import MeanScheme

__all__ = ["check_mean_scheme"]


def check_mean_scheme(scheme: MeanScheme) -> list[Condition]:
    """Return consistency, symmetry and order; for EMS also the exact energy and constraint laws."""
    order = scheme.order
    lines = [
        Condition("consistent", "D(q, p, 0, 0) = (H_q, H_p)", "yes" if order else "no",
                  order >= 1, "0" if order else "not 0", required=True),
        Condition("symmetric", "D unchanged by exchange of the end points",
                  "yes" if order == 2 else "no", order == 2, "0" if order == 2 else "not 0",
                  required=True),
        Condition("order", "consistent and symmetric: 2", str(order), order == 2,
                  str(order - 2) if order != 2 else "0", required=True),
    ]
    if scheme.discrete:
        lines += [_energy(scheme), _constraint(scheme)]
    return lines


def _energy(scheme: MeanScheme) -> Condition:
    """ΔH = D_qH·Δq + D_pH·Δp: energy is kept exactly, the multiplier's work is λΔg = 0 (60)."""
    variables = [*scheme.system.q, *scheme.system.p]
    means = [*scheme.means[0], *scheme.means[1]]
    differences = [*scheme.differences[0], *scheme.differences[1]]
    slope = [*scheme.mean_gradient[0], *scheme.mean_gradient[1]]
    residual = increment_residual(scheme.system.H, slope, variables, means, differences)
    return _identity("energy", "H_k − H_(k−1) = D_q·Δq + D_p·Δp", residual)


def _constraint(scheme: MeanScheme) -> Condition:
    residual = sp.Add(*(
        sp.Abs(increment_residual(g, row, scheme.system.q, scheme.means[0], scheme.differences[0]))
        for g, row in zip(scheme.system.constraints, scheme.mean_constraint, strict=True)
    ))
    return _identity("constraint work", "g_k − g_(k−1) = Ḡ·Δq", residual)


def increment_residual(
    e: sp.Expr,
    slope: Sequence[sp.Expr],
    variables: Sequence[sp.Symbol],
    means: Sequence[sp.Symbol],
    differences: Sequence[sp.Symbol],
) -> sp.Expr:
    """Return e(end) − e(start) − slope·difference, zero for a discrete gradient."""
    ends = [
        e.xreplace({x: m + sign * d / 2
                    for x, m, d in zip(variables, means, differences, strict=True)})
        for sign in (1, -1)
    ]
    work = sum((a * d for a, d in zip(slope, differences, strict=True)), sp.Integer(0))
    residual = sp.expand(ends[0] - ends[1] - work)
    return residual if residual == 0 else sp.simplify(residual)


def _identity(name: str, equation: str, residual: sp.Expr) -> Condition:
    holds = residual == 0
    return Condition(name, equation, "proved" if holds else "refuted", holds,
                     "0" if holds else str(residual)[:60], required=True)
