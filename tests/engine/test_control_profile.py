"""Profile ``control``: against the full stepper, at its bounds, and on other machines.

The C is compiled as its users compile it, and called through cffi.
"""

from __future__ import annotations

import json
import re
import shutil
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from c_programs import STRICT, Program, write
from c_programs import run as said_by
from compilers import MAIN, compiler
from gyrospark.core.errors import InputError
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.runtime.steppers.stepper import Stepper
from processes import DATA, ROOT, call

OK, NOT_CONVERGED, SINGULAR, NOT_FINITE, DIVERGED, INVALID = 0, 1, 2, 3, 5, 6
TOP = gs.problems.fast_top()
PARAMETERS = TOP.parameters | {"gamma": gs.gamma(TOP.inertia)}
SMALL = Spec("G-L", 2, real="float")


@cache
def made(spec, model=None, derivatives=False):
    """Return the stepper's text in profile control, derived once."""
    return generate(spec.with_profile("control"), model=model, derivatives=derivatives).source


class Control(Program):
    """One trajectory of a stepper of profile control."""

    def begin(self, parameters, q, p, dt, *, tolerance=0.0, max_iterations=50, status=OK):
        self.w = self.new_work()
        self.q, self.p = np.array(q, self.type), np.array(p, self.type)
        assert self.library_begin(parameters, dt, tolerance, max_iterations) == status
        return self

    def library_begin(self, parameters, dt, *options):
        return getattr(self.library, f"{self.name}_begin")(
            self.w, self.parameters(parameters), self.options(*options), dt, self.pointer(self.q),
            self.pointer(self.p))

    def velocities(self, parameters, q, p):
        """Return the velocities of a state."""
        names = self.manifest.system.numbers
        velocities = np.zeros(sum(number.role == "velocity" for number in names), self.type)
        self.velocity(self.parameters(parameters), *map(self.pointer, (
            np.array(q, self.type), np.array(p, self.type), velocities)))
        return velocities

    def started(self, parameters, q, velocity):
        """Return status, q and p of a start from velocities."""
        q, velocity = np.array(q, self.type), np.array(velocity, self.type)
        p = np.zeros_like(q)
        status = self.start(self.parameters(parameters), *map(self.pointer, (q, velocity, p)))
        return status, q, p

    def step(self):
        return self.advance(self.w, self.pointer(self.q), self.pointer(self.p))

    def run(self, steps):
        """Take steps that succeed; return all states."""
        q, p = [self.q.copy()], [self.p.copy()]
        for _ in range(steps):
            assert self.step() == OK
            q.append(self.q.copy())
            p.append(self.p.copy())
        return np.array(q), np.array(p)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return Control(made(SMALL), tmp_path_factory.mktemp("small"), "-O2", "-Wshadow")


@pytest.fixture(scope="module")
def composition(tmp_path_factory):
    """A splitting of order 4 in profile control."""
    return Control(made(Spec.from_arguments("splitting", order=4)),
                   tmp_path_factory.mktemp("flows"))


# ---------------------------------------------------------------- the same numbers


def test_steps_are_those_of_the_full_stepper(small):
    """The end of a step depends on the start of its sweeps only by rounding.

    Errors of rounding grow like t; the conserved ones do not: energy and |g| over 4000 steps, in a
    type of 24 bits. A unit in the last place of a rate is worth h|k| eps a step: some hundred eps
    after 500 of them.
    """
    q, p = small.begin(PARAMETERS, TOP.q0, TOP.p0, 1e-3).run(4000)
    run = gs.stepper("G-L", 2, real="float").integrate(
        TOP.q0, TOP.p0, dt=1e-3, steps=4000, parameters=PARAMETERS)
    eps = float(np.finfo(np.float32).eps)
    assert abs(q[:4] - run.q[:4]).max() <= 4 * eps
    assert abs(q - run.q)[:500].max() <= 400 * eps
    assert abs(p - run.p)[:500].max() <= 400 * eps * abs(run.p).max()
    double = systems.stepper("heavy_top")
    H = double.energy(q.astype(float), p.astype(float), parameters=PARAMETERS)
    error, full = abs(H - H[0]).max(), run.report.energy_error_max
    assert error <= 2 * full + 2 * eps * abs(H[0])
    assert abs((q.astype(float) ** 2).sum(1) - 1).max() <= 2 * eps
    assert abs((q.astype(float) * p).sum(1)).max() <= 2 * eps * abs(p).max()


