"""Steps and runs as PyTorch functions, in double: backward, jvp, ``torch.func``, vmap.

    import gyrospark.interop.torch as gt

    advance = gt.step(stepper, dt=1e-3)
    q1, p1 = advance(q, p, parameters)

Three functions as in ``jax``: F, F'(x) dx and F'(x)ᵀ w, each with an axis of points x and an axis
of directions.
"""

from __future__ import annotations

from typing import Any

from ..core.errors import InputError, MissingDependencyError
from ..core.extras import install
from ..runtime.steppers.stepper import Stepper
from .discrete_flow import DiscreteFlow
from .flow_function import FlowFunction, no_second_order, no_third_order, on_mapped_axis

try:
    import torch
    from torch.autograd import Function
except ImportError as error:
    raise MissingDependencyError(
        f"gyrospark.interop.torch needs PyTorch; {install('torch')} brings it.") from error

__all__ = ["Flow", "run", "step"]


def step(stepper: Stepper, *, dt: Any = None, second_order: str = "exact") -> Flow:
    """Return one step of a stepper as a PyTorch function: ``f(q, p, parameters)`` → (q1, p1).

    See ``run``, of which it is ``steps=1``.
    """
    return run(stepper, steps=1, dt=dt, second_order=second_order)


def run(stepper: Stepper, *, steps: int, dt: Any = None, second_order: str = "exact") -> Flow:
    """Return a run of a stepper as a PyTorch function: (q, p) after ``steps`` steps.

    Arguments as for ``FlowFunction``; ``second_order`` says how ``torch.func.hessian`` gets its
    second derivatives.
    """
    return Flow(stepper, steps, dt, second_order)


class Flow(FlowFunction):
    """N steps as a PyTorch function; see ``run``. Tensors are of double precision, on the CPU."""

    _arrays = (torch.Tensor,)
    _stack = "torch.stack"

    def _array(self, name: str, argument: Any) -> Any:
        """Return an array as ``FlowFunction`` does; tensors in a list are refused as others are."""
        _refuse_listed(argument)
        return super()._array(name, argument)

    def _evaluate(self, parts: list[tuple[Any, tuple[int, ...]]]) -> Any:
        """Return F(x) as a tensor of 2 n numbers."""
        x = torch.cat([_double(component).broadcast_to(shape).flatten()
                       for component, shape in parts])
        return _Value.apply(x[None], self._flow, self._has_second)[0]


def _double(component: Any) -> Any:
    """Return a part of x as a tensor; tensors must be of double precision, on the CPU."""
    if not isinstance(component, torch.Tensor):
        return torch.as_tensor(component, dtype=torch.float64)
    if component.dtype is not torch.float64 or component.device.type != "cpu":
        raise InputError(f"A tensor is {component.dtype} on {component.device}; steps take "
                         "torch.float64 on the CPU: x.double().cpu().")
    return component


def _refuse_listed(argument: Any) -> None:
    """Refuse tensors of another type or device in a list, or in lists of a list."""
    if isinstance(argument, (list, tuple)):
        for entry in argument:
            _refuse_listed(entry)
            if isinstance(entry, torch.Tensor):
                _double(entry)


# ---------------------------------------------------------------- functions of torch.autograd


def _call_numpy(function: Any, *tensors: Any) -> Any:
    """Return a function of NumPy arrays, evaluated on tensors, as a tensor that autograd does
    not record."""
    return torch.from_numpy(function(*(tensor.detach().numpy() for tensor in tensors)))


def _save(ctx: Any, inputs: tuple[Any, ...]) -> None:
    """Keep the inputs for derivatives; gradients that are not asked for stay None."""
    *tensors, ctx.flow, ctx.has_second = inputs
    ctx.save_for_backward(*tensors)
    ctx.save_for_forward(*tensors)
    ctx.set_materialize_grads(False)


def _batch(function: Any, size: int, axes: tuple[Any, ...], inputs: tuple[Any, ...]) -> Any:
    """The rule of ``vmap`` for a function; see ``on_mapped_axis``."""
    *tensors, flow, has_second = inputs

    def repeat(tensor: Any, axis: int, size: int) -> Any:
        """Insert an axis of ``size`` equal entries."""
        return tensor.unsqueeze(axis).expand(*tensor.shape[:axis], size, *tensor.shape[axis:])

    return on_mapped_axis(lambda *merged: function.apply(*merged, flow, has_second), tensors,
                          axes[: len(tensors)], size, torch.movedim, repeat)


class _Batched(Function):
    """A function of x and directions with ``setup_context`` and ``vmap``."""

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:
        """Keep the arguments for derivatives."""
        _save(ctx, inputs)

    @classmethod
    def vmap(cls, info: Any, in_dims: tuple[Any, ...], *inputs: Any) -> Any:
        """Return the function of batched arguments, and the batch axis of the result."""
        return _batch(cls, info.batch_size, in_dims, inputs)


