"""Impacts: Newton's law where gaps close, on the grid of the run; closed forms, order, energy."""

from __future__ import annotations

import contextlib
import shutil
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
import zarr
from scipy.integrate import solve_ivp

import budget
import gyrospark as gs
import systems
from derivative_cases import difference
from gyrospark.core.errors import InputError
from gyrospark.core.records import replace_fields
from gyrospark.runtime.results.joint_motion import multipliers_at_states
from stores import Interrupted, assert_same, ends_after, small_blocks

EPS = 2.0**-52
t, (m, g) = sp.Symbol("t", real=True), sp.symbols("m g", positive=True)
#: Of the ball, whose wall is at −sin(t)/10 in some of the runs.
BALL, WALL = systems.case("ball").parameters, {"a": -0.1, "omega": 1.0}
#: Of the double pendulum.
RODS = systems.case("two_rods").parameters

#: (α, β, α̇, β̇) of the double pendulum with a wall at t = 2: Taylor series in 40 digits.
REFERENCES = {
    1: (-.05524820165037671345, -.6954572041855481544904, 1.835873378197671770577,
        1.212316797417326875254),
    0.5: (-.03013680403073061728, -.5157090040215214651546, .6474817881235305610658,
          .8845625403997008562901)}
FIRST_HITS = .76352320786946771115, 2.28475925744446628, 3.79994379415922505


@cache
def stepper(name: str, scheme: str = "G-L", stages: int | None = 2,
            real: str = "double") -> gs.Stepper:
    """Return a stepper of the catalogue or of a system of this file, its impacts compiled."""
    with budget.shared():
        step = (gs.stepper(scheme, stages, system=OWN[name](), real=real) if name in OWN else
                systems.stepper(name, scheme, stages, real))
        step._impact_binding()
    return step


def _hoisted() -> gs.System:
    q, p = sp.symbols("x y", real=True), sp.symbols("u v", real=True)
    return gs.System(q, p, (g,), sum(u**2 for u in p) / 2 + g * q[1], [
        q[0]**2 + q[1]**2 - (1 + t / 9)**2], time=t, name="hoisted", quantities={"gap": 1 - q[0]})


def _cradle() -> gs.System:
    q, p = sp.symbols("x1:6", real=True), sp.symbols("u1:6", real=True)
    return gs.System(q, p, (m,), sum(u**2 for u in p) / (2 * m), name="cradle", quantities={
        f"gap{i}": q[i + 1] - q[i] - 1 for i in range(4)})


OWN = {"cradle": _cradle, "hoisted": _hoisted}


def dropped(steps: int = 200, *, restitution: float = 0.5, **options):
    """Return the run of a ball that falls from 1 m."""
    return stepper("ball").integrate([1.0], [0.0], **{"dt": 0.01, "steps": steps} | options,
                                     parameters=BALL,
                                     events=gs.Impact("floor", restitution=restitution))


def swung(steps: int, *, scheme: str = "G-L", stages: int | None = 2, restitution=1.0, end=2.0,
          start=None, ahead: int = 1, **options):
    """Return the run of the double pendulum beside a wall."""
    a, b = -0.9, -0.4
    q = np.array([np.sin(a), -np.cos(a), np.sin(a) + np.sin(b), -np.cos(a) - np.cos(b)])
    return stepper("two_rods", scheme, stages).integrate(
        *((q, 0 * q) if start is None else start), dt=ahead * end / steps, steps=steps,
        parameters=RODS, events=gs.Impact("gap", restitution=restitution),
        **options)


def angles(q, p):
    """Return α, β and their rates."""
    a, b = np.arctan2(q[0], -q[1]), np.arctan2(q[2] - q[0], q[1] - q[3])
    return np.array([a, b, p[0] * np.cos(a) + p[1] * np.sin(a),
                     (p[2] - p[0]) * np.cos(b) + (p[3] - p[1]) * np.sin(b)])


def test_a_ball_comes_to_rest():
    """Times, losses and t∞ have closed forms; the run ends where impacts get too close."""
    with pytest.warns(gs.errors.InputWarning, match="floor"):
        run = dropped()
    hits, fall = run.impacts["floor"], np.sqrt(2 / 9.81)
    k = np.arange(len(hits))
    assert len(hits) > 40
    assert np.abs(hits.t - fall * (3 - 2 * 0.5**k)).max() < 4 * EPS
    assert np.abs(hits.energy_lost / (0.75 * 9.81 * 0.25**k) - 1)[:20].max() < 1e-9
    assert np.allclose(hits.p, -0.5 * hits.p_before, rtol=1e-14, atol=0)
    assert np.allclose(hits.impulse, (hits.p - hits.p_before)[:, 0], rtol=1e-14, atol=0)
    assert 0 <= 3 * fall - run.t[-1] < 32 * EPS
    assert run.q.min() > -EPS
    assert np.abs(run.energy_error()).max() < 32 * EPS
    assert run.report.energy_error_max < 32 * EPS
    assert np.array_equal(run.events["floor"].p, hits.p_before)


def test_rows_stay_on_the_grid_and_the_first_have_the_bits_of_a_run_without():
    run, free = dropped(100), stepper("ball").integrate(
        [1.0], [0.0], dt=0.01, steps=100, parameters=BALL)
    assert np.array_equal(run.t, free.t)
    before = run.t < run.impacts["floor"].t[0]
    assert np.array_equal(run.q[before], free.q[before])
    assert np.array_equal(run.p[before], free.p[before])
    fewer = dropped(100, every=7)
    assert np.array_equal(fewer.q, run.q[[*range(0, 100, 7), 100]])
    assert np.array_equal(fewer.impacts["floor"].t, run.impacts["floor"].t)


