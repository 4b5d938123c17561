"""Co-moving frames: symmetries are derived and proved, motions turned back, invariants stay.

A stepper with ``frame="symmetries"`` integrates H − Σ ω_i J_i and turns back. The second ways here:
closed forms, the same motion without a frame by a method of more stages, mpmath. Steady motions
q(t) = e^{ωt} q(0) have no error in the frame of their rates, whatever the method and the step.
"""

from __future__ import annotations

import json
import re
from fractions import Fraction
from functools import cache

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.generator.symmetry.rotations import rotate_coordinates, rotation_of
from python_newton import integrate
from steady_motions import STEADY

TOP = gs.problems.fast_top()
CONE = gs.problems.regular_precession()
EPS = np.finfo(float).eps


def with_gamma(problem):
    return problem.parameters | {"gamma": gs.gamma(problem.inertia)}


@cache
def framed(scheme="G-L", stages=2, **more):
    return gs.stepper(scheme, stages, frame="symmetries", **more)


@cache
def model():
    """Two symmetric tops on each other; g turns with the vertical."""
    return gs.models.double_top()


@cache
def tops():
    """The model's stepper with a frame, and a start on the constraints."""
    top_model = model()
    numbers = {name: float(x) for name, x in top_model.parameters.items()}
    numbers |= {name: gs.gamma(x) for name, x in top_model.bodies.items()}
    numbers |= {"a_I2": numbers["a_I1"], "b_I2": numbers["b_I1"]}
    step = gs.stepper("G-L", 2, system=top_model, frame="symmetries")
    return step, numbers, step.project(top_model.q0, top_model.p0, parameters=numbers)


def height(q):
    """Return R33, the height of the body's axis."""
    return q[:, 0] ** 2 - q[:, 1] ** 2 - q[:, 2] ** 2 + q[:, 3] ** 2


def names_of(system):
    """Return name → condition of the symmetries that are derived for a system."""
    generated = generate(Spec.from_arguments("G-L", 1).with_frame("symmetries"), system=system)
    return {s["name"]: s["conditions"] for s in json.loads(generated.source.manifest)["frame"][
        "symmetries"]}


def plane_system(H, q, p, *parameters, g=(), **more):
    return gs.System(q, p, parameters, H, g, name="plane", **more)


X, Y, Z, W, PX, PY, PZ, PW = sp.symbols("x y z w p_x p_y p_z p_w", real=True)
A1, A2, B1, B2, B3, B4, K, AXIS = sp.symbols("a1 a2 b1 b2 b3 b4 k axis", real=True)
OMEGA = sp.Symbol("omega_space", real=True)
KINETIC = (PX**2 + PY**2) / 2


def pair_system(*g):
    """Return two points of mass 1 in a plane, on springs to the origin."""
    return plane_system(KINETIC + (PZ**2 + PW**2) / 2 + A1 * (X**2 + Y**2) + A2 * (Z**2 + W**2),
                        (X, Y, Z, W), (PX, PY, PZ, PW), A1, A2, g=g)


def test_a_top_has_its_own_axis_and_the_vertical():
    body, space = framed().symmetries
    assert (body.name, body.condition, space.name, space.condition) == (
        "omega_body", "I1 = I2", "omega_space", "")
    q, p = TOP.q0, TOP.p0
    p0, p1, p2, p3 = p
    q0, q1, q2, q3 = q
    assert body.momentum(q, p) == pytest.approx((p3 * q0 - p0 * q3 + p1 * q2 - p2 * q1) / 2)
    assert space.momentum(q, p) == pytest.approx((p3 * q0 - p0 * q3 - p1 * q2 + p2 * q1) / 2)
    assert body.J == "-p0*q3/2 + p1*q2/2 - p2*q1/2 + p3*q0/2"


def test_a_free_body_turns_about_any_axis_of_space():
    generated = generate(Spec.from_arguments("G-L", 1, "gamma",
                                             "free_body").with_frame("symmetries"))
    symmetries = json.loads(generated.source.manifest)["frame"]["symmetries"]
    assert [s["name"] for s in symmetries] == ["omega_body", "omega_space_1", "omega_space_2",
                                               "omega_space_3"]
    assert [s["conditions"] for s in symmetries] == [["I1 = I2"], [], [], []]


