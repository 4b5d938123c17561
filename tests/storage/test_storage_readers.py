"""What readers of Zarr and xarray find: dimensions, units, attributes, the same bytes."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest
import xarray
import zarr

import gyrospark as gs
import systems
from calls import PARAMETERS, TOP, integrate
from stores import START, record, small_blocks


@pytest.fixture
def opened(gl3, tmp_path):
    record(gl3, **START, steps=20, every=3, t0=1.0, out=tmp_path / "run.zarr")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield xarray.open_zarr(tmp_path / "run.zarr")


def test_dimensions_and_units(opened, gl3):
    nodes = gl3.binding.multipliers
    assert dict(opened.sizes) == {
        "time": 8, "coordinate": 4, "node": nodes,
        "checkpoint_byte": opened.sizes["checkpoint_byte"],
        "source_byte": opened.sizes["source_byte"]}
    assert opened["q"].dims == opened["p"].dims == ("time", "coordinate")
    assert opened["multipliers"].dims == ("time", "node")
    assert {name: array.attrs["units"] for name, array in opened.variables.items()
            if "units" in array.attrs} == {"time": "s", "q": "1", "p": "kg m2 s-1", "energy": "J"}
    assert all("long_name" in array.attrs for array in opened.variables.values())
    assert opened["q"].attrs["components"] == ["q0", "q1", "q2", "q3"]
    assert opened["iterations"].dtype == np.int32


def test_values(opened, gl3, tmp_path):
    """t0 + k dt, the last one off the grid; what belongs to steps has nothing at the start."""
    names = {path.name for path in (tmp_path / "run.zarr").rglob("*") if path.is_file()}
    assert names <= {"zarr.json", "0"}  # nothing but metadata and blocks
    whole = integrate(gl3, **START, steps=20, every=3, t0=1.0)
    np.testing.assert_array_equal(opened["time"], whole.t)
    np.testing.assert_array_equal(opened["q"], whole.q)
    np.testing.assert_array_equal(opened["multipliers"][1:], whole.multipliers)
    np.testing.assert_array_equal(opened["iterations"][1:], whole.iterations)
    assert np.isnan(opened["multipliers"][0]).all()
    assert opened["iterations"][0] == 0
    assert float(opened["q"].sel(time=1.003)[0]) == whole.q[1, 0]


def test_attributes(opened, gl3):
    about = opened.attrs
    assert about["manifest"] == gl3.manifest.as_json()
    assert about["run"]["parameters"] == PARAMETERS
    assert about["run"]["q0"] == list(TOP.q0)
    assert about["versions"]["gyrospark"] == gs.__version__
    assert about["versions"]["zarr"] == zarr.__version__
    assert (about["status"], about["steps_done"], about["states"]) == ("complete", 20, 8)
    assert about["report"]["steps"] == 20
    json.dumps(about, allow_nan=False)  # any reader of JSON can take it


def test_what_is_no_row_is_refused(opened, tmp_path):
    """Of a store as of a run in memory."""
    recording = gs.load(tmp_path / "run.zarr")
    for row, error in (("q0", gs.InputError), (1.5, gs.InputError), (8, IndexError),
                       (-9, IndexError)):
        for run in (recording, recording[:]):
            with pytest.raises(error, match=rf"run\[{row!r}\]"):
                run[row]


def test_rows_to_come(gl3, tmp_path, monkeypatch):
    """The array has its length from the start; what is not computed yet is NaN, or 0."""
    small_blocks(monkeypatch, 4)
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 7)

    def progress(done):
        if done > 20:
            raise RuntimeError

    with pytest.raises(RuntimeError):
        record(gl3, **START, steps=60, out=tmp_path / "run.zarr", progress=progress)
    found = gs.load(tmp_path / "run.zarr")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        whole = xarray.open_zarr(tmp_path / "run.zarr").load()
    assert 0 < found.states < whole.sizes["time"] == 61
    assert not np.isnan(whole["q"][: found.states]).any()
    last = -(-found.states // 4) * 4 + 4  # the block that may have been written, uncommitted
    assert np.isnan(whole["q"][last:]).all()
    assert np.isnan(whole["time"][last:]).all()
    assert (whole["iterations"][last:] == 0).all()


def test_slices_have_the_most_iterations_of_their_steps(tmp_path, monkeypatch):
    small_blocks(monkeypatch, 8)
    step = systems.stepper("pendulum")
    run = systems.run("pendulum", step, 43)
    assert len({*run.iterations}) > 1
    stored = systems.run("pendulum", step, 43, out=tmp_path / "run.zarr")
    rare = systems.run("pendulum", step, 43, every=10).iterations[:4]
    for states in (run[::10], stored[::10], run[::5][::2], stored[:][::10]):
        assert np.array_equal(states.iterations, rare)
    assert np.array_equal(stored[3:30:4].iterations, run[3:30:4].iterations)
    assert len(run[5:6].iterations) == len(stored[5:6].iterations) == 0
