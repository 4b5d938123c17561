"""What every result offers by the same names: save, show, plot, table, dataset, rows and slices."""

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
    for part in (run[rows], stored[rows]):
        assert np.array_equal(part.t, run.t[rows])
        assert np.array_equal(part.q, run.q[rows])
        assert np.array_equal(part.multipliers, run.multipliers[chosen[1:] - 1])
        assert part.every == 2 * (rows.step or 1)
        t = part.events["q1"].t
        assert np.array_equal(t, run.events["q1"].t[
            (run.events["q1"].t >= part.t[0])
            & ((run.events["q1"].t <= part.t[-1]) | (chosen[-1] + (rows.step or 1) > 10))])


@pytest.mark.parametrize("rows", [slice(5, 2), slice(None, None, -1), slice("a", None)])
def test_what_is_no_slice_is_refused(rows, run):
    with pytest.raises(gs.InputError, match="states"):
        run[rows]


@pytest.mark.parametrize("real", [
    "double", pytest.param("long-double", marks=pytest.mark.slow), "float128"])
@pytest.mark.parametrize("end", [".npz", ".nc", ".zarr"])
def test_what_is_saved_is_loaded_with_all_digits(real, end, tmp_path):
    step = systems.stepper("driven_pendulum", real=real)
    whole = systems.run("driven_pendulum", step, 9, every=2, events=gs.Event("along", level=0.9))
    again = gs.load(whole.save(tmp_path / f"run{end}"))
    for name in ("t", "q", "p", "multipliers", "iterations", "energies", "work",
                 "quantity_values"):
        assert np.array_equal(getattr(again, name), getattr(whole, name)), name
    assert (again.dt, again.every, again.report) == (whole.dt, whole.every, whole.report)
    assert (again.parameters, again.manifest) == (whole.parameters, whole.manifest)
    for part in ("t", "q", "p", "steps", "rising", "elapsed"):
        assert np.array_equal(getattr(again.events["along"], part),
                              getattr(whole.events["along"], part))


def test_tables_and_files_of_columns_agree(run, stored, tmp_path):
    frame = run.table()
    assert frame.index.name == "time"
    assert np.array_equal(frame[["q0", "q1", "q2", "q3"]], run.q)
    for one in (run, stored):
        pandas.testing.assert_frame_equal(one.table(), frame)
        parquet = pandas.read_parquet(one.save(tmp_path / "run.parquet")).set_index("time")
        pandas.testing.assert_frame_equal(parquet, frame)
        csv = pandas.read_csv(one.save(tmp_path / "run.csv"))
        assert np.array_equal(csv.set_index("time")[list(frame)], frame, equal_nan=True)
    crossings = pandas.read_parquet(tmp_path / "run.events.parquet")
    assert np.array_equal(crossings["time"], run.events["q1"].t)
    some = run.table(["energy", "q1"])
    assert list(some) == ["energy", "q1"]
    assert list(pandas.read_parquet(run.save(tmp_path / "a.parquet", columns="p"))) == [
        "time", "p0", "p1", "p2", "p3"]


def test_an_ensemble_has_the_same_face(gl3, tmp_path):
    many = gl3.integrate_ensemble([TOP, TOP], dt=[1e-3, 2e-3], steps=4)
    frame = many.table()
    assert frame.index.names == ["trajectory", "time"]
    assert np.array_equal(frame["q0"], many.q[..., 0].ravel())
    assert np.array_equal(many.dataset().q, many.q)
    saved = pandas.read_parquet(many.save(tmp_path / "many.parquet"))
    assert np.array_equal(saved["p3"], many.p[..., 3].ravel())
    assert len(many.plot("energy", "q1").axes) == 2
    assert many.show(member=1).page
    with pytest.raises(gs.InputError, match="member = 2"):
        many.show(member=2)


def test_values_are_drawn_by_name(run, stored, tmp_path):
    for one in (run, stored):
        assert [len(axes.lines) for axes in one.plot("energy", "q1").axes] == [1, 1]
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
    for one in (run, stored):
        one.show(tmp_path / name, **options)
        assert (tmp_path / name).stat().st_size > 1000


@pytest.mark.parametrize(("path", "options", "said"), [
    ("run.svg", {}, "plot"), ("run.png", {"fps": 3}, "fps.*azimuth"),
    (None, {"tme": 1.0}, "page"), ("run.glb", {"mesh": "none"}, "mean meshes"),
    (None, {"shape": "sphere"}, "Unknown shape 'sphere'"), ("run.avi", {}, r"\.gif.*\.mp4"),
    ("run.gltf", {}, r"'run\.gltf'.*\.glb"), ("run.glb", {"meshes": "some"}, "'some'")])
def test_what_cannot_be_shown_is_refused(path, options, said, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(gs.InputError, match=said):
        run.show(path, **options)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("call", "said"), [
    (lambda r: r.save("run.npz", columns="q"), "columns"),
    (lambda r: r.save("run.nc", euler="ZYX"), "euler"),
    (lambda r: r.save("run.zarr", degrees=True), "degrees"),
    (lambda r: gs.load("run.csv"), "pandas"), (lambda r: gs.load("none.nc"), "read"),
    (lambda r: gs.load("none.zarr"), "stored"), (lambda r: gs.load(3), "path")])
