"""Files of stored runs have the same numbers, to the bit, or a sentence says why not."""

from __future__ import annotations

import csv
import json
import re
import sys
import warnings
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray
import zarr

import gyrospark as gs
import systems
from calls import integrate
from command_line import FAILS, RUN, refused
from gyrospark.runtime.results.state_columns import headings
from stores import START, Interrupted, assert_same, ends_after, record, small_blocks

ENDS = [".csv", ".nc", ".npz"]


def record_case(out, name="heavy_top", real="double", steps=25, every=2, **options):
    """Return the stored run of a case of the catalogue."""
    step, case = systems.stepper(name, real=real), systems.case(name)
    q, p = systems.start(name, step)
    return record(step, gs.Start(q, p, t=case.t0), out=out, dt=case.dt, steps=steps,
                     every=every, parameters=case.parameters, **options)


RUNS = {
    "top": record_case,
    "forced": partial(record_case, name="dragged_pendulum", steps=35, every=3),
    "two constraints": partial(record_case, name="two_rods", steps=10, every=1),
    "long double": partial(record_case, real="long-double"),
    "one state": partial(record_case, steps=0, every=1),
}


@pytest.fixture(scope="module", params=[  # the top is exported in long double
    pytest.param(run, id=name, marks=[pytest.mark.slow] * (
        name in ("long double", "two constraints")))
    for name, run in RUNS.items() if name != "top"])  # the columns of two are looked at below
def stored(request, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        small_blocks(patch, 4)
        return request.param(tmp_path_factory.mktemp("stored") / "run.zarr")


def read_csv(path):
    """Return a CSV file's columns by their headings."""
    with path.open(newline="", encoding="utf-8") as file:
        headings, *rows = csv.reader(file)
    assert len(set(headings)) == len(headings)
    columns = np.array(rows, dtype=float).reshape(len(rows), len(headings))
    return {name: columns[:, i] for i, name in enumerate(headings)}


NAMES = {
    "top": "time q0 q1 q2 q3 p0 p1 p2 p3 energy g_error f_error iterations multipliers0 "
           "multipliers1 multipliers2",
    "forced": "time x y u v energy g_error f_error iterations multipliers0 multipliers1 "
              "multipliers2 work height drive spin phase three ratio rates",
    "two constraints": "time x1 y1 x2 y2 px1 py1 px2 py2 energy g_error f_error iterations "
                       + " ".join(f"multipliers{i}_g{j}" for i in range(3) for j in range(2))
                       + " gap held",
}


def read_netcdf(path):
    """Return a NetCDF file's dataset."""
    with xarray.open_dataset(path, engine="h5netcdf", decode_times=False) as file:
        return file.load()


def test_files_have_the_numbers_of_the_store(stored, tmp_path):
    """Each kind of file agrees to the bit, exported or saved; xarray has no warning."""
    dataset, trajectory = stored.dataset().load(), stored[:]
    exported, saved = ({end: write(tmp_path / f"{name}{end}") for end in ENDS}
                       for name, write in (("stored", stored.save), ("saved", trajectory.save)))
    assert sorted(tmp_path.glob(".*.part")) == []
    assert_same(gs.load(exported[".npz"]), trajectory)

    columns = read_csv(exported[".csv"])
    expected = [array.values.reshape(len(array), -1)
                for array in (dataset["time"], *dataset.data_vars.values())
                if "byte" not in array.dims]
    numbers = np.stack(list(columns.values()), axis=1)
    # Times of wide types have more digits there, and may lie halfway between doubles.
    np.testing.assert_array_max_ulp(numbers[:, 0], expected[0][:, 0].astype(float))
    np.testing.assert_array_equal(numbers[:, 1:],
                                  np.concatenate(expected[1:], axis=1).astype(float))
    assert saved[".csv"].read_bytes() == exported[".csv"].read_bytes()

    file, saved_file = read_netcdf(exported[".nc"]), read_netcdf(saved[".nc"])
    xarray.testing.assert_equal(file, dataset)
    assert set(file.variables) == set(dataset.variables) == set(saved_file.variables)
    wide = [name for name in file if name.endswith("_bytes")]  # a NaN has many
    xarray.testing.assert_equal(file.drop_vars(wide), saved_file.drop_vars(wide))
    assert file.attrs["report"] == saved_file.attrs["report"]
    for key in ("manifest", "run"):
        assert json.loads(file.attrs[key]) == stored.attributes[key]
    for name in dataset.variables:
        assert file[name].attrs["long_name"] == dataset[name].attrs["long_name"]
        kinds = {file[name].dtype, dataset[name].dtype}
        assert len(kinds) == 1 or {kind.kind for kind in kinds} <= set("OUT")  # text

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        opened = xarray.open_zarr(stored.path).load()
    group = zarr.open_group(stored.path, mode="r")
    assert {name for name, _ in group.arrays()} == {*stored.attributes["arrays"], "checkpoint",
                                                     "source"}
    assert opened.sizes["time"] == dataset.sizes["time"] == stored.states
    assert {"checkpoint", "source"}.isdisjoint(dataset)
    if stored.attributes["manifest"]["real"] == "long-double":
        assert dataset["q_bytes"].dims == ("time", "coordinate", "byte")
        assert dataset.sizes["byte"] == 16
        np.testing.assert_array_equal(dataset["q"], trajectory.q.astype(float))
        assert (trajectory.q != trajectory.q.astype(float)).any()


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow] * (name != "forced")) for name in NAMES])
def test_files_go_by_the_systems_names(name, tmp_path):
    stored = RUNS[name](tmp_path / "run.zarr")
    assert " ".join(read_csv(stored.save(tmp_path / "run.csv"))) == NAMES[name]
    coordinates, momenta = stored[:].coordinates, stored[:].momenta
    for dataset in (stored.dataset(), read_netcdf(stored.save(tmp_path / "run.nc"))):
        coordinate = coordinates[1]
        np.testing.assert_array_equal(dataset["p"].sel(coordinate=coordinate), stored[:].p[:, 1])
    assert stored.dataset()["p"].attrs["components"] == [*momenta]
    with np.load(stored.save(tmp_path / "run.npz")) as file:  # for readers without a manifest
        assert file["coordinates"].tolist() == [*coordinates]
        assert file["momenta"].tolist() == [*momenta]
        assert file["quantities"].tolist() == [*stored[:].quantities]


