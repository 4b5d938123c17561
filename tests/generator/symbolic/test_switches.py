"""Functions with two sides: what SymPy calls Piecewise, Max, Min, Abs, sign, Heaviside, Mod, …

Values are compared with SymPy's own, derivatives with differences in 50 digits, and the C of every
type with exact values, also where the side that is not taken is no number.
"""

import platform
import random
import re
from dataclasses import replace
from fractions import Fraction
from functools import cache
from itertools import product

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from c_programs import run
from compilers import compiler
from gyrospark.core.errors import InputError
from gyrospark.generator.pipeline import generate
from gyrospark.generator.schemes.fast_path import FastSystem
from gyrospark.generator.spec import Spec
from gyrospark.generator.symbolic.derivatives import derivative
from gyrospark.generator.symbolic.identities import evaluate
from gyrospark.generator.symbolic.numeric_evaluation import Evaluator, mp_context
from gyrospark.generator.symbolic.numeric_evaluation import evaluate as in_numpy
from gyrospark.generator.symbolic.switching_functions import Max, Min, as_switches, switches_of
from gyrospark.generator.systems.numeric_system import NumericConstraints
from gyrospark.generator.systems.repeated_structure import Structure
from strategies import EPS

x, y, u, v, t = sp.symbols("x y u v t", real=True)
k, a = sp.symbols("k a", positive=True)
P, H, Q = sp.Piecewise, sp.Heaviside, sp.Rational

ZOO = {
    "drag": sp.Abs(x) * x, "coulomb": -k * sp.sign(x),
    "one-sided": k * sp.Max(0, sp.sqrt(x**2 + y**2) - a) ** 2 / 2,
    "contact": k * sp.Max(0, -y) ** Q(3, 2), "saturation": sp.Min(sp.Max(x * y, -1), 1),
    "three": sp.Max(x, y, -x - y) + sp.Min(x, y, k), "step": H(x - a) + H(y, 1),
    "backlash": P((k * (x + a), x < -a), (0, x <= a), (k * (x - a), True)),
    "window": P((1, (x > 0) & (x < a)), (2, sp.Or(y > 1, sp.Eq(x, -1))), (3, True)),
    "never": P((sp.log(x), x > 0), (sp.sqrt(-x), y < 1), (1 / (x + y - 3), True)),
    "not": P((x, sp.Not((x < 0) | (y > 0))), (y, sp.Ne(x, 1)), (k, True)),
    "saw": sp.Mod(x, a) + sp.frac(y) + sp.ceiling(x + y) - sp.floor(x * y),
    "root": sp.sqrt(sp.Max(x, 0)) * sp.sqrt(sp.Abs(y)),
    "nested": sp.Max(P((x, y < 0), (sp.Abs(x - y), True)), sp.sign(x)) ** k,
}
named = pytest.mark.parametrize("name", ZOO)
#: Whole numbers and halves among them: kinks and ties of most of the above.
PLACES = [-1.0, -0.75, 0.0, 0.375, 0.75, 2.5]
PARAMETERS = {"k": 1.5, "a": 0.75}


@pytest.fixture(autouse=True)
def fifty_digits():
    with mp.workdps(50):
        yield


def points():
    """Yield every pair (x, y) of places as floats, and as exact numbers by symbol."""
    for pair in product(PLACES, PLACES):
        yield pair, {s: Fraction(value) for s, value in
               zip((x, y, k, a), (*pair, *PARAMETERS.values()), strict=True)}


@cache
def sympys(e, pair):
    """Return SymPy's own value at (x, y), to 40 digits; None where it is no real number."""
    numbers = dict(zip((x, y, k, a), map(Q, (*pair, *PARAMETERS.values())), strict=True))
    value = sp.N(e.subs(numbers), 40)
    return mp.mpf(str(value)) if value.is_real and value.is_finite else None


def ours(e, point):
    try:
        return evaluate([e], point, 50)[e]
    except (ValueError, ArithmeticError):
        return None


