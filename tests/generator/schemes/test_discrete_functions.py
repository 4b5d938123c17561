"""Discrete gradients of nested elementary functions: 10 000 random expressions.

    pytest tests/generator/schemes/test_discrete_functions.py -m "slow or not slow"

runs all 10 000; without the marker there are fewer. Every one is evaluated in doubles and, as a
second way, in mpmath at the two end points.
"""

import math
from fractions import Fraction

import mpmath as mp
import pytest
import sympy as sp
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from gyrospark.core.errors import InputError
from gyrospark.generator.schemes.discrete_gradient import (
    DiscreteDifference,
    differentiate,
    discrete_gradient,
)
from gyrospark.generator.symbolic.identities import evaluate
from gyrospark.generator.symbolic.shared_subexpressions import expand_shared, parts_of
from gyrospark.generator.symbolic.switching_functions import Max, Min
from random_expressions import (
    EXPRESSIONS,
    PARAMETERS,
    X,
    in_doubles,
    keeps_off_edges,
    largest_term,
)
from strategies import EPS

DIGITS = 60
MEANS = sp.symbols("xm0:4", real=True)
STEPS = sp.symbols("dx0:4", real=True)
#: Values beyond this, and 0/0, overflow somewhere.
LARGEST = mp.mpf(10) ** 30


def gradient_of(e):
    return discrete_gradient(e, X, MEANS, STEPS)


def check(e, means, direction, size, weights):
    """Check the identity in doubles and in mpmath, symmetry and consistency."""
    values = named(means, [size * d for d in direction], weights)
    with mp.workdps(DIGITS):
        try:
            ends = [evaluate([e], point, DIGITS) for point in end_points(values)]
            largest = largest_term(e, ends, sizes_of_steps(values))
        except (ValueError, ArithmeticError):
            assume(False)
        sizes = [abs(v) for end in ends for v in end.values()]
        assume(max(sizes) < LARGEST)
        # a value that underflows, as exp(-1000), has no digits in doubles
        assume(all(size == 0 or size > mp.mpf(10) ** -280 for size in sizes))
        assume(largest < LARGEST)
        assume(keeps_off_edges(e, ends, 64 * EPS))
    assume(has_positive_bases(e, ends))
    assume(has_no_jumps(e, ends))
    assume(has_finite_cosines(e, ends))
    check_identity(e, values, ends, largest)


def named(means, steps, weights):
    """Return the values of means, steps and parameters."""
    return dict(zip((*MEANS, *STEPS, *PARAMETERS), (*means, *steps, *weights), strict=True))


def end_points(values):
    """Return x̄ ∓ Δx/2 without rounding, and the parameters."""
    exact = {s: Fraction(v) for s, v in values.items()}
    parameters = {s: exact[s] for s in PARAMETERS}
    return [
        parameters | {x: exact[m] + sign * exact[d] / 2
                      for x, m, d in zip(X, MEANS, STEPS, strict=True)}
        for sign in (-1, 1)
    ]


def sizes_of_steps(values):
    return {x: mp.mpf(abs(values[d])) for x, d in zip(X, STEPS, strict=True)}


def check_identity(e, values, ends, largest):
    """Check D·Δx = e₁ − e₀ in doubles to 64 eps of the largest term, and more in mpmath."""
    D = gradient_of(e)
    gradient = [mp.mpf(d) for d in in_doubles(D, values)]
    with mp.workdps(DIGITS):
        change = ends[1][e] - ends[0][e]
        total = mp.fsum(d * mp.mpf(values[s]) for d, s in zip(gradient, STEPS, strict=True))
        error = abs(total - change)
        assert error <= 64 * EPS * largest, f"{mp.nstr(error / largest / EPS, 4)} eps"
    check_exactly(e, D, values, change, ends[0])


def has_positive_bases(e, ends):
    """Return whether powers that take logarithms, no multiples of ½, have positive bases."""
    return all(
        values.get(power.base, power.base) > 0
        for power in parts_of([e]) if power.is_Pow and not (2 * power.exp).is_Integer
        for values in ends)


def has_no_jumps(e, ends):
    """Return whether no atan2 crosses its cut, where it jumps, unlike its discrete gradient."""
    start, end = ends
    return all(abs(end[angle] - start[angle]) < mp.pi for angle in parts_of([e])
               if angle.func == sp.atan2)


