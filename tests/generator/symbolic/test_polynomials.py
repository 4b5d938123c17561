"""Expanded polynomials are SymPy's, to the order of terms and factors."""

from __future__ import annotations

import random

import sympy as sp

from gyrospark.generator.symbolic.bounded_algebra import is_small
from gyrospark.generator.symbolic.polynomials import expanded_polynomial

_X = [*sp.symbols("x y z _u b1", real=True), sp.Symbol("m", positive=True)]


def _expression(chance: random.Random, depth: int) -> sp.Expr:
    kind = chance.random()
    if depth == 0 or kind < 0.2:
        if chance.random() < 0.25:
            return sp.Rational(chance.randint(-4, 4), chance.choice([1, 2, 3]))
        return chance.choice(_X) ** chance.choice([-2, -1, 1, 1, 1])
    if kind < 0.55:
        return sp.Add(*(_expression(chance, depth - 1) for _ in range(chance.randint(1, 4))))
    if kind < 0.9:
        return sp.Mul(*(_expression(chance, depth - 1) for _ in range(chance.randint(1, 3))))
    return _expression(chance, depth - 1) ** chance.randint(0, 3)


def test_random_polynomials_expand_as_in_sympy():
    chance = random.Random(5)
    for _ in range(60):
        e = _expression(chance, 4)
        # the text of srepr has the order of arguments, which equality does not
        assert sp.srepr(expanded_polynomial(e)) == sp.srepr(sp.expand(e)), e


def test_long_expansions_are_known_before():
    """(x + y + 1)**n has (n + 1)(n + 2)/2 terms, also beside a function; 1/(x + n) is one."""
    x, y, *_ = _X
    for factor in (1, sp.cos(x * y)):
        assert is_small(factor * (x + y + 1) ** 9)
        assert not is_small(factor * (x + y + 1) ** 300)
    assert is_small(sp.Mul(*(1 / (x + n) for n in range(20))))
    assert not is_small(sp.Mul(*(x + n for n in range(20))))


def test_constants_cancelled_terms_and_what_is_left_to_sympy():
    x, y, *_ = _X
    assert expanded_polynomial(sp.Integer(0)) is sp.S.Zero
    assert expanded_polynomial((x + y) * (x - y) - x**2 + y**2) is sp.S.Zero
    assert expanded_polynomial(x * (1 + 1 / x) - x) is sp.S.One
    assert expanded_polynomial((x + y) ** 2 / 2).args == sp.expand((x + y) ** 2 / 2).args
    x, y, *_ = _X
    for e in (sp.sin(x) + 1, sp.sqrt(x), 1 / (x + y), 0.5 * x, x**y):
        assert expanded_polynomial(e) is None
