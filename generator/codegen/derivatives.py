"""Tangents and adjoints of a stepper: which kernels, columns and tables its C has for them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import sympy as sp

from ..kernels.c_printer import CPrinter
from ..kernels.kernel import Constants, EmittedKernel, Target, emit_kernel
from ..kernels.statements import Kernel
from ..schemes.derivative_kernels import (
    derivative_kernels,
    flow_transposes,
    impact_derivatives,
    quantity_derivatives,
    quantity_rates,
    switch_kernel,
    time_columns,
)
from ..schemes.splitting_scheme import SplittingScheme
from ..schemes.step_equations import SparkScheme, common_kernels
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


class _StateKernels(NamedTuple):
    """The kernels of functions of one state that derivatives need; None where a system has none.

    Attributes
    ----------
    quantities, rates : Kernel or None
        Derivatives of the user's quantities, and of their rates along a motion.
    switches : Kernel or None
        The switching functions of H and the forces.
    impacts : Kernel or None
        Derivatives of an impact.
    """

    quantities: Kernel | None
    rates: Kernel | None
    switches: Kernel | None
    impacts: Kernel | None


class _Kernels(NamedTuple):
    """The kernels of the derivatives of a step.

    Attributes
    ----------
    derivatives : list of Kernel
        Derivatives that a step itself does not need, by state and by constants.
    linearisation : list of Kernel
        All kernels that the linearisation of a step calls, for lanes.
    duals : list of Kernel
        Kernels that are evaluated on dual numbers.
    """

    derivatives: list[Kernel]
    linearisation: list[Kernel]
    duals: list[Kernel]


class _ParameterChain(NamedTuple):
    """The chain rule from constants c of a run to parameters θ.

    Attributes
    ----------
    slopes : list of expressions
        The dc_i/dθ_j that are not 0.
    entries : list of (int, int, str)
        i, j and C of each slope.
    functions : frozenset of str
        Functions that this C calls.
    """

    slopes: list[sp.Expr]
    entries: list[tuple[int, int, str]]
    functions: frozenset[str]


def derivatives_of(
    derived: Derived, constants_c: dict[str, str], elements: Elements | None,
    iteration: LaneIteration | None,
) -> Derivatives:
    """Return the kernels and tables from which the C of tangents and adjoints is made.

    Parameters
    ----------
    constants_c : dict
        Name of each constant of a run → C of its value.
    elements : Elements or None
        The element templates, if the C of the stepper loops over them.
    iteration : LaneIteration or None
        The iteration on lanes, whose kernels are not emitted again.
    """
    scheme, system, real = derived.scheme, derived.system, derived.real
    definition_of = {str(s): (s, e) for e, s in derived.constants.definitions.items()}
    # the symbol of each constant of a run, and its expression in the parameters
    constants = [definition_of[name] for name in constants_c]
    times = time_columns(scheme)
    # the symbols that kernels are differentiated by, a column of their Jacobians for each; C has no
    # arrays of length 0: without constants there is one column of zeros
    columns = [*(s for s, _ in constants or [(sp.Dummy(), 0)]), *times]
    element_tables = [] if elements is None else element_derivatives(derived, elements)
    step = _step_kernels(derived, columns, has_templates=bool(element_tables))
    # small systems are linearised on lanes, systems with element templates are not
    kernels, lane_kernels = _emit_kernels(derived, step, None if element_tables else iteration)
    state_kernels = _state_kernels(derived)
    # functions of one state are in the user's parameters, not in constants of a run
    kernels += [emit_kernel(kernel, Constants(system.parameters), real,
                            Target(real.c_type, constants="parameters_t", prefix=""))
                for kernel in state_kernels if kernel is not None]
    chain = _parameter_chain(derived, [e for _, e in constants])
    # second derivatives, and derivatives of flows that are not on lanes, are by dual numbers
    needs_duals = derived.second or (isinstance(scheme, SplittingScheme) and not lane_kernels)
    duals = dual_kernels(derived, step.duals, chain.slopes) if needs_duals else None
    # an input that no formula uses is no constant of a run: its column is −1
    index_of = {name: i for i, name in enumerate(constants_c)}
    return Derivatives(
        kernels=kernels,
        columns=len(columns),
        times=len(times),
        chain=chain.entries,
        inputs=[index_of.get(str(u), -1) for u in system.inputs],
        functions=chain.functions.union(
            *(k.functions for k in kernels),
            *(k["scalar"].functions for table in element_tables
              for k in table["derivative_kernels"]),
            duals.functions if duals else ()),
        element_tables=element_tables,
        lane_kernels=lane_kernels,
        quantities=state_kernels.quantities is not None,
        quantity_rates=state_kernels.rates is not None,
        duals=duals,
        second=derived.second,
        impacts=state_kernels.impacts is not None,
        switches=0 if state_kernels.switches is None else len(state_kernels.switches.outputs["w"]),
    )


def _emit_kernels(
    derived: Derived, step: _Kernels, iteration: LaneIteration | None
) -> tuple[list[EmittedKernel], list[EmittedKernel]]:
    """Return the C of the kernels of a step's derivatives: on numbers, and on lanes.

    There are none on lanes if ``iteration`` is None or the system is not small; with them, numbers
    keep only the kernels that are called once a step, at its end.
    """
    scalar = [emit_kernel(k, derived.constants, derived.real) for k in step.derivatives]
    if iteration is None or not _fits_lanes(derived):
        return scalar, []
    # the iteration has emitted some of them already
    names = {k.name for k in iteration.kernels}
    # derivatives of f belong to the projection of momenta, which ends steps of SPARK alone
    is_spark = isinstance(derived.scheme, SparkScheme)
    lanes = [emit_kernel(k, derived.constants, derived.real, Target.lanes(names={}))
             for k in step.linearisation if f"lanes_{k.name}" not in names
             and (is_spark or k.name != "hidden_derivative")]
    end_kernels = {"hidden_derivative", "constraint_by_constants", "mean_rates_derivative"}
    if derived.system.is_time_dependent:
        end_kernels.add("rates_by_constants")
    return [k for k in scalar if k.name in end_kernels], lanes


def _state_kernels(derived: Derived) -> _StateKernels:
    """Return the kernels of functions of one state; rates of quantities only in profile full."""
    system = derived.system
    return _StateKernels(
        quantities=quantity_derivatives(system),
        rates=quantity_rates(system) if derived.profile == "full" else None,
        switches=switch_kernel(system),
        impacts=impact_derivatives(system) if derived.second else None)


def _step_kernels(
    derived: Derived, columns: Sequence[sp.Symbol], *, has_templates: bool
) -> _Kernels:
    """Return the kernels of the derivatives of a step, by state and by ``columns``.

    ``columns`` are the symbols of the constants, then of the times. Element templates have kernels
    of their own (``element_derivatives``): no kernels are returned for them.
    """
    if has_templates:
        return _Kernels(derivatives=[], linearisation=[], duals=[])
    scheme = derived.scheme
    derivatives = derivative_kernels(scheme, columns)
    if not isinstance(scheme, SplittingScheme):
        linearisation = [
            k for k in [*common_kernels(scheme.system), *scheme.kernels(), *derivatives]
            if k.name in LINEARISATION]
        return _Kernels(derivatives, linearisation, linearisation)
    # the adjoint of a flow is written with transposes, its tangent with dual numbers
    transposes = flow_transposes(scheme, columns)
    derivatives = [*derivatives, *transposes]
    duals = [*scheme.kernels(), *scheme.flow_kernels(work=False)]
    if derived.second:
        duals += [*derivatives, *(k for k in scheme.state_kernels() if k.name in LINEARISATION)]
    space_rates = [k for k in scheme.kernels() if k.name == "space_rates"]
    return _Kernels(derivatives, [*transposes, *space_rates], duals)


def _fits_lanes(derived: Derived) -> bool:
    """Whether steps are linearised on lanes: small systems with an H, without dual numbers."""
    return (not derived.second and not isinstance(derived.system, LagrangianSystem)
            and not derived.real.wide and derived.scheme.size <= _MOST_UNKNOWNS
            and derived.system.n <= _MOST_COORDINATES)


def _parameter_chain(derived: Derived, constants: Sequence[sp.Expr]) -> _ParameterChain:
    """Return the slopes of the constants c(θ) by the user's parameters θ, constant by constant."""
    system = derived.system
    printer = CPrinter(derived.real, {p: f"par->{p}" for p in derived.constants.parameters}
                       | {START: f"par->{system.time}"})
    index_of = {p: j for j, p in enumerate(system.parameters)}
    slopes: list[sp.Expr] = []
    entries: list[tuple[int, int, str]] = []
    for i, e in enumerate(constants):
        for p in sorted(e.free_symbols & index_of.keys(), key=index_of.__getitem__):
            slope = derivative(e, p)
            if slope != 0:
                slopes.append(slope)
                entries.append((i, index_of[p], printer.number(slope)))
    return _ParameterChain(slopes, entries, frozenset(printer.functions))
