"""Derivatives of states within steps: at any times, at events, at the end by an event."""

from __future__ import annotations

import pickle
from functools import cache

import numpy as np
import pytest

import gyrospark as gs
import systems
from event_runs import BALL
from gyrospark.generator.models.model_file import parse_model
from gyrospark.generator.schemes import derivative_kernels
from stores import record

DT, T0 = 0.02, 0.3
VALUES = systems.case("driven_pendulum").parameters
#: Multipliers have a round-off of 1/τ² times that of states, after steps of τ ≤ DT.
FORCE = DT**2 / 10
EVENTS = [gs.Event("x"), gs.Event("v", level=0.3, name="turn"), gs.Event("along", level=0.5)]
NAMES = ["m", "l", "a", "push"]
ALL = gs.Tangents("all", NAMES, dt=True, t0=True, multipliers=True)

ASKED = {
    "events": {"events": EVENTS},
    "terminal": {"events": [gs.Event("x", terminal=True), EVENTS[1]], "every": 7},
    "quantity": {"events": [gs.Event("along", level=0.5, terminal=True)], "every": 7},
    "first step": {"events": [gs.Event("x", level=0.434, terminal=True)]},
    "times": {"t_eval": [0.317, 0.47, 0.333, 0.61, 1.499]},
}


@cache
def stepper():
    return systems.differentiable("driven_pendulum")


@cache
def start():
    state = stepper().consistent([0.5, -0.8], [0.3, 0.4], parameters=VALUES, t=T0)
    return np.concatenate([state.q, state.p])


def integrated(step, z, values=(), dt=DT, t0=T0, steps=60, **options):
    parameters = VALUES | dict(zip(NAMES, values, strict=False))
    begin = step.consistent(z[:2], z[2:], parameters=parameters, t=t0)
    return step.integrate(gs.Start(begin.q, begin.p, t=t0), dt=dt, steps=steps,
                          parameters=parameters, **options)


def numbers(run):
    """Return all numbers that have derivatives, as one vector."""
    crossings = [array for event in run.events.values() for array in (event.t, event.q, event.p)]
    return np.concatenate([np.ravel(array) for array in (run.t, run.q, run.p, *crossings,
                                                         FORCE * run.multipliers)])


def derivatives(run):
    """Return the tangents of ``numbers``."""
    rows = [run.tangents, *(run.tangents.events[name] for name in run.events)]
    arrays = [array for row in rows for array in (row.t, row.q, row.p)]
    arrays.append(FORCE * run.tangents.multipliers)
    return np.concatenate([array.reshape(-1, array.shape[-1]) for array in arrays])


def cotangents(run, weights):
    """Return the cotangents of weights @ numbers."""
    rows = [run, *run.events.values()]
    sizes = [array.shape for row in rows for array in (row.t, row.q, row.p)]
    parts = iter(np.split(weights, np.cumsum([np.prod(size) for size in sizes])))
    by_row = [{name: next(parts).reshape(getattr(row, name).shape) for name in "tqp"}
              for row in rows]
    forces = FORCE * weights[len(weights) - run.multipliers.size :].reshape(run.multipliers.shape)
    return by_row[0] | {"multipliers": forces,
                        "events": dict(zip(run.events, by_row[1:], strict=True))}


@pytest.mark.parametrize("options", [
    pytest.param(options, id=name, marks=[pytest.mark.slow] * (name in ("events", "first step")))
    for name, options in ASKED.items()])
