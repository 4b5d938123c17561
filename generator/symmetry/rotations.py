"""Linear fields X(q) = A q whose flow is a rotation, in closed form.

Where A³ = −a² A on a block of coordinates,

    e^{θA} = 1 + sin(aθ) A/a + (1 − cos(aθ)) A²/a²,

so that one sine and one cosine rotate all blocks of one a: a = 1 of points, a = ½ of quaternions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction

import sympy as sp

from ...core.records import dataclass
from ..systems.elimination_order import connected_components

__all__ = ["Rotation", "commute", "rotate_coordinates", "rotation_of"]

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
        """−Aᵀ, the rotation of the momenta if A is the rotation of the coordinates."""
        return Rotation({a: {(j, i): -e for (i, j), e in A.items()}
                         for a, A in self.blocks.items()})


def rotate_coordinates(
    x: Sequence[sp.Expr], rotations: Sequence[Rotation], axis: Sequence[sp.Expr],
    cosines: Mapping[Fraction, sp.Expr], sines: Mapping[Fraction, sp.Expr],
) -> list[sp.Expr]:
    """Return e^{θA} x with A = Σ n_i A_i, from cos(aθ) and sin(aθ) of each a.

    ``axis`` is n: [1] for one rotation, or a unit vector for the rotations about e1, e2, e3.
    """
    rotated = list(x)
    for a in sorted({a for rotation in rotations for a in rotation.blocks}):
        # B = A/a, for which B³ = −B: e^{θA} = 1 + sin(aθ) B + (1 − cos(aθ)) B²
        generators = [(n, {entry: e / a for entry, e in rotation.blocks.get(a, {}).items()})
                      for n, rotation in zip(axis, rotations, strict=True)]
        Bx = _image(generators, x)
        BBx = _image(generators, Bx)
        for i, (e, square) in enumerate(zip(Bx, BBx, strict=True)):
            if e == 0 and square == 0:
                continue
            # where B² x = −x, x is perpendicular to the axis, and cos(aθ) x is shorter
            is_perpendicular = _on_unit_axis(square + x[i], axis) == 0
            even_part = cosines[a] * x[i] if is_perpendicular else x[i] + (1 - cosines[a]) * square
            rotated[i] = even_part + sines[a] * e
    return rotated


def rotation_of(A: Entries) -> Rotation | None:
    """Return a matrix as a rotation; None if it is none, or if a rate a is no dyadic number."""
    blocks: dict[Fraction, dict[tuple[int, int], Fraction]] = {}
    nonzero = {entry: x for entry, x in A.items() if x}
    for indices in connected_components([frozenset(entry) for entry in nonzero]):
        block = {(i, j): x for (i, j), x in nonzero.items() if i in indices}
        # A³ = −a² A: one entry gives a², the others must agree
        cube = _product(block, _product(block, block))
        entry, x = next(iter(block.items()))
        square = -cube.get(entry, Fraction(0)) / x
        a = _root(square)
        if a is None or cube != {entry: -square * x for entry, x in block.items()}:
            return None
        blocks.setdefault(a, {}).update(block)
    return Rotation(blocks) if blocks else None


def commute(A: Entries, B: Entries) -> bool:
    """Whether A B = B A."""
    return _product(A, B) == _product(B, A)


def _root(square: Fraction) -> Fraction | None:
    """Return a = √square if a > 0 is a dyadic number, which is exact in binary; else None."""
    if square <= 0:
        return None
    root = sp.sqrt(_rational(square))
    if not root.is_Rational or int(root.q) & (int(root.q) - 1):
        return None
    return Fraction(int(root.p), int(root.q))


def _product(A: Entries, B: Entries) -> dict[tuple[int, int], Fraction]:
    """Return the product of two sparse matrices of fractions."""
    rows: dict[int, list[tuple[int, Fraction]]] = {}
    for (j, k), x in B.items():
        rows.setdefault(j, []).append((k, x))
    product: dict[tuple[int, int], Fraction] = {}
    for (i, j), x in A.items():
        for k, y in rows.get(j, ()):
            product[i, k] = product.get((i, k), Fraction(0)) + x * y
    return {entry: x for entry, x in product.items() if x}


def _image(parts: Sequence[tuple[sp.Expr, Entries]], x: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Return Σ n_i A_i x."""
    rows: list[list[sp.Expr]] = [[] for _ in x]
    for n, A in parts:
        for (i, j), e in sorted(A.items()):
            rows[i].append(n * _rational(e) * x[j])
    return [sp.Add(*terms) for terms in rows]


def _on_unit_axis(e: sp.Expr, axis: Sequence[sp.Expr]) -> sp.Expr:
    """Return an expression expanded modulo n·n = 1."""
    expanded = sp.expand(e)
    if len(axis) == 1:
        return expanded
    return sp.expand(expanded.subs(axis[-1] ** 2, 1 - sum(n**2 for n in axis[:-1])))


def _rational(x: Fraction) -> sp.Rational:
    """Return a fraction as an expression."""
    return sp.Rational(x.numerator, x.denominator)
