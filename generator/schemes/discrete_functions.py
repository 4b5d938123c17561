"""Differences of expressions over a step, exact for powers and elementary functions.

The rules are listed in ``discrete_gradient``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import sympy as sp

from ..symbolic.cardinal_functions import Asinhc, Atanc, Atanhc, Sinc, Sinhc
from ..symbolic.piecewise import PiecewiseForm
from ..symbolic.shared_subexpressions import Shared, parts_of, share
from ..symbolic.switching_functions import Max, Min, Switch, Where

__all__ = ["FUNCTIONS", "DiscreteDifference", "absolute", "angle", "chosen", "exponential",
           "extreme", "logarithm", "piecewise", "power"]

@dataclass(frozen=True)
class DiscreteDifference:
    """An expression u by its mean ū = (u₁ + u₀)/2 and its difference quotient.

    Attributes
    ----------
    mean : Expr
        ū.
    slope : dict of int to Expr
        i → D_i u, with u₁ − u₀ = Σ_i D_i u Δx_i; entries that vanish identically are absent.
    steps : sequence of Symbol
        Δx.
    known_change : Expr, optional
        u₁ − u₀ where it has a shorter form than the sum over i.
    known_ends : tuple of 2 Expr, optional
        u₀ and u₁ where they are known better than ū ∓ ½ Δu: max(x, 0) is 0, not nearly.
    """

    mean: sp.Expr
    slope: dict[int, sp.Expr]
    steps: Sequence[sp.Symbol]
    known_change: sp.Expr | None = None
    known_ends: tuple[sp.Expr, sp.Expr] | None = None

    @cached_property
    def change(self) -> sp.Expr:
        """u₁ − u₀."""
        if self.known_change is not None:
            return self.known_change
        return sp.Add(*(d * self.steps[i] for i, d in self.slope.items()))

    @cached_property
    def half(self) -> sp.Expr:
        """(u₁ − u₀)/2."""
        return self.change / 2

    @cached_property
    def ends(self) -> tuple[sp.Expr, sp.Expr]:
        """u₀ and u₁."""
        if self.known_ends is not None:
            return self.known_ends
        return self.mean - self.half, self.mean + self.half

    def with_ends(self, start: sp.Expr, end: sp.Expr) -> DiscreteDifference:
        """Return the same, its ends known."""
        return replace(self, known_ends=(share(start), share(end)))

    def become(self, mean: sp.Expr, factor: sp.Expr) -> DiscreteDifference:
        """Return the difference of an f(u) with that mean and f(u₁) − f(u₀) = factor·(u₁ − u₀)."""
        return DiscreteDifference(mean, {i: factor * d for i, d in self.slope.items()}, self.steps)

    def shared(self) -> DiscreteDifference:
        """Return u with mean and change as shared parts: a function uses them more than once."""
        return DiscreteDifference(share(self.mean), self.slope, self.steps, share(self.change),
                                  self.known_ends)

    def apply(self, mean: sp.Expr, factor: sp.Expr) -> DiscreteDifference:
        """Return the result of ``become`` in shared parts, which are computed once."""
        factor = share(factor)
        made = self.become(share(mean), factor)
        return DiscreteDifference(made.mean, made.slope, self.steps, share(factor * self.change))

    def plus(self, *others: DiscreteDifference) -> DiscreteDifference:
        """Return the difference of the sum of all: in one go, as SymPy sorts every sum it makes."""
        terms: dict[int, list[sp.Expr]] = {}
        for part in (self, *others):
            for i, d in part.slope.items():
                terms.setdefault(i, []).append(d)
        total = DiscreteDifference(sp.Add(self.mean, *(other.mean for other in others)),
                                   {i: sp.Add(*slopes) for i, slopes in terms.items()}, self.steps)
        if not any(part.known_ends for part in (self, *others)):
            return total
        return total.with_ends(*(sp.Add(*ends) for ends in zip(
            *(part.ends for part in (self, *others)), strict=True)))

    def __add__(self, other: DiscreteDifference) -> DiscreteDifference:
        return self.plus(other)

    def __mul__(self, other: DiscreteDifference) -> DiscreteDifference:
        """Return the difference of uv: Δ(uv) = ū Δv + v̄ Δu, mean ū v̄ + ¼ Δu Δv."""
        total = other.become(sp.Integer(0), self.mean) + self.become(sp.Integer(0), other.mean)
        mean = self.mean * other.mean
        if self.slope and other.slope:
            mean += self.change * other.change / 4
        product = DiscreteDifference(mean, total.slope, self.steps)
        if not (self.known_ends or other.known_ends):
            return product
        return product.with_ends(*(a * b for a, b in zip(self.ends, other.ends, strict=True)))


#: Powers up to here are written as a sum of products, those above by halving the exponent.
_LARGEST_SUM = 6

# ---------------------------------------------------------------- powers


def power(u: DiscreteDifference, exponent: sp.Expr) -> DiscreteDifference:
    """Return the difference of u^c, where c does not change."""
    if exponent.is_Integer:
        return _integer_power(u, int(exponent))
    if (2 * exponent).is_Integer:
        return _integer_power(_root(u.shared()), int(2 * exponent))
    return _real_power(u.shared(), exponent)


def _integer_power(u: DiscreteDifference, n: int) -> DiscreteDifference:
    if n < 0:  # 1/u first: the ends of uⁿ are further apart, mean and change of it say less of both
        return _integer_power(_reciprocal(u), -n)
    if n == 1:
        return u
    if n == 2:  # mean(u²) = ū² + ¼Δu², Δ(u²) = 2ūΔu: the general rule, shorter
        return u.become(u.mean**2 + u.change**2 / 4, 2 * u.mean)
    u = u.shared()
    u0, u1 = u.ends
    return u.apply((u1**n + u0**n) / 2, _quotient(u, n))


def _quotient(u: DiscreteDifference, n: int) -> sp.Expr:
    """Return (u₁ⁿ − u₀ⁿ)/(u₁ − u₀), with about 2 log₂ n terms for large n."""
    u0, u1 = u.ends
    if n == 1:
        return sp.Integer(1)
    if n <= _LARGEST_SUM:
        return sp.Add(*(u1**k * u0 ** (n - 1 - k) for k in range(n)))
    if n % 2:  # half the sum of the two ways to split one factor off
        return (u1 ** (n - 1) + u0 ** (n - 1)) / 2 + u.mean * _quotient(u, n - 1)
    return _quotient(u, n // 2) * (u1 ** (n // 2) + u0 ** (n // 2))


def _reciprocal(u: DiscreteDifference) -> DiscreteDifference:
    u = u.shared()
    product = u.mean**2 - u.change**2 / 4  # u₀u₁
    return u.apply(u.mean / product, -1 / product)


def _root(u: DiscreteDifference) -> DiscreteDifference:
    u0, u1 = map(sp.sqrt, u.ends)
    total = u1 + u0
    if u.known_ends is None:
        return u.apply(total / 2, 1 / total)
    # both may be 0 for a while, as those of max(x, 0)
    total = share(total)
    quotient = Where(sp.Integer(0), total, 1 / total, sp.Integer(0))
    return u.apply(total / 2, quotient).with_ends(u0, u1)


def _geometric(u: DiscreteDifference) -> tuple[sp.Expr, sp.Expr]:
    """Return g = √u₁ √u₀ and Δu/(2g), the sinh of ½ Δ log u; no number if u₀ or u₁ is negative."""
    u0, u1 = u.ends
    g = share(sp.sqrt(u1) * sp.sqrt(u0))
    return g, share(u.half / g)


def _real_power(u: DiscreteDifference, c: sp.Expr) -> DiscreteDifference:
    """Return exp(c log u), with powers of g in place of the exponential of the mean."""
    g, z = _geometric(u)
    growth = share(c * z * Asinhc(z))  # ½ Δ(c log u)
    mean = g**c * sp.cosh(growth)
    quotient = c * g ** (c - 1) * Sinhc(growth) * Asinhc(z)
    if u.known_ends is not None:  # one of them may be 0, or both
        zero, total = sp.Integer(0), share(sp.Add(*u.ends))
        mean = Where(zero, g, mean, _mean_of(lambda x: x**c, u))
        quotient = Where(zero, g, quotient, Where(zero, total, 2 * mean / total, zero))
    return u.apply(mean, quotient)


# ---------------------------------------------------------------- exponentials and logarithms


def exponential(u: DiscreteDifference, base: sp.Expr = sp.E) -> DiscreteDifference:
    """Return the difference of base^u."""
    u, rate = u.shared(), sp.log(base)
    half = rate * u.half
    value = base**u.mean
    return u.apply(value * sp.cosh(half), rate * value * Sinhc(half))


def logarithm(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of log u."""
    u = u.shared()
    g, z = _geometric(u)
    return u.apply(sp.log(g), Asinhc(z) / g)


