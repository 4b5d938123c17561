"""The problems and their exact motions, against the paper, Euler's equations and DOP853."""

from __future__ import annotations

import dataclasses
import itertools
import math
import pickle

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import gyrospark as gs
from gyrospark.core.errors import InputError, InputWarning
from gyrospark.core.registry import PROBLEMS
from gyrospark.runtime.rigid_body.exact import FreeRotation, SteadyRotation
from gyrospark.runtime.rigid_body.problems import (
    Problem,
    cone_mass,
    fast_top,
    free_body,
    regular_precession,
)
from gyrospark.runtime.rigid_body.quaternion import (
    angular_velocity,
    axis,
    left_matrix,
    rotation_matrix,
)

ASYMMETRIC = [(0.002, 0.0013, 0.0008), (5.0, 3.0, 2.5), (1.0, 0.6, 0.59)]
ORDERS = list(itertools.permutations(range(3)))
ATTITUDE = tuple(np.array((0.5, 0.1, -0.7, 0.3)) / math.sqrt(0.84))


def derivative(function, t, h, unity=1.0):
    """Return df/dt by the eighth-order central difference; ``unity`` has the type of numbers."""
    weights = {1: 4 * unity / 5, 2: -unity / 5, 3: 4 * unity / 105, 4: -unity / 280}
    return sum(w * (function(t + n * h) - function(t - n * h)) for n, w in weights.items()) / h


def integrate_free_body(problem, times):
    """Return Ω and q of Euler's equations, by DOP853, independent of the closed form."""
    I1, I2, I3 = problem.inertia

    def rates(_, state):
        q0, q1, q2, q3, x, y, z = state.tolist()
        return [
            (-q1 * x - q2 * y - q3 * z) / 2,
            (q0 * x - q3 * y + q2 * z) / 2,
            (q3 * x + q0 * y - q1 * z) / 2,
            (-q2 * x + q1 * y + q0 * z) / 2,
            (I2 - I3) / I1 * y * z,
            (I3 - I1) / I2 * z * x,
            (I1 - I2) / I3 * x * y,
        ]

    omega0 = angular_velocity(problem.q0, problem.p0, problem.inertia)
    solution = solve_ivp(rates, (0, times[-1]), np.concatenate([problem.q0, omega0]),
                         method="DOP853", rtol=1e-13, atol=1e-14, t_eval=times)
    return solution.y[4:].T, solution.y[:4].T


def in_space(problem, times):
    """Return the angular momentum in space axes, shape (N, 3)."""
    l = np.array(problem.inertia) * problem.exact.angular_velocity(times)  # noqa: E741
    return np.einsum("nij,nj->ni", rotation_matrix(problem.exact.attitude(times)), l)


@pytest.mark.parametrize("name", PROBLEMS)
def test_every_problem(name):
    problem = PROBLEMS[name].make()
    assert problem.name == name
    assert problem.system == "heavy_top"
    assert problem.description.endswith(".")
    assert list(problem.parameters) == ["I1", "I2", "I3", "mgl"]
    assert tuple(problem.parameters.values())[:3] == problem.inertia
    assert all(type(x) is float for x in problem.parameters.values())
    assert abs(np.linalg.norm(problem.q0) - 1) < 3e-16
    assert abs(problem.q0 @ problem.p0) <= 1e-16 * np.linalg.norm(problem.p0)
    for state in (problem.q0, problem.p0):
        assert state.shape == (4,)
        with pytest.raises(ValueError, match="read-only"):
            state[0] = 0.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        problem.name = "other"


@pytest.mark.parametrize("name", ["regular-precession", "free-body"])
def test_exact_motion_starts_at_the_problem(name):
    problem, digits = PROBLEMS[name].make(), mpmath.mp.dps
    np.testing.assert_allclose(problem.exact.attitude(0.0), problem.q0, atol=2e-16)
    omega = angular_velocity(problem.q0, problem.p0, problem.inertia)
    np.testing.assert_allclose(problem.exact.angular_velocity(0.0), omega, rtol=1e-14, atol=1e-12)
    for times in (0.3, [0.3], [0.3, 0.1], [[0.3], [0.1]]):
        shape = np.shape(times)
        assert problem.exact.attitude(times).shape == (*shape, 4)
        assert problem.exact.angular_velocity(times).shape == (*shape, 3)
        assert problem.exact.axis(times).shape == (*shape, 3)
    assert problem.exact.attitude([]).shape == (0, 4)
    assert mpmath.mp.dps == digits  # nobody's precision is changed
    with pytest.raises(InputError, match="times"):
        problem.exact.attitude([0.0, math.nan])
    for time in ("soon", 1j, [[0.0], [0.0, 1.0]]):
        with pytest.raises(gs.InputError, match="t "):
            problem.exact.attitude(time)


