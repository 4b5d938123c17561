"""Kernels of element templates for the derivatives of a step.

Each is local to one instance: derivatives by its constants, followed by derivatives by the times of
``time_columns``. ``derivative_elements.c.jinja`` evaluates the matrices of all instances at a
state, gathers directions and scatters products.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import sympy as sp

from ..kernels.statements import Kernel
from ..schemes.derivative_kernels import derivative_rows, time_columns
from ..schemes.step_equations import MeanScheme, SparkScheme
from ..schemes.system_differences import (
    differences_of_states,
    mean_gradient_of,
    means_of_states,
    time_input,
    vector,
)
from ..systems.jacobians import jacobian, transposed_product
from ..systems.repeated_structure import ElementTemplate, Structure
from .elements import NUMBERS, Emitter, local_inputs, mean_jacobian, nonempty, term_kernels
from .program import Derived, Elements

__all__ = ["element_derivatives"]

#: Groups of matrices that are evaluated at one state → kind of templates ("H", "g" or "F") → their
#: kernels.
_GROUPS: dict[str, dict[str, tuple[str, ...]]] = {
    "rates": {"H": ("hessian", "rates_by_constants"), "F": ("jacobian", "by_constants")},
    "mean_rates": {"H": ("mean_by_start", "mean_by_constants"), "F": ("jacobian", "by_constants")},
    "constraint_value": {"g": ("jacobian", "by_constants")},
    "constraint_velocity": {"g": ("velocity_by_coordinates", "velocity_by_constants")},
    "constraint_force": {"g": ("curvature", "force_by_constants")},
    "mean_constraint_force": {"g": ("mean_force_by_start", "mean_force_by_constants")},
}
#: Output of a kernel → products (sum, direction, whether with the transpose).
_PRODUCTS: dict[str, list[tuple[str, str, bool]]] = {
    "H_qq": [("force", "q", False)], "H_pp": [("velocity", "p", False)],
    "H_pq": [("velocity", "q", False), ("force", "p", True)],
    "H_qc": [("force", "c", False)], "H_pc": [("velocity", "c", False)],
    "D_qq": [("force", "q", False)], "D_qp": [("force", "p", False)],
    "D_pq": [("velocity", "q", False)], "D_pp": [("velocity", "p", False)],
    "D_qc": [("force", "c", False)], "D_pc": [("velocity", "c", False)],
    "F_q": [("force", "q", False)], "F_p": [("force", "p", False)], "F_c": [("force", "c", False)],
    "G": [("out", "q", False)], "g_c": [("out", "c", False)],
    "f_q": [("out", "q", False)], "f_c": [("out", "c", False)],
    "K": [("out", "q", False)], "force_c": [("out", "c", False)],
}


def element_derivatives(derived: Derived, elements: Elements) -> list[dict[str, Any]]:
    """Return the tables of ``elements`` with the kernels of derivatives, one dict a template.

    Key ``derivative_kernels`` has the additional kernels; ``groups`` maps a group of matrices that
    are evaluated at one state to its tables (``_group``); ``kind`` is "H", "g" or "F".
    """
    scheme, structure = derived.implicit, Structure(derived.scheme.system)
    emit, times = Emitter(derived.constants, derived.real), time_columns(scheme)
    kinds = (("H", structure.templates, elements.energies, _energy_derivatives),
             ("g", structure.constraint_templates, elements.constraints, _constraint_derivatives),
             ("F", structure.force_templates, elements.forces, _force_derivatives))
    derivative_tables = []
    for kind, templates, tables, kernels_of in kinds:
        for template, table in zip(templates, tables, strict=True):
            derivative_kernels = emit.template_kernels(table["name"], nonempty(
                [(kernel, NUMBERS) for kernel in kernels_of(template, scheme, times)]))
            extended = table | {"kind": kind, "columns": table["nk"] + len(times),
                                "derivative_kernels": derivative_kernels}
            # a group may have kernels of the step itself, such as the Hessian of H
            by_name = {k["name"]: k for k in (*table["kernels"], *derivative_kernels)}
            groups: dict[str, dict[str, Any]] = {}
            for name, kernel_names in _GROUPS.items():
                kernels = [by_name[k] for k in kernel_names.get(kind, ()) if k in by_name]
                if kernels:
                    groups[name] = _group(extended, name, kernels)
            derivative_tables.append(extended | {"groups": groups})
    return derivative_tables


def _group(
    template: dict[str, Any], name: str, kernels: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """Return the matrix-vector products of a template in a group, as the template of C reads them.

    ``calls`` are the kernels; ``matrices`` their outputs, each of which is multiplied by its
    ``direction`` (q, p or constants c) and added to its ``sum``. ``outputs`` and ``inputs`` are
    these sums and directions with their lengths ``n``, the index tables of the instances, and the
    ``entries`` that a product has.
    """
    # the index table by which the instances add each sum: forces of H act on coordinates, F and
    # rates of g have rows of their own
    index_of = {"force": "q" if template["kind"] == "H" else "row", "velocity": "p",
                "out": "q" if name.endswith("force") else "row"}
    length_of = {"q": template["nq"], "p": template["np"], "row": template["rows"],
                 "c": template["columns"]}
    length_of |= {total: length_of[index] for total, index in index_of.items()}
    matrices = [matrix for kernel in kernels for matrix in _matrices(kernel, length_of)]
    # the array ``force`` is H_q − F: products with derivatives of F are subtracted
    sign = "-" if template["kind"] == "F" else "+"
    return {
        "calls": kernels,
        "matrices": matrices,
        "outputs": [{"name": total, "index": index_of[total], "n": length_of[total],
                     "sign": sign, "entries": entries}
                    for total, entries in _nonzero_entries(matrices, "sum").items()],
        "inputs": [{"name": direction, "index": direction, "n": length_of[direction], "sign": "+",
                    "entries": entries}
                   for direction, entries in _nonzero_entries(matrices, "direction").items()
                   if direction != "c"],  # the template of C gathers constants by itself
    }


def _matrices(kernel: dict[str, Any], length_of: dict[str, int]) -> list[dict[str, Any]]:
    """Return the matrices of a kernel's outputs, one for each product of ``_PRODUCTS``.

    ``length_of`` has the length of each sum and of each direction. ``places`` are the (row, column)
    of the entries that are not always 0.
    """
    matrices: list[dict[str, Any]] = []
    # ``nonzero`` counts through the entries of all outputs of a kernel
    first, nonzero = 0, set(kernel["nonzero"])
    for output in kernel["outputs"]:
        for total, direction, transposed in _PRODUCTS[output]:
            rows, columns = length_of[total], length_of[direction]
            if transposed:  # the product with the transpose: the matrix itself has the other shape
                rows, columns = columns, rows
            places = [divmod(e, columns) for e in range(rows * columns) if first + e in nonzero]
            matrices.append({"name": output, "sum": total, "direction": direction,
                             "transposed": transposed, "rows": rows, "columns": columns,
                             "places": places})
        first += rows * columns
    return matrices


def _nonzero_entries(matrices: Sequence[dict[str, Any]], side: str) -> dict[str, list[int]]:
    """Return name → indices of the entries that a nonzero product has.

    Names are the sums for ``side`` "sum", and the directions for ``side`` "direction".
    """
    entries_of: dict[str, set[int]] = {}
    for matrix in matrices:
        # M v: rows belong to the sum, columns to the direction; Mᵀ v: the other way round
        by_column = matrix["transposed"] != (side == "direction")
        for row, column in matrix["places"]:
            entries_of.setdefault(matrix[side], set()).add(column if by_column else row)
    return {name: sorted(entries) for name, entries in entries_of.items()}


def _by_constants(
    template: ElementTemplate, expressions: Sequence[sp.Expr], times: Sequence[sp.Symbol]
) -> list[list[sp.Expr]]:
    """Return the derivatives of expressions by the constants of an instance and by the times.

    There is one row for each expression; the columns of the constants come first.
    """
    return derivative_rows(expressions, [*template.constants, *times])


def _energy_derivatives(
    template: ElementTemplate, scheme: SparkScheme | MeanScheme, times: Sequence[sp.Symbol]
) -> list[Kernel]:
    """Return the kernels of a term of H: dH_q/dc, dH_p/dc and, of IMS and EMS, of D_q and D_p.

    D_q and D_p are its discrete gradients, in means and differences of two states; ``times`` are
    the columns of derivatives by times behind those by constants.
    """
    element = template.system
    state = Kernel("rates_by_constants", "dH_q/dc and dH_p/dc", local_inputs(template),
                   {"H_qc": _by_constants(template, element.H_q, times),
                    "H_pc": _by_constants(template, element.H_p, times)})
    if isinstance(scheme, SparkScheme):
        return [state]
    # IMS and EMS
    nq, np = len(template.q), len(template.p)
    means, differences = means_of_states(nq, np), differences_of_states(nq, np)
    (qm, pm), (dq, dp) = means, differences
    D_q, D_p = mean_gradient_of(element, means, differences, scheme.discrete)
    arguments = {"qm": qm, "pm": pm, "dq": dq, "dp": dp, "k": template.constants}
    mean = Kernel("mean_by_start", "derivatives of D_q and D_p by qm and pm", arguments,
                  {"D_qq": jacobian(D_q, qm), "D_qp": jacobian(D_q, pm),
                   "D_pq": jacobian(D_p, qm), "D_pp": jacobian(D_p, pm)})
    by_constants = Kernel("mean_by_constants", "dD_q/dc and dD_p/dc", arguments,
                          {"D_qc": _by_constants(template, D_q, times),
                           "D_pc": _by_constants(template, D_p, times)})
    hessian = [kernel for kernel, _ in term_kernels(template, between=False, constrained=True)
               if kernel.name == "hessian"]
    return [state, mean, by_constants, *hessian]


def _constraint_derivatives(
    template: ElementTemplate, scheme: SparkScheme | MeanScheme, times: Sequence[sp.Symbol]
) -> list[Kernel]:
    """Return the kernels of a constraint g: derivatives of g, of its rate and of its force.

    With G = g_q the rate is G v + g_t and the force Gᵀ λ, of IMS and EMS with the mean G of a step.
    Derivatives are by q, and by c: constants, then ``times``.
    """
    nq, m = len(template.q), len(template.expressions)
    lam, v = vector("lambda", m), vector("d", nq)
    G = jacobian(template.expressions, template.q)
    rates = _rates(template, G, v)
    at_velocity = local_inputs(template, d=v)
    kernels = [
        Kernel("by_constants", "dg/dc", local_inputs(template),
               {"g_c": _by_constants(template, template.expressions, times)}),
        Kernel("velocity_by_coordinates", "d(G v + g_t)/dq at fixed v", at_velocity,
               {"f_q": jacobian(rates, template.q)}),
        Kernel("velocity_by_constants", "d(G v + g_t)/dc at fixed v", at_velocity,
               {"f_c": _by_constants(template, rates, times)}),
    ]
    if isinstance(scheme, SparkScheme):
        kernels.append(Kernel("force_by_constants", "d(G^T lambda)/dc",
                              local_inputs(template, **{"lambda": lam}),
                              {"force_c": _by_constants(template, transposed_product(G, lam),
                                                        times)}))
        return kernels
    # of q₁ and q₀, the kernels take the mean qm and the difference dq
    qm, dq = vector("qm", nq), vector("dq", nq)
    mean_G, _ = mean_jacobian(template, qm, dq, scheme.discrete)
    force = transposed_product(mean_G, lam)
    arguments = {"qm": qm, "dq": dq, "lambda": lam, "k": template.constants}
    return [
        *kernels,
        Kernel("mean_force_by_start", "d(G^T lambda)/dqm between two states", arguments,
               {"K": jacobian(force, qm)}),
        Kernel("mean_force_by_constants", "d(G^T lambda)/dc between two states", arguments,
               {"force_c": _by_constants(template, force, times)}),
    ]


def _rates(
    template: ElementTemplate, G: list[list[sp.Expr]], v: Sequence[sp.Symbol]
) -> list[sp.Expr]:
    """Return the rates G v + g_t of the constraints of a template along the velocity v."""
    rates = [sp.Add(*(a * x for a, x in zip(row, v, strict=True))) for row in G]
    if template.time is None:
        return rates
    g_t = jacobian(template.expressions, [template.time])
    return [sp.Add(rate, row[0]) for rate, row in zip(rates, g_t, strict=True)]


def _force_derivatives(
    template: ElementTemplate, scheme: SparkScheme | MeanScheme, times: Sequence[sp.Symbol]
) -> list[Kernel]:
    """Return the kernel of a force F: dF/dc."""
    arguments = {"q": template.q, "p": template.p, **time_input(scheme.system),
                 "k": template.constants}
    return [Kernel("by_constants", "dF/dc", arguments,
                   {"F_c": _by_constants(template, template.expressions, times)})]
