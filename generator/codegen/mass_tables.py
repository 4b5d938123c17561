"""The elimination of the mass matrix of a Lagrangian, and what derivatives of H cost.

Kernels of M, b, V and L_q are expressions; the engine composes H and its derivatives of them, with
the factors of M.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable

from ..kernels.kernel import EmittedKernel
from ..systems.lagrangian import LagrangianSystem
from .program import MassTables

__all__ = ["composed_operations", "mass_tables"]


def mass_tables(system: LagrangianSystem) -> MassTables:
    """Return the tables of the elimination of M, and how many entries it has."""
    elimination = system.elimination
    return MassTables(
        entries=elimination.entries,
        definite=system.is_definite,
        order=elimination.order,
        counts=[len(rows) for rows in elimination.rows],
        flat_rows=[row for rows in elimination.rows for row in rows],
        flat_slots=[slot for slots in elimination.slots for slot in slots],
        flat_targets=[slot for slots in elimination.targets for slot in slots],
    )


def composed_operations(
    system: LagrangianSystem, kernels: Iterable[EmittedKernel]
) -> dict[str, dict[str, int]]:
    """Return the operations of H's derivatives, by the names that those of other systems have."""
    own = defaultdict(Counter[str], {k.name.removeprefix("lanes_"): Counter(k.operations)
                                     for k in kernels})
    n = system.n
    products = system.elimination.products if system.is_definite else n * n * (n + 1)
    factor = own["mass_matrix"] + Counter(div=n, mul=products, add=products)
    below = system.elimination.entries - n if system.is_definite else n * n
    solve = own["rest_momentum"] + Counter(mul=2 * below + n, add=2 * below + n)
    column = own["force_derivative"] + own["applied_force_derivative"] + solve
    newton = Counter({name: 2 * n * count for name, count in column.items()}
                     ) + Counter(mul=n**3, add=n**3)
    made = {"velocity": factor + solve, "force": solve + own["generalised_force"],
            "gradient": factor + solve + own["generalised_force"], "hessian": factor + newton}
    mean = {"mean_velocity": made["velocity"], "mean_force": made["gradient"],
            "mean_gradient": made["gradient"], "mean_jacobian": made["hessian"]}
    if "mean_generalised_force" in own:  # EMS: the velocities of both ends
        both = Counter({name: 2 * count for name, count in made["velocity"].items()})
        by_state = own["mean_generalised_force_derivative"]
        change = own["force_derivative"] + by_state + by_state + solve
        columns = Counter({name: n * count for name, count in change.items()})
        mean = {"mean_velocity": both, "mean_force": both + own["mean_generalised_force"],
                "mean_gradient": both + own["mean_generalised_force"],
                "mean_jacobian": both + columns + Counter(mul=n**3, add=n**3)}
    return {name: dict(count) for name, count in (made | mean).items()}
