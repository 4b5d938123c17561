"""Events of a sweep's cells: first times and counts against closed forms and single runs."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from calls import PARAMETERS, TOP
from command_line import refused
from sweep_studies import FAILURES, study_file

SWINGS = [0.5, 1.0, 2.0]


def pendulum(angle: float = 1.0) -> gs.Model:
    """Return the pendulum of test_events, let go at an angle, with an event at the bottom."""
    x, y, u, v, g = sp.symbols("x y u v g")
    system = gs.System((x, y), (u, v), (g,), (u**2 + v**2) / 2 + g * y, (x**2 + y**2 - 1,),
                       name="event_pendulum", quantities={"side": x, "height": y})
    return gs.Model(system, {"g": 1.0}, [np.sin(angle), -np.cos(angle)], [0.0, 0.0], dt=0.05,
                    events=[gs.Event("side")])


def period(angle: float = 1.0) -> float:
    """Return 4 K(sin²(θ/2)), the period for g = l = 1."""
    return float(4 * mpmath.ellipk(mpmath.sin(mpmath.mpf(angle) / 2) ** 2))


def test_first_times_and_counts_are_those_of_the_closed_form() -> None:
    """Events are at T/4 + k T/2, else NaN and 0; other results have the bits without events."""
    model = pendulum()
    run = {"scheme": "G-L", "stages": 5, "steps": 200, "every": 50}
    over = {"g": SWINGS, "dt": [0.05, 0.02, -0.05]}
    result = gs.sweep(model, over, **run, events=[
        *model.events, gs.Event("side", direction=-1, name="falls"), gs.Event("v", level=9.0)])
    plain = gs.sweep(model, over, **run)
    for name in plain.variables:
        assert np.array_equal(plain[name], result[name]), name
    for i, g in enumerate(SWINGS):
        for j, dt in enumerate(over["dt"]):
            quarter, sign = period() / 4 / np.sqrt(g), np.sign(dt)
            assert abs(result.event_side_first[i, j] - sign * quarter) < 1e-13
            assert result.event_side_count[i, j] == (200 * abs(dt) + quarter) // (2 * quarter)
            falls = result.event_falls_count[i, j]
            assert falls == (200 * abs(dt) + 3 * quarter) // (4 * quarter)
    assert np.isnan(result.event_v_first).all()
    assert (result.event_v_count == 0).all()
    assert result.event_side_first.attrs["units"] == "s"


@pytest.mark.parametrize(("real", "solver"), [("double", "newton"), ("long-double", "auto")])
def test_cells_find_what_single_runs_find(real: str, solver: str) -> None:
    """Cells and runs agree to the bit, in wide types and by Newton's method, at any length."""
    step, event = systems.stepper("heavy_top", real=real), gs.Event("q1", level=0.2)
    result = gs.sweep("fast-top", {"dt": [1e-3, 8e-4]}, scheme="G-L", stages=2, t_end=0.2,
                      parameters={"gamma": PARAMETERS["gamma"]}, real=real, solver=solver,
                      events=event)
    q, p = step.project(TOP.q0, TOP.p0, parameters=PARAMETERS)
    for i, (dt, steps) in enumerate([(1e-3, 200), (8e-4, 250)]):
        crossings = step.integrate_ensemble([q], [p], dt=dt, steps=steps, parameters=PARAMETERS,
                                            solver=solver, events=event).events["q1"]
        assert result.event_q1_first[i] == float(crossings.first[0])
        assert result.event_q1_count[i] == crossings.count[0] > 0


@FAILURES
def test_a_cell_that_fails_has_no_events() -> None:
    """A failed cell has NaN for its events, as for its other results: later ones are unknown."""
    model = pendulum()
    states = {"q": [model.q0, [0.3, 0.3]], "p": [model.p0, [0.0, 0.0]]}
    result = gs.sweep(model, {"start": states}, scheme="G-L", stages=5, steps=100,
                      events=model.events)
    assert result.status.values.tolist()[0] == 0 != result.status.values.tolist()[1]
    assert np.isfinite(result.event_side_first).values.tolist() == [True, False]
    assert np.isfinite(result.event_side_count).values.tolist() == [True, False]


