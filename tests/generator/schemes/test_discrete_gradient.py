"""The discrete gradient: ΔH = D·Δ exactly, symmetric, consistent; proved, then in doubles.

The proofs are algebraic: every root √u becomes a variable r with the relation r² = u, the
numerator of the residual is divided by the relations, and the remainder must be zero.
"""

from __future__ import annotations

import pytest
import sympy as sp

from gyrospark.core.errors import InputError
from gyrospark.generator.multibody.rigid_body import (
    alpha,
    gamma,
    heavy_top,
    left_matrix,
    mgl,
    moments,
)
from gyrospark.generator.schemes.discrete_gradient import (
    DiscreteDifference,
    differentiate,
    discrete_gradient,
)
from gyrospark.generator.schemes.step_equations import MeanScheme
from gyrospark.generator.schemes.system_differences import constraint_increment, vector
from gyrospark.generator.symbolic.shared_subexpressions import expand_shared

x = sp.symbols("x0:3", real=True)
xm = sp.symbols("xm0:3", real=True)
dx = sp.symbols("dx0:3", real=True)
a, b = sp.symbols("a b", positive=True)
x0, x1, x2 = x

STARTS = {s: mean - d / 2 for s, mean, d in zip(x, xm, dx, strict=True)}
ENDS = {s: mean + d / 2 for s, mean, d in zip(x, xm, dx, strict=True)}
MEANS = dict(zip(x, xm, strict=True))
NO_STEP = dict.fromkeys(dx, sp.Integer(0))
EXCHANGED = {d: -d for d in dx}


def is_zero(*expressions):
    """Prove that algebraic expressions vanish, by division by the relations of their roots."""
    return all(prove_zero(e) for e in expressions)


def prove_zero(e):
    roots = {}  # what is under a root, in terms of earlier roots → its symbol

    def vanishes(quotient):
        remainder = sp.expand(sp.together(quotient).as_numer_denom()[0])
        for base, r in reversed(roots.items()):  # roots under other roots come last
            above, below = sp.fraction(base)
            remainder = sp.prem(remainder, below * r**2 - above, r)  # at most linear in r is left
        return sp.expand(remainder) == 0

    def plain(node):
        if node.is_Atom:
            return node
        node = node.func(*map(plain, node.args))
        if not (node.is_Pow and node.exp.is_Rational and node.exp.q == 2):
            return node
        base = sp.cancel(node.base)
        known = next((r for other, r in roots.items() if vanishes(base - other)), None)
        if known is None:
            roots[base] = known = sp.Symbol(f"r{len(roots)}")
        return known ** node.exp.p

    return vanishes(plain(e))


def gradient_of(e):
    return [expand_shared(D) for D in discrete_gradient(e, x, xm, dx)]


def residual(e):
    """Return ΔH − D·Δ."""
    change = e.xreplace(ENDS) - e.xreplace(STARTS)
    return change - sum(D * d for D, d in zip(gradient_of(e), dx, strict=True))


POLYNOMIALS = {
    "linear": 3 * x0 - a * x1 + 2,
    "square": x0**2,
    "cube": x0**3,
    "sixth": x1**6,
    "mixed": x0 * x1**2 * x2**3 - b * x0 * x1,
    "square of a sum": (x0 + 2 * x1 - a) ** 2,
    "nested powers": ((x0**2 + x1) ** 3 + x2) ** 2,
    "product of sums": (x0 + x1) * (x1 + x2) * (x2 + x0) * (a - x0),
}
QUOTIENTS = {
    "reciprocal": 1 / x0,
    "negative square": x0**-2,
    "negative cube": x0**-3,
    "quotient": (x0 + a) / (x1**2 + b),
    "quotient of quotients": (x0 / x1) / (1 + x2 / x0),
    "Kepler squared": a / (x0**2 + x1**2 + x2**2),
}
ROOTS = {
    "root": sp.sqrt(x0),
    "three halves": x0 ** sp.Rational(3, 2),
    "minus a half": 1 / sp.sqrt(x0),
    "minus three halves": x0 ** sp.Rational(-3, 2),
    "length": sp.sqrt(x0**2 + a),
    "product of roots": sp.sqrt(x0) * sp.sqrt(x1 + x2),
    "inverse length": b / sp.sqrt(x0**2 + x1**2),
    "root under root": sp.sqrt(a + sp.sqrt(x0)),
    "relativistic": sp.sqrt(a**2 + x0**2) + x1 * x0,
}
ZOO = POLYNOMIALS | QUOTIENTS | ROOTS
named = pytest.mark.parametrize("e", ZOO.values(), ids=ZOO.keys())


