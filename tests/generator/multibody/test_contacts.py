"""Contacts and stops of the builder: their gaps, their impacts in runs, and refusals."""

from __future__ import annotations

import csv
import itertools
import pickle
import warnings
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from scipy.spatial.transform import Rotation
from scipy.special import ellipk

import budget
import gyrospark as gs
from gyrospark.core.errors import InputError
from gyrospark.runtime.plotting.scene import scene_of
from gyrospark.runtime.steppers.run_defaults import RunDefaults

EPS = 2.0**-52
INERTIA = (0.1, 0.2, 0.15)


def two_bodies() -> gs.Multibody:
    """Return a builder with two bodies in any pose."""
    build = gs.Multibody("pair")
    for name, x, turn in (("a", (0.3, -0.2, 1.7), (0.4, -0.3, 0.8)), ("b", (1, 2, -1), (1, 2, 3))):
        build.body(name, mass=1, inertia=INERTIA, position=x, rotation=Rotation.from_rotvec(turn))
    return build


def gaps(model: gs.Model) -> dict[str, float]:
    """Return the gaps at the start, from the model's expressions."""
    numbers = dict(zip(model.system.q, model.q0, strict=True)) | {
        s: model.parameters.get(str(s), 1.0) for s in model.system.parameters}
    gap = {impact.name: model.system.quantities[impact.quantity].xreplace(numbers)
           for impact in model.events}
    return {name: float(e.xreplace(dict.fromkeys(e.free_symbols, 0.0))) for name, e in gap.items()}


def test_gaps_are_distances():
    """Gaps of spheres, points, corners and planes of ground or body equal distances by matrices."""
    build = two_bodies()
    Ra, Rb = (Rotation.from_rotvec(turn).as_matrix() for turn in ((0.4, -0.3, 0.8), (1, 2, 3)))
    xa, xb, n = np.array([0.3, -0.2, 1.7]), np.array([1, 2, -1]), np.array([1, 2, 2]) / 3
    build.contact("ball", "a", on_a=(0.1, 0.2, 0.3), radius=[0.25])
    build.contact("wall", "a", "b", on_a=[(0.1, 0, 0), (0, 0.1, 0)], on_b=(0, 0, 0.5),
                  normal=(1, 2, 2), radius=0.05)
    build.contact("balls", "a", "b", on_a=(0, 0, 0.2), on_b=(0.1, 0, 0), radius=(0.3, 0.2))
    build.contact("box", "a", build.ground, on_a=(0, 0, 0.1), box=(0.2, 0.3, 0.1))
    expected = {
        "ball": (xa + Ra @ [0.1, 0.2, 0.3])[2] - 0.25,
        "wall_1": Rb @ n @ (xa + Ra @ [0.1, 0, 0] - xb - Rb @ [0, 0, 0.5]) - 0.05,
        "wall_2": Rb @ n @ (xa + Ra @ [0, 0.1, 0] - xb - Rb @ [0, 0, 0.5]) - 0.05,
        "balls": np.linalg.norm(xa + Ra @ [0, 0, 0.2] - xb - Rb @ [0.1, 0, 0]) - 0.5}
    corners = [xa + Ra @ [0.2 * i, 0.3 * j, 0.1 + 0.1 * k]
               for i, j, k in itertools.product((-1, 1), repeat=3)]
    expected |= {f"box_{i}": x[2] for i, x in enumerate(corners, 1)}
    assert gaps(build.model()) == pytest.approx(expected, abs=8 * EPS)


#: The system of most runs: two balls above a floor, a moving wall, a latch, an arm between stops.
HALL = """
name = "hall"
bodies = [{name = "arm", mass = 2, inertia = [0.1, 0.2, 0.15], position = [0, 9, -0.5]}]
point_masses = [
    {name = "a", mass = 1, position = [0, 0, 1.1]}, {name = "b", mass = 2, position = [1, 0, 2.1]},
]
points = [{name = "piston", path = ["3 - t/2", 0, 0]}]
joints = [
    {name = "hinge", type = "revolute", bodies = ["ground", "arm"], axis = [0, 1, 0], \
     at = [0, 9, 0], angle = 0.5},
    {name = "held", type = "ball", bodies = ["ground", "a"], on_a = [5, 0, 49], on_b = [0, 0, 0]},
]
contacts = [
    {name = "floor_a", bodies = ["a"], radius = 0.1, restitution = "e"},
    {name = "floor_b", bodies = ["b"], radius = 0.1, restitution = "e"},
    {name = "hit", bodies = ["a", "b"], radius = [0.3, 0.2], restitution = 0.75},
    {name = "push", bodies = ["b", "piston"], normal = [-1, 0, 0], radius = 0.2, restitution = 0},
]
latches = [{name = "catch", gap = "5 - a_x", close = ["held"]}]
stops = [{name = "end", joint = "hinge", lower = -0.2, upper = 1.0, restitution = 0.75}]
parameters = {e = 0.5}
run = {dt = 0.01, steps = 120}
"""


