"""What is measured of states: values, residuals against data, and their derivatives by q and p.

The residual of a measured attitude d against q is the small rotation between them in the axes of
the measured body, twice the vector part L(d) q of d*q with the sign of its scalar part dᵀq, in rad:
−d is the same measurement as d.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.arguments import as_items, shown, unknown
from ...core.errors import InputError
from ..bindings.array_checks import as_numbers
from ..compilation.body_columns import bodies_of
from ..rigid_body.quaternion import left_matrix

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["Observation", "Observe", "observation_of"]

Array = NDArray[Any]

#: A function of rows of q and p: values (rows, c), and derivatives by q and by p, (rows, c, n).
Observe = Callable[[Array, Array], tuple[ArrayLike, ArrayLike, ArrayLike]]

#: How far |d| of a measured attitude may be from 1.
_NORM = 1e-3


@dataclass(frozen=True)
class Observation:
    """Columns of data, and what a state says of them.

    Attributes
    ----------
    attitudes : list of list of int
        Columns of q that are the quaternion of a body; four columns of data for each come first.
    columns : list of int
        Columns of (q, p) that are measured as they are; a column of data for each.
    function : callable or None
        In place of both.
    names : list of str
        Of the columns of data; empty with a function.
    """

    n: int
    attitudes: list[list[int]]
    columns: list[int]
    function: Observe | None
    names: list[str]

    def checked(self, data: ArrayLike, rows: int) -> Array:
        """Return the data as rows of numbers, attitudes with length 1.

        Raises
        ------
        InputError
            For data of another shape, for NaN, and for quaternions that are no attitudes.
        """
        given = as_numbers("data", data)
        if given.ndim == 1 and rows != 1:
            given = given[:, None]
        elif given.ndim == 3:
            given = given.reshape(len(given), -1)
        wanted = len(self.names)
        if given.ndim != 2 or len(given) != rows or (wanted and given.shape[1] != wanted):
            columns = f"{wanted} columns ({', '.join(self.names)})" if wanted else "its columns"
            raise InputError(f"data has the shape {np.shape(data)}; give {rows} rows, one for each "
                             f"time, with {columns}.")
        made = np.array(given, dtype=float)
        if not np.isfinite(made).all():
            row, column = np.argwhere(~np.isfinite(made))[0]
            raise InputError(f"data[{row}, {column}] = {made[row, column]} is not finite; leave "
                             "out the samples that are missing, and their times.")
        for k in range(len(self.attitudes)):
            part = made[:, 4 * k : 4 * k + 4]
            norms = np.linalg.norm(part, axis=1)
            off = int(np.argmax(np.abs(norms - 1)))
            if abs(norms[off] - 1) > _NORM:
                raise InputError(f"data[{off}] = {shown(part[off].tolist())} is no unit "
                                 f"quaternion: its length is {norms[off]:.6g}. Scale the rows to "
                                 "length 1.")
            part /= norms[:, None]
        return made

    def residuals(self, data: Array, q: Array, p: Array) -> tuple[Array, Array, Array]:
        """Return residuals, shape (rows, c), and their derivatives by q and p, (rows, c, n)."""
        if self.function is not None:
            return self._of_function(self.function, data, q, p)
        rows, at = len(data), 3 * len(self.attitudes)
        count = at + len(self.columns)
        found = np.zeros((rows, count))
        by_state = np.zeros((rows, count, 2 * self.n))
        for k, columns in enumerate(self.attitudes):
            d, own = data[:, 4 * k : 4 * k + 4], q[:, columns]
            left = left_matrix(d)
            sign = 2 * np.where((d * own).sum(axis=1) < 0, -1.0, 1.0)
            part = slice(3 * k, 3 * k + 3)
            by_state[:, part, columns] = left * sign[:, None, None]
            found[:, part] = (left @ own[:, :, None])[:, :, 0] * sign[:, None]
        if self.columns:
            z = np.concatenate([q, p], axis=1)
            found[:, at:] = z[:, self.columns] - data[:, 4 * len(self.attitudes) :]
            by_state[:, range(at, count), self.columns] = 1.0
        return found, by_state[:, :, : self.n], by_state[:, :, self.n :]

    def _of_function(
        self, function: Observe, data: Array, q: Array, p: Array
    ) -> tuple[Array, Array, Array]:
        made = function(q, p)
        if not isinstance(made, tuple) or len(made) != 3:
            raise InputError(f"observe returned {shown(made)}; return the values and their "
                             "derivatives by q and by p.")
        rows, columns = data.shape
        shape = (rows, columns, self.n)
        values, by_q, by_p = (np.asarray(x, dtype=float) for x in made)
        if columns == 1 and values.shape == (rows,):
            values = values[:, None]
        if columns == 1 and by_q.shape == by_p.shape == (rows, self.n):
            by_q, by_p = by_q[:, None], by_p[:, None]
        if values.shape != data.shape or by_q.shape != shape or by_p.shape != shape:
            raise InputError(f"observe returned arrays of the shapes {values.shape}, {by_q.shape} "
                             f"and {by_p.shape}; values are {data.shape} as data are, and "
                             f"derivatives by q and by p {shape}.")
        return values - data, by_q, by_p


def observation_of(step: Stepper, observe: str | Sequence[str] | Observe) -> Observation:
    """Return what ``observe`` of a fit names.

    Raises
    ------
    InputError
        For an unknown name, with the nearest.
    """
    n = step.n
    if callable(observe):
        return Observation(n, [], [], observe, [])
    system = step.manifest.system
    coordinates, momenta = list(system.coordinates), list(system.momenta)
    both = coordinates + momenta
    bodies = bodies_of(step.manifest)
    many = {"q": list(range(n)), "p": list(range(n, 2 * n))}
    turns = {f"{name} attitude": [body.q] for name, body in bodies.items()}
    if bodies:
        turns["attitude"] = [body.q for body in bodies.values()]
    names = [observe] if isinstance(observe, str) else as_items("observe", observe, "names")
    attitudes: list[list[int]] = []
    columns: list[int] = []
    for name in names:
        if not isinstance(name, str):
            raise InputError(f"observe has {shown(name)}, which is no name; write text.")
        if name in turns:
            attitudes += turns[name]
        elif name in many:
            columns += many[name]
        elif name in both:
            columns.append(both.index(name))
        else:
            raise unknown("quantity to observe", name, [*turns, *many, *both],
                          " or a function of (q, p)")
    if not names:
        raise InputError("observe names nothing; give for example observe=\"attitude\".")
    labels = [coordinates[i] for body in attitudes for i in body]
    return Observation(n, attitudes, columns, None, [*labels, *(both[i] for i in columns)])
