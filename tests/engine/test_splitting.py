"""Compositions of exact flows: orders, bits, round-off, forces, failures, profile control."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import splitting_systems
from c_programs import Program
from gyrospark.core.errors import InputError, StepFailed
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.runtime.rigid_body.quaternion import rotation_matrix

TOP = gs.problems.fast_top()
SYMMETRIC = TOP.parameters | {"gamma": 1.0}
ASYMMETRIC = SYMMETRIC | {"I2": 1.3 * TOP.parameters["I1"]}
ORDERS = (2, 4, 6, 8, 10)


def end(step, start, parameters, t, steps, **more):
    run = step.integrate(*start, dt=t / steps, steps=steps, parameters=parameters, every=steps,
                         **more)
    return np.concatenate([run.q[-1], run.p[-1]]), run


def distance(step, start, parameters, t, steps, exact):
    return float(np.abs(end(step, start, parameters, t, steps)[0] - exact).max())


@pytest.fixture(scope="module")
def pair():
    """An asymmetric body and a point on a spring to a point of the body, in gravity."""
    model = gs.Multibody("pair", gravity=(0, 0, -1))
    a = model.body("a", mass=1, inertia=(1, 1.2, 0.7), angular_velocity=(0.5, 0.2, 1))
    b = model.point_mass("b", mass=2, position=(1.5, 0.2, 0.1), velocity=(0, 0.3, 0))
    k = model.parameter("k", 2.0, positive=True)
    reach = [x - y for x, y in zip(a.point((0.2, 0, 0)), b.point((0, 0, 0)), strict=True)]
    model.potential(k * sum(x**2 for x in reach) / 2)
    return model.model()


@pytest.mark.parametrize("parameters", [SYMMETRIC, ASYMMETRIC], ids=["symmetric", "asymmetric"])
@pytest.mark.parametrize(("order", "real"), [(4, "double"), *(  # 1e-12 of the shortest steps
    pytest.param(order, "float128", marks=pytest.mark.slow) for order in (4, 6, 8, 10))])
def test_order(order, real, parameters):
    exact = {name: Fraction(value) for name, value in parameters.items()}
    step = gs.stepper("splitting", order=order, real=real)
    start = step.project(TOP.q0, TOP.p0, parameters=exact)
    fine, _ = end(step, start, exact, Fraction(1, 50), 96)
    errors = [distance(step, start, exact, Fraction(1, 50), n, fine) for n in (6, 12)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.25)


@pytest.mark.slow  # G-L with five stages of two systems
def test_bodies_in_space_forces_and_drag_against_gauss_lobatto(pair):
    model = gs.Multibody("driven")
    top = model.top("t", mass=1, inertia=(1, 1, 0.7), centre=(0, 0, 0.3),
                    quaternion=(0.9, np.sqrt(0.19), 0, 0), angular_velocity=(0.5, 0.2, 9))
    c, u = model.parameter("c", 0.2), model.input("u", 0.3)
    model.torque(top, [-c * sp.Symbol(f"t_I{i}", positive=True) * w + u * top.rotation[2, 0]
                       for i, w in zip((1, 2, 3), top.angular_velocity, strict=True)])
    model.potential(0.3 * sp.cos(2 * model.time) * top.rotation[0, 2])
    for system_model in (pair, model.model()):
        start = system_model.q0, system_model.p0
        reference = gs.stepper("G-L", stages=5, system=system_model.system)
        exact, run = end(reference, start, system_model.parameters, 1.0, 400)
        for order, bound in ((4, 2e-6), (8, 1e-11)):
            step = gs.stepper("splitting", order=order, system=system_model.system)
            split_end, split_run = end(step, start, system_model.parameters, 1.0, 40)
            assert np.abs(split_end - exact).max() < bound
            assert split_run.report.work == pytest.approx(run.report.work, abs=20 * bound)
            assert split_run.report.energy_error_max < 20 * bound


@pytest.fixture(scope="module")
def turntable():
    """A body and a point on a spring in axes that turn at w, with drag of the body."""
    model = gs.Multibody("turntable", gravity=(0, 0, 0))
    a = model.body("a", mass=1, inertia=(1, 1.2, 0.7), position=(0.3, 0.2, -0.5),
                   velocity=(0.1, 0.4, 0), angular_velocity=(0.5, 0.2, 1))
    b = model.point_mass("b", mass=2, position=(1.5, 0.2, 0.1), velocity=(0, 0.3, 0))
    w = [model.parameter(f"w{i}", x) for i, x in enumerate((0.3, -0.2, 0.5))]
    c, k = model.parameter("c", 0.0), model.parameter("k", 2.0)
    model.potential(k * sum((x - y)**2 for x, y in zip(a.point((0.2, 0, 0)), b.x, strict=True)))
    model.torque(a, [-c * sp.Symbol(f"a_I{i}", positive=True) * x
                     for i, x in zip((1, 2, 3), a.angular_velocity, strict=True)])
    momentum = sp.Matrix(a.angular_momentum)
    for body in (a, b):
        momentum += sp.Matrix(body.x).cross(sp.Matrix(body.p_x))
    model.potential(-sp.Matrix(w).dot(momentum))
    return model.model()


def test_motion_in_rotating_axes_is_the_rotated_motion(turntable):
    """The motion of a body and of a point, each rotated by R, agrees with the motion at rest."""
    step = gs.stepper("splitting", order=4, system=turntable)
    start, values = (turntable.q0, turntable.p0), dict(turntable.parameters)
    at_rest = step.integrate(*start, dt=0.01, steps=100, parameters=values | dict.fromkeys(
        ("w0", "w1", "w2"), 0.0))
    turning = step.integrate(*start, dt=0.01, steps=100, parameters=values)
    w, t = np.array([values[f"w{i}"] for i in range(3)]), 1.0
    half = 0.5 * t * np.linalg.norm(w)
    R = rotation_matrix(np.array([np.cos(half), *(-np.sin(half) * w / np.linalg.norm(w))]))
    for name in ("a", "b"):
        rows = [turning.coordinates.index(f"{name}_{x}") for x in "xyz"]
        assert np.abs(turning.q[-1][rows] - R @ at_rest.q[-1][rows]).max() < 1e-13
        assert np.abs(turning.p[-1][rows] - R @ at_rest.p[-1][rows]).max() < 1e-13
    assert np.abs(turning.body("a").angular_momentum()[-1]
                  - R @ at_rest.body("a").angular_momentum()[-1]).max() < 1e-13


@pytest.mark.slow  # a stepper of one system
def test_a_bead_in_a_plane_that_turns():
    """The bead moves in closed form beside a top in axes at rest."""
    x, y, u, v, w = sp.symbols("x y u v w", real=True)
    top = gs.models.lagrange_top()
    bead = (u**2 + v**2 + x**2 + 4 * y**2) / 2 - w * (x * v - y * u)
    system = gs.System((*top.system.q, x, y), (*top.system.p, u, v), (*top.system.parameters, w),
                       top.system.H + bead, top.system.constraints, name="bead")
    start = np.append(top.q0, [1.0, 0.0]), np.append(top.p0, [0.0, 0.5])
    values = dict(top.parameters) | {"w": 0.4, "a_gamma": 1.0}
    run = gs.stepper("splitting", order=8, system=system).integrate(
        *start, dt=0.01, steps=200, parameters=values)
    slow, fast = np.linalg.eig([[0, 0.4, 1, 0], [-0.4, 0, 0, 1], [-1, 0, 0, 0.4], [0, -4, -0.4, 0]])
    exact = fast @ (np.exp(2 * slow) * np.linalg.solve(fast, [1.0, 0.0, 0.0, 0.5]))
    state = np.concatenate([run.q[-1, 4:], run.p[-1, 4:]])
    assert np.abs(state - exact).max() < 1e-12


def test_a_run_has_the_same_bits_in_pieces_in_ensembles_and_stored_seldom():
    step, count = gs.stepper("splitting", order=4), 40
    sets = [SYMMETRIC | {"mgl": 0.1 + 0.01 * i, "I2": SYMMETRIC["I1"] * (1 + (i % 3 == 1) * 0.2)}
            for i in range(count)]
    q, p = np.tile(TOP.q0, (count, 1)), np.tile(TOP.p0, (count, 1))
    dt = np.linspace(1e-3, 3e-3, count)
    ensemble = step.integrate_ensemble(q, p, dt=dt, steps=70, parameters=sets, every=7)
    for i in (0, 1, 33, 39):
        single = step.integrate(TOP.q0, TOP.p0, dt=dt[i], steps=70, parameters=sets[i])
        assert np.array_equal(ensemble.q[i], single.q[::7])
        assert np.array_equal(ensemble.p[i], single.p[::7])
        assert ensemble.members[i].report == single.report
        motion = step.start(TOP.q0, TOP.p0, dt=dt[i], parameters=sets[i])
        for steps in (1, 20, 49):
            motion.advance(steps)
        assert np.array_equal(motion.q, single.q[-1])
        assert np.array_equal(motion.p, single.p[-1])


def test_parameters_change_between_steps():
    step = gs.stepper("splitting", order=4)
    motion = step.start(TOP.q0, TOP.p0, dt=2e-3, parameters=SYMMETRIC)
    motion.advance(30)
    heavier = SYMMETRIC | {"mgl": 1.2 * SYMMETRIC["mgl"], "I2": 1.1 * SYMMETRIC["I1"]}
    motion.parameters = heavier
    fresh = step.integrate(motion.q, motion.p, dt=2e-3, steps=5, parameters=heavier)
    motion.advance(5)
    assert np.array_equal(motion.q, fresh.q[-1])
    assert np.array_equal(motion.p, fresh.p[-1])
    assert motion.report.energy_error_max < 1e-6


@pytest.mark.slow  # a long run: 20,000 steps of 32 tops
def test_round_off_does_not_drift():
    step = gs.stepper("splitting", order=10)
    count, rng = 32, np.random.default_rng(1)
    sets = [SYMMETRIC | {"mgl": SYMMETRIC["mgl"] * x} for x in rng.uniform(0.9, 1.1, count)]
    q, p = np.tile(TOP.q0, (count, 1)), np.tile(TOP.p0, (count, 1))
    runs = step.integrate_ensemble(q, p, dt=8e-3, steps=20_000, parameters=sets, every=20_000)
    error = np.array([run.energy()[-1] / run.energy()[0] - 1 for run in runs.members])
    assert np.sqrt(np.mean(error**2)) < 1e-13
    assert abs(error.mean()) < 4 * error.std() / np.sqrt(count)
    assert np.abs((runs.q**2).sum(axis=-1) - 1).max() < 1e-15


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_a_step_that_fails_keeps_what_was_before_it():
    step = gs.stepper("splitting", order=4)
    overflowing = SYMMETRIC | {"mgl": 1e306}
    with pytest.raises(StepFailed) as failed:
        step.integrate(TOP.q0, TOP.p0, dt=1e4, steps=50, parameters=overflowing)
    trajectory = failed.value.trajectory
    assert trajectory.report.steps == failed.value.step - 1
    assert np.isfinite(trajectory.q).all()
    q, p = np.tile(TOP.q0, (3, 1)), np.tile(TOP.p0, (3, 1))
    ensemble = step.integrate_ensemble(q, p, dt=[1e-3, 1e4, 1e-3], steps=50,
                                       parameters=[SYMMETRIC, overflowing, SYMMETRIC])
    assert list(ensemble.failures) == [1]
    assert ensemble.failures[1].step == failed.value.step
    single = step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=50, parameters=SYMMETRIC)
    assert np.array_equal(ensemble.q[2], single.q)


@pytest.mark.parametrize(("arguments", "words"), [
    ({"order": 7}, "order = 7"), ({}, "order"), ({"stages": 3, "order": 4}, "stages = 3"),
    ({"scheme": "G-L", "stages": 2, "order": 4}, "order = 4.*G-L"),
    ({"order": 6, "composition": "G4"}, "G4.*order"),
    ({"composition": "SABAG6"}, "SABAG6.*'heavy_top'"),  # I2 may differ from I1
])
def test_methods_that_are_no_splitting_are_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        gs.stepper(**{"scheme": "splitting"} | arguments)


def test_a_splitting_has_neither_a_residual_nor_solvers():
    step = gs.stepper("splitting", order=4)
    with pytest.raises(InputError, match="residual"):
        step.residual([], TOP.q0, TOP.p0, dt=1e-3, parameters=SYMMETRIC)
    with pytest.raises(InputError, match="solver = 'newton'"):
        step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=1, parameters=SYMMETRIC, solver="newton")


@pytest.mark.parametrize(("system", "choice", "words"), [
    ("driven", {"order": 4}, "order = 4.*drag"), ("drag", {"composition": "G4"}, "G4.*'drag'")])
def test_forces_bound_the_order(system, choice, words):
    with pytest.raises(InputError, match=words):
        gs.stepper("splitting", system=splitting_systems.SYSTEMS[system][0], **choice)


def with_drag(turntable, **moments):
    """Return the stepper of the turntable, which chooses its flows by the moments, start, values.
    """
    values = dict(turntable.parameters) | {"c": 0.2} | moments
    return gs.stepper("splitting", order=4, system=turntable), (turntable.q0, turntable.p0), values


def test_work_of_drag_has_the_order_of_the_motion(turntable):
    (step, start, values), errors = with_drag(turntable, a_I2=1.0), []
    for steps in (40, 80):
        run = step.integrate(*start, dt=1 / steps, steps=steps, parameters=values)
        errors.append(np.abs(run.energy_error()).max())
    assert errors[0] / errors[1] > 12
    motion = step.start(*start, dt=0.025, parameters=values)
    for _ in range(40):
        motion.advance(1)
        motion.parameters = dict(values)
    assert motion.report.work == pytest.approx(run.report.work, rel=1e-4)
    assert motion.report.energy_error_max < 2 * errors[0]


@pytest.mark.slow  # derivatives compiled for this
def test_derivatives_by_the_drag_of_a_body(turntable):
    """Without a spring, in axes at rest, |m| ∝ exp(−c t): d(|p|²/2)/dc = −t |p|²."""
    step, start, values = with_drag(turntable, k=0.0, w0=0.0, w1=0.0, w2=0.0)
    run = step.integrate(*start, dt=5e-3, steps=4, parameters=values,
                         tangents=gs.Tangents(start=None, parameters=["c"]))
    body, tangent = run.p[-1] * (np.arange(step.n) < 4), run.tangents.p[-1]
    adjoint = step.gradient(run, {"q": 0 * body, "p": body}, wrt=["c"]).vector()
    assert [*adjoint, *body @ tangent] == pytest.approx([-run.t[-1] * body @ body] * 2, rel=1e-13)


def test_means_of_the_report_are_below_maxima():
    step = gs.stepper("splitting", order=4)
    for steps in (5, 16, 32, 63, 100):
        report = step.integrate(TOP.q0, TOP.p0, dt=2e-3, steps=steps, parameters=SYMMETRIC).report
        assert 0 < report.energy_error_mean <= report.energy_error_max


def test_a_rotation_near_pi_between_kicks_is_warned_of():
    step = gs.stepper("splitting", order=4)
    with pytest.warns(gs.errors.InputWarning, match="rad a step"):
        step.integrate(TOP.q0, TOP.p0, dt=3e-2, steps=3, parameters=SYMMETRIC)


def begun(program, parameters, q0, p0, dt):
    """Begin a trajectory; return the status, the arguments of ``advance``, and arrays of the
    state."""
    q, p = np.array(q0, float), np.array(p0, float)
    arguments = program.new_work(), program.pointer(q), program.pointer(p)
    values = {name: float(x) for name, x in parameters.items()}
    limits = dict(zip(("tolerance", "max_iterations"), (0.0, 50), strict=True))
    status = program.begin(arguments[0], program.parameters(values),
                           program.ffi.new(f"{program.name}_options *", limits), dt, *arguments[1:])
    return status, arguments, q, p


@pytest.fixture(scope="module")
def control(tmp_path_factory):
    """A splitting of order 4 in profile control."""
    source = generate(Spec.from_arguments("splitting", order=4).with_profile("control")).source
    return Program(source, tmp_path_factory.mktemp("control"), "-Wshadow")


@pytest.mark.parametrize("parameters", [SYMMETRIC, ASYMMETRIC], ids=["symmetric", "asymmetric"])
def test_profile_control_takes_the_steps_of_the_full_profile(parameters, control):
    assert begun(control, parameters, TOP.q0, TOP.p0, 0.0)[0] == 6
    status, memory, q, p = begun(control, parameters, TOP.q0, TOP.p0, 2e-3)
    assert status == 0
    finite, p[1] = p[1], np.inf
    assert control.advance(*memory) == control.advance(*memory) == 3  # as often as it is tried
    p[1] = finite
    for _ in range(50):
        assert control.advance(*memory) == 0
    run = gs.stepper("splitting", order=4).integrate(TOP.q0, TOP.p0, dt=2e-3, steps=50,
                                                     parameters=parameters)
    assert np.abs(q - run.q[-1]).max() < 1e-14
    assert np.abs(p - run.p[-1]).max() < 1e-14


def test_profile_run_takes_the_steps_of_the_full_profile(turntable, tmp_path):
    """Runs at once and in pieces agree, for an asymmetric body with drag and its work."""
    step, start, values = with_drag(turntable)
    program = Program(generate(Spec.from_arguments("splitting", order=4).with_profile("run"),
                               model=turntable, system=turntable.system).source, tmp_path)
    expected, ends = step.integrate(*start, dt=5e-3, steps=40, parameters=values), []
    for pieces in ((40,), (1, 20, 19)):
        _, (work, *state), q, p = begun(program, values, *start, 5e-3)
        for steps in pieces:
            assert program.advance(work, steps, *state) == 0
        ends.append([*q, *p])
        assert np.abs(q - expected.q[-1]).max() < 1e-14
        assert np.abs(p - expected.p[-1]).max() < 1e-13
    assert ends[0] == ends[1]
    _, (work, *state), q, p = begun(program, values, *start, 5e-3)
    rows, work_rows, null = np.zeros((4, step.n)), np.zeros(4), program.ffi.NULL
    parameters = program.parameters({name: float(x) for name, x in values.items()})
    assert program.integrate(parameters, program.options(0.0), 5e-3, 40, 10, *state,
                             program.pointer(rows), null, null, program.pointer(work_rows),
                             program.ffi.new(f"{program.name}_report *"), work) == 0
    assert [*q, *p] == ends[0]
    assert np.abs(rows - expected.q[10::10]).max() < 1e-14
    assert np.abs(work_rows - expected.work[10::10]).max() < 1e-13


def test_members_of_an_ensemble_have_inputs_of_their_own():
    """Under a constant force in each step, steps of order 2 are the exact motion of a point."""
    build = gs.Multibody("pushed_point", gravity=(0, 0, 0))
    build.force(build.point_mass("b", mass=2), [build.input("u"), 0, 0])
    model, dt = build.model(), 0.25
    forces = np.array([[1.0, -2.0, 0.5], [0.0, 3.0, 1.0]])
    ensemble = gs.stepper("splitting", order=2, system=model).integrate_ensemble(
        gs.Start([model.q0] * 2, [model.p0] * 2, model.parameters), dt=dt, steps=3,
        inputs=forces[:, :, None])
    momenta = dt * np.cumsum(forces, axis=1)
    means = (momenta + np.column_stack([[0.0, 0.0], momenta[:, :-1]])) / 2
    assert np.array_equal(ensemble.p[:, 1:, 0], momenta)
    assert np.array_equal(ensemble.q[:, 1:, 0], dt * np.cumsum(means / 2, axis=1))
