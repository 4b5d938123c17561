"""The benchmarks: fair turns, medians, errors, rows, tables, files. No times are asserted."""

from __future__ import annotations

import ast
import importlib.util
import json
import sys

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import gyrospark as gs
from benchmarks import (
    adaptive,
    attitudes,
    bodies,
    equal_error,
    fast_top,
    gradients,
    peers,
    reference_states,
    rows,
    scale,
    sweeps,
    timing,
    tops,
)
from benchmarks.__main__ import BENCHMARKS, main
from benchmarks.peers import optional, ours
from benchmarks.peers.entry import PeerEntry
from benchmarks.peers.gradient_job import of_euler, top_start
from benchmarks.rows import Choice, Entry, Prepared, Row
from benchmarks.scenes import scene_of
from processes import ROOT

QUICK = Choice(quick=True, rounds=1)
EPS = float(np.finfo(float).eps)


def still(t_end):
    """Return the start of a top as its end: it does not move."""
    return tops.state_of(tops.tops()[0])


def prepared(run, dt=None, t_end=1.0, limit=60.0):
    return fast_top._prepared(PeerEntry("still", "as it is", lambda: run, dt), t_end, limit)


#: Modules without a public name: for derivatives of two extensions of a loss, and for writing
#: digits into the package.
INSIDE = {"gradients.py": {"gyrospark.runtime.derivatives.tangent_space"}, "make_digits.py": {
    "gyrospark.references.problem", "gyrospark.references.problem_registry",
    "gyrospark.references.true_digits", "gyrospark.references.work_precision",
    "gyrospark.runtime.bindings.binary128", "gyrospark.runtime.bindings.real_numbers"}}


@pytest.mark.parametrize("path", sorted((ROOT / "benchmarks").rglob("*.py")),
                         ids=lambda path: path.stem)
def test_what_comes_in_is_public(path):
    """Benchmarks import gyrospark and its public modules only."""
    modules = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            modules.add(node.module)
    inside = {name for name in modules if name.startswith("gyrospark.")}
    assert inside - {"gyrospark.references", "gyrospark.errors"} == INSIDE.get(path.name, set())


def test_jobs_take_turns():
    order = []
    jobs = {name: (lambda name=name: order.append(name)) for name in "abc"}
    timing.alternate(jobs, 3)
    assert "".join(order) == "abccbaabc"


def test_times_are_the_clocks():
    ticks = iter([0.0, 1.0, 1.0, 4.0, 10.0, 12.0])
    sample = timing.alternate({"a": lambda: None}, 3, lambda: next(ticks))["a"]
    assert sample.seconds == (1.0, 3.0, 2.0)
    assert sample.median == 2.0
    assert sample.spread == 0.5
    assert sample.per(2.0).median == 1.0
    assert len(sample.wall_seconds) == 3
    assert sample.per(2.0).wall == sample.wall / 2


def test_a_job_is_repeated_until_it_takes_long_enough():
    results = []
    repeat, times = timing.repeated(lambda: results.append(sum(range(1000))), 2e-3)
    assert times > 1
    results.clear()
    repeat()
    assert len(results) == times


def entry(program, setting, cost=1.0, error=0.0, quick=True):
    return Entry(program, setting, lambda: Prepared(
        {"error": error}, {"run": lambda: sum(range(100))}, lambda seconds: {"cost": cost}), quick)


def test_each_entry_has_a_row():
    """A missing program says how to install it; a broken entry of ours has failed."""
    def broken():
        raise ZeroDivisionError("oh")

    with pytest.raises(optional.Unavailable, match=r"pip install no-such\)"):
        optional.need("no_such_module", "no-such")
    choice = Choice(("gyrospark", "gone", "odd"), quick=True, rounds=2)
    table = rows.contest("case", [
        entry("gyrospark", "a", 3.0, 1e-9), entry("gyrospark", "slow", quick=False),
        entry("elsewhere", "b"), Entry("gyrospark", "c", broken), Entry("odd", "d", broken),
        Entry("gone", "e", lambda: optional.need("no_such_module"))], choice)
    assert [row.setting for row in table] == ["a", "c", "d", "e"]
    assert table[0].numbers["cost"] == 3.0
    assert table[0].numbers["error"] == 1e-9
    assert table[0].numbers["±"] >= 0
    assert len(table[0].samples["run"]) == 2
    assert table[0].program == f"gyrospark {gs.__version__}"
    assert [row.failed for row in table] == [False, True, False, False]
    assert "ZeroDivisionError('oh')" in table[1].note
    assert "pip install no_such_module)" in table[3].note


