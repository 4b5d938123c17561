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
    multiply_monomials,
    plain_exponent,
    primitive,
    quotient,
    rational,
    scale_terms,
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
        self._expanded: dict[sp.Expr, Terms] = {}

    @contextmanager
    def allow_products(self, products: int) -> Iterator[None]:
        """Set the allowance inside a ``with`` block; the previous one is restored afterwards."""
        previous, self.allowance = self.allowance, products
        try:
            yield
        finally:
            self.allowance = previous

    def spend(self, products: int) -> None:
        """Subtract from the allowance; raises ``TooLongError`` if it is exhausted."""
        self.allowance -= products
        if self.allowance < 0:
            raise TooLongError

    def __call__(self, e: sp.Expr) -> Terms:
        """Return the terms of an expression, divided by the sums in their denominators."""
        terms = self.terms(e)
        while True:  # a quotient by one sum may be divisible by another
            sums = {base for m in terms for base, n in m if is_below(base, n)}
            undivided = terms
            for base in sorted(sums, key=base_key):
                terms = self._divide_by_sum(terms, base)
            if terms == undivided:
                return terms

    def terms(self, e: sp.Expr) -> Terms:
        """Return the terms without division."""
        if e not in self._expanded:
            self._expanded[e] = self._terms(e)
        return self._expanded[e]

    def _terms(self, e: sp.Expr) -> Terms:
        """Return an expression as terms: sums and products expanded, functions as atoms."""
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
        canonical = rebuilt(e, self.canonical)
        if canonical.func == e.func:
            return {frozenset([(canonical, 1)]): 1}
        return self.terms(canonical)  # sin(−x) has become −sin(x)

    # ------------------------------------------------------------ products

    def product(self, factors: Iterable[Terms]) -> Terms:
        """Return the product."""
        product = constant(1)
        for factor in sorted(factors, key=len):  # short factors first: short intermediate products
            product = self._times(product, factor)
        return product

    def power(self, base: Terms, n: int) -> Terms:
        """Return baseⁿ for n ≥ 0, by repeated squaring."""
        # k terms to the power n have up to C(k + n − 1, n) terms: refuse before computing them. For
        # n beyond the allowance, n alone refuses them: the binomial would take long.
        self.spend(math.comb(len(base) + n - 1, n) if n <= self.allowance else n)
        power = constant(1)
        for bit in f"{n:b}":  # from the highest bit of n
            power = self._times(power, power)
            if bit == "1":
                power = self._times(power, base)
        return power

    def _times(self, a: Terms, b: Terms) -> Terms:
        """Return the product of two sums, term by term, within the limit of work."""
        self.spend(len(a) * len(b))
        product: Terms = {}
        expanded_products: list[Terms] = []
        for m_a, x in a.items():
            for m_b, y in b.items():
                monomial, coefficient, sum_powers = multiply_monomials(m_a, m_b)
                coefficient = quotient(x * y * coefficient, 1) if coefficient != 1 else x * y
                if sum_powers:  # √u √u = u, which is expanded again
                    powers = (self.power(self.terms(base), n) for base, n in sum_powers)
                    expanded_products.append(self.product([{monomial: coefficient}, *powers]))
                else:
                    add_to(product, monomial, coefficient)
        return total_of(product, *expanded_products) if expanded_products else product

    # ------------------------------------------------------------ denominators, roots, other powers

    def _power(self, base: sp.Expr, exponent: sp.Expr) -> Terms:
        """Return base^exponent as terms; sums in denominators and roots stay atoms."""
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
        power = base**exponent  # SymPy takes out factors, as (4 x)^½ = 2 √x
        if (power.is_Pow or isinstance(power, sp.exp)) and power.as_base_exp() == (base, exponent):
            return power_of_atom(base, exponent)
        return self.product(
            self._power(*factor.as_base_exp()) if factor.is_Pow else self.terms(factor)
            for factor in sp.Mul.make_args(power))

    def _sum_power(self, base: sp.Expr, exponent: sp.Rational) -> Terms:
        """Return a power of a sum, with common numbers and denominators taken out of the sum.

        (a Σ m/d)ⁿ = aⁿ d⁻ⁿ (Σ m)ⁿ. Roots of variable sums keep their denominators d, and a factor
        leaves a root only if it is positive.
        """
        inner = self.terms(base)
        clears_denominators = exponent.is_Integer or not varies(base)
        outer = ONE
        if clears_denominators:
            outer = denominators(inner, only_positive=not exponent.is_Integer)
        if outer:
            cleared = self._times(inner, {inverse(outer): 1})
            factors = [self._power(b, n * exponent) for b, n in outer]
            return self.product([*factors, self._power(expression_of(cleared), exponent)])
        content, inner_sum = primitive(base)
        if content < 0 and not exponent.is_Integer:
            content, inner_sum = -content, -inner_sum
        # u^(5/2) = u² u^(1/2): the integer part is expanded, the root stays a base
        integer_part = max(int(sp.floor(exponent)), 0)
        factors = [power_of_atom(rational(content), exponent),
                   {frozenset([(inner_sum, plain_exponent(exponent - integer_part))]): 1}]
        if integer_part:
            factors.append(self.power(self.terms(inner_sum), integer_part))
        return self.product(factors)

    # ------------------------------------------------------------ division

    def _divide_by_sum(self, terms: Terms, base: sp.Expr) -> Terms:
        """Return the terms after division by the sum b = ``base``, wherever it is a denominator.

        With b = a l + r and its leading monomial l: l bⁿ = (bⁿ⁺¹ − r bⁿ)/a for n < 0. A monomial
        m = l · cofactor with b in its denominator becomes cofactor · (head + tail), head = b/a and
        tail = −r/a.
        """
        inner = self.terms(base)
        lead = leading(inner)
        if lead is None:
            return terms
        tail = scale_terms({m: c for m, c in inner.items() if m != lead}, quotient(-1, inner[lead]))
        head: Terms = {frozenset([(base, 1)]): quotient(1, inner[lead])}
        quotient_terms = dict(terms)
        # A term of the quotient may be divisible again: one of the head has less of b in the
        # denominator, one of the tail comes later in the order of ``leading``. Where r has terms
        # that this order leaves out, as √2 x² in x + √2 x², the allowance of products ends it.
        waiting = [m for m in quotient_terms if has_below(m, base) and divides(lead, m)]
        while waiting:
            m = waiting.pop()
            if m not in quotient_terms:
                continue
            # nothing is split off: l has whole powers of bases that are neither sums nor numbers
            cofactor: Terms = {multiply_monomials(m, inverse(lead)).monomial: quotient_terms.pop(m)}
            expanded = total_of(self._times(cofactor, head), self._times(cofactor, tail))
            for monomial, c in expanded.items():
                add_to(quotient_terms, monomial, c)
                if has_below(monomial, base) and divides(lead, monomial):
                    waiting.append(monomial)
        return quotient_terms


