"""Discrete gradients of nested elementary functions: 10 000 random expressions.

    pytest tests/test_discrete_functions.py -m "slow or not slow"

runs all 10 000; without the marker there are fewer. Every one is evaluated in doubles and, as a
second way, in mpmath at the two end points.
"""

from __future__ import annotations

from fractions import Fraction

import mpmath as mp
import pytest
import sympy as sp
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from gyrospark.generator.discrete_gradient import discrete_gradient
from gyrospark.generator.identities import evaluate
from gyrospark.generator.sharing import parts_of
from random_expressions import EXPRESSIONS, PARAMETERS, X, in_doubles, largest_term
from strategies import EPS

DIGITS = 60
MEANS = sp.symbols("xm0:4", real=True)
STEPS = sp.symbols("dx0:4", real=True)
#: Values beyond this, and 0/0, overflow somewhere.
LARGEST = mp.mpf(10) ** 30


def gradient_of(e):
    return discrete_gradient(e, X, MEANS, STEPS)


def check(e, at, direction, size, weights):
    """Check the identity in doubles and in mpmath, symmetry and consistency."""
    steps = [size * d for d in direction]
    parameters = dict(zip(PARAMETERS, map(Fraction, weights), strict=True))
    ends = [
        {x: Fraction(m) + sign * Fraction(d) / 2 for x, m, d in zip(X, at, steps, strict=True)}
        for sign in (-1, 1)
    ]
    with mp.workdps(DIGITS):
        try:
            start, end = (evaluate([e], parameters | point, DIGITS) for point in ends)
            sizes = {x: mp.mpf(abs(d)) for x, d in zip(X, steps, strict=True)}
            largest = largest_term(e, [start, end], sizes)
        except (ValueError, ArithmeticError):
            assume(False)
        sizes = [abs(v) for values in (start, end) for v in values.values()]
        assume(max(sizes) < LARGEST)
        # what underflows, as exp(-1000), has no digits in doubles
        assume(all(size == 0 or size > mp.mpf(10) ** -280 for size in sizes))
        assume(largest < LARGEST)
        change = end[e] - start[e]
    assume(has_positive_bases(e, (start, end)))
    D = gradient_of(e)
    values = dict(zip((*MEANS, *STEPS, *PARAMETERS), (*at, *steps, *weights), strict=True))
    found = [mp.mpf(d) for d in in_doubles(D, values)]
    with mp.workdps(DIGITS):
        total = mp.fsum(d * mp.mpf(step) for d, step in zip(found, steps, strict=True))
        error = abs(total - change)
        assert error <= 64 * EPS * largest, f"{mp.nstr(error / largest / EPS, 4)} eps"
    check_exactly(e, D, values, change, start)


def has_positive_bases(e, ends):
    """Powers that are no whole or half ones go through logarithms: not for bases up to 0."""
    return all(
        values.get(part.base, part.base) > 0
        for part in parts_of([e]) if part.is_Pow and not (2 * part.exp).is_Integer
        for values in ends)


def check_exactly(e, D, values, change, start):
    """Check the identity and the symmetry with 60 digits, and D = ∂e/∂x for Δx = 0."""
    point = {s: Fraction(v) for s, v in values.items()}
    back = point | {s: -point[s] for s in STEPS}
    rest = point | dict.fromkeys(STEPS, Fraction(0))
    gradient = [sp.diff(e, x) for x in X]
    at_mean = {x: point[m] for x, m in zip(X, MEANS, strict=True)} | point
    there, again = (evaluate(D, p, DIGITS) for p in (point, back))
    with mp.workdps(DIGITS):
        terms = [there[d] * mp.mpf(values[s]) for d, s in zip(D, STEPS, strict=True)]
        scale = max(1, *(abs(t) for t in terms), *(abs(v) for v in start.values()))
        assert abs(mp.fsum(terms) - change) < scale * mp.mpf(10) ** -25
        for d in D:
            assert abs(there[d] - again[d]) <= mp.mpf(10) ** -25 * (1 + abs(there[d]))
    try:
        found, wanted = evaluate(D, rest, DIGITS), evaluate(gradient, at_mean, DIGITS)
    except (ValueError, ArithmeticError):
        return  # no derivative there, though the ends have values
    with mp.workdps(DIGITS):
        for d, g in zip(D, gradient, strict=True):
            assert abs(found[d] - wanted[g]) <= mp.mpf(10) ** -25 * (1 + abs(wanted[g]))


RANDOM = (
    EXPRESSIONS,
    st.tuples(*[st.floats(-2, 2).filter(lambda v: abs(v) > 1e-3)] * 4),
    st.tuples(*[st.integers(-1000, 1000).map(lambda n: n / 1000)] * 4),
    st.sampled_from([0.5, 0.1, 1e-2, 1e-4, 1e-8, 1e-16, 0.0]),
    # No whole numbers: a power with a symbol as exponent takes positive bases only.
    st.tuples(*[st.floats(0.51, 1.97).filter(lambda v: v != 1)] * 2),
)
QUIET = [HealthCheck.filter_too_much, HealthCheck.too_slow, HealthCheck.data_too_large]


@settings(max_examples=300, deadline=None, derandomize=True, suppress_health_check=QUIET)
@given(*RANDOM)
def test_identity_of_random_expressions(e, at, direction, size, weights):
    check(e, at, direction, size, weights)


@pytest.mark.slow
@settings(max_examples=10_000, deadline=None, derandomize=True, suppress_health_check=QUIET)
@given(*RANDOM)
def test_identity_of_ten_thousand_random_expressions(e, at, direction, size, weights):
    check(e, at, direction, size, weights)
