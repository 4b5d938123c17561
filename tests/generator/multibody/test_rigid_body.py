"""The paper's identities about q, L, R, T and H, proved as polynomial identities.

An identity on the constraint manifold is proved by division through the Gröbner basis of
|q|² − 1 and qᵀp: remainder zero. The inverses 1/I_i, 1/α, 1/γ are variables of their own, so every
expression is a polynomial.
"""

from functools import cache

import pytest
import sympy as sp

from gyrospark.core.errors import InputError
from gyrospark.generator.multibody.rigid_body import (
    alpha,
    double_momentum,
    free_body,
    gamma,
    gravity_potential,
    heavy_top,
    kinetic_energy,
    left_matrix,
    mgl,
    moments,
    p,
    q,
    rotation_matrix,
)

v = sp.symbols("v0:4", real=True)  # q̇, a free vector
dq = sp.symbols("dq0:4", real=True)
dp = sp.symbols("dp0:4", real=True)
a = sp.symbols("a1:4", positive=True)  # other moments
INVERSE = {1 / x: sp.Symbol(f"over_{x}") for x in (*moments, alpha, gamma)}
Q, P, V, DQ, DP = (sp.Matrix(x) for x in (q, p, v, dq, dp))
J = sp.diag(*moments)
J_INVERSE = sp.diag(*[1 / x for x in moments])
K = sp.diag(1, -1, -1, 1)
L, R = left_matrix(q), rotation_matrix(q)
LP = left_matrix(p)
ONE3 = sp.eye(3)

UNIT = Q.dot(Q) - 1
ORTHOGONAL = Q.dot(P)
TANGENT = Q.dot(V)


def polynomials(value, symbols=()):
    """Return the entries as elements of one polynomial ring over ℚ."""
    entries = [value] if isinstance(value, sp.Expr) else list(sp.Matrix(value))
    entries = [entry.xreplace(INVERSE) for entry in entries]
    used = set().union(*(entry.free_symbols for entry in entries), symbols)
    names = sorted(used, key=lambda x: (x.name[0] not in "qp", x.name))
    ring = sp.ring(names or [sp.Dummy()], sp.QQ, "grevlex")[0]
    return ring, [ring.from_expr(entry) for entry in entries]


def vanishes(value):
    """Return whether an expression or matrix is zero as a polynomial."""
    return not any(polynomials(value)[1])


@cache
def basis_of(relations):
    return sp.groebner(relations, order="grevlex").exprs


def vanishes_on(relations, value):
    """Return whether an expression or matrix lies in the ideal of the relations."""
    basis = basis_of(tuple(relations))
    symbols = set().union(*(e.free_symbols for e in basis))
    ring, entries = polynomials(value, symbols)
    divisors = [ring.from_expr(e) for e in basis]
    return not any(entry.rem(divisors) for entry in entries)


def on_manifold(value):
    return vanishes_on([UNIT, ORTHOGONAL], value)