@named
def test_values_are_those_of_sympy(name):
    """Values by two walks in mpmath and in NumPy are SymPy's, and missing where SymPy has none."""
    e = as_switches(ZOO[name])
    assert not e.has(P, sp.Max, sp.Min, H, sp.Mod, sp.ceiling, sp.frac)
    context = mp_context(50)
    compared = 0
    for pair, point in points():
        expected, value = sympys(ZOO[name], pair), ours(e, point)
        assert (expected is None) == (value is None), point
        if expected is None:
            continue
        compared += 1
        assert abs(value - expected) <= mp.mpf(10) ** -35 * (1 + abs(expected))
        lazy = Evaluator({s: context.mpf(float(p)) for s, p in point.items()}, mp=context)(e)
        assert abs(lazy - expected) <= mp.mpf(10) ** -35 * (1 + abs(expected))
        doubles = {s: np.full(2, float(p)) for s, p in point.items()}
        assert np.abs(in_numpy([e], doubles) - float(expected)).max() <= 16 * EPS * (
            1 + abs(expected))
    assert compared > 20


@named
def test_derivatives_are_those_of_the_sides(name):
    """Derivatives agree with differences away from the kinks and never have Dirac's delta."""
    e = as_switches(ZOO[name])
    slopes = [derivative(e, s) for s in (x, y)]
    assert not any(d.has(sp.DiracDelta, sp.Derivative, P) for d in slopes)
    assert slopes == [sp.diff(e, s).doit() for s in (x, y)] or e.has(sp.sign, sp.Abs, sp.floor,
                                                                   sp.sqrt, sp.Pow)
    rng, step = random.Random(5), Fraction(1, 10**25)
    compared = 0
    for _ in range(20):
        point = {x: Fraction(rng.uniform(-2, 2)), y: Fraction(rng.uniform(-2, 2)),
                 k: Fraction(3, 2), a: Fraction(3, 4)}
        for s, slope in zip((x, y), slopes, strict=True):
            near = [ours(e, point | {s: point[s] + d}) for d in (-step, step)]
            if None in near:
                continue
            expected = (near[1] - near[0]) / (2 * mp.mpf(10) ** -25)
            assert abs(ours(slope, point) - expected) <= mp.mpf(10) ** -15 * (1 + abs(expected))
            compared += 1
    assert compared > 10


@pytest.mark.parametrize(("e", "at_zero"), [
    (sp.Abs(x), 0), (sp.Max(x, 0), Q(1, 2)), (sp.Min(x, 0), Q(1, 2)), (sp.sign(x), 0), (H(x), 0),
    (sp.Max(x, -x), 0), (sp.Abs(x) * x, 0), (sp.Max(0, x) ** 2, 0),
    (P((sp.sqrt(x), x > 0), (0, True)), 0), (sp.sqrt(sp.Max(0, x + x**2) + 1), Q(1, 4)),
])
def test_derivative_at_the_kink_is_a_mean_or_that_of_a_side(e, at_zero):
    slope = derivative(as_switches(e), x)
    assert ours(slope, {x: Fraction(0)}) == mp.mpf(at_zero.p) / at_zero.q if at_zero else \
        ours(slope, {x: Fraction(0)}) == 0


def test_roots_that_rest_at_zero_do_not_move_and_pieces_that_cover_the_line_need_no_true():
    for e in (sp.sqrt(sp.Max(0, x)), sp.Max(0, x) ** Q(3, 2), (k * sp.Max(0, x)) ** Q(1, 3)):
        first = derivative(as_switches(e), x)
        for d in (first, derivative(first, x)):
            assert ours(d, {x: Fraction(-1), k: Fraction(2)}) == 0
    for e in (P((0, x <= 0), (x, x > 0)), P((0, x < 0), (x, (x >= 0) & (x < 1)), (1, x >= 1))):
        switches = as_switches(e)
        assert [ours(switches, {x: Fraction(p)}) for p in (-1, 0.5)] == [0, 0.5]


