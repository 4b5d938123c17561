"""Discrete gradients of |u|, max, min and pieces: exact, with a kink between the ends or at one.

The identity ΔH = D·Δ is checked with 60 digits against H at both ends, for every pair of ends from
a list with kinks, ties and tiny steps, then in doubles; EMS keeps such an H to round-off.
"""

import re
from fractions import Fraction
from functools import cache
from itertools import pairwise, product

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from calls import jacobian_by_differences
from gyrospark.certificates.midpoint_conditions import check_mean_scheme
from gyrospark.core.errors import InputError
from gyrospark.generator.pipeline import generate
from gyrospark.generator.schemes.discrete_gradient import discrete_gradient
from gyrospark.generator.schemes.step_equations import MeanScheme
from gyrospark.generator.spec import Spec
from gyrospark.generator.symbolic.identities import evaluate
from gyrospark.generator.symbolic.piecewise import NotPiecewiseError, piecewise_form_of
from gyrospark.generator.symbolic.switching_functions import as_switches
from random_expressions import in_doubles
from strategies import EPS

X = x, y = sp.symbols("x y", real=True)
MEANS, STEPS = sp.symbols("xm ym", real=True), sp.symbols("dx dy", real=True)
k, a, b, c = sp.symbols("k a b c", positive=True)
r = sp.Symbol("r", real=True)
P, H, Q = sp.Piecewise, sp.Heaviside, sp.Rational
LENGTH = sp.sqrt(x**2 + y**2)
PARAMETERS = {k: Fraction(13, 10), a: Fraction(1, 2), b: Fraction(3, 2), r: Fraction(1, 2)}

ZOO = {
    "|x|": sp.Abs(x), "|xy|x": sp.Abs(x * y) * x, "max": sp.Max(x, y),
    "min of products": sp.Min(x * y, x - 1), "three": sp.Max(x, y, -x - y),
    "contact": k * sp.Max(0, x) ** Q(5, 2), "odd power": sp.Max(0, x) ** Q(7, 3),
    "any power": sp.Max(0, x - a) ** k, "root": sp.sqrt(sp.Abs(x)),
    "root of two": (1 - sp.Min(x, 1)) ** Q(3, 2),
    "two springs": P((x**2, x < 0), (2 * x**2, True)) * y,
    "backlash": P((k * (x + a) ** 2, x < -a), (0, x < a), (k * (x - a) ** 2, True)),
    "backlash, sign not known": P((k * (x - r) ** 2, x > r), (0, x > -r), (k * (x + r) ** 2, True)),
    "well": P((0, (x > -r) & (x < r)), (k * (x**2 - r**2) ** 2, True)),
    "rope": P((0, a >= LENGTH), (k * (LENGTH - a) ** 2, True)),
    "rope, multiplied out": P((0, a >= LENGTH), (x**2 + y**2 - 2 * a * LENGTH + a**2, True)),
    "difference": P((0, x - y < a), ((x - y - a) ** 3, True)), "step times": x * H(x) * y**2,
    "steps together": sp.sign(x - 1) * (x - 1) + H(x) * x + y**2,
    "half defined": P((0, x < 0), (sp.sqrt(x) ** 3, True)),
    "log": P((sp.log(x), x > 1), (x - 1, True)), "poles": P((1 / (2 - x), x < 1), (x, True)),
    "saturated": sp.Min(sp.Max(x, -1), 1) ** 2, "exponential": sp.exp(sp.Max(x, y)),
    "by a parameter": P((x**2 * y, k < r), (sp.sqrt(1 + x**2), True))
    + P((P((x, k < 1), (k * x, True)), x < 0), (2 * k * x, True)),
    "all of it": sp.Abs(sp.Max(x, y) - sp.Min(x, 2 * y)) * sp.cos(sp.Abs(x)),
}
named = pytest.mark.parametrize("name", ZOO)
#: Kinks of the above, their neighbours, and steps too small to change them.
ENDS = [-2.0, -1.0, -0.5, -1e-9, 0.0, 1e-17, 0.3, 0.5, 0.5 + 1e-16, 1.0, 1.0000001, 1.7]
PAIRS = list(product(ENDS, ENDS))[::7]


@cache
def gradient_of(name):
    return discrete_gradient(as_switches(ZOO[name]), X, MEANS, STEPS)


