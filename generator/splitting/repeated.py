"""Many equal molecules: one body, one pair, and a number of copies.

A model of two equal molecules says everything about a thousand: each body moves by the flow of the
first, each pair i < j by the kick of the two. Nothing is derived per molecule or per pair, and the
kick of all is one loop over pairs with one kernel.

    H = Σ_i [T(q_i, p_i) + V₁(q_i, r_i)] + Σ_{i<j} V₂(q_i, r_i, q_j, r_j)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import sympy as sp

from ...core.arguments import shown, whole
from ...core.errors import InputError
from ..systems.body_layout import BodyLayout
from .parts import BodyFlow, KickInstance, KickTemplate, Splitting

__all__ = ["Molecules", "repeat"]


@dataclass(frozen=True)
class Molecules:
    """The splitting of so many equal molecules.

    Molecule i has the coordinates 7 i … 7 i + 6 of the state: its quaternion, then its position.

    Attributes
    ----------
    pair : Splitting
        Of two of the molecules.
    count : int
        Number of molecules.
    body : BodyFlow
        The rotation of each.
    inverse_mass : Expr
        1/m of each.
    single : tuple of KickTemplate
        Terms of V₁, with one slot and the three coordinates of its position.
    pairs : tuple of KickTemplate
        Terms of V₂, for each pair i < j.

    Notes
    -----
    All molecules have the parameters of the first body of the pair.
    """

    pair: Splitting
    count: int
    body: BodyFlow
    inverse_mass: sp.Expr
    single: tuple[KickTemplate, ...]
    pairs: tuple[KickTemplate, ...]

    @cached_property
    def constants(self) -> Mapping[sp.Symbol, sp.Symbol]:
        """Parameters of the second molecule, by which those of the first stand."""
        first, second = self.pair.system.bodies
        return _names(second, first)

    def instance(self, template: KickTemplate, i: int, j: int = 0) -> KickInstance:
        """Return the places of a template for the molecules i and j; of ``single`` for i alone."""
        one = template.instances[0]
        places = (i, j) if template in self.pairs else (i, i)
        parameters = self.pair.system.parameters
        return KickInstance(
            tuple(places[b] for b in one.bodies),
            tuple(7 * places[x // 7] + x % 7 for x in one.coordinates),
            tuple(parameters.index(self.constants.get(parameters[k], parameters[k]))
                  for k in one.constants))


def repeat(pair: Splitting, count: int) -> Molecules:
    """Return the splitting of many molecules from that of two.

    Parameters
    ----------
    pair : Splitting
        Of a system of two free bodies, each with a position, that are equal but for the names of
        their parameters; their potential is that of every pair, potentials of one body alone those
        of every molecule.
    count : int
        Number of molecules, 2 at least.

    Raises
    ------
    InputError
        If there are other bodies or points, other forces, or if the two differ.
    """
    if whole(count) is None or count < 2:
        raise InputError(f"count = {shown(count)} is no number of molecules; give 2 or more.")
    system = pair.system
    layouts = [body for body in system.bodies if body.x]
    if (len(pair.bodies) != 2 or len(layouts) != 2 or system.n != 14 or pair.space
            or any(e != 0 for N in pair.applied.torques for e in N) or any(pair.applied.forces)):
        raise InputError(
            f"System {system.name!r} is no pair of molecules: it has {len(pair.bodies)} bodies and "
            f"{system.n} coordinates; give two free bodies of 7 coordinates each, with potentials "
            "as their only forces.")
    first, second = pair.bodies
    same = _names(layouts[1], layouts[0])
    masses = [_mass(pair, [system.q.index(x) for x in body.x]) for body in layouts]
    if not (_shape(first, {}) == _shape(second, same)
            and masses[0] is not None and masses[1] is not None
            and masses[0] == masses[1].xreplace(same)):
        raise InputError(
            f"Bodies {first.name!r} and {second.name!r} of system {system.name!r} differ; give two "
            "equal bodies, whose parameters differ in their names only.")
    single = [t for t in pair.templates if len(t.bodies) + len(t.coordinates) // 3 < 3
              and all(len({*at.bodies} | {i // 7 for i in at.coordinates}) == 1
                      for at in t.instances)]
    pairs = [t for t in pair.templates if t not in single]
    if any(len(t.instances) != 2 for t in single):
        raise InputError(
            f"System {system.name!r} has a potential of one of its two molecules alone; write it "
            "for both, as it acts on every molecule.")
    return Molecules(pair, count, first, masses[0], tuple(single), tuple(pairs))


def _names(second: BodyLayout, first: BodyLayout) -> dict[sp.Symbol, sp.Symbol]:
    """Return the parameters of the first body by those of the second."""
    pairs = zip((*second.inertia, second.mass), (*first.inertia, first.mass), strict=True)
    return {x: y for x, y in pairs if isinstance(x, sp.Symbol) and isinstance(y, sp.Symbol)}


def _shape(body: BodyFlow, names: Mapping[sp.Symbol, sp.Symbol]) -> tuple[sp.Expr, ...]:
    """Return all expressions of a body, with other names."""
    axes = [(*axis.axis, axis.d, axis.c) for axis in (*body.axes, *body.further)]
    return tuple(e.xreplace(names) for e in (body.a, body.drag, *chain(*axes)))


def _mass(pair: Splitting, places: Sequence[int]) -> sp.Expr | None:
    """Return 1/m of a body; None if its kinetic energy is no |p|²/2m."""
    move = pair.translation
    assert move is not None
    found = {at: e for at, e in move.inverse_mass.items() if {*at} & {*places}}
    values = {*found.values()}
    plain = {*found} == {(i, i) for i in places} and not move.velocity and not move.drag
    return values.pop() if plain and len(values) == 1 else None
