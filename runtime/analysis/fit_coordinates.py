"""Coordinates of parameters in which each step of a fit stays physical.

Positive parameters move by their logarithms. Three principal moments of a body are
I_i = Σ_{j≠i} d_j², and the six entries of an inverse tensor are those of J⁻¹ with

    J = tr(Σ) 1 − Σ,   Σ = L Lᵀ,

where d and the lower triangle of L move: every such J obeys the triangle inequalities (Wensing,
Kim, Slotine, IEEE Robot. Autom. Lett. 3, 2018). All other parameters move as they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..compilation.body_columns import bodies_of

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["Coordinates"]

Array = NDArray[Any]

#: Largest step, in units.
_LARGEST = 0.7
#: Least share of tr(J) in the principal values of Σ: of round-off, and of a first guess, for at 0
#: no step leads away.
_FLOOR, _INSIDE = 1e-12, 1e-2


@dataclass(frozen=True)
class Inertia:
    """The inertia of one body, three principal moments or six entries of an inverse tensor."""

    names: list[str]

    @property
    def entries(self) -> tuple[Array, ...]:
        """Rows and columns of the entries of L that move."""
        return np.diag_indices(3) if len(self.names) == 3 else np.tril_indices(3)

    def factor(self, values: Mapping[str, float], least: float = _FLOOR) -> Array:
        """Return L of parameters; principal values of Σ are at least this share of its trace."""
        own = [values[name] for name in self.names]
        if len(own) == 3:
            J = np.diag(own)
        else:
            K = np.zeros((3, 3))
            K[np.triu_indices(3)] = own
            J = np.linalg.inv(K + np.triu(K, 1).T)
        second, axes = np.linalg.eigh(np.trace(J) / 2 * np.eye(3) - J)
        lowest = least * abs(float(np.trace(J)))
        if second[0] < lowest:
            second = np.maximum(second, lowest)
        found: Array = np.linalg.cholesky((axes * second) @ axes.T)
        return found

    def values(self, L: Array) -> tuple[list[float], Array]:
        """Return the parameters of L, and their derivatives by the entries that move."""
        def of(sigma: Array) -> Array:
            found: Array = np.trace(sigma) * np.eye(3) - sigma
            return found

        J = of(L @ L.T)
        changes = []
        for i, j in zip(*self.entries, strict=True):
            unit = np.zeros((3, 3))
            unit[i, j] = 1.0
            changes.append(of(unit @ L.T + L @ unit.T))
        if len(self.names) == 3:
            return np.diag(J).tolist(), np.array([np.diag(dJ) for dJ in changes]).T
        K, upper = np.linalg.inv(J), np.triu_indices(3)
        return K[upper].tolist(), np.array([-(K @ dJ @ K)[upper] for dJ in changes]).T


class Coordinates:
    """Coordinates y of the free parameters, zero at the values where they are asked for."""

    def __init__(self, step: Stepper, free: Sequence[str], first: Mapping[str, float]) -> None:
        self._first = {name: float(first[name]) for name in free}
        self.free = list(free)
        self._bodies = [Inertia(body.inertia) for body in bodies_of(step.manifest).values()
                        if {*body.inertia} <= {*free}]
        taken = {name for body in self._bodies for name in body.names}
        domains = step.parameter_domains
        #: Whether each free parameter is above 0; its relative changes are those of its logarithm.
        self.positive = np.array([domains.get(name) == "positive" for name in free], dtype=bool)
        self._single = [(i, name, bool(self.positive[i])) for i, name in enumerate(free)
                        if name not in taken]

    def inside(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return parameters whose inertias are those of bodies, next to these."""
        found = dict(values)
        for body in self._bodies:
            L = body.factor(values)
            if not np.array_equal(L, inner := body.factor(values, _INSIDE)):
                found.update(zip(body.names, body.values(inner)[0], strict=True))
        return found

    def jacobian(self, values: Mapping[str, float]) -> Array:
        """Return ∂θ/∂y of the free parameters, square."""
        found = np.zeros((len(self.free), len(self.free)))
        at = 0
        for body in self._bodies:
            rows = [self.free.index(name) for name in body.names]
            size = len(rows)
            found[rows, at : at + size] = body.values(body.factor(values))[1]
            at += size
        for i, name, positive in self._single:
            found[i, at] = values[name] if positive else 1.0
            at += 1
        return found

    def moved(self, values: Mapping[str, float], y: Array) -> dict[str, float]:
        """Return the parameters at y from these."""
        found, at = dict(values), 0
        for body in self._bodies:
            L = body.factor(values)
            size = len(body.names)
            L[body.entries] += y[at : at + size]
            found.update(zip(body.names, body.values(L)[0], strict=True))
            at += size
        for _, name, positive in self._single:
            found[name] = values[name] * float(np.exp(y[at])) if positive else (
                values[name] + float(y[at]))
            at += 1
        return found

    def excess(self, values: Mapping[str, float], y: Array) -> float:
        """Return how many times y is longer than a step may be."""
        return float(np.abs(y / self.units(values)).max(initial=0.0)) / _LARGEST

    def units(self, values: Mapping[str, float]) -> Array:
        """Return changes of y that are large; infinite for what was 0 at first."""
        found: list[float] = []
        for body in self._bodies:
            found += [float(np.abs(body.factor(values)).max())] * len(body.names)
        found += [1.0 if positive else self._size(name, values)
                  for _, name, positive in self._single]
        return np.array(found)

    def scales(self, values: Mapping[str, float]) -> Array:
        """Return changes of the parameters themselves that are large, as ``units`` of y."""
        return np.array([self._size(name, values) for name in self.free])

    def _size(self, name: str, values: Mapping[str, float]) -> float:
        first = abs(self._first[name])
        if self.positive[self.free.index(name)]:
            return abs(values[name])
        return max(abs(values[name]), first) if first else np.inf