def check_another_system(control, full, parameters, q0, p0):
    """Compare steps, energy, and starts from velocities of both profiles."""
    run = full.integrate(q0, p0, dt=1e-3, steps=60, parameters=parameters)
    q, p = control.begin(parameters, q0, p0, 1e-3).run(60)
    eps = np.finfo(float).eps
    assert abs(q - run.q).max() <= 400 * eps * max(1, abs(run.q).max())
    assert abs(p - run.p).max() <= 400 * eps * max(abs(run.p).max(), 1e-3)
    assert control.energy(control.parameters(parameters), 0.0, control.pointer(q[-1]),
                          control.pointer(p[-1])) == pytest.approx(full.energy(
                              q[-1], p[-1], parameters=parameters), rel=1e-14)
    velocity = control.velocities(parameters, q[0], p[0])
    status, position, momenta = control.started(parameters, q[0], velocity)
    assert status == OK
    assert np.array_equal(position, q[0])  # on the constraints already
    assert abs(momenta - p[0]).max() <= 8 * eps * abs(p[0]).max()
    if full.m > 1:  # joints
        assert control.started(parameters, q[0] + 1e-3, velocity)[0] == INVALID
        assert control.started(parameters, q[0], velocity + 1e-3)[0] == INVALID


@pytest.mark.parametrize(("scheme", "stages", "name"), [
    ("EMS", None, "two_rods"), *(pytest.param(*given, marks=pytest.mark.slow) for given in (
        ("G-L", 2, "two_rods"), ("EMS", None, "dragged_pendulum")))])
def test_steps_and_derivatives_of_other_systems(scheme, stages, name, tmp_path):
    """Two rods have constraints with a W that varies; the dragged pendulum has forces and time."""
    case, full = systems.case(name), systems.differentiable(name, scheme, stages)
    source = generate(Spec(scheme, stages).with_profile("control"), system=case.system,
                      derivatives=True).source
    control, state = Control(source, tmp_path), systems.start(name, full)
    check_another_system(control, full, case.parameters, *state)
    check_derivatives(control, full, case.parameters, *state)


# ---------------------------------------------------------------- bounds and ends


@pytest.fixture(scope="module")
def large(tmp_path_factory):
    """A stepper with three stages in double."""
    return Control(made(Spec("G-L", 3)), tmp_path_factory.mktemp("large"))


def test_sizes_are_those_promised(small, large):
    """The lines and memory of 2-G-L in float, and the memory of 3-G-L in double, are bounded."""
    assert made(SMALL).source.count("\n") <= 900
    assert small.work_size() <= 2048
    assert large.work_size() <= 4096


