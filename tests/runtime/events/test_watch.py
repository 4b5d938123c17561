"""Brackets of events do not depend on how a run is cut into pieces."""

from __future__ import annotations

import os
import signal
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import gyrospark as gs
from event_runs import pendulum, period, start
from gyrospark.runtime.bindings.compiled_module import Compiled
from gyrospark.runtime.events import observer
from gyrospark.runtime.events.detection import EventDetector

#: Values beside their level, of two events.
ROWS = st.lists(st.tuples(*[st.integers(-6, 6)] * 2), min_size=1, max_size=24)


def watch_of(terminal: bool) -> EventDetector:
    """Return a watch: one event goes either way, the other falls and may end the run."""
    levels = SimpleNamespace(
        binding=SimpleNamespace(times=lambda t0, dt, steps: t0 + steps * dt),
        events=(gs.Event("x"), gs.Event("y", direction=-1, terminal=terminal)),
        differences=lambda parameters, t, q, p: q, is_time_dependent=False, no_past=None,
        near=lambda parameters, t, q, p, last: (0, len(q) - 1))
    return EventDetector(levels, None, 0.0, 1.0)


def seen(rows: np.ndarray, cuts: list[int], terminal: bool, peeks: set[int]) -> list:
    """Return the brackets of rows cut after so many steps; some cuts look a row ahead, or not."""
    detector = watch_of(terminal)
    ends = sorted({min(cut, len(rows) - 1) for cut in cuts} | {len(rows) - 1})
    for begin, end in zip([0, *ends], ends, strict=False):
        detector.detect(begin, rows[begin : end + 1], rows[begin : end + 1])
        if detector.ends_in is not None:
            break
        if end in peeks and end < len(rows) - 1:
            detector.bracket_last_step((rows[end + 1 : end + 2],) * 2)
        elif -end in peeks:
            detector.bracket_last_step()
    detector.bracket_last_step()
    detector.bracket_last_step()  # sees nothing twice
    brackets = detector.brackets
    return [] if brackets is None else sorted(zip(
        brackets.step.tolist(), brackets.event.tolist(), brackets.turning.tolist(),
        brackets.before.tolist(), brackets.after.tolist(), brackets.q.tolist(), strict=True))


@given(ROWS, st.lists(st.integers(0, 24), max_size=8), st.booleans(),
       st.sets(st.integers(-24, 24)))
def test_pieces_are_no_part_of_the_result(rows, cuts, terminal, peeks) -> None:
    """Brackets are the same however the run is cut, wherever a cut looks into the last step.

    Without the state behind it, such a look leaves a bracket where the value still falls: one more
    step to look into, and none twice.
    """
    values = np.array(rows, dtype=float)
    uncut = seen(values, [], terminal, set())
    assert seen(values, cuts, terminal, {end for end in peeks if end > 0}) == uncut
    brackets = seen(values, cuts, terminal, peeks | {-cut for cut in cuts})
    assert [bracket for bracket in brackets if bracket in uncut] == uncut
    extra = [bracket for bracket in brackets if bracket not in uncut]
    assert all(turning and abs(after) < abs(before) for _, _, turning, before, after, _ in extra)
    assert len({(step, event) for step, event, *_ in brackets}) == len(brackets)
    assert seen(values, list(range(len(rows))), terminal, set()) == uncut


def come_near(parameters, t, q, p, last):
    """Return first and last row behind a value no further off than it moves, as compiled."""
    near = []
    for i, now in enumerate(q):
        moves = abs(now - last[0])
        if not (abs(last[0]) > last[1] + moves).all():
            near.append(i)
        last[:] = now, moves
    return (near[0], near[-1]) if near else None


def sparse_of(make):
    """Return a maker of watches that look only where something is near."""
    def sparse(terminal):
        detector = make(terminal)
        detector._levels.near, detector._last_values = come_near, np.full((2, 2), np.nan)
        return detector
    return sparse


@given(ROWS, st.lists(st.integers(0, 24), max_size=8))
@example([(5, 5)] + [(1, 1)] * 6, [2])
@example([(-5, -5)] + [(-1, -1)] * 6, [2, 3])
def test_pieces_that_are_looked_at_where_something_is_near(rows, cuts) -> None:
    """Values near at the end of a piece are looked at with the first states of the next.

    So is the last step where the parabola through the state before turns, and nothing moves behind.
    """
    values = np.array(rows, dtype=float)

    with pytest.MonkeyPatch.context() as patch:
        uncut = seen(values, [], False, set())
        patch.setitem(globals(), "watch_of", sparse_of(watch_of))
        assert seen(values, [], False, set()) == uncut
        assert seen(values, cuts, False, set()) == uncut
        for cut in range(len(rows)):
            assert seen(values, [cut], False, set()) == uncut


def test_a_value_that_stays_far_is_not_looked_at() -> None:
    """Values are looked at if a parabola may lead to their level, in one piece or by themselves."""
    far = np.array([[9.0], [8.0], [9.0]] * 4).repeat(2, axis=1)
    assert seen(far, [], False, set()) == []
    near = np.array([[2.6], [1.3], [2.6], [4.0], [5.4]]).repeat(2, axis=1)
    assert seen(near, [2], False, set()) == seen(near, [], False, set())


