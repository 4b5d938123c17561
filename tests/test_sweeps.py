"""Sweeps: each cell is the run it stands for, whoever computes it, however often it is ended."""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import gyrospark as gs
from gyrospark.sweeps import compute, local, tiles
from gyrospark.sweeps.estimate import estimate
from gyrospark.sweeps.picture import draw
from gyrospark.sweeps.plan import plan
from gyrospark.sweeps.results import (
    BAD_START,
    NOT_COMPUTED,
    Store,
    done_tiles,
    fields_of,
    meanings,
)
from gyrospark.sweeps.study_file import parse_study
from killing import differences
from processes import ROOT, call, cli, environment, gyrospark_command

EXAMPLES = sorted((ROOT / "examples" / "studies").glob("*.toml"))
TOP = gs.problems.fast_top()
GAMMAS, STEPS = [8e-4, 1.2e-3, 1.6e-3], [1e-3, 2e-3]
OVER = {"gamma": GAMMAS, "dt": STEPS}
STUDY = """
model = "fast-top"
scheme = "G-L 2"
steps = 400
[grid]
gamma = { from = 4e-4, to = 4e-3, count = 40, spacing = "log" }
dt = { from = 1e-4, to = 2e-3, count = 32, spacing = "log" }
"""


@pytest.fixture
def small_tiles(monkeypatch):
    """Tiles of 64 cells: several even of a small sweep."""
    monkeypatch.setattr(tiles, "_LEAST_WORK", 1)
    monkeypatch.setattr(tiles, "_TILES", 2**30)


def pendulum(**more):
    q, p = sp.symbols("x y", real=True), sp.symbols("px py", real=True)
    m, g, l = sp.symbols("m g l", positive=True)  # noqa: E741
    return gs.System(q, p, (m, g, l), H=(p[0]**2 + p[1]**2) / (2 * m) + m * g * q[1],
                     constraints=[q[0]**2 + q[1]**2 - l**2], name="swept_pendulum", **more)


def pendulum_model(**more):
    return gs.Model(pendulum(**more), {"m": 1.0, "g": 9.81, "l": 1.0}, [0.6, -0.8], [0.8, 0.6],
                    dt=0.01)


def alone(step, parameters, dt, steps, q=TOP.q0, p=TOP.p0, **options):
    """Return one trajectory by itself, in the lanes that sweeps use."""
    many = step.integrate_ensemble(np.array([q]), np.array([p]), dt=dt, steps=steps,
                                   parameters=parameters, **options)
    return many.members[0]


# ---------------------------------------------------------------- cells are runs


@pytest.mark.parametrize(("scheme", "stages", "rep"), [
    ("IMS", None, "alpha"), ("EMS", None, "gamma"), ("G-L", 3, "gamma"), ("LIIIA-B", 4, "alpha")])
@pytest.mark.parametrize("real", ["double", "float", "long-double"])
def test_cells_are_runs_to_the_bit(scheme, stages, rep, real):
    over = {rep: GAMMAS, "dt": STEPS}
    result = gs.sweep("fast-top", over, scheme=scheme, stages=stages, rep=rep, real=real, steps=30,
                      every=10)
    step = gs.stepper(scheme, stages, rep, real=real)
    q, p = step.project(TOP.q0, TOP.p0, parameters=TOP.parameters | {rep: GAMMAS[0]})
    assert result.energy_error_max.dims == (rep, "dt")
    for (i, value), (j, dt) in itertools.product(enumerate(GAMMAS), enumerate(STEPS)):
        cell = result.isel({rep: i, "dt": j})
        run = alone(step, TOP.parameters | {rep: value}, dt, 30, q, p, every=10)
        report = run.report
        assert np.array_equal(cell.q, run.q[-1].astype(float))
        assert np.array_equal(cell.p_samples, run.p.astype(float))
        assert cell.energy_error_max == report.energy_error_max
        assert cell.energy_error_mean == pytest.approx(report.energy_error_mean, rel=1e-6)
        assert cell.constraint_max == report.constraint_max
        assert cell.momentum_constraint_max == report.momentum_constraint_max
        assert cell.iterations_mean == report.iterations_mean
        assert (cell.iterations_max, cell.steps_done) == (report.iterations_max, 30)
        assert cell.status == 0


