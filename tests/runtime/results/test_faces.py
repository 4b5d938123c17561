"""Every result has the same names: save, show, plot, table, dataset, rows and slices."""

from __future__ import annotations

import json
import pickle
import shutil
from dataclasses import fields

import numpy as np
import pandas
import pytest
import zarr

import gyrospark as gs
import systems
from calls import PARAMETERS, RUN, TOP, equal, refused
from gyrospark.runtime.results.outputs import OUTPUTS, names_in_files
from gyrospark.runtime.results.state_columns import states_of
from gyrospark.storage.array_layout import fields_of
from stores import Interrupted, assert_same, assert_same_bytes, ends_after, record

EVENT = gs.Event("q1", level=0.2589)


@pytest.fixture(scope="module")
def run(gl3):
    return gl3.integrate(TOP, steps=20, every=2, events=EVENT, **RUN)


@pytest.fixture(scope="module")
def stored(gl3, tmp_path_factory):
    out = tmp_path_factory.mktemp("faces") / "run.zarr"
    return gl3.integrate(TOP, steps=20, every=2, events=EVENT, out=out, **RUN)


def test_a_stored_run_is_read_as_one_in_memory(run, stored):
    assert isinstance(stored, gs.Trajectory)
    assert_same(stored, run)
    assert len(stored) == len(run) == 11
    assert np.array_equal(stored.events["q1"].t, run.events["q1"].t)
    for row in (0, 3, -1):
        assert np.array_equal(stored[row].q, run[row].q)
        assert stored[row].t == run[row].t
    assert np.array_equal(stored.body().euler("ZXZ"), run.body().euler("ZXZ"))
    assert np.array_equal(stored.at([0.0035]).q, run.at([0.0035]).q)
    again = pickle.loads(pickle.dumps(stored))
    assert np.array_equal(again.p, run.p)


@pytest.mark.parametrize("rows", [slice(None), slice(3, None), slice(2, 9, 3), slice(-4, -1)])
def test_a_slice_is_a_run_of_some_states(rows, run, stored):
    chosen = np.arange(11)[rows]
    for piece in (run[rows], stored[rows]):
        assert np.array_equal(piece.t, run.t[rows])
        assert np.array_equal(piece.q, run.q[rows])
        assert np.array_equal(piece.multipliers, run.multipliers[chosen[1:] - 1])
        assert piece.every == 2 * (rows.step or 1)
        t = piece.events["q1"].t
        assert np.array_equal(t, run.events["q1"].t[
            (run.events["q1"].t >= piece.t[0])
            & ((run.events["q1"].t <= piece.t[-1]) | (chosen[-1] + (rows.step or 1) > 10))])


@pytest.mark.parametrize("rows", [slice(5, 2), slice(None, None, -1), slice("a", None)])
def test_what_is_no_slice_is_refused(rows, run):
    with pytest.raises(gs.InputError, match="states"):
        run[rows]


@pytest.mark.parametrize("real", [
    "double", pytest.param("long-double", marks=pytest.mark.slow), "float128"])
@pytest.mark.parametrize("end", [".npz", ".nc", ".zarr"])
def test_what_is_saved_is_loaded_with_all_digits(real, end, tmp_path):
    step = systems.stepper("driven_pendulum", real=real)
    run = systems.run("driven_pendulum", step, 9, every=2, events=gs.Event("along", level=0.9))
    again = gs.load(run.save(tmp_path / f"run{end}"))
    for name in ("t", "q", "p", "multipliers", "iterations", "energies", "work",
                 "quantity_values"):
        assert np.array_equal(getattr(again, name), getattr(run, name)), name
    assert (again.dt, again.every, again.report) == (run.dt, run.every, run.report)
    assert (again.parameters, again.manifest) == (run.parameters, run.manifest)
    for column in ("t", "q", "p", "steps", "rising", "elapsed"):
        assert np.array_equal(getattr(again.events["along"], column),
                              getattr(run.events["along"], column))


def test_tables_and_files_of_columns_agree(run, stored, tmp_path):
    frame = run.table()
    assert frame.index.name == "time"
    assert np.array_equal(frame[["q0", "q1", "q2", "q3"]], run.q)
    for result in (run, stored):
        pandas.testing.assert_frame_equal(result.table(), frame)
        parquet = pandas.read_parquet(result.save(tmp_path / "run.parquet")).set_index("time")
        pandas.testing.assert_frame_equal(parquet, frame)
        csv = pandas.read_csv(result.save(tmp_path / "run.csv"))
        assert np.array_equal(csv.set_index("time")[list(frame)], frame, equal_nan=True)
    crossings = pandas.read_parquet(tmp_path / "run.events.parquet")
    assert np.array_equal(crossings["time"], run.events["q1"].t)
    selected = run.table(["energy", "q1"])
    assert list(selected) == ["energy", "q1"]
    assert list(pandas.read_parquet(run.save(tmp_path / "a.parquet", columns="p"))) == [
        "time", "p0", "p1", "p2", "p3"]


