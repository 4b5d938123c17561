"""Measured quantities of a state: their residuals against data, and derivatives by q and p.

The residual of a measured attitude d at the attitude q is r = 2 sign(dᵀq) L(d) q, with L(d) q the
vector part of d* q: 2 sin(θ/2) n of the rotation by θ about n between them, in the axes of the
measured body. The sign makes d and −d the same measurement.

An angular velocity is Ω = J⁻¹ ½ L(q) p (19) in body axes, which depends on the inertia too:
∂Ω/∂p = J⁻¹ ½ L(q), ∂Ω/∂q = −J⁻¹ ½ L(p), ∂Ω/∂K_ij of K = J⁻¹ from Ω = K l, and ∂Ω_i/∂I_i = −Ω_i/I_i.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import as_items, count_text, join_or, shown, unknown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.records import dataclass
from ..bindings.array_checks import as_numbers
from ..compilation.body_columns import BodyAt, bodies_of
from ..rigid_body.quaternion import left_matrix

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["Observation", "Observe", "observation_of"]

#: A function of rows of q and p: values (rows, c), and derivatives by q and by p, (rows, c, n).
Observe = Callable[[Array, Array], tuple[ArrayLike, ArrayLike, ArrayLike]]

#: What is measured: columns of q that are an attitude, a body that turns, or a column of (q, p).
Part = list[int] | BodyAt | int

#: How far |d| of a measured attitude may be from 1.
_NORM = 1e-3


class Residuals(NamedTuple):
    """Prediction − data of c numbers in each row, with derivatives."""

    values: Array  # shape (rows, c)
    by_q: Array  # shape (rows, c, n)
    by_p: Array
    #: parameter → derivative at fixed q and p, (rows, c): an angular velocity has the inertia
    by_parameters: dict[str, Array]


@dataclass(frozen=True)
class Observation:
    """The measured quantities: which component of a state predicts which column of data.

    Attributes
    ----------
    parts : list of Part
        What is measured, in the order of the columns of data: the columns of q that are the
        quaternion of a body, with four columns of data; a body whose angular velocity is measured,
        with three; a column of (q, p), with one.
    function : callable or None
        In place of the parts.
    names : list of str
        Of the columns of data; empty with a function.
    """

    n: int
    parts: list[Part]
    function: Observe | None
    names: list[str]

    def check_data(self, data: ArrayLike, rows: int) -> Array:
        """Return the data as rows of numbers, attitudes with length 1.

        Raises
        ------
        InputError
            For data of another shape, for NaN, and for quaternions that are no attitudes.
        """
        samples = as_numbers("data", data)
        # one number a sample is one column; bodies side by side, (rows, bodies, 4), are their
        # columns
        if samples.shape == (rows,):
            samples = samples[:, None]
        elif samples.ndim == 3:
            samples = samples.reshape(len(samples), -1)
        column_count = len(self.names)
        if samples.ndim != 2 or len(samples) != rows or (
                column_count and samples.shape[1] != column_count):
            columns = (f"{count_text(column_count, 'column')} "
                       f"({', '.join(self.names)})" if column_count
                       else "its columns")
            raise InputError(f"data has the shape {np.shape(data)}; give {rows} rows, one for each "
                             f"time, with {columns}.")
        measurements = np.array(samples, dtype=float)
        if not np.isfinite(measurements).all():
            row, column = np.argwhere(~np.isfinite(measurements))[0]
            raise InputError(f"data[{row}, {column}] = {measurements[row, column]} is not finite; "
                             "leave out the samples that are missing, and their times.")
        self._normalise_attitudes(measurements)
        return measurements

    def _normalise_attitudes(self, measurements: Array) -> None:
        """Scale the quaternions in rows of data to length 1, in place; refuse other quaternions."""
        for part, columns_of_part, _ in self._columns():
            if not isinstance(part, list):
                continue
            attitudes = measurements[:, columns_of_part]
            norms = np.linalg.norm(attitudes, axis=1)
            row = int(np.argmax(np.abs(norms - 1)))
            if abs(norms[row] - 1) > _NORM:
                raise InputError(f"data[{row}] = {shown(attitudes[row].tolist())} is no unit "
                                 f"quaternion: its length is {norms[row]:.6g}. Scale the rows to "
                                 "length 1.")
            attitudes /= norms[:, None]  # a view: in ``measurements`` too

    def residuals(
        self, data: Array, q: Array, p: Array, parameters: Mapping[str, float]
    ) -> Residuals:
        """Return prediction − data of states q and p, (rows, n), and its derivatives.

        An attitude has four columns of data and three residuals. The equations are in the module
        docstring.
        """
        if self.function is not None:
            return self._residuals_of_function(self.function, data, q, p)
        count = sum(1 if isinstance(part, int) else 3 for part in self.parts)
        residuals = np.zeros((len(data), count))
        by_state = np.zeros((len(data), count, 2 * self.n))
        by_parameters: dict[str, Array] = {}
        z = np.concatenate([q, p], axis=1)
        for part, data_columns, columns in self._columns():
            measured = data[:, data_columns]
            if isinstance(part, list):  # an attitude
                residuals[:, columns], by_state[:, columns, part] = _rotation_between(
                    measured, q[:, part])
            elif isinstance(part, int):  # a coordinate or a momentum
                residuals[:, columns] = z[:, [part]] - measured
                by_state[:, columns, part] = 1.0
            else:  # the angular velocity of a body
                omega, by_q, by_p, by_inertia = _angular_velocity(part, q[:, part.q], p[:, part.q],
                                                                  parameters)
                residuals[:, columns] = omega - measured
                by_state[:, columns, part.q] = by_q
                by_state[:, columns, [self.n + i for i in part.q]] = by_p
                for name, change in by_inertia.items():
                    derivative = by_parameters.setdefault(name, np.zeros_like(residuals))
                    derivative[:, columns] = change
        return Residuals(residuals, by_state[:, :, : self.n], by_state[:, :, self.n :],
                         by_parameters)

    def _columns(self) -> Iterator[tuple[Part, slice, slice]]:
        """Yield each part, its columns of data, and its columns of residuals."""
        data_end = residual_end = 0
        for part in self.parts:
            residual_count = 1 if isinstance(part, int) else 3
            # four numbers of a quaternion have the three residuals 2 sin(θ/2) n
            data_count = 4 if isinstance(part, list) else residual_count
            yield (part, slice(data_end, data_end := data_end + data_count),
                   slice(residual_end, residual_end := residual_end + residual_count))

    def _residuals_of_function(
        self, function: Observe, data: Array, q: Array, p: Array
    ) -> Residuals:
        """Return the residuals of a user's function; InputError for arrays of other shapes."""
        returned = function(q, p)
        if not isinstance(returned, tuple) or len(returned) != 3:
            raise InputError(f"observe returned {shown(returned)}; return the values and their "
                             "derivatives by q and by p.")
        sample_count, columns = data.shape
        shape = (sample_count, columns, self.n)
        predictions, by_q, by_p = (np.asarray(x, dtype=float) for x in returned)
        # one observed number needs no axis of its own
        if columns == 1 and predictions.shape == (sample_count,):
            predictions = predictions[:, None]
        if columns == 1 and by_q.shape == by_p.shape == (sample_count, self.n):
            by_q, by_p = by_q[:, None], by_p[:, None]
        if predictions.shape != data.shape or by_q.shape != shape or by_p.shape != shape:
            raise InputError(f"observe returned arrays of the shapes {predictions.shape}, "
                             f"{by_q.shape} and {by_p.shape}; values are {data.shape} as data are, "
                             f"and derivatives by q and by p {shape}.")
        for array, label in ((predictions, "a value"), (by_q, "a derivative by q"),
                             (by_p, "a derivative by p")):
            if not np.isfinite(array).all():
                row = int(np.argwhere(~np.isfinite(array))[0, 0])
                raise InputError(f"observe returned {label} that is not finite, at the state "
                                 f"q = {shown(q[row].tolist())}, p = {shown(p[row].tolist())}; "
                                 "return finite numbers for every state.")
        return Residuals(predictions - data, by_q, by_p, by_parameters={})


