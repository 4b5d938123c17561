"""The time as t = t0 + τ, where τ is the time since the start: no digits are lost at a late time.

A sum a t + b, where a and b depend on parameters alone, becomes a τ + φ with a constant of the run
φ = a t0 + b. In the argument of a sine, a cosine or a tangent, φ is reduced to [−π, π] in twice the
working precision, by ``phase`` in C; elsewhere, as in t − T, it is a plain sum.
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
    """c s t0 + b modulo 2π, with a number c and expressions s, t0 and b."""

    nargs: Any = 4
    c_name = "phase"

    @staticmethod
    def value(*arguments: Any) -> Any:
        """Return the value at mpmath numbers, to working precision."""
        c, s, start, b = arguments
        angle = c * s * start + b
        return mp.atan2(mp.sin(angle), mp.cos(angle))

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        """Return the derivative by an argument, counted from 1."""
        c, s, start, _ = self.args
        slopes: list[sp.Expr] = [s * start, c * start, c * s, sp.Integer(1)]
        return slopes[argindex - 1]


def without_start(e: sp.Expr) -> sp.Expr:
    """Return an expression for t0 = 0, so that the time since the start is the time."""
    with_shift: sp.Expr = e.replace(Phase, lambda *arguments: arguments[-1])
    return with_shift.xreplace({START: sp.Integer(0)})


def since_start(
    e: sp.Expr, time: sp.Symbol, constants: frozenset[sp.Symbol],
    constant: Callable[[sp.Expr], sp.Expr],
) -> sp.Expr:
    """Return e(t0 + τ), with τ under the symbol of the time, and constants of the run.

    sin(a t + b) becomes sin(a τ + φ) with φ = (a t0 + b) mod 2π, since a t loses digits at large
    t0.

    Parameters
    ----------
    e : Expr
    time : Symbol
        The time t in e, and τ in the result.
    constants : set of Symbol
        Symbols that are constant during a run.
    constant : callable
        Returns the symbol of a constant expression.
    """
    shifted: sp.Expr = _TimeShift(time, constants, constant).shift(e)
    return shifted


class _TimeShift:
    """Expressions at t = t0 + τ; see ``since_start`` for the arguments."""

    def __init__(
        self, time: sp.Symbol, constants: frozenset[sp.Symbol],
        constant: Callable[[sp.Expr], sp.Expr],
    ) -> None:
        self._time, self._constants, self._constant = time, constants, constant
        self._replacement: dict[sp.Basic, sp.Basic] = {}

    def shift(self, x: Any) -> Any:
        """Return x at t0 + τ; equal subexpressions are rebuilt once."""
        if x not in self._replacement:
            self._replacement[x] = self._rebuilt(x)
        return self._replacement[x]

    def _rebuilt(self, x: Any) -> Any:
        """Return x at t0 + τ: the arguments of periodic functions as phases, linear sums with φ."""
        if self._time not in x.free_symbols:
            return x
        if isinstance(x, _PERIODIC):
            argument = self._shift_linear_sum(x.args[0], periodic=True)
            return x.func(self.shift(x.args[0]) if argument is None else argument)
        if x == self._time or x.is_Add or x.is_Mul:
            linear_sum = self._shift_linear_sum(x, periodic=False)
            if linear_sum is not None:
                return linear_sum
        return x.func(*map(self.shift, x.args))

    def _shift_linear_sum(self, x: sp.Expr, *, periodic: bool) -> sp.Expr | None:
        """Return a sum a t + b + … as a τ + φ + …; None if no term is linear in the time.

        φ = a t0 + b is a constant of the run, reduced modulo 2π (``Phase``) if ``periodic``.
        """
        rates, offsets, other_terms = [], [], []
        for term in sp.Add.make_args(x):
            rate, time_factor = term.as_independent(self._time, as_Add=False)
            if time_factor == self._time and self._is_constant(rate):
                rates.append(rate)
            elif self._is_constant(term):
                offsets.append(term)
            else:
                other_terms.append(term)
        if not rates:
            return None
        a, b = sp.Add(*rates), sp.Add(*offsets)
        if periodic:
            # the number in a = number · symbols is passed to ``phase`` with twice the digits
            number, symbols = a.as_independent(*self._constants, as_Add=False)
            phi = self._constant(Phase(number, symbols, START, b))
        else:
            phi = self._constant(a * START + b)
        return sp.Add(a * self._time, phi, *map(self.shift, other_terms))

    def _is_constant(self, x: sp.Basic) -> bool:
        """Whether x has the same value during a whole run."""
        return bool(x.free_symbols <= self._constants)
