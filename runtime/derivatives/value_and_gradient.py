"""A function of a vector, and its gradient: what optimisers ask for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import InputError
from ..bindings.array_checks import as_numbers
from .gradient import loss_of
from .tangent_space import TangentSpace

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["objective"]

Array = NDArray[Any]


def objective(
    stepper: Stepper, loss: Callable[..., Any], q: ArrayLike, p: ArrayLike, wrt: tuple[str, ...],
    parameters: Mapping[str, Any], dt: Any, steps: int, memory: str, options: dict[str, Any],
) -> Callable[[ArrayLike], tuple[float, Array]]:
    """Return f(x) → (loss, gradient); see ``Stepper.value_and_gradient``."""
    if {"q", "p"} & {*wrt}:
        raise InputError("x has coordinates of the tangent space for the start: ask for \"start\" "
                         "in place of \"q\" and \"p\".")
    loss = loss_of(loss)
    held = options.get("inputs")
    first = stepper.resolved(stepper.run_arguments(
        q, p, dt=dt, steps=0, t0=options.get("t0", 0.0),
        parameters=stepper.parameters_with_inputs(parameters, held)))
    binding = stepper.derivative_binding()
    space = TangentSpace(binding, binding.own.parameters(first.parameters, first.t0), first.q,
                         first.p, stepper.constraint_names)
    basis = space.basis()
    shape = np.shape(np.zeros((0, 0)) if held is None else held)
    sizes = {"start": basis.shape[1], "inputs": int(np.prod(shape))}

    def evaluate(x: ArrayLike) -> tuple[float, Array]:
        given = as_numbers("x", x)
        whole = sum(sizes.get(name, 1) for name in wrt)
        if given.shape != (whole,):
            raise InputError(f"x has the shape {given.shape}; {', '.join(wrt)} are {whole} "
                             "numbers.")
        here: dict[str, Any] = {"dt": dt, "t0": options.get("t0", 0.0)}
        now, state, moved, at = dict(parameters), (first.q, first.p), False, 0
        inputs = held
        for name in wrt:
            part = given[at : at + sizes.get(name, 1)]
            at += len(part)
            if name == "start":
                z = np.concatenate(state) + basis @ part
                state, moved = (z[: stepper.n], z[stepper.n :]), True
            elif name == "inputs":
                inputs = part.reshape(shape)
            elif name in here:
                here[name] = part[0]
            else:
                now[name], moved = part[0], True
        more = {key: value for key, value in options.items() if key not in ("t0", "inputs")}
        if stepper.m and moved:
            found = stepper.consistent(
                *state, t=here["t0"], parameters=stepper.parameters_with_inputs(now, held))
            state = found.q, found.p
        run = stepper.integrate(state[0], state[1], steps=steps, parameters=now, inputs=inputs,
                                dt=here["dt"], t0=here["t0"], **more)
        gradient = stepper.gradient(run, loss=loss, wrt=wrt, memory=memory,
                                    solver=more.get("solver", "auto"))
        numbers = dict.fromkeys(wrt)
        parts = [np.ravel(basis.T @ np.concatenate([gradient.q, gradient.p])) if name == "start"
                 else np.ravel(np.asarray(gradient[name])) for name in numbers]
        return float(gradient.value), np.concatenate(parts).astype(float)

    return evaluate
