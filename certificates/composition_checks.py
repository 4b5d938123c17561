"""The checks of a composition by ``gyrospark verify --scheme splitting``, line by line.

Sums, symmetry and the flattening are rational arithmetic, order conditions interval arithmetic, the
force gradient exact algebra. The order is measured beside, on two pendulums.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from fractions import Fraction
from functools import cache
from itertools import product
from typing import Any

import mpmath as mp
import sympy as sp

from ..generator.tableaux.compositions import COMPOSITIONS, Composition, flatten
from ..generator.tableaux.conditions import Condition
from .composition_order import observed_composition_order
from .composition_proofs import STORED, OrderConditions, as_mpf, intervals
from .lyndon_words import (
    Series,
    drift_flow,
    evaluate_flow,
    factors_of,
    kick_flow,
    lyndon_words,
    multiply_flows,
    target,
)

__all__ = ["check_composition", "error_constant", "force_gradient_residuals", "step_coefficients"]

#: Bound of residuals at stored numbers: 10^8 units of their last decimal.
_SMALL = Fraction(1, 10 ** (STORED - 8))


def check_composition(composition: Composition) -> list[Condition]:
    """Return the lines on a composition and on its base; these begin with the base's name.

    A base is the step S of the product S(w_1 h) … S(w_s h); "Strang" has no order condition.
    """
    lines = [*_exact_conditions(composition), *_conditions(composition)]
    if composition.base in COMPOSITIONS and composition.base != "Strang":
        base = COMPOSITIONS[composition.base]
        lines += _conditions(base, f"{base.name}: ")
    return [*lines, _order_in_letters(composition), _symplectic(composition),
            *_measure_order(composition)]


def _exact_conditions(composition: Composition) -> Iterator[Condition]:
    """Yield the conditions that are checked in rational arithmetic: sums, symmetry, flattening."""
    drifts, kicks, gradients = composition.drifts, composition.kicks, composition.gradients
    stored = (drifts, kicks, gradients)
    largest_error = max(abs(sum(coefficients, Fraction(0)) - 1) for coefficients in (drifts, kicks))
    yield _condition_on_error(
        "consistency", "sum a_i = sum b_i = 1", largest_error, f"{len(kicks)} stages")
    yield _condition_on_error(
        "symmetry", "a, b and c are palindromes",
        _largest_difference(stored, [coefficients[::-1] for coefficients in stored]),
        "forward" if composition.forward else "with negative times")
    if composition.base:
        flattened = flatten(COMPOSITIONS[composition.base], composition.weights)
        yield _condition_on_error(
            "composition", f"product of {composition.base}(w_i h), drifts joined",
            _largest_difference(flattened, stored), f"{len(composition.weights)} weights")


def _largest_difference(
    left: Sequence[Sequence[Fraction]], right: Sequence[Sequence[Fraction]]
) -> Fraction:
    """Return the largest |x − y| of entries of lists of coefficients."""
    return max(abs(x - y) for xs, ys in zip(left, right, strict=True)
               for x, y in zip(xs, ys, strict=True))


def _condition_on_error(name: str, equation: str, error: Fraction, result: str) -> Condition:
    """Return a condition in rational arithmetic, which holds if its ``error`` is exactly 0."""
    return Condition(name, equation, result, holds=error == 0, required=True,
                     residual="0" if error == 0 else f"{float(error):.1e}")


def _conditions(composition: Composition, name: str = "") -> Iterator[Condition]:
    """Yield each order condition at the stored numbers, and the proof of a solution near them.

    ``name`` begins the names of the lines.
    """
    conditions = OrderConditions(composition)
    # stored numbers are rounded to 60 digits: residuals are small, and the zero is beside them
    for word, residual in zip(conditions.words, conditions.residuals(), strict=True):
        with intervals() as interval:
            small = abs(residual) < interval(_SMALL)
        yield Condition(f"{name}order condition {word}", f"coefficient {target(word)}",
                        _interval_text(residual), holds=bool(small), residual=_size(residual),
                        required=True)
    if conditions.words:
        box = conditions.enclose()
        distance = None if box is None else max(
            _size_of(exact - stored)
            for exact, stored in zip(box, _enclose_unknowns(conditions), strict=True))
        yield Condition(
            f"{name}exact solution", "Krawczyk's operator on the box of 1e-40",
            "none is proved" if distance is None else
            f"one and only one, within {mp.nstr(distance, 2)} of the stored numbers",
            holds=distance is not None, residual="0" if distance is not None else "not proved",
            required=True)


def _enclose_unknowns(conditions: OrderConditions) -> list[Any]:
    """Return enclosures of the stored unknowns of a composition, which are rational numbers."""
    with intervals() as interval:
        return [interval(value) for value in conditions.unknowns]


def _size_of(interval: Any) -> Any:
    """Return the largest |x| in an interval of mpmath: of its ends a and b."""
    return max(abs(mp.mpf(interval.a)), abs(mp.mpf(interval.b)))


def _size(interval: Any) -> str:
    """Return the largest |x| in an interval as text of two digits."""
    return str(mp.nstr(_size_of(interval), 2))


def _interval_text(interval: Any) -> str:
    """Return an interval in three digits, rounded outwards."""
    bound_texts = [Context(prec=3, rounding=rounding).create_decimal(mp.nstr(mp.mpf(end), STORED))
                   for end, rounding in ((interval.a, ROUND_FLOOR), (interval.b, ROUND_CEILING))]
    return "[{:.2e}, {:.2e}]".format(*bound_texts)


def _order_in_letters(composition: Composition) -> Condition:
    """Check the order of the drifts and kicks as written out, at all Lyndon words of A and B."""
    # the order is even: by symmetry, the conditions of this grade follow from those below
    words = lyndon_words("AB", composition.order - 1)
    with intervals() as interval:
        series = step_coefficients(composition, words, interval)
        sizes = [_size_of(series[word] - interval(target(word))) for word in words]
        largest = max(sizes)
        holds = largest < as_mpf(_SMALL)
    return Condition(
        "order", f"{len(words)} Lyndon words of drifts A and kicks B, to h^{composition.order}",
        " ".join(map(str, composition.orders)), holds=bool(holds), residual=mp.nstr(largest, 2),
        required=True)


def step_coefficients(composition: Composition, words: list[str], as_number: Any) -> Series:
    """Return the coefficients of a step at ``words`` of A (drift) and B (kick).

    The step is exp(a₀ A) exp(b₁ B + c₁ [B, [A, B]]) exp(a₁ A) …; ``as_number`` turns its weights,
    fractions, into the numbers that are multiplied.
    """
    longest = max(map(len, words))
    drift, kick = drift_flow(longest), kick_flow(longest, composition.has_gradients)
    # a step begins and ends with a drift: one more of them than of kicks
    series = [evaluate_flow(drift, [as_number(composition.drifts[0])], as_number)]
    for a, b, c in zip(composition.drifts[1:], composition.kicks, composition.gradients,
                       strict=True):
        arguments = [as_number(b), as_number(c)] if composition.has_gradients else [as_number(b)]
        series += [evaluate_flow(kick, arguments, as_number),
                   evaluate_flow(drift, [as_number(a)], as_number)]
    return multiply_flows(series, factors_of(words), as_number)[-1]


def error_constant(composition: Composition) -> float:
    """Return ‖e‖₂, e the error's coefficients at all words of order + 1 letters A and B.

    The error of a step is h^{order+1} Σ_w e_w w to leading order, a sum of nested commutators.
    """
    words = ["".join(word) for word in product("AB", repeat=composition.order + 1)]
    series = step_coefficients(composition, words, float)
    return float(sum((series[word] - float(target(word))) ** 2 for word in words) ** 0.5)


def _symplectic(composition: Composition) -> Condition:
    """Check the Hamiltonians of the composition's flows: T, and b V − c h² G, which has no p.

    Kicks are exact only if −G = {V, {T, V}} is free of p. It is, for every T quadratic in p and any
    V: the identity is checked for functions, and is the same for all compositions.
    """
    residuals = force_gradient_residuals() if composition.has_gradients else ()
    holds = all(residual == 0 for residual in residuals)
    kicks = "b V - c h^2 G(q), -G = {V, {T, V}}" if composition.has_gradients else "b V(q)"
    return Condition("symplecticity", f"drifts are flows of T, kicks of {kicks}",
                     "each flow is symplectic" if holds else "a kick depends on p", holds=holds,
                     residual="0" if holds else "not 0", required=True)


@cache
def force_gradient_residuals() -> tuple[sp.Expr, ...]:
    """Return the residuals of the identities behind kicks with a force gradient, all 0.

    For functions V(q) and T = pᵀM(q)p/2 + d(q)·p in two degrees of freedom:
    {{V, T}, V} + V_qᵀ M V_q, the derivatives of {{V, T}, V} by p, and
    [B, [A, B]] f − {f, {{V, T}, V}} with A = {·, T} and B = {·, V}, for each coordinate and
    momentum f: commutators of derivations are derivations, which these values determine.
    """
    q, p = sp.symbols("q0:2"), sp.symbols("p0:2")
    V = sp.Function("V")(*q)
    M = sp.Matrix(2, 2, lambda i, j: sp.Function(f"M{min(i, j)}{max(i, j)}")(*q))
    d = [sp.Function(f"d{i}")(*q) for i in range(2)]
    T = sum(M[i, j] * p[i] * p[j] for i in range(2) for j in range(2)) / 2 + sum(
        x * y for x, y in zip(d, p, strict=True))

    def bracket(f: Any, g: Any) -> Any:
        """Return {f, g} = f_q·g_p − f_p·g_q."""
        return sum(f.diff(x) * g.diff(y) - f.diff(y) * g.diff(x)
                   for x, y in zip(q, p, strict=True))

    def commutator(X: Any, Y: Any, function: Any) -> Any:
        """Return [X, Y] f = X(Y f) − Y(X f)."""
        return X(Y(function)) - Y(X(function))

    def A(function: Any) -> Any:
        """Return the derivative of a function along the drift."""
        return bracket(function, T)

    def B(function: Any) -> Any:
        """Return the derivative of a function along the kick."""
        return bracket(function, V)

    # {V, T} is linear in p, so that {{V, T}, V} has no p
    VTV = sp.expand(bracket(bracket(V, T), V))
    G = sum(V.diff(q[i]) * M[i, j] * V.diff(q[j]) for i in range(2) for j in range(2))
    return (sp.expand(VTV + G), *(VTV.diff(y) for y in p),
            *(sp.expand(commutator(B, lambda function: commutator(A, B, function), f)
                        - bracket(f, VTV)) for f in (*q, *p)))


def _measure_order(composition: Composition) -> Iterator[Condition]:
    """Yield the slopes on a small problem, and the error constant."""
    measured_orders = [(composition.order, False, "order, measured")]
    if len(composition.orders) > 1:  # a higher order in the terms with one kick, of small V
        measured_orders.append((composition.orders[0], True, "order in small kicks, measured"))
    for order, one_kick, name in measured_orders:
        slope = observed_composition_order(composition, one_kick)
        yield Condition(name, "log2 of the local error's ratio for h, h/2, less 1",
                        f"{slope:.3f}", holds=abs(slope - order) < 0.1,
                        residual=f"{slope - order:.1e}", required=True)
    constant = error_constant(composition)
    yield Condition("error constant",
                    f"norm of the error's coefficients at words of h^{composition.order + 1}",
                    f"{constant:.3e}", holds=constant > 0, residual="the order is no higher")
