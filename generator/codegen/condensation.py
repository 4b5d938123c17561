"""Condensation of Newton's system: rates of momenta are eliminated before the band is factorised.

With y = δk − r, of the rows of k, and H_pp invertible block by block, rows of k give
δP = H_pp⁻¹ (y − H_pq δQ), and rows of k̂ become

    H_pp⁻¹ (y − H_pq δQ) + Δt Â (D δQ + C y) + Δt Ã (Gᵀ δΛ + K δD) = Δt Â r̂,
    C = X H_pp⁻¹,  D = H_qq − F_q − C H_pq,  X = H_qp − F_p.

Coordinates whose forces are constants and constraint forces, such as positions in a chain with ball
joints, leave m δk + Δt Ã Gᵀ δΛ = …, which gives their rates; the multipliers of a body's joints are
coupled then. A chain keeps s·4 unknowns δk of a body and its multipliers. The engine's
``newton/condensed.h`` has the algorithm; here are the places of the entries.
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
    free = _free_coordinates(structure, block_of)
    columns = [{a} for a in range(n)]
    moved: list[set[int]] = [set() for _ in range(n)]  # columns whose momenta act on a row
    for form in structure.templates:
        for i in form.instances if form.p else ():
            for a in (*i.p, *i.q):
                moved[a] |= {a} if a in free else {*i.p, *i.q} - free
    coupled = [{*i.q, *i.p} - free for i in (
        i for form in (*structure.templates, *structure.constraint_templates)
        for i in form.instances)]
    for nodes in coupled:
        for a in nodes:
            columns[a] |= nodes
    for form in structure.force_templates:
        for i in form.instances:
            reached = set(i.q).union(*(block_of[a] for a in i.p))
            coupled.append((reached | set(i.rows)) - free)
            for a in i.rows:
                columns[a] |= reached
                moved[a] = moved[a].union(*(block_of[b] for b in i.p))
    entries = [(a, b) for a in range(n)
               for b in (*sorted(moved[a]), *sorted(columns[a] - moved[a]))]
    slot = {entry: k for k, entry in enumerate(entries)}
    # Derivatives by free coordinates are 0, but for H_pp.
    slot |= {pair: slot[a, a] for i in (
        i for form in (*structure.templates, *structure.constraint_templates)
        for i in form.instances) for a in free.intersection((*i.q, *i.p))
        for b in (*i.q, *i.p) for pair in ((a, b), (b, a))}
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
    # A body with many joints would couple them all.
    positions, band, free = min(
        (_positions(structure, scheme, coupled, constraint_entries, eliminated)
         for eliminated in (free, frozenset())), key=lambda p: len(p[0]) * p[1] ** 2)
    pairs = [(e, f) for e, (_, a) in enumerate(constraint_entries) if a in free
             for f, (_, b) in enumerate(constraint_entries) if a == b]
    first = [0]
    for row in columns:
        first.append(first[-1] + len(row))
    return {"first": first, "moved": [first[a] + len(moved[a]) for a in range(n)],
            "rows": [a for a, _ in entries], "columns": [b for _, b in entries],
            "constraint_rows": [mu for mu, _ in constraint_entries],
            "constraint_columns": [b for _, b in constraint_entries], "pairs": pairs,
            "largest": max(len(form.p) * max(len(form.p), len(form.q))
                           for form in structure.templates),
            "positions": positions, "band": band, "unknowns": max(positions) + 1}


def _free_coordinates(structure: Structure, block_of: dict[int, set[int]]) -> frozenset[int]:
    """Return the coordinates of a block of their own, on which all else depends linearly."""
    bound: set[int] = set()
    for form in (*structure.templates, *structure.constraint_templates):
        state = {*form.q, *form.p}
        nonlinear = [k for k, x in enumerate(form.q)
                     if any(e.diff(x).free_symbols & state for e in form.expressions)]
        coupled = len(form.p) > 1 or any(
            e.diff(y).free_symbols & {*form.q} for y in form.p for e in form.expressions)
        for i in form.instances:
            bound.update(i.q[k] for k in nonlinear)
            bound.update(i.p if coupled else ())
    for form in structure.force_templates:
        for i in form.instances if form.q or form.p else ():
            bound.update(i.rows, i.q, *(block_of[a] for a in i.p))
    return frozenset(range(structure.system.n)) - bound


def _positions(
    structure: Structure, scheme: SparkScheme | MeanScheme, coupled: list[set[int]],
    constraint_entries: list[tuple[int, int]], free: frozenset[int],
) -> tuple[list[int], int, frozenset[int]]:
    """Return the places of the unknowns δk, δΛ in a narrow band, how far it reaches, and ``free``.

    The place of the rates of free coordinates is -1.
    """
    n, m = structure.system.n, structure.system.m
    s, p = (scheme.tableau.s, scheme.tableau.p) if scheme.tableau else (1, 1)
    neighbours: dict[Node, set[Node]] = {**{("q", a): set() for a in range(n) if a not in free},
                                         **{("g", row): set() for row in range(m)}}
    groups = [{("q", a) for a in coordinates} for coordinates in coupled]
    of_free: dict[int, set[Node]] = {a: set() for a in free}
    for row, a in constraint_entries:
        if a in free:
            of_free[a].add(("g", row))
        else:
            groups.append({("g", row), ("q", a)})
    for nodes in (*groups, *of_free.values()):
        present = nodes & neighbours.keys()
        for node in present:
            neighbours[node] |= present - {node}
    first: dict[Node, int] = {}
    positions = [-1] * (s * n + p * m)
    count = 0
    for node in reverse_cuthill_mckee(neighbours):
        kind, index = node
        first[node] = count
        for k in range(s if kind == "q" else p):
            positions[k * n + index if kind == "q" else s * n + k * m + index] = count
            count += 1
    size = {"q": s, "g": p}
    reach = max((first[b] + size[b[0]] - 1 - first[a]
                 for a, others in neighbours.items() for b in (a, *others)), default=0)
    return positions, reach, free
