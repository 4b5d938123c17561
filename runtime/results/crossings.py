"""Crossings of an event: their states and times, in one run and in many."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ...core.arguments import count_text
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.html import card, table
from ...core.records import dataclass

if TYPE_CHECKING:
    from ..bindings.binding import Binding

__all__ = ["Crossings", "CrossingsOfMany", "Impacts", "of_columns"]

#: Crossings that notebooks show.
_SHOWN = 10


@explain_arguments
@dataclass(frozen=True, eq=False)
class Crossings:
    """Where a run crossed a level, in the order of the run.

    Attributes
    ----------
    t : array, shape (K,)
        Times, to some units in the last place.
    q, p : array, shape (K, n)
        The states there: of real steps from the states before, so on their constraints.
    steps : array of int, shape (K,)
        Whole steps of the run before each; a crossing at the end of a step is within that step.
    rising : array of bool, shape (K,)
        Whether the quantity rises there along the run.
    elapsed : array, shape (K,)
        Times since the start of the run, which have more digits than t where that is late; in
        scaled time those of τ.
    """

    t: Array
    q: Array
    p: Array
    steps: Array
    rising: Array
    elapsed: Array

    def __len__(self) -> int:
        return len(self.t)

    @classmethod
    def _column_names(cls) -> list[str]:
        """Return the names of the arrays in files, in the order of ``columns``."""
        return [field.name for field in fields(Crossings)]

    @property
    def columns(self) -> dict[str, Array]:
        """The arrays by their names in files."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def first(self) -> Self:
        """The first crossing alone, or none."""
        return self._select(np.arange(len(self)) < 1)  # a mask, for there may be no row 0

    def shown(self, binding: Binding) -> Self:
        """Return the crossings as users see them: in scaled time t is apart from q and p."""
        if not binding.clocked:
            return self
        # compiled code has the time as its last coordinate, behind n others, and τ as t
        n = binding.shown
        return replace(self, t=self.q[:, -1].astype(self.t.dtype), q=self.q[:, :n].copy(),
                       p=self.p[:, :n].copy())

    def until(self, last: Crossings, dt: Any) -> Self:
        """Return the crossings up to ``last``, a single one, in a run with steps dt."""
        # steps are compared first, and times only within the step of ``last``; times decrease if
        # dt < 0
        step, is_later = last.steps[0], (self.elapsed - last.elapsed[0]) * dt > 0
        return self._select((self.steps < step) | (self.steps == step) & ~is_later.astype(bool))

    def within(self, begin: Any, end: Any, ahead: int) -> Self:
        """Return the crossings from time ``begin`` to ``end``; None is no end.

        ``ahead`` is 1 or −1, the sign of dt.
        """
        return self._select(_within(self.t, begin, end, ahead))

    def joined(self, later: Self) -> Self:
        """Return these crossings followed by later ones."""
        return type(self)(*(np.concatenate([getattr(rows, field.name) for rows in (self, later)])
                            for field in fields(self)))

    def _select(self, selected: Array) -> Self:
        """Return the crossings of a mask, or of indices."""
        return type(self)(*(getattr(self, field.name)[selected] for field in fields(self)))

    def __repr__(self) -> str:
        if not len(self):
            return "<Crossings: none>"
        return (f"<Crossings: {len(self):,}, from t = {float(self.t[0]):.6g} to "
                f"{float(self.t[-1]):.6g} s>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: time and direction of the first crossings."""
        rows = [(f"{float(t):.9g}", f"{steps:,}", "up" if rising else "down") for t, steps, rising
                in zip(self.t[:_SHOWN], self.steps, self.rising, strict=False)]
        return card(f"Crossings: {len(self):,}",
                    table(rows, ("t / s", "steps before", "direction")))


def _within(t: Array, begin: Any, end: Any, ahead: int) -> Array:
    """Return a mask, shape (crossings,), of the times t from ``begin`` to ``end``, None for no end.

    ``ahead`` is 1, or −1 in a run backwards in time.
    """
    selected = np.array(ahead * (t - begin) >= 0, bool)
    if end is not None:
        selected &= np.array(ahead * (t - end) <= 0, bool)
    return selected


@explain_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Impacts(Crossings):
    """The impacts of a gap, in the order of the run.

    Attributes
    ----------
    t : array, shape (K,)
        Times, to some units in the last place.
    q, p_before, p : array, shape (K, n)
        The coordinates, and the momenta before and after.
    impulse : array, shape (K,)
        −(1 + e) φ̇/(nᵀ H_pp n), by which n is added to p: of a gap in metres in N s.
    energy_lost : array, shape (K,)
        H before less H after, in joules.
    work : array, shape (K,)
        The work of the forces since the start of the run; 0 without forces.
    steps : array of int, shape (K,)
        Whole steps of the run before each; one at the end of a step is before the next step, which
        begins with its momenta.
    rising : array of bool, shape (K,)
        False: a gap falls there.
    elapsed : array, shape (K,)
        Times since the start of the run, which have more digits than t where that is late.
    """

    p_before: Array
    impulse: Array
    energy_lost: Array
    work: Array

    @property
    def crossings(self) -> Crossings:
        """The crossings of the gap through 0, with the momenta before."""
        return Crossings(self.t, self.q, self.p_before, self.steps, self.rising, self.elapsed)

    @classmethod
    def _column_names(cls) -> list[str]:
        """Return the names of the arrays in files: "p" are the momenta before, as of crossings."""
        return [*super()._column_names(), "p_after", "impulse", "energy_lost", "work"]

    @property
    def columns(self) -> dict[str, Array]:
        """The arrays by their names in files: the crossings' columns, then the impacts' own."""
        arrays = (self.p, self.impulse, self.energy_lost, self.work)
        return self.crossings.columns | dict(zip(self._column_names()[-len(arrays):], arrays,
                                                 strict=True))

    def __repr__(self) -> str:
        if not len(self):
            return "<Impacts: none>"
        return (f"<Impacts: {len(self):,}, from t = {float(self.t[0]):.6g} to "
                f"{float(self.t[-1]):.6g} s, energy lost {float(self.energy_lost.sum()):.6g} J>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: time, impulse and loss of the first impacts."""
        rows = [(f"{float(t):.9g}", f"{float(impulse):.6g}", f"{float(lost):.6g}")
                for t, impulse, lost in zip(self.t[:_SHOWN], self.impulse, self.energy_lost,
                                            strict=False)]
        return card(f"Impacts: {len(self):,}", table(rows, ("t / s", "impulse", "energy lost")))


def of_columns(columns: dict[str, Array]) -> Crossings:
    """Return crossings, or impacts, of their ``columns``.

    Of impacts "p" are the momenta before in files, and "p_after" are ``p``.
    """
    if "p_after" not in columns:
        return Crossings(**columns)
    return Impacts(**{"p_before" if name == "p" else "p" if name == "p_after" else name: array
                      for name, array in columns.items()})


@dataclass(frozen=True, eq=False)
class CrossingsOfMany:
    """The crossings of each trajectory of an ensemble; ``crossings[i]`` are of trajectory i."""

    _members: list[Crossings]

    def __getitem__(self, i: int) -> Crossings:
        return self._members[i]

    def __len__(self) -> int:
        return len(self._members)

    @property
    def count(self) -> Array:
        """The number of crossings of each trajectory."""
        return np.array([len(crossings) for crossings in self._members])

    @property
    def first(self) -> Array:
        """The time of the first crossing of each trajectory; NaN without one."""
        no_time = np.array([np.nan])
        return np.array([(crossings.t if len(crossings) else no_time)[0]
                         for crossings in self._members])

    def __repr__(self) -> str:
        return f"<CrossingsOfMany {count_text(len(self), 'trajectory')}: {self.count.sum():,}>"
