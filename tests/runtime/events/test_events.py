"""Events: times at which a quantity of a run crosses a level, solved for by real steps."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

import gyrospark as gs
import systems
from event_runs import BALL, pendulum, period, start
from gyrospark.commands import gyrospark
from gyrospark.core.event import event_of_text
from gyrospark.runtime.events import location
from gyrospark.runtime.events.zeros import zeros

EPS = {"double": 2.0**-52, "float": 2.0**-23, "float128": 2.0**-112}


@pytest.mark.parametrize("ahead", [1, -1])
@pytest.mark.parametrize("steps", [2000, pytest.param(700_000, marks=pytest.mark.slow)])
def test_a_pendulum_through_the_bottom(steps: int, ahead: int) -> None:
    """The 30 crossings, 10,448 in the slow test, are at T/4 + k T/2 to twelve digits."""
    run = pendulum().integrate(*start(), dt=ahead * 0.05, steps=steps, every=steps,
                               parameters={"g": 1.0}, events=gs.Event("side"))
    crossings = run.events["side"]
    times = ahead * float(period()) * (0.25 + 0.5 * np.arange(len(crossings)))
    assert len(crossings) == int(np.floor(0.05 * steps / float(period()) * 2 + 0.5))
    assert np.abs(crossings.t / times - 1).max() < 1e-12
    assert np.array_equal(crossings.rising, np.arange(len(crossings)) % 2 == 1)
    late = np.abs(crossings.t).max()  # a unit in the last place of t is that far at a speed below 1
    assert np.abs(crossings.q[:, 0]).max() < EPS["double"] * max(4, late)
    assert np.abs((crossings.q**2).sum(axis=1) - 1).max() <= 4 * EPS["double"]


@pytest.mark.parametrize("names", [("q", "p"), ("p", "q")])
def test_each_of_two_events_has_the_times_it_has_alone(names):
    """Some crossings of each event lie between two of the other one in one block of states."""
    step, numbers = systems.stepper("oscillator"), systems.case("oscillator").parameters

    def times_of(*events):
        run = step.integrate([1.0], [0.2], dt=0.06, steps=600, parameters=numbers, events=[
            gs.Event(str(getattr(step.manifest.system, {
                "q": "coordinates", "p": "momenta"}[name])[0]), name=name) for name in events])
        return {name: crossings.t.tolist() for name, crossings in run.events.items()}

    both = times_of(*names)
    assert both == times_of("q") | times_of("p")
    assert min(map(len, both.values())) > 20


@pytest.mark.parametrize(("real", "dt"), [
    ("float", 0.02), pytest.param("float128", 0.01, marks=pytest.mark.slow)])  # two seconds
def test_in_every_type_and_backwards(real: str, dt: float) -> None:
    """Times are exact to the last places of the type; backwards they are the same ones.

    The depth of a dip gives its times: at the bottom the bob has the speed √(2 (1 − cos θ₀)).
    """
    step = pendulum(real, stages=8 if real == "float128" else 2)
    with mpmath.workdps(34):
        depth = {"float": mpmath.mpf(1e-4), "float128": mpmath.mpf(10) ** -20}[real]
        run = {"parameters": {"g": 1}, "every": 100, "events": [
            gs.Event("side"), gs.Event("height", level=-1 + depth)]}
    if real == "float128":
        angle = mpmath.mpf(1)
        with mpmath.workdps(40):
            q0 = [mpmath.sin(angle), -mpmath.cos(angle)]
        q0, p0 = step.project(q0, [0, 0], parameters={"g": 1})
    else:
        q0, p0 = step.project(*start(), parameters={"g": 1})
    events = step.integrate(q0, p0, dt=dt, steps=round(6 / dt), **run).events
    ahead = events["side"]
    back = step.integrate(q0, p0, dt=-dt, steps=round(6 / dt), **run).events["side"]
    assert len(ahead) == len(back) == 2
    bound = {"float": 64 * EPS[real], "float128": 1e-27}[real]  # 16th order, 0.01: 1e-28
    with mpmath.workdps(40):
        for k, time in enumerate(ahead.t):
            assert abs(time - period() * (2 * k + 1) / 4) < bound * 6
            assert abs(time + back.t[k]) < bound * 6
            half = mpmath.sqrt(2 * depth / (2 - 2 * mpmath.cos(1)))
            assert abs((time - events["height"].t[2 * k]) / half - 1) < 1e-2
            assert abs((events["height"].t[2 * k + 1] - time) / half - 1) < 1e-2
    assert not ahead.rising[0]
    assert not back.rising[0]


@pytest.mark.parametrize("solver", ["auto", "newton"])
def test_the_discrete_gradient_and_its_solvers(solver: str) -> None:
    """Crossings lie between the states about them, on the level."""
    step = systems.stepper("pendulum", "EMS")
    run = {"dt": 0.02, "steps": 200, "solver": solver,
           "parameters": systems.case("pendulum").parameters}
    watched = step.integrate(*start(), **run, events=[gs.Event("angle"), gs.Event("py", level=0.1)])
    plain = step.integrate(*start(), **run)
    assert np.array_equal(watched.q, plain.q)
    assert watched.report == plain.report
    for name, values, level in (("angle", plain.q[:, 0], 0.0), ("py", plain.p[:, 1], 0.1)):
        crossings = watched.events[name]
        changes = np.flatnonzero(np.diff(np.sign(values - level)) != 0)
        assert np.array_equal(crossings.steps, changes)
        assert np.all((plain.t[changes] <= crossings.t) & (crossings.t <= plain.t[changes + 1]))
    assert np.abs(watched.events["py"].p[:, 1] - 0.1).max() < 16 * EPS["double"]


def test_a_terminal_event_ends_the_run() -> None:
    step = pendulum()
    run = {"dt": 0.05, "steps": 1000, "parameters": {"g": 1.0}}
    stop = gs.Event("side", direction=1, terminal=True, name="stop")
    ended = step.integrate(*start(), **run, every=7, events=[stop, gs.Event("side")])
    end = 0.75 * float(period())
    assert abs(ended.t[-1] - end) < 1e-12
    assert ended.t[-1] == ended.events["stop"].t[0]
    assert np.array_equal(ended.q[-1], ended.events["stop"].q[0])
    assert ended.report.steps == int(end / 0.05)
    assert len(ended.events["side"]) == 2
    assert len(ended.t) == len(ended.q) == len(ended.multipliers) + 1 == ended.report.steps // 7 + 2
    plain = step.integrate(*start(), **(run | {"steps": ended.report.steps}), every=7)
    # the whole steps, but for the state at the end
    assert replace(ended.report, q=plain.report.q, p=plain.report.p, energy_error_max=0.0,
                   constraint_max=0.0, momentum_constraint_max=0.0) == replace(
        plain.report, energy_error_max=0.0, constraint_max=0.0, momentum_constraint_max=0.0)
    assert (ended.report.q, ended.report.p) == (tuple(ended.q[-1]), tuple(ended.p[-1]))
    rows = ended.report.steps // 7 + 1
    assert np.array_equal(ended.q[:rows], plain.q[:rows])
    sampled = step.integrate(*start(), **run, t_eval=[1.0, end - 1e-3, end + 1e-3, 40.0],
                             events=[stop])
    assert np.array_equal(sampled.t, [1.0, end - 1e-3])
    assert np.allclose(sampled.q, ended.at([1.0, end - 1e-3]).q, rtol=0, atol=1e-14)


def test_a_terminal_event_may_have_the_largest_errors(tmp_path) -> None:
    """(u² + v²)/2 + 9 y less the work, of the rows: its change is largest at the event."""
    step, case = systems.stepper("dragged_pendulum"), systems.case("dragged_pendulum")
    beginning = gs.Start(*systems.start("dragged_pendulum", step), case.parameters, t=0.2)
    plan = {"dt": 0.2, "steps": 40, "events": gs.Event("height", level=-0.8, terminal=True)}
    runs = [step.integrate(beginning, **plan),
            step.integrate(beginning, **plan, out=tmp_path / "run.zarr"),
            gs.resume(tmp_path / "run.zarr")]
    for run in runs:
        balance = (run.p**2).sum(axis=1) / 2 + 9 * run.q[:, 1] - run.work
        errors = abs(balance - balance[0])
        assert errors[-1] > 1.001 * errors[:-1].max()
        # round-off of a sum of terms of up to 9
        assert run.report.energy_error_max == pytest.approx(errors[-1], abs=72 * EPS["double"])
        assert run.report.constraint_max == pytest.approx(
            abs((run.q**2).sum(axis=1) - 1).max(), abs=4 * EPS["double"])
        assert run.report.work == run.work[-1]
        assert run.report == runs[0].report


@pytest.mark.parametrize("terminal", [False, True])
def test_a_dip_is_found_near_the_end(terminal: bool) -> None:
    """The dip is in the last step of a run, or in the piece of steps in which a run ends."""
    step, quarter = pendulum(), 0.25 * float(period())
    low = gs.Event("height", level=-1 + 1e-7)
    dip = step.integrate(*start(), dt=0.05, steps=400, parameters={"g": 1.0}, events=low
                         ).events["height"]
    if terminal:  # it ends soon after the second dip
        events = [low, gs.Event("side", level=0.1, direction=1, terminal=True, name="stop")]
        run = step.integrate(*start(), dt=0.05, steps=400, parameters={"g": 1.0}, events=events)
        assert run.t[-1] > 3 * quarter
    else:
        run = step.integrate(*start(), dt=0.05, steps=int(dip.steps[2]) + 1,
                             parameters={"g": 1.0}, events=low)
    assert np.array_equal(run.events["height"].t, dip.t[:4])


def test_an_ensemble_has_the_first_and_the_number_of_its_members() -> None:
    step, lengths = pendulum(), np.linspace(0.5, 2.0, 9)
    q0, p0 = start()
    ensemble = step.integrate_ensemble([q0] * 9, [p0] * 9, dt=0.05, steps=400, every=400, events=[
        gs.Event("side"), gs.Event("side", level=3, name="never")], parameters={"g": lengths})
    assert ensemble.events["side"].count.tolist() == [
        len(member.events["side"]) for member in ensemble.members]
    first = float(period()) / 4 / np.sqrt(lengths)
    assert np.abs(ensemble.events["side"].first / first - 1).max() < 1e-13
    assert np.isnan(ensemble.events["never"].first).all()
    assert ensemble.events["never"].count.tolist() == [0] * 9


def ensemble_with_an_end():
    return pendulum().integrate_ensemble([start()[0]] * 2, [start()[1]] * 2, dt=0.05, steps=3,
                                         parameters={"g": 1.0},
                                         events=gs.Event("side", terminal=True))


@pytest.mark.parametrize(("events", "text"), [
    (lambda: [gs.Event("hight")], "'hight'"),
    (lambda: "side", "events = 'side'"),
    (lambda: [gs.Event("side"), gs.Event("side", level=1)], "'side'"),
    (lambda: gs.Event("side", direction=2), "direction = 2.*-1"),
    (lambda: gs.Event("side", level=float("inf")), "level = inf"),
    (lambda: gs.Event("side", level="0"), "level = '0'"),
    (lambda: gs.Event("side", terminal=1), "terminal = 1"),
    (ensemble_with_an_end, r"'side'.*terminal"),
])
def test_wrong_events_end_in_a_sentence(events, text: str) -> None:
    with pytest.raises(gs.InputError, match=text):
        pendulum().integrate(*start(), dt=0.05, steps=3, parameters={"g": 1.0}, events=events())


def test_events_in_words() -> None:
    event = event_of_text(" height = -0.5 down stop ")
    assert (event.quantity, float(event.level), event.direction, event.terminal) == (
        "height", -0.5, -1, True)
    assert event_of_text("side=0").direction == 0
    for text in ("height", "height=", "height=x", "height=0 left", "height=0 up down", "h=30 deg"):
        with pytest.raises(gs.InputError, match="read"):
            event_of_text(text)


@given(st.floats(0.01, 0.99), st.integers(1, 9),
       st.sampled_from(["power", "exp", "tan", "step", "mix"]))
def test_zeros_of_smooth_flat_and_jumping_functions(root: float, power: int, kind: str) -> None:
    """Zeros are exact to the tolerance for any function; powers of 9 are flat, steps jump."""
    function = {"power": lambda x: np.sign(x - root) * np.abs(x - root) ** power,
                "exp": lambda x: np.expm1(power * (x - root)),
                "tan": lambda x: np.tan(1.5 * (x - root)),
                "mix": lambda x: (x - root) ** 3 + (x - root) / 10**power,
                "step": lambda x: np.where(x < root, -1.0, 2.0)}[kind]
    last: list[float] = []

    def evaluate(x, indices):
        last.append(float(x[0]))
        return function(x)

    ends = function(np.array([0.0])), function(np.array([1.0]))
    zeros(evaluate, *ends, np.array([1e-14]))
    best = min(abs(x - root) for x in last)
    flat = 1e-300 ** (1 / power) if kind == "power" else 0.0  # the power is 0 in doubles
    assert best <= 2e-14 + flat


def test_a_smooth_value_takes_three_steps_of_a_part(monkeypatch) -> None:
    """The cubic through the states before starts the search, and a secant ends it."""
    shares = []
    partial_steps = location.partial_steps

    def counted(stepper, q, p, t0, dt, *options):
        shares.append(len(dt))
        return partial_steps(stepper, q, p, t0, dt, *options)

    monkeypatch.setattr(location, "partial_steps", counted)
    run = pendulum().integrate([1, 0], [0, 0], dt=0.05, steps=2000, parameters={"g": 1.0},
                               events=gs.Event("side"))
    count = len(run.events["side"])
    assert count > 20
    assert sum(shares) <= 3.5 * count
    assert np.abs(run.events["side"].q[:, 0]).max() < 1e-14


def test_a_section_of_many_starts(tmp_path) -> None:
    """The points are the members' crossings; a picture is drawn by any two names."""
    step = pendulum()
    angles = np.linspace(0.2, 2.0, 7)
    q0 = np.column_stack([np.sin(angles), -np.cos(angles)])
    section = gs.section(step, q0, np.zeros((7, 2)), event=gs.Event("side", direction=1), dt=0.05,
                         steps=1000, parameters={"g": 1.0})
    times = [0.75 * float(period(angle)) for angle in angles]
    first = [section.t[section.trajectory == i][0] for i in range(7)]
    assert np.abs(np.array(first) / times - 1).max() < 1e-12
    assert np.abs(section.values("side")).max() < 1e-14
    assert np.array_equal(section.values("height"), section.q[:, 1])
    assert np.array_equal(section.values("u"), section.p[:, 0])
    speed = np.sqrt(2 * (1 - np.cos(angles)))  # at the bottom, by the energy
    assert np.abs(section.values("u") - speed[section.trajectory]).max() < 1e-12
    section.plot("height", "u", tmp_path / "section.png")
    assert (tmp_path / "section.png").stat().st_size > 5000
    falling = replace(section, event=gs.Event("side", direction=-1)).plot("height", "u")
    assert falling.axes[0].get_title() != section.plot("height", "u").axes[0].get_title()
    with pytest.raises(gs.InputError, match=r"quantity.*'w'"):
        section.values("w")
    with pytest.raises(gs.InputError, match=r"event = .side.*gs\.Event"):
        gs.section(step, q0, np.zeros((7, 2)), event="side", dt=0.05, steps=10,
                   parameters={"g": 1.0})


