"""Stored runs have the events of ``integrate`` to the bit, however often they were ended."""

from __future__ import annotations

import contextlib
import csv
import json
import shutil

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import integrate
from event_runs import assert_same_events, in_pieces, period
from gyrospark.storage import array_layout, recorder, writer
from stores import (
    Interrupted,
    as_files,
    assert_same,
    assert_same_bytes,
    bits,
    ends_after,
    record,
    recorded,
    small_blocks,
)

#: Dips below a level; quantities that cross it once a swing, on the way up alone, and never.
EVENTS = [gs.Event("y", level=-1 + 1e-7, name="dip"), gs.Event("angle"),
          gs.Event("py", level=0.3, direction=1), gs.Event("angle", level=5, name="never")]
#: Ends by a dip in step 16, and by a crossing in step 29.
DIP = gs.Event("y", level=-1 + 1e-7, terminal=True, name="touch")
STOP = gs.Event("angle", level=-0.93, direction=-1, terminal=True, name="stop")


def arguments(**others):
    """Return a pendulum of length 1, released at rest, at the bottom after 16.7 and 50.2 steps."""
    step, case = systems.stepper("pendulum"), systems.case("pendulum")
    q, p = systems.start("pendulum", step)
    return step, {"q": q, "p": p, "dt": 0.1, "steps": 60, "parameters": case.parameters,
                  "events": EVENTS} | others


def small(patch, chunk, rows, seconds=0.0):
    """Let pieces, blocks of states and blocks of events be small."""
    patch.setattr("gyrospark.runtime.integration.step_loop._CHUNK_WITH_EVENTS", chunk)
    small_blocks(patch, rows, seconds)
    patch.setattr(array_layout, "_MOST_EVENTS", 2)


@pytest.mark.parametrize(("ends", "status", "steps", "chunk", "rows", "every", "calls"), [
    ([], "complete", 60, 32, 8, 7, [1]), ([DIP], "ended: touch", 16, 5, 4, 7, [2] * 2),
    pytest.param([STOP, DIP], "ended: touch", 16, 99, 64, 1, [], marks=pytest.mark.slow)])
def test_a_stored_run_finds_what_integrate_finds(
        ends, status, steps, chunk, rows, every, calls, tmp_path, monkeypatch) -> None:
    """The state where an event ends the run agrees too; each run of pieces has the same files."""
    step, run = arguments(every=every, events=EVENTS + ends)
    computed = integrate(step, **run)
    small(monkeypatch, chunk, rows)
    uninterrupted = recorded(step, tmp_path / "whole.zarr", **run)
    assert (uninterrupted.status, uninterrupted.steps_done) == (status, steps)
    for recording in (uninterrupted, in_pieces(step, tmp_path / "pieces.zarr", calls, **run)):
        assert_same(recording[:], computed)
        assert_same_events(recording.events, computed.events)
        assert_same_events(recording[:].events, computed.events)
    assert_same_bytes(tmp_path / "whole.zarr", tmp_path / "pieces.zarr")


def test_a_wide_run_ended_often(tmp_path, monkeypatch) -> None:
    """Times and states agree in all digits, up to the event that ends the run."""
    step, case = systems.stepper("heavy_top", real="float128"), systems.case("heavy_top")
    q, p = systems.start("heavy_top", step)
    low = gs.Event("q1", level=0.2, direction=-1, name="low")
    run = {"q": q, "p": p, "dt": 1e-3, "steps": 400, "every": 40, "parameters": case.parameters,
           "events": [low, gs.Event("q0", level=float(q[0]) - 0.05, terminal=True, name="stop")]}
    small(monkeypatch, 40, 4)
    computed = integrate(step, **run)
    recording = in_pieces(step, tmp_path / "run.zarr", [2, 2], **run)
    assert_same(recording[:], computed)
    assert_same_events(recording.events, computed.events)
    assert len(recording.events["stop"]) == 1


