"""Tangents and adjoints of a stepper: which kernels, columns and tables its C has for them."""

from __future__ import annotations

import sympy as sp

from ..kernels.c_printer import CPrinter
from ..kernels.kernel import Constants, Target, emit_kernel
from ..schemes.derivative_kernels import (
    derivative_kernels,
    flow_transposes,
    quantity_derivatives,
    quantity_rates,
    switch_kernel,
    time_columns,
)
from ..schemes.splitting_scheme import SplittingScheme
from ..schemes.step_equations import common_kernels
from ..symbolic.derivatives import derivative
from ..symbolic.phases import START
from ..systems.lagrangian import LagrangianSystem
from .element_derivatives import element_derivatives
from .program import Derivatives, Derived, Elements, LaneIteration
from .second_order import dual_kernels

__all__ = ["LINEARISATION", "derivatives_of"]

#: Kernels of a linearisation.
LINEARISATION = {
    "hessian", "constraint_jacobian", "constraint_curvature", "rates_by_constants",
    "force_by_constants", "constraint_by_constants", "hidden_derivative", "mean_jacobian",
    "mean_curvature", "mean_constraint", "mean_rates_derivative", "mean_constraint_by_start"}

#: Unknowns and coordinates up to which steps are linearised on lanes: the adjoint of each unit
#: vector is then cheaper than one adjoint on numbers, and J of all lanes fits in the cache.
_MOST_UNKNOWNS, _MOST_COORDINATES = 48, 8


def derivatives_of(
    derived: Derived, constants_c: dict[str, str], elements: Elements | None,
    iteration: LaneIteration | None,
) -> Derivatives:
    """Return the derivatives of a stepper whose C has these constants."""
    scheme, system, real = derived.scheme, derived.system, derived.real
    symbols = {str(s): (s, e) for e, s in derived.constants.definitions.items()}
    constants = [symbols[name] for name in constants_c]
    times = time_columns(scheme)
    columns = [*(s for s, _ in constants or [(sp.Dummy(), 0)]), *times]
    parts = [] if elements is None else element_derivatives(derived, elements)
    own = [] if parts else derivative_kernels(scheme, columns)
    if isinstance(scheme, SplittingScheme):
        of_linearisation = flow_transposes(scheme, columns)
        own += of_linearisation
        on_duals = [*scheme.kernels(), *scheme.flow_kernels(work=False)]
        of_linearisation = [*of_linearisation,
                            *(k for k in scheme.kernels() if k.name == "space_rates")]
        if derived.second:
            on_duals += [*own, *(k for k in scheme.state_kernels() if k.name in LINEARISATION)]
    else:  # element templates have kernels of their own
        of_linearisation = on_duals = [] if parts else [
            k for k in [*common_kernels(scheme.system), *scheme.kernels(), *own]
            if k.name in LINEARISATION]
    kernels = [emit_kernel(k, derived.constants, real) for k in own]
    lanes = []
    if (iteration is not None and not parts and not derived.second
            and not isinstance(system, LagrangianSystem) and not real.wide
            and scheme.size <= _MOST_UNKNOWNS and system.n <= _MOST_COORDINATES):
        known = {k.name for k in iteration.kernels}
        lanes = [emit_kernel(k, derived.constants, real, Target.lanes({}))
                 for k in of_linearisation if f"lanes_{k.name}" not in known]
        used = {"hidden_derivative", "constraint_by_constants", "mean_rates_derivative",
                *({"rates_by_constants"} if system.is_time_dependent else ())}  # of one state
        kernels = [k for k in kernels if k.name in used]
    quantities = quantity_derivatives(system)
    if quantities is not None:
        kernels.append(emit_kernel(quantities, Constants(system.parameters), real,
                                   Target(real.c_type, "parameters_t", "")))
    rates = quantity_rates(system) if derived.profile == "full" else None
    switches = switch_kernel(system)
    for kernel in (rates, switches):
        if kernel is not None:
            kernels.append(emit_kernel(kernel, Constants(system.parameters), real,
                                       Target(real.c_type, "parameters_t", "")))
    called = [*kernels, *(k["scalar"] for part in parts for k in part["own"])]
    printer = CPrinter(real, {p: f"par->{p}" for p in derived.constants.parameters}
                       | {START: f"par->{system.time}"})
    order = {p: j for j, p in enumerate(system.parameters)}
    slopes = [(i, order[p], d) for i, (_, e) in enumerate(constants)
              for p in sorted(e.free_symbols & order.keys(), key=order.__getitem__)
              if (d := derivative(e, p)) != 0]
    duals = dual_kernels(derived, on_duals, [d for *_, d in slopes]) if derived.second or (
        isinstance(scheme, SplittingScheme) and not lanes) else None
    places = {name: i for i, name in enumerate(constants_c)}
    return Derivatives(
        kernels=kernels,
        columns=len(columns),
        times=len(times),
        chain=[(i, j, printer.number(d)) for i, j, d in slopes],
        inputs=[places.get(str(u), -1) for u in system.inputs],
        functions=frozenset(printer.functions).union(
            duals.functions if duals else (), *(k.functions for k in called)),
        parts=parts,
        lanes=lanes,
        quantities=quantities is not None,
        quantity_rates=rates is not None,
        duals=duals,
        second=derived.second,
        switches=0 if switches is None else len(switches.outputs["w"]),
    )

