"""Steps as CasADi functions: Jacobians, both modes, Hessians, and Opti."""

from __future__ import annotations

from gc import collect

import numpy as np
import pytest

import input_systems
import systems
from flows import PARAMETERS, TOP, close, flow_of, inputs_of, start_of, stepper_of
from gyrospark.core.errors import InputError

casadi = pytest.importorskip("casadi", reason="CasADi is not installed: the extra casadi brings it")

import gyrospark.interop.casadi as gc  # noqa: E402

THETA = np.array([*TOP.parameters.values(), 0.0016])
Q, P = np.array(TOP.q0), np.array(TOP.p0)


def of_theta(make, steps=12, **options):
    """Return a CasADi function of the parameters: the result of ``make(F, theta)`` for F(theta)."""
    flow = gc.run(stepper_of("top"), steps=steps, dt=1e-3, **options)
    theta = casadi.MX.sym("theta", 5)
    expression = make(casadi.vertcat(*flow(Q, P, theta)), theta)
    return casadi.Function("f", [theta], [expression])(THETA).full()


def test_values_and_derivatives_are_those_of_the_flow():
    flow, x = flow_of("top", 12)
    J = flow.jacobian(x[None])[0, :, 8:13]
    v, w = np.random.default_rng(0).normal(size=(5, 3)), np.arange(1.0, 9)
    assert np.array_equal(of_theta(lambda F, theta: F)[:, 0], flow.value(x[None])[0])
    assert close(of_theta(casadi.jacobian), J)
    assert close(of_theta(lambda F, theta: casadi.jtimes(F, theta, v)), J @ v)
    assert close(of_theta(lambda F, theta: casadi.gradient(casadi.dot(w, F), theta))[:, 0], w @ J)
    by_name = gc.step(stepper_of("top"))(Q, P, PARAMETERS, dt=1e-3)
    assert np.array_equal(casadi.vertcat(*by_name).full()[:, 0],
                          flow_of("top", 1)[0].value(x[None])[0])


def test_inputs_of_a_run():
    flow, x = flow_of("pushed", 3)
    q, p, parameters, dt, _ = start_of("pushed")
    function, u = gc.run(stepper_of("pushed"), steps=3, dt=dt), casadi.MX.sym("u", 2, 3)
    F = casadi.vertcat(*function(q, p, parameters, inputs=u.T))
    values_and_jacobian = casadi.Function("f", [u], [F, casadi.jacobian(F, u)])
    value, J = values_and_jacobian(inputs_of("pushed", 3).T)
    assert np.array_equal(value.full()[:, 0], flow.value(x[None])[0])
    assert close(J.full(), flow.jacobian(x[None])[0][:, flow.fields["inputs"]])
    row = np.array([0.3, -0.2])
    constant_inputs = casadi.vertcat(*function(q, p, parameters, inputs=row))
    by_rows, _ = values_and_jacobian(np.tile(row, (3, 1)).T)
    assert np.array_equal(casadi.evalf(constant_inputs).full(), by_rows.full())


def test_second_derivatives_are_exact_or_differences_or_refused():
    w = np.arange(1.0, 9)
    hessian = lambda F, theta: casadi.hessian(casadi.dot(w, F), theta)[0]  # noqa: E731
    with pytest.raises(RuntimeError, match="second_order"):  # CasADi's, with our sentence
        of_theta(hessian, second_order="refuse")
    flow, x = flow_of("top", 12)
    expected = flow.second(flow.adjoint, x[None], np.tile(w, (1, 5, 1)),
                           np.eye(flow.size)[None, 8:13])[0, :, 8:13]
    scale = np.outer(THETA, THETA)
    assert close(of_theta(hessian) * scale, expected * scale, 1e-14)
    assert close(of_theta(hessian, second_order="differences") * scale, expected * scale, 1e-8)


def test_a_failed_step_is_nan():
    flow = gc.step(stepper_of("top"), dt=1e-3)
    assert np.isnan(flow(Q, P, -THETA)[0].full()).all()
    assert "I1" in flow.failures[-1]
    with pytest.raises(InputError, match="q has shape"):
        flow(casadi.MX.sym("q", 3), P, THETA)