def has_finite_cosines(e, ends):
    """Return whether cosh u₁ cosh u₀ and sinh Δu in the rule of tanh do not overflow."""
    return all(abs(values[tangent.args[0]]) < 350
               for tangent in parts_of([e]) if tangent.func == sp.tanh for values in ends)


def check_exactly(e, D, values, change, start):
    """Check the identity and the symmetry with 60 digits, and D = ∂e/∂x for Δx = 0."""
    point = {s: Fraction(v) for s, v in values.items()}
    back = point | {s: -point[s] for s in STEPS}
    at_rest = point | dict.fromkeys(STEPS, Fraction(0))
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
        limits, slopes = evaluate(D, at_rest, DIGITS), evaluate(gradient, at_mean, DIGITS)
    except (ValueError, ArithmeticError):
        return  # no derivative there, though the ends have values
    with mp.workdps(DIGITS):
        for d, g in zip(D, gradient, strict=True):
            assert abs(limits[d] - slopes[g]) <= mp.mpf(10) ** -25 * (1 + abs(slopes[g]))


RANDOM = (
    EXPRESSIONS,
    st.tuples(*[st.floats(-2, -1e-3) | st.floats(1e-3, 2)] * 4),
    st.tuples(*[st.integers(-1000, 1000).map(lambda n: n / 1000)] * 4),
    st.sampled_from([0.5, 0.1, 1e-2, 1e-4, 1e-8, 1e-16, 0.0]),
    # No integers: a power with a symbol as exponent takes positive bases only.
    st.tuples(*[st.floats(0.51, 0.99) | st.floats(1.01, 1.97)] * 2),
)
QUIET = [HealthCheck.filter_too_much, HealthCheck.too_slow, HealthCheck.data_too_large]


@settings(max_examples=6, derandomize=True, suppress_health_check=QUIET)
@given(*RANDOM)
def test_identity_of_random_expressions(e, means, direction, size, weights):
    check(e, means, direction, size, weights)


@pytest.mark.slow
@settings(max_examples=10_000, derandomize=True, suppress_health_check=QUIET)
@given(*RANDOM)
def test_identity_of_ten_thousand_random_expressions(e, means, direction, size, weights):
    check(e, means, direction, size, weights)


@settings(max_examples=20, derandomize=True)
@given(function=st.sampled_from([sp.cos, sp.sin]), k=st.sampled_from([-3, -2, -1, 1, 2, 3, 4]),
       angles=st.tuples(*[st.floats(1e-6, 1.5)] * 2), radii=st.tuples(*[st.floats(0.1, 2)] * 2),
       clockwise=st.booleans(), phase=st.floats(0.51, 0.99))
def test_periodic_functions_of_an_angle_do_not_see_its_cut(
    function, k, angles, radii, clockwise, phase,
):
    """The identity holds across the negative x axis, where atan2 itself jumps by 2π.

    The largest term is taken from the motion turned by π, where nothing jumps.
    """
    x, y = X[:2]
    e = function(k * sp.atan2(y, x) + PARAMETERS[0])
    sides = [math.pi - angles[0], math.pi + angles[1]]
    (x0, y0), (x1, y1) = ((r * math.cos(s), r * math.sin(s))
                          for r, s in zip(radii, sides[::-1] if clockwise else sides, strict=True))
    values = named([(x0 + x1) / 2, (y0 + y1) / 2, 1.0, 1.0], [x1 - x0, y1 - y0, 0.0, 0.0],
                   [phase, 1.5])
    with mp.workdps(DIGITS):
        ends = [evaluate([e], point, DIGITS) for point in end_points(values)]
        assert not has_no_jumps(e, ends)
        turned = [evaluate([e], point | {x: -point[x], y: -point[y]}, DIGITS)
                  for point in end_points(values)]
        assert has_no_jumps(e, turned)
        largest = largest_term(e, turned, sizes_of_steps(values))
    check_identity(e, values, ends, largest)


x, y, z, _ = X
a, b = PARAMETERS
HALF = sp.Rational(1, 2)