def test_headings_differ_whatever_the_names():
    """A heading that occurs twice gets a prefix of its array."""
    system = SimpleNamespace(coordinates=("energy", "work"), momenta=("p", "q0"),
                             velocity_names=(), constraint_names=(),
                             velocity_constraint_names=(),
                             quantities=("energy", "q_energy", "spin"))
    shapes = {"time": (), "q": (2,), "p": (2,), "energy": (), "work": (),
              **{f"quantity_{name}": () for name in system.quantities}}
    assert headings(system, shapes) == [
        "time", "q_energy", "q_work", "p", "q0", "energy", "work", "quantity_energy",
        "quantity_q_energy", "spin"]


def test_unfinished_run(gl3, tmp_path, monkeypatch):
    """Files hold the states stored before the end, and no more."""
    small_blocks(monkeypatch, 4)
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 7)
    with pytest.raises(Interrupted):
        record(gl3, **START, steps=60, out=tmp_path / "run.zarr", progress=ends_after(6))
    recording = gs.load(tmp_path / "run.zarr")
    exact = integrate(gl3, **START, steps=60).q[: recording.states]
    csv_file, netcdf, npz = (recording.save(tmp_path / f"run{end}") for end in ENDS)
    np.testing.assert_array_equal(gs.load(npz).q, exact)
    np.testing.assert_array_equal(read_csv(csv_file)["q3"], exact[:, 3])
    np.testing.assert_array_equal(read_netcdf(netcdf)["q"], exact)


@pytest.mark.parametrize("name", ["x.nc", "x.zarr", "a b γ.csv"])
def test_run_writes_what_its_name_says(name, gyrospark, tmp_path):
    """Numbers on stdout and states in the file do not depend on --out; no other file stays."""
    answer = gyrospark(*RUN, "--every", "3", "--out", name, "--json")
    assert answer.code == 0, answer.stderr
    plain = gyrospark(*RUN, "--every", "3", "--json")
    for key in plain.document.keys() - {"seconds", "ns_per_step"}:
        assert answer.document[key] == plain.document[key]
    expected = {name, f".{name}.lock"} if name.endswith(".zarr") else {name}
    assert {path.name for path in tmp_path.iterdir()} == expected
    step = systems.stepper("heavy_top")
    q = integrate(step, **START, steps=20, every=3).q
    if name.endswith(".csv"):
        np.testing.assert_array_equal(read_csv(Path(name))["q0"], q[:, 0])
    elif name.endswith(".nc"):
        np.testing.assert_array_equal(read_netcdf(name)["q"], q)
    else:
        np.testing.assert_array_equal(gs.load(name)[:].q, q)


