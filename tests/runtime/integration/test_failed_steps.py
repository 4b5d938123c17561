"""``StepFailed``: the reason, the last increment, and a step that would converge."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from calls import PARAMETERS, TOP

pytestmark = pytest.mark.filterwarnings("ignore:The fastest rotation")

FEW = gs.Solver("auto", max_iterations=2)
FAILURES = {
    "diverged": {"dt": 0.08, "solver": "fixed-point"},
    "not converged": {"dt": 0.01, "solver": FEW},
    "a root that Newton cannot reach": {"dt": 0.2},
}


def failed(step, **run) -> gs.StepFailed:
    with pytest.raises(gs.StepFailed) as caught:
        step.integrate(TOP.q0, TOP.p0, steps=20, parameters=PARAMETERS, **run)
    return caught.value


@pytest.mark.parametrize("run", FAILURES.values(), ids=FAILURES)
def test_the_step_that_it_proposes_does(run, gl3):
    failure = failed(gl3, **run)
    assert 0 < failure.dt < run["dt"]
    assert f"dt = {failure.dt:.9g} does" in str(failure)
    state = failure.trajectory
    made = gl3.integrate(state.q[-1], state.p[-1], steps=1, parameters=PARAMETERS,
                         **run | {"dt": failure.dt})
    assert len(made) == 2


def test_too_few_iterations_are_distinguished_from_divergence(gl3):
    few = failed(gl3, dt=0.01, solver=FEW)
    assert few.reason == "not converged"
    assert "2 iterations" in str(few)
    assert "max_iterations" in str(few)
    assert 1e-3 < few.increment < 1
    assert f"{few.increment:.1e}" in str(few)
    assert failed(gl3, dt=0.08, solver="fixed-point").reason == "diverged"


@cache
def damped():
    """Return a body under a spring and its weight, with friction and a damper."""
    x, p, k, g, c, a, b = sp.symbols("x p k g c a b", real=True)
    return gs.stepper("IMS", system=gs.System(
        (x,), (p,), (k, g, c, a, b), p**2 / 2 + k * x**2 / 2 + g * x,
        forces=[-c * sp.tanh(a * p) - sp.sinh(b * p)], name="damped"))


def test_stagnation_is_reported():
    """A force with a jump: increments neither shrink nor grow, and no rounding explains them."""
    with pytest.raises(gs.StepFailed) as caught:  # friction, as steep as a jump for these steps
        damped().integrate([0.0], [1e-5], dt=1e-3, steps=50, solver="newton",
                           parameters={"k": 0, "g": 1, "c": 1, "a": 1e9, "b": 0})
    assert caught.value.reason in ("stagnated", "diverged")
    assert caught.value.increment > 0


def test_ensembles_tell_the_reason_without_looking_for_a_cure(gl3):
    made = gl3.integrate_ensemble(np.array([TOP.q0] * 2), np.array([TOP.p0] * 2),
                                  dt=np.array([1e-3, 0.08]), steps=3, parameters=PARAMETERS,
                                  solver="fixed-point")
    assert list(made.failures) == [1]
    assert made.failures[1].reason == "diverged"
    assert made.failures[1].dt is None


def test_newton_that_leaves_the_range_of_numbers_has_diverged():
    """The state is finite, and so are its forces: "not finite" would be said of these."""
    with pytest.raises(gs.StepFailed) as caught:
        damped().integrate([0.0], [3.0], dt=1.0, steps=1,
                           parameters={"k": 1, "g": 0, "c": 0, "a": 0, "b": 50})
    assert caught.value.reason == "diverged"


def test_a_parameter_beyond_the_range_is_named(gl3):
    with pytest.raises(gs.StepFailed, match=r"mgl = 1e\+300.*range") as caught:
        gl3.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=1, parameters=PARAMETERS | {"mgl": 1e300})
    assert caught.value.reason == "not finite"
