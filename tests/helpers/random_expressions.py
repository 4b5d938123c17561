"""Random nested expressions, and how accurately their difference can be computed at all.

The size that an error is compared with must not depend on the formulas under test. It comes from
the expression u itself. Every part v of u is known at both ends only by two rounded numbers, its
mean and its change; 64 eps of the *largest term* means: of the largest change of u₁ − u₀ that
comes from changing one of these by as much as itself,

    largest term = max over the parts v of  V |w₁ − w₀| + M |w̄|

with w = ∂u/∂v at either end, V = max(|v₁|, |v₀|) and M the size of v₁ − v₀ before its terms
cancel (|Δx_i| at a variable, then by the rules of sums and products, times |Δf/Δu| at a function).
Both terms vanish with Δx: the digits of a small change count, not those of u. In particular it is
at least |D_i Δx_i| of whatever D the product and chain rule lead to.
"""

from __future__ import annotations

import math
from typing import Any

import mpmath as mp
import sympy as sp
from hypothesis import strategies as st

from gyrospark.generator.symbolic.shared_subexpressions import parts_of
from gyrospark.generator.symbolic.switching_functions import Max, Min

X = sp.symbols("x0:4", real=True)
PARAMETERS = sp.symbols("a b", positive=True)
TINY = 2.0**-1022

THIRD = sp.Rational(1, 3)
NUMBERS = [sp.Integer(2), sp.Integer(-3), THIRD, sp.Rational(5, 4)]
LEAVES = st.one_of(st.sampled_from(X), st.sampled_from(X), st.sampled_from([*PARAMETERS, *NUMBERS]))
EXPONENTS = [*map(sp.Integer, (-4, -2, -1, 2, 3, 4, 5, 7, 9, 12, 25)), sp.Rational(-3, 2),
             sp.Rational(5, 2)]
REAL_EXPONENTS = [THIRD, sp.Rational(-7, 10), sp.Rational(12, 5), PARAMETERS[0], -PARAMETERS[1]]
ANYWHERE = [sp.exp, sp.sin, sp.cos, sp.tan, sp.atan, sp.sinh, sp.cosh, sp.tanh, sp.asinh, sp.Abs]
ALLOWED = {*ANYWHERE, sp.log, sp.asin, sp.acos, sp.acosh, sp.atanh, sp.atan2, Max, Min}


def grow(inner: Any) -> Any:
    """Return expressions one level deeper; half of those with a domain stay inside it."""
    pairs = st.tuples(inner, inner)
    positive = st.one_of(inner, inner.map(lambda e: 1 + e**2), inner.map(sp.exp))
    below_one = st.one_of(inner, inner.map(sp.tanh), inner.map(lambda e: e / (1 + e**2)))
    return st.one_of(
        pairs.map(lambda t: t[0] + t[1]),
        pairs.map(lambda t: t[0] - t[1]),
        pairs.map(lambda t: t[0] * t[1]),
        pairs.map(lambda t: t[0] / t[1]),
        st.tuples(inner, st.sampled_from(EXPONENTS)).map(lambda t: t[0] ** t[1]),
        st.tuples(st.sampled_from(ANYWHERE), inner).map(lambda t: t[0](t[1])),
        st.tuples(st.sampled_from(ANYWHERE), inner).map(lambda t: t[0](t[1])),
        st.tuples(st.sampled_from([sp.log, sp.sqrt, lambda e: sp.acosh(1 + e)]),
                  positive).map(lambda t: t[0](t[1])),
        st.tuples(positive, st.sampled_from(REAL_EXPONENTS)).map(lambda t: t[0] ** t[1]),
        st.tuples(positive, inner).map(lambda t: t[0] ** t[1]),
        st.tuples(st.sampled_from([sp.asin, sp.acos, sp.atanh]), below_one).map(
            lambda t: t[0](t[1])),
        pairs.map(lambda t: sp.atan2(*t)),
        st.tuples(st.sampled_from([Max, Min]), inner, inner).map(lambda t: t[0](*t[1:])),
    )


