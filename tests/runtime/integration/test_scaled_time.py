"""Runs in scaled time: times asked for, derivatives, energy, refused calls, orders.

Orders are of errors beside motions by a second way: other coordinates, equations without
constraints, 40 digits (``helpers/scaled_motions.py``).
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from fractions import Fraction
from functools import partial

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import scaled_motions
import systems
from gyrospark.core.registry import SYSTEMS
from gyrospark.interop.discrete_flow import DiscreteFlow
from gyrospark.runtime.results.joint_motion import multipliers_at_states
from systems import case, differentiable, stepper, timed_start

EPS = np.finfo(float).eps
x, y, u, v, t = sp.symbols("x y u v t", real=True)
SCALED = ["eccentric", "scaled_pendulum", "tethered_pair"]


def arguments(name, **changes):
    entry = case(name)
    return {"parameters": entry.parameters} | entry.step | changes


def to(name, t_end, step=None, **changes):
    step = step or stepper(name)
    return step.integrate(timed_start(name, step), t_end=t_end, **arguments(name, **changes))


# ---------------------------------------------------------------- energy, steps


@pytest.mark.parametrize(("stages", "dtau"), [
    (2, 0.2), *(pytest.param(*row, marks=pytest.mark.slow) for row in (
        (1, 0.02), (3, 0.4), (4, 0.6)))])
def test_the_energy_error_is_of_the_order_of_the_steps(stages, dtau):
    """H + e is 0 in the motion; it is never projected to 0, and does not drift."""
    step = stepper("eccentric", "G-L", stages)
    errors = []
    for size in (dtau, dtau / 2):
        run = step.integrate(timed_start("eccentric", step), steps=round(40 / size),
                             parameters={"k": 1.0}, dtau=size)
        assert np.array_equal(run.time_momentum, np.full(len(run), 0.5))
        assert np.abs(run.energies + 0.5).max() == pytest.approx(
            run.report.energy_error_max, rel=1e-6)
        errors.append(run.report.energy_error_max)
    assert abs(np.log2(errors[0] / errors[1]) - 2 * stages) < 0.6


def test_the_largest_energy_error_may_be_the_error_at_t_end():
    """(u² + v²)/2 − 1/r of the rows, whose error is largest in the last one."""
    step, numbers = stepper("eccentric"), arguments("eccentric")
    start = timed_start("eccentric", step)
    for run in (step.integrate(start, t_end=start.t + 0.1, **numbers),
                step.integrate(start, t_end=start.t + 0.1, events=gs.Event("x"), **numbers),
                step.integrate_ensemble([start], t_end=start.t + 0.1, **numbers).members[0]):
        H = (run.p**2).sum(axis=1) / 2 - 1 / np.hypot(*run.q.T)
        errors = abs(H - H[0])
        assert errors[-1] > 1.001 * errors[:-1].max()
        # round-off of two terms of up to 1/r at the pericentre
        assert run.report.energy_error_max == pytest.approx(
            errors[-1], abs=8 * EPS / np.hypot(*run.q.T).min())
        assert run.report.q == tuple(run.q[-1])
        assert run.report.p == tuple(run.p[-1])


def test_multipliers_at_states_are_those_of_time():
    """The rod of two masses with H = Σ p² − ½ Σ k/r has 8 l² λ = |ḋ|² − k d·(x₂/r₂³ − x₁/r₁³).

    Errors are of Δτ²; scales of the other end of a step would be off by Δτ.
    """
    run = to("tethered_pair", 2.0, dtau=0.02)
    x, p = (z[:, :4].reshape(-1, 2, 2) for z in (run.q, run.p))
    d, rate = x[:, 1] - x[:, 0], 2 * (p[:, 1] - p[:, 0])
    pull = x / np.linalg.norm(x, axis=2, keepdims=True) ** 3
    exact = ((rate**2).sum(1) - (d * (pull[:, 1] - pull[:, 0])).sum(1)) / (8 * (d**2).sum(1))
    states = multipliers_at_states(run)[:, 0]
    assert np.abs(states - exact).max() < 1e-3 * np.abs(exact).max()


def test_steps_of_time_are_those_of_the_scale():
    run = systems.run("eccentric", stepper("eccentric"), 80)
    steps = np.diff(run.t)
    assert run.report.time_step_min == pytest.approx(steps.min(), rel=1e-12)
    assert run.report.time_step_max == pytest.approx(steps.max(), rel=1e-12)
    assert steps.max() > 6 * steps.min()  # ((1 + e) / (1 − e))^(3/2) is 8
    assert np.allclose(run.tau, 0.1 * np.arange(81), rtol=1e-14)
    middle = np.sqrt(run.time_steps[1:] * run.time_steps[:-1])
    assert np.abs(steps / middle - 1).max() < 0.01


@pytest.mark.parametrize(("power", "dtau", "t_end", "warns"), [
    (1.5, 0.05, 7, False), (-1, 0.05, 7, True), (1.5, 0.2, 2, False), (-1, 0.15, 2, True)])
def test_a_scale_that_misses_the_fast_part_is_warned_of(power, dtau, t_end, warns):
    """With σ = 1/r steps are longest at the pericentre, longer than as many constant ones.

    The short runs have a dozen rows.
    """
    step = stepper("eccentric") if not warns else gs.stepper(
        "G-L", 2, system=case("eccentric").system.with_time_scale((x**2 + y**2) ** (power / 2)))
    start = timed_start("eccentric", stepper("eccentric"))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        span = {"dtau": dtau, "t_end": t_end, "parameters": {"k": 1.0}}
        run = step.integrate(start, **span)
        step.integrate_ensemble([start] * 3, **span)  # one warning for all
    assert t_end == 7 or 12 < len(run) < 30
    assert [warning.category for warning in caught] == [gs.errors.InputWarning] * 2 * warns


def test_a_rotation_is_measured_by_steps_of_time():
    """With σ = 1/20 a step of 2.1 rad in τ is one of 0.1 rad, of which no ensemble warns."""
    entry = case("heavy_top")
    slowed = gs.stepper("G-L", 1, system=SYSTEMS["heavy_top"].make("gamma").with_time_scale(
        sp.Rational(1, 20)))
    pair = [[x] * 2 for x in (entry.q, entry.p)]
    with warnings.catch_warnings():
        warnings.simplefilter("error", gs.errors.InputWarning)
        slowed.integrate_ensemble(*pair, dtau=1 / 60, steps=4, parameters=entry.parameters)
        slowed.start(entry.q, entry.p, dtau=1 / 60, parameters=entry.parameters)
    with pytest.warns(gs.errors.InputWarning, match="rad.*dtau"):
        slowed.integrate_ensemble(*pair, dtau=1 / 3, steps=4, parameters=entry.parameters)
    with pytest.warns(gs.errors.InputWarning, match="rad.*dtau"):
        slowed.start(entry.q, entry.p, dtau=1 / 3, parameters=entry.parameters)


# ---------------------------------------------------------------- times


@pytest.mark.filterwarnings("ignore::gyrospark.core.errors.InputWarning")  # the pendulum's σ, back
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("name", SCALED)
def test_times_are_met(name, direction):
    """``t_end``, ``t_eval``, ``at`` and events lead to the same state at a time, to round-off."""
    entry, step = case(name), stepper(name)
    t_end, dtau = entry.t0 + direction * 0.9, direction * entry.dt
    run = to(name, t_end, dtau=dtau)
    assert run.t[-1] == t_end
    assert not run.events
    times = entry.t0 + direction * np.array([0.0, 0.31, 0.3, 0.9])
    between = run.at(times)
    assert np.array_equal(between.t, times)
    evaluated = to(name, t_end, dtau=dtau, t_eval=times)
    size = np.abs(run.q).max() + np.abs(run.p).max()
    for states in (between, evaluated):
        assert np.array_equal(states.q[0], run.q[0])
        assert np.abs(states.q[-1] - run.q[-1]).max() <= 1e3 * EPS * size
    assert np.array_equal(between.q, evaluated.q)
    thinned = to(name, t_end, dtau=dtau, every=3).at(times)
    assert np.abs(thinned.q - between.q).max() <= 1e3 * EPS * size
    event = gs.Event(step.manifest.system.clock.time, level=times[1], name="at")
    crossing = to(name, t_end, dtau=dtau, events=event).events["at"]
    located = to(name, t_end, dtau=dtau, events=event)
    assert located.events.keys() == {"at"}
    same = to(name, t_end, dtau=dtau, events=replace(event, name="t_end"))  # the end's own name
    assert np.array_equal(same.events["t_end"].t, crossing.t)
    assert np.array_equal(same.q, located.q)
    for kind in ("t", "tau", "q", "p", "work"):  # its end is located among the events
        assert np.abs(getattr(located, kind)[-1] - getattr(run, kind)[-1]).max() <= 1e3 * EPS * size
    assert np.abs(located.multipliers[-1] - run.multipliers[-1]).max(initial=0) <= 1e6 * EPS * size
    assert np.abs(crossing.t - times[1]).max() <= 8 * EPS * (1 + abs(times[1]))
    assert np.abs(crossing.q[0] - between.q[1]).max() <= 1e3 * EPS * size


@pytest.mark.parametrize(("dtau", "t_end", "every", "real", "round_off"), [
    (0.8, 1.0, 1, "double", EPS), (-0.8, -3.3, 2, "double", EPS), (0.3, 1e-3, 1, "double", EPS),
    (0.1, 3.0, 7, "double", EPS),
    pytest.param(0.8, 1.0, 1, "float128", 2.0**-112, marks=pytest.mark.slow)])  # a stepper
def test_the_end_of_steps_of_any_length_is_that_among_events(dtau, t_end, every, real, round_off):
    step, event = stepper("eccentric", real=real), gs.Event("t", level=99.0)
    alone, with_event = (to("eccentric", t_end, step, dtau=dtau, every=every, **options)
                         for options in ({}, {"events": event}))
    assert alone.t[-1] == with_event.t[-1] == t_end
    assert len(alone) == len(with_event)
    for kind in ("tau", "q", "p"):
        ends = (getattr(run, kind)[-1:] for run in (alone, with_event))
        assert np.abs(np.subtract(*ends)).max() <= 30 * round_off


@pytest.mark.parametrize(("real", "round_off"), [("float", 1e-4), ("float128", 1e-28)])
def test_states_between_steps_and_gradients_have_the_digits_of_the_stepper(real, round_off):
    """The end of a run, cotangents of another type: beside a run that ends there, and tangents."""
    step = differentiable("eccentric", real=real)
    run = to("eccentric", 3.3, step, dtau=0.2)
    assert np.abs(run.at([3.3]).q[0] - run.q[-1]).max() <= round_off
    early = to("eccentric", 1.3, step, dtau=0.2)
    assert np.abs(run.at([1.3]).q[0] - early.q[-1]).max() <= round_off
    along = to("eccentric", 3.3, step, dtau=0.2, tangents=gs.Tangents()).tangents.q[-1, 0]
    for one in (1.0, Fraction(1), mp.mpf(1)):  # mpmath's own numbers have 53 bits
        start = run.gradient({"q": [one, 0]}).start
        assert np.abs(start - along).max() <= round_off * np.abs(along).max()


@pytest.mark.slow  # a module for this
def test_tangents_of_a_short_rod_are_found_between_steps():
    """The round-off of G H_p is the one of coordinates, which are six times the rod."""
    name = "tethered_pair"
    step = differentiable(name)
    run = step.integrate(timed_start(name, step), t_end=0.9, tangents=gs.Tangents(start="all"),
                         **arguments(name))
    between = run.at(np.linspace(0.03, 0.88, 60))
    for kind in ("q", "p"):
        assert np.isfinite(getattr(between.tangents, kind)).all()


def test_a_long_run_to_a_time_grows_its_arrays():
    run = to("eccentric", 200.0)
    assert len(run) > 2000
    assert len(run) == run.report.steps + 2  # the start and the part of a step that ends it
    assert run.t[-1] == 200.0


# ---------------------------------------------------------------- derivatives


@pytest.mark.parametrize("name", [
    pytest.param("eccentric", marks=pytest.mark.slow), "scaled_pendulum"])
def test_gradients_at_a_time_are_differences(name):
    """At the start de = −dH, which depends on parameters and on the start."""
    entry, step = case(name), differentiable(name)
    t_end = entry.t0 + 0.9
    begin = timed_start(name, step)
    run = step.integrate(begin, t_end=t_end, **arguments(name))
    w = np.linspace(0.3, 1.1, step.n)
    cotangents = {"q": np.zeros_like(run.q), "p": np.zeros_like(run.p)}
    cotangents["q"][-1], cotangents["p"][-1] = w, 1 - w
    gradient = run.gradient(cotangents, wrt=["start", *entry.parameters])
    backwards = run.gradient(cotangents, wrt=["start", *entry.parameters], memory="none")
    assert backwards.vector() == pytest.approx(gradient.vector(), rel=1e-10)
    tangents = step.integrate(begin, t_end=t_end, tangents=gs.Tangents(
        start="all", parameters=[*entry.parameters]), **arguments(name)).tangents
    assert not tangents.events

    def value(q, p, **parameters):
        end = step.integrate(gs.Start(q, p, t=entry.t0), t_end=t_end, dtau=entry.dt,
                             parameters=entry.parameters | parameters)
        return w @ end.q[-1] + (1 - w) @ end.p[-1]

    def slope(function):
        h = 1e-3
        coarse, fine = ((function(s) - function(-s)) / (2 * s) for s in (h, h / 2))
        return (4 * fine - coarse) / 3

    q, p = begin.q, begin.p
    ends = w @ tangents.q[-1] + (1 - w) @ tangents.p[-1]
    for parameter in {"k", "g"} & {*entry.parameters}:  # others move the constraints
        number = entry.parameters[parameter]
        expected = slope(
            lambda s: value(q, p, **{parameter: number + s}))  # noqa: B023 - called here
        assert abs(gradient[parameter] - expected) < 1e-7 * (1 + abs(expected))
        assert abs(ends[tangents.names.index(parameter)] - expected) < 1e-7 * (1 + abs(expected))
    for k, name in enumerate(tangents.names):
        if name.startswith("start"):
            dz = tangents.start[:, k]
            along = gradient.q @ dz[: step.n] + gradient.p @ dz[step.n :]
            assert abs(along - ends[k]) < 1e-11 * (1 + abs(along))
            if not step.m:
                expected = slope(lambda s: value(q + s * dz[: step.n],  # noqa: B023 - called here
                                                 p + s * dz[step.n :]))  # noqa: B023
                assert abs(along - expected) < 1e-7 * (1 + abs(expected))


@pytest.mark.parametrize(("stages", "dtau", "times"), [
    (2, 0.01, [0.0, 0.4, 0.9, 1.3, 1.7]),
    pytest.param(4, 0.1, [0.0, 0.4, 0.9, 1.7, 2.2, 3.1, 4.6, 5.9, 6.1, 6.6],
                 marks=pytest.mark.slow)])  # derivatives of a stepper of four stages
def test_a_fit_has_the_parameter_and_the_start_of_its_data(stages, dtau, times):
    """Samples are at any times, the first at the start; the closed form has k = 1."""
    entry, step = case("eccentric"), differentiable("eccentric", stages=stages)
    data = np.array([entry.exact(time) for time in times])
    begin = timed_start("eccentric", step).replace(parameters={"k": 1.02})
    fit = gs.fit(step, begin, times, data, dtau=dtau, observe=["x", "y"])
    assert fit.converged
    assert fit.rms < 1e-8
    assert abs(fit.parameters["k"] - 1) < 1e-8
    assert np.abs(fit.q - entry.q).max() < 1e-8
    assert np.abs(fit.p - entry.p).max() < 1e-8
    for options, words in (({}, ["dtau"]), ({"dt": 0.1}, ["dt = 0.1", "dtau"])):
        with pytest.raises(gs.InputError) as caught:
            gs.fit(step, begin, times, data, observe=["x", "y"], **options)
        assert all(word in str(caught.value) for word in words)
    with pytest.raises(gs.InputError, match="dtau"):
        gs.fit(stepper("kepler"), timed_start("kepler", stepper("kepler")), [0.5, 1.0],
               np.ones((2, 2)), dtau=0.1, observe=["q"])


@pytest.mark.parametrize("name", SCALED)
def test_cells_of_a_sweep_are_runs(name):
    """Cells have the states, times, samples, first events and errors of runs."""
    entry, step = case(name), stepper(name)
    begin = step.project(entry.q, entry.p, parameters=entry.parameters)  # sweeps start at t = 0
    model = gs.Model(entry.system, entry.parameters, *begin)
    parameter = next(iter(entry.parameters))
    values = [entry.parameters[parameter] * factor for factor in (1.0, 1.1)]
    event = gs.Event(step.manifest.system.coordinates[0], level=0.25, name="crossing")
    over = {"dtau": [entry.dt, entry.dt / 2]}
    with_events = gs.sweep(model, over | {parameter: values}, scheme="G-L", stages=2, steps=20,
                           every=5, events=event)
    plain = gs.sweep(model, over | {parameter: values}, scheme="G-L", stages=2, steps=20, every=5)
    for variable in plain.variables:
        assert np.array_equal(plain[variable], with_events[variable]), variable
    for i, dtau in enumerate(over["dtau"]):
        for j, value in enumerate(values):
            parameters = entry.parameters | {parameter: value}
            q, p = step.project(*begin, parameters=parameters)
            run = step.integrate(q, p, dtau=dtau, steps=20, every=5, parameters=parameters,
                                 events=event)
            close = 1e4 * EPS * (1 + np.abs(run.p).max())
            cell = with_events.isel(dtau=i, **{parameter: j})
            assert abs(float(cell.t) - run.t[-1]) <= close
            assert np.abs(cell.q_samples - run.q).max() <= close
            assert np.abs(cell.p - run.p[-1]).max() <= close
            assert np.abs(cell.t_samples - run.t).max() <= close
            assert abs(float(cell.energy_error_max) - run.report.energy_error_max) <= close
            crossings = run.events["crossing"]
            assert float(cell.event_crossing_count) == len(crossings)
            if len(crossings):
                assert abs(float(cell.event_crossing_first) - crossings.t[0]) <= close


def test_a_cell_whose_time_stops_is_nan_with_its_reason():
    system = gs.System([x], [u], (), u, name="drift", time_scale=1 - 4 * x)
    model = gs.Model(system, {}, [0.0], [0.3])
    with pytest.warns(gs.errors.InputWarning, match="1 of 2"):
        dataset = gs.sweep(model, {"dtau": [0.1, 1.0]}, scheme="G-L", stages=2, steps=3)
    assert dataset.status.values.tolist() == [0, 7]
    assert np.isnan(dataset.t.values).tolist() == [False, True]


# ---------------------------------------------------------------- failures


@pytest.mark.parametrize(("scheme", "stages", "done"), [
    ("G-L", 2, 0), pytest.param("IMS", None, 1, marks=pytest.mark.slow)])  # a stepper
def test_a_scale_that_is_not_positive_is_refused_where_it_is_met(scheme, stages, done):
    """x' = 1 with σ = 1 − 4x has long steps over x = 1/4, where t stops."""
    step = gs.stepper(scheme, stages, system=gs.System([x], [u], (), u, name="drift",
                                                       time_scale=1 - 4 * x))
    with pytest.raises(gs.InputError, match="-1"):
        step.integrate(gs.Start([0.5], [0.3]), dtau=0.1, steps=3)
    start = gs.Start([0.0], [0.3])
    for solver in ("auto", "newton"):
        with pytest.raises(gs.StepFailed) as caught:
            step.integrate(start, dtau=1.0, steps=3, solver=solver)
        assert caught.value.reason == "time stopped"
        assert caught.value.step == done + 1
        assert caught.value.trajectory.t[-1] == caught.value.t
    ensemble = step.integrate_ensemble([start] * 3, dtau=[0.1, 1.0, 0.1], steps=3)
    assert {i: failure.reason for i, failure in ensemble.failures.items()} == {1: "time stopped"}
    assert np.isfinite(ensemble.q[[0, 2]]).all()


