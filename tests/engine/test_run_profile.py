"""Profile ``run``: plain C of one trajectory against the full stepper and profile control.

Newton's steps agree with the full stepper to the bit; sweeps agree with control, to the bit while
no step needs Newton; and both end where the full stepper ends, up to rounding.
"""

from __future__ import annotations

import re
import shutil
from functools import cache

import numpy as np
import pytest

import systems
from c_programs import Program
from calls import PARAMETERS, TOP
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.runtime.compilation.compiler import read_declarations
from processes import call

ROWS = 40


def models():
    """Return name → scheme, system or None, start, parameters, dt, time at the start."""
    top, bead = (TOP.q0, TOP.p0), ([0.6, -0.8], [0.8, 0.6])
    drag = {"k": 1.3, "c": 0.2, "f": 0.7, "omega": 2.1}
    forced = systems.case("dragged_pendulum").system
    return {
        "G-L2 double": (Spec("G-L", 2), None, top, PARAMETERS, 1e-3),
        "long steps": (Spec("G-L", 2), None, top, PARAMETERS, 0.026),
        "forces EMS float": (Spec("EMS", real="float"), forced, bead, drag, 0.05),
        "forces": (Spec("G-L", 2), forced, bead, drag, 0.05),
        "LIIIA-B3 long-double": (Spec("LIIIA-B", 3, real="long-double"), None, top, PARAMETERS,
                                 1e-3),
    }


MODELS = models()
#: Of these, the default run compiles two profiles each.
FEW = ("G-L2 double", "long steps")
EVERY = [pytest.param(name, marks=[pytest.mark.slow] * (name not in FEW)) for name in MODELS]
every_model = pytest.mark.parametrize("name", EVERY)


@cache
def made(name, profile="run"):
    spec, system, *_ = MODELS[name]
    return generate(spec.with_profile(profile), system=system).source


class Run(Program):
    """A stepper of either profile: runs at once, and trajectories in pieces."""

    def new(self, *shape):
        array = np.zeros(shape, self.type)
        return array, self.pointer(array)

    def start(self, name, solver=None):
        _, _, (q0, p0), values, dt = MODELS[name]
        time = self.manifest.system.time
        fields = {key: float(value) for key, value in values.items()}
        parameters = self.parameters(fields | ({time: 1.25} if time else {}))
        options = solver if solver is None else self.options(0.0, 50, solver)
        (q, q_at), (p, p_at) = self.new(len(q0)), self.new(len(p0))
        q[:], p[:] = q0, p0
        return parameters, options, dt, (q, p), (q_at, p_at), self.new_work()

    def run(self, name, solver):
        """Return rows, record and status of a run."""
        parameters, options, dt, _, state, memory = self.start(name, solver)
        n = len(self.manifest.system.coordinates)
        (q, q_at), (p, p_at) = self.new(ROWS, n), self.new(ROWS, n)
        counts = self.ffi.new(f"int[{ROWS}]")
        work, work_at = self.new(ROWS)
        forced = [work_at] if self.manifest.system.forces else []
        multipliers = [self.ffi.NULL] if self.manifest.profile == "full" else []
        report = self.ffi.new(f"{self.name}_report *")
        status = self.integrate(parameters, options, dt, 2 * ROWS, 2, *state, q_at, p_at,
                                *multipliers, counts, *forced, report, memory)
        return status, [text(q), text(p), text(work), list(counts), self.record(report)]

    def record(self, report):
        fields = self.ffi.typeof(report).item.fields
        return {name: float(getattr(report, name)) for name, _ in fields}

    def steps(self, name, count):
        """Return the end of so many steps of profile control."""
        parameters, _, dt, arrays, state, work = self.start(name)
        self.begin(work, parameters, self.options(0.0, 50), dt, *state)
        for _ in range(count):
            assert self.advance(work, *state) == 0
        return [*map(text, arrays)]

    def hold(self, name, solver, parts):
        """Return the end of a trajectory that is held, and its record."""
        parameters, options, dt, arrays, state, work = self.start(name, solver)
        self.begin(work, parameters, options, dt, *state)
        for steps in parts:
            self.advance(work, steps, *state)
        return [*map(text, arrays), self.record(self.report_of(work))]


def text(array):
    """Return numbers as what tells them apart to the bit, whatever their padding holds."""
    return [np.format_float_scientific(x, unique=True) for x in array.ravel()]


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("programs")
    compiled = cache(lambda name, profile: Run(made(name, profile), folder / f"{name} {profile}",
                                               "-DGYROSPARK_PLAIN"))
    return lambda name, profile: compiled("G-L2 double" if name == "long steps" else name, profile)


AUTO, NEWTON, FIXED_POINT = 0, 1, 2


@every_model
def test_newton_is_that_of_the_full_stepper(name, programs):
    """Rows, iterations, work and records agree to the bit."""
    run_program, full = programs(name, "run"), programs(name, "full")
    status, of_run = run_program.run(name, NEWTON)
    assert (status, of_run) == full.run(name, NEWTON)
    assert status == 0