def test_steps_before_a_crossing_at_the_end_of_a_step():
    """At t = 1, the end of step 8: a level is reached in it, and an impact begins the next one."""
    # a weight below round-off: x = 1 - t
    plan = {"dt": 0.125, "steps": 12, "parameters": {**BALL, "g": 2.0**-200}}
    for terminal in (False, True):
        crossed, hit = (
            stepper("ball").integrate([1.0], [-BALL["m"]], **plan, events=event) for event in (
                gs.Event("floor", terminal=terminal), gs.Impact("floor", 1, terminal=terminal)))
        assert crossed.events["floor"].t == hit.events["floor"].t == 1
        assert (crossed.events["floor"].steps, hit.events["floor"].steps) == (7, 8)
        # a run that ends there has taken the same steps before
        assert crossed.report.steps == hit.report.steps == (7 if terminal else 12)


def test_an_end_between_two_steps_and_one_at_an_impact():
    full_run, cut_run = dropped(124), dropped(None, t_end=1.234567)
    assert cut_run.t[-1] == 1.234567
    assert np.array_equal(cut_run.q[:-1], full_run.q[:-1])
    assert np.array_equal(cut_run.impacts["floor"].t, full_run.impacts["floor"].t)
    last = dropped(None, t_end=float(full_run.impacts["floor"].t[1]) + 1e-5)
    assert len(last.impacts["floor"]) == 2
    assert last.impacts["floor"].steps[-1] == full_run.impacts["floor"].steps[1]
    assert abs(last.impacts["floor"].elapsed[1] - full_run.impacts["floor"].elapsed[1]) < 8 * EPS


def test_the_round_off_of_a_gap_may_be_larger_than_that_of_its_coordinates():
    """The gap is a difference of kilometres: impacts are located to 1e-12 of it."""
    run = stepper("ball").integrate([1.0], [0.0], dt=0.01, steps=100,
                                    parameters=BALL, events=gs.Impact("far"))
    height = np.sqrt((5000 + np.log(1.25))**2 - 4000**2) - 3000
    assert run.impacts["far"].t == pytest.approx([np.sqrt(2 / 9.81 * (1 - height))], abs=1e-11)
    assert run.energy_error()[-1] == pytest.approx(0, abs=1e-10)


def test_many_impacts_within_a_step():
    """A ball between two walls, at a speed of 3001, has 3001 impacts in a second, in two steps."""
    run = stepper("ball").integrate(
        [0.25], [3001.0], dt=0.5, steps=2, parameters=BALL | {"g": 1e-9},
        events=[gs.Impact("floor"), gs.Impact("roof")])
    times = np.sort(np.concatenate([hits.t for hits in run.impacts.values()]))
    assert np.abs(times - (0.75 + np.arange(3001)) / 3001).max() < 1e-10
    assert abs(len(run.impacts["roof"]) - len(run.impacts["floor"])) == 1
    assert np.abs(np.abs(run.p[-1]) - 3001).max() < 1e-9
    # a call has room for fewer impacts than a step has; each part takes an iteration at least
    assert run.report.iterations == run.iterations.sum() >= 3001
    assert run.report.iterations_max == run.iterations.max()


def test_iterations_of_a_step_are_those_of_all_its_parts():
    run, fewer = dropped(100), dropped(99, every=3)
    assert run.report.iterations == run.iterations.sum()
    assert run.report.iterations_max == run.iterations.max() > np.median(run.iterations)
    assert np.array_equal(fewer.iterations, run.iterations[:99].reshape(33, 3).max(axis=1))
    # whole steps: a run ends within one where the ball hits the floor for good
    end = stepper("ball").integrate([1.0], [0.0], dt=0.01, steps=100, parameters=BALL,
                                    events=gs.Impact("floor", terminal=True)).report
    assert end.iterations == run.iterations[:end.steps].sum()
    assert end.iterations_max == run.iterations[:end.steps].max()


def test_an_impact_changes_the_energy_by_its_loss_to_the_rounding_of_momenta():
    """Without a second look at H, the rounding of 1/m would move the loss by up to four eps."""
    run, mass = stepper("ball").integrate(
        [0.25], [3.3], dt=0.5, steps=200, parameters=BALL | {"m": 1.3, "g": 0.7}, events=[
            gs.Impact(name, restitution=0.9999) for name in ("floor", "roof")]), 1.3
    for hits in run.impacts.values():
        after, before = (p[:, 0].astype(np.longdouble) for p in (hits.p, hits.p_before))
        error = (after**2 - before**2) / (2 * mass) + hits.energy_lost
        assert len(hits) > 100
        assert np.abs(error / (before**2 / (2 * mass))).max() < 3 * EPS


def lowest_gap(run, amplitude: float, rate: float) -> float:
    """Return the least gap of a free ball to the wall A sin(Ωt), between the impacts of a run.

    The ball is at x₁ + v₁ (t − t₁) there: the gap is least at an end or where v₁ = AΩ cos Ωt.
    """
    columns = [(run.t[:1], run.q[:1], run.p[:1]),
               *((hits.t, hits.q, hits.p) for hits in run.impacts.values())]
    times, x, v = (np.concatenate([column.ravel() for column in rows])
                   for rows in zip(*columns, strict=True))
    order = np.argsort(times, kind="stable")
    times, x, v = times[order], x[order], v[order]
    end, turn = np.append(times[1:], run.t[-1]), 2 * np.pi / rate
    lowest = (x + v * (end - times) - amplitude * np.sin(rate * end)).min()
    for sign in (1, -1):
        slow = np.abs(v) < amplitude * rate
        first = sign * np.arccos(v[slow] / (amplitude * rate)) / rate
        first += turn * np.ceil((times[slow] - first) / turn)
        for k in range(int(np.ceil((end - times)[slow].max(initial=0) / turn))):
            turns = np.minimum(first + k * turn, end[slow])
            gap = x[slow] + v[slow] * (turns - times[slow]) - amplitude * np.sin(rate * turns)
            lowest = min(lowest, gap.min(initial=np.inf))
    return lowest


