"""Runs up to a time: full steps, times that would fit, and a last row by a step of a part of Δt."""

from __future__ import annotations

import re
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gyrospark as gs
import systems
from calls import RUN, TOP, refused
from command_line import refused as refused_by_command
from gyrospark.runtime.integration.run_arguments import span_of, step_count
from gyrospark.storage.recorder import Recorder
from stores import Interrupted, assert_same, assert_same_bytes, small_blocks
from strategies import EPS

DT, END = 0.01, 0.104


def in_pairs(first, second):
    """Return the product of two lists; pairs off its diagonal are slow."""
    return [pytest.param(x, y, marks=[pytest.mark.slow] * (i % len(second) != j))
            for i, x in enumerate(first) for j, y in enumerate(second)]


def run(name="pendulum", **options):
    step = systems.stepper(name)
    start = gs.Start(*systems.start(name, step), systems.case(name).parameters)
    full_run = step.integrate(start, dt=DT, steps=11)
    return step, start, full_run, step.integrate(start, dt=DT, t_end=END, **options)


@pytest.mark.parametrize("name", ["pendulum", "heavy_top", "driven_oscillator", "sleigh"])
def test_the_last_row_is_the_state_at_t_end(name):
    step, _, full_run, to_end = run(name)
    assert to_end.t[-1] == END
    assert to_end.report.steps == 10
    assert len(to_end) == 12
    assert np.array_equal(to_end.q[:-1], full_run.q[:-1])
    between = full_run.at([0.0, END])
    for field in ("q", "p", "multipliers", "work"):
        row, exact = (np.asarray(getattr(states, field))[-1] for states in (to_end, between))
        assert np.abs(row - exact).max(initial=0) <= 1e-11 * (
            1 + np.abs(exact).max(initial=0)), field
    assert to_end.report.q == tuple(to_end.q[-1])
    assert step.constraint_names == [] or to_end.g_errors[-1] < 1e-14


@pytest.mark.parametrize("t_end", [0.34, 0.56])
def test_the_largest_error_of_the_energy_may_be_that_of_the_last_row(t_end, tmp_path):
    """(u² + v²)/2 + 9 y less the work, of the rows: its change there is the largest."""
    step, case = systems.stepper("dragged_pendulum"), systems.case("dragged_pendulum")
    start = gs.Start(*systems.start("dragged_pendulum", step), case.parameters, t=0.2)
    plan = {"dt": 0.2, "t_end": t_end}
    runs = [step.integrate(start, **plan), step.integrate(start, **plan, out=tmp_path / "x.zarr"),
            step.integrate_ensemble([start], **plan).members[0]]
    for to_end in runs:
        balance = (to_end.p**2).sum(axis=1) / 2 + 9 * to_end.q[:, 1] - to_end.work
        errors = abs(balance - balance[0])
        assert errors[-1] > 1.001 * errors[:-1].max()
        # round-off of a sum of terms of up to 9
        assert to_end.report.energy_error_max == pytest.approx(errors[-1], abs=8 * 9 * EPS)
    assert runs[0].report == runs[1].report


@pytest.mark.parametrize(("every", "rows"), [(1, 12), (2, 7), (5, 4), (3, 5), (4, 4), (20, 2)])
def test_rows_are_those_of_every_and_the_last(every, rows):
    _, _, full_run, to_end = run(every=every)
    assert len(to_end) == rows
    assert len(to_end.multipliers) == len(to_end.iterations) == rows - 1
    stored = full_run.q[:11:every]
    assert np.array_equal(to_end.q[:-1], stored)
    assert np.abs(to_end.at([0.0123, 0.1017]).q - full_run.at([0.0123, 0.1017]).q).max() < 1e-14


def test_a_longer_run_goes_on_from_the_last_whole_step():
    step, start, full_run, to_end = run(every=3)
    assert np.array_equal(to_end.grid_end.q, full_run.q[10])
    assert to_end.grid_end.t == full_run.t[10]
    later = step.integrate(to_end.grid_end, dt=DT, steps=1)
    assert np.abs(later.q[-1] - full_run.q[-1]).max() < 1e-14
    assert full_run.grid_end.t == full_run.t[-1]
    assert ("part" in repr(to_end), "part" in repr(to_end[:3]), "part" in repr(full_run)) == (
        True, False, False)
    assert to_end[2:].grid_end.t == to_end.grid_end.t
    assert to_end[:3].grid_end.t == to_end.t[2]
    short = step.integrate(start, dt=DT, t_end=0.004)
    assert short.t.tolist() == [0, 0.004]
    assert short.grid_end.t == 0
    back = step.integrate(start, dt=-DT, t_end=-0.014)
    assert back.t.tolist() == [0, -0.01, -0.014]


