"""Lagrangians whose M is regular and not positive definite, and starts where it has no inverse."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from scipy.linalg import expm

import gyrospark as gs
from gyrospark.core.errors import InputError
from strategies import EPS

Q, V = sp.symbols("x y", real=True), sp.symbols("vx vy", real=True)
START, RATES = np.array([0.3, 0.4]), np.array([0.1, -0.2])
K = np.array([[1.3, 1 / 3], [1 / 3, 1.3]])


@cache
def coupled():
    """Return a system with M = [[e, 1], [1, e]] and a spring."""
    e = sp.Symbol("e", positive=True)
    x, y = Q
    L = e * (V[0] ** 2 + V[1] ** 2) / 2 + V[0] * V[1]
    L -= sp.Rational(13, 20) * (x**2 + y**2) + x * y / 3
    return gs.System.from_lagrangian(L, Q, V, [e], name="coupled")


@cache
def stepper(*scheme):
    return gs.stepper(*scheme, system=coupled())


def closed(e, t):
    """Return (x, y, p) at t of M q'' = −K q."""
    M = np.array([[e, 1], [1, e]])
    zero = np.zeros((2, 2))
    A = np.block([[zero, np.linalg.inv(M)], [-K, zero]])
    return expm(A * t) @ np.concatenate([START, M @ RATES])


@pytest.mark.parametrize("e", [1e-15, 0.5, 3.0])
def test_any_sign_of_the_mass_matrix(e):
    parameters = {"e": e}
    step = stepper("G-L", 3)
    p = step.momenta(START, RATES, parameters=parameters)
    np.testing.assert_allclose(step.velocities(START, p, parameters=parameters), RATES,
                               rtol=0, atol=4 * EPS)
    options = {"dt": 0.02, "steps": 50, "parameters": parameters}
    run = step.integrate(START, p, **options)
    newton = step.integrate(START, p, solver="newton", **options)
    ensemble = step.integrate_ensemble(np.tile(START, (5, 1)), np.tile(p, (5, 1)), **options)
    for q, momenta in ((run.q[-1], run.p[-1]), (newton.q[-1], newton.p[-1]),
                       (ensemble.q[3][-1], ensemble.p[3][-1])):
        np.testing.assert_allclose([*q, *momenta], closed(e, 1.0), rtol=0, atol=2e-13)


def test_one_coordinate_whose_mass_may_change_its_sign():
    """The mass of m − c t, which a rocket loses, may have either sign: (m − c t) v = p is exact."""
    x, v, m, c, t = sp.symbols("x v m c t", real=True)
    system = gs.System.from_lagrangian((m - c * t) * v**2 / 2, [x], [v], [m, c], time=t,
                                       name="rocket")
    assert not system.is_definite
    run = gs.stepper("G-L", 3, system=system).integrate(
        [0.0], [2.0], dt=0.01, steps=50, parameters={"m": 1.0, "c": 0.4})
    # q = ∫ p/(m − c t) dt
    assert run.q[-1, 0] == pytest.approx(-2 / 0.4 * np.log(1 - 0.4 * 0.5), rel=8 * EPS)
    assert run.velocities[-1, 0] == pytest.approx(2 / (1 - 0.4 * 0.5), rel=4 * EPS)


@pytest.mark.slow  # a stepper of one system
def test_energy_is_kept_by_ems():
    step = stepper("EMS")
    p = step.momenta(START, RATES, parameters={"e": 1e-12})
    run = step.integrate(START, p, dt=0.01, steps=100, parameters={"e": 1e-12})
    assert np.abs(run.energy_error()).max() <= 8 * EPS
    assert np.abs(np.array([*run.q[-1], *run.p[-1]]) - closed(1e-12, 1.0)).max() <= 1e-5


def test_masses_of_bodies_need_no_pivots():
    x = Q[0]
    L = (2 * V[0] ** 2 + V[1] ** 2 + 2 * V[0] * V[1] * sp.cos(x)) / 2
    assert gs.System.from_lagrangian(L, Q, V, []).is_definite
    assert not coupled().is_definite


@cache
def rotating():
    """Return a stepper whose M is taken for positive definite, as it is for c > −1."""
    c = sp.Symbol("c", real=True)
    L = (V[0] ** 2 + (1 + c) * sp.sin(Q[0]) ** 2 * V[1] ** 2) / 2 - sp.cos(Q[0])
    return gs.stepper("G-L", 2, system=gs.System.from_lagrangian(L, Q, V, [c], name="polar"))


def test_a_start_where_the_mass_matrix_has_no_inverse():
    step = stepper("G-L", 3)
    with pytest.raises(InputError, match="no inverse"):
        step.integrate(START, RATES, dt=0.01, steps=1, parameters={"e": 1.0})


@pytest.mark.slow  # a stepper for this
def test_starts_where_the_mass_matrix_is_not_as_it_has_to_be():
    step = rotating()
    for _ in range(2):  # also after a call that differs by its state alone
        with pytest.raises(InputError, match="vy"):
            step.integrate([0, 0.4], [0, 0], dt=0.01, steps=1, parameters={"c": 0})
        step.integrate([0.1, 0.4], [0, 0], dt=0.01, steps=1, parameters={"c": 0})
    with pytest.raises(InputError, match="positive definite"):
        step.integrate([0.3, 0.4], RATES, dt=0.01, steps=1, parameters={"c": -3})