# ---------------------------------------------------------------- circular functions


def _sin(u: DiscreteDifference) -> DiscreteDifference:
    return u.apply(sp.sin(u.mean) * sp.cos(u.half), sp.cos(u.mean) * Sinc(u.half))


def _cos(u: DiscreteDifference) -> DiscreteDifference:
    return u.apply(sp.cos(u.mean) * sp.cos(u.half), -sp.sin(u.mean) * Sinc(u.half))


def _tan(u: DiscreteDifference) -> DiscreteDifference:
    u0, u1 = u.ends
    product = sp.cos(u1) * sp.cos(u0)
    return u.apply(sp.sin(2 * u.mean) / (2 * product), Sinc(u.change) / product)


def _mean_of(function: Callable[[sp.Expr], sp.Expr], u: DiscreteDifference) -> sp.Expr:
    u0, u1 = u.ends
    return (function(u1) + function(u0)) / 2


def _arc(u: DiscreteDifference, root: Callable[[sp.Expr], sp.Expr], cardinal: type) -> sp.Expr:
    """Return the quotient of 2 at(Δu/(r₁ + r₀)), r the co-function: u = sin θ, r = cos θ, …"""
    u0, u1 = u.ends
    total = share(root(u1) + root(u0))
    return 2 * cardinal(u.change / total) / total