def test_an_ensemble_has_the_same_face(gl3, tmp_path):
    ensemble = gl3.integrate_ensemble([TOP, TOP], dt=[1e-3, 2e-3], steps=4)
    frame = ensemble.table()
    assert frame.index.names == ["trajectory", "time"]
    assert np.array_equal(frame["q0"], ensemble.q[..., 0].ravel())
    assert np.array_equal(ensemble.dataset().q, ensemble.q)
    saved = pandas.read_parquet(ensemble.save(tmp_path / "many.parquet"))
    assert np.array_equal(saved["p3"], ensemble.p[..., 3].ravel())
    some = pandas.read_csv(ensemble.save(tmp_path / "some.csv", columns="energy"))
    assert np.array_equal(some["trajectory"], saved["trajectory"])
    assert list(some) == ["trajectory", "time", "energy"]
    assert len(ensemble.plot("energy", "q1").axes) == 2
    assert ensemble.show(member=1).page
    with pytest.raises(gs.InputError, match="member = 2"):
        ensemble.show(member=2)


def test_values_are_drawn_by_name(run, stored, tmp_path):
    for result in (run, stored):
        assert [len(axes.lines) for axes in result.plot("energy", "q1").axes] == [1, 1]
    for states in (1, 4):  # iterations belong to steps
        line, = run[:states].plot("iterations").axes[0].lines
        assert line.get_xydata().tolist() == [*map(list, zip(
            run.t[1:states], run.iterations[:states - 1], strict=True))]
    stored.plot("energy", tmp_path / "energy.png")
    run.plot(tmp_path / "all.svg")
    assert (tmp_path / "energy.png").stat().st_size > 1000
    with pytest.raises(gs.InputError, match="mean energy"):
        run.plot("enrgy")


@pytest.mark.parametrize(("name", "options"), [
    ("run.html", {}), ("run.png", {"size": (120, 90)}), ("run.glb", {})])
def test_a_run_is_shown_by_the_ending_of_a_name(name, options, run, stored, tmp_path):
    for result in (run, stored):
        result.show(tmp_path / name, **options)
        assert (tmp_path / name).stat().st_size > 1000


@pytest.mark.parametrize(("path", "options", "message"), [
    ("run.svg", {}, "plot"), ("run.png", {"fps": 3}, "fps.*azimuth"),
    (None, {"tme": 1.0}, "page"), ("run.glb", {"mesh": "none"}, "mean meshes"),
    (None, {"shape": "sphere"}, "Unknown shape 'sphere'"), ("run.avi", {}, r"\.gif.*\.mp4"),
    ("run.gltf", {}, r"'run\.gltf'.*\.glb"), ("run.glb", {"meshes": "some"}, "'some'")])
def test_what_cannot_be_shown_is_refused(path, options, message, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(gs.InputError, match=message):
        run.show(path, **options)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("call", "message"), [
    (lambda r: r.save("run.npz", columns="q"), "columns"),
    (lambda r: r.save("run.nc", euler="ZYX"), "euler"),
    (lambda r: r.save("run.zarr", degrees=True), "degrees"),
    (lambda r: gs.load("run.csv"), "pandas"), (lambda r: gs.load("none.nc"), "read"),
    (lambda r: gs.load("none.zarr"), "stored"), (lambda r: gs.load(3), "path")])
