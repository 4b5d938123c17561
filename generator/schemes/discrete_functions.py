"""Differences of expressions over a step, exact for powers and elementary functions.

The rules are listed in ``discrete_gradient``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import sympy as sp

from ...core.records import dataclass
from ..symbolic.cardinal_functions import Asinhc, Atanc, Atanhc, Sinc, Sinhc
from ..symbolic.piecewise import PiecewiseForm
from ..symbolic.shared_subexpressions import Shared, parts_of, share
from ..symbolic.switching_functions import Max, Min, Switch, Where

__all__ = ["FUNCTIONS", "DiscreteDifference", "absolute", "angle", "choose_branch", "exponential",
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
        The differences Δx_i.
    known_change : Expr, optional
        u₁ − u₀, if it has a shorter form than the sum over i.
    known_ends : tuple of 2 Expr, optional
        u₀ and u₁, if they are more exact than ū ∓ ½ Δu: max(x, 0) is 0, not nearly 0.
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
        """Return the difference with the given ends u₀ and u₁."""
        return replace(self, known_ends=(share(start), share(end)))

    def become(self, mean: sp.Expr, factor: sp.Expr) -> DiscreteDifference:
        """Return the difference of f(u), from its mean and f(u₁) − f(u₀) = factor·(u₁ − u₀)."""
        return DiscreteDifference(mean, {i: factor * d for i, d in self.slope.items()}, self.steps)

    def with_shared_parts(self) -> DiscreteDifference:
        """Return u with its mean and its change as shared subexpressions."""
        return DiscreteDifference(share(self.mean), self.slope, self.steps,
                                  known_change=share(self.change), known_ends=self.known_ends)

    def apply(self, mean: sp.Expr, factor: sp.Expr) -> DiscreteDifference:
        """Return the result of ``become`` with shared subexpressions, computed once."""
        factor = share(factor)
        difference = self.become(share(mean), factor)
        return replace(difference, known_change=share(factor * self.change))

    def plus(self, *summands: DiscreteDifference) -> DiscreteDifference:
        """Return the difference of a sum; all terms at once, as SymPy sorts every sum it builds."""
        terms: dict[int, list[sp.Expr]] = {}
        for term in (self, *summands):
            for i, d in term.slope.items():
                terms.setdefault(i, []).append(d)
        total = DiscreteDifference(sp.Add(self.mean, *(term.mean for term in summands)),
                                   {i: sp.Add(*slopes) for i, slopes in terms.items()}, self.steps)
        # unless a term has ends of its own, those of the sum are mean ± half the change
        if not any(term.known_ends for term in (self, *summands)):
            return total
        return total.with_ends(*(sp.Add(*ends) for ends in zip(
            *(term.ends for term in (self, *summands)), strict=True)))

    def __add__(self, v: DiscreteDifference) -> DiscreteDifference:
        return self.plus(v)

    def __mul__(self, v: DiscreteDifference) -> DiscreteDifference:
        """Return the difference of uv: Δ(uv) = ū Δv + v̄ Δu, mean ū v̄ + ¼ Δu Δv."""
        # only the slopes of this sum are used: its mean is 0
        total = v.become(sp.Integer(0), self.mean) + self.become(sp.Integer(0), v.mean)
        mean = self.mean * v.mean
        if self.slope and v.slope:
            mean += self.change * v.change / 4
        product = DiscreteDifference(mean, total.slope, self.steps)
        if not (self.known_ends or v.known_ends):
            return product
        return product.with_ends(*(a * b for a, b in zip(self.ends, v.ends, strict=True)))


#: Up to this n, (u₁ⁿ − u₀ⁿ)/(u₁ − u₀) is a sum of products; above, n is halved.
_LARGEST_SUM = 6

# ---------------------------------------------------------------- powers


def power(u: DiscreteDifference, exponent: sp.Expr) -> DiscreteDifference:
    """Return the difference of u^c with a constant c."""
    if exponent.is_Integer:
        return _integer_power(u, int(exponent))
    if (2 * exponent).is_Integer:
        return _integer_power(_root(u.with_shared_parts()), int(2 * exponent))
    return _real_power(u.with_shared_parts(), exponent)


def _integer_power(u: DiscreteDifference, n: int) -> DiscreteDifference:
    """Return the difference of uⁿ."""
    # 1/u first: the ends of uⁿ are further apart, and lose more digits in mean ∓ ½ change
    if n < 0:
        return _integer_power(_reciprocal(u), -n)
    if n == 1:
        return u
    if n == 2:  # mean(u²) = ū² + ¼Δu², Δ(u²) = 2ūΔu: the general rule, shorter
        return u.become(u.mean**2 + u.change**2 / 4, 2 * u.mean)
    u = u.with_shared_parts()
    u0, u1 = u.ends
    return u.apply((u1**n + u0**n) / 2, _power_quotient(u, n))


def _power_quotient(u: DiscreteDifference, n: int) -> sp.Expr:
    """Return (u₁ⁿ − u₀ⁿ)/(u₁ − u₀) without a division, with about 2 log₂ n terms for large n.

    u₁²ᵏ − u₀²ᵏ = (u₁ᵏ − u₀ᵏ)(u₁ᵏ + u₀ᵏ) halves n.
    """
    u0, u1 = u.ends
    if n <= _LARGEST_SUM:
        return sp.Add(*(u1**k * u0 ** (n - 1 - k) for k in range(n)))
    if n % 2:  # the mean of u₁ⁿ⁻¹ + u₀ q and u₀ⁿ⁻¹ + u₁ q with q = (u₁ⁿ⁻¹ − u₀ⁿ⁻¹)/(u₁ − u₀)
        return (u1 ** (n - 1) + u0 ** (n - 1)) / 2 + u.mean * _power_quotient(u, n - 1)
    return _power_quotient(u, n // 2) * (u1 ** (n // 2) + u0 ** (n // 2))


def _reciprocal(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of 1/u: mean ū/(u₀u₁), slope −1/(u₀u₁), u₀u₁ = ū² − ¼Δu²."""
    u = u.with_shared_parts()
    product = u.mean**2 - u.change**2 / 4  # u₀u₁
    return u.apply(u.mean / product, -1 / product)


