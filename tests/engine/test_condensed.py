"""Newton's method of element templates against dense Newton steps with the full Jacobian."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

import budget
import gyrospark as gs
import systems
from strategies import EPS
from structured_systems import BEADS, made_beads, start_of_beads


def dense_newton(step, start, dt, parameters):
    """Return the unknowns of a step, and the iterations until the increment is round-off."""
    q, p, t = start
    arguments = {"dt": dt, "parameters": parameters} | ({"t": t} if step.binding.is_timed else {})
    x = step.guess(q, p, **arguments)
    for count in range(1, 30):
        r, J = (f(x, q, p, **arguments) for f in (step.residual, step.jacobian))
        scale = np.abs(J).max(axis=1)
        increment = np.linalg.solve(J / scale[:, None], r / scale)
        x = x - increment
        size = np.abs(increment[: 2 * len(q)]).max() / np.abs(x[: 2 * len(q)]).max()
        if size < 1e4 * EPS:
            return x, count
    raise AssertionError("dense Newton did not converge")


@pytest.mark.parametrize(("name", "scheme", "stages"), [
    ("double_top", "G-L", 2), ("beads", "G-L", 2), ("two_rods", "EMS", None),
    ("beads", "EMS", None),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in (  # a stepper each
        ("double_top", "EMS", None), ("double_top", "LIIIA-B", 3), ("andrews", "EMS", None)))])
def test_condensed_steps_are_those_of_the_whole_jacobian(name, scheme, stages):
    """They take as many iterations as dense Newton: a wrong entry makes them linear."""
    if name == "beads":
        step = made_beads(scheme, stages, True)
        start, parameters, dt = gs.Start(*start_of_beads(step, 0.4), t=0.4), BEADS, 0.02
    else:
        step, case = systems.stepper(name, scheme, stages), systems.case(name)
        start, parameters, dt = systems.timed_start(name, step), case.parameters, 4 * case.dt
    run = step.integrate(start, dt=dt, steps=3, parameters=parameters, solver="newton")
    q, p = run.q[-2], run.p[-2]
    x, count = dense_newton(step, (q, p, run.t[-2]), dt, parameters)
    n = len(q)
    expected = x[:n]  # EMS
    if stages:
        b = np.array([float(w) for w in gs.tableau(scheme, stages).numeric(20).b])
        expected = q + dt * b @ x[: stages * n].reshape(stages, n)
    np.testing.assert_allclose(run.q[-1], expected, rtol=0, atol=1e4 * EPS)
    assert run.iterations[-1] <= count + 1


PUSH = sp.Symbol("push", real=True)
KINETIC = {
    "rank one": lambda a, b: (a + b) ** 2 / 2,  # the pattern does not show it
    "zero row": lambda a, b: a**2 / 2 + b}


def springs(*kinetic):
    """Return points between springs, with these energies of momenta two by two; one is pushed."""
    q, p = sp.symbols("x1:9", real=True), sp.symbols("y1:9", real=True)
    pairs = zip(p[::2], p[1::2], strict=True)
    H = sum(f(*pair) for f, pair in zip(kinetic, pairs, strict=False)) + sum(
        y**2 for y in p[2 * len(kinetic):]) / 2 + sum(
        (a - b) ** 2 for a, b in pairwise(q)) + sum(a**4 for a in q)
    return gs.System(q, p, (), H=H, forces=(PUSH, *[0] * 7), inputs=(PUSH,),
                     name="springs_of_two_masses")


START = np.linspace(0.1, 0.8, 8), np.linspace(0.3, -0.4, 8)


@pytest.mark.parametrize("kinetic", [("rank one", "zero row"), *(
    pytest.param((name,), marks=pytest.mark.slow) for name in KINETIC)])  # each by itself
def test_a_singular_mass_is_solved_with_the_whole_jacobian(kinetic):
    with budget.shared():
        step = gs.stepper("G-L", stages=2, system=springs(*map(KINETIC.get, kinetic)))
    ends = [step.integrate(*START, dt=0.05, steps=4, parameters={"push": 0}, solver=solver)
            for solver in ("newton", "fixed-point")]
    np.testing.assert_allclose(ends[0].q[-1], ends[1].q[-1], rtol=0, atol=100 * EPS)
    np.testing.assert_allclose(ends[0].p[-1], ends[1].p[-1], rtol=0, atol=100 * EPS)


def test_forms_without_constraints_have_inputs():
    """Each push lasts for 80 steps; the reference is DOP853."""
    system, pushes = springs(*KINETIC.values()), [0.5, -1.0, 0.25]
    slope = sp.lambdify([system.q, system.p, PUSH], [
        *(sp.diff(system.H, p) for p in system.p),
        *(force - sp.diff(system.H, q) for q, force in zip(system.q, system.forces, strict=True))])
    y = np.concatenate(START)
    for force in pushes:
        y = solve_ivp(lambda t, y, force=force: slope(y[:8], y[8:], force), (0, 0.4), y,
                      method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    with budget.shared():
        step = gs.stepper("G-L", stages=2, system=system)
    run = {"dt": 0.005, "steps": 240, "inputs": gs.Inputs(pushes, hold=80)}
    single = step.integrate(*START, **run)
    assert np.abs([*single.q[-1], *single.p[-1]] - y).max() <= 1e-9  # of order 4
    ensemble = step.integrate_ensemble([START[0]] * 2, [START[1]] * 2, **run)
    assert np.abs(ensemble.q[1] - single.q).max() <= 256 * EPS