@pytest.mark.parametrize("count", [10_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_no_impact_on_a_moving_wall_is_lost(count):
    """No gap is negative between impacts, in steps with none, one or many, at random speeds."""
    rng, hits, several, worst = np.random.default_rng(2), 0, 0, 0.0
    while hits < count:
        run = stepper("ball").integrate(
            [0.5], [-(10**rng.uniform(-1.3, 1.3))], dt=1 / (2 * np.pi), t_end=400 + rng.uniform(),
            every=1000, parameters=BALL | {"g": 1e-300, "a": 0.05, "omega": 2 * np.pi},
            events=[gs.Impact("wall"), gs.Impact("roof")])
        steps = np.sort(np.concatenate([impacts.steps for impacts in run.impacts.values()]))
        hits += len(steps)
        several += np.count_nonzero(np.diff(steps) == 0)
        worst = min(worst, lowest_gap(run, 0.05, 2 * np.pi))
    assert worst > -1e-11  # round-off of the way since the last impact
    assert several > hits / 4


@pytest.mark.parametrize(("dt", "steps"), [(0.9, 1), (0.1, 8)])
@pytest.mark.parametrize(("excess", "count"), [(1e-6, 1), (-1e-6, 0)])
def test_two_crossings_within_a_step(excess, count, dt, steps):
    """A ball at a roof would have a negative gap for a millisecond in the middle of a step.

    Parts of a step are taken to find its lowest gap, and forgotten where it is not negative.
    """
    run = stepper("ball").integrate(
        [0.0], [np.sqrt(2 * 9.81 * (1 + excess))], dt=dt, steps=steps,
        parameters=BALL, events=gs.Impact("roof"))
    assert len(run.impacts["roof"]) == count
    assert run.energy_error()[-1] == pytest.approx(0, abs=1e-13)
    if not count:
        assert np.abs(run.q[:, 0] - run.p[0, 0] * run.t + 9.81 / 2 * run.t**2).max() < 8 * EPS


@pytest.mark.parametrize("restitution", [1, 0.5])
@pytest.mark.parametrize(("scheme", "stages", "steps", "order"), [
    ("G-L", 2, 100, 4),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in (  # compiled for this
        ("EMS", None, 100, 2), *(("G-L", s, n, 2 * s) for s, n in ((1, 200), (3, 50), (4, 50)))))])
def test_the_order_of_the_scheme_through_impacts(scheme, stages, steps, order, restitution):
    errors = [np.abs(angles(run.q[-1], run.p[-1]) - REFERENCES[restitution]).max()
              for run in (swung(n, scheme=scheme, stages=stages, restitution=restitution)
                          for n in (steps, 2 * steps, 4 * steps))]
    assert errors[0] > 1e-12
    slopes = np.log2(np.divide(errors[:-1], errors[1:]))
    assert slopes == pytest.approx([order, order], abs=0.4)
    assert np.abs(slopes - order).min() < 0.2  # long steps, or round-off, may spoil one of them


@pytest.mark.parametrize(("scheme", "stages"), [
    ("G-L", 2), pytest.param("EMS", None, marks=pytest.mark.slow)])  # compiled for this
@pytest.mark.parametrize("backwards", [False, True])
def test_the_way_back(scheme, stages, backwards):
    """With e = 1, reversed momenta or a reversed dt lead back to the start, on the same grid."""
    run = swung(200, scheme=scheme, stages=stages, end=4.0)
    assert np.abs(run.impacts["gap"].t - FIRST_HITS).max() < 2e-2
    back = swung(200, scheme=scheme, stages=stages, end=4.0, ahead=-1 if backwards else 1,
                 start=(run.q[-1], run.p[-1] if backwards else -run.p[-1]))
    assert np.abs(back.q[-1] - run.q[0]).max() < 1e-13
    assert np.abs(back.p[-1]).max() < 1e-13
    # EMS leaves p along g_qᵀ to the round-off of g over Δt, which moves nothing.
    moving = stepper("two_rods", scheme, stages).project(
        back.q[-1], back.p[-1], parameters=RODS)[1]
    assert np.abs(moving).max() < 1e-14
    assert back.report.constraint_max < 16 * EPS
    if scheme == "EMS":
        assert run.report.energy_error_max < 128 * EPS
        assert not run.impacts["gap"].energy_lost.any()


def test_a_store_is_resumed_in_the_middle_of_a_cascade(tmp_path, monkeypatch):
    """The store has the bits of one run, wherever it is interrupted or continued."""
    with pytest.warns(gs.errors.InputWarning, match="floor"):
        full_run = dropped(out=tmp_path / "whole.zarr", every=3)
    small_blocks(monkeypatch, 8)
    ball, out = stepper("ball"), tmp_path / "parts.zarr"
    arguments = {"dt": 0.01, "steps": 200, "every": 3, "parameters": BALL,
                 "events": gs.Impact("floor", restitution=0.5), "out": out}
    with pytest.raises(Interrupted):
        ball.integrate([1.0], [0.0], **arguments, progress=ends_after(3))
    for calls in (1, 2):
        with contextlib.suppress(Interrupted), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            gs.resume(out, progress=ends_after(calls))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        resumed = gs.resume(out)
    assert full_run.status == resumed.status == "ended: floor"
    assert_same(resumed, full_run)
    assert_same_impacts(resumed.impacts, full_run.impacts)
    with pytest.warns(gs.errors.InputWarning, match="floor"):
        computed = dropped(every=3)
    assert_same(resumed, computed)
    assert_same_impacts(resumed.impacts, computed.impacts)
    begun = tmp_path / "begun.zarr"
    ball.integrate([1.0], [0.0], **arguments | {"steps": 129, "out": begun})
    assert len(gs.load(begun).impacts["floor"]) == 4
    with pytest.warns(gs.errors.InputWarning, match="floor"):
        longer = gs.resume(begun, steps=200)
    assert_same(longer, full_run)
    assert_same_impacts(longer.impacts, full_run.impacts)


def test_a_store_ends_at_a_terminal_impact(tmp_path):
    """The store begins before the impact and is resumed to a time beyond it."""
    arguments = {"dt": 0.01, "parameters": BALL, "events": gs.Impact(
        "floor", terminal=True)}
    run = stepper("ball").integrate([1.0], [0.0], steps=100, **arguments)
    stepper("ball").integrate([1.0], [0.0], steps=20, **arguments, out=tmp_path / "ball.zarr")
    stored = gs.resume(tmp_path / "ball.zarr", steps=100)
    assert stored.status == "ended: floor"
    with pytest.raises(InputError, match=rf"ends it, at t = {run.t[-1]:.9g} s"):
        run.gradient({"q": [1.0]})
    assert_same(stored, run)
    assert_same_impacts(stored.impacts, run.impacts)
    group, hits = zarr.open_group(tmp_path / "ball.zarr", mode="r"), run.impacts["floor"]
    for name, momenta in (("p", hits.p_before), ("p_after", hits.p)):
        assert np.array_equal(group[f"event_floor_{name}"][:], momenta)


def test_a_loss_in_an_impact_is_no_error_at_the_end_between_two_steps(tmp_path):
    """Of the losses in two impacts one is behind the last whole step; each is some joules."""
    step, out = stepper("ball"), tmp_path / "ball.zarr"
    start = gs.Start([1.0], [0.0], BALL)
    plan = {"dt": 0.09, "events": gs.Impact("floor", restitution=0.5)}
    run = step.integrate(start, **plan, t_end=0.95)
    assert [len(run.impacts["floor"]), run.impacts["floor"].steps.tolist()] == [2, [5, 10]]
    assert run.impacts["floor"].energy_lost.min() > 1
    assert run.report.energy_error_max < 32 * EPS * 9.81
    step.integrate(start, **plan, t_end=0.7, out=out)  # its end is before the second impact
    stored = gs.resume(out, t_end=0.95)
    assert_same(stored, run)
    assert_same_impacts(stored.impacts, run.impacts)


def test_a_store_of_more_impacts_than_a_call_returns(tmp_path, monkeypatch):
    """Each step has some thousand impacts; the store has only complete steps."""
    small_blocks(monkeypatch, 2)
    arguments = {"dt": 0.5, "steps": 4, "every": 2, "parameters": BALL | {"g": 1e-9},
                 "events": [gs.Impact("floor"), gs.Impact("roof")]}
    run = stepper("ball").integrate([0.25], [3001.0], **arguments)
    stored = stepper("ball").integrate([0.25], [3001.0], **arguments, out=tmp_path / "walls.zarr")
    assert_same(stored, run)
    assert_same_impacts(stored.impacts, run.impacts)
    assert sum(map(len, run.impacts.values())) == 6002


def test_an_ensemble_has_the_bits_of_each_run():
    """Members differ in their parameters; one of them comes to rest."""
    ball, gravities = stepper("ball"), np.array([9.81, 3.0, 50.0])
    arguments = {"dt": 0.01, "steps": 100, "every": 4, "events": gs.Impact(
        "floor", restitution=0.5)}
    with pytest.warns(gs.errors.InputWarning, match="1 of 3"):
        ensemble = ball.integrate_ensemble(np.ones((3, 1)), np.zeros((3, 1)), **arguments,
                                           parameters=BALL | {"g": gravities})
    assert len(ensemble.events["floor"].count) == 3
    for i, gravity in enumerate(gravities[:2]):
        alone = ball.integrate([1.0], [0.0], **arguments, parameters=BALL | {"g": gravity})
        assert np.array_equal(ensemble.q[i], alone.q)
        assert np.array_equal(ensemble.p[i], alone.p)
        assert_same(ensemble.members[i], alone)
        assert_same_impacts(ensemble.members[i].impacts, alone.impacts)
    assert np.isnan(ensemble.q[2, -1])
    assert ensemble.t[2, 0] == 0
    assert ensemble.members[2].t[-1] == pytest.approx(3 * np.sqrt(2 / 50))
    with pytest.raises(InputError, match="Trajectory 1"):
        ball.integrate_ensemble([[1.0], [-1.0]], [[0.0], [0.0]], **arguments,
                                parameters=BALL | {"g": 1})


@pytest.mark.parametrize("every", [1, 7])
@pytest.mark.parametrize("ahead", [1, -1])
def test_states_between_steps_on_both_sides_of_impacts(every, ahead):
    """Steps of G-L follow the parabolas exactly; at an impact the state is the one after it."""
    run = stepper("ball").integrate([1.0], [0.0], dt=ahead * 0.07, steps=30, every=every,
                                    parameters=BALL, events=gs.Impact("floor"))
    hits, fall = run.impacts["floor"], np.sqrt(2 / 9.81)
    t = np.sort(np.concatenate([np.linspace(0, 2.1, 61) * ahead, hits.t]))
    since = (np.abs(t) + fall) % (2 * fall) - fall
    between = run.at(t)
    inner = np.abs(np.abs(since) - fall) > 1e-9
    assert np.abs(between.q[:, 0] - 1 + 9.81 / 2 * since**2).max() < 1e-13
    assert np.abs(between.p[:, 0] + ahead * 9.81 * since)[inner].max() < 1e-12
    assert np.array_equal(run.at(hits.t).p, hits.p)
    assert np.array_equal(run.at(run.t).p, run.p)
    assert np.abs(between.energy_error()).max() < 1e-13
    if every == 1:
        sampled = stepper("ball").integrate(
            [1.0], [0.0], dt=ahead * 0.07, steps=30, t_eval=t, parameters=BALL,
            events=gs.Impact("floor"))
        assert np.abs(sampled.q - between.q).max() < 1e-14


def test_states_after_impacts_are_on_the_grid_of_the_run():
    """Where steps have errors: rows that ``every`` leaves out have the states of a run with all."""
    every_row, seventh_row = swung(40), swung(40, every=7)
    assert len(seventh_row.impacts["gap"]) >= 1
    states = seventh_row.at(every_row.t)
    # steps amplify the round-off of Newton's iterations
    assert np.abs(states.q - every_row.q).max() < 256 * EPS
    assert np.abs(states.p - every_row.p).max() < 256 * EPS


def test_states_between_steps_after_many_impacts_at_once(tmp_path):
    """Gaps of a cradle, run or read from a file, are crossed at the same time as others."""
    run = stepper("cradle", "EMS", None).integrate(
        [-0.5, 1, 2, 3, 4], [1, 0, 0, 0, 0], dt=0.3, steps=4, parameters={"m": 1},
        events=[gs.Impact(f"gap{i}") for i in range(4)])
    for trajectory in (run, gs.load(run.save(tmp_path / "cradle.npz"))):
        late = trajectory.at([0.4, 0.55, 0.85], stepper=stepper("cradle", "EMS", None))
        assert np.abs(late.q[0] - [-0.1, 1, 2, 3, 4]).max() < 8 * EPS
        assert np.abs(late.q[1:] - [[0, 1, 2, 3, 4.05], [0, 1, 2, 3, 4.35]]).max() < 8 * EPS
        assert np.abs(late.p[1:] - [0, 0, 0, 0, 1]).max() < 8 * EPS


def test_work_at_impacts_and_between_steps():
    """W at an impact is the work until there; states between steps continue it."""
    run = stepper("ball").integrate(
        [0.5], [0.0], dt=0.05, steps=20, parameters={"m": 1, "g": 9.81, "c": 0.3} | WALL,
        inputs={"push": np.repeat([-1.0, 2.0], 10)}, events=gs.Impact("floor", restitution=0.8))
    hits = run.impacts["floor"]
    H = 9.81 * hits.q[:, 0] + hits.p_before[:, 0]**2 / 2
    lost = np.concatenate([[0], np.cumsum(hits.energy_lost)[:-1]])
    assert len(hits) > 1
    assert np.abs(H - 9.81 * 0.5 - hits.work + lost).max() < 1e-5
    between = run.at(np.linspace(0, 1, 41))
    assert np.abs(between.energy_error()).max() < 1e-5


@cache
def differentiable(name: str, *args: object, **options) -> gs.Stepper:
    """Return the same stepper, its modules of derivatives compiled."""
    step = stepper(name, *args, **options)
    with budget.shared():
        step._derivative_binding()
        step._jump_binding()
    return step


@pytest.mark.parametrize(("scheme", "stages", "accuracy"), [
    ("G-L", 2, 1e-10),  # the round-off of differences
    pytest.param("EMS", None, 1e-8, marks=pytest.mark.slow)])  # two modules more
def test_tangents_and_adjoint_through_impacts(scheme, stages, accuracy):
    """Three impacts off the grid have derivatives by the start, parameters and dt."""
    pendulum = differentiable("two_rods", scheme, stages)
    run = swung(200, scheme=scheme, stages=stages, restitution=0.7, end=4.0,
                tangents=gs.Tangents(parameters=["g", "width"], dt=True))
    tangents, start, steps = run.tangents, np.concatenate([run.q[0], run.p[0]]), 200
    assert len(run.impacts["gap"]) == 3
    for k, name in enumerate(tangents.names):
        def end(h, k=k, name=name):
            values = {**RODS, "dt": 0.02, "": start}
            values["" if name.startswith("start") else name] = (
                start + h * tangents.start[:, k] if name.startswith("start") else values[name] + h)
            dt, z0 = values.pop("dt"), values.pop("")
            moved = pendulum.integrate(
                *pendulum.project(z0[:4], z0[4:], parameters=values), dt=dt, steps=steps,
                parameters=values, events=gs.Impact("gap", restitution=0.7))
            return np.concatenate([moved.q[-1], moved.p[-1]])

        exact = tangents[name][-1]
        step = {"dt": 1e-6, "width": 1e-4}.get(name, 3e-4)  # no impact crosses the grid
        error = np.abs(difference(end, step) - exact).max()
        assert error < accuracy * np.abs(exact).max(), name
    rng = np.random.default_rng(0)
    w = {name: rng.normal(size=(201, 4)) for name in "qp"}
    gradient = run.gradient(w, wrt=["start", "g", "width", "dt"]).vector()
    along = np.einsum("ij,ijk", w["q"], tangents.q) + np.einsum("ij,ijk", w["p"], tangents.p)
    assert np.abs(gradient - along).max() < 1e-12 * np.abs(along).max()
    ensemble = pendulum.integrate_ensemble(
        run.q[:1], run.p[:1], dt=0.02, steps=200, parameters=RODS,
        events=gs.Impact("gap", restitution=0.7))
    of_member = ensemble.members[0].gradient(w, wrt=["start", "g", "width", "dt"])
    assert np.array_equal(of_member.vector(), gradient)


def test_derivatives_with_a_moving_wall_inputs_and_a_parameter_as_restitution():
    ball, inputs = differentiable("ball"), np.linspace(-1, 2, 20)[:, None]

    def moved(start=(0.5, 0.2), m=1.3, g=9.81, c=0.9, dt=0.07, t0=0.3, push=inputs, **options):
        return ball.integrate(
            gs.Start([start[0]], [start[1]], {"m": m, "g": g, "c": c} | WALL, t=t0), dt=dt,
            steps=20, inputs=push, events=gs.Impact("wall", restitution="c"), **options)

    run = moved()
    assert len(run.impacts["wall"]) > 1
    w = {"q": np.cos(np.arange(21.0))[:, None], "p": np.sin(np.arange(21.0))[:, None]}
    names = ["start", "m", "g", "c", "dt", "t0", "inputs"]
    gradient = run.gradient(w, wrt=names)

    def value(**changes):
        moved_run = moved(**changes)
        return (w["q"] * moved_run.q).sum() + (w["p"] * moved_run.p).sum()

    for name, x, step in (("m", 1.3, 1e-4), ("g", 9.81, 1e-3), ("c", 0.9, 1e-4),
                          ("dt", 0.07, 1e-6), ("t0", 0.3, 1e-4)):
        assert difference(lambda h, name=name, x=x: value(**{name: x + h}), step) == (
            pytest.approx(gradient[name], rel=1e-8)), name
    for k in range(2):
        direction = gradient.basis[:, k]
        assert difference(lambda h, d=direction: value(start=h * d + [0.5, 0.2]), 1e-4) == (
            pytest.approx(gradient["start"][k], rel=1e-8))
    for step in (0, *run.impacts["wall"].steps[:2], 19):
        unit = (np.arange(20) == step)[:, None]
        assert difference(lambda h, unit=unit: value(push=inputs + h * unit), 1e-3) == (
            pytest.approx(gradient["inputs"][step, 0], rel=1e-8, abs=1e-11))


def hoisted(gravity: float, angle: float, rate: float) -> np.ndarray:
    """Return q and p of the ball on a rope of 1 + t/9 from t = 0.3 to 0.9, by its angle."""
    def slope(t, y):
        return [y[1], -(gravity * np.sin(y[0]) + 2 / 9 * y[1]) / (1 + t / 9)]

    def gap(t, y):
        return 1 - (1 + t / 9) * np.sin(y[0])

    gap.terminal, gap.direction = True, -1
    exact = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-13}
    fall = solve_ivp(slope, (0.3, 0.9), [angle, rate], events=gap, **exact)
    time, (a, w) = fall.t_events[0][0], fall.y_events[0][0]
    out = np.sin(a) / 9
    across = (1 + time / 9) * np.cos(a)
    w = (-0.8 * (out + across * w) - out) / across
    a, w = solve_ivp(slope, (time, 0.9), [a, w], **exact).y[:, -1]
    along, turned = np.array([np.sin(a), -np.cos(a)]), np.array([np.cos(a), np.sin(a)])
    return np.concatenate([1.1 * along, along / 9 + 1.1 * w * turned])


