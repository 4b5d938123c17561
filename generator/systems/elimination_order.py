"""The order in which the zeros of a symmetric matrix stay: graphs of rows that meet."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from heapq import heappop, heappush

from ...core.records import dataclass

__all__ = ["Elimination", "Node", "connected", "eliminate", "reverse_cuthill_mckee"]

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
        """The same by rows: for ``order[k]``, earlier pivots that act on it, and the entry's slot.
        """
        earlier: dict[int, list[tuple[int, int]]] = {row: [] for row in self.order}
        for pivot, rows, slots in zip(self.order, self.rows, self.slots, strict=True):
            for row, slot in zip(rows, slots, strict=True):
                earlier[row].append((pivot, slot))
        return tuple(map(tuple, earlier.values()))

    @property
    def products(self) -> int:
        """How many multiply-adds factorising takes."""
        return sum(len(t) + len(r) for t, r in zip(self.targets, self.rows, strict=True))


def connected(sets: Iterable[frozenset[int]]) -> list[frozenset[int]]:
    """Return the connected components of overlapping sets, in the order of their least elements.

    By a union-find forest: ``parent`` leads from each element to the root of its component.
    """
    parent: dict[int, int] = {}

    def root(a: int) -> int:
        """Return the root of an element; the path to it is halved on the way."""
        while parent[a] != a:
            parent[a] = parent[parent[a]]
            a = parent[a]
        return a

    for members in sets:
        first_root = None
        for a in sorted(members):
            parent.setdefault(a, a)
            if first_root is None:
                first_root = root(a)
            else:
                parent[root(a)] = first_root
    unions: dict[int, set[int]] = defaultdict(set)
    for a in sorted(parent):
        unions[root(a)].add(a)
    return [frozenset(u) for u in sorted(unions.values(), key=min)]


def eliminate(neighbours: dict[int, set[int]]) -> Elimination:
    """Return the elimination of a symmetric matrix, without fill for chains and trees of bodies.

    ``neighbours`` has, for each row, the columns of its nonzero entries off the diagonal. The next
    pivot is the first row whose neighbours are all coupled to each other, so that no entry is new;
    if there is none, as in a loop, the row with fewest neighbours (minimum degree).
    """
    graph = {row: set(neighbourhood) for row, neighbourhood in neighbours.items()}
    order, below = [], []  # pivots, and the rows that are coupled to each when it is eliminated
    heap = sorted((len(neighbourhood), row) for row, neighbourhood in graph.items())
    while graph:
        examined: list[tuple[int, int]] = []
        while heap:
            size, row = heappop(heap)
            if row in graph and size == len(graph[row]):  # else its neighbours have changed since
                examined.append((size, row))
                if _is_clique(graph, graph[row]):
                    break
        pivot = examined[-1][1] if _is_clique(graph, graph[examined[-1][1]]) else examined[0][1]
        for entry in examined:
            heappush(heap, entry)
        neighbourhood = graph.pop(pivot)
        order.append(pivot)
        below.append(neighbourhood)
        for row in neighbourhood:
            graph[row] |= neighbourhood
            graph[row] -= {row, pivot}
            heappush(heap, (len(graph[row]), row))
    position = {row: k for k, row in enumerate(order)}
    slot_of = {(row, row): row for row in order}
    entries = len(order)
    rows = [tuple(sorted(neighbourhood, key=position.__getitem__)) for neighbourhood in below]
    for pivot, acted in zip(order, rows, strict=True):
        for row in acted:
            slot_of[row, pivot] = slot_of[pivot, row] = entries
            entries += 1
    slots = [tuple(slot_of[row, pivot] for row in acted)
             for pivot, acted in zip(order, rows, strict=True)]
    targets = [tuple(slot_of[i, j] for count, i in enumerate(acted) for j in acted[:count])
               for acted in rows]
    return Elimination(tuple(order), tuple(rows), tuple(slots), tuple(targets),
                       entries, slot_of)


def _is_clique(neighbours: dict[int, set[int]], rows: set[int]) -> bool:
    return all(len(rows - neighbours[row]) == 1 for row in rows)


def reverse_cuthill_mckee(neighbours: dict[Node, set[Node]]) -> list[Node]:
    """Return the nodes of a graph in an order in which its matrix has a narrow band.

    Breadth first from a peripheral node of each component, neighbours of low degree first, reversed
    (Cuthill, McKee, 1969).
    """
    order: list[Node] = []
    visited: set[Node] = set()
    number = {node: i for i, node in enumerate(neighbours)}

    def breadth_first(start: Node) -> list[Node]:
        """Return the nodes reached from ``start`` level by level, those with few neighbours first.
        """
        queue, queued = [start], {start}
        for node in queue:
            new_nodes = neighbours[node] - queued
            queue += sorted(new_nodes, key=lambda neighbour: (len(neighbours[neighbour]),
                                                              number[neighbour]))
            queued |= new_nodes
        return queue

    for node in neighbours:
        if node in visited:
            continue
        end = node
        for _ in range(4):  # the last node of a search is far from its start: nearly peripheral
            end = breadth_first(end)[-1]
        component = breadth_first(end)
        order += component
        visited |= set(component)
    return order[::-1]
