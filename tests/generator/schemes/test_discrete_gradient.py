"""The discrete gradient of the heavy top: ΔH = D·Δ, symmetric, consistent, proved by algebra.

That of other expressions is in test_discrete_functions.py.
"""

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
from gyrospark.generator.schemes.discrete_gradient import discrete_gradient
from gyrospark.generator.schemes.step_equations import MeanScheme
from gyrospark.generator.schemes.system_differences import constraint_increment, vector
from gyrospark.generator.symbolic.shared_subexpressions import expand_shared

x = sp.symbols("x0:3", real=True)
xm = sp.symbols("xm0:3", real=True)
dx = sp.symbols("dx0:3", real=True)
a = sp.Symbol("a", positive=True)
x0, x1, _ = x


def gradient_of(e):
    return [expand_shared(D) for D in discrete_gradient(e, x, xm, dx)]


def test_symbols_that_do_not_occur_have_slope_zero_and_constants_have_none():
    assert gradient_of(x1 * a) == [0, a, 0]
    assert gradient_of(sp.sin(a) + sp.Integer(3)) == [0, 0, 0]
    assert gradient_of(sp.sin(a) * x0) == [sp.sin(a), 0, 0]  # any function of parameters


@pytest.mark.parametrize(("e", "name"), [
    (x1 + sp.LambertW(x0), "LambertW"),
    (sp.sqrt(1 + sp.erf(x1)), "erf"),
    (sp.Function("f")(x0), "f"),
    (sp.Piecewise((x0, x0 > 0), (0, True)), "Piecewise"),
    (sp.Max(x0, x1), "Max"),
])
def test_function_without_a_known_difference_is_refused_by_name(e, name):
    with pytest.raises(InputError, match=f"'{name}'"):
        gradient_of(e)


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


def test_constraints_change_by_twice_the_mean_times_dq_exactly():
    (row,) = top_scheme("gamma").mean_constraint
    assert polynomial_zero(*(e - 2 * mean for e, mean in zip(row, qm, strict=True)))
    top = heavy_top("gamma")
    d = vector("d", 4)
    moved = {s: s + e for s, e in zip(q, d, strict=True)}
    (found,) = constraint_increment(top, d)
    (g,) = top.constraints
    assert polynomial_zero(found - g.xreplace(moved) + g)
    assert polynomial_zero(found - sum(e * (2 * s + e) for s, e in zip(q, d, strict=True)))
