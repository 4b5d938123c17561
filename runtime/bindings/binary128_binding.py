"""A float128 stepper's functions as Python callables on object arrays of mpf.

Each call packs its arrays into bytes, hands pointers to ``quad_wrapper``'s functions, and reads
back the numbers that changed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array
from ..compilation.quad_wrapper import PREFIX
from . import binary128
from .binding import SOLVERS, Binding, SolverName
from .real_numbers import aligned_zeros
from .run_memory import (
    BatchMemory,
    BatchState,
    OptionStruct,
    ParameterStruct,
    Rows,
    RunConstants,
    RunRecord,
    RunState,
    WorkMemory,
)

__all__ = ["QuadBinding"]

#: The numbers at the end of a report, in the header's order.
_COUNTS = 32  # bytes of the whole numbers before them
_RECORDED = ("work", "work_low", "energy_start", "energy_error_max", "energy_error_sum",
             "constraint_max", "constraint_sum", "hidden_max", "hidden_sum")


class QuadBinding(Binding):
    """``Binding`` for float128."""

    def _epsilon(self) -> float:
        """Return the distance from 1 to the next number of binary128."""
        return binary128.EPSILON

    def _function(self, name: str) -> Callable[..., Any]:
        """Return a function of the module that takes arrays and numbers of mpf.

        Each array is packed into bytes for the call, and unpacked after it if C writes to it.
        """
        function = getattr(self.lib, f"{PREFIX}{self.name}_{name}")

        def call(*arguments: Any) -> Any:
            """Call C with copies of arrays and numbers in binary128; read the arrays back."""
            # copies in binary128, for which cffi has no type; None for what C takes as it is
            copies = [_Box(self.ffi, a)
                      if isinstance(a, (np.ndarray, float, binary128.mpf)) else None
                      for a in arguments]
            c_arguments = []
            for a, copy in zip(arguments, copies, strict=True):
                if copy is not None:
                    c_arguments.append(copy.pointer)
                else:
                    c_arguments.append(a.pointer if isinstance(a, (_Block, _Record)) else a)
            c_result = function(*c_arguments)
            for copy in filter(None, copies):
                copy.read_back()
            return c_result

        return call

    def pointer(self, array: Array, start: int = 0) -> Any:
        """Return the argument of a C function for an array: the array, NULL for an empty one."""
        if start:
            raise ValueError("An array of mpf is packed from its first entry on.")
        return array if array.size else self.ffi.NULL

    def new(self, *shape: int) -> Array:
        """Return an array of zeros."""
        return binary128.full(shape)

    def array(self, name: str, value: Any, shape: tuple[int, ...]) -> Array:
        """Return a checked copy of a caller's array as mpf."""
        return binary128.as_quads(name, value, shape)

    def to_real(self, array: Array) -> Array:
        """Return a copy of a caller's numbers as mpf, infinite where they are beyond the type."""
        quads = binary128.full(array.shape)
        quads.flat[:] = [binary128.quad(x) for x in array.flat]
        return quads

    def times(self, t0: Any, dt: Any, steps: Array) -> Array:
        """Return t0 + k dt for each k of ``steps``."""
        times: Array = t0 + steps.astype(object) * dt
        return times

    # ------------------------------------------------------------ structs

    def parameters(self, values: dict[str, Any], t: Any = 0.0) -> ParameterStruct:
        """Return the parameter struct for a run, or a step, that starts at time t."""
        columns = {name: np.array([value], dtype=object) for name, value in values.items()}
        return self.parameter_sets(columns, np.array([t], dtype=object))

    def sets_of(self, rows: Array) -> ParameterStruct:
        """Return rows of ``parameter_rows`` as an array of parameter structs."""
        block = _Block(self.ffi, f"{self.name}_parameters", len(rows))
        block.write(0, binary128.pack([number for row in rows for number in row]))
        return ParameterStruct(block)

    def sets(self, parameters: ParameterStruct) -> int:
        """Return 1: the parameters belong to one run."""
        return 1

    def options(
        self, tolerance: float | None, max_iterations: int, solver: SolverName
    ) -> OptionStruct:
        """Return the options struct; tolerance None means down to round-off.

        Written as bytes, as cffi knows no float128.
        """
        block = _Block(self.ffi, f"{self.name}_options")
        # the tolerance is the first field; the others have types that cffi knows
        block.write(0, binary128.pack([tolerance or 0.0]))
        block.pointer.max_iterations = min(max_iterations, 2**31 - 1)
        block.pointer.solver = SOLVERS[solver]
        return OptionStruct(block)

    def work(self) -> WorkMemory:
        """Return work memory for one thread."""
        return WorkMemory(_Block(self.ffi, f"{self.name}_work"))

    def batch_memory(self) -> BatchMemory:
        """Return the memory of ``integrate_lanes`` for one thread."""
        return _Block(self.ffi, f"{self.name}_batch"), self.work()

    def report(self) -> RunRecord:
        """Return an empty running record."""
        return cast(RunRecord, self.reports(count=1)[0])

    def reports(self, count: int) -> Any:
        """Return empty running records."""
        block = _Block(self.ffi, f"{self.name}_report", count)
        return _Records([_Record(block, i) for i in range(count)])

    def record_of(self, work: WorkMemory) -> RunRecord:
        """Return the running record of the trajectory that work memory holds: a copy."""
        block = _Block(self.ffi, f"{self.name}_report")
        report = self.ffi.cast("char *", self.function("report_of")(work))
        block.write(0, bytes(self.ffi.buffer(report, block.size)))
        return _Record(block, index=0)

    def copy_of(self, report: RunRecord) -> RunRecord:
        """Return the running record itself: it owns its memory."""
        return report

    def image(self, struct: Any) -> NDArray[np.uint8]:
        """Return the bytes of a running record or of work memory, to read and to write."""
        block = struct.block if isinstance(struct, _Record) else struct
        image: NDArray[np.uint8] = block.memory
        return image

    def coefficients(self) -> list[Fraction]:
        """Return the compiled coefficients in the order of the struct, exactly."""
        struct = self.function("coefficients")()
        data = self.ffi.buffer(self.ffi.cast("char *", struct), self.ffi.sizeof(struct[0]))[:]
        return [binary128.exact(entry) for entry in binary128.unpack(data)]

    # ------------------------------------------------------------ calls

    def integrate(
        self, constants: RunConstants, steps: int, every: int, state: RunState, rows: Rows,
        row: int = 0,
    ) -> int:
        """Advance a state in place by up to ``steps`` steps; return the status."""
        # Rows are converted: those of this call, not all that are left.
        return super().integrate(constants, steps, every, state, rows[row : row + steps // every])

    def integrate_lanes(
        self, constants: RunConstants, steps: int, every: int, batch: BatchState, rows: Rows,
        row: int, memory: BatchMemory,
    ) -> None:
        """Advance a batch in place by up to ``steps`` steps, stored from ``row`` of each on."""
        # C would write into packed copies: only the rows of this call are copied, and put back
        places = np.s_[:, row : row + steps // every]
        copies = rows[places].copy()
        super().integrate_lanes(constants, steps, every,
                                replace(batch, records=batch.records.first), copies, row=0,
                                memory=memory)
        rows.assign(places, copies)


class _Box:
    """The bytes of an array or a number, for the time of a call."""

    def __init__(self, ffi: Any, value: Any) -> None:
        """Copy an array of mpmath numbers, or one number, to memory that C can read."""
        self.array = value if isinstance(value, np.ndarray) else np.array([value], dtype=object)
        self.before = binary128.pack(self.array.flat)
        self.memory = aligned_zeros(len(self.before))
        self.memory[:] = np.frombuffer(self.before, dtype=np.uint8)
        self.pointer = ffi.cast("quad *", ffi.from_buffer(self.memory))

    def read_back(self) -> None:
        """Put the numbers that C has changed into the array."""
        after, size = self.memory.tobytes(), binary128.BYTES
        # only what C has changed is decoded, which takes longer than most calls
        if after == self.before:
            return
        for index, i in enumerate(range(0, len(after), size)):
            if after[i : i + size] != self.before[i : i + size]:
                (self.array.flat[index],) = binary128.unpack(after[i : i + size])


class _Block:
    """Zeroed memory for structs, which begin and end with it."""

    def __init__(self, ffi: Any, struct: str, count: int = 1) -> None:
        """Allocate ``count`` structs of the type named ``struct`` in one block."""
        self.size = ffi.sizeof(struct)
        self.memory = aligned_zeros(self.size * count)
        self.pointer = ffi.cast(f"{struct} *", ffi.from_buffer(self.memory))

    def write(self, start: int, data: bytes) -> None:
        """Write bytes at the offset ``start``."""
        self.memory[start : start + len(data)] = np.frombuffer(data, dtype=np.uint8)

    def read(self, start: int) -> Any:
        """Return the number of binary128 at the offset ``start``."""
        return binary128.unpack(self.memory[start : start + binary128.BYTES].tobytes())[0]


def _report_number(field: int) -> property:
    """Return a property for entry ``field`` of ``_RECORDED``, the numbers at the end of a report.
    """

    def start(record: _Record) -> int:
        """Return the offset of the number in the block, in bytes."""
        # ``record.index`` is the place of the report in the block
        end: int = (record.index + 1) * record.block.size
        return end - (len(_RECORDED) - field) * binary128.BYTES

    def read(record: _Record) -> Any:
        """Return the number."""
        return record.block.read(start(record))

    def write(record: _Record, value: Any) -> None:
        """Set the number."""
        record.block.write(start(record), binary128.pack([value]))

    return property(read, write)


def _time_step(offset: int) -> property:
    """Return a property for the smallest step of t in a report, offset 0, or the largest, offset 1.

    Both are the first numbers of a report in scaled time, behind its whole numbers.
    """

    def read(record: _Record) -> Any:
        """Return the step."""
        start = record.index * record.block.size + _COUNTS
        return record.block.read(start + offset * binary128.BYTES)

    return property(read)


def _report_count(name: str) -> property:
    """Return a property for the field ``name`` of a report, a whole number, which cffi knows."""

    def read(record: _Record) -> int:
        """Return the number."""
        return int(getattr(record.pointer, name))

    def write(record: _Record, value: int) -> None:
        """Set the number."""
        setattr(record.pointer, name, value)

    return property(read, write)


class _Record:
    """A running record: the struct's fields, those that cffi does not know as well."""

    steps, iterations, iterations_max, newton_steps = map(
        _report_count, ("steps", "iterations", "iterations_max", "newton_steps"))
    time_step_min, time_step_max = map(_time_step, range(2))
    (work, work_low, energy_start, energy_error_max, energy_error_sum, constraint_max,
     constraint_sum, hidden_max, hidden_sum) = map(_report_number, range(len(_RECORDED)))

    def __init__(self, block: _Block, index: int) -> None:
        """Refer to the struct number ``index`` of a block."""
        self.block, self.index = block, index
        self.pointer = block.pointer + index


class _Records(list[_Record]):
    """Contiguous running records of a batch."""

    @property
    def first(self) -> _Record:
        """The first record of the block, whose pointer is the block's."""
        return self[0]
