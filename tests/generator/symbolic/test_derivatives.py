"""Derivatives: SymPy's own, term by term."""

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from gyrospark.core.errors import InputError
from gyrospark.generator.multibody.rigid_body import heavy_top
from gyrospark.generator.schemes.step_equations import hoist_constants
from gyrospark.generator.symbolic.derivatives import derivative
from gyrospark.generator.symbolic.shared_subexpressions import Shared

X = sp.symbols("x y z", real=True)
M = sp.Symbol("m", positive=True)
ATOMS = [*X, M, sp.Integer(2), sp.Rational(-1, 3), sp.sqrt(2), sp.pi]
EXPONENTS = [sp.Integer(2), sp.Integer(3), sp.Integer(-1), sp.Rational(1, 2), sp.Rational(-3, 2)]


def grow(inner):
    """Return sums, products, powers and functions of expressions; numbers stay as they are."""
    sums = st.lists(inner, min_size=2, max_size=4).map(lambda terms: sp.Add(*terms))
    products = st.lists(inner, min_size=2, max_size=4).map(lambda factors: sp.Mul(*factors))
    powers = st.builds(lambda e, n: sp.Pow(1 + e**2, n), inner, st.sampled_from(EXPONENTS))
    functions = st.builds(lambda f, e: f(e), st.sampled_from([sp.sin, sp.exp, sp.atan]), inner)
    exponentials = st.builds(lambda e, n: sp.Pow(M, e + n), inner, st.sampled_from(X))
    return sums | products | powers | functions | exponentials


expressions = st.recursive(st.sampled_from(ATOMS), grow, max_leaves=8)


@settings(max_examples=25, derandomize=True)
@given(expressions, st.sampled_from([*X, M]))
def test_derivative_is_that_of_sympy(e, x):
    assert derivative(e, x) == sp.diff(e, x)


@pytest.mark.parametrize("rep", ["alpha", "gamma"])
def test_first_and_second_derivatives_of_bodies_are_those_of_sympy(rep):
    system, _ = hoist_constants(heavy_top(rep))
    for x in (*system.q, *system.p):
        first = derivative(system.H, x)
        assert first == sp.diff(system.H, x)
        for y in (system.q[1], system.p[2]):
            assert derivative(first, y) == sp.diff(first, y)


@pytest.mark.parametrize("e", [sp.Integer(3), sp.pi, X[1], sp.sqrt(2) + M])
def test_derivative_of_what_does_not_depend_is_zero(e):
    assert derivative(e, X[0]) == 0
    assert derivative(X[0], X[0]) == 1


def test_sympy_derives_a_shared_part_too():
    x, y, _ = X
    assert sp.diff(sp.sin(Shared(x**2 + y)), x).subs({x: 2, y: -4}) == 4


def test_a_function_without_a_known_derivative_is_refused_by_name():
    x = sp.Symbol("x", real=True)
    assert derivative(sp.zeta(sp.Integer(3)) * x, x) == sp.zeta(3)  # a number needs none
    with pytest.raises(InputError, match=r"'zeta'.*zeta\(x\*\*2\)"):
        derivative(x + sp.zeta(x**2), x)
