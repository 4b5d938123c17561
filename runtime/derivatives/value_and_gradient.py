"""A function of a vector, and its gradient: what optimisers ask for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import shown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.inertia import real_array
from ...core.solver import as_solver
from ...core.start import Start
from ..bindings.array_checks import as_numbers
from ..bindings.inputs import Inputs
from .gradient import loss_of
from .tangent_space import TangentSpace

if TYPE_CHECKING:
    from ..integration.run_arguments import StartNumbers
    from ..steppers.stepper import Stepper

__all__ = ["Objective"]


class Objective:
    """The function f(x) → (loss, gradient) of ``Stepper.value_and_gradient``.

    x has a block for each name in ``wrt``. ``span`` has the number of steps, or t_end where it lies
    between two steps.
    """

    def __init__(
        self, stepper: Stepper, loss: Callable[..., Any], start: StartNumbers, wrt: tuple[str, ...],
        dt: Any, span: dict[str, Any], inputs: Any, memory: str, options: dict[str, Any],
    ) -> None:
        """Project the start, and keep a basis of the tangent space there: x has its coordinates.

        ``span`` is {"t_end": ...} or {"steps": ...}, ``options`` are further arguments of
        ``integrate``; the others are those of ``value_and_gradient``.
        """
        if {"q", "p"} & {*wrt}:
            raise InputError("x has coordinates of the tangent space for the start: ask for "
                             "\"start\" in place of \"q\" and \"p\".")
        self._stepper, self._loss, self._wrt, self._dt = stepper, loss_of(loss), wrt, dt
        self._start, self._inputs = start, inputs
        self._span, self._memory, self._options = span, memory, options
        input_values: Any = inputs
        self._hold = 1  # an array has a row for each step
        if isinstance(inputs, Inputs):
            input_values, self._hold = inputs.values, inputs.hold
        # the state that coordinates of the tangent space count from: the start, projected, as a run
        # of no steps has it
        run_of_start = stepper._resolved(stepper._run_arguments(replace(
            start, parameters=stepper._parameters_with_inputs(start.parameters, inputs)),
            dt=dt, steps=0))
        self._state = run_of_start.q, run_of_start.p
        binding = stepper._derivative_binding()
        self._basis = TangentSpace(
            binding, binding.own.parameters(run_of_start.parameters, run_of_start.t0),
            run_of_start.q, run_of_start.p,
            stepper.constraint_names).basis()
        inputs_array = real_array(input_values)
        if "inputs" in wrt and inputs_array is None:
            raise InputError(f"inputs = {shown(input_values)} are no rows of numbers, by which "
                             "\"inputs\" in wrt asks for derivatives; give a row of each step.")
        self._input_shape = (0, 0) if inputs_array is None else inputs_array.shape
        self._sizes = dict.fromkeys(wrt, 1) | {
            "start": self._basis.shape[1], "inputs": int(np.prod(self._input_shape))}

    def __call__(self, x: ArrayLike) -> tuple[float, Array]:
        """Return the value and its gradient at x, shape (k,), in doubles."""
        start, arguments = self._arguments(x)
        run = self._stepper.integrate(start, **arguments, **self._span, **self._options)
        gradient = self._stepper.gradient(run, loss=self._loss, wrt=self._wrt, memory=self._memory,
                                          solver=as_solver(self._options["solver"]).kind)
        # by coordinates of the basis at the first start: ``gradient.start`` has those of another
        by_start = self._basis.T @ np.concatenate([gradient.q, gradient.p])
        blocks = [by_start if name == "start" else np.ravel(np.asarray(gradient[name]))
                  for name in dict.fromkeys(self._wrt)]
        return float(gradient.value), np.concatenate(blocks).astype(float)

    def _arguments(self, x: ArrayLike) -> tuple[Start, dict[str, Any]]:
        """Return the start of the run at x, and its other arguments: parameters, inputs and dt.

        Raises InputError for an x of another shape.
        """
        variables = as_numbers("x", x)
        sizes = [self._sizes[name] for name in self._wrt]
        if variables.shape != (sum(sizes),):
            raise InputError(f"x has the shape {variables.shape}; {', '.join(self._wrt)} are "
                             f"{sum(sizes)} numbers.")
        stepper, state, inputs = self._stepper, self._state, self._inputs
        times: dict[str, Any] = {"dt": self._dt, "t0": self._start.t}
        parameters = dict(self._start.parameters)
        for name, block in zip(self._wrt, np.split(variables, np.cumsum(sizes)[:-1]), strict=True):
            if name == "start":
                # coordinates of an orthonormal basis of the tangent space, 0 at the given start
                z = np.concatenate(state) + self._basis @ block
                state = z[: stepper.n], z[stepper.n :]
            elif name == "inputs":
                inputs = Inputs(block.reshape(self._input_shape), self._hold)
            elif name in times:
                times[name] = block[0]
            else:
                parameters[name] = block[0]
        # a parameter may move the constraints; the gradient has the derivative of this projection
        if stepper.m and not {*self._wrt} <= {"inputs", *times}:
            consistent_state = stepper.consistent(
                *state, t=times["t0"],
                parameters=stepper._parameters_with_inputs(parameters, self._inputs))
            state = consistent_state.q, consistent_state.p
        return Start(*state, t=times["t0"]), {"parameters": parameters, "inputs": inputs,
                                              "dt": times["dt"]}