@pytest.mark.parametrize("e", [
    3 * x - a * y + 2, x**2, x**3, y**6, x * y**2 * z**3 - b * x * y, (x + 2 * y - a) ** 2,
    ((x**2 + y) ** 3 + z) ** 2, (x + y) * (y + z) * (z + x) * (a - x),
    1 / x, x**-2, x**-3, (x + a) / (y**2 + b), (x / y) / (1 + z / x), a / (x**2 + y**2 + z**2),
    sp.sqrt(x), x ** (3 * HALF), 1 / sp.sqrt(x), x ** (-3 * HALF), sp.sqrt(x**2 + a),
    sp.sqrt(x) * sp.sqrt(y + z), b / sp.sqrt(x**2 + y**2), sp.sqrt(a + sp.sqrt(x)),
    sp.sqrt(a**2 + x**2) + y * x, y**7, sp.sinh(x) * sp.cosh(a * y), a ** (x * y),
], ids=str)
def test_powers_quotients_and_roots(e):
    """Identity, symmetry and gradient hold, and the mean of e is the mean of its end values."""
    values = named([1.25, 0.75, 1.5, 1.0], [0.5, -0.25, 0.75, 0.0], [0.7, 1.2])
    leaves = {s: DiscreteDifference(mean, {i: sp.Integer(1)}, STEPS)
              for i, (s, mean) in enumerate(zip(X, MEANS, strict=True))}
    mean = differentiate(e, leaves, STEPS).mean
    with mp.workdps(DIGITS):
        ends = [evaluate([e], point, DIGITS) for point in end_points(values)]
        largest = largest_term(e, ends, sizes_of_steps(values))
        mean_value = evaluate([mean], {s: Fraction(v) for s, v in values.items()}, DIGITS)[mean]
        assert abs(mean_value - (ends[0][e] + ends[1][e]) / 2) < mp.mpf(10) ** -50
    check_identity(e, values, ends, largest)


@pytest.mark.parametrize(("e", "mean", "step"), [
    (sp.asinh(10**8 * x), 0.01, 2.0), (sp.asinh(100 * x), 0.01, 2.0),
    (sp.atan(10**6 * x), 0.01, 2.0), (1 / sp.atan(10**6 * x**2), 0.01, 3.0),
    (sp.atan2(sp.Rational(4, 5) * x**4, x), 0.001, 0.0167),
    (sp.cos(2 * sp.atan2(10**-4 * x**2, x)), 0.01, 2.0),
    (sp.atanh(x), 1e-5, 1.9998), (sp.atanh(sp.tanh(4 * x)), 0.1, 2.0),
    (sp.asin(sp.sin(x)), 0.01, 3.1), (sp.acos(sp.tanh(8 * x)), 0.1, 2.0),
    (sp.acosh(1 + 10**4 * x), 1.0, 1.99999), (sp.log(x), 1.0, 1.99999999),
    (x**-24, 0.27, 0.2), (x**-9, 1.0, 1.9), (x ** sp.Rational(-3, 2), 1.0, 1.99999),
    (x ** sp.Rational(1, 3), 1.0, 1.99999999), (sp.tan(x), 0.01, 3.14), (sp.tanh(x), 0.01, 30.0),
    (Max(sp.Abs(x), Min(a, 2 * x)), 0.01, 2.0), (Max(x, 1 / a - x), 0.6, 1.5),
    (1 / Min(2 * x, x * y - a), 1.0, 0.4), (x ** (a + x), 1.0, 1.99999),
])
def test_ends_far_apart_cost_no_digits(e, mean, step):
    """The identity holds from one branch to another, where sums of the two ends cancel."""
    values = named([mean, 1.0, 1.0, 1.0], [step, 0.0, 0.0, 0.0], [0.7, 1.2])
    with mp.workdps(DIGITS):
        ends = [evaluate([e], point, DIGITS) for point in end_points(values)]
        largest = largest_term(e, ends, sizes_of_steps(values))
    check_identity(e, values, ends, largest)


def test_symbols_that_do_not_occur_have_slope_zero_and_constants_have_none():
    for e, slopes in ((y * a, [0, a, 0, 0]), (sp.sin(a) + sp.Integer(3), [0] * 4),
                      (sp.sin(a) * x, [sp.sin(a), 0, 0, 0])):  # any function of parameters
        assert [expand_shared(D) for D in gradient_of(e)] == slopes


@pytest.mark.parametrize(("e", "name"), [
    (y + sp.LambertW(x), "LambertW"), (sp.sqrt(1 + sp.erf(y)), "erf"), (sp.Function("f")(x), "f"),
    (sp.Piecewise((x, x > 0), (0, True)), "Piecewise"), (sp.Max(x, y), "Max")])
def test_function_without_a_known_difference_is_refused_by_name(e, name):
    with pytest.raises(InputError, match=f"'{name}'"):
        gradient_of(e)
