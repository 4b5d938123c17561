"""Storage on real machines: memory, clocks, padding of numbers, disks that are full or fail."""

from __future__ import annotations

import ast
import ctypes
import errno
import functools
import gc
import itertools
import os
import shutil
import subprocess
import tracemalloc
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from zarr.core.buffer import default_buffer_prototype

import gyrospark as gs
import gyrospark.storage
import systems
from calls import integrate
from gyrospark.runtime.bindings.real_numbers import without_padding
from gyrospark.runtime.compilation.compiler import find_compiler
from gyrospark.storage import recorder
from gyrospark.storage.durable_files import DurableStore, write_durably
from stores import START, assert_same_bytes, record, recorded, small_blocks


def traced_peak(call):
    """Return the largest memory of Python and NumPy while a function is called, in bytes."""
    gc.collect()  # objects of earlier tests
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("end", [
    "", *(pytest.param(end, marks=pytest.mark.slow) for end in (".csv", ".nc"))])
def test_memory_is_that_of_blocks(end, tmp_path, monkeypatch):
    """Three times as many rows need no more memory: 1,024 more of 332 bytes would be 340 kB.

    Objects of JSON's encoder and of asyncio that wait for the collection of cycles are some 100 kB.
    """
    small_blocks(monkeypatch, 256, seconds=1e9)
    step, case, peaks = systems.stepper("double_top"), systems.case("double_top"), []
    q, p = systems.start("double_top", step)
    for rows in (256, 512, 1536):  # the first run imports and caches
        def stored(rows=rows):
            return record(step, q, p, dt=case.dt, parameters=case.parameters, steps=rows,
                          out=tmp_path / f"{rows}.zarr", resume=True)

        run = stored() if end else None
        write = functools.partial(run.save, tmp_path / f"{rows}{end}") if end else stored
        peaks.append(traced_peak(write) if rows > 256 else write())
    assert peaks[2] - peaks[1] < 250_000


#: Clocks that someone can set.
WALL = {"time", "time_ns", "localtime", "gmtime", "now", "utcnow", "today", "ctime"}


def test_no_wall_clock_in_the_source():
    for file in Path(gyrospark.storage.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                assert "datetime" not in {name.name for name in node.names}, file
            if isinstance(node, ast.ImportFrom):
                assert node.module not in ("datetime", "time"), file
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                assert node.func.attr not in WALL, (file, ast.unparse(node))


def test_between_full_blocks_commits_wait_for_their_time(gl3, tmp_path, monkeypatch):
    """If no time goes by, 1,001 states in blocks of 64 have a commit for each block."""
    small_blocks(monkeypatch, 64, seconds=5.0)
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 50)
    monkeypatch.setattr(recorder, "time", SimpleNamespace(monotonic=lambda: 1e6))
    commits, commit = [], recorder.Recorder._commit

    def counted(course, writer, **options):
        commits.append(course.state.steps)
        commit(course, writer, **options)

    monkeypatch.setattr(recorder.Recorder, "_commit", counted)
    recorded(gl3, tmp_path / "run.zarr", **START, steps=3000, every=3)
    assert len(commits) == 16
    assert commits[-1] == 3000


@pytest.mark.parametrize("clock", [
    pytest.param([0.0, 1e9], marks=pytest.mark.slow), [0.0, 5.0, 5.0, 5.0]])
def test_number_of_commits_does_not_matter(clock, gl3, tmp_path, monkeypatch):
    """The bytes are the same if commits are due never, always, or now and then."""
    small_blocks(monkeypatch, 32, seconds=5.0)
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 25)
    recorded(gl3, tmp_path / "whole.zarr", **START, steps=300, every=3)
    times = itertools.accumulate(itertools.cycle(clock))
    monkeypatch.setattr(recorder, "time", SimpleNamespace(monotonic=lambda: next(times)))
    recorded(gl3, tmp_path / "run.zarr", **START, steps=300, every=3)
    assert_same_bytes(tmp_path / "whole.zarr", tmp_path / "run.zarr")


DIRTY = """
void dirty(unsigned pattern)
{
    volatile unsigned char room[300000];
    for (unsigned i = 0; i < sizeof room; ++i)
        room[i] = (unsigned char)(pattern*(i*2654435761u >> 13));
}
"""


@pytest.fixture(scope="module")
def dirty(tmp_path_factory):
    """A function that leaves a pattern on the stack, below the caller's frame."""
    folder = tmp_path_factory.mktemp("dirty")
    (folder / "dirty.c").write_text(DIRTY, encoding="ascii")
    subprocess.run([*find_compiler().command, "-O0", "-w", "-shared", "-fPIC", "dirty.c", "-o",
                    "dirty.so"], cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "dirty.so")).dirty


def start(step):
    case, (q, p) = systems.case("heavy_top"), systems.start("heavy_top", step)
    return {"q": q, "p": p, "dt": case.dt, "steps": 30, "every": 3, "parameters": case.parameters}


def test_a_store(dirty, tmp_path):
    step = systems.stepper("heavy_top", real="long-double")
    for pattern in (0, 171):
        dirty(pattern)
        recorded(step, tmp_path / f"{pattern}.zarr", **start(step))
    assert_same_bytes(tmp_path / "0.zarr", tmp_path / "171.zarr")