def _rotation_between(d: Array, q: Array) -> tuple[Array, Array]:
    """Return r = 2 sign(dᵀq) L(d) q and ∂r/∂q, shapes (rows, 3) and (rows, 3, 4).

    r = 2 sin(θ/2) n of the rotation by θ about n from the measured attitude d to q, both of shape
    (rows, 4).
    """
    left_matrices = left_matrix(d)
    # q and −q are one attitude
    factor = 2 * np.where((d * q).sum(axis=1) < 0, -1.0, 1.0)
    rotated = (left_matrices @ q[:, :, None])[:, :, 0]
    return rotated * factor[:, None], left_matrices * factor[:, None, None]


def _angular_velocity(
    body: BodyAt, q: Array, p: Array, parameters: Mapping[str, float]
) -> Residuals:
    """Return Ω = K l, l = ½ L(q) p, K = J⁻¹, of one body with its derivatives: residuals of data 0.

    q and p have the shape (rows, 4), so that c = 3 and n = 4; the derivative by an entry of the
    inertia is dK l.
    """
    half_L, half_L_of_p = left_matrix(q) / 2, left_matrix(p) / 2
    l = np.einsum("kij,kj->ki", half_L, p)  # noqa: E741  the paper's letter
    values = np.array([parameters[name] for name in body.inertia])
    if len(values) == 3:
        K = np.diag(1 / values)
        K_by_values = [np.diag(row) for row in -np.diag(values**-2.0)]
    else:
        units = []
        for i, j in zip(*np.triu_indices(3), strict=True):
            unit = np.zeros((3, 3))
            unit[i, j] = unit[j, i] = 1.0
            units.append(unit)
        # K is linear in its six entries: its derivatives are the unit matrices
        K = sum(entry * unit for entry, unit in zip(values, units, strict=True))
        K_by_values = units
    # rows times symmetric matrices: l K is (K l)ᵀ
    return Residuals(values=l @ K, by_q=-K @ half_L_of_p, by_p=K @ half_L, by_parameters={
        name: l @ dK for name, dK in zip(body.inertia, K_by_values, strict=True)})


