"""A function of a vector, and its gradient: what optimisers ask for."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Array
from ...core.errors import InputError
from ...core.solver import as_solver
from ...core.start import Start
from ..bindings.array_checks import as_numbers
from ..bindings.inputs import Inputs
from .gradient import loss_of
from .tangent_space import TangentSpace

if TYPE_CHECKING:
    from ..integration.starts import StartNumbers
    from ..steppers.stepper import Stepper

__all__ = ["objective"]


def objective(
    stepper: Stepper, loss: Callable[..., Any], start: StartNumbers, wrt: tuple[str, ...],
    dt: Any, span: dict[str, Any], input_rows: Any, memory: str, options: dict[str, Any],
) -> Callable[[ArrayLike], tuple[float, Array]]:
    """Return f(x) → (loss, gradient); see ``Stepper.value_and_gradient``.

    ``span`` has the number of steps, or t_end where it lies between two steps.
    """
    if {"q", "p"} & {*wrt}:
        raise InputError("x has coordinates of the tangent space for the start: ask for \"start\" "
                         "in place of \"q\" and \"p\".")
    loss = loss_of(loss)
    parameters = start.parameters
    rows: Any
    rows, hold = (input_rows.values, input_rows.hold) if isinstance(input_rows,
                                                                    Inputs) else (input_rows, 1)
    first = stepper._resolved(stepper._run_arguments(
        start.q, start.p, dt=dt, steps=0, t0=start.t,
        parameters=stepper._parameters_with_inputs(parameters, input_rows)))
    binding = stepper._derivative_binding()
    space = TangentSpace(binding, binding.own.parameters(first.parameters, first.t0), first.q,
                         first.p, stepper.constraint_names)
    basis = space.basis()
    shape = np.shape(np.zeros((0, 0)) if rows is None else rows)
    sizes = {"start": basis.shape[1], "inputs": int(np.prod(shape))}

    def evaluate(x: ArrayLike) -> tuple[float, Array]:
        """Return the value and its gradient at x, whose blocks are in the order of ``wrt``."""
        variables = as_numbers("x", x)
        variable_count = sum(sizes.get(name, 1) for name in wrt)
        if variables.shape != (variable_count,):
            raise InputError(f"x has the shape {variables.shape}; {', '.join(wrt)} are "
                             f"{variable_count} numbers.")
        times: dict[str, Any] = {"dt": dt, "t0": start.t}
        values, state, is_moved, offset = dict(parameters), (first.q, first.p), False, 0
        inputs = input_rows
        for name in wrt:
            block = variables[offset : offset + sizes.get(name, 1)]
            offset += len(block)
            if name == "start":
                # x counts along an orthonormal basis of the tangent space: its zero is the given
                # start
                z = np.concatenate(state) + basis @ block
                state, is_moved = (z[: stepper.n], z[stepper.n :]), True
            elif name == "inputs":
                inputs = Inputs(block.reshape(shape), hold)
            elif name in times:
                times[name] = block[0]
            else:
                values[name], is_moved = block[0], True
        # a parameter may move the constraints; the gradient has the derivative of this projection
        if stepper.m and is_moved:
            consistent_state = stepper.consistent(
                *state, t=times["t0"],
                parameters=stepper._parameters_with_inputs(values, input_rows))
            state = consistent_state.q, consistent_state.p
        run = stepper.integrate(Start(*state, t=times["t0"]), parameters=values,
                                inputs=inputs, dt=times["dt"], **span, **options)
        gradient = stepper.gradient(run, loss=loss, wrt=wrt, memory=memory,
                                    solver=as_solver(options["solver"]).kind)
        numbers = dict.fromkeys(wrt)
        parts = [np.ravel(basis.T @ np.concatenate([gradient.q, gradient.p])) if name == "start"
                 else np.ravel(np.asarray(gradient[name])) for name in numbers]
        return float(gradient.value), np.concatenate(parts).astype(float)

    return evaluate
