"""How smooth a system is where its expressions switch sides: examined at random points of w = 0.

A constraint must have a tangent everywhere. A force may jump, but then a step that would end
there may have no solution. Where H jumps its force is an impulse, which no step contains, so that
the energy of the jump is lost. A method has its order between such places only.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from dataclasses import replace
from enum import IntEnum
from functools import cached_property, partial
from itertools import count
from typing import Any

import sympy as sp

from ...core.errors import InputError
from ...core.records import dataclass
from ..parsing.tokens import shorten
from ..symbolic.derivatives import derivative
from ..symbolic.numeric_evaluation import Evaluator, mp_context
from ..symbolic.switching_functions import on_side, switches_of
from .system import System

__all__ = ["Continuity", "Switching", "continuity", "on_any_side", "refuse_kinks"]

#: Half of the digits may cancel where two sides of a switch are compared.
_DIGITS = 50
_POINTS, _TRIES = 3, 20
#: Most switching functions that are examined: a system of many bodies repeats them.
_MOST_SWITCHES = 20


class Continuity(IntEnum):
    """Continuity of an expression where it switches from one side to the other."""

    JUMP = 0
    KINK = 1
    SMOOTH = 2  # with a continuous derivative, at least


def refuse_kinks(system: System) -> None:
    """Refuse constraints with a kink or a jump, and velocity constraints with a jump.

    Raises InputError with the constraint and the equation w = 0 of the place.
    """
    # a kink of A v + a is allowed: velocities stay continuous across it
    for name, row in zip(system.velocity_constraint_names, system.velocity_constraints,
                         strict=True):
        for w in switches_of([row]):
            if not w.free_symbols.isdisjoint(system.q) and (
                    continuity(row, w, [*system.q, *system.velocities]) is Continuity.JUMP):
                raise InputError(
                    f"The velocity constraint {name!r} of {system.name!r} jumps where "
                    f"{_place(w)}: velocities would jump, too. Write it continuously.")
    for name, g in zip(system.constraint_names, system.constraints, strict=True):
        for w in switches_of([g]):
            if w.free_symbols.isdisjoint(system.q):
                continue
            kind = continuity(g, w, system.q)
            if kind < Continuity.SMOOTH:
                verb = "jumps" if kind is Continuity.JUMP else "has a kink"
                raise InputError(
                    f"The constraint {name!r} of {system.name!r} {verb} where {_place(w)}: it has "
                    "no tangent there, and no multiplier. Write it with a continuous derivative, "
                    "or as a stiff force.")


def continuity(e: sp.Expr, w: sp.Expr, symbols: Sequence[sp.Symbol]) -> Continuity:
    """Return the continuity of e, as a function of the symbols, at w = 0.

    Both sides and their first derivatives are compared at random points of w = 0, in 50 digits: a
    jump or a kink may be missed, but no difference is round-off.
    """
    if any(isinstance(node, sp.floor) and node.args[0] == w for node in sp.preorder_traversal(e)):
        return Continuity.JUMP
    # terms without this switch are the same on both sides
    terms = [t for t in sp.Add.make_args(e) if not {w, -w}.isdisjoint(switches_of([t]))]
    part = sp.Add(*terms)
    # where w < 0, and where w > 0
    sides = [on_side(part, partial(_weight_of_side, w=w, above=above)) for above in (0, 1)]
    variables = [x for x in symbols if x in w.free_symbols]
    observed = Continuity.SMOOTH
    for evaluator in _points_on(w, variables, part.free_symbols | w.free_symbols):
        if not _are_equal(evaluator, *sides):
            return Continuity.JUMP
        if not all(_are_equal(evaluator, *(derivative(side, x) for side in sides))
                   for x in symbols):
            observed = Continuity.KINK
    return observed


def _weight_of_side(expression: sp.Expr, w: sp.Expr, above: int) -> sp.Expr | None:
    """Return 1 if the switch of ``expression`` is on its side ``expression`` > 0, and 0 if not.

    That is decided for w and −w by ``above``, which is 1 where w > 0 and 0 where w < 0. None for
    other switching functions, which stay as they are.
    """
    if expression == w:
        return sp.Integer(above)
    return sp.Integer(1 - above) if -expression == w else None


def _are_equal(evaluator: Evaluator, below: sp.Expr, above: sp.Expr) -> bool:
    """Whether the values of both sides agree to half of the digits; not if one is infinite."""
    try:
        a, b = evaluator(below), evaluator(above)
        return bool(abs(a - b) <= 10.0 ** (-_DIGITS // 2) * max(1, abs(a), abs(b)))
    except (ArithmeticError, ValueError):
        return False  # an infinite slope


def _points_on(
    w: sp.Expr, moving: Sequence[sp.Symbol], symbols: set[sp.Symbol]
) -> Iterator[Evaluator]:
    """Yield evaluators at three random points of w = 0, at fewer if roots are not reached.

    All ``symbols`` are random, then one of ``moving`` is set to a root of w by the secant method.
    """
    context, rng, root_count = mp_context(_DIGITS), random.Random(3), 0
    for attempt in range(_TRIES):
        # along another symbol in each attempt: w may have no root along one of them
        x = moving[attempt % len(moving)]
        point = {s: context.mpf(rng.uniform(0.25, 1) if s.is_positive else rng.uniform(-1, 1))
                 for s in sorted(symbols, key=str)}

        def value(coordinate: Any, x: sp.Symbol = x, point: dict[sp.Symbol, Any] = point) -> Any:
            """Return w at the point with x = ``coordinate``."""
            return Evaluator(point | {x: coordinate}, mp=context)(w)

        try:
            root = context.findroot(value, (point[x], point[x] + context.mpf(0.125)))
        except (ArithmeticError, ValueError, InputError):
            continue
        # a complex root
        if not isinstance(root, context.mpf):
            continue
        yield Evaluator(point | {x: root}, mp=context)
        root_count += 1
        if root_count == _POINTS:
            return


def _place(w: sp.Expr) -> str:
    """Return the text "w = 0", without a leading minus sign."""
    w = -w if w.could_extract_minus_sign() else w
    return f"{shorten(str(w), 60)} = 0"


@dataclass(frozen=True)
class Switching:
    """The switching functions w of H and the forces of a system, and the continuity at w = 0."""

    system: System

    @cached_property
    def _moving(self) -> set[sp.Symbol]:
        """Coordinates, momenta and the time."""
        time = set() if self.system.time is None else {self.system.time}
        return {*self.system.q, *self.system.p} | time

    @cached_property
    def switches(self) -> list[sp.Expr]:
        """Every w of H and of the forces that depends on the state or the time."""
        return [w for w in switches_of([self.system.H, *self.system.forces])
                if not w.free_symbols.isdisjoint(self._moving)]

    @cached_property
    def _continuity_of_H(self) -> dict[sp.Expr, Continuity]:
        """The continuity of H at the zeros of each of its switching functions."""
        time = [] if self.system.time is None else [self.system.time]
        symbols = [*self.system.q, *self.system.p, *time]
        switches = switches_of([self.system.H])
        return {w: continuity(self.system.H, w, symbols) for w in self.switches[:_MOST_SWITCHES]
                if not {w, -w}.isdisjoint(switches)}

    @cached_property
    def jumps_of_H(self) -> list[sp.Expr]:
        """The w at whose zeros H is not continuous."""
        return [w for w, kind in self._continuity_of_H.items() if kind is Continuity.JUMP]

    def jumps_of_forces(self, *, discrete: bool) -> list[sp.Expr]:
        """Return the w at whose zeros −H_q + F or H_p jumps: a kink of H, or a jump of F.

        A kink of H does no harm to a ``discrete`` gradient, which is continuous there.
        """
        symbols = [*self.system.q, *self.system.p]
        jumps = []
        for w in self.switches[:_MOST_SWITCHES]:
            # w and −w are one switch; ``switches_of`` returns one of them
            forces = [f for f in self.system.forces if not {w, -w}.isdisjoint(switches_of([f]))]
            has_kink = not discrete and self._continuity_of_H.get(w) is Continuity.KINK
            # a switch of the time alone jumps at a known time, wherever the state is
            if not w.free_symbols.isdisjoint(symbols) and (
                    has_kink or any(continuity(f, w, symbols) is Continuity.JUMP for f in forces)):
                jumps.append(w)
        return jumps

    @property
    def description(self) -> str:
        """The zeros of all w, as text."""
        return _describe(self.switches)

    def named_jumps(self, *, discrete: bool) -> str:
        """Return the zeros of ``jumps_of_forces`` as text."""
        return _describe(self.jumps_of_forces(discrete=discrete))

    def manifest_fields(self, order: int, *, discrete: bool) -> dict[str, Any]:
        """Return the fields of the manifest about switches; {} without any.

        "remarks", a list of sentences, says where a method of order ``order`` loses its order;
        "jumps" says where forces jump, for the message of a failed step. ``discrete`` is as of
        ``jumps_of_forces``.
        """
        if not self.switches:
            return {}
        remarks = [f"order {order} holds for steps that do not cross {self.description}"]
        states = {*self.system.q, *self.system.p}
        at_times = [w for w in self.jumps_of_H if w.free_symbols.isdisjoint(states)]
        at_states = [w for w in self.jumps_of_H if w not in at_times]
        if at_states:
            remarks.append(f"H jumps at {_describe(at_states)}: no step feels a force there")
        if at_times:
            remarks.append(f"H jumps at {_describe(at_times)}: the work of the time omits the jump")
        jumps = self.named_jumps(discrete=discrete)
        if not jumps:
            return {"remarks": remarks}
        remarks.append(f"forces jump at {jumps}: a step to there may have no solution")
        return {"remarks": remarks, "jumps": jumps}


def on_any_side(system: System) -> tuple[System, list[sp.Symbol]]:
    """Return a system with s (side w > 0) + (1 − s) (side w < 0) for each switch, and all s.

    The symbols s are parameters of the new system. A statement that is true of it for all s, such
    as a symmetry, is true of the given system on each side. Raises InputError if a constraint
    switches: g = 0 is no manifold then for 0 < s < 1.
    """
    if switches := switches_of(system.constraints):
        raise InputError(f"A constraint of {system.name!r} switches at {_describe(switches)}; what "
                         "turns with both of its sides is not searched for.")
    symbols: dict[sp.Expr, sp.Symbol] = {}
    reserved = {str(s) for s in (*system.q, *system.p, *system.parameters, system.time)}
    names = (name for i in count() if (name := f"side{i}") not in reserved)

    def side(w: sp.Expr) -> sp.Expr:
        """Return the symbol s that is 1 where w > 0 and 0 elsewhere; 1 − s for −w."""
        if -w in symbols:
            return 1 - symbols[-w]
        if w not in symbols:
            symbols[w] = sp.Symbol(next(names), real=True)
        return symbols[w]

    # expressions that have the same w share its s
    H, *forces = (on_side(e, side) for e in (system.H, *system.forces))
    weights = list(symbols.values())
    if not weights:
        return system, []
    return replace(system, H=H, forces=tuple(forces), quantities={},
                   parameters=(*system.parameters, *weights)), weights


def _describe(switches: Sequence[sp.Expr]) -> str:
    """Return the first three switches as "w = 0", and the number of further ones."""
    suffix = f" and {len(switches) - 3} more such places" if len(switches) > 3 else ""
    return ", ".join(map(_place, switches[:3])) + suffix
