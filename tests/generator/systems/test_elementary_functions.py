"""Systems with sin, exp, log, roots and arcs: energy of EMS at round-off, orders, verification."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.generator.multibody.rigid_body import free_body
from gyrospark.generator.pipeline import generate
from gyrospark.generator.schemes.midpoint_conditions import check_mean_scheme
from gyrospark.generator.schemes.step_equations import MeanScheme
from gyrospark.generator.spec import Spec
from strategies import EPS

x, y, u, v = sp.symbols("x y u v", real=True)
a, b = sp.symbols("a b", positive=True)
KINETIC = (u**2 + v**2) / 2


def plane(V, name, parameters=()):
    """A particle in the plane."""
    return gs.System((x, y), (u, v), parameters, KINETIC + V, name=name)


def body():
    """An asymmetric body, its axis drawn by a spring that is no polynomial of its height."""
    free = free_body("gamma")
    q0, q1, q2, q3 = free.q
    height = q0**2 - q1**2 - q2**2 + q3**2
    V = a * sp.exp(b * height) + sp.sqrt(2 + height)
    return replace(free, H=free.H + V, parameters=(*free.parameters, a, b), name="bent")


#: System, parameters, q, p, Δt, and the size of what H adds up.
EXAMPLES = {
    # an angle's cosine, Morse's exponential, a galaxy's logarithm and Toda's lattice
    "bonds": (plane(a * (1 - sp.cos(x)) + a * (1 - sp.exp(-b * y)) ** 2 + sp.exp(x - y)
                    + sp.log(a + x**2 + y**2 / b) / 2, "bonds", (a, b)),
              {"a": 1.1, "b": 0.8}, [1.2, 0.5], [0.4, 0.7], 0.04, 8),
    "arcs": (plane(4 * (x**2 + y**2) + sp.atan(x * y) + sp.asin(x / 9) + sp.atan2(y, x + 7)
                   + sp.tanh(x) + a ** (x + y) + (1 + x**2) ** b, "arcs", (a, b)),
             {"a": 1.4, "b": 0.3}, [0.7, 0.2], [0.1, 0.6], 0.03, 8),
    # round and round: across the cut of atan2 in every turn
    "threefold": (plane((x**2 + y**2) / 2 + a * sp.cos(3 * sp.atan2(y, x) + b) / 9, "threefold",
                        (a, b)), {"a": 0.4, "b": 0.3}, [1.0, 0.0], [0.0, 1.2], 0.03, 3),
    "body": (body(), {"I1": 1.0, "I2": 1.7, "I3": 2.2, "gamma": 1.6, "a": 0.4, "b": 0.9},
             [0.9, 0.3, -0.2, 0.1], [0.4, -1.0, 0.8, 1.2], 0.02, 10),
}
named = pytest.mark.parametrize("name", EXAMPLES)


@cache
def stepper_for(name, scheme, stages=None, real="double"):
    return gs.stepper(scheme, stages, system=EXAMPLES[name][0], real=real)


def start(name, step):
    _, parameters, q, p, dt, _ = EXAMPLES[name]
    if step.m:
        q, p = step.project(q, p, parameters=parameters)
    return {"q": np.array(q), "p": np.array(p), "dt": dt, "parameters": parameters}


@named
def test_EMS_keeps_the_energy_to_round_off_over_many_steps(name):
    step, steps = stepper_for(name, "EMS"), 10_000
    run = start(name, step)
    found = step.integrate(run.pop("q"), run.pop("p"), steps=steps, every=steps, **run)
    # A few roundings of the terms of H in a step, and they add up like a random walk.
    assert found.report.energy_error_max <= 4 * EPS * np.sqrt(steps) * EXAMPLES[name][5]
    assert found.report.newton_steps == 0


@pytest.mark.parametrize("name", ["arcs", "body"])
@pytest.mark.parametrize("solver", ["newton", "fixed-point", "python"])
def test_solvers_agree(name, solver):
    step = stepper_for(name, "EMS")
    run = start(name, step)
    q, p = run.pop("q"), run.pop("p")
    one, other = (step.integrate(q, p, steps=20, solver=s, **run) for s in ("auto", solver))
    bound = 2000 * EPS * (1 + np.abs(one.p).max())  # 20 steps of 64 eps
    assert np.abs(one.q - other.q).max() <= bound
    assert np.abs(one.p - other.p).max() <= bound + 256 * EPS / run["dt"] * bool(step.m)


def order_seen(name, step, exact, counts, span):
    run = start(name, step) | {"dt": None}
    q, p = run.pop("q"), run.pop("p")
    errors = []
    for n in counts:
        end = step.integrate(q, p, steps=n, every=n, **run | {"dt": span / n})
        errors.append(np.abs(end.q[-1] - exact).max())
    return np.polyfit(np.log(1 / np.array(counts)), np.log(errors), 1)[0]


@pytest.mark.parametrize(("scheme", "stages", "counts"), [
    ("EMS", None, [64, 128, 256]), ("G-L", 2, [16, 32, 64]),
    # the same derivatives at other nodes
    pytest.param("G-L", 1, [64, 128, 256], marks=pytest.mark.slow),
    pytest.param("G-L", 3, [6, 9, 13], marks=pytest.mark.slow)])
def test_orders_with_every_elementary_function(scheme, stages, counts):
    step, fine = stepper_for("arcs", scheme, stages), stepper_for("arcs", "G-L", 2)
    run = start("arcs", fine)
    exact = fine.integrate(run["q"], run["p"], dt=1 / 2048, steps=2048,
                           parameters=run["parameters"]).q[-1]
    assert step.order == 2 * (stages or 1)
    assert abs(order_seen("arcs", step, exact, counts, 1.0) - step.order) < 0.25


@pytest.mark.parametrize(("real", "scheme", "stages"), [
    ("float", "EMS", None), pytest.param("long-double", "G-L", 2, marks=pytest.mark.slow)])
@pytest.mark.slow  # 1 CPU s; other cases run all its branches
def test_other_types(real, scheme, stages):
    """Every elementary function in the arcs, on lanes of floats and one by one."""
    step = stepper_for("arcs", scheme, stages, real)
    run = start("arcs", step)
    q, p = run.pop("q"), run.pop("p")
    found = step.integrate(q, p, steps=200, **run)
    reference = stepper_for("arcs", scheme, stages).integrate(q, p, steps=200, **run)
    eps = float(np.finfo(found.q.dtype).eps)
    bound = 200 * 64 * max(eps, EPS)
    assert np.abs(found.q - reference.q).max() <= bound


def test_jacobian_is_that_of_the_residual():
    """Against central differences; all cardinal functions have their derivatives in it."""
    step = stepper_for("arcs", "EMS")
    run = start("arcs", step)
    q, p = run.pop("q"), run.pop("p")
    at = step.guess(q, p, **run) * 1.1
    J, h = step.jacobian(at, q, p, **run), 1e-6
    for i, e in enumerate(np.eye(step.unknowns)):
        column = (step.residual(at + h * e, q, p, **run)
                  - step.residual(at - h * e, q, p, **run)) / (2 * h)
        assert np.abs(J[:, i] - column).max() <= 1e-7 * np.abs(J).max()


@named
def test_conditions_hold_and_say_how_they_were_found(name):
    scheme = generate(Spec.checked("EMS"), system=EXAMPLES[name][0]).scheme
    assert isinstance(scheme, MeanScheme)
    lines = {line.name: line for line in check_mean_scheme(scheme)}
    assert all(line.holds for line in lines.values())
    assert lines["energy"].found.startswith("seen at 8 random points to 30 digits")
    assert lines["constraint work"].found == "proved"


def test_a_wrong_gradient_is_refuted():
    class Wrong(MeanScheme):
        @property
        def mean_gradient(self):
            D_q, D_p = super().mean_gradient
            return [D_q[0] * sp.Rational(10**12 + 1, 10**12)], D_p

    angle = gs.System((x,), (u,), (a,), u**2 / 2 - a * sp.cos(x), name="angle")
    scheme = Wrong(angle, discrete=True)
    lines = {line.name: line for line in check_mean_scheme(scheme)}
    assert lines["consistent"].found == lines["energy"].found == "refuted"
    assert lines["symmetric"].holds
    assert not lines["order"].holds
    assert scheme.order == 0


def test_a_state_outside_the_domain_of_H_fails_as_not_finite():
    system = gs.System((x,), (u,), (), u**2 / 2 + x * sp.log(x), name="domain")
    step = gs.stepper("EMS", system=system)
    with pytest.raises(gs.StepFailed, match="not finite"):
        step.integrate([0.3], [-3.0], dt=0.5, steps=50, parameters={})


def test_logarithm_of_a_parameter_is_computed_once_a_run():
    system = gs.System((x,), (u,), (a,), u**2 / 2 + a**x + a ** (-2 * x), name="once")
    source = generate(Spec.checked("EMS"), system=system).source.source
    assert source.count("log(") == 1
    assert "pow(c->" not in source
