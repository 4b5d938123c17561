"""Trajectories as tables: CSV, pandas and xarray agree with each other and with the arrays."""

from __future__ import annotations

import csv
import sys

import numpy as np
import pandas
import pytest

import gyrospark as gs
import systems
from calls import RUN, TOP
from stores import record


@pytest.fixture(scope="module")
def tops():
    model = gs.models.double_top()
    return systems.stepper("double_top").integrate(
        model.q0, model.p0, dt=1e-3, steps=12, parameters=dict(model.parameters))


def read(path):
    with path.open(encoding="utf-8") as file:
        titles, *rows = csv.reader(file)
    return titles, np.array(rows)


def test_euler_angles_come_with_the_states(tops, tmp_path):
    told = {"euler": "ZYX", "degrees": True, "angular_velocity": "space"}
    path = tops.save(tmp_path / "tops.csv", **told)
    titles, rows = read(path)
    frame, dataset = tops.table(**told), tops.dataset(**told)
    assert titles[0] == "time" == frame.index.name
    assert titles[1:] == list(frame.columns)
    assert len(set(titles)) == len(titles)
    for name in tops.bodies:
        body = tops.body(name)
        angles, rates = body.euler("ZYX", degrees=True), body.angular_velocity("space")
        for k, axis in enumerate("ZYX"):
            title = f"{name}_euler{k + 1}_{axis}"
            assert np.array_equal(rows[:, titles.index(title)].astype(float), angles[:, k])
            assert np.array_equal(frame[title], angles[:, k])
            assert np.array_equal(frame[f"{name}_omega{k + 1}"], rates[:, k])
        assert np.array_equal(dataset.euler.sel(body=name), angles)
        assert np.array_equal(dataset.angular_velocity.sel(body=name), rates)
        assert np.array_equal(dataset.attitude.sel(body=name), body.attitude)
    assert dataset.euler.attrs["units"] == "degree"
    assert np.array_equal(frame["b_x"], tops.q[:, 8])
    assert np.array_equal(dataset.q.sel(coordinate="b_x"), tops.q[:, 8])
    assert np.array_equal(dataset.p.sel(coordinate="b_x"), tops.p[:, 8])
    last = dataset.multipliers.sel(constraint="joint: z")[1:, -1]
    assert np.array_equal(last, tops.multipliers[:, -1, -1])
    node = tops.multipliers.shape[1] - 1
    assert np.array_equal(frame[f"multipliers{node}_joint_z"][1:], last)
    assert np.array_equal(dataset.time, tops.t)
    assert np.isnan(dataset.multipliers[0]).all()


def test_a_dataset_has_the_names_of_a_store(gl3, tmp_path):
    run = gl3.integrate(TOP.q0, TOP.p0, steps=5, **RUN)
    stored = record(gl3, TOP.q0, TOP.p0, steps=5, **RUN, out=tmp_path / "run.zarr").dataset()
    made = run.dataset()
    assert {*stored.data_vars} <= {*made.data_vars}
    for name in stored.data_vars:
        assert made[name].dims == stored[name].dims
        assert made[name].attrs["long_name"] == stored[name].attrs["long_name"]
        assert np.array_equal(made[name], stored[name], equal_nan=True)
    assert list(made.coordinate.values) == ["q0", "q1", "q2", "q3"]


def test_names_of_quantities_and_columns_that_are_taken():
    run = systems.run("pendulum", systems.stepper("pendulum"), 3)
    frame = run.table()
    assert np.array_equal(frame["angle"], run.quantity("angle"))
    assert np.array_equal(frame["x"], run.q[:, 0])
    assert "quantity_angle" in run.dataset()
    with pytest.raises(gs.InputError, match=r"'pendulum'.*rigid"):
        run.table(euler="zyx")
    with pytest.raises(gs.InputError, match=r"'pendulum'.*rigid"):
        run.dataset(angular_velocity="body")


