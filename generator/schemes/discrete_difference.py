"""An expression seen from both ends of a step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import sympy as sp

from ..symbolic.shared_subexpressions import share

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
    known_ends : tuple of 2 Expr, optional
        u₀ and u₁ where they are known better than ū ∓ ½ Δu: max(x, 0) is 0, not nearly.
    """

    mean: sp.Expr
    slope: dict[int, sp.Expr]
    steps: Sequence[sp.Symbol]
    known_change: sp.Expr | None = None
    known_ends: tuple[sp.Expr, sp.Expr] | None = None

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
        if self.known_ends is not None:
            return self.known_ends
        return self.mean - self.half, self.mean + self.half

    def with_ends(self, start: sp.Expr, end: sp.Expr) -> Difference:
        """Return the same, its ends known."""
        return replace(self, known_ends=(share(start), share(end)))

    def become(self, mean: sp.Expr, factor: sp.Expr) -> Difference:
        """Return the difference of an f(u) with that mean and f(u₁) − f(u₀) = factor·(u₁ − u₀)."""
        return Difference(mean, {i: factor * d for i, d in self.slope.items()}, self.steps)

    def shared(self) -> Difference:
        """Return u with mean and change as shared parts: a function uses them more than once."""
        return Difference(share(self.mean), self.slope, self.steps, share(self.change),
                          self.known_ends)

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
        total = Difference(sp.Add(self.mean, *(other.mean for other in others)),
                           {i: sp.Add(*slopes) for i, slopes in terms.items()}, self.steps)
        if not any(part.known_ends for part in (self, *others)):
            return total
        return total.with_ends(*(sp.Add(*ends) for ends in zip(
            *(part.ends for part in (self, *others)), strict=True)))

    def __add__(self, other: Difference) -> Difference:
        return self.plus(other)

    def __mul__(self, other: Difference) -> Difference:
        """Return the difference of uv: Δ(uv) = ū Δv + v̄ Δu, mean ū v̄ + ¼ Δu Δv."""
        total = other.become(sp.Integer(0), self.mean) + self.become(sp.Integer(0), other.mean)
        mean = self.mean * other.mean
        if self.slope and other.slope:
            mean += self.change * other.change / 4
        product = Difference(mean, total.slope, self.steps)
        if not (self.known_ends or other.known_ends):
            return product
        return product.with_ends(*(a * b for a, b in zip(self.ends, other.ends, strict=True)))
