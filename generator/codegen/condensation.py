"""Condensation of Newton's system: rates of momenta are eliminated before the band is factorised.

With y = δk − r, of the rows of k, and H_pp invertible block by block, rows of k give
δP = H_pp⁻¹ (y − H_pq δQ), and rows of k̂ become

    H_pp⁻¹ (y − H_pq δQ) + Δt Â (D δQ + C y) + Δt Ã (Gᵀ δΛ + K δD) = Δt Â r̂,
    C = X H_pp⁻¹,  D = H_qq − F_q − C H_pq,  X = H_qp − F_p,

with δQ = Δt A δk and, at the constraint nodes, δD = Δt Ā δk and G δD = r. The unknowns are δk and
δΛ. Free coordinates, whose forces are constants and constraint forces, such as positions in a chain
with ball joints, leave m δk + Δt Ã Gᵀ δΛ = …, which gives their rates; the multipliers of a body's
joints are coupled then by G m⁻¹ Gᵀ. A chain keeps s·4 unknowns δk of a body and its multipliers.
The engine's ``newton/condensed.h`` has the algorithm; here are the places of the entries.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, product
from typing import Any, NamedTuple

from ...core.records import dataclass
from ..schemes.step_equations import MeanScheme, SparkScheme
from ..systems.elimination_order import Node, reverse_cuthill_mckee
from ..systems.repeated_structure import Structure

__all__ = ["Condensation", "condensation_of"]


@dataclass(frozen=True)
class Condensation:
    """The entries of the condensed system and the order of its unknowns.

    The matrices of the coordinates, H_pp⁻¹, H_pp⁻¹ H_pq, C, D and K, have the same entries.

    Attributes
    ----------
    first : list of int
        Index of the first entry of each row, then the number of entries.
    momentum_ends : list of int
        End of the entries of each row that are not 0 in H_pp, H_pq and X; further entries of the
        row belong to D and K alone.
    rows, columns : list of int
        Row and column of each entry, row by row.
    constraint_rows, constraint_columns : list of int
        Constraint and coordinate of each entry of G that is not always 0, those of eliminated
        coordinates first.
    constraint_places : list of int
        Index of each of them in the matrices G of all instances, row by row.
    constraint_size, eliminated_entries : int
        Number of all entries of these matrices, and of the entries of eliminated coordinates.
    pairs : list of (int, int)
        Entries of G in the column of one eliminated coordinate, for G m⁻¹ Gᵀ.
    largest : int
        Largest number of entries of H_pp or H_pq of an element.
    positions : list of int
        Place in the band of each δk, s × n, then of each δΛ, p × m; −1 for eliminated ones.
    band, unknowns : int
        Half the bandwidth, and the number of unknowns.
    tables : list of dict
        Of each template of energies, constraints and forces in turn: ``condensed`` has the places
        of the second derivatives of each instance, ``condensed_start`` the first entry of its G,
        ``curved`` the entries of K that are not always 0, to which its places belong.
    """

    first: list[int]
    momentum_ends: list[int]
    rows: list[int]
    columns: list[int]
    constraint_rows: list[int]
    constraint_columns: list[int]
    constraint_places: list[int]
    constraint_size: int
    eliminated_entries: int
    pairs: list[tuple[int, int]]
    largest: int
    positions: list[int]
    band: int
    unknowns: int
    tables: list[dict[str, Any]]


class _Couplings(NamedTuple):
    """Coupled coordinates, row by row and element by element.

    Attributes
    ----------
    columns : list of set
        The columns of each row that are not always 0.
    by_momenta : list of set
        The columns among these that are not 0 in H_pp, H_pq and X.
    elements : list of set
        The coordinates of each instance of a template, without free ones.
    """

    columns: list[set[int]]
    by_momenta: list[set[int]]
    elements: list[set[int]]


def condensation_of(
    structure: Structure, scheme: SparkScheme | MeanScheme, constraints: list[dict[str, Any]]
) -> Condensation | None:
    """Return the pattern of a step's Newton system without its momenta, or None.

    Rates of momenta are eliminated by the inverse of H_pp, and so are free coordinates
    (``_free_coordinates``), if that narrows the band. None if H_pp is singular.

    ``constraints`` has one table for each template of constraints, with its kernels.
    """
    block_of = _kinetic_blocks(structure)
    if block_of is None:
        return None
    free_q = _free_coordinates(structure, block_of)
    columns, by_momenta, elements = _couplings(structure, block_of, free_q)
    # (row, column) of all matrices of coordinates: in each row first those that are not 0 in H_pp,
    # H_pq and X = H_qp − F_p, which end at ``momentum_ends``, then the entries of D and K alone
    entries = [(a, b) for a in range(structure.system.n)
               for b in (*sorted(by_momenta[a]), *sorted(columns[a] - by_momenta[a]))]
    stored, nonzero = _jacobian_entries(structure, constraints)
    # Free coordinates are eliminated, all or none, if that narrows the band: it couples multipliers
    # of all joints of a body to each other, which widens the band of a body with many joints.
    bands = {coordinates: _band(structure, scheme, elements, nonzero, coordinates)
             for coordinates in (free_q, frozenset[int]())}
    eliminated = min(bands, key=lambda coordinates: bands[coordinates].half_width)
    band = bands[eliminated]
    # stable: eliminated columns first
    nonzero.sort(key=lambda row_and_column: row_and_column[1] not in eliminated)
    place_of = {entry: k for k, entry in enumerate(stored)}
    first = [0, *accumulate(map(len, columns))]
    return Condensation(
        first=first,
        # ``first`` has one entry more, the end of the last row
        momentum_ends=[start + len(row) for start, row in zip(first, by_momenta, strict=False)],
        rows=[a for a, _ in entries],
        columns=[b for _, b in entries],
        constraint_rows=[mu for mu, _ in nonzero],
        constraint_columns=[b for _, b in nonzero],
        constraint_places=[place_of[entry] for entry in nonzero],
        constraint_size=len(stored),
        eliminated_entries=sum(a in eliminated for _, a in nonzero),
        pairs=_pairs_in_columns(nonzero, eliminated),
        largest=max(len(template.p) * max(len(template.p), len(template.q))
                    for template in structure.templates),
        positions=band.positions,
        band=band.half_width,
        unknowns=max(band.positions) + 1,
        tables=_tables(structure, entries, free_q, constraints),
    )


def _kinetic_blocks(structure: Structure) -> dict[int, set[int]] | None:
    """Return, for each momentum, the coordinates of the element of H that it belongs to.

    None if H_pp is singular: a block of H_pp has a zero row, or a momentum is in no element.
    """
    block_of: dict[int, set[int]] = {}
    for template in structure.templates:
        if template.p and not all(map(any, template.system.H_pp)):
            return None
        for instance in template.instances:
            block_of |= {a: {*instance.q, *instance.p} for a in instance.p}
    return block_of if len(block_of) == structure.system.n else None


def _jacobian_entries(
    structure: Structure, constraints: list[dict[str, Any]]
) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Return the entries (constraint, coordinate) of G that are stored, and the nonzero ones.

    Stored are the whole matrices of all instances, row by row; nonzero are the entries of these
    that are not 0 for every state.
    """
    stored: list[tuple[int, int]] = []
    nonzero: list[tuple[int, int]] = []
    for template, tables in zip(structure.constraint_templates, constraints, strict=True):
        places = _nonzero(tables, "jacobian")
        for instance in template.instances:
            matrix = list(product(instance.rows, instance.q))
            stored += matrix
            nonzero += [matrix[k] for k in places]
    return stored, nonzero


