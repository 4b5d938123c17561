"""Exact differences of powers and of the elementary functions; the rules are listed in
``discrete_gradient``.
"""

from __future__ import annotations

from collections.abc import Callable

import sympy as sp

from ..symbolic.cardinal_functions import Asinhc, Atanc, Atanhc, Sinc, Sinhc
from ..symbolic.shared_subexpressions import share
from ..symbolic.switching_functions import Where
from .discrete_difference import Difference
from .discrete_switches import absolute

__all__ = ["FUNCTIONS", "angle", "exponential", "logarithm", "power"]

#: Powers up to here are written as a sum of products, those above by halving the exponent.
_LARGEST_SUM = 6

# ---------------------------------------------------------------- powers


def power(u: Difference, exponent: sp.Expr) -> Difference:
    """Return the difference of u^c, where c does not change."""
    if exponent.is_Integer:
        return _integer_power(u, int(exponent))
    if (2 * exponent).is_Integer:
        return _integer_power(_root(u.shared()), int(2 * exponent))
    return _real_power(u.shared(), exponent)


def _integer_power(u: Difference, n: int) -> Difference:
    if n < 0:  # 1/u first: the ends of uⁿ are further apart, mean and change of it say less of both
        return _integer_power(_reciprocal(u), -n)
    if n == 1:
        return u
    if n == 2:  # mean(u²) = ū² + ¼Δu², Δ(u²) = 2ūΔu: the general rule, shorter
        return u.become(u.mean**2 + u.change**2 / 4, 2 * u.mean)
    u = u.shared()
    u0, u1 = u.ends
    return u.apply((u1**n + u0**n) / 2, _quotient(u, n))