@pytest.mark.parametrize("solver", ["newton", "fixed-point"])
def test_solvers(solver):
    result = gs.sweep(TOP, OVER, scheme="G-L", stages=2, steps=20, solver=solver)
    step = gs.stepper("G-L", 2)
    run = alone(step, TOP.parameters | {"gamma": GAMMAS[1]}, STEPS[1], 20, solver=solver)
    assert np.array_equal(result.q[1, 1], run.q[-1])


def test_schemes_starts_lists_and_draws():
    spins = [[0, 0, 100.0], [0, 1.0, 120.0]]
    over = {"scheme": ["EMS", ("G-L", 2), "LIIIA-B 3"], "start": {"angular_velocity": spins},
            "pair": {"gamma": [1e-3, 2e-3], "dt": [1e-3, 5e-4]},
            "drawn": {"count": 3, "seed": 5, "mgl": {"from": 0.3, "to": 0.5}}}
    result = gs.sweep("fast-top", over, steps=7)
    assert dict(result.sizes) == {"scheme": 3, "start": 2, "pair": 2, "drawn": 3, "coordinate": 4}
    assert list(result.scheme.values) == ["EMS", "G-L 2", "LIIIA-B 3"]
    assert result.attrs["seed"] == 5
    assert ((result.mgl >= 0.3) & (result.mgl <= 0.5)).all()
    again = gs.sweep("fast-top", over, steps=7)
    assert result.identical(again)
    for k, (scheme, stages) in enumerate([("EMS", None), ("G-L", 2), ("LIIIA-B", 3)]):
        parameters = TOP.parameters | {"gamma": 2e-3, "mgl": result.mgl.values[2]}
        q, p = TOP.q0, gs.momentum(TOP.q0, spins[1], TOP.inertia)
        run = alone(gs.stepper(scheme, stages), parameters, 5e-4, 7, q, p)
        assert np.array_equal(result.q[k, 1, 1, 2], run.q[-1])


def test_a_system_of_ones_own_with_forces_time_and_quantities():
    t = sp.Symbol("t")
    y = sp.Symbol("y", real=True)
    model = pendulum_model(forces=[sp.cos(3 * t), -0.1 * y], time=t, quantities={"height": y + t})
    result = gs.sweep(model, {"m": [1.0, 2.0]}, scheme="G-L", stages=2, steps=40)
    step = gs.stepper("G-L", 2, system=model.system)
    q, p = step.project(model.q0, model.p0, parameters=model.parameters)
    run = alone(step, {"m": 2.0, "g": 9.81, "l": 1.0}, 0.01, 40, q, p)
    assert result.work[1] == run.report.work != 0
    assert result.quantity_height[1] == run.quantity("height")[-1]
    assert result.energy_error_max[1] == run.report.energy_error_max


def test_no_fast_path_no_constraint_no_parameter():
    """A tableau-free corner: nothing is swept side by side, nothing needs to be consistent."""
    x, px = sp.symbols("x px", real=True)
    model = gs.Model(gs.System([x], [px], (), H=px**2 / 2 + x**4, name="quartic"), {}, [1.0], [0.0])
    result = gs.sweep(model, {"dt": [0.01, 0.02, 0.05]}, scheme="EMS", steps=50, solver="newton")
    run = alone(gs.stepper("EMS", system=model.system), {}, 0.05, 50, [1.0], [0.0],
                solver="newton")
    assert np.array_equal(result.q[2], run.q[-1])


def test_a_duration_gives_each_step_its_number():
    result = gs.sweep(TOP, {"dt": [1e-3, 3e-4, 7e-3]}, scheme="EMS", duration=0.02)
    assert list(result.steps_done) == [20, 67, 3]


@settings(max_examples=12, deadline=None)
@given(st.integers(1, 9), st.integers(1, 40), st.integers(1, 3), st.integers(0, 2**31))
def test_tiles_cover_every_cell_once_and_change_nothing(rows, columns, workers, seed):
    numbers = np.random.default_rng(seed)
    over = {"gamma": list(numbers.uniform(6e-4, 3e-3, rows)),
            "dt": list(numbers.uniform(1e-4, 3e-3, columns))}
    study = plan(TOP, over, scheme="G-L", stages=2, steps=3)
    with pytest.MonkeyPatch.context() as patch:
        whole = gs.sweep(TOP, over, scheme="G-L", stages=2, steps=3)
        patch.setattr(tiles, "_cells_of_a_tile", lambda study: int(numbers.integers(1, 30)))
        fixed = tiles.tile_shape(study)
        patch.setattr(tiles, "tile_shape", lambda study: fixed)
        seen = np.zeros(study.shape, dtype=int)
        for tile in tiles.tiles_of(study):
            seen[tile.slices] += 1
        assert (seen == 1).all()
        parts = gs.sweep(TOP, over, scheme="G-L", stages=2, steps=3, workers=workers)
    assert parts.equals(whole)


