"""Simulations: the bits of ``integrate``, their record, copies, parameters that change."""

from __future__ import annotations

import copy
import pickle
import runpy
import signal
import threading
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gyrospark as gs
import systems
from calls import LATE, PARAMETERS, RUN, TOP, refused
from gyrospark.runtime.results.outputs import OUTPUTS
from gyrospark.runtime.steppers import simulation
from processes import PATIENCE, ROOT
from strategies import EPS


def begun(step, **changes):
    return step.start(TOP.q0, TOP.p0, **RUN | changes)


def in_pieces(sim, count, steps):
    for _ in range(count):
        sim.advance(steps)


def assert_is(sim, run):
    """Check state, time and report of a simulation to the bit against the end of a run."""
    assert np.array_equal(sim.q, run.q[-1])
    assert np.array_equal(sim.p, run.p[-1])
    assert sim.t == run.t[-1]
    assert sim.report == run.report


@pytest.mark.parametrize("solver", ["auto", "newton", "fixed-point"])
def test_any_split_is_a_run_to_the_bit(solver, step):
    run = step.integrate(TOP.q0, TOP.p0, steps=150, solver=solver, **RUN)
    sim = begun(step, solver=solver)
    for steps in (1, 0, 1, 16, 17, 115):
        sim.advance(steps)
    assert_is(sim, run)
    assert sim.steps == 150
    assert sim.dt == 1e-3


@pytest.mark.filterwarnings("ignore:The fastest rotation")
@pytest.mark.parametrize(("real", "solver"), [
    ("float", "auto"), ("long-double", "auto"), ("float128", "newton")])
def test_every_type(real, solver, tmp_path):
    """Times of a float128 simulation have 34 digits; steps need Newton's help at this dt."""
    step = systems.stepper("heavy_top", real=real)
    q, p = step.project(TOP.q0, TOP.p0, parameters=PARAMETERS)
    begin, options = gs.Start(q, p, PARAMETERS, 1.5), {"dt": 0.02, "solver": solver}
    run = step.integrate(begin, steps=12, **options)
    sim, unrecorded = (step.start(begin, record=record, **options) for record in (True, False))
    for simulated in (sim, unrecorded):
        simulated.advance(5)
        simulated.advance(7)
        assert_is(simulated, run)
        assert_is(pickle.loads(pickle.dumps(simulated)), run)
    trajectory = sim.trajectory
    assert_same_run(trajectory, run)
    assert_same_run(gs.load(trajectory.save(tmp_path / "run.npz")), run)
    between = run.t[:-1] + 0.4 * options["dt"]
    assert np.array_equal(trajectory.at(between).q, run.at(between).q)
    sim.advance(5)
    assert len(trajectory) == 13
    assert len(sim.trajectory) == 18


def test_a_simulation_comes_from_a_stepper(gl3):
    with refused("start.*step.start"):
        gs.Simulation(gl3, gs.problems.fast_top())


def test_a_tableau_without_fixed_point_iterations():
    """Newton's method solves every step."""
    step = gs.stepper(tableau=ROOT / "examples" / "tableaux" / "radau_plain_2.json")
    sim = begun(step)
    sim.advance(5)
    sim.advance(7)
    assert_is(sim, step.integrate(TOP.q0, TOP.p0, steps=12, **RUN))


def test_copies_go_their_own_way(gl3):
    sim = begun(gl3)
    sim.advance(30)
    copies = [sim.copy(), copy.copy(sim), copy.deepcopy(sim), pickle.loads(pickle.dumps(sim))]
    sim.advance(50)
    assert all(copied.steps == 30 for copied in copies)
    for copied in copies:
        copied.advance(50)
        assert np.array_equal(copied.q, sim.q)
        assert np.array_equal(copied.p, sim.p)
        assert copied.report == sim.report


def test_a_pickle_of_other_code_is_refused(gl3):
    sim = begun(gl3)
    make, (step, provenance, *contents) = sim.__reduce__()
    assert make is simulation._unpickle
    with refused("pickled.*cpu"):
        make(step, provenance | {"cpu": "another"}, *contents)


def test_arrays_belong_to_the_caller(gl3):
    sim = begun(gl3)
    sim.advance(np.int64(3))
    q, p = sim.q, sim.p
    q[:] = p[:] = 0
    sim.advance(4.0)
    assert_is(sim, gl3.integrate(TOP.q0, TOP.p0, steps=7, **RUN))


# ---------------------------------------------------------------- parameters that change


