"""Condensation of Newton's system: rates of momenta are eliminated before the band is factorised.

With y = δk − r, of the rows of k, and H_pp invertible block by block, rows of k give
δP = H_pp⁻¹ (y − H_pq δQ), and rows of k̂ become

    H_pp⁻¹ (y − H_pq δQ) + Δt Â (D δQ + C y) + Δt Ã (Gᵀ δΛ + K δD) = Δt Â r̂,
    C = X H_pp⁻¹,  D = H_qq − F_q − C H_pq,  X = H_qp − F_p.

A chain keeps the s·7 unknowns δk of a body and its multipliers. The engine's ``newton/condensed.h``
has the algorithm; here are the places of the entries.
"""

from __future__ import annotations

from itertools import product
from typing import Any

from ..schemes.step_equations import MeanScheme, SparkScheme
from ..systems.elimination_order import Node, reverse_cuthill_mckee
from ..systems.repeated_structure import Structure

__all__ = ["condensation_of"]


def condensation_of(
    structure: Structure, scheme: SparkScheme | MeanScheme, energies: list[dict[str, Any]],
    constraints: list[dict[str, Any]], forces: list[dict[str, Any]],
) -> dict[str, Any] | None:
    """Return the pattern of the condensed system, and set ``condensed`` of the templates in it.

    None if a block of H_pp has a zero row or a momentum is in none, so that none can be inverted.
    """
    n = structure.system.n
    block_of = {a: {*i.q, *i.p} for form in structure.templates for i in form.instances
                for a in i.p}
    if len(block_of) < n or any(not any(row) for form in structure.templates if form.p
                                for row in form.system.H_pp):
        return None
    columns = [{a} for a in range(n)]
    moved: list[set[int]] = [set() for _ in range(n)]  # columns whose momenta act on a row
    for form in structure.templates:
        for i in form.instances if form.p else ():
            for a in (*i.p, *i.q):
                moved[a] |= {*i.p, *i.q}
    coupled = [{*i.q, *i.p} for form in (*structure.templates, *structure.constraint_templates)
               for i in form.instances]
    for nodes in coupled:
        for a in nodes:
            columns[a] |= nodes
    for form in structure.force_templates:
        for i in form.instances:
            reached = set(i.q).union(*(block_of[a] for a in i.p))
            coupled.append(reached | set(i.rows))
            for a in i.rows:
                columns[a] |= reached
                moved[a] = moved[a].union(*(block_of[b] for b in i.p))
    entries = [(a, b) for a in range(n)
               for b in (*sorted(moved[a]), *sorted(columns[a] - moved[a]))]
    slot = {entry: k for k, entry in enumerate(entries)}
    for form, energy in zip(structure.templates, energies, strict=True):
        energy["condensed"] = [
            [slot[pair] for rows, cols in ((i.p, i.p), (i.p, i.q), (i.q, i.p), (i.q, i.q))
             for pair in product(rows, cols)] for i in form.instances]
    constraint_entries: list[tuple[int, int]] = []
    for form, constraint in zip(structure.constraint_templates, constraints, strict=True):
        constraint["condensed"] = [[slot[pair] for pair in product(i.q, i.q)]
                                   for i in form.instances]
        constraint["condensed_start"] = len(constraint_entries)
        constraint_entries += [pair for i in form.instances for pair in product(i.rows, i.q)]
    for form, force in zip(structure.force_templates, forces, strict=True):
        force["condensed"] = [[slot[pair] for pair in product(i.rows, i.q)]
                              for i in form.instances]
    positions, band = _positions(structure, scheme, coupled, constraint_entries)
    first = [0]
    for row in columns:
        first.append(first[-1] + len(row))
    return {"first": first, "moved": [first[a] + len(moved[a]) for a in range(n)],
            "rows": [a for a, _ in entries], "columns": [b for _, b in entries],
            "constraint_rows": [mu for mu, _ in constraint_entries],
            "constraint_columns": [b for _, b in constraint_entries],
            "largest": max(len(form.p) * max(len(form.p), len(form.q))
                           for form in structure.templates),
            "positions": positions, "band": band, "unknowns": len(positions)}


def _positions(
    structure: Structure, scheme: SparkScheme | MeanScheme, coupled: list[set[int]],
    constraint_entries: list[tuple[int, int]],
) -> tuple[list[int], int]:
    """Return the place of each unknown δk, δΛ in a narrow band, and how far it reaches."""
    n, m = structure.system.n, structure.system.m
    s, p = (scheme.tableau.s, scheme.tableau.p) if scheme.tableau else (1, 1)
    neighbours: dict[Node, set[Node]] = {**{("q", a): set() for a in range(n)},
                                         **{("g", row): set() for row in range(m)}}
    for coordinates in coupled:
        nodes = {("q", a) for a in coordinates}
        for node in nodes:
            neighbours[node] |= nodes - {node}
    for row, a in constraint_entries:
        neighbours["g", row].add(("q", a))
        neighbours["q", a].add(("g", row))
    first: dict[Node, int] = {}
    positions = [0] * (s * n + p * m)
    count = 0
    for node in reverse_cuthill_mckee(neighbours):
        kind, index = node
        first[node] = count
        for k in range(s if kind == "q" else p):
            positions[k * n + index if kind == "q" else s * n + k * m + index] = count
            count += 1
    size = {"q": s, "g": p}
    reach = max(first[b] + size[b[0]] - 1 - first[a]
                for a, others in neighbours.items() for b in (a, *others))
    return positions, reach
