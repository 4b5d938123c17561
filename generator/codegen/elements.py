"""A system as sums over element templates: kernels of the templates, tables of their instances.

Every kernel works on local symbols: coordinates ``q``, momenta ``p`` and constants ``k`` of one
instance. The functions of the whole system, which gather and scatter, are in
``templates/elements.c.jinja``; they have the names that the other templates call.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import sympy as sp

from ...core.real_types import Real
from ..kernels.kernel import Constants, Target, emit_kernel
from ..kernels.statements import Kernel
from ..schemes.step_equations import MeanScheme, SparkScheme
from ..schemes.system_differences import (
    by_increment,
    increment_of,
    mean_gradient_of,
    mean_slopes_of,
    time_input,
    vector,
)
from ..systems.elimination_order import Elimination
from ..systems.jacobians import curvature, jacobian, transposed_product
from ..systems.repeated_structure import ElementSystem, ElementTemplate, Structure
from .condensation import condensation_of
from .program import Derived, Elements

__all__ = ["NUMBERS", "Emitter", "Placed", "elements_of", "local_inputs", "term_kernels"]

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
    scheme, emit = derived.implicit, Emitter(derived.constants, derived.real)
    templates = (*structure.templates, *structure.constraint_templates, *structure.force_templates)
    # constants in the order of the system, so that equal systems have equal C
    constants = sorted({c for template in templates for i in template.instances
                        for c in i.constants})
    index = {c: position for position, c in enumerate(constants)}
    # IMS and EMS evaluate gradients between two states, and have kernels for these as well
    between, constrained = isinstance(scheme, MeanScheme), bool(structure.system.m)
    blocks = _Blocks(structure)
    energies, constraints, forces = (list[dict[str, Any]]() for _ in range(3))
    for f, template in enumerate(structure.templates):
        kernels = term_kernels(template, between=between, constrained=constrained)
        if isinstance(scheme, MeanScheme):
            kernels += mean_term_kernels(template, scheme.discrete)
        energies.append(_table_of(f"term{f}", template, index)
                        | {"kernels": emit.all(f"term{f}", kernels),
                           "blocks": blocks.of_elements[f]})
    for f, template in enumerate(structure.constraint_templates):
        kernels = constraint_kernels(template, between=between)
        if isinstance(scheme, MeanScheme):
            kernels += mean_constraint_kernels(template, scheme.discrete)
        constraints.append(_table_of(f"constraint{f}", template, index)
                           | {"kernels": emit.all(f"constraint{f}", kernels),
                              "places": blocks.places[f]})
    for f, template in enumerate(structure.force_templates):
        kernels = force_kernels(template, time_input(structure.system))
        forces.append(_table_of(f"force{f}", template, index)
                      | {"kernels": emit.all(f"force{f}", kernels)})
    condensed = condensation_of(structure, scheme, constraints)
    if condensed:
        for table, condensed_table in zip((*energies, *constraints, *forces), condensed.tables,
                                          strict=True):
            table |= condensed_table
    # order of the unknowns and half the bandwidth of Newton's matrix, where it is not condensed
    positions, band = _band(structure, scheme)
    symbols = list(scheme.system.parameters)
    momenta = [a for template in structure.templates for i in template.instances for a in i.p]
    return Elements(
        energies, constraints, forces,
        used_constants=[str(symbols[c]) for c in constants],
        blocks=blocks,
        # each momentum in one instance: H_p is written by the instances, and no zeros before them
        covers_momenta=sorted(momenta) == list(range(structure.system.n)),
        elimination=_elimination_tables(structure.elimination),
        second=_second_derivatives(structure, energies, forces),
        positions=positions,
        band=band,
        condensed=condensed,
    )


def _elimination_tables(elimination: Elimination) -> dict[str, Any]:
    """Return the tables of the factors of W, pivot by pivot, as the template of C reads them."""
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

    def all(self, prefix: str, kernels: Sequence[Placed]) -> list[dict[str, Any]]:
        """Return the kernels of an element template, one dict each, as the C template reads them.

        ``scalar`` and ``lanes`` are the C, None where the kernel is not needed.
        """
        emitted = []
        for kernel, where in kernels:
            named = Kernel(f"{prefix}_{kernel.name}", kernel.doc,
                           {a: s for a, s in kernel.inputs.items() if s}, kernel.outputs,
                           kernel.compensated)
            scalar = emit_kernel(named, self.constants, self.real)
            lanes = emit_kernel(named, self.constants, self.real, Target.lanes({}))
            emitted.append({"name": kernel.name, "inputs": list(named.inputs),
                            "outputs": list(named.outputs),
                            "nonzero": [place for place, entry in enumerate(
                                _entries([*named.outputs.values()])) if entry != 0],
                            "scalar": scalar if where != LANES else None,
                            "lanes": lanes if where != NUMBERS else None,
                            "operations": scalar.operations})
        return emitted


def _entries(output: Any) -> list[sp.Expr]:
    """Return the entries of nested lists, in order."""
    if not isinstance(output, (list, tuple)):
        return [output]
    return [entry for row in output for entry in _entries(row)]


def local_inputs(
    template: ElementTemplate, **more: Sequence[sp.Symbol]
) -> dict[str, Sequence[sp.Symbol]]:
    """Return the inputs of a kernel of a template: coordinates, momenta, constants."""
    return {"q": template.q, "p": template.p, **more, "k": template.constants}


def term_kernels(template: ElementTemplate, *, between: bool, constrained: bool) -> list[Placed]:
    """Return the kernels of a term of H: H, (H_p, H_q), H_p, H_pp, H_t and second derivatives.

    With ``between``, a step of IMS or EMS, whose second derivatives ``mean_term_kernels`` has. H_p
    for numbers and H_pp serve the constraint on the momenta, G H_p + g_t = 0, of ``constrained``
    systems.
    """
    system = template.system
    arguments = local_inputs(template)
    gradients: dict[str, Any] = {"H_q": system.H_q} if template.q else {}
    if template.p:
        gradients = {"H_p": system.H_p} | gradients
    kernels = [
        (Kernel("energy", f"H of {_short(system.H)}", arguments, {"H": template.expressions[-1]}),
         BOTH),
        (Kernel("gradient", "derivatives of H", arguments, gradients),
         NUMBERS if between else BOTH),
    ]
    second: dict[str, Any] = {"H_qq": system.H_qq} if template.q else {}
    if template.p:
        kernels.append((Kernel("velocity", "H_p", arguments, {"H_p": system.H_p}),
                        BOTH if constrained else LANES))
        kernels.append((Kernel("mass", "H_pp, the inverse of a mass", arguments,
                               {"H_pp": system.H_pp}),
                        BOTH))
        second |= ({"H_pq": system.H_pq} if template.q else {}) | {"H_pp": system.H_pp}
    if template.time is not None and not between:
        kernels.append((Kernel("energy_rate", "H_t", arguments, {"H_t": system.H_t}), BOTH))
    kernels.append((Kernel("hessian", "second derivatives of H", arguments, second), NUMBERS))
    # IMS and EMS have kernels of their own between two states: ``mean_term_kernels``
    dropped = {"gradient", "hessian"} if between else set()
    if not constrained:
        dropped |= {"mass"} | ({"velocity"} if between else set())
    return [(kernel, where) for kernel, where in kernels
            if kernel.outputs and kernel.name not in dropped]


def constraint_kernels(template: ElementTemplate, *, between: bool) -> list[Placed]:
    """Return the kernels of a template of g: g, g(q + d) − g(q), G, Gᵀ λ, K = (Gᵀ λ)_q and g_t."""
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
        (Kernel("curvature", "K = d(G^T lambda)/dq", with_lambda, {"K": curvature(g, q, lam)}),
         NUMBERS),
    ]
    if template.time is not None:
        rates = [row[0] for row in jacobian(g, [template.time])]
        kernels.append((Kernel("rate", "g_t", arguments, {"g_t": rates}), BOTH))
    # IMS and EMS have the curvature between two states: ``mean_constraint_kernels``
    return [pair for pair in kernels if not (between and pair[0].name == "curvature")]


def force_kernels(template: ElementTemplate, time: dict[str, list[sp.Symbol]]) -> list[Placed]:
    """Return the kernels of a template of forces: F, and F_q and F_p if it depends on the state."""
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
    qm, pm, dq, dp = (vector("qm", nq), vector("pm", np), vector("dq", nq), vector("dp", np))
    D_q, D_p = mean_gradient_of(template.system, (qm, pm), (dq, dp), discrete)
    arguments = {"qm": qm, "pm": pm, "dq": dq, "dp": dp, "k": template.constants}
    # C has no arrays of length 0: outputs without entries are left out below
    outputs = {"D_q": D_q, "D_p": D_p}
    second = {"D_qq": by_increment(D_q, qm, dq) if nq else [],
              "D_qp": by_increment(D_q, pm, dp) if nq and np else [],
              "D_pq": by_increment(D_p, qm, dq) if nq and np else [],
              "D_pp": by_increment(D_p, pm, dp) if np else []}
    drive = [] if template.time is None else [
        (Kernel("mean_energy_rate", "mean of dH/dt between two states", arguments,
                {"D_t": mean_slopes_of(template.system, (qm, pm), (dq, dp), discrete)[-1]
                 if template.system.is_time_dependent else sp.Integer(0)}), BOTH)]
    kernels = [
        (Kernel("mean_gradient", "mean gradient of H between two states", arguments,
                {a: e for a, e in outputs.items() if e}), BOTH if nq else NUMBERS),
        (Kernel("mean_jacobian", "its derivatives by dq and dp", arguments,
                {a: e for a, e in second.items() if e}), NUMBERS),
    ]
    if np:
        kernels.append((Kernel("mean_velocity", "D_p", arguments, {"D_p": D_p}), LANES))
    return [(kernel, where) for kernel, where in [*kernels, *drive] if kernel.outputs]


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

    Row r is the mean gradient of g_r, as of a Hamiltonian without momenta.
    """
    n = len(template.q)
    p, pm, dp = (vector(name, n) for name in ("unused", "pm", "dp"))
    systems = [ElementSystem(template.q, tuple(p), template.constants, g, time=template.time)
               for g in template.expressions]
    slopes = [mean_slopes_of(system, (qm, pm), (dq, dp), discrete) for system in systems]
    # rows of D by q, by the unused p, and by t if there is one
    return [row[:n] for row in slopes], [sp.Add(*row[2 * n:]) for row in slopes]


