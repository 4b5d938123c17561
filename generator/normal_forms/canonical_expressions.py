"""Canonical forms of single expressions: one for all equivalent expressions.

A form depends on the order of the symbols of the expression, not on their names: equal forms of
different bodies are computed once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction

import sympy as sp

from ..symbolic.shared_subexpressions import parts_of
from .expansion import NormalForm, TooLongError, rebuilt
from .products_of_sums import Power, split_off_powers
from .shortest_sum import Compact, cost
from .terms import (
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

__all__ = ["CanonicalForms", "costs_less"]

#: The given form is selected if it costs less than this part of the derived one.
_CLEARLY_LESS = 0.7
#: Limits of products of terms: at least, for each expanded subexpression, for each term whose short
#: form is sought. Bodies and springs need a third of them.
_LEAST, _FOR_A_PART, _FOR_A_TERM = 2000, 25, 200


class CanonicalForms:
    """Canonical forms of expressions in placeholders, with a cache."""

    def __init__(self) -> None:
        self._form = NormalForm(self.expression)
        self.compact = Compact(self._form)
        self._known: dict[sp.Expr, sp.Expr] = {}
        self._terms: dict[sp.Expr, Terms] = {}

    def expression(self, e: sp.Expr) -> sp.Expr:
        """Return the canonical form of an expression that is not split further."""
        if e.is_Symbol or e.is_Rational:
            return e
        own = local_names(e.free_symbols)
        e = e.xreplace(own)
        if e not in self._known:
            written = self.normal_form(e)
            found = self._shortest(self.terms(e))
            self._known[e] = written if costs_less([written], [found]) else found
        return self._known[e].xreplace({x: s for s, x in own.items()})

    def terms(self, e: sp.Expr) -> Terms:
        """Return the terms of an expression: itself where expansion takes too long."""
        if e not in self._terms:
            try:
                with self._form.allowed(_LEAST + _FOR_A_PART * sum(1 for _ in parts_of([e]))):
                    self._terms[e] = self._form(e)
            except TooLongError:
                self._terms[e] = {frozenset([(self.normal_form(e), 1)]): 1}
        return self._terms[e]

    def short(self, terms: Terms) -> sp.Expr:
        """Return terms in their shortest form."""
        own = local_names(symbols_in(terms))
        renamed = {frozenset((base.xreplace(own), n if isinstance(n, int) else n.xreplace(own))
                             for base, n in m): a for m, a in terms.items()}
        return self._shortest(renamed).xreplace({x: s for s, x in own.items()})

    def powers(
        self, terms: Terms, momenta: frozenset[sp.Symbol] | None = None
    ) -> tuple[list[Power], Terms]:
        """Return powers of sums, of momenta if these are given, and the remaining terms."""
        try:
            with self._form.allowed(_LEAST + _FOR_A_TERM * len(terms)):
                return split_off_powers(terms, self.compact, momenta)
        except TooLongError:
            return [], terms

    def _shortest(self, terms: Terms) -> sp.Expr:
        try:
            with self._form.allowed(_LEAST + _FOR_A_TERM * len(terms)):
                found = self.compact(terms)
        except TooLongError:
            found = expression_of(terms)
        powers = [x for x in found.atoms(sp.Pow, sp.exp) if not x.exp.is_Rational]
        return found.xreplace({x: x.as_base_exp()[0] ** self.expression(x.exp) for x in powers})

    # ------------------------------------------------------------ what was written

    def normal_form(self, e: sp.Expr) -> sp.Expr:
        """Return an expression as given, with its subexpressions in canonical form."""
        if e.is_Add:
            return sp.Add(*map(self.normal_form, e.args))
        if e.is_Mul:
            return sp.Mul(*map(self._factor, e.args))
        return self._factor(e)

    def _factor(self, e: sp.Expr) -> sp.Expr:
        if e.is_Float and e.is_finite:
            return rational(fraction(e))
        if not (e.is_Add or e.is_Pow):
            return rebuilt(e, self.expression)
        base, exponent = e.as_base_exp()
        base, exponent = self.expression(base), self.expression(exponent)
        if not (base.is_Add and exponent.is_Integer):
            return base**exponent
        value, inner = primitive(base)
        value, n = quotient(Fraction(value) ** int(exponent), 1), int(exponent)
        if n > 0 and value.numerator % 2**n == 0 and all(map(is_bilinear, inner.args)):
            value, inner = quotient(value, 2**n), 2 * inner
        # evaluated, a number would go into the sum
        return sp.Mul(rational(value), inner**exponent, evaluate=False)


def costs_less(written: Sequence[sp.Expr], found: Sequence[sp.Expr]) -> bool:
    """Whether the given expressions cost clearly less than the derived ones."""
    return cost(written) < _CLEARLY_LESS * cost(found)


def is_bilinear(e: sp.Expr) -> bool:
    """Whether an expression is a number times two different variables."""
    factors = sp.Mul.make_args(e.as_coeff_Mul()[1])
    return len(factors) == 2 and all(x.is_Symbol and varies(x) for x in factors)


def local_names(symbols: Iterable[sp.Symbol]) -> dict[sp.Symbol, sp.Symbol]:
    """Return placeholders numbered from 0, in the same order: equal forms get equal names."""
    found = {}
    counts = {True: 0, False: 0}
    for x in sorted(symbols, key=lambda x: x.name):
        found[x] = placeholder(counts[varies(x)], varies(x), frozenset(x.assumptions0.items()))
        counts[varies(x)] += 1
    return found
