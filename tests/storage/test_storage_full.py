"""Disks that are full, or fail, or may not be written: nothing that was stored is lost."""

from __future__ import annotations

import errno
import itertools
import os
import shutil
from pathlib import Path

import pytest

import gyrospark as gs
import systems
from gyrospark.storage.durable_files import write_durably
from stores import START, assert_same_bytes, record, recorded, small_blocks


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
    """All operations of a small run in turn: made a store, wrote rows, checkpoint, attributes.

    The store is gone on with when the disk is well again, and ends with the same bytes.
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


@pytest.mark.parametrize("end", [".csv", ".nc"])
def test_export_to_a_full_disk(end, gl3, tmp_path, monkeypatch):
    """The file appears complete or not at all."""
    found = record(gl3, **START, out=tmp_path / "run.zarr", steps=100)
    disk = Disk(monkeypatch, errno.ENOSPC)
    disk.good_until = 0
    with pytest.raises(gs.GyrosparkError, match=f"run{end}'.*space"):
        found.save(tmp_path / f"run{end}")
    disk.good_until = None
    assert sorted(path.name for path in tmp_path.iterdir()) == [".run.zarr.lock", "run.zarr"]


@pytest.mark.skipif(os.name == "nt", reason="Windows does not sync folders")
def test_a_file_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    """Else a power cut leaves the name of a file without its bytes; the name is synced then."""
    done = []

    def fsync(handle):
        done.append(("sync", os.fstat(handle).st_ino))

    def replace(part, target):
        done.append(("name", part.stat().st_ino, part.read_bytes()))
        os.replace(part, target)  # noqa: PTH105

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(Path, "replace", replace)
    write_durably(tmp_path / "file", b"bytes")
    file, folder = (path.stat().st_ino for path in (tmp_path / "file", tmp_path))
    assert done == [("sync", file), ("name", file, b"bytes"), ("sync", folder)]
