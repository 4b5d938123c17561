"""An expression seen from both ends of a step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import sympy as sp

from .sharing import share

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
    known_change : Expr, optional
        u₁ − u₀ where it has a shorter form than the sum over i.
    """

    mean: sp.Expr
    slope: dict[int, sp.Expr]
    steps: Sequence[sp.Symbol]
    known_change: sp.Expr | None = None

    @cached_property
    def change(self) -> sp.Expr:
        """u₁ − u₀."""
        if self.known_change is not None:
            return self.known_change
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

    def shared(self) -> Difference:
        """Return u with mean and change as shared parts: a function uses them more than once."""
        return Difference(share(self.mean), self.slope, self.steps, share(self.change))

    def apply(self, mean: sp.Expr, factor: sp.Expr) -> Difference:
        """Return what ``become`` returns, as parts that are computed once."""
        factor = share(factor)
        made = self.become(share(mean), factor)
        return Difference(made.mean, made.slope, self.steps, share(factor * self.change))

    def plus(self, *others: Difference) -> Difference:
        """Return the difference of the sum of all: in one go, as SymPy sorts every sum it makes."""
        terms: dict[int, list[sp.Expr]] = {}
        for part in (self, *others):
            for i, d in part.slope.items():
                terms.setdefault(i, []).append(d)
        return Difference(sp.Add(self.mean, *(other.mean for other in others)),
                          {i: sp.Add(*slopes) for i, slopes in terms.items()}, self.steps)

    def __add__(self, other: Difference) -> Difference:
        return self.plus(other)

    def __mul__(self, other: Difference) -> Difference:
        """Return the difference of uv: Δ(uv) = ū Δv + v̄ Δu, mean ū v̄ + ¼ Δu Δv."""
        total = other.become(sp.Integer(0), self.mean) + self.become(sp.Integer(0), other.mean)
        mean = self.mean * other.mean
        if self.slope and other.slope:
            mean += self.change * other.change / 4
        return Difference(mean, total.slope, self.steps)
