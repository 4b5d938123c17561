"""The compiled tangents and adjoints of one stepper as calls on arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from ..bindings.binding import Binding
from ..bindings.real_numbers import aligned
from ..bindings.run_memory import ParameterStruct, Rows, RunState
from ..compilation.quad_wrapper import PREFIX
from ..integration.run_arguments import RunArguments

__all__ = ["DerivativeBinding", "KeptRun", "KeptSteps"]

Array = NDArray[Any]


@dataclass(frozen=True)
class KeptSteps:
    """Steps of a run with all that their derivatives need: states, and unknowns x of each step.

    ``q`` and ``p`` have a row more than ``x``. In a co-moving frame they are those of the frame.
    """

    first: int
    q: Array
    p: Array
    x: Array

    @property
    def count(self) -> int:
        """Number of steps."""
        return len(self.x)


class DerivativeBinding:
    """Calls into the module of derivatives; ``own`` makes its structs, ``primal`` integrates."""

    def __init__(self, own: Binding, primal: Binding, keeps_momentum: bool) -> None:
        self.own, self.primal = own, primal
        own.frames += primal.frames  # for integrate_and_keep, which calls the other module
        self.n = own.n
        #: Whether the scheme keeps f(q, p) = 0.
        self.keeps_momentum = keeps_momentum
        #: Rows of a direction: q, p, parameters, dt, start time.
        self.rows = 2 * own.n + len(own.parameter_names) + 2
        self._size = int(own.function("derivative_size")())

    def memory(self) -> Any:
        """Return memory for one thread."""
        return self.own.ffi.cast("void *", self.own.ffi.from_buffer(
            keep := aligned(self._size))), keep

    def constraint_derivatives(
        self, parameters: ParameterStruct, q: Array, p: Array
    ) -> tuple[Array, Array]:
        """Return the derivatives of g and f, m rows each, by the rows of a direction."""
        own, (memory, _keep) = self.own, self.memory()
        g, f = own.new(own.m, self.rows), own.new(own.m, self.rows)
        if own.m:
            own.function("constraint_derivatives")(
                parameters, own.pointer(q), own.pointer(p), own.pointer(g), own.pointer(f), memory)
        return g, f

    def quantity_derivatives(
        self, parameters: ParameterStruct, t: Any, q: Array, p: Array, *, energy: bool = False
    ) -> Array | None:
        """Return the derivatives of each quantity of a state by the rows of a direction.

        In place of the start time is the time t. None where they are not generated.
        """
        own, size = self.own, self.rows - 1
        if not self._has("quantities_by_state"):
            return None
        count = len(own.quantity_names) + own.clocked
        rows, found = own.new(count, size), own.new(count, self.rows)
        time = own.new(1)
        time[0] = t
        own.function("quantities_by_state")(
            parameters, *([own.pointer(time)] if own.quantities_take_time else []),
            own.pointer(q), own.pointer(p), own.pointer(rows))
        found[:, : size - 1], found[:, -1] = rows[:, : size - 1], rows[:, -1]
        return found[: len(own.quantity_names)] if not energy else found[-1:]

    def energy_derivatives(self, parameters: ParameterStruct, q: Array, p: Array) -> Array:
        """Return the derivatives of H(q, p, t) in scaled time by the rows of a direction."""
        found = self.quantity_derivatives(parameters, 0.0, q, p, energy=True)
        assert found is not None
        row: Array = found[0]
        return row

    def count_switches(
        self, run: RunArguments, parameters: ParameterStruct, steps: KeptSteps
    ) -> int:
        """Return how many of these steps end on another side of a switch of H or the forces."""
        own = self.own
        if not self._has("count_switches"):
            return 0
        return int(own.function("count_switches")(
            parameters, run.dt, steps.first, steps.count, own.pointer(steps.q),
            own.pointer(steps.p)))

    def _has(self, function: str) -> bool:
        """Whether the module has a function that not all systems have."""
        return any(hasattr(self.own.lib, f"{prefix}{self.own.name}_{function}")
                   for prefix in ("", PREFIX))

    def begin(self, run: RunArguments) -> KeptRun:
        """Return a run to be kept, at its start."""
        return KeptRun(self, run)

    def integrate_and_keep(self, run: KeptRun, count: int, q: Array, p: Array, x: Array) -> int:
        """Fill rows of q, p and x with steps of the primal module; return the status."""
        own, primal, arguments = self.own, self.primal, run.run
        address = int(primal.ffi.cast("uintptr_t", primal.ffi.addressof(
            primal.lib, f"{primal.name}_integrate")))
        return int(own.function("integrate_and_keep")(
            address, run.parameters, run.constants.options, *own._fed(arguments.inputs)[:2],
            arguments.dt, count, own.pointer(q), own.pointer(p), own.pointer(x), run.state.record,
            run.state.work))

    def tangent(
        self, parameters: ParameterStruct, dt: Any, q: Array, p: Array, x: Array, dz: Array,
        multipliers: Array,
    ) -> tuple[int, Array]:
        """Return the status and the directions of the end, rows q and p, a column each.

        ``multipliers`` gets those of the multipliers, unless it is empty.
        """
        own, (memory, _keep) = self.own, self.memory()
        ends = own.new(2 * self.n, dz.shape[1])
        status = own.function("tangent")(
            parameters, dt, own.pointer(q), own.pointer(p), own.pointer(x), dz.shape[1],
            own.pointer(dz), own.pointer(ends), own.pointer(multipliers), memory)
        return int(status), ends

    def adjoint(
        self, parameters: ParameterStruct, dt: Any, q: Array, p: Array, x: Array, w: Array,
        multipliers: Array
    ) -> tuple[int, Array]:
        """Return the status and the cotangent of the start.

        ``w`` is that of the end, ``multipliers`` that of the multipliers, or empty.
        """
        own, (memory, _keep) = self.own, self.memory()
        z_bar = own.new(self.rows)
        status = own.function("adjoint")(
            parameters, dt, own.pointer(q), own.pointer(p), own.pointer(x), own.pointer(w),
            own.pointer(multipliers), own.pointer(z_bar), memory)
        return int(status), z_bar

    def integrate_tangent(
        self, run: RunArguments, parameters: ParameterStruct, steps: KeptSteps, dz: Array,
        every: int, rows: Array, multipliers: Array, tangents: Array,
    ) -> int:
        """Advance ``tangents`` by kept steps; each ``every``-th state has a row in ``rows``.

        ``multipliers`` gets those of each step, unless it is empty.
        """
        own, (memory, _keep) = self.own, self.memory()
        return int(own.function("integrate_tangent")(
            parameters, *own._fed(run.inputs)[:2], run.dt, steps.first, steps.count,
            own.pointer(steps.q), own.pointer(steps.p), own.pointer(steps.x), dz.shape[1],
            own.pointer(dz), every, own.pointer(rows), own.pointer(multipliers),
            own.pointer(tangents), memory))

    def integrate_adjoint(
        self, run: RunArguments, parameters: ParameterStruct, steps: KeptSteps, cotangents: Array,
        every: int, multipliers: Array, w: Array, z_bar: Array, inputs_bar: Array,
    ) -> int:
        """Take ``w`` backwards through kept steps and add to ``z_bar``.

        ``multipliers`` has the cotangents of the multipliers of each step, or is empty.
        """
        own, (memory, _keep) = self.own, self.memory()
        fed = [*own._fed(run.inputs)[:2], own.pointer(inputs_bar)] if own.input_names else []
        return int(own.function("integrate_adjoint")(
            parameters, *fed, run.dt, steps.first, steps.count, own.pointer(steps.q),
            own.pointer(steps.p), own.pointer(steps.x), own.pointer(cotangents), every,
            own.pointer(multipliers), own.pointer(w), own.pointer(z_bar), memory))


class KeptRun:
    """A run that is integrated piece by piece, every step of it kept."""

    def __init__(self, binding: DerivativeBinding, run: RunArguments) -> None:
        self.binding, self.run = binding, run
        self.constants = run.constants(binding.own)
        self.state = RunState.at_start(binding.own, run.q, run.p)

    @property
    def parameters(self) -> ParameterStruct:
        """The parameters of the run."""
        return self.constants.parameters

    @property
    def done(self) -> int:
        """Steps done."""
        return self.state.steps

    def keep(self, count: int) -> tuple[KeptSteps, int]:
        """Return the next steps, up to one that fails, and the status."""
        own, state, first = self.binding.own, self.state, self.done
        q, p = own.new(count + 1, own.n), own.new(count + 1, own.n)
        x = own.new(count, own.unknowns)
        q[0], p[0] = state.q, state.p
        status = self.binding.integrate_and_keep(self, count, q, p, x)
        taken = self.done - first
        state.q[:], state.p[:] = q[taken], p[taken]
        return KeptSteps(first, q[: taken + 1], p[: taken + 1], x[:taken]), status


class QuadDerivativeBinding(DerivativeBinding):
    """The same for float128, whose functions cffi calls through others: a call for each step."""

    def integrate_and_keep(self, run: KeptRun, count: int, q: Array, p: Array, x: Array) -> int:
        """Fill rows of q, p and x with steps of the primal module; return the status."""
        own, primal, kept = self.own, self.primal, run.state
        constants, none = run.run.constants(primal), Rows.allocate(primal, 0)
        state = RunState.at_start(primal, q[0], p[0])
        # The run may have been restored to a checkpoint since the last call.
        primal.image(state.work)[:] = own.image(kept.work)
        primal.image(state.record)[:] = own.image(kept.record)
        for j in range(count):
            status = primal.integrate(constants, 1, 1, state, none)
            if status:
                return status
            own.image(kept.work)[:] = primal.image(state.work)
            own.image(kept.record)[:] = primal.image(state.record)
            if hasattr(own.lib, f"{PREFIX}{own.name}_frame_state"):
                own.function("frame_state")(kept.work, state.q, state.p)
            q[j + 1], p[j + 1] = state.q, state.p
            unknowns = own.new(own.unknowns)
            own.function("keep")(kept.work, run.constants.options, own.pointer(unknowns))
            x[j] = unknowns
        return 0
