"""Memory of runs: structs of a compiled module, and arrays that it reads and fills.

Structs are cffi's, of whatever fields a stepper has; their types here keep one from another.
"""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any, NewType, Protocol, Self

import numpy as np

from ...core.arrays import Array
from ...core.errors import InputError
from ...core.records import dataclass
from .inputs import InputRows

if TYPE_CHECKING:
    from .compiled_module import Compiled

__all__ = ["DEFAULT_MEMORY", "BatchMemory", "BatchState", "OptionStruct", "ParameterStruct", "Rows",
           "RunConstants", "RunRecord", "RunState", "WorkMemory"]

#: Bytes that the steps of a run may take for derivatives.
DEFAULT_MEMORY = "256 MB"
#: The parameters of a run, with its start time where something has t; or an array of them.
ParameterStruct = NewType("ParameterStruct", object)
#: Tolerance, iterations at most, solver.
OptionStruct = NewType("OptionStruct", object)
#: What steps need, and leave to the next one: factors, compensation terms, the predictor's history.
WorkMemory = NewType("WorkMemory", object)
#: What a batch of trajectories in the lanes of vector registers needs.
BatchMemory = tuple[object, WorkMemory]


class RunRecord(Protocol):
    """Running record of a run: counts, and numbers of the stepper's type over all its steps."""

    steps: int
    iterations: int
    iterations_max: int
    newton_steps: int
    work: Any
    energy_start: Any
    energy_error_max: Any
    energy_error_sum: Any
    constraint_max: Any
    constraint_sum: Any
    hidden_max: Any
    hidden_sum: Any


@dataclass(frozen=True)
class RunConstants:
    """Constant arguments of the steps of a run; ``dt`` is a column for a batch of runs."""

    parameters: ParameterStruct
    options: OptionStruct
    dt: Any
    inputs: InputRows | None = None


@dataclass(frozen=True)
class RunState:
    """A run after some steps. Compiled code advances all four in place.

    Attributes
    ----------
    q, p : array, shape (n,)
    record : running record
    work : solver memory
    """

    q: Array
    p: Array
    record: RunRecord
    work: WorkMemory

    @classmethod
    def at_start(
        cls, binding: Compiled, q: Array, p: Array, work: WorkMemory | None = None
    ) -> RunState:
        """Return the state before the first step, with copies of q and p, shapes (n,).

        ``work`` may be memory that another run has used; by default it is new.
        """
        return cls(q.copy(), p.copy(), binding.report(), binding.work() if work is None else work)

    @property
    def steps(self) -> int:
        """Steps so far."""
        return int(self.record.steps)

    def nbytes(self, binding: Compiled) -> int:
        """Return the size in bytes of a copy: q, p, the record and the solver memory."""
        return (self.q.nbytes + self.p.nbytes + binding.image(self.record).size
                + binding.image(self.work).size)

    def assign(self, binding: Compiled, source: RunState) -> None:
        """Copy state, record and solver memory from ``source``."""
        self.q[:], self.p[:] = source.q, source.p
        binding.image(self.record)[:] = binding.image(source.record)
        binding.image(self.work)[:] = binding.image(source.work)

    def copy(self, binding: Compiled) -> RunState:
        """Return a copy of the state in new memory."""
        copy = RunState.at_start(binding, self.q, self.p)
        copy.assign(binding, self)
        return copy


@dataclass(frozen=True)
class BatchState:
    """Trajectories side by side after some steps, a row each, as in ``RunState``."""

    q: Array
    p: Array
    records: Any
    status: Array


@dataclass(frozen=True)
class Rows:
    """Stored states of a run, a row each: row 0 is the start, which has no multipliers.

    ``iterations`` are the most of a step since the row before, ``work`` is that of forces since
    the start. Of many runs the first axis counts these.
    """

    q: Array
    p: Array
    multipliers: Array
    iterations: Array
    work: Array

    @classmethod
    def allocate(cls, binding: Compiled, *shape: int) -> Rows:
        """Return zeroed rows with leading axes ``shape``; InputError without memory for them."""
        try:
            return cls(binding.new(*shape, binding.n), binding.new(*shape, binding.n),
                       binding.new(*shape, binding.multipliers), np.zeros(shape, dtype=np.intc),
                       binding.new(*shape))
        except (MemoryError, ValueError) as error:  # ValueError: more than can be addressed
            raise InputError(f"There is no memory for {shape[-1]} states; take fewer steps, or "
                             "keep fewer of their states with a larger every.") from error

    def __getitem__(self, rows: Any) -> Self:
        """Return some of the rows, as NumPy indexes each of the arrays."""
        return type(self)(self.q[rows], self.p[rows], self.multipliers[rows],
                          self.iterations[rows], self.work[rows])

    def assign(self, rows: Any, source: Rows) -> None:
        """Set the rows that the index ``rows`` selects in each array, from ``source``."""
        for field in fields(self):
            getattr(self, field.name)[rows] = getattr(source, field.name)

    def copy(self) -> Self:
        """Return rows of their own memory."""
        return type(self)(*(getattr(self, field.name).copy() for field in fields(self)))

    def with_room(self, binding: Compiled, rows: int) -> Rows:
        """Return these rows in memory for ``rows`` rows."""
        # an array that compiled code writes to cannot grow in place
        larger = Rows.allocate(binding, rows)
        larger.assign(np.s_[: len(self.iterations)], self)
        return larger