@pytest.mark.slow  # four modules a type; others have impacts on constraints, and walls that move
@pytest.mark.parametrize("real", ["float", "double"])
def test_derivatives_after_an_impact_on_constraints_that_move(real):
    """In float, the equation of the angle has the derivatives; in double, differences have them."""
    step = differentiable("hoisted", real=real)
    start = step.consistent([0.5, -1.0], [4.5, 2.0], parameters={"g": 9.81}, t=0.3)
    q, p = (np.asarray(x, float) for x in (start.q, start.p))
    angle, rate = np.arctan2(q[0], -q[1]), (p[1] * q[0] - p[0] * q[1]) / (q @ q)

    def run(gravity=9.81, **options):
        return step.integrate(gs.Start(start.q, start.p, {"g": gravity}, t=0.3), dt=0.03, steps=20,
                              events=gs.Impact("gap", restitution=0.8), **options)

    def end(h):
        if real == "float":
            return hoisted(9.81 + h, angle, rate)
        ended = run(9.81 + h)
        return np.concatenate([ended.q[-1], ended.p[-1]])

    exact, bound = difference(end, 1e-3), {"float": 1e-4, "double": 1e-9}[real]
    struck = run(tangents=gs.Tangents(start=None, parameters=["g"]))
    assert 0 < struck.impacts["gap"].steps[0] < 18
    assert struck.tangents["g"][-1] == pytest.approx(exact, rel=bound)
    assert struck.gradient({"q": np.array([1.0, 0.0])})["g"] == pytest.approx(exact[0], rel=bound)