def test_a_store_is_a_run_up_to_a_commit(tmp_path, monkeypatch) -> None:
    """At any time the events in the store are the events of the steps in the store."""
    step, run = arguments(events=EVENTS[:2])
    small(monkeypatch, 9, 4)
    out, steps_done = tmp_path / "run.zarr", []
    for count in (1, 2, 2):
        with contextlib.suppress(Interrupted):
            record(step, out=out, resume=True, progress=ends_after(count), **run)
        recording = gs.load(out)
        computed = integrate(step, **run | {"steps": recording.steps_done})
        assert_same_events(recording.events, computed.events)
        assert recording.dataset().sizes["event_angle"] == len(computed.events["angle"])
        steps_done.append(recording.steps_done)
    assert steps_done == sorted(set(steps_done))
    assert steps_done[-1] > 17


@pytest.mark.parametrize(("first", "second"), [
    (16, 17), pytest.param(18, 51, marks=pytest.mark.slow)])
def test_a_finished_run_goes_on_to_more_steps(first, second, tmp_path, monkeypatch) -> None:
    """The last step may have a dip whose neighbour behind was not known."""
    step, run = arguments()
    small(monkeypatch, 20, 16)
    record(step, out=tmp_path / "run.zarr", **run | {"steps": first})
    recording = record(step, out=tmp_path / "run.zarr", resume=True, **run | {"steps": second})
    computed = integrate(step, **run | {"steps": second})
    assert_same(recording[:], computed)
    assert_same_events(recording.events, computed.events)


def crossing_in_a_part_of_a_step(**event):
    """Return stepper, start and run that crosses the bottom behind the last whole of its steps."""
    step, run = arguments()
    start = gs.Start(run["q"], run["p"], run["parameters"])
    return step, start, {"dt": 0.1, "every": 7, "t_end": 1.68, "events": gs.Event("angle", **event)}


@pytest.mark.parametrize("terminal", [False, True])
def test_a_run_that_is_killed_before_it_says_that_it_is_complete(
        terminal, tmp_path, monkeypatch) -> None:
    """The last checkpoint is written, the attributes are not: no event comes twice."""
    small(monkeypatch, 5, 4)
    step, start, run = crossing_in_a_part_of_a_step(terminal=terminal)
    assert len(step.integrate(start, **run, out=tmp_path / "whole.zarr").events["angle"]) == 1
    consolidate = writer.consolidate

    def killed(path, names, attributes):
        if attributes["status"] != "running":
            raise Interrupted
        consolidate(path, names, attributes)

    with monkeypatch.context() as patch:
        patch.setattr(writer, "consolidate", killed)
        with pytest.raises(Interrupted):
            step.integrate(start, **run, out=tmp_path / "killed.zarr")
    assert gs.load(tmp_path / "killed.zarr").status == "running"
    gs.resume(tmp_path / "killed.zarr")
    assert_same_bytes(tmp_path / "whole.zarr", tmp_path / "killed.zarr")


def test_a_longer_run_has_an_event_behind_the_last_whole_step_once(tmp_path, monkeypatch) -> None:
    """Also a run that is killed again, after its arrays have grown, has this event once."""
    step, start, run = crossing_in_a_part_of_a_step()
    out = tmp_path / "run.zarr"
    assert len(step.integrate(start, **run, out=out).events["angle"]) == 1
    with monkeypatch.context() as patch:
        patch.setattr(recorder.Recorder, "run_to_end", lambda self, report: ends_after(0)(0))
        with pytest.raises(Interrupted):
            gs.resume(out, t_end=1.7)
    assert len(gs.load(out).events["angle"]) == 0
    longer = gs.resume(out, t_end=1.75)
    computed = step.integrate(start, **run | {"t_end": 1.75})
    assert_same(longer, computed)
    assert_same_events(longer.events, computed.events)
    # a quarter of the period, to the fourth order of the scheme
    assert longer.events["angle"].t == pytest.approx([float(period()) / 4], abs=0.1**4)


def test_a_run_that_an_event_has_ended_takes_no_more_steps(tmp_path) -> None:
    """The status says so for any number of steps, and no file changes."""
    step, run = arguments(events=[STOP, *EVENTS])
    record(step, out=tmp_path / "run.zarr", **run)
    files = as_files(tmp_path / "run.zarr")
    for steps in (60, 200):
        recording = record(step, out=tmp_path / "run.zarr", resume=True, **run | {"steps": steps})
        assert recording.status == "ended: stop"
        assert "ended: stop, 29 of 60" in repr(recording)
    assert as_files(tmp_path / "run.zarr") == files
    assert_same(recording[:], integrate(step, **run))