def test_what_has_no_columns_or_no_model_is_refused(call, message, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(gs.InputError, match=message):
        call(run)


def test_a_saved_store_is_there_once_and_not_resumed(run, tmp_path):
    path = run.save(tmp_path / "run.zarr")
    with pytest.raises(gs.InputError, match="already"):
        run.save(path)
    with pytest.raises(gs.InputError, match="source"):
        gs.resume(path)


@pytest.mark.parametrize("real", [
    "double", pytest.param("float128", marks=pytest.mark.slow)])
def test_a_run_goes_on_from_its_store_alone(real, tmp_path, monkeypatch):
    """Interrupted runs end with the same bytes, longer ones with the same states."""
    step = systems.stepper("dragged_pendulum", real=real)
    begin = gs.Start(*systems.start("dragged_pendulum", step),
                     systems.case("dragged_pendulum").parameters, 0.5)
    options = {"dt": 0.0625, "every": 3, "events": gs.Event("height", level=-0.8),
               "solver": gs.Solver("auto", tolerance=1e-12, max_iterations=40)}
    full_run = step.integrate(begin, steps=24, out=tmp_path / "whole.zarr", **options)
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK_WITH_EVENTS", 5)
    with pytest.raises(Interrupted):
        step.integrate(begin, steps=24, out=tmp_path / "pieces.zarr", progress=ends_after(2),
                       **options)
    assert gs.resume(tmp_path / "pieces.zarr").status == "complete"
    assert_same_bytes(tmp_path / "whole.zarr", tmp_path / "pieces.zarr")
    step.integrate(begin, steps=7, out=tmp_path / "longer.zarr", **options)
    gs.resume(tmp_path / "longer.zarr", steps=16)
    assert_same(gs.resume(tmp_path / "longer.zarr", t_end=2.0), full_run)


@pytest.mark.parametrize(("changes", "message"), [
    ({"t_eval": [0.001]}, "t_eval"), ({"tangents": gs.Tangents()}, "tangents"),
    ({"out": "run.npz"}, "zarr")])
def test_what_stores_do_not_have_is_refused(changes, message, gl3, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(gs.InputError, match=message):
        gl3.integrate(TOP, steps=3, **RUN | {"out": "run.zarr"} | changes)
    assert not list(tmp_path.iterdir())


def test_inputs_of_a_stored_run_are_held(tmp_path):
    step, parameters = systems.stepper("pushed_pendulum"), {"k": 2.0}
    start = gs.Start([0.6, -0.8], [0.8, 0.6], parameters)
    stored = step.integrate(start, dt=0.02, steps=9, inputs=[0.5, -1.0], out=tmp_path / "run.zarr")
    assert np.array_equal(stored.q, step.integrate(start, dt=0.02, steps=9, inputs=[0.5, -1.0]).q)
    with pytest.raises(gs.InputError, match="inputs"):
        step.integrate(start, dt=0.02, steps=9, inputs=np.ones((9, 2)) * np.arange(9)[:, None],
                       out=tmp_path / "other.zarr")


def test_a_store_that_exists_is_not_begun_again(gl3, stored):
    with pytest.raises(gs.InputError, match="exists"):
        gl3.integrate(TOP, steps=20, out=stored.path, **RUN)


@pytest.mark.parametrize(("name", "present"), [
    ("to_csv", "save"), ("to_dataframe", "table"), ("to_xarray", "dataset"), ("view", "show"),
    ("picture", "show"), ("animate", "show"), ("export", "show"), ("load", r"gyrospark\.load")])
def test_former_names_are_refused_with_the_present_ones(name, present, run):
    with pytest.raises(AttributeError, match=present):
        getattr(run, name)
    assert not hasattr(run, name)


def test_a_trajectory_has_a_field_for_each():
    arrays = [field.name for field in fields(gs.Trajectory) if field.type == "Array"]
    assert sorted(arrays) == sorted(output.attribute for output in OUTPUTS)
    for output in OUTPUTS:
        assert output.attribute in gs.Trajectory.__doc__


def test_files_and_stores_have_the_same_in_the_same_order(gl3):
    run = gl3.integrate(TOP.q0, TOP.p0, steps=4, **RUN)
    assert list(states_of(run)) == [field.name for field in fields_of(gl3.manifest)]
    assert list(states_of(run)) == [
        name for output in OUTPUTS for name in names_in_files(output, gl3.manifest)]
    assert run.panels() == {}  # energy and constraints have pictures of their own


def test_a_file_without_an_output_is_refused(gl3, tmp_path):
    """The message names the missing array and possible damage."""
    path = gl3.integrate(TOP.q0, TOP.p0, steps=4, **RUN).save(tmp_path / "run.npz")
    with np.load(path) as file:
        arrays = {name: file[name] for name in file if name != "f_errors"}
    np.savez(path, **arrays)
    with refused("f_errors.*gyrospark.*damaged"):
        gs.load(path)
    about = json.loads(str(arrays["about"]))
    del about["report"]["steps"]
    np.savez(path, **arrays | {"about": np.array(json.dumps(about))})
    with refused(r"run\.npz.*damaged"):
        gs.load(path)


def test_a_store_without_an_output_is_read_and_not_resumed(gl3, tmp_path):
    """Stores of an earlier version may lack an array: others can be read, but no run goes on."""
    recording = record(gl3, TOP.q0, TOP.p0, out=tmp_path / "run.zarr", steps=4, **RUN)
    assert equal(recording[:], gl3.integrate(TOP.q0, TOP.p0, steps=4, **RUN))
    shutil.rmtree(tmp_path / "run.zarr" / "f_error")
    group = zarr.open_group(tmp_path / "run.zarr", mode="r+", use_consolidated=False)
    group.update_attributes({"arrays": [x for x in group.attrs["arrays"] if x != "f_error"]})
    loaded = gs.load(tmp_path / "run.zarr")
    with refused("gyrospark.*f_error"):
        loaded[:]
    with pytest.raises(gs.InputError, match="array 'f_error'"):
        record(gl3, TOP.q0, TOP.p0, out=tmp_path / "run.zarr", steps=8, dt=RUN["dt"],
                  parameters=PARAMETERS, resume=True)
