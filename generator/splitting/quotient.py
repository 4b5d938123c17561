"""Normal forms of polynomials modulo x² = e, for symbols x of which no e contains any.

The leading monomials x² are powers of different symbols, so that the relations are a Gröbner basis
of their ideal: a polynomial is in the ideal if and only if its normal form is 0. Functions, roots
and denominators are treated as symbols, with their arguments in normal form; an expression with
them is in the ideal if its normal form is 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import sympy as sp

from ..normal_forms.expansion import NormalForm, TooLongError
from ..normal_forms.terms import Terms, add_to, expression_of

__all__ = ["Quotient", "unit_quaternions"]

#: Largest number of products of terms; a longer expression raises ``TooLongError``.
_MAX_PRODUCTS = 200_000


def unit_quaternions(quaternions: Sequence[Sequence[sp.Symbol]]) -> dict[sp.Symbol, sp.Expr]:
    """Return the relations q₀² = 1 − q₁² − q₂² − q₃²."""
    return {q[0]: 1 - q[1]**2 - q[2]**2 - q[3]**2 for q in quaternions}


class Quotient:
    """The polynomials modulo x² = e.

    Parameters
    ----------
    squares : mapping of Symbol to Expr
        e of each x.
    """

    def __init__(self, squares: Mapping[sp.Symbol, sp.Expr]) -> None:
        self._form = NormalForm(self._argument)
        with self._form.allow_products(_MAX_PRODUCTS):
            self._squares = {x: self._form.terms(e) for x, e in squares.items()}

    def terms(self, e: sp.Expr) -> Terms:
        """Return the normal form as terms.

        Raises TooLongError if it takes too many products.
        """
        with self._form.allow_products(_MAX_PRODUCTS):
            return self._reduce(self._form(e))

    def expression(self, e: sp.Expr) -> sp.Expr:
        """Return the normal form; TooLongError as for ``terms``."""
        return expression_of(self.terms(e))

    def expression_if_short(self, e: sp.Expr) -> sp.Expr:
        """Return the normal form, or e itself, which is equal to it, if that takes too long."""
        try:
            return self.expression(e)
        except TooLongError:
            return e

    def vanishes(self, e: sp.Expr) -> bool:
        """Whether an expression is proved to be in the ideal; False if that takes too long."""
        try:
            return e == 0 or not self.terms(e)
        except TooLongError:
            return False

    def _argument(self, e: sp.Expr) -> sp.Expr:
        """Return the normal form of an argument, a radicand or a denominator."""
        return e if e.is_Symbol or e.is_Rational else expression_of(self._reduce(self._form(e)))

    def _reduce(self, terms: Terms) -> Terms:
        """Return the terms with xⁿ, n > 1, replaced by x^(n mod 2) e^(n div 2)."""
        reduced: Terms = {}
        stack = list(terms.items())
        while stack:
            m, a = stack.pop()
            # the first power that can be reduced; the products may have others, and come again
            square = next(((x, n) for x, n in m if x in self._squares
                           and isinstance(n, int) and n > 1), None)
            if square is None:
                add_to(reduced, m, a)
                continue
            x, n = square
            cofactor = (m - {square}) | ({(x, 1)} if n % 2 else set())
            power = self._form.power(self._squares[x], n // 2)
            stack += self._form._times({cofactor: a}, power).items()
        return reduced