def test_the_order_of_events_is_no_part_of_a_run(tmp_path, monkeypatch) -> None:
    step, run = arguments(events=[*EVENTS, STOP])
    small(monkeypatch, 9, 4)
    with pytest.raises(Interrupted):
        record(step, out=tmp_path / "run.zarr", progress=ends_after(2), **run)
    recording = record(step, out=tmp_path / "run.zarr", resume=True,
                      **run | {"events": [STOP, *EVENTS[::-1]]})
    assert_same_events(recording.events, integrate(step, **run).events)
    assert recording.status == "ended: stop"


def test_a_run_with_other_events_is_another_run(tmp_path) -> None:
    step, run = arguments(steps=3)
    record(step, out=tmp_path / "run.zarr", **run)
    files = as_files(tmp_path / "run.zarr")
    for events, words in (
            ([], r"events .*\{.*None"),
            (EVENTS[:3], r"events\.never .*\{.*None"),
            ([*EVENTS, STOP], r"events\.stop .*None.*\{'quantity': 'angle'"),
            ([*EVENTS[:3], gs.Event("angle", level=0.1, name="never")],
             r"events\.never\.level.*5\.0.*0\.1"),
            ([*EVENTS[:3], gs.Event("angle", level=5, direction=1, terminal=True, name="never")],
             r"never\.direction.*0.*1.*terminal")):
        with pytest.raises(gs.InputError, match="another run.*" + words):
            record(step, out=tmp_path / "run.zarr", resume=True, **run | {"events": events})
    with pytest.raises(gs.InputError, match=r"'\.\./angle'"):  # no array can have this name
        record(step, out=tmp_path / "other.zarr", **run | {
            "events": gs.Event("angle", name="../angle")})
    assert not (tmp_path / "other.zarr").exists()
    assert as_files(tmp_path / "run.zarr") == files


def test_states_between_the_steps_of_a_stored_run(tmp_path) -> None:
    """States at times on the way, and up to the event that ended the run, agree."""
    step, run = arguments(events=[STOP], every=4)
    stored = record(step, out=tmp_path / "run.zarr", **run)[:]
    computed = integrate(step, **run)
    times = [0.0, 1.234, 2.8, float(computed.t[-2]) + 0.01, computed.t[-1]]
    assert_same(stored.at(times, stepper=step), computed.at(times))
    assert bits(stored.at(times, stepper=step).q[-1]) == bits(computed.events["stop"].q[0])
    with pytest.raises(gs.InputError, match="outside"):
        stored.at([5.0], stepper=step)


def test_parts_of_a_stored_run(tmp_path) -> None:
    """A part from a state on has the events behind it; a thinned run has all events."""
    step, run = arguments(every=10)
    stored = record(step, out=tmp_path / "run.zarr", **run)
    events = integrate(step, **run).events["angle"]
    assert events.steps.tolist() == [16, 50]
    assert stored[2:].events["angle"].steps.tolist() == [50]
    assert stored[::3].events["angle"].steps.tolist() == [16, 50]


def test_a_store_that_says_other_events_is_damaged(tmp_path) -> None:
    step, run = arguments(steps=9, events=gs.Event("angle"))
    record(step, out=tmp_path / "run.zarr", **run)
    path = tmp_path / "run.zarr" / "zarr.json"
    sound = json.loads(path.read_text())
    about = sound["attributes"]["run"]
    wrong_event = about["events"]["angle"] | {"restitution": "x"}
    for changes, words in (
            *(({"run": about | {"events": {"angle": event}}}, rf"run\.events are .*{word}")
              for event, word in ((3, "3"), (wrong_event, "x"))),
            ({"events": {}}, r"events are \{\}"), ({"events": 3}, "events are 3"),
            ({"events": {"angle": -1}}, r"events\.angle is -1"),
            ({"events": {"angle": 7}}, "'event_angle_t'.* 7 rows"),
            ({"status": "ended: angle"}, "'ended: angle'")):
        path.write_text(json.dumps(sound | {"attributes": sound["attributes"] | changes}))
        with pytest.raises(gs.InputError, match="damaged.*" + words):
            gs.load(tmp_path / "run.zarr")