def test_parameters_change_between_steps(step):
    """A new start has the same motion to round-off; errors do not jump."""
    sim = begun(step)
    sim.advance(40)
    before = sim.report
    heavier = sim.parameters | {"mgl": 2 * PARAMETERS["mgl"]}
    sim.parameters = heavier
    assert sim.parameters == heavier
    fresh_run = step.integrate(sim.q, sim.p, dt=1e-3, steps=40, parameters=heavier)
    sim.advance(40)
    assert abs(sim.q - fresh_run.q[-1]).max() < 1e-13
    assert abs(sim.p - fresh_run.p[-1]).max() < 1e-13
    assert sim.report.energy_error_max < 2 * (before.energy_error_max
                                              + fresh_run.report.energy_error_max)
    assert abs(sim.report.energy_start - fresh_run.report.energy_start) < 1e-12 + \
        2 * before.energy_error_max


def test_the_same_parameters_change_nothing(step):
    sim = begun(step)
    for _ in range(6):
        sim.advance(20)
        sim.parameters = PARAMETERS
    assert_is(sim, step.integrate(TOP.q0, TOP.p0, steps=120, **RUN))


def test_parameters_without_an_energy_are_refused():
    sim = systems.stepper("logarithm").start([8.0], [0.0], dt=0.01, parameters={"dt": 1.0})
    with refused("H.*parameters"):
        sim.parameters = {"dt": 1.7e308}
    assert sim.parameters["dt"] == 1


def test_parameters_that_the_state_is_off():
    """The length of a pendulum cannot change under way; the old value stays."""
    sim = systems.stepper("pendulum").start([0.6, -0.8], [0.8, 0.6], dt=0.01,
                                            parameters={"m": 1, "l": 1, "g": 9.81})
    with refused("constraints"):
        sim.parameters = {"m": 1, "l": 1.1, "g": 9.81}
    sim.parameters = {"m": 1, "l": 1, "g": 1.62}
    sim.advance(5)
    assert sim.parameters == {"m": 1, "l": 1, "g": 1.62}
    with pytest.raises(TypeError):
        sim.parameters["g"] = 3
    for wrong, message in (({"m": 1, "g": 1}, "'l'"), ({"m": 0, "l": 1, "g": 1}, "m = 0.*zero"),
                           ({"m": 1, "l": 1, "g": 1, "h": 1}, "'h' is unknown")):
        with refused(message):
            sim.parameters = wrong


# ---------------------------------------------------------------- a controller


def test_a_controller_settles_as_its_poles_say(monkeypatch):
    """At the end of the example an axis decays as the slowest root of its sampled, linear loop.

    About each axis I θ̈ = −θ/4 − 4 θ̇, the right side held for h = 0.1 s: between two samples
    (θ, θ̇) is multiplied by a matrix of two rows.
    """
    monkeypatch.chdir(ROOT)
    example = runpy.run_path(str(ROOT / "examples" / "attitude_control.py"))
    sim, angles, h = example["sim"], example["seen"], 0.1
    assert sim.t == pytest.approx(600, abs=1e-9)
    assert angles[0] > 70
    assert angles[-1] < 1e-14
    assert sim.report.constraint_max <= 2 * EPS
    assert sim.report.momentum_constraint_max <= 2 * EPS
    slowest = max(abs(np.linalg.eigvals(np.array([[1, h], [0, 1]]) - np.outer(
        [h**2 / 2, h], [0.25, 4]) / inertia)).max() for inertia in (12, 10, 3))
    assert angles[5900] / angles[5000] == pytest.approx(slowest**900, rel=1e-4)


# ---------------------------------------------------------------- failures


@pytest.mark.parametrize("solver", ["auto", "newton", "fixed-point"])
def test_a_failed_step_leaves_the_last_good_state(solver, failures):
    for step, options, _ in failures[:1]:
        options = options | {"solver": solver}
        with pytest.raises(gs.StepFailed) as of_run:
            step.integrate(*LATE, steps=200, **options)
        sim = step.start(*LATE, **options)
        with pytest.raises(gs.StepFailed) as failed:
            in_pieces(sim, 40, 5)
        done = of_run.value.trajectory
        assert (failed.value.step, failed.value.reason) == (of_run.value.step, of_run.value.reason)
        assert sim.steps == failed.value.step - 1 == done.report.steps
        assert np.array_equal(sim.q, done.q[-1])
        assert len(failed.value.trajectory) == 1
        assert np.array_equal(failed.value.trajectory.q[0], sim.q)
        assert failed.value.trajectory.t[0] == sim.t
        with pytest.raises(gs.StepFailed):  # it stays there
            sim.advance()
        assert np.array_equal(sim.q, done.q[-1])
        q, p = step.project(sim.q, sim.p, parameters=PARAMETERS)
        again = step.start(gs.Start(q, p, t=sim.t), dt=1e-4, parameters=PARAMETERS)
        again.advance(3)
        assert again.report.constraint_max < 1e-15


