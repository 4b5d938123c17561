"""Costs of a fixed-point iteration and of a Newton iteration, counted from the kernels they call.

``solver="auto"`` selects the cheaper method. The number of iterations a step takes is measured in
the run; the cost of one is estimated here, in units of an addition. The C compares the two without
a clock, so that a run has the same bits on a busy machine.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from ...core.real_types import Real
from ...core.records import dataclass
from ..kernels.kernel import EmittedKernel
from ..schemes.step_equations import MeanScheme, SparkScheme
from ..systems.lagrangian import LagrangianSystem
from .mass_tables import composed_operations
from .program import Elements

__all__ = ["Cost", "solver_costs"]

#: Time of an operation, in additions; "product" adds a product to a sum of two words. Other names
#: are calls of <math.h>, lane by lane.
_WEIGHTS = {"add": 1.0, "mul": 1.0, "div": 6.0, "sqrt": 8.0, "product": 12.0}
_CALL = 40.0
#: The same where sines and cosines are computed for all lanes at once: ``lanes.c.jinja``.
_WEIGHTS_OF_DOUBLE = _WEIGHTS | {"sin": _CALL, "cos": _CALL}

#: For SPARK, and for IMS and EMS: phase of a step → names of the kernels that it calls for a stage,
#: and for a constraint node. ``_DENSE`` are kernels of the whole system, ``_ELEMENTS`` of element
#: templates.
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
    """Cost of arithmetic, on all lanes at once, and of calls of <math.h>, lane by lane."""

    arithmetic: float = 0.0
    calls: float = 0.0

    def __add__(self, other: Cost) -> Cost:
        return Cost(self.arithmetic + other.arithmetic, self.calls + other.calls)

    def times(self, count: float) -> Cost:
        """Return the cost of ``count`` repetitions."""
        return Cost(count * self.arithmetic, count * self.calls)

    @property
    def total(self) -> float:
        """The cost without lanes."""
        return self.arithmetic + self.calls

    @classmethod
    def of(cls, operations: Mapping[str, int], real: Real) -> Cost:
        """Return the cost of some operations on numbers of a type."""
        weights = _WEIGHTS_OF_DOUBLE if real.name == "double" else _WEIGHTS
        return cls(sum(weights[name] * n for name, n in operations.items() if name in weights),
                   sum(_CALL * n for name, n in operations.items() if name not in weights))


def solver_costs(
    scheme: SparkScheme | MeanScheme, kernels: Iterable[EmittedKernel],
    elements: Elements | None, real: Real,
) -> dict[str, int]:
    """Return costs of a stage and of a constraint node in an iteration, a residual and a Jacobian.

    By these and measured numbers of iterations, the engine selects the solver of a step. Costs are
    in additions; of an iteration, ``*_lanes`` is arithmetic, which costs as much for all lanes as
    for one, and ``*_calls`` are functions of <math.h>, which cost this for each stage or node.
    """
    kind = "spark" if isinstance(scheme, SparkScheme) else "mean"
    recipe = (_DENSE if elements is None else _ELEMENTS)[kind]
    kernels = list(kernels)
    # kernels on lanes come last, and replace the scalar ones
    operations = {k.name.removeprefix("lanes_"): k.operations for k in kernels}
    if isinstance(scheme.system, LagrangianSystem):
        operations |= composed_operations(scheme.system, kernels)
    cost_at_stage, cost_at_node = (_dense_cost(operations, real) if elements is None
                                   else _elements_cost(elements, real))
    costs: dict[str, int] = {}
    for phase, (stage_kernels, node_kernels) in recipe.items():
        stage = sum(map(cost_at_stage, stage_kernels), Cost())
        # without constraints there are no nodes
        node = sum(map(cost_at_node, node_kernels), Cost()) if scheme.system.m else Cost()
        if phase == "iteration":
            costs |= {"stage_lanes": round(stage.arithmetic), "stage_calls": round(stage.calls),
                      "node_lanes": round(node.arithmetic), "node_calls": round(node.calls)}
        else:
            costs |= {f"{phase}_stage": round(stage.total), f"{phase}_node": round(node.total)}
    return costs


def _dense_cost(operations: Mapping[str, Mapping[str, int]], real: Real) -> tuple[Any, Any]:
    """Return two equal functions name → cost of a kernel, as ``_elements_cost`` does."""
    def cost(name: str) -> Cost:
        """Return the cost of a kernel of the whole system; 0 for one that it does not have."""
        return Cost.of(operations.get(name, {}), real)

    return cost, cost


def _elements_cost(elements: Elements, real: Real) -> tuple[Any, Any]:
    """Return two functions name → cost of a kernel: of energies and forces, and of constraints."""

    def sum_over(templates: list[dict[str, Any]]) -> Any:
        """Return a function: kernel name → its cost in all instances of the templates."""
        def cost(name: str) -> Cost:
            """Return the cost of a kernel, summed over templates and their instances."""
            total = Cost()
            for template in templates:
                for kernel in template["kernels"]:
                    if kernel["name"] == name:
                        total += Cost.of(kernel["operations"], real).times(template["count"])
            return total

        return cost

    return sum_over([*elements.energies, *elements.forces]), sum_over(elements.constraints)
