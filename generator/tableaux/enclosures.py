"""Enclosures of the coefficients of a tableau: proved, in fixed-point arithmetic."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from math import lcm
from typing import Any

import sympy as sp

from .node_algebra import Nodes, ValueNodes
from .nodes import Enclosure, enclose_roots

__all__ = ["enclose_part", "horner", "map_entries", "widest_radius"]


def enclose_part(rows: list[list[Any]], nodes: list[Nodes], bits: int) -> tuple[Any, ...]:
    """Return enclosures of a table of coefficients; its exact nodes are enclosed to 2^−bits.

    ``rows`` is the exact matrix over the algebras of the nodes: one set of nodes for a vector, two
    for a matrix. A vector becomes a tuple, a matrix a tuple of rows.
    """
    if isinstance(nodes[0], ValueNodes):
        digits = bits * 3 // 10  # log₁₀ 2 = 0.301
        enclosed = [tuple(enclose_expression(entry, digits) for entry in row) for row in rows]
        return tuple(enclosed) if len(nodes) == 2 else tuple(row[0] for row in enclosed)
    # fixed-point integers: all coefficients times their common denominator and 2^bits
    fractions = [[Fraction(int(e.numerator), int(e.denominator)) for e in row] for row in rows]
    scale = lcm(*(e.denominator for row in fractions for e in row))
    # (centre, radius), as the roots: coefficients are exact
    coefficients = [[(int(e * scale) << bits, 0) for e in row] for row in fractions]
    unit = scale << bits
    row_roots, *column_roots = (_fixed_roots(node_set, bits) for node_set in nodes)
    if not column_roots:
        polynomial = [row[0] for row in coefficients]
        return tuple(_enclosure(horner(polynomial, root, bits), unit) for root in row_roots)
    # Columns first: Σ_l C_kl vˡ then vanishes exactly for the zero column (v = 1) of Ã.
    by_column = [[horner(row, root, bits) for row in coefficients] for root in column_roots[0]]
    return tuple(tuple(_enclosure(horner(column, root, bits), unit) for column in by_column)
                 for root in row_roots)


def _fixed_roots(nodes: Any, bits: int) -> list[tuple[int, int]]:
    """Return centres and radii of the nodes in units of 2^−bits, which are integers."""
    unit = 2**bits
    return [(int(root.centre * unit), int(root.radius * unit))
            for root in enclose_roots(nodes.polynomial, bits)]


def _enclosure(interval: tuple[int, int], unit: int) -> Enclosure:
    """Return the enclosure of a centre and a radius in units of 1/unit."""
    centre, radius = interval
    return Enclosure(Fraction(centre, unit), Fraction(radius, unit))


def horner(
    coefficients: Sequence[tuple[int, int]], x: tuple[int, int], bits: int
) -> tuple[int, int]:
    """Enclose Σ_k coefficients[k] xᵏ in multiples of 2^−bits: (centre, radius), 0 when exact.

    |x| ≤ 1. A product is rounded down, which adds at most one unit to the radius.
    """
    x_centre, x_radius = x
    centre, radius = coefficients[-1]
    for coefficient, coefficient_radius in reversed(coefficients[:-1]):
        product = centre * x_centre
        # |c x − c' x'| ≤ |c| δx + δc (|x| + δx)
        error = abs(centre) * x_radius + radius * (abs(x_centre) + x_radius)
        is_rounded = product & (2**bits - 1) != 0
        centre = (product >> bits) + coefficient
        # the error is rounded up
        radius = (error >> bits) + (error != 0) + is_rounded + coefficient_radius
    return centre, radius


def enclose_expression(expression: sp.Expr, digits: int) -> Enclosure:
    """Enclose an exact number; rationals come out exact."""
    if expression.is_Rational:
        return Enclosure(Fraction(int(expression.p), int(expression.q)))
    text = str(sp.N(expression, digits))
    # SymPy's evaluation is right to its digits but for a few: five of them are given away
    centre = Fraction(text)
    return Enclosure(centre, abs(centre) * Fraction(1, 10 ** (digits - 5)))


def map_entries(parts: dict[str, Any], function: Callable[[Enclosure], Any]) -> dict[str, Any]:
    """Return the tables as nested lists, with the function applied to each entry."""
    return {
        name: [
            [function(entry) for entry in row] if isinstance(row, tuple) else function(row)
            for row in table
        ]
        for name, table in parts.items()
    }


def widest_radius(parts: dict[str, Any]) -> Fraction:
    """Return the largest radius of all enclosures."""
    rows = (row if isinstance(row, tuple) else (row,) for table in parts.values() for row in table)
    radii: list[Fraction] = [entry.radius for row in rows for entry in row]
    return max(radii)
