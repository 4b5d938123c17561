"""Tables, datasets and files of runs and ensembles agree with each other and with the arrays."""

from __future__ import annotations

import csv
import json
import sys

import numpy as np
import pandas
import pytest
import xarray

import gyrospark as gs
import systems
from calls import RUN, TOP, refused
from event_runs import pendulum, start
from gyrospark.runtime.results.state_columns import states_of
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
    options = {"euler": "ZYX", "degrees": True, "angular_velocity": "space"}
    path = tops.save(tmp_path / "tops.csv", **options)
    titles, rows = read(path)
    frame, dataset = tops.table(**options), tops.dataset(**options)
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
    dataset = run.dataset()
    assert {*stored.data_vars} <= {*dataset.data_vars}
    for name in stored.data_vars:
        assert dataset[name].dims == stored[name].dims
        assert dataset[name].attrs["long_name"] == stored[name].attrs["long_name"]
        assert np.array_equal(dataset[name], stored[name], equal_nan=True)
    assert list(dataset.coordinate.values) == ["q0", "q1", "q2", "q3"]


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
    """Names, patterns and arrays choose columns, in that order behind the time."""
    titles, rows = read(tops.save(tmp_path / "all.csv"))
    patterns = ["energy", "?_q*", "multipliers", "energy"]
    chosen, numbers = read(tops.save(tmp_path / "some.csv", columns=patterns))
    assert chosen == ["time", "energy", *(f"{body}_q{k}" for body in "ab" for k in range(4)),
                      *(title for title in titles if title.startswith("multipliers"))]
    assert np.array_equal(numbers, rows[:, [titles.index(title) for title in chosen]])
    saved = tops.save(tmp_path / "saved.csv", columns=patterns)
    assert saved.read_bytes() == (tmp_path / "some.csv").read_bytes()
    assert list(tops.table(columns="energy")) == ["energy"]
    added = tops.table(euler="ZYX", columns=["a_euler*", "p"])
    assert list(added)[:3] == ["a_euler1_Z", "a_euler2_Y", "a_euler3_X"]
    assert list(added)[3:] == list(tops.momenta)
    for columns in ("energi", ["*_angle"], [3], 3):
        with pytest.raises(gs.InputError, match="columns"):
            tops.save(tmp_path / "no.csv", columns=columns)
    for name in ("no.npz", "no.nc"):
        with pytest.raises(gs.InputError, match="columns"):
            tops.save(tmp_path / name, columns=["energy"])
    assert not [*tmp_path.glob("no.*")]


def test_some_columns_of_a_stored_run(gl3, tmp_path, gyrospark):
    """Python and the command write the same columns as a trajectory in memory."""
    options = {"steps": 12, "every": 5, "dt": 1e-3, "parameters": RUN["parameters"]}
    stored = record(gl3, TOP.q0, TOP.p0, out=tmp_path / "run.zarr", **options)
    patterns = ["*_error", "p", "multipliers"]
    path = gl3.integrate(TOP.q0, TOP.p0, **options).save(tmp_path / "mine.csv", columns=patterns)
    expected = path.read_bytes()
    assert stored.save(tmp_path / "a.csv", columns=patterns).read_bytes() == expected
    assert gyrospark("export", tmp_path / "run.zarr", tmp_path / "b.csv", "--columns",
                     ", ".join(patterns)).code == 0
    assert (tmp_path / "b.csv").read_bytes() == expected
    refused = gyrospark("export", tmp_path / "run.zarr", tmp_path / "c.csv", "--columns", "x")
    assert refused.code == 2
    assert "columns" in refused.stderr


LENGTHS = [0.5, 1.0, 2.0]


def ensemble(real="double", **options):
    q0, p0 = pendulum(real).project(*start(), parameters={"g": 1})
    return pendulum(real).integrate_ensemble(
        [q0] * 3, [p0] * 3, dt=[0.05, 0.1, 0.2], steps=20, every=3, parameters={"g": LENGTHS},
        events=gs.Event("side"), **options)


def failing():
    """Return an ensemble of three, the second of which fails in its first step."""
    q0, p0 = start()
    return pendulum().integrate_ensemble([q0] * 3, [p0] * 3, dt=[0.05, 20.0, 0.05], steps=20,
                                         every=3, parameters={"g": LENGTHS},
                                         solver=gs.Solver("fixed-point", max_iterations=20))


