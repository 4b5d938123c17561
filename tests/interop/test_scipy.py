"""Optimisers of SciPy with the gradients and Jacobians of runs."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares, minimize

import gyrospark as gs
from flows import PARAMETERS, start_of, stepper_of


def test_minimize_finds_inputs():
    """Little effort that turns a pendulum nearly into a given state, by the adjoint."""
    step, steps = stepper_of("pushed"), 20
    q, p, parameters, dt, _ = start_of("pushed")
    goal = np.array([0.0, 1.0])

    def miss(run):
        off = run.q[-1] - goal
        return off @ off + run.p[-1] @ run.p[-1], {"q": 2 * off, "p": 2 * run.p[-1]}

    f = step.value_and_gradient(miss, q, p, wrt=["inputs"], parameters=parameters, dt=dt,
                                steps=steps, inputs=np.zeros((steps, 2)))

    def loss(x):
        value, gradient = f(x)
        return value + 1e-6 * x @ x, gradient + 2e-6 * x

    found = minimize(loss, np.full(2 * steps, 0.1), jac=True, method="L-BFGS-B",
                     options={"maxiter": 100})
    assert found.success
    assert found.nfev < 60
    run = step.integrate(q, p, dt=dt, steps=steps, parameters=parameters,
                         inputs=found.x.reshape(steps, 2))
    assert np.abs(run.q[-1] - goal).max() < 1e-2


def test_the_gradient_by_the_start_and_inputs_is_the_limit_of_differences():
    step, steps = stepper_of("pushed"), 5
    q, p, parameters, dt, _ = start_of("pushed")
    f = step.value_and_gradient(lambda run: (run.q[-1, 0], {"q": np.array([1.0, 0.0])}), q, p,
                                wrt=["start", "inputs", "k"], parameters=parameters, dt=dt,
                                steps=steps, inputs=np.ones((steps, 2)))
    x, along = np.concatenate([np.zeros(2), np.ones(2 * steps), [1.3]]), np.arange(1.0, 14) / 10
    h = 1e-4
    difference = (f(x + h * along)[0] - f(x - h * along)[0]) / (2 * h)
    assert abs(f(x)[1] @ along - difference) < 1e-7 * abs(difference)


def test_least_squares_finds_parameters():
    """Moments of inertia and the weight of a top from its attitude, by tangents."""
    step, names = stepper_of("top"), ["I1", "I2", "mgl"]
    q, p, _, dt, _ = start_of("top")
    true = np.array([PARAMETERS[name] for name in names])

    def run(s):
        return step.integrate(
            q, p, dt=dt, steps=60, every=6, parameters=PARAMETERS | dict(zip(names, s * true,
                                                                             strict=True)),
            tangents=gs.Tangents(start=None, parameters=names))

    data = run(np.ones(3)).q
    calls = []

    def residuals(s):
        calls.append(1)
        return (run(s).q - data).ravel()

    found = least_squares(residuals, [0.9, 1.1, 1.2], xtol=1e-15, ftol=1e-15, gtol=1e-15,
                          jac=lambda s: run(s).tangents.q.reshape(-1, 3) * true)
    assert np.abs(found.x - 1).max() < 1e-10
    assert len(calls) < 20
