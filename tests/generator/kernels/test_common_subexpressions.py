"""Common subexpressions: the temporaries of ``sympy.cse``, and expressions of the same value."""

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import systems
from gyrospark.generator.kernels.common_subexpressions import common_subexpressions
from gyrospark.generator.symbolic.shared_subexpressions import expand_shared, substitute

X = sp.symbols("x y z w", real=True)


def grow(inner):
    """Return sums, differences, products, quotients and functions of expressions."""
    several = st.lists(inner, min_size=2, max_size=4)
    return (several.map(lambda e: sp.Add(*e)) | several.map(lambda e: sp.Mul(*e))
            | several.map(lambda e: e[0] - sp.Add(*e[1:])) | inner.map(lambda e: 1 / (2 + e**2))
            | inner.map(sp.sin))


expressions = st.lists(st.recursive(
    st.sampled_from([*X, sp.Integer(-3), sp.Rational(1, 2)]), grow, max_leaves=8), max_size=6)


def both(e, **options):
    """Return the temporaries and results of SymPy, and those of this package."""
    return sp.cse(e, sp.numbered_symbols("_t", real=True), order="canonical"), (
        common_subexpressions(e, sp.numbered_symbols("_t", real=True), **options))


@settings(max_examples=40, derandomize=True)
@given(expressions)
def test_temporaries_are_those_of_sympy(e):
    theirs, ours = both(e)
    assert ours == theirs


@pytest.mark.parametrize("name", ["driven_pendulum", "lagrangian", "relativistic", "andrews"])
def test_temporaries_of_a_system_are_those_of_sympy(name):
    system = systems.case(name).system
    e = [expand_shared(x) for x in (*system.H_q, *system.H_p, *system.constraints)]
    theirs, ours = both(e)
    assert ours == theirs


@settings(max_examples=25, derandomize=True)
@given(expressions, st.booleans())
def test_definitions_give_the_expressions_back(e, sort):
    definitions, reduced = common_subexpressions(e, sp.numbered_symbols("_t", real=True), sort=sort)
    expanded = {}
    for symbol, definition in definitions:
        expanded[symbol] = substitute([definition], expanded)[0]
    for original, restored in zip(e, substitute(reduced, expanded), strict=True):
        assert sp.expand(original - restored) == 0


def test_names_in_use_are_skipped():
    t = sp.Symbol("_t0", real=True)
    definitions, reduced = common_subexpressions(
        [sp.sin(t + X[0]), sp.cos(t + X[0])], sp.numbered_symbols("_t", real=True))
    assert definitions == [(sp.Symbol("_t1", real=True), t + X[0])]
    assert reduced == [sp.sin(definitions[0][0]), sp.cos(definitions[0][0])]