def test_a_run_that_was_read_does_not_know_its_last_whole_step(tmp_path):
    _, _, _, to_end = run()
    read = gs.load(to_end.save(tmp_path / "run.npz"))
    assert np.array_equal(read.q, to_end.q)
    with pytest.raises(gs.InputError, match=r"run\[-1\]"):
        read.grid_end  # noqa: B018


def test_times_are_asked_for_up_to_t_end():
    times = [END, 0.001, 0.1005]
    _, _, full_run, to_end = run(t_eval=times)
    assert to_end.t.tolist() == times
    assert np.abs(to_end.q - full_run.at(times).q).max() < 1e-14
    with pytest.raises(gs.InputError, match=r"0\.105 is outside"):
        run(t_eval=[0.105])


def test_inputs_have_a_row_for_the_last_part():
    step = systems.stepper("pushed_pendulum")
    start = gs.Start([0.6, -0.8], [0.8, 0.6], {"k": 2.0})
    rows = np.random.default_rng(3).normal(size=(6, 2))
    to_end = step.integrate(start, dt=0.02, t_end=0.107, inputs=rows)
    between = step.integrate(start, dt=0.02, steps=6, inputs=rows).at([0.107])
    assert np.abs(to_end.q[-1] - between.q[-1]).max() < 1e-14
    assert dict(to_end[-1].inputs) == dict(zip(("push", "pull"), rows[5], strict=True))
    with pytest.raises(gs.InputError, match=r"\(6, 2\)"):
        step.integrate(start, dt=0.02, t_end=0.107, inputs=rows[:5])


def test_gradients_are_those_of_the_row_at_t_end():
    step = systems.differentiable("pendulum")
    start = gs.Start(*systems.start("pendulum", step), systems.case("pendulum").parameters)
    full_run = step.integrate(start, dt=DT, steps=11, t_eval=[0.03, END])
    to_end = step.integrate(start, dt=DT, t_end=END)
    w = np.ones(step.n)
    wrt = ["q", "p", *start.parameters, "dt", "t0"]
    assert to_end.gradient({"q": w}, wrt=wrt).vector() == pytest.approx(
        full_run.gradient({"q": np.stack([0 * w, w])}, wrt=wrt).vector(), rel=1e-10, abs=1e-12)
    tangents = gs.Tangents(dt=True)
    assert step.integrate(start, dt=DT, t_end=END, tangents=tangents).tangents.q[-1] \
        == pytest.approx(step.integrate(start, dt=DT, steps=11, t_eval=[END],
                                        tangents=tangents).tangents.q[-1], rel=1e-10)
    name = next(iter(start.parameters))
    value, slope = step.value_and_gradient(
        lambda run: (float(run.q[-1].sum()), {"q": w}), start, wrt=[name], dt=DT, t_end=END)(
            [start.parameters[name]])
    assert value == float(to_end.q[-1].sum())
    assert slope[0] == pytest.approx(to_end.gradient({"q": w})[name], rel=1e-12)


TO_A_TIME = ["fast-top", "--scheme", "G-L", "--stages", "2", "--dt", "1e-3", "--t-end", "0.0306"]


def test_what_ends_with_a_whole_step_says_so(gyrospark):
    step, start, _, _ = run()
    for call in (lambda: gs.section(step, start, event=gs.Event("x"), dt=DT,
                                    t_end=END),
                 lambda: gs.lyapunov(step, start, dt=DT, t_end=END)):
        with pytest.raises(gs.InputError, match=r"t_end = 0\.1 and 0\.11"):
            call()
    refused_by_command(gyrospark("lyapunov", *TO_A_TIME), "0.03 and 0.031")


