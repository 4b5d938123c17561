"""Canonical forms of single expressions: one for all equivalent expressions.

A form depends on the order of the symbols of the expression, not on their names: equal forms of
different bodies are computed once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction

import sympy as sp

from ..symbolic.shared_subexpressions import parts_of, substitute
from .expansion import NormalForm, TooLongError, rebuilt
from .products_of_sums import Power, split_off_powers
from .shortest_sum import Compact, cost
from .terms import (
    Monomial,
    Terms,
    expression_of,
    fraction,
    placeholder,
    primitive,
    quotient,
    rational,
    symbols_in,
    varies,
)

__all__ = ["CanonicalForms", "costs_less", "local_names"]

#: The original form is selected if it costs less than this fraction of the derived one.
_CLEARLY_LESS = 0.7
#: Limits of the number of products of terms: the minimum, and the increments for each subexpression
#: that is expanded and for each term of a sum that is shortened. Bodies and springs need a third.
_MIN_PRODUCTS, _PER_SUBEXPRESSION, _PER_TERM = 2000, 25, 200


class CanonicalForms:
    """Canonical forms of expressions in placeholders, with a cache."""

    def __init__(self) -> None:
        """Make the normal form and the search of short forms, and empty tables of their results."""
        self._form = NormalForm(self.expression)
        self.compact = Compact(self._form)
        self._canonical: dict[sp.Expr, sp.Expr] = {}
        self._terms: dict[sp.Expr, Terms] = {}

    def expression(self, e: sp.Expr) -> sp.Expr:
        """Return the canonical form of an expression as a whole, not split into addends.

        Symbols are renamed by their order before, so that equal forms of different bodies hit the
        cache.
        """
        if e.is_Symbol or e.is_Rational:
            return e
        renaming = local_names(e.free_symbols)
        e = substitute([e], renaming)[0]
        if e not in self._canonical:
            original_form = self.normal_form(e)
            derived_form = self._shortest(self.terms(e))
            is_cheaper = costs_less([original_form], [derived_form])
            self._canonical[e] = original_form if is_cheaper else derived_form
        return substitute([self._canonical[e]], {x: s for s, x in renaming.items()})[0]

    def terms(self, e: sp.Expr) -> Terms:
        """Return the terms of an expression; if its expansion takes too long, e as one term."""
        if e not in self._terms:
            try:
                subexpressions = sum(1 for _ in parts_of([e]))
                with self._form.allow_products(_MIN_PRODUCTS + _PER_SUBEXPRESSION * subexpressions):
                    self._terms[e] = self._form(e)
            except TooLongError:
                self._terms[e] = {frozenset([(self.normal_form(e), 1)]): 1}
        return self._terms[e]

    def short(self, terms: Terms) -> sp.Expr:
        """Return terms in their shortest form."""
        renaming = local_names(symbols_in(terms))

        def rename(m: Monomial) -> Monomial:
            """Return a monomial in local symbols; an exponent may contain symbols, too."""
            return frozenset((base.xreplace(renaming),
                              n if isinstance(n, int) else n.xreplace(renaming)) for base, n in m)

        local_terms = {rename(m): a for m, a in terms.items()}
        return substitute([self._shortest(local_terms)], {x: s for s, x in renaming.items()})[0]

    def powers(
        self, terms: Terms, momenta: frozenset[sp.Symbol] | None = None
    ) -> tuple[list[Power], Terms]:
        """Return powers of sums and the remaining terms; see ``split_off_powers``."""
        try:
            with self._form.allow_products(_MIN_PRODUCTS + _PER_TERM * len(terms)):
                return split_off_powers(terms, self.compact, momenta)
        except TooLongError:
            return [], terms

    def _shortest(self, terms: Terms) -> sp.Expr:
        """Return the shortest form of a sum of terms that a bounded search finds."""
        try:
            with self._form.allow_products(_MIN_PRODUCTS + _PER_TERM * len(terms)):
                shortest = self.compact(terms)
        except TooLongError:
            shortest = expression_of(terms)
        # exponents with symbols are sums of terms: these are shortened, too
        powers = [x for x in shortest.atoms(sp.Pow, sp.exp) if not x.exp.is_Rational]
        return shortest.xreplace({x: x.as_base_exp()[0] ** self.expression(x.exp) for x in powers})

    # ------------------------------------------------------------ the original form

    def normal_form(self, e: sp.Expr) -> sp.Expr:
        """Return the original expression with its subexpressions in canonical form."""
        if e.is_Add:
            return sp.Add(*map(self.normal_form, e.args))
        if e.is_Mul:
            return sp.Mul(*map(self._factor, e.args))
        return self._factor(e)

    def _factor(self, e: sp.Expr) -> sp.Expr:
        """Return a factor in normal form: decimals exact, sums primitive, numbers in front."""
        if e.is_Float and e.is_finite:
            return rational(fraction(e))
        if not (e.is_Add or e.is_Pow):
            return rebuilt(e, self.expression)
        base, exponent = e.as_base_exp()
        base, exponent = self.expression(base), self.expression(exponent)
        if not (base.is_Add and exponent.is_Integer):
            return base**exponent
        n = int(exponent)
        factor, coprime_sum = primitive(base)
        factor = quotient(Fraction(factor) ** n, 1)
        # 2ⁿ (x y)ⁿ becomes (2 x y)ⁿ, as in ``absorb_factor_two``
        if n > 0 and factor.numerator % 2**n == 0 and all(map(is_bilinear, coprime_sum.args)):
            factor, coprime_sum = quotient(factor, 2**n), 2 * coprime_sum
        # evaluated, a number would go into the sum
        return sp.Mul(rational(factor), coprime_sum**exponent, evaluate=False)


def costs_less(original: Sequence[sp.Expr], derived: Sequence[sp.Expr]) -> bool:
    """Whether the original expressions cost clearly less than the derived ones."""
    return cost(original) < _CLEARLY_LESS * cost(derived)


def is_bilinear(e: sp.Expr) -> bool:
    """Whether an expression is a number times two different variables."""
    factors = sp.Mul.make_args(e.as_coeff_Mul()[1])
    return len(factors) == 2 and all(x.is_Symbol and varies(x) for x in factors)


def local_names(symbols: Iterable[sp.Symbol]) -> dict[sp.Symbol, sp.Symbol]:
    """Return placeholders numbered from 0 for symbols, in order: equal forms get equal names."""
    renaming = {}
    counts = {True: 0, False: 0}
    for x in sorted(symbols, key=lambda x: x.name):
        renaming[x] = placeholder(counts[varies(x)], varies(x), frozenset(x.assumptions0.items()))
        counts[varies(x)] += 1
    return renaming
