"""Random trees of links in URDF and SDF: accelerations beside Pinocchio and each other."""

import math

import numpy as np
import pytest

import gyrospark as gs
from random_robots import random_tree, sdf_text, urdf_text
from robots import Motion

#: Rounding of a solve with mass matrices and constraints of a few bodies, whose condition is below
#: a thousand or so, and of numbers that files have in decimals.
CLOSE = 2**16 * np.finfo(float).eps


def start(links, rng):
    """Return angles and rates of the joints that follow no other joint."""
    free = [f"{link.name}_joint" for link in links if link.kind != "fixed" and not link.follows]
    return ({name: float(x) for name, x in zip(free, values, strict=True)}
            for values in (rng.uniform(-0.5, 0.5, len(free)), rng.uniform(-1, 1, len(free))))


def accelerations(model, links):
    motion = Motion(model)
    return np.array([motion.acceleration(
        f"{link.name}_joint_{'speed' if link.kind == 'prismatic' else 'rate'}")
        for link in links if link.kind != "fixed"])


def seeds(count):
    """Return seeds; all but the first few are slow: each derives a robot."""
    few = 1
    return [*range(few), *(pytest.param(k, marks=pytest.mark.slow) for k in range(few, count))]


@pytest.mark.parametrize("seed", seeds(100))
def test_urdf_moves_as_pinocchio_has_it(tmp_path, seed):
    """Trees of hinges, slides, fixed links and dampers have Pinocchio's accelerations."""
    pin = pytest.importorskip("pinocchio", reason="pip install gyrospark[pinocchio]")
    rng = np.random.default_rng(seed)
    links = random_tree(rng, int(rng.integers(1, 5)), mimic=False)
    path = tmp_path / "random.urdf"
    path.write_text(urdf_text(links, rng))
    angles, rates = start(links, rng)
    reference = pin.buildModelFromUrdf(str(path))
    q, v, tau = pin.neutral(reference), np.zeros(reference.nv), np.zeros(reference.nv)
    damping = {f"{link.name}_joint": link.damping for link in links}
    for joint, name in zip([*reference.joints][1:], [*reference.names][1:], strict=True):
        x, i = angles[name], joint.idx_q
        q[i:i + joint.nq] = x if joint.nq == 1 else (math.cos(x), math.sin(x))
        v[joint.idx_v] = rates[name]
        tau[joint.idx_v] = -damping[name] * rates[name]
    a = pin.aba(reference, reference.createData(), q, v, tau)
    expected = np.array([a[reference.joints[reference.getJointId(name)].idx_v] for name in angles])
    joint_accelerations = accelerations(
        gs.load_model(path, ignore="limits", angles=angles, rates=rates), links)
    assert np.abs(joint_accelerations - expected).max() <= CLOSE * np.abs(expected).max()


@pytest.mark.parametrize("seed", seeds(100))
def test_sdf_moves_as_the_equal_urdf(tmp_path, seed):
    """The same tree in SDF, with poses and axes in any frames and order, moves the same."""
    rng = np.random.default_rng(1000 + seed)
    links = random_tree(rng, int(rng.integers(1, 4)))
    files = tmp_path / "random.urdf", tmp_path / "random.sdf"
    files[0].write_text(urdf_text(links))
    files[1].write_text(sdf_text(links, rng))
    angles, rates = start(links, rng)
    by_urdf, by_sdf = (accelerations(gs.load_model(
        file, ignore="limits", angles=angles, rates=rates), links) for file in files)
    assert np.abs(by_sdf - by_urdf).max() <= CLOSE * np.abs(by_urdf).max()
