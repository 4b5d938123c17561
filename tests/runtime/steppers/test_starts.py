"""Starts are one argument for state, parameters and time, wherever something is integrated."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import TOP
from processes import ROOT
from systems import case, start, stepper

EPS = np.finfo(float).eps
STEP = {"dt": 1e-3, "steps": 12}


def top():
    return stepper("heavy_top")


def test_a_problem_is_a_start_and_gamma_is_by_rule():
    run = top().integrate(TOP, **STEP)
    by_number = TOP.parameters | {"gamma": gs.gamma(TOP.inertia)}
    for parameters in (by_number, TOP.parameters):
        plain = top().integrate(TOP.q0, TOP.p0, parameters=parameters, **STEP)
        assert np.array_equal(plain.q, run.q)
        assert plain.parameters == run.parameters == by_number


@pytest.mark.parametrize("name", ["double_top", "satellite"])
def test_a_model_is_a_start(name):
    step, model = stepper(name), case(name).system
    run = step.integrate(model, dt=case(name).dt, steps=5)
    plain = step.integrate(model.q0, model.p0, dt=case(name).dt, steps=5,
                           parameters=model.parameters)
    assert np.array_equal(run.q, plain.q)


def test_merged_moments_have_the_bits_of_a_model_with_these_moments():
    """γ is by the rule of a model, by the mean without one, and stays where it is given."""
    moments = (0.0021, 0.0017, 0.0009)
    with_moments = gs.Start(TOP.q0, TOP.p0, dict(zip(("I1", "I2", "I3"), moments, strict=True))
                            | {"mgl": TOP.parameters["mgl"]})
    merged = top().integrate(TOP, parameters={"I1": 0.0021, "I2": 0.0017, "I3": 0.0009}, **STEP)
    assert np.array_equal(merged.q, top().integrate(with_moments, **STEP).q)
    assert merged.parameters["gamma"] == gs.gamma(moments)
    begin = TOP.start.replace(parameters=TOP.parameters | {"gamma": 0.0012})
    run = top().integrate(begin, parameters={"I1": 0.0021}, **STEP)
    assert run.parameters["gamma"] == 0.0012
    assert run[-1].parameters["gamma"] == 0.0012
    start = TOP.start.of_model({"gamma": TOP.inertia}, {"gamma": "h"})
    assert top().integrate(start, **STEP).parameters["gamma"] == gs.gamma(TOP.inertia, "h")
    merged = top().integrate(start, parameters={"I1": 0.0021}, **STEP)
    assert merged.parameters["gamma"] == gs.gamma((0.0021, *TOP.inertia[1:]), "h")


def test_a_row_goes_on_to_round_off_and_finds_gamma_anew():
    full_run, first_half = top().integrate(TOP, dt=1e-3, steps=24), top().integrate(TOP, **STEP)
    assert "gamma" not in first_half[-1].parameters
    second_half = top().integrate(first_half[-1], **STEP)
    assert float(second_half.t[-1]) == pytest.approx(0.024, rel=EPS)
    assert np.abs(second_half.q[-1] - full_run.q[-1]).max() <= 64 * EPS
    assert np.array_equal(first_half[0].q, first_half.q[0])
    assert [begin.t for begin in first_half] == first_half.t.tolist()
    with pytest.raises(IndexError):
        first_half[13]
    with pytest.raises(gs.InputError, match="row"):
        first_half["last"]


@pytest.mark.parametrize("name", ["driven_oscillator", "driven_pendulum", "sleigh"])
def test_a_simulation_and_a_row_go_on_from_their_time(name):
    step, entry = stepper(name), case(name)
    state = step.consistent(entry.q, entry.p, parameters=entry.parameters, t=0.25)
    begin = gs.Start(state.q, state.p, entry.parameters, 0.25)
    run = step.integrate(begin, dt=entry.dt, steps=6)
    simulation = step.start(begin, dt=entry.dt)
    simulation.advance(6)
    assert float(run.t[0]) == 0.25
    assert np.array_equal(simulation.q, run.q[-1])
    later = [step.integrate(source, dt=entry.dt, steps=3) for source in (simulation, run[-1])]
    assert [float(x.t[0]) for x in later] == [float(run.t[-1])] * 2
    assert np.array_equal(*(x.q for x in later))
    longer = step.integrate(begin, dt=entry.dt, steps=9)
    assert np.abs(later[0].q - longer.q[6:]).max() <= 64 * EPS  # solved from other guesses


def test_a_row_has_the_inputs_of_the_step_that_ended_there():
    name = "pushed_pendulum"
    step, entry = stepper(name), case(name)
    rows = {key: np.linspace(0.1, 0.4, 4) for key in step.binding.input_names}
    begin = gs.Start(*start(name, step), entry.parameters)
    run = step.integrate(begin, dt=entry.dt, steps=8, inputs=gs.Inputs(rows, hold=2))
    each = {key: np.repeat(row, 2) for key, row in rows.items()}
    assert np.array_equal(run.q, step.integrate(begin, dt=entry.dt, steps=8, inputs=each).q)
    assert [set(run[k].inputs.values()) for k in (2, 4)] == [{rows[next(iter(rows))][0]},
                                                             {rows[next(iter(rows))][1]}]
    with pytest.raises(gs.InputError, match="hold"):
        step.integrate(begin, dt=entry.dt, steps=8, inputs=rows, hold=2)


def test_a_state_between_steps_is_a_start():
    run = top().integrate(TOP, **STEP)
    between = run.at(0.0045)
    assert np.array_equal(between.q, run.at([0.0045]).q[0])
    assert between.t == 0.0045


def test_ensembles_take_starts_columns_and_an_end():
    moments = np.array([0.0020, 0.0021])
    columns = top().integrate_ensemble(TOP, dt=1e-3, t_end=0.012, parameters={"I1": moments})
    each = top().integrate_ensemble([TOP, TOP], dt=1e-3, steps=12, parameters={"I1": moments})
    assert np.array_equal(columns.q, each.q)
    for member, moment in zip(columns.members, moments, strict=True):
        assert member.parameters["gamma"] == gs.gamma((moment, *TOP.inertia[1:]))
    later = top().integrate_ensemble([TOP.start.replace(t=t) for t in (0.0, 0.5)], **STEP)
    assert later.t[:, 0].tolist() == [0.0, 0.5]
    with pytest.raises(gs.InputError, match="steps"):
        top().integrate_ensemble([TOP, TOP.start.replace(t=0.006)], dt=1e-3, t_end=0.012)
    with pytest.raises(gs.InputError, match="2"):
        top().integrate_ensemble([TOP, TOP], **STEP, parameters={"I1": [0.002] * 3})


def test_solvers_are_objects_or_names():
    tight, loose = gs.Solver("newton"), gs.Solver("newton", tolerance=1e-4)
    runs = [top().integrate(TOP, solver=solver, **STEP) for solver in ("newton", tight, loose)]
    assert np.array_equal(runs[0].q, runs[1].q)
    assert runs[2].report.iterations < runs[0].report.iterations
    assert pickle.loads(pickle.dumps(tight)) == copy.deepcopy(tight) == tight


@pytest.mark.parametrize(("call", "says"), [
    (lambda: top().integrate("rest", **STEP), "start"),
    (lambda: top().integrate(TOP.q0, **STEP), "^p .*start"),
    (lambda: top().integrate_ensemble([TOP.q0], **STEP), "^p .*starts"),
    (lambda: top().integrate(gs.models.double_top(), **STEP), "another system"),
    (lambda: top().integrate([1, [0, 0], 0, 0], **STEP), "^p "),
    *((lambda q=q: top().integrate(gs.Start(q, TOP.p0, TOP.parameters), **STEP), "^q ")
      for q in (1.0, [1, [0, 0], 0, 0], [[[1, 0, 0, 0]]], [[1, 0, 0, 0]], "rest", None)),
    *((lambda q=q: top().integrate_ensemble(gs.Start(q, TOP.p0, TOP.parameters), **STEP), "^q ")
      for q in (1.0, [1, [0, 0], 0, 0], [[[1, 0, 0, 0]]], "rest", None)),
    (lambda: top().integrate_ensemble([gs.Start([1, [0, 0], 0, 0], TOP.p0)], **STEP), "^q "),
    (lambda: top().integrate_ensemble([TOP, 3], **STEP), "starts"),
    (lambda: top().integrate_ensemble([], **STEP), "starts"),
    (lambda: TOP.start.replace(velocity=1.0), "velocity"),
    (lambda: gs.Start(TOP.q0, TOP.p0, 3.0), "parameters"),
    (lambda: gs.Start(TOP.q0, TOP.p0, {1: 2.0}), "parameters.* 1,"),
    (lambda: gs.Start(iter(TOP.q0), TOP.p0), "^q .*once"),
    (lambda: top().integrate_ensemble([TOP, TOP], parameters=[{}], **STEP), "^1 sets.* 2 starts"),
    (lambda: gs.Solver("newtn"), "newton"),
    (lambda: gs.Solver(tolerance=0.0), "tolerance"),
    (lambda: gs.Solver(tolerance="small"), "tolerance"),
    (lambda: gs.Solver(max_iterations=0), "max_iterations"),
    (lambda: gs.Inputs([1.0], hold=0), "hold"),
    (lambda: top().integrate(TOP, tolerance=1e-9, **STEP), "gs.Solver"),
    (lambda: top().integrate(TOP, parameters={"I4": 1.0}, **STEP), "I4"),
])
def test_what_is_no_start_or_solver_is_refused(call, says):
    with pytest.raises(gs.InputError, match=says):
        call()


@pytest.mark.parametrize("call", [
    lambda long, short: top().integrate_ensemble([long, short], **STEP),
    lambda long, short: top().integrate_ensemble([short, long], **STEP),
    lambda long, short: top().integrate_ensemble([long.q, short.q], [long.p, short.p], **STEP),
    lambda long, short: top().integrate(long.q, short.p, **STEP),
    lambda long, short: top().start(short, dt=STEP["dt"]),
    lambda long, short: gs.section(top(), [long, short], event=gs.Event("q1"), **STEP),
    lambda long, short: gs.sweep("fast-top", {"start": {"q": [long.q, short.q],
                                                        "p": [long.p, short.p]}}, **STEP),
])
def test_starts_of_different_lengths_are_refused(call):
    short = gs.Start([1.0, 0.0, 0.0], [0.0, 0.0, 0.0], TOP.parameters)
    with pytest.raises(gs.InputError, match=r"^(The start|[qp]) .*\.$"):
        call(TOP.start, short)


def test_a_start_is_copied_and_pickled_and_changes_with_nobody():
    q = np.array(TOP.q0)
    begin = gs.Start(q, TOP.p0, TOP.parameters, 0.5)
    q[:] = 0
    run = top().integrate(begin, **STEP)
    for copied in (copy.deepcopy(begin), pickle.loads(pickle.dumps(begin)), begin.start):
        assert np.array_equal(top().integrate(copied, **STEP).q, run.q)
    assert "mgl" in repr(begin)
    assert "mgl" in begin._repr_html_()


def test_wide_starts_keep_their_digits():
    step = systems.stepper("heavy_top", real="long-double")
    third, start = np.longdouble(1) / 3, gs.problems.fast_top().start
    q, p = step.project([third, 0, third, 0], [0, 0, 0, 0], parameters=start.parameters)
    begin = gs.Start(q, p, start.parameters)
    assert q[0] != float(q[0])
    assert step.integrate(begin, dt=1e-3, steps=1).q[0, 0] == q[0]


def test_no_body_has_such_an_inertia():
    """A single body, of a problem or a file, has the check of the builders, in sweeps too."""
    step, file = systems.stepper("heavy_top"), ROOT / "examples" / "damped_top.toml"
    model = gs.load_model(file)
    for parameters in ({"I1": 1.0}, {"I1": [0.002, 1.0]}, [{"I1": 0.002}, {"I1": 1.0}]):
        start = gs.problems.fast_top()
        call = step.integrate_ensemble if parameters != {"I1": 1.0} else step.integrate
        with pytest.raises(gs.InputError, match="no body"):
            call(start, dt=1e-3, steps=1, parameters=parameters)
    with pytest.raises(gs.InputError, match="inertia"):
        gs.sweep(model, {"I1": [0.002, 1.0]}, scheme="G-L", stages=2, steps=1)
    with pytest.raises(gs.InputError, match=r"body\.inertia"):
        gs.load_model(file, set={"I1": 1.0})
    free = gs.Start(TOP.q0, TOP.p0, {**TOP.parameters, "I1": 1.0})  # effective moments, of no model
    assert step.integrate(free, dt=1e-3, steps=1).report.steps == 1