def _pairs_in_columns(
    entries: list[tuple[int, int]], eliminated: frozenset[int]
) -> list[tuple[int, int]]:
    """Return the pairs of entries of G in the column of one eliminated coordinate.

    The entries (μ, a) and (ν, a) of a pair contribute G_μa G_νa / m_a to G m⁻¹ Gᵀ.
    """
    column_of: dict[int, list[int]] = {a: [] for a in sorted(eliminated)}
    for e, (_, a) in enumerate(entries):
        if a in eliminated:
            column_of[a].append(e)
    return [pair for column in column_of.values() for pair in product(column, column)]


def _couplings(
    structure: Structure, block_of: dict[int, set[int]], free: frozenset[int]
) -> _Couplings:
    """Return the couplings of all coordinates by energies, constraints and forces.

    Coordinates are coupled where an entry of the module's H_pp, H_pq, X, C, D or K is not always 0.
    ``block_of`` has, of each momentum, the coordinates of the element of H that it belongs to: the
    columns of its row of H_pp⁻¹. ``free`` are the free coordinates, whose only coupling is their
    own 1/m.
    """
    n = structure.system.n
    columns = [{a} for a in range(n)]  # the diagonal is stored in any case
    by_momenta: list[set[int]] = [set() for _ in range(n)]
    elements: list[set[int]] = []
    for template in structure.templates:
        for instance in template.instances if template.p else ():
            for a in (*instance.p, *instance.q):  # H_pp and H_pq; of a free coordinate, 1/m alone
                by_momenta[a] |= {a} if a in free else {*instance.p, *instance.q} - free
    for template in (*structure.templates, *structure.constraint_templates):
        for instance in template.instances:  # H_qq, and K = (Gᵀ λ)_q
            elements.append({*instance.q, *instance.p} - free)
            for a in elements[-1]:
                columns[a] |= elements[-1]
    for template in structure.force_templates:
        # F_q in D, and −F_p H_pp⁻¹ in C: the blocks of the momenta that F depends on
        for instance in template.instances:
            reached = set(instance.q).union(*(block_of[a] for a in instance.p))
            elements.append((reached | set(instance.rows)) - free)
            for a in instance.rows:
                columns[a] |= reached
                by_momenta[a] = by_momenta[a].union(*(block_of[b] for b in instance.p))
    return _Couplings(columns, by_momenta, elements)


