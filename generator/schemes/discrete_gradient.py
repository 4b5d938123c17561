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

Inverse functions f have mean(f) = (f(u₁) + f(u₀))/2 unless stated otherwise. They use half the
angle between the ends, tan(½ Δθ) = sin(Δθ)/(1 + cos(Δθ)), which has no branch cut within a step:

    asin, acos Δ = ±2 atanc(Δu/r)/r Δu,   r = √(1 − u₁²) + √(1 − u₀²)
    atan2(v,u) Δ = 2 atanc(k/r)/r k,      k = ū Δv − v̄ Δu, r = |ρ₁w₀ + ρ₀w₁|²/(2ρ₀ρ₁) with
                                          w = (u, v) and ρ = |w|;  mean = atan2(v₀, u₀) + Δ/2
    atan       as atan2(u, 1)
    acosh      Δ = 2 atanhc(Δu/r)/r Δu,   r = √(u₁² − 1) + √(u₀² − 1)
    asinh      Δ = asinhc(h/r)/r Δu,      r = cosh(mean); a form with atanh cancels from −u to u
    atanh      Δ = asinhc(Δu/r)/r Δu,     r = √(1 − u₁²) √(1 − u₀²)

Functions with a switch depend on the sides of the ends, with h = Δu/2 and the tilt
τ(u) = ū/max(|ū|, |h|), which is ±1 if both ends are on one side of 0 and ū/|h| otherwise:

    |u|        Δ|u|      = τ(u) Δu,                         mean = max(|ū|, |h|)
    max        Δmax(u,v) = ½(1 + τ) Δu + ½(1 − τ) Δv,       τ = τ(u − v); min with −τ
    pieces     Δf(s)     = Σ_i Δf_i(c_i),                   c_i = min(max(s, b_(i−1)), b_i)

where f is f_i from b_(i−1) to b_i and continuous (``piecewise``). Where a denominator is 0, the
branch without a quotient is selected; no digit is lost if both ends are on one side.

If u has no square root or logarithm at an end, the value is NaN, as of H itself. Powers whose
exponent is not a multiple of ½ need u > 0; tanh needs |Δu| < 700 in double, as sinh overflows
beyond. Means and changes that a function uses more than once are shared subexpressions
(``shared_subexpressions``), so that the cost of nested functions is proportional to their number.

Shared subexpressions of H are visited once: each has a mean and a change, and D is propagated
backward from H through them, as in reverse-mode differentiation.
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
    choose_branch,
    exponential,
    extreme,
    logarithm,
    piecewise,
    power,
)

__all__ = ["DiscreteDifference", "differentiate", "discrete_gradient"]


def discrete_gradient(
    expression: sp.Expr, symbols: Sequence[sp.Symbol], means: Sequence[sp.Symbol],
    differences: Sequence[sp.Symbol]
) -> list[sp.Expr]:
    """Return D_i u of the expression u for each symbol x_i, in terms of means and differences.

    u₁ − u₀ = Σ_i (D_i u) Δx_i holds exactly for the values u₀ and u₁ at the ends.

    Parameters
    ----------
    expression : Expr
        Built from the symbols and parameters with +, ×, /, powers and the functions in the
        docstring of this module.
    symbols, means, differences : sequences of Symbol
        x, and the symbols of x̄ and Δx, in the same order.

    Raises
    ------
    InputError
        If the expression contains a function without a known exact difference.
    """
    steps = list(differences)
    # variables, by their means and D_i x_i = 1: first the symbols, then shared subexpressions
    leaves = {
        symbol: DiscreteDifference(mean, {i: sp.Integer(1)}, steps)
        for i, (symbol, mean) in enumerate(zip(symbols, means, strict=True))
    }
    nodes = [node for node in parts_of([expression]) if isinstance(node, Shared)]
    names = {node: sp.Symbol(f"_part{i}", real=True) for i, node in enumerate(nodes)}
    *arguments, root = substitute([*(node.args[0] for node in nodes), expression], names)
    node_differences = []
    for symbol, argument in zip(names.values(), arguments, strict=True):
        difference = differentiate(argument, leaves, steps)
        change = share(difference.change)
        # a shared subexpression is one more variable, with the step ``change``
        leaves[symbol] = DiscreteDifference(share(difference.mean), {len(steps): sp.Integer(1)},
                                            steps, known_change=change,
                                            known_ends=difference.known_ends)
        node_differences.append(difference)
        steps.append(change)
    return _propagate_backward(differentiate(root, leaves, steps), node_differences, len(symbols))


def _propagate_backward(
    root: DiscreteDifference, node_differences: Sequence[DiscreteDifference], count: int
) -> list[sp.Expr]:
    """Return D of the root by the ``count`` symbols, by the chain rule through shared nodes.

    D_j = Σ_i D_i · slope_j(node i), from the last node to the first. Slope i ≥ count of a
    difference is the slope by shared node i − count.
    """
    terms: dict[int, list[sp.Expr]] = {i: [d] for i, d in root.slope.items()}
    for i, difference in reversed([*enumerate(node_differences, count)]):
        adjoint = share(sp.Add(*terms.get(i, ())))
        for j, d in difference.slope.items():
            terms.setdefault(j, []).append(adjoint * d)
    return [sp.Add(*terms.get(i, ())) for i in range(count)]


def differentiate(
    u: sp.Expr, leaves: Mapping[sp.Symbol, DiscreteDifference], dx: Sequence[sp.Expr]
) -> DiscreteDifference:
    """Return mean and slope of u by recursion over its subexpressions, each visited once."""
    return _Differences(u, leaves, dx)(u)