def test_a_bodys_own_axis_costs_one_addition():
    """u₃(a u₃ − ω/2) has the derivative (2 a u₃ − ω/2) u₃′: the vertical alone costs terms."""
    def operations(*, frame):
        spec = Spec.from_arguments("G-L", 2, "gamma", system="heavy_top")
        generated = generate(spec.with_frame("symmetries") if frame else spec)
        counts = re.findall(r"/\* H_[pq].* w.* (\d+) add, (\d+) mul", generated.source.source)
        return np.array(counts, dtype=int)

    velocity, force = operations(frame=True) - operations(frame=False)
    assert velocity.tolist() == [4 + 1, 4]
    assert force.tolist() == [4, 4]


@pytest.mark.parametrize(("system", "expected"), [
    (plane_system((PX**2 + PY**2) / 2 - K / sp.sqrt(X**2 + Y**2), (X, Y), (PX, PY), K),
     {"omega_space": []}),
    (plane_system((PX**2 + PY**2) / 2 + A1 * X**2 + A2 * Y**2, (X, Y), (PX, PY), A1, A2),
     {"omega_space": ["a1 = a2"]}),
    (plane_system((PX**2 + PY**2 + PZ**2) / 2 + A1 * X**2 + A2 * Y**2 + K * Z**2, (X, Y, Z),
                  (PX, PY, PZ), A1, A2, K, g=(X**2 + Y**2 + Z**2 - 1,)),
     {"omega_space": ["a1 = a2"]}),
    # names of coordinates do not matter
    (plane_system((PX**2 + PY**2) / 2 - K / sp.sqrt(AXIS**2 + Y**2), (AXIS, Y), (PX, PY), K),
     {"omega_space": []}),
    (plane_system(KINETIC + A1 * X**2 + A2 * Y**2 + K * X * Y + B1 * X**4 + B2 * Y**4
                  + B3 * X**2 * Y**2, (X, Y), (PX, PY), A1, A2, B1, B2, B3, K),
     {"omega_space": ["k = 0", "a1 = a2", "2*b1 = b3", "b1 = b2"]}),
    (pair_system(), {"omega_space": [], "omega_1": []}),
    # a name that is in use
    (plane_system(KINETIC + OMEGA * (X**2 + Y**2), (X, Y), (PX, PY), OMEGA), {"omega_1": []}),
], ids=["Kepler", "oscillator", "Neumann", "axis", "quartic", "two points", "name"])
def test_symmetries_of_any_system(system, expected):
    assert names_of(system) == expected


@pytest.mark.parametrize("system", [
    plane_system((PX**2 + PY**2) / 2 + X**4 + 2 * Y**4, (X, Y), (PX, PY)),
    plane_system((PX**2 + PY**2) / 2 + X * Y, (X, Y), (PX, PY)),  # a squeeze, no rotation
    plane_system((PX**2 + PY**2) / 2 + X, (X, Y), (PX, PY)),  # a shift
    plane_system((PX**2 + PY**2) / 2 + X**2 + Y**2, (X, Y), (PX, PY), forces=(0, X)),
    plane_system(KINETIC + sp.sqrt(1 + X**2 + A1 * Y**2), (X, Y), (PX, PY), A1),
    plane_system(KINETIC + A1 * A2 * X**2 + Y**2, (X, Y), (PX, PY), A1, A2),
    plane_system(KINETIC + A1 * X**2 + A2 * Y**2 + K * X * Y + B1 * X**4 + B2 * Y**4  # 5 conditions
                 + B3 * X**2 * Y**2 + B4 * X**3 * Y, (X, Y), (PX, PY), A1, A2, B1, B2, B3, B4, K),
    pair_system(X - Z),
    pair_system(*(sp.exp(X**2 + Y**2) * e for e in (X - Z, Y - W))),  # no polynomials
], ids=["none", "squeeze", "shift", "forces", "root", "product", "quartic", "one row", "exp"])
def test_a_system_without_a_rotation_is_refused(system):
    with pytest.raises(gs.InputError, match="co-moving"):
        names_of(system)


@pytest.mark.parametrize(("scheme", "stages"), [
    ("G-L", 2), pytest.param("EMS", None, marks=pytest.mark.slow)])
