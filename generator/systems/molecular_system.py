"""Many equal molecules with a potential between every two: one molecule stands for all.

    H = Σ_i H₁(q_i, p_i) + Σ_{i<j} V(v_i, v_j),      v: points x + R(q) r, vectors R(q) r

H and the constraints of a ``MolecularSystem`` are those of one molecule, and V that of one pair, so
that nothing is derived a molecule or a pair. The state has a row of 7 numbers for each molecule,
its quaternion and its position, one after another.
"""

from __future__ import annotations

import random
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import sympy as sp

from ...core.errors import InputError
from ..symbolic.derivatives import slopes
from ..symbolic.shared_subexpressions import Shared, parts_of, share
from ..symbolic.switching_functions import Max, Min, sides
from .body_layout import BodyLayout
from .system import System

__all__ = ["MolecularSystem", "PairPotential", "SpaceVector"]

#: Digits of the test that V(v_i, v_j) = V(v_j, v_i).
_DIGITS = 40
#: Sizes of the vectors in it.
_SCALES = (sp.Rational(1, 16), sp.Integer(1), sp.Integer(16))


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
        """Refuse a V that depends on which of two molecules is the first.

        It is compared in points at several distances, relative to the size of its terms; on both
        sides of each switch, so that a cut-off hides nothing.
        """
        swap = dict(zip([*self.first, *self.second], [*self.second, *self.first], strict=True))
        if self.V.xreplace(swap) == self.V:
            return
        V, rng = _smooth(self.V), random.Random(1)
        symbols = sorted(self.V.free_symbols | {*self.first, *self.second}, key=str)
        for scale in _SCALES:
            numbers = rng.sample(range(1, 10**6), len(symbols))  # no two alike
            values = {x: sp.Float(sp.Rational(n, 10**6), _DIGITS) for x, n in
                      zip(symbols, numbers, strict=True)}
            values |= {x: rng.choice((-scale, scale)) * values[x] for x in swap}
            swapped = values | {x: values[y] for x, y in swap.items()}
            one, other = ([sp.N(e.xreplace(at), _DIGITS) for e in sp.Add.make_args(V)]
                          for at in (values, swapped))
            size = sum(abs(e) for e in one)
            if abs(sp.N(sum(one) - sum(other))) > size * sp.Float(10) ** (-_DIGITS // 2):
                raise InputError(f"The pair potential of {name!r} changes when its two molecules "
                                 "are swapped; write it so that it treats both alike.")


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


def _smooth(e: sp.Expr) -> sp.Expr:
    """Return an expression without switches, in which both sides of each of them count.

    θ(w) = 1/2 + w/(1 + w²) is the weight of the side w > 0, a + b + ab in place of max(a, b). As
    θ(−w) = 1 − θ(w), and both orders of three arguments agree, a symmetric e remains symmetric.
    """
    known: dict[sp.Basic, sp.Basic] = {}
    for part in parts_of([e]):
        made = part.func(*(known[a] for a in part.args)) if part.args else part
        if isinstance(made, (Max, Min)):
            a, b = made.args
            made = a + b + (a * b if isinstance(made, Max) else -a * b)
        elif told := sides(made):
            w, below, above = told
            weight = sp.S.Half + w / (1 + w**2)
            made = weight * above + (1 - weight) * below
        known[part] = made
    return known[e]


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
