"""Steps and runs as JAX functions: jit, vmap, grad, jvp, jacfwd, jacrev.

    import gyrospark.interop.jax as gj

    advance = gj.step(stepper, dt=1e-3)
    q1, p1 = advance(q, p, parameters)

Three primitives, F, F'(x) dx and F'(x)ᵀ w. The second is the derivative of the first, the third is
the transpose of the second: JAX composes every first derivative of these rules. Each has an axis of
points x and an axis of directions, and ``vmap`` makes one of them longer. Where only directions are
mapped, as in ``jacfwd``, all of them follow one run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from ..core.errors import InputError, MissingDependencyError
from ..core.extras import install
from ..runtime.steppers.stepper import Stepper
from .discrete_flow import DiscreteFlow
from .flow_function import FlowFunction, no_second_order, no_third_order, on_mapped_axis

try:
    import jax
    import jax.numpy as jnp
    from jax.core import ShapedArray
    from jax.extend.core import Primitive
    from jax.interpreters import ad, batching, mlir
except ImportError as error:
    raise MissingDependencyError(
        f"gyrospark.interop.jax needs JAX; {install('jax')} brings it.") from error

__all__ = ["Flow", "run", "step"]


def step(stepper: Stepper, *, dt: Any = None, second_order: str = "exact") -> Flow:
    """Return one step of a stepper as a JAX function: ``f(q, p, parameters)`` → (q1, p1).

    See ``run``, of which it is ``steps=1``.
    """
    return run(stepper, steps=1, dt=dt, second_order=second_order)


def run(stepper: Stepper, *, steps: int, dt: Any = None, second_order: str = "exact") -> Flow:
    """Return a run of a stepper as a JAX function of its start: (q, p) after ``steps`` steps.

    Arguments are those of ``FlowFunction``; second derivatives are those of ``jax.hessian``.
    """
    return Flow(stepper, steps, dt, second_order)


class Flow(FlowFunction):
    """N steps as a JAX function; see ``run``. JAX must compute in 64 bits."""

    _arrays = (jax.Array,)
    _stack = "jax.numpy.array"

    def _evaluate(self, parts: list[tuple[Any, tuple[int, ...]]]) -> Any:
        """Return F of the parts of x, each broadcast to its shape and flattened; needs 64 bits."""
        if not jax.config.jax_enable_x64:
            raise InputError("JAX computes in 32 bits, and steps need 64; call "
                             "jax.config.update(\"jax_enable_x64\", True) first.")
        x = jnp.concatenate([jnp.broadcast_to(jnp.asarray(component, dtype=jnp.float64),
                                              shape).ravel()
                             for component, shape in parts])
        return _value.bind(x[None], flow=self._flow, has_second=self._has_second)[0]


# ---------------------------------------------------------------- primitives

#: x, shape (rows, size) → F(x), shape (rows, 2 n).
_value = Primitive("gyrospark_run")
#: x and dx, shape (rows, k, size) → F'(x) dx, shape (rows, k, 2 n).
_tangent = Primitive("gyrospark_tangent")
#: x and w, shape (rows, k, 2 n) → F'(x)ᵀ w, shape (rows, k, size).
_adjoint = Primitive("gyrospark_adjoint")
#: x, v and dx, shape (rows, k, …) → the derivative of one of these two at v by x along dx.
_second_tangent = Primitive("gyrospark_second_tangent")
_second_adjoint = Primitive("gyrospark_second_adjoint")


def _register(primitive: Any, call: Callable[..., Any], is_adjoint: bool) -> None:
    """Register the evaluation of a primitive, in Python and in compiled programs.

    ``call`` takes the flow and NumPy arrays, of which x, the rows of arguments of F (see
    ``DiscreteFlow``), is the first. ``is_adjoint`` says that its result has the width of x, not of
    F(x). Compiled programs call Python back.
    """
    # JAX passes every rule of a primitive the same settings: ``has_second``, whether there are
    # second derivatives, is read by the rules of derivatives alone
    def shape(x: Any, *directions: Any, flow: DiscreteFlow) -> tuple[int, ...]:
        """Return the shape of the result: rows and directions as the arguments have them."""
        width = flow.size if is_adjoint else 2 * flow.n
        return (*(directions[0].shape[:2] if directions else x.shape[:1]), width)

    def compute(*arrays: Any, flow: DiscreteFlow, has_second: bool) -> Any:
        """Evaluate the primitive on arrays in Python."""
        return call(flow, *map(np.asarray, arrays))

    def call_back(*arrays: Any, flow: DiscreteFlow, has_second: bool) -> Any:
        """Return the operation of a compiled program that calls ``compute`` back."""
        return jax.pure_callback(
            partial(compute, flow=flow, has_second=has_second),
            jax.ShapeDtypeStruct(shape(*arrays, flow=flow), jnp.float64), *arrays)

    def abstract(*arrays: Any, flow: DiscreteFlow, has_second: bool) -> Any:
        """Return shape and type of the result, which JAX asks for before it is computed."""
        return ShapedArray(shape(*arrays, flow=flow), jnp.dtype("float64"))

    def implement(*arrays: Any, **settings: Any) -> Any:
        """Evaluate the primitive outside of compiled programs."""
        return jnp.asarray(compute(*arrays, **settings))

    primitive.def_impl(implement)
    primitive.def_abstract_eval(abstract)
    mlir.register_lowering(primitive, mlir.lower_fun(call_back, multiple_results=False))
    batching.primitive_batchers[primitive] = partial(_batch, primitive)


def _batch(
    primitive: Any, arrays: Sequence[Any], axes: Sequence[int | None], **settings: Any
) -> tuple[Any, int]:
    """The rule of ``vmap`` for a primitive; see ``on_mapped_axis``."""
    size = next(array.shape[axis] for array, axis in zip(arrays, axes, strict=True)
                if axis is not None)

    def repeat(array: Any, axis: int, size: int) -> Any:
        """Insert an axis of ``size`` equal entries."""
        return jnp.broadcast_to(jnp.expand_dims(array, axis),
                                (*array.shape[:axis], size, *array.shape[axis:]))

    return on_mapped_axis(partial(primitive.bind, **settings), arrays, axes, size, jnp.moveaxis,
                          repeat)


def _is_nonzero(tangent: Any) -> bool:
    """Whether a tangent is an array: JAX has an object for tangents that are zero."""
    return type(tangent) is not ad.Zero


def _value_jvp(primals: Any, tangents: Any, **settings: Any) -> Any:
    """Return F(x) and F'(x) dx, as JAX asks for a primitive's derivative."""
    (x,), (dx,) = primals, tangents
    value = _value.bind(x, **settings)
    return value, _tangent.bind(x, dx[:, None], **settings)[:, 0]


def _linear_jvp(
    linear: Any, second: Any, primals: Any, tangents: Any, *, flow: DiscreteFlow, has_second: bool
) -> Any:
    """Return F'(x) v or F'(x)ᵀ v, and its derivative: exact by v, and by x as ``second_order``
    says.

    ``linear`` is the primitive of the product, ``second`` that of its derivative by x; the tangents
    dx and dv may be zero.
    """
    (x, v), (dx, dv) = primals, tangents
    settings = {"flow": flow, "has_second": has_second}
    product = linear.bind(x, v, **settings)
    terms = [linear.bind(x, dv, **settings)] if _is_nonzero(dv) else []
    if _is_nonzero(dx):
        if not has_second:
            raise no_second_order()
        directions = jnp.broadcast_to(dx[:, None], (*v.shape[:2], dx.shape[-1]))
        terms.append(second.bind(x, v, directions, **settings))
    return product, sum(terms[1:], terms[0]) if terms else ad.Zero.from_primal_value(product)


def _transpose(transposed_primitive: Any, cotangent: Any, x: Any, v: Any, **settings: Any) -> Any:
    """Return the cotangents of x and v of F'(x) v, which is linear in v: None, and F'(x)ᵀ
    cotangent.

    Of F'(x)ᵀ w it is F'(x) cotangent: ``transposed_primitive`` is the other one of the two.
    """
    if not _is_nonzero(cotangent):
        return None, ad.Zero(v.aval)
    return None, transposed_primitive.bind(x, cotangent, **settings)


def _refuse_transpose(*arrays: Any, **settings: Any) -> Any:
    """Raise InputError: a second derivative has no transpose here."""
    raise InputError("Second derivatives of steps are taken forward over reverse: use jax.hessian, "
                     "or jacfwd of jacrev.")


def _refuse_third(*arrays: Any, **settings: Any) -> Any:
    """Raise InputError: a second derivative has no derivative here."""
    raise no_third_order()


_register(_value, DiscreteFlow.value, is_adjoint=False)
_register(_tangent, DiscreteFlow.tangent, is_adjoint=False)
_register(_adjoint, DiscreteFlow.adjoint, is_adjoint=True)
_register(_second_tangent, lambda flow, *xs: flow.second(flow.tangent, *xs), is_adjoint=False)
_register(_second_adjoint, lambda flow, *xs: flow.second(flow.adjoint, *xs), is_adjoint=True)
ad.primitive_jvps[_value] = _value_jvp
for _product, _transposed, _second in ((_tangent, _adjoint, _second_tangent),
                                       (_adjoint, _tangent, _second_adjoint)):
    ad.primitive_jvps[_product] = partial(_linear_jvp, _product, _second)
    ad.primitive_transposes[_product] = partial(_transpose, _transposed)
    ad.primitive_transposes[_second] = _refuse_transpose
    ad.primitive_jvps[_second] = _refuse_third