@pytest.mark.parametrize(("name", "derivative", "said"), [
    ("sleigh", casadi.jacobian, "velocity constraints"),
    ("heavy_bob", lambda F, q: casadi.hessian(casadi.sumsqr(F), q), "a Lagrangian")])
def test_a_derivative_that_a_stepper_has_not_is_refused_where_it_is_formed(name, derivative, said):
    """CasADi raises a RuntimeError with our sentence; values have no need of derivatives."""
    stepper, case = systems.stepper(name), systems.case(name)
    q0, p0 = systems.start(name, stepper)
    q = casadi.MX.sym("q", len(q0))
    F = casadi.vertcat(*gc.step(stepper, dt=case.dt)(q, p0, case.parameters))
    assert np.isfinite(casadi.Function("f", [q], [F])(q0).full()).all()
    with pytest.raises(RuntimeError, match=said):
        derivative(F, q)


@pytest.mark.parametrize("second_order", ["refuse", "exact"])
def test_opti_swings_a_pendulum(second_order):
    """The pendulum swings from below to an angle at rest; a run with the controls ends there."""
    step, count, angle = stepper_of("pushed"), 6, 0.8
    advance = gc.step(step, dt=0.2, second_order=second_order)
    opti = casadi.Opti()
    q, p, u = opti.variable(2, count + 1), opti.variable(2, count + 1), opti.variable(2, count)
    opti.subject_to(q[:, 0] == [0, -1])
    opti.subject_to(p[:, 0] == 0)
    for k in range(count):
        q1, p1 = advance(q[:, k], p[:, k], {"k": 1.3}, inputs=u[:, k])
        opti.subject_to(q[:, k + 1] == q1)
        opti.subject_to(p[:, k + 1] == p1)
    opti.subject_to(q[0, count] == np.sin(angle))  # one coordinate, one momentum: n − m
    opti.subject_to(p[0, count] == 0)
    opti.minimize(casadi.sumsqr(u))
    opti.set_initial(q, np.tile([[0.0], [-1.0]], count + 1))
    opti.set_initial(u, 0.1)
    solver_options = {"hessian_approximation": "limited-memory"} if second_order == "refuse" else {}
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"} | solver_options)
    solution = opti.solve()
    run = step.integrate([0, -1], [0, 0], dt=0.2, steps=count, parameters={"k": 1.3},
                         inputs=solution.value(u).T)
    assert np.abs(run.q.T - solution.value(q)).max() < 1e-8
    assert np.abs(run.q[-1] - [np.sin(angle), -np.cos(angle)]).max() < 1e-7
    assert solution.value(casadi.sumsqr(u)) == pytest.approx(opti.value(opti.f))


def test_one_input_is_a_column():
    """A symbolic column has one shape, whether it is a row for each step or a vector."""
    step = input_systems.stepper(input_systems.oscillator)
    flow, u = gc.run(step, steps=5, dt=0.05), casadi.MX.sym("u", 5, 1)
    F = casadi.vertcat(*flow([0.3], [0.2], {"k": 1.3}, inputs=u))
    rows = np.linspace(-1, 1, 5)[:, None]
    run = step.integrate([0.3], [0.2], dt=0.05, steps=5, parameters={"k": 1.3}, inputs=rows)
    end = casadi.Function("f", [u], [F])(rows).full()[:, 0]
    assert np.array_equal(end, [*run.q[-1], *run.p[-1]])


def test_expressions_outlive_the_function_that_made_them():
    theta, expected = casadi.MX.sym("theta", 5), of_theta(casadi.jacobian)
    F = casadi.vertcat(*gc.run(stepper_of("top"), steps=12, dt=1e-3)(Q, P, theta))
    collect()
    jacobian = casadi.Function("f", [theta], [casadi.jacobian(F, theta)])(THETA).full()
    assert np.array_equal(jacobian, expected)