# ---------------------------------------------------------------- refused


def other_calls(step, start, run):
    d = 0.1
    model = gs.Model(case("eccentric").system, {"k": 1.0}, start.q, start.p)
    ones = np.ones(2)
    return {
        "step": lambda: step.step(start, dt=d),
        "jvp": lambda: step.jvp(start, ones, ones, dt=d),
        "vjp": lambda: step.vjp(start, dt=d),
        "hvp": lambda: step.hvp(start, ones, ones, ones, ones, dt=d),
        "hessian": lambda: run.hessian({"q": np.ones_like(run.q)}),
        "value_and_gradient": lambda: step.value_and_gradient(
            lambda run: run.q.sum(), start, wrt=["start"], dt=d, steps=3),
        "accelerations": lambda: step.accelerations(start),
        "mass_matrix": lambda: step.mass_matrix(start),
        "lyapunov": lambda: gs.lyapunov(step, start, dt=d, steps=10),
        "periodic_orbit": lambda: gs.periodic_orbit(step, start, dt=d, steps=10),
        "flow": lambda: DiscreteFlow(step, 3),
        "build": lambda: gs.build("cpp", model, scheme="G-L", stages=2),
        "splitting": lambda: gs.stepper(order=4, system=model.system),
    }


@pytest.mark.parametrize("call", other_calls(None, gs.Start([0.4, 0], [0, 2]), None))
def test_what_is_not_derived_is_refused_with_a_way_out(call):
    step = stepper("eccentric")
    start = gs.Start([0.4, 0.0], [0.0, 2.0], {"k": 1.0})
    run = step.integrate(start, steps=3, dtau=0.1)
    with pytest.raises(gs.InputError) as caught:
        other_calls(step, start, run)[call]()
    assert "time_scale" in str(caught.value)


