"""A sentence names each thing without a derivative."""

from __future__ import annotations

import re
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from calls import PARAMETERS, TOP, refused

START = {"dt": 1e-3, "parameters": PARAMETERS}
#: Tangent to |q| = 1, and to qᵀp = 0 where dp is 0 and the top is at rest.
ALONG = np.array([-TOP.q0[1], TOP.q0[0], 0.0, 0.0])
ZERO = np.zeros(4)


@pytest.fixture(scope="module")
def top():
    return systems.differentiable("heavy_top")


@pytest.fixture(scope="module")
def run(top):
    return top.integrate(TOP.q0, TOP.p0, **START, steps=3000, every=100)


def jvp(step, dq=ALONG, dp=ZERO, **changes):
    return step.jvp(TOP.q0, TOP.p0, dq, dp, **START | changes)


def one_step(**request):
    return lambda s, r: s.integrate(TOP.q0, TOP.p0, **START, steps=1,
                                    tangents=gs.Tangents(**request))


def gradient(cotangents=None, **options):
    return lambda s, r: s.gradient(r, {"q": TOP.q0} if cotangents is None and "loss" not in options
                                   else cotangents, **options)


def test_a_step_backwards_that_has_no_derivative_is_named(top, run, monkeypatch):
    binding = top._derivative_binding()
    monkeypatch.setattr(binding, "begin", lambda _: SimpleNamespace(keep=lambda _: (None, 2)))
    with pytest.raises(gs.GyrosparkError, match="singular"):
        top.gradient(run, {"q": TOP.q0}, memory="none")


@pytest.mark.parametrize(("call", "words"), [
    (lambda s, r: jvp(s, d={"I4": 1.0}), "'I4'.*'I1'|'I4'.*I1"),
    (lambda s, r: jvp(s, dq=[1.0, 2.0]), "shape"),
    (lambda s, r: s.vjp(TOP.q0, TOP.p0, **START, wrt=["mgI"]), "mgI.*mgl"),
    (lambda s, r: s.gradient(r, {"q": TOP.q0})["I5"], "I5"),
    (lambda s, r: s.gradient(r), "either"),
    (lambda s, r: gs.Stepper(s.name, s.files).gradient(r, {"q": TOP.q0}), "derivatives"),
    (gradient(wrt="begin"), "begin"),
    (gradient(wrt=[]), "wrt"),
    (gradient(wrt="inputs"), "'inputs'"),
    (gradient(memory="1 kB"), r"1,000.*need [\d,]+"),
    (gradient(memory="much"), "much"),
    (gradient(memory=-3), "-3"),
    (gradient({"x": TOP.q0}), "'x'"),
    (gradient({"q": [1.0, 2.0, 3.0]}), r"\(3,\)"),
    (gradient({"multipliers": np.ones(5)}), r"\(5,\).*\(30, 3\)"),
    (gradient({"multipliers": np.full((30, 3), np.nan)}), "finite"),
    (gradient({"multiplier": np.ones(4)}), "multipliers"),
    (gradient({"events": {"x": {"t": 1.0}}}), "'x'.*no events"),
    (gradient({"parameters": {"I3": np.nan}}), "I3.*nan"),
    (gradient({"parameters": {"I5": 1.0}}), "'I5'.*I1"),
    (lambda s, r: one_step()(s, r).tangents["I5"], "'I5'.*start"),
    (lambda s, r: s.hessian(r, {"multipliers": np.ones(3)}), "multipliers"),
    (gradient({"parameters": {"I3": "a"}}), "I3.*'a'"),
    (gradient(loss=3.0), "function"),
    (gradient(loss=lambda r: 3.0), "3.0"),
    (gradient(loss=lambda r: None), "None"),
    (gradient(loss=lambda r: ("x", {"q": r.q})), "'x'"),
    (gradient(loss=lambda r: (1.0, [1, 2])), r"\[1, 2\]"),
    (gradient(loss=sp.Symbol("lambda_0")), "every = 1"),
    (gradient(loss=sp.Symbol("lambda_3")), "lambda_0"),
    (gradient(loss=1 / sp.Symbol("q2")), "finite"),
    (one_step(parameters=["mass"]), "mass"),
    (lambda s, r: s.integrate(TOP.q0, TOP.p0, **START, steps=1, tangents=True), "True"),
    (one_step(start="some"), "some"),
    (one_step(start=None), "No direction"),
    (one_step(start=np.ones(7)), r"\(7, 1\)"),
])
def test_what_has_no_derivative_is_named(top, run, call, words):
    with refused(words):
        call(top, run)