def _short(e: sp.Expr) -> str:
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
        """Number the blocks G_i of rows and momenta, instance by instance, and their slots in W."""
        slot_of = structure.elimination.slot_of
        entry_index: dict[tuple[int, int], int] = {}  # (row, coordinate) → place in G
        self.of_elements: list[dict[str, list[Any]]] = []
        self.slots: list[int] = []
        self.entries = 0
        for template in structure.templates:
            blocks: dict[str, list[Any]] = {"count": [], "place": [], "slot": []}
            for instance in template.instances if template.p else ():
                rows = structure.attached(instance)
                blocks["count"].append(len(rows))
                blocks["place"].append(self.entries)
                blocks["slot"].append(len(self.slots))
                for i, row in enumerate(rows):
                    entry_index |= {(row, a): self.entries + b for b, a in enumerate(instance.p)}
                    self.entries += len(instance.p)
                    # W is stored as the elimination stores its factors
                    self.slots += [slot_of[row, column] for column in rows[: i + 1]]
            self.of_elements.append(blocks)
        self.places = []
        for template in structure.constraint_templates:
            G = jacobian(template.expressions, template.q)
            # −1: an entry that is 0 for every state, or of a coordinate without momenta, is not
            # stored
            self.places.append([
                [entry_index.get((row, a), -1) if G[r][b] != 0 else -1
                 for r, row in enumerate(instance.rows) for b, a in enumerate(instance.q)]
                for instance in template.instances])
        nonzero = {entry for places_of_template in self.places
                   for places in places_of_template for entry in places}
        self.is_full = nonzero.issuperset(range(self.entries))  # none of the entries is always 0


