"""A system with its numbers, before anything is compiled: g, g_q, H_p in NumPy.

g_q is Im g(q + iε e_k)/ε, exact to round-off: a way that shares nothing with the derived formulas.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from ..errors import InputError
from .derivatives import derivative
from .evaluation import evaluate
from .system import System

__all__ = ["NumericSystem"]

Array = NDArray[Any]
TINY = 1e-100  # ε of the complex step: its square vanishes beside 1


class NumericSystem:
    """g, g_q and H_p of a system at given parameters; states are float arrays, shape (n,)."""

    def __init__(self, system: System, parameters: Mapping[str, float]) -> None:
        self.system = system
        self.constraint_names = system.constraint_names
        self.coordinates = [str(x) for x in system.q]
        self.momenta = [str(x) for x in system.p]
        self._parameters = {s: _value(system, s, parameters) for s in system.parameters}

    def g(self, q: Array) -> Array:
        """Return g(q), shape (m,)."""
        return evaluate(self.system.constraints, self._at(q))

    def G(self, q: Array) -> Array:
        """Return g_q, shape (m, n)."""
        directions = q[:, None] + 1j * TINY * np.eye(len(q))
        slopes: Array = evaluate(self.system.constraints, self._at(directions)).imag / TINY
        return slopes

    def H(self, q: Array, p: Array) -> float:
        """Return H(q, p)."""
        return float(evaluate([self.system.H], self._at(q, p))[0])

    def H_p(self, q: Array, p: Array) -> Array:
        """Return the velocity, shape (n,)."""
        return evaluate(self._velocity, self._at(q, p))

    def H_pp_times(self, q: Array, p: Array, directions: Array) -> Array:
        """Return H_pp dᵀ for rows d, shape (n, number of rows)."""
        if not len(directions):
            return np.zeros((len(p), 0))
        at = self._at(q[:, None], p[:, None] + 1j * TINY * directions.T)
        slopes: Array = evaluate(self._velocity, at).imag / TINY
        return slopes

    @cached_property
    def _velocity(self) -> list[sp.Expr]:
        """H_p, term by term: a term is differentiated by the momenta it contains only."""
        by_momentum: dict[sp.Symbol, list[sp.Expr]] = {x: [] for x in self.system.p}
        for term in sp.Add.make_args(self.system.H):
            for x in term.free_symbols & by_momentum.keys():
                by_momentum[x].append(derivative(term, x))
        return [sp.Add(*terms) for terms in by_momentum.values()]

    def _at(self, q: Array, p: Array | None = None) -> dict[sp.Symbol, Any]:
        values = dict(zip(self.system.q, q, strict=True)) | self._parameters
        return values if p is None else values | dict(zip(self.system.p, p, strict=True))


def _value(system: System, symbol: sp.Symbol, parameters: Mapping[str, float]) -> float:
    if str(symbol) not in parameters:
        raise InputError(f"Parameter {str(symbol)!r} of system {system.name!r} has no value; "
                         "give one.")
    return float(parameters[str(symbol)])