def test_a_table_divides_costs_by_those_of_its_base():
    table = [Row("x", "a 1", "s=2 Δt=0.1", {"cost": 4.0, "error": 1e-9}),
             Row("x", "b 1", "tol 1e-9", {"cost": 2.0}), Row("x", "c", "", note="not installed"),
             Row("y", "b 1", "tol 1e-9", {"cost": 5.0})]
    head, *lines = rows.table(table)
    assert head == ["case", "program", "setting", "cost", "error", "× base"]
    assert [line[-1] for line in lines] == ["1", "0.5", "–", "1"]
    assert [line[-1] for line in rows.table(table, "b tol")[1:]] == ["2", "1", "–", "1"]
    assert lines[2][2:5] == [" (not installed)", "–", "–"]
    assert rows.markdown([head, *lines]).count("\n") == 6
    assert [row.family for row in table[:2]] == ["a s=2", "b"]


def test_the_cheapest_is_exact_enough():
    table = [Row("x", "a", f"{i}", {"ms": cost, "m": error})
             for i, (cost, error) in enumerate(((1, 1e-3), (2, 1e-5), (3, 1e-6)))]
    assert rows.cheapest(table, "ms", "m", 1e-4) is table[1]
    assert rows.cheapest(table, "ms", "m", 1e-7) is None


def test_a_law_is_the_slope_of_the_logarithms():
    """The slope counts from 8 bodies on; a cost of one size has none."""
    points = {float(N): {"step": 2e-6 * N**1.5, "model": 3.0} for N in (8, 16, 90)} | {
        2.0: {"step": 1.0, "model": 1.0}}
    assert rows.power_laws(points, 8) == pytest.approx({"step": 1.5, "model": 0.0}, abs=1e-12)
    assert rows.power_laws({1.0: {"step": 1.0}}) == {}
    table = [Row("bodies", "gyrospark", f"{N}", {"size": float(N), "step (s)": N**2.0})
             for N in (1, 8, 16)]
    law, = scale.laws(table)
    assert law.numbers == pytest.approx({"step (s)": 2.0}, abs=1e-12)


def test_reference_knows_its_times():
    assert all(reference_states.reference_axes(t).shape == (8, 3) for t in reference_states.TIMES)
    assert {"made with", "checked with"} <= reference_states.about().keys()
    with pytest.raises(gs.InputError, match="1, 10, 100 or 1000"):
        fast_top.top(Choice(t_end=3.0))


