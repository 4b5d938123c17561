"""What templates are told of sweeps on plain numbers, of profiles ``control`` and ``run``.

The same identities and the same scaled unknowns as those of the full stepper's sweeps, but for one
trajectory at a time. Profile ``run`` has Newton behind them, on kernels of its own.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ...core.errors import InputError
from ...core.real_types import Real
from ..kernels.c_printer import CPrinter
from ..kernels.kernel import Constants, EmittedKernel, Target, emit_kernel
from ..schemes.fast_path import FastSystem
from ..schemes.fast_tableau import FastTableau
from ..schemes.step_equations import MeanScheme, SparkScheme
from ..systems.lagrangian import LagrangianSystem
from .profiles import ProfileName

__all__ = ["beside", "control_context"]

#: Differences of the past that starting values are made of.
_ORDERS = 8
#: Coordinates of the largest system that is written out in full.
_LARGEST = 28


def control_context(
    scheme: SparkScheme | MeanScheme, constants: Constants, real: Real, profile: ProfileName
) -> dict[str, Any]:
    """Return what the templates need beside what all steppers have.

    Raises
    ------
    InputError
        For what this profile does not take: other types, other tableaux, large systems.
    """
    _refuse(scheme, real, profile)
    system, spark = FastSystem(scheme.system), isinstance(scheme, SparkScheme)
    own = (system.spark_kernels(apart=True) if isinstance(scheme, SparkScheme)
           else system.mean_kernels(scheme))
    # What is asked of a run once stands among its constants; H and F are asked of nothing here.
    unused = {"hamiltonian", "applied_force", "schur_inverse", "correction",
              *([] if spark else ["hidden_constraint"])}
    names = {"velocity": "first_rates", "force": "second_rates"} if system.shared else {}
    folds = {symbol: f"c->{symbol.name.lstrip('_')}"
             for symbol in system.folds.definitions.values()}
    target = Target("real", "constants", "", folds)
    values = CPrinter(real, {s: f"c->{s}" for s in scheme.system.parameters})
    m, constant = scheme.system.m, system.schur_inverse is not None
    scalar = system.correction is not None
    tables = FastTableau(scheme.tableau).tables(real) if scheme.tableau else {}
    if not m and tables:
        tables = {name: tables[name] for name in ("mu", "mu_hat")}
    s, p = (scheme.tableau.s, scheme.tableau.p) if scheme.tableau else (1, 1)
    emitted = {k.name: emit_kernel(replace(k, name=names.get(k.name, k.name)), constants, real,
                                   target) for k in own}
    W_inverse = system.schur_inverse or []
    return {
        "kernels": [kernel for name, kernel in emitted.items() if name not in unused],
        "known": [*emitted.values()],
        "run_constants": [
            *((f"W_inverse[{i}][{j}]", values(e)) for i, row in enumerate(W_inverse)
              for j, e in enumerate(row) if m),
            *([("correction", values(system.correction))] if scalar else []),
        ],
        "folded": {symbol.name.lstrip("_"): values(e)
                   for e, symbol in system.folds.definitions.items()},
        "fast_tables": {name: [[real.literal(e) for e in row] for row in rows]
                        for name, rows in tables.items()},
        "shared": len(system.shared),
        "affine": system.is_affine,
        "orders": _ORDERS,
        "X": 2 * s * scheme.system.n + p * m,
        "nodes_held": p,
        "scalar": scalar,
        "constant_schur": bool(m) and constant,
        "proved": {"fast": True, "constant_schur": m and constant, "correction": m and scalar,
                   "separable": system.is_separable, "lane_kernels": []},
        "eliminates": bool(m) and (spark or not constant),
    }


def _refuse(scheme: SparkScheme | MeanScheme, real: Real, profile: ProfileName) -> None:
    if isinstance(scheme.system, LagrangianSystem):
        raise InputError(f"Profile {profile} takes systems with an H, not yet those from a "
                         "Lagrangian; choose profile full.")
    if profile == "control" and real.name not in ("float", "double"):
        raise InputError(f"Profile control is for float and double, not for {real.name}; choose "
                         "one of these, or profile run or full.")
    if scheme.system.n > _LARGEST:
        raise InputError(f"Profile {profile} writes a system out in full, up to {_LARGEST} "
                         f"coordinates; {scheme.system.name} has {scheme.system.n}: choose profile "
                         "full.")
    if scheme.system.is_timed:
        raise InputError(f"Profile {profile} takes time in forces, not in H or constraints; "
                         f"{scheme.system.name} has it there: choose profile full.")
    refusal = FastTableau(scheme.tableau).refusal if scheme.tableau else None
    if refusal is not None:
        raise InputError(f"Profile {profile} solves by sweeps, which this tableau does not allow: "
                         f"{refusal}; choose profile full.")


def beside(
    of_newton: Sequence[EmittedKernel], of_sweeps: Sequence[EmittedKernel]
) -> tuple[list[EmittedKernel], dict[str, str]]:
    """Return the kernels that sweeps have and Newton has not, and new names of some of these.

    What both call by one name is one function where it is the same, else there are two.
    """
    known = {kernel.name: kernel for kernel in of_newton}
    own, names = [], {}
    for kernel in of_sweeps:
        other = known.get(kernel.name)
        if other is None:
            own.append(kernel)
        elif _text(other) != _text(kernel):
            names[kernel.name] = f"sweep_{kernel.name}"
            own.append(replace(kernel, name=names[kernel.name]))
    return own, names


def _text(kernel: EmittedKernel) -> str:
    """Return what a kernel does; the type has a name of its own where sweeps call it."""
    return re.sub(r"\b(double|float|long double|_Float\d+)\b", "real",
                  "\n".join([kernel.returns, kernel.signature, *kernel.lines]))
