"""Coupling of coordinates in H, derived from its terms.

    kinetic block   momenta that H_pp couples, directly or through others
    block           coordinates and momenta in the energy of a kinetic block
    class           blocks that are coupled to each other and to the same others, as x, y, z
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from itertools import combinations

from ..systems.elimination_order import connected

__all__ = ["CoordinateCoupling"]

Places = frozenset[int]


class CoordinateCoupling:
    """Kinetic blocks, blocks and classes of n coordinates.

    Parameters
    ----------
    terms : iterable of pairs
        For each term of H, the indices of its momenta, and those of its coordinates and momenta.
    """

    def __init__(self, n: int, terms: Iterable[tuple[Places, Places]]) -> None:
        pairs = list(dict.fromkeys(terms))
        self.kinetic_block_of = {a: min(block) for block in connected([p for p, _ in pairs])
                                 for a in block}
        reach: dict[int, set[int]] = defaultdict(set)
        for p, places in pairs:
            if p:
                reach[self.kinetic_block_of[min(p)]] |= places
        every = [frozenset([a]) for a in range(n)]
        blocks = connected([*every, *map(frozenset, reach.values())])
        self.block_of = {a: min(block) for block in blocks for a in block}
        near: dict[int, set[int]] = {min(block): {min(block)} for block in blocks}
        for _, places in pairs:
            for a, b in combinations(sorted(self.blocks(places)), 2):
                near[a].add(b)
                near[b].add(a)
        self.near = near
        first: dict[Places, int] = {}
        self.class_of = {b: first.setdefault(frozenset(others), b) for b, others in near.items()}

    def blocks(self, places: Iterable[int]) -> Places:
        """Return the blocks of indices."""
        return frozenset(self.block_of[a] for a in places)

    def classes(self, places: Iterable[int]) -> Places:
        """Return the classes of indices."""
        return frozenset(self.class_of[b] for b in self.blocks(places))

    def are_coupled(self, places: Iterable[int]) -> bool:
        """Whether some term of H couples each two of the indices."""
        blocks = self.blocks(places)
        return all(blocks <= self.near[b] for b in blocks)