def test_regular_precession_has_no_error(scheme, stages):
    """In the frame of both rates q~ stands still, for any method and any step."""
    cone, step, numbers = CONE, framed(scheme, stages), with_gamma(CONE)
    rates = rates_of(step, cone.q0, cone.p0, numbers)
    run = step.integrate(cone.q0, cone.p0, dt=1e-2, steps=2000, parameters=numbers | rates)
    assert np.ptp(height(run.q)) < 1e-13
    assert abs(run.energy_error()).max() <= 32 * EPS * abs(run.energies).max()
    exact = cone.exact.attitude(run.t[-1])
    # Rates are least squares of rounded numbers: the angle of 20 s of them is off by 20 ω ε.
    bound = 20 * sum(map(abs, rates.values())) * 8 * EPS
    assert min(abs(run.q[-1] - exact).max(), abs(run.q[-1] + exact).max()) < bound


@pytest.mark.parametrize(("scheme", "stages", "ratio", "times", "steps"), [
    ("G-L", 2, 0.5, 10, 2000), pytest.param("EMS", None, 0.5, 10, 500, marks=pytest.mark.slow),
    *(pytest.param(*scheme, ratio, times, 10**5, marks=pytest.mark.slow)
      for scheme in [("G-L", 2), ("LIIIA-B", 3), ("IMS", None), ("EMS", None)]
      for ratio in (0.5, 1.5) for times in (1, 2, 5, 10))])
def test_regular_precession_keeps_its_height_at_ten_times_the_papers_step(
        scheme, stages, ratio, times, steps):
    """Sweeps diverge there, and the rounding that Newton leaves would add up."""
    cone, dt = gs.problems.regular_precession(radius_ratio=ratio), {0.5: 5e-3, 1.5: 1e-2}[ratio]
    step, numbers = framed(scheme, stages), with_gamma(cone)
    run = step.integrate(cone.q0, cone.p0, dt=times * dt, steps=steps, every=max(1, steps // 2000),
                         parameters=numbers | gs.tune(
                             step, cone, dt=times * dt, steps=steps, frame="auto").parameters)
    assert np.ptp(height(run.q)) < (8 * EPS if times == 10 else 1e-13)  # of turning back


def test_turning_back_costs_no_digit_after_a_million_seconds():
    """A sleeping top stands still in its frame; 1.25e8 rad are turned back as mpmath does it.

    Of 10⁹ steps and rad the angle itself is held against 60 digits in ``test_engine``. Steps of one
    stage are exact here; those of more leave some of the rounding of their 31,000 rad.
    """
    step, spin = framed("EMS", None), 124.9
    with mp.workdps(50):  # 2 I₃ Ω has 106 bits
        p = [0, 0, 0, 2 * mp.mpf(TOP.inertia[2]) * mp.mpf(spin)]
        run = step.integrate([1.0, 0, 0, 0], p, dt=250, steps=4000, every=4000,
                             parameters=with_gamma(TOP) | {"omega_body": spin})
        half, q = mp.mpf(spin) * 10**6 / 2, [mp.mpf(x) for x in run.q[-1]]
        error = max(abs(q[0] - mp.cos(half)), abs(q[3] - mp.sin(half)))
    assert error <= 2 * step.binding.epsilon


@pytest.mark.slow  # a stepper of one system
def test_what_moves_by_less_than_rounding_moves():
    """A circle stands still in its frame, unless another coordinate moves at all."""
    system = gs.System((X, Y, Z), (PX, PY, PZ), (), (PX**2 + PY**2 + PZ**2) / 2
                       - 1 / sp.sqrt(X**2 + Y**2), name="lift")
    step = gs.stepper("G-L", 2, system=system, frame="symmetries")
    for lift in (0.0, 1e-18):
        start = gs.Start([0.7, 0, 0], [0, 0.7**-0.5, lift])
        run = step.integrate(start, dt=0.3, steps=1000, parameters=gs.tune(
            step, start, dt=0.3, frame="start").parameters)
        assert np.ptp(np.linalg.norm(run.q[:, :2], axis=1)) < (4 * EPS if lift == 0 else 1e-13)
        assert run.q[-1, 2] == pytest.approx(300 * lift, rel=1e-13)


def rates_of(step, q, p, numbers):
    """Return ω with H_p = Σ ω_i A_i q, by least squares; H_p from the residual of no step."""
    x = np.zeros(step.unknowns)
    if step.manifest.scheme.unknowns_are_state:
        x[: 2 * step.n] = [*q, *p]
    H_p = -step.residual(x, q, p, dt=1.0, parameters=numbers)[: step.n]
    moves = np.stack([s.A @ np.asarray(q, float) for s in step.symmetries], axis=1)
    rates = np.linalg.lstsq(moves, H_p, rcond=None)[0]
    return {s.name: float(w) for s, w in zip(step.symmetries, rates, strict=True)}


@pytest.mark.parametrize(("scheme", "stages", "order"), [("G-L", 2, 4), ("EMS", None, 2)])
def test_the_order_is_kept_and_the_error_is_smaller(scheme, stages, order):
    """With rates 0 a frame changes nothing: its steps equal steps without a frame."""
    numbers, plain = with_gamma(TOP), systems.stepper("heavy_top")
    run = {"dt": 1e-4, "steps": 1000, "every": 1000, "parameters": numbers}
    exact = plain.integrate(TOP.q0, TOP.p0, **run).q[-1]
    errors = [abs(framed(scheme, stages).integrate(
        TOP.q0, TOP.p0, dt=dt, steps=round(0.1 / dt),
        parameters=numbers | {"omega_body": w}).q[-1] - exact).max()
        for w in (0.0, 75.4) for dt in (4e-3, 2e-3)]
    for coarse, fine in (errors[:2], errors[2:]):
        assert 0.8 * 2**order < coarse / fine < 1.25 * 2**order
    assert errors[3] < errors[1] / 5
    if scheme == "G-L":
        runs = [step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=300, parameters=numbers)
                for step in (framed(), plain)]
        assert abs(runs[0].q - runs[1].q).max() < 1e-13
        assert abs(runs[0].multipliers - runs[1].multipliers).max() < 1e-9


