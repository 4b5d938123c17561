"""Coupling of coordinates in H, derived from its terms.

    kinetic block   momenta that H_pp couples, directly or through others
    block           coordinates and momenta in the energy of a kinetic block
    class           blocks that are coupled to each other and to the same other blocks, as x, y, z
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from itertools import combinations

from ..systems.elimination_order import connected_components

__all__ = ["CoordinateCoupling", "IndexSet"]

IndexSet = frozenset[int]


class CoordinateCoupling:
    """Kinetic blocks, blocks and classes of n coordinates.

    Parameters
    ----------
    terms : iterable of pairs
        For each term of H, the indices of its momenta, and the indices of its q and p.
    """

    def __init__(self, n: int, terms: Iterable[tuple[IndexSet, IndexSet]]) -> None:
        """Take H of ``n`` coordinates: ``terms`` has (momenta, coordinates) of each of its terms.
        """
        pairs = list(dict.fromkeys(terms))
        # a block has the name of its least index
        self.kinetic_block_of = {a: min(block)
                                 for block in connected_components([p for p, _ in pairs])
                                 for a in block}
        # coordinates that one kinetic block depends on belong together
        support_of_block: dict[int, set[int]] = defaultdict(set)
        for p, support in pairs:
            if p:  # all momenta of a term are in one block: any of them gives it
                support_of_block[self.kinetic_block_of[min(p)]] |= support
        singletons = [frozenset([a]) for a in range(n)]
        blocks = connected_components([*singletons, *map(frozenset, support_of_block.values())])
        self.block_of = {a: min(block) for block in blocks for a in block}
        neighbours: dict[int, set[int]] = {min(block): {min(block)} for block in blocks}
        for _, support in pairs:
            for a, b in combinations(sorted(self.blocks(support)), 2):
                neighbours[a].add(b)
                neighbours[b].add(a)
        self.neighbours = neighbours
        # equal sets of neighbours, each with the block itself: the blocks are of one class
        representatives: dict[IndexSet, int] = {}
        self.class_of = {block: representatives.setdefault(frozenset(adjacent), block)
                         for block, adjacent in neighbours.items()}

    def blocks(self, indices: Iterable[int]) -> IndexSet:
        """Return the blocks of indices."""
        return frozenset(self.block_of[a] for a in indices)

    def classes(self, indices: Iterable[int]) -> IndexSet:
        """Return the classes of indices."""
        return frozenset(self.class_of[b] for b in self.blocks(indices))

    def are_coupled(self, indices: Iterable[int]) -> bool:
        """Whether some term of H couples each pair of the indices."""
        blocks = self.blocks(indices)
        return all(blocks <= self.neighbours[b] for b in blocks)
