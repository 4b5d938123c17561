"""A recorded run is the run that ``integrate`` returns, to the bit, and what a store says of it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from calls import LATE, PARAMETERS, TOP
from forced_systems import PARAMETERS as FORCED
from forced_systems import oscillator, pendulum, runner
from gyrospark.storage import recording as recordings
from gyrospark.storage.array_layout import block_rows, fields_of
from stores import ARRAYS, START, assert_same, bits, recorded, small_blocks
from structured_systems import made, start

REALS = ("double", "float", "long-double", "float128")
SOLVERS = ("auto", "newton", "fixed-point", "python")
ALPHA = TOP.parameters | {"alpha": gs.gamma_m(TOP.inertia)}


def check(step, out, **arguments):
    """Check that a run is stored as ``integrate`` returns it; return its recording."""
    recording = recorded(step, out, **arguments)
    whole = step.integrate(**arguments)
    assert recording.status == "complete"
    assert (recording.steps_done, len(recording)) == (arguments["steps"], len(whole))
    assert recording.report == whole.report
    assert_same(recording.trajectory(), whole)
    return recording


# ---------------------------------------------------------------- the same as integrate


@pytest.mark.parametrize("solver", SOLVERS)
def test_each_scheme_and_solver(step, solver, tmp_path, monkeypatch):
    """Blocks of 8 rows, of which the last is begun; a last state off the grid of ``every``."""
    if solver == "fixed-point" and not step.manifest["fast_path"]["available"]:
        pytest.skip("no sweeps")
    small_blocks(monkeypatch, 8)
    check(step, tmp_path / "run.zarr", **START, steps=100, every=3, solver=solver)


@pytest.mark.parametrize("rep", ["alpha", "gamma"])
@pytest.mark.parametrize(("scheme", "stages"), [("IMS", None), ("G-L", 3), ("LIIIA-B", 4)])
def test_each_representation(scheme, stages, rep, tmp_path):
    parameters = ALPHA if rep == "alpha" else PARAMETERS
    check(gs.stepper(scheme, stages, rep), tmp_path / "run.zarr",
          **START | {"parameters": parameters}, steps=50)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize(("scheme", "stages"), [("EMS", None), ("G-L", 2)])
def test_each_real(scheme, stages, real, tmp_path, monkeypatch):
    small_blocks(monkeypatch, 4)
    step = gs.stepper(scheme, stages, real=real)
    q, p = step.project(TOP.q0, TOP.p0, parameters=PARAMETERS)
    arguments = START | {"q": q, "p": p, "steps": 19, "every": 2}
    check(step, tmp_path / "run.zarr", **arguments)
    check(step, tmp_path / "python.zarr", **arguments | {"solver": "python"})


SYSTEMS = {
    "forces in time, m = 0": (oscillator, [0.7], [0.1]),
    "forces and quantities, m = 1": (pendulum, [0.6, -0.8], [0.8, 0.6]),
    "forces, not separable": (runner, [0.0, 1.0], [0.4, 0.0]),
}


@pytest.mark.parametrize(("name", "scheme", "real"), [
    *((name, scheme, "double") for name in SYSTEMS for scheme in (("EMS", None), ("G-L", 2))),
    ("forces and quantities, m = 1", ("EMS", None), "long-double"),
    pytest.param("forces, not separable", ("G-L", 2), "long-double", marks=pytest.mark.slow)])
def test_forces_time_and_quantities(name, scheme, real, tmp_path, monkeypatch):
    small_blocks(monkeypatch, 8)
    make, q, p = SYSTEMS[name]
    step = gs.stepper(*scheme, system=make(), real=real)
    q, p = step.project(q, p, parameters=FORCED)
    for solver in ("auto", "python"):
        check(step, tmp_path / f"{solver}.zarr", q=q, p=p, dt=0.01, steps=50, every=4,
              parameters=FORCED, t0=0.3, solver=solver)


def test_several_constraints(tmp_path, monkeypatch):
    """m = 2: a bead where a plane cuts a sphere; multipliers have a dimension of constraints."""
    small_blocks(monkeypatch, 8)
    x, y, z, u, v, w = sp.symbols("x y z u v w", real=True)
    g, = sp.symbols("g,", positive=True)
    system = gs.System((x, y, z), (u, v, w), (g,), (u**2 + v**2 + w**2) / 2 + g * z,
                       (x**2 + y**2 + z**2 - 1, x - y / 2), name="cut")
    step = gs.stepper("G-L", 3, system=system)
    q, p = step.project([0.4, 0.8, -0.4], [0.1, 0.2, 0.5], parameters={"g": 9.8})
    found = check(step, tmp_path / "run.zarr", q=q, p=p, dt=0.01, steps=100, every=3,
                  parameters={"g": 9.8})
    assert found.trajectory().multipliers.shape == (34, step.binding.multipliers // 2, 2)


def test_structured_chain(tmp_path, monkeypatch):
    """Many bodies, whose linear algebra is that of a tree."""
    small_blocks(monkeypatch, 8)
    q, p, parameters = start(driven=True)
    step = made("G-L", 2, structured=True, driven=True)
    check(step, tmp_path / "run.zarr", q=q, p=p, dt=1e-3, parameters=parameters, steps=30, every=2)


@pytest.mark.parametrize(("steps", "every"), [
    (0, 1), (0, 7), (1, 1), (1, 9), (4096, 4096), (4097, 4096), (9000, 5000), (5000, 9000),
    (12288, 4097), (8192, 1), (8193, 8192), (10_000, 3)])
def test_counts(steps, every, gl3, tmp_path, monkeypatch):
    """Around the 4096 steps that compiled code does in one call; nothing, and one row, as well."""
    small_blocks(monkeypatch, 1024)
    check(gl3, tmp_path / "run.zarr", **START, steps=steps, every=every)


def test_backwards(gl3, tmp_path):
    check(gl3, tmp_path / "run.zarr", **START | {"dt": -1e-3}, steps=100, t0=5.0)


def test_chosen_gamma(tmp_path):
    """"auto" is chosen before the run begins; the store has the number."""
    step = gs.stepper("G-L", 2)
    arguments = START | {"parameters": TOP.parameters | {"gamma": "auto"}, "steps": 50}
    found = check(step, tmp_path / "run.zarr", **arguments)
    assert isinstance(found.attributes["run"]["parameters"]["gamma"], float)


def test_failed_step(failures, tmp_path, monkeypatch):
    """The error of a recorded run is the error of the run, with the same states."""
    small_blocks(monkeypatch, 2)
    for number, (step, options, failure) in enumerate(failures):
        out = tmp_path / f"{number}.zarr"
        for resume in (False, True):  # a run that has failed fails again at once
            with pytest.raises(gs.StepFailed) as again:
                gs.record(step, *LATE, out=out, steps=200, resume=resume, **options)
            assert (again.value.step, again.value.t) == (failure.step, failure.t)
            assert again.value.reason == failure.reason
            assert_same(again.value.trajectory, failure.trajectory)
        found = gs.open_recording(out)
        assert found.status == f"failed: {failure.reason}"
        assert found.steps_done == failure.step - 1


# ---------------------------------------------------------------- what a recording says


def test_about_a_recording(gl3, tmp_path):
    found = gs.record(gl3, **START, out=tmp_path / "run.zarr", steps=20, every=5, seed=7)
    assert "run.zarr" in repr(found)
    assert "complete, 20 of 20" in repr(found)
    assert found.attributes["seed"] == 7
    assert found.attributes["manifest"] == gl3.manifest
    assert found.attributes["run"]["parameters"] == PARAMETERS
    assert found.attributes["run"]["code"] == gl3.provenance
    assert set(found.attributes["versions"]) == {"gyrospark", "numpy", "zarr", "python"}
    assert sorted(p.name for p in tmp_path.iterdir() if p.name != ".run.zarr.lock") == ["run.zarr"]


@pytest.mark.parametrize(("first", "thin"), [(0, 1), (3, 1), (0, 2), (2, 3), (6, 1)])
def test_part_of_a_recording(first, thin, gl3, tmp_path):
    whole = gl3.integrate(**START, steps=29, every=5)
    found = gs.record(gl3, **START, out=tmp_path / "run.zarr", steps=29, every=5)
    part = found.trajectory(first=first, thin=thin)
    assert part.every == 5 * thin
    for name in ("t", "q", "p", "energies", "g_errors", "f_errors", "work"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[first::thin])
    for name in ("multipliers", "iterations"):  # of the steps that end at a state
        expected = getattr(whole, name)[first + thin - 1 :: thin]
        np.testing.assert_array_equal(getattr(part, name), expected)


@pytest.mark.parametrize("real", ["double", "float128"])
def test_every_so_many_states_are_read_chunk_by_chunk(real, tmp_path, monkeypatch):
    """Whatever the chunk and the place to begin: the rows of the whole, and one chunk at a time."""
    step, read, rows = gs.stepper("IMS", real=real), recordings.stored_values, []
    monkeypatch.setattr(recordings, "stored_values", lambda array, first, count, *what: [
        rows.append(count), read(array, first, count, *what)][1])
    q, p = step.project(TOP.q0, TOP.p0, parameters=PARAMETERS)
    for chunk in (4, 8):
        small_blocks(monkeypatch, chunk)
        found = recorded(step, tmp_path / "run.zarr", **START | {"q": q, "p": p}, steps=21)
        whole = found.trajectory()
        del rows[:]
        for first, thin in itertools.product((0, 4, 7, 21), (2, 5, 30)):
            part = found.trajectory(first=first, thin=thin)
            for name in ARRAYS:
                of_steps = name in ("multipliers", "iterations")
                place = slice(first + thin - 1 if of_steps else first, None, thin)
                assert bits(getattr(part, name)) == bits(getattr(whole, name)[place]), name
        assert max(rows) == chunk


def test_rows_of_a_block():
    """A power of two, of 32 MB at most, and of the run if that is shorter."""
    for scheme in (("IMS", None), ("G-L", 3)):
        fields = fields_of(gs.stepper(*scheme).manifest)
        rows = block_rows(fields, 10**9)
        row = sum(field.row_bytes for field in fields)
        assert rows & (rows - 1) == 0
        assert rows * row <= 32 * 2**20 < 4 * rows * row
        assert block_rows(fields, 5) == 5


def test_what_a_killed_run_left_unfinished_is_removed(gl3, tmp_path):
    store = tmp_path / "run.zarr"
    gs.record(gl3, **START, steps=20, out=store)
    left = [store / ".zarr.json.1234.part", store / "q" / ".0.part"]
    for path in left:
        path.write_bytes(b"half")
    gs.record(gl3, **START, steps=30, out=store, resume=True)
    assert not any(path.exists() for path in left)
