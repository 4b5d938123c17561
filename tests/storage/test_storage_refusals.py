"""Places where a run neither begins nor continues: a sentence says why, and no file is written."""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import zarr

import gyrospark as gs
import systems
from calls import PARAMETERS, TOP
from command_line import RUN, refused
from gyrospark.storage import recorder
from gyrospark.storage.staging import writer_lock
from stores import START, Interrupted, as_files, assert_same_bytes, record, small_blocks

ARGUMENTS = START | {"steps": 100, "every": 2}
AS_ROOT = os.geteuid() == 0


@pytest.fixture(scope="module")
def begun(tmp_path_factory, gl3):
    """A store of a run that was ended in its third block."""
    out = tmp_path_factory.mktemp("begun") / "run.zarr"
    with pytest.MonkeyPatch.context() as patch:
        small_blocks(patch, 16)
        patch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 10)
        patch.setattr(recorder.Writer, "busy", False)  # a commit after each piece

        def progress(done):
            if done >= 90:
                raise Interrupted

        with pytest.raises(Interrupted):
            record(gl3, **ARGUMENTS, out=out, progress=progress)
    assert gs.load(out).states == 42
    return out


@pytest.fixture
def store(begun, tmp_path):
    """A copy of the store ``begun``, to damage."""
    return Path(shutil.copytree(begun, tmp_path / "run.zarr"))


def sentence(error):
    """Return the text of an error; check that it is one or two sentences for people."""
    text = str(error)
    assert text.endswith(".")
    assert "\n" not in text
    assert "Error" not in text
    return text


def everything(store, stepper):
    """Use a store in each way."""
    recording = gs.load(store)
    assert repr(recording)
    assert len(recording) >= 0
    recording[:]
    recording.save(store.with_name("run.csv"))
    record(stepper, **ARGUMENTS, out=store, resume=True)


# ---------------------------------------------------------------- another run

OTHERS = [
    ({"dt": 2e-3}, ("dt", "0.001", "0.002")),
    ({"steps": 99}, ("steps", "100", "99")),
    ({"dt": 2e-3, "steps": 7}, ("dt", "0.001", "0.002", "steps", "100", " 7")),
    ({"every": 3}, ("every", "2", "3")),
    ({"t0": 1.0}, ("t0", "0.0", "1.0")),
    ({"solver": "newton"}, ("solver", "'auto'", "'newton'")),
    ({"solver": gs.Solver(tolerance=1e-12)}, ("tolerance", "None", "1e-12")),
    ({"solver": gs.Solver(max_iterations=51)}, ("max_iterations", "50", "51")),
    ({"parameters": PARAMETERS | {"mgl": np.nextafter(PARAMETERS["mgl"], 1)}},
     ("parameters.mgl", "0.3924", "0.39240000000000")),
    ({"q": -np.asarray(TOP.q0), "p": -np.asarray(TOP.p0)}, ("q0",)),
]


def test_another_run_is_refused(gl3, begun):
    files = as_files(begun)
    for change, words in OTHERS:
        with pytest.raises(gs.InputError, match="another run") as error:
            record(gl3, **ARGUMENTS | change, out=begun, resume=True)
        message = sentence(error.value)
        assert all(word in message for word in words), message
    assert as_files(begun) == files


def test_other_flags_of_the_compiler_are_refused(gl3, store):
    """They would compute other bits."""
    changed(store, run__code__flags="-Ofast")
    with pytest.raises(gs.InputError, match=r"code\.flags.*'-Ofast'"):
        record(gl3, **ARGUMENTS, out=store, resume=True)


def test_another_stepper_is_refused(begun):
    """Another scheme, number of stages, representation or type is refused."""
    alpha = {"parameters": TOP.parameters | {"alpha": PARAMETERS["gamma"]}}
    steppers = [(systems.stepper("heavy_top", "EMS"), {}), (systems.stepper("heavy_top"), {}),
                (systems.stepper("heavy_top_alpha"), alpha),
                (systems.stepper("heavy_top", real="float"), {})]
    for step, change in steppers:
        with pytest.raises(gs.InputError, match=r"stepper.*'heavy_top_gl3_gamma'"):
            record(step, **ARGUMENTS | change, out=begun, resume=True)


def test_another_version_is_refused(gl3, begun, monkeypatch):
    """The message names the version and every other difference; the store can be read."""
    monkeypatch.setattr("gyrospark.storage.identity.__version__", "9.9")
    files = as_files(begun)
    with pytest.raises(gs.InputError) as error:
        record(gl3, **ARGUMENTS | {"dt": 2e-3}, out=begun, resume=True)
    message = sentence(error.value)
    for word in (repr(str(begun)), f"gyrospark {gs.__version__}", "gyrospark 9.9", "0.002"):
        assert word in message
    assert gs.load(begun)[:].q.shape == (42, 4)
    assert as_files(begun) == files


