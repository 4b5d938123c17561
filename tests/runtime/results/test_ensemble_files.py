"""Dataset, files and figures of an ensemble against those of its members."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
import xarray

import gyrospark as gs
import systems
from calls import refused
from event_runs import pendulum, start
from gyrospark.runtime.results.state_columns import states_of

LENGTHS = [0.5, 1.0, 2.0]


def ensemble(real="double", **more):
    q0, p0 = pendulum(real).project(*start(), parameters={"g": 1})
    return pendulum(real).integrate_ensemble(
        [q0] * 3, [p0] * 3, dt=[0.05, 0.1, 0.2], steps=20, every=3, parameters={"g": LENGTHS},
        events=gs.Event("side"), **more)


def failing():
    """The second of three fails in its first step."""
    q0, p0 = start()
    return pendulum().integrate_ensemble([q0] * 3, [p0] * 3, dt=[0.05, 20.0, 0.05], steps=20,
                                         every=3, parameters={"g": LENGTHS},
                                         solver=gs.Solver("fixed-point", max_iterations=20))


def test_a_dataset_has_what_the_members_have() -> None:
    many = ensemble()
    found = many.dataset()
    for i, one in enumerate(many.members):
        for name, values in states_of(one).items():
            array = found[name].sel(trajectory=i)
            assert np.array_equal(array, values, equal_nan=True), name
        events = found.event_side_t[found.event_side_trajectory.values == i]
        assert np.array_equal(events, one.events["side"].t)
    assert found.dt.values.tolist() == [0.05, 0.1, 0.2]
    assert found.parameter_g.values.tolist() == LENGTHS
    assert found.status.values.tolist() == ["complete"] * 3
    assert found.sizes["state"] == 8
    by_g = found.swap_dims(trajectory="parameter_g")
    assert np.array_equal(by_g.q.sel(parameter_g=2.0, coordinate="x"), many.q[2, :, 0])


def test_wide_numbers_keep_their_bytes(tmp_path) -> None:
    """In float128 they are bytes of the archive, and doubles elsewhere."""
    step, case = systems.stepper("heavy_top", real="float128"), systems.case("heavy_top")
    q, p = systems.start("heavy_top", step)
    many = step.integrate_ensemble([q] * 2, [p] * 2, dt=[case.dt, 2 * case.dt], steps=2,
                                   parameters=case.parameters)
    with np.load(many.save(tmp_path / "run.npz"), allow_pickle=False) as file:
        assert json.loads(str(file["about"]))["manifest"]["real"] == "float128"
        assert any(file[name].shape == (*many.q.shape, 16) for name in file.files)
    with xarray.open_dataset(many.save(tmp_path / "run.nc"), engine="h5netcdf",
                             decode_times=False) as file:
        assert np.array_equal(file.q, many.q.astype(float))


def test_a_failure_is_reported() -> None:
    many = failing()
    assert set(many.failures) == {1}
    found = many.dataset()
    assert found.status.values.tolist() == ["complete", many.failures[1].reason, "complete"]
    assert found.steps.values.tolist() == [20, 0, 20]
    assert np.isnan(found.energy[1, 1:]).all()
    assert np.isfinite(found.energy[::2]).all()
    assert (found.iterations[1] == 0).all()
    assert found.iterations.dtype.kind == "i"


@pytest.mark.parametrize("real", ["double", pytest.param("float128", marks=pytest.mark.slow)])
def test_files(real: str, tmp_path) -> None:
    """All three, read by other programs' own readers."""
    many = ensemble(real)
    with np.load(many.save(tmp_path / "run.npz"), allow_pickle=False) as file:
        assert file["parameter_g"].shape[0] == 3
        assert json.loads(str(file["about"]))["manifest"]["name"] == pendulum(real).name
        if real != "float128":
            assert np.array_equal(file["q"], many.q)
            assert np.array_equal(file["event_side_t"], np.concatenate(
                [one.events["side"].t for one in many.members]))
    with xarray.open_dataset(many.save(tmp_path / "run.nc"), engine="h5netcdf",
                             decode_times=False) as file:
        assert np.array_equal(file.q, many.q.astype(float))
        assert file.status.values.tolist() == ["complete"] * 3
        assert file.trajectory.values.tolist() == [0, 1, 2]
        assert file.event_side_trajectory.values.tolist() == np.repeat(
            np.arange(3), many.events["side"].count).tolist()
    with many.save(tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 24
    assert [float(row["x"]) for row in rows] == many.q[..., 0].astype(float).ravel().tolist()
    assert [int(row["trajectory"]) for row in rows] == np.repeat(np.arange(3), 8).tolist()
    with (tmp_path / "run.events.csv").open(newline="") as file:
        assert len(list(csv.reader(file))) == 1 + many.events["side"].count.sum()


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
    with pytest.raises(gs.GyrosparkError):
        ensemble().save(tmp_path / "nowhere" / "run.npz")


def test_an_event_that_never_happens_is_written(tmp_path) -> None:
    """Also of one run, whose file of events then has no line of it."""
    events = [gs.Event("side"), gs.Event("side", level=5, name="never")]
    run = pendulum().integrate(*start(), dt=0.05, steps=60, parameters={"g": 1}, events=events)
    run.save(tmp_path / "run.csv")
    lines = (tmp_path / "run.events.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in lines] == ["event", "side"]
