"""Expansion of expressions: the same terms for all equivalent expressions.

Arguments of functions, denominators and radicands are in canonical form
(``canonical_expressions``), so that equal subexpressions are equal objects. Terms are divided by
the sums in their denominators: x/(1 + x) and 1 − 1/(1 + x) have the same terms.

The number of products is bounded: beyond it ``TooLongError`` is raised.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import sympy as sp

from .terms import (
    ONE,
    Monomial,
    Number,
    Terms,
    add_to,
    base_key,
    divides,
    expression_of,
    fraction,
    inverse,
    is_below,
    leading,
    merged,
    plain_exponent,
    primitive,
    quotient,
    rational,
    scaled,
    total_of,
    varies,
)

__all__ = ["NormalForm", "TooLongError", "rebuilt"]


class TooLongError(Exception):
    """Expansion takes more products of terms than allowed."""


class NormalForm:
    """Expansion of expressions, each subexpression once.

    Parameters
    ----------
    canonical : function
        Returns the canonical form of an argument, a denominator or a radicand.

    Attributes
    ----------
    allowance : int
        Remaining number of products of terms.
    """

    def __init__(self, canonical: Callable[[sp.Expr], sp.Expr]) -> None:
        self.canonical = canonical
        self.allowance = 0
        self._known: dict[sp.Expr, Terms] = {}

    @contextmanager
    def allowed(self, products: int) -> Iterator[None]:
        """Set the allowance for a while; the previous one is restored afterwards."""
        before, self.allowance = self.allowance, products
        try:
            yield
        finally:
            self.allowance = before

    def spend(self, products: int) -> None:
        """Take from the allowance."""
        self.allowance -= products
        if self.allowance < 0:
            raise TooLongError

    def __call__(self, e: sp.Expr) -> Terms:
        """Return the terms of an expression, divided by the sums in their denominators."""
        terms = self.terms(e)
        while True:  # what was divided by one sum may be divided by another again
            sums = {base for m in terms for base, n in m if is_below(base, n)}
            before = terms
            for base in sorted(sums, key=base_key):
                terms = self._divided(terms, base)
            if terms == before:
                return terms

    def terms(self, e: sp.Expr) -> Terms:
        """Return the terms without division."""
        if e not in self._known:
            self._known[e] = self._terms(e)
        return self._known[e]

    def _terms(self, e: sp.Expr) -> Terms:
        if e.is_Rational or (e.is_Float and e.is_finite):
            return constant(fraction(e))
        if e.is_Symbol:
            return {frozenset([(e, 1)]): 1}
        if e.is_Add:
            return total_of(*map(self.terms, e.args))
        if e.is_Mul:
            return self.product(map(self.terms, e.args))
        if e.is_Pow or isinstance(e, sp.exp):
            return self._power(*e.as_base_exp())
        made = rebuilt(e, self.canonical)
        if made.func == e.func:
            return {frozenset([(made, 1)]): 1}
        return self.terms(made)  # sin(−x) has become −sin(x)

    # ------------------------------------------------------------ products

    def product(self, factors: Iterable[Terms]) -> Terms:
        """Return the product."""
        made = constant(1)
        for factor in sorted(factors, key=len):
            made = self._times(made, factor)
        return made

    def power(self, base: Terms, n: int) -> Terms:
        """Return a whole power."""
        self.spend(math.comb(len(base) + n - 1, n) if n <= self.allowance else n)
        made = constant(1)
        for bit in f"{n:b}":
            made = self._times(made, made)
            if bit == "1":
                made = self._times(made, base)
        return made

    def _times(self, a: Terms, b: Terms) -> Terms:
        self.spend(len(a) * len(b))
        made: Terms = {}
        longer: list[Terms] = []
        for left, x in a.items():
            for right, y in b.items():
                found, value, sums = merged(left, right)
                value = quotient(x * y * value, 1) if value != 1 else x * y
                if sums:  # √u √u has become u
                    powers = (self.power(self.terms(base), n) for base, n in sums)
                    longer.append(self.product([{found: value}, *powers]))
                else:
                    add_to(made, found, value)
        return total_of(made, *longer) if longer else made

    # ------------------------------------------------------------ bars, roots, other powers

    def _power(self, base: sp.Expr, exponent: sp.Expr) -> Terms:
        if exponent.is_Float and exponent.is_finite:
            exponent = rational(fraction(exponent))
        if exponent.is_Integer and exponent > 0:
            return self.power(self.terms(base), int(exponent))
        if not exponent.is_Rational:
            exponent = expression_of(self(exponent))  # such exponents are added
        if base is not sp.E:
            base = self.canonical(base)
        if base.is_Add and exponent.is_Rational:
            return self._sum_power(base, exponent)
        value = base**exponent  # SymPy takes out of it what may be taken out
        if (value.is_Pow or isinstance(value, sp.exp)) and value.as_base_exp() == (base, exponent):
            return power_of_atom(base, exponent)
        return self.product(
            self._power(*factor.as_base_exp()) if factor.is_Pow else self.terms(factor)
            for factor in sp.Mul.make_args(value))

    def _sum_power(self, base: sp.Expr, exponent: sp.Rational) -> Terms:
        """Return a power of a sum without common numbers and denominators."""
        inner = self.terms(base)
        may_split = exponent.is_Integer or not varies(base)
        outer = denominators(inner, only_positive=not exponent.is_Integer) if may_split else ONE
        if outer:
            cleared = self._times(inner, {inverse(outer): 1})
            factors = [self._power(b, n * exponent) for b, n in outer]
            return self.product([*factors, self._power(expression_of(cleared), exponent)])
        value, inner_sum = primitive(base)
        if value < 0 and not exponent.is_Integer:
            value, inner_sum = -value, -inner_sum
        whole = max(int(sp.floor(exponent)), 0)
        factors = [power_of_atom(rational(value), exponent),
                   {frozenset([(inner_sum, plain_exponent(exponent - whole))]): 1}]
        if whole:
            factors.append(self.power(self.terms(inner_sum), whole))
        return self.product(factors)

    # ------------------------------------------------------------ division

    def _divided(self, terms: Terms, base: sp.Expr) -> Terms:
        """Return the terms after division by a sum wherever it is a denominator.

        With b = a l + r and its leading term l, l bⁿ = (bⁿ⁺¹ − r bⁿ)/a for n < 0.
        """
        inner = self.terms(base)
        lead = leading(inner)
        if lead is None:
            return terms
        rest = scaled({m: b for m, b in inner.items() if m != lead}, quotient(-1, inner[lead]))
        once: Terms = {frozenset([(base, 1)]): quotient(1, inner[lead])}
        made = dict(terms)
        waiting = [m for m in made if has_below(m, base) and divides(lead, m)]
        while waiting:
            m = waiting.pop()
            if m not in made:
                continue
            part: Terms = {merged(m, inverse(lead))[0]: made.pop(m)}
            for found, b in total_of(self._times(part, once), self._times(part, rest)).items():
                add_to(made, found, b)
                if has_below(found, base) and divides(lead, found):
                    waiting.append(found)
        return made


def constant(value: Number) -> Terms:
    """Return a number as terms."""
    return {ONE: value} if value else {}


def power_of_atom(base: sp.Expr, exponent: sp.Expr) -> Terms:
    """Return a power of an atom; of a number, by its prime factors."""
    if not base.is_Rational or not exponent.is_Rational:
        return {frozenset([(base, plain_exponent(exponent))] if exponent != 0 else []): 1}
    if exponent.is_Integer:
        return constant(fraction(base**exponent))
    roots: dict[sp.Expr, Any] = {}
    value = sp.Integer(1)
    for prime, n in sp.factorrat(base).items():
        whole = math.floor(n * exponent)
        value *= sp.Integer(prime) ** whole
        if n * exponent != whole:
            roots[sp.Integer(prime)] = n * exponent - whole
    return {frozenset(roots.items()): fraction(value)}


def has_below(m: Monomial, base: sp.Expr) -> bool:
    """Whether a monomial has a sum in the denominator."""
    return any(b == base and is_below(b, n) for b, n in m)


def denominators(terms: Terms, *, only_positive: bool) -> Monomial:
    """Return the product of all symbols in denominators of a sum, as negative powers."""
    lowest: dict[sp.Expr, int] = {}
    for m in terms:
        for base, n in m:
            if isinstance(n, int) and n < 0 and (base.is_positive or not only_positive):
                lowest[base] = min(n, lowest.get(base, 0))
    return frozenset(lowest.items())


def rebuilt(e: sp.Basic, canonical: Callable[[sp.Expr], sp.Expr]) -> Any:
    """Return e with its largest subexpressions in canonical form."""
    if not e.args:
        return e
    return e.func(*(canonical(a) if isinstance(a, sp.Expr) else rebuilt(a, canonical)
                    for a in e.args))