@pytest.mark.parametrize("name", ["eccentric", "kepler"])
def test_calls_that_take_steps_of_t_alone_say_so(name):
    step = stepper(name)
    start = timed_start(name, step)
    for call in (step.step, step.jvp, step.vjp, step.hvp, step.value_and_gradient,
                 partial(gs.lyapunov, step), partial(gs.periodic_orbit, step)):
        with pytest.raises(gs.InputError, match=r"'dtau'.*dt=.*integrate\(.*time_scale") as caught:
            call(start, dtau=0.1)
        assert "mean dt" not in str(caught.value)


@pytest.mark.parametrize(("keywords", "words"), [
    ({"dt": 0.1, "steps": 3}, ["0.1", "dtau"]),
    ({"dt": 0.1, "dtau": 0.1, "steps": 3}, ["dt = 0.1", "dtau"]),
    ({"steps": 3}, ["dtau"]),
    ({"dtau": 0, "steps": 3}, ["dtau = 0", "positive"]),
    ({"dtau": "a", "steps": 3}, ["dtau = 'a'"]),
    ({"dtau": 0.1, "t_end": -1}, ["t_end = -1", "after"]),
    ({"dtau": 0.1, "t_end": 1, "steps": 3}, ["steps", "t_end"]),
    ({"dtau": 0.1, "steps": 3, "t_eval": [99.0]}, ["99.0"]),
    ({"dtau": 0.1, "t_end": 1, "out": "here.zarr"}, ["steps"]),
    ({"over": {"k": [1.0, 2.0]}, "dt": 0.1, "steps": 3}, ["dt = 0.1", "dtau"]),
    ({"over": {"k": [1.0, 2.0]}, "steps": 3}, ["dtau"]),
    ({"over": {"dt": [0.1, 0.2]}, "dtau": 0.1, "steps": 3}, ["dt", "dtau"]),
    ({"over": {"dtau": [0.1, 0.0]}, "steps": 3}, ["dtau = 0"]),
    ({"over": {"k": [1.0, 2.0]}, "dtau": 0.1, "t_end": 1.0}, ["t_end", "steps"]),
])
def test_other_steps_and_ends_are_refused(keywords, words, tmp_path, monkeypatch):
    """Calls with ``over`` are sweeps, the others runs."""
    monkeypatch.chdir(tmp_path)
    step, entry = stepper("eccentric"), case("eccentric")
    model = gs.Model(entry.system, entry.parameters, entry.q, entry.p)
    call, begin = (gs.sweep, (model,)) if "over" in keywords else (
        step.integrate, (timed_start("eccentric", step),))
    options = {"scheme": "G-L", "stages": 2} if "over" in keywords else {"parameters": {"k": 1.0}}
    with pytest.raises(gs.InputError) as caught:
        call(*begin, **options, **keywords)
    assert all(word in str(caught.value) for word in words), caught.value
    with pytest.raises(gs.InputError, match="dtau"):
        stepper("kepler").integrate(timed_start("kepler", stepper("kepler")), dtau=0.1, steps=3)


