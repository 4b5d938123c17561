"""The benchmarks' machinery: fair turns, medians, errors, rows, files. No times are asserted."""

from __future__ import annotations

import importlib.util
import json
import sys

import numpy as np
import pytest

import gyrospark as gs
from benchmarks import (
    drift,
    ensembles,
    events,
    growth,
    joined_bodies,
    peer_linkages,
    peers,
    pictures,
    reference_states,
    scaling,
    steps,
    storing,
    sweeping,
    timing,
    tops,
)
from benchmarks.__main__ import _print_accuracies, main
from benchmarks.contest import ContestRow, Limits, compete, judged, with_ratios
from benchmarks.peers import optional, ours
from benchmarks.peers.entry import PeerEntry
from gyrospark.core.extras import install
from gyrospark.runtime.rigid_body.quaternion import rotation_matrix
from gyrospark.sweeps.run_sweep import run_study

SHORT = Limits(t_end=1.0, rounds=3, least=1e-4, most=60.0)


def entry(name: str, run, dt: float | None = None) -> PeerEntry:
    return PeerEntry(name, "1.0", "as it is", lambda: run, dt)


def still(t_end: float) -> tops.TopState:
    """A top that does not move."""
    return tops.state_of(tops.tops()[0])


def is_picture(path) -> bool:
    return path.read_bytes().startswith(b"\x89PNG")


def drawn(draw, rows, folder) -> bool:
    """Whether a picture of rows is written; True without matplotlib."""
    if importlib.util.find_spec("matplotlib") is None:
        return True
    draw(rows, folder / "drawn.png")
    return is_picture(folder / "drawn.png")


# ---------------------------------------------------------------- timing


def test_jobs_take_turns():
    seen = []
    jobs = {name: (lambda name=name: seen.append(name)) for name in "abc"}
    timing.alternate(jobs, 3)
    assert "".join(seen) == "abccbaabc"


def test_times_are_the_clocks():
    ticks = iter([0.0, 1.0, 1.0, 4.0, 10.0, 12.0])
    sample = timing.alternate({"a": lambda: None}, 3, lambda: next(ticks))["a"]
    assert sample.seconds == (1.0, 3.0, 2.0)
    assert sample.median == 2.0
    assert sample.spread == 0.5
    assert sample.per(2.0).median == 1.0


# ---------------------------------------------------------------- reference


def test_reference_knows_its_times():
    assert all(reference_states.reference_axes(t).shape == (8, 3) for t in reference_states.TIMES)
    assert reference_states.has(10.0)
    assert not reference_states.has(3.0)
    assert {"made with", "checked with"} <= reference_states.about().keys()