# ---------------------------------------------------------------- cells that fail


def test_a_diverging_cell_is_nan_with_its_reason_and_the_others_stay():
    over = {"gamma": [1.6e-3], "dt": [1e-3, 0.3, 2e-3, 50.0]}
    result = gs.sweep(TOP, over, scheme="G-L", stages=3, steps=10)
    good = gs.sweep(TOP, {"gamma": [1.6e-3], "dt": [1e-3, 2e-3]}, scheme="G-L", stages=3, steps=10)
    assert list(result.status[0] == 0) == [True, False, True, False]
    assert result.isel(dt=[0, 2]).drop_vars("dt").equals(good.drop_vars("dt"))
    lost = result.isel(gamma=0, dt=1)
    assert np.isnan(lost.q).all()
    assert np.isnan(lost.energy_error_max)
    assert lost.steps_done < 10
    assert int(lost.status) in meanings()
    words = result.status.attrs["flag_meanings"].split()
    assert words[result.status.attrs["flag_values"].index(int(lost.status))] in (
        "not_converged", "singular_matrix", "not_finite")


@pytest.mark.parametrize("scheme", ["G-L 2", "EMS"])
def test_a_start_off_the_constraints_is_told(scheme):
    q = np.array([TOP.q0, 1.001 * TOP.q0, TOP.q0])
    p = np.array([TOP.p0, TOP.p0, TOP.p0 + 0.1 * TOP.q0])
    result = gs.sweep(TOP, {"start": (q, p)}, scheme=scheme, dt=1e-3, steps=5)
    assert list(result.status) == [0, BAD_START, BAD_START]
    assert list(result.steps_done) == [5, 0, 0]
    assert np.isnan(result.q[1:]).all()


def test_a_start_is_judged_with_the_parameters_of_its_cell():
    """g of the pendulum has l in it: the start fits one length only."""
    model = pendulum_model()
    result = gs.sweep(model, {"l": [1.0, 1.5], "m": [1.0, 2.0]}, scheme="G-L", stages=2, steps=5)
    assert result.status.values.tolist() == [[0, 0], [BAD_START, BAD_START]]


# ---------------------------------------------------------------- what cannot be swept