@every_model
def test_steps_are_those_of_the_full_stepper(name, programs):
    """The end of sweeps depends on their start only by rounding, which adds up."""
    run_program, full = programs(name, "run"), programs(name, "full")
    (status, of_run), (_, of_full) = run_program.run(name, AUTO), full.run(name, AUTO)
    assert status == 0
    bound = (4000 if name == "long steps" else 400) * float(np.finfo(run_program.type).eps)
    for run_texts, full_texts in zip(of_run[:3], of_full[:3], strict=True):
        numbers, expected = (np.array(x, np.longdouble) for x in (run_texts, full_texts))
        assert abs(numbers - expected).max() <= bound * max(abs(expected).max(), 1e-3)
    record, full_record = of_run[-1], of_full[-1]
    assert record["steps"] == full_record["steps"] == 2 * ROWS
    assert record["energy_error_max"] <= 2 * full_record["energy_error_max"] + bound * (
        1 + abs(record["energy_start"]))
    assert record["constraint_max"] <= 2 * full_record["constraint_max"] + bound / 100
    if name == "long steps":
        assert 0 < record["newton_steps"] <= 2 * ROWS


@every_model
def test_any_split_is_a_run_to_the_bit(name, programs):
    run_program = programs(name, "run")
    for solver in (AUTO, NEWTON):
        _, of_run = run_program.run(name, solver)
        pieces = run_program.hold(name, solver, (1, 0, 16, 30, 33))
        n = len(pieces[0])
        assert pieces == [of_run[0][-n:], of_run[1][-n:], of_run[-1]]


@pytest.mark.parametrize("name", [name for name in EVERY if name.values[0] not in (
    "long steps", "LIIIA-B3 long-double")])
def test_sweeps_are_those_of_profile_control(name, programs):
    run_program, control = programs(name, "run"), programs(name, "control")
    assert run_program.hold(name, FIXED_POINT, (60,))[:2] == control.steps(name, 60)


@pytest.mark.parametrize("name", [  # two programs each
    "G-L2 double", pytest.param("forces EMS float", marks=pytest.mark.slow)])
def test_project(name, programs):
    states = []
    for profile in ("run", "full"):
        program = programs(name, profile)
        parameters, _, _, (q, p), state, _ = program.start(name)
        q *= program.type(1.001)
        p += q / 7
        assert program.project(parameters, *state) == 0
        states.append([text(q), text(p)])
    assert states[0] == states[1]


def test_quantities(programs):
    texts = []
    for profile in ("run", "full"):
        program = programs("forces EMS float", profile)
        parameters, _, _, _, state, _ = program.start("forces EMS float")
        values, pointer = program.new(len(program.manifest.system.quantities))
        t, t_at = program.new(1)
        t[:] = 0.5
        program.quantities(parameters, 1, t_at, *state, pointer)
        texts.append(text(values))
    assert texts[0] == texts[1]


def test_nothing_but_what_the_header_declares(programs):
    """The text has no batches, no lanes, and no static function that nothing calls."""
    program = programs("G-L2 double", "run")
    source = made("G-L2 double")
    functions = set(re.findall(rf"\b{source.name}_(\w+)\(", read_declarations(source.header)))
    assert functions == {"work_size", "begin", "advance", "set_parameters", "report_of",
                         "integrate", "project"}
    symbols = [line.split() for line in call(["nm", program.path]).stdout.splitlines()]
    defined = {words[-1].removeprefix(f"{source.name}_") for words in symbols
               if words[-2] == "T" and words[-1].startswith(source.name)}
    assert defined == functions
    assert source.source.count("\n") <= 1850
    for word in ("vector_size", "__asm__", "lanes", "batch", "trajectories_", "malloc"):
        assert word not in source.source
    named = re.findall(r"^static [^;{(]*?\b(\w+)\(", source.source, re.MULTILINE)
    assert len(named) > 50
    for function in named:
        assert len(re.findall(rf"\b{function}\b", source.source)) > named.count(function), function


def test_header_is_for_cplusplus(tmp_path):
    if shutil.which("g++") is None:
        pytest.skip("g++ is not installed")
    source = made("G-L2 double")
    (tmp_path / f"{source.name}.h").write_text(source.header, encoding="utf-8")
    for macro in ("", f"#define {source.name.upper()}_WORK\n"):
        (tmp_path / "main.cpp").write_text(f'{macro}#include "{source.name}.h"\nint main() {{}}\n')
        process = call(["g++", "-Wall", "-Wextra", "-pedantic", "-Werror", "-fsyntax-only",
                        "main.cpp"], cwd=tmp_path)
        assert process.returncode == 0, process.stderr


def test_float128_is_taken():
    """Profile run accepts float128; refusals of both plain profiles are in
    ``test_control_profile.py``."""
    assert "_Float128" in generate(Spec("IMS", real="float128").with_profile("run")).source.header
