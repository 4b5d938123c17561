"""The elimination of the mass matrix of a Lagrangian, and the cost of derivatives of H.

There are kernels of M, b, V and L_q; the engine computes H and its derivatives from them and the
factors of M.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable

from ..kernels.kernel import EmittedKernel
from ..systems.lagrangian import LagrangianSystem
from .program import MassTables

__all__ = ["composed_operations", "mass_tables"]


def mass_tables(system: LagrangianSystem) -> MassTables:
    """Return the tables of the elimination of M without its zeros."""
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
    """Return the operations of the derivatives of H, by the names of the kernels of other systems.

    With p = M v + b: H_p = v takes the factors of M and one solve, H_q = −L_q(q, v) one kernel
    more, each of the 2 n columns of second derivatives d(L_q) and a solve, and Newton's system n³.
    The result maps kernel → operation → count.
    """
    # a kernel that the system does not have costs nothing
    counts = defaultdict(Counter[str], {k.name.removeprefix("lanes_"): Counter(k.operations)
                                        for k in kernels})
    n = system.n
    # M = L D Lᵀ without its zeros; where M may be indefinite, a dense M = Q R by Gram-Schmidt
    products = system.elimination.products if system.is_definite else n * n * (n + 1)
    off_diagonal = system.elimination.entries - n if system.is_definite else n * n
    factor = counts["mass_matrix"] + Counter(div=n, mul=products, add=products)
    # M v = p − b by both triangles and D
    solve = counts["rest_momentum"] + Counter(mul=2 * off_diagonal + n, add=2 * off_diagonal + n)
    column = counts["force_derivative"] + counts["applied_force_derivative"] + solve
    dense_products = Counter(mul=n**3, add=n**3)
    velocity = factor + solve
    gradient = velocity + counts["generalised_force"]
    hessian = factor + _multiply_counts(column, 2 * n) + dense_products
    composed = {"velocity": velocity, "force": solve + counts["generalised_force"],
                "gradient": gradient, "hessian": hessian,
                "mean_velocity": velocity, "mean_force": gradient, "mean_gradient": gradient,
                "mean_jacobian": hessian}
    if "mean_generalised_force" in counts:  # EMS: the velocities of both ends
        both_velocities = _multiply_counts(velocity, count=2)
        by_both_states = _multiply_counts(counts["mean_generalised_force_derivative"], count=2)
        columns = _multiply_counts(counts["force_derivative"] + by_both_states + solve, n)
        force = both_velocities + counts["mean_generalised_force"]
        composed |= {"mean_velocity": both_velocities, "mean_force": force, "mean_gradient": force,
                     "mean_jacobian": both_velocities + columns + dense_products}
    return {name: dict(count) for name, count in composed.items()}


def _multiply_counts(operations: Counter[str], count: int) -> Counter[str]:
    """Return the operations of ``count`` repetitions."""
    return Counter({name: count * n for name, n in operations.items()})