@pytest.fixture(scope="module")
def hall(tmp_path_factory: pytest.TempPathFactory) -> tuple[gs.Model, gs.Stepper, Path]:
    """Return the model of ``HALL``, its stepper and the file."""
    path = tmp_path_factory.mktemp("hall") / "hall.toml"
    path.write_text(HALL, encoding="utf-8")
    with budget.shared():
        step = gs.stepper("G-L", 2, system=path)
        step._impact_binding()
    return gs.load_model(path), step, path


def thrown(model: gs.Model, q: list[float], p: list[float]) -> gs.Start:
    """Return a start of the model with the balls at q and their momenta p."""
    return model.start.replace(q=[*model.q0[:7], *q], p=[*model.p0[:7], *p])


def test_runs_of_a_model_have_its_impacts(hall):
    """Two balls bounce at the times of the closed form, with the parameter e."""
    model, step, _ = hall
    apart = thrown(model, [-5, 0, 1.1, 1, 0, 2.1], [0.0] * 6)
    for e in (0.5, 1):
        run = step.integrate(apart, dt=0.01, t_end=1.2, parameters={"e": e})
        fall = np.sqrt(2 / 9.81 * np.array([1, 2]))
        hits = run.impacts["floor_a"].t
        assert np.abs(hits - fall[0] * (1 + 2 * np.cumsum([0, *[e**k for k in range(1, 9)]]))[
            : len(hits)]).max() < 16 * EPS
        assert run.impacts["floor_b"].t == pytest.approx([fall[1]], abs=4 * EPS)
    assert not len(run.impacts["hit"]) + len(run.impacts["push"])
    none = step.integrate(gs.Start(model.q0, model.p0, model.parameters), dt=0.01, t_end=1.2)
    assert not none.impacts
    assert none.q[-1, 9] < 0
    floor_run = step.integrate(apart, dt=0.01, t_end=1.2, events=gs.Impact("floor_b"))
    assert [*floor_run.impacts] == ["floor_b"]


def test_two_spheres_and_a_moving_wall(hall):
    """A hit keeps P and reverses the rate along the line of centres; the wall adds its own rate."""
    model, step, _ = hall
    start = thrown(model, [0, 0.1, 50, 1, 0, 50], [1.5, 0, 0, 0, 0, 0])
    run = step.integrate(start, dt=0.01, t_end=2)
    (hit,), (push,) = (list(range(len(run.impacts[name]))) for name in ("hit", "push"))
    impacts = run.impacts["hit"]
    d = impacts.q[0, 7:10] - impacts.q[0, 10:]
    assert np.linalg.norm(d) == pytest.approx(0.5, abs=4 * EPS)
    assert impacts.t[hit] == pytest.approx((1 - np.sqrt(0.25 - 0.01)) / 1.5, abs=4 * EPS)

    def rate(p):
        return (p[:3] - p[3:] / 2) @ d / 0.5

    before, after = impacts.p_before[hit, 7:], impacts.p[hit, 7:]
    # The last bits of an impulse make H exact, which is 1500 J here.
    assert rate(after) == pytest.approx(-0.75 * rate(before), abs=1500 * EPS)
    assert after[:3] + after[3:] == pytest.approx(before[:3] + before[3:], abs=16 * EPS)
    wall = run.impacts["push"]
    assert wall.p[push, 10] / 2 == pytest.approx(-0.5, abs=1500 * EPS)
    assert wall.q[push, 10] == pytest.approx(2.8 - wall.t[push] / 2, abs=8 * EPS)