def _root(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of √u: slope 1/(√u₁ + √u₀)."""
    u0, u1 = map(sp.sqrt, u.ends)
    total = u1 + u0
    if u.known_ends is None:
        return u.apply(total / 2, 1 / total)
    # both ends may be 0, for example if u = max(x, 0)
    total = share(total)
    quotient = Where(sp.Integer(0), total, 1 / total, sp.Integer(0))
    return u.apply(total / 2, quotient).with_ends(u0, u1)


def _geometric_mean(u: DiscreteDifference) -> tuple[sp.Expr, sp.Expr]:
    """Return g = √u₁ √u₀ and Δu/(2g) = sinh(½ Δ log u); NaN if u₀ or u₁ is negative."""
    u0, u1 = u.ends
    g = share(sp.sqrt(u1) * sp.sqrt(u0))
    return g, share(u.half / g)


def _real_power(u: DiscreteDifference, c: sp.Expr) -> DiscreteDifference:
    """Return the difference of uᶜ = exp(c log u), with gᶜ in place of exp(c mean(log u)).

    With z = Δu/(2g): ½ Δ log u = z asinhc(z) =: ℓ, mean gᶜ cosh(cℓ), Δ(uᶜ) = 2 gᶜ sinh(cℓ).
    """
    g, z = _geometric_mean(u)
    growth = share(c * z * Asinhc(z))  # ½ Δ(c log u)
    mean = g**c * sp.cosh(growth)
    quotient = c * g ** (c - 1) * Sinhc(growth) * Asinhc(z)
    if u.known_ends is not None:  # one end may be 0, or both
        zero, total = sp.Integer(0), share(sp.Add(*u.ends))
        mean = Where(zero, g, mean, _mean_of(lambda x: x**c, u))
        quotient = Where(zero, g, quotient, Where(zero, total, 2 * mean / total, zero))
    return u.apply(mean, quotient)


# ---------------------------------------------------------------- exponentials and logarithms


def exponential(u: DiscreteDifference, base: sp.Expr = sp.E) -> DiscreteDifference:
    """Return the difference of base^u."""
    u, rate = u.with_shared_parts(), sp.log(base)
    half = rate * u.half
    mean_power = base**u.mean
    return u.apply(mean_power * sp.cosh(half), rate * mean_power * Sinhc(half))


def logarithm(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of log u."""
    u = u.with_shared_parts()
    g, z = _geometric_mean(u)
    return u.apply(sp.log(g), Asinhc(z) / g)


# ---------------------------------------------------------------- circular functions


# The rules of ``discrete_gradient``, mean and factor of Δu; h = Δu/2 is ``u.half``.


def _sin(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of sin u: mean sin ū cos h, factor cos ū sinc h."""
    return u.apply(sp.sin(u.mean) * sp.cos(u.half), sp.cos(u.mean) * Sinc(u.half))


def _cos(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of cos u: mean cos ū cos h, factor −sin ū sinc h."""
    return u.apply(sp.cos(u.mean) * sp.cos(u.half), -sp.sin(u.mean) * Sinc(u.half))


def _tan(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of tan u: factor sinc(Δu)/(cos u₁ cos u₀)."""
    u0, u1 = u.ends
    product = sp.cos(u1) * sp.cos(u0)
    return u.apply(sp.sin(2 * u.mean) / (2 * product), Sinc(u.change) / product)


def _mean_of(function: Callable[[sp.Expr], sp.Expr], u: DiscreteDifference) -> sp.Expr:
    """Return (f(u₁) + f(u₀))/2."""
    u0, u1 = u.ends
    return (function(u1) + function(u0)) / 2


def _arc_slope(
    u: DiscreteDifference, root: Callable[[sp.Expr], sp.Expr], cardinal: type
) -> sp.Expr:
    """Return 2 cardinal(Δu/(r₁ + r₀))/(r₁ + r₀) with r = root(u): u = sin θ has r = cos θ."""
    u0, u1 = u.ends
    total = share(root(u1) + root(u0))
    return 2 * cardinal(u.change / total) / total


def _asin(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of asin u; r = √(1 − u²) is the cosine of the angle."""
    return u.apply(_mean_of(sp.asin, u), _arc_slope(u, _circle, Atanc))


def _acos(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of acos u = π/2 − asin u."""
    return u.apply(_mean_of(sp.acos, u), -_arc_slope(u, _circle, Atanc))


def _circle(x: sp.Expr) -> sp.Expr:
    """Return √(1 − x²), as a product that loses no digits for |x| near 1."""
    return sp.sqrt((1 - x) * (1 + x))


def _atan(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of atan u = atan2(u, 1)."""
    return angle(u, DiscreteDifference(sp.Integer(1), slope={}, steps=u.steps))


def angle(y: DiscreteDifference, x: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of atan2(y, x): the angle between w = (x, y) at the two ends.

    Its tangent is (w₀ × w₁)/(w₀ · w₁); the tangent of half the angle is (w₀ × w₁)/r, where r
    (``total``) = |w₀||w₁| + w₀·w₁ is |s|²/(2|w₀||w₁|) of the bisector s = |w₁|w₀ + |w₀|w₁: no
    digits cancel where w₁ is nearly −w₀. The mean is half the angle after the start: both are
    continuous where atan2 jumps by 2π; only atan2 itself differs there from its definition, no
    periodic function of it does.
    """
    y, x = y.with_shared_parts(), x.with_shared_parts()
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
    return DiscreteDifference(share(sp.atan2(y0, x0) + change / 2), slope, y.steps,
                              known_change=change)


# ---------------------------------------------------------------- hyperbolic functions


def _sinh(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of sinh u: mean sinh ū cosh h, factor cosh ū sinhc h."""
    return u.apply(sp.sinh(u.mean) * sp.cosh(u.half), sp.cosh(u.mean) * Sinhc(u.half))


def _cosh(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of cosh u: mean cosh ū cosh h, factor sinh ū sinhc h."""
    return u.apply(sp.cosh(u.mean) * sp.cosh(u.half), sp.sinh(u.mean) * Sinhc(u.half))


def _tanh(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of tanh u: factor sinhc(Δu)/(cosh u₁ cosh u₀)."""
    u0, u1 = u.ends
    return u.apply(_mean_of(sp.tanh, u), Sinhc(u.change) / (sp.cosh(u1) * sp.cosh(u0)))


def _asinh(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of asinh u: factor asinhc(h/r)/r with r = cosh(mean)."""
    mean = share(_mean_of(sp.asinh, u))
    c = share(sp.cosh(mean))
    return u.apply(mean, Asinhc(u.half / c) / c)


def _acosh(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of acosh u; r = √(u² − 1) is the hyperbolic sine of the angle."""
    return u.apply(_mean_of(sp.acosh, u),
                    _arc_slope(u, lambda x: sp.sqrt(x - 1) * sp.sqrt(x + 1), Atanhc))


def _atanh(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of atanh u: factor asinhc(Δu/r)/r, r = √(1 − u₁²) √(1 − u₀²)."""
    u0, u1 = u.ends
    g = share(_circle(u1) * _circle(u0))
    return u.apply(_mean_of(sp.atanh, u), Asinhc(u.change / g) / g)


#: ``differentiate`` of ``discrete_gradient``.
Differentiate = Callable[
    [sp.Expr, Mapping[sp.Symbol, DiscreteDifference], Sequence[sp.Expr]], DiscreteDifference]

HALF = sp.Rational(1, 2)


def _tilt(u: DiscreteDifference) -> sp.Expr:
    """Return the tilt ū/max(|ū|, |h|): ±1 if both ends are on one side of 0, 0 if both are 0."""
    h, side = sp.Abs(u.half), sp.sign(u.mean)
    # a u that does not change has h = 0, which is no divisor
    return share(Where(sp.Abs(u.mean), h, u.mean / h, side) if h != 0 else side)


def absolute(u: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of |u|: Δ|u| = τ Δu with the tilt τ, mean max(|ū|, |Δu/2|)."""
    u = u.with_shared_parts()
    difference = u.apply(Max(sp.Abs(u.mean), sp.Abs(u.half)), _tilt(u))
    return difference.with_ends(*map(sp.Abs, u.ends))


def extreme(
    function: type[Max | Min], u: DiscreteDifference, v: DiscreteDifference
) -> DiscreteDifference:
    """Return the difference of max(u, v) or min(u, v): ½(1 ± τ) Δu + ½(1 ∓ τ) Δv.

    max(u, v) = ½(u + v + |w|) with w = u − v, whose tilt is τ. The mean is ½(ū + v̄ ± |Δw/2|) if w
    changes its sign within the step, else the larger, or smaller, of ū and v̄.
    """
    u, v = u.with_shared_parts(), v.with_shared_parts()
    w = (u + v.become(-v.mean, factor=sp.Integer(-1))).with_shared_parts()
    sign = 1 if function is Max else -1
    tilt = sign * _tilt(w)
    u_share, v_share = share((1 + tilt) / 2), share((1 - tilt) / 2)
    mean = Where(sp.Abs(w.mean), sp.Abs(w.half), (u.mean + v.mean + sign * sp.Abs(w.half)) / 2,
                 function(u.mean, v.mean))
    zero = sp.Integer(0)
    slope = {i: _weighted(u_share, u.slope.get(i, zero)) + _weighted(v_share, v.slope.get(i, zero))
             for i in sorted(u.slope.keys() | v.slope.keys())}
    change = _weighted(u_share, u.change) + _weighted(v_share, v.change)
    difference = DiscreteDifference(share(mean), slope, u.steps, known_change=share(change))
    return difference.with_ends(*(function(*ends) for ends in zip(u.ends, v.ends, strict=True)))


def _weighted(weight: sp.Expr, e: sp.Expr) -> sp.Expr:
    """Return weight · e; 0 for the weight 0, even if e is infinite or NaN."""
    return weight * e if _is_finite(e) else Where(sp.Integer(0), weight, weight * e, sp.Integer(0))


def _is_finite(e: sp.Expr) -> bool:
    """Whether e is finite for all values of its symbols."""
    return all(
        node.is_Atom or node.is_Add or node.is_Mul
        or (node.is_Pow and node.exp.is_Integer and node.exp > 0)
        or isinstance(node, (Shared, Switch, sp.Abs, sp.sign))
        for node in parts_of([e]))


def choose_branch(
    a: DiscreteDifference, b: DiscreteDifference, x: DiscreteDifference, y: DiscreteDifference
) -> DiscreteDifference:
    """Return the difference of x where a < b and y elsewhere, for constant a and b.

    Mean, slopes, change and ends belong to the selected expression.
    """
    def select(below: sp.Expr, above: sp.Expr) -> sp.Expr:
        """Return ``below`` where a < b, ``above`` elsewhere."""
        return Where(a.mean, b.mean, below, above)

    zero = sp.Integer(0)
    slope = {i: select(x.slope.get(i, zero), y.slope.get(i, zero))
             for i in sorted(x.slope.keys() | y.slope.keys())}
    difference = DiscreteDifference(select(x.mean, y.mean), slope, x.steps,
                                    known_change=select(x.change, y.change))
    return difference.with_ends(*(select(*ends) for ends in zip(x.ends, y.ends, strict=True)))


def piecewise(
    pieces: PiecewiseForm, s: DiscreteDifference, differentiate: Differentiate
) -> DiscreteDifference:
    """Return the difference of f(s) = Σ_i f_i(c_i) + constant, where c_i is s clamped to piece i.

    Δf = Σ_i (Df_i)(Δc_i/Δs) Δs. If both ends of s are in one piece, all other Δc_i are 0, and
    their slopes, which may be infinite there, are not used.
    """
    s = s.with_shared_parts()
    factor, zero = sp.Integer(0), sp.Integer(0)
    limits = pairwise([None, *pieces.limits, None])
    for piece, (low, high) in zip(pieces.parts, limits, strict=True):
        if pieces.symbol not in piece.free_symbols:
            continue
        clamped = _clamp(s, low, high)
        slope = differentiate(piece, {pieces.symbol: clamped}, clamped.steps).slope[0]
        fraction = clamped.slope[0]  # Δc_i/Δs, the fraction of the step within the piece
        factor += slope if _is_finite(slope) else Where(zero, fraction, slope, zero)
    # NaN if low > high: the pieces would not be continuous there, and the result wrong
    for low, high in pieces.assumed:
        factor = Where(high, low, sp.sqrt(high - low), factor)
    end_values = [pieces.whole.xreplace({pieces.symbol: end}) for end in s.ends]
    return s.apply((end_values[0] + end_values[1]) / 2, factor).with_ends(*end_values)


def _clamp(s: DiscreteDifference, low: sp.Expr | None, high: sp.Expr | None) -> DiscreteDifference:
    """Return c = max(min(s, high), low), with its slope Δc/Δs; None stands for no limit."""
    step = (s.change,)  # s is the only variable
    clamped = DiscreteDifference(s.mean, {0: sp.Integer(1)}, step)
    if high is not None:
        clamped = extreme(Min, clamped, DiscreteDifference(high, slope={}, steps=step))
    if low is not None:
        clamped = extreme(Max, clamped, DiscreteDifference(low, slope={}, steps=step))
    return clamped


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
