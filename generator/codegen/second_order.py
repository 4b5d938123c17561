"""Second derivatives of a stepper: kernels on dual numbers a + b ε, ε² = 0.

The derivative of an adjoint along a direction is the adjoint evaluated on dual numbers: the same
kernels, the same equations of the engine, each function with its derivative.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import sympy as sp

from ...core.incompatibilities import LARGEST, refuse_together
from ..kernels.c_printer import SWITCHES, CPrinter
from ..kernels.kernel import Target, emit_kernel
from ..kernels.statements import Kernel
from ..symbolic.phases import START
from ..systems.lagrangian import LagrangianSystem
from .program import Derived, DualKernels

__all__ = ["dual_kernels", "refuse_second"]

#: The derivative of each function of <math.h> at x, where f is its value; the C macro MATH(name)
#: is the function for the type of numbers.
_SLOPES = {
    "sin": "MATH(cos)(x)", "cos": "-MATH(sin)(x)", "tan": "1 + f*f",
    "asin": "1/MATH(sqrt)((1 - x)*(1 + x))", "acos": "-1/MATH(sqrt)((1 - x)*(1 + x))",
    "atan": "1/(1 + x*x)", "sinh": "MATH(cosh)(x)", "cosh": "MATH(sinh)(x)",
    "tanh": "1/(MATH(cosh)(x)*MATH(cosh)(x))", "asinh": "1/MATH(hypot)(1, x)",
    "acosh": "1/MATH(sqrt)((x - 1)*(x + 1))", "atanh": "1/((1 - x)*(1 + x))", "exp": "f",
    "log": "1/x", "sqrt": "(real)0.5/f", "floor": "0", "fabs": "x < 0 ? -1 : x > 0",
}
#: Cardinal functions c(z) = f(z)/z: the C of f''/z, which is c'' + 2 c'/z, at x, and of c''(0).
_CARDINALS = {
    "sinc": ("-sinc(x)", "-(real)1/3"), "sinhc": ("sinhc(x)", "(real)1/3"),
    "asinhc": ("-1/((1 + x*x)*MATH(hypot)(1, x))", "-(real)1/3"),
    "atanc": ("-2/((1 + x*x)*(1 + x*x))", "-(real)2/3"),
    "atanhc": ("2/(((1 - x)*(1 + x))*((1 - x)*(1 + x)))", "(real)2/3"),
}


def refuse_second(derived: Derived) -> None:
    """Refuse steppers for which second derivatives are not derived.

    Raises
    ------
    InputError
        For systems of a Lagrangian, co-moving frames and large systems.
    """
    system, name = derived.system, derived.name
    # the name of each feature in an error; False if the stepper does not have it
    refuse_together(
        second=f"second derivatives of {name}",
        lagrangian=isinstance(system, LagrangianSystem) and "a Lagrangian",
        frame=derived.frame is not None and "a co-moving frame",
        large=system.n > LARGEST and f"{system.n} coordinates")


def dual_kernels(
    derived: Derived, kernels: Sequence[Kernel], slopes: Sequence[sp.Expr]
) -> DualKernels:
    """Return kernels on dual numbers, and the functions that they call.

    A function of dual numbers is f(a + b ε) = f(a) + f'(a) b ε, with f' from ``_SLOPES``.
    ``slopes`` are the nonzero derivatives dc_i/dθ_j of constants by parameters, which are
    differentiated again.
    """
    real = derived.real
    # no function of dual numbers sums in double words
    emitted = [emit_kernel(replace(k, compensated=False), derived.constants, real, Target.duals())
               for k in kernels]
    # the time at the start of a run is the last of the parameters
    names = {p: f"par[{j}]" for j, p in enumerate([*derived.system.parameters, START])}
    printer = CPrinter(real, names, prefix="dual_")
    chain = [printer.number(e) for e in slopes]
    functions = printer.functions.union(*(k.functions for k in emitted))
    # a cardinal function and its slope, which are defined together
    cardinals = [name for name in _CARDINALS if functions & {name, f"{name}_slope"}]
    return DualKernels(
        kernels=emitted,
        chain=chain,
        slopes={name: slope for name, slope in _SLOPES.items() if name in functions},
        cardinals={name: _CARDINALS[name] for name in cardinals},
        others=sorted(functions & (SWITCHES | {"pow", "atan2"})),
        functions=frozenset({*cardinals, *(f"{name}_slope" for name in cardinals)}),
    )