def constant(number: Number) -> Terms:
    """Return a number as terms."""
    return {ONE: number} if number else {}


def power_of_atom(base: sp.Expr, exponent: sp.Expr) -> Terms:
    """Return base^exponent of an atom: a symbol, a function, a sum or a rational number.

    A rational number is split into prime factors: √12 = 2 √3.
    """
    if not base.is_Rational or not exponent.is_Rational:
        return {frozenset([(base, plain_exponent(exponent))] if exponent != 0 else []): 1}
    if exponent.is_Integer:
        return constant(fraction(base**exponent))
    # (Π pⁿ)^x = Π p^⌊n x⌋ Π p^(n x − ⌊n x⌋), of which the second product is of roots
    roots: dict[sp.Expr, Any] = {}
    rational_factor = sp.Integer(1)
    for prime, n in sp.factorrat(base).items():
        integer_part = math.floor(n * exponent)
        rational_factor *= sp.Integer(prime) ** integer_part
        if n * exponent != integer_part:
            roots[sp.Integer(prime)] = n * exponent - integer_part
    return {frozenset(roots.items()): fraction(rational_factor)}


def has_below(m: Monomial, base: sp.Expr) -> bool:
    """Whether a monomial has the sum ``base`` in the denominator."""
    return any(b == base and is_below(b, n) for b, n in m)


def denominators(terms: Terms, *, only_positive: bool) -> Monomial:
    """Return the common denominator of a sum: its bases with their lowest negative powers."""
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