def dips(dt: float) -> dict[str, object]:
    """Return arguments of a run that dips, at a quarter of its period and on, below a level."""
    return {"dt": dt, "parameters": {"g": 1.0}, "events": [
        gs.Event("height", level=-1 + 1e-7, terminal=True), gs.Event("side", level=0.1)]}


def test_a_step_that_fails_behind_the_end_is_none_of_the_run() -> None:
    """A dip ends the run at once, whatever the steps behind it would do."""
    step = pendulum()
    sound = step.integrate(*start(), **dips(0.05), steps=100)
    real, last = Compiled.integrate, [40]

    def failing(binding, constants, steps, every, state, rows):
        status = real(binding, constants, steps, every, state, rows)
        return 1 if state.steps >= last[0] else status

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Compiled, "integrate", failing)
        run = step.integrate(*start(), **dips(0.05), steps=100)
        assert run.t.tolist() == sound.t.tolist()
        assert run.report == sound.report
        last[0] = 10
        with pytest.raises(gs.StepFailed) as failed:
            step.integrate(*start(), **dips(0.05), steps=10)
    assert len(failed.value.trajectory) == 11
    assert [*failed.value.trajectory.events] == [*sound.events]


def test_a_dip_within_the_step_of_the_end_is_told() -> None:
    """The step before the end is looked into, though no state behind it belongs to the run."""
    below = gs.Event("height", level=-1 + 1e-7)
    end = gs.Event("side", level=-0.02, terminal=True)
    run = pendulum().integrate(*start(), dt=0.25, steps=20, parameters={"g": 1.0},
                               events=[below, end])
    assert len(run.events["side"]) == 1
    assert run.events["height"].steps.tolist() == 2 * [len(run) - 2]
    sides = run.events["height"].q[:, 0]
    assert np.allclose(np.abs(sides), np.sqrt(2e-7), rtol=1e-5)


@pytest.mark.parametrize("t0", [-100.0, 100.0])
@pytest.mark.parametrize("dt", [0.25, -0.25])
def test_of_two_ends_in_one_step_the_first_is_the_end(t0: float, dt: float) -> None:
    """The order of ends holds for times of either sign, and for either direction of the run."""
    events = [gs.Event("side", level=0.02, terminal=True, name="late"),
              gs.Event("side", level=0.1, terminal=True, name="early")]
    for order in (events, events[::-1]):
        run = pendulum().integrate(gs.Start(*start(), t=t0), dt=dt, steps=20,
                                   parameters={"g": 1.0}, events=order)
        assert len(run.events["late"]) == 0
        assert run.t[-1] == run.events["early"].t[0]
        assert abs(run.q[-1, 0] - 0.1) < 1e-12


def test_ctrl_c_where_events_are_solved_for(monkeypatch) -> None:
    """The states come without events, for these were not solved for."""
    real = observer.crossings_of

    def interrupted(*arguments):
        os.kill(os.getpid(), signal.SIGINT)
        return real(*arguments)

    monkeypatch.setattr(observer, "crossings_of", interrupted)
    with pytest.raises(gs.errors.Stopped, match="without events") as stopped:
        pendulum().integrate(*start(), dt=0.05, steps=60, parameters={"g": 1.0},
                             events=gs.Event("side"))
    assert len(stopped.value.trajectory) == 61
    assert stopped.value.trajectory.events == {}


def test_times_to_store_and_a_dip_that_ends_the_run() -> None:
    """The run is repeated up to its end, and stores no state behind it."""
    run = pendulum().integrate(*start(), **dips(0.05), steps=100, t_eval=[0.3])
    assert run.t.tolist() == [0.3]
    assert run.report.steps == int(period() / 4 / 0.05)


def nearest(rows: list[float], level: float) -> tuple[int, int] | None:
    """Return the rows that compiled code calls near, for states with this first coordinate."""
    step = pendulum()
    q = np.zeros((len(rows), 2))
    q[:, 0] = rows
    binding = step.binding
    return binding.near(binding.parameters({"g": 1.0}), np.zeros(1), q, q, np.array([0], np.intc),
                        np.array([level]), np.full(2, np.nan))


@pytest.mark.parametrize(("units", "expected"), [
    (1, (0, 5)), (2, (0, 5)), (-2, (0, 5)), (3, (0, 1)), (-3, (0, 1))])
def test_what_is_off_its_level_by_rounding_is_near(units: int, expected: tuple[int, int]) -> None:
    """Two units off the level are near, though nothing moves; so are first rows, without a past."""
    level = 2.0**30
    assert nearest([level + units * 2.0**-22] * 6, level) == expected


def test_near_is_no_further_than_the_steps_on_either_side_move() -> None:
    """|y_i| <= |y_i - y_(i-1)| + |y_(i+1) - y_i|, in exact numbers; the row behind counts too."""
    assert nearest([40, 39, 30, 25, 16, 7, 7, 7, 7], 0) == (0, 6)  # 7 <= 9 + 0
    assert nearest([40, 39, 30, 25, 20, 15, 15, 15], 0) == (0, 1)
    assert nearest([40, 39, 30, 25, 15, 15, 10, 5.5, 5.5], 0) == (0, 1)  # 10 > 5 + 4.5
    assert nearest([40, 39, 30, 25, 15, 15, 10, 4], 0) == (0, 7)  # 10 <= 5 + 6