def test_rows_within_steps_have_tangents_and_gradients(options):
    """Tangents by start, parameters, dt and t0 agree with differences; gradients with tangents."""
    step, z = stepper(), start()
    run = integrated(step, z, **options, tangents=ALL)
    assert all(len(event) for event in list(run.events.values())[:1])
    tangents, B = derivatives(run), run.tangents.start[:, :2]
    point = np.concatenate([[0, 0], [VALUES[name] for name in NAMES], [DT, T0]])
    for i, size in enumerate([1, 1, 1, 1, 1, 1, DT, 1]):
        e = np.zeros(8)
        e[i] = 1e-5 * size

        def moved(x):
            return numbers(integrated(step, z + B @ x[:2], x[2:6], *x[6:], **options))

        slope = (8 * (moved(point + e) - moved(point - e)) - moved(point + 2 * e)
                 + moved(point - 2 * e))
        error = np.abs(slope / (12 * e[i]) - tangents[:, i]).max()
        assert error <= 1e-8 * max(np.abs(tangents[:, i]).max(), 1), run.tangents.names[i]
    weights = np.random.default_rng(0).normal(size=len(tangents))
    expected = weights @ tangents
    for memory in ("256 MB", "22 kB", "none"):
        gradient = run.gradient(cotangents(run, weights), wrt=["start", *NAMES, "dt", "t0"],
                                memory=memory).vector()
        assert np.abs(gradient - expected).max() <= 1e-12 * np.abs(expected).max()


@pytest.mark.slow  # a stepper and its derivatives
def test_events_of_a_scheme_that_does_not_keep_the_momentum_constraint():
    """Parameters and dt leave the start as it is; momenta within steps have fewer digits."""
    step, z = systems.differentiable("driven_pendulum", "EMS"), start()

    def run_of(mass, push, dt, **options):
        return step.integrate(gs.Start(z[:2], z[2:], t=T0), dt=dt, steps=60, **ASKED["terminal"],
                              parameters=VALUES | {"m": mass, "push": push}, **options)

    point = np.array([VALUES["m"], VALUES["push"], DT])
    run = run_of(*point, tangents=gs.Tangents(None, ["m", "push"], dt=True, multipliers=True))
    tangents = derivatives(run)
    for i, e in enumerate(np.diag(1e-5 * np.array([1, 1, DT]))):
        slope = (numbers(run_of(*(point + e))) - numbers(run_of(*(point - e)))) / (2 * e[i])
        assert np.abs(slope - tangents[:, i]).max() <= 1e-6 * max(np.abs(tangents[:, i]).max(), 1)
    weights = np.random.default_rng(0).normal(size=len(tangents))
    gradient = run.gradient(cotangents(run, weights), wrt=["m", "push", "dt"]).vector()
    assert np.abs(gradient - weights @ tangents).max() <= 1e-11 * np.abs(weights @ tangents).max()


def test_states_asked_for_later_have_the_tangents_of_those_asked_for_at_once():
    step, times = stepper(), [0.317, 1.2, 0.47]
    run = integrated(step, start(), every=10, tangents=ALL)
    later = run.at(times)
    at_once = integrated(step, start(), t_eval=times, tangents=ALL)
    assert (later.tangents.q == at_once.tangents.q).all()
    assert not later.tangents.t.any()
    copy = pickle.loads(pickle.dumps(at_once))
    assert (copy.tangents.p == at_once.tangents.p).all()
    w = {"q": np.ones(2)}
    assert (step.gradient(copy, w).vector() == at_once.gradient(w).vector()).all()
    assert (run.at([run.t[0]]).tangents.q[0] == run.tangents.q[0]).all()


def test_inputs_of_the_step_that_an_event_ends_have_a_gradient():
    """The inputs of a step that an event cuts short count too."""
    step, z = stepper(), start()
    values = {name: value for name, value in VALUES.items() if name != "push"}
    inputs = np.linspace(-1, 1, 20)[:, None]

    def run_of(inputs):
        return step.integrate(gs.Start(z[:2], z[2:], t=T0), dt=DT, steps=60,
                              inputs=gs.Inputs(inputs, hold=3), parameters=values,
                              events=gs.Event("x", level=-0.2, terminal=True))

    run = run_of(inputs)
    gradient = run.gradient({"t": 1.0, "q": [1.0, 2.0]}, wrt="inputs").inputs
    assert len(gradient) == run.report.steps // 3 + 1
    for i in range(0, len(gradient)):
        e = np.zeros((20, 1))
        e[i] = 1e-4
        slope = sum(sign * (r.t[-1] + r.q[-1] @ [1, 2]) for sign, r in (
            (1, run_of(inputs + e)), (-1, run_of(inputs - e)))) / 2e-4
        assert gradient[i, 0] == pytest.approx(slope, abs=1e-8)


