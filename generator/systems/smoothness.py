"""How smooth a system is where its expressions switch sides: seen at random points of w = 0.

A constraint must have a tangent everywhere. A force may jump, but then a step that would end
there may have no solution; what H jumps by is lost, for its force there is an impulse that no step
sees. And a method has its order between such places.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property, partial
from itertools import count
from typing import Any

import sympy as sp

from ...core.errors import InputError
from ..parsing.tokens import shorten
from ..symbolic.derivatives import derivative
from ..symbolic.numeric_evaluation import Evaluator, mp_context
from ..symbolic.switching_functions import on_side, switches_of
from .system import System

__all__ = ["Meeting", "Switching", "meeting", "on_any_side", "refuse_kinks"]

_DIGITS = 50
_POINTS, _TRIES = 3, 20
#: Most switching places that are tried: a system of many bodies repeats them.
_MOST_PLACES = 20


class Meeting(IntEnum):
    """How two sides of an expression meet."""

    JUMP = 0
    KINK = 1
    SMOOTH = 2  # with a continuous derivative, at least


def refuse_kinks(system: System) -> None:
    """Refuse constraints with a kink or a jump, and velocity constraints with a jump.

    Raises InputError with the constraint and the place.
    """
    for name, row in zip(system.velocity_constraint_names, system.velocity_constraints,
                         strict=True):
        for w in switches_of([row]):
            if not w.free_symbols.isdisjoint(system.q) and (
                    meeting(row, w, [*system.q, *system.velocities]) is Meeting.JUMP):
                raise InputError(
                    f"The velocity constraint {name!r} of {system.name!r} jumps where "
                    f"{_place(w)}: velocities would jump, too. Write it continuously.")
    for name, g in zip(system.constraint_names, system.constraints, strict=True):
        for w in switches_of([g]):
            if w.free_symbols.isdisjoint(system.q):
                continue
            kind = meeting(g, w, system.q)
            if kind < Meeting.SMOOTH:
                verb = "jumps" if kind is Meeting.JUMP else "has a kink"
                raise InputError(
                    f"The constraint {name!r} of {system.name!r} {verb} where {_place(w)}: it has "
                    "no tangent there, and no multiplier. Write it with a continuous derivative, "
                    "or as a stiff force.")


def meeting(e: sp.Expr, w: sp.Expr, symbols: Sequence[sp.Symbol]) -> Meeting:
    """Return how e, as a function of the symbols, passes through w = 0; seen at random points."""
    if any(isinstance(node, sp.floor) and node.args[0] == w for node in sp.preorder_traversal(e)):
        return Meeting.JUMP
    terms = [t for t in sp.Add.make_args(e) if not {w, -w}.isdisjoint(switches_of([t]))]
    e = sp.Add(*terms)
    both = [on_side(e, partial(_weight, w=w, above=above)) for above in (0, 1)]
    moving = [x for x in symbols if x in w.free_symbols]
    worst = Meeting.SMOOTH
    for walk in _points_on(w, moving, e.free_symbols | w.free_symbols):
        if not _same(walk, *both):
            return Meeting.JUMP
        if not all(_same(walk, *(derivative(side, x) for side in both)) for x in symbols):
            worst = Meeting.KINK
    return worst


def _weight(expression: sp.Expr, w: sp.Expr, above: int) -> sp.Expr | None:
    if expression == w:
        return sp.Integer(above)
    return sp.Integer(1 - above) if -expression == w else None


def _same(walk: Evaluator, below: sp.Expr, above: sp.Expr) -> bool:
    try:
        a, b = walk(below), walk(above)
        return bool(abs(a - b) <= 10.0 ** (-_DIGITS // 2) * max(1, abs(a), abs(b)))
    except (ArithmeticError, ValueError):
        return False  # an infinite slope


def _points_on(
    w: sp.Expr, moving: Sequence[sp.Symbol], symbols: set[sp.Symbol]
) -> Iterator[Evaluator]:
    """Yield random points where w = 0, found by moving one of the symbols."""
    context, draw, count = mp_context(_DIGITS), random.Random(3), 0
    for attempt in range(_TRIES):
        x = moving[attempt % len(moving)]
        point = {s: context.mpf(draw.uniform(0.25, 1) if s.is_positive else draw.uniform(-1, 1))
                 for s in sorted(symbols, key=str)}

        def value(coordinate: Any, x: sp.Symbol = x, point: dict[sp.Symbol, Any] = point) -> Any:
            return Evaluator(point | {x: coordinate}, mp=context)(w)

        try:
            root = context.findroot(value, (point[x], point[x] + context.mpf(0.125)))
        except (ArithmeticError, ValueError, InputError):
            continue
        if not isinstance(root, context.mpf):
            continue
        yield Evaluator(point | {x: root}, mp=context)
        count += 1
        if count == _POINTS:
            return


def _place(w: sp.Expr) -> str:
    w = -w if w.could_extract_minus_sign() else w
    return f"{shorten(str(w), 60)} = 0"


@dataclass(frozen=True)
class Switching:
    """Where H and the forces of a system switch."""

    system: System

    @cached_property
    def _moving(self) -> set[sp.Symbol]:
        time = set() if self.system.time is None else {self.system.time}
        return {*self.system.q, *self.system.p} | time

    @cached_property
    def places(self) -> list[sp.Expr]:
        """Every w of H and of the forces."""
        return [w for w in switches_of([self.system.H, *self.system.forces])
                if not w.free_symbols.isdisjoint(self._moving)]

    @cached_property
    def _of_H(self) -> dict[sp.Expr, Meeting]:
        symbols = [*self.system.q, *self.system.p]
        switches = switches_of([self.system.H])
        return {w: meeting(self.system.H, w, symbols) for w in self.places[:_MOST_PLACES]
                if not {w, -w}.isdisjoint(switches)}

    @cached_property
    def jumps_of_H(self) -> list[sp.Expr]:
        """Where H is not continuous."""
        return [w for w, kind in self._of_H.items() if kind is Meeting.JUMP]

    def jumps_of_forces(self, *, discrete: bool) -> list[sp.Expr]:
        """Where −H_q + F or H_p is discontinuous in q or p; a discrete gradient is continuous."""
        symbols = [*self.system.q, *self.system.p]
        jumps = []
        for w in self.places[:_MOST_PLACES]:
            forces = [f for f in self.system.forces if not {w, -w}.isdisjoint(switches_of([f]))]
            kink = not discrete and self._of_H.get(w) is Meeting.KINK
            if not w.free_symbols.isdisjoint(symbols) and (
                    kink or any(meeting(f, w, symbols) is Meeting.JUMP for f in forces)):
                jumps.append(w)
        return jumps

    @property
    def named(self) -> str:
        """The places, as text."""
        return _listed(self.places)

    def named_jumps(self, *, discrete: bool) -> str:
        """The jumps of forces, as text."""
        return _listed(self.jumps_of_forces(discrete=discrete))

    def said(self, order: int, *, discrete: bool) -> dict[str, Any]:
        """Return the facts about a method of some order on the system, {} if there are none.

        ``remarks``: list of str; ``jumps``: where forces jump, for the message of a failed step.
        """
        if not self.places:
            return {}
        remarks = [f"order {order} holds for steps that do not cross {self.named}"]
        if self.jumps_of_H:
            remarks.append(f"H jumps at {_listed(self.jumps_of_H)}: no step feels a force there")
        jumps = self.named_jumps(discrete=discrete)
        if not jumps:
            return {"remarks": remarks}
        remarks.append(f"forces jump at {jumps}: a step to there may have no solution")
        return {"remarks": remarks, "jumps": jumps}


def on_any_side(system: System) -> tuple[System, list[sp.Symbol]]:
    """Return a system whose H and forces are sums of all their sides, and the weights in them.

    What holds of it for any weights holds of the system on each of its sides. Raises InputError if
    a constraint switches sides: there is no manifold for any weights.
    """
    if places := switches_of(system.constraints):
        raise InputError(f"A constraint of {system.name!r} switches at {_listed(places)}; what "
                         "turns with both of its sides is not searched for.")
    symbols: dict[sp.Expr, sp.Symbol] = {}
    reserved = {str(s) for s in (*system.q, *system.p, *system.parameters, system.time)}
    names = (name for i in count() if (name := f"side{i}") not in reserved)

    def side(w: sp.Expr) -> sp.Expr:
        if -w in symbols:
            return 1 - symbols[-w]
        if w not in symbols:
            symbols[w] = sp.Symbol(next(names), real=True)
        return symbols[w]

    H, *forces = (on_side(e, side) for e in (system.H, *system.forces))
    weights = list(symbols.values())
    if not weights:
        return system, []
    return replace(system, H=H, forces=tuple(forces), quantities={},
                   parameters=(*system.parameters, *weights)), weights


def _listed(places: Sequence[sp.Expr]) -> str:
    suffix = f" and {len(places) - 3} more such places" if len(places) > 3 else ""
    return ", ".join(map(_place, places[:3])) + suffix