def test_a_simulation_in_scaled_time_keeps_parameters_and_counts_no_times():
    step = stepper("eccentric")
    sim = step.start(timed_start("eccentric", step), **arguments("eccentric"))
    sim.advance(4)
    assert sim.t == systems.run("eccentric", step, 4).t[-1]
    with pytest.raises(gs.InputError, match="t_end"):
        sim.advance_to(1.0)
    with pytest.raises(gs.InputError, match=r"step\.start"):
        sim.parameters = {"k": 2.0}


@pytest.mark.parametrize(("name", "every"), [("eccentric", 1), ("tethered_pair", 3)])
def test_trajectories_of_an_ensemble_end_at_a_time(name, every):
    """Members have the bits of single runs, and NaN behind their ends, at different steps."""
    entry, step = case(name), (differentiable if name == "eccentric" else stepper)(name)
    starts = [timed_start(name, step)] * 3
    dtau, t_end = entry.dt * np.array([1.0, 0.5, 0.7]), entry.t0 + 0.9
    event = gs.Event(step.manifest.system.coordinates[0], level=0.25, name="crossing")
    options = {"parameters": entry.parameters, "t_end": t_end, "events": event, "every": every,
               "tangents": gs.Tangents(start="all") if name == "eccentric" else None}
    ensemble = step.integrate_ensemble(starts, dtau=dtau, **options)
    runs = [step.integrate(start, dtau=size, **options)
            for start, size in zip(starts, dtau, strict=True)]
    assert ensemble.t.shape == (3, max(map(len, runs)))
    for i, run in enumerate(runs):
        assert ensemble.members[i].t[-1] == t_end
        assert np.array_equal(ensemble.members[i].q, run.q)
        assert np.array_equal(ensemble.t[i, : len(run)], run.t)
        assert np.array_equal(ensemble.q[i, : len(run)], run.q)
        assert np.isnan(ensemble.q[i, len(run) :]).all()
        assert ensemble.members[i].events.keys() == {"crossing"}
        assert np.array_equal(ensemble.events["crossing"][i].t, run.events["crossing"].t)
        assert run.tangents is None or np.array_equal(ensemble.tangents[i].q, run.tangents.q)
    assert np.array_equal(ensemble.members[0].at([t_end / 2]).q, runs[0].at([t_end / 2]).q)


