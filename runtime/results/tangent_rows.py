"""Derivatives of the stored states of a run."""

from __future__ import annotations

from dataclasses import field, replace
from typing import Any

import numpy as np

from ...core.arguments import choose, count_text, few
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ...core.html import card, table
from ...core.records import dataclass

__all__ = ["EventTangents", "TangentRows"]


class EventTangents(dict[str, "TangentRows"]):
    """The tangents of each event's crossings; looking up an event without tangents raises why."""

    def __init__(self, tangents: dict[str, TangentRows], reasons: dict[str, str]) -> None:
        super().__init__(tangents)
        self.refused = reasons

    def __missing__(self, name: str) -> TangentRows:
        choose("event", name, [*self, *self.refused])
        raise InputError(self.refused[name])

    def __reduce__(self) -> tuple[Any, ...]:
        return EventTangents, (dict(self), self.refused)


@explain_arguments
@dataclass(frozen=True)
class TangentRows:
    """Directions at each stored state of a run.

    Attributes
    ----------
    q, p : array, shape (rows, n, k)
        Derivatives of q and p along each of the k directions.
    names : list of str
        What each direction is: "start[0]", …, a parameter, "dt", "t0".
    start : array, shape (2 n, k)
        The directions at the first state.
    t : array, shape (rows, k)
        Derivatives of the times of the rows: 0 at times that were asked for.
    multipliers : array, shape (rows − 1, p+1, k), or (rows − 1, p+1, m, k), or None
        Derivatives of the run's multipliers, where they were asked for.
    switched_steps : int
        Steps that end on another side of a switch than they begin: see ``Gradient``.
    events : dict of str to TangentRows
        The same of the crossings of each event, at its own time. Events of quantities, and ones
        that only touch their level, have none: ``events[name]`` says why.
    """

    q: Array
    p: Array
    names: list[str]
    start: Array
    t: Array
    #: The directions by all rows: q, p, parameters, dt, start time; None in what files have.
    _directions: Any = field(default=None, repr=False)
    multipliers: Any = field(default=None, repr=False)
    switched_steps: int = field(default=0, repr=False)
    events: EventTangents = field(default_factory=lambda: EventTangents({}, {}), repr=False)

    def __repr__(self) -> str:
        return (f"<TangentRows of {count_text(len(self.q), 'state')} along {few(self.names)}>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the size of each direction in the first and last state."""
        rows = [(name, *(f"{np.linalg.norm(self[name][i].astype(float)):.6g}" for i in (0, -1)))
                for name in self.names] if len(self.q) else []
        return card(f"Tangents of {count_text(len(self.q), 'state')}",
                    table(rows, ("direction", "norm of the first", "norm of the last")))

    def __getitem__(self, name: str) -> Array:
        """Return the derivatives of (q, p) by one name, shape (rows, 2 n)."""
        if name not in self.names:
            raise InputError(f"{name!r} is none of the directions {', '.join(self.names)}.")
        k = self.names.index(name)
        return np.concatenate([self.q[:, :, k], self.p[:, :, k]], axis=1)

    def together(self) -> Array:
        """Return the derivatives of q, p and multipliers as one array, shape (rows, ·, k).

        The start has no step before it: its derivatives of multipliers are 0.
        """
        blocks = [self.q, self.p]
        if self.multipliers is not None:
            step_count, *inner_shape, k = self.multipliers.shape
            of_multipliers = np.zeros((step_count + 1, int(np.prod(inner_shape)), k), self.q.dtype)
            of_multipliers[1:] = self.multipliers.reshape(step_count, of_multipliers.shape[1], k)
            blocks.append(of_multipliers)
        return np.concatenate(blocks, axis=1)

    def of_others(self, columns: Array, t: Array) -> TangentRows:
        """Return the tangents of other states along the same directions of the start.

        ``columns``, shape (rows, 2 n + multipliers, k), are as from ``together``; ``t`` has the
        derivatives of the states' times, (rows, k).
        """
        n, k = self.q.shape[1], columns.shape[2]
        multipliers = None
        if columns.shape[1] > 2 * n:  # before row 0 there is no step, which would have some
            multipliers = columns[1:, 2 * n :].reshape(-1, *self.multipliers.shape[1:-1], k)
        return replace(self, q=columns[:, :n], p=columns[:, n : 2 * n], t=t,
                       multipliers=multipliers)
