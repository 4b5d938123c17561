"""Steps and runs as CasADi functions, with exact Jacobians, tangents and adjoints.

    import gyrospark.interop.casadi as gc

    advance = gc.step(stepper, dt=0.01)
    q1, p1 = advance(q, p, parameters, inputs=u)        # MX, DM or numbers

CasADi calls Python for them: such functions do not generate C.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..core.arrays import Array
from ..core.errors import MissingDependencyError
from ..core.extras import install
from ..runtime.steppers.stepper import Stepper
from .discrete_flow import DiscreteFlow
from .flow_function import FlowFunction, no_second_order

try:
    import casadi
except ImportError as error:
    raise MissingDependencyError(
        f"gyrospark.interop.casadi needs CasADi; {install('casadi')} brings it.") from error

__all__ = ["Flow", "run", "step"]


def step(stepper: Stepper, *, dt: Any = None, second_order: str = "exact") -> Flow:
    """Return one step of a stepper as a CasADi function: ``f(q, p, parameters)`` → (q1, p1).

    See ``run``, of which it is ``steps=1``.
    """
    return run(stepper, steps=1, dt=dt, second_order=second_order)


def run(stepper: Stepper, *, steps: int, dt: Any = None, second_order: str = "exact") -> Flow:
    """Return a run of a stepper as a CasADi function: (q, p) after ``steps`` steps.

    Arguments are those of ``FlowFunction``. By default second derivatives are exact, as IPOPT
    needs; with ``second_order="refuse"`` give IPOPT ``hessian_approximation="limited-memory"``.
    """
    return Flow(stepper, steps, dt, second_order)


class Flow(FlowFunction):
    """N steps as a CasADi function; see ``run``.

    Attributes
    ----------
    function : casadi.Function
        x ↦ z, the columns (q, p, parameters, dt, t0, inputs) ↦ (q, p) after N steps.
    """

    _columns = True
    _arrays = (casadi.MX, casadi.SX, casadi.DM)
    _stack = "casadi.vertcat"

    def __init__(self, stepper: Stepper, steps: int, dt: Any, second_order: str) -> None:
        super().__init__(stepper, steps, dt, second_order)
        key = (stepper, self._flow.steps, second_order)
        if key not in _functions:
            _functions[key] = self._flow, _value(self._flow, self._has_second)
        self._flow, self.function = _functions[key]
        self.failures = self._flow.failures

    def _evaluate(self, parts: list[tuple[Any, tuple[int, ...]]]) -> Any:
        """Return F(x) as a column; the parts of x are numbers or CasADi's matrices."""
        return self.function(casadi.vertcat(*(_column(component, shape)
                                              for component, shape in parts)))

    def _shape(self, value: Any) -> tuple[int, ...]:
        """Return a shape as NumPy has it: CasADi has columns of one number for scalars."""
        if not isinstance(value, self._arrays):
            return np.shape(value)
        row_count, column_count = value.shape
        if row_count == column_count == 1:
            return ()
        return (row_count,) if column_count == 1 else (row_count, column_count)


def _column(component: Any, shape: tuple[int, ...]) -> Any:
    """Return a part of x as a column of numbers or symbols; a matrix of inputs row by row.

    One row of inputs serves all steps: it is repeated.
    """
    if not isinstance(component, (casadi.MX, casadi.SX, casadi.DM)):
        component = casadi.DM(np.asarray(component, dtype=float))
    if len(shape) == 2 and component.shape != shape:  # the same inputs in each step
        return casadi.vertcat(*[component] * shape[0])
    return casadi.vec(component.T) if len(shape) == 2 else component


# ---------------------------------------------------------------- functions of CasADi

#: The flow and the function of each stepper, number of steps and order. They are kept, because
#: expressions that call a function of Python do not keep it, and may outlive their Flow.
_functions: dict[tuple[Stepper, int, str], tuple[DiscreteFlow, Any]] = {}


class _Function(casadi.Callback):
    """A function of columns and matrices by a NumPy function of arrays."""

    def __init__(
        self, name: str, ins: Mapping[str, tuple[int, int]], outs: Mapping[str, tuple[int, int]],
        compute: Callable[..., tuple[Array, ...]],
        derivatives: Mapping[str, Callable[..., Any]] | None = None,
    ) -> None:
        """Construct the callback, with the shapes of its inputs and outputs and its derivatives."""
        super().__init__()
        self._ins, self._outs, self._compute = dict(ins), dict(outs), compute
        self._derivatives = dict(derivatives or {})
        self._made: list[Any] = []  # CasADi does not keep the functions that it is given
        self.construct(name)

    def get_n_in(self) -> int:
        return len(self._ins)

    def get_n_out(self) -> int:
        return len(self._outs)

    def get_name_in(self, i: int) -> str:
        return list(self._ins)[i]

    def get_name_out(self, i: int) -> str:
        return list(self._outs)[i]

    def get_sparsity_in(self, i: int) -> Any:
        return casadi.Sparsity.dense(*list(self._ins.values())[i])

    def get_sparsity_out(self, i: int) -> Any:
        return casadi.Sparsity.dense(*list(self._outs.values())[i])

    def eval(self, arguments: Any) -> list[Any]:
        return [casadi.DM(array) for array in self._compute(*(a.full() for a in arguments))]

    def has_jacobian(self) -> bool:
        return "jacobian" in self._derivatives

    def has_forward(self, count: int) -> bool:
        return "forward" in self._derivatives

    def has_reverse(self, count: int) -> bool:
        return "reverse" in self._derivatives

    def get_jacobian(self, *arguments: Any) -> Any:
        return self._keep_derivative("jacobian", *arguments)

    def get_forward(self, count: int, *arguments: Any) -> Any:
        return self._keep_derivative("forward", *arguments, count)

    def get_reverse(self, count: int, *arguments: Any) -> Any:
        return self._keep_derivative("reverse", *arguments, count)

    def _keep_derivative(
        self, kind: str, name: str, ins: list[str], outs: list[str], options: Any, *count: int
    ) -> Any:
        """Make a derivative of a kind, and keep it alive."""
        self._made.append(self._derivatives[kind](name, ins, outs, *count))
        return self._made[-1]