def test_a_run_in_a_frame_is_one_autonomous_map():
    """S_(ωkh) Φ^k = (S_(ωh) Φ)^k: it is the same where a run is cut and its frame begins anew."""
    step, rates = framed(), {"omega_body": 75.4, "omega_space": -3.0}
    numbers = with_gamma(TOP) | rates
    unsplit = step.integrate(TOP.q0, TOP.p0, dt=2e-3, steps=100, parameters=numbers)
    first = step.integrate(TOP.q0, TOP.p0, dt=2e-3, steps=37, parameters=numbers)
    second = step.integrate(first.q[-1], first.p[-1], dt=2e-3, steps=63, parameters=numbers)
    assert abs(second.q[-1] - unsplit.q[-1]).max() < 1e-12
    reversed_run = step.integrate(unsplit.q[-1], unsplit.p[-1], dt=-2e-3, steps=100,
                                  parameters=numbers)
    assert abs(reversed_run.q[-1] - TOP.q0).max() < 1e-12


def test_momentum_maps_are_kept():
    step, numbers = framed(), with_gamma(TOP) | {"omega_body": 75.4, "omega_space": 5.0}
    run = step.integrate(TOP.q0, TOP.p0, dt=5e-3, steps=1000, parameters=numbers)
    for symmetry in step.symmetries:
        J = symmetry.momentum(run.q, run.p)
        assert np.ptp(J) < 1e-13 * abs(J).max()


@pytest.mark.slow  # derives a double top in its frame
def test_multipliers_turn_with_the_constraints():
    """Multipliers of joints are in axes of space: with ω_space each node must turn them."""
    step, numbers, (q, p) = tops()
    assert [(s.name, s.condition) for s in step.symmetries] == [
        ("omega_a", "a_I1 = a_I2"), ("omega_b", "b_I1 = b_I2"), ("omega_space", "")]
    without_frame = step.integrate(q, p, dt=1e-3, steps=40, parameters=numbers, every=4)
    in_frame = step.integrate(q, p, dt=1e-3, steps=40, every=4, parameters=numbers | {
        "omega_a": 39.0, "omega_b": 70.0, "omega_space": 20.0})
    assert abs(in_frame.q - without_frame.q).max() < 1e-7
    assert abs(in_frame.multipliers - without_frame.multipliers).max() < 1e-3 * abs(
        without_frame.multipliers).max()
    for solver in ("newton", "python"):
        newton_run = integrate(step, q, p, dt=1e-3, steps=8, every=4, solver=solver,
                               parameters=numbers | {"omega_space": 20.0, "omega_a": 39.0})
        swept_run = step.integrate(q, p, dt=1e-3, steps=8, every=4,
                                   parameters=numbers | {"omega_space": 20.0, "omega_a": 39.0})
        assert abs(newton_run.q - swept_run.q).max() < 1e-13
        assert abs(newton_run.multipliers - swept_run.multipliers).max() < 1e-8