def test_the_prover_itself_rejects_what_is_false():
    assert not is_zero(x0 - x1)
    assert not is_zero(sp.sqrt(x0**2 + a) - x0)
    assert not is_zero(sp.sqrt(a + sp.sqrt(x0)) - sp.sqrt(a))
    assert is_zero(sp.sqrt(x0**2 + a) ** 3 - (x0**2 + a) * sp.sqrt(x0**2 + a))
    assert is_zero(1 / (sp.sqrt(x0 + 1) + 1) - (sp.sqrt(x0 + 1) - 1) / x0)


@named
def test_change_of_e_is_D_times_change_of_x_exactly(e):
    assert is_zero(residual(e))


@named
def test_D_is_symmetric_under_exchange_of_the_end_points(e):
    assert is_zero(*(D - D.xreplace(EXCHANGED) for D in gradient_of(e)))


@named
def test_D_is_the_gradient_when_the_end_points_meet(e):
    derivatives = [sp.diff(e, s).xreplace(MEANS) for s in x]
    at_rest = [D.xreplace(NO_STEP) for D in gradient_of(e)]
    assert is_zero(*(D - d for D, d in zip(at_rest, derivatives, strict=True)))


@pytest.mark.parametrize("e", [x0 * x1, x0**3, 1 / x0, sp.sqrt(x0), x0**-2 * x1])
def test_mean_is_the_mean_of_the_end_values_exactly(e):
    leaves = {s: DiscreteDifference(mean, {i: sp.Integer(1)}, dx)
              for i, (s, mean) in enumerate(zip(x, xm, strict=True))}
    found = differentiate(e, leaves, dx)
    assert is_zero(expand_shared(found.mean) - (e.xreplace(STARTS) + e.xreplace(ENDS)) / 2)


def test_symbols_that_do_not_occur_have_slope_zero_and_constants_have_none():
    assert gradient_of(x1 * a) == [0, a, 0]
    assert gradient_of(sp.sin(a) + sp.Integer(3)) == [0, 0, 0]
    assert gradient_of(sp.sin(a) * x0) == [sp.sin(a), 0, 0]  # any function of parameters


@pytest.mark.parametrize(
    ("e", "name"),
    [
        (x1 + sp.LambertW(x0), "LambertW"),
        (sp.sqrt(1 + sp.erf(x1)), "erf"),
        (sp.Function("f")(x0), "f"),
        (sp.Piecewise((x0, x0 > 0), (0, True)), "Piecewise"),
        (sp.Max(x0, x1), "Max"),
    ],
)
def test_function_without_a_known_difference_is_refused_by_name(e, name):
    with pytest.raises(InputError, match=f"'{name}'"):
        gradient_of(e)


# ---------------------------------------------------------------- the heavy top

q, p = sp.symbols("q0:4", real=True), sp.symbols("p0:4", real=True)
qm, pm = vector("qm", 4), vector("pm", 4)
dq, dp = vector("dq", 4), vector("dp", 4)
START = {s: mean - d / 2 for s, mean, d in zip((*q, *p), (*qm, *pm), (*dq, *dp), strict=True)}
END = {s: mean + d / 2 for s, mean, d in zip((*q, *p), (*qm, *pm), (*dq, *dp), strict=True)}
K = sp.diag(1, -1, -1, 1)
REPS = ["alpha", "gamma"]


def top_scheme(rep):
    return MeanScheme(heavy_top(rep), discrete=True)