def test_events_that_are_gone_are_not_nothing(tmp_path) -> None:
    """A missing block is not NaN, and a missing array does not mean no event."""
    step, run = arguments(events=gs.Event("angle"))
    stored = record(step, out=tmp_path / "run.zarr", **run)
    shutil.rmtree(tmp_path / "run.zarr" / "event_angle_q" / "c")
    for use in (lambda: stored.events, lambda: stored[:],
                lambda: stored.save(tmp_path / "run.csv")):
        with pytest.raises(gs.InputError, match="'event_angle_q'"):
            use()
    shutil.rmtree(tmp_path / "run.zarr" / "event_angle_q")
    with pytest.raises(gs.InputError, match=r"'event_angle_q'.*missing"):
        gs.load(tmp_path / "run.zarr")


@pytest.mark.parametrize(("real", "array", "types"), [
    ("double", "event_q1_q", ("float64", "float32")),
    pytest.param("float128", array_layout.wide_name("event_q1_q"), ("uint8", "uint16"),
                 marks=pytest.mark.slow)])
def test_events_in_arrays_of_another_form_are_damaged(real, array, types, tmp_path) -> None:
    step = systems.stepper("heavy_top", real=real)
    q, p = systems.start("heavy_top", step)
    run = {"q": q, "p": p, "dt": 1e-3, "parameters": systems.case("heavy_top").parameters,
           "events": gs.Event("q1"), "out": tmp_path / "run.zarr"}
    record(step, **run, steps=20)
    about = tmp_path / "run.zarr" / array / "zarr.json"
    about.write_text(about.read_text().replace(*types))
    with pytest.raises(gs.InputError, match=f"'{array}'"):
        record(step, **run, steps=30, resume=True)


def test_an_end_before_the_first_stored_state(tmp_path) -> None:
    """One row beside the start is stored, in memory and in a store."""
    step, run = arguments(events=STOP, every=1000)
    computed = integrate(step, **run)
    assert computed.t.tolist() == [0.0, computed.events["stop"].t[0]]
    assert_same(record(step, out=tmp_path / "run.zarr", **run)[:], computed)


def test_an_event_that_ends_a_forced_run_keeps_its_work(tmp_path, monkeypatch):
    """The work in the last row is the work of all steps and of the last step up to the event."""
    small_blocks(monkeypatch, 4)
    step = systems.stepper("dragged_pendulum")
    q, p = systems.start("dragged_pendulum", step)
    run = {"q": q, "p": p, "dt": 0.01, "steps": 400, "every": 3,
           "parameters": systems.case("dragged_pendulum").parameters,
           "events": [gs.Event("height", level=-0.75, terminal=True)]}
    computed = integrate(step, **run)
    stored = recorded(step, tmp_path / "run.zarr", **run)[:]
    assert computed.report.steps < 400
    assert computed.work[-1] != 0
    assert bits(stored.work) == bits(computed.work)


def test_names_that_netcdf_has_not_are_refused(tmp_path):
    for name in ("angle_t", "a/b", "/", "nul\0"):
        step, run = arguments(steps=20, events=[gs.Event("angle"), gs.Event("angle", name=name)])
        computed = integrate(step, **run)
        with pytest.raises(gs.InputError, match="NetCDF"):
            computed.save(tmp_path / "run.nc")
        assert not list(tmp_path.iterdir())
    computed.save(tmp_path / "run.npz")
    assert_same_events(gs.load(tmp_path / "run.npz").events, computed.events)


def test_no_name_is_a_formula_of_spreadsheets(tmp_path):
    """Such names get a quote; numbers, which may be negative, stay as they are."""
    names = ["=1+1", "+dip", "-dip", "@SUM(A1)", "\t=1", "dip", "a-b"]
    step, run = arguments(events=[gs.Event("angle", name=name) for name in names])
    computed = integrate(step, **run)
    computed.save(tmp_path / "run.csv")
    with (tmp_path / "run.events.csv").open(encoding="utf-8", newline="") as file:
        _, *rows = csv.reader(file)
    assert {row[0] for row in rows} == {
        name if name in ("dip", "a-b") else f"'{name}" for name in names}
    crossings = computed.events["dip"]
    numbers = np.array([[float(x) for x in row[1:6]] for row in rows if row[0] == "dip"])
    np.testing.assert_array_equal(numbers, np.column_stack(
        [crossings.t, crossings.q, crossings.p]))
    assert (numbers < 0).any()