class _Value(_Batched):
    """x, shape (rows, size) → F(x), shape (rows, 2 n)."""

    @staticmethod
    def forward(x: Any, flow: DiscreteFlow, has_second: bool) -> Any:
        """Return F(x)."""
        return _call_numpy(flow.value, x)

    @staticmethod
    def backward(ctx: Any, w: Any) -> Any:
        """Return F'(x)ᵀ w, itself a differentiable function of x and w."""
        if w is None:
            return None, None, None
        (x,) = ctx.saved_tensors
        return _Adjoint.apply(x, w[:, None], ctx.flow, ctx.has_second)[:, 0], None, None

    @staticmethod
    def jvp(ctx: Any, dx: Any, *_: Any) -> Any:
        """Return F'(x) dx."""
        (x,) = ctx.saved_tensors
        return _Tangent.apply(x, dx[:, None], ctx.flow, ctx.has_second)[:, 0]


def _transpose(ctx: Any, transposed_function: Any, cotangent: Any) -> Any:
    """Return the cotangents of x, v, flow and has_second: only v has one.

    F'(x) v and F'(x)ᵀ v are linear in v, so that it is the transposed function of ``cotangent``.
    """
    if ctx.needs_input_grad[0]:
        raise InputError("Second derivatives of steps are taken forward over reverse: use "
                         "torch.func.hessian, or jacfwd of jacrev.")
    if cotangent is None or not ctx.needs_input_grad[1]:
        return None, None, None, None
    return None, transposed_function.apply(ctx.saved_tensors[0], cotangent, ctx.flow,
                                           ctx.has_second), None, None


def _linear_jvp(ctx: Any, function: Any, second: Any, dx: Any, dv: Any) -> Any:
    """Return the derivative of F'(x) v or F'(x)ᵀ v: exact by v, and by x as ``second_order`` says.

    dx and dv are None where they are zero; so is the result without both.
    """
    x, v = ctx.saved_tensors
    terms = [] if dv is None else [function.apply(x, dv, ctx.flow, ctx.has_second)]
    if dx is not None:
        if not ctx.has_second:
            raise no_second_order()
        directions = dx[:, None].expand(*v.shape[:2], dx.shape[-1])
        terms.append(second.apply(x, v, directions, ctx.flow, ctx.has_second))
    return sum(terms[1:], terms[0]) if terms else None


class _Tangent(_Batched):
    """x and dx, shape (rows, k, size) → F'(x) dx, shape (rows, k, 2 n)."""

    @staticmethod
    def forward(x: Any, dx: Any, flow: DiscreteFlow, has_second: bool) -> Any:
        """Return F'(x) dx."""
        return _call_numpy(flow.tangent, x, dx)

    @staticmethod
    def backward(ctx: Any, w: Any) -> Any:
        """Return the cotangent of dx, F'(x)ᵀ w."""
        return _transpose(ctx, _Adjoint, w)

    @staticmethod
    def jvp(ctx: Any, dx: Any, dv: Any, *_: Any) -> Any:
        """Return the derivative of F'(x) v along (dx, dv)."""
        return _linear_jvp(ctx, _Tangent, _SecondTangent, dx, dv)


class _Adjoint(_Batched):
    """x and w, shape (rows, k, 2 n) → F'(x)ᵀ w, shape (rows, k, size)."""

    @staticmethod
    def forward(x: Any, w: Any, flow: DiscreteFlow, has_second: bool) -> Any:
        """Return F'(x)ᵀ w."""
        return _call_numpy(flow.adjoint, x, w)

    @staticmethod
    def backward(ctx: Any, dv: Any) -> Any:
        """Return the cotangent of w, F'(x) dv."""
        return _transpose(ctx, _Tangent, dv)

    @staticmethod
    def jvp(ctx: Any, dx: Any, dv: Any, *_: Any) -> Any:
        """Return the derivative of F'(x)ᵀ v along (dx, dv)."""
        return _linear_jvp(ctx, _Adjoint, _SecondAdjoint, dx, dv)


class _Second(_Batched):
    """A second derivative, which has no derivative here."""

    @staticmethod
    def jvp(ctx: Any, *_: Any) -> Any:
        """Raise InputError."""
        raise no_third_order()

    @staticmethod
    def backward(ctx: Any, *_: Any) -> Any:
        """Raise InputError."""
        raise no_third_order()


class _SecondTangent(_Second):
    """x, v and dx, shape (rows, k, …) → the derivative of F'(x) v by x along dx."""

    @staticmethod
    def forward(x: Any, v: Any, dx: Any, flow: DiscreteFlow, has_second: bool) -> Any:
        """Return the derivative of F'(x) v by x along dx."""
        return _call_numpy(lambda *xs: flow.second(flow.tangent, *xs), x, v, dx)


class _SecondAdjoint(_Second):
    """x, w and dx, shape (rows, k, …) → the derivative of F'(x)ᵀ w by x along dx."""

    @staticmethod
    def forward(x: Any, w: Any, dx: Any, flow: DiscreteFlow, has_second: bool) -> Any:
        """Return the derivative of F'(x)ᵀ w by x along dx."""
        return _call_numpy(lambda *xs: flow.second(flow.adjoint, *xs), x, w, dx)