def is_usable(e: sp.Expr) -> bool:
    """Whether e depends on X and SymPy left its form, unlike |x| of √x²."""
    return not e.free_symbols.isdisjoint(X) and all(
        node.is_Symbol or node.is_Add or node.is_Mul or node.is_Pow or node.func in ALLOWED
        or (node.is_number and node.is_real and node.is_finite and not node.args)
        for node in parts_of([e]))


EXPRESSIONS = st.recursive(LEAVES, grow, max_leaves=8).filter(is_usable)

# ---------------------------------------------------------------- values in doubles


def _cardinal(function: Any) -> Any:
    """Return a cardinal function as templates/cardinal.c.jinja writes it."""
    return lambda z: function(abs(z) + TINY) / (abs(z) + TINY)


_IN_DOUBLES = {name: getattr(math, name) for name in (
    "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh",
    "asinh", "acosh", "atanh")} | {
    name.capitalize() + "c": _cardinal(getattr(math, name))
    for name in ("sinh", "asinh", "atan", "atanh")} | {
        "Sinc": _cardinal(math.sin), "Shared": lambda value: value, "Abs": abs,
        "sign": lambda u: (u > 0) - (u < 0), "Max": max, "Min": min,
        "Where": lambda a, b, x, y: x if a < b else y}


def in_doubles(expressions: Any, values: dict[sp.Basic, float]) -> list[float]:
    """Evaluate in double precision, each part once; NaN where there is no value, as in C."""
    evaluated: dict[sp.Basic, float] = dict(values)
    for e in parts_of(expressions):
        if e not in evaluated:
            try:
                evaluated[e] = _in_doubles(e, [evaluated[a] for a in e.args])
            except (ValueError, ZeroDivisionError):
                evaluated[e] = math.nan
    return [evaluated[e] for e in expressions]


def _in_doubles(e: sp.Basic, arguments: list[float]) -> float:
    if e.is_Add:
        return sum(arguments[1:], arguments[0])
    if e.is_Mul:
        return math.prod(arguments[1:], start=arguments[0])
    if e.is_Pow and e.exp == sp.Rational(1, 2):
        return math.sqrt(arguments[0])
    if e.is_Pow and e.exp == -1:
        return 1 / arguments[0]
    if e.is_Pow:
        return math.pow(*arguments)
    return float(e) if e.is_number else _IN_DOUBLES[e.func.__name__](*arguments)


# ---------------------------------------------------------------- the largest term

_DERIVATIVES = {
    "exp": mp.exp, "log": lambda u: 1 / u, "sin": mp.cos, "cos": lambda u: -mp.sin(u),
    "tan": lambda u: 1 + mp.tan(u) ** 2, "asin": lambda u: 1 / mp.sqrt(1 - u * u),
    "acos": lambda u: -1 / mp.sqrt(1 - u * u), "atan": lambda u: 1 / (1 + u * u),
    "sinh": mp.cosh, "cosh": mp.sinh, "tanh": lambda u: 1 / mp.cosh(u) ** 2,
    "asinh": lambda u: 1 / mp.sqrt(1 + u * u), "acosh": lambda u: 1 / mp.sqrt(u * u - 1),
    "atanh": lambda u: 1 / (1 - u * u), "Abs": mp.sign,
}


def partials(e: sp.Basic, arguments: list[Any], value: Any) -> list[Any]:
    """Return ∂e/∂argument, in mpmath."""
    if e.is_Add:
        return [mp.mpf(1)] * len(arguments)
    if e.is_Mul:
        return [mp.fprod(arguments[:i] + arguments[i + 1 :]) for i in range(len(arguments))]
    if e.is_Pow:
        base, exponent = arguments
        by_base = exponent * mp.power(base, exponent - 1) if exponent != 1 else mp.mpf(1)
        return [by_base, value * mp.log(base) if not e.exp.is_number else mp.mpf(0)]
    if e.func == sp.atan2:
        y, x = arguments
        return [x / (x * x + y * y), -y / (x * x + y * y)]
    if e.func in (Max, Min):
        return [mp.mpf(a == value) for a in arguments]
    return [_DERIVATIVES[e.func.__name__](*arguments)]