def test_peers_begin_where_we_do():
    """Energy and Euler's equations against the stepper's own H and against Ω' of a short step."""
    top = tops.tops()[0]
    state, step = tops.state_of(top), gs.stepper("G-L", stages=2, rep="gamma")
    H = step.energy(top.q, top.p, parameters=tops.parameters())
    assert tops.energy(state) == pytest.approx(H, rel=1e-15)
    h = 1e-4
    ahead = step.integrate(top.q, top.p, dt=h, steps=1, parameters=tops.parameters())
    back = step.integrate(top.q, top.p, dt=-h, steps=1, parameters=tops.parameters())
    slope = (ahead.angular_velocity()[-1] - back.angular_velocity()[-1]) / (2 * h)
    found = tops.euler_equations(*state.q, *state.omega, *tops.INERTIA, tops.MGL)
    np.testing.assert_allclose(found[4:], slope, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(found[:4], (ahead.q[-1] - back.q[-1]) / (2 * h), rtol=1e-3,
                               atol=1e-3)


# ---------------------------------------------------------------- contest


def test_a_row_of_each_entry():
    rows = compete([entry("still", still, 0.1)], SHORT)
    assert [row.name for row in rows] == ["still as it is"]
    assert rows[0].error == pytest.approx(reference_states.distance(tops.tops()[0].q[None], 1)[0])
    assert rows[0].energy_error < 1e-15
    assert rows[0].norm_error < 1e-15
    assert len(rows[0].samples) == 3
    assert rows[0].ns_per_step == pytest.approx(rows[0].us_per_second * 100)


def test_a_missing_peer_is_a_row():
    with pytest.raises(optional.Unavailable, match=r"pip install no-such\)"):
        optional.need("no_such_module", "no-such")
    missing = PeerEntry("gone", "", "x", lambda: optional.need("no_such_module"))
    rows = compete([missing, entry("still", still)], SHORT)
    assert rows[0].us_per_second is None
    assert "pip install no_such_module)" in rows[0].note
    assert not rows[0].failed
    assert rows[1].us_per_second is not None


def test_a_peer_that_breaks_is_a_row():
    def broken(t_end):
        raise ZeroDivisionError("oh")

    row, run = judged(entry("broken", broken), SHORT)
    assert run is None
    assert row.failed
    assert "ZeroDivisionError('oh')" in row.note


def test_a_dear_entry_is_not_run_to_its_end():
    asked = []

    def dear(t_end):
        asked.append(t_end)
        return still(t_end)

    row, run = judged(entry("dear", dear), Limits(t_end=1000.0, most=0.0))
    assert run is None
    assert max(asked) < 1000
    assert "its end" in row.note
    assert row.us_per_second > 0
    assert row.error is None


def test_ratios_are_over_the_base():
    rows = [ContestRow("a", "", "x", 1.0, us_per_second=4.0), ContestRow("b", "", "x", 1.0),
            ContestRow("c", "", "y", 1.0, us_per_second=2.0)]
    assert [row.ratio for row in with_ratios(rows)] == [1.0, None, 0.5]
    assert [row.ratio for row in with_ratios(rows, "c y")] == [2.0, None, 1.0]
    assert [row.ratio for row in with_ratios(rows[1:2])] == [None]


@pytest.mark.slow  # other programs, which few machines have
@pytest.mark.parametrize("name", sorted(set(peers.PEERS) - {"gyrospark"}))
def test_quick_peers_arrive(name):
    """Each peer that is installed goes where the reference is; the others say what is missing."""
    first = peers.entries([name], quick=True)[0]
    try:
        end = first.prepare()(0.1)
    except optional.Unavailable as reason:
        pytest.skip(str(reason))
    exact = ours.prepare(ours.Method("G-L", 3, 1e-3), "newton")(0.1)
    assert np.linalg.norm(tops.axis(end.q) - tops.axis(exact.q)) < 1e-3
    np.testing.assert_allclose(end.omega, exact.omega, atol=0.2)


# ---------------------------------------------------------------- steps, ensembles, drift


def test_solvers_of_a_step_agree():
    variant = steps.Variant("G-L γ", "G-L", "gamma", gs.problems.fast_top, (2,))
    cell, = steps.compare_steps([variant], [1e-3], 2, 1e-4)
    assert cell.ns.keys() == {s for s in ours.SOLVERS if ours.available(s)}
    assert all(size < 1e-12 for size in cell.difference.values())
    assert cell.notes.keys() == set(ours.SOLVERS) - cell.ns.keys()
    assert cell.ratio["auto"] == pytest.approx(cell.ns["newton"] / cell.ns["auto"])


def test_ensembles_report_the_worst():
    found = [e for e in ensembles.ensemble_entries(8) if e.name == "gyrospark G-L s=4 Δt=0.01, "
             "1 worker"]
    row, = ensembles.compare_ensembles(found, Limits(t_end=1.0, rounds=1), 8)
    assert row.trajectories == 8
    assert 1e-12 < row.row.error < 1e-7
    assert row.wall_us_per_second is not None


def test_drift_goes_through_the_decades(tmp_path):
    assert drift.drift_times(10) == [1, 2, 5, 10]
    assert drift.drift_times(1000)[-3:] == [200, 500, 1000]
    course, = drift.follow([entry("still", still)], Limits(t_end=10.0))
    assert [point.t for point in course.points] == [1, 2, 5, 10]
    assert [point.error is None for point in course.points] == [False, True, True, False]
    assert drawn(pictures.draw_drift, [course], tmp_path)
    stopped, = drift.follow([entry("still", still)], Limits(t_end=10.0, most=0.0))
    assert stopped.points == ()
    assert "its end" in stopped.note


def test_a_line_joins_what_nothing_beats():
    points = [(1e-15, 9.0), (1e-12, 20.0), (1e-10, 4.0), (1e-8, 4.0), (1e-6, 1.0)]
    assert pictures._best(points) == [points[0], points[2], points[4]]


# ---------------------------------------------------------------- bodies


def test_a_job_is_repeated_until_it_takes_long_enough():
    done = []
    again, times = timing.repeated(lambda: done.append(sum(range(1000))), 2e-3)
    assert times > 1
    done.clear()
    again()
    assert len(done) == times


@pytest.fixture
def quick_builds(monkeypatch):
    """Nothing is asserted of times: what is made for these tests alone is not optimised."""
    monkeypatch.setenv("GYROSPARK_OPTIMISE", "0")


@pytest.mark.slow  # derives and compiles two chains
@pytest.mark.usefixtures("quick_builds")
def test_chains_grow(tmp_path):
    said = []
    one, two = growth.grow((1, 2), 20, 1, 1e-4, said.append)
    assert [line.startswith("chain of") for line in said] == [True, True, False]
    assert (two.coordinates, two.constraints) == (14, 8)
    assert not one.failed
    assert two.steps % 20 == 0
    assert two.us_per_body == pytest.approx(two.us_per_step / 2)
    assert two.as_dict()["ns_per_body_and_sweep"] > 0
    assert min(two.model_s, two.generate_s, two.compile_s) > 0
    assert max(two.constraint_max, two.momentum_constraint_max) < 1e-14
    assert drawn(pictures.draw_growth, [one, two], tmp_path)


def test_a_slope_is_that_of_the_logarithms():
    rows = [scaling.Scale("bodies", N, {"step": 2e-6 * N**1.5, "model": 3.0}) for N in (10, 40, 90)]
    assert scaling.slopes(rows, "bodies") == pytest.approx({"step": 1.5, "model": 0.0}, abs=1e-12)
    assert scaling.tables(rows)["bodies"][1] == ["10", "63.2 µs", "3 s"]


def test_a_law_is_the_slope_of_large_chains():
    """Below 8 bodies a size is not looked at; a cost that is missing has no law."""
    sizes = [growth.Size(N, 7 * N, 4 * N, True, 0.1 * N**2, 3.0, 2.0, 5000 if N < 8 else 10 * N,
                         us_per_step=0.5 * N, sweeps=None) for N in (1, 2, 8, 16, 100)]
    assert growth.laws(sizes) == pytest.approx(
        {"model_s": 2, "generate_s": 0, "compile_s": 0, "lines": 1, "us_per_step": 1,
         "us_per_body": 0}, abs=1e-12)
    assert growth.laws(sizes[:4]) == {}


@pytest.mark.parametrize("linkage", [peer_linkages.chain_of(3), peer_linkages.closed_loop()],
                         ids=lambda linkage: linkage.name)
def test_linkages_are_held_where_both_bodies_are(linkage):
    """A joint of two bodies does not move at the start, seen from either: ẋ + ω × r agree."""
    bodies_at = linkage.starts()

    def velocity(body, at):
        omega = rotation_matrix(body.q) @ body.omega
        return body.v + np.cross(omega, np.array(at) - body.x)

    for hold in linkage.holds:
        a, b = (np.zeros(3) if i is None else velocity(bodies_at[i], hold.at)
                for i in (hold.a, hold.b))
        np.testing.assert_allclose(a, b, atol=1e-13)


@pytest.mark.slow  # two runs of each step
@pytest.mark.usefixtures("quick_builds")
def test_ours_arrives_on_bodies(tmp_path):
    rows = joined_bodies.compare_bodies([peer_linkages.chain_of(2)], ["gyrospark"], 1, 1e-4,
                                        quick=True)
    assert [row.dt for row in rows] == [1e-2, 5e-3]
    assert rows[1].error < rows[0].error / 12  # fourth order
    assert all(row.seconds and row.us_per_step for row in rows)
    assert joined_bodies.cheapest(rows, "chain of 2", "gyrospark", rows[1].error) == rows[1]
    assert joined_bodies.cheapest(rows, "chain of 2", "gyrospark", rows[1].error / 2) is None
    assert drawn(pictures.draw_bodies, rows, tmp_path)


# ---------------------------------------------------------------- stores


def test_stores_are_rows(tmp_path):
    said = []
    row, = storing.compare_stores([(7, 500)], 2, said.append, tmp_path)
    assert said == ["the disk", "500 steps, every 7"]
    assert (row.every, row.steps, row.failed) == (7, 500, False)
    assert len(row.store_wall) == len(row.memory_cpu) == 2
    assert row.stored_bytes > 73 * 132  # the states, and what describes them
    assert min(row.disk, row.disk_files) > 0
    assert list(tmp_path.iterdir()) == []


def test_what_storing_adds_is_that_of_a_round():
    row = storing.StoreRow(1, 10, (1.0, 2.0, 4.0), (1.5, 2.2, 6.0), (1.0,) * 3, (3.0,) * 3, 60,
                           1.0, 1.0)
    assert row.overhead == 0.5
    assert row.cpu_overhead == 2
    assert row.rate == 60 / 2.2
    assert row.as_dict()["ns_per_step"] == (2e8, pytest.approx(2.2e8))


# ---------------------------------------------------------------- sweeps


def test_the_kernel_does_what_the_sweep_does():
    """Otherwise shares mean nothing: the same bits from the bare kernel, in another order."""
    study = sweeping.study_of(sweeping.SweepCase("steps", 9, 20, 5), "G-L 2")
    q, p = sweeping.kernel_job(study, 2)()
    result = run_study(study)
    assert np.array_equal(q.reshape(9, 9, 4), result.q)
    assert np.array_equal(p.reshape(9, 9, 4), result.p)


def test_shares_are_those_of_a_round():
    row = sweeping.SweepRow("steps", "EMS", 2, 5, None, 1,
                            {"kernel": (1.0, 2.0, 8.0), "store": (2.0, 2.5, 10.0)})
    assert row.share("store") == 0.8
    assert row.ns("store") == 2.5e8
    assert row.share("memory") is None


# ---------------------------------------------------------------- the command


@pytest.fixture
def bench(monkeypatch, capsys, tmp_path):
    """Call ``make bench`` in an empty folder; return exit code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    def caller(*arguments):
        monkeypatch.setattr(sys, "argv", ["bench", *arguments])
        capsys.readouterr()
        with pytest.raises(SystemExit) as end:
            main()
        said = capsys.readouterr()
        return end.value.code, said.out, said.err

    return caller


def test_each_program_of_bodies_has_a_column(capsys):
    """The cheapest that is exact enough, and its cost over that of the first program."""
    rows = [joined_bodies.BodyRow("chain", peer, "1", "x", 1e-3, seconds=seconds, error=error)
            for peer, seconds, error in (("gyrospark", 0.002, 1e-7), ("mujoco", 0.006, 1e-5),
                                         ("mujoco", 0.5, 1e-5), ("pydy", None, None))]
    _print_accuracies(rows)
    lines = [[cell.strip() for cell in line.split("│")[1:-1]]
             for line in capsys.readouterr().out.splitlines() if "│" in line]
    first = next(line for line in lines if "1e-05" in line)
    assert [" ".join(cell.split()) for cell in first] == [
        "chain", "1e-05", "2.00 x Δt=0.001", "6.00 x Δt=0.001", "–"]
    assert sum("× 3.0" in line for line in lines) == 3
    assert [line[3] for line in lines if "1e-06" in line] == ["–"]


@pytest.mark.slow  # in long double
def test_events_of_the_top():
    """Against long double: the height falls through its level as often, at the same times."""
    top = events.FastTop(0.5)
    job = top.ours()["G-L s=4 Δt=0.005"]()
    times = job.events()
    assert len(times) > 2
    assert max(top.errors(times, job.dense())) < 1e-9
    assert top.errors(times[1:], job.dense())[0] == float("inf")


def test_command_writes_json_and_a_picture(bench, tmp_path):
    pytest.importorskip("matplotlib")
    code, out, _ = bench("--quick", "--peers", "gyrospark", "--rounds", "1", "--json", "--out",
                         "new/bench")
    assert code == 0
    document = json.loads(out)
    assert document == json.loads((tmp_path / "new/bench/bench.json").read_text(encoding="utf-8"))
    assert document.keys() == {"about", "peers"}
    assert {"gyrospark", "compiler", "processor", "packages"} <= document["about"].keys()
    assert document["peers"][0]["samples"]
    assert is_picture(tmp_path / "new/bench/work_precision.png")


@pytest.mark.slow
def test_command_does_all(bench, tmp_path):
    pytest.importorskip("matplotlib")
    code, out, _ = bench("all", "--quick", "--peers", "gyrospark", "--rounds", "1", "--json",
                         "--out", "new/bench")
    assert code == 0
    document = json.loads(out)
    assert document.keys() == {"about", "peers", "step", "ensemble", "drift", "growth", "bodies",
                               "batches", "growth_laws", "store", "sweeps", "events",
                               "gradients", "derivatives", "scale"}
    assert (tmp_path / "new/bench/scale.md").read_text(encoding="utf-8").startswith("# How costs")
    for picture in ("work_precision.png", "drift.png", "growth.png", "bodies.png", "sweeps.png",
                    "gradients.png"):
        assert is_picture(tmp_path / "new/bench" / picture)


@pytest.mark.parametrize(("arguments", "message"), [
    (["nonsense"],
     "'nonsense'; choose peers, step, ensemble, drift, bodies, store, sweeps, events, "
     "gradients, scale, references, robots or all"),
    (["scale", "--largest", "planets=9"], "'planets=9'"),
    (["scale", "--largest", "bodies=few"], "--largest bodies 'few'"),
    (["--peers", "gyrospark,matlab"], "'matlab'; choose gyrospark, "),
    (["--t-end", "3"], "1, 10, 100 or 1000"),
    (["--t-end", "soon"], "--t-end 'soon'"),
    (["--rounds", "0"], "--rounds 0"),
    (["--rounds", "many"], "--rounds 'many'"),
    (["--quick", "--peers", "gyrospark", "--rounds", "1", "--base", "matlab"],
     "'matlab'"),
])
def test_command_refuses_in_a_sentence(bench, arguments, message):
    code, out, err = bench(*arguments)
    assert code == 2
    assert not out
    assert err.count("\n") == 1
    assert message in err


@pytest.mark.parametrize(("package", "extra", "arguments"), [
    ("gyrospark.runtime.plotting.figure", "plot", ["--out", "new"]),
    ("zarr", "storage", ["store"])])
def test_command_says_what_is_missing_before_it_measures(
    bench, monkeypatch, tmp_path, package, extra, arguments
):
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.delitem(sys.modules, "gyrospark.storage", raising=False)
    monkeypatch.delattr(gs, "storage", raising=False)
    monkeypatch.setattr(sys.modules["benchmarks.__main__"], "_MEASURE", {})
    code, out, err = bench(*arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert install(extra) in err
    assert list(tmp_path.iterdir()) == []
