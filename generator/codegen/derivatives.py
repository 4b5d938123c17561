"""Tangents and adjoints of a stepper: which kernels, columns and tables its C has for them."""

from __future__ import annotations

import sympy as sp

from ..kernels.c_printer import CPrinter
from ..kernels.kernel import emit_kernel
from ..schemes.derivative_kernels import derivative_kernels, time_columns
from ..symbolic.derivatives import derivative
from .element_derivatives import element_derivatives
from .program import Derivatives, Derived, Elements

__all__ = ["derivatives_of"]


def derivatives_of(
    derived: Derived, constants_c: dict[str, str], elements: Elements | None
) -> Derivatives:
    """Return the derivatives of a stepper whose C has these constants."""
    scheme, system, real = derived.scheme, derived.system, derived.real
    symbols = {str(s): (s, e) for e, s in derived.constants.definitions.items()}
    constants = [symbols[name] for name in constants_c]
    times = time_columns(scheme)
    columns = [*(s for s, _ in constants or [(sp.Dummy(), 0)]), *times]
    parts = [] if elements is None else element_derivatives(derived, elements)
    kernels = [] if parts else [emit_kernel(k, derived.constants, real)
                                for k in derivative_kernels(scheme, columns)]
    called = [*kernels, *(k["scalar"] for part in parts for k in part["own"])]
    printer = CPrinter(real, {p: f"par->{p}" for p in derived.constants.parameters})
    chain = [(i, j, printer.number(d)) for i, (_, e) in enumerate(constants)
             for j, p in enumerate(system.parameters)
             if p in e.free_symbols and (d := derivative(e, p)) != 0]
    places = {name: i for i, name in enumerate(constants_c)}
    return Derivatives(
        kernels=kernels,
        columns=len(columns),
        times=len(times),
        chain=chain,
        inputs=[places.get(str(u), -1) for u in system.inputs],
        functions=frozenset(printer.functions).union(*(k.functions for k in called)),
        parts=parts,
    )

