"""The compiled module of one stepper: pointers, structs, and the calls that do whole runs.

With ``binding`` the only file that touches cffi pointers. Arrays reaching it have been checked:
contiguous, of the stepper's own type. cffi releases the GIL during every call.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from fractions import Fraction
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Array
from ...core.manifest import Manifest
from ...core.real_types import REALS
from ...core.solver import SolverName
from ..compilation.call_stack import on_large_stack
from ..compilation.newton_library import raise_library_errors
from .array_checks import as_array, as_numbers, converted_to
from .inputs import InputRows
from .real_numbers import aligned_zeros, rounding
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

__all__ = ["CORES", "SOLVERS", "Compiled", "Pool", "SolverName"]

#: Processors of this machine, asked for once: os.cpu_count() takes as long as some steps.
CORES = os.cpu_count() or 1
#: Bytes of a kind of memory that are kept for the next call, if not that of one thread.
_KEPT = 2**28
#: Solver → its number in the generated enum.
SOLVERS: dict[SolverName, int] = {"auto": 0, "newton": 1, "fixed-point": 2}


class Pool:
    """Pool of work memory for compiled calls; it is reused, and not cleared.

    Whoever takes some gives it back, unless a call was interrupted; threads may share a pool.
    """

    def __init__(self, make: Callable[[], Any], size: int) -> None:
        """``make`` allocates new memory; ``size``, in bytes, bounds how much is kept."""
        self._make, self._free = make, list[Any]()
        self._most = max(1, min(CORES, _KEPT // size))

    def take(self) -> Any:
        """Take unused memory from the pool, or allocate it."""
        try:
            return self._free.pop()
        except IndexError:
            return self._make()

    def give_back(self, memory: Any) -> None:
        """Keep memory for the next ``take``, or drop it if the pool is full.

        The pool is full with one memory for each core, or with 2²⁸ bytes.
        """
        if len(self._free) < self._most:
            self._free.append(memory)


class Compiled:
    """Calls into a compiled module; one instance may serve many threads.

    Work memory has about 8 U² bytes for U unknowns; most of them are Newton's method's.
    """

    def __init__(self, module: Any, name: str, manifest: Manifest) -> None:
        """Take a loaded module of cffi, and the sizes and features of its stepper, once."""
        self.ffi, self.lib, self.name = module.ffi, module.lib, name
        self._from_buffer = self.ffi.from_buffer
        self._functions: dict[str, Callable[..., Any]] = {}
        self._newton_apart = hasattr(self.lib, f"{name}_newton_table")
        #: Types of the structs: cffi takes as long to look up a name as to make the struct.
        self._types = {kind: self.ffi.typeof(f"{name}_{kind} *")
                       for kind in ("parameters", "options", "report")}
        self._types["int[]"] = self.ffi.typeof("int[]")
        frames = getattr(module, "frames", None)
        #: Bytes of stack that calls take at most; work memory is larger than all their arrays.
        self.frames: int = 2 * self.ffi.sizeof(f"{name}_work") if frames is None else frames
        real = REALS[manifest.real]
        self.c_type, self.dtype = real.c_type, real.dtype
        self._reals = None if self.dtype is object else self.ffi.typeof(f"{self.c_type}[]")
        #: Distance from 1 to the next number of the stepper's type.
        self.epsilon = self._epsilon()
        #: Rounds a fraction to the stepper's own type; where that is float, to double.
        self.number = rounding(manifest.real)
        self._read_sizes(manifest)
        #: Trajectories that one call of ``integrate_lanes`` takes; 0 where there is no fast path.
        self.lanes = int(self.function("lanes")()) if manifest.fast_path.available else 0
        self._report_type: np.dtype[Any] | None = None
        #: Memory of ``integrate``, and of ``integrate_lanes``.
        size = self.ffi.sizeof(f"{self.name}_work")
        self.works, self.batches = Pool(self.work, size), Pool(self.batch_memory, size)

    def _read_sizes(self, manifest: Manifest) -> None:
        """Read the numbers of coordinates, constraints, unknowns and multipliers."""
        system = manifest.system
        self.parameter_names = list(system.parameters)
        #: Those of them that may change from step to step.
        self.input_names = list(system.inputs)
        #: Whether the last coordinate is the time of a system in scaled time, which is not shown.
        self.clocked = system.clock is not None
        #: Coordinates of the compiled code, and those that are shown.
        self.shown = len(system.coordinates)
        self.n = self.shown + self.clocked
        self.m = len(system.constraints)
        #: Velocity constraints, and all conditions on momenta: these and the hidden constraints.
        self.rows = len(system.velocity_constraint_names)
        self.conditions = self.m + self.rows
        self.has_forces = bool(system.forces)
        #: The field of the parameters with the time at the start; None where nothing has t.
        self.time: str | None = system.time
        #: Whether H or g has t, so that what is asked of a state is asked at a time.
        self.is_timed = bool(system.time_in_H_or_g)
        self.quantity_names = list(system.quantities)
        #: Which of them is σ = dt/dτ.
        self.scale_place = (-1 if system.clock is None
                            else self.quantity_names.index(system.clock.scale))
        self.quantities_take_time = bool(system.quantities_take_time)
        self.unknowns = int(manifest.scheme.unknowns)
        #: How many multipliers a step has, and how many of them are of velocity constraints.
        self.reactions = int(manifest.scheme.reactions) * self.rows
        self.multipliers = int(manifest.scheme.multipliers) * self.m + self.reactions
        #: Whether a step solves equations; a composition of exact flows does not.
        self.solves = manifest.scheme.kind != "splitting"
        #: Whether the unknowns are increments of the state, and residuals are rates.
        self.solves_increments = bool(manifest.scheme.unknowns_are_state)
        #: The unknowns that are rates of momenta, or their increments: behind as many of q, n of
        #: each stage; a scheme without a tableau has one.
        self.kicks = slice(*(self.n * k * (manifest.scheme.stages or 1) for k in (1, 2)))

    def _epsilon(self) -> float:
        """Return the distance from 1 to the next number of the stepper's type."""
        return float(np.finfo(self.dtype).eps)

    @property
    def number_type(self) -> Any:
        """NumPy's type for columns of such numbers as ``number`` makes."""
        return np.float64 if self.dtype is np.float32 else self.dtype

    def function(self, name: str) -> Any:
        """Return a function of the module by its name without prefix, on a large stack."""
        function = self._functions.get(name)
        if function is None:
            compiled = self._function(name)
            # Newton's method may be a module of its own, loaded when a call asks for it
            compiled = raise_library_errors(compiled) if self._newton_apart else compiled
            # looked up once for all calls
            function = self._functions[name] = on_large_stack(compiled, self.frames)
        return function

    def _function(self, name: str) -> Callable[..., Any]:
        """Return a function of the C; long doubles are passed as numbers that cffi takes."""
        function: Callable[..., Any] = getattr(self.lib, f"{self.name}_{name}")
        # cffi takes all other numbers as they are
        if self.dtype is not np.longdouble:
            return function
        return lambda *arguments: function(*map(self._cffi_value, arguments))

    def _cffi_value(self, argument: Any) -> Any:
        """Return a NumPy long double as a cffi value: cffi itself would round it to double.

        Other arguments are returned unchanged.
        """
        if not isinstance(argument, np.longdouble):
            return argument
        box = self.ffi.new("long double *")
        np.frombuffer(self.ffi.buffer(box), dtype=np.longdouble)[0] = argument
        return box[0]

    def pointer(self, array: Array, start: int = 0) -> Any:
        """Return a pointer to entry ``start`` of a checked array; NULL for an empty array."""
        if array.size == 0:
            return self.ffi.NULL
        address = self._from_buffer(self._reals, array, True)  # no read-only array
        return address + start if start else address

    def parameters(self, values: dict[str, Any], t: Any = 0.0) -> ParameterStruct:
        """Return the parameter struct for a run, or a step, that starts at time t."""
        fields = [*map(values.__getitem__, self.parameter_names)]
        if self.time is not None:
            fields.append(t)
        if self.dtype is np.longdouble:
            fields = [*map(self._cffi_value, fields)]
        return ParameterStruct(self.ffi.new(self._types["parameters"], fields))

    def work(self) -> WorkMemory:
        """Return zeroed solver memory of one run; it persists between calls that continue the run.
        """
        struct = f"{self.name}_work"
        return WorkMemory(
            self.ffi.from_buffer(f"{struct} *", aligned_zeros(self.ffi.sizeof(struct))))

    def bytes_at(self, size: int) -> tuple[Any, Any]:
        """Return the address of aligned memory of ``size`` bytes, and the array that owns it.

        The array must outlive a call with the address.
        """
        array = aligned_zeros(size)
        return self.ffi.cast("void *", self.ffi.from_buffer(array)), array

    def options(
        self, tolerance: float | None, max_iterations: int, solver: SolverName
    ) -> OptionStruct:
        """Return the options struct; tolerance None means down to round-off."""
        return OptionStruct(self.ffi.new(self._types["options"], [
            self._cffi_value(tolerance or 0.0), min(max_iterations, 2**31 - 1), SOLVERS[solver]]))

    def report(self) -> RunRecord:
        """Return an empty running record."""
        return cast(RunRecord, self.ffi.new(self._types["report"]))

    def record_of(self, work: WorkMemory) -> RunRecord:
        """Return the running record of the trajectory that work memory holds: a copy."""
        return self.copy_of(self.function("report_of")(work)[0])

    def copy_of(self, report: RunRecord) -> RunRecord:
        """Return a copy of a running record; an entry of ``reports`` does not own its memory."""
        return cast(RunRecord, self.ffi.new(f"{self.name}_report *", report))

    def work_done(self, record: RunRecord) -> Any:
        """Return the work of the forces up to a running record, in J: 0 without forces."""
        if not self.has_forces:
            return 0.0
        if self.dtype is not np.longdouble:
            return record.work
        # float() of cffi's long double would round it to double
        return np.frombuffer(self.ffi.buffer(self.ffi.addressof(record, "work")), self.dtype)[0]

    def image(self, struct: RunRecord | WorkMemory) -> NDArray[np.uint8]:
        """Return the bytes of a running record or of work memory, to read and to write."""
        return np.frombuffer(self.ffi.buffer(struct), dtype=np.uint8)

    def clear_padding(self, report: RunRecord, work: WorkMemory) -> None:
        """Set padding bytes of both to zero, so that equal runs have equal images."""
        if self.c_type == "long double":  # no other type has any that compiled code writes to
            self.function("clear_padding")(report, work)

    def new(self, *shape: int) -> Array:
        """Return a zeroed array of the stepper's type."""
        return np.zeros(shape, dtype=self.dtype)

    def array(self, name: str, value: Any, shape: tuple[int, ...]) -> Array:
        """Return a checked copy of a caller's array in the stepper's type."""
        return as_array(name, value, shape, self.dtype)

    def numbers(self, name: str, value: Any) -> Array:
        """Return a caller's numbers, of whatever shape and real type, as an array."""
        return as_numbers(name, value)

    def to_real(self, array: Array) -> Array:
        """Return a copy of a caller's numbers in the stepper's type, infinite beyond its range."""
        return converted_to(self.dtype, array)

    def times(self, t0: Any, dt: Any, steps: Array) -> Array:
        """Return t0 + k dt for each k of ``steps``, in the type of ``number``."""
        times: Array = t0 + steps * dt
        return times

    def coefficients(self) -> list[Fraction]:
        """Return the compiled coefficients in the order of the struct, exactly."""
        struct = self.function("coefficients")()
        array = np.frombuffer(self.ffi.buffer(struct), dtype=self.dtype)
        return [Fraction(*entry.as_integer_ratio()) for entry in array]

    # ------------------------------------------------------------ calls

    def integrate(
        self, constants: RunConstants, steps: int, every: int, state: RunState, rows: Rows,
        row: int = 0,
    ) -> int:
        """Advance a state in place by up to ``steps`` steps; return the status.

        Every ``every``-th state is stored, from ``row`` on; without rows none is.
        """
        pointer, start = self.pointer, self.n * row
        work = [pointer(rows.work, row)] if self.has_forces else []
        counts = (self.ffi.NULL if rows.iterations.size == 0
                  else self._from_buffer(self._types["int[]"], rows.iterations,
                                         require_writable=True) + row)
        return int(self.function("integrate")(
            constants.parameters, constants.options, *self.input_arguments(constants.inputs)[:2],
            constants.dt, steps, every, pointer(state.q), pointer(state.p),
            pointer(rows.q, start), pointer(rows.p, start),
            pointer(rows.multipliers, self.multipliers * row), counts, *work, state.record,
            state.work,
        ))

    def integrate_short(
        self, constants: RunConstants, q: Array, p: Array, steps: int, every: int
    ) -> tuple[int, RunState, Callable[[], Rows]]:
        """Take ``steps`` steps from (q, p), which stay; return the status and the state after them.

        The function returned reads the stored rows. All numbers are in one array, whose parts are
        views when they are asked for: NumPy takes as long for a few as C for a step. Not for
        float128, whose arrays are packed for each call.
        """
        n, row_count = self.n, steps // every + 1
        # the state, and rows of q, of p, of multipliers and of work, one behind the other
        p_rows = (2 + row_count) * n
        multiplier_rows = p_rows + row_count * n
        work_rows = multiplier_rows + row_count * self.multipliers
        block = np.zeros(work_rows + row_count, dtype=self.dtype)
        q_end, p_end = block[:n], block[n : 2 * n]
        q_end[:], p_end[:] = q, p
        counts = self.ffi.new(self._types["int[]"], row_count)
        state = RunState(q_end, p_end, self.report(), self.works.take())
        start = self._from_buffer(self._reals, block, require_writable=True)
        # C writes from row 1 of each on: row 0 is the start
        status = self.function("integrate")(
            constants.parameters, constants.options, *self.input_arguments(constants.inputs)[:2],
            constants.dt, steps, every, start, start + n, start + 3 * n, start + (p_rows + n),
            start + (multiplier_rows + self.multipliers), counts + 1,
            *([start + (work_rows + 1)] if self.has_forces else []), state.record, state.work)
        self.works.give_back(state.work)

        def rows() -> Rows:
            """Return the rows of the run, the start in the first of them."""
            q_column, p_column, multipliers = (
                block[start:end].reshape(row_count, -1) for start, end in (
                    (2 * n, p_rows), (p_rows, multiplier_rows), (multiplier_rows, work_rows)))
            q_column[0], p_column[0] = q, p
            iterations = np.frombuffer(self.ffi.buffer(counts), dtype=np.intc)
            return Rows(q_column, p_column, multipliers, iterations, block[work_rows:])

        return int(status), state, rows

    def input_arguments(self, inputs: InputRows | None) -> list[Any]:
        """Return the arguments for inputs: rows, steps that each is held, rows from run to run.

        Functions of one run take the first two. No arguments of a system without inputs.
        """
        if not self.input_names:
            return []
        if inputs is None:
            return [self.ffi.NULL, 0, 0]
        return [self.pointer(inputs.values), inputs.hold, inputs.stride]

    def batch_memory(self) -> BatchMemory:
        """Return the memory of ``integrate_lanes`` for one thread."""
        return self.ffi.new(f"{self.name}_batch *"), self.work()

    def reports(self, count: int) -> Any:
        """Return empty running records."""
        return self.ffi.new(f"{self.name}_report[]", count)

    def parameter_sets(self, columns: dict[str, Array], times: Array) -> ParameterStruct:
        """Return an array of parameter structs, for runs that start at those times."""
        return self.sets_of(self.parameter_rows(columns, times))

    def sets_of(self, rows: Array) -> ParameterStruct:
        """Return rows of ``parameter_rows`` as an array of parameter structs."""
        return ParameterStruct(self.ffi.from_buffer(f"{self.name}_parameters[]", rows))

    def parameter_rows(self, columns: dict[str, Array], times: Array) -> Array:
        """Return the numbers of ``parameter_sets``, a row for each struct."""
        fields = [*(columns[name] for name in self.parameter_names),
                  *([] if self.time is None else [times])]
        rows = self.new(len(times), max(len(fields), 1))  # a struct of C has one field at least
        with np.errstate(over="ignore"):  # numbers beyond the type become infinite
            for column_index, column in enumerate(fields):
                rows[:, column_index] = column
        return rows

    def integrate_lanes(
        self, constants: RunConstants, steps: int, every: int, batch: BatchState, rows: Rows,
        row: int, memory: BatchMemory,
    ) -> None:
        """Advance a batch in place by up to ``steps`` steps; a run that fails stays where it is.

        Every ``every``-th state of each run is stored in ``rows``, from index ``row`` on.
        """
        work = [self.pointer(rows.work, row)] if self.has_forces else []
        counts = self.ffi.from_buffer("int[]", rows.iterations, require_writable=True)
        places = [self.pointer(array, row * width) for array, width in (
            (rows.q, self.n), (rows.p, self.n), (rows.multipliers, self.multipliers))]
        self.function("integrate_lanes")(
            len(constants.dt), constants.parameters, constants.options,
            *self.input_arguments(constants.inputs), self.pointer(constants.dt), steps, every,
            rows.q.shape[1], self.pointer(batch.q), self.pointer(batch.p), *places, counts + row,
            *work, batch.records,
            self.ffi.from_buffer("int[]", batch.status, require_writable=True), *memory,
        )

    @property
    def report_type(self) -> np.dtype[Any]:
        """The running record's fields as a record type of NumPy; made when first asked for."""
        if self._report_type is None:
            self._report_type = self._record_dtype()
        return self._report_type

    def _record_dtype(self) -> np.dtype[Any]:
        """Return the C struct of reports as NumPy's record type, with cffi's offsets."""
        # fields of all other C types are numbers of the stepper's type
        kinds = {"long": np.dtype("l"), "int": np.dtype("i")}
        struct = self.ffi.typeof(f"{self.name}_report")
        fields = dict(struct.fields)
        return np.dtype({
            "names": list(fields), "offsets": [f.offset for f in fields.values()],
            "formats": [kinds.get(f.type.cname, np.dtype(self.dtype)) for f in fields.values()],
            "itemsize": self.ffi.sizeof(struct),
        })

    def integrate_many(
        self, parameters: Array, options: OptionStruct, dt: Array, steps: int, every: int,
        q: Array, p: Array, out: tuple[Array, ...] | None, memory: BatchMemory | tuple[WorkMemory],
    ) -> tuple[Array, Array]:
        """Advance the rows of q and p in place by whole runs; return records and statuses.

        ``parameters`` has a row for each trajectory, in the order of ``parameter_names``, with the
        time at the start behind them where something depends on time. ``out`` are arrays for the
        stored states of q and p, or None. The records have one entry per trajectory; a status of 0
        is success.
        """
        count = len(dt)
        reports = np.zeros(count, dtype=self.report_type)
        status = np.zeros(count, dtype=np.intc)
        structs = self.ffi.from_buffer(f"{self.name}_parameters[]", parameters)
        q_out, p_out = (self.ffi.NULL, self.ffi.NULL) if out is None else map(self.pointer, out)
        self.function("integrate_many")(
            count, structs, options, *self.input_arguments(inputs=None), self.pointer(dt), steps,
            every, self.pointer(q), self.pointer(p), q_out, p_out,
            self.ffi.from_buffer(f"{self.name}_report[]", reports, require_writable=True),
            self.ffi.from_buffer("int[]", status, require_writable=True), *memory)
        return reports, status

    def many_memory(self) -> BatchMemory | tuple[WorkMemory]:
        """Return the memory of ``integrate_many`` for one thread."""
        return self.batch_memory() if self.lanes else (self.work(),)
