"""A system in a co-moving frame: H̃ = H − Σ ω_i J_i is what moves it, H what is reported."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import sympy as sp

from .jacobians import gradient, shortest
from .system import System

__all__ = ["MovingSystem", "energy_of"]


@dataclass(frozen=True)
class MovingSystem(System):
    """A system whose H is that of the frame.

    Parameters
    ----------
    energy : Expr
        H itself.
    """

    energy: sp.Expr = field(default=sp.Integer(0), kw_only=True)

    @property
    def defining(self) -> dict[str, sp.Expr]:
        """What defines it beside g and F."""
        return {**super().defining, "energy": self.energy}

    @cached_property
    def hidden(self) -> list[sp.Expr]:
        """The constraint on the momenta, that of H: the same where g = 0."""
        H_p = gradient(self.energy, self.p)
        return [self._without_units(shortest(sum((a * b for a, b in zip(row, H_p, strict=True)),
                                                 sp.Integer(0)))) for row in self.G]


def energy_of(system: System) -> sp.Expr:
    """Return H, also of a system in a frame."""
    return system.energy if isinstance(system, MovingSystem) else system.H