def test_a_dataset_has_what_the_members_have() -> None:
    trajectories = ensemble()
    dataset = trajectories.dataset()
    for i, member in enumerate(trajectories.members):
        for name, values in states_of(member).items():
            array = dataset[name].sel(trajectory=i)
            assert np.array_equal(array, values, equal_nan=True), name
        events = dataset.event_side_t[dataset.event_side_trajectory.values == i]
        assert np.array_equal(events, member.events["side"].t)
    assert dataset.dt.values.tolist() == [0.05, 0.1, 0.2]
    assert dataset.parameter_g.values.tolist() == LENGTHS
    assert dataset.status.values.tolist() == ["complete"] * 3
    assert dataset.sizes["state"] == 8
    by_g = dataset.swap_dims(trajectory="parameter_g")
    assert np.array_equal(by_g.q.sel(parameter_g=2.0, coordinate="x"), trajectories.q[2, :, 0])


def test_wide_numbers_keep_their_bytes(tmp_path) -> None:
    """Numbers in float128 are bytes of the archive, and doubles elsewhere."""
    step, case = systems.stepper("heavy_top", real="float128"), systems.case("heavy_top")
    q, p = systems.start("heavy_top", step)
    trajectories = step.integrate_ensemble([q] * 2, [p] * 2, dt=[case.dt, 2 * case.dt], steps=2,
                                           parameters=case.parameters)
    with np.load(trajectories.save(tmp_path / "run.npz"), allow_pickle=False) as file:
        assert json.loads(str(file["about"]))["manifest"]["real"] == "float128"
        assert any(file[name].shape == (*trajectories.q.shape, 16) for name in file.files)
    with xarray.open_dataset(trajectories.save(tmp_path / "run.nc"), engine="h5netcdf",
                             decode_times=False) as file:
        assert np.array_equal(file.q, trajectories.q.astype(float))


def test_a_failure_is_reported() -> None:
    trajectories = failing()
    assert set(trajectories.failures) == {1}
    dataset = trajectories.dataset()
    assert dataset.status.values.tolist() == [
        "complete", trajectories.failures[1].reason, "complete"]
    assert dataset.steps.values.tolist() == [20, 0, 20]
    assert np.isnan(dataset.energy[1, 1:]).all()
    assert np.isfinite(dataset.energy[::2]).all()
    assert (dataset.iterations[1] == 0).all()
    assert dataset.iterations.dtype.kind == "i"


@pytest.mark.parametrize("real", ["double", pytest.param("float128", marks=pytest.mark.slow)])
def test_files(real: str, tmp_path) -> None:
    """Readers of other programs read all three formats."""
    trajectories = ensemble(real)
    with np.load(trajectories.save(tmp_path / "run.npz"), allow_pickle=False) as file:
        assert file["parameter_g"].shape[0] == 3
        assert json.loads(str(file["about"]))["manifest"]["name"] == pendulum(real).name
        if real != "float128":
            assert np.array_equal(file["q"], trajectories.q)
            assert np.array_equal(file["event_side_t"], np.concatenate(
                [member.events["side"].t for member in trajectories.members]))
    with xarray.open_dataset(trajectories.save(tmp_path / "run.nc"), engine="h5netcdf",
                             decode_times=False) as file:
        assert np.array_equal(file.q, trajectories.q.astype(float))
        assert file.status.values.tolist() == ["complete"] * 3
        assert file.trajectory.values.tolist() == [0, 1, 2]
        assert file.event_side_trajectory.values.tolist() == np.repeat(
            np.arange(3), trajectories.events["side"].count).tolist()
    with trajectories.save(tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 24
    assert [float(row["x"]) for row in rows] == (
        trajectories.q[..., 0].astype(float).ravel().tolist())
    assert [int(row["trajectory"]) for row in rows] == np.repeat(np.arange(3), 8).tolist()
    with (tmp_path / "run.events.csv").open(newline="") as file:
        assert len(list(csv.reader(file))) == 1 + trajectories.events["side"].count.sum()


@pytest.mark.parametrize("name", ["run.npz", "run.nc"])
def test_an_ensemble_is_not_read_as_a_run(tmp_path, name) -> None:
    path = ensemble().save(tmp_path / name)
    with refused("ensemble"):
        gs.load(path)


def test_another_ending_is_refused(tmp_path) -> None:
    with refused(r"\.npz, \.csv, \.nc"):
        ensemble().save(tmp_path / "run.mat")
    with refused(r"columns.*run\.npz"):
        ensemble().save(tmp_path / "run.npz", columns=["t"])
    with pytest.raises(gs.GyrosparkError, match="nowhere"):
        ensemble().save(tmp_path / "nowhere" / "run.npz")


def test_an_event_that_never_happens_is_written(tmp_path) -> None:
    """The file of a run's events has no line of an event that never happens."""
    events = [gs.Event("side"), gs.Event("side", level=5, name="never")]
    run = pendulum().integrate(*start(), dt=0.05, steps=60, parameters={"g": 1}, events=events)
    run.save(tmp_path / "run.csv")
    lines = (tmp_path / "run.events.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in lines] == ["event", "side"]
