"""Kernels of a system from its Lagrangian: L is differentiated, M(q) is factorised by the engine.

The engine solves M v = p − b for v at a state (q, p); every kernel here is a function of q and v.
Second derivatives of H, for Newton's method, are computed column by column as derivatives of L_q
along a direction: a kernel as long as L_q, not n times as long.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from ..kernels.statements import Kernel
from ..symbolic.derivatives import along
from ..systems.lagrangian import LagrangianSystem
from .system_differences import time_input, vector

__all__ = ["motion_kernels", "newton_kernels", "state_kernels"]


@lru_cache(maxsize=4)
def state_kernels(system: LagrangianSystem) -> list[Kernel]:
    """Return the kernels of H and of the forces: M, b, V, F."""
    q = {"q": list(system.q)}
    arguments = {**q, "v": list(system.velocities), **time_input(system)}
    kernels = [
        Kernel("mass_matrix", "M = d^2L/dv^2, its entries as they are eliminated", q,
               {"A": system.mass_entries}),
        Kernel("rest_momentum", "b, the momentum of v = 0", q, {"b": system.rest_momenta}),
        Kernel("potential", "V(q)", q, {"V": system.potential}),
    ]
    if system.forces:
        kernels.append(Kernel("force_of_velocity", "F(q, v, t), which no potential has", arguments,
                              {"F": list(system.forces)}))
    # the search for common factors takes quadratic time, too long for a long L
    return [replace(k, factors=not system.is_long) for k in kernels]


def motion_kernels(system: LagrangianSystem) -> list[Kernel]:
    """Return the kernels of L_q + F and, with explicit time, of H_t = −L_t, at given v."""
    arguments = {"q": list(system.q), "v": list(system.velocities)}
    plus_forces = " + F" if system.forces else ""
    kernels = [Kernel("generalised_force", f"R = dL/dq{plus_forces} at fixed v",
                      arguments | time_input(system), {"R": system.generalised_force})]
    if system.is_time_dependent:
        # no ``time_input``: where H depends on time, the time is among the constants of a system
        kernels.append(Kernel("energy_rate_of_velocity",
                              "H_t = -dL/dt at fixed v, the power of what drives L", arguments,
                              {"H_t": system.H_t}))
    # the search for common factors takes quadratic time, too long for a long L
    return [replace(k, factors=not system.is_long) for k in kernels]


def newton_kernels(system: LagrangianSystem) -> list[Kernel]:
    """Return the kernels of the derivatives along (dq, dv), L_qq dq + L_qv dv and F_q dq + F_v dv.

    −H_q is L_q at fixed v, so that ``system.H_q`` serves as −L_q.
    """
    symbols = [*system.q, *system.velocities]
    dq, dv = vector("dq", system.n), vector("dv", system.n)
    arguments = {"q": list(system.q), "v": list(system.velocities)}
    direction = {"dq": dq, "dv": dv}
    kernels = [Kernel("force_derivative", "d(dL/dq) along (dq, dv)", arguments | direction,
                      {"dR": along([-e for e in system.H_q], symbols, [*dq, *dv])})]
    if system.forces:
        kernels.append(Kernel("applied_force_derivative", "dF along (dq, dv)",
                              arguments | time_input(system) | direction,
                              {"dF": along(system.forces, symbols, [*dq, *dv])}))
    # the search for common factors takes quadratic time, too long for a long L
    return [replace(k, factors=not system.is_long) for k in kernels]