def hat(w):
    """Return the matrix (6) of a vector."""
    return sp.Matrix([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def along(matrix, direction):
    """Return the derivative of a function of q along q̇."""
    return matrix.applyfunc(lambda e: sum(sp.diff(e, x) * d for x, d in zip(q, direction,
                                                                         strict=True)))


def test_the_prover_itself_rejects_what_is_false():
    assert not on_manifold(Q.dot(Q))
    assert not on_manifold(q[0] * p[0])
    assert not vanishes(Q.dot(Q))
    assert on_manifold(q[0] * UNIT + 3 * ORTHOGONAL / moments[0])


def test_9_10_11_L_is_antisymmetric_in_its_vectors_and_has_L_LT_and_LT_L_for_unit_q():
    assert vanishes(L * Q)
    assert vanishes(L * V + left_matrix(v) * Q)
    for product, expected in ((L * L.T, ONE3), (L.T * L, sp.eye(4) - Q * Q.T)):
        assert vanishes_on([UNIT], product - expected)
        assert not vanishes(product - expected)  # erratum 2: the printed forms need |q| = 1


def test_3_R_is_the_rotation_x_to_q_x_conjugate_q_with_determinant_one_for_unit_q():
    assert vanishes(R * R.T - Q.dot(Q) ** 2 * ONE3)
    assert vanishes(R.det(method="berkowitz") - Q.dot(Q) ** 3)
    x = sp.symbols("x1:4")
    turned = sp.Quaternion(*q) * sp.Quaternion(0, *x) * sp.Quaternion(*q).conjugate()
    assert vanishes(turned.a)
    assert vanishes(sp.Matrix([turned.b, turned.c, turned.d]) - R * sp.Matrix(x))


def test_5_to_8_Rdot_is_R_Omega_hat_with_Omega_2_L_qdot_so_R_maps_body_to_space():
    omega = 2 * L * V
    rate = along(R, v)
    # without |q| = 1 and qᵀq̇ = 0, exactly:
    assert vanishes(R * hat(omega) + 2 * TANGENT * R - Q.dot(Q) * rate)
    assert vanishes_on([UNIT, TANGENT], rate - R * hat(omega))


def test_19_20_l_and_the_legendre_transform_of_14():
    momentum = 4 * L.T * J * L * V
    assert vanishes_on([UNIT], J * (2 * L * V) - L * momentum / 2)
    assert vanishes(L * P + LP * Q)
    assert vanishes(sp.Matrix(double_momentum(q, p)) - L * P)
    momentum = 4 * L.T * J * L * V
    T = (2 * V.T * L.T * J * L * V)[0]
    assert vanishes(momentum.dot(V) - T - T)  # pᵀq̇ − T = T
    # (20) depends on p through w = L(q)p alone, which at this p is 4|q|²JLq̇, by 18
    assert vanishes(sp.Matrix(double_momentum(q, list(momentum))) - 4 * Q.dot(Q) * J * L * V)
    assert kinetic_energy("original") == sum(
        w**2 / Ii for w, Ii in zip(double_momentum(q, p), moments, strict=True)) / 8
    u = sp.Matrix(sp.symbols("u1:4"))  # L(q)q̇
    square = sp.Symbol("square")  # |q|²
    w = 4 * square * J * u
    hamiltonian = sum(x**2 / Ii for x, Ii in zip(w, moments, strict=True)) / 8
    assert sp.expand(hamiltonian - square**2 * 2 * (u.T * J * u)[0]) == 0  # |q|⁴ T
    assert vanishes(kinetic_energy("original") - (P.T * L.T * J_INVERSE * L * P)[0] / 8)


FORMS = {
    "original": (J_INVERSE, sp.zeros(4), sp.zeros(4), sp.zeros(4)),
    "alpha": (J_INVERSE, Q * Q.T / alpha, P * P.T / alpha, sp.zeros(4)),
    "gamma": (J_INVERSE - ONE3 / gamma, sp.zeros(4), sp.zeros(4), sp.eye(4) / gamma),
}


@pytest.mark.parametrize("rep", FORMS)
def test_21_23_27_hamiltons_equations_are_the_derivatives_of_H(rep):
    (D, q_qT, p_pT, square), top = FORMS[rep], heavy_top(rep)
    for ours, typed in (
            (top.H_p, (L.T * D * L * P + q_qT * P + square * P) / 4),
            (top.H_q, (LP.T * D * LP * Q + p_pT * Q) / 4 + 2 * mgl * K * Q),
            (top.H_pp, (L.T * D * L + q_qT + square) / 4),
            (top.H_qq, (LP.T * D * LP + p_pT) / 4 + 2 * mgl * K)):
        assert vanishes(sp.Matrix(ours) - typed)
    assert vanishes(sp.Matrix(top.H_pq).T - sp.Matrix(top.H_q).jacobian(p))
    assert [[2 * x for x in q]] == top.G  # the force −2λq


def test_22_26_28_types_equal_20_on_the_manifold_and_differ_by_a_multiple_of_the_constraint():
    extra = kinetic_energy("alpha") - kinetic_energy("original")
    assert vanishes(extra - P.dot(Q) ** 2 / alpha / 8)
    assert on_manifold(extra)
    D = J_INVERSE - ONE3 / gamma
    assert vanishes(kinetic_energy("gamma") - P.dot(P) / gamma / 8 - (P.T * L.T * D * L * P)[0] / 8)
    assert on_manifold(kinetic_energy("gamma") - kinetic_energy("original"))
    difference = kinetic_energy("gamma") - kinetic_energy("alpha").subs(alpha, gamma)
    assert vanishes(difference + UNIT * P.dot(P) / gamma / 8)
    assert vanishes_on([UNIT], difference)


MOVED_Q = [x + d for x, d in zip(q, dq, strict=True)]
MOVED_P = [x + d for x, d in zip(p, dp, strict=True)]
QM, PM = Q + DQ, P + DP
LM = left_matrix(MOVED_Q)
L_NOW, L_NEXT = L * P / 2, LM * PM / 2
DELTA_L = L_NEXT - L_NOW
K_S = (PM.dot(PM) - 4 * L_NEXT.dot(L_NEXT)) / 8
K_A = PM.dot(QM) ** 2 / 8


def intercept():
    """Return δT₀ of (36)."""
    return (DELTA_L.T * J_INVERSE * L_NOW)[0] + (DELTA_L.T * J_INVERSE * DELTA_L)[0] / 2


def test_34_to_38_energy_errors_are_the_intercept_and_k_over_gamma_or_alpha():
    error = kinetic_energy("original", MOVED_Q, MOVED_P) - kinetic_energy("original")
    assert vanishes(error - intercept())
    moved = kinetic_energy("gamma", MOVED_Q, MOVED_P)
    # exactly, with (20) in place of T on the manifold, which 26 proves equal:
    assert vanishes(moved - kinetic_energy("original") - K_S / gamma - intercept())
    assert on_manifold(kinetic_energy("gamma") - kinetic_energy("original"))
    moved = kinetic_energy("alpha", MOVED_Q, MOVED_P)
    assert vanishes(moved - kinetic_energy("original") - K_A / alpha - intercept())
    assert on_manifold(kinetic_energy("alpha") - kinetic_energy("original"))


def test_79_gravity_is_mgl_times_R33():
    assert vanishes(gravity_potential() - mgl * R[2, 2])
    assert vanishes(gravity_potential() - mgl * (Q.T * K * Q)[0])


@pytest.mark.parametrize(("rep", "parameter"), [("alpha", alpha), ("gamma", gamma)])
def test_17_hidden_constraint_is_qT_p_with_matrix_twice_the_square_of_q(rep, parameter):
    for system in (heavy_top(rep), free_body(rep)):
        assert vanishes(sp.Matrix(system.hidden) - sp.Matrix([ORTHOGONAL]))
        assert vanishes(sp.Matrix(system.hidden_matrix) - sp.Matrix([[2 * Q.dot(Q)]]))
        product = sp.Matrix(system.G) * sp.Matrix(system.H_p)
        factor = Q.dot(Q) if rep == "alpha" else 1
        assert vanishes(product[0] - factor * ORTHOGONAL / parameter / 2)


def test_original_type_is_singular_so_that_no_multiplier_can_act_on_qT_p():
    system = heavy_top("original")
    assert vanishes(sp.Matrix(system.H_pp) * Q)
    assert vanishes(sp.Matrix(system.G) * sp.Matrix(system.H_p))
    assert heavy_top("original").hidden == [0]


@pytest.mark.parametrize("rep", ["alpha", "gamma"])
def test_hamiltons_equations_are_eulers_equations_with_the_moment_of_gravity(rep):
    """l̇ = l × Ω + e₃ × (−mgl Rᵀe_z) for every multiplier; q̇ gives Ω = J⁻¹l."""
    top = heavy_top(rep)
    force = sp.Symbol("lam")
    q_rate = sp.Matrix(top.H_p)
    p_rate = -sp.Matrix(top.H_q) - force * sp.Matrix(top.G).T
    angular = L * P / 2
    rate = (left_matrix(list(q_rate)) * P + L * p_rate) / 2
    moment = sp.Matrix([0, 0, 1]).cross(-mgl * R[2, :].T)
    assert on_manifold(rate - angular.cross(J_INVERSE * angular) - moment)
    q_rate = sp.Matrix(heavy_top(rep).H_p)
    assert on_manifold(Q.dot(q_rate))
    assert on_manifold(2 * L * q_rate - J_INVERSE * L * P / 2)


@pytest.mark.parametrize(("system", "parameters"), [
    (heavy_top("alpha"), (*moments, mgl, alpha)),
    (heavy_top("gamma"), (*moments, mgl, gamma)),
    (heavy_top("original"), (*moments, mgl)),
    (free_body("alpha"), (*moments, alpha)),
    (free_body("gamma"), (*moments, gamma)),
])
def test_systems_are_unit_quaternions_with_the_parameters_of_their_energy(system, parameters):
    assert system.parameters == parameters
    assert (system.n, system.m, system.rigid_body) == (4, 1, True)
    assert vanishes(system.constraints[0] - UNIT)
    assert system.H.free_symbols == {*q, *p, *parameters}


def test_free_body_is_the_heavy_top_without_weight_and_T_takes_other_states_and_moments():
    for rep in ("alpha", "gamma"):
        assert vanishes(heavy_top(rep).H.subs(mgl, 0) - free_body(rep).H)
    swapped = kinetic_energy("gamma", p, q, a)
    there = dict(zip((*q, *p, *moments), (*p, *q, *a), strict=True))
    assert vanishes(swapped - kinetic_energy("gamma").xreplace(there))


def test_unknown_representation_is_refused_with_the_choices():
    with pytest.raises(InputError, match=r"'beta'.*gamma"):
        kinetic_energy("beta")