# The fast top


def test_fast_top_is_the_papers():
    top = fast_top()
    assert top.exact is None
    assert top.parameters == {"I1": 0.002, "I2": 0.002, "I3": 0.0008,
                              "mgl": pytest.approx(0.3924, rel=1e-15)}
    np.testing.assert_allclose(top.q0, [math.cos(math.pi / 12), math.sin(math.pi / 12), 0, 0])
    np.testing.assert_allclose(
        angular_velocity(top.q0, top.p0, top.inertia), [0, 0, 40 * math.pi], atol=1e-13
    )
    np.testing.assert_allclose(axis(top.q0), [0, -0.5, math.sqrt(3) / 2], atol=1e-15)


# Regular precession


def test_regular_precession_is_table_6():
    top = regular_precession()
    I1, I2, I3 = top.inertia
    assert top.parameters["mgl"] / (9.81 * 0.075) == pytest.approx(888.264, abs=5e-4)
    assert I1 == I2 == pytest.approx(8.5 * I3)
    spin = top.parameters["mgl"] / (I3 * 30) + (I1 - I3) / I3 * 30 * 0.5
    np.testing.assert_allclose(
        angular_velocity(top.q0, top.p0, top.inertia), [0, 30 * math.sqrt(3) / 2, spin + 15],
        atol=1e-11,
    )


def test_radius_ratio_of_table_7():
    I1, _, I3 = regular_precession(1.5).inertia
    assert abs(I1 / I3 - 1.39) < 5e-3


def test_physical_cone_moves_alike_with_another_energy():
    mass = cone_mass(2700.0, 0.05, 0.1)
    assert mass == pytest.approx(2700 * math.pi * 0.05**2 * 0.1 / 3)
    paper, cone = regular_precession(), regular_precession(mass=mass)
    np.testing.assert_allclose(cone.p0 * 888.2643960980 / mass, paper.p0, rtol=1e-10)
    np.testing.assert_allclose(cone.exact.attitude(0.4), paper.exact.attitude(0.4), atol=1e-12)
    assert cone.parameters["mgl"] == pytest.approx(mass * 9.81 * 0.075)


@settings(max_examples=30)
@given(
    ratio=st.floats(0.3, 3), rate=st.floats(2, 50), sign=st.sampled_from([1, -1]),
    gravity=st.floats(0, 20), t=st.floats(-2, 2),
)
def test_regular_precession_obeys_the_equations_of_motion(ratio, rate, sign, gravity, t):
    """q̇ = ½ L(q)ᵀ Ω, and d/dt (R J Ω) = l e × (−mg ẑ) = mgl (−y, x, 0)."""
    top = regular_precession(ratio, rate=sign * rate, gravity=gravity)
    omega, q = top.exact.angular_velocity(t), top.exact.attitude(t)
    h = 0.03 / np.linalg.norm(omega)
    turned = 2 * left_matrix(q) @ derivative(top.exact.attitude, t, h)
    np.testing.assert_allclose(turned, omega, atol=1e-10 * np.linalg.norm(omega))
    momentum = in_space(top, np.array([t]))[0]
    change = derivative(lambda time: in_space(top, np.array([time]))[0], t, h)
    x, y, z = top.exact.axis(t)
    torque = top.parameters["mgl"] * np.array([-y, x, 0])
    scale = np.linalg.norm(momentum) * np.linalg.norm(omega)
    np.testing.assert_allclose(change, torque, atol=1e-10 * scale)
    np.testing.assert_allclose(axis(q), [x, y, z], atol=1e-14)
    assert z == pytest.approx(0.5)
    assert x == pytest.approx(math.sin(math.pi / 3) * math.sin(sign * rate * t), abs=1e-14)


# The free body


def check_against_integration(problem):
    times = np.linspace(0.0, 4.0, 4)
    omega, q = integrate_free_body(problem, times)
    size = np.linalg.norm(omega[0])
    np.testing.assert_allclose(problem.exact.angular_velocity(times), omega, atol=3e-11 * size)
    np.testing.assert_allclose(problem.exact.attitude(times), q, atol=3e-11)


#: About the largest moment, about the smallest, and near the middle one; each with every order.
SPINS = [(8, -2, 3), (-1, -2, -9), (0, 5, 0.1)]
FREE = [*(pytest.param([ASYMMETRIC[body][axis] for axis in order], [spin[axis] for axis in order],
                       marks=[] if (i + body + k) % 3 == 0 and i < 3 else pytest.mark.slow)
          for i, order in enumerate(ORDERS) for body in range(3) for k, spin in enumerate(SPINS)),
        *(((3.0, 2.0, 1.0), tuple(np.multiply(signs, [(9, 1, 2), (2, 1, 9)][i % 2])))
          for i, signs in enumerate(itertools.product((1, -1), repeat=3))),
        *((inertia, omega) for inertia in (
            (1, 1, 2), (1, 2, 1), (2, 1, 1), (2, 2, 1), (1, 1, 1 + 2**-50))
          for omega in ((3, -4, 5), (-1, 1e-9, -6)))]