def _asin(u: DiscreteDifference) -> DiscreteDifference:
    return u.apply(_mean_of(sp.asin, u), _arc(u, _circle, Atanc))


def _acos(u: DiscreteDifference) -> DiscreteDifference:
    return u.apply(_mean_of(sp.acos, u), -_arc(u, _circle, Atanc))


def _circle(x: sp.Expr) -> sp.Expr:
    return sp.sqrt((1 - x) * (1 + x))


def _atan(u: DiscreteDifference) -> DiscreteDifference:
    return angle(u, DiscreteDifference(sp.Integer(1), {}, u.steps))


def angle(y: DiscreteDifference, x: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of atan2(y, x): the angle between the vectors w at the two ends.

    Its tangent is (w₀ × w₁)/(w₀ · w₁), of half the angle (w₀ × w₁)/r with r = |w₀||w₁| + w₀·w₁,
    which is |s|²/(2|w₀||w₁|) of the bisector s = |w₁|w₀ + |w₀|w₁: no digits cancel where w₁ is
    nearly −w₀. The mean is half the angle after the start: both are continuous where atan2 jumps
    by 2π; only atan2 itself differs there from its definition, no periodic function of it does.
    """
    y, x = y.shared(), x.shared()
    (y0, y1), (x0, x1) = y.ends, x.ends
    # the squares are shared: SymPy would make |x| of √(x² + x²), which has no C
    length0, length1 = (share(sp.sqrt(share(a**2 + b**2))) for a, b in ((x0, y0), (x1, y1)))
    bisector = (share(x0 * length1 + x1 * length0), share(y0 * length1 + y1 * length0))
    cross = share(x.mean * y.change - y.mean * x.change)
    total = share(sum(s**2 for s in bisector) / (2 * length0 * length1))
    factor = share(2 * Atanc(cross / total) / total)
    change = share(factor * cross)
    slope = (y.become(sp.Integer(0), factor * x.mean)
             + x.become(sp.Integer(0), -factor * y.mean)).slope
    return DiscreteDifference(share(sp.atan2(y0, x0) + change / 2), slope, y.steps, change)


# ---------------------------------------------------------------- hyperbolic functions


def _sinh(u: DiscreteDifference) -> DiscreteDifference:
    return u.apply(sp.sinh(u.mean) * sp.cosh(u.half), sp.cosh(u.mean) * Sinhc(u.half))


def _cosh(u: DiscreteDifference) -> DiscreteDifference:
    return u.apply(sp.cosh(u.mean) * sp.cosh(u.half), sp.sinh(u.mean) * Sinhc(u.half))


def _tanh(u: DiscreteDifference) -> DiscreteDifference:
    u0, u1 = u.ends
    return u.apply(_mean_of(sp.tanh, u), Sinhc(u.change) / (sp.cosh(u1) * sp.cosh(u0)))


def _asinh(u: DiscreteDifference) -> DiscreteDifference:
    mean = share(_mean_of(sp.asinh, u))
    c = share(sp.cosh(mean))
    return u.apply(mean, Asinhc(u.half / c) / c)


def _acosh(u: DiscreteDifference) -> DiscreteDifference:
    return u.apply(_mean_of(sp.acosh, u),
                    _arc(u, lambda x: sp.sqrt(x - 1) * sp.sqrt(x + 1), Atanhc))


def _atanh(u: DiscreteDifference) -> DiscreteDifference:
    u0, u1 = u.ends
    g = share(_circle(u1) * _circle(u0))
    return u.apply(_mean_of(sp.atanh, u), Asinhc(u.change / g) / g)


#: ``differentiate`` of ``discrete_gradient``.
Differentiate = Callable[
    [sp.Expr, Mapping[sp.Symbol, DiscreteDifference], Sequence[sp.Expr]], DiscreteDifference]

HALF = sp.Rational(1, 2)


def _tilt(u: DiscreteDifference) -> sp.Expr:
    """Return ū/max(|ū|, |h|): ±1 where both ends are on one side, 0 where all is zero."""
    h, side = sp.Abs(u.half), sp.sign(u.mean)
    return share(Where(sp.Abs(u.mean), h, u.mean / h, side) if h != 0 else side)


def absolute(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of |u|, whose mean is max(|ū|, |h|)."""
    u = u.shared()
    made = u.apply(Max(sp.Abs(u.mean), sp.Abs(u.half)), _tilt(u))
    return made.with_ends(*map(sp.Abs, u.ends))


def extreme(
    function: type[Max | Min], u: DiscreteDifference, v: DiscreteDifference
) -> DiscreteDifference:
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
    made = DiscreteDifference(share(mean), slope, u.steps, share(change))
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


def chosen(
    a: DiscreteDifference, b: DiscreteDifference, x: DiscreteDifference, y: DiscreteDifference
) -> DiscreteDifference:
    """Return the difference of x where a < b and y elsewhere, where a and b do not change."""
    def pick(yes: sp.Expr, no: sp.Expr) -> sp.Expr:
        return Where(a.mean, b.mean, yes, no)

    zero = sp.Integer(0)
    made = DiscreteDifference(pick(x.mean, y.mean),
                              {i: pick(x.slope.get(i, zero), y.slope.get(i, zero))
                                             for i in sorted(x.slope.keys() | y.slope.keys())},
                      x.steps, pick(x.change, y.change))
    return made.with_ends(*(pick(*ends) for ends in zip(x.ends, y.ends, strict=True)))


def piecewise(
    pieces: PiecewiseForm, s: DiscreteDifference, differentiate: Differentiate
) -> DiscreteDifference:
    """Return the difference of f(s) = Σ_i f_i(c_i) + constant, c_i being s held between its limits.

    Where s stays between two limits all c_i but one are constant.
    """
    s = s.shared()
    step = (s.change,)
    variable = DiscreteDifference(s.mean, {0: sp.Integer(1)}, step)
    factor = sp.Integer(0)
    for part, (low, high) in zip(pieces.parts, pairwise([None, *pieces.limits, None]), strict=True):
        if pieces.symbol not in part.free_symbols:
            continue
        held = variable
        if high is not None:
            held = extreme(Min, held, DiscreteDifference(high, {}, step))
        if low is not None:
            held = extreme(Max, held, DiscreteDifference(low, {}, step))
        slope = differentiate(part, {pieces.symbol: held}, step).slope[0]
        inside = held.slope[0]  # the part of the way that s goes between the limits
        factor += slope if _is_finite(slope) else Where(sp.Integer(0), inside, slope,
                                                        sp.Integer(0))
    for low, high in pieces.assumed:  # else f jumps: no number rather than a wrong one
        factor = Where(high, low, sp.sqrt(high - low), factor)
    at = [pieces.whole.xreplace({pieces.symbol: end}) for end in s.ends]
    return s.apply((at[0] + at[1]) / 2, factor).with_ends(*at)


#: Functions of one argument with a rule.
FUNCTIONS: dict[type[sp.Expr], Callable[[DiscreteDifference], DiscreteDifference]] = {
    sp.exp: exponential,
    sp.log: logarithm,
    sp.sin: _sin,
    sp.cos: _cos,
    sp.tan: _tan,
    sp.asin: _asin,
    sp.acos: _acos,
    sp.atan: _atan,
    sp.sinh: _sinh,
    sp.cosh: _cosh,
    sp.tanh: _tanh,
    sp.asinh: _asinh,
    sp.acosh: _acosh,
    sp.atanh: _atanh,
    sp.Abs: absolute,
}