def test_a_row_keeps_the_impacts_and_other_runs_refuse_them(hall):
    model, step, _ = hall
    run = step.integrate(model, dt=0.01, steps=20)
    assert [*step.integrate(run[-1], dt=0.01, steps=60).impacts] == [
        impact.name for impact in model.events]
    for starts in (model, [model, model]):
        ensemble = step.integrate_ensemble(starts, dt=0.01, steps=20)
        assert [*ensemble.events] == [impact.name for impact in model.events]
        assert np.array_equal(ensemble.q[-1], run.q)
    for call in (lambda: step.start(model, dt=0.01), lambda: step.step(model, dt=0.01)):
        with pytest.raises(InputError, match="floor_a"):
            call()
    with pytest.raises(InputError, match="different impacts"):
        step.integrate_ensemble([model, gs.Start(model.q0, model.p0, model.parameters)], dt=0.01,
                                steps=2)
    for e in (1.5, -0.1):
        with pytest.raises(InputError, match=f"{e}"):
            step.integrate(model, dt=0.01, steps=2, parameters={"e": e})
    with pytest.raises(InputError, match="events"):
        step.integrate(model, dt=0.01, steps=2, events=gs.Event("a_z"))
    assert pickle.loads(pickle.dumps(model)).events == model.events
    assert RunDefaults.from_json(RunDefaults.of(model).as_json()).events == model.events
    with pytest.raises(InputError, match="sweep"):
        gs.sweep(model, {"gravity_z": [0.0]}, scheme="G-L", stages=2, dt=0.01, steps=2)


def test_a_pendulum_between_two_stops(hall, tmp_path):
    """Rates follow from energy before a stop and from e after it; the loss is ½ I (1 − e²) ω².

    A state before an impact has the reaction before it: m (ẍ − g) along the arm. The file of events
    has all columns of the impacts.
    """
    model, step, _ = hall
    high = thrown(model, [0, 0, 50, 1, 0, 50], [0.0] * 6)
    run = step.integrate(high, dt=1e-3, t_end=2)
    hits, inertia = run.impacts["end_lower"], 0.2 + 2 * 0.25
    assert len(hits) == 2
    assert not len(run.impacts["end_upper"])
    squared = 2 * 2 * 9.81 * 0.5 * (np.cos(0.2) - np.cos(0.5)) / inertia
    lost = inertia / 2 * 0.4375 * squared * 0.5625**np.arange(2)
    assert hits.energy_lost == pytest.approx(lost, rel=1e-9)
    hinge, row = run.joint("hinge"), hits.steps[0]
    turn, rate, force = hinge.angle(), hinge.rate(), hinge.force()
    along = -2 * (9.81 * np.cos(turn) + 0.5 * rate**2)
    assert abs(along[row + 1] - along[row]) > 1
    radial = -force[:, 0] * np.sin(turn) - force[:, 2] * np.cos(turn)
    assert np.abs(radial - along)[[row - 1, row, row + 1]].max() < 1e-5  # to dt²
    assert turn.min() > -0.2 - 1e-12
    assert abs(run.energy_error()).max() < 1e-9
    assert scene_of(run, 100).impacts.tolist() == hits.t.tolist()
    for result in (run, step.integrate_ensemble([high, high], dt=1e-3, t_end=2)):
        result.save(tmp_path / "run.csv")
        with (tmp_path / "run.events.csv").open(newline="") as file:
            rows = [row for row in csv.DictReader(file)
                    if row["event"] == "end_lower" and row.get("trajectory", "1") == "1"]
        for name, column in (("time", hits.t), ("impulse", hits.impulse), ("work", hits.work),
                             ("energy_lost", hits.energy_lost)):
            assert [float(row[name]) for row in rows] == column.tolist()
        assert [[float(row[f"{name}_after"]) for name in run.manifest.system.momenta]
                for row in rows] == hits.p.tolist()


def test_a_run_ends_at_a_latch(hall):
    """The run ends as its parabola says, with the momenta that ``model`` then projects."""
    model, step, _ = hall
    run = step.integrate(thrown(model, [1, 0, 50, 1, 5, 50], [4.0, 0, 0, 0, 0, 0]), dt=0.01,
                         t_end=2)
    end = run.impacts["catch"]
    assert end.t == run.t[-1:] == pytest.approx([1], abs=4 * EPS)
    assert np.array_equal(end.p, end.p_before)
    assert run.p[-1, 7:10] == pytest.approx([4, 0, -9.81], abs=64 * EPS)


