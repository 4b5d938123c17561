"""Exact differences of H and g between two states, with time as one more variable.

g(q + d) − g(q) has no cancellation for small d, and ΔH = D_qH·Δq + D_pH·Δp + D_tH Δt.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import sympy as sp

from ..systems.jacobians import jacobian
from ..systems.system import System
from .discrete_gradient import discrete_gradient

__all__ = ["TIME_STEP", "StateSymbols", "by_increment", "constraint_increment",
           "differences_of_states", "discrete_jacobian", "discrete_slopes", "increment_of",
           "mean_gradient_of", "mean_slopes_of", "means_of_states", "time_input", "vector",
           "with_time"]

#: Δt between the ends of a difference, if H or g depends on time.
TIME_STEP = sp.Symbol("_dt", real=True)


class StateSymbols(NamedTuple):
    """Symbols for two states: the means q̄ and p̄, or the differences Δq and Δp."""

    q: list[sp.Symbol]
    p: list[sp.Symbol]


def means_of_states(q_count: int, p_count: int) -> StateSymbols:
    """Return the symbols of q̄ and p̄."""
    return StateSymbols(vector("qm", q_count), vector("pm", p_count))


def differences_of_states(q_count: int, p_count: int) -> StateSymbols:
    """Return the symbols of Δq and Δp."""
    return StateSymbols(vector("dq", q_count), vector("dp", p_count))


def vector(name: str, count: int) -> list[sp.Symbol]:
    """Return symbols _name0, _name1, …; symbols of systems have no leading underscore."""
    return [sp.Symbol(f"_{name}{i}", real=True) for i in range(count)]


def constraint_increment(system: System, d: list[sp.Symbol]) -> list[sp.Expr]:
    """Return g(q + d) − g(q) = Ḡ(q + d/2, d)·d, exact."""
    return [increment_of(g, system.q, d, system.clock) for g in system.constraints]


def increment_of(
    g: sp.Expr, q: Sequence[sp.Symbol], d: list[sp.Symbol], time: sp.Symbol | None = None
) -> sp.Expr:
    """Return g(q + d) − g(q), exact and without loss of digits for small d.

    With time it is g(q + d, t + Δt/2) − g(q, t − Δt/2).
    """
    means = [x + dx / 2 for x, dx in zip(q, d, strict=True)]
    symbols, means, d = with_time(q, means, d, time)
    slopes = discrete_gradient(g, symbols, means, d)
    return sum((a * dx for a, dx in zip(slopes, d, strict=True)), sp.Integer(0))


def with_time(
    symbols: Sequence[Any], means: Sequence[Any], differences: Sequence[Any],
    time: sp.Symbol | None,
) -> tuple[list[Any], list[Any], list[Any]]:
    """Return symbols, means and differences, each followed by t, t̄ = t and Δt if there is time."""
    if time is None:
        return [*symbols], [*means], [*differences]
    return [*symbols, time], [*means, time], [*differences, TIME_STEP]


def discrete_jacobian(
    system: System, means: list[Any], differences: list[sp.Symbol]
) -> list[list[sp.Expr]]:
    """Return Ḡ, m × n, with g(q₁) − g(q₀) = Ḡ (q₁ − q₀) exactly."""
    return [slopes[: system.n] for slopes in discrete_slopes(system, means, differences)]


def discrete_slopes(
    system: System, means: list[Any], differences: list[sp.Symbol]
) -> list[list[sp.Expr]]:
    """Return Ḡ, with ḡ_t as its last column if H or g depends on time."""
    variables = with_time(system.q, means, differences, system.clock)
    return [discrete_gradient(g, *variables) for g in system.constraints]


def mean_gradient_of(
    system: System, means: StateSymbols, differences: StateSymbols, discrete: bool
) -> tuple[list[sp.Expr], list[sp.Expr]]:
    """Return D_qH and D_pH in terms of means and differences; see ``mean_slopes_of``."""
    D = mean_slopes_of(system, means, differences, discrete)
    n = len(system.q)
    return D[:n], D[n : n + len(system.p)]


def mean_slopes_of(
    system: System, means: StateSymbols, differences: StateSymbols, discrete: bool
) -> list[sp.Expr]:
    """Return D_qH, D_pH and, if H or g depends on time, D_tH, in one list.

    D is the discrete gradient of EMS if ``discrete``, else the gradient at the midpoint.
    """
    variables, all_means = [*system.q, *system.p], [*means.q, *means.p]
    if discrete:
        return discrete_gradient(system.H, *with_time(
            variables, all_means, [*differences.q, *differences.p], system.clock))
    at_mean = dict(zip(variables, all_means, strict=True))
    time = [] if system.clock is None else [system.H_t]
    return [e.xreplace(at_mean) for e in (*system.H_q, *system.H_p, *time)]


def by_increment(
    expressions: Sequence[sp.Expr], means: list[sp.Symbol], differences: list[sp.Symbol]
) -> list[list[sp.Expr]]:
    """Return derivatives by differences at fixed start: ∂/∂Δ + ½ ∂/∂mean.

    There is one row for each expression, and one column for each difference.
    """
    by_means, by_differences = jacobian(expressions, means), jacobian(expressions, differences)
    return [[a / 2 + b for a, b in zip(mean_row, difference_row, strict=True)]
            for mean_row, difference_row in zip(by_means, by_differences, strict=True)]


def time_input(system: System) -> dict[str, list[sp.Symbol]]:
    """Return the input ``t`` of a kernel: the time of forces F(q, p, t), else an unused symbol.

    The engine calls these kernels with t for every system. A system with time in H or g has the
    time among its constants.
    """
    driven = system.time is not None and system.is_nonautonomous and not system.is_time_dependent
    return {"t": [system.time if driven else sp.Symbol("_time", real=True)]}
