"""Two crossings of a level within one step, against closed forms: none is lost, none found twice.

The tests of one crossing a step are in test_events.py, of pieces of a run in test_watch.py.
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from calls import integrate
from event_runs import assert_same_events, in_pieces, pendulum, start
from stores import recorded, small_blocks

#: Least depth of a dip, in parts of how far the value moves: a thousand units in the last place.
LEAST = 1e-12


def oscillator(real: str = "double", stages: int = 8):
    """x² − e touches its level from above twice a period, x − 1 + e from below once."""
    x, u, e = sp.symbols("x u e", real=True)
    system = gs.System((x,), (u,), (e,), (u**2 + x**2) / 2, name="dips",
                       quantities={"square": x**2 - e, "sine": x - 1 + e})
    return gs.stepper("G-L", stages, system=system, real=real)


def crossings(quantity: str, phase: float, e: float, span: float) -> np.ndarray:
    """The times of x = sin(phase + t), where x² = e or x = 1 − e, from 0 to span."""
    k = np.arange(-int(abs(span)) - 3, int(abs(span)) + 3)
    middle, half = ((np.pi * k, np.arcsin(np.sqrt(e))) if quantity == "square" else
                    (np.pi / 2 + 2 * np.pi * k, np.arccos(1 - e)))
    times = np.sort(np.concatenate([middle - half, middle + half]) - phase)
    return times[(times > min(span, 0)) & (times < max(span, 0))]


def starts(count: int, seed: int = 0):
    """Phases, and depths of dips from 1e-12 to 0.1."""
    random = np.random.default_rng(seed)
    return random.uniform(0, 2 * np.pi, count), 10 ** random.uniform(np.log10(LEAST), -1, count)


@pytest.mark.parametrize(("quantity", "dt", "slow"), [
    ("sine", -2.7, 1200), *(pytest.param(*given, marks=pytest.mark.slow) for given in (
        ("square", 1.3, 1200), ("square", -0.1, 20_000), ("sine", 0.5, 8000)))])  # many starts
@pytest.mark.parametrize("many", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_random_dips_of_an_oscillator(quantity: str, dt: float, slow: int, many: bool) -> None:
    """Each is found once, wherever in its step it turns, at up to 2.7 rad a step.

    Some fifty dips a case, slowly some ten thousand. Times are worth the rounding of the value
    over its rate, which is the root of the depth.
    """
    steps, count = 24, slow if many else max(slow // 80, 40)
    phase, depth = starts(count)
    found = oscillator().integrate_ensemble(
        np.sin(phase)[:, None], np.cos(phase)[:, None], dt=dt, steps=steps, every=steps,
        parameters={"e": depth}, events=gs.Event(quantity)).events[quantity]
    dips = 0
    for i in range(count):
        times = crossings(quantity, phase[i], depth[i], steps * dt)[::1 if dt > 0 else -1]
        assert len(found[i]) == len(times), (phase[i], depth[i])
        assert np.abs(found[i].t - times).max(initial=0) < 1e-9 / np.sqrt(depth[i])
        angle = phase[i] + times
        rate = np.sin(2 * angle) if quantity == "square" else np.cos(angle)
        assert np.array_equal(found[i].rising, rate * dt > 0)
        dips += int((np.diff((times / dt).astype(int)) == 0).sum())
    assert dips > (10_000 if many else 50)


@pytest.mark.parametrize(("real", "depth"), [
    ("float", 1e-4), pytest.param("float128", 1e-20, marks=pytest.mark.slow)])
def test_in_every_type(real: str, depth: float) -> None:
    """As deep as its numbers tell: about the bottom, where the bob goes √(2 (1 − cos θ₀)) fast."""
    step = pendulum(real)
    q, p = step.project(*start(), parameters={"g": 1})
    with mpmath.workdps(34):
        low = gs.Event("height", level=-1 + mpmath.mpf(depth))
        found = step.integrate(q, p, dt=0.05, steps=40, parameters={"g": 1},
                               events=[low, gs.Event("side")]).events
        before, behind = found["height"].t
        (bottom,) = found["side"].t
        half = mpmath.sqrt(2 * mpmath.mpf(depth)) / mpmath.sqrt(2 - 2 * mpmath.cos(1))
        assert abs((bottom - before) / half - 1) < 1e-2
        assert abs((behind - bottom) / half - 1) < 1e-2


def test_a_terminal_dip_ends_the_run() -> None:
    """At its first crossing, in any part of a step, whatever else happens in that step."""
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


def test_a_section_has_them() -> None:
    """The points of a section are those of the runs, to the bit."""
    step, (phase, depth) = oscillator(), starts(12, seed=2)
    run = {"dt": 0.7, "steps": 40, "parameters": {"e": depth}}
    q, p = np.sin(phase)[:, None], np.cos(phase)[:, None]
    event = gs.Event("square", direction=-1)
    found = gs.section(step, q, p, event=event, **run)
    many = step.integrate_ensemble(q, p, events=event, **run).events["square"]
    for i in range(12):
        times = crossings("square", phase[i], depth[i], 28)
        falling = times[np.sin(2 * (phase[i] + times)) < 0]
        assert np.array_equal(found.t[found.trajectory == i], many[i].t)
        assert np.abs(many[i].t - falling).max() < 1e-9 / np.sqrt(depth[i])


@pytest.mark.parametrize("terminal", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_stored_run_has_them(terminal: bool, tmp_path, monkeypatch) -> None:
    """At once, and ended again and again: what integrate finds, to the bit."""
    step = oscillator()
    events = [gs.Event("square"), gs.Event("sine")]
    if terminal:
        events.append(gs.Event("square", direction=1, level=-1e-12, terminal=True, name="end"))
    for phase, depth in zip(*starts(1, seed=3), strict=True):
        run = {"q": [np.sin(phase)], "p": [np.cos(phase)], "dt": 1.1, "steps": 20, "every": 3,
               "parameters": {"e": depth}, "events": events}
        whole = integrate(step, **run)
        with monkeypatch.context() as patch:
            patch.setattr("gyrospark.runtime.integration.step_loop._CHUNK_WITH_EVENTS", 5)
            small_blocks(patch, 4, 0.0)
            once = recorded(step, tmp_path / f"{phase}.zarr", **run)
            again = in_pieces(step, tmp_path / f"{phase} again.zarr", [1, 2, 1], **run)
        for found in (once, again):
            assert_same_events(found.events, whole.events)
            assert found.steps_done == whole.report.steps


@pytest.mark.parametrize("dt", [0.05, -0.05])
def test_the_bob_of_a_pendulum(dt: float) -> None:
    """sin(θ/2) = k sn: it dips below a height at K − F(arcsin(sin(θ/2)/k), m) before the bottom."""
    depth = 10 ** np.linspace(-11, -1, 31)
    events = [gs.Event("height", level=-1 + d, name=f"d{i}") for i, d in enumerate(depth)]
    run = pendulum().integrate(*start(), dt=dt, steps=100, every=100,
                                       parameters={"g": 1.0}, events=events)
    m, end = np.sin(0.5) ** 2, abs(100 * dt)
    with mpmath.workdps(30):
        quarter = float(mpmath.ellipk(m))
        bottoms = quarter * np.arange(1, int(end / quarter) + 2, 2)
        for i, one in enumerate(events):
            below = (1 + mpmath.mpf(one.level)) / 2  # sin²(θ/2) there, of the level as it is
            before = float(mpmath.ellipf(mpmath.asin(mpmath.sqrt(below / m)), m))
            times = np.sort(np.concatenate([bottoms - before, bottoms + before]))
            times = times[times < end]
            found = np.abs(run.events[one.name].t)
            assert len(found) == len(times), depth[i]
            assert np.abs(found - times).max() < 1e-12 / np.sqrt(depth[i])