def test_derivatives_of_an_end_between_two_steps_after_three_impacts():
    def moved(gravity=9.81, **options):
        return differentiable("ball").integrate(
            gs.Start([0.5], [0.2], {"m": 1.3, "g": gravity, "c": 0.9, "push": 0.0} | WALL),
            dt=0.07, t_end=1.43, events=gs.Impact("wall", restitution="c"), **options)

    run = moved(tangents=gs.Tangents(start=None, parameters=["g"]))
    assert len(run.impacts["wall"]) == 3
    exact = difference(lambda h: moved(9.81 + h).q[-1], 1e-4)
    assert run.tangents["g"][-1][:1] == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("ending", [".npz", ".nc", ".zarr", "out"])
def test_runs_of_files_have_the_derivatives_of_runs_in_memory(ending, tmp_path):
    """After impacts, at t_end between two steps, by a parameter that is the restitution."""
    step, path = differentiable("ball"), tmp_path / f"run{ending.replace('out', '.zarr')}"
    start = gs.Start([0.5], [0.2], {"m": 1.3, "g": 9.81, "c": 0.9, "push": 0.0} | WALL)
    plan = {"dt": 0.07, "events": gs.Impact("wall", restitution="c"), "every": 3}
    for t_end in (1.43, 1.4):
        run = step.integrate(start, t_end=t_end, **plan)
        if ending == "out":
            step.integrate(start, t_end=t_end, out=path, **plan)
        else:
            run.save(path)
        read = gs.load(path)
        exact = run.gradient({"q": [1.0], "p": [0.3]})
        assert exact["c"]
        gradient = read.gradient({"q": [1.0], "p": [0.3]}, stepper=step)
        assert gradient.vector() == pytest.approx(exact.vector(), rel=1e-13, abs=1e-14)
        # parts of a run are as runs from their first rows
        part = step.integrate(run[2], t_end=t_end, **plan).gradient({"q": [1.0]}).vector()
        assert len(run[2:].impacts["wall"]) < len(run.impacts["wall"])
        for rows in (run[2:], read[2:]):
            assert rows.gradient({"q": [1.0]}, stepper=step).vector() == pytest.approx(
                part, rel=1e-12, abs=1e-13)
        (shutil.rmtree if path.is_dir() else Path.unlink)(path)


