"""Inputs: numbers in forces that change between steps and are constant within a step.

The second way is a run of one call a step, with the input as a parameter of that step.
"""

from __future__ import annotations

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.core.errors import InputError
from input_systems import push, u, v, x, y
from strategies import EPS
from systems import case, stepper, timed_start

START = [0.6, -0.8], [0.8, 0.6]


def test_names_and_numbers_of_inputs_of_simulations_and_between_steps(tmp_path):
    step = stepper("pushed_pendulum")
    sim = step.start(*START, dt=0.02, parameters={"k": 2.0, "push": 0, "pull": 0})
    with pytest.raises(InputError, match=r"'pus'.*push, pull"):
        sim.advance(1, pus=2)
    with pytest.raises(InputError, match="Input push"):
        sim.advance(1, push="left")
    step = stepper("pushed_pendulum")
    options = {"dt": 0.02, "steps": 30, "parameters": {"k": 2.0}}
    run = step.integrate(*START, inputs=[0.3, -1], **options)
    constant = step.integrate(
        *START, **options | {"parameters": {"k": 2.0, "push": 0.3, "pull": -1}})
    assert np.array_equal(run.at([0.33]).q, constant.at([0.33]).q)
    varied = step.integrate(*START, inputs={"push": np.arange(30), "pull": 1}, **options)
    state, loaded = varied.at([0.33]), gs.load(varied.save(tmp_path / "run.npz"))
    for forgotten in (state, loaded):
        with pytest.raises(InputError, match=r"'push'.*changes"):
            forgotten.at([0.33], stepper=step)


@pytest.mark.parametrize(("name", "scheme", "every"), [
    ("pushed_pendulum", "G-L", 1), ("driven_pendulum", "EMS", 7)])