def moves(seed):
    """Yield exact ends: x from each end to each, y from and to some, every third one at rest."""
    rng = np.random.default_rng(seed)
    for index, (start, end) in enumerate(PAIRS):
        y_ends = [float(v) for v in rng.choice(ENDS, 2)]
        if index % 3 == 0:
            y_ends[1] = y_ends[0]
        yield [[Fraction(start), Fraction(y_ends[0])], [Fraction(end), Fraction(y_ends[1])]]


def at(ends):
    """Return means and steps of exact ends, with the parameters."""
    values = dict(zip(MEANS, ((s + e) / 2 for s, e in zip(*ends, strict=True)), strict=True))
    return values | dict(zip(STEPS, (e - s for s, e in zip(*ends, strict=True)), strict=True)) \
        | PARAMETERS


def values_at(e, ends):
    """Return e at both ends, 60 digits; None where it has no value."""
    try:
        return [evaluate([e], dict(zip(X, end, strict=True)) | PARAMETERS)[e] for end in ends]
    except (ValueError, ArithmeticError):
        return None


@named
def test_change_is_exact_and_right_in_doubles(name):
    """D·Δ = ΔH to 40 digits wherever H has values, and D is the same for the ends exchanged.

    In doubles the error stays below 64 ε of H and of the effect of rounding mean and step in H,
    and no 0/0 occurs.
    """
    e, D = as_switches(ZOO[name]), gradient_of(name)
    checked = 0
    for given_ends in moves(1):
        rounded = {s: float(v) for s, v in at(given_ends).items()}
        # the scheme has a mean and a step: the ends are exactly mean ∓ step/2
        ends = [[Fraction(rounded[m]) + sign * Fraction(rounded[d]) / 2
                 for m, d in zip(MEANS, STEPS, strict=True)] for sign in (-1, 1)]
        values = values_at(e, ends)
        if values is None or values_at(e, given_ends) is None:
            continue
        steps = [rounded[s] for s in STEPS]
        with mp.workdps(60):
            change = values[1] - values[0]
            there, back = (evaluate(D, at(order)) for order in (ends, ends[::-1]))
            assert all(abs(there[d] - back[d]) < mp.mpf(10) ** -40 * (1 + abs(there[d])) for d in D)
            total = mp.fsum(there[d] * mp.mpf(step) for d, step in zip(D, steps, strict=True))
            assert abs(total - change) < mp.mpf(10) ** -40 * max(1, *map(abs, values)), ends
        checked += 1
        if "rope" in name and any(0 < abs(u) + abs(v) < 1e-6 for u, v in ends):
            continue  # the root of a sum of squares has no digits beside a step of 1
        gradient = in_doubles(D, rounded)
        assert np.isfinite(gradient).all(), (name, ends)
        reach = [max(abs(float(p)) for p in pair) for pair in zip(*ends, strict=True)]
        scale = 1 + sum(abs(d) * s for d, s in zip(gradient, reach, strict=True)) + max(
            abs(float(v)) for v in values)
        assert abs(np.dot(gradient, steps) - float(change)) <= 64 * EPS * scale, (name, ends)
    assert checked > 10


def test_a_slope_that_is_not_chosen_may_be_infinite():
    """The infinite slope of √y, at rest at 0, does not enter max(√y, x + 4)."""
    D = discrete_gradient(as_switches(sp.Max(x + 4, sp.sqrt(y))), X, MEANS, STEPS)
    ends = [[Fraction(1), Fraction(0)], [Fraction(2), Fraction(0)]]
    assert [*in_doubles(D, {s: float(v) for s, v in at(ends).items()})] == [1.0, 0.0]


@named
def test_at_rest_it_is_the_gradient(name):
    """Away from kinks, ends that meet have D = ∂H/∂x."""
    e, D = as_switches(ZOO[name]), gradient_of(name)
    slopes = [sp.diff(e, s) for s in X]
    for position in ((-1.7, 0.4), (0.2, -0.9), (0.7, 1.3), (1.9, 0.6)):
        point = dict(zip(X, map(Fraction, position), strict=True)) | PARAMETERS
        at_rest = dict(zip(MEANS, point.values(), strict=False)) | dict.fromkeys(STEPS, Fraction(0))
        try:
            expected = evaluate(slopes, point)
        except (ValueError, ArithmeticError):
            continue
        gradient = evaluate(D, at_rest | PARAMETERS)
        with mp.workdps(60):
            assert all(abs(gradient[d] - expected[s]) < mp.mpf(10) ** -40 * (1 + abs(expected[s]))
                       for d, s in zip(D, slopes, strict=True))


