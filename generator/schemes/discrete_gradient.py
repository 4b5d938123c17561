"""Discrete differentiation: a difference quotient that satisfies the chain rule exactly.

For end points x₀, x₁ with mean x̄ and difference Δx, every expression u carries

    mean(u) = (u₁ + u₀)/2      and      Du with  u₁ − u₀ = Σ_i (D_i u) Δx_i   exactly,

both written in x̄ and Δx. The rules below are identities of u₁ − u₀, not limits, so
ΔH = D_qH·Δq + D_pH·Δp holds to round-off, also for Δx → 0, with no 0/0 and no branch. All are
even in Δx: the gradient is symmetric under exchange of the end points, hence of even order.

    sum        Δ(u + v) = Δu + Δv
    product    Δ(uv)    = ū Δv + v̄ Δu,                      mean(uv) = ū v̄ + ¼ Δu Δv
    power      Δ(uⁿ)    = (Σ_k u₁ᵏ u₀ⁿ⁻¹⁻ᵏ) Δu              (by halves of n where n is large)
    reciprocal Δ(1/u)   = −Δu/(u₀u₁),                       mean(1/u) = ū/(u₀u₁)
    root       Δ(√u)    = Δu/(√u₁ + √u₀)

With h = Δu/2, the cardinal functions sinc(z) = sin(z)/z, sinhc, asinhc, atanc, atanhc likewise
(``cardinal_functions``; 1 at z = 0), and for what needs positive values g = √u₁√u₀,
ℓ = (h/g) asinhc(h/g), which is ½ Δ log u:

    exp        Δ(eᵘ)    = exp(ū) sinhc(h) Δu,               mean = exp(ū) cosh(h)
    log        Δ(log u) = asinhc(h/g)/g Δu,                 mean = log(g)
    real power Δ(uᶜ)    = c gᶜ⁻¹ sinhc(cℓ) asinhc(h/g) Δu,  mean = gᶜ cosh(cℓ)
    any power  Δ(uᵛ)    = Δ exp(v log u),                   Δ(aᵘ) = Δ exp(u log a)
    sin        Δ(sin u) = cos(ū) sinc(h) Δu,                mean = sin(ū) cos(h)
    cos        Δ(cos u) = −sin(ū) sinc(h) Δu,               mean = cos(ū) cos(h)
    tan        Δ(tan u) = sinc(Δu)/(cos u₁ cos u₀) Δu,      mean = sin(2ū)/(2 cos u₁ cos u₀)
    sinh       Δ(sinh u) = cosh(ū) sinhc(h) Δu,             mean = sinh(ū) cosh(h)
    cosh       Δ(cosh u) = sinh(ū) sinhc(h) Δu,             mean = cosh(ū) cosh(h)
    tanh       Δ(tanh u) = sinhc(Δu)/(cosh u₁ cosh u₀) Δu

Inverse functions f have mean(f) = (f(u₁) + f(u₀))/2 unless stated otherwise. From half the
angle between the ends, tan(½ Δθ) = sin(Δθ)/(1 + cos(Δθ)), which no branch of the arc tangent
disturbs:

    asin, acos Δ = ±2 atanc(Δu/r)/r Δu,   r = √(1 − u₁²) + √(1 − u₀²)
    atan2(v,u) Δ = 2 atanc(k/r)/r k,      k = ū Δv − v̄ Δu, r = |ρ₁w₀ + ρ₀w₁|²/(2ρ₀ρ₁) with
                                          w = (u, v) and ρ = |w|;  mean = atan2(v₀, u₀) + Δ/2
    atan       as atan2(u, 1)
    acosh      Δ = 2 atanhc(Δu/r)/r Δu,   r = √(u₁² − 1) + √(u₀² − 1)
    asinh      Δ = asinhc(h/r)/r Δu,      r = cosh(mean); by atanh it has no digits from −u to u
    atanh      Δ = asinhc(Δu/r)/r Δu,     r = √(1 − u₁²) √(1 − u₀²)

Functions with two sides have these of where the ends lie, with h = Δu/2 and the tilt
τ(u) = ū/max(|ū|, |h|), which is ±1 where both ends lie on one side of 0 and ū/|h| else:

    |u|        Δ|u|      = τ(u) Δu,                         mean = max(|ū|, |h|)
    max        Δmax(u,v) = ½(1 + τ) Δu + ½(1 − τ) Δv,       τ = τ(u − v); min with −τ
    pieces     Δf(s)     = Σ_i Δf_i(c_i),                   c_i = min(max(s, b_(i−1)), b_i)

where f is f_i from b_(i−1) to b_i and continuous (``piecewise``). A quotient is not formed where
its denominator is 0: a side is taken, and no digit is lost where both ends lie on it.

Where u has no square root or logarithm at an end, the value is no number, as H itself is none.
Powers whose exponent is not a known multiple of ½ take positive u only; tanh takes |Δu| < 700 in
double, for sinh overflows beyond. Means and changes that a function uses more than once are
shared parts (``shared_subexpressions``): nested functions cost their number.

Shared parts of H are visited once: each has a mean and a change, Du goes backward
from the whole through them, as a gradient does.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from functools import partial, reduce

import sympy as sp

from ...core.errors import InputError
from ..parsing.tokens import shorten
from ..symbolic.piecewise import NotPiecewiseError, piecewise_form_of, selects_side
from ..symbolic.shared_subexpressions import Shared, parts_of, share, substitute
from ..symbolic.switching_functions import Max, Min, Where
from .discrete_functions import (
    FUNCTIONS,
    DiscreteDifference,
    angle,
    chosen,
    exponential,
    extreme,
    logarithm,
    piecewise,
    power,
)

__all__ = ["DiscreteDifference", "differentiate", "discrete_gradient"]


def discrete_gradient(
    expression: sp.Expr,
    symbols: Sequence[sp.Symbol],
    means: Sequence[sp.Symbol],
    differences: Sequence[sp.Symbol],
) -> list[sp.Expr]:
    """Return D_i of the expression for each symbol, in terms of means and differences.

    Parameters
    ----------
    expression : Expr
        Built from the symbols and parameters with +, ×, /, powers and the functions above.
    symbols, means, differences : sequences of Symbol
        x, and the names to use for x̄ and Δx.

    Raises
    ------
    InputError
        If the expression contains a function without a known exact difference.
    """
    steps = list(differences)
    leaves = {
        symbol: DiscreteDifference(mean, {i: sp.Integer(1)}, steps)
        for i, (symbol, mean) in enumerate(zip(symbols, means, strict=True))
    }
    parts = [part for part in parts_of([expression]) if isinstance(part, Shared)]
    names = {part: sp.Symbol(f"_part{i}", real=True) for i, part in enumerate(parts)}
    *bodies, whole = substitute([*(part.args[0] for part in parts), expression], names)
    found = []
    for symbol, body in zip(names.values(), bodies, strict=True):
        part = differentiate(body, leaves, steps)
        change = share(part.change)
        leaves[symbol] = DiscreteDifference(share(part.mean), {len(steps): sp.Integer(1)}, steps,
                                            change,
                                            part.known_ends)
        found.append(part)
        steps.append(change)
    return _backward(differentiate(whole, leaves, steps), found, len(symbols))


def _backward(
    whole: DiscreteDifference, parts: Sequence[DiscreteDifference], count: int
) -> list[sp.Expr]:
    """Return D of the whole by ``count`` symbols; behind these, its slopes are those by parts."""
    terms: dict[int, list[sp.Expr]] = {i: [d] for i, d in whole.slope.items()}
    for i, part in reversed([*enumerate(parts, count)]):
        weight = share(sp.Add(*terms.get(i, ())))
        for j, d in part.slope.items():
            terms.setdefault(j, []).append(weight * d)
    return [sp.Add(*terms.get(i, ())) for i in range(count)]


def differentiate(
    u: sp.Expr, leaves: Mapping[sp.Symbol, DiscreteDifference], dx: Sequence[sp.Expr]
) -> DiscreteDifference:
    """Return mean and slope of u by recursion over its expression tree, each part once."""
    return _Walk(u, leaves, dx)(u)


class _Walk:
    """The differences of an expression's parts."""

    def __init__(
        self, u: sp.Expr, leaves: Mapping[sp.Symbol, DiscreteDifference], dx: Sequence[sp.Expr]
    ) -> None:
        self.known: dict[sp.Expr, DiscreteDifference] = dict(leaves)
        self.symbols, self.dx = set(leaves), dx
        self.stepping = self._with_steps(u)

    def __call__(self, e: sp.Expr) -> DiscreteDifference:
        """Return the difference of e."""
        if e not in self.known:
            if e.free_symbols.isdisjoint(self.symbols):
                self.known[e] = DiscreteDifference(e, {}, self.dx)
            elif e in self.stepping:
                self.known[e] = self._of_steps(e)
            else:
                self.known[e] = self._combined(e)
        return self.known[e]

    def _combined(self, e: sp.Expr) -> DiscreteDifference:
        _refuse_unknown(e)
        return _combine(e, list(map(self, e.args)))

    # ------------------------------------------------------------ conditions

    def _with_steps(self, u: sp.Expr) -> set[sp.Basic]:
        """Return all parts of u that contain a condition, sign or floor of the symbols."""
        found: set[sp.Basic] = set()
        for part in parts_of([u]):
            if selects_side(part, self.symbols) or not found.isdisjoint(part.args):
                found.add(part)
        return found

    def _of_steps(self, e: sp.Expr) -> DiscreteDifference:
        """Return the difference of what contains a condition: of pieces, if it has any.

        In a product or sum it is what depends on the same symbols that has them together:
        x H(x) is continuous, and Heaviside's H(x) is not.
        """
        try:
            pieces = piecewise_form_of(e, self.symbols)
        except NotPiecewiseError as reason:
            together = self._together(e) if e.is_Add or e.is_Mul else e
            if together == e and (selects_side(e, self.symbols) or e.is_Add or e.is_Mul):
                raise _not_piecewise(e, reason) from None
            if together == e:
                return self._combined(e)
            self.stepping.add(together)
            rest = [a for a in e.args if a not in e.func.make_args(together)]
            return _combine(e, [self(together), *map(self, rest)])
        return piecewise(pieces, self(pieces.variable), differentiate)

    def _together(self, e: sp.Expr) -> sp.Expr:
        """Return the sum or product of those arguments that depend on no more than the first does
        that contains a condition.
        """
        moving = {a: a.free_symbols & self.symbols for a in e.args}
        first = min((a for a in e.args if a in self.stepping),
                    key=lambda a: len(moving[a]))
        return e.func(*(a for a in e.args if moving[a] and moving[a] <= moving[first]
                        and (e.is_Mul or a in self.stepping)))


