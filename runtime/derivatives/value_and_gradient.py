"""A function of a vector, and its gradient: what optimisers ask for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import shown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.inertia import real_array
from ...core.solver import as_solver
from ...core.start import Rule, Start
from ..bindings.array_checks import as_numbers
from ..bindings.inputs import Inputs
from .gradient import loss_of
from .tangent_space import TangentSpace

if TYPE_CHECKING:
    from ..integration.run_arguments import StartNumbers
    from ..steppers.stepper import Stepper

__all__ = ["Objective"]


def _refuse_unusable_names(wrt: tuple[str, ...]) -> None:
    """Refuse "q" and "p", in whose place x has coordinates of the start, and repeated names."""
    if {"q", "p"} & {*wrt}:
        raise InputError("x has coordinates of the tangent space for the start: ask for "
                         "\"start\" in place of \"q\" and \"p\".")
    for name in wrt:
        if wrt.count(name) > 1:
            raise InputError(f"wrt has {name!r} {wrt.count(name)} times, and x would have as "
                             "many values of it; name it once.")


class _InputLayout(NamedTuple):
    """How an array of inputs is laid out: (rows, inputs), and the steps that a row is held for."""

    shape: tuple[int, ...]
    hold: int


def _layout_of(inputs: Any, *, in_x: bool) -> _InputLayout:
    """Return the layout of a caller's inputs, without rows where they are no array.

    Raises InputError for these if x has the rows of inputs, ``in_x``.
    """
    values, hold = (inputs.values, inputs.hold) if isinstance(inputs, Inputs) else (inputs, 1)
    array = real_array(values)
    if in_x and array is None:
        raise InputError(f"inputs = {shown(values)} are no rows of numbers, by which "
                         "\"inputs\" in wrt asks for derivatives; give a row of each step.")
    return _InputLayout((0, 0) if array is None else array.shape, hold)


class _VariedArguments(NamedTuple):
    """The arguments of a run that depend on the variables."""

    state: Array  # z₀ + B y, shape (2 n,)
    times: dict[str, Any]  # "dt" and "t0"
    parameters: dict[str, Any]
    inputs: Any


class Objective:
    """The function f(x) → (loss, gradient) of ``Stepper.value_and_gradient``.

    x has a block for each name in ``wrt``. ``span`` has the number of steps, or t_end where it lies
    between two steps.
    """

    def __init__(
        self, stepper: Stepper, loss: Callable[..., Any], start: StartNumbers, wrt: tuple[str, ...],
        dt: Any, span: dict[str, Any], inputs: Any, memory: str, options: dict[str, Any],
    ) -> None:
        """Project the start, and keep a basis of the tangent space there, for "start" in x.

        z₀ = (q₀, p₀), the projected start, is ``_state``; ``_start`` is the caller's, with numbers
        in place of rules. ``span`` is {"t_end": ...} or {"steps": ...}, ``options`` are further
        arguments of ``integrate``; other arguments as for ``value_and_gradient``.
        """
        _refuse_unusable_names(wrt)
        self._stepper, self._loss, self._wrt, self._dt = stepper, loss_of(loss), wrt, dt
        self._inputs = inputs
        self._span, self._memory, self._options = span, memory, options
        # coordinates of the tangent space count from the start that a run of no steps has, moved
        # onto the constraints
        run_of_start = stepper._resolve(stepper._run_arguments(replace(
            start, parameters=stepper._parameters_with_inputs(start.parameters, inputs)),
            dt=dt, steps=0))
        self._state = run_of_start.q, run_of_start.p
        binding = stepper._derivative_binding()
        # γ by a rule, say, has the number that it has at the start, whatever x is
        self._start = replace(start, parameters={
            **start.parameters, **self._numbers_of_rules(start, run_of_start.parameters)})
        self._basis = TangentSpace(
            binding, binding.module.parameters(run_of_start.parameters, run_of_start.t0),
            run_of_start.q, run_of_start.p, stepper.constraint_names).basis()
        self._layout = _layout_of(inputs, in_x="inputs" in wrt)
        #: The number of entries of x by name: 1 of each parameter and of "dt" and "t0".
        self._sizes = dict.fromkeys(wrt, 1) | {
            "start": self._basis.shape[1], "inputs": int(np.prod(self._layout.shape))}

    def _numbers_of_rules(self, start: StartNumbers, numbers: Mapping[str, Any]) -> dict[str, Any]:
        """Return the numbers at the start of γ, α and rates of a frame that follow from a rule.

        They are constant in x. A mean that followed the moments of inertia in x would add a term to
        the derivative, which a run does not compute. A rule may be text, or left out.
        """
        return {name: number for name, number in numbers.items()
                if name not in self._stepper.binding.input_names
                and isinstance(start.parameters.get(name, ""), (Rule, str))}

    def __call__(self, x: ArrayLike) -> tuple[float, Array]:
        """Return the value and its gradient at x, shape (k,), in doubles."""
        variables = self._variables(x)
        arguments = self._varied_arguments(variables)
        times = arguments.times
        moved_state = self._on_constraints(variables)
        q, p = np.split(moved_state, 2)
        run = self._stepper.integrate(
            Start(q, p, t=times["t0"]), parameters=arguments.parameters,
            inputs=arguments.inputs, dt=times["dt"],
            **self._span, **self._options)
        gradient = self._stepper.gradient(run, loss=self._loss, wrt=self._wrt, memory=self._memory,
                                          solver=as_solver(self._options["solver"]).kind)
        by_state = np.concatenate([gradient.q, gradient.p])
        # the name of each entry of x
        names = np.repeat(np.array(self._wrt, object), [self._sizes[name] for name in self._wrt])
        # by coordinates of the basis at the first start: ``gradient.start`` has those of another
        blocks = [self._basis.T @ by_state if name == "start"
                  else np.ravel(np.asarray(gradient[name])) for name in self._wrt]
        slopes = np.concatenate(blocks)
        if self._needs_state_slopes(variables[names == "start"], arguments.state, moved_state):
            # inputs and dt do not move the start
            for k in np.flatnonzero(~np.isin(names, ("inputs", "dt"))).tolist():
                # by a parameter or t0 the run takes the derivative of a start that needed no
                # projection; the motion of the projected start is added. Its part along Gᵀ, which
                # the run has too, is not counted twice: ``by_state`` is 0 along Gᵀ
                direct = 0 if names[k] == "start" else slopes[k]
                slopes[k] = direct + by_state @ self._state_slope(variables, k, names[k])
        return float(gradient.value), slopes.astype(float)

    def _variables(self, x: ArrayLike) -> Array:
        """Return x as an array; raise InputError for another shape."""
        variables: Array = as_numbers("x", x)
        size = sum(self._sizes[name] for name in self._wrt)
        if variables.shape != (size,):
            raise InputError(f"x has the shape {variables.shape}; {', '.join(self._wrt)} are "
                             f"{size} numbers.")
        return variables

    def _varied_arguments(self, variables: Array) -> _VariedArguments:
        """Return the arguments of the run at x = ``variables``, the entries of ``wrt`` in order."""
        state, inputs = np.concatenate(self._state), self._inputs
        times: dict[str, Any] = {"dt": self._dt, "t0": self._start.t}
        parameters = dict(self._start.parameters)
        sizes = [self._sizes[name] for name in self._wrt]
        for name, block in zip(self._wrt, np.split(variables, np.cumsum(sizes)[:-1]), strict=True):
            if name == "start":
                # coordinates of an orthonormal basis of the tangent space, 0 at the given start
                state = state + self._basis @ block
            elif name == "inputs":
                inputs = Inputs(block.reshape(self._layout.shape), self._layout.hold)
            elif name in times:
                times[name] = block[0]
            else:
                parameters[name] = block[0]
        return _VariedArguments(state, times, parameters, inputs)

    @property
    def _may_leave_constraints(self) -> bool:
        """Whether variables may take the start off the constraints: "start", a parameter or t0."""
        return bool(self._stepper.m) and not {*self._wrt} <= {"inputs", "dt"}

    def _on_constraints(self, variables: Array) -> Array:
        """Return the state (q, p) at x, consistent(z₀ + B y), shape (2 n,)."""
        state, times, parameters, _ = self._varied_arguments(variables)
        stepper = self._stepper
        if not self._may_leave_constraints:
            return state
        return np.concatenate(stepper.project(
            *np.split(state, 2), t=times["t0"],
            parameters=stepper._parameters_with_inputs(parameters, self._inputs)))

    def _needs_state_slopes(self, y: Array, state: Array, moved_state: Array) -> bool:
        """Whether the derivative of consistent(z₀ + B y) differs from the one that the run takes.

        ``state`` is z₀ + B y and ``moved_state`` its projection, shapes (2 n,). The run takes the
        derivative at a consistent state, y = 0; IMS and EMS differentiate no momenta of a start.
        """
        if not self._may_leave_constraints:
            return False
        round_off = 64 * float(self._stepper.binding.epsilon)
        sizes = np.abs(state.astype(float)) + np.abs(moved_state.astype(float))
        changes = np.abs((moved_state - state).astype(float))
        return bool(any(y) or not self._stepper._derivative_binding().keeps_momentum
                    or changes.max() > round_off * sizes.max())

    def _state_slope(self, variables: Array, k: int, name: str) -> Array:
        """Return ∂(q, p)/∂x_k of the state at x, (2 n,), by differences of fourth order."""
        # integers, which a difference would round, become the stepper's numbers
        x = self._stepper.binding.to_real(variables)
        if name == "t0":
            # steps resolve the motion of the constraints, of which the size of t0 says nothing
            h = abs(float(self._varied_arguments(variables).times["dt"])) / 8
        else:
            length = float(np.linalg.norm(self._state[0].astype(float)) if name == "start"
                           else abs(x[k]))
            # ε/h is the round-off of a difference, h⁴ its truncation
            epsilon = max(float(self._stepper.binding.epsilon), np.finfo(float).eps)
            h = (length or 1.0) * epsilon**0.2

        def difference(factor: int) -> Array:
            """Return the difference of states for x_k 2 ``factor`` h apart."""
            higher, lower = x.copy(), x.copy()
            higher[k] += factor * h
            lower[k] -= factor * h
            change: Array = self._on_constraints(higher) - self._on_constraints(lower)
            return change

        slope: Array = (8 * difference(1) - difference(2)) / (12 * h)
        return slope
