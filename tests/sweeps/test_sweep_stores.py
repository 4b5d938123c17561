"""A store has all results of a sweep, and a finished cell is never computed again."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.storage.staging import writer_lock
from gyrospark.sweeps import compute_tile, cost_estimate, results, tiles
from gyrospark.sweeps.cost_estimate import _sample, estimate
from gyrospark.sweeps.plan import plan
from gyrospark.sweeps.results import NOT_COMPUTED, done_tiles, fields_of
from interruption import differences
from sweep_studies import FAILURES, OVER, TOP


@pytest.fixture
def small_tiles(monkeypatch):
    """Limit tiles to 64 cells: even a small sweep has several."""
    monkeypatch.setattr(tiles, "_LEAST_STORED", 1)
    monkeypatch.setattr(tiles, "_TILES", 2**30)


def test_a_store_holds_what_memory_holds(tmp_path, small_tiles):
    path = tmp_path / "s.zarr"
    over = {"scheme": ["EMS", "G-L 2"], "gamma": list(np.geomspace(8e-4, 2e-3, 3)),
            "dt": list(np.geomspace(1e-4, 2e-3, 3))}
    stored = gs.sweep(TOP, over, steps=20, out=path)
    assert stored.identical(gs.sweep(TOP, over, steps=20))
    opened = gs.load_sweep(path)
    assert opened.equals(stored)
    assert (opened.sel(scheme="G-L 2").status == 0).all()
    by_one_worker = gs.sweep(TOP, over, steps=20, out=tmp_path / "t.zarr", workers=1)
    assert by_one_worker.equals(stored)
    assert differences(path, tmp_path / "t.zarr") == []


def test_finished_cells_are_never_computed_again(tmp_path, small_tiles, monkeypatch):
    over = {"gamma": list(np.linspace(8e-4, 2e-3, 6)), "dt": list(np.linspace(1e-4, 1e-3, 5))}
    choice = {"scheme": "G-L", "stages": 2, "steps": 5}
    gs.sweep(TOP, over, **choice, out=tmp_path / "whole.zarr")
    computed: list[tuple[int, ...]] = []
    path, done = tmp_path / "s.zarr", set()

    compute = compute_tile.compute

    def counted(study, fields, tile):
        assert tile.place not in done
        computed.append(tile.place)
        return compute(study, fields, tile)

    def ended(finished, everything):
        if finished >= ended.at:
            raise KeyboardInterrupt

    monkeypatch.setattr(compute_tile, "compute", counted)
    for ended.at in (1, 8, 17):
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
    unfinished = gs.load_sweep(path)
    states = np.asarray(unfinished.status)
    assert {0, NOT_COMPUTED} == set(states.tolist())
    assert np.isfinite(unfinished.q.values[states == 0]).all()
    assert np.isnan(unfinished.q.values[states == NOT_COMPUTED]).all()


def test_a_missing_file_is_refused_and_computed_again(tmp_path):
    """Zarr would read NaN for a result and 0 for an axis."""
    path = tmp_path / "s.zarr"
    arguments = {"over": {"gamma": [1e-3, 2e-3], "mgl": [0.0]}, "scheme": "EMS", "dt": 1e-3,
                 "steps": 5}
    complete = gs.sweep(TOP, **arguments, out=path).load()
    (path / "q" / "c" / "0" / "0" / "0").unlink()
    with pytest.raises(gs.InputError, match="'q'"):
        gs.load_sweep(path)
    with pytest.raises(gs.InputError, match="load_sweep"):
        gs.load(path)
    assert gs.sweep(TOP, **arguments, out=path, resume=True).equals(complete)
    (path / "mgl" / "c" / "0").unlink()
    with pytest.raises(gs.InputError, match="'mgl'"):
        gs.load_sweep(path)


def test_another_sweep_is_not_resumed(tmp_path):
    path = tmp_path / "s.zarr"
    arguments = {"over": {"gamma": [1e-3, 2e-3]}, "scheme": "EMS", "dt": 1e-3, "steps": 5}
    gs.sweep(TOP, **arguments, out=path)
    with pytest.raises(gs.InputError, match="already"):
        gs.sweep(TOP, **arguments, out=path)
    for change, words in (
            ({"steps": 6}, "steps was 5"), ({"dt": 2e-3}, r"dt was 0\.001"),
            ({"scheme": "IMS"}, "steppers"), ({"parameters": {"mgl": 0.5}}, r"parameters\.mgl"),
            ({"over": {"gamma": [1e-3, 3e-3]}}, r"axes\.gamma"), ({"keep": ["q"]}, "results"),
            ({"tolerance": 1e-9}, "tolerance"), ({"resume": "no"}, "resume = 'no'")):
        with pytest.raises(gs.InputError, match=words):
            gs.sweep(TOP, **({"resume": True} | arguments | change), out=path)


def test_a_store_in_other_tiles_is_not_resumed(tmp_path, monkeypatch):
    """A tile is a chunk, whose size may depend on the version."""
    arguments = {"over": OVER, "scheme": "EMS", "steps": 5, "out": tmp_path / "s.zarr"}
    gs.sweep(TOP, **arguments)
    monkeypatch.setattr(tiles, "_cells_of_a_tile", lambda study, stored: 1)
    with pytest.raises(gs.InputError, match=r"tile.*\[3, 2\].*\[1, 1\]"):
        gs.sweep(TOP, **arguments, resume=True)


def test_a_damaged_status_is_named_where_the_sweep_is_resumed(tmp_path):
    arguments = {"over": {"gamma": [1e-3, 2e-3]}, "scheme": "EMS", "dt": 1e-3, "steps": 5,
                 "out": tmp_path / "a.zarr"}
    gs.sweep(TOP, **arguments)
    (tmp_path / "a.zarr/status/c/0").write_bytes(b"")
    with pytest.raises(gs.errors.StorageError, match="'status'"):
        gs.sweep(TOP, **arguments, resume=True)


def test_sweep_of_another_version(tmp_path, monkeypatch):
    """The refusal names the version; a store with the same layout is read."""
    path = tmp_path / "s.zarr"
    arguments = {"over": {"gamma": [1e-3, 2e-3]}, "scheme": "EMS", "dt": 1e-3, "steps": 5}
    result = gs.sweep(TOP, **arguments, out=path).load()
    file = path / "zarr.json"
    file.write_text(file.read_text().replace(f'"gyrospark": "{gs.__version__}"',
                                             '"gyrospark": "7.3"'))
    assert gs.load_sweep(path).load().equals(result)
    with pytest.raises(gs.InputError, match=r"gyrospark 7\.3"):
        gs.sweep(TOP, **arguments, out=path, resume=True)
    monkeypatch.setattr("gyrospark.sweeps.results.FORMAT", 2)
    with pytest.raises(gs.InputError, match=r"7\.3.*format is 1.* 2 "):
        gs.load_sweep(path)


def test_what_is_no_sweep_is_refused(tmp_path):
    (tmp_path / "s.zarr").mkdir()
    with pytest.raises(gs.errors.StorageError, match="no sweep"):
        gs.sweep(TOP, OVER, scheme="EMS", steps=5, out=tmp_path / "s.zarr", resume=True)
    with pytest.raises(gs.InputError, match="no sweep"):
        gs.load_sweep(tmp_path / "s.zarr")


def test_a_full_disk_ends_a_sweep_that_then_goes_on(tmp_path, small_tiles, monkeypatch):
    over = {"gamma": list(np.linspace(8e-4, 2e-3, 150))}
    choice = {"scheme": "EMS", "dt": 1e-3, "steps": 5}
    gs.sweep(TOP, over, **choice, out=tmp_path / "whole.zarr")
    from gyrospark.storage import durable_files

    write = durable_files.write_durably

    def full(path, *data, workshop=None):
        full.left -= 1
        if full.left < 0:
            raise OSError(28, "No space left on device")
        write(path, *data, workshop=workshop)

    path = tmp_path / "s.zarr"
    monkeypatch.setattr(durable_files, "write_durably", full)
    for full.left in itertools.count(1, 48):
        try:
            gs.sweep(TOP, over, **choice, out=path, resume=True)
            break
        except gs.errors.StorageError as error:
            assert "space" in str(error)  # noqa: PT017 (the last one finds room)
    assert full.left > 20
    assert differences(path, tmp_path / "whole.zarr") == []


@pytest.mark.filterwarnings("ignore:The fastest rotation")
@FAILURES
def test_every_tile_has_a_file_of_every_result(tmp_path, small_tiles):
    """Zeros and NaN have files, which the dry run counts: a missing file is lost, not zero."""
    path = tmp_path / "s.zarr"
    over = {"gamma": [1.6e-3] * 40, "dt": [50.0, 60.0]}  # no cell gets anywhere
    result = gs.sweep(TOP, over, scheme="G-L", stages=2, steps=3, out=path)
    assert (result.status != 0).all()
    study = plan(TOP, over, scheme="G-L", stages=2, steps=3)
    fields = fields_of(study)
    predicted = estimate(study, fields)
    files = [file for field in fields for file in (path / field.name / "c").rglob("*")
             if file.is_file()]
    assert len(files) == predicted.files == len(fields) * predicted.tiles > len(fields)
    assert sum(file.stat().st_size - 4 for file in files) == predicted.disk_bytes  # a checksum each


@pytest.mark.parametrize(("axes", "ratio"), [(1, 1.618033988749895), (2, 1.324717957244746)])
def test_timed_cells_cover_the_axes_evenly(axes, ratio):
    """The golden ratio is the root of φ² = φ + 1, the plastic ratio that of φ³ = φ + 1."""
    assert abs(ratio ** (axes + 1) - ratio - 1) < 1e-14
    study = SimpleNamespace(shape=(1000,) * axes)
    for i in range(20):
        expected = [int((0.5 + i * ratio**-k) % 1 * 1000) for k in range(1, axes + 1)]
        expected[-1] = min(expected[-1], 1000 - 16)
        assert _sample(study, i).place == tuple(expected)


def test_keep_keeps_what_it_names(tmp_path):
    result = gs.sweep(TOP, OVER, scheme="EMS", steps=5, keep=["energy_error_max"],
                      out=tmp_path / "s.zarr")
    assert set(result.data_vars) == {"energy_error_max", "status"}


def test_two_sweeps_on_one_store_do_not_meet(tmp_path):
    busy = pytest.raises(gs.errors.StorageError, match="Another process")
    with writer_lock(tmp_path / "s.zarr"), busy:
        gs.sweep(TOP, OVER, scheme="EMS", steps=5, out=tmp_path / "s.zarr")


def test_seconds_a_step_are_without_those_of_a_call(monkeypatch):
    """A call of half a second and 2 µs a step: of few steps the call is a part of each."""
    monkeypatch.setattr(cost_estimate, "_time", lambda study, tile: math.prod(tile.shape) * (
        0.5 + 2e-6 * study.steps))
    for options, seconds in (({"steps": 10**7}, 2e-6), ({"t_end": 1e5}, 2e-6),
                             ({"steps": 5}, 0.1 + 2e-6)):
        study = plan(TOP, {"mgl": [0.3, 0.4]}, scheme="G-L", stages=2, dt=1e-3, **options)
        assert cost_estimate._seconds_a_step(study, next(iter(tiles.tiles_of(study)))) == (
            pytest.approx(seconds))


def test_extrema_leave_out_cells_that_failed(monkeypatch):
    study = plan(TOP, {"mgl": [0.3, 0.4, 0.5]}, scheme="G-L", stages=2, dt=1e-3, steps=3)
    parts = [tiles.Tile((k,), (slice(k, k + 1),)) for k in range(3)]
    for values, least, most in (([np.nan, 2.0, 1.0], 0.5, 0.4), ([np.nan] * 3, None, None)):
        monkeypatch.setattr(results, "_tiles_in", lambda *_, values=values: (
            (tile, np.array([value])) for tile, value in zip(parts, values, strict=True)))
        extrema = results.summary(study, Path("none"), "energy_error_max")
        assert extrema.keys() >= {"least", "most"}
        assert extrema.get("least_at", {}).get("mgl") == least
        assert extrema.get("most_at", {}).get("mgl") == most