def test_wide_numbers_keep_their_digits(tmp_path):
    long = systems.stepper("heavy_top", real="long-double")
    q0, p0 = long.project(TOP.q0, TOP.p0, parameters=RUN["parameters"])
    run = long.integrate(q0, p0, steps=2, **RUN)
    titles, rows = read(run.save(tmp_path / "long.csv"))
    saved = pandas.read_parquet(run.save(tmp_path / "long.parquet"))
    for name, numbers in (("time", run.t), ("q1", run.q[:, 1]), ("q2", run.q[:, 2])):
        # times are doubles here, whose shortest text is another long double
        assert np.array_equal(rows[:, titles.index(name)].astype(np.longdouble), numbers)
        assert np.array_equal(saved[name].to_numpy().astype(str).astype(np.longdouble), numbers)
    assert run.table()["q1"].dtype == np.longdouble


def test_what_cannot_be_written(tops, tmp_path, monkeypatch):
    with pytest.raises(gs.InputError, match=r"\.csv"):
        tops.save(tmp_path / "run.txt")
    with pytest.raises(gs.InputError, match="no sequence 'zz'"):
        tops.save(tmp_path / "run.csv", euler="zz")
    with pytest.raises(gs.InputError, match="Unknown frame"):
        tops.dataset(angular_velocity="inertial")
    assert not list(tmp_path.iterdir())
    monkeypatch.setitem(sys.modules, "pandas", None)
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(gs.errors.MissingDependencyError, match=r"pip install .pandas"):
        tops.table()
    with pytest.raises(gs.errors.MissingDependencyError, match="xarray"):
        tops.dataset()


def test_some_of_the_columns(tops, tmp_path):
    """By names, patterns and arrays, in that order behind the time; the others stay as they are."""
    titles, rows = read(tops.save(tmp_path / "all.csv"))
    asked = ["energy", "?_q*", "multipliers", "energy"]
    some, numbers = read(tops.save(tmp_path / "some.csv", columns=asked))
    assert some == ["time", "energy", *(f"{body}_q{k}" for body in "ab" for k in range(4)),
                    *(title for title in titles if title.startswith("multipliers"))]
    assert np.array_equal(numbers, rows[:, [titles.index(title) for title in some]])
    saved = tops.save(tmp_path / "saved.csv", columns=asked)
    assert saved.read_bytes() == (tmp_path / "some.csv").read_bytes()
    assert list(tops.table(columns="energy")) == ["energy"]
    added = tops.table(euler="ZYX", columns=["a_euler*", "p"])
    assert list(added)[:3] == ["a_euler1_Z", "a_euler2_Y", "a_euler3_X"]
    assert list(added)[3:] == list(tops.momenta)
    for wanted in ("energi", ["*_angle"], [3], 3):
        with pytest.raises(gs.InputError, match="columns"):
            tops.save(tmp_path / "no.csv", columns=wanted)
    for name in ("no.npz", "no.nc"):
        with pytest.raises(gs.InputError, match="columns"):
            tops.save(tmp_path / name, columns=["energy"])
    assert not [*tmp_path.glob("no.*")]


def test_some_columns_of_a_stored_run(gl3, tmp_path, gyrospark):
    """Those that a trajectory in memory writes, by Python and by the command."""
    how = {"steps": 12, "every": 5, "dt": 1e-3, "parameters": RUN["parameters"]}
    kept = record(gl3, TOP.q0, TOP.p0, out=tmp_path / "run.zarr", **how)
    asked = ["*_error", "p", "multipliers"]
    path = gl3.integrate(TOP.q0, TOP.p0, **how).save(tmp_path / "mine.csv", columns=asked)
    mine = path.read_bytes()
    assert kept.save(tmp_path / "a.csv", columns=asked).read_bytes() == mine
    assert gyrospark("export", tmp_path / "run.zarr", tmp_path / "b.csv", "--columns",
                     ", ".join(asked)).code == 0
    assert (tmp_path / "b.csv").read_bytes() == mine
    refused = gyrospark("export", tmp_path / "run.zarr", tmp_path / "c.csv", "--columns", "x")
    assert refused.code == 2
    assert "columns" in refused.stderr
