"""A system as sums over element templates: kernels of the templates, tables of their instances.

Every kernel works on local symbols: coordinates ``q``, momenta ``p`` and constants ``k`` of one
instance. The functions of the whole system, which gather and scatter, are in
``templates/elements.c.jinja``; they have the names that the other templates call.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import accumulate
from typing import Any

import sympy as sp

from ...core.real_types import Real
from ..kernels.kernel import Constants, Target, emit_kernel
from ..kernels.statements import Kernel
from ..schemes.step_equations import MeanScheme, SparkScheme
from ..schemes.system_differences import (
    StateSymbols,
    by_increment,
    differences_of_states,
    increment_of,
    mean_gradient_of,
    mean_slopes_of,
    means_of_states,
    time_input,
    vector,
)
from ..systems.elimination_order import Elimination
from ..systems.jacobians import curvature, jacobian, transposed_product
from ..systems.repeated_structure import ElementSystem, ElementTemplate, Structure
from .condensation import condensation_of
from .program import Derived, Elements

__all__ = ["NUMBERS", "Emitter", "Placed", "elements_of", "local_inputs", "nonempty",
           "term_kernels"]

#: What a kernel is needed for: numbers (Newton, reports), lanes (fixed-point iteration), or both.
NUMBERS, LANES, BOTH = "numbers", "lanes", "both"

#: A kernel and what it is needed for.
Placed = tuple[Kernel, str]


def elements_of(structure: Structure, derived: Derived) -> Elements:
    """Return the tables and kernels of the element templates of a system.

    The tables of each template (``_table_of``) have its kernels in C, and
    ``blocks``, ``places``
        of a term of H its blocks of G H_pp Gᵀ, of a constraint its entries in G (``_Blocks``);
    ``condensed``, ``curved``, ``condensed_start``
        entries of the condensed system, if H_pp is invertible block by block (``Condensation``).
    """
    scheme = derived.implicit
    constants = _constants_of(structure)
    index = {c: position for position, c in enumerate(constants)}
    tables = partial(_tables, Emitter(derived.constants, derived.real), index)
    constrained, time = bool(structure.system.m), time_input(structure.system)
    energies = tables("term", structure.templates,
                      lambda template: _energy_kernels(template, scheme, constrained))
    constraints = tables("constraint", structure.constraint_templates,
                         lambda template: _constraint_kernels(template, scheme))
    forces = tables("force", structure.force_templates,
                    lambda template: force_kernels(template, time))
    blocks = _Blocks(structure)
    for table, blocks_of_table in zip(energies, blocks.of_elements, strict=True):
        table["blocks"] = blocks_of_table
    for table, places in zip(constraints, blocks.places, strict=True):
        table["places"] = places
    condensed = condensation_of(structure, scheme, constraints)
    if condensed:
        for table, condensed_table in zip((*energies, *constraints, *forces), condensed.tables,
                                          strict=True):
            table |= condensed_table
    # order of the unknowns and half the bandwidth of Newton's matrix, where it is not condensed
    positions, band = _band(structure, scheme)
    parameters = scheme.system.parameters
    momenta = [a for template in structure.templates for i in template.instances for a in i.p]
    return Elements(
        energies, constraints, forces,
        used_constants=[str(parameters[c]) for c in constants],
        blocks=blocks,
        # each momentum is in one instance: the instances write all of H_p, no zeros before them
        covers_momenta=sorted(momenta) == list(range(structure.system.n)),
        elimination=_elimination_tables(structure.elimination),
        second=_second_derivatives(structure, energies, forces),
        positions=positions,
        band=band,
        condensed=condensed,
    )


def _constants_of(structure: Structure) -> list[int]:
    """Return the constants of all instances, in the order of the system: equal systems, equal C."""
    templates = *structure.templates, *structure.constraint_templates, *structure.force_templates
    return sorted({constant for template in templates for instance in template.instances
                   for constant in instance.constants})


def _energy_kernels(
    template: ElementTemplate, scheme: SparkScheme | MeanScheme, constrained: bool
) -> list[Placed]:
    """Return the kernels of a term of H; for IMS and EMS also those between two states."""
    kernels = term_kernels(template, between=isinstance(scheme, MeanScheme),
                           constrained=constrained)
    if isinstance(scheme, MeanScheme):
        kernels += mean_term_kernels(template, scheme.discrete)
    return kernels


def _constraint_kernels(
    template: ElementTemplate, scheme: SparkScheme | MeanScheme
) -> list[Placed]:
    """Return the kernels of a constraint; for IMS and EMS also those between two states."""
    kernels = constraint_kernels(template, between=isinstance(scheme, MeanScheme))
    if isinstance(scheme, MeanScheme):
        kernels += mean_constraint_kernels(template, scheme.discrete)
    return kernels


def _elimination_tables(elimination: Elimination) -> dict[str, Any]:
    """Return the tables of the factors of W = G H_pp Gᵀ, as the template of C reads them.

    For pivot k in ``order``: ``counts[k]`` rows below it in ``flat_rows``, the entries that they
    change in ``flat_targets``, and ``before_counts[k]`` earlier pivots in ``before_rows``, with the
    entries of row k in their columns in ``before_slots``.
    """
    return {
        "entries": elimination.entries,
        "order": elimination.order,
        "counts": [len(rows) for rows in elimination.rows],
        "flat_rows": [row for rows in elimination.rows for row in rows],
        "flat_targets": [slot for slots in elimination.targets for slot in slots],
        "before_counts": [len(pairs) for pairs in elimination.before],
        "before_rows": [row for pairs in elimination.before for row, _ in pairs],
        "before_slots": [slot for pairs in elimination.before for _, slot in pairs],
    }


def _tables(
    emit: Emitter, index: dict[int, int], kind: str, templates: Sequence[ElementTemplate],
    kernels_of: Callable[[ElementTemplate], list[Placed]],
) -> list[dict[str, Any]]:
    """Return the tables of the templates of one kind, named ``kind0``, ``kind1`` and so on."""
    return [_table_of(f"{kind}{f}", template, index)
            | {"kernels": emit.template_kernels(f"{kind}{f}", kernels_of(template))}
            for f, template in enumerate(templates)]


def _table_of(name: str, template: ElementTemplate, index: dict[int, int]) -> dict[str, Any]:
    """Return the sizes and tables of an element template, as the template of C reads them.

    ``q``, ``p`` and ``row`` have, for each instance, indices of coordinates, momenta and rows of
    g or F; ``k`` indices of constants in the C, by ``index`` from those in the system.
    """
    return {
        "name": name,
        "nq": len(template.q), "np": len(template.p), "nk": len(template.constants),
        "rows": len(template.instances[0].rows),
        "count": len(template.instances),
        "q": [i.q for i in template.instances],
        "p": [i.p for i in template.instances],
        "k": [tuple(index[c] for c in i.constants) for i in template.instances],
        "row": [i.rows for i in template.instances],
        "text": [str(e).replace("**", "^") for e in template.expressions],
    }


class Emitter:
    """Emits each kernel of an element template twice: for numbers and for lanes."""

    def __init__(self, constants: Constants, real: Real) -> None:
        self.constants, self.real = constants, real

    def template_kernels(self, prefix: str, kernels: Sequence[Placed]) -> list[dict[str, Any]]:
        """Return the kernels of an element template, one dict each, as the C template reads them.

        ``prefix``, the name of the template, begins their names in C. ``scalar`` and ``lanes`` are
        the C, None where the kernel is not needed; ``nonzero`` the places, through all outputs, of
        the entries that are not always 0.
        """
        emitted = []
        for kernel, use in kernels:
            # C has no arrays of length 0
            inputs = {array: symbols for array, symbols in kernel.inputs.items() if symbols}
            prefixed_kernel = Kernel(f"{prefix}_{kernel.name}", kernel.doc, inputs, kernel.outputs,
                                     kernel.compensated)
            scalar = emit_kernel(prefixed_kernel, self.constants, self.real)
            lanes = emit_kernel(prefixed_kernel, self.constants, self.real, Target.lanes(names={}))
            entries = _flat_entries([*prefixed_kernel.outputs.values()])
            emitted.append({"name": kernel.name, "inputs": list(prefixed_kernel.inputs),
                            "outputs": list(prefixed_kernel.outputs),
                            "nonzero": [k for k, e in enumerate(entries) if e != 0],
                            "scalar": scalar if use != LANES else None,
                            "lanes": lanes if use != NUMBERS else None,
                            "operations": scalar.operations})
        return emitted


def _flat_entries(output: Any) -> list[sp.Expr]:
    """Return the entries of nested lists, in order."""
    if not isinstance(output, (list, tuple)):
        return [output]
    return [entry for row in output for entry in _flat_entries(row)]


def local_inputs(
    template: ElementTemplate, **more: Sequence[sp.Symbol]
) -> dict[str, Sequence[sp.Symbol]]:
    """Return the inputs of a kernel of a template: coordinates, momenta, ``more``, constants."""
    return {"q": template.q, "p": template.p, **more, "k": template.constants}


def term_kernels(template: ElementTemplate, *, between: bool, constrained: bool) -> list[Placed]:
    """Return the kernels of a term of H: H, (H_p, H_q), H_p, H_pp, H_t and second derivatives.

    ``between``: the scheme is IMS or EMS, whose gradient and second derivatives, between two
    states, are in ``mean_term_kernels``. A kernel is emitted for one trajectory (NUMBERS), for
    trajectories side by side (LANES), or for both. H_p for numbers and H_pp serve the constraint on
    the momenta, G H_p + g_t = 0, of ``constrained`` systems.
    """
    system, arguments = template.system, local_inputs(template)
    # in a co-moving frame, H̃ of the motion comes first, and the energy H last
    energy, in_frame = template.expressions[-1], " in the frame" * (len(template.expressions) > 1)
    kernels = [(Kernel("energy", f"H of {_short_text(energy)}", arguments, {"H": energy}), BOTH)]
    if not between:
        kernels.append((Kernel("gradient", f"derivatives of H{in_frame}", arguments,
                               {"H_p": system.H_p, "H_q": system.H_q}), BOTH))
    if constrained or not between:
        kernels.append((Kernel("velocity", "H_p", arguments, {"H_p": system.H_p}),
                        BOTH if constrained else LANES))
    if constrained:
        kernels.append((Kernel("mass", "H_pp, the inverse of a mass", arguments,
                               {"H_pp": system.H_pp}), BOTH))
    if template.time is not None and not between:
        kernels.append((Kernel("energy_rate", "H_t", arguments, {"H_t": system.H_t}), BOTH))
    if not between:
        kernels.append((Kernel("hessian", f"second derivatives of H{in_frame}", arguments, {
            "H_qq": system.H_qq, "H_pq": system.H_pq, "H_pp": system.H_pp}), NUMBERS))
    return nonempty(kernels)


def nonempty(kernels: Sequence[Placed]) -> list[Placed]:
    """Return kernels without outputs of length 0, which C has not; one with no others is omitted.

    The order of outputs stays: it is the order of the arguments in C.
    """
    nonempty_kernels = []
    for kernel, use in kernels:
        outputs = {name: entries for name, entries in kernel.outputs.items()
                   if _flat_entries(entries)}
        if outputs:
            nonempty_kernels.append((replace(kernel, outputs=outputs), use))
    return nonempty_kernels


def constraint_kernels(template: ElementTemplate, *, between: bool) -> list[Placed]:
    """Return the kernels of a template of g: g, g(q + d) − g(q), G, Gᵀ λ, K = (Gᵀ λ)_q and g_t.

    g_t exists only where a constraint depends on time. ``between``: the scheme is IMS or EMS,
    whose K, between two states, is in ``mean_constraint_kernels``.
    """
    g, q = list(template.expressions), template.q
    d, lam = vector("d", len(q)), vector("lambda", len(g))
    G = jacobian(g, q)
    arguments, with_lambda = local_inputs(template), local_inputs(template, **{"lambda": lam})
    increments = [increment_of(e, q, d, template.time) for e in g]
    kernels = [
        (Kernel("value", "g", arguments, {"g": g}, compensated=True), BOTH),
        (Kernel("increment", "g(q + d) - g(q), no digit lost for small d",
                local_inputs(template, d=d), {"dg": increments}), BOTH),
        (Kernel("jacobian", "G = dg/dq", arguments, {"G": G}), BOTH),
        (Kernel("reaction", "G^T lambda", with_lambda, {"force": transposed_product(G, lam)}),
         NUMBERS if between else BOTH),
    ]
    if not between:  # IMS and EMS have the curvature between two states
        kernels.append((Kernel("curvature", "K = d(G^T lambda)/dq", with_lambda,
                               {"K": curvature(g, q, lam)}), NUMBERS))
    if template.time is not None:
        rates = [row[0] for row in jacobian(g, [template.time])]
        kernels.append((Kernel("rate", "g_t", arguments, {"g_t": rates}), BOTH))
    return kernels


def force_kernels(template: ElementTemplate, time: dict[str, list[sp.Symbol]]) -> list[Placed]:
    """Return the kernels of a template of forces: F, and F_q and F_p if it depends on the state.

    ``time`` is the input of the time by its name, {} for a system without one.
    """
    arguments = {"q": template.q, "p": template.p, **time, "k": template.constants}
    F = list(template.expressions)
    kernels = [(Kernel("value", "F, which no potential has", arguments, {"F": F}), BOTH)]
    derivatives = {name: jacobian(F, symbols)
                   for name, symbols in (("F_q", template.q), ("F_p", template.p)) if symbols}
    if derivatives:  # a force of t alone has none
        kernels.append((Kernel("jacobian", "dF/dq and dF/dp", arguments, derivatives), NUMBERS))
    return kernels


def mean_term_kernels(template: ElementTemplate, discrete: bool) -> list[Placed]:
    """Return the mean gradient D of a term of H between two states, and its derivatives.

    H(q₁, p₁) − H(q₀, p₀) = D_q·Δq + D_p·Δp for the discrete gradient of EMS (``discrete``); for
    IMS D is the gradient at the midpoint. Inputs are means ``qm``, ``pm`` and increments ``dq``,
    ``dp``; derivatives are by q₁ and p₁ at fixed q₀ and p₀, ½ ∂/∂qm + ∂/∂dq.
    """
    nq, np = len(template.q), len(template.p)
    means, differences = means_of_states(nq, np), differences_of_states(nq, np)
    (qm, pm), (dq, dp) = means, differences
    D_q, D_p = mean_gradient_of(template.system, means, differences, discrete)
    arguments = {"qm": qm, "pm": pm, "dq": dq, "dp": dp, "k": template.constants}
    kernels = [
        (Kernel("mean_gradient", "mean gradient of H between two states", arguments,
                {"D_q": D_q, "D_p": D_p}), BOTH if nq else NUMBERS),
        (Kernel("mean_jacobian", "its derivatives by dq and dp", arguments,
                {"D_qq": by_increment(D_q, qm, dq), "D_qp": by_increment(D_q, pm, dp),
                 "D_pq": by_increment(D_p, qm, dq), "D_pp": by_increment(D_p, pm, dp)}), NUMBERS),
        (Kernel("mean_velocity", "D_p", arguments, {"D_p": D_p}), LANES),
    ]
    if template.time is not None:
        rate = sp.Integer(0)  # of a term without time
        if template.system.is_time_dependent:
            # the slope by t follows the slopes by q and p
            *_, rate = mean_slopes_of(template.system, means, differences, discrete)
        kernels.append((Kernel("mean_energy_rate", "mean of dH/dt between two states", arguments,
                               {"D_t": rate}), BOTH))
    return nonempty(kernels)


def mean_constraint_kernels(template: ElementTemplate, discrete: bool) -> list[Placed]:
    """Return the kernels of IMS and EMS: Gᵀ λ with the mean G between two states, its derivative
    by q₁, G itself, and g_t of a rheonomic constraint.

    IMS has G at the mean state, EMS a ``discrete`` derivative with g(q₁) − g(q₀) = G Δq.
    """
    qm, dq, lam = (vector("qm", len(template.q)), vector("dq", len(template.q)),
                   vector("lambda", len(template.expressions)))
    G, rates = mean_jacobian(template, qm, dq, discrete)
    force = transposed_product(G, lam)
    arguments = {"qm": qm, "dq": dq, "k": template.constants}
    with_lambda = {"qm": qm, "dq": dq, "lambda": lam, "k": template.constants}
    drive = [] if template.time is None else [
        (Kernel("mean_rate", "g_t between two states", arguments, {"g_t": rates}), BOTH)]
    return [
        *drive,
        (Kernel("mean_reaction", "G^T lambda between two states", with_lambda, {"force": force}),
         BOTH),
        (Kernel("mean_curvature", "its derivative by dq", with_lambda,
                {"K": by_increment(force, qm, dq)}), NUMBERS),
        (Kernel("mean_jacobian", "G between two states", arguments, {"G": G}), NUMBERS),
    ]


def mean_jacobian(
    template: ElementTemplate, qm: list[sp.Symbol], dq: list[sp.Symbol], discrete: bool
) -> tuple[list[list[sp.Expr]], list[sp.Expr]]:
    """Return the mean G between two states, and g_t, of a template of constraints.

    Row r is the mean gradient of g_r, taken as a Hamiltonian without momenta. ``qm`` and ``dq`` are
    the mean and the difference of the coordinates of the two states.
    """
    n = len(template.q)
    # a system has as many momenta as coordinates: these occur in no g
    p, pm, dp = (vector(name, n) for name in ("unused", "pm", "dp"))
    systems = [ElementSystem(template.q, tuple(p), template.constants, g, time=template.time)
               for g in template.expressions]
    means, differences = StateSymbols(qm, pm), StateSymbols(dq, dp)
    slopes = [mean_slopes_of(system, means, differences, discrete) for system in systems]
    # rows of D by q, by the unused p, and by t if there is one
    return [row[:n] for row in slopes], [sp.Add(*row[2 * n:]) for row in slopes]


def _short_text(e: sp.Expr) -> str:
    """Return e for a comment in C, cut to 100 characters."""
    text = str(e).replace("**", "^")
    return text if len(text) <= 100 else text[:97] + "..."


class _Blocks:
    """The entries of G and of W = G H_pp Gᵀ = Σ_c G_c H_pp,c G_cᵀ, a sum over kinetic elements c.

    G is stored element by element: G_c has a row for each constraint that acts on the momenta of c.

    Attributes
    ----------
    of_elements : list of dict
        For each template of H and each instance: ``count`` rows of G_c, ``place`` of its first
        entry in G, and ``slot``, the first of its places in ``slots``.
    slots : list of int
        Entries of W that the lower triangles of all G_c H_pp,c G_cᵀ are added to.
    entries : int
        Number of entries of G.
    places : list
        For each template of g and each instance, the place in G of each of its derivatives.
    is_full : bool
        Whether every entry of G is set, so that none has to be zeroed.
    """

    def __init__(self, structure: Structure) -> None:
        """Number the blocks G_c of rows and momenta, instance by instance, and their slots in W."""
        slot_of = structure.elimination.slot_of
        place_of: dict[tuple[int, int], int] = {}  # (row, coordinate) → place in G
        self.of_elements: list[dict[str, list[Any]]] = []
        self.slots: list[int] = []
        self.entries = 0
        for template in structure.templates:
            blocks: dict[str, list[Any]] = {"count": [], "place": [], "slot": []}
            for instance in template.instances if template.p else ():
                rows = structure.constraints_of(instance)
                blocks["count"].append(len(rows))
                blocks["place"].append(self.entries)
                blocks["slot"].append(len(self.slots))
                for i, row in enumerate(rows):
                    place_of |= {(row, a): self.entries + b for b, a in enumerate(instance.p)}
                    self.entries += len(instance.p)
                    # W is stored as the elimination stores its factors: the lower triangle
                    self.slots += [slot_of[row, column] for column in rows[: i + 1]]
            self.of_elements.append(blocks)
        self.places = [_places_in_G(template, place_of)
                       for template in structure.constraint_templates]
        nonzero = {entry for places_of_template in self.places
                   for places in places_of_template for entry in places}
        self.is_full = nonzero.issuperset(range(self.entries))  # none of the entries is always 0


def _places_in_G(
    template: ElementTemplate, place_of: dict[tuple[int, int], int]
) -> list[list[int]]:
    """Return, for each instance of a constraint, the places of its derivatives in G, row by row.

    ``place_of`` maps (row, coordinate) to a place. An entry that is 0 for every state, or whose
    coordinate has no momentum in H, is not stored: its place is −1.
    """
    G = jacobian(template.expressions, template.q)
    return [[place_of.get((row, a), -1) if derivative != 0 else -1
             for row, derivatives in zip(instance.rows, G, strict=True)
             for a, derivative in zip(instance.q, derivatives, strict=True)]
            for instance in template.instances]


def _second_derivatives(
    structure: Structure, energies: list[dict[str, Any]], forces: list[dict[str, Any]]
) -> dict[str, Any]:
    """Return the tables of the entries of H_pp and of H_qp − F_p by momenta.

    Adds to the tables of each template, in ``energies`` and ``forces``, the places of the entries
    of its instances.
    """
    return (_momentum_blocks(structure, energies)
            | _mixed_derivatives(structure, energies, forces))


def _momentum_blocks(structure: Structure, energies: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the table of the entries of H_pp: a full block for each instance.

    Momentum a has the ``block_count[a]`` entries of column a from ``block_first[a]`` on, in rows
    ``block_row``. Adds to ``energies`` ``pp_start``, the place of the first entry of a template.
    """
    n = structure.system.n
    block_first, block_count = [0] * n, [0] * n
    block_row: list[int] = []
    for template, energy in zip(structure.templates, energies, strict=True):
        energy["pp_start"] = len(block_row)
        for instance in template.instances:
            for a in instance.p:
                # kinetic blocks, and so instances, have no momentum in common
                assert not block_count[a]
                block_first[a], block_count[a] = len(block_row), len(instance.p)
                block_row += instance.p
    return {"block_first": block_first, "block_count": block_count, "block_row": block_row,
            "pp_entries": len(block_row)}


