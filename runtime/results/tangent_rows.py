"""Derivatives of the stored states of a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError

__all__ = ["TangentRows"]

Array = NDArray[Any]


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
    """

    q: Array
    p: Array
    names: list[str]
    start: Array

    def __getitem__(self, name: str) -> Array:
        """Return the derivatives of (q, p) by one name, shape (rows, 2 n)."""
        if name not in self.names:
            raise InputError(f"{name!r} is none of the directions {', '.join(self.names)}.")
        k = self.names.index(name)
        return np.concatenate([self.q[:, :, k], self.p[:, :, k]], axis=1)