def polynomial_zero(*expressions):
    """Whether polynomials in the variables and the inverse parameters vanish."""
    inverse = {1 / s: sp.Symbol(f"over_{s}") for s in (*moments, alpha, gamma)}
    for e in map(sp.sympify, expressions):
        flat = e.xreplace(inverse)
        if flat.free_symbols and sp.ring(sorted(flat.free_symbols, key=str), sp.QQ)[0].from_expr(
                flat) != 0:
            return False
        if not flat.free_symbols and flat != 0:
            return False
    return True


@pytest.mark.parametrize("rep", REPS)
def test_energy_changes_by_D_times_change_of_state_exactly(rep):
    D_q, D_p = top_scheme(rep).mean_gradient
    H = heavy_top(rep).H
    change = H.xreplace(END) - H.xreplace(START)
    products = zip((*D_q, *D_p), (*dq, *dp), strict=True)
    assert polynomial_zero(change - sum(D * d for D, d in products))


@pytest.mark.parametrize("rep", REPS)
def test_58_59_as_erratum_5_corrects_them(rep):
    mean_Lp = sp.zeros(3, 1)
    mean_qp = sp.Integer(0)
    for end in (START, END):
        at_q, at_p = [s.xreplace(end) for s in q], [s.xreplace(end) for s in p]
        mean_Lp += left_matrix(at_q) * sp.Matrix(at_p) / 2
        mean_qp += sp.Matrix(at_q).dot(sp.Matrix(at_p)) / 2
    mean_Lq = -mean_Lp  # L(p)q = −L(q)p
    Q, P = sp.Matrix(qm), sp.Matrix(pm)
    LQ, LP = left_matrix(qm), left_matrix(pm)
    J_INVERSE = sp.diag(*[1 / i for i in moments])
    if rep == "alpha":
        H_p = (LQ.T * J_INVERSE * mean_Lp + Q * mean_qp / alpha) / 4
        H_q = (LP.T * J_INVERSE * mean_Lq + P * mean_qp / alpha) / 4
    else:
        D = J_INVERSE - sp.eye(3) / gamma
        H_p = (P / gamma + LQ.T * D * mean_Lp) / 4
        H_q = LP.T * D * mean_Lq / 4
    H_q += 2 * mgl * K * Q  # ∂V*/∂q
    D_q, D_p = top_scheme(rep).mean_gradient
    assert polynomial_zero(*(sp.Matrix(D_p) - H_p), *(sp.Matrix(D_q) - H_q))


@pytest.mark.parametrize("rep", REPS)
def test_gradient_of_the_top_is_symmetric_and_consistent_hence_of_order_2(rep):
    scheme = top_scheme(rep)
    top = heavy_top(rep)
    D = [*scheme.mean_gradient[0], *scheme.mean_gradient[1]]
    back = {d: -d for d in (*dq, *dp)}
    assert polynomial_zero(*(e - e.xreplace(back) for e in D))
    at_mean = dict(zip((*q, *p), (*qm, *pm), strict=True))
    rest = dict.fromkeys((*dq, *dp), sp.Integer(0))
    assert polynomial_zero(*(
        e.xreplace(rest) - g.xreplace(at_mean)
        for e, g in zip(D, (*top.H_q, *top.H_p), strict=True)))
    assert scheme.order == 2
    assert MeanScheme(top, discrete=False).order == 2


def test_constraint_changes_by_twice_the_mean_times_dq():
    (row,) = top_scheme("gamma").mean_constraint
    assert polynomial_zero(*(e - 2 * mean for e, mean in zip(row, qm, strict=True)))


def test_constraint_increment_is_the_change_of_g_exactly():
    top = heavy_top("gamma")
    d = vector("d", 4)
    moved = {s: s + e for s, e in zip(q, d, strict=True)}
    (found,) = constraint_increment(top, d)
    (g,) = top.constraints
    assert polynomial_zero(found - g.xreplace(moved) + g)
    assert polynomial_zero(found - sum(e * (2 * s + e) for s, e in zip(q, d, strict=True)))
