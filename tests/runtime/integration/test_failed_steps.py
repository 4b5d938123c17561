"""``StepFailed``: the reason, the last increment, and a step that would converge."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

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


def test_stagnation_is_reported():
    """A force with a jump: increments neither shrink nor grow, and no rounding explains them."""
    import sympy as sp

    x, p, t = sp.Symbol("x", real=True), sp.Symbol("p", real=True), sp.Symbol("t", real=True)
    jump = sp.tanh(10**9 * p)  # friction, as steep as a jump for these steps
    system = gs.System((x,), (p,), (), p**2 / 2 + x, forces=[-jump], time=t, name="stuck")
    with pytest.raises(gs.StepFailed) as caught:
        gs.stepper("IMS", system=system).integrate([0.0], [1e-5], dt=1e-3, steps=50, parameters={},
                                                   solver="newton")
    assert caught.value.reason in ("stagnated", "diverged")
    assert caught.value.increment > 0


def test_it_survives_the_way_to_another_process(gl3):
    failure = failed(gl3, dt=0.01, solver=FEW)
    again = pickle.loads(pickle.dumps(failure))
    for name in ("step", "t", "reason", "increment", "dt", "detail", "cure"):
        assert getattr(again, name) == getattr(failure, name)
    assert str(again) == str(failure)


def test_ensembles_tell_the_reason_without_looking_for_a_cure(gl3):
    made = gl3.integrate_ensemble(np.array([TOP.q0] * 2), np.array([TOP.p0] * 2),
                                  dt=np.array([1e-3, 0.08]), steps=3, parameters=PARAMETERS,
                                  solver="fixed-point")
    assert list(made.failures) == [1]
    assert made.failures[1].reason == "diverged"
    assert made.failures[1].dt is None


def test_newton_that_leaves_the_range_of_numbers_has_diverged():
    """The state is finite, and so are its forces: "not finite" would be said of these."""
    import sympy as sp

    q, u, c = sp.symbols("q u c", real=True)
    system = gs.System((q,), (u,), (c,), u**2 / 2 + q**2 / 2, forces=[-sp.sinh(c * u)],
                       name="sinh_damper")
    with pytest.raises(gs.StepFailed) as caught:
        gs.stepper("G-L", 2, system=system).integrate([0.0], [3.0], dt=1.0, steps=1,
                                                      parameters={"c": 50.0})
    assert caught.value.reason == "diverged"


def test_a_parameter_beyond_the_range_is_named(gl3):
    with pytest.raises(gs.StepFailed, match=r"mgl = 1e\+300.*range") as caught:
        gl3.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=1, parameters=PARAMETERS | {"mgl": 1e300})
    assert caught.value.reason == "not finite"