def _quotient(u: Difference, n: int) -> sp.Expr:
    """Return (u₁ⁿ − u₀ⁿ)/(u₁ − u₀), with about 2 log₂ n terms for large n."""
    u0, u1 = u.ends
    if n == 1:
        return sp.Integer(1)
    if n <= _LARGEST_SUM:
        return sp.Add(*(u1**k * u0 ** (n - 1 - k) for k in range(n)))
    if n % 2:  # half the sum of the two ways to split one factor off
        return (u1 ** (n - 1) + u0 ** (n - 1)) / 2 + u.mean * _quotient(u, n - 1)
    return _quotient(u, n // 2) * (u1 ** (n // 2) + u0 ** (n // 2))


def _reciprocal(u: Difference) -> Difference:
    u = u.shared()
    product = u.mean**2 - u.change**2 / 4  # u₀u₁
    return u.apply(u.mean / product, -1 / product)


def _root(u: Difference) -> Difference:
    u0, u1 = map(sp.sqrt, u.ends)
    total = u1 + u0
    if u.known_ends is None:
        return u.apply(total / 2, 1 / total)
    # both may be 0 for a while, as those of max(x, 0)
    total = share(total)
    quotient = Where(sp.Integer(0), total, 1 / total, sp.Integer(0))
    return u.apply(total / 2, quotient).with_ends(u0, u1)


def _geometric(u: Difference) -> tuple[sp.Expr, sp.Expr]:
    """Return g = √u₁ √u₀ and Δu/(2g), the sinh of ½ Δ log u; no number if u₀ or u₁ is negative."""
    u0, u1 = u.ends
    g = share(sp.sqrt(u1) * sp.sqrt(u0))
    return g, share(u.half / g)


def _real_power(u: Difference, c: sp.Expr) -> Difference:
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


def exponential(u: Difference, base: sp.Expr = sp.E) -> Difference:
    """Return the difference of base^u."""
    u, rate = u.shared(), sp.log(base)
    half = rate * u.half
    value = base**u.mean
    return u.apply(value * sp.cosh(half), rate * value * Sinhc(half))


def logarithm(u: Difference) -> Difference:
    """Return the difference of log u."""
    u = u.shared()
    g, z = _geometric(u)
    return u.apply(sp.log(g), Asinhc(z) / g)


# ---------------------------------------------------------------- circular functions


def _sin(u: Difference) -> Difference:
    return u.apply(sp.sin(u.mean) * sp.cos(u.half), sp.cos(u.mean) * Sinc(u.half))


def _cos(u: Difference) -> Difference:
    return u.apply(sp.cos(u.mean) * sp.cos(u.half), -sp.sin(u.mean) * Sinc(u.half))


def _tan(u: Difference) -> Difference:
    u0, u1 = u.ends
    product = sp.cos(u1) * sp.cos(u0)
    return u.apply(sp.sin(2 * u.mean) / (2 * product), Sinc(u.change) / product)


def _mean_of(function: Callable[[sp.Expr], sp.Expr], u: Difference) -> sp.Expr:
    u0, u1 = u.ends
    return (function(u1) + function(u0)) / 2


def _arc(u: Difference, root: Callable[[sp.Expr], sp.Expr], cardinal: type) -> sp.Expr:
    """Return the quotient of 2 at(Δu/(r₁ + r₀)), r the co-function: u = sin θ, r = cos θ, …"""
    u0, u1 = u.ends
    total = share(root(u1) + root(u0))
    return 2 * cardinal(u.change / total) / total


def _asin(u: Difference) -> Difference:
    return u.apply(_mean_of(sp.asin, u), _arc(u, _circle, Atanc))


def _acos(u: Difference) -> Difference:
    return u.apply(_mean_of(sp.acos, u), -_arc(u, _circle, Atanc))


def _circle(x: sp.Expr) -> sp.Expr:
    return sp.sqrt((1 - x) * (1 + x))


def _atan(u: Difference) -> Difference:
    return angle(u, Difference(sp.Integer(1), {}, u.steps))


def angle(y: Difference, x: Difference) -> Difference:
    """Return the difference of atan2(y, x): the angle between the vectors w at the two ends.

    Its tangent is (w₀ × w₁)/(w₀ · w₁), of half the angle (w₀ × w₁)/r with r = |w₀||w₁| + w₀·w₁,
    which is |s|²/(2|w₀||w₁|) of the bisector s = |w₁|w₀ + |w₀|w₁: no digits cancel where w₁ is
    nearly −w₀. The mean is half the angle after the start: both are continuous where atan2 jumps
    by 2π; only atan2 itself differs there from what is said of it, no periodic function of it does.
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
    return Difference(share(sp.atan2(y0, x0) + change / 2), slope, y.steps, change)


# ---------------------------------------------------------------- hyperbolic functions


def _sinh(u: Difference) -> Difference:
    return u.apply(sp.sinh(u.mean) * sp.cosh(u.half), sp.cosh(u.mean) * Sinhc(u.half))


def _cosh(u: Difference) -> Difference:
    return u.apply(sp.cosh(u.mean) * sp.cosh(u.half), sp.sinh(u.mean) * Sinhc(u.half))


def _tanh(u: Difference) -> Difference:
    u0, u1 = u.ends
    return u.apply(_mean_of(sp.tanh, u), Sinhc(u.change) / (sp.cosh(u1) * sp.cosh(u0)))


def _asinh(u: Difference) -> Difference:
    mean = share(_mean_of(sp.asinh, u))
    c = share(sp.cosh(mean))
    return u.apply(mean, Asinhc(u.half / c) / c)


def _acosh(u: Difference) -> Difference:
    return u.apply(_mean_of(sp.acosh, u),
                    _arc(u, lambda x: sp.sqrt(x - 1) * sp.sqrt(x + 1), Atanhc))


def _atanh(u: Difference) -> Difference:
    u0, u1 = u.ends
    g = share(_circle(u1) * _circle(u0))
    return u.apply(_mean_of(sp.atanh, u), Asinhc(u.change / g) / g)


#: Functions of one argument with a rule.
FUNCTIONS: dict[type[sp.Expr], Callable[[Difference], Difference]] = {
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