def test_store_of_another_version_with_the_same_layout_is_read(store):
    """Unknown fields are ignored; later fields have their default."""
    original = gs.load(store)
    changed(store, run__gyrospark="0.0.1", report__later=3.5, run__later="x", later=[1])
    changed_store = gs.load(store)
    assert changed_store.report == original.report
    np.testing.assert_array_equal(changed_store[:].q, original[:].q)
    changed(store, report__work=...)
    assert gs.load(store).report.work == 0.0


@pytest.mark.parametrize("change", [
    {"run__format": 2}, {"report__steps": ...}, {"states": {"of": 42}}, {"arrays": ["other"]}])
def test_store_of_another_version_that_is_not_understood(change, store, gl3):
    """The message does not call it damaged."""
    changed(store, run__gyrospark="7.3", **change)
    for use in (lambda: gs.load(store),
                lambda: record(gl3, **ARGUMENTS, out=store, resume=True)):
        with pytest.raises(gs.InputError, match=r"gyrospark 7\.3") as error:
            use()
        assert sentence(error.value).endswith("Use gyrospark 7.3.")


def test_last_digits_of_wide_starts(tmp_path):
    """Two starts that differ in their last bit alone are two runs."""
    for real, eps in (("long-double", 2.0**-64), ("float128", 2.0**-113)):
        step = systems.stepper("heavy_top", real=real)
        q, p = step.project(TOP.q0, TOP.p0, parameters=PARAMETERS)
        arguments = START | {"q": q, "p": p, "steps": 2}
        record(step, **arguments, out=tmp_path / f"{real}.zarr")
        q[0] += eps
        assert q[0] != arguments["p"][0]
        with pytest.raises(gs.InputError, match="q0 was"):
            record(step, **arguments | {"q": q}, out=tmp_path / f"{real}.zarr", resume=True)


# ---------------------------------------------------------------- places


def test_store_that_is_there(gyrospark, begun):
    files = as_files(begun)
    refused(gyrospark(*RUN, "--out", begun), "already", "--resume")
    refused(gyrospark(*RUN, "--out", begun, "--resume"), "another run", "steps was 100")
    assert as_files(begun) == files


@pytest.mark.parametrize("kind", ["file", "folder", "array", "loop"])
def test_what_is_no_store(kind, gl3, gyrospark, tmp_path):
    path = tmp_path / "run.zarr"
    if kind == "file":
        path.write_text("mine")
    elif kind == "loop":
        path.symlink_to(path)
    else:
        (path / "mine").mkdir(parents=True)
        if kind == "array":
            (path / "zarr.json").write_text('{"zarr_format": 3, "node_type": "array"}')
    for resume in (False, True):
        with pytest.raises((gs.InputError, gs.errors.StorageError)) as error:
            record(gl3, **ARGUMENTS, out=path, resume=resume)
        sentence(error.value)
    with pytest.raises(gs.InputError, match="gyrospark stored"):
        gs.load(path)
    refused(gyrospark(*RUN, "--out", "run.zarr"), "'run.zarr'")
    refused(gyrospark("export", "run.zarr", "run.csv"), "'run.zarr'", "not a run")
    if kind == "file":
        assert path.read_text() == "mine"
    elif kind != "loop":
        assert (path / "mine").is_dir()


@pytest.mark.parametrize("name", ["", ".", "/", "..", "a\0b", 3, b"run.zarr"])
def test_what_is_no_path(name, gl3):
    for call in (lambda: gs.load(name), lambda: record(gl3, **ARGUMENTS, out=name)):
        with pytest.raises((gs.InputError, gs.errors.StorageError)) as error:
            call()
        assert repr(name) in sentence(error.value)


@pytest.mark.parametrize("name", ["it's \"so\" γ*\n.zarr", "-no_ending", "\udcff.zarr"])
def test_names(name, gl3, tmp_path, monkeypatch):
    """A run has these names, and is the same for NumPy's and Python's integers and floats."""
    monkeypatch.chdir(tmp_path)
    record(gl3, **ARGUMENTS | {"dt": np.float64(1e-3), "steps": np.int64(100)}, out=name)
    assert record(gl3, **ARGUMENTS, out=tmp_path / name, resume=True).status == "complete"
    assert gs.load(name)[:].q.shape == (51, 4)


