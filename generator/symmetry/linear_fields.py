"""Linear vector fields X(q) = A q + a that are likely symmetries, with readable names.

The coordinates are divided into blocks, in their order: four coordinates of unit length by a
constraint are a quaternion; the others are points, three coordinates in space or two in the plane.
A wrong division is harmless: its fields are tested, and are no symmetries.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import cached_property

import numpy as np
import sympy as sp

from ...core.arrays import Floats
from ...core.records import dataclass
from ..multibody.rigid_body import left_matrix
from ..systems.system import System

__all__ = ["LinearField", "known_fields", "motions_of_space", "spins_of_bodies"]

_AXES = ("e1", "e2", "e3")


#: Nonzero entries of A and a by row and column; a is column n.
Weights = Mapping[tuple[int, int], Fraction]


@dataclass(frozen=True, eq=False)
class LinearField:
    """The vector field X(q) = A q + a on n coordinates, with exact entries."""

    name: str
    n: int
    weights: Weights

    @classmethod
    def linear_combination(
        cls, name: str, factors: Iterable[Fraction], fields: Iterable[LinearField], n: int
    ) -> LinearField:
        """Return Σ factor · field on n coordinates, with a factor for each field."""
        weights: dict[tuple[int, int], Fraction] = {}
        for factor, field in zip(factors, fields, strict=True):
            for entry, x in field.weights.items() if factor else ():
                weights[entry] = weights.get(entry, Fraction(0)) + factor * x
        return cls(name, n, {entry: x for entry, x in weights.items() if x})

    @cached_property
    def matrix(self) -> Floats:
        """(A, a), shape (n, n + 1)."""
        entries = np.zeros((self.n, self.n + 1))
        for index, x in self.weights.items():
            entries[index] = float(x)
        return entries

    @property
    def A(self) -> Floats:
        """A, shape (n, n)."""
        return self.matrix[:, : self.n]

    @property
    def a(self) -> Floats:
        """a, shape (n,)."""
        return self.matrix[:, self.n]

    def momentum(self, q: Sequence[sp.Expr], p: Sequence[sp.Expr]) -> sp.Expr:
        """Return the momentum J = pᵀ(A q + a), with exact numbers."""
        q_and_one = [*q, sp.Integer(1)]
        rows: dict[int, list[sp.Expr]] = {}
        for (i, j), x in sorted(self.weights.items()):
            rows.setdefault(i, []).append(sp.Rational(x.numerator, x.denominator) * q_and_one[j])
        return sp.Add(*(p[i] * sp.Add(*terms) for i, terms in rows.items()))


@dataclass(frozen=True)
class _Blocks:
    """Indices of quaternions and points among the coordinates."""

    quaternions: list[list[int]]
    points: list[list[int]]
    size: int  # 3 for space, 2 for the plane


def known_fields(system: System) -> list[LinearField]:
    """Return the candidates: momenta p_i, then the fields of each division into blocks.

    These are rigid motions of all blocks together, rotations of each body about its own axes, and
    rigid motions of each block.
    """
    n = system.n
    fields = [_shift(n, [[i]], k=0, name=f"momentum {p}") for i, p in enumerate(system.p)]

    for blocks in _block_layouts(system):
        fields += [*_motions(n, blocks), *_spins(system, blocks)]
        for block in blocks.points:
            for motion in _motions(n, _Blocks(quaternions=[], points=[block], size=blocks.size)):
                name = f"{motion.name} of ({_coordinates(system, block)})"
                fields.append(LinearField(name, n, motion.weights))
        for block in blocks.quaternions:
            for motion in _motions(n, _Blocks(quaternions=[block], points=[], size=blocks.size)):
                if motion.A.any():  # a quaternion alone has rotations, and no translations
                    name = f"{motion.name} of body ({_coordinates(system, block)})"
                    fields.append(LinearField(name, n, motion.weights))
    return fields


def spins_of_bodies(system: System) -> list[LinearField]:
    """Return the rotations of each body about its own axes 1, 2 and 3.

    The list is empty if the coordinates cannot be divided into bodies and points.
    """
    layouts = _block_layouts(system)
    return _spins(system, layouts[0]) if layouts else []


def _spins(system: System, blocks: _Blocks) -> list[LinearField]:
    """Return the rotations of the bodies of a division into blocks about their own axes."""
    fields = []
    for block in blocks.quaternions:
        axis = ("the body's axis" if len(blocks.quaternions) == 1 else
                f"the axis of body ({_coordinates(system, block)}),")
        fields += [_spin(system.n, block, k, f"angular momentum about {axis} {k + 1}")
                   for k in range(3)]
    return fields


def _coordinates(system: System, block: list[int]) -> str:
    """Return the names of the coordinates of a block."""
    return ", ".join(str(system.q[i]) for i in block)


def motions_of_space(system: System) -> list[LinearField]:
    """Return the rotations about e1, e2, e3 and the translations of the whole system.

    The list is empty if the coordinates cannot be divided into points of space or of the plane.
    """
    layouts = _block_layouts(system)
    return _motions(system.n, layouts[0]) if layouts else []


def _block_layouts(system: System) -> list[_Blocks]:
    """Return the divisions of the coordinates into blocks: in space, in the plane, or both."""
    quaternions = list(_unit_quaternions(system))
    quaternion_indices = {i for block in quaternions for i in block}
    # runs of consecutive indices between quaternions
    runs: list[list[int]] = []
    for i in range(system.n):
        if i in quaternion_indices:
            continue
        if runs and runs[-1][-1] == i - 1:
            runs[-1].append(i)
        else:
            runs.append([i])
    layouts = []
    for size in (3, 2):
        # quaternions turn in space: their points have three coordinates
        if quaternions and size == 2:
            continue
        if all(len(run) % size == 0 for run in runs):
            points = [run[i : i + size] for run in runs for i in range(0, len(run), size)]
            layouts.append(_Blocks(quaternions, points, size))
    return layouts


def _unit_quaternions(system: System) -> Iterator[list[int]]:
    """Yield the indices of four consecutive coordinates x with a constraint c (Σ x² − const).

    They are the quaternion of a body: bodies keep theirs in consecutive coordinates.
    """
    index_of = {symbol: i for i, symbol in enumerate(system.q)}
    for g in system.constraints:
        symbols = sorted(g.free_symbols & index_of.keys(), key=index_of.__getitem__)
        if len(symbols) != 4 or not g.is_polynomial(*symbols):
            continue
        leading_coefficient = sp.Poly(g, *symbols).LC()
        constant = sp.expand(g / leading_coefficient - sum(x**2 for x in symbols))
        indices = [index_of[x] for x in symbols]
        if not constant.has(*symbols) and indices == list(range(indices[0], indices[0] + 4)):
            yield indices


def _motions(n: int, blocks: _Blocks) -> list[LinearField]:
    """Return the rigid motions that move all blocks together: rotations, and shifts of points."""
    if blocks.size == 2:  # in the plane, about e3
        rotations = [_turn(n, blocks, k=2, name="angular momentum")]
    else:
        rotations = [_turn(n, blocks, k, f"angular momentum about {axis}")
                     for k, axis in enumerate(_AXES)]
    shifts = [_shift(n, blocks.points, k, f"linear momentum along {_AXES[k]}")
              for k in range(blocks.size)] if blocks.points else []
    return [*rotations, *shifts]


def _shift(n: int, points: Sequence[Sequence[int]], k: int, name: str) -> LinearField:
    """Return the translation along e_k: coordinate k of all points moves at the rate 1."""
    return LinearField(name, n, {(block[k], n): Fraction(1) for block in points})


def _turn(n: int, blocks: _Blocks, k: int, name: str) -> LinearField:
    """Return the rotation about e_k: e_k × x for points, ½ e_k q for quaternions."""
    weights: dict[tuple[int, int], Fraction] = {}
    i, j = (k + 1) % 3, (k + 2) % 3  # e_i × e_j = e_k
    for block in blocks.points:
        weights[block[j], block[i]] = Fraction(1)
        weights[block[i], block[j]] = Fraction(-1)
    for block in blocks.quaternions:
        weights |= _half_product(block, k, from_left=True)
    return LinearField(name, n, weights)


def _spin(n: int, block: Sequence[int], k: int, name: str) -> LinearField:
    """Return the rotation of a body about its own axis k: ½ q e_k."""
    return LinearField(name, n, _half_product(block, k, from_left=False))


def _half_product(
    block: Sequence[int], k: int, *, from_left: bool
) -> dict[tuple[int, int], Fraction]:
    """Return the matrix of x → ½ e_k x or x → ½ x e_k on a block of four coordinates.

    Row k of L(x) y is yᵀ(x e_k), so its derivative by x is the second; from the left the cross
    product of the vector parts changes its sign.
    """
    x = sp.symbols("x0:4")
    matrix = left_matrix(x).row(k).jacobian(x).tolist()
    weights: dict[tuple[int, int], Fraction] = {}
    for i, row in enumerate(matrix):
        for j, e in enumerate(row):
            if e:
                is_of_vectors = i > 0 and j > 0  # entry 0 of a quaternion is its scalar
                sign = -1 if from_left and is_of_vectors else 1
                weights[block[i], block[j]] = sign * Fraction(int(e), 2)
    return weights
