"""Coordinates of parameters in which each step of a fit stays physical.

Positive parameters move by their logarithms. Three principal moments of a body are
I_i = Σ_{j≠i} d_j², and the six entries of an inverse tensor are those of J⁻¹ with

    J = tr(Σ) 1 − Σ,   Σ = L Lᵀ,

where d and the lower triangle of L move: every such J obeys the triangle inequalities (Wensing,
Kim, Slotine, IEEE Robot. Autom. Lett. 3, 2018). All other parameters move as they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...core.arrays import Array
from ...core.records import dataclass
from ..compilation.body_columns import bodies_of

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["Coordinates"]

#: Largest step, in units.
_LARGEST = 0.7
#: Least principal values of Σ, as shares of tr(J): of any Σ, against round-off, and of that of a
#: first guess, because no step leads away from 0.
_FLOOR, _INSIDE = 1e-12, 1e-2


class _BodyParameters(NamedTuple):
    """Values of a body's parameters, and their derivatives by the entries of its factor L."""

    values: list[float]
    by_factor: Array  # shape (names, entries)


@dataclass(frozen=True)
class Inertia:
    """The inertia of one body, three principal moments or six entries of an inverse tensor."""

    names: list[str]

    @property
    def entries(self) -> tuple[Array, ...]:
        """Rows and columns of the entries of L that move."""
        return np.diag_indices(3) if len(self.names) == 3 else np.tril_indices(3)

    def factor(self, parameters: Mapping[str, float], least_share: float = _FLOOR) -> Array:
        """Return L with LLᵀ = Σ = tr(J)/2 − J; eigenvalues of Σ are at least a share of tr(J)."""
        inertia_entries = [parameters[name] for name in self.names]
        if len(inertia_entries) == 3:
            J = np.diag(inertia_entries)
        else:
            K = np.zeros((3, 3))
            K[np.triu_indices(3)] = inertia_entries
            J = np.linalg.inv(K + np.triu(K, 1).T)  # K is symmetric
        # a J of no body has a negative second moment: it is raised to the least share
        second_moments, axes = np.linalg.eigh(np.trace(J) / 2 * np.eye(3) - J)
        lowest = least_share * abs(float(np.trace(J)))
        if second_moments[0] < lowest:
            second_moments = np.maximum(second_moments, lowest)
        L: Array = np.linalg.cholesky((axes * second_moments) @ axes.T)
        return L

    def parameters_of(self, L: Array) -> _BodyParameters:
        """Return the parameters of J(LLᵀ), and their derivatives by the moving entries of L.

        dJ = tr(dΣ) 1 − dΣ with dΣ = dL Lᵀ + L dLᵀ, and dK = −K dJ K for K = J⁻¹. Shape (names,
        entries).
        """
        def inertia_of(sigma: Array) -> Array:
            """Return J = tr(Σ) 1 − Σ, linear in Σ."""
            inertia: Array = np.trace(sigma) * np.eye(3) - sigma
            return inertia

        J = inertia_of(L @ L.T)
        J_by_L = []
        for i, j in zip(*self.entries, strict=True):
            # dL has one entry 1
            unit = np.zeros((3, 3))
            unit[i, j] = 1.0
            J_by_L.append(inertia_of(unit @ L.T + L @ unit.T))
        if len(self.names) == 3:
            return _BodyParameters(np.diag(J).tolist(),
                                   np.array([np.diag(dJ) for dJ in J_by_L]).T)
        K, upper = np.linalg.inv(J), np.triu_indices(3)
        return _BodyParameters(K[upper].tolist(),
                               np.array([-(K @ dJ @ K)[upper] for dJ in J_by_L]).T)


