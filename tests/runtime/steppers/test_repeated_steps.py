"""A loop of ``step``: each call continues where the one before ended."""

from __future__ import annotations

import threading

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import PARAMETERS, RUN, TOP


def loop(step, steps: int, **more):
    q, p = TOP.q0, TOP.p0
    for _ in range(steps):
        q, p = step.step(q, p, **RUN | more)
    return q, p


@pytest.mark.parametrize("solver", ["auto", "newton", "fixed-point"])
def test_a_loop_of_steps_is_a_run_to_the_bit(solver, step):
    run = step.integrate(TOP.q0, TOP.p0, steps=100, solver=solver, **RUN)
    for _ in range(2):  # what was held before does not matter
        q, p = loop(step, 100, solver=solver)
        assert np.array_equal(q, run.q[-1])
        assert np.array_equal(p, run.p[-1])


def test_anything_else_starts_anew(gl3):
    """A changed state, time step, parameter or solver is none of the trajectory that is held."""
    def after(change, **more):
        q, p = (x.copy() for x in loop(gl3, 70))
        change(q, p)
        q, p = gl3.project(q, p, parameters=PARAMETERS)
        held = gl3.step(q, p, **RUN | more)
        alone = gl3.integrate(q, p, steps=1, **RUN | more)
        return np.array_equal(held[0], alone.q[-1]) and np.array_equal(held[1], alone.p[-1])

    def turned(q, p):
        q *= -1
        p *= -1

    def same(q, p):
        pass

    assert after(turned)
    assert after(same, dt=2e-3)
    assert after(same, solver="newton")
    assert after(same, parameters=PARAMETERS | {"mgl": 0.5})


def test_results_belong_to_the_caller(gl3):
    """Writing into them changes nothing that is held, and is noticed."""
    q, p = loop(gl3, 5)
    run = gl3.integrate(TOP.q0, TOP.p0, steps=6, **RUN)
    kept = q.copy()
    q[:] = 0
    again = gl3.step(kept, p, **RUN)
    assert np.array_equal(again[0], run.q[-1])


def test_threads_do_not_share_what_is_held(gl3):
    run = gl3.integrate(TOP.q0, TOP.p0, steps=200, **RUN)
    ends = []
    threads = [threading.Thread(target=lambda: ends.append(loop(gl3, 200))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(ends) == 4
    assert all(np.array_equal(q, run.q[-1]) for q, _ in ends)


def test_time_goes_on_with_the_steps():
    step = systems.stepper("driven_oscillator")
    numbers = {"parameters": systems.case("driven_oscillator").parameters}
    run = step.integrate(gs.Start([1.0], [0.0], t=2.0), dt=0.0625, steps=20, **numbers)
    q, p = np.array([1.0]), np.array([0.0])
    for k in range(20):
        q, p = step.step(gs.Start(q, p, t=2.0 + k * 0.0625), dt=0.0625, **numbers)
    assert np.array_equal(q, run.q[-1])
    anew = step.step(gs.Start(q, p, t=7.0), dt=0.0625, **numbers)  # not the time that follows
    alone = step.integrate(gs.Start(q, p, t=7.0), dt=0.0625, steps=1, **numbers)
    assert np.array_equal(anew[0], alone.q[-1])


def test_inputs_of_one_call_are_not_those_of_the_next():
    step = systems.stepper("pushed_pendulum")
    q, p = systems.start("pushed_pendulum", step)
    numbers = {"dt": 0.02, "parameters": {"k": 2.0}}
    q, p = step.step(q, p, inputs={"push": 0.5, "pull": -0.2}, **numbers)
    with pytest.raises(gs.InputError, match="push"):
        step.step(q, p, **numbers)


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_a_failed_call_holds_nothing(gl3):
    loop(gl3, 3)
    with pytest.raises(gs.StepFailed):
        gl3.step(TOP.q0, TOP.p0, dt=0.2, parameters=PARAMETERS,
                 solver=gs.Solver("auto", max_iterations=1))
    run = gl3.integrate(TOP.q0, TOP.p0, steps=30, **RUN)
    assert np.array_equal(loop(gl3, 30)[0], run.q[-1])
