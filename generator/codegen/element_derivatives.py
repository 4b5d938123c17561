"""Kernels of element templates that derivatives of a step need beside those of the step itself.

Each is local: derivatives by the constants of one instance, and behind them by the times of
``time_columns``. ``derivative_elements.c.jinja`` gathers directions and scatters products.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import sympy as sp

from ..kernels.statements import Kernel
from ..schemes.derivative_kernels import by_each, time_columns
from ..schemes.step_equations import MeanScheme, SparkScheme
from ..schemes.system_differences import mean_gradient_of, time_input, vector
from ..systems.jacobians import jacobian, transposed_product
from ..systems.repeated_structure import ElementTemplate, Structure
from .elements import NUMBERS, Emitter, Placed, local_inputs, mean_jacobian, term_kernels
from .program import Derived, Elements

__all__ = ["element_derivatives"]


def element_derivatives(derived: Derived, elements: Elements) -> list[dict[str, Any]]:
    """Return the kernels of each template: its part of ``elements``, by their names."""
    scheme, structure = derived.implicit, Structure(derived.scheme.system)
    emit, times = Emitter(derived.constants, derived.real), time_columns(scheme)
    kinds = ((structure.templates, elements.energies, _energy),
             (structure.constraint_templates, elements.constraints, _constraint),
             (structure.force_templates, elements.forces, _force))
    found = []
    for kind, (forms, parts, kernels_of) in enumerate(kinds):
        for form, part in zip(forms, parts, strict=True):
            if not (form.q or form.p) and kind == 0:
                continue  # a constant of H
            made = emit.all(part["name"], kernels_of(form, scheme, times))
            known = {k["name"]: k for k in part["kernels"]}
            found.append(part | {
                "kind": kind, "columns": part["nk"] + len(times), "own": made,
                "by_name": known | {k["name"]: k for k in made}})
    return found


def _by(
    form: ElementTemplate, expressions: Sequence[sp.Expr], times: Sequence[sp.Symbol]
) -> list[list[sp.Expr]]:
    return by_each(expressions, [*form.constants, *times])


def _kept(kernels: Sequence[Kernel]) -> list[Placed]:
    """Return kernels with outputs that have rows and columns."""
    made = []
    for kernel in kernels:
        outputs = {a: rows for a, rows in kernel.outputs.items() if rows and rows[0]}
        if outputs:
            made.append((Kernel(kernel.name, kernel.doc, kernel.inputs, outputs), NUMBERS))
    return made


def _energy(
    form: ElementTemplate, scheme: SparkScheme | MeanScheme, times: Sequence[sp.Symbol]
) -> list[Placed]:
    part = form.system
    state = Kernel("rates_by_constants", "dH_q/dc and dH_p/dc", local_inputs(form),
                   {"H_qc": _by(form, part.H_q if form.q else [], times),
                    "H_pc": _by(form, part.H_p if form.p else [], times)})
    if isinstance(scheme, SparkScheme):
        return _kept([state])
    nq, np = len(form.q), len(form.p)
    qm, pm, dq, dp = (vector("qm", nq), vector("pm", np), vector("dq", nq), vector("dp", np))
    D_q, D_p = mean_gradient_of(part, (qm, pm), (dq, dp), scheme.discrete)
    at = {"qm": qm, "pm": pm, "dq": dq, "dp": dp, "k": form.constants}
    mean = Kernel("mean_by_start", "derivatives of D_q and D_p by qm and pm", at,
                  {"D_qq": jacobian(D_q, qm), "D_qp": jacobian(D_q, pm),
                   "D_pq": jacobian(D_p, qm), "D_pp": jacobian(D_p, pm)})
    by_constants = Kernel("mean_by_constants", "dD_q/dc and dD_p/dc", at,
                          {"D_qc": _by(form, D_q, times), "D_pc": _by(form, D_p, times)})
    hessian = [k for k in term_kernels(form, between=False, constrained=True)
               if k[0].name == "hessian"]
    return [*_kept([state, mean, by_constants]), *hessian]


def _constraint(
    form: ElementTemplate, scheme: SparkScheme | MeanScheme, times: Sequence[sp.Symbol]
) -> list[Placed]:
    nq, rows = len(form.q), len(form.expressions)
    lam, v = vector("lambda", rows), vector("d", nq)
    G = jacobian(form.expressions, form.q)
    rates = [sp.Add(*(a * x for a, x in zip(row, v, strict=True))) for row in G]
    if form.time is not None:
        moving = jacobian(form.expressions, [form.time])
        rates = [sp.Add(rate, row[0]) for rate, row in zip(rates, moving, strict=True)]
    kernels = [
        Kernel("by_constants", "dg/dc", local_inputs(form),
               {"g_c": _by(form, form.expressions, times)}),
        Kernel("velocity_by_coordinates", "d(G v + g_t)/dq at fixed v", local_inputs(form, d=v),
               {"f_q": jacobian(rates, form.q)}),
        Kernel("velocity_by_constants", "d(G v + g_t)/dc at fixed v", local_inputs(form, d=v),
               {"f_c": _by(form, rates, times)}),
    ]
    if isinstance(scheme, SparkScheme):
        kernels.append(Kernel("force_by_constants", "d(G^T lambda)/dc",
                              local_inputs(form, **{"lambda": lam}),
                              {"force_c": _by(form, transposed_product(G, lam), times)}))
        return _kept(kernels)
    qm, dq = vector("qm", nq), vector("dq", nq)
    mean_G, _ = mean_jacobian(form, qm, dq, scheme.discrete)
    force = transposed_product(mean_G, lam)
    at = {"qm": qm, "dq": dq, "lambda": lam, "k": form.constants}
    return _kept([
        *kernels,
        Kernel("mean_force_by_start", "d(G^T lambda)/dqm between two states", at,
               {"K": jacobian(force, qm)}),
        Kernel("mean_force_by_constants", "d(G^T lambda)/dc between two states", at,
               {"force_c": _by(form, force, times)}),
    ])


def _force(
    form: ElementTemplate, scheme: SparkScheme | MeanScheme, times: Sequence[sp.Symbol]
) -> list[Placed]:
    at = {"q": form.q, "p": form.p, **time_input(scheme.system), "k": form.constants}
    return _kept([Kernel("by_constants", "dF/dc", at,
                         {"F_c": _by(form, form.expressions, times)})])