STEADY = [((3, 3, 3), (1, -2, 3)), ((3, 2, 1), (4, 0, 0)), ((3, 2, 1), (0, -4, 0)),
          ((3, 2, 1), (0, 0, 4)), ((3, 3, 1), (3, 4, 0)), ((3, 2, 2), (0, 3, -4)),
          ((3, 2, 1), (0, 0, 0))]


@pytest.mark.parametrize(("inertia", "omega"), [*FREE, *STEADY])
def test_free_body_in_every_axis_order_and_regime(inertia, omega):
    problem = free_body(inertia, omega, ATTITUDE)
    steady = (inertia, omega) in STEADY
    assert isinstance(problem.exact, SteadyRotation if steady else FreeRotation)
    check_against_integration(problem)
    if steady:
        np.testing.assert_array_equal(problem.exact.angular_velocity([0.0, 2.0]), [omega] * 2)


@pytest.mark.parametrize(("order", "signs"), [
    (order, ((-1) ** i, (-1) ** (i // 2))) for i, order in enumerate(ORDERS)])
def test_free_body_on_the_separatrix(order, signs):
    """I = (9, 5, 4), Ω = (±1, y, ±3) has |l|² = 2T I_2 exactly and ends about the middle axis."""
    omega = (signs[0], 0.5, 3 * signs[1])
    problem = free_body([(9, 5, 4)[axis] for axis in order], [omega[axis] for axis in order])
    check_against_integration(problem)
    late = problem.exact.angular_velocity(1e4)
    expected = [abs(late[order.index(axis)]) for axis in range(3)]
    np.testing.assert_allclose(expected, [0, math.sqrt((9 + 5 / 4 + 36) / 5), 0], atol=1e-14)


#: Of three points on the axes: no moment exceeds the sum of the others.
moments = st.tuples(*[st.floats(0.1, 10)] * 3).map(lambda x: tuple(sum(x) - y for y in x))
# Not so small that the energy underflows.
speeds = st.floats(-20, 20).map(lambda w: w if abs(w) > 1e-100 else 0.0)


@settings(max_examples=5)
@given(moments, st.tuples(speeds, speeds, speeds))
def test_free_body_conserves_energy_and_angular_momentum(inertia, omega):
    problem = free_body(inertia, omega, ATTITUDE)
    I, times = np.array(problem.inertia), np.array([0.0, -0.4, 1.3, 1e3])  # noqa: E741
    rates = problem.exact.angular_velocity(times)
    energy = rates**2 @ I
    np.testing.assert_allclose(energy, energy[0], rtol=4e-15)
    space = in_space(problem, times)
    np.testing.assert_allclose(space, space[[0] * 4], atol=1e-14 * np.linalg.norm(space[0]))
    norms = np.linalg.norm(problem.exact.attitude(times), axis=-1)
    np.testing.assert_allclose(norms, 1, atol=3e-16)
    np.testing.assert_allclose(
        problem.exact.axis(times), axis(problem.exact.attitude(times)), atol=1e-15
    )


@pytest.mark.parametrize("t", [0.7, 250])
@pytest.mark.parametrize(("inertia", "omega"), [
    ((0.002, 0.0013, 0.0008), (30.0, -40.0, 100.0)), ((0.0013, 0.0008, 0.002), (-3.0, 4.0, 10.0)),
    ((3.0, 2.0, 1.0), (1.0, 0.2, -1.7320508075688772)),  # 1 − m = 2e-16
    ((5.0, 9.0, 4.0), (0.5, -1.0, 3.0))])  # m = 1
def test_free_body_solves_eulers_equations_to_28_digits(inertia, omega, t):
    """J Ω̇ = JΩ × Ω and q̇ = ½ L(q)ᵀ Ω, the derivatives by differences in 40 digits."""
    exact = free_body(inertia, omega, ATTITUDE).exact
    mp = exact._mp
    x, y, z = omega_t = exact.precise_angular_velocity(mp.mpf(t))
    q0, q1, q2, q3 = exact.precise_attitude(mp.mpf(t))
    speed = mp.sqrt(sum(w**2 for w in omega_t))
    h = mp.mpf(10) ** -5 / speed

    def slopes(precise):
        def component(i):
            return lambda time: precise(time)[i]

        return [derivative(component(i), mp.mpf(t), h, mp.mpf(1)) for i in range(len(precise(0)))]

    I1, I2, I3 = (mp.mpf(moment) for moment in inertia)
    accelerations = [(I2 - I3) / I1 * y * z, (I3 - I1) / I2 * z * x, (I1 - I2) / I3 * x * y]
    for slope, formula in zip(slopes(exact.precise_angular_velocity), accelerations, strict=True):
        assert abs(slope - formula) < 1e-28 * speed**2
    turns = [-q1 * x - q2 * y - q3 * z, q0 * x - q3 * y + q2 * z,
             q3 * x + q0 * y - q1 * z, -q2 * x + q1 * y + q0 * z]
    for slope, formula in zip(slopes(exact.precise_attitude), turns, strict=True):
        assert abs(slope - formula / 2) < 1e-28 * speed


def test_attitude_is_continuous():
    exact = free_body((3.0, 2.0, 1.0), (-1.0, 0.3, -2.0)).exact
    q = exact.attitude(np.linspace(0.0, 12.0, 150))
    assert np.linalg.norm(np.diff(q, axis=0), axis=1).max() < 0.15


def test_free_body_takes_any_length_of_attitude():
    for length in (2, 1e-200, 1e200):
        with pytest.warns(InputWarning, match="length .* 1"):
            q0 = free_body(attitude=(length, 0, 0, -length)).q0
        np.testing.assert_allclose(q0, [math.sqrt(0.5), 0, 0, -math.sqrt(0.5)], rtol=2e-16)


@pytest.mark.parametrize("problem", [free_body(), free_body(angular_velocity=(0, 0, 1)),
                                     regular_precession()])
def test_problems_can_be_pickled(problem):
    again = pickle.loads(pickle.dumps(problem))
    np.testing.assert_array_equal(again.p0, problem.p0)
    np.testing.assert_array_equal(again.exact.attitude(0.7), problem.exact.attitude(0.7))


# Refusals


@pytest.mark.parametrize(("call", "words"), [
    (lambda: regular_precession(0), "radius_ratio is 0.0"),
    (lambda: regular_precession(rate=0), "rate is 0"),
    (lambda: regular_precession(rate=math.inf), "rate.*inf"),
    (lambda: regular_precession(height=-1), "height is -1.0"),
    (lambda: regular_precession(density=0), "density is 0.0"),
    (lambda: regular_precession(mass=0), "mass is 0.0"),
    (lambda: regular_precession(mass=math.nan), "mass.*nan"),
    (lambda: regular_precession(gravity=math.nan), "gravity.*nan"),
    (lambda: regular_precession("half"), "'half'"),
    (lambda: cone_mass(1, 0, 1), "radius is 0.0"),
    (lambda: free_body((1, 2)), "has 2 moments"),
    (lambda: free_body((1, 2, 0)), "I3 = 0.0"),
    (lambda: free_body(angular_velocity=(1, 2)), "angular_velocity .* 3 finite numbers"),
    (lambda: free_body(angular_velocity=(1, 2, math.inf)), "3 finite numbers"),
    (lambda: free_body(angular_velocity="fast"), "3 numbers"),
    (lambda: free_body(attitude=(0, 0, 0, 0)), "zero"),
    (lambda: free_body(attitude=(1, 0, 0)), "4 finite numbers"),
    (lambda: Problem("x", {}, [1, 0], [0] * 4, (1, 1, 1)), "q0 .* 4 finite numbers"),
    (lambda: free_body([[2, 0.1, 0], [0.1, 2, 0], [0, 0, 3]]), "tensor.*Multibody"),
    (lambda: free_body(attitude=np.eye(4)), "attitude"),
    (lambda: Problem("x", {"I2": 3.0}, [1, 0, 0, 0], [0] * 4, (1, 2, 2)), "I2 = 3.0"),
    # the phase of an angle of 1e31 rad is not in 40 digits
    (lambda: free_body((1, 2, 1.5), (1, 2, 3)).exact.attitude([0.1, -1e31]), "1e[+]31"),
    (lambda: free_body((1, 2, 2), (3, 0, 0)).exact.attitude(1e31), "1e[+]31")])
def test_refusals(call, words):
    with pytest.raises(InputError, match=words):
        call()


# ---------------------------------------------------------------- gs.exact


def test_exact_motions_have_public_names():
    cone = gs.problems.regular_precession()
    motion = gs.exact.regular_precession(30.0, cone.exact.spin, np.pi / 3)
    assert np.array_equal(motion.axis([0.1, 0.2]), cone.exact.axis([0.1, 0.2]))
    for call, words in ((lambda: gs.exact.free_body((1, 1, 3), (1, 2, 3)), "inertia"),
                        (lambda: gs.exact.regular_precession("fast", 1, 1), "rate = 'fast'")):
        with pytest.raises(InputError, match=words):
            call()
    with pytest.raises(AttributeError):
        gs.exact.free_bodies  # noqa: B018