@pytest.mark.parametrize(("e", "reason"), [
    (P((x, x > 1), (2, x < 1)), r"value.*\(value, True\)"),
    (P((x, x > k)), "value"),
    (P((x, sp.Symbol("b")), (2, True)), "Piecewise"),
    (P((x, sp.Xor(x > 0, y > 0)), (2, True)), "<"),
    (sp.Eq(x**2, 1), r"equation.*x\*\*2 - 1\."),
    (x > 0, r"condition.*Piecewise\(\(1, x > 0\), \(0, True\)\)"),
])
def test_what_is_no_expression_is_refused(e, reason):
    with pytest.raises(InputError, match=reason):
        gs.System((x,), (u,), (k,), u**2 / 2, forces=(e,))


def test_symbols_are_real_numbers_declared_or_not():
    """SymPy's |e^z| is e^(re z) where z may be complex."""
    z = sp.Symbol("z")
    system = gs.System((z,), (u,), (), u**2 / 2 + sp.Abs(sp.exp(z)) + sp.Abs(z))
    assert system.H - u**2 / 2 == sp.exp(z) + sp.Abs(z)
    assert system.H_q == [sp.exp(z) + sp.sign(z)]


def test_orders_of_two_and_text_that_reads_like_a_model_file():
    assert Max(x, x) == Min(x, x) == x
    assert (Max(Q(1, 2), Q(1, 3)), Min(Q(1, 2), Q(1, 3))) == (Q(1, 2), Q(1, 3))
    assert Max(y, x) == Max(x, y)
    assert Max(x, k).is_extended_nonnegative
    assert Max(x, y).is_extended_nonnegative is None
    for arguments in ((x,), (x, y, k)):
        with pytest.raises(TypeError, match="2"):
            Max(*arguments)
    assert str(as_switches(ZOO["window"])) == (
        "if(0 < x and x < a, 1, if(not (-1 >= x and x >= -1) and 1 >= y, 3, 2))")
    assert str(as_switches(sp.Max(x, 0))) == "max(0, x)"
    assert [str(w) for w in switches_of([as_switches(ZOO["window"])])] == [
        "-a + x", "-x", "1 - y", "x + 1"]


QUANTITIES = {name.replace("-", "_"): e for name, e in ZOO.items()}


def watched(**more):
    return gs.System((x, y), (u, v), (k, a), (u**2 + v**2) / 2, name="sides",
                     **{"quantities": QUANTITIES, **more})


#: Whatever compares with √x at x < 0 is no number; SymPy does not decide either.
ROOT = sp.sqrt(x)
UNDECIDED = {"max_of_none": sp.Max(0, ROOT), "least_of_none": sp.Min(ROOT, 2),
             "sign_of_none": sp.sign(ROOT), "where_none": P((1, ROOT < 1), (2, True)),
             "other_none": P((1, ROOT > 1), (2, True))}


@pytest.mark.parametrize("real", ["double", *(
    pytest.param(real, marks=pytest.mark.slow) for real in ("float", "long-double", "float128"))])
def test_C_of_every_type(real):
    """The C is a few roundings from the exact values at all points, and NaN where there is none."""
    step = gs.stepper("IMS", system=replace(FORCED, quantities=QUANTITIES | UNDECIDED), real=real)
    eps = max(step.binding.epsilon, EPS)
    for pair, _ in points():
        quantities = step.quantities(pair, [0.0, 0.0], parameters=PARAMETERS)
        for name, e in QUANTITIES.items():
            expected, value = sympys(e, pair), float(quantities[name])
            assert (expected is None) == (not np.isfinite(value)), (name, pair)
            if expected is not None:
                assert abs(value - float(expected)) <= 16 * eps * (1 + abs(expected)), (name, pair)
        undecided = np.isnan([float(quantities[name]) for name in UNDECIDED])
        assert undecided.all() if pair[0] < 0 else not undecided.any()


#: Both sides of everything, some of them no numbers, in forces on four trajectories or more.
FORCED = watched(quantities={}, time=t, constraints=[], forces=(
    -k * sp.Abs(u) * u - sp.Max(0, x - a) ** Q(3, 2) + P((sp.log(x), x > 1), (0, True)),
    -sp.Min(sp.Max(3 * v, -1), 1) - sp.floor(y) / 8 + P((1, (t > 0.3) & (t < 0.7)), (0, True))
    + sp.sign(y) * sp.Max(0, sp.Abs(y) - a)))


