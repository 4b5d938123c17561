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
from .program import Derived, PlainIteration, Table

__all__ = ["additional_kernels", "plain_iteration"]

#: Backward differences of past steps that extrapolate the starting values.
_ORDERS = 8


def plain_iteration(derived: Derived) -> PlainIteration:
    """Return the fixed-point iteration of a step on plain numbers: its kernels, tables and sizes.

    Raises
    ------
    InputError
        If the profile does not support the type, the tableau, a Lagrangian, an explicit time in H
        or g, or as many coordinates.
    """
    scheme, real = derived.implicit, derived.real
    _refuse(scheme, real, derived.profile)
    system = FastSystem(scheme.system)
    emitted = _emit_kernels(derived, system)
    # W⁻¹ of W = G H_pp Gᵀ, where it is constant, and c of H_pp Gᵀ = c Gᵀ, the correction, are
    # constants of a run; H and F are not evaluated here
    unused = {"hamiltonian", "applied_force", "schur_inverse", "correction"}
    if not derived.is_spark:  # IMS and EMS do not project momenta
        unused.add("hidden_constraint")
    printer = CPrinter(real, {s: f"c->{s}" for s in scheme.system.parameters},
                       explicit=derived.profile == "control")
    m, is_constant = scheme.system.m, system.schur_inverse is not None
    # IMS and EMS count as one stage and one node
    s, p = (scheme.tableau.s, scheme.tableau.p) if scheme.tableau else (1, 1)
    return PlainIteration(
        kernels=[kernel for name, kernel in emitted.items() if name not in unused],
        # all of them count in the operations of an iteration, also those that are not printed
        all_kernels=[*emitted.values()],
        run_constants=_run_constants(system, printer, constrained=m > 0),
        folded={symbol.name.lstrip("_"): printer(e)
                for e, symbol in system.folds.definitions.items()},
        tables=_tables(scheme, real),
        # a constant W is inverted once a run; SPARK factorises it too, for the momentum
        factors=bool(m) and (derived.is_spark or not is_constant),
        constant_schur=bool(m) and is_constant,
        scalar_schur=bool(m) and system.correction is not None,
        separable=system.is_separable,
        shared=len(system.shared_sums),
        affine=system.is_affine,
        orders=_ORDERS,
        unknowns=2 * s * scheme.system.n + p * m,
        nodes=p,
    )


def _emit_kernels(derived: Derived, system: FastSystem) -> dict[str, EmittedKernel]:
    """Return name → C of the kernels of an iteration, for the C type ``real``."""
    scheme = derived.implicit
    kernels = (system.spark_kernels(separate=True) if isinstance(scheme, SparkScheme)
               else system.mean_kernels(scheme))
    # folds, subexpressions of constants of a run, are further members of the struct of constants
    folds = {symbol: f"c->{symbol.name.lstrip('_')}"
             for symbol in system.folds.definitions.values()}
    target = Target("real", "constants", prefix="", names=folds,
                    explicit=derived.profile == "control")
    # kernels that share subexpressions w are called as a pair, under names of their own
    names = {"velocity": "first_rates", "force": "second_rates"} if system.shared_sums else {}
    return {k.name: emit_kernel(replace(k, name=names.get(k.name, k.name)), derived.constants,
                                derived.real, target) for k in kernels}


def _run_constants(
    system: FastSystem, printer: CPrinter, *, constrained: bool
) -> list[tuple[str, str]]:
    """Return (name, C) of the constants of an iteration: the entries of W⁻¹, and the correction.

    W⁻¹ is left out without constraints, and where W is not constant; so is a correction of None.
    """
    inverse = (system.schur_inverse or []) if constrained else []
    run_constants = [(f"W_inverse[{i}][{j}]", printer(e))
                     for i, row in enumerate(inverse) for j, e in enumerate(row)]
    if system.correction is not None:
        run_constants.append(("correction", printer(system.correction)))
    return run_constants


def _tables(scheme: SparkScheme | MeanScheme, real: Real) -> dict[str, Table]:
    """Return the coefficients of the scaled unknowns as literals; {} for IMS and EMS."""
    if not scheme.tableau:
        return {}
    tables = FastTableau(scheme.tableau).tables(real)
    if not scheme.system.m:
        # without constraints there are no nodes of multipliers
        tables = {name: tables[name] for name in ("mu", "mu_hat")}
    # starting values are extrapolated by backward differences: the tables ``onward`` of the
    # predictor on lanes are not needed
    return {name: [[real.literal(e) for e in row] for row in rows]
            for name, rows in tables.items() if not name.startswith("onward")}


def _refuse(scheme: SparkScheme | MeanScheme, real: Real, profile: ProfileName) -> None:
    """Refuse a type, tableau or system that the profiles ``control`` and ``run`` do not support."""
    system = scheme.system
    refusal = FastTableau(scheme.tableau).refusal if scheme.tableau else None
    # the name of each feature in an error; False if the stepper does not have it
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
        elif _text_without_type(newton_kernel) != _text_without_type(kernel):
            new_names[kernel.name] = f"iteration_{kernel.name}"
            additional.append(replace(kernel, name=new_names[kernel.name]))
    return additional, new_names


def _text_without_type(kernel: EmittedKernel) -> str:
    """Return the text of a kernel with ``real`` as the type, which the iteration writes."""
    return re.sub(r"\b(double|float|long double|_Float\d+)\b", "real",
                  "\n".join([kernel.returns, kernel.signature, *kernel.lines]))
