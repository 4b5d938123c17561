"""Stores of an earlier version are read; a run of other code is not resumed."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

import gyrospark as gs
from processes import DATA
from stores import record

KEPT = DATA / "stores"


def run_again(real: str = "double"):
    """Return the stepper, its projected start and parameters of the stored runs."""
    top = gs.problems.fast_top()
    step = gs.stepper("G-L", 2, rep="gamma", real=real)
    parameters = top.parameters | {"gamma": gs.gamma(top.inertia)}
    q0, p0 = step.project(top.q0, top.p0, parameters=parameters)
    return step, q0, p0, parameters


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """Return the Zarr store of an earlier version, unpacked."""
    with zipfile.ZipFile(KEPT / "heavy_top_gl2_gamma.zarr.zip") as packed:
        packed.extractall(tmp_path / "run.zarr")
    return tmp_path / "run.zarr"


@pytest.mark.parametrize("real", ["double", "float128"])
def test_a_kept_file_is_read(real: str) -> None:
    """Its states equal the states of the same run of today, up to the order of additions."""
    suffix = "" if real == "double" else f"_{real}"
    stored = gs.load(KEPT / f"heavy_top_gl2_gamma{suffix}.npz")
    step, q0, p0, parameters = run_again(real)
    computed = step.integrate(q0, p0, dt=1e-3, steps=300, every=10, parameters=parameters)
    assert stored.t.shape == computed.t.shape
    # 300 steps, each of which may end on another neighbour of the root
    bound = 300 * 16 * (2.0 ** -52 if real == "double" else 2.0 ** -112)
    assert np.max(np.abs(stored.q - computed.q)) < bound


def test_an_earlier_store_is_read(store: Path) -> None:
    recording = gs.load(store)
    file = gs.load(KEPT / "heavy_top_gl2_gamma.npz")
    trajectory = recording[:]
    assert np.array_equal(trajectory.q, file.q)
    assert np.array_equal(trajectory.p, file.p)
    assert recording.report.steps == 300


def test_an_earlier_store_is_not_resumed_by_other_code(store: Path) -> None:
    """The bits would differ from the bits of one run: the message names the difference."""
    step, q0, p0, parameters = run_again()
    sizes = sorted((file, file.stat().st_size) for file in store.rglob("*"))
    with pytest.raises(gs.InputError, match=r"another.*code\.source"):
        record(step, q0, p0, dt=1e-3, steps=600, every=10, parameters=parameters,
                  out=store, resume=True)
    assert sorted((file, file.stat().st_size) for file in store.rglob("*")) == sizes