def test_a_moving_wall():
    """The speed relative to the wall is reversed; what H gains is the work of the wall."""
    run = stepper("ball").integrate(
        [1.0], [-1.0], dt=0.01, steps=150, events=gs.Impact("wall", restitution=0.5),
        parameters=BALL | {"g": 1e-300} | WALL)
    hits = run.impacts["wall"]
    assert len(hits) == 1
    (time,), speed = hits.t, -np.cos(hits.t[0]) / 10
    assert abs(1 - time + np.sin(time) / 10) < 4 * EPS
    assert hits.p[0, 0] == pytest.approx(speed - 0.5 * (-1 - speed), rel=1e-14)
    assert hits.energy_lost[0] == pytest.approx((1 - hits.p[0, 0]**2) / 2, rel=1e-13)


def test_a_cradle_hits_one_ball_after_another():
    """Balls touch: the last one leaves, in as many impacts as there are gaps."""
    run = stepper("cradle", "EMS", None).integrate(
        [-0.5, 1, 2, 3, 4], [1, 0, 0, 0, 0], dt=0.1, steps=20, parameters={"m": 1},
        events=[gs.Impact(f"gap{i}") for i in range(4)])
    assert np.abs(run.p[-1] - [0, 0, 0, 0, 1]).max() < 8 * EPS
    assert [len(hits) for hits in run.impacts.values()] == [1] * 4
    assert all(abs(hits.t[0] - 0.5) < 4 * EPS for hits in run.impacts.values())


