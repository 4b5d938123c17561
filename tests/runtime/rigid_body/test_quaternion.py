"""Quaternions, Euler angles and means of moments: identities of the paper, SciPy's conventions."""

from __future__ import annotations

import itertools
import math
import warnings

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import gyrospark as gs
from gyrospark.core.errors import InputError
from gyrospark.runtime.rigid_body.euler_angles import euler_angles
from gyrospark.runtime.rigid_body.quaternion import (
    angular_velocity,
    attitude_quaternion,
    axis,
    euler_quaternion,
    left_matrix,
    momentum,
    rotation_matrix,
    state_of_body,
    to_rotation,
)

INERTIA = (0.002, 0.0013, 0.0008)
RANDOM = np.random.default_rng(20)
Q = RANDOM.normal(size=(3, 5, 4))
UNIT = Q / np.linalg.norm(Q, axis=-1, keepdims=True)
angles = st.floats(-10, 10)


def elementary(axis_number, angle):
    """Return the rotation about one axis by its matrix."""
    c, s = np.cos(angle), np.sin(angle)
    if axis_number == 1:
        return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def test_left_matrix_identities():
    L = left_matrix(Q)
    square = np.sum(Q**2, axis=-1)[..., None, None]
    assert L.shape == (3, 5, 3, 4)
    np.testing.assert_allclose(np.einsum("...ij,...j", L, Q), 0, atol=1e-15)
    np.testing.assert_allclose(L @ L.swapaxes(-1, -2), square * np.eye(3), atol=1e-14)
    outer = Q[..., :, None] * Q[..., None, :]
    np.testing.assert_allclose(L.swapaxes(-1, -2) @ L, square * np.eye(4) - outer, atol=1e-14)
    np.testing.assert_array_equal(L[1, 2], left_matrix(Q[1, 2].tolist()))


def test_rotation_matrix_is_a_rotation():
    R = rotation_matrix(UNIT)
    assert R.shape == (3, 5, 3, 3)
    np.testing.assert_allclose(R @ R.swapaxes(-1, -2), np.broadcast_to(np.eye(3), R.shape),
                               atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(R), 1)
    np.testing.assert_array_equal(rotation_matrix(-UNIT), R)
    np.testing.assert_array_equal(axis(UNIT), R[..., :, 2])
    np.testing.assert_array_equal(R[1, 2], rotation_matrix(UNIT[1, 2]))
    np.testing.assert_allclose(to_rotation(UNIT[0]).as_matrix(), R[0], atol=1e-15)


def test_left_matrix_gives_the_angular_velocity_of_the_rotation_matrix():
    """Ṙ = R Ω̂ with Ω = 2 L(q) q̇, equations (5) to (7), agrees with a central difference."""
    q, h = UNIT[0, 0], 1e-6
    rate = np.cross(Q[0, 1, 1:], Q[0, 2, 1:])
    q_dot = left_matrix(q).T @ rate / 2
    R_dot = (rotation_matrix(q + h * q_dot) - rotation_matrix(q - h * q_dot)) / (2 * h)
    hat = rotation_matrix(q).T @ R_dot
    np.testing.assert_allclose([hat[2, 1], hat[0, 2], hat[1, 0]], rate, rtol=1e-9)


def test_momentum_and_angular_velocity_are_inverse():
    omega = RANDOM.normal(size=(3, 5, 3)) * 100
    p = momentum(UNIT, omega, INERTIA)
    assert p.shape == (3, 5, 4)
    np.testing.assert_allclose(angular_velocity(UNIT, p, INERTIA), omega, rtol=1e-12)
    np.testing.assert_allclose(np.einsum("...i,...i", UNIT, p), 0, atol=1e-15)
    of_one_attitude = momentum(UNIT[0, 0], omega, INERTIA)
    np.testing.assert_allclose(of_one_attitude[0, 0], p[0, 0], rtol=1e-14)
    assert of_one_attitude.shape == (3, 5, 4)


@given(angles, angles, angles)
def test_euler_quaternion_turns_about_z_x_z(phi, theta, psi):
    q = euler_quaternion(phi, theta, psi)
    assert q.shape == (4,)
    assert euler_quaternion(np.full(6, phi), theta, np.zeros((2, 1))).shape == (2, 6, 4)
    assert np.linalg.norm(q) == pytest.approx(1, abs=1e-15)
    expected = elementary(3, phi) @ elementary(1, theta) @ elementary(3, psi)
    np.testing.assert_allclose(rotation_matrix(q), expected, atol=2e-15)


