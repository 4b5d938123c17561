"""Discrete differentiation: a difference quotient that satisfies the chain rule exactly.

For end points x₀, x₁ with mean x̄ and difference Δx, every expression u carries

    mean(u) = (u₁ + u₀)/2      and      Du with  u₁ − u₀ = Σ_i (D_i u) Δx_i   exactly,

both written in x̄ and Δx. The rules below are identities of u₁ − u₀, not limits, so
ΔH = D_qH·Δq + D_pH·Δp holds to round-off, also for Δx → 0, with no 0/0 and no branch. All are
even in Δx: the gradient is symmetric under exchange of the end points, hence of even order.

    sum        Δ(u + v) = Δu + Δv
    product    Δ(uv)    = ū Δv + v̄ Δu,              mean(uv) = ū v̄ + ¼ Δu Δv
    power      Δ(uⁿ)    = (Σ_k u₁ᵏ u₀ⁿ⁻¹⁻ᵏ) Δu
    reciprocal Δ(1/u)   = −Δu/(u₀u₁),               mean(1/u) = ū/(u₀u₁)
    root       Δ(√u)    = Δu/(√u₁ + √u₀)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

import sympy as sp

from ..errors import InputError

__all__ = ["Difference", "discrete_gradient"]


@dataclass(frozen=True)
class Difference:
    """An expression seen from both ends of a step: its mean and its difference quotient."""

    mean: sp.Expr
    slope: dict[int, sp.Expr]  # i → D_i u; entries that vanish identically are absent

    def delta(self, dx: Sequence[sp.Symbol]) -> sp.Expr:
        """Return u₁ − u₀ = Σ_i D_i u Δx_i."""
        return sum((d * dx[i] for i, d in self.slope.items()), sp.Integer(0))

    def scaled(self, factor: sp.Expr) -> dict[int, sp.Expr]:
        """Return factor · Du."""
        return {i: factor * d for i, d in self.slope.items()}


def discrete_gradient(
    expression: sp.Expr,
    symbols: Sequence[sp.Symbol],
    means: Sequence[sp.Symbol],
    differences: Sequence[sp.Symbol],
) -> list[sp.Expr]:
    """Return D_i of the expression for each symbol, in terms of means and differences.

    Parameters
    ----------
    expression : Expr
        Built from the symbols, parameters, +, ×, integer and half-integer powers.
    symbols, means, differences : sequences of Symbol
        x, and the names to use for x̄ and Δx.

    Raises
    ------
    InputError
        If the expression contains a function without a known exact difference.
    """
    leaves = {
        symbol: Difference(mean, {i: sp.Integer(1)})
        for i, (symbol, mean) in enumerate(zip(symbols, means, strict=True))
    }
    slope = differentiate(expression, leaves, differences).slope
    return [slope.get(i, sp.Integer(0)) for i in range(len(symbols))]


def differentiate(
    u: sp.Expr, leaves: Mapping[sp.Symbol, Difference], dx: Sequence[sp.Symbol]
) -> Difference:
    """Return mean and slope of u by recursion over its expression tree."""
    if u in leaves:
        return leaves[u]
    if not u.free_symbols & leaves.keys():
        return Difference(u, {})
    parts = [differentiate(argument, leaves, dx) for argument in u.args]
    if u.is_Add:
        return reduce(_sum, parts)
    if u.is_Mul:
        return reduce(lambda a, b: _product(a, b, dx), parts)
    if u.is_Pow and not u.exp.free_symbols and (2 * u.exp).is_Integer:
        return _power(parts[0], u.exp, dx)
    raise InputError(
        f"No exact difference is known for {u.func.__name__!r} in {u}; the discrete gradient "
        "takes sums, products, quotients, integer powers and square roots."
    )


def _sum(u: Difference, v: Difference) -> Difference:
    slope = dict(u.slope)
    for i, d in v.slope.items():
        slope[i] = slope[i] + d if i in slope else d
    return Difference(u.mean + v.mean, slope)


def _product(u: Difference, v: Difference, dx: Sequence[sp.Symbol]) -> Difference:
    slope = _sum(Difference(sp.Integer(0), v.scaled(u.mean)),
                 Difference(sp.Integer(0), u.scaled(v.mean))).slope
    if not u.slope or not v.slope:
        return Difference(u.mean * v.mean, slope)
    return Difference(u.mean * v.mean + u.delta(dx) * v.delta(dx) / 4, slope)


def _power(u: Difference, exponent: sp.Rational, dx: Sequence[sp.Symbol]) -> Difference:
    """Return the difference of u^exponent for integer and half-integer exponents."""
    if exponent.q == 2:
        return _power(_root(u, dx), sp.Integer(exponent.p), dx)
    if exponent < 0:
        return _reciprocal(_power(u, -exponent, dx), dx)
    if exponent == 1:
        return u
    if exponent == 2:  # mean(u²) = ū² + ¼Δu², Δ(u²) = 2ūΔu: the general rule, shorter
        return Difference(u.mean**2 + u.delta(dx) ** 2 / 4, u.scaled(2 * u.mean))
    u0, u1 = _ends(u, dx)
    n = int(exponent)
    quotient = sum((u1**k * u0 ** (n - 1 - k) for k in range(n)), sp.Integer(0))
    return Difference((u1**n + u0**n) / 2, u.scaled(quotient))


def _reciprocal(u: Difference, dx: Sequence[sp.Symbol]) -> Difference:
    product = u.mean**2 - u.delta(dx) ** 2 / 4  # u₀u₁
    return Difference(u.mean / product, u.scaled(-1 / product))


def _root(u: Difference, dx: Sequence[sp.Symbol]) -> Difference:
    u0, u1 = _ends(u, dx)
    total = sp.sqrt(u1) + sp.sqrt(u0)
    return Difference(total / 2, u.scaled(1 / total))


def _ends(u: Difference, dx: Sequence[sp.Symbol]) -> tuple[sp.Expr, sp.Expr]:
    """Return u₀ and u₁ from mean and difference."""
    half = u.delta(dx) / 2
    return u.mean - half, u.mean + half
