"""What a reference problem is: a model, a time, names of numbers there, digits of others."""

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
    """Digits that others gave.

    Attributes
    ----------
    source : str
        Where they stand.
    values : mapping of str to str
        Name → digits, as printed there.
    """

    source: str
    values: Mapping[str, str]


@dataclass(frozen=True)
class Attempt:
    """A scheme with its stages, and the numbers of steps it is run with."""

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
        Its name, what it is, and where it comes from.
    form : str
        How its model is made: TOML, Python, or Lagrangian.
    make : callable
        Returns the model, with numbers as exact as they are given.
    seconds : str
        The time of comparison, in digits.
    groups : mapping of str to sequence of str
        Kind of number ("positions", "velocities") → names. An error is relative to the largest
        number of its kind.
    read : callable
        Trajectory → the numbers at its end by group, in the order of the names.
    invariants : mapping of str to str
        What the motion keeps → its formula. A name that is a quantity of the system is followed.
    attempts : sequence of Attempt
        What is run.
    published : Published, optional
        What others gave.
    no_bodies : str
        Why the problem is no rigid bodies on joints, for programs that know nothing else; "" where
        it is.
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
        """How far each published number is from the true one, relative to that; none is {}."""
        if self.published is None:
            return {}
        true = self.truth
        return {name: abs(float(Fraction(text) / true.value(name) - 1))
                for name, text in self.published.values.items()}

    def error(self, run: Trajectory) -> float:
        """Return how far the end of a run is from the truth, the worst of all groups."""
        true = self.truth
        found = self.read(run)
        return max(largest_error(found[group], [true.value(name) for name in names])
                   for group, names in self.groups.items())


def largest_error(found: Sequence[Any], wanted: Sequence[Fraction]) -> float:
    """Return the largest difference, relative to the largest number that is wanted."""
    differences = [abs(Fraction(*_ratio(x)) - y) for x, y in zip(found, wanted, strict=True)]
    return float(max(differences) / max(map(abs, wanted)))


def _ratio(value: Any) -> tuple[int, int]:
    """Return a floating-point number of any type as the quotient it is."""
    if hasattr(value, "as_integer_ratio"):
        top, bottom = value.as_integer_ratio()
        return int(top), int(bottom)
    from ..runtime.bindings.binary128 import exact

    return exact(value).as_integer_ratio()