@pytest.mark.parametrize("end", [".csv", ".zarr"])  # .npz in test_cli.py
def test_failed_run_writes_what_it_has(end, gyrospark, tmp_path):
    answer = gyrospark(*FAILS, "--out", f"x{end}")
    assert answer.code == 1
    assert "failed: " in answer.stderr
    assert (tmp_path / f"x{end}").exists()
    if end != ".zarr":
        assert [path.name for path in tmp_path.iterdir()] == [f"x{end}"]


def test_export_command(gyrospark, tmp_path):
    assert gyrospark(*RUN, "--out", "run.zarr").code == 0
    for end in ENDS:
        answer = gyrospark("export", "run.zarr", f"run{end}")
        assert answer.code == 0, answer.stderr
        assert re.fullmatch(rf"run{end}: 21 states .* 20 steps .*complete.*\n", answer.stdout)
    assert len(read_csv(tmp_path / "run.csv")["time"]) == 21
    assert len(gs.load(tmp_path / "run.npz")) == 21


def test_euler_angles_from_the_command_line(gyrospark, tmp_path):
    """The columns equal the columns of ``save`` to the bit."""
    angles = ("--euler", "ZXZ", "--degrees")
    assert gyrospark(*RUN, "--out", "run.zarr", "--event", "q1=0.25").code == 0
    answer = gyrospark("export", "run.zarr", "stored.csv", *angles)
    assert answer.code == 0, answer.stderr
    trajectory = gs.load("run.zarr")[:]
    saved = trajectory.save("asked.csv", euler="ZXZ", degrees=True)
    assert (tmp_path / "stored.csv").read_bytes() == saved.read_bytes()
    euler = trajectory.body().euler("ZXZ", degrees=True)
    columns = read_csv(saved)
    for k, axis in enumerate("ZXZ"):
        assert [float(x) for x in columns[f"body_euler{k + 1}_{axis}"]] == euler[:, k].tolist()
    events = {(tmp_path / f"{name}.events.csv").read_bytes() for name in ("stored", "asked")}
    assert len(events) == 1
    assert len(trajectory.events["q1"]) == len(events.pop().splitlines()) - 1 > 0


def test_export_that_is_refused(gyrospark, tmp_path):
    (tmp_path / "folder.csv").mkdir()
    assert gyrospark(*RUN, "--out", "run.zarr").code == 0
    paths = sorted(tmp_path.rglob("*"))
    kinds = ".npz, .csv, .nc"
    for words, *options in (
            (kinds, "run.txt"), (kinds, "run"), ("FILE", ""), (kinds, ".csv"),
            ("'none/run.csv'", "none/run.csv"), ("folder", "folder.csv"),
            ("'ZZX'", "x.csv", "--euler", "ZZX"), ("'x.npz'", "x.npz", "--euler", "ZYX"),
            ("degrees", "x.csv", "--degrees")):
        refused(gyrospark("export", "run.zarr", *options), words)
    refused(gyrospark("export", "none.zarr", "x.csv"), "'none.zarr'", "not a run")
    assert sorted(tmp_path.rglob("*")) == paths


def test_missing_package_is_named(gyrospark, monkeypatch, tmp_path):
    """The refusal comes before a step is taken."""
    assert gyrospark(*RUN, "--out", "run.zarr").code == 0
    monkeypatch.setitem(sys.modules, "h5netcdf", None)
    monkeypatch.setattr(gs.Stepper, "integrate", lambda *_, **__: pytest.fail("steps are taken"))
    refused(gyrospark(*RUN, "--out", "x.nc"), "h5netcdf>=")
    refused(gyrospark("export", "run.zarr", "x.nc"), "h5netcdf>=")
    with pytest.raises(gs.errors.MissingDependencyError):
        gs.load("run.zarr").save("x.nc")
    assert sorted(p.name for p in tmp_path.iterdir()) == [".run.zarr.lock", "run.zarr"]


def test_stopped_run_writes_what_it_has(gl3, gyrospark, monkeypatch, tmp_path):
    """After a signal the file has the states so far, and no other file stays."""
    from gyrospark.core.interrupts import Interrupts

    long = ["run", "fast-top", "--scheme", "G-L", "--stages", "3", "--dt", "1e-3", "--steps",
            "5000", "--every", "10", "--out", "x.csv"]
    with monkeypatch.context() as patch:
        patch.setattr(Interrupts, "is_requested", True)
        patch.setattr(Interrupts, "__init__", lambda self: setattr(self, "signal", 15))
        answer = gyrospark(*long)
    assert answer.code == 143
    assert "'x.csv'" in answer.stderr
    assert len(read_csv(tmp_path / "x.csv")["time"]) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["x.csv"]