def test_a_state_between_steps_is_a_step_with_its_own_inputs(name, scheme, every) -> None:
    """A state between steps is a run over a part of a step with its inputs as parameters."""
    step = stepper(name, scheme)
    inputs, dt, hold = step.binding.input_names, 0.02, 3
    fixed = {key: x for key, x in case(name).parameters.items() if key not in inputs}
    rows = np.random.default_rng(8).integers(-8, 8, (11, len(inputs))) / 8
    begin = timed_start(name, step)
    options = {"dt": dt, "steps": 31, "parameters": fixed, "inputs": gs.Inputs(rows, hold=hold)}
    full_run = step.integrate(begin, **options)
    shares = np.array([0.25, 3.5, 8.75, 14.125, 30.5, 2, 9.5])
    times = begin.t + shares * dt
    states = step.integrate(begin, **options, every=every).at(times)
    if every == 1:
        again = step.integrate(begin, **options, t_eval=times)
        assert np.array_equal(states.q, again.q)
    for share, q1, p1 in zip(shares, states.q, states.p, strict=True):
        k = int(share)
        step_inputs = dict(zip(inputs, rows[k // hold], strict=True))
        partial_run = step.integrate(gs.Start(full_run.q[k], full_run.p[k], t=full_run.t[k]),
                                     dt=(share - k) * dt or dt, steps=int(share > k),
                                     parameters=fixed | step_inputs)
        assert np.abs(q1 - partial_run.q[-1]).max() <= 64 * EPS
        # by EMS, rounding g costs 4/Δt times ε in p
        assert np.abs(p1 - partial_run.p[-1]).max() <= (64 + 4 / dt * (scheme == "EMS")) * EPS


def test_events_of_runs_whose_inputs_change() -> None:
    """A step with its own inputs leads to x = 1/4 at the time of an event, also in ensembles."""
    step, rows = stepper("pushed_pendulum"), np.random.default_rng(4).standard_normal((8, 2))
    options = {"dt": 0.2, "steps": 40, "parameters": {"k": 2.0}}
    pushes, back = gs.Inputs(rows, hold=5), gs.Inputs(-rows, hold=5)
    event = gs.Event("x", level=0.25)
    run, plain = (step.integrate(*START, inputs=pushes, **options, **extra)
                  for extra in ({"events": event}, {}))
    t = run.events["x"].t
    assert len(t) == 3
    assert np.array_equal(run.q, plain.q)
    for i, time in zip(run.events["x"].steps, t, strict=True):
        push_, pull_ = rows[i // 5]
        there = step.integrate(plain.q[i], plain.p[i], dt=time - plain.t[i], steps=1,
                               parameters={"k": 2.0, "push": push_, "pull": pull_})
        assert abs(there.q[-1, 0] - 0.25) <= 64 * EPS
    ensemble = step.integrate_ensemble(*([component] * 2 for component in START), **options,
                                       events=event,
                                       inputs=gs.Inputs(np.array([rows, -rows]), hold=5))
    below = step.integrate(*START, inputs=back, **options, events=event).events["x"].t
    for crossings, times in zip(ensemble.events["x"], (t, below), strict=True):
        assert crossings.t == pytest.approx(times, abs=1e-12)
    stop = step.integrate(*START, inputs=pushes, **options,
                          events=gs.Event("x", level=0.25, terminal=True))
    assert stop.t[-1] == t[0]
    assert abs(stop.q[-1, 0] - 0.25) <= 4 * EPS


FILE = """
name = "cart"
[system]
coordinates = ["x"]
momenta = ["u"]
hamiltonian = "u**2/2 + k*x**2/2"
forces = ["2*push"]
[parameters]
k = 4
[inputs]
push = "k/8"
[start]
q = [0.3]
p = [0.1]
[run]
dt = 0.02
steps = 30
"""


def test_a_file_names_inputs(gyrospark, tmp_path):
    path = tmp_path / "cart.toml"
    path.write_text(FILE, encoding="utf-8")
    model = gs.load_model(path)
    assert [str(s) for s in model.system.inputs] == ["push"]
    assert model.parameters["push"] == 0.5
    for bad, message in ((FILE.replace('"2*push"', '"2*x"'), "force"),
                      (FILE.replace("k = 4", "k = 4\npush = 1"), "once"),
                      (FILE.replace("k*x**2/2", "k*x**2/2 - push*x"), "as forces")):
        path.write_text(bad, encoding="utf-8")
        answer = gyrospark("run", path)
        assert answer.code == 2
        assert message in answer.stderr
        assert answer.stderr.count("\n") == 1


@pytest.mark.parametrize(("inputs", "hold", "message"), [
    (np.zeros((7, 2)), 1, r"\(7, 2\).*\(2,\) or shape \(8, 2\)"),
    (np.zeros((8, 2)), 3, r"shape \(3, 2\)"), (np.zeros((8, 3)), 1, r"shape \(8, 3\)"),
    ({"push": np.zeros(7), "pull": 0}, 1, r"push.*\(7,\)"), ({"push": 1}, 1, "'pull'"),
    ({"push": 1, "pul": 2}, 1, "'pul'"), ([1, np.nan], 1, "not finite"),
    ([1, 2j], 1, "real numbers"), ([1, 2], 0, "hold"),
])
def test_inputs_of_wrong_shape_are_refused(inputs, hold, message):
    step = stepper("pushed_pendulum")
    with pytest.raises(InputError, match=message):
        step.integrate(*START, dt=0.02, steps=8, parameters={"k": 2.0},
                       inputs=gs.Inputs(inputs, hold=hold))


def test_inputs_that_nobody_declared_are_refused():
    with pytest.raises(InputError, match="has none"):
        gs.stepper("G-L", 2).integrate([1, 0, 0, 0], [0, 0, 0, 0], dt=0.1, steps=1, inputs=1,
                                       parameters=gs.problems.fast_top().parameters | {"gamma": 1})
    for H, g, options in ((u**2 - push * x, [], {}), (u**2 + v**2, [x - push], {}),
                       (u**2, [], {"quantities": {"seen": push}})):
        with pytest.raises(InputError, match="as forces"):
            gs.System((x, y), (u, v), (), H, g, inputs=(push,), name="wrong", **options)
    step = stepper("pushed_pendulum")
    with pytest.raises(InputError, match="'push'"):
        step.integrate(*START, dt=0.02, steps=8, parameters={"k": 2.0})
