"""Inputs of a run: numbers that a system's forces may have anew in every step.

A row has one number for each input and is held for so many steps: zero-order hold.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import proposal
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.records import dataclass
from .array_checks import as_numbers, as_positive_count

if TYPE_CHECKING:
    from .compiled_module import Compiled

__all__ = ["InputRows", "Inputs", "as_inputs"]


@dataclass(frozen=True, eq=False)
class Inputs:
    """Inputs of a run whose rows are held for several steps each.

    Attributes
    ----------
    values : mapping or array_like
        By name, a number or one for each row; or an array with a column for each input. There are
        ⌈steps/hold⌉ rows.
    hold : int
        Steps that each row is held for.

    Raises
    ------
    InputError
        Unless ``hold`` is a whole number from 1 on.
    """

    values: Mapping[str, Any] | ArrayLike
    hold: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "hold", as_positive_count("hold", self.hold, minimum=1))


@dataclass(frozen=True)
class InputRows:
    """Rows of inputs in the stepper's type, those of several runs one behind the other.

    Attributes
    ----------
    names : list of str
        Names of the inputs.
    values : array, shape (runs, rows, inputs)
        Of one run where all have the same.
    hold : int
        Steps that a row is held for; 0 where one row is held throughout.
    """

    names: Sequence[str]
    values: Array
    hold: int

    @property
    def stride(self) -> int:
        """Rows from one run to the next; 0 where all have the same."""
        return self.values.shape[1] if len(self.values) > 1 else 0

    @property
    def throughout(self) -> dict[str, Any]:
        """The inputs of the first run by name; NaN for inputs that change, which have no one value.

        A quantity of a step whose inputs were not stored is then NaN, not wrong.
        """
        rows = self.values[0]
        first_row = rows[0] if len(rows) else np.full(len(self.names), np.nan, rows.dtype)
        # NaN in the number type of the inputs
        changing = 0 * (first_row[0] if len(rows) else 1.0) + np.nan
        stays = (rows == first_row).all(axis=0)
        return {name: x if constant else changing
                for name, x, constant in zip(self.names, first_row.tolist(), stays, strict=True)}

    def of(self, i: int) -> InputRows:
        """Return the inputs of run i."""
        return replace(self, values=self.values[i : i + 1]) if len(self.values) > 1 else self

    def between(self, runs: slice) -> InputRows:
        """Return the inputs of a slice of the runs."""
        return replace(self, values=self.values[runs]) if len(self.values) > 1 else self

    def rows_of(self, runs: Array, steps: Array, count: int = 1) -> InputRows:
        """Return the inputs of ``count`` steps of each of several runs, a row per step.

        Entry i begins at step ``steps[i]`` of run ``runs[i]``; its last row is repeated. The values
        have the shape (entries, ``count``, inputs).
        """
        step_numbers = steps[:, None] + np.arange(count)
        # hold = 0: one row holds throughout
        row_numbers = step_numbers // self.hold if self.hold else 0 * step_numbers
        last_row = self.values.shape[1] - 1  # holds for all later steps
        run_numbers = runs[:, None] if len(self.values) > 1 else 0  # runs may share their inputs
        values = self.values[run_numbers, np.minimum(row_numbers, last_row)]
        return InputRows(self.names, np.ascontiguousarray(values), hold=1)

    @property
    def first(self) -> dict[str, Any]:
        """The inputs of the first step of the first run by name; 1 where there is no step."""
        rows = self.values[0]
        return dict(zip(self.names, rows[0].tolist() if len(rows) else [1.0] * len(self.names),
                        strict=True))

    def of_steps(self, count: int) -> InputRows:
        """Return the inputs of run 0 for ``count`` steps, a row per step; the last row repeats."""
        return self.rows_of(runs=np.zeros(1, int), steps=np.zeros(1, int), count=count)

    def refine(self, factor: int) -> InputRows:
        """Return the inputs for steps ``factor`` times smaller: each row is held for as many more.
        """
        return replace(self, hold=self.hold * factor)

    def at(self, step: int) -> Array:
        """Return the inputs of a step of the first run, shape (inputs,)."""
        row: Array = self.values[0, step // self.hold if self.hold else 0]
        return row


def as_inputs(
    inputs: Any, binding: Compiled, steps: int, runs: int | None = None
) -> InputRows | None:
    """Return the inputs of a run of ``steps`` steps, or of ``runs`` such runs; None for None.

    The array has the shape (runs, rows, inputs), with 1 run where all have the same inputs, and 1
    row where they stay. Inputs that are checked already are returned unchanged. Raises InputError
    for unknown or missing names, other shapes, what is no finite number.
    """
    if inputs is None or isinstance(inputs, InputRows):
        return inputs
    hold = 1
    if isinstance(inputs, Inputs):
        inputs, hold = inputs.values, inputs.hold
    names = binding.input_names
    if not names:
        raise InputError("inputs are given, and this system has none; declare them by "
                         "System(..., inputs=...).")
    rows = (steps + hold - 1) // hold  # rounded up: the last row may serve fewer steps
    if isinstance(inputs, Mapping):
        parts = [_column(name, inputs, rows, runs) for name in _check_names(inputs, names)]
        array = np.stack(np.broadcast_arrays(*parts), axis=-1)
    else:
        array = _table(as_numbers("inputs", inputs), len(names), rows, runs)
    return InputRows(names, binding.array("inputs", array, array.shape),
                     hold=0 if array.shape[1] == 1 else hold)  # 0: one row is held throughout


def _check_names(inputs: Mapping[str, Any], names: Sequence[str]) -> Sequence[str]:
    """Return all input names of the system; refuse unknown and missing names in ``inputs``."""
    unknown = [str(name) for name in inputs if name not in names]
    if unknown:
        raise InputError(f"Input {unknown[0]!r} is unknown; this system has {', '.join(names)}"
                         f"{proposal(unknown[0], names)}.")
    absent = [name for name in names if name not in inputs]
    if absent:
        raise InputError(f"Input {absent[0]!r} is not given; give all of {', '.join(names)}.")
    return names


def _column(name: str, inputs: Mapping[str, Any], rows: int, runs: int | None) -> Array:
    """Return one input, shape (runs, rows), either of them 1 where one number serves all.

    ``inputs[name]`` is one number, a number per row, or with ``runs`` a row of these for each run.
    """
    array = as_numbers(f"Input {name}", inputs[name])
    # shape as given → shape (runs, rows)
    allowed = {(): (1, 1), (rows,): (1, rows)}
    if runs is not None:
        allowed |= {(runs, 1): (runs, 1), (runs, rows): (runs, rows)}
    if array.shape not in allowed:
        raise InputError(f"Input {name} has shape {array.shape}; give "
                         f"{_choices(list(allowed))}.")
    return array.reshape(allowed[array.shape])


def _table(array: Array, count: int, rows: int, runs: int | None) -> Array:
    """Return inputs as (runs, rows, inputs), an axis of length 1 where one number serves all.

    The last axis of ``array`` has the ``count`` inputs, the axis before it ``rows`` rows, and the
    first one ``runs`` runs where these are not None.
    """
    # shape as given → shape (runs, rows, inputs)
    allowed = {(count,): (1, 1, count), (rows, count): (1, rows, count)}
    if count == 1:  # one input needs no axis of its own
        allowed = {(): (1, 1, 1), (rows,): (1, rows, 1)} | allowed
    if runs is not None:
        allowed |= {(runs, 1, count): (runs, 1, count), (runs, rows, count): (runs, rows, count)}
    if array.shape not in allowed:
        raise InputError(f"inputs have shape {array.shape}; give {_choices(list(allowed))}.")
    return array.reshape(allowed[array.shape])


def _choices(shapes: Sequence[tuple[int, ...]]) -> str:
    """Return the allowed shapes in words, as "one number, shape (3,) or shape (2, 3)"."""
    texts = ["one number" if shape == () else f"shape {shape}" for shape in shapes]
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} or {texts[-1]}"
