"""Sums and products without simplification: those of SymPy, of the same arguments in one order."""

import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from gyrospark.generator.symbolic.construction import negative, product_of, rebuilt, sum_of
from gyrospark.generator.symbolic.shared_subexpressions import Shared, tree_size

X = sp.symbols("x y z", real=True)
NUMBERS = [sp.Integer(n) for n in (-2, -1, 0, 1, 3)] + [sp.Rational(-1, 3), sp.Rational(1, 2)]
ATOMS = [*X, *NUMBERS, sp.sqrt(2), sp.pi, sp.S.Infinity, sp.exp(X[0]), 2 * X[0], Shared(X[0] + 1),
         sp.Mul(2, X[0] + X[1], evaluate=False)]


def grow(inner):
    """Return sums, products and powers of expressions."""
    several = st.lists(inner, min_size=2, max_size=3)
    powers = st.builds(sp.Pow, inner, st.sampled_from([2, -1, sp.Rational(1, 2), X[1]]))
    return several.map(lambda e: sp.Add(*e)) | several.map(lambda e: sp.Mul(*e)) | powers


lists = st.lists(st.recursive(st.sampled_from(ATOMS), grow, max_leaves=4), min_size=1, max_size=4)


@settings(max_examples=60, derandomize=True)
@given(lists)
def test_sum_and_product_are_those_of_sympy(e):
    for ours, theirs in ((sum_of, sp.Add), (product_of, sp.Mul)):
        assert ours(e) == theirs(*e)
        assert ours(e).is_commutative


@settings(max_examples=50, derandomize=True)
@given(lists)
def test_sum_of_negative_terms(e):
    assert negative(sp.Add(*e)) == sp.Add(*(-term for term in sp.Add.make_args(sp.Add(*e))))


def test_same_arguments_are_the_same_expression():
    e = sp.Mul(2, X[0] + X[1], evaluate=False)
    assert rebuilt(e, e.args) is e
    assert rebuilt(e, [sp.Integer(2), X[2]]) == 2 * X[2]
    assert rebuilt(sp.sin(X[0]), [X[1]]) == sp.sin(X[1])


def test_the_size_of_a_tree_counts_repeated_parts():
    e = sp.sin(X[0] + X[1])  # 4 nodes
    assert tree_size([X[2], e, e**2 + e]) == 1 + 4 + (1 + 6 + 4)