def test_links(gl3, begun, tmp_path):
    """A link to a store is that store; one that leads nowhere says where to put it."""
    target = Path(shutil.copytree(begun, tmp_path / "disk" / "run.zarr"))
    link, nowhere = tmp_path / "link.zarr", tmp_path / "nowhere.zarr"
    link.symlink_to(target)
    nowhere.symlink_to(tmp_path / "disk" / "new.zarr")
    (tmp_path / "folder").symlink_to(tmp_path / "disk")
    for path in (link, tmp_path / "folder" / "run.zarr"):
        with writer_lock(target), pytest.raises(gs.errors.StorageError, match="Another process"):
            record(gl3, **ARGUMENTS, out=path, resume=True)
    record(gl3, **ARGUMENTS, out=link, resume=True)
    record(gl3, **ARGUMENTS, out=nowhere)
    assert link.is_symlink()
    assert nowhere.is_symlink()
    assert gs.load(target).status == "complete"
    small = gs.load(tmp_path / "disk" / "new.zarr")[:]
    np.testing.assert_array_equal(gs.load(target)[:].q, small.q)


@pytest.mark.skipif(AS_ROOT, reason="root may write everywhere")
def test_folder_that_cannot_be_written(gl3, begun, tmp_path):
    path = Path(shutil.copytree(begun, tmp_path / "disk" / "run.zarr"))
    path.parent.chmod(0o555)
    try:
        for resume in (False, True):
            with pytest.raises(gs.errors.StorageError, match="written"):
                record(gl3, **ARGUMENTS, out=path, resume=resume)
        assert gs.load(path)[:].q.shape == (42, 4)
    finally:
        path.parent.chmod(0o755)


# ---------------------------------------------------------------- damage


def changed(path, **entries):
    """Change attributes of a store; a__b is entry b of a, None takes an entry away."""
    document = json.loads((path / "zarr.json").read_text())
    for name, value in entries.items():
        *keys, last = name.split("__")
        entry = document["attributes"]
        for key in keys:
            entry = entry[key]
        if value is Ellipsis:
            del entry[last]
        else:
            entry[last] = value
    (path / "zarr.json").write_text(json.dumps(document))


ATTRIBUTES = {
    "run": [..., None, [], "x", {}], "run__format": [2, "1", None, 1.5],
    "run__steps": ["x", -1, 1.5, True, None, ...], "run__every": [0, "x", ...],
    "run__dt": [..., "x", None], "run__t0": [..., "x"], "run__parameters": [3, {"I1": "x"}, ...],
    "steps_done": ["many", 1.5, -1, 10**9, None, True, [], ...],
    "states": [10**9, -3, "a", None, 0, 41, 42.0, ...],
    "status": [3, "odd", "complete", None, [], {}, ...],
    "report": ["x", {}, {"a": 1}, [], 0, None, ...],
    "report__q": ["x", 3.0j.__class__.__name__, ["a"]], "report__steps": ["x", None, ...],
    "manifest": [None, {}, [], "x", ...], "manifest__real": ["half", None, [], ...],
    "manifest__system": [[], {}, None, ...], "manifest__system__coordinates": [5, [1], ...],
    "manifest__system__quantities": [3, "x"],
    "arrays": [None, 7, "q", ["nope"], [3], ["q", "../q"], ["."], [""], ["q", "\ud800"],
               ...],
}


@pytest.mark.parametrize("name", ATTRIBUTES)
def test_hostile_attributes(name, store, gl3):
    """Any such attribute is an error of ours when the store is opened or resumed."""
    sound = (store / "zarr.json").read_bytes()
    for value in ATTRIBUTES[name]:
        (store / "zarr.json").write_bytes(sound)
        changed(store, **{name: value})
        with pytest.raises(gs.InputError) as error:
            gs.load(store)
        assert "run.zarr" in sentence(error.value), value
        with pytest.raises(gs.InputError):
            record(gl3, **ARGUMENTS, out=store, resume=True)


#: Cut, empty, other kinds, groups of another format or without attributes, too deep.
TEXTS = [
    '{"a":', "", "[]", "null", "3", '{"zarr_format": 3, "node_type": "array"}',
    '{"zarr_format": 4, "node_type": "group"}', '{"zarr_format": 3, "node_type": "group"}',
    '{"zarr_format": 3, "node_type": "group", "attributes": []}', "[" * 100_000,
]


@pytest.mark.parametrize("file", ["zarr.json", "q/zarr.json"])
def test_garbage_for_metadata(file, store, gl3):
    for text in (*map(str.encode, TEXTS), b"\xff\xfe\0"):
        (store / file).write_bytes(text)
        with pytest.raises(gs.InputError) as error:
            gs.load(store)
        sentence(error.value)
        with pytest.raises(gs.InputError):
            record(gl3, **ARGUMENTS, out=store, resume=True)


