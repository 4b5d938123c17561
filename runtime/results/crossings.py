"""Crossings of an event: their states and times, in one run and in many."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.calls import explain_arguments

if TYPE_CHECKING:
    from ..bindings.binding import Binding

__all__ = ["Crossings", "CrossingsOfMany"]

Array = NDArray[Any]


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
        Whole steps of the run before each.
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

    @property
    def first(self) -> Crossings:
        """The first of them by itself, or none."""
        return self._some(np.arange(len(self)) < 1)

    def shown(self, binding: Binding) -> Crossings:
        """Return them as users see them: in scaled time t is a coordinate, which q has no more."""
        if not binding.clocked:
            return self
        n = binding.shown
        return replace(self, t=self.q[:, -1].astype(self.t.dtype), q=self.q[:, :n].copy(),
                       p=self.p[:, :n].copy())

    def until(self, last: Crossings, dt: Any) -> Crossings:
        """Return those that are no later, in a run with steps dt, than another crossing."""
        step, later = last.steps[0], (self.elapsed - last.elapsed[0]) * dt > 0
        return self._some((self.steps < step) | (self.steps == step) & ~later.astype(bool))

    def within(self, begin: Any, end: Any, ahead: int) -> Crossings:
        """Return those from a time on, up to another unless it is None.

        ``ahead`` is 1 or −1, the sign of dt.
        """
        chosen = np.array(ahead * (self.t - begin) >= 0, bool)
        if end is not None:
            chosen &= np.array(ahead * (self.t - end) <= 0, bool)
        return self._some(chosen)

    def _some(self, chosen: Array) -> Crossings:
        return Crossings(self.t[chosen], self.q[chosen], self.p[chosen], self.steps[chosen],
                         self.rising[chosen], self.elapsed[chosen])

    def __repr__(self) -> str:
        if not len(self):
            return "<Crossings: none>"
        return (f"<Crossings: {len(self):,}, from t = {float(self.t[0]):.6g} to "
                f"{float(self.t[-1]):.6g} s>")


@dataclass(frozen=True, eq=False)
class CrossingsOfMany:
    """The crossings of each trajectory of an ensemble: ``found[i]`` has those of trajectory i."""

    _members: list[Crossings]

    def __getitem__(self, i: int) -> Crossings:
        return self._members[i]

    def __len__(self) -> int:
        return len(self._members)

    @property
    def count(self) -> Array:
        """How many each trajectory has."""
        return np.array([len(one) for one in self._members])

    @property
    def first(self) -> Array:
        """The time of the first of each trajectory; NaN where it has none."""
        none = np.array([np.nan])
        return np.array([(one.t if len(one) else none)[0] for one in self._members])

    def __repr__(self) -> str:
        return f"<CrossingsOfMany {len(self):,} trajectories: {self.count.sum():,}>"