def test_ends_of_ensembles_are_refused_and_fail_one_by_one():
    step, start = stepper("eccentric"), timed_start("eccentric", stepper("eccentric"))
    with pytest.raises(gs.InputError, match="t_end = -1"):
        step.integrate_ensemble([start] * 2, dtau=0.1, t_end=-1.0, parameters={"k": 1.0})
    drift = gs.stepper("G-L", 2, system=gs.System([x], [u], (), u, name="drift",
                                                  time_scale=1 - 4 * x))
    ensemble = drift.integrate_ensemble([gs.Start([0.0], [0.3])] * 3, dtau=[0.01, 1.0, 0.01],
                                        t_end=0.1)
    assert {i: failure.reason for i, failure in ensemble.failures.items()} == {1: "time stopped"}
    assert [member.t[-1] for member in ensemble.members] == [0.1, 0.0, 0.1]


@pytest.mark.parametrize("span", [{"steps": 534}, {"t_end": 20.0}])
def test_a_section_takes_steps_of_scaled_time(span):
    """The orbit crosses the axis once a period, at its pericentre, where it began."""
    step, start = stepper("eccentric"), timed_start("eccentric", stepper("eccentric"))
    event = gs.Event("y", direction=1)
    section = gs.section(step, start, event=event, dtau=0.03, parameters={"k": 1.0}, **span)
    expected = 2 * np.pi * np.arange(1, len(section.t) + 1)
    assert len(section.t) > 1
    assert np.abs(section.t - expected).max() < 1e-7
    assert np.abs(section.q - [0.4, 0]).max() < 1e-7
    with pytest.raises(gs.InputError, match="dtau"):
        gs.section(step, start, event=event, dt=0.2, parameters={"k": 1.0}, **span)


