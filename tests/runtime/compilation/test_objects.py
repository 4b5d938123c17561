"""A stepper's C has several objects: lanes and Newton's method are compiled at first use."""

from __future__ import annotations

import errno
import os
import re
import sysconfig
import threading
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

import gyrospark as gs
import systems
from c_programs import run as run_compiler
from compilers import COMPILERS, MAIN
from gyrospark import api
from gyrospark.core.real_types import REALS
from gyrospark.generator.spec import Spec
from gyrospark.runtime.compilation import compiler, newton_library, object_files, stepper_module
from gyrospark.runtime.compilation.build_cache import CacheError
from processes import PATIENCE

MODULES = "oscillator_*.so"


def made(**options):
    files = api.files_of(Spec.from_arguments("IMS", **options))
    name = next(file for file in files if file.endswith(".json")).removesuffix(".json")
    return name, dict(files)


@pytest.fixture
def own_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("GYROSPARK_CACHE", str(tmp_path))
    monkeypatch.setenv("GYROSPARK_OPTIMISE", "1")  # at -O0 one module has all
    return tmp_path


def small_stepper():
    """Return an oscillator's stepper whose objects are not compiled yet."""
    compiled = systems.stepper("oscillator")
    return gs.Stepper(compiled.name, dict(compiled.files))


@pytest.mark.slow  # three modules with optimisation; the test below asks for lanes too
def test_lanes_are_compiled_when_first_asked_for(own_cache):
    """Runs and ensembles by Newton need none; threads that ask together compile them once."""
    step = small_stepper()
    arguments = {"dt": 1e-3, "steps": 2, "parameters": {"k": 4.0}}
    step.integrate([0.8], [-0.3], **arguments)
    assert len(list(own_cache.glob(MODULES))) == 1
    step.integrate_ensemble([[0.8]] * 2, [[-0.3]] * 2, solver="newton", **arguments)
    assert len(list(own_cache.glob(MODULES))) == 2  # and Newton's method
    together = threading.Barrier(4)

    def ask(_):
        together.wait()
        return step._binding_of_many

    with ThreadPoolExecutor(4) as pool:
        assert len(set(map(id, pool.map(ask, range(4))))) == 1
    assert len(list(own_cache.glob(MODULES))) == 3
    assert step._binding_of_many.lanes == step.binding.lanes > 0
    step.integrate_ensemble([[0.8]] * 2, [[-0.3]] * 2, **arguments)
    assert len(list(own_cache.glob(MODULES))) == 3


def test_a_module_has_its_functions_and_no_other():
    """A module has the functions of one trajectory or of many; one object defines each."""
    for real in REALS:
        name, files = made(real=real)
        header = files[f"{name}.h"]
        every = object_files._functions(name, header)
        assert {"step", "integrate_lanes", "hamiltonian", "increment_size"} < every
        functions = {}
        for kind in ("runs", "lanes"):
            declared = object_files.declarations_of(name, header, kind)
            functions[kind] = object_files._functions(name, declared)
            defined = [function for linked in object_files.objects_of(name, files, kind)
                       for function in every if not is_static(name, function, linked.header)]
            assert sorted(defined) == sorted(functions[kind])
        assert functions["runs"] | functions["lanes"] == every
        assert functions["runs"] & functions["lanes"] == {"lanes", "work_size"}


def is_static(name, function, header):
    line = re.search(rf"^(?! \*).*\b{name}_{function}\(", header, re.MULTILINE)
    return " static " in line[0]


@pytest.mark.parametrize("real", ["double", "float128"])
def test_the_wrapper_is_free_of_what_newer_compilers_refuse(real, tmp_path):
    """gcc 14 and clang 16 made errors of these warnings, which -w does not suppress."""
    name, files = made(real=real)
    for file, text in files.items():
        (tmp_path / file).write_text(text, encoding="utf-8")
    refused = ("incompatible-pointer-types", "int-conversion", "implicit-int",
               "implicit-function-declaration")
    for kind in ("runs", "lanes"):
        wrapper = compiler._write_wrapper(name, files, (), tmp_path, kind, newton_apart=True)
        run_compiler([*COMPILERS[MAIN], "-fsyntax-only", f"-I{sysconfig.get_paths()['include']}",
                      "-I.", *(f"-Werror={warning}" for warning in refused), wrapper.name],
                     tmp_path)


def test_a_stepper_without_lanes_is_one_object():
    files = {"a.h": "int a_step(void);\nint a_integrate_many(long count);\n", "a.c": ""}
    assert object_files.objects_of("a", files, "runs") == [
        object_files.Object("whole", files["a.h"], checks=("numbers",))]
    assert object_files.declarations_of("a", files["a.h"], "runs") == files["a.h"]


RUN = {"dt": 0.02, "steps": 3, "parameters": {"k": 4.0}}


def run(step, solver="auto"):
    return step.integrate([0.8], [-0.3], solver=solver, **RUN).q


def by_newton(step):
    return run(step, "newton")


def guess(step):
    return step.guess([0.8], [-0.3], dt=0.02, parameters=RUN["parameters"])


def forked(step, results):
    results.put(by_newton(step).tolist())


def test_the_library_is_made_when_it_is_needed_and_its_errors_are_raised(own_cache, monkeypatch):
    """Calls fail without a compiler and on a full disk; a fork and its parent then succeed."""
    step = small_stepper()
    fixed = run(step)
    assert len(list(own_cache.glob(MODULES))) == 1
    monkeypatch.setenv("CC", "no-such-compiler")
    for call in (by_newton, guess):
        with pytest.raises(gs.errors.CompilerError, match="no-such-compiler"):
            call(step)
    assert np.array_equal(run(step), fixed)
    monkeypatch.delenv("CC")

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as changed:
        changed.setattr(stepper_module, "publish", full)
        with pytest.raises(CacheError, match="space"):
            by_newton(step)
    assert len(list(own_cache.glob(MODULES))) == 1
    context = get_context("fork")
    results = context.Queue()
    child = context.Process(target=forked, args=(step, results))
    child.start()
    child_states = results.get(timeout=PATIENCE)
    child.join()
    assert len(list(own_cache.glob(MODULES))) == 2
    states = by_newton(step)
    assert states.tolist() == child_states
    assert np.abs(states - fixed).max() < 1e-12
    assert len(list(own_cache.glob(MODULES))) == 2


def test_the_table_has_every_function_in_the_order_of_the_calls():
    for real in ("double", "float128"):
        name, files = made(real=real)
        header = files[f"{name}.h"]
        table = newton_library.table_text(name, header, "void check(int kernel);")
        calls = newton_library.trampolines(name, header, public=True)
        entries = [line.strip(" ,").removeprefix("(newton_function)")
                   for line in table.splitlines() if line.startswith("    (newton_function)")]
        assert entries[newton_library.CHECK] == "check"
        assert len(entries) == 4 + len(object_files.newton_functions(name, header))
        for index, function in enumerate(entries):
            assert (f"(&{function}))table[{index}])" in calls) is (function != "check")


def test_modules_of_one_name_keep_their_functions():
    """Two kinds of modules have the name of their stepper; another stepper of it loads both again.

    CPython would load each again into the object of the other.
    """
    step = systems.stepper("oscillator")
    kinds = ["runs", "derivatives", "runs", "derivatives"]
    loaded = [stepper_module.load_module(step.name, dict(step.files), kind) for kind in kinds]
    paths = [module.__file__ for module in loaded]
    assert paths[0] == paths[2] != paths[1] == paths[3]
    functions = [dir(module.lib) for module in loaded]
    assert functions[0] == functions[2] != functions[1] == functions[3]
