"""Sums and products of expressions that need no simplification, in a tenth of SymPy's time.

``Add`` and ``Mul`` look for like terms, equal bases, roots of numbers and infinities, which rarely
occur where an expression is rebuilt from other arguments. The results are those of SymPy: whatever
it would simplify is left to it. Symbols are commutative.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cmp_to_key

import sympy as sp

__all__ = ["ORDER", "apply_function", "has_minus", "negative", "product_of", "rebuilt", "sum_of"]

#: The order of arguments in sums and products.
ORDER = cmp_to_key(sp.Basic.compare)


def sum_of(terms: Sequence[sp.Expr]) -> sp.Expr:
    """Return Σ terms, ``Add(*terms)``.

    Like terms, which SymPy combines, are equal without their numbers (``multiples``); these and
    unusual terms go to SymPy.
    """
    number: sp.Expr = sp.S.Zero
    remaining = [*terms]
    summands: list[sp.Expr] = []
    multiples = set[object]()
    for term in remaining:
        if term.is_Number:
            if not term.is_Rational:  # decimals, infinities
                return sp.Add(*terms)
            number += term
            continue
        if term.is_Add:
            remaining += term.args  # the loop takes its terms, too
            continue
        multiple: object = term
        if term.is_Mul:
            # 2 x y and 3 x y are multiples of (x, y); 2 x is one of x, which may be a term itself
            factors = term.args[1:] if term.args[0].is_Number else term.args
            if factors[0].is_Number:
                return sp.Add(*terms)
            multiple = factors if len(factors) > 1 else factors[0]
        elif not (term.is_Symbol or term.is_Function or (term.is_Pow and not term.base.is_Number)):
            return sp.Add(*terms)  # matrices, orders, roots of numbers
        summands.append(term)
        multiples.add(multiple)
    if len(multiples) < len(summands):  # like terms
        return sp.Add(*terms)
    summands.sort(key=ORDER)
    if number:
        summands.insert(0, number)
    return sp.Add._from_args(summands, is_commutative=True)


def product_of(factors: Sequence[sp.Expr]) -> sp.Expr:
    """Return Π factors, ``Mul(*factors)``; factors of equal base, and unusual ones, go to SymPy."""
    number: sp.Expr = sp.S.One
    remaining = [*factors]
    powers: list[sp.Expr] = []
    bases = set[sp.Expr]()
    for factor in remaining:
        if factor.is_Number:
            if not factor.is_Rational or not factor:  # decimals, infinities, 0
                return sp.Mul(*factors)
            number *= factor
            continue
        if factor.is_Mul:
            remaining += factor.args  # the loop takes its factors, too
            continue
        base = factor
        if factor.is_Pow:
            base = factor.base
            if not factor.exp.is_Rational:
                return sp.Mul(*factors)
        # roots of numbers have rules of their own; eᵃ eᵇ is eᵃ⁺ᵇ
        if not (base.is_Symbol or base.is_Add or base.is_Function) or isinstance(base, sp.exp):
            return sp.Mul(*factors)
        powers.append(factor)
        bases.add(base)
    # equal bases; and a number times a sum, into which SymPy may multiply the number
    if len(bases) < len(powers) or (len(powers) == 1 and powers[0].is_Add):
        return sp.Mul(*factors)
    powers.sort(key=ORDER)
    if number is not sp.S.One:
        powers.insert(0, number)
    return sp.Mul._from_args(powers, is_commutative=True)


def has_minus(e: sp.Basic) -> bool:
    """Return whether a sum or product has more minus signs than its negative, or a number is < 0.

    It is ``could_extract_minus_sign``, which asks for assumptions of every number.
    """
    if e.is_Rational:
        return bool(e.p < 0)
    if e.is_Mul and e.args[0].is_Rational:
        return bool(e.args[0].p < 0)
    return isinstance(e, sp.Expr) and bool(e.could_extract_minus_sign())


def negative(e: sp.Expr) -> sp.Expr:
    """Return −e; of a sum, the sum of the negative terms."""
    return sum_of([-term for term in e.args]) if e.is_Add else -e


def rebuilt(e: sp.Basic, arguments: Iterable[sp.Basic]) -> sp.Basic:
    """Return e with other arguments; e itself if they are its own."""
    arguments = [*arguments]
    if all(a is b for a, b in zip(arguments, e.args, strict=True)):
        return e
    return apply_function(e.func, arguments)


def apply_function(function: type[sp.Basic], arguments: Sequence[sp.Basic]) -> sp.Basic:
    """Return ``function(*arguments)``."""
    if function is sp.Add:
        return sum_of(arguments)
    return product_of(arguments) if function is sp.Mul else function(*arguments)
