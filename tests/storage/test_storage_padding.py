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
from calls import integrate
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
        again = gs.load(tmp_path / f"{pattern}.npz")
        assert np.array_equal(again.q, run.q)
    assert files[0] == files[1]


def test_numbers_stay_what_they_are():
    x = np.array([[1, -3], [7, 1e4000]], dtype=np.longdouble) / 3
    for array in (x, x.T, x[::2], x[:0], np.array(x[0, 0])):
        kept = without_padding(array)
        assert kept.dtype == array.dtype
        assert np.array_equal(kept, array)
    doubles = np.arange(3.0)
    assert without_padding(doubles) is doubles