def test_the_time_of_an_end_by_an_event_has_a_gradient():
    """An optimiser's function has the place and the time at which a thrown body comes down."""
    step = thrown()

    def loss(run):
        return run.q[-1, 0] * run.t[-1], {"q": [run.t[-1], 0.0], "t": run.q[-1, 0]}

    f = step.value_and_gradient(
        loss, [0.1, 0.0], [1.0, 1.0], wrt=["start"], parameters={"g": 1.0}, dt=0.03, steps=100,
        events=gs.Event("y", level=-0.5, terminal=True))
    value, gradient = f(np.zeros(4))
    time = 1 + np.sqrt(2)
    assert value == pytest.approx((0.1 + time) * time, rel=1e-14)
    # by x, v_x; the time by y and v_y is 1/√2 and time/√2
    slope = 0.1 + 2 * time
    expected = [time, slope / np.sqrt(2), time**2, slope * time / np.sqrt(2)]
    assert np.allclose(gradient, expected, rtol=1e-13)


def test_events_in_a_moving_frame():
    """The rates of a frame move the motion by its error alone."""
    problem = gs.problems.fast_top()
    parameters = problem.parameters | {"gamma": 0.0016}
    moving, fixed = (systems.differentiable(name) for name in ("heavy_top_in_frame", "heavy_top"))
    rates = [symmetry.name for symmetry in moving.symmetries]
    arguments = {"dt": 4e-5, "steps": 2500, "events": gs.Event("q1", level=0.01)}
    turning = gs.tune(moving, problem, dt=4e-5, frame="start").parameters
    start = gs.Start(problem.q0, problem.p0, parameters | turning)
    *end, _, _ = moving.jvp(start, np.zeros(4), np.zeros(4), dt=4e-5)
    assert np.abs(np.array(end) - moving.step(start, dt=4e-5)).max() <= 16 * np.finfo(float).eps
    run = moving.integrate(problem.q0, problem.p0, **arguments, t_eval=[0.0173, 0.0999],
                           parameters=parameters | turning,
                           tangents=gs.Tangents("all", ["I3", *rates], multipliers=True))
    still = fixed.integrate(problem.q0, problem.p0, **arguments, t_eval=[0.0173, 0.0999],
                            parameters=parameters, tangents=gs.Tangents("all", ["I3"],
                                                                    multipliers=True))
    tangents, expected = derivatives(run), derivatives(still)
    assert np.abs(tangents[:, :7] - expected).max() <= 1e-10 * np.abs(expected).max()
    assert np.abs(tangents[:, 7:]).max() < 1e-11
    weights = np.random.default_rng(0).normal(size=len(tangents))
    gradient = run.gradient(cotangents(run, weights), wrt=["start", "I3", *rates]).vector()
    assert np.abs(gradient - weights @ tangents).max() <= 1e-12 * np.abs(weights @ tangents).max()