@pytest.mark.parametrize("rate", [0.0, 2.0])
def test_multipliers_of_two_points_on_a_circle(rate):
    """The points circle together at ω² = a1 + a2; g = (x − z, 2 (y − w)) does not turn as r does.

    At rate ω the motion stands still in the frame, at rate 0 its nodes have errors of the order.
    """
    step = framed(system=pair_system(X - Z, 2 * (Y - W)))
    run = step.integrate([1.0, 0.0, 1.0, 0.0], [0.0, 2.0, 0.0, 2.0], dt=0.05, steps=20,
                         parameters={"a1": 3.0, "a2": 1.0, "omega_space": rate})
    angle = 2 * (run.t[:-1, None] + 0.05 * np.array([0, 0.5, 1]))
    # x″ = −ω² x = −2 a1 x − λ1, and y″ = −2 a1 y − 2 λ2
    exact = -2 * np.stack([np.cos(angle), np.sin(angle) / 2], axis=-1)
    assert abs(run.multipliers - exact).max() < (64 * EPS / 0.05 if rate else 1e-2)


def test_an_impulse_and_a_new_rate_are_in_the_callers_coordinates():
    step, numbers = framed(), with_gamma(TOP) | {"omega_body": 75.4, "omega_space": 1.0}
    motion = step.start(TOP.q0, TOP.p0, dt=2e-3, parameters=numbers)
    motion.advance(20)
    motion.parameters = numbers | {"omega_body": 60.0, "omega_space": -2.0}
    kick = np.array([0.0, 0.0, 0.0, 1e-3])
    kicked = step.project(motion.q, motion.p + kick, parameters=numbers)
    motion._run.p[:] = kicked[1]  # as a caller in C does
    motion.advance(20)
    fresh = step.integrate(*kicked, dt=2e-3, steps=20, parameters=motion.parameters)
    assert abs(fresh.q[-1] - motion.q).max() < 1e-12
    assert abs(fresh.p[-1] - motion.p).max() < 1e-12 * abs(TOP.p0).max()
    assert motion.report.energy_error_max < 1e-6


def test_a_model_file_may_ask_for_frames(tmp_path):
    text = """
        name = "quartic"
        [system]
        coordinates = ["x", "y"]
        momenta = ["px", "py"]
        hamiltonian = "(px**2 + py**2)/2 + (x**2 + y**2)**2/4"
        [start]
        q = [1, 0]
        p = [0, 1]"""
    file = tmp_path / "moving.toml"
    for frame, names in (("", []), ('frame = "symmetries"', ["omega_space"])):
        file.write_text(frame + text, encoding="utf-8")
        generated = generate(Spec.from_arguments("G-L", 1, None, str(file)))
        symmetries = json.loads(generated.source.manifest).get("frame", {}).get("symmetries", ())
        assert [symmetry["name"] for symmetry in symmetries] == names
    file.write_text('frame = "moving"' + text, encoding="utf-8")
    with pytest.raises(gs.InputError, match="symmetries"):
        gs.load_model(file)


def test_generate_writes_steppers_with_frames(gyrospark, tmp_path):
    choice = ["generate", "--scheme", "G-L", "--stages", "1", "--frame", "symmetries"]
    answer = gyrospark(*choice, "--no-compile", "--out", tmp_path)
    assert "heavy_top_gl1_gamma_frame: order 2" in answer.stdout
    header = (tmp_path / "heavy_top_gl1_gamma_frame.h").read_text(encoding="utf-8")
    assert "omega_body: J = -p0*q3/2 + p1*q2/2 - p2*q1/2 + p3*q0/2, where I1 = I2" in header


def test_a_frame_along_what_is_no_symmetry_is_refused_with_its_condition():
    step, numbers = framed(), with_gamma(TOP)
    asymmetric = numbers | {"I1": np.nextafter(numbers["I1"], 1), "omega_body": 75.4}
    expected = r"omega_body = 75\.4.*I1 = I2.*I1 = 0\.002"
    with pytest.raises(gs.InputError, match=expected):
        step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=1, parameters=asymmetric)
    with pytest.raises(gs.InputError, match="I1 = I2"):
        step.step(TOP.q0, TOP.p0, dt=1e-3, parameters=asymmetric)
    with pytest.raises(gs.InputError, match=r"Trajectory 1: .*I1 = I2"):
        step.integrate_ensemble([TOP.q0] * 2, [TOP.p0] * 2, dt=1e-3, steps=1,
                                parameters=[numbers, asymmetric])
    with pytest.raises(gs.InputError, match="I1 = I2"):
        gs.sweep(TOP, {"omega_body": [0.0, 1.0], "I1": [2e-3, 3e-3]}, scheme="G-L", stages=2,
                 frame="symmetries", dt=1e-3, steps=1)
    at_rest = step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=1,
                             parameters=asymmetric | {"omega_body": 0})
    assert at_rest.report.steps == 1


