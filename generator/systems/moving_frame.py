"""Systems whose motion has another Hamiltonian than their energy.

In a co-moving frame H̃ = H − Σ ω_i J_i defines the motion, and H is the reported energy; the other
case is scaled time (``time_scale``).
"""

from __future__ import annotations

from dataclasses import field
from functools import cached_property

import sympy as sp

from ...core.records import dataclass
from .jacobians import gradient, shortest
from .system import System

__all__ = ["CoMovingSystem", "TransformedSystem", "energy_of", "in_sums"]


@dataclass(frozen=True)
class TransformedSystem(System):
    """A system whose H defines its motion, and whose energy is another function.

    Parameters
    ----------
    energy : Expr
        The energy that runs report.
    """

    energy: sp.Expr = field(default=sp.Integer(0), kw_only=True)

    @property
    def defining(self) -> dict[str, sp.Expr]:
        """H, the energy, and the other expressions on which derived C depends, besides g and F."""
        return {**super().defining, "energy": self.energy}

    @property
    def conserved_function(self) -> sp.Expr:
        """The function on g = 0 whose gradient by p is the velocity, up to a factor."""
        return self.energy

    @cached_property
    def hidden(self) -> list[sp.Expr]:
        """The constraint on the momenta, m entries: g_q ∂c/∂p with c = ``conserved_function``.

        On g = 0 it is g_q H̃_p up to a factor; c is shorter than H̃.
        """
        velocity = gradient(self.conserved_function, self.p)
        rates = [sum((a * v for a, v in zip(row, velocity, strict=True)), sp.Integer(0))
                 for row in self.G]
        return [self._without_units(shortest(rate)) for rate in rates]


@dataclass(frozen=True)
class CoMovingSystem(TransformedSystem):
    """A system in a co-moving frame.

    Parameters
    ----------
    frame_velocity : tuple of Expr
        Σ ω_i A_i q, the velocity of the frame, if forces do work on it; else empty.
    """

    frame_velocity: tuple[sp.Expr, ...] = field(default=(), kw_only=True)


def energy_of(system: System) -> sp.Expr:
    """Return the energy, which is H but for transformed systems."""
    return system.energy if isinstance(system, TransformedSystem) else system.H


def in_sums(J: sp.Expr, H: sp.Expr) -> list[sp.Expr]:
    """Return terms whose sum is J: multiples of sums u whose squares H contains, then the rest.

    H̃ = H − ωJ then has u² and u with one temporary u, not with J multiplied out; u_k = 2 l_k, for
    example, in the energy of a rigid body.
    """
    factors = [f for term in sp.Add.make_args(H) for f in sp.Mul.make_args(term)]
    sums = {f.base for f in factors if f.is_Pow and f.exp == 2 and f.base.is_Add}
    coefficients, multiples = sp.expand(J).as_coefficients_dict(), list[sp.Expr]()
    for u in sorted(sums, key=sp.default_sort_key):
        coefficients_of_u = u.as_coefficients_dict()
        # J contains k u if all terms of u stand in J with the same ratio k
        ratios = {coefficients.get(term, 0) / x for term, x in coefficients_of_u.items()}
        if len(ratios) == 1 and 0 not in ratios:
            multiples.append(sp.Mul(*ratios, u, evaluate=False))
            coefficients = {term: x for term, x in coefficients.items()
                            if term not in coefficients_of_u}
    return [*multiples, *(x * term for term, x in coefficients.items())]