def largest_term(e: sp.Expr, ends: list[dict[sp.Basic, Any]], sizes: dict[sp.Basic, Any]) -> Any:
    """Return the largest term of u₁ − u₀ from the values of all parts at the ends and |Δx|."""
    parts = list(parts_of([e]))
    size = dict(sizes)  # M of every part
    slopes = {}
    for part in parts:
        if not part.args:
            size.setdefault(part, mp.mpf(0))
            continue
        end_slopes = [partials(part, [end[a] for a in part.args], end[part]) for end in ends]
        slopes[part] = end_slopes
        (low, high) = (end[part] for end in ends)
        changes = [ends[1][a] - ends[0][a] for a in part.args]
        if len(part.args) == 1 or (part.is_Pow and not size[part.args[1]]):
            factor = (high - low) / changes[0] if changes[0] else end_slopes[0][0]
            size[part] = abs(factor) * size[part.args[0]]
        else:
            # the change itself where the ends do not show it: vectors that pass by the origin
            size[part] = max(abs(high - low), mp.fsum(max(abs(w0), abs(w1)) * size[a]
                             for a, w0, w1 in zip(part.args, *end_slopes, strict=True)))
    weights: list[dict[sp.Basic, Any]] = [dict.fromkeys(parts, mp.mpf(0)) for _ in ends]
    for k, weight in enumerate(weights):
        weight[e] = mp.mpf(1)
        for part in reversed(parts):
            for a, w in zip(part.args, slopes[part][k] if part.args else (), strict=True):
                weight[a] += weight[part] * w
    return max(
        max(abs(end[part]) for end in ends) * abs(weights[1][part] - weights[0][part])
        + size[part] * abs(weights[1][part] + weights[0][part]) / 2
        for part in parts if part.args or part in sizes)


# ---------------------------------------------------------------- where doubles have a value

#: How far an argument is from the edge of its function's domain.
_MARGINS = {"log": abs, "asin": lambda u: 1 - abs(u), "acos": lambda u: 1 - abs(u),
            "acosh": lambda u: u - 1, "atanh": lambda u: 1 - abs(u), "Abs": abs}


def margin(e: sp.Basic, arguments: list[Any]) -> Any:
    """Return the distance of the arguments of e from where e has no value."""
    if e.is_Pow:
        base, exponent = e.args
        is_polynomial = exponent.is_Integer and exponent > 0
        return mp.inf if is_polynomial or base.is_number else abs(arguments[0])
    if e.func == sp.atan2:
        return max(map(abs, arguments))
    if e.func in (Max, Min):
        return abs(arguments[0] - arguments[1])
    return _MARGINS.get(e.func.__name__, lambda u: mp.inf)(arguments[0])


def keeps_off_edges(e: sp.Expr, ends: list[dict[sp.Basic, Any]], tolerance: float) -> bool:
    """Whether doubles can tell on which side of the edges of their domains all arguments are.

    tanh(25) is 1 in doubles, which has no atanh. A part v is as uncertain as ``tolerance`` times

        N(v) = max(|v₁|, |v₀|, Σ_a |∂v/∂a| N(a))    over its arguments a.
    """
    sizes: dict[sp.Basic, Any] = {}
    for part in parts_of([e]):
        sizes[part] = max(abs(end[part]) for end in ends)
        if not part.args:
            continue
        values = [[end[a] for a in part.args] for end in ends]
        reach = max(sizes[a] for a in part.args)
        if min(margin(part, v) for v in values) <= tolerance * reach:
            return False
        slopes = zip(*(partials(part, v, end[part]) for v, end in zip(values, ends, strict=True)),
                     strict=True)
        carried = mp.fsum(max(map(abs, end_slopes)) * sizes[a]
                          for a, end_slopes in zip(part.args, slopes, strict=True))
        sizes[part] = max(sizes[part], carried)
    return True