@pytest.mark.parametrize(("e", "variable", "limits"), [
    (ZOO["backlash"], x, [-a, a]),
    (ZOO["backlash, sign not known"], x, [-r, r]),
    (ZOO["well"], x, [-r, r]),
    (P((k * (x**2 - r**2) ** 2, (x < -r) | (x > r)), (0, True)), x, [-r, r]),
    (ZOO["rope"], LENGTH, [a]),
    (P((1, x**2 + y**2 < 1), (x**2 + y**2, True)), x**2 + y**2, [1]),
    (ZOO["difference"], x - y, [a]),
    (P((0, 2 * x + 3 * y < a), ((2 * x + 3 * y - a) ** 3, True)), x + 3 * y / 2, [a / 2]),
    (sp.sign(x - 1) * (x - 1) + H(x) * x, x, [0, 1]),
    (P((0, -k * x > -a), ((k * x - a) ** 2, True)), x, [a / k]),
    (P((0, sp.sin(x) < 0), (sp.sin(x) ** 2, True)), sp.sin(x), [0]),
    (P((0, x < a), ((x - a) ** 2, x < r), ((r - a) * (2 * x - a - r), True)), x, [a, r]),
])
def test_pieces_are_found(e, variable, limits):
    form = piecewise_form_of(as_switches(e), set(X))
    assert form.variable == variable
    assert form.limits == limits
    assert len(form.parts) == len(limits) + 1
    assert not any(piece.free_symbols & set(X) for piece in form.parts)


REFUSED = [
    (P((0, x < 0), (1, True)), "jumps.* 0 .* 1 .*x = 0"),
    (P((0, x < a), (x, True)), "jumps.* 0 .* a .*x = a"),
    (sp.sign(x) * y, "jumps.*-1 .* 1 .*x = 0"),
    (P((0, x < 0), (x * y, True)), "y besides x"),
    (P((0, x < y), (x**2, True)), "functions.*[xy] . [xy]"),
    (P((0, r * x < 0), (x**2, True)), "sign.*positive"),
    (P((x, x**2 < 1), (1, True)), r"functions.*x\*\*2"),
    (sp.sign(x - r) * sp.sign(x - b) * (x - r) * (x - b), "order.*b and r"),
    (P((1, sp.Eq(x, 0)), (sp.sin(x) / x, True)), "value.*x = 0"),
    (sp.floor(x) * x, "floor"),
    (x - sp.Mod(x, 1), "floor"),
]


@pytest.mark.parametrize(("e", "reason"), REFUSED)
def test_what_has_no_pieces_is_refused_in_one_sentence(e, reason):
    with pytest.raises(InputError, match=reason) as caught:
        discrete_gradient(as_switches(e) + y**2, X, MEANS, STEPS)
    assert "IMS or a SPARK" in str(caught.value)


def test_pieces_that_meet_for_no_reason_that_algebra_sees_are_no_pieces():
    with pytest.raises(NotPiecewiseError, match="jumps"):
        piecewise_form_of(as_switches(P((k * x**2 / 2, x < a), (b * x - c, True))), set(X))


q = sp.symbols("q0:5", real=True)
p = sp.symbols("p0:5", real=True)
FAIR = gs.System(q, p, (k, a, r, b), sum(z**2 for z in p) / 2
                 + P((k * (q[0] + r) ** 2, q[0] < -r), (0, q[0] < r), (k * (q[0] - r) ** 2, True))
                 + k * sp.Max(0, -q[1]) ** Q(5, 2) + q[1] / 3  # bouncing on a ball
                 + sp.Abs(q[2]) + sp.Max(q[0] - q[2], 0) ** 2
                 + k * sp.Max(0, sp.sqrt(q[2] ** 2 + q[3] ** 2) - a) ** 2 / 2
                 + b * sp.Max(0, q[4]) ** 2 / 2, name="fair")  # a wall
FAIR_START = [0.9, 0.3, -0.4, 0.5, 0.01], [0.1, 0.0, 0.7, -0.6, -0.02]
FAIR_PARAMETERS = {"k": 3.0, "a": 0.4, "r": 0.3, "b": 2.0}


