"""The same run gives the same bytes, whatever compilers leave in those that mean nothing.

An x87 number has 10 bytes of its 16. The others come from the stack, so the stack is filled with
something else before each run: what two processes would otherwise have by chance.
"""

from __future__ import annotations

import ctypes
import subprocess

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import PARAMETERS, TOP
from forced_systems import PARAMETERS as FORCED
from gyrospark.runtime.bindings.real_numbers import without_padding
from gyrospark.runtime.compilation.compiler import find_compiler
from stores import assert_same_bytes, recorded

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


@pytest.fixture(scope="module")
def plain():
    """A long-double stepper without optimisation, which copies the most."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GYROSPARK_OPTIMISE", "0")
        return systems.stepper("dragged_pendulum", real="long-double")


def start(step):
    q, p = step.project([0.6, -0.8], [0.8, 0.6], parameters=FORCED)
    return {"q": q, "p": p, "dt": 0.01, "steps": 60, "every": 3, "parameters": FORCED}


@pytest.mark.parametrize("solver", [
    "auto", *(pytest.param(solver, marks=pytest.mark.slow) for solver in ("newton", "python"))])
def test_a_store(solver, plain, dirty, tmp_path):
    for pattern in (0, 171):
        dirty(pattern)
        recorded(plain, tmp_path / f"{pattern}.zarr", solver=solver, **start(plain))
    assert_same_bytes(tmp_path / "0.zarr", tmp_path / "171.zarr")


@pytest.mark.slow  # a stepper in long double each
@pytest.mark.parametrize(("scheme", "frame"), [(("EMS", None), None), (("G-L", 2), "symmetries")])
def test_a_store_of_the_top(scheme, frame, dirty, tmp_path, monkeypatch):
    """EMS, and a trajectory in a co-moving frame, have fields of their own."""
    monkeypatch.setenv("GYROSPARK_OPTIMISE", "0")
    step = gs.stepper(*scheme, real="long-double", frame=frame)
    parameters = PARAMETERS | ({"omega_body": 3.0} if frame else {})
    q, p = step.project(TOP.q0, TOP.p0, parameters=parameters)
    for pattern in (0, 171):
        dirty(pattern)
        recorded(step, tmp_path / f"{pattern}.zarr", q=q, p=p, dt=1e-3, steps=60, every=3,
                 parameters=parameters)
    assert_same_bytes(tmp_path / "0.zarr", tmp_path / "171.zarr")


def test_a_file(plain, dirty, tmp_path):
    files = []
    for pattern in (0, 171):
        dirty(pattern)
        run = plain.integrate(**start(plain))
        for name in ("q", "p", "energies"):  # as a compiler that copies all 16 bytes leaves them
            getattr(run, name).view(np.uint8).reshape(-1, 16)[:, 10:] = pattern
        files.append(run.save(tmp_path / f"{pattern}.npz").read_bytes())
        again = gs.Trajectory.load(tmp_path / f"{pattern}.npz")
        assert np.array_equal(again.q, run.q)
    assert files[0] == files[1]


@pytest.mark.parametrize("real", [
    "double", *(pytest.param(real, marks=pytest.mark.slow) for real in ("float", "float128"))])
def test_no_other_type_has_padding(real, dirty, tmp_path):
    step = systems.stepper("dragged_pendulum", real=real)
    for pattern in (0, 171):
        dirty(pattern)
        recorded(step, tmp_path / f"{pattern}.zarr", **start(step))
    assert_same_bytes(tmp_path / "0.zarr", tmp_path / "171.zarr")


def test_numbers_stay_what_they_are():
    x = np.array([[1, -3], [7, 1e4000]], dtype=np.longdouble) / 3
    for array in (x, x.T, x[::2], x[:0], np.array(x[0, 0])):
        kept = without_padding(array)
        assert kept.dtype == array.dtype
        assert np.array_equal(kept, array)
    doubles = np.arange(3.0)
    assert without_padding(doubles) is doubles
