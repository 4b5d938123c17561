"""One list of a run's outputs: what holds, writes and reads them goes by it."""

from __future__ import annotations

import json
import shutil
from dataclasses import fields

import numpy as np
import pytest
import zarr

import gyrospark as gs
from calls import PARAMETERS, RUN, TOP, equal, refused
from gyrospark.runtime.results.outputs import OUTPUTS, names_in_files
from gyrospark.runtime.results.state_columns import states_of
from gyrospark.storage.array_layout import fields_of
from stores import record


def test_a_trajectory_has_a_field_for_each():
    arrays = [one.name for one in fields(gs.Trajectory) if one.type == "Array"]
    assert sorted(arrays) == sorted(one.attribute for one in OUTPUTS)
    for one in OUTPUTS:
        assert one.attribute in gs.Trajectory.__doc__


def test_files_and_stores_have_the_same_in_the_same_order(gl3):
    run = gl3.integrate(TOP.q0, TOP.p0, steps=4, **RUN)
    assert list(states_of(run)) == [one.name for one in fields_of(gl3.manifest)]
    assert list(states_of(run)) == [
        name for one in OUTPUTS for name in names_in_files(one, gl3.manifest)]
    assert run.panels() == {}  # energy and constraints have pictures of their own


def test_a_file_without_an_output_is_refused(gl3, tmp_path):
    """Neither damage nor made up."""
    path = gl3.integrate(TOP.q0, TOP.p0, steps=4, **RUN).save(tmp_path / "run.npz")
    with np.load(path) as file:
        kept = {name: file[name] for name in file if name != "f_errors"}
    np.savez(path, **kept)
    with refused("f_errors.*gyrospark.*damaged"):
        gs.load(path)
    about = json.loads(str(kept["about"]))
    del about["report"]["steps"]
    np.savez(path, **kept | {"about": np.array(json.dumps(about))})
    with refused(r"run\.npz.*damaged"):
        gs.load(path)


def test_a_store_without_an_output_is_read_and_not_resumed(gl3, tmp_path):
    """Of a version that had not got it; what it has can be read, but not gone on with."""
    whole = record(gl3, TOP.q0, TOP.p0, out=tmp_path / "run.zarr", steps=4, **RUN)
    assert equal(whole[:], gl3.integrate(TOP.q0, TOP.p0, steps=4, **RUN))
    shutil.rmtree(tmp_path / "run.zarr" / "f_error")
    group = zarr.open_group(tmp_path / "run.zarr", mode="r+", use_consolidated=False)
    group.update_attributes({"arrays": [x for x in group.attrs["arrays"] if x != "f_error"]})
    found = gs.load(tmp_path / "run.zarr")
    with refused("gyrospark.*f_error"):
        found[:]
    with pytest.raises(gs.InputError, match="array 'f_error'"):
        record(gl3, TOP.q0, TOP.p0, out=tmp_path / "run.zarr", steps=8, dt=RUN["dt"],
                  parameters=PARAMETERS, resume=True)
