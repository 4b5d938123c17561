"""States between steps: real steps of a part of Δt, on the constraints and of the run's order."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import gyrospark as gs
import systems

EPS = {"double": 2.0**-52, "float": 2.0**-23, "float128": 2.0**-112}
TIMES = np.random.default_rng(7).uniform(0.0, 1.03, 40)


def fast_top(real: str = "double", stages: int = 2):
    top = gs.problems.fast_top()
    step = systems.stepper("heavy_top", "G-L", stages, real)
    parameters = top.parameters | {"gamma": gs.gamma(top.inertia)}
    return step, *step.project(top.q0, top.p0, parameters=parameters), parameters


@pytest.mark.parametrize("real", [
    "double", *(pytest.param(real, marks=pytest.mark.slow) for real in ("float", "float128"))])
def test_at_the_steps_it_is_the_run(real: str) -> None:
    """Stored states are returned as they are, others are computed again."""
    step, q0, p0, parameters = fast_top(real, stages=2)
    run = step.integrate(q0, p0, dt=1e-2, steps=33, every=10, parameters=parameters)
    full_run = step.integrate(q0, p0, dt=1e-2, steps=33, parameters=parameters)
    again = run.at(run.t)
    for name in ("q", "p", "multipliers", "iterations", "energies"):
        assert np.array_equal(getattr(again, name), getattr(run, name)), name
    assert np.abs(run.at(full_run.t).q - full_run.q).max() <= 64 * EPS[real]
    assert np.abs(run.at(full_run.t).multipliers / full_run.multipliers - 1).max() < 1e4 * EPS[real]


def test_order_and_direction_of_times_do_not_matter() -> None:
    step, q0, p0, parameters = fast_top(stages=3)
    run = step.integrate(q0, p0, dt=1e-2, steps=103, every=25, parameters=parameters)
    states, order = run.at(TIMES), np.argsort(TIMES)
    sorted_ = run.at(TIMES[order])
    assert np.abs(states.q[order] - sorted_.q).max() < 16 * EPS["double"]
    assert np.array_equal(states.t, TIMES)
    back = step.integrate(gs.Start(run.q[-1], run.p[-1], t=run.t[-1]), dt=-1e-2, steps=103,
                          every=4, parameters=parameters)
    # each is as near to the motion as the scheme is: O(Δt^6) there and back
    assert np.abs(back.at(TIMES).q - states.q).max() < 1e-5
    alone = run.at(float(TIMES[3]))
    assert np.abs(alone.q - states.q[3]).max() < 16 * EPS["double"]


def test_work_is_that_since_the_start() -> None:
    name = "driven_oscillator"
    step, parameters = systems.stepper(name), systems.case(name).parameters
    q0, p0 = systems.start(name, step)
    run = step.integrate(q0, p0, dt=1e-2, steps=100, every=7, parameters=parameters)
    fine = step.integrate(q0, p0, dt=1e-3, steps=1000, parameters=parameters)
    assert np.abs(run.at(fine.t).work - fine.work).max() < 1e-9
    late = run.at([0.5, 0.7])
    assert abs(late.energy_error()[1]) < 1e-9  # since the first of them, not since the start


def test_what_was_read_needs_its_stepper(tmp_path) -> None:
    step, q0, p0, parameters = fast_top()
    run = step.integrate(q0, p0, dt=1e-2, steps=20, parameters=parameters)
    read = gs.load(run.save(tmp_path / "run.npz"))
    with pytest.raises(gs.InputError, match=r"stepper.*at\(times, step"):
        read.at(0.111)
    with pytest.raises(gs.InputError, match="stepper"):
        pickle.loads(pickle.dumps(run)).at(0.111)
    assert np.array_equal(read.at(0.111, stepper=step).q, run.at(0.111).q)
    of_three_stages = fast_top(stages=3)[0]
    with pytest.raises(gs.InputError, match=r"stepper.*name"):
        read.at(0.111, stepper=of_three_stages)


@pytest.mark.parametrize(("times", "text"), [
    ([0.1, 0.3], r"0\.3.*0\.0 to 0\.2 s"),
    ([-1e-9], "outside"),
    ([float("nan")], "not finite"),
    ([["0.1"]], "real numbers"),
    ([[0.1]], r"\(1, 1\)"),
])
def test_wrong_times_end_in_a_sentence(times, text: str) -> None:
    step, q0, p0, parameters = fast_top()
    run = step.integrate(q0, p0, dt=1e-2, steps=20, parameters=parameters)
    with pytest.raises(gs.InputError, match=text):
        run.at(times)


@pytest.mark.parametrize("dt", [1e-2, -1e-2])
def test_a_run_for_times_stores_no_more_than_it_needs(dt: float) -> None:
    """``t_eval`` has the states that ``at`` has of a run with each step; the report is the same."""
    step, q0, p0, parameters = fast_top()
    times = np.copysign(1.0, dt) * np.append(TIMES, [0.0, 0.5, 1.03])
    full_run = step.integrate(q0, p0, dt=dt, steps=103, parameters=parameters)
    sampled = step.integrate(q0, p0, dt=dt, steps=103, parameters=parameters, t_eval=times)
    for name in ("t", "q", "p", "energies"):
        assert np.array_equal(getattr(sampled, name), getattr(full_run.at(times), name)), name
    assert sampled.report == full_run.report
    assert np.array_equal(sampled.q[-3], full_run.q[0])
    assert np.array_equal(sampled.q[-1], full_run.q[-1])


def test_a_run_for_times_that_fails_keeps_what_it_has() -> None:
    step, q0, p0, parameters = fast_top()
    run = {"dt": 1e-2, "steps": 50, "parameters": parameters}
    with pytest.raises(gs.StepFailed) as failed:
        step.integrate(q0, p0, **run, t_eval=[0.105, 0.35],
                       solver=gs.Solver("newton", max_iterations=1))
    assert len(failed.value.trajectory) >= 1
    with pytest.raises(gs.InputError, match=r"every = 3.*t_eval"):
        step.integrate(q0, p0, **run, every=3, t_eval=[0.1])
    with pytest.raises(gs.InputError, match=r"0\.6.*outside"):
        step.integrate(q0, p0, **run, t_eval=[0.6])
    assert len(step.integrate(q0, p0, **run, t_eval=[])) == 0
    assert len(step.integrate(q0, p0, dt=1e-2, steps=0, parameters=parameters, t_eval=[0.0])) == 1


def test_no_times_and_times_in_any_order(tmp_path):
    step = systems.stepper("pendulum")
    run = systems.run("pendulum", step, 20)
    empty = run.at([])
    assert "0 states" in repr(empty)
    assert len(empty.energy_error()) == len(empty.table()) == 0
    for ending in (".npz", ".nc"):
        assert gs.load(empty.save(tmp_path / f"none{ending}")).q.shape == (0, 2)
    with pytest.raises(gs.InputError, match="no state"):
        empty.save(tmp_path / "none.zarr")
    shuffled = run.at([0.7, 0.1, 0.4])
    assert np.array_equal(shuffled.q[1], run.at(0.1).q)
    for states, word in ((empty, "no states"), (shuffled, "order")):
        with pytest.raises(gs.InputError, match=word):
            states.at(0.2)
