"""A reference problem: its model, time of comparison, compared numbers and published digits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from ..generator.schemes.named_schemes import SchemeName
from .true_digits import Truth, truth

if TYPE_CHECKING:
    from ..generator.multibody.model import Model
    from ..runtime.results.trajectory import Trajectory

__all__ = ["Attempt", "Published", "Reference", "largest_error"]


@dataclass(frozen=True)
class Published:
    """Published digits of a problem.

    Attributes
    ----------
    source : str
        The publication or program.
    values : mapping of str to str
        Name → digits, as printed there.
    """

    source: str
    values: Mapping[str, str]


@dataclass(frozen=True)
class Attempt:
    """A scheme with its stages, None for EMS, and the numbers of steps it is run with."""

    scheme: SchemeName
    stages: int | None
    steps: tuple[int, ...]

    @property
    def name(self) -> str:
        """As in tables: ``3-G-L``, ``EMS``."""
        return f"{self.stages}-{self.scheme}" if self.stages else self.scheme


@dataclass(frozen=True)
class Reference:
    """A problem whose motion is known in more digits than a double has.

    Attributes
    ----------
    name, title, source : str
        Its name, title and origin.
    form : str
        The form of its model: TOML, Python, or Lagrangian.
    make : callable
        Returns the model, with the exact values of its numbers.
    seconds : str
        The time of comparison, in digits.
    groups : mapping of str to sequence of str
        Kind of number ("positions", "velocities") → names. An error is relative to the largest
        number of its kind.
    read : callable
        Trajectory → the numbers at its end by group, in the order of the names.
    invariants : mapping of str to str
        Conserved quantity → its formula. A name that is a quantity of the system is measured.
    attempts : sequence of Attempt
        Schemes and numbers of steps to run.
    published : Published, optional
        Published digits.
    no_bodies : str
        Why the problem cannot be built of rigid bodies on joints, the only models of some programs;
        "" if it can.
    """

    name: str
    title: str
    source: str
    form: str
    make: Callable[[], Model]
    seconds: str
    groups: Mapping[str, Sequence[str]]
    read: Callable[[Trajectory], Mapping[str, Any]]
    invariants: Mapping[str, str]
    attempts: Sequence[Attempt]
    published: Published | None = field(default=None)
    no_bodies: str = ""

    @property
    def truth(self) -> Truth:
        """The digits, and how they were made."""
        return truth(self.name)

    @property
    def deviations(self) -> Mapping[str, float]:
        """Relative error of each published number; {} without published digits."""
        if self.published is None:
            return {}
        exact = self.truth
        # in fractions: doubles would round away differences of digits beyond 16
        return {name: abs(float(Fraction(text) / exact.value(name) - 1))
                for name, text in self.published.values.items()}

    def error(self, run: Trajectory) -> float:
        """Return the error at the end of a run, the largest of all groups."""
        exact = self.truth
        end_values = self.read(run)
        return max(largest_error(end_values[group], [exact.value(name) for name in names])
                   for group, names in self.groups.items())


def largest_error(numbers: Sequence[Any], exact: Sequence[Fraction]) -> float:
    """Return max |x_i − y_i| / max |y_i| of computed numbers x and exact ones y."""
    differences = [abs(Fraction(*_ratio(x)) - y) for x, y in zip(numbers, exact, strict=True)]
    return float(max(differences) / max(map(abs, exact)))


def _ratio(value: Any) -> tuple[int, int]:
    """Return a number of any type, quadruple precision included, as numerator and denominator."""
    if hasattr(value, "as_integer_ratio"):
        top, bottom = value.as_integer_ratio()
        return int(top), int(bottom)
    from ..runtime.bindings.binary128 import exact

    return exact(value).as_integer_ratio()