def test_lanes_take_their_own_sides():
    """Trajectories side by side have the bits of each alone with the same width of lanes."""
    step = gs.stepper("IMS", system=replace(FORCED, quantities=QUANTITIES | UNDECIDED))
    rng = np.random.default_rng(2)
    q, p = rng.uniform(-2, 2, (9, 2)), rng.uniform(-2, 2, (9, 2))
    options = {"dt": 0.02, "steps": 60, "parameters": PARAMETERS}
    ensemble = step.integrate_ensemble(q, p, **options)
    for i in range(9):
        member = step.integrate_ensemble(q[i : i + 1], p[i : i + 1], **options)
        assert np.array_equal(member.q[0], ensemble.q[i])
        alone = step.integrate(q[i], p[i], **options)
        # other starting values end at other roundings, which kinks spread: ten times an ulp of q
        # for each of the 60 steps
        assert np.abs(alone.q - ensemble.q[i]).max() <= 60 * 10 * 2.0**-52 * np.abs(alone.q).max()


def test_lanes_have_no_branch(tmp_path):
    """Lanes choose a side by masks: the assembly compares and does not jump."""
    if platform.machine() not in ("x86_64", "AMD64"):
        pytest.skip("reads the assembly of x86-64")
    source = generate(Spec.from_arguments("IMS"), system=FORCED).source
    text = re.search(r"INLINE lanes lanes_choose.*?\n}\n", source.source, re.DOTALL)[0]
    (tmp_path / "choose.c").write_text(
        "typedef double lanes __attribute__((vector_size(16)));\n"
        "typedef __typeof__((lanes){ 0 } < (lanes){ 0 }) lanes_mask;\n"
        + text.replace("INLINE", "", 1).replace("#if defined(LANE_BYTES)", ""))
    run([*compiler("gcc"), "-std=c11", "-O2", "-S", "choose.c", "-o", "choose.s"], tmp_path)
    assembly = (tmp_path / "choose.s").read_text()
    assert "cmpltpd" in assembly
    assert not re.search(r"\tj\w+\t", assembly)


def test_a_derivative_that_vanishes_says_nothing_of_a_step():
    """sign(q·p) has the derivative 0 and is moved by a constraint force along q."""
    circle = (x**2 + y**2 - 1,)
    radial = sp.sign(x * u + y * v)
    H_0 = (u**2 + v**2) * (1 + x**2) / 2
    moved = gs.System((x, y), (u, v), (k,), H_0, circle,
                      forces=((x * v - y * u) + radial, x * v - y * u + 2 * radial))
    shared = FastSystem(moved).shared_sums
    assert all(not e.has(sp.sign) for e in shared)
    steps = gs.System((x, y), (u, v), (k,), H_0 + (x * u + y * v) * radial, circle)
    assert not FastSystem(steps).is_affine
    mixed = gs.System((x,), (u,), (k,), u**2 / 2 + sp.Abs(u + x))
    assert all(e == 0 for row in mixed.H_pq for e in row)
    assert not FastSystem(mixed).is_separable
    assert not Structure(mixed).is_separable
    assert not Structure(gs.System((x,), (u,), (k,), sp.Abs(u) + x**2)).is_quadratic


def test_switches_by_a_floor_alone_are_where_the_floor_jumps():
    whole = sp.floor(x)
    assert switches_of([as_switches(sp.sign(whole - sp.Rational(1, 2)))]) == [x]


def test_constraints_by_complex_steps():
    """|q| is analytic on each of its sides: Im g(q + iε)/ε is its derivative."""
    g = as_switches(sp.Abs(x) ** 3 + sp.Max(0, y) ** 2 + P((x, x < y), (y, True)) - 1)
    constraints = NumericConstraints((x, y), [g], ["g"], {})
    for point in ([-0.7, 0.4], [0.3, -0.2], [0.9, 0.8]):
        gradient = [
            float(ours(derivative(g, s), dict(zip((x, y), map(Fraction, point), strict=True))))
            for s in (x, y)]
        assert constraints.G(np.array(point))[0] == pytest.approx(
            gradient, rel=8 * EPS, abs=8 * EPS)