@pytest.mark.parametrize("name", ["q", "time", "iterations", "multipliers"])
def test_arrays_of_another_form(name, store, gl3):
    """Shape, blocks and type are compared before a run is resumed."""
    file = store / name / "zarr.json"
    text = file.read_text()
    for change in (("51", "30"), ("51", "52"), ("16", "8"), ("float64", "float32"),
                   ("0.0", '"x"')):
        file.write_text(text.replace(*change))
        if file.read_text() != text:
            with pytest.raises(gs.InputError):
                everything(store, gl3)
            with pytest.raises(gs.InputError):
                record(gl3, **ARGUMENTS, out=store, resume=True)


def test_blocks_of_other_lengths(store):
    """Each array is sound by itself; together they belong to no run."""
    array = zarr.open_group(store)["q"]
    values, attributes = array[:], dict(array.attrs)
    rows, columns = values.shape
    rewritten = zarr.open_group(store).create_array(
        "q", shape=values.shape, dtype=values.dtype, chunks=(rows // 2, columns), overwrite=True)
    rewritten[:] = values
    rewritten.attrs.update(attributes)
    with pytest.raises(gs.InputError, match="blocks"):
        gs.load(store)


@pytest.mark.parametrize("name", ["q", "time", "energy", "iterations", "multipliers",
                                  "checkpoint"])
def test_missing_array(name, store, gl3):
    """Without its checkpoint a run can be read but not resumed; no file changes."""
    (store / name / "zarr.json").write_text("{")
    for damage in (None, shutil.rmtree):
        if damage:
            damage(store / name)
        files = as_files(store)
        if name == "checkpoint":
            assert gs.load(store)[:].q.shape == (42, 4)
        else:
            with pytest.raises(gs.InputError, match=f"'{name}'.*missing"):
                gs.load(store)
        for steps in (100, 200):
            with pytest.raises(gs.InputError, match=f"'{name}'.*missing"):
                record(gl3, **ARGUMENTS | {"steps": steps}, out=store, resume=True)
        assert as_files(store) == files


@pytest.mark.parametrize(("name", "block"), [("q", 0), ("time", 2), ("iterations", 1)])
def test_missing_block(name, block, store, tmp_path):
    """An error names the block, which Zarr would read as NaN."""
    inner = "/0" if name == "q" else ""
    (store / name / "c" / f"{block}{inner}").unlink()
    recording = gs.load(store)
    for use in (lambda: recording[:], recording.dataset, lambda: recording.save(tmp_path / "x.csv"),
                lambda: recording.save(tmp_path / "x.nc")):
        with pytest.raises(gs.InputError, match=f"rows {block * 16} .*'{name}'"):
            use()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.zarr"]


@pytest.mark.parametrize(("name", "change", "end"), [
    ("q/c/1/0", lambda data: data[:9] + bytes([data[9] ^ 1]) + data[10:], ".csv"),
    ("q/c/1/0", lambda data: data[:-5], ".nc"), ("time/c/0", lambda data: b"", ".npz"),
    ("energy/c/2", lambda data: data + bytes(4), ".csv")])
def test_damaged_block(name, change, end, store):
    """The checksum detects a single wrong bit, and no file is exported."""
    (store / name).write_bytes(change((store / name).read_bytes()))
    recording, target = gs.load(store), store.with_name("run" + end)
    with pytest.raises(gs.InputError, match="damaged") as error:
        recording.save(target)
    sentence(error.value)
    assert [p.name for p in store.parent.iterdir()] == ["run.zarr"]


def test_damaged_checkpoint(store, gl3):
    file = store / "checkpoint" / "c" / "0"
    data = bytearray(file.read_bytes())
    data[100] ^= 1
    file.write_bytes(data)
    with pytest.raises(gs.InputError, match=re.escape(f"{str(store)!r}")) as error:
        record(gl3, **ARGUMENTS, out=store, resume=True)
    sentence(error.value)
    assert gs.load(store)[:].q.shape == (42, 4)


def test_any_byte_of_a_damaged_store(store, gl3, tmp_path):
    """A wrong bit anywhere leads to an error of ours or to a run that ends with the right bytes."""
    uninterrupted = tmp_path / "whole.zarr"
    random = np.random.default_rng(11)
    with pytest.MonkeyPatch.context() as patch:
        small_blocks(patch, 16)
        record(gl3, **ARGUMENTS, out=uninterrupted)
        shutil.copytree(store, tmp_path / "kept.zarr")
        files = sorted(p.relative_to(store) for p in store.rglob("*") if p.is_file())
        for _ in range(8):
            name = files[random.integers(len(files))]
            data = bytearray((store / name).read_bytes())
            data[random.integers(len(data))] ^= 1 << random.integers(8)
            (store / name).write_bytes(data)
            try:
                everything(store, gl3)
            except gs.GyrosparkError as error:
                sentence(error)
            shutil.rmtree(store)
            shutil.copytree(tmp_path / "kept.zarr", store)
        record(gl3, **ARGUMENTS, out=store, resume=True)
    assert_same_bytes(uninterrupted, store)
