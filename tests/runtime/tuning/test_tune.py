"""``gs.tune`` as a call: its result, its arguments, and rules of a model that it resolves."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import TOP, refused

MEAN = gs.gamma(TOP.inertia)


def framed():
    return systems.stepper("heavy_top_in_frame")


def test_a_result_is_numbers_a_reason_and_pilot_runs(gl3):
    done = []
    tuned = gs.tune(gl3, TOP, dt=2e-3, gamma="auto", steps=100, progress=done.append)
    assert tuned.dt == 2e-3
    assert tuned.parameters["gamma"] != MEAN
    assert tuned.pilots[0].parameters == {"gamma": MEAN}
    assert done == [*range(1, len(done) + 1)]
    assert len(done) >= len(tuned.pilots)
    first, _, *rows = str(tuned).splitlines()
    assert first == tuned.reason
    assert len(rows) == len(tuned.pilots)
    assert f"{tuned.parameters['gamma']:.6g}" in repr(tuned)
    assert tuned.pilots[0].label in tuned._repr_html_()
    longer = gs.tune(gl3, TOP, dt=2e-3, gamma="auto", steps=10000, pilot_steps=100)
    assert longer.error in [pilot.motion for pilot in longer.pilots]
    again = pickle.loads(pickle.dumps(tuned))
    assert (again.parameters, str(again)) == (tuned.parameters, str(tuned))


@pytest.mark.parametrize("rule", ["m", "h", "mt", "ht"])
def test_means_are_rules_too(gl3, rule):
    tuned = gs.tune(gl3, TOP, dt=1e-3, gamma=rule)
    assert tuned.parameters == {"gamma": gs.gamma(TOP.inertia, rule)}
    assert tuned.pilots == ()


def test_arrays_and_merged_parameters_are_starts(gl3):
    options = {"dt": 2e-3, "gamma": "auto", "pilot_steps": 50}
    by_start, by_arrays = gs.tune(gl3, TOP, **options), gs.tune(gl3, TOP.q0, TOP.p0, **options,
                                                                parameters=TOP.parameters)
    assert by_start.parameters == by_arrays.parameters
    heavier = gs.tune(gl3, TOP, **options, parameters={"I1": 0.003, "I2": 0.003})
    assert heavier.pilots[0].parameters["gamma"] == gs.gamma((0.003, 0.003, TOP.inertia[2]))


def test_the_search_of_a_model_is_made_by_its_runs():
    """``gamma = "auto"`` of a file is the same search; a number among parameters wins."""
    step = systems.stepper("heavy_top")
    start = TOP.start.of_model({"gamma": TOP.inertia}, {"gamma": "auto"})
    tuned = gs.tune(step, TOP, dt=2e-3, steps=40, gamma="auto")
    run = step.integrate(start, dt=2e-3, steps=40)
    assert run.parameters["gamma"] == tuned.parameters["gamma"] != MEAN
    fixed = step.integrate(start, dt=2e-3, steps=40, parameters={"gamma": MEAN})
    assert fixed.parameters["gamma"] == MEAN
    simulation = step.start(start, dt=2e-3)
    longer = gs.tune(step, TOP, dt=2e-3, gamma="auto")
    assert simulation.parameters["gamma"] == longer.parameters["gamma"]
    for refusing in (lambda: step.step(start, dt=2e-3),
                     lambda: step.integrate_ensemble([start, start], dt=2e-3, steps=3)):
        with refused("gamma.*tune"):
            refusing()


def test_aims_of_bodies_agree():
    step, model = systems.stepper("double_top"), systems.case("double_top").system
    rules = {"a_gamma": "auto", "b_gamma": "auto-energy"}
    start = gs.Start(model.q0, model.p0, {name: x for name, x in model.parameters.items()
                                          if name not in rules}).of_model(model.bodies, rules)
    with refused("auto and for auto-energy"):
        step.integrate(start, dt=1e-3, steps=3)


@pytest.mark.parametrize("word", ["auto", "m"])
def test_text_among_parameters_is_refused(gl3, word):
    for call in (lambda parameters: gl3.integrate(TOP, dt=1e-3, steps=3, parameters=parameters),
                 lambda parameters: gl3.step(TOP, dt=1e-3, parameters=parameters),
                 lambda parameters: gl3.integrate_ensemble([TOP, TOP], dt=1e-3, steps=3,
                                                           parameters=parameters)):
        with refused(rf"gamma = '{word}'.*gamma\(.*tune"):
            call({"gamma": word})
        with refused(rf"frame = '{word}'.*tune"):
            call({"frame": word})


@pytest.mark.parametrize(("changes", "message"), [
    ({}, "gamma='auto'"), ({"gamma": "auto", "dt": None}, "dt"),
    ({"gamma": "fast"}, "'fast'"), ({"gamma": "auto", "aim": "speed"}, "motion or energy"),
    ({"gamma": "h", "aim": "energy"}, "aim = 'energy'"), ({"gamma": "auto", "dt": 0}, "dt = 0"),
    ({"gamma": "auto", "pilot_steps": 1}, "at least 8"), ({"frame": "auto"}, "co-moving"),
    ({"gamma": "auto", "parameters": {"gamma": 1e-3}}, "no gamma"),
    ({"gamma": "auto", "steps": -1}, "at least 0"),
    ({"gamma": "auto", "parameters": {"I1": "big"}}, "'big'"),
])
def test_wrong_use_is_refused(gl3, changes, message):
    with refused(message):
        gs.tune(gl3, TOP, **{"dt": 1e-3} | changes)


def test_rates_are_given_or_searched():
    with refused("omega_body.*frame = 'auto'"):
        gs.tune(framed(), TOP, dt=1e-3, frame="auto", parameters={"omega_body": 1.0})
    with refused("no gamma"):
        gs.tune(systems.stepper("pendulum"), [1.0, 0.0], [0.0, 0.0], dt=1e-3, gamma="auto",
                parameters=systems.case("pendulum").parameters)


def test_a_frame_is_chosen_with_the_inputs_of_the_run():
    from framed_point import PENDULUM, framed_point

    step, numbers = framed_point(), {name: PENDULUM[name] for name in "kac"}
    start = gs.Start([0.6, 0.0, -0.8], [0.0, 0.7, 0.0], numbers)
    name = step.symmetries[0].name
    rates = [gs.tune(step, start, dt=0.1, steps=60, frame="auto", inputs={"u": u}).parameters[name]
             for u in (0.0, -2.0)]
    assert rates[0] != rates[1]
    constant = gs.tune(step, start, dt=0.1, steps=60, frame="auto", parameters={"u": -2.0})
    assert constant.parameters[name] == rates[1]
    rows = np.full(60, -2.0)
    assert gs.tune(step, start, dt=0.1, steps=60, frame="auto",
                   inputs={"u": rows}).parameters[name] == rates[1]