def test_a_model_file_has_events(tmp_path) -> None:
    """A run of the command has the events of the model and of --event."""
    path = tmp_path / "ball.toml"
    path.write_text(BALL, encoding="utf-8")
    model = gs.load_model(path)
    assert [(event.name, event.quantity, float(event.level), event.direction, event.terminal)
            for event in model.events] == [("half", "height", 2.5, -1, False),
                                           ("landing", "y", 0.0, 0, True)]
    step = gs.stepper("G-L", 2, system=model)
    run = step.integrate(model.q0, model.p0, dt=model.dt, steps=model.steps,
                         parameters=model.parameters, events=model.events)
    assert abs(run.t[-1] - 1) < 1e-14  # h = g t²/2
    assert abs(run.events["half"].t[0] - np.sqrt(0.5)) < 1e-14
    command = ["run", str(path), "--scheme", "G-L", "--stages", "2", "--json"]
    for _ in range(2):  # the second time from the cache
        done = CliRunner().invoke(gyrospark, [*command, "--event", "x=3/4", "--event",
                                              "second: x = 1.125 up"], standalone_mode=False)
        assert done.exception is None, done.output
        events = json.loads(done.output)["events"]
        assert {name: crossing["t"] for name, crossing in events.items()} == {
            "half": run.events["half"].t.tolist(), "landing": run.events["landing"].t.tolist(),
            "x": [0.5], "second": [0.75]}
    plain = CliRunner().invoke(gyrospark, command[:-1], standalone_mode=False)
    assert "event half" in plain.output
    repeated = CliRunner().invoke(gyrospark, [*command, "--event", "half: x=1"],
                                  standalone_mode=False)
    assert "'half'" in str(repeated.exception)
    for event in ("x=3/o", "x=1 dwn"):
        refusal = CliRunner().invoke(gyrospark, [*command, "--event", event], standalone_mode=False)
        assert repr(event) in str(refusal.exception)
        assert "down" in str(refusal.exception)
    changed = CliRunner().invoke(gyrospark, [*command, "--set", "h=20"], standalone_mode=False)
    assert abs(json.loads(changed.output)["events"]["half"]["t"][0] - np.sqrt(2)) < 1e-14