def test_a_rate_of_no_symmetry_is_unknown():
    with pytest.raises(gs.InputError, match=r"'omega_bdy'.*omega_body"):
        framed().integrate(TOP.q0, TOP.p0, dt=1e-3, steps=1,
                           parameters=with_gamma(TOP) | {"omega_bdy": 1.0})
    with pytest.raises(gs.InputError, match="'omega_body' is unknown"):
        gs.stepper("G-L", 2).integrate(TOP.q0, TOP.p0, dt=1e-3, steps=1,
                                       parameters=with_gamma(TOP) | {"omega_body": 1.0})
    with pytest.raises(gs.InputError, match="frame 'moving'"):
        gs.stepper("G-L", 2, frame="moving")


@pytest.mark.parametrize(("rate", "is_one"), [
    (1, True), (Fraction(1, 2), True), (Fraction(3, 8), True), (6, True), (Fraction(1, 3), False),
    (Fraction(1, 6), False), (Fraction(2, 5), False)])
def test_a_rotation_turns_at_a_rate_that_binary_holds(rate, is_one):
    """A rounded rate would make the angle wrong by its rounding times a million steps."""
    rate = Fraction(rate)
    rotation = rotation_of({(0, 1): -rate, (1, 0): rate})
    assert (rotation is not None) == is_one
    if rotation is not None:
        assert list(rotation.blocks) == [rate]
        x, y, cosine, sine = sp.symbols("x y cosine sine")
        assert rotate_coordinates([x, y], [rotation], [sp.S.One], {rate: cosine}, {rate: sine}) == [
            cosine * x - sine * y, cosine * y + sine * x]


@cache
def steady_stepper(name, scheme="G-L", stages=2):
    steady = STEADY[name]()
    return gs.stepper(scheme, stages, system=steady.system, frame="symmetries", **steady.rep)


@pytest.mark.slow  # systems that are derived for seconds; test_frames.py has a quick one
@pytest.mark.parametrize("name", STEADY)
def test_a_steady_motion_has_no_error(name):
    """The frame is the start's own least squares; without a frame the error is of the order."""
    steady, step = STEADY[name](), steady_stepper(name)
    start = {"dt": steady.dt, "steps": 200, "parameters": steady.parameters}
    plain = step.integrate(steady.q, steady.p, **start)
    run = step.integrate(steady.q, steady.p, **start | {"parameters": {
        **steady.parameters, **gs.tune(step, steady.q, steady.p, dt=steady.dt, frame="start",
                                       parameters=steady.parameters).parameters}})
    bound = allowed(run)
    assert steady.error(run) < bound < 1e-3 * steady.error(plain)
    # T and V, which are rounded, may be ten times H, their sum
    assert abs(run.energy_error()).max() <= 64 * EPS * abs(run.energies).max()
    errors = [steady.error(step.integrate(
        steady.q, steady.p, dt=steady.dt / k, steps=10 * k, parameters=steady.parameters))
        for k in (4, 8)]
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.1)  # it is a motion of the system


def allowed(run):
    """Return the error of an angle whose rates are rounded: some t ω ε."""
    rates = sum(abs(run.parameters[s]) for s in run.parameters if s.startswith("omega"))
    return 16 * EPS * (1 + run.t[-1] * rates)


@pytest.mark.slow  # derives the satellite
def test_the_satellites_frames_are_its_own_axis_and_the_orbits_where_it_is_a_ball():
    """The gradient is about the vertical, n l_y about the normal: both stay for a ball only."""
    axial, normal = steady_stepper("satellite").symmetries
    assert (axial.name, axial.condition) == ("omega_body", "a_I1 = a_I2")
    assert (normal.name, normal.condition) == ("omega_space", "a_I1 = a_I3 and a_I1 = a_I2")