@given(angles, angles, angles)
def test_rotation_round_trip(phi, theta, psi):
    q = euler_quaternion(phi, theta, psi)
    back = attitude_quaternion(to_rotation(q))
    assert abs(back @ q) == pytest.approx(1, abs=1e-15)
    from_scipy = attitude_quaternion(Rotation.from_euler("ZXZ", [phi, theta, psi]))
    assert abs(from_scipy @ q) == pytest.approx(1, abs=1e-14)


def test_state_from_rotation():
    omega = [1.0, -2.0, 3.0]
    rotation = Rotation.from_euler("ZXZ", [0.1, 0.2, 0.3])
    q, p = state_of_body(rotation, omega, INERTIA)
    np.testing.assert_allclose(rotation_matrix(q), rotation.as_matrix(), atol=1e-15)
    np.testing.assert_allclose(angular_velocity(q, p, INERTIA), omega)
    space = rotation.as_matrix() @ (np.array(INERTIA) * omega)
    np.testing.assert_allclose(rotation_matrix(q) @ (left_matrix(q) @ p / 2), space)
    stack = Rotation.from_rotvec(RANDOM.normal(size=(5, 3)))
    for rotations, rates in ((stack, omega), (stack[0], np.ones((5, 3)))):
        q, p = state_of_body(rotations, rates, INERTIA)
        assert q.shape == p.shape == (5, 4)
        assert q.flags.writeable


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: left_matrix([1, 0, 0]), r"\(3,\).*length 4"),
        (lambda: rotation_matrix(1.0), r"\(\)"),
        (lambda: axis("north"), "real numbers"),
        (lambda: momentum([1, 0, 0, 0], [1, 2], INERTIA), "angular velocity"),
        (lambda: momentum([1, 0, 0, 0], [1, 2, 3], (1, 2, 0)), "I3 = 0.0"),
        (lambda: angular_velocity([1, 0, 0, 0], [1, 2, 3], INERTIA), "momentum p"),
        (lambda: to_rotation([0, 0, 0, 0]), "no attitude"),
        (lambda: to_rotation([np.nan, 0, 0, 0]), "no attitude"),
        (lambda: attitude_quaternion([1, 0, 0]), r"scipy\.spatial\.transform\.Rotation"),
    ],
)
def test_refusals(call, words):
    with pytest.raises(InputError, match=words):
        call()


SEQUENCES = [letters for axes in itertools.product("xyz", repeat=3)
             if axes[0] != axes[1] != axes[2]
             for letters in ("".join(axes), "".join(axes).upper())]
EPS = float(np.finfo(float).eps)


def random_quaternions(count):
    q = np.random.default_rng(4).normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def as_scipy(q):
    return Rotation.from_quat(q[:, [1, 2, 3, 0]])


def test_all_sequences_are_scipys():
    assert len(SEQUENCES) == 24
    q = random_quaternions(500)
    for sequence in SEQUENCES:
        angles, expected = euler_angles(q, sequence), as_scipy(q).as_euler(sequence)
        apart = np.abs((angles - expected + np.pi) % (2 * np.pi) - np.pi)
        near = np.abs(np.sin(angles[:, 1] if sequence[0] == sequence[2]
                             else angles[:, 1] + np.pi / 2))
        assert (apart.max(axis=1) * near < 64 * EPS).all(), sequence  # angles lose digits at locks
        assert np.abs(angles[:, [0, 2]]).max() <= np.pi


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_locked_angles_give_the_rotation_back(sequence):
    ends = (0.0, np.pi) if sequence[0] == sequence[2] else (np.pi / 2, -np.pi / 2)
    for end in ends:
        rotation = Rotation.from_euler(sequence, [[0.3, end, 0.5], [2.5, end, -3.0]])
        locked = euler_angles(rotation.as_quat()[:, [3, 0, 1, 2]], sequence)
        assert (locked[:, 2] == 0).all()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the lock
            assert np.abs(locked - rotation.as_euler(sequence)).max() < 1e-7
        assert (Rotation.from_euler(sequence, locked) * rotation.inv()).magnitude().max() < 1e-7


def test_the_papers_angles():
    """Equation (81) has q of φ, θ, ψ, which are the angles of q."""
    angles = np.random.default_rng(5).uniform((-3, 0.1, -3), (3, 3, 3), size=(50, 3))
    assert np.abs(euler_angles(euler_quaternion(*angles.T), "ZXZ") - angles).max() < 200 * EPS