def test_points_of_a_section_know_their_time_and_the_energy_of_their_start():
    """Points have a quantity of q and t; one start has an H + e that is an earlier run's error."""
    step, numbers = stepper("scaled_pendulum"), case("scaled_pendulum")
    start = timed_start("scaled_pendulum", step).replace(parameters=numbers.parameters)
    event, span = gs.Event("x", direction=1), {"dtau": numbers.dt, "steps": 200}
    later = step.integrate(start, dtau=numbers.dt, steps=20)[-1]
    points = gs.section(step, [start, later], event=event, **span)
    alone = [step.integrate(begin, events=event, **span).events["x"].t for begin in (start, later)]
    assert np.abs(points.t - np.concatenate(alone)).max() < 1e-11
    along = points.values("x") * np.cos(points.t) + points.values("y")
    assert np.abs(points.values("along") - along).max() < 1e-15


def test_runs_to_one_time_are_complete_whatever_their_steps():
    step, numbers = stepper("scaled_pendulum"), case("scaled_pendulum")
    start = timed_start("scaled_pendulum", step).replace(parameters=numbers.parameters)
    slower = step.consistent(start.q, start.p / 2 + 0.1, parameters=numbers.parameters, t=start.t)
    slower = gs.Start(slower.q, slower.p, numbers.parameters, start.t)
    ensemble = step.integrate_ensemble([start, slower], dtau=numbers.dt, t_end=start.t + 20)
    assert len({*map(len, ensemble.members)}) == 2
    assert (ensemble.dataset().status == "complete").all()