class Coordinates:
    """Coordinates y of the free parameters, with y = 0 at the current parameters."""

    def __init__(self, step: Stepper, free_names: Sequence[str],
                 first_values: Mapping[str, float]) -> None:
        """Take the free parameters and their first values; inertias that are free move as a whole.
        """
        self._first = {name: float(first_values[name]) for name in free_names}
        self.free = list(free_names)
        self._bodies = [Inertia(body.inertia) for body in bodies_of(step.manifest).values()
                        if {*body.inertia} <= {*free_names}]
        inertia_names = {name for body in self._bodies for name in body.names}
        domains = step.parameter_domains
        #: Whether each free parameter is above 0; its relative changes are those of its logarithm.
        self.positive = np.array([domains.get(name) == "positive" for name in free_names],
                                 dtype=bool)
        #: Index and name of the parameters that move by themselves, and whether each is positive.
        self._single = [(i, name, bool(self.positive[i])) for i, name in enumerate(free_names)
                        if name not in inertia_names]

    def inside(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """Return parameters with physical inertias: J moved until Σ is positive definite."""
        moved_parameters = dict(parameters)
        for body in self._bodies:
            L = body.factor(parameters)
            # bodies that are well inside keep the bits of their parameters
            inner_factor = body.factor(parameters, least_share=_INSIDE)
            if not np.array_equal(L, inner_factor):
                moved_parameters.update(zip(body.names, body.parameters_of(inner_factor).values,
                                            strict=True))
        return moved_parameters

    def jacobian(self, parameters: Mapping[str, float]) -> Array:
        """Return ∂θ/∂y of the free parameters at y = 0, square.

        Columns: the entries of L of each body in turn, then the other parameters, ∂θ/∂y = θ of a
        positive one, whose logarithm moves, and 1 of others.
        """
        jacobian = np.zeros((len(self.free), len(self.free)))
        column = 0
        for body in self._bodies:
            indices = [self.free.index(name) for name in body.names]
            size = len(indices)
            block = body.parameters_of(body.factor(parameters)).by_factor
            jacobian[indices, column : column + size] = block
            column += size
        for i, name, positive in self._single:
            jacobian[i, column] = parameters[name] if positive else 1.0
            column += 1
        return jacobian

    def apply_step(self, parameters: Mapping[str, float], y: Array) -> dict[str, float]:
        """Return the parameters θ after a step y, shape (unknowns,), in the coordinates of the fit.

        The columns of y are those of ``jacobian``: the entries of the factor L of each body's Σ = L
        Lᵀ become L + y, a positive parameter θ e^y, others θ + y.
        """
        moved_parameters, column = dict(parameters), 0
        for body in self._bodies:
            L = body.factor(parameters)
            size = len(body.names)
            L[body.entries] += y[column : column + size]
            moved_parameters.update(zip(body.names, body.parameters_of(L).values, strict=True))
            column += size
        for _, name, positive in self._single:
            moved_parameters[name] = parameters[name] * float(np.exp(y[column])) if positive else (
                parameters[name] + float(y[column]))
            column += 1
        return moved_parameters

    def excess(self, parameters: Mapping[str, float], y: Array) -> float:
        """Return the length of y as a multiple of the longest step allowed; above 1 it is too long.
        """
        return float(np.abs(y / self.units(parameters)).max(initial=0.0)) / _LARGEST

    def units(self, parameters: Mapping[str, float]) -> Array:
        """Return the unit of each y, a large change.

        It is the largest entry of L for an inertia, 1 for a logarithm, and the size of any other
        parameter, infinite for one that began at 0.
        """
        units: list[float] = []
        for body in self._bodies:
            units += [float(np.abs(body.factor(parameters)).max())] * len(body.names)
        units += [1.0 if positive else self._size(name, parameters)
                  for _, name, positive in self._single]
        return np.array(units)

    def scales(self, parameters: Mapping[str, float]) -> Array:
        """Return the unit of each free parameter, a large change of it, as ``units`` for y."""
        return np.array([self._size(name, parameters) for name in self.free])

    def _size(self, name: str, parameters: Mapping[str, float]) -> float:
        """Return the unit of changes of a parameter x: |x|, or its first |x| if that is larger.

        For a positive parameter it is |x|. It is infinite for one that began at 0 and may have
        either sign, which has no scale of its own.
        """
        first = abs(self._first[name])
        if self.positive[self.free.index(name)]:
            return abs(parameters[name])
        return max(abs(parameters[name]), first) if first else np.inf