def test_what_has_no_columns_or_no_model_is_refused(call, said, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(gs.InputError, match=said):
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
    """Interrupted, to the same bytes; to more steps and to a later time, with the same states."""
    step = systems.stepper("dragged_pendulum", real=real)
    begin = gs.Start(*systems.start("dragged_pendulum", step),
                     systems.case("dragged_pendulum").parameters, 0.5)
    asked = {"dt": 0.0625, "every": 3, "events": gs.Event("height", level=-0.8),
             "solver": gs.Solver("auto", tolerance=1e-12, max_iterations=40)}
    whole = step.integrate(begin, steps=24, out=tmp_path / "whole.zarr", **asked)
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK_WITH_EVENTS", 5)
    with pytest.raises(Interrupted):
        step.integrate(begin, steps=24, out=tmp_path / "pieces.zarr", progress=ends_after(2),
                       **asked)
    assert gs.resume(tmp_path / "pieces.zarr").status == "complete"
    assert_same_bytes(tmp_path / "whole.zarr", tmp_path / "pieces.zarr")
    step.integrate(begin, steps=7, out=tmp_path / "longer.zarr", **asked)
    gs.resume(tmp_path / "longer.zarr", steps=16)
    assert_same(gs.resume(tmp_path / "longer.zarr", t_end=2.0), whole)


@pytest.mark.parametrize(("more", "said"), [
    ({"t_eval": [0.001]}, "t_eval"), ({"tangents": gs.Tangents()}, "tangents"),
    ({"out": "run.npz"}, "zarr")])
def test_what_stores_do_not_have_is_refused(more, said, gl3, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(gs.InputError, match=said):
        gl3.integrate(TOP, steps=3, **RUN | {"out": "run.zarr"} | more)
    assert not list(tmp_path.iterdir())


def test_inputs_of_a_stored_run_are_held(tmp_path):
    step, parameters = systems.stepper("pushed_pendulum"), {"k": 2.0}
    start = gs.Start([0.6, -0.8], [0.8, 0.6], parameters)
    held = step.integrate(start, dt=0.02, steps=9, inputs=[0.5, -1.0], out=tmp_path / "run.zarr")
    assert np.array_equal(held.q, step.integrate(start, dt=0.02, steps=9, inputs=[0.5, -1.0]).q)
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
    arrays = [one.name for one in fields(gs.Trajectory) if one.type == "Array"]
    assert sorted(arrays) == sorted(one.attribute for one in OUTPUTS)
    for one in OUTPUTS:
        assert one.attribute in gs.Trajectory.__doc__


def test_files_and_stores_have_the_same_in_the_same_order(gl3):
    run = gl3.integrate(TOP.q0, TOP.p0, steps=4, **RUN)
    assert list(states_of(run)) == [one.name for one in fields_of(gl3.manifest)]
    assert list(states_of(run)) == [
        name for one in OUTPUTS for name in names_in_files(one, gl3.manifest)]
    assert run.panels() == {}  # energy and constraints have pictures of their own


def test_a_file_without_an_output_is_refused(gl3, tmp_path):
    """Neither damage nor made up."""
    path = gl3.integrate(TOP.q0, TOP.p0, steps=4, **RUN).save(tmp_path / "run.npz")
    with np.load(path) as file:
        kept = {name: file[name] for name in file if name != "f_errors"}
    np.savez(path, **kept)
    with refused("f_errors.*gyrospark.*damaged"):
        gs.load(path)
    about = json.loads(str(kept["about"]))
    del about["report"]["steps"]
    np.savez(path, **kept | {"about": np.array(json.dumps(about))})
    with refused(r"run\.npz.*damaged"):
        gs.load(path)


def test_a_store_without_an_output_is_read_and_not_resumed(gl3, tmp_path):
    """As of an earlier version: its other arrays can be read, but no run goes on from it."""
    whole = record(gl3, TOP.q0, TOP.p0, out=tmp_path / "run.zarr", steps=4, **RUN)
    assert equal(whole[:], gl3.integrate(TOP.q0, TOP.p0, steps=4, **RUN))
    shutil.rmtree(tmp_path / "run.zarr" / "f_error")
    group = zarr.open_group(tmp_path / "run.zarr", mode="r+", use_consolidated=False)
    group.update_attributes({"arrays": [x for x in group.attrs["arrays"] if x != "f_error"]})
    found = gs.load(tmp_path / "run.zarr")
    with refused("gyrospark.*f_error"):
        found[:]
    with pytest.raises(gs.InputError, match="array 'f_error'"):
        record(gl3, TOP.q0, TOP.p0, out=tmp_path / "run.zarr", steps=8, dt=RUN["dt"],
                  parameters=PARAMETERS, resume=True)