def observation_of(step: Stepper, observe: str | Sequence[str] | Observe) -> Observation:
    """Return the observation that the argument ``observe`` of ``fit`` names.

    Raises InputError for an unknown name, with the nearest.
    """
    if callable(observe):
        return Observation(step.n, parts=[], function=observe, names=[])
    measurable = _measurable_parts(step)
    names = [observe] if isinstance(observe, str) else as_items("observe", observe, "names")
    system = step.manifest.system
    coordinates, state_names = list(system.coordinates), [*system.coordinates, *system.momenta]
    parts: list[Part] = []
    labels: list[str] = []
    for name in names:
        if not isinstance(name, str):
            raise InputError(f"observe has {shown(name)}, which is no name; write text.")
        if name not in measurable:
            raise _unmeasurable(step, name, measurable)
        for label, part in measurable[name]:
            parts.append(part)
            if isinstance(part, list):
                labels += [coordinates[i] for i in part]
            elif isinstance(part, int):
                labels.append(state_names[part])
            else:
                labels += [f"{label}_omega{axis}" for axis in (1, 2, 3)]
    if not names:
        raise InputError("observe names nothing; give for example observe=\"attitude\".")
    return Observation(step.n, parts, function=None, names=labels)


def _unmeasurable(step: Stepper, name: str, measurable: Iterable[str]) -> InputError:
    """Return the error for a name that no measured quantity of the system has."""
    if name in ("attitude", "angular_velocity"):  # the first is the default
        return InputError(f"observe = {shown(name)} needs a body, and {step.name} has none; "
                          f"choose {join_or(measurable)}, or give a function of (q, p) that "
                          "returns values and derivatives by q and by p.")
    return unknown("quantity to observe", name, measurable,
                   "; for a quantity, such as a joint's angle, give a function of (q, p) "
                   "that returns values and derivatives by q and by p")


def _measurable_parts(step: Stepper) -> dict[str, list[tuple[str, Part]]]:
    """Return the names that ``observe`` may have, each with pairs of a body's name and a part.

    The body's name labels columns of data; it is empty for columns of q and p, which have names.
    """
    n, system, bodies = step.n, step.manifest.system, bodies_of(step.manifest)
    parts: dict[str, list[tuple[str, Part]]] = {}
    for name, body in bodies.items():
        parts[f"{name} attitude"] = [(name, body.q)]
        parts[f"{name} angular_velocity"] = [(name, body)]
    if bodies:
        parts["attitude"] = [(name, body.q) for name, body in bodies.items()]
        parts["angular_velocity"] = [*bodies.items()]
    # a coordinate of the name of a longer vector does not replace it
    parts.setdefault("q", [("", i) for i in range(n)])
    parts.setdefault("p", [("", i) for i in range(n, 2 * n)])
    for i, name in enumerate((*system.coordinates, *system.momenta)):
        parts.setdefault(name, [("", i)])
    return parts
