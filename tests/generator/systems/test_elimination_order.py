"""The order of elimination, by a search through all rows for each pivot."""

from __future__ import annotations

import random

from gyrospark.generator.systems.elimination_order import eliminate


def _searched(neighbours: dict[int, set[int]]) -> list[int]:
    left = {row: set(others) for row, others in neighbours.items()}
    order = []
    while left:
        rows = sorted(left, key=lambda row: (len(left[row]), row))
        free = [row for row in rows
                if all(left[row] <= left[other] | {other} for other in left[row])]
        pivot = [*free, rows[0]][0]
        others = left.pop(pivot)
        order.append(pivot)
        for row in others:
            left[row] = (left[row] | others) - {row, pivot}
    return order


def test_pivots_are_those_of_a_search():
    for seed in range(100):
        draw = random.Random(seed)
        count = draw.randint(1, 20)
        neighbours: dict[int, set[int]] = {row: set() for row in range(count)}
        for _ in range(draw.randint(0, 2 * count)):
            a, b = draw.randrange(count), draw.randrange(count)
            if a != b:
                neighbours[a].add(b)
                neighbours[b].add(a)
        assert list(eliminate(neighbours).order) == _searched(neighbours)