@pytest.mark.parametrize(("over", "options", "fragments"), [
    ({}, {}, ["Nothing varies"]),
    ({"gamma": []}, {}, ["gamma", "no list"]),
    ({"I1": [1e-3, -1e-3]}, {}, ["I1", "-0.001", "positive"]),
    ({"gamma": [1e-3, 0]}, {}, ["gamma", "nonzero"]),
    ({"gamma": [[1e-3]]}, {}, ["gamma"]),
    ({"gamma": "abc"}, {}, ["gamma"]),
    ({"gamma": [float("nan")]}, {}, ["finite"]),
    ({"gama": [1e-3]}, {}, ["gama"]),
    ({"dt": [0.0, 1e-3]}, {"dt": None}, ["dt"]),
    ({"gamma": {"from": 0, "to": 1, "count": 3, "spacing": "log"}}, {}, ["logarithm"]),
    ({"gamma": {"from": 1e-3, "to": 1e-2}}, {}, ["count"]),
    ({"gamma": {"from": 1e-3, "to": 1e-2, "count": 2, "spacing": "cubic"}}, {}, ["cubic"]),
    ({"gamma": {"from": 1e-3, "to": 1e-2, "count": 2, "step": 1}}, {}, ["range"]),
    ({"a": {"gamma": [1e-3]}, "b": {"gamma": [1e-3]}}, {}, ["varies along", "'a'", "'b'"]),
    ({"a": {"gamma": [1e-3, 2e-3], "dt": [1e-3]}}, {"dt": None}, ["different lengths"]),
    ({"a": {"nothing": [1.0]}}, {}, ["nothing"]),
    ({"start": [1, 2]}, {}, ["start"]),
    ({"start": {"q": [[1, 0, 0, 0]], "p": [[0, 0, 0]]}}, {}, ["shapes"]),
    ({"start": {"q": [[1, 0, 0]], "p": [[0, 0, 0]]}}, {}, ["3 numbers"]),
    ({"scheme": ["EMS"]}, {}, ["leave out scheme"]),
    ({"gamma": [1e-3]}, {"scheme": None}, ["scheme is not given"]),
    ({"gamma": [1e-3]}, {"scheme": "G-L x"}, ["G-L x"]),
    ({"gamma": [1e-3]}, {"steps": None}, ["steps", "duration"]),
    ({"gamma": [1e-3]}, {"duration": 1.0}, ["steps", "duration"]),
    ({"gamma": [1e-3]}, {"steps": None, "duration": -1.0}, ["duration"]),
    ({"gamma": [1e-3]}, {"steps": None, "duration": 1.0, "every": 2}, ["every needs steps"]),
    ({"gamma": [1e-3]}, {"steps": 0}, ["steps"]),
    ({"gamma": [1e-3]}, {"every": 0}, ["every"]),
    ({"gamma": [1e-3]}, {"solver": "python"}, ["python"]),
    ({"gamma": [1e-3]}, {"real": "float128"}, ["float128"]),
    ({"gamma": [1e-3]}, {"keep": ["energy"]}, ["'energy'", "energy_error_max"]),
    ({"gamma": [1e-3]}, {"workers": 0}, ["workers"]),
    ({"gamma": [1e-3]}, {"dt": None}, ["dt"]),
    ({"gamma": [1e-3]}, {"parameters": {"mgl": "heavy"}}, ["mgl", "heavy"]),
    ({"gamma": [1e-3]}, {"resume": True}, ["resume"]),
    ([("gamma", [1e-3])], {}, ["no dict"]),
])
def test_refusals_come_before_anything_is_computed(over, options, fragments, monkeypatch):
    monkeypatch.setattr(local, "compute", None)
    choice = {"scheme": "EMS", "steps": 10, "dt": 1e-3} | options
    with pytest.raises(gs.InputError) as error:
        gs.sweep("fast-top", over, **choice)
    assert all(fragment in str(error.value) for fragment in fragments), str(error.value)


# ---------------------------------------------------------------- stores


def test_a_store_holds_what_memory_holds(tmp_path, small_tiles):
    path = tmp_path / "s.zarr"
    over = {"scheme": ["EMS", "G-L 2"], "gamma": list(np.geomspace(8e-4, 2e-3, 13)),
            "dt": list(np.geomspace(1e-4, 2e-3, 11))}
    stored = gs.sweep(TOP, over, steps=20, out=path)
    assert stored.identical(gs.sweep(TOP, over, steps=20))
    opened = gs.open_sweep(path)
    assert opened.equals(stored)
    assert (opened.sel(scheme="G-L 2").status == 0).all()
    other = gs.sweep(TOP, over, steps=20, out=tmp_path / "t.zarr", workers=1)
    assert other.equals(stored)
    assert differences(path, tmp_path / "t.zarr") == []


def test_finished_cells_are_never_computed_again(tmp_path, small_tiles, monkeypatch):
    over = {"gamma": list(np.linspace(8e-4, 2e-3, 40)), "dt": list(np.linspace(1e-4, 1e-3, 16))}
    choice = {"scheme": "G-L", "stages": 2, "steps": 5}
    gs.sweep(TOP, over, **choice, out=tmp_path / "whole.zarr")
    computed: list[tuple[int, ...]] = []
    path, done = tmp_path / "s.zarr", set()

    def counted(study, fields, tile):
        assert tile.place not in done
        computed.append(tile.place)
        return compute.compute(study, fields, tile)

    def ended(finished, everything):
        if finished >= ended.at:
            raise KeyboardInterrupt

    monkeypatch.setattr(local, "compute", counted)
    for ended.at in (1, 200, 321):
        with pytest.raises(KeyboardInterrupt):
            gs.sweep(TOP, over, **choice, out=path, resume=True, workers=1, progress=ended)
        done = done_tiles(path)
    gs.sweep(TOP, over, **choice, out=path, resume=True)
    assert set(computed) == {tile.place for tile in tiles.tiles_of(plan(TOP, over, **choice))}
    before = len(computed)
    gs.sweep(TOP, over, **choice, out=path, resume=True)
    assert len(computed) == before
    assert differences(path, tmp_path / "whole.zarr") == []


