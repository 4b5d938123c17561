"""An expression seen from both ends of a step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import sympy as sp

__all__ = ["Difference"]


@dataclass(frozen=True)
class Difference:
    """An expression u by its mean ū = (u₁ + u₀)/2 and its difference quotient.

    Attributes
    ----------
    mean : Expr
        ū.
    slope : dict of int to Expr
        i → D_i u, with u₁ − u₀ = Σ_i D_i u Δx_i; entries that vanish identically are absent.
    steps : sequence of Symbol
        Δx.
    """

    mean: sp.Expr
    slope: dict[int, sp.Expr]
    steps: Sequence[sp.Symbol]

    @cached_property
    def change(self) -> sp.Expr:
        """u₁ − u₀."""
        return sp.Add(*(d * self.steps[i] for i, d in self.slope.items()))

    @cached_property
    def half(self) -> sp.Expr:
        """(u₁ − u₀)/2."""
        return self.change / 2

    @cached_property
    def ends(self) -> tuple[sp.Expr, sp.Expr]:
        """u₀ and u₁."""
        return self.mean - self.half, self.mean + self.half

    def become(self, mean: sp.Expr, factor: sp.Expr) -> Difference:
        """Return the difference of an f(u) with that mean and f(u₁) − f(u₀) = factor·(u₁ − u₀)."""
        return Difference(mean, {i: factor * d for i, d in self.slope.items()}, self.steps)

    def __add__(self, other: Difference) -> Difference:
        slope = dict(self.slope)
        for i, d in other.slope.items():
            slope[i] = slope[i] + d if i in slope else d
        return Difference(self.mean + other.mean, slope, self.steps)

    def __mul__(self, other: Difference) -> Difference:
        """Return the difference of uv: Δ(uv) = ū Δv + v̄ Δu, mean ū v̄ + ¼ Δu Δv."""
        total = other.become(sp.Integer(0), self.mean) + self.become(sp.Integer(0), other.mean)
        mean = self.mean * other.mean
        if self.slope and other.slope:
            mean += self.change * other.change / 4
        return Difference(mean, total.slope, self.steps)
