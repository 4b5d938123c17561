"""Short files include the engine, standalone files contain it, and steppers keep their engine."""

from __future__ import annotations

import importlib
import json
import pickle
import re
import shutil

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from calls import PARAMETERS
from command_line import refused
from compilers import MAIN, compiler
from gyrospark import api
from gyrospark.api import checked_in_files
from gyrospark.core.errors import GyrosparkError
from gyrospark.engine import amalgamate as engine
from gyrospark.engine.amalgamate import FOLDER, amalgamate
from gyrospark.generator.fingerprint import generator_fingerprint
from gyrospark.runtime.compilation import prebuilt
from gyrospark.runtime.compilation.build_cache import binary_key, digest
from gyrospark.runtime.compilation.compiler import find_compiler
from gyrospark.targets.native import native_bits
from processes import ROOT, call, gyrospark_command
from stores import START, record
from toy import HEADERS

NAME = "heavy_top_ims_gamma"
SHORT = sorted((ROOT / "generated").glob("*.c"))
FLAGS = ["-std=c11", "-O0", "-ffp-contract=off"]


def text_of(name):
    return (ROOT / "generated" / f"{name}.c").read_text(encoding="utf-8")


@pytest.fixture
def other_engine(tmp_path, monkeypatch):
    """Return a function that changes headers of a copy of the engine, which is then used."""
    folder = tmp_path / "engine"
    shutil.copytree(FOLDER / "gyrospark", folder / "gyrospark")

    def change(header, old, new):
        path = folder / "gyrospark" / header
        text = path.read_text(encoding="ascii")
        assert old in text
        path.write_text(text.replace(old, new), encoding="ascii")
        monkeypatch.setattr(engine, "FOLDER", folder)
        engine._header.cache_clear()
        api._named_stepper.cache_clear()  # of other tests in this process
        return folder

    yield change
    engine._header.cache_clear()


CHANGE = ("fixed_point/convergence.h", "s->iterations > 2", "s->iterations > 3")


FULL = ["newton/step", "run/batch", "run/ensemble", "run/begin_advance"]
RUN = ["newton/step", "profiles/run", "run/begin_advance"]


@pytest.mark.parametrize(("features", "headers"), [
    ("SPARK INPUTS", FULL), ("FRAME FRAME_WORK FORCES TIME_DEPENDENT", FULL),
    ("SPARK LAGRANGIAN TIME_DEPENDENT", FULL), ("ELEMENTS", FULL),
    ("SPARK PROFILE_RUN FORCES", RUN), ("PROFILE_CONTROL", ["profiles/control"])])
def test_amalgamation_does_what_the_preprocessor_does(features, headers, tmp_path):
    """Both leave the same tokens, also where macros of features expand to nothing."""
    fixed_point = "" if "PROFILE" in features else "FIXED_POINT"
    names = ["ENGINE", "CONSTRAINED", "FACTORS", *f"{fixed_point} {features}".split()]
    lines = [f"#define GS_{name} 1" for name in names]
    lines += ["#define NAME(f) toy_##f", "#define MATH(f) f", "#define LIMIT(f) DBL_##f",
              "#define KERNEL(f) KERNEL_##f", "#define KERNEL_constraint constraint",
              "#define KERNEL_constraint_jacobian G", "#define KERNEL_constraint_increment dg",
              "#define KERNEL_hidden_constraint f", "#define KERNEL_hidden_matrix W",
              "#define KERNEL_mean_constraint mean_constraint",
              *(f'#include "gyrospark/{name}.h"' for name in ("engine", *headers)), ""]
    tokens = []
    for text in ("\n".join(lines), amalgamate("\n".join(lines))):
        (tmp_path / "x.c").write_text(text, encoding="ascii")
        process = call([*compiler(MAIN), "-E", "-P", f"-I{FOLDER}", "x.c"], cwd=tmp_path)
        assert process.returncode == 0, process.stderr
        tokens.append("".join(process.stdout.split()))
    assert len(tokens[0]) > 5000
    assert tokens[0] == tokens[1]


def test_standalone_files_contain_what_they_need():
    for path in SHORT:
        standalone = amalgamate(path.read_text(encoding="utf-8"))
        assert "gyrospark/" not in standalone, path
        assert not re.search(r"^#\w+.*\bGS_", standalone, re.MULTILINE), path
        assert amalgamate(standalone) == standalone, path


def test_a_system_may_be_named_as_the_engine_names_its_features(tmp_path):
    """The C of "gs_demo" defines GS_DEMO_GL2_WORK for its header, which is no name of the engine.
    """
    x, px = sp.symbols("x px", real=True)
    system = gs.System((x,), (px,), (), px**2 / 2 + x**2 / 2, name="gs_demo")
    run = gs.stepper("G-L", 2, system=system).integrate([0.0], [1.0], dt=0.02, steps=50)
    assert run.q[-1, 0] == pytest.approx(np.sin(1), abs=1e-9)
    built = gs.build("cpp", system, scheme="G-L", stages=2, dt=0.02, start=([0.0], [1.0]),
                     out=tmp_path / "made")
    assert np.frombuffer(bytes.fromhex(native_bits(built.stepper, built.options, 50)))[0] == (
        pytest.approx(np.sin(1), abs=1e-9))


def test_the_command_of_the_documents_builds_a_short_file(tmp_path):
    """A shell runs cc -I "$(gyrospark include)" -c x.c."""
    (tmp_path / "x.c").write_text(text_of(NAME), encoding="utf-8")
    shutil.copy(ROOT / "generated" / f"{NAME}.h", tmp_path)
    include = " ".join(map(str, gyrospark_command("include")))
    process = call(["sh", "-c", f'{compiler(MAIN)[0]} -std=c11 -O0 -I "$({include})" -c x.c'],
                   cwd=tmp_path)
    assert (process.returncode, process.stderr) == (0, "")
    assert (tmp_path / "x.o").is_file()