def test_an_unfinished_sweep_can_be_read(tmp_path, small_tiles):
    path = tmp_path / "s.zarr"

    def end(finished, everything):
        if finished:
            raise KeyboardInterrupt

    over = {"gamma": list(np.linspace(8e-4, 2e-3, 400))}
    with pytest.raises(KeyboardInterrupt):
        gs.sweep(TOP, over, scheme="EMS", dt=1e-3, steps=5, out=path, workers=1, progress=end)
    found = gs.open_sweep(path)
    states = np.asarray(found.status)
    assert {0, NOT_COMPUTED} == set(states.tolist())
    assert np.isfinite(found.q.values[states == 0]).all()
    assert np.isnan(found.q.values[states == NOT_COMPUTED]).all()


@pytest.mark.parametrize(("change", "fragment"), [
    ({"steps": 6}, "steps was 5 and is 6"), ({"dt": 2e-3}, "dt was 0.001 and is 0.002"),
    ({"scheme": "IMS"}, "steppers"), ({"parameters": {"mgl": 0.5}}, "parameters.mgl"),
    ({"over": {"gamma": [1e-3, 3e-3]}}, "axes.gamma"), ({"keep": ["q"]}, "results"),
    ({"tolerance": 1e-9}, "tolerance")])
def test_another_sweep_is_not_gone_on_with(change, fragment, tmp_path):
    path = tmp_path / "s.zarr"
    arguments = {"over": {"gamma": [1e-3, 2e-3]}, "scheme": "EMS", "dt": 1e-3, "steps": 5}
    gs.sweep(TOP, **arguments, out=path)
    with pytest.raises(gs.InputError, match="is there already"):
        gs.sweep(TOP, **arguments, out=path)
    with pytest.raises(gs.InputError) as error:
        gs.sweep(TOP, **(arguments | change), out=path, resume=True)
    assert fragment in str(error.value)


def test_what_is_no_sweep_is_refused(tmp_path):
    (tmp_path / "s.zarr").mkdir()
    with pytest.raises(gs.StorageError, match="no sweep"):
        gs.sweep(TOP, OVER, scheme="EMS", steps=5, out=tmp_path / "s.zarr", resume=True)
    with pytest.raises(gs.InputError, match="no sweep"):
        gs.open_sweep(tmp_path / "s.zarr")


def test_a_full_disk_ends_a_sweep_that_then_goes_on(tmp_path, small_tiles, monkeypatch):
    over = {"gamma": list(np.linspace(8e-4, 2e-3, 300))}
    choice = {"scheme": "EMS", "dt": 1e-3, "steps": 5}
    gs.sweep(TOP, over, **choice, out=tmp_path / "whole.zarr")
    from gyrospark.storage import durable

    write = durable.write_durably

    def full(path, data, workshop=None):
        full.left -= 1
        if full.left < 0:
            raise OSError(28, "No space left on device")
        write(path, data, workshop)

    path = tmp_path / "s.zarr"
    monkeypatch.setattr(durable, "write_durably", full)
    for full.left in itertools.count(1, 7):
        try:
            gs.sweep(TOP, over, **choice, out=path, resume=True)
            break
        except gs.StorageError as error:
            assert "No space left" in str(error)  # noqa: PT017 (the last one finds room)
    assert full.left > 20
    assert differences(path, tmp_path / "whole.zarr") == []


def test_every_tile_has_a_file_of_every_result(tmp_path, small_tiles):
    """Zeros and NaN too: the dry run counts them, and what is missing is lost, not zero."""
    path = tmp_path / "s.zarr"
    over = {"gamma": [1.6e-3] * 40, "dt": [50.0, 60.0]}  # no cell gets anywhere
    result = gs.sweep(TOP, over, scheme="G-L", stages=2, steps=3, out=path)
    assert (result.status != 0).all()
    study = plan(TOP, over, scheme="G-L", stages=2, steps=3)
    fields = fields_of(study)
    said = estimate(study, fields)
    files = [file for field in fields for file in (path / field.name / "c").rglob("*")
             if file.is_file()]
    assert len(files) == said.files == len(fields) * said.tiles > len(fields)
    assert sum(file.stat().st_size - 4 for file in files) == said.disk_bytes  # a checksum each


