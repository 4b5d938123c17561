"""Elimination orders with little fill-in, and narrow bands, of sparse symmetric matrices.

A matrix is a graph: its rows are the nodes, its nonzero entries off the diagonal the edges.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from heapq import heappop, heappush

from ...core.records import dataclass

__all__ = ["Elimination", "Node", "connected_components", "eliminate", "reverse_cuthill_mckee"]

Node = tuple[str, int]


@dataclass(frozen=True)
class Elimination:
    """Sparse LDLᵀ of a symmetric matrix: the operations of each pivot, in order.

    Entry r of the storage is the diagonal of row r, further entries are below it, pivot by pivot.
    For pivot ``order[k]`` the rows ``rows[k]`` have an entry in its column, at ``slots[k]``; the
    entry of each pair i > j of them, row by row, is at ``targets[k]``.
    """

    order: tuple[int, ...]
    rows: tuple[tuple[int, ...], ...]
    slots: tuple[tuple[int, ...], ...]
    targets: tuple[tuple[int, ...], ...]
    entries: int
    slot_of: dict[tuple[int, int], int]

    @property
    def before(self) -> tuple[tuple[tuple[int, int], ...], ...]:
        """For each row ``order[k]``, the earlier pivots with an entry in it, and its slot.

        The elimination by rows: row i of L has these columns.
        """
        earlier: dict[int, list[tuple[int, int]]] = {row: [] for row in self.order}
        for pivot, rows, slots in zip(self.order, self.rows, self.slots, strict=True):
            for row, slot in zip(rows, slots, strict=True):
                earlier[row].append((pivot, slot))
        return tuple(map(tuple, earlier.values()))

    @property
    def products(self) -> int:
        """Number of multiply-adds of a factorisation: one for each target and each row entry."""
        return sum(len(t) + len(r) for t, r in zip(self.targets, self.rows, strict=True))


def connected_components(sets: Iterable[frozenset[int]]) -> list[frozenset[int]]:
    """Return the connected components of overlapping sets, in the order of their least elements.

    By a union-find forest: ``parent`` leads from each element to the root of its component.
    """
    parent: dict[int, int] = {}
    for members in sets:
        first_root = None
        # all members of a set get the root of its least one
        for a in sorted(members):
            parent.setdefault(a, a)
            if first_root is None:
                first_root = _root(parent, a)
            else:
                parent[_root(parent, a)] = first_root
    unions: dict[int, set[int]] = defaultdict(set)
    for a in sorted(parent):
        unions[_root(parent, a)].add(a)
    return [frozenset(u) for u in sorted(unions.values(), key=min)]


def _root(parent: dict[int, int], a: int) -> int:
    """Return the root of an element of a forest; the path to it is halved on the way."""
    while parent[a] != a:
        parent[a] = parent[parent[a]]
        a = parent[a]
    return a


def eliminate(neighbours: dict[int, set[int]]) -> Elimination:
    """Return the elimination of a symmetric matrix, without fill for chains and trees of bodies.

    ``neighbours`` has, for each row, the columns of its nonzero entries off the diagonal.
    """
    pivots = _minimum_degree_order(neighbours)
    order = list(pivots)
    position = {row: k for k, row in enumerate(order)}
    rows = [tuple(sorted(column, key=position.__getitem__)) for column in pivots.values()]
    # the storage: the diagonal, then the column of each pivot
    slot_of = {(row, row): row for row in order}
    entries = len(order)
    for pivot, column in zip(order, rows, strict=True):
        for row in column:
            slot_of[row, pivot] = slot_of[pivot, row] = entries
            entries += 1
    slots = [tuple(slot_of[row, pivot] for row in column)
             for pivot, column in zip(order, rows, strict=True)]
    # the update of a pivot changes the entry of each pair of rows in its column
    targets = [tuple(slot_of[i, j] for count, i in enumerate(column) for j in column[:count])
               for column in rows]
    return Elimination(tuple(order), tuple(rows), tuple(slots), tuple(targets),
                       entries, slot_of)


def _minimum_degree_order(neighbours: dict[int, set[int]]) -> dict[int, set[int]]:
    """Return pivot → rows with an entry in its column, in the order of elimination.

    The next pivot is the first row, of few neighbours, whose neighbours are all coupled to each
    other: its elimination adds no entry. If there is none, as in a loop, it is the row with fewest
    neighbours (minimum degree), whose neighbours become coupled.
    """
    graph = {row: set(neighbourhood) for row, neighbourhood in neighbours.items()}
    pivots: dict[int, set[int]] = {}
    # rows by degree; an entry whose degree has changed since is dropped when it comes up
    heap = sorted((len(neighbourhood), row) for row, neighbourhood in graph.items())
    while graph:
        examined: list[tuple[int, int]] = []
        while heap:
            degree, row = heappop(heap)
            if row in graph and degree == len(graph[row]):
                examined.append((degree, row))
                if _is_clique(graph, graph[row]):
                    break
        _, last_row = examined[-1]
        _, row_of_least_degree = examined[0]
        pivot = last_row if _is_clique(graph, graph[last_row]) else row_of_least_degree
        # the rows that were passed over are candidates for the next pivot again
        for entry in examined:
            heappush(heap, entry)
        neighbourhood = graph.pop(pivot)
        pivots[pivot] = neighbourhood
        for row in neighbourhood:
            graph[row] |= neighbourhood
            graph[row] -= {row, pivot}
            heappush(heap, (len(graph[row]), row))
    return pivots


def _is_clique(neighbours: dict[int, set[int]], rows: set[int]) -> bool:
    """Whether all ``rows`` are coupled to each other: each lacks itself alone as a neighbour."""
    return all(len(rows - neighbours[row]) == 1 for row in rows)


def reverse_cuthill_mckee(neighbours: dict[Node, set[Node]]) -> list[Node]:
    """Return the nodes of a graph in an order in which its matrix has a narrow band.

    Breadth first from a peripheral node of each component, neighbours of low degree first, reversed
    (Cuthill, McKee, 1969).
    """
    order: list[Node] = []
    visited: set[Node] = set()
    number = {node: i for i, node in enumerate(neighbours)}
    for node in neighbours:
        if node in visited:
            continue
        end = node
        # the last node of a search is far from its start: after a few searches nearly peripheral
        for _ in range(4):
            end = _breadth_first(neighbours, number, end)[-1]
        component = _breadth_first(neighbours, number, end)
        order += component
        visited |= set(component)
    return order[::-1]


def _breadth_first(
    neighbours: dict[Node, set[Node]], number: dict[Node, int], start: Node
) -> list[Node]:
    """Return the nodes reached from ``start`` level by level, those with few neighbours first.

    ``number`` decides between nodes with as many neighbours.
    """
    queue, queued = [start], {start}
    for node in queue:
        new_nodes = neighbours[node] - queued
        queue += sorted(new_nodes, key=lambda neighbour: (len(neighbours[neighbour]),
                                                          number[neighbour]))
        queued |= new_nodes
    return queue