def _refuse_unknown(e: sp.Expr) -> None:
    if e.is_Add or e.is_Mul or e.is_Pow or e.func in FUNCTIONS or e.func in _OF_MORE:
        return
    raise InputError(
        f"No exact difference is known for {e.func.__name__!r} in {e}; the discrete gradient takes "
        "sums, products, quotients, powers, sqrt, atan2, Abs, Max, Min, Piecewise in one variable "
        f"and {', '.join(sorted(f.__name__ for f in FUNCTIONS if f is not sp.Abs))}: write H with "
        "these, or choose IMS or a SPARK method."
    )


def _not_piecewise(e: sp.Expr, reason: NotPiecewiseError) -> InputError:
    return InputError(
        f"No exact difference is known for {shorten(str(e), 200)}: {reason}. The discrete gradient "
        "takes pieces in one variable that meet, for all parameters, where their conditions "
        "change; write it so, or with Abs, Max and Min, or choose IMS or a SPARK method."
    )


#: Functions of several arguments with a rule; a ``Where`` here depends on parameters.
_OF_MORE: Mapping[type[sp.Expr], Callable[..., DiscreteDifference]] = {
    sp.atan2: angle, Max: partial(extreme, Max), Min: partial(extreme, Min), Where: chosen,
}


def _combine(e: sp.Expr, parts: list[DiscreteDifference]) -> DiscreteDifference:
    """Return the difference of e from those of its arguments."""
    if e.is_Add:
        return parts[0].plus(*parts[1:])
    if e.is_Mul:
        return reduce(operator.mul, parts)
    if e.is_Pow:
        return _power(*parts)
    if e.func in _OF_MORE:
        return _OF_MORE[e.func](*parts)
    return FUNCTIONS[e.func](parts[0].shared())


def _power(base: DiscreteDifference, exponent: DiscreteDifference) -> DiscreteDifference:
    if not exponent.slope:
        return power(base, exponent.mean)
    if not base.slope:
        return exponential(exponent, base.mean)
    return exponential(exponent * logarithm(base))