@pytest.mark.parametrize("sequence", ["zy", "zzx", "xyY", "", "abc", None, 3, ["z", "y", "x"]])
def test_what_is_no_sequence(sequence):
    with pytest.raises(gs.InputError, match="three axes"):
        euler_angles([1, 0, 0, 0], sequence)


RULES = ["m", "h", "mt", "ht"]

triples = st.tuples(*[st.floats(1e-9, 1e9)] * 3)


def test_formulas_of_the_paper():
    for inertia in ([1, 2, 6], np.array([1, 2, 6]), np.array([1.0, 2.0, 6.0]), (1, 2, 6)):
        assert gs.gamma(inertia) == 3
        assert type(gs.gamma(inertia)) is float
    assert gs.gamma((1, 2, 6), "h") == pytest.approx(3 / (1 + 1 / 2 + 1 / 6))
    assert gs.gamma((1, 2, 6), "mt") == 4
    assert gs.gamma((1, 2, 6), "ht") == pytest.approx(3)


@given(triples)
def test_axis_order_does_not_matter(inertia):
    for rule in RULES:
        values = [gs.gamma(order, rule) for order in itertools.permutations(inertia)]
        assert values == pytest.approx([values[0]] * 6, rel=1e-15)


@given(triples)
def test_means_lie_between_the_moments_and_harmonic_below_arithmetic(inertia):
    smallest, middle, largest = sorted(inertia)
    margin = 1 + 1e-15
    assert smallest <= gs.gamma(inertia, "h") * margin
    assert gs.gamma(inertia, "h") <= gs.gamma(inertia) * margin
    assert gs.gamma(inertia) <= largest * margin
    assert middle <= gs.gamma(inertia, "ht") * margin
    assert gs.gamma(inertia, "ht") <= gs.gamma(inertia, "mt") * margin
    assert gs.gamma(inertia, "h") <= gs.gamma(inertia, "ht") * margin


@pytest.mark.parametrize("inertia", [
    (3e-310, 2e-310, 1.5e-310), (1e-320, 1e-320, 1e-320), (1e-310, 1.0, 1.0),
    (1.5e308, 1e308, 9e307)])
@pytest.mark.parametrize("rule", ["m", "h", "mt", "ht"])
def test_means_at_the_ends_of_doubles(inertia, rule):
    """1/I and sums of I are no doubles there; mpmath has any exponent."""
    with mp.workdps(40):
        moments = sorted(map(mp.mpf, inertia))[-2 if rule.endswith("t") else -3:]
        mean = (mp.fsum(moments) / len(moments) if rule[0] == "m"
                else len(moments) / mp.fsum(1 / x for x in moments))
    # half a unit of the smallest double, beside three roundings
    assert abs(gs.gamma(inertia, rule) - mean) <= 3 * 2.0**-52 * mean + mp.mpf(2) ** -1074


@given(triples)
def test_tilde_is_the_limit_of_a_vanishing_moment(inertia):
    smallest, middle, largest = sorted(inertia)
    expected = (gs.gamma((smallest, middle, largest), "mt"),
                gs.gamma((smallest, middle, largest), "ht"))
    for flat in ([0, middle, largest], [middle, 0, largest], [middle, largest, 0]):
        assert (gs.gamma(flat, "mt"), gs.gamma(flat, "ht")) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize(("inertia", "words"), [
    ((1, 2), "has 2 moments"), ((1, 2, 3, 4), "has 4 moments"), ((), "has 0 moments"),
    ((1, -2, 3), "I2 = -2.0"), ((1, 2, math.nan), "I3 = nan"), ((math.inf, 2, 3), "I1 = inf"),
    ((0, 1, 0), "I1 = 0.0"), (("1", "2", "3"), "three"), ((1, None, 3), "three"),
    ((1, 2j, 3), "three"), (3, "three"), ((1, 2, 10**400), "three")])
def test_refusals_of_moments(rule, inertia, words):
    with pytest.raises(InputError, match=words):
        gs.gamma(inertia, rule)
    if rule in ("m", "h"):  # a vanishing moment needs the tilde
        with pytest.raises(InputError, match=r"I3 = 0\.0 kg m²"):
            gs.gamma((1, 2, 0), rule)
    with pytest.raises(InputError, match=r"'fast'.*ht"):
        gs.gamma((1, 2, 2), "fast")