def test_it_goes_on_after_a_failure(gl3):
    """Steps fail with a heavy weight; with a lighter one they go on from the last good state."""
    sim = gl3.start(TOP.q0, TOP.p0, dt=5e-3, parameters=PARAMETERS)
    sim.advance(10)
    state = sim.q, sim.p
    sim.parameters = PARAMETERS | {"mgl": 1e6}
    with pytest.raises(gs.StepFailed):
        sim.advance(5)
    assert np.array_equal(sim.q, state[0])
    sim.parameters = PARAMETERS
    sim.advance(10)
    fresh_run = gl3.integrate(*state, dt=5e-3, steps=10, parameters=PARAMETERS)
    assert abs(sim.q - fresh_run.q[-1]).max() < 1e-12
    assert sim.report.constraint_max < 1e-15


def before_each_piece(sim, action, monkeypatch):
    """Call a function before each piece of a long call."""
    advance = sim._run.advance
    monkeypatch.setattr(sim._run, "advance", lambda steps: (action(), advance(steps))[1])


def test_one_thread_at_a_time(gl3, monkeypatch):
    sim, inside, ended = begun(gl3), threading.Event(), threading.Event()
    before_each_piece(sim, lambda: (inside.set(), ended.wait(PATIENCE)), monkeypatch)
    long = threading.Thread(target=lambda: sim.advance(1000))
    long.start()
    assert inside.wait(PATIENCE)
    for use in (sim.advance, sim.copy, lambda: pickle.dumps(sim)):
        with refused("thread"):
            use()
    ended.set()
    long.join()
    assert sim.steps == 1000


def test_ctrl_c_ends_a_long_call_at_a_step(gl3, monkeypatch):
    """The simulation stands where it was ended, and goes on from there to the bit."""
    sim = begun(gl3)
    before_each_piece(sim, lambda: sim.steps and signal.raise_signal(signal.SIGINT), monkeypatch)
    with pytest.raises(gs.errors.Stopped, match=r"step [\d,]+ of 100,000,000") as stopped:
        sim.advance(100_000_000)
    monkeypatch.undo()
    assert stopped.value.signal == signal.SIGINT
    uninterrupted = begun(gl3)
    uninterrupted.advance(sim.steps)
    for simulated in (sim, uninterrupted):
        simulated.advance(3)
    assert sim.steps > 3
    assert np.array_equal(sim.q, uninterrupted.q)
    assert sim.report == uninterrupted.report


def test_what_it_says_of_itself(gl3):
    sim = begun(gl3)
    sim.advance(12)
    assert repr(sim) == "<Simulation by heavy_top_gl3_gamma: 12 steps of 0.001 s, t = 0.012 s>"
    assert isinstance(sim, gs.Simulation)


def test_the_start_counts_once_in_a_run(gl3):
    """Means are over k = 0..N: a start that is a little off shows how often it is counted."""
    q = TOP.q0 * (1 + 2e-15)
    run = gl3.integrate(q, TOP.p0, steps=1, **RUN)
    assert run.report.constraint_mean == pytest.approx(run.g_errors.mean(), rel=1e-12)


def assert_same_run(trajectory, run):
    """Check the arrays and the report of a trajectory to the bit against another."""
    for output in OUTPUTS:
        a, b = getattr(trajectory, output.attribute), getattr(run, output.attribute)
        assert a.dtype == b.dtype
        assert np.array_equal(a, b, equal_nan=a.dtype != object), output.attribute
    assert trajectory.report == run.report
    assert (trajectory.dt, trajectory.every) == (run.dt, run.every)
    assert list(map(repr, trajectory.parameters.items())) == list(map(repr, run.parameters.items()))


@pytest.mark.parametrize(("scheme", "stages", "solver"), [
    ("G-L", 2, "auto"), ("G-L", 2, "newton"),
    pytest.param("EMS", None, "newton", marks=pytest.mark.slow)])