def test_rotations_are_those_of_other_code():
    """Rotations agree with SciPy, with q' of a turning body, and with the way back."""
    q = np.random.default_rng(0).normal(size=(9, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    R = attitudes.rotation_matrix(q)
    assert np.abs(R - Rotation.from_quat(q, scalar_first=True).as_matrix()).max() < 4 * EPS
    for quaternion, matrix in zip(q, R, strict=True):
        assert np.abs(np.abs(attitudes.quaternion_of(matrix) @ quaternion) - 1) < 8 * EPS
    J, omega = np.diag([1.0, 2.0, 3.0]), np.array([0.3, -0.2, 0.9])
    p = 2 * np.swapaxes(attitudes.left_matrix(q), -1, -2) @ (J @ omega)
    for inertia in (J, np.diag(J)):
        assert np.abs(attitudes.angular_velocity(q, p, inertia) - omega).max() < 8 * EPS


def test_peers_begin_where_we_do():
    """Energy and Euler's equations agree with the stepper's own H and with Ω' of a short step."""
    top = tops.tops()[0]
    state, step = tops.state_of(top), gs.stepper("G-L", stages=2, rep="gamma")
    H = step.energy(top.q, top.p, parameters=tops.parameters())
    assert tops.energy(state) == pytest.approx(H, rel=1e-15)
    h = 1e-4
    ahead, behind = (step.integrate(top.q, top.p, dt=dt, steps=1, parameters=tops.parameters())
                     for dt in (h, -h))
    slope = (ahead.angular_velocity()[-1] - behind.angular_velocity()[-1]) / (2 * h)
    rates = tops.euler_equations(*state.q, *state.omega, *tops.INERTIA, tops.MGL)
    np.testing.assert_allclose(rates[4:], slope, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(rates[:4], (ahead.q[-1] - behind.q[-1]) / (2 * h), rtol=1e-3,
                               atol=1e-3)


def test_errors_are_those_at_the_end():
    contestant = prepared(still, 0.1)
    distance = reference_states.distance(tops.tops()[0].q[None], 1)[0]
    assert contestant.errors["dx (m)"] == pytest.approx(distance)
    assert max(contestant.errors["ΔH/H"], contestant.errors["|q| − 1"]) < 4 * EPS
    costs = contestant.costs({"run": timing.Sample((2e-6,), (1.0,))})
    assert costs == pytest.approx({"CPU µs/s": 2.0, "ns/step": 200.0})


def test_a_dear_entry_is_not_run_to_its_end(monkeypatch):
    """A hundredth of the entry takes a second, so that it is refused."""
    ends = []

    def dear(t_end):
        ends.append(t_end)
        return still(t_end)

    monkeypatch.setattr(fast_top, "stopwatch", lambda call: call() and 1.0)
    with pytest.raises(optional.Unavailable, match="100 s"):
        prepared(dear, t_end=1000.0, limit=99.0)
    assert set(ends) == {10.0}


@pytest.mark.slow  # other programs, which few machines have
@pytest.mark.parametrize("name", sorted(set(peers.PEERS) - {"gyrospark"}))
def test_quick_peers_arrive(name):
    """Each installed peer ends where the reference ends; the others name the missing package."""
    first = next(candidate for candidate in peers.entries([name]) if candidate.quick)
    try:
        end = first.prepare()(0.1)
    except optional.Unavailable as reason:
        pytest.skip(str(reason))
    exact = ours.prepare("G-L", 3, 1e-3)(0.1)
    assert np.linalg.norm(tops.axis(end.q) - tops.axis(exact.q)) < 1e-3
    np.testing.assert_allclose(end.omega, exact.omega, atol=0.2)


@pytest.mark.parametrize("model", [gs.models.chain(3), gs.models.four_bar()], ids=lambda m: m.name)
def test_joints_hold_both_bodies(model):
    """A point of two bodies does not move at the start, seen from either: ẋ + ω × r agree."""
    scene = scene_of(model)

    def velocity(name, point):
        if not name:
            return np.zeros(3)
        start = scene.bodies[name].start
        omega = attitudes.rotation_matrix(start.q) @ start.omega
        return start.v + np.cross(omega, point - start.x)

    for joint in scene.joints:
        assert velocity(joint.a, joint.at) == pytest.approx(velocity(joint.b, joint.at), abs=1e-13)


@pytest.mark.parametrize("model", [bodies.arm(3), bodies.tree(3)], ids=lambda m: m.name)
def test_centres_are_those_of_the_system(model):
    """Centres agree with SymPy's frames and points, at angles that are all different."""
    system, q = model.system(), np.array([0.3, -0.5, 0.8])
    values = dict(zip(system.q, q, strict=True)) | {
        sp.Symbol("l", positive=True): bodies._VALUES["l"]}
    moving = [body for body in system.bodies if body.name != "ground"]
    for body, centre in zip(moving, model.centres(q), strict=True):
        position = body.masscenter.pos_from(system.fixed_point).to_matrix(system.frame)
        assert centre == pytest.approx(np.array(position.subs(values), dtype=float).ravel(),
                                       abs=1e-15)


def test_the_ensemble_does_what_the_sweep_does():
    """Both have the same bits; otherwise shares mean nothing."""
    ends = sweeps.ensemble_job(2, 9, 20)()
    swept = gs.sweep(gs.problems.fast_top(), **sweeps.sweep_arguments(2, 9, 20))
    for values, swept_values in ((ends.q, swept.q), (ends.p, swept.p)):
        assert np.array_equal(values[:, -1].reshape(9, 9, 4),
                              np.asarray(swept_values).swapaxes(0, 1))


@pytest.mark.parametrize("e", [0.3, 0.9])
def test_orbits_are_in_closed_form(e):
    """Half a period leads to the apocentre; a quarter in E, and the law of areas."""
    position = adaptive.kepler(e, 1.0).position
    assert np.abs(position(np.pi) - [-1 - e, 0.0]).max() < 1e-13
    assert np.abs(position(np.pi / 2 - e) - [-e, np.sqrt(1 - e**2)]).max() < 1e-13


def test_errors_fall_with_the_step():
    """The order is 6: half the step has 2⁻⁶ of the error, against Jacobi's functions."""
    problem = equal_error.PROBLEMS["free body"]
    coarse, fine = equal_error._Job("free body", "gyrospark", problem.reference(), (
        "3-G-L Δt=0.5", "3-G-L Δt=0.25"), quick=True)()
    assert coarse.numbers["error"] / fine.numbers["error"] == pytest.approx(64, rel=0.1)
    assert coarse.numbers["CPU ms"] > 0


def test_the_double_pendulum_ends_where_its_digits_say():
    """DOP853 on Lagrange's equations in angles and their rates ends there."""
    def rates(t, x):
        a, b, da, db = x
        c, s = np.cos(a - b), np.sin(a - b)
        pull = [-s * db**2 - 2 * 9.81 * np.sin(a), s * da**2 - 9.81 * np.sin(b)]
        return [da, db, *np.linalg.solve([[2, c], [c, 1]], pull)]

    end = solve_ivp(rates, (0, equal_error._SWINGS), [*equal_error._ANGLES, 0, 0],
                    method="DOP853", rtol=1e-9, atol=1e-9).y[:2, -1]
    assert end == pytest.approx([float(x) for x in equal_error._ANGLES_AT_END], abs=1e-7)


def test_missing_programs_are_named(monkeypatch):
    """Missing programs and programs that cannot compute a problem are no failure."""
    for module in ("heyoka", "numba", "diffrax", "jax"):
        monkeypatch.setitem(sys.modules, module, None)
    choice = Choice(("heyoka", "scipy", "diffrax", "mujoco"), quick=True, rounds=1,
                    only="Kepler, e = 0.1")
    table = equal_error.peers(choice)
    assert [row.program.split()[0] for row in table] == ["heyoka", "scipy", "diffrax"]
    assert all("pip install" in row.note and not row.failed for row in table)
    lines = equal_error.levels(table)["Kepler, e = 0.1"]
    assert ["pip install" in line[1] for line in lines[1:]] == [True] * 3 + [False] * 2
    assert [line[0] for line in lines[4:]] == ["mujoco", "exudyn"]


def test_the_cheapest_at_equal_error_are_compared():
    """Only settings that are exact enough are compared; one cheaper than gyrospark's is a loss."""
    def row(program, setting, cost, error):
        return Row("free body", program, setting, {"CPU ms": cost, "error": error})

    table = [row("gyrospark 1", "long", 2.0, 1e-7), row("gyrospark 1", "short", 4.0, 1e-11),
             row("heyoka 7", "a", 1.0, 1e-5), row("heyoka 7", "b", 6.0, 1e-11),
             row("scipy 1", "c", 1.5, 1e-6)]
    (head, *lines) = equal_error.levels(table)["free body"]
    assert head == ["program", "1e-06", "1e-10", "1e-13"]
    assert lines[1] == ["heyoka 7", "6 ms, 3 ×, b", "6 ms, 1.5 ×, b", "–"]
    assert lines[2] == ["scipy 1", "1.5 ms, 0.75 ×, c", "–", "–"]
    assert equal_error.losses(table)[1:] == [["free body", "1e-06", "scipy 1", "0.75"]]
    near_cheapest = equal_error._near_cheapest(table[:2], (1e-6, 1e-10))
    assert near_cheapest == ("long", "short")
    dear = row("gyrospark 1", "dear", 7.0, 1e-12)
    assert equal_error._near_cheapest([*table[:2], dear], (1e-6,)) == (
        "long",)
    text = equal_error.page(table, QUICK, {
        "processor": "P", "cores": 2, "load": 0.5, "compiler": "C"})
    assert "| heyoka 7 | 6 ms, 3 ×, b |" in text


@pytest.mark.slow  # compiles derivatives for speed
def test_gradients_of_ours_and_of_what_is_missing(monkeypatch):
    """Adjoint and tangents agree with long double; each missing program says so in its row."""
    for module in ("heyoka", "diffrax", "jax", "casadi", "mujoco"):
        monkeypatch.setitem(sys.modules, module, None)
    table = gradients.gradients(Choice(peers.PROGRAMS, quick=True, rounds=1))
    our_rows = [row for row in table if row.program.startswith("gyrospark")]
    assert [row.setting.split()[2] for row in our_rows] == ["adjoint", "tangents"]
    for row in our_rows:
        assert row.numbers["truth off by"] < 1e-12 < row.numbers["error"] < 1e-6
    assert our_rows[0].numbers["by start"] == pytest.approx(
        our_rows[1].numbers["by start"], rel=1e-3)
    missing = [row for row in table if row not in our_rows]
    assert {row.program.split()[0] for row in missing} == {"heyoka", "diffrax", "casadi", "mujoco"}
    assert all("pip install" in row.note and not row.failed for row in missing)


def test_gradients_by_spin_are_those_by_momentum():
    """Along any (dq, dp) and change of moments they agree with differences of Ω(q, p, I)."""
    random = np.random.default_rng(0)
    by_state, by_values = random.normal(size=7), random.normal(size=4)
    gradient = of_euler(by_state, by_values)
    start, step = tops.tops()[0], 1e-6
    dq, dp, dI = random.normal(size=4), random.normal(size=4) * 0.1, random.normal(size=3) * 1e-3

    def state(h: float) -> np.ndarray:
        moved = type(start)(start.q + h * dq, start.p + h * dp)
        spin = tops.spin_of(moved) * tops.INERTIA / (tops.INERTIA + h * dI)
        return np.concatenate([moved.q, spin])

    assert np.array_equal(state(0.0), top_start())
    rate = (state(step) - state(-step)) / (2 * step)
    change = gradient.q @ dq + gradient.p @ dp + gradient.parameters[:3] @ dI
    assert change == pytest.approx(by_state @ rate + by_values[:3] @ dI, rel=1e-7)


def test_command_writes_json_and_a_picture(tmp_path, capsys):
    drawn = importlib.util.find_spec("matplotlib") is not None
    out = ["--out", str(tmp_path / "new")] if drawn else []
    assert main(["top", "--quick", "--programs", "gyrospark", "--rounds", "1", "--json", *out]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document.keys() == {"about", "top"}
    assert {"gyrospark", "compiler", "processor", "packages"} <= document["about"].keys()
    assert document["top"][0]["samples"]
    if drawn:
        assert document == json.loads((tmp_path / "new/bench.json").read_text(encoding="utf-8"))
        assert (tmp_path / "new/top.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_command_does_all(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    assert main(["all", "--quick", "--programs", "gyrospark", "--rounds", "1", "--out",
                 str(tmp_path)]) == 0
    output = capsys.readouterr().out
    of_cases = {"peers", "scale"}  # whose tables have the titles of their cases
    assert all(benchmark.about in output or name in of_cases
               for name, benchmark in BENCHMARKS.items())
    assert "where another program is cheaper" in output
    document = json.loads((tmp_path / "bench.json").read_text(encoding="utf-8"))
    assert document.keys() == {"about", *BENCHMARKS}
    for page in ("peers.md", "scale.md", "references.md", "reference_robots.md"):
        assert (tmp_path / page).read_text(encoding="utf-8").startswith("# ")


@pytest.mark.parametrize(("arguments", "named"), [
    (["nonsense"], "nonsense"), (["--programs", "gyrospark,matlab"], "matlab"),
    (["top", "--t-end", "3", "--programs", "gyrospark"], "10"), (["--rounds", "0"], "--rounds"),
    (["--rounds", "many"], "many")])
def test_command_refuses_in_a_sentence(arguments, named, capsys):
    with pytest.raises((SystemExit, gs.InputError)) as error:
        main(arguments)
    assert named in str(error.value) + capsys.readouterr().err