def test_directions_that_leave_the_constraints(top):
    """The message names the constraint; the direction may be projected."""
    (name,) = map(re.escape, top.constraint_names)
    with refused(f"'{name}'"):
        jvp(top, dq=TOP.q0)
    with refused(f"'{name}'"):
        top.integrate(TOP.q0, TOP.p0, **START, steps=1,
                      tangents=gs.Tangents(start=np.concatenate([TOP.q0, ZERO])))
    *_, dq, _ = top.jvp(TOP.q0, TOP.p0, TOP.q0, ZERO, **START, project=True)
    assert np.abs(dq).max() < 1e-14


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_none(top, run, bad):
    with refused(str(bad)[:3]):
        jvp(top, dq=[bad, 0, 0, 0])
    with refused(str(bad)[:3]):
        jvp(top, d={"I3": bad})
    with refused("finite"):
        top.gradient(run, {"q": [bad, 0, 0, 0]})
    _, _, back = top.vjp(TOP.q0, TOP.p0, **START)
    with refused(str(bad)[:3]):
        back([bad, 0, 0, 0], ZERO)


def test_memory_that_is_asked_for_suffices(top, run):
    """The number of bytes in the message is enough."""
    with pytest.raises(gs.InputError) as error:
        top.gradient(run, {"q": TOP.q0}, memory="1 kB")
    needed = int(str(error.value).split("need ")[1].split(".")[0].replace(",", ""))
    assert np.isfinite(top.gradient(run, {"q": TOP.q0}, memory=f"{needed} B").vector()).all()


def test_steps_whose_equations_do_not_hold(top):
    loose = {"solver": gs.Solver(tolerance=1e-6)}
    with refused("tolerance = 1e-06"):
        top.integrate(TOP.q0, TOP.p0, **START, steps=2, **loose, tangents=gs.Tangents())


def test_steps_that_fail(top):
    """A failed step raises StepFailed: there is no derivative of a part of a run."""
    with pytest.raises(gs.StepFailed):
        top.integrate(TOP.q0, TOP.p0, **START, steps=20,
                      solver=gs.Solver("auto", max_iterations=2), tangents=gs.Tangents())
    for call in (top.vjp, lambda *z, **options: top.jvp(*z, ALONG, ZERO, **options)):
        with pytest.raises(gs.StepFailed):
            call(TOP.q0, TOP.p0, dt=5.0, parameters=PARAMETERS)


def test_runs_of_other_systems(run):
    free = systems.differentiable("pushed_pendulum")
    with refused(run.manifest.name):
        free.gradient(run, {"q": [1.0, 0.0]})


def test_multipliers_of_systems_without_constraints():
    step = systems.differentiable("driven_oscillator")
    arguments = {"dt": 0.1, "steps": 2, "parameters": systems.case("driven_oscillator").parameters}
    with refused("multipliers.*constraints"):
        step.integrate([1.0], [0.0], **arguments).gradient({"multipliers": [1.0]})
    with refused("multipliers.*constraints"):
        step.integrate([1.0], [0.0], **arguments, tangents=gs.Tangents(multipliers=True))


def test_inputs_of_each_step_are_no_direction():
    """A parameter has no effect where rows of inputs have its name."""
    step = systems.differentiable("pushed_pendulum")
    rows = np.ones((3, 2))
    run = {"dt": 0.01, "steps": 3, "parameters": {"k": 9.81, "push": 1.0, "pull": 1.0}}
    start = [0.6, -0.8], [0.4, 0.3]
    with refused("'push'"):
        step.integrate(*start, inputs=rows, **run, tangents=gs.Tangents(parameters=["push"]))
    constant = step.integrate(*start, **run, tangents=gs.Tangents(parameters=["push"]))
    fed = step.integrate(*start, inputs=rows, **run).gradient({"q": [1.0, 0.0]})
    assert fed["push"] == 0
    assert abs(fed.inputs[:, 0].sum() - constant.tangents["push"][-1, 0]) < 1e-16


def test_round_off_of_a_direction_along_momenta_is_no_departure():
    """A dq of 3e-19, which a projection leaves at rest, is accepted; 1e-3 is refused."""
    step, case = systems.differentiable("pendulum"), systems.case("pendulum")
    q, p = systems.start("pendulum", step)
    along = np.array([q[1], -q[0]])
    for departure in (3e-19, 1e-3):
        tangents = gs.Tangents(start=np.concatenate([departure * q, along]))
        run = partial(step.integrate, q, p, dt=case.dt, steps=1, parameters=case.parameters,
                      tangents=tangents)
        if departure < 1e-18:
            run()
        else:
            with pytest.raises(gs.InputError, match="constraint"):
                run()