@given(parts=st.lists(st.tuples(st.integers(0, 30), st.none() | st.integers(-3, 3)), max_size=6))
@settings(max_examples=4)
def test_a_history_is_that_of_integrate(scheme, stages, solver, parts):
    """Steps have the inputs that held in them, however calls share them; a pickle goes on."""
    step = systems.stepper("pushed_pendulum", scheme, stages)
    begin, options = gs.Start([0.6, -0.8], [0.8, 0.6], t=1.5), {"dt": 0.03, "solver": solver}
    inputs = {"push": 0.5, "pull": -1.0}
    sim = step.start(begin, parameters={"k": 2.0} | inputs, record=True, **options)
    rows = []
    for steps, pull in parts:
        inputs |= {} if pull is None else {"pull": pull}
        sim.advance(steps, **({} if pull is None else {"pull": pull}))
        rows += [list(inputs.values())] * steps
        if steps % 2:
            sim = pickle.loads(pickle.dumps(sim))
    run = step.integrate(begin, parameters={"k": 2.0} | (
        inputs if all(pull is None for _, pull in parts) else {}), steps=len(rows),
        inputs=None if all(pull is None for _, pull in parts) else np.reshape(rows, (-1, 2)),
        **options)
    assert_same_run(sim.trajectory, run)
    assert_is(sim, run)


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_a_history_ends_where_a_step_fails(gl3):
    """The history has all steps until then; a copy has its own."""
    sim = begun(gl3, dt=0.08, record=True, solver=gs.Solver("fixed-point", max_iterations=30))
    copied = sim.copy()
    with pytest.raises(gs.StepFailed) as failed:
        sim.advance(10)
    assert len(failed.value.trajectory) == len(sim.trajectory) == sim.steps + 1
    assert len(copied.trajectory) == 1
    with refused("records"):
        sim.advance(1)


def test_a_history_is_asked_for(gl3):
    with refused("record=True"):
        _ = begun(gl3).trajectory
    with refused("record"):
        begun(gl3, record=1)
    sim = begun(gl3, record=True)
    with refused("parameters"):
        sim.parameters = sim.parameters | {"mgl": 0.1}
    assert len(sim.trajectory) == 1


def test_a_history_grows_as_a_list_does(gl3, monkeypatch):
    """Arrays grow to twice their size at least, and never to twice as many rows as steps."""
    sim = begun(gl3, record=True)
    rooms, move_rows = [len(sim._run._inputs)], type(sim._run)._move_rows

    def moved(run, room, *rows):
        assert room < 2 * (run.steps + steps)
        rooms.append(room)
        move_rows(run, room, *rows)

    monkeypatch.setattr(type(sim._run), "_move_rows", moved)
    for steps in (*[1] * 500, 20_000):
        sim.advance(steps)
    assert len(rooms) > 2
    assert all(later >= 2 * earlier for earlier, later in pairwise(rooms))
    assert len(sim._run._rows.iterations) == rooms[-1] + 1
    assert_is(sim, sim.trajectory)


def loop(step, steps: int, **changes):
    q, p = TOP.q0, TOP.p0
    for _ in range(steps):
        q, p = step.step(q, p, **RUN | changes)
    return q, p


@pytest.mark.parametrize("solver", ["auto", "newton", "fixed-point"])
def test_a_loop_of_steps_is_a_run_to_the_bit(solver, step):
    run = step.integrate(TOP.q0, TOP.p0, steps=100, solver=solver, **RUN)
    for _ in range(2):  # what was held before does not matter
        q, p = loop(step, 100, solver=solver)
        assert np.array_equal(q, run.q[-1])
        assert np.array_equal(p, run.p[-1])


def test_anything_else_starts_anew(gl3):
    """A changed state, time step, parameter or solver does not belong to the held trajectory."""
    def after(change, **changes):
        q, p = (x.copy() for x in loop(gl3, 70))
        change(q, p)
        q, p = gl3.project(q, p, parameters=PARAMETERS)
        stepped = gl3.step(q, p, **RUN | changes)
        alone = gl3.integrate(q, p, steps=1, **RUN | changes)
        return np.array_equal(stepped[0], alone.q[-1]) and np.array_equal(stepped[1], alone.p[-1])

    def turned(q, p):
        q *= -1
        p *= -1

    def unchanged(q, p):
        pass

    assert after(turned)
    assert after(unchanged, dt=2e-3)
    assert after(unchanged, solver="newton")
    assert after(unchanged, parameters=PARAMETERS | {"mgl": 0.5})


def test_results_belong_to_the_caller(gl3):
    """Writing into results changes nothing of the held trajectory; written ones start anew."""
    q, p = loop(gl3, 5)
    run = gl3.integrate(TOP.q0, TOP.p0, steps=6, **RUN)
    state = q.copy()
    q[:] = 0
    again = gl3.step(state, p, **RUN)
    assert np.array_equal(again[0], run.q[-1])
    q, p = loop(gl3, 70)
    q[:], p[:] = TOP.q0, TOP.p0
    anew = gl3.step(q, p, **RUN)
    assert np.array_equal(anew[0], run.q[1])
    assert np.array_equal(anew[1], run.p[1])


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
