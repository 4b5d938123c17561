"""Euler angles against SciPy's, and turned back into the rotation."""

from __future__ import annotations

import itertools
import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gyrospark as gs
from gyrospark.runtime.rigid_body.euler_angles import euler_angles
from gyrospark.runtime.rigid_body.quaternion import euler_quaternion

SEQUENCES = [letters for found in itertools.product("xyz", repeat=3)
             if found[0] != found[1] != found[2]
             for letters in ("".join(found), "".join(found).upper())]
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
        ours, theirs = euler_angles(q, sequence), as_scipy(q).as_euler(sequence)
        apart = np.abs((ours - theirs + np.pi) % (2 * np.pi) - np.pi)
        near = np.abs(np.sin(ours[:, 1] if sequence[0] == sequence[2] else ours[:, 1] + np.pi / 2))
        assert (apart.max(axis=1) * near < 64 * EPS).all(), sequence  # angles lose digits at locks
        assert np.abs(ours[:, [0, 2]]).max() <= np.pi


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_locked_angles_give_the_rotation_back(sequence):
    ends = (0.0, np.pi) if sequence[0] == sequence[2] else (np.pi / 2, -np.pi / 2)
    for end in ends:
        there = Rotation.from_euler(sequence, [[0.3, end, 0.5], [2.5, end, -3.0]])
        found = euler_angles(there.as_quat()[:, [3, 0, 1, 2]], sequence)
        assert (found[:, 2] == 0).all()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the lock
            assert np.abs(found - there.as_euler(sequence)).max() < 1e-7
        assert (Rotation.from_euler(sequence, found) * there.inv()).magnitude().max() < 1e-7


def test_the_papers_angles():
    """(81) makes q of φ, θ, ψ: the other way round."""
    angles = np.random.default_rng(5).uniform((-3, 0.1, -3), (3, 3, 3), size=(50, 3))
    assert np.abs(euler_angles(euler_quaternion(*angles.T), "ZXZ") - angles).max() < 200 * EPS


@pytest.mark.parametrize("sequence", ["zy", "zzx", "xyY", "", "abc", None, 3, ["z", "y", "x"]])
def test_what_is_no_sequence(sequence):
    with pytest.raises(gs.InputError, match="three axes"):
        euler_angles([1, 0, 0, 0], sequence)