def _mixed_derivatives(
    structure: Structure, energies: list[dict[str, Any]], forces: list[dict[str, Any]]
) -> dict[str, Any]:
    """Return the table of the entries of H_qp − F_p, whose columns have different lengths.

    Momentum a has the entries of its column from ``mixed_first[a]`` on, in rows ``mixed_row``. Adds
    ``mixed`` to ``energies`` and ``forces``: for each instance the places of its entries in the
    order of its kernel, for H_pq one momentum after another, for F_p one row after another.
    """
    place_in_column = _mixed_columns(structure)
    first = [0, *accumulate(map(len, place_in_column))]
    for template, energy in zip(structure.templates, energies, strict=True):
        energy["mixed"] = [[first[a] + place_in_column[a][b] for a in i.p for b in i.q]
                           for i in template.instances]
    for template, force in zip(structure.force_templates, forces, strict=True):
        force["mixed"] = [[first[a] + place_in_column[a][row] for row in i.rows for a in i.p]
                          for i in template.instances]
    return {"mixed_first": first, "mixed_entries": first[-1],
            "mixed_row": [row for column in place_in_column for row in column]}


def _mixed_columns(structure: Structure) -> list[dict[int, int]]:
    """Return the columns of H_qp − F_p, one for each momentum: row → place in the column.

    Only rows are listed that some element of H or some force has; H comes before the forces.
    """
    columns: list[dict[int, int]] = [{} for _ in range(structure.system.n)]
    for template in structure.templates:
        for instance in template.instances:
            for a in instance.p:
                for row in instance.q:
                    columns[a].setdefault(row, len(columns[a]))
    for template in structure.force_templates:
        for instance in template.instances:
            for a in instance.p:
                for row in instance.rows:
                    columns[a].setdefault(row, len(columns[a]))
    return columns