def test_a_start_on_the_floor():
    """A falling ball has an impact at once; at rest, its run ends at once."""
    ball = stepper("ball")
    run = ball.integrate([0.0], [-1.0], dt=0.01, steps=5, parameters=BALL,
                         events=gs.Impact("floor"))
    assert run.impacts["floor"].t.tolist() == [0.0]
    assert run.p[1, 0] == pytest.approx(1 - 0.0981)
    with pytest.warns(gs.errors.InputWarning, match="floor"):
        run = ball.integrate([0.0], [0.0], dt=0.01, steps=5, parameters=BALL,
                             events=gs.Impact("floor"))
    assert len(run) <= 2
    assert abs(run.t[-1]) < 1e-7


def assert_same_impacts(impacts, expected):
    assert impacts.keys() == expected.keys()
    for name, hits in impacts.items():
        for column, array in hits.columns.items():
            assert np.array_equal(array, expected[name].columns[column]), (name, column)


def test_impacts_on_grid_points_count_once():
    """Heights and times are exact in binary; rows have the momenta after, and losses count."""
    run = stepper("ball").integrate([0.5], [0.0], dt=0.25, steps=7, parameters=BALL | {"g": 1.0},
                                    events=gs.Impact("floor", restitution=0.5))
    assert run.impacts["floor"].t.tolist() == [1.0]
    assert run.impacts["floor"].steps.tolist() == [4]
    assert run.p[4, 0] == 0.5
    assert run.energy_error().tolist() == [0.0] * 8
    assert run[4:].energy_error().tolist() == [0.0] * 4
    raised = swung(200)
    assert raised.report.energy_error_mean == pytest.approx(
        np.abs(raised.energy_error()).mean(), rel=0.05)


def test_multipliers_at_steps_with_impacts():
    """A step with an impact has the multipliers of its last part, near the next row's."""
    run = swung(200)
    (step,) = run.impacts["gap"].steps
    smooth = np.abs(np.diff(run.multipliers[:, 0], axis=0))[step + 1 : step + 20].max()
    assert np.abs(run.multipliers[step, 0] - run.multipliers[step + 1, 0]).max() < 4 * smooth
    # the state before an impact in the first step has none of its own
    later = swung(9, start=(run.q[step], run.p[step]), end=0.09)
    assert later.impacts["gap"].steps.tolist() == [0]
    assert np.isnan(multipliers_at_states(later)).all(axis=1).tolist() == [True] + 9 * [False]


