"""Functions of one state, in the parameters themselves: energy, quantities, velocities."""

from __future__ import annotations

from ...core.arguments import few
from ...core.errors import InputError
from ..kernels.kernel import Constants, EmittedKernel, Target, emit_kernel
from ..kernels.statements import Kernel
from ..schemes.start_kernels import StartKernels, energy_kernel
from .program import Derived, StateFunctions

__all__ = ["quantity_kernel", "state_functions"]


def state_functions(derived: Derived) -> StateFunctions | None:
    """Return the functions of one state, or None: only profile ``control`` has them."""
    if derived.profile != "control":
        return None
    start = StartKernels(derived.system)
    start_kernels = start.kernels() if start.exists else []
    return StateFunctions(
        own=start,
        kernels=[_emit_in_parameters(k, derived)
                 for k in [energy_kernel(derived.system), *start_kernels]],
        velocities=start.names if start.exists else [],
        held=len(start.conditions) if start.exists else 0,
    )


def quantity_kernel(derived: Derived) -> EmittedKernel | None:
    """Return the kernel of the user's quantities, functions of t, q and p; None without any.

    Raises InputError for one with velocities of a Lagrangian, which this C has not solved for.
    """
    system = derived.system
    if not system.quantities:
        return None
    velocities = {*system.velocities} - {*system.parameters}
    for name, expression in system.quantities.items():
        if used_velocities := expression.free_symbols & velocities:
            raise InputError(
                f"Quantity {name!r} of system {system.name!r} contains the velocity "
                f"{min(map(str, used_velocities))!r}; write it in q and p, {few(system.p)}, take "
                "the system of system.legendre(), or compute it from run.velocities.")
    time = {} if system.time is None else {"t": [system.time]}
    kernel = Kernel("quantities", "What the user asked for of a state",
                    {**time, "q": list(system.q), "p": list(system.p)},
                    {"out": list(system.quantities.values())})
    return _emit_in_parameters(kernel, derived)


def _emit_in_parameters(kernel: Kernel, derived: Derived) -> EmittedKernel:
    """Return the C of a kernel that takes the parameters, not the constants of a run."""
    target = Target(derived.real.c_type, constants="parameters_t", prefix="",
                    explicit=derived.profile == "control")
    return emit_kernel(kernel, Constants(derived.system.parameters), derived.real, target)
