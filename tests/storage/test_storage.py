"""A stored run equals ``integrate`` to the bit; Zarr and xarray read it."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest
import xarray
import zarr

import gyrospark as gs
import systems
from calls import LATE, PARAMETERS, TOP, integrate
from gyrospark.storage import recording as recordings
from gyrospark.storage.array_layout import block_rows, fields_of
from stores import ARRAYS, START, assert_same, bits, record, recorded, small_blocks


def check(step, out, **arguments):
    """Check that a run is stored as ``integrate`` returns it; return its recording."""
    recording = recorded(step, out, **arguments)
    computed = integrate(step, **arguments)
    assert recording.status == "complete"
    assert (recording.steps_done, len(recording)) == (arguments["steps"], len(computed))
    assert recording.report == computed.report
    assert_same(recording[:], computed)
    return recording


@pytest.mark.parametrize(("name", "scheme", "real", "solver"), [
    ("heavy_top", "EMS", "double", "newton"), ("heavy_top", "G-L", "float", "fixed-point"),
    ("heavy_top", "G-L", "float128", "auto"), ("dragged_pendulum", "G-L", "double", "fixed-point")])
def test_a_stored_run_is_that_of_integrate(name, scheme, real, solver, tmp_path, monkeypatch):
    """The last block of 8 rows is begun, the last state off the grid; one run goes backwards."""
    small_blocks(monkeypatch, 8)
    step, case = systems.stepper(name, scheme, real=real), systems.case(name)
    q, p = systems.start(name, step)
    check(step, tmp_path / "run.zarr", q=q, p=p, dt=case.dt * (1 - 2 * (real == "float")),
          t0=case.t0, steps=40, every=3, parameters=case.parameters, solver=solver)


@pytest.mark.parametrize(("steps", "every"), [(0, 1), (65, 64), (80, 150), (80, 3)])
def test_counts(steps, every, gl3, tmp_path, monkeypatch):
    """Numbers of steps are near the chunk of one call of compiled code; or none, or one row."""
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 64)
    small_blocks(monkeypatch, 16)
    check(gl3, tmp_path / "run.zarr", **START, steps=steps, every=every)


def test_searched_gamma(tmp_path):
    """A search of the model happens before the run begins; the store has the number."""
    step, out = systems.stepper("heavy_top"), tmp_path / "run.zarr"
    start = TOP.start.of_model({"gamma": TOP.inertia}, {"gamma": "auto"})
    recording = record(step, start, out=out, dt=1e-3, steps=50)
    run = step.integrate(start, dt=1e-3, steps=50)
    assert recording.attributes["run"]["parameters"] == run.parameters
    assert run.parameters["gamma"] != gs.gamma(TOP.inertia)


def test_failed_step(failures, tmp_path, monkeypatch):
    """The error of a recorded run is the error of the run, with the same states."""
    small_blocks(monkeypatch, 2)
    (step, options, failure), *_ = failures
    out = tmp_path / "run.zarr"
    for resume in (False, True):  # a run that has failed fails again at once
        with pytest.raises(gs.StepFailed) as second_failure:
            record(step, *LATE, out=out, steps=200, resume=resume, **options)
        assert (second_failure.value.step, second_failure.value.t) == (failure.step, failure.t)
        assert second_failure.value.reason == failure.reason
        assert_same(second_failure.value.trajectory, failure.trajectory)
    recording = gs.load(out)
    assert recording.status == f"failed: {failure.reason}"
    assert recording.steps_done == failure.step - 1


def test_about_a_recording(gl3, tmp_path):
    recording = record(gl3, **START, out=tmp_path / "run.zarr", steps=20, every=5)
    assert "run.zarr" in repr(recording)
    assert "complete, 20 of 20" in repr(recording)
    assert recording.manifest == gl3.manifest
    assert recording.attributes["run"]["parameters"] == PARAMETERS
    assert recording.attributes["run"]["code"] == gl3._provenance
    assert set(recording.attributes["versions"]) == {"gyrospark", "numpy", "zarr", "python"}
    assert sorted(p.name for p in tmp_path.iterdir() if p.name != ".run.zarr.lock") == ["run.zarr"]


@pytest.mark.parametrize("real", ["double", pytest.param("float128", marks=pytest.mark.slow)])
def test_every_so_many_states_are_read_chunk_by_chunk(real, tmp_path, monkeypatch):
    """From any start and for any chunk the rows agree, and one chunk is read at a time."""
    step, reader, rows = systems.stepper("heavy_top", real=real), recordings.stored_values, []
    monkeypatch.setattr(recordings, "stored_values", lambda array, first, count, *what, **more: [
        rows.append(count), reader(array, first, count, *what, **more)][1])
    q, p = step.project(TOP.q0, TOP.p0, parameters=PARAMETERS)
    for chunk in (4, 8) if real == "double" else (4,):
        small_blocks(monkeypatch, chunk)
        recording = recorded(step, tmp_path / "run.zarr", **START | {"q": q, "p": p}, steps=21)
        trajectory = recording[:]
        assert bits(recording[3:].q) == bits(trajectory.q[3:])
        del rows[:]
        for first, thin in zip((0, 4, 7, 21), (2, 5, 30, 2), strict=True):
            selection = recording[first::thin]
            assert selection.every == thin
            assert bits(selection.iterations) == bits(trajectory[first::thin].iterations)
            for name in {*ARRAYS} - {"iterations"}:
                window = slice(first + thin - 1 if name == "multipliers" else first, None, thin)
                assert bits(getattr(selection, name)) == bits(getattr(
                    trajectory, name)[window]), name
        assert max(rows) == chunk


def test_rows_of_a_block():
    """A block has a power of two of rows, 32 MB at most, or the rows of a shorter run."""
    for scheme in (("EMS", None), ("G-L", 2)):
        fields = fields_of(systems.stepper("heavy_top", *scheme).manifest)
        rows = block_rows(fields, 10**9)
        row = sum(field.row_bytes for field in fields)
        assert rows & (rows - 1) == 0
        assert rows * row <= 32 * 2**20 < 4 * rows * row
        assert block_rows(fields, 5) == 5


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
    """Times are t0 + k dt, the last one off the grid; entries of steps are empty at the start."""
    names = {path.name for path in (tmp_path / "run.zarr").rglob("*") if path.is_file()}
    assert names <= {"zarr.json", "0"}  # nothing but metadata and blocks
    computed = integrate(gl3, **START, steps=20, every=3, t0=1.0)
    np.testing.assert_array_equal(opened["time"], computed.t)
    np.testing.assert_array_equal(opened["q"], computed.q)
    np.testing.assert_array_equal(opened["multipliers"][1:], computed.multipliers)
    np.testing.assert_array_equal(opened["iterations"][1:], computed.iterations)
    assert np.isnan(opened["multipliers"][0]).all()
    assert opened["iterations"][0] == 0
    assert float(opened["q"].sel(time=1.003)[0]) == computed.q[1, 0]


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
    """A store refuses it like a run in memory."""
    recording = gs.load(tmp_path / "run.zarr")
    for row, error in (("q0", gs.InputError), (1.5, gs.InputError), (8, IndexError),
                       (-9, IndexError)):
        for run in (recording, recording[:]):
            with pytest.raises(error, match=rf"run\[{row!r}\]"):
                run[row]


def test_rows_to_come(gl3, tmp_path, monkeypatch):
    """The array has its length from the start; rows to come are NaN, or 0."""
    small_blocks(monkeypatch, 4)
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 7)

    def progress(done):
        if done > 20:
            raise RuntimeError

    with pytest.raises(RuntimeError):
        record(gl3, **START, steps=60, out=tmp_path / "run.zarr", progress=progress)
    recording = gs.load(tmp_path / "run.zarr")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        dataset = xarray.open_zarr(tmp_path / "run.zarr").load()
    assert 0 < recording.states < dataset.sizes["time"] == 61
    assert not np.isnan(dataset["q"][: recording.states]).any()
    last = -(-recording.states // 4) * 4 + 4  # the block that may have been written, uncommitted
    assert np.isnan(dataset["q"][last:]).all()
    assert np.isnan(dataset["time"][last:]).all()
    assert (dataset["iterations"][last:] == 0).all()


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


def test_a_slice_of_a_stored_run_has_the_stepper_of_the_store(gl3, tmp_path):
    """The one that ran it here, or, of a store that is read, the one of its source."""
    stored = record(gl3, **START, steps=12, out=tmp_path / "run.zarr")
    run = integrate(gl3, **START, steps=12)
    for recording in (stored, gs.load(tmp_path / "run.zarr")):
        for rows in (slice(None, None, 4), slice(3, 9)):
            middle = float(run.t[4:6].mean())
            assert bits(recording[rows].at(middle).q) == bits(run[rows].at(middle).q)