def test_runs_of_the_command_end_between_steps(gyrospark):
    """The last row is at the end, behind 30 steps, in files and in stores, which are resumed."""
    command = ["run", *TO_A_TIME]
    for out in ("x.npz", "x.zarr"):
        answer = gyrospark(*command, "--out", out, "--json").document
        assert answer["t_end"] == 0.0306
        assert answer["steps"] == 30
        stored = gs.load(out)
        assert stored.t[-1] == 0.0306
        assert len(stored.t) == 32
        assert stored.q[-1].tolist() == answer["q"]
    answer = gyrospark(*command, "--out", "x.zarr", "--resume", "--json").document
    assert answer["done_before"]


@pytest.mark.parametrize(("name", "every"), [
    *in_pairs(["pendulum", "driven_oscillator"], [1, 3]),
    pytest.param("sleigh", 5, marks=pytest.mark.slow)])
def test_stored_runs_end_there(name, every, tmp_path):
    """Stores have the bits of a run in memory; a longer run goes on from the last full step."""
    step, start, _, to_end = run(name, every=every)
    stored = step.integrate(start, dt=DT, t_end=END, every=every, out=tmp_path / "run.zarr")
    assert stored.status == "complete"
    assert_same(stored, to_end)
    assert stored.grid_end.t == to_end.grid_end.t
    assert np.array_equal(stored.grid_end.q, to_end.grid_end.q)
    for times in ({"t_end": 0.107}, {"steps": 13}, {"t_end": 0.1301}):
        assert_same(gs.resume(tmp_path / "run.zarr", **times),
                    step.integrate(start, dt=DT, every=every, **times))
    with pytest.raises(gs.InputError, match="t_end was"):
        gs.resume(tmp_path / "run.zarr", t_end=0.1201)


@pytest.mark.parametrize(("every", "method"), [
    pytest.param(1, "_advance", marks=pytest.mark.slow), (4, "_take_last_part")])