@cache
def thrown():
    """Return the stepper of a thrown body, whose height costs too much to derive."""
    step = gs.stepper("G-L", 2, system=parse_model(BALL, "ball.toml"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(derivative_kernels, "_LARGEST_QUANTITIES", 0)
        step._derivative_binding()
    return step


@pytest.mark.parametrize("event", [
    gs.Event("y", level=0.5 - 1e-13, name="apex"), gs.Event("height", level=0.25, name="apex")])
def test_events_without_derivatives_are_refused_by_name(event, tmp_path):
    """The events only touch their level, or cost too much to derive."""
    step = thrown()
    arguments = {"dt": 0.03, "steps": 50, "parameters": {"g": 1.0}, "tangents": gs.Tangents()}
    begin = [0.1, 0.0], [1.0, 1.0]
    run = step.integrate(*begin, **arguments, events=event)
    assert run.tangents.q.shape == (51, 2, 4)
    for trajectory in (run, gs.load(run.save(tmp_path / "run.npz"))):
        with pytest.raises(gs.InputError, match="apex"):
            trajectory.tangents.events["apex"]
    with pytest.raises(gs.InputError, match="apex"):
        run.gradient({"events": {"apex": {"t": np.ones(len(run.events["apex"]))}}})
    ends = gs.Event(event.quantity, event.level, terminal=True, name="apex")
    with pytest.raises(gs.InputError, match="apex"):
        step.integrate(*begin, **arguments, events=ends)


@pytest.mark.parametrize("memory", ["256 MB", "none"])
def test_a_run_that_ends_before_its_times_has_no_row_to_differentiate(memory):
    run = thrown().integrate([0.1, 0.0], [1.0, 1.0], dt=0.03, steps=50, parameters={"g": 1.0},
                             events=gs.Event("y", level=0.25, terminal=True), t_eval=[1.4])
    assert len(run) == 0
    gradient = run.gradient({"q": np.zeros((0, 2))}, wrt=["start", "g"], memory=memory)
    assert not gradient.vector().any()


def test_unknown_events_are_refused():
    run = thrown().integrate([0.1, 0.0], [1.0, 1.0], dt=0.03, steps=50, parameters={"g": 1.0},
                             events=gs.Event("y", level=0.25), tangents=gs.Tangents())
    with pytest.raises(gs.InputError, match="x"):
        run.tangents.events["x"]
    with pytest.raises(gs.InputError, match="'x'"):
        run.gradient({"events": {"x": {"t": [1.0]}}})
    with pytest.raises(gs.InputError, match="shape"):
        run.gradient({"events": {"y": {"t": [1.0, 2.0]}}})


def test_members_of_an_ensemble_have_the_derivatives_of_each_alone():
    """Ends of steps agree bit by bit, events up to round-off of times; a failed member has none."""
    step, z, forces = stepper(), start(), np.array([0.1, 1e300, -0.2, 0.3])[:, None]
    arguments = {"dt": DT, "steps": 40, "events": EVENTS, "parameters": VALUES,
                 "tangents": gs.Tangents("all", ["l"], dt=True, multipliers=True)}
    begin = gs.Start(z[:2], z[2:], t=T0)
    ensemble = step.integrate_ensemble([begin] * 4, **arguments, workers=2, inputs={"push": forces})
    assert [tangents is None for tangents in ensemble.tangents] == [False, True, False, False]
    for i in (0, 2, 3):
        member = ensemble.members[i]
        alone = step.integrate(begin, **arguments, inputs={"push": forces[i, 0]})
        for name in ("q", "p", "t"):
            assert (getattr(member.tangents, name) == getattr(alone.tangents, name)).all()
        assert np.abs(derivatives(member) - derivatives(alone)).max() < 1e-11
        w = {"q": np.cos(alone.q), "t": alone.t}
        wrt = ["start", "inputs", "l"]
        assert (step.gradient(member, w, wrt=wrt).vector()
                == alone.gradient(w, wrt=wrt).vector()).all()


def test_points_of_a_section_move_along_it():
    step, z = thrown(), np.array([[0.1, 0.0], [0.2, 0.1]])
    section = gs.section(step, z, np.ones((2, 2)), event=gs.Event("y", level=0.3), dt=0.03,
                         steps=80, parameters={"g": 1.0}, tangents=gs.Tangents(np.eye(4)))
    assert len(section) == 4
    for tangents, y in zip(section.tangents, z[:, 1], strict=True):
        assert np.abs(tangents.q[:, 1]).max() < 1e-15
        speed = np.sqrt(1 - 2 * (0.3 - y))  # there, by the energy; dt/dy = -1/w at the first point
        assert tangents.t[0, 1] == pytest.approx(-1 / speed, rel=1e-13)


def test_stored_runs_have_the_gradients_of_the_run(tmp_path):
    """Files and stores agree bit by bit, thinned stores to round-off; later rows are a start."""
    step, z = stepper(), start()
    run = integrated(step, z, steps=50, every=5)
    weights, wrt = np.sin(run.q), ["start", "l", "dt", "t0"]
    expected = run.gradient({"q": weights}, wrt=wrt).vector()
    loaded = gs.load(run.save(tmp_path / "run.npz"))
    assert (step.gradient(loaded, {"q": weights}, wrt=wrt).vector() == expected).all()
    recording = record(step, gs.Start(run.q[0], run.p[0], t=T0), dt=DT, steps=50, every=5,
                          parameters=VALUES, out=tmp_path / "run.zarr")
    stored = recording[:]
    assert (step.gradient(stored, {"q": weights}, wrt=wrt).vector() == expected).all()
    thin, later = recording[::3], recording[4:]
    expected_thin = run.gradient({"q": weights * (np.arange(11) % 3 == 0)[:, None]},
                                 wrt=wrt).vector()
    assert np.abs(step.gradient(thin, {"q": weights[::3]}, wrt=wrt).vector()
                  - expected_thin).max() <= 1e-13 * np.abs(expected_thin).max()
    alone = integrated(step, np.concatenate([later.q[0], later.p[0]]), t0=later.t[0], steps=30,
                       every=5).gradient({"q": weights[4:]}, wrt="m")
    assert step.gradient(later, {"q": weights[4:]}, wrt="m")["m"] == pytest.approx(alone["m"],
                                                                                  rel=1e-12)


@pytest.mark.parametrize("every", [1, 7])
def test_stored_runs_to_a_time_between_two_steps_have_its_gradients(every, tmp_path):
    """In memory they are those of the run, of which tangents are differences."""
    step, z, wrt = stepper(), start(), ["start", "l", "dt", "t0"]
    plan = {"dt": DT, "t_end": T0 + 0.567, "every": every, "parameters": VALUES}
    run = step.integrate(gs.Start(z[:2], z[2:], t=T0), **plan)
    weights = {"q": np.sin(run.q), "multipliers": FORCE * np.cos(run.multipliers)}
    expected = run.gradient(weights, wrt=wrt).vector()
    stored = step.integrate(gs.Start(z[:2], z[2:], t=T0), **plan, out=tmp_path / "run.zarr")
    for trajectory in (stored, gs.load(tmp_path / "run.zarr"), run[:],
                       *(gs.load(run.save(tmp_path / f"run{end}")) for end in (".npz", ".nc"))):
        gradient = step.gradient(trajectory, weights, wrt=wrt).vector()
        assert np.abs(gradient - expected).max() <= 1e-13 * np.abs(expected).max()


@pytest.mark.parametrize("options", [
    {"t_eval": [0.317, 0.47]}, {"events": gs.Event("x", terminal=True)},
    {"inputs": np.linspace(0, 1, 60)[:, None]}], ids=lambda options: next(iter(options)))
def test_stored_runs_that_lack_what_gradients_need_are_refused(options, tmp_path):
    """Files lack the steps of rows at other times, of terminal events, and of changing inputs."""
    step, z = stepper(), start()
    run = step.integrate(gs.Start(z[:2], z[2:], t=T0), dt=DT, steps=60, parameters=VALUES,
                         **options)
    loaded = gs.load(run.save(tmp_path / "run.npz"))
    with pytest.raises(gs.InputError, match=r"not kept|not know"):
        step.gradient(loaded, {"q": [1.0, 0.0]})
