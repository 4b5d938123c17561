"""Many equal molecules with a potential between every two: one molecule stands for all.

    H = Σ_i H₁(q_i, p_i) + Σ_{i<j} V(v_i, v_j),      v: points x + R(q) r, vectors R(q) r

H and the constraints of a ``MolecularSystem`` are those of one molecule, and V that of one pair, so
that nothing is derived a molecule or a pair. The state has a row of 7 numbers for each molecule,
its quaternion and its position, one after another.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import sympy as sp

from ...core.errors import InputError
from ..symbolic.derivatives import slopes
from ..symbolic.shared_subexpressions import Shared, parts_of, share
from .body_layout import BodyLayout
from .system import System

__all__ = ["MolecularSystem", "PairPotential", "SpaceVector"]

#: Digits of the test that V(v_i, v_j) = V(v_j, v_i).
_DIGITS = 40


@dataclass(frozen=True)
class SpaceVector:
    """A vector in space that a molecule carries, x + R(q) r or R(q) r.

    Attributes
    ----------
    r : tuple of 3 Expr
        In body axes.
    is_point : bool
        Whether it begins at the origin of space, as positions do.
    first, second : tuple of 3 Symbol
        Its components in V, of the one molecule and of the other.
    """

    r: tuple[sp.Expr, ...]
    is_point: bool
    first: tuple[sp.Symbol, ...]
    second: tuple[sp.Symbol, ...]


@dataclass(frozen=True)
class PairPotential:
    """The potential of two molecules, in components of vectors that they carry.

    Attributes
    ----------
    V : Expr
    vectors : tuple of SpaceVector
    """

    V: sp.Expr
    vectors: tuple[SpaceVector, ...]

    @property
    def first(self) -> list[sp.Symbol]:
        """The components of the vectors of the one molecule."""
        return [x for vector in self.vectors for x in vector.first]

    @property
    def second(self) -> list[sp.Symbol]:
        """Those of the other."""
        return [x for vector in self.vectors for x in vector.second]

    @cached_property
    def forces(self) -> list[sp.Expr]:
        """−∂V by the components of the one molecule, then of the other: in reverse mode.

        Of each distance there are one root and one quotient: its powers are those of 1/√(r²).
        """
        found = slopes(_shared_bases(self.V), (*self.first, *self.second))
        return _one_root([-e for e in found])

    def refuse_asymmetric(self, name: str) -> None:
        """Refuse a V that depends on which of two molecules is the first."""
        swapped = self.V.xreplace(dict(zip([*self.first, *self.second],
                                           [*self.second, *self.first], strict=True)))
        values = {x: sp.Float(sp.Rational(101 * n * n % 89, 7), _DIGITS) for n, x in enumerate(
            sorted(self.V.free_symbols | swapped.free_symbols, key=str), 1)}
        one, other = (sp.N(e.xreplace(values), _DIGITS) for e in (self.V, swapped))
        if abs(one - other) > abs(one) * sp.Float(10) ** (-_DIGITS // 2):
            raise InputError(f"The pair potential of {name!r} changes when its two molecules are "
                             "swapped; write it so that it treats both alike.")


@dataclass(frozen=True, repr=False)
class MolecularSystem(System):
    """So many equal molecules; H, g and the coordinates are those of one.

    Parameters
    ----------
    pair : PairPotential
    copies : int
        Number of molecules.
    """

    pair: PairPotential = field(default=PairPotential(sp.S.Zero, ()), kw_only=True)
    copies: int = field(default=1, kw_only=True)

    def __repr__(self) -> str:
        return f"<MolecularSystem {self.name}: {self.copies} molecules>"

    @property
    def layout(self) -> BodyLayout:
        """The layout of the molecule."""
        return self.bodies[0]

    @property
    def energy_text(self) -> str:
        """H as text, of which each term stands for many."""
        pairs = self.copies * (self.copies - 1) // 2
        return f"{self.copies} x [{self.H}] + {pairs} x [{self.pair.V}]"

    def of_all(self, texts: Iterable[str]) -> list[str]:
        """Return texts of one molecule as those of all, in turn: x of molecule 17 is x_17."""
        names = "|".join(map(str, (*self.q, *self.p, self.layout.name)))
        own = [re.sub(rf"\b({names})\b", r"\1_#", text) for text in texts]
        return [text.replace("#", str(i)) for i in range(self.copies) for text in own]


def _shared_bases(e: sp.Expr) -> sp.Expr:
    """Return an expression in which each base of a power is shared."""
    known: dict[sp.Basic, sp.Basic] = {}
    for part in parts_of([e]):
        made = part.func(*(known[a] for a in part.args)) if part.args else part
        if isinstance(made, sp.Pow) and made.exp.is_number:
            made = share(made.base) ** made.exp
        known[part] = made
    return known[e]


def _one_root(expressions: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Return the expressions with all powers of a base under a root as those of one quotient."""
    parts = list(parts_of(expressions))
    powers = [e for e in parts if isinstance(e, sp.Pow) and e.exp.is_Rational and e.exp < 0]
    roots = {e.base for e in powers if e.exp.q == 2}
    known: dict[sp.Basic, sp.Basic] = {}
    for e in parts:
        if e in powers and e.base in roots:
            known[e] = Shared(known[e.base] ** sp.Rational(-1, 2)) ** (-2 * e.exp)
        else:
            known[e] = e.func(*(known[a] for a in e.args)) if e.args else e
    return [known[e] for e in expressions]
