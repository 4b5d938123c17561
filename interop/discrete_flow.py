"""N steps as a function of one vector, its tangent and its adjoint: what other libraries call.

    F(x) = Φᴺ(π(q, p); θ, Δt, t0, u),   x = (q, p, θ, Δt, t0, u_1 … u_N)

π is the projection onto the constraints (``Stepper.project``): libraries differentiate along every
coordinate, and optimisers leave the constraints on their way. At a consistent start the derivatives
are exact. Off the constraints they are those at the projected start, which differ from the
derivative of F by the order of the distance.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ..core.arguments import shown, unknown
from ..core.arrays import Array
from ..core.errors import GyrosparkError, InputError
from ..runtime.bindings.array_checks import as_positive_count
from ..runtime.bindings.binding import REASONS
from ..runtime.bindings.inputs import InputRows
from ..runtime.bindings.run_memory import DEFAULT_MEMORY, Rows, RunState
from ..runtime.derivatives.binding import KeptRun, KeptSteps
from ..runtime.derivatives.frame import FrameMotion
from ..runtime.derivatives.gradient import as_bytes, backwards
from ..runtime.derivatives.kept_steps import linearisation_error, pieces, split
from ..runtime.derivatives.second_order import CotangentSlopes, pulled_back_slope
from ..runtime.derivatives.tangent_space import TangentSpace
from ..runtime.integration.consistency import refuse_singular_mass
from ..runtime.integration.run_arguments import RunArguments
from ..runtime.steppers.stepper import Stepper

__all__ = ["DiscreteFlow"]

#: A start this near its projection, in ε of its size, is consistent and taken as it is.
_CONSISTENT = 64
#: Tangents that cost as much as an adjoint.
_MANY = 8
#: Nodes and weights of the central difference of order 4; its step is ε^(1/5).
_DIFFERENCE = ((1, 2 / 3), (2, -1 / 12))


class DiscreteFlow:
    """N steps of a stepper as a function F of one vector x, for rows of many x.

    Calls from several threads are safe: each makes its own memory.

    Attributes
    ----------
    stepper : Stepper
    steps : int
        N.
    names : list of str
        The parameters θ in the order of x: those of the stepper without its inputs.
    input_names : list of str
        The inputs u; each step has its own.
    fields : dict of str to slice
        The slices of x of "q", "p", "parameters", "dt", "t0", "inputs".
    size : int
        Numbers in x.
    failures : deque of str
        The reasons of the last 16 rows at most that are NaN.
    """

    def __init__(self, stepper: Stepper, steps: int, *, exact: bool = True) -> None:
        """Lay out x = (q, p, parameters, dt, t0, inputs), and find the row of each of its entries
        in a direction of the compiled code.
        """
        if not isinstance(stepper, Stepper):
            raise InputError(f"step = {shown(stepper)} is no stepper; give one of "
                             "gyrospark.stepper(...).")
        if stepper.manifest.real != "double":
            raise InputError(f"{stepper.name} computes in {stepper.manifest.real}, and other "
                             "libraries in double; give a stepper with real=\"double\".")
        stepper._refuse_scaled(interop="steps in another library")
        self.stepper = stepper
        #: Whether second derivatives are exact; else differences.
        self.exact = exact
        self.steps = as_positive_count("steps", steps, minimum=1)
        binding = stepper.binding
        self.n, self.input_names = stepper.n, binding.input_names
        self.names = [name for name in binding.parameter_names if name not in self.input_names]
        self.fields: dict[str, slice] = {}
        self.size = 0
        for name, width in (("q", self.n), ("p", self.n), ("parameters", len(self.names)),
                            ("dt", 1), ("t0", 1), ("inputs", self.steps * len(self.input_names))):
            self.fields[name] = slice(self.size, self.size + width)
            self.size += width
        self.failures: deque[str] = deque(maxlen=16)
        # A direction dz of the compiled code has the rows q, p, all parameters, Δt and t0; the
        # inputs of a step are among the parameters. ``_fixed_rows`` has the row of each entry of x
        # before the inputs, in the order of x; ``_input_rows`` the row of each input of a step.
        row_of = {name: 2 * self.n + i for i, name in enumerate(binding.parameter_names)}
        self._row_count = len(row_of) + 2 * self.n + 2
        self._fixed_rows = np.array([*range(2 * self.n), *(row_of[name] for name in self.names),
                                     self._row_count - 2, self._row_count - 1])
        self._input_rows = np.array([row_of[name] for name in self.input_names], dtype=int)

    # ------------------------------------------------------------ F, F'dx, F'ᵀw

    def value(self, x: Array) -> Array:
        """Return F of each row of x: shape (rows, 2 n), q beside p; NaN where a step fails."""
        return self._of_rows(self._value, 2 * self.n, x)

    def tangent(self, x: Array, dx: Array) -> Array:
        """Return F'(x) dx, shape (rows, k, 2 n), of directions dx, shape (rows, k, size)."""
        self.compile()
        return self._of_rows(self._tangent, (dx.shape[1], 2 * self.n), x, dx)

    def adjoint(self, x: Array, w: Array) -> Array:
        """Return F'(x)ᵀ w, shape (rows, k, size), of cotangents w, shape (rows, k, 2 n)."""
        self.compile()
        return self._of_rows(self._adjoint, (w.shape[1], self.size), x, w)

    def jacobian(self, x: Array) -> Array:
        """Return F'(x), shape (rows, 2 n, size), by tangents, or by adjoints for many inputs.

        All tangents share one factorisation of a step, and each adjoint has its own.
        """
        if self.size > _MANY * 2 * self.n:
            return self.adjoint(x, np.repeat(np.eye(2 * self.n)[None], len(x), axis=0))
        return self.tangent(x, np.repeat(np.eye(self.size)[None], len(x), axis=0)).swapaxes(1, 2)

    def second(self, linear: Callable[..., Array], x: Array, v: Array, dx: Array) -> Array:
        """Return the derivative of ``linear(x, v)`` by x along dx.

        ``linear`` is ``tangent`` or ``adjoint``; dx has the shape (rows, k, size), a direction for
        each v. The directions of the start are projected onto the constraints. Exact, or by central
        differences of order 4.
        """
        self.compile(second=True)
        width = self.size if linear == self.adjoint else 2 * self.n
        if self.exact:
            exact_derivative = (
                self._second_adjoint if linear == self.adjoint else self._second_tangent)
            return self._of_rows(exact_derivative, (v.shape[1], width), x, v, dx)

        return self._of_rows(partial(self._second_difference, linear), (v.shape[1], width),
                             x, v, dx)

    def _second_difference(
        self, linear: Callable[..., Array], x: Array, v: Array, dx: Array
    ) -> Array:
        """Return d/dh linear(x + h dx, v) at h = 0 of one x, a row for each pair of v and dx.

        Central differences of order 4 from the projected start, along the projected dx: Σ_k w_k
        (linear(x + c_k h dx, v) − linear(x − c_k h dx, v))/h with the (c_k, w_k) of _DIFFERENCE.
        """
        run = self._run(x)
        start = np.concatenate([run.q, run.p, x[2 * self.n :]])
        _, space = self._stored_run(run)
        projected = self._project(space, dx[:, : self._fixed_rows.size])
        directions = np.concatenate([projected.T[:, self._fixed_rows],
                                     dx[:, self._fixed_rows.size :]], axis=1)
        # ε^(1/5) of the largest relative change balances truncation ∝ h⁴ and round-off ∝ ε/h
        relative_changes = (np.abs(directions) / self._sizes(start)).max(axis=1, initial=0)
        h = np.finfo(float).eps ** 0.2 / np.maximum(relative_changes, np.finfo(float).tiny)
        h[~directions.any(axis=1)] = 1  # a direction 0, whose derivative is 0 with any h
        derivative: Array = sum(
            sign * weight / h[:, None]
            * linear(start + sign * node * h[:, None] * directions, v[:, None])[:, 0]
            for node, weight in _DIFFERENCE for sign in (1, -1))
        return derivative

    def compile(self, *, second: bool = False) -> None:
        """Compile the derivatives, with ``second`` those of second order too where they are exact.

        A stepper that has none, and a compiler that fails, are no failures of a row. Raises
        InputError and CompilerError.
        """
        _ = self.stepper._derivative_binding()
        if second and self.exact:
            _ = self.stepper._second_binding()

    # ------------------------------------------------------------ x from its parts

    def parameters(self, parameters: Mapping[str, Any]) -> list[Any]:
        """Return the values of a dict in the order of ``names``; rates left out are 0.

        Raises InputError for missing and unknown names, and for text in place of a number.
        """
        rates = {symmetry.name for symmetry in self.stepper.symmetries}
        for name, number in parameters.items():
            if name not in self.names:
                raise unknown("parameter", name, self.names)
            if isinstance(number, str):
                raise InputError(f"Parameter {name} = {number!r} is no number; give one, such as "
                                 "gs.gamma(inertia).")
        unset = [name for name in self.names if name not in parameters and name not in rates]
        if unset:
            raise InputError(f"Parameter {unset[0]!r} is not given; this stepper needs "
                             f"{', '.join(name for name in self.names if name not in rates)}.")
        return [parameters.get(name, 0.0) for name in self.names]

    # ------------------------------------------------------------ one row

    def _of_rows(self, function: Callable[..., Array], shape: int | tuple[int, ...],
                 *arrays: Array) -> Array:
        """Return ``function`` of each row of the arrays, shape (rows, *shape).

        A row that fails is NaN, and its reason is appended to ``failures``.
        """
        results = np.full((len(arrays[0]), *np.atleast_1d(shape)), np.nan)
        inputs = [np.array(array, dtype=float) for array in arrays]  # compiled code may write
        for i, row_arguments in enumerate(zip(*inputs, strict=True)):
            try:
                with np.errstate(all="ignore"):
                    results[i] = function(*row_arguments)
            except (GyrosparkError, np.linalg.LinAlgError) as error:
                self.failures.append(str(error))
        return results

    def _run(self, x: Array) -> RunArguments:
        """Return the run of one x = (q, p, θ, Δt, t0, u_1 … u_N), whose start is projected."""
        stepper, binding = self.stepper, self.stepper.binding
        q, p, parameters, (dt,), (t0,), inputs = (x[field_slice]
                                                  for field_slice in self.fields.values())
        if not np.isfinite(x).all():
            raise InputError("x has entries that are not finite.")
        if not dt:
            raise InputError("dt = 0 is no time step; give another number.")
        parameter_values = dict(zip(self.names, parameters.tolist(), strict=True))
        input_rows = np.ascontiguousarray(inputs.reshape(1, self.steps, -1))
        # inputs are among the parameters of the C, which those of each step then replace
        parameter_values |= dict(zip(self.input_names, input_rows[0, 0].tolist(), strict=True))
        run = RunArguments(
            q=q.copy(), p=p.copy(), dt=float(dt), steps=self.steps, every=self.steps,
            parameters=stepper.check_parameters(parameter_values),
            solver="auto", tolerance=None, max_iterations=50, t0=float(t0),
            inputs=InputRows(self.input_names, input_rows, hold=1) if self.input_names else None)
        refuse_singular_mass(binding, stepper.manifest, run)
        if not binding.conditions:
            return run
        q, p = stepper._project(run.q, run.p, binding.parameters(run.parameters, run.t0))
        if not stepper.manifest.scheme.keeps_momentum_constraint:
            p = run.p  # of IMS and EMS f oscillates at their truncation error
        # a consistent start keeps its bits, so that F is that of ``integrate``
        return replace(run, q=_unless_near(run.q, q), p=_unless_near(run.p, p))

    def _value(self, x: Array) -> Array:
        """Return F(x) = (q, p) after all steps, for one x."""
        run, binding = self._run(x), self.stepper.binding
        state = RunState.at_start(binding, run.q, run.p)
        status = binding.integrate(run.constants(binding), run.steps, run.every, state,
                                   Rows.allocate(binding, 0))
        if status:
            raise GyrosparkError(f"Step {state.steps + 1} of {self.steps} failed: "
                                 f"{REASONS[status]}.")
        return np.concatenate([state.q, state.p])

    def _stored_run(self, run: RunArguments) -> tuple[KeptRun, TangentSpace]:
        """Return the run at its start, for its steps to be kept, and the tangent space there."""
        binding = self.stepper._derivative_binding()
        stored_run = binding.begin(run)
        return stored_run, TangentSpace(binding, stored_run.parameters, run.q, run.p,
                                        self.stepper.constraint_names)

    def _tangent(self, x: Array, dx: Array) -> Array:
        """Return F'(x) dx, shape (k, 2 n), for one x and k directions: tangents step by step."""
        run, binding = self._run(x), self.stepper._derivative_binding()
        stored_run, space = self._stored_run(run)
        fixed_count, count = self._fixed_rows.size, len(dx)
        input_directions = dx[:, fixed_count:].reshape(count, self.steps, -1)
        dz = self._project(space, dx[:, :fixed_count])
        tangents = dz[: 2 * self.n].copy()
        no_entries = binding.module.new(0)
        for steps in pieces(self.stepper, run, stored_run):
            # directions of inputs change from step to step: a call of C for each
            for step_group in (split(steps, np.arange(self.steps)) if input_directions.any()
                               else (steps,)):
                dz[self._input_rows] = (input_directions[:, step_group.first].T
                                        if input_directions.size else 0)
                # no rows are stored: the tangents at the end are in ``tangents``
                status = binding.integrate_tangent(
                    run, stored_run.parameters, step_group, dz, every=self.steps, rows=no_entries,
                    multipliers=no_entries, tangents=tangents)
                if status:
                    raise linearisation_error(step_group.first, status)
        frame = FrameMotion(binding, self.stepper.symmetries, run)
        if frame.moves:  # back to space at the end; the frame's own motion depends on parameters
            end_state = np.concatenate([stored_run.state.q, stored_run.state.p])
            tangents = (frame.matrix(self.steps) @ tangents
                        + frame.own_derivatives(self.steps, end_state) @ dz)
        return tangents.T

    def _adjoint(self, x: Array, w: Array) -> Array:
        """Return F'(x)ᵀ w, shape (k, size), for one x and k cotangents: steps backwards."""
        run, binding = self._run(x), self.stepper._derivative_binding()
        stored_run, space = self._stored_run(run)
        frame = FrameMotion(binding, self.stepper.symmetries, run)
        count, inputs = len(w), len(self.input_names)
        z_bar, w = binding.module.new(count, self._row_count), w.copy()
        u_bar = binding.module.new(count, self.steps, inputs)
        is_last, no_entries = True, binding.module.new(0)
        for steps in backwards(self.stepper, run, as_bytes(DEFAULT_MEMORY), end=None):
            if is_last and frame.moves:
                end_state = np.concatenate([steps.q[-1], steps.p[-1]])
                z_bar += w @ frame.own_derivatives(self.steps, end_state)
                w = np.ascontiguousarray(w @ frame.matrix(self.steps))
            is_last = False
            # in place: each w becomes the cotangent of the state before these steps
            for cotangent, gradient, inputs_bar in zip(w, z_bar, u_bar, strict=True):
                status = binding.integrate_adjoint(
                    run, stored_run.parameters, steps, cotangents=no_entries, every=self.steps,
                    multipliers=no_entries, w=cotangent, z_bar=gradient,
                    inputs_bar=inputs_bar[steps.first : steps.first + steps.count])
                if status:
                    raise linearisation_error(steps.first, status)
        z_bar[:, : 2 * self.n] = w
        pulled = space.pulled_back(z_bar.T).T
        return np.concatenate([pulled[:, self._fixed_rows], u_bar.reshape(count, -1)], axis=1)

    def _second_tangent(self, x: Array, v: Array, dx: Array) -> Array:
        """Return the derivative of F'(x) v along dx, a row for each pair of v and dx.

        Entry i is the derivative of the gradient of F_i along dx, times v.
        """
        units = np.eye(2 * self.n)  # cotangents that pick one entry of F
        rows = []
        for direction, along in zip(v, dx, strict=True):
            gradient_slopes = self._second_adjoint(
                x, units, np.repeat(along[None], 2 * self.n, axis=0))
            rows.append([slope @ direction for slope in gradient_slopes])
        return np.array(rows)

    def _second_adjoint(self, x: Array, w: Array, dx: Array) -> Array:
        """Return d/dε F'(x + ε dx)ᵀ w at ε = 0, a row for each pair of w and dx.

        Forward over reverse: dx is taken forwards through the steps, then w backwards together with
        its slope along these tangents, then both through the projection of the start.
        """
        run, second = self._run(x), self.stepper._second_binding()
        stored_run, space = self._stored_run(run)
        steps, status = stored_run.keep(self.steps)
        if status:
            self.stepper._run(run)  # says why it fails
            raise linearisation_error(stored_run.steps_done, status)
        parameters = second.module.parameters(run.parameters, run.t0)
        fixed_count, size = self._fixed_rows.size, 2 * self.n
        input_directions = dx[:, fixed_count:].reshape(len(dx), self.steps, -1)
        start_directions = self._project(space, dx[:, :fixed_count])
        # F is of the end alone: cotangents of stored states, and their slopes, are 0
        no_stored_states = np.zeros((1, size)), np.zeros((1, size))
        derivatives = np.zeros((len(w), self.size))
        for j, cotangent in enumerate(w):
            # forwards: the tangents of dx before each step
            dz = start_directions[:, j].copy()
            tangents = self._tangents_of_steps(run, stored_run, steps, dz, input_directions[j])
            # backwards: w with its slope, which is 0 at the end
            cotangents = CotangentSlopes.at_end(second, cotangent, np.zeros(size), self.steps)
            cotangents.inputs.direction[:] = input_directions[j]
            status = second.integrate_second(
                run, parameters, steps, tangents, dz, rows=no_stored_states, every=self.steps,
                cotangents=cotangents)
            if status:
                raise linearisation_error(0, status)
            # through the projection of the start
            z_bar, slope = cotangents.z_bar
            z_bar[:size], slope[:size] = cotangents.w
            start_slope = pulled_back_slope(second, space, parameters, run.q, run.p, dz, z_bar,
                                            slope)
            derivatives[j] = np.concatenate([start_slope[self._fixed_rows],
                                             cotangents.inputs.cotangent_slopes.ravel()])
        return derivatives

    def _tangents_of_steps(
        self, run: RunArguments, stored_run: KeptRun, steps: KeptSteps, dz: Array,
        input_directions: Array,
    ) -> Array:
        """Return the tangent of (q, p) before each step and after the last, shape (steps + 1, 2 n).

        ``dz`` is a direction of the start, and ``input_directions`` has a row for each step.
        """
        binding, size = self.stepper._derivative_binding(), 2 * self.n
        dz = dz.copy()
        tangents = np.zeros((self.steps + 1, size))
        tangents[0], tangent = dz[:size], dz[:size, None].copy()
        # directions of inputs change from step to step: a call of C for each
        for step_group in (split(steps, np.arange(self.steps)) if input_directions.any()
                           else (steps,)):
            dz[self._input_rows] = input_directions[step_group.first]
            status = binding.integrate_tangent(
                run, stored_run.parameters, step_group, dz[:, None].copy(), every=1,
                rows=tangents[step_group.first + 1 :], multipliers=binding.module.new(0),
                tangents=tangent)
            if status:
                raise linearisation_error(step_group.first, status)
        return tangents

    # ------------------------------------------------------------ the derivative of the projection

    def _project(self, space: TangentSpace, dx: Array) -> Array:
        """Return directions of the start, projected onto the constraints, shape (rows, k).

        ``dx`` has the shape (k, entries of x without inputs); the rows are those of compiled
        derivatives, in their order.
        """
        dz = self.stepper.binding.new(self._row_count, len(dx))
        dz[self._fixed_rows] = dx.T
        return np.ascontiguousarray(space.project(dz))

    def _sizes(self, x: Array) -> Array:
        """Return the size of each entry of x, shape (size,), in which a difference is small.

        That is |q| and |p| for their entries, Δt for t0, and |x_i| for the others, 1 where it is 0.
        """
        size = np.where(x == 0, 1.0, np.abs(x))
        for name in ("q", "p"):
            size[self.fields[name]] = np.linalg.norm(x[self.fields[name]]) or 1.0
        size[self.fields["t0"]] = np.abs(x[self.fields["dt"]])
        return size


def _unless_near(x: Array, projected: Array) -> Array:
    """Return x if it is consistent up to round-off, else its projection."""
    distance = np.abs(projected - x).max()
    return x if distance <= _CONSISTENT * np.finfo(float).eps * np.linalg.norm(x) else projected