@pytest.mark.parametrize("steps", [200, pytest.param(4_000, marks=pytest.mark.slow)])
def test_EMS_keeps_the_energy(steps):
    """Across hundreds of kinks, or tens, H = 2 changes by a random walk of its roundings."""
    step = gs.stepper("EMS", system=FAIR)
    run = step.integrate(*FAIR_START, dt=0.02, steps=steps, parameters=FAIR_PARAMETERS)
    crossings = (np.diff(np.sign(run.q[:, 1:3]), axis=0) != 0).sum()
    assert crossings > steps // 80
    assert run.report.energy_error_max <= 4 * EPS * np.sqrt(steps) * 2
    assert run.report.iterations_max < 50


@pytest.mark.parametrize("stiffness", [1e2, 1e8])
def test_steps_across_a_kink_are_found(stiffness):
    """Of 2000 starts about to hit a wall, h ω from 0.5 to 500, all take a step that keeps H."""
    rng, h = np.random.default_rng(1), 0.05
    p0 = rng.uniform(-1, 1, 2000)
    q0 = -p0 * h * rng.uniform(-0.5, 1.5, 2000) + 10 ** rng.uniform(-18, -2, 2000)
    starts = np.tile([[0, 1, 0.1, 0.1, 0], [0.0] * 5], (2000, 1, 1))  # others meet no kink
    starts[:, :, 4] = np.stack([q0, p0], axis=-1)
    for solver in ("auto", "newton"):
        run = gs.stepper("EMS", system=FAIR).integrate_ensemble(
            starts[:, 0], starts[:, 1], dt=h, steps=1, solver=solver,
            parameters=FAIR_PARAMETERS | {"b": stiffness})
        q1, p1 = np.array(run.q)[:, -1, 4], np.array(run.p)[:, -1, 4]
        assert np.isfinite(q1).all()
        H0, H1 = (m**2 / 2 + stiffness * np.maximum(x, 0) ** 2 / 2 for x, m in ((q0, p0), (q1, p1)))
        assert (np.abs(H1 - H0) <= 256 * EPS * (H0 + H1)).all()


def test_jacobian_is_that_of_the_residual():
    """The Jacobian equals central differences at random unknowns, half of them across a kink."""
    step = gs.stepper("EMS", system=FAIR)
    run = {"dt": 0.5, "parameters": FAIR_PARAMETERS}
    rng = np.random.default_rng(3)
    for _ in range(10):
        at_q, at_p, unknowns = (rng.uniform(-1, 1, n) for n in (5, 5, 10))
        J = step.jacobian(unknowns, at_q, at_p, **run)
        assert np.isfinite(J).all()
        differences = jacobian_by_differences(step, unknowns, at_q, at_p, **run)
        assert np.abs(differences - J).max() <= 1e-7 * np.abs(J).max()


def test_conditions_hold():
    scheme = generate(Spec.from_arguments("EMS"), system=FAIR).scheme
    assert isinstance(scheme, MeanScheme)
    assert scheme.order == 2
    lines = {line.name: line for line in check_mean_scheme(scheme)}
    assert all(line.holds for line in lines.values())


@pytest.mark.slow  # a stepper of eight springs
def test_many_of_them():
    """A chain of one-sided springs has one form, which the C loops over, and keeps its energy."""
    n = 8
    u, v = sp.symbols(f"u0:{n}", real=True), sp.symbols(f"v0:{n}", real=True)
    slack = [sp.Max(0, upper - lower - a) for lower, upper in pairwise(u)]
    chain = gs.System(u, v, (k, a), sum(z**2 for z in v) / 2 + k * sum(s**2 for s in slack)
                      + sp.Abs(u[0]) + sum(P((z**2, z < 0), (0, True)) for z in u), name="slack")
    generated = generate(Spec.from_arguments("EMS"), system=chain)
    assert generated.source.source.count("term0_count = ") == 1
    assert len(re.findall(r"static \w+ term\d+_energy", generated.source.source)) <= 5
    step = gs.stepper("EMS", system=chain)
    start = np.linspace(-1, 5, n)
    run = step.integrate(start, -start / 2, dt=0.02, steps=500, parameters={"k": 2.0, "a": 0.5})
    assert run.report.energy_error_max <= 4 * EPS * np.sqrt(500) * 20