def _second_derivatives(
    structure: Structure, energies: list[dict[str, Any]], forces: list[dict[str, Any]]
) -> dict[str, Any]:
    """Return the tables of the entries of H_pp and of H_qp − F_p by momenta.

    Momentum e has the ``block_count[e]`` entries of column e of H_pp from ``block_first[e]`` on, in
    rows ``block_row``, and the entries of column e of H_qp − F_p from ``mixed_first[e]`` on, in
    rows ``mixed_row``. The tables of ``energies`` and ``forces`` get the places of the entries of
    their instances: ``mixed``, and ``pp_start`` of the first H_pp of a template.
    """
    n = structure.system.n
    block_first, block_count = [0] * n, [0] * n
    block_row: list[int] = []
    mixed: list[dict[int, int]] = [{} for _ in range(n)]  # momentum → row → place in its column
    pp = 0  # entries of H_pp so far
    for template, energy in zip(structure.templates, energies, strict=True):
        energy |= {"pp_start": pp, "mixed": []}
        for instance in template.instances if template.p else ():
            for a in instance.p:
                block_first[a], block_count[a] = len(block_row), len(instance.p)
                block_row += instance.p
                pp += len(instance.p)
                for b in instance.q:
                    mixed[a].setdefault(b, len(mixed[a]))
    for template in structure.force_templates:
        for instance in template.instances:
            for a in instance.p:
                for row in instance.rows:
                    mixed[a].setdefault(row, len(mixed[a]))
    first = [0]
    # columns of different length in one array: column e begins at first[e]
    for entries in mixed:
        first.append(first[-1] + len(entries))
    for template, energy in zip(structure.templates, energies, strict=True):
        energy["mixed"] = [[first[a] + mixed[a][b] for a in i.p for b in i.q]
                         for i in template.instances]
    for template, force in zip(structure.force_templates, forces, strict=True):
        force["mixed"] = [[first[a] + mixed[a][row] for row in i.rows for a in i.p]
                         for i in template.instances]
    return {"block_first": block_first, "block_count": block_count, "block_row": block_row,
            "mixed_first": first, "mixed_row": [b for entries in mixed for b in entries],
            "pp_entries": pp, "mixed_entries": first[-1]}


def _band(structure: Structure, scheme: SparkScheme | MeanScheme) -> tuple[list[int], int]:
    """Return the place of each unknown, and of its equation, in a narrow band, and half its width.

    Unknowns are numbered as the scheme numbers them: k and k̂ of all stages, or increments of q and
    p, then multipliers.
    """
    n, m = structure.system.n, structure.system.m
    s, p = (scheme.tableau.s, scheme.tableau.p) if scheme.tableau else (1, 1)
    # the unknowns of one coordinate, s stages of k and of k̂, are neighbours in the band, as every
    # stage is coupled to all others
    unknowns = {("q", a): [half * s * n + i * n + a for half in (0, 1) for i in range(s)]
                for a in range(n)}
    unknowns |= {("g", row): [2 * s * n + node * m + row for node in range(p)]
                 for row in range(m)}
    position: dict[int, int] = {}
    first, last = {}, {}
    for node in structure.band_order:
        first[node] = len(position)
        for unknown in unknowns[node]:
            position[unknown] = len(position)
        last[node] = len(position) - 1
    band = 0
    for nodes in structure.coupled:
        band = max(band, max(last[x] for x in nodes) - min(first[x] for x in nodes))
    return [position[u] for u in range(len(position))], band
