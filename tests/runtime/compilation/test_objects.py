"""A stepper's C in several objects, of which lanes are compiled when they are first asked for."""

from __future__ import annotations

import re
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import gyrospark as gs
import systems
from gyrospark import api
from gyrospark.core.real_types import REALS
from gyrospark.generator.spec import Spec
from gyrospark.runtime.compilation import compiler, object_files
from gyrospark.runtime.steppers import evaluation

TOP = gs.problems.fast_top()
MODULES = "oscillator_*.so"
COUNT = 9  # more than the lanes of a register, and no multiple of them


def files_of(real, scheme="IMS"):
    """Return the files of a stepper whose sweeps fail for long steps: Newton is behind them."""
    return api.files_of(Spec.from_arguments(scheme, 2 if scheme == "G-L" else None, real=real))


@pytest.fixture
def own_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("GYROSPARK_CACHE", str(tmp_path))
    monkeypatch.setenv("GYROSPARK_OPTIMISE", "0")
    return tmp_path


def numbers(array):
    return [str(x) for x in np.asarray(array).flat]  # as many digits as tell one from the next


def results(step):
    """Return what the stepper's functions give, entry by entry."""
    par = {name: TOP.parameters[name] for name in ("I1", "I2", "I3", "mgl")} | {"gamma": 1e-3}
    q, p = step.project(np.array(TOP.q0) * 1.0001, TOP.p0, parameters=par)
    found = []
    for solver in ("auto", "newton", "fixed-point"):
        what = {"parameters": par, "solver": solver, "steps": 12}
        one = step.integrate(q, p, dt=2e-3, **what)
        many = step.integrate_ensemble([q] * COUNT, [p] * COUNT,
                                       dt=np.linspace(1e-3, 0.05, COUNT), **what)
        found += [one.q, one.p, one.multipliers, one.energies, many.q, many.p, many.multipliers]
        found += [[int(member.report.newton_steps) for member in many.members]]
        found += [sorted(many.failures)]
    x = step.guess(q, p, dt=1e-3, parameters=par)
    at = {"dt": 1e-3, "parameters": par}
    found += [q, p, x, step.residual(x, q, p, **at), step.jacobian(x, q, p, **at)]
    return [numbers(part) for part in found]


@pytest.mark.filterwarnings("ignore:The fastest rotation")
@pytest.mark.slow  # nine objects with optimisation
@pytest.mark.parametrize(("scheme", "real", "level"), [
    ("IMS", "double", "1"), ("IMS", "long-double", "1"), ("G-L", "double", "3")])
def test_objects_compute_the_bits_of_one(scheme, real, level, own_cache, monkeypatch):
    """Runs, Newton behind them, lanes and what is evaluated once, against the file in one piece."""
    monkeypatch.setenv("GYROSPARK_OPTIMISE", level)
    files = files_of(real, scheme)
    apart = results(gs.Stepper(*named(files)))
    steps = apart[7]
    assert steps[0] == "0"
    assert steps[-1] == "12"  # Newton was asked on lanes
    monkeypatch.setattr(compiler, "objects_of", lambda name, files, part, **how: [
        object_files.Object("whole", files[f"{name}.h"], checks=("numbers", "lanes"))])
    monkeypatch.setattr(compiler, "has_newton_apart", lambda name, files: False)
    monkeypatch.setattr(compiler, "declarations_of", lambda name, header, part: header)
    monkeypatch.setattr(evaluation, "load_module", loaded_in_one_piece(evaluation.load_module))
    assert results(gs.Stepper(*named(files))) == apart


def named(files):
    name = next(file for file in files if file.endswith(".json")).removesuffix(".json")
    return name, dict(files)


def small_stepper():
    """Return an oscillator's stepper whose objects are not compiled yet."""
    files = systems.stepper("oscillator").files
    return gs.Stepper(*named(files))


def loaded_in_one_piece(load):
    """Return ``load`` with a comment in the C, which makes it another entry of the cache."""
    return lambda name, files, part="runs": load(
        name, files | {f"{name}.c": files[f"{name}.c"] + "/* in one piece */\n"}, part)


@pytest.mark.slow  # three modules with optimisation; the test below asks for lanes too
def test_lanes_are_compiled_when_first_asked_for(own_cache, monkeypatch):
    """Not for a run, nor for an ensemble without them; once, also by threads that ask together."""
    monkeypatch.setenv("GYROSPARK_OPTIMISE", "1")  # at -O0 one module has all
    step = small_stepper()
    what = {"dt": 1e-3, "steps": 2, "parameters": {"k": 4.0}}
    step.integrate([0.8], [-0.3], **what)
    assert len(list(own_cache.glob(MODULES))) == 1
    step.integrate_ensemble([[0.8]] * 2, [[-0.3]] * 2, solver="newton", **what)
    assert len(list(own_cache.glob(MODULES))) == 2  # and Newton's method
    together = threading.Barrier(4)

    def ask(_):
        together.wait()
        return step._binding_of_many

    with ThreadPoolExecutor(4) as pool:
        assert len(set(map(id, pool.map(ask, range(4))))) == 1
    assert len(list(own_cache.glob(MODULES))) == 3
    assert step._binding_of_many.lanes == step.binding.lanes > 0
    step.integrate_ensemble([[0.8]] * 2, [[-0.3]] * 2, **what)
    assert len(list(own_cache.glob(MODULES))) == 3


def test_a_module_has_its_functions_and_no_other():
    """Those of one trajectory, or those of many; each object defines what no other does."""
    for real in REALS:
        name, files = named(files_of(real))
        header = files[f"{name}.h"]
        every = object_files._functions(name, header)
        assert {"step", "integrate_lanes", "hamiltonian", "increment_size"} < every
        made = {}
        for part in ("runs", "lanes"):
            declared = object_files.declarations_of(name, header, part)
            made[part] = object_files._functions(name, declared)
            defined = [found for one in object_files.objects_of(name, files, part)
                       for found in every if not is_static(name, found, one.header)]
            assert sorted(defined) == sorted(made[part])
        assert made["runs"] | made["lanes"] == every
        assert made["runs"] & made["lanes"] == {"lanes", "work_size"}


def is_static(name, function, header):
    line = re.search(rf"^(?! \*).*\b{name}_{function}\(", header, re.MULTILINE)
    return " static " in line[0]


def test_a_stepper_without_lanes_is_one_object():
    files = {"a.h": "int a_step(void);\nint a_integrate_many(long count);\n", "a.c": ""}
    assert object_files.objects_of("a", files, "runs") == [
        object_files.Object("whole", files["a.h"], checks=("numbers",))]
    assert object_files.declarations_of("a", files["a.h"], "runs") == files["a.h"]