def test_the_command_prints_one_line(gyrospark):
    answer = gyrospark("include")
    assert (answer.code, answer.stderr) == (0, "")
    assert answer.stdout == f"{FOLDER}\n"


def test_without_the_folder_the_compiler_says_what_is_missing(tmp_path):
    (tmp_path / "x.c").write_text(text_of(NAME), encoding="utf-8")
    shutil.copy(ROOT / "generated" / f"{NAME}.h", tmp_path)
    process = call([*compiler(MAIN), *FLAGS, "-c", "x.c"], cwd=tmp_path)
    assert process.returncode != 0
    first = next(line for line in process.stderr.splitlines() if "error" in line)
    assert "gyrospark include" in first


def test_a_missing_engine_is_one_sentence(gyrospark, tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "FOLDER", tmp_path / "none")
    monkeypatch.setattr(importlib.import_module("gyrospark.commands.include"), "FOLDER",
                        tmp_path / "none")
    engine._header.cache_clear()
    try:
        refused(gyrospark("include"), "none")
        refused(gyrospark("generate", "--scheme", "IMS", "--no-compile", "--standalone"), "none")
        with pytest.raises(GyrosparkError, match="none"):
            checked_in_files(NAME)
    finally:
        engine._header.cache_clear()


def test_a_missing_header_is_named(other_engine):
    folder = other_engine(*CHANGE)
    (folder / "gyrospark" / CHANGE[0]).unlink()
    with pytest.raises(GyrosparkError, match=re.escape(CHANGE[0])):
        amalgamate(text_of(NAME))


def test_another_version_of_the_engine_is_refused(other_engine, gyrospark, tmp_path):
    """The compiler, Python and a command refuse it."""
    folder = other_engine("engine.h", "#define GS_ENGINE_VERSION 1", "#define GS_ENGINE_VERSION 2")
    with pytest.raises(GyrosparkError, match="version"):
        amalgamate(text_of(NAME))
    refused(gyrospark("run", "fast-top", "--scheme", "IMS", "--dt", "1e-3", "--steps", "5"),
            "version")
    (tmp_path / "x.c").write_text(text_of(NAME), encoding="utf-8")
    shutil.copy(ROOT / "generated" / f"{NAME}.h", tmp_path)
    process = call([*compiler(MAIN), *FLAGS, f"-I{folder}", "-c", "x.c"], cwd=tmp_path)
    assert process.returncode != 0
    assert "version" in next(line for line in process.stderr.splitlines() if "error" in line)


def test_a_changed_header_is_another_stepper(other_engine):
    """The key of the cache and a wheel's digest change."""
    old_files = checked_in_files(NAME)
    other_engine(*CHANGE)
    new_files = checked_in_files(NAME)
    assert {name for name in old_files if old_files[name] != new_files[name]} == {f"{NAME}.c"}
    compiler = find_compiler()
    assert binary_key(old_files, compiler) != binary_key(new_files, compiler)
    assert digest(old_files) != digest(new_files)


def test_every_header_counts_in_the_fingerprint_of_generated_sources(monkeypatch):
    """A change to any header invalidates the cached sources."""
    read_bytes, paths = type(ROOT).read_bytes, set()

    def reads(path, *arguments, **options):
        paths.add(path)
        return read_bytes(path, *arguments, **options)

    monkeypatch.setattr(type(ROOT), "read_bytes", reads)
    generator_fingerprint.__wrapped__()
    assert set(HEADERS) <= paths


def test_a_prebuilt_module_of_another_engine_is_not_loaded(other_engine, tmp_path, monkeypatch):
    about = {f"{NAME}.so": {"source": digest(checked_in_files(NAME)), "part": "runs",
                            "sha256": prebuilt._checksum(ROOT / "py.typed")}}
    (tmp_path / "modules.json").write_text(json.dumps(about), encoding="utf-8")
    shutil.copy(ROOT / "py.typed", tmp_path / f"{NAME}.so")
    monkeypatch.setattr(prebuilt, "FOLDER", tmp_path)
    prebuilt._modules.cache_clear()
    try:
        assert prebuilt.prebuilt_module(checked_in_files(NAME), "runs") is not None
        other_engine(*CHANGE)
        assert prebuilt.prebuilt_module(checked_in_files(NAME), "runs") is None
    finally:
        prebuilt._modules.cache_clear()


def test_a_run_does_not_resume_on_another_engine(other_engine, tmp_path):
    pytest.importorskip("zarr")
    out, arguments = tmp_path / "run.zarr", START | {"steps": 20}
    record(gs.Stepper(NAME, checked_in_files(NAME)), **arguments, out=out)
    other_engine(*CHANGE)
    with pytest.raises(gs.InputError, match=r"code\.source"):
        record(gs.Stepper(NAME, checked_in_files(NAME)), **arguments, out=out, resume=True)


def test_a_pickle_keeps_the_engine_it_was_made_with(other_engine):
    step = gs.Stepper(NAME, checked_in_files(NAME))
    stored = pickle.dumps(step)
    other_engine(*CHANGE)
    unpickled = pickle.loads(stored)
    assert unpickled._provenance["source"] == step._provenance["source"]
    rebuilt = gs.Stepper(NAME, checked_in_files(NAME))
    assert rebuilt._provenance["source"] != step._provenance["source"]
    runs = [s.integrate(START["q"], START["p"], dt=1e-3, steps=5, parameters=PARAMETERS)
            for s in (step, unpickled)]
    assert np.array_equal(runs[0].q, runs[1].q)