def _band(structure: Structure, scheme: SparkScheme | MeanScheme) -> tuple[list[int], int]:
    """Return the place of each unknown, and of its equation, in a narrow band, and half its width.

    Unknowns are numbered as the scheme numbers them: k and k̂ of all stages, or increments of q and
    p, then multipliers.
    """
    n, m = structure.system.n, structure.system.m
    s, p = (scheme.tableau.s, scheme.tableau.p) if scheme.tableau else (1, 1)
    # the unknowns of one coordinate, s stages of k and of k̂, are neighbours in the band, as every
    # stage is coupled to all others
    first_k_hat, first_multiplier = s * n, 2 * s * n
    unknowns = {("q", a): [start + i * n + a for start in (0, first_k_hat) for i in range(s)]
                for a in range(n)}
    unknowns |= {("g", row): [first_multiplier + node * m + row for node in range(p)]
                 for row in range(m)}
    position: dict[int, int] = {}
    first, last = {}, {}
    for node in structure.band_order:
        first[node] = len(position)
        for unknown in unknowns[node]:
            position[unknown] = len(position)
        last[node] = len(position) - 1
    # coupled coordinates and constraints: the largest distance of two of their unknowns
    band = 0
    for nodes in structure.coupled_sets:
        band = max(band, max(last[x] for x in nodes) - min(first[x] for x in nodes))
    return [position[unknown] for unknown in range(len(position))], band