def test_a_file(dirty, tmp_path):
    plain, files = systems.stepper("heavy_top", real="long-double"), []
    for pattern in (0, 171):
        dirty(pattern)
        run = integrate(plain, **start(plain))
        for name in ("q", "p", "energies"):  # as a compiler that copies all 16 bytes leaves them
            getattr(run, name).view(np.uint8).reshape(-1, 16)[:, 10:] = pattern
        files.append(run.save(tmp_path / f"{pattern}.npz").read_bytes())
        loaded = gs.load(tmp_path / f"{pattern}.npz")
        assert np.array_equal(loaded.q, run.q)
    assert files[0] == files[1]


def test_numbers_stay_what_they_are():
    x = np.array([[1, -3], [7, 1e4000]], dtype=np.longdouble) / 3
    for array in (x, x.T, x[::2], x[:0], np.array(x[0, 0])):
        cleared = without_padding(array)
        assert cleared.dtype == array.dtype
        assert np.array_equal(cleared, array)
    doubles = np.arange(3.0)
    assert without_padding(doubles) is doubles


class Disk:
    """Fails at its so-many-th operation and from then on, as a full disk does."""

    def __init__(self, monkeypatch, number):
        self.good_until, self.done, self.number = None, 0, number
        for owner, name in ((Path, "write_bytes"), (Path, "replace"), (os, "fsync"),
                            (Path, "mkdir"), (Path, "rename")):
            monkeypatch.setattr(owner, name, self.watched(getattr(owner, name)))

    def watched(self, function):
        def call(path, *arguments, **options):
            self.done += 1
            if self.good_until is not None and self.done > self.good_until:
                if function.__name__ == "write_bytes":  # a part of it fits
                    function(path, arguments[0][:10])
                raise OSError(self.number, os.strerror(self.number), str(path))
            return function(path, *arguments, **options)
        return call


@pytest.mark.parametrize(("number", "every"), [
    (errno.EIO, 97), pytest.param(errno.ENOSPC, 1, marks=pytest.mark.slow)])  # each operation
def test_disk_that_fails_at_any_operation(number, every, tmp_path, monkeypatch):
    """Each operation of a small run fails in turn: store, rows, checkpoint, attributes.

    The store is resumed when the disk is well again, and ends with the same bytes.
    """
    small_blocks(monkeypatch, 4)
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 9)
    step, out = systems.stepper("heavy_top"), tmp_path / "run.zarr"
    arguments = START | {"steps": 20, "every": 2}
    recorded(step, tmp_path / "whole.zarr", **arguments)
    disk = Disk(monkeypatch, number)
    for good in itertools.count(0, every):
        shutil.rmtree(out, ignore_errors=True)
        disk.good_until, disk.done = good, 0
        try:
            record(step, out=out, **arguments)
        except gs.errors.StorageError as error:
            text = str(error)
            assert repr(str(out)) in text
            assert os.strerror(number) in text
            assert "free" in text or "written" in text
        else:
            break
        finally:
            disk.good_until = None
        if out.exists():
            gs.load(out)
        else:
            assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".run")] == []
        record(step, out=out, resume=True, **arguments)
        assert_same_bytes(tmp_path / "whole.zarr", out)
    assert good > 60


def test_a_file_written_at_once_makes_its_store(tmp_path):
    store = DurableStore(tmp_path / "new.zarr")
    store.set_sync("key", default_buffer_prototype().buffer.from_bytes(b"abc"))
    assert (tmp_path / "new.zarr" / "key").read_bytes() == b"abc"
    with pytest.raises(ValueError, match="read"):
        DurableStore(tmp_path / "new.zarr", read_only=True).set_sync(
            "key", default_buffer_prototype().buffer.from_bytes(b"d"))
    with pytest.raises(FileNotFoundError):
        DurableStore(tmp_path / "none.zarr", read_only=True).set_sync(
            "key", default_buffer_prototype().buffer.from_bytes(b"d"))


@pytest.mark.parametrize("end", [".csv", ".nc"])
def test_export_to_a_full_disk(end, gl3, tmp_path, monkeypatch):
    """The file appears complete or not at all."""
    recording = record(gl3, **START, out=tmp_path / "run.zarr", steps=100)
    disk = Disk(monkeypatch, errno.ENOSPC)
    disk.good_until = 0
    with pytest.raises(gs.GyrosparkError, match=f"run{end}'.*space"):
        recording.save(tmp_path / f"run{end}")
    disk.good_until = None
    assert sorted(path.name for path in tmp_path.iterdir()) == [".run.zarr.lock", "run.zarr"]


@pytest.mark.skipif(os.name == "nt", reason="Windows does not sync folders")
def test_a_file_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    """A power cut would leave a name without its bytes; the name is synced afterwards."""
    operations = []

    def fsync(handle):
        operations.append(("sync", os.fstat(handle).st_ino))

    def replace(source, target):
        operations.append(("name", source.stat().st_ino, source.read_bytes()))
        os.replace(source, target)  # noqa: PTH105

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(Path, "replace", replace)
    write_durably(tmp_path / "file", b"bytes")
    file, folder = (path.stat().st_ino for path in (tmp_path / "file", tmp_path))
    assert operations == [("sync", file), ("name", file, b"bytes"), ("sync", folder)]