def test_a_list_of_models_has_their_events(tmp_path) -> None:
    """Models have equal events, none of them terminal; other lists are refused."""
    path = tmp_path / "ball.toml"
    path.write_text(BALL, encoding="utf-8")
    model = gs.load_model(path)
    half, landing = model.events
    step, options = gs.stepper("G-L", 2, system=model), {"dt": model.dt, "steps": model.steps}
    with_half, with_landing = (replace(model, events=(event,)) for event in (half, landing))
    ensemble = step.integrate_ensemble([with_half, with_half], **options)
    assert abs(ensemble.events["half"].first - np.sqrt(0.5)).max() < 1e-14  # h = g t²/2
    assert step.integrate_ensemble([with_half, with_half], events=(), **options).events == {}
    for starts, word in (([with_landing, with_landing], "'landing'"),
                         ([with_half, with_landing], "different events")):
        with pytest.raises(gs.InputError, match=word):
            step.integrate_ensemble(starts, **options)


@pytest.mark.parametrize("end", [".zarr", ".csv"])
def test_a_files_events_are_written(tmp_path, end: str) -> None:
    """Every format has the events; a run that was ended by one says so when it is resumed."""
    path, out = tmp_path / "ball.toml", tmp_path / f"run{end}"
    path.write_text(BALL, encoding="utf-8")
    model = gs.load_model(path)
    run = gs.stepper("G-L", 2, system=model).integrate(
        model.q0, model.p0, dt=model.dt, steps=model.steps, parameters=model.parameters,
        events=model.events)
    command = ["run", str(path), "--scheme", "G-L", "--stages", "2", "--out", str(out)]
    done = CliRunner().invoke(gyrospark, [*command, "--json"], standalone_mode=False)
    assert done.exception is None, done.output
    document = json.loads(done.output)
    times = {name: crossings.t.tolist() for name, crossings in run.events.items()}
    assert {name: crossings["t"] for name, crossings in document["events"].items()} == times
    assert document["ended"] == {"event": "landing", "t": run.t[-1]}
    if end == ".csv":
        lines = (tmp_path / "run.events.csv").read_text().splitlines()
        assert lines[0] == "event,time,x,y,u,v,steps,rising,elapsed"
        half, landing = (line.split(",") for line in lines[1:])
        assert half[0] == "half"
        assert [float(x) for x in landing[1:]] == [
            run.t[-1], *run.q[-1], *run.p[-1], run.report.steps, 0, run.elapsed[-1]]
        run.save(tmp_path / "again.csv")
        for name in ("run.csv", "run.events.csv"):
            again = tmp_path / name.replace("run", "again")
            assert again.read_bytes() == (tmp_path / name).read_bytes()
    else:
        resumed = CliRunner().invoke(gyrospark, [*command, "--resume"], standalone_mode=False)
        assert "done before: " in resumed.output
        assert re.search(r"^ *ended .*landing.* 1 s$", resumed.output, re.MULTILINE)
        dataset = gs.load(out).dataset()
        assert dataset.event_half_p.sel(coordinate="y").values == run.events["half"].p[:, 1]
        assert dataset.event_landing_rising.values.tolist() == [0]
        assert "event_landing_trajectory" not in dataset  # a column of ensembles
        CliRunner().invoke(gyrospark, ["export", str(out), str(tmp_path / "run.npz")],
                           standalone_mode=False)
        assert gs.load(tmp_path / "run.npz").events["landing"].t[0] == run.t[-1]


@pytest.mark.parametrize(("line", "text"), [
    ('low = "hight=0"', r"'hight'.*height\?"),
    ('low = "height"', "'height'.*read"),
    ('low = "height=h/0"', r"\[events\] low"),
    ("low = 3", r"\[events\] low .*3.*quotes"),
    ('"a b" = "height=0"', r"\[events\].*'a b'.*name"),
])
def test_wrong_events_of_a_file_end_in_a_sentence(tmp_path, line: str, text: str) -> None:
    path = tmp_path / "ball.toml"
    path.write_text(BALL + line, encoding="utf-8")
    with pytest.raises(gs.InputError, match=r"ball\.toml'.*" + text):
        gs.load_model(path)