@pytest.mark.slow  # a stepper, a hundred thousand hits; test_impacts.py has EMS
def test_an_elastic_box_keeps_its_energy():
    """By EMS, each corner's impulse has the last bits that keep H, and steps keep it between."""
    with budget.shared():
        build = gs.Multibody("elastic_box")
        build.body("box", mass=1, inertia=(0.13, 0.34, 0.29), position=(0, 0, 1.5),
                   angular_velocity=(1, 2, 0.5))
        build.contact("table", "box", box=(0.9, 0.5, 0.3))
        model = build.model()
        step = gs.stepper("EMS", system=model)
        step._impact_binding()
    run = step.integrate(model, dt=0.01, steps=3_400_000, every=34_000)
    assert sum(map(len, run.impacts.values())) > 100_000
    assert np.abs(run.energy_error()).max() < 1e-12 * run.energies[0]


#: Housner's block: half its width and height, its moment of inertia, the angle of its diagonal.
HALF, HEIGHT, SLOPE = 0.2, 0.5, np.arctan2(0.2, 0.5)
MOMENT = (HALF**2 + HEIGHT**2) / 3


def rocking_block() -> gs.Multibody:
    """Return a block tilted by half its slope about its right edge; each edge is a latch."""
    build = gs.Multibody("rocking_block")
    c, s = np.cos(SLOPE / 2), np.sin(SLOPE / 2)
    block = build.body(
        "block", mass=1, inertia=[MOMENT] * 3, rotation=Rotation.from_rotvec([0, SLOPE / 2, 0]),
        position=(HALF - c * HALF + s * HEIGHT, 0, s * HALF + c * HEIGHT))
    for side, x in (("right", HALF), ("left", -HALF)):
        build.revolute(f"{side}_pin", build.ground, block, axis_in_space=(0, 1, 0),
                       on_a=(x, 0, 0), on_b=(x, 0, -HEIGHT))
        build.latch(side, block, on_a=(x, 0, -HEIGHT), close=f"{side}_pin")
    return build


@pytest.mark.slow  # a stepper an edge; one latch is that of a ball above
def test_a_block_rocks_from_latch_to_latch():
    """Rates fall by Housner's 1 - 1.5 sin^2; amplitudes and first hit have their closed forms.

    (Housner 1963, The behavior of inverted pendulum structures during earthquakes.)
    """
    ratio = 1 - 1.5 * np.sin(SLOPE)**2
    build, start, t, before = rocking_block(), None, 0.0, None
    amplitudes = []
    for k in range(5):
        model = build.model(closed=("right", "left")[k % 2], start=start)
        with budget.shared():
            step = gs.stepper("G-L", 4, system=model)
            step._impact_binding()
        run = step.integrate(model.start.replace(t=t), dt=0.01, t_end=t + 2)
        impact = run.impacts[("left", "right")[k % 2]]
        assert impact.t == run.t[-1:]
        assert impact.p == pytest.approx(impact.p_before, abs=0)
        rates = run.body("block").angular_velocity()[[0, -1], 1]
        if before is None:
            assert run.t[-1] == pytest.approx(0.357810995370, abs=1e-12)
        else:
            assert rates[0] / before == pytest.approx(ratio, abs=2 * EPS)
            rise = 2 * MOMENT * rates[0]**2 / (9.81 * np.hypot(HALF, HEIGHT))
            amplitudes.append(SLOPE - np.arccos(np.cos(SLOPE) + rise))
        start, t, before = run[-1], run.t[-1], rates[1]
    assert amplitudes == pytest.approx(
        [.104370449361, .061783331499, .037614679434, .023218124964], abs=1e-11)