def _name_shapes(names: list[str], shapes: list[tuple[int, int]]) -> dict[str, tuple[int, int]]:
    """Return the shapes by the names that CasADi gives."""
    return dict(zip(names, shapes, strict=True))


def _value(flow: DiscreteFlow, has_second: bool) -> Any:
    """Return z = F(x) as a CasADi function with Jacobian, forward and reverse derivatives.

    A derivative is compiled where CasADi asks for its function: a stepper that has none says so
    there, not where an expression of it is evaluated.
    """
    x_shape, z_shape = (flow.size, 1), (2 * flow.n, 1)

    def jacobian(name: str, ins: list[str], outs: list[str]) -> Any:
        """Return the function x, z ↦ F'(x), one row per entry of F."""
        flow.compile()
        return _Function(name, _name_shapes(ins, [x_shape, z_shape]),
                         _name_shapes(outs, [(2 * flow.n, flow.size)]),
                         lambda x, z: (flow.jacobian(x.T)[0],))

    def forward(name: str, ins: list[str], outs: list[str], count: int) -> Any:
        """Return the function x, z, dx ↦ F'(x) dx for ``count`` directions, the columns of dx."""
        flow.compile()
        return _Function(
            name, _name_shapes(ins, [x_shape, z_shape, (flow.size, count)]),
            _name_shapes(outs, [(2 * flow.n, count)]),
            lambda x, z, dx: (flow.tangent(x.T, dx.T[None])[0].T,))

    def reverse(name: str, ins: list[str], outs: list[str], count: int) -> Any:
        """Return the function x, z, w ↦ F'(x)ᵀ w for ``count`` cotangents, the columns of w."""
        flow.compile()
        return _reverse(flow, has_second, name, ins, outs, count)

    return _Function("gyrospark_run", {"x": x_shape}, {"z": z_shape},
                     lambda x: (flow.value(x.T).T,),
                     {"jacobian": jacobian, "forward": forward, "reverse": reverse})


def _reverse(
    flow: DiscreteFlow, has_second: bool, name: str, ins: list[str], outs: list[str], count: int
) -> Any:
    """Return x, z, w ↦ F'(x)ᵀ w; its Jacobian is one of second order.

    w has ``count`` columns, the seeds; z is the value F(x), which CasADi passes and nothing uses.
    """
    shapes = [(flow.size, 1), (2 * flow.n, 1), (2 * flow.n, count)]

    def jacobian(name: str, ins: list[str], outs: list[str]) -> Any:
        """Return the Jacobian of x, z, w ↦ F'(x)ᵀ w by the three arguments; refused without
        second order."""
        if not has_second:
            raise no_second_order(
                ": IPOPT does without them by hessian_approximation=\"limited-memory\"")
        flow.compile(second=True)
        width = flow.size * count
        return _Function(
            name, _name_shapes(ins, [*shapes, (flow.size, count)]),
            _name_shapes(outs, [(width, height * columns) for height, columns in shapes]), second)

    def second(x: Array, z: Array, w: Array, nominal: Array) -> tuple[Array, ...]:
        """Return the Jacobian of F'(x)ᵀ w by x, by z (0) and by w, side by side in columns.

        With the ``count`` columns of w stacked it has size · count rows, and size, 2n and 2n count
        columns. ``nominal`` is the value F'(x)ᵀ w, which CasADi passes and nothing uses.
        """
        # a flow takes rows, CasADi has columns. By the stacked columns of w the derivative is a
        # block F'ᵀ for each of them
        first_order = flow.jacobian(x.T)[0].T
        unit = np.eye(flow.size)[None]
        # each cotangent is differentiated along all entries of x at once
        by_x = np.concatenate([
            flow.second(flow.adjoint, x.T, np.repeat(cotangent[None, None], flow.size, axis=1),
                        unit)[0].T for cotangent in w.T])
        return by_x, np.zeros((len(by_x), len(z))), np.kron(np.eye(count), first_order)

    return _Function(name, _name_shapes(ins, shapes), _name_shapes(outs, [(flow.size, count)]),
                     lambda x, z, w: (flow.adjoint(x.T, w.T[None])[0].T,), {"jacobian": jacobian})