def test_a_killed_run_ends_there_with_the_same_bytes(every, method, tmp_path, monkeypatch):
    small_blocks(monkeypatch, 4)
    step, start, _, _ = run()
    complete, killed = tmp_path / "whole.zarr", tmp_path / "killed.zarr"
    plan = {"dt": DT, "t_end": END, "every": every, "events": gs.Event("x", level=0.6)}
    step.integrate(start, **plan, out=complete)
    original, calls = getattr(Recorder, method), []

    def kill(self, *arguments):
        calls.append(arguments)
        if len(calls) == (1 if method == "_take_last_part" else 2):
            raise Interrupted
        return original(self, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr("gyrospark.runtime.integration.step_loop._CHUNK_WITH_EVENTS", 7)
        patch.setattr(Recorder, method, kill)
        with pytest.raises(Interrupted):
            step.integrate(start, **plan, out=killed)
    assert gs.load(killed).status == "running"
    gs.resume(killed)
    assert_same_bytes(complete, killed)


@pytest.mark.parametrize(("time", "terminal"), in_pairs(
    [0.1065, 0.052, 0.1, 0.1013], [False, True]))
def test_events_in_the_last_part_of_a_step(time, terminal, tmp_path):
    """A run, a stored run and an ensemble have the same crossings."""
    step, start, full_run, _ = run()
    event = gs.Event(step.manifest.system.coordinates[0], float(full_run.at([time]).q[0, 0]),
                     terminal=terminal, name="there")
    plan = {"dt": DT, "t_end": END, "events": event, "solver": "newton"}
    to_end = step.integrate(start, **plan)
    crossings = to_end.events["there"]
    assert crossings.t == pytest.approx([time] * (time < END), abs=1e-13)
    assert crossings.elapsed == pytest.approx([time] * (time < END), abs=1e-13)
    assert all(k * DT <= time <= (k + 1) * DT for k in crossings.steps)
    ended = terminal and time < END
    assert to_end.t[-1] == (pytest.approx(time, abs=1e-13) if ended else END)
    assert np.abs(to_end.q[-1] - full_run.at([to_end.t[-1]]).q[0]).max() < 1e-12
    stored = step.integrate(start, **plan, out=tmp_path / "run.zarr")
    assert_same(stored, to_end)
    assert stored.ended_by == ("there" if ended else None)
    repeats = [stored.events["there"]]
    if not terminal:
        ensemble = step.integrate_ensemble([start, start], **plan)
        assert np.array_equal(ensemble.q[1], to_end.q)
        repeats.append(ensemble.events["there"][1])
    for repeat in repeats:
        for name in ("t", "q", "steps", "elapsed"):
            assert np.array_equal(getattr(repeat, name), getattr(crossings, name))


@pytest.mark.parametrize("solver", ["auto", "newton"])
@pytest.mark.parametrize("name", ["pendulum", "heavy_top", "driven_oscillator"])
def test_ensembles_end_there(name, solver, tmp_path):
    """By Newton's method members have the bits of single runs; lanes agree to round-off."""
    step, start, _, to_end = run(name, every=3, solver=solver)
    later = start.replace(t=0.001)
    alone = step.integrate(later, dt=DT, t_end=END, every=3, solver=solver)
    ensemble = step.integrate_ensemble([start, later], dt=DT, t_end=END, every=3, solver=solver)
    for single, member, i in ((to_end, ensemble.members[0], 0), (alone, ensemble.members[1], 1)):
        close = 0 if solver == "newton" else 2e-15
        for states in (ensemble.q[i], member.q):
            assert np.abs(states - single.q).max() <= close
        assert ensemble.t[i].tolist() == member.t.tolist() == single.t.tolist()
        assert member.report.q == tuple(ensemble.q[i, -1])
        assert member.report.work == pytest.approx(single.report.work, abs=1e-16)
        assert np.array_equal(member.multipliers, ensemble.multipliers[i], equal_nan=True)
        assert member.grid_end.t == single.grid_end.t
    assert len(gs.load(ensemble.members[0].save(tmp_path / "x.npz"))) == len(to_end)
    with pytest.raises(gs.InputError, match=f"t_end = {END}"):
        step.integrate_ensemble([start, start], dt=[DT, 0.0104], t_end=END)


def test_ensembles_have_inputs_and_tangents_for_the_last_part():
    step = systems.stepper("pushed_pendulum")
    start = gs.Start([0.6, -0.8], [0.8, 0.6], {"k": 2.0})
    rows = np.random.default_rng(3).normal(size=(2, 6, 2))
    ensemble = step.integrate_ensemble([start, start], dt=[0.02, 0.021], t_end=0.107, inputs=rows)
    for i, dt in enumerate((0.02, 0.021)):
        alone = step.integrate(start, dt=dt, t_end=0.107, inputs=rows[i])
        assert np.abs(ensemble.q[i] - alone.q).max() < 1e-14
        assert dict(ensemble.members[i][-1].inputs) == dict(alone[-1].inputs)
    step = systems.differentiable("pendulum")
    start = gs.Start(*systems.start("pendulum", step), systems.case("pendulum").parameters)
    plan = {"dt": DT, "t_end": END, "tangents": gs.Tangents(dt=True), "solver": "newton"}
    ensemble = step.integrate_ensemble([start, start], **plan)
    assert np.array_equal(ensemble.tangents[1].q, step.integrate(start, **plan).tangents.q)


def test_a_last_part_that_fails_is_a_failed_step(tmp_path):
    """Runs, stored runs and members of an ensemble have the full steps before the failure."""
    step, start, _, _ = run("pendulum", solver="newton")
    solver = gs.Solver("newton", max_iterations=1, tolerance=1e-300)
    for call in (lambda: step.integrate(start, dt=DT, t_end=0.004, solver=solver),
                 lambda: step.integrate(start, dt=DT, t_end=0.004, solver=solver,
                                        out=tmp_path / "run.zarr")):
        with pytest.raises(gs.StepFailed) as failure:
            call()
        assert failure.value.step == 1
        assert len(failure.value.trajectory) == 1
    assert gs.load(tmp_path / "run.zarr").status.startswith("failed: ")
    ensemble = step.integrate_ensemble([start, start], dt=DT, t_end=0.004, solver=solver)
    assert {*ensemble.failures} == {0, 1}
    assert np.isnan(ensemble.q[:, -1]).all()
    assert ensemble.failures[1].step == 1
    assert len(ensemble.members[1]) == 1


COMMAND = ["run", "fast-top", "--scheme", "G-L", "--stages", "3", "--json"]
plain = st.floats(1e-6, 1e3)


@given(n=st.integers(0, 10**6), dt=plain, t0=st.one_of(st.just(0.0), plain), back=st.booleans())
def test_what_is_a_whole_number_but_for_rounding_is_one(n, dt, t0, back):
    dt = -dt if back else dt
    assert step_count(None, t0 + n * dt, t0, dt) == n


@pytest.mark.parametrize("n", [1, 3, 1000])
def test_a_unit_of_a_double_is_what_times_may_be_off_by(n):
    """|t_end - n dt| <= 2^-52 (|t_end| + n dt) holds to the last digit of a fraction."""
    unit = Fraction(1, 2**52)
    largest = 2 * unit / (1 - unit)  # x <= unit (2 + x), of t_end = n (1 + x)
    for departure in (largest, -2 * unit / (1 + unit)):
        assert step_count(None, n * (1 + departure), 0, 1) == n
        with pytest.raises(gs.InputError):
            step_count(None, n * (1 + departure * (1 + Fraction(1, 2**20))), 0, 1)


@pytest.mark.parametrize(("t_end", "dt", "n"), [
    (600, 0.1, 6000), (0.3, 0.1, 3), (1, 1 / 3, 3), (2 * np.pi, 2 * np.pi / 1000, 1000),
    (Decimal("0.7"), Fraction(1, 10), 7), (-0.3, -0.1, 3), (0, 0.1, 0), (np.float32(0.5), 0.25, 2),
])
def test_numbers_of_any_type(t_end, dt, n):
    assert step_count(None, t_end, 0, dt) == n


@given(t_end=plain, dt=plain, t0=st.one_of(st.just(0.0), plain))
def test_what_is_named_fits(t_end, dt, t0):
    dt = -dt if t_end < t0 else dt
    try:
        step_count(None, t_end, t0, dt)
    except gs.InputError as error:
        message = str(error)
    else:
        return
    times, steps = re.search(r".* t_end = (.*), or dt = (.*)\.$", message).groups()
    counts = [step_count(None, float(t), t0, dt) for t in times.split(" and ")]
    assert counts in ([1], [counts[0], counts[0] + 1])
    exact = (Fraction(t_end) - Fraction(t0)) / Fraction(dt)
    assert counts[-1] - 1 < exact < counts[-1]
    assert [step_count(None, t_end, t0, float(x)) for x in steps.split(" or ")] == counts[::-1]


def test_a_run_up_to_a_time_is_that_of_its_steps(gl3, gyrospark):
    by_steps = gl3.integrate(gs.Start(TOP.q0, TOP.p0, t=0.5), steps=30, **RUN)
    by_time = gl3.integrate(gs.Start(TOP.q0, TOP.p0, t=0.5), t_end=0.53, **RUN)
    assert np.array_equal(by_time.q, by_steps.q)
    document = gyrospark(*COMMAND, "--dt", "1e-3", "--set", "t=0.5", "--t-end", "0.53").document
    assert document["steps"] == 30
    assert document["q"] == by_steps.q[-1].tolist()


def test_wrong_use_is_refused(gl3, gyrospark):
    for ends in ({}, {"steps": 3, "t_end": 1}):
        with refused("steps.*t_end"):
            gl3.integrate(TOP.q0, TOP.p0, **ends, **RUN)
    with refused(r"t_end = -1\.0.*t = 0\.0.*dt = -0\.001"):
        gl3.integrate(TOP.q0, TOP.p0, t_end=-1, **RUN)
    with refused("t_end = nan"):
        gl3.integrate(TOP.q0, TOP.p0, t_end=float("nan"), **RUN)
    refused_by_command(gyrospark("lyapunov", *COMMAND[1:-1], "--dt", "0.3", "--t-end", "1"),
                       "t_end = 0.9 and 1.2, or dt = 0.25 or 0.3333333333333333.")
    refused_by_command(gyrospark(*COMMAND, "--dt", "0.3", "--t-end", "1", "--steps", "3"),
                       "--steps 3 and --t-end 1")
    refused_by_command(gyrospark(*COMMAND, "--dt", "0.3", "--t-end", "soon"), "--t-end 'soon'")


@given(t_end=st.floats(-1e3, 1e3), dt=plain, t0=st.one_of(st.just(0.0), plain))
def test_whole_steps_and_the_rest_lead_to_any_time(t_end, dt, t0):
    """The sum is exact, unless rounding cannot tell the end from the end of a full step."""
    dt = -dt if t_end < t0 else dt
    count, partial = span_of(None, t_end, t0, dt)
    remaining = Fraction(t_end) - Fraction(t0) - count * Fraction(dt)
    assert partial in (0, remaining)
    assert (0 < partial / Fraction(dt) < 1) if partial else abs(remaining) <= abs(Fraction(dt)) / 2
