"""The time t as t0 + τ: what loses the digits of a late time is written in τ, since the start.

A sum a t + b with a and b of the parameters alone becomes a τ + φ, with φ = a t0 + b a constant of
the run: for the argument of a sine, a cosine or a tangent reduced to [−π, π] in twice the working
precision, by ``phase`` in C; elsewhere, as in t − T, a plain sum of which t0 − T is exact.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath as mp
import sympy as sp

from .cardinal_functions import Numeric

__all__ = ["START", "Phase", "since_start", "without_start"]

#: The time at the start of a run.
START = sp.Symbol("_start", real=True)
_PERIODIC = (sp.sin, sp.cos, sp.tan)


class Phase(Numeric):
    """c s t0 + b less a multiple of 2π: a number c, and s, t0 and b."""

    nargs: Any = 4
    c_name = "phase"

    @staticmethod
    def value(*arguments: Any) -> Any:
        """Return the value at mpmath numbers, to working precision."""
        number, s, start, b = arguments
        angle = number * s * start + b
        return mp.atan2(mp.sin(angle), mp.cos(angle))

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        """Return the derivative."""
        number, s, start, _ = self.args
        slopes: list[sp.Expr] = [s * start, number * start, number * s, sp.Integer(1)]
        return slopes[argindex - 1]


def without_start(e: sp.Expr) -> sp.Expr:
    """Return an expression as it is for t0 = 0, where the time since the start is the time."""
    plain: sp.Expr = e.replace(Phase, lambda *arguments: arguments[-1])
    return plain.xreplace({START: sp.Integer(0)})


def since_start(
    e: sp.Expr, time: sp.Symbol, known: frozenset[sp.Symbol],
    constant: Callable[[sp.Expr], sp.Expr],
) -> sp.Expr:
    """Return e with t0 + τ in place of the time, which is now τ, in constants of the run."""
    made: dict[sp.Basic, sp.Basic] = {}

    def is_known(x: sp.Basic) -> bool:
        return bool(x.free_symbols <= known)

    def linear(x: sp.Expr, *, periodic: bool) -> sp.Expr | None:
        """Return a sum whose time has coefficients of the parameters alone; None for others."""
        slopes, shifts, others = [], [], []
        for term in sp.Add.make_args(x):
            rate, rest = term.as_independent(time, as_Add=False)
            if rest == time and is_known(rate):
                slopes.append(rate)
            elif is_known(term):
                shifts.append(term)
            else:
                others.append(term)
        if not slopes:
            return None
        slope, shift = sp.Add(*slopes), sp.Add(*shifts)
        if periodic:
            numbers, symbols = slope.as_independent(*known, as_Add=False)
            shift = constant(Phase(numbers, symbols, START, shift))
        else:
            shift = constant(slope * START + shift)
        return sp.Add(slope * time, shift, *map(walk, others))

    def walk(x: Any) -> Any:
        if x not in made:
            made[x] = _walk(x)
        return made[x]

    def _walk(x: Any) -> Any:
        if time not in x.free_symbols:
            return x
        if isinstance(x, _PERIODIC):
            argument = linear(x.args[0], periodic=True)
            return x.func(walk(x.args[0]) if argument is None else argument)
        if x == time or x.is_Add or x.is_Mul:
            found = linear(x, periodic=False)
            if found is not None:
                return found
        return x.func(*map(walk, x.args))

    found: sp.Expr = walk(e)
    return found
