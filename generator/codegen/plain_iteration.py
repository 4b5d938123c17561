"""The fixed-point iteration of profiles ``control`` and ``run``, on plain numbers.

It uses the same identities and scaled unknowns as the iteration on lanes, for one trajectory.
Profile ``run`` also has the kernels of Newton's method, to which it falls back.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from ...core.incompatibilities import LARGEST, refuse_together
from ...core.real_types import Real
from ..kernels.c_printer import CPrinter
from ..kernels.kernel import EmittedKernel, Target, emit_kernel
from ..schemes.fast_path import FastSystem
from ..schemes.fast_tableau import FastTableau
from ..schemes.step_equations import MeanScheme, SparkScheme
from ..systems.lagrangian import LagrangianSystem
from .profiles import ProfileName
from .program import Derived, PlainIteration

__all__ = ["additional_kernels", "plain_iteration"]

#: Backward differences of past steps that extrapolate the starting values.
_ORDERS = 8


def plain_iteration(derived: Derived) -> PlainIteration:
    """Return the iteration on plain numbers.

    Raises
    ------
    InputError
        If the profile does not support the type, the tableau, a Lagrangian, an explicit time in H
        or g, or as many coordinates.
    """
    scheme, real, constants = derived.implicit, derived.real, derived.constants
    _refuse(scheme, real, derived.profile)
    system = FastSystem(scheme.system)
    fast_kernels = (system.spark_kernels(separate=True) if isinstance(scheme, SparkScheme)
                    else system.mean_kernels(scheme))
    # A constant W⁻¹ and its correction are constants of a run; H and F are not evaluated here.
    unused = {"hamiltonian", "applied_force", "schur_inverse", "correction",
              *([] if derived.is_spark else ["hidden_constraint"])}
    # kernels that share subexpressions w are called as a pair, under names of their own
    names = {"velocity": "first_rates", "force": "second_rates"} if system.shared else {}
    folds = {symbol: f"c->{symbol.name.lstrip('_')}"
             for symbol in system.folds.definitions.values()}
    explicit = derived.profile == "control"
    target = Target("real", "constants", "", folds, explicit)
    printer = CPrinter(real, {s: f"c->{s}" for s in scheme.system.parameters}, explicit=explicit)
    m, is_constant = scheme.system.m, system.schur_inverse is not None
    tables = FastTableau(scheme.tableau).tables(real) if scheme.tableau else {}
    if not m and tables:
        # without constraints there are no nodes of multipliers
        tables = {name: tables[name] for name in ("mu", "mu_hat")}
    s, p = (scheme.tableau.s, scheme.tableau.p) if scheme.tableau else (1, 1)
    emitted = {k.name: emit_kernel(replace(k, name=names.get(k.name, k.name)), constants, real,
                                   target) for k in fast_kernels}
    return PlainIteration(
        kernels=[kernel for name, kernel in emitted.items() if name not in unused],
        # all of them count in the operations of an iteration, also those that are not printed
        known=[*emitted.values()],
        run_constants=[
            *((f"W_inverse[{i}][{j}]", printer(e))
              for i, row in enumerate(system.schur_inverse or []) for j, e in enumerate(row) if m),
            *([("correction", printer(system.correction))]
              if system.correction is not None else []),
        ],
        folded={symbol.name.lstrip("_"): printer(e)
                for e, symbol in system.folds.definitions.items()},
        tables={name: [[real.literal(e) for e in row] for row in rows]
                for name, rows in tables.items() if not name.startswith("onward")},
        factors=bool(m) and (derived.is_spark or not is_constant),
        constant_schur=bool(m) and is_constant,
        scalar_schur=bool(m) and system.correction is not None,
        separable=system.is_separable,
        shared=len(system.shared),
        affine=system.is_affine,
        orders=_ORDERS,
        unknowns=2 * s * scheme.system.n + p * m,
        nodes=p,
    )


def _refuse(scheme: SparkScheme | MeanScheme, real: Real, profile: ProfileName) -> None:
    """Refuse a type, tableau or system that the profiles ``control`` and ``run`` do not support."""
    system = scheme.system
    refusal = FastTableau(scheme.tableau).refusal if scheme.tableau else None
    refuse_together(
        profile=f"profile {profile!r}", control=profile == "control" and "profile 'control'",
        lagrangian=isinstance(system, LagrangianSystem) and f"the Lagrangian of {system.name}",
        long_numbers=real.name not in ("float", "double") and f"numbers of type {real.name}",
        large=system.n > LARGEST and f"the {system.n} coordinates of {system.name}",
        time=system.is_time_dependent and f"time in H or in a constraint of {system.name}",
        newton_only=refusal is not None and f"a tableau without that iteration ({refusal})")


def additional_kernels(
    newton: Sequence[EmittedKernel], fixed_point: Sequence[EmittedKernel]
) -> tuple[list[EmittedKernel], dict[str, str]]:
    """Return the fixed-point kernels that are no Newton kernels, and the new names of some.

    A kernel with the name and the text of a Newton kernel is omitted; one with the name but another
    text is renamed to ``iteration_``\\ *name*.
    """
    newton_kernels = {kernel.name: kernel for kernel in newton}
    additional, new_names = [], {}
    for kernel in fixed_point:
        newton_kernel = newton_kernels.get(kernel.name)
        if newton_kernel is None:
            additional.append(kernel)
        elif _text(newton_kernel) != _text(kernel):
            new_names[kernel.name] = f"iteration_{kernel.name}"
            additional.append(replace(kernel, name=new_names[kernel.name]))
    return additional, new_names


def _text(kernel: EmittedKernel) -> str:
    """Return the text of a kernel with ``real`` as the type, which the iteration writes."""
    return re.sub(r"\b(double|float|long double|_Float\d+)\b", "real",
                  "\n".join([kernel.returns, kernel.signature, *kernel.lines]))