def test_pictures_mark_impacts():
    pytest.importorskip("matplotlib")
    run = dropped(100)
    for figure, panels in ((run.plot(), 2), (run.plot("floor", "energy_error"), 2)):
        marked = [axes for axes in figure.axes for line in axes.get_lines() if np.array_equal(
            line.get_xdata(), run.impacts["floor"].t)]
        assert len(marked) == panels


@pytest.mark.parametrize("ending", [".npz", ".nc", ".zarr"])
def test_files_have_the_impacts(tmp_path, ending):
    run = dropped(100)
    read = gs.load(run.save(tmp_path / f"ball{ending}"))
    assert_same_impacts(read.impacts, run.impacts)
    assert np.array_equal(read.events["floor"].p, run.impacts["floor"].p_before)
    assert np.array_equal(read.energy_error(), run.energy_error())
    assert len(run[:50].impacts["floor"]) == len(read[:50].impacts["floor"]) == 1
    assert np.array_equal(read[60:].energy_error(), run[60:].energy_error())
    assert "energy lost" in repr(run.impacts["floor"])
    assert read.report.impacts == run.report.impacts == len(run.impacts["floor"])


def test_runs_from_every_kind_of_state_keep_the_impacts(tmp_path):
    """A ball whose run continues without its floor would fall through it."""
    step = stepper("ball")
    impact, fall = gs.Impact("floor", restitution=0.8), {"dt": 0.01, "steps": 60}
    start = gs.Start([1.0], [0.0], BALL)
    run = step.integrate(start, events=impact, **fall)
    stored = step.integrate(start, events=impact, out=tmp_path / "run.zarr", **fall)
    states = [run[::7], stored, stored[::7], run.at([0.5]),
              step.integrate_ensemble([start], events=impact, **fall).members[0]]
    for source, ending in ((run, ".npz"), (run, ".zarr"), (stored, ".nc")):
        states.append(gs.load(source.save(tmp_path / f"saved{ending}")))
    for state in states:
        (law,) = state[-1]._events
        assert (law.quantity, float(law.restitution), law.terminal) == ("floor", 0.8, False)
    full_run = step.integrate(start, events=impact, dt=0.01, steps=120)
    later = step.integrate(states[-1][-1], **fall)
    assert len(later.impacts["floor"]) == len(full_run.impacts["floor"]) - len(run.impacts["floor"])
    assert np.abs(later.q[-1] - full_run.q[-1]).max() < 1e-14


def begun(q, p, events, **options):
    """Return a step of the ball."""
    return stepper("ball").integrate([q], [p], dt=0.01, steps=1, parameters=BALL, events=events,
                                     **options)


def relativistic():
    """Return a run to a floor, of a particle on a curve."""
    step, case = systems.stepper("relativistic"), systems.case("relativistic")
    q, p = systems.start("relativistic", step)
    return step.integrate(q, -p, dt=0.1, steps=40, parameters=case.parameters,
                          events=gs.Impact("floor"))


@pytest.mark.parametrize(("call", "words"), [
    (lambda: gs.Impact("floor", restitution=1.1), "1.1"),
    (lambda: gs.Impact("floor", restitution=None), "None"),
    (lambda: dropped(restitution="hight"), "hight"),
    (lambda: gs.Impact(3), "3"),
    (lambda: gs.Impact("floor", name=3), "3"),
    (lambda: dropped(dt=-0.01), "backwards"),
    (lambda: begun(-0.5, 0.0, gs.Impact("floor")), "-0.5"),
    (lambda: begun(0.5, 0.0, gs.Impact("speed")), "u"),
    (lambda: begun(0.5, 0.0, gs.Impact("x")), "quantities"),
    (lambda: begun(0.5, 0.0, [gs.Impact("floor")] * 2), "floor"),
    pytest.param(relativistic, "quadratic", marks=pytest.mark.slow),  # after impacts are compiled
    (lambda: dropped(100).at(1.5), "outside"),
    (lambda: dropped(100, tangents=gs.Tangents(), t_eval=[0.5]), "t_eval"),
    (lambda: dropped(100).gradient({"q": np.ones((101, 1))}, memory="none"), "impacts"),
    (lambda: dropped(100).gradient({"q": np.ones((101, 1))}, memory="1 kB"), "memory"),
    (lambda: dropped(100).hessian({"q": np.ones((101, 1))}), "impacts"),
    (lambda: swung(200).gradient({"multipliers": swung(200).multipliers}), "Multipliers.*impacts"),
    (lambda: swung(9, tangents=gs.Tangents(multipliers=True)), "multipliers"),
    (lambda: begun(0.0, -1.0, gs.Impact("floor"), tangents=gs.Tangents()), "start"),
    (lambda: replace_fields(dropped(100), _origin=None, _laws=()).gradient(
        {"q": np.ones((101, 1))}), "laws"),
    (lambda: stepper("cradle", "EMS", None).integrate(
        [-0.5, 1, 2, 3, 4], [1, 0, 0, 0, 0], dt=0.3, steps=4, parameters={"m": 1},
        events=[gs.Impact(f"gap{i}") for i in range(4)], tangents=gs.Tangents()), "at once"),
])
def test_refusals(call, words):
    with pytest.raises(InputError, match=words):
        call()
