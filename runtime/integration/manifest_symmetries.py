"""Symmetries of a stepper's co-moving frame, read from its manifest.

    q = e^{ωtA} q̃,   p = e^{−ωtAᵀ} p̃,   H̃ = H − ω J,   J = pᵀA q

Each has a parameter ω, 0 where it is not given. Some are symmetries only where parameters satisfy
conditions, I1 = I2 say; whether they do is decided exactly, with the numbers as they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ...core.arrays import Array
from ...core.errors import InputError
from ...core.exact_numbers import exact
from ...core.manifest import Manifest, SymmetryManifest
from ...core.records import dataclass

__all__ = ["Symmetry", "refuse_asymmetric", "symmetries_of"]

#: A polynomial: coefficient and powers of each term.
Polynomial = Sequence[tuple[Fraction, Mapping[str, int]]]


@dataclass(frozen=True, eq=False, repr=False)
class Symmetry:
    """A linear symmetry of H, g and F, with the parameter that moves a frame along it.

    Attributes
    ----------
    name : str
        Of the parameter, an angular rate in rad/s: ``omega_body``, ``omega_space``, …
    meaning : str
        What J is, e.g. "angular momentum about e3".
    A : ndarray, shape (n, n)
        The generator: q → e^{θA} q, p → e^{−θAᵀ} p.
    J : str
        The momentum map pᵀA q, in the names of coordinates and momenta.
    condition : str
        What parameters must satisfy, e.g. "I1 = I2"; empty where it holds for any.
    group : int
        Symmetries of one group do not commute: three rotations of space, which turn about one axis.
    vanishing : tuple of Polynomial
        The condition as polynomials of parameters that are 0 where it is satisfied.
    """

    name: str
    meaning: str
    A: Array
    J: str
    condition: str
    group: int = 0
    vanishing: tuple[Polynomial, ...] = ()

    @classmethod
    def of(cls, symmetry: SymmetryManifest, n: int) -> Symmetry:
        """Return a symmetry of a manifest as arrays and fractions."""
        A = np.zeros((n, n))
        for i, j, x in symmetry.A:
            A[i, j] = float(Fraction(x))
        A.setflags(write=False)
        vanishing = tuple(tuple((Fraction(x), dict(powers)) for x, powers in terms)
                          for terms in symmetry.vanishing)
        return cls(symmetry.name, symmetry.meaning, A, symmetry.J,
                   " and ".join(symmetry.conditions), symmetry.group, vanishing)

    def __repr__(self) -> str:
        where = f", where {self.condition}" if self.condition else ""
        return f"<Symmetry {self.name}: {self.meaning}{where}>"

    def momentum(self, q: Array, p: Array) -> Array:
        """Return J of each row of q and p, shapes (..., n)."""
        return np.asarray(np.einsum("...i,...i->...", p, q @ self.A.T))

    def holds(self, parameters: Mapping[str, Any]) -> bool:
        """Whether parameters satisfy the condition, exactly."""
        return all(_value(terms, parameters) == 0 for terms in self.vanishing)

    def holds_plainly(self, columns: Mapping[str, Array]) -> bool:
        """Whether many runs may move along it, decided for the usual condition, x = y, alone.

        ``columns`` are parameters of all runs. False where the condition fails or is another one.
        """
        if not self.vanishing or not columns[self.name].any():
            return True  # without a condition, or no run moves along it
        for terms in self.vanishing:
            # terms of a x − a y
            names = [[*powers] for _, powers in terms if [*powers.values()] == [1]]
            if len(terms) != 2 or len(names) != 2 or terms[0][0] != -terms[1][0]:
                return False
            if not np.array_equal(columns[names[0][0]], columns[names[1][0]]):
                return False
        return True

    @property
    def condition_parameters(self) -> list[str]:
        """The parameters in the condition."""
        return sorted({name for terms in self.vanishing for _, powers in terms for name in powers})


def symmetries_of(manifest: Manifest) -> tuple[Symmetry, ...]:
    """Return the symmetries of a stepper, none of one without a frame."""
    n = len(manifest.system.coordinates)
    symmetries = () if manifest.frame is None else manifest.frame.symmetries
    return tuple(Symmetry.of(symmetry, n) for symmetry in symmetries)


def refuse_asymmetric(symmetries: Sequence[Symmetry], parameters: Mapping[str, Any]) -> None:
    """Refuse a frame along a generator that is no symmetry for these parameters.

    Raises InputError with the condition and the numbers that do not satisfy it.
    """
    for symmetry in symmetries:
        if parameters[symmetry.name] != 0 and not symmetry.holds(parameters):
            values = ", ".join(f"{name} = {parameters[name]!r}"
                               for name in symmetry.condition_parameters)
            raise InputError(
                f"Parameter {symmetry.name} = {parameters[symmetry.name]} moves along a symmetry "
                f"that this system has only where {symmetry.condition} exactly, but {values}; "
                f"give {symmetry.name} = 0.")


def _value(terms: Polynomial, parameters: Mapping[str, Any]) -> Fraction | None:
    """Return the value of a polynomial; None where a parameter is not finite."""
    # exactly: equal doubles are equal fractions
    polynomial_value = Fraction(0)
    for factor, powers in terms:
        for name, power in powers.items():
            x = exact(parameters[name])
            if not isinstance(x, Fraction):
                return None
            factor *= x**power
        polynomial_value += factor
    return polynomial_value
