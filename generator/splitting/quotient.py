"""Normal forms of polynomials modulo x² = e, for symbols x of which no e contains any.

The leading monomials x² are powers of different symbols, so that the relations are a Gröbner basis
of their ideal and every polynomial has one normal form: it is in the ideal just if the form is 0.
Functions, roots and denominators are symbols to this algebra, with their arguments in normal form;
an expression with them whose form is 0 is in the ideal, too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import sympy as sp

from ..normal_forms.expansion import NormalForm, TooLongError
from ..normal_forms.terms import Terms, add_to, expression_of

__all__ = ["Quotient", "unit_quaternions"]

#: Products of terms until an expression counts as too long.
_MOST = 200_000


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
        with self._form.allowed(_MOST):
            self._squares = {x: self._form.terms(e) for x, e in squares.items()}

    def terms(self, e: sp.Expr) -> Terms:
        """Return the normal form as terms.

        Raises
        ------
        TooLongError
            If it takes too many products.
        """
        with self._form.allowed(_MOST):
            return self._reduced(self._form(e))

    def expression(self, e: sp.Expr) -> sp.Expr:
        """Return the normal form; TooLongError as for ``terms``."""
        return expression_of(self.terms(e))

    def vanishes(self, e: sp.Expr) -> bool:
        """Whether an expression is proved to be in the ideal; not where that takes too long."""
        try:
            return e == 0 or not self.terms(e)
        except TooLongError:
            return False

    def _argument(self, e: sp.Expr) -> sp.Expr:
        """Return the normal form of an argument, a radicand or a denominator."""
        return e if e.is_Symbol or e.is_Rational else expression_of(self._reduced(self._form(e)))

    def _reduced(self, terms: Terms) -> Terms:
        made: Terms = {}
        waiting = list(terms.items())
        while waiting:
            m, a = waiting.pop()
            high = next(((x, n) for x, n in m if x in self._squares
                         and isinstance(n, int) and n > 1), None)
            if high is None:
                add_to(made, m, a)
                continue
            x, n = high
            rest = (m - {high}) | ({(x, 1)} if n % 2 else set())
            power = self._form.power(self._squares[x], n // 2)
            waiting += self._form._times({rest: a}, power).items()
        return made