def test_a_latch_closes_at_the_time_of_the_start_with_the_masses_of_the_run():
    # A point is caught by one that moves as it does: at t = 2 both are at x = 2, at 1 m/s.
    build = gs.Multibody("catch", gravity=(0, 0, 0))
    hand = build.moving_point("hand", (build.time, 0, 0))
    ball = build.point_mass("ball", mass=3.0, position=(2.0, 0, 0))
    build.point_mass("other", mass=1.0)
    build.latch("grip", gap=ball.x[0] - build.time,
                close=build.ball("hold", hand, ball, on_a=(0, 0, 0), on_b=(0, 0, 0)))
    model = build.model()
    with pytest.raises(InputError, match="'hold: x'"):
        build.model(closed="grip", start=model)
    closed = build.model(closed="grip", start=model.start.replace(t=2.0))
    assert closed.q0.tolist() == model.q0.tolist()
    assert closed.p0[:3] == pytest.approx([3.0, 0, 0], abs=4 * EPS)
    # Points of 3 and 1 kg that meet at 1 m/s and at rest go on together at 0.75 m/s.
    build = gs.Multibody("coupling", gravity=(0, 0, 0))
    a, b = build.point_mass("a", mass=1.0), build.point_mass("b", mass=1.0)
    build.latch("grip", gap=b.x[0] - a.x[0],
                close=build.ball("hold", a, b, on_a=(0, 0, 0), on_b=(0, 0, 0)))
    start = build.model().start.replace(parameters={"a_m": 3.0}, p=[3.0, 0, 0, 0, 0, 0])
    closed = build.model(closed="grip", start=start)
    assert closed.p0 == pytest.approx([2.25, 0, 0, 0.75, 0, 0], abs=4 * EPS)
    assert closed.parameters["a_m"] == 3.0
    assert closed.parameters["b_m"] == 1.0
    build = gs.Multibody("throw")
    build.point_mass("ball", mass=3.0)
    model = build.model(start=gs.Start([1, 2, 3], [4, 5, 6]))
    assert model.q0.tolist() == [1, 2, 3]
    assert model.p0.tolist() == [4, 5, 6]


@pytest.mark.parametrize(("angle", "word"), [
    (np.pi, "'dock'.*120"), (np.pi / 2, "'dock: turn x'.*open")])
def test_a_latch_closes_on_a_fixed_joint_at_its_rotation_alone(angle, word):
    """A latch half or a quarter turn off is refused; half a turn off the sines are 0, too."""
    build = gs.Multibody("docking", gravity=(0, 0, 0))
    bodies = [build.body(name, mass=1, inertia=(1, 1, 1), position=(x, 0, 0))
              for name, x in (("a", 0), ("b", 1))]
    build.fixed("dock", *bodies, on_a=(0.5, 0, 0), on_b=(-0.5, 0, 0))
    build.latch("latch", *bodies, radius=0.5, close="dock")
    model = build.model()
    q = model.q0.copy()
    assert build.model(closed="latch", start=model).system.m == 2 + 6
    q[7:11] = np.cos(angle / 2), np.sin(angle / 2), 0, 0
    with pytest.raises(InputError, match=word):
        build.model(closed="latch", start=gs.Start(q, model.p0))


def test_latches_names_and_stops_are_refused():
    build = rocking_block()
    model = build.model(closed="right")
    build.revolute("loose", build.ground, "block", axis_in_space=(0, 1, 0))
    build.latch("loop", "block", close=["loose"])
    for call, word in (
            (lambda: build.model(closed="left"), "start=run"),
            (lambda: build.model(closed="up"), "up"),
            (lambda: build.model(closed="loop"), "on_a"),
            (lambda: build.model(closed="right", start=gs.Start([0.0], [0.0])), "q of start"),
            (lambda: build.model(start=3), "start"),
            (lambda: build.latch("more", "block", close="pin"), "pin"),
            (lambda: build.latch("more", "block", close="loose", restitution=1), "restitution"),
            (lambda: gs.Impact("floor", terminal=1), "terminal")):
        with pytest.raises(InputError, match=word):
            call()
    opened = build.model(start=model)
    assert opened.system.m == 1
    assert [impact.terminal for impact in opened.events] == [True] * 3
    build = two_bodies()
    build.revolute("hinge", "a", "b", axis_on_body=(1, 0, 0), on_a=(0, 0, 0), on_b=(0, 0, 0))
    build.contact("floor", "a")
    build.quantity("height", 1)
    for call, word in ((lambda: build.contact("floor", "b"), "floor"),
                       (lambda: build.contact("height", "b"), "height"),
                       (lambda: build.quantity("floor", 1), "floor"),
                       (lambda: build.quantity("height", 2), "height"),
                       (lambda: build.stop("end", "hinge"), "lower"),
                       (lambda: build.stop("end", "hinge", lower=2, upper=1), "upper = 1"),
                       (lambda: build.stop("end", "knee", lower=2), "knee")):
        with pytest.raises(InputError, match=word):
            call()


