"""The compiled tangents and adjoints of one stepper as calls on arrays."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...core.arrays import Array
from ...core.errors import InputError
from ...core.records import dataclass
from ..bindings.binding import Binding
from ..bindings.run_memory import ParameterStruct, Rows, RunState
from ..compilation.quad_wrapper import PREFIX
from ..integration.run_arguments import RunArguments

__all__ = ["DerivativeBinding", "KeptRun", "KeptSteps"]


@dataclass(frozen=True)
class KeptSteps:
    """Steps of a run with all that their derivatives need.

    Attributes
    ----------
    first : int
        Index of the first step in the run.
    q, p : array, shape (count + 1, n)
        The states before, between and after the steps; in a co-moving frame, states of the frame.
    x : array, shape (count, unknowns)
        The solution of each step's equations.
    """

    first: int
    q: Array
    p: Array
    x: Array

    @property
    def count(self) -> int:
        """Number of steps."""
        return len(self.x)


@dataclass(frozen=True)
class ImpactStep(KeptSteps):
    """A step with impacts, whose derivatives are a matrix in place of the equations of a step.

    ``matrix``, shape (2 n, rows), has the derivatives of its end (q₁, p₁) by all rows of a
    direction at its start: q, p, parameters, Δt and t0.
    """

    matrix: Array

    @property
    def count(self) -> int:
        """One step."""
        return 1

    def take_tangents(
        self, dz: Array, every: int, rows: Array, multipliers: Array, tangents: Array
    ) -> int:
        """Advance ``tangents``, (2 n, k), in place: (dq₁, dp₁) = M dz; return the status 0.

        M is ``matrix``; the arguments are as in ``DerivativeBinding.integrate_tangent``.
        """
        self._refuse_multipliers(multipliers)
        tangents[:] = self.matrix @ np.concatenate([tangents, dz[len(tangents) :]])
        if (self.first + 1) % every == 0:
            rows[0] = tangents
        return 0

    def take_adjoint(
        self, cotangents: Array, multipliers: Array, w: Array, z_bar: Array, inputs_bar: Array,
        columns: list[int],
    ) -> int:
        """Take ``w``, (2 n,), backwards in place: (w, z̄_θ) = Mᵀ w; return the status 0.

        M is ``matrix``. The arguments are as in ``DerivativeBinding.integrate_adjoint``;
        ``columns`` are the columns of M that the inputs have.
        """
        self._refuse_multipliers(multipliers)
        cotangent = self.matrix.T @ w
        # inputs of this step: their cotangents belong to its row, and not to parameters
        if len(inputs_bar):
            inputs_bar[0], cotangent[columns] = cotangent[columns], 0
        z_bar[len(w) :] += cotangent[len(w) :]
        w[:] = cotangent[: len(w)] + (cotangents[0] if len(cotangents) else 0)
        return 0

    @staticmethod
    def _refuse_multipliers(multipliers: Array) -> None:
        """Refuse an array of derivatives of multipliers unless it is empty."""
        if multipliers.size:
            raise InputError("Multipliers of a run with impacts are not differentiated; leave "
                             "multipliers out.")


class ConstraintDerivatives(NamedTuple):
    """Derivatives of g and of f at a state, shape (m, rows) each."""

    g: Array
    f: Array


class DerivativeBinding:
    """Calls into the module of derivatives; ``module`` makes its structs, ``primal`` integrates."""

    def __init__(self, binding: Binding, primal: Binding, keeps_momentum: bool) -> None:
        """Take the modules of derivatives and of the steps.

        ``keeps_momentum`` says whether the scheme keeps f(q, p) = 0, the constraints of momenta.
        """
        self.module, self.primal = binding, primal
        binding.frames += primal.frames  # for integrate_and_keep, which calls the other module
        self.n = binding.n
        #: Whether the scheme keeps f(q, p) = 0.
        self.keeps_momentum = keeps_momentum
        #: Rows of a direction: q, p, parameters, dt, start time.
        self.rows = 2 * binding.n + len(binding.parameter_names) + 2
        self._size = int(binding.function("derivative_size")())

    def constraint_derivatives(
        self, parameters: ParameterStruct, q: Array, p: Array
    ) -> ConstraintDerivatives:
        """Return ∂g and ∂f, shape (m, ``rows``) each.

        Column j is the derivative by entry j of a direction, (q, p, parameters, Δt, t).
        """
        binding = self.module
        memory, _owner = binding.bytes_at(self._size)
        g, f = binding.new(binding.m, self.rows), binding.new(binding.m, self.rows)
        if binding.m:
            binding.function("constraint_derivatives")(
                parameters, binding.pointer(q), binding.pointer(p), binding.pointer(g),
                binding.pointer(f), memory)
        return ConstraintDerivatives(g, f)

    def quantity_derivatives(
        self, parameters: ParameterStruct, t: Any, q: Array, p: Array, *, energy: bool = False
    ) -> Array | None:
        """Return the derivatives of each quantity A(q, p, t), shape (quantities, rows).

        Columns are by the entries of a direction, (q, p, parameters, Δt, t), with the time t of the
        state in place of the start time; by Δt they are 0. ``energy`` asks for H alone, shape
        (1, rows), which in scaled time follows the quantities. Returns None where the module has no
        such derivatives.
        """
        binding, size = self.module, self.rows - 1
        if not self._has("quantities_by_state"):
            return None
        count = len(binding.quantity_names) + binding.clocked
        columns, derivatives = binding.new(count, size), binding.new(count, self.rows)
        time = binding.new(1)
        time[0] = t
        binding.function("quantities_by_state")(
            parameters, *([binding.pointer(time)] if binding.quantities_take_time else []),
            binding.pointer(q), binding.pointer(p), binding.pointer(columns))
        # C has no column for Δt
        derivatives[:, : size - 1], derivatives[:, -1] = columns[:, : size - 1], columns[:, -1]
        return derivatives[-1:] if energy else derivatives[: len(binding.quantity_names)]

    def energy_derivatives(self, parameters: ParameterStruct, q: Array, p: Array) -> Array:
        """Return the derivatives of H(q, p, t) in scaled time, shape (rows,)."""
        # in scaled time the time is a coordinate, and t is not read
        derivatives = self.quantity_derivatives(parameters, t=0.0, q=q, p=p, energy=True)
        assert derivatives is not None
        row: Array = derivatives[0]
        return row

    def count_switches(
        self, run: RunArguments, parameters: ParameterStruct, steps: KeptSteps
    ) -> int:
        """Return how many of the steps cross a switch of H or the forces between start and end."""
        binding = self.module
        if not self._has("count_switches"):
            return 0
        return int(binding.function("count_switches")(
            parameters, run.dt, steps.first, steps.count, binding.pointer(steps.q),
            binding.pointer(steps.p)))

    def _has(self, function: str) -> bool:
        """Whether the module has a function that not all systems have."""
        # modules of float128 wrap their functions for cffi, under a prefix
        return any(hasattr(self.module.lib, f"{prefix}{self.module.name}_{function}")
                   for prefix in ("", PREFIX))

    def begin(self, run: RunArguments, first: int = 0) -> KeptRun:
        """Return a run to be kept, at its start, whose first step has the number ``first``."""
        return KeptRun(self, run, first)

    def integrate_and_keep(self, run: KeptRun, count: int, q: Array, p: Array, x: Array) -> int:
        """Fill q and p, (count + 1, n), and x, (count, unknowns), with steps; return the status.

        Row 0 of q and p is the state before. The module of derivatives calls the primal module's
        function by its address, so that steps have the bits of the run.
        """
        binding, primal, arguments = self.module, self.primal, run.run
        address = int(primal.ffi.cast("uintptr_t", primal.ffi.addressof(
            primal.lib, f"{primal.name}_integrate")))
        input_rows_and_hold = binding.input_arguments(arguments.inputs)[:2]
        return int(binding.function("integrate_and_keep")(
            address, run.parameters, run.constants.options, *input_rows_and_hold, arguments.dt,
            count, binding.pointer(q), binding.pointer(p), binding.pointer(x), run.state.record,
            run.state.work))

    def tangent(
        self, parameters: ParameterStruct, dt: Any, q: Array, p: Array, x: Array, dz: Array,
        multipliers: Array,
    ) -> tuple[int, Array]:
        """Return the status, and the directions of the end of a step, shape (2 n, k).

        The step leads from the state (q, p) with the unknowns x; ``dz``, (rows, k), has k
        directions. ``multipliers`` gets the directions of the multipliers, unless it is empty.
        """
        binding = self.module
        memory, _owner = binding.bytes_at(self._size)
        dz_end = binding.new(2 * self.n, dz.shape[1])
        status = binding.function("tangent")(
            parameters, dt, binding.pointer(q), binding.pointer(p), binding.pointer(x), dz.shape[1],
            binding.pointer(dz), binding.pointer(dz_end), binding.pointer(multipliers), memory)
        return int(status), dz_end

    def adjoint(
        self, parameters: ParameterStruct, dt: Any, q: Array, p: Array, x: Array, w: Array,
        multipliers: Array
    ) -> tuple[int, Array]:
        """Return the status, and the cotangent of all rows at the start of a step, (rows,).

        The step leads from the state (q, p) with the unknowns x; ``w``, (2 n,), is the cotangent of
        its end, ``multipliers`` that of its multipliers, or empty.
        """
        binding = self.module
        memory, _owner = binding.bytes_at(self._size)
        z_bar = binding.new(self.rows)
        status = binding.function("adjoint")(
            parameters, dt, binding.pointer(q), binding.pointer(p), binding.pointer(x),
            binding.pointer(w),
            binding.pointer(multipliers), binding.pointer(z_bar), memory)
        return int(status), z_bar

    def integrate_tangent(
        self, run: RunArguments, parameters: ParameterStruct, steps: KeptSteps, dz: Array,
        every: int, rows: Array, multipliers: Array, tangents: Array,
    ) -> int:
        """Advance ``tangents``, shape (2 n, k), by kept steps, in place; return the status.

        ``dz``, (rows, k), has the directions of parameters and times; its rows q and p are not
        read. ``rows``, (stored states, 2 n, k), gets the tangents of each ``every``-th state of the
        run; ``multipliers``, unless it is empty, the tangents of the multipliers of each step.
        """
        if isinstance(steps, ImpactStep):
            return steps.take_tangents(dz, every, rows, multipliers, tangents)
        binding = self.module
        memory, _owner = binding.bytes_at(self._size)
        input_rows_and_hold = binding.input_arguments(run.inputs)[:2]
        return int(binding.function("integrate_tangent")(
            parameters, *input_rows_and_hold, run.dt, steps.first, steps.count,
            binding.pointer(steps.q), binding.pointer(steps.p), binding.pointer(steps.x),
            dz.shape[1],
            binding.pointer(dz), every, binding.pointer(rows), binding.pointer(multipliers),
            binding.pointer(tangents), memory))

    def integrate_adjoint(
        self, run: RunArguments, parameters: ParameterStruct, steps: KeptSteps, cotangents: Array,
        every: int, multipliers: Array, w: Array, z_bar: Array, inputs_bar: Array,
    ) -> int:
        """Take the cotangent ``w`` of (q, p) backwards through kept steps; return the status.

        In place, with the map Φ of a step and its parameters θ (Δt and t0 included), at each step:

            z̄_θ ← z̄_θ + Φ_θᵀ w
            w ← Φ_zᵀ w + the row of ``cotangents``, if the state before the step is stored

        w has the shape (2 n,), ``z_bar`` (rows,). ``inputs_bar`` gets the cotangents of the
        inputs, a row for each step, if the run has inputs. ``multipliers`` has the cotangents of
        the multipliers of each step, or is empty.
        """
        binding = self.module
        memory, _owner = binding.bytes_at(self._size)
        if isinstance(steps, ImpactStep):
            input_columns = [2 * self.n + binding.parameter_names.index(u)
                             for u in binding.input_names]
            return steps.take_adjoint(cotangents, multipliers, w, z_bar, inputs_bar, input_columns)
        # the rows of inputs, how many steps each is held, and their cotangents
        inputs = [*binding.input_arguments(run.inputs)[:2],
                  binding.pointer(inputs_bar)] if binding.input_names else []
        return int(binding.function("integrate_adjoint")(
            parameters, *inputs, run.dt, steps.first, steps.count, binding.pointer(steps.q),
            binding.pointer(steps.p), binding.pointer(steps.x), binding.pointer(cotangents), every,
            binding.pointer(multipliers), binding.pointer(w), binding.pointer(z_bar), memory))


class KeptRun:
    """Run integrated piece by piece; the states and unknowns of every step are stored."""

    def __init__(self, binding: DerivativeBinding, run: RunArguments, first: int) -> None:
        """Begin at the start of ``run``, whose first step has the number ``first``."""
        self.binding, self.run, self.first = binding, run, first
        self.constants = run.constants(binding.module)
        self.state = RunState.at_start(binding.module, run.q, run.p)

    @property
    def parameters(self) -> ParameterStruct:
        """The parameters of the run."""
        return self.constants.parameters

    @property
    def steps_done(self) -> int:
        """The number of the next step."""
        return self.first + self.state.steps

    def keep(self, count: int) -> tuple[KeptSteps, int]:
        """Return the next ``count`` steps, or those before the first that fails, and the status."""
        binding, state, first = self.binding.module, self.state, self.steps_done
        q, p = binding.new(count + 1, binding.n), binding.new(count + 1, binding.n)
        x = binding.new(count, binding.unknowns)
        q[0], p[0] = state.q, state.p
        status = self.binding.integrate_and_keep(self, count, q, p, x)
        completed = self.steps_done - first
        state.q[:], state.p[:] = q[completed], p[completed]
        return KeptSteps(first, q[: completed + 1], p[: completed + 1], x[:completed]), status


class QuadDerivativeBinding(DerivativeBinding):
    """The derivative module of float128: Python takes the primal steps one by one.

    cffi calls functions of float128 through others that take pointers; C cannot call these by
    their address.
    """

    def integrate_and_keep(self, run: KeptRun, count: int, q: Array, p: Array, x: Array) -> int:
        """Fill q, p, (count + 1, n), and x, (count, unknowns), with steps; return the status.

        The primal module has the iteration in float128; this one, in which derivatives are
        compiled, gets state and work memory after each step as images of bytes.
        """
        binding, primal, kept_state = self.module, self.primal, run.state
        constants, no_rows = run.run.constants(primal), Rows.allocate(primal, 0)
        state = RunState.at_start(primal, q[0], p[0])
        # The run may have been restored to a checkpoint since the last call.
        primal.image(state.work)[:] = binding.image(kept_state.work)
        primal.image(state.record)[:] = binding.image(kept_state.record)
        for j in range(count):
            status = primal.integrate(constants, steps=1, every=1, state=state, rows=no_rows)
            if status:
                return status
            binding.image(kept_state.work)[:] = primal.image(state.work)
            binding.image(kept_state.record)[:] = primal.image(state.record)
            # in a co-moving frame the kept states are of the frame
            if hasattr(binding.lib, f"{PREFIX}{binding.name}_frame_state"):
                binding.function("frame_state")(kept_state.work, state.q, state.p)
            q[j + 1], p[j + 1] = state.q, state.p
            unknowns = binding.new(binding.unknowns)
            binding.function("keep")(kept_state.work, run.constants.options,
                                     binding.pointer(unknowns))
            x[j] = unknowns
        return 0
