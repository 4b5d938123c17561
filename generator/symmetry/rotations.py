"""Linear fields X(q) = A q whose flow is a rotation, in closed form.

Where A³ = −a² A on a block of coordinates,

    e^{θA} = 1 + sin(aθ) A/a + (1 − cos(aθ)) A²/a²,

so that one sine and one cosine turn all blocks of one a: a = 1 of points, a = ½ of quaternions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import sympy as sp

from ..systems.elimination_order import connected

__all__ = ["Rotation", "commute", "rotation_of", "turned"]

#: Entries of a square matrix by row and column.
Entries = Mapping[tuple[int, int], Fraction]


@dataclass(frozen=True)
class Rotation:
    """A matrix A as its blocks, grouped by their rate a.

    Attributes
    ----------
    blocks : mapping of Fraction to matrix
        a → the part of A with A³ = −a² A.
    """

    blocks: Mapping[Fraction, Entries]

    @property
    def dual(self) -> Rotation:
        """−Aᵀ, by which momenta turn where coordinates turn by A."""
        return Rotation({a: {(j, i): -e for (i, j), e in A.items()}
                         for a, A in self.blocks.items()})


def turned(
    x: Sequence[sp.Expr], rotations: Sequence[Rotation], axis: Sequence[sp.Expr],
    cosines: Mapping[Fraction, sp.Expr], sines: Mapping[Fraction, sp.Expr],
) -> list[sp.Expr]:
    """Return e^{θA} x with A = Σ n_i A_i, from cos(aθ) and sin(aθ) of each a.

    ``axis`` is n: the number 1 of one rotation, or a unit vector where these are about e1, e2, e3.
    """
    found = list(x)
    for a in sorted({a for rotation in rotations for a in rotation.blocks}):
        parts = [(n, {place: e / a for place, e in rotation.blocks.get(a, {}).items()})
                 for n, rotation in zip(axis, rotations, strict=True)]
        once = _image(parts, x)
        twice = _image(parts, once)
        for i, e in enumerate(once):
            if e == 0 and twice[i] == 0:
                continue
            plain = _on_unit_axis(twice[i] + x[i], axis) == 0
            along = cosines[a] * x[i] if plain else x[i] + (1 - cosines[a]) * twice[i]
            found[i] = along + sines[a] * e
    return found


def rotation_of(A: Entries) -> Rotation | None:
    """Return a matrix as a rotation; None if it is none, or of a rate that binary cannot hold."""
    blocks: dict[Fraction, dict[tuple[int, int], Fraction]] = {}
    places = {place: x for place, x in A.items() if x}
    for part in connected([frozenset(place) for place in places]):
        block = {(i, j): x for (i, j), x in places.items() if i in part}
        cube = _product(block, _product(block, block))
        place, x = next(iter(block.items()))
        square = -cube.get(place, Fraction(0)) / x
        a = _root(square)
        if a is None or cube != {place: -square * x for place, x in block.items()}:
            return None
        blocks.setdefault(a, {}).update(block)
    return Rotation(blocks) if blocks else None


def commute(A: Entries, B: Entries) -> bool:
    """Whether A B = B A."""
    return _product(A, B) == _product(B, A)


def _root(square: Fraction) -> Fraction | None:
    """Return a > 0 with that square if it is a dyadic number."""
    if square <= 0:
        return None
    root = sp.sqrt(_rational(square))
    if not root.is_Rational or int(root.q) & (int(root.q) - 1):
        return None
    return Fraction(int(root.p), int(root.q))


def _product(A: Entries, B: Entries) -> dict[tuple[int, int], Fraction]:
    rows: dict[int, list[tuple[int, Fraction]]] = {}
    for (j, k), x in B.items():
        rows.setdefault(j, []).append((k, x))
    found: dict[tuple[int, int], Fraction] = {}
    for (i, j), x in A.items():
        for k, y in rows.get(j, ()):
            found[i, k] = found.get((i, k), Fraction(0)) + x * y
    return {place: x for place, x in found.items() if x}


def _image(parts: Sequence[tuple[sp.Expr, Entries]], x: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Return Σ n_i A_i x."""
    rows: list[list[sp.Expr]] = [[] for _ in x]
    for n, A in parts:
        for (i, j), e in sorted(A.items()):
            rows[i].append(n * _rational(e) * x[j])
    return [sp.Add(*terms) for terms in rows]


def _on_unit_axis(e: sp.Expr, axis: Sequence[sp.Expr]) -> sp.Expr:
    """Return an expression multiplied out where n·n = 1."""
    long = sp.expand(e)
    if len(axis) == 1:
        return long
    return sp.expand(long.subs(axis[-1] ** 2, 1 - sum(n**2 for n in axis[:-1])))


def _rational(x: Fraction) -> sp.Rational:
    return sp.Rational(x.numerator, x.denominator)
