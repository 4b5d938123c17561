"""Costs of a fixed-point iteration and of a Newton iteration, counted from the kernels they call.

``solver="auto"`` selects the cheaper method. The number of iterations a step takes is measured in
the run; the cost of one is estimated here, in units of an addition. The C compares the two without
a clock, so that a run has the same bits on a busy machine.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ..kernels.kernel import EmittedKernel
from ..schemes.step_equations import MeanScheme, SparkScheme
from ..systems.lagrangian import LagrangianSystem
from .mass_tables import composed_operations
from .program import Elements

__all__ = ["Cost", "solver_costs"]

#: Additions that an operation takes as long as; any other is a call of <math.h>.
_WEIGHTS = {"add": 1.0, "mul": 1.0, "div": 6.0, "sqrt": 8.0, "product": 12.0}
_CALL = 40.0

#: Kernels of a stage, and of a constraint node, in an iteration, a residual and a Jacobian.
_DENSE = {
    "spark": {"iteration": (["velocity", "force"], ["constraint_increment", "constraint_jacobian"]),
              "residual": (["gradient"], ["constraint_increment", "constraint_jacobian"]),
              "jacobian": (["hessian"], ["constraint_curvature"])},
    "mean": {"iteration": (["mean_velocity", "mean_force"],
                       ["constraint_increment", "mean_constraint"]),
             "residual": (["mean_gradient"],
                          ["constraint", "constraint_increment", "mean_constraint"]),
             "jacobian": (["mean_jacobian"], ["mean_curvature", "constraint_jacobian"])},
}
_ELEMENTS = {
    "spark": {"iteration": (["velocity", "gradient", "value"], ["increment", "reaction"]),
              "residual": (["gradient", "value"], ["increment", "reaction"]),
              "jacobian": (["hessian", "jacobian"], ["jacobian", "curvature"])},
    "mean": {"iteration": (["mean_velocity", "mean_velocity", "mean_gradient", "value"],
                       ["increment", "mean_reaction", "mean_reaction"]),
             "residual": (["mean_gradient", "value"], ["value", "increment", "mean_reaction"]),
             "jacobian": (["mean_jacobian", "jacobian"],
                          ["mean_jacobian", "mean_curvature", "jacobian"])},
}


@dataclass(frozen=True)
class Cost:
    """Arithmetic, which lanes do side by side, and calls of <math.h>, which they do in turn."""

    arithmetic: float = 0.0
    calls: float = 0.0

    def __add__(self, other: Cost) -> Cost:
        return Cost(self.arithmetic + other.arithmetic, self.calls + other.calls)

    def times(self, count: float) -> Cost:
        """Return the cost of doing it so often."""
        return Cost(count * self.arithmetic, count * self.calls)

    @property
    def total(self) -> float:
        """The cost for one number at a time."""
        return self.arithmetic + self.calls

    @classmethod
    def of(cls, operations: Mapping[str, int]) -> Cost:
        """Return the cost of some operations."""
        return cls(sum(_WEIGHTS[name] * n for name, n in operations.items() if name in _WEIGHTS),
                   sum(_CALL * n for name, n in operations.items() if name not in _WEIGHTS))


def solver_costs(
    scheme: SparkScheme | MeanScheme, kernels: Iterable[EmittedKernel],
    elements: Elements | None,
) -> dict[str, int]:
    """Return costs of a stage and of a constraint node in an iteration, a residual and a Jacobian.

    Of an iteration, ``*_lanes`` is done for all lanes at once, ``*_calls`` once a stage or node.
    """
    kind = "spark" if isinstance(scheme, SparkScheme) else "mean"
    recipe = (_DENSE if elements is None else _ELEMENTS)[kind]
    kernels = list(kernels)
    operations = {k.name.removeprefix("lanes_"): k.operations for k in kernels}  # lanes come last
    if isinstance(scheme.system, LagrangianSystem):
        operations |= composed_operations(scheme.system, kernels)
    of_stage, of_node = _dense_cost(operations) if elements is None else _elements_cost(elements)
    costs: dict[str, int] = {}
    for part, names in recipe.items():
        stage, node = (sum(map(cost, kernels_of), Cost())
                       for cost, kernels_of in zip((of_stage, of_node), names, strict=True))
        if not scheme.system.m:
            node = Cost()
        if part == "iteration":
            costs |= {"stage_lanes": round(stage.arithmetic), "stage_calls": round(stage.calls),
                      "node_lanes": round(node.arithmetic), "node_calls": round(node.calls)}
        else:
            costs |= {f"{part}_stage": round(stage.total), f"{part}_node": round(node.total)}
    return costs


def _dense_cost(operations: Mapping[str, Mapping[str, int]]) -> tuple[Any, Any]:
    def cost(name: str) -> Cost:
        return Cost.of(operations.get(name, {}))

    return cost, cost


def _elements_cost(elements: Elements) -> tuple[Any, Any]:
    """Return costs of kernels by name: of the terms and forces, and of the joints."""

    def over(parts: list[dict[str, Any]]) -> Any:
        def cost(name: str) -> Cost:
            return sum((Cost.of(k["operations"]).times(part["count"]) for part in parts
                        for k in part["kernels"] if k["name"] == name), Cost())

        return cost

    return over([*elements.energies, *elements.forces]), over(elements.constraints)
