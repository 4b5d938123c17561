"""A wheel for one platform: its steppers run where there is no compiler, and are what they say."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import zipfile

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.api import checked_in_files
from gyrospark.core.errors import CompilerError
from gyrospark.runtime.compilation import prebuilt, stepper_module
from processes import ROOT, environment

NAME = "heavy_top_ims_gamma"


@pytest.fixture(scope="module")
def wheel_folder(tmp_path_factory):
    """Modules as a wheel has them, compiled for any processor."""
    folder = tmp_path_factory.mktemp("wheel") / "prebuilt"
    prebuilt.prebuild({NAME: checked_in_files(NAME)}, folder)
    return folder


@pytest.fixture
def no_compiler(wheel_folder, monkeypatch):
    """A machine that has the wheel and no compiler."""
    def none():
        raise CompilerError("No C compiler was found.")

    monkeypatch.setattr(stepper_module, "find_compiler", none)
    monkeypatch.setattr(prebuilt, "FOLDER", wheel_folder)
    prebuilt._modules.cache_clear()
    yield
    prebuilt._modules.cache_clear()


def fast_top_run(dt=1e-3):
    top = gs.problems.fast_top()
    step = gs.Stepper(NAME, checked_in_files(NAME))  # not one that another test has loaded
    return step, step.integrate(top.q0, top.p0, dt=dt, steps=100,
                                parameters=top.parameters)


def test_runs_without_a_compiler(no_compiler, request):
    step, run = fast_top_run()
    assert "-march=native" not in step._provenance["flags"]
    assert step._provenance["compiler"]
    request.getfixturevalue("monkeypatch").undo()
    _, prebuilt_run = fast_top_run()
    # Other instructions round otherwise: a hundred steps, each by a few eps of |q| = 1.
    assert np.max(np.abs(np.array(run.q) - np.array(prebuilt_run.q))) < 1000*np.finfo(float).eps


def test_other_steppers_ask_for_a_compiler(no_compiler):
    files = checked_in_files(NAME)
    with pytest.raises(CompilerError, match="No C compiler"):
        stepper_module.load_module(NAME, files | {f"{NAME}.c": files[f"{NAME}.c"] + "\n"})


def test_a_damaged_module_is_not_loaded(no_compiler, wheel_folder, tmp_path, monkeypatch):
    damaged = shutil.copytree(wheel_folder, tmp_path
                              / "prebuilt")  # the loaded folder stays as it is
    monkeypatch.setattr(prebuilt, "FOLDER", damaged)
    files = checked_in_files(NAME)
    (path,) = damaged.glob("*_runs*")
    assert prebuilt.prebuilt_module(files, "runs") == path
    content = path.read_bytes()
    path.write_bytes(content[:5000] + b"x" + content[5001:])
    assert prebuilt.prebuilt_module(files, "runs") is None


def test_a_checkout_has_none():
    assert not prebuilt.FOLDER.exists()
    assert prebuilt.prebuilt_module(checked_in_files(NAME), "runs") is None


@pytest.mark.slow
def test_wheel_of_a_platform(tmp_path):
    """The wheel of RELEASE.md has a tag for this platform, modules inside, and runs a top without
    gcc."""
    pytest.importorskip("build")
    build = subprocess.run([sys.executable, "-m", "build", "--wheel", "--outdir", tmp_path, ROOT],
                           env=environment(GYROSPARK_PREBUILT=NAME, PYTHONWARNINGS=None),
                           capture_output=True, text=True, check=False)
    assert build.returncode == 0, build.stderr
    (wheel,) = tmp_path.glob("*-cp311-abi3-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        about = json.loads(archive.read("gyrospark/prebuilt/modules.json"))
    assert set(about) == {f"{NAME}_{kind}.abi3.so" for kind in ("runs", "lanes")}
    python = tmp_path / "venv" / "bin" / "python"
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True)
    subprocess.run([python, "-m", "pip", "install", "--quiet", "--no-compile", wheel], check=True,
                   env=environment(PYTHONWARNINGS=None, PYTHONPATH=None))
    process = subprocess.run(
        [python, "-m", "gyrospark", "run", "fast-top", "--scheme", "IMS", "--dt", "1e-3",
         "--steps", "10", "--json"], cwd=tmp_path, text=True, check=False, capture_output=True,
        env=environment(PATH="", CC=None, PYTHONPATH=None, GYROSPARK_CACHE=str(tmp_path / "cache")))
    assert process.returncode == 0, process.stderr
    assert json.loads(process.stdout)["steps"] == 10
