"""Stiff systems: a step that has a root is done, and iterations stop where rounding stops them.

A spring k rounds its force by ε k L, which times Δt may be large beside a small momentum. The
spring pendulum starts at rest where its spring carries its weight, one radian from down.
"""

from __future__ import annotations

import functools

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from calls import identify
from python_newton import one_step
from reference import Equations, Method
from systems import SCHEMES

EPSILON = np.finfo(float).eps
LENGTH, GRAVITY = 10.0, 9.81
every_scheme = pytest.mark.parametrize("scheme", [
    ("EMS", None), *(pytest.param(scheme, marks=pytest.mark.slow) for scheme in (
        ("IMS", None), ("G-L", 2), ("G-L", 4), ("LIIIA-B", 2)))], ids=identify)
STIFFNESSES = (1e4, 1e6, 1e7, 1e8, 1e9)
ANGLES = (0.03, 0.1, 0.3, 1.0, 3.0)  # of the spring's oscillation a step
STEPS = 60


@functools.cache
def spring_pendulum() -> gs.System:
    q, p = sp.symbols("x y", real=True), sp.symbols("px py", real=True)
    k, g, l = sp.symbols("k g l", positive=True)  # noqa: E741
    stretch = sp.sqrt(q[0]**2 + q[1]**2) - l
    return gs.System(q, p, (k, g, l), (p[0]**2 + p[1]**2) / 2 + g * q[1] + k * stretch**2 / 2,
                     name="spring_pendulum")


def by_hand(parameters: dict[str, float]):
    """Return the system typed by hand, for the reference."""

    def equations(number) -> Equations:
        k, g, l = (number(parameters[name]) for name in "kgl")  # noqa: E741
        root = mp.sqrt if number is mp.mpf else np.sqrt

        def pull(q, r, stretch):
            return k * stretch / r * q + np.array([0 * g, g])

        def H_q(q, p):
            r = root(q @ q)
            return pull(q, r, r - l)

        def mean_gradient(q0, p0, q1, p1):
            r0, r1 = root(q0 @ q0), root(q1 @ q1)
            return pull((q0 + q1) / 2, (r0 + r1) / 2, (r0 + r1) / 2 - l), (p0 + p1) / 2

        return Equations(
            lambda q, p: p @ p / 2 + g * q[1] + k * (root(q @ q) - l)**2 / 2, H_q,
            lambda q, p: p, g=lambda q: np.array([]), G=lambda q: np.zeros((0, 2)),
            mean_gradient=mean_gradient, mean_constraint=lambda q0, q1: np.zeros((0, 2)))

    return equations


def stepper(scheme: tuple[str, int | None]) -> gs.Stepper:
    return gs.stepper(*scheme, system=spring_pendulum())


def start(k: float) -> tuple[np.ndarray, np.ndarray]:
    length = LENGTH + GRAVITY * np.cos(1) / k
    return length * np.array([np.sin(1), -np.cos(1)]), np.zeros(2)


def run_of(k: float, angle: float) -> dict:
    return {"dt": angle / np.sqrt(k), "steps": STEPS,
            "parameters": {"k": k, "g": GRAVITY, "l": LENGTH}}


@every_scheme
@pytest.mark.parametrize("solver", ["auto", "newton", "fixed-point"])
def test_steps_that_have_a_root_are_done(scheme, solver):
    """Sweeps contract up to angles of 0.3 with every scheme, Newton goes on."""
    step = stepper(scheme)
    for k in STIFFNESSES:
        for angle in ANGLES[: 3 if solver == "fixed-point" else None]:
            trajectory = step.integrate(*start(k), solver=solver, **run_of(k, angle))
            assert len(trajectory) == STEPS + 1
            if scheme[0] == "EMS":
                assert trajectory.report.energy_error_max <= 16 * EPSILON * GRAVITY * LENGTH


@every_scheme
@pytest.mark.parametrize("k", [1e4, 1e7])
def test_a_step_is_the_root_that_fifty_digits_find(scheme, k):
    """Each solver has the root up to the rounding of the force."""
    step = stepper(scheme)
    for angle in (0.1, 3.0):
        run = run_of(k, angle) | {"steps": 7}
        state = step.integrate(*start(k), **run)
        q, p, dt = state.q[-1], state.p[-1], run["dt"]
        exact = Method(by_hand(run["parameters"]), *scheme, q, p, dt).step()
        for solver in ("auto", "newton", "python"):
            q1, p1 = one_step(step, q, p, dt=dt, parameters=run["parameters"], solver=solver)
            rounding = dt * k * LENGTH * EPSILON
            assert np.abs(q1 - exact.q).max() <= 4 * EPSILON * LENGTH + 8 * dt * rounding
            assert np.abs(p1 - exact.p).max() <= 8 * rounding + 8 * EPSILON * np.abs(p).max()


def test_a_fast_mode_at_rest_is_no_loss():
    """The spring, at a hundred rad a step, is not excited, and its own step is not required."""
    run = stepper(("EMS", None)).integrate(*start(1e8), **run_of(1e8, 100.0) | {"steps": 5})
    assert run.report.newton_steps


@every_scheme
def test_ensembles_do_them_too(scheme):
    step = stepper(scheme)
    k = np.array(STIFFNESSES)
    q, p = zip(*map(start, STIFFNESSES), strict=True)
    ensemble = step.integrate_ensemble(
        np.array(q), np.array(p), dt=0.3 / np.sqrt(k), steps=STEPS,
        parameters={"k": k, "g": GRAVITY, "l": LENGTH})
    assert not ensemble.failures


@pytest.mark.parametrize("solver", ["auto", "newton"])
@pytest.mark.parametrize("scheme", SCHEMES, ids=identify)
def test_what_is_at_rest_stays_there(scheme, solver):
    """At rest a first increment has no size to be small beside."""
    free = gs.stepper(*scheme)
    inertia = (0.002, 0.0015, 0.0008)
    parameters = dict(zip(("I1", "I2", "I3"), inertia, strict=True)) | {
        "mgl": 0.0, "gamma": gs.gamma(inertia)}
    for q in ([1.0, 0, 0, 0], [np.cos(0.3), np.sin(0.3), 0, 0], [0.1, 0.3, 0.3, 0.9]):
        trajectory = free.integrate(q, np.zeros(4), dt=1e-3, steps=50, parameters=parameters,
                                    solver=solver)
        assert np.abs(trajectory.q - q).max() <= 2 * EPSILON


@pytest.mark.filterwarnings("ignore:The fastest rotation")
@pytest.mark.parametrize("scheme", SCHEMES, ids=identify)
def test_what_has_no_root_is_no_step(scheme):
    """With huge steps iterations go astray; rounding explains no error there, and g = 0 shows
    it."""
    top = gs.problems.fast_top()
    step = gs.stepper(*scheme)
    parameters = top.parameters | {"gamma": gs.gamma(top.inertia)}
    for dt in np.geomspace(0.03, 1.0, 12):
        for solver in ("auto", "newton"):
            try:
                trajectory = step.integrate(top.q0, top.p0, dt=dt, steps=20, parameters=parameters,
                                            solver=solver)
            except gs.StepFailed as failure:
                trajectory = failure.trajectory
            assert trajectory.g_errors.max() <= 1e-14
            if scheme[0] == "EMS":
                assert np.abs(trajectory.energies - trajectory.energies[0]).max() <= 1e-12
