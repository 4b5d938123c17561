"""Exact differences of functions with two sides; the rules are listed in ``discrete_gradient``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import sympy as sp

from ..symbolic.piecewise import Pieces
from ..symbolic.shared_subexpressions import Shared, parts_of, share
from ..symbolic.switching_functions import Max, Min, Switch, Where
from .discrete_difference import Difference

__all__ = ["absolute", "chosen", "extreme", "piecewise"]

#: ``differentiate`` of ``discrete_gradient``.
Differentiate = Callable[
    [sp.Expr, Mapping[sp.Symbol, Difference], Sequence[sp.Expr]], Difference]

HALF = sp.Rational(1, 2)


def _tilt(u: Difference) -> sp.Expr:
    """Return ū/max(|ū|, |h|): ±1 where both ends are on one side, 0 where all is zero."""
    h, side = sp.Abs(u.half), sp.sign(u.mean)
    return share(Where(sp.Abs(u.mean), h, u.mean / h, side) if h != 0 else side)


def absolute(u: Difference) -> Difference:
    """Return the difference of |u|, whose mean is max(|ū|, |h|)."""
    u = u.shared()
    made = u.apply(Max(sp.Abs(u.mean), sp.Abs(u.half)), _tilt(u))
    return made.with_ends(*map(sp.Abs, u.ends))


def extreme(function: type[Max | Min], u: Difference, v: Difference) -> Difference:
    """Return the difference of max(u, v) or min(u, v): of u and v by their shares in it."""
    u, v = u.shared(), v.shared()
    w = (u + v.become(-v.mean, sp.Integer(-1))).shared()
    tilt = _tilt(w) if function is Max else -_tilt(w)
    mine, others = share((1 + tilt) / 2), share((1 - tilt) / 2)
    h = sp.Abs(w.half) if function is Max else -sp.Abs(w.half)
    mean = Where(sp.Abs(w.mean), sp.Abs(w.half), (u.mean + v.mean + h) / 2,
                 function(u.mean, v.mean))
    slope = {i: _weighted(mine, u.slope.get(i, sp.Integer(0)))
             + _weighted(others, v.slope.get(i, sp.Integer(0)))
             for i in sorted(u.slope.keys() | v.slope.keys())}
    change = _weighted(mine, u.change) + _weighted(others, v.change)
    made = Difference(share(mean), slope, u.steps, share(change))
    return made.with_ends(*(function(*ends) for ends in zip(u.ends, v.ends, strict=True)))


def _weighted(weight: sp.Expr, e: sp.Expr) -> sp.Expr:
    """Return their product: 0 for the weight 0, also where e is no number."""
    return weight * e if _is_finite(e) else Where(sp.Integer(0), weight, weight * e, sp.Integer(0))


def _is_finite(e: sp.Expr) -> bool:
    """Whether e has a value for any values of its symbols."""
    return all(
        part.is_Atom or part.is_Add or part.is_Mul
        or (part.is_Pow and part.exp.is_Integer and part.exp > 0)
        or isinstance(part, (Shared, Switch, sp.Abs, sp.sign))
        for part in parts_of([e]))


def chosen(a: Difference, b: Difference, x: Difference, y: Difference) -> Difference:
    """Return the difference of x where a < b and y elsewhere, where a and b do not change."""
    def pick(yes: sp.Expr, no: sp.Expr) -> sp.Expr:
        return Where(a.mean, b.mean, yes, no)

    zero = sp.Integer(0)
    made = Difference(pick(x.mean, y.mean), {i: pick(x.slope.get(i, zero), y.slope.get(i, zero))
                                             for i in sorted(x.slope.keys() | y.slope.keys())},
                      x.steps, pick(x.change, y.change))
    return made.with_ends(*(pick(*ends) for ends in zip(x.ends, y.ends, strict=True)))


def piecewise(pieces: Pieces, s: Difference, differentiate: Differentiate) -> Difference:
    """Return the difference of f(s) = Σ_i f_i(c_i) + constant, c_i being s held between its limits.

    Where s stays between two limits all c_i but one are constant.
    """
    s = s.shared()
    step = (s.change,)
    variable = Difference(s.mean, {0: sp.Integer(1)}, step)
    factor = sp.Integer(0)
    for part, (low, high) in zip(pieces.parts, pairwise([None, *pieces.limits, None]), strict=True):
        if pieces.symbol not in part.free_symbols:
            continue
        held = variable
        if high is not None:
            held = extreme(Min, held, Difference(high, {}, step))
        if low is not None:
            held = extreme(Max, held, Difference(low, {}, step))
        slope = differentiate(part, {pieces.symbol: held}, step).slope[0]
        inside = held.slope[0]  # the part of the way that s goes between the limits
        factor += slope if _is_finite(slope) else Where(sp.Integer(0), inside, slope,
                                                        sp.Integer(0))
    for low, high in pieces.assumed:  # else f jumps: no number rather than a wrong one
        factor = Where(high, low, sp.sqrt(high - low), factor)
    at = [pieces.whole.xreplace({pieces.symbol: end}) for end in s.ends]
    return s.apply((at[0] + at[1]) / 2, factor).with_ends(*at)