class _Differences:
    """The differences of the subexpressions of u."""

    def __init__(
        self, u: sp.Expr, leaves: Mapping[sp.Symbol, DiscreteDifference], dx: Sequence[sp.Expr]
    ) -> None:
        """Keep the differences of the leaves; ``dx`` are the increments of the variables."""
        self.differences: dict[sp.Expr, DiscreteDifference] = dict(leaves)
        self.symbols, self.dx = set(leaves), dx
        self.conditional = self._conditional_nodes(u)

    def __call__(self, e: sp.Expr) -> DiscreteDifference:
        """Return the difference of e."""
        if e not in self.differences:
            if e.free_symbols.isdisjoint(self.symbols):
                self.differences[e] = DiscreteDifference(e, slope={}, steps=self.dx)
            elif e in self.conditional:
                self.differences[e] = self._conditional_difference(e)
            else:
                self.differences[e] = self._combine_arguments(e)
        return self.differences[e]

    def _combine_arguments(self, e: sp.Expr) -> DiscreteDifference:
        """Return the difference of e by the rule of its function."""
        _refuse_unknown(e)
        return _combine(e, list(map(self, e.args)))

    # ------------------------------------------------------------ conditions

    def _conditional_nodes(self, u: sp.Expr) -> set[sp.Basic]:
        """Return all subexpressions of u with a condition, sign or floor of the symbols."""
        conditional: set[sp.Basic] = set()
        for node in parts_of([u]):
            if selects_side(node, self.symbols) or not conditional.isdisjoint(node.args):
                conditional.add(node)
        return conditional

    def _conditional_difference(self, e: sp.Expr) -> DiscreteDifference:
        """Return the difference of an expression with conditions, by its pieces.

        In a product or sum, the arguments of the same symbols are combined first: x H(x) is
        continuous, Heaviside's H(x) is not.
        """
        try:
            pieces = piecewise_form_of(e, self.symbols)
        except NotPiecewiseError as reason:
            # the pieces of a part may be known where the pieces of the whole are not
            has_parts = e.is_Add or e.is_Mul
            joint = self._joint_argument(e) if has_parts else e
            if joint == e and (has_parts or selects_side(e, self.symbols)):
                raise _piecewise_error(e, reason) from None
            if joint == e:  # a function of an argument with conditions
                return self._combine_arguments(e)
            self.conditional.add(joint)
            other_arguments = [a for a in e.args if a not in e.func.make_args(joint)]
            return _combine(e, [self(joint), *map(self, other_arguments)])
        return piecewise(pieces, self(pieces.variable), differentiate)

    def _joint_argument(self, e: sp.Expr) -> sp.Expr:
        """Return the part of a sum or product that depends on the symbols of one argument only.

        e is a sum or product whose own pieces are not known; pieces of a smaller part may be. The
        argument is the one with a condition that depends on the fewest symbols. Of a sum the part
        has conditional terms alone; of a product it has all factors of these symbols.
        """
        symbols_of = {a: a.free_symbols & self.symbols for a in e.args}
        simplest = min((a for a in e.args if a in self.conditional),
                       key=lambda a: len(symbols_of[a]))
        joint = [a for a in e.args if symbols_of[a] and symbols_of[a] <= symbols_of[simplest]]
        # x H(x) is continuous though H(x) is not: a factor without a condition stays with the
        # others; such a term of a sum makes nothing continuous, and has a rule of its own
        return e.func(*(a for a in joint if e.is_Mul or a in self.conditional))


def _refuse_unknown(e: sp.Expr) -> None:
    """Refuse a function without a rule for its exact difference."""
    if e.is_Add or e.is_Mul or e.is_Pow or e.func in FUNCTIONS or e.func in _MULTIVARIATE:
        return
    raise InputError(f"No exact difference is known for {e.func.__name__!r} in {e}; the discrete "
                     "gradient takes sums, products, quotients, powers, sqrt, atan2, Abs, Max, "
                     "Min, Piecewise in one variable and "
                     f"{', '.join(sorted(f.__name__ for f in FUNCTIONS if f is not sp.Abs))}: "
                     "write H with these, or choose IMS or a SPARK method.")


def _piecewise_error(e: sp.Expr, reason: NotPiecewiseError) -> InputError:
    """Return the error of a function without an exact difference, with the reason."""
    return InputError(
        f"No exact difference is known for {shorten(str(e), 200)}: {reason}. The discrete gradient "
        "takes pieces in one variable that meet, for all parameters, where their conditions "
        "change; write it so, or with Abs, Max and Min, or choose IMS or a SPARK method."
    )


#: Functions of several arguments with a rule; the condition of a ``Where`` is constant here.
_MULTIVARIATE: Mapping[type[sp.Expr], Callable[..., DiscreteDifference]] = {
    sp.atan2: angle, Max: partial(extreme, Max), Min: partial(extreme, Min), Where: choose_branch,
}


def _combine(e: sp.Expr, arguments: list[DiscreteDifference]) -> DiscreteDifference:
    """Return the difference of e from the differences of its arguments."""
    if e.is_Add:
        return arguments[0].plus(*arguments[1:])
    if e.is_Mul:
        return reduce(operator.mul, arguments)
    if e.is_Pow:
        return _power(*arguments)
    if e.func in _MULTIVARIATE:
        return _MULTIVARIATE[e.func](*arguments)
    return FUNCTIONS[e.func](arguments[0].with_shared_parts())


def _power(base: DiscreteDifference, exponent: DiscreteDifference) -> DiscreteDifference:
    """Return the difference of base**exponent; as exp(exponent log base) if both change."""
    if not exponent.slope:
        return power(base, exponent.mean)
    if not base.slope:
        return exponential(exponent, base.mean)
    return exponential(exponent * logarithm(base))