def _tables(
    structure: Structure, entries: list[tuple[int, int]], free: frozenset[int],
    constraints: list[dict[str, Any]],
) -> list[dict[str, Any]]:
    """Return ``Condensation.tables``: for each template, the indices of its instances' entries.

    ``entries`` are the (row, column) of the condensed matrices, in order; ``constraints`` has one
    table for each template of constraints, with its kernels.
    """
    index_of = {entry: k for k, entry in enumerate(entries)}
    # Of a free coordinate a only the diagonal entry is stored, H_pp = 1/m: templates have zeros in
    # the rest of its row and column, which are added there too.
    for template in (*structure.templates, *structure.constraint_templates):
        for instance in template.instances:
            for a in free.intersection((*instance.q, *instance.p)):
                for b in (*instance.q, *instance.p):
                    index_of[a, b] = index_of[b, a] = index_of[a, a]

    def indices(rows: Sequence[int], columns: Sequence[int]) -> list[int]:
        """Return the indices of the entries of a block, row by row."""
        return [index_of[entry] for entry in product(rows, columns)]

    tables: list[dict[str, Any]] = []
    for template in structure.templates:
        # H_pp, H_pq, H_qp and H_qq of each instance
        tables.append({"condensed": [
            [*indices(instance.p, instance.p), *indices(instance.p, instance.q),
             *indices(instance.q, instance.p), *indices(instance.q, instance.q)]
            for instance in template.instances]})
    start = 0  # of a template, in the matrices G of all instances
    for template, constraint in zip(structure.constraint_templates, constraints, strict=True):
        curved = _nonzero(constraint, "curvature")
        # K of each instance
        blocks = [indices(instance.q, instance.q) for instance in template.instances]
        tables.append({"condensed": [[block[k] for k in curved] for block in blocks],
                       "curved": curved, "condensed_start": start})
        start += sum(len(instance.rows) * len(instance.q) for instance in template.instances)
    for template in structure.force_templates:
        tables.append({"condensed": [indices(instance.rows, instance.q)  # F_q
                                     for instance in template.instances]})
    return tables


def _nonzero(constraint: dict[str, Any], name: str) -> list[int]:
    """Return the places, row by row, of the entries of G or K that are not 0 for every state.

    ``name`` is "jacobian" for G and "curvature" for K; of IMS and EMS, G and K of the step count
    too, whose kernels have the prefix ``mean_``.
    """
    return sorted({k for kernel in constraint["kernels"]
                   if kernel["name"] in (name, f"mean_{name}") for k in kernel["nonzero"]})