#: Δτ of one stage to six at which errors begin to follow their order, and are not yet round-off.
STEPS = {
    "eccentric": (0.02, 0.1, 0.4, 0.6, 0.8, 1.0),
    "very_eccentric": (0.02, 0.1, 0.4, 0.6, 0.8, 1.0),
    "tethered_pair": (0.02, 0.05, 0.1, 0.1, 0.12, 0.15),
    "scaled_pendulum": (0.05, 0.1, 0.15, 0.12, 0.16, 0.2),
    "eccentric_satellite": (0.02, 0.1, 0.2, 0.2, 0.3, 0.45),
}
_QUICK = {(name, 2) for name in STEPS if name != "eccentric_satellite"}


def errors(name, scheme, stages, real="double", count=3):
    """Return the largest errors of q and p at the end, in parts of the largest; Δτ falls by 1.5."""
    step = systems.stepper(name, scheme, stages, real)
    motion, (start, end) = scaled_motions.MOTIONS[name], scaled_motions.states(name)
    begin = gs.Start(*start.reshape(2, step.n), t=np.longdouble(motion.t0))
    runs = [step.integrate(begin, dtau=STEPS[name][stages - 1] / 1.5**k,
                           t_end=np.longdouble(motion.t_end),
                           parameters=systems.case(name).parameters) for k in range(count)]
    assert all(run.report.constraint_max < 64 * np.finfo(run.q.dtype).eps for run in runs)
    return np.array([np.abs(np.concatenate([run.q[-1], run.p[-1]]) - end).max()
                     for run in runs]) / np.abs(end).max()


