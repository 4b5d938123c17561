"""Functions of one state, in the parameters themselves: energy, quantities, velocities."""

from __future__ import annotations

from ...core.real_types import Real
from ..kernels.kernel import Constants, EmittedKernel, Target, emit_kernel
from ..kernels.statements import Kernel
from ..schemes.start_kernels import StartKernels, energy_kernel
from ..systems.system import System
from .program import Derived, StateFunctions

__all__ = ["quantity_kernel", "state_functions"]


def state_functions(derived: Derived) -> StateFunctions | None:
    """Return the functions of profile ``control``."""
    if derived.profile != "control":
        return None
    start = StartKernels(derived.system)
    own = start.kernels() if start.exists else []
    return StateFunctions(
        own=start,
        kernels=[_emitted(kernel, derived.system, derived.real)
                 for kernel in [energy_kernel(derived.system), *own]],
        velocities=start.names if start.exists else [],
        held=len(start.conditions) if start.exists else 0,
    )


def quantity_kernel(system: System, real: Real) -> EmittedKernel | None:
    """Return the kernel of the user's quantities."""
    if not system.quantities:
        return None
    time = {} if system.time is None else {"t": [system.time]}
    return _emitted(Kernel("quantities", "What the user asked for of a state",
                           {**time, "q": list(system.q), "p": list(system.p)},
                           {"out": list(system.quantities.values())}), system, real)


def _emitted(kernel: Kernel, system: System, real: Real) -> EmittedKernel:
    return emit_kernel(kernel, Constants(system.parameters), real,
                       Target(real.c_type, "parameters_t", ""))