REFUSED = {
    "gap and body": ({"a": "a", "gap": sp.Symbol("a_x", real=True)}, "body"),
    "neither": ({}, "gap="),
    "gap and radius": ({"gap": sp.Symbol("a_x", real=True), "radius": 0.1}, "radius"),
    "gap and box": ({"gap": sp.Symbol("a_x", real=True), "box": (1, 1, 1), "b": "b"}, "b, box"),
    "gap and points": ({"gap": sp.Symbol("a_x", real=True), "on_a": (0, 0, 1), "on_b": (0, 0, 1),
                        "normal": (1, 0, 0)}, "on_a, on_b, normal"),
    "restitution": ({"a": "a", "restitution": 1.2}, "1.2"),
    "parameter": ({"a": "a", "restitution": "f"}, "'f'"), "body": ({"a": "c"}, "'c'"),
    "points": ({"a": "a", "on_a": (1, 2)}, "on_a"), "box": ({"a": "a", "box": (1, 0, 1)}, "box"),
    "normal": ({"a": "a", "normal": (0, 0, 0)}, "normal"),
    "radius": ({"a": "a", "radius": -1}, "-1"), "radii": ({"a": "a", "radius": [1, 2]}, "radius"),
    "two points": ({"a": "a", "b": "b"}, "radius="),
}


@pytest.mark.parametrize(("arguments", "word"), REFUSED.values(), ids=REFUSED)
def test_contacts_are_refused(arguments, word):
    with pytest.raises(InputError, match=word):
        two_bodies().contact("floor", **arguments)


FILE = """
name = "tossed"
bodies = [
    {name = "box", mass = 1, inertia = [0.1, 0.2, 0.15], position = [0, 0, 2]},
    {name = "arm", mass = 1, inertia = [0.1, 0.2, 0.15], position = [0, 3, -0.5]},
]
joints = [
    {name = "elbow", type = "revolute", bodies = ["ground", "arm"], axis = [0, 1, 0], \
     at = [0, 3, 0]},
    {name = "grip", type = "ball", bodies = ["box", "arm"], on_a = [0, 0, 0], on_b = [0, 0, 0]},
]
contacts = [
    {name = "floor", bodies = ["box"], on_a = [[0, 0, -0.5], [0.5, 0, 0]], on_b = [0, 0, 0.5], \
     normal = [0, 0, 2], radius = 0.25, restitution = "e"},
    {name = "click", bodies = ["box", "arm"], radius = [0.25, 0.5]},
    {name = "block", bodies = ["box"], box = [0.5, 0.25, 0.125]},
    {name = "free", gap = ["box_z + 1 - t", "elbow_angle + 2"]}, {name = "roof", gap = "h - box_z"},
]
latches = [
    {name = "dock", bodies = ["box", "arm"], on_a = [0, 0, 0.5], close = ["grip"], radius = 0.5},
]
stops = [{name = "end", joint = "elbow", lower = "-30 deg", upper = "2*h", restitution = 0.5}]
parameters = {e = 0.5, h = 5}
"""


def test_a_file_has_contacts_and_stops_whose_slides_are_no_angles(tmp_path):
    """A file has the gaps of the builder, and restitutions that name parameters."""
    path = tmp_path / "tossed.toml"
    path.write_text(FILE)
    model = gs.load_model(path)
    expected = {"floor_1": 0.75, "floor_2": 1.25, "click": np.hypot(3, 2.5) - 0.75, "free_1": 3,
                "free_2": 2, "roof": 3, "end_lower": np.pi / 6, "end_upper": 10,
                "dock": np.sqrt(18) - 1}
    expected |= {f"block_{i}": 2 + 0.125 * (-1)**i for i in range(1, 9)}
    assert gaps(model) == pytest.approx(expected)
    assert {impact.name: impact.restitution for impact in model.events if impact.restitution != 1
            } == {"floor_1": "e", "floor_2": "e", "end_lower": 0.5, "end_upper": 0.5, "dock": 0}
    assert [impact.name for impact in model.events if impact.terminal] == ["dock"]
    path = tmp_path / "slid.toml"
    text = FILE.replace('"revolute"', '"prismatic"')
    path.write_text(text.replace("elbow_angle", "elbow_travel"))
    with pytest.raises(InputError, match="unit deg"):
        gs.load_model(path)


@pytest.mark.parametrize(("old", "new", "word"), [
    ('restitution = "e"', "restitution = 1.5", "1.5"),
    ('restitution = "e"', 'restitution = "f"', "restitution"),
    ("radius = 0.25", "radious = 0.25", "radious"),
    ('bodies = ["box", "arm"]', 'bodies = ["box", "leg"]', "leg"),
    ('joint = "elbow"', 'joint = "knee"', "knee"),
    ('gap = "h - box_z"', 'gap = "h - box_y0"', "box_y0"),
    (', gap = "h - box_z"', "", "gap"),
    ('close = ["grip"]', 'close = ["grasp"]', "grasp"),
    ('close = ["grip"], ', "", "close"),
    ('lower = "-30 deg"', 'lower = "700 deg"', "upper"),
])
def test_tables_are_refused(tmp_path, old, new, word):
    assert old in FILE
    path = tmp_path / "tossed.toml"
    path.write_text(FILE.replace(old, new))
    with pytest.raises(InputError, match=word) as error:
        gs.load_model(path)
    assert "tossed.toml" in str(error.value)