def _free_coordinates(structure: Structure, block_of: dict[int, set[int]]) -> frozenset[int]:
    """Return the free coordinates: each is a block of its own with H_pp = 1/m, F = 0 and g_qq = 0.

    H and g depend on them linearly, with coefficients that are constants. ``block_of`` is the
    result of ``_kinetic_blocks``.
    """
    bound: set[int] = set()
    for template in (*structure.templates, *structure.constraint_templates):
        state = {*template.q, *template.p}
        # an expression is linear in x if its derivative by x does not depend on the state
        nonlinear = [k for k, x in enumerate(template.q)
                     if any(e.diff(x).free_symbols & state for e in template.expressions)]
        # momenta are coupled by H_pp, or to coordinates by H_pq
        coupled = len(template.p) > 1 or any(
            e.diff(y).free_symbols & {*template.q}
            for y in template.p for e in template.expressions)
        for instance in template.instances:
            bound.update(instance.q[k] for k in nonlinear)
            bound.update(instance.p if coupled else ())
    # a force binds its own coordinate, those that it depends on, and the blocks of its momenta
    for template in structure.force_templates:
        for instance in template.instances if template.q or template.p else ():
            bound.update(instance.rows, instance.q, *(block_of[a] for a in instance.p))
    return frozenset(range(structure.system.n)) - bound


class _Band(NamedTuple):
    """The unknowns δk, δΛ in the order of a band matrix."""

    positions: list[int]  # of each unknown in the band, −1 of an eliminated one
    half_width: int


def _band(
    structure: Structure, scheme: SparkScheme | MeanScheme, elements: list[set[int]],
    constraint_entries: list[tuple[int, int]], free: frozenset[int],
) -> _Band:
    """Return a narrow band of the unknowns δk, δΛ, the rates of the ``free`` q eliminated.

    All stages of a coordinate, and all nodes of a constraint, are neighbours in the band.
    """
    n, m = structure.system.n, structure.system.m
    s, p = (scheme.tableau.s, scheme.tableau.p) if scheme.tableau else (1, 1)
    neighbours = _coupling_graph(structure, elements, constraint_entries, free)
    # the unknowns of a node: rates of a coordinate at all stages, multipliers at all p nodes
    count = {"q": s, "g": p}
    first: dict[Node, int] = {}
    positions = [-1] * (s * n + p * m)
    position = 0
    for node in reverse_cuthill_mckee(neighbours):
        kind, index = node
        first[node] = position
        for k in range(count[kind]):
            # δk is stored stage by stage, δΛ behind it constraint node by constraint node
            unknown = k * n + index if kind == "q" else s * n + k * m + index
            positions[unknown] = position
            position += 1
    # from the first unknown of a node to the last of its neighbour
    half_width = max((first[b] + count[b[0]] - 1 - first[a]
                      for a, adjacent in neighbours.items() for b in (a, *adjacent)), default=0)
    return _Band(positions, half_width)


def _coupling_graph(
    structure: Structure, elements: list[set[int]],
    constraint_entries: list[tuple[int, int]], free: frozenset[int],
) -> dict[Node, set[Node]]:
    """Return the graph of the condensed matrix: the neighbours of each coordinate and constraint.

    Nodes are ("q", coordinate), without the ``free`` ones, and ("g", constraint). ``elements`` are
    sets of coordinates that are coupled with each other; ``constraint_entries`` the (constraint,
    coordinate) of the entries of G.
    """
    neighbours: dict[Node, set[Node]] = {
        ("q", a): set() for a in range(structure.system.n) if a not in free}
    neighbours |= {("g", row): set() for row in range(structure.system.m)}
    cliques = [{("q", a) for a in coordinates} for coordinates in elements]
    # a constraint is coupled to its coordinates; through a free one, to all constraints on this
    constraints_on: dict[int, set[Node]] = {a: set() for a in free}
    for row, a in constraint_entries:
        if a in free:
            constraints_on[a].add(("g", row))
        else:
            cliques.append({("g", row), ("q", a)})
    for clique in (*cliques, *constraints_on.values()):
        nodes = clique & neighbours.keys()
        for node in nodes:
            neighbours[node] |= nodes - {node}
    return neighbours