def slope(errors):
    """Return the mean slope: with many stages, single ones scatter where the error is near zero."""
    return np.log(errors[0] / errors[-1]) / np.log(1.5) / (len(errors) - 1)


@pytest.mark.parametrize(("name", "stages"), [
    pytest.param(name, stages, marks=[] if (name, stages) in _QUICK else pytest.mark.slow)
    for name in STEPS for stages in (1, 2)])
def test_one_stage_has_order_2_and_two_have_4(name, stages):
    assert abs(slope(errors(name, "G-L", stages)) - 2 * stages) < 0.15


@pytest.mark.slow  # twenty steppers in long double, for errors below the round-off of doubles
@pytest.mark.parametrize("stages", [3, 4, 5, 6])
@pytest.mark.parametrize("name", STEPS)
def test_more_stages_have_twice_their_number_as_order(name, stages):
    """A symmetric method has an even order: 0.7 tells it from the next ones."""
    assert abs(slope(errors(name, "G-L", stages, "long-double", 4)) - 2 * stages) < 0.7


@pytest.mark.slow  # twelve steppers
@pytest.mark.parametrize("stages", [2, 3])
@pytest.mark.parametrize("name", STEPS)
def test_lobatto_steps_have_order_2s_less_2(name, stages):
    assert abs(slope(errors(name, "LIIIA-B", stages, "long-double", 4)) - 2 * (stages - 1)) < 0.4


@pytest.mark.slow  # 40 digits in Python
@pytest.mark.parametrize("name", STEPS)
def test_stored_motions_are_those_of_their_equations(name):
    computed = np.array([[np.longdouble(x) for x in numbers]
                         for numbers in scaled_motions.digits(name)])
    assert np.abs(computed - scaled_motions.states(name)).max() < 1e-18


@pytest.mark.slow  # a million steps
@pytest.mark.parametrize("name", ["very_eccentric", "tethered_pair"])
def test_the_energy_error_is_bounded_over_a_million_steps(name):
    """H + e does not drift: its largest in each tenth is the same; e and J are constant."""
    step = systems.stepper(name)
    run = systems.run(name, step, 10**6, every=100, dtau=0.1)
    tenths = np.abs(run.energies + run.time_momentum)[1:].reshape(10, -1).max(axis=1)
    assert tenths.max() < 1.02 * tenths.min()
    assert np.ptp(run.time_momentum) == 0
    half = run.q.shape[1] // 2
    J = sum(run.q[:, i] * run.p[:, i + 1] - run.q[:, i + 1] * run.p[:, i]
            for i in range(0, 2 * half, 2))
    assert np.abs(J - J[0]).max() < 1e-11 * np.abs(J[0])