STUDY = """
model = "fast-top"
scheme = "G-L 2"
steps = 200
[grid]
gamma = [8e-4, 1.2e-3, 1.6e-3]
dt = [1e-3, 2e-3]
[events]
low = "q1=0.2 down"
"""


def test_a_study_has_events_and_its_store_keeps_to_them(tmp_path, gyrospark) -> None:
    """A store is resumed with the same events only."""
    text = STUDY.replace("0.2", "1/5")  # levels are arithmetic, too
    study, store = study_file(tmp_path, text), tmp_path / "cells.zarr"
    command = ["sweep", str(study), "--out", str(store), "--show", "event_low_first", "--json"]
    done = gyrospark(*command)
    assert done.code == 0, done.stderr
    stored = gs.load_sweep(store)
    direct = gs.sweep("fast-top", {"gamma": [8e-4, 1.2e-3, 1.6e-3], "dt": [1e-3, 2e-3]},
                      scheme="G-L", stages=2, steps=200,
                      events=gs.Event("q1", level=0.2, direction=-1, name="low"))
    for name in ("event_low_first", "event_low_count"):
        assert np.array_equal(stored[name], direct[name])
    assert (stored.event_low_count >= 1).all()
    assert done.document["least"] == float(stored.event_low_first.min())
    assert gyrospark(*command, "--resume").code == 0
    study_file(tmp_path, STUDY.replace("0.2", "0.3"))
    refused(gyrospark(*command, "--resume"), "events")


@pytest.mark.parametrize(("events", "text"), [
    (gs.Event("side", terminal=True), "'side'.*terminal"),
    (gs.Event("sied"), "'sied'.*side"),
    (gs.Event("side", name="a/b"), "'a/b'.*name"),
    ("side", "events = 'side'"),
])
def test_wrong_events_end_in_a_sentence(events, text: str) -> None:
    with pytest.raises(gs.InputError, match=text):
        gs.sweep(pendulum(), {"g": SWINGS}, scheme="G-L", stages=5, steps=9, events=events)


@pytest.mark.parametrize(("line", "words"), [
    ("low = 3", ["[events] low = 3"]), ('low = "q1"', ["'q1'", "read"]),
    ('low = "q9=0"', ["'q9'"])])
def test_wrong_events_of_a_study_end_in_a_sentence(tmp_path, gyrospark, line, words) -> None:
    path = study_file(tmp_path, STUDY.replace('low = "q1=0.2 down"', line))
    refused(gyrospark("sweep", path), *words)


@pytest.mark.filterwarnings("ignore::gyrospark.errors.InputWarning")
def test_a_cell_whose_event_is_not_located_fails_alone():
    """Steps of 50 s converge, a part of one does not; the other cell does not change."""
    choice = {"scheme": "EMS", "steps": 50, "every": 10,
              "events": [gs.Event("q1", level=0.2, name="low")]}
    result = gs.sweep("fast-top", {"dt": [1e-3, 50.0]}, **choice)
    assert result.status.values.tolist() == [0, 1]
    assert np.isnan([result.event_low_first[1], result.event_low_count[1], result.q[1, 0]]).all()
    alone = gs.sweep("fast-top", {"dt": [1e-3]}, **choice)
    assert result.isel(dt=[0]).equals(alone)


def test_a_sweep_says_that_cells_go_on_behind_the_end_of_runs() -> None:
    """A run ends at the bottom; after half a period a cell is on the other side, at rest."""
    model = pendulum()
    stopping = gs.Model(model.system, model.parameters, model.q0, model.p0, dt=0.05,
                        events=[gs.Event("side", terminal=True, name="bottom")])
    run = {"scheme": "G-L", "stages": 5, "steps": 100}
    with pytest.warns(gs.errors.InputWarning, match="bottom"):
        cells = gs.sweep(stopping, {"dt": [period() / 200]}, **run)
    assert np.abs(cells.q[0] - [-np.sin(1.0), -np.cos(1.0)]).max() < 1e-13