def test_needs_nothing_but_the_maths_library(tmp_path):
    """It has no writable memory of its own, and exports the documented functions only."""
    source = made(SMALL)
    assert set(re.findall(r'#include [<"](.*?)[>"]', source.source)) == {
        f"{source.name}.h", "float.h", "math.h", "stdbool.h"}
    assert "double" not in source.source
    write(source.files(), tmp_path)
    process = call([*compiler(MAIN), "-std=c11", "-O2", "-c", f"{source.name}.c"], cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    lines = [line.split() for line in call(["nm", f"{source.name}.o"], cwd=tmp_path)
             .stdout.splitlines()]
    assert {words[-2] for words in lines} <= set("TtrU")
    assert {words[-1] for words in lines if words[-2] == "T"} == {
        f"{source.name}_{function}" for function in
        ("begin", "advance", "set_parameters", "iterations", "change", "time", "work_size",
         "energy", "start", "velocity")}
    assert {words[-1] for words in lines if words[-2] == "U"} <= {
        "fmaf", "fmaxf", "sqrtf", "memset", "memcpy", "__stack_chk_fail", "_GLOBAL_OFFSET_TABLE_"}


@pytest.mark.parametrize("max_iterations", [1, 2, 12])
def test_a_step_takes_no_more_sweeps_than_allowed(max_iterations, small):
    """After too few sweeps the state is off by about the last change, and a status says so."""
    eps = float(np.finfo(np.float32).eps)
    exact, _ = small.begin(PARAMETERS, TOP.q0, TOP.p0, 1e-3).run(1)
    small.begin(PARAMETERS, TOP.q0, TOP.p0, 1e-3, max_iterations=max_iterations)
    status = small.step()
    assert status == (NOT_CONVERGED if max_iterations < 3 else OK)
    assert small.iterations(small.w) <= max_iterations
    assert abs(small.q - exact[-1]).max() <= 2 * small.change(small.w) + eps
    assert eps < small.change(small.w) < 0.02 or status == OK


def test_tolerance_saves_sweeps(small):
    def sweeps(tolerance):
        small.begin(PARAMETERS, TOP.q0, TOP.p0, 1e-3, tolerance=tolerance)
        return sum(small.step() + small.iterations(small.w) for _ in range(50))

    assert sweeps(1e-3) < sweeps(1e-5) < sweeps(0.0)


def test_a_step_that_fails_leaves_the_state(small):
    """Sweeps diverge at so long a step; the next call from a possible state goes on."""
    small.begin(PARAMETERS, TOP.q0, TOP.p0, 1.0, max_iterations=20)
    q, p = small.q.copy(), small.p.copy()
    assert small.step() == DIVERGED
    assert small.iterations(small.w) <= 20
    assert np.array_equal(small.q, q)
    assert np.array_equal(small.p, p)


def test_no_number_is_reported_and_forgotten(small):
    q, _ = small.begin(PARAMETERS, TOP.q0, TOP.p0, 1e-3).run(3)
    small.q[1] = np.nan
    assert small.step() == NOT_FINITE
    small.q[:] = q[-1]
    assert small.step() == OK
    undisturbed, _ = small.begin(PARAMETERS, TOP.q0, TOP.p0, 1e-3).run(4)
    assert abs(small.q - undisturbed[-1]).max() <= 4 * np.finfo(np.float32).eps


@pytest.mark.parametrize("wrong", [
    {"dt": 0.0}, {"dt": np.nan}, {"dt": np.inf}, {"q": np.zeros(4)}, {"p": [0, np.inf, 0, 0]},
    {"I2": 0.0}, {"I3": -1e-3}, {"mgl": np.nan}, {"gamma": 0.0}, {"max_iterations": 0},
    {"tolerance": np.nan},
], ids=lambda wrong: "{}={}".format(*next(iter(wrong.items()))))
def test_arguments_outside_of_their_domains_begin_nothing(wrong, small):
    start = {"q": TOP.q0, "p": TOP.p0, "dt": 1e-3}
    options = {key: x for key, x in wrong.items() if key not in PARAMETERS}
    small.begin(PARAMETERS | {key: x for key, x in wrong.items() if key in PARAMETERS},
                **(start | options), status=INVALID)
    assert small.step() == INVALID
    assert small.set_parameters(small.w, small.parameters(PARAMETERS)) == INVALID
    small.begin(PARAMETERS, **start)
    assert small.step() == OK


@pytest.mark.parametrize("name", ["small", "composition"])
def test_memory_of_zeros_is_no_trajectory(name, request):
    """Memory as of `static NAME_work work;` is refused until it begins, and after a refused
    begin."""
    control, parameters = request.getfixturevalue(name), PARAMETERS
    start = parameters, TOP.q0, TOP.p0

    def refuses():
        q, p, memory = control.q.copy(), control.p.copy(), control.ffi.buffer(control.memory)[:]
        assert control.set_parameters(control.w, control.parameters(parameters)) == INVALID
        assert control.step() == INVALID
        assert control.ffi.buffer(control.memory)[:] == memory
        assert np.array_equal([control.q, control.p], [q, p])

    control.begin(*start, 0.0, status=INVALID)  # sets q and p
    control.ffi.memmove(control.memory, bytes(control.work_size()), control.work_size())
    refuses()
    assert (control.time(control.w), control.iterations(control.w),
            control.change(control.w)) == (0, 0, 0)
    q, _ = control.begin(*start, 1e-3).run(3)
    assert abs(q[3] - q[0]).max() > 1e-4
    assert control.time(control.w) == pytest.approx(3e-3)
    assert control.library_begin(parameters, 0.0, 0.0, 50) == INVALID
    refuses()


def test_starts_from_an_attitude_and_an_angular_velocity(small):
    """p equals 2 L(q)^T J Omega for the axis e3, and for a quaternion of any length."""
    omega = [0.1, -0.2, 30.0]
    status, q, p = small.started(PARAMETERS, [2.0, 1.0, 0.0, 0.5], omega)
    assert status == OK
    assert (q**2).sum() == pytest.approx(1, abs=3e-7)
    assert q[0] / q[3] == pytest.approx(4)
    assert small.velocities(PARAMETERS, q, p) == pytest.approx(omega, rel=1e-5)
    upright = small.started(PARAMETERS, [1, 0, 0, 0], omega)[2]
    moments = [PARAMETERS[f"I{i}"] for i in (1, 2, 3)]
    assert upright == pytest.approx([0, *(2 * np.multiply(moments, omega))])
    for wrong in ({"q": [0, 0, 0, 0]}, {"q": [np.nan, 0, 0, 1]}, {"velocity": [np.inf, 0, 0]},
                  {"parameters": PARAMETERS | {"I1": 0.0}}):
        arguments = {"parameters": PARAMETERS, "q": [2.0, 0, 0, 0], "velocity": omega} | wrong
        status, q, p = small.started(**arguments)
        assert status == INVALID
        assert np.array_equal(q, np.float32(arguments["q"]), equal_nan=True)
        assert not p.any()


def test_quaternions_of_any_accepted_length_are_normalised(small, large):
    """A length is accepted if its square keeps its digits and does not overflow."""
    omega, unit = [0.1, -0.2, 30.0], np.array([0.6, 0.5, -0.4, 0.3])
    unit /= np.linalg.norm(unit)
    for control in (small, large):
        kind = np.finfo(control.type)
        shortest, longest = (float(x) ** 0.5 for x in (kind.tiny / kind.eps, kind.max))
        for length in (1.01 * shortest, 1, 0.99 * longest):
            status, q, _ = control.started(PARAMETERS, unit * length, omega)
            assert status == OK
            assert np.abs(q - unit).max() <= 2 * kind.eps
        for length in (0.99 * shortest, kind.eps * shortest, 1.01 * longest):
            assert control.started(PARAMETERS, unit * length, omega)[0] == INVALID
            control.begin(PARAMETERS, unit * length, TOP.p0, 1e-3, status=INVALID)


def test_a_start_without_momenta_is_singular(tmp_path):
    """For H = (x y)^2/2 the velocity is x^2 y, and at x = 0 no momentum has a velocity but 0."""
    x, y = sp.symbols("x y", real=True)
    system = gs.System((x,), (y,), (), (x * y) ** 2 / 2, name="needle")
    control = Control(generate(Spec("IMS").with_profile("control"), system=system).source, tmp_path)
    status, _, p = control.started({}, [0.5], [2.0])
    assert (status, *p) == (OK, 8.0)
    assert control.velocities({}, [0.5], [8.0]) == [2.0]
    assert control.started({}, [0.0], [2.0])[0] == SINGULAR


def test_parameters_outside_of_their_domains_change_nothing(small):
    expected = small.begin(PARAMETERS, TOP.q0, TOP.p0, 1e-3).run(6)[0]
    first = small.begin(PARAMETERS, TOP.q0, TOP.p0, 1e-3).run(3)[0]
    for wrong in ({"I1": 0.0}, {"mgl": np.inf}):
        assert small.set_parameters(small.w, small.parameters(PARAMETERS | wrong)) == INVALID
    assert np.array_equal([*first, *small.run(3)[0][1:]], expected)


def test_an_impulse_and_other_parameters_between_steps(small):
    """A change holds from the next step on, as in a run that starts there, up to rounding."""
    q, p = small.begin(PARAMETERS, TOP.q0, TOP.p0, 1e-3).run(20)
    kick = np.array([-q[-1][1], q[-1][0], q[-1][3], -q[-1][2]]) * 1e-3  # on f = 0: a torque
    heavier = PARAMETERS | {"mgl": 2 * PARAMETERS["mgl"]}
    small.p += kick
    small.set_parameters(small.w, small.parameters(heavier))
    q_on, p_on = small.run(20)
    q_new, p_new = small.begin(heavier, q[-1], p[-1] + kick, 1e-3).run(20)
    eps = np.finfo(np.float32).eps
    assert abs(q_on - q_new).max() <= 50 * eps
    assert abs(p_on - p_new).max() <= 50 * eps * abs(p_new).max()
    assert abs(q_on[-1] - Control.run(small.begin(PARAMETERS, q[-1], p[-1], 1e-3), 20)[0][-1]
               ).max() > 1e-4


def test_time_is_rounded_once(small):
    """start + n h agrees with exact fractions, up to 2^53 steps: 285,000 years at 1 kHz."""
    steps = small.ffi.cast("int64_t *", small.begin(PARAMETERS, TOP.q0, TOP.p0, 1e-3).memory)
    h, worst = Fraction(float(np.float32(1e-3))), 0
    for n in (1, 2**24 + 1, 2**31 + 7, 5 * 10**12 + 3, 2**53 - 1, 2**53):
        steps[0] = n
        t = small.time(small.w)
        worst = max(worst, abs(Fraction(t) - n * h) / Fraction(float(np.spacing(np.float32(t)))))
    assert worst <= Fraction(501, 1000)


# ---------------------------------------------------------------- choices


def test_python_says_that_it_needs_the_full_profile():
    """Files of profile control make no stepper for runs, ensembles and all else."""
    source = made(SMALL)
    with pytest.raises(InputError, match=r"'control'.*--profile full"):
        Stepper(source.name, source.files())


def test_a_point_at_rest_at_the_origin_starts(tmp_path):
    """x'' = u starts from x = x' = 0, where neither position nor velocity has a scale."""
    x, y, u = sp.symbols("x y u", real=True)
    cart = gs.System((x,), (y,), (u,), y**2 / 2, name="cart", forces=(u,), inputs=(u,))
    control = Control(generate(Spec("EMS").with_profile("control"), system=cart).source, tmp_path)
    q, p = control.begin({"u": 3.0}, [0.0], [0.0], 0.1).run(3)
    for step in range(1, 4):
        assert q[step] == pytest.approx(3 * (0.1 * step)**2 / 2, rel=1e-14)
        assert p[step] == pytest.approx(3 * 0.1 * step, rel=1e-14)


# ---------------------------------------------------------------- programs


def test_example_of_a_control_loop(gyrospark, tmp_path):
    """The commands of the example's README run: the satellite is turned, in few sweeps."""
    folder = ROOT / "examples" / "control_c"
    for name in ("main.c", "satellite.toml"):
        shutil.copy(folder / name, tmp_path)
    lines = re.findall(r"^    gyrospark (generate .*)\n    cc (.*) && \./satellite$",
                       (folder / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert f" *   gyrospark {lines[0][0]}\n *   cc {lines[0][1]} && ./satellite\n" in (
        folder / "main.c").read_text(encoding="utf-8")
    assert gyrospark(*lines[0][0].split()).code == 0  # in the folder of the test
    process = call([*compiler(MAIN), *STRICT, *lines[0][1].split()[1:]], cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    output = call([tmp_path / "satellite"], cwd=tmp_path).stdout.splitlines()
    angles = [float(x) for x in re.findall(r"([0-9.e+-]+) degrees", "\n".join(output))]
    assert len(angles) == 7
    assert angles == sorted(angles, reverse=True)
    assert angles[0] > 70
    assert angles[-1] < 1e-9  # a number near 0 has all its digits on a float too
    assert re.search(r"\b[3-8] iterations .*\b[0-9]{3,4} bytes", output[-1])


@pytest.mark.slow  # a bus with a wheel is derived for two seconds
def test_a_body_with_the_momentum_of_a_wheel_turns_as_with_the_wheel(tmp_path):
    """The gyrostat of the examples turns like a bus with a wheel that a motor accelerates."""
    spin, rate, torque, dt = (0.02, -0.03, 0.05), 40.0, 0.1, 0.01
    build = gs.Multibody("wheel_on_bus", gravity=(0, 0, 0))
    bus = build.body("bus", mass=50, inertia=(12, 10, 3), quaternion=(0.8, 0.6, 0, 0),
                     angular_velocity=spin)
    build.rotor("wheel", bus, mass=1, inertia=(0.02, 0.01), axis_on_body=(0, 0, 1), rate=rate)
    build.motor("motor", "wheel_bearing", torque=torque)
    model = build.model()
    wheel = gs.stepper("G-L", 2, system=model).integrate(  # it turns by 0.1 rad a step
        model, dt=dt / 4, steps=200)
    gyrostat = gs.load_model(ROOT / "examples" / "control_c" / "gyrostat.toml")
    control = Control(generate(Spec("G-L", 2).with_profile("control"),
                               system=gyrostat.system).source, tmp_path)
    values = {"I1": 12.01, "I2": 10.01, "I3": 3.0, "gamma": 25 / 3,  # and the wheel's, across it
              "u1": 0.0, "u2": 0.0, "u3": torque, "h1": 0.0, "h2": 0.0, "h3": 0.0}
    status, q, p = control.started(values, (0.8, 0.6, 0, 0), spin)
    assert status == OK
    control.begin(values, q, p, dt)
    for k in range(50):
        values["h3"] = 0.02 * (rate + spin[2]) + torque * (k + 0.5) * dt  # in the middle of a step
        assert control.set_parameters(control.w, control.parameters(values)) == OK
        assert control.step() == OK
    np.testing.assert_allclose(control.q, wheel.q[-1, :4], rtol=0, atol=1e-9)
    assert abs(control.q - wheel.q[0, :4]).max() > 0.005


# ---------------------------------------------------------------- other machines

ARM = "arm-none-eabi-gcc"
CORTEX_M4 = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
#: With ``-icount shift=0`` an instruction takes a nanosecond; the board's clock has 25 MHz.
INSTRUCTIONS_A_TICK = 40
STEPS = 300


def needed(*programs):
    """Skip the test, with the reason, where a program is not installed."""
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")


def program(source, folder, command, *more):
    """Compile tests/data/control_top.c with a stepper; return what it says here."""
    write(source.files(), folder)
    shutil.copy(DATA / "control_top.c", folder)
    said_by([*command, "-std=c11", "-ffp-contract=off", f"-DNAME={source.name}",
             f"-D{source.name.upper()}_WORK=", f"-DSTEPS={STEPS}",
             f"-DREAL={json.loads(source.manifest)['real']}", "control_top.c",
             f"{source.name}.c", *more], folder)


def here(source, folder):
    program(source, folder, [*compiler(MAIN), "-O2"], "-lm", "-o", "here")
    return said_by([folder / "here"], folder).splitlines()


def test_same_bits_on_a_cortex_m4(tmp_path):
    """2-G-L in float, at -Os, runs on the emulated processor in little text, memory and time.

    Instructions are counted by the processor's own timer, on a clock that QEMU drives by them.
    """
    needed(ARM, "arm-none-eabi-size", "qemu-system-arm")
    board = DATA / "cortex_m4"
    expected = here(made(SMALL), tmp_path)
    start = said_by([ARM, *CORTEX_M4, "-print-file-name=rdimon-crt0.o"], tmp_path).strip()
    program(made(SMALL), tmp_path, [ARM, *CORTEX_M4, "-Os"], "--specs=rdimon.specs",
            "-nostartfiles", "-T", str(board / "mps2_an386.ld"), str(board / "start.c"), start,
            "-lm", "-o", "top.elf")
    lines = said_by(["qemu-system-arm", "-M", "mps2-an386", "-kernel", "top.elf", "-display",
                     "none", "-monitor", "none", "-serial", "none", "-semihosting", "-icount",
                     "shift=0"], tmp_path).splitlines()
    assert lines[:-1] == expected[:-1]
    sweeps, ticks, ticks_max, memory = map(int, re.findall(r"\d+", lines[-1]))
    assert sweeps == int(expected[-1].split()[0])
    assert memory <= 2048
    assert 500 * sweeps < ticks * INSTRUCTIONS_A_TICK < 5000 * sweeps
    assert ticks_max * INSTRUCTIONS_A_TICK < 25_000
    said_by([ARM, *CORTEX_M4, "-std=c11", "-Os", "-c", f"{SMALL.name}.c"], tmp_path)
    text = said_by(["arm-none-eabi-size", f"{SMALL.name}.o"], tmp_path).splitlines()[1].split()
    assert int(text[0]) <= 12 * 1024
    assert text[1:3] == ["0", "0"]  # neither data nor bss


# ---------------------------------------------------------------- derivatives


def check_derivatives(control, full, parameters, q, p):
    """Compare tangents and adjoint of both profiles.

    The end of the step and the factors of J are rounded in another way: some ulp of the largest
    entry of a column, or, for γ, on which a step hardly depends, of a state per parameter. The
    error of p by rounding g is 4/Δt times as large in EMS (see test_step_reference.py).
    """
    control.begin(parameters, q, p, 1e-3).run(9)
    q, p = control.q.copy(), control.p.copy()
    assert control.step() == OK
    time = control.time(control.w) - 1e-3
    binding = full._derivative_binding()
    x = np.zeros(binding.module.unknowns, control.type)
    control.keep(control.w, control.options(0.0, 50), control.pointer(x))
    memory = control.ffi.new("char[]", control.derivative_size())
    parameter_array = binding.module.parameters(parameters, time)
    normals = np.vstack(binding.constraint_derivatives(parameter_array, q, p))
    dz = np.eye(binding.rows) - np.linalg.pinv(normals) @ normals
    dz = np.ascontiguousarray(dz, control.type)
    ends, z_bar = np.zeros((2 * full.n, binding.rows), control.type), np.zeros(
        binding.rows, control.type)
    w = np.linspace(1, 2, 2 * full.n).astype(control.type)
    timed = {control.manifest.system.time: time} if control.manifest.system.time else {}
    step = control.parameters(parameters | timed), 1e-3, *map(control.pointer, (q, p, x))
    none, empty = control.ffi.NULL, binding.module.new(0)
    assert control.tangent(*step, binding.rows, control.pointer(dz), control.pointer(ends), none,
                           memory) == OK
    assert control.adjoint(*step, control.pointer(w), none, control.pointer(z_bar), memory) == OK
    _, expected = binding.tangent(parameter_array, 1e-3, q, p, x, dz, empty)
    _, cotangent = binding.adjoint(parameter_array, 1e-3, q, p, x, w, empty)
    size, state = abs(expected).max(0), max(abs(control.q).max(), abs(control.p).max())
    values = [parameters[name] for name in binding.module.parameter_names]
    size[2 * full.n : -2] = np.maximum(size[2 * full.n : -2], state / np.abs(values))
    units = np.full((2 * full.n, 1), 16.0)
    if not control.manifest.scheme.keeps_momentum_constraint:
        units[full.n:] += 4 / 1e-3
    allowed = np.finfo(control.type).eps * units * size
    assert size.max() > 0.5
    assert (abs(ends - expected) <= allowed).all()
    assert (abs(dz.T @ (z_bar - cotangent)) <= w @ allowed).all()
