"""Two crossings of a level within one step, and starts exactly on a level, against closed forms.

The tests of one crossing a step are in test_events.py, of pieces of a run in test_watch.py.
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from event_runs import pendulum, start

#: Least depth of a dip, in parts of how far the value moves: a thousand units in the last place.
LEAST = 1e-12


def oscillator(real: str = "double", stages: int = 8):
    """Return a stepper: x² − e is crossed from above twice a period, x − 1 + e from below once."""
    x, u, e = sp.symbols("x u e", real=True)
    system = gs.System((x,), (u,), (e,), (u**2 + x**2) / 2, name="dips",
                       quantities={"square": x**2 - e, "sine": x - 1 + e})
    return gs.stepper("G-L", stages, system=system, real=real)


def crossings(quantity: str, phase: float, e: float, span: float) -> np.ndarray:
    """Return the times at which x = sin(phase + t) has x² = e or x = 1 − e, from 0 to span."""
    k = np.arange(-int(abs(span)) - 3, int(abs(span)) + 3)
    middle, half = ((np.pi * k, np.arcsin(np.sqrt(e))) if quantity == "square" else
                    (np.pi / 2 + 2 * np.pi * k, np.arccos(1 - e)))
    times = np.sort(np.concatenate([middle - half, middle + half]) - phase)
    return times[(times > min(span, 0)) & (times < max(span, 0))]


def starts(count: int, seed: int = 0):
    """Return phases, and depths of dips from 1e-12 to 0.1."""
    random = np.random.default_rng(seed)
    return random.uniform(0, 2 * np.pi, count), 10 ** random.uniform(np.log10(LEAST), -1, count)


@pytest.mark.parametrize(("quantity", "dt", "slow"), [
    ("sine", -2.7, 1200), *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        ("square", 1.3, 1200), ("square", -0.1, 20_000), ("sine", 0.5, 8000)))])  # many starts
@pytest.mark.parametrize("in_full", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_random_dips_of_an_oscillator(quantity: str, dt: float, slow: int, in_full: bool) -> None:
    """Each dip is detected once, wherever in its step it turns, at up to 2.7 rad a step.

    Some fifty dips a case, slowly some ten thousand. Times are worth the rounding of the value
    over its rate, which is the root of the depth.
    """
    steps, count = 24, slow if in_full else max(slow // 80, 40)
    phase, depth = starts(count)
    events = oscillator().integrate_ensemble(
        np.sin(phase)[:, None], np.cos(phase)[:, None], dt=dt, steps=steps, every=steps,
        parameters={"e": depth}, events=gs.Event(quantity)).events[quantity]
    dips = 0
    for i in range(count):
        times = crossings(quantity, phase[i], depth[i], steps * dt)[::1 if dt > 0 else -1]
        assert len(events[i]) == len(times), (phase[i], depth[i])
        assert np.abs(events[i].t - times).max(initial=0) < 1e-9 / np.sqrt(depth[i])
        angle = phase[i] + times
        rate = np.sin(2 * angle) if quantity == "square" else np.cos(angle)
        assert np.array_equal(events[i].rising, rate * dt > 0)
        dips += int((np.diff((times / dt).astype(int)) == 0).sum())
    assert dips > (10_000 if in_full else 50)


def test_a_terminal_dip_ends_the_run() -> None:
    """The run ends at the first crossing, in any part of a step, whatever else the step has."""
    step = oscillator()
    phase, depth = starts(15, seed=1)
    for i, dt in enumerate(np.resize([0.1, -0.1, 0.7, 1.3, -1.3], 15)):
        first = crossings("square", phase[i], depth[i], 50 * dt)[0 if dt > 0 else -1]
        run = step.integrate([np.sin(phase[i])], [np.cos(phase[i])], dt=dt, steps=50,
                             parameters={"e": depth[i]},
                             events=[gs.Event("square", terminal=True), gs.Event("sine")])
        assert abs(run.t[-1] - first) < 1e-9 / np.sqrt(depth[i])
        assert run.report.steps == int(run.t[-1] / dt)
        assert len(run.events["square"]) == 1
        assert all((run.events["sine"].t - run.t[-1]) * dt <= 0)


@pytest.mark.parametrize("dt", [0.05, -0.05])
def test_the_bob_of_a_pendulum(dt: float) -> None:
    """sin(θ/2) = k sn: the bob dips at K − F(arcsin(sin(θ/2)/k), m) before the bottom."""
    depth = 10 ** np.linspace(-11, -1, 31)
    events = [gs.Event("height", level=-1 + d, name=f"d{i}") for i, d in enumerate(depth)]
    run = pendulum().integrate(*start(), dt=dt, steps=100, every=100,
                                       parameters={"g": 1.0}, events=events)
    m, end = np.sin(0.5) ** 2, abs(100 * dt)
    with mpmath.workdps(30):
        quarter = float(mpmath.ellipk(m))
        bottoms = quarter * np.arange(1, int(end / quarter) + 2, 2)
        for i, event in enumerate(events):
            below = (1 + mpmath.mpf(event.level)) / 2  # sin²(θ/2) there, of the level as it is
            before = float(mpmath.ellipf(mpmath.asin(mpmath.sqrt(below / m)), m))
            times = np.sort(np.concatenate([bottoms - before, bottoms + before]))
            times = times[times < end]
            event_times = np.abs(run.events[event.name].t)
            assert len(event_times) == len(times), depth[i]
            assert np.abs(event_times - times).max() < 1e-12 / np.sqrt(depth[i])


def ball(real: str = "double"):
    """Return the stepper of x'' = −g + push, whose parabolas it follows to rounding."""
    return systems.stepper("ball", real=real)


def accelerated(a: float) -> dict[str, float]:
    """Return parameters with which x'' = a, exactly: g is positive."""
    weight, push = (-a, 0.0) if a < 0 else (1e-300, a or 1e-300)
    return systems.case("ball").parameters | {"g": weight, "push": push}


def falls(real: str, level: float, count: int, seed: int):
    """Return velocities on the level from 1e-9 to 1, and times at which balls come back there."""
    random = np.random.default_rng(seed)
    speed = 10 ** random.uniform(-9 if level == 0 and real == "double" else -2, 0, count)
    u = speed * random.choice([-1, 1], count)
    return u, 2 * u / 10


@pytest.mark.parametrize(("real", "level", "dt"), [
    ("double", 0.0, 0.05), ("double", 0.0, -0.05), ("double", 5.0, 0.05),
    pytest.param("float", 0.0, 0.05, marks=pytest.mark.slow)])
@pytest.mark.parametrize("count", [
    200, pytest.param(250_000, marks=pytest.mark.slow(reason="a million starts"))])
def test_random_starts_on_the_level(real: str, level: float, dt: float, count: int) -> None:
    """Balls thrown upwards (backwards in time: from above) come back once, the others never."""
    u, returns = falls(real, level, count, seed=1)
    steps = 3
    events = ball(real=real).integrate_ensemble(
        np.full((count, 1), level), u[:, None], dt=dt, steps=steps, every=steps,
        parameters=accelerated(-10.0), events=[
            gs.Event("x", level=level), gs.Event("x", level=level, direction=1, name="rising"),
            gs.Event("x", level=level, direction=-1, name="falling")]).events
    times = returns * np.sign(dt)
    ends = (times > 0) & (times < steps * abs(dt))
    assert np.count_nonzero(ends & (times < abs(dt))) > count / 8
    assert np.array_equal(events["x"].count, ends)
    assert np.array_equal(events["falling"].count, ends)
    assert not events["rising"].count.any()
    size = 2.0**-23 if real == "float" else 2.0**-52
    bound = 64 * size * (abs(dt) + level / abs(u[ends]))
    assert np.all(abs(events["x"].first[ends] - returns[ends]) <= bound)


def quadratic(first: float, second: float, ahead: int = 1):
    """Return the event times of a run of x = (t − first)(t − second), exact in steps of 1/4."""
    start, end = (0.0, 2.0)[::ahead]
    begin = gs.Start([(start - first) * (start - second)], [2 * start - first - second], t=start)
    run = ball().integrate(begin, dt=ahead / 4, steps=8, parameters=accelerated(2.0), events=[
            gs.Event("x"), gs.Event("x", direction=1, name="rising"),
            gs.Event("x", direction=-1, name="falling")])
    assert run.t[-1] == end
    assert np.array_equal(run.q[:, 0], (run.t - first) * (run.t - second))
    return {name: event.t.tolist() for name, event in run.events.items()}


@pytest.mark.parametrize("ahead", [1, -1])
@pytest.mark.parametrize(("first", "second"), [
    (1.0, 1.125), (0.875, 1.0), (0.5, 1.5), (1.0, 1.25), (0.0, 1.0), (0.0, 0.25), (1.0, 9.0)])
def test_states_on_the_level_within_a_run(first: float, second: float, ahead: int) -> None:
    """A zero is at the end of a step, with or without another one in the steps beside it."""
    inside = [t for t in (first, second) if t < 2 and t != (0.0, 2.0)[::ahead][0]][::ahead]
    times = quadratic(first, second, ahead)
    assert times["x"] == pytest.approx(inside, abs=1e-15)
    for name, sign in (("falling", -1), ("rising", 1)):
        expected = [t for t in inside if (2 * t - first - second) * ahead * sign > 0]
        assert times[name] == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("ahead", [1, -1])
def test_a_touch_is_no_crossing(ahead: int) -> None:
    """A zero of second order is at the end of a step, or at the start of a run."""
    assert quadratic(1.0, 1.0, ahead) == {"x": [], "rising": [], "falling": []}
    assert quadratic(0.0, 0.0, ahead)["x"] == []


def test_a_value_that_rests_on_its_level_does_not_cross_it() -> None:
    run = ball().integrate([0.0], [0.0], dt=0.1, steps=5, parameters=accelerated(0.0),
                           events=gs.Event("x"))
    assert len(run.events["x"]) == 0


@pytest.mark.parametrize("direction", [0, -1])
@pytest.mark.parametrize("t0", [0.0, 3.0])
def test_a_ball_bounces_from_the_states_of_its_events(direction: int, t0: float) -> None:
    """Each flight begins where the last one ended, and the bounces are half as high in the end."""
    event = gs.Event("x", direction=direction, terminal=True)
    t, x, u = t0, 0.0, 1.0
    for bounce in range(12):
        run = ball().integrate(gs.Start([x], [u], t=t), dt=0.05, steps=40, events=event,
                               parameters=accelerated(-10.0))
        assert run.t[-1] - t == pytest.approx(2 * u / 10, rel=1e-12), bounce
        t, x, u = float(run.t[-1]), float(run.q[-1, 0]), -0.7 * float(run.p[-1, 0])


def test_an_event_is_not_found_again_from_its_own_state() -> None:
    """The run goes on through the level as if it had not ended there."""
    event = gs.Event("x", level=0.3, terminal=True)
    for u in np.linspace(2.5, 9.0, 15):
        run = {"dt": 0.05, "steps": 40, "parameters": accelerated(-10.0), "events": event}
        first = ball().integrate([0.0], [u], **run)
        second = ball().integrate(gs.Start(first.q[-1], first.p[-1], t=first.t[-1]), **run)
        third = ball().integrate(gs.Start(second.q[-1], second.p[-1], t=second.t[-1]), **run)
        assert bool(first.events["x"].rising[0])
        assert not second.events["x"].rising[0]
        assert second.t[-1] == pytest.approx((u + np.sqrt(u * u - 6)) / 10, rel=1e-13)
        assert len(third.events["x"]) == 0
