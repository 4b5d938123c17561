"""Compositions of a drift and a kick in one normal form, and the stored compositions.

    Ψ(h) = T(a₀h) K(b₁h, c₁h³) T(a₁h) ⋯ K(b_s h, c_s h³) T(a_s h)

T(τ) is the exact flow of the kinetic part T(q, p) for the time τ. K(β, γ) is the exact flow, for
the time 1, of the potential β V(q) − γ G(q) with the force-gradient term

    G(q) = −{V, {T, V}} = V_qᵀ T_pp V_q   (τᵀ S τ for a body with torque τ and S = J⁻¹), G ≥ 0,

so p ← p − b_i h V_q + c_i h³ G_q in canonical momenta; c_i = −κ_i b_i in the notation V + κh²G.
As operators A = {·, T} and B = {·, V} this kick is exp(b_i h B + c_i h³ [B, [A, B]]): the double
commutator is the Lie derivative of {{V, T}, V} = −G. The sequence is a palindrome, so the order in
which operators and maps are written does not matter.

The numbers are rational: decimals of 60 digits, with Σa_i = Σb_i = 1 exactly. They approximate
algebraic numbers; ``certificates.composition_proofs`` proves that these exist, and bounds the
distance. ``studies.composition_search`` writes ``compositions.json``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import field
from fractions import Fraction
from pathlib import Path
from typing import Any

from ...core.arguments import as_integer, choose, shown
from ...core.errors import InputError
from ...core.records import dataclass

__all__ = ["COMPOSITIONS", "PATH", "Composition", "composition", "composition_named", "palindrome"]

PATH = Path(__file__).resolve().parent / "compositions.json"


@dataclass(frozen=True)
class Composition:
    """A symmetric composition of drifts and kicks, in the normal form of this module.

    Attributes
    ----------
    name : str
        Key in ``COMPOSITIONS``.
    order : int
        Order of a step for any T and V; even.
    drifts : tuple of Fraction, s + 1
        Times a_i of the drifts in units of h.
    kicks : tuple of Fraction, s
        Times b_i of the kicks in units of h.
    gradients : tuple of Fraction, s
        Factors c_i of h³[V,[T,V]]; zeros without force gradients.
    weights : tuple of Fraction
        w_i of a step S(w₁h) S(w₂h) ⋯ with a symmetric map S; else empty.
    base : str
        The map S, ``"Strang"`` or ``"G4"``; empty without weights.
    orders : tuple of int
        Order in the terms with one kick, with two, and so on, the last for all further ones:
        (10, 6, 4) for kicks that are small beside drifts; (order,) for others.
    also : tuple of str
        Lyndon words whose conditions hold in addition to the conditions of the orders.
    free : tuple of int
        Unknowns that the conditions leave free: their decimals are exact.
    source : str
        Publication of a composition of this form, or of nearly these numbers.
    found : str
        Origin of the numbers: a closed form, or a search with its seed.
    """

    name: str
    order: int
    drifts: tuple[Fraction, ...] = field(repr=False)
    kicks: tuple[Fraction, ...] = field(repr=False)
    gradients: tuple[Fraction, ...] = field(repr=False)
    weights: tuple[Fraction, ...] = field(default=(), repr=False)
    base: str = ""
    orders: tuple[int, ...] = ()
    also: tuple[str, ...] = ()
    free: tuple[int, ...] = ()
    source: str = ""
    found: str = field(default="", repr=False)

    @property
    def stages(self) -> int:
        """The number s of kicks a step, and of drifts, as a run joins the drifts of two steps."""
        return len(self.kicks)

    @property
    def has_gradients(self) -> bool:
        """Whether a kick needs the force gradient."""
        return any(self.gradients)

    @property
    def forward(self) -> bool:
        """Whether no time is negative."""
        return min(self.drifts + self.kicks) >= 0


def palindrome(first: Sequence[Fraction], size: int) -> tuple[Fraction, ...]:
    """Return a palindrome with ``size`` entries and the sum 1.

    ``first`` is the first half without the entry next to or at the middle, which the sum gives.
    """
    middle = 1 - 2 * sum(first, Fraction(0))
    if size % 2:
        return (*first, middle, *reversed(first))
    return (*first, middle / 2, middle / 2, *reversed(first))


def _load_compositions() -> dict[str, Composition]:
    """Return the compositions of the file, in which a base precedes its compositions."""
    compositions: dict[str, Composition] = {}
    for name, record in json.loads(PATH.read_text(encoding="utf-8")).items():
        compositions[name] = _from_record(name, record, compositions)
    return compositions


def _from_record(name: str, record: dict[str, Any], bases: dict[str, Composition]) -> Composition:
    """Return a composition from its record, which has one half of palindromic coefficients.

    A record with ``base`` has the weights w_i of a composition of steps of another one,
    Ψ(w₁ h) ⋯ Ψ(w_k h), from which drifts and kicks are computed; ``bases`` has this one.
    """
    stages = record["stages"]
    halves = {key: [Fraction(text) for text in record.get(key, ())]
              for key in ("weights", "drifts", "kicks", "gradients")}
    base = record.get("base", "")
    weights: tuple[Fraction, ...] = ()
    if base:
        weights = palindrome(halves["weights"], stages)
        drifts, kicks, gradients = flatten(bases[base], weights)
    else:
        drifts = palindrome(halves["drifts"], stages + 1)
        kicks = palindrome(halves["kicks"], stages)
        # the sum of gradients is not known: their half contains the middle one
        half = halves["gradients"] or [Fraction(0)] * ((stages + 1) // 2)
        gradients = (*half, *reversed(half[: stages // 2]))
    return Composition(
        name=name, order=record["order"], drifts=drifts, kicks=kicks, gradients=gradients,
        weights=weights, base=base, orders=tuple(record.get("orders", [record["order"]])),
        also=tuple(record.get("also", ())), free=tuple(record.get("free", ())),
        source=record["source"], found=record["found"])


def flatten(base: Composition, weights: Sequence[Fraction]) -> tuple[tuple[Fraction, ...], ...]:
    """Return drifts, kicks and gradients of S(w₁h) S(w₂h) ⋯, with adjacent drifts added.

    Gradients have the factor h³, so that a step of w h has w³ of them.
    """
    drifts, kicks, gradients = list[Fraction](), list[Fraction](), list[Fraction]()
    for w in weights:
        first, *inner = [w * a for a in base.drifts]
        if drifts:  # the last drift of a step and the first of the next one are one flow
            drifts[-1] += first
        else:
            drifts.append(first)
        drifts += inner
        kicks += [w * b for b in base.kicks]
        gradients += [w**3 * c for c in base.gradients]
    return tuple(drifts), tuple(kicks), tuple(gradients)


#: All stored compositions by name.
COMPOSITIONS: dict[str, Composition] = _load_compositions()
#: Default composition of each order, without and with force gradients. At order 10 they are equal:
#: no composition with a base with force gradients is known.
_CHOICE = {False: {2: "Strang", 4: "BM4", 6: "KL6", 8: "KL8", 10: "SS10"},
           True: {2: "Strang", 4: "G4", 6: "G6", 8: "G8", 10: "SS10"}}


def composition(order: int, gradients: bool = False) -> Composition:
    """Return the composition for an order.

    Parameters
    ----------
    order : {2, 4, 6, 8, 10}
    gradients : bool
        Whether kicks may have a force-gradient term. At order 10 the composition is the same, and
        has none.

    Raises
    ------
    InputError
        For any other order.
    """
    name = _CHOICE[bool(gradients)].get(as_integer(order) or 0)
    if name is None:
        raise InputError(f"order = {shown(order)} is not the order of a composition; symmetric "
                         "ones have even orders: choose 2, 4, 6, 8 or 10.")
    return COMPOSITIONS[name]


def composition_named(name: str) -> Composition:
    """Return a composition by its name.

    Raises InputError for an unknown name; names the allowed ones.
    """
    return COMPOSITIONS[choose("composition", name, COMPOSITIONS)]