def test_keep_keeps_what_it_names(tmp_path):
    result = gs.sweep(TOP, OVER, scheme="EMS", steps=5, keep=["energy_error_max"],
                      out=tmp_path / "s.zarr")
    assert set(result.data_vars) == {"energy_error_max", "status"}


# ---------------------------------------------------------------- the command


def study_file(folder, text=STUDY):
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_command_sweeps_draws_and_says_where_the_least_is(tmp_path):
    study_file(tmp_path)
    done = cli("sweep", "study.toml", "--plot", "s.png", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["statuses"] == {"done": 1280}
    result = gs.open_sweep(tmp_path / "study.zarr")
    assert said["least"] == float(result.energy_error_max.min())
    at = result.sel(gamma=said["least_at"]["gamma"], dt=said["least_at"]["dt"])
    assert at.energy_error_max == said["least"]
    assert (tmp_path / "s.png").stat().st_size > 5000
    again = cli("sweep", "study.toml", "--resume", cwd=tmp_path)
    assert again.returncode == 0
    assert "1,280 cells (40 gamma × 32 dt)" in again.stdout
    assert cli("sweep", "study.toml", cwd=tmp_path).returncode == 2


def test_dry_run_computes_nothing_and_is_about_right(tmp_path):
    path = study_file(tmp_path)
    done = cli("sweep", "study.toml", "--dry-run", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert (said["cells"], said["steps"]) == (1280, 1280 * 400)
    assert not (tmp_path / "study.zarr").exists()
    loaded = parse_study(STUDY, path)
    assert said["disk_bytes"] == 1280 * sum(f.row_bytes for f in fields_of(loaded.study))
    found = estimate(loaded.study, fields_of(loaded.study))
    assert 0 < found.low <= found.cpu_seconds <= found.high < 60
    assert found.tiles == len(list(tiles.tiles_of(loaded.study)))


@pytest.mark.parametrize(("text", "fragments"), [
    ("", ["model"]), ("x = ", ["not TOML"]), ("model = 3", ["model = 3"]),
    (STUDY + "\n[extra]\n", ["'extra'"]),
    (STUDY.replace("steps = 400", 'steps = "many"'), ["steps", "many"]),
    (STUDY.replace("steps = 400", "steps = true"), ["steps"]),
    (STUDY.replace("fast-top", "slow-top"), ["slow-top"]),
    (STUDY.replace("fast-top", "nothing.toml"), ["nothing.toml"]),
    (STUDY.replace("steps", "keep = 3\nsteps"), ["keep"]),
    (STUDY.replace("steps", "settings = { x = 1 }\nsteps"), ["settings", "x"]),
    (STUDY.replace("steps", "name = 1\nsteps"), ["name"]),
    (STUDY.replace("[grid]", "[grid]\nstart = { q = 1 }"), ["start"]),
])
def test_wrong_files_end_in_one_sentence(text, fragments, tmp_path):
    study_file(tmp_path, text)
    done = cli("sweep", "study.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert all(fragment in done.stderr for fragment in [*fragments, "study.toml"]), done.stderr


@pytest.mark.parametrize("arguments", [
    ["--out", "none/s.zarr"], ["--workers", "x"], ["--show", "q"], ["--plot", "s.txt"],
    ["--dask", "tcp://127.0.0.1:1"]])
def test_wrong_options_end_in_one_sentence(arguments, tmp_path):
    study_file(tmp_path)
    done = cli("sweep", "study.toml", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1, done.stderr


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_examples_are_studies_and_say_how_to_begin(path):
    text = path.read_text(encoding="utf-8")
    assert parse_study(text, path).study.size > 1
    header = [line for line in text.splitlines() if line.startswith("#   gyrospark sweep ")]
    words = header[0].removeprefix("#").split()
    assert words[3:] == ["--dry-run"]
    done = cli(*words[1:], cwd=ROOT)
    assert done.returncode == 0, done.stderr


def test_the_readmes_example_has_a_million_cells():
    path = ROOT / "examples" / "studies" / "gamma_dt.toml"
    study = parse_study(path.read_text(encoding="utf-8"), path).study
    assert (study.size, study.steps) == (10**6, 1000)


def test_pictures_of_one_and_three_axes_and_what_cannot_be_drawn(tmp_path):
    one = gs.sweep(TOP, {"gamma": GAMMAS}, scheme="EMS", dt=1e-3, steps=5)
    draw(one, "energy_error_max", tmp_path / "one.svg")
    three = gs.sweep(TOP, {"scheme": ["EMS", "IMS"], **OVER}, steps=5)
    draw(three, "iterations_mean", tmp_path / "three.pdf")
    with pytest.raises(gs.InputError, match="cannot be drawn"):
        draw(one, "q")
    lost = gs.sweep(TOP, {"gamma": GAMMAS, "dt": [50.0, 60.0]}, scheme="EMS", steps=5)
    draw(lost, "energy_error_max", tmp_path / "lost.png")


# ---------------------------------------------------------------- ends of processes


def killed(folder, kills, seed):
    path = study_file(folder, STUDY.replace("count = 40", "count = 240"))
    done = call([sys.executable, ROOT / "tests" / "killing.py", folder, str(kills), str(seed),
                 "sweep", path, "--out", "{store}"])
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["kills"] == kills
    assert said["completed"] == said["same"] >= 1, said


def test_killed_sweeps_end_in_the_same_bytes(tmp_path):
    killed(tmp_path, 5, 1)


@pytest.mark.slow
def test_two_hundred_kills(tmp_path, monkeypatch):
    monkeypatch.setattr("processes.PATIENCE", 3600)
    killed(tmp_path, 200, 2)


def test_ctrl_c_keeps_every_finished_cell(tmp_path):
    study_file(tmp_path, STUDY.replace("count = 40", "count = 4000"))
    command = gyrospark_command("sweep", "study.toml")
    process = subprocess.Popen(command, cwd=tmp_path, env=environment(), text=True,
                               stderr=subprocess.PIPE, stdout=subprocess.PIPE)
    store = tmp_path / "study.zarr"
    while not done_tiles(store):
        time.sleep(0.02)
        assert process.poll() is None
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "--resume" in said
    cells = int(said.split("Stopped with ")[1].split(" ")[0].replace(",", ""))
    assert cells == int((gs.open_sweep(store).status == 0).sum()) > 0


def test_two_sweeps_on_one_store_do_not_meet(tmp_path):
    from gyrospark.storage.lock import claim

    with claim(tmp_path / "s.zarr"), pytest.raises(gs.StorageError, match="Another process"):
        gs.sweep(TOP, OVER, scheme="EMS", steps=5, out=tmp_path / "s.zarr")


CLUSTER = """
import os, signal, sys, warnings
from pathlib import Path

from distributed import Client, LocalCluster

import gyrospark as gs
from gyrospark.sweeps import tiles
from gyrospark.sweeps.study_file import load_study
from gyrospark.sweeps.sweep import run_study

if __name__ == "__main__":
    study = load_study(Path("study.toml")).study
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None,
                      silence_logs=50) as cluster, Client(cluster) as client:
        def look(done, everything):
            if done and not look.killed:
                look.killed = min(client.run(os.getpid).values())
                os.kill(look.killed, signal.SIGKILL)
        look.killed = 0
        stored = run_study(study, out="cluster.zarr", dask=client, progress=look)
        assert look.killed
        print(bool(run_study(study, dask=client).equals(stored)))
"""


def test_a_cluster_that_loses_a_worker_writes_the_same_bytes(tmp_path):
    path = study_file(tmp_path, STUDY.replace("count = 40", "count = 120"))
    from gyrospark.sweeps.study_file import load_study
    from gyrospark.sweeps.sweep import run_study

    run_study(load_study(path).study, out=tmp_path / "threads.zarr")
    script = tmp_path / "cluster.py"
    script.write_text(CLUSTER, encoding="utf-8")
    done = subprocess.run([sys.executable, str(script)], cwd=tmp_path, text=True,
                          capture_output=True, timeout=300, check=False,
                          env=dict(os.environ, PYTHONPATH=str(Path(gs.__file__).parent.parent)))
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["True"]
    assert differences(tmp_path / "threads.zarr", tmp_path / "cluster.zarr") == []


DEADLY = """
import os, signal
from pathlib import Path

from distributed import Client, LocalCluster

import gyrospark as gs
from gyrospark.sweeps import cluster as on_cluster
from gyrospark.sweeps.study_file import load_study
from gyrospark.sweeps.sweep import run_study

work = on_cluster._compute

def deadly(shared, tile):
    if tile.place == (1, 0):
        os.kill(os.getpid(), signal.SIGKILL)
    return work(shared, tile)

if __name__ == "__main__":
    study = load_study(Path("study.toml")).study
    on_cluster._compute = deadly
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None,
                      silence_logs=50) as cluster, Client(cluster) as client:
        try:
            run_study(study, out="cluster.zarr", dask=client)
        except gs.GyrosparkError as error:
            print(error)
"""


@pytest.mark.slow
def test_a_tile_that_kills_every_worker_is_left_and_done_later(tmp_path):
    """All others are done, whatever the scheduler blames for the deaths."""
    path = study_file(tmp_path, STUDY.replace("count = 40", "count = 400"))
    from gyrospark.sweeps.study_file import load_study
    from gyrospark.sweeps.sweep import run_study

    study = load_study(path).study
    run_study(study, out=tmp_path / "threads.zarr")
    script = tmp_path / "cluster.py"
    script.write_text(DEADLY, encoding="utf-8")
    done = subprocess.run([sys.executable, str(script)], cwd=tmp_path, text=True,
                          capture_output=True, timeout=300, check=False,
                          env=dict(os.environ, PYTHONPATH=str(Path(gs.__file__).parent.parent)))
    assert done.returncode == 0, done.stderr
    assert "not computed: 1. Workers died" in done.stdout
    assert "--resume" in done.stdout
    every = {tile.place for tile in tiles.tiles_of(study)}
    assert every - done_tiles(tmp_path / "cluster.zarr") == {(1, 0)}
    run_study(study, out=tmp_path / "cluster.zarr", resume=True)
    assert differences(tmp_path / "threads.zarr", tmp_path / "cluster.zarr") == []


GONE = """
import os, signal, sys, threading
from pathlib import Path

from distributed import Client, Scheduler
from distributed.deploy import SpecCluster

import gyrospark as gs
from gyrospark.sweeps import cluster as on_cluster
from gyrospark.sweeps.study_file import load_study
from gyrospark.sweeps.sweep import run_study

if __name__ == "__main__":
    study = load_study(Path("study.toml")).study
    scheduler = {"cls": Scheduler, "options": {"dashboard_address": None}}
    with SpecCluster({}, scheduler=scheduler, silence_logs=50) as cluster, \
            Client(cluster) as client:
        if sys.argv[1] == "signal":
            threading.Timer(2, os.kill, (os.getpid(), signal.SIGINT)).start()
        else:
            on_cluster._PATIENCE = 2
            client.nthreads = iter([{"tcp://a": 1}] + [{}] * 1000).__next__
        try:
            run_study(study, out="cluster.zarr", dask=client)
        except (gs.GyrosparkError, KeyboardInterrupt) as error:
            print(error)
"""


@pytest.mark.parametrize(("how", "said"), [
    ("signal", "Stopped with 0 of 1,280 cells done"), ("gone", "has had no worker for 2 s")])
def test_a_sweep_does_not_hang_where_no_worker_is(how, said, tmp_path):
    study_file(tmp_path)
    script = tmp_path / "cluster.py"
    script.write_text(GONE, encoding="utf-8")
    done = subprocess.run([sys.executable, str(script), how], cwd=tmp_path, text=True,
                          capture_output=True, timeout=300, check=False,
                          env=dict(os.environ, PYTHONPATH=str(Path(gs.__file__).parent.parent)))
    assert done.returncode == 0, done.stderr
    assert said in done.stdout, done.stderr
    assert "--resume" in done.stdout


def test_studies_and_stores_travel():
    import pickle

    study = plan(TOP, OVER, scheme="EMS", steps=5)
    there = pickle.loads(pickle.dumps((study, Store(Path("x")))))[0]
    tile = next(tiles.tiles_of(study))
    fields = fields_of(study)
    here = compute.compute(study, fields, tile)
    for name, values in compute.compute(there, fields, tile).items():
        assert np.array_equal(values, here[name])