def test_the_command_has_the_impacts_of_a_file(hall, tmp_path, gyrospark):
    """The command prints and lists impacts and how bodies come to rest, and refuses an event."""
    command = ("run", hall[2], "--scheme", "G-L", "--stages", "2")
    assert "3 times" in gyrospark(*command).stdout
    rested = gyrospark(*command, "--steps", "200", "--json", "--out", tmp_path / "rest.zarr")
    impacts = rested.document["impacts"]["floor_a"]
    assert gs.load(tmp_path / "rest.zarr").impacts["floor_a"].t.tolist() == impacts["t"]
    assert impacts["t"][:3] == pytest.approx(np.sqrt(2 / 9.81) * np.array([1, 2, 2.5]), abs=8 * EPS)
    assert impacts["energy_lost"][:3] == pytest.approx(9.81 * 0.75 * 0.25**np.arange(3))
    assert rested.document["ended"]["t"] == pytest.approx(3 * np.sqrt(2 / 9.81), abs=1e-7)
    alone = gyrospark(*command, "--steps", "200", "--json")
    assert rested.document["t_end"] == alone.document["t_end"] == rested.document["ended"]["t"]
    assert alone.document["q"] == rested.document["q"]
    refused = gyrospark(*command, "--event", "a_z=1")
    assert refused.code == 2
    assert "events" in refused.stderr


def test_a_certificate_is_of_the_motion_without_impacts(hall):
    """Its run has all steps, and leads back, which an impact of e < 1 does not."""
    model = gs.load_model(hall[2])
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of a run that ends where a gap stays closed
        certificate = gs.certify(model, "G-L", 2, dt=0.01, steps=200)
    assert certificate.holds
    assert certificate.line("reversal").holds
    assert certificate.line("energy").value < 1e-7


@pytest.mark.slow  # three bodies, to and fro
def test_tops_that_touch_at_rest_stay_so_and_lead_back():
    """Newton's cradle has an impact a gap each half period and none at rest, also run back.

    Rates of the tops at rest are round-off, as are their gaps, which depend on quaternions whose
    large components have a gradient of 0.
    """
    with budget.shared():
        build = gs.Multibody("cradle", gravity=(0, 0, -9.81))
        for i in range(3):
            build.top(f"top_{i}", mass=1, inertia=(1.0, 1.0, 0.01), at=(0.2 * i, 0, 0),
                      centre=(0, 0, -1), quaternion=(np.cos(0.3), 0, np.sin(0.3), 0) if i == 0
                      else (1, 0, 0, 0))
        for i in range(2):
            build.contact(f"gap_{i}", f"top_{i}", f"top_{i + 1}", radius=0.1, on_a=(0, 0, -1),
                          on_b=(0, 0, -1))
        model = build.model()
        step = gs.stepper("G-L", stages=2, system=model)
        step._impact_binding()
    run = step.integrate(model, dt=0.01, t_end=5)
    assert [len(impacts) for impacts in run.impacts.values()] == [5, 5]
    period = np.diff(run.impacts["gap_0"].t)
    assert np.ptp(period) < 1e-9
    # I_1 = 1 about the pivot, as given: T = 4 K(sin(θ/2)) √(I_1/(m g l)).
    assert period[0] == pytest.approx(2 * ellipk(np.sin(0.3)**2) / np.sqrt(9.81), rel=1e-7)
    back = step.integrate(run[-1], dt=-0.01, t_end=0)
    assert [len(impacts) for impacts in back.impacts.values()] == [5, 5]
    assert np.abs(back.q[-1] - model.q0).max() < 1e-14
    assert np.abs(back.p[-1] - model.p0).max() < 1e-12
    reversed_run = step.integrate(model.start.replace(q=run.q[-1], p=-run.p[-1]), dt=0.01, t_end=5)
    assert np.abs(reversed_run.q[-1] - model.q0).max() < 1e-14
